"""Winds by description: the path of a file, or a mapping that JSON can hold.

The suffix of a path tells the format: ``.bts`` (TurbSim), ``.csv``, ``.wnd`` or ``.hh`` (series), ``.nc`` (hipersim),
``.json`` (a mapping in a file; relative paths in it count from its folder). A mapping has either ``file``, a path or
the three paths of a HAWC2 box, or ``kind``, and options:

==================================== ===================================================================================
``{"file": "a.bts"}``                ``remove_profile``, ``beyond_grid``, ``time_offset``, and after ``remove_profile``
                                     the options of the mean wind
``{"file": "a.csv"}``, .wnd, .hh     ``hub_height``, ``reference_length``, ``travels``, ``time_offset``
``{"file": ["u", "v", "w"]}``        required: ``shape``, ``spacing``, ``mean_speed``; ``hub_height``, ``factors``,
                                     ``y_center``, ``z_center``, ``beyond_grid``, ``time_offset``, the mean wind
``{"file": "a.nc"}``                 required: ``mean_speed``; otherwise as above without shape and spacing
``{"kind": "steady"}``               required: ``speed``; ``hub_height``, the mean wind
``{"kind": "step"}``                 required: ``before``, ``after``, ``time``; ``hub_height``, ``shear_exponent``,
                                     ``reference_length``, ``travels``
``{"kind": "ramp"}``                 required: ``before``, ``after``, ``time``, ``duration``; otherwise as step
==================================== ===================================================================================

The options of the mean wind are those of `SteadyInflow`: ``shear_exponent``, ``roughness_length``, ``veer``,
``yaw_misalignment``, ``inclination``, ``jet_height``, ``jet_share``. Defaults of ``hub_height`` and
``reference_length`` are hub height and rotor diameter of the turbine.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeGuard

from wt_gym.base.errors import InflowError, did_you_mean
from wt_gym.wind.mann_files import read_hawc2, read_hipersim
from wt_gym.wind.protocol import Inflow
from wt_gym.wind.series import SeriesInflow
from wt_gym.wind.series_files import read_csv, read_uniform
from wt_gym.wind.steady import SteadyInflow
from wt_gym.wind.turbulence_box import TurbulenceBox
from wt_gym.wind.turbulent import TurbulentInflow

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["SUFFIXES", "files_of", "is_described", "is_wind_path", "whole_description", "wind_from"]

SUFFIXES = (".bts", ".csv", ".wnd", ".hh", ".nc", ".json")
"""Of files of wind."""

_MEAN_WIND = (
    "shear_exponent", "roughness_length", "veer", "yaw_misalignment", "inclination", "jet_height", "jet_share",
)  # fmt: skip
_SERIES = ("hub_height", "reference_length", "travels", "time_offset")
_BOX = ("hub_height", "factors", "y_center", "z_center")
_CARRIED = ("beyond_grid", "time_offset", *_MEAN_WIND)
_CHANGES = ("hub_height", "reference_length", "travels", "shear_exponent")
# What each form must have, and what it may have.
_FORMS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    ".bts": ((), ("remove_profile", *_CARRIED)),
    ".csv": ((), _SERIES),
    ".wnd": ((), _SERIES),
    ".hh": ((), _SERIES),
    ".nc": (("mean_speed",), (*_BOX, *_CARRIED)),
    "three files": (("shape", "spacing", "mean_speed"), (*_BOX, *_CARRIED)),
    "steady": (("speed",), ("hub_height", *_MEAN_WIND)),
    "step": (("before", "after", "time"), _CHANGES),
    "ramp": (("before", "after", "time", "duration"), _CHANGES),
}
_KINDS = ("steady", "step", "ramp")


def is_wind_path(value: object) -> bool:
    """Whether a value is the path of a file of wind, by its suffix."""
    return isinstance(value, str | os.PathLike) and os.path.splitext(os.fspath(value))[1].lower() in SUFFIXES


def is_described(value: object) -> TypeGuard[str | os.PathLike[str] | Mapping[str, Any]]:
    """Whether a value is a path or a mapping that describes a wind."""
    return isinstance(value, Mapping) or is_wind_path(value)


def whole_description(description: str | os.PathLike[str] | Mapping[str, Any]) -> dict[str, Any]:
    """A description as a mapping with whole paths: it means the same in other folders and processes.

    Parameters
    ----------
    description
        A path or a mapping.

    Raises
    ------
    InflowError
        If it is neither, a ``.json`` file cannot be read, or a path has no suffix of `SUFFIXES`.
    """
    folder, given = ".", description
    if not isinstance(description, Mapping) and is_wind_path(description):
        path = os.path.abspath(os.fspath(description))
        if not path.lower().endswith(".json"):
            return {"file": path}
        folder, given = os.path.dirname(path), _json(path)
    if not isinstance(given, Mapping):
        raise InflowError(
            f"a wind is described by a mapping or by a file that ends in {', '.join(SUFFIXES)}; got {given!r:.100}"
        )
    found = dict(given)
    if ("file" in found) == ("kind" in found):
        raise InflowError(f"the description of a wind has either 'file' or 'kind'; got {sorted(map(str, found))}")
    if "kind" in found:
        return found
    files = found["file"]
    several = isinstance(files, list | tuple)
    paths = [os.fspath(one) for one in (files if several else [files]) if isinstance(one, str | os.PathLike)]
    if len(paths) != (len(files) if several else 1) or (several and len(paths) != 3):
        raise InflowError(f"file must be a path, or the paths of u, v and w of a HAWC2 box; got {files!r:.200}")
    if not several and (not is_wind_path(paths[0]) or paths[0].lower().endswith(".json")):
        raise InflowError(f"file must end in {', '.join(s for s in SUFFIXES if s != '.json')}; got {paths[0]!r}")
    paths = [os.path.abspath(os.path.join(folder, path)) for path in paths]
    return {**found, "file": paths if several else paths[0]}


def files_of(description: Mapping[str, Any]) -> tuple[str, ...]:
    """Paths of the files that a whole description names."""
    files = description.get("file", ())
    return (files,) if isinstance(files, str) else tuple(files)


def wind_from(
    description: str | os.PathLike[str] | Mapping[str, Any], hub_height: float = 90.0, rotor_diameter: float = 126.0
) -> Inflow:
    """Make the wind of a description.

    Parameters
    ----------
    description
        A path or a mapping, see the module.
    hub_height, rotor_diameter
        Of the turbine [m], for what the description leaves open.

    Raises
    ------
    InflowError
        If an option is unknown, missing or out of range, or a file cannot be read.

    Examples
    --------
    >>> print(wind_from({"kind": "step", "before": 8.0, "after": 11.0, "time": 30.0}))
    step from 8 to 11 m/s at 30 s: 8 to 11 m/s at 90 m, uniform profile
    """
    options = whole_description(description)
    files, kind = options.pop("file", None), options.pop("kind", None)
    form = kind if files is None else "three files" if isinstance(files, list) else Path(files).suffix.lower()
    if form not in _FORMS:
        raise InflowError(
            f"kind must be one of {', '.join(map(repr, _KINDS))}; got {kind!r:.100}{did_you_mean(kind, _KINDS)}"
        )
    _check_options(form, options)
    if form == ".bts":
        return _from_bts(files, options)
    if form == "steady":
        return SteadyInflow(**{"hub_height": hub_height, **options})
    if form in ("three files", ".nc"):
        return _from_mann(files, {"hub_height": hub_height, **options})
    options = {"hub_height": hub_height, "reference_length": rotor_diameter, **options}
    if form in _KINDS:
        return SeriesInflow.step(**options) if form == "step" else SeriesInflow.ramp(**options)
    return read_csv(files, **options) if form == ".csv" else read_uniform(files, **options)


def _check_options(form: str, options: dict[str, Any]) -> None:
    needed, more = _FORMS[form]
    for name in options:
        if name not in (*needed, *more):
            near = did_you_mean(name, (*needed, *more), ".")
            raise InflowError(
                f"a wind of the form {form!r} has no option {name!r:.60}{near} Allowed: {', '.join((*needed, *more))}"
            )
    missing = [name for name in needed if name not in options]
    if missing:
        raise InflowError(f"a wind of the form {form!r} needs {', '.join(missing)}")


def _from_bts(path: str, options: dict[str, Any]) -> TurbulentInflow:
    remove = options.pop("remove_profile", False)
    if not isinstance(remove, bool):
        raise InflowError(f"remove_profile must be True or False; got {remove!r}")
    box = TurbulenceBox.from_bts(path, remove_profile=remove)
    return _carried(replace(box, description=f"{Path(path).name}: {box.description}"), options)


def _from_mann(files: str | Sequence[str], options: dict[str, Any]) -> TurbulentInflow:
    carried = {name: options.pop(name) for name in _CARRIED if name in options}
    return _carried(
        read_hipersim(files, **options) if isinstance(files, str) else read_hawc2(files, **options), carried
    )


def _carried(box: TurbulenceBox, options: dict[str, Any]) -> TurbulentInflow:
    """Box on a mean wind of its own speed and height."""
    mean = {name: options.pop(name) for name in _MEAN_WIND if name in options}
    return TurbulentInflow(box, SteadyInflow(box.mean_speed, box.hub_height, **mean), **options)


def _json(path: str) -> Any:
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InflowError(f"cannot read the description of a wind {path}: {error}") from error
