"""The table of a folder of results."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.analysis.statistics import relative_change
from wt_gym.base.errors import BenchmarkError
from wt_gym.benchmark.ceiling import ceiling_line, ceiling_of
from wt_gym.benchmark.reference import reference_of
from wt_gym.benchmark.scoring import score
from wt_gym.benchmark.tasks import load_task, task_names
from wt_gym.runs.definition import digest

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping

    from wt_gym.benchmark.reference import Reference
    from wt_gym.benchmark.tasks import BenchmarkTask

__all__ = ["into_page", "leaderboard", "to_markdown"]

_SHOWN = {
    "captured_power": "power",
    "blade_flap_del": "flap DEL",
    "tower_fore_aft_del": "tower f-a DEL",
    "tower_side_side_del": "tower s-s DEL",
}
"""Metrics whose mean relative change against the baseline is shown."""
_SHOWN_WHERE_SCORED = {"tracking_rms": "tracking error"}
"""The same in tasks that score them."""


def leaderboard(results: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Scores of all agents in all tasks.

    Parameters
    ----------
    results : iterable of dict
        As `wt_gym.benchmark.ResultFolder` gives them.

    Returns
    -------
    dict
        ``tasks``: name to a list of rows, the best first; a row has ``agent``, ``winds`` (runs made), ``score`` (as
        `wt_gym.benchmark.Score`) or ``refused`` (why there is none), ``changes`` against the baseline and
        ``pitch_travel`` over that of the baseline. ``references``: name to the best known agent; ``ceilings``: name to
        ``improvement`` and ``score`` where the wind is known, and a ``line`` on both.
    """
    runs: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for result in results:
        definition = result["definition"]
        entry = digest({key: value for key, value in definition.items() if key != "wind"})
        runs.setdefault((definition["task"], entry), []).append(result)
    unknown = sorted({name for name, _ in runs} - {*task_names()})
    if unknown:
        raise BenchmarkError(f"tasks of results must be among {', '.join(task_names())}, got {', '.join(unknown)}")
    tasks, references, ceilings = {}, {}, {}
    for name in sorted({name for name, _ in runs}):
        task = load_task(name)
        rows = [_row(task, own) for (of, _), own in runs.items() if of == name]
        tasks[name] = sorted(rows, key=lambda row: -row["score"]["score"] if row["score"] else np.inf)
        if task.reference is not None:
            references[name] = {key: task.reference[key] for key in ("best_agent", "best_improvement")}
        if (ceiling := ceiling_of(task)) is not None:
            ceilings[name] = {
                "improvement": ceiling.improvement, "score": ceiling.score, "line": ceiling_line(task, ceiling),
            }  # fmt: skip
    return {"tasks": tasks, "references": references, "ceilings": ceilings}


def _shown(task: BenchmarkTask) -> dict[str, str]:
    """Metrics whose change is shown, and how they are called."""
    scored = {term.metric for term in task.terms}
    return {key: label for key, label in _SHOWN_WHERE_SCORED.items() if key in scored} | _SHOWN


def _row(task: BenchmarkTask, results: list[Mapping[str, Any]]) -> dict[str, Any]:
    """One agent in one task."""
    labels = {digest(wind.definition): wind.label for wind in task.winds}
    labeled = [(labels.get(digest(result["definition"]["wind"])), result) for result in results]
    by_wind = {label: result for label, result in labeled if label is not None}
    row = {
        "agent": results[0]["agent"],
        "winds": f"{len(by_wind)} of {len(task.winds)}",
        "score": None,
        "refused": None,
    }
    try:
        reference = reference_of(task)
        row["score"] = asdict(score(task, by_wind, reference))
        row |= _changes(task, by_wind, reference)
    except BenchmarkError as error:
        row["refused"] = str(error)
    return row


def _changes(task: BenchmarkTask, by_wind: Mapping[str, Mapping[str, Any]], reference: Reference) -> dict[str, Any]:
    """Mean changes over the winds; none where a run ended early."""
    winds = [wind for wind in task.winds if by_wind[wind.label]["metrics"]]
    if len(winds) < len(task.winds):
        return {"changes": {}, "pitch_travel": None}
    weights = [wind.weight for wind in winds]

    def mean(metric: str) -> float:
        pairs = [(by_wind[w.label]["metrics"][metric], reference.baseline[w.label][metric]) for w in winds]
        return float(np.average([relative_change(*pair) for pair in pairs], weights=weights))

    still = any(reference.baseline[wind.label]["pitch_travel"] == 0.0 for wind in winds)
    changes = {metric: mean(metric) for metric in _shown(task)}
    return {"changes": changes, "pitch_travel": None if still else 1.0 + mean("pitch_travel")}


def to_markdown(board: Mapping[str, Any]) -> str:
    """Tables of a `leaderboard`, one a task."""
    lines = []
    for name, rows in board["tasks"].items():
        task, best = load_task(name), board["references"].get(name)
        lines += [f"### {task.id}", ""]
        if best is not None:
            gained = f"{100 * best['best_improvement']:.2f} % over `{task.baseline}`"
            lines += [f"100 is `{best['best_agent']}`, an improvement of {gained}.", ""]
        if name in board["ceilings"]:
            lines += [board["ceilings"][name]["line"], ""]
        shown = _shown(task)
        head = ["agent", "score", "95 % interval", "better in", *shown.values(), "pitch travel", "penalties"]
        lines += ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
        lines += ["| " + " | ".join(_cells(row, shown)) + " |" for row in rows]
        lines += ["", *(f"- {row['agent']}: {row['refused']}" for row in rows if row["refused"])]
        lines += [""] * (lines[-1] != "")
    return "\n".join(lines).rstrip("\n") + "\n"


def into_page(table: str, page: str, part: str = "leaderboard") -> str:
    """Put a table between the lines ``<!-- part -->`` and ``<!-- end of the part -->`` of a page.

    Raises
    ------
    wt_gym.base.errors.BenchmarkError
        If the page has no such lines.
    """
    first, last = f"<!-- {part} -->", f"<!-- end of the {part} -->"
    before, begin, rest = page.partition(first)
    _, end, after = rest.partition(last)
    if not (begin and end):
        raise BenchmarkError(f"the page has no place for a table: it needs the lines {first} and {last}")
    return f"{before}{begin}\n\n{table}\n{end}{after}"


def _cells(row: Mapping[str, Any], shown: Collection[str]) -> list[str]:
    """Cells of a row, with the changes of some metrics."""
    if row["score"] is None:
        return [row["agent"], "–", "–", f"{row['winds']} winds run", *["–"] * len(shown), "–", "–"]
    found, changes = row["score"], row["changes"]
    broken = [reason for wind in found["winds"] for reason in wind["broken"]]
    penalties = ", ".join(f"{reason} × {broken.count(reason)}" for reason in dict.fromkeys(broken))
    travel = row["pitch_travel"]
    return [
        row["agent"],
        f"{found['score']:.1f}",
        f"{found['low']:.1f} … {found['high']:.1f}",
        f"{100 * found['better']:.0f} %",
        *(f"{100 * changes[metric]:+.1f} %" if changes and np.isfinite(changes[metric]) else "–" for metric in shown),
        "–" if travel is None else f"× {travel:.2f}",
        penalties or "none",
    ]
