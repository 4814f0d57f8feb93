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

- ``"quasi_steady"``: the near wake, half a second old at most, carries the present circulation of the blades, as it
  does soon after a change; only the older wake is frozen. Right for changes that last longer than the travel of some
  chords and shorter than the time in which the induction of the whole wake changes, D/V. It follows the tower-top
  motion and speed of the NREL 5-MW after steps of pitch, torque and wind within 10 %, blade-root moments within 30 %.
- ``"frozen_wake"``: all rings of the wake but the newest are frozen. This is the answer of the first instant; it lacks
  the part of the circulation that builds up while shed vorticity moves away, about a quarter.
- ``"none"``: no air at all.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.base.errors import SimulationError, did_you_mean
from wt_gym.simulation.channels import channel_table, parities
from wt_gym.simulation.linear.frozen_plant import FrozenPlant
from wt_gym.simulation.linear.linear_model import LinearModel, SteadyPoint, multiblade_model
from wt_gym.simulation.reflection import state_parities
from wt_gym.simulation.step.monitor import Extremes
from wt_gym.wind import MirroredInflow, SteadyInflow

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from wt_gym.simulation.linear.frozen_plant import LinearizedSimulator, Wake
    from wt_gym.simulation.linear.linear_model import RotorPoint
    from wt_gym.wind import Inflow

__all__ = ["SteadyPoint", "linearize", "trim"]

MOTION_STEP = 3e-3
"""Displacement of the rotor's points by which positions are changed for the difference quotients [m]."""
SPEED_STEP = 0.05
"""Velocity of the rotor's points by which rates are changed, and wind speed [m/s]."""
TORQUE_STEP = 100.0
"""Change of the generator torque [N m]; the equations are linear in it."""


def linearize(
    simulator: LinearizedSimulator,
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

    States are the elastic coordinates and joint angles of the structure, their rates, and the angles and rates of the
    yaw and pitch drives. Inputs are "pitch_1", … and "pitch_collective" (demands of the drives [rad]), "yaw" (demand
    [rad]), "generator_torque" (high-speed shaft [N m]), "wind_speed" (uniform change along the mean wind [m/s]),
    "wind_x", "wind_y" and "wind_z". Outputs are channels of the simulator. The drives have no rate limits here.

    Parameters
    ----------
    simulator : Simulator
        Gives turbine, fidelity and inflow; its own state is not changed.
    operating_point : object, optional
        With attributes ``rotor_speed`` [rad/s] and ``pitch`` [rad].
    wind_speed : float, optional
        [m/s] at hub height, with the profile of the simulator's inflow; by default its own speed.
    rotor_speed : float, optional
        [rad/s]; zero for a parked rotor. Without it and without an operating point the model is made about the
        simulator's present state with its present wake, whether that is steady or not.
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
        Channel names, or names of blade channels without their number for all blades; by default all but "time" and
        the extremes since the last sample, which no linear model has.

    Returns
    -------
    LinearModel

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
    plant = FrozenPlant(simulator, _felt_inflow(simulator, wind_speed), aerodynamics, _lock(generator))
    if multiblade and plant.n_blades != 3:
        raise SimulationError(f"n_blades must be 3 for multi-blade coordinates, got {plant.n_blades}")
    if operating_point is not None:
        rotor_speed = operating_point.rotor_speed if rotor_speed is None else rotor_speed
        pitch = operating_point.pitch if pitch is None else pitch
    if rotor_speed is None:
        point, wakes = _present(plant, simulator)
    else:
        yaw = -yaw if simulator.mirrored else yaw
        point, wakes = trim_plant(
            plant, rotor_speed, 0.0 if pitch is None else pitch, yaw, generator_torque, azimuth, n_azimuths
        )
    names = _output_names(plant.n_blades, outputs)
    count = len(point.azimuth) if multiblade else 1
    models = []
    for k in range(count):
        plant.wake = wakes[k]
        model = _differentiate(plant, point, k, names)
        models.append(multiblade_model(model, point.azimuth[k], point.rotor_speed) if multiblade else model)
    mean = {key: np.mean([getattr(m, key) for m in models], axis=0) for key in "ABCD"}
    model = replace(models[0], **mean)
    return _reflected_model(model, plant) if simulator.mirrored else model


def trim(
    simulator: LinearizedSimulator,
    rotor_speed: float,
    pitch: ArrayLike = 0.0,
    *,
    wind_speed: float | None = None,
    yaw: float = 0.0,
    generator_torque: float | None = None,
    azimuth: float = 0.0,
    aerodynamics: str = "quasi_steady",
    n_azimuths: int = 6,
) -> SteadyPoint:
    """The steady operating point alone; arguments as for :func:`linearize`.

    Returns
    -------
    SteadyPoint
    """
    plant = FrozenPlant(simulator, _felt_inflow(simulator, wind_speed), aerodynamics, False)
    yaw = -yaw if simulator.mirrored else yaw
    point = trim_plant(plant, rotor_speed, pitch, yaw, generator_torque, azimuth, n_azimuths)[0]
    return _reflected_point(point, plant) if simulator.mirrored else point


def _felt_inflow(simulator: LinearizedSimulator, wind_speed: float | None) -> Inflow:
    """The steady wind of an operating point as the simulated image of the turbine feels it."""
    inflow = steady_inflow(simulator.inflow, wind_speed)
    return MirroredInflow.of(inflow) if simulator.mirrored else inflow


def _reflected_point(point: SteadyPoint, plant: FrozenPlant) -> SteadyPoint:
    """The operating point of a turbine from that of its mirror image, see `wt_gym.simulation.reflection`."""
    return replace(
        point,
        yaw=-point.yaw,
        states=point.states * state_parities(plant.system.state_names),
        outputs=point.outputs * parities(plant.n_blades),
    )


def _reflected_model(model: LinearModel, plant: FrozenPlant) -> LinearModel:
    """The linear model of a turbine from that of its mirror image, see `wt_gym.simulation.reflection`."""
    channels = dict(zip((c.name for c in channel_table(plant.n_blades)), parities(plant.n_blades), strict=True))
    inputs = np.array([-1.0 if name in ("yaw", "wind_y") else 1.0 for name in model.input_names])
    outputs = np.array([channels.get(name, 1.0) for name in model.output_names])  # names of no channel are of blades
    states = state_parities(model.state_names)
    return replace(
        model,
        A=model.A * np.outer(states, states),
        B=model.B * np.outer(states, inputs),
        C=model.C * np.outer(outputs, states),
        D=model.D * np.outer(outputs, inputs),
        operating_point=None if model.operating_point is None else _reflected_point(model.operating_point, plant),
    )


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


def _lock(generator: str) -> bool:
    if generator not in ("free", "locked"):
        raise SimulationError(f"generator must be free or locked, got {generator!r}")
    return generator == "locked"


# ---- trim ------------------------------------------------------------------------------------------------------------


def trim_plant(
    plant: FrozenPlant,
    rotor_speed: float,
    pitch: ArrayLike,
    yaw: float,
    generator_torque: float | None,
    azimuth: float,
    n_azimuths: int,
    passes: int = 8,
    tolerance: float = 1e-4,
) -> tuple[SteadyPoint, list[Wake | None]]:
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

    def states(z: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        return [
            plant.steady_state(psi, rotor_speed, s[0] @ z, s[1] @ z) for psi, s in zip(azimuths, shapes, strict=True)
        ]

    def residual(z: NDArray[np.float64]) -> NDArray[np.float64]:
        total = np.zeros(len(z))
        for y, shape, wake in zip(states(z), shapes, wakes, strict=True):
            plant.wake = wake
            total += shape[3] @ (plant.acceleration(y)[plant.elastic] - shape[2] @ z)
        return total / len(azimuths)

    reach = np.max([np.abs(s[0]) * plant.reach[plant.elastic, None] for s in shapes], axis=(0, 1))
    step = MOTION_STEP / reach
    for _ in range(passes if plant.with_air else 1):
        wakes = [plant.new_wake(y, rotor_speed) for y in states(unknown)]
        before = unknown.copy()
        jacobian = None
        for _ in range(25):
            r = residual(unknown)
            if jacobian is None:
                jacobian = np.column_stack([(residual(unknown + row) - r) / row.sum() for row in np.diag(step)])
            change = np.linalg.solve(jacobian, -r)
            unknown = unknown + change
            if not np.all(np.isfinite(unknown)):
                raise SimulationError("no steady operating point was found: the structure diverged")
            if (np.abs(change) * reach).max() < 1e-7:
                break
        else:
            raise SimulationError("no steady operating point was found: Newton's iteration did not converge")
        if (np.abs(unknown - before) * reach).max() < tolerance:
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


def _harmonics(
    plant: FrozenPlant, azimuth: float, rotor_speed: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
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


def _mean_outputs(
    plant: FrozenPlant, states: Sequence[NDArray[np.float64]], wakes: Sequence[Wake | None]
) -> NDArray[np.float64]:
    values = []
    for y, wake in zip(states, wakes, strict=True):
        plant.wake = wake
        values.append(plant.outputs(y, plant.rates(y)))
    out: NDArray[np.float64] = np.mean(values, axis=0)
    return out


def _present(plant: FrozenPlant, simulator: LinearizedSimulator) -> tuple[SteadyPoint, list[Wake | None]]:
    """The simulator's present state as an operating point, with its present wake."""
    state = simulator.state().arrays
    y = state["history_y"][-1].copy()
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


def _output_names(n_blades: int, chosen: str | Sequence[str] | None) -> tuple[str, ...]:
    """Channel names from channels and groups of blade channels."""
    known = [c.name for c in channel_table(n_blades) if c.group not in Extremes._fields]
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


def _differentiate(plant: FrozenPlant, point: SteadyPoint, k: int, output_names: tuple[str, ...]) -> LinearModel:
    """Central differences of rates and outputs about the state at one azimuth."""
    y, system = point.states[k], plant.system
    channels = [c.name for c in channel_table(plant.n_blades)]
    chosen = [channels.index(name) for name in output_names]
    turns = np.array([channels[i] in ("azimuth", "yaw_error") for i in chosen])
    locked = {plant.structure.azimuth_q, system.n_q + plant.structure.azimuth_u} if plant.hold_speed else set()
    kept = [i for i in range(system.n_state) if i not in locked]

    def evaluate(state: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        dy = plant.rates(state)
        return dy[kept], plant.outputs(state, dy)[chosen]

    def quotient(
        up: tuple[NDArray[np.float64], NDArray[np.float64]],
        down: tuple[NDArray[np.float64], NDArray[np.float64]],
        width: float,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
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
    names = tuple(system.state_names[i] for i in kept)
    return LinearModel(
        np.array(a).T, np.array(b).T, np.array(c).T, np.array(d).T, names, tuple(inputs), output_names, point
    )
