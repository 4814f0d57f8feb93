"""Relative rewards: what the controller alone earns is recorded once a beginning and never simulated again."""

import contextlib
import math
import pickle
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from wt_gym.envs import twin as reward_store
from wt_gym.envs.rewards import FunctionTerm
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.envs.vector_env import WindTurbineVectorEnv
from wt_gym.experiment.environments import Environments
from wt_gym.simulation import Simulator
from wt_gym.wind import MirroredInflow, SteadyInflow

ARGUMENTS = {
    "turbine": "nrel_5mw", "inflow": "turbulent", "wind_speed": (13.0, 17.0), "wind_seeds": (1, 2), "start": "steady",
    "action_mode": "residual", "pitch": "fixed-frame", "action_components": ("pitch",), "observation": ("rotor",),
    "control_dt": 0.1, "episode_length": 2.0, "starts": 3, "relative_reward": True,
}  # fmt: skip


@pytest.fixture(autouse=True)
def _cache(tmp_path, monkeypatch):
    """A cache of rewards on disk that is empty, and nothing in memory; turbulence stays where it is."""
    monkeypatch.setattr(reward_store, "cached_file", tmp_path.joinpath)
    reward_store._courses.clear()
    yield
    reward_store._courses.clear()


def episode(env, number=0, steps=20):
    """Rewards and terms of an episode under drawn actions."""
    env.reset(seed=5, options={"start_number": number})
    rng, out = np.random.default_rng(number), []
    for _ in range(steps):
        _, reward, terminated, truncated, info = env.step(rng.uniform(-1.0, 1.0, 3))
        out.append((reward, info["reward_terms"]))
        if terminated or truncated:
            break
    return out


def simulated(env):
    """How many steps of the controller alone were simulated in its last episode; None: no simulator was made."""
    return None if env.terms["twin"].env.simulator is None else env.terms["twin"]._steps


def files(tmp_path):
    return sorted((tmp_path / "twins").rglob("*.npz"))


def test_the_canary_is_measured_for_the_first_episode(monkeypatch):
    measured = []
    monkeypatch.setattr(reward_store, "canary_of", lambda *_: measured.append(1) or {})
    env = WindTurbineEnv(**ARGUMENTS)
    assert not measured
    for number in range(2):
        env.reset(options={"start_number": number})
    assert measured == [1]


def test_a_recorded_twin_pays_the_same_bits_as_one_that_runs_beside(tmp_path, monkeypatch):
    """From memory, from the disk, and stepped beside by an environment that keeps nothing."""
    first = WindTurbineEnv(**ARGUMENTS)
    beside = episode(first)
    assert simulated(first) == 20
    assert not files(tmp_path)
    first.close()
    assert len(files(tmp_path)) == 1
    again = WindTurbineEnv(**ARGUMENTS)
    assert episode(again) == beside
    assert simulated(again) is None
    reward_store._courses.clear()
    from_disk = WindTurbineEnv(**ARGUMENTS)
    assert episode(from_disk) == beside
    assert simulated(from_disk) is None
    keeps_nothing = WindTurbineEnv(**ARGUMENTS)
    monkeypatch.setattr(keeps_nothing.terms["twin"], "_identity", None)
    assert episode(keeps_nothing) == beside
    assert keeps_nothing.terms["twin"].course.key is None
    assert any(reward != 0.0 for reward, _ in beside)


def test_what_is_taken_off_is_what_the_controller_earns_alone():
    plain = WindTurbineEnv(**ARGUMENTS | {"relative_reward": False})
    relative, absolute = episode(WindTurbineEnv(**ARGUMENTS)), episode(plain)
    plain.reset(seed=5, options={"start_number": 0})
    for (reward, terms), (whole, parts) in zip(relative, absolute, strict=True):
        own = plain.step(np.zeros(3))[4]["reward_terms"]
        assert terms == {name: parts[name] - own[name] for name in own}
        assert reward == whole - sum(own.values())


def test_an_episode_that_ends_early_leaves_a_part_that_a_longer_one_goes_on_from(tmp_path):
    """The twin of the longer one comes from the beginning, and earns on the way what it has earned before."""
    whole = episode(WindTurbineEnv(**ARGUMENTS), 1)
    reward_store._courses.clear()
    env = WindTurbineEnv(**ARGUMENTS)
    assert episode(env, 1, steps=6) == whole[:6]
    assert episode(env, 0, steps=2) != whole[:2]
    assert len(env.terms["twin"].course) == 2
    assert episode(env, 1) == whole
    assert simulated(env) == 20
    env.close()
    assert sorted(len(np.load(file)["rows"]) for file in files(tmp_path)) == [2, 20]


def test_beginnings_are_as_many_as_starts_and_the_same_in_every_environment():
    env, other = WindTurbineEnv(**ARGUMENTS), WindTurbineEnv(**ARGUMENTS)
    winds = {}
    for seed in range(12):
        _, info = env.reset(seed=seed)
        winds[info["wind_speed"]] = env.episode_wind.time_offset, env.signals["azimuth"]
    assert len(winds) == 3
    for number in range(3):
        _, info = other.reset(options={"start_number": number})
        assert winds[info["wind_speed"]] == (other.episode_wind.time_offset, other.signals["azimuth"])
    unlimited = WindTurbineEnv(**ARGUMENTS | {"starts": None})
    assert len({unlimited.reset(seed=seed)[1]["wind_speed"] for seed in range(6)}) == 6
    with pytest.raises(ValueError, match="start_number must be left out without starts, got 1"):
        unlimited.reset(options={"start_number": 1})
    for wrong in (3, -1, 0.5, "first"):
        with pytest.raises(ValueError, match="start_number must be a whole number from 0 to 2, got"):
            env.reset(options={"start_number": wrong})


@pytest.mark.parametrize(("recorded", "elsewhere"), [(False, True), (True, False)])
def test_snapshots_go_on_with_the_twin(recorded, elsewhere):
    """Live or recorded, in the same environment or, through a pickle, in another one."""
    if recorded:
        episode(WindTurbineEnv(**ARGUMENTS))
    env = WindTurbineEnv(**ARGUMENTS)
    env.reset(seed=1, options={"start_number": 0})
    for _ in range(5):
        env.step(np.ones(3))
    snapshot = env.snapshot()
    assert (snapshot.parts["twin"].state is None) == recorded
    expected = [env.step(np.zeros(3))[1] for _ in range(5)]
    before = simulated(env)
    if elsewhere:
        snapshot = pickle.loads(pickle.dumps(snapshot))
        env = WindTurbineEnv(**ARGUMENTS)
    env.restore(snapshot)
    assert [env.step(np.zeros(3))[1] for _ in range(5)] == expected
    if not elsewhere:
        assert simulated(env) == before  # what follows is known


class Resting:
    """A controller of one's own."""

    channels = ("rotor_speed",)

    def start(self, signals, demand):
        self._demand = demand

    def step(self, signals, dt):
        return self._demand


@pytest.mark.parametrize(
    "own",
    [
        {"reward": [FunctionTerm(lambda step: 0.0)]},
        {"controller": lambda turbine: Resting()},
        {"simulator": lambda turbine, inflow, fidelity: Simulator(turbine, inflow=inflow, fidelity=fidelity)},
    ],
    ids=["reward", "controller", "simulator"],
)
def test_what_is_yours_is_not_kept(own, tmp_path):
    env = WindTurbineEnv(**ARGUMENTS | own)
    episode(env, steps=2)
    assert env.terms["twin"].course.key is None
    env.close()
    assert not files(tmp_path)
    assert not reward_store._courses


def test_other_environments_winds_and_starts_have_other_courses():
    def key(arguments=None, **options):
        env = WindTurbineEnv(**ARGUMENTS | (arguments or {}))
        env.reset(seed=3, options={"start_number": 0, **options})
        return env.terms["twin"].course.key

    agents = {"sensor_noise": 1.0, "observation": ("pitch",), "action_components": ("pitch", "torque")}
    same, seen_otherwise = key(), key(agents)
    assert same == seen_otherwise
    others = [
        key({"controller": "ipc:limit=0.05"}), key({"reward": {"actuator_use": 0.5}}), key({"control_dt": 0.2}),
        key({"overspeed_limit": 1.2}), key({"turbulence_class": "A"}), key({"site": {"air_density": 1.1}}),
        key({"wind_direction": 0.1}), key(start_number=1), key(wind_speed=15.0), key(azimuth=1.0), key(yaw=0.1),
    ]  # fmt: skip
    assert len({*others, same}) == len(others) + 1
    winds = ("wind_speed", "wind_seeds", "inflow")
    calm = WindTurbineEnv(
        inflow=SteadyInflow(15.0), **{name: value for name, value in ARGUMENTS.items() if name not in winds}
    )
    calm.reset(seed=0)
    assert calm.terms["twin"].course.key is not None


def test_memory_and_disk_are_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr(reward_store, "MOST_NUMBERS", 60)
    monkeypatch.setattr(reward_store, "MOST_FILES", 5)
    monkeypatch.setattr(reward_store, "_BETWEEN", 1)
    names = ("power", "blades")
    for k in range(12):
        course = reward_store.kept_course(f"{k:02d}", names)
        for step in range(10):
            course.append(step, {"power": step, "blades": -k}, False)
        course.save()
    assert len(files(tmp_path)) == 5
    assert [*reward_store._courses] == ["08", "09", "10", "11"]  # the last one was empty when it came
    assert reward_store.kept_course("11", names).terms(3) == {"power": 3.0, "blades": -11.0}
    assert len(reward_store.kept_course("00", names)) == 0


@pytest.mark.parametrize("damage", [b"no archive", None])
def test_a_file_that_is_not_sound_is_recorded_again(damage, tmp_path, caplog):
    env = WindTurbineEnv(**ARGUMENTS)
    expected = episode(env)
    env.close()
    (path,) = files(tmp_path)
    if damage is None:
        np.savez(path, names=np.array(["power"]), rows=np.array([[math.nan]]), ended=False)
    else:
        path.write_bytes(damage)
    reward_store._courses.clear()
    env = WindTurbineEnv(**ARGUMENTS)
    assert episode(env) == expected
    assert "it is made again" in caplog.text
    env.close()
    reward_store._courses.clear()
    assert len(reward_store.kept_course(path.stem, tuple(expected[0][1]))) == 20


def test_an_evaluation_begins_where_no_training_does():
    """Beginnings of a training are few and always the same; those of an evaluation are drawn by its seed."""
    environments = Environments("wt_gym/Gusts-v3", {"start": "steady"}, 4.0)
    evaluated, trained = environments.plain.unwrapped, gym.make("wt_gym/Gusts-v3", start="steady").unwrapped
    starts = trained.options.starts
    known = set()
    for number in range(starts):
        trained.reset(seed=0, options={"start_number": number, "wind_speed": 12.0})
        known.add(repr(trained.episode_wind.inflow))
    for seed in range(20):
        evaluated.reset(seed=7_000_000 + seed, options={"wind_speed": 12.0})
        assert repr(evaluated.episode_wind.inflow) not in known


def test_copies_in_a_vector_pay_what_single_ones_do():
    """All of them in the same beginning at the same time."""
    arguments = ARGUMENTS | {"starts": 1}
    with contextlib.closing(WindTurbineVectorEnv(3, threads=2, **arguments)) as vector:
        vector.reset(seed=[1, 2, 3])
        actions = np.random.default_rng(0).uniform(-1.0, 1.0, (10, 3, 3))
        rewards = np.array([vector.step(action)[1] for action in actions])
        assert len({id(env.terms["twin"].course) for env in vector.envs}) == 1
    reward_store._courses.clear()
    for k in range(3):
        env = WindTurbineEnv(**arguments)
        env.reset(seed=k + 1)
        assert [env.step(action)[1] for action in actions[:, k]] == rewards[:, k].tolist()


def test_a_baseline_on_a_path_is_recorded_once():
    """Drawn with turbulence; another path, offset, scale, profile or mirror image is another one."""
    path = ARGUMENTS | {"inflow": "path", "wind_speed": (9.0, 17.0)}
    first, again = WindTurbineEnv(**path), WindTurbineEnv(**path)
    beside = episode(first)
    assert simulated(first) == 20
    first.close()
    assert episode(again) == beside
    assert simulated(again) is None
    beginning = again.terms["twin"]._beginning
    wind = beginning.wind.inflow
    winds = [wind, MirroredInflow(wind)] + [
        replace(wind, **{name: 1.01 * getattr(wind, name)}) for name in ("times", "speeds", "scales", "offset")
    ]
    winds += [replace(wind, profile=SteadyInflow(1.0, 90.0, shear_exponent=0.3)), replace(wind, box=None)]
    keys = [again.terms["twin"]._key(replace(beginning, wind=replace(beginning.wind, inflow=other))) for other in winds]
    assert None not in keys
    assert len(set(keys)) == len(winds)
    elsewhere = replace(beginning, wind=replace(beginning.wind, wind_seed=-1))  # turbulence from a file
    assert again.terms["twin"]._key(elsewhere) is None
