"""The same agents in the same winds in two simulators: whether their effects agree, as tables, figures and a page."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from html import escape
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import numpy as np
import plotly.graph_objects as go
from matplotlib.figure import Figure
from plotly.subplots import make_subplots
from scipy.stats import spearmanr

from wt_gym.analysis import page
from wt_gym.analysis.metrics import COLUMN_HEADS, METRICS, mean_spectrum
from wt_gym.analysis.page import NONE, Row, Section, change_tag, format_estimate
from wt_gym.analysis.results import METRICS_FILE, TABLE_FILE, Evaluation, Wind
from wt_gym.analysis.statistics import LIFETIME_EXPONENTS, Estimate, paired_change, relative_change
from wt_gym.base.picture_style import COLORS, MARKERS, plain

if TYPE_CHECKING:
    import xarray as xr

COMPARED = (*LIFETIME_EXPONENTS, "pitch_travel", "mean_power")
"""Metrics whose changes are compared."""
_HEADS = [COLUMN_HEADS[key] for key in COMPARED]
SERIES = ("wind_x", "rotor_speed", "pitch_1", "root_flap_moment_1", "tower_base_fore_aft_moment", "generator_power")
"""Signals that are laid over each other."""
_SPECTRA = ("root_flap_moment_1", "tower_base_fore_aft_moment", "tower_base_side_side_moment", "pitch_1")
_LOADS = ("blade_flap_del", "tower_fore_aft_del", "tower_side_side_del")
_PLOTTED = (*_LOADS, "pitch_travel")
_LEAST_FOR_RANKS = 3
_SHOWN = 60.0  # length of the signals that are drawn [s]
_FASTEST = 3.0  # spectra are drawn up to it [Hz]
_TICKS = (-60, -40, -20, 0, 20, 40, 100)  # of changes [%], drawn in logarithms beyond 50
_UNITS = {"N m": (1e-6, "MN m"), "W": (1e-6, "MW"), "rad/s": (30.0 / math.pi, "rpm"), "rad": (180.0 / math.pi, "deg")}
_CHANGES_FILE = "figures/changes.svg"


def _finite(value: float) -> float | None:
    """A number as JSON has it, which has no NaN."""
    return value if math.isfinite(value) else None


@dataclass(frozen=True)
class Crosscheck:
    """Two evaluations of the same agents in the same winds, against the same baseline."""

    names: tuple[str, str]
    """Of the simulators."""
    evaluations: tuple[Evaluation, Evaluation]
    """The first is that of the simulator that the agents were made with."""

    def __post_init__(self) -> None:
        first, second = self.evaluations
        for what in ("agents", "winds", "baseline"):
            ours, theirs = getattr(first, what), getattr(second, what)
            if ours != theirs:
                raise ValueError(f"{what} of both evaluations must be the same, got {ours} and {theirs}")

    @property
    def baseline(self) -> str:
        """Agent that the others are compared with, in each simulator for itself."""
        return self.evaluations[0].baseline

    def changes(self, agent: str, key: str, speed: float | None = None) -> tuple[Estimate | None, Estimate | None]:
        """Change of a metric against the baseline in both simulators, at a mean wind speed [m/s] or in all winds."""
        first, second = (paired_change(each, agent, key, speed) for each in self.evaluations)
        return first, second

    def level(self, key: str, speed: float | None = None) -> float:
        """Metric of the baseline in the first simulator over that in the second, minus one."""
        first, second = (each.overall_metrics(self.baseline, speed).get(key, math.nan) for each in self.evaluations)
        return float(relative_change(first, second))

    def rank_correlation(self, key: str, speed: float | None = None) -> float:
        """Spearman's rank correlation of the agents' changes, the baseline's being zero; NaN for fewer than three.

        One says that both simulators put the agents into the same order.
        """
        pairs = [self.changes(agent, key, speed) for agent in self.evaluations[0].others]
        values = [(0.0, 0.0)] + [(a.value, b.value) for a, b in pairs if a is not None and b is not None]
        if len(values) < _LEAST_FOR_RANKS or not np.ptp(values, axis=0).all():
            return math.nan
        return float(spearmanr(values).statistic)

    def common(self, agent: str, wind: Wind) -> tuple[xr.Dataset, xr.Dataset]:
        """Signals of both runs after the skipped start, as long as both lasted."""
        first, second = (each.run(agent, wind).data for each in self.evaluations)
        end = min(float(data.time[-1]) for data in (first, second))
        half = 0.5 * float(first.time[1] - first.time[0])  # instants of both that differ by less are one
        span = slice(float(self.evaluations[0].settings["skip"]) - half, end + half)
        return first.sel(time=span), second.sel(time=span)

    def sample_correlation(self, agent: str, name: str) -> float:
        """Mean over the winds of the correlation of a signal in both simulators, sample by sample."""
        pairs = [[data[name].values for data in self.common(agent, wind)] for wind in self.evaluations[0].winds]
        moving = [pair for pair in pairs if all(values.size > 1 and values.std() > 0.0 for values in pair)]
        return float(np.mean([np.corrcoef(pair)[0, 1] for pair in moving])) if moving else math.nan

    def spectra(self, agent: str, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Frequencies [Hz] and the mean power spectral densities of a signal in both simulators."""
        both = zip(*(self.common(agent, wind) for wind in self.evaluations[0].winds), strict=True)
        (frequency, first), (_, second) = (mean_spectrum(runs, name) for runs in both)
        return frequency, first, second

    @cached_property
    def content(self) -> dict[str, Any]:
        """All numbers of the page, as JSON values: changes with their intervals, levels and correlations."""
        rows = [
            {
                "wind_speed": speed,
                "metric": key,
                "level": _finite(self.level(key, speed)),
                "rank_correlation": _finite(self.rank_correlation(key, speed)),
                "changes": {
                    agent: [None if change is None else change.to_json() for change in self.changes(agent, key, speed)]
                    for agent in self.evaluations[0].others
                },
            }
            for speed in (*self.evaluations[0].speeds, None)
            for key in COMPARED
        ]
        samples = {
            agent: {name: _finite(self.sample_correlation(agent, name)) for name in SERIES}
            for agent in (self.baseline, *self.evaluations[0].others)
        }
        return {
            "simulators": list(self.names),
            "baseline": self.baseline,
            "turbine": self.evaluations[0].turbine,
            "settings": [each.settings for each in self.evaluations],
            "winds": [wind.label for wind in self.evaluations[0].winds],
            "metrics": rows,
            "units": {key: METRICS[key].label for key in COMPARED},
            "baseline_metrics": [
                {key: value for key, value in each.overall_metrics(self.baseline).items() if key in COMPARED}
                for each in self.evaluations
            ],
            "sample_correlation": samples,
            "idle": [list(each.idle_sentences.values()) for each in self.evaluations],
        }


# ---- tables, as text and on the page ----


def _change_rows(
    content: Mapping[str, Any], cell: Callable[[str, list[Estimate | None]], str], labels: Mapping[str, str]
) -> list[Row]:
    """Changes of every agent in both simulators, in a cell each."""
    rows: list[Row] = []
    for speed, of_metric in _by_speed(content).items():
        rows.append(Row(_speed_text(speed)))
        for agent in _agents(content)[1:]:
            pairs = {key: [_estimate(change) for change in of_metric[key]["changes"][agent]] for key in COMPARED}
            rows.append(Row(labels.get(agent, agent), [cell(key, pair) for key, pair in pairs.items()]))
    return rows


def _agreement_rows(content: Mapping[str, Any]) -> list[Row]:
    """Level of the baseline and rank correlation of the agents, by wind speed."""
    rows = []
    for speed, of_metric in _by_speed(content).items():
        levels = [of_metric[key]["level"] for key in COMPARED]
        shown = [NONE if level is None else f"{page.signed(100.0 * level, 1)} %" for level in levels]
        ranks = [_number(of_metric[key]["rank_correlation"]) for key in COMPARED]
        rows += [Row(_speed_text(speed)), Row("level", shown), Row("rank correlation", ranks)]
    return rows


def _correlation_rows(content: Mapping[str, Any], labels: Mapping[str, str]) -> list[Row]:
    samples = content["sample_correlation"]
    return [Row(labels.get(a, a), [_number(samples[a][name]) for name in SERIES]) for a in _agents(content)]


def _baseline_rows(content: Mapping[str, Any]) -> list[Row]:
    return [
        Row(escape(name), [page.format_value(key, metrics[key]) if key in metrics else "" for key in COMPARED])
        for name, metrics in zip(content["simulators"], content["baseline_metrics"], strict=True)
    ]


def _by_speed(content: Mapping[str, Any]) -> dict[float | None, dict[str, dict[str, Any]]]:
    """Rows of the content by wind speed (None: all winds) and metric."""
    out: dict[float | None, dict[str, dict[str, Any]]] = {}
    for row in content["metrics"]:
        out.setdefault(row["wind_speed"], {})[row["metric"]] = row
    return out


def _agents(content: Mapping[str, Any]) -> list[str]:
    """Agents, the baseline first."""
    return list(content["sample_correlation"])


def _speed_text(speed: float | None) -> str:
    return "All winds" if speed is None else f"{speed:g} m/s"


def _estimate(record: Mapping[str, Any] | None) -> Estimate | None:
    return None if record is None else Estimate.from_json(record)


def _pair(key: str, changes: list[Estimate | None]) -> str:
    """Changes of both simulators in one cell; their intervals are in ``crosscheck.json``."""
    return " / ".join(NONE if c is None else format_estimate(key, c).partition(" [")[0] for c in changes)


def _number(value: float | None) -> str:
    return NONE if value is None else f"{value:.2f}".replace("-", "\u2212")


def tables(content: Mapping[str, Any]) -> str:
    """Markdown of a ``crosscheck.json``: changes side by side, order of the agents, levels, correlations."""
    (first, second), baseline = content["simulators"], content["baseline"]
    labels = [f"{name} [{METRICS[key].unit}]" for key, name in zip(COMPARED, _HEADS, strict=True)]
    parts = [
        [f"Changes against {baseline} in the same simulator: {first} / {second}."],
        page.markdown(["wind", "agent", *_HEADS], _change_rows(content, _pair, {})),
        [f"{baseline} in {first} over that in {second}, and Spearman's rank correlation of all agents' changes between "
         "both."],
        page.markdown(["wind", "", *_HEADS], _agreement_rows(content)),
        ["Correlation sample by sample, mean over the winds."],
        page.markdown(["agent", *SERIES], _correlation_rows(content, {})),
        *([f"In {simulator} {sentence}" for sentence in sentences]
          for simulator, sentences in zip(content["simulators"], content.get("idle", ()), strict=False) if sentences),
        [f"{baseline}, mean over all winds."],
        page.markdown(["simulator", *labels], _baseline_rows(content)),
    ]  # fmt: skip
    return "\n\n".join("\n".join(part) for part in parts)


# ---- pages ----


def write_crosscheck(check: Crosscheck, folder: str | Path, command: str | None = None) -> tuple[Path, Path]:
    """Write ``crosscheck.json``, figures, and the pages ``crosscheck.md`` and ``report.html``; return both pages.

    The report links to the evaluations of both simulators where they are in the folder. ``command`` repeats it.
    """
    folder = Path(folder)
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    content = check.content
    changes_figure(content).savefig(folder / _CHANGES_FILE)
    for agent, (signals, spectra) in _figure_files(content).items():
        _signals_figure(check, agent).savefig(folder / signals, dpi=110)
        _spectra_figure(check, agent).savefig(folder / spectra, dpi=110)
    (folder / "crosscheck.json").write_text(json.dumps(content, indent=1, default=str), encoding="utf-8")
    text = folder / "crosscheck.md"
    text.write_text(_text(check, content, command), encoding="utf-8")
    return text, _write_report(check, content, folder, command)


def _figure_files(content: Mapping[str, Any]) -> dict[str, list[str]]:
    """Figures of signals and spectra of each agent, as seen from the folder of the page."""
    agents = _agents(content)
    return {agent: [f"figures/{what}_{k}.png" for what in ("signals", "spectra")] for k, agent in enumerate(agents)}


def _duration(check: Crosscheck) -> str:
    settings = check.evaluations[0].settings
    return f"{settings['duration']:g} s a run, without the first {settings['skip']:g} s"


def _early_ends(check: Crosscheck) -> list[str]:
    return [
        f"{name}: {run.agent} at {run.wind.name} ended after {run.duration:g} s ({run.ending}) {run.failure or ''}"
        for name, each in zip(check.names, check.evaluations, strict=True)
        for run in each.runs
        if not run.complete
    ]


def _text(check: Crosscheck, content: Mapping[str, Any], command: str | None) -> str:
    """Markdown of the whole page."""
    evaluation = check.evaluations[0]
    parts = [
        f"# {evaluation.turbine}: {check.names[0]} and {check.names[1]}",
        f"{evaluation.settings['env_id']}, {_duration(check)}. Winds: {'; '.join(content['winds'])}.",
        f"```\n{command}\n```" if command else "",
        f"![changes in {check.names[0]} and {check.names[1]}]({_CHANGES_FILE})",
        tables(content),
        "\n".join(_early_ends(check)),
    ]
    for agent, (signals, spectra) in _figure_files(content).items():
        parts += [f"## {agent}", f"![signals]({signals})", f"![spectra]({spectra})"]
    return "\n\n".join(part for part in parts if part) + "\n"


def _write_report(check: Crosscheck, content: Mapping[str, Any], folder: Path, command: str | None) -> Path:
    evaluation = check.evaluations[0]
    labels = page.agent_labels(evaluation.agents)
    heads = [page.column_head(key) for key in COMPARED]
    more = [
        f"changes against <b>{escape(check.baseline)}</b> in the same simulator; above {escape(check.names[0])}, below"
        f" {escape(check.names[1])}"
    ]

    def cell(key: str, changes: list[Estimate | None]) -> str:
        return "".join(
            change_tag(key, change, "main", name, NONE) for name, change in zip(check.names, changes, strict=True)
        )

    units = [f"{head} <small>[{METRICS[key].unit}]</small>" for key, head in zip(COMPARED, heads, strict=True)]
    changes = page.table(["Agent", *heads], _change_rows(content, cell, labels))
    agreement = page.table(["", *heads], _agreement_rows(content))
    baseline = page.table([escape(check.baseline), *units], _baseline_rows(content))
    signals = page.table(["Agent", *(name.replace("_", " ") for name in SERIES)], _correlation_rows(content, labels))
    images = "".join(
        page.details(agent, "".join(f"<img loading='lazy' alt='' src='{quote(file)}'>" for file in files))
        for agent, files in _figure_files(content).items()
    )
    settings = "".join(page.settings_element(each.settings) for each in check.evaluations)
    figure = page.figure_element("changes", _interactive_changes(check, content))
    return page.write_page(
        folder / "report.html",
        title=f"{evaluation.turbine}: {check.names[0]} and {check.names[1]}",
        result=_result(check),
        facts={
            "Turbine": evaluation.turbine,
            "Winds": "; ".join(content["winds"]),
            "Duration": _duration(check),
            "Environment": str(evaluation.settings["env_id"]),
            "Date": page.today(),
        },
        sections=[
            Section(
                "verdict", "Do both simulators see the same changes?", page.legend(more=more) + changes + figure,
                link="Changes",
            ),
            Section("agreement", "Agreement by load", agreement + baseline, _AGREEMENT_CAPTION, "Agreement"),
            Section("signals", "Signals sample by sample", signals, _CORRELATION_CAPTION, "Signals"),
            Section("pictures", "Signals and spectra", images, "Both simulators on top of each other.", "Pictures"),
            Section("ends", "What ended early", page.html_list(_early_ends(check)), link="Ends"),
            Section("runs", "Runs", _runs(check, folder)),
            Section("method", "Settings", (f"<pre>{escape(command)}</pre>" if command else "") + settings),
        ],
    )  # fmt: skip


_AGREEMENT_CAPTION = (
    "Level: the reference in the first simulator over that in the second. Rank correlation: Spearman's, of the changes"
    " of all agents; one puts them into the same order."
)
_CORRELATION_CAPTION = "Correlation of a signal in both simulators, mean over the winds."


def _result(check: Crosscheck) -> str:
    """In how many comparisons of loads both simulators say the same."""
    pairs = [
        [change.kind(key) for change in check.changes(agent, key, speed) if change is not None]
        for agent, key, speed in product(check.evaluations[0].others, _LOADS, check.evaluations[0].speeds)
    ]
    seen = [pair for pair in pairs if len(pair) == 2 and {"better", "worse"}.intersection(pair)]
    if not seen:
        return f"Neither {check.names[0]} nor {check.names[1]} sees a change of a fatigue load."
    return (
        f"{check.names[0]} and {check.names[1]} agree on what gets better and worse in"
        f" {sum(first == second for first, second in seen)} of {len(seen)} changes of fatigue loads against"
        f" {check.baseline}."
    )


def _runs(check: Crosscheck, folder: Path) -> str:
    """Links to both evaluations and the signals of their runs, where these are in the folder."""
    parts = []
    for name, evaluation in zip(check.names, check.evaluations, strict=True):
        kept = folder / name / TABLE_FILE
        if not kept.exists():
            continue
        files = [row["file"] for row in json.loads(kept.read_text(encoding="utf-8"))["runs"]]
        links = {
            (run.agent, run.wind): f"<a href='{quote(f'{name}/{file}')}'>signals</a>"
            for run, file in zip(evaluation.runs, files, strict=True)
        }
        rows = [Row(escape(wind.label), [links[a, wind] for a in evaluation.agents]) for wind in evaluation.winds]
        whole = " and ".join(f"<a href='{quote(f'{name}/{file}')}'>{file}</a>" for file in (METRICS_FILE, TABLE_FILE))
        parts.append(
            f"<h3>{escape(name)}</h3><p>{whole}</p>" + page.table(["Wind", *map(escape, evaluation.agents)], rows)
        )
    return "".join(parts)


# ---- figures ----


def _points(content: Mapping[str, Any], key: str) -> tuple[dict[str, list[tuple[float, float, float]]], list[float]]:
    """Wind speeds and the changes of each agent in both simulators, of pitch travel the ratios; and their range."""
    unchanged, scale = (1.0, 1.0) if key == "pitch_travel" else (0.0, 100.0)
    points: dict[str, list[tuple[float, float, float]]] = {agent: [] for agent in _agents(content)[1:]}
    for speed, found in _by_speed(content).items():
        for agent, shown in points.items():
            pair = found[key]["changes"].get(agent, (None, None))
            if speed is not None and all(change is not None and change["relative"] for change in pair):
                x, y = (unchanged + scale * change["value"] for change in pair)
                shown.append((speed, x, y))
    values = [unchanged, *(value for shown in points.values() for _, *xy in shown for value in xy)]
    return points, [min(values), max(values)]


def _interactive_changes(check: Crosscheck, content: Mapping[str, Any]) -> go.Figure:
    """Changes in the second simulator over those in the first, a point for each agent and wind speed (plotly)."""
    titles = [f"{COLUMN_HEADS[key]} [{'times' if key == 'pitch_travel' else '%'}]" for key in _PLOTTED]
    figure = make_subplots(rows=len(_PLOTTED), cols=1, subplot_titles=titles, vertical_spacing=0.08)
    styles = page.agent_styles(check.evaluations[0].agents)
    for row, key in enumerate(_PLOTTED, start=1):
        points, ends = _points(content, key)
        for agent, shown in points.items():
            look = styles[agent]
            figure.add_scatter(
                x=[x for _, x, _ in shown], y=[y for _, _, y in shown], mode="markers", name=agent, legendgroup=agent,
                showlegend=row == 1, customdata=[f"{speed:g} m/s" for speed, *_ in shown], row=row, col=1,
                marker={"color": look["color"], "symbol": look["symbol"], "size": 10},
                hovertemplate=f"{agent}, %{{customdata}}: %{{x:.1f}}, %{{y:.1f}}<extra></extra>",
            )  # fmt: skip
        figure.add_scatter(
            x=ends, y=ends, mode="lines", line={"color": page.MUTED, "width": 1, "dash": "dot"}, hoverinfo="skip",
            showlegend=False, row=row, col=1,
        )  # fmt: skip
        figure.update_yaxes(title_text=check.names[1], row=row, col=1)
        figure.update_xaxes(title_text=check.names[0], row=row, col=1)
    page.titles_at_left(figure)
    return page.style(figure, 280 * len(_PLOTTED) + 80)


def changes_figure(content: Mapping[str, Any]) -> Figure:
    """Changes in the second simulator over those in the first, a point for each agent and wind speed (matplotlib)."""
    speeds = [speed for speed in _by_speed(content) if speed is not None]
    looks = {
        agent: {"color": COLORS[k % len(COLORS)], "fillstyle": "full" if k < len(COLORS) else "none"}
        for k, agent in enumerate(_agents(content)[1:])
    }
    marks = {speed: MARKERS[m % len(MARKERS)] for m, speed in enumerate(speeds)}
    figure = Figure(figsize=(8.6, 8.4), layout="constrained")
    axes = figure.subplots(2, 2).ravel()
    for ax, key in zip(axes, _PLOTTED, strict=True):
        points, ends = _points(content, key)
        for agent, shown in points.items():
            for speed, x, y in shown:
                ax.plot(x, y, marks[speed], markersize=6, clip_on=False, **looks[agent])
        ax.plot(ends, ends, color="0.6", linewidth=0.8, zorder=0)
        title = f"{COLUMN_HEADS[key]} against {content['baseline']} [{'times' if key == 'pitch_travel' else '%'}]"
        plain(ax, content["simulators"][0], content["simulators"][1], title)
        if key != "pitch_travel":
            ticks = [tick for tick in _TICKS if ends[0] <= tick <= ends[1]]
            for set_scale, set_ticks in ((ax.set_xscale, ax.set_xticks), (ax.set_yscale, ax.set_yticks)):
                set_scale("symlog", linthresh=50.0, linscale=2.0)
                set_ticks(ticks, [f"{tick}".replace("-", "\u2212") for tick in ticks])
    handles = [axes[0].plot([], [], "o", label=agent, **look)[0] for agent, look in looks.items()]
    handles += [axes[0].plot([], [], m, c="0.4", mfc="none", label=f"{v:g} m/s")[0] for v, m in marks.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=9, frameon=False)
    return figure


def _signals_figure(check: Crosscheck, agent: str) -> Figure:
    """Signals of both simulators in the wind in the middle of the list, on top of each other."""
    winds = check.evaluations[0].winds
    wind = winds[len(winds) // 2]
    pair = check.common(agent, wind)
    figure = Figure(figsize=(10.0, 1.5 * len(SERIES)), layout="constrained")
    axes = figure.subplots(len(SERIES), 1, sharex=True)
    for ax, name in zip(axes, SERIES, strict=True):
        for data, label in zip(pair, check.names, strict=True):
            shown = data.sel(time=slice(None, float(data.time[0]) + _SHOWN))
            factor, unit = _UNITS.get(data[name].attrs["units"], (1.0, data[name].attrs["units"]))
            ax.plot(shown.time, factor * shown[name], label=label, linewidth=1.0)
        ax.set_title(f"{name} [{unit}]", fontsize=9, loc="left")
        ax.grid(alpha=0.3)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper right", ncols=2, fontsize=9)
    figure.suptitle(f"{agent}, {wind.label}", fontsize=10, x=0.01, ha="left")
    axes[-1].set_xlabel("time [s]")
    return figure


def _spectra_figure(check: Crosscheck, agent: str) -> Figure:
    """Spectra of both simulators, means over all winds."""
    figure = Figure(figsize=(10.0, 6.0), layout="constrained")
    for ax, name in zip(figure.subplots(2, 2).ravel(), _SPECTRA, strict=True):
        frequency, *densities = check.spectra(agent, name)
        shown = frequency <= _FASTEST
        for density, label in zip(densities, check.names, strict=True):
            ax.loglog(frequency[shown], density[shown], label=label, linewidth=1.0)
        ax.set_title(name, fontsize=9)
        ax.grid(alpha=0.3, which="both")
    figure.axes[0].legend(fontsize=8)
    figure.supxlabel("frequency [Hz]")
    figure.supylabel("power spectral density")
    return figure
