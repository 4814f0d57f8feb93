"""Controllers with the Bladed interface, with a small library of our own and with ROSCO."""

import copy
import importlib.util
import math
import pickle
import re
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from wt_gym.base.errors import ControllerError, SimulationError
from wt_gym.bridges.compiler import compile_library, library_name
from wt_gym.control import Demand, Lidar, operating_point
from wt_gym.control.bladed import BladedController, rosco_library
from wt_gym.control.bladed.records import channels_read, new_swap, write_readings
from wt_gym.control.bladed.rosco import quiet_input, tuned_input, with_values, write_rosco_input
from wt_gym.control.controllers import make_controller, parse_name
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.experiment.names import fingerprint
from wt_gym.experiment.run import run_controller
from wt_gym.simulation import Simulator
from wt_gym.turbines import load_turbine
from wt_gym.wind import PathInflow, SteadyInflow

TURBINE = load_turbine("nrel_5mw")
HELD = Demand(np.full(3, 0.1), 0.0, 4e4)
needs_rosco = pytest.mark.skipif(importlib.util.find_spec("rosco") is None, reason="the package rosco is not installed")


@pytest.fixture(scope="module")
def library(tmp_path_factory, compiler):
    """A compiled library that answers with what it reads."""
    folder = tmp_path_factory.mktemp("library")
    path = folder / library_name("echo")
    compile_library(Path(__file__).with_name("data") / "echo.c", path, flags=("-Wno-format",))
    return path


def readings(time=0.0, **changed):
    """Readings of an instant, zero but for those given."""
    return dict.fromkeys(channels_read(3), 0.0) | {"time": time} | changed


def input_file(tmp_path, name):
    (tmp_path / name).write_text("", encoding="utf-8")
    return tmp_path / name


def alike(one, other):
    """Whether two demands are the same."""
    return np.array_equal(one.pitch, other.pitch) and one.generator_torque == other.generator_torque


@pytest.fixture
def swaps(monkeypatch):
    """Records of all calls of libraries."""
    seen, answer = [], BladedController._answer
    monkeypatch.setattr(BladedController, "_answer", lambda self, swap: (seen.append(swap.copy()), answer(self, swap)))
    return seen


def started(library, signals=None, **options):
    controller = BladedController(TURBINE, library, **options)
    controller.start(signals or readings(), HELD)
    return controller


def test_root_moments_belong_to_the_blade_that_does_not_pitch(library):
    signals = readings(pitch_1=math.pi / 2, root_flap_moment_1=3e6, root_edge_moment_1=1e6)
    pitch = started(library, signals).step(signals, 0.1).pitch
    assert pitch[:2] == pytest.approx([-1e6, 3e6], rel=1e-6)  # turned by a quarter
    signals = readings(root_flap_moment_1=3e6, root_edge_moment_1=1e6)
    assert started(library, signals).step(signals, 0.1).pitch[:2] == pytest.approx([3e6, 1e6])


@pytest.mark.parametrize("yaw", [0.0, 0.5, -2.0])
def test_accelerations_are_those_along_axes_that_do_not_yaw(yaw):
    """What OpenFAST's YawBrTAxp and YawBrTAyp are: x to the back of a nacelle that heads along x, y to its left."""
    along, across = np.array([math.cos(yaw), math.sin(yaw)]), np.array([-math.sin(yaw), math.cos(yaw)])
    swap = new_swap()
    names = {"yaw": yaw, "nacelle_acceleration_fore_aft": 0.7, "nacelle_acceleration_side_side": -0.2}
    write_readings(swap, readings(**names), 3)
    assert swap[[52, 53]] == pytest.approx(0.7 * along - 0.2 * across, abs=1e-6)


def test_calls_come_at_the_step_or_more_often(library):
    steps = [readings(0.1 * k) for k in range(3)]
    controller = started(library, steps[0])
    demands = [controller.step(signals, 0.1) for signals in steps]
    assert [d.generator_torque for d in demands] == [1, 2, 3]
    assert [d.pitch[2] for d in demands] == pytest.approx([0.1] * 3)
    controller = started(library, steps[0], interval=0.03)
    demands = [controller.step(signals, 0.1) for signals in steps]
    assert [d.generator_torque for d in demands] == [1, 5, 9]
    assert [d.pitch[2] for d in demands] == pytest.approx([0.025] * 3)
    mean = started(library, individual_pitch=False)
    mean.step(steps[0], 0.1)
    assert mean.step(steps[1], 0.1).pitch == pytest.approx([0.1] * 3)  # record 45, the time


def test_readings_between_steps_go_linearly_and_the_azimuth_across_a_turn(library, swaps):
    first, second = readings(generator_speed=100.0, azimuth=6.2), readings(0.1, generator_speed=104.0, azimuth=0.1)
    controller = started(library, first, interval=0.05)
    controller.step(first, 0.1)
    controller.step(second, 0.1)
    half = 6.2 + 0.5 * (0.1 + 2 * math.pi - 6.2)
    expected = np.array([(0.0, 100.0, 6.2), (0.05, 102.0, half), (0.1, 104.0, 0.1)])
    assert np.array(swaps)[:, [1, 19, 59]] == pytest.approx(expected)


@pytest.mark.parametrize("isolated", [False, True])
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda controller: pickle.loads(pickle.dumps(controller))])
def test_copies_go_on_where_the_original_was(library, copied, isolated):
    controller = started(library, isolated=isolated)
    for k in range(4):
        controller.step(readings(0.1 * k), 0.1)
    twin = copied(controller)
    later = readings(0.4, root_flap_moment_1=5.0)
    ours = controller.step(later, 0.1)
    assert ours.generator_torque == 5
    assert alike(ours, twin.step(later, 0.1))


def test_a_copy_of_a_library_with_another_memory_is_refused(library, tmp_path):
    controller = started(library, input_file=input_file(tmp_path, "memory.in"))
    controller.step(readings(), 0.1)
    with pytest.raises(SimulationError, match="does not repeat its demands"):
        copy.deepcopy(controller).step(readings(0.1), 0.1)


@pytest.mark.parametrize(
    ("name", "isolated", "message"),
    [
        ("dry.in", False, "failed: the pump is dry"),
        ("dry.in", True, "failed: the pump is dry"),
        ("nan.in", False, "demands what is not finite: .* torque inf"),
        ("abort.in", True, "ended its process by signal 6: now it comes"),
    ],
)
def test_a_library_that_fails_ends_the_episode_with_its_message(library, tmp_path, name, isolated, message):
    text = f"bladed:{library}:input_file={input_file(tmp_path, name)},isolated={isolated}"
    env = WindTurbineEnv("nrel_5mw", inflow="steady", wind_speed=12.0, action_mode="residual", controller=text)
    env.reset(seed=0)
    ended = (env.step(np.zeros(env.action_space.shape)) for _ in range(3))
    info = next(info for *_, terminated, _, info in ended if terminated)
    assert info["termination"] == "failure"
    assert re.search(message, info["failure"])
    env.reset(seed=1)  # and can be used on


def test_a_warning_is_logged_once(library, tmp_path, caplog):
    controller = started(library, input_file=input_file(tmp_path, "noisy.in"))
    for k in range(3):
        controller.step(readings(0.1 * k), 0.1)
    assert [record.message for record in caplog.records] == ["controller library echo.so: the pump is noisy"]


@pytest.mark.parametrize(
    ("error", "choice", "message"),
    [
        (FileNotFoundError, "bladed:nothing.so", "no controller library"),
        (ValueError, "bladed:empty.so", "must be a shared library"),
        (ValueError, "bladed:echo.so:function=CONTROL", "no function 'CONTROL'"),
        (FileNotFoundError, "bladed:echo.so:input_file=nothing.in", "no input file"),
        (ValueError, "bladed", "must be given a library"),
        (ValueError, "bladed:echo.so:interval=0", "interval of controller 'bladed' must be a number above 0 s"),
        (ValueError, "rosco:derate=yaw", "must be one of speed, torque, pitch"),
    ],
)
def test_what_cannot_be_loaded_is_refused(error, choice, message, library, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    input_file(tmp_path, "empty.so")
    (tmp_path / "echo.so").write_bytes(library.read_bytes())
    with pytest.raises(error, match=message):
        make_controller(choice, TURBINE)


def test_names(library, tmp_path):
    found = parse_name(f"bladed+yaw:{library}:interval=0.02,isolated=True,function=OTHER")
    expected = {"library": str(library), "interval": 0.02, "isolated": True, "function": "OTHER"}
    assert found.parameters == expected
    assert parse_name(found.text) == found
    odd = tmp_path / "a:b=c" / library.name
    assert parse_name(f"bladed:{odd}").parameters == {"library": str(odd)}
    made = make_controller(found.text, TURBINE).base
    assert made.interval == 0.02
    made.start(readings(), HELD)
    assert made.step(readings(), 0.1).generator_torque == 7


def test_another_library_is_another_agent(library, tmp_path):
    """A stopped evaluation goes on only with the same files."""
    copied, read = tmp_path / library.name, input_file(tmp_path, "mine.in")
    copied.write_bytes(library.read_bytes())
    first = fingerprint(f"bladed:{copied}:input_file={read}")
    assert set(first["sha256"]) == {str(copied), str(read)}
    read.write_text("changed", encoding="utf-8")
    second = fingerprint(f"bladed:{copied}:input_file={read}")
    assert second != first
    assert second["choice"] == first["choice"]


def test_a_lidar_fills_its_records_gate_by_gate_along_the_heading(library, swaps):
    """And interpolated between calls, in what copies repeat."""
    lidar, yaw, gates = Lidar((50.0, 120.0), 0.2, 3), 0.5, ([10.0, 8.0], [12.0, 9.0], [13.0, 9.0])
    steps = [
        readings(max(0.1 * (k - 1), 0.0), yaw=yaw, lidar_1=a, lidar_2=b) for k, (a, b) in enumerate([gates[0], *gates])
    ]
    controller = started(library, steps[0], interval=0.05, lidar=lidar)
    assert controller.lidar == lidar
    assert controller.channels[-2:] == ("lidar_1", "lidar_2")
    for signals in steps[1:3]:
        controller.step(signals, 0.1)
    x, y = [-d * math.cos(yaw) for d in lidar.ranges], [-d * math.sin(yaw) for d in lidar.ranges]
    places = [*x, *y, TURBINE.hub_height, TURBINE.hub_height]
    for found, speeds in zip(swaps, ([10.0, 8.0], [11.0, 8.5], [12.0, 9.0]), strict=True):
        expected = [0.0, 0.0, 3.0, 1.0, 2.0, 0.0, *speeds, *places, *[0.0] * 8]
        assert found[1998:2020] == pytest.approx(np.array(expected, dtype=np.float32), abs=1e-5)
    copy.deepcopy(controller).step(steps[3], 0.1)
    assert np.array_equal(np.array(swaps[:3])[:, 1998:2020], np.array(swaps[3:6])[:, 1998:2020])


def test_a_library_in_an_environment_reads_what_the_lidar_of_its_turbine_sees(library):
    env = WindTurbineEnv(
        controller=f"bladed:{library}:lidar=True", observation=["lidar"], inflow="turbulent", wind_speed=12.0,
        action_mode="residual",
    )  # fmt: skip
    env.reset(seed=1)
    base = env.operation.controller
    assert base.lidar == Lidar.for_rotor(env.turbine.rotor_diameter)
    look = env.operation.ahead(env.signals)
    assert np.ptp(look) > 0.1
    assert base._swap[2004:2007] == pytest.approx(look, rel=1e-6)
    env.close()


@needs_rosco
def test_rosco_runs_the_5mw_as_its_input_file_says():
    """λ = 7.5 below rated (``VS_TSRopt``), rated speed and power above; no prints on the way."""
    source = tuned_input(TURBINE)
    assert source is not None
    assert source.name == "DISCON.IN"
    steady = {}
    for wind in (8.0, 16.0):
        simulator = Simulator(TURBINE, SteadyInflow(wind, TURBINE.hub_height), "training")
        record = run_controller(simulator, make_controller("rosco", TURBINE), 60.0).to_dataset()
        steady[wind] = record.isel(time=slice(-100, None)).mean()
    assert float(steady[8.0].rotor_speed) * 63.0 / 8.0 == pytest.approx(7.5, rel=0.03)
    assert float(steady[16.0].generator_power) == pytest.approx(5e6, rel=2e-3)
    assert float(steady[16.0].rotor_speed) * 30 / math.pi == pytest.approx(12.1, rel=2e-3)


def stood(turbine):
    """Rotor speed, pitch and torque of a turbine that stands with feathered blades, and the demand that holds them."""
    feather = min(turbine.pitch.max_pitch, 0.5 * math.pi)
    return {"rotor_speed": 0.0, "pitch": feather, "generator_torque": 0.0}, Demand(np.full(3, feather), 0.0, 0.0)


def flown(simulator, controller, start, demand, until):
    """Time, rotor speed, power and pitch after each step of a controller, and its demands of pitch, each (n,)."""
    signals, rows = simulator.reset(**start), []
    controller.start(signals, demand)
    while signals["time"] < until - 1e-6:
        demand = controller.step(signals, 0.1)
        signals = simulator.advance(0.1, demand.pitch, 0.0, demand.generator_torque)
        rows.append([*(signals[c] for c in ("time", "rotor_speed", "generator_power", "pitch_1")), demand.pitch[0]])
    return np.array(rows).T


@needs_rosco
def test_rosco_starts_a_parked_turbine_in_stages_up_to_rated():
    """At a tenth of its durations: a wait of 12 s, free-wheeling for 20 s at 6.9 rpm, a fifth of the load, all."""
    simulator = Simulator(TURBINE, SteadyInflow(14.0, TURBINE.hub_height), "training")
    controller = make_controller("rosco", TURBINE, start_stop=True, time_scale=0.1)
    times, speeds, powers, _, demanded = flown(simulator, controller, *stood(TURBINE), 130.0)
    np.testing.assert_allclose(demanded[times < 11.9], 0.5 * math.pi, atol=2e-3)
    loaded = times[np.argmax(powers > 1e4)]
    least = 0.7226  # of the turbine [rad/s]
    assert times[np.argmax(speeds > 0.95 * least)] + 20.0 < loaded < 70.0
    assert powers[(times > loaded + 12.0) & (times < loaded + 28.0)] == pytest.approx(1e6, rel=0.15)
    last = times > 120.0
    assert powers[last].mean() == pytest.approx(5e6, rel=0.01)
    assert speeds[last].mean() * 30 / math.pi == pytest.approx(12.1, rel=0.01)


@needs_rosco
def test_rosco_stops_above_cut_out_for_good():
    """The pitch in 28 m/s lies above the one in 25; pitch to feather at a degree a second, torque at 750 N m/s."""
    inflow = PathInflow(
        np.array([0.0, 10.0, 15.0, 100.0, 110.0, 150.0]), np.array([24.0, 24.0, 28.0, 28.0, 15.0, 15.0]),
        SteadyInflow(1.0, TURBINE.hub_height),
    )  # fmt: skip
    controller = make_controller("rosco", TURBINE, start_stop=True, time_scale=0.02)
    assert [controller.runs_in(wind) for wind in (2.0, 3.0, 25.0, 26.0)] == [False, True, True, False]
    start = asdict(operating_point(TURBINE, 24.0))
    demand = Demand(np.full(3, start["pitch"]), 0.0, start["generator_torque"])
    time, speed, power, pitch, _ = flown(Simulator(TURBINE, inflow, "training"), controller, start, demand, 150.0)
    assert power[time < 15.0] == pytest.approx(5e6, rel=0.03)
    stops = time[np.argmax(power < 4.5e6)]
    assert 15.0 < stops < 40.0
    falling = (time > stops + 5.0) & (time < stops + 30.0)
    assert np.polyfit(time[falling], pitch[falling], 1)[0] == pytest.approx(math.radians(1.0), rel=0.01)
    assert (power[time > 100.0] < 1e3).all()  # also in 15 m/s
    assert abs(speed[time > 100.0]).max() < 0.1


@needs_rosco
def test_rosco_starts_and_stops_with_the_numbers_of_a_file_that_is_given(tmp_path):
    source = tuned_input(TURBINE)
    given = with_values(quiet_input(source), {"SU_StartTime": 7.5, "SD_EnablePitch": 1})
    (tmp_path / "mine.in").write_text(given, encoding="utf-8")
    controller = make_controller("rosco", TURBINE, input_file=tmp_path / "mine.in", start_stop=True)

    def values(name):
        text = Path(controller.input_file).read_text(encoding="utf-8")
        return re.search(rf"^(.*?) *! {name}\b", text, re.MULTILINE)[1].split()

    _, parked = stood(TURBINE)
    controller.start(readings(), parked)
    assert [values(name) for name in ("SU_Mode", "SD_Mode", "SU_StartTime")] == [["1"], ["1"], ["7.5"]]
    controller.start(readings(rotor_speed=1.2), HELD)  # no start-up of a turbine that runs
    assert [values(name) for name in ("SU_Mode", "SD_Mode", "SD_EnablePitch")] == [["0"], ["1"], ["1"]]


def test_an_input_file_of_rosco_may_have_any_form(tmp_path):
    """ROSCO takes keywords in any case, with or without an exclamation mark, and reads bytes."""
    (tmp_path / "cp.txt").write_text("table")
    source = tmp_path / "DISCON.IN"
    source.write_bytes(
        "! Gr\u00f6\u00dfe \u0085\r\n2 LOGGINGLEVEL\r\n1 ! echo - e\r\n'cp.txt' perffilename\r\n".encode("latin-1")
    )
    lines = quiet_input(source).splitlines()
    assert [line for line in lines if "!" in line][-3:] == [
        "0 ! LoggingLevel", "0 ! Echo", f'"{tmp_path / "cp.txt"}" ! PerfFileName'
    ]  # fmt: skip


@needs_rosco
@pytest.mark.parametrize("turbine", ["nrel_5mw", "iea_15mw", "iea_22mw", "gebhardt_45m"])
def test_rosco_takes_an_input_file_made_from_any_turbine_and_its_stages(turbine, tmp_path, capfd):
    turbine = load_turbine(turbine)
    write_rosco_input(turbine, tmp_path / "DISCON.IN")
    controller = make_controller("rosco", turbine, input_file=tmp_path / "DISCON.IN")
    speed = turbine.drivetrain.rated_rotor_speed
    signals = readings(wind_x=15.0, rotor_speed=speed, generator_speed=speed * turbine.drivetrain.gear_ratio)
    controller.start(signals, HELD)
    assert 0.0 < controller.step(signals, 0.1).generator_torque <= 1.2 * turbine.drivetrain.max_generator_torque
    twin, later = copy.deepcopy(controller), signals | {"time": 0.1, "wind_x": 15.5}
    assert alike(controller.step(later, 0.1), twin.step(later, 0.1))
    controller = make_controller("rosco", turbine, start_stop=True)
    feather = min(turbine.pitch.max_pitch, 0.5 * math.pi)
    signals = readings(pitch_1=feather, pitch_2=feather, pitch_3=feather, wind_x=8.0)
    controller.start(signals, stood(turbine)[1])
    demand = controller.step(signals, 0.1)
    assert demand.pitch == pytest.approx([feather] * 3)
    assert demand.generator_torque == 0.0
    assert capfd.readouterr() == ("", "")


def test_without_the_package_rosco_says_how_to_get_it(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ControllerError, match=r"pip install 'wt_gym\[rosco\]'"):
        rosco_library()
