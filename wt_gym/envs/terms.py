"""Contracts of the environment: terms with their hooks, the beginning of an episode, a transition, a snapshot."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self

import numpy as np

from wt_gym.envs.wind_sampler import EpisodeWind, WindSampler
from wt_gym.simulation import Signals
from wt_gym.simulation.drivetrain.faults import DriveFault, SensorBias
from wt_gym.turbines import BladeIce, Turbine
from wt_gym.wind import Inflow

if TYPE_CHECKING:
    from wt_gym.envs.running_record import Start


class Stateful:
    """Something that remembers values within an episode, for snapshots."""

    remembered: ClassVar[tuple[str, ...]] = ()
    """Attributes that make the memory."""

    def memory(self) -> dict[str, Any]:
        """Copy of the values that it remembers, for `recall`."""
        return copy.deepcopy({name: self.__dict__[name] for name in self.remembered})

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Continue with a memory."""
        self.__dict__.update(copy.deepcopy(memory))


class Term(Stateful):
    """A feature of an environment, in a file with its options, its draw, its channels and its part of `info`.

    It has those of these methods that it needs, and the environment keeps lists of them; a feature that is off is in
    none of the lists.

    - ``draw(request)``: draw for an episode, in the turn that `wt_gym.envs.episode_start.DRAW_ORDER` gives it;
    - ``begin(beginning)``: start an episode;
    - ``groups()``: groups of observation channels by name;
    - ``follow(transition)``: take notice of a step;
    - ``adjust(reward, terms, step, time)``: change the reward of a step that began at a time [s];
    - ``info()``: part of the info of every reset and step;
    - ``close()``: release what it holds.
    """

    option: ClassVar[str] = ""
    """Option of a reset that takes the place of the draw."""


def hooks(terms: Iterable[object], name: str) -> list[Callable[..., Any]]:
    """Methods of a name of those terms that have it."""
    return [getattr(term, name) for term in terms if hasattr(term, name)]


@dataclass(frozen=True)
class Plant:
    """The turbine that an episode simulates."""

    turbine: Turbine
    number: int = -1  #: place in the set of a variation; -1: nominal turbine
    ice: BladeIce | None = None

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self  # never changes


@dataclass
class Request:
    """An episode that is being drawn; every step of `wt_gym.envs.episode_start.DRAW_ORDER` fills in its part."""

    rng: np.random.Generator  #: Random numbers of the beginning: those of the episode, or of a numbered beginning
    episode_rng: np.random.Generator  #: Random numbers of the episode
    seed: int  #: Seed of the random numbers of the episode
    seeded: bool  #: The reset gave it
    number: int | None  #: Number of the beginning
    options: dict[str, Any]  #: Checked options of the reset
    length: float | None  #: Length of the episode, where it is known [s]
    winds: WindSampler
    plant: Plant
    yaw: float  #: yaw of the nacelle [rad]
    faults: tuple[DriveFault | SensorBias, ...]
    turns: list[Callable[[EpisodeWind], EpisodeWind]] = field(default_factory=list)  #: Changes of the drawn wind
    drawn: dict[str, Any] = field(default_factory=dict)  #: Results by name of the term
    wind: EpisodeWind = None  # type: ignore[assignment]  # until it is drawn
    start: Start = None  # type: ignore[assignment]  # until it is drawn


@dataclass(frozen=True)
class Beginning:
    """Result of the draws for an episode.

    A drawn object may have ``equip(operation)``, which puts it into the operation of the turbine, ``first_info()``,
    its part of the info of a reset, and ``key``, which tells it from others where it changes what a controller does.
    """

    wind: EpisodeWind
    start: Start
    yaw: float  #: yaw of the nacelle [rad]
    faults: tuple[DriveFault | SensorBias, ...]
    plant: Plant
    drawn: Mapping[str, Any]  #: Drawn objects by name of the term


@dataclass(frozen=True)
class EnvSnapshot:
    """State from which an environment continues, see `wt_gym.envs.WindTurbineEnv.snapshot`."""

    simulator: Any  #: State of the simulator; None of one that failed
    wind: EpisodeWind
    random: dict[str, Any]  #: State of the random numbers
    parts: dict[str, Any]  #: Memory by name of the part


# ---- reward ----


@dataclass(frozen=True)
class Transition:
    """One control step as the reward sees it.

    Attributes
    ----------
    before, after : Signals
        Signals at the beginning and the end of the step; ``after["time"]`` is the time [s].
    dt : float
        Length of the step [s].
    inflow : Inflow, optional
        The undisturbed wind of the episode.
    action : numpy.ndarray, shape (n_act,), optional
        The validated action that led here.
    demanded_power : float, optional
        Demand of a grid operator at the end of the step [W].
    """

    turbine: Turbine
    before: Signals
    after: Signals
    dt: float
    inflow: Inflow | None = None
    action: np.ndarray | None = None
    demanded_power: float | None = None


class RewardTerm(Protocol):
    """A part of the reward: its name in ``info["reward_terms"]``, its weight, and its value for a step.

    A term that remembers something between steps also has ``reset(turbine, signals)``, called at the start of every
    episode with the first signals, and keeps its memory in plain attributes, so that ``copy.deepcopy`` is a snapshot.
    With a true attribute ``begins_with_means`` it gets the running means of root and tower moments in their place.
    A term whose rate is not bounded by its weight says so by an attribute ``worst_rate`` [1/s].
    """

    if TYPE_CHECKING:  # read only: a frozen dataclass will do

        @property
        def name(self) -> str: ...

        @property
        def weight(self) -> float: ...

    else:
        name: str
        weight: float

    def __call__(self, transition: Transition) -> float:
        """Rate of reward [1/s], at least -weight."""
        ...


def bounded_square(square: float) -> float:
    """Penalty x^2 / (1 + x^2) in [0, 1) of a square x^2."""
    return square / (1.0 + square) if square < math.inf else 1.0


class HighPass:
    """First-order high-pass filter, exact for a signal held over the step.

    Parameters
    ----------
    time_constant : float
        [s]
    mean : float
        Mean of the signal before the start.
    """

    def __init__(self, time_constant: float, mean: float):
        self._time_constant, self.mean = float(time_constant), float(mean)
        self._dt, self._share = 0.0, 0.0

    def __call__(self, value: float, dt: float) -> float:
        """Deviation of ``value`` from the mean of the last ``time_constant`` seconds."""
        if dt != self._dt:
            self._dt, self._share = dt, 1.0 - math.exp(-dt / self._time_constant)
        self.mean += self._share * (value - self.mean)
        return value - self.mean
