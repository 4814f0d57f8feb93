"""Viscous drag of a platform: Morison's drag of members, of heave plates, as points at which it acts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wt_gym.base.options import option, option_record
from wt_gym.base.quantities import Array
from wt_gym.hydrodynamics.record import Record, fail


@option_record
class DragMember(Record):
    """Straight cylinder with drag across its axis.

    The force per length is ½ ρ C_d D |v| v, with v the part of the velocity of the water relative to the member that is
    across its axis (Morison et al., Petroleum Transactions AIME 189 (1950) 149).
    """

    start: Array = option("one end in axes of the platform", unit="m", shape=(3,), low=-1e3, high=1e3)
    end: Array = option("other end", unit="m", shape=(3,), low=-1e3, high=1e3)
    diameter: float = option("diameter", unit="m", low=0, above=True, high=200)
    drag_coefficient: float = option("C_d, based on the diameter", unit="-", low=0, high=20)

    def check(self) -> None:
        """Check the length."""
        if np.linalg.norm(self.end - self.start) <= 0.0:
            raise fail("DragMember.end", self.end, "another point than the start")


@option_record
class HeavePlate(Record):
    """Plate with drag along its axis, F = ½ ρ C_d A |v| v at its middle."""

    position: Array = option("middle in axes of the platform", unit="m", shape=(3,), low=-1e3, high=1e3)
    axis: Array = option("normal; its length has no meaning", unit="-", shape=(3,), low=-1e3, high=1e3)
    area: float = option("area", unit="m^2", low=0, high=1e5)
    drag_coefficient: float = option("C_d of both sides together", unit="-", low=0, high=50)

    def check(self) -> None:
        """Check the axis."""
        if np.linalg.norm(self.axis) <= 0.0:
            raise fail("HeavePlate.axis", self.axis, "a vector with a length")


class DragPoints(NamedTuple):
    """Points at which drag acts, in axes of the platform."""

    position: Array
    """Shape (n, 3) [m]."""
    axis: Array
    """Unit vectors, shape (n, 3)."""
    across: Array
    """Force over the square of the velocity across the axis, ½ ρ C_d A, shape (n,) [kg/m]."""
    along: Array
    """The same along the axis."""


def drag_points(
    members: tuple[DragMember, ...], plates: tuple[HeavePlate, ...], density: float, spacing: float = 3.0
) -> DragPoints:
    """Return the points at which the drag of the wet part of members and plates acts.

    Parameters
    ----------
    members : tuple of DragMember
        Cut into equal pieces; the part above still water has no drag.
    plates : tuple of HeavePlate
    density : float
        Of the water [kg/m^3].
    spacing : float
        Longest piece [m].
    """
    rows: list[tuple[Array, Array, float, float]] = []
    for member in members:
        start, end = member.start, member.end
        if start[2] > end[2]:
            start, end = end, start
        if start[2] >= 0.0:
            continue
        if end[2] > 0.0:
            end = start + (end - start) * start[2] / (start[2] - end[2])
        length = float(np.linalg.norm(end - start))
        count = int(np.ceil(length / spacing - 1e-9))
        factor = 0.5 * density * member.drag_coefficient * member.diameter * length / count
        rows += [(start + (end - start) * (k + 0.5) / count, (end - start) / length, factor, 0.0) for k in range(count)]
    for plate in plates:
        if plate.position[2] < 0.0:
            axis = plate.axis / np.linalg.norm(plate.axis)
            rows.append((plate.position, axis, 0.0, 0.5 * density * plate.drag_coefficient * plate.area))
    n = len(rows)
    return DragPoints(
        np.array([row[0] for row in rows]).reshape(n, 3), np.array([row[1] for row in rows]).reshape(n, 3),
        np.array([row[2] for row in rows]), np.array([row[3] for row in rows]),
    )  # fmt: skip
