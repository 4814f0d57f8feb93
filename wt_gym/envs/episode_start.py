"""How an episode begins: its wind, its faults and the state of the turbine, drawn or as the options of a reset say."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.base.errors import did_you_mean
from wt_gym.control import OperatingPoint
from wt_gym.control.operating_point import starting_point
from wt_gym.envs.arguments import check_number, shown
from wt_gym.envs.start import Start, steady_start
from wt_gym.simulation.drivetrain.drives import available_torque
from wt_gym.simulation.drivetrain.faults import DriveFault, SensorBias, checked_faults
from wt_gym.wind.inflow import start_speed

if TYPE_CHECKING:
    from collections.abc import Callable

    from wt_gym.control.controllers.controller import StartsTurbine
    from wt_gym.envs.dial import DialCourse, DialDraws
    from wt_gym.envs.fault_draws import DrawnFault, FaultDraws
    from wt_gym.envs.power_reference import PowerReference, PowerReferenceDraws
    from wt_gym.envs.running_start import RunningStart
    from wt_gym.envs.variation import DrawnVariation
    from wt_gym.envs.wind_sampler import EpisodeWind, WindSampler
    from wt_gym.turbines import Turbine

__all__ = ["RESET_OPTIONS", "Beginning", "EpisodeStarts"]

_WIND = ("wind_speed", "wind_seed", "time_offset")
_POINT = ("rotor_speed", "pitch", "generator_torque")
_NUMBERS = (*_POINT, "azimuth", "yaw")
RESET_OPTIONS = (
    "wind_speed", "wind_seed", "time_offset", "inflow", "rotor_speed", "pitch", "azimuth", "yaw", "generator_torque",
    "faults", "start_number",
    "power_reference", "dial", "fault",
)  # fmt: skip
_FIRST_START = 40_000_000
"""Seed of the random numbers of a numbered beginning, beside its number."""


@dataclass(frozen=True)
class Beginning:
    """What an episode begins with.

    Attributes
    ----------
    wind : EpisodeWind
    start : Start
    yaw : float
        Of the nacelle [rad].
    faults : tuple
    drawn : DrawnVariation, optional
        What the episode has of a variation.
    reference : PowerReference, optional
        What a grid operator asks for.
    dial : DialCourse, optional
        Factors on the weights of the reward.
    fault : DrawnFault, optional
        What of the faults of the environment breaks; its faults are among ``faults``.
    """

    wind: EpisodeWind
    start: Start
    yaw: float
    faults: tuple[DriveFault | SensorBias, ...]
    drawn: DrawnVariation | None = None
    reference: PowerReference | None = None
    dial: DialCourse | None = None
    fault: DrawnFault | None = None


class EpisodeStarts:
    """Beginnings of the episodes of an environment.

    Parameters
    ----------
    turbine : Turbine
    winds : WindSampler
    running : RunningStart or None
        Starts of the running turbine; None where all are steady.
    count : int, optional
        Of the beginnings that are drawn from; None: every one is another.
    starter : StartsTurbine, optional
        Of the base controller: in winds in which it does not run a turbine for long, the turbine starts parked.
    references : PowerReferenceDraws, optional
        Draws what a grid operator asks for.
    dials : DialDraws, optional
        Draws the factors on the weights of the reward.
    breakages : FaultDraws, optional
        Draws what breaks.
    """

    def __init__(
        self,
        turbine: Turbine,
        winds: WindSampler,
        running: RunningStart | None,
        count: int | None = None,
        starter: StartsTurbine | None = None,
        references: PowerReferenceDraws | None = None,
        dials: DialDraws | None = None,
        breakages: FaultDraws | None = None,
    ):
        self._turbine, self._winds, self.running, self._count = turbine, winds, running, count
        self._starter, self._references, self._dials = starter, references, dials
        self._breakages = breakages

    def draw(
        self,
        rng: np.random.Generator,
        options: dict[str, Any] | None,
        length: float | None,
        draw: Callable[[int | None], DrawnVariation | None] | None = None,
    ) -> Beginning:
        """Draw a beginning.

        Parameters
        ----------
        rng : numpy.random.Generator
        options : dict, optional
            Of the reset.
        length : float, optional
            Of the episode, where it is known [s].
        draw : callable, optional
            Draws a variation, for a numbered beginning that of its number.

        Raises
        ------
        ValueError
            If an option is unknown or no number.
        wt_gym.base.errors.InflowError
            If a wind is asked for that cannot be had.
        """
        given = _checked(options)
        numbered, number = self._numbered(rng, given)
        beginning = self._drawn(numbered, number, given, length, draw)
        # of the random numbers of the episode: a numbered beginning comes with any factors
        return replace(beginning, dial=self._dial(rng, given))

    def _drawn(
        self,
        rng: np.random.Generator,
        number: int | None,
        given: dict[str, Any],
        length: float | None,
        draw: Callable[[int | None], DrawnVariation | None] | None,
    ) -> Beginning:
        """Beginning without its dial."""
        drawn = None if draw is None else draw(number)
        faults = checked_faults(given.get("faults", ()), self._turbine.n_blades)
        yaw = check_number("yaw", given.get("yaw", 0.0), "rad")
        chosen = {name: given[name] for name in _WIND if name in given}
        winds = self._winds if drawn is None else drawn.sampler(self._winds)
        if "inflow" in given:
            wind = winds.given(given["inflow"], **chosen)
        else:
            wind = winds.sample(rng, **chosen, length=length, heading=yaw)
        azimuth = rng.uniform(0.0, 2.0 * math.pi)
        if drawn is not None:
            wind = drawn.turned(wind)
            faults = (*faults, *drawn.faults)
        start = self._start(rng, wind, given, yaw, azimuth)
        reference, fault = self._reference(rng, wind, given), self._fault(rng, given)
        if fault is not None:
            faults = (*faults, *fault.faults)
        iced = fault is not None and fault.ice is not None
        if iced or (drawn is not None and drawn.structural):  # the motion of a structure belongs to it
            start = replace(start, motion=None)
        return Beginning(wind, start, yaw, faults, drawn, reference, fault=fault)

    def _fault(self, rng: np.random.Generator, given: dict[str, Any]) -> DrawnFault | None:
        """What breaks in the episode."""
        chosen = given.get("fault")
        if self._breakages is not None:
            return self._breakages.draw(rng, chosen)
        if chosen is not None:
            raise ValueError(
                f"fault must be left out of a reset without fault_kinds of the environment, got {shown(chosen)}"
            )
        return None

    def _reference(self, rng: np.random.Generator, wind: EpisodeWind, given: dict[str, Any]) -> PowerReference | None:
        """What a grid operator asks for in the episode."""
        chosen = given.get("power_reference")
        if self._references is not None:
            return self._references.draw(rng, wind, chosen)
        if chosen is not None:
            raise ValueError(
                f"power_reference must be left out of a reset without a power_reference of the environment, got "
                f"{shown(chosen)}"
            )
        return None

    def _dial(self, rng: np.random.Generator, given: dict[str, Any]) -> DialCourse | None:
        """Factors on the weights of the reward in the episode."""
        chosen = given.get("dial")
        if self._dials is not None:
            return self._dials.draw(rng, chosen)
        if chosen is not None:
            raise ValueError(
                f"dial must be left out of a reset without dial_weights of the environment, got {shown(chosen)}"
            )
        return None

    def _numbered(self, rng: np.random.Generator, given: dict[str, Any]) -> tuple[np.random.Generator, int | None]:
        """Random numbers of one of the beginnings and its number, where there are so many and no more."""
        chosen, count = given.get("start_number"), self._count
        if count is None:
            if chosen is not None:
                raise ValueError(f"start_number must be left out without starts, got {chosen!r}")
            return rng, None
        drawn = int(rng.integers(count))  # also where one is chosen: what is drawn later stays as it is
        if chosen is not None and not (isinstance(chosen, int | np.integer) and 0 <= chosen < count):
            raise ValueError(f"start_number must be a whole number from 0 to {count - 1}, got {shown(chosen)}")
        number = drawn if chosen is None else int(chosen)
        return np.random.default_rng((_FIRST_START, number)), number

    def _start(
        self, rng: np.random.Generator, wind: EpisodeWind, given: dict[str, Any], yaw: float, azimuth: float
    ) -> Start:
        """Start of the running turbine in the wind of the episode, or a steady one where there is none or one is asked.

        A steady start has the operating point of the wind, or what the options of the reset say.
        """
        parked = self._parked(wind)
        if self.running is not None and not parked and not any(name in given for name in _POINT):
            chosen = float(given["azimuth"]) if "azimuth" in given else None
            start = self.running.draw(wind, yaw, rng, chosen)
            if start is not None:
                return start
        point = self._point(wind)
        speed, pitch = float(given.get("rotor_speed", point.rotor_speed)), float(given.get("pitch", point.pitch))
        torque = min(point.generator_torque, available_torque(self._turbine.drivetrain, speed))
        torque, azimuth = float(given.get("generator_torque", torque)), float(given.get("azimuth", azimuth))
        return steady_start(speed, pitch, torque, azimuth, self._turbine.n_blades)

    def _parked(self, wind: EpisodeWind) -> bool:
        """Whether the controller lets the turbine stand in the wind of the start."""
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
    given = dict(options or {})
    for name in given:
        if name not in RESET_OPTIONS:
            near = did_you_mean(name, RESET_OPTIONS, ".")
            raise ValueError(f"reset has no option {name!r}{near} Its options are {', '.join(RESET_OPTIONS)}")
    return given | {name: check_number(name, given[name], finite=False) for name in _NUMBERS if name in given}
