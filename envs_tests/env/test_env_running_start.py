"""Episodes that begin amid the operation of the turbine."""

import logging

import gymnasium as gym
import numpy as np
import pytest

from wt_gym.control import Demand
from wt_gym.control.controllers import DisconController, lidar_of, make_controller
from wt_gym.control.controllers.memory import Memory, memory_of, remember
from wt_gym.envs import record_store, running_record
from wt_gym.envs.running_record import Record, RecordingPlan, StartRecorder
from wt_gym.envs.running_start import RunningStart
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow, TurbulenceBox, TurbulentInflow

TASK = "wt_gym/LoadReduction-v1"
LOADS = ("root_flap_moment", "tower_base_fore_aft_moment", "tower_base_side_side_moment")


@pytest.fixture(scope="module")
def env():
    made = gym.make(TASK, wind_speed=15.0).unwrapped
    yield made
    made.close()


def begun(env, seed=0, **options):
    env.reset(seed=seed, options={"wind_seed": 5001, "time_offset": 80.0, **options})
    return env.signals


def test_same_seed_same_start(env):
    first, other = begun(env, seed=3), begun(env, seed=3)
    assert first == other


def test_seeds_draw_among_instants_alike(env):
    azimuths = {round(begun(env, seed=seed)["azimuth"], 6) for seed in range(8)}
    assert len(azimuths) > 1


def test_tower_swings_at_the_start(env):
    motion = []
    for seed in range(6):
        begun(env, seed=seed)
        motion.append(env.simulator.tower_top()[2:])
    assert (np.std(motion, axis=0) > 1e-4).all()


def test_another_record_of_the_memory_is_the_same_as_that_of_the_disk(env, monkeypatch):
    first = begun(env, seed=3)
    monkeypatch.setattr(record_store, "_records", {})
    assert begun(env, seed=3) == first


def test_a_turbine_that_cannot_run_is_asked_once_on_a_machine(env, monkeypatch, tmp_path):
    """Another process finds on the disk that there is no record."""
    asked = []
    monkeypatch.setattr(StartRecorder, "record", lambda *_: asked.append(1))
    monkeypatch.setattr(record_store, "_folder", lambda: tmp_path)
    for _ in range(2):
        monkeypatch.setattr(record_store, "_records", {})
        begun(env, seed=3)
        np.testing.assert_allclose(env.simulator.tower_top()[2:], 0.0, atol=1e-9)
    assert len(asked) == 1


def test_azimuth_of_the_options_is_kept(env):
    # the rotor is ahead of the generator by the twist of the shaft, 4.2 MN m over 868 MN m/rad
    assert begun(env, azimuth=1.0)["azimuth"] == pytest.approx(1.0, abs=0.006)


@pytest.mark.parametrize("option", [{"rotor_speed": 1.2}, {"pitch": 0.1}, {"generator_torque": 4e4}])
def test_a_fixed_operating_point_starts_at_rest(env, option):
    begun(env, **option)
    np.testing.assert_allclose(env.simulator.tower_top()[2:], 0.0, atol=1e-9)


def test_steady_start_is_at_the_operating_point_at_rest():
    env = gym.make(TASK, wind_speed=15.0, start="steady").unwrapped
    signals = begun(env)
    assert np.ptp(signals["pitch"]) == 0.0
    np.testing.assert_allclose(env.simulator.tower_top()[2:], 0.0, atol=1e-9)


def test_unknown_start_is_refused():
    with pytest.raises(ValueError, match=r"start must be one of \('running', 'steady'\), got 'moving'"):
        gym.make(TASK, start="moving")


def test_steady_wind_starts_at_rest():
    env = gym.make("wt_gym/NREL5MW-Steady-v1").unwrapped
    env.reset(seed=0)
    np.testing.assert_allclose(env.simulator.tower_top()[2:], 0.0, atol=1e-9)


def test_start_is_the_instant_of_the_record_after_the_same_wind():
    """In the wind of the record itself the nearest instant is that of the record, with its motion."""
    turbine = load_turbine("nrel_5mw")
    controller = make_controller("discon", turbine)
    box = TurbulenceBox.kaimal(15.0, turbine.hub_height, turbine.rotor_diameter, "B", seed=9)
    inflow = TurbulentInflow(box, SteadyInflow(15.0, turbine.hub_height, shear_exponent=0.2))
    maker = StartRecorder(turbine, "training", controller)
    run = maker.run(inflow)
    record = Record.of_runs(maker, [run])
    chosen = len(record.now) // 2
    _, first, spacing = maker.times(run.step)
    k = first + chosen * spacing
    later = TurbulentInflow(box, inflow.steady, time_offset=k * run.step)
    start, row = record.start(later, 0.0, 0.0, None, np.inf), run.rows[k].astype(float)
    assert start.rotor_speed == pytest.approx(row[maker.columns.turning.start + 1], rel=1e-6)
    np.testing.assert_allclose(start.tower_top, row[maker.columns.tower_top], rtol=1e-6)
    assert set(start.deviations) == set(LOADS)


@pytest.mark.parametrize("name", ["tuned", "tuned_lidar"])
def test_controller_continues_as_the_one_that_was_recorded(name):
    """Integrals, filters and what a lidar has seen are put back."""
    turbine = load_turbine("nrel_5mw")
    box = TurbulenceBox.kaimal(15.0, turbine.hub_height, turbine.rotor_diameter, "B", seed=9)
    maker = StartRecorder(turbine, "training", make_controller(name, turbine))
    run = maker.run(TurbulentInflow(box))
    record = Record.of_runs(maker, [run])
    running = make_controller(name, turbine)
    record.at(0).start(running, None, None)
    k = maker.times(run.step)[1]
    present = record._before(run.rows[: k + 1].astype(float), Memory(*(part[0] for part in record.memory)), 0.0)
    demand, recorded = running.step(present._readings(k, lidar_of(running)), run.step), run.rows[k + 1]
    assert np.ptp(demand.pitch) > np.radians(0.1)
    np.testing.assert_allclose(demand.pitch, recorded[maker.columns.pitch], atol=1e-6)
    assert demand.generator_torque == pytest.approx(recorded[maker.columns.torque.start], rel=1e-3)


def test_a_wind_in_which_the_turbine_cannot_run_starts_at_rest(caplog, monkeypatch):
    turbine = load_turbine("nrel_5mw")

    class Runaway(DisconController):
        def step(self, signals, dt):
            return Demand(np.zeros(3), 0.0, 0.0)

    monkeypatch.setattr(running_record, "RECORDING_PLAN", RecordingPlan(1, 60.0, 25.0))
    box = TurbulenceBox.kaimal(25.0, turbine.hub_height, turbine.rotor_diameter, "B", seed=9)
    with caplog.at_level(logging.WARNING):
        assert StartRecorder(turbine, "training", Runaway()).record([TurbulentInflow(box)]) is None
    assert "does not run in" in caplog.text


def test_an_interrupt_ends_the_runs_that_are_under_way(monkeypatch):
    turbine, run, steps = load_turbine("nrel_5mw"), StartRecorder.run, []

    class Counting(DisconController):
        def step(self, signals, dt):
            steps.append(dt)
            return super().step(signals, dt)

    still, steady = (SteadyInflow(15.0, turbine.hub_height) for _ in range(2))

    def interrupted(self, inflow, stop=None):
        if inflow is still:
            raise KeyboardInterrupt
        return run(self, inflow, stop)

    monkeypatch.setattr(running_record, "RECORDING_PLAN", RecordingPlan(2, 60.0, 600.0))
    monkeypatch.setattr(StartRecorder, "run", interrupted)
    recorder = StartRecorder(turbine, "training", Counting())
    with pytest.raises(KeyboardInterrupt):
        recorder.record([still, steady])
    assert len(steps) < 3000  # of 6600


def test_turbulence_of_the_user_starts_amid_motion_too():
    turbine = load_turbine("nrel_5mw")
    box = TurbulenceBox.kaimal(15.0, turbine.hub_height, turbine.rotor_diameter, "B", seed=9)
    env = gym.make("wt_gym/NREL5MW-Turbulent-v1", inflow=TurbulentInflow(box)).unwrapped
    env.reset(seed=0)
    assert abs(env.simulator.tower_top()[2:]).max() > 1e-4


def test_reward_filters_begin_with_running_means(env):
    env.reset(seed=3, options={"wind_seed": 5001, "time_offset": 80.0})
    term = next(term for term in env.reward_terms if term.name == "tower_side_side_fatigue")
    assert term._filter.mean != env.signals["tower_base_side_side_moment"]
    assert isinstance(env._starts.running, RunningStart)


def test_memory_of_another_controller_is_refused():
    turbine = load_turbine("nrel_5mw")
    plain, tuned = (make_controller(name, turbine) for name in ("discon", "tuned"))
    with pytest.raises(ValueError, match="has other parts"):
        remember(plain, memory_of(tuned), np.ones(99, dtype=bool))


def test_parameters_that_are_changed_later_stay():
    env = gym.make(TASK, wind_speed=15.0, controller="side_side_damper").unwrapped
    (damper,) = env.controller.additions
    damper.gain *= 0.5
    changed = damper.gain
    env.reset(seed=0)
    assert damper.gain == changed


class Logging(DisconController):
    """A controller of a user, with a memory that grows."""

    def __init__(self, parameters=None):
        super().__init__(parameters)
        self.log, self.last, self.itself = [], None, self

    def step(self, signals, dt):
        demand = super().step(signals, dt)
        self.log.append(demand.pitch)
        self.last = float(signals["generator_speed"])
        return demand


def test_controllers_of_the_user_start_from_the_present_demand():
    env = gym.make(TASK, wind_speed=15.0, controller=Logging()).unwrapped
    signals = begun(env)
    assert env.controller.log == []
    assert abs(env.simulator.tower_top()[2:]).max() > 1e-4
    env.step(np.zeros(env.action_space.shape))
    np.testing.assert_allclose(env.controller.log[0], signals["pitch"], atol=np.radians(0.5))


def test_a_wind_unlike_those_of_the_record_starts_at_rest(env, monkeypatch):
    """Slow wind at the start of an episode whose mean is fast."""
    kept = {}
    monkeypatch.setattr(record_store, "_records", kept)
    begun(env)
    (record,) = kept.values()
    calm = SteadyInflow(5.0, 90.0)
    assert record.start(calm, 0.0, 0.5, None, np.inf) is None
    assert record.start(SteadyInflow(15.0, 90.0, shear_exponent=0.2), 0.0, 0.5, None, 0.1) is None


def test_a_wind_that_has_no_past_is_not_asked_for_it():
    class Started:
        mean_speed, hub_height, description = 15.0, 90.0, "from time zero on"

        def velocity(self, points, time):
            assert time >= 0.0
            return np.broadcast_to([15.0 + np.sin(time), 0.0, 0.0], np.shape(points)).copy()

    env = gym.make("wt_gym/NREL5MW-Turbulent-v1", inflow=Started()).unwrapped
    env.reset(seed=0)
    np.testing.assert_allclose(env.simulator.tower_top()[2:], 0.0, atol=1e-9)
