"""Environments to train on, in one process or several, and budgets of costs around them.

Budgets are mean costs that a policy must not exceed, held by Lagrangian multipliers. With the cost c_i of a step over
what its budget allows and a multiplier u_i, PPO learns from the reward

    (r - sum u_i c_i) / (1 + sum u_i),

so that rewards keep their size (Stooke, Achiam, Abbeel, ICML 2020, arXiv:2007.03964). After each rollout the multiplier
moves by its mean cost J_i: u_i <- max(0, u_i + rate (J_i - 1) / (J_i + 1)), a bounded step that is zero where the
budget is just used up. One value function learns the sum, as in reward-constrained policy optimization (Tessler et
al., ICLR 2019, arXiv:1805.11074): the multipliers change more slowly than it learns.
"""

from __future__ import annotations

import math
import multiprocessing
import signal
from functools import partial
from typing import TYPE_CHECKING, Any, cast

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecEnv, VecEnvWrapper, VecMonitor, VecNormalize

from wt_gym.envs.terminations import PITCH_TRAVEL
from wt_gym.envs.vector_env import WindTurbineVectorEnv
from wt_gym.experiment.environments import compile_kernels

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

    from wt_gym.learning.options import TrainingConfig

__all__ = [
    "ALLOWED_SHARE", "MULTIPLIER_RATE", "START_METHOD", "BudgetUpdates", "BudgetedVecEnv", "TurbineVecEnv",
    "allowed_costs", "make_training_env", "monitored", "normalized",
]  # fmt: skip


class TurbineVecEnv(DummyVecEnv):
    """`wt_gym.envs.vector_env.WindTurbineVectorEnv` behind the interface of stable-baselines3.

    Threads step the turbines. Infos are those of the single environments, with ``terminal_observation`` and
    ``TimeLimit.truncated`` as stable-baselines3 requires them; no wrapper stands around a single environment.

    Parameters
    ----------
    env_id : str
        Of this package.
    **kwargs
        Arguments of the environment, and ``threads``.

    Raises
    ------
    ValueError
        If the id is not an environment of this package.
    """

    def __init__(self, env_id: str, num_envs: int, **kwargs: Any):
        made = gym.make_vec(env_id, num_envs, "vector_entry_point", autoreset_mode=AutoresetMode.SAME_STEP, **kwargs)
        self.turbines = cast(WindTurbineVectorEnv, made)
        one_each = self.turbines.envs if len(self.turbines.envs) == num_envs else num_envs * self.turbines.envs
        self.envs = list(one_each)  # linear models have one environment for all
        VecEnv.__init__(self, num_envs, made.single_observation_space, made.single_action_space)

    def reset(self) -> np.ndarray:
        """Start episodes with the seeds and options that were set for it."""
        options = self._options[0] or None
        if any(other != self._options[0] for other in self._options):
            raise ValueError("options of a reset hold for all turbines")
        results = self.turbines.reset_each(self._seeds, options, range(self.num_envs))
        self._reset_seeds()
        self._reset_options()
        self.reset_infos = [info for _, info in results]
        return np.stack([observation for observation, _ in results])

    def step_wait(self) -> VecEnvStepReturn:
        """Advance every turbine by a control step; where an episode ends the next begins."""
        outcomes = self.turbines.step_each(self.actions)
        infos = []
        for k, outcome in enumerate(outcomes):
            info = outcome.info
            if outcome.final is not None:
                self.reset_infos[k], (last, info) = outcome.info, outcome.final
                info["terminal_observation"] = last
            info["TimeLimit.truncated"] = outcome.truncated and not outcome.terminated
            infos.append(info)
        observations, rewards, terminated, truncated, *_ = zip(*outcomes, strict=True)
        dones = np.array(terminated) | np.array(truncated)
        return np.stack(observations), np.array(rewards), dones, infos

    def close(self) -> None:
        """Release simulators and threads."""
        self.turbines.close()


ALLOWED_SHARE = 1e-3
"""Share of the steps beyond a limit that a budget allows; the pitch travel may use up its limit."""
MULTIPLIER_RATE = 0.05
"""Largest change of a multiplier after a rollout."""


def allowed_costs(budgets: Mapping[str, float]) -> dict[str, float]:
    """Mean cost of a step that each budget, a limit of ``cost_limits`` of the environment, allows."""
    return {name: 1.0 if name == PITCH_TRAVEL else ALLOWED_SHARE for name in budgets}


class BudgetedVecEnv(VecEnvWrapper):
    """Takes costs times multipliers off the rewards, and moves the multipliers.

    Parameters
    ----------
    venv : VecEnv
        Its infos have ``costs``.
    allowed : mapping
        Mean cost of a step that is allowed, by name; positive.
    rate : float
        Largest change of a multiplier in an update.

    Attributes
    ----------
    spent : dict of str to float
        Mean costs over the allowed ones, in the last rollout.
    """

    def __init__(self, venv: VecEnv, allowed: Mapping[str, float], rate: float = MULTIPLIER_RATE):
        super().__init__(venv)
        self._allowed, self._rate = dict(allowed), rate
        self.multipliers = dict.fromkeys(self._allowed, 0.0)
        self.spent = dict.fromkeys(self._allowed, 0.0)
        self._sums, self._count = np.zeros(len(self._allowed)), 0

    def reset(self) -> VecEnvObs:
        """Start episodes."""
        return self.venv.reset()

    def step_wait(self) -> VecEnvStepReturn:
        """As of the environments, with rewards less the costs."""
        observations, rewards, dones, infos = self.venv.step_wait()
        costs = np.array([[info["costs"][name] / most for name, most in self._allowed.items()] for info in infos])
        self._sums += costs.sum(axis=0)
        self._count += len(infos)
        prices = np.array(list(self.multipliers.values()))
        return observations, (rewards - costs @ prices) / (1.0 + prices.sum()), dones, infos

    def update(self) -> None:
        """Move the multipliers by the costs since the last update."""
        if not self._count:
            return
        for name, mean in zip(self._allowed, (self._sums / self._count).tolist(), strict=True):
            self.spent[name] = mean
            step = self._rate * (mean - 1.0) / (mean + 1.0)
            self.multipliers[name] = max(0.0, self.multipliers[name] + step)
        self._sums, self._count = np.zeros(len(self._allowed)), 0


class BudgetUpdates(BaseCallback):
    """Moves the multipliers after each rollout and stores their schedule.

    Parameters
    ----------
    before : mapping, optional
        Record of an earlier session, which is continued; a `ValueError` where it is damaged.
    """

    def __init__(self, venv: BudgetedVecEnv, before: Mapping[str, Any] | None = None):
        super().__init__()
        self._venv, names = venv, list(venv.multipliers)
        kinds = ("multiplier", "spent")
        self.curve: dict[str, list[Any]] = {"steps": []} | {f"{name}_{kind}": [] for name in names for kind in kinds}
        if before is None:
            return
        kept, curve = before.get("multipliers"), before.get("curve")
        if not (
            isinstance(kept, dict)
            and set(kept) == set(names)
            and all(isinstance(value, int | float) and 0.0 <= value < math.inf for value in kept.values())
            and isinstance(curve, dict)
            and set(curve) == set(self.curve)
        ):
            raise ValueError(f"the record is damaged: its budgets must have multipliers of {', '.join(names)}")
        venv.multipliers = {name: float(kept[name]) for name in names}
        self.curve = {name: list(values) for name, values in curve.items()}

    def record(self, budgets: Mapping[str, float]) -> dict[str, Any]:
        """Content of a training's record, JSON values."""
        return {
            "limits": dict(budgets),
            "allowed": allowed_costs(budgets),
            "multipliers": dict(self._venv.multipliers),
            "spent": dict(self._venv.spent),
            "curve": self.curve,
        }

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        self._venv.update()
        self.curve["steps"].append(int(self.num_timesteps))
        for kind, values in (("multiplier", self._venv.multipliers), ("spent", self._venv.spent)):
            for name, value in values.items():
                self.curve[f"{name}_{kind}"].append(value)
                self.logger.record(f"budget/{name}_{kind}", value)


START_METHOD = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
"""How processes that step environments begin: the former where there is one (not on Windows), because it is faster.

A fork would copy the threads of numba and torch in a broken state, once the kernels have been compiled or read from the
cache.
"""


def make_training_env(config: TrainingConfig) -> VecNormalize:
    """Copies of the environment with statistics of rewards.

    Several copies of an environment of this package are stepped by threads of this process, others in processes of
    their own.

    Raises
    ------
    ValueError
        If the environment cannot be made with these arguments.
    """
    first = _make(gym.make, config)
    if config.n_envs == 1:
        venv: VecEnv = DummyVecEnv([lambda: Monitor(first)])
    elif str(first.spec.vector_entry_point).startswith("wt_gym.") and not first.spec.additional_wrappers:
        first.close()
        venv = VecMonitor(_make(partial(TurbineVecEnv, num_envs=config.n_envs), config))
    else:
        compile_kernels(first)
        venv = SubprocVecEnv([monitored(config.env_id, config.env_kwargs)] * config.n_envs, start_method=START_METHOD)
    return normalized(BudgetedVecEnv(venv, allowed_costs(config.budgets)) if config.budgets else venv, config)


def normalized(venv: VecEnv, config: TrainingConfig) -> VecNormalize:
    """Statistics of rewards, and of observations where the configuration wants them, around environments."""
    hyperparameters = config.resolved
    return VecNormalize(
        venv,
        norm_obs=hyperparameters["normalize_observations"],
        norm_reward=hyperparameters["normalize_rewards"],
        gamma=hyperparameters["gamma"],
    )


def _make(make: Callable[..., Any], config: TrainingConfig) -> Any:
    """Make environments of an id with its arguments."""
    try:
        return make(config.env_id, **config.env_kwargs)
    except (TypeError, AttributeError) as error:  # an argument of another type, as from JSON
        raise ValueError(f"{config.env_id} cannot be made with the arguments {config.env_kwargs}: {error}") from error


def monitored(env_id: str, kwargs: dict[str, Any]) -> Callable[[], gym.Env]:
    """Give a function that makes a monitored environment in a process of its own."""

    def make() -> gym.Env:
        import wt_gym  # noqa: F401 - registers the environments in a fresh process

        # Ctrl-C reaches every process of the terminal; the training process alone decides when the others end.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        return Monitor(gym.make(env_id, **kwargs))

    return make
