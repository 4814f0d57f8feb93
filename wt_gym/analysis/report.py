"""A report of an evaluation as one HTML file that opens without a network."""

from __future__ import annotations

import json
from datetime import datetime
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from wt_gym.analysis.comparison_plots import pareto_figure, verdict_figure
from wt_gym.analysis.learning_plots import learning_figure, trainings
from wt_gym.analysis.lifetime import wind_weights
from wt_gym.analysis.metrics import METRICS, measured_metrics
from wt_gym.analysis.paired import LIFETIME_EXPONENTS, lifetime, lifetime_change, paired_change
from wt_gym.analysis.plots import agent_styles, spectra_figure, time_series_figure
from wt_gym.analysis.replay_section import replay_script, replay_section
from wt_gym.analysis.report_page import PAGE, figure_element, section, write_page
from wt_gym.analysis.statistics import LEAST_PER_STRATUM, N_RESAMPLES
from wt_gym.analysis.summary import (
    JUDGED,
    difference_class,
    format_difference,
    format_estimate,
    format_value,
    headline,
    summarize,
    unseen,
    verdict,
)

if TYPE_CHECKING:
    from wt_gym.analysis.paired import Estimate
    from wt_gym.analysis.results import Evaluation, Wind

__all__ = ["write_report"]

# Time series of so many runs at most, one wind a speed: more would make the page heavy.
_MOST_SERIES = 16


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
        The file, 6 to 10 MB: plotly.js, some time series and the replay are inside.
    """
    parts = {
        "title": escape(title or f"{evaluation.turbine}: evaluation of controllers"),
        "headline": escape(headline(evaluation)),
        "facts": _facts(evaluation),
        "question": escape(_question(evaluation)),
        "verdicts": _verdicts(evaluation),
        "summary": "".join(f"<p>{escape(paragraph)}</p>" for paragraph in summarize(evaluation)),
        "table": _table(evaluation),
        "lifetime": _lifetime(evaluation),
        "sections": _sections(evaluation),
        "method": _method(evaluation),
        "replayjs": replay_script(),
    }
    return write_page(path, PAGE, parts)


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


def _question(evaluation: Evaluation) -> str:
    """What the page answers first."""
    others = [agent for agent in evaluation.agents if agent != evaluation.baseline]
    if not others:
        return f"{evaluation.baseline} alone"
    return f"Is {others[0] if len(others) == 1 else 'any of these'} better than {evaluation.baseline}?"


def _verdicts(evaluation: Evaluation) -> str:
    """The answer: a row an agent, with the changes that decide, and their picture."""
    others = [agent for agent in evaluation.agents if agent != evaluation.baseline]
    if not others:
        return ""
    styles = agent_styles(evaluation)
    head = "".join(f"<th scope='col'>{escape(_SHORT[key])}</th>" for key in JUDGED)
    rows = []
    for agent in others:
        result = verdict(evaluation, agent)
        runs = evaluation.runs_of(agent)
        complete = sum(run.complete for run in runs)
        note = "" if complete == len(runs) else f"<small>{complete} of {len(runs)} winds survived</small>"
        cells = "".join(f"<td>{_estimate_tag(key, paired_change(evaluation, agent, key))}</td>" for key in JUDGED)
        rows.append(
            f"<tr><th scope='row'><i style='background:{styles[agent]['color']}'></i>{escape(agent)}</th>"
            f"<td class='verdict'><span class='badge {result.kind}'>{result.word}</span>{note}</td>{cells}</tr>"
        )
    table = (
        f"<div class='scroll'><table class='verdicts'><thead><tr><th scope='col'>Agent</th><th scope='col'>Verdict</th>"
        f"{head}</tr></thead><tbody>{''.join(rows)}</tbody></table></div>"
    )
    figure = verdict_figure(evaluation)
    return table + ("" if figure is None else figure_element("changes", figure))


_SHORT = {
    "corrected_power": "Power",
    "blade_flap_del": "Flap DEL",
    "tower_fore_aft_del": "Tower fore-aft DEL",
    "tower_side_side_del": "Tower side-side DEL",
    "pitch_travel": "Pitch travel",
}


def _estimate_tag(key: str, change: Estimate | None) -> str:
    """Change against the baseline and below it its interval, colored by what it means."""
    if change is None:
        return "<span class='diff none'>not compared</span>"
    value, _, interval = format_estimate(key, change).partition(" [")
    note = f"<small>[{interval}</small>" if interval else ""
    return f"<span class='diff {change.kind(key)}'>{value}{note}</span>"


def _table(evaluation: Evaluation) -> str:
    """Metrics of all agents over all winds and at each wind speed."""
    agents, styles = evaluation.agents, agent_styles(evaluation)
    groups: dict[str, float | None] = {"All winds": None}
    if len(evaluation.speeds) > 1:
        groups |= {f"{speed:g} m/s": speed for speed in evaluation.speeds}
    head = "".join(f"<th colspan='{len(agents)}' scope='colgroup'>{escape(group)}</th>" for group in groups)
    names = "".join(
        f"<th scope='col'{' class=first' if i == 0 else ''}><i style='background:{styles[agent]['color']}'></i>"
        f"{escape(agent)}</th>"
        for _ in groups
        for i, agent in enumerate(agents)
    )
    rows = [_survival_row(evaluation, groups)]
    for key in measured_metrics(run.metrics for run in evaluation.runs):
        metric = METRICS[key]
        cells = "".join(_cell(evaluation, key, agent, speed) for speed in groups.values() for agent in agents)
        unit = "" if metric.unit == "-" else f" <small>[{metric.unit}]</small>"
        rows.append(f"<tr><th scope='row'>{escape(metric.label)}{unit}</th>{cells}</tr>")
    return (
        f"<table><thead><tr><th rowspan='2' scope='col'>Metric</th>{head}</tr><tr>{names}</tr></thead>"
        f"<tbody>{''.join(rows)}</tbody></table>"
    )


def _survival_row(evaluation: Evaluation, groups: dict[str, float | None]) -> str:
    """How many runs lasted as long as planned."""
    cells = []
    for speed in groups.values():
        for agent in evaluation.agents:
            runs = [run for run in evaluation.runs_of(agent) if speed in (None, run.wind.speed)]
            first = " class='first'" if agent == evaluation.baseline else ""
            cells.append(f"<td{first}>{sum(run.complete for run in runs)} of {len(runs)}</td>")
    return f"<tr><th scope='row'>Winds survived</th>{''.join(cells)}</tr>"


def _cell(evaluation: Evaluation, key: str, agent: str, speed: float | None) -> str:
    """One value of the table with its change against the baseline."""
    baseline = evaluation.baseline
    first = " class='first'" if agent == baseline else ""
    mine, base = evaluation.overall_metrics(agent, speed), evaluation.overall_metrics(baseline, speed)
    if key not in mine:
        return f"<td{first}>\u2013</td>"
    whole = {
        name: all(run.complete for run in evaluation.runs_of(name) if speed in (None, run.wind.speed))
        for name in (agent, baseline)
    }
    text = format_value(key, mine[key]) + ("" if whole[agent] else " \u2020")
    if agent != baseline and key in base and all(whole.values()):
        if METRICS[key].over_winds == "mean":
            text += _estimate_tag(key, paired_change(evaluation, agent, key, speed))
        else:
            kind = difference_class(key, mine[key], base[key])
            text += f"<span class='diff {kind}'>{format_difference(key, mine[key], base[key])}</span>"
    return f"<td{first}>{text}</td>"


def _lifetime(evaluation: Evaluation) -> str:
    """Loads over the life of a wind climate, where there is one and several wind speeds."""
    climate = evaluation.climate
    if climate is None or len(evaluation.speeds) < 2:
        return ""
    styles = agent_styles(evaluation)
    shares = ", ".join(
        f"{speed:g} m/s {100 * weight:.0f} %"
        for speed, weight in zip(evaluation.speeds, wind_weights(climate, evaluation.speeds), strict=True)
    )
    names = "".join(
        f"<th scope='col'><i style='background:{styles[agent]['color']}'></i>{escape(agent)}</th>"
        for agent in evaluation.agents
    )
    rows = []
    for key in LIFETIME_EXPONENTS:
        cells = []
        for agent in evaluation.agents:
            value = lifetime(evaluation, agent, key)
            text = "\u2013" if value is None else format_value(key, value)
            if agent != evaluation.baseline and value is not None:
                text += _estimate_tag(key, lifetime_change(evaluation, agent, key))
            cells.append(f"<td>{text}</td>")
        label = f"{METRICS[key].label} <small>[{METRICS[key].unit}]</small>"
        rows.append(f"<tr><th scope='row'>{label}</th>{''.join(cells)}</tr>")
    caption = (
        f"Damage weighted by a Weibull distribution of the mean wind speed: {climate.mean_speed:g} m/s on average, "
        f"exponent {climate.shape:g}. Every wind between {climate.cut_in:g} and {climate.cut_out:g} m/s counts for the "
        f"nearest evaluated speed: {shares} of the operating time."
    )
    return (
        f"<section id='lifetime'><h2>Fatigue over a life</h2><p class='caption'>{escape(caption)}</p>"
        f"<div class='scroll'><table><thead><tr class='last'><th scope='col'>Load</th>{names}</tr></thead>"
        f"<tbody>{''.join(rows)}</tbody></table></div></section>"
    )


def _sections(evaluation: Evaluation) -> str:
    """Figures with their headings."""
    sections = []
    front = pareto_figure(evaluation)
    if front is not None:
        text = (
            "What a lower load costs in pitch travel: down and to the left is better. Mean duty cycle and paired change"
            " of the flapwise DEL, both with 95 % intervals; the dashed line joins the agents that no other beats in"
            " both."
        )
        sections.append(section("pareto", "Load against pitch travel", text, figure_element("pareto-figure", front)))
    sections.append(replay_section(evaluation))
    for i, agents in enumerate(trainings(evaluation)):
        text = f"{', '.join(agents)}: episodes of the training, with exploration, in its own winds."
        figure = learning_figure(evaluation, agents)
        sections.append(
            section(f"training{i}", "Learning curve", escape(text), figure_element(f"training{i}-figure", figure))
        )
    text = (
        "All rows share one time axis: zoom into one and the others follow; double-click to return. Dashed lines are"
        " rated values, dotted vertical lines the ends of runs that stopped early. One wind of each mean speed is"
        " shown; the folder of the evaluation holds all."
    )
    series = "".join(
        f"<details{'' if i else ' open'}><summary>{escape(wind.label)}</summary>"
        f"{figure_element(f'time{i}', time_series_figure(evaluation, wind))}</details>"
        for i, wind in enumerate(_shown_winds(evaluation))
    )
    sections.append(section("time", "Time series", text, series))
    skip = evaluation.settings.get("skip", 0.0)
    text = (
        "Power spectral density by Welch's method (60 s segments), mean over the winds that an agent completed. Dotted"
        " lines: once and three times the mean rotor frequency of the baseline."
    )
    spectra = figure_element("spectra-figure", spectra_figure(evaluation, skip))
    sections.append(section("spectra", "Where the loads come from", text, spectra))
    return "".join(sections)


def _shown_winds(evaluation: Evaluation) -> list[Wind]:
    """The first wind of each mean speed, of some speeds spread over all of them."""
    first = {wind.speed: wind for wind in reversed(evaluation.winds)}
    speeds = evaluation.speeds
    n = min(4, max(1, _MOST_SERIES // len(evaluation.agents)), len(speeds))
    places = {round(k * (len(speeds) - 1) / max(1, n - 1)) for k in range(n)}
    return [first[speeds[place]] for place in sorted(places)]


def _method(evaluation: Evaluation) -> str:
    """How the numbers came about."""
    skip = evaluation.settings.get("skip", 0.0)
    items = [
        f"Metrics leave out the first {skip:g} s of every run, in which the wake forms.",
        "All agents meet the same winds and start in the same state. A change against"
        f" {evaluation.baseline} is taken wind by wind; shown is the interquartile mean of these changes (for power"
        " and energy the mean, because what one wind costs another must earn), and in"
        f" brackets its 95 % interval: expanded percentiles (Hesterberg 2015) of {N_RESAMPLES} bootstrap"
        f" resamples of the winds, stratified by mean wind speed. There are"
        f" no intervals with less than {LEAST_PER_STRATUM} winds a speed.",
        "\u2713 better and \u2717 worse: a change of more than 1 % whose interval excludes zero; \u2248 its interval"
        " holds zero.",
        "Power is corrected: the mean electrical power plus the kinetic energy that rotor and generator gained over the"
        " time measured, divided by that time.",
        "Damage-equivalent loads (DEL) are peak-to-peak amplitudes of a 1 Hz load with the same damage: rainflow"
        " cycles by ASTM E1049, Woehler exponent 10 at the blade root (worst blade) and 4 at the tower base.",
        "The pitch duty cycle is the mean pitch rate over the greatest possible one, mean of the blades.",
        "Largest and smallest values are those of all structural time steps and all winds, overspeeds are counted over"
        " all winds; their differences are differences of these.",
        "\u2020 A run ended early: its figures cover the time until then and are not compared.",
    ]
    if evaluation.training and unseen(evaluation):
        items.append("No training episode used the turbulence seeds of this evaluation.")
    listed = "".join(f"<li>{escape(item)}</li>" for item in items)
    settings = escape(json.dumps(evaluation.settings, indent=1, default=str))
    return f"<ul>{listed}</ul><details><summary>All settings</summary><pre>{settings}</pre></details>"
