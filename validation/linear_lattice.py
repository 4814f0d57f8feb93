"""A flat oscillating half wing as a linear vortex lattice in the frequency domain: an independent reference.

Nothing is shared with the lattice of the package: double precision, vortices without core, the wake summed as a
geometric series of its rows, and Kutta-Joukowski loads with the vorticity of the last quarter panel taken into account.
The wing lies in the plane x = 0, chord along y, span along z from the plane of symmetry z = 0.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import fsolve

__all__ = ["LinearLattice"]


def _segment(start, end, points):
    """Velocity across the plane of unit segments (n_segment, 2) at points (n_point, 2), (n_point, n_segment)."""
    first, second = points[:, None] - start, points[:, None] - end
    cross = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    near, far = np.linalg.norm(first, axis=-1), np.linalg.norm(second, axis=-1)
    return (near + far) * cross / (4.0 * np.pi * near * far * (near * far + (first * second).sum(axis=-1)))


class LinearLattice:
    """Half wing of constant chord with panels of even size and a time step of one panel.

    Parameters
    ----------
    chord, axis : float
        Chord [m] and distance from the leading edge to the axis y = 0 of twist, in chords.
    edges : ndarray, shape (n_span + 1,)
        Span edges, from 0 [m].
    n_chord : int
    wake_chords : float
        Length of the wake.
    """

    def __init__(self, chord: float, axis: float, edges, n_chord: int, wake_chords: float):
        self.panel = chord / n_chord
        self.edges, self.width = np.asarray(edges, dtype=float), np.diff(edges)
        self.middle = 0.5 * (self.edges[1:] + self.edges[:-1])
        self.vortex = -axis * chord + (np.arange(n_chord) + 0.25) * self.panel
        self.control = self.vortex + 0.5 * self.panel
        self._points = np.array([(y, z) for y in self.control for z in self.middle])
        self._bound = np.hstack([self._row(y) for y in self.vortex])
        rows = self.vortex[-1] + self.panel * np.arange(1, round(wake_chords * n_chord) + 1)
        self._wake = np.array([self._row(y) for y in rows])

    def _row(self, y):
        """Velocity of unit rings from y to one panel behind it, with their mirror images, (n_point, n_span)."""
        total = 0.0
        for left, right in ((self.edges[:-1], self.edges[1:]), (-self.edges[1:], -self.edges[:-1])):
            ys = (y, y, y + self.panel, y + self.panel)
            corners = [np.column_stack([np.full(len(left), a), z]) for a, z in zip(ys, (left, right, right, left),
                                                                                   strict=True)]  # fmt: skip
            for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
                total = total + _segment(a, b, self._points)
        return total

    def modal_forces(self, heave, twist, omega: float, speed: float, density: float) -> np.ndarray:
        """Generalized forces (n_mode, n_mode) of the air for harmonic unit modes.

        Parameters
        ----------
        heave, twist : ndarray, shape (n_span, n_mode)
            Displacement along x of the axis and nose-up rotation of the strips.
        omega, speed, density : float
            [rad/s], [m/s], [kg/m³].
        """
        n_span, n_chord = len(self.middle), len(self.vortex)
        step = self.panel / speed
        shift = np.exp(1j * omega * step)
        influence = self._bound.astype(complex)
        behind = shift ** -np.arange(1.0, len(self._wake) + 1.0)
        influence[:, (n_chord - 1) * n_span :] += np.tensordot(behind, self._wake, axes=1)
        wash = [speed * twist - 1j * omega * (heave - y * twist) for y in self.control]
        ring = np.linalg.solve(influence, -np.vstack(wash)).reshape(n_chord, n_span, -1)
        bound = np.diff(ring, axis=0, prepend=0.0)
        rate = (1.5 - 2.0 / shift + 0.5 / shift**2) / step * ring
        total = np.zeros((heave.shape[1],) * 2, dtype=complex)
        for i, y in enumerate(self.vortex):
            # The vorticity -rate/V behind the last bound vortex carries -rate p/4: half of the last ring counts.
            length = self.panel if i < n_chord - 1 else 0.5 * self.panel
            for arm, force in ((y, speed * bound[i]), (y + 0.5 * length, length * rate[i])):
                total += density * (heave - arm * twist).T @ (self.width[:, None] * force)
        return total

    def flutter(self, heave, twist, frequency, density: float, guess) -> tuple[float, float]:
        """Flutter speed [m/s] and frequency [rad/s] of mass-normalized modes.

        Parameters
        ----------
        heave, twist : ndarray, shape (n_span, n_mode)
        frequency : ndarray, shape (n_mode,)
            Of the modes in vacuum [rad/s].
        density : float
            [kg/m³].
        guess : tuple of float
            Speed and frequency to start from.
        """

        def determinant(unknown):
            speed, omega = unknown
            air = self.modal_forces(heave, twist, omega, speed, density)
            value = np.linalg.det((np.diag(frequency**2 - omega**2) - air) / 1e4)
            return [value.real, value.imag]

        speed, omega = fsolve(determinant, guess)
        return float(speed), float(omega)
