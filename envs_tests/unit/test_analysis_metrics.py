"""Load metrics against exact results."""

import math

import numpy as np
import pytest
import xarray as xr

from wt_gym.analysis.metrics import (
    LIMIT_METRICS,
    METRICS,
    PLATFORM_METRICS,
    TRACKING_METRICS,
    damage_equivalent_load,
    measured_metrics,
    power_spectral_density,
    run_metrics,
)
from wt_gym.control.design import rotor_inertia


def sine(amplitude, frequency, duration, step):
    time = np.arange(0.0, duration + step / 2, step)
    # From crest to crest: whole cycles, every extreme a sample.
    return amplitude * np.cos(2 * np.pi * frequency * time)


@pytest.mark.parametrize(("exponent", "frequency"), [(4.0, 0.25), (10.0, 1.0)])
def test_del_of_a_sine(exponent, frequency):
    # f T cycles of range 2 A over T seconds: DEL = 2 A f^(1/m)
    load = damage_equivalent_load(5.0 + sine(3.0, frequency, 600.0, 0.05), 600.0, exponent)
    assert load == pytest.approx(6.0 * frequency ** (1 / exponent), rel=1e-6)


def test_del_of_two_known_cycle_sizes():
    # ASTM E1049-85, figure 6: -2 1 -3 5 -1 3 -4 4 -2 gives ranges 3 (0.5), 4 (1.5), 6 (0.5), 8 (1.0), 9 (0.5).
    history = np.array([-2.0, 1.0, -3.0, 5.0, -1.0, 3.0, -4.0, 4.0, -2.0])
    damage = 0.5 * 3**4 + 1.5 * 4**4 + 0.5 * 6**4 + 1.0 * 8**4 + 0.5 * 9**4
    assert damage_equivalent_load(history, 10.0, 4.0) == pytest.approx((damage / 10.0) ** 0.25)


def test_del_scales_with_the_load_and_ignores_its_mean():
    rng = np.random.default_rng(0)
    load = rng.standard_normal(500)
    one = damage_equivalent_load(load, 50.0, 10.0)
    assert damage_equivalent_load(1e8 * load + 3e8, 50.0, 10.0) == pytest.approx(1e8 * one, rel=1e-6)
    assert damage_equivalent_load(np.full(10, 3.0), 1.0, 10.0) == 0.0


@pytest.mark.parametrize(
    ("history", "duration", "message"), [([0.0, np.nan], 1.0, "finite"), ([0, 1], 0.0, "positive")]
)
def test_bad_histories_are_refused(history, duration, message):
    with pytest.raises(ValueError, match=message):
        damage_equivalent_load(np.array(history), duration, 4.0)


@pytest.fixture
def run(turbine):
    step, n = 0.1, 1000
    time = step * np.arange(1, n + 1)
    ones = np.ones(n)
    triangle = np.tile([0.0, 1.0], n // 2)  # fastest load cycle the sampling allows: 5 Hz
    channels = {
        "generator_power": 2e6 * ones,
        "generator_torque": 20e3 + 100.0 * np.arange(n),
        "rotor_speed": turbine.drivetrain.rated_rotor_speed * np.where((time % 20) > 15, 1.15, 1.0),
        "tower_base_fore_aft_moment": 30e6 + 40e6 * triangle,
        "tower_base_side_side_moment": 0.0 * ones,
        "tower_base_moment_max": 71e6 * ones,  # extremes lie between the samples
        "tower_base_moment_x": 0.0 * ones,
        "tower_base_moment_y": 30e6 + 40e6 * triangle,
        "yaw": 0.0 * ones,
        "yaw_rate": 0.001 * ones,
    }
    for b in (1, 2, 3):
        channels[f"root_flap_moment_{b}"] = b * 1e6 * triangle
        channels[f"root_edge_moment_{b}"] = 1e6 * ones
        channels[f"tip_out_of_plane_{b}"] = float(b) * ones
        channels[f"tip_clearance_{b}"] = 10.0 * ones
        channels[f"root_flap_moment_max_{b}"] = (b + 0.5) * 1e6 * triangle
        channels[f"tip_out_of_plane_max_{b}"] = b + triangle
        channels[f"tip_clearance_min_{b}"] = 10.0 - b * triangle
        channels[f"pitch_travel_{b}"] = np.full(n, 0.002)  # between the samples too
    channels["rotor_speed_max"] = 1.01 * channels["rotor_speed"]
    return xr.Dataset({name: ("time", values) for name, values in channels.items()}, coords={"time": time})


def test_metrics_of_a_made_up_run(run, turbine):
    metrics, rated = run_metrics(run, turbine), turbine.drivetrain.rated_rotor_speed
    special = {*TRACKING_METRICS, *PLATFORM_METRICS, *LIMIT_METRICS}
    assert set(metrics) == set(METRICS) - special == set(measured_metrics([metrics]))
    half_cycles = 499.5 / 100.0  # 999 in 100 s
    expected = {
        "mean_power": 2e6, "energy": 2e8, "power_std": 0.0, "torque_rate": 1000.0, "overspeed_count": 5,
        "rotor_speed_max": 1.01 * 1.15 * rated, "blade_flap_del": 3e6 * half_cycles**0.1, "blade_edge_del": 0.0,
        "tower_fore_aft_del": 40e6 * half_cycles**0.25, "tower_del": 40e6 * half_cycles**0.25,
        "tip_deflection_max": 4.0, "tip_clearance_min": 7.0, "blade_flap_max": 3.5e6, "tower_base_max": 71e6,
        "pitch_duty_cycle": 0.02 / turbine.pitch.max_rate, "pitch_travel": 2.0, "yaw_travel": 0.1,
    }  # fmt: skip
    assert {name: metrics[name] for name in expected} == pytest.approx(expected)
    assert metrics["rotor_speed_mean"] == pytest.approx(1.0375 * rated, rel=1e-3)


def test_metrics_of_a_platform(run, turbine):
    angle = np.radians(2.0 + np.where(np.arange(run.sizes["time"]) % 2 == 0, 1.0, -1.0))
    channels = {"platform_pitch": ("time", angle), "platform_roll": ("time", np.full_like(angle, np.radians(4.0)))}
    metrics = run_metrics(run.assign(channels), turbine)
    assert set(metrics) == set(METRICS) - {*TRACKING_METRICS, *LIMIT_METRICS}
    found = [math.degrees(metrics[name]) for name in PLATFORM_METRICS]
    assert found == pytest.approx([2.0, 1.0, 5.0], rel=1e-3)


def test_metrics_of_a_tracked_power(run, turbine):
    """2 MW against a demand of 1.9 MW, then of 2.4 MW while the wind allows no more than 2.1 MW."""
    early = np.arange(run.sizes["time"]) < run.sizes["time"] // 2
    demanded, available = np.where(early, 1.9e6, 2.4e6), np.where(early, 5e6, 2.1e6)
    added = {"demanded_power": ("time", demanded), "available_power": ("time", available)}
    metrics = run_metrics(run.assign(added), turbine)
    assert set(metrics) == set(METRICS) - {*PLATFORM_METRICS, *LIMIT_METRICS} == set(measured_metrics([{}, metrics]))
    others = dict.fromkeys(("limits_violated", *PLATFORM_METRICS), 0.0)
    assert set(measured_metrics([metrics, others])) == set(METRICS)
    assert metrics["tracking_mean"] == pytest.approx(250e3)
    assert metrics["tracking_rms"] == pytest.approx(math.sqrt((100e3**2 + 400e3**2) / 2))
    assert metrics["tracking_rms_share"] == pytest.approx(metrics["tracking_rms"] / turbine.drivetrain.rated_power)
    assert metrics["demanded_energy"] == pytest.approx(2.0 / 2.15)
    # the available power is smoothed: it falls below 2.4 MW after 5 s ln(2.9/0.3)
    assert metrics["saturated_share"] == pytest.approx(0.5 - 0.05 * math.log(2.9 / 0.3), abs=2e-3)
    assert 100e3 < metrics["tracking_rms_in_wind"] < metrics["tracking_rms"]


@pytest.mark.parametrize(("above", "events"), [((0,), 1), ((1,), 1), ((0, 1, 3, 5, 6), 3), ((999,), 1), ((), 0)])
def test_an_overspeed_counts_once_from_the_first_sample_on(run, turbine, above, events):
    fastest = np.full(1000, 1.09)
    fastest[list(above)] = 1.11
    run["rotor_speed_max"][:] = fastest * turbine.drivetrain.rated_rotor_speed
    assert run_metrics(run, turbine)["overspeed_count"] == events


SHOWN = {
    "MW": 1e-6, "MWh": 1 / 3.6e9, "rpm": 30 / np.pi, "MN m": 1e-6, "kN m/s": 1e-3, "deg": 180 / np.pi, "%": 100.0,
    "kW": 1e-3, "m": 1.0, "-": 1.0,
}  # fmt: skip
NO_SENSE = {"rotor_speed_mean", "saturated_share", "demanded_energy", "platform_pitch_mean"}
MORE_IS_BETTER = {"mean_power", "corrected_power", "energy", "tip_clearance_min"}


def test_every_metric_is_shown_in_its_unit_and_has_its_sense():
    for name, metric in METRICS.items():
        assert metric.factor == pytest.approx(SHOWN[metric.unit], rel=1e-12)
        assert metric.better == (1 if name in MORE_IS_BETTER else 0 if name in NO_SENSE else -1), name


@pytest.mark.parametrize("angle", [0.3, 4.0])
def test_the_worst_direction_of_the_tower_turns_with_the_world(run, turbine, angle):
    along = run["tower_base_moment_y"].values
    run["yaw"][:] = angle
    run["tower_base_moment_x"][:], run["tower_base_moment_y"][:] = -np.sin(angle) * along, np.cos(angle) * along
    metrics = run_metrics(run, turbine)
    assert metrics["tower_del"] == pytest.approx(metrics["tower_fore_aft_del"])


def test_a_moment_that_turns_with_the_nacelle_wears_the_tower(run, turbine):
    """Constant in the axes of the nacelle, and a full cycle for every point of the wall in a turn of the world."""
    turn = 2.0 * np.pi * np.arange(1000) / 1000
    run["yaw"][:], run["tower_base_fore_aft_moment"][:] = turn, 50e6
    run["tower_base_moment_x"][:], run["tower_base_moment_y"][:] = -50e6 * np.sin(turn), 50e6 * np.cos(turn)
    metrics = run_metrics(run, turbine)
    assert metrics["tower_fore_aft_del"] == 0.0
    assert metrics["tower_del"] == pytest.approx(100e6 * (1.0 / 100.0) ** 0.25, rel=0.01)


def test_power_out_of_the_rotor_is_no_power(run, turbine):
    # 2 MW are taken from 300 MJ of kinetic energy and from nowhere else
    energy = 3e8 - 2e6 * run["time"].values
    run["rotor_speed"][:] = np.sqrt(2.0 * energy / rotor_inertia(turbine))
    for skip in (0.0, 10.0):
        metrics = run_metrics(run, turbine, skip)
        assert metrics["mean_power"] == 2e6
        assert metrics["corrected_power"] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(("n_slow", "skip", "time"), [(100, 10.0, 90.0), (1, 0.0, 99.9)])
def test_kinetic_energy_counts_from_the_state_before_the_first_step(run, turbine, n_slow, skip, time):
    """Slow until the start of the first step that is measured, or in the first sample where nothing is before."""
    run["generator_power"][: round(10.0 * skip)] = 0.0  # the skipped start does not count
    run["rotor_speed"][:] = np.where(np.arange(1000) < n_slow, 1.0, 1.2)
    gained = 0.5 * rotor_inertia(turbine) * (1.2**2 - 1.0**2)
    assert run_metrics(run, turbine, skip)["corrected_power"] == pytest.approx(2e6 + gained / time, rel=1e-12)


def test_uneven_or_empty_runs_are_refused(run, turbine):
    with pytest.raises(ValueError, match=r"at least two samples after the first 99.9 s, got 1"):
        run_metrics(run, turbine, skip=99.9)
    assert run_metrics(run, turbine, skip=99.8)["energy"] == pytest.approx(2e6 * 0.2)
    with pytest.raises(ValueError, match="evenly"):
        run_metrics(run.isel(time=[0, 1, 5]), turbine)


def test_spectrum_holds_the_variance_at_the_right_frequency():
    step, amplitude, frequency = 0.05, 3.0, 0.5
    time = np.arange(0.0, 600.0, step)
    f, density = power_spectral_density(2.0 + amplitude * np.sin(2 * np.pi * frequency * time), step)
    assert f[np.argmax(density)] == pytest.approx(frequency)
    assert np.trapezoid(density, f) == pytest.approx(amplitude**2 / 2, rel=1e-3)
    with pytest.raises(ValueError, match="at least 8 samples"):
        power_spectral_density(np.zeros(7), step)
    with pytest.raises(ValueError, match="a positive time step"):
        power_spectral_density(np.zeros(8), 0.0)
    assert power_spectral_density(np.zeros(8), step)[0] == pytest.approx(np.arange(1, 5) / (8 * step))
    assert power_spectral_density(np.zeros(100), step, 0.1)[0][0] == pytest.approx(1 / (8 * step))  # 8 samples at least
