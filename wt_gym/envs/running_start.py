"""Episodes that begin amid the operation of a turbine: a start in the distribution of the running turbine.

A turbine that is put into turbulence at rest is another one than that which runs in it: the side-side motion of the
tower, for one, needs minutes to build up. So the turbine is recorded under its base controller in winds like those of
the episodes (`wt_gym.envs.running_record`), and an episode begins with an instant of such a record: rotor speed, pitch,
torque, azimuth, the motion of tower and blades, and what the controller remembers. The wake is that of a steady state
with the mean thrust before (`wt_gym.simulation.Simulator.reset`). At fidelities whose structure is not that of the
record the blades follow their loads, and the tower swings in its first modes as the recorded one. Which instant is
decided by the wind before the start of the episode.
"""

from __future__ import annotations

import copy
import math
from dataclasses import replace
from typing import TYPE_CHECKING, cast

import numpy as np

from wt_gym.control.controllers import make_controller, parts_of
from wt_gym.control.controllers.power_tracking import power_tracking_of
from wt_gym.envs.record_store import digest_of_controller, kept_record
from wt_gym.envs.running_record import WINDOWS, StartRecorder, rotor_wind
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.wind.protocol import PointInflow

if TYPE_CHECKING:
    from collections.abc import Callable

    from wt_gym.control.controllers import Controller
    from wt_gym.control.controllers.power_tracking import PowerTracking
    from wt_gym.envs.start import Start
    from wt_gym.envs.wind_sampler import EpisodeWind, WindSampler
    from wt_gym.simulation import Fidelity
    from wt_gym.turbines import Turbine

__all__ = ["RunningStart"]

BIN = 2.0
"""Distance of the wind speeds at which the turbine is recorded [m/s]."""
_BUILT_IN = "wt_gym.control.controllers"
_STEADY = 1e-3
"""Range of the wind before the start, over its mean, up to which it is steady."""
_HIGHEST = 0.97
"""Rotor speed over that at which an episode ends, beyond which none begins."""


class RunningStart:
    """Starts of a turbine that runs under a controller in turbulence.

    Records are made in turbulence like that of a sampler: of its class, model, spectra and profile. Where a sampler has
    winds of the user, that is turbulence of the turbine's class at their mean speed.

    Parameters
    ----------
    turbine : Turbine
    fidelity : str or Fidelity
        Of the episodes. Records are made with "training", or "training-torsion" for blades that twist.
    controller : Controller
        The base controller; it is copied. One that is not built in is started from the present demand, in records
        under the baseline: what it remembers need not be made of numbers.
    winds : WindSampler
    overspeed_limit : float
        Rotor speed over rated at which an episode ends.
    power_share : callable, optional
        Mean power that is asked for in a wind [m/s], over rated power: nothing is asked for in a record, and a
        controller that follows a demanded power follows this one there.
    """

    def __init__(
        self,
        turbine: Turbine,
        fidelity: str | Fidelity,
        controller: Controller,
        winds: WindSampler,
        overspeed_limit: float,
        power_share: Callable[[float], float] | None = None,
    ):
        self._turbine, self._winds = turbine, winds
        twists = isinstance(fidelity, str) and fidelity.endswith("-torsion")
        self._is_own = any(not type(part).__module__.startswith(_BUILT_IN) for part in parts_of(controller))
        recorded_controller = make_controller("discon", turbine) if self._is_own else copy.deepcopy(controller)
        self._recorder = StartRecorder(turbine, "training-torsion" if twists else "training", recorded_controller)
        recorded = fidelity_of(self._recorder.fidelity)
        self._same_model = fidelity_of(fidelity) == recorded and recorded.takes_motion
        tracking = power_tracking_of(recorded_controller)
        self._power_share = None if tracking is None else power_share
        self._recorders: dict[float, tuple[StartRecorder, str]] = {}
        self._fastest = _HIGHEST * overspeed_limit * turbine.drivetrain.rated_rotor_speed

    def draw(self, wind: EpisodeWind, yaw: float, rng: np.random.Generator, azimuth: float | None) -> Start | None:
        """Draw a start.

        Parameters
        ----------
        wind : EpisodeWind
        yaw : float
            Nacelle yaw [rad].
        rng : numpy.random.Generator
            Two numbers are drawn of it.
        azimuth : float, optional
            Of blade 1 [rad]; by default that of the record.

        Returns
        -------
        Start or None
            None where the wind has not changed before the start, blows below cut-in or above cut-out, is like none in
            which the turbine was recorded, or the turbine cannot run in it.
        """
        which, among = rng.random(2).tolist()
        speed = self._speed(wind, yaw)
        low, high = self._turbine.cut_in, self._turbine.cut_out
        if speed is None or not low <= speed <= high:
            return None
        # Of the speeds with records on both sides one is drawn, the nearer one as much more often as it is nearer: the
        # distribution is then interpolated linearly.
        speed = min(max(BIN * math.floor(speed / BIN + which), low), high)
        record = kept_record(*self._recorder_at(speed), self._winds, speed)
        start = None if record is None else record.start(wind.inflow, yaw, among, azimuth, self._fastest)
        if start is None:
            return None
        if self._is_own:
            start = replace(start, before=None)
        return start if self._same_model else replace(start, motion=None)

    def _recorder_at(self, speed: float) -> tuple[StartRecorder, str]:
        """Recorder for a wind speed [m/s], with the identity of its controller."""
        place = 0.0 if self._power_share is None else speed
        if place not in self._recorders:
            recorder = self._recorder
            if self._power_share is not None:
                controller = copy.deepcopy(recorder.controller)
                cast("PowerTracking", power_tracking_of(controller)).level = self._power_share(speed)
                recorder = StartRecorder(recorder.turbine, recorder.fidelity, controller)
            self._recorders[place] = recorder, digest_of_controller(recorder.controller)
        return self._recorders[place]

    def _speed(self, wind: EpisodeWind, yaw: float) -> float | None:
        """Mean speed of the turbulence before the start [m/s]; None where the wind does not change, or has no past.

        Of turbulence made here it is that of the episode. Other winds are asked: those that are known to have a wind
        at any time.
        """
        if not isinstance(wind.inflow, PointInflow):
            return None
        times = -self._recorder.time_scale * np.linspace(0.0, WINDOWS[-1], 25)
        speeds = np.array([rotor_wind(wind.inflow, self._turbine, yaw, time)[0] for time in times.tolist()])
        if np.ptp(speeds) <= _STEADY * abs(speeds.mean()):
            return None
        return wind.wind_speed if wind.wind_seed >= 0 else float(speeds.mean())
