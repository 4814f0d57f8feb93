"""Learning curves of trained agents (plotly)."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from wt_gym.analysis.plots import MUTED, agent_styles, style, titles_at_left

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.analysis.results import Evaluation

__all__ = ["learning_figure", "median_and_range", "running_mean", "trainings"]

_LENGTH = "episode_length"
_PANELS = {"episode_return": "Return of a training episode [-]", _LENGTH: "Length of a training episode [s]"}
_SAME_LENGTH = 1e-6
"""Difference of lengths that is rounding [s]."""
_GRID = 200


def trainings(evaluation: Evaluation) -> list[list[str]]:
    """Agents with a learning curve; those whose trainings differ by their seeds only stand together."""
    groups: dict[str, list[str]] = {}
    for agent, record in evaluation.training.items():
        if record.get("curve", {}).get("steps"):
            config = {name: value for name, value in record.get("config", {}).items() if name != "seed"}
            key = json.dumps([record.get("algorithm"), config], sort_keys=True, default=str) if config else agent
            groups.setdefault(key, []).append(agent)
    return list(groups.values())


def running_mean(values: NDArray[np.float64], half_width: int) -> NDArray[np.float64]:
    """Mean over a centered window that shrinks at the ends.

    Parameters
    ----------
    values : numpy.ndarray, shape (n,)
    half_width : int
        Values on either side.

    Returns
    -------
    numpy.ndarray, shape (n,)
    """
    total = np.concatenate([[0.0], np.cumsum(values)])
    index = np.arange(len(values))
    low, high = np.maximum(index - half_width, 0), np.minimum(index + half_width + 1, len(values))
    out: NDArray[np.float64] = (total[high] - total[low]) / (high - low)
    return out


def median_and_range(
    curves: list[tuple[NDArray[np.float64], NDArray[np.float64]]],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Median, least and greatest of several curves over the steps that all of them cover.

    Parameters
    ----------
    curves : list of (numpy.ndarray, numpy.ndarray)
        Steps, ascending, and values.

    Returns
    -------
    steps, median, low, high : numpy.ndarray, shape (n,)
    """
    steps = np.linspace(max(s[0] for s, _ in curves), min(s[-1] for s, _ in curves), _GRID)
    values = np.array([np.interp(steps, s, v) for s, v in curves])
    return steps, np.median(values, axis=0), values.min(axis=0), values.max(axis=0)


def learning_figure(evaluation: Evaluation, agents: list[str]) -> go.Figure:
    """Return and length of the training episodes against environment steps, of the seeds of one training.

    One seed: episodes as points, and their running mean. Several: the median of the running means, and their range.
    Where all episodes have the same length, that has no panel.
    """
    look = agent_styles(evaluation)[agents[0]]
    panels = dict(_PANELS)
    lengths = np.concatenate([_curve(evaluation.training[agent], _LENGTH)[1] for agent in agents])
    if np.ptp(lengths) <= _SAME_LENGTH:
        del panels[_LENGTH]
    figure = make_subplots(
        rows=len(panels), cols=1, shared_xaxes=True, vertical_spacing=0.14, subplot_titles=list(panels.values())
    )
    for row, name in enumerate(panels, start=1):
        curves = [_curve(evaluation.training[agent], name) for agent in agents]
        smooth = [(steps, running_mean(values, max(1, len(values) // 12))) for steps, values in curves]
        show = {"showlegend": row == 1}
        if len(agents) == 1:
            steps, values = curves[0]
            points = {"color": look["color"], "size": 4, "opacity": 0.35}
            traces = [
                go.Scatter(x=steps, y=values, mode="markers", marker=points, name="episode", **show),
                go.Scatter(x=steps, y=smooth[0][1], mode="lines", line=_line(look), name="running mean", **show),
            ]
        else:
            steps, median, low, high = median_and_range(smooth)
            edge = {"mode": "lines", "line": {"width": 0}, "hoverinfo": "skip", "x": steps}
            traces = [
                go.Scatter(y=low, showlegend=False, **edge),
                go.Scatter(
                    y=high, fill="tonexty", fillcolor=_faint(look["color"]), name=f"range of {len(agents)} seeds",
                    **edge, **show,
                ),
                go.Scatter(x=steps, y=median, mode="lines", line=_line(look), name="median of the seeds", **show),
            ]  # fmt: skip
        for trace in traces:
            figure.add_trace(trace, row=row, col=1)
    if all(evaluation.training[agent].get("environment", {}).get("relative_reward") for agent in agents):
        figure.add_hline(  # rewards are differences to those of the base controller
            y=0.0, line={"color": MUTED, "width": 1.2, "dash": "dash"}, annotation_text="base controller",
            annotation_font={"size": 12, "color": MUTED}, annotation_position="bottom right", row=1, col=1,
        )  # fmt: skip
    titles_at_left(figure)
    style(figure, height=120 + 190 * len(panels))
    figure.update_xaxes(title_text="Environment steps", row=len(panels), col=1)
    return figure


def _curve(record: dict[str, Any], name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Steps and values of a learning curve."""
    curve = record["curve"]
    return np.asarray(curve["steps"], dtype=float), np.asarray(curve[name], dtype=float)


def _line(look: dict[str, str]) -> dict[str, Any]:
    return {"color": look["color"], "width": 2}


def _faint(color: str) -> str:
    """Color ``#rrggbb`` at a fifth of its strength."""
    red, green, blue = (int(color[k : k + 2], 16) for k in (1, 3, 5))
    return f"rgba({red},{green},{blue},0.2)"
