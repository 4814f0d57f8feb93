"""Modes of the blades as they turn, bent and loaded, recomputed as the simulation continues.

The clamped modes at rest, in which a blade usually moves, are those of a blade without load. About a state of steady
deformation u (nodal displacements) at the angular velocity ω, under forces F of the air, the second-order theory of
`wt_gym.structure.flexible_body`, r = x₀ + S u + ½ uᵀ H u, has the tangent

    K_t = K + Σ m (Ŝᵀ ω̃ω̃ Ŝ + (ω̃ω̃ r)·H) − Σ F·H,    M_t = Σ m Ŝᵀ Ŝ,    Ŝ = S + H u,

from the elastic energy, the centrifugal potential −½ Σ m |ω × r|² and the work of the forces; at u = 0 without forces
it is that of `wt_gym.structure.modes.clamped_modes` with spin. Its lowest modes of each kind are the new basis Φ'. The
blades share one basis, as they share their mesh: u, ω and F are means over the blades, in which the weight, that turns
round once a revolution, cancels except for its small part along the shaft. That part is left out.

Coordinates, rates and the points of the multistep scheme pass over by the closest motion, q' = Φ'ᵀ M_t Φ q: what of the
motion lies outside the new basis, second-order small in the change of the modes in a step, is lost.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from wt_gym.base.errors import SimulationError
from wt_gym.base.quantities import Array
from wt_gym.multibody.arrays import History, Points, Work
from wt_gym.simulation.models import TurbineModels
from wt_gym.simulation.turbine_structure import bending_dofs, body_points
from wt_gym.structure.beam import Beam, skew
from wt_gym.structure.flexible_body import FlexibleBody, particle_fields
from wt_gym.structure.modes import Modes, lowest_modes, named_modes, select_modes

LOOK = 16
"""Modes among which the required ones are sought."""


class TangentBlade:
    """Tangent matrices and modes of one clamped blade about a deformed state.

    Parameters
    ----------
    points : array (n, 3)
        Where the air acts, body frame [m].
    center : array (3,)
        A point of the rotor's axis, body frame [m].
    """

    def __init__(self, beam: Beam, points: Array, center: ArrayLike) -> None:
        every = np.eye(beam.n_dof)
        self.beam, self.center = beam, np.asarray(center, dtype=float)
        self._fields = particle_fields(beam, every)
        self._points = body_points(beam, every, points)

    def matrices(self, u: Array, omega: Array, forces: Array | None = None) -> tuple[Array, Array]:
        """K_t and M_t (n_dof, n_dof).

        Parameters
        ----------
        u : array (n_dof,)
            Nodal displacements [m, rad].
        omega : array (3,)
            Body frame [rad/s].
        forces : array (n, 3), optional
            On the points, body frame [N].
        """
        fields, mass = self._fields, self.beam.particle_mass
        bent = fields.linear + fields.second_along(u)
        place = fields.position + 0.5 * (fields.linear + bent) @ u - self.center
        turn = skew(omega) @ skew(omega)
        flat = bent.reshape(-1, self.beam.n_dof)
        weighted = (mass[:, None, None] * bent).reshape(flat.shape)
        spinning = (mass[:, None, None] * np.einsum("ij,pjk->pik", turn, bent)).reshape(flat.shape)
        stiffness = self.beam.stiffness + flat.T @ spinning
        stiffness += fields.contract_second(mass[:, None] * (place @ turn.T))
        if forces is not None:
            stiffness -= np.einsum("pi,pijk->jk", forces, self._points.second)
        return stiffness, weighted.T @ flat

    def modes(
        self, u: Array, omega: Array, forces: Array | None = None, node_dofs: Sequence[int] = (0, 1, 2, 3, 4)
    ) -> tuple[Modes, Array]:
        """Lowest `Modes` of K_t φ = (2 π f)² M_t φ, of nodes that move in the given directions, and M_t."""
        stiffness, mass = self.matrices(u, omega, forces)
        free = np.array([6 * node + k for node in range(1, self.beam.n_dof // 6) for k in node_dofs])
        block = np.ix_(free, free)
        value, vector = lowest_modes(stiffness[block], mass[block], min(LOOK, len(free)))
        shape = np.zeros((self.beam.n_dof, len(value)))
        shape[free] = vector
        return named_modes(self.beam, value, shape), mass

    def in_basis(self, basis: Array) -> tuple[Array, Array, Array]:
        """The points (`Points`) in a basis (n_dof, n)."""
        p = self._points
        linear = p.linear @ basis
        second = np.einsum("pijk,ja,kb->piab", p.second, basis, basis, optimize=True)
        return p.position, linear, second


class DeformedBasis:
    """The basis of the blades of a coupled turbine, brought up to date before each aerodynamic step.

    Attributes
    ----------
    basis : array (n_dof, n)
        Nodal displacements of the current modes; part of the state of the simulation.
    frequency : array (n,)
        Of the current modes of the blade clamped to the turning hub [Hz].
    """

    def __init__(self, models: TurbineModels) -> None:
        self._models, structure = models, models.structure
        self._beam, self._rest = structure.blade_field
        self.basis = self._rest.copy()
        center = (0.0, 0.0, -models.turbine.hub.radius)
        lattice = Points(*(shapes[0] for shapes in structure.lattice_points))  # of the only body of a blade, views
        self.tangent = TangentBlade(self._beam, lattice.position, center)
        tip = TangentBlade(self._beam, structure.tip_points.position, center)
        self._carried = ((self.tangent, lattice), (tip, structure.tip_points))
        self.frequency = np.zeros(self.basis.shape[1])
        each = np.arange(self.basis.shape[1])
        system = structure.system
        self._q = np.add.outer([system.index(b, "elastic_q") for b in structure.blades], each)
        self._u = np.add.outer([system.index(b, "elastic_u") for b in structure.blades], each) + system.n_q

    def restart(self) -> None:
        """Go back to the modes at rest."""
        if not np.array_equal(self.basis, self._rest):
            self.basis[:] = self._rest
            self.install()

    def install(self) -> None:
        """Bodies and points of the blades in the current basis."""
        models, structure, tree = self._models, self._models.structure, self._models.structure.system.tree
        blade, twists = models.turbine.blade, models.fidelity.blade_modes[2] > 0
        body = FlexibleBody.from_beam("blade", self._beam, self.basis, blade.damping_ratio, complete=twists)
        n = self.basis.shape[1]
        for b in structure.blades:
            for key in ("c1", "c2", "j1", "j2", "d0", "d1", "d2", "m0", "m1", "m2"):
                value = getattr(body.inertia, key)
                getattr(tree, key)[(b, *(slice(0, k) for k in value.shape))] = value
            for key in ("stiffness", "damping"):
                getattr(tree, key)[b, :n, :n] = getattr(body, key)
        for tangent, points in self._carried:
            _, points.linear[:], points.second[:] = tangent.in_basis(self.basis)

    def _mean(self, y: Array, work: Work, forces: Array) -> tuple[Array, Array, Array]:
        """Nodal displacements, angular velocity and forces of the air, means over the blades in their own axes."""
        blades = self._models.structure.blades
        u = self.basis @ y[self._q].mean(axis=0)
        omega = np.mean([work.omega[b] for b in blades], axis=0)
        return u, omega, np.mean([f @ work.rot[b] for f, b in zip(forces, blades, strict=True)], axis=0)

    def update(self, history: History, loads: Sequence[Array], work: Work, forces: Array) -> None:
        """New modes about the current state, which passes over to them.

        Parameters
        ----------
        history : History
            Of states alone (`IntegratorEntry.keeps_states`), changed in place; the kinematics in ``work`` belong to the
            newest.
        loads : sequence of array (..., n_b, 6 + n_f)
            Generalized loads of the bodies; those of the blades pass over too.
        forces : array (n_blades, n, 3)
            Of the air on the lattice points, global [N].

        Raises
        ------
        SimulationError
            When the blade is deformed so far that it lacks a required mode.
        """
        blades, counts = self._models.structure.blades, self._models.fidelity.blade_modes
        try:
            modes, mass = self.tangent.modes(*self._mean(history.y[-1], work, forces), bending_dofs(counts))
            chosen = select_modes(modes, flap=counts[0], edge=counts[1], torsion=counts[2])
        except ValueError as error:
            raise SimulationError(f"no modes of the deformed blade: {error}") from error
        new = modes.shape[:, chosen]
        passage = new.T @ mass @ self.basis
        for array in (history.y, history.f, history.memory[None]):
            for index in (self._q, self._u):
                array[:, index] = array[:, index] @ passage.T
        back = np.linalg.inv(passage)
        n = len(chosen)
        for array in loads:
            for b in blades:
                array[..., b, 6 : 6 + n] = array[..., b, 6 : 6 + n] @ back
        self.basis[:], self.frequency[:] = new, modes.frequency[chosen]
        self.install()
