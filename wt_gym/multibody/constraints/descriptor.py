"""The differential–algebraic equations in quaternion coordinates, exactly as printed by Gebhardt et al. 2012.

The compiled kernels solve for the accelerations of (v, ω); the paper writes the blades' primary motions with three
positions and four quaternion components and one norm condition each. Both are the same equations: with ω = 2 G(p) ṗ and
Ġ ṗ = 0 the velocities transform as u = L ẋ and u̇ = L ẍ, and eq. (7) becomes

    [LᵀM L  B̄ᵀ] [ẍ]   [Lᵀ f]
    [B̄      0 ] [λ] = [c    ],     B̄ = [B L; 2 pᵀ],

with c = −γ − 2 α φ̇ − α² φ (Baumgarte) for the six equations of a blade root, and the same for p·p − 1 = 0. This module
assembles eqs. (7)–(11) densely, for inspection and as the reference of the fast solution.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from wt_gym.base.quantities import Array
from wt_gym.multibody.arrays import Inputs, MultibodyError
from wt_gym.multibody.system import MultibodySystem
from wt_gym.multibody.tree import tree_kernels


@dataclass(frozen=True)
class DescriptorForm:
    """Eq. (7) for one state.

    Attributes
    ----------
    mass : array (n_x, n_x)
        Eq. (8); singular along the quaternions themselves.
    jacobian : array (n_c, n_x)
        Eq. (9), with one norm row for each quaternion at the end.
    force : array (n_x,)
    right_hand_side : array (n_c,)
    to_velocities : array (n_u, n_x)
        L: u = L ẋ.
    """

    mass: Array
    jacobian: Array
    force: Array
    right_hand_side: Array
    to_velocities: Array

    def solve(self) -> tuple[Array, Array]:
        """Accelerations ẍ (n_x,) and multipliers λ (n_c,) of eq. (7).

        Raises
        ------
        MultibodyError
            When the constraints depend on each other or leave a massless motion free.
        """
        n = len(self.force)
        matrix = np.block([[self.mass, self.jacobian.T], [self.jacobian, np.zeros((len(self.jacobian),) * 2)]])
        try:
            solution = np.linalg.solve(matrix, np.concatenate([self.force, self.right_hand_side]))
        except np.linalg.LinAlgError as error:
            raise MultibodyError(f"eq. (7) has no unique solution: {error}") from error
        return solution[:n], solution[n:]


def descriptor_form(system: MultibodySystem, y: ArrayLike, inputs: Inputs | None = None) -> DescriptorForm:
    """Assemble eqs. (7)–(11) for a state.

    Parameters
    ----------
    y : array (n_state,)
    inputs : Inputs, optional
        Loads and references; those at the start of the interval are used.

    Returns
    -------
    DescriptorForm
        x has the order of the positions ``system.coordinate_names``.

    Raises
    ------
    MultibodyError
        For a state without meaning, such as a quaternion that is not a unit quaternion.
    """
    inputs, work = inputs or system.new_inputs(), system.new_work()
    y = np.ascontiguousarray(y, dtype=float)
    system.rates(y, inputs, work)  # servo accelerations, constraint rows and residuals
    tree, n_q, n_u = system.tree, system.n_q, system.n_u
    tree_kernels.assemble(y, inputs.body_loads[0], tree, work)
    mass = np.tril(work.mass) + np.tril(work.mass, -1).T
    force = work.force + inputs.dof_force[0]
    position = np.where(tree.dof_q >= 0, y[tree.dof_q], 0.0)
    force += tree.dof_stiffness * (inputs.reference[0] - position)
    force += tree.dof_damping * (inputs.reference_rate[0] - y[n_q : n_q + n_u])
    transform, norms = _velocity_transform(system, y)
    alpha = system.stabilization
    rows = -work.gamma - 2.0 * alpha * work.residual_rate - alpha**2 * work.residual
    norm_rows, norm_right = [], []
    rates = np.linalg.pinv(transform) @ y[n_q : n_q + n_u]
    for q in norms:
        p, rate = y[q : q + 4], rates[q : q + 4]
        row = np.zeros(n_q)
        row[q : q + 4] = 2.0 * p
        norm_rows.append(row)
        norm_right.append(-2.0 * rate @ rate - 2.0 * alpha * 2.0 * p @ rate - alpha**2 * (p @ p - 1.0))
    return DescriptorForm(
        mass=transform.T @ mass @ transform,
        jacobian=np.vstack([work.jacobian @ transform, *norm_rows]),
        force=transform.T @ force,
        right_hand_side=np.concatenate([rows, norm_right]),
        to_velocities=transform,
    )


def _velocity_transform(system: MultibodySystem, y: Array) -> tuple[Array, list[int]]:
    """L (n_u, n_q) with u = L ẋ, and the first indices of all quaternions."""
    transform, norms = np.zeros((system.n_u, system.n_q)), []
    for i, q in enumerate(system.tree.dof_q):
        if q >= 0:
            transform[i, q] = 1.0
    for body, joint in enumerate(system.joints):
        if joint.kind not in ("spherical", "free"):
            continue
        shift = 3 if joint.kind == "free" else 0
        q, u = system.index(body, "joint_q") + shift, system.index(body, "joint_u") + shift
        p0, p1, p2, p3 = y[q : q + 4]
        gradient = np.array([[-p1, p0, p3, -p2], [-p2, -p3, p0, p1], [-p3, p2, -p1, p0]])
        transform[u : u + 3, q : q + 4] = 2.0 * gradient
        norms.append(q)
    return transform, norms
