"""Turbines by name, from a windIO file or from an OpenFAST model."""

import importlib
import importlib.util
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wt_gym.base.errors import TurbineDefinitionError, did_you_mean
from wt_gym.turbine_records import RECORDS
from wt_gym.turbines.checks import fail
from wt_gym.turbines.model import Turbine
from wt_gym.turbines.windio import own_file, read_turbine

__all__ = ["catalogue", "load_turbine", "turbine_file"]


def _windio_example(name: str) -> Path:
    # Found without importing windIO, which is slow and, for a file read before, not needed.
    spec = importlib.util.find_spec("windIO")
    if spec is None or spec.origin is None:
        raise TurbineDefinitionError("the package windIO is not installed: pip install windIO")
    return Path(spec.origin).parent / "examples" / "turbine" / name


@cache
def _built(name: str) -> Turbine:
    """Make a turbine that no windIO file describes, or none alone."""
    source = RECORDS[name].source
    if "function" in source:
        module, _, function = source["function"].partition(":")
        out: Turbine = getattr(importlib.import_module(module), function)()
        return out
    return load_turbine(source["turbine"], water_depth=source["water_depth"])


def _has_file(name: str) -> bool:
    """Whether a windIO file describes a turbine of the catalogue."""
    return bool(RECORDS[name].source.keys() & {"file", "windio_example"})


def catalogue() -> tuple[str, ...]:
    """Return the names that ``load_turbine`` knows."""
    return tuple(RECORDS)


def load_turbine(
    name_or_path: str | Path,
    water_depth: float | None = None,
    foundation: NDArray[np.float64] | None = None,
    rotation: str | None = None,
) -> Turbine:
    """Load a turbine of the catalogue, any windIO file (version 2 or 1) or any OpenFAST model.

    Parameters
    ----------
    name_or_path : str or Path
        A name of ``catalogue()``, the path of a YAML file, or that of the primary file of an OpenFAST model (``.fst``,
        see `read_openfast`).
    water_depth : float, optional
        Puts the tower on the monopile of the file, in water of this depth [m]. By default a tower is clamped at its
        base.
    foundation : ndarray (6, 6), optional
        Stiffness of the ground under that monopile (see `Support`), by default rigid.
    rotation : {"clockwise", "counter-clockwise"}, optional
        Direction in which the rotor turns, seen looking downwind. By default that of the file: OpenFAST models say it
        (MirrorRotor), windIO has no key for it and means clockwise.

    Returns
    -------
    Turbine
        Frozen; the same object for the same content of the file in one process. ``turbine.notes`` lists what had to be
        assumed because the file does not say it.

    Raises
    ------
    TurbineDefinitionError
        If the name or path is unknown, the file is not YAML, does not fit windIO's schema, lacks a number the simulator
        needs or contradicts itself. The message names the file, the key path and what is allowed.

    Examples
    --------
    >>> load_turbine("nrel_5mw").rotor_diameter
    126.0
    >>> load_turbine("nrel_5mw", rotation="counter-clockwise").rotation
    'counter-clockwise'
    """
    turbine = _load(name_or_path, water_depth, foundation)
    return turbine if rotation is None or rotation == turbine.rotation else replace(turbine, rotation=rotation)


def _load(name_or_path: str | Path, water_depth: float | None, foundation: NDArray[np.float64] | None) -> Turbine:
    """Load a turbine as its file describes it; see `load_turbine`."""
    if foundation is not None and water_depth is None:
        raise fail("foundation", "a stiffness", "None without a water_depth")
    if isinstance(name_or_path, str) and name_or_path in RECORDS and not _has_file(name_or_path):
        if water_depth is not None:
            raise fail("water_depth", water_depth, f"None for {name_or_path!r}, which no windIO file describes")
        return _built(name_or_path)
    path = turbine_file(name_or_path)
    if path.suffix.lower() == ".fst":
        return _openfast(path, water_depth)
    return read_turbine(path, water_depth, foundation)


def _openfast(path: Path, water_depth: float | None) -> Turbine:
    from wt_gym.turbines.openfast import read_openfast  # which most users never need

    if water_depth is not None:
        raise fail("water_depth", water_depth, "None for an OpenFAST model, whose substructure is left aside")
    try:
        return read_openfast(path)
    except TurbineDefinitionError as error:
        raise TurbineDefinitionError(f"{path}: {error}") from error


def turbine_file(name_or_path: str | Path) -> Path:
    """Return the path of the file behind a name of the catalogue, or the given path if it is a file.

    Raises
    ------
    TurbineDefinitionError
        If it is neither, or a turbine of the catalogue that has no file.
    """
    if isinstance(name_or_path, str) and name_or_path in RECORDS:
        source = RECORDS[name_or_path].source
        if not _has_file(name_or_path):
            with_file = ", ".join(repr(name) for name in RECORDS if _has_file(name))
            raise TurbineDefinitionError(
                f"turbine {name_or_path!r} has no windIO file, the package builds it: load_turbine({name_or_path!r}); "
                f"with a file are {with_file}"
            )
        return own_file(source["file"]) if "file" in source else _windio_example(source["windio_example"])
    allowed = f"one of {', '.join(map(repr, catalogue()))} or the path of a windIO file or OpenFAST model (.fst)"
    if not isinstance(name_or_path, (str, Path)):
        raise fail("turbine", name_or_path, allowed)
    path = Path(name_or_path).expanduser()
    if path.is_dir():
        raise fail("turbine", str(name_or_path), f"{allowed} (this is a folder)")
    if not path.is_file():
        raise fail(
            "turbine", str(name_or_path), f"{allowed} (there is no such file){did_you_mean(name_or_path, catalogue())}"
        )
    return path
