"""The table of parameters of the built-in controllers: what it says is what the controllers do."""

import json
import math

import numpy as np
import pytest

from wt_gym.commands import run as run_command
from wt_gym.control import Demand, operating_point
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
from wt_gym.turbines import load_turbine

PARTS = [name for name in (*BASES, *WRAPPERS, *ADDITIONS, *GUARDS) if name not in COMPILED]
NUMBERS = [
    (name, parameter)
    for name in PARTS
    for parameter in declared_parameters(name)
    if "float" in parameter.annotation.split("|")
]
DT = 0.4
"""Interval of the controllers [s]."""
ON = {"thrust_limit": "iea_22mw", "resonance": "iea_22mw"}
"""Turbines for what the controller of the NREL 5-MW does not have, by parameter of "discon" or "supervisor"."""
QUICK = {"averaging": 20.0}
"""Within which the run gets through storm, calm and start."""
BESIDE = {"leak_time": {"level": 0.1}, "stop": {"dead_band": 0.05}}
"""What must be chosen too for a parameter to have an effect."""
CHOSEN = {
    "averaging": 10.0, "fade": 0.2, "hysteresis": 20.0, "least_speed": 0.6, "overspeed": 1.05, "resonance": 0.1,
    "filter_damping": 0.7, "lead": 1.0, "level": 0.3, "limit": 0.004, "notch_frequency": 1.0, "min_pitch": 0.03,
    "proportional_time": 2.0, "rate_limit": 0.002, "region_3_min_pitch": 0.1, "second_harmonic": 0.25,
    "simulator_step": 0.05, "stop": 0.03, "thrust_limit": 0.8, "tip_speed_ratio": 8.5, "natural_frequency": 0.36,
    "damping_ratio": 0.42,
}  # fmt: skip
"""Values other than six tenths of the default."""
WITHIN = {"fault_supervisor": "supervisor+ipc+yaw+fault_supervisor"}
"""Whole names, for what acts on other parts alone."""
FAILING = (
    (60, 62, "rotor_speed", 1.012, 0.0),
    (90, 500, "root_flap_moment_1", 1.0, 0.12),
    (150, 152, "root_flap_moment_2", 0.0, 0.5),
    (200, 500, "yaw_error", 1.0, 0.15),
    (250, 258, "pitch_1", 1.0, 0.016),
    (300, 302, "pitch_2", 1.0, 0.03),
    (400, 420, "pitch_3", 1.0, 0.05),
)
"""Samples, channel, factor and offset of its reading, of a moment in the reference moment: each between six tenths of
a limit of the fault supervisor and that limit, except the last one, which is a fault by default."""
TIME = DT * np.arange(500)
WINDS = 11.5 + 3.0 * np.sin(0.05 * TIME) + 0.8 * np.sin(0.6 * TIME)
"""Wind [m/s] about rated, with gusts."""
STORM = np.interp(TIME, [0, 30, 60, 80, 81, 90, 91, 110, 111], [6, 6, 22, 26, 45, 45, 0.5, 0.5, 20])
"""Light wind, storm, a gust that stops the turbine, a calm, and a wind to start in [m/s]."""


def answers(turbine, choice, **parameters):
    """Demands of a controller to a made-up run, shape (n, n_blades + 2)."""
    turbine = load_turbine(turbine)
    drive, rated, moment = turbine.drivetrain, turbine.drivetrain.rated_rotor_speed, reference_flap_moment(turbine)
    controller = make_controller(WITHIN.get(choice, choice), turbine, **parameters)
    winds = STORM if choice == "supervisor" else WINDS
    point = operating_point(turbine, float(winds[0]))
    demand = Demand(np.full(turbine.n_blades, point.pitch), 0.0, point.generator_torque)
    rows, azimuth, flap = [], 0.3, 2.0 * drive.rated_power / rated  # of the size of a flap moment
    for k, (time, wind) in enumerate(zip(TIME.tolist(), winds.tolist(), strict=True)):
        speed, torque = rated * min(wind / 12.0, 1.0 + 0.02 * (wind - 12.0), 1.1), demand.generator_torque
        azimuth += DT * speed
        ahead = {f"lidar_{gate + 1}": float(np.interp(time + 3.0 * gate, TIME, WINDS)) for gate in range(3)}
        signals = ahead | {
            "generator_speed": speed * drive.gear_ratio, "rotor_speed": speed, "generator_torque": torque,
            "generator_power": drive.generator_efficiency * torque * speed * drive.gear_ratio,
            "azimuth": azimuth, "wind_x": wind, "wind_y": 0.0, "yaw_error": 0.25 * math.sin(0.05 * time),
            "nacelle_acceleration_fore_aft": 0.5 * math.sin(2.0 * time),
            "nacelle_acceleration_side_side": 0.3 * math.sin(2.1 * time),
            "yaw": 0.0, "platform_roll_rate": 0.0, "platform_pitch_rate": 0.02 * math.sin(0.24 * time),
        }  # fmt: skip
        for b in range(turbine.n_blades):
            place = azimuth + 2.0 * math.pi * b / turbine.n_blades
            wave = 0.3 * math.cos(place) * (1.0 + math.sin(0.1 * time)) + 0.1 * math.cos(2.0 * place)
            signals |= {f"pitch_{b + 1}": float(demand.pitch[b]), f"root_flap_moment_{b + 1}": flap * (1.0 + wave)}
        for first, last, name, factor, offset in FAILING if choice in WITHIN else ():
            if first <= k < last:
                signals[name] = factor * signals[name] + offset * (moment if "moment" in name else 1.0)
        if k == 0:
            controller.start(signals, demand)
        demand = controller.step(signals, DT)
        rows.append((*demand.pitch, demand.yaw_rate, demand.generator_torque))
    return np.array(rows)


@pytest.mark.filterwarnings("ignore:the speed loop of")
@pytest.mark.parametrize(("name", "parameter"), NUMBERS, ids=lambda x: getattr(x, "name", x))
def test_every_parameter_changes_its_controller(name, parameter):
    turbine = ON.get(parameter.name, "nrel_5mw") if name in ("discon", "supervisor") else "nrel_5mw"
    turbine = "oc4_nrel_5mw" if name == "floating" else turbine
    beside = QUICK if name == "supervisor" and parameter.name != "averaging" else BESIDE.get(parameter.name, {})
    beside = {f"{name}__{key}": value for key, value in beside.items()}
    value = CHOSEN.get(parameter.name) or 0.6 * parameter.default_of(load_turbine(turbine))
    changed = answers(turbine, name, **beside | {f"{name}__{parameter.name}": value})
    assert not np.array_equal(changed, answers(turbine, name, **beside)), value


def test_names_for_several_parts_tell_the_parts_apart():
    found = controller_parameters("tower_dampers")
    assert (found["fore_aft_damper__damping"], found["side_side_damper__damping"]) == (0.05, 0.03)
    for name in ("tower_dampers", "tuned"):
        numbers = {key: value for key, value in controller_parameters(name).items() if value is not None}
        make_controller(name, load_turbine("nrel_5mw"), **numbers)


# ---- the command ----


def test_the_command_prints_every_parameter(capsys):
    run_command("list", ["controllers"])
    text = capsys.readouterr().out
    for name in CONTROLLERS:
        assert f"\n{name} (" in f"\n{text}"
        assert controller_summary(name).endswith(".")
        for parameter in declared_parameters(name):
            assert parameter.name in text
            assert parameter.meaning in text
            assert parameter.unit
            assert parameter.default is not None or parameter.otherwise
    assert "0.1396 (8°)" in text


@pytest.mark.parametrize("turbine", ["nrel_5mw", "iea_22mw"])
def test_the_command_shows_what_the_controller_of_a_turbine_takes(turbine, capsys):
    """What is left out is refused, what is shown is not."""
    run_command("list", ["controllers", "discon", "--turbine", turbine, "--json"])
    (row,) = json.loads(capsys.readouterr().out)["controllers"]
    shown = {parameter["name"]: parameter["default"] for parameter in row["parameters"]}
    if turbine == "nrel_5mw":  # NREL/TP-500-38060, table 7-2
        assert (shown["kp"], shown["ki"], shown["region_2_gain"]) == ("0.01883", "0.008069", "2.332")
    values = {"min_pitch": 0.0, "region_3_min_pitch": 0.02, "region_2_gain": 2.0, "thrust_limit": 0.9}
    values |= {"land_gains": True}
    for parameter in declared_parameters("discon"):
        if parameter.name not in values:
            assert parameter.name in shown
        elif parameter.name in shown:
            make_controller("discon", load_turbine(turbine), **{parameter.name: values[parameter.name]})
        else:
            with pytest.raises(ValueError, match=f"{parameter.name} must be left out"):
                make_controller("discon", load_turbine(turbine), **{parameter.name: values[parameter.name]})


@pytest.mark.parametrize(
    ("what", "word"),
    [("turbines", "iea_22mw"), ("tasks", "wt_gym/LoadReduction-v3"), ("channels", "generator_speed"), ("agents", "l")],
)
def test_the_command_lists_other_things(what, word, capsys):
    run_command("list", [what])
    assert word in capsys.readouterr().out


def test_an_unknown_name_takes_one_line():
    with pytest.raises(SystemExit, match=r"error: turbines must be among .*got 'iea_22'.*did you mean 'iea_22mw'"):
        run_command("list", ["turbines", "iea_22"])
