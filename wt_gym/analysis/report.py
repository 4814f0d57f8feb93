"""A report of an evaluation as one HTML file that opens without a network."""

from __future__ import annotations

import json
from datetime import datetime
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from plotly.offline import get_plotlyjs

from wt_gym.analysis.metrics import METRICS
from wt_gym.analysis.plots import agent_styles, spectra_figure, time_series_figure, training_figure
from wt_gym.analysis.report_page import PAGE
from wt_gym.analysis.scene import scene_figure
from wt_gym.analysis.summary import difference_class, format_difference, format_value, headline, summarise, unseen

if TYPE_CHECKING:
    import plotly.graph_objects as go

    from wt_gym.analysis.results import Evaluation

__all__ = ["write_report"]

_CARDS = ("mean_power", "blade_flap_del", "tower_fore_aft_del", "pitch_duty_cycle", "rotor_speed_max")


def write_report(evaluation: Evaluation, path: str | Path, title: str | None = None) -> Path:
    """Write the report.

    Parameters
    ----------
    evaluation : Evaluation
    path : str or path
        HTML file; its folder is created if missing.
    title : str, optional

    Returns
    -------
    pathlib.Path
        The file, about 5 MB: plotly.js is inside.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    page = PAGE
    for name, text in {
        "title": escape(title or f"{evaluation.turbine}: evaluation of controllers"),
        "headline": escape(headline(evaluation)),
        "facts": _facts(evaluation),
        "summary": "".join(f"<p>{escape(paragraph)}</p>" for paragraph in summarise(evaluation)),
        "cards": _cards(evaluation),
        "table": _table(evaluation),
        "sections": _sections(evaluation),
        "method": _method(evaluation),
        "plotlyjs": get_plotlyjs(),
    }.items():
        page = page.replace(f"<!--{name}-->", text)
    path.write_text(page, encoding="utf-8")
    return path


def _facts(evaluation: Evaluation) -> str:
    """Line of facts below the title."""
    settings = evaluation.settings
    facts = [
        evaluation.turbine,
        f"fidelity \u201c{settings['fidelity']}\u201d" if "fidelity" in settings else None,
        f"control step {settings['control_dt']:g} s" if "control_dt" in settings else None,
        datetime.now().strftime("%d %B %Y"),
    ]
    return "".join(f"<li>{escape(fact)}</li>" for fact in facts if fact)


def _cards(evaluation: Evaluation) -> str:
    """Key figures of each agent."""
    styles, base = agent_styles(evaluation), evaluation.mean_metrics(evaluation.baseline)
    cards = []
    for agent in evaluation.agents:
        mean = evaluation.mean_metrics(agent)
        runs = evaluation.runs_of(agent)
        complete = sum(run.complete for run in runs)
        comparable = complete == len(runs) and all(run.complete for run in evaluation.runs_of(evaluation.baseline))
        rows = [f"<div class='figure'><dt>Winds survived</dt><dd>{complete} of {len(runs)}</dd></div>"]
        for key in _CARDS:
            if key not in mean:
                continue
            note = _difference_tag(key, mean[key], base[key]) if agent != evaluation.baseline and comparable else ""
            mark = "" if complete == len(runs) else " \u2020"
            rows.append(
                f"<div class='figure'><dt>{escape(METRICS[key].label)}</dt>"
                f"<dd>{format_value(key, mean[key])} <small>{METRICS[key].unit}</small>{mark}{note}</dd></div>"
            )
        cards.append(
            f"<article class='card' style='--agent:{styles[agent]['color']}'><h3>{escape(agent)}</h3>"
            f"<dl>{''.join(rows)}</dl></article>"
        )
    return "".join(cards)


def _difference_tag(key: str, value: float, reference: float) -> str:
    """Difference to the baseline, coloured by what it means."""
    kind = difference_class(key, value, reference)
    return f"<span class='diff {kind}'>{format_difference(key, value, reference)}</span>"


def _table(evaluation: Evaluation) -> str:
    """Metrics of all agents in each wind and in the mean."""
    agents, winds, styles = evaluation.agents, evaluation.winds, agent_styles(evaluation)
    groups = ["Mean of the winds", *(wind.label for wind in winds)]
    head = "".join(f"<th colspan='{len(agents)}' scope='colgroup'>{escape(group)}</th>" for group in groups)
    names = "".join(
        f"<th scope='col'{' class=first' if i == 0 else ''}><i style='background:{styles[agent]['color']}'></i>"
        f"{escape(agent)}</th>"
        for _ in groups
        for i, agent in enumerate(agents)
    )
    columns = [{agent: evaluation.mean_metrics(agent) for agent in agents}]
    complete = [{agent: all(run.complete for run in evaluation.runs_of(agent)) for agent in agents}]
    for wind in winds:
        columns.append({agent: evaluation.run(agent, wind).metrics for agent in agents})
        complete.append({agent: evaluation.run(agent, wind).complete for agent in agents})
    rows = []
    for key, metric in METRICS.items():
        cells = "".join(
            _cell(key, column, whole, agent, evaluation.baseline)
            for column, whole in zip(columns, complete, strict=True)
            for agent in agents
        )
        unit = "" if metric.unit == "-" else f" <small>[{metric.unit}]</small>"
        rows.append(f"<tr><th scope='row'>{escape(metric.label)}{unit}</th>{cells}</tr>")
    return (
        f"<table><thead><tr><th rowspan='2' scope='col'>Metric</th>{head}</tr><tr>{names}</tr></thead>"
        f"<tbody>{''.join(rows)}</tbody></table>"
    )


def _cell(key: str, column: dict, whole: dict, agent: str, baseline: str) -> str:
    """One value of the table with its difference to the baseline."""
    first = " class='first'" if agent == baseline else ""
    if key not in column[agent]:
        return f"<td{first}>\u2013</td>"
    value = column[agent][key]
    text = format_value(key, value) + ("" if whole[agent] else " \u2020")
    if agent != baseline and key in column[baseline] and whole[agent] and whole[baseline]:
        text += _difference_tag(key, value, column[baseline][key])
    return f"<td{first}>{text}</td>"


def _sections(evaluation: Evaluation) -> str:
    """Figures with their headings."""
    sections = []
    if evaluation.geometry:
        caption = (
            f"{escape(evaluation.geometry_label)}. Surfaces are the vortex lattices on the blades' camber; lines are"
            " the trailing filaments of the free wake. Drag to turn, scroll to zoom."
        )
        sections.append(_section("scene", "Rotor and wake", caption, scene_figure(evaluation.geometry)))
    for i, wind in enumerate(evaluation.winds):
        text = (
            "All rows share one time axis: zoom into one and the others follow; double-click to return. Dashed"
            " lines are rated values, dotted vertical lines the ends of runs that stopped early."
        )
        figure = time_series_figure(evaluation, wind)
        sections.append(_section(f"time{i}", f"Time series: {escape(wind.label)}", text, figure))
    skip = evaluation.settings.get("skip", 0.0)
    text = (
        "Power spectral density by Welch's method (60 s segments), mean over the winds that an agent completed. Dotted"
        " lines: once and three times the mean rotor frequency of the baseline."
    )
    sections.append(_section("spectra", "Where the loads come from", text, spectra_figure(evaluation, skip)))
    for i, (agent, training) in enumerate(evaluation.training.items()):
        if training.get("curve", {}).get("steps"):
            text = f"{escape(agent)}: each point is a finished training episode."
            sections.append(_section(f"training{i}", "Training", text, training_figure(training)))
    return "".join(sections)


def _section(name: str, heading: str, caption: str, figure: go.Figure) -> str:
    """Section with a figure that the page's script draws."""
    # "</" would end the script element early.
    data = figure.to_json().replace("</", "<\\/")
    height = int(figure.layout.height)
    return (
        f"<section id='{name}'><h2>{heading}</h2><p class='caption'>{caption}</p>"
        f"<div class='plot' style='height:{height}px' data-figure='{name}-data'></div>"
        f"<script type='application/json' id='{name}-data'>{data}</script></section>"
    )


def _method(evaluation: Evaluation) -> str:
    """How the numbers came about."""
    skip = evaluation.settings.get("skip", 0.0)
    items = [
        f"Metrics leave out the first {skip:g} s of every run, in which the wake forms.",
        "Damage-equivalent loads (DEL) are peak-to-peak amplitudes of a 1 Hz load with the same damage: rainflow"
        " cycles by ASTM E1049, Woehler exponent 10 at the blade root (worst blade) and 4 at the tower base.",
        "The pitch duty cycle is the mean pitch rate over the greatest possible one, mean of the blades.",
        "All agents meet the same winds and start in the same state. Differences are relative to"
        f" {evaluation.baseline}; below 1 % they are shown as equal.",
        "\u2020 The run ended early: its figures cover the time until then and are not compared.",
    ]
    if evaluation.training and unseen(evaluation):
        items.append("No training episode used the turbulence seeds of this evaluation.")
    listed = "".join(f"<li>{escape(item)}</li>" for item in items)
    settings = escape(json.dumps(evaluation.settings, indent=1, default=str))
    return f"<ul>{listed}</ul><details><summary>All settings</summary><pre>{settings}</pre></details>"
