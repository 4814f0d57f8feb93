"""TorchRL takes the environments, where it is installed."""

from functools import partial

import pytest

from wt_gym.tasks import TASKS

torchrl_envs = pytest.importorskip("torchrl.envs", reason="TorchRL is not installed: pip install torchrl")
SETTLED = {"wind_speed": 12.0, "start": "steady"}


def make(env_id, **kwargs):
    """Environment from the operating point."""
    return torchrl_envs.GymEnv(env_id, **SETTLED | kwargs)


@pytest.mark.parametrize("env_id", [*(task.id for task in TASKS.values()), "wt_gym/NREL5MW-Steady-v1"])
def test_specs_agree_with_what_the_environment_gives(scripted, env_id):
    """Every id is made, though TorchRL tries an argument that none has."""
    env = make(env_id)
    torchrl_envs.check_env_specs(env)
    steps = env.rollout(4)
    assert steps["observation"].shape == (4, *env.observation_spec["observation"].shape)
    assert env.observation_spec["observation"].is_in(steps["next", "observation"][-1])
    env.close()


def test_repeated_actions(scripted):
    once, thrice = make("wt_gym/NREL5MW-Steady-v1"), make("wt_gym/NREL5MW-Steady-v1", frame_skip=3)
    once.rollout(6), thrice.rollout(2)
    assert once.unwrapped.signals["time"] == pytest.approx(thrice.unwrapped.signals["time"])


@pytest.mark.slow
def test_parallel_environments_and_collectors():
    from torchrl.collectors import Collector

    factory = partial(make, "wt_gym:wt_gym/NREL5MW-Steady-v1")
    parallel = torchrl_envs.ParallelEnv(2, factory, mp_start_method="spawn")
    assert parallel.rollout(3).shape == (2, 3)
    parallel.close()
    collector = Collector(factory, None, frames_per_batch=8, total_frames=16)
    assert [tuple(batch.shape) for batch in collector] == [(8,), (8,)]
    collector.shutdown()
