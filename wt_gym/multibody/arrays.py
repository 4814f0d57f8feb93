"""The arrays of a multibody system: named tuples, which compiled kernels take as they are.

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

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    Array = NDArray[np.float64]
    Integers = NDArray[np.int64]

__all__ = ["Inputs", "Points", "System", "Tree", "Work"]


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


class Named(Protocol):
    """What has a name."""

    @property
    def name(self) -> str:
        """Of a constraint."""
        ...


class System(Protocol):
    """What integrators and checks need of a `wt_gym.multibody.system.MultibodySystem`."""

    tree: Any  # Tree, once it is built
    n_q: int
    n_u: int
    n_servo: int
    stabilization: float
    quaternions: list[tuple[int, str]]

    @property
    def constraints(self) -> Sequence[Named]:
        """Constraint equations between bodies."""
        ...

    @property
    def n_state(self) -> int:
        """Length of the state vector."""
        ...

    @property
    def state_names(self) -> list[str]:
        """Names of the entries of the state vector."""
        ...

    @property
    def constrained(self) -> int | None:
        """None without constraint equations."""
        ...

    def require_built(self) -> None:
        """Refuse the use of a system that is not built."""

    def new_work(self, trail: int = 0) -> Work:
        """Scratch arrays."""
        ...

    def new_inputs(self) -> Inputs:
        """Inputs, all zero."""
        ...

    def rates(self, y: ArrayLike, inputs: Inputs | None = None, work: Work | None = None) -> Array:
        """dy/dt (n_state,)."""
        ...

    def project(self, y: Array, inputs: Inputs | None = None, passes: int = 2) -> None:
        """Move a state onto the constraint equations."""

    def position_change(self, y: Array, u: int) -> Array:
        """Change of the positions (n_q,) per motion along a velocity."""
        ...

    def multiplier_rows(self, constraint: int) -> slice:
        """Rows of the equations of a constraint."""
        ...
