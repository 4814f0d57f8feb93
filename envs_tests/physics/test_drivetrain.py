"""Drive trains: gearboxes and geared rotors, generator and converter, losses, dips of the grid."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import curve_fit
from scipy.spatial.transform import Rotation

from wt_gym.base.errors import ActionError, SimulationError, TurbineDefinitionError, WtGymError
from wt_gym.control.design import rotor_inertia
from wt_gym.control.operating_point import operating_point
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.multibody.arrays import MultibodyError
from wt_gym.multibody.observer_frame.observer_frame_body import ObserverFrameError
from wt_gym.multibody.observer_frame.observer_frame_from_system import observer_frame_from_system
from wt_gym.multibody.observer_frame.observer_frame_kernels import accelerations
from wt_gym.multibody.system import Joint, MultibodySystem
from wt_gym.multibody.tree import output_kernels
from wt_gym.simulation import FIDELITIES, Simulator
from wt_gym.simulation.drivetrain.drives import DampingTorque, Drives
from wt_gym.simulation.drivetrain.faults import GeneratorLoss, VoltageDip
from wt_gym.simulation.fidelity import fidelity
from wt_gym.simulation.turbine_structure import build_structure
from wt_gym.structure.flexible_body import FlexibleBody
from wt_gym.turbines import load_turbine
from wt_gym.turbines.model import LossShares
from wt_gym.turbines.variants import electrical_power, shaft_damper_of, with_electrical
from wt_gym.wind import SteadyInflow

# ---- gearbox --------------------------------------------------------------------------------------------------------

RIGID = {"tower_coordinates": "rigid", "blade_coordinates": "rigid", "stiffest_shaft": 0.1}
IMPLICIT = {"integrator": "generalized_alpha", "blade_elements": 6}
FORMULATIONS = {
    "rigid": RIGID,
    "embedded": {},
    "yaw spring": {"yaw_drive": "spring"},
    "constrained": {"formulation": "constrained"},
    "nodal": {"tower_coordinates": "nodal", "blade_coordinates": "nodal", **IMPLICIT},
    "mixed": {"formulation": "constrained", "blade_coordinates": "nodal", **IMPLICIT},
    "several bodies": {"blade_bodies": 3, **IMPLICIT},
    "observer": {"formulation": "observer"},
}
YAW_RATE = np.radians(0.25)
TIP = np.array([[0.0, 0.0, 61.0]])


def reversing(turbine, reverses=True):
    """The turbine with a gearbox that reverses."""
    return replace(turbine, drivetrain=replace(turbine.drivetrain, gearbox_reverses=reverses))


# ---- one rotor on one carrier ----------------------------------------------------------------------------------------


INERTIA = 0.7
"""Of the rotor [kg m²]."""


def gyrostat(ratio):
    """A free rigid carrier with a disc on a hinge, to which a rotor in the carrier is geared."""
    system = MultibodySystem()
    turn = Rotation.from_euler("xyz", (0.3, -0.4, 0.5)).as_matrix()
    carrier = FlexibleBody.rigid("carrier", 5.0, (0.3, 0.1, 0.5), np.diag([2.0, 3.0, 4.0]), {"end": (0.2, 0.0, 1.0)})
    carrier = system.add(carrier, Joint("free", name="float"))
    disc = FlexibleBody.rigid("disc", 1.5, (0.1, -0.2, 0.3), np.diag([0.5, 0.3, 0.4]))
    axis = tuple(np.array([2.0, -1.0, 2.0]) / 3.0)
    hinge = Joint("revolute", axis, turn, (0.1, 0.2, 0.0), name="turn", rotor_inertia=INERTIA, rotor_ratio=ratio)
    system.add(disc, hinge, carrier, "end")
    return system.build(), turn @ axis


def momenta(system, y, along, ratio):
    """Momentum (3,), angular momentum about the origin (3,) and kinetic energy, body by body and rotor by itself."""
    work = system.new_work()
    output_kernels.energies(y, system.tree, work)
    p, h, energy = np.zeros(3), np.zeros(3), 0.0
    for b, body in enumerate(system.bodies):
        m, c = body.inertia.mass, body.inertia.c0 / body.inertia.mass
        about_center = body.inertia.j0 - m * (c @ c * np.eye(3) - np.outer(c, c))
        rot, w = work.rot[b], work.omega[b]
        velocity = rot @ (work.v[b] + np.cross(w, c))
        p += m * velocity
        h += np.cross(work.r[b] + rot @ c, m * velocity) + rot @ about_center @ w
        energy += 0.5 * m * velocity @ velocity + 0.5 * w @ about_center @ w
    spin = along @ work.omega[0] + ratio * y[system.n_q + 6]
    h += INERTIA * spin * (work.rot[0] @ along)
    return np.concatenate([p, h, [energy + 0.5 * INERTIA * spin**2]])


@pytest.mark.parametrize("ratio", [1.0, 12.0, -12.0, 0.3, -1.0])
def test_momentum_angular_momentum_and_energy_determine_every_acceleration(ratio):
    """Seven laws for the seven accelerations of carrier and hinge: none can be wrong."""
    system, along = gyrostat(ratio)
    system.tree = system.tree._replace(gravity=np.zeros(3))
    rng = np.random.default_rng(4)
    for _ in range(3):
        y = system.initial_state()
        y[:3], y[7] = rng.standard_normal(3), rng.standard_normal()
        y[3:7] = rng.standard_normal(4)
        y[3:7] /= np.linalg.norm(y[3:7])
        y[8:] = rng.standard_normal(7)
        dy, step = system.rates(y), 1e-5
        ahead, behind = (momenta(system, y + s * dy, along, ratio) for s in (step, -step))
        np.testing.assert_allclose((ahead - behind) / (2.0 * step), 0.0, atol=1e-7 * np.abs(ahead).max())
        assert system.energy(y)[0] == pytest.approx(momenta(system, y, along, ratio)[6], rel=1e-12)


@pytest.mark.parametrize("ratio", [12.0, -12.0])
def test_observer_frames_give_the_same_accelerations(ratio):
    system, _ = gyrostat(ratio)
    y = system.initial_state()
    y[8:] = np.random.default_rng(6).standard_normal(7)
    expected = system.rates(y)[8:]
    observed = observer_frame_from_system(system, y=y, torques={})
    model, state, work = observed.pack()
    assert accelerations(np.zeros((0, 6)), model, state, work) == 0
    rotation, turn = state.rotation[0], np.cross(state.omega[0], state.rotation[0].T @ state.velocity[0])
    np.testing.assert_allclose(state.a[0, :3], rotation.T @ expected[:3], atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(state.a[0, 3:6], expected[3:6], atol=1e-9 * np.abs(expected).max())
    assert np.abs(turn).max() > 0.0


def test_what_is_refused():
    rotor = {"rotor_inertia": 1.0, "rotor_ratio": 3.0}
    with pytest.raises(MultibodyError, match=r"fixed joint '': rotor_inertia must be 0, got 1\.0: joint type 'fixed'"):
        Joint("fixed", **rotor)
    with pytest.raises(MultibodyError, match=r"rotor_inertia must be a finite number >= 0, got -1\.0"):
        Joint("revolute", rotor_inertia=-1.0)
    with pytest.raises(MultibodyError, match="rotor_ratio must be a finite number, got nan"):
        Joint("revolute", rotor_inertia=1.0, rotor_ratio=np.nan)
    structure = build_structure(load_turbine("nrel_5mw"), FIDELITIES["training"], TIP)
    tower, disc = structure.system.bodies[structure.tower], FlexibleBody.rigid("disc", 1.0, np.zeros(3), np.eye(3))
    system = MultibodySystem()
    system.add(tower, Joint("fixed"))
    with pytest.raises(MultibodyError, match="needs bearings in a rigid body, but 'tower' has 5 elastic coordinates"):
        system.add(disc, Joint("revolute", **rotor), 0, "tip")
    system.add(disc, Joint("free"))
    names = tuple(f"mast_{name}" for name in tower.coordinate_names)
    system.add(replace(tower, name="mast", coordinate_names=names), Joint("revolute", name="turn", **rotor), 1)
    beams = dict.fromkeys(("tower", "mast"), structure.tower_field)
    with pytest.raises(ObserverFrameError, match="a rotor may be geared to the joint of a rigid body only"):
        observer_frame_from_system(system.build(), beams)
    with pytest.raises(WtGymError, match="gearbox_reverses"):
        reversing(load_turbine("nrel_5mw"), "yes")


# ---- the turbine -----------------------------------------------------------------------------------------------------


def nacelle_moment(structure, speed, yaw_rate, torque, rigidly):
    """Moment (3,) of the yaw bearing on the nacelle, its axes, and the accelerations (n_u,).

    ``rigidly``: shaft, blades and tower keep the accelerations zero, so that they move as one rigid rotor.
    """
    system = structure.system
    y, inputs, work = system.initial_state(), system.new_inputs(), system.new_work()
    y[system.n_q + structure.azimuth_u] = speed
    inputs.servo_interval[:] = 1.0  # prescribed
    drive = structure.nacelle if system.joints[structure.nacelle].kind == "servo" else structure.nacelle - 1
    servo = system.index(drive, "servo")
    inputs.servo_rate[:, servo] = inputs.servo_command[1, servo] = yaw_rate
    y[system.n_q + system.n_u + system.n_servo + servo] = yaw_rate
    system.place_free_bodies(y)
    inputs.dof_force[:, structure.azimuth_u] = -torque
    rates = system.rates(y, inputs, work)[system.n_q : system.n_q + system.n_u]
    if rigidly:
        rates = rates.copy()
        for b in structure.lattice_bodies:
            first = system.index(b, "joint_u")
            if system.joints[b].kind == "free":
                carry_frame(structure, work, b, rates[first : first + 6])
        rates[:] = rates * free_frames(structure)
    wrench = np.zeros((len(system.bodies), 6))
    loads = np.zeros_like(work.loads)
    output_kernels.joint_wrenches(y, rates, loads, system.tree, work, wrench)
    return wrench[structure.nacelle, 3:], rates


def free_frames(structure):
    """Ones at the velocities (n_u,) of free bodies, zeros elsewhere."""
    system, out = structure.system, np.zeros(structure.system.n_u)
    for b, joint in enumerate(system.joints):
        if joint.kind == "free":
            first = system.index(b, "joint_u")
            out[first : first + 6] = 1.0
    return out


def carry_frame(structure, work, b, out):
    """Accelerations (6,) of the frame of a free blade that the hub carries rigidly."""
    hub, rot = structure.hub, work.rot
    lever = work.r[b] - work.r[hub]
    omega, turning = rot[hub] @ work.omega[hub], rot[hub] @ work.bias_ang[hub]
    out[:3] = rot[hub] @ work.bias_lin[hub] + np.cross(turning, lever) + np.cross(omega, np.cross(omega, lever))
    out[3:] = rot[b].T @ turning


@pytest.fixture(scope="module")
def structures():
    """Turbines as they are asked for, built once: (turbine, formulation, reverses) -> Turbine, TurbineStructure."""
    known = {}

    def get(name, formulation, reverses=False):
        key = name, formulation, reverses
        if key not in known:
            turbine = reversing(load_turbine(name), reverses)
            fidelity = replace(FIDELITIES["training"], **FORMULATIONS[formulation])
            known[key] = turbine, build_structure(turbine, fidelity, TIP)
        return known[key]

    return get


def axial_inertia(structure):
    """Of hub and undeformed blades about the shaft [kg m²], by the parallel-axis rule from the bodies' own tensors."""
    system = structure.system
    y, work = system.initial_state(), system.new_work()
    system.place_free_bodies(y)
    output_kernels.energies(y, system.tree, work)
    along, total = work.rot[structure.hub][:, 0], 0.0
    for b in (structure.hub, *structure.lattice_bodies):
        inertia = system.bodies[b].inertia
        lever, first = work.r[b] - work.r[structure.hub], work.rot[b] @ inertia.c0
        across = lever - along * (along @ lever)
        total += along @ work.rot[b] @ inertia.j0 @ work.rot[b].T @ along
        total += inertia.mass * across @ across + 2.0 * across @ (first - along * (along @ first))
    return total


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize(("name", "reverses"), [("nrel_5mw", False), ("nrel_5mw", True), ("iea_15mw", False)])
def test_gyroscopic_moment_of_a_yawing_nacelle(structures, name, formulation, reverses):
    """(I_r ± N J_g) Ω ψ̇ cos τ about the lateral axis, for both signs of the yaw rate."""
    turbine, structure = structures(name, formulation, reverses)
    drive = turbine.drivetrain
    speed, sign = drive.rated_rotor_speed, -1.0 if reverses else 1.0
    still = nacelle_moment(structure, speed, 0.0, 0.0, True)[0][1]
    spin = axial_inertia(structure) + sign * drive.gear_ratio * drive.generator_inertia
    for rate in (YAW_RATE, -YAW_RATE):
        found = nacelle_moment(structure, speed, rate, 0.0, True)[0][1] - still
        unsteady = nacelle_moment(structure, 0.0, rate, 0.0, True)[0][1] - nacelle_moment(
            structure, 0.0, 0.0, 0.0, True)[0][1]  # fmt: skip
        expected = spin * speed * rate * np.cos(turbine.nacelle.tilt)
        assert found - unsteady == pytest.approx(expected, rel=1e-9)


def test_roll_moment_of_the_published_turbine(structures):
    """970 kN m at the low-speed shaft reach the tower of the NREL 5-MW as 860.1 kN m."""
    along = np.array([np.cos(np.radians(5.0)), 0.0, -np.sin(np.radians(5.0))])
    structure = structures("nrel_5mw", "rigid")[1]
    moments = [nacelle_moment(structure, 1.0, 0.0, torque, False)[0] @ along for torque in (0.0, 970e3)]
    assert moments[0] - moments[1] == pytest.approx(860.1e3, rel=1e-4)


@pytest.mark.parametrize("reverses", [False, True])
def test_roll_moment_after_a_step_of_torque(structures, reverses):
    """The tower of a rigid turbine feels N T_g + (N² ∓ N) J_g α about the shaft."""
    turbine, structure = structures("nrel_5mw", "rigid", reverses)
    drive, tilt = turbine.drivetrain, turbine.nacelle.tilt
    n, sign = drive.gear_ratio, -1.0 if reverses else 1.0
    along, torque = np.array([np.cos(tilt), 0.0, -np.sin(tilt)]), n * 1e4
    (before, none), (after, rates) = (nacelle_moment(structure, 1.2, 0.0, t, False) for t in (0.0, torque))
    alpha = (rates - none)[structure.azimuth_u]
    expected = -(torque + (n**2 - sign * n) * drive.generator_inertia * alpha)
    assert (after - before) @ along == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("reverses", [False, True])
def test_roll_moment_of_a_damper(reverses):
    """A generator that is a damper brakes by c Ω, the tower feels it and what its rotor takes in, as of a torque."""
    turbine = reversing(load_turbine("nrel_5mw"), reverses)
    fidelity = replace(FIDELITIES["training"], **RIGID)
    along = np.array([np.cos(turbine.nacelle.tilt), 0.0, -np.sin(turbine.nacelle.tilt)])
    free, damped = (build_structure(turbine, fidelity, TIP, damping) for damping in (0.0, 8e5))
    (before, _), (after, rates) = (nacelle_moment(s, 1.2, 0.0, 0.0, False) for s in (free, damped))
    exact = nacelle_moment(free, 1.2, 0.0, 1.2 * 8e5, False)
    assert (after - before) @ along == pytest.approx((exact[0] - before) @ along, rel=1e-12)
    assert rates[0] == pytest.approx(exact[1][0], rel=1e-12)


# ---- generator and converter ----------------------------------------------------------------------------------------

TURBINE = load_turbine("nrel_5mw")
DRIVE = TURBINE.drivetrain
RATED, N, ETA = DRIVE.rated_rotor_speed, DRIVE.gear_ratio, DRIVE.generator_efficiency
FULL = DRIVE.rated_power / (ETA * RATED * N)
WIND = SteadyInflow(15.0)


def torques(drives, demand, steps, dt, faults=(), speed=RATED, first=20e3):
    """Torque after each step [N m]."""
    drives.start(0.1, 0.0, speed, first)
    clock, found = [0.0], []
    drives.fail(faults, lambda: clock[0])
    for k in range(steps):
        drives.follow(np.full(3, 0.1), 0.0, demand, dt, speed)
        found.append(drives.command.item(0))
        clock[0] = (k + 1) * dt
    return np.array(found)


# ---- lag ----


@pytest.mark.parametrize("dt", [0.02, 0.1])
def test_the_step_response_is_that_of_first_order(dt):
    lagged = with_electrical(TURBINE, torque_lag=0.3)
    found = torques(Drives(lagged), 21e3, 50, dt)
    time = dt * np.arange(1, 51)
    np.testing.assert_allclose(found, 20e3 + 1e3 * (1.0 - np.exp(-time / 0.3)), rtol=1e-12)


def test_limits_of_rate_and_torque_hold_with_a_lag_too():
    lagged = Drives(with_electrical(TURBINE, torque_lag=0.05))
    found = torques(lagged, 60e3, 100, 0.1)
    assert np.diff(found).max() == pytest.approx(0.1 * DRIVE.max_torque_rate)
    assert found[-1] == pytest.approx(DRIVE.max_generator_torque)
    assert torques(lagged, -1e4, 100, 0.1)[-1] == pytest.approx(0.0, abs=1e-6)


# ---- losses ----


def test_rated_losses_are_those_of_the_efficiency_and_parts_add_up():
    for shares in (LossShares(), LossShares(1.0, 0.0, 0.0), LossShares(0.2, 0.3, 0.5)):
        mapped = with_electrical(TURBINE, losses=shares).drivetrain
        assert electrical_power(mapped, RATED * N, FULL) == pytest.approx(DRIVE.rated_power)
        assert electrical_power(mapped, RATED * N, 0.0) == 0.0
    assert electrical_power(DRIVE, 100.0, 1e4) == pytest.approx(100.0 * 1e4 * ETA)


def test_copper_losses_go_with_the_square_of_the_torque_and_iron_losses_with_the_speed():
    lost = (1.0 / ETA - 1.0) * DRIVE.rated_power
    copper = with_electrical(TURBINE, losses=LossShares(1.0, 0.0, 0.0)).drivetrain
    iron = with_electrical(TURBINE, losses=LossShares(0.0, 1.0, 0.0)).drivetrain
    converter = with_electrical(TURBINE, losses=LossShares(0.0, 0.0, 1.0)).drivetrain
    for x, t in ((0.6, 0.4), (0.9, 1.0)):
        speed, torque = x * RATED * N, t * FULL
        found = [(speed * torque - electrical_power(one, speed, torque)) / lost for one in (copper, iron, converter)]
        p = x * t
        known = [t**2, 0.5 * (x + x**2), (1.0 + 10.0 * (t + p) + 5.0 * (t**2 + p**2)) / 31.0]
        np.testing.assert_allclose(found, known, rtol=1e-9)


def test_power_in_the_simulation_is_that_of_the_map_and_nothing_else_changes():
    """Energy: what the shaft gives is what the grid gets and what is lost."""
    runs = []
    for turbine in (TURBINE, with_electrical(TURBINE, losses=LossShares())):
        simulator = Simulator(turbine, inflow=WIND)
        simulator.reset(rotor_speed=0.9 * RATED, pitch=0.15, generator_torque=30e3)
        runs.append([simulator.advance(0.1, 0.15, 0.0, 30e3 + 500.0 * k) for k in range(20)])
    mapped = with_electrical(TURBINE, losses=LossShares()).drivetrain
    for sound, own in zip(*runs, strict=True):
        shaft = own["generator_speed"] * own["generator_torque"]
        assert own["generator_power"] == pytest.approx(
            electrical_power(mapped, own["generator_speed"], own["generator_torque"]), rel=1e-12
        )
        assert own["generator_power"] < 0.99 * shaft
        assert abs(own["generator_power"] / sound["generator_power"] - 1.0) > 1e-4
        assert {name for name in sound if sound[name] != own[name]} == {"generator_power"}


# ---- damping of the shaft ----

BARE = replace(TURBINE, drivetrain=replace(DRIVE, damper=0.0))
"""Nothing but the converter damps its shaft."""
STIFF = replace(fidelity("training"), name="stiff", blade_coordinates="rigid", tower_coordinates="rigid")


def swinging(turbine, dt, duration=4.0, pulse=1.5e3, faults=(), fidelity=STIFF):
    """Twist rate of the shaft [rad/s] and torque [N m] in steady wind, the torque raised during the first 0.1 s."""
    simulator, point = Simulator(turbine, WIND, replace(fidelity, time_step=dt)), operating_point(TURBINE, 15.0)
    simulator.faults = faults
    simulator.reset(rotor_speed=point.rotor_speed, pitch=point.pitch)
    found, torque = [], simulator.signals["generator_torque"]
    for k in range(round(duration / dt)):
        signals = simulator.advance(dt, point.pitch, 0.0, torque + (pulse if k * dt < 0.099 else 0.0))
        found.append((signals["generator_speed"] / N - signals["rotor_speed"], signals["generator_torque"]))
    return np.array(found).T


def modes(twisting, dt, order):
    """Frequency [Hz] and damping ratio of each vibration in a free response, by a matrix pencil, weak ones left out."""
    n = len(twisting)
    hankel = np.array([twisting[k : k + n // 2] for k in range(n - n // 2)])
    _, size, vt = np.linalg.svd(hankel, full_matrices=False)
    keep = min(order, int((size > 1e-3 * size[0]).sum()))
    left, right = vt[:keep, :-1].T, vt[:keep, 1:].T
    poles = np.log(np.linalg.eigvals(np.linalg.pinv(left) @ right).astype(complex)) / dt
    return [(abs(pole) / (2.0 * math.pi), -pole.real / abs(pole)) for pole in poles if pole.imag > 0.0]


def decay(twisting, dt):
    """Frequency [rad/s] and damping ratio of a vibration that dies, by least squares."""
    time = dt * np.arange(1, len(twisting) + 1)

    def vibration(t, ratio, frequency, a, b):
        damped = frequency * math.sqrt(1.0 - ratio**2)
        return np.exp(-ratio * frequency * t) * (a * np.cos(damped * t) + b * np.sin(damped * t))

    (ratio, frequency, *_), _ = curve_fit(vibration, time, twisting, [0.05, 13.9, 0.0, 0.0])
    return frequency, ratio


def test_the_frequency_of_the_shaft_is_the_published_one():
    """2.2 Hz and 5 % of the published 6.215e6 N m s/rad (Jonkman et al., NREL/TP-500-38060, table 6-1)."""
    damper = shaft_damper_of(TURBINE, 0.05)
    assert damper.frequency / (2.0 * math.pi) == pytest.approx(2.2, rel=0.02)
    assert DRIVE.damper * damper.frequency / (2.0 * DRIVE.spring) == pytest.approx(0.05, rel=0.02)


@pytest.mark.parametrize(("dt", "ratio"), [(0.02, 0.05), (0.05, 0.1), (0.1, 0.05)])
def test_the_converter_adds_its_damping_ratio_to_two_rigid_inertias(dt, ratio):
    free, damped = (
        decay((swinging(turbine, dt)[0] - swinging(turbine, dt, pulse=0.0)[0])[round(0.2 / dt) :], dt)
        for turbine in (BARE, with_electrical(BARE, shaft_damping=ratio))
    )
    assert free[0] == pytest.approx(shaft_damper_of(TURBINE, 0.1).frequency, rel=0.01)
    assert damped[1] - free[1] == pytest.approx(ratio, rel=0.1)
    assert damped[0] == pytest.approx(free[0], rel=0.02)


def test_a_damper_is_at_rest_at_constant_speed_and_within_the_limits_of_the_generator():
    damped = Drives(with_electrical(TURBINE, shaft_damping=0.1))
    assert type(damped.generator) is DampingTorque
    np.testing.assert_array_equal(torques(damped, 21e3, 30, 0.1), torques(Drives(TURBINE), 21e3, 30, 0.1))
    for first, sign in ((0.0, -1.0), (DRIVE.max_generator_torque, 1.0)):
        damped.start(0.1, 0.0, RATED, first)
        for k in range(20):
            damped.follow(np.full(3, 0.1), 0.0, first, 0.1, RATED * (1.0 + sign * 0.1 * (k % 2)))
            assert 0.0 <= damped.torque(RATED) <= DRIVE.max_generator_torque
            assert damped.command[0] == damped.torque(RATED)


@pytest.mark.parametrize(("faults", "demand"), [([GeneratorLoss(0.0)], 20e3), ([], 0.0)], ids=["lost", "off"])
def test_a_generator_that_is_lost_or_off_damps_nothing(faults, demand):
    damped = Drives(with_electrical(TURBINE, shaft_damping=0.1))
    damped.fail(faults, lambda: 1.0)
    damped.start(0.1, 0.0, RATED, demand)
    for k in range(5):
        damped.follow(np.full(3, 0.1), 0.0, demand, 0.1, RATED * (1.0 + 0.02 * (-1) ** k))
        assert damped.torque(RATED) == 0.0


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_after_a_dip_the_demand_begins_again_where_it_was_cut(sign):
    """Whatever the damper did at the cut, the torque that is asked for returns as without a damper, within a step."""
    asked = []
    for turbine, place in ((TURBINE, 0), (with_electrical(TURBINE, shaft_damping=0.2), 1)):
        drives, clock = Drives(turbine), [0.0]
        drives.fail([VoltageDip(0.5, 0.2, 0.15, 20.0)], lambda clock=clock: clock[0])
        drives.start(0.1, 0.0, RATED, 40e3)
        found = []
        for k in range(20):
            speed = RATED * (1.0 + (0.02 * sign * (-1) ** k if place else 0.0))
            drives.follow(np.full(3, 0.1), 0.0, 40e3, 0.1, speed)
            found.append(drives.generator_command[place])
            clock[0] = 0.1 * (k + 1)
        asked.append(found)
    reach = 0.1 * DRIVE.max_torque_rate
    np.testing.assert_allclose(asked[1][:5], asked[0][:5])
    np.testing.assert_allclose(asked[1][7:], asked[0][7:], atol=reach)


def test_in_the_model_that_trains_the_first_torsion_is_damped_and_the_second_not_excited():
    """Blades that bend make 1.7 and 4 Hz of the 2.2 Hz of two rigid inertias."""
    ratios = []
    for damping in (0.0, 0.05):
        flexible = replace(fidelity("training"), name="flexible", tower_coordinates="rigid")
        own = BARE if damping == 0.0 else with_electrical(BARE, shaft_damping=damping)
        twisting = swinging(own, 0.1, 8.0, fidelity=flexible)[0] - swinging(own, 0.1, 8.0, 0.0, fidelity=flexible)[0]
        ratios.append(modes(twisting[2:], 0.1, 24))
    for known, least in ((1.67, 0.03), (4.0, 0.0)):
        free, damped = (next(z for f, z in found if abs(f / known - 1.0) < 0.06) for found in ratios)
        assert damped - free > least


def test_a_damper_without_a_shaft_that_twists_or_with_a_long_step_is_refused():
    damped = with_electrical(TURBINE, shaft_damping=0.1)
    with pytest.raises(SimulationError, match=r"rigid at this fidelity"):
        Simulator(damped, WIND, replace(fidelity("training"), stiffest_shaft=1.0))
    with pytest.raises(SimulationError, match=r"aerodynamic step of at most 0\.143 s"):
        Simulator(damped, WIND, replace(fidelity("training"), time_step=0.2))
    with pytest.raises(TurbineDefinitionError, match=r"damping_ratio of a ShaftDamper"):
        with_electrical(TURBINE, shaft_damping=0.5)


# ---- dips ----


def test_the_torque_has_the_impulse_of_the_dip_whatever_the_step():
    """Zero for 150 ms, then a ramp of the power of 2 a second up to the torque: its area in closed form."""
    dip, share = VoltageDip(0.23, 0.1, 0.15, 2.0), 0.8
    lost = 0.15 * (share - 0.1) + 0.5 * (share - 0.1) ** 2 / 2.0
    for dt in (0.01, 0.05, 0.1, 1.0):
        means = [dip.mean_limited(share, k * dt, dt) for k in range(round(2.0 / dt))]
        assert dt * (share - np.array(means)).sum() == pytest.approx(lost, rel=1e-9)
    assert dip.mean_limited(1.1, 0.0, 0.1) == pytest.approx(1.1)  # an overload before is no matter of the grid
    assert [dip.voltage(t) for t in (0.2, 0.3, 0.43, 2.0)] == pytest.approx([1.0, 0.1, 0.2, 1.0])


def test_a_dip_is_felt_at_once_and_leaves_at_the_greatest_rate():
    found = torques(Drives(TURBINE), 20e3, 40, 0.1, [VoltageDip(1.0, 0.2, 0.2, 5.0)])
    np.testing.assert_array_equal(found[:10], 20e3)
    np.testing.assert_allclose(found[10:12], 0.2 * FULL)
    assert np.diff(found[12:]).max() <= 0.1 * DRIVE.max_torque_rate * (1.0 + 1e-9)
    assert found[-1] == 20e3


@pytest.mark.parametrize("remaining", [0.0, 0.5])
def test_the_rotor_speeds_up_by_the_torque_that_is_missing(remaining):
    """J (omega - omega_0) = int [N (T_0 - T) + M - M_0] dt of a rigid shaft, against a run without the dip.

    Blades swing edgewise once a second beside the hub: the last second is averaged.
    """
    stiff = replace(TURBINE, drivetrain=replace(DRIVE, spring=1e13))
    point, runs = operating_point(TURBINE, 15.0), []
    for faults in ((), (VoltageDip(0.5, remaining, 0.15, 10.0),)):
        simulator = Simulator(stiff, inflow=WIND)
        simulator.faults = faults
        simulator.reset(rotor_speed=point.rotor_speed, pitch=point.pitch, generator_torque=point.generator_torque)
        found = [simulator.advance(0.1, point.pitch, 0.0, point.generator_torque) for _ in range(30)]
        names = "rotor_speed", "generator_torque", "aero_torque"
        runs.append(np.array([[signals[name] for name in names] for signals in found]))
    assert not simulator.structure.shaft_flexible
    rise, more_torque, more_moment = (runs[1] - runs[0]).T
    assert np.all(rise[:5] == 0.0)
    moment = np.concatenate([[0.0], 0.5 * (more_moment[1:] + more_moment[:-1])])
    impulse = 0.1 * np.cumsum(moment - N * more_torque / DRIVE.gearbox_efficiency)
    assert rotor_inertia(TURBINE) * rise[-10:].mean() == pytest.approx(impulse[-10:].mean(), rel=0.03)
    assert rise[-1] > 0.005


# ---- environment ----


def test_options_reach_simulator_controller_alone_and_info():
    env = WindTurbineEnv(
        inflow=WIND, action_mode="residual", action_components=("pitch",), control_dt=0.1, relative_reward=True,
        torque_lag=0.2, loss_map=True, shaft_damping=0.1, fault_kinds=("none", "voltage_dip"),
    )  # fmt: skip
    _, info = env.reset(seed=0, options={"fault": {"kind": "voltage_dip", "time": 0.5, "size": 0.3}})
    assert env.simulator.turbine.drivetrain.torque_lag == 0.2
    assert env.simulator.turbine.drivetrain.losses == LossShares()
    assert env.simulator.turbine.drivetrain.shaft_damper == shaft_damper_of(TURBINE, 0.1)
    assert info["grid_voltage"] == 1.0
    rows = [env.step(np.zeros(1)) for _ in range(12)]
    assert [row[4]["grid_voltage"] for row in rows][5] == pytest.approx(0.3)
    assert all(row[1] == 0.0 for row in rows)
    powers = [row[4]["generator_power"] for row in rows]
    assert min(powers) < 0.5 * powers[0]
    kept = env.snapshot()
    first = [env.step(np.ones(1))[0] for _ in range(5)]
    env.restore(kept)
    np.testing.assert_array_equal(first, [env.step(np.ones(1))[0] for _ in range(5)])
    _, info = env.reset(seed=0, options={"fault": "none"})
    assert "grid_voltage" not in info


def test_what_has_no_meaning_is_refused():
    with pytest.raises(TurbineDefinitionError, match=r"LossShares must be shares whose sum is 1"):
        LossShares(0.5, 0.5, 0.5)
    with pytest.raises(TurbineDefinitionError, match=r"Drivetrain.torque_lag"):
        with_electrical(TURBINE, torque_lag=3.0)
    for values, message in (
        ((0.0, -0.1), "remaining voltage"),
        ((0.0, 1.1), "at most 1"),
        ((0.0, 0.5, 0.0), "duration"),
    ):
        with pytest.raises(ActionError, match=message):
            VoltageDip(*values)
