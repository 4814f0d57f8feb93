"""The tower of an OpenFAST model: ElastoDyn's bending stiffness and mass, AeroDyn's diameter and drag."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.turbines.beam import BeamStations, inertia_matrix
from wt_gym.turbines.checks import fail
from wt_gym.turbines.model import Tower
from wt_gym.turbines.openfast_text import TextFile
from wt_gym.turbines.windio_tower import POISSON_RATIO

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["read_openfast_tower"]

STEEL_WAVE_SPEED_SQUARED = 210e9 / 8500.0
"""E/rho of a steel tower with its flanges and paint (NREL/TP-500-38060, section 6) [m^2/s^2]."""


def read_openfast_tower(elastodyn: TextFile, file: TextFile, aerodyn: TextFile, notes: list[str]) -> Tower:
    """Build the tower, clamped at TowerBsHt.

    Parameters
    ----------
    elastodyn, file, aerodyn : TextFile
        Primary file of ElastoDyn, its tower file, primary file of AeroDyn.
    notes : list of str
        Receives a sentence for every assumption.

    Returns
    -------
    Tower

    Raises
    ------
    TurbineDefinitionError
        Naming file and keyword of what is missing, inconsistent or out of range.
    """
    base, top = elastodyn.number("TowerBsHt"), elastodyn.number("TowerHt")
    length = top - base
    if length <= 0.0:
        raise elastodyn.fail("TowerHt", top, f"a height above TowerBsHt = {base:g} m")
    table, fraction = file.sections("NTwInpSt", "HtFract", ("tmassden", "twfastif", "twssstif"), "tower")
    _check_order(file, table, ("htfract", "tmassden", "twfastif", "twssstif"))
    station = fraction * length
    mass = table["tmassden"] * file.number("AdjTwMa", 1.0)
    fore_aft = table["twfastif"] * file.number("AdjFASt", 1.0) * _tuner(file, "FAStTunr", notes)
    side_side = table["twssstif"] * file.number("AdjSSSt", 1.0) * _tuner(file, "SSStTunr", notes)
    bending = 0.5 * (fore_aft + side_side)
    if np.any(mass <= 0.0) or np.any(bending <= 0.0):
        raise file.fail("TMassDen, TwFAStif, TwSSStif", float(min(mass.min(), bending.min())), "numbers above 0")
    wall, diameter, drag = _shape(aerodyn, base, length, (station, bending / mass), notes)
    outer = np.interp(station, wall, diameter)
    stiffness = np.zeros((station.size, 6, 6))
    # A thin tube of diameter D: I = A D^2/8, J = 2 I, so that EA = 8 EI/D^2 and GJ = EI/(1 + nu).
    diagonal: tuple[float | NDArray[np.float64], ...] = (
        np.inf, np.inf, 8.0 * bending / outer**2, side_side, fore_aft, bending / (1.0 + POISSON_RATIO),
    )  # fmt: skip
    for k, value in enumerate(diagonal):
        stiffness[:, k, k] = value
    ring = mass * outer**2 / 8.0
    notes.append(
        f"{file.path.name}: ElastoDyn's tower bends only; axial and torsional stiffness and rotary inertia are those "
        "of a thin tube of its diameter"
    )
    values = [file.number(key) for key in ("TwrFADmp(1)", "TwrFADmp(2)", "TwrSSDmp(1)", "TwrSSDmp(2)") if key in file]
    if not values:
        raise TurbineDefinitionError(f"{file.path.name}: TwrFADmp(1): missing, no line has this keyword")
    if max(values) != min(values):
        given = ", ".join(f"{value:g}" for value in values)
        notes.append(f"{file.path.name}: damping {given} % of the modes, {values[0]:g} % is taken for all")
    sections = BeamStations(station, stiffness, inertia_matrix(mass, 0.0, 0.0, ring, ring, 0.0))
    return Tower(base, top, wall, diameter, sections, 0.01 * values[0], drag)


def _check_order(file: TextFile, table: dict[str, NDArray[np.float64]], columns: tuple[str, ...]) -> None:
    """Refuse tables whose header has another order than that in which OpenFAST counts the columns."""
    given = [name for name in table if name in columns]
    if given != [name for name in columns if name in table] or list(table)[: len(given)] != given:
        raise file.fail(
            "columns of the tower", list(table), f"{', '.join(columns)} in this order, as OpenFAST counts them"
        )


def _tuner(file: TextFile, name: str, notes: list[str]) -> float:
    one, two = file.number(f"{name}(1)", 1.0), file.number(f"{name}(2)", 1.0)
    if one != two:
        notes.append(f"{file.path.name}: {name}(1) = {one:g} is taken for all modes, {name}(2) = {two:g} is left aside")
    return one


def _shape(
    aerodyn: TextFile,
    base: float,
    length: float,
    specific: tuple[NDArray[np.float64], NDArray[np.float64]],
    notes: list[str],
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return stations from the base [m], diameters [m] and drag coefficient.

    ``specific`` holds stations [m] and EI per mass per length [m^4/s^2], from which the diameter of a thin steel tube
    follows where AeroDyn has no tower: EI/m = (E/rho) D^2/8.
    """
    if "NumTwrNds" in aerodyn and aerodyn.integer("NumTwrNds") > 1:
        table = aerodyn.table("NumTwrNds", "TwrElev")
        if "twrdiam" not in table:
            raise TurbineDefinitionError(f"{aerodyn.path.name}: no column twrdiam in the table of the tower")
        _check_order(aerodyn, table, ("twrelev", "twrdiam", "twrcd"))
        elevation = table["twrelev"]
        if np.any(np.diff(elevation) <= 0.0):
            raise aerodyn.fail("TwrElev", elevation.tolist(), "heights that ascend")
        inside = (elevation > base + 1e-6) & (elevation < base + length - 1e-6)
        height = np.concatenate(([base], elevation[inside], [base + length]))
        diameter = np.interp(height, elevation, table["twrdiam"])
        drag = table.get("twrcd", np.ones(elevation.size))
        if np.ptp(drag) > 1e-9:
            notes.append(f"{aerodyn.path.name}: TwrCd varies along the tower, its mean {drag.mean():g} is used")
        if not aerodyn.flag("TwrAero", True):
            notes.append(f"{aerodyn.path.name}: TwrAero is False; the tower has the drag of TwrCd here")
        station = height - base
        station[-1] = length
        return station, diameter, float(drag.mean())
    diameter = np.sqrt(8.0 * specific[1] / STEEL_WAVE_SPEED_SQUARED)
    if np.any(diameter > 50.0):
        raise fail("diameter of the tower", float(diameter.max()), "a table of the tower in AeroDyn (NumTwrNds)")
    notes.append(
        f"{aerodyn.path.name}: no tower; diameters of {diameter.max():.2f} to {diameter.min():.2f} m are those of a "
        "thin steel tube with ElastoDyn's stiffness and mass, drag coefficient 1 assumed"
    )
    return specific[0], diameter, 1.0
