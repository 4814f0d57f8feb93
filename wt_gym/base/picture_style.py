"""One look for all matplotlib figures: colors that color-blind readers tell apart, with markers and line styles."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

INK, GRAY, GRID = "#1c2733", "#8a96a3", "#dde3ea"
BLUE, ORANGE, GREEN = "#0072b2", "#d55e00", "#009e73"
COLORS = (BLUE, ORANGE, GREEN, "#cc79a7", "#e69f00", "#56b4e9", "#000000")
"""Those of Okabe and Ito, by decreasing contrast with white; yellow is left out."""
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
LINE_STYLES: tuple[Any, ...] = ("-", "--", "-.", ":", (0, (6, 1.5, 1, 1.5, 1, 1.5)), (0, (8, 3)), (0, (1, 2.5)))
SVG: dict[Any, Any] = {"svg.fonttype": "none", "font.family": "sans-serif", "path.simplify_threshold": 0.3}
"""Settings of matplotlib for small drawings whose text stays text."""


def plain(axes: Axes, x_label: str = "", y_label: str = "", title: str = "") -> None:
    """Axes with a light grid, without a frame at the top and at the right.

    Labels have the unit in brackets; the title stands at the left, above.
    """
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(GRAY)
    axes.grid(color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8, colors=INK, length=3)
    axes.set_xlabel(x_label, fontsize=9, color=INK)
    axes.set_ylabel(y_label, fontsize=9, color=INK)
    if title:
        axes.set_title(title, loc="left", fontsize=10, color=INK)


def baseline(axes: Axes, value: float, text: str = "", vertical: bool = False) -> None:
    """Dashed line of the baseline at a value of the y axis, or of the x axis if ``vertical``, named at its end."""
    line = axes.axvline if vertical else axes.axhline
    line(value, color=GRAY, linewidth=1.0, linestyle=(0, (5, 3)), zorder=0.5)
    if not text:
        return
    if vertical:
        axes.annotate(text, (value, 1.0), xycoords=("data", "axes fraction"), xytext=(3, -3), va="top",
                      textcoords="offset points", fontsize=8, color=GRAY, rotation=90)  # fmt: skip
    else:
        axes.annotate(text, (1.0, value), xycoords=("axes fraction", "data"), xytext=(0, 2), ha="right",
                      textcoords="offset points", fontsize=8, color=GRAY)  # fmt: skip


_PLACES = (
    (6, 8), (6, -8), (-6, 8), (-6, -8), (7, 0), (-7, 0), (0, 11), (0, -11), (10, 15), (10, -15), (-10, 15), (-10, -15),
    (14, 22), (14, -22), (-14, 22), (-14, -22), (22, 32), (22, -32), (-22, 32), (-22, -32),
)  # fmt: skip
"""Offsets of labels from their points that are tried, in this order [points]."""


def label_points(
    axes: Axes, points: Sequence[tuple[float, float]], texts: Sequence[str], colors: Sequence[str], size: float = 8.0
) -> list[Any]:
    """Write a name at each point, beside the points and the other names where there is room.

    The limits of the axes must be those of the finished picture. All points stay visible; those beyond the number of
    texts have no name. A name that had to go far has a line to its point. The size of the font is in points.
    """
    figure = axes.get_figure(root=True)
    assert figure is not None
    figure.canvas.draw()  # layout and the sizes of texts
    scale = figure.dpi / 72.0
    frame = axes.get_window_extent()
    there = [axes.transData.transform(point) for point in points]
    taken: list[tuple[float, float, float, float]] = []
    written = []
    for k, (text, color) in enumerate(zip(texts, colors, strict=True)):
        best = axes.annotate(
            text, points[k], xytext=(0, 0), textcoords="offset points", fontsize=size, color=color, va="center"
        )
        extent = best.get_window_extent()
        width, half = extent.width, 0.5 * extent.height
        ratings = []
        for rank, (x, y) in enumerate(_PLACES):
            left = there[k][0] + x * scale - (0.0 if x > 0 else width if x < 0 else 0.5 * width)
            middle = there[k][1] + y * scale
            box = left, middle - half, left + width, middle + half
            covered = sum(box[0] < t[2] and t[0] < box[2] and box[1] < t[3] and t[1] < box[3] for t in taken)
            covered += sum(
                box[0] - 3 * scale < at[0] < box[2] + 3 * scale and box[1] - 2 * scale < at[1] < box[3] + 2 * scale
                for j, at in enumerate(there)
                if j != k
            )
            outside = box[0] < frame.x0 or box[2] > frame.x1 + 2 or box[1] < frame.y0 or box[3] > frame.y1
            ratings.append((covered + 2 * outside + 0.01 * rank, rank, box))
        _, rank, box = min(ratings)
        x, y = _PLACES[rank]
        best.set_horizontalalignment("left" if x > 0 else "right" if x < 0 else "center")
        best.xyann = (x, y)
        taken.append(box)
        if math.hypot(*best.xyann) > 12.0:
            axes.annotate("", points[k], xytext=best.xyann, textcoords="offset points",
                          arrowprops={"arrowstyle": "-", "color": color, "linewidth": 0.6, "shrinkA": 0})  # fmt: skip
        written.append(best)
    return written
