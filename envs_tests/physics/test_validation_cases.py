"""Fast validation cases, and fast parts of the slow ones, against exact and published numbers."""

import numpy as np
import pytest

from envs_tests.physics.cases.beams import BarChain, bathe_displacement, exact_rod
from envs_tests.physics.cases.rotating_beams import (
    spinning_beam,
    spinning_frequencies,
    tapered_sections,
    uniform_sections,
)
from envs_tests.physics.cases.small_turbine import Disc, simulate, small_turbine
from envs_tests.physics.cases.tools import NoBalance, frequencies, static_balance
from envs_tests.physics.validation import load_cases, read_table, run_case
from wt_gym.multibody.system import Joint, MultibodySystem
from wt_gym.structure.beam import Beam, BeamSections
from wt_gym.structure.flexible_body import FlexibleBody
from wt_gym.structure.substructure import add_chain, cut_beam, sub_body_at, tip_and_interior_modes

FAST_CASES = (
    "beam-static",
    "beam-free-vibration",
    "circular-element",
    "heavy-top-precession",
    "nodal-geometric-stiffness",
    "parked-nrel-5mw",
    "roll-up",
    "simple-pendulum",
    "southwell",
    "spatial-slider-crank",
    "spin-up",
    "structural-damping",
    "mixed-coordinates",
)


@pytest.mark.parametrize("name", FAST_CASES)
def test_case(name):
    result = run_case(load_cases()[name])
    assert result.checks
    failed = [f"{c.quantity}: expected {c.expected}, obtained {c.obtained:.6g}" for c in result.checks if not c.passed]
    assert not failed, "\n".join(failed)


def all_passes(name):
    return run_case(load_cases()[name]).passed


@pytest.mark.slow
@pytest.mark.parametrize("name", ["iea-15mw-blade-static", "iea-15mw-blade-dynamic"])
def test_slow_case(name):
    assert all_passes(name)


@pytest.mark.parametrize("coordinates", ["modal", "nodal"])
@pytest.mark.parametrize(("delta", "eta"), [(0.0, 6.0), (0.0, 12.0), (0.1, 6.0), (1.0, 10.0), (5.0, 12.0)])
def test_rotating_cantilever(coordinates, delta, eta):
    """Flap 1–3 (and lag 1 without a hub) of the published tables within 0.5 %."""
    flap, lag = spinning_frequencies(spinning_beam(uniform_sections(), coordinates, delta), eta)
    if delta == 0.0:
        table, columns = read_table("rotating_uniform_cantilever.csv")
        row = table[table[:, 0] == eta][0]
        expected = row[1:4]
        assert lag[0] == pytest.approx(row[columns.index("lag1")], rel=0.005)
    else:
        table, _ = read_table("rotating_uniform_cantilever_hub_offset.csv")
        expected = table[(table[:, 0] == delta) & (table[:, 1] == eta)][0, 2:5]
    np.testing.assert_allclose(flap[:3], expected, rtol=0.005)


@pytest.mark.parametrize("coordinates", ["modal", "nodal"])
def test_rotating_tapered_cantilever(coordinates):
    table, _ = read_table("rotating_tapered_cantilever.csv")
    model = spinning_beam(tapered_sections(), coordinates)
    for row in table[[0, 6, 12]]:
        np.testing.assert_allclose(spinning_frequencies(model, row[0])[0][:3], row[1:4], rtol=0.005)


def test_bathe_bend_with_eight_bodies():
    """Published tip displacements (−13.4 … −13.6, −23.5 … −23.7, 53.4 … 53.5) within 2 %."""
    moved = bathe_displacement(8, 1)
    np.testing.assert_allclose(moved[[0, 2, 1]], [-13.5, -23.6, 53.45], rtol=0.02)


class TestSubstructure:
    """A beam cut into bodies behaves as the whole for small motions, and bad cuts are refused."""

    @staticmethod
    def sections():
        return BeamSections.uniform(12.0, EA=3e8, EIx=5e6, EIy=2e6, GJ=1e6, mass=20.0, Ix=0.4, Iy=0.9)

    @pytest.mark.parametrize(("coordinates", "n_modes"), [("nodal", 0), ("modal", 100)])
    def test_small_vibrations_are_those_of_the_whole_beam(self, coordinates, n_modes):
        """The chain has the same degrees of freedom, so that its frequencies are those of the uncut matrices."""
        from scipy.linalg import eigh

        beam = Beam(self.sections(), 6)
        expected = np.sqrt(eigh(beam.stiffness[6:, 6:], beam.mass[6:, 6:], eigvals_only=True))
        sub_bodies = cut_beam("beam", self.sections(), 6, 3, coordinates, n_modes)
        system = MultibodySystem((0.0, 0.0, 0.0))
        add_chain(system, sub_bodies, Joint("fixed"))
        found = frequencies(system.build(), system.initial_state(), step=1e-6)
        np.testing.assert_allclose(found[:12], expected[:12], rtol=1e-5)

    def test_given_cuts_and_owners(self):
        sub_bodies = cut_beam("beam", self.sections(), np.array([0.0, 1.0, 4.0, 6.0, 12.0]), [4.0, 6.0])
        assert [(p.start, p.end) for p in sub_bodies] == [(0.0, 4.0), (4.0, 6.0), (6.0, 12.0)]
        assert [sub_body_at(sub_bodies, s) for s in (0.0, 3.9, 4.0, 12.0)] == [0, 0, 1, 2]
        marker = sub_bodies[2].marker(9.0, (0.1, 0.0, 0.0))
        np.testing.assert_allclose(marker.position, [0.1, 0.0, 3.0])

    def test_static_shapes_of_the_tip_and_their_damping(self):
        """Between fixed ends, Hermite's cubics: a unit shift of the tip bends by 3 x² - 2 x³, a turn by L (x³ - x²)."""
        shapes = tip_and_interior_modes(Beam(self.sections(), 4), 0)
        x = np.array([0.25, 0.5, 0.75, 1.0])
        np.testing.assert_allclose(shapes[6::6, 0], 3.0 * x**2 - 2.0 * x**3)
        np.testing.assert_allclose(shapes[6::6, 4], 12.0 * (x**3 - x**2), atol=1e-12)
        np.testing.assert_allclose(shapes[-6:], np.eye(6))
        assert tip_and_interior_modes(Beam(self.sections(), 1), 3).shape == (12, 6)
        whole = tip_and_interior_modes(Beam(self.sections(), 4), 5)
        assert whole.shape == (30, 11)
        assert not whole[-6:, 6:].any()  # the rest vibrate between fixed ends
        damped = cut_beam("beam", self.sections(), 4, 2, stiffness_damping=0.1)[1].body
        np.testing.assert_allclose(damped.damping, 0.1 * damped.stiffness)

    def test_bad_input_is_refused(self):
        with pytest.raises(ValueError, match="not a node"):
            cut_beam("beam", self.sections(), 4, [5.0])
        with pytest.raises(ValueError, match="must have 1 … 4 sub-bodies"):
            cut_beam("beam", self.sections(), 4, 5)
        with pytest.raises(ValueError, match="must increase"):
            cut_beam("beam", self.sections(), 4, [6.0, 3.0])
        with pytest.raises(ValueError, match="'nodal' or 'modal'"):
            cut_beam("beam", self.sections(), 4, 2, "exact")
        sub_bodies = cut_beam("beam", self.sections(), 4, 2)
        with pytest.raises(ValueError, match="outside"):
            sub_body_at(sub_bodies, 13.0)
        with pytest.raises(ValueError, match="outside"):
            sub_body_at(sub_bodies, -0.1)
        with pytest.raises(ValueError, match="outside the sub-body"):
            sub_bodies[1].marker(5.9)
        assert sub_body_at(sub_bodies, 6.0 - 5e-10) == 1  # rounding of the cut belongs to the outer piece
        with pytest.raises(ValueError, match="outside the sub-body"):
            sub_bodies[0].marker(9.0)


class TestReferenceSolutions:
    """The reference solutions of the large-deflection cases against closed forms."""

    def test_rod_rolls_into_a_circle(self):
        sections = BeamSections.uniform(2.0, EA=1e9, EIx=1.0, EIy=1.0, GJ=1.0, mass=1.0, Ix=0.01, Iy=0.01)
        moment = 0.75 * np.pi  # curvature 3π/4 over 2 m: three quarters of a circle
        _, position, _ = exact_rod(sections, tip_moment=(0.0, moment, 0.0), n=200)
        radius = 1.0 / moment
        np.testing.assert_allclose(position[-1], [radius, 0.0, -radius], atol=1e-3)

    def test_rod_gives_the_linear_deflection_under_small_loads(self):
        sections = BeamSections.uniform(2.0, EA=1e9, EIx=3.0, EIy=2.0, GJ=1.0, mass=1.0, Ix=0.01, Iy=0.01)
        _, position, _ = exact_rod(
            sections, lambda s: np.array([1e-4, 0.0, 0.0]), (0.0, 1e-4, 0.0), n=200, load_steps=1
        )
        assert position[-1, 0] == pytest.approx(1e-4 * 2.0**4 / (8 * 2.0), rel=1e-3)
        assert position[-1, 1] == pytest.approx(1e-4 * 2.0**3 / (3 * 3.0), rel=1e-3)

    def test_bar_chain_is_the_elastica(self):
        """Cantilever with P L²/EI = 2: tip at 0.49346 L across, 0.83933 L along (Bisshopp & Drucker 1945)."""
        chain = BarChain(1.0, lambda s: 1.0 + 0.0 * s, lambda s: 1.0 + 0.0 * s, 200)
        force = np.zeros(200)
        force[-1] = 2.0
        across, along = chain.tip(chain.static(force))
        assert across == pytest.approx(0.49346, rel=1e-3)
        assert along == pytest.approx(0.83933, rel=1e-3)

    def test_bar_chain_vibrates_like_a_cantilever(self):
        chain = BarChain(1.0, lambda s: 1.0 + 0.0 * s, lambda s: 1.0 + 0.0 * s, 16)
        times = np.linspace(0.0, 3.6, 721)
        force = 1e-3 * chain.lump(lambda s: s**2)
        tip = chain.tip(chain.simulate(chain.static(force), times))[0]
        down = np.flatnonzero((tip[:-1] > 0.0) & (tip[1:] <= 0.0))
        crossing = times[down] + tip[down] / (tip[down] - tip[down + 1]) * 0.005
        assert np.diff(crossing)[0] == pytest.approx(2.0 * np.pi / 3.51602, rel=0.02)


def test_no_balance_is_an_error():
    """A pendulum under a moment larger than weight times arm has no position of rest."""
    system = MultibodySystem()
    bob = FlexibleBody.rigid("bob", 1.0, (0.0, 0.0, -1.0), np.zeros((3, 3)))
    system.add(bob, Joint("revolute", (0.0, 1.0, 0.0), name="swing"))
    system.build()

    def push(_, inputs, work):
        inputs.body_loads[:, 0, 4] = 20.0

    with pytest.raises(NoBalance, match="did not settle"):
        static_balance(system, system.initial_state(), push)


def test_mixed_coordinates_equal_eliminated_constraints():
    """Cartesian nacelle and rotor with multipliers move as the ones carried by joints."""
    speed = Disc().speed
    first = simulate(small_turbine(speed=speed), 0.05)
    second = simulate(small_turbine(reference="joint", speed=speed), 0.05)
    size = np.abs(first[1]).max()
    np.testing.assert_allclose(first[1], second[1], atol=1e-5 * size)
    np.testing.assert_allclose(first[2], second[2], rtol=1e-6)


@pytest.mark.parametrize(("tower", "blades"), [("rigid", "rigid"), ("nodal", "modal"), ("modal", "rigid")])
def test_every_body_takes_every_coordinates(tower, blades):
    model = small_turbine(tower, blades, "joint", speed=20.0, tower_elements=2)
    _, nacelle, speed, _ = simulate(model, 0.01)
    assert np.isfinite(speed).all()
    assert (np.abs(nacelle).max() == 0.0) == (tower == "rigid")
