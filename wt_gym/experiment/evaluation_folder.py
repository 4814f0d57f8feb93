"""The folder of an evaluation: runs are kept as they come, and a stopped evaluation resumes where it was."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from wt_gym.analysis.results import METRICS_FILE, RUNS_FOLDER, TABLE_FILE, Evaluation, Run, Wind, run_file
from wt_gym.base.canary import differing
from wt_gym.base.files import json_values, write_text_whole
from wt_gym.envs.options import wind_files_of
from wt_gym.experiment.names import fingerprint
from wt_gym.runs.definition import RunDefinition, described, run_digest
from wt_gym.runs.store import SWEEP_FILE, RunStore

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from wt_gym.envs.episode import Agent
    from wt_gym.experiment.evaluation_config import EvaluationConfig

__all__ = ["CONFIGURATION_FILE", "REPORT_FILE", "EvaluationFolder"]

CONFIGURATION_FILE, REPORT_FILE = "configuration.json", "report.html"
# These weigh what the runs gave, and change no run.
_ONLY_WEIGH = ("iec_class", "mean_wind_speed", "weibull_shape")


class EvaluationFolder(RunStore):
    """Runs of one evaluation on disk; a context that holds the folder for this process.

    Parameters
    ----------
    path : str or path
    agents : mapping
        Name to word or path.
    config : EvaluationConfig

    Raises
    ------
    ValueError
        If an agent is an object, which a file cannot identify.
        On entering, if another process evaluates there.
    FileNotFoundError
        If an agent's model does not exist.
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
            **{name: value for name, value in asdict(config).items() if name not in _ONLY_WEIGH},
            "env_kwargs": described(config.env_kwargs, "env_kwargs"),
            "wind_files": wind_files_of(config.env_kwargs),
        }
        # through JSON, so that it can be compared with what a file says
        self._configuration = json_values(configuration)

    def begin(self, fingerprint: dict[str, Any], overwrite: bool) -> None:
        """Make the folder ready: empty for a new evaluation, as it is for one to resume.

        Parameters
        ----------
        fingerprint : dict
            Of `wt_gym.benchmark.benchmark_fingerprint`. A folder keeps the one with which it was begun, so that small
            changes do not add up.
        overwrite : bool
            Start afresh, and remove what any evaluation left there; other files stay.

        Raises
        ------
        ValueError
            If it holds another evaluation that is not to be overwritten.
        OSError
            If it cannot be written.
        """
        self._configuration["fingerprint"] = fingerprint
        if overwrite:
            self._clear()
        elif self._used and (others := self._differences()):
            raise ValueError(
                f"{self.path} holds another evaluation, with other {', '.join(others)}: take another folder, or "
                "overwrite it"
            )
        (self.path / RUNS_FOLDER).mkdir(parents=True, exist_ok=True)
        text = json.dumps(self._configuration, indent=1) + "\n"
        write_text_whole(self.path / CONFIGURATION_FILE, text)

    def definition(self, job: tuple[str, Wind]) -> dict[str, Any]:
        """What decides on the numbers of an agent in a wind that was asked for."""
        (agent, wind), known = job, self._configuration
        return RunDefinition(
            agent={"name": agent, **known["agents"][agent]},
            env_id=known["env_id"],
            env_kwargs=known["env_kwargs"],
            wind=asdict(wind),
            duration=known["duration"],
            skip=known["skip"],
            seed=self._config.seed_in(wind),
            replay=self._config.replay_in(wind),
            wind_files=known["wind_files"],
            fingerprint=known["fingerprint"],
        ).to_json()

    def name(self, definition: dict[str, Any]) -> str:
        """Name of the file of a run."""
        return run_file(run_digest(definition), definition["agent"]["name"])

    def _read(self, file: Path, definition: dict[str, Any] | None = None) -> Run:
        """Read a run; `Run.save` says what stands there, and `begin` has compared the fingerprint of the folder."""
        return Run.load(file)

    def _write(self, file: Path, definition: dict[str, Any], result: Run) -> Run:
        result.save(file)
        return result

    def save_tables(self, evaluation: Evaluation, jobs: Sequence[tuple[str, Wind]]) -> None:
        """Write the tables beside the runs, whose agents and asked winds are given in their order."""
        evaluation.save_tables(self.path, [self.name(self.definition(job)) for job in jobs])

    @property
    def _used(self) -> bool:
        """Whether an evaluation has been here."""
        return any((self.path / name).exists() for name in (CONFIGURATION_FILE, TABLE_FILE))

    def _differences(self) -> list[str]:
        """Parts of the configuration that are not those of the evaluation that is there."""
        file = self.path / CONFIGURATION_FILE
        found: dict[str, Any] = {}
        if file.exists():
            try:
                found = json.loads(file.read_text(encoding="utf-8"))
            except ValueError as error:
                raise ValueError(f"{file} is damaged: {error}") from error
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
