"""The structure of a turbine in motion, as the coupled step knows it whatever its form.

A form is what `StructureMotion` asks for: it starts from a state, hands a `Structure` to the compiled step, names the
arrays that carry its state, and comes back after they were restored. The compiled half of the contract is
`wt_gym.simulation.step.structure_motion_kernels`. Here is the form in which the turbine's multibody system moves
itself, blades on joints ("embedded") or held by constraint equations ("constrained"), in modal or nodal coordinates;
local observer frames are in :mod:`wt_gym.simulation.step.observer_motion`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from wt_gym.base.compiled import compiled_for
from wt_gym.base.errors import SimulationError
from wt_gym.multibody.arrays import Inputs, Tree, Work
from wt_gym.multibody.errors import failure_of_a_step
from wt_gym.multibody.integrators.hamming import History, new_history
from wt_gym.multibody.integrators.integrator_kernels import hamming_advance
from wt_gym.multibody.integrators.schemes import DEFAULT, Integrator, Method, coupled_integrator, method_of
from wt_gym.multibody.tree import tree_kernels

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from wt_gym.multibody.observer_frame import observer_frame_arrays as frame
    from wt_gym.simulation.model.assembly import TurbineModels
    from wt_gym.simulation.step.coupling_data import Scheme

__all__ = ["Motion", "Observed", "Structure", "StructureMotion", "TreeMotion"]

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

    def begin(self, y: NDArray[np.float64], scheme: Scheme) -> None:
        """Begin to move from the state y (n_state,) of the multibody system, under the loads that the inputs hold."""

    def resume(self) -> None:
        """Bring up to date what follows from restored arrays."""

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Every array that carries state, by name."""

    def root_multipliers(self) -> NDArray[np.float64]:
        """Lagrange multipliers (n_blades, 6) of the constraints that hold the blades [N, N m]."""


class TreeMotion:
    """A turbine whose multibody system moves itself; see `StructureMotion`.

    Parameters
    ----------
    models : TurbineModels
    """

    def __init__(self, models: TurbineModels) -> None:
        self.models = models
        self.integrator = i = _integrator(models)
        system = models.structure.system
        empty: dict[str, Any] = {name: np.zeros_like(array) for name, array in i.history._asdict().items()}
        saved = i.history._replace(**empty)
        motion = Motion(i.state, i.state_rate, i.inputs, system.tree, i.work)
        self.structure = Structure(motion, i.history, saved, system.constrained, method_of(i), observed=None)
        self._rate: Callable[..., int] | None = None  # compiled once multipliers are asked for

    def begin(self, y: NDArray[np.float64], scheme: Scheme) -> None:
        """Begin to move from the state y (n_state,), under the loads that the inputs hold."""
        self.integrator.start(y)

    def resume(self) -> None:
        """Nothing follows from the history."""

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Every array that carries state, by name."""
        arrays = {f"history_{k}": a for k, a in self.integrator.history._asdict().items()}
        return arrays | {f"inputs_{k}": a for k, a in self.integrator.inputs._asdict().items()}

    def root_multipliers(self) -> NDArray[np.float64]:
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
