"""The page of a crosscheck: tables side by side, signals on top of each other, spectra."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wt_gym.analysis.crosscheck import COMPARED, SERIES
from wt_gym.analysis.metrics import METRICS
from wt_gym.analysis.paired import Estimate
from wt_gym.analysis.summary import format_estimate, format_value

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from wt_gym.analysis.crosscheck import Crosscheck

__all__ = ["changes_figure", "figure_files", "page", "tables", "write_page"]

_COLUMNS = {
    "blade_flap_del": "flap DEL",
    "blade_edge_del": "edge DEL",
    "tower_fore_aft_del": "tower fore-aft DEL",
    "tower_side_side_del": "tower side-side DEL",
    "pitch_travel": "pitch travel",
    "mean_power": "power",
}
_SPECTRA = ("root_flap_moment_1", "tower_base_fore_aft_moment", "tower_base_side_side_moment", "pitch_1")
_PLOTTED = ("blade_flap_del", "tower_fore_aft_del", "tower_side_side_del", "pitch_travel")
_SHOWN = 60.0
"""Length of the signals that are drawn [s]."""
_FASTEST = 3.0
"""Up to which spectra are drawn [Hz]."""
_CHANGES_FILE = "figures/changes.svg"
# Okabe and Ito's colors, told apart by color-blind readers too; beside them markers by wind speed
_COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
_MARKERS = "os^Dv<>"


def tables(content: dict[str, Any]) -> str:
    """Markdown of the changes side by side, the order of the agents, levels and correlations.

    Parameters
    ----------
    content : dict
        As `Crosscheck.to_json` gives it, and ``crosscheck.json`` has it.
    """
    (first, second), baseline = content["simulators"], content["baseline"]
    rows = {(row["wind_speed"], row["metric"]): row for row in content["metrics"]}
    speeds = list(dict.fromkeys(speed for speed, _ in rows))
    agents = [name for name in content["sample_correlation"] if name != baseline]
    lines = [
        f"Changes against {baseline} in the same simulator: {first} / {second}.",
        "",
        *_heading(["wind [m/s]", "agent", *(_COLUMNS[key] for key in COMPARED)]),
    ]
    for speed in speeds:
        for agent in agents:
            cells = [_pair(key, rows[speed, key]["changes"][agent]) for key in COMPARED]
            lines.append(_line([_speed(speed), agent, *cells]))
    lines += [
        "",
        f"{baseline} in {first} over that in {second}, and Spearman's rank correlation of all agents' changes "
        "between both.",
        "",
        *_heading(["wind [m/s]", "", *(_COLUMNS[key] for key in COMPARED)]),
    ]
    for speed in speeds:
        found = [rows[speed, key] for key in COMPARED]
        lines.append(_line([_speed(speed), "level", *(_percent(row["level"]) for row in found)]))
        lines.append(_line([_speed(speed), "rank correlation", *(_number(row["rank_correlation"]) for row in found)]))
    lines += ["", "Correlation sample by sample, mean over the winds.", "", *_heading(["agent", *SERIES])]
    for agent in (baseline, *agents):
        lines.append(_line([agent, *(_number(content["sample_correlation"][agent][name]) for name in SERIES)]))
    for simulator, sentences in zip(content["simulators"], content.get("idle", ()), strict=False):
        lines += ["", *(f"In {simulator} {sentence}" for sentence in sentences)] if sentences else []
    lines += ["", f"{baseline}, mean over all winds.", "", *_heading(["simulator", *map(_labeled, COMPARED)])]
    for name, metrics in zip((first, second), content["baseline_metrics"], strict=True):
        lines.append(_line([name, *(format_value(key, metrics[key]) if key in metrics else "" for key in COMPARED)]))
    return "\n".join(lines)


def page(check: Crosscheck, command: str | None = None) -> str:
    """Markdown of the whole page, with figures that `write_page` puts beside it.

    Parameters
    ----------
    check : Crosscheck
    command : str, optional
        That repeats it.
    """
    evaluation = check.evaluations[0]
    settings = evaluation.settings
    winds = "; ".join(wind.label for wind in evaluation.winds)
    lines = [
        f"# {evaluation.turbine}: {check.names[0]} and {check.names[1]}",
        "",
        f"{settings['env_id']}, {settings['duration']:g} s a run, without the first {settings['skip']:g} s. "
        f"Winds: {winds}.",
        "",
        *([f"```\n{command}\n```", ""] if command else []),
        f"![changes in {check.names[0]} and {check.names[1]}]({_CHANGES_FILE})",
        "",
        tables(check.to_json()),
    ]
    failed = [
        f"{name}: {run.agent} at {run.wind.name} ended after {run.duration:g} s ({run.ending}) {run.failure or ''}"
        for name, each in zip(check.names, check.evaluations, strict=True)
        for run in each.runs
        if not run.complete
    ]
    lines += ["", *failed] if failed else []
    for agent in (check.baseline, *check.agents):
        lines += ["", f"## {agent}", "", f"![signals]({_file(check, agent, 'signals')})"]
        lines += ["", f"![spectra]({_file(check, agent, 'spectra')})"]
    return "\n".join(lines) + "\n"


def write_page(check: Crosscheck, folder: str | Path, command: str | None = None) -> Path:
    """Write ``crosscheck.md`` with its figures, and ``crosscheck.json``.

    Parameters
    ----------
    check : Crosscheck
    folder : str or Path
    command : str, optional
        That repeats it.

    Returns
    -------
    Path
        Of the page.
    """
    folder = Path(folder)
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    changes_figure(check.to_json()).savefig(folder / _CHANGES_FILE)
    for agent in (check.baseline, *check.agents):
        _signals_figure(check, agent).savefig(folder / _file(check, agent, "signals"), dpi=110)
        _spectra_figure(check, agent).savefig(folder / _file(check, agent, "spectra"), dpi=110)
    (folder / "crosscheck.json").write_text(json.dumps(check.to_json(), indent=1, default=str), encoding="utf-8")
    path = folder / "crosscheck.md"
    path.write_text(page(check, command), encoding="utf-8")
    return path


def figure_files(check: Crosscheck) -> dict[str, list[str]]:
    """Files of the figures of each agent, as seen from the folder of the page."""
    return {agent: [_file(check, agent, what) for what in ("signals", "spectra")]
            for agent in (check.baseline, *check.agents)}  # fmt: skip


def changes_figure(content: dict[str, Any]) -> Figure:
    """Changes in the second simulator over those in the first, a point for each agent and wind speed.

    Parameters
    ----------
    content : dict
        As of `tables`.
    """
    from matplotlib.figure import Figure

    rows = {(row["wind_speed"], row["metric"]): row["changes"] for row in content["metrics"]}
    speeds = [speed for speed in dict.fromkeys(speed for speed, _ in rows) if speed is not None]
    agents = [name for name in content["sample_correlation"] if name != content["baseline"]]
    figure = Figure(figsize=(11.0, 6.6), layout="constrained")
    axes = figure.subplots(2, 2).ravel()
    for ax, key in zip(axes, _PLOTTED, strict=True):
        unchanged, scale, unit = (1.0, 1.0, "times") if key == "pitch_travel" else (0.0, 100.0, "change, %")
        ends = [unchanged, unchanged]
        for k, agent in enumerate(agents):
            for m, speed in enumerate(speeds):
                pair = rows[speed, key][agent]
                if not all(change is not None and change["relative"] for change in pair):
                    continue
                point = [unchanged + scale * change["value"] for change in pair]
                ax.plot(
                    *point, _MARKERS[m % len(_MARKERS)], markersize=5,
                    color=_COLORS[k % len(_COLORS)], fillstyle="full" if k < len(_COLORS) else "none",
                )  # fmt: skip
                ends = [min(*ends, *point), max(*ends, *point)]
        ax.plot(ends, ends, color="0.6", linewidth=0.8, zorder=0)
        ax.set_title(f"{_COLUMNS[key]} against {content['baseline']} [{unit}]", fontsize=9)
        ax.grid(alpha=0.3)
    first, second = content["simulators"]
    figure.supxlabel(first, fontsize=9)
    figure.supylabel(second, fontsize=9)
    handles = [
        axes[0].plot([], [], "o", color=_COLORS[k % len(_COLORS)], label=agent,
                     fillstyle="full" if k < len(_COLORS) else "none")[0]
        for k, agent in enumerate(agents)
    ] + [
        axes[0].plot([], [], _MARKERS[m % len(_MARKERS)], color="0.4", fillstyle="none", label=f"{speed:g} m/s")[0]
        for m, speed in enumerate(speeds)
    ]  # fmt: skip
    figure.legend(handles=handles, loc="outside right upper", fontsize=8)
    return figure


def _signals_figure(check: Crosscheck, agent: str) -> Figure:
    """Signals of both simulators in the wind in the middle of the list, on top of each other."""
    from matplotlib.figure import Figure

    winds = check.evaluations[0].winds
    wind = winds[len(winds) // 2]
    pair = check.common(agent, wind)
    figure = Figure(figsize=(10.0, 1.5 * len(SERIES)), layout="constrained")
    axes = figure.subplots(len(SERIES), 1, sharex=True)
    for ax, name in zip(axes, SERIES, strict=True):
        for data, label in zip(pair, check.names, strict=True):
            shown = data.sel(time=slice(None, float(data.time[0]) + _SHOWN))
            factor, unit = _scale(data[name].attrs["units"])
            ax.plot(shown.time, factor * shown[name], label=label, linewidth=1.0)
        ax.set_ylabel(f"{name}\n[{unit}]", fontsize=7)
        ax.grid(alpha=0.3)
    axes[0].legend(loc="upper right", fontsize=8)
    axes[0].set_title(f"{agent}, {wind.label}", fontsize=9)
    axes[-1].set_xlabel("time [s]")
    return figure


def _spectra_figure(check: Crosscheck, agent: str) -> Figure:
    """Spectra of both simulators, means over all winds."""
    from matplotlib.figure import Figure

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


def _file(check: Crosscheck, agent: str, what: str) -> str:
    place = (check.baseline, *check.agents).index(agent)
    return f"figures/{what}_{place}.png"


def _scale(unit: str) -> tuple[float, str]:
    """Factor and unit in which a signal is drawn."""
    return {
        "N m": (1e-6, "MN m"), "W": (1e-6, "MW"), "rad/s": (30.0 / math.pi, "rpm"), "rad": (180.0 / math.pi, "deg"),
    }.get(unit, (1.0, unit))  # fmt: skip


def _pair(key: str, changes: list[dict[str, Any] | None]) -> str:
    """Changes of both simulators in one cell; their intervals are in ``crosscheck.json``."""
    shown = []
    for change in changes:
        if change is None:
            shown.append("–")
        else:
            known: dict[str, Any] = {name: math.nan if value is None else value for name, value in change.items()}
            shown.append(format_estimate(key, Estimate(**known)).partition(" [")[0])
    return " / ".join(shown)


def _speed(speed: float | None) -> str:
    return "all" if speed is None else f"{speed:g}"


def _labeled(key: str) -> str:
    return f"{_COLUMNS[key]} [{METRICS[key].unit}]"


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{100.0 * value:+.1f} %".replace("-", "−")


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}".replace("-", "−")


def _heading(cells: list[str]) -> list[str]:
    return [_line(cells), "|---" * len(cells) + "|"]


def _line(cells: list[str]) -> str:
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"
