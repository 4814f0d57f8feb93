"""Floating platforms from models of OpenFAST: ElastoDyn, HydroDyn with tables of WAMIT, MoorDyn or MAP++.

WAMIT's tables are made without dimensions by the density ρ of the water, gravity g and a length L: added mass by
ρ L^k, damping by ρ ω L^k, wave forces by ρ g L^(k-1) and stiffness by ρ g L^(k-1), with k from 3 for translations to 5
for rotations (WAMIT User Manual, chapter 3).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.base.files import decoded_text
from wt_gym.base.quantities import GRAVITY, Array
from wt_gym.hydrodynamics import DragMember, ExcitationTable, HeavePlate, MooringLine, Platform, RadiationTable
from wt_gym.turbines.openfast_text import Model, TextFile, as_number, existing_file

MOTIONS = ("PtfmSgDOF", "PtfmSwDOF", "PtfmHvDOF", "PtfmRDOF", "PtfmPDOF", "PtfmYDOF")
"""Keywords of ElastoDyn that free the platform."""
_PIECE = 3.0  # Longest piece of a member whose section changes along it [m]
_SAME = 1e-6
_ROTATES = np.array([0, 0, 0, 1, 1, 1])
_ADDED = 0.05, 3.0  # Least and largest added mass in surge over displaced mass; published models have 0.12 to 0.94

# keyword of HydroDyn, values that are modeled, their description
_REQUIRED: tuple[tuple[str, tuple[int, ...], str], ...] = (
    ("PotMod", (1,), "1: loads from the tables of WAMIT"),
    ("RdtnMod", (1, 2), "1 or 2: radiation with memory"),
    ("ExctnMod", (0, 1, 2), "0, 1 or 2"),
    ("NBody", (1,), "1: one body in potential flow"),
    ("NAddDOF", (0,), "0: a rigid body"),
    *((f"PtfmRef{axis}", (0,), "0: tables about the origin") for axis in ("xt", "yt", "zt", "ztRot")),
    ("PtfmRefY", (0,), "0: tables about the heading 0"),
    ("NMGDepths", (0,), "0: marine growth is not modeled"),
)  # fmt: skip
_LEFT_ASIDE = dict.fromkeys(
    ("ExctnDisp", "PtfmYMod", "WaveDisp", "AMMod"), "loads are those at the mean position"
) | dict.fromkeys(("MnDrift", "NewmanApp", "DiffQTF", "SumQTF"), "wave forces are of first order")


def floats(model: Model) -> bool:
    """Return whether the turbine of a model stands on a platform that moves.

    A substructure of SubDyn without mooring stands on the ground, as do turbines whose platform is fixed.
    """
    primary = model.primary
    moves = any(model.elastodyn.flag(key) for key in MOTIONS)
    is_moored = primary.integer("CompMooring", 0) != 0
    return is_moored or (moves and primary.integer("CompHydro", 0) != 0 and primary.integer("CompSub", 0) == 0)


def read_openfast_platform(model: Model) -> Platform | None:
    """Build the platform of a model; None for a turbine on the ground.

    Raises
    ------
    TurbineDefinitionError
        Naming file and keyword of what is not modeled: members without potential flow, several bodies, bodies, rods and
        free points of mooring lines, and values that are missing or out of range.
    """
    if not floats(model):
        return None
    primary, elastodyn = model.primary, model.elastodyn
    switches: tuple[tuple[str, tuple[int, ...], str], ...] = (
        ("CompHydro", (1,), "1: a platform floats by HydroDyn"),
        ("CompSub", (0,), "0: a platform is rigid"),
        ("CompMooring", (0, 1, 3), "0, 1 (MAP++) or 3 (MoorDyn)"),
    )
    for key, allowed, words in switches:
        if primary.integer(key, 0) not in allowed:
            raise primary.fail(key, primary.integer(key, 0), words)
    file = primary.file("HydroFile")
    for key, allowed, words in _REQUIRED:
        if key in file and file.integer(key) not in allowed:
            raise file.fail(key, file.integer(key), words)
    for key, words in _LEFT_ASIDE.items():
        if key in file and file.integer(key) != 0:
            model.note(f"left aside: {key} {file.text(key)}; {words}", file)
    if file.integer("ExctnMod", 1) == 0:
        model.note("left aside: ExctnMod 0; waves have the forces of the table .3 here", file)
    density, depth = _water(model, file, "WtrDens"), _water(model, file, "WtrDpth")
    if (level := _water(model, file, "MSL2SWL", 0.0)) != 0.0:
        raise primary.fail("MSL2SWL", level, "0: still water at mean sea level")
    model.notes += [f"{elastodyn.path.name}: left aside: {key} False; the platform moves freely here"
                    for key in MOTIONS if not elastodyn.flag(key)]  # fmt: skip
    gravity = (primary if "Gravity" in primary else elastodyn).number("Gravity", GRAVITY)
    for key in ("PtfmRefxt", "PtfmRefyt", "PtfmRefzt"):
        if elastodyn.number(key, 0.0) != 0.0:
            raise elastodyn.fail(key, elastodyn.number(key), "0: motions of the point at mean sea level")
    members = _members(file)
    mass, center, inertia = _body(elastodyn, _ballast(file, members, density))
    radiation, excitation, hydrostatic = _tables(file, density, gravity)
    if np.any(hydrostatic[3:5, 5] != 0.0):
        model.note("stiffness over yaw in the table .hst is left aside, it follows from the center of buoyancy", file)
        hydrostatic[3:5, 5] = 0.0
    stiffness = file.numbers(file.line_of("AddCLin"), 6, 6, "AddCLin")
    volume, buoyancy = _buoyancy(file, density * gravity)
    model.note("the waves of the model are left aside, simulations take a sea of their own")
    lines: tuple[MooringLine, ...] = ()
    if primary.integer("CompMooring", 0):
        lines = read_mooring(primary.file("MooringFile").path, depth, model.notes)
        model.note("mooring lines are quasi-static here, without inertia and drag of their own or mass of their ends")
    elif np.trace(stiffness[:2, :2]) <= 0.0:
        raise primary.fail("CompMooring", 0, "1 or 3 for a platform that AddCLin does not hold")
    linear, quadratic = (file.numbers(file.line_of(key), 6, 6, key) for key in ("AddBLin", "AddBQuad"))
    return Platform(
        primary.path.stem, mass, center, inertia, volume, hydrostatic, radiation, excitation,
        elastodyn.number("TowerBsHt"), depth, density, gravity, buoyancy,
        tuple(drag for member in members for drag in member.drag()), _plates(file, members), lines,
        linear, quadratic, stiffness,
    )  # fmt: skip


def _water(model: Model, hydrodyn: TextFile, key: str, default: float | None = None) -> float:
    """Return a property of the water, which releases have in different files."""
    seastate = [model.primary.file("SeaStFile")] if model.primary.integer("CompSeaSt", 0) == 1 else []
    values = [file.number(key) for file in (*seastate, hydrodyn, model.primary) if not file.is_default(key)]
    if not values and default is None:
        raise model.primary.missing(key)
    if min(values, default=0.0) != max(values, default=0.0):
        model.note(f"{key} differs between the files of the model; {values[0]:g} is taken, {values[1:]} left aside")
    return values[0] if values else float(default or 0.0)


def _buoyancy(file: TextFile, weight: float) -> tuple[float, Array]:
    """Return displaced volume and the center of buoyancy in x and y.

    A constant additional force upwards with moments is as much additional buoyancy; ``weight`` is that of the water per
    volume.
    """
    force = file.array("AddF0")
    if len(force) < 6:  # a column since OpenFAST 3, a row before
        force = file.numbers(file.line_of("AddF0"), 6, 1, "AddF0")[:, 0]
    if np.any(force[[0, 1, 5]] != 0.0):
        raise file.fail("AddF0", force.tolist(), "0 in surge, sway and yaw")
    volume = file.number("PtfmVol0")
    total = volume + force[2] / weight
    x, y = (file.number(f"PtfmCOB{axis}t", 0.0) * volume for axis in "xy")
    return float(total), np.array([x - force[4] / weight, y + force[3] / weight]) / total


# ---- mass ------------------------------------------------------------------------------------------------------------


class _Part(NamedTuple):
    """Rigid part: mass [kg], center [m], inertia about it [kg m^2]."""

    mass: float
    center: Array
    inertia: Array


def _body(file: TextFile, ballast: list[_Part]) -> _Part:
    """Put the platform of ElastoDyn and its ballast together."""
    names = [("R", "XY", "XZ"), ("XY", "P", "YZ"), ("XZ", "YZ", "Y")]
    own = np.array([[file.number(f"Ptfm{name}Iner", 0.0 if len(name) == 2 else None) for name in row] for row in names])
    center = np.array([file.number(f"PtfmCM{axis}t", 0.0) for axis in "xyz"])
    parts = [_Part(file.number("PtfmMass"), center, own), *ballast]
    mass = sum(part.mass for part in parts)
    middle = sum((part.mass * part.center for part in parts), np.zeros(3)) / (mass or 1.0)
    inertia = np.zeros((3, 3))
    for part in parts:
        away = part.center - middle
        inertia += part.inertia + part.mass * (away @ away * np.eye(3) - np.outer(away, away))
    return _Part(mass, middle, inertia)


def _ballast(file: TextFile, members: list[_Member], density: float) -> list[_Part]:
    """Return what fills members up to a height: cylinders that move with the platform."""
    count = file.integer("NFillGroups", 0)
    if count == 0:
        return []
    by_name, parts = {member.name: member for member in members}, list[_Part]()
    for row in file.rows(file.line_of("NFillGroups") + 1, count, "FillNumM", 4, skip_text=True):
        number = int(file.value("FillNumM", row[0]))
        if len(row) < number + 3:
            raise file.fail("FillMList", " ".join(row), f"{number} members, FillFSLoc and FillDens")
        level, words = file.value("FillFSLoc", row[number + 1]), row[number + 2]
        filling = density if words.strip("\"'").lower() == "default" else file.value("FillDens", words)
        for name in row[1 : number + 1]:
            if name not in by_name:
                raise file.fail("FillMList", name, f"members of the table, {', '.join(by_name)}")
            parts += by_name[name].filled(level, filling)
    return parts


# ---- members ---------------------------------------------------------------------------------------------------------


class _Member(NamedTuple):
    """Cylinder between two joints, with values at both ends (2,)."""

    name: str
    joints: tuple[str, str]
    ends: Array  #: Shape (2, 3) [m].
    diameter: Array
    wall: Array
    drag_coefficient: Array

    def pieces(self, first: float = 0.0, last: float = 1.0) -> Iterator[tuple[float, float]]:
        """Shares of the length between two of them: one piece where the section is the same, else short ones."""
        values = (self.diameter, self.wall, self.drag_coefficient)
        length = float(np.linalg.norm(self.ends[1] - self.ends[0])) * (last - first)
        count = 1 if all(np.ptp(value) == 0.0 for value in values) else max(1, int(np.ceil(length / _PIECE)))
        edges = np.linspace(first, last, count + 1)
        return zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)

    def at(self, share: float, values: Array) -> Array:
        """Return values that are linear along the member."""
        return np.asarray(values[0] + (values[1] - values[0]) * share)

    def drag(self) -> Iterator[DragMember]:
        """Return the member as pieces. Those without drag are drawn, except the stub behind a heave plate."""
        is_stub = np.linalg.norm(self.ends[1] - self.ends[0]) < 0.1 * self.diameter.min()
        for low, high in self.pieces():
            middle = 0.5 * (low + high)
            diameter, coefficient = (float(self.at(middle, part)) for part in (self.diameter, self.drag_coefficient))
            if coefficient > 0.0 or not is_stub:
                yield DragMember(self.at(low, self.ends), self.at(high, self.ends), diameter, coefficient)

    def filled(self, level: float, density: float) -> Iterator[_Part]:
        """Return what fills the member up to a height [m]."""
        z = self.ends[:, 2]
        cut = 1.0 if z.max() <= level else 0.0
        if z.min() < level < z.max():
            cut = float((level - z[0]) / (z[1] - z[0]))
        elif cut == 0.0:
            return
        first, last = (0.0, cut) if z[0] <= z[1] or cut == 1.0 else (cut, 1.0)
        axis = self.ends[1] - self.ends[0]
        length = float(np.linalg.norm(axis))
        axis = axis / length
        for low, high in self.pieces(first, last):
            middle, h = 0.5 * (low + high), length * (high - low)
            radius = float(self.at(middle, 0.5 * self.diameter - self.wall))
            mass = density * np.pi * radius**2 * h
            across = mass * (3.0 * radius**2 + h**2) / 12.0
            inertia = across * np.eye(3) + (0.5 * mass * radius**2 - across) * np.outer(axis, axis)
            yield _Part(mass, self.at(middle, self.ends), inertia)


def _members(file: TextFile) -> list[_Member]:
    """Read the members, all of which must be part of the body in potential flow."""
    if "NPropSetsRec" in file and file.integer("NPropSetsRec") != 0:
        raise file.fail("NPropSetsRec", file.integer("NPropSetsRec"), "0: members are cylinders")

    def table(count: str, key: str) -> dict[str, dict[str, str]]:
        count = f"{count}Cyl" if f"{count}Cyl" in file else count
        return {row[key.lower()]: row for row in file.records(count, key)}

    joints, sections = table("NJoints", "JointID"), table("NPropSets", "PropSetID")
    by_member, members = table("NCoefMembers", "MemberID"), []
    for row in file.records("NMembers", "MemberID"):
        name = row["memberid"]
        if row.get("proppot", "false").lower().lstrip(".")[:1] not in ("t", "1"):
            raise file.fail(f"PropPot of member {name}", row.get("proppot"), "True: members have drag only")
        mode = row["mcoefmod"]
        if mode not in ("1", "3"):
            raise file.fail(f"MCoefMod of member {name}", mode, "1 or 3: coefficients do not depend on the depth")
        places, walls = [], []
        for end in ("1", "2"):
            joint, section = joints.get(row[f"mjointid{end}"]), sections.get(row[f"mpropsetid{end}"])
            if joint is None or section is None:
                raise file.fail(f"member {name}", " ".join(row.values()), "between joints and sections of the file")
            place = f"Jointzi of joint {joint['jointid']}"
            places.append([file.value(place, joint[f"joint{axis}i"]) for axis in "xyz"])
            walls.append([file.value("PropD", section["propd"]), file.value("PropThck", section["propthck"])])
        if mode == "1":
            words = [file.rows(file.line_of("SimplCd") + 1, 1, "SimplCd", skip_text=True)[0][0]] * 2
        elif name in by_member:
            words = [by_member[name]["membercd1"], by_member[name]["membercd2"]]
        else:
            raise file.fail(f"MCoefMod of member {name}", mode, "1 for a member without a row of coefficients")
        drag = np.array([file.value(f"MemberCd of member {name}", word) for word in words])
        diameter, wall = np.array(walls).T
        members.append(_Member(name, (row["mjointid1"], row["mjointid2"]), np.array(places), diameter, wall, drag))
    return members


def _plates(file: TextFile, members: list[_Member]) -> tuple[HeavePlate, ...]:
    """Read the drag of the ends of members.

    HydroDyn's force is 1/4 ρ AxCd A |v| v with the areas A of all ends at a joint as vectors that point out, so that
    C_d is half of AxCd.
    """
    coefficients = {row["axcoefid"]: row for row in file.records("NAxCoef", "AxCoefID")}
    plates = []
    for joint in file.records("NJoints", "JointID"):
        name = joint["jointid"]
        row = coefficients.get(joint["jointaxid"])
        if row is None:
            raise file.fail(f"JointAxID of joint {name}", joint["jointaxid"], f"one of {', '.join(coefficients)}")
        drag = file.value("AxCd", row["axcd"])
        if drag == 0.0:
            continue
        for key in ("axfdmod", "axvncoff"):
            if file.value(key, row.get(key, "0")) != 0.0:
                raise file.fail(f"{key} of JointAxID {joint['jointaxid']}", row[key], "0: drag without a filter")
        area, place = np.zeros(3), np.zeros(3)
        for member in members:
            for end in (0, 1):
                if member.joints[end] == name:
                    outward = member.ends[end] - member.ends[1 - end]
                    area += 0.25 * np.pi * member.diameter[end] ** 2 * outward / np.linalg.norm(outward)
                    place = member.ends[end]
        if (size := float(np.linalg.norm(area))) > 1e-9:
            plates.append(HeavePlate(place, area / size, size, 0.5 * drag))
    return tuple(plates)


# ---- tables of WAMIT -------------------------------------------------------------------------------------------------


def _tables(file: TextFile, density: float, gravity: float) -> tuple[RadiationTable, ExcitationTable, Array]:
    """Read radiation, excitation and hydrostatics."""
    root, length = file.text("PotFile"), file.number("WAMITULEN", 1.0)
    if length <= 0.0:
        raise file.fail("WAMITULEN", length, "above 0 m")
    folder, label = file.path.parent, f"{file.path.name}: PotFile"
    paths = [existing_file(folder, f"{root}{end}", label) for end in (".1", ".3", ".hst")]
    matrix = length ** (3.0 + _ROTATES[:, None] + _ROTATES)
    hydrostatic = np.full((6, 6), np.nan)
    for i, j, value, *_ in _rows(paths[2], 3):
        hydrostatic[_index(paths[2], [i, j])] = value
    if np.isnan(hydrostatic).any():
        raise TurbineDefinitionError(f"{paths[2].name}: must have 36 rows: motion, motion, stiffness")
    hydrostatic *= density * gravity * matrix / length
    if abs(hydrostatic[2:5, 2:5] - hydrostatic[2:5, 2:5].T).max() <= _SAME * abs(hydrostatic).max():
        hydrostatic[2:5, 2:5] = 0.5 * (hydrostatic[2:5, 2:5] + hydrostatic[2:5, 2:5].T)
    radiation, displaced = _radiation(paths[0], density * matrix), density * file.number("PtfmVol0")
    if not _ADDED[0] * displaced < (added := radiation.added_mass_infinite[0, 0]) < _ADDED[1] * displaced:
        allowed = (
            f"the length of the tables: the added mass in surge is {added:g} kg, the displaced one {displaced:g} kg"
        )
        raise file.fail("WAMITULEN", length, allowed)
    return radiation, _excitation(paths[1], density * gravity * length ** (2.0 + _ROTATES)), hydrostatic


def _rows(path: Path, least: int) -> list[list[float]]:
    """Return the rows of numbers of a table, of which some have no further columns."""
    rows = []
    for k, line in enumerate(decoded_text(path.read_bytes()).splitlines()):
        numbers = [as_number(word) for word in line.split()]
        row = [number for number in numbers if number is not None]
        if not numbers or (k == 0 and None in numbers):
            continue  # a title may stand first
        if len(row) < max(least, len(numbers)) or not np.isfinite(row).all():
            raise TurbineDefinitionError(
                f"{path.name}: line {k + 1} must have at least {least} numbers, got {line!r:.80}"
            )
        rows.append(row)
    if not rows:
        raise TurbineDefinitionError(f"{path.name}: must be a table of WAMIT, got no numbers")
    return rows


def _index(path: Path, place: list[float]) -> tuple[int, ...]:
    """Return indices of motions from their numbers 1 to 6."""
    if any(number not in range(1, 7) for number in place):
        raise TurbineDefinitionError(f"{path.name}: motions must be 1 to 6, one body in potential flow, got {place}")
    return tuple(int(number) - 1 for number in place)


def _radiation(path: Path, scale: Array) -> RadiationTable:
    """Read added mass and damping; a period below 0 is the frequency 0, the period 0 an infinite one."""
    added: dict[float, Array] = {}
    damping: dict[float, Array] = {}
    for period, i, j, *values in _rows(path, 4):
        frequency = 0.0 if period < 0.0 else np.inf if period == 0.0 else 2.0 * np.pi / period
        place = _index(path, [i, j])
        added.setdefault(frequency, np.zeros((6, 6)))[place] = values[0]
        damping.setdefault(frequency, np.zeros((6, 6)))[place] = values[1] if len(values) > 1 else 0.0
    if np.inf not in added:
        raise TurbineDefinitionError(f"{path.name}: must have the added mass of infinite frequency, period 0")
    omega = np.array(sorted(frequency for frequency in added if frequency < np.inf))
    b = np.array([damping[w] * w for w in omega]) * scale
    with _named(path):
        return RadiationTable(omega, np.array([added[w] for w in omega]) * scale, b, added[np.inf] * scale)


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Let an error begin with the name of the file."""
    try:
        yield
    except TurbineDefinitionError as error:
        raise TurbineDefinitionError(f"{path.name}: {error}") from error


def _excitation(path: Path, scale: Array) -> ExcitationTable:
    """Read wave forces."""
    rows = np.array([row[:7] for row in _rows(path, 7)])
    rows = rows[rows[:, 0] > 0.0]
    periods, headings = np.unique(rows[:, 0])[::-1], np.unique(rows[:, 1])
    if 0.0 < np.ptp(headings) < 6.3 and np.any(abs(headings - np.round(headings, 1)) > 1e-6):
        ends = f"{headings[0]:g} to {headings[-1]:g}"
        raise TurbineDefinitionError(f"{path.name}: headings must be in degrees, got {ends}")
    modulus, size = rows[:, 3], np.hypot(rows[:, 5], rows[:, 6])
    if modulus.any() and np.any(abs(modulus - size) > 1e-3 * size.max()):
        raise TurbineDefinitionError(f"{path.name}: columns must be period, heading, motion, modulus, phase, Re and Im")
    force = np.full((len(periods), len(headings), 6, 2), np.nan)
    for period, heading, motion, *_, real, imaginary in rows:
        (k,) = _index(path, [motion])
        force[np.searchsorted(-periods, -period), np.searchsorted(headings, heading), k] = real, imaginary
    if np.isnan(force).any():
        raise TurbineDefinitionError(f"{path.name}: must have six motions for each period and heading")
    force *= scale[:, None]
    return ExcitationTable(2.0 * np.pi / periods, np.radians(headings), force[..., 0], force[..., 1])


# ---- mooring ---------------------------------------------------------------------------------------------------------

_SECTIONS = (
    ("ROD TYPE", ""), ("ROD", "rods"), ("BOD", "bodies"), ("TYPE", "types"), ("DICTIONARY", "types"),
    ("OPTION", "options"), ("EXTERNAL", "loads"),
    ("OUTPUT", "outputs"), ("FAIL", "failures"), ("CONTROL", "controls"), ("POINT", "points"), ("CONNECTION", "points"),
    ("NODE", "points"), ("LINE", "lines"),
)  # fmt: skip
"""Words of the rules above sections, the first that occurs decides."""
_COLUMNS = {"types": "diam", "points": "x", "lines": "unstrlen"}  # by which the line of their names is known
_FIXED, _MOVING = ("fixed", "fix", "anchor", "anch"), ("vessel", "ves", "coupled", "cpld", "fairlead", "fair")


def read_mooring(path: Path, depth: float, notes: list[str]) -> tuple[MooringLine, ...]:
    """Read the mooring lines of an input file of MoorDyn or MAP++.

    Parameters
    ----------
    path : Path
    depth : float
        Of the water [m].
    notes : list of str
        Gets a sentence for what is left aside.

    Raises
    ------
    TurbineDefinitionError
        For bodies, rods, free points, and lines that are not elastic catenaries between an anchor and the platform.
    """
    file = TextFile(path)
    sections = _sections(file)
    for name in ("rods", "bodies", "failures", "controls", "loads"):
        if rows := sections.get(name):
            raise file.fail(name, " ".join(rows[0].values()), "absent: lines run from anchors to the platform")
    types = {_first(row, "name", "linetype", "typename"): row for row in sections.get("types", [])}
    points = {_first(row, "id", "node"): row for row in sections.get("points", [])}
    for name, table in (("types", types), ("points", points)):
        if len(table) != len(sections[name]):
            raise file.fail(name, [*table], f"{len(sections[name])} different names")
    options: dict[str, list[str]] = {}
    for first, *rest in (list(row.values()) for row in sections.get("options", [])):
        options.setdefault(first.lower(), []).extend(rest)  # MAP++: keyword, values
        options.setdefault("".join(rest[:1]).lower(), []).append(first)  # MoorDyn: value, keyword
    copies = [0.0, *(np.radians(file.value("repeat", word)) for word in options.get("repeat", []))]
    middle = np.array([file.value("ref_position", word) for word in options.get("ref_position", ["0", "0"])[:2]])
    for word in options.get("wtrdpth", []):
        if abs(file.value("WtrDpth", word) - depth) > _SAME * depth:
            raise file.fail("WtrDpth", word, f"that of the model, {depth:g} m")
    along = [options[key][-1] for key in ("mu_ka", "mu_kt", "frictioncoefficient") if key in options]
    lines = []
    for angle in copies:
        cos, sin = np.cos(angle), np.sin(angle)
        turn = np.array([[cos, -sin], [sin, cos]])
        for row in sections.get("lines", []):
            ends = _ends(file, row, points, depth)
            for end in ends:
                end[:2] = middle + turn @ (end[:2] - middle)
            kind = types.get(_first(row, "linetype"))
            if kind is None:
                raise file.fail("LineType", _first(row, "linetype"), f"one of {', '.join(types)}")
            numbers = [
                file.value(key, _first(table, *names)) for key, table, *names in (
                    ("UnstrLen", row, "unstrlen"), ("MassDen", kind, "massden", "massdeninair"), ("Diam", kind, "diam"),
                    ("EA", kind, "ea"), ("CB", {"cb": next(iter(along), kind.get("cb", "0"))}, "cb"),
                )
            ]  # fmt: skip
            with _named(path):
                lines.append(MooringLine(*ends, *numbers))
            if angle == 0.0 and not lines[-1].rests(depth):
                name, z = next(iter(row.values())), lines[-1].anchor[2]
                notes.append(f"{path.name}: line {name} hangs free, its anchor is at {z:g} m, above the seabed")
    for name, kind in types.items():
        if file.value("EI", kind.get("ei", "0")) != 0.0:
            notes.append(f"{path.name}: left aside: EI {kind['ei']} of {name}; lines do not resist bending")
    return tuple(lines)


def _ends(file: TextFile, row: dict[str, str], points: dict[str, dict[str, str]], depth: float) -> tuple[Array, Array]:
    """Return anchor and fairlead of a line."""
    line, places = f"line {next(iter(row.values()))}", {}
    for name in (_first(row, "attacha", "nodeanch"), _first(row, "attachb", "nodefair")):
        point = points.get(name, {})
        kind = _first(point, "type", "attachment", "attach", "att").lower()
        if kind not in (*_FIXED, *_MOVING):
            raise file.fail(f"end {name} of {line}", kind, "a point that is Fixed or Vessel")
        words = {f"{axis} of point {name}": point.get(axis, "") for axis in "xyz"}
        place = [-depth if word.lower() == "depth" else file.value(key, word) for key, word in words.items()]
        places[kind in _MOVING] = np.array(place)
    if len(places) < 2:
        raise file.fail(line, " ".join(row.values()), "a line from a Fixed to a Vessel point")
    if flags := {"omit_contact", "linear_spring"} & {word.lower() for word in row.values()}:
        raise file.fail(line, flags.pop(), "an elastic catenary on the seabed")
    return places[False], places[True]


def _first(row: dict[str, str], *names: str) -> str:
    """Return the value of the first column that is there."""
    return next((row[name] for name in names if name in row), "")


def _sections(file: TextFile) -> dict[str, list[dict[str, str]]]:
    """Return the rows of each section by the names of columns; further words have their number as a name."""
    sections: dict[str, list[dict[str, str]]] = {}
    counts: dict[str, int] = {}
    name, header = "", list[str]()
    for line in file.lines:
        if line.lstrip().startswith("--"):
            name = next((kind for word, kind in _SECTIONS if re.search(rf"\b{word}", line.upper())), "")
            header = []
            continue
        words = line.partition("#")[0].partition("!")[0].split()
        if not words or not name or words[0][0] in "([" or words[0] == "-":
            continue
        if not header and name != "options":
            if as_number(words[0]) is not None:  # the number of rows may stand above
                counts[name] = int(file.value(name, words[0]))
            elif _COLUMNS.get(name, words[0].lower()) in (names := [word.lower() for word in words]):
                header = names
            continue
        row = {(header[k] if k < len(header) else str(k)): word for k, word in enumerate(words)}
        sections.setdefault(name, []).append(row)
    for name, column in _COLUMNS.items():
        if name not in sections:
            raise file.fail(name, "no row", f"rows below the names of their columns, {column} among them")
        if counts.get(name, len(sections[name])) != len(sections[name]):
            raise file.fail(name, len(sections[name]), f"as many rows as announced, {counts[name]}")
    return sections
