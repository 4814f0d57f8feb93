"""The linear model as an environment: exact sums, rewards of the terms, conventions."""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from scipy.signal import fftconvolve

import wt_gym
from wt_gym.envs.fatigue import LOADS
from wt_gym.envs.terms import Transition
from wt_gym.envs.wind_sampler import TRAINING_WIND_SEEDS
from wt_gym.experiment.trained_agent import TrainedAgent
from wt_gym.learning import linear_env
from wt_gym.learning.linear_env import RAW, LinearModel, LinearTurbineEnv, LinearVectorEnv, forecast
from wt_gym.learning.models import ArrayPPO
from wt_gym.learning.options import TrainingConfig
from wt_gym.learning.train import train
from wt_gym.tasks import TASKS

TASK = TASKS["LoadReduction"].id
RUNS, STEPS, LAGS = 3, 600, 75
N_OBS, OWN = 87, 10


@pytest.fixture(scope="module")
def model():
    """A model of noise and decaying responses."""
    rng = np.random.default_rng(0)
    sizes = np.array([6e6, 1e6, 1e6, 6e7, 6e6, 1e6, 3e6, 1e6, 5e6])
    raw = sizes * (np.array([1, 0, 0, 1, 0, 0, 0, 0, 1]) + 0.1 * rng.normal(size=(RUNS, STEPS, len(RAW))))
    decay = np.exp(-np.arange(LAGS) / 8.0) * np.cos(0.3 * np.arange(LAGS))
    scales = np.concatenate([sizes * [0.3, 0.3, 0.3, 0.3, 0.3, 0, 0, 0, 0.3], np.full(OWN, 0.1)])
    return LinearModel(
        speeds=np.array([13.0, 15.0, 18.0]),
        observations=rng.uniform(-0.4, 0.4, (RUNS, STEPS, N_OBS)).astype(np.float32), raw=raw,
        azimuth=np.cumsum(np.full((RUNS, STEPS), 0.25), axis=1),
        pitch=0.2 + 0.001 * rng.normal(size=(RUNS, STEPS, 3)), share=np.full((RUNS, STEPS), 0.8),
        knots=np.array([12.0, 20.0]),
        responses=rng.normal(size=(2, len(RAW) + OWN, 3, 1)) * scales[:, None, None] * decay,
        curvature=np.array([0.5, 1.0]),
    )  # fmt: skip


def vector(model, count=RUNS, mode="Disabled", **changes):
    return LinearVectorEnv(count, None, mode, model=model, modeled=TASK, **changes)


def actions(steps, count=RUNS, size=0.5):
    return np.random.default_rng(1).uniform(-size, size, (steps, count, 3)).astype(np.float32)


def started(model, **changes):
    env = vector(model, **changes)
    for k in range(RUNS):
        env.start_at(k, k)
    return env


def played(env, given):
    rewards, effects, seen, acted = [], [], [], []
    for action in given:
        outcomes = env.step_each(action)
        rewards.append([out.reward for out in outcomes])
        effects.append(env.effects)
        seen.append([out.observation for out in outcomes])
        acted.append(env._acted.copy())
    return tuple(map(np.array, (rewards, effects, seen, acted)))


def test_effects_are_the_convolution_with_the_responses(model):
    env = started(model)
    _, effects, seen, acted = played(env, actions(120))
    for k, speed in enumerate(model.speeds):
        share = (speed - 12.0) / 8.0
        responses = (1.0 - share) * model.responses[0] + share * model.responses[1]
        expected = sum(fftconvolve(responses[:, j], acted[None, :, k, j], axes=1)[:, :120] for j in range(3))
        np.testing.assert_allclose(effects[:, k].T, expected[: len(RAW)], atol=1e-9 * np.abs(expected).max())
        recorded = model.observations[k, 51:171]
        own = env._own
        np.testing.assert_allclose(seen[:, k][:, own], recorded[:, own] + expected[len(RAW) :].T, atol=1e-4)
        others = np.setdiff1d(np.arange(N_OBS), [*own, *env._offset_places])
        np.testing.assert_array_equal(seen[:, k][:, others], recorded[:, others])


def test_rewards_are_those_of_the_terms_of_the_environment(model):
    """The terms themselves, on signals with and without the effects."""
    weights = {"actuator_use": 0.0, "power": 0.0, "overspeed": 0.0}
    env = started(model, reward_credit=False, reward={**weights, "blade_fatigue": 7.5})
    rewards, effects, *_ = played(env, actions(60))
    turbine, dt = env.envs[0].turbine, env.envs[0].control_dt
    for k in range(RUNS):
        both = []
        for changed in (True, False):
            terms = copy.deepcopy(env.envs[0].reward_terms)
            total, mean = np.zeros(60), model.raw[k].mean(0)
            series = model.raw[k].copy()
            if changed:
                series[51:111] += effects[:, k]
            for step in range(STEPS):
                angles = model.azimuth[k, step] + 2.0 * np.pi / 3.0 * np.arange(3)
                flap = series[step, 0] + series[step, 1] * np.cos(angles) + series[step, 2] * np.sin(angles)
                after = {
                    "root_flap_moment": flap, "azimuth": model.azimuth[k, step],
                    "tower_base_fore_aft_moment": series[step, 3], "tower_base_side_side_moment": series[step, 4],
                }  # fmt: skip
                if step == 0:
                    start = {**after, "root_flap_moment": np.full(3, mean[0])}
                    start |= {"tower_base_fore_aft_moment": mean[3], "tower_base_side_side_moment": mean[4]}
                    for term in terms:
                        term.reset(turbine, start)
                rate = sum(term(Transition(turbine, after, after, dt)) for term in terms)
                if 51 <= step < 111:
                    total[step - 51] = dt * rate
            both.append(total)
        # the filter of the blades turns with them: tilt and yaw pass it but for a few per cent
        np.testing.assert_allclose(rewards[:, k], both[0] - both[1], atol=0.05 * np.abs(rewards).max())
        assert np.corrcoef(rewards[:, k], both[0] - both[1])[0, 1] > 0.995


def test_an_action_is_paid_all_of_its_effects_at_once(model):
    given = np.zeros((LAGS + 20, RUNS, 3), np.float32)
    given[0] = 0.3
    reward = {"actuator_use": 0.0, "power": 0.0}
    paid, *_ = played(started(model, reward=reward), given)
    plain, *_ = played(started(model, reward=reward, reward_credit=False), given)
    # the offset comes back to zero in a second: what the first steps are paid is all that ever comes
    np.testing.assert_allclose(paid.sum(0), plain.sum(0), rtol=1e-9)
    late = slice(10, None)
    assert np.abs(paid[late]).max() < 1e-9 < np.abs(plain[late]).max()


def test_power_is_paid_up_to_the_rated_one(model):
    fatigue = {"blade_fatigue": 0.0, "tower_fore_aft_fatigue": 0.0, "tower_side_side_fatigue": 0.0}
    env = started(model, reward={"power": 2.0, "actuator_use": 0.0, **fatigue})
    rewards, effects, _, acted = played(env, actions(60))
    place, rated = RAW.index("power"), env.envs[0].turbine.drivetrain.rated_power
    before = model.raw[:, 51:111, place].T
    gained = np.minimum(before + effects[..., place], rated) - np.minimum(before, rated)
    curvature = np.interp(model.speeds, model.knots, model.curvature)
    expected = 2.0 * (gained / rated - curvature * (acted**2).sum(-1))
    np.testing.assert_allclose(rewards, env.envs[0].control_dt * expected, atol=1e-12)
    assert (gained > 0.0).any()
    assert (before > rated).any()


def test_the_gradient_is_that_of_small_actions(model):
    env = started(model, reward={"actuator_use": 0.0, "power": 0.0})
    gradient = env.gradient_rates()
    small = np.zeros((1, RUNS, 3), np.float32)
    small[..., 1] = 1e-3
    rewards, _, _, acted = played(env, small)
    moved = acted[0, :, 1] / env._spans[1] / 0.8  # the gradient has the share in which offsets act
    np.testing.assert_allclose(rewards[0], gradient[:, 50, 0, 1] * moved, rtol=0.02)


def test_a_forecast_without_actions_changes_nothing(model):
    class Nobody:
        def predict(self, observation, **_):
            return np.zeros((len(observation), 3), np.float32), None

    for found in forecast(vector(model), Nobody(), skip=10.0):
        assert found == pytest.approx(dict.fromkeys(found, 0.0), abs=1e-15)


def test_it_is_an_environment_with_the_spaces_of_the_task(model, monkeypatch):
    monkeypatch.setattr(linear_env, "cached_model", lambda *_: model)
    task, env = gym.make(TASK), gym.make("wt_gym/LoadReduction-Linear-v0")
    assert env.observation_space == task.observation_space
    assert env.action_space == task.action_space
    check_env(LinearTurbineEnv(modeled=TASK), skip_render_check=True)
    starts = set()
    for seed in range(20):
        env.reset(seed=seed)
        starts.add(env.unwrapped._models._time.item())
    assert len(starts) > 10
    first, _ = env.reset(seed=5)
    course = [env.step(np.full(3, 0.1, np.float32))[:2] for _ in range(10)]
    again, _ = env.reset(seed=5)
    np.testing.assert_array_equal(first, again)
    for seen, reward in course:
        now, paid, *_ = env.step(np.full(3, 0.1, np.float32))
        np.testing.assert_array_equal(now, seen)
        assert paid == reward


@pytest.mark.parametrize("mode", ["SameStep", "NextStep"])
def test_episodes_end_by_their_limit_and_begin_anew(model, mode):
    env = LinearVectorEnv(4, 20, mode, model=model, modeled=TASK)
    env.reset(seed=0)
    given = actions(45, 4)
    ends = []
    for k, action in enumerate(given):
        seen, rewards, terminated, truncated, infos = env.step(action)
        assert seen.shape == (4, N_OBS)
        assert not terminated.any()
        if truncated.any():
            ends.append(k)
            assert truncated.all()
            assert ("final_obs" in infos) is (mode == "SameStep")
        elif ends and ends[-1] == k - 1 and mode == "NextStep":
            assert not rewards.any()  # the step that resets
            np.testing.assert_array_equal(env._changes, 0.0)
    assert ends == ([19, 39] if mode == "SameStep" else [19, 40])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"observation": ["measurable"]}, "needs observation="),
        ({"residual_form": "rate"}, "needs action_mode='residual'"),
        ({"controller": "discon", "observation": ["offsets"], "reward_credit": False}, "with an observer"),
        ({"history": 2}, "history=1"),
        ({"sensor_noise": 1.0}, "sensor_noise=0"),
        ({"vector_reward": True}, "one number as reward"),
        ({"reward": {"tip_deflection": 1.0}}, "alone, got those of tip_deflection"),
    ],
)
def test_what_has_no_linear_model_is_refused(model, changes, message):
    with pytest.raises(ValueError, match=message):
        vector(model, **changes)


def test_actions_and_resets_are_checked(model):
    env = vector(model)
    with pytest.raises(gym.error.ResetNeeded):
        env.step_each(np.zeros((RUNS, 3)))
    env.reset(seed=0)
    with pytest.raises(wt_gym.base.errors.ActionError, match="within"):
        env.step_each(np.full((RUNS, 3), 2.0))
    with pytest.raises(ValueError, match=f"{RUNS} actions are needed"):
        env.step_each(np.zeros((RUNS + 1, 3)))
    with pytest.raises(ValueError, match="max_episode_steps must be at most 474"):
        LinearVectorEnv(1, 475, model=model, modeled=TASK)
    with pytest.raises(ValueError, match="no options"):
        env.reset(options={"wind_speed": 12.0})
    with pytest.raises(ValueError, match="for each of 3 runs"):
        forecast(vector(model, 2), None)


def test_the_loads_of_the_model_are_those_of_the_reward(model):
    assert RAW[: len(LOADS)] == LOADS


def test_a_training_begins_on_the_linear_model_with_larger_steps_than_in_the_simulator(model, tmp_path, monkeypatch):
    monkeypatch.setattr(linear_env, "cached_model", lambda *_: model)
    rates = []
    learn = ArrayPPO.learn

    def watched(self, steps, *arguments, **named):
        rates.append((self.n_envs, self.lr_schedule(1.0), steps))
        return learn(self, 0 if self.n_envs == 1 else steps, *arguments, **named)

    monkeypatch.setattr(ArrayPPO, "learn", watched)
    config = TrainingConfig(
        env_id=TASK, linear_steps=256, total_steps=2, n_envs=1, eval_every=0, tensorboard=False,
        hyperparameters={"learning_rate": "lin_6e-3", "rollout_steps": 128, "batch_size": 32, "n_epochs": 1,
                         "normalize_observations": True},
    )  # fmt: skip
    record = train(config, tmp_path / "run", progress=False)
    assert rates == [(64, pytest.approx(6e-3), 256), (1, pytest.approx(1e-3), 2)]
    assert record["linear"]["steps"] == 256
    assert set(TRAINING_WIND_SEEDS) <= set(record["wind_seeds"])
    agent = TrainedAgent.load(tmp_path / "run" / "model.zip", "PPO", trust=True)
    assert float(agent.model.policy.action_net.bias.detach().abs().max()) > 0.0  # a fresh one has none
    with (tmp_path / "run" / "vecnormalize.pkl").open("rb") as file:
        statistics = pickle.load(file)
    assert statistics.obs_rms.count > 64.0  # those of the linear model, from which the policy comes
    assert statistics.ret_rms.count > 64.0


@pytest.mark.parametrize(
    ("env", "message"),
    [
        (TASKS["Gusts"].id, "a linear model needs"),
        ("wt_gym/LoadReduction-Linear-v0", "needs an environment of the simulator"),
    ],
)
def test_an_environment_without_a_linear_model_is_refused_before_files_are_removed(env, message, tmp_path):
    (tmp_path / "training.json").write_text("{}")
    config = TrainingConfig(env_id=env, linear_steps=256, total_steps=2, n_envs=1, eval_every=0, tensorboard=False)
    with pytest.raises(ValueError, match=message):
        train(config, tmp_path, progress=False, overwrite=True)
    assert (tmp_path / "training.json").read_text() == "{}"


def test_steps_on_a_linear_model_go_with_nothing_that_it_does_not_have():
    with pytest.raises(ValueError, match=r"linear_steps must be left out except with PPO.* got 1 with SAC"):
        TrainingConfig(linear_steps=1, algorithm="SAC")
