"""The controller alone in the wind of an episode: what it earns is taken off a relative reward.

It always does the same from the same beginning, so what it earned is kept, for this process and for others, and a
turbine under the controller alone is simulated only where nothing is known: beside the first episode from a beginning,
and beyond the end of the longest one.
"""

from __future__ import annotations

import hashlib
import pickle
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.base.canary import software
from wt_gym.control.controllers import parts_of
from wt_gym.envs.canary import canary_of
from wt_gym.envs.operation import make_simulator
from wt_gym.envs.reward_store import Course, kept_course, new_course, store_course
from wt_gym.envs.terms import EnvSnapshot, Term
from wt_gym.simulation.contract import fingerprint
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.wind import (
    MirroredInflow,
    PathInflow,
    SteadyInflow,
    TransientInflow,
    TurbulentInflow,
    TurningInflow,
)

if TYPE_CHECKING:
    from wt_gym.envs.running_record import Start
    from wt_gym.envs.terms import Beginning, RewardTerm
    from wt_gym.envs.turbine_env import WindTurbineEnv
    from wt_gym.envs.wind_sampler import EpisodeWind
    from wt_gym.wind import Inflow, TurbulenceBox

__all__ = ["Twin"]

_OWN_MODULES = ("wt_gym.control.controllers", "wt_gym.envs")
"""Whose objects are told from others by what they remember, and whose sources are known."""


@dataclass(frozen=True)
class TwinSnapshot:
    """State of the controller alone.

    Attributes
    ----------
    beginning : Beginning
        Of the episode.
    course : Course
        Rewards from there.
    steps : int
        That were simulated.
    state : EnvSnapshot or None
        Of the simulation; None where none runs.
    """

    beginning: Beginning
    course: Course
    steps: int
    state: EnvSnapshot | None


class Twin(Term):
    """Rewards of the controller alone, from the beginnings of the episodes of an environment.

    Parameters
    ----------
    env : WindTurbineEnv
        The turbine under the controller alone: it gets the winds that are drawn elsewhere, and has none itself.
    wind_key : tuple
        What decides on turbulence made here beside its speed, seed and time.

    Attributes
    ----------
    course : Course
        Of this episode.
    """

    course: Course

    def __init__(self, env: WindTurbineEnv, wind_key: tuple[Any, ...]):
        self.env, self._wind_key = env, wind_key
        self._identity = _identity(env)
        self._beginning: Beginning | None = None
        self._simulated: Course | None = None  # in which the environment stands
        self._steps = 0  # that it has made there

    def begin(self, beginning: Beginning) -> None:
        """Start an episode with the draws that change what the controller does: nothing is simulated yet."""
        self.keep()
        drawn = {name: one for name, one in beginning.drawn.items() if hasattr(one, "key")}
        beginning = replace(beginning, drawn=drawn)
        self._beginning = beginning
        key = self._key(beginning)
        names = tuple(term.name for term in self.env.reward_terms)
        self.course = new_course(names) if key is None else kept_course(key, names)

    def keep(self) -> None:
        """Keep what was recorded in this episode for other processes."""
        if self._beginning is not None:
            store_course(self.course)

    def adjust(self, reward: float, terms: dict[str, float], step: int, _: float) -> tuple[float, dict[str, float]]:
        """Take off what the controller alone earns in the same step."""
        other = self.terms(step)
        return reward - sum(other.values()), {name: value - other.get(name, 0.0) for name, value in terms.items()}

    def terms(self, step: int) -> dict[str, float]:
        """Reward terms of a step of the episode, from 0; after the end of the twin those of its last one."""
        course = self.course
        if step >= len(course) and not course.ended:
            self._simulate(step)
        return course.terms(step)

    def _simulate(self, step: int) -> None:
        """Record up to a step; what is known already is passed through again if the simulation does not stand there."""
        course, env = self.course, self.env
        assert self._beginning is not None
        if self._simulated is not course:
            env._begin(self._beginning)
            self._simulated, self._steps = course, 0
        nothing = np.zeros(env.layout.action.size)
        while self._steps <= step and not course.ended:
            *_, info = env.step(nothing)
            course.append(self._steps, info["reward_terms"], not env._running)
            self._steps += 1

    # ---- what it is ----

    def _key(self, beginning: Beginning) -> str | None:
        """Name of the course of a beginning; None where it cannot be told from every other one."""
        wind = self._wind(beginning.wind)
        if self._identity is None or wind is None:
            return None
        limits = self.env.limits.overspeed, self.env.limits.standstill
        drawn = [(name, one.key) for name, one in beginning.drawn.items()]
        others = beginning.yaw, beginning.faults, drawn
        return fingerprint(self._identity, limits, wind, _start(beginning.start), others)[:40]

    def _wind(self, wind: EpisodeWind) -> tuple[Any, ...] | None:
        """What tells a wind from others."""
        told = _inflow(wind.inflow, wind.wind_seed >= 0)
        return None if told is None else (self._wind_key, wind.wind_speed, wind.wind_seed, wind.time_offset, told)

    # ---- snapshots ----

    def memory(self) -> TwinSnapshot:  # type: ignore[override]  # no names
        """Take a snapshot; the rewards are shared with it, as they never change."""
        assert self._beginning is not None
        state = self.env.snapshot() if self._simulated is self.course else None
        return TwinSnapshot(self._beginning, self.course, self._steps, state)

    def recall(self, snapshot: TwinSnapshot) -> None:  # type: ignore[override]
        """Continue from a snapshot; a simulation of the same course continues from where it is."""
        self._beginning, self.course = snapshot.beginning, snapshot.course
        if self._simulated is not self.course and snapshot.state is not None:
            self.env.restore(snapshot.state)
            self._simulated, self._steps = self.course, snapshot.steps

    def close(self) -> None:
        """Keep what was recorded, and release the simulator."""
        self.keep()
        self.env.close()
        self._simulated = None


def _identity(env: WindTurbineEnv) -> str | None:
    """What decides on the rewards of a turbine under its controller beside the beginning and the limits.

    None where something is from outside of this package: it may do another thing tomorrow, or draw numbers. The canary
    counts to its last digit here: rewards must not depend on which version has filled the cache.
    """
    controller, terms = env.operation.controller, env.reward_terms
    parts: list[object] = [] if controller is None else [*parts_of(controller)]
    if env.operation.make_simulator is not make_simulator or not all(map(_is_own, [*parts, *terms])):
        return None
    described = _digest(controller), _digest(terms)
    canary = canary_of(env.turbine, env.fidelity, type(env))
    return fingerprint(env.turbine, fidelity_of(env.fidelity), env.control_dt, *described, canary, software())


def _is_own(part: object | RewardTerm) -> bool:
    """Whether an object is made by this package alone: a function as a reward is not."""
    own = type(part).__module__.startswith(_OWN_MODULES)
    return own and not hasattr(part, "function")


def _digest(value: object) -> str:
    """Digest of an object that was just made, by what it is made of."""
    return hashlib.sha256(pickle.dumps(value)).hexdigest()


def _inflow(inflow: Inflow, made_here: bool) -> tuple[object, ...] | None:
    """What tells an inflow from others beside speed, seed and time of turbulence; None where that is not known."""
    if isinstance(inflow, TurningInflow):
        inner = _inflow(inflow.inner, made_here)
        return None if inner is None else (type(inflow).__name__, inflow.times, inflow.directions, *inner)
    if isinstance(inflow, MirroredInflow):
        inner = _inflow(inflow.inner, made_here)
        return None if inner is None else (type(inflow).__name__, *inner)
    if isinstance(inflow, TurbulentInflow) and made_here:
        return inflow.steady, inflow.beyond_grid, *_box(inflow.box)
    if type(inflow) is PathInflow and (made_here or inflow.box is None):
        path = type(inflow).__name__, inflow.times, inflow.speeds, inflow.scales, inflow.offset, inflow.profile
        return (*path, None) if inflow.box is None else (*path, *_box(inflow.box))
    if type(inflow) in (SteadyInflow, TransientInflow):
        return (inflow,)
    return None


def _box(box: TurbulenceBox) -> tuple[object, ...]:
    """What tells turbulence made here from others beside its seed."""
    return box.mean_speed, box.time_step, box.scale, box.description


def _start(start: Start) -> tuple[object, ...]:
    """What tells a start from others; the signals before it are for observations alone."""
    told = [getattr(start, f.name) for f in fields(start) if f.name not in ("deviations", "trail")]
    return (*told, *sorted(start.deviations.items(), key=lambda item: item[0]))
