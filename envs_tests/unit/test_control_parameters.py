"""The table of parameters of the built-in controllers: what it says is what the controllers do."""

import json
import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from wt_gym.commands import run as run_command
from wt_gym.control import Demand
from wt_gym.control.controllers import (
    ADDITIONS,
    BASES,
    COMPILED,
    CONTROLLERS,
    GUARDS,
    WRAPPERS,
    controller_parameters,
    controller_summary,
    declared_parameters,
    make_controller,
)
from wt_gym.control.design import reference_flap_moment
from wt_gym.control.operating_point import operating_point
from wt_gym.turbines import load_turbine

DOCS = Path(__file__).resolve().parents[2] / "docs"
PARTS = (*BASES, *WRAPPERS, *ADDITIONS, *GUARDS)
EVERY = [(name, parameter) for name in PARTS if name not in COMPILED for parameter in declared_parameters(name)]
NUMBERS = [(name, parameter) for name, parameter in EVERY if "float" in parameter.annotation.split("|")]
DT = 0.4
"""Interval of the controllers [s]."""
ON = {"thrust_limit": "iea_22mw", "resonance": "iea_22mw"}
"""Turbines for what the controller of the NREL 5-MW does not have, by parameter of "discon" or "supervisor"."""
BESIDE = {
    "leak_time": {"level": 0.1},  # the pitch returns within a band only
    "stop": {"dead_band": 0.05},
    **{
        name: {"averaging": 20.0}  # in which the run gets through storm, calm and start
        for name in (
            "derate_from",
            "least_speed",
            "least_power",
            "hysteresis",
            "restart_delay",
            "run_up",
            "stop_rate",
        )
    },
}
"""What must be chosen too for a parameter to have an effect."""
CHOSEN = {
    "averaging": 10.0,
    "fade": 0.2,
    "hysteresis": 20.0,
    "least_speed": 0.6,
    "overspeed": 1.05,
    "resonance": 0.1,
    "filter_damping": 0.7,
    "lead": 1.0,
    "level": 0.3,
    "limit": 0.004,
    "notch_frequency": 1.0,
    "min_pitch": 0.03,
    "proportional_time": 2.0,
    "rate_limit": 0.002,
    "region_3_min_pitch": 0.1,
    "second_harmonic": 0.25,
    "simulator_step": 0.05,
    "stop": 0.03,
    "thrust_limit": 0.8,
    "tip_speed_ratio": 8.5,
}
"""Values other than six tenths of the default."""


WITHIN = {"fault_supervisor": "supervisor+ipc+yaw+fault_supervisor"}
"""Whole names, for what acts on other parts alone."""
FAILING = (
    (60, 62, {"rotor_speed": (1.012, 0.0)}),
    (90, 500, {"root_flap_moment_1": (1.0, 0.12)}),
    (150, 152, {"root_flap_moment_2": (0.0, 0.5)}),
    (200, 500, {"yaw_error": (1.0, 0.15)}),
    (250, 258, {"pitch_1": (1.0, 0.016)}),
    (300, 302, {"pitch_2": (1.0, 0.03)}),
    (400, 420, {"pitch_3": (1.0, 0.05)}),
)
"""Samples, channels, and factor and offset of their readings, of moments in the reference moment: each between six
tenths of a limit of the fault supervisor and that limit, but for the last one, which is a fault by default."""


def spoiled(signals, k, moment):
    """Readings of sensors and drives that fail a little."""
    for first, last, channels in FAILING:
        for name, (factor, offset) in channels.items() if first <= k < last else ():
            signals[name] = factor * signals[name] + offset * (moment if "moment" in name else 1.0)
    return signals


def of(name, parameter):
    """Turbine on which a parameter is tried."""
    return load_turbine(ON.get(parameter.name, "nrel_5mw") if name in ("discon", "supervisor") else "nrel_5mw")


@cache
def winds():
    """Wind [m/s] over 200 s in steps of 0.4 s: about rated, with gusts."""
    time = DT * np.arange(500)
    return 11.5 + 3.0 * np.sin(0.05 * time) + 0.8 * np.sin(0.6 * time)


@cache
def storm():
    """The same for a supervisor: light wind, storm, a gust that stops the turbine, a calm, and a wind to start in."""
    time = DT * np.arange(500)
    return np.interp(time, [0, 30, 60, 80, 81, 90, 91, 110, 111], [6, 6, 22, 26, 45, 45, 0.5, 0.5, 20])


def answers(turbine, choice, **parameters):
    """Demands of a controller to a made-up run about rated wind, shape (n, n_blades + 2)."""
    controller = make_controller(WITHIN.get(choice, choice), turbine, **parameters)
    drivetrain, rated = turbine.drivetrain, turbine.drivetrain.rated_rotor_speed
    blows = storm() if choice == "supervisor" else winds()
    point = operating_point(turbine, float(blows[0]))
    demand = Demand(np.full(turbine.n_blades, point.pitch), 0.0, point.generator_torque)
    rows, azimuth = [], 0.3
    flap = 2.0 * drivetrain.rated_power / rated  # of the size of a flap moment
    for k, wind in enumerate(blows.tolist()):
        time, speed = DT * k, rated * min(wind / 12.0, 1.0 + 0.02 * (wind - 12.0), 1.1)
        azimuth += DT * speed
        signals = {
            "generator_speed": speed * drivetrain.gear_ratio,
            "rotor_speed": speed,
            "generator_torque": demand.generator_torque,
            "azimuth": azimuth,
            "wind_x": wind,
            "wind_y": 0.0,
            "yaw_error": 0.25 * math.sin(0.05 * time),
            "nacelle_acceleration_fore_aft": 0.5 * math.sin(2.0 * time),
            "nacelle_acceleration_side_side": 0.3 * math.sin(2.1 * time),
            "lidar_1": wind,
            "lidar_2": float(np.interp(time + 3.0, DT * np.arange(500), winds())),
            "lidar_3": float(np.interp(time + 6.0, DT * np.arange(500), winds())),
        }
        for b in range(turbine.n_blades):
            place = azimuth + 2.0 * math.pi * b / turbine.n_blades
            signals[f"pitch_{b + 1}"] = float(demand.pitch[b])
            signals[f"root_flap_moment_{b + 1}"] = flap * (
                1.0 + 0.3 * math.cos(place) * (1.0 + math.sin(0.1 * time)) + 0.1 * math.cos(2.0 * place)
            )
        if choice in WITHIN:
            signals["generator_power"] = (
                drivetrain.generator_efficiency * demand.generator_torque * signals["generator_speed"]
            )
            signals = spoiled(signals, k, reference_flap_moment(turbine))
        if k == 0:
            controller.start(signals, demand)
        demand = controller.step(signals, DT)
        rows.append((*demand.pitch, demand.yaw_rate, demand.generator_torque))
    return np.array(rows)


@pytest.mark.filterwarnings("ignore:the speed loop of")
@pytest.mark.parametrize(("name", "parameter"), NUMBERS, ids=lambda x: getattr(x, "name", x))
def test_every_parameter_changes_its_controller(name, parameter):
    turbine = of(name, parameter)
    beside = {f"{name}__{key}": value for key, value in BESIDE.get(parameter.name, {}).items()}
    value = CHOSEN.get(parameter.name)
    if value is None:
        known = parameter.default_of(turbine)
        if known is None:
            known = {"natural_frequency": 0.6, "damping_ratio": 0.7}[parameter.name]
        value = 0.6 * known
    changed = answers(turbine, name, **beside, **{f"{name}__{parameter.name}": value})
    assert not np.array_equal(changed, answers(turbine, name, **beside)), value


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ("discn", r"must be among discon, .*got 'discn'.*did you mean 'discon'\?"),
        ("yaw:deadband=0.1", r"no parameter 'deadband' .*did you mean 'dead_band'\?"),
        ("discon:natural_freq=0.1", r"did you mean 'natural_frequency'\?"),
        ("ipc+yaw:yaw__limit=0.1", "no parameter 'yaw__limit'"),
        (
            "yaw:dead_band=-0.1",
            r"dead_band of controller 'yaw' must be a number above 0 and at most 3.14159 rad, got -0.1",
        ),
        ("ipc:fade=0.9", r"fade .* must be true or false, a number from 0.001 to 0.5 rad or a FadeParameters, got 0.9"),
        ("lidar:lidar=3", r"lidar .* must be a Lidar or None \(three gates by the rotor's size\), got 3"),
        ("discon:ki=0", r"ki of controller 'discon' must be a number above 0 or None"),
    ],
)
def test_what_is_wrong_is_refused_with_what_is_allowed(choice, message):
    with pytest.raises(ValueError, match=message):
        make_controller(choice, load_turbine("nrel_5mw"))


def test_what_only_a_torque_curve_has_is_refused_elsewhere():
    for choice in ("discon:min_pitch=0.02", "discon:region_3_min_pitch=0.02"):
        with pytest.raises(ValueError, match="must be left out for IEA 22MW"):
            make_controller(choice, load_turbine("iea_22mw"))


def test_names_for_several_parts_tell_the_parts_apart():
    found = controller_parameters("tower_dampers")
    assert found["fore_aft_damper__damping"] == 0.05
    assert found["side_side_damper__damping"] == 0.03
    turbine = load_turbine("nrel_5mw")
    for name in ("tower_dampers", "tuned"):
        numbers = {key: value for key, value in controller_parameters(name).items() if value is not None}
        make_controller(name, turbine, **numbers)
    with pytest.raises(ValueError, match=r"must be among discon, .*got 'pid'"):
        declared_parameters("pid")


@pytest.mark.parametrize("name", CONTROLLERS)
def test_everything_has_a_meaning(name):
    assert controller_summary(name).endswith(".")
    for parameter in declared_parameters(name):
        assert parameter.unit
        assert parameter.default is not None or parameter.otherwise


# ---- the command ----


def test_the_command_prints_every_parameter(capsys):
    run_command("list", ["controllers"])
    text = capsys.readouterr().out
    for name in CONTROLLERS:
        assert f"\n{name} (" in f"\n{text}"
        assert all(parameter.name in text and parameter.meaning in text for parameter in declared_parameters(name))
    assert "0.1396 (8°)" in text


def test_the_command_shows_the_defaults_of_a_turbine(capsys):
    run_command("list", ["controllers", "discon", "--turbine", "nrel_5mw", "--json"])
    (row,) = json.loads(capsys.readouterr().out)["controllers"]
    shown = {parameter["name"]: parameter["default"] for parameter in row["parameters"]}
    # NREL/TP-500-38060, table 7-2
    assert (shown["kp"], shown["ki"], shown["region_2_gain"]) == ("0.01883", "0.008069", "2.332")


@pytest.mark.parametrize("turbine", ["nrel_5mw", "iea_22mw"])
def test_the_command_shows_what_the_controller_of_a_turbine_takes(turbine, capsys):
    """What is left out is refused, what is shown is not."""
    run_command("list", ["controllers", "discon", "--turbine", turbine, "--json"])
    (row,) = json.loads(capsys.readouterr().out)["controllers"]
    shown = {parameter["name"] for parameter in row["parameters"]}
    for parameter in declared_parameters("discon"):
        values = {"min_pitch": 0.0, "region_3_min_pitch": 0.02, "region_2_gain": 2.0, "thrust_limit": 0.9}
        if parameter.name not in values:
            assert parameter.name in shown
        elif parameter.name in shown:
            make_controller("discon", load_turbine(turbine), **{parameter.name: values[parameter.name]})
        else:
            with pytest.raises(ValueError, match=f"{parameter.name} must be left out"):
                make_controller("discon", load_turbine(turbine), **{parameter.name: values[parameter.name]})


@pytest.mark.parametrize(
    ("what", "word"),
    [("turbines", "iea_22mw"), ("tasks", "wt_gym/LoadReduction-v2"), ("channels", "generator_speed"), ("agents", "l")],
)
def test_the_command_lists_other_things(what, word, capsys):
    run_command("list", [what])
    assert word in capsys.readouterr().out


def test_an_unknown_name_takes_one_line():
    with pytest.raises(SystemExit, match=r"error: turbines must be among .*got 'iea_22'.*did you mean 'iea_22mw'"):
        run_command("list", ["turbines", "iea_22"])
