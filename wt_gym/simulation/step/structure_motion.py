"""The structure of a turbine in motion, as the coupled step knows it whatever its form.

A form is what `StructureMotion` asks for: it starts from a state, hands a `Structure` to the compiled step, names the
arrays that carry its state, and comes back after they were restored. The compiled half of the contract is
`wt_gym.simulation.step.structure_motion_kernels`. In `TreeMotion` the turbine's multibody system moves itself, blades
on joints ("embedded") or held by constraint equations ("constrained"), in modal or nodal coordinates; in
`ObserverMotion` local observer frames move (Holm-Jørgensen, Nielsen & Rubak).

Bodies, joints and drives are those of the turbine's multibody system, with second-order displacements and the geometric
stiffness that comes with them, or, as published, without (`Fidelity.frame_displacement`). The observer frames are
integrated by Newmark's or the generalized-α scheme; the multibody system is the language in which the rest of the
simulation reads the motion: its coordinates are angles of hinges and elastic coordinates, which frames that are clamped
to their bodies share.

Loads of the air are known as forces f at points x₀ + S q + ½ qᵀ H q of the blades, given in the deformed state. Their
virtual work on these points is eq. (4) with the lever of the deformed axis in every section: Q = (S + H q)ᵀ f on the
elastic coordinates, force and moment about the frame of the body (docs/formulations.md).
"""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from wt_gym.base.compiled import compiled_for
from wt_gym.base.errors import SimulationError
from wt_gym.base.quantities import Array, Integers
from wt_gym.multibody.arrays import History, Inputs, Tree, Work, failure_of_a_step, new_history
from wt_gym.multibody.integrators.integrator_kernels import hamming_advance
from wt_gym.multibody.integrators.schemes import DEFAULT, INTEGRATORS, Integrator, Method, coupled_integrator, method_of
from wt_gym.multibody.observer_frame import observer_frame_body as frame
from wt_gym.multibody.observer_frame import observer_frame_kernels
from wt_gym.multibody.observer_frame.observer_frame_body import ObserverFrameError
from wt_gym.multibody.observer_frame.observer_frame_constraint_kernels import TORQUE
from wt_gym.multibody.observer_frame.observer_frame_from_system import FRAME, Translation
from wt_gym.multibody.tree import rotation_kernels, tree_kernels
from wt_gym.simulation.models import TurbineModels
from wt_gym.simulation.step import observer_motion_kernels
from wt_gym.simulation.step.coupling_data import Scheme

NEWTON_TOLERANCE = 2e-8
"""Change of the position increments, in blade lengths, at which the iteration of an implicit step ends, far below what
the passes of structure and loads leave."""


class Motion(NamedTuple):
    """The motion of a turbine's multibody system, and what acts on it: what all forms of a structure write and read."""

    state: np.ndarray  # (n_state,) newest state: coordinates, velocities, servos and their rates [m, rad, m/s, rad/s]
    rate: np.ndarray  # (n_state,) its rate
    inputs: Inputs  # loads and commands at the start and at the end of the aerodynamic step
    tree: Tree  # the multibody system
    work: Work  # kinematics of the newest state; states and rates of the structural steps (trail, trail_rate)


class StateArrays(NamedTuple):
    """A state in observer frames, as flat arrays."""

    numbers: np.ndarray  # (n,) all of `State` but the counts [m, rad, m/s, …]
    counts: np.ndarray  # int64 (n_b,) updates of the frames


class Observed(NamedTuple):
    """The structure in local observer frames."""

    model: frame.Model
    state: frame.State  # views of ``now``
    work: frame.Work
    now: StateArrays
    saved: StateArrays  # as it was at the start of the aerodynamic step
    tree_state: np.ndarray  # (n_state,) the same of the multibody system
    bodies: np.ndarray  # int64 (n_b,) bodies of the multibody system
    drives: np.ndarray  # int64 (n_drives,) servos that they follow
    hinges: np.ndarray  # int64 (n_hinges, 4) rows of the constraint equations, springs, and their places in the state
    servo: np.ndarray  # (n_servo, 2, 2) what a servo's error and its rate become within a structural step
    loads: np.ndarray  # (0, 6) no loads but those of the sections
    n_iterations: int  # solutions of a structural step
    threshold: float  # displacement beyond which frames are updated; 0: in every step [m]


class Structure(NamedTuple):
    """A structure, as the compiled step takes it: its motion, and what its form needs to move on."""

    motion: Motion
    history: History  # what the integration of the multibody system continues from
    saved: History  # as it was at the start of the aerodynamic step
    constrained: int | None  # see MultibodySystem.constrained; None: no constraint equations
    method: Method  # how its scheme moves it on
    observed: Observed | None  # None: the multibody system moves itself


class StructureMotion(Protocol):
    """A structure that can move.

    Attributes
    ----------
    integrator : Integrator
        With the state of the turbine's multibody system, its rates and its inputs.
    structure : Structure
        For the compiled step; the same arrays throughout.
    """

    integrator: Integrator
    structure: Structure

    def begin(self, y: Array, scheme: Scheme) -> None:
        """Begin to move from the state y (n_state,) of the multibody system, under the loads that the inputs hold."""

    def resume(self) -> None:
        """Bring up to date what follows from restored arrays."""

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Every array that carries state, by name."""

    def root_multipliers(self) -> Array:
        """Lagrange multipliers (n_blades, 6) of the constraints that hold the blades [N, N m]."""


class TreeMotion:
    """A turbine whose multibody system moves itself; see `StructureMotion`."""

    def __init__(self, models: TurbineModels) -> None:
        self.models = models
        self.integrator = i = _integrator(models)
        system = models.structure.system
        empty: dict[str, Any] = {name: np.zeros_like(array) for name, array in i.history._asdict().items()}
        saved = i.history._replace(**empty)
        motion = Motion(i.state, i.state_rate, i.inputs, system.tree, i.work)
        self.structure = Structure(motion, i.history, saved, system.constrained, method_of(i), observed=None)
        self._rate: Callable[..., int] | None = None  # compiled once multipliers are asked for

    def begin(self, y: Array, scheme: Scheme) -> None:
        """Begin to move from the state y (n_state,), under the loads that the inputs hold."""
        self.integrator.start(y)

    def resume(self) -> None:
        """Nothing follows from the history."""

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Every array that carries state, by name."""
        arrays = {f"history_{k}": a for k, a in self.integrator.history._asdict().items()}
        return arrays | {f"inputs_{k}": a for k, a in self.integrator.inputs._asdict().items()}

    def root_multipliers(self) -> Array:
        """Lagrange multipliers (n_blades, 6) [N, N m], see `wt_gym.simulation.Simulator.root_multipliers`.

        Raises
        ------
        SimulationError
            Without constraint equations.
        """
        i, system = self.integrator, self.models.structure.system
        if not system.constraints:
            raise SimulationError(
                "there are no multipliers without constraint equations: formulation='constrained' has them; the "
                "channels root_flap_moment, root_edge_moment and root_torsion have the moments in every formulation"
            )
        history = new_history(system.n_state)  # its newest rate is evaluated again
        history.y[3] = i.state
        arguments = history, i.inputs, system.tree, i.work, 1.0, 0, 0, system.constrained, True
        if self._rate is None:  # to look up the types of the arguments takes twenty times as long as the call
            self._rate = compiled_for(hamming_advance, arguments)
        code = self._rate(*arguments)
        if code != tree_kernels.OK:
            raise SimulationError(failure_of_a_step(code, i.step))
        return np.array([i.work.multipliers[system.multiplier_rows(k)] for k in range(len(system.constraints))])


def _integrator(models: TurbineModels) -> Integrator:
    """Integrator of the structure of a turbine, at rest."""
    system, fidelity, length = models.structure.system, models.fidelity, models.turbine.blade.length
    name = DEFAULT if fidelity.formulation == "observer" else fidelity.integrator  # frames have their own scheme
    settings = fidelity.scheme_settings._replace(tolerance=NEWTON_TOLERANCE * length, trail=models.n_substeps)
    return coupled_integrator(name, system, models.time_step / models.n_substeps, settings)


ITERATIONS = 1
"""Solutions of a structural step. A second one, with directions of constraints and loads renewed, changes nothing."""


class ObserverMotion(TreeMotion):
    """A turbine whose observer frames move; see `StructureMotion`.

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

    def _hinges(self, model: frame.Model) -> Integers:
        """Rows of the constraint equations, springs, and their places in the state (n_hinges, 4)."""
        system = self.models.structure.system
        rows = {model.row_spring[r]: r for r in range(len(model.row_kind)) if model.row_kind[r] == TORQUE}
        hinges = [
            (rows[spring], spring, system.index(b, "joint_q"), system.index(b, "joint_u"))
            for spring, b in self.translation.hinges
        ]
        return np.array(hinges, dtype=np.int64).reshape(-1, 4)

    def _servo_steps(self) -> Array:
        """What the error and the rate of each servo become within a structural step (n_servo, 2, 2)."""
        tree, h = self.structure.motion.tree, self.integrator.step
        steps = [
            expm(h * np.array([[0.0, 1.0], [-(w**2), -2.0 * d * w]]))
            for w, d in zip(tree.servo_frequency, tree.servo_damping, strict=True)
        ]
        return np.array(steps).reshape(-1, 2, 2)

    def begin(self, y: Array, scheme: Scheme) -> None:
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
