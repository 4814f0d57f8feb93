"""The arrays of a system in local observer frames: named tuples, which compiled kernels take as they are.

Sizes: n_b bodies, n coordinates of the body that has most (others are padded with zeros), six of them rigid-body
coordinates at the end of its own; n_e elastic coordinates of the body with second-order displacements that has most;
n_m markers, n_row rows of the constraint equations, n_drive drives, n_spring springs, n_load loads, n_field consistent
ones. Integers are int64.

Letters stand where the theory has them (:mod:`wt_gym.multibody.observer_frame.frame`): q the coordinates, v and a their
rates q̇ and q̈; ω and α of the frames.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Integers = NDArray[np.int64]
    Flags = NDArray[np.bool_]

__all__ = ["Model", "State", "Work"]


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
