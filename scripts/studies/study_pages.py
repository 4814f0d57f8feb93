"""Records of the studies, and the tables and pictures that they write for pages."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib as mpl

from wt_gym.base.files import write_text_whole
from wt_gym.base.picture_style import SVG

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))  # the cases of validation are no part of the installed package
DATA, TASK_PAGES, TRAINED = ROOT / "docs" / "data", ROOT / "docs" / "tasks", ROOT / "agents" / "trained"
STEADY = {"start": "steady"}
"""Arguments of an environment that needs no records of the running turbine."""


def markdown(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Table, without a line break at its end."""
    lines = (headings, ["---"] * len(headings), *rows)
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def signed(value: float, digits: int, plus: bool = True) -> str:
    """Number with the minus sign of text; one that rounds to zero has no sign."""
    text = f"{value:+.{digits}f}" if plus else f"{value:.{digits}f}"
    return (text.lstrip("+-") if float(text) == 0.0 else text).replace("-", "−")


def percent(share: float, digits: int, plus: bool = True) -> str:
    """A share in per cent, as `signed`."""
    return f"{signed(100.0 * share, digits, plus)} %"


def filled(page: str, makers: Mapping[str, Callable[[str], str]]) -> str:
    """Text of a page in which blocks ``<!-- KIND: WORDS -->`` … ``<!-- end -->`` hold what the maker of KIND returns.

    Raises
    ------
    ValueError
        If the page has no such block.
    """
    block = re.compile(rf"(<!-- ({'|'.join(makers)})(?:: ([^>]+?))? -->\n).*?(<!-- end -->)", re.DOTALL)
    text, count = block.subn(lambda found: f"{found[1]}{makers[found[2]](found[3])}\n{found[4]}", page)
    if not count:
        raise ValueError(f"the page must have a block <!-- {' or '.join(makers)} --> … <!-- end -->")
    return text


def renew(path: Path, makers: Mapping[str, Callable[[str], str]]) -> None:
    """Write the blocks of a page again, as `filled`."""
    write_text_whole(path, filled(path.read_text(encoding="utf-8"), makers))


def read_json(path: Path) -> Any:
    """Content of a record."""
    return json.loads(path.read_text(encoding="utf-8"))


def with_runs(study: Mapping[str, Any]) -> str:
    """JSON of a study, a line a run: a later one shows in the history which numbers it moved."""
    head = json.dumps({key: value for key, value in study.items() if key != "runs"})
    runs = ",\n  ".join(json.dumps(run, ensure_ascii=False) for run in study["runs"])
    return f'{head[:-1]}, "runs": [\n  {runs}]}}'


def write_entries(path: Path, entries: Mapping[str, Any], text: Callable[[Any], str] = json.dumps) -> None:
    """Write a record of entries, each as a text of JSON that begins a line."""
    lines = ",\n".join(f"{json.dumps(name)}: {text(value)}" for name, value in entries.items())
    write_text_whole(path, f"{{\n{lines}\n}}\n")


def save_svg(figure: Figure, path: Path) -> Path:
    """Write a drawing that is the same at every run."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context({**SVG, "svg.hashsalt": path.stem}):
        figure.savefig(path, metadata={"Date": None})
    return path
