"""The coupled simulator: flexible multibody turbine and free-wake vortex lattice marched together in time."""

import math
import numbers
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from wt_gym.aerodynamics import TowerFlow, VortexLattice
from wt_gym.aerodynamics.errors import AerodynamicsError
from wt_gym.compiled import compiled_for
from wt_gym.errors import ActionError, SimulationError
from wt_gym.multibody.checks import check_state
from wt_gym.multibody.errors import failure_of_a_step
from wt_gym.multibody.system import HammingIntegrator, MultibodyError
from wt_gym.multibody.tree import point_kernels, tree_kernels
from wt_gym.simulation import coupled_step_kernels, coupling_kernels
from wt_gym.simulation.blade_lattice import blade_planform
from wt_gym.simulation.channels import Signals
from wt_gym.simulation.equilibrium import elastic_equilibrium, highest_frequency
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.simulation.measurement import Measurement
from wt_gym.simulation.state import SimulatorState, fingerprint
from wt_gym.simulation.turbine_bodies import place_nacelle, turbine_bodies
from wt_gym.simulation.turbine_structure import build_structure
from wt_gym.turbines import Turbine, load_turbine

__all__ = ["Simulator"]

MAX_DEFLECTION = 0.4
"""Elastic tip displacement, in blade lengths, beyond which a linear elastic blade has lost its meaning."""
FULL_TORQUE_SPEED = 0.05
"""Speed, in rated speeds, below which the available torque falls to zero: a generator brakes, it never drives."""
MAX_OVERSPEED = 3.0
"""Rotor speed, in rated speeds, at which a simulation is given up."""
BOTH_ENDS = slice(2)


class Exchange(NamedTuple):
    """What passes between structure and air, and the limits of the model, as arrays for the compiled step."""

    nodes: np.ndarray  # (n_blades, n_chord + 1, n_span + 1, 3) lattice nodes [m]
    velocities: np.ndarray  # the same [m/s]
    points: tuple  # Points of the lattice on a blade
    blades: np.ndarray  # (n_blades,) bodies
    elastic_q: np.ndarray  # (n_blades, n_f) where a blade's coordinates are in the state
    elastic_u: np.ndarray  # (n_blades, n_f) and their rates
    elastic: np.ndarray  # (n_blades, n_f)
    elastic_rate: np.ndarray  # (n_blades, n_f)
    previous_loads: np.ndarray  # (n_b, 6 + n_f) of the bodies, one step ago
    passes: np.ndarray  # (2, n_b, 6 + n_f) loads under which the blades moved, and their last change
    tip: np.ndarray  # (3, n_f) displacement of a tip
    speed_index: int
    max_speed: float  # [rad/s]
    max_deflection: float  # [m]


class Simulator:
    """A wind turbine in the wind.

    Parameters
    ----------
    turbine : str, path or Turbine
        Name in the catalogue, path of a windIO v2 file, or a turbine.
    inflow : Inflow
        Undisturbed wind.
    fidelity : str or Fidelity
        "training", "engineering", "reference" or one of your own.
    threads : int
        Threads that share the velocities of the wake; worth it at "reference". The numbers do not depend on it.

    Attributes
    ----------
    time_step : float
        Aerodynamic step [s]; ``advance`` takes whole numbers of it.
    structure : TurbineStructure
    lattice : VortexLattice

    Examples
    --------
    >>> from wt_gym.wind import SteadyInflow
    >>> sim = Simulator("nrel_5mw", inflow=SteadyInflow(8.0))
    >>> signals = sim.reset(rotor_speed=0.96)
    >>> signals = sim.advance(0.2, pitch=(0.0, 0.0, 0.0), yaw_rate=0.0, generator_torque=19.3e3)
    """

    def __init__(self, turbine="nrel_5mw", inflow=None, fidelity="training", threads=1):
        if inflow is None:
            raise SimulationError("Simulator needs an inflow, for example wt_gym.wind.SteadyInflow(8.0)")
        self.turbine = turbine if isinstance(turbine, Turbine) else load_turbine(turbine)
        self.inflow, self.fidelity, self._threads = inflow, fidelity_of(fidelity), threads
        self.time_step = self.fidelity.step_for(self.turbine.drivetrain.rated_rotor_speed)
        self._model = fingerprint(self.turbine, self.fidelity)
        self._build_models()
        self._allocate()
        self._started = False

    # ---- construction ----

    def _build_models(self):
        """Everything that depends only on the meshes."""
        turbine, fid = self.turbine, self.fidelity
        planform = blade_planform(turbine, fid.aero)
        self.structure = build_structure(turbine, fid, planform.nodes)
        tower, base = turbine.tower, np.array([0.0, 0.0, turbine.tower.base_height])
        self.tower_flow = TowerFlow(base, tower.diameter_station, tower.diameter)
        bodies = turbine_bodies(turbine, fid, planform.nodes)
        self.lattice = VortexLattice(planform, turbine.n_blades, fid.aero, turbine.air_density, bodies, self._threads)
        if fid.formulation == "embedded":
            self._embedded = None
            self._n_sub = fid.substeps_for(self.time_step, highest_frequency(self.structure.system))
        else:
            # constraint equations leave the motion, and so its frequencies and its steady state, as they are
            self._embedded = Simulator(turbine, self.inflow, replace(fid, formulation="embedded"))
            self._n_sub = self._embedded._n_sub
        self._h = self.time_step / self._n_sub
        self._integrator = HammingIntegrator(self.structure.system, self._h, fid.corrections, fid.starter)

    def _allocate(self):
        """Arrays of the state and of the exchange between structure and air."""
        n = self.turbine.n_blades
        self._aero = self.lattice.new_state()
        system, shape = self.structure.system, self.lattice.nodes_shape
        points = self.structure.lattice_points
        each = np.arange(points.linear.shape[2])
        q = np.add.outer([system.index(blade, "elastic_q") for blade in self.structure.blades], each)
        u = np.add.outer([system.index(blade, "elastic_u") for blade in self.structure.blades], each) + system.n_q
        self._exchange = Exchange(
            nodes=np.zeros(shape), velocities=np.zeros(shape), points=points, blades=np.array(self.structure.blades),
            elastic_q=q, elastic_u=u, elastic=np.zeros(q.shape), elastic_rate=np.zeros(q.shape),
            previous_loads=np.zeros_like(self._integrator.inputs.body_loads[0]),
            passes=np.zeros_like(self._integrator.inputs.body_loads),
            tip=np.ascontiguousarray(self.structure.tip_points.linear[0]),
            speed_index=system.n_q + self.structure.azimuth_u,
            max_speed=MAX_OVERSPEED * self.turbine.drivetrain.rated_rotor_speed,
            max_deflection=MAX_DEFLECTION * self.turbine.blade.length,
        )  # fmt: skip
        self._flat = (n, shape[1] * shape[2], 3)
        self._earlier_velocities = np.zeros(shape)
        self._saved = type(self._integrator.history)(*(np.zeros_like(x) for x in self._integrator.history))
        self._command = np.zeros(n + 2)  # generator torque, yaw, pitch of each blade
        self._measurement = Measurement(self.turbine, self.structure)
        self._values = self._measurement.values
        self._n_steps = 0
        self._coupled_step = None  # compiled for the types of this simulator

    def __getstate__(self):
        """What a copy or a pickle takes along: all but the compiled form."""
        return self.__dict__ | {"_coupled_step": None}

    # ---- the public run ----

    @property
    def time(self):
        """Simulated time [s]."""
        return self._n_steps * self.time_step

    @property
    def signals(self):
        """Signals at the current time, a fresh copy."""
        self._require_start()
        return Signals(self._values.copy(), self.turbine.n_blades)

    def reset(self, rotor_speed, pitch=0.0, azimuth=0.0, yaw=0.0, generator_torque=None):
        """Start at time zero near a steady state: developed wake, deflected structure.

        Parameters
        ----------
        rotor_speed : float
            [rad/s], not negative.
        pitch : float or array (n_blades,)
            [rad].
        azimuth : float
            Of blade 1 [rad].
        yaw : float
            Nacelle yaw [rad].
        generator_torque : float, optional
            High-speed shaft [N m]; by default what balances the torque of the air.

        Returns
        -------
        Signals

        Raises
        ------
        ActionError
            For values that are not finite or out of range.
        SimulationError
            When no steady state is found, for example because the wind bends the blades beyond the elastic model.
        """
        pitch = self._pitch_vector(pitch)
        self._check_finite(rotor_speed=rotor_speed, azimuth=azimuth, yaw=yaw)
        limit = MAX_OVERSPEED * self.turbine.drivetrain.rated_rotor_speed
        if not 0.0 <= rotor_speed < limit:
            raise ActionError(f"rotor_speed is {rotor_speed} rad/s; allowed: 0 … {limit:.3f} rad/s")
        self._check_pitch_range(pitch)
        if generator_torque is not None:
            self._check_finite(generator_torque=generator_torque)
            self._check_torque(generator_torque)
        self._n_steps, self._started = 0, False
        self._aero.clear()  # the tower stands in what the last wake slowed
        start = self._start_steadily if self._embedded is None else self._start_from_embedded
        try:
            start(rotor_speed, pitch, azimuth, yaw, generator_torque)
        except (MultibodyError, AerodynamicsError) as error:
            raise SimulationError(f"no start at {rotor_speed} rad/s in {self.inflow.description}: {error}") from error
        self._started = True
        self._move_lattice(self._integrator.state)
        self._earlier_velocities[:] = self._exchange.velocities
        self._measure()
        return self.signals

    def advance(self, duration, pitch, yaw_rate=0.0, generator_torque=0.0):
        """Simulate for a while with constant demands; the drives follow them within their limits.

        Parameters
        ----------
        duration : float
            A whole number of time steps [s].
        pitch : float or array (n_blades,)
            Demanded pitch [rad]; followed at no more than the pitch rate limit, within the pitch range.
        yaw_rate : float
            Demanded yaw rate [rad/s], limited to the yaw drive's rate.
        generator_torque : float
            Demanded torque on the high-speed shaft [N m]; rate-limited and kept between 0 and the generator's maximum,
            which falls to zero as the rotor stops.

        Returns
        -------
        Signals
            At the end.

        Raises
        ------
        ActionError
            For demands that are not finite or a duration that is no multiple of the time step.
        SimulationError
            When the simulation diverges; the simulator must then be reset.
        """
        self._require_start()
        pitch = self._pitch_vector(pitch)
        self._check_finite(duration=duration, yaw_rate=yaw_rate, generator_torque=generator_torque)
        n = round(duration / self.time_step)
        if n < 1 or abs(n * self.time_step - duration) > 1e-6 * self.time_step:
            raise ActionError(f"duration {duration} s is not a whole number of time steps of {self.time_step} s")
        for _ in range(n):
            self._move_commands(pitch, yaw_rate, generator_torque)
            try:
                self._step()
            except (SimulationError, AerodynamicsError) as error:
                self._started = False
                raise SimulationError(f"simulation failed at {self.time:.3f} s: {error}") from error
        self._measure()
        return self.signals

    # ---- snapshots and pictures ----

    def state(self):
        """Snapshot from which the simulation continues bit for bit.

        Returns
        -------
        SimulatorState
        """
        self._require_start()
        return SimulatorState.take(self._state_arrays(), self._n_steps, self._model)

    def restore(self, state):
        """Continue from a snapshot of a simulator with the same turbine and fidelity.

        Raises
        ------
        SimulationError
            When the snapshot does not fit, or its motion has no meaning.
        """
        self._started = False
        state.put(self._state_arrays(), self._model)
        try:
            check_state(self.structure.system, self._integrator.state)
        except MultibodyError as error:
            raise SimulationError(f"the snapshot holds no state: {error}") from error
        self._n_steps = state.n_steps
        self._started = True
        self._move_lattice(self._integrator.state)
        self._place_bodies()

    def _state_arrays(self):
        """Every array that carries state, by name."""
        arrays = {f"history_{k}": a for k, a in self._integrator.history._asdict().items()}
        arrays |= {f"inputs_{k}": a for k, a in self._integrator.inputs._asdict().items()}
        arrays |= {f"aero_{k}": a for k, a in self._aero.arrays._asdict().items()}
        arrays |= {"previous_loads": self._exchange.previous_loads, "command": self._command, "values": self._values}
        arrays |= {"nodes": self._exchange.nodes, "velocities": self._exchange.velocities}
        arrays |= {"earlier_velocities": self._earlier_velocities}
        return arrays

    def linearize(self, operating_point=None, **options):
        """Linear model about a steady operating point; see :func:`wt_gym.simulation.linearization.linearize`.

        Returns
        -------
        LinearModel
            A, B, C, D with named states, inputs and outputs.
        """
        from wt_gym.simulation.linearization import linearize  # it builds on simulators

        return linearize(self, operating_point, **options)

    def geometry(self):
        """Shapes for pictures, global coordinates [m].

        Returns
        -------
        dict
            "blades" (n_blades, n_chord + 1, n_span + 1, 3) ring nodes; "wake" (n_rows + 1, n_blades, n_span + 1, 3);
            "wake_circulation" (n_rows, n_blades, n_span) [m²/s]; "tower" (n, 3) axis and "tower_radius" (n,);
            "hub" (3,); "nacelle" (2, 3) ends of the shaft.
        """
        self._require_start()
        s, work = self.structure, self._integrator.work
        y = self._integrator.state
        self._move_lattice(y)
        tower, velocity = np.zeros_like(s.tower_points.position), np.zeros_like(s.tower_points.position)
        q, rate = s.elastic(s.tower, y)
        frame = work.rot[s.tower], work.r[s.tower], work.v[s.tower], work.omega[s.tower]
        point_kernels.point_motion(*frame, q, rate, s.tower_points, tower, velocity)
        return {
            "blades": self._exchange.nodes.copy(),
            "wake": self._aero.wake_nodes.copy(),
            "wake_circulation": self._aero.wake_circulation.copy(),
            "tower": tower,
            "tower_radius": s.tower_radius.copy(),
            "hub": work.r[s.hub].copy(),
            "nacelle": np.array([work.r[s.hub], work.r[s.generator]]),
        }

    # ---- commands ----

    def _require_start(self):
        if not self._started:
            raise SimulationError("the simulator is not running: call reset() first, also after a failed simulation")

    def _pitch_vector(self, pitch):
        n = self.turbine.n_blades
        try:
            vector = np.asarray(pitch, dtype=float)
        except (TypeError, ValueError):
            raise ActionError(f"pitch is {pitch!r}; one angle or {n} angles [rad] are needed") from None
        if vector.shape not in ((), (n,)):
            raise ActionError(f"pitch has shape {vector.shape}; allowed: one angle or {n} angles [rad]")
        if not np.all(np.isfinite(vector)):
            raise ActionError(f"pitch {pitch!r} is not finite")
        if np.abs(vector).max() > np.pi:
            raise ActionError(f"pitch {pitch!r} is beyond ±π rad; are these degrees?")
        return np.broadcast_to(vector, (n,)).copy()

    @staticmethod
    def _check_finite(**values):
        for name, value in values.items():
            if not isinstance(value, numbers.Real) or not math.isfinite(value):
                raise ActionError(f"{name} is {value!r}; a finite number is needed")

    def _check_pitch_range(self, pitch):
        low, high = self.turbine.pitch.min_pitch, self.turbine.pitch.max_pitch
        if pitch.min() < low - 0.1 or pitch.max() > high + 0.1:
            raise ActionError(f"pitch {pitch} rad at the start; allowed: {low:.3f} … {high:.3f} rad (± 0.1)")

    def _check_torque(self, torque):
        limit = self.turbine.drivetrain.max_generator_torque
        if not 0.0 <= torque <= limit:
            raise ActionError(f"generator_torque is {torque} N m; allowed: 0 … {limit} N m")

    def _move_commands(self, pitch, yaw_rate, torque):
        """Demands after one time step, within the rates and ranges of the drives."""
        dt, drive, limits, c = self.time_step, self.turbine.drivetrain, self.turbine.pitch, self._command
        reach = drive.max_torque_rate * dt
        turning = self._integrator.state[self.structure.system.n_q + self.structure.azimuth_u] / drive.rated_rotor_speed
        strongest = drive.max_generator_torque * min(max(turning / FULL_TORQUE_SPEED, 0.0), 1.0)
        c[0] = min(max(torque, c[0] - reach, 0.0), c[0] + reach, strongest)
        fastest = self.turbine.nacelle.max_yaw_rate
        c[1] += dt * min(max(yaw_rate, -fastest), fastest)
        reach = limits.max_rate * dt
        for i in range(len(pitch)):
            wanted = min(max(pitch[i], limits.min_pitch), limits.max_pitch)
            c[2 + i] += min(max(wanted - c[2 + i], -reach), reach)

    def _set_inputs(self, end):
        """Commands into the inputs at the start (0), the end (1) or both ends of the step."""
        inputs, drive = self._integrator.inputs, self.turbine.drivetrain
        shaft = self._command[0] * drive.gear_ratio / drive.gearbox_efficiency
        inputs.dof_force[end, self.structure.azimuth_u] = -shaft
        inputs.servo_command[end] = self._command[1:]

    # ---- the coupled step ----

    def _step(self):
        """One aerodynamic step: wake, then structure and loads iterated to agreement at its end."""
        integrator, x = self._integrator, self._exchange
        dt, time = self.time_step, self.time
        self._set_inputs(1)
        self.lattice.take_wind(self._aero, self.inflow, time)
        # Where the blades will be, by Adams-Bashforth: 5 cm from where they come to be, less than the wind resolves.
        ahead = x.nodes + dt * (1.5 * x.velocities - 0.5 * self._earlier_velocities)
        blade_wind = self._wind_at_blades(ahead, time + dt)
        self._earlier_velocities[:] = x.velocities
        code = self._advance_compiled(blade_wind)
        if code != tree_kernels.OK:
            raise SimulationError(self._failure(code))
        for array in integrator.inputs:
            array[0] = array[1]
        self._n_steps += 1

    def _advance_compiled(self, blade_wind):
        """One compiled call; or several with the induction of a big wake between them."""
        ck, lattice, x, i, fid = coupled_step_kernels, self.lattice, self._exchange, self._integrator, self.fidelity
        air = lattice.arrays, lattice.constants, self._aero.arrays, lattice.work
        tree, fixed = self.structure.system.tree, self.structure.system.constrained
        body = i.history, self._saved, i.inputs, tree, i.work
        steps = self.time_step, self._h, self._n_sub, i.n_corrections, fid.coupling_iterations
        if lattice.split is None:
            arguments = (*air, x, *body, blade_wind, *steps, fid.coupling_tolerance, fixed, *lattice.body_arrays)
            if lattice.bodies:  # placed anew now and then
                return ck.coupled_step(*arguments)
            if self._coupled_step is None:
                self._coupled_step = compiled_for(ck.coupled_step, arguments)
            return self._coupled_step(*arguments)
        code = ck.predict_step(*air[1:3], x, *body, *steps, fixed)
        if code == tree_kernels.OK:
            lattice.prepare(self._aero, x.nodes)
            code = ck.correct_step(*air, x, *body, blade_wind, *steps, fid.coupling_tolerance, fixed)
        if code == tree_kernels.OK:
            lattice.accept(self._aero)
            code = ck.end_step(x, i.history, i.inputs, tree, i.work, fixed)
        return code

    def _failure(self, code):
        """What a code of the compiled step says."""
        y, x = self._integrator.history.y[3], self._exchange
        if code == coupled_step_kernels.OVERSPEED:
            return f"rotor speed {y[x.speed_index]:.2f} rad/s is beyond {x.max_speed:.2f} rad/s"
        if code == coupled_step_kernels.DEFLECTION:
            largest = np.linalg.norm(np.einsum("ck,bk->bc", x.tip, y[x.elastic_q]), axis=1).max()
            return f"tip deflection {largest:.1f} m is beyond the elastic model ({x.max_deflection:.1f} m)"
        if code == coupled_step_kernels.UNSETTLED:
            return f"circulation and polars of the blades disagree by {self._aero.residual:.3g} m/s"
        return failure_of_a_step(code, self._h)

    def _move_lattice(self, y):
        """Lattice nodes and their velocities for the state y; the kinematics are then up to date."""
        coupled_step_kernels.move_lattice(y, self.structure.system.tree, self._integrator.work, self._exchange)

    def _wind(self, points, time):
        """Undisturbed wind at points, refused where it is not finite."""
        wind = np.ascontiguousarray(self.inflow.velocity(points, time), dtype=np.float64)
        if not math.isfinite(wind.sum()):
            raise SimulationError(f"the inflow is not finite at time {time} s")
        return wind

    def _wind_at_blades(self, nodes, time):
        """Undisturbed wind at the lattice nodes, with the blocking of the tower."""
        wind = self._wind(nodes, time)
        if self.lattice.bodies:
            self._place_bodies()
            self.lattice.body_wind[:] = self._wind(self.lattice.bodies.control_points, time)
        if self.fidelity.tower_shadow and self.fidelity.tower_body is None:
            # The tower stands in a wind that the rotor has slowed; the undisturbed one would double its effect.
            slowed = self._aero.arrays.wake_flow.mean(axis=1)
            wind = wind + slowed
            self.tower_flow.add(nodes, wind, self._integrator.work.r[self.structure.nacelle])
            wind -= slowed
        return wind

    def _place_bodies(self):
        """The nacelle's body where the nacelle is, as far as the kinematics are up to date."""
        work, nacelle = self._integrator.work, self.structure.nacelle
        place_nacelle(self.lattice.bodies, work.rot[nacelle], work.omega[nacelle])

    # ---- start ----

    def _start_steadily(self, rotor_speed, pitch, azimuth, yaw, generator_torque):
        """Balance air and structure."""
        for array in self._integrator.inputs:
            array[:] = 0.0
        y = self._rigid_state(rotor_speed, pitch, azimuth, yaw)
        self._find_equilibrium(y, rotor_speed, generator_torque)
        self._exchange.previous_loads[:] = self._integrator.inputs.body_loads[0]
        self._integrator.start(y)

    def _start_from_embedded(self, rotor_speed, pitch, azimuth, yaw, generator_torque):
        """Balance the turbine in the embedded form and take over its motion."""
        embedded = self._embedded
        embedded.inflow = self.inflow
        embedded.reset(rotor_speed, pitch, azimuth, yaw, generator_torque)
        self._aero.assign(embedded._aero)
        self._command[:] = embedded._command
        self._integrator.inputs.body_loads[:] = embedded._integrator.inputs.body_loads
        self._set_inputs(BOTH_ENDS)
        self._exchange.previous_loads[:] = embedded._exchange.previous_loads
        self._integrator.start(self.structure.adopt(embedded.structure, embedded._integrator.state))

    def _rigid_state(self, rotor_speed, pitch, azimuth, yaw):
        """Undeformed turbine turning steadily."""
        system, s = self.structure.system, self.structure
        y = system.initial_state()
        y[s.azimuth_q] = azimuth
        y[system.n_q + s.azimuth_u] = rotor_speed
        n_y = system.n_q + system.n_u
        y[n_y] = yaw
        y[n_y + 1 : n_y + 1 + len(pitch)] = pitch
        self._command[1], self._command[2:] = yaw, pitch
        return y

    def _find_equilibrium(self, y, rotor_speed, generator_torque, passes=3):
        """Wake, loads and elastic state (y, in place) in balance with each other and the generator."""
        s, inputs, drive = self.structure, self._integrator.inputs, self.turbine.drivetrain
        work, x = self._integrator.work, self._exchange
        for _ in range(passes):
            self._move_lattice(y)
            axis = work.rot[s.hub, :, 0].copy()
            wind = self._wind_at_blades(x.nodes, 0.0)
            self.lattice.initialise_helix(
                self._aero, x.nodes, x.velocities, wind, work.r[s.hub], axis, rotor_speed, self.time_step
            )
            forces = self._aero.nodal_forces.reshape(self._flat)
            coupling_kernels.rotor_loads(forces, work.rot, x.elastic, x.points, x.blades, inputs.body_loads[1])
            inputs.body_loads[0] = inputs.body_loads[1]
            torque = generator_torque
            if torque is None:
                _, moment = coupling_kernels.rotor_resultant(x.nodes.reshape(self._flat), forces, work.r[s.hub], axis)
                torque = min(max(moment / drive.gear_ratio, 0.0), drive.max_generator_torque)
            self._command[0] = torque
            self._set_inputs(BOTH_ENDS)
            elastic_equilibrium(s.system, y, inputs, work, s.azimuth_q, s.azimuth_u)

    # ---- measurement ----

    def _measure(self):
        """Fill the channel values from the current state."""
        integrator = self._integrator
        self._measurement.take(
            self.time, integrator.state, integrator.state_rate, integrator.inputs.body_loads[1], integrator.work,
            self._exchange.nodes.reshape(self._flat), self._aero.nodal_forces.reshape(self._flat), self._command,
            self.inflow,
        )  # fmt: skip
