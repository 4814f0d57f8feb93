"""Camber lines, polars and their blends against analytic airfoils; stall delayed by rotation."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.simulation.contract import fingerprint
from wt_gym.turbines import Airfoil, Polar, RotationalAugmentation, load_turbine
from wt_gym.turbines.airfoil import blend_airfoils, blend_polars, camber_line


def naca4_camber(x: np.ndarray, m: float, p: float) -> tuple[np.ndarray, np.ndarray]:
    """Camber and slope of the NACA 4-digit series (Abbott and von Doenhoff, section 6.4)."""
    front = x < p
    camber = np.where(front, m / p**2 * (2 * p * x - x**2), m / (1 - p) ** 2 * (1 - 2 * p + 2 * p * x - x**2))
    slope = np.where(front, 2 * m / p**2 * (p - x), 2 * m / (1 - p) ** 2 * (p - x))
    return camber, slope


def naca4_contour(m: float, p: float, t: float, n: int = 80, normal: bool = True) -> np.ndarray:
    """Contour with the thickness laid off across the camber line (as NACA does) or vertically."""
    x = 0.5 * (1 - np.cos(np.linspace(0, np.pi, n)))
    half = 5 * t * (0.2969 * np.sqrt(x) - 0.126 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1036 * x**4)
    camber, slope = naca4_camber(x, m, p)
    angle = np.arctan(slope) if normal else np.zeros(n)
    upper = np.column_stack((x - half * np.sin(angle), camber + half * np.cos(angle)))
    lower = np.column_stack((x + half * np.sin(angle), camber - half * np.cos(angle)))
    contour = np.vstack((upper[::-1], lower[1:]))
    contour[:, 0] = (contour[:, 0] - contour[:, 0].min()) / np.ptp(contour[:, 0])
    return contour


@pytest.mark.parametrize(("m", "p", "t"), [(0.02, 0.4, 0.12), (0.04, 0.4, 0.15), (0.06, 0.3, 0.30), (0.0, 0.4, 0.21)])
def test_camber_line_of_vertical_thickness_is_exact(m, p, t):
    x, camber, thickness = camber_line(naca4_contour(m, p, t, normal=False))
    np.testing.assert_allclose(camber, naca4_camber(x, m, p)[0], atol=2e-4)
    assert thickness == pytest.approx(t, rel=2e-3)


def test_camber_of_a_circle_and_of_its_stretched_forms_is_zero():
    angle = np.linspace(0, 2 * np.pi, 101)
    for height in (1.0, 0.6):
        contour = np.column_stack((0.5 + 0.5 * np.cos(angle), 0.5 * height * np.sin(angle)))
        _, camber, thickness = camber_line(contour)
        np.testing.assert_allclose(camber, 0.0, atol=1e-12)
        assert thickness == pytest.approx(height, rel=2e-3)


def test_blunt_trailing_edge_keeps_the_mean_of_its_corners():
    contour = naca4_contour(0.03, 0.4, 0.2, normal=False)
    opened = contour.copy()
    nose = np.argmin(contour[:, 0])
    opened[: nose + 1, 1] += 0.02 * contour[: nose + 1, 0]
    opened[nose:, 1] -= 0.02 * contour[nose:, 0]
    closed = np.vstack(([1.0, 0.0], opened, [1.0, 0.0]))
    x, camber, _ = camber_line(opened)
    np.testing.assert_allclose(camber, naca4_camber(x, 0.03, 0.4)[0], atol=3e-4)
    np.testing.assert_allclose(camber_line(closed)[1][:-1], camber[:-1], atol=1e-12)


def test_slope_of_the_camber_line():
    contour = naca4_contour(0.04, 0.4, 0.12, n=400, normal=False)
    x, camber, thickness = camber_line(contour)
    airfoil = Airfoil("4412", thickness, contour, x, camber, flat_polar())
    at = np.array([0.1, 0.25, 0.5, 0.8])
    np.testing.assert_allclose(airfoil.camber_at(at)[1], naca4_camber(at, 0.04, 0.4)[1], atol=3e-3)
    with pytest.raises(TurbineDefinitionError, match="x_c"):
        airfoil.camber_at(1.2)
    with pytest.raises(TurbineDefinitionError, match=r"airfoil '4412': Airfoil\.relative_thickness must be .*, got 2"):
        Airfoil("4412", 2.0, contour, x, camber, flat_polar())


def flat_polar(scale: float = 1.0) -> Polar:
    alpha = np.radians(np.linspace(-180, 180, 73))
    return Polar(alpha, scale * np.sin(2 * alpha), scale * (1 - np.cos(2 * alpha)), scale * 0.1 * np.sin(alpha))


def test_polar_is_periodic_exact_at_its_points_and_linear_between():
    polar, angle = flat_polar(), np.linspace(-20.0, 20.0, 101)
    np.testing.assert_allclose(polar.coefficients(angle), polar.coefficients(angle + 2 * np.pi), atol=1e-10)
    np.testing.assert_array_equal(polar.coefficients(polar.alpha)[0], polar.cl)
    middle = 0.5 * (polar.alpha[1:] + polar.alpha[:-1])
    np.testing.assert_allclose(polar.coefficients(middle)[1], 0.5 * (polar.cd[1:] + polar.cd[:-1]), atol=1e-14)
    assert polar.coefficients(np.zeros((2, 3)))[2].shape == (2, 3)


def test_blend_of_polars_on_different_grids_is_linear_everywhere():
    alpha = np.radians(np.linspace(-180, 180, 50))
    first, second = flat_polar(), Polar(alpha, np.cos(alpha), 0.1 + 0 * alpha, 0 * alpha)
    mixed = blend_polars(first, second, 0.3)
    at = np.linspace(-np.pi, np.pi, 999)
    for a, b, c in zip(first.coefficients(at), second.coefficients(at), mixed.coefficients(at), strict=True):
        np.testing.assert_allclose(c, 0.7 * a + 0.3 * b, atol=1e-12)
    assert blend_polars(first, second, 0.0) is first
    assert blend_polars(first, second, 1.0) is second


def test_blend_of_airfoils_is_linear_in_camber_and_thickness():
    sections = []
    for m, t in ((0.02, 0.12), (0.04, 0.20)):
        contour = naca4_contour(m, 0.4, t, normal=False)
        x, camber, thickness = camber_line(contour)
        sections.append(Airfoil(f"naca {m}", thickness, contour, x, camber, flat_polar(1 + m)))
    half = blend_airfoils(*sections, 0.5)
    np.testing.assert_allclose(half.camber, naca4_camber(half.camber_x, 0.03, 0.4)[0], atol=2e-4)
    assert camber_line(half.contour)[2] == pytest.approx(0.16, rel=5e-3)
    assert half.relative_thickness == pytest.approx(0.16, rel=5e-3)


@pytest.mark.parametrize(
    ("change", "named"),
    [({"alpha": np.radians(np.linspace(-90, 90, 5))}, "Polar.alpha"), ({"cd": [0, np.nan, 0, 0, 0]}, r"Polar.cd\[1\]")],
)
def test_wrong_polars_are_refused(change, named):
    good = {"alpha": np.radians(np.linspace(-180, 180, 5)), "cl": np.zeros(5), "cd": np.zeros(5), "cm": np.zeros(5)}
    with pytest.raises(TurbineDefinitionError, match=named):
        Polar(**(good | change))


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
def test_factors_of_rotation_by_hand(model, factor):
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
