"""The arrays of a multibody system: named tuples, which compiled kernels take as they are, and what is refused.

Sizes: n_b bodies, n_f elastic coordinates of the body that has most (others are padded with zeros), n_full those of the
body with most complete integrals, n_u velocities, n_q positions, n_servo servos, n_c constraint equations, n_con
constraints, n_m = n_b + 2 n_con frames (those of all joints, then both ends of every constraint). The state is y =
[q (n_q), u (n_u), servo angles (n_servo), servo rates (n_servo)], n_state numbers. "Body axes" are those of a body's
frame, whose origin is at its joint. Integers are int64.

Letters stand where the theory has them (:mod:`wt_gym.multibody.tree.tree_kernels`,
:mod:`wt_gym.structure.flexible_body`): y, q, u; r, v and ω, place and velocities of a body's frame; Vl and Va, the
velocity transformations; the inertia integrals c, j, d and m, whose number says the order in q; γ, the acceleration
bias of constraint equations.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wt_gym.base.errors import WtGymError
from wt_gym.base.quantities import Array, Integers
from wt_gym.multibody.tree import tree_kernels
from wt_gym.structure.flexible_body import FlexibleBody


class Tree(NamedTuple):
    """Bodies, joints and constraint equations: what does not change in time."""

    parent: Integers  # (n_b,) body that carries the joint; −1: the ground
    dof_parent: Integers  # (n_u,) velocity before on the way from the ground; −1: none
    kind: Integers  # (n_b,) of the joint, FIXED … SERVO
    axis: Array  # (n_b, 3) of revolute, prismatic and servo joints, joint frame
    joint_rotation: Array  # (n_m, 3, 3) frame to marker
    joint_offset: Array  # (n_m, 3) origin of the frame from the marker, marker axes [m]
    marker_position: Array  # (n_m, 3) of the undeformed marker, axes of the carrying body [m]
    marker_linear: Array  # (n_m, 3, n_f) displacement S of the marker [m per coordinate]
    marker_second: Array  # (n_m, 3, n_f, n_f) second-order displacement H
    marker_rotation: Array  # (n_m, 3, n_f) rotation vector of the marker [rad per coordinate]
    n_elastic: Integers  # (n_b,) elastic coordinates
    joint_q: Integers  # (n_b,) first position of the joint
    joint_u: Integers  # (n_b,) first velocity of the joint
    elastic_q: Integers  # (n_b,) first elastic position
    elastic_u: Integers  # (n_b,) first elastic velocity
    servo: Integers  # (n_b,) servo of the joint, where it has one
    mass: Array  # (n_b,) [kg]
    c0: Array  # (n_b, 3) ∫ r dm at rest [kg m]
    c1: Array  # (n_b, 3, n_f) its change with q: C at rest
    c2: Array  # (n_b, 3, n_f, n_f) and that of C
    j0: Array  # (n_b, 3, 3) inertia tensor J at rest, with what rotors geared to joints add [kg m²]
    j1: Array  # (n_b, n_f, 3, 3) its change with q
    j2: Array  # (n_b, n_f, n_f, 3, 3)
    d0: Array  # (n_b, n_f, 3) ∫ r × ∂r/∂q dm: D at rest
    d1: Array  # (n_b, n_f, n_f, 3) its change with q
    d2: Array  # (n_b, n_full, n_full, n_full, 3)
    m0: Array  # (n_b, n_f, n_f) elastic mass matrix M at rest
    m1: Array  # (n_b, n_f, n_f, n_f) its change with q
    m2: Array  # (n_b, n_full, n_full, n_full, n_full)
    n_complete: Integers  # (n_b,) elastic coordinates with d2 and m2
    stiffness: Array  # (n_b, n_f, n_f) of the elastic coordinates
    damping: Array  # (n_b, n_f, n_f)
    cols: Integers  # (n_b, n_u) velocities that move the frame of a body: columns of Vl and Va, in this order
    n_col: Integers  # (n_b,) how many these are
    dof_stiffness: Array  # (n_u,) springs of joints [N m/rad, N/m]
    dof_damping: Array  # (n_u,) [N m s/rad, N s/m]
    dof_inertia: Array  # (n_u,) of the coordinate itself, by rotors geared to joints [kg m²]
    dof_q: Integers  # (n_u,) position whose rate a velocity is; −1: it turns a quaternion
    servo_frequency: Array  # (n_servo,) ω [rad/s]
    servo_damping: Array  # (n_servo,) ζ
    gravity: Array  # (3,) [m/s²]
    n_q: int
    n_u: int
    n_servo: int
    load_parent: Integers  # (n_b,) body that carries the loads of a body: the parent, or what a weld ties it to
    constraint_kind: Integers  # (n_con,) WELD, HINGE or BALL
    constraint_body: Integers  # (n_con, 2) first and second body; −1: the ground
    constraint_axis: Array  # (n_con, 3) of a hinge or servo, first frame
    constraint_turn: Array  # (n_con, 3, 3) axes about which the second frame must not turn, first frame; rows
    constraint_servo: Integers  # (n_con,) servo that turns the first frame; −1: none
    stabilization: float  # Baumgarte's α [1/s]
    projection: int  # 1: the state is put back onto the constraint equations after every step
    added_body: int  # body with which water moves, on a Cardan joint to the ground; −1: none
    added_mass: Array  # (6, 6) of that water at the origin of the body, global axes [kg, kg m, kg m²]


class Work(NamedTuple):
    """Scratch of the kernels for one user, and what they leave: kinematics, mass matrix, multipliers.

    Of the frame that a marker carries (a joint's, or an end of a constraint) the vectors are in the axes of the body p
    that carries it, until `joint_motion` has gone through the joint.
    """

    rot: Array  # (n_b, 3, 3) body axes to global ones
    r: Array  # (n_b, 3) origin of the body's frame, global [m]
    v: Array  # (n_b, 3) its velocity, body axes [m/s]
    omega: Array  # (n_b, 3) angular velocity ω, body axes [rad/s]
    vl: Array  # (n_b, 3, n_u) Vl, velocity of the origin per velocity of `Tree.cols`, body axes
    va: Array  # (n_b, 3, n_u) Va, angular velocity likewise
    bias_lin: Array  # (n_b, 3) gl, acceleration of the origin without u̇, body axes [m/s²]
    bias_ang: Array  # (n_b, 3) ga, angular acceleration without u̇ [rad/s²]
    joint_vl: Array  # (3, n_u) as vl, of the frame that the marker carries
    joint_va: Array  # (3, n_u) as va
    joint_bias_lin: Array  # (3,) as bias_lin
    joint_bias_ang: Array  # (3,) as bias_ang
    joint_v: Array  # (3,) as v
    joint_omega: Array  # (3,) angular velocity of the frame; before, of the marker relative to p [rad/s]
    marker_bias: Array  # (3,) angular acceleration of the marker relative to p for constant rates [rad/s²]
    place: Array  # (3,) position of marker or frame in p [m]; a vector in use
    place_rate: Array  # (3,) its velocity [m/s]; a vector in use
    place_bias: Array  # (3,) its acceleration for constant rates [m/s²]
    turn: Array  # (3,) rotation vector of the marker or joint [rad]; a vector in use
    turn_rate: Array  # (3,) its rate [rad/s]; a vector in use
    lever: Array  # (3,) from the marker to the frame, axes of p [m]
    turn_rot: Array  # (3, 3) rotation by ``turn``, or by a quaternion
    tangent: Array  # (3, 3) T of this rotation, ω = T ṫ
    joint_rot: Array  # (3, 3) frame that the marker carries to axes of p
    child_rot: Array  # (3, 3) body behind the joint to axes of p
    marker_shape: Array  # (3, n_f) S + H q of the marker
    first_moment: Array  # (n_b, 3) mc, mass times center of mass, body axes [kg m]
    inertia: Array  # (n_b, 3, 3) J about the origin, body axes [kg m²]
    inertia_rate: Array  # (3, 3) J̇ of one body [kg m²/s]
    coupling_lin: Array  # (n_b, 3, n_f) C, of forces and elastic accelerations [kg]
    coupling_ang: Array  # (n_b, 3, n_f) D, of moments and elastic accelerations [kg m]
    coupling_slope: Array  # (n_f, n_f, 3) ∂D_k/∂q_j of one body
    elastic_lin: Array  # (3,) C q̇ of one body [kg m/s]
    elastic_ang: Array  # (3,) D q̇ of one body [kg m²/s]
    elastic_mass: Array  # (n_b, n_f, n_f) M of the elastic coordinates
    reach: Array  # (n_full, n_full, n_full) ∫ (H q)_k · H_lj dm of one body
    bias_force: Array  # (n_b, 6 + n_f) inertial forces, moments and elastic forces that go with velocities
    acceleration: Array  # (3,) of the origin of a body without gravity, body axes [m/s²]
    angular_acceleration: Array  # (3,) [rad/s²]
    one: Array  # (3,) a vector in use
    two: Array  # (3,) a vector in use
    mass: Array  # (n_u, n_u) mass matrix M of the system, lower triangle; then its factor
    force: Array  # (n_u,) right-hand side f of M u̇ = f; then u̇
    loads: Array  # (n_b, 6 + n_f) on the bodies now: force, moment, elastic forces, body axes
    servo_acceleration: Array  # (n_servo,) [rad/s²]
    predictor: Array  # (n_state,) of the Hamming scheme
    corrector: Array  # (n_state,)
    rate: Array  # (n_state,)
    frame_r: Array  # (2, 3) origins of the two frames of a constraint, global [m]
    frame_v: Array  # (2, 3) their velocities [m/s]
    frame_w: Array  # (2, 3) their angular velocities [rad/s]
    frame_bl: Array  # (2, 3) their accelerations without u̇ [m/s²]
    frame_ba: Array  # (2, 3) their angular accelerations without u̇ [rad/s²]
    frame_rot: Array  # (2, 3, 3) frame to global axes
    frame_jl: Array  # (2, 3, n_u) Jacobians of their velocities
    frame_ja: Array  # (2, 3, n_u) Jacobians of their angular velocities
    jacobian: Array  # (n_c, n_u) B
    half_jacobian: Array  # (n_c, n_u) rows L⁻¹ Bᵀ
    gamma: Array  # (n_c,) γ, φ̈ without B u̇
    residual: Array  # (n_c,) φ [m, rad]
    residual_rate: Array  # (n_c,) φ̇ [m/s, rad/s]
    multipliers: Array  # (n_c,) λ, forces and moments on the second bodies [N, N m]
    weight: Array  # (n_c,) of the rows in the augmented mass matrix [kg, kg m²]
    schur: Array  # (n_c, n_c) factor of Xᵀ X with X = L⁻¹ Bᵀ
    drift: Array  # (3,) largest | |q| − 1 | of quaternions, |φ| and |φ̇| since they were last set to zero
    trail: Array  # (n_trail, n_state) states after the steps of a call
    trail_rate: Array  # (n_trail, n_state) their rates


class Inputs(NamedTuple):
    """What acts on a system, at the start [0] and the end [1] of an interval; linear in between except for servos."""

    body_loads: Array  # (2, n_b, 6 + n_f) force [N] and moment [N m] at the origin, body axes; on elastic coordinates
    dof_force: Array  # (2, n_u) on the velocities [N, N m]
    reference: Array  # (2, n_u) of the springs of joints [rad, m]
    reference_rate: Array  # (2, n_u) of their dampers [rad/s, m/s]
    servo_command: Array  # (2, n_servo) [rad]
    servo_rate: Array  # (2, n_servo) [rad/s], of servos that are prescribed
    servo_interval: Array  # (2, n_servo) time over which they are prescribed [s]; 0: the servo follows its command


class Points(NamedTuple):
    """Material points of a body."""

    position: Array  # (n, 3) undeformed, body axes [m]
    linear: Array  # (n, 3, n_f) displacement S [m per coordinate]
    second: Array  # (n, 3, n_f, n_f) second-order displacement H


class History(NamedTuple):
    """What an integration continues from, of one type for all schemes; n_v counts velocities and servos.

    The Hamming scheme keeps four points and no matrix, implicit schemes one point.
    """

    y: Array  # (n_points, n_state) states, newest last
    f: Array  # (n_points, n_state) their rates
    memory: Array
    # (n_state,) error estimate of the Hamming scheme; (n_v,) pseudo-accelerations of implicit ones, of the origins of
    # constrained free bodies in body axes
    counters: Integers  # (1,) how many older points count; (3,) counters of the implicit schemes
    matrix: Array  # (n_v, n_v) factors of Newton's matrix
    pivot: Integers  # (n_v,) its row exchanges


class Drift(NamedTuple):
    """What steps have drifted by before they were put back."""

    norm: float  # of quaternions, | |q| − 1 |
    position: float  # of constraint equations, |φ| [m, rad]
    velocity: float  # |φ̇| [m/s, rad/s]


def new_history(n: int) -> History:
    """Empty history of the Hamming scheme for a state of length n."""
    points, count = np.zeros((4, n)), np.zeros(1, dtype=np.int64)
    return History(points, points.copy(), np.zeros(n), count, np.zeros((0, 0)), np.zeros(0, dtype=np.int64))


class MultibodyError(WtGymError, ValueError):
    """A system of bodies and joints that cannot be built or integrated."""


FAILURES = {
    tree_kernels.SINGULAR_MASS: "the mass matrix is not positive definite: a coordinate moves no mass",
    tree_kernels.SINGULAR_CONSTRAINTS: "the constraint equations depend on each other: a motion is locked twice",
    tree_kernels.DIVERGED: "the integration diverged; the step may exceed the stability limit",
    tree_kernels.NOT_CONVERGED: "Newton's iteration did not converge; the step may be too long for the motion",
}
"""Messages for the codes that the compiled kernels return."""


def failure_of_a_step(code: int, step: float) -> str:
    """Message for a code that a compiled integrator returned during a step [s], for everything that takes steps.

    The mass matrix was sound at the start: when it is singular in a step, a diverging state has spoiled it before its
    numbers overflowed.
    """
    if code in (tree_kernels.DIVERGED, tree_kernels.SINGULAR_MASS):
        return f"{FAILURES[tree_kernels.DIVERGED]} (step {step:.6g} s)"
    return FAILURES[code]


_EXACT = 1e-9
"""Largest deviation of an axis from unit length and of a rotation matrix from orthogonality."""


def check_vector(owner: str, name: str, value: ArrayLike, unit: bool = False) -> None:
    """A finite vector (3,), of unit length on request.

    Raises
    ------
    MultibodyError
    """
    vector = numbers(owner, name, value)
    if vector.shape != (3,) or not np.all(np.isfinite(vector)):
        raise MultibodyError(f"{owner}: {name} must be three finite numbers, got {value!r}")
    if unit and abs(np.linalg.norm(vector) - 1.0) > _EXACT:
        raise MultibodyError(f"{owner}: {name} {tuple(vector.tolist())} is not a unit vector, its length is "
                             f"{np.linalg.norm(vector):.6g}")  # fmt: skip


def check_rotation(owner: str, name: str, value: ArrayLike | None) -> None:
    """A proper rotation matrix (3, 3), or None.

    Raises
    ------
    MultibodyError
    """
    if value is None:
        return
    matrix = numbers(owner, name, value)
    if matrix.shape != (3, 3):
        raise MultibodyError(f"{owner}: {name} must be a rotation matrix (3, 3), got shape {matrix.shape}")
    error = np.abs(matrix @ matrix.T - np.eye(3)).max()
    if not error <= _EXACT:
        raise MultibodyError(f"{owner}: {name} is not orthogonal, R Rᵀ differs from one by {error:.3g}")
    if np.linalg.det(matrix) < 0.0:
        raise MultibodyError(f"{owner}: {name} is a reflection (determinant −1); must be a proper rotation")


def check_number(owner: str, name: str, value: Any, positive: bool = False, signed: bool = False) -> None:
    """A finite number that is not negative, or not zero either, or of any sign where it is ``signed``.

    Raises
    ------
    MultibodyError
    """
    number = numbers(owner, name, value)
    low = not signed and (number < 0.0 if number.shape == () else True)
    if number.shape != () or not np.isfinite(number) or low or (positive and number == 0.0):
        bound = "" if signed else " > 0" if positive else " >= 0"
        raise MultibodyError(f"{owner}: {name} must be a finite number{bound}, got {value!r}")


def numbers(owner: str, name: str, value: Any) -> Array:
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise MultibodyError(f"{owner}: {name} must be numbers, got {value!r}") from None


def check_body(body: FlexibleBody) -> None:
    """A body whose kinetic energy is not negative for any rigid or elastic motion.

    A body may be massless; whether a coordinate moves no mass at all shows only in the assembled system.

    Raises
    ------
    MultibodyError
    """
    inertia, owner = body.inertia, f"body {body.name!r}"
    check_number(owner, "mass", inertia.mass)
    c = inertia.c0
    lever = np.array([[0.0, -c[2], c[1]], [c[2], 0.0, -c[0]], [-c[1], c[0], 0.0]])
    rigid = np.block([[inertia.mass * np.eye(3), -lever], [lever, inertia.j0]])
    for name, matrix in (("inertia", rigid), ("elastic mass matrix", inertia.m0), ("stiffness", body.stiffness),
                         ("damping", body.damping)):  # fmt: skip
        if not np.all(np.isfinite(matrix)):
            raise MultibodyError(f"{owner}: its {name} is not finite")
        size = np.abs(matrix).max(initial=0.0)
        if np.abs(matrix - matrix.T).max(initial=0.0) > 1e-6 * size:
            raise MultibodyError(f"{owner}: its {name} is not symmetric")
        if name in ("stiffness", "damping") or size == 0.0:
            continue
        # unit diagonal, so that units do not matter; what moves no mass has a zero row
        diagonal = np.diag(matrix)
        scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, size))
        lowest = np.linalg.eigvalsh(matrix * np.outer(scale, scale))[0]
        if diagonal.min() < 0.0 or lowest < -1e-7:
            raise MultibodyError(
                f"{owner}: its {name} is negative for a motion; about the body frame's origin its diagonal is "
                f"{np.array2string(diagonal, precision=4)}"
            )


def check_unique(what: str, names: Sequence[str]) -> None:
    """Names that occur once each.

    Raises
    ------
    MultibodyError
    """
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise MultibodyError(f"{what} names occur twice: {', '.join(twice)}; name bodies and joints differently")
