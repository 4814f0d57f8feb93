"""One substructure of the local observer frame formulation, and the arrays of a system.

The arrays of a system in local observer frames: named tuples, which compiled kernels take as they are.

Sizes: n_b bodies, n coordinates of the body that has most (others are padded with zeros), six of them rigid-body
coordinates at the end of its own; n_e elastic coordinates of the body with second-order displacements that has most;
n_m markers, n_row rows of the constraint equations, n_drive drives, n_spring springs, n_load loads, n_field consistent
ones. Integers are int64.

Letters stand where the theory has them (:mod:`wt_gym.multibody.observer_frame.frame`): q the coordinates, v and a their
rates q̇ and q̈; ω and α of the frames.

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

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space

from wt_gym.base.errors import WtGymError
from wt_gym.base.quantities import Array, Integers
from wt_gym.structure.beam import Beam, skew
from wt_gym.structure.flexible_body import particle_fields
from wt_gym.structure.modes import lowest_modes

Flags = NDArray[np.bool_]


class Model(NamedTuple):
    """Bodies, connections and loads. With rotation modes of the deformed body the matrices follow its shape."""

    n: Integers  # (n_b,) coordinates of a body
    first: Integers  # (n_b, n) first column of each row of the matrices that is not zero
    stiffness: Array  # (n_b, n, n) K, lower triangle as in all matrices
    damping: Array  # (n_b, n, n) C
    gyro: Array  # (n_b, 3, n, n) G_k
    second: Array  # (n_b, 6, n, n) ∫ N_kᵀ N_l for kl = 11, 22, 33 and the symmetric pairs 12, 13, 23
    first_moment: Array  # (n_b, n, 3) M₀ᵀ
    reference_moment: Array  # (n_b, n, 9) X
    ends: Array  # (n_b, 2, 3) points whose displacement is watched [m]
    reach: float  # largest distance of such a point from the origin of its body [m]
    mass_low: Array  # (n_b, n, n) factors of M
    mass_up: Array  # (n_b, n, n)
    gravity: Array  # (3,) fixed axes [m/s²]
    marker_body: Integers  # (n_m,)
    marker_position: Array  # (n_m, 3) in the frame, shortened by the bending known last [m]
    marker_shape: Array  # (n_m, 6, n) displacement and rotation per coordinate
    marker_held: Integers  # (n_m,) components on which constraint equations act: 0, 3 or 6
    mass_columns: Array  # (n_m, 6, n) M⁻¹ shapeᵀ
    mass_pairs: Array  # (n_m, n_m, 6, 6) shape M⁻¹ shapeᵀ
    row_kind: Integers  # (n_row,) DISPLACEMENT, ORTHOGONAL or TORQUE
    row_marker: Integers  # (n_row, 2) markers; −1: the ground
    row_vector: Array  # (n_row, 2, 3) direction and place, or vectors fixed in the two sections
    load_marker: Integers  # (n_load,)
    load_axes: Integers  # (n_load,) FIXED … CONSISTENT
    load_field: Integers  # (n_load,) index of a consistent load in load_second
    load_second: Array  # (n_field, 3, n, n) second-order displacement H of its point
    marker_lever: Array  # (n_m, 3) displacement of the marker with which the rotation modes turn it [m]
    reference_first: Array  # (n_b, 3) ∫ s dm [kg m]
    reference_second: Array  # (n_b, 3, 3) ∫ s sᵀ dm [kg m²]
    deformed_modes: bool  # whether rotation modes turn the body as it is deformed
    prediction: int  # UNIFORM, MEAN or PRINTED
    row_drive: Integers  # (n_row,) drive that turns the second vector; −1: none
    row_axis: Array  # (n_row, 3) its axis, or that of the hinge, second section
    row_spring: Integers  # (n_row,) spring of a TORQUE row; −1: none
    row_stiffness: Array  # (n_row,) [N m/rad]
    row_damping: Array  # (n_row,) [N m s/rad]
    row_inertia: Array  # (n_row,) of rotors geared to the hinge [kg m²]
    load_section: Integers  # (n_b,) marker for which `Work.body_load` is known; −1: none
    rule: Array  # (4,) β, γ, αm, αf of the steps
    definite: Flags  # (n_b,) whether M is positive definite by itself
    bends: Flags  # (n_b,) whether the body has second-order displacements
    bend_first: Array  # (n_b, 3, n_e, n_e) ∫ H_k
    bend_moment: Array  # (n_b, 9, n_e, n_e) ∫ H_k s_l, k first
    bend_mass: Array  # (n_b, n_e, n_e, n_e) ∫ N_i · H_jm
    bend_marker: Array  # (n_m, 3, n_e, n_e) H of the markers
    elastic_first: Array  # (n_b, n_e, 3) M₀ᵀ of the undeformed shapes
    elastic_moment: Array  # (n_b, n_e, 9) X of the undeformed shapes
    marker_place: Array  # (n_m, 3) position of the undeformed marker [m]
    marker_linear: Array  # (n_m, 3, n_e) its displacement per elastic coordinate
    extra_mass: Array  # (n_b, n_e, n_e) what bending adds to the elastic mass matrix
    geometric: Array  # (n_b, n_e, n_e) geometric stiffness K_g


class State(NamedTuple):
    """Motion of the frames, and of the bodies in them."""

    position: Array  # (n_b, 3) origin of the frame, fixed axes [m]
    rotation: Array  # (n_b, 3, 3) frame to fixed axes
    velocity: Array  # (n_b, 3) fixed axes [m/s]
    omega: Array  # (n_b, 3) ω, frame axes [rad/s]
    acceleration: Array  # (n_b, 3) fixed axes [m/s²]
    alpha: Array  # (n_b, 3) α, frame axes [rad/s²]
    q: Array  # (n_b, n)
    v: Array  # (n_b, n) q̇
    a: Array  # (n_b, n) q̈
    lead: Array  # (n_b, n) pseudo-acceleration of the generalized-α scheme minus q̈
    deformed: Array  # (n_b, n) elastic coordinates of the shape that the matrices know
    multiplier: Array  # (n_row,) λ [N, N m]
    age: Array  # (n_b,) time since the frame was updated [s]
    turned: Array  # (n_b, 3) rotation vector of the frame over the step [rad]
    n_updates: Integers  # (n_b,) of the frame
    angle: Array  # (n_spring,) of the hinges, through whole turns [rad]
    reaction: Array  # (n_m, 3) force of the body on others at a held marker, frame axes [N]


class Work(NamedTuple):
    """Scratch of the kernels, what drives and springs say, and what the rows are now."""

    low: Array  # (n_b, n, n) factors of the matrices S of the step
    up: Array  # (n_b, n, n)
    columns: Array  # (n_m, 6, n) S⁻¹ shapeᵀ
    pairs: Array  # (n_m, n_m, 6, 6) shape S⁻¹ shapeᵀ
    base: Array  # (n_b, n) right-hand side of a step without loads
    rhs: Array  # (n_b, n) right-hand side, then increment of q
    next: Array  # (n_b, n) q at the end of the step
    vector: Array  # (n_b, n) coordinates in use
    schur: Array  # (n_row, n_row) B A⁻¹ Bᵀ, then its factors
    multiplier: Array  # (n_row,) right-hand side of the multipliers, then these
    row_value: Array  # (n_row,) φ, or the angle of a hinge [m, rad]
    row_rate: Array  # (n_row,) φ̇ [m/s, rad/s]
    row_bias: Array  # (n_row,) φ̈ without q̈ [m/s², rad/s²]
    weight: Array  # (n_row, 2, 6) action of a unit multiplier on the two markers, frame axes
    marker_rotation: Array  # (n_m, 3, 3) section to fixed axes
    marker_tangent: Array  # (n_m, 3, 3) tangent of its rotation from the frame
    marker_point: Array  # (n_m, 3) position, fixed axes [m]
    marker_rate: Array  # (n_m, 6) velocity and angular velocity, fixed axes [m/s, rad/s]
    marker_bias: Array  # (n_m, 6) accelerations without q̈ [m/s², rad/s²]
    marker_field: Array  # (n_m, 6) displacement and rotation for coordinates in use
    turn: Array  # (3, 3) a rotation in use
    tangent: Array  # (3, 3) its tangent
    angle: Array  # (3,) a vector in use
    spare: Array  # (3,) a vector in use
    lever: Array  # (3,) a vector in use
    one: Array  # (3,) vector of the first section of a row, fixed axes
    two: Array  # (3,) vector of the second section, fixed axes
    normal: Array  # (3,) direction of a row, fixed axes
    normal_rate: Array  # (3,) its rate
    field: Array  # (6,) displacement and rotation of a marker
    field_rate: Array  # (6,) their rates
    rate: Array  # (6,) velocities of a marker
    bias: Array  # (6,) accelerations without q̈
    pull: Array  # (6,) force and moment on a marker
    load: Array  # (6,) force and moment of a load
    moments: Array  # (n, 9) ∫ N_i yᵀ of the deformed body
    second: Array  # (3, 3) ∫ y yᵀ [kg m²]
    mixed: Array  # (3, 3) ∫ y sᵀ [kg m²]
    mean: Array  # (3,) ∫ y [kg m]
    pair: Array  # (3, 3) a matrix in use
    drive: Array  # (n_drive, 3) angle, rate and acceleration [rad, rad/s, rad/s²]
    spring: Array  # (n_spring, 3) references of angle and rate, torque [rad, rad/s, N m]
    body_load: Array  # (n_b, n) loads known for a section: elastic forces, force and moment
    row_change: Array  # (n_row,) rates of the rows for a change of q̇
    axis: Array  # (3,) of a drive or hinge, fixed axes
    second_rate: Array  # (3,) angular velocity of the second vector [rad/s]
    second_bias: Array  # (3,) its angular acceleration without q̈ [rad/s²]
    order: Integers  # (n_row,) row exchanges of schur
    row_scale: Array  # (n_row,) factor of the equations of hinges
    row_reach: Array  # (n_row, n_m, 6) what the unit multiplier of a row moves on every marker
    ahead: Array  # (n_b, n) q̇ expected at the end of the step


REFERENCE_CONDITIONS = ("clamped", "simply_supported", "three_quarter")
DISPLACEMENTS = ("linear", "second_order")
"""Displacement from the moving frame: N q as published, or N q + ½ qᵀ H q, which brings the geometric stiffness."""


class ObserverFrameError(WtGymError, ValueError):
    """A system in local observer frames that cannot be built or integrated."""


def reference_condition(beam: Beam, name: str) -> Array:
    """Rows C (6, n_dof) of a reference condition: C q_nodal = 0 for shapes that comply with it.

    Parameters
    ----------
    name : str
        One of :data:`REFERENCE_CONDITIONS`.

    Raises
    ------
    ObserverFrameError
        For another name.
    """
    if name not in REFERENCE_CONDITIONS:
        raise ObserverFrameError(f"reference condition must be one of {', '.join(REFERENCE_CONDITIONS)}, got {name!r}")
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


def rigid_modes(beam: Beam) -> Array:
    """Nodal displacements (n_dof, 6) of the linearized rigid-body motions about the origin of the body frame."""
    modes = np.zeros((beam.n_dof, 6))
    for node, p in enumerate(beam.node_position):
        modes[6 * node : 6 * node + 3, :3] = np.eye(3)
        modes[6 * node : 6 * node + 3, 3:] = -skew(p)
        modes[6 * node + 3 : 6 * node + 6, 3:] = np.eye(3)
    return modes


def _complying_vectors(rows: Array) -> Array:
    """Columns (n_dof, n_dof − 6) that span the null space of C; unit vectors where the rows allow it."""
    single = np.count_nonzero(rows, axis=1) == 1
    if np.all(single):
        held = np.argmax(np.abs(rows), axis=1)
        return np.delete(np.eye(rows.shape[1]), held, axis=1)
    return cast("Array", null_space(rows))


@dataclass(frozen=True)
class Place:
    """A named section of a body: where it is and how the elastic coordinates move it.

    Attributes
    ----------
    position : array (3,)
        Undeformed, in the body frame [m].
    field : array (6, n_f)
        Displacement and rotation per elastic coordinate.
    second_order : callable
        Without arguments; the second-order displacement H (3, n_f, n_f) of the point, computed when it is needed.
    """

    position: Array
    field: Array
    second_order: Callable[[], Array] = dataclasses.field(repr=False)

    @classmethod
    def on_beam(cls, beam: Beam, basis: Array, s: float) -> Place:
        """The section of a beam at the arc length s [m]."""
        linear = np.vstack(beam.linear_field(s, basis))
        return cls(beam.sections.axis_at(s), linear, partial(_second_order, beam, basis, s))

    def shape(self) -> Array:
        """Displacement and rotation (6, n) per coordinate, rigid-body motions last."""
        rigid = np.eye(6)
        rigid[:3, 3:] = -skew(self.position)
        return np.hstack([self.field, rigid])


def _second_order(beam: Beam, basis: Array, s: float) -> Array:
    return beam.second_order_field(basis).at(s)


def seen_from_frame(second: Array, position: Array, linear: Array, rigid: Array) -> Array:
    """Second-order displacement H of points seen from a frame that moves against the root as the shapes say.

    A point at r = s + S q + ½ qᵀ H q from the root, whose place and rotation vector in the frame are (u, φ) = R q, is
    at u + exp(φ̃) r, in which the terms of second order are

        H_ij + φ_i × S_j + φ_j × S_i + ½ [φ_i × (φ_j × s) + φ_j × (φ_i × s)].

    Parameters
    ----------
    second : array (n_p, 3, n, n)
    position : array (n_p, 3)
        s [m].
    linear : array (n_p, 3, n)
        S, clamped at the root.
    rigid : array (6, n)
        R.
    """
    if not np.any(rigid):
        return second
    out, turn = np.array(second), [skew(phi) for phi in rigid[3:].T]
    for i, one in enumerate(turn):
        swing = np.einsum("ab,pbj->paj", one, linear)
        out[:, :, i, :] += swing
        out[:, :, :, i] += swing
        for j, two in enumerate(turn):
            out[:, :, i, j] += 0.5 * position @ (one @ two + two @ one).T
    return out


@dataclass(frozen=True)
class SecondOrder:
    """Integrals of the second-order displacement ½ qᵀ H q of a body with n elastic coordinates.

    Attributes
    ----------
    first : array (3, n, n)
        ∫ H_k.
    moment : array (9, n, n)
        ∫ H_k s_l, k first.
    mass : array (n, n, n)
        ∫ N_i · H_jm.
    particles : callable
        Without arguments; H (n_p, 3, n, n) of the mass points.
    """

    first: Array
    moment: Array
    mass: Array
    particles: Callable[[], Array]

    @classmethod
    def from_points(cls, mass: Array, position: Array, linear: Array, particles: Callable[[], Array]) -> SecondOrder:
        """Sums over mass points (n_p,) at positions (n_p, 3) with elastic shapes (n_p, 3, n)."""
        second, n = particles(), linear.shape[2]
        return cls(
            first=np.einsum("p,pkij->kij", mass, second),
            moment=np.einsum("pkij,pl->klij", second, mass[:, None] * position, optimize=True).reshape(9, n, n),
            mass=np.einsum("pki,pkjm->ijm", mass[:, None, None] * linear, second, optimize=True),
            particles=particles,
        )


@dataclass(frozen=True)
class Substructure:
    """A body in a moving frame, in q = [q_f (n_f), q_r (6)].

    Attributes
    ----------
    places : dict of str to Place
        Named sections; "root" and "tip" exist on every beam.
    frequency : array (n_f,)
        Natural frequencies [rad/s] of the elastic modes at rest in the reference condition; empty when not computed.
    ends : array (2, 3)
        Points whose rigid-body displacement is watched for updates on demand [m].
    particle_mass : array (n_p,)
    particle_position : array (n_p, 3)
    particle_shape : array (n_p, 3, n)
        Mass points and their displacement per coordinate.
    stiffness, damping : array (n, n)
    first_moment : array (n, 3)
        M₀ᵀ.
    gyro : array (3, n, n)
        G_k, skew-symmetric.
    second : array (6, n, n)
        ∫ N_kᵀN_l for kl = 11, 22, 33 and the symmetric pairs 12, 13, 23.
    reference_moment : array (n, 9)
        X.
    definite : bool
        Whether the mass matrix is positive definite by itself; not that of a body that shares the inertia of a rotor.
    beam : Beam or None
    basis : array (n_dof, n) or None
        Nodal displacements of the coordinates of a beam; the last six columns are the rigid-body modes.
    second_order : SecondOrder or None
        Of a body whose displacement is N q + ½ qᵀ H q; None: N q, as published.
    """

    name: str
    reference: str
    places: dict[str, Place]
    frequency: Array
    ends: Array
    particle_mass: Array = dataclasses.field(repr=False)
    particle_position: Array = dataclasses.field(repr=False)
    particle_shape: Array = dataclasses.field(repr=False)
    stiffness: Array = dataclasses.field(repr=False)
    damping: Array = dataclasses.field(repr=False)
    first_moment: Array = dataclasses.field(repr=False)
    gyro: Array = dataclasses.field(repr=False)
    second: Array = dataclasses.field(repr=False)
    reference_moment: Array = dataclasses.field(repr=False)
    definite: bool = True
    beam: Beam | None = dataclasses.field(default=None, repr=False)
    basis: Array | None = dataclasses.field(default=None, repr=False)
    second_order: SecondOrder | None = dataclasses.field(default=None, repr=False)

    @classmethod
    def from_points(
        cls,
        name: str,
        points: tuple[Array, Array, Array],
        stiffness: Array,
        damping: Array,
        places: dict[str, Place],
        ends: Array,
        *,
        reference: str = "given",
        second: Callable[[], Array] | None = None,
        **more: Any,
    ) -> Substructure:
        """Build a substructure from mass points.

        Parameters
        ----------
        points : (array (n_p,), array (n_p, 3), array (n_p, 3, n_f))
            Masses [kg], positions [m] and displacements per elastic coordinate, in the body frame.
        stiffness, damping : array (n_f, n_f)
            Of the elastic coordinates.
        places : dict of str to Place
        ends : array (2, 3)
            Points whose rigid-body displacement is watched [m].
        reference : str
            Name of the condition with which the elastic shapes comply.
        second : callable, optional
            Without arguments; the second-order displacement H (n_p, 3, n_f, n_f) of the points.
        **more
            ``frequency``, ``definite``, ``beam`` and ``basis``.
        """
        mass, position, linear = points
        rigid = np.concatenate([np.tile(np.eye(3), (len(mass), 1, 1)), -skew(position)], axis=2)
        shape = np.concatenate([linear, rigid], axis=2)
        n = shape.shape[2]
        strain = np.zeros((2, n, n))
        strain[0, :-6, :-6], strain[1, :-6, :-6] = stiffness, damping
        more.setdefault("frequency", np.zeros(0))
        if second is not None:
            more["second_order"] = SecondOrder.from_points(mass, position, linear, second)
        constants: dict[str, Any] = _integrals(mass, position, shape)
        return cls(name, reference, places, ends=ends, particle_mass=mass, particle_position=position,
                   particle_shape=shape, stiffness=strain[0], damping=strain[1], **constants, **more)  # fmt: skip

    @classmethod
    def from_beam(
        cls,
        name: str,
        beam: Beam,
        reference: str = "clamped",
        n_modes: int | None = None,
        damping_time: float = 0.0,
        markers: Mapping[str, float] | None = None,
        displacement: str = "linear",
    ) -> Substructure:
        """Build a substructure from a beam.

        Parameters
        ----------
        reference : str
            One of :data:`REFERENCE_CONDITIONS`.
        n_modes : int, optional
            Number of elastic eigenmodes that comply with the reference condition (eq. 16); None keeps all nodal
            coordinates (full finite elements), 0 gives a rigid body.
        damping_time : float
            Stiffness-proportional damping [s]; the damping ratio at the frequency ω is damping_time · ω / 2.
        markers : dict of str to float, optional
            Further named arc lengths [m].
        displacement : str
            One of :data:`DISPLACEMENTS`. The second-order displacement is that of shapes which are at rest at the root,
            so that it needs the reference condition "clamped".

        Raises
        ------
        ObserverFrameError
            For an unknown reference condition or displacement, a number of modes the beam does not have, or a marker
            off the beam.
        """
        check_displacement(displacement)
        if displacement == "second_order" and reference != "clamped":
            raise ObserverFrameError(
                f"substructure {name!r}: displacement 'second_order' needs the reference 'clamped', not {reference!r}"
            )
        rows = reference_condition(beam, reference)
        complying = _complying_vectors(rows)
        available = complying.shape[1]
        if n_modes is not None and not 0 <= n_modes <= available:
            raise ObserverFrameError(f"substructure {name!r}: n_modes must be 0 … {available}, got {n_modes}")
        if damping_time < 0.0:
            raise ObserverFrameError(f"substructure {name!r}: damping_time must not be negative, got {damping_time}")
        frequency = np.zeros(0)
        if n_modes == 0:
            complying = complying[:, :0]
        elif n_modes is not None:
            stiffness, mass = (complying.T @ a @ complying for a in (beam.stiffness, beam.mass))
            try:
                value, vector = lowest_modes(stiffness, mass, n_modes)
            except ValueError as error:
                raise ObserverFrameError(f"substructure {name!r}: the mass matrix is singular") from error
            frequency, complying = np.sqrt(np.maximum(value, 0.0)), complying @ vector
        stations = {"root": beam.nodes[0], "tip": beam.nodes[-1]} | dict(markers or {})
        for key, s in stations.items():
            if not beam.nodes[0] <= s <= beam.nodes[-1]:
                allowed = f"[{beam.nodes[0]}, {beam.nodes[-1]}]"
                raise ObserverFrameError(f"substructure {name!r}: marker {key!r} at {s} m lies outside {allowed} m")
        places = {key: Place.on_beam(beam, complying, s) for key, s in stations.items()}
        stiffness = complying.T @ beam.stiffness @ complying
        linear = np.einsum("pia,an->pin", beam.particle_shape, complying, optimize=True)
        points = beam.particle_mass, beam.particle_position, linear
        ends, basis = beam.node_position[[0, -1]], np.hstack([complying, rigid_modes(beam)])
        second = None
        if displacement == "second_order" and complying.shape[1]:
            second = partial(_second_of_particles, beam, complying)
        return cls.from_points(name, points, stiffness, damping_time * stiffness, places, ends, reference=reference,
                               frequency=frequency, beam=beam, basis=basis, second=second)  # fmt: skip

    @property
    def n(self) -> int:
        """Number of coordinates, elastic and rigid."""
        return len(self.stiffness)

    @property
    def n_elastic(self) -> int:
        """Number of elastic coordinates."""
        return self.n - 6

    @property
    def mass_matrix(self) -> Array:
        """M (n, n)."""
        return cast("Array", self.second[:3].sum(axis=0))

    def marker_shape(self, name: str) -> Array:
        """Displacement and rotation (6, n) of the axis at a marker per coordinate, in frame axes."""
        return self.places[name].shape()

    def marker_position(self, name: str) -> Array:
        """Undeformed position (3,) of a marker in the frame [m]."""
        return self.places[name].position

    def displacement(self, place: Place, q: Array) -> Array:
        """Displacement and rotation (6,) of a :class:`Place` from the moving frame, for elastic coordinates (n_f,)."""
        field: Array = place.field @ q
        if self.second_order is not None:
            field[:3] += 0.5 * place.second_order() @ q @ q
        return field

    def envelope(self) -> Integers:
        """First non-zero column (n,) of each row of the lower triangles of all matrices."""
        if self.second_order is not None:
            return np.zeros(self.n, dtype=np.int64)  # the deformed body couples all its coordinates
        matrices = np.concatenate([self.stiffness[None], self.damping[None], self.gyro, self.second])
        scale = np.abs(matrices).max(axis=(1, 2), keepdims=True)
        filled = (np.abs(matrices) > 1e-14 * np.maximum(scale, 1e-300)).any(axis=0)
        np.fill_diagonal(filled, True)
        first: Integers = np.argmax(filled | filled.T, axis=1)
        first[-6:] = 0  # a deformed body couples its rigid-body modes to everything
        return first


def check_displacement(name: str) -> None:
    """Refuse a displacement that is none of :data:`DISPLACEMENTS`."""
    if name not in DISPLACEMENTS:
        raise ObserverFrameError(f"displacement must be one of {', '.join(DISPLACEMENTS)}, got {name!r}")


def _second_of_particles(beam: Beam, basis: Array) -> Array:
    return particle_fields(beam, basis).second


def _integrals(m: Array, s: Array, shape: Array) -> dict[str, Array]:
    """Constant matrices of mass points m (n_p,) at s (n_p, 3) with shapes (n_p, 3, n)."""
    n = np.swapaxes(shape, 0, 1)
    weighted = m[:, None] * n
    e = np.array([[weighted[a].T @ n[b] for b in range(3)] for a in range(3)])
    pairs = [e[0, 1] + e[1, 0], e[0, 2] + e[2, 0], e[1, 2] + e[2, 1]]
    return {
        "first_moment": weighted.sum(axis=1).T,
        # Nᵀ ẽ_k N with (ẽ₁)₃₂ = 1, (ẽ₁)₂₃ = −1 and cyclic
        "gyro": np.array([e[2, 1] - e[1, 2], e[0, 2] - e[2, 0], e[1, 0] - e[0, 1]]),
        "second": np.array([e[0, 0], e[1, 1], e[2, 2], *pairs]),
        "reference_moment": np.einsum("ipn,pj->nij", weighted, s, optimize=True).reshape(-1, 9),
    }
