"""Winds from files: TurbSim's .bts, boxes of HAWC2 and hipersim, time series in CSV and uniform wind files."""

import math
import pickle
import re
import struct
import warnings
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from envs_tests.hawc2 import write_hawc2
from wt_gym.base.errors import InflowError
from wt_gym.wind import SeriesInflow, SteadyInflow, TurbulenceBox, TurbulentInflow, TurningInflow, wind_from
from wt_gym.wind.files import read_bts, read_hawc2, read_hipersim, write_bts
from wt_gym.wind.series import read_csv, read_uniform

HUB = 90.0


def turned_by(angle):
    return np.array([[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 1.0]])


# --- TurbSim .bts: byte layout against a file built by hand ---------------------------------------------------------

NZ, NY, NTWR, NT = 3, 2, 2, 4
SLOPE, OFFSET = (7642.3628, 11408.5352, 15189.7031), (-89586.6094, -528.6875, -351.332)
DESCRIPTION = b"written by hand, byte by byte"


def counts(it, point, component):
    """Integer stored for a point (grid row by row, then tower) of a time step."""
    return 1000 * it + 10 * point + component - 2000


@pytest.fixture
def handmade(tmp_path):
    """Return the path of a non-periodic file of 3 x 2 grid points and 2 tower points, packed field by field."""
    parts = [struct.pack("<h", 7)]
    parts += [struct.pack("<i", n) for n in (NZ, NY, NTWR, NT)]
    parts += [struct.pack("<f", x) for x in (20.0, 25.0, 0.05, 12.177, 90.0, 50.0)]
    for slope, offset in zip(SLOPE, OFFSET, strict=True):
        parts += [struct.pack("<f", slope), struct.pack("<f", offset)]
    parts += [struct.pack("<i", len(DESCRIPTION)), DESCRIPTION]
    for it in range(NT):
        for point in range(NZ * NY + NTWR):
            parts += [struct.pack("<h", counts(it, point, k)) for k in range(3)]
    data = b"".join(parts)
    assert len(data) == 70 + len(DESCRIPTION) + NT * (NY * NZ + NTWR) * 6
    path = tmp_path / "hand.bts"
    path.write_bytes(data)
    return path


def decoded(it, point):
    return [(counts(it, point, k) - OFFSET[k]) / SLOPE[k] for k in range(3)]


def test_reads_the_handmade_file(handmade):
    box = read_bts(handmade)
    assert box.fluctuation.shape == (NT, NZ, NY, 3)
    np.testing.assert_allclose(box.y, [-12.5, 12.5])
    np.testing.assert_allclose(box.z, [50.0, 70.0, 90.0])
    assert (box.time_step, box.mean_speed, box.hub_height) == pytest.approx((0.05, 12.177, 90.0))
    assert box.description == DESCRIPTION.decode()
    assert not box.periodic
    inflow = TurbulentInflow(box)
    for it in range(NT):
        for iz in range(NZ):
            for iy in range(NY):
                point = [0.0, box.y[iy], box.z[iz]]
                expected = decoded(it, iz * NY + iy)
                np.testing.assert_allclose(inflow.velocity(point, it * box.time_step), expected, atol=5e-5)
        for tower_point in range(NTWR):
            velocity = box.tower[it, tower_point] + [box.mean_speed, 0.0, 0.0]
            np.testing.assert_allclose(velocity, decoded(it, NZ * NY + tower_point), atol=1e-5)


def test_writes_the_same_layout(tmp_path):
    """Every header field and integer of a written file, decoded with struct alone."""
    rng = np.random.default_rng(3)
    grid = rng.normal(size=(NT, NZ, NY, 3)).astype(np.float32)
    tower = rng.normal(size=(NT, NTWR, 3)).astype(np.float32)
    box = TurbulenceBox(grid, 0.5, 25.0, 20.0, 50.0, 12.0, 90.0, tower=tower, description="A box")
    path = tmp_path / "box.bts"
    write_bts(box, path)
    data = path.read_bytes()
    assert struct.unpack_from("<h4i", data) == (8, NZ, NY, NTWR, NT)
    assert struct.unpack_from("<6f", data, 18) == (20.0, 25.0, 0.5, 12.0, 90.0, 50.0)
    scaling = np.array(struct.unpack_from("<6f", data, 42)).reshape(3, 2)
    assert struct.unpack_from("<i", data, 66) == (5,)
    assert data[70:75] == b"A box"
    values = np.array(struct.unpack_from(f"<{3 * NT * (NZ * NY + NTWR)}h", data, 75)).reshape(NT, -1, 3)
    assert len(data) == 75 + 2 * values.size
    assert values.min(axis=(0, 1)).tolist() == [-32768] * 3
    assert values.max(axis=(0, 1)).tolist() == [32767] * 3
    velocity = (values - scaling[:, 1]) / scaling[:, 0]
    fluctuation = np.concatenate([grid.reshape(NT, -1, 3), tower], axis=1)
    expected = fluctuation + np.array([12.0, 0.0, 0.0])
    assert np.all(np.abs(velocity - expected) <= 0.51 / scaling[:, 0])
    back = read_bts(path)
    assert back.periodic
    assert back.description == "A box"
    assert (back.z_bottom, back.hub_height, back.spacing_y) == (50.0, 90.0, 25.0)


def test_profile_is_written_and_can_be_removed(tmp_path):
    box = TurbulenceBox.kaimal(8.0, 90.0, 126.0, seed=6, duration=60.0, grid=(5, 5), cache=False)
    steady = SteadyInflow(8.0, 90.0, shear_exponent=0.2, veer=0.001)
    path = tmp_path / "sheared.bts"
    write_bts(box, path, steady)
    points = np.random.default_rng(0).uniform([0, -60, 30], [0, 60, 150], size=(20, 3))
    at_grid = np.array([[0.0, box.y[1], box.z[0]], [0.0, box.y[4], box.z[3]]])
    original = TurbulentInflow(box, steady)
    kept = TurbulentInflow(read_bts(path))
    np.testing.assert_allclose(kept.velocity(at_grid, 7.5), original.velocity(at_grid, 7.5), atol=2e-4)
    removed = TurbulentInflow(read_bts(path, remove_profile=True), steady)
    np.testing.assert_allclose(removed.velocity(points, 7.6), original.velocity(points, 7.6), atol=3e-4)
    with pytest.raises(InflowError, match="profile"):
        TurbulentInflow(read_bts(path), steady)


def test_component_without_fluctuation_survives(tmp_path):
    grid = np.zeros((4, 2, 2, 3), dtype=np.float32)
    grid[..., 1] = 1e-5 * np.arange(4)[:, None, None]
    path = tmp_path / "calm.bts"
    write_bts(TurbulenceBox(grid, 1.0, 10.0, 10.0, 80.0, 25.0, 85.0), path)
    back = read_bts(path)
    np.testing.assert_allclose(back.fluctuation[..., 0], 0.0, atol=4e-6)
    np.testing.assert_allclose(back.fluctuation[..., 1], grid[..., 1], atol=1e-9)
    np.testing.assert_array_equal(back.fluctuation[..., 2], 0.0)


@pytest.mark.parametrize(
    ("start", "packed", "message"),
    [
        (0, b"\x50\x4b", "not a .bts file"), (2, struct.pack("<i", -3), "impossible header"),
        (66, struct.pack("<i", 4000), "impossible header"), (42, struct.pack("<f", 1e-3), "must be at most 200 m/s"),
        (26, struct.pack("<f", 0.0), "impossible header"), (42, struct.pack("<f", math.nan), "impossible header"),
    ],
)  # fmt: skip
def test_wrong_headers_are_refused(handmade, start, packed, message):
    data = handmade.read_bytes()
    handmade.write_bytes(data[:start] + packed + data[start + len(packed) :])
    with pytest.raises(InflowError, match=message):
        read_bts(handmade)


def test_files_that_are_missing_too_short_or_long_and_misaligned_wind_are_refused(tmp_path, handmade):
    with pytest.raises(InflowError, match="cannot read"):
        read_bts(tmp_path / "absent.bts")
    with pytest.raises(InflowError, match="aligned"):
        write_bts(read_bts(handmade), tmp_path / "x.bts", SteadyInflow(12.177, 90.0, yaw_misalignment=0.1))
    data = handmade.read_bytes()
    for wrong, message in (
        (data[:50], "header of 70"), (data[:-1], "truncated"), (data[:90], "truncated"), (data + b"xx", "too long")
    ):  # fmt: skip
        handmade.write_bytes(wrong)
        with pytest.raises(InflowError, match=message):
            read_bts(handmade)


# --- boxes of HAWC2 and hipersim, how far a grid must reach, tower points, profiles in words -------------------------

SHAPE, SPACING, SPEED = (6, 4, 5), (3.0, 50.0, 40.0), 12.0
SAMPLES = np.random.default_rng(4).normal(size=(3, *SHAPE)).astype(np.float32)


@pytest.fixture
def files(tmp_path):
    paths = [tmp_path / f"box_{name}.bin" for name in "uvw"]
    for path, samples in zip(paths, SAMPLES, strict=True):
        path.write_bytes(samples.astype("<f4").tobytes())
    return paths


def at(box, x, y, z, time):
    return TurbulentInflow(box).velocity([x, y, z], time) - [SPEED, 0.0, 0.0]


def test_axes_of_hawc2(files):
    """The first plane meets the rotor last, the first column is the right one looking downwind, the first row below."""
    box = read_hawc2(files, SHAPE, SPACING, SPEED, HUB)
    dt = SPACING[0] / SPEED
    assert box.time_step == dt
    for ix, iy, iz in ((0, 0, 0), (5, 0, 0), (2, 3, 1), (4, 1, 4)):
        y, z = (iy - 1.5) * SPACING[1], HUB + (iz - 2) * SPACING[2]
        arrives = (SHAPE[0] - 1 - ix) * dt
        np.testing.assert_allclose(at(box, 0.0, y, z, arrives), SAMPLES[:, ix, iy, iz], rtol=1e-5, atol=1e-6)
        # at time zero the last plane is at the tower, and the others stand behind it, upwind
        x = (ix - (SHAPE[0] - 1)) * SPACING[0]
        np.testing.assert_allclose(at(box, x, y, z, 0.0), SAMPLES[:, ix, iy, iz], rtol=1e-5, atol=1e-5)


def test_position_and_factors_of_a_hawc2_box(files):
    box = read_hawc2(files, SHAPE, SPACING, SPEED, HUB, factors=(2.0, 1.0, 0.5), y_center=7.0, z_center=95.0)
    y, z = 7.0 + 0.5 * SPACING[1], 95.0 + SPACING[2]
    expected = SAMPLES[:, 5, 2, 3] * np.array([2.0, 1.0, 0.5])
    np.testing.assert_allclose(at(box, 0.0, y, z, 0.0), expected, rtol=1e-5, atol=1e-5)
    assert (box.y[0], box.z[0]) == (7.0 - 75.0, 15.0)
    with pytest.raises(InflowError, match="y_center must be 0"):
        write_bts(box, files[0].with_suffix(".bts"))


def test_a_box_goes_out_and_in(files):
    box = TurbulenceBox.kaimal(12.0, HUB, 126.0, seed=2, duration=20.0, grid=(5, 3), cache=False)
    spacing = write_hawc2(box, files)
    again = read_hawc2(files, (80, 5, 3), spacing, 12.0, HUB)
    np.testing.assert_array_equal(again.fluctuation, box.fluctuation)
    np.testing.assert_allclose(again.y, box.y, atol=1e-9)
    assert again.z_bottom == pytest.approx(box.z_bottom)
    assert again.time_step == pytest.approx(box.time_step)


def test_hipersim_files_hold_the_same_box(files, tmp_path):
    coords = {name: np.arange(n) * d for name, n, d in zip("xyz", SHAPE, SPACING, strict=True)}
    array = xr.DataArray(SAMPLES, dims=("uvw", "x", "y", "z"), coords={**coords, "uvw": ["u", "v", "w"]})
    array.transpose("x", "y", "z", "uvw").to_netcdf(tmp_path / "box.nc")
    box, other = read_hipersim(tmp_path / "box.nc", SPEED, HUB), read_hawc2(files, SHAPE, SPACING, SPEED, HUB)
    np.testing.assert_array_equal(box.fluctuation, other.fluctuation)
    assert (box.time_step, box.spacing_y, box.spacing_z) == (other.time_step, other.spacing_y, other.spacing_z)
    array.rename(x="a").to_netcdf(tmp_path / "wrong.nc")
    with pytest.raises(InflowError, match="one variable of the dimensions"):
        read_hipersim(tmp_path / "wrong.nc", SPEED, HUB)
    array.isel(uvw=[1, 0, 2]).to_netcdf(tmp_path / "order.nc")
    with pytest.raises(InflowError, match="u, v and w in this order"):
        read_hipersim(tmp_path / "order.nc", SPEED, HUB)
    (tmp_path / "no.nc").write_bytes(b"nothing")
    with pytest.raises(InflowError, match="cannot read"):
        read_hipersim(tmp_path / "no.nc", SPEED, HUB)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"shape": (6, 4, 6)}, "480 bytes where 6 x 4 x 6 numbers of 4 bytes are 576"),
        ({"shape": (6, 4)}, "shape must be three numbers"), ({"shape": (6, 4, 1)}, "at least 2"),
        ({"spacing": (3.0, -1.0, 2.0)}, "spacing along y"), ({"mean_speed": 0.0}, "mean_speed"),
        ({"factors": (1e4, 1.0, 1.0)}, "velocities of up to"),
    ],
)  # fmt: skip
def test_defects_of_hawc2_boxes_are_named(files, change, message):
    given = {"shape": SHAPE, "spacing": SPACING, "mean_speed": SPEED, "hub_height": HUB, **change}
    with pytest.raises(InflowError, match=message):
        read_hawc2(files, **given)
    with pytest.raises(InflowError, match="three files"):
        read_hawc2(files[:2], SHAPE, SPACING, SPEED, HUB)


def test_described_boxes_stand_on_a_mean_wind(files):
    given = {"file": [str(f) for f in files], "shape": SHAPE, "spacing": SPACING, "mean_speed": SPEED}
    wind = wind_from({**given, "shear_exponent": 0.2, "time_offset": 0.5}, HUB)
    assert wind.steady == SteadyInflow(SPEED, HUB, shear_exponent=0.2)
    assert "Mann box at 12 m/s" in wind.description
    assert "power-law profile (exponent 0.2)" in wind.description
    shifted = wind_from(given, HUB)
    np.testing.assert_allclose(
        wind.velocity([0.0, 5.0, HUB], 1.0), shifted.velocity([0.0, 5.0, HUB], 1.5), rtol=1e-6, atol=1e-6
    )


def box_of(width, height, z_bottom, y_center=0.0, n=5):
    samples = np.zeros((4, n, n, 3), dtype=np.float32)
    spacing = width / (n - 1), height / (n - 1)
    return TurbulenceBox(samples, 1.0, *spacing, z_bottom, 12.0, HUB, y_center=y_center, description="a box")


@pytest.mark.parametrize(
    ("box", "numbers"),
    [
        (box_of(54.0, 54.0, 63.0), "y from -27 to 27 m and z from 63 to 117 m"),
        (box_of(140.0, 140.0, 90.0), "z from 90 to 230 m"),
        (box_of(140.0, 140.0, 20.0, y_center=40.0), "y from -30 to 110 m"),
        (box_of(140.0, 120.0, 40.0), "z from 40 to 160 m"),
        (box_of(140.0, 100.0, 20.0), "z from 20 to 120 m"),
        (box_of(100.0, 140.0, 20.0), "y from -50 to 50 m"),
    ],
)
def test_a_grid_must_reach_around_the_rotor(box, numbers):
    wind = TurbulentInflow(box)
    expected = re.escape(numbers) + ".*the rotor needs y from -63 to 63 m and z from 27 to 153 m"
    with pytest.raises(InflowError, match=expected):
        wind.require_cover(HUB, 126.0)
    with pytest.raises(InflowError, match=expected):
        TurningInflow(wind, np.zeros(1), np.zeros(1)).require_cover(HUB, 126.0)
    with pytest.warns(UserWarning, match=expected + ".*held at the edge"):
        replace(wind, beyond_grid="hold").require_cover(HUB, 126.0)
    assert "held at the edge of its grid" in replace(wind, beyond_grid="hold").description


def test_grids_of_our_own_and_as_wide_as_the_rotor_reach_around_it():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        TurbulentInflow(box_of(126.0, 126.0, 27.0)).require_cover(HUB, 126.0)
        for hub, diameter in ((90.0, 126.0), (150.0, 242.0), (170.0, 284.0), (67.0, 130.0)):
            box = TurbulenceBox.kaimal(10.0, hub, diameter, seed=1, duration=4.0, grid=(3, 3), cache=False)
            TurbulentInflow(box).require_cover(hub, diameter)
    with pytest.raises(InflowError, match="beyond_grid must be one of"):
        TurbulentInflow(box_of(140.0, 140.0, 20.0), beyond_grid="ignore")


@pytest.fixture
def towered():
    rng = np.random.default_rng(8)
    samples, tower = (rng.normal(size=s).astype(np.float32) for s in ((8, 4, 3, 3), (8, 2, 3)))
    return TurbulenceBox(samples, 0.5, 60.0, 40.0, 30.0, 10.0, HUB, tower=tower)


def test_below_the_grid_the_wind_is_that_of_the_tower_points(towered):
    """At the points themselves, half-way between them and the lowest row, and below the last one."""
    wind, row, tower = TurbulentInflow(towered), towered.fluctuation[3, 0], towered.tower[3]
    mean = np.array([10.0, 0.0, 0.0])
    for z, y, expected in (
        (30.0, 60.0, row[2]),
        (10.0, 60.0, 0.5 * (row[2] + tower[0])),
        (10.0, 0.0, 0.5 * (row[1] + tower[0])),
        (-10.0, 60.0, tower[0]),
        (-30.0, -60.0, 0.5 * (tower[0] + tower[1])),
        (-50.0, 0.0, tower[1]),
        (-80.0, 0.0, tower[1]),
    ):
        np.testing.assert_allclose(wind.velocity([0.0, y, z], 1.5) - mean, expected, rtol=1e-5, atol=1e-6)
    now = wind.velocity([0.0, 0.0, -10.0], 1.6) - mean
    np.testing.assert_allclose(now, 0.8 * towered.tower[3, 0] + 0.2 * towered.tower[4, 0], rtol=1e-5, atol=1e-6)
    again = pickle.loads(pickle.dumps(wind))
    np.testing.assert_array_equal(again.velocity([0.0, 0.0, -10.0], 1.6), wind.velocity([0.0, 0.0, -10.0], 1.6))


def test_tower_points_of_a_file_are_used(towered, tmp_path):
    grid = replace(towered, z_bottom=50.0)
    write_bts(grid, tmp_path / "towered.bts")
    wind = wind_from(tmp_path / "towered.bts")
    expected = TurbulentInflow(grid).velocity([[0.0, 0.0, 10.0], [0.0, 30.0, 40.0]], 0.7)
    np.testing.assert_allclose(wind.velocity([[0.0, 0.0, 10.0], [0.0, 30.0, 40.0]], 0.7), expected, atol=2e-3)


# --- winds that follow a time series --------------------------------------------------------------------------------

AT_HUB = [0.0, 0.0, HUB]
POINTS = np.array([AT_HUB, [3.0, -40.0, 120.0], [-5.0, 60.0, 40.0], [0.0, 10.0, 1.0]])


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
    hub = LINES[:, 1] + LINES[:, 7]  # with the gust
    assert wind.mean_speed == pytest.approx(np.trapezoid(hub, LINES[:, 0]) / 20.0)
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
    up = math.radians(5.0)
    turn = turned_by(-math.radians(10.0)) @ np.array(
        [[math.cos(up), 0, -math.sin(up)], [0, 1.0, 0], [math.sin(up), 0, math.cos(up)]]
    )
    origin = np.array([0.0, 0.0, 150.0])
    velocity = turn @ wind.velocity(turn.T @ (np.array(point) - origin) + origin, 30.0)
    np.testing.assert_allclose(velocity, published, atol=1e-7)


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
    np.testing.assert_allclose(wind.velocity(AT_HUB, 10.0), [12.0 * math.cos(math.pi / 6), 6.0, 0.0], rtol=1e-12)
    assert wind.velocity([0.0, 0.0, 180.0], 0.0)[0] == pytest.approx(8.0 * 2.0**-0.1, rel=1e-12)
    assert (wind.mean_speed, wind.start_speed, wind.duration) == (10.0, 8.0, 10.0)
    assert wind.description == (
        "met.csv: 8 to 12 m/s at 90 m, power-law profile, exponent -0.1, direction 0 to 30 deg, 10 s"
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"), ("# nothing\n", "is empty"), ("time,speed\n", "must have lines of numbers"),
        ("time,wind\n0,8\n", "columns must be among .*; got 'wind'"), ("time,Speed\n0,8\n", "did you mean 'speed'"),
        ("time,direction\n0,8\n", "'speed' must be there"), ("time,speed,speed\n0,8,8\n", "must be named once"),
        ("time,speed\n0,8\n1\n", "line 3: 2 numbers are needed"),
        ("time,speed\n0,8\n1,fast\n", "line 3: speed must be a number; got 'fast'"),
        ("time,speed\n0,8\n1,nan\n", "line 3: every number must be finite"),
        ("time,speed\n0,8\n1,-2\n", r"speed must lie in \[0, 200\] m/s; got -2 at 1 s"),
        ("time,speed\n1,8\n0,9\n", "times must not decrease; 0 s follows 1 s"),
        ("time,speed\n0,8\n0,9\n0,10\n", "at most twice .a step., got 0 s"),
        ("time,speed,shear_exponent\n0,8,2\n", "shear_exponent must lie in"),
    ],
)  # fmt: skip
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
    step = SeriesInflow.ramp(8.0, 12.0, 10.0, shear_exponent=0.2)
    below = [0.0, 0.0, 45.0]
    assert step.velocity(below, np.nextafter(10.0, 0.0))[0] == pytest.approx(8.0 * 0.5**0.2, rel=1e-12)
    assert step.velocity(below, 10.0)[0] == pytest.approx(12.0 * 0.5**0.2, rel=1e-12)
    assert step.start_speed == 8.0
    ramp = SeriesInflow.ramp(5.0, 25.0, 10.0, 40.0)
    speeds = [ramp.velocity(AT_HUB, t)[0] for t in (0.0, 20.0, 30.0, 50.0, 99.0)]
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
    seen, expected = turned.velocity(POINTS @ turned_by(angle).T, 4.0), wind.velocity(POINTS, 4.0) @ turned_by(angle).T
    np.testing.assert_allclose(seen, expected, rtol=1e-12, atol=1e-12)


def test_a_traveling_series_is_met_earlier_upwind():
    wind = SeriesInflow.of({"time": [0.0, 10.0, 30.0], "speed": [8.0, 12.0, 10.0]}, travels=True)
    speed = wind.mean_speed
    for t in (2.0, 11.0):
        ahead = wind.velocity([-50.0, 0.0, 90.0], t)
        np.testing.assert_allclose(ahead, wind.velocity(AT_HUB, t + 50.0 / speed), rtol=1e-12)
    assert replace(wind, travels=False).velocity([-50.0, 0.0, 90.0], 2.0)[0] == pytest.approx(8.8)


def test_copies_and_pickles_are_equal_and_keep_the_kernel():
    wind = SeriesInflow.ramp(8.0, 12.0, 10.0)
    for copy in (pickle.loads(pickle.dumps(wind)), deepcopy(wind)):
        assert copy == wind
        assert hash(copy) == hash(wind)
        assert not copy.table.flags.writeable
        np.testing.assert_array_equal(copy.velocity(POINTS, 11.0), wind.velocity(POINTS, 11.0))
    assert wind != replace(wind, time_offset=1.0)
    with pytest.raises(InflowError, match="point 1 of 2"):
        wind.velocity([AT_HUB, [math.nan, 0.0, 0.0]], 0.0)


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
