"""The ceiling of a task of the benchmark: the score where the wind is known.

    python scripts/studies/ceiling.py --task load-reduction --winds 3

Writes wt_gym/experiment/benchmark_data/ceilings/NAME.json. `make_ceiling` identifies the plant in training winds
and learns offsets in the winds of the task (`ceiling_oracle`). Every run is stored.
"""

import datetime
import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from ceiling_oracle import OracleOptions, Played, best_of, learn_offsets
from numpy.typing import NDArray
from study_pages import markdown

from wt_gym.analysis.results import Wind
from wt_gym.analysis.statistics import relative_change
from wt_gym.base.errors import BenchmarkError
from wt_gym.base.files import write_text_whole
from wt_gym.base.options import Options, option, option_record
from wt_gym.commands.benchmark import KEPT, chosen
from wt_gym.commands.options import WORKERS, add_shared, executor_of
from wt_gym.commands.program import OneLineParser, stoppable, user_errors
from wt_gym.control import Demand
from wt_gym.control.controllers import Combined, Readings, lidar_of
from wt_gym.control.controllers.linear_optimal import OUTPUTS, PitchOffsets
from wt_gym.envs.layout import layout_of
from wt_gym.envs.turbine_env import turbine_env_of
from wt_gym.experiment.agents import ConstantAgent
from wt_gym.experiment.benchmark import (
    BenchmarkAgent,
    BenchmarkRun,
    ResultFolder,
    entry_of,
    play_task,
    run_jobs,
    task_fingerprint,
)
from wt_gym.experiment.benchmark_tasks import BenchmarkTask, BenchmarkWind, Ceiling, ceiling_file
from wt_gym.experiment.execute import Executor, SerialExecutor
from wt_gym.experiment.names import BASELINE, RESIDUAL_INTERFACE
from wt_gym.experiment.store import described
from wt_gym.learning.linear_design import Plant, identified_plant
from wt_gym.learning.options import LinearDesignTask
from wt_gym.learning.recording import LOADS, DrawnOffsets, Recording, RecordingStore, record
from wt_gym.turbines import Turbine, load_turbine

_SHOWN = {
    "captured_power": "power", "blade_flap_del": "flap DEL", "tower_fore_aft_del": "tower f-a DEL",
    "tower_side_side_del": "tower s-s DEL",
}  # fmt: skip
"""Changes that a table shows."""
_CHANGES = (*_SHOWN, "blade_edge_del", "pitch_travel")
"""Metrics whose change is written down."""
_EXCITATION_SEED = 100
"""First seed of the drawn offsets; that of the wind is added."""
_CHANNELS = (
    "time", "azimuth", "nacelle_acceleration_fore_aft", "nacelle_acceleration_side_side", "rotor_speed",
    "tower_base_fore_aft_moment", "tower_base_side_side_moment", "generator_power",
)  # fmt: skip
_OF_BLADES = ("root_flap_moment", "root_edge_moment", "pitch")


@option_record
class CeilingOptions(Options):
    """Settings of a ceiling."""

    title = "ceiling"

    winds: int = option("winds of each speed of the task, the first ones", default=3, low=1)
    duration: float | None = option("length of a run in them", default=None, unit="s", otherwise="the task's")
    base: str = option("base controller of the offsets", default="side_side_damper")
    seeds: tuple[int, ...] = option(
        "training winds in which the plant is identified, without and with drawn offsets", default=(1, 2, 3)
    )
    recorded: float = option("length of these runs", default=300.0, unit="s")
    oracle: OracleOptions = option("how offsets are learned", default=OracleOptions(), kinds=(OracleOptions,))


class OffsetsPlayer:
    """Agent that plays offsets of the pitch on the base controller of its environment, whose place it takes.

    The offsets begin with the first step after the reset, whatever the controller did before.

    Parameters
    ----------
    env : gymnasium.Env
        In residual mode.
    levels : numpy.ndarray, shape (3, n)
        Of mean, tilt and yaw, one a step of the simulator [rad].
    limit, rate_limit : float
        [rad], [rad/s].
    """

    def __init__(self, env: gym.Env, levels: NDArray[np.float64], limit: float, rate_limit: float) -> None:
        self._env, self._still = turbine_env_of(env), ConstantAgent(layout_of(env))
        self._turbine = self._env.turbine
        self._played = DrawnOffsets(PitchOffsets(self._turbine, limit, rate_limit, False), levels)
        self._names = (*_CHANNELS, *(f"{name}_{b + 1}" for name in _OF_BLADES for b in range(self._turbine.n_blades)))
        self._combined: Combined | None = None
        self._rows: list[list[float]] = []
        self._dt = 0.0

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> Any:
        """Act by nothing; the offsets act through the base controller."""
        if self._combined is None:
            operation = self._env.operation
            self._played.start(operation.signals)
            self._combined = Combined(operation.controller, self._played)
            self.channels, self.lidar = self._combined.channels, lidar_of(self._combined)
            operation.controller = self
        return self._still.predict(observation, state, episode_start, deterministic)

    def start(self, signals: Readings, demand: Demand) -> None:
        """Begin, as a controller."""
        self._combined.start(signals, demand)
        self._rows = []

    def step(self, signals: Readings, dt: float) -> Demand:
        """Demand of the base controller with the offsets."""
        self._dt = dt
        self._rows.append([signals[name] for name in self._names])
        return self._combined.step(signals, dt)

    def recording(self) -> Recording:
        """The run up to the instant of the last offset."""
        channels = dict(zip(self._names, np.array(self._rows).T, strict=True))
        offsets, share = np.array(self._played.acting).T[:, :-1], np.array(self._played.share)[:-1]
        return Recording.of_channels(channels, self._turbine, self._dt, offsets, share)


@dataclass(frozen=True)
class _Runs:
    """Runs in the winds of a task, each kept when it is done: a result of the benchmark, and its recording."""

    task: BenchmarkTask
    options: CeilingOptions
    folder: Path

    def controller(self, name: str, wind: BenchmarkWind) -> dict[str, Any]:
        """Result of a controller, as the benchmark itself makes and keeps it."""
        job = BenchmarkRun(self.task, wind, entry_of(name))
        folder = ResultFolder(self.folder)
        run_jobs([job], folder, progress=False)
        return folder.read(job.definition)

    def offsets(self, wind: BenchmarkWind, levels: NDArray[np.float64]) -> tuple[dict[str, Any], Recording | None]:
        """Result and recording of offsets; none of a run that ended before its time."""
        oracle = self.options.oracle
        interface = {**RESIDUAL_INTERFACE, "controller": [self.options.base, {}]}
        agent = {
            "kind": "offsets", "offsets": described(np.asarray(levels)), "limit": oracle.limit,
            "rate_limit": oracle.rate_limit,
        }  # fmt: skip
        definition = BenchmarkRun(self.task, wind, BenchmarkAgent("offsets", "", agent, interface)).definition
        results, recordings = ResultFolder(self.folder), RecordingStore(self.folder / "recordings", Recording)
        if (found := results.find(definition)) is not None:
            kept = recordings.find(definition)
            if kept is not None or found["ending"] != "time":
                return found, kept
        players: list[OffsetsPlayer] = []

        def make(env: gym.Env) -> OffsetsPlayer:
            players.append(OffsetsPlayer(env, levels, oracle.limit, oracle.rate_limit))
            return players[-1]

        result = {"definition": definition, "agent": "offsets", **play_task(self.task, wind, make, interface)}
        recording = players[-1].recording() if result["ending"] == "time" else None
        if recording is not None:
            recordings.keep(definition, recording)
        results.keep(definition, result)
        return result, recording


def _in_wind(runs: _Runs, plants: dict[float, Plant], turbine: Turbine, wind: BenchmarkWind) -> dict[str, Any]:
    """Learn offsets in one wind."""
    task, metrics = runs.task, []
    baseline = runs.controller(BASELINE, wind)
    if baseline["ending"] != "time":
        raise BenchmarkError(f"the baseline controller must complete {wind.label}, it ended with {baseline['ending']}")
    base = baseline["metrics"]

    def play_levels(levels: NDArray[np.float64]) -> Played:
        result, recording = runs.offsets(wind, levels)
        metrics.append(result["metrics"])
        if result["ending"] != "time":
            return Played(None, None, (result["ending"],))
        return Played(recording, task.improvement(metrics[-1], base), task.broken_limits(metrics[-1], base))

    passes = learn_offsets(play_levels, play_levels(np.zeros((3, 0))), plants[wind.speed], turbine, runs.options.oracle)
    best = best_of(passes)
    found = metrics[next(k for k, played in enumerate(passes) if played is best)]
    reference = runs.controller(task.yardstick, wind) if task.yardstick else {"ending": None}
    return {
        "improvement": best.value,
        "passes": [None if played.broken else played.value for played in passes],
        "broken": [list(played.broken) for played in passes],
        "yardstick": task.improvement(reference["metrics"], base) if reference["ending"] == "time" else None,
        "changes": {name: relative_change(found[name], base[name]) for name in _CHANGES},
        "offsets_rms_deg": None if best.run is None else np.degrees(best.run.offsets.std(1)).round(3).tolist(),
    }


def _record(turbine: Turbine, task: LinearDesignTask, run: tuple[float, int, bool]) -> Recording:
    """Run of a training wind."""
    speed, seed, excited = run
    offsets = PitchOffsets(turbine, task.limit, task.rate_limit, False)
    drawn = (task.excitation, _EXCITATION_SEED + seed) if excited else None
    return record(turbine, task.base, Wind(speed, seed), task.duration, offsets, drawn, task.fidelity)


def make_ceiling(
    task: BenchmarkTask,
    folder: Path,
    options: CeilingOptions | None = None,
    executor: Executor | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Ceiling:
    """Make the ceiling of a task.

    Parameters
    ----------
    task : BenchmarkTask
        With turbulent winds.
    folder : path
        Of the runs; what is there is not made again.
    executor : Executor, optional
        Of `wt_gym.experiment.execute`, entered: does the runs, one wind after another by default.
    progress : callable
        Called with a line after every recording and wind.

    Raises
    ------
    wt_gym.base.errors.BenchmarkError
        If the task has winds without turbulence, or the baseline does not complete one.
    wt_gym.base.errors.SimulationError
        If a run of a training wind fails.
    """
    options = options or CeilingOptions()
    executor = SerialExecutor() if executor is None else executor
    if any(wind.transient is not None for wind in task.winds):
        raise BenchmarkError(f"task {task.name}: a ceiling is made of turbulent winds, this one has transients")
    played = task if options.duration is None else replace(task, duration=options.duration)
    environment = {**gym.spec(task.env_id).kwargs, **task.env_kwargs}
    turbine, speeds = load_turbine(environment["turbine"]), tuple(sorted({wind.speed for wind in task.winds}))
    design_task = LinearDesignTask(
        speeds=speeds, seeds=options.seeds, excited=len(options.seeds), duration=options.recorded, base=options.base,
        limit=options.oracle.limit, rate_limit=options.oracle.rate_limit, fade=0.0, fidelity=environment["fidelity"],
    )  # fmt: skip
    runs = _Runs(played, options, folder)
    fingerprint = task_fingerprint(task)

    recordings = RecordingStore(folder / "recordings", Recording)
    definitions = {
        run: {"fingerprint": fingerprint, "ceiling": described(asdict(design_task)), "run": list(run)}
        for run in design_task.runs
    }
    found = {run: kept for run, known in definitions.items() if (kept := recordings.find(known)) is not None}
    left = [run for run in design_task.runs if run not in found]
    for run, made in executor.results(partial(_record, turbine, design_task), left):
        found[run] = made
        recordings.keep(definitions[run], made)
        progress(f"recording {len(found)} of {len(definitions)}: {run[0]:g} m/s, seed {run[1]}"
                 f"{', with drawn offsets' if run[2] else ''}")  # fmt: skip
    plants, explained = {}, {}
    for speed in speeds:
        still, excited = ([found[speed, seed, drawn] for seed in options.seeds] for drawn in (False, True))
        plants[speed], shares = identified_plant(design_task, turbine, still, excited)
        explained[f"{speed:g} m/s"] = dict(zip((*OUTPUTS, *LOADS), np.round(shares, 4).tolist(), strict=True))

    winds = [wind for speed in speeds for wind in [w for w in task.winds if w.speed == speed][: options.winds]]
    rows: dict[str, dict[str, Any]] = {}
    for wind, row in executor.results(partial(_in_wind, runs, plants, turbine), winds):
        rows[wind.label] = row
        learned = ", ".join("broken" if value is None else f"{100 * value:+.2f}" for value in row["passes"])
        progress(f"{wind.label}: improvement by passes in %: {learned}; {task.yardstick} "
                 + ("–" if row["yardstick"] is None else f"{100 * row['yardstick']:+.2f}"))  # fmt: skip
    weights = [wind.weight for wind in winds]
    known = [rows[wind.label]["yardstick"] for wind in winds]
    return Ceiling(
        task=task.name,
        version=task.version,
        definition=task.digest,
        fingerprint=fingerprint,
        made={"date": datetime.date.today().isoformat(), **runs.controller(BASELINE, winds[0])["made_with"]},
        how={"duration": played.duration, "skip": played.skip, **described(asdict(options))},
        explained=explained,
        improvement=float(np.average([rows[wind.label]["improvement"] for wind in winds], weights=weights)),
        yardstick=task.yardstick,
        yardstick_improvement=None if None in known else float(np.average(known, weights=weights)),
        winds={wind.label: rows[wind.label] for wind in winds},
    )


def write_ceiling(ceiling: Ceiling, path: Path) -> Path:
    """Write a ceiling.

    Raises
    ------
    ValueError
        If it holds a number that is not finite.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text_whole(path, json.dumps(asdict(ceiling), indent=1, allow_nan=False, ensure_ascii=False) + "\n")
    return path


def ceiling_table(ceilings: Mapping[str, Ceiling]) -> str:
    """Table of ceilings by the id of the task, ended by a line break; changes are means over the winds."""
    if not ceilings:
        return "No ceiling is recorded.\n"
    rows = []
    for name, ceiling in ceilings.items():
        winds, known = list(ceiling.winds.values()), ceiling.yardstick_improvement
        mean = {key: float(np.mean([row["changes"][key] for row in winds])) for key in (*_SHOWN, "pitch_travel")}
        rows.append([
            name,
            f"{100 * ceiling.improvement:+.1f} %",
            "–" if known is None else f"{100 * known:+.1f} %",
            "–" if ceiling.score is None else f"{ceiling.score:.0f}",
            *(f"{100 * mean[metric]:+.1f} %" for metric in _SHOWN),
            f"× {1.0 + mean['pitch_travel']:.1f}",
            f"{len(winds)} × {ceiling.how['duration']:g} s, {ceiling.made['date']}",
        ])  # fmt: skip
    head = ["task", "ceiling", "reference controller", "score of the ceiling", *_SHOWN.values()]
    return markdown([*head, "pitch travel", "measured in"], rows) + "\n"


def main() -> None:
    """Make ceilings."""
    parser = OneLineParser(description=__doc__)
    parser.add_argument("--task", nargs="*", default=["load-reduction"], metavar="NAME", help="(default: %(default)s)")
    parser.add_argument("--winds", type=int, default=3, metavar="N", help="of each speed (default: %(default)s)")
    parser.add_argument("--duration", type=float, metavar="S", help="of a run (default: the task's)")
    parser.add_argument("--passes", type=int, default=3, metavar="N", help="runs with offsets (default: %(default)s)")
    parser.add_argument("--out", type=Path, default=Path(KEPT), metavar="DIR", help="runs (default: %(default)s)")
    add_shared(parser, *WORKERS)
    arguments = parser.parse_args()
    oracle = OracleOptions(passes=arguments.passes)
    options = CeilingOptions(winds=arguments.winds, duration=arguments.duration, oracle=oracle)
    stopped = stoppable("the same command resumes with the runs that are stored")
    with user_errors(), stopped, executor_of(arguments) as executor:
        for task in chosen(arguments.task):
            ceiling = make_ceiling(task, arguments.out, options, executor, partial(print, file=sys.stderr))
            path = write_ceiling(ceiling, ceiling_file(task))
            print(f"{task.id}: with the wind known an improvement of {100 * ceiling.improvement:.2f} % ({path})")


if __name__ == "__main__":
    main()
