"""Models of stable-baselines3 from hyperparameters, fresh or as a run folder holds them, and a faster PPO."""

from __future__ import annotations

import math
import pickle
from collections import defaultdict
from functools import partial
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.utils import LinearSchedule, explained_variance

from wt_gym.base.files import write_whole
from wt_gym.base.processes import one_blas_thread
from wt_gym.experiment.policy_arrays import FlatVector, PolicyArrays
from wt_gym.experiment.trained_agent import ALGORITHM_CLASSES, DAMAGE, TrainedAgent
from wt_gym.learning.hyperparameters import of_each_copy

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from typing import BinaryIO, Self

    from stable_baselines3.common.buffers import RolloutBuffer
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.type_aliases import RolloutBufferSamples
    from stable_baselines3.common.vec_env import VecEnv, VecNormalize

    from wt_gym.experiment.run_folder import RunFolder
    from wt_gym.learning.options import TrainingConfig


class ArrayPPO(PPO):
    """`stable_baselines3.PPO`: the same algorithm, random numbers, figures and model files, in less time.

    Rollouts and updates of small networks take a fraction of the time with NumPy (`PolicyArrays`); the results are
    those of torch except for rounding. Networks that `PolicyArrays` does not represent, exploration that depends on the
    state, optimizers other than plain Adam and a clipped value function are left to torch.
    """

    def learn(self, *arguments: Any, **named: Any) -> Self:
        """As of `stable_baselines3.PPO`, with one thread of NumPy's linear algebra, because the matrices are small."""
        with one_blas_thread():
            return super().learn(*arguments, **named)

    def collect_rollouts(
        self, env: VecEnv, callback: BaseCallback, rollout_buffer: RolloutBuffer, n_rollout_steps: int
    ) -> bool:
        """Fill the buffer; False where a callback ends the training."""
        if self.use_sde or not PolicyArrays.represents(self.policy):
            return super().collect_rollouts(env, callback, rollout_buffer, n_rollout_steps)
        self.policy.set_training_mode(False)
        arrays, buffer = PolicyArrays(self.policy), rollout_buffer
        low, high = (getattr(self.action_space, name) for name in ("low", "high"))
        buffer.reset()
        callback.on_rollout_start()
        for n_steps in range(n_rollout_steps):
            observations = cast(np.ndarray, self._last_obs)
            actions, values, log_probs = arrays.sample(observations)
            clipped_actions = np.clip(actions, low, high)
            new_obs, rewards, dones, infos = env.step(clipped_actions)
            self.num_timesteps += env.num_envs
            callback.update_locals(locals())
            if not callback.on_step():
                return False
            self._update_info_buffer(infos, dones)
            for k in np.flatnonzero(dones):
                if infos[k].get("TimeLimit.truncated"):  # the episode would have continued
                    rewards[k] += self.gamma * arrays.values(infos[k]["terminal_observation"][None])[0]
            buffer.observations[n_steps], buffer.actions[n_steps] = observations, actions
            buffer.rewards[n_steps], buffer.values[n_steps] = rewards, values
            buffer.log_probs[n_steps], buffer.episode_starts[n_steps] = log_probs, self._last_episode_starts
            self._last_obs, self._last_episode_starts = cast(np.ndarray, new_obs), dones
        buffer.pos, buffer.full = n_rollout_steps, n_rollout_steps == buffer.buffer_size
        last_values = arrays.values(cast(np.ndarray, self._last_obs))
        buffer.compute_returns_and_advantage(torch.from_numpy(last_values), cast(np.ndarray, self._last_episode_starts))
        callback.update_locals(locals())
        callback.on_rollout_end()
        return True

    def train(self) -> None:
        """Update policy and value function from the buffer."""
        if self.use_sde or self.clip_range_vf is not None or not (_represents(self.policy, self.policy.optimizer)):
            super().train()
            return
        self._update_learning_rate(self.policy.optimizer)
        update = _Update(self, self.clip_range(self._current_progress_remaining))  # type: ignore[operator]
        for _ in range(self.n_epochs):
            update.figures["approx_kl"].clear()  # what is shown is that of the last epoch
            going_on = all(update.take(batch) for batch in self.rollout_buffer.get(self.batch_size))
            self._n_updates += 1
            if not going_on:
                break
        update.finish()
        buffer = self.rollout_buffer
        figures = {name: np.mean(values) for name, values in update.figures.items()} | {
            "loss": update.loss,
            "explained_variance": explained_variance(buffer.values.flatten(), buffer.returns.flatten()),
            "std": float(torch.exp(self.policy.log_std.detach()).mean()),
            "clip_range": update.clip,
        }
        for name, value in figures.items():
            self.logger.record(f"train/{name}", value)
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")


def _represents(policy: Any, optimizer: torch.optim.Optimizer) -> bool:
    """Whether `_Update` does what torch would do."""
    if type(optimizer) is not torch.optim.Adam or len(optimizer.param_groups) != 1:
        return False
    (group,) = optimizer.param_groups
    plain = not (group["amsgrad"] or group["maximize"] or group["weight_decay"])
    return plain and PolicyArrays.represents(policy)


class _Update:
    """Steps of Adam on the loss of PPO, with figures of every minibatch and the loss of the last one.

    ``clip`` is the range of the ratio of probabilities about 1.
    """

    def __init__(self, model: ArrayPPO, clip: float):
        self._model, self.clip, self.loss = model, clip, math.nan
        self._optimizer = model.policy.optimizer
        self.figures: dict[str, list[float]] = defaultdict(list)
        policy = model.policy
        self._parameters, self._gradient, self._mean, self._square = (FlatVector(policy) for _ in range(4))
        self._arrays = PolicyArrays(policy, self._parameters, self._gradient)
        state = self._optimizer.state
        for p in policy.parameters():
            if not state[p]:  # as Adam begins
                means = {name: torch.zeros_like(p) for name in ("exp_avg", "exp_avg_sq")}
                state[p] |= {"step": torch.tensor(0.0), **means}
        self._parameters.read(lambda p: p)
        self._mean.read(lambda p: state[p]["exp_avg"])
        self._square.read(lambda p: state[p]["exp_avg_sq"])
        self._steps = float(state[policy.log_std]["step"])

    def take(self, batch: RolloutBufferSamples) -> bool:
        """Take a step by a minibatch; False, and no step, where the policy has changed by more than the limit."""
        model, low, high = self._model, 1.0 - self.clip, 1.0 + self.clip
        observations, actions, _, old, advantages, returns = (tensor.numpy() for tensor in batch[:6])
        if model.normalize_advantage and advantages.size > 1:
            advantages = (advantages - advantages.mean()) / (advantages.std(ddof=1) + np.float32(1e-8))
        n = np.float32(advantages.size)
        values, log_probs = self._arrays.evaluate(observations, actions)
        log_ratio, error = log_probs - old, values - returns
        ratio = np.exp(log_ratio)
        policy_loss = -float(np.minimum(advantages * ratio, advantages * np.clip(ratio, low, high)).mean())
        value_loss, entropy_loss = float(np.square(error).mean()), -self._arrays.entropy()
        self.loss = policy_loss + model.ent_coef * entropy_loss + model.vf_coef * value_loss
        divergence = float(((ratio - 1.0) - log_ratio).mean())  # http://joschu.net/blog/kl-approx.html
        for name, value in (
            ("entropy_loss", entropy_loss),
            ("policy_gradient_loss", policy_loss),
            ("value_loss", value_loss),
            ("approx_kl", divergence),
            ("clip_fraction", float((np.abs(ratio - 1.0) > self.clip).mean())),
        ):
            self.figures[name].append(value)
        if model.target_kl is not None and divergence > 1.5 * model.target_kl:
            return False
        clipped = np.where(advantages > 0.0, ratio > high, ratio < low)
        by_log_probs = np.where(clipped, np.float32(0.0), -advantages * ratio / n)
        self._arrays.backward(np.float32(2.0 * model.vf_coef) * error / n, by_log_probs)
        self._gradient[model.policy.log_std][...] -= model.ent_coef
        self._step()
        return True

    def _step(self) -> None:
        """Take a step of Adam along the gradient, which is shortened to the greatest norm first."""
        (group,) = self._optimizer.param_groups
        first, second = group["betas"]
        gradient, mean, square = self._gradient.values, self._mean.values, self._square.values
        gradient *= min(1.0, self._model.max_grad_norm / (float(np.linalg.norm(gradient)) + 1e-6))
        self._steps += 1.0
        mean += (1.0 - first) * (gradient - mean)
        square *= second
        square += (1.0 - second) * np.square(gradient)
        scale = np.sqrt(square) / math.sqrt(1.0 - second**self._steps) + group["eps"]
        self._parameters.values -= group["lr"] / (1.0 - first**self._steps) * mean / scale

    def finish(self) -> None:
        """Give parameters and optimizer what has become of them."""
        state = self._optimizer.state
        self._parameters.write(lambda p: p)
        self._mean.write(lambda p: state[p]["exp_avg"])
        self._square.write(lambda p: state[p]["exp_avg_sq"])
        for p in self._model.policy.parameters():
            state[p]["step"].fill_(self._steps)


_OF_THE_POLICY = ("net_arch", "log_std_init", "activation_fn", "n_quantiles", "n_critics")
_FINE = 1.0 / 6.0
"""Learning rate of a policy that is good already, over that of a fresh one."""
_OF_THE_ENVIRONMENT = ("normalize_observations", "normalize_rewards")
_LEARNING_CLASSES: dict[str, type[BaseAlgorithm]] = {**ALGORITHM_CLASSES, "PPO": ArrayPPO}
_ACTIVATIONS = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU, "elu": torch.nn.ELU}


def make_model(config: TrainingConfig, venv: VecNormalize) -> BaseAlgorithm:
    """Fresh model of a configuration; a ValueError where the hyperparameters do not go together."""
    chosen = of_each_copy(config.resolved, venv.num_envs)
    if config.linear_steps and (rate := chosen.get("learning_rate")) is not None:
        falls, number = str(rate).startswith("lin_"), _FINE * float(str(rate).removeprefix("lin_"))
        chosen["learning_rate"] = f"lin_{number}" if falls else number
    values = {name: _value(entry) for name, entry in chosen.items() if name not in _OF_THE_ENVIRONMENT}
    policy = {name: values.pop(name) for name in _OF_THE_POLICY if name in values}
    if values.pop("linear_policy", False):
        policy["net_arch"] = {"pi": [], "vf" if config.algorithm == "PPO" else "qf": policy.get("net_arch", [64, 64])}
    try:
        return _LEARNING_CLASSES[config.algorithm](
            "MlpPolicy", venv, policy_kwargs=policy, seed=config.seed, device="cpu", **values
        )
    except AssertionError as error:  # stable-baselines3's own checks of one value against another
        raise ValueError(f"the hyperparameters do not go together: {error}") from error


def _value(entry: Any) -> Any:
    """What stable-baselines3 takes for an entry."""
    if isinstance(entry, str) and entry.startswith("lin_"):
        return LinearSchedule(float(entry.removeprefix("lin_")), 0.0, 1.0)
    if isinstance(entry, str):
        return _ACTIVATIONS.get(entry, entry)
    return list(entry) if isinstance(entry, tuple) else entry


def save_model(model: BaseAlgorithm, model_file: Path, normalization_file: Path) -> None:
    """Write a model and the statistics of its environment."""
    write_whole(normalization_file, partial(pickle.dump, model.get_vec_normalize_env()))
    write_whole(model_file, cast("Callable[[BinaryIO], None]", model.save))


def save_replay_buffer(model: BaseAlgorithm, path: Path) -> None:
    """Write the replay buffer of a model that has one."""
    if isinstance(model, OffPolicyAlgorithm):
        write_whole(path, cast("Callable[[BinaryIO], None]", model.save_replay_buffer))


def load_model(config: TrainingConfig, venv: VecNormalize, folder: RunFolder) -> BaseAlgorithm:
    """Model as a training left it, with statistics, optimizer and replay buffer, to resume it.

    The environments get the statistics, and seeds by training seed and steps, so that they do not repeat their first
    episodes. Errors: a `FileNotFoundError` for a missing file, a `ValueError` for a damaged one or one that does not
    fit the environment.
    """
    # of its own training
    agent = TrainedAgent.load(folder.model, config.algorithm, trust=True, classes=_LEARNING_CLASSES)
    if agent.normalization is None:
        raise FileNotFoundError(f"{folder.normalization} is missing: resuming a training requires its statistics")
    # there are statistics of observations only where these are normalized
    vars(venv).update({name: rms for name, rms in vars(agent.normalization).items() if name in ("obs_rms", "ret_rms")})
    model = agent.model
    try:
        model.set_env(venv)
    except (AssertionError, ValueError) as error:
        raise ValueError(f"the model in {folder.path} does not fit the environment: {error}") from error
    if isinstance(model, OffPolicyAlgorithm):
        if not folder.buffer.is_file():
            raise FileNotFoundError(f"{folder.buffer} is missing: resuming a training requires its replay buffer")
        try:
            with folder.buffer.open("rb") as file:
                model.replay_buffer = buffer = pickle.load(file)
        except DAMAGE as error:
            raise ValueError(
                f"the replay buffer {folder.buffer} is damaged: {type(error).__name__}: {error}"
            ) from error
        if not isinstance(buffer, ReplayBuffer) or buffer.n_envs != venv.num_envs:
            raise ValueError(
                f"{folder.buffer} must hold a replay buffer for {venv.num_envs} environments, got "
                f"{getattr(buffer, 'n_envs', buffer)!r:.80}"
            )
    model.set_random_seed(int(np.random.SeedSequence((config.seed, model.num_timesteps)).generate_state(1)[0] >> 1))
    return model
