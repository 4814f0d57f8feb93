"""windIO files turned into turbines: the readers of tower and controller, and all parts put together.

windIO's tower frame: x parallel to the ground downwind, z up, y to the left. Section matrices use the same axes, so K44
(bending about x) is side-side and K55 fore-aft.

windIO gives gains of the controller from the speed of the rotor [rpm] to pitch [deg] and torque [N m], with the signs
of ROSCO's input files (negative), and schedules in degrees; `ControlData` holds them on the generator side, in SI units
and positive. A JSON file ``NAME.control.json`` beside ``NAME.yaml`` holds what windIO has no keys for, under the names
of `ControlData`; an angle may be given in degrees under its name with ``_deg``. What stands there goes before the
section of the windIO file. Numbers of the turbine without a windIO key stand in its object ``turbine`` (`OWN_FIELDS`).

The readers raise `TurbineDefinitionError` with the key path that is missing, inconsistent or out of range, and leave a
sentence for every assumption in the notes of the file.
"""

import hashlib
import json
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.base.quantities import AIR_DENSITY, Array
from wt_gym.turbines.blade import BeamStations, inertia_matrix, shear_rigid_stiffness
from wt_gym.turbines.checks import check_number, fail
from wt_gym.turbines.model import ControlData, Support, Tower, Turbine
from wt_gym.turbines.windio_blade import beam_tables, damping_ratio, read_blade, require_straight
from wt_gym.turbines.windio_file import Node, WindioFile, read_windio, within
from wt_gym.turbines.windio_machine import read_drivetrain, read_hub, read_machine, read_nacelle, read_pitch, rpm

_Table = tuple[Array, Array]
"""Grid (n,) and values (n,)."""
_DEGREE = np.pi / 180.0
_LARGEST_PITCH, _LARGEST_YAW_RATE = 0.5 * np.pi, 10.0 * _DEGREE
"""Of windIO's schema."""
OWN_FIELDS: dict[str, Callable[[Any], bool]] = {
    "air_density": lambda value: value == AIR_DENSITY,
    "design_air_density": lambda value: value is None,
    "rotation": lambda value: value == "clockwise",
    "pitch.max_pitch": lambda value: value <= _LARGEST_PITCH,
    "pitch.servo_frequency": lambda value: value is None,
    "pitch.servo_damping": lambda value: value == 1.0,
    "drivetrain.gearbox_reverses": lambda value: not value,
    "drivetrain.torque_lag": lambda value: value == 0.0,
    "drivetrain.min_rotor_speed": lambda value: value > 0.0,  # 0 means unknown in windIO files
    "nacelle.max_yaw_rate": lambda value: value <= _LARGEST_YAW_RATE,
}
"""Fields of a turbine and of its parts that a windIO file has no keys for, or keys with a smaller range, and whether it
holds a value of them."""
CONTROL_NUMBERS = {
    "optimal_tsr": ("optimal_tip_speed_ratio", 0),
    "region2_k": ("region_2_gain", 2),
    "lpf_frequency": ("speed_filter_frequency", 0),
    "lpf_damping": ("speed_filter_damping", 0),
    "pitch_actuator_frequency": ("pitch_actuator_frequency", 0),
    "pitch_actuator_damping": ("pitch_actuator_damping", 0),
}
"""Numbers of the section ``control``: field of `ControlData`, and power with which the speed of the rotor in rpm over
that of the generator in rad/s enters."""
_CLASS_NUMBERS = {"1": "I", "2": "II", "3": "III", "4": "IV"}
_FILE_KEYS = {
    "n_blades": "number_of_blades",
    "rotor_orientation": "rotor_orientation",
    "rotor_diameter": "rotor_diameter",
    "hub_height": "hub_height",
    "cut_in": "cut_in_wind_speed",
    "cut_out": "cut_out_wind_speed",
    "iec_class": "turbine_class",
    "turbulence_class": "turbulence_class",
}
"""Keys of the ``assembly`` section behind the fields of a turbine."""
_DEFAULT_TOWER_DAMPING = 0.01  # Modal damping of the NREL 5-MW and IEA 15-MW towers
POISSON_RATIO = 0.3
"""Of steel; only used where a table leaves out the torsional stiffness."""

_loaded: dict[str, Turbine] = {}


def own_file(name: str) -> Path:
    """Path of a file of the package by its name in the folder of turbines."""
    return Path(__file__).parent / "data" / name


def control_file_of(path: Path) -> Path:
    """Return the path of the published constants beside a windIO file."""
    return path.with_name(f"{path.stem}.control.json")


def read_turbine(path: Path, water_depth: float | None = None, foundation: Array | None = None) -> Turbine:
    """Read a windIO file; arguments and errors are those of `wt_gym.turbines.load_turbine`.

    Returns
    -------
    Turbine
        The same object for the same content of the file in one process.
    """
    beside = control_file_of(path)
    try:
        content = path.read_bytes()
        constants = beside.read_text(encoding="utf-8-sig") if beside.is_file() else None
    except OSError as error:
        raise TurbineDefinitionError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise TurbineDefinitionError(f"{beside}: must be UTF-8 text: {error}") from error
    key = hashlib.sha256(content + b"\0" + (constants or "").encode()).hexdigest()
    if water_depth is None and key in _loaded:
        return _loaded[key]
    file: WindioFile | None = None
    try:
        file = read_windio(path, content)
        turbine = _build(file.root, water_depth, foundation, constants)
    except TurbineDefinitionError as error:
        where, _, rest = str(error).partition(": ")
        alike = ""
        if file is not None and rest.startswith("missing") and where in file.resembling:
            alike = f"; the file has {file.resembling[where]!r} there"
        raise TurbineDefinitionError(f"{path}: {error}{alike}") from error
    if water_depth is None and file.alone:
        _loaded[key] = turbine
    return turbine


def _build(root: Node, water_depth: float | None, foundation: Array | None, constants: str | None) -> Turbine:
    """Turn a file, and constants beside it, into a turbine, on its monopile if the depth of the water is given."""
    notes, assembly = root.notes, root.at("assembly")
    control = root.at("control", "a mapping with rated_rotor_speed, max_gen_torque and the limits of the actuators")
    power_node = assembly if "rated_power" in assembly else control
    rated_power = power_node.number("rated_power", 1.0, 1e9)
    n_blades = int(_default(assembly, "number_of_blades", 3))
    hub_node = root.at("components.hub")
    hub_radius = hub_node.number("diameter", 0.0, 30.0, 0.5)
    blade = read_blade(root, hub_radius, control.number("rated_rotor_speed", 1e-3, 1000.0, rpm))
    diameter = 2.0 * (hub_radius + blade.length) * float(np.cos(hub_node.number("cone_angle", 0.0, 50.0, _DEGREE)))
    machine = read_machine(root, rated_power, diameter, n_blades, blade.structure.mass_moment(0))
    hub = read_hub(root, machine)
    drivetrain = read_drivetrain(root, blade, hub, machine)
    tower = _read_tower(root)
    if water_depth is not None:
        notes[:] = [note for note in notes if not note.startswith("components.monopile:")]
        tower = replace(tower, support=_read_support(root, tower, water_depth, foundation))
    nacelle = read_nacelle(root, blade, hub, machine)
    height = tower.height + root.at("components.drivetrain.outer_shape").number("distance_tt_hub", 0.0, 20.0)
    data = _read_control(root, drivetrain.gear_ratio)
    data, own = (data, {}) if constants is None else _own_constants(root, data, constants)
    values: dict[str, Any] = dict(
        name=root.text("name"),
        n_blades=n_blades,
        rotor_orientation=str(_default(assembly, "rotor_orientation", "upwind")).lower(),
        rotor_diameter=assembly.number("rotor_diameter", 1.0, 1000.0) if "rotor_diameter" in assembly else diameter,
        hub_height=assembly.number("hub_height", 1.0, 1000.0) if "hub_height" in assembly else height,
        rated_wind_speed=_rated_wind_speed(root, rated_power, 0.5 * diameter, drivetrain.rated_rotor_speed),
        cut_in=float(_default(assembly, "cut_in_wind_speed", 3.0)),
        cut_out=float(_default(assembly, "cut_out_wind_speed", 25.0)),
        air_density=AIR_DENSITY,  # windIO's turbine files carry none
        blade=blade,
        tower=tower,
        hub=hub,
        nacelle=nacelle,
        drivetrain=drivetrain,
        pitch=read_pitch(root),
        iec_class=_CLASS_NUMBERS.get(name := str(_default(assembly, "turbine_class", "I")).upper(), name),
        turbulence_class=str(_default(assembly, "turbulence_class", "B")).upper(),
        notes=tuple(notes),
        control=data,
    )
    try:
        return _with_own_fields(Turbine(**values), own)
    except TurbineDefinitionError as error:
        # say the same in the words of the file
        text = str(error)
        for field, key in _FILE_KEYS.items():
            text = text.replace(f"Turbine.{field} ", f"assembly.{key} (Turbine.{field}) ")
        raise TurbineDefinitionError(text) from error


def _default(node: Node, key: str, default: object) -> Any:
    """Return an entry that the schema has checked, or the schema's default with a note."""
    if key in node:
        return node.data[key]
    node.missing(key, f"{default} assumed")
    return default


def _rated_wind_speed(root: Node, power: float, radius: float, speed: float) -> float:
    """Return the lowest wind of ``outputs.cases`` at rated power, else that of the optimal tip-speed ratio [m/s]."""
    winds = []
    if "outputs.cases" in root:
        for case in root.at("outputs").items("cases"):
            if "integrated.electrical_power" in case and "configuration.wind_speed" in case:
                reached = case.at("integrated").number("electrical_power", -1e9, 1e9)
                if reached >= 0.999 * power:
                    winds.append(case.at("configuration").number("wind_speed", 0.0, 200.0))
    if winds:
        return min(winds)
    if "control.optimal_tsr" not in root:
        raise TurbineDefinitionError(
            "control.optimal_tsr: missing, and outputs.cases has no case at rated power; one of them must be there"
        )
    wind = speed * radius / root.at("control").number("optimal_tsr", 0.1, 50.0)
    root.notes.append(f"rated wind speed: not in the file, {wind:.2f} m/s is where rated speed has control.optimal_tsr")
    return wind


def _read_tower(root: Node) -> Tower:
    """Build the tower, clamped at the start of its reference axis."""
    node = root.at("components.tower")
    base, height = _heights(node.at("reference_axis"))
    shape = node.at("outer_shape")
    grid, diameter = shape.distribution("outer_diameter")
    cd = shape.distribution("cd")[1]
    if np.any(diameter <= 0.0):
        raise fail(shape.where("outer_diameter.values"), float(diameter.min()), "diameters above 0 m")
    if np.ptp(cd) > 1e-9:
        shape.note("cd", f"varies along the tower, its mean {cd.mean():g} is used")
    if "floating_platform" in root.at("components"):
        raise fail(
            "components.floating_platform", "a platform",
            "absent: windIO has no added mass, radiation damping and wave forces; load the turbine's OpenFAST model "
            "(.fst), or remove the section for a tower that is clamped at its base",
        )  # fmt: skip
    for support in ("monopile", "jacket"):
        if support in root.at("components"):
            how = "left out (load_turbine takes a water_depth)" if support == "monopile" else "not modeled"
            root.note(f"components.{support}", f"{how}, the tower is clamped at its base, {base:g} m up")
    length = height - base
    structure = node.at("structure", "a mapping with elastic_properties or layers")
    if "elastic_properties" in structure:
        elastic = structure.at("elastic_properties")
        with within(elastic.path):
            sections = _from_table(elastic, length, (grid, diameter))
        damping = damping_ratio(elastic, _DEFAULT_TOWER_DAMPING)
    else:
        sections = shell_sections(root, structure, length, (grid, diameter))
        damping = _DEFAULT_TOWER_DAMPING
        root.note(structure.path, f"no structural_damping, {100 * damping:g} % of critical assumed")
    with within(node.path):
        return Tower(base, height, grid * length, diameter, sections, damping, float(cd.mean()))


def _read_support(root: Node, tower: Tower, water_depth: float, foundation: Array | None) -> Support:
    """Build the monopile under a tower, from the sea bed up.

    Its sections are those of its walls where the file gives them, else of its table. What lies below the sea bed is
    left out: the ground holds the pile there, rigidly or by a foundation's stiffness. ``water_depth`` [m] comes from
    outside, because files of turbines do not say where the sea bed lies.
    """
    if "monopile" not in root.at("components"):
        raise fail("water_depth", water_depth, "None for a turbine whose file has no components.monopile")
    node = root.at("components.monopile")
    start, top = _heights(node.at("reference_axis"))
    if abs(top - tower.base_height) > 1e-3:
        allowed = f"a monopile that ends at the base of the tower, {tower.base_height:g} m up"
        raise fail(node.where("reference_axis.z"), top, allowed)
    allowed = f"depths from 0 to the {-start:g} m where the monopile begins"
    if not 0.0 <= check_number("water_depth", water_depth, 0.0, 500.0) <= -start:
        raise fail("water_depth", water_depth, allowed)
    length = top - start
    grid, diameter = node.at("outer_shape").distribution("outer_diameter")
    structure = node.at("structure", "a mapping with layers or elastic_properties")
    if "layers" in structure:
        whole = shell_sections(root, structure, length, (grid, diameter))
    else:
        elastic = structure.at("elastic_properties")
        with within(elastic.path):
            whole = _from_table(elastic, length, (grid, diameter))
    buried = -water_depth - start
    station = np.concatenate([[0.0], whole.station[whole.station > buried + 1e-6] - buried])
    wall = np.concatenate([[0.0], grid[grid * length > buried + 1e-6] * length - buried])
    mass = node.number("transition_piece_mass", 0.0, 1e8) if "transition_piece_mass" in node else 0.0
    root.note(node.path, f"stands on the sea bed {water_depth:g} m deep; its {buried:g} m below are left out")
    with within(node.path):
        return Support(
            -water_depth,
            wall,
            np.interp(wall + buried, grid * length, diameter),
            BeamStations(station, whole.stiffness_at(station + buried), whole.inertia_at(station + buried)),
            foundation,
            mass,
        )


def _heights(axis: Node) -> tuple[float, float]:
    grid_z, z = axis.distribution("z")
    length = float(z[-1] - z[0])
    if np.any(np.diff(z) <= 0.0) or np.any(np.abs(z - z[0] - grid_z * length) > 1e-3 * length):
        raise fail(axis.where("z"), z.tolist(), "heights that ascend in proportion to the grid")
    for key in ("x", "y"):
        require_straight(axis, axis.distribution(key)[1], length)
    return float(z[0]), float(z[-1])


def _from_table(node: Node, length: float, diameter: _Table) -> BeamStations:
    """Section properties from ``elastic_properties``; gaps are filled with those of a thin tube of that diameter."""
    grid, stiffness, tables = beam_tables(node, ("K44", "K55"))
    d = np.interp(grid, *diameter)
    bending = 0.5 * (stiffness[:, 3, 3] + stiffness[:, 4, 4])
    # A thin tube of diameter D: I = A D^2/8, J = 2 I, so that EA = 8 EI/D^2 and GJ = EI/(1 + nu).
    for key, k, value in (("K33", 2, 8.0 * bending / d**2), ("K66", 5, bending / (1.0 + POISSON_RATIO))):
        if not np.any(stiffness[:, k, k]):
            stiffness[:, k, k] = value
            node.missing(f"stiffness_matrix.{key}", "taken from K44, K55 as for a thin tube")
    ring = tables["mass"] * d**2 / 8.0
    if not np.any(tables["i_edge"]) or not np.any(tables["i_flap"]):
        tables["i_edge"], tables["i_flap"] = ring, ring
        node.note("inertia_matrix", "no section inertias, those of a thin tube are used")
    inertia = inertia_matrix(
        tables["mass"], tables["cm_x"], tables["cm_y"], tables["i_edge"], tables["i_flap"], tables["i_cp"]
    )
    return BeamStations(grid * length, stiffness, inertia)


def shell_sections(root: Node, structure: Node, length: float, diameter: _Table) -> BeamStations:
    """Return the section properties of a tower given as layers of isotropic walls.

    The first layer lies outside; each further one inside the one before. Euler-Bernoulli sections with area
    A = pi (ro^2 - ri^2), I = pi/4 (ro^4 - ri^4), J = 2 I. The outfitting factor multiplies mass and inertia.

    Parameters
    ----------
    structure : Node
        ``components.tower.structure``; the materials stand at the top level, ``root``.
    length : float
        [m].
    diameter : tuple of ndarray
        Grid (n,) and outer diameter (n,) [m].
    """
    layers = structure.items("layers")
    if not layers:
        raise fail(structure.where("layers"), [], "at least one wall")
    walls = [layer.distribution("thickness") for layer in layers]
    grid = np.unique(np.concatenate([diameter[0], *(wall[0] for wall in walls)]))
    outer = 0.5 * np.interp(grid, *diameter)
    axial, bending, torsion, mass, rotary = (np.zeros(grid.size) for _ in range(5))
    for layer, wall in zip(layers, walls, strict=True):
        inner = outer - np.interp(grid, *wall)
        if np.any(inner < 0.0) or np.any(inner > outer):
            raise fail(layer.where("thickness.values"), wall[1].tolist(), "thicknesses from 0 to the radius inside")
        young, shear, density = _material(root, layer)
        area = np.pi * (outer**2 - inner**2)
        second = 0.25 * np.pi * (outer**4 - inner**4)
        axial += young * area
        bending += young * second
        torsion += shear * 2.0 * second
        mass += density * area
        rotary += density * second
        outer = inner
    if np.any(mass <= 0.0):
        raise fail(structure.where("layers"), "a wall of no thickness", "walls along the whole tower")
    factor = structure.number("outfitting_factor", 1.0, 2.0) if "outfitting_factor" in structure else 1.0
    stiffness = shear_rigid_stiffness(axial, bending, bending, torsion)
    inertia = inertia_matrix(factor * mass, 0.0, 0.0, factor * rotary, factor * rotary, 0.0)
    return BeamStations(grid * length, stiffness, inertia)


def _material(root: Node, layer: Node) -> tuple[float, float, float]:
    """Return Young's modulus, shear modulus [Pa] and density [kg/m^3] of the isotropic material of a layer."""
    name = layer.text("material")
    materials = {node.data.get("name"): node for node in root.items("materials")}
    if name not in materials:
        raise fail(layer.where("material"), name, f"one of the materials: {', '.join(sorted(map(str, materials)))}")
    node = materials[name]
    if node.data.get("orth") != 0:
        raise fail(node.where("orth"), node.data.get("orth"), "0 (isotropic) for the wall of a tower")
    young = node.number("E", 1e6, 1e13)
    shear = node.number("G", 1e6, 1e13) if "G" in node else young / (2.0 * (1.0 + node.number("nu", -1.0, 0.5)))
    return young, shear, node.number("rho", 1.0, 20000.0)


_READ = {
    "fine_pitch": "fine pitch",
    "optimal_tsr": "tip-speed ratio",
    "region2_k": "torque gain of region 2",
    "gen_torque_kp": "torque gains",
    "gen_torque_ki": "torque gains",
    "constant_power": "constant power or torque",
    "pitch_kp": "pitch gains",
    "pitch_ki": "pitch gains",
    "lpf_frequency": "speed filter",
    "lpf_damping": "speed filter",
    "min_pitch_table": "least pitch over the wind",
    "pitch_actuator_frequency": "pitch actuator",
    "pitch_actuator_damping": "pitch actuator",
}
"""Keys that end up in `ControlData`, with the words for them."""
_ELSEWHERE = frozenset(
    {
        "max_gen_torque",
        "max_pitch_limit",
        "max_pitch_rate",
        "max_torque_rate",
        "min_pitch_limit",
        "min_rotor_speed",
        "rated_power",
        "rated_rotor_speed",
        "yaw_rate",
    }
)
"""Keys that the readers of drivetrain, nacelle and pitch system take."""


def _read_control(root: Node, gear_ratio: float) -> ControlData | None:
    """Read the numbers of the controller from ``control``; None for a file that says nothing about its controller.

    ``gear_ratio`` is the generator speed over the rotor speed.
    """
    node = root.at("control")
    values: dict[str, Any] = {}
    ignored = sorted(key for key in node.data if key not in _READ and key not in _ELSEWHERE)
    _numbers(node, gear_ratio, values)
    _pitch_gains(node, gear_ratio, values)
    if "min_pitch_table" in node:
        table = node.at("min_pitch_table")
        wind = table.array("wind_speed")
        values["min_pitch_wind"], values["min_pitch"] = wind, _DEGREE * table.array("min_pitch", wind.size)
    used = list(dict.fromkeys(words for key, words in _READ.items() if key in node))
    if used:
        root.note("control", f"the turbine's own controller has {', '.join(used)} from the file")
    if "pitch_actuator_frequency" in node:
        node.note(
            "pitch_actuator_frequency", "kept in Turbine.control only; the pitch drives of the simulation follow their "
            "demand at up to max_pitch_rate unless PitchSystem.servo_frequency is set",
        )  # fmt: skip
    if ignored:
        root.note("control", f"{', '.join(ignored)} not used")
    if not values:
        return None
    with within("control"):
        return ControlData(**values)


def _numbers(node: Node, gear_ratio: float, values: dict[str, Any]) -> None:
    """Read what is a single number; zero stands for what a file does not know."""
    torque_gain = 1.0 / (rpm * gear_ratio)
    for key, (name, power) in CONTROL_NUMBERS.items():
        if key in node and (value := node.number(key, 0.0, 1e12)) > 0.0:
            values[name] = torque_gain**power * value
    if "fine_pitch" in node:
        values["fine_pitch"] = node.number("fine_pitch", -90.0, 90.0, _DEGREE)
    if "constant_power" in node:
        values["constant_power"] = bool(node.number("constant_power", 0.0, 1.0))
    gains = {key: node.number(key, -1e12, 1e12) for key in ("gen_torque_kp", "gen_torque_ki") if key in node}
    if len(gains) == 2 and all(gains.values()):
        if gains["gen_torque_kp"] * gains["gen_torque_ki"] < 0.0:
            raise TurbineDefinitionError(
                f"{node.where('gen_torque_kp')}: {gains['gen_torque_kp']:g} and gen_torque_ki "
                f"{gains['gen_torque_ki']:g} must have the same sign"
            )
        values["torque_proportional_gain"] = torque_gain * abs(gains["gen_torque_kp"])
        values["torque_integral_gain"] = torque_gain * abs(gains["gen_torque_ki"])


def _pitch_gains(node: Node, gear_ratio: float, values: dict[str, Any]) -> None:
    """Read the gain schedules of the pitch controller, on one grid."""
    given = [key for key in ("pitch_kp", "pitch_ki") if key in node]
    if len(given) < 2:
        if given:
            node.note(given[0], "not used, since only one of pitch_kp and pitch_ki is in the file")
        return
    grids, gains = [], []
    for key, column in (("pitch_kp", "kp"), ("pitch_ki", "ki")):
        table = node.at(key)
        grids.append(_DEGREE * table.array("pitch_angle"))
        gains.append(table.array(column, grids[-1].size))
    if not (gains[0].any() and gains[1].any()):
        node.note("pitch_kp", "not used, all gains of pitch_kp or pitch_ki are zero")
        return
    # most files have the signs of ROSCO: more speed with a negative gain means more pitch
    sign = -1.0 if gains[1].sum() < 0.0 else 1.0
    scale = sign * _DEGREE / (rpm * gear_ratio)
    grid = grids[0] if np.array_equal(grids[0], grids[1]) else np.union1d(grids[0], grids[1])
    values["gain_pitch"] = grid
    values["pitch_proportional_gain"] = scale * np.interp(grid, grids[0], gains[0])
    values["pitch_integral_gain"] = scale * np.interp(grid, grids[1], gains[1])


_BESIDE = "the .control.json beside it"


def _own_constants(root: Node, control: ControlData | None, text: str) -> tuple[ControlData | None, dict[str, Any]]:
    """Return control data with the constants of a file ``NAME.control.json``, and its object ``turbine``."""
    try:
        content = json.loads(text)
    except ValueError as error:
        raise TurbineDefinitionError(f"{_BESIDE}: not JSON: {error}") from error
    if not isinstance(content, dict):
        raise TurbineDefinitionError(f"{_BESIDE}: must be a JSON object with the names of ControlData, got {content!r}")
    own, source = content.pop("turbine", {}), content.pop("source", None)
    if not isinstance(own, dict) or not own.keys() <= OWN_FIELDS.keys():
        raise TurbineDefinitionError(
            f"{_BESIDE}: turbine must be an object with keys among {sorted(OWN_FIELDS)}, got {own!r}"
        )
    known = {f.name for f in fields(ControlData)}
    values: dict[str, Any] = {}
    for key, value in content.items():
        plain = key.removesuffix("_deg")
        if plain not in known:
            raise TurbineDefinitionError(f"{_BESIDE}: keys must be among {', '.join(sorted(known))}; got {key!r}")
        try:
            values[plain] = np.radians(value) if key != plain else value
        except TypeError as error:
            raise TurbineDefinitionError(f"{_BESIDE}: {key} must be numbers, got {value!r}") from error
    if not values:
        return control, own
    with within(_BESIDE):
        data = replace(control or ControlData(), **values)
    root.note("control", f"published constants of the controller from {source or _BESIDE}")
    return data, own


def _with_own_fields(turbine: Turbine, own: dict[str, Any]) -> Turbine:
    """Return a turbine with values by the keys of `OWN_FIELDS`."""
    changes: dict[str, dict[str, Any]] = {}
    for key, value in own.items():
        part, _, name = key.rpartition(".")
        changes.setdefault(part, {})[name] = value
    with within(_BESIDE):
        parts = {part: replace(getattr(turbine, part), **values) for part, values in changes.items() if part}
        return replace(turbine, **changes.get("", {}), **parts) if own else turbine
