"""Episodes that begin amid the operation of the turbine."""

import logging
from dataclasses import replace
from functools import cache

import gymnasium as gym
import numpy as np
import pytest

from wt_gym.base.canary import differing
from wt_gym.control import Demand
from wt_gym.control.controllers import DisconController, make_controller
from wt_gym.control.controllers.controller import memory_of
from wt_gym.envs import episode_start, record_store
from wt_gym.envs.record_store import (
    CATALOG,
    StartFile,
    digest_of_turbine,
    dimensions,
    find_record,
    record_canary,
    recorded_speeds,
)
from wt_gym.envs.running_record import ControllerForm, Record, RecordingPlan, StartRecorder, _places
from wt_gym.experiment.run import benchmark_fingerprint
from wt_gym.simulation import Signals
from wt_gym.simulation.channels import parities
from wt_gym.turbines import load_turbine
from wt_gym.wind import MirroredInflow, SteadyInflow, TurbulenceBox, TurbulentInflow

TASK = "wt_gym/LoadReduction-v3"
OWN = {"observation": None, "reward_credit": False}  # of a controller without an observer
LOADS = ("root_flap_moment", "tower_base_fore_aft_moment", "tower_base_side_side_moment")
BRIEF = RecordingPlan(settling=10.0, instants=2, spacing=0.1)
PLAIN = next(recorded for recorded in CATALOG if recorded.name == "nrel_5mw")


@pytest.fixture(scope="module")
def env():
    made = gym.make(TASK, wind_speed=15.0).unwrapped
    yield made
    made.close()


@pytest.fixture(scope="module")
def brief(turbine):
    """Two instants with a step of the controller between them, the form of its memory, and the rows of the record."""
    controller = make_controller("discon", turbine)
    result = StartRecorder(turbine, "training", controller).run(PLAIN.inflow(15.0, 0), BRIEF)
    form = ControllerForm.of(controller, result.memories)
    return result, form, np.concatenate([result.rows, form.numbers(result.memories)], axis=1)[None]


def begun(env, seed=0, **options):
    env.reset(seed=seed, options={"wind_seed": 5001, "time_offset": 80.0, **options})
    return env.signals


def test_seeds_draw_among_instants_of_a_tower_that_swings(env):
    azimuths, motion = set(), []
    for seed in range(6):
        azimuths.add(round(begun(env, seed=seed)["azimuth"], 6))
        motion.append(env.simulator.tower_top()[2:])
    assert len(azimuths) > 1
    assert (np.std(motion, axis=0) > 1e-4).all()
    term = next(term for term in env.reward_terms if term.name == "tower_side_side_fatigue")
    assert term._filter.mean != env.signals["tower_base_side_side_moment"]  # filters begin with running means


def test_every_id_of_the_package_has_a_record():
    ids = [name for name in gym.registry if name.startswith("wt_gym/")]
    turbines = [gym.make(name).unwrapped.layout.turbine for name in ids]
    without = [turbine.name for turbine in turbines if find_record(turbine, 1.0) is None]
    assert len(ids) > 20
    assert without == []


def test_a_wind_speed_that_was_not_met_before_costs_no_simulation(env, monkeypatch):
    begun(env)
    monkeypatch.setattr("wt_gym.simulation.Simulator.__init__", lambda *_: pytest.fail("another simulation"))
    for speed in (12.5, 19.0):
        begun(env, wind_speed=speed)


def test_azimuth_of_the_options_is_kept(env):
    # the rotor is ahead of the generator by the twist of the shaft, 4.2 MN m over 868 MN m/rad
    assert begun(env, azimuth=1.0)["azimuth"] == pytest.approx(1.0, abs=0.006)


@pytest.mark.parametrize("option", [{"rotor_speed": 1.2}, {"pitch": 0.1}, {"generator_torque": 4e4}, {}])
def test_fixed_and_steady_starts_are_at_rest(env, option):
    env = env if option else gym.make(TASK, wind_speed=15.0, start="steady").unwrapped
    assert np.ptp(begun(env, **option)["pitch"]) == 0.0
    np.testing.assert_allclose(env.simulator.tower_top()[2:], 0.0, atol=1e-9)


@pytest.mark.parametrize("run", [0, 7])
def test_start_is_the_instant_of_the_record_after_the_same_wind(turbine, run):
    """In the wind of a recorded run the nearest instant is that of the run, with its motion."""
    _, record = find_record(turbine, 1.0)
    plan, inflow = RecordingPlan(), PLAIN.inflow(14.0, run)
    time = plan.settling + 3 * plan.spacing
    later = replace(inflow, time_offset=inflow.time_offset + time)
    start = record.start(turbine, later, 14.0, 0.0, 0.0, None, np.inf)
    place = recorded_speeds(turbine).tolist().index(14.0) * PLAIN.runs * plan.instants + run * plan.instants + 3
    same = record.at(turbine, place)
    assert start.rotor_speed == pytest.approx(same.rotor_speed, rel=1e-4)  # the wind is recorded in 16 bits
    np.testing.assert_allclose(start.motion, same.motion, rtol=1e-2, atol=1e-4 * np.abs(same.motion).max())
    assert set(start.deviations) == set(LOADS)


def test_a_file_holds_the_record_to_sixteen_bits(turbine, brief, tmp_path):
    _, form, rows = brief
    head = StartFile(turbine.name, dimensions(turbine), "training", "discon", 1.0, form.kind, 45, {"speed": "1 2"})
    head.write(tmp_path / "record.npz", np.array([15.0]), rows, form)
    assert StartFile.of(tmp_path / "record.npz") == head
    read, written = head.read(tmp_path / "record.npz"), Record(3, 45, np.array([15.0]), rows, form)
    for instant in range(2):
        a, b = read.at(turbine, instant), written.at(turbine, instant)
        np.testing.assert_allclose(a.motion, b.motion, atol=np.ptp(rows[0], axis=0).max() / 65_535, rtol=1e-9)
        np.testing.assert_allclose(a.memory.values, b.memory.values, rtol=1e-6)


def test_a_start_follows_the_difference_of_the_winds(turbine):
    """In stronger wind than before the instant the blades pitch more; the azimuth is that of the record."""
    _, record = find_record(turbine, 1.0)
    speeds = [15.0, 15.1]
    starts = [
        record.start(turbine, SteadyInflow(speed, 90.0, shear_exponent=0.2), 15.0, 0.0, 0.0, None, np.inf)
        for speed in speeds
    ]
    assert starts[0].azimuth == starts[1].azimuth
    assert 0.0 < starts[1].pitch.mean() - starts[0].pitch.mean() < np.radians(1.0)


@pytest.mark.parametrize(("change", "share"), [(1e6, 1.0), (-1e6, 0.0)])
def test_a_start_never_asks_for_more_torque_than_the_generator_has(turbine, change, share):
    """A wind that differs from that of the record changes the torque, which ends at the limits."""
    _, record = find_record(turbine, 1.0)
    row = np.zeros(record._rows.shape[1])
    row[_places(3)["generator_torque"]] = change
    limit = turbine.drivetrain.max_generator_torque
    assert 0.0 < record.at(turbine, 0).generator_torque < limit
    assert record.at(turbine, 0, change=row).generator_torque == share * limit


@pytest.mark.parametrize("name", ["discon", "discon+yaw", "discon+supervisor:averaging=60"])
def test_controller_continues_as_the_one_that_was_recorded(turbine, brief, name):
    """Integrals and filters are put back, also where the recorded controller is the base of another one."""
    result, form, rows = brief
    start = Record(3, 45, np.array([15.0]), rows, form).at(turbine, 0)
    running = make_controller(name, turbine)
    signals = Signals(np.zeros(69), 3)
    signals.set("generator_speed", result.rows[0, 2])
    start.start(running, signals, start_demand(start))
    inner = running
    while type(inner) is not DisconController:
        inner = inner.base
    inner.step(signals, 0.1)
    np.testing.assert_allclose(memory_of(inner).values, result.memories[1].values, rtol=1e-6)


def start_demand(start):
    return Demand(start.pitch, 0.0, start.generator_torque)


def test_controllers_with_other_parameters_start_from_the_present_demand(turbine, brief):
    result, form, rows = brief
    memory = form.memory(form.numbers(result.memories)[0])
    other = make_controller("discon", turbine)
    other.parameters = replace(other.parameters, corner_frequency=2.0)
    signals = Signals(np.zeros(69), 3)
    other.start(signals, start_demand(Record(3, 45, np.array([15.0]), rows, form).at(turbine, 0)))
    before = memory_of(other).values
    memory.put(other)
    np.testing.assert_array_equal(memory_of(other).values, before)


def test_a_turbine_without_a_record_starts_at_rest_and_says_so_once(caplog, monkeypatch, env):
    monkeypatch.setattr(record_store, "_heads", dict)
    episode_start._report_missing.cache_clear()
    with caplog.at_level(logging.WARNING):
        for seed in range(2):
            begun(env, seed=seed)
    np.testing.assert_allclose(env.simulator.tower_top()[2:], 0.0, atol=1e-9)
    assert caplog.text.count("there is no record of it") == 1


@pytest.fixture
def of_user(turbine, brief, tmp_path, monkeypatch):
    """Writes a record of the user of a turbine, with changes of its head, where no other is; gives the path."""
    _, form, rows = brief
    folder = tmp_path / "running"
    folder.mkdir()
    monkeypatch.setenv("WT_GYM_CACHE", str(tmp_path))
    monkeypatch.setattr(record_store, "_heads", cache(record_store._heads.__wrapped__))
    for name in ("_read", "_is_of_user", "_digest_of_file"):
        monkeypatch.setattr(record_store, name, cache(getattr(record_store, name).__wrapped__))

    def write(own, **changes):
        made = {"canary": record_canary(own, "training", "discon", 1.0), "turbine_digest": digest_of_turbine(own)}
        head = StartFile(own.name, dimensions(own), "training", "discon", 1.0, form.kind, 45, **made | changes)
        head.write(folder / "own.npz", np.array([14.0, 15.0]), np.repeat(rows, 2, axis=0), form)
        record_store._heads.cache_clear()
        return folder / "own.npz"

    return write


def own_turbine(turbine, **changes):
    return replace(turbine, name="own", hub=replace(turbine.hub, mass=6e4), **changes)


def test_a_record_of_the_user_serves_the_recorded_turbine_at_any_site(turbine, of_user):
    own = own_turbine(turbine)
    of_user(own)
    assert find_record(own, 1.0) is not None
    assert find_record(own.with_site(air_density=1.1), 1.0) is not None
    assert find_record(replace(own, hub=replace(own.hub, mass=6.1e4)), 1.0) is None


def test_a_record_of_another_behavior_is_left_aside_and_says_so_once(turbine, of_user, caplog):
    own = own_turbine(turbine)
    path = of_user(own, canary={"turning[1]": "1 2 3 4"})
    with caplog.at_level(logging.WARNING):
        assert [find_record(own, 1.0) for _ in range(2)] == [None, None]
    assert caplog.text.count(f"the record {path} is of another behavior (history[0] in its form): record again") == 1


@pytest.mark.parametrize("share", [0.0, 0.99, None])
def test_a_damaged_record_of_the_user_is_left_aside(turbine, of_user, caplog, share):
    """Cut off, or with other bytes amid its numbers."""
    own = own_turbine(turbine)
    path = of_user(own)
    content = path.read_bytes()
    place = content.index(b"codes.npy") + 300
    spoiled = content[:place] + bytes(50) + content[place + 50 :]
    path.write_bytes(spoiled if share is None else content[: int(share * len(content))])
    with caplog.at_level(logging.WARNING):
        assert [find_record(own, 1.0) for _ in range(2)] == [None, None]
        assert find_record(turbine, 1.0) is not None
    assert caplog.text.count(f"the record {path} is left aside") == 1


def test_the_fingerprint_of_a_benchmark_names_a_record_of_the_user(turbine, of_user):
    own = own_turbine(turbine)
    before = benchmark_fingerprint(own, "training")
    of_user(own)
    after = benchmark_fingerprint(own, "training")
    assert differing(before, after)[0] == "start"
    assert "start" not in benchmark_fingerprint(turbine, "training")


def softer(beam):
    return replace(beam, stiffness=0.9 * beam.stiffness)


@pytest.mark.parametrize(
    "change",
    [
        lambda one: {"blade": replace(one.blade, structure=softer(one.blade.structure))},
        lambda one: {"blade": replace(one.blade, chord=1.01 * one.blade.chord)},
        lambda one: {"tower": replace(one.tower, structure=softer(one.tower.structure))},
        lambda one: {"nacelle": replace(one.nacelle, mass=1.1 * one.nacelle.mass)},
    ],
)
def test_a_turbine_of_the_name_of_another_does_not_take_its_motion(turbine, change):
    assert find_record(replace(turbine, notes=("a copy",)), 1.0) is not None
    assert find_record(replace(turbine, **change(turbine)), 1.0) is None


def test_a_tower_on_a_monopile_is_not_that_on_land():
    """They have one name and the same dimensions."""
    land, monopile = (load_turbine(name) for name in ("iea_15mw", "iea_15mw_monopile"))
    assert [record_store._is_of_catalog("iea_15mw", one) for one in (land, monopile)] == [True, False]


def test_a_counter_clockwise_rotor_starts_as_the_mirror_image(turbine, brief):
    start = Record(3, 45, np.array([15.0]), brief[2], brief[1]).at(turbine, 0)
    image, side_side = start.mirrored(3), "tower_base_side_side_moment"
    assert image.deviations[side_side] == -start.deviations[side_side]
    np.testing.assert_array_equal(image.deviations["root_flap_moment"], start.deviations["root_flap_moment"])
    np.testing.assert_array_equal(image.trail, start.trail * parities(3))
    np.testing.assert_array_equal(replace(start, tower_top=np.ones(4)).mirrored(3).tower_top, [1, -1, 1, -1])
    box = TurbulenceBox.kaimal(15.0, turbine.hub_height, turbine.rotor_diameter, "B", seed=9)
    wind = TurbulentInflow(box)
    winds = (wind, None), (MirroredInflow(wind), {"rotation": "counter-clockwise"})
    envs = [gym.make("wt_gym/NREL5MW-Turbulent-v1", inflow=inflow, site=site).unwrapped for inflow, site in winds]
    for env in envs:
        env.reset(seed=3)
    one, other = (env.signals for env in envs)
    assert abs(envs[1].simulator.tower_top()[2:]).max() > 1e-4
    np.testing.assert_allclose(other.values, one.values * parities(3), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(envs[1].simulator.tower_top(), envs[0].simulator.tower_top() * [1, -1, 1, -1])


def test_parameters_that_are_changed_later_stay():
    env = gym.make(TASK, wind_speed=15.0, controller="side_side_damper", **OWN).unwrapped
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
    env = gym.make(TASK, wind_speed=15.0, controller=Logging(), **OWN).unwrapped
    signals = begun(env)
    assert env.controller.log == []
    assert abs(env.simulator.tower_top()[2:]).max() > 1e-4
    env.step(np.zeros(env.action_space.shape))
    step = env.controller.parameters.max_pitch_rate * 0.1
    np.testing.assert_allclose(env.controller.log[0], signals["pitch"], atol=step)


def test_a_wind_unlike_those_of_the_record_starts_at_rest(turbine):
    """A gust that the turbine has never met before the start, or a limit of the rotor speed below all."""
    _, record = find_record(turbine, 1.0)
    gust, usual = SteadyInflow(60.0, 90.0), SteadyInflow(15.0, 90.0, shear_exponent=0.2)
    assert record.start(turbine, gust, 15.0, 0.0, 0.5, None, np.inf) is None
    assert record.start(turbine, usual, 15.0, 0.0, 0.5, None, 0.1) is None


def test_a_wind_that_has_no_past_is_not_asked_for_it():
    class Started:
        mean_speed, hub_height, description = 15.0, 90.0, "from time zero on"

        def velocity(self, points, time):
            assert time >= 0.0
            return np.broadcast_to([15.0 + np.sin(time), 0.0, 0.0], np.shape(points)).copy()

    env = gym.make("wt_gym/NREL5MW-Turbulent-v1", inflow=Started()).unwrapped
    env.reset(seed=0)
    np.testing.assert_allclose(env.simulator.tower_top()[2:], 0.0, atol=1e-9)
