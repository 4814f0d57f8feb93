"""Compared controllers as one HTML page, in the style of all reports."""

from __future__ import annotations

import math
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.analysis.page import (
    Row,
    Section,
    agent_labels,
    change_tag,
    format_value,
    html_list,
    legend,
    settings_element,
    table,
    today,
    write_page,
)
from wt_gym.analysis.statistics import Estimate, is_relative, relative_change
from wt_gym.experiment.comparison import COLUMNS, LEAST_FOR_INTERVAL, change

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from wt_gym.experiment.comparison import ControllerRuns

__all__ = ["write_comparison"]

_HEADS = {
    "mean_power": "Power", "blade_flap_del": "Flap DEL", "blade_edge_del": "Edge DEL",
    "tower_fore_aft_del": "Fore-aft DEL", "tower_side_side_del": "Side-side DEL", "pitch_duty_cycle": "Pitch duty",
    "torque_rate": "Torque rate", "rotor_speed_max": "Speed, largest",
}  # fmt: skip
_VALUES = ("pitch_duty_cycle", "torque_rate", "rotor_speed_max")
"""Shown as means, not as changes."""
_LOADS = {
    "blade_flap_del": "flapwise blade fatigue", "tower_fore_aft_del": "fore-aft tower fatigue",
    "tower_side_side_del": "side-side tower fatigue",
}  # fmt: skip


def write_comparison(
    runs: Sequence[ControllerRuns], path: str | Path, turbine: str, settings: Mapping[str, Any]
) -> Path:
    """Write the page.

    Parameters
    ----------
    runs : sequence of ControllerRuns
        In the same winds; the first is the reference.
    path : str or path
        HTML file; its folder is created if missing.
    turbine : str
        Title of the turbine.
    settings : mapping
        With ``duration`` and ``skip`` [s], and what else it was made with.

    Returns
    -------
    pathlib.Path
    """
    cases = runs[0].done
    speeds = sorted({case.wind_speed for case in cases})
    seeds = list(dict.fromkeys(case.seed for case in cases if case.seed is not None))
    marks = [
        f"changes against <b>{escape(runs[0].name)}</b> in the same winds: mean over the seeds, with its 95 % interval"
        f" (Student's t) from {LEAST_FOR_INTERVAL} seeds on",
        "pitch, torque and speed: means",
    ]
    failures = [
        f"{run.name} at {case.wind_speed:g} m/s, seed {case.seed}: {message}"
        for run in runs
        for case, message in run.failures.items()
    ]
    return write_page(
        path,
        title=f"{turbine}: controllers compared",
        result=_result(runs),
        facts={
            "Turbine": turbine,
            "Mean wind speed": f"{', '.join(f'{speed:g}' for speed in speeds)} m/s",
            "Winds": f"seeds {', '.join(map(str, seeds))}" if seeds else "steady",
            "Duration": f"{settings['duration']:g} s each, after {settings['skip']:g} s that are left out",
            "Simulation": f"fidelity \u201c{settings['fidelity']}\u201d",
            "Date": today(),
        },
        sections=[
            Section("verdict", f"What changes against {runs[0].name}?", legend(more=marks) + _table(runs, speeds),
                    link="Changes"),
            Section("failed", "What failed", html_list(failures)),
            Section("method", "Settings", settings_element(settings)),
        ],
    )  # fmt: skip


def _mean_change(run: ControllerRuns, reference: ControllerRuns, key: str) -> float:
    """Mean relative change over all winds in which both ran; NaN where there is none, or no share makes sense."""
    pairs = [(run.metrics[c][key], reference.metrics[c][key]) for c in run.metrics if c in reference.metrics]
    values, references = np.array(pairs).reshape(-1, 2).T
    return float(np.mean(relative_change(values, references))) if pairs and is_relative(key, references) else math.nan


def _result(runs: Sequence[ControllerRuns]) -> str:
    """The controller with the least fatigue over all winds, and what it changes."""
    reference, *others = runs
    if not others:
        return f"{reference.name} alone, in {len(reference.metrics)} winds."
    changes = {run.name: {key: _mean_change(run, reference, key) for key in _LOADS} for run in others if run.metrics}
    least = {name: float(np.mean(list(found.values()))) for name, found in changes.items()}
    known = {name: value for name, value in least.items() if not math.isnan(value)}
    if not known:
        return f"No wind in which {reference.name} and another controller ran."
    best = min(known, key=known.__getitem__)
    if known[best] >= 0.0:
        return f"No controller has less fatigue than {reference.name} in the mean of blade and tower."
    words = ", ".join(f"{name} by {_percent(changes[best][key])}" for key, name in _LOADS.items())
    power = _mean_change(next(run for run in others if run.name == best), reference, "mean_power")
    more = "" if math.isnan(power) else f", and power by {_percent(power)}"
    winds = f"mean over {len(reference.metrics)} winds"
    return f"Least fatigue: {best} changes {words}{more} against {reference.name}, {winds}."


def _percent(value: float) -> str:
    return f"{100.0 * value:+.1f}\u00a0%".replace("-", "\u2212")


def _table(runs: Sequence[ControllerRuns], speeds: Sequence[float]) -> str:
    """A block a wind speed, a row a controller."""
    labels, rows = agent_labels([run.name for run in runs]), []
    for speed in speeds:
        rows.append(Row(f"{speed:g} m/s"))
        rows += [Row(labels[run.name], [_cell(key, run, runs[0], speed) for key, _ in COLUMNS]) for run in runs]
    return table(["Controller", *(_HEADS[key] for key, _ in COLUMNS)], rows)


def _cell(key: str, run: ControllerRuns, reference: ControllerRuns, speed: float) -> str:
    """Value of the reference or of a metric that is shown as such, else a change with its mark."""
    values = [m[key] for c, m in run.metrics.items() if c.wind_speed == speed]
    if not values:
        return "failed"
    mean, half = change(run, reference, speed, key)
    if run is reference or key in _VALUES or math.isnan(mean):
        return format_value(key, float(np.mean(values)), unit=True)
    return change_tag(key, Estimate(mean, mean - half, mean + half, True, len(values)), "main")
