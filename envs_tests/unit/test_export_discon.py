"""Controllers exported as libraries with the Bladed interface, against Python's on the same readings."""

import json
import math
import os
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from envs_tests.unit.exported_library import (
    INTERVAL,
    Exported,
    lost,
    numbers_read,
    pitches,
    random_readings,
    sanitized,
    together,
    torques,
)  # fmt: skip
from wt_gym.base.files import read_toml
from wt_gym.bridges.openfast import write_model
from wt_gym.commands import run as run_command
from wt_gym.control import Demand, Lidar
from wt_gym.control.bladed import BladedController
from wt_gym.control.controllers import Combined, lidar_of, make_controller
from wt_gym.control.controllers.linear_optimal import LinearDesign, save_design
from wt_gym.deployment.export.discon import export_discon
from wt_gym.deployment.export.parts import controller_parts
from wt_gym.turbines import load_turbine
from wt_gym.turbines.catalog import turbine_file
from wt_gym.turbines.openfast_text import InputFile

pytestmark = pytest.mark.usefixtures("compiler")
DT = INTERVAL
CONTROLLERS = read_toml(Path(__file__).with_name("data") / "exported_controllers.toml")["controllers"]


def start_demand(readings, turbine):
    pitch = np.array([readings[f"pitch_{b + 1}"] for b in range(turbine.n_blades)])
    # as records hold it
    return Demand(
        pitch.astype(np.float32).astype(float), 0.0, float(np.float32(0.5 * turbine.drivetrain.max_generator_torque))
    )


def side_by_side(controller, library, parameters, turbine, readings):
    """Demands of a controller and of its library for the same readings, after they have been compared."""
    for k, signals in enumerate(readings):
        if k == 0:
            held = start_demand(signals, turbine)
            ours = Exported(library, turbine, parameters, held, lidar=lidar_of(controller))
        read = ours.read(signals)
        if k == 0:
            controller.start(read, held)
        expected, found = controller.step(read, DT), ours.call(k * DT, DT)
        assert ours.flag == 0, ours.message
        assert np.abs(found.pitch - expected.pitch).max() < 2e-7  # pytest.approx takes most of the time
        torque = expected.generator_torque
        assert abs(found.generator_torque - torque) <= max(1e-6 * abs(torque), 1e-3)
        assert abs(found.yaw_rate - expected.yaw_rate) <= 1e-8
        yield expected, found


@pytest.fixture
def load(exported):
    """Loads the library of a controller, with its own parameter file or another one."""

    def load(choice, held=None, file=None, name="nrel_5mw", drive=None, **options):
        _, library, parameters, _ = exported(choice, name, **({} if drive is None else {"drive": drive}))
        return Exported(library, load_turbine(name), parameters if file is None else file, held, **options)

    return load


@pytest.mark.parametrize(("choice", "name"), CONTROLLERS)
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_random_readings_give_the_demands_of_the_controller(choice, name, seed, exported):
    """The same up to the single precision of the demands, over 100 s of readings that reach everywhere."""
    turbine, (_, library, parameters, _) = load_turbine(name), exported(choice, name)
    controller = make_controller(choice, turbine)
    readings = random_readings(turbine, 1000, seed, DT, 3 if lidar_of(controller) else 0)
    pitch = pitches(expected for expected, _ in side_by_side(controller, library, parameters, turbine, readings))
    assert (np.ptp(pitch, axis=1) if "ipc" in choice else abs(pitch[:, 0])).max() > 0.01  # it did act


def test_a_published_set_point_smoother_and_an_unlimited_torque(exported, tmp_path):
    path = tmp_path / "mine.yaml"
    shutil.copy(turbine_file("iea_15mw"), path)
    shifts = {"speed_shift_per_pitch": 1.9, "speed_shift_per_power": 0.001, "speed_shift_frequency": 0.63}
    path.with_name("mine.control.json").write_text(json.dumps(shifts), encoding="utf-8")
    turbine, (_, library, parameters, _) = load_turbine(path), exported("discon", str(path))
    controller = make_controller("discon", turbine)
    pairs = side_by_side(controller, library, parameters, turbine, random_readings(turbine, 1000, 0, DT))
    most = max(expected.generator_torque for expected, _ in pairs)
    assert most == pytest.approx(controller.parameters.rated_torque)


@pytest.mark.parametrize(
    ("choice", "name"),
    [
        ("discon+derate_speed", "nrel_5mw"),
        ("retuned+derate_torque+ipc:power_level=0.7", "nrel_5mw"),
        ("discon+derate_pitch", "nrel_5mw"),
        ("derate_kinetic+tower_dampers:lowest_speed=0.85,band=0.05,raised=0.02", "nrel_5mw"),
        ("discon+derate_kinetic", "gebhardt_45m"),
    ],
)
def test_a_demanded_power_is_followed_as_by_the_controller(choice, name, exported):
    """Record 13 wanders and jumps, is missing for a while (0), and asks for less and more than there can be."""
    turbine, (_, library, parameters, _), rng = load_turbine(name), exported(choice, name), np.random.default_rng(4)

    def asked():
        for k, signals in enumerate(random_readings(turbine, 1500, 7, DT)):
            if k % 50 == 0:
                share = rng.choice([0.0, 0.1, 1.2, *rng.uniform(0.3, 1.0, 4)])
            yield signals | {"demanded_power": turbine.drivetrain.rated_power * share}

    pairs = side_by_side(make_controller(choice, turbine), library, parameters, turbine, asked())
    torque = [found.generator_torque for _, found in pairs]
    assert np.ptp(torque) > 0.5 * max(torque)


WHOLE = "constrained_ipc:level=0.02,fade=False"
DAMPERS = "discon+tower_dampers:fade=False"


def recorded(count, seed=3, name="nrel_5mw", **changes):
    """A turbine and drawn readings, some of them at a value."""
    turbine = load_turbine(name)
    return turbine, [now | changes for now in random_readings(turbine, count, seed, DT)]


def run(ours, signals, dt=DT, first=0):
    """Demands of a library over readings."""
    return together((ours, signals), dt=dt, first=first)[0]


def same(found, expected, pitch=1e-6, torque=1e-5):
    """Whether demands are alike."""
    np.testing.assert_allclose(pitches(found), pitches(expected), atol=pitch)
    np.testing.assert_allclose(torques(found), torques(expected), rtol=torque)


def test_it_acts_at_its_own_step_whatever_that_of_the_caller(load):
    """Called eight times a step it acts on the readings of every eighth call, also after ten hours.

    It starts anew with the readings of the second call. Calls that are farther apart make several steps.
    """
    _, signals = recorded(100)
    coarse = pitches(run(load(WHOLE), signals))
    for begin in (0.0, 36000.0):
        ours, fine = load(WHOLE), []
        for k, now in enumerate(signals):
            for part in range(8):
                ours.read(now if part == 0 or 8 * k + part == 1 else signals[(k + 50) % 100])
                fine.append(ours.call(begin + DT * k + DT / 8 * part, DT / 8).pitch)
        assert np.array_equal(np.array(fine), np.repeat(coarse, 8, axis=0))
    twice = [signals[max(2 * ((k + 1) // 2), 0)] for k in range(40)]  # 0, then each of the others twice
    far = pitches(run(load("discon"), signals[:40:2], dt=2 * DT))
    assert np.array_equal(pitches(run(load("discon"), twice))[::2], far)


def test_the_rotor_speed_stands_in_for_that_of_the_generator_and_the_azimuth_goes_on(load):
    ratio = load_turbine("nrel_5mw").drivetrain.gear_ratio
    _, signals = recorded(100, rotor_speed=1.2, generator_speed=1.2 * ratio)
    signals = [now | {"azimuth": 0.12 * k} for k, now in enumerate(signals)]
    flights = (load(WHOLE), signals), (load(WHOLE), signals)
    found, expected, _ = together(*flights, spoil=lost(20, since=11))
    same(found, expected, pitch=1e-5)


def drawn_design(path, knots, interval=DT, fade=0.05):
    """Design of drawn matrices, with an output that keeps what lasts, and one that has a washout of its own."""
    rng, n = np.random.default_rng(5), len(knots)
    design = LinearDesign(
        pitch=np.array(knots), responses=rng.normal(size=(n, 6, 3, 13)), gains=4e-3 * rng.normal(size=(n, 3, 6, 7)),
        scale=np.array([3e6, 3e6, 3e6, 0.5, 0.2, 0.3]), washout=np.array([30.0, 0.0, 0.0, 5.0, 30.0, 30.0]),
        loads=np.zeros((n, 2, 3, 13)), interval=interval, limit=0.07, rate_limit=0.05, fade=fade, fine_speed=(0.9, 1.0),
    )  # fmt: skip
    save_design(design, path)
    return path


@pytest.mark.parametrize(
    ("knots", "interval", "name"),
    [((0.2,), DT, "nrel_5mw"), ((0.0, 0.1, 0.3), 2 * DT, "nrel_5mw"), ((0.1, 0.2), DT / 2, "iea_15mw")],
)
def test_linear_pitch_of_any_design_is_that_of_the_controller(knots, interval, name, exported, tmp_path):
    """One design and several, decisions at every second step, and two intervals within a step."""
    choice = f"linear_optimal:file={drawn_design(tmp_path / 'drawn.npz', knots, interval)}"
    turbine, (_, library, parameters, _) = load_turbine(name), exported(choice, name)
    readings = random_readings(turbine, 600, 7, DT)
    pairs = side_by_side(make_controller(choice, turbine), library, parameters, turbine, readings)
    assert max(np.ptp(expected.pitch) for expected, _ in pairs) > 0.01


@pytest.mark.parametrize(
    ("choice", "alone", "record", "value", "seconds"),
    [
        *((WHOLE, "discon", 31, value, 4.0 / 1.5) for value in (math.nan, math.inf, 1e12)),  # at the limit of the rate
        ("linear_optimal", "side_side_damper", 31, math.nan, 2 * 0.07 / 0.05),
        *((DAMPERS, "discon", record, math.nan, 40.0) for record in (37, 53, 54, 1006)),
    ],
)
def test_what_a_missing_reading_serves_rests_which_is_said_once(choice, alone, record, value, seconds, load, tmp_path):
    """Demands come back to those of the controller without the part."""
    name = "nrel_5mw" if record < 1000 else "oc4_nrel_5mw"
    speed = load_turbine(name).drivetrain.rated_rotor_speed
    turbine, signals = recorded(600, name=name, **({"yaw": 1.0} if choice == DAMPERS else {"rotor_speed": speed}))
    if choice == "linear_optimal":
        choice += f":file={drawn_design(tmp_path / 'drawn.npz', (0.2,), fade=0.001)}"
    held = start_demand(signals[0], turbine)
    flights = [(load(one, held, name=name), signals) for one in (choice, alone)]
    found, plain, said = together(*flights, spoil=lost(record, since=150, value=value))
    wanted = np.clip(pitches(plain), turbine.pitch.min_pitch, None)
    apart = abs(torques(found) - torques(plain)) / turbine.drivetrain.max_generator_torque
    apart = np.maximum(apart, abs(pitches(found) - wanted).max(axis=1))
    assert max(apart[50:150]) > 1e-3
    assert max(apart[150 + math.ceil(seconds / DT) :]) < 1e-6
    assert [(k, flag) for k, flag, _ in said] == [(150, 1)]
    assert f"record {record}" in said[0][2]


def test_accelerations_may_come_along_the_nacelle_instead(exported, load, tmp_path):
    """As Bladed gives them: the same demands as of those along axes that do not yaw, and no yaw is needed."""
    turbine, signals = recorded(300)
    text = Path(exported(DAMPERS)[2]).read_text(encoding="utf-8")
    assert "\nacceleration_axes = 0.0 " in text
    along = tmp_path / "nacelle.in"
    along.write_text(text.replace("acceleration_axes = 0.0", "acceleration_axes = 1"), encoding="utf-8")
    held, apart = start_demand(signals[0], turbine), []

    def turned(k, swap):
        own = [signals[k][f"nacelle_acceleration_{name}"] for name in ("fore_aft", "side_side")]
        apart.append(abs(swap[52] - own[0]))
        swap[52:54], swap[36] = own, math.nan

    found, expected, said = together(
        (load(DAMPERS, held, along), signals), (load(DAMPERS, held), signals), spoil=turned
    )
    assert said == []
    same(found, expected, torque=1e-6)
    assert max(apart) > 1.0  # the nacelle stood askew


GENERATOR, ROTOR = 20, 21


def in_full_wind(turbine, count):
    """Readings of a turbine that holds its rated power at a pitch of 0.2 rad, and its demand before the first."""
    speed = turbine.drivetrain.rated_rotor_speed
    held = next(random_readings(turbine, 1, 0, DT)) | {f"pitch_{b}": 0.2 for b in (1, 2, 3)} | {"wind_x": 18.0}
    turns = [speed * (1.0 + 0.005 * math.sin(0.3 * k)) for k in range(count)]
    ratio = turbine.drivetrain.gear_ratio
    signals = [held | {"rotor_speed": now, "generator_speed": now * ratio} for now in turns]
    return signals, replace(start_demand(held, turbine), pitch=np.full(3, 0.2))


@pytest.mark.parametrize("value", [math.nan, 1e6])
@pytest.mark.parametrize(
    ("losses", "last_seen", "said_at", "last_words"),
    [
        ({GENERATOR: 100}, 200, [100], "the rotor speed stands in for it"),
        ({ROTOR: 100}, 200, [], ""),  # nobody reads it
        ({GENERATOR: 100, ROTOR: 100}, 99, [100], "its last value is held"),
        ({GENERATOR: 50, ROTOR: 100}, 99, [50, 100], "its last value is held"),
        ({GENERATOR: 50, ROTOR: 0}, 49, [50], "its last value is held"),  # what is missing stands in for nothing
    ],
)
def test_a_controller_goes_on_without_speed_readings(losses, last_seen, said_at, last_words, value, load):
    """One speed stands in for the other, as good as it; without both the last one is held, and that is said.

    Demands are those of a library that sees the readings of a call for ever.
    """
    signals, held = in_full_wind(load_turbine("nrel_5mw"), 200)
    seen = [signals[min(k, last_seen)] for k in range(200)]

    def spoil(k, swap):
        for record, since in losses.items():
            lost(record, since=since, value=value)(k, swap)

    found, expected, said = together((load("discon", held), signals), (load("discon", held), seen), spoil=spoil)
    same(found, expected)
    assert pitches(found).min() > 0.1
    assert [(k, flag) for k, flag, _ in said] == [(k, 1) for k in said_at]
    assert not said or last_words in said[-1][2]


@pytest.mark.parametrize("records", [(GENERATOR,), (GENERATOR, ROTOR)])
def test_without_the_generator_speed_nothing_starts(records, load):
    signals, _ = in_full_wind(load_turbine("nrel_5mw"), 1)
    _, ((_, flag, message),) = together((load("discon"), signals), spoil=lost(*records))
    assert flag == -1
    assert all(f"speed (record {record})" in message for record in records)
    assert "nothing to start from" in message


def test_a_first_call_with_another_status_starts_and_the_last_one_holds(load):
    _, signals = recorded(20)
    ours, found = load(WHOLE), []
    for k, now in enumerate([*signals, signals[0]]):
        ours.read(now)
        found.append(ours.call(k * DT, DT, status=1 if k < 20 else -1).pitch)
    assert np.array_equal(found, [*(expected := pitches(run(load(WHOLE), signals))), expected[-1]])
    assert ours.flag == 0


def test_collective_pitch_only_is_said_where_blades_are_pitched_one_by_one(load):
    _, signals = recorded(2)
    ours = load(WHOLE, individual=False)
    first = run(ours, signals[:1])
    assert ours.flag == 1
    assert "record 28 must be 1" in ours.message
    assert ours.swap[44] == pytest.approx(first[0].pitch.mean(), abs=1e-6)
    run(ours, signals[1:], first=1)
    assert ours.flag == 0


def test_parameters_can_be_changed_in_the_file(exported, load, tmp_path):
    turbine, signals = recorded(200)
    _, library, parameters, _ = exported("discon")
    text = Path(parameters).read_text(encoding="utf-8")
    changed = tmp_path / "slow.in"
    changed.write_text(text.replace("corner_frequency = ", "corner_frequency = 2.5 # was "), encoding="utf-8")
    controller = make_controller("discon:corner_frequency=2.5", turbine)
    found = [ours for _, ours in side_by_side(controller, library, changed, turbine, signals)]
    held = start_demand(signals[0], turbine)
    unchanged = pitches(run(load("discon", held, ""), signals))  # without a file as it was exported
    assert np.array_equal(unchanged, pitches(run(load("discon", held), signals)))
    assert abs(unchanged - pitches(found)).max() > 1e-3


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("proportional_gian = 1", "line 1: there is no parameter 'proportional_gian'"),
        ("proportional_gain = x", "line 1: proportional_gain must be 1 number.* from 0 to inf"),
        ("proportional_gain = -1", "line 1: proportional_gain must be 1 number.* from 0 to inf"),
        ("proportional_gain = nan", "line 1: proportional_gain must be 1 number.* from 0 to inf"),
        ("proportional_gain = 1 2", "there are more"),
        ("proportional_gain", "must be 'name = value'"),
        ("= 3", "must be 'name = value'"),
        (None, "must be readable"),
    ],
)
def test_a_parameter_file_with_an_error_ends_the_simulation(line, message, load, tmp_path):
    if line is not None:
        (tmp_path / "wrong.in").write_text(line + "\n", encoding="utf-8")
    ours = load("discon", file=tmp_path / "wrong.in")
    run(ours, recorded(1)[1])
    assert ours.flag == -1
    assert re.search(message, ours.message)


def written_numbers(count):
    """Numbers as parameter files have them, of every size, and in other writings."""
    rng = np.random.default_rng(0)
    values = rng.integers(0, 2**63, count, dtype=np.uint64).view(np.float64)  # finite or not, every exponent
    texts = [repr(x) for x in values[np.isfinite(values)].tolist()]
    texts += [repr(-float(x)) for x in 10.0 ** rng.uniform(-12.0, 12.0, count)]
    texts += [
        f"{x:.{d}e}" for x, d in zip(10.0 ** rng.uniform(-9.0, 9.0, count), rng.integers(0, 35, count), strict=True)
    ]
    texts += [f"{x:.20f}" for x in rng.normal(size=count)]
    halves = rng.integers(2**52, 2**53, 100).tolist()
    texts += [str(2 * half + 1) for half in halves]  # halfway between two numbers
    texts += ["0", "-0.0", "+1", ".5", "5.", "1e5", "1E+05", "00012.50", "5e-324", "2.4703282292062327e-324", "1e-330",
              "2.2250738585072011e-308", "1.7976931348623157e308", "1.7976931348623159e308", "1e999", "-1e-999", "inf",
              "0." + "0" * 350 + "1", "1" + "0" * 300, "9007199254740993", " \t3.5"]  # fmt: skip
    return texts


def test_numbers_of_a_parameter_file_are_those_of_python(exported, tmp_path):
    texts = written_numbers(2000)
    found = numbers_read(exported("discon")[0], texts, tmp_path)
    expected = [float(text) for text in texts]
    wrong = [(t, f, e) for t, (f, _), e in zip(texts, found, expected, strict=True) if f != e]
    assert wrong == []
    assert [count for _, count in found] == [len(text) for text in texts]
    texts = ["1.5 2", "1,5", "1e", "2e+", "3x", "0x10", "", "x", "-", ".", "nan", "1.2.3"]  # they end where none is
    ended = [(1.5, 3), (1.0, 1), (1.0, 1), (2.0, 1), (3.0, 1), (0.0, 1), *[(0.0, 0)] * 5, (1.2, 3)]
    assert numbers_read(exported("discon")[0], texts, tmp_path) == ended


def test_numbers_have_a_point_where_the_locale_has_a_comma(exported, tmp_path):
    if (define := shutil.which("localedef")) is None:
        pytest.skip("localedef is needed")
    made = subprocess.run(
        [define, "-c", "-f", "UTF-8", "-i", "de_DE", str(tmp_path / "de_DE.UTF-8")], capture_output=True
    )
    if not (tmp_path / "de_DE.UTF-8").exists():
        pytest.skip(f"localedef makes no German locale: {made.stderr!r}")
    environment = os.environ | {"LOCPATH": str(tmp_path)}
    found = numbers_read(exported("discon")[0], ["0.1", "-2.5e-3"], tmp_path, "de_DE.UTF-8", environment)
    assert found == [(0.1, 3), (-2.5e-3, 7)]


@pytest.mark.parametrize("length", [0.0, -1.0, math.nan, 4.0e9])
def test_a_parameter_file_is_read_when_its_length_is_not_given(length, load, tmp_path):
    """The name ends with its null then; an unreadable one ends the simulation and is not passed over."""
    (turbine, signals), changed = recorded(100), tmp_path / "slow.in"
    changed.write_text("corner_frequency = 0.5\n", encoding="utf-8")
    held = start_demand(signals[0], turbine)
    ours, whole, none = (load("discon", held, file) for file in (changed, changed, tmp_path / "none.in"))
    ours.swap[49] = none.swap[49] = length
    assert np.array_equal(pitches(run(ours, signals)), pitches(run(whole, signals)))
    run(none, signals[:1])
    assert none.flag == -1
    assert "none.in must be readable" in none.message


def called(library, time, status):
    """Save or read a checkpoint."""
    library.call(time, DT, status=status)
    assert (library.flag, library.message) == (0, "")


@pytest.mark.parametrize("choice", ["tsr_tracking+ipc+yaw:dead_band=0.05", WHOLE])
def test_a_checkpoint_brings_another_instance_to_the_same_place(choice, load):
    _, signals = recorded(300)
    ours, other = load(choice), load(choice)
    run(ours, signals[:150])
    swap = ours.swap.copy()
    called(ours, 14.9, -8)
    assert np.array_equal(swap[3:], ours.swap[3:])
    expected = run(ours, signals[150:], first=150)
    shutil.copy(f"{ours.library.output_name}.14900.checkpoint", other.library.output_name.rpartition("/")[0])
    other.swap[:] = swap
    called(other, 14.9, -9)
    assert np.array_equal(pitches(run(other, signals[150:], first=150)), pitches(expected))


def test_a_checkpoint_can_be_named_in_place_of_the_parameter_file(exported, load, tmp_path):
    """As OpenFAST does; the parameter file itself is never written."""
    _, signals = recorded(200)
    ours, other, parameters = load(WHOLE), load(WHOLE), exported(WHOLE)[2]
    text, name = Path(parameters).read_bytes(), str(tmp_path / "run.160.dll.chkp")
    other.call(0.0, DT, status=-8)
    assert Path(parameters).read_bytes() == text
    run(ours, signals[:100])
    swap = ours.swap.copy()
    for one, status in ((ours, -8), (other, -9)):
        one.swap[:] = swap
        one.input_file, one.swap[49] = name, len(name) + 1
        called(one, 9.9, status)
        one.input_file, one.swap[49] = str(parameters), len(str(parameters)) + 1
    expected, found, _ = together((ours, signals[100:]), (other, signals[100:]), first=100)
    assert np.array_equal(pitches(found), pitches(expected))
    other.input_file, other.swap[49] = f"{name}.none", len(name) + 6
    other.call(9.9, DT, status=-9)
    assert other.flag == -1
    assert "run.160.dll.chkp.none could not be read" in other.message


def test_a_checkpoint_that_is_none_is_refused(load):
    ours, other = load("discon"), load(WHOLE)
    other.call(0.0, DT, status=-9)
    assert other.flag == -1
    assert "could not be read" in other.message
    run(ours, recorded(1)[1])
    ours.call(0.0, DT, status=-8)
    shutil.copy(f"{ours.library.output_name}.0.checkpoint", f"{other.library.output_name}.0.checkpoint")
    other.call(0.0, DT, status=-9)
    assert other.flag == -1
    assert "must be one of this controller" in other.message


def test_drives_in_the_library_keep_the_limits_of_the_turbine(load):
    """With drives of its own the pitch is that of a command at the greatest rate, and the torque moves evenly."""
    turbine, signals = recorded(300)
    held, parts = start_demand(signals[0], turbine), 8
    found = run(load(WHOLE, held, drive=True), np.repeat(signals, parts), dt=DT / parts)
    command, expected, rate, most = held.pitch, held.pitch, np.zeros(3), turbine.pitch.max_rate
    for k, demand in enumerate(run(load(WHOLE, held), signals)):
        # the drive of the simulator: its rate goes from that of the last command to that of this one within the step
        assert found[parts * k].pitch == pytest.approx(expected, abs=1e-6)
        before = rate
        rate = np.clip((np.clip(demand.pitch, 0.0, turbine.pitch.max_pitch) - command) / DT, -most, most)
        expected, command = expected + 0.5 * DT * (before + rate), command + DT * rate
    rates = abs(np.diff(pitches(found), axis=0) / (DT / parts)).max()
    assert 0.9 * most < rates <= most * 1.001
    assert abs(np.diff(torques(found))).max() <= turbine.drivetrain.max_torque_rate * DT / parts * 1.001


def test_drives_do_not_drift_where_steps_of_the_caller_fit_none_of_the_controller(load):
    turbine, signals = recorded(200)
    held = start_demand(signals[0], turbine)
    expected = pitches(run(load(WHOLE, held, drive=True), signals))
    odd, found, k, dt = load(WHOLE, held, drive=True), [], 0, 0.03
    for call in range(round(200 * DT / dt)):
        time = call * dt
        if time >= DT * k - 0.5 * dt:  # the readings of the step that is due
            odd.read(signals[k])
            k += 1
        found.append(odd.call(time, dt).pitch)
    times = dt * np.arange(len(found))
    times = times[times <= DT * 199]  # what is known of the way
    found = found[: len(times)]
    smooth = np.array([np.interp(times, DT * np.arange(200), column) for column in expected.T]).T
    # the evenness of a step and half a step of the caller at the greatest rate
    assert abs(np.array(found) - smooth).max() < 0.7 * dt * turbine.pitch.max_rate + 0.3 * DT * turbine.pitch.max_rate


def test_drives_that_are_servos_settle_on_the_demand(tmp_path):
    turbine = load_turbine("iea_15mw")
    turbine = replace(turbine, pitch=replace(turbine.pitch, servo_frequency=2.0, servo_damping=0.7))
    _, library, parameters, _ = export_discon("discon", tmp_path, turbine=turbine, interval=DT, drive=True)["files"]
    signals = next(random_readings(turbine, 1, 0, DT))
    speed = 1.02 * turbine.drivetrain.rated_rotor_speed
    signals |= {"rotor_speed": speed, "generator_speed": speed * turbine.drivetrain.gear_ratio}
    signals |= {f"pitch_{b}": 0.2 for b in (1, 2, 3)}
    count, dt = 2000, DT / 8
    ours = Exported(library, turbine, parameters)
    angles = pitches(run(ours, [signals] * count, dt=dt))[:, 0]
    (tmp_path / "bare.in").write_text("drive = 0\n", encoding="utf-8")
    demands = pitches(run(Exported(library, turbine, tmp_path / "bare.in"), [signals] * count, dt=dt))[:, 0]
    time = dt * np.arange(count)
    # behind a moving demand by what the command is late, held demands besides, and by 2 zeta/omega
    late = DT + 2 * 0.7 / 2.0
    assert demands[-1] - demands[0] > 0.02
    assert angles[400:] == pytest.approx(np.interp(time - late, time, demands)[400:], abs=2e-4)
    assert abs(angles - demands).max() > 5e-4


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ("ipc+ipc_2p", "must be there once to be exported, got IndividualPitch, IndividualPitch"),
        ("discon+linear_pitch+observer", "got LinearOptimalPitch, LoadObserver"),
        ("derate_pitch+lidar", "must have derate_pitch or lidar, not both"),
        ("envs_tests/unit/test_export_discon.py:Exported", "must be a trained agent or a controller of discon"),
    ],
)
def test_what_cannot_be_exported_is_refused_with_what_can(choice, message, tmp_path):
    with pytest.raises(SystemExit, match=message):
        run_command("export", [choice, "--to", "discon", "--out", str(tmp_path)])


def test_the_command_names_files_and_compiles_for_the_turbine(tmp_path, capsys):
    words = ["--turbine", "iea_22mw", "--interval", "0.05", "--drive"]
    run_command("export", ["tsr_tracking", "--to", "discon", "--out", str(tmp_path), *words])
    names = [line.rpartition("/")[2] for line in capsys.readouterr().out.splitlines()]
    assert [name.rpartition(".")[2] for name in names] == ["c", "so", "in", "md"]
    assert "\ndrive = 1.0 " in (tmp_path / "tsr_tracking.in").read_text(encoding="utf-8")
    page = (tmp_path / "README.md").read_text(encoding="utf-8")
    assert "every 0.05 s" in page
    assert "| 23 | generator torque |" in page


@pytest.mark.parametrize(
    ("choice", "words", "absent"),
    [  # ServoDyn reads the yaw rate with YCMode 5 alone, and ElastoDyn turns the nacelle with YawDOF
        ("tsr_tracking+ipc+yaw:dead_band=0.05", ("`PCMode`, `VSContrl` and `YCMode` 5", "`YawDOF` True"), "Lidar"),
        ("tuned", ("`PCMode` and `VSContrl` 5",), "YCMode"),
        ("discon+derate_speed", ("| 13 | demanded power |",), "YawDOF"),
        ("tuned_lidar", ("| 2005 | lidar | -60 to 60 | lidar preview |", "Gates 63, 126, 189 m ahead of the tower axis,"
                         " made for 4 beam(s) on a cone of 15° half angle"), "YCMode"),
    ],
)  # fmt: skip
def test_the_page_tells_what_is_read_and_what_openfast_needs(choice, words, absent, exported):
    page = Path(exported(choice)[3]).read_text(encoding="utf-8")
    assert all(word in page for word in words)
    assert absent not in page


@pytest.mark.parametrize(
    "choice", ["discon", "tsr_tracking+ipc+yaw:dead_band=0.05", "constrained_ipc+tower_dampers+yaw", "linear_optimal",
               "tuned_lidar"],
)  # fmt: skip
def test_sanitizers_find_nothing(choice, exported, tmp_path):
    source, _, parameters, _ = exported(choice)
    sanitized(source, parameters, tmp_path)


WITH_LIDAR = "lidar:fade=False"


def steady_readings(turbine, count, rng, gusts=True):
    """Readings of a turbine that keeps its pitch and speed in a wind that moves, as three gates see it."""
    base = next(random_readings(turbine, 1, 0, DT))
    speed = turbine.drivetrain.rated_rotor_speed
    base |= {"rotor_speed": speed, "generator_speed": speed * turbine.drivetrain.gear_ratio, "yaw": 0.0}
    base |= {f"pitch_{b + 1}": 0.2 for b in range(turbine.n_blades)}
    wind = 16.0 + (np.cumsum(rng.normal(size=(count, 3)), axis=0) * 0.2 if gusts else np.zeros((count, 3)))
    for row in wind:
        yield base | {f"lidar_{k + 1}": float(value) for k, value in enumerate(row)}


def with_and_without(load, count, spoil=None):
    """Pitch of a library with a lidar and of one without on spoiled readings, and what the first said."""
    turbine, lidar = load_turbine("nrel_5mw"), Lidar.for_rotor(load_turbine("nrel_5mw").rotor_diameter)
    readings = list(steady_readings(turbine, count, np.random.default_rng(2)))
    held = start_demand(readings[0], turbine)
    flights = (load(WITH_LIDAR, held, lidar=lidar), readings), (load("discon", held), readings)
    one, other, said = together(*flights, spoil=spoil)
    return np.stack([pitches(one)[:, 0], pitches(other)[:, 0]], axis=1), said


def test_the_pitch_follows_the_wind_ahead_once_it_has_come(load):
    pairs, said = with_and_without(load, 400)
    apart = abs(pairs[:, 0] - pairs[:, 1])
    assert said == []
    assert apart[:100].max() < 1e-7  # the air of the farthest gate takes 189 m / 16 m/s
    assert apart[150:].max() > 0.01
    pairs, said = with_and_without(load, 300, lost(*range(2001, 2501), value=0.0))  # a lidar that never reads
    assert np.array_equal(pairs[:, 0], pairs[:, 1])
    assert [k for k, *_ in said] == [0]


@pytest.mark.parametrize(
    ("record", "value"),
    [(2006, math.nan), (2005, math.inf), (2007, -99.0), (2008, math.nan), (2009, -20.0), (2003, 0.0), (2003, math.nan),
     (2002, 60.0), (129, 2000.0), (129, 2010.0), (37, math.nan)],
)  # fmt: skip
def test_without_the_lidar_the_rest_of_the_controller_goes_on(record, value, load):
    """Nothing is shifted from then on, which is said once; the demands are those of the pitch that is reached."""
    pairs, said = with_and_without(load, 400, lost(record, since=200, value=value))
    expected, _ = with_and_without(load, 400, lost(2005, 2006, 2007, since=200))
    assert [(k, flag) for k, flag, _ in said] == [(200, 1)]
    assert ("nacelle yaw (record 37)" if record == 37 else "lidar (record 2005)") in said[0][2]
    assert np.array_equal(pairs, expected)
    steps = np.diff(pairs[:, 0] - pairs[:, 1])
    assert abs(steps[150:199]).max() > 1e-4
    whole, _ = with_and_without(load, 400)
    assert abs(whole[:, 0] - pairs[:, 0])[250:].max() > 1e-3


def test_a_short_gap_hardly_matters_and_a_long_one_is_a_new_start(load):
    whole, short, long, alone = (
        with_and_without(load, 500, lost(2005, since=200, until=end))[0] for end in (200, 203, 250, 500)
    )
    apart = abs(short[:, 0] - whole[:, 0])
    assert apart[:200].max() == 0.0
    assert 0.0 < apart.max() < 0.2 * abs(whole[:, 0] - whole[:, 1]).max()
    steps = np.diff(long[:, 0] - long[:, 1])
    assert np.array_equal(long[:340], alone[:340])  # 5 s, then the air of 189 m again
    assert abs(steps[400:]).max() > 1e-4


def test_points_are_told_by_where_they_are_and_speeds_along_beams_are_scaled(exported, load, tmp_path):
    """Four beams in each of three gates and another gate, in any order, with the nacelle turned."""
    turbine = load_turbine("nrel_5mw")
    lidar = Lidar.for_rotor(turbine.rotor_diameter)
    scaled, factor = tmp_path / "along.in", 1.0 / math.cos(lidar.half_angle)
    text = Path(exported(WITH_LIDAR)[2]).read_text(encoding="utf-8")
    scaled.write_text(text.replace("speed_factor = 1.0", f"speed_factor = {factor!r}"), encoding="utf-8")
    rng, yaw = np.random.default_rng(3), 0.7
    readings = [now | {"yaw": yaw} for now in steady_readings(turbine, 300, rng)]
    held, order = start_demand(readings[0], turbine), rng.permutation(16)

    def beams(k, swap):
        speeds, places = [], []
        for gate, distance in enumerate((*lidar.ranges, 300.0)):
            mean = readings[k][f"lidar_{gate + 1}"] if gate < 3 else 99.0
            for beam, side in enumerate(np.array([[0.0, 1.0], [1.0, 0.0], [0.0, -1.0], [-1.0, 0.0]])):
                speeds.append((mean + (0.5, -0.5, 1.5, -1.5)[beam]) / factor)
                level, up = distance * math.tan(lidar.half_angle) * side
                x = -distance * math.cos(yaw) - level * math.sin(yaw)
                places.append((x, -distance * math.sin(yaw) + level * math.cos(yaw), 90.0 + up))
        swap[2000:2004] = 3.0, 4.0, 4.0, 0.0
        swap[2004 : 2004 + 64] = np.concatenate([np.array(speeds)[order], *np.array(places)[order].T])

    flights = (load(WITH_LIDAR, held, scaled), readings), (load(WITH_LIDAR, held, lidar=lidar), readings)
    found, expected, said = together(*flights, spoil=beams)
    assert said == []
    np.testing.assert_allclose(pitches(found), pitches(expected), atol=2e-7)
    assert abs(found[-1].pitch[0] - readings[0]["pitch_1"]) > 1e-3


def test_a_lidar_with_more_gates_than_there_are_records_is_refused(tmp_path):
    turbine = load_turbine("nrel_5mw")
    many = Lidar(tuple(60.0 + k for k in range(125)))
    with pytest.raises(ValueError, match="a lidar on the Bladed interface must have at most 124 gates, got 125"):
        BladedController(turbine, export_discon("discon", tmp_path)["files"][1], lidar=many)
    controller = make_controller("lidar", turbine, lidar=many)
    with pytest.raises(ValueError, match="a lidar to be exported must have at most 124 gates, got 125"):
        controller_parts(controller, turbine, DT)
    late = make_controller("lidar:delay=11.0", turbine)
    with pytest.raises(ValueError, match=r"delay of a lidar's feed-forward must be at most 10 s .* got 11\.0 s"):
        controller_parts(Combined(late), turbine, DT)


def openfast_words(choice, folder, *more):
    wind = '{"inflow": "steady", "wind_speed": 15.0}'
    return [choice, "--to", "openfast", "--out", str(folder), "--duration", "1", "--env-kwargs", wind, *more]


def test_a_model_of_the_users_gets_the_controller_of_its_turbine(tmp_path):
    primary = write_model(load_turbine("iea_15mw"), tmp_path / "own")
    servo = InputFile(primary.with_name("servodyn.dat"))
    for key, value in {"VSContrl": 1, "VS_RtGnSp": 7.56, "VS_RtTq": 19.8e6, "VS_Rgn2K": 0.0, "VS_SlPc": 10.0}.items():
        servo.set(key, value)
    servo.write(servo.path)
    run_command("export", openfast_words("discon", tmp_path / "flight", "--model", str(primary)))
    start = InputFile(tmp_path / "flight" / "elastodyn.dat")
    assert start.number("RotSpeed") == pytest.approx(7.56, rel=0.01)  # rated, IEA-15-240-RWT
    parameters = (tmp_path / "flight" / "discon.in").read_text(encoding="utf-8")
    (torque,) = re.findall(r"^max_torque = ([\d.e+]+)", parameters, re.MULTILINE)
    assert float(torque) > 1e7  # without a gearbox
    other = openfast_words("discon", tmp_path / "flight", "--model", str(primary), "--turbine", "nrel_5mw")
    with pytest.raises(SystemExit, match=r"TipRad must be that of the turbine .*, 63 .*, got 12"):
        run_command("export", other)


def test_a_folder_for_openfast_tells_which_points_of_the_lidar_it_reads(tmp_path, capsys):
    run_command("export", openfast_words("lidar", tmp_path))
    assert "OpenFAST reads 5 of 12 points of the lidar" in capsys.readouterr().out
    page = (tmp_path / "README.md").read_text(encoding="utf-8")
    assert "5 of 12 points, as many as it reads" in page
    assert "| -126 | 33.76 | 0 |" in page
    assert InputFile(tmp_path / "inflowwind.dat").number("NumBeam") == 5
