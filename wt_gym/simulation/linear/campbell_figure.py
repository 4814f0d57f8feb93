"""The drawing of a Campbell diagram: modes told apart by name, family color and line style, labeled at their lines."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from wt_gym.base.picture_style import BLUE, GREEN, INK, ORANGE, baseline, plain

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

__all__ = ["Diagram", "campbell_figure", "mode_family", "mode_label", "spread"]

HARMONICS = (1, 2, 3, 4, 5, 6, 7, 8, 9)
FAMILIES = {
    "tower fore-aft": "#000000",
    "tower side-side": "#e69f00",
    "tower torsion": "#cc79a7",
    "blade flap": BLUE,
    "blade edge": ORANGE,
    "blade torsion": "#56b4e9",
    "drivetrain torsion": GREEN,
}
"""Colors of families of modes."""
WHIRLS: dict[str, Any] = {"collective": "-", "regressive": "--", "progressive": "-."}
"""Line styles of blade modes; others are solid."""
_GENERATORS = {"locked": "generator locked (constant speed)", "free": "generator free (constant torque)"}


class Diagram(Protocol):
    """What is drawn: the attributes of `wt_gym.simulation.linear.campbell.CampbellDiagram` that are used here."""

    @property
    def abscissa(self) -> str:
        """Either "rotor_speed" or "wind_speed"."""

    @property
    def wind_speed(self) -> NDArray[np.float64]:
        """Shape (n_points,) [m/s]."""

    @property
    def rotor_speed(self) -> NDArray[np.float64]:
        """Shape (n_points,) [rad/s]."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the modes."""

    @property
    def frequency(self) -> NDArray[np.float64]:
        """Shape (n_modes, n_points) [Hz]."""

    @property
    def damping(self) -> NDArray[np.float64]:
        """Damping ratios, shape (n_modes, n_points) [-]."""

    @property
    def turbine(self) -> str:
        """Its title."""

    @property
    def description(self) -> str:
        """What is linearized."""

    @property
    def generator(self) -> str:
        """Locked or free."""

    @property
    def rated(self) -> float:
        """On the abscissa [rad/s or m/s]."""


def mode_family(name: str) -> str:
    """Family of a mode, of `FAMILIES`; the name itself where it is of none.

    Parameters
    ----------
    name : str
        As of `CampbellDiagram.names`. Modes of blades end in how the three move together; a torsion that does not is
        that of the tower.
    """
    base, _, whirl = name.partition(" ")
    kind = base.rstrip("0123456789").rstrip("_")
    if kind == "shaft_torsion":
        return "drivetrain torsion"
    if kind in ("flap", "edge") or (kind == "torsion" and whirl):
        return f"blade {kind}"
    return {"fore_aft": "tower fore-aft", "side_side": "tower side-side", "torsion": "tower torsion"}.get(kind, name)


def mode_label(name: str) -> str:
    """Name of a mode for readers: "blade flap 1, regressive", "tower fore-aft 1".

    Parameters
    ----------
    name : str
        As of `CampbellDiagram.names`.
    """
    base, _, whirl = name.partition(" ")
    family, number = mode_family(name), base[len(base.rstrip("0123456789")) :]
    if family == name:
        return name.replace("_", " ")
    return " ".join(filter(None, (family, number))) + (f", {whirl}" if whirl else "")


def spread(places: Sequence[float], distance: float, low: float, high: float) -> NDArray[np.float64]:
    """Places for labels, in the same order, at least a distance apart where there is room, and near the given ones.

    Parameters
    ----------
    places : sequence of float
        Where labels belong.
    distance : float
        Between neighbors; less if they do not fit.
    low, high : float
        Range of the labels.

    Returns
    -------
    numpy.ndarray
    """
    order = np.argsort(places, kind="stable")
    count = len(order)
    if count == 0:
        return np.zeros(0)
    distance = min(distance, (high - low) / max(count - 1, 1))
    # least squares with a least distance: isotonic regression of the places less their least rises (pool neighbors)
    wanted = np.asarray(places, dtype=np.float64)[order] - distance * np.arange(count)
    pools: list[tuple[float, int]] = []
    for value in wanted:
        pools.append((float(value), 1))
        while len(pools) > 1 and pools[-2][0] > pools[-1][0]:
            (b, m), (a, n) = pools.pop(), pools.pop()
            pools.append(((a * n + b * m) / (n + m), n + m))
    settled = np.concatenate([np.full(n, value) for value, n in pools])
    settled = np.clip(settled, low, high - distance * (count - 1)) + distance * np.arange(count)
    out = np.empty(count)
    out[order] = settled
    return out


def campbell_figure(diagram: Diagram) -> Figure:
    """Draw frequencies above and damping below, on an axis that spreads the lightly damped modes.

    Parameters
    ----------
    diagram : Diagram

    Returns
    -------
    matplotlib.figure.Figure
    """
    by_rotor = diagram.abscissa == "rotor_speed"
    x = diagram.rotor_speed * 30.0 / np.pi if by_rotor else diagram.wind_speed
    rated = diagram.rated * 30.0 / np.pi if by_rotor else diagram.rated
    figure = Figure(figsize=(9.5, 9.5))
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(1.5, 1))
    figure.subplots_adjust(left=0.075, right=0.74, top=0.93, bottom=0.06, hspace=0.08)
    highest = 1.2 * float(np.nanmax(diagram.frequency))
    plain(top, "", "damped frequency [Hz]")
    plain(bottom, "rotor speed [rpm]" if by_rotor else "wind speed [m/s]", "damping ratio [%]")
    top.set_ylim(0.0, highest)
    bottom.set_yscale("symlog", linthresh=1.0, linscale=0.6)
    least = 100.0 * float(np.nanmin(diagram.damping))
    bottom.set_ylim(min(0.0, 1.3 * least), 100.0)
    ticks = [-10.0, -2.0, -1.0, 0.0, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0]
    bottom.set_yticks([t for t in ticks if t >= min(0.0, 1.3 * least)], minor=False)
    bottom.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    bottom.minorticks_off()
    if least < 0.0:
        bottom.axhspan(-100.0, 0.0, color=ORANGE, alpha=0.08, linewidth=0)
        bottom.annotate("unstable", (0.01, 0.0), xycoords=("axes fraction", "data"), fontsize=8, va="top", color=ORANGE)
    _harmonics(top, x, diagram.rotor_speed, highest)
    if math.isfinite(rated) and x.min() <= rated <= x.max():
        for axes, text in ((top, "rated"), (bottom, "")):
            baseline(axes, rated, text, vertical=True)
    marker = "o" if len(x) < 15 else None
    used: dict[str, None] = {}
    for name, frequency, damping in zip(diagram.names, diagram.frequency, diagram.damping, strict=True):
        family = mode_family(name)
        used[family] = None
        look = {
            "color": FAMILIES.get(family, INK), "linestyle": WHIRLS.get(name.rpartition(" ")[2], "-"), "linewidth": 1.6,
            "marker": marker, "markersize": 2.5,
        }  # fmt: skip
        top.plot(x, frequency, **look)
        bottom.plot(x, 100.0 * damping, **look)
    top.set_xlim(x.min(), x.max() if x.max() > x.min() else x.min() + 1.0)
    figure.canvas.draw()  # the places of labels depend on the size of the axes
    _labels(top, diagram, diagram.frequency)
    _labels(bottom, diagram, 100.0 * diagram.damping)
    handles = [Line2D([], [], color=INK, linestyle=style, label=name) for name, style in WHIRLS.items()]
    top.legend(handles=handles, title="blade modes", title_fontsize=8, fontsize=8, frameon=False, loc="upper left",
               handlelength=3.2)  # fmt: skip
    figure.text(0.075, 0.978, f"{diagram.turbine}", fontsize=11, color=INK, va="top")
    figure.text(0.075, 0.957, f"{diagram.description}; {_GENERATORS.get(diagram.generator, diagram.generator)}",
                fontsize=9, color=INK, va="top")  # fmt: skip
    return figure


def _harmonics(axes: Axes, x: NDArray[np.float64], rotor_speed: NDArray[np.float64], highest: float) -> None:
    """Multiples of the rotor speed, labeled where they leave the picture; those of the number of blades are darker."""
    fine = np.linspace(x.min(), x.max(), 400)
    speed = np.interp(fine, x, rotor_speed) / (2.0 * np.pi)
    for n in HARMONICS:
        line, chief = n * speed, n % 3 == 0 or n == 1
        axes.plot(fine, line, color="0.72" if chief else "0.86", linewidth=1.2 if chief else 0.7, zorder=0)
        inside = np.flatnonzero(line < 0.985 * highest)
        if not len(inside) or line[inside[-1]] <= 0.0:
            continue
        # along the last tenth of the line that is inside
        k = inside[-1] if inside[-1] < len(fine) - 1 else int(0.93 * (len(fine) - 1))
        axes.text(fine[k], line[k], f"{n}P", ha="center", va="center", fontsize=8, color="0.35" if chief else "0.55",
                  bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.8}, zorder=1.5)  # fmt: skip


def _labels(axes: Axes, diagram: Diagram, values: NDArray[np.float64]) -> None:
    """Names at the right of the lines, apart from each other, with a thin line to each."""
    ends = {}
    for name, row in zip(diagram.names, values, strict=True):
        known = np.flatnonzero(np.isfinite(row))
        if len(known):
            ends[name] = float(row[known[-1]])
    to_axes = axes.transData + axes.transAxes.inverted()
    places = [float(to_axes.transform((axes.get_xlim()[1], value))[1]) for value in ends.values()]
    figure = axes.get_figure(root=True)
    assert figure is not None
    height = axes.get_position().height * figure.get_size_inches()[1] * 72.0  # points
    for name, place, at in zip(ends, places, spread(places, 11.0 / height, 0.01, 0.99), strict=True):
        color = FAMILIES.get(mode_family(name), INK)
        axes.plot([1.0, 1.025, 1.03], [place, at, at], color=color, linewidth=0.7, alpha=0.7, transform=axes.transAxes,
                  clip_on=False)  # fmt: skip
        axes.text(1.037, at, mode_label(name), transform=axes.transAxes, fontsize=8.5, va="center", color=color)
