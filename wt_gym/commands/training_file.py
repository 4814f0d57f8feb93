"""A training in a file: the options of the command in YAML, so that the same words begin it, and begin it again."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["words_of"]

_ONLY_TYPED = ("config", "recipe", "resume")
_WITH_NO = ("resume-if-exists", "tensorboard")
_EITHER = (("--seed", "--seeds"), ("--resume-if-exists", "--overwrite"))


def words_of(path: str | Path, typed: Sequence[str] = ()) -> list[str]:
    """Options of a training file as words of a command line.

    Parameters
    ----------
    path : str or path
        YAML that maps names of options, with ``_`` or ``-``, to values: numbers, words, lists of them, true or false
        for switches, a mapping for ``env_kwargs``, ``site``, ``hyper``, ``pretrain`` and ``budget``.
    typed : sequence of str
        Words that come after them; what they exclude is left out, as ``seed`` by ``--seeds``.

    Returns
    -------
    list of str
        What the parser of the command checks like words that were typed.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If it is not such a mapping.
    """
    import yaml  # in the extra "train"

    try:
        options = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is not valid YAML: {error}") from error
    if not isinstance(options, dict) or not all(isinstance(name, str) for name in options):
        raise ValueError(f"{path} must map options of the training to values, as 'algo: sac', got {options!r:.80}")
    words = []
    for name, value in options.items():
        option = name.replace("_", "-")
        if not _typed_instead(option, typed):
            words += _option(option, value, path)
    return words


def _typed_instead(name: str, typed: Sequence[str]) -> bool:
    """Whether an option was typed that excludes this one."""
    options = {word.partition("=")[0] for word in typed}
    return any(f"--{name}" in pair and options & (set(pair) - {f"--{name}"}) for pair in _EITHER)


def _option(name: str, value: Any, path: str | Path) -> list[str]:
    """Words of one option."""
    if any(only.startswith(name) for only in _ONLY_TYPED):  # the parser takes beginnings of names too
        raise ValueError(f"{path}: {name} belongs on the command line")
    match value:
        case bool():
            return [f"--{name}" if value else f"--no-{name}"] if value or name in _WITH_NO else []
        case dict() if name == "env-kwargs":
            return [f"--{name}={json.dumps(value)}"]
        case dict() if name in ("hyper", "site", "pretrain", "budget"):
            return [f"--{name}", *(f"{key}={_word(entry)}" for key, entry in value.items())]
        case list():
            return [f"--{name}", *map(_word, value)]
        case int() | float() | str():
            return [f"--{name}={_word(value)}"]
    raise ValueError(f"{path}: {name} must be a number, a word, a list or true or false, got {value!r:.80}")


def _word(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)
