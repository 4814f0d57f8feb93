"""Files of recorded signals, read back by other readers than ours."""

import struct
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from wt_gym.commands import run as run_command
from wt_gym.hydrodynamics.waves import SeaState
from wt_gym.simulation import Recorder, Signals
from wt_gym.simulation.recorder import write_recording
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow

TIME = np.arange(101) * 0.05
SPEED = 1.2 + 0.1 * np.sin(TIME)
SIGNALS = {
    "rotor_speed": (SPEED, "rad/s", "RotSpeed"),
    "wind_x": (np.full(101, 12.0), "m/s", "WindHubVelX"),
    "pitch_1": (np.radians(3.0 + 0.5 * np.cos(TIME)), "rad", "BldPitch1"),
    "generator_power": (5e6 + 1e-3 * np.sin(TIME), "W", "GenPwr"),
    "aero_power": (-5e6 * np.cos(TIME), "W", "RtAeroPwr"),
    "root_flap_moment_1": (1e7 * np.cos(3.0 * TIME), "N m", "RootMyb1"),
    "yaw_rate": (np.zeros(101), "rad/s", "YawVzn"),
    "platform_pitch_rate": (0.01 * np.cos(TIME), "rad/s", "PtfmRVyi"),
    "platform_pitch_acceleration": (0.01 * np.cos(TIME), "rad/s^2", "PtfmRAyi"),
    "platform_surge_acceleration": (np.cos(TIME), "m/s^2", "PtfmTAxi"),
    "fairlead_tension_2": (1e6 + 1e5 * np.cos(TIME), "N", "FairTen2"),
    "pitch_travel_1": (np.ones(101), "rad", ""),
}
OPENFAST = {
    "RotSpeed": (30.0 / np.pi * SPEED, "(rpm)"),
    "WindHubVelX": (SIGNALS["wind_x"][0], "(m/s)"),
    "BldPitch1": (3.0 + 0.5 * np.cos(TIME), "(deg)"),
    "GenPwr": (5e3 + 1e-6 * np.sin(TIME), "(kW)"),
    "RtAeroPwr": (-5e6 * np.cos(TIME), "(W)"),
    "RootMyb1": (1e4 * np.cos(3.0 * TIME), "(kN-m)"),
    "YawVzn": (np.zeros(101), "(deg/s)"),
    "PtfmRVyi": (np.degrees(0.01 * np.cos(TIME)), "(deg/s)"),
    "PtfmRAyi": (np.degrees(0.01 * np.cos(TIME)), "(deg/s^2)"),
    "PtfmTAxi": (np.cos(TIME), "(m/s^2)"),
    "FairTen2": (1e6 + 1e5 * np.cos(TIME), "(N)"),
}


@pytest.fixture
def data():
    variables = {n: ("time", v, {"units": u, "openfast_name": o}) for n, (v, u, o) in SIGNALS.items()}
    variables["root_multiplier_force"] = (("time", "blade"), np.ones((101, 2)) * [1.0, 2.0], {"units": "N"})
    return xr.Dataset(variables, {"time": TIME, "blade": [1, 2]}, {"turbine": "NREL", "inflow": "steady"})


def read(path):
    """Outputs by name, and their units, by the description in OpenFAST's `FAST_Subs.f90` (`WrBinFAST`)."""
    content = path.read_bytes()
    at = 0

    def take(pattern):
        nonlocal at
        values = struct.unpack_from("<" + pattern, content, at)
        at += struct.calcsize("<" + pattern)
        return values

    kind, length = take("hh")
    assert kind == 4
    count, rows, first, step = take("iidd")
    scale, offset = np.array(take(f"{count}f")), np.array(take(f"{count}f"))
    (described,) = take("i")
    take(f"{described}s")
    names, units = ([take(f"{length}s")[0].decode().strip() for _ in range(count + 1)] for _ in range(2))
    table = np.reshape(take(f"{rows * count}h"), (rows, count))
    assert at == len(content)
    columns = np.column_stack([first + step * np.arange(rows), (table - offset) / scale])
    return dict(zip(names, columns.T, strict=True)), dict(zip(names, units, strict=True))


def check(values, units):
    assert list(values) == ["Time", *OPENFAST]
    np.testing.assert_allclose(values["Time"], TIME, atol=1e-12)
    for name, (expected, unit) in OPENFAST.items():
        assert units[name].strip("()") == unit.strip("()")
        span, size = np.ptp(expected), np.abs(expected).max()
        np.testing.assert_allclose(values[name], expected, rtol=0.0, atol=max(span / 6e4, size / 4e6))


def test_outb_has_the_names_and_units_of_openfast(tmp_path, data):
    write_recording(tmp_path / "run.outb", data)
    check(*read(tmp_path / "run.outb"))


def test_outb_is_read_by_the_reader_of_openfast(tmp_path, data):
    reader = pytest.importorskip("openfast_io.FAST_output_reader")
    write_recording(tmp_path / "run.OUTB", data)
    table, info, _ = reader.load_binary_output(str(tmp_path / "run.OUTB"))
    names = info["attribute_names"]
    check(dict(zip(names, table.T, strict=True)), dict(zip(names, info["attribute_units"], strict=True)))


def test_outb_is_read_by_openfast_toolbox(tmp_path, data):
    reader = pytest.importorskip("openfast_toolbox.io.fast_output_file")
    write_recording(tmp_path / "run.outb", data)
    table = reader.FASTOutputFile(str(tmp_path / "run.outb")).toDataFrame()
    heads = [column.rpartition("_") for column in table.columns]
    values = dict(zip((name for name, *_ in heads), table.values.T, strict=True))
    check(values, {name: unit.strip("[]") for name, _, unit in heads})


def test_csv_has_every_signal_in_si_units(tmp_path, data):
    write_recording(tmp_path / "run.csv", data)
    head, *rows = (tmp_path / "run.csv").read_text(encoding="utf-8").splitlines()
    names = head.split(",")
    assert names[:2] == ["time [s]", "rotor_speed [rad/s]"]
    assert names[-2:] == ["root_multiplier_force_1 [N]", "root_multiplier_force_2 [N]"]
    table = np.array([row.split(",") for row in rows], dtype=float)
    np.testing.assert_array_equal(table[:, 1], SPEED)
    np.testing.assert_array_equal(table[:, -2:], np.ones((101, 2)) * [1.0, 2.0])


def test_other_endings_are_refused(tmp_path, data, capsys):
    with pytest.raises(ValueError, match=r"must end in .nc, .outb, .csv, got run.xlsx"):
        write_recording(tmp_path / "run.xlsx", data)
    with pytest.raises(SystemExit) as stop:
        run_command("simulate", ["--out", "run.xlsx"])
    assert stop.value.code == 2
    assert "argument --out: must be a file that ends in .nc, .outb, .csv, got run.xlsx" in capsys.readouterr().err


@pytest.mark.parametrize(("height", "current", "text"), [
    (3.0, (0.0, 0.0), "Hs 2.82 m, Tp 8.96 s, towards 20 deg"),
    (0.0, (0.3, -0.4), "no waves, current of 0.5 m/s towards -53 deg"),
])  # fmt: skip
def test_a_recording_says_which_sea_it_is_of(height, current, text, tmp_path):
    state = SeaState("jonswap", height, 9.0, direction=np.radians(20.0), current=current)
    turbine = load_turbine("oc4_nrel_5mw")
    simulator = SimpleNamespace(
        turbine=turbine, inflow=SteadyInflow(12.0), time_step=0.1,
        sea=state.components(np.random.default_rng(1), 200.0),
        fidelity=SimpleNamespace(name="training", formulation="embedded"),
    )  # fmt: skip
    recorder = Recorder(simulator)
    recorder.append(Signals(np.zeros(len(recorder.channels)), 3))
    recorder.save(tmp_path / "run.outb")
    recorder.save(tmp_path / "run.nc")
    with xr.open_dataset(tmp_path / "run.nc") as data:
        assert data.attrs["sea"] == text
    assert text.encode() in (tmp_path / "run.outb").read_bytes()
