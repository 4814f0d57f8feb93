"""Turbines as windIO v2 files: what the readers of this package read back as the same turbine, to rounding.

windIO has no keys for some numbers of a turbine and its controller. They go into a JSON file ``NAME.control.json``
beside ``NAME.yaml``, under the names of `ControlData`, and of the turbine (`OWN_FIELDS`).
"""

import dataclasses
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator

from wt_gym.base.files import write_text_whole
from wt_gym.base.quantities import Array
from wt_gym.turbines.airfoil import Airfoil
from wt_gym.turbines.blade import BeamStations, Blade, inertia_matrix, rotation_about_z
from wt_gym.turbines.checks import fail
from wt_gym.turbines.model import Drivetrain, Hub, Nacelle, Tower, Turbine
from wt_gym.turbines.windio import CONTROL_NUMBERS, OWN_FIELDS, control_file_of
from wt_gym.turbines.windio_machine import rpm

_DEGREE = np.pi / 180.0
_VERSION = "2.1"
_ROUNDING = 1e-9  # Relative difference that angles in degrees and speeds in rpm leave
_NO_MU = [0.0] * 6  # windIO's mu, which the schema requires; the ratio beside it is what is read


def write_windio(turbine: Turbine, path: str | Path, source: str = "") -> list[Path]:
    """Write a turbine as a windIO v2 file, and the numbers of its controller beside it.

    Parameters
    ----------
    path : str or Path
        Of the YAML file; the controller's numbers go to ``NAME.control.json`` in the same folder.
    source : str
        Where the turbine comes from, for the head of the file.

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    TurbineDefinitionError
        If the turbine has what windIO files do not hold here: a support, a damper as generator, a downwind cone or
        tilt, stall delay added to polars, a blade that is softer edgewise than flapwise.
    """
    path = Path(path)
    content = windio_content(turbine)
    from ruamel.yaml import YAML  # comes with windIO

    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = None
    yaml.width = 120
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]  # declared as None
    yaml.representer.ignore_aliases = lambda _: True
    text = io.StringIO()
    lines = [f"Turbine in windIO {_VERSION}{f', from {source}' if source else ''}", *turbine.notes]
    text.write("".join(f"# {' '.join(line.split())}\n" for line in lines))
    yaml.dump(content, text)
    written = [path]
    write_text_whole(path, text.getvalue())
    numbers = _control_json(turbine, source)
    beside = control_file_of(path)
    if numbers or beside.exists():  # one of another turbine would count
        write_text_whole(beside, json.dumps(numbers, indent=1) + "\n")
        written.append(beside)
    return written


def windio_content(turbine: Turbine) -> dict[str, Any]:
    """Return what the windIO file of a turbine holds, as mappings, lists and numbers."""
    if turbine.tower.support is not None:
        raise fail("Turbine.tower.support", "a monopile", "None (windIO files take it from their own walls)")
    if turbine.floater is not None:
        without = (
            "windIO has no added mass, radiation damping and wave forces; --turbine takes an OpenFAST model itself"
        )
        raise fail("Turbine.floater", "a platform", f"None: {without}")
    if turbine.drivetrain.generator_damping or not turbine.drivetrain.takes_torque:
        raise fail("Turbine.drivetrain.generator_damping", turbine.drivetrain.generator_damping, "0")
    if turbine.hub.cone < 0.0 or turbine.nacelle.tilt < 0.0:
        raise fail("Turbine.hub.cone, nacelle.tilt", (turbine.hub.cone, turbine.nacelle.tilt), "angles from 0")
    if turbine.blade.augmentation is not None:
        raise fail("Turbine.blade.augmentation", turbine.blade.augmentation, "None")
    if turbine.ice is not None:
        raise fail("Turbine.ice", turbine.ice, "None: the file has one blade for all")
    names = _names(turbine.blade.airfoils)
    return {
        "name": turbine.name,
        "windIO_version": _VERSION,
        "assembly": {
            "turbine_class": turbine.iec_class,
            "turbulence_class": turbine.turbulence_class,
            "drivetrain": "direct_drive" if turbine.drivetrain.gear_ratio == 1.0 else "geared",
            "rotor_orientation": turbine.rotor_orientation,
            "number_of_blades": turbine.n_blades,
            "rotor_diameter": turbine.rotor_diameter,
            "hub_height": turbine.hub_height,
            "rated_power": turbine.drivetrain.rated_power,
            "cut_in_wind_speed": turbine.cut_in,
            "cut_out_wind_speed": turbine.cut_out,
        },
        "control": _control(turbine),
        "components": {
            "hub": _hub(turbine.hub),
            "drivetrain": _drivetrain(turbine.drivetrain, turbine.nacelle),
            "yaw": {"elastic_properties": _yaw(turbine.nacelle)},
            "tower": _tower(turbine.tower),
            "blade": _blade(turbine.blade, names),
        },
        "airfoils": [
            _airfoil(airfoil, name, turbine.blade.rotating_polars)
            for airfoil, name in zip(turbine.blade.airfoils, names, strict=True)
        ],
        "outputs": {
            "cases": [
                {
                    "configuration": {"wind_speed": turbine.rated_wind_speed},
                    "integrated": {"electrical_power": turbine.drivetrain.rated_power},
                }
            ]
        },
    }


def _names(airfoils: tuple[Airfoil, ...]) -> list[str]:
    """Return names that occur once."""
    names: list[str] = []
    for airfoil in airfoils:
        name, k = airfoil.name, 2
        while name in names:
            name, k = f"{airfoil.name} ({k})", k + 1
        names.append(name)
    return names


def _control(turbine: Turbine) -> dict[str, Any]:
    """Return the section ``control``: limits, and gains for the speed of the rotor with the signs of ROSCO."""
    train, pitch = turbine.drivetrain, turbine.pitch
    section: dict[str, Any] = {
        "min_rotor_speed": train.min_rotor_speed / rpm,
        "rated_rotor_speed": train.rated_rotor_speed / rpm,
        "rated_power": train.rated_power,
        "max_gen_torque": train.max_generator_torque,
        "max_torque_rate": train.max_torque_rate,
        "min_pitch_limit": pitch.min_pitch / _DEGREE,
        "max_pitch_limit": min(pitch.max_pitch, 0.5 * np.pi) / _DEGREE,
        "max_pitch_rate": pitch.max_rate / _DEGREE,
        "yaw_rate": min(turbine.nacelle.max_yaw_rate, 10.0 * _DEGREE) / _DEGREE,
    }
    data = turbine.control
    if data is None:
        return section
    turn = rpm * train.gear_ratio
    scaled = [(key, getattr(data, name), turn**power) for key, (name, power) in CONTROL_NUMBERS.items()]
    for key, value, scale in (
        ("fine_pitch", data.fine_pitch, 1.0 / _DEGREE),
        *scaled[:2],
        ("gen_torque_kp", data.torque_proportional_gain, -turn),
        ("gen_torque_ki", data.torque_integral_gain, -turn),
        *scaled[2:],
    ):
        if value is not None:
            section[key] = scale * value
    if data.constant_power is not None:
        section["constant_power"] = int(data.constant_power)
    if data.gain_pitch is not None:
        angle = (data.gain_pitch / _DEGREE).tolist()
        for letter, gains in (("p", data.pitch_proportional_gain), ("i", data.pitch_integral_gain)):
            assert gains is not None
            section[f"pitch_k{letter}"] = {"pitch_angle": angle, f"k{letter}": (-turn / _DEGREE * gains).tolist()}
    if data.min_pitch_wind is not None and data.min_pitch is not None:
        section["min_pitch_table"] = {
            "wind_speed": data.min_pitch_wind.tolist(),
            "min_pitch": (data.min_pitch / _DEGREE).tolist(),
        }
    return section


def _control_json(turbine: Turbine, source: str) -> dict[str, Any]:
    """Return the controller's known numbers under their names, and the turbine's that windIO does not hold."""
    numbers = {} if turbine.control is None else turbine.control.as_dict(all_fields=True)
    values = {name: value for name, value in numbers.items() if value is not None}
    own = {}
    for key, holds in OWN_FIELDS.items():
        part, _, name = key.rpartition(".")
        value = getattr(getattr(turbine, part) if part else turbine, name)
        if not holds(value):
            own[key] = value
    values |= {"turbine": own} if own else {}
    return ({"source": source} if source and values else {}) | values


def _hub(hub: Hub) -> dict[str, Any]:
    return {
        "diameter": 2.0 * hub.radius,
        "cone_angle": hub.cone / _DEGREE,
        "cd": 0.5,  # required by the schema, not read
        "elastic_properties": _rigid_body(
            hub.mass, [hub.inertia_axial, hub.inertia_transverse, hub.inertia_transverse], hub.cm_offset_along_shaft
        ),
    }


def _rigid_body(mass: float, diagonal: list[float], x: float = 0.0) -> dict[str, Any]:
    return {"mass": mass, "inertia": [*diagonal, 0.0, 0.0, 0.0], "location": [x, 0.0, 0.0]}


def _drivetrain(train: Drivetrain, nacelle: Nacelle) -> dict[str, Any]:
    horizontal = nacelle.overhang * np.cos(nacelle.tilt)
    i = nacelle.inertia
    fastest = 2.0 * train.rated_rotor_speed * train.gear_ratio / rpm
    return {
        "outer_shape": {
            "uptilt": nacelle.tilt / _DEGREE,
            "distance_tt_hub": float(nacelle.tower_top_to_shaft + horizontal * np.tan(nacelle.tilt)),
            "overhang": float(horizontal),
        },
        "gearbox": {
            "gear_ratio": train.gear_ratio,
            "efficiency": train.gearbox_efficiency,
            "elastic_properties": {"torsional_stiffness": train.spring, "torsional_damping": train.damper},
        },
        "generator": {
            "rpm_efficiency": {"grid": [0.0, fastest], "values": [train.generator_efficiency] * 2},
            "elastic_properties": _rigid_body(0.0, [train.generator_inertia, 0.0, 0.0]),
        },
        "elastic_properties": {
            "mass": nacelle.mass,
            "inertia": i[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]].tolist(),
            "location": nacelle.cm.tolist(),
        },
    }


def _yaw(nacelle: Nacelle) -> dict[str, Any]:
    body = _rigid_body(nacelle.yaw_bearing_mass, [0.0, 0.0, 0.0])
    return body | {"spring_constant": nacelle.yaw_spring, "damping_coefficient": nacelle.yaw_damper}


def _table(grid: Array, values: Array) -> dict[str, list[float]]:
    return {"grid": grid.tolist(), "values": values.tolist()}


def _unit(station: Array, length: float) -> Array:
    """Return a grid from 0 to 1."""
    grid = station / length
    grid[0], grid[-1] = 0.0, 1.0
    return grid


def _tower(tower: Tower) -> dict[str, Any]:
    ends = np.array([0.0, 1.0])
    zero = _table(ends, np.zeros(2))
    s = tower.structure
    return {
        "reference_axis": {"x": zero, "y": zero, "z": _table(ends, np.array([tower.base_height, tower.height]))},
        "outer_shape": {
            "outer_diameter": _table(_unit(tower.diameter_station, tower.length), tower.diameter),
            "cd": _table(ends, np.full(2, tower.drag_coefficient)),
        },
        "structure": {
            "elastic_properties": _sections(
                "tower", _unit(s.station, tower.length), s.stiffness, s.inertia, tower.damping_ratio
            )
        },
    }


def _sections(name: str, grid: Array, stiffness: Array, inertia: Array, damping: float) -> dict[str, Any]:
    """Return ``elastic_properties`` of section matrices (n, 6, 6) in the frame of the file."""
    table: dict[str, Any] = {"grid": grid.tolist()}
    for i in range(6):
        for j in range(i, 6):
            if np.all(np.isfinite(stiffness[:, i, j])) and (i == j or np.any(stiffness[:, i, j])):
                table[f"K{i + 1}{j + 1}"] = stiffness[:, i, j].tolist()
    m = inertia[:, 0, 0]
    columns = {
        "mass": m,
        "cm_x": inertia[:, 1, 5] / m,
        "cm_y": -inertia[:, 0, 5] / m,
        "i_edge": inertia[:, 3, 3],
        "i_flap": inertia[:, 4, 4],
        "i_cp": -inertia[:, 3, 4],
        "i_plr": inertia[:, 5, 5],
    }
    again = inertia_matrix(*(columns[key] for key in ("mass", "cm_x", "cm_y", "i_edge", "i_flap", "i_cp", "i_plr")))
    if not np.allclose(again, inertia, rtol=1e-6, atol=1e-6 * float(np.abs(inertia).max())):
        raise fail(f"inertia of the {name}", "couplings of another kind", "those of masses off the axis")
    return {
        "stiffness_matrix": table,
        "inertia_matrix": {"grid": grid.tolist(), **{key: column.tolist() for key, column in columns.items()}},
        "structural_damping": {"mu": _NO_MU, "damping_ratio": damping},
    }


def _blade(blade: Blade, names: list[str]) -> dict[str, Any]:
    axis_grid = _unit(blade.axis[:, 2].copy(), blade.length)
    grid = _unit(blade.aero_station.copy(), blade.length)
    shape: dict[str, Any] = {
        "chord": _table(grid, blade.chord),
        "twist": _table(grid, blade.twist / _DEGREE),
        "section_offset_y": _table(grid, blade.le_offset * blade.chord),
    }
    if blade.normal_offset is not None and np.any(blade.normal_offset):
        shape["section_offset_x"] = _table(grid, blade.normal_offset * blade.chord)
    position = np.clip(blade.airfoil_station / blade.length, 0.0, 1.0)
    index = blade.airfoil_index
    if position[0] > 0.0:
        position, index = np.concatenate(([0.0], position)), np.concatenate((index[:1], index))
    if position[-1] < 1.0:
        position, index = np.concatenate((position, [1.0])), np.concatenate((index, index[-1:]))
    thickness = np.array([blade.airfoils[i].relative_thickness for i in index])
    shape["rthick"] = _table(position, thickness)
    shape["airfoils"] = [
        {"name": names[i], "spanwise_position": x} for i, x in zip(index.tolist(), position.tolist(), strict=True)
    ]
    return {
        "reference_axis": {key: _table(axis_grid, blade.axis[:, k]) for k, key in enumerate("xyz")},
        "outer_shape": shape,
        "structure": {
            "anchors": [],  # the schema requires them; there are no composite layers
            "layers": [],
            "elastic_properties": _blade_sections(blade, axis_grid, grid),
        },
    }


def _blade_sections(blade: Blade, axis_grid: Array, grid: Array) -> dict[str, Any]:
    """Return the section matrices in frames turned by the twist, over windIO's grid."""
    s: BeamStations = blade.structure
    place = _invert(PchipInterpolator(axis_grid, blade.axis_station), s.station)
    turn = rotation_about_z(PchipInterpolator(grid, blade.twist)(place))
    back = np.swapaxes(turn, -1, -2)
    rigid = np.isinf(s.stiffness)
    stiffness = np.where(rigid, np.inf, turn @ np.where(rigid, 0.0, s.stiffness) @ back)
    outer = np.linspace(0.3, 1.0, 71)
    edge, flap = (np.interp(outer, place, stiffness[:, k, k]) for k in (3, 4))
    if np.mean(np.log(edge / flap)) < 0.0:
        raise fail("Blade.structure.stiffness", "softer edgewise than flapwise", "stiffer edgewise over the outer 70 %")
    return _sections("blade", place, stiffness, turn @ s.inertia @ back, blade.damping_ratio)


def _invert(station: PchipInterpolator, at: Array) -> Array:
    """Return the places of the grid (n,) at distances along the axis, by bisection of an ascending function."""
    low, high = np.zeros(at.size), np.ones(at.size)
    for _ in range(60):
        middle = 0.5 * (low + high)
        above = station(middle) > at
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    place = 0.5 * (low + high)
    place[0], place[-1] = 0.0, 1.0
    return place


def _airfoil(airfoil: Airfoil, name: str, rotating: bool | None) -> dict[str, Any]:
    polar = airfoil.polar
    angle = (polar.alpha / _DEGREE).tolist()
    words = {True: "rotational augmentation included", False: "no rotational augmentation"}
    table = {key: {"grid": angle, "values": getattr(polar, key).tolist()} for key in ("cl", "cd", "cm")}
    entry = {
        "name": name,
        "coordinates": {"x": airfoil.contour[:, 0].tolist(), "y": airfoil.contour[:, 1].tolist()},
        "rthick": airfoil.relative_thickness,
        "aerodynamic_center": 0.25,
        "polars": [{"configuration": "default", "re_sets": [{"re": 1.0e6, **table}]}],
    }
    return entry | ({} if rotating is None else {"description": words[rotating]})


def require_same(expected: Any, found: Any, where: str = "Turbine") -> None:
    """Require two turbines, or parts of them, to be equal up to rounding; notes and names are not compared.

    Airfoils are compared in their order along the span.
    """
    for item in dataclasses.fields(expected):
        one, two = getattr(expected, item.name), getattr(found, item.name)
        name = f"{where}.{item.name}"
        if item.name in ("notes", "airfoils", "airfoil_index", "name"):
            continue
        if dataclasses.is_dataclass(one) and type(one) is type(two):
            require_same(one, two, name)
        elif not _equal(one, two):
            raise fail(name, two, f"{one!r:.80}")
    if isinstance(expected, Blade) and isinstance(found, Blade):
        pairs = zip(expected.airfoil_index, found.airfoil_index, strict=True)
        for i, (one, two) in enumerate(pairs):
            require_same(expected.airfoils[one], found.airfoils[two], f"{where}.airfoils[{i}]")


def _equal(one: Any, two: Any) -> bool:
    if isinstance(one, np.ndarray) and isinstance(two, np.ndarray):
        if one.shape != two.shape:
            return False
        rigid = np.isinf(one)
        if not np.array_equal(rigid, np.isinf(two)):
            return False
        first, second = one[~rigid], two[~rigid]
        return bool(np.all(np.abs(first - second) <= _ROUNDING * np.abs(first).max(initial=0.0)))
    if isinstance(one, float) and isinstance(two, float):
        return abs(one - two) <= _ROUNDING * max(abs(one), 1e-3)
    return bool(one == two)
