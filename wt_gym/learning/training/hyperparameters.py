"""Hyperparameters by algorithm and environment: YAML files in the style of rl-baselines3-zoo, checked.

A file has a section ``default`` and one for each environment id that differs from it. Nothing in it is evaluated:
values are numbers, words and lists.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import yaml

import wt_gym  # noqa: F401 - registers the environments
from wt_gym.base.errors import did_you_mean
from wt_gym.base.files import shipped_folder

__all__ = [
    "ALGORITHMS",
    "OVER_ALL_COPIES",
    "check_hyperparameters",
    "hyperparameters_for",
    "of_each_copy",
    "parse_override",
    "read_hyperparameters",
    "replaced",
]

_FOLDER = shipped_folder() / "hyperparameters"


@dataclass(frozen=True)
class _Number:
    """A number from ``low`` to ``high``."""

    low: float
    high: float
    whole: bool = False

    def allows(self, value: Any) -> bool:
        kinds = int if self.whole else (int, float)
        return isinstance(value, kinds) and not isinstance(value, bool) and self.low <= value <= self.high

    def __str__(self) -> str:
        return f"a {'whole ' if self.whole else ''}number from {self.low:g} to {self.high:g}"


@dataclass(frozen=True)
class _Schedule:
    """A number, or ``lin_<number>``: falling from it to zero over the training."""

    low: float
    high: float

    def allows(self, value: Any) -> bool:
        if isinstance(value, str) and value.startswith("lin_"):
            value = _plain(value.removeprefix("lin_"))
        return _Number(self.low, self.high).allows(value)

    def __str__(self) -> str:
        return f"a number from {self.low:g} to {self.high:g}, or lin_<number> to let it fall to zero"


@dataclass(frozen=True)
class _Word:
    """One of some words, or another kind of value."""

    words: tuple[Any, ...]
    other: Any = None

    def allows(self, value: Any) -> bool:
        # bools equal numbers in Python: the type decides too
        listed = any(value == word and type(value) is type(word) for word in self.words)
        return listed or (self.other is not None and self.other.allows(value))

    def __str__(self) -> str:
        words = "one of " + ", ".join(str(word).lower() if word in (True, False) else str(word) for word in self.words)
        return words if self.other is None else f"{words}, or {self.other}"


@dataclass(frozen=True)
class _Layers:
    """Sizes of the hidden layers."""

    def allows(self, value: Any) -> bool:
        size = _Number(1, 4096, whole=True)
        return isinstance(value, list | tuple) and 1 <= len(value) <= 8 and all(size.allows(n) for n in value)

    def __str__(self) -> str:
        return "a list of one to eight sizes from 1 to 4096, as [64, 64]"


_FLAG = _Word((True, False))
_SHARED = {
    "learning_rate": _Schedule(1e-8, 1.0),
    "gamma": _Number(0.0, 1.0),
    "batch_size": _Number(2, 1_000_000, whole=True),
    "log_std_init": _Number(-10.0, 3.0),
    "net_arch": _Layers(),
    "activation_fn": _Word(("tanh", "relu", "elu")),
    "use_sde": _FLAG,
    "sde_sample_freq": _Number(-1, 1_000_000, whole=True),
    "normalize_observations": _FLAG,
    "normalize_rewards": _FLAG,
}
_OFF_POLICY = _SHARED | {
    "buffer_size": _Number(1, 10_000_000, whole=True),
    "learning_starts": _Number(0, 10_000_000, whole=True),
    "tau": _Number(0.0, 1.0),
    "update_every": _Number(1, 1_000_000, whole=True),
    "train_freq": _Number(1, 1_000_000, whole=True),
    "gradient_steps": _Number(-1, 1_000_000, whole=True),
    "ent_coef": _Word(("auto",), _Number(0.0, 1e3)),
    "target_entropy": _Word(("auto",), _Number(-1e3, 1e3)),
}
ALGORITHMS: dict[str, dict[str, Any]] = {
    "PPO": _SHARED
    | {
        "rollout_steps": _Number(2, 1_000_000, whole=True),
        "n_steps": _Number(2, 1_000_000, whole=True),
        "n_epochs": _Number(1, 1000, whole=True),
        "gae_lambda": _Number(0.0, 1.0),
        "clip_range": _Schedule(1e-6, 10.0),
        "ent_coef": _Number(0.0, 1e3),
        "vf_coef": _Number(0.0, 1e3),
        "max_grad_norm": _Number(1e-6, 1e6),
        "target_kl": _Number(1e-6, 1e3),
    },
    "SAC": _OFF_POLICY,
    "TQC": _OFF_POLICY
    | {
        "top_quantiles_to_drop_per_net": _Number(0, 100, whole=True),
        "n_quantiles": _Number(1, 1000, whole=True),
        "n_critics": _Number(1, 20, whole=True),
    },
}
"""Algorithms with the hyperparameters that they take; named as in stable-baselines3, except for the flags
``normalize_observations`` and ``normalize_rewards`` and those of `OVER_ALL_COPIES`."""

OVER_ALL_COPIES = {"rollout_steps": "n_steps", "update_every": "train_freq"}
"""Steps between updates, over all copies of the environment; and the hyperparameter of stable-baselines3 that counts
them for each copy. One replaces the other."""


def check_hyperparameters(algorithm: str, values: Any, where: str = "hyperparameters") -> dict[str, Any]:
    """Refuse hyperparameters that an algorithm does not have, or values out of range.

    Returns
    -------
    dict
        The values.

    Raises
    ------
    ValueError
        Naming what was given and what is allowed.
    """
    if algorithm not in ALGORITHMS:
        near = did_you_mean(algorithm, ALGORITHMS)
        raise ValueError(f"algorithm must be one of {', '.join(ALGORITHMS)}, got {algorithm!r}{near}")
    if not isinstance(values, Mapping):
        raise ValueError(f"{where} must map names to values, got {values!r}")
    known = ALGORITHMS[algorithm]
    for name, value in values.items():
        if name not in known:
            raise ValueError(
                f"{where}: names for {algorithm} must be among {', '.join(sorted(known))}; got {name!r}"
                f"{did_you_mean(name, known)}"
            )
        if not known[name].allows(value):
            raise ValueError(f"{where}: {name} must be {known[name]}, got {value!r}")
    for over_all, each in OVER_ALL_COPIES.items():
        if over_all in values and each in values:
            raise ValueError(
                f"{where}: steps must be given once, got {over_all} (over all copies of the environment) and {each} "
                "(of each)"
            )
    return dict(values)


def read_hyperparameters(path: str | Path, algorithm: str, env_id: str) -> dict[str, Any]:
    """Hyperparameters of a file for an environment: its section on top of ``default``.

    Raises
    ------
    FileNotFoundError
    ValueError
        If the file is not YAML, has a section that names no environment, or an entry that the algorithm does not take.
    """
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
            entries = {name: _plain(value) if isinstance(value, str) else value for name, value in entries.items()}
        where = f"{path}, section {section!r}"
        sections[section] = check_hyperparameters(algorithm, {} if entries is None else entries, where)
    return replaced(sections.get("default", {}), sections.get(env_id, {}))


def hyperparameters_for(
    algorithm: str, env_id: str, file: str | Path | None = None, overrides: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Hyperparameters that training starts with.

    Those that come with the package, replaced by those of a file, replaced by single ones.

    Parameters
    ----------
    algorithm : str
        Of `ALGORITHMS`.
    env_id : str
    file : str or path, optional
    overrides : mapping, optional

    Returns
    -------
    dict

    Raises
    ------
    FileNotFoundError, ValueError
        See `read_hyperparameters`.
    """
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
    """Hyperparameters as stable-baselines3 has them: steps between updates are of each copy of the environment.

    Parameters
    ----------
    values : mapping
        Of `hyperparameters_for`.
    n_envs : int
        Copies.
    """
    given = dict(values)
    for over_all, each in OVER_ALL_COPIES.items():
        if over_all in given:
            given[each] = max(2 if each == "n_steps" else 1, given.pop(over_all) // n_envs)
    return given


def parse_override(text: str) -> tuple[str, Any]:
    """Name and value from ``name=value``, as on the command line.

    Raises
    ------
    ValueError
        If there is no name, or the value is not YAML.
    """
    name, separator, value = text.partition("=")
    if not (name and separator):
        raise ValueError(f"a hyperparameter must be given as name=value, got {text!r}")
    return name.strip(), _plain(value)


def _plain(text: str) -> Any:
    """Value of a text: a number if it reads as one (YAML takes ``1e-3`` for a word), else what YAML makes of it."""
    for kind in (int, float):
        try:
            number = kind(text)
        except ValueError:
            continue
        if math.isfinite(number):
            return number
    try:
        return yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ValueError(f"a value must be a number, a word or YAML, got {text!r}") from error
