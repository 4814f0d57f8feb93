"""The coupled turbine in local observer frames (Holm-Jørgensen, Nielsen & Rubak).

Bodies, joints and drives are those of the turbine's multibody system, with second-order displacements and the geometric
stiffness that comes with them, or, as published, without (`Fidelity.frame_displacement`). The observer frames are
integrated by Newmark's or the generalized-α scheme; the multibody system is the language in which the rest of the
simulation reads the motion: its coordinates are angles of hinges and elastic coordinates, which frames that are clamped
to their bodies share.

Loads of the air are known as forces f at points x₀ + S q + ½ qᵀ H q of the blades, given in the deformed state. Their
virtual work on these points is eq. (4) with the lever of the deformed axis in every section: Q = (S + H q)ᵀ f on the
elastic coordinates, force and moment about the frame of the body (docs/formulations.md).
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from wt_gym.errors import SimulationError
from wt_gym.multibody.errors import failure_of_a_step
from wt_gym.multibody.integrators.schemes import generalised_alpha
from wt_gym.multibody.observer_frame.frame import ObserverFrameError
from wt_gym.multibody.observer_frame.observer_frame_constraint_kernels import TORQUE
from wt_gym.multibody.observer_frame.observer_frame_from_system import FRAME, Translation
from wt_gym.multibody.tree import rotation_kernels, tree_kernels
from wt_gym.simulation.step import observer_coupling_kernels
from wt_gym.simulation.step.coupling import Coupling

__all__ = ["ObservedMotion", "ObserverCoupling"]

ITERATIONS = 1
"""Solutions of a structural step. A second one, with directions of constraints and loads renewed, changes nothing."""


class StateArrays(NamedTuple):
    """A state in observer frames, as flat arrays."""

    numbers: np.ndarray  # (n,) all of `State` but the counts
    counts: np.ndarray  # (n_b,) int64: updates of the frames


class ObservedMotion(NamedTuple):
    """The structure in observer frames, as the compiled step takes it."""

    model: tuple  # Model
    state: tuple  # State; views of ``now``
    work: tuple  # Work
    now: StateArrays
    saved: StateArrays  # room for a copy
    tree_state: np.ndarray  # (n_state,) room for a copy of the state of the multibody system
    bodies: np.ndarray  # (n_b,) bodies of the multibody system
    drives: np.ndarray  # (n_drives,) servos that they follow
    hinges: np.ndarray  # (n_hinges, 4) rows of the constraint equations, springs, and their places in the state
    servo: np.ndarray  # (n_servo, 2, 2) what a servo's error and its rate become within a structural step
    loads: np.ndarray  # (0, 6) no loads but those of the sections
    n_iterations: int
    threshold: float  # displacement beyond which frames are updated; 0: in every step [m]


class ObserverCoupling(Coupling):
    """Structure in local observer frames and air of one turbine; see `Coupling`.

    Parameters
    ----------
    models : TurbineModels
        With the formulation "observer".

    Attributes
    ----------
    translation : Translation
        Of the multibody system into observer frames.
    observed : ObservedMotion
    """

    _whole_step = staticmethod(observer_coupling_kernels.observed_step)
    _last_part = staticmethod(observer_coupling_kernels.end_observed)

    def __init__(self, models):
        super().__init__(models)
        structure, fidelity = models.structure, models.fidelity
        system = structure.system
        try:
            self.translation = Translation(
                system, structure.beams, system.initial_state(), reference=fidelity.reference_condition,
                displacement=fidelity.frame_displacement,
            )  # fmt: skip
            model, state, work = self.translation.observed.pack()
        except ObserverFrameError as error:
            raise SimulationError(f"the turbine has no form in local observer frames: {error}") from error
        if fidelity.integrator == "generalised_alpha":
            model.rule[:] = generalised_alpha(fidelity.scheme_radius)
        markers = self.translation.observed._markers
        for i in range(len(model.n)):
            model.load_section[i] = markers.index((i, FRAME))
        state, now = _flat(state)
        rows = {model.row_spring[r]: r for r in range(len(model.row_kind)) if model.row_kind[r] == TORQUE}
        hinges = [
            (rows[spring], spring, system.index(b, "joint_q"), system.index(b, "joint_u"))
            for spring, b in self.translation.hinges
        ]
        frequency, damping = system.tree.servo_frequency, system.tree.servo_damping
        servo = [
            expm(self.scheme.h * np.array([[0.0, 1.0], [-(w**2), -2.0 * d * w]]))
            for w, d in zip(frequency, damping, strict=True)
        ]
        update = fidelity.frame_update
        self.observed = ObservedMotion(
            model=model, state=state, work=work, now=now, saved=StateArrays(*(np.zeros_like(a) for a in now)),
            tree_state=np.zeros(system.n_state), bodies=np.array(self.translation.tree_bodies),
            drives=np.array(self.translation.servos, dtype=np.int64),
            hinges=np.array(hinges, dtype=np.int64).reshape(-1, 4), servo=np.array(servo).reshape(-1, 2, 2),
            loads=np.zeros((0, 6)), n_iterations=ITERATIONS, threshold=0.0 if update == "step" else float(update),
        )  # fmt: skip

    def arrays(self):
        """Every array that carries state, by name."""
        now = self.observed.now
        return super().arrays() | {"observer_numbers": now.numbers, "frame_updates": now.counts}

    def _start_structure(self, y):
        """Frames and coordinates for a state of the multibody system, in consistent motion."""
        system, work, s = self.models.structure.system, self.integrator.work, self.observed.state
        history, motion = self.integrator.history, self.bundle()[1]
        for array in (history.y, history.f, history.memory, history.counters):
            array[:] = 0
        history.y[3] = y
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
        code = observer_coupling_kernels.begin_observed(motion, self.observed, self.scheme)
        if code != tree_kernels.OK:
            raise SimulationError(failure_of_a_step(code, self.scheme.h))

    def resume(self):
        """Bring up to date what follows from restored arrays."""
        observer_coupling_kernels.refresh(self.observed.model, self.observed.state, self.observed.work)
        super().resume()

    def bundle(self):
        """Arguments of the compiled step."""
        air, motion, *others = super().bundle()
        return air, motion, self.observed, *others

    def parts_without_air(self):
        """Kernels of the step that do without the induction of the wake, with their arguments."""
        air, motion, observed, x, scheme, gauges, monitor = self.bundle()
        kernels = observer_coupling_kernels
        return (
            (kernels.predict_observed, (air, motion, observed, x, scheme)),
            (kernels.end_observed, (motion, observed, x, scheme, gauges, monitor, self.blade_forces, self._blade_wind)),
        )

    def _advance_split(self, blade_wind):
        air, motion, observed, x, scheme, gauges, monitor = self._bundles
        kernels = observer_coupling_kernels
        code = kernels.predict_observed(air, motion, observed, x, scheme)
        if code == tree_kernels.OK:
            self.models.lattice.prepare(self.aero, x.nodes)
            code = kernels.correct_observed(air, motion, observed, x, scheme, blade_wind)
        if code == tree_kernels.OK:
            self.models.lattice.accept(self.aero)
            forces = self.blade_forces
            code = kernels.end_observed(motion, observed, x, scheme, gauges, monitor, forces, blade_wind)
        return code


def _flat(state):
    """The same state with all arrays of numbers as views of one array, and both as `StateArrays`."""
    arrays = {key: a for key, a in state._asdict().items() if key != "n_updates"}
    numbers = np.concatenate([a.ravel() for a in arrays.values()])
    views, start = {}, 0
    for key, a in arrays.items():
        views[key] = numbers[start : start + a.size].reshape(a.shape)
        start += a.size
    return type(state)(**views, n_updates=state.n_updates), StateArrays(numbers, state.n_updates)
