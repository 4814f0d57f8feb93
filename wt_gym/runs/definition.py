"""What decides on the numbers of a run."""

from __future__ import annotations

import enum
import functools
import hashlib
import inspect
import json
import os
import types
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any

import numpy as np

from wt_gym.base.canary import CANARY

__all__ = ["RunDefinition", "described", "digest", "run_digest"]

_WRITTEN_OUT = 100
"""Numbers that an array may have to be written out; a larger one is told by a digest."""
_PACKAGE = "wt_gym"


def digest(value: Any) -> str:
    """Sixteen hexadecimal digits of the SHA-256 of a JSON value; the order of keys does not matter."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def run_digest(definition: Mapping[str, Any]) -> str:
    """Digest of the definition of a run without the canary in its fingerprint, which is compared, never hashed."""
    fingerprint = definition.get("fingerprint")
    if fingerprint is None or CANARY not in fingerprint:
        return digest(definition)
    return digest({**definition, "fingerprint": {name: fingerprint[name] for name in fingerprint if name != CANARY}})


@dataclass(frozen=True)
class RunDefinition:
    """Who runs where, in what wind and for how long, and with which code: plain data.

    Runs with the same `to_json` have the same numbers on the same machine; the last digits of the canary depend on the
    processor. Entries of None are left out.

    Attributes
    ----------
    wind : dict
        Mean speed, seed and what else tells the wind from every other one.
    duration : float
        [s].
    skip : float
        Start left out of the metrics [s].
    fingerprint : dict
        Digests of turbine and fidelity, and a canary of the package (`wt_gym.benchmark.benchmark_fingerprint`).
    agent : dict, optional
        Tells who acts from everyone else; None where nobody does.
    env_id : str, optional
        None where a simulator runs without an environment.
    env_kwargs : dict, optional
        Arguments besides those of the id.
    interface : dict, optional
        Arguments that the agent chooses.
    faults : list of dict, optional
    azimuth : float, optional
        Of blade 1 at the start [deg].
    seed : int, optional
        Of the environment: what the wind leaves open.
    replay : float, optional
        Length of the end of which shapes are kept [s].
    wind_files : dict, optional
        Digests of the files of wind that the arguments name.
    more : dict
        What a study adds: task and version of the benchmark.
    """

    wind: dict[str, Any]
    duration: float
    skip: float
    fingerprint: dict[str, Any]
    agent: dict[str, Any] | None = None
    env_id: str | None = None
    env_kwargs: dict[str, Any] | None = None
    interface: dict[str, Any] | None = None
    faults: list[dict[str, Any]] | None = None
    azimuth: float | None = None
    seed: int | None = None
    replay: float | None = None
    wind_files: dict[str, Any] | None = None
    more: dict[str, Any] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """Everything as JSON values, as a file would give it back; objects by `described`.

        Raises
        ------
        ValueError
            If ``more`` repeats something, or an object has no description that is the same in every process.
        """
        parts = {part.name: getattr(self, part.name) for part in fields(self) if part.name != "more"}
        known = {name: value for name, value in parts.items() if value is not None}
        if both := known.keys() & self.more.keys():
            raise ValueError(f"more must not repeat what a run is defined by, got {', '.join(sorted(both))}")
        known |= self.more
        return {name: described(value, name) for name, value in known.items()}

    @property
    def digest(self) -> str:
        """Short name of the run."""
        return run_digest(self.to_json())


def described(value: Any, name: str = "value") -> Any:
    """Describe a value by JSON values that depend on its content alone: the same in every process.

    Parameters
    ----------
    value : object
        Plain values, numbers of numpy and paths stand for themselves, also in mappings, lists, tuples and sets. Arrays
        are told by their numbers; dataclasses by their fields; other objects by their ``to_dict()``, else by their
        attributes; functions and classes of a module by its name and theirs, those of others with a digest of their
        source.
    name : str
        For the message.

    Raises
    ------
    ValueError
        If it has no such description: lambdas and functions within functions, generators, open files, objects that
        refer to themselves; the message names the place.
    """
    return _described(value, name, ())


def _described(value: Any, name: str, above: tuple[int, ...]) -> Any:
    if value is None or (isinstance(value, bool | int | float | str) and not isinstance(value, enum.Enum)):
        return value.item() if isinstance(value, np.generic) else value
    if isinstance(value, np.generic):
        return _described(value.item(), name, above)
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if id(value) in above:
        raise ValueError(f"{name} must not refer to itself, got {value!r:.100}")
    above = (*above, id(value))
    if isinstance(value, Mapping):
        return {_key(key, name): _described(one, f"{name}[{key!r}]", above) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_described(one, f"{name}[{k}]", above) for k, one in enumerate(value)]
    if isinstance(value, set | frozenset):
        return sorted((_described(one, name, above) for one in value), key=lambda one: json.dumps(one, sort_keys=True))
    if isinstance(value, np.ndarray):
        return _array(value, name, above)
    return _object(value, name, above)


def _key(key: Any, name: str) -> str:
    """Key of a mapping as JSON has it."""
    if isinstance(key, str | bool | int | float | None):
        return str(next(iter(json.loads(json.dumps({key: 0})))))
    raise ValueError(f"keys of {name} must be texts or numbers, got {key!r:.100}")


def _array(value: np.ndarray[Any, Any], name: str, above: tuple[int, ...]) -> Any:
    """Numbers of a small array, the digest of those of a large one."""
    if value.size <= _WRITTEN_OUT or value.dtype.hasobject:
        return _described(value.tolist(), name, above)
    content = hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
    return {"array": value.dtype.str, "shape": list(value.shape), "sha256": content}


def _object(value: Any, name: str, above: tuple[int, ...]) -> Any:
    """Description of what is not a plain value."""
    if isinstance(value, type | types.FunctionType | types.BuiltinFunctionType):
        return _named(value, name)
    if isinstance(value, types.MethodType):
        return {"method": value.__name__, "of": _described(value.__self__, name, above)}
    if isinstance(value, functools.partial):
        parts = {"function": value.func, "arguments": value.args, "keywords": value.keywords}
        return {"partial": _described(parts, name, above)}
    kind = _named(type(value), name)
    if isinstance(value, enum.Enum):
        return kind | {"value": value.name}
    if is_dataclass(value) and not isinstance(value, type):
        content = {one.name: getattr(value, one.name) for one in fields(value)}
    elif callable(getattr(value, "to_dict", None)):
        content = value.to_dict()
    elif hasattr(value, "__dict__") and not isinstance(value, types.ModuleType):
        content = vars(value)
    else:
        raise ValueError(
            f"{name} must be plain data, a dataclass, an object with attributes or to_dict(), or a function or class "
            f"of a module, so that a run can be told from others; got {value!r:.100}"
        )
    return kind | {key: _described(one, f"{name}.{key}", above) for key, one in content.items()}


def _named(value: Any, name: str) -> dict[str, Any]:
    """Module and name of a function or class, with a digest of the source where that is not the package's own."""
    module, qualname = value.__module__, value.__qualname__
    if "<" in qualname:
        raise ValueError(
            f"{name} must be a function or class of a module, which can be told from others in another process; got "
            f"{qualname} of {module}"
        )
    found = {"class" if isinstance(value, type) else "function": f"{module}:{qualname}"}
    if module == "builtins" or module.partition(".")[0] == _PACKAGE:
        return found
    try:
        source = inspect.getsource(value)
    except (OSError, TypeError):  # compiled, or typed at a prompt
        return found
    return found | {"source": hashlib.sha256(source.encode()).hexdigest()[:16]}
