"""A report of an evaluation as one HTML file that opens without a network."""

from __future__ import annotations

import math
from html import escape
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from wt_gym.analysis.comparison_plots import pareto_figure, verdict_figure
from wt_gym.analysis.learning_plots import learning_figure, trainings
from wt_gym.analysis.lifetime import wind_weights
from wt_gym.analysis.metrics import LIMIT_METRICS, METRICS, TRACKING_METRICS, measured_metrics
from wt_gym.analysis.paired import LIFETIME_EXPONENTS, Estimate, lifetime, lifetime_change, paired_change
from wt_gym.analysis.plots import agent_styles, spectra_figure, time_series_figure
from wt_gym.analysis.replay_section import replay_script, replay_section
from wt_gym.analysis.report_page import (
    CHANGES_LEGEND,
    Row,
    Section,
    agent_label,
    badge,
    details,
    figure_element,
    legend,
    settings_element,
    table,
    today,
    write_page,
)
from wt_gym.analysis.results import METRICS_FILE, TABLE_FILE
from wt_gym.analysis.statistics import LEAST_PER_STRATUM, N_RESAMPLES
from wt_gym.analysis.summary import (
    JUDGED,
    difference_class,
    format_difference,
    format_estimate,
    format_value,
    headline,
    result_sentence,
    summarize,
    unseen,
    verdict,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from wt_gym.analysis.results import Evaluation, Run, Wind

__all__ = ["write_report"]

# Time series of so many runs at most, one wind a speed: more would make the page heavy.
_MOST_SERIES = 16
# Wind speeds that are listed one by one in the header.
_MOST_SPEEDS = 6

_SHORT = {
    "corrected_power": "Power",
    "blade_flap_del": "Flap DEL",
    "tower_fore_aft_del": "Fore-aft DEL",
    "tower_side_side_del": "Side-side DEL",
    "pitch_travel": "Pitch travel",
}
_CLEARANCE = "tip_clearance_min"
_GROUPS = {
    "Power and rotor speed": (
        "mean_power", "corrected_power", "energy", "power_std", "rotor_speed_mean", "rotor_speed_std",
        "rotor_speed_max", "overspeed_count", "time_without_power", "time_at_standstill",
    ),
    "Power tracking": TRACKING_METRICS,
    "Limits": LIMIT_METRICS,
    "Blades": ("blade_flap_del", "blade_edge_del", "blade_flap_max", "tip_deflection_max", _CLEARANCE),
    "Tower base": ("tower_fore_aft_del", "tower_side_side_del", "tower_del", "tower_base_max"),
    "Actuators": ("pitch_duty_cycle", "pitch_travel", "yaw_travel", "torque_rate"),
}  # fmt: skip
_REASONS = {
    "time": "complete",
    "overspeed": "overspeed",
    "standstill": "rotor stalled",
    "tower_strike": "tower strike",
    "failure": "simulation failed",
}


def write_report(
    evaluation: Evaluation,
    path: str | Path,
    title: str | None = None,
    files: Sequence[str] | None = None,
    crosscheck: Mapping[str, Any] | None = None,
) -> Path:
    """Write the report.

    Parameters
    ----------
    evaluation : Evaluation
    path : str or path
        HTML file; its folder is created if missing.
    title : str, optional
    files : sequence of str, optional
        Of the runs, as seen from the folder of the page, in the order of ``evaluation.runs``; the page links to them.
    crosscheck : mapping, optional
        Content of a ``crosscheck.json``: agents that have the same name in it get their changes in the other simulator
        beside those of the evaluation.

    Returns
    -------
    pathlib.Path
        The file, 6 to 10 MB: plotly.js, some time series and the replay are inside.

    Raises
    ------
    ValueError
        If there is not one file for each run.
    """
    if files is not None and len(files) != len(evaluation.runs):
        raise ValueError(f"files must be one for each of {len(evaluation.runs)} runs, got {len(files)}")
    words = "".join(f"<p>{escape(paragraph)}</p>" for paragraph in summarize(evaluation))
    return write_page(
        path,
        title=title or f"{evaluation.turbine}: evaluation of controllers",
        result=result_sentence(evaluation),
        facts=_facts(evaluation),
        sections=[
            Section("verdict", _question(evaluation), _verdicts(evaluation, crosscheck), link="Verdict"),
            Section("summary", "In words", words),
            _comparison(evaluation),
            _lifetime(evaluation),
            *_figures(evaluation),
            _runs(evaluation, files),
            Section("method", "How to read the numbers", _method(evaluation), link="Method"),
        ],
        script=replay_script(),
    )


def _facts(evaluation: Evaluation) -> dict[str, str | None]:
    """What stands below the result."""
    settings, kwargs = evaluation.settings, evaluation.settings.get("env_kwargs", {})
    speeds, winds = evaluation.speeds, evaluation.winds
    counts = {sum(wind.speed == speed for wind in winds) for speed in speeds}
    each = f"{counts.pop()} each" if len(counts) == 1 and len(speeds) > 1 else ""
    shown = (
        ", ".join(f"{speed:g}" for speed in speeds)
        if len(speeds) <= _MOST_SPEEDS
        else f"{speeds[0]:g} to {speeds[-1]:g}"
    )
    kind = "turbulent" if any(wind.seed is not None for wind in winds) else None
    held_out = "unseen in training" if evaluation.training and unseen(evaluation) else None
    number = f"{len(winds)} wind{'s' if len(winds) > 1 else ''}{f' ({each})' if each else ''}"
    skip = f", without the first {settings['skip']:g} s" if settings.get("skip") else ""
    iec = [f"IEC class {settings[key]}" if key == "iec_class" else f"turbulence {settings[key]}"
           for key in ("iec_class", "turbulence_class") if settings.get(key)]  # fmt: skip
    simulator = kwargs.get("simulator")
    return {
        "Turbine": evaluation.turbine,
        "Class": ", ".join(iec) or None,
        "Mean wind speed": f"{shown} m/s",
        "Winds": ", ".join(part for part in (number, kind, held_out) if part),
        "Duration": f"{max(run.planned_duration for run in evaluation.runs):g} s each{skip}",
        "Simulation": ", ".join(
            part
            for part in (
                str(simulator.get("name", simulator) if isinstance(simulator, dict) else simulator)
                if simulator
                else None,
                f"fidelity \u201c{settings['fidelity']}\u201d" if "fidelity" in settings else None,
                f"control step {settings['control_dt']:g} s" if "control_dt" in settings else None,
            )
            if part
        ),
        "Date": today(),
    }


def _question(evaluation: Evaluation) -> str:
    """What the page answers first."""
    others = [agent for agent in evaluation.agents if agent != evaluation.baseline]
    if not others:
        return headline(evaluation)
    return f"Is {others[0] if len(others) == 1 else 'any of these'} better than {evaluation.baseline}?"


def _verdicts(evaluation: Evaluation, crosscheck: Mapping[str, Any] | None) -> str:
    """The answer: legend, a row an agent with the changes that decide and the tip clearance, and their picture."""
    others = [agent for agent in evaluation.agents if agent != evaluation.baseline]
    if not others:
        return f"<p>{escape(result_sentence(evaluation))}</p>"
    styles = agent_styles(evaluation)
    base = evaluation.baseline
    rows = [
        Row(
            agent_label(base, styles[base]),
            [
                f"{badge('', 'Reference')}{_survived(evaluation, base)}",
                *(_value(evaluation, base, key) for key in (*JUDGED, _CLEARANCE)),
            ],
        )
    ]
    found = {}
    for agent in others:
        result = verdict(evaluation, agent)
        cells = [_estimate_tag(key, paired_change(evaluation, agent, key), "main") for key in JUDGED]
        there = _elsewhere(evaluation, crosscheck, agent)
        rows.append(
            Row(
                agent_label(agent, styles[agent]),
                [f"{badge(result.kind, result.word)}{_survived(evaluation, agent)}", *cells,
                 _extreme(evaluation, _CLEARANCE, agent)],
                "under" if there else "",
            )
        )  # fmt: skip
        if crosscheck is not None and there is not None:
            found[agent] = there
            rows.append(
                Row(f"in {escape(_simulator(crosscheck))}", ["", *(there.get(key, "") for key in JUDGED), ""], "sub")
            )
    head = ["Agent", "Verdict", *_SHORT.values(), "Tip clearance, smallest"]
    more = [f"changes against <b>{escape(base)}</b> in the same winds, with 95 % intervals"]
    if found and crosscheck is not None:
        more.append(escape(_crosscheck_note(crosscheck, evaluation.speeds[0])))
    figure = verdict_figure(evaluation)
    return (
        legend(more=more)
        + table(head, rows, texts=(1,))
        + ("" if figure is None else figure_element("changes", figure))
    )


def _survived(evaluation: Evaluation, agent: str) -> str:
    """Note on winds that were lost."""
    runs = evaluation.runs_of(agent)
    complete = sum(run.complete for run in runs)
    return "" if complete == len(runs) else f"<small class='note'>{complete} of {len(runs)} winds survived</small>"


def _value(evaluation: Evaluation, agent: str, key: str, speed: float | None = None) -> str:
    """Value of a metric with its unit."""
    values = evaluation.overall_metrics(agent, speed)
    unit = "" if METRICS[key].unit == "-" else f" {METRICS[key].unit}"
    return f"{format_value(key, values[key])}{unit}" if key in values else "\u2013"


def _extreme(evaluation: Evaluation, key: str, agent: str) -> str:
    """Extreme over all winds and its difference to the baseline's."""
    mine, base = (evaluation.overall_metrics(name) for name in (agent, evaluation.baseline))
    if key not in mine:
        return "\u2013"
    text = _value(evaluation, agent, key) + ("" if _whole(evaluation, agent) else " \u2020")
    if key not in base or not (_whole(evaluation, agent) and _whole(evaluation, evaluation.baseline)):
        return text
    kind = difference_class(key, mine[key], base[key])
    return f"<span class='diff main {kind}'>{text}<small>{format_difference(key, mine[key], base[key])}</small></span>"


def _whole(evaluation: Evaluation, agent: str, speed: float | None = None) -> bool:
    """Whether all runs lasted as long as planned."""
    return all(run.complete for run in evaluation.runs_of(agent) if speed in (None, run.wind.speed))


def _simulator(crosscheck: Mapping[str, Any]) -> str:
    """The other simulator of a crosscheck, as it is written."""
    return {"openfast": "OpenFAST"}.get(name := str(crosscheck["simulators"][1]), name)


def _elsewhere(evaluation: Evaluation, crosscheck: Mapping[str, Any] | None, agent: str) -> dict[str, str] | None:
    """Changes of an agent in the other simulator of a crosscheck, over its winds of the same mean speeds.

    None where the crosscheck lacks the agent, has another baseline, or another wind.
    """
    if crosscheck is None or crosscheck["baseline"] != evaluation.baseline or len(evaluation.speeds) > 1:
        return None
    changes = {
        row["metric"]: row["changes"].get(agent, (None, None))[1]
        for row in crosscheck["metrics"]
        if row["wind_speed"] == evaluation.speeds[0]
    }
    cells = {}
    for key in JUDGED:
        change = changes.get("mean_power" if key == "corrected_power" else key)
        if change is not None:
            known: dict[str, Any] = {name: math.nan if value is None else value for name, value in change.items()}
            cells[key] = f"<span class='diff'>{format_estimate(key, Estimate(**known)).partition(' [')[0]}</span>"
    return cells or None


def _crosscheck_note(crosscheck: Mapping[str, Any], speed: float) -> str:
    """Where the numbers of the other simulator come from."""
    settings = crosscheck["settings"][1]
    number = sum(label.startswith(f"{speed:g} m/s") for label in crosscheck["winds"])
    measured = settings["duration"] - settings["skip"]
    return (
        f"in {_simulator(crosscheck)}: the same agent there against {crosscheck['baseline']} there, in {number}"
        f" wind{'s' if number != 1 else ''} of {measured:g} s of the same mean speed (a crosscheck)"
    )


def _estimate_tag(key: str, change: Estimate | None, size: str = "") -> str:
    """Change against the baseline and below it its interval, colored by what it means."""
    if change is None:
        return "<span class='diff none'>not compared</span>"
    value, _, interval = format_estimate(key, change).partition(" [")
    note = f"<small>[{interval}</small>" if interval else ""
    return _change_tag(value, change.kind(key), note, size)


def _change_tag(value: str, kind: str, note: str = "", size: str = "") -> str:
    """A change with the mark of its kind; ``=`` says enough."""
    classes = " ".join(part for part in ("diff", size, "none" if value == "=" else kind) if part)
    return f"<span class='{classes}'>{value}{note}</span>"


def _comparison(evaluation: Evaluation) -> Section:
    """Metrics of all agents over all winds, and at each wind speed."""
    parts = [_table(evaluation, None)]
    if len(evaluation.speeds) > 1:
        parts = [details("All winds", parts[0], opened=True)]
        parts += [details(f"{speed:g} m/s", _table(evaluation, speed)) for speed in evaluation.speeds]
    marks = legend(CHANGES_LEGEND, ["\u2020 a run ended early, not compared", "extremes and events have no interval"])
    caption = f"Every metric, and its change against {evaluation.baseline}."
    return Section("comparison", "All metrics", marks + "".join(parts), caption)


def _table(evaluation: Evaluation, speed: float | None) -> str:
    """Metrics of all agents over all winds, or those of one speed."""
    styles = agent_styles(evaluation)
    rows = [Row("Winds survived", [_survival(evaluation, agent, speed) for agent in evaluation.agents])]
    measured = measured_metrics(run.metrics for run in evaluation.runs)
    for group, keys in _GROUPS.items():
        shown = [key for key in keys if key in measured]
        rows += [Row(group)] if shown else []
        for key in shown:
            metric = METRICS[key]
            unit = "" if metric.unit == "-" else f" <small>[{metric.unit}]</small>"
            cells = [_cell(evaluation, key, agent, speed) for agent in evaluation.agents]
            rows.append(Row(f"{escape(metric.label)}{unit}", cells))
    return table(["Metric", *(agent_label(agent, styles[agent]) for agent in evaluation.agents)], rows)


def _survival(evaluation: Evaluation, agent: str, speed: float | None) -> str:
    """How many runs lasted as long as planned."""
    runs = [run for run in evaluation.runs_of(agent) if speed in (None, run.wind.speed)]
    return f"{sum(run.complete for run in runs)} of {len(runs)}"


def _cell(evaluation: Evaluation, key: str, agent: str, speed: float | None) -> str:
    """One value of the table with its change against the baseline."""
    baseline = evaluation.baseline
    mine, base = evaluation.overall_metrics(agent, speed), evaluation.overall_metrics(baseline, speed)
    if key not in mine:
        return "\u2013"
    whole = {name: _whole(evaluation, name, speed) for name in (agent, baseline)}
    text = format_value(key, mine[key]) + ("" if whole[agent] else " \u2020")
    if agent != baseline and key in base and all(whole.values()):
        if METRICS[key].over_winds == "mean":
            text += _estimate_tag(key, paired_change(evaluation, agent, key, speed))
        else:
            kind = difference_class(key, mine[key], base[key])
            text += _change_tag(format_difference(key, mine[key], base[key]), kind)
    return text


def _lifetime(evaluation: Evaluation) -> Section:
    """Loads over the life of a wind climate, where there is one and several wind speeds."""
    climate = evaluation.climate
    if climate is None or len(evaluation.speeds) < 2:
        return Section("lifetime", "", "")
    styles = agent_styles(evaluation)
    shares = ", ".join(
        f"{speed:g} m/s {100 * weight:.0f} %"
        for speed, weight in zip(evaluation.speeds, wind_weights(climate, evaluation.speeds), strict=True)
    )
    rows = []
    for key in LIFETIME_EXPONENTS:
        cells = []
        for agent in evaluation.agents:
            value = lifetime(evaluation, agent, key)
            text = "\u2013" if value is None else format_value(key, value)
            if agent != evaluation.baseline and value is not None:
                text += _estimate_tag(key, lifetime_change(evaluation, agent, key))
            cells.append(text)
        rows.append(Row(f"{METRICS[key].label} <small>[{METRICS[key].unit}]</small>", cells))
    caption = (
        f"Damage weighted by a Weibull distribution of the mean wind speed: {climate.mean_speed:g} m/s on average, "
        f"exponent {climate.shape:g}. Every wind between {climate.cut_in:g} and {climate.cut_out:g} m/s counts for the "
        f"nearest evaluated speed: {shares} of the operating time."
    )
    content = legend() + table(["Load", *(agent_label(agent, styles[agent]) for agent in evaluation.agents)], rows)
    return Section("lifetime", "Fatigue over a life", content, caption, "Lifetime")


def _figures(evaluation: Evaluation) -> list[Section]:
    """Figures with their headings."""
    sections = []
    front = pareto_figure(evaluation)
    if front is not None:
        text = (
            "What a lower load costs in pitch travel: down and to the left is better. Mean duty cycle and paired change"
            " of the flapwise DEL, both with 95 % intervals; the dashed line joins the agents that no other beats in"
            " both."
        )
        content = figure_element("pareto-figure", front)
        sections.append(Section("pareto", "Load against pitch travel", content, text, "Load and travel"))
    sections.append(replay_section(evaluation))
    for i, agents in enumerate(trainings(evaluation)):
        text = f"{', '.join(agents)}: episodes of the training, with exploration, in its own winds."
        content = figure_element(f"training{i}-figure", learning_figure(evaluation, agents))
        sections.append(Section(f"training{i}", "Learning curve", content, text))
    text = (
        "All rows share one time axis: zoom into one and the others follow; double-click to return. Dashed lines are"
        " rated values, dotted vertical lines the ends of runs that stopped early. One wind of each mean speed is"
        " shown; the files of the runs hold all."
    )
    series = "".join(
        details(wind.label, figure_element(f"time{i}", time_series_figure(evaluation, wind)), opened=i == 0)
        for i, wind in enumerate(_shown_winds(evaluation))
    )
    sections.append(Section("time", "Time series", series, text))
    skip = evaluation.settings.get("skip", 0.0)
    text = (
        "Power spectral density by Welch's method (60 s segments), mean over the winds that an agent completed. Dotted"
        " lines: once and three times the mean rotor frequency of the reference."
    )
    spectra = figure_element("spectra-figure", spectra_figure(evaluation, skip))
    sections.append(Section("spectra", "Where the loads come from", spectra, text, "Spectra"))
    return sections


def _runs(evaluation: Evaluation, files: Sequence[str] | None) -> Section:
    """Every run, how it ended and where its signals are."""
    place = {(run.agent, run.wind): k for k, run in enumerate(evaluation.runs)}
    styles = agent_styles(evaluation)

    def cell(run: Run) -> str:
        text = _REASONS[run.ending] if run.complete else f"{_REASONS[run.ending]} after {run.duration:.0f} s"
        kind = "" if run.complete else " class='worse'"
        named = f"<span{kind}>{escape(text)}</span>"
        return named if files is None else f"<a href='{quote(files[place[run.agent, run.wind]])}'>{named}</a>"

    rows = [
        Row(escape(wind.label), [cell(evaluation.run(agent, wind)) for agent in evaluation.agents])
        for wind in evaluation.winds
    ]
    content = table(["Wind", *(agent_label(agent, styles[agent]) for agent in evaluation.agents)], rows)
    if files is None:
        return Section("runs", "Runs", content, "How each run ended.")
    links = (
        f"<p>Metrics of every run: <a href='{METRICS_FILE}'>{METRICS_FILE}</a>, with settings and trainings:"
        f" <a href='{TABLE_FILE}'>{TABLE_FILE}</a>.</p>"
    )
    caption = "How each run ended, with a link to its signals (NetCDF, with units)."
    return Section("runs", "Runs", content + links, caption)


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
        "\u2713 better and \u2717 worse: a change of 1 % or more whose interval excludes zero. \u2248 shown equal: the"
        " whole interval is within 1 % to either side. \u25cb no difference seen: neither of these, more winds would"
        " tell. Extremes have no interval: their mark is that of the difference alone.",
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
    return f"<ul>{listed}</ul>{settings_element(evaluation.settings)}"
