"""Wings and rotors in potential flow by other methods than the lattice: what its strips at the tip are compared with.

All circulations are linear: they stand for unit angle of attack, or for unit angle against the helices of the wake.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.special import gammaln

__all__ = ["helix_induction", "lifting_line_blade", "lifting_surface", "optimum_circulation", "outermost_strips"]


def _semicircles(low, high, n):
    """Edges (n + 1,) and stations (n,) of a span by cosines, to which the root of the circulation at an end is exact.

    Edges are the zeros of the Chebyshev polynomial of the first kind, stations those of the second (Lan 1974).
    """
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    edges = middle - half * np.cos((2.0 * np.arange(n + 1) + 1.0) * np.pi / (2.0 * (n + 1)))
    return edges, middle - half * np.cos(np.arange(1, n + 1) * np.pi / (n + 1))


def _over_span(low: float, high: float, stations: np.ndarray, values: np.ndarray) -> Callable[..., Any]:
    """The function of the span through values that fall to zero at both ends like square roots."""
    middle, half = 0.5 * (low + high), 0.5 * (high - low)

    def angle(place):
        return np.arccos(np.clip((np.asarray(place) - middle) / half, -1.0, 1.0))

    spline = CubicSpline(np.r_[0.0, angle(stations)[::-1], np.pi], np.r_[0.0, values[::-1], 0.0])
    return lambda place: spline(angle(place))


def lifting_surface(
    half_span: float, chord: Callable[..., Any], n_span: int = 80, n_chord: int = 8
) -> Callable[..., Any]:
    """Circulation along a flat wing with straight half-chord line by the quasi-vortex lattice, unit stream and angle.

    Cosines along span and chord integrate the square-root singularities of tips and leading edge (C. E. Lan,
    J. Aircraft 11 (1974) 518); horseshoe vortices with straight wakes.

    Parameters
    ----------
    half_span : float
        [m].
    chord : callable
        Chord at places along the span, symmetric [m].
    n_span, n_chord : int
        Strips of one half and vortices along the chord.

    Returns
    -------
    callable
        Circulation at places along the span [m²/s].
    """
    edges, stations = _semicircles(-half_span, half_span, 2 * n_span)
    k = np.arange(1, n_chord + 1)
    vortex, control = (
        0.5 * (1.0 - np.cos((2 * k - 1) * np.pi / (2 * n_chord))) - 0.5,
        0.5 * (1.0 - np.cos(k * np.pi / n_chord)) - 0.5,
    )
    right = stations[n_span:]  # symmetry: unknowns of one half, velocities of both
    x, y = np.ravel(control[:, None] * chord(right)), np.tile(right, n_chord)
    begin = np.ravel(vortex[:, None] * chord(edges[:-1])), np.tile(edges[:-1], n_chord)
    end = np.ravel(vortex[:, None] * chord(edges[1:])), np.tile(edges[1:], n_chord)
    upwash = _horseshoes(x[:, None], y[:, None], begin, end).reshape(x.size, n_chord, 2 * n_span)
    both = upwash[:, :, n_span:] + upwash[:, :, n_span - 1 :: -1]
    strength = np.linalg.solve(both.reshape(x.size, -1), -np.ones(x.size))
    half = strength.reshape(n_chord, n_span).sum(axis=0)
    return _over_span(-half_span, half_span, stations, np.r_[half[::-1], half])


def _horseshoes(x, y, begin, end):
    """Upwash in their plane of unit horseshoes with legs along +x (Katz & Plotkin, Low-Speed Aerodynamics, 12.1)."""
    ax, ay, bx, by = x - begin[0], y - begin[1], x - end[0], y - end[1]
    a, b = np.hypot(ax, ay), np.hypot(bx, by)
    lx, ly = ax - bx, ay - by
    across = ax * by - bx * ay
    along = (lx * ax + ly * ay) / a - (lx * bx + ly * by) / b
    bound = np.divide(along, across, out=np.zeros_like(along), where=np.abs(across) > 1e-14)
    return (bound - (1.0 + ax / a) / ay + (1.0 + bx / b) / by) / (4.0 * np.pi)


def outermost_strips(n: int) -> np.ndarray:
    """Circulation of strips at a tip over the exact one at their middles, outermost first, for even narrow strips.

    With the last edge a quarter strip before the tip, vortices at the edges k = 0, 1, … and no further downwash at the
    middles between them have the strengths Γ(k + 1/2) / k!, strip j thus the circulation Γ(j + 3/2) / j!, which tends
    to the root of the distance j + 3/4 from the tip.
    """
    j = np.arange(n)
    return np.exp(gammaln(j + 1.5) - gammaln(j + 1.0)) / np.sqrt(j + 0.75)


# ---- rotors ----


def helix_induction(radius, helix: float, pitch: float, n_blades: int):
    """Velocity at a blade of helices of unit circulation that begin on all blades: against the axis and the motion.

    J. W. Wrench, The calculation of propeller induction factors, David Taylor Model Basin report 1116 (1957); closed
    formulas in place of Kapteyn series, right within 1e-4.

    Parameters
    ----------
    radius : ndarray
        Points on the blades [m].
    helix : float
        Radius of the helices [m].
    pitch : float
        Advance of the helices over their angle [m/rad].
    n_blades : int
    """
    y0, y = helix / pitch, radius / pitch
    root0, root = np.sqrt(1.0 + y0**2), np.sqrt(1.0 + y**2)
    inside = radius < helix
    power = n_blades * (np.log(y0 * (root - 1.0) / (y * (root0 - 1.0))) + root - root0)
    share = np.exp(-np.abs(power)) / -np.expm1(-np.abs(power))  # 1 / (1/U - 1) inside, 1 / (U - 1) outside
    curved = ((9.0 * y0**2 + 2.0) / root0**3 + (3.0 * y**2 - 2.0) / root**3) / (24.0 * n_blades)
    factor = np.sqrt(root0 / root) / (2.0 * n_blades * y0)
    factor = factor * np.where(inside, -share - curved * np.log1p(share), share - curved * np.log1p(share))
    per_turn = n_blades / (4.0 * np.pi)
    axial = per_turn / pitch * (np.where(inside, 1.0, 0.0) - 2.0 * n_blades * y0 * factor)
    turning = per_turn / radius * (np.where(inside, 0.0, 1.0) + 2.0 * n_blades * y0 * factor)
    return axial, turning


def _downwash(root, pitch, n_blades, n):
    """Stations, angle of the helices there, and velocity across the helices per circulation of a strip (n, n)."""
    edges, stations = _semicircles(root, 1.0, n)
    angle = np.arctan2(pitch, stations)
    axial, turning = np.array([helix_induction(stations, edge, pitch, n_blades) for edge in edges]).transpose(1, 2, 0)
    across = axial * np.cos(angle)[:, None] - turning * np.sin(angle)[:, None]
    return stations, angle, np.diff(across, axis=1)


def lifting_line_blade(chord: float, root: float, pitch: float, n_blades: int, n: int = 80) -> Callable[..., Any]:
    """Circulation along narrow blades of one chord and radius one at unit angle to undisturbed helices.

    Γ / (π c) + w(Γ) = W, with the sections' lift slope 2π and the resultant W of a unit wind and the rotation.
    """
    stations, _, downwash = _downwash(root, pitch, n_blades, n)
    strength = np.linalg.solve(downwash + np.eye(n) / (np.pi * chord), np.hypot(1.0, stations / pitch))
    return _over_span(root, 1.0, stations, strength)


def optimum_circulation(root: float, pitch: float, n_blades: int, n: int = 80) -> Callable[..., Any]:
    """Circulation of least loss (Betz 1919, Goldstein 1929): its helices move like a rigid screw of unit speed."""
    stations, angle, downwash = _downwash(root, pitch, n_blades, n)
    strength = np.linalg.solve(downwash, 0.5 * np.cos(angle))  # at the blade half of what is far behind
    return _over_span(root, 1.0, stations, strength)
