"""One blade: reference axis, planform, airfoils and section properties, with the interpolations between the tables."""

from dataclasses import dataclass
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator

from wt_gym.turbines.airfoil import Airfoil, Polar, blend_polars
from wt_gym.turbines.beam import BeamStations
from wt_gym.turbines.checks import ArrayRecord, check_array, check_ascending, check_number, check_span, fail
from wt_gym.turbines.rotational_augmentation import RotationalAugmentation

__all__ = ["Blade"]


@dataclass(frozen=True, eq=False, repr=False)
class Blade(ArrayRecord):
    """One blade.

    Attributes
    ----------
    length : float
        From root to tip along z [m] (OpenFAST TipRad - HubRad).
    root_radius : float
        From the rotor apex to the blade root [m] (HubRad).
    axis_station : ndarray (n,)
        Distance along the reference axis from the root [m]: the coordinate of ``structure.station``.
    axis : ndarray (n, 3)
        Points of the reference (pitch) axis in the blade frame [m]; starts at z = 0. Upwind prebend is -x.
    aero_station : ndarray (m,)
        z of the planform stations, from 0 to ``length`` [m] (BlSpn).
    chord : ndarray (m,)
        Chord [m].
    twist : ndarray (m,)
        Twist [rad], positive to feather (BlTwist).
    le_offset : ndarray (m,)
        Distance from leading edge to reference axis along the chord, divided by the chord.
    airfoils : tuple of Airfoil
    airfoil_station : ndarray (k,)
        z [m] where the section is exactly ``airfoils[airfoil_index[i]]``; blended linearly between, constant outside.
    airfoil_index : ndarray (k,) of int
    structure : BeamStations
    damping_ratio : float
        Structural damping of every blade mode, fraction of critical (BldFlDmp / 100).
    normal_offset : ndarray (m,)
        Distance of the chord line from the reference axis towards the suction side, divided by the chord; zero for
        most blades. ``camber_at`` includes it.
    rotating_polars : bool or None
        Whether the polars of ``airfoils`` hold the delay of stall by rotation; None where that is not known.
    augmentation : RotationalAugmentation or None
        What `polar_at` adds to two-dimensional polars.
    """

    length: float
    root_radius: float
    axis_station: NDArray[np.float64]
    axis: NDArray[np.float64]
    aero_station: NDArray[np.float64]
    chord: NDArray[np.float64]
    twist: NDArray[np.float64]
    le_offset: NDArray[np.float64]
    airfoils: tuple[Airfoil, ...]
    airfoil_station: NDArray[np.float64]
    airfoil_index: NDArray[np.int64]
    structure: BeamStations
    damping_ratio: float
    normal_offset: NDArray[np.float64] | None = None
    rotating_polars: bool | None = None
    augmentation: RotationalAugmentation | None = None

    def __post_init__(self) -> None:
        """Check the fields and make the arrays read-only."""
        length = check_number("Blade.length", self.length, 0.0, 500.0, open_low=True)
        self._set(
            length=length,
            root_radius=check_number("Blade.root_radius", self.root_radius, 0.0, 50.0),
            damping_ratio=check_number("Blade.damping_ratio", self.damping_ratio, 0.0, 0.5),
        )
        self._check_axis()
        self._check_planform()
        self._check_airfoils()
        if self.augmentation is not None and self.rotating_polars:
            raise fail("Blade.augmentation", self.augmentation, "None: the polars hold the delay of stall by rotation")

    def _check_axis(self) -> None:
        station = check_array("Blade.axis_station", self.axis_station, (None,), low=0.0)
        check_ascending("Blade.axis_station", station)
        axis = check_array("Blade.axis", self.axis, (station.size, 3))
        check_ascending("Blade.axis[:, 2]", axis[:, 2])
        check_span("Blade.axis[:, 2]", axis[:, 2], self.length)
        if not isinstance(self.structure, BeamStations):
            raise fail("Blade.structure", self.structure, "BeamStations")
        check_span("Blade.structure.station", self.structure.station, float(station[-1]))
        self._set(axis_station=station, axis=axis)

    def _check_planform(self) -> None:
        z = check_array("Blade.aero_station", self.aero_station, (None,))
        check_ascending("Blade.aero_station", z)
        check_span("Blade.aero_station", z, self.length)
        offset = np.zeros(z.size) if self.normal_offset is None else self.normal_offset
        self._set(
            aero_station=z,
            chord=check_array("Blade.chord", self.chord, (z.size,), low=1e-3, high=30.0),
            twist=check_array("Blade.twist", self.twist, (z.size,), low=-np.pi / 2, high=np.pi / 2),
            le_offset=check_array("Blade.le_offset", self.le_offset, (z.size,), low=-2.0, high=3.0),
            normal_offset=check_array("Blade.normal_offset", offset, (z.size,), low=-2.0, high=2.0),
        )

    def _check_airfoils(self) -> None:
        airfoils = tuple(self.airfoils)
        if not airfoils or not all(isinstance(a, Airfoil) for a in airfoils):
            raise fail("Blade.airfoils", self.airfoils, "at least one Airfoil")
        z = check_array("Blade.airfoil_station", self.airfoil_station, (None,), low=0.0, high=self.length * (1 + 1e-9))
        if z.size > 1:
            check_ascending("Blade.airfoil_station", z)
        index = np.array(self.airfoil_index)
        if index.shape != z.shape or not np.issubdtype(index.dtype, np.integer):
            raise fail("Blade.airfoil_index", self.airfoil_index, f"{z.size} integers, one per airfoil_station")
        if np.any((index < 0) | (index >= len(airfoils))):
            raise fail("Blade.airfoil_index", index.tolist(), f"integers from 0 to {len(airfoils) - 1}")
        index = index.astype(np.int64)
        index.flags.writeable = False
        self._set(airfoils=airfoils, airfoil_station=z, airfoil_index=index)

    @cached_property
    def _planform(self) -> PchipInterpolator:
        table = np.column_stack(
            (self.chord, self.twist, self.le_offset, cast("NDArray[np.float64]", self.normal_offset))
        )
        return PchipInterpolator(self.aero_station, table, extrapolate=False)

    @cached_property
    def _axis_by_z(self) -> PchipInterpolator:
        table = np.column_stack((self.axis[:, :2], self.axis_station))
        return PchipInterpolator(self.axis[:, 2], table, extrapolate=False)

    def _inside(self, z: ArrayLike) -> NDArray[np.float64]:
        position = np.asarray(z, dtype=np.float64)
        slack = 1e-9 * self.length
        if np.any(~((position >= -slack) & (position <= self.length + slack))):
            raise fail("z", z, f"distances from the blade root in [0, {self.length:g}] m")
        # Only rounding errors are left: bring them back into the table.
        return np.clip(position, 0.0, self.length)

    def chord_at(self, z: ArrayLike) -> NDArray[np.float64]:
        """Return the chord [m] at z [m] from the root (monotone cubic, no overshoot)."""
        out: NDArray[np.float64] = self._planform(self._inside(z))[..., 0]
        return out

    def twist_at(self, z: ArrayLike) -> NDArray[np.float64]:
        """Return the twist [rad], positive to feather, at z [m] from the root (monotone cubic)."""
        out: NDArray[np.float64] = self._planform(self._inside(z))[..., 1]
        return out

    def le_offset_at(self, z: ArrayLike) -> NDArray[np.float64]:
        """Return the distance from leading edge to reference axis divided by the chord, at z [m] from the root."""
        out: NDArray[np.float64] = self._planform(self._inside(z))[..., 2]
        return out

    def axis_at(self, z: ArrayLike) -> NDArray[np.float64]:
        """Return points (..., 3) of the reference axis [m] in the blade frame at z [m] from the root."""
        position = self._inside(z)
        return np.concatenate((self._axis_by_z(position)[..., :2], position[..., None]), axis=-1)

    def station_at(self, z: ArrayLike) -> NDArray[np.float64]:
        """Return the distance along the reference axis [m] (as in ``structure.station``) at z [m] from the root."""
        out: NDArray[np.float64] = self._axis_by_z(self._inside(z))[..., 2]
        return out

    def _bracket(self, z: float) -> tuple[Airfoil, Airfoil, float]:
        """Return the two airfoils around z and the weight of the second."""
        stations, index = self.airfoil_station, self.airfoil_index
        j = int(np.searchsorted(stations, z, side="right"))
        if j == 0 or j == stations.size:
            only = self.airfoils[index[min(j, stations.size - 1)]]
            return only, only, 0.0
        weight = float((z - stations[j - 1]) / (stations[j] - stations[j - 1]))
        return self.airfoils[index[j - 1]], self.airfoils[index[j]], weight

    def polar_at(self, z: float) -> Polar:
        """Return the polar at z [m] from the root, blended linearly between the neighboring airfoil stations.

        With ``augmentation``, that of the section in rotation.
        """
        position = float(self._inside(z))
        first, second, weight = self._bracket(position)
        polar = blend_polars(first.polar, second.polar, weight)
        if self.augmentation is None:
            return polar
        return self.augmentation.of(polar, float(self.chord_at(position)), self.root_radius + position)

    @property
    def lift_start(self) -> float:
        """Distance from the root [m] up to which no section has lift, as on a cylindrical root; 0 if none has."""
        lifts = [bool(np.any(self.airfoils[i].polar.cl)) for i in self.airfoil_index]
        first = lifts.index(True) if any(lifts) else 0
        return float(self.airfoil_station[first - 1]) if first else 0.0

    def camber_at(self, z: float, x_c: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the camber line at z [m] from the root.

        Parameters
        ----------
        z : float
            Distance from the root along z [m].
        x_c : array_like
            Chordwise positions from the leading edge, in [0, 1].

        Returns
        -------
        camber, slope : ndarray
            Height above the line through the reference axis parallel to the chord, towards the suction side, divided
            by the chord, and its derivative by x/c; shaped like ``x_c``.
        """
        position = float(self._inside(z))
        first, second, weight = self._bracket(position)
        (y0, s0), (y1, s1) = first.camber_at(x_c), second.camber_at(x_c)
        offset = float(self._planform(position)[3])
        return (1.0 - weight) * y0 + weight * y1 + offset, (1.0 - weight) * s0 + weight * s1
