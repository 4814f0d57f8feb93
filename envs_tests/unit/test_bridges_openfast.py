"""OpenFAST's bridge without OpenFAST: models, winds, mode shapes, drives, signals, and a library that fails."""

import ctypes
import importlib.util
import json
import math
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from wt_gym.base.errors import ActionError, SimulationError, TurbineDefinitionError
from wt_gym.bridges.compiler import find_compiler
from wt_gym.bridges.openfast.driver import read_outputs, read_turbine, write_driver_run, write_turbine
from wt_gym.bridges.openfast.measurement import AERODYN_OUTPUTS, INFLOW_OUTPUTS, Measurement, elastodyn_outputs
from wt_gym.bridges.openfast.model import TopBody, bending_shapes, blade_sections, tower_sections, write_model
from wt_gym.bridges.openfast.process import DRIVER_VARIABLE, VARIABLE, find_driver, find_library, relay_library
from wt_gym.bridges.openfast.run_folder import BentTurbine, ServedController
from wt_gym.bridges.openfast.simulator import OpenFASTSimulator, PitchPath
from wt_gym.bridges.openfast.wind import PointLidar, sampled, write_wind
from wt_gym.commands import loadcases
from wt_gym.commands import parse as parse_command
from wt_gym.commands import run as run_command
from wt_gym.control import Lidar, operating_point
from wt_gym.envs.operation import simulator_maker
from wt_gym.simulation import Simulator
from wt_gym.simulation.contract import fingerprint
from wt_gym.simulation.drivetrain.faults import StuckPitch
from wt_gym.structure.beam import Beam, BeamSections
from wt_gym.structure.modes import clamped_modes
from wt_gym.turbines import PitchSystem, catalog, load_turbine
from wt_gym.turbines.blade_element import BladeElementRotor, BladeElements
from wt_gym.turbines.openfast import compare_with_openfast_io, read_openfast
from wt_gym.turbines.openfast_text import InputFile
from wt_gym.turbines.variants import mirrored, unloaded_clearance
from wt_gym.turbines.windio_writer import require_same
from wt_gym.wind import MirroredInflow, SteadyInflow, TurbulenceBox, TurbulentInflow, TurningInflow, read_bts


class TestModeShapes:
    """Ritz modes in ElastoDyn's polynomials, against exact solutions."""

    @staticmethod
    def uniform(count, **options):
        station = np.linspace(0.0, 60.0, 5)
        mass, stiffness = np.full(5, 250.0), np.full(5, 4e9)
        shapes, frequency = bending_shapes(station, mass, stiffness, count, **options)
        return shapes, frequency * 2 * math.pi / math.sqrt(4e9 / 250.0 / 60.0**4)

    def test_cantilever(self):
        shapes, roots = self.uniform(2)
        assert roots == pytest.approx([3.5160, 22.0345], rel=2e-4)  # Rao, Mechanical Vibrations, table 8.4
        np.testing.assert_allclose(shapes.sum(axis=1), 1.0)

    def test_mass_on_the_end(self):
        """With a mass as heavy as the beam the root β L = 1.2479 (Blevins, Formulas for Natural Frequency, 8.8)."""
        _, roots = self.uniform(1, top=TopBody(250.0 * 60.0, 0.0, 0.0))
        assert roots[0] == pytest.approx(1.2479**2, rel=2e-4)

    def test_a_turning_beam_is_stiffer(self):
        """A uniform beam that turns with Ω = 6 √(EI/(m L⁴)): 7.3604 (Wright et al., J. Appl. Mech. 49 (1982))."""
        station, speed = np.linspace(0.0, 60.0, 400), 6.0 * math.sqrt(4e9 / 250.0 / 60.0**4)
        pull = 0.5 * 250.0 * speed**2 * (60.0**2 - station**2)
        _, turning = bending_shapes(station, np.full(400, 250.0), np.full(400, 4e9), 1, pull=pull)
        assert turning[0] * 2 * math.pi * 6.0 / speed == pytest.approx(7.3604, rel=5e-4)


class TestSections:
    @pytest.mark.parametrize(("name", "near"), [("nrel_5mw", 0.02), ("iea_15mw", 0.06)])
    def test_frequencies_are_those_of_the_simulator(self, name, near):
        """The blade that the simulator bends and twists; that of the IEA 15-MW is curved, what ElastoDyn has not."""
        turbine = load_turbine(name)
        blade, structure = turbine.blade, turbine.blade.structure
        axis = blade.axis_at(np.interp(structure.station, blade.axis_station, blade.axis[:, 2]))
        beam = Beam(BeamSections(structure.station, structure.stiffness, structure.inertia, axis), 30)
        speed, root = turbine.drivetrain.rated_rotor_speed, np.array([0.0, 0.0, -turbine.hub.radius])
        flap_1, edge_1, flap_2 = clamped_modes(beam, 3, spin=speed, center=root).frequency
        assert blade_sections(turbine).frequencies == pytest.approx([flap_1, flap_2, edge_1], rel=near)

    def test_fore_aft_of_the_nrel_5mw(self, turbine):
        """Published: 0.324 Hz fore-aft, 0.312 Hz side-side (NREL/TP-500-38060, table 9-1)."""
        frequencies = tower_sections(turbine).frequencies
        assert frequencies[[0, 2]] == pytest.approx([0.318, 0.318], rel=0.03)

    @pytest.mark.parametrize("turn", [0.1, -0.3])
    def test_a_turned_section_has_its_own_axes(self, turbine, turn):
        """Sections turned by an angle keep their stiffnesses, and their axes turn by it."""
        structure = turbine.blade.structure
        c, s = math.cos(-turn), math.sin(-turn)
        one = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        both = np.kron(np.eye(2), one)
        finite = np.where(np.isinf(structure.stiffness), 0.0, structure.stiffness)
        stiffness = both @ finite @ both.T
        stiffness = np.where(np.isinf(structure.stiffness), np.inf, 0.5 * (stiffness + stiffness.transpose(0, 2, 1)))
        turned = replace(turbine.blade, structure=replace(structure, stiffness=stiffness))
        found, wanted = blade_sections(replace(turbine, blade=turned)), blade_sections(turbine)
        own = np.abs(wanted.flap - wanted.edge) > 0.1 * wanted.edge
        assert own.sum() > 20
        np.testing.assert_allclose(found.flap[own], wanted.flap[own], rtol=1e-6)
        np.testing.assert_allclose((found.twist - wanted.twist)[own], turn, atol=1e-6)

    def test_a_monopile_is_refused(self):
        with pytest.raises(TurbineDefinitionError, match="monopile"):
            tower_sections(load_turbine("nrel_5mw_monopile"))


@pytest.fixture(scope="module")
def model(turbine, tmp_path_factory):
    return write_model(turbine, tmp_path_factory.mktemp("model"))


class TestModelFiles:
    """The files that are written, as other readers understand them."""

    def test_reading_them_gives_the_turbine_back(self, turbine, model):
        train = turbine.drivetrain
        read = read_openfast(model, rated_power=train.rated_power, rated_rotor_speed=train.rated_rotor_speed)
        for part, names in (
            ("", "n_blades rotor_diameter hub_height air_density"),
            ("drivetrain", "gear_ratio gearbox_efficiency generator_efficiency generator_inertia spring"),
            ("tower", "base_height height drag_coefficient damping_ratio"),
        ):
            found, wanted = (getattr(t, part) if part else t for t in (read, turbine))
            for name in names.split():
                assert getattr(found, name) == pytest.approx(getattr(wanted, name), rel=1e-6, abs=1e-9), name
        require_same(turbine.hub, read.hub)
        require_same(turbine.pitch, read.pitch)
        require_same(replace(turbine.nacelle, inertia=read.nacelle.inertia), read.nacelle)
        z = np.linspace(0.0, turbine.blade.length, 40)
        np.testing.assert_allclose(read.blade.twist_at(z), turbine.blade.twist_at(z), atol=math.radians(0.15))
        np.testing.assert_allclose(read.blade.chord_at(z), turbine.blade.chord_at(z), rtol=0.02)
        for order in range(3):
            found, wanted = (t.blade.structure.mass_moment(order) for t in (read, turbine))
            assert found == pytest.approx(wanted, rel=2e-3)
        for order in range(2):
            found, wanted = (t.tower.structure.mass_moment(order) for t in (read, turbine))
            assert found == pytest.approx(wanted, rel=1e-6)
        middle = 0.5 * turbine.blade.length
        found, wanted = (t.blade.structure.stiffness_at(middle)[3:5, 3:5] for t in (read, turbine))
        np.testing.assert_allclose(found, wanted, rtol=0.02, atol=1e-3 * wanted.max())

    def test_their_rotor_makes_the_same_power(self, turbine, model):
        train = turbine.drivetrain
        read = read_openfast(model, rated_power=train.rated_power, rated_rotor_speed=train.rated_rotor_speed)
        points = [8.0, 12.0, 18.0], [0.96, 1.267, 1.267], np.radians([0.0, 4.0, 14.9])
        found, wanted = (BladeElements(BladeElementRotor.of_turbine(t)).solve(*points) for t in (read, turbine))
        np.testing.assert_allclose(found["power"], wanted["power"], rtol=0.01)
        np.testing.assert_allclose(found["thrust"], wanted["thrust"], rtol=0.01)

    @pytest.mark.skipif(importlib.util.find_spec("openfast_io") is None, reason="needs the extra openfast")
    def test_openfast_io_reads_them_line_by_line(self, turbine, model):
        """It takes values by the number of their line in the files of OpenFAST 5, whatever the keyword there."""
        from openfast_io.FAST_reader import InputReader_OpenFAST

        agree = re.findall(r"(\d+) numbers agree", "\n".join(compare_with_openfast_io(model)))
        assert len(agree) == 5
        assert sum(map(int, agree)) > 100
        reader = InputReader_OpenFAST()
        reader.FAST_InputFile, reader.FAST_directory = model.name, str(model.parent)
        reader.execute()
        read = reader.fst_vt
        for module, key, value in (
            ("Fst", "AirDens", turbine.air_density), ("ElastoDyn", "DTTorDmp", turbine.drivetrain.damper),
            ("AeroDyn", "DBEMT_Mod", 2), ("AeroDyn", "NumAFfiles", len(read["AeroDyn"]["af_data"])),
            ("ServoDyn", "YawSpr", turbine.nacelle.yaw_spring), ("ServoDyn", "Ptch_Cntrl", 1),
            ("InflowWind", "WindType", 1),
        ):  # fmt: skip
            assert read[module][key] == pytest.approx(value), key
        blade = read["ElastoDynBlade"]
        shape = (blade if isinstance(blade, dict) else blade[0])["BldFl1Sh"]
        np.testing.assert_allclose(shape, blade_sections(turbine).flap_shapes[0])

    def test_a_rotor_that_turns_the_other_way_is_its_image(self, turbine, tmp_path):
        write_model(turbine, tmp_path / "one")
        write_model(mirrored(turbine), tmp_path / "other")
        for path in (tmp_path / "one").rglob("*.*"):
            assert path.read_text() == (tmp_path / "other" / path.relative_to(tmp_path / "one")).read_text()


class TestWind:
    """Wind files, read back."""

    def test_a_power_law_is_openfasts_own(self, turbine, tmp_path):
        wind = SteadyInflow(9.0, 90.0, shear_exponent=0.14)
        file = InputFile(write_wind(wind, turbine, tmp_path, 60.0))
        assert (file.number("WindType"), file.number("HWindSpeed"), file.number("PLExp")) == (1, 9.0, 0.14)
        assert not (tmp_path / "wind.bts").exists()
        file = InputFile(write_wind(MirroredInflow.of(wind), turbine, tmp_path, 60.0))
        assert file.number("WindType") == 1

    @pytest.mark.parametrize(("offset", "near"), [(0.0, 0.002), (7.5, 0.002), (7.6, 0.03)])
    def test_turbulence_is_that_of_the_box(self, turbine, tmp_path, offset, near):
        """Through the end of the period too, and nearly where an episode begins between two samples."""
        box = TurbulenceBox.kaimal(14.0, 90.0, 126.0, "B", seed=3, duration=60.0, grid=(7, 7), cache=False)
        wind = TurbulentInflow(box, SteadyInflow(14.0, 90.0, shear_exponent=0.2), time_offset=offset)
        file = InputFile(write_wind(wind, turbine, tmp_path, 600.0))
        assert file.number("WindType") == 3
        read = TurbulentInflow(read_bts(tmp_path / "wind.bts"))
        assert read.box.periodic
        hub = np.array([[0.0, 0.0, 90.0], [-5.0, 0.0, 90.0], [0.0, box.spacing_y, 90.0 + box.spacing_z]])
        times = np.arange(1.0, 130.0, 0.37)
        found, wanted = (np.array([each.velocity(hub, time) for time in times]) for each in (read, wind))
        assert np.sqrt(np.mean((found - wanted) ** 2)) < near < 0.1 * wanted[..., 0].std()

    def test_a_wind_that_changes_lasts_as_long_as_it_must(self, turbine):
        wind = TurningInflow(SteadyInflow(12.0, 90.0), np.array([20.0, 40.0]), np.array([0.0, 0.5]))
        content = sampled(wind, turbine, 50.0)
        times = np.arange(len(content.grid)) * content.time_step
        middle = content.grid[:, 7, 7]
        for k in np.flatnonzero(times < 50.0)[::37]:
            np.testing.assert_allclose(middle[k], wind.velocity([0.0, 0.0, 90.0], times[k]), atol=1e-4)
        # what is downwind at the start was there before
        np.testing.assert_allclose(middle[-1], wind.velocity([0.0, 0.0, 90.0], -content.time_step), atol=1e-4)
        assert times[-1] > 50.0
        # what is upwind at the end comes after it
        near_end = (times > 50.0) & (times < 55.0)
        last = np.tile(wind.velocity([0.0, 0.0, 90.0], 50.0), (near_end.sum(), 1))
        np.testing.assert_allclose(middle[near_end], last, atol=1e-4)

    def test_veer_and_a_log_profile_are_sampled(self, turbine):
        wind = SteadyInflow(12.0, 90.0, roughness_length=0.03, veer=-0.002, yaw_misalignment=0.2)
        content = sampled(wind, turbine, 600.0)
        z = content.z_bottom + content.spacing_z * np.arange(content.grid.shape[1])
        points = np.stack([0 * z, 0 * z, z], axis=1)
        np.testing.assert_allclose(content.grid[5, :, 7], wind.velocity(points, 0.0), atol=1e-5)
        assert content.z_bottom < 1.0  # the tower is in the wind down to its foot


class TestPitchPath:
    def test_an_ideal_drive_is_at_the_mean_of_two_commands(self):
        path = PitchPath(PitchSystem(0.0, 1.5, 0.2), 0.1, 8)
        path.start(np.zeros(3))
        commands = np.array([[0.01, 0.0, 0.02], [0.02, 0.01, 0.02], [0.02, 0.03, 0.02]])
        before = np.zeros(3)
        for command in commands:
            angles = path.follow(command)
            np.testing.assert_allclose(angles[-1], 0.5 * (before + command), atol=1e-15)
            before = command
        np.testing.assert_allclose(path.follow(before)[-1], before, atol=1e-15)
        np.testing.assert_allclose(path.rate, 0.0)

    def test_a_servo_follows_a_step(self):
        """Critically damped: 1 − (1 + ω t) exp(−ω t), from a command that got there within a step of 0.1 ms."""
        omega = 3.0
        path = PitchPath(PitchSystem(0.0, 1.5, 9.0, servo_frequency=omega), 1e-4, 1)
        path.start(np.zeros(1))
        angles = np.array([path.follow(np.array([0.1]))[-1, 0] for _ in range(20000)])
        times = 1e-4 * np.arange(1, 20001)
        np.testing.assert_allclose(angles, 0.1 * (1 - (1 + omega * times) * np.exp(-omega * times)), atol=2e-5)


NAMES = [*elastodyn_outputs(3), *AERODYN_OUTPUTS, *INFLOW_OUTPUTS]


def outputs(**given):
    row = np.zeros(len(NAMES))
    for name, value in given.items():
        row[NAMES.index(name)] = value
    return row


def measured(turbine, *rows, **options):
    measurement = Measurement(turbine, NAMES)
    still = np.zeros(3)
    measurement.take(options.pop("time", 0.0), np.array(rows), 2e4, still, still, still, False)
    return measurement.signals()


class TestSignals:
    """OpenFAST's outputs in the frames, signs and units of the channel table."""

    def test_units(self, turbine):
        signals = measured(
            turbine, outputs(RotSpeed=12.1, GenSpeed=1173.7, BldPitch2=90.0, RootMyb3=5.0, RtAeroPwr=5e6, Azimuth=-90.0)
        )
        assert signals["rotor_speed"] == pytest.approx(1.267, rel=1e-3)
        assert signals["pitch_2"] == pytest.approx(0.5 * math.pi)
        assert signals["root_flap_moment_3"] == 5e3
        assert signals["aero_power"] == 5e6
        assert signals["azimuth"] == pytest.approx(1.5 * math.pi)
        assert signals["generator_power"] == pytest.approx(2e4 * 1173.7 * math.pi / 30 * 0.944, rel=1e-3)

    def test_fore_aft_is_along_the_nacelle(self, turbine):
        """A nacelle that heads to the left: a push to the left is fore-aft, bends the tower about −x in ground axes."""
        signals = measured(
            turbine, outputs(YawPzn=90.0, TTDspSS=0.3, TwrBsMxt=-7.0, YawBrTAyp=0.2, WindHubVelX=3.0, WindHubVelY=4.0)
        )
        assert signals["tower_top_fore_aft"] == pytest.approx(0.3)
        assert signals["tower_top_side_side"] == pytest.approx(0.0, abs=1e-12)
        assert signals["tower_base_fore_aft_moment"] == pytest.approx(7e3)
        assert signals["nacelle_acceleration_fore_aft"] == pytest.approx(0.2)
        assert signals["yaw_error"] == pytest.approx(math.atan2(4.0, 3.0) - 0.5 * math.pi)

    def test_clearance_of_unloaded_passing_and_bent_blades(self, turbine):
        signals = measured(turbine, outputs(Azimuth=180.0))
        assert signals["tip_clearance_1"] == pytest.approx(unloaded_clearance(turbine), abs=0.01)
        assert signals["tip_clearance_2"] > 40.0
        passing = measured(turbine, outputs(Azimuth=170.0), outputs(Azimuth=190.0))  # the tower, between samples
        assert passing["tip_clearance_min_1"] < passing["tip_clearance_1"]
        assert passing["tip_clearance_min_1"] == pytest.approx(unloaded_clearance(turbine), abs=1.0)
        assert measured(turbine, outputs(Azimuth=180.0, OoPDefl1=14.0))["tip_clearance_1"] < 0.0
        bent, yawed = (measured(turbine, outputs(Azimuth=180.0, OoPDefl1=5.0, YawPzn=yaw)) for yaw in (0.0, 40.0))
        assert yawed["tip_clearance_1"] == pytest.approx(bent["tip_clearance_1"])

    def test_extremes_accumulate(self, turbine):
        measurement, still = Measurement(turbine, NAMES), np.zeros(3)
        for k, (moment, accumulate) in enumerate([(5.0, False), (3.0, True)]):
            rows = np.array([outputs(RootMyb1=-moment, RotSpeed=moment)])
            measurement.take(float(k), rows, 0.0, still, still, np.full(3, 0.1), accumulate)
        signals = measurement.signals()
        assert signals["root_flap_moment_max_1"] == 5e3
        assert signals["root_flap_moment_1"] == -3e3
        assert signals["pitch_travel_1"] == pytest.approx(0.2)
        assert signals["rotor_speed_max"] == pytest.approx(5.0 * math.pi / 30)

    def test_start_bends_as_the_simulator_does(self, turbine):
        """At 8 m/s and 9.2 rpm the blades of the NREL 5-MW bend by about 3 m, the tower top by 0.2 m."""
        bent = BentTurbine(turbine).deflections(8.0, 0.96, 0.0)
        assert bent.out_of_plane == pytest.approx(3.1, abs=0.5)
        assert bent.in_plane == pytest.approx(-0.35, abs=0.15)
        assert bent.fore_aft == pytest.approx(0.22, abs=0.05)
        assert bent.side_side == pytest.approx(-0.025, abs=0.005)


@pytest.mark.usefixtures("compiler")
def test_relay_hands_over_the_demands(tmp_path, monkeypatch):
    monkeypatch.setenv("WT_GYM_CACHE", str(tmp_path))
    library = ctypes.CDLL(str(relay_library()))
    (ctypes.c_double * 5).in_dll(library, "wt_gym_demands")[:] = [0.1, 0.2, 0.3, 4e4, -0.005]
    swap, fail = np.zeros(200, np.float32), ctypes.c_int(-1)
    message = ctypes.create_string_buffer(1025)
    library.DISCON(swap.ctypes.data_as(ctypes.c_void_p), ctypes.byref(fail), b"in", b"out", message)
    assert fail.value == 0
    np.testing.assert_allclose(swap[[41, 42, 43, 44, 46, 47, 34]], [0.1, 0.2, 0.3, 0.1, 4e4, -0.005, 1.0], rtol=1e-7)


@pytest.mark.usefixtures("compiler")
class TestProcess:
    """A library that behaves, reports an error, aborts, or stops."""

    @staticmethod
    def simulator(place, way, turbine, **options):
        source = (Path(__file__).with_name("data") / "openfast.c").read_text(encoding="utf-8")
        source = source.replace("WAY", str(way)).replace("NAMES", ", ".join(f'"{name}"' for name in NAMES))
        source = source.replace("SPEED", str(NAMES.index("RotSpeed"))).replace("PITCH", str(NAMES.index("BldPitch1")))
        path, library = place / "fake.c", place / f"fake{way}.so"
        path.write_text(source)
        subprocess.run([*find_compiler(), "-shared", "-fPIC", "-o", str(library), str(path)], check=True)
        wind = SteadyInflow(8.0, 90.0)
        return OpenFASTSimulator(turbine, wind, openfast_library=library, commands="inputs", **options)

    def test_one_that_behaves(self, tmp_path, turbine):
        sim = self.simulator(tmp_path, 0, turbine)
        assert sim.reset(rotor_speed=1.0, pitch=0.02)["pitch_command_1"] == 0.02
        for _ in range(5):
            signals = sim.advance(0.2, pitch=0.05, generator_torque=1e4)
        assert signals["time"] == pytest.approx(1.0)
        assert signals["pitch_1"] == pytest.approx(0.05)
        sim.close()
        with pytest.raises(SimulationError, match="reset"):
            sim.advance(0.2, pitch=0.05)

    @pytest.mark.parametrize(
        ("way", "message"),
        [(1, "OpenFAST: the mesh is broken"), (2, "OpenFAST crashed .*STOP in a subroutine"), (3, "OpenFAST crashed")],
    )
    def test_one_that_fails_can_be_started_again(self, tmp_path, turbine, way, message):
        sim = self.simulator(tmp_path, way, turbine)
        for _ in range(2):
            sim.reset(rotor_speed=1.0)
            sim.advance(0.2, pitch=0.0)
            with pytest.raises(SimulationError, match=rf"simulation failed at 0\.200 s: {message}"):
                sim.advance(0.2, pitch=0.0)
            with pytest.raises(SimulationError, match="reset"):
                sim.advance(0.2, pitch=0.0)

    def test_simulators_share_no_files(self, tmp_path, turbine):
        kept = tmp_path / "kept"
        pair = [self.simulator(tmp_path, 0, turbine, folder=kept) for _ in range(2)]
        for sim, speed in zip(pair, (0.5, 1.0), strict=True):
            sim.reset(rotor_speed=speed)
        speeds = sorted(InputFile(path).number("RotSpeed") for path in kept.glob("run_*/elastodyn.dat"))
        assert speeds == pytest.approx([0.5 * 30 / math.pi, 30 / math.pi])
        for path in kept.glob("run_*/aerodyn.dat"):  # the files that a run leaves as they are
            assert Path(InputFile(path).text("ADBlFile(1)")).is_file()
        temporary = self.simulator(tmp_path, 0, turbine)
        folder = temporary.model.parents[1]
        assert folder.is_dir()
        temporary.close()
        assert not folder.exists()

    def test_a_failure_ends_the_episode(self, tmp_path, turbine):
        self.simulator(tmp_path, 2, turbine).close()
        options = {"name": "openfast", "openfast_library": str(tmp_path / "fake2.so"), "commands": "inputs"}
        env = gym.make("wt_gym/NREL5MW-Steady-v1", wind_speed=8.0, simulator=options)
        env.reset(seed=0)
        env.step(np.zeros(env.action_space.shape))
        *_, terminated, _, info = env.step(np.zeros(env.action_space.shape))
        assert terminated
        assert info["termination"] == "failure"
        assert "OpenFAST crashed" in info["failure"]
        env.reset(seed=0)
        env.close()

    def test_faults_of_drives(self, tmp_path, turbine):
        sim = self.simulator(tmp_path, 0, turbine)
        sim.faults = (StuckPitch(0.1, blade=1),)
        sim.reset(rotor_speed=1.0)
        for _ in range(5):
            signals = sim.advance(0.1, pitch=0.2)
        assert signals["pitch_command_1"] < signals["pitch_command_2"]

    def test_a_wind_that_is_over(self, tmp_path, turbine):
        sim = self.simulator(tmp_path, 0, turbine, duration=1.0)
        sim.reset(rotor_speed=1.0)
        sim.advance(2.0, pitch=0.0)  # a steady wind has no end
        sim.inflow = TurningInflow(SteadyInflow(12.0, 90.0), np.array([0.0, 1.0]), np.array([0.0, 0.5]))
        sim.reset(rotor_speed=1.0)
        sim.advance(1.0, pitch=0.0)
        with pytest.raises(SimulationError, match=r"written for 1 s, and 1\.1 s are asked for"):
            sim.advance(0.1, pitch=0.0)

    def test_what_is_refused(self, tmp_path, turbine):
        sim = self.simulator(tmp_path, 0, turbine)
        sim.reset(rotor_speed=1.0)
        for refused in (sim.state, sim.geometry, sim.linearize):
            with pytest.raises(SimulationError):
                refused()
        with pytest.raises(ActionError, match="degrees"):
            sim.advance(0.1, pitch=15.0)
        with pytest.raises(ActionError, match="whole number"):
            sim.advance(0.15, pitch=0.0)
        with pytest.raises(SimulationError, match="changes must name modules"):
            self.simulator(tmp_path, 0, turbine, changes={"AeroDyn15": {"UA_Mod": 3}}).reset(rotor_speed=1.0)
        with pytest.raises(TurbineDefinitionError, match="UA_Mode"):
            self.simulator(tmp_path, 0, turbine, changes={"AeroDyn": {"UA_Mode": 3}}).reset(rotor_speed=1.0)


class TestChoice:
    """What is said where the library or a name is not known."""

    def test_no_library_is_one_clear_line(self, monkeypatch, tmp_path):
        monkeypatch.setenv(VARIABLE, str(tmp_path / "libopenfastlib.so"))
        with pytest.raises(SimulationError, match=rf"{VARIABLE} must be the path"):
            gym.make("wt_gym/NREL5MW-Steady-v1", simulator="openfast")
        monkeypatch.delenv(VARIABLE)
        monkeypatch.delenv("CONDA_PREFIX", raising=False)
        monkeypatch.setattr("ctypes.util.find_library", lambda name: None)
        monkeypatch.setattr("sys.prefix", str(tmp_path))
        with pytest.raises(SimulationError, match="conda install -c conda-forge openfast"):
            find_library()

    @pytest.mark.parametrize(
        ("choice", "message"),
        [
            ("openfst", "did you mean 'openfast'"),
            ({"changes": {}}, "simulator must be one of"),
            ({"name": "wt_gym", "step": 0.01}, "no further arguments"),
            ({"name": "openfast", "steps": 0.01}, "OpenFAST takes openfast_library.*got steps"),
            (3, "simulator must be one of"),
        ],
    )
    def test_names(self, choice, message):
        with pytest.raises(ValueError, match=message):
            simulator_maker(choice, "nrel_5mw", pictured=False)

    def test_load_cases_leave_the_parked_turbine_out(self, monkeypatch, tmp_path):
        library = tmp_path / "library.so"
        library.write_bytes(b"")
        monkeypatch.setenv(VARIABLE, str(library))
        chosen = loadcases.configuration(parse_command("loadcases", ["discon", "--simulator", "openfast"]))
        assert "1.1" in chosen.cases
        assert "6.1" not in chosen.cases
        assert chosen.env_kwargs["simulator"] == "openfast"
        with pytest.raises(ValueError, match=r"6\.1, the parked turbine, must be left out"):
            loadcases.configuration(parse_command("loadcases", ["--simulator", "openfast", "--case", "6.1"]))

    def test_no_pictures(self):
        with pytest.raises(ValueError, match="render_mode must be None"):
            gym.make("wt_gym/NREL5MW-Steady-v1", simulator="openfast", render_mode="rgb_array")

    def test_a_function_makes_the_simulator(self):
        made = []

        def maker(turbine, inflow, fidelity):
            made.append(turbine.name)
            return Simulator(turbine, inflow, fidelity)

        env = gym.make("wt_gym/NREL5MW-Steady-v1", wind_speed=8.0, simulator=maker)
        env.reset(seed=0)
        env.close()
        assert len(made) == 1


class TestPointLidar:
    """What InflowWind reads of a lidar."""

    def test_the_default_lidar_keeps_points_in_every_gate(self):
        lidar = Lidar.for_rotor(126.0)
        points = PointLidar.of(lidar)
        r2, r3 = (d * math.tan(lidar.half_angle) for d in lidar.ranges[1:])
        expected = [[-63, 0, 0], [-126, r2, 0], [-126, -r2, 0], [-189, 0, r3], [-189, 0, -r3]]
        assert not points.whole
        assert points.points == pytest.approx(np.array(expected))
        wind = SteadyInflow(10.0, 90.0, shear_exponent=0.2)
        height = 90.0 + np.array([0.0, 0.0, 0.0, r3, -r3])
        speeds = 10.0 * (height / 90.0) ** 0.2
        found = points.read(wind, 0.0, 0.4, 90.0)
        assert found == pytest.approx([speeds[0], speeds[1:3].mean(), speeds[3:].mean()])

    def test_a_lidar_of_few_points_keeps_its_places_and_reads_magnitudes(self):
        lidar = Lidar((100.0,), 0.2, 4, frozen=True)
        points, wind = PointLidar.of(lidar), SteadyInflow(10.0, inclination=0.1)
        assert points.whole
        assert points.points == pytest.approx(lidar._beams(0.0, 0.0)[0].reshape(-1, 3), abs=1e-9)
        assert points.read(wind, 0.0, 0.0, 90.0) == pytest.approx([10.0])
        assert lidar.read(wind, 0.0, 0.0, 90.0) == pytest.approx([10.0 * math.cos(0.1)])

    def test_it_has_five_points_at_most_and_each_gate_at_its_range(self):
        for gates in range(1, 6):
            points = PointLidar(tuple(50.0 * (k + 1) for k in range(gates)), n_beams=8).points
            assert len(points) == 5
            assert sorted(set(-points[:, 0])) == [50.0 * (k + 1) for k in range(gates)]
        with pytest.raises(ValueError, match=r"a lidar in OpenFAST must have at most 5 gates, .* got 6"):
            PointLidar.of(Lidar((50.0, 60.0, 70.0, 80.0, 90.0, 100.0)))


@pytest.fixture(scope="module")
def written(turbine, tmp_path_factory):
    """Primary file of a folder for the driver, in a wind that OpenFAST has no formula for."""
    wind, controller = SteadyInflow(15.0, 90.0, shear_exponent=0.2, veer=1e-3), ServedController("mine.so", "mine.in")
    folder = tmp_path_factory.mktemp("driven")
    return write_driver_run(turbine, wind, folder, controller, duration=30.0, interval=0.1, azimuth=0.5)


class TestDriverRuns:
    """Folders for OpenFAST's driver, and what it writes."""

    def test_a_folder_names_nothing_outside_itself(self, written):
        assert written.name == "model.fst"
        assert not written.with_name("turbine.fst").exists()
        for path in written.parent.rglob("*.*"):
            if path.suffix in (".fst", ".dat"):
                named = re.findall(r'"([^"]*)"', path.read_text(encoding="utf-8"))
                assert not [name for name in named if name.startswith("/") or ":" in name]
                files = [name for name in named if name.endswith((".dat", ".bts"))]
                assert all((path.parent / name).is_file() for name in files)

    def test_the_driver_runs_it_under_the_library(self, written, turbine):
        primary, servo, elasto = (
            InputFile(written.with_name(name)) for name in ("model.fst", "servodyn.dat", "elastodyn.dat")
        )
        assert (primary.number("TMax"), primary.number("DT_Out"), primary.number("TStart")) == (30.0, 0.1, 0.0)
        assert 0.1 / primary.number("DT") == pytest.approx(8.0)
        assert [servo.number(key) for key in ("PCMode", "VSContrl", "YCMode", "Ptch_Cntrl")] == [5, 5, 5, 1]
        assert (servo.text("DLL_FileName"), servo.text("DLL_InFile")) == ("mine.so", "mine.in")
        point = operating_point(turbine, 15.0)
        assert elasto.number("RotSpeed") * math.pi / 30.0 == pytest.approx(point.rotor_speed)
        assert math.radians(elasto.number("BlPitch(2)")) == pytest.approx(point.pitch)
        assert math.radians(elasto.number("Azimuth")) == pytest.approx(0.5)

    def test_inflowwind_reads_the_points_of_a_lidar(self, turbine, tmp_path, written):
        """Counted from the apex of the rotor, with the tip of the cone on the tower axis at hub height."""
        assert InputFile(written.with_name("inflowwind.dat")).number("SensorType") == 0
        lidar = PointLidar((60.0, 120.0), half_angle=0.3, n_beams=2)
        self.driven(turbine, tmp_path, lidar=lidar)
        file, step = InputFile(tmp_path / "inflowwind.dat"), InputFile(tmp_path / "model.fst").number("DT")
        lines = [line.split() for line in file.lines]
        found = {
            words[-2]: [float(word.strip(",")) for word in words[:-2]]
            for words in lines
            if len(words) > 2 and words[-2].startswith(("FocalDistance", "RotorApex"))
        }
        apex = np.array([-5.0, 0.0, 90.0])
        places = np.array([found[f"FocalDistance{axis}"] for axis in "XYZ"]).T + apex + found["RotorApexOffsetPos"]
        up = math.tan(0.3)
        expected = [[-d, 0.0, 90.0 + sign * d * up] for d in lidar.ranges for sign in (1.0, -1.0)]
        assert places == pytest.approx(np.array(expected), abs=1e-3)
        assert [file.number(key) for key in ("SensorType", "NumBeam", "NumPulseGate")] == [1, 4, 1]
        assert file.number("MeasurementInterval") == step

    @staticmethod
    def own_model(turbine, folder, **values):
        """Primary file of a model of the user's with values of module and keyword, ``ServoDyn_DT`` for example."""
        primary = write_model(turbine, folder)
        names = {"OpenFAST": primary.name, "ServoDyn": "servodyn.dat", "ElastoDyn": "elastodyn.dat"}
        for place, value in values.items():
            module, _, key = place.partition("_")
            file = InputFile(folder / names[module])
            file.set(key, value)
            file.write(file.path)
        return primary

    @staticmethod
    def driven(turbine, folder, model=None, lidar=None):
        controller = ServedController("mine.so", "mine.in", lidar)
        return write_driver_run(turbine, SteadyInflow(8.0), folder, controller, duration=1.0, interval=0.1, model=model)

    def test_the_folder_of_a_model_of_the_users_can_be_moved(self, turbine, tmp_path):
        """With what its files name: beside them, above them, by @ and by a stem; not the wind that it had."""
        own = tmp_path / "mine" / "turbine"
        model = self.own_model(turbine, own, OpenFAST_HydroFile="../sea/hydro.dat", ServoDyn_DLL_InFile="law.in")
        (own / "law.in").write_text("law\n", encoding="utf-8")
        (tmp_path / "mine" / "sea").mkdir()
        (tmp_path / "mine" / "sea" / "hydro.dat").write_text('"data/spar"  PotFile\n', encoding="utf-8")
        (tmp_path / "mine" / "sea" / "data").mkdir()
        for end in ("1", "3"):
            (tmp_path / "mine" / "sea" / "data" / f"spar.{end}").write_bytes(b"\0" + end.encode())
        polar = own / "polars" / "node_01.dat"
        polar.write_text(polar.read_text(encoding="utf-8") + '@"shape.txt" NumCoords\n', encoding="utf-8")
        (own / "polars" / "shape.txt").write_text("0 0\n", encoding="utf-8")
        (own / "polars" / "other.txt").write_text("nobody names it\n", encoding="utf-8")
        primary = self.driven(turbine, tmp_path / "run", model)
        there = tmp_path / "there"
        (tmp_path / "run").rename(there)
        (tmp_path / "mine").rename(tmp_path / "gone")
        for path in there.rglob("*.*"):
            if path.suffix in (".fst", ".dat"):
                assert str(tmp_path) not in path.read_text(encoding="utf-8")
        assert (there / InputFile(there / primary.name).text("HydroFile")).name == "hydro.dat"
        aero = InputFile(there / "aerodyn.dat")
        assert (there / aero.text("ADBlFile(1)")).read_bytes() == (
            tmp_path / "gone" / "turbine" / "aerodyn_blade.dat"
        ).read_bytes()
        assert (there / InputFile(there / "elastodyn.dat").text("TwrFile")).is_file()
        hydro = there / InputFile(there / primary.name).text("HydroFile")
        assert (hydro.parent / "data" / "spar.3").read_bytes() == b"\x003"
        assert len(list(there.rglob("shape.txt"))) == 1
        left_out = {"law.in", "inflowwind.dat", "elastodyn.dat", "servodyn.dat", "other.txt"}
        assert not left_out & {path.name for path in (there / "model").rglob("*")}

    @pytest.mark.parametrize("step", [0.008, 0.1])
    def test_the_library_of_a_model_is_called_at_its_step(self, turbine, tmp_path, step):
        """ServoDyn ends with another DLL_DT that its step does not divide, and holds demands over a longer one."""
        model = self.own_model(turbine, tmp_path / "own", OpenFAST_DT=0.008, ServoDyn_DT=0.008, ServoDyn_DLL_DT=step)
        primary = self.driven(turbine, tmp_path / "run", model)
        servo = InputFile(primary.with_name("servodyn.dat"))
        assert InputFile(primary).number("DT") == pytest.approx(0.1 / 13)
        assert servo.is_default("DT")
        assert servo.is_default("DLL_DT")

    @pytest.mark.parametrize(
        ("place", "value", "said"),
        [
            ("ElastoDyn_TipRad", 120.97, r"TipRad must be that of the turbine .*, 63 \(m .*\) within 1 %, got 120.97"),
            ("ElastoDyn_NumBl", 2, "NumBl must be that of the turbine .*, 3 .*, got 2"),
            ("ElastoDyn_GBRatio", 1.0, "GBRatio must be that of the turbine .*, 97 .*, got 1"),
            ("OpenFAST_CompElast", 2, "CompElast must be 1; blades of BeamDyn are not flown here, got 2"),
        ],
    )
    def test_models_of_another_turbine_and_blades_of_beamdyn_are_refused(self, turbine, tmp_path, place, value, said):
        model = self.own_model(turbine, tmp_path / "own", **{place: value})
        error = TurbineDefinitionError if place.startswith("ElastoDyn") else SimulationError
        with pytest.raises(error, match=said):
            self.driven(turbine, tmp_path / "run", model)
        with pytest.raises(TurbineDefinitionError, match="rotation must be 'clockwise'"):
            self.driven(mirrored(turbine), tmp_path)

    @staticmethod
    def outputs(leave_out=()):
        """Names, two rows of numbers that all differ, and the text of such a file."""
        names = [*NAMES, "GenTq", *(f"BlPitchC{b}" for b in (1, 2, 3))]
        names = ["Time", *(name for name in names if name not in leave_out)]
        rows = [[0.1 * k, *(0.01 * (k + 1) * place for place in range(1, len(names)))] for k in (0, 1)]
        lines = ["", "Predictions", "", "", "", "", "\t".join(names), "\t".join("(-)" for _ in names)]
        return names, rows, "\n".join(lines + ["\t".join(map(repr, row)) for row in rows]) + "\n"

    def test_outputs_are_signals(self, turbine, tmp_path):
        names, rows, text = self.outputs()
        (tmp_path / "model.out").write_text(text, encoding="utf-8")
        data = read_outputs(tmp_path / "model.out", turbine)
        at = {name: rows[1][k] for k, name in enumerate(names)}
        last = data.isel(time=1)
        assert float(last.time) == 0.1
        assert float(last["generator_torque"]) == pytest.approx(1e3 * at["GenTq"])
        assert float(last["root_flap_moment_2"]) == pytest.approx(1e3 * at["RootMyb2"])
        assert float(last["pitch_command_3"]) == pytest.approx(math.radians(at["BlPitchC3"]))
        turned = math.radians(at["BldPitch1"] - rows[0][names.index("BldPitch1")])
        assert float(last["pitch_travel_1"]) == pytest.approx(turned)
        assert float(last["pitch_rate_1"]) == pytest.approx(turned / 0.1)

    def test_rows_make_samples(self, turbine, tmp_path):
        names, _, text = self.outputs()
        further = [
            [0.1 * k, *(0.01 * (1 + k * (-1) ** k) * place for place in range(1, len(names)))] for k in (2, 3, 4)
        ]
        text += "\n".join("\t".join(map(repr, row)) for row in further) + "\n"
        (tmp_path / "model.out").write_text(text, encoding="utf-8")
        each, pairs = (read_outputs(tmp_path / "model.out", turbine, every) for every in (1, 2))
        assert pairs.time.values.tolist() == pytest.approx([0.0, 0.2, 0.4])
        assert pairs["generator_torque"].values.tolist() == each["generator_torque"].values[::2].tolist()
        travel, most = each["pitch_travel_2"].values, each["root_flap_moment_max_1"].values
        assert pairs["pitch_travel_2"].values[1:] == pytest.approx([travel[1:3].sum(), travel[3:5].sum()])
        assert pairs["root_flap_moment_max_1"].values[1:] == pytest.approx([max(most[1:3]), max(most[3:5])])

    @staticmethod
    def loads(path, capsys, *more):
        run_command("loads", [str(path), "--skip", "0", "--json", *more])
        return json.loads(capsys.readouterr().out.splitlines()[-1])[str(path)]

    def test_loads_are_those_of_the_turbine_that_was_flown(self, turbine, written, tmp_path, capsys):
        """Power has the gear ratio and efficiency of the generator of that turbine."""
        other = replace(
            turbine, drivetrain=replace(turbine.drivetrain, generator_efficiency=0.5), notes=("made for a test",)
        )
        shutil.copy(written.with_name("turbine.json"), tmp_path)
        (tmp_path / "other").mkdir()
        write_turbine(other, tmp_path / "other" / "turbine.json")
        paths = [tmp_path / "model.out", tmp_path / "other" / "model.out"]
        for path in paths:
            path.write_text(self.outputs()[2], encoding="utf-8")
        own, half = (self.loads(path, capsys) for path in paths)
        assert half["mean_power"] == pytest.approx(own["mean_power"] * 0.5 / turbine.drivetrain.generator_efficiency)
        (tmp_path / "turbine.json").unlink()
        with pytest.raises(SystemExit, match=r"--turbine must name the turbine of .*: there is no turbine.json beside"):
            run_command("loads", [str(paths[0])])
        assert self.loads(paths[0], capsys, "--turbine", "nrel_5mw") == own
        (tmp_path / "turbine.json").write_text('{"record": "Tower", "fields": {}}', encoding="utf-8")
        with pytest.raises(SystemExit, match="must be the file of a turbine that was written here"):
            run_command("loads", [str(paths[0])])

    @pytest.mark.parametrize("name", catalog())
    def test_a_turbine_file_gives_the_turbine_back(self, tmp_path, name):
        wanted = load_turbine(name)
        write_turbine(wanted, tmp_path / "turbine.json")
        assert fingerprint(read_turbine(tmp_path / "turbine.json")) == fingerprint(wanted)

    def test_what_is_not_such_a_file_is_refused(self, turbine, tmp_path):
        (tmp_path / "a.out").write_text("nothing\n", encoding="utf-8")
        with pytest.raises(SimulationError, match="must be a text file of outputs of OpenFAST"):
            read_outputs(tmp_path / "a.out", turbine)
        (tmp_path / "b.out").write_text(self.outputs(("RootMyb2", "GenTq"))[2], encoding="utf-8")
        with pytest.raises(SimulationError, match="RootMyb2, GenTq are missing"):
            read_outputs(tmp_path / "b.out", turbine)

    def test_the_driver_is_found_or_said_how_to_get(self, tmp_path, monkeypatch):
        monkeypatch.delenv(DRIVER_VARIABLE, raising=False)
        monkeypatch.setenv("PATH", str(tmp_path))
        monkeypatch.setenv(VARIABLE, str(tmp_path / "lib" / "libopenfastlib.so"))
        with pytest.raises(SimulationError, match=r"driver .* is not here: conda install"):
            find_driver()
        (tmp_path / "bin").mkdir()
        driver = tmp_path / "bin" / "openfast"
        driver.touch(mode=0o755)
        assert find_driver() == driver.resolve()
        monkeypatch.setenv(DRIVER_VARIABLE, str(tmp_path / "none"))
        with pytest.raises(SimulationError, match=f"{DRIVER_VARIABLE} must be the path of OpenFAST's driver"):
            find_driver()
