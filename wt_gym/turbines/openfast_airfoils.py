"""Airfoils of an OpenFAST model: AirfoilInfo files with their tables and coordinates."""

import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.turbines.airfoil import Airfoil, Polar, blend_polars, camber_line, cosine_grid
from wt_gym.turbines.checks import fail
from wt_gym.turbines.openfast_text import TextFile, as_number
from wt_gym.turbines.source import within

__all__ = ["AirfoilFile", "read_airfoil_file"]

QUARTER_CHORD = 0.25
THICKNESS_GUESS = 0.18
"""Relative thickness of a lifting section whose coordinates and thickness are unknown."""

THICK = 0.5
"""Relative thickness from which on a section is rather a cylinder, with its reference point in the middle."""

_REFERENCES = (0.1, 0.6)
"""Reference points [chords] of lifting sections and cylinders; files made by interpolation may have others."""

_ROTATING = re.compile(r"rotational\s+(stall\s+delay|augmentation)|stall\s+delay|3-?d\s+correct", re.IGNORECASE)


@dataclass(frozen=True)
class AirfoilFile:
    """What one AirfoilInfo file gives.

    Attributes
    ----------
    airfoil : Airfoil
        With the moment about the quarter chord.
    reference : float
        Point of the chord that AeroDyn puts at BlCrvAC and BlSwpAC [chords from the leading edge].
    rotating : bool
        Whether a comment says that the polars hold the delay of stall by rotation.
    """

    airfoil: Airfoil
    reference: float
    rotating: bool


def read_airfoil_file(
    path: Path, columns: tuple[int, int, int, int], mode: int, reynolds: float, thickness: float, notes: list[str]
) -> AirfoilFile:
    """Read an AirfoilInfo file.

    Parameters
    ----------
    path : Path
    columns : tuple of int
        Of angle, lift, drag and moment, counted from 1 (InCol_Alfa, InCol_Cl, InCol_Cd, InCol_Cm); 0: not there.
    mode : int
        Use of several tables (AFTabMod): 1 the first, 2 interpolation over the Reynolds number, 3 over UserProp.
    reynolds : float
        In rated operation.
    thickness : float
        Relative thickness that the blade file gives (t_c); 0 where it gives none.
    notes : list of str
        Receives a sentence for every assumption.

    Returns
    -------
    AirfoilFile

    Raises
    ------
    TurbineDefinitionError
        Naming the file and what is missing or wrong.
    """
    file = TextFile(path, free=True, titles=0)
    tables = _tables(file)
    lower, upper, weight = _selection(file, tables, mode, reynolds, notes)
    contour, reference, known = _shape(file, lower.line, columns, thickness, notes)
    polar = _polar(file, lower, columns, reference, notes)
    if weight > 0.0:
        polar = blend_polars(polar, _polar(file, upper, columns, reference, notes), weight)
    with within(path.name):
        x, camber, measured = camber_line(contour)
        airfoil = Airfoil(path.stem, min(known or measured, 1.0), contour, x, camber, polar)
    return AirfoilFile(airfoil, reference, _ROTATING.search(file.comments) is not None)


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
        return Polar(alpha, cl, cd, cm - normal * (reference - QUARTER_CHORD))


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


def _coefficients(
    file: TextFile, line: int, columns: tuple[int, int, int, int], notes: list[str]
) -> tuple[NDArray[np.float64], ...]:
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


def _shape(
    file: TextFile, table: int, columns: tuple[int, int, int, int], thickness: float, notes: list[str]
) -> tuple[NDArray[np.float64], float, float]:
    """Return contour (n, 2), reference point [chords] and relative thickness (0: that of the contour)."""
    name = file.path.name
    known = file.number("RelThickness", 0.0) if not file.is_default("RelThickness") else 0.0
    known = known if 0.0 < known <= 1.0 else (thickness if 0.0 < thickness <= 1.0 else 0.0)
    count = _count(file, "NumCoords", file.text("NumCoords")) if "NumCoords" in file else 0
    if count > 5:
        points = file.numbers(file.line_of("NumCoords") + 1, count, 2, "coordinates of the airfoil")
        contour, reference = _closed_contour(name, points[1:]), float(points[0, 0])
        if not _REFERENCES[0] <= reference <= _REFERENCES[1]:
            taken = 0.5 if (known or np.ptp(contour[:, 1])) > THICK else QUARTER_CHORD
            notes.append(f"{name}: the reference point at {reference:g} chords is implausible, {taken:g} is taken")
            reference = taken
        return contour, reference, known
    return _assumed_contour(file, table, columns, known, notes), QUARTER_CHORD, known


def _closed_contour(where: str, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a contour from the trailing edge over the suction side, x/c from 0 to 1."""
    x, y = points.T
    if np.ptp(x) < 0.9 or np.ptp(x) > 1.1:
        raise fail(f"{where}: x/c", [float(x.min()), float(x.max())], "coordinates from 0 to 1")
    nose = int(np.argmin(x))
    if nose in (0, x.size - 1):  # starts at the leading edge: go round from the trailing edge
        ring = points[:-1] if np.allclose(points[0], points[-1]) else points
        points = np.roll(ring, -int(np.argmax(ring[:, 0])), axis=0)
        points = np.vstack((points, points[:1]))
        x, y = points.T
    contour = np.column_stack(((x - x.min()) / np.ptp(x), y))
    area = 0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)
    return contour if area > 0.0 else contour[::-1].copy()


def _assumed_contour(
    file: TextFile, table: int, columns: tuple[int, int, int, int], known: float, notes: list[str]
) -> NDArray[np.float64]:
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
        thick = known or THICKNESS_GUESS
        root = np.sqrt(x)
        half = 5.0 * thick * (0.2969 * root - 0.1260 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1036 * x**4)
        camber = -2.0 * zero * x * (1.0 - x)
        notes.append(
            f"{file.path.name}: no coordinates, a section of {100 * thick:.0f} % thickness with a parabolic camber of "
            f"the polar's zero-lift angle {np.degrees(zero):.2f} deg assumed"
        )
    return np.vstack((np.column_stack((x, camber + half))[::-1], np.column_stack((x, camber - half))[1:]))
