"""Hyperparameters by algorithm and environment, and recipes: YAML files, of which nothing is evaluated.

A file of hyperparameters, in the style of rl-baselines3-zoo, has a section ``default`` and one for each environment id
that differs from it. A recipe is the recommended training of a task, a file of options of ``wt-gym train`` for its id.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
import yaml

from wt_gym.base.errors import did_you_mean
from wt_gym.base.files import shipped_folder
from wt_gym.base.options import Options, option, option_record, options_of, real_number, word_value
from wt_gym.tasks import TASKS

_FOLDER, _RECIPES = shipped_folder() / "hyperparameters", shipped_folder() / "recipes"


def _or_falling(meaning: str, low: float, high: float) -> Any:
    """Number that may be ``lin_<number>``: falling from it to zero over the training."""
    allowed = f"a number from {low:g} to {high:g}, or lin_<number> to let it fall to zero"

    def check(value: float | str) -> float | str:
        if isinstance(value, str):
            number = real_number(word_value(value.removeprefix("lin_"))) if value.startswith("lin_") else None
            if number is None or not low <= number <= high:
                raise ValueError(f"must be {allowed}, got {value!r}")
        return value

    return option(meaning, default=None, low=low, high=high, check=check, allowed=allowed)


def _layers(sizes: tuple[int, ...]) -> tuple[int, ...]:
    if not 1 <= len(sizes) <= 8:
        raise ValueError(f"must have one to eight layers, got {len(sizes)}")
    return sizes


_MANY = 10_000_000
_COPIES = "steps between updates, over all copies of the environment"


@option_record
class _Shared(Options):
    """Hyperparameters of every algorithm, named as in stable-baselines3; left out, they are those of its defaults."""

    title = "hyperparameters"

    learning_rate: float | str = _or_falling("learning rate", 1e-8, 1.0)
    gamma: float = option("discount of rewards in a step", default=None, low=0.0, high=1.0)
    batch_size: int = option("samples of an update", default=None, low=2, high=1_000_000)
    log_std_init: float = option("first logarithm of the standard deviation of actions", default=None, low=-10, high=3)
    net_arch: tuple[int, ...] = option("sizes of the hidden layers", default=None, low=1, high=4096, check=_layers)
    linear_policy: bool = option("no hidden layers in the policy: those of net_arch are of values alone", default=None)
    activation_fn: str = option("activation of the layers", default=None, choices=("tanh", "relu", "elu"))
    use_sde: bool = option("exploration that depends on the state", default=None)
    sde_sample_freq: int = option("steps between its draws; -1: a rollout", default=None, low=-1, high=1_000_000)
    normalize_observations: bool = option("scale observations by their statistics", default=None)
    normalize_rewards: bool = option("scale rewards by the statistics of returns", default=None)


@option_record
class _Ppo(_Shared):
    """Hyperparameters of PPO."""

    rollout_steps: int = option(_COPIES, default=None, low=2, high=1_000_000)
    n_steps: int = option("the same of each copy", default=None, low=2, high=1_000_000)
    n_epochs: int = option("passes over a rollout", default=None, low=1, high=1000)
    gae_lambda: float = option("factor of the generalized advantage estimate", default=None, low=0.0, high=1.0)
    clip_range: float | str = _or_falling("range of the ratio of probabilities about 1", 1e-6, 10.0)
    ent_coef: float = option("weight of the entropy", default=None, low=0.0, high=1e3)
    vf_coef: float = option("weight of the loss of values", default=None, low=0.0, high=1e3)
    max_grad_norm: float = option("greatest norm of the gradient", default=None, low=1e-6, high=1e6)
    target_kl: float = option("divergence that ends the passes over a rollout", default=None, low=1e-6, high=1e3)


@option_record
class _Sac(_Shared):
    """Hyperparameters of SAC."""

    buffer_size: int = option("steps in the replay buffer", default=None, low=1, high=_MANY)
    learning_starts: int = option("steps before the first update", default=None, low=0, high=_MANY)
    tau: float = option("share of the critics that their targets take over", default=None, low=0.0, high=1.0)
    update_every: int = option(_COPIES, default=None, low=1, high=1_000_000)
    train_freq: int = option("the same of each copy", default=None, low=1, high=1_000_000)
    gradient_steps: int = option("updates at a time; -1: one a step", default=None, low=-1, high=1_000_000)
    ent_coef: float | str = option("weight of the entropy", default=None, low=0.0, high=1e3, choices=("auto",))
    target_entropy: float | str = option("aim of the entropy", default=None, low=-1e3, high=1e3, choices=("auto",))


@option_record
class _Tqc(_Sac):
    """Hyperparameters of TQC."""

    top_quantiles_to_drop_per_net: int = option("greatest quantiles left out", default=None, low=0, high=100)
    n_quantiles: int = option("quantiles of a critic", default=None, low=1, high=1000)
    n_critics: int = option("number of critics", default=None, low=1, high=20)


ALGORITHMS: dict[str, type[Options]] = {"PPO": _Ppo, "SAC": _Sac, "TQC": _Tqc}
"""Algorithms with the hyperparameters that they take; those of stable-baselines3, except for the flags
``normalize_observations`` and ``normalize_rewards`` and those of `OVER_ALL_COPIES`."""

OVER_ALL_COPIES = {"rollout_steps": "n_steps", "update_every": "train_freq"}
"""Steps between updates, over all copies of the environment; and the hyperparameter of stable-baselines3 that counts
them for each copy. One replaces the other."""


def check_hyperparameters(algorithm: str, values: Any, where: str = "hyperparameters") -> dict[str, Any]:
    """Refuse hyperparameters that an algorithm does not have, or values out of range; return the others as they are."""
    if algorithm not in ALGORITHMS:
        near = did_you_mean(algorithm, ALGORITHMS)
        raise ValueError(f"algorithm must be one of {', '.join(ALGORITHMS)}, got {algorithm!r}{near}")
    try:
        declared = {one.name: one for one in options_of(ALGORITHMS[algorithm])}
        for name, value in ALGORITHMS[algorithm].named(values).items():
            declared[name].checked(value)
    except ValueError as error:
        raise ValueError(f"{where} of {algorithm}: {error}") from error
    for over_all, each in OVER_ALL_COPIES.items():
        if over_all in values and each in values:
            raise ValueError(
                f"{where}: steps must be given once, got {over_all} (over all copies of the environment) and {each} "
                "(of each)"
            )
    return dict(values)


def read_hyperparameters(path: str | Path, algorithm: str, env_id: str) -> dict[str, Any]:
    """Hyperparameters of a YAML file for an environment: its section on top of ``default``."""
    path = Path(path)
    try:
        table = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is not valid YAML: {' '.join(str(error).split())}") from error
    if not isinstance(table, Mapping):
        raise ValueError(f"{path} must map environment ids, or 'default', to hyperparameters, got {table!r:.80}")
    sections: dict[str, dict[str, Any]] = {}
    for section, entries in table.items():
        if section != "default" and section not in gym.registry:
            raise ValueError(f"{path}: sections must be 'default' or the id of an environment, got {section!r}")
        if isinstance(entries, Mapping):
            entries = {name: word_value(value) if isinstance(value, str) else value for name, value in entries.items()}
        where = f"{path}, section {section!r}"
        sections[section] = check_hyperparameters(algorithm, {} if entries is None else entries, where)
    return replaced(sections.get("default", {}), sections.get(env_id, {}))


def hyperparameters_for(
    algorithm: str, env_id: str, file: str | Path | None = None, overrides: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Hyperparameters of a training: those of the package, replaced by those of a file, replaced by single ones."""
    overrides = check_hyperparameters(algorithm, overrides or {})
    values = read_hyperparameters(_FOLDER / f"{algorithm.lower()}.yml", algorithm, env_id)
    if file is not None:
        values = replaced(values, read_hyperparameters(file, algorithm, env_id))
    return replaced(values, overrides)


def replaced(values: Mapping[str, Any], overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Hyperparameters with some replaced, steps of each copy by those over all copies too, and the other way round."""
    pairs = [pair for names in OVER_ALL_COPIES.items() for pair in (names, names[::-1])]
    gone = {other for name, other in pairs if name in overrides}
    return {name: value for name, value in values.items() if name not in gone} | dict(overrides)


def of_each_copy(values: Mapping[str, Any], n_envs: int) -> dict[str, Any]:
    """Hyperparameters as stable-baselines3 has them: steps between updates are of each copy of the environment."""
    given = dict(values)
    for over_all, each in OVER_ALL_COPIES.items():
        if over_all in given:
            given[each] = max(2 if each == "n_steps" else 1, given.pop(over_all) // n_envs)
    return given


def recipe_names() -> tuple[str, ...]:
    """Tasks that have a recipe, in the order of `wt_gym.tasks.TASKS`."""
    return tuple(name for name in TASKS if (_RECIPES / f"{name}.yml").is_file())


def recipe_file(env_id: str) -> Path:
    """File with the recipe of the id of a task."""
    tasks = {TASKS[name].id: name for name in recipe_names()}
    if env_id not in tasks:
        raise ValueError(
            f"--recipe needs an environment that has one, got {env_id!r}; must be one of {', '.join(tasks)}"
            f"{did_you_mean(env_id, tasks)}"
        )
    return _RECIPES / f"{tasks[env_id]}.yml"
