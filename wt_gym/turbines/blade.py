"""Beams (blade or tower) by their sections, and blades: reference axis, planform, airfoils, sections, and ice.

Ice is a mass at the leading edge, less lift and more drag. The mass per length is that of the GL guideline for the
certification of wind turbines (Germanischer Lloyd, edition 2010, chapter 4, ice load on rotor blades): it rises in a
straight line from the rotor axis to

    mu_E = rho_E k c_min (c_max + c_min),   k = 0.00675 + 0.3 exp(-0.32 R / 1 m),   rho_E = 700 kg/m^3

at half the radius R and stays there up to the tip; c_max is the largest chord and c_min that of the tip, to which the
contour is continued in a straight line. The coefficients of the sections change over the span as the mass does: at
the full value lift falls by 30 % and drag doubles. Published losses of iced sections lie about these: 30 % of the lift
and 50 % more drag (Zanon, De Gennaro and Kuehnelt, Renewable Energy 115 (2018) 760, NREL 5-MW), 35 % and 97 % for
glaze ice (Energies 18 (2025) 3448).
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from wt_gym.base.options import option, option_record
from wt_gym.base.quantities import Array, Integers
from wt_gym.turbines.airfoil import Airfoil, Polar, RotationalAugmentation, blend_polars
from wt_gym.turbines.checks import ArrayRecord, check_array, check_span, check_symmetric, fail

_EVEN = 0.02  # Difference of both bending stiffnesses, over their mean, below which a section has no axes of its own


@option_record
class BeamStations(ArrayRecord):
    """Stiffness and inertia of cross-sections, about the point where the reference axis meets the section.

    Axes of a blade: the blade frame (z root to tip, x to the suction side, y to the trailing edge) without pitch; the
    structural twist is already turned in. On a prebent axis z means the local tangent. Axes of a tower: x downwind,
    y left looking downwind, z up. A bending moment about y bends the beam along x: ``stiffness[:, 4, 4]`` is flapwise
    (fore-aft) and ``stiffness[:, 3, 3]`` edgewise (side-side). OpenFAST BeamDyn uses the same order and axes. Between
    stations every property is linear in the distance.
    """

    station: Array = option("distance along the axis from the root or base", unit="m", shape=("station",), ascending=2)
    stiffness: Array = option(
        "positive definite, from strains (shear x and y, axial, curvature x and y, twist rate) to forces and moments "
        "[N, N m, N m^2]; a section that does not shear has ``inf`` at [0, 0] and [1, 1] and zeros beside them",
        shape=("station", 6, 6),
        infinite=True,
    )
    inertia: Array = option("mass matrix per length of the point on the axis [kg/m, kg, kg m]", shape=("station", 6, 6))

    def check(self) -> None:
        """Check what belongs together."""
        station, stiffness, inertia = self.station, self.stiffness, self.inertia
        if station[0] != 0.0:
            raise fail("BeamStations.station[0]", float(station[0]), "0 (the root or base)")
        check_symmetric("BeamStations.stiffness", stiffness)
        check_symmetric("BeamStations.inertia", inertia)
        _check_rigid_shear(stiffness)
        _check_definite("BeamStations.stiffness", stiffness, strictly=True)
        _check_spikes(np.diagonal(stiffness, axis1=1, axis2=2))
        _check_definite("BeamStations.inertia", inertia, strictly=False)
        if np.any(inertia[:, 0, 0] <= 0.0):
            i = int(np.argmax(inertia[:, 0, 0] <= 0.0))
            raise fail(f"BeamStations.inertia[{i}, 0, 0]", float(inertia[i, 0, 0]), "a mass per length above 0 kg/m")

    @property
    def length(self) -> float:
        """Length of the reference axis [m]."""
        return float(self.station[-1])

    @property
    def shear_rigid(self) -> bool:
        """Whether the sections do not shear (infinite shear stiffness)."""
        return bool(np.isinf(self.stiffness[0, 0, 0]))

    def stiffness_at(self, station: ArrayLike) -> Array:
        """Return the stiffness (..., 6, 6) at distances along the axis [m], linear between the stations."""
        return interpolate(station, self.station, self.stiffness)

    def inertia_at(self, station: ArrayLike) -> Array:
        """Return the inertia (..., 6, 6) at distances along the axis [m], linear between the stations."""
        return interpolate(station, self.station, self.inertia)

    def mass_moment(self, order: int = 0) -> float:
        """Return the integral of (mass per length) * s**order ds [kg m**order], exact for the linear interpolation.

        Order 0 is the mass, 1 the first and 2 the second moment about the start of the axis.
        """
        s, m = self.station, self.inertia[:, 0, 0]
        nodes, weights = np.polynomial.legendre.leggauss(order // 2 + 2)
        half = 0.5 * np.diff(s)[:, None]
        points = 0.5 * (s[1:] + s[:-1])[:, None] + half * nodes
        return float(np.sum(half * weights * np.interp(points, s, m) * points**order))


def interpolate(at: ArrayLike, station: Array, table: Array) -> Array:
    """Return a table (n, ...) at distances along the axis [m], linear between the stations (n,); infinity stays."""
    s = np.asarray(at, dtype=np.float64)
    if np.any(~((s >= 0.0) & (s <= station[-1] * (1.0 + 1e-9)))):
        raise fail("station", at, f"distances in [0, {station[-1]:g}] m")
    j = np.minimum(np.searchsorted(station, s, side="right"), station.size - 1)
    i = j - 1
    w = ((s - station[i]) / (station[j] - station[i])).reshape(s.shape + (1,) * (table.ndim - 1))
    # Rigid entries are infinite at both ends: inf * 0 would be NaN, so they are passed on as they are.
    a, b = table[i], table[j]
    rigid = np.isinf(a)
    low, high = np.where(rigid, 0.0, a), np.where(rigid, 0.0, b)
    return np.where(rigid, np.inf, (1.0 - w) * low + w * high)


def _check_rigid_shear(stiffness: Array) -> None:
    infinite = np.isinf(stiffness)
    allowed = np.zeros((6, 6), dtype=bool)
    allowed[0, 0] = allowed[1, 1] = True
    if np.any(infinite & ~allowed):
        i, j, k = (int(v) for v in np.argwhere(infinite & ~allowed)[0])
        raise fail(
            f"BeamStations.stiffness[{i}, {j}, {k}]", np.inf, "a finite number (only [0, 0] and [1, 1] may be inf)"
        )
    if np.any(infinite) and not np.all(infinite[:, [0, 1], [0, 1]]):
        raise fail("BeamStations.stiffness[:, 0, 0] and [:, 1, 1]", "inf and finite mixed", "inf everywhere or nowhere")
    if np.any(infinite):
        beside = stiffness[:, :2, :].copy()
        beside[:, [0, 1], [0, 1]] = 0.0
        if np.any(beside != 0.0):
            raise fail("BeamStations.stiffness[:, 0:2, :]", "couplings", "zeros beside an infinite shear stiffness")


def _check_spikes(diagonal: Array) -> None:
    """Refuse stiffnesses (n, 6) with implausible jumps (probable typing errors): blades and towers change by at most
    200 from one station to the next, and hardly ever up and down again.
    """
    decades = np.diff(np.log10(np.where(np.isinf(diagonal), 1.0, diagonal)), axis=0)
    there, back = decades[:-1], decades[1:]
    spikes = np.zeros(diagonal.shape, dtype=bool)
    spikes[1:-1] = (there * back < 0.0) & (np.minimum(np.abs(there), np.abs(back)) > 2.0)
    spikes[1:] |= np.abs(decades) > 6.0
    if np.any(spikes):
        i, j = (int(v) for v in np.argwhere(spikes)[0])
        allowed = "a stiffness within a factor of 100 of one of its neighbors, and of a million of both"
        raise fail(f"BeamStations.stiffness[{i}, {j}, {j}]", float(diagonal[i, j]), allowed)


def _check_definite(field: str, matrices: Array, *, strictly: bool) -> None:
    """Require positive (semi)definite matrices; scaled by their diagonal because the entries differ in unit."""
    for i, matrix in enumerate(matrices):
        diagonal = np.where(np.isinf(np.diag(matrix)), 1.0, np.diag(matrix))
        finite = np.where(np.isinf(matrix), 1.0, matrix)
        scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
        least = float(np.linalg.eigvalsh(finite * np.outer(scale, scale))[0])
        if least < -1e-9 or (strictly and least <= 1e-12):
            what = "a positive definite matrix" if strictly else "a positive semidefinite matrix"
            raise fail(f"{field}[{i}]", f"least eigenvalue {least:.3g} after scaling the diagonal to 1", what)


def bending_matrices(structure: BeamStations, station: Array) -> Array:
    """Stiffness (n, 2, 2) against curvatures about x and y of sections without axial force and torque [N m²]."""
    stiffness = structure.stiffness_at(station)
    if structure.shear_rigid:
        return np.linalg.inv(np.linalg.inv(stiffness[:, 2:, 2:])[:, 1:3, 1:3])
    return np.linalg.inv(np.linalg.inv(stiffness)[:, 3:5, 3:5])


def principal_bending(bending: Array, along: Array) -> tuple[Array, Array, Array]:
    """Flapwise and edgewise stiffness and the angle of their axes, the one next to the twist of the chord."""
    xx, xy, yy = bending[:, 0, 0], bending[:, 0, 1], bending[:, 1, 1]
    mean, half = 0.5 * (xx + yy), 0.5 * (xx - yy)
    size = np.hypot(half, xy)
    angle = -0.5 * np.arctan2(xy, half)  # of the stiffer axis from x, counted as twist: clockwise about z
    twist = along + (angle - along + np.pi / 4) % (np.pi / 2) - np.pi / 4
    even = size < 0.5 * _EVEN * mean
    twist = np.where(even, along, twist)
    # the matrix in axes turned by minus the twist
    edge = mean + half * np.cos(2.0 * twist) - xy * np.sin(2.0 * twist)
    flap = 2.0 * mean - edge
    return flap, edge, twist


def rotation_about_z(angle: ArrayLike) -> Array:
    """Return the 6 x 6 matrices (..., 6, 6) that turn force/moment or velocity pairs by ``angle`` [rad] about z.

    They map components in the turned frame to components in the fixed one, so a section matrix becomes R M R^T.
    """
    angle = np.asarray(angle, dtype=np.float64)
    rotation = np.zeros((*angle.shape, 6, 6))
    c, s = np.cos(angle), np.sin(angle)
    for k in (0, 3):
        rotation[..., k, k], rotation[..., k, k + 1] = c, -s
        rotation[..., k + 1, k], rotation[..., k + 1, k + 1] = s, c
        rotation[..., k + 2, k + 2] = 1.0
    return rotation


def turned(matrices: Array, angle: Array) -> Array:
    """Return section matrices R M R^T (n, 6, 6), turned by angles (n,) [rad] about z, symmetric in spite of rounding.

    Equal infinite shear stiffnesses stay as they are under a turn in their plane.
    """
    rotation, rigid = rotation_about_z(angle), np.isinf(matrices)
    product = rotation @ np.where(rigid, 0.0, matrices) @ np.swapaxes(rotation, -1, -2)
    return np.where(rigid, np.inf, 0.5 * (product + np.swapaxes(product, -1, -2)))


def shear_rigid_stiffness(axial: ArrayLike, about_x: ArrayLike, about_y: ArrayLike, torsion: ArrayLike) -> Array:
    """Return section stiffnesses (..., 6, 6) without couplings and without shear: EA [N], EI and GJ [N m^2]."""
    values = np.broadcast_arrays(*(np.asarray(a, dtype=np.float64) for a in (axial, about_x, about_y, torsion)))
    stiffness = np.zeros((*values[0].shape, 6, 6))
    stiffness[..., 0, 0] = stiffness[..., 1, 1] = np.inf
    for k, value in enumerate(values, start=2):
        stiffness[..., k, k] = value
    return stiffness


def inertia_matrix(
    mass: ArrayLike,
    cm_x: ArrayLike,
    cm_y: ArrayLike,
    i_xx: ArrayLike,
    i_yy: ArrayLike,
    i_xy: ArrayLike,
    i_zz: ArrayLike | None = None,
) -> Array:
    """Return section mass matrices (..., 6, 6) about the reference axis.

    With v(x, y) = v + w x (x, y, 0), the kinetic energy per length is (v, w)^T M (v, w) / 2.

    Parameters
    ----------
    mass : array_like
        Per length [kg/m].
    cm_x, cm_y : array_like
        Center of mass from the axis [m].
    i_xx, i_yy, i_xy : array_like
        Integrals of rho y^2, rho x^2 and rho x y over the section, about the reference axis [kg m].
    i_zz : array_like, optional
        Polar inertia [kg m]; for a flat section (default) i_xx + i_yy.
    """
    m, cx, cy, xx, yy, xy = np.broadcast_arrays(
        *(np.asarray(a, dtype=np.float64) for a in (mass, cm_x, cm_y, i_xx, i_yy, i_xy))
    )
    matrix = np.zeros((*m.shape, 6, 6))
    matrix[..., 0, 0] = matrix[..., 1, 1] = matrix[..., 2, 2] = m
    matrix[..., 0, 5] = matrix[..., 5, 0] = -m * cy
    matrix[..., 1, 5] = matrix[..., 5, 1] = m * cx
    matrix[..., 2, 3] = matrix[..., 3, 2] = m * cy
    matrix[..., 2, 4] = matrix[..., 4, 2] = -m * cx
    matrix[..., 3, 3], matrix[..., 4, 4] = xx, yy
    matrix[..., 3, 4] = matrix[..., 4, 3] = -xy
    matrix[..., 5, 5] = xx + yy if i_zz is None else np.asarray(i_zz, dtype=np.float64)
    return matrix


@option_record
class Blade(ArrayRecord):
    """One blade."""

    length: float = option("from root to tip along z (TipRad - HubRad)", unit="m", low=0, high=500, above=True)
    root_radius: float = option("from the rotor apex to the blade root (HubRad)", unit="m", low=0, high=50)
    axis_station: Array = option("distance from the root along the axis", unit="m", shape=("axis",), low=0, ascending=2)
    axis: Array = option("reference (pitch) axis in the blade frame; prebend upwind is -x", unit="m", shape=("axis", 3))
    aero_station: Array = option(
        "z of the planform, from 0 to ``length`` (BlSpn)", unit="m", shape=("aero",), ascending=2
    )
    chord: Array = option("chord", unit="m", shape=("aero",), low=1e-3, high=30)
    twist: Array = option("to feather (BlTwist)", unit="rad", shape=("aero",), low=-np.pi / 2, high=np.pi / 2)
    le_offset: Array = option("from leading edge to reference axis, over the chord", shape=("aero",), low=-2, high=3)
    airfoils: tuple[Airfoil, ...] = option("sections that occur, in any order", kinds=(Airfoil,))
    airfoil_station: Array = option(
        "z of each section; linear between, constant outside", unit="m", shape=("airfoil",), low=0, ascending=1
    )
    airfoil_index: Integers = option("place in ``airfoils`` of the section at each ``airfoil_station``")
    structure: BeamStations = option("sections along the reference axis", kinds=(BeamStations,))
    damping_ratio: float = option("of every blade mode, fraction of critical (BldFlDmp / 100)", low=0, high=0.5)
    normal_offset: Array | None = option(
        "axis to chord line, suction side, over chord", default=None, otherwise="zeros", shape=("aero",), low=-2, high=2
    )
    rotating_polars: bool | None = option("polars with stall delayed by rotation", default=None, otherwise="not known")
    augmentation: RotationalAugmentation | None = option("of `polar_at`", default=None, kinds=(RotationalAugmentation,))

    def check(self) -> None:
        """Check what belongs together."""
        if self.normal_offset is None:
            self._set("normal_offset", check_array("Blade.normal_offset", np.zeros(self.chord.size), "n"))
        check_array("Blade.axis[:, 2]", self.axis[:, 2], "n", ascending=2)
        check_span("Blade.axis[:, 2]", self.axis[:, 2], self.length)
        check_span("Blade.structure.station", self.structure.station, float(self.axis_station[-1]))
        check_span("Blade.aero_station", self.aero_station, self.length)
        self._check_airfoils()
        if self.augmentation is not None and self.rotating_polars:
            raise fail("Blade.augmentation", self.augmentation, "None: the polars hold the delay of stall by rotation")

    def _check_airfoils(self) -> None:
        z = self.airfoil_station
        if z[-1] > self.length * (1 + 1e-9):
            raise fail("Blade.airfoil_station", float(z[-1]), f"numbers up to the length, {self.length:g} m")
        index = np.array(self.airfoil_index)
        if index.shape != z.shape or not np.issubdtype(index.dtype, np.integer):
            raise fail("Blade.airfoil_index", self.airfoil_index, f"{z.size} integers, one per airfoil_station")
        if np.any((index < 0) | (index >= len(self.airfoils))):
            raise fail("Blade.airfoil_index", index.tolist(), f"integers from 0 to {len(self.airfoils) - 1}")
        index = index.astype(np.int64)
        index.flags.writeable = False
        self._set("airfoil_index", index)

    @cached_property
    def _planform(self) -> PchipInterpolator:
        table = np.column_stack((self.chord, self.twist, self.le_offset, cast("Array", self.normal_offset)))
        return PchipInterpolator(self.aero_station, table, extrapolate=False)

    @cached_property
    def _axis_by_z(self) -> PchipInterpolator:
        table = np.column_stack((self.axis[:, :2], self.axis_station))
        return PchipInterpolator(self.axis[:, 2], table, extrapolate=False)

    def _inside(self, z: ArrayLike) -> Array:
        position = np.asarray(z, dtype=np.float64)
        slack = 1e-9 * self.length
        if np.any(~((position >= -slack) & (position <= self.length + slack))):
            raise fail("z", z, f"distances from the blade root in [0, {self.length:g}] m")
        # Only rounding errors are left: bring them back into the table.
        return np.clip(position, 0.0, self.length)

    def chord_at(self, z: ArrayLike) -> Array:
        """Return the chord [m] at z [m] from the root (monotone cubic, no overshoot)."""
        out: Array = self._planform(self._inside(z))[..., 0]
        return out

    def twist_at(self, z: ArrayLike) -> Array:
        """Return the twist [rad], positive to feather, at z [m] from the root (monotone cubic)."""
        out: Array = self._planform(self._inside(z))[..., 1]
        return out

    def le_offset_at(self, z: ArrayLike) -> Array:
        """Return the distance from leading edge to reference axis divided by the chord, at z [m] from the root."""
        out: Array = self._planform(self._inside(z))[..., 2]
        return out

    def axis_at(self, z: ArrayLike) -> Array:
        """Return points (..., 3) of the reference axis [m] in the blade frame at z [m] from the root."""
        position = self._inside(z)
        return np.concatenate((self._axis_by_z(position)[..., :2], position[..., None]), axis=-1)

    def station_at(self, z: ArrayLike) -> Array:
        """Return the distance along the reference axis [m] (as in ``structure.station``) at z [m] from the root."""
        out: Array = self._axis_by_z(self._inside(z))[..., 2]
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

    def camber_at(self, z: float, x_c: ArrayLike) -> tuple[Array, Array]:
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


LIFT_LOSS, MORE_DRAG = 0.3, 1.0
"""Share of the lift that is lost and of the drag that is added under full ice [-]."""
_DENSITY = 700.0
_TIP = (0.7, 0.9)  # Shares of the length through whose chords the line to the chord of the tip goes


@option_record
class BladeIce(ArrayRecord):
    """Ice on one blade of a turbine."""

    by_value = True

    blade: int = option("number of the blade", low=1, high=10)
    level: float = option("mass, loss of lift and drag over those of full ice", low=0, high=2, above=True)


def spread(blade: Blade, z: Array) -> Array:
    """Share of the full value at distances from the root along z [m]: from 0 at the axis to 1 at half the radius."""
    tip = blade.root_radius + blade.length
    share: Array = np.minimum(2.0 * (blade.root_radius + z) / tip, 1.0)
    return share


def ice_mass(blade: Blade) -> float:
    """Mass of full ice per length in the outer half of a blade, mu_E [kg/m]."""
    inner, outer = blade.chord_at(np.array(_TIP) * blade.length)
    tip = max(float(outer + (1.0 - _TIP[1]) / (_TIP[1] - _TIP[0]) * (outer - inner)), 0.0)
    k = 0.00675 + 0.3 * math.exp(-0.32 * (blade.root_radius + blade.length))
    return float(_DENSITY * k * tip * (blade.chord.max() + tip))


def iced_structure(blade: Blade, level: float) -> BeamStations:
    """Sections of a blade with ice at the leading edge; arguments as of `BladeIce`."""
    beam = blade.structure
    z = np.interp(beam.station, blade.axis_station, blade.axis[:, 2])
    mass = level * ice_mass(blade) * spread(blade, z)
    ahead, twist = blade.le_offset_at(z) * blade.chord_at(z), blade.twist_at(z)
    # the leading edge lies at -ahead along the chord, which the twist turns by minus itself about z
    x, y = -ahead * np.sin(twist), -ahead * np.cos(twist)
    ice = inertia_matrix(mass, x, y, mass * y**2, mass * x**2, mass * x * y)
    return replace(beam, inertia=beam.inertia + ice)


def iced_polar(polar: Array, share: float) -> Array:
    """Polar (n, 3) of lift, drag and moment with a share of full ice [-]."""
    factors = np.array([1.0 - LIFT_LOSS * share, 1.0 + MORE_DRAG * share, 1.0 - LIFT_LOSS * share])
    iced: Array = polar * factors
    return iced
