"""Blade and tower of an OpenFAST model: AeroDyn planform and polars, ElastoDyn or BeamDyn section properties.

AeroDyn's and BeamDyn's blade frames are the one used here: z from root to tip, x to the suction side (downwind), y to
the trailing edge; their twist is positive to feather. AeroDyn gives the place of each section's reference point
(BlCrvAC, BlSwpAC), which lies on the chord line; the file of the airfoil's coordinates says how far behind its nose.
"""

import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.interpolate import PchipInterpolator

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.base.quantities import Array, Integers
from wt_gym.turbines.airfoil import Airfoil, Polar, blend_polars, camber_line, contour_of, cosine_grid, suction_first
from wt_gym.turbines.blade import BeamStations, Blade, inertia_matrix, shear_rigid_stiffness, turned
from wt_gym.turbines.checks import check_array, check_number, fail
from wt_gym.turbines.model import Tower
from wt_gym.turbines.openfast_text import Model, TextFile, as_number, existing_file
from wt_gym.turbines.windio import POISSON_RATIO
from wt_gym.turbines.windio_blade import DEFAULT_BLADE_DAMPING, KINEMATIC_VISCOSITY, arc_length
from wt_gym.turbines.windio_file import within

STRUCTURES = ("elastodyn", "beamdyn")
"""Modules with the structure of the blade, as CompElast (1, 2) counts them."""
_SAME_LENGTH = 0.01
"""Part of the length by which AeroDyn's and BeamDyn's blades may differ from ElastoDyn's; they are stretched to it."""
_STRAIGHT = 1e-4  # Prebend that is rounding of BlCrvAC and BlSwpAC, in blade lengths
_SWITCH = 1e-4  # Length of the change from one airfoil to the next where they are not blended, in blade lengths
_FULL_SET = 0.75  # Airfoils a node from which on they are those of the nodes, between which sections are blended
_QUARTER_CHORD = 0.25
_THICKNESS_GUESS = 0.18  # Relative thickness of a lifting section whose coordinates and thickness are unknown
_THICK = 0.5  # Relative thickness from which on a section is rather a cylinder, with its reference point in the middle
_REFERENCES = (0.1, 0.6)
"""Reference points [chords] of lifting sections and cylinders; files made by interpolation may have others."""
_ROTATING = re.compile(r"rotational\s+(stall\s+delay|augmentation)|stall\s+delay|3-?d\s+correct", re.IGNORECASE)
_STEEL_WAVE_SPEED_SQUARED = 210e9 / 8500.0
"""E/rho of a steel tower with its flanges and paint (NREL/TP-500-38060, section 6) [m^2/s^2]."""


@dataclass(frozen=True)
class _Planform:
    """AeroDyn's table of the blade, in SI units, and the airfoil of each node."""

    z: Array
    curve: Array
    sweep: Array
    twist: Array
    chord: Array
    index: Integers
    files: "tuple[_AirfoilFile, ...]"

    def reference(self) -> Array:
        """Return the reference point of every node [chords behind the leading edge]."""
        return np.array([self.files[i].reference for i in self.index])

    def thickness(self) -> Array:
        """Return the largest thickness of every node [m]."""
        out: Array = self.chord * np.array([self.files[i].airfoil.relative_thickness for i in self.index])
        return out


def read_openfast_blade(
    model: Model, structure: str | None, length: float, hub_radius: float, rated_rotor_speed: float
) -> Blade:
    """Build the blade.

    Parameters
    ----------
    structure : str or None
        Of `STRUCTURES`; None: that of CompElast.
    length : float
        TipRad - HubRad [m].
    hub_radius : float
        [m].
    rated_rotor_speed : float
        [rad/s]; picks among tables of several Reynolds numbers.
    """
    numbers = range(1, model.n_blades + 1)
    file = _one_file(model.aerodyn, [f"ADBlFile({i})" for i in numbers])
    fluid = model.primary if model.aerodyn.is_default("KinVisc") else model.aerodyn
    viscosity = KINEMATIC_VISCOSITY if fluid.is_default("KinVisc") else fluid.number("KinVisc")
    viscosity = check_number(f"{fluid.path.name}: KinVisc", viscosity, 1e-8, 1e-2)
    elastodyn, primary = model.elastodyn, model.primary
    elastic_path = elastodyn.path.parent / elastodyn.text("BldFile(1)").replace("\\", "/")
    beamdyn, elastic = (structure or STRUCTURES[primary.integer("CompElast") - 1]) == "beamdyn", None
    if beamdyn:
        beam = _one_file(primary, [f"BDBldFile({i})" for i in numbers], within="BldFile")
        sections = beam.file("BldFile")
        if elastic_path.is_file():
            elastic = TextFile(elastic_path, free=True)
            model.note(f"blade: sections of BeamDyn ({sections.path.name}), not those of {elastic.path.name}")
    else:
        elastic = _one_file(elastodyn, [f"BldFile({i})" for i in numbers], free=True)
        if "BDBldFile(1)" in primary and (primary.path.parent / primary.text("BDBldFile(1)")).is_file():
            model.note("blade: sections of ElastoDyn; BeamDyn's, which the model has too, are left aside")
    plan = _read_planform(model, file, viscosity, length, hub_radius, rated_rotor_speed)
    if beamdyn:
        z, axis, bend = _beamdyn_axis(model, beam, length)
    else:
        z, axis = plan.z, _prebend_axis(model, plan)
    bent = PchipInterpolator(z, axis)
    station = arc_length(z, lambda at: np.column_stack((bent(at), at)))
    check_array(
        "distance along the axis of the blade", station, "n", ascending=2
    )  # key points may lie closer than rounding
    offset_x, offset_y = _offsets(plan, z, axis)
    if beamdyn:
        beams = _beamdyn_sections(sections, station[-1], PchipInterpolator(station, bend))
        damping = _beamdyn_damping(model, sections, elastic)
    else:
        assert elastic is not None  # of ElastoDyn
        beams, damping = _elastodyn_sections(model, elastic, plan, PchipInterpolator(z, station), length)
    airfoils, airfoil_z, airfoil_index = _airfoils(model, plan, length)
    return Blade(
        length=length,
        root_radius=hub_radius,
        axis_station=station,
        axis=np.column_stack((axis, z)),
        aero_station=plan.z,
        chord=plan.chord,
        twist=plan.twist,
        le_offset=plan.reference() - offset_y / plan.chord,
        airfoils=airfoils,
        airfoil_station=airfoil_z,
        airfoil_index=airfoil_index,
        structure=beams,
        damping_ratio=damping,
        normal_offset=offset_x / plan.chord,
        rotating_polars=True if any(plan.files[i].rotating for i in plan.index) else None,
    )


def _one_file(file: TextFile, keys: list[str], free: bool = False, within: str = "") -> TextFile:
    """Open the file that all keywords, one for each blade, name, or the first of several that are copies of each other.

    ``within`` is a keyword of these files that names another one, whose copies are copies too.
    """
    names = [file.text(key) for key in keys if key in file]
    if not names:
        raise file.missing(keys[0])
    first = TextFile(existing_file(file.path.parent, names[0], keys[0]), free)
    for name in dict.fromkeys(names[1:]):
        if name != names[0] and not _is_copy(first, file.path.parent / name.replace("\\", "/"), free, within):
            raise file.fail(", ".join(keys), names, "the same file for all blades, or copies of it")
    return first


def _is_copy(first: TextFile, path: Path, free: bool, within: str) -> bool:
    """Return whether a file has the same words below its titles, and so the file that ``within`` names there."""
    if not path.is_file():
        return False
    other = TextFile(path, free)
    if first.words(within) != other.words(within):
        return False
    if not within:
        return True
    return _is_copy(first.file(within), other.file(within).path, False, "")


def _stretched(model: Model, file: TextFile, key: str, z: Array, length: float) -> Array:
    """Return places along the blade, which may end beside its length by a little, from 0 to the length."""
    if abs(z[-1] - length) > 1e-6 * length:
        model.note(f"{key} ends at {z[-1]:g} m, stretched to TipRad - HubRad = {length:g} m", file)
    z = z * (length / z[-1])
    z[0], z[-1] = 0.0, length
    return z


def _read_planform(
    model: Model, file: TextFile, viscosity: float, length: float, hub_radius: float, rotor_speed: float
) -> _Planform:
    aerodyn, needed = model.aerodyn, ("blcrvac", "blswpac", "bltwist", "blchord", "blafid")
    table = file.table("NumBlNds", "BlSpn", *needed, part="blade")
    span = table["blspn"]
    if abs(span[0]) > 1e-6 * length or abs(span[-1] - length) > _SAME_LENGTH * length:
        raise file.fail("BlSpn", [float(span[0]), float(span[-1])], f"a span from 0 to TipRad - HubRad = {length:g} m")
    if np.any(np.diff(span) <= 0.0):
        raise file.fail("BlSpn", span.tolist(), "values that ascend from root to tip")
    z = _stretched(model, file, "BlSpn", span, length)
    twist, chord = np.radians(table["bltwist"]), table["blchord"]
    if np.any(np.abs(twist) > np.radians(60.0)):
        raise file.fail("BlTwist", float(table["bltwist"].max()), "twists of at most 60 deg")
    named = table["blafid"].astype(np.int64) - 1
    rows = aerodyn.rows(aerodyn.line_of("NumAFfiles") + 1, aerodyn.integer("NumAFfiles"), "AFNames")
    what = f"{aerodyn.path.name}: AFNames"  # a keyword that the first line need not have
    names = [existing_file(aerodyn.path.parent, row[0].strip("\"'"), what) for row in rows]
    if np.any((named < 0) | (named >= len(names))):
        raise file.fail("BlAFID", (named + 1).tolist(), f"numbers from 1 to NumAFfiles = {len(names)}")
    ratio = table.get("t_c", np.zeros(z.size))
    alfa, lift, drag, moment = (aerodyn.integer(f"InCol_{key}") for key in ("Alfa", "Cl", "Cd", "Cm"))
    columns = alfa, lift, drag, moment if aerodyn.flag("UseBlCm", True) else 0
    mode = aerodyn.integer("AFTabMod", 1)
    if mode not in (1, 2, 3):
        raise aerodyn.fail("AFTabMod", mode, "1, 2 or 3")
    read: list[_AirfoilFile] = []
    index = np.zeros(z.size, dtype=np.int64)
    for position, i in enumerate(np.unique(named)):
        nodes = np.flatnonzero(named == i)
        k = int(nodes[nodes.size // 2])
        reynolds = rotor_speed * (hub_radius + z[k]) * chord[k] / viscosity
        read.append(_read_airfoil(names[i], columns, mode, float(reynolds), float(ratio[k]), model.notes))
        index[nodes] = position
    return _Planform(z, table["blcrvac"], table["blswpac"], twist, chord, index, tuple(read))


def _prebend_axis(model: Model, plan: _Planform) -> Array:
    """Return x and y (n, 2) of the reference axis of a blade whose structure has no axis of its own.

    ElastoDyn's pitch axis is straight. The reference point of a section lies on the chord line through the axis if
    BlCrvAC = BlSwpAC tan(twist); what is left of BlCrvAC is prebend.
    """
    bend = plan.curve - plan.sweep * np.tan(plan.twist)
    bend = bend - bend[0]
    if np.max(np.abs(bend)) < _STRAIGHT * plan.z[-1]:
        bend = np.zeros(bend.size)
    else:
        model.note(
            f"prebend: ElastoDyn's blade is straight, AeroDyn's ends {plan.curve[-1]:.2f} m out of plane (BlCrvAC); "
            "the axis of the beam follows AeroDyn's, the mass per length along it is that along ElastoDyn's"
        )
    return np.column_stack((bend, np.zeros(bend.size)))


def _beamdyn_axis(model: Model, file: TextFile, length: float) -> tuple[Array, Array, Array]:
    """Return z (n,), x and y (n, 2) of the key points [m] and the twist there (n,) [rad]."""
    members, total = file.integer("member_total"), file.integer("kp_total")
    if members < 1 or total < 2:
        raise file.fail("member_total, kp_total", [members, total], "at least one member and two key points")
    rows = file.rows(file.line_of("kp_total") + 1, members + total, "members and key points", 2, skip_text=True)
    counts = [file.value("key points of a member", row[1]) for row in rows[:members]]
    if sum(counts) - (members - 1) != total:  # members share the key point where they meet
        raise file.fail("kp_total", total, f"the sum over the members, shared points once ({counts})")
    if any(len(row) < 4 for row in rows[members:]):
        raise file.fail("key points", min(rows[members:], key=len), "rows of x, y, z and twist")
    table = np.array([[file.value("key points", word) for word in row[:4]] for row in rows[members:]])
    z = table[:, 2]
    if np.any(np.diff(z) <= 0.0) or abs(z[0]) > 1e-6 * length or abs(z[-1] - length) > _SAME_LENGTH * length:
        allowed = f"values that ascend from 0 to TipRad - HubRad = {length:g} m"
        raise file.fail("kp_zr", [float(z[0]), float(z[-1])], allowed)
    z = _stretched(model, file, "kp_zr", z, length)
    return z, table[:, :2], np.radians(table[:, 3])


def _offsets(plan: _Planform, z: Array, axis: Array) -> tuple[Array, Array]:
    """Return the reference points of the sections from the axis, normal to the chord and along it to the rear [m]."""
    at = PchipInterpolator(z, axis)(plan.z)
    x, y = plan.curve - at[:, 0], plan.sweep - at[:, 1]
    c, s = np.cos(plan.twist), np.sin(plan.twist)
    normal = x * c - y * s
    return np.where(np.abs(normal) < 1e-6 * plan.chord, 0.0, normal), x * s + y * c


def _airfoils(model: Model, plan: _Planform, length: float) -> tuple[tuple[Airfoil, ...], Array, Integers]:
    """Return airfoils, their z [m] and index.

    AeroDyn blends no airfoils: each node has its own. Where nodes share airfoils, each holds half way to the next node;
    a set with an airfoil for (almost) every node was blended when it was made, and is blended between nodes here.
    """
    airfoils = tuple(file.airfoil for file in plan.files)
    if len(airfoils) >= _FULL_SET * plan.z.size:
        return airfoils, plan.z, plan.index
    model.note(
        f"airfoils: {len(airfoils)} for {plan.z.size} nodes, each holds half way to the next node, as in AeroDyn"
    )
    step = 0.5 * _SWITCH * length
    station, index = [0.0], [int(plan.index[0])]
    for k in np.flatnonzero(np.diff(plan.index)):
        middle = 0.5 * (plan.z[k] + plan.z[k + 1])
        station += [middle - step, middle + step]
        index += [int(plan.index[k]), int(plan.index[k + 1])]
    return airfoils, np.array([*station, length]), np.array([*index, int(plan.index[-1])], dtype=np.int64)


def _elastodyn_sections(
    model: Model, file: TextFile, plan: _Planform, arc: PchipInterpolator, length: float
) -> tuple[BeamStations, float]:
    """Return sections and damping of an ElastoDyn blade.

    ElastoDyn's blade bends and does nothing else. Shear stays rigid. Axial stiffness and rotary inertia are those of a
    tube with the section's outer size, EA = 8 EI/c^2; torsion is as stiff as bending in both directions together, which
    leaves a blade that hardly twists.
    """
    table = file.table("NBlInpSt", "BlFract", "strctwst", "bmassden", "flpstff", "edgstff", part="blade")
    z = file.unit_grid("BlFract", table["blfract"]) * length
    flap = table["flpstff"] * file.number("AdjFlSt", 1.0) * model.first_mode(file, "FlStTunr")
    edge = table["edgstff"] * file.number("AdjEdSt", 1.0)
    slope = np.maximum(arc.derivative()(z), 1.0)
    mass = table["bmassden"] * file.number("AdjBlMs", 1.0) / slope
    chord, thick = np.interp(z, plan.z, plan.chord), np.interp(z, plan.z, plan.thickness())
    flat, deep, angle = mass * thick**2 / 16.0, mass * chord**2 / 16.0, -np.radians(table["strctwst"])
    stiffness = turned(shear_rigid_stiffness(4.0 * (flap + edge) / chord**2, edge, flap, flap + edge), angle)
    inertia = turned(inertia_matrix(mass, 0.0, 0.0, deep, flat, 0.0), angle)
    model.note(
        "ElastoDyn's blade bends only; assumed: no shear, EA = 4 (FlpStff + EdgStff)/chord^2, GJ = FlpStff + EdgStff "
        "(hardly twists), rotary inertia by radii of a quarter of chord and thickness, centers of mass and shear on "
        "the pitch axis", file,
    )  # fmt: skip
    return BeamStations(arc(z), stiffness, inertia), model.damping(file, "BldFlDmp(1)", "BldFlDmp(2)", "BldEdDmp(1)")


def _beamdyn_sections(file: TextFile, length: float, twist: PchipInterpolator) -> BeamStations:
    """Return the sections of a BeamDyn blade: 6x6 matrices in the frame turned by the twist."""
    count = file.integer("station_total")
    # OpenFAST counts lines up to the heading of the sections, the last one, and does not read it
    headings = [i for i, text in enumerate(file.lines) if text.lstrip().startswith(("--", "=="))]
    named = [i for i, text in enumerate(file.lines) if "DISTRIBUTED PROP" in text.upper()]
    line = max(named or headings, default=0)
    rows = file.rows(line + 1, 13 * count, "station_total sections with a stiffness and an inertia each", 1, True)
    sections = [rows[i : i + 13] for i in range(0, 13 * count, 13)]
    if any(len(row) < 6 for section in sections for row in section[1:]):
        raise file.fail(
            "sections", f"{count} sections", "a line with the span, and two matrices with six rows of six each"
        )
    station = np.array([file.value("span of a section", section[0][0]) for section in sections])
    matrices = np.array([[[file.value("section", word) for word in row[:6]] for row in s[1:]] for s in sections])
    stiffness, inertia = matrices[:, :6], matrices[:, 6:]
    s = file.unit_grid("span of the sections", station) * length
    return BeamStations(s, turned(stiffness, -twist(s)), turned(inertia, -twist(s)))


def _beamdyn_damping(model: Model, file: TextFile, elastodyn: TextFile | None) -> float:
    """Return the damping ratio of the blade's modes.

    BeamDyn's mu are coefficients in proportion to stiffness: the ratio of a mode is mu omega / 2. ElastoDyn's file of
    the same blade, where there is one, has the ratio.
    """
    kind = file.integer("damp_flag" if "damp_flag" in file else "damp_type", 1)
    if kind == 0:
        model.note("the blade has no structural damping", file)
        return 0.0
    if kind == 2 and "n_modes" in file:
        first = float(file.numbers(file.line_of("n_modes") + 1, 1, 1, "zeta")[0, 0])
        model.note(f"modal damping, that of the first mode ({100 * first:g} %) is taken for all", file)
        return first
    if elastodyn is not None and "BldFlDmp(1)" in elastodyn:
        value = 0.01 * elastodyn.number("BldFlDmp(1)")
        model.note(f"mu is not used, {100 * value:g} % of critical from {elastodyn.path.name} is taken", file)
        return value
    model.note(f"mu is not used, {100 * DEFAULT_BLADE_DAMPING:g} % of critical assumed", file)
    return DEFAULT_BLADE_DAMPING


@dataclass(frozen=True)
class _AirfoilFile:
    """Content of one AirfoilInfo file."""

    airfoil: Airfoil
    """With the moment about the quarter chord."""
    reference: float
    """Point of the chord that AeroDyn puts at BlCrvAC and BlSwpAC [chords from the leading edge]."""
    rotating: bool
    """Whether a comment says that the polars hold the delay of stall by rotation."""


def _read_airfoil(
    path: Path, columns: tuple[int, int, int, int], mode: int, reynolds: float, thickness: float, notes: list[str]
) -> _AirfoilFile:
    """Read an AirfoilInfo file.

    Parameters
    ----------
    columns : tuple of int
        Of angle, lift, drag and moment, counted from 1 (InCol_Alfa, InCol_Cl, InCol_Cd, InCol_Cm); 0: not there.
    mode : int
        Use of several tables (AFTabMod): 1 the first, 2 interpolation over the Reynolds number, 3 over UserProp.
    reynolds : float
        In rated operation.
    thickness : float
        Relative thickness that the blade file gives (t_c); 0 where it gives none.
    """
    file = TextFile(path, free=True, titles=0)
    tables = _tables(file)
    lower, upper, weight = _selection(file, tables, mode, reynolds, notes)
    contour, reference, known = _airfoil_shape(file, lower.line, columns, thickness, notes)
    polar = _polar(file, lower, columns, reference, notes)
    if weight > 0.0:
        polar = blend_polars(polar, _polar(file, upper, columns, reference, notes), weight)
    with within(path.name):
        x, camber, measured = camber_line(contour)
        airfoil = Airfoil(path.stem, min(known or measured, 1.0), contour, x, camber, polar)
    return _AirfoilFile(airfoil, reference, _ROTATING.search(file.comments) is not None)


@dataclass(frozen=True)
class _Table:
    """Place of a table of coefficients: its number from 1, its line with NumAlf, Reynolds number and property."""

    number: int
    line: int
    reynolds: float
    property: float


def _tables(file: TextFile) -> list[_Table]:
    """Return the tables of a file, as many as NumTabs."""
    out: list[_Table] = []
    reynolds = setting = 0.0
    for i, key, word in file.entries("Re", "Ctrl", "UserProp", "NumAlf"):
        if key == "Re":
            reynolds = 1e6 * _value(file, key, word)
        elif key == "NumAlf":
            out.append(_Table(len(out) + 1, i, reynolds, setting))
        else:
            setting = _value(file, key, word)
    if not out:
        raise TurbineDefinitionError(f"{file.path.name}: NumAlf: missing, no table of coefficients")
    count = file.integer("NumTabs", len(out))
    if not 1 <= count <= len(out):
        raise file.fail("NumTabs", count, f"a number from 1 to that of the tables, {len(out)}")
    return out[:count]


def _selection(
    file: TextFile, tables: list[_Table], mode: int, reynolds: float, notes: list[str]
) -> tuple[_Table, _Table, float]:
    """Return two tables and the weight of the second, as AirfoilInfo uses them (AFI_ComputeAirfoilCoefs).

    Coefficients are linear over the logarithm of the Reynolds number or over UserProp, and constant outside of the
    tables. UserProp is an input of AeroDyn that is 0 without control of the flow over the airfoils.
    """
    name = file.path.name
    if len(tables) == 1:
        return tables[0], tables[0], 0.0
    if mode == 1:
        notes.append(f"{name}: {len(tables)} tables, the first is used (AFTabMod 1)")
        return tables[0], tables[0], 0.0
    if mode == 2:
        what, at = "Re", float(np.log(max(reynolds, 1.0)))
        values = [float(np.log(max(table.reynolds, 1.0))) for table in tables]
        if len({table.property for table in tables}) > 1:
            raise file.fail("UserProp", [table.property for table in tables], "the same in all tables (AFTabMod 2)")
        words = f"at the Reynolds number of rated operation, {reynolds:.3g}, is used for all speeds"
    else:
        what, at, values = "UserProp", 0.0, [table.property for table in tables]
        words = "at UserProp 0 is used"
    if any(after <= before for before, after in pairwise(values)):
        given = [table.reynolds if mode == 2 else table.property for table in tables]
        raise file.fail(what, given, f"values that ascend from table to table (AFTabMod {mode})")
    upper = int(np.clip(np.searchsorted(values, at), 1, len(values) - 1))
    weight = float(np.clip((at - values[upper - 1]) / (values[upper] - values[upper - 1]), 0.0, 1.0))
    notes.append(f"{name}: {len(tables)} tables, the coefficients {words} (AFTabMod {mode})")
    return tables[upper - 1], tables[upper], weight


def _polar(
    file: TextFile, table: _Table, columns: tuple[int, int, int, int], reference: float, notes: list[str]
) -> Polar:
    """Return a table of coefficients, its moment about the quarter chord."""
    where = f"{file.path.name}: table {table.number}"
    angle, cl, cd, cm = _coefficients(file, table.line, columns, notes)
    if angle[0] > -180.0 + 1e-6 or angle[-1] < 180.0 - 1e-6:
        if np.any(np.ptp([cl, cd, cm], axis=1)):
            raise fail(f"{where}: Alpha", [float(angle[0]), float(angle[-1])], "angles from -180 to 180 deg")
        # constant coefficients hold at all angles, also in OpenFAST
        angle, cl, cd, cm = np.array([-180.0, 180.0]), *(np.repeat(column[:1], 2) for column in (cl, cd, cm))
    alpha = np.radians(angle)
    normal = cl * np.cos(alpha) + cd * np.sin(alpha)
    if cd.min() < 0.0:
        k = int(np.argmin(cd))
        notes.append(f"{where}: the drag coefficient is {cd[k]:g} at {angle[k]:g} deg, used as it is, as in OpenFAST")
    with within(where):
        return Polar(alpha, cl, cd, cm - normal * (reference - _QUARTER_CHORD))


def _value(file: TextFile, key: str, word: str) -> float:
    value = as_number(word)
    if value is None:
        raise file.fail(key, word, "a number")
    return value


def _count(file: TextFile, key: str, word: str) -> int:
    """Return a whole number of lines."""
    value = _value(file, key, word)
    if not (0.0 <= value < 1e6 and value == int(value)):
        raise file.fail(key, word, "a whole number from 0")
    return int(value)


def _coefficients(file: TextFile, line: int, columns: tuple[int, int, int, int], notes: list[str]) -> tuple[Array, ...]:
    """Return angle [deg], lift, drag and moment about the reference point."""
    count = _count(file, "NumAlf", next(word for i, _, word in file.entries("NumAlf") if i == line))
    if min(columns[:3]) < 1:
        raise fail("InCol_Alfa, InCol_Cl, InCol_Cd", columns[:3], "columns from 1")
    block = file.numbers(line + 1, count, max(columns), "table of coefficients")
    values = [block[:, k - 1] if k else np.zeros(count) for k in columns]
    if not columns[3]:
        note = "InCol_Cm: 0, sections without a pitching moment"
        if note not in notes:
            notes.append(note)
    return tuple(values)


def _airfoil_shape(
    file: TextFile, table: int, columns: tuple[int, int, int, int], thickness: float, notes: list[str]
) -> tuple[Array, float, float]:
    """Return contour (n, 2), reference point [chords] and relative thickness (0: that of the contour)."""
    name = file.path.name
    known = file.number("RelThickness", 0.0) if not file.is_default("RelThickness") else 0.0
    known = known if 0.0 < known <= 1.0 else (thickness if 0.0 < thickness <= 1.0 else 0.0)
    count = _count(file, "NumCoords", file.text("NumCoords")) if "NumCoords" in file else 0
    if count > 5:
        points = file.numbers(file.line_of("NumCoords") + 1, count, 2, "coordinates of the airfoil")
        contour, reference = _closed_contour(name, points[1:]), float(points[0, 0])
        if not _REFERENCES[0] <= reference <= _REFERENCES[1]:
            taken = 0.5 if (known or np.ptp(contour[:, 1])) > _THICK else _QUARTER_CHORD
            notes.append(f"{name}: the reference point at {reference:g} chords is implausible, {taken:g} is taken")
            reference = taken
        return contour, reference, known
    return _assumed_contour(file, table, columns, known, notes), _QUARTER_CHORD, known


def _closed_contour(where: str, points: Array) -> Array:
    """Return a contour from the trailing edge over the suction side, x/c from 0 to 1."""
    x = points[:, 0]
    if np.ptp(x) < 0.9 or np.ptp(x) > 1.1:
        raise fail(f"{where}: x/c", [float(x.min()), float(x.max())], "coordinates from 0 to 1")
    nose = int(np.argmin(x))
    if nose in (0, x.size - 1):  # starts at the leading edge: go round from the trailing edge
        ring = points[:-1] if np.allclose(points[0], points[-1]) else points
        points = np.roll(ring, -int(np.argmax(ring[:, 0])), axis=0)
        points = np.vstack((points, points[:1]))
    return suction_first(points)


def _assumed_contour(
    file: TextFile, table: int, columns: tuple[int, int, int, int], known: float, notes: list[str]
) -> Array:
    """Return a NACA four-digit section with the zero-lift angle of the polar; a circle where there is no lift.

    A parabolic camber line of height h has the zero-lift angle -2 h (thin-airfoil theory). Thickness distribution of
    the four-digit series: E. N. Jacobs, K. E. Ward, R. M. Pinkerton, NACA report 460, 1933.
    """
    angle, cl = _coefficients(file, table, columns, [])[:2]
    x = cosine_grid(61)
    if not np.any(cl):
        half = np.sqrt(np.maximum(x * (1.0 - x), 0.0)) * (known or 1.0)
        camber = np.zeros(x.size)
        notes.append(f"{file.path.name}: no coordinates, a circle assumed (its polar has no lift)")
    else:
        inner = np.abs(angle) <= 15.0
        lift, a = cl[inner], angle[inner]
        cross = np.flatnonzero((lift[:-1] <= 0.0) & (lift[1:] > 0.0))
        zero = 0.0
        if cross.size:
            k = cross[0]
            zero = float(np.radians(a[k] - lift[k] * (a[k + 1] - a[k]) / (lift[k + 1] - lift[k])))
        thick = known or _THICKNESS_GUESS
        root = np.sqrt(x)
        half = 5.0 * thick * (0.2969 * root - 0.1260 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1036 * x**4)
        camber = -2.0 * zero * x * (1.0 - x)
        notes.append(
            f"{file.path.name}: no coordinates, a section of {100 * thick:.0f} % thickness with a parabolic camber of "
            f"the polar's zero-lift angle {np.degrees(zero):.2f} deg assumed"
        )
    return contour_of(x, camber + half, camber - half)


def read_openfast_tower(model: Model) -> Tower:
    """Build the tower, clamped at TowerBsHt: ElastoDyn's bending stiffness and mass, AeroDyn's diameter and drag."""
    elastodyn = model.elastodyn
    base, top = elastodyn.number("TowerBsHt"), elastodyn.number("TowerHt")
    file = elastodyn.file("TwrFile")
    length = top - base
    if length <= 0.0:
        raise elastodyn.fail("TowerHt", top, f"a height above TowerBsHt = {base:g} m")
    columns = "tmassden", "twfastif", "twssstif"
    table = file.table("NTwInpSt", "HtFract", *columns, part="tower")
    station = file.unit_grid("HtFract", table["htfract"]) * length
    _check_order(file, table, ("htfract", *columns))
    mass = table["tmassden"] * file.number("AdjTwMa", 1.0)
    fore_aft = table["twfastif"] * file.number("AdjFASt", 1.0) * model.first_mode(file, "FAStTunr")
    side_side = table["twssstif"] * file.number("AdjSSSt", 1.0) * model.first_mode(file, "SSStTunr")
    bending = 0.5 * (fore_aft + side_side)
    if np.any(mass <= 0.0) or np.any(bending <= 0.0):
        raise file.fail("TMassDen, TwFAStif, TwSSStif", float(min(mass.min(), bending.min())), "numbers above 0")
    wall, diameter, drag = _tower_shape(model, base, length, (station, bending / mass))
    outer = np.interp(station, wall, diameter)
    # A thin tube of diameter D: I = A D^2/8, J = 2 I, so that EA = 8 EI/D^2 and GJ = EI/(1 + nu).
    torsion = bending / (1.0 + POISSON_RATIO)
    stiffness = shear_rigid_stiffness(8.0 * bending / outer**2, side_side, fore_aft, torsion)
    ring = mass * outer**2 / 8.0
    model.note(
        "ElastoDyn's tower bends only; axial and torsional stiffness and rotary inertia are those of a thin tube of "
        "its diameter", file,
    )  # fmt: skip
    damping = model.damping(file, "TwrFADmp(1)", "TwrFADmp(2)", "TwrSSDmp(1)", "TwrSSDmp(2)")
    sections = BeamStations(station, stiffness, inertia_matrix(mass, 0.0, 0.0, ring, ring, 0.0))
    return Tower(base, top, wall, diameter, sections, damping, drag)


def _check_order(file: TextFile, table: dict[str, Array], columns: tuple[str, ...]) -> None:
    """Refuse tables whose header has another order than that in which OpenFAST counts the columns."""
    given = [name for name in table if name in columns]
    if given != [name for name in columns if name in table] or list(table)[: len(given)] != given:
        raise file.fail(
            "columns of the tower", list(table), f"{', '.join(columns)} in this order, as OpenFAST counts them"
        )


def _tower_shape(model: Model, base: float, length: float, specific: tuple[Array, Array]) -> tuple[Array, Array, float]:
    """Return stations from the base [m], diameters [m] and drag coefficient.

    ``specific`` holds stations [m] and EI per mass per length [m^4/s^2], from which the diameter of a thin steel tube
    follows where AeroDyn has no tower: EI/m = (E/rho) D^2/8.
    """
    aerodyn = model.aerodyn
    if aerodyn.integer("NumTwrNds", 0) > 1:
        table = aerodyn.table("NumTwrNds", "TwrElev", "twrdiam", part="tower")
        _check_order(aerodyn, table, ("twrelev", "twrdiam", "twrcd"))
        elevation = table["twrelev"]
        if np.any(np.diff(elevation) <= 0.0):
            raise aerodyn.fail("TwrElev", elevation.tolist(), "heights that ascend")
        inside = (elevation > base + 1e-6) & (elevation < base + length - 1e-6)
        height = np.concatenate(([base], elevation[inside], [base + length]))
        diameter = np.interp(height, elevation, table["twrdiam"])
        drag = table.get("twrcd", np.ones(elevation.size))
        if np.ptp(drag) > 1e-9:
            model.note(f"TwrCd varies along the tower, its mean {drag.mean():g} is used", aerodyn)
        if not aerodyn.flag("TwrAero", True):
            model.note("TwrAero is False; the tower has the drag of TwrCd here", aerodyn)
        station = height - base
        station[-1] = length
        return station, diameter, float(drag.mean())
    diameter = np.sqrt(8.0 * specific[1] / _STEEL_WAVE_SPEED_SQUARED)
    if np.any(diameter > 50.0):
        raise fail("diameter of the tower", float(diameter.max()), "a table of the tower in AeroDyn (NumTwrNds)")
    model.note(
        f"no tower; diameters of {diameter.max():.2f} to {diameter.min():.2f} m are those of a thin steel tube with "
        "ElastoDyn's stiffness and mass, drag coefficient 1 assumed", aerodyn,
    )  # fmt: skip
    return specific[0], diameter, 1.0
