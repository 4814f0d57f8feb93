"""One substructure of the local observer frame formulation: rigid-body modes, elastic basis and constant matrices.

The displacement from the moving frame is u(s, t) = N(s) q(t) with q = [q_f, q_r] (eq. 2): six rigid-body coordinates
q_r (displacement of the frame origin and rotation about it) and elastic coordinates q_f whose shapes comply with a
*reference condition*, which says what "the rigid body" of a deformed beam is:

- ``"clamped"``: it moves with the root section (fig. 1a);
- ``"simply_supported"``: its axis is the chord from root to tip, its roll that of the root section (fig. 1b);
- ``"three_quarter"``: the same with the point at three quarters of the length in place of the tip.

With N the shapes of the mass points the constant matrices are sums over them, split by the frame axes so that any
angular velocity can be inserted afterwards (eqs 7–8 without their ω):

    M = Σ m NᵀN     M₀ = Σ m N     G_k = Σ m Nᵀ ẽ_k N     A_kl = Σ m (N_kᵀ N_l + N_lᵀ N_k)     X = Σ m Nᵀ ⊗ s.

(K. Holm-Jørgensen, S. R. K. Nielsen, R. Rubak, System reduction in nonlinear multibody dynamics of wind turbines.)
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import eigh, null_space

from wt_gym.errors import WtGymError
from wt_gym.structure.beam import skew

__all__ = ["REFERENCE_CONDITIONS", "ObserverFrameError", "Substructure", "reference_condition"]

REFERENCE_CONDITIONS = ("clamped", "simply_supported", "three_quarter")


class ObserverFrameError(WtGymError, ValueError):
    """A system in local observer frames that cannot be built or integrated."""


def reference_condition(beam, name):
    """Rows C (6, n_dof) of a reference condition: C q_nodal = 0 for shapes that comply with it.

    Parameters
    ----------
    beam : Beam
    name : str
        One of :data:`REFERENCE_CONDITIONS`.

    Raises
    ------
    ObserverFrameError
        For another name.
    """
    if name not in REFERENCE_CONDITIONS:
        raise ObserverFrameError(f"reference condition {name!r} is unknown; allowed: {', '.join(REFERENCE_CONDITIONS)}")
    rows = np.zeros((6, beam.n_dof))
    rows[:6, :6] = np.eye(6)
    if name == "clamped":
        return rows
    first, last = beam.nodes[0], beam.nodes[-1]
    support = last if name == "simply_supported" else first + 0.75 * (last - first)
    element, xi = beam.locate(support)
    shape = beam.shape(element, xi)[0, :3]
    shape[np.abs(shape) < 1e-9] = 0.0  # a support on a node reads that node alone
    chord = beam.sections.axis_at(support) - beam.node_position[0]
    along = chord / np.linalg.norm(chord)
    across = np.eye(3)[[0, 1]] - np.outer(along[:2], along)
    across[0] /= np.linalg.norm(across[0])
    across[1] = np.cross(along, across[0])
    rows[3:] = 0.0
    rows[3:5, 6 * element : 6 * element + 12] = across @ shape
    rows[5, 3:6] = along
    return rows


def rigid_modes(beam):
    """Nodal displacements (n_dof, 6) of the linearised rigid-body motions about the origin of the body frame."""
    modes = np.zeros((beam.n_dof, 6))
    for node, p in enumerate(beam.node_position):
        modes[6 * node : 6 * node + 3, :3] = np.eye(3)
        modes[6 * node : 6 * node + 3, 3:] = -skew(p)
        modes[6 * node + 3 : 6 * node + 6, 3:] = np.eye(3)
    return modes


def _complying_vectors(rows):
    """Columns (n_dof, n_dof − 6) that span the null space of C; unit vectors where the rows allow it."""
    single = np.count_nonzero(rows, axis=1) == 1
    if np.all(single):
        held = np.argmax(np.abs(rows), axis=1)
        return np.delete(np.eye(rows.shape[1]), held, axis=1)
    return null_space(rows)


@dataclass(frozen=True)
class Substructure:
    """A beam in a moving frame, in q = [q_f (n_f), q_r (6)].

    Attributes
    ----------
    name, reference : str
    beam : Beam
    basis : array (n_dof, n)
        Nodal displacements of the coordinates; the last six columns are the rigid-body modes.
    frequency : array (n_f,)
        Natural frequencies [rad/s] of the elastic modes at rest in the reference condition; empty for finite elements.
    damping_time : float
        C = damping_time · K [s].
    markers : dict of str to float
        Named arc lengths [m] on the axis; "root" and "tip" exist always.
    stiffness : array (n, n)
    first_moment : array (n, 3)
        M₀ᵀ.
    gyro : array (3, n, n)
        G_k, skew-symmetric.
    second : array (6, n, n)
        ∫ N_kᵀN_l for kl = 11, 22, 33 and the symmetric pairs 12, 13, 23.
    reference_moment : array (n, 9)
        X.
    """

    name: str
    reference: str
    beam: object
    basis: np.ndarray
    frequency: np.ndarray
    damping_time: float
    markers: dict
    stiffness: np.ndarray = field(repr=False)
    first_moment: np.ndarray = field(repr=False)
    gyro: np.ndarray = field(repr=False)
    second: np.ndarray = field(repr=False)
    reference_moment: np.ndarray = field(repr=False)

    @classmethod
    def from_beam(cls, name, beam, reference="clamped", n_modes=None, damping_time=0.0, markers=None):
        """Build a substructure.

        Parameters
        ----------
        name : str
        beam : Beam
        reference : str
            One of :data:`REFERENCE_CONDITIONS`.
        n_modes : int, optional
            Number of elastic eigenmodes that comply with the reference condition (eq. 16); None keeps all nodal
            coordinates (full finite elements), 0 gives a rigid body.
        damping_time : float
            Stiffness-proportional damping [s]; the damping ratio at the frequency ω is damping_time · ω / 2.
        markers : dict of str to float, optional
            Further named arc lengths [m].

        Raises
        ------
        ObserverFrameError
            For an unknown reference condition, a number of modes the beam does not have, or a marker off the beam.
        """
        rows = reference_condition(beam, reference)
        complying = _complying_vectors(rows)
        available = complying.shape[1]
        if n_modes is not None and not 0 <= n_modes <= available:
            raise ObserverFrameError(f"substructure {name!r}: {n_modes} modes wanted, 0 … {available} exist")
        if damping_time < 0.0:
            raise ObserverFrameError(f"substructure {name!r}: damping_time must not be negative, got {damping_time}")
        frequency = np.zeros(0)
        if n_modes == 0:
            complying = complying[:, :0]
        elif n_modes is not None:
            stiffness, mass = (complying.T @ a @ complying for a in (beam.stiffness, beam.mass))
            try:
                value, vector = eigh(stiffness, mass, subset_by_index=[0, n_modes - 1])
            except np.linalg.LinAlgError as error:
                raise ObserverFrameError(f"substructure {name!r}: the mass matrix is singular") from error
            frequency, complying = np.sqrt(np.maximum(value, 0.0)), complying @ vector
        basis = np.hstack([complying, rigid_modes(beam)])
        points = {"root": beam.nodes[0], "tip": beam.nodes[-1]} | dict(markers or {})
        for key, s in points.items():
            if not beam.nodes[0] <= s <= beam.nodes[-1]:
                allowed = f"[{beam.nodes[0]}, {beam.nodes[-1]}]"
                raise ObserverFrameError(f"substructure {name!r}: marker {key!r} at {s} m lies outside {allowed} m")
        return cls(name, reference, beam, basis, frequency, float(damping_time), points, **_integrals(beam, basis))

    @property
    def n(self):
        """Number of coordinates, elastic and rigid."""
        return self.basis.shape[1]

    @property
    def n_elastic(self):
        """Number of elastic coordinates."""
        return self.n - 6

    @property
    def mass_matrix(self):
        """M (n, n)."""
        return self.second[:3].sum(axis=0)

    def gyroscopic_matrix(self, omega):
        """G (n, n) of eq. (8) for an angular velocity (3,) in frame axes [rad/s]."""
        return np.einsum("k,kij->ij", omega, self.gyro)

    def centrifugal_matrix(self, omega):
        """D (n, n) of eq. (7) for an angular velocity (3,) in frame axes [rad/s]."""
        w = np.asarray(omega, dtype=float)
        weight = np.array([*(w * w - w @ w), w[0] * w[1], w[0] * w[2], w[1] * w[2]])
        return np.einsum("k,kij->ij", weight, self.second)

    def marker_shape(self, name):
        """Displacement and rotation (6, n) of the axis at a marker per coordinate, in frame axes."""
        element, xi = self.beam.locate(self.markers[name])
        return self.beam.shape(element, xi)[0] @ self.basis[6 * element : 6 * element + 12]

    def marker_position(self, name):
        """Undeformed position (3,) of a marker in the frame [m]."""
        return self.beam.sections.axis_at(self.markers[name])

    def envelope(self):
        """First non-zero column (n,) of each row of the lower triangles of all matrices."""
        matrices = np.concatenate([self.stiffness[None], self.gyro, self.second])
        scale = np.abs(matrices).max(axis=(1, 2), keepdims=True)
        filled = (np.abs(matrices) > 1e-14 * np.maximum(scale, 1e-300)).any(axis=0)
        np.fill_diagonal(filled, True)
        first = np.argmax(filled | filled.T, axis=1)
        first[-6:] = 0  # a deformed body couples its rigid-body modes to everything
        return first


def _integrals(beam, basis):
    """Constant matrices of a basis by sums over the mass points of the beam."""
    m, s = beam.particle_mass, beam.particle_position
    n = np.einsum("pia,an->ipn", beam.particle_shape, basis, optimize=True)
    weighted = m[:, None] * n
    e = np.array([[weighted[a].T @ n[b] for b in range(3)] for a in range(3)])
    pairs = [e[0, 1] + e[1, 0], e[0, 2] + e[2, 0], e[1, 2] + e[2, 1]]
    stiffness = basis.T @ beam.stiffness @ basis
    stiffness[-6:], stiffness[:, -6:] = 0.0, 0.0  # rigid-body motions strain nothing; removes rounding errors
    return {
        "stiffness": stiffness,
        "first_moment": weighted.sum(axis=1).T,
        # Nᵀ ẽ_k N with (ẽ₁)₃₂ = 1, (ẽ₁)₂₃ = −1 and cyclic
        "gyro": np.array([e[2, 1] - e[1, 2], e[0, 2] - e[2, 0], e[1, 0] - e[0, 1]]),
        "second": np.array([e[0, 0], e[1, 1], e[2, 2], *pairs]),
        "reference_moment": np.einsum("ipn,pj->nij", weighted, s).reshape(-1, 9),
    }
