"""Campbell diagrams: frequencies and damping of the modes against rotor speed or wind speed."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import linear_sum_assignment

from wt_gym.base.errors import SimulationError
from wt_gym.base.files import whole_file
from wt_gym.simulation.linear.linearization import linearize

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from os import PathLike

    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike, NDArray

    from wt_gym.simulation.linear.frozen_plant import LinearizedSimulator
    from wt_gym.simulation.linear.linear_model import Mode, RotorPoint, SteadyPoint

__all__ = ["CampbellDiagram", "campbell"]

RPM = np.pi / 30.0


@dataclass(frozen=True)
class CampbellDiagram:
    """Modes of a turbine over a series of operating points.

    Attributes
    ----------
    abscissa : str
        "rotor_speed" or "wind_speed".
    wind_speed, rotor_speed, pitch : arrays (n_points,)
        [m/s], [rad/s], collective pitch [rad].
    names : tuple of str
        Modes, by their mean frequency, each named where its participation is clearest.
    frequency, damping : arrays (n_modes, n_points)
        Damped frequency [Hz] and damping ratio [-]; NaN where a mode does not oscillate.
    turbine, description : str
        For titles.
    generator : str
        "locked", at constant speed, or "free", at constant torque.
    rated : float
        Rated rotor speed [rad/s] or rated wind speed [m/s], as the abscissa; NaN if not known.
    """

    abscissa: str
    wind_speed: NDArray[np.float64]
    rotor_speed: NDArray[np.float64]
    pitch: NDArray[np.float64]
    names: tuple[str, ...]
    frequency: NDArray[np.float64]
    damping: NDArray[np.float64]
    turbine: str = ""
    description: str = ""
    generator: str = "locked"
    rated: float = math.nan

    def rows(self) -> list[dict[str, float | str]]:
        """Tidy table: one dict for each mode at each point.

        Returns
        -------
        list of dict
            Keys wind_speed [m/s], rotor_speed_rpm, pitch_deg, mode, frequency_hz, damping_ratio.
        """
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
        """Frequencies with the rotor's harmonics, and damping below; families by color, whirls by line style.

        Returns
        -------
        matplotlib.figure.Figure
        """
        from wt_gym.simulation.linear.campbell_figure import campbell_figure

        return campbell_figure(self)


def campbell(
    simulator: LinearizedSimulator,
    *,
    rotor_speeds: Sequence[float] | NDArray[np.float64] | None = None,
    wind_speeds: Sequence[float] | NDArray[np.float64] | None = None,
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
        As for :func:`wt_gym.simulation.linear.linearization.linearize`. "locked": the generator turns at constant
        speed.
    on_point : callable, optional
        Called with (number of points done, number of points).

    Returns
    -------
    CampbellDiagram

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
    """Modes by name; the tilt and yaw modes at standstill begin the branches: the lower one the regressive."""
    table = {mode.name: mode for mode in modes}
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
        simulator.turbine.title,
        words.get(aerodynamics, "in operation, quasi-steady aerodynamics"),
        generator,
        turbine.drivetrain.rated_rotor_speed if abscissa == "rotor_speed" else turbine.rated_wind_speed,
    )
