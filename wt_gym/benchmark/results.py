"""Results on disk: one file a run, named by what defines the run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wt_gym.benchmark.tasks import digest
from wt_gym.errors import BenchmarkError
from wt_gym.files import write_text_whole

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["ResultFolder", "result_key"]

_FIELDS = {"definition", "agent", "metrics", "ending"}


def result_key(definition: dict[str, Any]) -> str:
    """Name of a result: a digest of `wt_gym.benchmark.run_definition`."""
    return digest(definition)


class ResultFolder:
    """Folder with one JSON file a run.

    Files are there when they are whole: whoever stops a series finds every finished run again, and none by halves.

    Parameters
    ----------
    path : str or path
    """

    def __init__(self, path: str | Path):
        self.path = Path(path)

    def file(self, definition: dict[str, Any]) -> Path:
        """Where the result of a run stands."""
        return self.path / f"{definition['task']}-{result_key(definition)}.json"

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
        self.path.mkdir(parents=True, exist_ok=True)
        path = self.file(result["definition"])
        write_text_whole(path, json.dumps(result, indent=1, allow_nan=False) + "\n")
        return path

    def read(self, definition: dict[str, Any]) -> dict[str, Any]:
        """Read the result of a run."""
        return _read(self.file(definition))

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """All results, by name of the file.

        Raises
        ------
        wt_gym.errors.BenchmarkError
            If a file is damaged, or has another name than its content.
        """
        for path in sorted(self.path.glob("*-*.json")):
            yield _read(path)


def _read(path: Path) -> dict[str, Any]:
    """Read one result and check it against its name."""
    try:
        result = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise BenchmarkError(f"{path} is damaged: {error}") from error
    if not isinstance(result, dict) or not set(result) >= _FIELDS:
        raise BenchmarkError(f"{path} is not a result of the benchmark: it needs {', '.join(sorted(_FIELDS))}")
    if ResultFolder(path.parent).file(result["definition"]).name != path.name:
        raise BenchmarkError(f"{path} is not what its name says: its definition has been changed")
    return result
