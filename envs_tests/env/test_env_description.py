"""What ``print`` shows of an environment."""

import gymnasium as gym
import pytest

import wt_gym  # noqa: F401 - registers the environments
from wt_gym.control.controllers import make_controller
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.tasks import TASKS
from wt_gym.turbines import load_turbine

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


TASKS_OF_NREL = [task for task in TASKS.values() if not task.name.startswith("IEA")]


@pytest.mark.parametrize("task", TASKS_OF_NREL, ids=lambda task: task.name)
def test_every_task_has_its_goal_wind_and_names(task):
    env = gym.make(task.id).unwrapped
    found = rows(env)
    assert len(str(env).splitlines()) <= 17
    assert tuple(name for name in found if name != "conditions") == LINES
    assert found["task"] == f"{task.id}: {task.goal}"
    assert env.turbine.heading in found["turbine"]
    assert f"{env.wind.speeds[1]:.4g} m/s" in found["wind"]
    for name in env.action_names:
        assert name in found["actions"]
    first = env.observation_names[0].rstrip("1")
    assert found["observations"].startswith(f"{env.observation_space.shape[0]}: {first}")
    assert all(term.name in found["reward"] for term in env.reward_terms)


def test_conditions_are_those_that_differ_from_nothing():
    assert rows(gym.make("wt_gym/Dial-v1").unwrapped)["conditions"] == "a dial on the weights of the reward"
    assert rows(gym.make("wt_gym/PowerTracking-v1").unwrapped)["conditions"] == "a power reference"
    env = WindTurbineEnv(fault_kinds=("stuck_blade",), variation={"air_density": 0.9})
    assert rows(env)["conditions"] == "faults: stuck_blade; variation: air_density"
    assert "conditions" not in rows(WindTurbineEnv())


def test_controllers_by_name_and_as_objects():
    own = make_controller("tsr_tracking", load_turbine("nrel_5mw"))
    for arguments, text in (
        ({}, "none: the actions are the demands"),
        ({"controller": own, "action_mode": "residual"}, "TsrTrackingController, changed by the actions"),
        ({"controller": lambda _: own, "action_components": ("pitch",)}, "TsrTrackingController, beside the actions"),
    ):
        assert rows(WindTurbineEnv(**arguments))["controller"] == text


def test_wrappers_and_texts_show_one_line():
    env = gym.make("wt_gym/NREL5MW-Steady-v1")
    assert str(env) == repr(env) == "<OrderEnforcing<WindTurbineEnv<wt_gym/NREL5MW-Steady-v1>>>"
    assert f"{env.unwrapped}" == "<WindTurbineEnv<wt_gym/NREL5MW-Steady-v1>>"
    assert f"{WindTurbineEnv()}" == "<WindTurbineEnv instance>"
    assert "\n" not in repr(env.unwrapped)


def test_vector_environments_say_how_many():
    envs = gym.make_vec("wt_gym/LoadReduction-v3", num_envs=3)
    assert rows(envs)["task"].startswith("3 turbines, wt_gym/LoadReduction-v3: Less blade fatigue")
    assert "\n" not in str(gym.wrappers.vector.RecordEpisodeStatistics(envs)) + repr(envs) + f"{envs}"
    envs.close()
