"""Unsteady vortex lattice with free wake: from moving lattice nodes and wind to circulation and nodal forces."""

from wt_gym.aerodynamics.bodies.body_set import (
    BodySet,
    BodySurface,
    TowerFlow,
    ellipsoid_body,
    revolution_body,
    tower_body,
    tower_perturbation,
)
from wt_gym.aerodynamics.lattice.planform import LatticePlanform, build_planform, span_distribution
from wt_gym.aerodynamics.options import ENGINEERING, REFERENCE, TRAINING, AerodynamicsError, AeroOptions
from wt_gym.aerodynamics.state import AeroState
from wt_gym.aerodynamics.vortex_lattice import VortexLattice

__all__ = [
    "ENGINEERING",
    "REFERENCE",
    "TRAINING",
    "AeroOptions",
    "AeroState",
    "AerodynamicsError",
    "BodySet",
    "BodySurface",
    "LatticePlanform",
    "TowerFlow",
    "VortexLattice",
    "build_planform",
    "ellipsoid_body",
    "revolution_body",
    "span_distribution",
    "tower_body",
    "tower_perturbation",
]
