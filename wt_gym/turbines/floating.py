"""Floating turbines: rotor and nacelle of a turbine of the catalog on another tower and a platform.

The data are in ``data/NAME.json``: tower, and the gains of a controller that is slower than the platform, so that pitch
control above rated wind does not drive it (Larsen & Hanson, J. Phys. Conf. Ser. 75, 2007, 012073).
"""

import json
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from wt_gym.hydrodynamics.platform import load_platform
from wt_gym.turbines.blade import BeamStations, inertia_matrix, shear_rigid_stiffness
from wt_gym.turbines.catalog import load_turbine
from wt_gym.turbines.model import Tower, Turbine
from wt_gym.turbines.windio import own_file

SHEAR_OVER_YOUNG, YOUNG_OVER_DENSITY = 80.8 / 210.0, 210e9 / 8500.0
"""Of steel, with paint, bolts, welds and flanges in the density [-], [m^2/s^2]: NREL/TP-500-38060, section 6."""


@cache
def oc4_turbine() -> Turbine:
    """NREL 5-MW turbine on the DeepCwind semi-submersible of OC4, with the gains of OC3-Hywind."""
    return _floating("oc4_nrel_5mw.json")


@cache
def volturnus_turbine() -> Turbine:
    """IEA 15-MW turbine on the semi-submersible VolturnUS-S, with the detuned gains of its ROSCO controller."""
    return _floating("volturnus_iea_15mw.json")


def _floating(file: str) -> Turbine:
    """Turbine of a file in ``data``."""
    data = json.loads(own_file(file).read_text(encoding="utf-8"))
    base, gains = load_turbine(data["turbine"]), data["control"]
    tower = _tower(data["tower"], base.tower.drag_coefficient)
    assert base.control is not None  # of the catalog
    arrays: dict[str, Any] = {
        key: np.array(value) if isinstance(value, list) else value for key, value in gains.items()
    }
    return replace(
        base,
        name=data["name"],
        tower=tower,
        floater=load_platform(data["platform"]),
        control=replace(base.control, **arrays),
    )


def _tower(data: dict[str, Any], drag: float) -> Tower:
    """Round steel tower from mass and bending stiffness per length.

    A thin tube has the torsional stiffness 2 (G/E) EI; its rotary inertia is that of its material, EI ρ/E.
    """
    length = data["height"] - data["base_height"]
    station, ends = length * np.array(data["share_of_height"]), np.array([0.0, length])
    mass, bending = np.array(data["mass_per_length"]), np.array(data["bending_stiffness"])
    rotary = bending / YOUNG_OVER_DENSITY
    stiffness = shear_rigid_stiffness(mass * YOUNG_OVER_DENSITY, bending, bending, 2.0 * SHEAR_OVER_YOUNG * bending)
    sections = BeamStations(station, stiffness, inertia_matrix(mass, 0.0, 0.0, rotary, rotary, 0.0))
    return Tower(
        data["base_height"], data["height"], ends, np.array(data["diameter"]), sections, data["damping_ratio"], drag
    )
