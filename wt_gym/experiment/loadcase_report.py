"""Load cases as tables in text and as one HTML page that opens without a network."""

from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from wt_gym.analysis.metrics import METRICS, Metric, idle_sentence
from wt_gym.analysis.page import (
    BEYOND,
    NONE,
    Row,
    Section,
    agent_labels,
    agent_styles,
    badge,
    details,
    difference_tag,
    figure_element,
    format_difference,
    format_value,
    html_list,
    legend,
    markdown,
    method_list,
    metric_label,
    style,
    table,
    titles_at_left,
    today,
    write_page,
)
from wt_gym.analysis.statistics import LIFETIME_EXPONENTS
from wt_gym.experiment.loadcase_runs import CLEARANCE, PARKED, SPEED, TABLE_FILE, CaseRun, LoadCaseResults, Value
from wt_gym.experiment.loadcases import CASES, DEFLECTION_FACTOR, EXTRAPOLATION, SKIP
from wt_gym.experiment.store import RUNS_FOLDER

_EXTREMES = {
    "blade_flap_max": Metric("Blade root flapwise moment", "MN m", 1e-6, -1, 1),
    "blade_edge_max": Metric("Blade root edgewise moment", "MN m", 1e-6, -1, 1),
    "tower_base_max": Metric("Tower base bending moment", "MN m", 1e-6, -1, 0),
    CLEARANCE: Metric("Tip clearance", "m", 1.0, +1, 1, share=False),
    SPEED: Metric("Rotor speed", "rpm", 30 / np.pi, -1, 1),
}
_SHORT = ("flap", "edge", "tower base", "clearance", "speed")
_TRACES = {
    "wind_x": Metric("Wind at the hub", "m/s", 1.0, 0, 1),
    "rotor_speed": _EXTREMES[SPEED],
    "generator_power": Metric("Electrical power", "MW", 1e-6, 0, 2),
    "pitch_1": Metric("Pitch of blade 1", "deg", 180 / np.pi, 0, 1),
    "root_flap_moment_1": Metric("Flapwise moment of blade 1", "MN m", 1e-6, 0, 1),
    "tower_base_fore_aft_moment": Metric("Tower base fore-aft moment", "MN m", 1e-6, 0, 0),
}
_ENDINGS = {
    "overspeed": "overspeed", "standstill": "standstill", "tower_strike": "tower strike",
    "failure": "simulation failed",
}  # fmt: skip
_HEADS = [metric_label(shown) for shown in _EXTREMES.values()]


def load_case_tables(results: LoadCaseResults) -> list[str]:
    """Lines of Markdown: design loads by case and agent, and loads over a life."""
    heads = [f"{name} [{shown.unit}]" for name, shown in zip(_SHORT, _EXTREMES.values(), strict=True)]
    lines = markdown(["case", "agent", "came through", *heads], _case_rows(results, html=False))
    if lifetimes := _lifetime_rows(results):
        head = [f"{METRICS[key].label} [{METRICS[key].unit}]" for key in LIFETIME_EXPONENTS]
        rows = [Row(agent, [_survival(results, "1.2", agent), *cells]) for agent, cells in lifetimes.items()]
        lines += ["", *markdown(["lifetime (DLC 1.2)", "came through", *head], rows)]
    sentences = []
    for agent in results.agents:
        runs = [run for case in results.cases for run in results.runs.get((case, agent), [])]
        times = ((run.situation.name, run.result.get("idle_time", 0.0)) for run in runs)
        sentences += [line for line in [idle_sentence(agent, times)] if line is not None]
    return lines + (["", *sentences] if sentences else [])


def _case_rows(results: LoadCaseResults, html: bool) -> list[Row]:
    """Extremes of all cases and agents, a block a case."""
    labels, rows = agent_labels(results.agents) if html else {}, []
    for case in (case for case in results.cases if not CASES[case].fatigue):
        kind = CASES[case]
        rows.append(Row(f"DLC {case} {escape(kind.title)} <small>\u03b3 {kind.factor:g}</small>" if html else case))
        for agent in (agent for other, agent in results.rows() if other == case):
            passed, planned = results.survived(case, agent)
            came = _survival(results, case, agent)
            came = badge("better" if passed == planned else "lost", came) if html else came
            cells = [(_html_cell if html else _cell)(results, case, agent, key) for key in _EXTREMES]
            rows.append(Row(labels.get(agent, agent), [came, *cells]))
    return rows


def _lifetime_rows(results: LoadCaseResults) -> dict[str, list[str]]:
    """Loads over a life by agent, where there are any, with their changes against the first agent."""
    if "1.2" not in results.cases or results.climate is None:
        return {}
    rows: dict[str, list[str]] = {}
    for agent in results.agents:
        rows[agent] = []
        for key in LIFETIME_EXPONENTS:
            value, base = results.lifetime(agent, key), results.lifetime(results.agents[0], key)
            change = ""
            if value is not None and base is not None and agent != results.agents[0]:
                change = f" ({format_difference(key, value, base)})"
            rows[agent].append(NONE if value is None else format_value(key, value) + change)
    return rows


def _cell(results: LoadCaseResults, case: str, agent: str, key: str) -> str:
    """Design value; with a dagger where a run ended early."""
    value = results.value(case, agent, key)
    if value is None:
        return NONE
    passed, planned = results.survived(case, agent)
    return format_value(_EXTREMES[key], value.design) + ("" if passed == planned else f" {BEYOND}")


def _survival(results: LoadCaseResults, case: str, agent: str) -> str:
    """Number of runs that came through, and the ends of the others."""
    passed, planned = results.survived(case, agent)
    failures = [f"{len(runs)} {_ENDINGS[end]}" for end, runs in results.failures(case, agent).items()]
    return f"{passed} of {planned}" + (f" ({', '.join(failures)})" if failures else "")


def write_load_case_report(results: LoadCaseResults, path: str | Path, title: str | None = None) -> Path:
    """Write the page, an HTML file; its folder is created if missing."""
    path = Path(path)
    return write_page(
        path,
        title=title or f"{results.turbine}: design load cases",
        result=_result(results),
        facts=_facts(results),
        sections=[
            Section("verdict", "Who comes through, and with which loads?", _verdict(results), link="Verdict"),
            Section(
                "table", "Extreme loads by case",
                table(["Agent", "Came through", *_HEADS], _case_rows(results, html=True), texts=(1,)),
                _TABLE_CAPTION, "By case",
            ),
            Section(
                "loads", "Design loads side by side", figure_element("loads-figure", _loads(results)), link="Loads"
            ),
            _lifetime_section(results),
            Section("failed", "What did not come through", _failed(results), _FAILED_CAPTION, "Failures"),
            Section("transients", "Transients", _transients(results), _TRANSIENTS_CAPTION),
            Section("runs", "Runs", _links(path.parent)),
            Section("method", "How to read the numbers", _method(results), link="Method"),
        ],
    )  # fmt: skip


_TABLE_CAPTION = (
    "Design values: characteristic ones, in small print, times the partial safety factor \u03b3 of the case. \u2020: a"
    " run ended early, so that its extremes are those until then."
)
_FAILED_CAPTION = "Runs that did not go as planned, with the time at which they ended."
_TRANSIENTS_CAPTION = "Courses in transients, from 10 s before them on. All rows share one time axis."


def _lost(results: LoadCaseResults, agent: str) -> list[str]:
    """Cases that an agent does not come through."""
    return [c for c, a in results.rows() if a == agent and len(set(results.survived(c, a))) > 1]


def _result(results: LoadCaseResults) -> str:
    """Who came through; what all have in common is said once."""
    lost = {agent: _lost(results, agent) for agent in results.agents}
    if not any(lost.values()):
        who = results.agents[0] if len(lost) == 1 else "Both agents" if len(lost) == 2 else "All agents"
        return f"{who} come{'s' if len(lost) == 1 else ''} through all {len(results.cases)} load cases."
    common = [case for case in results.cases if len(lost) > 1 and all(case in cases for cases in lost.values())]
    words = [f"No agent comes through DLC {', '.join(common)}"] if common else []
    for agent, cases in lost.items():
        alone = [case for case in cases if case not in common]
        if alone:
            words.append(f"{agent} does not come through DLC {', '.join(alone)}")
        elif not common:
            words.append(f"{agent} comes through all cases")
    return "; ".join(words) + "."


def _facts(results: LoadCaseResults) -> dict[str, str | None]:
    """Facts below the result."""
    settings, climate = results.settings, results.climate
    n_runs = len({id(run.result) for runs in results.runs.values() for run in runs})
    return {
        "Turbine": results.turbine,
        "Cases": f"DLC {', '.join(results.cases)} of IEC 61400-1",
        "Runs": f"{n_runs}, {'quick' if settings['quick'] else 'full'} set",
        "Turbulence": settings.get("turbulence"),
        "Wind climate": None if climate is None else f"{climate.mean_speed:g} m/s on average",
        "Simulation": f"fidelity \u201c{settings['fidelity']}\u201d",
        "Date": today(),
    }


def _verdict(results: LoadCaseResults) -> str:
    """A row an agent: whether it comes through, and its worst design values with the cases that they are of."""
    labels, base = agent_labels(results.agents), results.agents[0]
    rows = []
    for agent in results.agents:
        lost = _lost(results, agent)
        number = sum(results.survived(case, a)[0] for case, a in results.rows() if a == agent)
        planned = sum(results.survived(case, a)[1] for case, a in results.rows() if a == agent)
        word = badge("lost" if lost else "better", f"Lost {planned - number} of {planned} runs" if lost else "Passed")
        cells = [_governing_cell(results, agent, base, key) for key in _EXTREMES]
        rows.append(Row(labels[agent], [word, *cells]))
    head = ["Agent", "Verdict", *_HEADS]
    more = [
        "worst design value of all cases, and the case that it is of",
        f"difference to <b>{escape(base)}</b>",
        f"{BEYOND} without cases in which a run ended early",
    ]
    marks = {
        "better": "better",
        "worse": "worse (both: by 1 % or more)",
        "equal": "within \u00b11 %, or half the last digit of meters",
    }
    return legend(marks if len(results.agents) > 1 else {}, more) + table(head, rows, texts=(1,))


def _governing(results: LoadCaseResults, agent: str, key: str) -> tuple[float, str, bool] | None:
    """Worst design value over the cases that were come through, its case, and whether these were all."""
    sign, whole, found = (-1.0 if key == CLEARANCE else 1.0), True, []
    for case, name in results.rows():
        if name != agent or CASES[case].fatigue:
            continue
        value = results.value(case, agent, key)
        if len(set(results.survived(case, agent))) > 1:
            whole = False
        elif value is not None:
            found.append((sign * value.design, case))
    if not found:
        return None
    worst, case = max(found)
    return sign * worst, case, whole


def _governing_cell(results: LoadCaseResults, agent: str, base: str, key: str) -> str:
    mine, other = _governing(results, agent, key), _governing(results, base, key)
    if mine is None:
        return NONE
    value, case, whole = mine
    text = f"{format_value(_EXTREMES[key], value)}{'' if whole else f' {BEYOND}'}<small class='note'>DLC {case}</small>"
    if agent == base or other is None or not (whole and other[2]):
        return text
    return text + difference_tag(_EXTREMES[key], value, other[0])


def _html_cell(results: LoadCaseResults, case: str, agent: str, key: str) -> str:
    """Design value, below it the characteristic one and where it comes from."""
    value: Value | None = results.value(case, agent, key)
    if value is None:
        return NONE
    note = f"{format_value(_EXTREMES[key], value.characteristic)}: {escape(value.where)}"
    return f"{escape(_cell(results, case, agent, key))}<small class='note where'>{note}</small>"


def _loads(results: LoadCaseResults) -> go.Figure:
    """Bars of the design values, a row a quantity."""
    titles = [f"{shown.label} [{shown.unit}]" for shown in _EXTREMES.values()]
    figure = make_subplots(len(_EXTREMES), 1, shared_xaxes=True, vertical_spacing=0.05, subplot_titles=titles)
    styles = agent_styles(results.agents) | {PARKED: {"color": "#5f6b76"}}
    cases = [case for case in results.cases if not CASES[case].fatigue]
    for row, (key, shown) in enumerate(_EXTREMES.items(), start=1):
        for agent in dict.fromkeys(agent for _, agent in results.rows()):
            values = [results.value(case, agent, key) if (case, agent) in results.runs else None for case in cases]
            figure.add_bar(
                x=[f"DLC {case}" for case in cases], y=[None if v is None else shown.factor * v.design for v in values],
                name=agent, legendgroup=agent, showlegend=row == 1, marker_color=styles[agent]["color"], row=row, col=1,
            )  # fmt: skip
    titles_at_left(figure)
    return style(figure, 190 * len(_EXTREMES) + 80)


def _lifetime_section(results: LoadCaseResults) -> Section:
    """Loads over a life."""
    lifetimes, climate, labels = _lifetime_rows(results), results.climate, agent_labels(results.agents)
    if climate is None or not lifetimes:
        return Section("lifetime", "", "")
    rows = [Row(labels[agent], [escape(cell) for cell in cells]) for agent, cells in lifetimes.items()]
    head = ["Agent", *(metric_label(key) for key in LIFETIME_EXPONENTS)]
    caption = (
        "DLC 1.2: the load at 1 Hz throughout that does the damage of production in normal turbulence, \u03b3 1."
        f" Weibull distribution of the mean wind speed: {climate.mean_speed:g} m/s on average, exponent"
        f" {climate.shape:g}, between {climate.cut_in:g} and {climate.cut_out:g} m/s. Starts, stops, idling and faults"
        " are not in it."
    )
    return Section("lifetime", "Fatigue over a life", table(head, rows), caption, "Lifetime")


def _failed(results: LoadCaseResults) -> str:
    """List of runs that did not go as planned."""
    items = []
    for case, agent in results.rows():
        for end, runs in results.failures(case, agent).items():
            for run in runs:
                seed = "" if run.situation.seed is None else f", seed {run.situation.seed}"
                why = "" if run.result["failure"] is None else f": {run.result['failure']}"
                ended = f"{_ENDINGS[end]} after {run.result['time']:.1f} s{why}"
                items.append(f"DLC {case}, {agent}, {run.situation.name}{seed}: {ended}")
    return html_list(items)


def _transients(results: LoadCaseResults) -> str:
    """Courses of the transients, the first azimuth of each."""
    parts: list[str] = []
    for case in results.cases:
        shown: dict[tuple[Any, ...], dict[str, CaseRun]] = {}
        for agent in results.agents:
            for run in results.runs.get((case, agent), []):
                if run.result["trace"]:
                    shown.setdefault(run.situation.group, {}).setdefault(agent, run)
        for runs in shown.values():
            name = f"trace{len(parts)}"
            heading = f"DLC {case}: {next(iter(runs.values())).situation.name}"
            figure = figure_element(name, _courses(results, runs))
            parts.append(details(heading, figure, opened=not parts))
    return "".join(parts)


def _links(folder: Path) -> str:
    """Files of the runs, where they are beside the page."""
    if not (folder / TABLE_FILE).exists():
        return ""
    return (
        f"<p>All design values and endings: <a href='{TABLE_FILE}'>{TABLE_FILE}</a>. One file for each run, named by"
        f" the hash of what it depends on: <a href='{RUNS_FOLDER}/'>{RUNS_FOLDER}/</a>.</p>"
    )


def _courses(results: LoadCaseResults, runs: dict[str, CaseRun]) -> go.Figure:
    """Signals of agents in one transient."""
    titles = [f"{shown.label} [{shown.unit}]" for shown in _TRACES.values()]
    figure = make_subplots(len(_TRACES), 1, shared_xaxes=True, vertical_spacing=0.04, subplot_titles=titles)
    styles = agent_styles(results.agents)
    for agent, run in runs.items():
        trace, look = run.result["trace"], styles[agent]
        for row, (key, shown) in enumerate(_TRACES.items(), start=1):
            figure.add_scatter(
                x=trace["time"], y=[shown.factor * value for value in trace[key]], mode="lines", name=agent,
                legendgroup=agent, showlegend=row == 1, row=row, col=1,
                line={"color": look["color"], "dash": look["dash"], "width": 1.6},
            )  # fmt: skip
    figure.update_xaxes(title_text="Time [s]", row=len(_TRACES), col=1)
    titles_at_left(figure)
    return style(figure, 140 * len(_TRACES) + 90)


def _method(results: LoadCaseResults) -> str:
    """Origin and meaning of the numbers."""
    quick = ["This is the quick set: too few seeds and too short runs for a certificate."]
    return method_list(
        Path(__file__).with_name("loadcase_method.txt"), results.settings,
        *(quick if results.settings["quick"] else []),
        extrapolation=EXTRAPOLATION, deflection=DEFLECTION_FACTOR, skip=SKIP,
    )  # fmt: skip
