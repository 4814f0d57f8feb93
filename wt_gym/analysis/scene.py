"""Three-dimensional picture of rotor, tower and wake (plotly)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import plotly.graph_objects as go

from wt_gym.analysis.plots import FONT, INK

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["scene_figure", "trailing_strength"]

_STEEL, _BLADE, _LATTICE = "#c3ccd6", "#f2f5f8", "#51606e"
_LIGHT = {"ambient": 0.8, "diffuse": 0.45, "specular": 0.05, "roughness": 0.9}
_STRENGTH_SCALE = [[0.0, "#d3dde6"], [0.35, "#7fb2d6"], [0.7, "#0072b2"], [1.0, "#06213a"]]
# Strong filaments are drawn thicker; the limit is a share of the strongest.
_STRONG = 0.25


def trailing_strength(circulation: np.ndarray) -> np.ndarray:
    """Circulation of the trailing filaments between rings side by side.

    Parameters
    ----------
    circulation : numpy.ndarray, shape (n_rows, n_blades, n_span)
        Of the wake's rings [m^2/s].

    Returns
    -------
    numpy.ndarray, shape (n_rows, n_blades, n_span + 1)
        Magnitude of the difference across each filament [m^2/s].
    """
    padded = np.pad(np.asarray(circulation, dtype=np.float64), ((0, 0), (0, 0), (1, 1)))
    return np.abs(np.diff(padded, axis=2))


def scene_figure(geometry: Mapping[str, np.ndarray]) -> go.Figure:
    """Lattice surfaces of the blades, filaments of the wake, tower and nacelle.

    Parameters
    ----------
    geometry : mapping
        As given by ``Simulator.geometry()``: ``blades`` (n_blades, n_chord + 1, n_span + 1, 3), ``wake`` (n_rows,
        n_blades, n_span + 1, 3), ``wake_circulation`` (n_rows or n_rows - 1, n_blades, n_span), ``tower`` (n, 3),
        ``tower_radius`` (n,), ``hub`` (3,); metres, global frame.

    Returns
    -------
    plotly.graph_objects.Figure
    """
    blades, hub = np.asarray(geometry["blades"], dtype=float), np.asarray(geometry["hub"], dtype=float)
    tower, radius = np.asarray(geometry["tower"], dtype=float), np.asarray(geometry["tower_radius"], dtype=float)
    size = float(np.linalg.norm(blades[:, 0, -1] - hub, axis=1).max())
    traces = [
        *_wake(geometry),
        _tube(tower, radius, "Tower"),
        _tube(*_nacelle(tower, radius, hub), "Nacelle"),
        _sphere(hub, 0.75 * float(radius[-1])),
        *(_blade(blade) for blade in blades),
        _lattice_lines(blades),
        _ground(size),
    ]
    figure = go.Figure(traces)
    plain = {
        "showbackground": False, "gridcolor": "#e3e8ee", "zeroline": False, "showspikes": False,
        "tickfont": {"color": INK, "size": 11}, "title_font": {"color": INK, "size": 12},
    }  # fmt: skip
    figure.update_layout(
        height=640,
        autosize=True,
        margin={"l": 0, "r": 0, "t": 8, "b": 0},
        font={"family": FONT, "color": INK},
        paper_bgcolor="rgba(0,0,0,0)",
        showlegend=False,
        modebar={"bgcolor": "rgba(0,0,0,0)", "color": "#8a96a3", "activecolor": INK},
        scene={
            "domain": {"x": [0.0, 1.0], "y": [0.1, 1.0]},
            "xaxis": {**plain, "title": {"text": "downwind [m]"}},
            "yaxis": {**plain, "title": {"text": "left [m]"}},
            "zaxis": {**plain, "title": {"text": "height [m]"}},
            "aspectmode": "data",
            "camera": {"eye": {"x": -1.15, "y": -1.45, "z": 0.4}, "center": {"x": 0.0, "y": 0.0, "z": -0.1}},
            "dragmode": "orbit",
        },
    )
    return figure


def _wake(geometry: Mapping[str, np.ndarray]) -> list[go.Scatter3d]:
    """Trailing filaments, coloured by their circulation, the strong ones thicker."""
    wake = np.asarray(geometry["wake"], dtype=float)
    if wake.shape[0] < 2:
        return []
    strength = trailing_strength(geometry["wake_circulation"])
    if strength.shape[0] < wake.shape[0]:  # one ring less than rows of nodes: the last node ends the last ring
        strength = np.concatenate([strength, np.repeat(strength[-1:], wake.shape[0] - strength.shape[0], axis=0)])
    largest = float(np.quantile(strength, 0.995)) or 1.0
    strong = strength.max(axis=0) > _STRONG * largest
    traces = []
    for is_strong, width, opacity in ((False, 1.5, 0.35), (True, 3.5, 0.9)):
        chosen = strong == is_strong
        if not chosen.any():
            continue
        # (rows, filaments, 3) -> one line with gaps
        points, colours = wake[:, chosen], strength[:, chosen]
        gap = np.full((1, *points.shape[1:]), np.nan)
        line = np.concatenate([points, gap]).swapaxes(0, 1).reshape(-1, 3).astype(np.float32)
        colour = np.concatenate([colours, np.zeros((1, colours.shape[1]))]).T.reshape(-1).astype(np.float32)
        title = {"text": "Circulation of trailing filaments [m²/s]", "font": {"color": INK, "size": 12}, "side": "top"}
        bar = {
            "title": title, "orientation": "h", "thickness": 10, "len": 0.7, "x": 0.5, "y": 0.0, "yanchor": "bottom",
            "tickfont": {"color": INK, "size": 11},
        }  # fmt: skip
        traces.append(
            go.Scatter3d(
                x=line[:, 0], y=line[:, 1], z=line[:, 2], mode="lines", opacity=opacity, hoverinfo="skip",
                line={"color": colour, "colorscale": _STRENGTH_SCALE, "cmin": 0.0, "cmax": largest,
                      "width": width, "showscale": is_strong, "colorbar": bar},
            )
        )  # fmt: skip
    return traces


def _surface(x: np.ndarray, y: np.ndarray, z: np.ndarray, colour: str, name: str) -> go.Surface:
    """A surface of one colour."""
    return go.Surface(
        x=x.astype(np.float32), y=y.astype(np.float32), z=z.astype(np.float32), name=name, hoverinfo="name",
        surfacecolor=np.zeros(x.shape, dtype=np.float32), colorscale=[[0, colour], [1, colour]], showscale=False,
        lighting=_LIGHT, contours={"x": {"highlight": False}, "y": {"highlight": False}, "z": {"highlight": False}},
    )  # fmt: skip


def _blade(nodes: np.ndarray) -> go.Surface:
    """Camber surface of a blade; nodes (n_chord + 1, n_span + 1, 3)."""
    return _surface(nodes[..., 0], nodes[..., 1], nodes[..., 2], _BLADE, "Blade")


def _lattice_lines(blades: np.ndarray) -> go.Scatter3d:
    """Panel edges of all blades as one line with gaps."""
    gap = np.full((1, 3), np.nan)
    lines = []
    for blade in blades:
        lines += [np.concatenate([row, gap]) for row in blade]
        lines += [np.concatenate([column, gap]) for column in blade.swapaxes(0, 1)]
    points = np.concatenate(lines).astype(np.float32)
    return go.Scatter3d(
        x=points[:, 0], y=points[:, 1], z=points[:, 2], mode="lines", line={"color": _LATTICE, "width": 2},
        hoverinfo="skip",
    )  # fmt: skip


def _tube(axis: np.ndarray, radius: np.ndarray, name: str) -> go.Surface:
    """Surface of circular sections along a line; axis (n, 3), radius (n,)."""
    tangent = np.gradient(axis, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    # Any direction not along the tube serves to build the sections.
    helper = np.array([0.0, 1.0, 0.0])
    first = np.cross(tangent, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(tangent, first)
    angle = np.linspace(0.0, 2 * np.pi, 25)
    circle = np.cos(angle)[:, None, None] * first + np.sin(angle)[:, None, None] * second
    points = axis + radius[:, None] * circle
    return _surface(points[..., 0], points[..., 1], points[..., 2], _STEEL, name)


def _nacelle(tower: np.ndarray, radius: np.ndarray, hub: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Axis and radii of a nacelle from the hub through the tower axis and as far beyond, rounded at the ends."""
    towards = tower[-1] - hub
    towards[2] = 0.0
    station = np.array([0.12, 0.14, 0.25, 1.6, 2.0, 2.05])
    shape = np.array([0.0, 0.55, 0.9, 0.95, 0.7, 0.0])
    slope = np.array([0.0, 0.0, -0.02 * np.linalg.norm(towards)])
    return hub + station[:, None] * (towards + slope), shape * float(radius[-1])


def _sphere(centre: np.ndarray, radius: float) -> go.Surface:
    """A ball, for the hub."""
    polar, azimuth = np.meshgrid(np.linspace(0, np.pi, 13), np.linspace(0, 2 * np.pi, 25), indexing="ij")
    x = centre[0] + radius * np.sin(polar) * np.cos(azimuth)
    y = centre[1] + radius * np.sin(polar) * np.sin(azimuth)
    z = centre[2] + radius * np.cos(polar)
    return _surface(x, y, z, _STEEL, "Hub")


def _ground(size: float) -> go.Mesh3d:
    """A disc on the ground under the turbine."""
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    x, y = np.append(0.6 * size * np.cos(angle), 0.0), np.append(0.6 * size * np.sin(angle), 0.0)
    i = np.arange(60)
    return go.Mesh3d(
        x=x.astype(np.float32), y=y.astype(np.float32), z=np.zeros(61, dtype=np.float32), i=i, j=(i + 1) % 60,
        k=np.full(60, 60), color="#dfe7dc", opacity=0.6, hoverinfo="skip", flatshading=True,
    )  # fmt: skip
