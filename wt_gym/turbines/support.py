"""What stands under a tower at sea: a monopile in the water on its foundation."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wt_gym.turbines.beam import BeamStations
from wt_gym.turbines.checks import (
    ArrayRecord,
    check_array,
    check_ascending,
    check_number,
    check_span,
    check_symmetric,
    fail,
)

__all__ = ["SEA_WATER", "Support"]

SEA_WATER = 1025.0
"""Density of sea water [kg/m^3]."""


@dataclass(frozen=True, eq=False, repr=False)
class Support(ArrayRecord):
    """Monopile between the sea bed and the base of a tower: one beam with it, in its frame.

    The sea has no waves and no current: what is in it moves the water around it, and that is all. A cylinder that
    moves across its axis carries added mass, rho pi D^2/4 per length (potential flow, J. N. Newman, Marine
    Hydrodynamics, 1977, section 4.13), which has inertia and no weight.

    Attributes
    ----------
    base_height : float
        Elevation of the sea bed, where the foundation begins, above mean sea level [m]: minus the depth of the water.
    diameter_station : ndarray (n,)
        Distance from the base along the monopile [m].
    diameter : ndarray (n,)
        Outer diameter [m].
    structure : BeamStations
        From the base (station 0) to the base of the tower.
    foundation : ndarray (6, 6) or None
        Stiffness that the ground has against the displacement and rotation of the base (axes of a tower: x downwind,
        y left, z up) [N/m, N, N m]; None: the base is clamped. See `wt_gym.structure.beam.pile_head_stiffness`.
    top_mass : float
        Of a transition piece at the base of the tower [kg].
    water_density : float
        [kg/m^3]; 0 leaves the water out.

    Raises
    ------
    TurbineDefinitionError
        If a table does not fit the others, or the foundation is not a stiffness matrix.
    """

    base_height: float
    diameter_station: NDArray[np.float64]
    diameter: NDArray[np.float64]
    structure: BeamStations
    foundation: NDArray[np.float64] | None = None
    top_mass: float = 0.0
    water_density: float = SEA_WATER

    def __post_init__(self) -> None:
        """Check the fields and make the arrays read-only."""
        if not isinstance(self.structure, BeamStations):
            raise fail("Support.structure", self.structure, "BeamStations")
        station = check_array("Support.diameter_station", self.diameter_station, (None,), low=0.0)
        check_ascending("Support.diameter_station", station)
        check_span("Support.diameter_station", station, self.structure.length)
        self._set(
            base_height=check_number("Support.base_height", self.base_height, -500.0, 500.0),
            diameter_station=station,
            diameter=check_array("Support.diameter", self.diameter, (station.size,), low=0.01, high=50.0),
            top_mass=check_number("Support.top_mass", self.top_mass, 0.0, 1e9),
            water_density=check_number("Support.water_density", self.water_density, 0.0, 2000.0),
        )
        if self.foundation is not None:
            self._set(foundation=_checked_stiffness(self.foundation))

    @property
    def length(self) -> float:
        """Length from the sea bed to the base of the tower [m]."""
        return self.structure.length

    def diameter_at(self, station: ArrayLike) -> NDArray[np.float64]:
        """Return the outer diameter [m] at a distance from the base [m], linear between stations."""
        return np.interp(np.asarray(station, dtype=np.float64), self.diameter_station, self.diameter)

    def added_mass_at(self, station: ArrayLike) -> NDArray[np.float64]:
        """Return the mass per length [kg/m] of the water that moves along across the axis, none above sea level."""
        s = np.asarray(station, dtype=np.float64)
        wet = self.base_height + s <= 0.0
        return np.where(wet, 0.25 * np.pi * self.water_density * self.diameter_at(s) ** 2, 0.0)


def _checked_stiffness(value: ArrayLike) -> NDArray[np.float64]:
    """Return a symmetric positive definite (6, 6) stiffness."""
    stiffness = check_array("Support.foundation", value, (6, 6))
    check_symmetric("Support.foundation", stiffness[None])
    scale = np.sqrt(np.abs(np.diag(stiffness)))
    if not np.all(scale > 0.0) or np.linalg.eigvalsh(stiffness / np.outer(scale, scale))[0] <= 0.0:
        raise fail("Support.foundation", stiffness.diagonal().tolist(), "a positive definite stiffness (its diagonal)")
    return stiffness
