"""Whether the tasks can be learned, and whether what is learned on the linear model holds in the simulator."""

from functools import partial

import gymnasium as gym
import numpy as np
import pytest

from wt_gym.analysis.metrics import LIFETIME_COST_WEIGHTS
from wt_gym.envs.turbine_env import turbine_env_of
from wt_gym.experiment.agents import ConstantAgent
from wt_gym.experiment.run import ENDLESS, benchmark_metrics, play
from wt_gym.experiment.tuning import Cost
from wt_gym.learning.learnability import LearnabilityOptions, measure
from wt_gym.learning.linear_env import LinearVectorEnv, cached_model, forecast, in_winds
from wt_gym.tasks import LINEAR, TASKS

pytestmark = pytest.mark.slow
TASK = TASKS["LoadReduction"].id
WINDS = ((15.0, 1001), (15.0, 1002), (18.0, 1001), (18.0, 1002))
LASTS, SKIP = 180.0, 30.0


@pytest.mark.parametrize("name", LINEAR)
def test_the_actions_hold_the_optimum_and_the_gradient_shows_the_way(name):
    task = TASKS[name]
    rated = turbine_env_of(gym.make(task.id)).turbine.rated_wind_speed
    found = measure(task.id, options=LearnabilityOptions(speeds=(round(1.3 * rated), round(1.55 * rated))))
    assert found.bound > 0.92
    assert min(found.alignment[4.0]) > 0.9
    assert found.signal > 0.35


def test_without_credit_the_gradient_is_noise():
    found = measure(TASK, {"reward_credit": False}, LearnabilityOptions(seeds=(1,), speeds=(15.0,)))
    assert found.signal < 0.35


def learned(steps, seed=0):
    """PPO of stable-baselines3 on the linear model, as of agents/train_sb3.py."""
    import torch
    from stable_baselines3 import PPO

    from wt_gym.learning.environments import TurbineVecEnv

    torch.set_num_threads(1)
    model = PPO(
        "MlpPolicy", TurbineVecEnv("wt_gym/LoadReduction-Linear-v0", 64), n_steps=256, batch_size=2048, gamma=0.98,
        ent_coef=0.005, learning_rate=lambda left: 3e-3 * max(left, 0.0),
        policy_kwargs={"net_arch": {"pi": [], "vf": [64, 64]}, "log_std_init": -1.5}, seed=seed, device="cpu",
    )  # fmt: skip
    return model.learn(steps)


@pytest.fixture(scope="module")
def policies():
    return {"short": learned(100_000), "long": learned(2_500_000)}


def simulated(agent, wind, **changes):
    """Metrics of a run in the simulator; without an agent under zero actions."""
    given = {"relative_reward": False, "reward_credit": False, "starts": None, "start": "steady", **changes}
    env = gym.make(TASK, max_episode_steps=ENDLESS, **given)
    plain = turbine_env_of(env)
    plain.outer_steps = ENDLESS
    options = {"azimuth": 0.0, "wind_speed": wind[0], "wind_seed": wind[1], "time_offset": 0.0}
    done = play(env, agent or ConstantAgent(plain.layout), seed=wind[1], options=options, duration=LASTS)
    assert done.ending == "time"
    return benchmark_metrics(done.after_start, plain.turbine, SKIP), plain.turbine


def improvement(agent, base=None, **changes):
    """Mean improvement of the lifetime cost in `WINDS` [%]."""
    found = []
    for wind in WINDS:
        before, turbine = simulated(None, wind, **(base or {}))
        found.append(-100.0 * Cost().of(simulated(agent, wind, **changes)[0], before, turbine))
    return float(np.mean(found))


class Scaled:
    """A policy whose actions are a share of those of another."""

    def __init__(self, agent, share):
        self.agent, self.share = agent, share

    def predict(self, observation, **settings):
        action, state = self.agent.predict(observation, **settings)
        return (np.float32(self.share) * action).clip(-1.0, 1.0), state


def test_forecasts_of_the_cost_hold_in_the_simulator(policies):
    model = in_winds(cached_model(TASK, {}), TASK, {}, WINDS, LASTS)
    models = LinearVectorEnv(len(WINDS), None, "Disabled", model=model, modeled=TASK)
    agents = {
        **policies, "half": Scaled(policies["long"], 0.5), "more": Scaled(policies["long"], 1.3),
        "quarter": Scaled(policies["long"], 0.25),
    }  # fmt: skip
    for name, agent in agents.items():
        changes = forecast(models, agent, SKIP)
        forecast_gain = -100.0 * np.mean([sum(LIFETIME_COST_WEIGHTS[k] * v for k, v in one.items()) for one in changes])
        found = improvement(agent)
        assert forecast_gain == pytest.approx(found, abs=1.0), name


def test_what_ppo_learns_on_the_linear_model_holds_in_the_simulator(policies):
    """At least three quarters of what the linear optimal pitch improves over the turbine's own controller."""
    nobody = {"controller": "discon", "observation": ["rotor"]}
    best = {"controller": "linear_optimal", "observation": ["rotor"]}
    over = partial(improvement, base=nobody)
    assert over(policies["long"]) > 0.75 * over(None, **best)
