"""Layouts of windIO 2 files that are not the schema's: keys of windIO 2.0 and of WISDEM under those of windIO 2.1.

WISDEM writes its limits under ``control.pitch``, ``control.torque`` and ``control.supervisory``, as windIO's converter
to 2.0 leaves them, and masses and inertias under ``elastic_properties_mb``. Units are those of version 2 (deg, rpm).
"""

import math
from typing import Any

from wt_gym.turbines.checks import fail

__all__ = ["adopt_layout"]

_MOVED = {
    "control.pitch.min_pitch": "control.min_pitch_limit",
    "control.pitch.max_pitch": "control.max_pitch_limit",
    "control.pitch.max_pitch_rate": "control.max_pitch_rate",
    "control.torque.max_torque_rate": "control.max_torque_rate",
    "control.torque.tsr": "control.optimal_tsr",
    "control.torque.VS_minspd": "control.min_rotor_speed",
    "control.supervisory.rated_power": "control.rated_power",
    "control.supervisory.Vin": "assembly.cut_in_wind_speed",
    "control.supervisory.Vout": "assembly.cut_out_wind_speed",
    "components.hub.elastic_properties_mb.system_mass": "components.hub.elastic_properties.mass",
    "components.hub.elastic_properties_mb.system_inertia": "components.hub.elastic_properties.inertia",
    "components.hub.elastic_properties_mb.system_center_mass": "components.hub.elastic_properties.location",
    "components.drivetrain.elastic_properties_mb.system_mass": "components.drivetrain.elastic_properties.mass",
    "components.drivetrain.elastic_properties_mb.system_inertia": "components.drivetrain.elastic_properties.inertia",
    "components.drivetrain.elastic_properties_mb.system_inertia_tt": (
        "components.drivetrain.elastic_properties.inertia_tt"
    ),
    "components.drivetrain.elastic_properties_mb.system_center_mass": (
        "components.drivetrain.elastic_properties.location"
    ),
    "components.drivetrain.elastic_properties_mb.spring_constant": (
        "components.drivetrain.elastic_properties.spring_constant"
    ),
    "components.drivetrain.elastic_properties_mb.damping_coefficient": (
        "components.drivetrain.elastic_properties.damping_coefficient"
    ),
    "components.drivetrain.elastic_properties_mb.yaw_mass": "components.yaw.elastic_properties.mass",
    "components.drivetrain.generator.generator_rpm_efficiency_user": "components.drivetrain.generator.rpm_efficiency",
    "components.drivetrain.generator.elastic_properties_mb.system_mass": (
        "components.drivetrain.generator.elastic_properties.mass"
    ),
    "components.drivetrain.generator.elastic_properties_mb.rotor_inertia": (
        "components.drivetrain.generator.elastic_properties.inertia"
    ),
}
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
    notes : list of str
        Receives a sentence for each place from which numbers were taken.

    Raises
    ------
    TurbineDefinitionError
        If a number that enters the rated rotor speed or the stretching is not one, or the largest torque is far below
        the rated one.
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
    """Turn torque limits that a tool wrote in kN m into N m; one far below the rated torque cannot be meant in N m.

    Raises
    ------
    TurbineDefinitionError
        If the largest torque is less than half the rated one in either unit.
    """
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
