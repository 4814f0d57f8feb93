"""Evaluation of agents in winds that no training saw: every agent in every wind from the same start."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import gymnasium as gym
import numpy as np

import wt_gym
from wt_gym.analysis.metrics import run_metrics
from wt_gym.analysis.results import METRICS_FILE, RUNS_FOLDER, TABLE_FILE, Evaluation, Run, Wind, run_file
from wt_gym.base.canary import differing
from wt_gym.base.files import json_values, read_json, write_text_whole
from wt_gym.base.options import LONGEST, Options, option, option_record
from wt_gym.envs.episode import Agent
from wt_gym.envs.layout import EnvLayout, layout_of
from wt_gym.envs.options import wind_files_of, with_whole_paths
from wt_gym.envs.terminations import violated
from wt_gym.envs.turbine_env import WindTurbineEnv, turbine_env_of
from wt_gym.envs.wind_sampler import EVALUATION_WIND_SEEDS, LARGEST_WIND_SEED, WindSampler
from wt_gym.experiment.environments import AgentExperiment, with_common_step
from wt_gym.experiment.execute import Executor
from wt_gym.experiment.names import fingerprint
from wt_gym.experiment.options import ClimateOptions
from wt_gym.experiment.run import LEAST_MEASURED, EpisodePlayer, benchmark_fingerprint
from wt_gym.experiment.store import SWEEP_FILE, RunStore, described, run_definition, run_digest
from wt_gym.tasks import DEFAULT_ENV

if TYPE_CHECKING:
    import xarray as xr

__all__ = [
    "CONFIGURATION_FILE", "DEFAULT_WIND_SEEDS", "FIRST_SEED", "REPORT_FILE", "EvaluationConfig", "EvaluationFolder",
    "evaluate", "oscillation_notes", "swings", "winds_for", "winds_of",
]  # fmt: skip

_log = logging.getLogger(__name__)

# ---- winds ----

DEFAULT_WIND_SEEDS = EVALUATION_WIND_SEEDS[:6]
"""Turbulence seeds that no training saw; six is what IEC 61400-1 asks for at each mean speed."""
USUAL_SPEED = 15.0
"""Where nothing is said, winds have this mean speed [m/s] if the environment draws it, else that in the middle."""
_DRAWS = len(DEFAULT_WIND_SEEDS)


def winds_for(
    env_id: str,
    env_kwargs: Mapping[str, Any],
    speeds: Sequence[float] | None = None,
    seeds: Sequence[int] | None = None,
    draws: int | None = None,
    length: float | None = None,
) -> tuple[Wind, ...]:
    """Winds of an environment by id; see `winds_of`."""
    env = gym.make(env_id, **env_kwargs)
    try:
        return winds_of(turbine_env_of(env).wind, speeds, seeds, draws, length)
    finally:
        env.close()


def winds_of(
    wind: WindSampler,
    speeds: Sequence[float] | None = None,
    seeds: Sequence[int] | None = None,
    draws: int | None = None,
    length: float | None = None,
) -> tuple[Wind, ...]:
    """Every speed with every turbulence seed, or with every draw of what else an environment draws.

    Parameters
    ----------
    speeds : sequence of float, optional
        Mean speeds [m/s]; by default `USUAL_SPEED`, or the middle of the environment's range if that lies outside.
    seeds : sequence of int, optional
        Turbulence seeds, by default `DEFAULT_WIND_SEEDS`.
    draws : int, optional
        Of gusts, of several inflows, of the time in a file, of the direction of a wind without turbulence; by default
        six, or as many as files have pieces of the length of a run.
    length : float, optional
        Of a run [s].

    Raises
    ------
    ValueError
        If something is asked for that the wind of the environment does not have.
    """
    turbulent, drawn = "wind_seed" in wind.options, wind.draws_more and "wind_seed" not in wind.options
    if speeds is not None and "wind_speed" not in wind.options:
        raise ValueError(f"speeds must be left out, the wind of this environment has its own; got {list(speeds)} m/s")
    if seeds is not None and not turbulent:
        instead = ": give a number of draws" if drawn else ""
        raise ValueError(f"seeds must be left out, the wind of this environment has none; got {list(seeds)}{instead}")
    if draws is not None and not drawn:
        instead = "give turbulence seeds" if turbulent else "one run in it is all"
        raise ValueError(f"draws must be left out: the wind of this environment has its speed and seed only; {instead}")
    if draws is not None and draws < 1:
        raise ValueError(f"draws must be at least 1, got {draws!r}")
    if drawn and length is not None and (pieces := wind.windows(length)):
        if draws is not None and draws > len(pieces):
            raise ValueError(
                f"draws must be at most {len(pieces)}, the windows of {length:g} s in the files; "
                f"got {draws}: make runs shorter"
            )
        draws = min(draws or _DRAWS, len(pieces))
    low, high = wind.asked_speeds
    return tuple(
        Wind(speed, seed, draw)
        for speed in (speeds or (USUAL_SPEED if low <= USUAL_SPEED <= high else 0.5 * (low + high),))
        for seed in ((seeds or DEFAULT_WIND_SEEDS) if turbulent else (None,))
        for draw in (range(1, (draws or _DRAWS) + 1) if drawn else (None,))
    )


def actual_wind(env: WindTurbineEnv, asked: Wind, winds: Sequence[Wind]) -> Wind:
    """Wind of an episode: its speed and seed, and a description where these do not tell what it was.

    The environment has been reset for the requested wind; those of ``winds`` that mean the same to it are numbered.
    """
    own, options = env.episode_wind, env.wind.options

    def heard(wind: Wind) -> Wind:
        speed = wind.speed if "wind_speed" in options else 0.0
        return replace(wind, speed=speed, seed=wind.seed if "wind_seed" in options else None)

    draw = asked.draw
    if sum(heard(wind) == heard(asked) for wind in winds) > 1:
        draw = winds.index(asked) + 1
    description = own.inflow.description if env.wind.draws_more or env.wind.seeds is None else ""
    seed = own.wind_seed if own.wind_seed >= 0 else None
    return Wind(float(own.wind_speed), seed, draw, description if seed is None else "")


# ---- configuration ----

FIRST_SEED = 2**40
"""Seeds of the environment in evaluations begin here, far beyond those of any training: what a wind seed does not
decide (gusts, directions, own inflows, noise) is never what a training has drawn."""
_SEEDS_A_WIND, _MOST_WINDS, _MOST_SEED = 1000, 2**20, 2**32


@option_record
class EvaluationConfig(Options):
    """Environment, winds and length of an evaluation.

    ``env_kwargs`` are arguments of the environment besides the length of episodes; files of wind get whole paths.
    ``winds``, a tuple of `wt_gym.analysis.results.Wind`, are those that are asked for, by default six held-out
    turbulence seeds at 15 m/s; `winds_for` gives those of an environment. Runs are labeled by the winds that they had.
    """

    title = "evaluation"

    env_id: str = option("id of the environment", default=DEFAULT_ENV)
    env_kwargs: dict[str, Any] = field(default_factory=dict)
    winds: tuple[Wind, ...] = tuple(Wind(USUAL_SPEED, seed) for seed in DEFAULT_WIND_SEEDS)
    duration: float = option("length of a run", default=600.0, unit="s", low=0.0, high=LONGEST)
    skip: float = option("start left out of the metrics", default=30.0, unit="s", low=0.0)
    seed: int = option(
        "random numbers that the wind seeds do not decide: gusts, directions, your own inflows, measurement noise; "
        "counted from `FIRST_SEED` on, so that no training has met it", default=0, low=0, high=_MOST_SEED,
    )  # fmt: skip
    replay: float = option(
        "length of the end of the runs in the first wind whose shapes are stored for a replay; 0: none", default=20.0,
        unit="s", low=0.0, high=LONGEST,
    )  # fmt: skip
    climate: ClimateOptions = option(
        "wind climate for loads over a life", default=ClimateOptions(), kinds=(ClimateOptions,)
    )

    def check(self) -> None:
        """Refuse runs without measurement, winds that are missing or stand twice, and a length in the arguments."""
        if self.duration < self.skip + LEAST_MEASURED:
            raise ValueError(
                f"duration must be {LEAST_MEASURED:g} s longer than skip or more, got {self.duration:g} and "
                f"{self.skip:g} s"
            )
        if not self.winds or len(set(self.winds)) < len(self.winds) or len(self.winds) > _MOST_WINDS:
            labels = ", ".join(wind.label for wind in self.winds[:100])
            raise ValueError(f"1 to {_MOST_WINDS} winds must be given, each once, got {labels}")
        for seed in (wind.seed for wind in self.winds if wind.seed is not None):
            if not 0 <= seed <= LARGEST_WIND_SEED:
                raise ValueError(f"a wind seed must be from 0 to {LARGEST_WIND_SEED}, got {seed!r}")
        self._set("env_kwargs", with_whole_paths(self.env_kwargs))
        for name in ("episode_length", "max_episode_steps"):
            if name in self.env_kwargs:
                raise ValueError(f"{name} follows from the duration of the evaluation; leave it out of env_kwargs")

    def seed_in(self, wind: Wind) -> int:
        """Seed of the environment in a wind: what the wind leaves open is drawn for each, once for all agents.

        Each seed and place of a wind has its own number: its last three digits are those of the seed, then come the
        place and the rest of the seed.
        """
        rest, first = divmod(self.seed, _SEEDS_A_WIND)
        return FIRST_SEED + first + _SEEDS_A_WIND * (self.winds.index(wind) + _MOST_WINDS * rest)

    def replay_in(self, wind: Wind) -> float:
        """Length of the replay of a run in a wind [s]."""
        return self.replay if wind == self.winds[0] else 0.0


# ---- the folder ----

CONFIGURATION_FILE, REPORT_FILE = "configuration.json", "report.html"


class EvaluationFolder(RunStore):
    """Runs of one evaluation on disk, with its configuration; a context that holds the folder for this process.

    Raises a `ValueError` if an agent is an object, which a file cannot identify.
    """

    def __init__(self, path: str | Path, agents: Mapping[str, str | Agent], config: EvaluationConfig):
        objects = [name for name, agent in agents.items() if not isinstance(agent, str)]
        if objects:
            raise ValueError(
                f"agents of an evaluation that is kept in a folder must be names or paths, got objects for "
                f"{', '.join(objects)}: leave the folder out and save the result"
            )
        super().__init__(path, "evaluation")
        self._config = config
        configuration = {
            "agents": {name: fingerprint(cast(str, choice)) for name, choice in agents.items()},
            **{name: value for name, value in asdict(config).items() if name != "climate"},
            "env_kwargs": described(config.env_kwargs, "env_kwargs"),
            "wind_files": wind_files_of(config.env_kwargs),
        }
        # through JSON, so that it can be compared with what a file says
        self._configuration = json_values(configuration)

    def begin(self, fingerprint: dict[str, Any], overwrite: bool) -> None:
        """Make the folder ready: empty for a new evaluation or with ``overwrite``, as it is for one to resume.

        A folder stores the fingerprint with which it was begun, so that small changes do not add up. Other files stay.
        Raises a `ValueError` if it holds another evaluation that is not to be overwritten.
        """
        self._configuration["fingerprint"] = fingerprint
        if overwrite:
            self._clear()
        elif any((self.path / name).exists() for name in (CONFIGURATION_FILE, TABLE_FILE)) and (
            others := self._differences()
        ):
            raise ValueError(
                f"{self.path} holds another evaluation, with other {', '.join(others)}: take another folder, or "
                "overwrite it"
            )
        (self.path / RUNS_FOLDER).mkdir(parents=True, exist_ok=True)
        text = json.dumps(self._configuration, indent=1) + "\n"
        write_text_whole(self.path / CONFIGURATION_FILE, text)

    def definition(self, job: tuple[str, Wind]) -> dict[str, Any]:
        """JSON values that decide on the numbers of an agent in a requested wind."""
        (agent, wind), known = job, self._configuration
        return run_definition(
            agent={"name": agent, **known["agents"][agent]},
            wind=asdict(wind),
            seed=self._config.seed_in(wind),
            replay=self._config.replay_in(wind),
            **{name: known[name] for name in ("env_id", "env_kwargs", "duration", "skip", "wind_files", "fingerprint")},
        )

    def name(self, definition: dict[str, Any]) -> str:
        """Name of the file of a run."""
        return run_file(run_digest(definition), definition["agent"]["name"])

    def _read(self, file: Path, definition: dict[str, Any] | None = None) -> Run:
        """Read a run; `Run.save` says what stands there, and `begin` has compared the fingerprint of the folder."""
        return Run.load(file)

    def _write(self, file: Path, definition: dict[str, Any], result: Run) -> Run:
        result.save(file)
        return result

    def _differences(self) -> list[str]:
        """Parts of the configuration that are not those of the evaluation that is there."""
        file = self.path / CONFIGURATION_FILE
        found: dict[str, Any] = read_json(file) if file.exists() else {}
        names = [name for name, value in self._configuration.items()
                 if name != "fingerprint" and (name not in found or found[name] != value)]  # fmt: skip
        fingerprint = found.get("fingerprint", {})
        names += differing(fingerprint, self._configuration["fingerprint"])
        self._configuration["fingerprint"] = fingerprint
        return names

    def _clear(self) -> None:
        """Remove what an evaluation left here, and nothing else."""
        for name in (CONFIGURATION_FILE, TABLE_FILE, METRICS_FILE, REPORT_FILE, SWEEP_FILE):
            (self.path / name).unlink(missing_ok=True)
        for pattern in ("*.nc", "*_replay.npz"):
            for file in (self.path / RUNS_FOLDER).glob(pattern):
                file.unlink()


# ---- runs ----


class _EvaluationRuns(AgentExperiment):
    """Rows of an evaluation: name of an agent and requested wind."""

    def __init__(
        self, agents: Mapping[str, str | Agent], config: EvaluationConfig, as_given: bool,
        folder: EvaluationFolder | None,
    ):  # fmt: skip
        self._config, self._folder = config, folder
        super().__init__(agents, config.env_id, config.env_kwargs, config.duration, as_given)

    def __getstate__(self) -> dict[str, Any]:
        return super().__getstate__() | {"_folder": None}

    def definition(self, row: tuple[str, Wind]) -> dict[str, Any]:
        return {"agent": row[0], "wind": asdict(row[1])} if self._folder is None else self._folder.definition(row)

    def label(self, row: tuple[str, Wind]) -> str:
        return f"{row[0]} at {row[1].label}"

    def __call__(self, row: tuple[str, Wind]) -> Run:
        (name, request), (env, agent), config = row, self[row[0]], self._config
        turbine_env, options = turbine_env_of(env), dict[str, Any](azimuth=0.0)
        asked = {"wind_speed": request.speed, "wind_seed": request.seed}
        options |= {key: asked[key] for key in turbine_env.wind.options if asked.get(key) is not None}
        if request.draw is not None and (pieces := turbine_env.wind.windows(config.duration)):
            file, start = pieces[(request.draw - 1) % len(pieces)]  # drawn ones would overlap, or be the same
            options["inflow"] = file.inflow(start)
        replay = config.replay_in(request)
        player = EpisodePlayer(env, agent, seed=config.seed_in(request), options=options, replay=replay)
        self.progress.follow(self.label(row), config.duration, player)
        result, wind = player.episode, actual_wind(turbine_env, request, config.winds)
        measured = result.time >= config.skip + LEAST_MEASURED
        metrics = run_metrics(result.after_start, turbine_env.turbine, config.skip) if measured else {}
        if metrics and turbine_env.options.limits.costs is not None:
            violations = violated({name: cost / result.steps for name, cost in result.costs.items()})
            metrics["limits_violated"] = float(bool(violations))
        seed = int(turbine_env.episode_wind.wind_seed)
        return Run(
            agent=name, wind=wind, data=result.data.assign_attrs(agent=name, wind_speed=wind.speed, wind_seed=seed),
            metrics=metrics, episode_return=result.episode_return, reward_terms=result.reward_terms,
            planned_duration=config.duration, duration=result.time, ending=result.ending, failure=result.failure,
            replay=result.replay,
        )  # fmt: skip


def evaluate(
    agents: Mapping[str, str | Agent],
    config: EvaluationConfig,
    *,
    folder: str | Path | None = None,
    overwrite: bool = False,
    allow_other_environment: bool = False,
    executor: Executor | None = None,
    progress: bool = True,
) -> Evaluation:
    """Run every agent in every wind from the same start.

    Parameters
    ----------
    agents : mapping
        Name to agent, or to a word or path for `wt_gym.experiment.agents.load_agent`. The first is the one the others
        are compared with. Control steps are as short as the shortest in the training of one of them
        (`wt_gym.experiment.environments.with_common_step`).
    folder : str or path, optional
        Stores each run as soon as it is done, and in the end the tables. Runs of the same evaluation that are there
        already are not run again. Needs agents by word or path.
    overwrite : bool
        Remove what another evaluation left in the folder.
    allow_other_environment : bool
        Take trained models into an environment with other noise, action spans or base controller than in their
        training, see `wt_gym.experiment.environments.check_environment`.
    executor : Executor, optional
        Of `wt_gym.experiment.execute`, entered: does the runs, by default one after another. The numbers are the same.
        One that does them in other processes needs agents by word or path.
    progress : bool
        Show progress on standard error.

    Raises
    ------
    ValueError
        If the folder holds another evaluation or is in use by another process, an agent that is to be stored there or
        to run in another process is given as an object, or a model does not fit the environment.
    OSError
        If the folder cannot be written.
    ChildProcessError
        If runs were lost, because the processes or machines that did them ended again and again.
    """
    objects = [name for name, agent in agents.items() if not isinstance(agent, str)]
    if executor is not None and executor.beside and objects:
        raise ValueError(
            f"agents that run in other processes must be names or paths, got objects for {', '.join(objects)}"
        )
    config = replace(config, env_kwargs=with_common_step(agents, config.env_id, config.env_kwargs))
    store = None if folder is None else EvaluationFolder(folder, agents, config)
    with store or nullcontext(), _EvaluationRuns(agents, config, allow_other_environment, store) as experiment:
        layout, turbine_env = layout_of(experiment.env), turbine_env_of(experiment.env)
        turbine, notes = layout.turbine, training_notes(experiment.agents, config.winds)
        for note in notes.values():
            _log.warning(note)
        climate = config.climate.of(turbine)
        if store:  # nothing else can be refused any more
            store.begin(benchmark_fingerprint(turbine, turbine_env.fidelity), overwrite)
        rows = [(name, wind) for wind in config.winds for name in agents]
        runs = experiment.table(rows, executor, store, progress)
        _require_common_winds(dict(zip(rows, runs, strict=True)), agents, config.winds)
        for name, note in oscillation_notes(runs, turbine.drivetrain.rated_rotor_speed, config.skip).items():
            _log.warning(note)
            notes[name] = f"{notes[name]} {note}" if name in notes else note
        operates = all(turbine.cut_in <= run.wind.speed <= turbine.cut_out for run in runs)
        evaluation = Evaluation(
            turbine=turbine.heading,
            settings=_settings(config, layout, experiment.env),
            runs=runs,
            baseline=next(iter(agents)),
            limits={
                "rated_power": turbine.drivetrain.rated_power,
                "rated_rotor_speed": turbine.drivetrain.rated_rotor_speed,
            },
            training={
                name: record for name, agent in experiment.agents.items() if (record := getattr(agent, "record", None))
            },
            climate=climate if operates else None,
            notes=notes,
        )
        if store:
            evaluation.save_tables(store.path, [store.name(store.definition(row)) for row in rows])
    return evaluation


def _require_common_winds(runs: Mapping[tuple[str, Wind], Run], agents: Iterable[str], winds: Iterable[Wind]) -> None:
    """Refuse to compare agents that did not meet the same wind where the same was asked for."""
    for asked in winds:
        if len(met := dict.fromkeys(runs[name, asked].wind for name in agents)) > 1:
            raise ValueError(
                f"agents met different winds where one was asked for, {' and '.join(w.label for w in met)}: the "
                "inflow must follow from the random generator that it is given, and from nothing else"
            )


def _settings(config: EvaluationConfig, layout: EnvLayout, env: gym.Env) -> dict[str, Any]:
    """How the evaluation was made, as JSON values."""
    fidelity = turbine_env_of(env).fidelity
    settings = {
        "env_id": config.env_id,
        "env_kwargs": config.env_kwargs,
        "fidelity": fidelity if isinstance(fidelity, str) else fidelity.name,
        "control_dt": layout.control_dt,
        "iec_class": layout.turbine.iec_class,
        "turbulence_class": turbine_env_of(env).options.wind.turbulence_class or layout.turbine.turbulence_class,
        "duration": config.duration,
        "skip": config.skip,
        "seed": config.seed,
        "wt_gym": wt_gym.__version__,
        "numpy": np.__version__,
        "gymnasium": gym.__version__,
    }
    return json_values(settings)


# ---- notes ----

_MOST_NAMED = 6


def training_notes(agents: Mapping[str, Agent], winds: Iterable[Wind]) -> dict[str, str]:
    """Sentences, by agent, on trained models that have met winds of an evaluation, or whose training is unknown.

    Agents with a ``record``, as of `wt_gym.experiment.trained_agent.TrainedAgent`, are trained.
    """
    seeds = list(dict.fromkeys(wind.seed for wind in winds if wind.seed is not None))
    notes = {}
    for name, agent in agents.items():
        if not isinstance(record := getattr(agent, "record", False), Mapping | None):
            continue  # not a trained model
        if not record:
            notes[name] = (
                f"Nothing is known of the training of {name}: there is no training.json beside its model. It runs on "
                "the environment's own controller and observation, and may have met these winds."
            )
        elif met := [str(seed) for seed in seeds if seed in (record.get("wind_seeds") or ())]:
            more = f" and {len(met) - _MOST_NAMED} more" if len(met) > _MOST_NAMED else ""
            notes[name] = (
                f"{name} was trained on wind seed{'s' if len(met) > 1 else ''} {', '.join(met[:_MOST_NAMED])}{more} of "
                "this evaluation: its figures there do not test unseen winds."
            )
    return notes


SWING = 0.1
"""Deviation of the rotor speed to either side that counts, in rated speeds [-]."""
LEAST_SWINGS = 3
"""Alternations between the two sides from which on a run oscillates."""
_STEADY = 0.02
"""Standard deviation of the wind at the hub over its mean up to which it counts as steady [-]."""


def swings(data: xr.Dataset, rated_speed: float, skip: float = 0.0) -> int:
    """Number of times that the rotor speed goes from one side of a band to the other.

    The band is ±10 % of rated speed. It lies about rated speed, since below it the speed follows the wind; in a steady
    wind, which explains no change, about the median of the run. The loop of a floating turbine is slower than its
    platform and lets the speed follow turbulence: there a steady wind alone counts. Takes ``rotor_speed`` [rad/s] and
    ``wind_x`` [m/s] over ``time`` [s], rated speed [rad/s] and the start that is left out [s].
    """
    kept = data["time"].values >= skip
    speed, wind = data["rotor_speed"].values[kept], data["wind_x"].values[kept]
    if speed.size == 0:
        return 0
    steady = float(np.std(wind)) <= _STEADY * abs(float(np.mean(wind)))
    if not steady and "platform_pitch" in data:
        return 0
    middle = float(np.median(speed)) if steady else rated_speed
    side = np.where(speed > middle + SWING * rated_speed, 1, np.where(speed < middle - SWING * rated_speed, -1, 0))
    visited = side[side != 0]
    return int(np.count_nonzero(np.diff(visited)))


def oscillation_notes(runs: Iterable[Run], rated_speed: float, skip: float) -> dict[str, str]:
    """Sentences on agents under which the rotor speed oscillates, by name; nothing of agents whose runs are steady.

    Takes rated speed [rad/s] and the start of each run that is left out [s].
    """
    found: dict[str, list[tuple[str, float, float]]] = {}
    for run in runs:
        if swings(run.data, rated_speed, skip) < LEAST_SWINGS:
            continue
        speed = run.data["rotor_speed"].values[run.data["time"].values >= skip] / rated_speed
        found.setdefault(run.agent, []).append((run.wind.name, float(speed.min()), float(speed.max())))
    notes = {}
    for agent, cases in found.items():
        low, high = min(case[1] for case in cases), max(case[2] for case in cases)
        more = f" and {len(cases) - 4} more" if len(cases) > 4 else ""
        notes[agent] = (
            f"The rotor speed oscillates under {agent} in {', '.join(case[0] for case in cases[:4])}{more}: it swings "
            f"between {low:.2f} and {high:.2f} times rated speed. Its controller does not hold this turbine, and "
            "figures of these runs compare nothing."
        )
    return notes
