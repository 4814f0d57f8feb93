"""The start of a simulation amid motion: tower top where and as fast as asked, blades that turn with their weight."""

import numpy as np
import pytest

from wt_gym.base.errors import ActionError
from wt_gym.simulation import Simulator
from wt_gym.wind import SteadyInflow, TurningInflow

SPEED, PITCH = 1.267, 0.07
SWING = np.array([0.2, -0.1, 0.3, 0.15])


@pytest.fixture(scope="module")
def simulator():
    return Simulator("nrel_5mw", inflow=SteadyInflow(12.0))


@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_tower_top_is_where_it_is_asked_to_be(simulator, yaw):
    simulator.reset(SPEED, PITCH, yaw=yaw)
    wanted = simulator.tower_top() + SWING
    signals = simulator.reset(SPEED, PITCH, yaw=yaw, tower_top=wanted)
    # displacements of second order in the swing move it by less than a millimeter
    np.testing.assert_allclose(simulator.tower_top(), wanted, atol=1e-3)
    assert signals.tower_top_fore_aft == pytest.approx(wanted[0], abs=1e-3)
    assert signals.tower_top_side_side == pytest.approx(wanted[1], abs=1e-3)


def test_tower_top_velocity_is_the_rate_of_its_displacement(simulator):
    simulator.reset(SPEED, PITCH)
    wanted = simulator.tower_top() + SWING
    before = simulator.reset(SPEED, PITCH, tower_top=wanted)
    torque = before.generator_torque
    after = simulator.advance(simulator.time_step, (PITCH,) * 3, 0.0, torque)
    mean_rate = 0.5 * (SWING[2:] + simulator.tower_top()[2:])
    moved = np.array([after.tower_top_fore_aft, after.tower_top_side_side]) - wanted[:2]
    np.testing.assert_allclose(moved / simulator.time_step, mean_rate, atol=4e-3)


def test_free_swing_side_side_has_the_frequency_of_the_first_mode():
    """Of a parked turbine: 0.3120 Hz by FAST, 0.3164 Hz by ADAMS (NREL/TP-500-38060)."""
    still = Simulator("nrel_5mw", inflow=SteadyInflow(0.0))
    rest = still.reset(0.0, np.pi / 2).tower_top_side_side
    still.reset(0.0, np.pi / 2, tower_top=still.tower_top() + np.array([0.0, 0.1, 0.0, 0.0]))
    series = [still.advance(0.1, (np.pi / 2,) * 3).tower_top_side_side - rest for _ in range(400)]
    spectrum = np.abs(np.fft.rfft(series * np.hanning(400), 8000))
    frequency = np.fft.rfftfreq(8000, 0.1)[spectrum.argmax()]
    assert 0.99 * 0.3120 < frequency < 1.01 * 0.3164


def test_blades_start_in_the_motion_of_their_weight(simulator):
    """Edgewise the running blade follows its weight at 1P; a blade at rest would ring ten times as much."""

    def ringing(moments, azimuths):
        turns = [f(k * azimuths) for k in (1, 2) for f in (np.cos, np.sin)]
        harmonics = np.column_stack([np.ones(len(azimuths)), *turns])
        return np.std(moments - harmonics @ np.linalg.lstsq(harmonics, moments, rcond=None)[0])

    signals = simulator.reset(SPEED, PITCH)
    torque, samples = signals.generator_torque, []
    for _ in range(400):
        signals = simulator.advance(0.1, (PITCH,) * 3, 0.0, torque)
        samples.append((signals.root_edge_moment_1, signals.azimuth))
    moments, azimuths = np.array(samples).T
    assert ringing(moments[:100], azimuths[:100]) < 1.6 * ringing(moments[300:], azimuths[300:])


def test_tower_top_of_another_form_is_refused(simulator):
    for wrong in ([0.1, 0.0], [0.0, 0.0, np.nan, 0.0]):
        with pytest.raises(ActionError, match="tower_top must be 4 finite numbers"):
            simulator.reset(SPEED, PITCH, tower_top=wrong)


def parts(simulator):
    """Coordinates, rates and accelerations of the structure."""
    n = simulator.structure.system.n_u - 1
    return np.split(simulator.motion(), [simulator.structure.n_motion - 2 * n, simulator.structure.n_motion - n])


def test_restart_amid_motion_continues_the_motion():
    """A running turbine that is started anew with its motion bends on as before: only its wake is another one."""
    running, restarted = (Simulator("nrel_5mw", inflow=SteadyInflow(12.0, shear_exponent=0.2)) for _ in range(2))
    torque = running.reset(SPEED, PITCH).generator_torque
    running.reset(SPEED, PITCH, tower_top=running.tower_top() + SWING)
    for _ in range(150):
        running.advance(0.1, (PITCH,) * 3, 0.0, torque)
    system, y = running.structure.system, running.coupling.integrator.state
    azimuth, speed = y[running.structure.azimuth_q], y[system.n_q + running.structure.azimuth_u]
    restarted.reset(speed, PITCH, azimuth, generator_torque=torque, motion=running.motion())
    (_, rates, accelerations), (_, own_rates, own_accelerations) = map(parts, (running, restarted))
    np.testing.assert_allclose(own_rates, rates, atol=1e-9)
    np.testing.assert_allclose(own_accelerations, accelerations, atol=1e-4 * np.abs(accelerations).max())
    pairs = [[one.advance(0.1, (PITCH,) * 3, 0.0, torque) for one in (running, restarted)] for _ in range(30)]
    # the wake of a start is not yet that of the run: 3 % of the thrust, and of what it bends
    for name, size in (("tower_top_fore_aft", 0.35), ("tower_top_side_side", 0.05), ("tip_out_of_plane_1", 5.0)):
        np.testing.assert_allclose(*np.array([[one[name] for one in pair] for pair in pairs]).T, atol=0.04 * size)


def test_motion_turns_with_the_nacelle():
    """The same motion relative to the nacelle in a wind that has turned with it: the same displacements and loads."""
    angle, signals, motions = 0.9, [], []
    wind = SteadyInflow(12.0, shear_exponent=0.2)
    for yaw, inflow in ((0.0, wind), (angle, TurningInflow.by(wind, angle))):
        simulator = Simulator("nrel_5mw", inflow=inflow)
        if not signals:
            simulator.reset(SPEED, PITCH)
            simulator.reset(SPEED, PITCH, tower_top=simulator.tower_top() + SWING)
            motion = simulator.motion()
        simulator.reset(SPEED, PITCH, yaw=yaw, motion=motion)
        motions.append(simulator.motion())
        signals.append(simulator.signals)
    np.testing.assert_allclose(*motions, atol=1e-5 * np.abs(motions[0]).max())
    for name in ("tower_top_fore_aft", "tower_top_side_side", "tower_base_fore_aft_moment", "root_flap_moment_1"):
        assert signals[1][name] == pytest.approx(signals[0][name], rel=1e-5)


def test_motion_of_another_form_is_refused(simulator):
    with pytest.raises(ActionError, match="motion must be"):
        simulator.reset(SPEED, PITCH, motion=np.zeros(3))
