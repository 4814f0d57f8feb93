"""Runs of a simulator: extremes between samples, records, start amid motion."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
import xarray as xr

from wt_gym.base.errors import ActionError, SimulationError
from wt_gym.base.quantities import GRAVITY
from wt_gym.simulation import FIDELITIES, Recorder, Simulator
from wt_gym.simulation.step.coupling_kernels import passing_clearance, signed_clearance, view_from_tower
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow, TurningInflow

# ---- extremes between samples ---------------------------------------------------------------------------------------

START_SPEED = 1.2
RADIUS = 2.5


def clearance(ahead, beside, above=-10.0):
    return signed_clearance(np.array([ahead, beside, above, RADIUS]))


def test_clearance_of_a_cylinder_and_of_what_lies_behind_it():
    assert clearance(4.0, 3.0) == pytest.approx(5.0 - RADIUS)  # upwind: from the surface
    assert clearance(-7.0, 3.0) == clearance(0.0, -3.0) == pytest.approx(0.5)  # beside what lies behind
    assert clearance(0.0, 0.0) == -RADIUS
    assert clearance(-3.0, 0.0) == pytest.approx(-3.0 - RADIUS)  # from the front of the tower, along the nacelle's axis
    assert clearance(-3.0, 2.4) == pytest.approx(0.0, abs=0.25)
    assert clearance(2.0, 0.0, above=4.0) == 4.0  # over the rim
    assert clearance(5.5, 0.0, above=4.0) == pytest.approx(5.0)


def test_a_tip_is_seen_along_the_axis_of_the_nacelle():
    base, top, yaw = np.array([0.0, 0.0, 10.0]), np.array([1.0, 0.5, 90.0]), 0.4
    axis = np.array([np.cos(yaw), np.sin(yaw), -0.1])
    upwind, side = -np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
    middle = 0.5 * (base + top)
    tip = middle + np.array([*(6.0 * upwind + 2.0 * side), 0.0])
    out = np.zeros(4)
    view_from_tower(tip, base, top, axis, np.array([0.0, 40.0, 80.0]), np.array([3.0, 2.6, 2.0]), out)
    np.testing.assert_allclose(out, [6.0, 2.0, -40.0, 2.6], atol=1e-12)


@pytest.mark.parametrize(("ahead", "least"), [(6.0, 6.0 - RADIUS), (-1.0, -1.0 - RADIUS)])
def test_a_tip_that_flies_by_between_two_steps_counts(ahead, least):
    before, now = (np.array([ahead, beside, -60.0, RADIUS]) for beside in (5.0, -6.0))
    assert min(signed_clearance(before), signed_clearance(now)) > least + 1.0
    assert passing_clearance(before, now, np.zeros(4)) == pytest.approx(least, abs=1e-12)
    assert passing_clearance(now, now, np.zeros(4)) == signed_clearance(now)


def run(sheared, control_step, duration, state):
    """Signals of a run with constant demands from a snapshot."""
    sheared.restore(state)
    return [
        sheared.advance(control_step, pitch=0.03, generator_torque=38e3) for _ in range(round(duration / control_step))
    ]


@pytest.fixture(scope="module")
def sheared():
    sim = Simulator("nrel_5mw", SteadyInflow(11.0, shear_exponent=0.2))
    sim.reset(rotor_speed=START_SPEED, azimuth=0.4)
    return sim


def test_extremes_do_not_depend_on_the_control_step(sheared):
    """The same motion, sampled every 0.1 s and every 1.2 s: the extremes agree to the last bit, the samples do not."""
    start = sheared.state()
    fine, coarse = (run(sheared, step, 3.6, start) for step in (0.1, 1.2))
    assert np.array_equal(fine[-1]["tip_clearance"], coarse[-1]["tip_clearance"])
    for name in ("tip_out_of_plane", "root_flap_moment", "tower_base_moment", "rotor_speed"):
        highest = [np.max([s[f"{name}_max"] for s in signals], axis=0) for signals in (fine, coarse)]
        assert np.array_equal(*highest), name
    least = [np.min([s["tip_clearance_min"] for s in signals]) for signals in (fine, coarse)]
    assert least[0] == least[1]
    sampled = [min(s["tip_clearance"].min() for s in signals) for signals in (fine, coarse)]
    assert least[0] <= sampled[0] < least[0] + 0.5
    assert sampled[1] > least[0] + 1.0


def test_samples_count_among_the_extremes(sheared):
    signals = sheared.reset(rotor_speed=START_SPEED, azimuth=0.4)
    for _ in range(10):
        base = np.hypot(signals.tower_base_fore_aft_moment, signals.tower_base_side_side_moment)
        assert signals.tower_base_moment_max >= base * (1.0 - 1e-12)
        assert signals.rotor_speed_max >= signals.rotor_speed
        assert np.all(signals.tip_clearance_min <= signals.tip_clearance)
        assert np.all(signals.tip_out_of_plane_max >= signals.tip_out_of_plane)
        assert np.all(signals.root_flap_moment_max >= np.abs(signals.root_flap_moment) * (1.0 - 1e-12))
        signals = sheared.advance(0.1, pitch=0.03, generator_torque=38e3)


@pytest.fixture(scope="module")
def leaning():
    """The 5-MW turbine tilted the wrong way, so that its tips swing round behind the tower."""
    nrel, tilt = load_turbine("nrel_5mw"), np.radians(-7.0)
    height = nrel.hub_height + nrel.nacelle.overhang * (np.sin(tilt) - np.sin(nrel.nacelle.tilt))
    turbine = replace(nrel, hub_height=height, nacelle=replace(nrel.nacelle, tilt=tilt))
    fidelity = replace(FIDELITIES["training"], tower_shadow=False)  # no flow around a tower that is hit
    return Simulator(turbine, SteadyInflow(9.0), fidelity)


def test_no_tip_passes_behind_the_tower_unseen(leaning):
    """The first strike is found in the control step in which a blade passes the tower, wherever it starts."""
    step, unseen = 0.4, 0
    for azimuth in np.linspace(0.0, 0.9, 5):
        signals = leaning.reset(rotor_speed=START_SPEED, azimuth=azimuth)
        passing = (np.pi / 3.0 - azimuth) % (2.0 * np.pi / 3.0)  # of the next blade that comes to point down
        turned = 0.0
        while turned < passing:
            assert turned > passing - 0.1 or signals.tip_clearance_min.min() > 0.0
            before = signals.azimuth
            signals = leaning.advance(step, pitch=0.0, generator_torque=30e3)
            turned += (signals.azimuth - before) % (2.0 * np.pi)
        assert signals.tip_clearance_min.min() < -1.5
        unseen += signals.tip_clearance.min() > 0.0
    assert unseen >= 3  # what samples at control steps would have missed


def test_way_of_the_pitch_counts_what_happens_between_two_samples():
    """An ideal drive takes half a degree in the first of two time steps and stands at the sample."""
    sim = Simulator("nrel_5mw", inflow=SteadyInflow(12.0))
    sim.reset(rotor_speed=1.2, pitch=0.07)
    step = np.radians(0.5)
    for k, demand in enumerate((0.07 + step, 0.07, [0.07, 0.07 - step, 0.07])):
        signals = sim.advance(0.2, pitch=demand, generator_torque=40e3)
        np.testing.assert_allclose(signals.pitch_rate, 0.0, atol=1e-5)
        np.testing.assert_allclose(signals.pitch_travel, step if k < 2 else [0.0, step, 0.0], atol=1e-6)
    start = sim.state()
    there, back = sim.advance(0.1, 0.08, generator_torque=40e3), sim.advance(0.1, 0.07, generator_torque=40e3)
    sim.restore(start)
    sim.advance(0.1, 0.08, generator_torque=40e3)
    both = sim.advance(0.1, 0.07, generator_torque=40e3, accumulate=True)
    np.testing.assert_allclose(both.pitch_travel, there.pitch_travel + back.pitch_travel)
    np.testing.assert_array_equal(both.tip_clearance_min, np.minimum(there.tip_clearance_min, back.tip_clearance_min))
    assert both.rotor_speed_max == max(there.rotor_speed_max, back.rotor_speed_max)
    assert (both.time, both.rotor_speed) == (back.time, back.rotor_speed)


def test_an_interval_goes_on_from_a_snapshot_and_not_over_a_reset():
    sim = Simulator("nrel_5mw", inflow=SteadyInflow(12.0))
    sim.reset(rotor_speed=1.2, pitch=0.07)
    first = sim.advance(0.1, 0.08, generator_torque=40e3)
    amid = sim.state()
    whole = sim.advance(0.1, 0.09, generator_torque=40e3, accumulate=True)
    assert whole.pitch_travel.min() > first.pitch_travel.max()
    for _ in range(3):
        sim.advance(0.2, 0.12, generator_torque=40e3)
    sim.restore(amid)
    assert sim.advance(0.1, 0.09, generator_torque=40e3, accumulate=True) == whole
    sim.reset(rotor_speed=1.2, pitch=0.07)
    assert sim.advance(0.1, 0.08, generator_torque=40e3, accumulate=True) == first


# ---- records --------------------------------------------------------------------------------------------------------

CONSTRAINED = replace(FIDELITIES["training"], formulation="constrained")
NAMES = ["root_multiplier_force", "root_multiplier_moment"]


def moved(simulator, recorder=None, steps=15):
    """Signals (steps + 1, n) of a run with moving drives, recorded or not."""
    rows = [simulator.reset(rotor_speed=1.1, azimuth=0.4)]
    for k in range(steps):
        if recorder is not None:
            recorder.append(rows[-1])
        rows.append(simulator.advance(0.2, pitch=(0.02 * (k % 3), 0.03, 0.0), yaw_rate=0.003, generator_torque=28e3))
    return np.array([signals.values for signals in rows])


@pytest.mark.parametrize("integrator", ["hamming", "generalized_alpha"])
def test_multipliers_are_recorded_and_disturb_nothing(integrator):
    """The moments are those of the channels, and the run is that without a recorder bit for bit."""
    simulator = Simulator(
        "nrel_5mw", SteadyInflow(9.0, shear_exponent=0.2), replace(CONSTRAINED, integrator=integrator)
    )
    recorder, unrecorded = Recorder(simulator), moved(simulator)
    kept = simulator.state()
    np.testing.assert_array_equal(moved(simulator, recorder), unrecorded)
    assert simulator.state() == kept
    run = recorder.to_dataset()
    assert [run[name].dims for name in NAMES] == [("time", "blade", "component")] * 2
    assert [run[name].attrs["units"] for name in NAMES] == ["N", "N m"]
    assert run.blade.values.tolist() == [1, 2, 3]
    for channel, component in (("root_edge_moment", "x"), ("root_flap_moment", "y"), ("root_torsion", "z")):
        for blade in (1, 2, 3):
            found = run.root_multiplier_moment.sel(blade=blade, component=component).values
            known = run[f"{channel}_{blade}"].values
            np.testing.assert_allclose(found, -known, atol=1e-7 * np.abs(run.root_flap_moment_1.values).max())
    structure, pull = simulator.structure, -run.root_multiplier_force.sel(component="z").values
    assert pull.max() > structure.system.bodies[structure.blades[0]].inertia.mass * GRAVITY  # it hangs and turns


def test_a_file_of_a_recorded_environment_brings_them_back(tmp_path):
    env = gym.make("wt_gym/NREL5MW-Steady-v1", fidelity=CONSTRAINED, wind_speed=9.0)
    _, info = env.reset(seed=0)
    recorder = Recorder(env.unwrapped.simulator)
    for _ in range(3):
        *_, info = env.step(env.action_space.sample())
        recorder.append(env.unwrapped.signals)
    assert "root_multipliers" not in info
    recorder.save(tmp_path / "run.nc")
    last = env.unwrapped.simulator.root_multipliers()
    with xr.open_dataset(tmp_path / "run.nc", engine="h5netcdf") as run:
        found = np.concatenate([run[name].values[-1] for name in NAMES], axis=1)
        assert run.component.values.tolist() == ["x", "y", "z"]
    np.testing.assert_array_equal(found, last)


def test_other_instants_have_none():
    """Signals of an earlier instant, and those before a failed step."""
    simulator = Simulator("nrel_5mw", SteadyInflow(9.0), CONSTRAINED)
    early = simulator.reset(rotor_speed=1.0)
    late = simulator.advance(0.2, pitch=0.0, generator_torque=28e3)
    recorder = Recorder(simulator)
    recorder.append(early)
    recorder.append(late)
    simulator.inflow = SteadyInflow(200.0)
    with pytest.raises(SimulationError, match="simulation failed"):
        simulator.advance(20.0, pitch=0.0)
    recorder.append(late)
    known = recorder.to_dataset().root_multiplier_moment.notnull().all(("blade", "component"))
    assert known.values.tolist() == [False, True, False]
    assert Recorder(simulator).to_dataset().root_multiplier_force.shape == (0, 3, 3)


@pytest.mark.parametrize("formulation", ["embedded", pytest.param("observer", marks=pytest.mark.slow)])
def test_without_constraint_equations_nobody_asks_for_multipliers(formulation, monkeypatch):
    simulator = Simulator("nrel_5mw", SteadyInflow(9.0), replace(CONSTRAINED, formulation=formulation))
    monkeypatch.setattr(Simulator, "root_multipliers", lambda self: pytest.fail("asked"))
    recorder = Recorder(simulator)
    recorder.append(simulator.reset(rotor_speed=1.0))
    assert set(recorder.to_dataset().sizes) == {"time"}


# ---- start amid motion ----------------------------------------------------------------------------------------------

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


@pytest.mark.parametrize(
    ("start", "message"),
    [
        ({"tower_top": [0.1, 0.0]}, "tower_top must be 4 finite numbers"),
        ({"tower_top": [0.0, 0.0, np.nan, 0.0]}, "tower_top must be 4 finite numbers"),
        ({"motion": np.zeros(3)}, "motion must be"),
        ({"yaw": 40.0}, "yaw must be within one turn"),  # degrees
    ],
)
def test_a_start_of_another_form_is_refused(simulator, start, message):
    with pytest.raises(ActionError, match=message):
        simulator.reset(SPEED, PITCH, **start)


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
    n = 1 - system.n_u
    rates, own_rates = (one.motion()[2 * n : n] for one in (running, restarted))
    accelerations, own_accelerations = (one.motion()[n:] for one in (running, restarted))
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
