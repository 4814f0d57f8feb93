"""Static polars split into attached and fully separated flow, the tables of the dynamic stall model.

The flow about a section is a mixture: attached up to the separation point, f chords behind the leading edge (f = 1 at
the trailing edge), separated behind it. In Kirchhoff's flow past a flat plate the lift is cl = cla (alpha - alpha0)
((1 + sqrt f) / 2)^2. Solved for f, this gives the static separation point fst(alpha) of any polar, and what remains is
the lift of fully separated flow: cl_st = fst cla (alpha - alpha0) + (1 - fst) cl_fs (Oeye, 4th IEA Symposium on the
Aerodynamics of Wind Turbines, 1991; Hansen, Gaunaa & Madsen, Risoe-R-1354, 2004).

Polars that lose their lift within a few degrees fall faster than Kirchhoff's flow: then cl_fs would fall, too, at once.
A circulation, which cannot follow at once, would belong to several angles of attack, and the lattice, the more so the
finer its steps, would jump from one to the other. Such a fall is therefore given to the separation point: cl_fs is
replaced by the largest lift below it that does not fall with the angle, and fst follows from the polar.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wt_gym.base.attached_flow import attached_lift

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = ["separation_tables"]

FADE = np.radians([40.0, 50.0])
"""Distances from the angle of zero lift between which attached flow goes over into the static polar [rad]. Beyond, no
boundary layer can hold on; as in AeroDyn, whose unsteady model ends at 45 degrees."""


def separation_tables(polars: ArrayLike, monotone: bool = True) -> NDArray[np.float64]:
    """Tables of the dynamic stall model on the angles of the polars.

    Parameters
    ----------
    polars : array_like, shape (n_span, n_alpha, 3)
        cl, cd, cm at angles of attack evenly spaced from -pi (included) to pi (excluded).
    monotone : bool
        The lift of fully separated flow does not fall with the angle of attack; False: as published.

    Returns
    -------
    ndarray, shape (n_span, n_alpha, 4)
        Lift coefficient of attached flow, of fully separated flow, static separation point [chords], and drag
        coefficient above that at zero lift. The mixture of the two lifts at the static separation point is the polar.
    """
    polars = np.asarray(polars, dtype=np.float64)
    n_alpha = polars.shape[1]
    if n_alpha == 0:
        return np.zeros((len(polars), 0, 4))
    alpha = -np.pi + 2.0 * np.pi / n_alpha * np.arange(n_alpha)
    return np.array([_table(alpha, polar[:, 0], polar[:, 1], monotone) for polar in polars])


def _table(
    alpha: NDArray[np.float64], cl: NDArray[np.float64], cd: NDArray[np.float64], monotone: bool
) -> NDArray[np.float64]:
    """Columns (n_alpha, 4) of one section."""
    line = attached_lift(alpha, cl)
    if line is None:
        return np.column_stack([cl, cl, np.zeros_like(cl), np.zeros_like(cl)])
    alpha0, slope = line
    arm = alpha - alpha0
    potential = slope * arm
    share = np.clip((FADE[1] - np.abs(arm)) / (FADE[1] - FADE[0]), 0.0, 1.0)
    ratio = np.divide(cl, potential, out=np.ones_like(cl), where=np.abs(arm) > 1e-9)
    root = np.clip(2.0 * np.sqrt(np.maximum(ratio, 0.0)) - 1.0, 0.0, 1.0)
    root[~_connected(root > 0.0, int(np.searchsorted(alpha, alpha0)))] = 0.0
    root[share == 0.0] = 0.0
    # No steeper than the polar, which is attached where it lies above the line: on the side of negative lift it may.
    attached = np.where(root == 1.0, cl, potential)
    separated = np.where(root == 0.0, cl, attached * (1.0 + 3.0 * root) / (4.0 * (1.0 + root)))
    point = root**2
    if monotone:
        limit = _without_fall(separated, arm)
        point = np.where(limit == separated, point, (cl - limit) / np.where(attached == limit, 1.0, attached - limit))
        separated = limit
    attached, separated = (share * lift + (1.0 - share) * cl for lift in (attached, separated))
    return np.column_stack([attached, separated, point, share * (cd - np.interp(alpha0, alpha, cd))])


def _connected(within: NDArray[np.bool_], center: int) -> NDArray[np.bool_]:
    """Entries of ``within`` (n,) that hold from index ``center`` outwards without a gap."""
    below, above = within[:center][::-1], within[center:]
    return np.concatenate([np.logical_and.accumulate(below)[::-1], np.logical_and.accumulate(above)])


def _without_fall(lift: NDArray[np.float64], arm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Largest lift not above ``lift`` (n,) that grows with the distance ``arm`` from zero lift; both sides alike."""
    limit = lift.copy()
    for side in (1.0, -1.0):
        within = np.flatnonzero((side * arm >= 0.0) & (side * arm <= FADE[0]))[:: int(side)]  # outwards
        limit[within] = side * np.minimum.accumulate(side * lift[within][::-1])[::-1]
    return limit
