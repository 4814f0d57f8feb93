"""What the case of all formulations in the environment compares, and how it judges."""

from dataclasses import replace

import numpy as np
import pytest

from envs_tests.physics.cases import formulations as module
from wt_gym.simulation import FIDELITIES, Simulator
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow

KNOWN = {combination.label: combination for combination in module.COMBINATIONS}
IDS = {"NREL5MW": "nrel_5mw", "IEA15MW": "iea_15mw"}


def test_parked_frequencies_are_those_of_the_linear_model():
    """Both for bodies that the linear model can describe; without damping the frequencies are a little higher."""
    turbine = load_turbine("nrel_5mw")
    model = Simulator(turbine, SteadyInflow(8.0)).linearize(
        rotor_speed=0.0, aerodynamics="none", generator="locked", outputs=("rotor_speed",)
    )
    expected = np.sort([mode.frequency for mode in model.modes() if mode.frequency > 0.0])[: module.LOWEST]
    np.testing.assert_allclose(module.parked_frequencies(turbine, FIDELITIES["training"]), expected, rtol=2e-4)


@pytest.mark.parametrize("pair", module.NODAL_AND_MODAL, ids=lambda pair: pair[0])
def test_nodal_blades_vibrate_as_modal_ones(pair):
    turbine = load_turbine(IDS[pair[0]])
    nodal, modal = (module.parked_frequencies(turbine, KNOWN[f"{pair[0]}, {name}"].fidelity) for name in pair[1:])
    np.testing.assert_allclose(nodal, modal, rtol=5e-3)
    assert np.abs(nodal / modal - 1.0).max() > 1e-5  # other elements, other coordinates


def test_frequencies_that_no_tree_describes_are_left_out():
    turbine = load_turbine("nrel_5mw")
    training = FIDELITIES["training"]
    for change in ({"formulation": "constrained"}, {"formulation": "observer", "reference_condition": "three_quarter"}):
        assert module.parked_frequencies(turbine, replace(training, **change)) is None


@pytest.mark.parametrize(
    ("ending", "change", "failed"),
    [
        (None, {}, ["power against"]),
        (None, {"failure": "overspeed"}, ["end early", "power against"]),
        ("tower_strike", {"failure": "tower_strike"}, ["power against"]),
        ("tower_strike", {}, ["end otherwise than by tower_strike", "power against"]),
        (None, {"repeats": False, "power": 100.4}, ["do not repeat"]),
    ],
)
def test_what_passes(ending, change, failed):
    default = {"failure": None, "repeats": True, "ms": 1.0, "power": 100.0, "flap_DEL": 1.0, "tip": 1.0,
               "frequencies": None}  # fmt: skip
    combination = module.Combination("NREL5MW", "some", FIDELITIES["training"], ending=ending)
    checks, line = module.compare(combination, default | {"power": 101.0} | change, default)
    found = [check.quantity for check in checks if not check.passed]
    assert len(found) == len(failed)
    assert all(text in quantity for text, quantity in zip(failed, found, strict=True))
    assert line.startswith("NREL5MW, some: 1.00, +")
