"""Blades of several bodies: they hang together, weigh and vibrate like the whole blade, and carry its lattice."""

from dataclasses import replace

import numpy as np
import pytest

from wt_gym.multibody.system import Joint, MultibodySystem
from wt_gym.multibody.tree import tree_kernels
from wt_gym.multibody.tree.point_kernels import point_motion
from wt_gym.simulation import Fidelity
from wt_gym.simulation.models import blade_planform
from wt_gym.simulation.turbine_structure import add_sub_bodies, build_structure, cut_blade
from wt_gym.structure.beam import Beam, BeamSections
from wt_gym.structure.modes import clamped_modes, select_modes
from wt_gym.turbines import load_turbine

PIECES = Fidelity(blade_bodies=4, blade_modes=(2, 1, 1), integrator="generalized_alpha")
DOFS = (0, 1, 3, 4, 5)


@pytest.fixture(scope="module")
def blade():
    """Blade of the NREL 5-MW turbine and its finite elements."""
    blade = load_turbine("nrel_5mw").blade
    axis = np.column_stack([np.interp(blade.structure.station, blade.axis_station, blade.axis[:, k]) for k in range(3)])
    sections = BeamSections(blade.structure.station, blade.structure.stiffness, blade.structure.inertia, axis)
    return blade, Beam(sections, PIECES.blade_elements)


def clamped_chain(blade, beam, n):
    """A blade in n pieces on the ground, without gravity."""
    system, fidelity = MultibodySystem((0.0, 0.0, 0.0)), replace(PIECES, blade_bodies=n)
    add_sub_bodies(
        system, cut_blade(blade, beam, fidelity, DOFS), lambda body: system.add(body, Joint("fixed")), "blade"
    )
    return system.build()


def vibrations(system, step=1e-4):
    """Frequencies [Hz] and damping ratios about rest, ascending."""
    n, origin = system.n_u, system.initial_state()
    columns = []
    for i in range(2 * n):
        y = origin.copy()
        y[i] = step
        columns.append((system.rates(y) - system.rates(origin))[n : 2 * n] / step)
    lower = np.array(columns).T
    matrix = np.block([[np.zeros((n, n)), np.eye(n)], [lower]])
    roots = np.linalg.eigvals(matrix)
    roots = roots[roots.imag > 0.0]
    roots = roots[np.argsort(np.abs(roots))]
    return np.abs(roots) / (2.0 * np.pi), -roots.real / np.abs(roots)


def test_the_chain_vibrates_and_is_damped_like_the_whole_blade(blade):
    """Bending within 0.5 %; torsion, whose static shapes are coarser, by the square of the length of the pieces."""
    whole = clamped_modes(blade[1], 40, node_dofs=DOFS)
    expected = whole.frequency[select_modes(whole, flap=1, edge=1, torsion=1)]
    errors = []
    for n in (4, 8):
        frequency, ratio = vibrations(clamped_chain(*blade, n))
        found = [np.abs(frequency - f).argmin() for f in expected]
        assert frequency[found[:2]] == pytest.approx(expected[:2], rel=0.005)
        assert ratio[found[:2]] == pytest.approx(blade[0].damping_ratio, rel=0.02)
        errors.append(frequency[found[2]] / expected[2] - 1.0)
    assert 0.0 < errors[1] < errors[0] / 3.0


@pytest.fixture(scope="module")
def turbines():
    """Structures of the turbine with blades of one body and of several, and the lattice nodes of a blade."""
    turbine = load_turbine("iea_15mw")  # with a curved blade
    nodes = blade_planform(turbine, PIECES.aero).nodes
    one = build_structure(turbine, Fidelity(), nodes)
    return turbine, one, build_structure(turbine, PIECES, nodes), nodes.reshape(-1, 3)


def lattice(structure, y, n):
    """Lattice nodes (n_blades, n, 3) of a structure in a state."""
    system, work = structure.system, structure.system.new_work()
    tree_kernels.kinematics(y, system.tree, work)
    nodes = np.full((len(structure.parts), n, 3), np.nan)
    points, sub_bodies = structure.lattice_points, structure.sub_body_nodes
    for blade, parts in enumerate(structure.parts):
        for p, body in enumerate(parts):
            own = type(points)(*(shapes[p] for shapes in points))
            place, speed = np.zeros((own.position.shape[0], 3)), np.zeros((own.position.shape[0], 3))
            q, rate = structure.elastic(body, y)
            point_motion(work.rot[body], work.r[body], work.v[body], work.omega[body], q, rate, own, place, speed)
            chosen = np.arange(n) if sub_bodies is None else sub_bodies.node[p, : sub_bodies.count[p]]
            nodes[blade, chosen] = place[: len(chosen)]
    return nodes


def test_the_undeformed_lattice_is_that_of_one_body(turbines):
    _, one, several, nodes = turbines
    expected = lattice(one, one.system.initial_state(), len(nodes))
    found = lattice(several, several.system.initial_state(), len(nodes))
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_pieces_weigh_as_much_as_the_blade(turbines):
    _, one, several, _ = turbines
    for structure in (one, several):
        mass = sum(structure.system.bodies[body].inertia.mass for body in structure.parts[0])
        assert mass == pytest.approx(one.blade_inertia.mass, rel=1e-6)
    assert several.blade_inertia.j0 == pytest.approx(one.blade_inertia.j0, rel=1e-6)


def test_a_bent_piece_carries_those_behind_it(turbines):
    """The lattice turns rigidly behind a piece whose tip alone turns."""
    _, _, several, nodes = turbines
    y = several.system.initial_state()
    straight = lattice(several, y, len(nodes))[0]
    body = several.parts[0][0]
    q = several.system.index(body, "elastic_q")
    turn = several.system.bodies[body].markers["tip"].rotation[1]
    y[q + int(np.abs(turn).argmax())] = 0.1  # radians about y
    bent = lattice(several, y, len(nodes))[0]
    sub_bodies = several.sub_body_nodes
    outer = np.concatenate([row[:n] for row, n in zip(sub_bodies.node[1:], sub_bodies.count[1:], strict=True)])
    pairs = np.array([outer[:-1], outer[1:]])
    before, after = (np.linalg.norm(x[pairs[1]] - x[pairs[0]], axis=1) for x in (straight, bent))
    np.testing.assert_allclose(after, before, atol=1e-9)
    assert np.linalg.norm(bent[outer] - straight[outer], axis=1).max() > 5.0
