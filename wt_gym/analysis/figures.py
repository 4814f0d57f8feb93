"""Figures of an evaluation (plotly): time series, spectra, changes against the baseline, learning curves."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from wt_gym.analysis.metrics import mean_spectrum
from wt_gym.analysis.page import BETTER, MUTED, WIND_COLOR, agent_styles, format_estimate, style, titles_at_left
from wt_gym.analysis.statistics import Estimate, level_of, paired_change

if TYPE_CHECKING:
    import xarray as xr

    from wt_gym.analysis.results import Evaluation, Wind


def _largest(prefix: str) -> Callable[[xr.Dataset], NDArray[np.float64]]:
    """Largest of the signals with a number behind a name, at each instant."""

    def largest(run: xr.Dataset) -> NDArray[np.float64]:
        names = [name for name in run.data_vars if str(name).startswith(prefix)]
        return np.asarray(np.max([run[name].values for name in names], axis=0))

    return largest


_Rows = tuple[tuple[str, str | Callable[["xr.Dataset"], NDArray[np.float64]], float, str], ...]
_ROWS: _Rows = (
    ("Wind speed at the hub [m/s]", "wind_x", 1.0, ""),
    ("Electrical power [MW]", "generator_power", 1e-6, "rated_power"),
    ("Rotor speed [rpm]", "rotor_speed", 30 / np.pi, "rated_rotor_speed"),
    ("Pitch of blade 1 [deg]", "pitch_1", 180 / np.pi, ""),
    ("Generator torque [kN m]", "generator_torque", 1e-3, ""),
    ("Largest tip deflection downwind [m]", _largest("tip_out_of_plane_"), 1.0, ""),
    ("Tower-base fore-aft moment [MN m]", "tower_base_fore_aft_moment", 1e-6, ""),
)
"""Rows of the time series: title with unit, signal, factor, and the limit that is drawn where it is known."""
_FLOATING_ROWS: _Rows = (
    ("Elevation of the sea [m]", "wave_elevation", 1.0, ""),
    ("Pitch of the platform [deg]", "platform_pitch", 180 / np.pi, ""),
    ("Surge of the platform [m]", "platform_surge", 1.0, ""),
    ("Largest tension at the fairleads [MN]", _largest("fairlead_tension_"), 1e-6, ""),
)
"""Further rows of a floating turbine, the last one of those with lines."""
_OUTSIDE = "wind_x", "wave_elevation"
"""Signals that all agents meet alike."""


def _line(look: dict[str, str]) -> dict[str, Any]:
    return {"color": look["color"], "dash": look["dash"], "width": 1.6}


def _rule(width: float = 1.0, dash: str = "dash", color: str = MUTED) -> dict[str, Any]:
    return {"color": color, "width": width, "dash": dash}


def _panels(titles: list[str], gap: float) -> go.Figure:
    """Panels below each other that share their horizontal axis."""
    return make_subplots(rows=len(titles), cols=1, shared_xaxes=True, vertical_spacing=gap, subplot_titles=titles)


def time_series_figure(evaluation: Evaluation, wind: Wind) -> go.Figure:
    """Wind, power, rotor speed, pitch, torque, tip deflection and tower moment of all agents in one wind.

    Of a floating turbine also sea, platform and mooring lines. The rows share their time axis: zooming one zooms all.
    """
    styles = agent_styles(evaluation.agents)
    signals = evaluation.run(evaluation.agents[0], wind).data
    n_more = len(_FLOATING_ROWS) - ("fairlead_tension_1" not in signals) if "platform_pitch" in signals else 0
    rows = (*_ROWS, *_FLOATING_ROWS[:n_more])
    figure = _panels([row[0] for row in rows], 0.224 / len(rows))
    for agent in evaluation.agents:
        run = evaluation.run(agent, wind)
        time = run.data["time"].values
        step = float(time[1] - time[0]) if time.size > 1 else 0.0
        for i, (_, signal, factor, _) in enumerate(rows, start=1):
            if signal in _OUTSIDE and agent != evaluation.agents[0]:
                continue
            line = {"color": WIND_COLOR, "width": 1.4} if signal in _OUTSIDE else _line(styles[agent])
            values = factor * (run.data[signal].values if isinstance(signal, str) else signal(run.data))
            figure.add_scatter(
                x0=float(time[0]), dx=step, y=compact(values), mode="lines", line=line, row=i, col=1,
                name={"wind_x": "wind", "wave_elevation": "sea"}.get(str(signal), agent), legendgroup=agent,
                showlegend=i == 2, hovertemplate="%{y:.4g}",
            )  # fmt: skip
        if not run.complete:
            figure.add_vline(x=run.duration, line=_rule(1, "dot", styles[agent]["color"]), row="all", col=1)
    for i, (_, _, factor, limit) in enumerate(rows, start=1):
        if limit in evaluation.limits:
            figure.add_hline(y=factor * evaluation.limits[limit], line=_rule(1), row=i, col=1)
    titles_at_left(figure)
    style(figure, height=round(1180 * len(rows) / len(_ROWS)))
    figure.update_layout(hovermode="x unified", hoversubplots="axis")
    figure.update_xaxes(title_text="Time [s]", row=len(rows), col=1)
    return figure


def spectra_figure(evaluation: Evaluation, skip: float) -> go.Figure:
    """Power spectral density of blade-root and tower-base moments, mean over the complete runs of each agent."""
    rows = (
        ("Blade root, flapwise moment", "root_flap_moment_1"),
        ("Blade root, edgewise moment", "root_edge_moment_1"),
        ("Tower base, fore-aft moment", "tower_base_fore_aft_moment"),
        ("Tower base, side-side moment", "tower_base_side_side_moment"),
    )
    styles = agent_styles(evaluation.agents)
    figure = _panels([f"{title} [(MN m)²/Hz]" for title, _ in rows], 0.05)
    for agent in evaluation.agents:
        whole = [run.data for run in evaluation.runs_of(agent) if run.complete]
        counted = [data.isel(time=data["time"].values >= data["time"].values[0] + skip - 1e-9) for data in whole]
        counted = [data for data in counted if data.sizes["time"] >= 64]
        for i, (_, name) in enumerate(rows if counted else (), start=1):
            frequency, density = mean_spectrum(counted, name)
            figure.add_scatter(
                x=compact(frequency), y=compact(density / 1e12), mode="lines", line=_line(styles[agent]), name=agent,
                legendgroup=agent, showlegend=i == 1, hovertemplate="%{y:.3g}", row=i, col=1,
            )  # fmt: skip
    turning = [run.data["rotor_speed"].values.mean() for run in evaluation.runs_of(evaluation.baseline)]
    rotation = float(np.mean(turning)) / (2 * np.pi)
    for multiple, rotor_frequency in (("1P", rotation), ("3P", 3 * rotation)):
        figure.add_vline(x=rotor_frequency, line=_rule(1, "dot"), row="all", col=1)
        figure.add_annotation(
            x=np.log10(rotor_frequency), y=1, xref="x", yref="y domain", text=multiple, showarrow=False,
            yanchor="bottom",
        )  # fmt: skip
    titles_at_left(figure, len(rows))
    style(figure, height=1000)
    ticks = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10]
    figure.update_xaxes(type="log", tickvals=ticks, ticktext=[f"{tick:g}" for tick in ticks])
    figure.update_yaxes(type="log", exponentformat="power", dtick=2)
    figure.update_xaxes(title_text="Frequency [Hz]", row=len(rows), col=1)
    return figure


def compact(values: NDArray[np.float64]) -> NDArray[np.float32]:
    """float32 copy: half the size in the page, more digits than a screen shows."""
    return np.asarray(values, dtype=np.float32)


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
    agents = evaluation.others
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
    styles = agent_styles(evaluation.agents)
    for row, (panel, better) in enumerate(zip(panels, (+1, -1), strict=True), start=1):
        changes = [change for (_, key), change in found.items() if key in panel]
        reach = 1.6 * 100 * max([0.01, *(np.nanmax(np.abs([c.value, c.low, c.high])) for c in changes)])
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
    common: dict[str, Any] = {"y": heights, "legendgroup": agent, "cliponaxis": False, "row": row, "col": 1}
    figure.add_scatter(
        x=[100 * c.value for c in estimates], mode="markers", name=agent, showlegend=row == 2, customdata=text,
        marker={"color": look["color"], "symbol": look["symbol"], "size": 10},
        error_x=_error_bar(estimates, 100.0, look["color"]), hovertemplate=f"{agent}: %{{customdata}}<extra></extra>",
        **common,
    )  # fmt: skip
    if labeled:
        figure.add_scatter(
            x=[100 * (c.high if c.has_interval else c.value) for c in estimates], mode="text", showlegend=False,
            text=[f"\u2002{words.partition(' [')[0]}" for words in text], textposition="middle right",
            textfont={"color": look["color"], "size": 12}, hoverinfo="skip", **common,
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
    speeds, styles = evaluation.speeds, agent_styles(evaluation.agents)
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
        figure.add_scatter(
            x=[x for x, _ in front], y=[100 * y for _, y in front], mode="lines", hoverinfo="skip", line=_rule(1),
            showlegend=False, **place,
        )  # fmt: skip
        for agent, (duty, load) in points.items():
            look = styles[agent]
            figure.add_scatter(
                x=[duty.value], y=[100 * load.value], mode="markers", name=agent, legendgroup=agent,
                showlegend=agent not in named, marker={"color": look["color"], "symbol": look["symbol"], "size": 11},
                error_x=_error_bar([duty], 1.0, look["color"]), error_y=_error_bar([load], 100.0, look["color"]),
                hovertemplate=f"{agent}<br>duty cycle {duty.value:.2f} %<br>flap DEL "
                f"{format_estimate('blade_flap_del', load)}<extra></extra>", **place,
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
    """Mean of values (n,) over a centered window, ``half_width`` to either side, that shrinks at the ends."""
    return np.asarray(pd.Series(values).rolling(2 * half_width + 1, center=True, min_periods=1).mean())


def median_and_range(
    curves: list[tuple[NDArray[np.float64], NDArray[np.float64]]],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Steps that all of several curves (ascending steps, values) cover, and their median, least and greatest there."""
    steps = np.linspace(max(s[0] for s, _ in curves), min(s[-1] for s, _ in curves), _GRID)
    values = np.array([np.interp(steps, s, v) for s, v in curves])
    return steps, np.median(values, axis=0), values.min(axis=0), values.max(axis=0)


def learning_figure(evaluation: Evaluation, agents: list[str]) -> go.Figure:
    """Return and length of the training episodes against environment steps, of the seeds of one training.

    One seed: episodes as points, and their running mean. Several: the median of the running means, and their range.
    Where all episodes have the same length, that has no panel.
    """
    look = agent_styles(evaluation.agents)[agents[0]]
    line = {"color": look["color"], "width": 2}
    panels = dict(_PANELS)
    lengths = np.concatenate([_curve(evaluation.training[agent], _LENGTH)[1] for agent in agents])
    if np.ptp(lengths) <= _SAME_LENGTH:
        del panels[_LENGTH]
    figure = _panels(list(panels.values()), 0.14)
    for row, name in enumerate(panels, start=1):
        curves = [_curve(evaluation.training[agent], name) for agent in agents]
        smooth = [(steps, running_mean(values, max(1, len(values) // 12))) for steps, values in curves]
        place: dict[str, Any] = {"row": row, "col": 1}
        show = place | {"showlegend": row == 1}
        if len(agents) == 1:
            points = {"color": look["color"], "size": 4, "opacity": 0.35}
            figure.add_scatter(x=curves[0][0], y=curves[0][1], mode="markers", marker=points, name="episode", **show)
            middle, title = smooth[0], "running mean"
        else:
            steps, median, low, high = median_and_range(smooth)
            edge = {"mode": "lines", "line": {"width": 0}, "hoverinfo": "skip", "x": steps}
            name, color = f"range of {len(agents)} seeds", _faint(look["color"])
            figure.add_scatter(y=low, showlegend=False, **edge, **place)
            figure.add_scatter(y=high, fill="tonexty", fillcolor=color, name=name, **edge, **show)
            middle, title = (steps, median), "median of the seeds"
        figure.add_scatter(x=middle[0], y=middle[1], mode="lines", line=line, name=title, **show)
    if all(evaluation.training[agent].get("environment", {}).get("relative_reward") for agent in agents):
        figure.add_hline(  # rewards are differences to those of the base controller
            y=0.0, line=_rule(1.2), annotation_text="base controller",
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


def _faint(color: str) -> str:
    """Color ``#rrggbb`` at a fifth of its strength."""
    red, green, blue = (int(color[k : k + 2], 16) for k in (1, 3, 5))
    return f"rgba({red},{green},{blue},0.2)"
