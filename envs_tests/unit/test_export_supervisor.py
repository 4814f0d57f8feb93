"""Supervisory control exported as a library with the Bladed interface, against Python's from standstill to storm."""

import math
from pathlib import Path

import numpy as np
import pytest

from envs_tests.unit.exported_library import INTERVAL, Exported, random_readings, sanitized
from envs_tests.unit.simple_rotor import SimpleRotor
from wt_gym.control import Demand
from wt_gym.control.controllers import lidar_of, make_controller, supervisor_of
from wt_gym.turbines import load_turbine

pytestmark = pytest.mark.usefixtures("compiler")
DT = INTERVAL
QUICK = "averaging=20,restart_delay=5,run_up=30"
PARKED = {"speed": 0.0, "pitch": 0.5 * math.pi, "torque": 0.0}
CALM_TO_STORM = ((0, 1), (20, 1), (30, 9), (100, 9), (140, 18), (180, 27.5), (200, 27.5), (230, 34), (290, 34),
                 (310, 20), (400, 20), (430, 1), (520, 1))  # fmt: skip
"""Wind [m/s] over time [s]."""


class Flight:
    """A controller and its library on the readings of a simple rotor, which follows the demands of the controller.

    Attributes
    ----------
    states : list of str
        That were passed.
    rows : list
        Rotor speed over rated, set point.
    """

    def __init__(self, files, choice, turbine, speed=None, pitch=0.2, torque=None, seed=1):
        self.turbine, drive = turbine, turbine.drivetrain
        self.rated = drive.rated_rotor_speed
        self.controller = make_controller(choice, turbine)
        self.lidar = lidar_of(self.controller)
        self.rotor = SimpleRotor(turbine, self.rated if speed is None else speed)
        self.pitch = np.full(turbine.n_blades, pitch, dtype=np.float32).astype(float)
        self.torque = float(np.float32(0.5 * drive.max_generator_torque if torque is None else torque))
        self.library, self.states, self.rows = None, [], []
        self.drawn = list(random_readings(turbine, 300, seed, DT))  # of everything else
        self.files, self.k = files, 0

    def signals(self, wind, others):
        """What is measured."""
        drive, speed, asked = self.turbine.drivetrain, self.rotor.speed, others.get("demanded_power")
        now = others | {
            "wind_x": wind, "rotor_speed": speed, "generator_speed": speed * drive.gear_ratio,
            "generator_torque": self.torque, "generator_power": self.torque * speed * drive.gear_ratio * 0.944,
        } | {f"pitch_{b + 1}": angle for b, angle in enumerate(self.pitch.tolist())}  # fmt: skip
        gates = 0 if self.lidar is None else len(self.lidar.ranges)
        now |= {f"lidar_{g + 1}": min(wind + 0.5 * g, 50.0) for g in range(gates)}
        return now if asked is None else now | {"demanded_power": asked}

    def run(self, path, spoil=lambda k, now: now, ask=None):
        """Both over a path of the wind; every demand of the library is that of the controller."""
        count = round(path[-1][0] / DT)
        winds = np.interp(DT * np.arange(count), *zip(*path, strict=True))
        winds += 0.3 * np.sin(0.31 * np.arange(count)) * (winds > 3.0)
        for wind in winds.tolist():
            now = spoil(self.k, self.signals(wind, self.drawn[self.k % len(self.drawn)]))
            if ask is not None:
                now["demanded_power"] = ask(self.k)
            if self.library is None:
                held = Demand(self.pitch, 0.0, self.torque)
                self.library = Exported(self.files[1], self.turbine, self.files[2], held, lidar=self.lidar)
                read = self.library.read(now)
                self.controller.start(read, held)
            else:
                read = self.library.read(now)
            expected, found = self.controller.step(read, DT), self.library.call(self.k * DT, DT)
            assert self.library.flag == 0, self.library.message
            torque = expected.generator_torque
            assert np.abs(found.pitch - expected.pitch).max() < 1e-7, self.k  # pytest.approx takes most of the time
            assert abs(found.generator_torque - torque) <= 1e-7 * abs(torque), self.k
            assert abs(found.yaw_rate - expected.yaw_rate) < 1e-8, self.k
            self.follow(wind, expected)
        return self

    def follow(self, wind, demand):
        """Drives and rotor."""
        reach = self.turbine.pitch.max_rate * DT
        self.pitch = self.pitch + np.clip(demand.pitch - self.pitch, -reach, reach)
        self.torque = demand.generator_torque
        self.rotor.advance(DT, wind, float(self.pitch.mean()), self.torque)
        supervisor = supervisor_of(self.controller)
        state, speed = supervisor.state, self.rotor.speed / self.rated
        if not self.states or self.states[-1] != state:
            self.states.append(state)
        self.rows.append((speed, supervisor.set_point))
        self.k += 1


@pytest.mark.parametrize(
    ("choice", "name"),
    [
        (f"discon+supervisor:{QUICK}", "nrel_5mw"),
        pytest.param(
            f"tsr_tracking+lidar+supervisor+ipc+yaw:supervisor__{QUICK.replace(',', ',supervisor__')},ipc__fade=False",
            "nrel_5mw", marks=pytest.mark.slow,
        ),
        pytest.param(f"supervisor+constrained_ipc+tower_dampers:{QUICK}", "iea_15mw", marks=pytest.mark.slow),
        (f"supervisor+yaw+fault_supervisor:{QUICK},resonance=0.08,moment_jump=9,pitch_tolerance=0.5", "iea_22mw"),
    ],
)  # fmt: skip
def test_from_a_calm_to_a_storm_and_back_demands_are_those_of_the_controller(choice, name, exported):
    turbine = load_turbine(name)
    flight = Flight(exported(choice, name), choice, turbine, **PARKED).run(CALM_TO_STORM)
    speed, set_point = np.array(flight.rows).T
    assert flight.states[:7] == ["parked", "start_up", "production", "soft_cut_out", "shut_down", "parked", "start_up"]
    assert flight.states[-2:] == ["shut_down", "parked"]
    assert set_point.min() < 0.85
    assert speed.max() < 1.2


@pytest.mark.parametrize(
    ("start", "wind", "state"),
    [
        ({"speed": None}, ((0, 18), (5, 18), (5.1, 48), (14, 48)), "shut_down"),
        ({"speed": 1.21}, ((0, 14), (120, 14)), "start_up"),  # again, after the least time at rest
        ({"speed": 0.6, "pitch": 0.0, "torque": 1e4}, ((0, 8), (20, 8), (50, 2), (110, 2)), "parked"),
        ({"speed": None, "pitch": 0.43}, ((0, 26), (60, 26)), "soft_cut_out"),
    ],
    ids=["gust", "overspeed", "calm", "start in a storm"],
)
def test_what_stops_the_controller_stops_the_library(start, wind, state, exported):
    """Every demand of the flight is compared."""
    choice, turbine = "discon+supervisor:averaging=40,restart_delay=60", load_turbine("nrel_5mw")
    if wind[-1][1] > 40:  # which would stop the turbine by its speed before
        choice += ",overspeed=2.5"
    if start["speed"] is not None:
        start = start | {"speed": start["speed"] * turbine.drivetrain.rated_rotor_speed}
    flight = Flight(exported(choice), choice, turbine, **start).run(wind)
    assert flight.states[-1] == state


@pytest.mark.parametrize("way", ["torque", "speed"])
def test_a_demanded_power_at_a_set_point_is_that_of_the_controller(way, exported):
    choice, turbine = f"derate_{way}+supervisor:{QUICK}", load_turbine("nrel_5mw")

    def ask(k):
        return turbine.drivetrain.rated_power * (0.0, 0.8, 0.4, 1.2)[k // 300 % 4]

    flight = Flight(exported(choice), choice, turbine, **PARKED)
    flight.run(((0, 12), (120, 12), (160, 27.5), (260, 27.5)), ask=ask)
    assert flight.states == ["parked", "start_up", "production", "soft_cut_out"]


def test_a_stuck_drive_stops_the_turbine_for_good(exported):
    """Found by the supervisor of faults, which stands around the whole of the controller."""
    choice, turbine = f"ipc+supervisor+fault_supervisor:{QUICK},moment_jump=9,vane_jump=3", load_turbine("nrel_5mw")
    flight = Flight(exported(choice), choice, turbine)

    def stuck(k, now):
        if k > 150:
            flight.pitch[1] = flight.stuck
        else:
            flight.stuck = flight.pitch[1]
        return now | {"pitch_2": flight.pitch[1]}

    flight.run(((0, 14), (15, 14), (40, 22), (60, 12), (260, 12)), stuck)
    assert supervisor_of(flight.controller).stopped
    assert flight.states[:2] == ["production", "shut_down"]
    assert "start_up" not in flight.states


def alone(files, turbine, speed, pitch, torque, winds, spoil):
    """Demands of a library whose rotor keeps its speed over rated, and what it said."""
    held = Demand(np.full(3, pitch), 0.0, torque)
    library, drive, rows, said = Exported(files[1], turbine, files[2], held), turbine.drivetrain, [], []
    now = next(random_readings(turbine, 1, 0, DT)) | {f"pitch_{b}": pitch for b in (1, 2, 3)}
    for k, wind in enumerate(winds):
        turns = drive.rated_rotor_speed * (speed(k) if callable(speed) else speed)
        library.read(now | {"wind_x": wind, "rotor_speed": turns, "generator_speed": turns * drive.gear_ratio})
        spoil(k, library.swap)
        rows.append(library.call(k * DT, DT))
        if library.flag:
            said.append((k, library.flag, library.message))
    return rows, said


CHOICE = f"discon+supervisor:{QUICK}"


def test_the_generator_speed_stands_in_for_that_of_the_rotor(exported):
    """An overspeed stops the turbine without the rotor speed too, which is said once."""

    def lost(k, swap):
        if k >= 20:
            swap[20] = math.nan

    def speed(k):
        return 1.0 if k < 40 else 1.25

    rows, said = alone(exported(CHOICE), load_turbine("nrel_5mw"), speed, 0.2, 4e4, [14.0] * 160, lost)
    assert [(k, flag) for k, flag, _ in said] == [(20, 1)]
    assert "rotor speed (record 21)" in said[0][2]
    assert rows[-1].pitch[0] > 0.5
    assert rows[39].pitch[0] < 0.25


def test_without_the_wind_nothing_starts_and_its_last_value_is_held(exported):
    turbine = load_turbine("nrel_5mw")

    def lost(first):
        def spoil(k, swap):
            if k >= first:
                swap[26] = math.nan

        return spoil

    _, said = alone(exported(CHOICE), turbine, 1.0, 0.2, 4e4, [14.0], lost(0))
    assert said[0][1] == -1
    assert "no reading of wind speed at the hub (record 27): without it there is nothing to start from" in said[0][2]
    storm = [14.0] * 50 + [40.0] * 1000
    rows, said = alone(exported(CHOICE), turbine, 1.0, 0.2, 4e4, storm, lost(50))
    held, _ = alone(exported(CHOICE), turbine, 1.0, 0.2, 4e4, [14.0] * 1050, lost(9999))
    assert [k for k, *_ in said] == [50]
    assert all(np.array_equal(one.pitch, other.pitch) for one, other in zip(rows, held, strict=True))
    seen, _ = alone(exported(CHOICE), turbine, 1.0, 0.2, 4e4, storm, lost(9999))
    assert seen[-1].pitch[0] > 1.5


def test_a_cut_out_of_the_parameter_file_holds(exported, tmp_path):
    """A harder one stops in a wind in which the exported one holds back."""
    hard, (page, library, parameters, *_) = tmp_path / "hard.in", exported(CHOICE)
    text = Path(parameters).read_text(encoding="utf-8")
    assert all(f"\nsupervisor_{name} " in text for name in ("cut_out = 30.0", "restart = 27.0"))
    hard.write_text("supervisor_cut_out = 25\nsupervisor_restart = 24\nsupervisor_derate_from = 25\n", encoding="utf-8")
    ends = []
    for file in (parameters, hard):
        flight = [page, library, file], load_turbine("nrel_5mw"), 0.85, 0.3, 4e4, [27.0] * 600
        rows, said = alone(*flight, lambda k, swap: None)
        assert said == []
        ends.append(rows[-1].pitch[0])
    assert ends[0] < 0.5
    assert ends[1] > 1.5


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("supervisor_cut_out = 20", "must be supervisor_cut_in < supervisor_restart <= supervisor_cut_out"),
        ("supervisor_least_power = 0.9", "supervisor_least_power must be at most supervisor_least_speed"),
        ("supervisor_overspeed = 0.9", "supervisor_overspeed must be 1 number(s) from 1 to inf"),
    ],
)
def test_a_parameter_file_that_contradicts_itself_ends_the_simulation(line, message, exported, tmp_path):
    parameters = tmp_path / "wrong.in"
    parameters.write_text(line + "\n", encoding="utf-8")
    files = [*exported(CHOICE)[:2], parameters]
    _, said = alone(files, load_turbine("nrel_5mw"), 1.0, 0.2, 4e4, [14.0], lambda k, swap: None)
    assert said[0][1] == -1
    assert message in said[0][2]


def test_sanitizers_find_nothing_in_supervisory_control(exported, tmp_path):
    source, _, parameters, page = exported(CHOICE)
    sanitized(source, parameters, tmp_path)
    told = Path(page).read_text(encoding="utf-8")
    assert "| 27 | wind speed at the hub | -150 to 150 | supervisory control |" in told
