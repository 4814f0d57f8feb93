"""TorchRL takes the environments; on demand (``-m slow``), where it is installed."""

import pytest

import wt_gym  # noqa: F401 - registers the environments
from wt_gym.tasks import TASKS

pytestmark = pytest.mark.slow
torchrl_envs = pytest.importorskip("torchrl.envs")


@pytest.mark.parametrize("task", ["LoadReduction", "MaxPower", "Yaw"])
def test_specs_agree_with_what_the_environment_gives(task):
    env = torchrl_envs.GymEnv(TASKS[task].ids[-1], wind_speed=12.0, wind_seeds=(1,))
    torchrl_envs.check_env_specs(env)
    steps = env.rollout(4)
    assert steps["observation"].shape == (4, *env.observation_spec["observation"].shape)
    assert env.observation_spec["observation"].is_in(steps["next", "observation"][-1])
    env.close()
