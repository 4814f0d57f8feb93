"""Campbell diagrams: frequencies and damping of the modes against rotor speed or wind speed."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import ArrayLike
from scipy.optimize import isotonic_regression, linear_sum_assignment

from wt_gym.base.errors import SimulationError
from wt_gym.base.files import whole_file
from wt_gym.base.picture_style import BLUE, GREEN, INK, ORANGE, baseline, plain
from wt_gym.base.quantities import Array
from wt_gym.simulation.linear_model import Mode, RotorPoint, SteadyPoint
from wt_gym.simulation.linearization import LinearizedSimulator, linearize

if TYPE_CHECKING:
    from matplotlib.axes import Axes


RPM = np.pi / 30.0


@dataclass(frozen=True)
class CampbellDiagram:
    """Modes of a turbine over a series of operating points."""

    abscissa: str  #: "rotor_speed" or "wind_speed"
    wind_speed: Array
    rotor_speed: Array
    pitch: Array  #: wind_speed, rotor_speed, pitch: [m/s], [rad/s], collective pitch [rad]; arrays (n_points,)
    names: tuple[str, ...]  #: Modes, by their mean frequency, each named where its participation is clearest
    frequency: Array
    damping: Array
    """frequency, damping: damped frequency [Hz] and damping ratio [-]; NaN where a mode does not oscillate; arrays
    (n_modes, n_points)."""
    turbine: str = ""
    description: str = ""  #: turbine, description: for titles
    generator: str = "locked"  #: "locked", at constant speed, or "free", at constant torque
    rated: float = math.nan  #: Rated rotor speed [rad/s] or rated wind speed [m/s], as the abscissa; NaN if not known

    def rows(self) -> list[dict[str, float | str]]:
        """Tidy table, one dict for each mode at each point; wind_speed in m/s, others as their keys say."""
        return [
            {
                "wind_speed": float(self.wind_speed[i]),
                "rotor_speed_rpm": float(self.rotor_speed[i] / RPM),
                "pitch_deg": float(np.degrees(self.pitch[i])),
                "mode": name,
                "frequency_hz": float(self.frequency[k, i]),
                "damping_ratio": float(self.damping[k, i]),
            }
            for i in range(len(self.rotor_speed))
            for k, name in enumerate(self.names)
            if np.isfinite(self.frequency[k, i])
        ]

    def to_csv(self, path: str | PathLike[str]) -> None:
        """Write the tidy table."""
        rows = self.rows()
        with whole_file(Path(path)) as partial, partial.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, fieldnames=list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)

    def figure(self) -> Figure:
        """Frequencies with the rotor's harmonics, and damping below; families by color, whirls by line style."""
        return campbell_figure(self)


def campbell(  # noqa: PLR0913
    simulator: LinearizedSimulator,
    *,
    rotor_speeds: Sequence[float] | Array | None = None,
    wind_speeds: Sequence[float] | Array | None = None,
    schedule: Callable[[float], RotorPoint] | None = None,
    pitch: float = 0.0,
    aerodynamics: str | None = None,
    generator: str = "locked",
    n_azimuths: int = 6,
    on_point: Callable[[int, int], None] | None = None,
) -> CampbellDiagram:
    """Modes over rotor speed (structure alone) or over wind speed (in operation).

    Parameters
    ----------
    simulator : Simulator
        Three-bladed turbine.
    rotor_speeds : sequence of float, optional
        [rad/s]; the structure turns at the given pitch, without air unless ``aerodynamics`` says otherwise.
    wind_speeds : sequence of float, optional
        [m/s], with ``schedule``; quasi-steady aerodynamics unless ``aerodynamics`` says otherwise.
    schedule : callable, optional
        Wind speed [m/s] → object with ``rotor_speed`` [rad/s] and ``pitch`` [rad], for example
        ``wt_gym.control.operating_point`` for a turbine.
    pitch : float
        [rad], with ``rotor_speeds``.
    aerodynamics, generator, n_azimuths
        As for :func:`wt_gym.simulation.linearization.linearize`. "locked": the generator turns at constant
        speed.
    on_point : callable, optional
        Called with (number of points done, number of points).

    Raises
    ------
    SimulationError
        Unless exactly one of ``rotor_speeds`` and ``wind_speeds`` is given, the latter with a schedule.
    """
    values = wind_speeds if rotor_speeds is None else rotor_speeds
    if values is None or (rotor_speeds is not None and wind_speeds is not None):
        raise SimulationError("a Campbell diagram needs either rotor_speeds or wind_speeds")
    if wind_speeds is not None and schedule is None:
        raise SimulationError(
            "a Campbell diagram over wind speed needs a schedule: wind speed -> rotor speed and pitch"
        )
    if aerodynamics is None:
        aerodynamics = "none" if wind_speeds is None else "quasi_steady"
    points, tables = [], []
    for k, value in enumerate(values):
        speed, wind = float(value), None
        angle: ArrayLike = pitch
        if wind_speeds is not None and schedule is not None:
            place = schedule(value)
            speed, angle, wind = place.rotor_speed, place.pitch, float(value)
        model = linearize(
            simulator, wind_speed=wind, rotor_speed=float(speed), pitch=angle, aerodynamics=aerodynamics,
            generator=generator, multiblade=True, n_azimuths=n_azimuths, outputs=("rotor_speed",),
        )  # fmt: skip
        assert model.operating_point is not None  # it is found first
        points.append(model.operating_point)
        tables.append(_whirl_names(model.modes()))
        if on_point is not None:
            on_point(k + 1, len(values))
    abscissa = "rotor_speed" if wind_speeds is None else "wind_speed"
    return _assemble(simulator, abscissa, points, tables, aerodynamics, generator)


def _whirl_names(modes: Iterable[Mode]) -> dict[str, Mode]:
    """Modes of the structure by name; tilt and yaw modes at standstill begin the branches: the lower the regressive."""
    table = {mode.name: mode for mode in modes if not mode.name.startswith("radiation_")}
    for name in [n for n in table if n.endswith(" tilt")]:
        base = name.removesuffix(" tilt")
        pair = [table.pop(n) for n in (name, f"{base} yaw") if n in table]
        for branch, mode in zip(("regressive", "progressive"), sorted(pair, key=lambda m: m.frequency), strict=False):
            table[f"{base} {branch}"] = mode
    return table


def _branches(tables: Sequence[Mapping[str, Mode]]) -> list[list[tuple[str, Mode] | None]]:
    """Continue each mode of the last point towards the first; returns {name and mode, or None, per point} per branch.

    Two modes of neighboring points belong together when each has no part in the other modes of its neighbor,
    |w₁·v₂| |w₂·v₁| = 1 with the dual vectors w; an equal name counts too, for a rotor at standstill mixes the modes.
    """
    branches: list[list[tuple[str, Mode] | None]] = [[one] for one in tables[-1].items()]
    for table in reversed(tables[:-1]):
        length, new = len(branches[0]) if branches else 0, list(table.items())
        score = np.zeros((len(branches), len(new)))
        for r, branch in enumerate(branches):
            if branch[0] is not None:
                before, known = branch[0]
                score[r] = [
                    abs(known.dual @ mode.shape) * abs(mode.dual @ known.shape) + 0.3 * (name == before)
                    for name, mode in new
                ]
        pairs = {r: c for r, c in zip(*linear_sum_assignment(-score), strict=True) if score[r, c] > 0.3}
        for r, branch in enumerate(branches):
            branch.insert(0, new[pairs[r]] if r in pairs else None)
        branches += [[one, *[None] * length] for c, one in enumerate(new) if c not in pairs.values()]
    return branches


def _branch_names(branches: Sequence[Sequence[tuple[str, Mode] | None]]) -> list[str]:
    """Name of each branch: that which its modes have where their coordinates are clearest; no name is given twice.

    Where two frequencies come near each other, as those of a tower above rated speed, their modes mix and then swap
    their names. The branch continues, and its name is that of its clear points, whose share is at least 0.9 of the
    branch's greatest.
    """
    votes: list[dict[str, float]] = []
    for branch in branches:
        shares = [(name, _share(name, mode)) for name, mode in filter(None, branch)]
        clear = 0.9 * max(share for _, share in shares)
        votes.append({})
        for name, share in shares:
            votes[-1][name] = votes[-1].get(name, 0.0) + share * (share >= clear)
    known = list(dict.fromkeys(name for vote in votes for name in vote))
    score = np.array([[vote.get(name, 0.0) for name in known] for vote in votes])
    names = {r: known[c] for r, c in zip(*linear_sum_assignment(-score), strict=True) if score[r, c] > 0.0}
    taken = list(names.values())
    for r, vote in enumerate(votes):  # pieces of a branch that was lost between two points
        if r not in names:
            wanted = max(vote, key=lambda name: vote[name])
            taken.append(wanted)
            names[r] = f"{wanted} ({taken.count(wanted)})"
    return [names[r] for r in range(len(branches))]


def _share(name: str, mode: Mode) -> float:
    """Participation of the coordinates that a mode has its name from, see `_whirl_names`."""
    base, _, part = name.rpartition(" ")
    if part in ("regressive", "progressive"):
        return mode.participation[f"{base}_cosine"] + mode.participation[f"{base}_sine"]
    return mode.participation.get(name.replace(" collective", "_collective"), 0.0)  # "mode 7" has no coordinate


def _assemble(
    simulator: LinearizedSimulator,
    abscissa: str,
    points: Sequence[SteadyPoint],
    tables: Sequence[Mapping[str, Mode]],
    aerodynamics: str,
    generator: str,
) -> CampbellDiagram:
    branches = _branches(tables)
    names, nothing = _branch_names(branches), float("nan")
    frequency = np.array([[one[1].frequency if one else nothing for one in branch] for branch in branches])
    damping = np.array([[one[1].damping if one else nothing for one in branch] for branch in branches])
    order = np.argsort(np.nanmean(frequency, axis=1))
    turbine = simulator.turbine
    words = {"none": "structure without air", "frozen_wake": "in operation, whole wake frozen"}
    return CampbellDiagram(
        abscissa,
        np.array([p.wind_speed for p in points]),
        np.array([p.rotor_speed for p in points]),
        np.array([np.mean(p.pitch) for p in points]),
        tuple(names[k] for k in order),
        frequency[order],
        damping[order],
        simulator.turbine.heading,
        words.get(aerodynamics, "in operation, quasi-steady aerodynamics"),
        generator,
        turbine.drivetrain.rated_rotor_speed if abscissa == "rotor_speed" else turbine.rated_wind_speed,
    )


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


def spread(places: Sequence[float], distance: float, low: float, high: float) -> Array:
    """Places for labels, in the same order, at least a distance apart where there is room, and near the given ones.

    Parameters
    ----------
    places : sequence of float
        Where labels belong.
    distance : float
        Between neighbors; less if they do not fit.
    low, high : float
        Range of the labels.
    """
    order = np.argsort(places, kind="stable")
    count = len(order)
    if count == 0:
        return np.zeros(0)
    distance = min(distance, (high - low) / max(count - 1, 1))
    # least squares with a least distance: isotonic regression of the places less their least rises
    settled = isotonic_regression(np.asarray(places, dtype=np.float64)[order] - distance * np.arange(count)).x
    settled = np.clip(settled, low, high - distance * (count - 1)) + distance * np.arange(count)
    out = np.empty(count)
    out[order] = settled
    return out


def campbell_figure(diagram: CampbellDiagram) -> Figure:
    """Draw frequencies above and damping below, on an axis that spreads the lightly damped modes."""
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


def _harmonics(axes: Axes, x: Array, rotor_speed: Array, highest: float) -> None:
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


def _labels(axes: Axes, diagram: CampbellDiagram, values: Array) -> None:
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
