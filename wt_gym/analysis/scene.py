"""A turbine and its free wake as a drawing: smooth filaments, rotor disc, tower, ground and scale (matplotlib)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgb
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from wt_gym.analysis.results import trailing_strength
from wt_gym.base.picture_style import BLUE
from wt_gym.turbines import Turbine

if TYPE_CHECKING:
    from matplotlib.axes import Axes


_STEEL, _SUBMERGED, _BLADE, _LAND, _SEA = "#98a4af", "#c3ccd4", "#26323d", "#e9efe6", "#cfe3f1"
_TROUGH, _CREST, _MARK = "#a9c8de", "#eef5fa", "#5d6b78"
_HIGH_WAVE = 0.02
"""Height from the darkest to the lightest water, in rotor diameters."""
_PIECES = 5
"""Straight pieces that a segment of a filament is drawn in."""
_INBOARD, _OUTBOARD, _ROOT_WEIGHT = 0.55, 0.85, 0.25
"""Radii, in rotor radii, between which the weight of filaments rises from that of the root vortices to one."""
_FADE = 0.55
"""Share of the wake's length, at its end, over which the filaments fade out."""
_FAINTEST = 0.07
"""Weight below which a filament is not drawn."""
_NARROWEST, _WIDEST = 0.35, 1.9
"""Widths of the faintest and of the strongest filaments [points]."""


def smooth_curves(nodes: NDArray[np.float64], pieces: int = _PIECES) -> NDArray[np.float64]:
    """Curves (pieces n_rows + 1, n_blades, n_span + 1, 3) through the nodes (n_rows + 1, …) of filaments.

    They are cubic splines over the length of the outermost filaments, which all share: rows of an old wake are farther
    apart than new ones. Each ``pieces``-th point is a node.
    """
    nodes = np.asarray(nodes, dtype=np.float64)
    n_rows = len(nodes) - 1
    if n_rows < 2:  # too few for a curve
        return np.repeat(nodes, pieces, axis=0)[: pieces * n_rows + 1] if n_rows else nodes
    lengths = np.linalg.norm(np.diff(nodes[:, :, -1], axis=0), axis=-1).mean(axis=1)
    at = np.concatenate([[0.0], np.cumsum(np.maximum(lengths, 1e-9))])
    fine = np.interp(np.arange(pieces * n_rows + 1) / pieces, np.arange(n_rows + 1), at)
    return np.asarray(CubicSpline(at, nodes)(fine))


def filament_weights(
    circulation: NDArray[np.float64], nodes: NDArray[np.float64], hub: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Weight of each segment of a wake in the drawing, 0 to 1: by strength, tips before roots, fading with age.

    Parameters
    ----------
    circulation : numpy.ndarray, shape (n_rows, n_blades, n_span)
        Of the rings [m²/s].
    nodes : numpy.ndarray, shape (n_rows + 1, n_blades, n_span + 1, 3)
        [m]
    hub : numpy.ndarray, shape (3,)
        [m]

    Returns
    -------
    numpy.ndarray, shape (n_rows, n_blades, n_span + 1)
    """
    strength = trailing_strength(circulation)
    if not strength.size:
        return strength
    radius = np.linalg.norm(nodes[0] - hub, axis=-1)
    place = np.clip((radius / radius.max() - _INBOARD) / (_OUTBOARD - _INBOARD), 0.0, 1.0)
    outer = strength[:, place >= 1.0]
    share = np.clip(strength / max(float(np.quantile(outer, 0.98)), 1e-9), 0.0, 1.0)
    age = np.linspace(0.0, 1.0, len(strength))[:, None, None]
    fade = np.clip((1.0 - age) / _FADE, 0.0, 1.0)
    return np.asarray(share * (_ROOT_WEIGHT + (1.0 - _ROOT_WEIGHT) * place) * fade)


def line_look(weights: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Widths [points] and opacities (0 to 1) of filaments by their weights (0 to 1); both rise with the weight."""
    return _NARROWEST + (_WIDEST - _NARROWEST) * weights, np.clip(0.12 + 0.88 * weights, 0.0, 1.0)


@dataclass(frozen=True)
class Camera:
    """Parallel projection."""

    turn: float = np.radians(60.0)
    """Angle about the vertical between the line of sight and the wind: 0 looks downwind, π/2 from the right [rad]."""
    rise: float = np.radians(7.0)
    """Angle above the horizon [rad]."""

    def project(self, points: Any) -> NDArray[np.float64]:
        """Points (..., 3) on the picture (..., 2) [m]."""
        return self._seen(points)[..., :2]

    def depth(self, points: Any) -> NDArray[np.float64]:
        """Distance of points (..., 3) behind the origin along the line of sight [m]."""
        return self._seen(points)[..., 2]

    def _seen(self, points: Any) -> NDArray[np.float64]:
        """Points (..., 3) to the right, up and ahead."""
        c, s, level, up = np.cos(self.turn), np.sin(self.turn), np.cos(self.rise), np.sin(self.rise)
        axes = np.array([[s, -c, 0.0], [c * up, s * up, level], [c * level, s * level, -up]])
        return np.asarray(np.asarray(points, dtype=np.float64) @ axes.T)


class Scene:
    """Turbine and wake on matplotlib axes.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Filled whole; frame and ticks are taken off.
    turbine : Turbine
    camera : Camera
    length : float
        Distance downwind that is shown, in rotor diameters.
    color : str
        Of the wake.
    """

    def __init__(
        self, axes: Axes, turbine: Turbine, camera: Camera | None = None, length: float = 1.7, color: str = BLUE
    ):
        self._axes, self.camera, self._color = axes, camera or Camera(), to_rgb(color)
        self._diameter, self._hub_height = turbine.rotor_diameter, turbine.hub_height
        self._length = length * turbine.rotor_diameter
        axes.set_axis_off()
        axes.set_aspect("equal")
        self._at_sea = turbine.tower.support is not None or turbine.floater is not None
        self._ground(length)
        self._mooring = self._lines(0.5, colors=[_MARK], linewidths=0.8)
        self._submerged = self._polygons(_SUBMERGED, 0.6, alpha=0.8)
        self._behind, self._before = (self._lines(z, capstyle="round", joinstyle="round") for z in (1, 5))
        self._disc = self._polygons(color, 1.5, alpha=0.07)
        self._rim = self._lines(1.6, colors=[(*self._color, 0.35)], linewidths=0.7)
        self._steel = self._polygons(_STEEL, 2)
        self._blades = self._polygons(_BLADE, 4)
        self._frame(length)

    def draw(self, geometry: Mapping[str, NDArray[np.float64]]) -> None:
        """Show an instant, as given by ``Simulator.geometry()``."""
        project, hub = self.camera.project, np.asarray(geometry["hub"], dtype=np.float64)
        blades = project(geometry["blades"])
        self._blades.set_verts([np.concatenate([blade[0], blade[-1][::-1]]) for blade in blades])
        self._draw_disc(np.asarray(geometry["blades"], dtype=np.float64), hub)
        tower, radius = np.asarray(geometry["tower"]), np.asarray(geometry["tower_radius"])
        below, above = cut_at_sea_level(np.column_stack([tower, radius]))
        parts = [(below, above), *floating_parts(geometry)]
        self._submerged.set_verts([self._outline(part) for part, _ in parts if len(part)])
        shown = [self._outline(part) for _, part in parts if len(part)]
        self._steel.set_verts([*shown, self._nacelle(tower[-1], hub, float(radius[-1]))])
        self._mooring.set_segments([self.camera.project(line) for line in geometry.get("lines", ())])
        if "sea" in geometry:
            self._draw_sea(np.asarray(geometry["sea"]))
        self._draw_wake(geometry, hub, float(self.camera.depth(tower[-1])))

    def _draw_sea(self, nodes: NDArray[np.float64]) -> None:
        """Show the surface of the water from far to near, lighter where it is high."""
        corners = np.stack([nodes[:-1, :-1], nodes[1:, :-1], nodes[1:, 1:], nodes[:-1, 1:]], axis=2).reshape(-1, 4, 3)
        middle = corners.mean(axis=1)
        order = np.argsort(-self.camera.depth(middle))
        height = np.clip(0.5 + middle[order, 2] / (_HIGH_WAVE * self._diameter), 0.0, 1.0)[:, None]
        self._floor.set_verts(list(self.camera.project(corners[order])))
        self._floor.set(antialiased=False, facecolor=(1.0 - height) * to_rgb(_TROUGH) + height * to_rgb(_CREST))

    def _draw_wake(self, geometry: Mapping[str, NDArray[np.float64]], hub: NDArray[np.float64], depth: float) -> None:
        nodes = np.asarray(geometry["wake"], dtype=np.float64)
        weights = filament_weights(np.asarray(geometry["wake_circulation"]), nodes, hub)
        nodes = nodes[: len(weights) + 1]
        if len(nodes) < 2:
            self._behind.set_segments([])
            self._before.set_segments([])
            return
        curves = smooth_curves(nodes)
        weights = np.repeat(weights, _PIECES, axis=0)
        # one line for each segment between nodes, whose pieces join without gaps
        points = np.stack([curves[k : len(curves) - 1 : _PIECES] for k in range(_PIECES)] + [curves[_PIECES::_PIECES]])
        lines = np.moveaxis(points, 0, -2).reshape(-1, _PIECES + 1, 3)
        weight = weights[::_PIECES].ravel() * np.clip(2.0 * (1.0 - lines[:, 0, 0] / self._length), 0.0, 1.0)
        shown = weight > _FAINTEST
        lines, weight = lines[shown], weight[shown]
        far = self.camera.depth(lines.mean(axis=1)) > depth
        order = np.argsort(weight)  # the strongest on top
        for collection, chosen in ((self._behind, order[far[order]]), (self._before, order[~far[order]])):
            widths, opacities = line_look(weight[chosen])
            collection.set_segments(cast("Sequence[Any]", self.camera.project(lines[chosen])))
            collection.set_linewidth(cast("Any", widths))
            colors = np.column_stack([np.tile(self._color, (len(chosen), 1)), opacities])
            collection.set_color(cast("Any", colors))

    def _draw_disc(self, blades: NDArray[np.float64], hub: NDArray[np.float64]) -> None:
        """Circle of the tips: about the hub, through the mean distance of the tips, in the plane of two of them."""
        tips = 0.5 * (blades[:, 0, -1] + blades[:, -1, -1])
        normal = np.zeros(3)
        for k in range(len(tips)):
            normal += np.cross(tips[k - 1] - hub, tips[k] - hub)
        normal /= max(float(np.linalg.norm(normal)), 1e-12)
        center = tips.mean(axis=0) if len(tips) > 2 else hub + ((tips - hub) @ normal).mean() * normal
        radius = float(np.linalg.norm(tips - center, axis=1).mean())
        across = np.cross(normal, [0.0, 0.0, 1.0])
        across /= np.linalg.norm(across)
        upward = np.cross(across, normal)
        angle = np.linspace(0.0, 2.0 * np.pi, 73)
        rim = self.camera.project(center + radius * (np.outer(np.cos(angle), across) + np.outer(np.sin(angle), upward)))
        self._disc.set_verts([rim])
        self._rim.set_segments([rim])

    def _lines(self, zorder: float, **look: Any) -> LineCollection:
        collection = LineCollection([], zorder=zorder, **look)
        self._axes.add_collection(collection)
        return collection

    def _polygons(self, color: str, zorder: float, **look: Any) -> PolyCollection:
        collection = PolyCollection([], facecolors=color, edgecolors="none", zorder=zorder, **look)
        self._axes.add_collection(collection)
        return collection

    def _ground(self, length: float) -> None:
        """Ground or sea as a strip, with a mark of each half a diameter downwind."""
        d = self._diameter
        angle = np.linspace(0.0, 2.0 * np.pi, 120)
        center = 0.5 * (length - 0.3) * d
        ground = np.column_stack([center + (0.5 * length + 0.35) * d * np.cos(angle), 0.55 * d * np.sin(angle),
                                  0.0 * angle])  # fmt: skip
        self._floor = self._polygons(_SEA if self._at_sea else _LAND, 0, alpha=0.9)
        self._floor.set_verts([self.camera.project(ground)])
        marks = []
        for k in range(int(np.floor(2.0 * length)) + 1):
            half = 0.12 if k % 2 == 0 else 0.06
            marks.append(self.camera.project([[0.5 * k * d, -half * d, 0.0], [0.5 * k * d, half * d, 0.0]]))
            if k and k % 2 == 0:
                place = self.camera.project([0.5 * k * d, -0.17 * d, 0.0])
                text = f"1 D = {d:.0f} m" if k == 2 else f"{k // 2} D"
                self._axes.text(float(place[0]), float(place[1]), text, fontsize=8, color=_MARK, ha="center", va="top")
        marks.append(self.camera.project([[0.0, 0.0, 0.0], [0.5 * np.floor(2.0 * length) * d, 0.0, 0.0]]))
        self._axes.add_collection(LineCollection(marks, colors="#a9b5ad", linewidths=0.9, zorder=0.3))
        tail, head = self.camera.project([[-0.46 * d, 0.0, 0.0], [-0.33 * d, 0.0, 0.0]])
        look = {"arrowstyle": "-|>", "color": _MARK, "linewidth": 1.2, "shrinkA": 0.0, "shrinkB": 0.0}
        self._axes.annotate("", head, tail, arrowprops=look)
        self._axes.annotate("wind", tail, xytext=(0, 4), textcoords="offset points", fontsize=8, color=_MARK)

    def _frame(self, length: float) -> None:
        """Limits of the picture: rotor, ground and wake, in the proportions of the axes."""
        d, hub = self._diameter, self._hub_height
        corners = np.array([[x, y, z] for x in (-0.25 * d, length * d) for y in (-0.5 * d, 0.5 * d)
                            for z in (0.0, hub + 0.6 * d)])  # fmt: skip
        places = self.camera.project(corners)
        low, high = places.min(axis=0), places.max(axis=0)
        if self._at_sea:
            low[1] -= 0.2 * hub
        figure = self._axes.get_figure(root=True)
        assert figure is not None
        box, size = self._axes.get_position(original=True), figure.get_size_inches()
        shape = box.width * size[0] / (box.height * size[1])
        middle, extent = 0.5 * (low + high), high - low
        half_width = 0.5 * max(extent[0], shape * extent[1])
        self._axes.set_xlim(middle[0] - half_width, middle[0] + half_width)
        self._axes.set_ylim(middle[1] - half_width / shape, middle[1] + half_width / shape)

    def _outline(self, column: NDArray[np.float64]) -> NDArray[np.float64]:
        """Outline of a column (n, 4): points of its axis and its radii there."""
        axis = self.camera.project(column[:, :3])
        along = axis[-1] - axis[0]
        sides = column[:, 3:] * np.array([along[1], -along[0]]) / max(float(np.hypot(*along)), 1e-9)
        return np.concatenate([axis - sides, (axis + sides)[::-1]])

    def _nacelle(self, top: NDArray[np.float64], hub: NDArray[np.float64], half_height: float) -> NDArray[np.float64]:
        """Outline of the nacelle, from the hub to as far behind the tower."""
        behind = top + 1.4 * (top - hub) * np.array([1.0, 1.0, 0.0])
        front, back = self.camera.project(hub), self.camera.project(np.append(behind[:2], hub[2]))
        lift = np.array([0.0, 1.1 * half_height])
        return np.array([front - 0.6 * lift, front + 0.6 * lift, back + lift, back - lift])


def floating_parts(geometry: Mapping[str, NDArray[np.float64]]) -> list[tuple[Any, Any]]:
    """Parts below and above sea level of each member of a platform, see `cut_at_sea_level`."""
    parts = []
    for ends, radius in zip(geometry.get("platform", ()), geometry.get("platform_radius", ()), strict=True):
        column = np.column_stack([ends[np.argsort(ends[:, 2])], np.full(2, radius)])
        parts.append((column, column[:0]) if column[-1, 2] <= 0.0 else cut_at_sea_level(column))
    return parts


def cut_at_sea_level(column: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Parts below and above sea level of a column (n, 4) that ascends: points of its axis [m] and its radii there [m].

    They share the section at sea level; nothing is below where the column begins on the ground.
    """
    n = int(np.searchsorted(column[:, 2], 0.0))
    if n == 0:
        return column[:0], column
    lower, upper = column[n - 1], column[n]
    edge = lower + (upper - lower) * lower[2] / (lower[2] - upper[2])
    return np.vstack([column[:n], edge]), np.vstack([edge, column[n:]])
