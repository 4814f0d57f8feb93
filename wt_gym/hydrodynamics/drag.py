"""Viscous drag of a platform: Morison's drag of members, of heave plates, as points at which it acts, and linear."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import erf

from wt_gym.base.options import option, option_record
from wt_gym.base.quantities import Array
from wt_gym.hydrodynamics.record import Record, fail


@option_record
class DragMember(Record):
    """Straight cylinder with drag across its axis.

    The force per length is ½ ρ C_d D |v| v, with v the part of the velocity of the water relative to the member that is
    across its axis (Morison et al., Petroleum Transactions AIME 189 (1950) 149). With C_d = 0 it is drawn only.
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

    position: Array  #: Shape (n, 3) [m].
    axis: Array  #: Unit vectors, shape (n, 3).
    across: Array  #: Force over the square of the velocity across the axis, ½ ρ C_d A, shape (n,) [kg/m].
    along: Array  #: The same along the axis.


def drag_points(
    members: tuple[DragMember, ...], plates: tuple[HeavePlate, ...], density: float, spacing: float = 3.0
) -> DragPoints:
    """Return the points at which the drag of the wet part of members and plates acts.

    Parameters
    ----------
    members : tuple of DragMember
        Cut into equal pieces; the part above still water has no drag, and those without any have no points.
    plates : tuple of HeavePlate
    density : float
        Of the water [kg/m^3].
    spacing : float
        Longest piece [m].
    """
    rows: list[tuple[Array, Array, float, float]] = []
    for member in members:
        start, end = sorted((member.start, member.end), key=lambda point: float(point[2]))
        if start[2] >= 0.0 or member.drag_coefficient == 0.0:  # without drag it is drawn only
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


def mean_square(mean: ArrayLike, deviation: ArrayLike) -> tuple[Array, Array]:
    """Mean of |v| v of a Gaussian velocity v over its mean U, and the derivative of that mean by U, both [m/s].

    E|v|v = (U² + σ²) erf(U / √2σ) + √(2/π) U σ exp(-U² / 2σ²) and its derivative 2 E|v| (R. N. Kazakov's equivalent
    gain; O. T. Gudmestad and J. J. Connor, Applied Ocean Research 5 (1983) 184). Without a mean both are √(8/π) σ
    (L. E. Borgman, J. Waterw. Harb. Div. ASCE 93 (1967) 129), without a deviation U and 2 U, at rest 0.

    Parameters
    ----------
    mean : array_like
        U [m/s], of any sign.
    deviation : array_like
        σ [m/s].
    """
    sigma = np.maximum(deviation, 1e-30)
    u = np.maximum(np.abs(mean), 1e-6 * sigma)
    within = erf(u / (math.sqrt(2.0) * sigma))
    beside = math.sqrt(2.0 / math.pi) * sigma * np.exp(-0.5 * (u / sigma) ** 2)
    return (u**2 + sigma**2) / u * within + beside, 2.0 * (u * within + beside)


def motion_of_points(position: Array) -> Array:
    """Matrices from the velocity of a body (6,) to those of points (n, 3), v + ω × r, shape (n, 3, 6)."""
    x, y, z = position.T
    zero = np.zeros_like(x)
    lever = np.array([[zero, z, -y], [-z, zero, x], [y, -x, zero]]).transpose(2, 0, 1)
    return np.concatenate([np.broadcast_to(np.eye(3), lever.shape), lever], axis=2)


class LinearDrag(NamedTuple):
    """Drag near a mean flow, force + transfer · (change of the water) - damping · (velocity of the platform)."""

    force: Array  #: Mean force and moment about the origin, shape (6,).
    damping: Array  #: Shape (6, 6).
    transfer: Array  #: Shape (6, n, 3).


def linear_drag(points: DragPoints, flow: Array, across: ArrayLike, along: ArrayLike) -> LinearDrag:
    """Return the drag of a platform at rest in a Gaussian flow, linear in what changes the flow, see `mean_square`.

    Parameters
    ----------
    points : DragPoints
        In any axes.
    flow : ndarray, shape (3,)
        Mean velocity of the water, the same axes [m/s].
    across, along : array_like, shape (n,)
        Standard deviations of the relative velocity across the axes, as if it were along the mean, and along [m/s].
    """
    outer = points.axis[:, :, None] * points.axis[:, None]
    along_flow = points.axis @ flow
    across_flow = flow - along_flow[:, None] * points.axis
    size = np.linalg.norm(across_flow, axis=1)
    direction = across_flow / np.maximum(size, 1e-30)[:, None]
    even, slope = (points.across * part for part in mean_square(size, across))
    lengthwise, steep = (points.along * part for part in mean_square(along_flow, along))
    resistance = even[:, None, None] * (np.eye(3) - outer) + steep[:, None, None] * outer
    resistance += (slope - even)[:, None, None] * direction[:, :, None] * direction[:, None]
    moved = motion_of_points(points.position)
    transfer = np.einsum("nij,nik->jnk", moved, resistance)
    force = even[:, None] * across_flow + (lengthwise * along_flow)[:, None] * points.axis
    return LinearDrag(np.einsum("nij,ni->j", moved, force), np.einsum("jnk,nkl->jl", transfer, moved), transfer)
