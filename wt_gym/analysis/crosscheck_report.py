"""The HTML page of a crosscheck, in the style of all reports: both simulators' changes, their agreement, signals."""

from __future__ import annotations

import json
import math
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from wt_gym.analysis.crosscheck import COMPARED, SERIES
from wt_gym.analysis.metrics import METRICS
from wt_gym.analysis.plots import MUTED, agent_styles, style, titles_at_left
from wt_gym.analysis.report_page import (
    Row,
    Section,
    agent_label,
    details,
    figure_element,
    legend,
    settings_element,
    table,
    today,
    write_page,
)
from wt_gym.analysis.results import METRICS_FILE, TABLE_FILE
from wt_gym.analysis.summary import format_estimate, format_value

if TYPE_CHECKING:
    from collections.abc import Mapping

    from wt_gym.analysis.crosscheck import Crosscheck
    from wt_gym.analysis.paired import Estimate

__all__ = ["write_crosscheck_report"]

_SHORT = {
    "blade_flap_del": "Flap DEL",
    "blade_edge_del": "Edge DEL",
    "tower_fore_aft_del": "Fore-aft DEL",
    "tower_side_side_del": "Side-side DEL",
    "pitch_travel": "Pitch travel",
    "mean_power": "Power",
}
_LOADS = ("blade_flap_del", "tower_fore_aft_del", "tower_side_side_del")
_PLOTTED = (*_LOADS, "pitch_travel")
_NONE = "\u2013"


def write_crosscheck_report(
    check: Crosscheck, folder: str | Path, command: str | None = None, figures: Mapping[str, list[str]] | None = None
) -> Path:
    """Write ``report.html``.

    Parameters
    ----------
    check : Crosscheck
    folder : str or Path
        Of the crosscheck; the page links to the evaluations of both simulators where they are in it.
    command : str, optional
        That repeats it.
    figures : mapping, optional
        Agent to image files in the folder, which the page shows.

    Returns
    -------
    Path
    """
    folder = Path(folder)
    evaluation = check.evaluations[0]
    settings = evaluation.settings
    images = "".join(
        details(agent, "".join(f"<img loading='lazy' alt='' src='{quote(file)}'>" for file in files))
        for agent, files in (figures or {}).items()
    )
    repeat = f"<pre>{escape(command)}</pre>" if command else ""
    return write_page(
        folder / "report.html",
        title=f"{evaluation.turbine}: {check.names[0]} and {check.names[1]}",
        result=_result(check),
        facts={
            "Turbine": evaluation.turbine,
            "Winds": "; ".join(wind.label for wind in evaluation.winds),
            "Duration": f"{settings['duration']:g} s a run, without the first {settings['skip']:g} s",
            "Environment": str(settings["env_id"]),
            "Date": today(),
        },
        sections=[
            Section("verdict", "Do both simulators see the same changes?", _changes(check), link="Changes"),
            Section("agreement", "Agreement by load", _agreement(check), _AGREEMENT_CAPTION, "Agreement"),
            Section("signals", "Signals sample by sample", _correlations(check), _CORRELATION_CAPTION, "Signals"),
            Section("pictures", "Signals and spectra", images, "Both simulators on top of each other.", "Pictures"),
            Section("ends", "What ended early", _ends(check), link="Ends"),
            Section("runs", "Runs", _runs(check, folder)),
            Section("method", "Settings", repeat + "".join(settings_element(e.settings) for e in check.evaluations)),
        ],
    )


_AGREEMENT_CAPTION = (
    "Level: the reference in the first simulator over that in the second. Rank correlation: Spearman's, of the changes"
    " of all agents; one puts them into the same order."
)
_CORRELATION_CAPTION = "Correlation of a signal in both simulators, mean over the winds."


def _result(check: Crosscheck) -> str:
    """In how many comparisons of loads both simulators say the same."""
    same, told = 0, 0
    for agent in check.agents:
        for speed in check.speeds:
            for key in _LOADS:
                kinds = [change.kind(key) for change in check.changes(agent, key, speed) if change is not None]
                if len(kinds) == 2 and any(kind in ("better", "worse") for kind in kinds):
                    told += 1
                    same += kinds[0] == kinds[1]
    if not told:
        return f"Neither {check.names[0]} nor {check.names[1]} sees a change of a fatigue load."
    return (
        f"{check.names[0]} and {check.names[1]} agree on what gets better and worse in {same} of {told} changes of"
        f" fatigue loads against {check.baseline}."
    )


def _tag(name: str, key: str, change: Estimate | None) -> str:
    """Change in one simulator."""
    if change is None:
        return f"<span class='diff none'>{_NONE}</span>"
    value, _, interval = format_estimate(key, change).partition(" [")
    note = f"<small>{escape(name)}{f' [{interval}' if interval else ''}</small>"
    kind = "none" if value == "=" else change.kind(key)
    return f"<span class='diff main {kind}'>{value}{note}</span>"


def _changes(check: Crosscheck) -> str:
    """Changes of every agent in both simulators, by wind speed, and their picture."""
    styles, rows = agent_styles(check.evaluations[0]), []
    for speed in check.speeds:
        rows.append(Row(f"{speed:g} m/s"))
        for agent in check.agents:
            cells = [
                "".join(
                    _tag(name, key, change)
                    for name, change in zip(check.names, check.changes(agent, key, speed), strict=True)
                )
                for key in COMPARED
            ]
            rows.append(Row(agent_label(agent, styles[agent]), cells))
    more = [
        f"changes against <b>{escape(check.baseline)}</b> in the same simulator; above {escape(check.names[0])}, below"
        f" {escape(check.names[1])}"
    ]
    found = table(["Agent", *(_SHORT[key] for key in COMPARED)], rows)
    return legend(more=more) + found + figure_element("changes", _figure(check))


def _figure(check: Crosscheck) -> go.Figure:
    """Changes in the second simulator over those in the first, a point for each agent and wind speed."""
    titles = [f"{_SHORT[key]} [{'times' if key == 'pitch_travel' else '%'}]" for key in _PLOTTED]
    figure = make_subplots(rows=len(_PLOTTED), cols=1, subplot_titles=titles, vertical_spacing=0.08)
    styles = agent_styles(check.evaluations[0])
    for row, key in enumerate(_PLOTTED, start=1):
        unchanged, scale = (1.0, 1.0) if key == "pitch_travel" else (0.0, 100.0)
        ends = [unchanged, unchanged]
        for agent in check.agents:
            found = [(speed, check.changes(agent, key, speed)) for speed in check.speeds]
            points = [
                (speed, *(unchanged + scale * change.value for change in pair if change is not None))
                for speed, pair in found
                if all(change is not None and change.relative for change in pair)
            ]
            reached = [*ends, *(value for point in points for value in point[1:])]
            ends = [min(reached), max(reached)]
            look = styles[agent]
            figure.add_scatter(
                x=[p[1] for p in points], y=[p[2] for p in points], mode="markers", name=agent, legendgroup=agent,
                showlegend=row == 1, customdata=[f"{p[0]:g} m/s" for p in points], row=row, col=1,
                marker={"color": look["color"], "symbol": look["symbol"], "size": 10},
                hovertemplate=f"{agent}, %{{customdata}}: %{{x:.1f}}, %{{y:.1f}}<extra></extra>",
            )  # fmt: skip
        figure.add_scatter(
            x=ends, y=ends, mode="lines", line={"color": MUTED, "width": 1, "dash": "dot"}, hoverinfo="skip",
            showlegend=False, row=row, col=1,
        )  # fmt: skip
        figure.update_yaxes(title_text=check.names[1], row=row, col=1)
        figure.update_xaxes(title_text=check.names[0], row=row, col=1)
    titles_at_left(figure)
    return style(figure, 280 * len(_PLOTTED) + 80)


def _number(value: float, digits: int = 2) -> str:
    if math.isnan(value):
        return _NONE
    text = f"{value:.{digits}f}"
    return (text if float(text) else text.lstrip("-")).replace("-", "\u2212")


def _agreement(check: Crosscheck) -> str:
    """Level of the reference and rank correlation of the agents, by wind speed, and the reference's own values."""
    rows = []
    for speed in check.speeds:
        rows.append(Row(f"{speed:g} m/s"))
        levels = [f"{_number(100.0 * check.level(key, speed), 1)} %" for key in COMPARED]
        rows.append(Row("Level", levels))
        rows.append(Row("Rank correlation", [_number(check.rank_correlation(key, speed)) for key in COMPARED]))
    rows.append(Row(f"{escape(check.baseline)}, all winds"))
    for name, evaluation in zip(check.names, check.evaluations, strict=True):
        values = evaluation.overall_metrics(check.baseline)
        cells = [f"{format_value(k, values[k])} {METRICS[k].unit}" if k in values else _NONE for k in COMPARED]
        rows.append(Row(escape(name), cells))
    return table(["", *(_SHORT[key] for key in COMPARED)], rows)


def _correlations(check: Crosscheck) -> str:
    styles = agent_styles(check.evaluations[0])
    rows = [
        Row(agent_label(agent, styles[agent]), [_number(check.sample_correlation(agent, name)) for name in SERIES])
        for agent in (check.baseline, *check.agents)
    ]
    return table(["Agent", *(name.replace("_", " ") for name in SERIES)], rows)


def _ends(check: Crosscheck) -> str:
    items = [
        f"<li>{escape(f'{name}: {run.agent} at {run.wind.name} ended after {run.duration:g} s ({run.ending})')}</li>"
        for name, each in zip(check.names, check.evaluations, strict=True)
        for run in each.runs
        if not run.complete
    ]
    return f"<ul>{''.join(items)}</ul>" if items else ""


def _runs(check: Crosscheck, folder: Path) -> str:
    """Links to both evaluations and the signals of their runs, where these are in the folder."""
    parts = []
    for name, evaluation in zip(check.names, check.evaluations, strict=True):
        kept = folder / name / TABLE_FILE
        if not kept.exists():
            continue
        files = {
            (row["agent"], k): row["file"] for k, row in enumerate(json.loads(kept.read_text(encoding="utf-8"))["runs"])
        }
        place = {(run.agent, run.wind): k for k, run in enumerate(evaluation.runs)}

        def link(agent: str, k: int, name: str = name, files: dict[tuple[str, int], str] = files) -> str:
            return f"<a href='{quote(f'{name}/{files[agent, k]}')}'>signals</a>"

        rows = [
            Row(escape(wind.label), [link(agent, place[agent, wind]) for agent in evaluation.agents])
            for wind in evaluation.winds
        ]
        tables = " and ".join(f"<a href='{quote(f'{name}/{file}')}'>{file}</a>" for file in (METRICS_FILE, TABLE_FILE))
        parts.append(f"<h3>{escape(name)}</h3><p>{tables}</p>" + table(["Wind", *map(escape, evaluation.agents)], rows))
    return "".join(parts)
