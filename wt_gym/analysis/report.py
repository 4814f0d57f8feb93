"""A report of an evaluation as one HTML file that opens without a network."""

import base64
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib import resources
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from numpy.typing import ArrayLike

from wt_gym.analysis import page
from wt_gym.analysis.figures import (
    learning_figure,
    pareto_figure,
    spectra_figure,
    time_series_figure,
    trainings,
    verdict_figure,
)
from wt_gym.analysis.metrics import LIMIT_METRICS, METRICS, PLATFORM_METRICS, TRACKING_METRICS, measured_metrics
from wt_gym.analysis.page import BEYOND, NONE, Row, Section, change_tag, format_value
from wt_gym.analysis.results import METRICS_FILE, TABLE_FILE, Evaluation, Replay, Run, Wind
from wt_gym.analysis.statistics import (
    LEAST_PER_STRATUM,
    LIFETIME_EXPONENTS,
    N_RESAMPLES,
    Estimate,
    lifetime,
    lifetime_change,
    paired_change,
    wind_weights,
)
from wt_gym.analysis.summary import JUDGED, REASONS, headline, result_sentence, summarize, unseen, verdict

# Time series of so many runs at most, one wind a speed: more would make the page heavy.
_MOST_SERIES = 16
# Wind speeds that are listed one by one in the header.
_MOST_SPEEDS = 6
_CLEARANCE, _PLATFORM = "tip_clearance_min", "platform_pitch_std"
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
_GROUPS = {
    "Power and rotor speed": (
        "mean_power", "corrected_power", "energy", "power_std", "rotor_speed_mean", "rotor_speed_std",
        "rotor_speed_max", "overspeed_count", "time_without_power", "time_at_standstill",
    ),
    "Power tracking": TRACKING_METRICS,
    "Platform": PLATFORM_METRICS,
    "Limits": LIMIT_METRICS,
    "Blades": ("blade_flap_del", "blade_edge_del", "blade_flap_max", "tip_deflection_max", _CLEARANCE),
    "Tower base": ("tower_fore_aft_del", "tower_side_side_del", "tower_del", "tower_base_max"),
    "Actuators": ("pitch_duty_cycle", "pitch_travel", "yaw_travel", "torque_rate"),
}  # fmt: skip


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
    path : str or path
        HTML file; its folder is created if missing.
    files : sequence of str, optional
        Of the runs, as seen from the folder of the page, in the order of ``evaluation.runs``; the page links to them.
    crosscheck : mapping, optional
        Content of a ``crosscheck.json``: agents that have the same name in it get their changes in the other simulator
        beside those of the evaluation.

    Returns
    -------
    pathlib.Path
        The file, 6 to 10 MB: plotly.js, some time series and the replay are inside.
    """
    if files is not None and len(files) != len(evaluation.runs):
        raise ValueError(f"files must be one for each of {len(evaluation.runs)} runs, got {len(files)}")
    words = "".join(f"<p>{escape(paragraph)}</p>" for paragraph in summarize(evaluation))
    return page.write_page(
        path,
        title=title or f"{evaluation.turbine}: evaluation of controllers",
        result=result_sentence(evaluation),
        facts=_facts(evaluation),
        sections=[
            _verdicts(evaluation, crosscheck),
            Section("summary", "In words", words),
            _comparison(evaluation),
            _lifetime(evaluation),
            *_figures(evaluation),
            _runs(evaluation, files),
            Section("method", "How to read the numbers", _method(evaluation), link="Method"),
        ],
        script=_shipped("replay.js"),
    )


def _shipped(name: str) -> str:
    """Text of a file beside this module."""
    return resources.files("wt_gym.analysis").joinpath(name).read_text(encoding="utf-8")


def _facts(evaluation: Evaluation) -> dict[str, str | None]:
    """Facts below the result."""
    settings, speeds, winds = evaluation.settings, evaluation.speeds, evaluation.winds
    counts = {sum(wind.speed == speed for wind in winds) for speed in speeds}
    each = f" ({counts.pop()} each)" if len(counts) == 1 and len(speeds) > 1 else ""
    few = len(speeds) <= _MOST_SPEEDS
    shown = ", ".join(f"{speed:g}" for speed in speeds) if few else f"{speeds[0]:g} to {speeds[-1]:g}"
    skip = f", without the first {settings['skip']:g} s" if settings.get("skip") else ""
    simulator = settings.get("env_kwargs", {}).get("simulator")
    name = simulator.get("name", simulator) if isinstance(simulator, dict) else simulator

    def fact(text: str, key: str) -> str:
        return text.format(settings[key]) if settings.get(key) else ""

    parts = {
        "Turbine": [evaluation.turbine],
        "Class": [fact("IEC class {}", "iec_class"), fact("turbulence {}", "turbulence_class")],
        "Mean wind speed": [f"{shown} m/s"],
        "Winds": [
            f"{len(winds)} wind{'s' if len(winds) > 1 else ''}{each}",
            "turbulent" if any(wind.seed is not None for wind in winds) else "",
            "unseen in training" if evaluation.training and unseen(evaluation) else "",
        ],
        "Sea": _spans(run.data.attrs["sea"] for run in evaluation.runs if "sea" in run.data.attrs),
        "Duration": [f"{max(run.planned_duration for run in evaluation.runs):g} s each{skip}"],
        "Simulation": [
            str(name) if simulator else "",
            fact("fidelity \u201c{}\u201d", "fidelity"),
            fact("control step {:g} s", "control_dt"),
        ],
        "Date": [page.today()],
    }
    return {fact: ", ".join(part for part in words if part) for fact, words in parts.items()}


def _spans(texts: Iterable[str]) -> list[str]:
    """Merge texts that differ in their numbers alone into one with the least and the greatest of them."""
    forms: dict[str, list[list[float]]] = {}
    for text in texts:
        forms.setdefault(_NUMBER.sub("{}", text), []).append([float(number) for number in _NUMBER.findall(text)])
    spans = {form: [sorted({min(column), max(column)}) for column in zip(*rows, strict=True)]
             for form, rows in forms.items()}  # fmt: skip
    return [
        form.format(*(" to ".join(f"{end:g}".replace("-", "\u2212") for end in span) for span in spans[form]))
        for form in forms
    ]


def _verdicts(evaluation: Evaluation, crosscheck: Mapping[str, Any] | None) -> Section:
    """The answer: legend, a row an agent with the changes that decide and the tip clearance, and their picture."""
    others, base = evaluation.others, evaluation.baseline
    if not others:
        answer = f"<p>{escape(result_sentence(evaluation))}</p>"
        return Section("verdict", headline(evaluation), answer, link="Verdict")
    rows: list[Row] = []
    note: list[str] = []
    shown = [key for key in (_PLATFORM, _CLEARANCE) if key in measured_metrics(run.metrics for run in evaluation.runs)]
    for agent, label in page.agent_labels(evaluation.agents).items():
        lost = f"<small class='note'>{_survival(evaluation, agent)} winds survived</small>"
        lost = "" if evaluation.survived(agent) else lost
        beside = [_cell(evaluation, key, agent, unit=True) for key in shown]
        if agent == base:
            own = [_cell(evaluation, key, agent, unit=True) for key in JUDGED]
            rows.append(Row(label, [page.badge("", "Reference") + lost, *own, *beside]))
            continue
        result, there = verdict(evaluation, agent), _elsewhere(evaluation, crosscheck, agent)
        cells = [change_tag(key, paired_change(evaluation, agent, key), "main") for key in JUDGED]
        cells = [page.badge(result.kind, result.word) + lost, *cells, *beside]
        rows.append(Row(label, cells, "under" if there else ""))
        if crosscheck is not None and there is not None:
            note = [escape(_crosscheck_note(crosscheck, evaluation.speeds[0]))]
            cells = ["", *(there.get(key, "") for key in (*JUDGED, *shown))]
            rows.append(Row(f"in {escape(_simulator(crosscheck))}", cells, "sub"))
    names = {_CLEARANCE: "Tip clearance, smallest", _PLATFORM: "Platform pitch, std"}
    head = ["Agent", "Verdict", *map(page.column_head, JUDGED), *(names[key] for key in shown)]
    more = [f"changes against <b>{escape(base)}</b> in the same winds, with 95 % intervals", *note]
    figure = verdict_figure(evaluation)
    drawn = "" if figure is None else page.figure_element("changes", figure)
    question = f"Is {others[0] if len(others) == 1 else 'any of these'} better than {base}?"
    content = page.legend(more=more) + page.table(head, rows, texts=(1,)) + drawn
    return Section("verdict", question, content, link="Verdict")


def _simulator(crosscheck: Mapping[str, Any]) -> str:
    """The other simulator of a crosscheck, as it is written."""
    return {"openfast": "OpenFAST"}.get(name := str(crosscheck["simulators"][1]), name)


def _elsewhere(evaluation: Evaluation, crosscheck: Mapping[str, Any] | None, agent: str) -> dict[str, str] | None:
    """Changes of an agent in the other simulator, None where the crosscheck lacks the agent, baseline or wind."""
    if crosscheck is None or crosscheck["baseline"] != evaluation.baseline or len(evaluation.speeds) > 1:
        return None
    changes = {
        row["metric"]: row["changes"].get(agent, (None, None))[1]
        for row in crosscheck["metrics"]
        if row["wind_speed"] == evaluation.speeds[0]
    }
    cells = {}
    for key in (*JUDGED, _PLATFORM):
        change = changes.get("mean_power" if key == "corrected_power" else key)
        if change is not None:
            value = page.format_estimate(key, Estimate.from_json(change)).partition(" [")[0]
            cells[key] = f"<span class='diff'>{value}</span>"
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


def _comparison(evaluation: Evaluation) -> Section:
    """Metrics of all agents over all winds, and at each wind speed."""
    parts = [_table(evaluation, None)]
    if len(evaluation.speeds) > 1:
        parts = [page.details("All winds", parts[0], opened=True)]
        parts += [page.details(f"{speed:g} m/s", _table(evaluation, speed)) for speed in evaluation.speeds]
    marks = page.legend(more=["\u2020 a run ended early, not compared", "extremes and events have no interval"])
    caption = f"Every metric, and its change against {evaluation.baseline}."
    return Section("comparison", "All metrics", marks + "".join(parts), caption)


def _table(evaluation: Evaluation, speed: float | None) -> str:
    """Metrics of all agents over all winds, or those of one speed."""
    labels = page.agent_labels(evaluation.agents)
    rows = [Row("Winds survived", [_survival(evaluation, agent, speed) for agent in evaluation.agents])]
    measured = measured_metrics(run.metrics for run in evaluation.runs)
    for group, keys in _GROUPS.items():
        shown = [key for key in keys if key in measured]
        rows += [Row(group)] if shown else []
        for key in shown:
            cells = [_cell(evaluation, key, agent, speed) for agent in evaluation.agents]
            rows.append(Row(page.metric_label(key), cells))
    return page.table(["Metric", *labels.values()], rows)


def _survival(evaluation: Evaluation, agent: str, speed: float | None = None) -> str:
    runs = evaluation.runs_of(agent, speed)
    return f"{sum(run.complete for run in runs)} of {len(runs)}"


def _cell(evaluation: Evaluation, key: str, agent: str, speed: float | None = None, unit: bool = False) -> str:
    """Value of a metric and its change against the baseline."""
    baseline = evaluation.baseline
    mine, base = evaluation.overall_metrics(agent, speed), evaluation.overall_metrics(baseline, speed)
    if key not in mine:
        return NONE
    whole = {name: evaluation.survived(name, speed) for name in (agent, baseline)}
    text = format_value(key, mine[key], unit) + ("" if whole[agent] else f" {BEYOND}")
    if agent != baseline and key in base and all(whole.values()):
        if METRICS[key].over_winds == "mean":
            text += change_tag(key, paired_change(evaluation, agent, key, speed))
        else:
            text += page.difference_tag(key, mine[key], base[key])
    return text


def _lifetime(evaluation: Evaluation) -> Section:
    """Loads over the life of a wind climate, where there is one and several wind speeds."""
    climate = evaluation.climate
    if climate is None or len(evaluation.speeds) < 2:
        return Section("lifetime", "", "")
    labels = page.agent_labels(evaluation.agents)
    shares = ", ".join(
        f"{speed:g} m/s {100 * weight:.0f} %"
        for speed, weight in zip(evaluation.speeds, wind_weights(climate, evaluation.speeds), strict=True)
    )
    rows = []
    for key in LIFETIME_EXPONENTS:
        cells = []
        for agent in evaluation.agents:
            value = lifetime(evaluation, agent, key)
            text = NONE if value is None else format_value(key, value)
            if agent != evaluation.baseline and value is not None:
                text += change_tag(key, lifetime_change(evaluation, agent, key))
            cells.append(text)
        rows.append(Row(page.metric_label(key), cells))
    caption = (
        f"Damage weighted by a Weibull distribution of the mean wind speed: {climate.mean_speed:g} m/s on average, "
        f"exponent {climate.shape:g}. Every wind between {climate.cut_in:g} and {climate.cut_out:g} m/s counts for the "
        f"nearest evaluated speed: {shares} of the operating time."
    )
    content = page.legend() + page.table(["Load", *labels.values()], rows)
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
        content = page.figure_element("pareto-figure", front)
        sections.append(Section("pareto", "Load against pitch travel", content, text, "Load and travel"))
    sections.append(replay_section(evaluation))
    for i, agents in enumerate(trainings(evaluation)):
        text = f"{', '.join(agents)}: episodes of the training, with exploration, in its own winds."
        content = page.figure_element(f"training{i}-figure", learning_figure(evaluation, agents))
        sections.append(Section(f"training{i}", "Learning curve", content, text))
    text = (
        "All rows share one time axis: zoom into one and the others follow; double-click to return. Dashed lines are"
        " rated values, dotted vertical lines the ends of runs that stopped early. One wind of each mean speed is"
        " shown; the files of the runs hold all."
    )
    series = "".join(
        page.details(wind.label, page.figure_element(f"time{i}", time_series_figure(evaluation, wind)), opened=i == 0)
        for i, wind in enumerate(_shown_winds(evaluation))
    )
    sections.append(Section("time", "Time series", series, text))
    skip = evaluation.settings.get("skip", 0.0)
    text = (
        "Power spectral density by Welch's method (60 s segments), mean over the winds that an agent completed. Dotted"
        " lines: once and three times the mean rotor frequency of the reference."
    )
    spectra = page.figure_element("spectra-figure", spectra_figure(evaluation, skip))
    sections.append(Section("spectra", "Where the loads come from", spectra, text, "Spectra"))
    return sections


def _runs(evaluation: Evaluation, files: Sequence[str] | None) -> Section:
    """Every run, how it ended and where its signals are."""
    place = {(run.agent, run.wind): k for k, run in enumerate(evaluation.runs)}
    labels = page.agent_labels(evaluation.agents)

    def cell(run: Run) -> str:
        text = "complete" if run.complete else f"{REASONS[run.ending]} after {run.duration:.0f} s"
        kind = "" if run.complete else " class='worse'"
        named = f"<span{kind}>{escape(text)}</span>"
        return named if files is None else f"<a href='{quote(files[place[run.agent, run.wind]])}'>{named}</a>"

    rows = [
        Row(escape(wind.label), [cell(evaluation.run(agent, wind)) for agent in evaluation.agents])
        for wind in evaluation.winds
    ]
    content = page.table(["Wind", *labels.values()], rows)
    caption = "How each run ended."
    if files is not None:
        caption = "How each run ended, with a link to its signals (NetCDF, with units)."
        content += (
            f"<p>Metrics of every run: <a href='{METRICS_FILE}'>{METRICS_FILE}</a>, with settings and trainings:"
            f" <a href='{TABLE_FILE}'>{TABLE_FILE}</a>.</p>"
        )
    return Section("runs", "Runs", content, caption)


def _shown_winds(evaluation: Evaluation) -> list[Wind]:
    """The first wind of each mean speed, of some speeds spread over all of them."""
    first = {wind.speed: wind for wind in reversed(evaluation.winds)}
    speeds = evaluation.speeds
    n = min(4, max(1, _MOST_SERIES // len(evaluation.agents)), len(speeds))
    places = {round(k * (len(speeds) - 1) / max(1, n - 1)) for k in range(n)}
    return [first[speeds[place]] for place in sorted(places)]


def _method(evaluation: Evaluation) -> str:
    """Origin and meaning of the numbers."""
    seen = evaluation.training and unseen(evaluation)
    return page.method_list(
        Path(__file__).with_name("report_method.txt"), evaluation.settings,
        *(["No training episode used the turbulence seeds of this evaluation."] if seen else []),
        skip=evaluation.settings.get("skip", 0.0), baseline=evaluation.baseline, resamples=N_RESAMPLES,
        least=LEAST_PER_STRATUM,
    )  # fmt: skip


# Almost a megabyte each: more agents would make the page heavy.
_MOST_AGENTS = 4
_BITS = {"blades": 16, "wake": 16, "strength": 8, "tower": 16, "hub": 16, "floater": 16, "sea": 8}


def encode(values: ArrayLike, bits: int = 16) -> dict[str, Any]:
    """Array of numbers or NaN as integers of 16 or 8 bits in base64.

    Returns
    -------
    dict
        ``bits``, ``shape``, ``offset``, ``scale`` and ``data``: value = offset + scale · integer / full, where full is
        32767 or 127, and -full - 1 is NaN.
    """
    values = np.asarray(values, dtype=np.float64)
    full = 2 ** (bits - 1) - 1
    low, high = (float(np.nanmin(values)), float(np.nanmax(values))) if np.isfinite(values).any() else (0.0, 0.0)
    offset, scale = 0.5 * (low + high), 0.5 * (high - low) or 1.0
    whole = np.where(np.isnan(values), -full - 1, np.round((values - offset) / scale * full))
    packed = base64.b64encode(whole.astype(f"<i{bits // 8}").tobytes()).decode()
    return {"bits": bits, "shape": list(values.shape), "offset": offset, "scale": scale, "data": packed}


def replay_section(evaluation: Evaluation) -> Section:
    """Section of the page with the replay, empty where no run kept its shapes."""
    runs = [run for agent in evaluation.agents for run in evaluation.runs_of(agent) if run.replay is not None]
    if not runs:
        return Section("replay", "", "")
    opened = opening_agent(evaluation, [run.agent for run in runs])
    first = [opened, evaluation.baseline, *(run.agent for run in runs)]
    offered = [agent for agent in dict.fromkeys(first) if any(run.agent == agent for run in runs)][:_MOST_AGENTS]
    runs = [run for run in runs if run.agent in offered]
    replays = [run.replay for run in runs if run.replay is not None]
    blades, longest = replays[0].blades, max(replays, key=lambda replay: replay.time.size)
    data = {
        "dt": float(np.diff(longest.time).mean()) if longest.time.size > 1 else 1.0,
        "frames": longest.time.size,
        "size": float(np.linalg.norm(blades[0, :, 0, -1] - replays[0].hub[0], axis=-1).max()),
        "hub_height": float(replays[0].hub[0, 2]),
        "tower_radius": [round(float(radius), 3) for radius in replays[0].tower_radius],
        "floater_radius": [round(float(radius), 3) for radius in replays[0].floater_radius],
        "sea_place": np.round(replays[0].sea_place.astype(float), 1).tolist(),
        "sea": "platform_pitch" in runs[0].data,
        "open": [run.agent for run in runs].index(opened),
        "agents": [_agent(run, replay) for run, replay in zip(runs, replays, strict=True)],
    }
    text = json.dumps(data, separators=(",", ":")).replace("</", "<\\/")
    left_out = len(evaluation.agents) - len(runs)
    caption = (
        f"The last {replays[0].time[-1] - replays[0].time[0]:.0f} s of each run at {runs[0].wind.label}: "
        "lifting surfaces of the blades, which bend and pitch, and trailing filaments of the free wake, brighter where "
        "they are stronger. Drag to turn."
    )
    if left_out:
        caption += f" {len(runs)} of {len(evaluation.agents)} agents can be chosen."
    markup = _shipped("replay.html")
    content = f"{markup}<script type='application/json' id='replay-data'>{text}</script>"
    return Section("replay", "Replay of rotor and wake", content, caption, "Replay")


def opening_agent(evaluation: Evaluation, agents: Sequence[str]) -> str:
    """Agent that the replay opens on: of those with one the trained one with the lowest flap DEL, else the last."""

    def load(agent: str) -> float:
        changes = [paired_change(evaluation, agent, "blade_flap_del", speed) for speed in evaluation.speeds]
        return float(np.mean([change.value for change in changes if change is not None] or [0.0]))

    return min((agent for agent in agents if agent in evaluation.training), key=load, default=agents[-1])


def _agent(run: Run, replay: Replay) -> dict[str, Any]:
    """Shapes and signals of a run over its replay."""
    signals = run.data
    places = np.searchsorted(signals["time"].values, replay.time - 1e-6)

    def rounded(name: str, factor: float = 1.0) -> list[float]:
        return [round(factor * float(value), 3) for value in signals[name].values[places]]

    blades, afloat = range(1, replay.blades.shape[1] + 1), {}
    if "platform_pitch" in signals:
        afloat = {"platform_pitch": rounded("platform_pitch", 180 / np.pi)}
    return {
        "name": run.agent,
        "time": [round(float(time), 3) for time in replay.time],
        "shapes": {name: encode(getattr(replay, name), bits) for name, bits in _BITS.items()},
        "signals": {
            "wind": rounded("wind_x"),
            "power": rounded("generator_power", 1e-6),
            "speed": rounded("rotor_speed", 30 / np.pi),
            "pitch": [rounded(f"pitch_{b}", 180 / np.pi) for b in blades],
            "tip": [rounded(f"tip_out_of_plane_{b}") for b in blades],
            **afloat,
        },
    }
