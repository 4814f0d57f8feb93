"""Budgets of a training: mean costs that a policy must not exceed, held by Lagrangian multipliers.

With the cost c_i of a step over what its budget allows and a multiplier u_i, PPO learns from the reward

    (r - sum u_i c_i) / (1 + sum u_i),

so that rewards keep their size (Stooke, Achiam, Abbeel, ICML 2020, arXiv:2007.03964). After each rollout the multiplier
moves by its mean cost J_i: u_i <- max(0, u_i + rate (J_i - 1) / (J_i + 1)), a bounded step that is zero where the
budget is just used up. One value function learns the sum, as in reward-constrained policy optimization (Tessler et
al., ICLR 2019, arXiv:1805.11074): the multipliers change more slowly than it learns.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnvWrapper

from wt_gym.envs.terminations import PITCH_TRAVEL

if TYPE_CHECKING:
    from collections.abc import Mapping

    from stable_baselines3.common.vec_env import VecEnv
    from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

__all__ = ["ALLOWED_SHARE", "MULTIPLIER_RATE", "BudgetUpdates", "BudgetedVecEnv", "allowed_costs", "budgeted_of"]

ALLOWED_SHARE = 1e-3
"""Share of the steps beyond a limit that a budget allows; the pitch travel may use up its limit."""
MULTIPLIER_RATE = 0.05
"""Largest change of a multiplier after a rollout."""


def allowed_costs(budgets: Mapping[str, float]) -> dict[str, float]:
    """Mean cost of a step that each budget allows.

    Parameters
    ----------
    budgets : mapping
        Limits by name, as ``cost_limits`` of the environment.
    """
    return {name: 1.0 if name == PITCH_TRAVEL else ALLOWED_SHARE for name in budgets}


class BudgetedVecEnv(VecEnvWrapper):
    """Takes costs times multipliers off the rewards, and moves the multipliers.

    Parameters
    ----------
    venv : VecEnv
        Whose infos have ``costs``.
    allowed : mapping
        Mean cost of a step that is allowed, by name; positive.
    rate : float
        Largest change of a multiplier in an update.

    Attributes
    ----------
    multipliers : dict of str to float
        By name.
    spent : dict of str to float
        Mean costs over what is allowed, in the last rollout.
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
    """Moves the multipliers after each rollout and keeps their course.

    Parameters
    ----------
    venv : BudgetedVecEnv
    before : mapping, optional
        Record of an earlier session, which is continued.

    Attributes
    ----------
    curve : dict of list
        ``steps``, and multiplier and spent share of each budget.

    Raises
    ------
    ValueError
        If the record is damaged.
    """

    def __init__(self, venv: BudgetedVecEnv, before: Mapping[str, Any] | None = None):
        super().__init__()
        self._venv = venv
        names = list(venv.multipliers)
        self.curve: dict[str, list[Any]] = {"steps": []} | {key: [] for name in names for key in _keys(name)}
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
        """What a record keeps, as JSON values."""
        venv = self._venv
        return {
            "limits": dict(budgets), "allowed": allowed_costs(budgets), "multipliers": dict(venv.multipliers),
            "spent": dict(venv.spent), "curve": self.curve,
        }  # fmt: skip

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        self._venv.update()
        self.curve["steps"].append(int(self.num_timesteps))
        for name, multiplier in self._venv.multipliers.items():
            for key, value in zip(_keys(name), (multiplier, self._venv.spent[name]), strict=True):
                self.curve[key].append(value)
                self.logger.record(f"budget/{key}", value)


def _keys(name: str) -> tuple[str, str]:
    return f"{name}_multiplier", f"{name}_spent"


def budgeted_of(venv: VecEnv) -> BudgetedVecEnv | None:
    """The budgeted environments within wrappers, None where there are none."""
    inner: Any = venv
    while isinstance(inner, VecEnvWrapper):
        if isinstance(inner, BudgetedVecEnv):
            return inner
        inner = inner.venv
    return None
