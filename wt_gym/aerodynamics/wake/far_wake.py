"""The velocity of a semi-infinite vortex cylinder as a table: what lies behind the last row of a rotor wake."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ellipe, ellipkm1

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["cylinder_table", "ring_velocity"]


def ring_velocity(
    axial: NDArray[np.float64], radial: NDArray[np.float64], core: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Velocity of a vortex ring of unit radius and unit circulation.

    Parameters
    ----------
    axial, radial : ndarray
        Position relative to the ring's center, in ring radii.
    core : float
        Softening of the distance to the ring, in ring radii.

    Returns
    -------
    axial_velocity, radial_velocity : ndarray
        Positive axial velocity inside the ring (Lamb, Hydrodynamics, art. 161).
    """
    axial, radial = np.broadcast_arrays(axial, radial)
    far2 = (1.0 + radial) ** 2 + axial**2 + core**2
    near2 = (1.0 - radial) ** 2 + axial**2 + core**2
    k, e = ellipkm1(near2 / far2), ellipe(1.0 - near2 / far2)
    root = np.sqrt(far2)
    u = (k + (1.0 - radial**2 - axial**2 - core**2) / near2 * e) / (2.0 * np.pi * root)
    safe = np.maximum(radial, 1e-6)
    v = axial / safe * (-k + (1.0 + radial**2 + axial**2 + core**2) / near2 * e) / (2.0 * np.pi * root)
    return u, np.where(radial > 1e-6, v, 0.0)


@lru_cache(maxsize=2)
def cylinder_table(n_axial: int = 193, n_radial: int = 129, core: float = 0.05) -> NDArray[np.float32]:
    """Velocity of the cylinder r = 1, z > 0 with unit tangential vorticity per length.

    The rings of the cylinder are summed along z. Far upstream it acts as a sink of strength pi in its first disc;
    that closed form starts the sum.

    Returns
    -------
    table : ndarray, shape (2, n_axial, n_radial), float32
        Axial and radial velocity at z / (1 + |z|) evenly spaced over [-1, 1] and r / (1 + r) over [0, 1].
    """
    p = np.linspace(-1.0, 1.0, n_axial)
    q = np.linspace(0.0, 1.0, n_radial)
    limit = 0.998
    z_grid = np.clip(p, -limit, limit) / (1.0 - np.abs(np.clip(p, -limit, limit)))
    r_grid = (np.minimum(q, limit) / (1.0 - np.minimum(q, limit)))[:, None]
    # Between neighboring table lines a dozen steps, fine where the ring is near.
    steps = np.unique(np.concatenate([np.linspace(a, b, 13) for a, b in pairwise(z_grid)]))
    u, v = ring_velocity(steps, r_grid, core)
    dz = np.diff(steps)
    distance = np.sqrt(steps[0] ** 2 + r_grid**2)
    u0, v0 = -0.25 * steps[0] / distance**3, -0.25 * r_grid / distance**3
    sums = [
        np.concatenate([c0, c0 + np.cumsum(0.5 * (c[:, 1:] + c[:, :-1]) * dz, axis=1)], axis=1)
        for c, c0 in ((u, u0), (v, v0))
    ]
    at_grid = np.searchsorted(steps, z_grid - 1e-12)
    table = np.stack([s[:, at_grid].T for s in sums]).astype(np.float32)
    table[:, :, -1] = 0.0  # infinitely far from the axis
    table[:, 0] = 0.0  # infinitely far upstream
    table.setflags(write=False)
    return table
