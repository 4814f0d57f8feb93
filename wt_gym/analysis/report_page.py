"""Style and parts of all report pages: evaluations, load cases, compared controllers, crosschecks.

A page answers first: a sentence with the result, then a table with its legend above it, then figures. It is one file
that opens without a network, in a light and a dark scheme, and in which tables become cards where they have no room.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from datetime import datetime
from html import escape
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from plotly.offline import get_plotlyjs

from wt_gym.analysis.plots import DARK_COLORS
from wt_gym.base.files import write_text_whole

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    import plotly.graph_objects as go

__all__ = [
    "CHANGES_LEGEND",
    "Row",
    "Section",
    "agent_label",
    "badge",
    "details",
    "figure_element",
    "legend",
    "settings_element",
    "table",
    "today",
    "write_page",
]

CHANGES_LEGEND = {
    "better": "better",
    "worse": "worse (both: by 1 % or more, chance excluded)",
    "equal": "shown equal: the whole interval is within \u00b11 %",
    "open": "no difference seen, none excluded",
}
"""What the marks of changes mean, by their class."""


@dataclass(frozen=True)
class Section:
    """Part of a page.

    Attributes
    ----------
    name : str
        Anchor.
    heading, link : str
        Text, of the heading and of the navigation.
    content : str
        HTML; a section without is left out.
    caption : str
        Text below the heading.
    """

    name: str
    heading: str
    content: str
    caption: str = ""
    link: str = ""

    def html(self) -> str:
        """The section of the page."""
        caption = f"<p class='caption'>{escape(self.caption)}</p>" if self.caption else ""
        return f"<section id='{self.name}'><h2>{escape(self.heading)}</h2>{caption}{self.content}</section>"


@dataclass(frozen=True)
class Row:
    """Row of a table.

    Attributes
    ----------
    header : str
        HTML of the first cell.
    cells : sequence of str
        HTML of the others; none for a heading over the rows that follow.
    kind : str
        Classes: ``"sub"`` for a row that belongs to the one before, which is ``"under"`` then.
    """

    header: str
    cells: Sequence[str] = ()
    kind: str = ""


def table(head: Sequence[str], rows: Iterable[Row], texts: Sequence[int] = ()) -> str:
    """Table that becomes a card for each row where it has no room.

    Parameters
    ----------
    head : sequence of str
        HTML above the columns, the first above the headers of the rows.
    rows : iterable of Row
    texts : sequence of int
        Columns with text, which is at the left and may be broken.

    Returns
    -------
    str
        HTML.
    """
    top = "".join(f"<th scope='col'{' class=text' if k in texts else ''}>{name}</th>" for k, name in enumerate(head))
    body = "".join(_row(row, head, texts) for row in rows)
    return f"<div class='scroll'><table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>"


def _row(row: Row, head: Sequence[str], texts: Sequence[int]) -> str:
    if not row.cells:
        return f"<tr class='group'><th scope='colgroup' colspan='{len(head)}'>{row.header}</th></tr>"
    cells = "".join(
        f"<td{' class=text' if k in texts else ''}><span class='label' aria-hidden='true'>{name}</span>{cell}</td>"
        if cell
        else "<td></td>"
        for k, (name, cell) in enumerate(zip(head[1:], row.cells, strict=True), start=1)
    )
    kind = f" class='{row.kind}'" if row.kind else ""
    return f"<tr{kind}><th scope='row'>{row.header}</th>{cells}</tr>"


def agent_label(agent: str, look: Mapping[str, str] | None = None) -> str:
    """Name of an agent with the color that it has in figures."""
    color = "" if look is None else f"<i class='agent' style='background:{look['swatch']}'></i>"
    return f"{color}{escape(agent)}"


def badge(kind: str, word: str) -> str:
    """A verdict: ``"better"``, ``"worse"``, ``"trade"``, ``"lost"`` or any other kind, without a color."""
    return f"<span class='badge {kind}'>{escape(word)}</span>"


def legend(marks: Mapping[str, str] = CHANGES_LEGEND, more: Iterable[str] = ()) -> str:
    """Legend above a table: the meaning of its marks, by their class, and more lines of HTML."""
    lines = [f"<span class='{kind}'>{escape(text)}</span>" for kind, text in marks.items()]
    return f"<ul class='legend'>{''.join(f'<li>{line}</li>' for line in (*lines, *more))}</ul>"


def details(summary: str, content: str, opened: bool = False) -> str:
    """A part that can be opened and closed."""
    return f"<details{' open' if opened else ''}><summary>{escape(summary)}</summary>{content}</details>"


def settings_element(settings: Mapping[str, object]) -> str:
    """All settings of a page, in a closed part."""
    return details("All settings", f"<pre>{escape(json.dumps(settings, indent=1, default=str))}</pre>")


def figure_element(name: str, figure: go.Figure) -> str:
    """A figure that the page's script draws."""
    # "</" would end the script element early.
    data = figure.to_json().replace("</", "<\\/")
    height = int(figure.layout.height)
    return (
        f"<div class='plot' style='height:{height}px' data-figure='{name}-data'></div>"
        f"<script type='application/json' id='{name}-data'>{data}</script>"
    )


def today() -> str:
    """Date of a page."""
    return f"{datetime.now():%d %B %Y}".lstrip("0")


_SHELL = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{title}</title>
<link rel="icon" href="data:,">
<style>{style}</style>
</head>
<body>
<header><div class="inner"><h1>{title}</h1><p class="result">{result}</p><dl>{facts}</dl></div></header>
<nav aria-label="Sections">{links}</nav>
<main>
{sections}
</main>
<footer>Made with wt_gym: flexible multibody turbine with unsteady vortex-lattice loads and a free wake.</footer>
<script type="application/json" id="dark-colors">{dark}</script>
{scripts}
</body>
</html>
"""


def write_page(
    path: str | Path,
    *,
    title: str,
    result: str,
    facts: Mapping[str, str | None],
    sections: Iterable[Section],
    script: str = "",
) -> Path:
    """Write a page whole, with plotly.js inside where it has figures.

    Parameters
    ----------
    path : str or path
        HTML file; its folder is created if missing.
    title, result : str
        What the page is about, and what came out, in one sentence.
    facts : mapping
        From a name to a value, both text, shown below the result; None is left out.
    sections : iterable of Section
        In their order.
    script : str
        JavaScript to run before the figures are drawn.

    Returns
    -------
    pathlib.Path
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    shown = [part for part in sections if part.content]
    drawn = any("class='plot'" in part.content for part in shown)
    own = resources.files("wt_gym.analysis")
    scripts = [script] + ([get_plotlyjs(), own.joinpath("report.js").read_text(encoding="utf-8")] if drawn else [])
    page = _SHELL.format(
        title=escape(title),
        result=escape(result),
        style=own.joinpath("report.css").read_text(encoding="utf-8"),
        facts="".join(f"<div><dt>{escape(n)}</dt><dd>{escape(v)}</dd></div>" for n, v in facts.items() if v),
        links="".join(f"<a href='#{part.name}'>{escape(part.link or part.heading)}</a>" for part in shown),
        sections="\n".join(part.html() for part in shown),
        dark=json.dumps(DARK_COLORS),
        scripts="\n".join(f"<script>{text}</script>" for text in scripts if text),
    )
    write_text_whole(path, page)
    return path
