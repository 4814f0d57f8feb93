"""From a turbine and a base controller to a design of linear optimal pitch: recordings, plants, feedbacks, one file."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

import wt_gym
from wt_gym.analysis.statistics import relative_change
from wt_gym.benchmark.run import benchmark_fingerprint
from wt_gym.control.controllers import make_controller
from wt_gym.control.controllers.linear_optimal import OUTPUTS, LinearDesign, PitchOffsets, default_limits, offset_fade
from wt_gym.envs.wind_sampler import TRAINING_WIND_SEEDS
from wt_gym.learning.linear_design.feedback import (
    FeedbackOptions,
    Plant,
    fit_feedback,
    forecast,
    forecast_change,
)
from wt_gym.learning.linear_design.identification import explained_share, identify, respond
from wt_gym.learning.linear_design.recording import LOADS, Excitation, Recording, record
from wt_gym.runs.executors import SerialExecutor

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from wt_gym.learning.linear_design.recording import RecordingStore
    from wt_gym.runs.executors import Executor
    from wt_gym.turbines import Turbine

__all__ = ["LinearDesignTask", "change_of_power", "default_speeds", "design", "identified_plant"]

_LEAST_EXPLAINED = 0.3
"""Share of the changes of power in an unseen run that a linear model must explain to be used [-]."""
_DOUBLINGS = 5
"""Most doublings of the cost of power for its limit."""
_EXCITATION_SEED = 100
"""First seed of the drawn offsets; that of the wind is added."""


@dataclass(frozen=True)
class LinearDesignTask:
    """What a design is made from.

    Attributes
    ----------
    speeds : tuple of float
        Mean winds at which plant and feedback are made [m/s].
    seeds : tuple of int
        Of the turbulence in which disturbances are recorded, of `TRAINING_WIND_SEEDS`.
    excited : int
        Number of these winds, the first ones, that are run with drawn offsets too; at least 2.
    duration : float
        Of every run [s].
    base : str
        Base controller, as `make_controller` takes it.
    limit, rate_limit : float
        Of the offsets [rad], [rad/s].
    fade : float
        Collective pitch above fine pitch from which on offsets act in full [rad].
    fine_speed : (float, float) or None
        Rotor speed over the rated one at which offsets begin and act in full at fine pitch [-]; None: they do not act
        there.
    memory : float
        Length of the impulse responses [s].
    ridge, decay : float
        Of the identification, see `identify`.
    fidelity : str or None
        None: what suits the turbine.
    excitation : Excitation
    feedback : FeedbackOptions
    least_power : float
        Change of power [-] that the forecast of a feedback must keep at every wind speed: where it does not, the cost
        of power is doubled until it does.

    Raises
    ------
    ValueError
        For winds, times and limits without meaning, or seeds that are not for training.
    """

    speeds: tuple[float, ...]
    seeds: tuple[int, ...] = (1, 2, 3, 4, 5, 6)
    excited: int = 3
    duration: float = 300.0
    base: str = "side_side_damper"
    limit: float = math.radians(4.0)
    rate_limit: float = math.radians(3.0)
    fade: float = math.radians(3.0)
    fine_speed: tuple[float, float] | None = (0.97, 1.02)
    memory: float = 25.0
    ridge: float = 1e-3
    decay: float = 4.0
    fidelity: str | None = None
    excitation: Excitation = field(default_factory=Excitation)
    feedback: FeedbackOptions = field(default_factory=FeedbackOptions)
    least_power: float = -0.003

    def __post_init__(self) -> None:
        if not self.speeds or any(b <= a for a, b in zip(self.speeds, self.speeds[1:], strict=False)):
            raise ValueError(f"speeds must be one or more rising wind speeds, got {self.speeds}")
        if foreign := [seed for seed in self.seeds if seed not in TRAINING_WIND_SEEDS]:
            raise ValueError(
                f"seeds of a design must be of the training winds, {TRAINING_WIND_SEEDS[0]} to "
                f"{TRAINING_WIND_SEEDS[-1]}; got {', '.join(map(str, foreign))}"
            )
        if len(set(self.seeds)) < len(self.seeds) or not 2 <= self.excited <= len(self.seeds):
            raise ValueError(
                f"there must be at least 2 different seeds with 2 or more excited; got seeds {self.seeds} and "
                f"{self.excited} excited"
            )
        if not -1.0 <= self.least_power <= 0.0:
            raise ValueError(f"least_power must be from -1 to 0, got {self.least_power!r}")
        if not (self.memory > 0.0 and self.feedback.skip + 2.0 * self.memory <= self.duration < math.inf):
            raise ValueError(
                f"a run must last at least {self.feedback.skip + 2.0 * self.memory:g} s (start and twice the memory of "
                f"the plant), got {self.duration!r} s"
            )

    @property
    def runs(self) -> list[tuple[float, int, bool]]:
        """Wind speed, seed, and whether offsets are drawn, of every run."""
        return [
            (speed, seed, excited)
            for speed in self.speeds
            for k, seed in enumerate(self.seeds)
            for excited in ((False, True) if k < self.excited else (False,))
        ]


def default_speeds(turbine: Turbine) -> tuple[float, ...]:
    """Winds of a design: about rated and above, rounded to half a meter a second."""
    found = dict.fromkeys(round(2.0 * ratio * turbine.rated_wind_speed) / 2.0 for ratio in _SPEED_RATIOS)
    return tuple(speed for speed in found if speed <= turbine.cut_out)


_SPEED_RATIOS = (1.05, 1.32, 1.58)
"""Winds of the designs over the rated one [-]."""


def definition(task: LinearDesignTask, turbine: Turbine, run: tuple[float, int, bool]) -> dict[str, Any]:
    """What decides on a recording, as JSON values."""
    speed, seed, excited = run
    return {
        "fingerprint": benchmark_fingerprint(turbine, task.fidelity),
        "base": task.base,
        "wind": {"speed": speed, "seed": seed},
        "duration": task.duration,
        "fade": asdict(offset_fade(task.fade, task.fine_speed)),
        "excitation": asdict(task.excitation) | {"limit": task.limit, "rate_limit": task.rate_limit}
        if excited
        else None,
    }


def _make(task: LinearDesignTask, turbine: Turbine, run: tuple[float, int, bool]) -> Recording:
    """Do one run."""
    speed, seed, excited = run
    offsets = PitchOffsets(turbine, task.limit, task.rate_limit, offset_fade(task.fade, task.fine_speed))
    drawn = (task.excitation, _EXCITATION_SEED + seed) if excited else None
    return record(turbine, task.base, speed, seed, task.duration, offsets, drawn, task.fidelity)


def change_of_power(
    changes: Sequence[NDArray[np.float64]], modeled: Sequence[NDArray[np.float64]],
    offsets: Sequence[NDArray[np.float64]], power: float,
) -> float:  # fmt: skip
    """Share of power that offsets take by the mean of their square [1/rad^2]: what a linear model does not explain.

    Parameters
    ----------
    changes, modeled : sequence of numpy.ndarray, shape (n + 1,)
        Change of power in each excited run, and what the linear model says [W].
    offsets : sequence of numpy.ndarray, shape (3, n)
        [rad].
    power : float
        Mean without offsets [W].

    Returns
    -------
    float
        Zero where offsets do not take any.
    """
    lost = sum(float((model - change).mean()) for change, model in zip(changes, modeled, strict=True))
    squares = sum(float((given**2).sum(0).mean()) for given in offsets)
    return max(lost / power / squares, 0.0)


def identified_plant(
    task: LinearDesignTask, turbine: Turbine, still: Sequence[Recording], excited: Sequence[Recording]
) -> tuple[Plant, NDArray[np.float64]]:
    """Plant of runs of the same winds without and with drawn offsets.

    Returns
    -------
    plant : Plant
        Fitted to all runs.
    explained : numpy.ndarray, shape (9,)
        Share of the mean square of the changes in the last run that a fit to the others explains: `OUTPUTS`, `LOADS`.
        Where it explains less than `_LEAST_EXPLAINED` of power, offsets have no linear effect on it in the plant, and
        all that they take counts by their square, since power is not linear near rated wind.
    """
    dt = still[0].dt
    taps = round(task.memory / dt)
    inputs = [run.offsets for run in excited]
    changes = [
        np.concatenate([run.outputs - twin.outputs, run.loads - twin.loads])
        for run, twin in zip(excited, still, strict=False)
    ]
    trial = identify(inputs[:-1], changes[:-1], taps, task.ridge, task.decay)
    explained = explained_share(trial, inputs[-1:], changes[-1:])
    responses = identify(inputs, changes, taps, task.ridge, task.decay)
    skip = round(task.feedback.skip / dt)
    power = len(OUTPUTS) + LOADS.index("power")
    if explained[power] < _LEAST_EXPLAINED:
        responses[power] = 0.0
    curvature = change_of_power(
        [change[power] for change in changes],
        [respond(responses, given)[power] for given in inputs],
        inputs,
        float(np.mean([run.loads[LOADS.index("power")].mean() for run in still])),
    )
    scale = np.mean([run.outputs[:, skip:].std(1) for run in still], axis=0)
    return Plant(responses, scale, curvature, Plant.lead_of(turbine, dt), dt), explained


def design(
    turbine: Turbine,
    task: LinearDesignTask | None = None,
    store: RecordingStore[Recording] | None = None,
    executor: Executor | None = None,
    progress: Callable[[str], None] | None = None,
) -> LinearDesign:
    """Make a design.

    Parameters
    ----------
    turbine : Turbine
    task : LinearDesignTask, optional
        By default at `default_speeds`, within `default_limits`.
    store : RecordingStore, optional
        Keeps recordings; what is there is not made again.
    executor : Executor, optional
        Of `wt_gym.runs.executors`, entered: does the runs.
    progress : callable, optional
        Called with a line after every run and every feedback.

    Raises
    ------
    ValueError
        If a wind speed lies where no offset acts, or pitch does not rise with the wind speed.
    wt_gym.base.errors.SimulationError
        If a run fails.
    """
    if task is None:
        limit, rate_limit = default_limits(turbine)
        task = LinearDesignTask(default_speeds(turbine), limit=limit, rate_limit=rate_limit)
    executor = SerialExecutor() if executor is None else executor
    make_controller(task.base, turbine)  # refuses a name before anything runs
    say = progress or (lambda _: None)
    found: dict[tuple[float, int, bool], Recording] = {}
    if store is not None:
        for run in task.runs:
            if (kept := store.find(definition(task, turbine, run))) is not None:
                found[run] = kept
    left = [run for run in task.runs if run not in found]
    for run, made in executor.results(partial(_make, task, turbine), left):
        key = (run[0], run[1], run[2])
        found[key] = made
        if store is not None:
            store.keep(definition(task, turbine, key), made)
        how = "with drawn offsets" if run[2] else "without offsets"
        say(f"run {len(found)} of {len(task.runs)}: {run[0]:g} m/s, seed {run[1]}, {how}")
    parts = [_at_speed(task, turbine, speed, found, say) for speed in task.speeds]
    pitch = np.array([part["pitch"] for part in parts])
    if (np.diff(pitch) <= 0.0).any():
        shown = ", ".join(f"{s:g} m/s: {math.degrees(p):.2f}°" for s, p in zip(task.speeds, pitch, strict=True))
        raise ValueError(f"the mean pitch must rise with the wind speed, got {shown}; leave out speeds below rated")
    scale = np.mean([part["scale"] for part in parts], axis=0)
    return LinearDesign(
        pitch=pitch,
        responses=np.stack([part["responses"] / scale[:, None, None] for part in parts]),
        gains=np.stack([part["gains"] * (scale / part["scale"])[:, None] for part in parts]),
        scale=scale,
        washout=np.array([0.0 if k in (1, 2) else task.feedback.washout for k in range(len(OUTPUTS))]),
        interval=found[task.runs[0]].dt,
        limit=task.limit,
        rate_limit=task.rate_limit,
        fade=task.fade,
        fine_speed=task.fine_speed,
        record={
            "turbine": turbine.name,
            "version": wt_gym.__version__,
            "fingerprint": benchmark_fingerprint(turbine, task.fidelity),
            "task": asdict(task),
            "speeds": [part["record"] for part in parts],
        },
    )


def _mean_change(now: Sequence[dict[str, float]], before: Sequence[dict[str, float]], key: str) -> float:
    return float(np.mean([relative_change(a[key], b[key]) for a, b in zip(now, before, strict=True)]))


def _at_speed(
    task: LinearDesignTask,
    turbine: Turbine,
    speed: float,
    found: dict[tuple[float, int, bool], Recording],
    say: Callable[[str], None],
) -> dict[str, Any]:
    """Plant and feedback at one wind speed."""
    still = [found[speed, seed, False] for seed in task.seeds]
    excited = [found[speed, seed, True] for seed in task.seeds[: task.excited]]
    if max(float(run.share.mean()) for run in still) < 0.01:
        raise ValueError(
            f"at {speed:g} m/s no offset acts, because the blades stay at fine pitch; speeds must be near rated "
            f"({turbine.rated_wind_speed:g} m/s) or above"
        )
    plant, explained = identified_plant(task, turbine, still, excited)
    skip, full, options = task.feedback.skip, turbine.pitch.max_rate, task.feedback
    before = [forecast(r, plant, np.zeros((3, r.steps))).metrics(r.dt, full, skip) for r in still]
    for doubled in range(_DOUBLINGS + 1):
        options = replace(task.feedback, power_weight=task.feedback.power_weight * 2.0**doubled)
        gains, offsets = fit_feedback(still, plant, turbine, options)
        now = [forecast(r, plant, u).metrics(r.dt, full, skip) for r, u in zip(still, offsets, strict=True)]
        changes = {key: _mean_change(now, before, key) for key in now[0]}
        if changes["captured_power"] >= task.least_power or options.power_weight == 0.0:
            break
    else:
        raise ValueError(
            f"at {speed:g} m/s offsets must keep power above {100.0 * task.least_power:+.2f} % in the forecast, got "
            f"{100.0 * changes['captured_power']:+.2f} % with {2**_DOUBLINGS} times the cost of power; lower "
            "least_power, or let offsets act less at fine pitch (fade, fine_speed)"
        )
    cost = float(np.mean([forecast_change(a, b, task.feedback.weights) for a, b in zip(now, before, strict=True)]))
    shares = dict(zip((*OUTPUTS, *LOADS), np.round(explained, 4).tolist(), strict=True))
    say(
        f"{speed:g} m/s: explained {', '.join(f'{name} {share:.2f}' for name, share in shares.items())}; forecast "
        f"cost {100 * cost:+.1f} %, " + ", ".join(f"{name} {100 * value:+.1f} %" for name, value in changes.items())
    )
    start = round(skip / still[0].dt)
    return {
        "pitch": float(np.mean([run.pitch[:, start:].mean() for run in still])),
        "scale": plant.scale,
        "responses": plant.responses[: len(OUTPUTS)],
        "gains": gains,
        "record": {
            "speed": speed,
            "explained": shares,
            "power_curvature": plant.power_curvature,
            "power_weight": options.power_weight,
            "forecast": {"cost": cost} | changes,
        },
    }
