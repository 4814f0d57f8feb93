"""The beginning of an episode: the order of its draws, its wind and the state of the turbine.

The side-side motion of a tower is damped so little that it lasts for minutes. In turbulence an episode therefore starts
with an instant of a record of the running turbine (`wt_gym.envs.running_record`): rotor speed, pitch, torque, azimuth,
the motion of tower and blades, and the memory of the base controller. The wake is that of a steady state with the mean
thrust before (`wt_gym.simulation.Simulator.reset`). At fidelities whose structure is not that of the record the blades
follow their loads, and the tower swings in its first modes as the recorded one. The wind before the start of the
episode decides on the instant. A rotor that turns in the other sense than the recorded one starts as its mirror image
in the mirrored wind.
"""

import logging
import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from multiprocessing import parent_process
from typing import Any

import numpy as np

from wt_gym.base.errors import did_you_mean
from wt_gym.base.options import check_number, shown
from wt_gym.control import OperatingPoint
from wt_gym.control.controllers.controller import StartsTurbine
from wt_gym.control.operating_point import starting_point
from wt_gym.envs.record_store import find_record
from wt_gym.envs.running_record import WINDOWS, Start, rotor_wind, time_scale
from wt_gym.envs.terms import Beginning, Plant, Request, Term
from wt_gym.envs.wind_sampler import EpisodeWind, WindSampler
from wt_gym.simulation import Fidelity
from wt_gym.simulation.drivetrain.drives import available_torque
from wt_gym.simulation.drivetrain.faults import checked_faults
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.turbines import Turbine
from wt_gym.wind import MirroredInflow
from wt_gym.wind.inflow import PointInflow, start_speed

DRAW_ORDER = ("variation", "wind", "start", "power_reference", "fault", "dial", "sea")
"""Order of the draws of an episode: another one would give every seed another episode."""
FEATURE_OPTIONS = {
    "power_reference": "power_reference",
    "fault": "fault_kinds",
    "dial": "dial_weights",
    "sea": "a floating turbine",
}
"""Options of a reset that belong to a feature, by the argument of the environment that turns it on."""
_WIND = ("wind_speed", "wind_seed", "time_offset")
_POINT = ("rotor_speed", "pitch", "generator_torque")
_NUMBERS = (*_POINT, "azimuth", "yaw")
RESET_OPTIONS = (
    "wind_speed", "wind_seed", "time_offset", "inflow", "rotor_speed", "pitch", "azimuth", "yaw", "generator_torque",
    "faults", "start_number", *FEATURE_OPTIONS,
)  # fmt: skip
_FIRST_START = 40_000_000  # Seed of the random numbers of a numbered beginning, beside its number
_log = logging.getLogger(__name__)
_STEADY = 1e-3  # Range of the wind before the start, over its mean, up to which it is steady
_HIGHEST = 0.97  # Rotor speed over that at which an episode ends, beyond which none begins


class EpisodeStarts:
    """Beginnings of the episodes of an environment.

    Parameters
    ----------
    terms : mapping
        Terms of the environment by name; those with a ``draw`` have their turn in `DRAW_ORDER`.
    running : RunningStart or None
        Starts of the running turbine; None where all are steady.
    count : int, optional
        Number of the beginnings that are drawn from; None: every one is another.
    starter : StartsTurbine, optional
        Of the base controller: in winds in which it does not run a turbine for long, the turbine starts parked.
    """

    def __init__(
        self,
        turbine: Turbine,
        winds: WindSampler,
        terms: Mapping[str, Term],
        running: "RunningStart | None",
        count: int | None = None,
        starter: StartsTurbine | None = None,
    ):
        self._turbine, self._winds, self.running, self._count = turbine, winds, running, count
        self._starter = starter
        draws: dict[str, Any] = {name: term.draw for name, term in terms.items() if hasattr(term, "draw")}
        draws |= {"wind": self._draw_wind, "start": self._draw_start}
        self._draws = [draws[name] for name in DRAW_ORDER if name in draws]
        self._off = {option: argument for option, argument in FEATURE_OPTIONS.items() if option not in draws}

    def draw(
        self,
        rng: np.random.Generator,
        options: dict[str, Any] | None,
        length: float | None,
        seed: int = 0,
        seeded: bool = False,
    ) -> Beginning:
        """Draw a beginning.

        Parameters
        ----------
        options : dict, optional
            Of the reset.
        length : float, optional
            Of the episode, where it is known [s].
        seed : int
            Of the generator.
        seeded : bool
            The reset gave the seed.

        Raises
        ------
        ValueError
            If an option is unknown or no number.
        wt_gym.base.errors.InflowError
            If a wind is asked for that cannot be had.
        """
        chosen = _checked(options)
        for option, argument in self._off.items():
            if chosen.get(option) is not None:
                raise ValueError(
                    f"{option} must be left out of a reset without {argument} of the environment, got "
                    f"{shown(chosen[option])}"
                )
        numbered, number = self._numbered(rng, chosen.get("start_number"))
        request = Request(
            numbered, rng, seed, seeded, number, chosen, length, self._winds, Plant(self._turbine),
            check_number("yaw", chosen.get("yaw", 0.0), "rad"),
            checked_faults(chosen.get("faults", ()), self._turbine.n_blades),
        )  # fmt: skip
        for draw in self._draws:
            draw(request)
        plant, start = request.plant, request.start
        if plant.number >= 0 or plant.ice is not None:  # the motion of a structure belongs to it
            start = replace(start, motion=None)
        return Beginning(request.wind, start, request.yaw, request.faults, plant, request.drawn)

    def _numbered(self, rng: np.random.Generator, choice: Any) -> tuple[np.random.Generator, int | None]:
        """Random numbers of one of the beginnings and its number, where there are so many and no more."""
        count = self._count
        if count is None:
            if choice is not None:
                raise ValueError(f"start_number must be left out without starts, got {choice!r}")
            return rng, None
        drawn = int(rng.integers(count))  # also where one is chosen: what is drawn later stays as it is
        if choice is not None and not (isinstance(choice, int | np.integer) and 0 <= choice < count):
            raise ValueError(f"start_number must be a whole number from 0 to {count - 1}, got {shown(choice)}")
        number = drawn if choice is None else int(choice)
        return np.random.default_rng((_FIRST_START, number)), number

    def _draw_wind(self, request: Request) -> None:
        """Draw the wind of an episode."""
        options, winds = request.options, request.winds
        chosen = {name: options[name] for name in _WIND if name in options}
        if "inflow" in options:
            request.wind = winds.given(options["inflow"], **chosen)
        else:
            request.wind = winds.sample(request.rng, **chosen, length=request.length, heading=request.yaw)

    def _draw_start(self, request: Request) -> None:
        """Draw the start of the running turbine, or a steady one where there is none or an option fixes it.

        A steady start has the operating point of the wind, or what the options of the reset say.
        """
        options = request.options
        azimuth = request.rng.uniform(0.0, 2.0 * math.pi)
        for turn in request.turns:
            request.wind = turn(request.wind)
        wind = request.wind
        if self.running is not None and not self._parked(wind) and not any(name in options for name in _POINT):
            chosen = float(options["azimuth"]) if "azimuth" in options else None
            start = self.running.draw(wind, request.yaw, request.rng, chosen)
            if start is not None:
                request.start = start
                return
        point = self._point(wind)
        speed, pitch = float(options.get("rotor_speed", point.rotor_speed)), float(options.get("pitch", point.pitch))
        torque = min(point.generator_torque, available_torque(self._turbine.drivetrain, speed))
        request.start = Start(
            speed, np.full(self._turbine.n_blades, pitch), float(options.get("generator_torque", torque)),
            float(options.get("azimuth", azimuth)),
        )  # fmt: skip

    def _parked(self, wind: EpisodeWind) -> bool:
        """The controller lets the turbine stand in the wind of the start."""
        return self._starter is not None and not self._starter.runs_in(start_speed(wind.inflow))

    def _point(self, wind: EpisodeWind) -> OperatingPoint:
        """Operating point of the wind, or a rotor at rest with feathered blades."""
        if self._winds.parks or self._parked(wind):
            return OperatingPoint(0.0, min(self._turbine.pitch.max_pitch, 0.5 * math.pi), 0.0)
        return starting_point(self._turbine, wind.inflow)


def _checked(options: dict[str, Any] | None) -> dict[str, Any]:
    """Options of a reset with checked numbers."""
    if options is not None and not isinstance(options, dict):
        raise ValueError(f"the options of reset must be a dict, got {shown(options)}")
    chosen = dict(options or {})
    for name in chosen:
        if name not in RESET_OPTIONS:
            near = did_you_mean(name, RESET_OPTIONS, ".")
            raise ValueError(f"reset has no option {name!r}{near} Its options are {', '.join(RESET_OPTIONS)}")
    return chosen | {name: check_number(name, chosen[name], finite=False) for name in _NUMBERS if name in chosen}


class RunningStart:
    """Starts of a turbine that runs under a controller in turbulence.

    Parameters
    ----------
    fidelity : str or Fidelity
        Of the episodes.
    overspeed_limit : float
        Rotor speed over rated at which an episode ends.
    level : float
        Demanded power over the power that the wind allows [-].
    floating : bool
        The base controller damps the platform.
    """

    def __init__(
        self, turbine: Turbine, fidelity: str | Fidelity, overspeed_limit: float, level: float = 1.0,
        floating: bool = False,
    ):  # fmt: skip
        self._turbine, self._fidelity, self._level, self._floating = turbine, fidelity, level, floating
        self._fastest = _HIGHEST * overspeed_limit * turbine.drivetrain.rated_rotor_speed

    def draw(self, wind: EpisodeWind, yaw: float, rng: np.random.Generator, azimuth: float | None) -> Start | None:
        """Draw a start, by one random number, with an azimuth of blade 1 [rad], by default that of the record.

        Returns
        -------
        Start or None
            None where the wind has not changed before the start, blows below cut-in or above cut-out, or is like none
            in which the turbine was recorded, and where there is no record of the turbine.
        """
        number, speed = float(rng.random()), self._speed(wind, yaw)
        if speed is None or not self._turbine.cut_in <= speed <= self._turbine.cut_out:
            return None
        result = find_record(self._turbine, self._level, self._floating)
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

        Of turbulence made here it is that of the episode. Other winds are asked.
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
