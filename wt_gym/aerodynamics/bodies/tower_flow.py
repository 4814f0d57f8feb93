"""The tower in the flow: potential flow past a slender cylinder, felt by the blades in front of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wt_gym.aerodynamics.bodies import tower_kernels
from wt_gym.aerodynamics.errors import AerodynamicsError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = ["TowerFlow", "tower_perturbation"]


class TowerFlow:
    """Velocity that a tower adds to the wind.

    At each height the tower is an infinite cylinder of the local diameter: with a the radius, r the vector from the
    axis and V the wind across the axis, v = a^2/r^2 (V - 2 (V . r) r / r^2) (doublet in a uniform stream, e.g. Katz &
    Plotkin, Low-Speed Aerodynamics, section 3.11). It fades over one radius beyond each end. Inside the tower, which
    no blade reaches before the simulation ends, the value of the surface holds.

    Parameters
    ----------
    base : array_like, shape (3,)
        Lower end of the tower axis [m].
    stations : array_like, shape (n,)
        Increasing distances from the base at which diameters are given [m].
    diameters : array_like, shape (n,)
        Outer diameters [m].

    Raises
    ------
    AerodynamicsError
        If the diameters are not positive at increasing stations.
    """

    def __init__(self, base: ArrayLike, stations: ArrayLike, diameters: ArrayLike) -> None:
        base, stations, diameters = (np.array(x, dtype=np.float64) for x in (base, stations, diameters))
        if base.shape != (3,) or not np.isfinite(base).all():
            raise AerodynamicsError(f"the tower base is {base}; must be three finite coordinates [m]")
        increasing = stations.ndim == 1 and stations.size and bool(np.all(np.diff(stations) > 0.0))
        if not increasing or stations.shape != diameters.shape or not np.all(diameters > 0.0):
            raise AerodynamicsError(f"tower diameters {diameters} must be positive, at increasing stations {stations}")
        self.base, self.stations, self.radii = base, stations, 0.5 * diameters

    def add(self, points: NDArray[np.float64], wind: NDArray[np.float64], top: NDArray[np.float64]) -> None:
        """Add the flow past the tower to the wind, in place.

        Parameters
        ----------
        points : ndarray, shape (..., 3)
            Where the wind is felt [m]; float64, contiguous.
        wind : ndarray, shape (..., 3)
            Undisturbed wind there [m/s], changed; float64, contiguous.
        top : ndarray, shape (3,)
            Upper end of the tower axis [m].

        Raises
        ------
        AerodynamicsError
            If base and top coincide, or the wind is not contiguous and could not be changed in place.
        """
        if not wind.flags.c_contiguous:
            raise AerodynamicsError(f"the wind, with strides {wind.strides}, must be contiguous")
        flat = wind.reshape(-1, 3)
        if not tower_kernels.add_tower_flow(points.reshape(-1, 3), flat, self.base, top, self.stations, self.radii):
            raise AerodynamicsError(f"the tower top must be above its base, got base {self.base} and top {top}")


def tower_perturbation(
    points: ArrayLike, wind: ArrayLike, base: ArrayLike, top: ArrayLike, stations: ArrayLike, diameters: ArrayLike
) -> NDArray[np.float64]:
    """Velocity that a tower adds to the wind, for a single use: see `TowerFlow`, which checks its tower only once.

    Parameters
    ----------
    points, wind : ndarray, shape (..., 3)
        Where the wind is felt [m] and the undisturbed wind there [m/s].
    base, top : array_like, shape (3,)
        Ends of the tower axis [m].
    stations, diameters : array_like, shape (n,)
        Outer diameters at increasing distances from the base [m].

    Returns
    -------
    velocity : ndarray, shape (..., 3)
        To be added to the wind [m/s].

    Raises
    ------
    AerodynamicsError
        If base and top coincide or the diameters are not positive at increasing stations.
    """
    undisturbed = np.asarray(wind, dtype=np.float64)
    disturbed = undisturbed.copy()
    TowerFlow(base, stations, diameters).add(
        np.ascontiguousarray(points, dtype=np.float64), disturbed, np.asarray(top, dtype=np.float64)
    )
    return disturbed - undisturbed
