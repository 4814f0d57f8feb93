"""Results on disk: one file a run, found by the digest of what defines the run; and what became of each sweep."""

from __future__ import annotations

import json
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from wt_gym.base.canary import differing
from wt_gym.base.files import write_text_whole
from wt_gym.runs.definition import run_digest
from wt_gym.runs.folder_lock import FolderLock

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from wt_gym.runs.tally import Tally

__all__ = ["RUNS_FOLDER", "SWEEP_FILE", "RunStore"]

RUNS_FOLDER, SWEEP_FILE = "runs", "sweep.json"


class RunStore(FolderLock):
    """Folder of runs; a context that holds it for this process, where others must not write at the same time.

    A file is there when it is whole: after an interrupted series every finished run is there, and none in part.

    Parameters
    ----------
    path : str or path
    work : str
        What is done there, see `FolderLock`.
    folder : str
        Of the files, in the path; "" is the path itself.
    """

    error: type[ValueError] = ValueError
    """What is raised of a file that is damaged."""
    required: frozenset[str] = frozenset({"definition"})
    """What a file must have."""
    indent: int | None = None
    """Of the files; None: one line."""

    def __init__(self, path: str | Path, work: str = "runs", folder: str = RUNS_FOLDER):
        super().__init__(path, work)
        self.subfolders = (folder,) if folder else ()
        self._folder = self.path / folder

    def name(self, definition: dict[str, Any]) -> str:
        """Name of the file of a run."""
        return f"{run_digest(definition)}.json"

    def file(self, definition: dict[str, Any]) -> Path:
        """Where the result of a run stands, or would."""
        return self._folder / self.name(definition)

    def find(self, definition: dict[str, Any]) -> Any | None:
        """Result of a run, None if it has not been made yet.

        Raises
        ------
        ValueError
            If its file is damaged, holds another run than its name says, or was made by a version of the package with
            another behavior.
        """
        return self.read(definition) if self.file(definition).exists() else None

    def read(self, definition: dict[str, Any]) -> Any:
        """Result of a run that has been made.

        Raises
        ------
        FileNotFoundError
            If it has not.
        ValueError
            As `find`.
        """
        return self._read(self.file(definition), definition)

    def keep(self, definition: dict[str, Any], result: Any) -> Any:
        """Write the result of a run; give it as it will be read.

        Raises
        ------
        ValueError
            If it holds a number that is not finite.
        """
        self._folder.mkdir(parents=True, exist_ok=True)
        return self._write(self.file(definition), definition, result)

    def _read(self, file: Path, definition: dict[str, Any] | None = None) -> Any:
        """Read a file, and check it against its name and the behavior of the present version of the package."""
        try:
            found = json.loads(file.read_text(encoding="utf-8"))
        except ValueError as error:
            raise self.error(f"{file} is damaged: {error}; remove it to have the run made again") from error
        if not isinstance(found, dict) or not set(found) >= self.required or not isinstance(found["definition"], dict):
            needed = ", ".join(sorted(self.required))
            raise self.error(f"{file} is damaged, or no result: it must have {needed}; remove it")
        if self.name(found["definition"]) != file.name:
            raise self.error(f"{file} is not what its name says: its definition has been changed; remove it")
        present = {} if definition is None else definition.get("fingerprint", {})
        if present and (parts := differing(found["definition"].get("fingerprint", {}), present)):
            raise self.error(
                f"{file} was made with another {' and '.join(parts)}: take another folder, or remove the file to have "
                "the run made again"
            )
        return found

    def _write(self, file: Path, definition: dict[str, Any], result: Any) -> Any:
        """Write a file; give what will be read."""
        text = json.dumps({"definition": definition, **result}, indent=self.indent, allow_nan=False) + "\n"
        write_text_whole(file, text)
        return json.loads(text)

    @contextmanager
    def session(self, tally: Tally, found: int, label: Callable[[Any], str] = str) -> Iterator[None]:
        """Do jobs, and add a row to ``sweep.json`` however that ends, unless the process is killed.

        A row has ``found`` (jobs whose files were there), ``made``, ``retried`` (jobs begun again because a process or
        a machine was gone) and ``lost`` (labels of those given up).

        Parameters
        ----------
        tally : Tally
            Of the executor; what it counted before does not belong to this sweep.
        found : int
        label : callable
            Gives the name of a job.
        """
        done, retried, lost = tally.done, tally.retried, len(tally.lost)
        try:
            yield
        finally:
            row = {
                "found": found,
                "made": tally.done - done,
                "retried": tally.retried - retried,
                "lost": [label(job) for job in tally.lost[lost:]],
            }
            if self.path.is_dir():
                _append(self.path / SWEEP_FILE, row)


def _append(file: Path, row: dict[str, Any]) -> None:
    """Add a row.

    Raises
    ------
    ValueError
        If the file holds something else.
    """
    rows = []
    if file.exists():
        try:
            rows = json.loads(file.read_text(encoding="utf-8"))
        except ValueError as error:
            raise ValueError(f"{file} is damaged: {error}") from error
        if not isinstance(rows, list):
            raise ValueError(f"{file} is damaged: it must be a list, a row for each time that the sweep was worked on")
    write_text_whole(file, json.dumps([*rows, row], indent=1) + "\n")
