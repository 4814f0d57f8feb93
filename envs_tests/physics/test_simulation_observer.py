"""The coupled turbine in local observer frames, and servos, springs and bodies without mass in them."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from envs_tests.physics.cases.rotating_beams import observed_frequencies
from envs_tests.physics.cases.tools import body_pose, rate_jacobian
from wt_gym.base.errors import SimulationError
from wt_gym.multibody.observer_frame.observer_frame_body import ObserverFrameError
from wt_gym.multibody.observer_frame.observer_frame_from_system import Translation, observer_frame_from_system
from wt_gym.multibody.observer_frame.observer_frame_integrator import ObserverFrameIntegrator
from wt_gym.multibody.system import Constraint, Joint, MultibodySystem
from wt_gym.simulation import FIDELITIES, Simulator
from wt_gym.simulation.channels import new_values
from wt_gym.simulation.models import assemble
from wt_gym.simulation.step.coupling import FORMS
from wt_gym.simulation.step.structure_motion import TreeMotion
from wt_gym.structure.flexible_body import FlexibleBody
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow

OBSERVER = replace(FIDELITIES["training"], formulation="observer")
LINEAR = replace(OBSERVER, frame_displacement="linear")


# ---- mechanisms ------------------------------------------------------------------------------------------------------


def mechanism(ratio=1.0):
    """A turbine in small: a sprung column, a servo and a spring behind it, a geared generator, a shaft, a pitch."""
    turn = Rotation.from_euler("xyz", (0.3, -0.2, 0.5)).as_matrix()
    tree, none = MultibodySystem(), np.zeros((3, 3))
    column = FlexibleBody.rigid("column", 4.0, (0.1, 0.0, 0.5), np.diag([0.6, 0.7, 0.5]), {"top": (0.0, 0.1, 1.0)})
    yaw = Joint("revolute", (0.0, 0.0, 1.0), stiffness=30.0, damping=0.5, rotation=turn, name="yaw")
    column = tree.add(column, yaw)
    drive = Joint("servo", (0.0, 1.0, 0.0), turn.T, (0.0, 0.0, 0.1), servo_frequency=5.0, name="drive")
    gear = tree.add(FlexibleBody.rigid("gear", 0.0, np.zeros(3), none), drive, column, "top")
    house = FlexibleBody.rigid("house", 3.0, (0.2, 0.1, 0.3), np.diag([0.2, 0.3, 0.25]), {"end": (0.0, 0.0, 0.4)})
    house = tree.add(house, Joint("revolute", (0.0, 1.0, 0.0), stiffness=80.0, damping=1.0, name="twist"), gear)
    generator = FlexibleBody.rigid("generator", 0.0, np.zeros(3), none)
    hinge = Joint("revolute", (1.0, 0.0, 0.0), turn, name="azimuth", rotor_inertia=0.3 / ratio**2, rotor_ratio=ratio)
    generator = tree.add(generator, hinge, house, "end")
    rotor = FlexibleBody.rigid("rotor", 2.0, (0.1, 0.0, 0.0), np.diag([0.4, 0.3, 0.3]))
    shaft = Joint("revolute", (1.0, 0.0, 0.0), None, (0.3, 0.0, 0.0), 50.0, 0.2, name="shaft")
    rotor = tree.add(rotor, shaft, generator)
    blade = FlexibleBody.rigid("blade", 0.5, (0.1, 0.05, 0.6), np.diag([0.1, 0.12, 0.03]), {"tip": (0.0, 0.0, 1.0)})
    pitch = Joint("servo", (0.0, 0.0, -1.0), None, (0.0, 0.0, 0.2), servo_frequency=5.0, name="pitch")
    tree.add(blade, pitch, rotor)
    return tree.build()


def motion(amplitude, frequency):
    """Angle, rate and acceleration of a servo, by time."""
    return lambda t: (
        amplitude
        * np.array([np.sin(frequency * t), frequency * np.cos(frequency * t), -(frequency**2) * np.sin(frequency * t)])
    )


@pytest.mark.parametrize(("radius", "ratio"), [(None, 1.0), (0.5, 1.0), (None, 4.0), (0.5, -4.0), (None, -0.5)])
def test_servos_springs_and_massless_bodies_move_like_the_tree(radius, ratio):
    """Tip of the mechanism against the tree and an eighth-order scheme: the difference is the scheme's O(h²)."""
    system, duration = mechanism(ratio), 1.0
    motions, n = {"drive": motion(0.3, 3.0), "pitch": motion(0.5, 2.0)}, system.n_q + system.n_u
    y, inputs, work = system.initial_state(), system.new_inputs(), system.new_work()
    y[:n] = 0.2, 0.1, 0.3, 0.05, 0.3, -0.2, 4.0, -0.5

    def torque(t):
        return 5.0 * np.sin(4.0 * t)

    def full(t, x):
        y = np.concatenate([x, np.zeros(4)])
        for s, of in enumerate(motions.values()):
            y[n + s], y[n + 2 + s], acceleration = of(t)
            inputs.servo_command[:, s] = (acceleration + 10.0 * y[n + 2 + s]) / 25.0 + y[n + s]
        inputs.dof_force[:, system.index(3, "joint_u")] = torque(t)
        return y

    y = full(0.0, y[:n])
    known = solve_ivp(lambda t, x: system.rates(full(t, x), inputs, work)[:n], (0.0, duration), y[:n], "DOP853",
                      rtol=1e-9, atol=1e-10)  # fmt: skip
    last = full(duration, known.y[:, -1])
    position, rotation = body_pose(system, last, 5)
    observed = observer_frame_from_system(
        system, y=y, motions=motions, torques={"azimuth": lambda t: (0.0, 0.0, torque(t))}
    )
    errors = []
    for step in (0.005, 0.0025):
        run = ObserverFrameIntegrator(observed, step, spectral_radius=radius)
        run.advance(round(duration / step))
        errors.append(np.abs(run.position("blade", "tip") - position - rotation[:, 2]).max())
    assert errors[1] < (1e-4 if radius is None else 3e-4)
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.25)
    np.testing.assert_allclose(run.state.angle, last[:4], atol=5e-4)


def test_stiff_spring_limits_no_step():
    """A torsion pendulum of 100 Hz in steps of its period swings down to its balance."""
    tree = MultibodySystem(gravity=(0.0, 0.0, 0.0))
    disc = FlexibleBody.rigid("disc", 1.0, np.zeros(3), np.diag([0.5, 0.5, 1.0]))
    stiffness = (200.0 * np.pi) ** 2
    tree.add(disc, Joint("revolute", (0.0, 0.0, 1.0), stiffness=stiffness, damping=200.0 * np.pi, name="twist"))
    torques = {"twist": lambda t: (0.2, 0.0, 0.1 * stiffness)}
    run = ObserverFrameIntegrator(observer_frame_from_system(tree.build(), torques=torques), 0.01)
    run.advance(400)
    assert run.state.angle[0] == pytest.approx(0.3, rel=1e-6)


def test_whole_turns_of_a_sprung_hinge_are_counted():
    """Spun by a constant torque against a damper: θ = ω₀ t − (ω₀/β) (1 − e^−βt), many turns on."""
    tree = MultibodySystem(gravity=(0.0, 0.0, 0.0))
    tree.add(FlexibleBody.rigid("disc", 1.0, np.zeros(3), np.diag([1.0, 1.0, 2.0])),
             Joint("revolute", (0.0, 0.0, 1.0), damping=0.4, name="turn"))  # fmt: skip
    run = ObserverFrameIntegrator(
        observer_frame_from_system(tree.build(), torques={"turn": lambda t: (0.0, 0.0, 2.0)}), 0.01
    )
    run.advance(1000)
    assert run.state.angle[0] == pytest.approx(5.0 * 10.0 - 25.0 * (1.0 - np.exp(-2.0)), rel=1e-4)


def test_servo_of_a_weld_is_the_servo_of_a_joint():
    """A driven constraint on a free body turns it as a driven joint does."""
    tips = []
    for tied in (False, True):
        tree, arm = MultibodySystem(), Rotation.from_euler("xyz", (0.2, 0.4, -0.3)).as_matrix()
        base = FlexibleBody.rigid("base", 2.0, (0.0, 0.1, 0.3), 0.2 * np.eye(3), {"end": (0.0, 0.0, 0.5)})
        base = tree.add(base, Joint("revolute", (1.0, 0.0, 0.0), name="swing"))
        blade = FlexibleBody.rigid("blade", 1.0, (0.1, 0.0, 0.5), np.diag([0.2, 0.25, 0.1]),
                                   {"root": (0.0, 0.0, 0.0), "tip": (0.0, 0.0, 1.0)})  # fmt: skip
        bearing = {"axis": (0.0, 0.0, 1.0), "rotation": arm, "servo_frequency": 5.0, "name": "pitch"}
        if tied:
            blade = tree.add(blade, Joint("free", name="place"))
            tree.add_constraint(Constraint("weld", **bearing), base, blade, "end", "root")
        else:
            tree.add(blade, Joint("servo", **bearing), base, "end")
        y = tree.build().initial_state()
        tree.place_free_bodies(y)
        observed = observer_frame_from_system(tree, y=y, motions={"pitch": motion(0.4, 3.0)})
        run = ObserverFrameIntegrator(observed, 0.005)
        run.advance(200)
        tips.append(run.position("blade", "tip"))
    np.testing.assert_allclose(tips[1], tips[0], atol=1e-9)


def test_body_without_mass_needs_a_rigid_lender():
    tree = MultibodySystem()
    wheel = FlexibleBody.rigid("wheel", 0.0, np.zeros(3), np.diag([1.0, 0.0, 0.0]))
    tree.add(wheel, Joint("revolute", (1.0, 0.0, 0.0), name="turn"))
    with pytest.raises(ObserverFrameError, match="'wheel' has no mass"):
        observer_frame_from_system(tree.build())


# ---- the turbine at rest ---------------------------------------------------------------------------------------------


def tree_frequencies(system):
    """Undamped circular frequencies at rest of a system of joint angles and elastic coordinates."""
    stiffness = -rate_jacobian(system, system.initial_state(), 1e-5)[:, : system.n_q]
    return np.sqrt(np.maximum(np.sort(np.linalg.eigvals(stiffness).real), 0.0))


@pytest.mark.parametrize("reference", ["clamped", "simply_supported", "three_quarter"])
def test_parked_frequencies(reference):
    """Linear: without weight those of the embedded form, with it all but the tower's, which lacks P-Δ, within 0.5 %."""
    turbine = load_turbine("nrel_5mw")
    embedded = assemble(turbine, FIDELITIES["training"]).structure.system
    heavy = tree_frequencies(embedded)[1:]
    embedded.tree = embedded.tree._replace(gravity=np.zeros(3))
    light = tree_frequencies(embedded)[1:]
    structure = assemble(turbine, LINEAR).structure
    start = structure.system.initial_state()
    observed = Translation(structure.system, structure.beams, start, reference=reference).observed
    found = observed_frequencies(observed)[1:]
    np.testing.assert_allclose(found, light, rtol=1e-7)
    np.testing.assert_allclose(found[2:], heavy[2:], rtol=5e-3)
    assert np.all(found[:2] / heavy[:2] > 1.01)  # the weight of the rotor on a tower that leans


# ---- the turbine in the wind -----------------------------------------------------------------------------------------


def trajectory(duration=4.0, step=0.0334, base=OBSERVER, **options):
    """Channels in a pitching, yawing turbine under a changing generator."""
    inflow = SteadyInflow(9.0, shear_exponent=0.2, yaw_misalignment=0.1)
    sim = Simulator("nrel_5mw", inflow, replace(base, max_substep=step, coupling_iterations=4, **options))
    sim.reset(rotor_speed=1.0, azimuth=0.3)
    rows = []
    for k in range(round(duration / 0.2)):
        pitch = (0.0, 0.03 * (k > 3), 0.02 * (k > 8))
        signals = sim.advance(0.2, pitch=pitch, yaw_rate=0.003, generator_torque=28e3 + 2e3 * (k > 10))
        rows.append(signals.values.copy())
    return np.array(rows), signals


WATCHED = ("rotor_speed", "azimuth", "yaw", "tip_out_of_plane", "tip_in_plane", "root_flap_moment", "root_edge_moment",
           "tower_top_fore_aft", "tower_base_fore_aft_moment", "tip_clearance_min", "tip_out_of_plane_max")  # fmt: skip


DAMPED = {"integrator": "generalized_alpha", "spectral_radius": 0.5}


@pytest.mark.slow
@pytest.mark.parametrize("base", [OBSERVER, LINEAR], ids=["second order", "linear"])
@pytest.mark.parametrize("scheme", [{}, DAMPED])
def test_coupled_trajectory_is_that_of_the_same_equations_in_the_embedded_form(monkeypatch, scheme, base):
    """Within 1e-3 of the largest value of each channel in 20 s, nearly four times nearer with half the step."""
    coarse, _ = trajectory(20.0, 0.0125, base, **scheme)
    fine, _ = trajectory(20.0, 0.00625, base, **scheme)
    with monkeypatch.context() as patch:
        patch.setitem(FORMS, "observer", TreeMotion)
        known, _ = trajectory(20.0, 0.00625, base)
    _, at = new_values(3)
    places = np.concatenate([np.atleast_1d(np.r_[at[name]]) for name in WATCHED])
    size = np.abs(known[:, places]).max(axis=0)
    errors = [(np.abs(run - known)[:, places] / size).max(axis=0) for run in (coarse, fine)]
    assert errors[1].max() < 1e-3
    assert np.linalg.norm(errors[1]) < 0.5 * np.linalg.norm(errors[0])


@pytest.mark.slow
def test_energy_balance_holds_and_finds_a_drive_from_nowhere():
    """The balance of the embedded coordinates is that of the observer frames: a torque that is not booked breaks it."""
    sim = Simulator("nrel_5mw", SteadyInflow(9.0), OBSERVER)
    sim.reset(rotor_speed=1.0)
    sim.advance(10.0, pitch=0.0, generator_torque=28e3)
    energy = sim.coupling.exchange.energy
    assert energy.gained[0] < 0.01 * energy.reserve
    observed = sim.coupling.motion.observed
    angles = dict(sim.coupling.motion.translation.hinges)
    spring = next(k for k, body in angles.items() if body == sim.structure.hub)
    row = int(np.flatnonzero(observed.model.row_spring == spring)[0])
    observed.model.row_damping[row] = -50.0 * sim.turbine.drivetrain.damper
    with pytest.raises(SimulationError, match=r"energy balance violated|beyond|diverged"):
        sim.advance(20.0, pitch=0.0, generator_torque=28e3)


@pytest.mark.slow
def test_environment():
    env = gymnasium.make("wt_gym/NREL5MW-Turbulent-v1", fidelity=OBSERVER)
    check_env(env.unwrapped, skip_render_check=True)
