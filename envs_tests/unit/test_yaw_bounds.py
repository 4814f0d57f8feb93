"""What the yaw of a rotor can win: against the controller itself, every sequence of moves, and closed forms."""

import itertools
import math

import numpy as np
import pytest
from power_bounds import (
    Directions,
    Yawed,
    by_thresholds,
    directions_of,
    with_wind_known,
    with_wind_known_at,
)

from wt_gym.control import Demand
from wt_gym.control.controllers.additions import YawByDeadBand
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow, TurbulenceBox, TurbulentInflow

TURBINE = load_turbine("nrel_5mw")
RATE = math.radians(0.3)
RATED, EXPONENT = 11.4, 1.7


def winds(n=3, steps=400, dt=0.5, seed=0):
    """Directions that wander, with a vane that is noisy."""
    rng = np.random.default_rng(seed)
    mean = 0.2 * np.cumsum(rng.standard_normal((n, steps)), axis=1) * math.sqrt(dt / 60.0)
    rotor = mean + 0.05 * rng.standard_normal(mean.shape)
    vane = rotor + 0.1 * rng.standard_normal(mean.shape)
    return Directions(vane, rotor, mean, rng.uniform(6.0, 13.0, mean.shape), RATED, EXPONENT, dt, RATE)


def power(speed, error):
    """Of a wind at a yaw error."""
    return np.minimum(speed**3 * np.maximum(np.cos(error), 0.0) ** EXPONENT, RATED**3)


def test_thresholds_are_the_controller():
    found = winds()
    parameters = {"dead_band": 0.1, "stop": 0.03, "slow": 12.0, "fast": 3.0}
    energy = travel = 0.0
    for vane, rotor, speed in zip(found.vane, found.rotor, found.speed, strict=True):
        controller, yaw = YawByDeadBand(TURBINE, **parameters), 0.0
        controller.start({"yaw_error": vane[0]})
        for read, met, blown in zip(vane, rotor, speed, strict=True):
            rate = controller.step({"yaw_error": read - yaw}, found.dt, Demand(np.zeros(3), 0.0, 0.0)).yaw_rate
            yaw += rate * found.dt
            travel += abs(rate) * found.dt
            energy += power(blown, met - yaw)
    expected = Yawed(energy / found.most, travel / 3)
    assert expected.travel > 0.1
    np.testing.assert_allclose(by_thresholds(found, **parameters), expected, rtol=1e-12)


def test_every_sequence_of_moves_has_no_more_than_the_program():
    found, price = winds(1, 8, 20.0, seed=2), 0.05
    step = found.rate * found.dt
    best = max(
        float(np.sum(power(found.speed, found.rotor - step * np.cumsum(moves)))) / found.most
        - price * step * np.abs(moves).sum()
        for moves in itertools.product((-1, 0, 1), repeat=8)
    )
    at = with_wind_known(found, price)
    assert at.travel > 0.0
    assert at.energy - price * at.travel == pytest.approx(best, rel=1e-12)


def test_a_drive_that_costs_nothing_faces_a_direction_that_it_can_follow():
    dt = 0.5
    direction = RATE * dt * np.arange(1.0, 201.0)[None, :]
    found = Directions(direction, direction, direction, np.full_like(direction, 8.0), RATED, EXPONENT, dt, RATE)
    np.testing.assert_allclose(with_wind_known(found, 0.0), (1.0, direction[0, -1]), rtol=1e-9)
    still = with_wind_known(found, 1e3)
    np.testing.assert_allclose(still, (np.mean(np.cos(direction) ** EXPONENT), 0.0), rtol=1e-12)


def test_no_thresholds_have_more_energy_at_their_travel_than_the_wind_known():
    found = winds(6)
    for band, stop in ((0.05, 0.02), (0.1, 0.08), (0.2, 0.0)):
        for turbulence in (True, False):
            own = by_thresholds(found, band, stop, 8.0, 2.0, turbulence=turbulence)
            assert with_wind_known_at(found, own.travel).energy > own.energy


def test_the_wind_known_bounds_every_sequence_of_moves_up_to_its_travel():
    found = winds(1, 7, 20.0, seed=5)
    step = found.rate * found.dt
    for moves in itertools.product((-1, 0, 1), repeat=7):
        travel = step * np.abs(moves).sum()
        energy = float(np.sum(power(found.speed, found.rotor - step * np.cumsum(moves)))) / found.most
        if travel <= with_wind_known(found, 0.0).travel:
            at = with_wind_known_at(found, travel)
            assert at.travel >= travel
            assert at.energy >= energy - 1e-12


def test_a_rotor_in_strong_wind_needs_not_face_it():
    """Beyond rated, power is rated as long as U cos^(p/3) of the yaw error is above it."""
    direction = np.full((1, 50), 0.3)
    still = Directions(direction, direction, direction, np.full_like(direction, 13.0), RATED, EXPONENT, 0.5, RATE)
    np.testing.assert_allclose(with_wind_known(still, 1e-9), (1.0, 0.0), rtol=1e-12)


def test_more_travel_than_serves_is_refused():
    with pytest.raises(ValueError, match=r"travel must be at most .* rad, where energy ends to rise, got 50 rad"):
        with_wind_known_at(winds(), 50.0)


def test_directions_are_those_of_the_wind():
    """A steady wind has the direction by which it is turned, its mirror image the same."""
    steady = SteadyInflow(9.0, TURBINE.hub_height)
    draw = np.linspace(0.0, 0.3, 5)
    found = directions_of(TURBINE, [steady], [[draw]], 0.5, RATED, EXPONENT)
    for given in (found.vane, found.rotor, found.mean):
        np.testing.assert_allclose(given, [draw, draw], atol=1e-12)
    np.testing.assert_allclose(found.speed, 9.0, rtol=1e-12)
    assert found.most == pytest.approx(10 * 9.0**3)
    assert found.rate == TURBINE.nacelle.max_yaw_rate


def test_the_vane_turns_with_the_eddies_more_than_the_disc():
    box = TurbulenceBox.kaimal(9.0, TURBINE.hub_height, TURBINE.rotor_diameter, "B", seed=3)
    still = np.zeros(200)
    found = directions_of(TURBINE, [TurbulentInflow(box)], [[still]], 0.5, RATED, EXPONENT)
    np.testing.assert_allclose(found.vane[0], -found.vane[1], rtol=1e-12)
    np.testing.assert_allclose(found.mean, 0.0, atol=0.0)
    assert found.vane.std() > found.rotor.std() > 0.01
