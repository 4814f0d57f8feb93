"""Winds that follow a time series, from numbers and from CSV and uniform wind files."""

import math
import pickle
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

from wt_gym.base.errors import InflowError
from wt_gym.wind import SeriesInflow, wind_from
from wt_gym.wind.series import COLUMNS, read_csv, read_uniform

HUB = [0.0, 0.0, 90.0]
POINTS = np.array([HUB, [3.0, -40.0, 120.0], [-5.0, 60.0, 40.0], [0.0, 10.0, 1.0]])


def inflowwind(line, points, height=90.0, length=126.0):
    """Velocity by the formula of InflowWind's uniform wind, its signs of direction written out, for 9 columns."""
    _, v, delta, vz, h_shear, exponent, v_shear, gust, upflow = line
    delta, upflow = math.radians(delta), math.radians(upflow)
    x, y, z = points.T
    v1 = v * ((z / height) ** exponent + (h_shear * (y * math.cos(delta) + x * math.sin(delta))) / length)
    v1 = v1 + v * v_shear * (z - height) / length + gust
    forward = math.cos(upflow) * v1 - math.sin(upflow) * vz
    upward = math.sin(upflow) * v1 + math.cos(upflow) * vz
    return np.column_stack([forward * math.cos(delta), -forward * math.sin(delta), upward])


LINES = np.array(
    [
        [0.0, 8.0, 0.0, 0.0, 0.0, 0.2, 0.0, 0.0, 0.0],
        [10.0, 12.0, 20.0, 0.5, 0.3, 0.14, -0.1, 1.5, 8.0],
        [12.0, 9.0, -170.0, -0.4, -0.2, 0.3, 0.2, -1.0, -5.0],
        [20.0, 11.0, 175.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    ]
)


def write(path, lines):
    path.write_text("! made by hand\n!Time Wind ...\n" + "\n".join(" ".join(map(repr, row)) for row in lines.tolist()))
    return path


def test_uniform_wind_files_give_the_documented_formula(tmp_path):
    wind = read_uniform(write(tmp_path / "a.wnd", LINES), hub_height=90.0, reference_length=126.0)
    for row in LINES[:3]:
        np.testing.assert_allclose(wind.velocity(POINTS, row[0]), inflowwind(row, POINTS), rtol=1e-12, atol=1e-12)
    middle = 0.25 * LINES[0] + 0.75 * LINES[1]
    np.testing.assert_allclose(wind.velocity(POINTS, 7.5), inflowwind(middle, POINTS), rtol=1e-12, atol=1e-12)
    # over the cut at 180 degrees the direction takes the short way: from -170 to 175 by -15
    turned = 0.5 * (LINES[2] + LINES[3])
    turned[2] = -177.5
    np.testing.assert_allclose(wind.velocity(POINTS, 16.0), inflowwind(turned, POINTS), rtol=1e-12, atol=1e-12)
    for time, row in ((-5.0, LINES[0]), (500.0, LINES[3])):
        np.testing.assert_allclose(wind.velocity(POINTS, time), inflowwind(row, POINTS), rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize(
    ("point", "published"),
    [
        ((-4.5, -0.5, 149.5), (22.22776892, -7.68844170, -1.93314988)),
        ((-4.5, 4.5, 154.5), (22.37351085, -7.73923567, -1.91982115)),
        ((-3.5, -4.5, 145.5), (22.10575262, -7.64591658, -1.94430880)),
    ],
)
def test_velocities_that_inflowwind_computes(tmp_path, point, published):
    """Regression case ifw_uniform of OpenFAST at 30 s: the field is turned by 10 degrees towards -y, and up by 5."""
    row = np.array([[30.0, 23.27, 9.18, -3.95, 0.0, 0.2, 0.0, 0.0]])
    wind = read_uniform(write(tmp_path / "a.hh", row), hub_height=150.0, reference_length=125.88)
    aside, up = math.radians(10.0), math.radians(5.0)
    turn = np.array([[math.cos(aside), math.sin(aside), 0], [-math.sin(aside), math.cos(aside), 0], [0, 0, 1.0]])
    turn = turn @ np.array([[math.cos(up), 0, -math.sin(up)], [0, 1.0, 0], [math.sin(up), 0, math.cos(up)]])
    origin = np.array([0.0, 0.0, 150.0])
    velocity = turn @ wind.velocity(turn.T @ (np.array(point) - origin) + origin, 30.0)
    np.testing.assert_allclose(velocity, published, atol=1e-7)


def test_a_positive_direction_of_inflowwind_blows_to_the_right(tmp_path):
    row = np.array([[0.0, 10.0, 30.0, 0, 0, 0, 0, 0]], dtype=float)
    wind = read_uniform(write(tmp_path / "a.hh", row))
    np.testing.assert_allclose(wind.velocity(HUB, 0.0), [10.0 * math.cos(math.pi / 6), -5.0, 0.0], rtol=1e-12)
    assert wind.table[0, COLUMNS.index("upflow")] == 0.0  # eight columns


def test_a_uniform_wind_file_in_any_form_that_inflowwind_takes(tmp_path):
    """Comment characters !#%, words behind the numbers, rows that are repeated, Latin-1, line ends, exponents."""
    path = tmp_path / "a.wnd"
    path.write_text("0 9 0 0 0 0.2 0 0\n49 9 0 0 0 0.2 0 0\n49.1 10 0 0 0 0.2 0 0\n")
    plain = read_uniform(path)
    path.write_bytes(
        "! B\xf6e \x85\n# more\n% and more\n\n0.0D+00,9,0,0,0,.2,0,0 x\r\n0 9 0 0 0 0.2 0 0\n0 9 0 0 0 0.2 0 0 ! c\n"
        "4.9E1\t9 0 0 0 0.2 0 0\n49 9 0 0 0 0.2 0 0 # c\n49.1 10 0 0 0 0.2 0 0".encode("latin-1")
    )
    assert read_uniform(path) == plain


def test_csv_columns_stand_in_any_order_and_directions_are_ours(tmp_path):
    path = tmp_path / "met.csv"
    path.write_text("# mast\n\nspeed, time,direction,shear_exponent\n8,0,0,-0.1\n 12 ,10,30,-0.1\n")
    wind = read_csv(path)
    np.testing.assert_allclose(wind.velocity(HUB, 10.0), [12.0 * math.cos(math.pi / 6), 6.0, 0.0], rtol=1e-12)
    assert wind.velocity([0.0, 0.0, 180.0], 0.0)[0] == pytest.approx(8.0 * 2.0**-0.1, rel=1e-12)
    assert (wind.mean_speed, wind.start_speed, wind.duration) == (10.0, 8.0, 10.0)
    assert wind.description == (
        "met.csv: 8 to 12 m/s at 90 m, power-law profile, exponent -0.1, direction 0 to 30 deg, 10 s"
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("# nothing\n", "is empty"),
        ("time,speed\n", "must have lines of numbers"),
        ("time,wind\n0,8\n", "columns must be among .*; got 'wind'"),
        ("time,Speed\n0,8\n", "did you mean 'speed'"),
        ("time,direction\n0,8\n", "'speed' must be there"),
        ("time,speed,speed\n0,8,8\n", "must be named once"),
        ("time,speed\n0,8\n1\n", "line 3: 2 numbers are needed"),
        ("time,speed\n0,8\n1,fast\n", "line 3: speed must be a number; got 'fast'"),
        ("time,speed\n0,8\n1,nan\n", "line 3: every number must be finite"),
        ("time,speed\n0,8\n1,-2\n", r"speed must lie in \[0, 200\] m/s; got -2 at 1 s"),
        ("time,speed\n1,8\n0,9\n", "times must not decrease; 0 s follows 1 s"),
        ("time,speed\n0,8\n0,9\n0,10\n", "at most twice .a step., got 0 s"),
        ("time,speed,shear_exponent\n0,8,2\n", "shear_exponent must lie in"),
    ],
)
def test_defects_of_a_csv_are_named(tmp_path, text, message):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InflowError, match=message) as caught:
        read_csv(path)
    assert "bad.csv" in str(caught.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"! only a comment\n", "must have lines of 8 or 9 numbers"),
        (b"0 8 0 0 0\n", "line 1: lines of a uniform wind file must have 8 or 9 numbers, got 5"),
        (b"0 8 0 0 0 0.2 0 0\n1 8 0 0\n", "line 2: 8 numbers are needed, one a column; got 4"),
        (b"0 8 0 0 0 0.2 0 x\n", "line 1: gust must be a number; got 'x'"),
        (b"\xff\xfe\x00\x01\x80", "must be a text file"),
    ],
)
def test_defects_of_a_uniform_wind_file_are_named(tmp_path, content, message):
    path = tmp_path / "bad.wnd"
    path.write_bytes(content)
    with pytest.raises(InflowError, match=message):
        read_uniform(path)
    with pytest.raises(InflowError, match="cannot read the wind file"):
        read_uniform(tmp_path / "missing.wnd")


def test_a_step_is_sharp_and_a_ramp_is_straight():
    step = SeriesInflow.step(8.0, 12.0, 10.0, shear_exponent=0.2)
    below = [0.0, 0.0, 45.0]
    assert step.velocity(below, np.nextafter(10.0, 0.0))[0] == pytest.approx(8.0 * 0.5**0.2, rel=1e-12)
    assert step.velocity(below, 10.0)[0] == pytest.approx(12.0 * 0.5**0.2, rel=1e-12)
    assert step.start_speed == 8.0
    ramp = SeriesInflow.ramp(5.0, 25.0, 10.0, 40.0)
    speeds = [ramp.velocity(HUB, t)[0] for t in (0.0, 20.0, 30.0, 50.0, 99.0)]
    np.testing.assert_allclose(speeds, [5.0, 10.0, 15.0, 25.0, 25.0], rtol=1e-12)
    assert ramp.mean_speed == 15.0


def test_a_series_shifted_in_time_is_the_result_shifted():
    columns = {"time": [0.0, 3.0, 9.0, 20.0], "speed": [8.0, 12.0, 7.0, 9.0], "direction": [0.0, 0.3, -0.2, 0.1]}
    wind = SeriesInflow.of(columns)
    later = SeriesInflow.of({**columns, "time": np.array(columns["time"]) + 5.0})
    entered = replace(wind, time_offset=4.0)
    for t in (0.0, 2.5, 7.0, 15.0):
        np.testing.assert_allclose(later.velocity(POINTS, t + 5.0), wind.velocity(POINTS, t), rtol=1e-12)
        np.testing.assert_array_equal(entered.velocity(POINTS, t), wind.velocity(POINTS, t + 4.0))
    assert entered.start_speed == pytest.approx(12.0 - 5.0 / 6.0)


def test_a_series_turned_is_the_result_turned():
    columns = {"time": [0.0, 10.0], "speed": [8.0, 12.0], "horizontal_shear": [0.2, 0.4], "upflow": [0.1, 0.0]}
    wind, angle = SeriesInflow.of(columns), 1.1
    turned = SeriesInflow.of({**columns, "direction": [angle, angle]})
    turn = np.array([[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 1.0]])
    np.testing.assert_allclose(
        turned.velocity(POINTS @ turn.T, 4.0), wind.velocity(POINTS, 4.0) @ turn.T, rtol=1e-12, atol=1e-12
    )


def test_a_traveling_series_is_met_earlier_upwind():
    wind = SeriesInflow.of({"time": [0.0, 10.0, 30.0], "speed": [8.0, 12.0, 10.0]}, travels=True)
    speed = wind.mean_speed
    for t in (2.0, 11.0):
        ahead = wind.velocity([-50.0, 0.0, 90.0], t)
        np.testing.assert_allclose(ahead, wind.velocity(HUB, t + 50.0 / speed), rtol=1e-12)
    assert replace(wind, travels=False).velocity([-50.0, 0.0, 90.0], 2.0)[0] == pytest.approx(8.8)


def test_copies_and_pickles_are_equal_and_keep_the_kernel():
    wind = SeriesInflow.step(8.0, 12.0, 10.0)
    for copy in (pickle.loads(pickle.dumps(wind)), deepcopy(wind)):
        assert copy == wind
        assert hash(copy) == hash(wind)
        assert not copy.table.flags.writeable
        np.testing.assert_array_equal(copy.velocity(POINTS, 11.0), wind.velocity(POINTS, 11.0))
    assert wind != replace(wind, time_offset=1.0)
    with pytest.raises(InflowError, match="point 1 of 2"):
        wind.velocity([HUB, [math.nan, 0.0, 0.0]], 0.0)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({}, "either 'file' or 'kind'"),
        ({"kind": "step", "file": "a.csv"}, "either 'file' or 'kind'"),
        ({"kind": "stepp"}, "kind must be one of"),
        ({"kind": "step", "before": 8.0, "after": 9.0}, "needs time"),
        ({"kind": "steady", "speed": 8.0, "jet_heigt": 100.0}, "did you mean 'jet_height'"),
        ({"file": "a.txt"}, "file must end in"),
        ({"file": ["a.bin", "b.bin"]}, "the paths of u, v and w"),
        ({"file": "a.csv", "beyond_grid": "hold"}, "has no option 'beyond_grid'"),
        ("a.txt", "described by a mapping or by a file"),
        ({"kind": "ramp", "before": 8.0, "after": 9.0, "time": 1.0, "duration": -1.0}, "duration must lie in"),
    ],
)
def test_wrong_descriptions_are_refused(given, message):
    with pytest.raises(InflowError, match=message):
        wind_from(given)


def test_descriptions_take_hub_and_diameter_of_the_turbine(tmp_path):
    path = write(tmp_path / "a.wnd", LINES)
    wind = wind_from(path, 150.0, 240.0)
    assert (wind.hub_height, wind.reference_length) == (150.0, 240.0)
    (tmp_path / "gust.json").write_text('{"file": "a.wnd", "hub_height": 100.0, "travels": true}')
    told = wind_from(tmp_path / "gust.json", 150.0, 240.0)
    assert (told.hub_height, told.reference_length, told.travels) == (100.0, 240.0, True)
    (tmp_path / "bad.json").write_text("{")
    with pytest.raises(InflowError, match="cannot read the description"):
        wind_from(tmp_path / "bad.json")


def test_profiles_with_a_nose_and_with_negative_shear():
    jet = wind_from({"kind": "steady", "speed": 9.0, "jet_height": 120.0, "jet_share": 0.6, "shear_exponent": 0.1})

    def prandtl(z):
        return math.sqrt(2.0) * math.exp(math.pi / 4 * (1.0 - z / 120.0)) * math.sin(math.pi / 4 * z / 120.0)

    for z in (10.0, 90.0, 120.0, 200.0, 480.0):
        expected = 9.0 * (0.4 * (z / 90.0) ** 0.1 + 0.6 * prandtl(z) / prandtl(90.0))
        assert jet.velocity([0.0, 0.0, z], 0.0)[0] == pytest.approx(expected, rel=1e-12)
    pure = wind_from({"kind": "steady", "speed": 9.0, "jet_height": 120.0, "jet_share": 1.0})
    z = np.arange(1.0, 400.0)
    u = pure.velocity(np.column_stack([0 * z, 0 * z, z]), 0.0)[:, 0]
    assert z[np.argmax(u)] == 120.0
    np.testing.assert_array_equal(pure.velocity([[0.0, 0.0, 0.0], [0.0, 0.0, -3.0]], 0.0), 0.0)
    falling = wind_from({"kind": "steady", "speed": 9.0, "shear_exponent": -0.2})
    heights = np.array([0.0, 5.0, 9.0, 45.0, 180.0])
    u = falling.velocity(np.column_stack([0 * heights, 0 * heights, heights]), 0.0)[:, 0]
    np.testing.assert_allclose(u, 9.0 * np.maximum(heights / 90.0, 0.1) ** -0.2, rtol=1e-12)
