"""What ``print`` shows of an environment."""

import copy
import pickle

import gymnasium as gym
import pytest

import wt_gym  # noqa: F401 - registers the environments
from wt_gym.control.controllers import make_controller
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.tasks import TASKS
from wt_gym.turbines import load_turbine
from wt_gym.turbines.windio_writer import write_windio

LINES = ("task", "turbine", "wind", "controller", "actions", "observations", "reward", "episode")


def rows(env):
    """Text by the first word of each line, those that continue one put behind it."""
    found = {}
    for line in str(env).splitlines():
        assert len(line) <= 120
        name, text = line[:14].strip(), line[14:]
        last = name or last  # noqa: F821 - the first line has a name
        found[last] = f"{found[last]} {text}" if last in found else text
    return found


@pytest.mark.parametrize("task", TASKS.values(), ids=lambda task: task.name)
def test_every_task_has_its_goal_wind_and_names(task):
    env = gym.make(task.id).unwrapped
    found = rows(env)
    assert len(str(env).splitlines()) <= 15
    assert tuple(name for name in found if name != "conditions") == LINES
    assert found["task"] == f"{task.id}: {task.goal}"
    assert env.turbine.heading in found["turbine"]
    assert f"{env.wind.speeds[1]:.4g} m/s" in found["wind"]
    for name in env.action_names:
        assert name in found["actions"]
    assert found["observations"].startswith(f"{env.observation_space.shape[0]}: rotor_")
    assert all(term.name in found["reward"] for term in env.reward_terms)


def test_conditions_are_those_that_differ_from_nothing():
    assert rows(gym.make("wt_gym/Dial-v0").unwrapped)["conditions"] == "a dial on the weights of the reward"
    assert rows(gym.make("wt_gym/PowerTracking-v0").unwrapped)["conditions"] == "a power reference"
    env = WindTurbineEnv(fault_kinds=("stuck_blade",), variation={"air_density": 0.9})
    assert rows(env)["conditions"] == "faults: stuck_blade; variation: air_density"
    assert "conditions" not in rows(WindTurbineEnv())


def test_names_that_differ_by_their_last_word_stand_together():
    found = rows(WindTurbineEnv(observation=("rotor", "blades"), action_mode="rate", pitch="individual"))
    assert "root_flap_moment_1/2/3" in found["observations"]
    assert "pitch_1_rate [rad/s]" in found["actions"]
    assert "generator_torque_rate [N m/s]" in found["actions"]


def test_controllers_by_name_and_as_objects():
    turbine = load_turbine("nrel_5mw")
    residual = {"action_mode": "residual"}
    assert rows(WindTurbineEnv())["controller"] == "none: the actions are the demands"
    assert rows(WindTurbineEnv(controller="discon+yaw", **residual))["controller"].startswith("discon+yaw, changed")
    own = make_controller("tsr_tracking", turbine)
    assert (
        rows(WindTurbineEnv(controller=own, **residual))["controller"]
        == "TsrTrackingController, changed by the actions"
    )
    made = rows(WindTurbineEnv(controller=lambda turbine: own, action_components=("pitch",)))["controller"]
    assert made == "TsrTrackingController, beside the actions"


def test_a_turbine_of_a_path_and_another_simulator(tmp_path):
    write_windio(load_turbine("nrel_5mw"), tmp_path / "turbine.yaml")
    env = WindTurbineEnv(turbine=tmp_path / "turbine.yaml", simulator=lambda *_: None, wind_speed=9.0)
    found = rows(env)
    assert found["task"] == "WindTurbineEnv"
    assert "5 MW, rotor 126 m" in found["turbine"]
    assert found["wind"] == "steady, 9 m/s at hub height"
    assert found["episode"].endswith("simulator your own")


def test_wrappers_and_texts_show_one_line():
    env = gym.make("wt_gym/NREL5MW-Steady-v1")
    assert str(env) == repr(env) == "<OrderEnforcing<WindTurbineEnv<wt_gym/NREL5MW-Steady-v1>>>"
    assert f"{env.unwrapped}" == "<WindTurbineEnv<wt_gym/NREL5MW-Steady-v1>>"
    assert f"{WindTurbineEnv()}" == "<WindTurbineEnv instance>"
    assert "\n" not in repr(env.unwrapped)


def test_vector_environments_say_how_many():
    envs = gym.make_vec("wt_gym/LoadReduction-v2", num_envs=3)
    assert rows(envs)["task"].startswith("3 turbines, wt_gym/LoadReduction-v2: Less blade fatigue")
    assert "\n" not in str(gym.wrappers.vector.RecordEpisodeStatistics(envs)) + repr(envs) + f"{envs}"
    envs.close()


def test_copies_and_closed_environments_have_the_same_text():
    env = gym.make("wt_gym/LoadReduction-v2").unwrapped
    text = str(env)
    assert str(copy.deepcopy(env)) == str(pickle.loads(pickle.dumps(env))) == text
    env.close()
    assert str(env) == text
