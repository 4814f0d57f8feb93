"""Structure and air marched together: what passes between them, and one aerodynamic step."""

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np

from wt_gym.compiled import compiled_for, is_compiled, was_compiled
from wt_gym.errors import SimulationError
from wt_gym.multibody.errors import failure_of_a_step
from wt_gym.multibody.integrators.hamming import new_history
from wt_gym.multibody.integrators.integrator_kernels import hamming_advance
from wt_gym.multibody.integrators.schemes import coupled_integrator, method_of
from wt_gym.multibody.tree import tree_kernels
from wt_gym.simulation.model.deformed_basis import DeformedBasis
from wt_gym.simulation.model.turbine_bodies import place_nacelle
from wt_gym.simulation.model.turbine_structure import drag_heights
from wt_gym.simulation.step import coupled_step_kernels, energy_kernels, monitor_kernels
from wt_gym.simulation.step.energy import EnergyBalance
from wt_gym.simulation.step.measurement import Gauges, MeasuredState
from wt_gym.simulation.step.monitor import Monitor
from wt_gym.simulation.step.tower_air import MovingBodies
from wt_gym.simulation.step.wind_kernels import ask_for_wind, felt_wind, receive_wind
from wt_gym.wind.protocol import fill_velocity, read_only

__all__ = ["Air", "Coupling", "Exchange", "Motion", "Scheme", "TowerAir"]

MAX_DEFLECTION = 0.4
"""Elastic tip displacement, in blade lengths, beyond which a linear elastic blade has lost its meaning."""
MAX_OVERSPEED = 3.0
"""Rotor speed, in rated speeds, at which a simulation is given up."""
NEWTON_TOLERANCE = 2e-8
"""Change of the position increments, in blade lengths, at which the iteration of an implicit step ends, far below what
the passes of structure and loads leave."""
LOOSEST = 0.1
"""Change of the loads of the blades, over the largest of them, with which a step may end."""


class Air(NamedTuple):
    """The lattice, as the compiled step takes it."""

    planform: tuple  # PlanformArrays
    constants: tuple  # AeroConstants
    arrays: tuple  # AeroArrays: the state
    work: tuple  # AeroWork
    bodies: tuple | None  # BodyArrays
    body_work: tuple | None  # BodyWork


class Motion(NamedTuple):
    """The structure, as the compiled step takes it."""

    history: tuple  # History: what the integration goes on from
    saved: tuple  # the same, room for a copy
    state: np.ndarray  # (n_state,) newest state, a view
    rate: np.ndarray  # (n_state,) its rate, a view
    method: tuple  # Method: how the scheme moves it on
    inputs: tuple  # Inputs
    tree: tuple  # Tree
    work: tuple  # Work
    constrained: int | None  # see MultibodySystem.constrained


class Scheme(NamedTuple):
    """How a step is taken."""

    dt: float  # aerodynamic step [s]
    h: float  # structural step [s]
    n_sub: int  # structural steps in an aerodynamic one
    n_corrections: int  # corrector passes of the structure
    iterations: int  # most passes of structure and loads
    tolerance: float  # relative change of the loads at which the passes end
    loosest: float  # relative change of the loads with which a step may end


class TowerAir(NamedTuple):
    """The tower in the wind: points that bear its drag, their motion, and the wind and forces there."""

    body: int
    points: tuple  # Points
    drag: np.ndarray  # (n,) drag over the square of the speed [kg/m]
    wind: np.ndarray  # (n, 3) [m/s]
    position: np.ndarray  # (n, 3) [m]
    velocity: np.ndarray  # (n, 3) [m/s]
    force: np.ndarray  # (n, 3) [N]
    given: np.ndarray  # (6 + n_f,) loads of the tower beside the drag

    @classmethod
    def of(cls, turbine, structure):
        """The tower of a turbine at rest; a force per length is integrated over its height by Simpson's rule."""
        tower, points = turbine.tower, structure.drag_points
        height = drag_heights(tower)
        length = (height[1] - height[0]) / 3.0 * np.array([1.0, *[4.0, 2.0] * (len(height) // 2 - 1), 4.0, 1.0])
        pressure_width = 0.5 * turbine.air_density * tower.drag_coefficient * tower.diameter_at(height)
        rest = points.position + np.array([0.0, 0.0, tower.base_height])
        free = np.zeros((3, *rest.shape))
        given = np.zeros(structure.system.new_inputs().body_loads.shape[2])
        return cls(structure.tower, points, pressure_width * length, free[0], rest, free[1], free[2], given)


class Exchange(NamedTuple):
    """What passes between structure and air, and the limits of the model."""

    nodes: np.ndarray  # (n_blades, n_chord + 1, n_span + 1, 3) lattice nodes [m]
    velocities: np.ndarray  # the same [m/s]
    points: tuple  # Points of the lattice on a blade, or on its pieces
    lattice_bodies: np.ndarray  # (n_lattice_bodies,) bodies that carry them: the blades, or their pieces blade by blade
    sub_bodies: tuple | None  # SubBodyNodes; None: a blade is one body
    elastic_q: np.ndarray  # (n_lattice_bodies, n_f) where the coordinates of a carrier are in the state
    elastic_u: np.ndarray  # (n_lattice_bodies, n_f) and their rates
    elastic: np.ndarray  # (n_lattice_bodies, n_f)
    elastic_rate: np.ndarray  # (n_lattice_bodies, n_f)
    previous_loads: np.ndarray  # (n_b, 6 + n_f) of the bodies, one step ago
    passes: np.ndarray  # (2, n_b, 6 + n_f) loads under which the blades moved, and their last change
    relaxation: np.ndarray  # (3,) share taken of a change of the loads, and sums of its secants
    energy: tuple  # EnergyBalance
    tip: np.ndarray  # (3, n_f) displacement of a tip
    tower: TowerAir
    max_speed: float  # [rad/s]
    max_deflection: float  # [m]

    @classmethod
    def of(cls, models, body_loads):
        """Arrays for a turbine whose bodies bear loads of the shape of ``body_loads`` (2, n_b, 6 + n_f)."""
        structure, shape = models.structure, models.lattice.nodes_shape
        system, points = structure.system, structure.lattice_points
        lattice_bodies, each = structure.lattice_bodies, np.arange(points.linear.shape[-1])
        q = np.add.outer([system.index(body, "elastic_q") for body in lattice_bodies], each)
        u = np.add.outer([system.index(body, "elastic_u") for body in lattice_bodies], each) + system.n_q
        return cls(
            nodes=np.zeros(shape), velocities=np.zeros(shape), points=points, lattice_bodies=lattice_bodies,
            sub_bodies=structure.sub_body_nodes,
            elastic_q=q, elastic_u=u, elastic=np.zeros(q.shape), elastic_rate=np.zeros(q.shape),
            previous_loads=np.zeros_like(body_loads[0]), passes=np.zeros_like(body_loads),
            relaxation=np.array([1.0, 0.0, 0.0]), energy=EnergyBalance.of(models),
            tip=np.ascontiguousarray(structure.tip_points.linear[0]), tower=TowerAir.of(models.turbine, structure),
            max_speed=MAX_OVERSPEED * models.turbine.drivetrain.rated_rotor_speed,
            max_deflection=MAX_DEFLECTION * models.turbine.blade.length,
        )  # fmt: skip


def _integrator(system, h, fidelity, n_substeps, length):
    """Integrator of a structure in steps of h [s] with blades of a length [m]."""
    name = "hamming" if fidelity.formulation == "observer" else fidelity.integrator  # frames bring their own scheme
    settings = fidelity.scheme_settings._replace(tolerance=NEWTON_TOLERANCE * length, trail=n_substeps)
    return coupled_integrator(name, system, h, settings)


class Coupling:
    """Structure and air of one turbine, in one state of motion.

    Parameters
    ----------
    models : TurbineModels

    Attributes
    ----------
    models : TurbineModels
    integrator : HammingIntegrator, NewmarkIntegrator or GeneralizedAlphaIntegrator
        Of the structure, with its state and inputs.
    aero : AeroState
    exchange : Exchange
    gauges : Gauges
        With the signals of the last step, but for those that `Measurement.complete` fills in.
    extremes : Extremes
        Since they were last told to ``restart``.
    scheme : Scheme
        May be exchanged, from one step to the next too.
    """

    _whole_step = staticmethod(coupled_step_kernels.coupled_step)
    _last_part = staticmethod(coupled_step_kernels.end_step)

    def __init__(self, models):
        self.models = models
        fidelity, system = models.fidelity, models.structure.system
        h = models.time_step / models.n_substeps
        self.integrator = _integrator(system, h, fidelity, models.n_substeps, models.turbine.blade.length)
        self.aero = models.lattice.new_state()
        self.exchange = Exchange.of(models, self.integrator.inputs.body_loads)
        self.gauges = Gauges.of(models.turbine, models.structure)
        self._monitor = Monitor.of(models.structure, self.integrator.inputs.body_loads, models.turbine.n_blades)
        self._earlier_velocities = np.zeros(models.lattice.nodes_shape)
        self._saved = type(self.integrator.history)(*(np.zeros_like(x) for x in self.integrator.history))
        self._scheme = Scheme(
            models.time_step, h, models.n_substeps, fidelity.corrections, fidelity.coupling_iterations,
            fidelity.coupling_tolerance, LOOSEST,
        )  # fmt: skip
        # the nodes of the lattice, the points of the tower, which stay, and the hub
        nodes, tower = self.exchange.nodes.reshape(-1, 3), self.exchange.tower.position
        self._wind_points = np.concatenate([nodes, tower, np.zeros((1, 3))])
        self._wind = np.zeros_like(self._wind_points)  # undisturbed, there
        self._blade_wind = np.zeros(models.lattice.nodes_shape)
        self._blade_winds = self._blade_wind.reshape(-1, 3)  # a view
        row_points = models.lattice.work.row_points
        self._row_points, self._row_size = read_only(row_points.reshape(-1, 3)), row_points[0].size // 3
        self._row_winds = np.zeros(row_points.shape)
        self._row_wind = self._row_winds.reshape(-1, 3)
        self._points = read_only(self._wind_points)
        moving = self.exchange.nodes, self.exchange.velocities, self._earlier_velocities
        self._moving_points = tuple(array.reshape(-1, 3) for array in moving)  # views
        self._pitches = slice(self._monitor.first_pitch, self._monitor.first_pitch + models.turbine.n_blades)
        self._step, self._bundles = None, None  # compiled for the types of this turbine, and its arguments
        self._rate = None  # compiled too, once multipliers are asked for
        self.basis = DeformedBasis(models) if fidelity.blade_basis == "deformed" else None
        self.moving = MovingBodies(models) if fidelity.moving_bodies else None
        self._moved_to = self.integrator.state  # what the kinematics belong to

    @property
    def scheme(self):
        """How a step is taken."""
        return self._scheme

    @scheme.setter
    def scheme(self, scheme):
        self._scheme, self._bundles = scheme, None

    @property
    def generator_speed(self):
        """Speed of the generator, low-speed shaft [rad/s]."""
        return self.integrator.state.item(self._monitor.generator_u)

    @property
    def pitch(self):
        """Pitch of the blades (n_blades,) [rad], a view."""
        return self.integrator.state[self._pitches]

    @property
    def extremes(self):
        """Largest and smallest values over the structural steps, and ways."""
        return self._monitor.extremes

    @cached_property
    def instant(self):
        """What can be measured now: views of the present state, whenever they are read."""
        i = self.integrator
        return MeasuredState(i.state, i.state_rate, i.inputs.body_loads[1], i.work, self.blade_nodes, self.blade_forces)

    def root_multipliers(self):
        """Lagrange multipliers of the blades' constraints, see `wt_gym.simulation.Simulator.root_multipliers`."""
        i, system = self.integrator, self.models.structure.system
        if not system.constraints:
            raise SimulationError(
                "there are no multipliers without constraint equations: formulation='constrained' has them; the "
                "channels root_flap_moment, root_edge_moment and root_torsion have the moments in every formulation"
            )
        history = new_history(system.n_state)  # its newest rate is evaluated anew
        history.y[3] = i.state
        arguments = history, i.inputs, system.tree, i.work, 1.0, 0, 0, system.constrained, True
        if self._rate is None:  # to look up the types of the arguments takes twenty times as long as the call
            self._rate = compiled_for(hamming_advance, arguments)
        code = self._rate(*arguments)
        if code != tree_kernels.OK:
            raise SimulationError(failure_of_a_step(code, self._scheme.h))
        return np.array([i.work.multipliers[system.multiplier_rows(k)] for k in range(len(system.constraints))])

    @property
    def blade_nodes(self):
        """Lattice nodes (n_blades, n_points, 3) [m], a view."""
        return self._by_blade(self.exchange.nodes)

    @property
    def blade_forces(self):
        """Forces of the air on them [N], a view."""
        return self._by_blade(self.aero.nodal_forces)

    def _by_blade(self, array):
        return array.reshape(len(array), -1, 3)

    def arrays(self):
        """Every array that carries state, by name."""
        arrays = {f"history_{k}": a for k, a in self.integrator.history._asdict().items()}
        arrays |= {f"inputs_{k}": a for k, a in self.integrator.inputs._asdict().items()}
        arrays |= {f"aero_{k}": a for k, a in self.aero.arrays._asdict().items()}
        arrays |= {"nodes": self.exchange.nodes, "velocities": self.exchange.velocities}
        arrays |= {"previous_loads": self.exchange.previous_loads, "relaxation": self.exchange.relaxation}
        arrays |= {"earlier_velocities": self._earlier_velocities, "passed": self._monitor.passed}
        arrays |= {f"extremes_{k}": a for k, a in self.extremes._asdict().items()} | {"last_pitch": self._monitor.pitch}
        arrays |= {f"energy_{k}": a for k, a in self.exchange.energy.state().items()}
        if self.basis is not None:
            arrays |= {"blade_basis": self.basis.basis, "blade_frequency": self.basis.frequency}
        if self.moving is not None:
            arrays |= self.moving.state() | {"tower_given": self.exchange.tower.given}
        return arrays

    def restart(self):
        """Forget what runs before have left beyond the arrays that `begin` sets."""
        if self.basis is not None:
            self.basis.restart()
        if self.moving is not None:
            self.moving.restart()
            self.exchange.tower.given[:] = 0.0

    def begin(self, y):
        """Start to move from the state y, under the loads that the inputs hold."""
        system = self.models.structure.system
        self.exchange.previous_loads[:] = self.integrator.inputs.body_loads[0]
        self.exchange.relaxation[:] = 1.0, 0.0, 0.0
        self.exchange.energy.begin()
        self._start_structure(y)
        self.move_lattice(self.integrator.state)
        self._earlier_velocities[:] = self.exchange.velocities
        self._monitor.pitch[:] = self.pitch
        y, dy, tree, work = self.integrator.state, self.integrator.state_rate, system.tree, self.integrator.work
        loads = self.integrator.inputs.body_loads[1]
        monitor_kernels.watch(y, dy, loads, tree, work, self.gauges, self._monitor)
        self.extremes.restart()

    def _start_structure(self, y):
        self.integrator.start(y)

    def resume(self):
        """Bring up to date what follows from restored arrays."""
        if self.basis is not None:
            self.basis.install()
        self.move_lattice(self.integrator.state)
        self._place_bodies()

    def move_lattice(self, y):
        """Lattice nodes and their velocities for the state y; the kinematics are then up to date."""
        tree, work = self.models.structure.system.tree, self.integrator.work
        coupled_step_kernels.move_lattice(y, tree, work, self.exchange)
        self._moved_to = y

    # ---- the step ----------------------------------------------------------------------------------------------------

    def step(self, inflow, time):
        """One aerodynamic step from ``time`` [s] on: wake, then structure and loads iterated to agreement at its end.

        The inputs of the structure hold the commands at its end.

        Raises
        ------
        SimulationError
            When the step fails; the state then has no meaning.
        """
        x, dt = self.exchange, self.models.time_step
        if self.basis is not None:
            self._renew_basis()
        elif self.moving is not None:  # bodies are placed by the same kinematics as after a snapshot
            self.move_lattice(self.integrator.state)
        code = self._advance(self._winds_of_step(inflow, time, dt))
        if code != tree_kernels.OK:
            raise SimulationError(self._failure(code))
        if self.moving is not None:
            y, work = self.integrator.state, self.integrator.work
            self.move_lattice(y)
            self.moving.take_force(self.aero.arrays, y, work)
            self.moving.load(y, work, x.tower.given)

    def _renew_basis(self):
        """Modes of the blades as they are now."""
        self.move_lattice(self.integrator.state)
        loads = (self.integrator.inputs.body_loads, self.exchange.previous_loads, self._monitor.loads)
        self.basis.update(self.integrator.history, loads, self.integrator.work, self.blade_forces)
        self.move_lattice(self.integrator.state)

    def _advance(self, blade_wind):
        """One compiled call; or several with the induction of a big wake between them."""
        lattice = self.models.lattice
        if self._bundles is None or lattice.bodies:  # bodies are placed anew now and then
            self._bundles = self.bundle()
        if lattice.split is not None:
            return self._advance_split(blade_wind)
        if lattice.bodies:
            return self._whole_step(*self._bundles, blade_wind)
        if self._step is None:
            self._step = self.compiled_step()
        return self._step(*self._bundles, blade_wind)

    def compiled_step(self):
        """The step of structure and air together, for the types of its arguments."""
        return compiled_for(self._whole_step, (*self.bundle(), self._blade_wind))

    @classmethod
    def was_compiled(cls):
        """Whether the step of any such turbine is in the cache of compiled kernels."""
        return was_compiled(cls._last_part)

    def is_compiled(self):
        """Whether the step is in the cache for the types of its arguments, which formulations and bodies change."""
        if self.models.lattice.split is None:
            return is_compiled(self._whole_step, (*self.bundle(), self._blade_wind))
        return all(is_compiled(*part) for part in self.parts_without_air())

    def parts_without_air(self):
        """Kernels of the step that do without the induction of the wake, with their arguments."""
        air, motion, x, scheme, gauges, monitor = self.bundle()
        kernels = coupled_step_kernels
        return (
            (kernels.predict_step, (air, motion, x, scheme)),
            (kernels.end_step, (motion, x, scheme, gauges, monitor, self.blade_forces, self._blade_wind)),
        )

    def bundle(self):
        """Arguments of the compiled step."""
        lattice, i, system = self.models.lattice, self.integrator, self.models.structure.system
        air = Air(lattice.arrays, lattice.constants, self.aero.arrays, lattice.work, *lattice.body_arrays)
        motion = Motion(i.history, self._saved, i.state, i.state_rate, method_of(i), i.inputs, system.tree, i.work,
                        system.constrained)  # fmt: skip
        return air, motion, self.exchange, self._scheme, self.gauges, self._monitor

    def _advance_split(self, blade_wind):
        air, motion, x, scheme, gauges, monitor = self._bundles
        code = coupled_step_kernels.predict_step(air, motion, x, scheme)
        if code == tree_kernels.OK:
            self.models.lattice.prepare(self.aero, x.nodes)
            code = coupled_step_kernels.correct_step(air, motion, x, scheme, blade_wind)
        if code == tree_kernels.OK:
            self.models.lattice.accept(self.aero)
            code = coupled_step_kernels.end_step(motion, x, scheme, gauges, monitor, self.blade_forces, blade_wind)
        return code

    def _failure(self, code):
        """What a code of the compiled step says."""
        y, x = self.integrator.state, self.exchange
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
            gained = x.energy.gained[0] / 1e6
            return f"energy balance violated: the structure gained {gained:.3g} MJ more than the work done on it"
        if code == energy_kernels.AIR_GIVES:
            return (
                f"energy balance violated: the air gave {x.energy.borrowed[0] / 1e6:.3g} MJ more than Betz's limit; "
                f"must be at most {x.energy.excess_limit / 1e6:.3g} MJ, the kinetic energy of the air around the rotor"
            )
        return failure_of_a_step(code, self._scheme.h)

    # ---- wind --------------------------------------------------------------------------------------------------------

    def take_wind(self, inflow, time):
        """Wind at the lattice nodes where they are now, and at hub, bodies and tower; see `_winds_of_step`."""
        nodes = self.exchange.nodes.reshape(-1, 3)
        self._wind_points[: len(nodes)] = nodes
        self._wind_points[-1] = self.integrator.work.r[self.models.structure.hub]
        fill_velocity(inflow, self._points, time, self._wind)
        self._check_wind(felt_wind(*self._felt()), inflow, time)
        return self._blade_wind

    def _winds_of_step(self, inflow, time, dt):
        """Wind at the wake at the start of a step; at its end at hub, bodies, tower, and at the nodes of the lattice.

        At the nodes with the blocking of the tower. The drag of the tower is that of the undisturbed wind on its
        undeformed axis, as in blade-element codes: what the rotor takes out of the wind before the upper tower is not
        taken off. The array is overwritten next time.
        """
        ask, asked, receive, felt = self._wind_calls
        count = ask(*asked)
        n = count * self._row_size
        fill_velocity(inflow, self._row_points[:n], time, self._row_wind[:n])
        fill_velocity(inflow, self._points, time + dt, self._wind)
        self._check_wind(receive(self._row_winds[:count], *felt), inflow, time + dt)
        return self._blade_wind

    @cached_property
    def _wind_calls(self):
        """The compiled parts of `_winds_of_step` and their arguments, the same arrays in every step."""
        lattice, structure = self.models.lattice, self.models.structure
        asked = (
            *lattice.turn_of_rows(self.aero), *self._moving_points, self.models.time_step, self.integrator.work,
            structure.hub, self._wind_points,
        )  # fmt: skip
        felt = lattice.work.rows, self.aero.arrays.wind, *self._felt()
        receive = compiled_for(receive_wind, (self._row_winds, *felt))
        return compiled_for(ask_for_wind, asked), asked, receive, felt

    def _felt(self):
        """Arguments of `wind_kernels.felt_wind`."""
        models, tower = self.models, self.models.tower_flow
        shadow = models.fidelity.tower_shadow and models.fidelity.tower_body is None
        top = self.integrator.work.r[models.structure.nacelle]
        return (
            self._wind, self._wind_points, shadow, self.aero.arrays, self.integrator.work, models.structure.hub,
            np.zeros(3), tower.base, top, tower.stations, tower.radii, self._blade_winds, self.exchange.tower.wind,
            self.gauges.hub_wind,
        )  # fmt: skip

    def _check_wind(self, finite, inflow, time):
        """Bodies and their wind, if there are any; refuse a wind that is not finite."""
        lattice = self.models.lattice
        if lattice.bodies:
            self._place_bodies()
            lattice.body_wind[:] = inflow.velocity(lattice.bodies.control_points, time)
            finite = finite and math.isfinite(lattice.body_wind.sum())
        if not finite:
            raise SimulationError(f"the inflow is not finite in the step to time {time} s")

    def _place_bodies(self):
        """The bodies where the structure is, as far as the kinematics are up to date."""
        work, nacelle = self.integrator.work, self.models.structure.nacelle
        if self.moving is not None:
            self.moving.place(self._moved_to, work)
            return
        place_nacelle(self.models.lattice.bodies, work.rot[nacelle], work.omega[nacelle])
