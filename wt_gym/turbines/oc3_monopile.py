"""The NREL 5-MW turbine on the monopile of the Offshore Code Comparison Collaboration (OC3)."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.turbines.beam import BeamStations, inertia_matrix
from wt_gym.turbines.model import Support, Tower, Turbine
from wt_gym.turbines.windio import own_file, read_turbine

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["OC3_FOUNDATION", "oc3_turbine"]

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
