"""Steady wind: exact profiles, signs of the angles, refusals."""

import dataclasses
import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wt_gym.base.errors import InflowError
from wt_gym.wind import Inflow, SteadyInflow

HEIGHTS = np.array([1.0, 10.0, 27.0, 90.0, 153.0, 400.0])
COLUMN = np.column_stack([np.zeros_like(HEIGHTS), np.zeros_like(HEIGHTS), HEIGHTS])


def test_uniform_wind_blows_along_x_everywhere():
    inflow = SteadyInflow(8.0)
    points = np.random.default_rng(0).normal(scale=200.0, size=(4, 5, 3))
    velocity = inflow.velocity(points, 3.0)
    assert velocity.shape == (4, 5, 3)
    assert velocity.dtype == np.float64
    np.testing.assert_array_equal(velocity, np.broadcast_to([8.0, 0.0, 0.0], (4, 5, 3)))


def test_power_law():
    velocity = SteadyInflow(11.4, 90.0, shear_exponent=0.14).velocity(COLUMN, 0.0)
    np.testing.assert_allclose(velocity[:, 0], 11.4 * (HEIGHTS / 90.0) ** 0.14, rtol=1e-13)
    np.testing.assert_array_equal(velocity[:, 1:], 0.0)


def test_logarithmic_profile():
    velocity = SteadyInflow(11.4, 90.0, roughness_length=0.03).velocity(COLUMN, 0.0)
    expected = 11.4 * np.log(HEIGHTS / 0.03) / np.log(90.0 / 0.03)
    np.testing.assert_allclose(velocity[:, 0], expected, rtol=1e-13)


@pytest.mark.parametrize("profile", [{"shear_exponent": 0.2}, {"roughness_length": 0.03}])
def test_sheared_wind_is_zero_in_the_ground(profile):
    points = np.array([[0.0, 0.0, 0.0], [5.0, 3.0, -1e-9], [0.0, 0.0, -200.0]])
    np.testing.assert_array_equal(SteadyInflow(8.0, **profile).velocity(points, 0.0), 0.0)


def test_positive_yaw_misalignment_turns_the_wind_to_the_left():
    angle = math.radians(20.0)
    velocity = SteadyInflow(8.0, yaw_misalignment=angle).velocity([0.0, 0.0, 90.0], 0.0)
    np.testing.assert_allclose(velocity, [8.0 * math.cos(angle), 8.0 * math.sin(angle), 0.0], rtol=1e-14)
    assert velocity[1] > 0.0  # +y is left looking downwind: counter-clockwise from above


def test_veer_turns_counter_clockwise_with_height():
    inflow = SteadyInflow(8.0, 90.0, veer=0.002, yaw_misalignment=0.1)
    velocity = inflow.velocity(COLUMN, 0.0)
    direction = np.arctan2(velocity[:, 1], velocity[:, 0])
    np.testing.assert_allclose(direction, 0.1 + 0.002 * (HEIGHTS - 90.0), rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(velocity, axis=1), 8.0)


def test_positive_inclination_rises_and_keeps_the_magnitude():
    velocity = SteadyInflow(8.0, inclination=math.radians(8.0), yaw_misalignment=0.3).velocity([0.0, 0.0, 90.0], 0.0)
    assert velocity[2] == pytest.approx(8.0 * math.sin(math.radians(8.0)))
    assert np.linalg.norm(velocity) == pytest.approx(8.0)
    assert math.atan2(velocity[1], velocity[0]) == pytest.approx(0.3)


def test_rotor_effective_speed():
    assert SteadyInflow(8.0).rotor_effective_speed(0.0, 126.0) == pytest.approx(8.0)
    # second-order mean of a power law over the disc: 1 + a (a - 1) / 8 (R/H)^2, next term fourth order
    a, ratio = 0.2, 20.0 / 90.0
    mean = SteadyInflow(8.0, 90.0, shear_exponent=a).rotor_effective_speed([0.0, 1.0], 40.0)
    np.testing.assert_allclose(mean, 8.0 * (1.0 + a * (a - 1.0) / 8.0 * ratio**2), rtol=1e-4)


def test_any_leading_shape():
    inflow = SteadyInflow(8.0, shear_exponent=0.2)
    assert inflow.velocity([0, 0, 90], 0).tolist() == pytest.approx([8.0, 0.0, 0.0])
    assert inflow.velocity(np.empty((0, 3)), 0.0).shape == (0, 3)
    points = np.random.default_rng(1).uniform(1.0, 200.0, size=(3, 4, 2, 3))
    strided = points[::-1, :, ::-1]
    np.testing.assert_array_equal(inflow.velocity(strided, 0.0), inflow.velocity(points, 0.0)[::-1, :, ::-1])


@pytest.mark.parametrize(
    ("points", "time"),
    [
        ([0.0, 0.0, math.nan], 0.0),
        ([[0.0, 0.0, 90.0], [math.inf, 0.0, 90.0]], 0.0),
        ([0.0, 0.0, 90.0], math.nan),
        ([0.0, 0.0, 90.0], math.inf),
        ([0.0, 0.0, 90.0], "noon"),
        ([0.0, 90.0], 0.0),
        (90.0, 0.0),
        ("abc", 0.0),
    ],
)
def test_points_and_times_that_make_no_sense_are_refused(points, time):
    with pytest.raises(InflowError):
        SteadyInflow(8.0, shear_exponent=0.2).velocity(points, time)


def test_refusal_names_the_point():
    with pytest.raises(InflowError, match=r"point 1 of 2 is \[0\.0, nan, 90\.0\]"):
        SteadyInflow(8.0).velocity([[0.0, 0.0, 90.0], [0.0, math.nan, 90.0]], 0.0)


@pytest.mark.parametrize(
    "arguments",
    [
        {"speed": -1.0},
        {"speed": math.nan},
        {"speed": "fast"},
        {"speed": 8.0, "hub_height": 0.0},
        {"speed": 8.0, "shear_exponent": -1.1},
        {"speed": 8.0, "jet_height": 30.0},
        {"speed": 8.0, "jet_height": 100.0, "jet_share": 0.0},
        {"speed": 8.0, "roughness_length": 0.0},
        {"speed": 8.0, "roughness_length": 90.0},
        {"speed": 8.0, "shear_exponent": 0.2, "roughness_length": 0.03},
        {"speed": 8.0, "yaw_misalignment": 20.0},
        {"speed": 8.0, "inclination": 8.0},
        {"speed": 8.0, "veer": 1.0},
    ],
)
def test_parameters_out_of_range_are_refused(arguments):
    with pytest.raises(InflowError):
        SteadyInflow(**arguments)


def test_value_semantics():
    inflow = SteadyInflow(8, shear_exponent=0.2, yaw_misalignment=0.1)
    assert inflow == SteadyInflow(8.0, 90.0, 0.2, yaw_misalignment=0.1)
    assert hash(inflow) == hash(dataclasses.replace(inflow))
    assert pickle.loads(pickle.dumps(inflow)) == inflow
    assert isinstance(inflow, Inflow)
    assert inflow.mean_speed == 8.0
    assert inflow.description == ("steady 8 m/s at 90 m, power-law profile (exponent 0.2), yaw misalignment 5.73 deg")
    with pytest.raises(dataclasses.FrozenInstanceError):
        inflow.speed = 9.0


@settings(max_examples=50, deadline=None)
@given(
    st.floats(0.0, 80.0),
    st.floats(0.0, 1.0),
    st.floats(-0.05, 0.05),
    st.floats(-math.pi, math.pi),
    st.floats(-1e6, 1e6),
)
def test_wind_is_always_finite(speed, exponent, veer, yaw, height):
    inflow = SteadyInflow(speed, 90.0, exponent, veer=veer, yaw_misalignment=yaw)
    assert np.isfinite(inflow.velocity([1e6, -1e6, height], 1e9)).all()
