"""The generator turns at the speed of its own shaft: exact moments on the nacelle, in every formulation."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wt_gym.base.errors import WtGymError
from wt_gym.multibody.arrays import MultibodyError
from wt_gym.multibody.observer_frame.observer_frame_body import ObserverFrameError
from wt_gym.multibody.observer_frame.observer_frame_from_system import Translation, observer_frame_from_system
from wt_gym.multibody.observer_frame.observer_frame_kernels import accelerations, hold_velocities
from wt_gym.multibody.system import Joint, MultibodySystem
from wt_gym.multibody.tree import output_kernels
from wt_gym.simulation import FIDELITIES, Simulator
from wt_gym.simulation.turbine_structure import build_structure
from wt_gym.structure.flexible_body import FlexibleBody
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow

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
YAW_RATE, TORQUE = np.radians(0.25), 1e4
TIP = np.array([[0.0, 0.0, 61.0]])


def reversing(turbine, reverses=True):
    """The turbine with a gearbox that reverses."""
    return replace(turbine, drivetrain=replace(turbine.drivetrain, gearbox_reverses=reverses))


# ---- one rotor on one carrier ----------------------------------------------------------------------------------------


def gyrostat(ratio, inertia=0.7):
    """A free rigid carrier with a disc on a hinge, to which a rotor in the carrier is geared."""
    system = MultibodySystem()
    turn = Rotation.from_euler("xyz", (0.3, -0.4, 0.5)).as_matrix()
    carrier = FlexibleBody.rigid("carrier", 5.0, (0.3, 0.1, 0.5), np.diag([2.0, 3.0, 4.0]), {"end": (0.2, 0.0, 1.0)})
    carrier = system.add(carrier, Joint("free", name="float"))
    disc = FlexibleBody.rigid("disc", 1.5, (0.1, -0.2, 0.3), np.diag([0.5, 0.3, 0.4]))
    axis = tuple(np.array([2.0, -1.0, 2.0]) / 3.0)
    hinge = Joint("revolute", axis, turn, (0.1, 0.2, 0.0), name="turn", rotor_inertia=inertia, rotor_ratio=ratio)
    system.add(disc, hinge, carrier, "end")
    return system.build(), turn @ axis


def momenta(system, y, along, ratio, inertia):
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
    h += inertia * spin * (work.rot[0] @ along)
    return np.concatenate([p, h, [energy + 0.5 * inertia * spin**2]])


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
        ahead, behind = (momenta(system, y + s * dy, along, ratio, 0.7) for s in (step, -step))
        np.testing.assert_allclose((ahead - behind) / (2.0 * step), 0.0, atol=1e-7 * np.abs(ahead).max())
        assert system.energy(y)[0] == pytest.approx(momenta(system, y, along, ratio, 0.7)[6], rel=1e-12)


def test_ratio_of_one_is_a_rotor_on_the_body():
    """A direct drive: the same matrices bit for bit as with the inertia in the body."""
    geared, _ = gyrostat(1.0)
    system = MultibodySystem()
    for body, joint, parent, marker in zip(geared.bodies, geared.joints, (None, 0), ("origin", "end"), strict=True):
        tensor = joint.rotor_inertia * np.outer(joint.axis, joint.axis)
        inertia = replace(body.inertia, j0=body.inertia.j0 + tensor)
        system.add(replace(body, inertia=inertia), replace(joint, rotor_inertia=0.0), parent, marker)
    y = system.build().initial_state()
    y[8:] = np.random.default_rng(5).standard_normal(7)
    assert np.array_equal(system.rates(y), geared.rates(y))


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


def test_published_rotor_gives_the_known_moment(structures):
    """NREL 5-MW: 43.784725e6 kg m² at the low speed (NREL/TP-500-38060, section 7), 97² × 534.116 of the generator.

    The blade here, from the table of sections with its mass factor, has 0.3 % more than this figure.
    """
    rotor = 43784725.0 - 97.0**2 * 534.116
    expected = (rotor + 97.0 * 534.116) * 12.1 * np.pi / 30.0 * YAW_RATE * np.cos(np.radians(5.0))
    moments = [nacelle_moment(structures("nrel_5mw", "rigid")[1], 12.1 * np.pi / 30.0, rate, 0.0, True)[0][1]
               for rate in (YAW_RATE, -YAW_RATE)]  # fmt: skip
    assert 0.5 * (moments[0] - moments[1]) == pytest.approx(expected, rel=4e-3)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize(("name", "reverses"), [("nrel_5mw", False), ("nrel_5mw", True), ("iea_15mw", False)])
def test_roll_moment_after_a_step_of_torque(structures, name, formulation, reverses):
    """The tower feels N T_g + (N² ∓ N) J_g α about the shaft, whatever the shaft and the blades do."""
    turbine, structure = structures(name, formulation, reverses)
    drive, tilt = turbine.drivetrain, turbine.nacelle.tilt
    n, sign = drive.gear_ratio, -1.0 if reverses else 1.0
    torque = n * TORQUE
    along = np.array([np.cos(tilt), 0.0, -np.sin(tilt)])
    system = structure.system
    speed = drive.rated_rotor_speed
    (before, none), (after, rates) = (nacelle_moment(structure, speed, 0.0, t, False) for t in (0.0, torque))
    change = rates - none
    # what the nacelle and the bodies behind the gearbox have gained, apart from generator and torque
    moved = system.tree._replace(dof_inertia=np.zeros(system.n_u), j0=system.tree.j0 - system.rotor_tensors)
    y, work, wrench = system.initial_state(), system.new_work(), np.zeros((2, len(system.bodies), 6))
    y[system.n_q + structure.azimuth_u] = speed
    system.place_free_bodies(y)
    output_kernels.energies(y, moved, work)
    for k, acceleration in enumerate((none, rates)):
        output_kernels.joint_wrenches(y, acceleration, np.zeros_like(work.loads), moved, work, wrench[k])
    rest = (wrench[1] - wrench[0])[structure.nacelle, 3:] @ along
    roll = sum_of_roll(structure, work, change) @ along
    alpha = change[structure.azimuth_u]
    expected = rest + drive.generator_inertia * (roll + sign * n * alpha)
    assert (after - before) @ along == pytest.approx(expected, rel=1e-9)
    if formulation == "rigid":
        assert (after - before) @ along == pytest.approx(
            -(torque + (n**2 - sign * n) * drive.generator_inertia * alpha), rel=1e-12
        )


def sum_of_roll(structure, work, change):
    """Angular acceleration (3,) of the nacelle for accelerations (n_u,), in its axes."""
    tree, b = structure.system.tree, structure.nacelle
    n = tree.n_col[b]
    return work.va[b, :, :n] @ change[tree.cols[b, :n]]


def test_roll_moment_of_the_published_turbine(structures):
    """970 kN m at the low-speed shaft reach the tower of the NREL 5-MW as 860.1 kN m."""
    along = np.array([np.cos(np.radians(5.0)), 0.0, -np.sin(np.radians(5.0))])
    structure = structures("nrel_5mw", "rigid")[1]
    moments = [nacelle_moment(structure, 1.0, 0.0, torque, False)[0] @ along for torque in (0.0, 970e3)]
    assert moments[0] - moments[1] == pytest.approx(860.1e3, rel=1e-4)


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


@pytest.mark.parametrize("reverses", [False, True])
def test_turbine_in_observer_frames_accelerates_like_the_tree(structures, reverses):
    """All accelerations under a torque, with the nacelle at rest and the rotor at speed."""
    _, structure = structures("nrel_5mw", "observer", reverses)
    system = structure.system
    y, inputs = system.initial_state(), system.new_inputs()
    y[system.n_q + structure.azimuth_u] = 1.2
    y[system.n_q + structure.system.index(structure.tower, "elastic_u") + 1] = 5.0
    inputs.dof_force[:, structure.azimuth_u] = -1e6
    expected = system.rates(y, inputs)[system.n_q : system.n_q + system.n_u]
    translation = Translation(system, structure.beams, y, torques={"azimuth": lambda t: (0.0, 0.0, -1e6)})
    model, state, work = translation.observed.pack()
    assert hold_velocities(model, state, work) == 0
    assert accelerations(np.zeros((0, 6)), model, state, work) == 0
    for i, b in enumerate(translation.tree_bodies):
        first, n = system.index(b, "elastic_u"), system.bodies[b].n_elastic
        np.testing.assert_allclose(state.a[i, :n], expected[first : first + n], atol=1e-6 * np.abs(expected).max())


# ---- in operation ----------------------------------------------------------------------------------------------------


def test_drivetrain_frequency_hardly_depends_on_the_direction():
    """The shaft feels N² J_g in either sense: the torsion frequency changes by the roll of the nacelle only."""
    frequencies = []
    for reverses in (False, True):
        simulator = Simulator(reversing(load_turbine("nrel_5mw"), reverses), SteadyInflow(8.0))
        model = simulator.linearize(rotor_speed=0.0, aerodynamics="none", outputs=("rotor_speed",))
        frequencies.append(max(mode.frequency for mode in model.modes() if "torsion" in mode.name))
    assert 1e-4 < abs(frequencies[1] / frequencies[0] - 1.0) < 4e-3
