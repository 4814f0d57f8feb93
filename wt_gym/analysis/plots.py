"""Interactive figures of an evaluation (plotly)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from wt_gym.analysis.spectra import power_spectral_density

if TYPE_CHECKING:
    from collections.abc import Sequence

    import xarray as xr

    from wt_gym.analysis.results import Evaluation, Wind

    class _Compared(Protocol):
        """Results of several agents."""

        @property
        def agents(self) -> Sequence[str]: ...

    from typing import Any

    from numpy.typing import NDArray


__all__ = [
    "BETTER",
    "DARK_COLORS",
    "FONT",
    "INK",
    "MUTED",
    "agent_styles",
    "compact",
    "spectra_figure",
    "style",
    "time_series_figure",
    "titles_at_left",
]

FONT = "Inter, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"
INK, MUTED, GRID = "#1c2733", "#465462", "#dde3ea"

# Okabe & Ito (2008): told apart with every common color vision; the dashes help in print.
_COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
_DASHES = ("solid", "dash", "dot")
_AXIS, _PAPER, BETTER = "#8a96a3", "#ffffff", "#e4f3ec"
_SYMBOLS = ("circle", "diamond", "square", "triangle-up", "x", "star", "triangle-down")
_WIND_COLOR = "#5f6b76"
DARK_COLORS = {
    INK: "#e3e9ef", MUTED: "#9fadba", GRID: "#2c3742", _AXIS: "#6d7a87", _PAPER: "#182029", BETTER: "#16352c",
    _WIND_COLOR: "#93a1ad",
    **dict(zip(_COLORS, ("#45A5E0", "#F2813A", "#2CC295", "#DD97BD", "#8ACCF2", "#F0B437"), strict=True)),
}  # fmt: skip
"""What becomes of the colors of figures in a dark scheme; report.css has the same for the page."""
_RPM = 30 / np.pi


@dataclass(frozen=True)
class _Row:
    """A row of the time-series figure: title with unit, how to get the values, and a reference line."""

    title: str
    values: Callable[[xr.Dataset], NDArray[np.float64]]
    limit: Callable[[dict[str, float]], float | None]


def _largest_tip(run: xr.Dataset) -> NDArray[np.float64]:
    """Downwind deflection of the tip that is bent most [m]."""
    names = [name for name in run.data_vars if str(name).startswith("tip_out_of_plane_")]
    out: NDArray[np.float64] = np.max([run[name].values for name in names], axis=0)
    return out


_ROWS = (
    _Row("Wind speed at the hub [m/s]", lambda run: run["wind_x"].values, lambda _: None),
    _Row(
        "Electrical power [MW]",
        lambda run: run["generator_power"].values / 1e6,
        lambda limits: limits["rated_power"] / 1e6 if "rated_power" in limits else None,
    ),
    _Row(
        "Rotor speed [rpm]",
        lambda run: run["rotor_speed"].values * _RPM,
        lambda limits: limits["rated_rotor_speed"] * _RPM if "rated_rotor_speed" in limits else None,
    ),
    _Row("Pitch of blade 1 [deg]", lambda run: np.degrees(run["pitch_1"].values), lambda _: None),
    _Row("Generator torque [kN m]", lambda run: run["generator_torque"].values / 1e3, lambda _: None),
    _Row("Tip deflection downwind, largest of the blades [m]", _largest_tip, lambda _: None),
    _Row(
        "Tower-base fore-aft moment [MN m]", lambda run: run["tower_base_fore_aft_moment"].values / 1e6, lambda _: None
    ),
)


def agent_styles(evaluation: _Compared) -> dict[str, dict[str, str]]:
    """Color, dash and symbol of each agent, the same in every figure and table, and its swatch in a page."""
    n = len(_COLORS)
    return {
        agent: {
            "color": _COLORS[i % n],
            "swatch": f"var(--agent-{i % n})",
            "dash": _DASHES[i // n % len(_DASHES)],
            "symbol": _SYMBOLS[i % len(_SYMBOLS)],
        }
        for i, agent in enumerate(evaluation.agents)
    }


def _line(look: dict[str, str]) -> dict[str, Any]:
    """Line of an agent."""
    return {"color": look["color"], "dash": look["dash"], "width": 1.6}


def style(figure: go.Figure, height: int) -> go.Figure:
    """Apply fonts, colors and margins common to all figures."""
    figure.update_layout(
        template="plotly_white",
        height=height,
        autosize=True,
        margin={"l": 54, "r": 14, "t": 56, "b": 48},
        font={"family": FONT, "size": 13, "color": INK},
        legend={"orientation": "h", "x": 0, "xanchor": "left", "y": 1, "yanchor": "top", "yref": "container"},
        modebar={"bgcolor": "rgba(0,0,0,0)", "color": _AXIS, "activecolor": INK},
        paper_bgcolor="rgba(0,0,0,0)",
        plot_bgcolor=_PAPER,
        hoverlabel={"font": {"family": FONT, "size": 12, "color": INK}, "bgcolor": _PAPER},
    )  # fmt: skip
    axis = {
        "gridcolor": GRID,
        "zeroline": False,
        "linecolor": _AXIS,
        "ticks": "outside",
        "tickcolor": _AXIS,
        "tickfont": {"color": INK, "size": 12},
        "title_font": {"color": INK, "size": 13},
        "automargin": True,
    }
    figure.update_xaxes(**axis)
    figure.update_yaxes(**axis)
    figure.update_annotations(font={"family": FONT, "size": 13, "color": INK})
    return figure


def titles_at_left(figure: go.Figure) -> None:
    """Put the titles of subplots to the left, where a narrow screen has room for them."""
    for annotation in figure.layout.annotations:
        annotation.update(x=0, xanchor="left", xref="paper", yshift=2)


def time_series_figure(evaluation: Evaluation, wind: Wind) -> go.Figure:
    """Wind, power, rotor speed, pitch, torque, tip deflection and tower moment of all agents in one wind.

    The rows share their time axis: zooming one zooms all.
    """
    styles = agent_styles(evaluation)
    figure = make_subplots(
        rows=len(_ROWS), cols=1, shared_xaxes=True, vertical_spacing=0.032, subplot_titles=[row.title for row in _ROWS]
    )
    for agent in evaluation.agents:
        run = evaluation.run(agent, wind)
        time = run.data["time"].values
        step = float(time[1] - time[0]) if time.size > 1 else 0.0
        for i, row in enumerate(_ROWS, start=1):
            if i == 1 and agent != evaluation.agents[0]:
                continue  # all agents meet the same wind
            line = {"color": _WIND_COLOR, "width": 1.4} if i == 1 else _line(styles[agent])
            figure.add_trace(
                go.Scatter(
                    x0=float(time[0]), dx=step, y=compact(row.values(run.data)), mode="lines", line=line,
                    name="wind" if i == 1 else agent, legendgroup=agent, showlegend=i == 2, hovertemplate="%{y:.4g}",
                ),
                row=i, col=1,
            )  # fmt: skip
        if not run.complete:
            figure.add_vline(
                x=run.duration, line={"color": styles[agent]["color"], "width": 1, "dash": "dot"}, row="all", col=1
            )
    for i, row in enumerate(_ROWS, start=1):
        limit = row.limit(evaluation.limits)
        if limit is not None:
            figure.add_hline(y=limit, line={"color": MUTED, "width": 1, "dash": "dash"}, row=i, col=1)
    titles_at_left(figure)
    style(figure, height=1180)
    figure.update_layout(hovermode="x unified", hoversubplots="axis")
    figure.update_xaxes(title_text="Time [s]", row=len(_ROWS), col=1)
    return figure


def spectra_figure(evaluation: Evaluation, skip: float) -> go.Figure:
    """Power spectral density of blade-root and tower-base moments, mean over the complete runs of each agent."""
    rows = (
        ("Blade root, flapwise moment", "root_flap_moment_1"),
        ("Blade root, edgewise moment", "root_edge_moment_1"),
        ("Tower base, fore-aft moment", "tower_base_fore_aft_moment"),
        ("Tower base, side-side moment", "tower_base_side_side_moment"),
    )
    styles = agent_styles(evaluation)
    figure = make_subplots(
        rows=len(rows), cols=1, shared_xaxes=True, vertical_spacing=0.05,
        subplot_titles=[f"{title} [(MN m)²/Hz]" for title, _ in rows],
    )  # fmt: skip
    for agent in evaluation.agents:
        spectra = _mean_spectra(evaluation, agent, [name for _, name in rows], skip)
        for i, (_, name) in enumerate(rows, start=1):
            if name not in spectra:
                continue
            frequency, density = spectra[name]
            figure.add_trace(
                go.Scatter(
                    x=compact(frequency), y=compact(density / 1e12), mode="lines",
                    line=_line(styles[agent]), name=agent, legendgroup=agent, showlegend=i == 1,
                    hovertemplate="%{y:.3g}",
                ),
                row=i, col=1,
            )  # fmt: skip
    for multiple, rotor_frequency in _rotor_frequencies(evaluation):
        figure.add_vline(x=rotor_frequency, line={"color": MUTED, "width": 1, "dash": "dot"}, row="all", col=1)
        figure.add_annotation(
            x=np.log10(rotor_frequency),
            y=1,
            xref="x",
            yref="y domain",
            text=multiple,
            showarrow=False,
            yanchor="bottom",
        )
    _title_at_left_of_first(figure, len(rows))
    style(figure, height=1000)
    ticks = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10]
    figure.update_xaxes(type="log", tickvals=ticks, ticktext=[f"{tick:g}" for tick in ticks])
    figure.update_yaxes(type="log", exponentformat="power", dtick=2)
    figure.update_xaxes(title_text="Frequency [Hz]", row=len(rows), col=1)
    return figure


def _title_at_left_of_first(figure: go.Figure, count: int) -> None:
    """Put the first ``count`` annotations, the titles, to the left."""
    for annotation in figure.layout.annotations[:count]:
        annotation.update(x=0, xanchor="left", xref="paper", yshift=2)


def _mean_spectra(
    evaluation: Evaluation, agent: str, names: list[str], skip: float
) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Frequency and mean density of each signal over the complete runs of an agent."""
    found: dict[str, list[tuple[NDArray[np.float64], NDArray[np.float64]]]] = {}
    for run in evaluation.runs_of(agent):
        time = run.data["time"].values
        kept = time >= time[0] + skip - 1e-9
        if not run.complete or np.count_nonzero(kept) < 64:
            continue
        step = float(np.diff(time).mean())
        for name in names:
            found.setdefault(name, []).append(power_spectral_density(run.data[name].values[kept], step))
    return {name: (spectra[0][0], np.mean([s[1] for s in spectra], axis=0)) for name, spectra in found.items()}


def _rotor_frequencies(evaluation: Evaluation) -> list[tuple[str, float]]:
    """Once and three times the mean rotational frequency of the baseline [Hz]."""
    runs = evaluation.runs_of(evaluation.baseline)
    rotation = float(np.mean([run.data["rotor_speed"].values.mean() for run in runs])) / (2 * np.pi)
    return [("1P", rotation), ("3P", 3 * rotation)]


def compact(values: NDArray[np.float64]) -> NDArray[np.float32]:
    """float32 copy: half the size in the page, more digits than a screen shows."""
    return np.asarray(values, dtype=np.float32)
