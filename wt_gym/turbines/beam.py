"""Sectional beam properties along a reference axis (blade or tower)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wt_gym.turbines.checks import ArrayRecord, check_array, check_ascending, check_symmetric, fail

__all__ = ["BeamStations", "inertia_matrix", "interpolate", "rotation_about_z"]


@dataclass(frozen=True, eq=False, repr=False)
class BeamStations(ArrayRecord):
    """Stiffness and inertia of cross-sections, about the point where the reference axis meets the section.

    Attributes
    ----------
    station : ndarray (n,)
        Distance along the reference axis [m], ascending from 0 (blade root, tower base). Between stations every
        property is linear in this distance.
    stiffness : ndarray (n, 6, 6)
        Relates the generalized strains (shear along x, shear along y, axial strain, curvature about x, curvature about
        y, twist rate about z) to the section forces (Fx, Fy, Fz, Mx, My, Mz); N, N m and N m^2. A section that does
        not shear (Euler-Bernoulli) has ``inf`` at [0, 0] and [1, 1] and zeros beside them.
    inertia : ndarray (n, 6, 6)
        Mass matrix per unit length for (vx, vy, vz, wx, wy, wz) of the point on the axis; kg/m, kg and kg m.

    Notes
    -----
    Axes of a blade: the blade frame (z root to tip, x to the suction side, y to the trailing edge) without pitch; the
    structural twist is already turned in. On a prebent axis z means the local tangent. Axes of a tower: x downwind,
    y left looking downwind, z up. A bending moment about y bends the beam along x: ``stiffness[:, 4, 4]`` is flapwise
    (fore-aft) and ``stiffness[:, 3, 3]`` edgewise (side-side). OpenFAST BeamDyn uses the same order and axes.

    Raises
    ------
    TurbineDefinitionError
        If shapes disagree, stations do not ascend from 0, a matrix is not symmetric, a stiffness is not positive
        definite or jumps as no beam does, or an inertia is not positive semidefinite.
    """

    station: NDArray[np.float64]
    stiffness: NDArray[np.float64]
    inertia: NDArray[np.float64]

    def __post_init__(self) -> None:
        """Check the tables and make them read-only."""
        station = check_array("BeamStations.station", self.station, (None,), low=0.0)
        check_ascending("BeamStations.station", station)
        if station[0] != 0.0:
            raise fail("BeamStations.station[0]", float(station[0]), "0 (the root or base)")
        shape = (station.size, 6, 6)
        stiffness = check_array("BeamStations.stiffness", self.stiffness, shape, infinite=True)
        inertia = check_array("BeamStations.inertia", self.inertia, shape)
        check_symmetric("BeamStations.stiffness", stiffness)
        check_symmetric("BeamStations.inertia", inertia)
        _check_rigid_shear(stiffness)
        _check_definite("BeamStations.stiffness", stiffness, strictly=True)
        _check_spikes(np.diagonal(stiffness, axis1=1, axis2=2))
        _check_definite("BeamStations.inertia", inertia, strictly=False)
        if np.any(inertia[:, 0, 0] <= 0.0):
            i = int(np.argmax(inertia[:, 0, 0] <= 0.0))
            raise fail(f"BeamStations.inertia[{i}, 0, 0]", float(inertia[i, 0, 0]), "a mass per length above 0 kg/m")
        self._set(station=station, stiffness=stiffness, inertia=inertia)

    @property
    def length(self) -> float:
        """Length of the reference axis [m]."""
        return float(self.station[-1])

    @property
    def shear_rigid(self) -> bool:
        """Whether the sections do not shear (infinite shear stiffness)."""
        return bool(np.isinf(self.stiffness[0, 0, 0]))

    def stiffness_at(self, station: ArrayLike) -> NDArray[np.float64]:
        """Return the stiffness (..., 6, 6) at distances along the axis [m], linear between the stations."""
        return interpolate(station, self.station, self.stiffness)

    def inertia_at(self, station: ArrayLike) -> NDArray[np.float64]:
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


def interpolate(at: ArrayLike, station: NDArray[np.float64], table: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a table (n, ...) at distances along the axis [m], linear between the stations (n,); infinity stays.

    Raises
    ------
    TurbineDefinitionError
        Outside the stations.
    """
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


def _check_rigid_shear(stiffness: NDArray[np.float64]) -> None:
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


def _check_spikes(diagonal: NDArray[np.float64]) -> None:
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


def _check_definite(field: str, matrices: NDArray[np.float64], *, strictly: bool) -> None:
    """Require positive (semi)definite matrices; scaled by their diagonal because the entries differ in unit."""
    for i, matrix in enumerate(matrices):
        diagonal = np.where(np.isinf(np.diag(matrix)), 1.0, np.diag(matrix))
        finite = np.where(np.isinf(matrix), 1.0, matrix)
        scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
        least = float(np.linalg.eigvalsh(finite * np.outer(scale, scale))[0])
        if least < -1e-9 or (strictly and least <= 1e-12):
            what = "a positive definite matrix" if strictly else "a positive semidefinite matrix"
            raise fail(f"{field}[{i}]", f"least eigenvalue {least:.3g} after scaling the diagonal to 1", what)


def rotation_about_z(angle: ArrayLike) -> NDArray[np.float64]:
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


def inertia_matrix(
    mass: ArrayLike,
    cm_x: ArrayLike,
    cm_y: ArrayLike,
    i_xx: ArrayLike,
    i_yy: ArrayLike,
    i_xy: ArrayLike,
    i_zz: ArrayLike | None = None,
) -> NDArray[np.float64]:
    """Return section mass matrices (..., 6, 6) about the reference axis.

    Parameters
    ----------
    mass : array_like
        Mass per length [kg/m].
    cm_x, cm_y : array_like
        Center of mass from the axis [m].
    i_xx, i_yy : array_like
        Integrals of rho y^2 and rho x^2 over the section, about the reference axis [kg m].
    i_xy : array_like
        Integral of rho x y about the reference axis [kg m].
    i_zz : array_like, optional
        Polar inertia [kg m]; for a flat section (default) i_xx + i_yy.

    Returns
    -------
    ndarray (..., 6, 6)
        With v(x, y) = v + w x (x, y, 0), the kinetic energy per length is (v, w)^T M (v, w) / 2.
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
