"""Linear models of the coupled turbine about a steady operating point.

Trim. A rotor that turns in gravity, tilt or shear moves periodically. The operating point is the motion that is steady
in multi-blade coordinates: tower and shaft stand still, the elastic coordinates of blade i are
q₀ + q_c cos ψ_i + q_s sin ψ_i, and the equations of motion hold in the mean over the azimuth when weighted with
1, cos ψ_i and sin ψ_i. Harmonics above once per revolution are left out of the operating point; the coefficients of the
equations keep their dependence on the azimuth. The generator turns at constant speed; the torque that holds it in the
mean is found, unless a torque is given.

Air. Behind each azimuth stands the helical wake in momentum balance with the rotor, and the velocity that it induces at
the blades is frozen, as is the influence of the bound rings on each other; a change of azimuth carries both with it.
Small motions change the boundary condition, circulation, decambering and forces. The force of the changing circulation
(added mass) and the memory of the shed vorticity are off: the result is an aerodynamic stiffness and damping.

- ``"quasi_steady"``: the near wake, half a second old at most, carries the current circulation of the blades, as it
  does soon after a change; only the older wake is frozen. Right for changes that last longer than the travel of some
  chords and shorter than the time in which the induction of the whole wake changes, D/V. It follows the tower-top
  motion and speed of the NREL 5-MW after steps of pitch, torque and wind within 10 %, blade-root moments within 30 %.
- ``"frozen_wake"``: all rings of the wake but the newest are frozen. This is the answer of the first instant; it lacks
  the part of the circulation that builds up while shed vorticity moves away, about a quarter.
- ``"none"``: no air at all.

Water. A floater has hydrostatics, lines and added mass as they change with its motion, and the memory of the water as
further states, ẋ = a x + b v with the force −c x (Cummins 1962; Perez and Fossen 2009; `fit_radiation`), v its velocity
in axes turned by its yaw. Drag is quadratic: of a small motion in still water it has no part. A current pushes the
floater in its operating point and makes drag linear; so do waves, by their standard deviations
(`wt_gym.hydrodynamics.loads.WaveResponse`). Waves push as inputs: their force depends on their frequency, before a
crest arrives too, so that no states lead from the elevation to it. `LinearModel.waves` and `WaveForces.of` have
the inputs of a sea. Slow drift, of second order, is not in them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, cast

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from wt_gym.aerodynamics import AeroState
from wt_gym.aerodynamics.state import AeroArrays
from wt_gym.aerodynamics.wake.wake_kernels import velocity_behind_disc
from wt_gym.base.errors import SimulationError, did_you_mean
from wt_gym.base.quantities import GRAVITY, MOTIONS, Array
from wt_gym.hydrodynamics.loads import NearLoads
from wt_gym.hydrodynamics.waves import WaveComponents
from wt_gym.multibody.arrays import MultibodyError
from wt_gym.multibody.tree import tree_kernels
from wt_gym.simulation.channels import channel_table
from wt_gym.simulation.contract import SimulatorState
from wt_gym.simulation.linear_model import (
    LinearModel,
    RotorPoint,
    SteadyPoint,
    WaveForces,
    multiblade_model,
    reflected_model,
)
from wt_gym.simulation.models import place_nacelle
from wt_gym.simulation.start import rigid_body
from wt_gym.simulation.step import coupling_kernels, water_kernels
from wt_gym.simulation.step.coupling import Coupling
from wt_gym.simulation.step.coupling_data import Extremes, MeasuredState, Measurement, TowerAir, Water
from wt_gym.turbines import Turbine
from wt_gym.wind import Inflow, MirroredInflow, SteadyInflow

MOTION_STEP = 3e-3
"""Displacement of the rotor's points by which positions are changed for the difference quotients [m]."""
SPEED_STEP = 0.05
"""Velocity of the rotor's points by which rates are changed, and wind speed [m/s]."""
TORQUE_STEP = 100.0
"""Change of the generator torque [N m]; the equations are linear in it."""
FORCE_STEP, MEMORY_STEP = 1e5, 100.0
"""Change of forces of waves [N, N m] and states of the radiation; the equations are linear in both."""


def linearize(  # noqa: PLR0913
    simulator: "LinearizedSimulator",
    operating_point: RotorPoint | None = None,
    *,
    wind_speed: float | None = None,
    rotor_speed: float | None = None,
    pitch: ArrayLike | None = None,
    yaw: float = 0.0,
    generator_torque: float | None = None,
    azimuth: float = 0.0,
    aerodynamics: str = "quasi_steady",
    generator: str = "free",
    multiblade: bool = False,
    n_azimuths: int = 6,
    outputs: str | Sequence[str] | None = None,
) -> LinearModel:
    """Linear model of a turbine about a steady operating point, which is found first.

    States are the elastic coordinates and joint angles of the structure, their rates, the angles and rates of the
    yaw and pitch drives, and of a floater those of the radiation, "radiation_surge_1", …: each is driven by the motion
    in its name. Inputs are "pitch_1", … and "pitch_collective" (demands of the drives [rad]), "yaw" (demand
    [rad]), "generator_torque" (high-speed shaft [N m]), "wind_speed" (uniform change along the mean wind [m/s]),
    "wind_x", "wind_y" and "wind_z", and of a floater "wave_force_surge", … "wave_force_yaw" (force and moment of the
    waves at its origin along global axes [N, N m]). Outputs are channels of the simulator. The drives have no rate
    limits here.

    Parameters
    ----------
    simulator : Simulator
        Gives turbine, fidelity, inflow and sea; its own state is not changed.
    operating_point : object, optional
        With attributes ``rotor_speed`` [rad/s] and ``pitch`` [rad].
    wind_speed : float, optional
        [m/s] at hub height, with the profile of the simulator's inflow; by default its own speed.
    rotor_speed : float, optional
        [rad/s]; zero for a parked rotor. Without it and without an operating point the model is made about the
        simulator's present state with its current wake, whether that is steady or not.
    pitch : float or array (n_blades,), optional
        [rad], default 0.
    yaw : float
        Nacelle yaw [rad].
    generator_torque : float, optional
        High-speed shaft [N m]; by default what keeps the rotor speed in the mean.
    azimuth : float
        Of blade 1 [rad]: where the model holds, or the first of the azimuths.
    aerodynamics : str
        "quasi_steady", "frozen_wake" or "none"; see the module.
    generator : str
        "free" (torque is an input) or "locked" (turns at exactly the rotor speed; its states and the torque drop out).
    multiblade : bool
        Coleman's transformation of all blade quantities and the mean over ``n_azimuths``; three blades only.
    n_azimuths : int
        Azimuths, equally spaced within one blade passage, over which the trim (and with ``multiblade`` the model) is
        averaged. A parked rotor has one.
    outputs : sequence of str, optional
        Channel names, or names of blade channels without their number for all blades; by default all but "time",
        and "wave_elevation" and the extremes since the last sample, which no linear model has.

    Raises
    ------
    SimulationError
        For an operating point that cannot be found or arguments without meaning.

    Examples
    --------
    >>> from wt_gym.simulation import Simulator
    >>> from wt_gym.wind import SteadyInflow
    >>> simulator = Simulator("nrel_5mw", inflow=SteadyInflow(18.0))
    >>> model = linearize(simulator, rotor_speed=1.267, pitch=0.26, multiblade=True)  # doctest: +SKIP
    >>> [(mode.name, mode.frequency, mode.damping) for mode in model.modes()]  # doctest: +SKIP
    """
    if generator not in ("free", "locked"):
        raise SimulationError(f"generator must be free or locked, got {generator!r}")
    plant = FrozenPlant(simulator, _felt_inflow(simulator, wind_speed), aerodynamics, generator == "locked")
    if multiblade and plant.n_blades != 3:
        raise SimulationError(f"n_blades must be 3 for multi-blade coordinates, got {plant.n_blades}")
    if operating_point is not None:
        rotor_speed = operating_point.rotor_speed if rotor_speed is None else rotor_speed
        pitch = operating_point.pitch if pitch is None else pitch

    def find() -> tuple[SteadyPoint, list[Wake | None]]:
        if rotor_speed is None:
            return _present(plant, simulator)
        angle, felt = 0.0 if pitch is None else pitch, -yaw if simulator.mirrored else yaw
        try:
            return trim_plant(plant, rotor_speed, angle, felt, generator_torque, azimuth, n_azimuths)
        except MultibodyError as error:
            raise SimulationError("no steady operating point was found: the structure diverged") from error

    point, wakes = find()
    if plant.meet_waves(point.states[0]):
        point, wakes = find()
    names = _output_names(plant.turbine, outputs)
    count = len(point.azimuth) if multiblade else 1
    models = []
    for k in range(count):
        plant.wake = wakes[k]
        model = _differentiate(plant, point, k, names)
        models.append(multiblade_model(model, point.azimuth[k], point.rotor_speed) if multiblade else model)
    mean = {key: np.mean([getattr(m, key) for m in models], axis=0) for key in "ABCD"}
    model = replace(models[0], **mean, waves=plant.waves)
    return reflected_model(model, plant.state_names, plant.turbine.n_lines) if simulator.mirrored else model


def _felt_inflow(simulator: "LinearizedSimulator", wind_speed: float | None) -> Inflow:
    """The steady wind of an operating point as the simulated image of the turbine feels it."""
    inflow = steady_inflow(simulator.inflow, wind_speed)
    return MirroredInflow.of(inflow) if simulator.mirrored else inflow


def steady_inflow(inflow: Inflow, wind_speed: float | None = None) -> SteadyInflow:
    """The steady wind of an operating point: the profile of the given inflow, at another speed if given.

    Raises
    ------
    SimulationError
        When the inflow is not steady and no speed is given.
    """
    profile = inflow if isinstance(inflow, SteadyInflow) else getattr(inflow, "steady", None)
    if wind_speed is None:
        if profile is not inflow:
            raise SimulationError(f"an operating point needs steady wind, not {inflow.description}; give wind_speed")
        return inflow
    if not isinstance(profile, SteadyInflow):
        profile = SteadyInflow(float(wind_speed), inflow.hub_height)
    return replace(profile, speed=float(wind_speed))


# ---- trim ------------------------------------------------------------------------------------------------------------


def trim_plant(
    plant: "FrozenPlant",
    rotor_speed: float,
    pitch: ArrayLike,
    yaw: float,
    generator_torque: float | None,
    azimuth: float,
    n_azimuths: int,
) -> "tuple[SteadyPoint, list[Wake | None]]":
    """Steady point and the wake at each of its azimuths; see :func:`linearize` for the arguments."""
    if not (np.isfinite(rotor_speed) and rotor_speed >= 0.0):
        raise SimulationError(f"rotor_speed is {rotor_speed} rad/s; must be a finite speed of at least zero")
    if n_azimuths < 1:
        raise SimulationError(f"n_azimuths is {n_azimuths}; must be at least one azimuth")
    pitch = np.broadcast_to(np.asarray(pitch, dtype=float), (plant.n_blades,)).copy()
    turning = rotor_speed > 0.0
    passage = 2.0 * np.pi / plant.n_blades
    azimuths = azimuth + passage * np.arange(n_azimuths if turning else 1) / n_azimuths
    plant.set_commands(0.0 if generator_torque is None else generator_torque, yaw, pitch)
    plant.hold_speed, hold = generator_torque is None, plant.hold_speed
    shapes = [_harmonics(plant, psi, rotor_speed) for psi in azimuths]
    unknown = np.zeros(shapes[0][0].shape[1])
    wakes: list[Wake | None] = [None] * len(azimuths)

    def states(z: Array) -> list[Array]:
        return [
            plant.steady_state(psi, rotor_speed, s[0] @ z, s[1] @ z) for psi, s in zip(azimuths, shapes, strict=True)
        ]

    def residual(z: Array) -> Array:
        total = np.zeros(len(z))
        for y, shape, wake in zip(states(z), shapes, wakes, strict=True):
            plant.wake = wake
            total += shape[3] @ (plant.acceleration(y)[plant.elastic] - shape[2] @ z)
        return total / len(azimuths)

    reach = np.max([np.abs(s[0]) * plant.reach[plant.elastic, None] for s in shapes], axis=(0, 1))
    step = MOTION_STEP / reach
    for _ in range(8 if plant.with_air else 1):
        wakes = [plant.new_wake(y, rotor_speed) for y in states(unknown)]
        before = unknown.copy()
        jacobian, last = None, np.inf
        for _ in range(25):
            r = residual(unknown)
            if jacobian is None:
                jacobian = np.column_stack([(residual(unknown + row) - r) / row.sum() for row in np.diag(step)])
            change = np.linalg.solve(jacobian, -r)
            unknown = unknown + change
            if not np.all(np.isfinite(unknown)):
                raise SimulationError("no steady operating point was found: the structure diverged")
            size = (np.abs(change) * reach).max()
            if size < 1e-7:
                break
            if size > 0.5 * last:  # blades or lines of a floater that have moved far have other slopes
                jacobian = None
            last = size
        else:
            raise SimulationError("no steady operating point was found: Newton's iteration did not converge")
        if (np.abs(unknown - before) * reach).max() < 1e-4:
            break
    ys = states(unknown)
    left = np.abs(residual(unknown)) * reach
    if generator_torque is None:
        reactions = []
        for y, wake in zip(ys, wakes, strict=True):
            plant.wake = wake
            plant.acceleration(y)
            reactions.append(plant.reaction)
        plant.set_commands(float(np.mean(reactions)), yaw, pitch)
    plant.hold_speed = hold
    point = SteadyPoint(
        plant.inflow.mean_speed, float(rotor_speed), pitch, float(yaw), plant.torque, azimuths, np.array(ys),
        _mean_outputs(plant, ys, wakes), float(left.max()),
    )  # fmt: skip
    return point, wakes


def _harmonics(plant: "FrozenPlant", azimuth: float, rotor_speed: float) -> tuple[Array, Array, Array, Array]:
    """Elastic coordinates, rates and accelerations of a steady motion per unknown, and the weights of its equations.

    A turning rotor: every coordinate that does not belong to a blade is constant, those of blade i are
    q₀ + q_c cos ψ_i + q_s sin ψ_i. A parked rotor: every coordinate on its own.
    """
    n = len(plant.elastic)
    if rotor_speed == 0.0:
        return np.eye(n), np.zeros((n, n)), np.zeros((n, n)), np.eye(n)
    place = {i: k for k, i in enumerate(plant.elastic)}
    blades = [[place[i] for i in rows] for rows in plant.blade_elastic]
    fixed = [k for k in range(n) if not any(k in rows for rows in blades)]
    n_b = len(blades[0])
    out = np.zeros((3, n, len(fixed) + 3 * n_b))
    weights = np.zeros((len(fixed) + 3 * n_b, n))
    for column, k in enumerate(fixed):
        out[0, k, column] = weights[column, k] = 1.0
    for i, rows in enumerate(blades):
        psi = azimuth + 2.0 * np.pi * i / len(blades)
        for mode, k in enumerate(rows):
            columns = len(fixed) + 3 * mode + np.arange(3)
            c, s = np.cos(psi), np.sin(psi)
            out[:, k, columns] = [[1.0, c, s], [0.0, -rotor_speed * s, rotor_speed * c],
                                  [0.0, -rotor_speed**2 * c, -rotor_speed**2 * s]]  # fmt: skip
            weights[columns, k] = np.array([1.0, 2.0 * c, 2.0 * s]) / len(blades)
    return (*out, weights)


def _mean_outputs(plant: "FrozenPlant", states: Sequence[Array], wakes: "Sequence[Wake | None]") -> Array:
    values = []
    for y, wake in zip(states, wakes, strict=True):
        plant.wake = wake
        values.append(plant.outputs(y, plant.rates(y)))
    return np.asarray(np.mean(values, axis=0))


def _present(plant: "FrozenPlant", simulator: "LinearizedSimulator") -> "tuple[SteadyPoint, list[Wake | None]]":
    """The simulator's present state as an operating point, with its current wake."""
    state = simulator.state().arrays
    y = np.concatenate([state["history_y"][-1], state.get("platform_radiation_state", ())])
    command = state["command"]
    plant.set_commands(command[0], command[1], command[2:])
    wake = plant.present_wake(simulator.coupling.aero, y)
    plant.wake = wake
    azimuth = y[plant.structure.azimuth_q]
    speed = y[plant.system.n_q + plant.structure.azimuth_u]
    acceleration = plant.acceleration(y) * plant.reach
    point = SteadyPoint(
        plant.inflow.mean_speed, float(speed), command[2:].copy(), float(command[1]), plant.torque, np.array([azimuth]),
        y[None], _mean_outputs(plant, [y], [wake]), float(np.abs(acceleration).max()),
    )  # fmt: skip
    return point, [wake]


# ---- difference quotients --------------------------------------------------------------------------------------------


def _output_names(turbine: Turbine, chosen: str | Sequence[str] | None) -> tuple[str, ...]:
    """Channel names from channels and groups of blade channels."""
    n_blades = turbine.n_blades
    without = (*Extremes._fields, "wave_elevation")
    known = [c.name for c in channel_table(n_blades, turbine.n_lines) if c.group not in without]
    if chosen is None:
        return tuple(name for name in known if name != "time")
    out = []
    for name in (chosen,) if isinstance(chosen, str) else chosen:
        group = [f"{name}_{i + 1}" for i in range(n_blades)]
        if name in known:
            out.append(name)
        elif set(group) <= set(known):
            out += group
        else:
            raise SimulationError(f"output must be one of {', '.join(known)}, got {name!r}{did_you_mean(name, known)}")
    return tuple(out)


def _differentiate(plant: "FrozenPlant", point: SteadyPoint, k: int, output_names: tuple[str, ...]) -> LinearModel:
    """Central differences of rates and outputs about the state at one azimuth."""
    y, system = point.states[k], plant.system
    channels = [c.name for c in channel_table(plant.n_blades, plant.turbine.n_lines)]
    chosen = [channels.index(name) for name in output_names]
    turns = np.array([channels[i] in ("azimuth", "yaw_error") for i in chosen])
    locked = {plant.structure.azimuth_q, system.n_q + plant.structure.azimuth_u} if plant.hold_speed else set()
    kept = [i for i in range(len(y)) if i not in locked]

    def evaluate(state: Array) -> tuple[Array, Array]:
        dy = plant.rates(state)
        return dy[kept], plant.outputs(state, dy)[chosen]

    def quotient(up: tuple[Array, Array], down: tuple[Array, Array], width: float) -> tuple[Array, Array]:
        rate, out = up[0] - down[0], up[1] - down[1]
        out[turns] = np.remainder(out[turns] + np.pi, 2.0 * np.pi) - np.pi
        return rate / width, out / width

    a, c, b, d = [], [], [], []
    for i in kept:
        h = plant.step_of(i, MOTION_STEP, SPEED_STEP)
        up, down = y.copy(), y.copy()
        up[i] += h
        down[i] -= h
        rate, out = quotient(evaluate(up), evaluate(down), 2.0 * h)
        a.append(rate)
        c.append(out)
    inputs = plant.inputs_of(MOTION_STEP, SPEED_STEP, TORQUE_STEP)
    for change, width in inputs.values():
        sides = []
        for sign in (1.0, -1.0):
            plant.change_inputs(sign * change)
            sides.append(evaluate(y))
        plant.change_inputs(np.zeros_like(change))
        rate, out = quotient(sides[0], sides[1], 2.0 * width)
        b.append(rate)
        d.append(out)
    names = tuple(plant.state_names[i] for i in kept)
    return LinearModel(
        np.array(a).T, np.array(b).T, np.array(c).T, np.array(d).T, names, tuple(inputs), output_names, point
    )


AERODYNAMICS = ("quasi_steady", "frozen_wake", "none")
ROUNDING = 1e-9
"""Speed of a lattice point that is none [m/s]."""
NEAR_WAKE = 0.5
"""Age up to which the wake follows the circulation of the blades in quasi-steady aerodynamics [s].

Between 0.25 and 2 s the response of the NREL 5-MW to steps of pitch, torque and wind changes by less than 3 %.
"""


class LinearizedSimulator(Protocol):
    """What of a `wt_gym.simulation.Simulator` linear models are made from; it builds on this module itself."""

    @property
    def turbine(self) -> Turbine:
        """The turbine."""

    @property
    def inflow(self) -> Inflow:
        """Its wind."""

    @property
    def mirrored(self) -> bool:
        """Whether structure and air are those of the mirror image."""

    @property
    def sea(self) -> WaveComponents | None:
        """Waves and current that a floater meets."""

    @property
    def coupling(self) -> Coupling:
        """Structure and air in their current state."""

    def state(self) -> SimulatorState:
        """Copy of the current state."""


@dataclass(frozen=True)
class Wake:
    """A lattice whose wake stands still, and the rotor's position for which it was made."""

    aero: AeroState
    source: Array
    """Decambering of the reference, where each solution starts, so that the loads are a smooth function; array
    (n_strip,)."""
    angle: float  #: Rotor azimuth [rad]
    center: Array
    axis: Array  #: center, axis: hub [m] and shaft direction; array (3,)
    slowing: Array  #: What the rotor adds to the wind at the tower [m/s]; array (3,)


class _Gust:
    """A steady inflow with a uniform change."""

    def __init__(self, inflow: Inflow) -> None:
        self.inflow, self.change = inflow, np.zeros(3)

    def velocity(self, points: Array, time: float) -> Array:
        return self.inflow.velocity(points, time) + self.change


class FrozenPlant:
    """Rates and channels of a turbine as functions of the state of its structure.

    Parameters
    ----------
    simulator : Simulator
        Its models are used, its state is left alone.
    aerodynamics : str
        "quasi_steady", "frozen_wake" or "none".
    hold_speed : bool
        A reaction on the generator keeps its speed exactly; the reaction is found with each evaluation.

    Attributes
    ----------
    elastic : array of int
        Velocities of all coordinates but the generator azimuth; for this structure also the indices of the coordinates.
    blade_elastic : list of list of int
        Those of each blade.
    reach : array (n_u,)
        Largest speed of a point of the rotor for a unit rate of each coordinate.
    state_names : tuple of str
        Those of the multibody system, then those of the radiation of a floater.
    waves : WaveForces or None
        Of the sea, with their drag; known after `meet_waves`.
    torque, reaction : float
        Commanded generator torque and the torque that held the speed in the last evaluation [N m, high-speed shaft].
    wake : Wake or None
        To be set before evaluations with air.
    """

    def __init__(
        self, simulator: LinearizedSimulator, inflow: Inflow, aerodynamics: str = "quasi_steady",
        hold_speed: bool = False,
    ) -> None:  # fmt: skip
        if aerodynamics not in AERODYNAMICS:
            raise SimulationError(f"aerodynamics must be one of {', '.join(AERODYNAMICS)}, got {aerodynamics!r}")
        models = simulator.coupling.models
        self.turbine, self.lattice, self.structure = models.turbine, models.lattice, models.structure
        self.fidelity, self.time_step, self.tower_flow = models.fidelity, models.time_step, models.tower_flow
        self.system, self.n_blades = self.structure.system, self.turbine.n_blades
        system = self.system
        if system.n_q != system.n_u or system.n_constraints:
            raise SimulationError("only a structure in embedded form without quaternions can be linearized")
        if models.fidelity.reference_condition != "clamped":
            raise SimulationError(
                f"Fidelity.reference_condition is {models.fidelity.reference_condition!r}; linear models of observer "
                "frames need 'clamped', with which their equations are those of the structure's coordinates"
            )
        self.inflow, self._wind = inflow, _Gust(inflow)
        self.state_names, self.waves = tuple(system.state_names), cast("WaveForces | None", None)
        self._near, self._water = cast("NearLoads | None", None), cast("Water | None", None)
        self._n_memory, sea = 0, simulator.sea
        if self.turbine.floater is not None:
            sea = sea.mirrored() if simulator.mirrored and sea is not None else sea
            self._near = NearLoads(replace(self.turbine.floater, gravity=GRAVITY), self.time_step, sea)
            self._water = Water.of(self.turbine, self.structure, self._near.arrays)
            motions = self._near.loads.radiation.motion.tolist()
            count = [motions[: k + 1].count(motion) for k, motion in enumerate(motions)]
            self.state_names += tuple(f"radiation_{MOTIONS[m]}_{k}" for m, k in zip(motions, count, strict=True))
            self._n_memory = len(motions)
        self.with_air, self.hold_speed = aerodynamics != "none", hold_speed
        self._near_wake = NEAR_WAKE if aerodynamics == "quasi_steady" else 0.0
        self._allocate()
        s, n_q = self.structure, system.n_q
        self.elastic = np.array([i for i in range(system.n_u) if i != s.azimuth_u])
        self.blade_elastic = [
            [system.index(b, "elastic_u") + k for b in parts for k in range(system.bodies[b].n_elastic)]
            for parts in s.parts
        ]
        self.reach = np.array([self._reach_of(n_q + i) for i in range(system.n_u)])
        servos = n_q + system.n_u + system.n_servo + np.arange(system.n_servo)
        self._servo_reach = np.array([self._reach_of(i) for i in servos.tolist()])

    def meet_waves(self, y: Array) -> bool:
        """Make the drag of a floater linear for its motion in the waves about the state y.

        Returns
        -------
        bool
            Whether the mean drag has changed, and with it the state of balance.
        """
        if self._near is None or self._water is None or self._near.loads.components is None:
            return False

        def load(state: Array) -> None:
            self._move(state)
            self._float(np.zeros(self._n_memory))

        places = self.system.index(self._water.body, "joint_q") + np.arange(6)
        start = y[: self.system.n_state].copy()
        motion = self._near.meet_waves(*rigid_body(self.system, start, self.inputs, self.work, places, load))
        self.waves = WaveForces(self._near.arrays.wave_frequency, motion.force)
        return bool(self._near.arrays.current.any() and motion.force.any())

    def _allocate(self) -> None:
        """Arrays of the exchange between structure and air."""
        n, shape = self.n_blades, self.lattice.nodes_shape
        self.work, self.inputs = self.system.new_work(), self.system.new_inputs()
        self._nodes, self._velocities, self._forces = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        flat = (n, shape[1] * shape[2], 3)
        self._flat = tuple(a.reshape(flat) for a in (self._nodes, self._velocities, self._forces))
        self._lattice_bodies = self.structure.lattice_bodies
        self._tower = TowerAir.of(self.turbine, self.structure)
        self._tower_axis = self._tower.position.copy()
        self._measurement = Measurement(self.turbine, self.structure)
        wave = n + (5 if self._water is None else 11)
        self._demands, self._gust, self._waves = slice(2 + n), slice(2 + n, 5 + n), slice(5 + n, wave)
        self._base = np.zeros(wave)  # torque, yaw, pitch of each blade, change of the wind, force of waves
        self._command = self._base.copy()
        self.wake: Wake | None = None
        self.reaction = 0.0

    def _move(self, y: Array) -> None:
        """Kinematics and lattice points of the state y."""
        s, work = self.structure, self.work
        tree_kernels.kinematics(y[: self.system.n_state], self.system.tree, work)
        self._elastic = [np.array(part) for part in zip(*(s.elastic(b, y) for b in self._lattice_bodies), strict=True)]
        coupling_kernels.rotor_motion(
            work.rot, work.r, work.v, work.omega, *self._elastic, s.lattice_points, self._lattice_bodies,
            s.sub_body_nodes, *self._flat[:2],
        )  # fmt: skip

    def _reach_of(self, i: int) -> float:
        """Largest speed of lattice points [m/s] at a unit rate i; one where none moves, as by inner tower nodes."""
        y = self.system.initial_state()
        y[i] = 1.0
        self._move(y)
        speed = float(np.linalg.norm(self._velocities, axis=-1).max())
        return speed if speed > ROUNDING else 1.0

    # ---- inputs ------------------------------------------------------------------------------------------------------

    @property
    def torque(self) -> float:
        """Commanded generator torque, high-speed shaft [N m]."""
        return float(self._base[0])

    def set_commands(self, torque: float, yaw: float, pitch: ArrayLike) -> None:
        """Commands of the operating point: torque [N m], yaw [rad] and pitch (n_blades,) [rad]."""
        self._base[0], self._base[1], self._base[self._demands][2:] = torque, yaw, pitch
        self.change_inputs(np.zeros_like(self._base))

    def change_inputs(self, change: Array) -> None:
        """Inputs that differ from the operating point by ``change``.

        They are torque, yaw, pitch of each blade, wind (3), and the force of the waves on a floater (6).
        """
        self._command = self._base + change
        self._wind.change = self._command[self._gust]
        self._set_torque(self._command[0])
        self.inputs.servo_command[:] = self._command[self._demands][1:]

    def _set_torque(self, torque: float) -> None:
        drive = self.turbine.drivetrain
        self.inputs.dof_force[:, self.structure.azimuth_u] = -torque * drive.gear_ratio / drive.gearbox_efficiency

    def inputs_of(self, motion: float, speed: float, torque: float) -> dict[str, tuple[Array, float]]:
        """Changes of the inputs by name, and by how much the named quantity changes.

        Parameters
        ----------
        motion, speed, torque : float
            Displacement [m] and velocity [m/s] of the rotor's points, and torque [N m].

        Returns
        -------
        dict of str to (array, float)
        """
        unit = np.eye(len(self._base))
        yaw, pitch = motion / self._servo_reach[0], motion / self._servo_reach[1]
        out = {f"pitch_{i + 1}": (pitch * unit[2 + i], pitch) for i in range(self.n_blades)}
        out["pitch_collective"] = (pitch * unit[self._demands][2:].sum(axis=0), pitch)
        out["yaw"] = (yaw * unit[1], yaw)
        if not self.hold_speed:
            out["generator_torque"] = (torque * unit[0], torque)
        hub = np.array([[0.0, 0.0, self.turbine.hub_height]])
        wind = self.inflow.velocity(hub, 0.0)[0]
        size = np.linalg.norm(wind)
        along = wind / size if size > 0.0 else np.array([1.0, 0.0, 0.0])
        out["wind_speed"] = (speed * along @ unit[self._gust], speed)
        for axis, row in zip("xyz", unit[self._gust], strict=True):
            out[f"wind_{axis}"] = (speed * row, speed)
        for name, row in zip(MOTIONS, unit[self._waves], strict=False):
            out[f"wave_force_{name}"] = (FORCE_STEP * row, FORCE_STEP)
        return out

    def step_of(self, i: int, motion: float, speed: float) -> float:
        """Change of the state's entry i that moves points of the rotor by ``motion`` [m] or ``speed`` [m/s]."""
        n_u, n_s = self.system.n_u, self.system.n_servo
        if i < n_u:
            return float(motion / self.reach[i])
        if i < 2 * n_u:
            return float(speed / self.reach[i - n_u])
        if i < 2 * n_u + n_s:
            return float(motion / self._servo_reach[i - 2 * n_u])
        if i < 2 * n_u + 2 * n_s:
            return float(speed / self._servo_reach[i - 2 * n_u - n_s])
        return MEMORY_STEP

    def steady_state(self, azimuth: float, rotor_speed: float, q: Array, u: Array) -> Array:
        """State with the drives at rest at their commands and elastic coordinates q and rates u (n_elastic,)."""
        y = np.concatenate([self.system.initial_state(), np.zeros(self._n_memory)])
        n = self.system.n_u
        y[self.elastic], y[n + self.elastic] = q, u
        y[self.structure.azimuth_q], y[n + self.structure.azimuth_u] = azimuth, rotor_speed
        y[2 * n : 2 * n + self.system.n_servo] = self._base[self._demands][1:]
        return y

    # ---- wake --------------------------------------------------------------------------------------------------------

    def new_wake(self, y: Array, rotor_speed: float) -> Wake | None:
        """Helical wake in momentum balance with the rotor in the state y (None without air)."""
        if not self.with_air:
            return None
        self._move(y)
        center, axis = self._shaft()
        aero = self.lattice.new_state()
        self.lattice.initialize_helix(
            aero, self._nodes, self._velocities, self._wind_at_blades(np.zeros(3)), center, axis, rotor_speed,
            self.time_step,
        )  # fmt: skip
        return self._frozen(aero, self._angle(y), center, axis)

    def present_wake(self, aero: AeroState, y: Array) -> Wake | None:
        """The wake of a running simulation in the state y, frozen (None without air)."""
        if not self.with_air:
            return None
        self._move(y)
        aero = aero.copy()
        aero.arrays.n_levels[0] = 1  # a solution at dt = 0 is steady
        return self._frozen(aero, self._angle(y), *self._shaft())

    def _frozen(self, aero: AeroState, angle: float, center: Array, axis: Array) -> Wake:
        """Freeze the wake of a lattice that belongs to the current nodes; its youngest rings follow the blades.

        A ring of the near wake takes the circulation of its strip at the trailing edge, like the newest ring: its
        influence joins that of the strip's last bound ring, and what it induced goes out of the frozen velocity.
        """
        a, rings, slowing = aero.arrays, self.lattice.arrays.shed_rings, np.zeros(3)
        velocity_behind_disc(
            a.wake, a.induced, a.age, a.n_rows, center, axis, self.work.omega[self.structure.hub, 0], slowing
        )
        wind = self._wind_at_blades(slowing)
        self.lattice._solve(aero, self._nodes, self._velocities, wind, 0.0, first=True)
        near = np.flatnonzero(a.age[1 : aero.n_rows] < self._near_wake) + 1
        if len(near):
            points, probe = self.lattice.work.points.copy(), aero.copy()
            for array in (probe.arrays.gamma, probe.arrays.wake_gamma, probe.arrays.far, probe.arrays.body_strength):
                array[...] = 0.0
            probe.arrays.n_rows[0] = near[-1] + 1
            per_blade = a.gamma[0].size
            for b in range(self.n_blades):
                for e, ring in enumerate(rings):
                    probe.arrays.wake_gamma[near, b, e] = 1.0
                    velocity = self.lattice.induced_velocity(probe, points.T).T
                    probe.arrays.wake_gamma[near, b, e] = 0.0
                    a.influence[b * per_blade + ring] += velocity
                    a.wake_flow[:] -= a.gamma[b].flat[ring] * velocity
            self._invert(a)
            self.lattice._solve(aero, self._nodes, self._velocities, wind, 0.0, first=True)
        return Wake(aero, a.source.copy(), angle, center, axis, slowing)

    def _invert(self, a: AeroArrays) -> None:
        """Solution of the boundary condition for a changed influence of the rings."""
        n_blade, n_chord, n_span = a.gamma.shape
        chord = a.nodes[:, 1:] - a.nodes[:, :-1]
        span = a.nodes[:, :, 1:] - a.nodes[:, :, :-1]
        normal = np.cross(chord[:, :, 1:] + chord[:, :, :-1], span[:, 1:] + span[:, :-1]).reshape(-1, 3)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        a.inverse[:] = np.linalg.inv(np.einsum("scr,rc->rs", a.influence[:, :, : len(normal)], normal))
        by_strip = a.inverse.reshape(n_blade, n_chord, n_span, n_blade, n_chord, n_span)[:, -1].sum(axis=3)
        a.response[:] = by_strip.reshape(a.response.shape)

    def _shaft(self) -> tuple[Array, Array]:
        hub = self.structure.hub
        return self.work.r[hub].copy(), self.work.rot[hub, :, 0].copy()

    def _angle(self, y: Array) -> float:
        s = self.structure  # a rigid shaft has no angle of its own: its index is that of the next coordinate
        twist = y[self.system.index(s.hub, "joint_q")] if s.shaft_flexible else 0.0
        return float(y[s.azimuth_q] + twist)

    def _wind_at_blades(self, slowing: Array) -> Array:
        """Undisturbed wind at the lattice nodes, with the blocking of the tower in a wind changed by ``slowing``."""
        wind = self._wind.velocity(self._nodes, 0.0)
        if self.lattice.bodies:
            nacelle = self.structure.nacelle
            place_nacelle(self.lattice.bodies, self.work.rot[nacelle], self.work.omega[nacelle])
            self.lattice.body_wind[:] = self._wind.velocity(self.lattice.bodies.control_points, 0.0)
        if self.fidelity.tower_shadow and self.fidelity.tower_body is None:
            wind = np.array(wind + slowing, dtype=np.float64)
            base = None if self.structure.floater is None else self.work.r[self.structure.tower]
            self.tower_flow.add(self._nodes, wind, self.work.r[self.structure.nacelle], base)
            wind -= slowing
        return wind

    # ---- evaluation --------------------------------------------------------------------------------------------------

    def _load(self, y: Array) -> None:
        """Loads of the air for the state y into the inputs; kinematics are up to date."""
        self._move(y)
        self._float(y[self.system.n_state :])
        if not self.with_air:
            return
        wake = self.wake
        if wake is None:
            raise SimulationError("the wake of a plant with air must be set before it is evaluated")
        # the wake turns with the rotor: the lattice is solved where the rotor stood
        turn = Rotation.from_rotvec((self._angle(y) - wake.angle) * wake.axis).as_matrix()
        nodes = wake.center + (self._nodes - wake.center) @ turn
        wake.aero.arrays.source[:] = wake.source
        forces = self.lattice._solve(
            wake.aero, nodes, self._velocities @ turn, self._wind_at_blades(wake.slowing) @ turn, 0.0, first=True
        )
        self._forces[:] = forces @ turn.T
        loads = self.inputs.body_loads
        coupling_kernels.rotor_loads(
            self._flat[2], self.work.rot, self._elastic[0], self.structure.lattice_points, self._lattice_bodies,
            self.structure.sub_body_nodes, loads[1],
        )  # fmt: skip
        self._tower.wind[:] = self._wind.velocity(self._tower_axis, 0.0)
        coupling_kernels.tower_drag(
            y[: self.system.n_state], self.system.tree, self.work, self._tower, loads[1][self.structure.tower]
        )
        loads[0] = loads[1]

    def _float(self, memory: Array) -> None:
        """Loads of water and lines on a floater with states of the radiation (r,); kinematics are up to date."""
        water, work = self._water, self.work
        if self._near is None or water is None:
            return
        b, loads = water.body, self.inputs.body_loads
        water_kernels.floater_motion(work, water)
        self._near.set(memory, self._command[self._waves], work.rot[b], water.velocity, water.spin)
        self._near.loads.require(water_kernels.floater_loads(work, water, loads[1, b]), work.r[b], work.rot[b])
        loads[0, b] = loads[1, b]

    def rates(self, y: Array) -> Array:
        """dy/dt of the structure and of the memory of the water in the state y."""
        self._load(y)
        dy = self._structure_rates(y[: self.system.n_state])
        return dy if self._near is None else np.concatenate([dy, self._near.memory_rate(y[self.system.n_state :])])

    def _structure_rates(self, y: Array) -> Array:
        """Rates of the structure under the loads of the state y."""
        dy: Array = self.system.rates(y, self.inputs, self.work)
        if not self.hold_speed:
            return dy
        k, torque = self.system.n_q + self.structure.azimuth_u, self._command[0]
        # accelerations are linear in the torque: a second evaluation tells which one stops the generator's
        other = torque + self.turbine.drivetrain.max_generator_torque
        self._set_torque(other)
        slope = (self.system.rates(y, self.inputs, self.work) - dy) / (other - torque)
        self._set_torque(torque)
        self.reaction = torque - dy[k] / slope[k]
        return np.asarray(dy + (self.reaction - torque) * slope)

    def acceleration(self, y: Array) -> Array:
        """u̇ (n_u,) in the state y."""
        return self.rates(y)[self.system.n_q : self.system.n_q + self.system.n_u]

    def outputs(self, y: Array, dy: Array) -> Array:
        """All channels (n_channels,) for the state y whose rates dy were just computed."""
        nodes, _, forces = self._flat
        n = self.system.n_state
        instant = MeasuredState(y[:n], dy[:n], self.inputs.body_loads[1], self.work, nodes, forces)
        torque = self.reaction if self.hold_speed else self._command[0]
        self._measurement.take(0.0, instant, torque, self._command[self._demands], self._wind, self._water)
        return self._measurement.values.copy()
