"""Results of an evaluation: runs of agents in winds and the shapes of their last seconds, on disk and read back."""

import json
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from wt_gym.analysis.metrics import METRICS, idle_sentence, idle_time, measured_metrics
from wt_gym.analysis.statistics import WindClimate
from wt_gym.base.files import write_netcdf_whole, write_text_whole, write_whole

# A wake is thinned to this many rows and filaments a blade, which keeps a replay of 20 s below 1 MB.
_MOST_ROWS, _MOST_FILAMENTS = 64, 5


def trailing_strength(circulation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Circulation of the trailing filaments between rings side by side: size of the difference across each [m^2/s].

    From the rings' circulation (n_rows, n_blades, n_span) [m^2/s] to shape (n_rows, n_blades, n_span + 1).
    """
    padded = np.pad(np.asarray(circulation, dtype=np.float64), ((0, 0), (0, 0), (1, 1)))
    return np.abs(np.diff(padded, axis=2))


@dataclass(frozen=True)
class Replay:
    """Shapes over time, global frame, meters."""

    time: NDArray[np.float64]
    """[s]. Shape (n,)."""
    blades: NDArray[np.float64]
    """Leading and trailing edges. Shape (n, n_blades, 2, n_span + 1, 3)."""
    wake: NDArray[np.float64]
    """Nodes of trailing filaments, the newest row first; NaN where the wake is shorter.
    Shape (n, n_rows, n_blades, n_filaments, 3)."""
    strength: NDArray[np.float64]
    """Size of the filaments' circulation [m^2/s]. Shape (n, n_rows, n_blades, n_filaments)."""
    tower: NDArray[np.float64]
    """Axis, from the ground up. Shape (n, n_tower, 3)."""
    tower_radius: NDArray[np.float64]
    """Shape (n_tower,)."""
    hub: NDArray[np.float64]
    """Shape (n, 3)."""
    floater: NDArray[np.float64]
    """Ends of the members of a platform and of pieces of its mooring lines. Shape (n, n_pieces, 2, 3)."""
    floater_radius: NDArray[np.float64]
    """Radii of the members, 0 for pieces of lines. Shape (n_pieces,)."""
    sea: NDArray[np.float64]
    """Elevation of the sea at nodes of its surface, none of a turbine on the ground. Shape (n, n_along, n_across)."""
    sea_place: NDArray[np.float64]
    """x and y of the nodes. Shape (n_along, n_across, 2)."""

    def save(self, path: Path) -> None:
        """Write a compressed NumPy archive, which is there when it is whole."""
        shapes = {f.name: getattr(self, f.name) for f in fields(self)}
        write_whole(path, lambda file: np.savez_compressed(file, **shapes))

    @classmethod
    def load(cls, path: Path) -> "Replay":
        """Read what `save` wrote."""
        with np.load(path) as arrays:
            if missing := {f.name for f in fields(cls)} - set(arrays):
                raise ValueError(f"{path} must hold {', '.join(sorted(missing))}: it is of another version")
            return cls(**{f.name: arrays[f.name] for f in fields(cls)})


class ReplayRecorder:
    """Keeps the shapes of the last ``n_frames`` instants while a simulation runs."""

    def __init__(self, n_frames: int):
        self._frames: deque[tuple[float, dict[str, NDArray[np.float64]]]] = deque(maxlen=n_frames)

    def append(self, time: float, geometry: Mapping[str, NDArray[np.float64]]) -> None:
        """Keep the shapes, as given by ``Simulator.geometry()``, at a time [s]."""
        self._frames.append((time, _thinned(geometry)))

    def to_replay(self) -> Replay | None:
        """Replay of the instants in memory; None where there are none."""
        if not self._frames:
            return None
        times, shapes = zip(*self._frames, strict=True)
        n_rows = max(len(shape["wake"]) for shape in shapes)
        for shape in shapes:  # rows of NaN behind a short wake
            for name in ("wake", "strength"):
                missing = [(0, n_rows - len(shape[name]))] + [(0, 0)] * (shape[name].ndim - 1)
                shape[name] = np.pad(shape[name], missing, constant_values=np.nan)
        constant = {name: shapes[0][name] for name in ("tower_radius", "floater_radius", "sea_place")}
        stacked = {name: np.stack([shape[name] for shape in shapes]) for name in shapes[0] if name not in constant}
        return Replay(time=np.array(times), **constant, **stacked)


def _thinned(geometry: Mapping[str, NDArray[np.float64]]) -> dict[str, NDArray[np.float64]]:
    """Shapes of an instant as single-precision numbers, the wake with fewer rows and filaments."""
    wake, rings = np.asarray(geometry["wake"]), trailing_strength(geometry["wake_circulation"])
    strength = np.zeros(wake.shape[:3])
    strength[: len(rings)] = rings
    if len(rings):  # one ring less than rows of nodes: the last node ends the last ring
        strength[len(rings) :] = rings[-1]
    rows = np.unique(np.linspace(0, len(wake) - 1, min(len(wake), _MOST_ROWS)).round().astype(int))
    filaments = kept_filaments(wake.shape[2])
    floater, radius = _floater(geometry), np.asarray(geometry.get("platform_radius", ()))
    sea = np.asarray(geometry.get("sea", np.zeros((0, 0, 3))))
    shapes = {
        "blades": np.asarray(geometry["blades"])[:, [0, -1]],
        "wake": wake[rows][:, :, filaments],
        "strength": strength[rows][:, :, filaments],
        "tower": geometry["tower"],
        "tower_radius": geometry["tower_radius"],
        "hub": geometry["hub"],
        "floater": floater,
        "floater_radius": np.pad(radius, (0, len(floater) - len(radius))),
        "sea": sea[..., 2],
        "sea_place": sea[..., :2],
    }
    return {name: np.array(values, dtype=np.float32) for name, values in shapes.items()}


def _floater(geometry: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    """Members of a platform and pieces of its lines (n_pieces, 2, 3); none of a turbine on the ground."""
    lines = np.asarray(geometry.get("lines", np.zeros((0, 2, 3))))
    lines = lines[:, np.linspace(0, lines.shape[1] - 1, 13).round().astype(int)]  # from anchor to fairlead
    pieces = np.stack([lines[:, :-1], lines[:, 1:]], axis=2).reshape(-1, 2, 3)
    return np.concatenate([np.asarray(geometry.get("platform", np.zeros((0, 2, 3)))), pieces])


def kept_filaments(n_filaments: int) -> NDArray[np.int_]:
    """Filaments of a blade that a replay keeps, from the first to the last, closer to each other towards the tip."""
    if n_filaments <= _MOST_FILAMENTS:
        return np.arange(n_filaments)
    places = (n_filaments - 1) * np.sin(np.linspace(0.0, 0.5 * np.pi, _MOST_FILAMENTS))
    return np.unique(places.round().astype(int))


TABLE_FILE, METRICS_FILE, RUNS_FOLDER = "evaluation.json", "metrics.csv", "runs"
_COMBINE: dict[str, Callable[..., Any]] = {"mean": np.mean, "max": np.max, "min": np.min, "sum": np.sum}


@dataclass(frozen=True)
class Wind:
    """A wind to evaluate in, or one that a run had."""

    speed: float
    """Mean at hub height [m/s]."""
    seed: int | None = None
    """Of the turbulence; None without."""
    draw: int | None = None
    """Number of the draw where more is drawn than turbulence: gusts, custom inflows, directions."""
    description: str = ""
    """The wind of a run in words, where speed and seed do not tell what it was."""

    @property
    def name(self) -> str:
        """Name for sentences, without the description."""
        seed = "" if self.seed is None else f", seed {self.seed}"
        draw = "" if self.draw is None else f", draw {self.draw}"
        return f"{self.speed:.4g} m/s{seed}{draw}"

    @property
    def label(self) -> str:
        """Name with the description, if there is one."""
        return f"{self.name} ({self.description})" if self.description else self.name


@dataclass(frozen=True)
class Run:
    """One agent in one wind."""

    agent: str
    wind: Wind
    """Of the run, whatever the request was."""
    data: xr.Dataset
    """Recorded signals over ``time`` [s]."""
    metrics: dict[str, float]
    """Keys of `wt_gym.analysis.metrics.METRICS`, SI units; empty if the run was too short to measure."""
    episode_return: float
    """Sum of rewards."""
    reward_terms: dict[str, float]
    """Sum of each term."""
    planned_duration: float
    duration: float
    """planned_duration, duration: requested and simulated [s]."""
    ending: str
    """``"time"``, or why the run was terminated."""
    failure: str | None = None
    """Message of a failed simulation."""
    replay: Replay | None = None
    """Shapes of its last seconds, if they were stored."""

    @property
    def complete(self) -> bool:
        """Return True if the run lasted as long as planned."""
        return self.ending == "time"

    def to_json(self) -> dict[str, Any]:
        """Everything but signals and shapes, as JSON values."""
        names = [f.name for f in fields(self) if f.name not in ("data", "replay")]
        return {name: getattr(self, name) for name in names} | {"wind": asdict(self.wind)}

    def save(self, path: Path) -> None:
        """Write the run as one NetCDF file, which is there when it is whole.

        The replay, if there is one, goes into a second file beside it, which is written first. The folder must exist.
        """
        if self.replay is not None:
            self.replay.save(_replay_file(path))
        write_netcdf_whole(path, self.data.assign_attrs(run=json.dumps(self.to_json())))

    @classmethod
    def load(cls, path: Path) -> "Run":
        """Read what `save` wrote; `ValueError` where the file holds no run."""
        data = xr.load_dataset(path, engine="h5netcdf")
        if "run" not in data.attrs:
            raise ValueError(f"{path} holds no run of an evaluation")
        row = json.loads(data.attrs.pop("run"))
        replay = Replay.load(_replay_file(path)) if _replay_file(path).exists() else None
        return cls(**row | {"wind": Wind(**row["wind"]), "data": data, "replay": replay})


def _replay_file(path: Path) -> Path:
    return path.with_name(f"{path.stem}_replay.npz")


def run_file(mark: str, agent: str) -> str:
    """Name of the file of a run: the agent, and a mark that tells the run from all others of the folder."""
    safe = "".join(c if c.isalnum() or c == "-" else "_" for c in agent).lower()
    return f"{safe}_{mark}.nc"


def run_files(folder: str | Path) -> list[str]:
    """Files of the runs of an evaluation's folder, as seen from it, in the order of `Evaluation.runs`."""
    table = json.loads((Path(folder) / TABLE_FILE).read_text(encoding="utf-8"))
    return [row["file"] for row in table["runs"]]


@dataclass(frozen=True)
class Evaluation:
    """Runs of several agents in the same winds."""

    turbine: str
    settings: dict[str, Any]
    """Environment id and arguments, skipped start, versions, as JSON values."""
    runs: list[Run]
    baseline: str
    """Agent that the others are compared with."""
    limits: dict[str, float] = field(default_factory=dict)
    """Rated power [W], rated rotor speed [rad/s] and the like, for reference lines in plots."""
    training: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Agent name to the record of its training (see `wt_gym.learning.train`), for trained agents."""
    climate: WindClimate | None = None
    """How often each wind speed blows, for loads over a life."""
    notes: dict[str, str] = field(default_factory=dict)
    """Agent name to a sentence on its figures: it has met these winds in its training, or that is unknown."""

    @property
    def agents(self) -> list[str]:
        """Agents, the baseline first."""
        names = list(dict.fromkeys(run.agent for run in self.runs))
        return sorted(names, key=lambda name: name != self.baseline)

    @property
    def others(self) -> list[str]:
        """Agents without the baseline."""
        return self.agents[1:]

    @property
    def winds(self) -> list[Wind]:
        """Winds in the order they were run."""
        return list(dict.fromkeys(run.wind for run in self.runs))

    @property
    def speeds(self) -> list[float]:
        """Mean wind speeds, ascending [m/s]."""
        return sorted({wind.speed for wind in self.winds})

    def run(self, agent: str, wind: Wind) -> Run:
        """Run of an agent in a wind; `KeyError` without."""
        return self._run_at[agent, wind]

    @cached_property
    def _run_at(self) -> dict[tuple[str, Wind], Run]:
        return {(run.agent, run.wind): run for run in self.runs}

    def runs_of(self, agent: str, speed: float | None = None) -> list[Run]:
        """Runs of an agent, in the order of `winds`, at one mean speed [m/s] or all."""
        return [self.run(agent, wind) for wind in self.winds if speed in (None, wind.speed)]

    def survived(self, agent: str, speed: float | None = None) -> bool:
        """Return True if all runs of an agent, at one mean speed [m/s] or all, lasted as long as planned."""
        return all(run.complete for run in self.runs_of(agent, speed))

    def mean_metrics(self, agent: str) -> dict[str, float]:
        """Mean of each metric over the winds, of those metrics that every run of the agent has."""
        return {key: float(np.mean(values)) for key, values in self._shared_metrics(agent, None).items()}

    def overall_metrics(self, agent: str, speed: float | None = None) -> dict[str, float]:
        """Each metric over the winds, of one mean speed or all: means, extremes of the extremes, sums of events."""
        values = self._shared_metrics(agent, speed)
        return {key: float(_COMBINE[METRICS[key].over_winds](values[key])) for key in values}

    def _shared_metrics(self, agent: str, speed: float | None) -> dict[str, list[float]]:
        """Values of those metrics that every run of an agent has."""
        tables = [run.metrics for run in self.runs_of(agent, speed)]
        return {key: [table[key] for table in tables] for key in tables[0] if all(key in table for table in tables)}

    @property
    def idle_sentences(self) -> dict[str, str]:
        """Sentences on agents under which the turbine made no power without a reason, by name."""
        spells = {a: [(run.wind.name, idle_time(run.data)) for run in self.runs_of(a)] for a in self.agents}
        sentences = {agent: idle_sentence(agent, times) for agent, times in spells.items()}
        return {agent: sentence for agent, sentence in sentences.items() if sentence is not None}

    def to_dataframe(self) -> pd.DataFrame:
        """Table with a row a run.

        Columns ``agent``, ``wind_speed`` [m/s], ``wind_seed``, ``wind``, ``ending``, ``duration`` [s],
        ``episode_return`` and one for each of `wt_gym.analysis.metrics.METRICS`, in SI units, NaN where not measured.
        """
        measured = measured_metrics(run.metrics for run in self.runs)
        rows = [
            {
                "agent": run.agent, "wind_speed": run.wind.speed, "wind_seed": run.wind.seed, "wind": run.wind.label,
                "ending": run.ending, "duration": run.duration, "episode_return": run.episode_return,
                **{key: run.metrics.get(key, np.nan) for key in measured},
            }
            for run in self.runs
        ]  # fmt: skip
        return pd.DataFrame(rows).astype({"wind_seed": "Int64"})

    def to_json(self) -> dict[str, Any]:
        """Everything but signals and shapes, as JSON values."""
        return {f.name: getattr(self, f.name) for f in fields(self)} | {
            "climate": None if self.climate is None else asdict(self.climate),
            "mean": {agent: self.mean_metrics(agent) for agent in self.agents},
            "runs": [run.to_json() for run in self.runs],
        }

    def save(self, folder: str | Path) -> Path:
        """Write the runs, a NetCDF file each, and the tables into a folder; give the path of the JSON file."""
        folder = Path(folder)
        (folder / RUNS_FOLDER).mkdir(parents=True, exist_ok=True)
        files = [run_file(f"{number:03d}", run.agent) for number, run in enumerate(self.runs)]
        for file, run in zip(files, self.runs, strict=True):
            run.save(folder / RUNS_FOLDER / file)
        return self.save_tables(folder, files)

    def save_tables(self, folder: Path, files: list[str]) -> Path:
        """Write ``evaluation.json`` and ``metrics.csv``, a row a run, beside runs that are in these files already."""
        table = self.to_json()
        for file, row in zip(files, table["runs"], strict=True):
            row["file"] = f"{RUNS_FOLDER}/{file}"
        rows = self.to_dataframe().drop(columns="episode_return").to_csv(index=False, lineterminator="\r\n")
        write_text_whole(folder / METRICS_FILE, rows)
        path = folder / TABLE_FILE
        write_text_whole(path, json.dumps(table, indent=1) + "\n")
        return path

    @classmethod
    def load(cls, folder: str | Path) -> "Evaluation":
        """Read what `save` wrote; `FileNotFoundError` where the folder holds no evaluation."""
        folder = Path(folder)
        table = json.loads((folder / TABLE_FILE).read_text(encoding="utf-8"))
        runs = [Run.load(folder / row["file"]) for row in table["runs"]]
        climate = None if table["climate"] is None else WindClimate(**table["climate"])
        del table["mean"]
        return cls(**table | {"runs": runs, "climate": climate})
