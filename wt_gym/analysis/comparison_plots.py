"""Figures of agents against the baseline: changes with their intervals, and load against pitch travel (plotly)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from wt_gym.analysis.paired import level_of, paired_change
from wt_gym.analysis.plots import BETTER, MUTED, agent_styles, style, titles_at_left
from wt_gym.analysis.summary import format_estimate

if TYPE_CHECKING:
    from typing import Any

    from wt_gym.analysis.paired import Estimate
    from wt_gym.analysis.results import Evaluation

__all__ = ["pareto_figure", "verdict_figure"]

_LOADS = {
    "blade_flap_del": "Blade root,<br>flapwise",
    "blade_edge_del": "Blade root,<br>edgewise",
    "tower_fore_aft_del": "Tower base,<br>fore-aft",
    "tower_side_side_del": "Tower base,<br>side-side",
}
# Numbers stand beside the points of so many agents at most.
_MOST_LABELED = 3


def verdict_figure(evaluation: Evaluation) -> go.Figure | None:
    """Changes of power and damage-equivalent loads against the baseline, with 95 % intervals.

    The shaded half is the better one. None where no agent can be compared.
    """
    agents = [agent for agent in evaluation.agents if agent != evaluation.baseline]
    panels = ({"corrected_power": "Power"}, _LOADS)
    changed = {(agent, key): paired_change(evaluation, agent, key) for agent in agents for key in panels[0] | panels[1]}
    found = {place: change for place, change in changed.items() if change is not None and change.relative}
    if not found:
        return None
    rows = [max(1, len(agents)) * len(panel) for panel in panels]
    height = 150 + max(24 * sum(rows), 190)
    figure = make_subplots(
        rows=2, cols=1, row_heights=[rows[0] + 0.4, rows[1] + 0.4], vertical_spacing=66 / height,
        subplot_titles=["Power, more is better", "Fatigue loads (DEL), less is better"],
    )  # fmt: skip
    styles = agent_styles(evaluation)
    for row, (panel, better) in enumerate(zip(panels, (+1, -1), strict=True), start=1):
        changes = [change for (_, key), change in found.items() if key in panel]
        reach = 1.3 * 100 * max([0.01, *(np.nanmax(np.abs([c.value, c.low, c.high])) for c in changes)])
        for i, agent in enumerate(agents):
            heights, shown = [], []
            for k, key in enumerate(panel):
                if (agent, key) in found:
                    heights.append(-k + 0.7 * ((len(agents) - 1) / 2 - i) / max(1, len(agents)))
                    shown.append((key, found[agent, key]))
            _add_points(figure, row, agent, heights, shown, styles[agent], len(agents) <= _MOST_LABELED)
        # after the points: nothing is drawn into an empty panel
        figure.add_vrect(x0=0.0, x1=better * 2 * reach, fillcolor=BETTER, line_width=0, layer="below", row=row, col=1)
        figure.add_vline(x=0.0, line={"color": MUTED, "width": 1}, row=row, col=1)
        figure.update_xaxes(range=[-reach, reach], ticksuffix=" %", row=row, col=1)
        figure.update_yaxes(
            tickvals=[-k for k in range(len(panel))], ticktext=list(panel.values()), row=row, col=1,
            range=[0.6 - len(panel), 0.6], showgrid=False, fixedrange=True,
        )  # fmt: skip
    titles_at_left(figure)
    return style(figure, height)


def _add_points(
    figure: go.Figure, row: int, agent: str, heights: list[float], changes: list[tuple[str, Estimate]],
    look: dict[str, Any], labeled: bool,
) -> None:  # fmt: skip
    """Changes of one agent as points with intervals, and numbers behind these."""
    estimates = [change for _, change in changes]
    text = [format_estimate(key, change) for key, change in changes]
    figure.add_trace(
        go.Scatter(
            x=[100 * c.value for c in estimates], y=heights, mode="markers", name=agent, legendgroup=agent,
            marker={"color": look["color"], "symbol": look["symbol"], "size": 10}, showlegend=row == 2,
            error_x=_error_bar(estimates, 100.0, look["color"]), customdata=text,
            hovertemplate=f"{agent}: %{{customdata}}<extra></extra>", cliponaxis=False,
        ),
        row=row, col=1,
    )  # fmt: skip
    if labeled:
        figure.add_trace(
            go.Scatter(
                x=[100 * (c.high if c.has_interval else c.value) for c in estimates], y=heights, mode="text",
                text=[f"\u2002{words.partition(' [')[0]}" for words in text], textposition="middle right",
                textfont={"color": look["color"], "size": 12}, hoverinfo="skip", legendgroup=agent, showlegend=False,
                cliponaxis=False,
            ),
            row=row, col=1,
        )  # fmt: skip


def _error_bar(estimates: list[Estimate], factor: float, color: str) -> dict[str, Any]:
    """Interval as plotly draws it; nothing where there is none."""
    high = [factor * (e.high - e.value) if e.has_interval else 0.0 for e in estimates]
    low = [factor * (e.value - e.low) if e.has_interval else 0.0 for e in estimates]
    return {"type": "data", "array": high, "arrayminus": low, "color": color, "thickness": 1.8, "width": 4}


def pareto_figure(evaluation: Evaluation) -> go.Figure | None:
    """Change of the flapwise fatigue against the pitch duty cycle, a panel a wind speed, a point an agent.

    A dashed line joins the agents that no other beats in both. None where no agent can be compared.
    """
    speeds, styles = evaluation.speeds, agent_styles(evaluation)
    columns = min(2, len(speeds))
    rows = -(-len(speeds) // columns)
    figure = make_subplots(
        rows=rows, cols=columns, subplot_titles=[f"{speed:g} m/s" for speed in speeds],
        horizontal_spacing=0.13, vertical_spacing=0.22 / rows,
    )  # fmt: skip
    named = set()
    for panel, speed in enumerate(speeds):
        place = {"row": panel // columns + 1, "col": panel % columns + 1}
        points = {}
        for agent in evaluation.agents:
            duty = level_of(evaluation, agent, "pitch_duty_cycle", speed)
            load = paired_change(evaluation, agent, "blade_flap_del", speed)
            if duty is not None and load is not None and load.relative:
                points[agent] = duty, load
        front = _front({agent: (duty.value, load.value) for agent, (duty, load) in points.items()})
        figure.add_trace(
            go.Scatter(
                x=[x for x, _ in front], y=[100 * y for _, y in front], mode="lines", hoverinfo="skip",
                line={"color": MUTED, "width": 1, "dash": "dash"}, showlegend=False,
            ),
            **place,
        )  # fmt: skip
        for agent, (duty, load) in points.items():
            look = styles[agent]
            figure.add_trace(
                go.Scatter(
                    x=[duty.value], y=[100 * load.value], mode="markers", name=agent, legendgroup=agent,
                    showlegend=agent not in named,
                    marker={"color": look["color"], "symbol": look["symbol"], "size": 11},
                    error_x=_error_bar([duty], 1.0, look["color"]), error_y=_error_bar([load], 100.0, look["color"]),
                    hovertemplate=f"{agent}<br>duty cycle {duty.value:.2f} %<br>flap DEL "
                    f"{format_estimate('blade_flap_del', load)}<extra></extra>",
                ),
                **place,
            )  # fmt: skip
            named.add(agent)
        figure.add_hline(y=0.0, line={"color": MUTED, "width": 1}, layer="below", **place)
        figure.update_xaxes(title_text="Pitch duty cycle [%]", rangemode="tozero", **place)
        figure.update_yaxes(title_text="Flap DEL against the baseline [%]" if place["col"] == 1 else None, **place)
    if not named - {evaluation.baseline}:
        return None
    figure = style(figure, height=110 + 350 * rows)
    figure.update_layout(margin={"t": 80})
    return figure


def _front(points: dict[str, tuple[float, float]]) -> list[tuple[float, float]]:
    """Points that no other equals or beats in both coordinates, in ascending order of the first."""
    front: list[tuple[float, float]] = []
    for point in sorted(points.values()):
        if not front or point[1] < front[-1][1]:
            front.append(point)
    return front
