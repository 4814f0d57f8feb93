"""Identity of runs, and their results on disk: a file a run, named by the digest of its definition."""

import enum
import functools
import hashlib
import inspect
import json
import os
import types
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from filelock import FileLock, Timeout

from wt_gym.base.canary import CANARY, differing
from wt_gym.base.files import read_json, remove_partial, write_text_whole

__all__ = ["RUNS_FOLDER", "SWEEP_FILE", "FolderLock", "RunStore", "described", "digest", "run_definition", "run_digest"]


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


def run_definition(
    *, wind: dict[str, Any], duration: float, skip: float, fingerprint: dict[str, Any], **parts: Any
) -> dict[str, Any]:
    """Definition of a run: agent, environment, wind, length and code, as the JSON values that a file gives back.

    Runs with the same definition have the same numbers on the same machine; the last digits of the canary depend on
    the processor.

    Parameters
    ----------
    wind : dict
        Mean speed, seed and what else tells the wind from every other one.
    duration, skip : float
        Length, and the start left out of the metrics [s].
    fingerprint : dict
        Digests of turbine and fidelity, and a canary of the package (`wt_gym.experiment.run.benchmark_fingerprint`).
    **parts
        What else decides, as ``agent`` (its identity), ``env_id``, ``env_kwargs``, ``interface`` (arguments that the
        agent chooses), ``seed`` (of what the wind leaves open) or ``wind_files`` (their digests). Parts of None are
        left out; objects are told by `described`.

    Raises
    ------
    ValueError
        If an object has no description that is the same in every process.
    """
    parts |= {"wind": wind, "duration": duration, "skip": skip, "fingerprint": fingerprint}
    return {name: described(value, name) for name, value in parts.items() if value is not None}


def described(value: Any, name: str = "value") -> Any:
    """Describe a value by JSON values that depend on its content alone: the same in every process.

    Parameters
    ----------
    value : object
        Plain values, numbers of NumPy and paths stand for themselves, also in mappings, lists, tuples and sets. Arrays
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
        for key in value:
            if not isinstance(key, str | bool | int | float | None):
                raise ValueError(f"keys of {name} must be texts or numbers, got {key!r:.100}")
        pairs = ((str(*json.loads(json.dumps({key: 0}))), key) for key in value)  # keys as JSON has them
        return {text: _described(value[key], f"{name}[{key!r}]", above) for text, key in pairs}
    if isinstance(value, list | tuple):
        return [_described(one, f"{name}[{k}]", above) for k, one in enumerate(value)]
    if isinstance(value, set | frozenset):
        return sorted((_described(one, name, above) for one in value), key=lambda one: json.dumps(one, sort_keys=True))
    if isinstance(value, np.ndarray):
        if value.size <= _WRITTEN_OUT or value.dtype.hasobject:
            return _described(value.tolist(), name, above)
        content = hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
        return {"array": value.dtype.str, "shape": list(value.shape), "sha256": content}
    return _object(value, name, above)


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


class FolderLock:
    """Holds a folder for one process while it is entered, and leaves no folder behind where nothing was written.

    What killed processes had begun to write there is removed.

    The lock is the operating system's and ends with the process, however that ends: a file that a killed process left
    behind locks nothing. In the file stands the number of the process that holds it, where the system lets anyone write
    and read a locked file (Windows does not).

    Parameters
    ----------
    path : str or path
        Created when the lock is taken.
    work : str
        What is done there, for the name of the file and the message.

    Raises
    ------
    ValueError
        On entering, if another process works there.
    OSError
        On entering, if the folder cannot be made.
    """

    subfolders: tuple[str, ...] = ()
    """Folders in this one that the work writes to."""

    def __init__(self, path: str | Path, work: str):
        self.path, self._work = Path(path), work
        self._lock_file = self.path / f"{work}.lock"
        self._lock: FileLock | None = None
        self._made = False

    def __enter__(self) -> Self:
        self._made = not self.path.exists()
        self.path.mkdir(parents=True, exist_ok=True)
        lock = FileLock(self._lock_file, timeout=0, thread_local=False)
        try:
            lock.acquire()
        except Timeout:
            holder = ""
            with suppress(OSError):
                holder = self._lock_file.read_text(encoding="utf-8", errors="replace").strip()
            raise ValueError(f"{self.path} is in use by another {self._work} (process {holder or 'unknown'})") from None
        self._lock = lock
        with suppress(PermissionError):
            self._lock_file.write_text(f"{os.getpid()}\n", encoding="utf-8")
        for folder in (self.path, *(self.path / name for name in self.subfolders)):
            remove_partial(folder)
        return self

    def __exit__(self, *_exception: object) -> None:
        lock, self._lock = self._lock, None
        with suppress(PermissionError):  # first, so that who takes a lock on a file has the file of that name
            self._lock_file.unlink(missing_ok=True)
        if lock is not None:
            lock.release()
        with suppress(PermissionError):  # Windows removes no file that is open
            if os.name == "nt":
                self._lock_file.unlink(missing_ok=True)
        if self._made and not any(self.path.iterdir()):  # refused before anything was written
            self.path.rmdir()


RUNS_FOLDER, SWEEP_FILE = "runs", "sweep.json"


class RunStore(FolderLock):
    """Folder of runs; a context that holds it for this process, where others must not write at the same time.

    A file is there when it is whole: after an interrupted series every finished run is there, and none in part.

    Parameters
    ----------
    work : str
        As of `FolderLock`.
    folder : str
        Of the files, in the path; "" is the path itself.
    """

    error: type[ValueError] = ValueError
    """Raised where a file is damaged."""
    required: frozenset[str] = frozenset({"definition"})
    """Entries of a file."""
    indent: int | None = None
    """Of the files; None: one line."""

    def __init__(self, path: str | Path, work: str = "runs", folder: str = RUNS_FOLDER):
        super().__init__(path, work)
        self.subfolders = (folder,) if folder else ()
        self._folder = self.path / folder

    def name(self, definition: dict[str, Any]) -> str:
        """Name of the file of a run."""
        return f"{run_digest(definition)}.json"

    def file(self, definition: dict[str, Any]) -> Path:
        """Path of the file of a run, which need not exist."""
        return self._folder / self.name(definition)

    def find(self, definition: dict[str, Any]) -> Any | None:
        """Result of a run, None if it has not been made yet; errors as of `read`."""
        return self.read(definition) if self.file(definition).exists() else None

    def read(self, definition: dict[str, Any]) -> Any:
        """Result of a run that has been made, else a `FileNotFoundError`.

        Raises a `ValueError` if its file is damaged, holds another run than its name says, or was made by a version of
        the package with another behavior.
        """
        return self._read(self.file(definition), definition)

    def keep(self, definition: dict[str, Any], result: Any) -> Any:
        """Write the result of a run; return it as it will be read. Numbers that are not finite raise a `ValueError`."""
        self._folder.mkdir(parents=True, exist_ok=True)
        return self._write(self.file(definition), definition, result)

    def _read(self, file: Path, definition: dict[str, Any] | None = None) -> Any:
        """Read a file, and check it against its name and the behavior of the current version of the package."""
        try:
            result: dict[str, Any] = read_json(file)
        except ValueError as error:
            raise self.error(f"{error}; remove it to have the run made again") from error
        if not set(result) >= self.required or not isinstance(result["definition"], dict):
            needed = ", ".join(sorted(self.required))
            raise self.error(f"{file} is damaged, or no result: it must have {needed}; remove it")
        if self.name(result["definition"]) != file.name:
            raise self.error(f"{file} is not what its name says: its definition has been changed; remove it")
        present = {} if definition is None else definition.get("fingerprint", {})
        if present and (parts := differing(result["definition"].get("fingerprint", {}), present)):
            raise self.error(
                f"{file} was made with another {' and '.join(parts)}: take another folder, or remove the file to have "
                "the run made again"
            )
        return result

    def _write(self, file: Path, definition: dict[str, Any], result: Any) -> Any:
        text = json.dumps({"definition": definition, **result}, indent=self.indent, allow_nan=False) + "\n"
        write_text_whole(file, text)
        return json.loads(text)

    @contextmanager
    def session(self, tally: Any, found: int, label: Callable[[Any], str] = str) -> Iterator[None]:
        """Play rows, and add a row to ``sweep.json`` however that ends, unless the process is killed.

        A row has ``found`` (results that were stored), ``made``, ``retried`` (runs begun again because a process or
        a machine was gone) and ``lost`` (labels of those given up). Earlier counts of the tally do not belong to it.
        """
        file, done, retried, lost = self.path / SWEEP_FILE, tally.done, tally.retried, len(tally.lost)
        try:
            yield
        finally:
            row = {
                "found": found, "made": tally.done - done, "retried": tally.retried - retried,
                "lost": [label(row) for row in tally.lost[lost:]],
            }  # fmt: skip
            if self.path.is_dir():
                rows = read_json(file, list) if file.exists() else []
                write_text_whole(file, json.dumps([*rows, row], indent=1) + "\n")
