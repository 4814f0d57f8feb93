"""Pictures for ``render()``: turbine and wake, and the recent course of the key signals (matplotlib, no display)."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from wt_gym.analysis.replay import trailing_strength

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from wt_gym.simulation import Signals
    from wt_gym.turbines import Turbine

__all__ = ["Renderer"]

_INK, _STEEL, _LINE, _LIMIT = "#1c2733", "#9aa7b3", "#0072B2", "#8a96a3"
_WAKE_COLORS = LinearSegmentedColormap.from_list("wake", ["#d3dde6", "#7fb2d6", "#0072b2", "#06213a"])
_WINDOW = 60.0
_RPM = 30 / np.pi


class Renderer:
    """Draws an environment.

    Parameters
    ----------
    turbine : Turbine
    width, height : int
        Size of the picture in pixels.
    """

    def __init__(self, turbine: Turbine, width: int = 960, height: int = 540):
        self._history: deque[tuple[float, ...]] = deque()
        self._arguments = turbine, width, height
        self._diameter, self._hub_height = turbine.rotor_diameter, turbine.hub_height
        self._figure = Figure(figsize=(width / 100, height / 100), dpi=100, facecolor="white")
        self._canvas = FigureCanvasAgg(self._figure)
        # Looking downwind from the right and a little from above.
        turn, rise = np.radians(50.0), np.radians(12.0)
        self._right = np.array([np.cos(turn), -np.sin(turn), 0.0])
        self._up = np.array([np.sin(turn) * np.sin(rise), np.cos(turn) * np.sin(rise), np.cos(rise)])
        self._build_scene(width, height)
        self._build_strips(turbine)

    def __getstate__(self) -> tuple[Any, ...]:
        """What a copy or a pickle takes along: figures can be made again, but not all can be copied."""
        return self._arguments, self._history

    def __setstate__(self, kept: tuple[Any, ...]) -> None:
        """Make the figure and take over the course of the signals."""
        arguments, history = kept
        Renderer.__init__(self, *arguments)
        self._history.extend(history)

    def reset(self) -> None:
        """Forget the course of the signals."""
        self._history.clear()

    def record(self, signals: Signals) -> None:
        """Take the signals of an instant."""
        row = (
            signals["time"], np.hypot(signals["wind_x"], signals["wind_y"]), signals["generator_power"] / 1e6,
            signals["rotor_speed"] * _RPM, np.degrees(signals["pitch_1"]), signals["tip_out_of_plane_1"],
        )  # fmt: skip
        self._history.append(row)
        while self._history[0][0] < row[0] - _WINDOW:
            self._history.popleft()

    def memory(self) -> tuple[tuple[float, ...], ...]:
        """Give the course of the signals, for `recall`."""
        return tuple(self._history)

    def recall(self, memory: Iterable[tuple[float, ...]]) -> None:
        """Continue with a course of the signals."""
        self._history = deque(memory)

    def draw(self, geometry: Mapping[str, np.ndarray] | None) -> np.ndarray:
        """Draw the turbine and the recorded signals.

        Parameters
        ----------
        geometry : mapping or None
            As given by ``Simulator.geometry()``; None leaves the turbine as it was drawn last.

        Returns
        -------
        numpy.ndarray, uint8, shape (height, width, 3)
        """
        if geometry is not None:
            self._draw_scene(geometry)
        self._draw_strips()
        self._canvas.draw()
        return np.array(self._canvas.buffer_rgba())[..., :3].copy()

    def _build_scene(self, width: int, height: int) -> None:
        axes = self._figure.add_axes((0.0, 0.0, 0.62, 1.0))
        axes.set_axis_off()
        axes.set_aspect("equal")
        size, center = self._diameter, self._project(np.array([0.4 * self._diameter, 0.0, 0.0]))
        bottom, top = -0.2 * self._hub_height, self._hub_height + 0.8 * size
        half_width = 0.5 * (top - bottom) * 0.62 * width / height
        axes.set_xlim(center[0] - half_width, center[0] + half_width)
        axes.set_ylim(bottom, top)
        angle = np.linspace(0.0, 2 * np.pi, 80)
        ground = 0.45 * size * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(80)])
        self._submerged = PolyCollection([], facecolors=_STEEL, edgecolors="none", alpha=0.5)
        axes.add_collection(self._submerged)
        color = "#e6ece4" if self._arguments[0].tower.support is None else "#cfe3f1cc"  # land, or a sea one looks into
        axes.add_collection(PolyCollection([self._project(ground)], facecolors=color, edgecolors="none"))
        self._wake = LineCollection([], cmap=_WAKE_COLORS)
        self._steel = PolyCollection([], facecolors=_STEEL, edgecolors="none")
        self._panels = PolyCollection([], facecolors="#f4f7fa", edgecolors="#1c2733", linewidths=0.8)
        for collection in (self._wake, self._steel, self._panels):
            axes.add_collection(collection)
        self._label = axes.text(0.04, 0.95, "", transform=axes.transAxes, color=_INK, fontsize=11, va="top")

    def _build_strips(self, turbine: Turbine) -> None:
        drivetrain = turbine.drivetrain
        rows = (
            ("Wind at the hub [m/s]", None),
            ("Electrical power [MW]", drivetrain.rated_power / 1e6),
            ("Rotor speed [rpm]", drivetrain.rated_rotor_speed * _RPM),
            ("Pitch of blade 1 [deg]", None),
            ("Tip deflection of blade 1 [m]", None),
        )
        self._strips = []
        for i, (title, limit) in enumerate(rows):
            axes = self._figure.add_axes((0.67, 0.835 - 0.19 * i, 0.31, 0.115))
            axes.set_title(title, loc="left", fontsize=9, color=_INK, pad=3)
            axes.tick_params(labelsize=8, colors=_INK, labelbottom=i == len(rows) - 1)
            axes.spines[["top", "right"]].set_visible(False)
            axes.grid(color="#dde3ea", linewidth=0.6)
            if limit is not None:
                axes.axhline(limit, color=_LIMIT, linewidth=0.8, linestyle="--")
            (line,) = axes.plot([], [], color=_LINE, linewidth=1.2)
            self._strips.append((axes, line, limit))
        axes.set_xlabel("Time [s]", fontsize=8, color=_INK, labelpad=1)

    def _draw_scene(self, geometry: Mapping[str, np.ndarray]) -> None:
        blades, wake = self._project(geometry["blades"]), self._project(geometry["wake"])
        corners = [blades[:, :-1, :-1], blades[:, :-1, 1:], blades[:, 1:, 1:], blades[:, 1:, :-1]]
        outlines = np.stack(corners, axis=-2).reshape(-1, 4, 2)
        self._panels.set_verts(cast("Sequence[Any]", outlines))

        tower, radius, hub = geometry["tower"], geometry["tower_radius"], geometry["hub"]
        nacelle = self._nacelle(np.asarray(tower)[-1], np.asarray(hub), float(radius[-1]))
        below, above = _cut_at_sea_level(np.column_stack([tower, radius]))
        self._submerged.set_verts([self._outline(below)] if len(below) else [])
        self._steel.set_verts([self._outline(above), nacelle])

        segments = np.stack([wake[:-1], wake[1:]], axis=-2)
        strength = trailing_strength(geometry["wake_circulation"])[: len(segments)]
        segments = segments[: len(strength)]
        share = strength / max(float(np.quantile(strength, 0.995)), 1e-9) if strength.size else strength
        self._wake.set_segments(cast("Sequence[Any]", segments.reshape(-1, 2, 2)))
        self._wake.set_array(np.clip(share, 0.0, 1.0).ravel())
        self._wake.set_linewidth(cast("Sequence[Any]", 0.3 + 1.3 * np.clip(share, 0.0, 1.0).ravel()))

    def _outline(self, column: np.ndarray) -> np.ndarray:
        """Outline of a column (n, 4): points of its axis and its radii there."""
        axis = self._project(column[:, :3])
        sides = np.column_stack([column[:, 3], np.zeros(len(column))])
        return np.concatenate([axis - sides, (axis + sides)[::-1]])

    def _nacelle(self, top: np.ndarray, hub: np.ndarray, half_height: float) -> np.ndarray:
        """Outline of the nacelle, from the hub to as far behind the tower."""
        behind = top + (top - hub) * np.array([1.0, 1.0, 0.0])
        front, back = self._project(hub), self._project(np.append(behind[:2], hub[2]))
        lift = np.array([0.0, 0.8 * half_height])
        return np.array([front - 0.6 * lift, front + 0.6 * lift, back + lift, back - lift])

    def _draw_strips(self) -> None:
        table = np.array(self._history)
        if not len(table):
            return
        time = table[:, 0]
        self._label.set_text(f"{time[-1]:.1f} s")
        for (axes, line, limit), values in zip(self._strips, table[:, 1:].T, strict=True):
            line.set_data(time, values)
            shown = values if limit is None else np.append(values, limit)
            low, high = float(shown.min()), float(shown.max())
            margin = max(0.08 * (high - low), 0.02 * abs(high), 0.05)
            axes.set_xlim(max(time[0], time[-1] - _WINDOW), max(time[-1], time[0] + 1.0))
            axes.set_ylim(low - margin, high + margin)

    def _project(self, points: np.ndarray) -> np.ndarray:
        """Parallel projection of points (..., 3) onto the picture (..., 2)."""
        points = np.asarray(points, dtype=np.float64)
        return np.stack([points @ self._right, points @ self._up], axis=-1)


def _cut_at_sea_level(column: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What of a column (n, 4) that ascends stands below sea level and what above."""
    n = int(np.searchsorted(column[:, 2], 0.0))
    if n == 0:
        return column[:0], column
    lower, upper = column[n - 1], column[n]
    edge = lower + (upper - lower) * lower[2] / (lower[2] - upper[2])
    return np.vstack([column[:n], edge]), np.vstack([edge, column[n:]])
