"""The record of the cases' last runs, one file: what was checked, when, and of which sources (version and commit).

Cases that are run again replace their own entries; the others stay, each with the date of its own run.
"""

from __future__ import annotations

import json
import math
import subprocess
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import wt_gym
from wt_gym.base.files import write_text_whole

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from validation.case import Case, CaseResult

__all__ = ["as_dict", "read_record", "source_commit", "update_record"]

ROOT = Path(__file__).resolve().parents[1]


def as_dict(case: Case, result: CaseResult) -> dict[str, Any]:
    """Plain data of one case, for JSON."""
    return {
        "name": case.name,
        "title": case.title,
        "source": case.source,
        "slow": case.slow,
        "passed": result.passed,
        "wall_time_s": result.wall_time if math.isfinite(result.wall_time) else None,
        "notes": result.notes,
        "checks": [check.as_dict() for check in result.checks],
    }


def read_record(path: Path) -> dict[str, dict[str, Any]]:
    """Entries by the names of the cases, in alphabetical order.

    Raises
    ------
    ValueError
        If the file is no record.
    """
    try:
        cases = json.loads(path.read_text(encoding="utf-8"))["cases"]
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{path} is not a record of validation cases: {error!r}") from error
    return {name: cases[name] for name in sorted(cases)}


def source_commit(record: Path | None = None, root: Path = ROOT) -> str | None:
    """Commit of the sources as they are now; to be asked before the cases run, while it is that of the code in memory.

    Parameters
    ----------
    record
        A file whose changes do not count: the record itself, which every case changes.
    root
        Folder of the clone.

    Returns
    -------
    str or None
        Short hash, with a "+" if the tree has changes; None without git, or where the folder is no clone of its own.
    """
    if not (root / ".git").exists():  # the clone of somebody else may lie around it
        return None
    left_out = []
    if record is not None and record.resolve().is_relative_to(root.resolve()):  # git knows no place outside
        left_out.append(f":(exclude){record.resolve().relative_to(root.resolve()).as_posix()}")
    try:
        commit = _git(root, "rev-parse", "--short", "HEAD")
        return commit + "+" * bool(_git(root, "status", "--porcelain", "--", ".", *left_out))
    except (OSError, subprocess.CalledProcessError):
        return None


def _git(root: Path, *arguments: str) -> str:
    done = subprocess.run(["git", *arguments], cwd=root, capture_output=True, text=True, check=True)
    return done.stdout.strip()


def update_record(path: Path, results: Iterable[tuple[Case, CaseResult]], commit: str | None = None) -> Path:
    """Put results into a record, which is begun if there is none, with the time (UTC), version and commit.

    Parameters
    ----------
    path
        The record.
    results
        Cases with their results.
    commit
        Of the sources that were run, see `source_commit`.

    Raises
    ------
    ValueError
        If the file is there and is no record.
    """
    cases = read_record(path) if path.exists() else {}
    now = datetime.now(UTC).isoformat(timespec="minutes").removesuffix("+00:00") + "Z"
    for case, result in results:
        cases[case.name] = {"date": now, "version": wt_gym.__version__, "commit": commit, **as_dict(case, result)}
    path.parent.mkdir(parents=True, exist_ok=True)
    # one check a line: a later run shows in the history which numbers it moved
    text = ",\n".join(f"{json.dumps(name)}: {_entry(cases[name])}" for name in sorted(cases))
    write_text_whole(path, f'{{"cases": {{\n{text}\n}}}}\n')
    return path


def _entry(case: Mapping[str, Any]) -> str:
    head = json.dumps({key: value for key, value in case.items() if key != "checks"}, ensure_ascii=False)
    checks = ",\n  ".join(json.dumps(check, ensure_ascii=False) for check in case["checks"])
    return f'{head[:-1]}, "checks": [\n  {checks}]}}'
