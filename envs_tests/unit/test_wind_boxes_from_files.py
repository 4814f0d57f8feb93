"""Boxes of HAWC2 and hipersim, grids that must reach around the rotor, tower points, profiles in words."""

import math
import pickle
import re
import warnings
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from wt_gym.base.errors import InflowError
from wt_gym.wind import SteadyInflow, TurbulenceBox, TurbulentInflow, TurningInflow, wind_from
from wt_gym.wind.files import read_hawc2, read_hipersim, write_bts, write_hawc2

SHAPE, SPACING, SPEED, HUB = (6, 4, 5), (3.0, 50.0, 40.0), 12.0, 90.0
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


def test_a_box_goes_out_and_in(files, tmp_path):
    box = TurbulenceBox.kaimal(12.0, HUB, 126.0, seed=2, duration=20.0, grid=(5, 3), cache=False)
    spacing = write_hawc2(box, files)
    again = read_hawc2(files, (80, 5, 3), spacing, 12.0, HUB)
    np.testing.assert_array_equal(again.fluctuation, box.fluctuation)
    np.testing.assert_allclose(
        [
            again.y,
        ],
        [box.y],
        atol=1e-9,
    )
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
        ({"shape": (6, 4)}, "shape must be three numbers"),
        ({"shape": (6, 4, 1)}, "at least 2"),
        ({"spacing": (3.0, -1.0, 2.0)}, "spacing along y"),
        ({"mean_speed": 0.0}, "mean_speed"),
        ({"factors": (1e4, 1.0, 1.0)}, "velocities of up to"),
    ],
)
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


def test_files_say_what_profile_they_hold(tmp_path):
    box = TurbulenceBox.kaimal(12.0, HUB, 126.0, seed=2, duration=60.0, grid=(5, 5), cache=False)
    write_bts(box, tmp_path / "a.bts", SteadyInflow(12.0, HUB, shear_exponent=0.14))
    told = wind_from(tmp_path / "a.bts")
    low, high = (12.0 * (z / HUB) ** 0.14 for z in (box.z[0], box.z[-1]))
    expected = f"profile of the file: {low:.3g} m/s at 17.55 m to {high:.3g} m/s at 162.4 m"
    assert f"{expected} (exponent of a power law through it 0.14), on a uniform profile" in told.description
    bare = wind_from({"file": str(tmp_path / "a.bts"), "remove_profile": True, "shear_exponent": 0.1})
    assert "power-law profile (exponent 0.1)" in bare.description
    assert "profile of the file" not in bare.description


def test_a_shifted_grid_reads_the_shifted_field():
    samples = np.random.default_rng(1).normal(size=(6, 3, 5, 3)).astype(np.float32)
    plain = TurbulenceBox(samples, 0.5, 40.0, 80.0, 10.0, 10.0, HUB)
    shifted = replace(plain, y_center=15.0)
    points = np.array([[3.0, -40.0, 50.0], [-2.0, 21.0, 120.0]])
    np.testing.assert_allclose(
        TurbulentInflow(shifted).velocity(points + np.array([0.0, 15.0, 0.0]), 0.8),
        TurbulentInflow(plain).velocity(points, 0.8),
        rtol=1e-12,
    )
    assert shifted != plain


def test_a_box_turned_and_shifted_in_time_is_the_result_turned_and_shifted(towered):
    wind, angle = TurbulentInflow(towered), 0.6
    turn = np.array([[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 1.0]])
    points = np.array([[3.0, -40.0, 50.0], [-2.0, 21.0, 120.0], [0.0, 5.0, 5.0]])
    turned = TurbulentInflow(towered, SteadyInflow(10.0, HUB, yaw_misalignment=angle))
    np.testing.assert_allclose(
        turned.velocity(points @ turn.T, 0.8), wind.velocity(points, 0.8) @ turn.T, rtol=1e-9, atol=1e-9
    )
    later = TurbulentInflow(towered, time_offset=0.7)
    np.testing.assert_allclose(later.velocity(points, 0.8), wind.velocity(points, 1.5), rtol=1e-12)
