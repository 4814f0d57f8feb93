"""The controller alone in the wind of an episode: its rewards are taken off a relative reward.

It always does the same from the same beginning, so its rewards are stored, in memory and on disk for other processes,
and a turbine under the controller alone is simulated only where nothing is stored: beside the first episode from a
beginning, and beyond the end of the longest one.
"""

from __future__ import annotations

import hashlib
import itertools
import pickle
import threading
import zipfile
from array import array
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.base.canary import software
from wt_gym.base.files import write_whole
from wt_gym.base.user_cache import cached_file, prune, read_cached, write_cached
from wt_gym.control.controllers import parts_of
from wt_gym.envs.canary import canary_of
from wt_gym.envs.fatigue import LOADS, present_loads
from wt_gym.envs.operation import make_simulator
from wt_gym.envs.terms import Beginning, EnvSnapshot, Term
from wt_gym.simulation.contract import fingerprint
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.wind import (
    Inflow,
    MirroredInflow,
    PathInflow,
    SteadyInflow,
    TransientInflow,
    TurbulenceBox,
    TurbulentInflow,
    TurningInflow,
)

if TYPE_CHECKING:
    from wt_gym.envs.running_record import Start
    from wt_gym.envs.turbine_env import WindTurbineEnv

MOST_NUMBERS = 8_000_000
"""Rewards in memory, 64 MB; the course that was asked for longest ago goes first."""
MOST_FILES = 4096
"""Files on disk, of some 30 kB for a minute by steps of 0.1 s; the oldest go first."""
_BETWEEN = 64  # Files written between two looks at how many there are
_courses: OrderedDict[str, Course] = OrderedDict()
_lock, _one_writes = threading.Lock(), threading.Lock()
_written = 0


class Course:
    """Reward terms of each step from the beginning of an episode on; they are appended and never change.

    Parameters
    ----------
    key : str or None
        Name under which it is kept; None: it is not.
    names : tuple of str
        Of the terms.
    """

    def __init__(self, key: str | None, names: tuple[str, ...]):
        self.key, self.names, self.ended = key, names, False  # ended: terminated with the last step
        self._numbers = array("d")  # step after step
        self._kept = 0  # steps that stand on the disk

    def __len__(self) -> int:
        return len(self._numbers) // len(self.names)

    def terms(self, step: int) -> dict[str, float]:
        """Terms of a step, or of the last one."""
        first = min(step, len(self) - 1) * len(self.names)
        return dict(zip(self.names, self._numbers[first : first + len(self.names)], strict=True))

    def rows(self, first: int, last: int) -> np.ndarray:
        """Numbers of the steps from the first up to the last one, without it (n, n_names)."""
        width = len(self.names)
        return np.array(self._numbers[first * width : last * width]).reshape(-1, width)

    def append(self, step: int, terms: Mapping[str, float], ended: bool) -> None:
        """Add the terms of a step, unless another turbine has come there first: it has earned the same."""
        with _lock:
            if step == len(self) and not self.ended:
                self._numbers.extend([terms[name] for name in self.names])
                self.ended = ended

    @property
    def path(self) -> Path | None:
        """File; None without a key, or a cache of the user."""
        return None if self.key is None else cached_file("twins", self.key[:2], f"{self.key}.npz")

    def load(self) -> None:
        """Take over what stands in its file, if there is one and it is sound."""
        if (path := self.path) is None:
            return

        def read(path: Path) -> tuple[Any, bool]:
            with np.load(path, allow_pickle=False) as file:
                names, rows, ended = tuple(file["names"].tolist()), file["rows"], bool(file["ended"])
            fits = names == self.names and rows.shape[1:] == (len(names),) and rows.dtype == np.float64
            if not (fits and np.isfinite(rows).all()):
                raise ValueError(f"it holds {names}, an array {rows.dtype}{rows.shape}")
            return rows, ended

        content = read_cached("rewards", path, read, (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile))
        if content is None:
            return
        rows, ended = content
        self._numbers, self.ended, self._kept = array("d", rows.ravel().tolist()), ended, len(rows)

    def save(self) -> None:
        """Write what has been added since it was read or written; a file that cannot be written costs another run."""
        if (path := self.path) is None:
            return
        with _one_writes:  # turbines in several threads may have the same course
            with _lock:
                rows, ended = np.array(self._numbers).reshape(-1, len(self.names)), self.ended
            if len(rows) <= self._kept:
                return
            table: dict[str, Any] = {"names": np.array(self.names), "rows": rows, "ended": ended}
            if write_cached("rewards", path, lambda file: write_whole(file, lambda opened: np.savez(opened, **table))):
                self._kept = len(rows)
                _tidy(path.parent.parent)


def kept_course(key: str, names: tuple[str, ...]) -> Course:
    """Course of a key: from memory, from the disk, or an empty one that is kept from now on."""
    with _lock:
        if key in _courses:
            _courses.move_to_end(key)
            return _courses[key]
    course = Course(key, names)
    course.load()
    with _lock:
        course = _courses.setdefault(key, course)  # another thread may have been faster
        _courses.move_to_end(key)
        total = sum(len(one) * len(one.names) for one in _courses.values())
        while total > MOST_NUMBERS and len(_courses) > 1:
            _, oldest = _courses.popitem(last=False)
            total -= len(oldest) * len(oldest.names)
    return course


def _tidy(folder: Path) -> None:
    """Remove the oldest files, once in a while."""
    global _written
    _written += 1
    if _written % _BETWEEN == 0:
        prune(folder.glob("*/*.npz"), MOST_FILES)


_OWN_MODULES = ("wt_gym.control.controllers", "wt_gym.envs")
"""Whose objects are told from others by what they remember, and whose sources are known."""


@dataclass(frozen=True)
class TwinSnapshot:
    """State of the controller alone."""

    beginning: Beginning  #: start of the episode
    course: Course  #: Rewards from there
    steps: int  #: simulated steps
    state: EnvSnapshot | None  #: state of the simulation; None where none runs


class Twin(Term):
    """Rewards of the controller alone, from the beginnings of the episodes of an environment.

    Parameters
    ----------
    env : wt_gym.envs.turbine_env.WindTurbineEnv
        The turbine under the controller alone: it gets the winds that are drawn elsewhere, and has none itself.
    wind_key : tuple
        Properties of turbulence made here beside its speed, seed and time.
    """

    course: Course  #: of this episode
    lead: int = 0  #: steps by which it is simulated ahead of the turbine, with its loads

    def __init__(self, env: WindTurbineEnv, wind_key: tuple[Any, ...]):
        self.env, self._wind_key = env, wind_key
        self._described, self._rewards = _description(env), len(env.reward_terms)
        self._beginning: Beginning | None = None
        self._simulated: Course | None = None  # in which the environment stands
        self._steps = 0  # that it has made there

    def begin(self, beginning: Beginning) -> None:
        """Start an episode with the draws that change what the controller does: nothing is simulated yet."""
        self.keep()
        drawn = {name: one for name, one in beginning.drawn.items() if hasattr(one, "key")}
        self._beginning = replace(beginning, drawn=drawn)
        key, names = self._key(self._beginning), tuple(term.name for term in self.env.reward_terms)
        if self.lead:
            names += LOADS
        self.course = Course(None, names) if key is None else kept_course(key, names)

    def keep(self) -> None:
        """Keep what was recorded in this episode for other processes."""
        if self._beginning is not None:
            self.course.save()

    def adjust(self, reward: float, terms: dict[str, float], step: int, _: float) -> tuple[float, dict[str, float]]:
        """Take off what the controller alone earns in the same step."""
        other = dict(itertools.islice(self.terms(step).items(), self._rewards))
        return reward - sum(other.values()), {name: value - other.get(name, 0.0) for name, value in terms.items()}

    def terms(self, step: int) -> dict[str, float]:
        """Reward terms of a step of the episode, from 0; after the end of the twin those of its last one."""
        course = self.course
        if step >= len(course) and not course.ended:
            self._simulate(step)
        return course.terms(step)

    def loads(self, step: int) -> np.ndarray:
        """`LOADS` of the next steps, from one on (n, 5), n being the lead, or less beyond the end of the twin."""
        course, last = self.course, step + self.lead
        if last > len(course) and not course.ended:
            self._simulate(last - 1)
        return course.rows(step, last)[:, self._rewards :]

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
            row = info["reward_terms"]
            if self.lead:
                row = row | dict(zip(LOADS, present_loads(env.reward_terms), strict=True))
            course.append(self._steps, row, not env._running)
            self._steps += 1

    # ---- what it is ----

    @cached_property
    def _identity(self) -> str | None:
        """Digest of all that decides on the rewards beside wind, start and limits; None where it is not known.

        The canary counts to its last digit here: rewards must not depend on which version has filled the cache. It is
        measured for the first episode, not when an environment is made.
        """
        env = self.env
        if self._described is None:
            return None
        canary = canary_of(env.turbine, env.fidelity, type(env))
        return fingerprint(env.turbine, fidelity_of(env.fidelity), env.control_dt, *self._described, canary, software())

    def _key(self, beginning: Beginning) -> str | None:
        """Name of the course of a beginning; None where it cannot be told from every other one."""
        wind = beginning.wind
        inflow = _inflow(wind.inflow, wind.wind_seed >= 0)
        if inflow is None or self._identity is None:
            return None
        wind_key = self._wind_key, wind.wind_speed, wind.wind_seed, wind.time_offset, inflow
        limits = self.env.limits.overspeed, self.env.limits.standstill, self.lead > 0
        drawn = [(name, one.key) for name, one in beginning.drawn.items()]
        others = beginning.yaw, beginning.faults, drawn
        return fingerprint(self._identity, limits, wind_key, _start(beginning.start), others)[:40]

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


def _description(env: WindTurbineEnv) -> tuple[str, str] | None:
    """Digests of controller and reward terms, as they were made.

    None where something is from outside of this package: it may do another thing tomorrow, or draw numbers.
    """
    controller, terms = env.operation.controller, env.reward_terms
    parts: list[object] = [*terms] if controller is None else [*parts_of(controller), *terms]
    own = all(type(part).__module__.startswith(_OWN_MODULES) and not hasattr(part, "function") for part in parts)
    known = own and env.operation.make_simulator is make_simulator
    return (_digest(controller), _digest(terms)) if known else None


def _digest(value: object) -> str:
    """Digest of an object that was just made, by what it is made of."""
    return hashlib.sha256(pickle.dumps(value)).hexdigest()


def _inflow(inflow: Inflow, made_here: bool) -> tuple[object, ...] | None:
    """Properties of an inflow beside speed, seed and time of turbulence; None where they do not tell it from others."""
    if isinstance(inflow, TurningInflow | MirroredInflow):
        inner = _inflow(inflow.inner, made_here)
        turning = (inflow.times, inflow.directions) if isinstance(inflow, TurningInflow) else ()
        return None if inner is None else (type(inflow).__name__, *turning, *inner)
    if isinstance(inflow, TurbulentInflow) and made_here:
        return inflow.steady, inflow.beyond_grid, *_box(inflow.box)
    if type(inflow) is PathInflow and (made_here or inflow.box is None):
        path = type(inflow).__name__, inflow.times, inflow.speeds, inflow.scales, inflow.offset, inflow.profile
        return (*path, None) if inflow.box is None else (*path, *_box(inflow.box))
    return (inflow,) if type(inflow) in (SteadyInflow, TransientInflow) else None


def _box(box: TurbulenceBox) -> tuple[object, ...]:
    """Properties that tell turbulence made here from others beside its seed."""
    return box.mean_speed, box.time_step, box.scale, box.description


def _start(start: Start) -> tuple[object, ...]:
    """Properties that tell a start from others; the signals before it are for observations alone."""
    state = [getattr(start, f.name) for f in fields(start) if f.name not in ("deviations", "trail")]
    return (*state, *sorted(start.deviations.items(), key=lambda item: item[0]))
