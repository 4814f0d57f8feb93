"""Results of the benchmark on disk: one file a run, named by its task and what defines the run."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from wt_gym.base.errors import BenchmarkError
from wt_gym.runs.definition import digest
from wt_gym.runs.store import RunStore

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

__all__ = ["ResultFolder", "result_key"]


def result_key(definition: dict[str, Any]) -> str:
    """Name of a result: a digest of `wt_gym.benchmark.run_definition`."""
    return digest(definition)


class ResultFolder(RunStore):
    """Folder with one JSON file a run; see `wt_gym.runs.store.RunStore`.

    Parameters
    ----------
    path : str or path
    """

    error = BenchmarkError
    required = frozenset({"definition", "agent", "metrics", "ending"})
    indent = 1

    def __init__(self, path: str | Path):
        super().__init__(path, "benchmark", folder="")

    def name(self, definition: dict[str, Any]) -> str:
        """Name of the file of a run."""
        return f"{definition.get('task')}-{result_key(definition)}.json"

    def has(self, definition: dict[str, Any]) -> bool:
        """Whether the run was made."""
        return self.file(definition).is_file()

    def write(self, result: dict[str, Any]) -> Path:
        """Write a result with its ``definition``.

        Raises
        ------
        ValueError
            If it holds a number that is not finite.
        """
        self.keep(result["definition"], result)
        return self.file(result["definition"])

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """All results, by name of the file.

        Raises
        ------
        wt_gym.base.errors.BenchmarkError
            If a file is damaged, or has another name than its content.
        """
        for path in sorted(self.path.glob("*-*.json")):
            yield self._read(path)
