"""Parts of all report pages, evaluations, load cases, compared controllers and crosschecks: numbers, tables, style.

A page answers first: a sentence with the result, then a table with its legend above it, then figures. It is one file
that opens without a network, in a light and a dark scheme, and in which tables become cards where they have no room.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from html import escape
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wt_gym.analysis.metrics import COLUMN_HEADS, Metric, metric_of
from wt_gym.analysis.statistics import Estimate, difference
from wt_gym.base.files import write_text_whole

if TYPE_CHECKING:
    import plotly.graph_objects as go

NONE, BEYOND = "\u2013", "\u2020"
"""Marks of a value that is missing, and of runs that ended early."""

# ---- numbers ----


def format_value(key: str | Metric, value: float, unit: bool = False) -> str:
    """Value of a metric [SI] in the unit shown, with that unit on request."""
    metric = metric_of(key)
    text = f"{value * metric.factor:.{metric.digits}f}".replace("-", "\u2212")
    return f"{text} {metric.unit}" if unit and metric.unit != "-" else text


def format_difference(key: str | Metric, value: float, reference: float) -> str:
    """Signed difference of a metric to its reference, in percent where that makes sense, else in the unit shown."""
    amount, relative = difference(key, value, reference)
    return format_estimate(key, Estimate(amount, math.nan, math.nan, relative, 1))


def format_estimate(key: str | Metric, estimate: Estimate) -> str:
    """Change with its interval: ``−18.4 % [−20.1, −16.2]``, ``× 4.4 [4.1, 4.8]``, or in the unit shown.

    No change in any wind is ``=``.
    """
    values = [estimate.value, estimate.low, estimate.high] if estimate.has_interval else [estimate.value]
    if not any(values):
        return "="
    if not estimate.relative:
        shown, unit = [signed(value, metric_of(key).digits) for value in values], metric_of(key).unit
    elif estimate.value >= 1.0:
        shown, unit = [f"{1.0 + value:.1f}" for value in values], "-"
        shown[0] = f"\u00d7 {shown[0]}"
    else:
        shown, unit = [signed(100.0 * value, 1) for value in values], "%"
    interval = f" [{', '.join(shown[1:])}]" if estimate.has_interval else ""
    return f"{shown[0]}{'' if unit == '-' else f' {unit}'}{interval}"


def signed(value: float, digits: int) -> str:
    """Number with its sign, none for what rounds to zero."""
    text = f"{value:+.{digits}f}"
    return (text if float(text) else text[1:]).replace("-", "\u2212")


def difference_class(key: str | Metric, value: float, reference: float) -> str:
    """``"better"``, ``"worse"`` or ``"equal"`` than the reference, or ``"none"`` if neither is good."""
    amount, relative = difference(key, value, reference)
    return Estimate(amount, amount, amount, relative, 1).kind(key)


# ---- tables ----

CHANGES_LEGEND = {
    "better": "better",
    "worse": "worse (both: by 1 % or more, chance excluded)",
    "equal": "shown equal: the whole interval is within \u00b11 %",
    "open": "no difference seen, none excluded",
}
"""Meaning of the marks of changes, by their class."""


@dataclass(frozen=True)
class Row:
    """Row of a table."""

    header: str
    """The first cell."""
    cells: Sequence[str] = ()
    """Empty for a heading over the rows that follow."""
    kind: str = ""
    """Classes: ``"sub"`` for a row that belongs to the one before, which is ``"under"`` then."""


def markdown(head: Sequence[str], rows: Iterable[Row]) -> list[str]:
    """Lines of a table in Markdown, of rows in plain text; a heading stands before each row that follows it."""
    heading: list[str] = []
    lines = [list(head)]
    for row in rows:
        if row.cells:
            lines.append([*heading, row.header, *row.cells])
        else:
            heading = [row.header]
    top, *others = (f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in line)} |" for line in lines)
    return [top, "|---" * len(head) + "|", *others]


def table(head: Sequence[str], rows: Iterable[Row], texts: Sequence[int] = ()) -> str:
    """Table that becomes a card for each row where it has no room.

    Head and rows are HTML; ``texts`` are the columns with text, which is at the left and may be broken.
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


def tag(text: str, kind: str = "", note: str = "", size: str = "") -> str:
    """A change with the mark of its kind and a note below it; ``=`` says enough."""
    classes = " ".join(part for part in ("diff", size, "none" if text == "=" else kind) if part)
    return f"<span class='{classes}'>{text}{f'<small>{note}</small>' if note else ''}</span>"


def change_tag(
    key: str | Metric, change: Estimate | None, size: str = "", name: str = "", missing: str = "not compared"
) -> str:
    """Change against the baseline and below it a name and the interval, colored by what it means."""
    if change is None:
        return tag(missing, "none")
    value, _, interval = format_estimate(key, change).partition(" [")
    note = " ".join(part for part in (escape(name), f"[{interval}" if interval else "") if part)
    return tag(value, change.kind(key), note, size)


def difference_tag(key: str | Metric, value: float, reference: float) -> str:
    """Difference of two extremes or counts, colored by what it means."""
    return tag(format_difference(key, value, reference), difference_class(key, value, reference))


def column_head(key: str) -> str:
    """Head of the column of a metric."""
    return COLUMN_HEADS[key][0].upper() + COLUMN_HEADS[key][1:]


def metric_label(key: str | Metric) -> str:
    """Name of a metric with its unit."""
    metric = metric_of(key)
    return f"{escape(metric.label)}{'' if metric.unit == '-' else f' <small>[{metric.unit}]</small>'}"


def agent_labels(agents: Sequence[str]) -> dict[str, str]:
    """Names of agents with the colors that they have in figures."""
    return {
        agent: f"<i class='agent' style='background:{look['swatch']}'></i>{escape(agent)}"
        for agent, look in agent_styles(agents).items()
    }


def html_list(items: Iterable[str]) -> str:
    """List of sentences, empty where there is none."""
    listed = "".join(f"<li>{escape(item)}</li>" for item in items)
    return f"<ul>{listed}</ul>" if listed else ""


def method_list(path: Path, settings: Mapping[str, Any], *more: str, **values: Any) -> str:
    """Origin and meaning of the numbers: the lines of a text with values in them, further ones, and the settings."""
    lines = path.read_text(encoding="utf-8").format(**values).splitlines()
    return html_list([*lines, *more]) + settings_element(settings)


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


# ---- figures ----

FONT = "Inter, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"
INK, MUTED, GRID = "#1c2733", "#465462", "#dde3ea"
# Okabe & Ito (2008): told apart with every common color vision; the dashes help in print.
_COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
_DASHES = ("solid", "dash", "dot")
_AXIS, _PAPER, BETTER = "#8a96a3", "#ffffff", "#e4f3ec"
_SYMBOLS = ("circle", "diamond", "square", "triangle-up", "x", "star", "triangle-down")
WIND_COLOR = "#5f6b76"
DARK_COLORS = {
    INK: "#e3e9ef", MUTED: "#9fadba", GRID: "#2c3742", _AXIS: "#6d7a87", _PAPER: "#182029", BETTER: "#16352c",
    WIND_COLOR: "#93a1ad",
    **dict(zip(_COLORS, ("#45A5E0", "#F2813A", "#2CC295", "#DD97BD", "#8ACCF2", "#F0B437"), strict=True)),
}  # fmt: skip
"""Colors of figures in a dark scheme; report.css has the same for the page."""


def agent_styles(agents: Sequence[str]) -> dict[str, dict[str, str]]:
    """Color, dash and symbol of each agent, the same in every figure and table, and its swatch in a page."""
    n = len(_COLORS)
    return {
        agent: {
            "color": _COLORS[i % n],
            "swatch": f"var(--agent-{i % n})",
            "dash": _DASHES[i // n % len(_DASHES)],
            "symbol": _SYMBOLS[i % len(_SYMBOLS)],
        }
        for i, agent in enumerate(agents)
    }


def style(figure: go.Figure, height: int) -> go.Figure:
    """Apply fonts, colors and margins common to all figures."""
    figure.update_layout(
        template="plotly_white",
        height=height,
        autosize=True,
        margin={"l": 54, "r": 14, "t": 56, "b": 48},
        font={"family": FONT, "size": 13, "color": INK},
        legend={"orientation": "h", "x": 0, "xanchor": "left", "y": 1, "yanchor": "top", "yref": "container"},
        modebar={"bgcolor": "rgba(0,0,0,0)", "color": _AXIS, "activecolor": INK},
        paper_bgcolor="rgba(0,0,0,0)",
        plot_bgcolor=_PAPER,
        hoverlabel={"font": {"family": FONT, "size": 12, "color": INK}, "bgcolor": _PAPER},
    )  # fmt: skip
    for update in (figure.update_xaxes, figure.update_yaxes):
        update(
            gridcolor=GRID, zeroline=False, linecolor=_AXIS, ticks="outside", tickcolor=_AXIS, automargin=True,
            tickfont={"color": INK, "size": 12}, title_font={"color": INK, "size": 13},
        )  # fmt: skip
    figure.update_annotations(font={"family": FONT, "size": 13, "color": INK})
    return figure


def titles_at_left(figure: go.Figure, count: int | None = None) -> None:
    """Put the titles of subplots, the first annotations, to the left, where a narrow screen has room for them."""
    for annotation in figure.layout.annotations[:count]:
        annotation.update(x=0, xanchor="left", xref="paper", yshift=2)


# ---- the page ----


@dataclass(frozen=True)
class Section:
    """Part of a page."""

    name: str
    """Anchor."""
    heading: str
    content: str
    """HTML; a section without is left out."""
    caption: str = ""
    """Text below the heading."""
    link: str = ""
    """Text of the navigation; by default the heading."""

    def html(self) -> str:
        """The section of the page."""
        caption = f"<p class='caption'>{escape(self.caption)}</p>" if self.caption else ""
        return f"<section id='{self.name}'><h2>{escape(self.heading)}</h2>{caption}{self.content}</section>"


def write_page(
    path: str | Path,
    *,
    title: str,
    result: str,
    facts: Mapping[str, str | None],
    sections: Iterable[Section],
    script: str = "",
) -> Path:
    """Write a page whole, with plotly.js inside where it has figures; return its path.

    Parameters
    ----------
    path : str or path
        HTML file; its folder is created if missing.
    title, result : str
        Subject of the page, and the result in one sentence.
    facts : mapping
        From a name to a value, both text, shown below the result; None is left out.
    script : str
        JavaScript to run before the figures are drawn.
    """
    from plotly.offline import get_plotlyjs  # slow to import, and tables in text do not need it

    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    shown = [part for part in sections if part.content]
    drawn = any("class='plot'" in part.content for part in shown)
    own = resources.files("wt_gym.analysis")
    scripts = [script] + ([get_plotlyjs(), own.joinpath("report.js").read_text(encoding="utf-8")] if drawn else [])
    shell = own.joinpath("page.html").read_text(encoding="utf-8")
    page = shell.format(
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
