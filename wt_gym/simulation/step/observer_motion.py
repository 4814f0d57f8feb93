"""The turbine in motion in local observer frames (Holm-Jørgensen, Nielsen & Rubak).

Bodies, joints and drives are those of the turbine's multibody system, with second-order displacements and the geometric
stiffness that comes with them, or, as published, without (`Fidelity.frame_displacement`). The observer frames are
integrated by Newmark's or the generalized-α scheme; the multibody system is the language in which the rest of the
simulation reads the motion: its coordinates are angles of hinges and elastic coordinates, which frames that are clamped
to their bodies share.

Loads of the air are known as forces f at points x₀ + S q + ½ qᵀ H q of the blades, given in the deformed state. Their
virtual work on these points is eq. (4) with the lever of the deformed axis in every section: Q = (S + H q)ᵀ f on the
elastic coordinates, force and moment about the frame of the body (docs/formulations.md).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import expm

from wt_gym.base.errors import SimulationError
from wt_gym.multibody.errors import failure_of_a_step
from wt_gym.multibody.integrators.schemes import INTEGRATORS
from wt_gym.multibody.observer_frame import observer_frame_kernels
from wt_gym.multibody.observer_frame.frame import ObserverFrameError
from wt_gym.multibody.observer_frame.observer_frame_constraint_kernels import TORQUE
from wt_gym.multibody.observer_frame.observer_frame_from_system import FRAME, Translation
from wt_gym.multibody.tree import rotation_kernels, tree_kernels
from wt_gym.simulation.step import observer_motion_kernels
from wt_gym.simulation.step.structure_motion import Observed, StateArrays, Structure, TreeMotion

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.multibody.observer_frame import observer_frame_arrays as frame
    from wt_gym.simulation.model.assembly import TurbineModels
    from wt_gym.simulation.step.coupling_data import Scheme

__all__ = ["ObserverMotion"]

ITERATIONS = 1
"""Solutions of a structural step. A second one, with directions of constraints and loads renewed, changes nothing."""


class ObserverMotion(TreeMotion):
    """A turbine whose observer frames move; see `wt_gym.simulation.step.structure_motion.StructureMotion`.

    Parameters
    ----------
    models : TurbineModels
        With the formulation "observer".

    Attributes
    ----------
    translation : Translation
        Of the multibody system into observer frames.

    Raises
    ------
    SimulationError
        For a turbine that has no form in observer frames.
    """

    def __init__(self, models: TurbineModels) -> None:
        super().__init__(models)
        structure, fidelity = models.structure, models.fidelity
        try:
            self.translation = Translation(
                structure.system, structure.beams, structure.system.initial_state(),
                reference=fidelity.reference_condition, displacement=fidelity.frame_displacement,
            )  # fmt: skip
            model, state, work = self.translation.observed.pack()
        except ObserverFrameError as error:
            raise SimulationError(f"the turbine has no form in local observer frames: {error}") from error
        model.rule[:] = INTEGRATORS[fidelity.integrator].rule(fidelity.scheme_settings)
        markers = self.translation.observed._markers
        for i in range(len(model.n)):
            model.load_section[i] = markers.index((i, FRAME))
        state, now = _flat(state)
        update = fidelity.frame_update
        self.observed = Observed(
            model=model, state=state, work=work, now=now, saved=StateArrays(*(np.zeros_like(a) for a in now)),
            tree_state=np.zeros(structure.system.n_state), bodies=np.array(self.translation.tree_bodies),
            drives=np.array(self.translation.servos, dtype=np.int64), hinges=self._hinges(model),
            servo=self._servo_steps(), loads=np.zeros((0, 6)), n_iterations=ITERATIONS,
            threshold=0.0 if update == "step" else float(update),
        )  # fmt: skip
        self.structure: Structure = self.structure._replace(observed=self.observed)

    def _hinges(self, model: frame.Model) -> NDArray[np.int64]:
        """Rows of the constraint equations, springs, and their places in the state (n_hinges, 4)."""
        system = self.models.structure.system
        rows = {model.row_spring[r]: r for r in range(len(model.row_kind)) if model.row_kind[r] == TORQUE}
        hinges = [
            (rows[spring], spring, system.index(b, "joint_q"), system.index(b, "joint_u"))
            for spring, b in self.translation.hinges
        ]
        return np.array(hinges, dtype=np.int64).reshape(-1, 4)

    def _servo_steps(self) -> NDArray[np.float64]:
        """What the error and the rate of each servo become within a structural step (n_servo, 2, 2)."""
        tree, h = self.structure.motion.tree, self.integrator.step
        steps = [
            expm(h * np.array([[0.0, 1.0], [-(w**2), -2.0 * d * w]]))
            for w, d in zip(tree.servo_frequency, tree.servo_damping, strict=True)
        ]
        return np.array(steps).reshape(-1, 2, 2)

    def begin(self, y: NDArray[np.float64], scheme: Scheme) -> None:
        """Frames and coordinates for a state (n_state,) of the multibody system, in consistent motion.

        Raises
        ------
        SimulationError
            When there is none.
        """
        system, work, s = self.models.structure.system, self.integrator.work, self.observed.state
        history = self.integrator.history
        for array in (history.y, history.f, history.memory, history.counters):
            array[:] = 0
        self.integrator.state[:] = y
        tree_kernels.kinematics(y, system.tree, work)
        for array in self.observed.now:
            array[:] = 0
        tangent, turn = np.zeros((3, 3)), np.zeros((3, 3))
        for i, b in enumerate(self.translation.tree_bodies):
            q, rate = self.models.structure.elastic(b, y)
            n, part = len(q), self.translation.rigid_parts[i]
            rotation_kernels.rotation_exp(part[3:] @ q, turn, tangent)
            s.rotation[i] = work.rot[b] @ turn.T
            s.position[i] = work.r[b]
            s.velocity[i] = work.rot[b] @ work.v[b]
            s.omega[i] = turn @ work.omega[b] - tangent @ part[3:] @ rate
            s.q[i, :n], s.v[i, :n], s.deformed[i, :n] = q, rate, q
        for spring, b in self.translation.hinges:
            s.angle[spring] = y[system.index(b, "joint_q")]
        code = observer_motion_kernels.begin_frames(self.structure.motion, self.observed, scheme)
        if code != tree_kernels.OK:
            raise SimulationError(failure_of_a_step(code, scheme.h))

    def resume(self) -> None:
        """Bring up to date what follows from restored arrays."""
        observer_frame_kernels.refresh(self.observed.model, self.observed.state, self.observed.work)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Every array that carries state, by name."""
        now = self.observed.now
        return super().arrays() | {"observer_numbers": now.numbers, "frame_updates": now.counts}


def _flat(state: frame.State) -> tuple[frame.State, StateArrays]:
    """The same state with all arrays of numbers as views of one array, and both as `StateArrays`."""
    arrays = {key: a for key, a in state._asdict().items() if key != "n_updates"}
    numbers = np.concatenate([a.ravel() for a in arrays.values()])
    views, start = {}, 0
    for key, a in arrays.items():
        views[key] = numbers[start : start + a.size].reshape(a.shape)
        start += a.size
    return type(state)(**views, n_updates=state.n_updates), StateArrays(numbers, state.n_updates)
