"""TurbSim .bts files: byte layout against a file built by hand, round trip, refusals."""

import struct

import numpy as np
import pytest

from wt_gym.base.errors import InflowError
from wt_gym.wind import SteadyInflow, TurbulenceBox, TurbulentInflow
from wt_gym.wind.files import read_bts, write_bts

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


def test_reads_a_description_of_any_length(handmade):
    data, text = handmade.read_bytes(), b"Gr\xf6\xdfe " + 300 * b"x"
    start = 66 + 4 + len(DESCRIPTION)
    handmade.write_bytes(data[:66] + struct.pack("<i", len(text)) + text + data[start:])
    box = read_bts(handmade)
    assert box.description.endswith(300 * "x")
    handmade.write_bytes(data)
    np.testing.assert_array_equal(box.fluctuation, read_bts(handmade).fluctuation)


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


def test_round_trip_is_as_fine_as_the_integers(tmp_path):
    box = TurbulenceBox.kaimal(8.0, 90.0, 126.0, seed=5, duration=60.0, grid=(5, 7), cache=False)
    path = tmp_path / "box.bts"
    write_bts(box, path)
    back = read_bts(path)
    for name in ("time_step", "spacing_y", "spacing_z", "z_bottom", "mean_speed", "hub_height", "duration"):
        assert getattr(back, name) == pytest.approx(getattr(box, name), rel=1e-6)
    assert back.periodic
    assert back.description == box.description
    count = (box.fluctuation.max(axis=(0, 1, 2)) - box.fluctuation.min(axis=(0, 1, 2))) / 65535
    assert np.all(np.abs(back.fluctuation - box.fluctuation) <= 0.51 * count + 1e-6)


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
    ("damage", "message"),
    [
        (lambda data: data[:50], "header of 70"),
        (lambda data: data[:-1], "truncated"),
        (lambda data: data[:90], "truncated"),
        (lambda data: data + b"xx", "too long"),
        (lambda data: b"\x50\x4b" + data[2:], "not a .bts file"),
        (lambda data: data[:2] + struct.pack("<i", -3) + data[6:], "impossible header"),
        (lambda data: data[:66] + struct.pack("<i", 4000) + data[70:], "impossible header"),
        (lambda data: data[:42] + struct.pack("<f", 1e-3) + data[46:], "must be at most 200 m/s"),
        (lambda data: data[:26] + struct.pack("<f", 0.0) + data[30:], "impossible header"),
        (lambda data: data[:42] + struct.pack("<f", float("nan")) + data[46:], "impossible header"),
    ],
)
def test_wrong_files_are_refused(handmade, damage, message):
    handmade.write_bytes(damage(handmade.read_bytes()))
    with pytest.raises(InflowError, match=message):
        read_bts(handmade)


def test_missing_file_and_misaligned_wind_are_refused(tmp_path, handmade):
    with pytest.raises(InflowError, match="cannot read"):
        read_bts(tmp_path / "absent.bts")
    box = read_bts(handmade)
    with pytest.raises(InflowError, match="aligned"):
        write_bts(box, tmp_path / "x.bts", SteadyInflow(12.177, 90.0, yaw_misalignment=0.1))
