"""Files of windIO version 1 as files of version 2, by the converter that comes with windIO.

The converter's own ``convert()`` works from file to file, prints, and continues after a part that it cannot convert,
which leaves half of the angles in radians. Its steps are called here one by one, and a step that fails is an error. Two
parts it drops are carried over: the masses and inertias of nacelle and generator, and all but the first Reynolds number
of an airfoil. The composite layers of the blade are not converted, because nothing here reads them.
"""

import contextlib
import copy
import io
import logging
from collections.abc import Callable
from typing import Any

import numpy as np

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.turbines.checks import fail

__all__ = ["to_version_2"]

_log = logging.getLogger(__name__)

_ALLOWED = "2.x, or 1.x for a file whose blade has an outer_shape_bem"
_LARGEST_TWIST_GAP = np.radians(0.1)


def to_version_2(data: dict[str, Any], notes: list[str]) -> dict[str, Any]:
    """Return a file of any version as one of version 2.

    Parameters
    ----------
    data : dict
        Content of the file.
    notes : list of str
        Receives a sentence if the file was converted.

    Returns
    -------
    dict
        ``data`` itself for a file of version 2.

    Raises
    ------
    TurbineDefinitionError
        If the version is missing in a file that is not shaped as one of version 1, is not supported, or a part cannot
        be converted; the last names the part and the key that it lacks.
    """
    version = data.get("windIO_version")
    if version is None and not _looks_like_version_1(data):
        raise TurbineDefinitionError(f"windIO_version: missing, expected is {_ALLOWED}")
    major = "1" if version is None else str(version).strip().lower().removeprefix("v").split(".")[0]
    if major == "2":
        return data
    if major != "1" or not _looks_like_version_1(data):
        raise fail("windIO_version", version, _ALLOWED)
    converted = _convert(data)
    notes.append("windIO_version: the file is of version 1 and was read through windIO's own converter to version 2")
    return converted


def _looks_like_version_1(data: dict[str, Any]) -> bool:
    components = data.get("components")
    blade = components.get("blade") if isinstance(components, dict) else None
    return isinstance(blade, dict) and "outer_shape_bem" in blade


def _convert(data: dict[str, Any]) -> dict[str, Any]:
    try:
        from windIO.converters.windIO2windIO import v1p0_to_v2p0
    except ImportError as error:
        raise TurbineDefinitionError(
            "windIO_version: got 1.x, and the windIO that is installed has no converter; must be 2.x, or "
            "read with windIO 2.1"
        ) from error
    converter = v1p0_to_v2p0.__new__(v1p0_to_v2p0)  # its constructor makes a folder for its output
    new = copy.deepcopy(data)
    new["windIO_version"] = "2.0"
    if "description" in new:
        new["comments"] = new.pop("description")
    nacelle = copy.deepcopy(new["components"].get("nacelle"))
    steps: list[tuple[str, Callable[[], Any]]] = [
        ("components.blade", lambda: _blade(converter, new)),
        ("components.nacelle", lambda: _nacelle(converter, new, nacelle)),
        ("components.tower", lambda: converter.convert_tower(new)),
        ("airfoils", lambda: _airfoils(converter, new)),
        ("materials", lambda: converter.convert_materials(new) if "materials" in new else None),
        ("control", lambda: _control(converter, new)),
    ]
    if "monopile" in new["components"]:
        steps.append(("components.monopile", lambda: converter.convert_monopile(new)))
    for part, step in steps:
        _run(part, step)
    out: dict[str, Any] = _plain(new)
    return out


def _run(part: str, step: Callable[[], Any]) -> None:
    """Run one step of the converter without its printing."""
    printed = io.StringIO()
    try:
        with contextlib.redirect_stdout(printed):
            step()
    except KeyError as error:
        raise TurbineDefinitionError(
            f"{part}: the key {error.args[0]!r} is missing, windIO's converter from version 1 requires it"
        ) from error
    except (AttributeError, IndexError, TypeError, ValueError) as error:
        raise TurbineDefinitionError(f"{part}: windIO's converter from version 1 cannot read it ({error})") from error
    finally:
        if printed.getvalue():
            _log.debug("windIO's converter, %s: %s", part, printed.getvalue().strip())


def _blade(converter: Any, new: dict[str, Any]) -> None:
    blade = new["components"]["blade"]
    beam = (blade.get("elastic_properties_mb") or {}).get("six_x_six")
    if beam is not None:
        _check_twist(beam, blade["outer_shape_bem"]["twist"])
        beam.setdefault("reference_axis", None)
        beam.setdefault("twist", None)
    converter.convert_blade_reference_axis(new)
    converter.convert_blade_outer_shape(new)
    blade.pop("internal_structure_2d_fem", None)
    blade["structure"] = {}
    if beam is not None:
        converter.convert_elastic_properties(new)


def _check_twist(beam: dict[str, Any], twist: dict[str, Any]) -> None:
    """Require one twist for shape and sections: version 2 has a single one, and the converter drops the other."""
    own = beam.get("twist")
    if not own:
        return
    grid = np.asarray(own["grid"], dtype=float)
    gap = np.abs(np.asarray(own["values"], dtype=float) - np.interp(grid, twist["grid"], twist["values"])).max()
    if gap > _LARGEST_TWIST_GAP:
        where = "components.blade.elastic_properties_mb.six_x_six.twist"
        raise fail(where, f"{np.degrees(gap):.2f} deg from it", "the twist of outer_shape_bem, within 0.1 deg")


def _nacelle(converter: Any, new: dict[str, Any], old: dict[str, Any] | None) -> None:
    new["components"]["hub"].setdefault("drag_coefficient", 0.5)  # the default of the schema; nothing here reads it
    converter.convert_nacelle(new)
    drivetrain = new["components"]["drivetrain"]
    old_train = (old or {}).get("drivetrain") or {}
    old_generator = (old or {}).get("generator") or {}
    for key in ("distance_hub_mb", "distance_mb_mb"):
        if key in old_train:
            drivetrain["outer_shape"].setdefault(key, old_train[key])
    for source in (old_train, old or {}):
        if "elastic_properties_mb" in source:
            drivetrain.setdefault("elastic_properties_mb", source["elastic_properties_mb"])
    generator = drivetrain["generator"]
    names = {
        "generator_length": "length",
        "generator_radius_user": "radius",
        "generator_mass_user": "mass",
        "generator_rpm_efficiency_user": "rpm_efficiency",
        "rpm_efficiency_user": "rpm_efficiency",
    }
    for key, name in names.items():
        for source in (old_generator, old_train):
            if source.get(key):  # 0 stands for "to be computed"
                generator.setdefault(name, source[key])
    for key, value in old_generator.items():
        if key not in names:
            generator.setdefault(key, value)


def _airfoils(converter: Any, new: dict[str, Any]) -> None:
    """Convert the airfoils; the polars of one airfoil at several Reynolds numbers become one set of tables."""
    converter.convert_airfoils(new)
    for airfoil in new["airfoils"]:
        polars = airfoil["polars"]
        numbers = [polar["re_sets"][0]["re"] for polar in polars]
        if len(polars) > 1 and len(set(numbers)) == len(numbers):
            airfoil["polars"] = [polars[0] | {"re_sets": [polar["re_sets"][0] for polar in polars]}]


def _control(converter: Any, new: dict[str, Any]) -> None:
    """Convert the units of the control section; the converter requires keys that a file may leave out."""
    control = new["control"]
    needed = {"pitch": ("min_pitch", "max_pitch", "max_pitch_rate"), "torque": ("VS_minspd", "VS_maxspd")}
    absent = []
    for section, keys in needed.items():
        part = control.setdefault(section, {})
        for key in keys:
            if key not in part:
                part[key] = 0.0
                absent.append((section, key))
    converter.convert_controls(new)
    for section, key in absent:
        del control[section][key]


def _plain(value: Any) -> Any:
    """Turn the arrays and numbers of NumPy that the converter leaves into lists and plain numbers."""
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(entry) for entry in value]
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    return value.item() if isinstance(value, np.generic) else value
