"""Airfoils of an OpenFAST model: AirfoilInfo files with their tables and coordinates."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wt_gym.errors import TurbineDefinitionError
from wt_gym.turbines.airfoil import Airfoil, Polar, camber_line, cosine_grid
from wt_gym.turbines.checks import fail
from wt_gym.turbines.openfast_text import TextFile, existing_file
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
    path: Path, columns: tuple[int, int, int, int], reynolds: float, thickness: float, notes: list[str]
) -> AirfoilFile:
    """Read an AirfoilInfo file.

    Parameters
    ----------
    path : Path
    columns : tuple of int
        Of angle, lift, drag and moment, counted from 1 (InCol_Alfa, InCol_Cl, InCol_Cd, InCol_Cm); 0: not there.
    reynolds : float
        In rated operation; the nearest of several tables is taken.
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
    raw = TextFile(path)
    file = TextFile(path, comment="!")
    number, table = _choose(file, reynolds, notes)
    contour, reference, known = _shape(path, raw, file, table, columns, thickness, notes)
    angle, cl, cd, cm = _coefficients(file, table, columns, notes)
    if angle[0] > -180.0 + 1e-6 or angle[-1] < 180.0 - 1e-6:
        raise fail(f"{path.name}: Alpha of table {number}", [angle[0], angle[-1]], "angles from -180 to 180 deg")
    alpha = np.radians(angle)
    normal = cl * np.cos(alpha) + cd * np.sin(alpha)
    with within(path.name):
        polar = Polar(alpha, cl, cd, cm - normal * (reference - QUARTER_CHORD))
        x, camber, measured = camber_line(contour)
        airfoil = Airfoil(path.stem, min(known or measured, 1.0), contour, x, camber, polar)
    comments = " ".join(line for line in raw.lines if line.lstrip().startswith("!"))
    return AirfoilFile(airfoil, reference, _ROTATING.search(comments) is not None)


def _choose(file: TextFile, reynolds: float, notes: list[str]) -> tuple[int, int]:
    """Return number (from 1) and first line of the table nearest to a Reynolds number, at the control setting 0."""
    found = []
    re_number, setting = 0.0, 0.0
    for i, line in enumerate(file.lines):
        words = line.replace(",", " ").split()
        key = words[1].lower() if len(words) > 1 else ""
        if key == "re":
            re_number = 1e6 * _value(file, "Re", words[0])
        elif key in ("ctrl", "userprop"):
            setting = _value(file, words[1], words[0])
        elif key == "numalf":
            found.append((i, re_number, setting))
    if not found:
        raise TurbineDefinitionError(f"{file.path.name}: NumAlf: missing, no table of coefficients")
    allowed = [k for k, entry in enumerate(found) if entry[2] == 0.0] or list(range(len(found)))
    distance = [abs(np.log(max(found[k][1], 1.0) / max(reynolds, 1.0))) for k in allowed]
    chosen = allowed[int(np.argmin(distance))]
    if len(found) > 1:
        notes.append(
            f"{file.path.name}: {len(found)} tables, number {chosen + 1} at a Reynolds number of "
            f"{found[chosen][1]:.3g} is used for all speeds (rated operation: {reynolds:.3g})"
        )
    return chosen + 1, found[chosen][0]


def _value(file: TextFile, key: str, word: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise file.fail(key, word, "a number") from None


def _count(file: TextFile, key: str, line: str) -> int:
    """Return the whole number with which a line begins."""
    word = line.split()[0] if line.split() else ""
    value = _value(file, key, word)
    if not (0.0 <= value < 1e6 and value == int(value)):
        raise file.fail(key, word, "a whole number from 0")
    return int(value)


def _coefficients(
    file: TextFile, line: int, columns: tuple[int, int, int, int], notes: list[str]
) -> tuple[NDArray[np.float64], ...]:
    """Return angle [deg], lift, drag and moment about the reference point."""
    count = _count(file, "NumAlf", file.lines[line])
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
    path: Path,
    raw: TextFile,
    file: TextFile,
    table: int,
    columns: tuple[int, int, int, int],
    thickness: float,
    notes: list[str],
) -> tuple[NDArray[np.float64], float, float]:
    """Return contour (n, 2), reference point [chords] and relative thickness (0: that of the contour)."""
    known = file.number("RelThickness", 0.0) if not file.is_default("RelThickness") else 0.0
    known = known if 0.0 < known <= 1.0 else (thickness if 0.0 < thickness <= 1.0 else 0.0)
    named = file.text("NumCoords") if "NumCoords" in file else "0"
    if named.startswith("@"):
        source = TextFile(existing_file(path.parent, named[1:].strip("\"'"), f"{path.name}: NumCoords"), comment="!")
        count = _count(source, "NumCoords", source.lines[0] if source.lines else "")
        first = 1
    else:
        source, count = file, _count(file, "NumCoords", named)
        first = file.line_of("NumCoords") + 1 if count else 0
    if count > 5:
        points = source.numbers(first, count, 2, "coordinates of the airfoil")
        contour, reference = _closed_contour(source.path.name, points[1:]), float(points[0, 0])
        if not _REFERENCES[0] <= reference <= _REFERENCES[1]:
            taken = 0.5 if (known or np.ptp(contour[:, 1])) > THICK else QUARTER_CHORD
            notes.append(
                f"{source.path.name}: the reference point at {reference:g} chords is implausible, {taken:g} is taken"
            )
            reference = taken
        return contour, reference, known
    return _assumed_contour(path, file, table, columns, known, notes), QUARTER_CHORD, known


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
    path: Path,
    file: TextFile,
    table: int,
    columns: tuple[int, int, int, int],
    known: float,
    notes: list[str],
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
        notes.append(f"{path.name}: no coordinates, a circle assumed (its polar has no lift)")
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
            f"{path.name}: no coordinates, a section of {100 * thick:.0f} % thickness with a parabolic camber of the "
            f"polar's zero-lift angle {np.degrees(zero):.2f} deg assumed"
        )
    return np.vstack((np.column_stack((x, camber + half))[::-1], np.column_stack((x, camber - half))[1:]))
