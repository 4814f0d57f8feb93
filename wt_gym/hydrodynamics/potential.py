"""Potential flow about a platform: tables of radiation and excitation, and radiation as a linear system."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import RegularGridInterpolator
from scipy.linalg import expm, null_space
from scipy.optimize import nnls
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from wt_gym.base.errors import InflowError
from wt_gym.base.options import option, option_record
from wt_gym.base.quantities import Array, Integers
from wt_gym.hydrodynamics.record import Record, fail

Complexes = NDArray[np.complex128]

ORDER = 10
"""States for each input of the radiation."""
_COUPLED = 1e-3  # least coupling that counts, of the peaks of both motions
_PASSIVE = 0.005, 300.0  # range in which the least eigenvalue of Re K is not negative [rad/s]
_MARGIN = 2e-5  # least eigenvalue over the peak, at 1 rad/s
_CUTS = 15  # steps of the search for it
_IRREGULAR = 3.0  # imaginary part over damping; both have peaks of one size where the flow has them
_TIMES = 6  # of the impulse response in half a period of the highest frequency
_LEAST_DAMPED = 0.03  # least damping ratio of a pole
_LOW, _HIGH = 0.4, 1.5  # between them errors of the force count equally; below them those of A more [rad/s]
_NOISE = 0.1  # of a table, of its peaks; published tables have up to 0.03, at irregular frequencies


@option_record
class RadiationTable(Record):
    """Added mass and radiation damping over frequency, about the origin, in axes of the platform.

    Units are those of force or moment over acceleration or velocity: kg, kg m, kg m^2 and kg/s, kg m/s, kg m^2/s.
    """

    frequency: Array = option("frequencies", unit="rad/s", shape=("frequency",), low=0, ascending=2)
    added_mass: Array = option("A at each frequency", shape=("frequency", 6, 6))
    damping: Array = option("B at each frequency", shape=("frequency", 6, 6))
    added_mass_infinite: Array = option("A at infinite frequency", shape=(6, 6))

    def check(self) -> None:
        """Check that added mass and damping are symmetric and not negative, as the energy of the waves is."""
        infinite = self.added_mass_infinite
        if np.any(np.diag(infinite) < 0.0):
            raise fail("RadiationTable.added_mass_infinite", np.diag(infinite), "at least 0 on the diagonal")
        for name, values in (("damping", self.damping), ("added_mass_infinite", infinite[None])):
            peak = np.sqrt(np.abs(np.einsum("kii->ki", values)).max(axis=0))
            # yaw of a round hull has noise alone, which counts as little as it is beside roll and pitch
            peak = np.maximum(peak, 0.01 * peak.reshape(2, 3).max(axis=1).repeat(3))
            relative = values / np.where(np.outer(peak, peak) > 0.0, np.outer(peak, peak), 1.0)
            turned = np.swapaxes(relative, 1, 2)
            for words, share in (
                ("symmetric, both sides equal", np.abs(relative - turned).max(axis=(1, 2))),
                ("positive semidefinite, its eigenvalues above 0", -0.5 * np.linalg.eigvalsh(relative + turned)[:, 0]),
            ):
                if share.max() > _NOISE:
                    at = f" at {self.frequency[share.argmax()]:g} rad/s" if name == "damping" else ""
                    allowed = f"{words} but for {_NOISE:g} of its peaks"
                    raise fail(f"RadiationTable.{name}{at}", round(float(share.max()), 3), allowed)

    def kernel(self) -> Complexes:
        """Return K(jω) = B(ω) + jω (A(ω) - A(∞)), shape (frequency, 6, 6), made symmetric.

        It is the transform of the impulse response of the radiation (T. F. Ogilvie, 5th Symposium on Naval
        Hydrodynamics, 1964). Panels have irregular frequencies, about which the added mass is not that of any flow: of
        motions with a larger imaginary part than a causal response can have, A follows from the damping B.
        """
        omega = self.frequency[:, None, None]
        inertia = omega * (self.added_mass - self.added_mass_infinite)
        real, imaginary = (np.abs(np.einsum("kii->ki", part)).max(axis=0) for part in (self.damping, inertia))
        if np.any(irregular := imaginary > _IRREGULAR * real):
            inertia = np.where(irregular[:, None] | irregular, self._causal(), inertia)
        k = self.damping + 1j * inertia
        return np.asarray(0.5 * (k + np.swapaxes(k, 1, 2)), np.complex128)

    def _causal(self) -> Array:
        """Imaginary part of the transform of the impulse response 2/π ∫ B cos(ωt) dω, which the damping has."""
        omega, gap = self.frequency, np.diff(self.frequency)
        time = np.linspace(0.0, np.pi / gap.max(), int(_TIMES * omega[-1] / gap.max()) + 2)
        share = 0.5 * (np.append(gap, 0.0) + np.append(0.0, gap))
        impulse = np.tensordot(np.cos(np.outer(time, omega)) * share, self.damping, 1)
        return np.asarray(-2.0 / np.pi * time[1] * np.tensordot(np.sin(np.outer(omega, time)), impulse, 1))


class _HeadingTable(Record):
    """Table of six components over frequency and heading of waves."""

    frequency: Array
    heading: Array
    force: Any
    is_mirrored: bool

    def check(self) -> None:
        """Check the headings."""
        name = type(self).__name__
        if np.any(np.diff(self.heading) <= 0.0):
            raise fail(f"{name}.heading", self.heading, "ascending")
        low = 0.0 if self.is_mirrored else self.heading[0]
        if self.is_mirrored and self.heading[0] > 1e-9:
            raise fail(f"{name}.heading[0]", self.heading[0], "0 or less where the platform is mirrored")
        if self.heading[-1] - low > 2.0 * np.pi + 1e-9:
            raise fail(f"{name}.heading", self.heading, "of one turn at most")

    def at(self, frequency: ArrayLike, heading: ArrayLike) -> NDArray[Any]:
        """Return ``force`` at pairs of frequencies [rad/s] and headings [rad], both (n,), as (n, 6).

        Values, or their real and imaginary parts, are linear in frequency and heading. Of a platform that is its own
        image in y, a wave from the other side has surge, heave and pitch of the same sign and sway, roll and yaw of the
        opposite sign.

        Raises
        ------
        InflowError
            If a frequency or a heading is outside of the table.
        """
        omega, beta = np.broadcast_arrays(np.asarray(frequency, np.float64), np.asarray(heading, np.float64))
        low, high = self.frequency[0], self.frequency[-1]
        if np.any(outside := (omega < low - 1e-9) | (omega > high + 1e-9)):
            raise InflowError(
                f"frequencies of waves must be from {low:g} to {high:g} rad/s, as in the table of the platform, "
                f"got {omega[outside][0]:g}"
            )
        angles, values = self._turn(np.asarray(self.force))
        start = angles[0]
        turned = start + np.mod(beta - start + 1e-9, 2.0 * np.pi) - 1e-9
        if np.any(outside := turned > angles[-1] + 1e-9):
            raise InflowError(
                f"headings of waves must be from {np.degrees(start):g} to {np.degrees(angles[-1]):g} degrees, as in "
                f"the table of the platform, got {np.degrees(beta[outside][0]):g}"
            )
        point = np.column_stack([np.clip(omega, low, high), np.clip(turned, start, angles[-1])])  # of rounding
        result: NDArray[Any] = RegularGridInterpolator((self.frequency, angles), values)(point)
        return result

    def _turn(self, values: NDArray[Any]) -> tuple[Array, NDArray[Any]]:
        """Headings and values, as far around as the table and its mirror image reach."""
        angles = self.heading
        if self.is_mirrored:
            half = angles >= -1e-9
            angles, values = np.abs(angles[half]), values[:, half]
            other = (angles > 1e-9) & (angles < np.pi - 1e-9)
            image = values[:, other] * np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
            angles = np.concatenate([-angles[other][::-1], angles])
            values = np.concatenate([image[:, ::-1], values], axis=1)
        gap = angles[0] + 2.0 * np.pi - angles[-1]
        if 1e-9 < gap <= 1.5 * np.max(np.diff(angles), initial=0.0):  # a full turn without its last heading
            angles, values = np.append(angles, angles[0] + 2.0 * np.pi), np.concatenate([values, values[:, :1]], axis=1)
        return angles, values


@option_record
class ExcitationTable(_HeadingTable):
    """Wave force per meter of amplitude over frequency and heading.

    The force is Re X e^{iωt} in a wave with its crest at the origin at t = 0; the heading is the direction towards
    which the wave travels, counter-clockwise from x. Forces [N/m], moments about the origin [N m/m].
    """

    frequency: Array = option("frequencies", unit="rad/s", shape=("frequency",), low=0, ascending=2)
    heading: Array = option("headings", unit="rad", shape=("heading",), low=-2 * np.pi, high=2 * np.pi)
    real: Array = option("real part of X", shape=("frequency", "heading", 6))
    imaginary: Array = option("imaginary part of X", shape=("frequency", "heading", 6))
    is_mirrored: bool = option("the platform is its own image in the plane of x and z", default=False)

    @property
    def force(self) -> Complexes:
        """Complex force X, shape (frequency, heading, 6)."""
        return self.real + 1j * self.imaginary


@option_record
class MeanDrift(_HeadingTable):
    """Mean wave force of second order over the square of the amplitude: the diagonal of WAMIT's ``.12d``.

    Slow forces follow by Newman's approximation: the force of a pair of components is the geometric mean of those of
    both alone (J. N. Newman, International Symposium on the Dynamics of Marine Vehicles and Structures in Waves, 1974;
    product of sums: R. G. Standing, W. J. Brendling and D. Wilson, OTC 5457, 1987). The mean is exact for waves of one
    direction, the slow part is good where it is much slower than the waves.
    """

    frequency: Array = option("frequencies", unit="rad/s", shape=("frequency",), low=0, ascending=2)
    heading: Array = option("headings", unit="rad", shape=("heading",), low=-2 * np.pi, high=2 * np.pi)
    force: Array = option("force [N/m^2] and moment [N m/m^2]", shape=("frequency", "heading", 6))
    is_mirrored: bool = option("the platform is its own image in the plane of x and z", default=False)


class StateSpace(NamedTuple):
    """Linear system x' = A x + B u, y = C x."""

    a: Array  #: Shape (n, n) [1/s].
    b: Array  #: Shape (n, 6).
    c: Array  #: Shape (6, n).

    @property
    def motion(self) -> Integers:
        """Which of the six motions drives each state of `fit_radiation`, shape (n,)."""
        return np.repeat(np.abs(self.b[1::2]).argmax(axis=1), 2)

    def response(self, frequency: ArrayLike) -> Complexes:
        """Return C (jω - A)^-1 B at frequencies [rad/s], shape (frequency, 6, 6)."""
        omega = np.atleast_1d(np.asarray(frequency, np.float64))
        unit = np.eye(len(self.a))
        return np.array([self.c @ np.linalg.solve(1j * w * unit - self.a, self.b) for w in omega])

    def discrete(self, step: float) -> tuple[Array, Array, Array]:
        """Return (Φ, Γ0, Γ1) of x(t + h) = Φ x(t) + Γ0 u(t) + Γ1 u(t + h), exact for u linear within a step h [s]."""
        n, m = self.b.shape
        whole = np.zeros((n + 2 * m, n + 2 * m))
        whole[:n, :n], whole[:n, n : n + m] = self.a * step, self.b * step
        whole[n : n + m, n + m :] = np.eye(m)
        exponential = expm(whole)
        last = exponential[:n, n + m :]
        return exponential[:n, :n], exponential[:n, n : n + m] - last, last


def fit_radiation(table: RadiationTable, order: int = ORDER) -> StateSpace:
    """Return a stable and passive system from velocity to the force of the memory of the water.

    The force on the platform is -y. Motions that couple have common poles, which vector fitting places (B. Gustavsen
    and A. Semlyen, IEEE Transactions on Power Delivery 14 (1999) 1052). The numerators follow from linear least
    squares. K(0) and K(∞) are 0 (T. Perez and T. I. Fossen, Modeling, Identification and Control 30 (2009) 1). No
    eigenvalue of Re K(jω) is negative: a motion of any frequency loses energy to the waves.

    Parameters
    ----------
    table : RadiationTable
    order : int
        Even number of poles of each group of coupled motions; each of its motions has as many states.
    """
    return _fitted(table, order)


@lru_cache(maxsize=16)
def _fitted(table: RadiationTable, order: int) -> StateSpace:
    k = table.kernel()
    omega = table.frequency
    size = np.sqrt(np.abs(np.einsum("kii->ki", k)).max(axis=0))
    scale = np.where(size > 0.0, size, 1.0)
    relative = k / np.outer(scale, scale)
    coupled = np.abs(relative).max(axis=0) > _COUPLED
    groups = connected_components(csr_array(coupled), directed=False)[1]
    parts = []
    for group in range(groups.max() + 1):
        motions = np.flatnonzero((groups == group) & (size > 0.0))
        if len(motions):
            parts.append((motions, _fit_group(omega, relative[:, motions[:, None], motions], order)))
    n = sum(order * len(motions) for motions, _ in parts)
    a, b, c, at = np.zeros((n, n)), np.zeros((n, 6)), np.zeros((6, n)), 0
    for motions, (pairs, numerators) in parts:
        for column, motion in enumerate(motions):
            for pair, (damping, stiffness) in enumerate(pairs):
                root = np.sqrt(stiffness)
                a[at : at + 2, at : at + 2] = [[0.0, root], [-root, -damping]]
                b[at + 1, motion] = root * scale[motion]
                c[motions, at] = numerators[:, column, 2 * pair] / stiffness * scale[motions]
                c[motions, at + 1] = numerators[:, column, 2 * pair + 1] / root * scale[motions]
                at += 2
    return StateSpace(a, b, c)


def _fit_group(omega: Array, k: Complexes, order: int) -> tuple[Array, Array]:
    """Denominators s² + a s + b as rows (a, b), and numerators n0 + n1 s, shape (m, m, order), of coupled motions."""
    m = k.shape[1]
    rows, columns = np.triu_indices(m)
    weight = np.sqrt(np.gradient(omega)) * np.maximum(_LOW / np.maximum(omega, 0.05 * _LOW), 1.0) ** 2
    weight *= np.minimum(_HIGH / np.maximum(omega, _LOW), 1.0)
    pairs = _pole_pairs(_place_poles(omega, k[:, rows, columns], weight, order))

    def basis(w: Array) -> Complexes:
        s = 1j * w[:, None]
        denominator = s**2 + pairs[:, 0] * s + pairs[:, 1]
        return np.stack([1.0 / denominator, s / denominator], axis=2).reshape(len(w), -1)

    static = np.zeros((1, order))
    static[0, ::2] = 1.0 / pairs[:, 1]
    free = null_space(static)  # numerators of K(0) = 0
    shape = basis(omega) @ free
    n, count = free.shape[1], len(rows)
    block = np.concatenate([shape.real, shape.imag]) * np.tile(weight, 2)[:, None]
    factor = np.where(rows == columns, 1.0, np.sqrt(2.0))  # an element beside the diagonal stands for two
    target = np.concatenate([k.real, k.imag])[:, rows, columns] * np.tile(weight, 2)[:, None]
    matrix, right = np.kron(np.diag(factor), block), (target * factor).T.ravel()
    offset = np.geomspace(0.02, 20.0, 80)  # about a weakly damped pair, which is narrow
    near = np.sqrt(pairs[:, 1:]) + pairs[:, :1] * np.concatenate([-offset, [0.0], offset])
    grid = np.unique(np.concatenate([np.geomspace(*_PASSIVE, 1000), near[near > _PASSIVE[0]]]))
    size = (grid + 1.0 / grid)[:, None] ** 2  # Re K goes as ω² at low, as 1/ω² at high frequencies
    real_shape = (basis(grid) @ free).real * size
    limits: list[Array] = []
    for _ in range(_CUTS):
        x = _least_squares_above(matrix, right, np.array(limits).reshape(-1, n * count), _MARGIN)
        real = np.zeros((len(grid), m, m))
        real[:, rows, columns] = real[:, columns, rows] = (real_shape @ x.reshape(count, n).T).reshape(-1, count)
        values, vectors = np.linalg.eigh(real)
        least = np.pad(values[:, 0], 1, constant_values=np.inf)
        lowest = (least[1:-1] <= least[:-2]) & (least[1:-1] <= least[2:])
        wrong = np.flatnonzero(lowest & (values[:, 0] < 0.5 * _MARGIN))
        for w in wrong:
            v = vectors[w, :, 0]
            sides = np.where(rows == columns, 1.0, 2.0) * v[rows] * v[columns]
            limits.append(np.outer(sides, real_shape[w]).ravel())
        if not len(wrong):
            break
    numerators = np.zeros((m, m, order))
    numerators[rows, columns] = numerators[columns, rows] = x.reshape(count, n) @ free.T
    resistive = (basis(grid)[:, 1::2].real * size).sum(axis=1)  # of s / (s² + a s + b), which no motion gains from
    rest = max(np.max((0.5 * _MARGIN - values[:, 0]) / resistive), 0.0)
    numerators[np.arange(m), np.arange(m), 1::2] += rest
    return pairs, numerators


def _place_poles(omega: Array, k: Complexes, weight: Array, order: int) -> Complexes:
    """Common poles of the columns of k by vector fitting, stable, complex ones in pairs that follow each other."""
    beta = np.geomspace(max(omega[0], 0.1), 0.6 * omega[-1], order // 2)
    poles = np.column_stack([-0.2 * beta + 1j * beta, -0.2 * beta - 1j * beta]).ravel()
    s = 1j * omega
    for _ in range(30):
        shape = np.zeros((len(s), order), np.complex128)
        a, b = np.zeros((order, order)), np.zeros(order)
        i = 0
        while i < order:
            p = poles[i]
            if p.imag == 0.0:
                shape[:, i], a[i, i], b[i] = 1.0 / (s - p), p.real, 1.0
                i += 1
                continue
            one, other = 1.0 / (s - p), 1.0 / (s - p.conjugate())
            shape[:, i], shape[:, i + 1] = one + other, 1j * (one - other)
            a[i : i + 2, i : i + 2] = [[p.real, p.imag], [-p.imag, p.real]]
            b[i] = 2.0
            i += 2
        n = k.shape[1]
        matrix = np.zeros((n, len(s), (n + 1) * order), np.complex128)
        for j in range(n):
            matrix[j, :, j * order : (j + 1) * order] = shape
            matrix[j, :, n * order :] = -k[:, j, None] * shape
        rows = (matrix * weight[:, None]).reshape(n * len(s), -1)
        right = (k * weight[:, None]).T.ravel()
        whole = np.concatenate([rows.real, rows.imag])
        norm = np.linalg.norm(whole, axis=0)
        x = np.linalg.lstsq(whole / norm, np.concatenate([right.real, right.imag]), rcond=1e-12)[0] / norm
        zeros = np.linalg.eigvals(a - np.outer(b, x[n * order :])).astype(np.complex128)
        zeros = -np.maximum(np.abs(zeros.real), _LEAST_DAMPED * np.abs(zeros)) + 1j * zeros.imag
        upper = zeros[zeros.imag > 0.0]
        real = zeros[zeros.imag == 0.0]
        poles = np.concatenate([np.column_stack([upper, upper.conj()]).ravel(), real])
    return poles


def _pole_pairs(poles: Complexes) -> Array:
    """Coefficients (a, b) of s² + a s + b of pairs of poles: complex ones, and real ones by size."""
    upper, real = poles[poles.imag > 0.0], np.sort(poles[poles.imag == 0.0].real)
    pairs = [(-2.0 * p.real, abs(p) ** 2) for p in upper]
    pairs += [(-(p + q), p * q) for p, q in zip(real[::2], real[1::2], strict=True)]
    return np.array(pairs)


def _least_squares_above(matrix: Array, right: Array, limits: Array, low: float) -> Array:
    """Return x of least |matrix x - right| with limits x ≥ low.

    Least distance programming (C. L. Lawson and R. J. Hanson, Solving Least Squares Problems, 1974, chapter 23).
    """
    norm = np.linalg.norm(matrix, axis=0)
    q, r = np.linalg.qr(matrix / norm)
    start = np.linalg.solve(r, q.T @ right)
    if len(limits):
        turned = np.linalg.solve(r.T, (limits / norm).T).T
        size = np.linalg.norm(turned, axis=1)
        least = (low - (limits / norm) @ start) / size
        system = np.concatenate([(turned / size[:, None]).T, least[None]])
        unit = np.zeros(len(system))
        unit[-1] = 1.0
        multiplier, _ = nnls(system, unit, maxiter=50 * system.shape[1])
        residual = system @ multiplier - unit
        start = start + np.linalg.solve(r, -residual[:-1] / residual[-1])
    result: Array = start / norm
    return result
