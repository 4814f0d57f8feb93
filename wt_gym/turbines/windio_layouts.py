"""windIO files of other versions and layouts in that of windIO 2.1.

Files of version 1 are read by the converter that comes with windIO. Its own ``convert()`` works from file to file,
prints, and continues after a part that it cannot convert, which leaves half of the angles in radians. Its steps are
called here one by one, and a step that fails is an error. Two parts it drops are carried over: the masses and inertias
of nacelle and generator, and all but the first Reynolds number of an airfoil. The composite layers of the blade are not
converted, because nothing here reads them.

WISDEM writes its limits under ``control.pitch``, ``control.torque`` and ``control.supervisory``, as windIO's converter
to 2.0 leaves them, and masses and inertias under ``elastic_properties_mb``. Units are those of version 2 (deg, rpm).
"""

import contextlib
import copy
import io
import logging
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.base.files import read_rows
from wt_gym.turbines.checks import fail

_log = logging.getLogger(__name__)

_ALLOWED = "2.x, or 1.x for a file whose blade has an outer_shape_bem"
_LARGEST_TWIST_GAP = np.radians(0.1)


def to_version_2(data: dict[str, Any], notes: list[str]) -> dict[str, Any]:
    """Return a file of any version as one of version 2.

    Parameters
    ----------
    data : dict
        Content of the file.

    Returns
    -------
    dict
        ``data`` itself for a file of version 2.
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


_MOVED = {row["foreign"]: row["windio"] for row in read_rows(Path(__file__).with_suffix(".csv"))}
"""Place in the foreign layout and in windIO 2.1, with the same meaning and unit."""

_TIP_SPEEDS = ("control.supervisory.maxTS", "control.max_allowable_blade_tip_speed")
"""Largest tip speeds [m/s] in WISDEM's files of windIO 2.0 and 2.1."""

_MARKS = ("control.pitch", "control.torque", "control.supervisory", "control.max_allowable_blade_tip_speed")
"""What tells a file of WISDEM."""


def adopt_layout(data: dict[str, Any], notes: list[str]) -> None:
    """Move the numbers of a foreign layout to where windIO 2.1 has them, in place.

    A number that stands in both places is left alone. The rated rotor speed, which WISDEM computes, is the smaller of
    ``torque.VS_maxspd`` (``control.max_rotor_speed`` in converted files) and the largest tip speed over the radius. A
    WISDEM file whose ``assembly`` gives another rotor diameter or hub height than its blade and tower (by more than
    1 %) means those of ``assembly``: blade and tower are stretched along z, as WISDEM does when it reads the file.

    Parameters
    ----------
    data : dict
        Content of the file.
    """
    foreign = any(_get(data, path) is not None for path in _MARKS)
    speed = _rated_rotor_speed(data, notes)
    moved: dict[str, list[str]] = {}
    for old, new in _MOVED.items():
        value = _get(data, old)
        if value is None or _get(data, new) is not None:
            continue
        parent, _, key = old.rpartition(".")
        _put(data, new, value)
        del _get(data, parent)[key]
        moved.setdefault(parent, []).append(f"{key} as {new}")
    if speed is not None:
        _put(data, "control.rated_rotor_speed", speed)
    for parent, names in moved.items():
        notes.append(f"{parent}: layout of windIO 2.0 or WISDEM, read {', '.join(names)}")
        _remove_if_empty(data, parent)
    _to_newton_meters(data, notes)
    if foreign:
        _stretch(data, notes)


def _rated_rotor_speed(data: dict[str, Any], notes: list[str]) -> float | None:
    """Return the rated rotor speed [rpm] of a file that leaves it to be computed, None where it gives it."""
    if _get(data, "control.rated_rotor_speed") is not None:
        return None
    found = {}
    for path in ("control.torque.VS_maxspd", "control.max_rotor_speed", *_TIP_SPEEDS):
        value = _number(data, path)
        if path in _TIP_SPEEDS:
            diameter = _number(data, "assembly.rotor_diameter")
            value = 2.0 * value / diameter * 30.0 / math.pi if value and diameter else None
        if value:  # 0 stands for "no limit"
            found[path] = value
    if not found:
        return None
    least = min(found, key=lambda path: found[path])
    notes.append(
        f"control.rated_rotor_speed: not in the file, {found[least]:.4g} rpm follows from {least}"
        f"{' and assembly.rotor_diameter' if least in _TIP_SPEEDS else ''}"
    )
    return found[least]


def _to_newton_meters(data: dict[str, Any], notes: list[str]) -> None:
    """Turn torque limits that a tool wrote in kN m into N m; one far below the rated torque cannot be meant in N m."""
    largest, speed = _number(data, "control.max_gen_torque"), _number(data, "control.rated_rotor_speed")
    power = _number(data, "assembly.rated_power") or _number(data, "control.rated_power")
    if not largest or not speed or not power:
        return
    ratio = _number(data, "components.drivetrain.gearbox.gear_ratio") or 1.0
    rated = power / (speed * math.pi / 30.0 * ratio)
    if largest >= 0.5 * rated:
        return
    if not 0.9 * rated <= 1e3 * largest <= 3.0 * rated:
        raise fail("control.max_gen_torque", largest, f"a torque of at least the rated one, {rated:.4g} N m")
    scaled = [key for key in ("max_gen_torque", "max_torque_rate") if _number(data, f"control.{key}") is not None]
    for key in scaled:
        data["control"][key] *= 1e3
    notes.append(
        f"control: {', '.join(scaled)} read in kN m, because in N m the largest torque, {largest:g}, were a thousandth "
        "of the rated one"
    )


def _stretch(data: dict[str, Any], notes: list[str]) -> None:
    """Stretch blade and tower to the rotor diameter and hub height of ``assembly``."""
    diameter, hub = _number(data, "assembly.rotor_diameter"), _number(data, "components.hub.diameter")
    cone = _number(data, "components.hub.cone_angle") or 0.0
    blade = _z(data, "components.blade.reference_axis.z.values")
    if diameter and hub is not None and blade:
        own = 2.0 * (blade[-1] + 0.5 * hub) * math.cos(math.radians(cone))
        if abs(own - diameter) > 0.01 * own:
            scale = diameter / own  # of the blade alone, which leaves out what the hub would have to grow
            _put(data, "components.blade.reference_axis.z.values", [z * scale for z in blade])
            notes.append(
                f"components.blade.reference_axis.z: stretched from {blade[-1]:.2f} m to {blade[-1] * scale:.2f} m for "
                f"the {diameter:g} m of assembly.rotor_diameter, as WISDEM reads its files"
            )
    height = _number(data, "assembly.hub_height")
    above = _number(data, "components.drivetrain.outer_shape.distance_tt_hub")
    tower = _z(data, "components.tower.reference_axis.z.values")
    if height and above is not None and tower:
        own, top = tower[-1] + above, height - above
        if abs(own - height) > 0.01 * own and top > tower[0]:
            scale = (top - tower[0]) / (tower[-1] - tower[0])
            _put(data, "components.tower.reference_axis.z.values", [tower[0] + (z - tower[0]) * scale for z in tower])
            notes.append(
                f"components.tower.reference_axis.z: top moved from {tower[-1]:.2f} m to {top:.2f} m, so that the hub "
                f"is {height:g} m high as assembly.hub_height says, as WISDEM reads its files"
            )


def _z(data: dict[str, Any], path: str) -> list[float] | None:
    """Return an ascending list of numbers, None for anything else, which the reader of that part refuses by name."""
    values = _get(data, path)
    if not isinstance(values, list) or len(values) < 2 or not all(_is_number(value) for value in values):
        return None
    return [float(value) for value in values] if values[-1] > values[0] else None


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _number(data: dict[str, Any], path: str) -> float | None:
    value = _get(data, path)
    if value is None:
        return None
    if not _is_number(value) or value < 0.0:
        raise fail(path, value, "a finite number of at least 0")
    return float(value)


def _get(data: dict[str, Any], path: str) -> Any:
    node: Any = data
    for part in path.split("."):
        if not isinstance(node, dict):
            return None
        node = node.get(part)
    return node


def _put(data: dict[str, Any], path: str, value: Any) -> None:
    *parents, key = path.split(".")
    for part in parents:
        if data.get(part) is None:
            data[part] = {}
        data = data[part]
    data[key] = value


def _remove_if_empty(data: dict[str, Any], path: str) -> None:
    parent, _, key = path.rpartition(".")
    if _get(data, path) == {}:
        del _get(data, parent)[key]
