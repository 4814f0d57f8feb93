"""Classes of the user, named as ``path/file.py:Class`` or ``module:Class``: to load one runs the code of its file."""

from __future__ import annotations

import ast
import hashlib
import importlib
import importlib.util
import inspect
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wt_gym.base.errors import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["call_maker", "load_class", "source_digest"]


def load_class(target: str) -> Any:
    """Load what ``path/file.py:Class`` or ``module:Class`` names: a class, or a function that makes something.

    The file or module is executed, with all that its author wrote into it. A file is executed once in a process and
    stays the same module, so that objects of its classes can be pickled and copied. Modules are looked for in the
    present folder too.

    Parameters
    ----------
    target : str

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If there is no such module, or it has no such name.
    """
    place, name = _place_and_name(target)
    module = _module_of_file(Path(place)) if place.endswith(".py") else _module(place, target)
    found: Any = module
    for part in name.split("."):
        if not hasattr(found, part):
            known = [key for key, value in vars(found).items() if callable(value) and not key.startswith("_")]
            there = ", ".join(known) or "no class or function"
            raise ValueError(f"{place} has no {name!r}; it has {there}{did_you_mean(name, known)}")
        found = getattr(found, part)
    if not callable(found):
        raise ValueError(f"{target} must be a class, or a function that makes a controller or an agent, got {found!r}")
    return found


def call_maker(target: str, maker: Callable[..., Any], arguments: dict[str, Any]) -> Any:
    """Call a class or function of a file with keyword arguments.

    Parameters
    ----------
    target : str
        Its name, for the message.
    maker : callable
    arguments : dict

    Raises
    ------
    ValueError
        If it takes other arguments.
    """
    try:
        signature = inspect.signature(maker)
        signature.bind(**arguments)
    except TypeError as error:
        raise ValueError(f"{target} takes the arguments {signature}, got {arguments}: {error}") from error
    return maker(**arguments)


def source_digest(target: str) -> str:
    """SHA-256 sum of the file in which a class is written: what tells it from one that was changed.

    What that file imports does not count.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If there is no such module, or it has no source.
    """
    place, _ = _place_and_name(target)
    if place.endswith(".py"):
        return hashlib.sha256(_existing(Path(place)).read_bytes()).hexdigest()
    source = inspect.getsourcefile(_module(place, target))
    if source is None:
        raise ValueError(f"module {place!r} has no source file")
    return hashlib.sha256(Path(source).read_bytes()).hexdigest()


def classes_in(file: Path) -> list[str]:
    """Names of the classes in a file, which is read but not executed; none where it is not Python."""
    try:
        tree = ast.parse(file.read_bytes())
    except (SyntaxError, ValueError, OSError):
        return []
    return [node.name for node in tree.body if isinstance(node, ast.ClassDef)]


def _place_and_name(target: str) -> tuple[str, str]:
    place, _, name = target.rpartition(":")
    return place, name


def _existing(file: Path) -> Path:
    if not file.is_file():
        raise FileNotFoundError(f"there is no file {file}")
    return file


def _module_of_file(file: Path) -> Any:
    """Module of a file, executed where it is not yet."""
    path = _existing(file).resolve()
    name = f"wt_gym_own_{path.stem}_{hashlib.sha256(str(path).encode()).hexdigest()[:8]}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ValueError(f"{file} cannot be loaded as Python")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def _module(name: str, target: str) -> Any:
    """Module by name; the present folder is looked in after all others."""
    here = os.getcwd()
    if here not in sys.path:
        sys.path.append(here)
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is not None and (name == error.name or name.startswith(f"{error.name}.")):
            raise ValueError(
                f"there is no module {error.name!r} for {target!r}; a file is named as path/file.py:Class"
            ) from error
        raise
