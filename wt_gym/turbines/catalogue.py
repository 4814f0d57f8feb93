"""Turbines by name, from a windIO file or from an OpenFAST model.

The turbine of Gebhardt, Preidikman, Jørgensen & Massa 2012: 45 m blades on a 68 m tower.

The paper gives the lengths, the degrees of freedom and two operating points; blade, masses and tower are stand-ins of
the same class. ``data/gebhardt45.json`` keeps published, inferred and stand-in values apart.

The small turbine of Nada & Al-Shahrani 2019: a rotor of half a meter on a copper rod in front of a wind generator.

The numbers of the paper are not legible in the copies at hand; the rig is a stand-in of the same kind, whose data
``data/nada_small.json`` keeps apart from what is published. The validation case ``mixed-coordinates`` uses the same
file.

The NREL 5-MW turbine on the monopile of the Offshore Code Comparison Collaboration (OC3).
"""

from __future__ import annotations

import importlib
import importlib.util
import json
from dataclasses import replace
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from wt_gym.base.errors import TurbineDefinitionError, did_you_mean
from wt_gym.turbine_records import RECORDS
from wt_gym.turbines.airfoil import Airfoil, Polar, cosine_grid
from wt_gym.turbines.blade import BeamStations, Blade, inertia_matrix, rotation_about_z
from wt_gym.turbines.checks import fail
from wt_gym.turbines.model import Drivetrain, Hub, Nacelle, PitchSystem, Support, Tower, Turbine
from wt_gym.turbines.windio import own_file, read_turbine

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from typing import Any

__all__ = [
    "GENERATOR_DAMPER", "catalogue", "gebhardt_data", "gebhardt_turbine", "load_turbine", "nada_data", "nada_speed",
    "plate_polar", "turbine_file",
]  # fmt: skip


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


ROOT_CHORD = 0.3
"""Chord of the lattice where the blade carries no lift [m]: the root strips of a lattice may be slender, not absent."""
GEBHARDT_MOST_TORQUE, GEBHARDT_TORQUE_RATE = 1.1, 0.348
"""Greatest torque of a generator with torque control and its rate [1/s], over the rated torque: those of the NREL 5-MW
(NREL/TP-500-38060, Table 7-2: 47.40 kN m and 15 kN m/s, rated 43.09 kN m). The paper's generator is a damper."""
ROOT_RAMP = 1.0
"""Half of the length over which the chord of the lattice rises where the lifting surface begins [m]."""


@cache
def gebhardt_data() -> dict[str, Any]:
    """Contents of ``data/gebhardt45.json``."""
    text = resources.files(__package__).joinpath("data", "gebhardt45.json").read_text(encoding="utf-8")
    out: dict[str, Any] = json.loads(text)
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
    blade, nacelle, tower = (
        _gebhardt_blade(data),
        _gebhardt_nacelle(data, nacelle_forward),
        _gebhardt_tower(data, tower_stiffness),
    )
    hub = data["hub"]
    slowest, fastest = (rpm * np.pi / 30.0 for rpm in data["rotor_speed_range_rpm"])
    tilt = np.radians(data["nacelle"]["tilt_deg"])
    return Turbine(
        name="Gebhardt et al. 2012, 45 m blades, 68 m tower (stand-in)",
        n_blades=gebhardt_data()["published"]["n_blades"],
        rotor_orientation="upwind",
        rotor_diameter=2.0 * (hub["radius_m"] + blade.length),
        hub_height=tower.height + nacelle.tower_top_to_shaft + nacelle.overhang * np.sin(tilt),
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
        drivetrain=Drivetrain(
            gear_ratio=1.0,
            gearbox_efficiency=1.0,
            generator_efficiency=1.0,
            generator_inertia=1.0,  # nothing beside the rotor's 1.2e7 kg m²; the paper's generator has none
            spring=1e10,
            damper=0.0,
            rated_power=data["rated_power_W"],
            rated_rotor_speed=fastest,
            min_rotor_speed=slowest,
            max_generator_torque=GEBHARDT_MOST_TORQUE * data["rated_power_W"] / fastest,
            max_torque_rate=GEBHARDT_TORQUE_RATE * data["rated_power_W"] / fastest,
            generator_damping=GENERATOR_DAMPER,
        ),
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
        structure=_blade_structure(beam),
        damping_ratio=0.0,
    )


def _blade_structure(beam: Mapping[str, NDArray[np.float64]]) -> BeamStations:
    """Section matrices from principal stiffnesses at the structural twist."""
    n = len(beam["span_m"])
    stiffness, zero = np.zeros((n, 6, 6)), np.zeros(n)
    stiffness[:, 0, 0] = stiffness[:, 1, 1] = np.inf
    turn = rotation_about_z(-np.radians(beam["struct_twist_deg"]))
    principal = np.zeros((n, 6, 6))
    for k, name in ((2, "EA_N"), (3, "EI_edge_Nm2"), (4, "EI_flap_Nm2"), (5, "GJ_Nm2")):
        principal[:, k, k] = beam[name]
    turned = turn @ principal @ np.swapaxes(turn, 1, 2)
    stiffness[:, 2:, 2:] = turned[:, 2:, 2:]
    mass, cg = beam["mass_kg_m"], beam["cg_edge_offset_m"]
    about_axis = beam["i_edge_kgm"] + mass * cg**2
    inertia = inertia_matrix(mass, zero, cg, about_axis, beam["i_flap_kgm"], zero)
    return BeamStations(beam["span_m"], stiffness, turn @ inertia @ np.swapaxes(turn, 1, 2))


def _gebhardt_tower(data: dict[str, Any], stiffness: float) -> Tower:
    """Straight prismatic undamped tube."""
    tower = data["tower"]
    height = gebhardt_data()["published"]["tower_height_m"]
    bending, inertia = stiffness * tower["EI_Nm2"], tower["section_inertia_kgm"]
    section = np.diag([np.inf, np.inf, tower["EA_N"], bending, bending, tower["GJ_Nm2"]])
    mass = inertia_matrix(tower["mass_kg_m"], 0.0, 0.0, inertia, inertia, 0.0)
    return Tower(
        base_height=0.0,
        height=height,
        diameter_station=np.array([0.0, height]),
        diameter=np.full(2, tower["outer_diameter_m"]),
        structure=BeamStations(np.array([0.0, height]), np.array([section] * 2), np.array([mass] * 2)),
        damping_ratio=0.0,
        drag_coefficient=0.0,  # the paper's air acts on the blades alone
    )


def _gebhardt_nacelle(data: dict[str, Any], forward: float | None) -> Nacelle:
    """Rigid nacelle in front of the tower, yaw held."""
    nacelle = data["nacelle"]
    yaw, roll = nacelle["inertia_yaw_kgm2"], nacelle["inertia_roll_kgm2"]
    downwind = gebhardt_data()["inferred"]["nacelle_cm_downwind_of_tower_m"] if forward is None else -forward
    return Nacelle(
        mass=nacelle["mass_kg"],
        cm=np.array([downwind, 0.0, nacelle["cm_above_tower_top_m"]]),
        inertia=np.diag([roll, yaw, yaw]),
        tilt=np.radians(nacelle["tilt_deg"]),
        overhang=nacelle["overhang_m"],
        tower_top_to_shaft=nacelle["shaft_above_tower_top_m"],
        yaw_bearing_mass=0.0,
        yaw_spring=1e10,
        yaw_damper=0.0,
        max_yaw_rate=0.0,
    )


STATIONS = 9
"""Stations along a blade, between which planform and sections are interpolated."""
NADA_MOST_TORQUE, NADA_TORQUE_RATE = 1.5, 10.0
"""Greatest torque of the generator and its rate [1/s], over the rated torque."""
HELD = 1e10
"""Stiffness of a shaft and a yaw bearing that do not yield [N m/rad]."""


@cache
def nada_data() -> dict[str, Any]:
    """Contents of ``data/nada_small.json``."""
    text = resources.files(__package__).joinpath("data", "nada_small.json").read_text(encoding="utf-8")
    out: dict[str, Any] = json.loads(text)
    return out


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
    torque = damping * speed
    blade, hub, tower = _nada_blade(data), data["hub"], _nada_tower(data["tower"])
    hub_inertia = 0.5 * hub["mass_kg"] * hub["radius_m"] ** 2
    rotor_mass = hub["mass_kg"] + data["blade"]["number"] * _mass(blade.structure)
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
        nacelle=_nada_nacelle(data, data["nacelle_rotor_mass_kg"] - rotor_mass),
        drivetrain=Drivetrain(
            gear_ratio=1.0,
            gearbox_efficiency=1.0,
            generator_efficiency=1.0,
            generator_inertia=data["generator_inertia_kgm2"],
            spring=HELD,
            damper=0.0,
            rated_power=torque * speed,
            rated_rotor_speed=speed,
            min_rotor_speed=0.4 * speed,
            max_generator_torque=NADA_MOST_TORQUE * torque,
            max_torque_rate=NADA_TORQUE_RATE * torque,
            generator_damping=damping,
        ),
        pitch=PitchSystem(min_pitch=low, max_pitch=high, max_rate=np.radians(data["pitch_rate_deg_s"])),
        iec_class="III",
        turbulence_class="C",
        notes=("all dimensions are stand-ins, see data/nada_small.json",),
    )


def _mass(structure: BeamStations) -> float:
    """Mass of a beam whose properties are linear between its stations [kg]."""
    return float(np.trapezoid(structure.inertia[:, 0, 0], structure.station))


def _nada_blade(data: dict[str, Any]) -> Blade:
    """A tapered, twisted strip of plastic, straight along its mid-chord."""
    blade, root = data["blade"], data["hub"]["radius_m"]
    length, t = blade["tip_radius_m"] - root, blade["thickness_m"]
    z = np.linspace(0.0, length, STATIONS)
    chord = np.interp(z, [0.0, length], [blade["chord_root_m"], blade["chord_tip_m"]])
    twist = np.radians(np.interp(z, [0.0, length], [blade["twist_root_deg"], blade["twist_tip_deg"]]))
    section, x = data["section"], cosine_grid(41)
    stall, width = np.radians([section["stall_deg"], section["stall_width_deg"]])
    polar = plate_polar(stall, width, section["friction_coefficient"])
    thickness = t / (0.5 * (chord[0] + chord[-1]))
    height = thickness * np.sqrt(x * (1.0 - x))
    contour = np.vstack((np.column_stack((x, height))[::-1], np.column_stack((x, -height))[1:]))
    plate = Airfoil("thin plate", thickness, contour, np.array([0.0, 0.5, 1.0]), np.zeros(3), polar)
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
        structure=_strip(z, chord, twist, t, blade["youngs_modulus_Pa"], blade["density_kg_m3"]),
        damping_ratio=blade["damping_ratio"],
    )


def _strip(
    z: NDArray[np.float64], chord: NDArray[np.float64], twist: NDArray[np.float64], t: float, e: float, rho: float
) -> BeamStations:
    """Sections of a solid strip: E c t³/12 across its flat side, E t c³/12 along it, torsion G c t³/3."""
    area, flat, edge = chord * t, chord * t**3 / 12.0, t * chord**3 / 12.0
    stiffness, zero = np.zeros((len(z), 6, 6)), np.zeros(len(z))
    for k, value in ((2, e * area), (3, e * edge), (4, e * flat), (5, e / 2.6 * chord * t**3 / 3.0)):
        stiffness[:, k, k] = value
    turn = rotation_about_z(-twist)
    stiffness = turn @ stiffness @ np.swapaxes(turn, 1, 2)
    stiffness[:, 0, 0] = stiffness[:, 1, 1] = np.inf
    inertia = inertia_matrix(rho * area, zero, zero, rho * edge, rho * flat, zero)
    return BeamStations(z, stiffness, turn @ inertia @ np.swapaxes(turn, 1, 2))


def _nada_tower(tower: dict[str, Any]) -> Tower:
    """Solid rod of circular section."""
    height, d, rho = tower["length_m"], tower["diameter_m"], tower["density_kg_m3"]
    area, second = 0.25 * np.pi * d**2, np.pi * d**4 / 64.0
    bending = tower["youngs_modulus_Pa"] * second
    section = np.diag([np.inf, np.inf, tower["youngs_modulus_Pa"] * area, bending, bending,
                       tower["shear_modulus_Pa"] * 2.0 * second])  # fmt: skip
    mass = inertia_matrix(rho * area, 0.0, 0.0, rho * second, rho * second, 0.0)
    ends = np.array([0.0, height])
    return Tower(
        base_height=0.0,
        height=height,
        diameter_station=ends,
        diameter=np.full(2, d),
        structure=BeamStations(ends, np.array([section] * 2), np.array([mass] * 2)),
        damping_ratio=tower["damping_ratio"],
        drag_coefficient=0.0,
    )


def _nada_nacelle(data: dict[str, Any], mass: float) -> Nacelle:
    """Rigid body on the tower top, yaw held."""
    return Nacelle(
        mass=mass,
        cm=np.zeros(3),
        inertia=mass * data["nacelle_radius_of_gyration_m"] ** 2 * np.eye(3),
        tilt=0.0,
        overhang=data["hub"]["overhang_m"],
        tower_top_to_shaft=0.0,
        yaw_bearing_mass=0.0,
        yaw_spring=HELD,
        yaw_damper=0.0,
        max_yaw_rate=0.0,
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


def tube(station: NDArray[np.float64], diameter: NDArray[np.float64], wall: NDArray[np.float64]) -> BeamStations:
    """Sections of a steel tube at stations (n,) [m] with diameters and walls (n,) [m]."""
    outer, inner = 0.5 * diameter, 0.5 * diameter - wall
    area, second = np.pi * (outer**2 - inner**2), 0.25 * np.pi * (outer**4 - inner**4)
    stiffness = np.zeros((len(station), 6, 6))
    rigid = np.full(len(station), np.inf)
    for k, value in enumerate((rigid, rigid, YOUNG * area, YOUNG * second, YOUNG * second, SHEAR * 2.0 * second)):
        stiffness[:, k, k] = value
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
