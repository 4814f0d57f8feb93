"""OpenFAST behind the contract of the simulator: operation, signs and frames beside the simulator of this package."""

import importlib.util
import json
import math
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from openfast_library import flown, openfast_library

from wt_gym.base.errors import SimulationError
from wt_gym.bridges.openfast import VARIABLE, OpenFASTSimulator
from wt_gym.bridges.openfast.model import tower_sections
from wt_gym.commands import run as run_command
from wt_gym.control.sensors import to_fixed_frame
from wt_gym.learning.options import PretrainingOptions, pretraining_environment
from wt_gym.learning.pretraining_episodes import EpisodeJob, plant_outputs, record_episode
from wt_gym.simulation import Simulator
from wt_gym.simulation.channels import parities
from wt_gym.turbines.variants import mirrored
from wt_gym.wind import SteadyInflow, TurbulenceBox, TurbulentInflow

LIBRARY = openfast_library()
pytestmark = [pytest.mark.skipif(LIBRARY is None, reason=f"no library of OpenFAST: {VARIABLE} is not set")]
ROSCO = importlib.util.find_spec("rosco")


def simulator(turbine, wind=None, **options):
    wind = SteadyInflow(8.0, 90.0, shear_exponent=0.2) if wind is None else wind
    return OpenFASTSimulator(turbine, wind, openfast_library=LIBRARY, **options)


def run(sim, seconds, pitch=0.0, torque=19.3e3, yaw_rate=0.0, **start):
    """Rows of signals under constant demands."""
    sim.reset(**{"rotor_speed": 0.96, "generator_torque": torque, **start})
    steps = round(seconds / sim.time_step)
    return [sim.advance(sim.time_step, pitch, yaw_rate, torque) for _ in range(steps)]


@pytest.mark.slow
@pytest.mark.parametrize(("speed", "seconds"), [(8.0, 60.0), (15.0, 40.0)])
def test_operating_points_are_those_of_the_simulator(turbine, speed, seconds):
    """Blade elements and vortex lattice differ: by 5 % in power below rated wind and in loads, by 0.25 m at the tip."""
    wind = SteadyInflow(speed, 90.0, shear_exponent=0.2)
    found, wanted = (
        {name: values[-round(10.0 / each.time_step) :].mean() for name, values in flown(each, seconds).items()}
        for each in (simulator(turbine, wind), Simulator(turbine, wind))
    )
    for name, near in (
        ("rotor_speed", 0.02), ("generator_power", 0.06), ("aero_thrust", 0.05), ("rotor_thrust", 0.05),
        ("root_flap_moment_1", 0.05), ("tower_base_fore_aft_moment", 0.05), ("tower_top_fore_aft", 0.05),
        ("shaft_torque", 0.05), ("tower_base_side_side_moment", 0.1), ("tower_top_side_side", 0.1),
    ):  # fmt: skip
        assert found[name] == pytest.approx(wanted[name], rel=near), name
    assert found["pitch_1"] == pytest.approx(wanted["pitch_1"], abs=math.radians(0.3))
    for name in ("tip_out_of_plane_1", "tip_in_plane_1"):
        assert found[name] == pytest.approx(wanted[name], abs=0.25), name
    assert found["nacelle_acceleration_fore_aft"] == pytest.approx(0.0, abs=0.01)


class TestSteady:
    """Ten seconds at 8 m/s."""

    @pytest.fixture(scope="class")
    @classmethod
    def rows(cls, turbine):
        return run(simulator(turbine), 20.0)

    def test_power_torque_and_speed(self, rows):
        last = rows[-1]
        assert last["time"] == pytest.approx(20.0)
        assert last["generator_power"] == pytest.approx(1.7e6, rel=0.06)
        assert last["generator_speed"] == pytest.approx(97.0 * last["rotor_speed"], rel=5e-3)
        assert last["generator_torque"] == 19.3e3
        assert last["aero_power"] == pytest.approx(last["aero_torque"] * last["rotor_speed"], rel=2e-3)
        assert last["shaft_torque"] == pytest.approx(97.0 * 19.3e3, rel=0.06)
        assert last["wind_x"] == pytest.approx(8.0 * (1.0 + 0.02 / 90.0) ** 0.2, rel=1e-5)  # the hub leans up by 2 cm

    def test_azimuth_counts_the_turns(self, rows):
        azimuth = np.unwrap([row["azimuth"] for row in rows])
        speed = np.array([row["rotor_speed"] for row in rows])
        assert azimuth[-1] - azimuth[0] == pytest.approx(np.trapezoid(speed, dx=0.1), rel=2e-4)

    def test_blades_fall_on_the_side_that_descends(self, rows):
        """Gravity bends a blade to its leading edge where it comes down: the edgewise moment is −M g sin(azimuth)."""
        azimuth = np.array([row["azimuth"] for row in rows[100:]])
        edge = np.array([row["root_edge_moment_1"] for row in rows[100:]])
        amplitude = 2.0 * np.mean(edge * np.sin(azimuth))
        weight = 17740.0 * 9.81 * 20.5
        assert abs(amplitude) == pytest.approx(weight, rel=0.08)
        assert amplitude > 0.0


def test_a_tower_that_starts_aside_sways_at_its_frequency(turbine):
    """Side-side, which the air hardly damps."""
    sim = simulator(turbine)
    rows = run(sim, 14.0, tower_top=[0.2, 0.3, 0.0, 0.0])
    assert rows[0]["tower_top_side_side"] == pytest.approx(0.3, abs=0.02)
    assert rows[0]["tower_top_fore_aft"] == pytest.approx(0.2, abs=0.02)
    top = np.array([row["tower_top_side_side"] for row in rows])
    top -= top.mean()
    assert np.ptp(top[70:]) > 0.4  # still
    crossings = np.flatnonzero((top[:-1] < 0.0) & (top[1:] >= 0.0))
    found = (len(crossings) - 1) / ((crossings[-1] - crossings[0]) * 0.1)
    assert found == pytest.approx(tower_sections(turbine).frequencies[2], rel=0.04)


class TestSigns:
    def test_blades_pitch_one_by_one(self, turbine):
        """The load of the blade that feathers falls, those of the others stay."""
        plain = run(simulator(turbine), 3.0)[-1]["root_flap_moment"]
        signals = run(simulator(turbine), 3.0, pitch=np.radians([0.0, 0.0, 2.0]))[-1]
        np.testing.assert_allclose(signals["pitch"], np.radians([0.0, 0.0, 2.0]), atol=1e-6)
        change = signals["root_flap_moment"] - plain
        assert change[2] < -0.3e6
        assert np.abs(change[:2]).max() < 0.15e6
        assert to_fixed_frame(signals["pitch"], signals["azimuth"])[0] == pytest.approx(np.radians(2.0) / 3)

    def test_torque_brakes(self, turbine):
        less, more = (run(simulator(turbine), 6.0, torque=torque) for torque in (15e3, 25e3))
        assert more[-1]["rotor_speed"] < less[-1]["rotor_speed"]
        moment = [np.mean([row["tower_base_side_side_moment"] for row in rows]) for rows in (less, more)]
        assert moment[1] - moment[0] == pytest.approx(97.0 * 10e3, rel=0.5)

    def test_yaw_turns_counter_clockwise(self, turbine):
        """The nacelle turns at the demanded rate, and the wind comes from the other side then."""
        rows = run(simulator(turbine), 10.0, yaw_rate=math.radians(0.3))
        turned = np.array([row["yaw"] for row in rows])
        assert turned[-1] - turned[49] == pytest.approx(math.radians(0.3) * 5.0, rel=0.05)
        assert rows[-1]["yaw_error"] == pytest.approx(-turned[-1])

    def test_the_mirror_image(self, turbine):
        wind = SteadyInflow(8.0, 90.0, yaw_misalignment=0.2)
        found = run(simulator(mirrored(turbine), wind), 1.0, yaw=0.1, yaw_rate=0.004)[-1]
        wanted = run(simulator(turbine, replace(wind, yaw_misalignment=-0.2)), 1.0, yaw=-0.1, yaw_rate=-0.004)[-1]
        np.testing.assert_allclose(found.values, wanted.values * parities(3), rtol=1e-9, atol=1e-9)


class TestWind:
    def test_it_is_the_same_wind(self, turbine):
        """Turbulence at the hub on a tower that bends, begun in the middle of its box and through the end of it."""
        box = TurbulenceBox.kaimal(12.0, 90.0, 126.0, "B", seed=3, duration=30.0, cache=False)
        wind = TurbulentInflow(box, SteadyInflow(12.0, 90.0, shear_exponent=0.2), time_offset=25.0)
        rows = run(simulator(turbine, wind), 8.0, pitch=0.06, torque=40e3, rotor_speed=1.267)
        x, z = -turbine.nacelle.overhang * math.cos(turbine.nacelle.tilt), turbine.hub_height
        lean = 1.7 / turbine.tower.height  # of the top of a bent cantilever over its way
        ways = [(row["tower_top_x"], row["tower_top_y"], row["time"]) for row in rows]
        more = 1.0 + lean * (z - turbine.tower.height)
        wanted = [wind.velocity([x + more * ahead, more * side, z - x * lean * ahead], t) for ahead, side, t in ways]
        found = [[row["wind_x"], row["wind_y"], row["wind_z"]] for row in rows]
        np.testing.assert_allclose(found, wanted, atol=0.01)


def test_both_ways_of_commands_agree(turbine):
    """Through a Bladed library and as inputs of ServoDyn, which the library must accept."""
    try:
        inputs = run(simulator(turbine, commands="inputs"), 5.0, pitch=0.02)
    except SimulationError as error:
        if "PCMode" in str(error):
            pytest.skip("this build takes no inputs of ServoDyn")
        raise
    bladed = run(simulator(turbine), 5.0, pitch=0.02)
    for name, near in (("rotor_speed", 1e-3), ("root_flap_moment_1", 5e-3), ("tower_top_fore_aft", 5e-3)):
        assert inputs[-1][name] == pytest.approx(bladed[-1][name], rel=near), name


def test_a_message_of_openfast_reaches_the_user(turbine):
    sim = simulator(turbine, changes={"AeroDyn": {"Wake_Mod": 7}})
    with pytest.raises(SimulationError, match=r"Wake_?Mod"):
        sim.reset(rotor_speed=0.96)


def test_the_same_again(turbine):
    """Two simulations, one after the other in one simulator, and one beside it: bit for bit."""
    first, second = simulator(turbine), simulator(turbine)
    runs = [run(first, 1.0)[-1], run(second, 1.0)[-1], run(first, 1.0)[-1]]
    assert runs[0] == runs[1] == runs[2]


def test_an_environment(monkeypatch):
    monkeypatch.setenv(VARIABLE, str(LIBRARY))
    env = gym.make("wt_gym/NREL5MW-Steady-v1", wind_speed=15.0, simulator="openfast", action_mode="residual")
    env.reset(seed=1)
    for _ in range(10):
        observation, reward, terminated, _, info = env.step(np.zeros(env.action_space.shape))
    assert not terminated
    assert np.isfinite(observation).all()
    assert -1.0 < reward < 1.0
    assert info["generator_power"] == pytest.approx(5e6, rel=0.1)
    env.close()


@pytest.mark.skipif(ROSCO is None, reason="the models of rosco are not installed: pip install --no-deps rosco")
def test_a_model_of_ones_own(turbine):
    path = Path(ROSCO.origin).parents[1] / "Examples" / "Test_Cases" / "NREL-5MW" / "NREL-5MW.fst"
    own = run(OpenFASTSimulator(path, SteadyInflow(8.0, 90.0), openfast_library=LIBRARY), 5.0)[-1]
    written = run(simulator(turbine, SteadyInflow(8.0, 90.0)), 5.0)[-1]
    for name in ("rotor_speed", "aero_thrust", "root_flap_moment_1", "tower_top_fore_aft"):
        assert own[name] == pytest.approx(written[name], rel=0.12), name


@pytest.mark.slow
def test_crosscheck(monkeypatch, tmp_path, capsys):
    monkeypatch.setenv(VARIABLE, str(LIBRARY))
    words = ["discon", "ipc", "--wind-speed", "15", "--wind-seeds", "1001", "--duration", "30", "--skip", "10"]
    run_command("crosscheck", [*words, "--out", str(tmp_path)])
    printed = capsys.readouterr().out
    assert "| 15 | ipc |" in printed
    content = json.loads((tmp_path / "crosscheck.json").read_text())
    (row,) = [r for r in content["metrics"] if r["metric"] == "pitch_travel" and r["wind_speed"] == 15.0]
    assert min(change["value"] for change in row["changes"]["ipc"]) > 0.3  # it moves the blades more, in both
    assert content["sample_correlation"]["discon"]["wind_x"] > 0.99
    page = (tmp_path / "crosscheck.md").read_text()
    for figure in ("signals_0.png", "spectra_1.png"):
        assert f"figures/{figure}" in page
        assert (tmp_path / "figures" / figure).stat().st_size > 10_000


def test_a_pretraining_may_record_in_openfast():
    """The same wind and start in both codes: mean flapwise moments, and edgewise ones of gravity, are alike."""
    arguments = json.dumps(pretraining_environment("wt_gym/LoadReduction-v3", {}))
    options = {"simulator": {"name": "openfast", "openfast_library": str(LIBRARY), "duration": 20.0}}
    (condition,) = PretrainingOptions(conditions=[options]).conditions
    job = EpisodeJob("wt_gym/LoadReduction-v3", arguments, 17.0, 3, 12.0)
    own, found = (record_episode(replace(job, condition=json.dumps(each))) for each in ({}, condition))
    (own_means, means), (flap, edge) = (plant_outputs(each).mean(1) for each in (own, found)), (0, slice(7, 9))
    assert means[flap] != own_means[flap]
    assert means[flap] == pytest.approx(own_means[flap], rel=0.1)
    assert np.hypot(*(means - own_means)[edge]) < 0.1 * np.hypot(*own_means[edge])
    assert (found.lead, found.pitch_gain) == (own.lead, own.pitch_gain)
