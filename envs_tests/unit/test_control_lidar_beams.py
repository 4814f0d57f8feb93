"""Lidar with its beams apart: what each one reads, their order, records, and what controllers make of them."""

import math
from dataclasses import asdict, replace

import gymnasium as gym
import numpy as np
import pytest

from wt_gym.bridges.openfast import PointLidar
from wt_gym.control import Lidar
from wt_gym.control.bladed.records import channels_read, new_swap, write_lidar
from wt_gym.control.controllers import WithLidar
from wt_gym.envs.lidar import LIDAR_NOISE, lidar_noise
from wt_gym.experiment.agents import ObservedSignals
from wt_gym.simulation.contract import fingerprint
from wt_gym.wind import SteadyInflow, TurbulenceBox, TurbulentInflow

ID = "wt_gym/NREL5MW-Turbulent-v1"
HUB = 90.0
APART = Lidar((30.0, 120.0), n_beams=5, apart=True)


@pytest.fixture(scope="module")
def turbulent():
    box = TurbulenceBox.kaimal(16.0, HUB, 126.0, "B", seed=5)
    return TurbulentInflow(box, SteadyInflow(16.0, HUB, shear_exponent=0.2))


def test_the_mean_over_the_beams_is_what_a_gate_reads(turbulent):
    for lidar in (APART, replace(APART, frozen=True)):
        seen = lidar.read(turbulent, 20.0, 0.3, HUB)
        assert seen.shape == (lidar.n_readings,) == (10,)
        assert np.ptp(seen[:5]) > 0.1
        expected = replace(lidar, apart=False).read(turbulent, 20.0, 0.3, HUB)
        np.testing.assert_allclose(lidar.gate_means(seen), expected, rtol=1e-12)


def test_shear_is_seen_by_the_upper_and_the_lower_beam():
    lidar, tangent = Lidar((100.0,), 0.3, apart=True), math.tan(0.3)
    up, right, down, left = lidar.read(SteadyInflow(10.0, HUB, shear_exponent=0.2), 0.0, 0.0, HUB)
    assert up == pytest.approx(10.0 * ((HUB + 100.0 * tangent) / HUB) ** 0.2)
    assert down == pytest.approx(10.0 * ((HUB - 100.0 * tangent) / HUB) ** 0.2)
    assert (right, left) == pytest.approx((10.0, 10.0))


@pytest.mark.parametrize(("rotation", "side"), [("clockwise", 1.0), ("counter-clockwise", -1.0)])
def test_beams_count_in_the_sense_of_rotation(rotation, side):
    """Seen looking downwind, the second of four looks to the right where the rotor turns clockwise."""
    lidar = Lidar((100.0,), 0.3, apart=True)
    # the nacelle is turned to the right, so that the wind blows to its left: towards the beam to the left it is slower
    _, second, _, fourth = lidar.read(SteadyInflow(10.0, HUB), 0.0, -0.1, HUB, rotation)
    change = 10.0 * math.sin(0.1) * math.tan(0.3)
    assert (second, fourth) == pytest.approx(
        (10.0 * math.cos(0.1) + side * change, 10.0 * math.cos(0.1) - side * change)
    )
    places = lidar.places(0.0, HUB, rotation)[0]
    assert places[:, 1] == pytest.approx(100.0 * math.tan(0.3) * np.array([0.0, -side, 0.0, side]), abs=1e-12)
    np.testing.assert_allclose(100.0 * lidar.sides(rotation).T, places[:, 1:] - [0.0, HUB], atol=1e-12)


def test_names_forms_and_fingerprints():
    gates = replace(APART, apart=False)
    assert APART.names[:6] == ("lidar_1_1", "lidar_1_2", "lidar_1_3", "lidar_1_4", "lidar_1_5", "lidar_2_1")
    assert gates.names == ("lidar_1", "lidar_2")
    assert Lidar(**asdict(APART)) == APART
    assert fingerprint(APART) != fingerprint(gates)
    served = [one.serves(other) for one in (APART, gates) for other in (APART, gates, replace(gates, frozen=True))]
    assert served == [True, True, False, False, True, False]
    assert lidar_noise(gates) == LIDAR_NOISE == pytest.approx(lidar_noise(APART) / math.sqrt(5))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"apart": 1}, "apart must be True or False, got 1"),
        ({"apart": True, "half_angle": 0.0}, "half_angle must be above"),
    ],
)
def test_what_cannot_be_is_refused(given, message):
    with pytest.raises(ValueError, match=message):
        Lidar((60.0,), **given)


def test_a_controller_reads_beams_and_the_means_of_gates():
    read = WithLidar({"yaw": 0.0}, np.arange(10.0), APART)
    assert (read["lidar_1"], read["lidar_2"]) == (2.0, 7.0)
    assert (read["lidar_1_1"], read["lidar_2_5"], read["yaw"]) == (0.0, 9.0, 0.0)


@pytest.mark.parametrize("rotation", ["clockwise", "counter-clockwise"])
def test_records_hold_each_beam_where_it_is(rotation):
    swap, names = new_swap(), dict(zip(APART.names, np.arange(10.0).tolist(), strict=True))
    assert set(APART.names) < set(channels_read(3, APART))
    write_lidar(swap, names | {"yaw": 0.4}, APART, HUB, rotation)
    assert swap[2001:2003].tolist() == [5.0, 2.0]
    assert swap[2004:2014].tolist() == list(range(10))
    places = APART.places(0.4, HUB, rotation).reshape(10, 3)
    np.testing.assert_allclose(swap[2014:2044].reshape(3, 10).T, places, rtol=1e-6)


def test_in_openfast_all_beams_must_be_among_its_points():
    few = Lidar((100.0,), 0.2, 4, apart=True)
    points, wind = PointLidar.of(few), SteadyInflow(10.0, HUB, shear_exponent=0.2)
    np.testing.assert_allclose(points.points, few.places(0.0, 0.0).reshape(-1, 3), atol=1e-9)
    for rotation in ("clockwise", "counter-clockwise"):
        np.testing.assert_allclose(points.read(wind, 0.0, 0.0, HUB, rotation), few.read(wind, 0.0, 0.0, HUB, rotation))
    with pytest.raises(ValueError, match=r"must have at most 5 beams over all gates where they are apart.* got 10"):
        PointLidar.of(APART)


def test_an_observation_has_a_channel_for_each_beam():
    env = gym.make(ID, inflow=SteadyInflow(11.0), observation=("lidar",), sensor_noise=0.0,
                   lidar={"ranges": [30.0, 60.0], "apart": True}, start="steady").unwrapped  # fmt: skip
    observation, _ = env.reset(seed=0)
    layout = env.layout.observation
    assert layout.names == tuple(f"lidar_{gate}_{beam}" for gate in (1, 2) for beam in (1, 2, 3, 4))
    assert [channel.noise for channel in layout.channels] == [pytest.approx(0.2)] * 8
    assert {channel.unit for channel in layout.channels} == {"m/s"}
    assert layout.channels[5].description == "wind 60 m ahead, beam at an azimuth of 90 degrees on a cone"
    assert [layout.value(observation, name) for name in layout.names] == pytest.approx([11.0] * 8, rel=1e-5)
    values = {name: float(k) for k, name in enumerate(layout.names)}
    row = [(values[c.name] - c.offset) / c.scale for c in layout.channels]
    assert ObservedSignals(env.layout, np.array(row))["lidar_2"] == pytest.approx(5.5)
    env.close()


def test_an_agent_may_see_the_beams_of_a_controllers_lidar():
    """The controller reads the means of the beams that are observed, noise included."""
    heard = []
    more = {"observation": ("lidar",), "controller": "lidar", "sensors": "all", "sensor_noise": 1.0, "start": "steady",
            "action_mode": "residual", "wind_speed": 14.0, "wind_seeds": (1,)}  # fmt: skip
    lidar = Lidar((63.0, 126.0, 189.0), apart=True)
    env = gym.make(ID, **more, lidar=lidar).unwrapped
    start = env.controller.start
    env.controller.start = lambda read, demand: (
        heard.append([read[f"lidar_{k}"] for k in (1, 2, 3)]),
        start(read, demand),
    )
    observation, _ = env.reset(seed=3)
    layout = env.layout.observation
    shown = np.array([layout.value(observation, name) for name in layout.names]).reshape(3, 4)
    assert np.ptp(shown[0]) > 0.1
    assert heard[0] == pytest.approx(shown.mean(axis=1).tolist(), rel=1e-5)
    env.close()
    with pytest.raises(
        ValueError, match=r"the base controller reads Lidar.* must be the same, the same with apart=True"
    ):
        gym.make(ID, **more, lidar=replace(lidar, n_beams=5))


def test_a_lidar_along_the_axis_needs_no_beams_apart():
    """Its beams see the same: they cannot be apart, and nothing asks for it."""
    env = gym.make(ID, observation=("rotor", "lidar"), lidar={"ranges": [120.0], "half_angle": 0.0})
    assert env.unwrapped.layout.lidar == Lidar((120.0,), 0.0)
    env.close()
