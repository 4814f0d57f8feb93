"""One look for all matplotlib figures: colors that color-blind readers tell apart, with markers and line styles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
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
