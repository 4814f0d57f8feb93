"""What became of the jobs of a sweep, kept in its folder: a row for each time that somebody worked on it."""

from __future__ import annotations

import json
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from wt_gym.files import write_text_whole

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from typing import Any

    from wt_gym.agents.workers import Tally

__all__ = ["SWEEP_FILE", "sweep_recorded"]

SWEEP_FILE = "sweep.json"


@contextmanager
def sweep_recorded(folder: Path, tally: Tally, found: int, label: Callable[[Any], str] = str) -> Iterator[None]:
    """Do jobs, and add a row to ``sweep.json`` however that ends, unless the process is killed.

    A row has ``found`` (jobs whose files were there), ``made``, ``retried`` (jobs begun again because a process or a
    machine was gone) and ``lost`` (labels of those given up).

    Parameters
    ----------
    folder : pathlib.Path
        Exists when the jobs are done.
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
        if folder.is_dir():
            _append(folder / SWEEP_FILE, row)


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
