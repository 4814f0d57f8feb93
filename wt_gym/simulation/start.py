"""The start of a simulation: turbine, wake and generator in balance with each other."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from wt_gym.base.errors import SimulationError
from wt_gym.base.quantities import Array, Integers
from wt_gym.multibody.arrays import Inputs, MultibodyError, Work
from wt_gym.multibody.integrators.schemes import INTEGRATORS
from wt_gym.multibody.system import MultibodySystem
from wt_gym.simulation.drivetrain.drives import Drives
from wt_gym.simulation.fidelity import Fidelity
from wt_gym.simulation.step import coupling_kernels
from wt_gym.simulation.step.coupling import Coupling
from wt_gym.wind import Inflow

ROUNDING = 1e-6
"""Change of the coordinates, over their size, below which a step that leads no nearer is rounding: nodal coordinates
are 1e9 times as stiff against each other as the blade as a whole."""
SMALLEST_SHARE = 1.0 / 256.0
"""Of a step of Newton's method, below which there is no balance."""


def elastic_equilibrium(
    system: MultibodySystem,
    y: Array,
    inputs: Inputs,
    work: Work,
    free: Sequence[int],
    of_forces: bool = False,
    accelerations: float | Array = 0.0,
    load: Callable[[Array], None] | None = None,
) -> None:
    """Newton's method for elastic coordinates that do not accelerate, or as told; the rotor's own acceleration is free.

    A step is halved until the next one, with the same derivatives, is shorter: where strong loads bend slender blades
    far, whole steps lead away (natural monotonicity, Deuflhard, Newton Methods for Nonlinear Problems, 2004).

    Parameters
    ----------
    system : MultibodySystem
        Without quaternions.
    y : array (n_state,)
        State, of whose coordinates the elastic ones change in place.
    inputs, work : arrays of the system
    free : sequence of int
        Coordinates that move freely and stay where they are, and so their velocities: the rotor's.
    of_forces : bool
        Balance forces, r = f − M_a u̇_a with the columns M_a of the velocities that are free and u̇_a = M_aa⁻¹ f_a,
        instead of accelerations. In nodal coordinates the accelerations of one small turn of a node exceed those of a
        bent blade so far that differences show nothing of these.
    accelerations : float or array (n_u - n_free,)
        That the elastic velocities are to have; with forces 0.
    load : callable, optional
        Brings the inputs up to date that depend on the state (n_state,), as the loads of a floater do.

    Raises
    ------
    SimulationError
        When no balance is found.
    MultibodyError
        When the mass matrix is singular at the start.
    """
    at_rest = [k for k in range(system.n_u) if k not in free]
    q, u = np.array(at_rest, dtype=int), np.array(at_rest, dtype=int) + system.n_q
    if len(q) == 0:
        return
    rest, freely = np.array(at_rest), np.array(free)

    def residual(state: Array) -> Array:
        if load is not None:
            load(state)
        if not of_forces:
            return np.asarray(system.rates(state, inputs, work)[u] - accelerations)
        mass, force = system.balance(state, inputs, work)
        mass = np.tril(mass) + np.tril(mass, -1).T
        moved = np.linalg.solve(mass[np.ix_(freely, freely)], force[freely])
        return np.asarray(force[rest] - mass[np.ix_(rest, freely)] @ moved)

    following: Array | None
    (jacobian, change), fresh = _newton_step(residual, y, q), True
    for _ in range(40):
        if np.abs(change).max() < 1e-9 * max(1.0, np.abs(y[q]).max()):
            y[q] += change
            return
        following = _shortened_step(residual, y, q, change, jacobian, SMALLEST_SHARE if fresh else 1.0)
        if following is None and fresh:
            if np.abs(change).max() < ROUNDING * max(1.0, np.abs(y[q]).max()):
                return
            break
        # nearly linear: the derivatives serve as long as they bring the balance nearer by half
        fresh = following is None or bool(np.linalg.norm(following) > 0.5 * np.linalg.norm(change))
        if following is None or fresh:
            jacobian, following = _newton_step(residual, y, q)
        change = following
    raise SimulationError("the static equilibrium of the structure did not converge under its loads")


def _shortened_step(
    residual: Callable[[Array], Array], y: Array, q: Integers, change: Array, jacobian: Array, smallest: float
) -> Array | None:
    """Take a step, or the largest half, quarter, … of it after which the next one is shorter.

    Returns
    -------
    array or None
        The next step, with the same derivatives; None, and y as it was, if a share below ``smallest`` was needed.
    """
    origin, share = y[q].copy(), 1.0
    while share >= smallest:
        y[q] = origin + share * change
        try:
            following = np.asarray(np.linalg.solve(jacobian, -residual(y)), dtype=np.float64)
        except MultibodyError:  # the structure has left its model
            following = None
        if following is not None and np.linalg.norm(following) < (1.0 - 0.25 * share) * np.linalg.norm(change):
            return following
        share *= 0.5
    y[q] = origin
    return None


def _newton_step(residual: Callable[[Array], Array], y: Array, q: Integers, step: float = 1e-4) -> tuple[Array, Array]:
    """Derivatives of the residual by the coordinates q, and the step that follows from them."""
    here, columns = residual(y), []
    for place in q:
        origin = y[place]
        y[place] = origin + step
        columns.append((residual(y) - here) / step)
        y[place] = origin
    jacobian = np.array(columns).T
    return jacobian, np.asarray(np.linalg.solve(jacobian, -here), dtype=np.float64)


def rigid_body(
    system: MultibodySystem, y: Array, inputs: Inputs, work: Work, places: Integers, load: Callable[[Array], None],
    step: float = 1e-3,
) -> tuple[Array, Array]:  # fmt: skip
    """Mass and stiffness (6, 6) of turbine and floater as one rigid body about a balance.

    Parameters
    ----------
    system : MultibodySystem
    y : array (n_state,)
        State of the balance.
    inputs, work : arrays of the system
    places : array of int (6,)
        Coordinates of the floater.
    load : callable
        Brings the loads of the floater up to date for a state.
    step : float
        Displacement for the differences [m, rad].
    """

    def force(state: Array) -> tuple[Array, Array]:
        load(state)
        mass, forces = system.balance(state, inputs, work)
        return mass[np.ix_(places, places)].copy(), forces[places].copy()

    columns = []
    for place in places:
        up, down = y.copy(), y.copy()
        up[place], down[place] = up[place] + step, down[place] - step
        columns.append((force(down)[1] - force(up)[1]) / (2.0 * step))
    mass = force(y)[0]
    return np.tril(mass) + np.tril(mass, -1).T, np.array(columns).T


PASSES = 3
"""Passes between wake and elastic deformation."""


class Starter:
    """Puts a coupled turbine into a steady state.

    A turbine with constraint equations is balanced without them, and takes over the motion.
    """

    def __init__(self, coupling: Coupling, drives: Drives) -> None:
        self.coupling, self.drives = coupling, drives
        embedded = coupling.models.embedded
        self._balanced = coupling if embedded is None else Coupling(embedded)

    def balance(
        self,
        rotor_speed: float,
        azimuth: float,
        generator_torque: float | None,
        inflow: Inflow,
        tower_top: Array | None = None,
        wake_thrust: float | None = None,
        motion: Array | None = None,
        platform: Array | None = None,
    ) -> None:
        """Balance turbine, wake and air, and begin to move; pitch and yaw are those that the drives have started with.

        Parameters
        ----------
        rotor_speed, azimuth : float
            [rad/s], [rad].
        generator_torque : float or None
            High-speed shaft [N m]; None: what balances the torque of the air.
        tower_top : array (4,), optional
            Displacement of the tower top along and across the heading of the nacelle [m] and its rates [m/s]; by
            default the balance, at rest, as on any floater.
        wake_thrust : float, optional
            Mean thrust in the time before, to which the wake belongs [N]; by default that of the balance.
        motion : array (n,), optional
            Of the structure (`TurbineStructure.motion`): it continues with its velocities and accelerations, deformed
            as the loads of the start make it.
        platform : array (12,), optional
            Slow motion of a floater: displacement and its rates [m, rad; m/s, rad/s], by default the balance at rest.
            The motion by the waves of time zero is added to it.

        Raises
        ------
        SimulationError, MultibodyError, AerodynamicsError
            When there is no balance.
        """
        coupling, balanced = self.coupling, self._balanced
        for array in (*balanced.integrator.inputs, *coupling.integrator.inputs):
            array[:] = 0.0
        for each in {balanced, coupling}:
            each.restart()
        balanced.aero.clear()  # the tower stands in what the last wake slowed
        y, radiation = self._rigid_state(rotor_speed, azimuth), None
        if motion is not None:
            accelerations = balanced.models.structure.move(y, motion, self.drives.command[1])
            self._find_equilibrium(y, rotor_speed, generator_torque, inflow, wake_thrust, accelerations)
        else:
            self._find_equilibrium(y, rotor_speed, generator_torque, inflow, wake_thrust)
            self._turn_loads(y, rotor_speed, azimuth)
            if tower_top is not None and balanced.platform is None:
                self._sway(y, tower_top)
            radiation = self._float(y, platform)
        if balanced is not coupling:
            y = coupling.models.structure.adopt(balanced.models.structure, y)
            coupling.aero.assign(balanced.aero)
            coupling.integrator.inputs.body_loads[:] = balanced.integrator.inputs.body_loads
            self._act(coupling)
        coupling.begin(y, radiation)

    def _act(self, coupling: Coupling) -> None:
        self.drives.act(coupling.integrator.inputs, coupling.models.structure.azimuth_u, first=0)

    def _rigid_state(self, rotor_speed: float, azimuth: float) -> Array:
        """Undeformed turbine turning steadily."""
        s = self._balanced.models.structure
        y: Array = s.system.initial_state()
        n_y = s.system.n_q + s.system.n_u
        y[s.azimuth_q], y[s.system.n_q + s.azimuth_u] = azimuth, rotor_speed
        y[n_y : n_y + s.system.n_servo] = self.drives.command[1:]
        return y

    def _turn_loads(self, y: Array, rotor_speed: float, azimuth: float) -> None:
        """Rates of the blades (y, in place) as their balance turns with the rotor past weight, shear and yawed wind.

        Each elastic coordinate has its balance at as many azimuths as there are blades. Its mean and the first harmonic
        that run through them, q = a + b cos ψ + c sin ψ, give the rate Ω (c cos ψ − b sin ψ) of a blade that follows
        slowly changing loads. Without it blades start at rest amid the swing of their weight and ring edgewise for a
        minute. Two blades do not tell three coefficients apart; theirs start at rest.
        """
        s, n = self._balanced.models.structure, self._balanced.models.turbine.n_blades
        if n < 3:
            return
        psi = azimuth + 2.0 * np.pi * np.arange(n) / n
        harmonics = np.column_stack([np.ones(n), np.cos(psi), np.sin(psi)])
        rates = rotor_speed * np.column_stack([np.zeros(n), -np.sin(psi), np.cos(psi)])
        slope = rates @ np.linalg.pinv(harmonics)
        for bodies in zip(*s.parts, strict=True):
            q, u = zip(*(s.elastic(body, y) for body in bodies), strict=True)
            for own, rate in zip(u, slope @ np.array(q), strict=True):
                own[:] = rate

    def _float(self, y: Array, platform: Array | None) -> Array | None:
        """Motion of a floater (y, in place) amid its waves; returns the memory of the water.

        To the balance, or a slow motion in its place, the harmonic answer to the waves of time zero is added. A slow
        motion is one without current: a current moves it as far as it moves the balance. The elastic coordinates then
        balance the loads of this instant, the floater moving freely.
        """
        c = self._balanced
        s, response, b = c.models.structure, c.wave_response, c.models.structure.floater
        if response is None or b is None:
            return None
        system, q = s.system, s.system.index(b, "joint_q")
        places = q + np.arange(6)
        amid = response.start(*rigid_body(system, y, c.integrator.inputs, c.integrator.work, places, c.float_at_rest))
        if platform is None and not np.any(amid.displacement):
            return None
        if platform is not None:
            y[places] += platform[:6] - self._still(y)[places]
            y[system.n_q + places] = platform[6:]
        y[places] += amid.displacement
        y[system.n_q + places] += amid.velocity
        c.begin_to_float(y, amid.radiation)
        elastic_equilibrium(system, y, c.integrator.inputs, c.integrator.work, (s.azimuth_u, *places.tolist()),
                            _balances_forces(c.models.fidelity))  # fmt: skip
        return amid.radiation

    def wave_motion(self, time: float) -> Array:
        """Motion of a floater by the waves (12,) at a time after the start [s], as the start adds it at time zero."""
        response = self._balanced.wave_response
        assert response is not None
        return response.platform(time)

    def _still(self, y: Array) -> Array:
        """Return the state in which a floater that rests in a current would rest without it; in still water y."""
        c, rest = self._balanced, y.copy()
        if c.platform is not None and c.platform.arrays.current.any():
            elastic_equilibrium(c.models.structure.system, rest, c.integrator.inputs, c.integrator.work,
                                (c.models.structure.azimuth_u,), _balances_forces(c.models.fidelity), 0.0,
                                partial(c.float_at_rest, current=False))  # fmt: skip
        return rest

    def _sway(self, y: Array, tower_top: Array) -> None:
        """Displacement and motion of the tower top (y, in place) in its first modes."""
        c = self._balanced
        s, yaw = c.models.structure, self.drives.command[1]
        cos, sin = np.cos(yaw), np.sin(yaw)
        turn = np.array([[cos, -sin], [sin, cos]])  # from the heading to axes of the base
        c.move_lattice(y)
        moved = turn @ tower_top[:2] - s.tower_deflection(c.integrator.work)[0]
        q, u = s.elastic(s.tower, y)
        q += s.tower_sway @ moved
        u += s.tower_sway @ (turn @ tower_top[2:])

    def _find_equilibrium(
        self,
        y: Array,
        rotor_speed: float,
        generator_torque: float | None,
        inflow: Inflow,
        wake_thrust: float | None,
        accelerations: float | Array = 0.0,
    ) -> None:
        """Wake, loads and elastic state (y, in place) in balance with each other and the generator.

        Balance means the given accelerations: a motion that continues in another wind is not jolted by it.
        """
        c = self._balanced
        s, induced = c.models.structure, None
        for k in range(PASSES):
            last = k == PASSES - 1
            induced = self._balance_air(y, rotor_speed, generator_torque, inflow, induced, last, wake_thrust)
            elastic_equilibrium(s.system, y, c.integrator.inputs, c.integrator.work, (s.azimuth_u,),
                                _balances_forces(c.models.fidelity), accelerations,
                                None if c.platform is None else c.float_at_rest)  # fmt: skip

    def _balance_air(
        self,
        y: Array,
        rotor_speed: float,
        generator_torque: float | None,
        inflow: Inflow,
        induced: float | None,
        last: bool,
        wake_thrust: float | None,
    ) -> float:
        """Wake and loads for a state of the structure, and the generator under them; returns what the wake induces."""
        c = self._balanced
        s, lattice, x = c.models.structure, c.models.lattice, c.exchange
        inputs, work = c.integrator.inputs, c.integrator.work
        c.move_lattice(y)
        axis = work.rot[s.hub, :, 0].copy()
        wind = c.take_wind(inflow, 0.0)
        induced = lattice.initialize_helix(
            c.aero, x.nodes, x.velocities, wind, work.r[s.hub], axis, rotor_speed, c.models.time_step,
            passes=4 if induced is None else 1, induced=induced, accept=last, wake_thrust=wake_thrust,
        )  # fmt: skip
        loads = inputs.body_loads[1]
        coupling_kernels.rotor_loads(
            c.blade_forces, work.rot, x.elastic, x.points, x.lattice_bodies, x.sub_bodies, loads
        )
        coupling_kernels.tower_drag(y, s.system.tree, work, x.tower, loads[s.tower])
        inputs.body_loads[0] = loads
        _, moment = coupling_kernels.rotor_resultant(c.blade_nodes, c.blade_forces, work.r[s.hub], axis)
        self.drives.load(moment, rotor_speed, generator_torque)
        self._act(c)
        return induced


def _balances_forces(fidelity: Fidelity) -> bool:
    """Whether forces are balanced: accelerations of light nodes would dominate the residual of a bent beam."""
    nodal = "nodal" in (fidelity.blade_coordinates, fidelity.tower_coordinates)
    return nodal or not INTEGRATORS[fidelity.integrator].explicit
