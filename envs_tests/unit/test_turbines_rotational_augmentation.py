"""Stall delayed by rotation: the factors of the models, where they act, and which polars are corrected."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.simulation.contract import fingerprint
from wt_gym.turbines import Polar, RotationalAugmentation, load_turbine

RADIUS, RATIO = 5.0, 5.4


def stalled_polar():
    """Slope 2π from -2 degrees to a maximum of 1.2, which it keeps: a polar without noise."""
    alpha = np.radians(np.concatenate(([-180.0], np.arange(-60.0, 61.0), [180.0])))
    cl = np.clip(2.0 * np.pi * (alpha + np.radians(2.0)), -0.8, 1.2)
    cl[[0, -1]] = 0.0
    return Polar(alpha, cl, 0.01 + np.sin(alpha) ** 2, 0.0 * alpha)


@pytest.mark.parametrize(
    ("model", "factor"),
    [
        # Λ = 0.98329, E = 2.0340, 0.2^E = 0.037868: (2.52565 · 0.962132 / 1.037868 - 1) / 2π
        ("du-selig", 0.21348),
        # 3.1 · 0.04 · 2.7² / (1 + 2.7²)
        ("snel", 0.109042),
        # 3 · 0.04
        ("snel-1993", 0.12),
    ],
)
def test_factors_by_hand(model, factor):
    obtained = RotationalAugmentation(model, RADIUS, RATIO).factor(chord=0.5, radius=2.5, slope=2.0 * np.pi)
    assert obtained == pytest.approx(factor, rel=1e-4)


@pytest.mark.parametrize("model", ["du-selig", "snel", "snel-1993"])
def test_lift_and_drag_of_a_section_in_rotation(model):
    polar, augmentation = stalled_polar(), RotationalAugmentation(model, RADIUS, RATIO)
    rotating = augmentation.of(polar, 0.5, 2.5)
    g = augmentation.factor(0.5, 2.5, 2.0 * np.pi)
    alpha = np.radians([-40.0, -10.0, -2.0, 5.0, 20.0, 30.0, 42.5, 55.0, 90.0])
    share = np.array([0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.5, 0.0, 0.0])  # attached at 5 degrees: nothing to gain
    cl, cd, cm = rotating.coefficients(alpha)
    before, drag, _ = polar.coefficients(alpha)
    gained = g * share * (2.0 * np.pi * (alpha + np.radians(2.0)) - before)
    np.testing.assert_allclose(cl, before + gained, atol=2e-4)
    # Eggers at 20 degrees: (0.342020 - 0.12 · 0.939693) / (0.939693 + 0.12 · 0.342020) = 0.233764
    eggers = 0.233764 * gained[4] if model == "du-selig" else 0.0
    assert cd[4] - drag[4] == pytest.approx(eggers, abs=1e-5)
    np.testing.assert_array_equal(cm, 0.0)


def test_only_inboard_sections_with_lift_are_corrected():
    augmentation, polar = RotationalAugmentation("snel", RADIUS, RATIO), stalled_polar()
    assert augmentation.of(polar, 0.5, 0.81 * RADIUS) is polar
    cylinder = Polar(polar.alpha, 0.0 * polar.alpha, polar.cd, polar.cm)
    assert augmentation.of(cylinder, 0.5, 1.0) is cylinder
    # never more lift than attached flow has, however close to the axis
    assert augmentation.factor(chord=2.0, radius=1.0, slope=6.0) == 1.0


def test_turbines_tell_whether_their_polars_hold_rotation():
    """The NREL 5-MW polars were corrected with Selig & Eggers; those of the IEA 15-MW say that they were not."""
    nrel, iea = load_turbine("nrel_5mw"), load_turbine("iea_15mw")
    with pytest.raises(TurbineDefinitionError, match="hold the delay of stall by rotation"):
        nrel.with_rotational_augmentation("snel")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rotating = iea.with_rotational_augmentation()
    assert rotating.blade.augmentation.tip_speed_ratio == pytest.approx(9.0, abs=0.01)
    stalled = np.radians(20.0)
    gain = [
        float(rotating.blade.polar_at(z).coefficients(stalled)[0] - iea.blade.polar_at(z).coefficients(stalled)[0])
        for z in (15.0, 25.0, 40.0, 100.0)
    ]
    assert gain[0] > gain[1] > gain[2] > gain[3] == 0.0
    assert fingerprint(rotating) != fingerprint(iea)  # no snapshot of the other fits
    with pytest.raises(TurbineDefinitionError, match="hold the delay"):
        rotating.with_rotational_augmentation("snel")
    with pytest.raises(TurbineDefinitionError, match="hold the delay"):
        replace(nrel.blade, augmentation=rotating.blade.augmentation)


def test_polars_of_unknown_origin_are_corrected_with_a_warning():
    iea = load_turbine("iea_15mw")
    unknown = replace(iea, blade=replace(iea.blade, rotating_polars=None))
    with pytest.warns(UserWarning, match="taken as two-dimensional"):
        rotating = unknown.with_rotational_augmentation("snel", tip_speed_ratio=8.0)
    assert "taken as two-dimensional" in rotating.notes[-1]
    assert rotating.blade.augmentation == RotationalAugmentation("snel", 0.5 * iea.rotor_diameter, 8.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"model": "lindenburg"}, "'du-selig'"),
        ({"tip_speed_ratio": 0.0}, "tip_speed_ratio"),
        ({"rotor_radius": -1.0}, "rotor_radius"),
    ],
)
def test_refusals(change, message):
    with pytest.raises(TurbineDefinitionError, match=message):
        RotationalAugmentation(**({"model": "snel", "rotor_radius": RADIUS, "tip_speed_ratio": RATIO} | change))
