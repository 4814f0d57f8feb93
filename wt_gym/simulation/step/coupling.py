"""Structure and air of one turbine marched together: their state, and one aerodynamic step.

What a step does stands in `wt_gym.simulation.step.coupled_step_kernels`; how a structure moves, whatever its form, in
:mod:`wt_gym.simulation.step.structure_motion`.

The wind of a step is asked of the inflow where wake, blades, tower, hub and bodies need it, and handed to them.

Closed bodies follow the deflected tower: its panels are carried by its sections, the body of hub and nacelle by the
nacelle; both stand where the structure was at the beginning of the step. The force of the air on each ring of panels of
the tower (a strip) follows by Lagally's theorem (`wt_gym.aerodynamics.bodies.body_set`) from what the lattice knows of
it: source strengths, and the velocity of wind, wake, blades and nacelle there. It acts, by virtual work, at the middle
of the strip, on top of the drag (`coupling_kernels.tower_drag`). Mirror images of the tower itself are left out: level
forces of a body and its image on each other cancel.

Forces belong to the end of an accepted step. The next step takes them continued in a straight line, and does not
iterate them with the structure: the air that moves with a tower has a two-hundredth of its mass.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from types import FunctionType
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from wt_gym.aerodynamics import AeroState
from wt_gym.aerodynamics.bodies.body_set import BodySurface, convective_force, impulse
from wt_gym.aerodynamics.state import AeroArrays
from wt_gym.base.compiled import compiled_for, is_compiled, was_compiled
from wt_gym.base.errors import SimulationError
from wt_gym.base.quantities import GRAVITY, Array, Integers
from wt_gym.hydrodynamics.loads import PlatformLoads, WaveResponse
from wt_gym.hydrodynamics.loads_kernels import water_motion
from wt_gym.hydrodynamics.waves import WaveComponents
from wt_gym.multibody.arrays import Points, Work, failure_of_a_step
from wt_gym.multibody.tree import tree_kernels
from wt_gym.multibody.tree.point_kernels import point_motion
from wt_gym.multibody.tree.rotation_kernels import cardan_rotation
from wt_gym.simulation.deformed_basis import DeformedBasis
from wt_gym.simulation.models import NACELLE, TurbineModels, place_nacelle
from wt_gym.simulation.step import (
    coupled_step_kernels,
    energy_kernels,
    monitor_kernels,
    structure_motion_kernels,
    water_kernels,
)
from wt_gym.simulation.step.coupled_step_kernels import coupled_step, end_step, predict_step
from wt_gym.simulation.step.coupling_data import Air, CouplingData, Extremes, Gauges, MeasuredState, Monitor, Scheme
from wt_gym.simulation.step.structure_motion import ObserverMotion, Structure, StructureMotion, TreeMotion
from wt_gym.simulation.step.wind_kernels import ask_for_wind, felt_wind, receive_wind
from wt_gym.simulation.turbine_structure import body_points
from wt_gym.turbines.model import Tower
from wt_gym.wind.inflow import Inflow, fill_velocity, read_only


class StepWind:
    """Wind at the parts of one turbine, whose closed bodies, if there are any, stand where the structure is.

    Parameters
    ----------
    work : Work
        With the kinematics of the structure.
    hub_wind : array (3,)
        Receives the undisturbed wind at the hub [m/s].

    Attributes
    ----------
    blades : array (n_blades, n_chord + 1, n_span + 1, 3)
        Wind at the nodes of the lattice as of the last call [m/s]; overwritten by the next.
    earlier_velocities : array (n_blades, n_chord + 1, n_span + 1, 3)
        Of the nodes at the start of the step before [m/s]; part of the state.
    """

    def __init__(
        self, models: TurbineModels, aero: AeroState, exchange: CouplingData, work: Work, hub_wind: Array
    ) -> None:
        self._models, self._aero, self._exchange, self._work = models, aero, exchange, work
        self._hub_wind, self._dt = hub_wind, models.time_step
        self.blades = np.zeros(models.lattice.nodes_shape)
        self.earlier_velocities = np.zeros(models.lattice.nodes_shape)
        # the nodes of the lattice, the points of the tower, which stay on the ground, and the hub
        nodes, tower = exchange.nodes.reshape(-1, 3), exchange.tower.position
        self._points = np.concatenate([nodes, tower, np.zeros((1, 3))])
        self._moving_tower = tower if models.structure.floater is not None else None
        self._tower_points = self._points[len(nodes) : -1]
        self._undisturbed = np.zeros_like(self._points)
        self._asked_points = read_only(self._points)
        row_points = models.lattice.work.row_points
        self._row_points, self._row_size = read_only(row_points.reshape(-1, 3)), row_points[0].size // 3
        self._row_winds = np.zeros(row_points.shape)
        self._row_wind = self._row_winds.reshape(-1, 3)  # a view

    def now(self, inflow: Inflow, time: float) -> Array:
        """Wind at the lattice nodes where they are now, and at hub, bodies and tower; see `of_step`."""
        nodes = self._exchange.nodes.reshape(-1, 3)
        self._points[: len(nodes)] = nodes
        if self._moving_tower is not None:
            self._tower_points[:] = self._moving_tower
        self._points[-1] = self._work.r[self._models.structure.hub]
        fill_velocity(inflow, self._asked_points, time, self._undisturbed)
        self._check(felt_wind(*self._felt()), inflow, time)
        return self.blades

    def of_step(self, inflow: Inflow, time: float) -> Array:
        """Wind at the wake at the start of a step; at its end at hub, bodies, tower, and at the nodes of the lattice.

        At the nodes with the blocking of the tower. The drag of the tower is that of the undisturbed wind on its
        undeformed axis, as in blade-element codes: what the rotor takes out of the wind before the upper tower is not
        taken off.

        Parameters
        ----------
        time : float
            At the start of the step [s].

        Returns
        -------
        array (n_blades, n_chord + 1, n_span + 1, 3)
            ``blades`` [m/s].

        Raises
        ------
        SimulationError
            When the wind is not finite.
        """
        ask, asked, receive, felt = self._calls
        count = ask(*asked)
        if self._moving_tower is not None:
            self._tower_points[:] = self._moving_tower
        n, end = count * self._row_size, time + self._dt
        fill_velocity(inflow, self._row_points[:n], time, self._row_wind[:n])
        fill_velocity(inflow, self._asked_points, end, self._undisturbed)
        finite = receive(self._row_winds[:count], *felt)
        if self._models.lattice.bodies or not finite:
            self._check(finite, inflow, end)
        return self.blades

    def compile(self) -> None:
        """Compile what `of_step` calls."""
        _ = self._calls

    @cached_property
    def _calls(self) -> tuple[Callable[..., int], tuple[Any, ...], Callable[..., bool], tuple[Any, ...]]:
        """The compiled parts of `of_step` and their arguments, the same arrays in every step."""
        lattice, structure = self._models.lattice, self._models.structure
        moving = self._exchange.nodes, self._exchange.velocities, self.earlier_velocities
        views = (array.reshape(-1, 3) for array in moving)
        asked = (*lattice.turn_of_rows(self._aero), *views, self._dt, self._work, structure.hub, self._points)
        felt = lattice.work.rows, self._aero.arrays.wind, *self._felt()
        receive = compiled_for(receive_wind, (self._row_winds, *felt))
        return compiled_for(ask_for_wind, asked), asked, receive, felt

    def _felt(self) -> tuple[Any, ...]:
        """Arguments of `wind_kernels.felt_wind`."""
        models, tower = self._models, self._models.tower_flow
        shadow = models.fidelity.tower_shadow and models.fidelity.tower_body is None
        top = self._work.r[models.structure.nacelle]
        base = tower.base if self._moving_tower is None else self._work.r[models.structure.tower]
        return (
            self._undisturbed, self._points, shadow, self._aero.arrays, self._work, models.structure.hub, np.zeros(3),
            base, top, tower.stations, tower.radii, self.blades.reshape(-1, 3), self._exchange.tower.wind,
            self._hub_wind,
        )  # fmt: skip

    def _check(self, finite: bool, inflow: Inflow, time: float) -> None:
        """Wind at the closed bodies, if there are any; refuse a wind that is not finite."""
        lattice = self._models.lattice
        if lattice.bodies:
            lattice.body_wind[:] = inflow.velocity(lattice.bodies.control_points, time)
            finite = finite and math.isfinite(lattice.body_wind.sum())
        if not finite:
            raise SimulationError(f"the inflow is not finite in the step to time {time} s")


TOWER = "tower"


class MovingBodies:
    """Places the bodies of a turbine, and loads its tower.

    Parameters
    ----------
    models : TurbineModels
        With closed bodies in the lattice.

    Attributes
    ----------
    force : array (2, n_strips, 3)
        Of the air on the strips at the ends of the last two steps, newest last [N].
    height : array (n_strips,)
        Of the strips above the base of the tower [m].
    """

    def __init__(self, models: TurbineModels) -> None:
        turbine, self._structure, self._lattice = models.turbine, models.structure, models.lattice
        bodies = models.lattice.bodies
        assert bodies is not None  # a fidelity has bodies where it moves them
        self._bodies = bodies
        self._dt, self._density = models.time_step, turbine.air_density
        self._top = np.array([0.0, 0.0, turbine.tower.height])
        self._tower = bodies.names.index(TOWER) if TOWER in bodies.names else None
        self._nacelle = bodies.names.index(NACELLE) if NACELLE in bodies.names else None
        self.height = np.zeros(0)
        if self._tower is not None:
            self._lay_out_tower(bodies.bodies[self._tower], turbine.tower, bodies.first_panel[self._tower :])
        n = len(self.height)
        self.force, self._impulse, self._filled = np.zeros((2, n, 3)), np.zeros((3, n, 3)), np.zeros(1, dtype=np.int64)

    def _lay_out_tower(self, surface: BodySurface, tower: Tower, panels: Integers) -> None:
        """Corners of the panels and middles of the strips as points of the tower; its first panel is ``panels[0]``."""
        beam, basis = self._structure.tower_field
        base = np.array([0.0, 0.0, tower.base_height])
        self._corners = body_points(beam, basis, surface.vertices - base)
        self._panels = slice(panels[0], panels[1])
        levels = np.unique(np.round(surface.vertices[:, 2], 9)) - base[2]
        self.height = 0.5 * (levels[1:] + levels[:-1])
        # a disc at an end belongs to the strip beside it
        of_panel = np.searchsorted(levels, surface.center[:, 2] - base[2]) - 1
        strip = np.clip(of_panel, 0, len(self.height) - 1)
        self._member = (strip == np.arange(len(self.height))[:, None]).astype(float)  # (n_strips, n_panels)
        radii = 0.5 * np.interp(levels, tower.diameter_station, tower.diameter)
        a, b = radii[:-1], radii[1:]
        self._volume = np.pi / 3.0 * (a * a + a * b + b * b) * np.diff(levels)
        self._middles = body_points(beam, basis, self.height[:, None] * [0.0, 0.0, 1.0])

    def restart(self) -> None:
        """Forget the forces of a run before."""
        self.force[:], self._impulse[:], self._filled[:] = 0.0, 0.0, 0

    def state(self) -> dict[str, NDArray[Any]]:
        """Arrays that carry state, by name."""
        return {"tower_force": self.force, "tower_impulse": self._impulse, "tower_filled": self._filled}

    # ---- places ----

    def place(self, y: Array, work: Work) -> None:
        """Put the bodies where the structure is in a state y with these kinematics."""
        bodies = self._bodies
        rotations = np.tile(np.eye(3), (len(bodies.names), 1, 1))
        origins, velocities, spins = (np.zeros((len(bodies.names), 3)) for _ in range(3))
        if self._nacelle is not None:
            k, n = self._nacelle, self._structure.nacelle
            rotations[k] = work.rot[n]
            origins[k] = work.r[n] - work.rot[n] @ self._top
            spins[k] = work.rot[n] @ work.omega[n]
            velocities[k] = work.rot[n] @ work.v[n] + np.cross(spins[k], origins[k] - work.r[n])
        if self._tower is not None:
            corners, moves = self._motion(self._corners, y, work)
            bodies.bend(self._tower, corners)
        bodies.place(rotations, origins, velocities, spins)
        if self._tower is not None:
            quads = bodies.bodies[self._tower].quads  # a panel moves with the mean of its corners
            bodies.arrays.motion[:, self._panels] = moves[quads].mean(axis=1).T

    def _motion(self, points: Points, y: Array, work: Work) -> tuple[Array, Array]:
        """Places (n, 3) [m] and velocities [m/s] of points of the tower."""
        s = self._structure
        q, rate = s.elastic(s.tower, y)
        place, velocity = np.zeros_like(points.position), np.zeros_like(points.position)
        point_motion(work.rot[s.tower], work.r[s.tower], work.v[s.tower], work.omega[s.tower], q, rate, points, place,
                     velocity)  # fmt: skip
        return place, velocity

    # ---- loads ----

    def take_force(self, aero: AeroArrays, y: Array, work: Work) -> None:
        """Force of the air on the strips at the end of a step; the kinematics belong to the state y."""
        if self._tower is None:
            return
        bodies, flow = self._bodies, self._flow(aero)
        flux = (aero.body_strength * bodies.area)[self._panels] * self._member
        place, velocity = self._motion(self._middles, y, work)
        arm = bodies.arrays.center[:, self._panels].T - place[:, None]
        self._impulse[:2] = self._impulse[1:]
        self._impulse[2] = impulse(flux, arm, self._volume, velocity, self._density)
        self._filled[0] = min(self._filled[0] + 1, 3)
        rate = np.zeros_like(velocity)
        if self._filled[0] == 2:
            rate = (self._impulse[2] - self._impulse[1]) / self._dt
        elif self._filled[0] == 3:
            rate = (1.5 * self._impulse[2] - 2.0 * self._impulse[1] + 0.5 * self._impulse[0]) / self._dt
        self.force[0] = self.force[1]
        self.force[1] = rate + convective_force(flux, flow, velocity, self._density)
        if self._filled[0] == 1:
            self.force[0] = self.force[1]

    def _flow(self, aero: AeroArrays) -> Array:
        """Velocity of everything but the tower at its panels (n, 3) [m/s]."""
        work, bodies, p = self._lattice.body_arrays[1], self._bodies, self._panels
        assert work is not None
        rings = np.tensordot(aero.gamma.ravel(), work.ring_influence[:, :, p], axes=1)
        flow: Array = work.wind[p] + (work.wake_flow[:, p] + rings).T
        if len(bodies.names) > 1:
            others = aero.body_strength.copy()
            others[p] = 0.0
            flow = flow + bodies.velocity(bodies.control_points[p], others)
        return flow

    def load(self, y: Array, work: Work, out: Array) -> None:
        """Loads (6 + n_f,) of the tower at the end of the next step, from the forces of the last two continued."""
        out[:] = 0.0
        if self._tower is None:
            return
        s, points = self._structure, self._middles
        force = (2.0 * self.force[1] - self.force[0]) @ work.rot[s.tower]  # body axes
        q, _ = s.elastic(s.tower, y)
        bend = points.second @ q
        place = points.position + (points.linear + 0.5 * bend) @ q
        out[:3] = force.sum(axis=0)
        out[3:6] = np.cross(place, force).sum(axis=0)
        out[6 : 6 + len(q)] = np.einsum("pi,pik->k", force, points.linear + bend)


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

    Attributes
    ----------
    motion : StructureMotion
        Of the structure, in the form that the fidelity names.
    integrator : HammingIntegrator, NewmarkIntegrator or GeneralizedAlphaIntegrator
        With the state and the inputs of the structure.
    gauges : Gauges
        With the signals of the last step, except those that `Measurement.complete` fills in.
    extremes : Extremes
        Since they were last told to ``restart``.
    scheme : Scheme
        May be exchanged, from one step to the next too.
    basis : DeformedBasis or None
        Of the blades, where it follows their deformation.
    moving : MovingBodies or None
        Closed bodies that follow the structure.
    platform : PlatformLoads or None
        Water and moorings of a floating turbine.
    """

    def __init__(self, models: TurbineModels) -> None:
        self.models = models
        fidelity = models.fidelity
        self.motion: StructureMotion = FORMS[fidelity.formulation](models)
        self.integrator = i = self.motion.integrator
        self.aero = models.lattice.new_state()
        floater = models.turbine.floater
        self.platform = None if floater is None else PlatformLoads(replace(floater, gravity=GRAVITY), models.time_step)
        water = None if self.platform is None else self.platform.arrays
        self.exchange = CouplingData.of(models, i.inputs.body_loads, water)
        self._tower_at_rest = self.exchange.tower.position.copy()
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
        self._state: Array = i.state
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
    def pitch(self) -> Array:
        """Pitch of the blades (n_blades,) [rad], a view."""
        return self._state[self._pitches]

    @cached_property
    def instant(self) -> MeasuredState:
        """What can be measured now: views of the current state, whenever they are read."""
        i = self.integrator
        return MeasuredState(i.state, i.state_rate, i.inputs.body_loads[1], i.work, self.blade_nodes, self.blade_forces)

    @property
    def blade_nodes(self) -> Array:
        """Lattice nodes (n_blades, n_points, 3) [m], a view."""
        return _by_blade(self.exchange.nodes)

    @property
    def blade_forces(self) -> Array:
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
        if self.platform is not None:
            arrays |= {f"platform_{k}": a for k, a in self.platform.state().items()}
            arrays |= {"tower_position": self.exchange.tower.position}
        return arrays

    def set_sea(self, waves: WaveComponents | None) -> None:
        """Let a floating turbine meet these waves from the next start on; None: still water."""
        assert self.platform is not None
        self.platform.set_sea(waves)
        water = self.exchange.water
        assert water is not None
        self.exchange = self.exchange._replace(water=water._replace(platform=self.platform.arrays))
        self._bundles = None

    def float_at_rest(self, y: Array, current: bool = True) -> None:
        """Loads of water, lines and, where wanted, current on a floater at rest in y, into the inputs; no waves."""
        assert self.platform is not None
        s, system = self.models.structure, self.models.structure.system
        assert s.floater is not None
        rotation, q = np.zeros((3, 3)), system.index(s.floater, "joint_q")
        cardan_rotation(y[q + 3 : q + 6], rotation)
        force = self.platform.static_force(y[q : q + 3].copy(), rotation)
        if current and self.platform.arrays.current.any():
            force += self.platform.current_force(rotation)
        self.integrator.inputs.body_loads[:, s.floater, :3] = force[:3] @ rotation
        self.integrator.inputs.body_loads[:, s.floater, 3:6] = force[3:] @ rotation

    @cached_property
    def wave_response(self) -> WaveResponse | None:
        """Harmonic answer of a floater to its sea."""
        return None if self.platform is None else WaveResponse(self.platform)

    def begin_to_float(self, y: Array, radiation: Array | None = None) -> None:
        """Water and lines about a floater in the state y at time zero, and their loads; radiation: memory of the water.

        Raises
        ------
        SimulationError
            When a line has no equilibrium.
        """
        water = self.exchange.water
        if self.platform is None or water is None:
            return
        self.move_lattice(y)
        work, b, loads = self.integrator.work, water.body, self.integrator.inputs.body_loads
        water_kernels.floater_motion(work, water)
        self.platform.restart(work.r[b], work.rot[b], water.velocity, water.spin, radiation)
        self.meet_waves(0.0)
        if water_kernels.floater_loads(work, water, loads[0, b]) != tree_kernels.OK:
            raise SimulationError("a mooring line has no equilibrium at the start")
        loads[1, b] = loads[0, b]

    def meet_waves(self, time: float) -> None:
        """Let the waves that a floater meets be those of a time [s]."""
        assert self.platform is not None
        self._water_motion(self.platform.arrays, time)

    @cached_property
    def _water_motion(self) -> Callable[..., None]:
        assert self.platform is not None
        return cast(Callable[..., None], compiled_for(water_motion, (self.platform.arrays, 0.0)))

    def restart(self) -> None:
        """Forget what runs before have left beyond the arrays that `begin` sets."""
        if self.basis is not None:
            self.basis.restart()
        if self.moving is not None:
            self.moving.restart()
            self.exchange.tower.given[:] = 0.0
        if self.platform is not None:
            self.platform.arrays.line_unknown[:] = 0.0
            self.exchange.tower.position[:] = self._tower_at_rest

    def begin(self, y: Array, radiation: Array | None = None) -> None:
        """Start to move from the state y (n_state,), under the loads that the inputs hold; radiation: of a floater."""
        self.begin_to_float(y, radiation)
        self.exchange.previous_loads[:] = self.integrator.inputs.body_loads[0]
        self.exchange.relaxation[:] = 1.0, 0.0, 0.0
        self.exchange.energy.begin()
        self.begin_motion(y)
        self.wind.earlier_velocities[:] = self.exchange.velocities
        self._monitor.pitch[:] = self.pitch
        m = self.motion.structure.motion
        monitor_kernels.watch(m.state, m.rate, m.inputs.body_loads[1], m.tree, m.work, self.gauges, self._monitor)
        self.extremes.restart()

    def begin_motion(self, y: Array) -> None:
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

    def move_lattice(self, y: Array) -> None:
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

    def take_wind(self, inflow: Inflow, time: float) -> Array:
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
        if self.platform is not None:
            self.meet_waves(time + self._scheme.dt)
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
        if code == coupled_step_kernels.LINE_FAILS:
            return "a mooring line has no equilibrium: the platform is beyond the reach of its lines"
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
        return failure_of_a_step(code, self._scheme.h)

    # ---- compilation -------------------------------------------------------------------------------------------------

    def compiled_step(self) -> Callable[..., int]:
        """The step of structure and air together, for the types of its arguments."""
        return cast(Callable[..., int], compiled_for(coupled_step, (*self.bundle(), self.wind.blades)))

    @classmethod
    def was_compiled(cls) -> bool:
        """Whether the step of any turbine is in the cache of compiled kernels."""
        return bool(was_compiled(end_step))

    def is_compiled(self) -> bool:
        """Whether the step is in the cache for the types of its arguments, which formulations and bodies change."""
        if self.models.lattice.split is None:
            return bool(is_compiled(coupled_step, (*self.bundle(), self.wind.blades)))
        return all(is_compiled(*part) for part in self.parts_without_air())

    def compile(self) -> None:
        """Compile the step for the types of its arguments, or load it."""
        whole = ((coupled_step, (*self.bundle(), self.wind.blades)),)
        for part in whole if self.models.lattice.split is None else self.parts_without_air():
            compiled_for(*part)

    def parts_without_air(self) -> tuple[tuple[Any, tuple[Any, ...]], ...]:
        """Kernels of the step that do without the induction of the wake, with their arguments."""
        air, structure, x, scheme, gauges, monitor = self.bundle()
        return (
            (predict_step, (air, structure, x, scheme)),
            (end_step, (structure, x, scheme, gauges, monitor, air.arrays.forces, self.wind.blades)),
        )


def _by_blade(array: Array) -> Array:
    return array.reshape(len(array), -1, 3)
