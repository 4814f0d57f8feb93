"""Turbines by name, from a windIO file or from an OpenFAST model, and those that no file describes.

- Gebhardt, Preidikman, Jørgensen & Massa 2012, 45 m blades on a 68 m tower: the paper gives the lengths, the degrees of
  freedom and two operating points; blade, masses and tower are stand-ins of the same class. ``data/gebhardt45.json``
  keeps published, inferred and stand-in values apart.
- Nada & Al-Shahrani 2019, a rotor of half a meter on a copper rod in front of a wind generator: the numbers of the
  paper are not legible in the copies at hand; the rig is a stand-in of the same kind, whose data
  ``data/nada_small.json`` keeps apart from what is published. The validation case ``mixed-coordinates`` uses the same
  file.
- The NREL 5-MW turbine on the monopile of the Offshore Code Comparison Collaboration (OC3).
"""

import importlib
import importlib.util
import json
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from wt_gym.base.errors import TurbineDefinitionError, did_you_mean
from wt_gym.base.quantities import Array
from wt_gym.turbine_records import RECORDS
from wt_gym.turbines.airfoil import Airfoil, Polar, contour_of, cosine_grid
from wt_gym.turbines.blade import BeamStations, Blade, inertia_matrix, rotation_about_z, shear_rigid_stiffness
from wt_gym.turbines.checks import fail
from wt_gym.turbines.model import Drivetrain, Hub, Nacelle, PitchSystem, Support, Tower, Turbine
from wt_gym.turbines.windio import own_file, read_turbine
from wt_gym.turbines.windio_file import within


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
    """Whether a windIO file describes a turbine of the catalog."""
    return bool(RECORDS[name].source.keys() & {"file", "windio_example"})


def catalog() -> tuple[str, ...]:
    """Return the names that ``load_turbine`` knows."""
    return tuple(RECORDS)


def load_turbine(
    name_or_path: str | Path,
    water_depth: float | None = None,
    foundation: Array | None = None,
    rotation: str | None = None,
) -> Turbine:
    """Load a turbine of the catalog, any windIO file (version 2 or 1) or any OpenFAST model.

    Parameters
    ----------
    name_or_path : str or Path
        A name of ``catalog()``, the path of a YAML file, or that of the primary file of an OpenFAST model (``.fst``,
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
    if foundation is not None and water_depth is None:
        raise fail("foundation", "a stiffness", "None without a water_depth")
    built = isinstance(name_or_path, str) and name_or_path in RECORDS and not _has_file(name_or_path)
    path = None if built else turbine_file(name_or_path)
    openfast = path is not None and path.suffix.lower() == ".fst"
    if water_depth is not None and (built or openfast):
        what = "an OpenFAST model, whose substructure is left aside"
        what = f"{name_or_path!r}, which no windIO file describes" if built else what
        raise fail("water_depth", water_depth, f"None for {what}")
    if path is None:
        turbine = _built(str(name_or_path))
    elif openfast:
        from wt_gym.turbines.openfast import read_openfast  # which most users never need

        with within(str(path)):
            turbine = read_openfast(path)
    else:
        turbine = read_turbine(path, water_depth, foundation)
    return turbine if rotation is None or rotation == turbine.rotation else replace(turbine, rotation=rotation)


def turbine_file(name_or_path: str | Path) -> Path:
    """Return the path of the file behind a name of the catalog, or the given path if it is a file."""
    if isinstance(name_or_path, str) and name_or_path in RECORDS:
        source = RECORDS[name_or_path].source
        if not _has_file(name_or_path):
            with_file = ", ".join(repr(name) for name in RECORDS if _has_file(name))
            raise TurbineDefinitionError(
                f"turbine {name_or_path!r} has no windIO file, the package builds it: load_turbine({name_or_path!r}); "
                f"with a file are {with_file}"
            )
        if "file" in source:
            return own_file(str(source["file"]))
        # Found without importing windIO, which is slow and, for a file read before, not needed.
        spec = importlib.util.find_spec("windIO")
        if spec is None or spec.origin is None:
            raise TurbineDefinitionError("the package windIO is not installed: pip install windIO")
        return Path(spec.origin).parent / "examples" / "turbine" / str(source["windio_example"])
    allowed = f"one of {', '.join(map(repr, catalog()))} or the path of a windIO file or OpenFAST model (.fst)"
    if not isinstance(name_or_path, (str, Path)):
        raise fail("turbine", name_or_path, allowed)
    path = Path(name_or_path).expanduser()
    if path.is_dir():
        raise fail("turbine", str(name_or_path), f"{allowed} (this is a folder)")
    if not path.is_file():
        raise fail(
            "turbine", str(name_or_path), f"{allowed} (there is no such file){did_you_mean(name_or_path, catalog())}"
        )
    return path


HELD = 1e10
"""Stiffness of a shaft and a yaw bearing that do not yield [N m/rad]."""
ROOT_CHORD = 0.3
"""Chord of the lattice where the blade carries no lift [m]: the root strips of a lattice may be slender, not absent."""
GEBHARDT_TORQUE = 1.1, 0.348
"""Greatest torque of a generator with torque control and its rate [1/s], over the rated torque: those of the NREL 5-MW
(NREL/TP-500-38060, Table 7-2: 47.40 kN m and 15 kN m/s, rated 43.09 kN m). The paper's generator is a damper."""
ROOT_RAMP = 1.0
"""Half of the length over which the chord of the lattice rises where the lifting surface begins [m]."""


@cache
def gebhardt_data() -> dict[str, Any]:
    """Contents of ``data/gebhardt45.json``."""
    return _data("gebhardt45.json")


def _data(name: str) -> dict[str, Any]:
    out: dict[str, Any] = json.loads(own_file(name).read_text(encoding="utf-8"))
    return out


GENERATOR_DAMPER = gebhardt_data()["inferred"]["generator_damper_Nms"]
"""Generator torque on the rotor side divided by the rotor speed [N m s]."""


@cache
def gebhardt_turbine(tower_stiffness: float = 1.0, nacelle_forward: float | None = None) -> Turbine:
    """The stand-in turbine, undamped like the paper's, with a generator that turns with the rotor.

    Parameters
    ----------
    tower_stiffness : float
        Factor on the bending stiffness of the tower.
    nacelle_forward : float, optional
        Distance of the nacelle's center of mass upwind of the tower [m]; by default the inferred one.

    Returns
    -------
    Turbine
        Its gear ratio is 1: generator torque and speed are those of the rotor side, as in the paper.
    """
    data = gebhardt_data()["stand_in"]
    hub, part, tube, power = data["hub"], data["nacelle"], data["tower"], data["rated_power_W"]
    forward = nacelle_forward
    downwind = gebhardt_data()["inferred"]["nacelle_cm_downwind_of_tower_m"] if forward is None else -forward
    roll, yaw = part["inertia_roll_kgm2"], part["inertia_yaw_kgm2"]
    blade = _gebhardt_blade(data)
    nacelle = replace(
        _nacelle(part["mass_kg"], np.diag([roll, yaw, yaw]), part["overhang_m"]),
        cm=np.array([downwind, 0.0, part["cm_above_tower_top_m"]]),
        tilt=np.radians(part["tilt_deg"]),
        tower_top_to_shaft=part["shaft_above_tower_top_m"],
    )
    bending, inertia = tower_stiffness * tube["EI_Nm2"], tube["section_inertia_kgm"]
    tower = _tower(
        gebhardt_data()["published"]["tower_height_m"],
        tube["outer_diameter_m"],
        shear_rigid_stiffness(tube["EA_N"], bending, bending, tube["GJ_Nm2"]),
        inertia_matrix(tube["mass_kg_m"], 0.0, 0.0, inertia, inertia, 0.0),
    )
    slowest, fastest = (rpm * np.pi / 30.0 for rpm in data["rotor_speed_range_rpm"])
    return Turbine(
        name="Gebhardt et al. 2012, 45 m blades, 68 m tower (stand-in)",
        n_blades=gebhardt_data()["published"]["n_blades"],
        rotor_orientation="upwind",
        rotor_diameter=2.0 * (hub["radius_m"] + blade.length),
        hub_height=tower.height + nacelle.tower_top_to_shaft + nacelle.overhang * np.sin(nacelle.tilt),
        rated_wind_speed=12.0,
        cut_in=3.0,
        cut_out=25.0,
        air_density=data["air_density_kg_m3"],
        blade=blade,
        tower=tower,
        hub=Hub(
            radius=hub["radius_m"],
            cone=np.radians(hub["precone_deg"]),
            mass=hub["mass_kg"],
            inertia_axial=hub["inertia_about_shaft_kgm2"],
            inertia_transverse=hub["inertia_about_shaft_kgm2"],
            cm_offset_along_shaft=0.0,
        ),
        nacelle=nacelle,
        # nothing beside the rotor's 1.2e7 kg m²; the paper's generator has no inertia
        drivetrain=_direct_drive(1.0, power, slowest, fastest, GEBHARDT_TORQUE, GENERATOR_DAMPER),
        pitch=PitchSystem(min_pitch=np.radians(-20.0), max_pitch=np.radians(90.0), max_rate=np.radians(10.0)),
        iec_class="II",
        turbulence_class="B",
        notes=("blade, masses, tower section and drivetrain are stand-ins, see data/gebhardt45.json",),
    )


def _columns(table: Sequence[Sequence[Any]], names: Sequence[str]) -> dict[str, list[Any]]:
    """Columns of a table of rows by name."""
    return {name: [row[i] for row in table] for i, name in enumerate(names)}


def _gebhardt_blade(data: dict[str, Any]) -> Blade:
    """Planform and sections of the stand-in blade; the round root carries no lift."""
    blade = data["blade"]
    plan = _columns(blade["planform"], blade["planform_columns"])
    beam = {k: np.array(v) for k, v in _columns(blade["structure"], blade["structure_columns"]).items()}
    length = blade["length_m"]
    start, span = blade["lifting_surface_from_m"], np.array(plan["span_m"])
    # lattice: slender root, a ramp centered on the begin of the lifting surface, the published planform outboard
    first, last = start - ROOT_RAMP, start + ROOT_RAMP
    outboard = span > last
    station = np.concatenate(([0.0, first, last], span[outboard]))
    chord = np.interp(station, span, plan["chord_m"])
    chord[:2] = ROOT_CHORD
    donor = read_turbine(own_file("nrel_5mw.yaml")).blade
    known = {a.name: a for a in donor.airfoils}
    lifting = [(z, name) for z, name in zip(span, plan["airfoil"], strict=True) if not name.startswith("Cylinder")]
    mass, cg, zero = beam["mass_kg_m"], beam["cg_edge_offset_m"], np.zeros(len(beam["span_m"]))
    inertia = inertia_matrix(mass, zero, cg, beam["i_edge_kgm"] + mass * cg**2, beam["i_flap_kgm"], zero)
    stiffness = [beam[name] for name in ("EA_N", "EI_edge_Nm2", "EI_flap_Nm2", "GJ_Nm2")]
    # a new section begins where its name first appears; between two such stations the sections are blended
    names = list(dict.fromkeys(name for _, name in lifting))
    begins = [next(z for z, name in lifting if name == own) for own in names]
    return Blade(
        length=length,
        root_radius=data["hub"]["radius_m"],
        axis_station=np.array([0.0, length]),
        axis=np.array([[0.0, 0.0, 0.0], [0.0, 0.0, length]]),
        aero_station=station,
        chord=chord,
        twist=np.radians(np.interp(station, span, plan["twist_deg"])),
        le_offset=np.interp(station, beam["span_m"], beam["pitch_axis_xc"]),
        airfoils=tuple(known[name] for name in names),
        airfoil_station=np.array(begins),
        airfoil_index=np.arange(len(names)),
        rotating_polars=donor.rotating_polars,
        structure=_turned_sections(beam["span_m"], np.radians(beam["struct_twist_deg"]), stiffness, inertia),
        damping_ratio=0.0,
    )


def _turned_sections(station: Array, twist: Array, stiffness: Sequence[Any], inertia: Array) -> BeamStations:
    """Sections from principal stiffnesses (axial, edge, flap, torsion) and inertias at the structural twist."""
    turn = rotation_about_z(-twist)
    principal = np.zeros((len(station), 6, 6))
    for k, value in enumerate(stiffness, start=2):
        principal[:, k, k] = value
    turned = turn @ principal @ np.swapaxes(turn, 1, 2)
    turned[:, 0, 0] = turned[:, 1, 1] = np.inf
    return BeamStations(station, turned, turn @ inertia @ np.swapaxes(turn, 1, 2))


def _tower(height: float, diameter: float, stiffness: Array, inertia: Array, damping: float = 0.0) -> Tower:
    """Straight prismatic tower of sections (6, 6), on which no air acts."""
    ends = np.array([0.0, height])
    sections = BeamStations(ends, np.array([stiffness] * 2), np.array([inertia] * 2))
    return Tower(0.0, height, ends, np.full(2, diameter), sections, damping, drag_coefficient=0.0)


def _nacelle(mass: float, inertia: Array, overhang: float) -> Nacelle:
    """Rigid body on the tower top, yaw held."""
    return Nacelle(
        mass=mass,
        cm=np.zeros(3),
        inertia=inertia,
        tilt=0.0,
        overhang=overhang,
        tower_top_to_shaft=0.0,
        yaw_bearing_mass=0.0,
        yaw_spring=HELD,
        yaw_damper=0.0,
        max_yaw_rate=0.0,
    )


def _direct_drive(
    inertia: float, power: float, slowest: float, fastest: float, limits: tuple[float, float], damping: float
) -> Drivetrain:
    """Stiff shaft, generator without losses; ``limits`` of torque [-] and its rate [1/s] over the rated torque."""
    most, rate = limits
    return Drivetrain(
        gear_ratio=1.0,
        gearbox_efficiency=1.0,
        generator_efficiency=1.0,
        generator_inertia=inertia,
        spring=HELD,
        damper=0.0,
        rated_power=power,
        rated_rotor_speed=fastest,
        min_rotor_speed=slowest,
        max_generator_torque=most * power / fastest,
        max_torque_rate=rate * power / fastest,
        generator_damping=damping,
    )


STATIONS = 9
"""Stations along a blade, between which planform and sections are interpolated."""
NADA_TORQUE = 1.5, 10.0
"""Greatest torque of the generator and its rate [1/s], over the rated torque."""


@cache
def nada_data() -> dict[str, Any]:
    """Contents of ``data/nada_small.json``."""
    return _data("nada_small.json")


def nada_speed() -> float:
    """Rotor speed of the rig in the test wind [rad/s]: that of the stand-in tip-speed ratio."""
    data = nada_data()
    return float(
        data["stand_in"]["tip_speed_ratio"]
        * data["published"]["test_wind_speed_m_s"]
        / data["stand_in"]["blade"]["tip_radius_m"]
    )


def plate_polar(stall: float, width: float, friction: float, n: int = 361) -> Polar:
    """Polar of a thin plate with sharp edges over the full circle.

    The force is normal to the plate except for friction: attached flow has the circulation of thin-airfoil theory and
    no suction at the leading edge, c_n = 2 π sin α; separated flow c_n = 1/(0.222 + 0.283/sin α) (Hoerner 1965);
    between them the share of attached flow falls as 1/(1 + exp((α − stall)/width)). The force acts at a quarter of the
    chord from the edge that leads, and at half of it across the wind.

    Parameters
    ----------
    stall, width : float
        [rad].
    friction : float
        Coefficient of the force along the plate.
    """
    alpha = np.linspace(-np.pi, np.pi, n)
    alpha[n // 2] = 0.0
    sine = np.abs(np.sin(alpha))
    from_edge = np.arcsin(np.minimum(sine, 1.0))
    attached = 1.0 / (1.0 + np.exp((from_edge - stall) / width))
    separated = np.divide(sine, 0.222 * sine + 0.283)
    normal = np.sign(np.sin(alpha)) * (attached * 2.0 * np.pi * sine + (1.0 - attached) * separated)
    normal[[0, n // 2, -1]] = 0.0
    along = friction * np.cos(alpha)
    behind = 0.25 * (1.0 - attached) * from_edge / (0.5 * np.pi)  # of the pressure behind the quarter of the chord
    center = np.where(np.cos(alpha) >= 0.0, behind, 0.5 - behind)
    return Polar(
        alpha=alpha,
        cl=normal * np.cos(alpha) - along * np.sin(alpha),
        cd=normal * np.sin(alpha) + along * np.cos(alpha),
        cm=-normal * center,
    )


@cache
def nada_turbine() -> Turbine:
    """The stand-in rig, with a generator that turns with the rotor and is a damper or takes a torque.

    Returns
    -------
    Turbine
        Its gear ratio is 1. Rated is the test: 8 m/s and the speed of :func:`nada_speed`, at which the damper balances
        the air. The rig's blades do not pitch; a small drive is added for control.
    """
    data, wind = nada_data()["stand_in"], nada_data()["published"]["test_wind_speed_m_s"]
    speed, damping = nada_speed(), data["generator_damper_Nms"]
    blade, hub, rod = _nada_blade(data), data["hub"], data["tower"]
    d, rho, young = rod["diameter_m"], rod["density_kg_m3"], rod["youngs_modulus_Pa"]
    area, second = 0.25 * np.pi * d**2, np.pi * d**4 / 64.0
    tower = _tower(
        rod["length_m"],
        d,
        shear_rigid_stiffness(young * area, young * second, young * second, rod["shear_modulus_Pa"] * 2.0 * second),
        inertia_matrix(rho * area, 0.0, 0.0, rho * second, rho * second, 0.0),
        rod["damping_ratio"],
    )
    hub_inertia = 0.5 * hub["mass_kg"] * hub["radius_m"] ** 2
    blade_mass = float(np.trapezoid(blade.structure.inertia[:, 0, 0], blade.structure.station))
    nacelle_mass = data["nacelle_rotor_mass_kg"] - (hub["mass_kg"] + data["blade"]["number"] * blade_mass)
    inertia = nacelle_mass * data["nacelle_radius_of_gyration_m"] ** 2 * np.eye(3)
    low, high = np.radians(data["pitch_range_deg"])
    return Turbine(
        name="Nada & Al-Shahrani 2019, small turbine on a copper rod (stand-in)",
        n_blades=data["blade"]["number"],
        rotor_orientation="upwind",
        rotor_diameter=2.0 * data["blade"]["tip_radius_m"],
        hub_height=tower.height,
        rated_wind_speed=wind,
        cut_in=data["wind_range_m_s"][0],
        cut_out=data["wind_range_m_s"][1],
        air_density=data["air_density_kg_m3"],
        blade=blade,
        tower=tower,
        hub=Hub(
            radius=hub["radius_m"],
            cone=0.0,
            mass=hub["mass_kg"],
            inertia_axial=hub_inertia,
            inertia_transverse=0.5 * hub_inertia,
            cm_offset_along_shaft=0.0,
        ),
        nacelle=_nacelle(nacelle_mass, inertia, hub["overhang_m"]),
        drivetrain=_direct_drive(
            data["generator_inertia_kgm2"], damping * speed * speed, 0.4 * speed, speed, NADA_TORQUE, damping
        ),
        pitch=PitchSystem(min_pitch=low, max_pitch=high, max_rate=np.radians(data["pitch_rate_deg_s"])),
        iec_class="III",
        turbulence_class="C",
        notes=("all dimensions are stand-ins, see data/nada_small.json",),
    )


def _nada_blade(data: dict[str, Any]) -> Blade:
    """A tapered, twisted strip of plastic, straight along its mid-chord."""
    blade, root = data["blade"], data["hub"]["radius_m"]
    length, t = blade["tip_radius_m"] - root, blade["thickness_m"]
    z = np.linspace(0.0, length, STATIONS)
    chord = np.interp(z, [0.0, length], [blade["chord_root_m"], blade["chord_tip_m"]])
    twist = np.radians(np.interp(z, [0.0, length], [blade["twist_root_deg"], blade["twist_tip_deg"]]))
    section, x = data["section"], cosine_grid(41)
    stall, width = np.radians([section["stall_deg"], section["stall_width_deg"]])
    # a solid strip: E c t³/12 across its flat side, E t c³/12 along it, torsion G c t³/3
    e, rho = blade["youngs_modulus_Pa"], blade["density_kg_m3"]
    area, flat, edge, zero = chord * t, chord * t**3 / 12.0, t * chord**3 / 12.0, np.zeros(STATIONS)
    inertia = inertia_matrix(rho * area, zero, zero, rho * edge, rho * flat, zero)
    stiffness = e * area, e * edge, e * flat, e / 2.6 * chord * t**3 / 3.0
    polar = plate_polar(stall, width, section["friction_coefficient"])
    thickness = t / (0.5 * (chord[0] + chord[-1]))
    height = thickness * np.sqrt(x * (1.0 - x))
    plate = Airfoil(
        "thin plate", thickness, contour_of(x, height, -height), np.array([0.0, 0.5, 1.0]), np.zeros(3), polar
    )
    return Blade(
        length=length,
        root_radius=root,
        axis_station=np.array([0.0, length]),
        axis=np.array([[0.0, 0.0, 0.0], [0.0, 0.0, length]]),
        aero_station=z,
        chord=chord,
        twist=twist,
        le_offset=np.full(STATIONS, 0.5),
        airfoils=(plate,),
        airfoil_station=np.array([0.0]),
        airfoil_index=np.array([0]),
        rotating_polars=False,
        structure=_turned_sections(z, twist, stiffness, inertia),
        damping_ratio=blade["damping_ratio"],
    )


NAME = "NREL 5-MW baseline, OC3 monopile"
WATER_DEPTH, TOWER_BASE = 20.0, 10.0
"""Depth of the sea bed and height of the transition from monopile to tower [m]."""
PILE_DIAMETER, PILE_WALL = 6.0, 0.060
"""[m]"""
TOWER_DIAMETERS, TOWER_WALLS = (6.0, 3.87), (0.027, 0.019)
"""At base and top [m], linear between."""
YOUNG, SHEAR, DENSITY = 210e9, 80.8e9, 8500.0
"""Of steel [Pa, Pa, kg/m^3], paint, bolts, welds and flanges in the density."""

_KH, _KC, _KM = 2.57481e9, -2.25325e10, 2.62912e11
OC3_FOUNDATION = np.diag([_KH, _KH, 1e11, _KM, _KM, 1e13])
"""Stiffness of the soil at the sea bed, 36 m of pile in layered sand ("coupled springs" of P. Passon, Memorandum:
derivation and description of the soil-pile-interaction models, 2006): published are K_h [N/m], K_hm [N] and K_m [N m].
Settlement and twist, published as rigid, are stiff springs here."""
OC3_FOUNDATION[0, 4] = OC3_FOUNDATION[4, 0] = _KC
OC3_FOUNDATION[1, 3] = OC3_FOUNDATION[3, 1] = -_KC
OC3_FOUNDATION.flags.writeable = False


def tube(station: Array, diameter: Array, wall: Array) -> BeamStations:
    """Sections of a steel tube at stations (n,) [m] with diameters and walls (n,) [m]."""
    outer, inner = 0.5 * diameter, 0.5 * diameter - wall
    area, second = np.pi * (outer**2 - inner**2), 0.25 * np.pi * (outer**4 - inner**4)
    stiffness = shear_rigid_stiffness(YOUNG * area, YOUNG * second, YOUNG * second, SHEAR * 2.0 * second)
    mass, rotary = DENSITY * area, DENSITY * second
    return BeamStations(station, stiffness, inertia_matrix(mass, 0.0, 0.0, rotary, rotary, 0.0))


@cache
def oc3_turbine() -> Turbine:
    """Rotor and nacelle of ``"nrel_5mw"`` on the OC3 monopile: J. Jonkman & W. Musial, NREL/TP-5000-48191, 2010.

    Returns
    -------
    Turbine
        On the published soil springs; ``replace`` its ``tower.support`` for a rigid foundation.
    """
    land = read_turbine(own_file("nrel_5mw.yaml"))
    length = land.tower.height - TOWER_BASE
    station = np.linspace(0.0, length, 21)  # section properties are powers of the linear diameter
    along = station / length
    diameter, wall = (a + (b - a) * along for a, b in (TOWER_DIAMETERS, TOWER_WALLS))
    depth = np.array([0.0, TOWER_BASE + WATER_DEPTH])
    across = np.full(2, PILE_DIAMETER)
    support = Support(-WATER_DEPTH, depth, across, tube(depth, across, np.full(2, PILE_WALL)), OC3_FOUNDATION)
    tower = Tower(
        TOWER_BASE,
        land.tower.height,
        station,
        diameter,
        tube(station, diameter, wall),
        land.tower.damping_ratio,
        land.tower.drag_coefficient,
        support,
    )
    note = (
        "tower and monopile of OC3, phase II (coupled springs); settlement and twist of the pile are stiff, not rigid"
    )
    return replace(land, name=NAME, tower=tower, notes=(*land.notes, note))
