"""Results of an evaluation: runs of agents in winds, kept in a folder and read back."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

__all__ = ["Evaluation", "Run", "Wind"]

_JSON_NAME, _GEOMETRY_NAME = "evaluation.json", "geometry.npz"


@dataclass(frozen=True)
class Wind:
    """A wind to evaluate in: mean speed at hub height [m/s] and turbulence seed (None: steady)."""

    speed: float
    seed: int | None = None

    @property
    def label(self) -> str:
        """Short name for tables."""
        return f"{self.speed:g} m/s" + ("" if self.seed is None else f", seed {self.seed}")


@dataclass(frozen=True)
class Run:
    """One agent in one wind.

    Attributes
    ----------
    agent : str
    wind : Wind
    data : xarray.Dataset
        Recorded signals over ``time`` [s].
    metrics : dict
        Keys of `wt_gym.analysis.metrics.METRICS`, SI units; empty if the run was too short to measure.
    episode_return : float
        Sum of rewards.
    reward_terms : dict
        Sum of each term.
    planned_duration, duration : float
        Asked for and simulated [s].
    ending : str
        ``"time"``, or why the run was terminated.
    failure : str or None
        Message of a failed simulation.
    """

    agent: str
    wind: Wind
    data: xr.Dataset
    metrics: dict[str, float]
    episode_return: float
    reward_terms: dict[str, float]
    planned_duration: float
    duration: float
    ending: str
    failure: str | None = None

    @property
    def complete(self) -> bool:
        """Whether the run lasted as long as planned."""
        return self.ending == "time"


@dataclass(frozen=True)
class Evaluation:
    """Runs of several agents in the same winds.

    Attributes
    ----------
    turbine : str
        Name of the turbine.
    settings : dict
        What the evaluation was made with (environment id and arguments, skipped start, versions), JSON values.
    runs : list of Run
    baseline : str
        Agent that the others are compared with.
    limits : dict
        Rated power [W], rated rotor speed [rad/s] and the like, for reference lines in plots.
    training : dict
        Agent name to how it was trained (see `agents.train`), for agents that were.
    geometry : dict of numpy.ndarray
        Blades, wake and tower at one instant as the simulator gives them; empty without.
    geometry_label : str
        What the geometry shows.
    """

    turbine: str
    settings: dict[str, Any]
    runs: list[Run]
    baseline: str
    limits: dict[str, float] = field(default_factory=dict)
    training: dict[str, dict[str, Any]] = field(default_factory=dict)
    geometry: dict[str, np.ndarray] = field(default_factory=dict)
    geometry_label: str = ""

    @property
    def agents(self) -> list[str]:
        """Agents, the baseline first."""
        names = list(dict.fromkeys(run.agent for run in self.runs))
        return sorted(names, key=lambda name: name != self.baseline)

    @property
    def winds(self) -> list[Wind]:
        """Winds in the order they were run."""
        return list(dict.fromkeys(run.wind for run in self.runs))

    def run(self, agent: str, wind: Wind) -> Run:
        """Give the run of an agent in a wind.

        Raises
        ------
        KeyError
            If there is none.
        """
        for run in self.runs:
            if run.agent == agent and run.wind == wind:
                return run
        raise KeyError(f"no run of agent {agent!r} in wind {wind.label}")

    def runs_of(self, agent: str) -> list[Run]:
        """Runs of an agent, in the order of `winds`."""
        return [self.run(agent, wind) for wind in self.winds]

    def mean_metrics(self, agent: str) -> dict[str, float]:
        """Mean of each metric over the winds, of those metrics that every run of the agent has."""
        tables = [run.metrics for run in self.runs_of(agent)]
        shared = [key for key in tables[0] if all(key in table for table in tables)]
        return {key: float(np.mean([table[key] for table in tables])) for key in shared}

    def to_json(self) -> dict[str, Any]:
        """Everything but the signals and the geometry, as JSON values."""
        names = [f.name for f in fields(Run) if f.name != "data"]
        runs = [{name: getattr(run, name) for name in names} | {"wind": asdict(run.wind)} for run in self.runs]
        return {
            "turbine": self.turbine,
            "settings": self.settings,
            "baseline": self.baseline,
            "limits": self.limits,
            "training": self.training,
            "geometry_label": self.geometry_label,
            "mean": {agent: self.mean_metrics(agent) for agent in self.agents},
            "runs": runs,
        }

    def save(self, folder: str | Path) -> Path:
        """Write ``evaluation.json``, the signals of each run as NetCDF and the geometry.

        Parameters
        ----------
        folder : str or path
            Created if missing.

        Returns
        -------
        pathlib.Path
            The JSON file.
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        table = self.to_json()
        for i, (run, row) in enumerate(zip(self.runs, table["runs"], strict=True)):
            row["signals"] = f"run_{i:02d}_{_file_safe(run.agent)}.nc"
            run.data.to_netcdf(folder / row["signals"], engine="h5netcdf")
        if self.geometry:
            np.savez_compressed(folder / _GEOMETRY_NAME, **self.geometry)
        path = folder / _JSON_NAME
        path.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
        return path

    @classmethod
    def load(cls, folder: str | Path) -> Evaluation:
        """Read what `save` wrote.

        Raises
        ------
        FileNotFoundError
            If the folder holds no evaluation.
        """
        folder = Path(folder)
        table = json.loads((folder / _JSON_NAME).read_text(encoding="utf-8"))
        runs = []
        for row in table["runs"]:
            signals = xr.load_dataset(folder / row.pop("signals"), engine="h5netcdf")
            runs.append(Run(**row | {"wind": Wind(**row["wind"]), "data": signals}))
        geometry = {}
        if (folder / _GEOMETRY_NAME).exists():
            with np.load(folder / _GEOMETRY_NAME) as arrays:
                geometry = {name: arrays[name] for name in arrays.files}
        del table["mean"]
        return cls(**table | {"runs": runs, "geometry": geometry})


def _file_safe(name: str) -> str:
    """Name with everything but letters, digits and dashes replaced."""
    return "".join(c if c.isalnum() or c == "-" else "_" for c in name).lower()
