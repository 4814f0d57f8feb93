"""Turbulence boxes: reproducibility, cache, interpolation and refusals."""

import math
import os
import tokenize
from dataclasses import replace

import numpy as np
import pytest

from wt_gym.base.errors import InflowError
from wt_gym.wind import SteadyInflow, TurbulenceBox, TurbulentInflow, turbulence_box
from wt_gym.wind.kaimal import KaimalParameters

SITE = {"mean_speed": 8.0, "hub_height": 90.0, "rotor_diameter": 126.0}
SMALL = {**SITE, "duration": 20.0, "grid": (3, 3)}


def small_box(seed=1, **changes):
    return TurbulenceBox.kaimal(**{**SMALL, "seed": seed, "cache": False, **changes})


def forget():
    turbulence_box._made_box.cache_clear()


@pytest.fixture
def cache_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("WT_GYM_CACHE", str(tmp_path))
    forget()
    yield tmp_path / "turbulence"
    forget()


def file_of(seed, **changes):
    """File of a box in the cache."""
    arguments = {
        **SMALL, "turbulence_class": "B", "seed": seed, "time_step": 0.25, "width": None, "turbulence": "NTM",
        "turbine_class": "I", "scaling": "low_frequency", "lateral_coherence": True,
    }  # fmt: skip
    return turbulence_box.cache_file(KaimalParameters(**{**arguments, **changes}))


def test_same_seed_same_bits_and_other_seed_other_wind():
    first = small_box(7)
    forget()
    second, other = small_box(7), small_box(8)
    assert first is not second
    np.testing.assert_array_equal(first.fluctuation, second.fluctuation)
    assert first == second
    assert hash(first) == hash(second)
    assert TurbulentInflow(first) == TurbulentInflow(second)
    assert first != other
    assert abs(np.corrcoef(first.fluctuation[:, 1, 1, 1], other.fluctuation[:, 1, 1, 1])[0, 1]) < 0.9


def test_default_box_of_the_5mw():
    box = TurbulenceBox.kaimal(**SITE, seed=0, cache=False)
    assert box.duration == 600.0
    assert box.time_step <= 0.25
    assert max(box.spacing_y, box.spacing_z) <= 10.0
    assert box.y[-1] - box.y[0] == pytest.approx(1.15 * 126.0)
    assert 0.5 * (box.z[0] + box.z[-1]) == pytest.approx(90.0)
    assert box.fluctuation.dtype == np.float32
    np.testing.assert_allclose(box.fluctuation.mean(axis=0, dtype=float), 0.0, atol=1e-6)
    sigma = 0.14 * (0.75 * 8.0 + 5.6)
    hub = box.fluctuation[:, box.z.size // 2, box.y.size // 2].astype(float)
    after = np.roll(hub, -1, axis=0)
    squares = ((hub**2 + hub * after + after**2) / 3.0).mean(axis=0)  # of the straight lines between the samples
    np.testing.assert_allclose(np.sqrt(squares), sigma * np.array([1.0, 0.8, 0.5]), rtol=1e-6)


def test_box_is_immutable_and_kept_in_memory():
    box, samples = small_box(), np.ones((4, 2, 2, 3), dtype=np.float32)
    assert small_box() is box
    with pytest.raises(ValueError, match="read-only"):
        box.fluctuation[0, 0, 0, 0] = 1.0
    with pytest.raises(AttributeError):
        box.time_step = 1.0
    own = TurbulenceBox(samples, 1.0, 10.0, 10.0, 80.0, 8.0, 85.0)
    samples[:] = 2.0  # the array of the caller is not shared
    assert own.fluctuation.max() == 1.0


def test_a_field_carried_along_at_another_speed_is_the_box_that_was_asked_for():
    box = TurbulenceBox.kaimal(**SMALL, seed=3)
    other = box.carried_along(10.0, 1.25, "faster")
    step = box.time_step * box.mean_speed / 10.0
    asked = replace(box, mean_speed=10.0, scale=1.25, time_step=step, description="faster")
    assert other == asked
    assert other.fluctuation is box.fluctuation
    assert box.scale == 1.0
    for wrong in ((0.0, 1.0), (math.nan, 1.0), (10.0, -1.0)):
        with pytest.raises(InflowError):
            box.carried_along(*wrong, "")


def test_second_build_reads_the_file(cache_folder, monkeypatch):
    box = TurbulenceBox.kaimal(**SMALL, seed=3)
    assert list(cache_folder.iterdir()) == [file_of(3)]
    with file_of(3).open("rb") as file:
        *_, samples = (np.load(file) for _ in range(3))
    np.testing.assert_array_equal(samples, box.fluctuation)
    forget()
    monkeypatch.setattr(KaimalParameters, "synthesize", lambda _: pytest.fail("made again"))
    assert TurbulenceBox.kaimal(**SMALL, seed=3) == box


@pytest.mark.parametrize(
    "change",
    [
        {"seed": 4}, {"mean_speed": 8.1}, {"turbulence_class": "A"}, {"turbulence": "ETM"}, {"time_step": 0.125},
        {"duration": 30.0}, {"width": 130.0}, {"scaling": "uniform"}, {"scaling": "none"},
        {"lateral_coherence": False}, {"spectrum_of": "samples"},
    ],
)  # fmt: skip
def test_every_parameter_counts_in_the_cache(change):
    assert file_of(**{"seed": 3, **change}) != file_of(3)


def test_damaged_and_foreign_files_are_noticed_and_made_again(cache_folder, caplog, monkeypatch):
    box, path = TurbulenceBox.kaimal(**SMALL, seed=3), file_of(3)
    sound = path.read_bytes()
    flipped = bytearray(sound)
    flipped[len(sound) // 2] ^= 0xFF
    TurbulenceBox.kaimal(**SMALL, seed=4)
    foreign = file_of(4).read_bytes()
    for wrong in (b"", sound[:10], sound[:500], sound[:-100], flipped, foreign):
        path.write_bytes(wrong)
        forget()
        caplog.clear()
        assert TurbulenceBox.kaimal(**SMALL, seed=3) == box
        assert path.read_bytes() == sound
        assert ("another box" if wrong is foreign else "unreadable") in caplog.text
    for error in (tokenize.TokenError("EOF in multi-line statement"), SyntaxError("invalid syntax")):  # in its headers

        def load(*_, error=error, **__):
            raise error

        monkeypatch.setattr(np, "load", load)
        forget()
        caplog.clear()
        assert TurbulenceBox.kaimal(**SMALL, seed=3) == box
        assert "unreadable" in caplog.text


def test_unwritable_cache_only_warns(tmp_path, monkeypatch, caplog):
    """A file stands where the directory should be: this also stops a privileged user."""
    blocker = tmp_path / "file"
    blocker.write_text("")
    monkeypatch.setenv("WT_GYM_CACHE", str(blocker))
    forget()
    assert TurbulenceBox.kaimal(**SMALL, seed=3).duration == 20.0
    assert "could not be cached" in caplog.text
    forget()


def test_cache_folder_is_bounded(cache_folder, monkeypatch):
    TurbulenceBox.kaimal(**SMALL, seed=0)
    monkeypatch.setattr(turbulence_box, "MAX_BYTES", 3 * file_of(0).stat().st_size + 100)
    for age, seed in enumerate((1, 2)):
        TurbulenceBox.kaimal(**SMALL, seed=seed)
        os.utime(file_of(seed), (1000 + age, 1000 + age))
    TurbulenceBox.kaimal(**SMALL, seed=3)
    assert [seed for seed in range(4) if file_of(seed).exists()] == [0, 2, 3]


@pytest.mark.parametrize(
    "change",
    [
        {"mean_speed": 0.0}, {"mean_speed": math.nan}, {"rotor_diameter": 200.0}, {"width": 200.0}, {"seed": -1},
        {"seed": 1.5}, {"seed": True}, {"grid": (4, 3)}, {"grid": (3,)}, {"duration": 20.1}, {"duration": 0.25},
        {"time_step": 0.0}, {"turbulence_class": "Z"}, {"turbulence": "calm"}, {"turbine_class": "IX"},
        {"scaling": "IEC"}, {"scaling": True},
    ],
)  # fmt: skip
def test_wrong_arguments_are_refused(change):
    with pytest.raises(InflowError):
        small_box(**{"seed": 1, **change})


@pytest.mark.parametrize(
    "samples", [np.zeros((4, 2, 2)), np.zeros((4, 1, 2, 3)), np.zeros((4, 2, 2, 2)), np.full((4, 2, 2, 3), np.nan)]
)
def test_wrong_samples_are_refused(samples):
    with pytest.raises(InflowError):
        TurbulenceBox(samples, 1.0, 10.0, 10.0, 80.0, 8.0, 85.0)


def trilinear_box():
    """Return a box whose samples are linear in y, z and time, so that linear interpolation is exact."""
    t, z, y = np.meshgrid(np.arange(8.0), 80.0 + 5.0 * np.arange(5), 6.0 * (np.arange(3) - 1), indexing="ij")
    samples = np.stack([0.1 * t + 0.02 * y, 0.01 * (z - 90.0) * y, 0.3 * t - 0.05 * (z - 90.0)], axis=-1)
    return TurbulenceBox(samples, 1.0, 6.0, 5.0, 80.0, 10.0, 90.0)


def test_interpolation_between_the_samples():
    inflow = TurbulentInflow(trilinear_box())
    velocity = inflow.velocity([-13.0, 2.5, 93.0], 1.2)  # 1.3 s more: 2.5 s in the box
    expected = [10.0 + 0.25 + 0.05, 0.01 * 3.0 * 2.5, 0.75 - 0.15]
    np.testing.assert_allclose(velocity, expected, rtol=1e-6)


def test_clamped_outside_the_grid():
    inflow = TurbulentInflow(trilinear_box())
    far = [[0.0, 80.0, 300.0], [0.0, -80.0, -30.0], [0.0, 1.0, 0.0]]
    edge = [[0.0, 6.0, 100.0], [0.0, -6.0, 80.0], [0.0, 1.0, 80.0]]
    np.testing.assert_allclose(inflow.velocity(far, 3.3), inflow.velocity(edge, 3.3), rtol=1e-12)


def test_mean_wind_must_fit_the_box_and_points_and_times_be_finite():
    box = trilinear_box()
    for arguments, message in (
        ((box, SteadyInflow(12.0, 90.0)), "within 1 %"), ((box, SteadyInflow(10.0, 120.0)), "within 1 %"),
        ((SteadyInflow(8.0),), "must be a TurbulenceBox"), ((box, 8.0), "must be a SteadyInflow"),
        ((box, None, math.inf), "time_offset"),
    ):  # fmt: skip
        with pytest.raises(InflowError, match=message):
            TurbulentInflow(*arguments)
    for points, time in (([0.0, math.nan, 90.0], 0.0), ([0.0, 0.0, 90.0], math.nan)):
        with pytest.raises(InflowError):
            TurbulentInflow(box).velocity(points, time)
