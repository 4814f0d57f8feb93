"""Named tuples that kernels take hold arrays of the types that their fields declare."""

import numpy as np

from wt_gym.aerodynamics import TRAINING, BodySet, VortexLattice, build_planform, ellipsoid_body
from wt_gym.aerodynamics.induction.tree_induction import make_block, make_tree
from wt_gym.hydrodynamics import PlatformLoads, load_platform
from wt_gym.simulation.turbine_structure import sub_body_points
from wt_gym.structure.beam import BeamSections
from wt_gym.structure.substructure import cut_beam

SHORT = {"Array": "NDArray[np.float64]", "Integers": "NDArray[np.int64]"}


def lattice():
    edges = np.linspace(2.0, 40.0, TRAINING.n_span + 1)
    ones = np.ones_like(edges)
    alpha = -np.pi + 2.0 * np.pi / 72 * np.arange(72)
    polar = np.column_stack([2.0 * np.pi * np.sin(alpha), 0.01 * np.ones(72), np.zeros(72)])
    axis = np.column_stack([0.0 * ones, 0.0 * ones, edges])
    planform = build_planform(
        edges, axis, ones, 0.0 * ones, 0.25 * ones, np.tile(polar, (len(edges) - 1, 1, 1)), TRAINING.n_chord
    )
    bodies = BodySet([ellipsoid_body((1.0, 0.5, 0.5), 6, 4)])
    return VortexLattice(planform, 2, TRAINING, bodies=bodies)


def blade_nodes():
    sections = BeamSections.uniform(30.0, EA=1e9, EIx=1e8, EIy=1e8, GJ=1e7, mass=100.0)
    pieces = cut_beam("blade", sections, np.linspace(0.0, 30.0, 7), 2, "modal", dofs=(0, 4))
    return sub_body_points(pieces, np.column_stack([np.zeros(5), np.zeros(5), np.linspace(1.0, 29.0, 5)]))[1]


def tuples():
    """Every named tuple, those within others too."""
    made = lattice()
    found, waiting = [], [
        made.arrays, made.work, made.new_state().arrays, *made.body_arrays, make_tree(8, 1, 8, 32), make_block(),
        blade_nodes(), PlatformLoads(load_platform("oc4_semi"), 0.1).arrays,
    ]  # fmt: skip
    while waiting:
        one = waiting.pop()
        found.append(one)
        waiting += [value for value in one if isinstance(value, tuple)]
    return found


def wrong_fields(one):
    """Fields that hold another type than their declaration says."""
    wrong = {}
    for name, value in zip(one._fields, one, strict=True):
        declared = type(one).__annotations__[name]
        text = getattr(declared, "__forward_arg__", declared)
        held = f"NDArray[np.{value.dtype.name}]" if isinstance(value, np.ndarray) else "no array"
        if SHORT.get(text, text if text.startswith("NDArray") else "no array").replace("bool_", "bool") != held:
            wrong[name] = text, held
    return wrong


def test_arrays_of_kernels_have_the_declared_types():
    found = tuples()
    assert {type(one).__name__ for one in found} >= {
        "AeroArrays", "AeroWork", "Block", "BodyArrays", "BodyWork", "SubBodyNodes", "PlanformArrays", "PlatformArrays",
        "RingWork", "Tree",
    }  # fmt: skip
    assert {type(one).__name__: wrong for one in found if (wrong := wrong_fields(one))} == {}
