"""The page of a crosscheck: tables side by side, signals on top of each other, spectra."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING

from wt_gym.analysis.crosscheck import COMPARED, SERIES
from wt_gym.analysis.metrics import METRICS
from wt_gym.analysis.summary import format_estimate, format_value

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from wt_gym.analysis.crosscheck import Crosscheck

__all__ = ["page", "tables", "write_page"]

_COLUMNS = {
    "blade_flap_del": "flap DEL",
    "blade_edge_del": "edge DEL",
    "tower_fore_aft_del": "tower fore-aft DEL",
    "tower_side_side_del": "tower side-side DEL",
    "pitch_travel": "pitch travel",
    "mean_power": "power",
}
_SPECTRA = ("root_flap_moment_1", "tower_base_fore_aft_moment", "tower_base_side_side_moment", "pitch_1")
_SHOWN = 60.0
"""Length of the signals that are drawn [s]."""
_FASTEST = 3.0
"""Up to which spectra are drawn [Hz]."""


def tables(check: Crosscheck) -> str:
    """Markdown of the changes side by side, the order of the agents, levels and correlations."""
    first, second = check.names
    head = ["wind [m/s]", "agent", *(_COLUMNS[key] for key in COMPARED)]
    lines = [
        f"Changes against {check.baseline} in the same simulator: {first} / {second}.",
        "",
        *_heading(head),
    ]
    for speed in check.speeds:
        for agent in check.agents:
            cells = [_pair(check, agent, key, speed) for key in COMPARED]
            lines.append(_line([f"{speed:g}", agent, *cells]))
    lines += [
        "",
        f"{check.baseline} in {first} over that in {second}, and Spearman's rank correlation of all agents' changes "
        "between both.",
        "",
        *_heading(["wind [m/s]", "", *(_COLUMNS[key] for key in COMPARED)]),
    ]
    for speed in check.speeds:
        lines.append(_line([f"{speed:g}", "level", *(_percent(check.level(key, speed)) for key in COMPARED)]))
        ranks = [_number(check.rank_correlation(key, speed)) for key in COMPARED]
        lines.append(_line([f"{speed:g}", "rank correlation", *ranks]))
    lines += ["", "Correlation sample by sample, mean over the winds.", "", *_heading(["agent", *SERIES])]
    for agent in (check.baseline, *check.agents):
        lines.append(_line([agent, *(_number(check.sample_correlation(agent, name)) for name in SERIES)]))
    lines += ["", f"{check.baseline}, mean over all winds.", "", *_heading(["simulator", *map(_labeled, COMPARED)])]
    for name, evaluation in zip(check.names, check.evaluations, strict=True):
        metrics = evaluation.overall_metrics(check.baseline)
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
        tables(check),
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
    for agent in (check.baseline, *check.agents):
        _signals_figure(check, agent).savefig(folder / _file(check, agent, "signals"), dpi=110)
        _spectra_figure(check, agent).savefig(folder / _file(check, agent, "spectra"), dpi=110)
    (folder / "crosscheck.json").write_text(json.dumps(check.to_json(), indent=1, default=str), encoding="utf-8")
    path = folder / "crosscheck.md"
    path.write_text(page(check, command), encoding="utf-8")
    return path


def _signals_figure(check: Crosscheck, agent: str) -> Figure:
    """Signals of both simulators in the first wind, on top of each other."""
    from matplotlib.figure import Figure

    wind = check.evaluations[0].winds[0]
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


def _pair(check: Crosscheck, agent: str, key: str, speed: float) -> str:
    """Changes of both simulators in one cell; the interval of the estimates is in the evaluations."""
    shown = [
        "–" if change is None else format_estimate(key, change).partition(" [")[0]
        for change in check.changes(agent, key, speed)
    ]
    return " / ".join(shown)


def _labeled(key: str) -> str:
    return f"{_COLUMNS[key]} [{METRICS[key].unit}]"


def _percent(value: float) -> str:
    return "–" if math.isnan(value) else f"{100.0 * value:+.1f} %".replace("-", "−")


def _number(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.2f}".replace("-", "−")


def _heading(cells: list[str]) -> list[str]:
    return [_line(cells), "|---" * len(cells) + "|"]


def _line(cells: list[str]) -> str:
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"
