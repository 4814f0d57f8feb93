"""Starts of episodes amid the operation of the turbine.

The side-side motion of a tower is damped so little that it lasts for minutes. In turbulence an episode therefore starts
with an instant of a record of the running turbine (`wt_gym.envs.running_record`): rotor speed, pitch, torque, azimuth,
the motion of tower and blades, and the memory of the base controller. The wake is that of a steady state with the mean
thrust before (`wt_gym.simulation.Simulator.reset`). At fidelities whose structure is not that of the record the blades
follow their loads, and the tower swings in its first modes as the recorded one. The wind before the start of the
episode decides on the instant. A rotor that turns in the other sense than the recorded one starts as its mirror image
in the mirrored wind.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from functools import cache
from multiprocessing import parent_process
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.envs.record_store import find_record
from wt_gym.envs.running_record import WINDOWS, rotor_wind, time_scale
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.wind import MirroredInflow
from wt_gym.wind.inflow import PointInflow

if TYPE_CHECKING:
    from wt_gym.envs.start import Start
    from wt_gym.envs.wind_sampler import EpisodeWind
    from wt_gym.simulation import Fidelity
    from wt_gym.turbines import Turbine

__all__ = ["RunningStart"]

_log = logging.getLogger(__name__)
_STEADY = 1e-3
"""Range of the wind before the start, over its mean, up to which it is steady."""
_HIGHEST = 0.97
"""Rotor speed over that at which an episode ends, beyond which none begins."""


class RunningStart:
    """Starts of a turbine that runs under a controller in turbulence.

    Parameters
    ----------
    turbine : Turbine
    fidelity : str or Fidelity
        Of the episodes.
    overspeed_limit : float
        Rotor speed over rated at which an episode ends.
    level : float
        Demanded power over the power that the wind allows [-].
    """

    def __init__(
        self,
        turbine: Turbine,
        fidelity: str | Fidelity,
        overspeed_limit: float,
        level: float = 1.0,
    ):
        self._turbine, self._fidelity, self._level = turbine, fidelity, level
        self._fastest = _HIGHEST * overspeed_limit * turbine.drivetrain.rated_rotor_speed

    def draw(self, wind: EpisodeWind, yaw: float, rng: np.random.Generator, azimuth: float | None) -> Start | None:
        """Draw a start.

        Parameters
        ----------
        wind : EpisodeWind
        yaw : float
            Nacelle yaw [rad].
        rng : numpy.random.Generator
            One number is drawn of it.
        azimuth : float, optional
            Of blade 1 [rad]; by default that of the record.

        Returns
        -------
        Start or None
            None where the wind has not changed before the start, blows below cut-in or above cut-out, or is like none
            in which the turbine was recorded, and where there is no record of the turbine.
        """
        number, speed = float(rng.random()), self._speed(wind, yaw)
        if speed is None or not self._turbine.cut_in <= speed <= self._turbine.cut_out:
            return None
        result = find_record(self._turbine, self._level)
        if result is None:
            _report_missing(self._turbine.name)
            return None
        file, record = result
        mirrored = file.mirrors(self._turbine)
        inflow, yaw = (MirroredInflow.of(wind.inflow), -yaw) if mirrored else (wind.inflow, yaw)
        start = record.start(self._turbine, inflow, speed, yaw, number, azimuth, self._fastest)
        if start is not None and mirrored:
            start = start.mirrored(self._turbine.n_blades)
        same_model = fidelity_of(self._fidelity) == fidelity_of(file.fidelity)
        return start if same_model or start is None else replace(start, motion=None)

    def _speed(self, wind: EpisodeWind, yaw: float) -> float | None:
        """Mean speed of the turbulence before the start [m/s]; None where the wind does not change, or has no past.

        Of turbulence made here it is that of the episode. Other winds are asked: those that are known to have a wind
        at any time.
        """
        if not isinstance(wind.inflow, PointInflow):
            return None
        times = -time_scale(self._turbine) * np.linspace(0.0, WINDOWS[-1], 25)
        speeds = np.array([rotor_wind(wind.inflow, self._turbine, yaw, time)[0] for time in times.tolist()])
        if np.ptp(speeds) <= _STEADY * abs(speeds.mean()):
            return None
        return wind.wind_speed if wind.wind_seed >= 0 else float(speeds.mean())


@cache
def _report_missing(name: str) -> None:
    """Once, and not by worker processes too."""
    if parent_process() is None:
        _log.warning(
            "episodes of %s start at the operating point of the wind, with the tower at rest: there is no record of it "
            "running in turbulence, which 'wt-gym record' makes",
            name,
        )
