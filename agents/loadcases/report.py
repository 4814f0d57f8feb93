"""Load cases as tables in text and as one HTML page that opens without a network."""

from __future__ import annotations

import json
from dataclasses import dataclass
from datetime import datetime
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from wt_gym.agents.loadcases.cases import CASES, DEFLECTION_FACTOR, EXTRAPOLATION, SKIP
from wt_gym.agents.loadcases.results import CLEARANCE, PARKED, SPEED
from wt_gym.analysis.metrics import METRICS
from wt_gym.analysis.paired import LIFETIME_EXPONENTS
from wt_gym.analysis.plots import agent_styles, style, titles_at_left
from wt_gym.analysis.report_page import SHELL, figure_element, section, write_page
from wt_gym.analysis.summary import format_value

if TYPE_CHECKING:
    from wt_gym.agents.loadcases.results import CaseRun, LoadCaseResults, Value

__all__ = ["load_case_tables", "write_load_case_report"]


@dataclass(frozen=True)
class _Shown:
    """How a quantity is shown."""

    label: str
    short: str
    unit: str
    factor: float
    digits: int

    def text(self, value: float) -> str:
        """Value without its unit."""
        return f"{value * self.factor:.{self.digits}f}".replace("-", "\u2212")


_EXTREMES = {
    "blade_flap_max": _Shown("Blade root flapwise moment", "flap", "MN m", 1e-6, 1),
    "blade_edge_max": _Shown("Blade root edgewise moment", "edge", "MN m", 1e-6, 1),
    "tower_base_max": _Shown("Tower base bending moment", "tower base", "MN m", 1e-6, 0),
    CLEARANCE: _Shown("Tip clearance", "clearance", "m", 1.0, 1),
    SPEED: _Shown("Rotor speed", "speed", "rpm", 30 / np.pi, 1),
}
_TRACES = {
    "wind_x": _Shown("Wind at the hub", "", "m/s", 1.0, 1),
    "rotor_speed": _EXTREMES[SPEED],
    "generator_power": _Shown("Electrical power", "", "MW", 1e-6, 2),
    "pitch_1": _Shown("Pitch of blade 1", "", "deg", 180 / np.pi, 1),
    "root_flap_moment_1": _Shown("Flapwise moment of blade 1", "", "MN m", 1e-6, 1),
    "tower_base_fore_aft_moment": _Shown("Tower base fore-aft moment", "", "MN m", 1e-6, 0),
}
_ENDINGS = {
    "overspeed": "overspeed", "standstill": "standstill", "tower_strike": "tower strike",
    "failure": "simulation failed",
}  # fmt: skip
_BEYOND = "\u2020"
_NONE = "\u2013"


def load_case_tables(results: LoadCaseResults) -> list[str]:
    """Markdown: design loads by case and agent, and loads over a life.

    Parameters
    ----------
    results : LoadCaseResults

    Returns
    -------
    list of str
        Lines.
    """
    head = [f"{shown.short} [{shown.unit}]" for shown in _EXTREMES.values()]
    lines = [f"| case | agent | came through | {' | '.join(head)} |", "|---" * (3 + len(head)) + "|"]
    for case, agent in results.rows():
        if not CASES[case].fatigue:
            cells = [_cell(results, case, agent, key) for key in _EXTREMES]
            lines.append(f"| {case} | {agent} | {_survival(results, case, agent)} | {' | '.join(cells)} |")
    return lines + _lifetime_lines(results)


def _lifetime_lines(results: LoadCaseResults) -> list[str]:
    """Loads over a life in Markdown, where there are any."""
    if "1.2" not in results.cases or results.climate is None:
        return []
    head = [f"{METRICS[key].label} [{METRICS[key].unit}]" for key in LIFETIME_EXPONENTS]
    lines = ["", f"| lifetime (DLC 1.2) | came through | {' | '.join(head)} |", "|---" * (2 + len(head)) + "|"]
    for agent in results.agents:
        cells = [_lifetime(results, agent, key) for key in LIFETIME_EXPONENTS]
        lines.append(f"| {agent} | {_survival(results, '1.2', agent)} | {' | '.join(cells)} |")
    return lines


def _cell(results: LoadCaseResults, case: str, agent: str, key: str) -> str:
    """Design value; with a dagger where a run ended early."""
    value = results.value(case, agent, key)
    if value is None:
        return _NONE
    passed, planned = results.survived(case, agent)
    return _EXTREMES[key].text(value.design) + ("" if passed == planned else f" {_BEYOND}")


def _survival(results: LoadCaseResults, case: str, agent: str) -> str:
    """How many runs came through, and what became of the others."""
    passed, planned = results.survived(case, agent)
    failures = [f"{len(runs)} {_ENDINGS[end]}" for end, runs in results.failures(case, agent).items()]
    return f"{passed} of {planned}" + (f" ({', '.join(failures)})" if failures else "")


def _lifetime(results: LoadCaseResults, agent: str, key: str) -> str:
    """Load over a life with its change against the first agent."""
    value, base = results.lifetime(agent, key), results.lifetime(results.agents[0], key)
    if value is None:
        return _NONE
    change = "" if agent == results.agents[0] or not base else f" ({100 * (value / base - 1):+.1f} %)"
    return format_value(key, value) + change.replace("-", "\u2212")


def write_load_case_report(results: LoadCaseResults, path: str | Path, title: str | None = None) -> Path:
    """Write the page.

    Parameters
    ----------
    results : LoadCaseResults
    path : str or path
        HTML file; its folder is created if missing.
    title : str, optional

    Returns
    -------
    pathlib.Path
    """
    parts = {
        "title": escape(title or f"{results.turbine}: design load cases"),
        "headline": escape(_headline(results)),
        "facts": _facts(results),
        "body": _body(results),
        "replayjs": "",
    }
    return write_page(path, SHELL, parts)


def _headline(results: LoadCaseResults) -> str:
    """Who came through."""
    words = []
    for agent in results.agents:
        lost = [c for c, a in results.rows() if a == agent and len(set(results.survived(c, a))) > 1]
        words.append(
            f"{agent} " + (f"does not come through DLC {', '.join(lost)}" if lost else "comes through all cases")
        )
    return "; ".join(words) + "."


def _facts(results: LoadCaseResults) -> str:
    """Line of facts below the title."""
    settings = results.settings
    n_runs = len({id(run.result) for runs in results.runs.values() for run in runs})
    facts = [
        results.turbine, f"fidelity \u201c{settings['fidelity']}\u201d", f"{n_runs} runs",
        "quick set" if settings["quick"] else "full set", datetime.now().strftime("%d %B %Y"),
    ]  # fmt: skip
    return "".join(f"<li>{escape(fact)}</li>" for fact in facts)


def _body(results: LoadCaseResults) -> str:
    """Sections of the page."""
    caption = (
        "Design values: characteristic ones, in small print, times the partial safety factor of the case. \u2020: a run"
        " ended early, so that its extremes are those until then."
    )
    table = f"<div class='scroll'>{_table(results)}</div>"
    parts = [section("table", "Extreme loads", caption, table)]
    parts.append(section("loads", "Design loads side by side", "", figure_element("loads-figure", _loads(results))))
    parts.append(_lifetime_section(results))
    parts.append(_failed_section(results))
    parts.append(_transient_section(results))
    parts.append(section("method", "How to read the numbers", "", _method(results)))
    return "".join(parts)


def _table(results: LoadCaseResults) -> str:
    """Extremes of all cases and agents."""
    styles = agent_styles(results)
    head = "".join(f"<th scope='col'>{shown.label} <small>[{shown.unit}]</small></th>" for shown in _EXTREMES.values())
    rows = []
    for case, agent in results.rows():
        kind = CASES[case]
        if kind.fatigue:
            continue
        passed, planned = results.survived(case, agent)
        badge = "better" if passed == planned else "lost"
        color = "" if agent == PARKED else f"<i style='background:{styles[agent]['color']}'></i>"
        cells = "".join(_html_cell(results, case, agent, key) for key in _EXTREMES)
        rows.append(
            f"<tr><th scope='row'><b>{case}</b> {escape(kind.title)} <small>\u03b3 {kind.factor:g}</small></th>"
            f"<th scope='row'>{color}{escape(agent)}</th>"
            f"<td><span class='badge {badge}'>{escape(_survival(results, case, agent))}</span></td>{cells}</tr>"
        )
    return (
        f"<table class='verdicts'><thead><tr><th scope='col'>Case</th><th scope='col'>Agent</th>"
        f"<th scope='col'>Came through</th>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"
    )


def _html_cell(results: LoadCaseResults, case: str, agent: str, key: str) -> str:
    """Design value, below it the characteristic one and where it comes from."""
    value: Value | None = results.value(case, agent, key)
    if value is None:
        return f"<td>{_NONE}</td>"
    note = f"{_EXTREMES[key].text(value.characteristic)}: {escape(value.where)}"
    return f"<td>{escape(_cell(results, case, agent, key))}<small style='display:block'>{note}</small></td>"


def _loads(results: LoadCaseResults) -> go.Figure:
    """Bars of the design values, a row a quantity."""
    titles = [f"{shown.label} [{shown.unit}]" for shown in _EXTREMES.values()]
    figure = make_subplots(len(_EXTREMES), 1, shared_xaxes=True, vertical_spacing=0.05, subplot_titles=titles)
    styles = agent_styles(results) | {PARKED: {"color": "#5f6b76"}}
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


def _lifetime_section(results: LoadCaseResults) -> str:
    """Loads over a life."""
    if "1.2" not in results.cases or results.climate is None:
        return ""
    climate, styles = results.climate, agent_styles(results)
    head = "".join(
        f"<th scope='col'>{METRICS[key].label} <small>[{METRICS[key].unit}]</small></th>" for key in LIFETIME_EXPONENTS
    )
    rows = "".join(
        f"<tr><th scope='row'><i style='background:{styles[agent]['color']}'></i>{escape(agent)}</th>"
        + "".join(f"<td>{escape(_lifetime(results, agent, key))}</td>" for key in LIFETIME_EXPONENTS)
        + "</tr>"
        for agent in results.agents
    )
    caption = (
        "DLC 1.2: the load at 1 Hz throughout that does the damage of production in normal turbulence, \u03b3 1."
        f" Weibull distribution of the mean wind speed: {climate.mean_speed:g} m/s on average, exponent"
        f" {climate.shape:g}, between {climate.cut_in:g} and {climate.cut_out:g} m/s. Starts, stops, idling and faults"
        " are not in it."
    )
    table = (
        f"<div class='scroll'><table class='verdicts'><thead><tr><th scope='col'>Agent</th>{head}</tr></thead>"
        f"<tbody>{rows}</tbody></table></div>"
    )
    return section("lifetime", "Fatigue over a life", escape(caption), table)


def _failed_section(results: LoadCaseResults) -> str:
    """Which runs did not go as planned."""
    items = []
    for case, agent in results.rows():
        for end, runs in results.failures(case, agent).items():
            items += [f"<li>{escape(_failed(case, agent, end, run))}</li>" for run in runs]
    caption = "Runs that did not go as planned, with the time at which they ended."
    return section("failed", "What did not come through", caption, f"<ul>{''.join(items)}</ul>") if items else ""


def _failed(case: str, agent: str, end: str, run: CaseRun) -> str:
    """One run that ended early, in words."""
    seed = "" if run.condition.seed is None else f", seed {run.condition.seed}"
    why = "" if run.result["failure"] is None else f": {run.result['failure']}"
    return f"DLC {case}, {agent}, {run.condition.name}{seed}: {_ENDINGS[end]} after {run.result['time']:.1f} s{why}"


def _transient_section(results: LoadCaseResults) -> str:
    """Courses of the transients, the first azimuth of each."""
    parts: list[str] = []
    for case in results.cases:
        shown: dict[tuple[Any, ...], dict[str, CaseRun]] = {}
        for agent in results.agents:
            for run in results.runs.get((case, agent), []):
                if run.result["trace"]:
                    shown.setdefault(run.condition.group, {}).setdefault(agent, run)
        for runs in shown.values():
            name = f"trace{len(parts)}"
            heading = f"DLC {case}: {next(iter(runs.values())).condition.name}"
            figure = figure_element(name, _courses(results, runs))
            parts.append(f"<details{'' if parts else ' open'}><summary>{escape(heading)}</summary>{figure}</details>")
    caption = "Courses in transients, from 10 s before them on. All rows share one time axis."
    return section("transients", "Transients", caption, "".join(parts)) if parts else ""


def _courses(results: LoadCaseResults, runs: dict[str, CaseRun]) -> go.Figure:
    """Signals of agents in one transient."""
    titles = [f"{shown.label} [{shown.unit}]" for shown in _TRACES.values()]
    figure = make_subplots(len(_TRACES), 1, shared_xaxes=True, vertical_spacing=0.04, subplot_titles=titles)
    styles = agent_styles(results)
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
    """How the numbers came about."""
    items = [
        "Cases and partial safety factors \u03b3 of IEC 61400-1, edition 3 with amendment 1, tables 2 and 3.",
        "Characteristic values: the mean over the seeds, or over the azimuths of the rotor at the start, of what is"
        " worst in a run; in DLC 2.1 and 2.2 over the worse half of the seeds; then the worst wind speed, sign and"
        " time.",
        f"DLC 1.1 is extrapolated to 50 years by the factor {EXTRAPOLATION:g} of the amendment, which is for blades;"
        " what else is worst in production is a matter of DLC 1.3. It supposes runs of ten minutes.",
        "Clearance: the deflection from the unloaded clearance counts, times \u03b3 and "
        f"{DEFLECTION_FACTOR:g} on the stiffness. A negative value touches the tower.",
        f"The first {SKIP:g} s of every run are left out. Flapwise moment, tower moment, clearance and rotor speed are"
        " those of all structural steps, the edgewise moment of the control steps.",
        "A turbine that stands after a shut-down has come through. Overspeed, a tip that strikes the tower, a rotor"
        " that stops by itself and a simulation that leaves its range have not.",
    ]
    if results.settings["quick"]:
        items.append("This is the quick set: too few seeds and too short runs for a certificate.")
    listed = "".join(f"<li>{escape(item)}</li>" for item in items)
    settings = escape(json.dumps(results.settings, indent=1, default=str))
    return f"<ul>{listed}</ul><details><summary>All settings</summary><pre>{settings}</pre></details>"
