"""Loads of the inner blade of the NREL 5-MW rotor, where lift sets in at the end of a cylindrical root.

The published turbine changes from cylinder to airfoil from one blade element to the next, 9.7 m from the axis. A
lattice with strips several meters wide must still carry the load that blade-element theory finds behind that step.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from validation.case import CaseResult, Check, Curve, Figure, case
from validation.rigid_rotor import RigidRotor
from wt_gym.aerodynamics.options import ENGINEERING, TRAINING
from wt_gym.turbines import load_turbine
from wt_gym.turbines.blade_element import BladeElementRotor, blade_element

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.aerodynamics import AeroOptions

__all__ = ["BANDS", "element_force", "mean_between", "strip_force"]

WIND, RATIO = 8.0, 7.55
BANDS = ((10.0, 15.0), (15.0, 25.0), (25.0, 45.0), (45.0, 60.0))
"""Stretches of the blade over which forces are compared [m from the axis]."""
FINE = replace(ENGINEERING, n_chord=1, n_span=40)


def strip_force(options: AeroOptions, turns: float = 5.0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Edges of the strips (n_span + 1,) [m from the axis] and their force along the axis per length (n_span,) [N/m].

    From speed, angle of attack and polar of every strip; the nodal forces are shared between neighbors.
    """
    turbine = load_turbine("nrel_5mw")
    rotor = RigidRotor.of_turbine(turbine, options)
    run = rotor.run(options, WIND, RATIO * WIND / rotor.radius, 0.0, turns)
    edges, planform = rotor.planform.span_edges, rotor.planform
    inflow = run.alpha + turbine.blade.twist_at(0.5 * (edges[1:] + edges[:-1]))
    across = run.coefficients[:, 0] * np.cos(inflow) + run.coefficients[:, 1] * np.sin(inflow)
    return rotor.root_radius + edges, 0.5 * rotor.air_density * run.speed**2 * planform.chord * across


def element_force(n_span: int = 600) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The same of blade-element theory with the published elements."""
    turbine = load_turbine("nrel_5mw")
    rotor = BladeElementRotor.of_turbine(turbine)
    result = blade_element(rotor, WIND, RATIO * WIND / rotor.radius, 0.0, n_span)
    edges = rotor.root_radius + np.linspace(0.0, rotor.length, n_span + 1)
    return edges, result.force[:, 0] / np.cos(rotor.cone)


def mean_between(edges, force, low, high):
    """Mean of a force per length that is constant on each strip, between two radii."""
    width = np.minimum(edges[1:], high) - np.maximum(edges[:-1], low)
    return float(np.sum(np.maximum(width, 0.0) * force) / (high - low))


@case(
    "nrel-5mw-inboard",
    "Normal force along the blade of the rigid NREL 5-MW rotor, behind the cylindrical root above all",
    "blade-element momentum theory with the published blade elements (NREL/TP-500-38060, Table 3-1); a fine lattice",
    slow=True,
)
def nrel_5mw_inboard() -> CaseResult:
    """Means over stretches of the blade; outboard of 45 m theory and lattice treat the tip differently."""
    element, fine = element_force(), strip_force(FINE, 4.0)
    checks, curves, lines = [], [Curve(*_steps(*element), "blade elements", "k-")], []
    for name, options in (("training", TRAINING), ("engineering", ENGINEERING)):
        own = strip_force(options)
        for low, high in BANDS:
            theory, best, value = (mean_between(*force, low, high) for force in (element, fine, own))
            where = f"{name}: mean normal force from {low:g} to {high:g} m"
            checks.append(Check(f"{where}, against {FINE.n_span} strips", best, value, 0.05, "N/m", source="lattice"))
            if high < 50.0:
                checks.append(Check(f"{where}, blade elements", theory, value, 0.10, "N/m", source="momentum theory"))
            lines.append(f"{where}: blade elements {theory:.0f}, {FINE.n_span} strips {best:.0f}, here {value:.0f} N/m")
        curves.append(Curve(*_steps(*own), name))
    curves.append(Curve(*_steps(*fine), f"{FINE.n_span} strips", "--"))
    figure = Figure(tuple(curves), "radius [m]", "normal force [N/m]")
    return CaseResult(checks, {"Normal force": figure}, "\n".join(lines))


def _steps(edges: NDArray[np.float64], force: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Corners of a line that is constant on each strip."""
    return np.repeat(edges, 2)[1:-1], np.repeat(force, 2)
