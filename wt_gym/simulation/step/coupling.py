"""Structure and air of one turbine marched together: their state, and one aerodynamic step.

What a step does stands in `wt_gym.simulation.step.coupled_step_kernels`; how a structure moves, whatever its form, in
:mod:`wt_gym.simulation.step.structure_motion`.
"""

from __future__ import annotations

from functools import cached_property
from types import FunctionType
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.base.compiled import compiled_for, is_compiled, was_compiled
from wt_gym.base.errors import SimulationError
from wt_gym.multibody.errors import failure_of_a_step
from wt_gym.multibody.tree import tree_kernels
from wt_gym.simulation.model.deformed_basis import DeformedBasis
from wt_gym.simulation.model.turbine_bodies import place_nacelle
from wt_gym.simulation.step import coupled_step_kernels, energy_kernels, monitor_kernels, structure_motion_kernels
from wt_gym.simulation.step.coupled_step_kernels import coupled_step, end_step, predict_step
from wt_gym.simulation.step.coupling_data import Air, CouplingData, Scheme
from wt_gym.simulation.step.measurement import Gauges, MeasuredState
from wt_gym.simulation.step.monitor import Extremes, Monitor
from wt_gym.simulation.step.observer_motion import ObserverMotion
from wt_gym.simulation.step.step_wind import StepWind
from wt_gym.simulation.step.structure_motion import Structure, StructureMotion, TreeMotion
from wt_gym.simulation.step.tower_air import MovingBodies

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from wt_gym.simulation.model.assembly import TurbineModels
    from wt_gym.wind.inflow import Inflow

__all__ = ["Coupling"]

FORMS: dict[str, Callable[[TurbineModels], StructureMotion]] = {
    "embedded": TreeMotion,
    "constrained": TreeMotion,
    "observer": ObserverMotion,
}
"""How a structure moves, by `Fidelity.formulation`."""
LOOSEST = 0.1
"""Change of the loads of the blades, over the largest of them, with which a step may end."""

_Bundle = tuple[Air, Structure, CouplingData, Scheme, Gauges, Monitor]


class Coupling:
    """Structure and air of one turbine, in one state of motion.

    Parameters
    ----------
    models : TurbineModels

    Attributes
    ----------
    models : TurbineModels
    motion : StructureMotion
        Of the structure, in the form that the fidelity names.
    integrator : HammingIntegrator, NewmarkIntegrator or GeneralizedAlphaIntegrator
        With the state and the inputs of the structure.
    aero : AeroState
    exchange : CouplingData
    gauges : Gauges
        With the signals of the last step, except those that `Measurement.complete` fills in.
    extremes : Extremes
        Since they were last told to ``restart``.
    scheme : Scheme
        May be exchanged, from one step to the next too.
    wind : StepWind
    basis : DeformedBasis or None
        Of the blades, where it follows their deformation.
    moving : MovingBodies or None
        Closed bodies that follow the structure.
    """

    def __init__(self, models: TurbineModels) -> None:
        self.models = models
        fidelity = models.fidelity
        self.motion: StructureMotion = FORMS[fidelity.formulation](models)
        self.integrator = i = self.motion.integrator
        self.aero = models.lattice.new_state()
        self.exchange = CouplingData.of(models, i.inputs.body_loads)
        self.gauges = Gauges.of(models.turbine, models.structure)
        self._monitor = Monitor.of(models.structure, i.inputs.body_loads, models.turbine.n_blades)
        self.extremes: Extremes = self._monitor.extremes
        self._scheme = Scheme(
            models.time_step, i.step, models.n_substeps, fidelity.corrections, fidelity.coupling_iterations,
            fidelity.coupling_tolerance, LOOSEST,
        )  # fmt: skip
        self.wind = StepWind(models, self.aero, self.exchange, i.work, self.gauges.hub_wind)
        first = self._monitor.first_pitch
        self._pitches = slice(first, first + models.turbine.n_blades)
        self._bundles: _Bundle | None = None  # arguments of the step
        self.basis = DeformedBasis(models) if fidelity.blade_basis == "deformed" else None
        self.moving = MovingBodies(models) if fidelity.moving_bodies else None
        self._state: NDArray[np.float64] = i.state
        self._generator_u = self._monitor.generator_u
        self._moved_to = self._state  # what the kinematics belong to

    @property
    def scheme(self) -> Scheme:
        """How a step is taken."""
        return self._scheme

    @scheme.setter
    def scheme(self, scheme: Scheme) -> None:
        self._scheme, self._bundles = scheme, None

    @property
    def generator_speed(self) -> float:
        """Speed of the generator, low-speed shaft [rad/s]."""
        return self._state.item(self._generator_u)

    @property
    def pitch(self) -> NDArray[np.float64]:
        """Pitch of the blades (n_blades,) [rad], a view."""
        return self._state[self._pitches]

    @cached_property
    def instant(self) -> MeasuredState:
        """What can be measured now: views of the present state, whenever they are read."""
        i = self.integrator
        return MeasuredState(i.state, i.state_rate, i.inputs.body_loads[1], i.work, self.blade_nodes, self.blade_forces)

    def root_multipliers(self) -> NDArray[np.float64]:
        """Lagrange multipliers of the blades' constraints, see `wt_gym.simulation.Simulator.root_multipliers`."""
        return self.motion.root_multipliers()

    @property
    def blade_nodes(self) -> NDArray[np.float64]:
        """Lattice nodes (n_blades, n_points, 3) [m], a view."""
        return _by_blade(self.exchange.nodes)

    @property
    def blade_forces(self) -> NDArray[np.float64]:
        """Forces of the air on them [N], a view."""
        return _by_blade(self.aero.nodal_forces)

    # ---- state -------------------------------------------------------------------------------------------------------

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Every array that carries state, by name."""
        arrays = self.motion.arrays()
        arrays |= {f"aero_{k}": a for k, a in self.aero.arrays._asdict().items()}
        arrays |= {"nodes": self.exchange.nodes, "velocities": self.exchange.velocities}
        arrays |= {"previous_loads": self.exchange.previous_loads, "relaxation": self.exchange.relaxation}
        arrays |= {"earlier_velocities": self.wind.earlier_velocities, "passed": self._monitor.passed}
        arrays |= {f"extremes_{k}": a for k, a in self.extremes._asdict().items()} | {"last_pitch": self._monitor.pitch}
        arrays |= {f"energy_{k}": a for k, a in self.exchange.energy.state().items()}
        if self.basis is not None:
            arrays |= {"blade_basis": self.basis.basis, "blade_frequency": self.basis.frequency}
        if self.moving is not None:
            arrays |= self.moving.state() | {"tower_given": self.exchange.tower.given}
        return arrays

    def restart(self) -> None:
        """Forget what runs before have left beyond the arrays that `begin` sets."""
        if self.basis is not None:
            self.basis.restart()
        if self.moving is not None:
            self.moving.restart()
            self.exchange.tower.given[:] = 0.0

    def begin(self, y: NDArray[np.float64]) -> None:
        """Start to move from the state y (n_state,), under the loads that the inputs hold."""
        self.exchange.previous_loads[:] = self.integrator.inputs.body_loads[0]
        self.exchange.relaxation[:] = 1.0, 0.0, 0.0
        self.exchange.energy.begin()
        self.begin_motion(y)
        self.wind.earlier_velocities[:] = self.exchange.velocities
        self._monitor.pitch[:] = self.pitch
        m = self.motion.structure.motion
        monitor_kernels.watch(m.state, m.rate, m.inputs.body_loads[1], m.tree, m.work, self.gauges, self._monitor)
        self.extremes.restart()

    def begin_motion(self, y: NDArray[np.float64]) -> None:
        """Let the structure start to move from the state y (n_state,), and the lattice with it."""
        self.motion.begin(y, self._scheme)
        self.move_lattice(self._state)

    def resume(self) -> None:
        """Bring up to date what follows from restored arrays."""
        if self.basis is not None:
            self.basis.install()
        self.motion.resume()
        self.move_lattice(self._state)
        self._place_bodies()

    def move_lattice(self, y: NDArray[np.float64]) -> None:
        """Lattice nodes and their velocities for the state y (n_state,); the kinematics are then up to date."""
        motion = self.motion.structure.motion
        structure_motion_kernels.move_lattice(y, motion.tree, motion.work, self.exchange)
        self._moved_to = y

    def _place_bodies(self) -> None:
        """The bodies where the structure is, as far as the kinematics are up to date."""
        work, nacelle = self.integrator.work, self.models.structure.nacelle
        if self.moving is not None:
            self.moving.place(self._moved_to, work)
            return
        place_nacelle(self.models.lattice.bodies, work.rot[nacelle], work.omega[nacelle])

    def take_wind(self, inflow: Inflow, time: float) -> NDArray[np.float64]:
        """Wind at the lattice nodes (n_blades, n_chord + 1, n_span + 1, 3) where they are now [m/s]; see `StepWind`."""
        if self.models.lattice.bodies:
            self._place_bodies()
        return self.wind.now(inflow, time)

    # ---- the step ----------------------------------------------------------------------------------------------------

    def step(self, inflow: Inflow, time: float) -> None:
        """One aerodynamic step from ``time`` [s] on: wake, then structure and loads iterated to agreement at its end.

        The inputs of the structure hold the commands at its end.

        Raises
        ------
        SimulationError
            When the step fails; the state then has no meaning.
        """
        if self.basis is not None:
            self._renew_basis()
        elif self.moving is not None:  # bodies are placed by the same kinematics as after a snapshot
            self.move_lattice(self._state)
        bodies = self.models.lattice.bodies
        if bodies:
            self._place_bodies()
        blade_wind = self.wind.of_step(inflow, time)
        if self._bundles is None or bodies:  # the arrays of bodies are others now and then
            self._bundles = self.bundle()
        code = self._advance(*self._bundles, blade_wind)
        if code != tree_kernels.OK:
            raise SimulationError(self._failure(code))
        if self.moving is not None:
            y, work = self._state, self.integrator.work
            self.move_lattice(y)
            self.moving.take_force(self.aero.arrays, y, work)
            self.moving.load(y, work, self.exchange.tower.given)

    def _renew_basis(self) -> None:
        """Modes of the blades as they are now."""
        assert self.basis is not None
        self.move_lattice(self._state)
        loads = (self.integrator.inputs.body_loads, self.exchange.previous_loads, self._monitor.loads)
        self.basis.update(self.integrator.history, loads, self.integrator.work, self.blade_forces)
        self.move_lattice(self._state)

    @cached_property
    def _advance(self) -> Callable[..., int]:
        """What takes a step: one compiled call, or several with the induction of a big wake between them."""
        if self.models.lattice.split is not None:
            return self._step_in_parts()
        return coupled_step if self.models.lattice.bodies else self.compiled_step()

    def _step_in_parts(self) -> Callable[..., int]:
        """`coupled_step` as Python runs it, where the lattice prepares and accepts a step in threads of its own."""
        lattice, aero, source = self.models.lattice, self.aero, coupled_step.py_func
        own = {
            "prepare_air": lambda air, nodes: lattice.prepare(aero, nodes),
            "accept_air": lambda air: lattice.accept(aero),
        }
        return FunctionType(source.__code__, source.__globals__ | own)

    def bundle(self) -> _Bundle:
        """Arguments of the compiled step except the wind at the blades."""
        lattice = self.models.lattice
        air = Air(lattice.arrays, lattice.constants, self.aero.arrays, lattice.work, *lattice.body_arrays)
        return air, self.motion.structure, self.exchange, self._scheme, self.gauges, self._monitor

    def _failure(self, code: int) -> str:
        """What a code of the compiled step says."""
        y, x = self._state, self.exchange
        if code == coupled_step_kernels.OVERSPEED:
            speed, generator = monitor_kernels.rotor_speed(y, self._monitor), self.generator_speed
            return f"rotor speed {speed:.2f} rad/s (generator {generator:.2f}) is beyond {x.max_speed:.2f} rad/s"
        if code == coupled_step_kernels.DEFLECTION:
            largest = np.linalg.norm(self.gauges.deflection, axis=1).max()
            if x.sub_bodies is None:
                largest = np.linalg.norm(np.einsum("ck,bk->bc", x.tip, y[x.elastic_q]), axis=1).max()
            return f"tip deflection {largest:.1f} m is beyond the elastic model ({x.max_deflection:.1f} m)"
        if code == coupled_step_kernels.UNSETTLED:
            return f"circulation and polars of the blades disagree by {self.aero.residual:.3g} m/s"
        if code == energy_kernels.STRUCTURE_GAINS:
            return (
                f"energy balance violated: the structure gained {x.energy.gained[0] / 1e6:.3g} MJ more than the work "
                "done on it"
            )
        if code == energy_kernels.AIR_GIVES:
            return (
                f"energy balance violated: the air gave {x.energy.excess_energy[0] / 1e6:.3g} MJ more than Betz's "
                f"limit, and the {x.energy.excess_limit / 1e6:.3g} MJ that move round the rotor do not cover them"
            )
        failure: str = failure_of_a_step(code, self._scheme.h)
        return failure

    # ---- compilation -------------------------------------------------------------------------------------------------

    def compiled_step(self) -> Callable[..., int]:
        """The step of structure and air together, for the types of its arguments."""
        step: Callable[..., int] = compiled_for(coupled_step, (*self.bundle(), self.wind.blades))
        return step

    @classmethod
    def was_compiled(cls) -> bool:
        """Whether the step of any turbine is in the cache of compiled kernels."""
        return bool(was_compiled(end_step))

    def is_compiled(self) -> bool:
        """Whether the step is in the cache for the types of its arguments, which formulations and bodies change."""
        if self.models.lattice.split is None:
            return bool(is_compiled(coupled_step, (*self.bundle(), self.wind.blades)))
        return all(is_compiled(*part) for part in self.parts_without_air())

    def parts_without_air(self) -> tuple[tuple[Any, tuple[Any, ...]], ...]:
        """Kernels of the step that do without the induction of the wake, with their arguments."""
        air, structure, x, scheme, gauges, monitor = self.bundle()
        return (
            (predict_step, (air, structure, x, scheme)),
            (end_step, (structure, x, scheme, gauges, monitor, air.arrays.forces, self.wind.blades)),
        )


def _by_blade(array: NDArray[np.float64]) -> NDArray[np.float64]:
    return array.reshape(len(array), -1, 3)
