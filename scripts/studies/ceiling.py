"""The ceiling of a task of the benchmark: the score where the wind is known, and the value of information.

    python scripts/studies/ceiling.py --task load-reduction --winds 3
    python scripts/studies/ceiling.py --page docs/benchmark.md      # with the tables of all ceilings

Writes wt_gym/experiment/benchmark_data/ceilings/NAME.json. `make_ceiling` identifies the plant in training winds,
learns offsets in the winds of the task (`ceiling_oracle`) and forecasts what linear laws with more and more information
reach (`ceiling_ladder`). Every run is stored.
"""

from __future__ import annotations

import argparse
import datetime
import json
import sys
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import gymnasium as gym
import numpy as np
from ceiling_ladder import Rung, Seen, climb, known_wind, rungs_of, see
from ceiling_oracle import OracleOptions, Played, best_of, learn_offsets

from wt_gym.analysis.results import Wind
from wt_gym.analysis.statistics import relative_change
from wt_gym.base.errors import BenchmarkError
from wt_gym.base.files import write_text_whole
from wt_gym.commands.benchmark import KEPT, chosen
from wt_gym.commands.options import WORKERS, add_shared, executor_of
from wt_gym.commands.program import OneLineParser, file_ending_in, stoppable, user_errors
from wt_gym.control.controllers import Combined, lidar_of
from wt_gym.control.controllers.linear_optimal import OUTPUTS, PitchOffsets
from wt_gym.envs.layout import layout_of
from wt_gym.envs.turbine_env import turbine_env_of
from wt_gym.experiment.agents import ConstantAgent
from wt_gym.experiment.benchmark import (
    BenchmarkAgent,
    BenchmarkRun,
    ResultFolder,
    entry_of,
    into_page,
    make_env,
    play_task,
    task_fingerprint,
)
from wt_gym.experiment.benchmark_tasks import Ceiling, ceiling_file, ceiling_of
from wt_gym.experiment.comparison import inflow_of
from wt_gym.experiment.execute import SerialExecutor
from wt_gym.experiment.names import BASELINE, RESIDUAL_INTERFACE
from wt_gym.experiment.store import RunStore, described
from wt_gym.learning.linear_design import identified_plant
from wt_gym.learning.options import LinearDesignTask
from wt_gym.learning.recording import LOADS, DrawnOffsets, Recording, RecordingStore, record
from wt_gym.turbines import load_turbine

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from wt_gym.control import Demand
    from wt_gym.control.controllers import Controller, Readings
    from wt_gym.experiment.benchmark_tasks import BenchmarkTask, BenchmarkWind
    from wt_gym.experiment.execute import Executor
    from wt_gym.learning.linear_design import Plant
    from wt_gym.turbines import Turbine
    from wt_gym.wind import Inflow

_SHOWN = {
    "captured_power": "power", "blade_flap_del": "flap DEL", "tower_fore_aft_del": "tower f-a DEL",
    "tower_side_side_del": "tower s-s DEL",
}  # fmt: skip
"""Changes that a table shows."""
_EXCITATION_SEED = 100
"""First seed of the drawn offsets; that of the wind is added."""
_CHANGES = (
    "captured_power", "blade_flap_del", "blade_edge_del", "tower_fore_aft_del", "tower_side_side_del", "pitch_travel",
)  # fmt: skip
"""Metrics whose change is written down."""


@dataclass(frozen=True)
class CeilingOptions:
    """How a ceiling is made.

    Attributes
    ----------
    winds : int
        Of each speed of the task, the first ones.
    duration : float or None
        Of a run in them [s]; None: the task's.
    base : str
        Base controller of the offsets.
    seeds : tuple of int
        Training winds in which the plant is identified and the ladder is fitted; all are run with drawn offsets too.
    recorded : float
        Length of these runs [s].
    oracle : OracleOptions
    ladder : bool
        Whether the ladder of information is made.
    """

    winds: int = 3
    duration: float | None = None
    base: str = "side_side_damper"
    seeds: tuple[int, ...] = (1, 2, 3)
    recorded: float = 300.0
    oracle: OracleOptions = field(default_factory=OracleOptions)
    ladder: bool = True

    def __post_init__(self) -> None:
        if self.winds < 1:
            raise ValueError(f"winds must be at least 1, got {self.winds!r}")

    def design_task(self, speeds: tuple[float, ...], fidelity: str) -> LinearDesignTask:
        """Recordings of training winds; it checks the numbers."""
        return LinearDesignTask(
            speeds=speeds, seeds=self.seeds, excited=len(self.seeds), duration=self.recorded, base=self.base,
            limit=self.oracle.limit, rate_limit=self.oracle.rate_limit, fade=False, fidelity=fidelity,
        )  # fmt: skip


class _Recorder:
    """Controller that plays offsets on another one and keeps what it reads."""

    def __init__(self, beneath: Controller, played: DrawnOffsets, n_blades: int) -> None:
        self._combined = Combined(beneath, played)
        self.channels = self._combined.channels
        blades = range(1, n_blades + 1)
        self.names = (
            "time", "azimuth", "nacelle_acceleration_fore_aft", "nacelle_acceleration_side_side", "rotor_speed",
            "tower_base_fore_aft_moment", "tower_base_side_side_moment", "generator_power",
            *(f"{name}_{b}" for name in ("root_flap_moment", "root_edge_moment", "pitch") for b in blades),
        )  # fmt: skip
        self.rows: list[list[float]] = []
        self.dt = 0.0

    @property
    def lidar(self) -> Any:
        return lidar_of(self._combined)

    def start(self, signals: Readings, demand: Demand) -> None:
        self._combined.start(signals, demand)
        self.rows = []

    def step(self, signals: Readings, dt: float) -> Demand:
        self.dt = dt
        self.rows.append([signals[name] for name in self.names])
        return self._combined.step(signals, dt)


class OffsetsPlayer:
    """Agent that leaves everything to the base controller of its environment, on which it plays offsets of the pitch.

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
        turbine = self._env.turbine
        self._played = DrawnOffsets(PitchOffsets(turbine, limit, rate_limit, False), levels)
        self._recorder: _Recorder | None = None

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> Any:
        """Act by nothing; the offsets act through the base controller."""
        if self._recorder is None:
            operation = self._env.operation
            beneath = cast("Controller", operation.controller)
            self._played.start(operation.signals)
            operation.controller = self._recorder = _Recorder(beneath, self._played, self._env.turbine.n_blades)
        return self._still.predict(observation, state, episode_start, deterministic)

    def recording(self) -> Recording:
        """What was played, up to the instant of the last offset."""
        recorder, turbine = cast("_Recorder", self._recorder), self._env.turbine
        channels = dict(zip(recorder.names, np.array(recorder.rows).T, strict=True))
        offsets, share = np.array(self._played.acting).T[:, :-1], np.array(self._played.share)[:-1]
        return Recording.of_channels(channels, turbine, recorder.dt, offsets, share)


@dataclass(frozen=True)
class _Runs:
    """Runs in the winds of a task, each kept when it is done.

    A run is a result of the benchmark, and the recording of it.
    """

    task: BenchmarkTask
    options: CeilingOptions
    folder: Path

    def controller(self, name: str, wind: BenchmarkWind) -> dict[str, Any]:
        """Result of a controller, as the benchmark itself makes and keeps it."""
        job = BenchmarkRun(self.task, wind, entry_of(name))
        definition, results = job.definition, ResultFolder(self.folder)
        if (kept := results.find(definition)) is not None:
            return cast("dict[str, Any]", kept)
        made = play_task(self.task, wind, job.entry.make, job.entry.interface)
        result = {"definition": definition, "agent": job.entry.name, **made}
        results.keep(definition, result)
        return result

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

        made = play_task(self.task, wind, make, interface)
        result = {"definition": definition, "agent": "offsets", **made}
        recording = players[-1].recording() if made["ending"] == "time" else None
        if recording is not None:
            recordings.keep(definition, recording)
        results.keep(definition, result)
        return result, recording


def _played(
    runs: _Runs, wind: BenchmarkWind, baseline: dict[str, float], levels: NDArray[np.float64]
) -> tuple[Played, dict[str, float]]:
    """A run with offsets, and its metrics."""
    result, recording = runs.offsets(wind, levels)
    if result["ending"] != "time":
        return Played(None, None, (result["ending"],)), {}
    metrics = result["metrics"]
    broken = runs.task.broken_limits(metrics, baseline)
    return Played(recording, runs.task.improvement(metrics, baseline), broken), metrics


def _in_wind(runs: _Runs, plants: dict[float, Plant], turbine: Turbine, wind: BenchmarkWind) -> dict[str, Any]:
    """Learn offsets in one wind."""
    metrics: list[dict[str, float]] = []
    baseline = runs.controller(BASELINE, wind)
    if baseline["ending"] != "time":
        raise BenchmarkError(f"the baseline controller must complete {wind.label}, it ended with {baseline['ending']}")
    yardstick = runs.controller(runs.task.yardstick, wind) if runs.task.yardstick else None

    def play_levels(levels: NDArray[np.float64]) -> Played:
        played, found = _played(runs, wind, baseline["metrics"], levels)
        metrics.append(found)
        return played

    base = play_levels(np.zeros((3, 0)))
    passes = learn_offsets(play_levels, base, plants[wind.speed], turbine, runs.options.oracle)
    best = best_of(passes)
    found = metrics[next(k for k, played in enumerate(passes) if played is best)]
    changes = {name: relative_change(found[name], baseline["metrics"][name]) for name in _CHANGES}
    gained = None
    if yardstick is not None and yardstick["ending"] == "time":
        gained = runs.task.improvement(yardstick["metrics"], baseline["metrics"])
    return {
        "improvement": best.value,
        "passes": [None if played.broken else played.value for played in passes],
        "broken": [list(played.broken) for played in passes],
        "yardstick": gained,
        "changes": changes,
        "offsets_rms_deg": None if best.run is None else np.degrees(best.run.offsets.std(1)).round(3).tolist(),
    }


def _record(turbine: Turbine, task: LinearDesignTask, run: tuple[float, int, bool]) -> Recording:
    """Run of a training wind."""
    speed, seed, excited = run
    offsets = PitchOffsets(turbine, task.limit, task.rate_limit, False)
    drawn = (task.excitation, _EXCITATION_SEED + seed) if excited else None
    return record(turbine, task.base, speed, seed, task.duration, offsets, drawn, task.fidelity)


def make_ceiling(
    task: BenchmarkTask,
    folder: Path,
    options: CeilingOptions | None = None,
    executor: Executor | None = None,
    progress: Callable[[str], None] | None = None,
) -> Ceiling:
    """Make the ceiling of a task.

    Parameters
    ----------
    task : BenchmarkTask
        With turbulent winds.
    folder : path
        Of the runs; what is there is not made again.
    options : CeilingOptions, optional
    executor : Executor, optional
        Of `wt_gym.experiment.execute`, entered: does the runs, one wind after another by default.
    progress : callable, optional
        Called with a line after every recording, wind and rung.

    Raises
    ------
    wt_gym.base.errors.BenchmarkError
        If the task has winds without turbulence, or the baseline does not complete one.
    wt_gym.base.errors.SimulationError
        If a run of a training wind fails.
    """
    options, say = options or CeilingOptions(), progress or (lambda _: None)
    executor = SerialExecutor() if executor is None else executor
    if any(wind.transient is not None for wind in task.winds):
        raise BenchmarkError(f"task {task.name}: a ceiling is made of turbulent winds, this one has transients")
    played = task if options.duration is None else replace(task, duration=options.duration)
    environment = {**gym.spec(task.env_id).kwargs, **task.env_kwargs}
    turbine, fidelity = load_turbine(environment["turbine"]), environment["fidelity"]
    speeds = tuple(sorted({wind.speed for wind in task.winds}))
    design_task = options.design_task(speeds, fidelity)
    runs = _Runs(played, options, folder)
    fingerprint = task_fingerprint(task)

    recordings = RecordingStore(folder / "recordings", Recording)
    found: dict[tuple[float, int, bool], Recording] = {}
    definitions = {
        run: {"fingerprint": fingerprint, "ceiling": described(asdict(design_task)), "run": list(run)}
        for run in design_task.runs
    }
    for run, definition in definitions.items():
        if (kept := recordings.find(definition)) is not None:
            found[run] = kept
    left = [run for run in design_task.runs if run not in found]
    for run, made in executor.results(partial(_record, turbine, design_task), left):
        found[run] = made
        recordings.keep(definitions[run], made)
        say(f"recording {len(found)} of {len(definitions)}: {run[0]:g} m/s, seed {run[1]}"
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
        say(f"{wind.label}: improvement by passes in %: {learned}; {task.yardstick} "
            + ("–" if row["yardstick"] is None else f"{100 * row['yardstick']:+.2f}"))  # fmt: skip
    ladder = _ladder(runs, design_task, found, plants, turbine, winds, fingerprint, say) if options.ladder else []
    weights = [wind.weight for wind in winds]
    gains = [rows[wind.label]["improvement"] for wind in winds]
    known = [rows[wind.label]["yardstick"] for wind in winds]
    yardstick = None if any(value is None for value in known) else float(np.average(known, weights=weights))
    return Ceiling(
        task=task.name,
        version=task.version,
        definition=task.digest,
        fingerprint=fingerprint,
        made={"date": datetime.date.today().isoformat(), **runs.controller(BASELINE, winds[0])["made_with"]},
        how={"duration": played.duration, "skip": played.skip, **described(asdict(options))},
        explained=explained,
        improvement=float(np.average(gains, weights=weights)),
        yardstick=task.yardstick,
        yardstick_improvement=yardstick,
        winds={wind.label: rows[wind.label] for wind in winds},
        ladder=ladder,
    )


def _inflow(task: BenchmarkTask, wind: BenchmarkWind) -> Inflow:
    """Inflow of a run of a task: its box is as long as the run asks for."""
    sampler = turbine_env_of(make_env(task, wind)).wind
    drawn = sampler.sample(np.random.default_rng(0), wind.speed, wind.seed, 0.0, task.duration)
    return drawn.inflow


def _ladder(
    runs: _Runs,
    task: LinearDesignTask,
    found: dict[tuple[float, int, bool], Recording],
    plants: dict[float, Plant],
    turbine: Turbine,
    winds: Sequence[BenchmarkWind],
    fingerprint: dict[str, Any],
    say: Callable[[str], None],
) -> list[dict[str, Any]]:
    """What linear laws with more and more information are forecast to reach in the winds of the task."""
    options, store = runs.options.oracle, RunStore(runs.folder / "ladder")
    seen: dict[float, tuple[list[Seen], list[Seen]]] = {}

    def both(speed: float) -> tuple[list[Seen], list[Seen]]:
        """Training winds, and those of the task, at a speed."""
        if speed not in seen:
            inflows = {seed: inflow_of(turbine, Wind(speed, seed)) for seed in task.seeds}
            fitted = [see(found[speed, seed, False], turbine, inflows[seed]) for seed in task.seeds]
            tested = []
            for wind in winds:
                if wind.speed == speed:
                    _, recording = runs.offsets(wind, np.zeros((3, 0)))
                    tested.append(see(cast("Recording", recording), turbine, _inflow(runs.task, wind)))
            seen[speed] = fitted, tested
        return seen[speed]

    def climbed(rung: Rung | None) -> dict[str, float]:
        """Mean over the speeds, each with the weight of its winds."""
        rows = []
        for speed, plant in plants.items():
            fitted, tested = both(speed)
            rows.append(
                known_wind(tested, plant, turbine, options) if rung is None
                else climb(rung, fitted, tested, plant, turbine, options)
            )  # fmt: skip
        weights = [sum(wind.weight for wind in winds if wind.speed == speed) for speed in plants]
        return {key: float(np.average([row[key] for row in rows], weights=weights)) for key in rows[0]}

    out = []
    for rung in (*rungs_of(next(iter(plants.values())).dt), None):
        name = "the whole wind" if rung is None else rung.name
        definition = {
            "rung": None if rung is None else asdict(rung), "winds": [wind.definition for wind in winds],
            "duration": runs.task.duration, "fingerprint": fingerprint,
            "options": described(asdict(runs.options)),
        }  # fmt: skip
        row = store.find(definition) or store.keep(definition, climbed(rung))
        row = {"name": name} | {key: value for key, value in row.items() if key != "definition"}
        out.append(row)
        say(f"{name}: forecast improvement over {task.base} {100 * row['improvement']:+.2f} %")
    return out


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
    head = ["task", "ceiling", "reference controller", "score of the ceiling", *_SHOWN.values()]
    head += ["pitch travel", "measured in"]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for name, ceiling in ceilings.items():
        rows = list(ceiling.winds.values())

        def mean(metric: str, rows: list[dict[str, Any]] = rows) -> float:
            return float(sum(row["changes"][metric] for row in rows)) / len(rows)

        known = ceiling.yardstick_improvement
        cells = [
            name,
            f"{100 * ceiling.improvement:+.1f} %",
            "–" if known is None else f"{100 * known:+.1f} %",
            "–" if ceiling.score is None else f"{ceiling.score:.0f}",
            *(f"{100 * mean(metric):+.1f} %" for metric in _SHOWN),
            f"× {1.0 + mean('pitch_travel'):.1f}",
            f"{len(rows)} × {ceiling.how['duration']:g} s, {ceiling.made['date']}",
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def ladder_table(ceilings: Mapping[str, Ceiling]) -> str:
    """Table of the ladders of those ceilings that have one, or a line where none has, ended by a line break."""
    ladders = {
        name: {row["name"]: row for row in ceiling.ladder} for name, ceiling in ceilings.items() if ceiling.ladder
    }
    if not ladders:
        return "No ladder is recorded.\n"
    names = list(dict.fromkeys(rung for ladder in ladders.values() for rung in ladder))
    head = ["what is known", *(f"`{name}`" for name in ladders)]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for rung in names:
        cells = [f"{100 * own[rung]['improvement']:+.1f} %" if rung in own else "–" for own in ladders.values()]
        lines.append(f"| {rung} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def parse_arguments(words: list[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = OneLineParser(description=__doc__)
    parser.add_argument("--task", nargs="+", default=["load-reduction"], metavar="NAME", help="(default: %(default)s)")
    parser.add_argument("--winds", type=int, default=3, metavar="N", help="of each speed (default: %(default)s)")
    parser.add_argument("--duration", type=float, metavar="S", help="of a run (default: the task's)")
    parser.add_argument("--passes", type=int, default=3, metavar="N", help="runs with offsets (default: %(default)s)")
    parser.add_argument("--no-ladder", dest="ladder", action="store_false", help="without the ladder of information")
    parser.add_argument("--page", type=file_ending_in(".md"), metavar="FILE", help="put the tables into this page")
    parser.add_argument("--out", type=Path, default=Path(KEPT), metavar="DIR", help="runs (default: %(default)s)")
    add_shared(parser, *WORKERS)
    return parser.parse_args(words)


def main() -> None:
    """Make ceilings."""
    arguments = parse_arguments()
    options = CeilingOptions(
        winds=arguments.winds, duration=arguments.duration, oracle=OracleOptions(passes=arguments.passes),
        ladder=arguments.ladder,
    )  # fmt: skip
    with user_errors(), stoppable("the same command resumes with the runs that are stored"):
        with executor_of(arguments) as executor:
            for task in chosen(arguments.task):
                ceiling = make_ceiling(task, arguments.out, options, executor, partial(print, file=sys.stderr))
                path = write_ceiling(ceiling, ceiling_file(task))
                print(f"{task.id}: with the wind known an improvement of {100 * ceiling.improvement:.2f} % ({path})")
        if arguments.page is not None:
            ceilings = {task.id: ceiling for task in chosen(["all"]) if (ceiling := ceiling_of(task)) is not None}
            page = arguments.page.read_text(encoding="utf-8")
            for part, text in (("ceilings", ceiling_table(ceilings)), ("ladder", ladder_table(ceilings))):
                page = into_page(text, page, part)
            write_text_whole(arguments.page, page)


if __name__ == "__main__":
    main()
