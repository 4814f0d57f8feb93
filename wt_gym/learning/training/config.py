"""What to train on, for how long, and how."""

from __future__ import annotations

import importlib.util
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

from wt_gym.base.files import json_values
from wt_gym.envs.options import with_whole_paths
from wt_gym.learning.pretraining.options import PretrainingOptions, pretraining_environment
from wt_gym.learning.training.hyperparameters import check_hyperparameters, hyperparameters_for
from wt_gym.tasks import DEFAULT_ENV

__all__ = ["TrainingConfig"]

# Beyond these, memory or processes end before the training does.
_MOST_STEPS, _MOST_ENVS, _MOST_SECONDS, _SEEDS = 10**12, 256, 1e9, 2**31


@dataclass(frozen=True)
class TrainingConfig:
    """What to train on, for how long, and how.

    Attributes
    ----------
    algorithm : str
        ``"PPO"``, ``"SAC"`` or ``"TQC"``.
    env_id : str
    env_kwargs : dict
        Arguments of the environment; files of wind get whole paths.
    hyperparameters : dict
        Of the algorithm; those left out come from ``agents/hyperparameters``.
    total_steps : int
        Environment steps over all copies; the last rollout of PPO is finished beyond them.
    max_seconds : float or None
        Wall time after which training stops, whatever the steps; counted from zero when it is resumed.
    n_envs : int
        Copies of the environment: threads step several of this package, processes those of others. They share
        ``rollout_steps`` and ``update_every`` of the hyperparameters.
    seed : int
    checkpoint_steps : int
        Steps between checkpoints.
    checkpoint_minutes : float
        Wall time between checkpoints, whatever the steps; 0 for none.
    eval_every : int
        Steps between evaluations against the baseline controller in other winds; 0 for none.
    eval_winds : int
        Number of these winds.
    eval_seconds : float
        Length of each [s].
    pretraining : dict or None
        Options of `wt_gym.learning.pretraining.options.PretrainingOptions`, those left out by default; None for no
        pretraining. With it, what ``env_kwargs`` leaves out is that of
        `wt_gym.learning.pretraining.options.pretraining_environment`.
    budgets : dict or None
        Limits of costs that the policy is to keep, as ``cost_limits`` of the environment, which they become: see
        `wt_gym.learning.training.budgets`.
    tensorboard : bool or None
        Write figures for TensorBoard; None: if it is installed.

    Raises
    ------
    ValueError
        If a value has no meaning; the message names it and what is allowed.
    """

    algorithm: str = "PPO"
    env_id: str = DEFAULT_ENV
    env_kwargs: dict[str, Any] = field(default_factory=dict)
    hyperparameters: dict[str, Any] = field(default_factory=dict)
    total_steps: int = 200_000
    max_seconds: float | None = None
    n_envs: int = 8
    seed: int = 0
    checkpoint_steps: int = 50_000
    checkpoint_minutes: float = 10.0
    eval_every: int = 20_000
    eval_winds: int = 2
    eval_seconds: float = 60.0
    pretraining: dict[str, Any] | None = None
    budgets: dict[str, float] | None = None
    tensorboard: bool | None = None

    def __post_init__(self) -> None:
        self._check_whole("total_steps", 1 if self.pretraining is None else 0, _MOST_STEPS)
        self._check_whole("n_envs", 1, _MOST_ENVS)
        self._check_whole("seed", 0, _SEEDS)
        self._check_whole("checkpoint_steps", 1, _MOST_STEPS)
        self._check_whole("eval_every", 0, _MOST_STEPS)
        self._check_whole("eval_winds", 1, 8)
        self._check_number("checkpoint_minutes", 0.0, _MOST_SECONDS)
        self._check_number("eval_seconds", 15.0, 3600.0)
        if self.max_seconds is not None:
            self._check_number("max_seconds", 0.0, _MOST_SECONDS)
        if self.tensorboard not in (True, False, None):
            raise ValueError(f"tensorboard must be true, false or null, got {self.tensorboard!r}")
        if self.tensorboard and importlib.util.find_spec("tensorboard") is None:
            raise ValueError("tensorboard is not installed; it comes with the extra 'train'")
        if not isinstance(self.env_kwargs, dict):
            raise ValueError(f"env_kwargs must map names to values, got {self.env_kwargs!r}")
        if self.budgets is not None:
            object.__setattr__(self, "env_kwargs", self._with_limits(self.budgets))
        if self.pretraining is not None:
            object.__setattr__(self, "env_kwargs", pretraining_environment(self.env_id, self.env_kwargs))
        object.__setattr__(self, "env_kwargs", with_whole_paths(self.env_kwargs))
        if self.pretraining is not None:
            options = PretrainingOptions.of(self.pretraining)
            if self.algorithm != "PPO":
                raise ValueError(f"pretraining needs the algorithm PPO, got {self.algorithm!r}")
            object.__setattr__(self, "pretraining", asdict(options))
        if self.env_kwargs.get("vector_reward"):
            raise ValueError("the reward of a training must be one number, got its terms: leave out vector_reward")
        object.__setattr__(self, "hyperparameters", check_hyperparameters(self.algorithm, self.hyperparameters))
        if self.pretraining is not None and self.resolved["normalize_observations"]:
            raise ValueError("pretraining needs normalize_observations: false")

    def _with_limits(self, budgets: Any) -> dict[str, Any]:
        """Arguments of the environment with the limits of the budgets."""
        if self.algorithm != "PPO":
            raise ValueError(f"budgets need the algorithm PPO, got {self.algorithm!r}")
        if not isinstance(budgets, dict) or not budgets:
            raise ValueError(f"budgets must map names of costs to limits, got {budgets!r}")
        if self.env_kwargs.get("cost_limits", budgets) != budgets:
            raise ValueError(
                f"cost_limits must be the budgets or left out, got {self.env_kwargs['cost_limits']!r} and {budgets!r}"
            )
        return {**self.env_kwargs, "cost_limits": dict(budgets)}

    @property
    def resolved(self) -> dict[str, Any]:
        """Hyperparameters with those that the package brings along."""
        return hyperparameters_for(self.algorithm, self.env_id, overrides=self.hyperparameters)

    def with_hyperparameters(self) -> TrainingConfig:
        """Give the configuration with every hyperparameter written out, as a record keeps it."""
        return replace(self, hyperparameters=self.resolved)

    def to_json(self) -> dict[str, Any]:
        """Fields by name."""
        return asdict(self)

    @classmethod
    def from_json(cls, values: Any) -> TrainingConfig:
        """Read what `to_json` gave.

        Raises
        ------
        ValueError
            If it is something else.
        """
        names = {f.name for f in fields(cls)}
        if not isinstance(values, dict) or not set(values) <= names:
            raise ValueError(
                f"a training configuration must have the fields {', '.join(sorted(names))}, got {values!r:.200}"
            )
        return cls(**values)

    def continues(self, record: Any) -> bool:
        """Whether this is the training of a record's configuration, except for seed and limits.

        Parameters
        ----------
        record : Any
            What `to_json` gave; anything else is another training.
        """
        free = dict.fromkeys(("seed", "total_steps", "max_seconds"))
        try:
            configs = (self.with_hyperparameters(), TrainingConfig.from_json(record).with_hyperparameters())
        except (TypeError, ValueError):
            return False
        # through JSON: of a tuple a record has a list
        mine, kept = (json_values(config.to_json() | free) for config in configs)
        return mine == kept

    def _check_whole(self, name: str, low: int, high: int) -> None:
        value = getattr(self, name)
        if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
            raise ValueError(f"{name} must be a whole number from {low} to {high}, got {value!r}")

    def _check_number(self, name: str, low: float, high: float) -> None:
        value = getattr(self, name)
        if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
            raise ValueError(f"{name} must be a number from {low:g} to {high:g}, got {value!r}")
