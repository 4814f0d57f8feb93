"""Linear optimal pitch: identification, least squares, offsets, files and the controller, against what is exact."""

import copy
import json
import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from wt_gym.analysis.metrics import FLOATING_COST_WEIGHTS, LIFETIME_COST_WEIGHTS
from wt_gym.analysis.results import Wind
from wt_gym.base.errors import ControllerError
from wt_gym.commands import run as run_command
from wt_gym.control import Demand
from wt_gym.control.controllers import Combined, FadeParameters, make_controller
from wt_gym.control.controllers.controller import memory_of, remember
from wt_gym.control.controllers.linear_optimal import (
    MOTION_CORNER,
    SHIPPED,
    LinearDesign,
    LinearOptimalPitch,
    LoadObserver,
    ModelFit,
    PitchOffsets,
    bin_means,
    channels_read,
    default_limits,
    delay_bins,
    load_design,
    measured_outputs,
    recorded_outputs,
    save_design,
    spread_over_bins,
    without_lasting,
)
from wt_gym.control.design import platform_pitch_frequency
from wt_gym.control.sensors import to_blades, to_fixed_frame
from wt_gym.experiment.benchmark_tasks import load_task
from wt_gym.experiment.comparison import inflow_of
from wt_gym.experiment.run import benchmark_metrics, run_controller
from wt_gym.learning import linear_design as designing
from wt_gym.learning.linear_design import (
    Plant,
    curvature_of_power,
    design,
    fit_feedback,
    forecast,
    forecast_change,
    minimize_quadratic,
    n_read,
)
from wt_gym.learning.options import Excitation, FeedbackOptions, LinearDesignTask, design_task
from wt_gym.learning.recording import Recording, RecordingStore, explained_share, identify, respond, sea_of_training
from wt_gym.simulation import Simulator
from wt_gym.simulation.drivetrain.drives import pitch_delay
from wt_gym.turbines import load_turbine
from wt_gym.turbines.variants import mirrored

DT = 0.1
SPEED = 12.1 * math.pi / 30


# ---------------------------------------------------------------- identification


def test_identification_finds_an_impulse_response_exactly():
    rng = np.random.default_rng(0)
    truth = rng.normal(size=(2, 3, 8)) * np.exp(-np.arange(8) / 3.0)
    inputs = [rng.normal(size=(3, 60)), rng.normal(size=(3, 45))]
    changes = [respond(truth, given) for given in inputs]
    found = identify(inputs, changes, taps=8)
    np.testing.assert_allclose(found, truth, atol=1e-10)
    delayed = respond(np.array([[[2.0, 3.0]]]), np.array([[1.0, 10.0, 100.0]]))
    np.testing.assert_allclose(delayed, [[0.0, 2.0, 23.0, 230.0]], atol=1e-12)
    unseen = [rng.normal(size=(3, 50))]
    np.testing.assert_allclose(explained_share(found, unseen, [respond(truth, unseen[0])]), 1.0)


def test_share_explained_falls_with_noise():
    rng = np.random.default_rng(1)
    truth, given = np.array([[[1.0, 0.5]]]), rng.normal(size=(1, 4000))
    clean = respond(truth, given)
    noisy = clean + rng.normal(size=clean.shape) * clean.std()
    assert explained_share(truth, [given], [noisy])[0] == pytest.approx(0.5, abs=0.05)


def test_ridge_shrinks_late_taps_more():
    rng = np.random.default_rng(2)
    given = [rng.normal(size=(1, 400))]
    changes = [respond(np.ones((1, 1, 20)), given[0])]
    found = identify(given, changes, 20, ridge=1.0, decay=4.0)[0, 0]
    assert found[:5].mean() > found[-5:].mean() + 0.1


@pytest.mark.parametrize(
    ("inputs", "changes", "taps", "message"),
    [
        (np.ones((1, 5)), np.ones((1, 6)), 9, "samples"),
        (np.zeros((1, 5)), np.ones((1, 6)), 2, "move"),
        (np.full((1, 5), np.nan), np.ones((1, 6)), 2, "finite"),
    ],
)
def test_identification_refuses(inputs, changes, taps, message):
    with pytest.raises(ValueError, match=message):
        identify([inputs], [changes], taps)


# ---------------------------------------------------------------- least squares


def test_least_squares_are_the_finite_horizon_optimum():
    """X' = a x + b u + w from rest, cost sum q x^2 + r u^2, w known: Riccati's recursion with its affine part."""
    a, b, q, r, n = 0.9, 0.4, 2.0, 0.3, 40
    wind = np.random.default_rng(3).normal(size=n)
    undisturbed = np.zeros(n + 1)
    for k in range(n):
        undisturbed[k + 1] = a * undisturbed[k] + wind[k]
    response = (b * a ** np.arange(n))[None, None]
    columns = np.stack([respond(response, np.eye(n)[k : k + 1])[0] for k in range(n)])
    rows = [(math.sqrt(q) * columns, math.sqrt(q) * undisturbed), (math.sqrt(r) * np.eye(n), np.zeros(n))]
    found = minimize_quadratic(rows)

    curvature, slope, gains = q, 0.0, []
    for k in reversed(range(n)):  # value x^2 curvature + 2 x slope
        weight = r + b * b * curvature
        gains.append((b * curvature * a / weight, b * (curvature * wind[k] + slope) / weight))
        closed = a - b * gains[-1][0]
        slope = closed * (curvature * wind[k] + slope)
        curvature = q + a * curvature * closed
    state, expected = 0.0, []
    for k, (of_state, constant) in enumerate(reversed(gains)):
        expected.append(-of_state * state - constant)
        state = a * state + b * expected[-1] + wind[k]
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-8)
    linear = minimize_quadratic([(np.eye(2), np.zeros(2))], linear=np.array([2.0, -4.0]))
    np.testing.assert_allclose(linear, [-1.0, 2.0], rtol=1e-9)


def toy_recording(seed, offsets=None, n=900):
    """A run of a linear plant with slow and once-per-revolution disturbances, as the simulator would record it."""
    rng = np.random.default_rng(seed)
    smooth = np.exp(-np.arange(200) * DT / 1.0)
    rough = rng.normal(size=(6, n + 200))
    found = np.stack([np.convolve(row, smooth, "valid") for row in rough])[:, : n + 1]
    outputs = found * np.array([3e5, 3e5, 3e5, 0.02, 0.02, 0.003])[:, None] + np.array([[6e6, 1e6, 0, 0, 0, SPEED]]).T
    loads = np.stack([1e7 + 8e6 * found[0], 2e6 * found[4], np.full(n + 1, 5e6)])
    given = np.zeros((3, n)) if offsets is None else offsets
    both = np.concatenate([outputs, loads]) + respond(TOY, given)
    azimuth = np.arange(n + 1) * DT * SPEED
    angles = azimuth + 2.0 * np.pi / 3.0 * np.arange(3)[:, None]
    flap = both[0] + both[1] * np.cos(angles) + both[2] * np.sin(angles)
    pitch = 0.1 + 0.02 * np.sin(0.1 * azimuth) * np.ones((3, 1))
    return Recording(DT, both[:6], both[6:], flap, 0.0 * flap, pitch, azimuth, given, np.ones(n))


def test_a_design_keeps_the_limit_of_power_in_its_forecast(turbine, toy_runs, monkeypatch):
    """Power that only the square of offsets takes: the cost of power rises until the forecast keeps the limit."""
    found = designing.identified_plant

    def costly(*given):
        plant, explained = found(*given)
        responses = plant.responses.copy()
        responses[8] = 0.0
        return replace(plant, responses=responses, power_curvature=20.0), explained

    monkeypatch.setattr(designing, "identified_plant", costly)

    def made(least):
        task = LinearDesignTask(speeds=(15.0,), excited=2, ridge=0.0, least_power=least, **TOY_TASK)
        return design(turbine, task).record["speeds"][0]

    free = made(-1.0)
    taken = free["forecast"]["captured_power"]
    assert free["power_weight"] == 1.0
    assert taken < -1e-4
    held = made(0.5 * taken)
    assert held["power_weight"] > 1.0
    assert 0.5 * taken <= held["forecast"]["captured_power"] < 0.0
    with pytest.raises(ValueError, match="keep power above"):
        made(0.0)


TOY = np.array([3e3, 3e3, 3e3, 1e-4, 1e-4, 1e-5, 1e4, 1e4, 1e3])[:, None, None] * np.ones((1, 3, 30))
TOY[0, 0] = TOY[1, 1] = TOY[2, 2] = -2e7 * np.exp(-np.arange(30) / 3.0)
TOY[6, 0] = -8e7 * np.exp(-np.arange(30) / 5.0)
TOY[5, 0] = -0.01


def test_feedback_lowers_the_cost_of_runs_that_it_has_not_seen(turbine):
    options = FeedbackOptions(skip=5.0, longest=5.0)
    runs = [toy_recording(seed) for seed in (1, 2, 3)]
    scale = np.mean([run.outputs.std(1) for run in runs], axis=0)
    plant = Plant(TOY, scale, 0.0, pitch_delay(turbine.pitch, DT), DT)
    gains, _ = fit_feedback(runs[:2], plant, turbine, options)
    assert gains.shape == (3, 6, 50)
    run, bins_total = runs[2], gains.shape[-1]
    past = np.stack([
        row if k in (1, 2) else without_lasting(row, options.washout, DT)
        for k, row in enumerate(run.outputs[:, :-1] / scale[:, None])
    ])  # fmt: skip
    padded = np.concatenate([np.repeat(past[:, :1], bins_total - 1, axis=1), past], axis=1)
    offsets = np.stack([
        sum(np.convolve(padded[k], gains[j, k], "valid") for k in range(6)) for j in range(3)
    ])  # fmt: skip
    before, now = (
        forecast(run, plant, given).metrics(DT, turbine.pitch.max_rate, 5.0) for given in (0.0 * offsets, offsets)
    )
    assert now["blade_flap_del"] < 0.9 * before["blade_flap_del"]
    assert forecast_change(now, before, options.weights) < -0.02


def test_feedback_steadies_a_platform_by_the_rate_of_its_pitch(turbine):
    """The mean offset turns a platform that swings with a period of 8 s; its swing costs by a weight of its own."""
    answer = -0.5 * np.exp(-np.arange(30) / 10.0)
    responses = np.concatenate([TOY[:6], np.zeros((2, 3, 30)), TOY[6:], np.zeros((1, 3, 30))])
    responses[9 + 2, 0], responses[6, 0] = answer, np.diff(answer, prepend=0.0) / DT
    run = toy_recording(1)
    swing = 0.02 * np.sin(2.0 * np.pi / 8.0 * DT * np.arange(run.steps + 1))
    rates = np.stack([np.gradient(swing, DT), 1e-3 * run.outputs[1] / 1e6])
    floating = replace(
        run, outputs=np.concatenate([run.outputs, rates]), loads=np.concatenate([run.loads, swing[None]])
    )
    plant = Plant(responses, floating.outputs.std(1), 0.0, pitch_delay(turbine.pitch, DT), DT)
    swings = []
    for weights in (LIFETIME_COST_WEIGHTS, FLOATING_COST_WEIGHTS):
        options = FeedbackOptions(skip=5.0, longest=5.0, weights=weights)
        gains, (offsets,) = fit_feedback([floating], plant, turbine, options)
        now = forecast(floating, plant, offsets)
        expected = swing + np.concatenate([[0.0], np.convolve(answer, offsets[0])[: run.steps]])
        np.testing.assert_allclose(now.platform[0], expected, atol=1e-12)
        swings.append(now.metrics(DT, turbine.pitch.max_rate, 5.0)["platform_pitch_std"])
    assert gains.shape == (3, 8, 50)
    assert gains[0, 6].any()
    assert swings[1] < 0.8 * swing[50:].std()
    assert swings[1] < 0.9 * swings[0]


@pytest.mark.parametrize(
    ("option", "curvature", "metric", "most"),
    [({"travel_weight": 5.0}, 0.0, "pitch_duty_cycle", 0.9), ({}, 300.0, "size", 0.8)],
)
def test_a_heavier_cost_of_travel_and_power_that_offsets_take_hold_them_back(turbine, option, curvature, metric, most):
    run, found = toy_recording(1), []
    for options, cost in (({}, 0.0), (option, curvature)):
        plant = Plant(TOY, run.outputs.std(1), cost, pitch_delay(turbine.pitch, DT), DT)
        _, (offsets,) = fit_feedback([run], plant, turbine, FeedbackOptions(skip=5.0, longest=5.0, **options))
        metrics = forecast(run, plant, offsets).metrics(DT, 0.14, 5.0) | {"size": offsets.std()}
        found.append(metrics[metric])
    assert found[1] < most * found[0]


def test_curvature_of_power_is_what_the_linear_model_leaves():
    offsets, responses = [np.full((3, 100), 0.02)], np.full((1, 3, 1), 1e4)
    linear, lost = respond(responses, offsets[0]), 5e6 * 7.0 * 3 * 0.02**2
    assert curvature_of_power(responses, 0, 1.0, offsets, [linear - lost], 5e6) == pytest.approx(7.0)
    assert curvature_of_power(responses, 0, 1.0, offsets, [linear + 1.0], 5e6) == 0.0
    assert curvature_of_power(responses, 0, 0.1, offsets, [linear - linear.mean() - lost], 5e6) == pytest.approx(7.0)
    assert not responses.any()


# ---------------------------------------------------------------- the past


def test_bins_cover_every_delay_once_and_widen():
    bins = delay_bins(15.0, DT)
    assert [bins[0][0], bins[-1][1]] == [0, 150]
    assert all(a[1] == b[0] for a, b in pairwise(bins))
    widths = [last - first for first, last in bins]
    assert widths[:6] == [1] * 6
    assert max(widths) > 10


def test_bin_means_and_spread_coefficients_are_the_same_filter():
    series, bins = np.random.default_rng(4).normal(size=80), delay_bins(2.0, DT)
    coefficients = np.random.default_rng(5).normal(size=len(bins))
    padded = np.concatenate([np.full(19, series[0]), series])
    expected = np.convolve(padded, spread_over_bins(coefficients, bins), "valid")
    np.testing.assert_allclose(coefficients @ bin_means(series, bins), expected, atol=1e-12)


def test_what_lasts_is_taken_off():
    steady = without_lasting(np.full(50, 3.0), 10.0, DT)
    np.testing.assert_allclose(steady, 0.0, atol=1e-12)
    step = without_lasting(np.concatenate([[0.0], np.ones(2000)]), 10.0, DT)
    assert step[1] == pytest.approx(math.exp(-0.01))
    assert abs(step[-1]) < 1e-6


# ---------------------------------------------------------------- offsets and readings


def above_rated(pitch=0.2):
    return Demand(np.full(3, pitch), 0.0, 43_093.5)


def test_offsets_that_reach_the_drives_are_given_back(turbine):
    offsets = PitchOffsets(turbine, math.radians(4.0), math.radians(3.0), False)
    demand = above_rated()
    for _ in range(20):
        changed = offsets.added((0.01, -0.02, 0.03), demand, 0.7, SPEED, DT)
    ahead = 0.7 + SPEED * pitch_delay(turbine.pitch, DT)
    np.testing.assert_allclose(to_fixed_frame(changed.pitch - demand.pitch, ahead), (0.01, -0.02, 0.03), atol=1e-12)
    np.testing.assert_allclose(offsets.acting, (0.01, -0.02, 0.03), atol=1e-12)
    assert demand.pitch.tolist() == [0.2, 0.2, 0.2]


def test_offsets_keep_size_and_rate(turbine):
    limit, rate = math.radians(4.0), math.radians(3.0)
    offsets = PitchOffsets(turbine, limit, rate, False)
    rows = [np.zeros(3)]
    for _ in range(40):
        offsets.added((1.0, 1.0, -1.0), above_rated(), 0.0, SPEED, DT)
        rows.append(np.array(offsets.acting))
    moves = np.diff(rows, axis=0)
    assert max(abs(moves[:, 0]).max(), np.hypot(*moves[:, 1:].T).max()) < rate * DT * 1.000001
    assert (rows[-1][0], np.hypot(*rows[-1][1:])) == pytest.approx((limit, limit))


def test_no_blade_is_pitched_below_its_range(turbine):
    offsets = PitchOffsets(turbine, 0.05, 10.0, False)
    changed = offsets.added((0.0, 0.05, 0.0), above_rated(turbine.pitch.min_pitch), 0.0, SPEED, DT)
    assert changed.pitch.min() == turbine.pitch.min_pitch
    assert offsets.acting[0] > 0.005  # the mean that is left is known
    assert offsets.acting[1] < 0.05


def test_at_fine_pitch_offsets_act_near_rated_speed_alone(turbine):
    fade = made_design(fine_speed=(0.9, 1.0)).fading
    offsets = PitchOffsets(turbine, 0.05, 10.0, fade)
    rated = turbine.drivetrain.rated_rotor_speed
    for ratio, share in ((0.85, 0.0), (0.95, 0.5), (1.0, 1.0), (1.1, 1.0)):
        assert offsets.update_share(above_rated(0.0), ratio * rated, DT) == pytest.approx(share)
    pitched = PitchOffsets(turbine, 0.05, 10.0, fade)  # where the blades are pitched, it is as without
    plain = PitchOffsets(turbine, 0.05, 10.0, 0.05)
    for ratio in (0.8, 0.9, 0.95):
        shares = [one.update_share(above_rated(0.1), ratio * rated, DT) for one in (pitched, plain)]
        assert shares[0] == shares[1]


def test_outputs_of_records_and_of_signals_agree():
    rng = np.random.default_rng(6)
    channels = {name: rng.normal(size=7) for name in channels_read(3)}
    recorded = recorded_outputs(channels, 3, -1.0)
    for k in range(7):
        out = np.zeros(6)
        measured_outputs({name: float(values[k]) for name, values in channels.items()}, 3, -1.0, out)
        np.testing.assert_allclose(recorded[:, k], out, atol=1e-14)
    np.testing.assert_array_equal(recorded[4], -channels["nacelle_acceleration_side_side"])


def test_rates_of_a_platform_are_read_in_the_axes_of_the_nacelle():
    """A nacelle that has turned by 90° pitches as the platform rolls, whichever way the rotor turns."""
    rng = np.random.default_rng(6)
    channels = {name: rng.normal(size=7) for name in channels_read(3, 9)}
    recorded = recorded_outputs(channels, 3, -1.0, 9)
    assert channels_read(3, 6) == channels_read(3)
    for k in range(7):
        out = np.zeros(9)
        measured_outputs({name: float(values[k]) for name, values in channels.items()}, 3, -1.0, out)
        np.testing.assert_allclose(recorded[:, k], out, atol=1e-14)
    turned = recorded_outputs(channels | {"yaw": np.full(7, np.pi / 2.0)}, 3, -1.0, 9)
    np.testing.assert_allclose(turned[6], -channels["platform_roll_rate"], atol=1e-15)
    np.testing.assert_allclose(turned[7], -channels["platform_pitch_rate"], atol=1e-15)
    np.testing.assert_array_equal(recorded[8], channels["wave_elevation"])


def test_drawn_offsets_are_held_and_reproducible():
    excitation = Excitation()
    levels = excitation.draw(3000, DT, 5)
    np.testing.assert_array_equal(levels, excitation.draw(3000, DT, 5))
    assert 0.9 * excitation.mean < abs(levels[0]).max() <= excitation.mean
    changes = np.flatnonzero(np.diff(levels[1])) + 1
    assert np.diff(changes).min() >= 2
    assert np.diff(changes).max() <= 50


# ---------------------------------------------------------------- file


def made_design(seed=7, knots=(0.1, 0.2), **changes):
    rng, n = np.random.default_rng(seed), len(knots)
    arguments = {
        "pitch": np.array(knots), "responses": rng.normal(size=(n, 6, 3, 12)).astype(np.float32),
        "gains": 1e-3 * rng.normal(size=(n, 3, 6, 9)).astype(np.float32),
        "scale": np.array([1e6, 1e6, 1e6, 0.1, 0.1, 0.03]), "washout": np.array([30.0, 0.0, 0.0, 30.0, 30.0, 30.0]),
        "loads": 1e8 * rng.normal(size=(n, 2, 3, np.shape(changes.get("responses", np.zeros(12)))[-1])),
        "interval": DT, "limit": 0.07, "rate_limit": 0.05, "fade": 0.05,
        "record": {"turbine": "NREL", "speeds": [1, 2]},
    }  # fmt: skip
    return LinearDesign(**arguments | changes)


def free_design(**changes):
    """Feedback alone, hardly limited in rate."""
    changes = {"knots": (0.15,), "responses": np.zeros((1, 6, 3, 12)), "rate_limit": 100.0} | changes
    return made_design(**changes)


def test_a_design_comes_back_from_its_file(tmp_path):
    design, path = made_design(), tmp_path / "design.npz"
    save_design(design, path)
    found = load_design(path)
    for name in ("pitch", "responses", "gains", "scale", "washout", "loads"):
        np.testing.assert_allclose(getattr(found, name), getattr(design, name), rtol=1e-7)
    assert (found.interval, found.limit, found.rate_limit, found.fade) == (DT, 0.07, 0.05, 0.05)
    assert found.record == design.record
    assert found.fine_speed is None
    save_design(made_design(fine_speed=(0.95, 1.0)), path)
    assert load_design(path).fading == FadeParameters((0.05 / 6.0, 0.05), fine_speed=(0.95, 1.0))
    assert copy.deepcopy(found) is found
    with pytest.raises(ValueError, match="read-only"):
        found.gains[0] = 0.0


@pytest.mark.parametrize(
    "wrong",
    [
        {"gains": np.zeros((2, 3, 5, 9))},
        {"responses": np.zeros((1, 6, 3, 12))},
        {"pitch": np.array([0.2, 0.1])},
        {"scale": np.zeros(6)},
        {"interval": 0.0},
        {"limit": math.nan},
        {"fine_speed": (1.0, 0.9)},
        {"washout": np.full(6, np.inf)},
        {"loads": np.zeros((2, 2, 3, 11))},
        {"loads": np.full((2, 2, 3, 12), np.nan)},
    ],
)
def test_a_design_refuses(wrong):
    with pytest.raises(ControllerError, match=next(iter(wrong))):
        made_design(**wrong)


def test_a_design_that_reads_a_platform_is_for_a_floating_turbine(turbine):
    eight = {"responses": np.zeros((1, 8, 3, 12)), "gains": np.zeros((1, 3, 8, 9)), "scale": np.ones(8)}
    design = made_design(knots=(0.15,), washout=np.zeros(8), **eight)
    assert design.outputs[6:] == ("platform_pitch_rate", "platform_roll_rate")
    with pytest.raises(ControllerError, match="floating turbine"):
        LoadObserver(turbine, design)
    observer = LoadObserver(load_turbine("oc4_nrel_5mw"), design)
    assert {"platform_pitch_rate", "platform_roll_rate", "yaw"} <= set(observer.channels)
    assert "wave_elevation" not in observer.channels


def test_files_that_are_no_designs(tmp_path):
    path = tmp_path / "some.npz"
    with pytest.raises(FileNotFoundError, match="wt-gym design"):
        load_design(path)
    path.write_text("no archive")
    with pytest.raises(ControllerError, match="must be a design"):
        load_design(path)
    np.savez(path, head=np.array({"format": 1}, dtype=object))
    with pytest.raises(ControllerError, match="must be a design"):
        load_design(path)
    save_design(made_design(), path)
    with np.load(path) as found:
        arrays = dict(found)
    arrays["head"] = np.array(str(arrays["head"]).replace('"format": 3', '"format": 99'))
    np.savez(path, **arrays)
    with pytest.raises(ControllerError, match="format 3, got 99"):
        load_design(path)


# ---------------------------------------------------------------- controller


def signals_of(outputs, azimuth, sign=1.0):
    """Readings whose fixed-frame outputs are these."""
    angles = azimuth + 2.0 * np.pi / 3.0 * np.arange(3)
    flap = outputs[0] + outputs[1] * np.cos(angles) + outputs[2] * np.sin(angles)
    return {
        "azimuth": azimuth,
        "rotor_speed": float(outputs[5]),
        "nacelle_acceleration_fore_aft": float(outputs[3]),
        "nacelle_acceleration_side_side": sign * float(outputs[4]),
        **{f"root_flap_moment_{b + 1}": float(flap[b]) for b in range(3)},
    }


NONE = np.zeros((6, 3, 12))
"""Responses of outputs that no offset moves."""


def driven(controller, disturbances, responses, dt=DT, every=1, sign=1.0, drawn=None):
    """Offsets that act (3, n), disturbances that a controller finds (6, n), and what it shows before each step.

    Outputs are disturbances (6, n) and what the offsets do; those ``drawn`` (3, n) are of an agent, as it is told.
    """
    n = disturbances.shape[1]
    acting, found, shown = np.zeros((3, n)), [], []
    controller.start(signals_of(disturbances[:, 0], 0.0, sign))
    for k in range(n):
        y = disturbances[:, k] + respond(responses, acting)[:, k]
        for part in range(every):
            signals = signals_of(y, (k + part / every) * DT * SPEED, sign) | {"pitch": np.full(3, 0.15)}
            shown.append(controller.known(signals))
            base = controller.step(signals, dt, above_rated(0.15))
            acting[:, k] += np.array(controller.offsets.acting) / every
        if drawn is not None:
            ahead = signals["azimuth"] + signals["rotor_speed"] * pitch_delay(controller.offsets.drive, DT)
            pitch = base.pitch + np.array(to_blades(drawn[:, k].tolist(), ahead, 3))
            controller.see_demand(base, Demand(pitch, 0.0, base.generator_torque), signals, DT)
            acting[:, k] += drawn[:, k]
        found.append(controller.disturbance.copy())
    return acting, np.array(found).T, np.array(shown)


def drawn_disturbances(n=120):
    mean = np.array([6e6, 1e6, -5e5, 0.05, -0.02, SPEED])
    size = np.array([3e5, 3e5, 3e5, 0.05, 0.05, 0.003])
    return mean[:, None] + size[:, None] * np.random.default_rng(8).normal(size=(6, n))


def driven_with_an_agent(turbine, told=True, n=120):
    """Controller, disturbances and those that it finds over their scale, what it shows, and what acts with an agent."""
    design = made_design(knots=(0.15,))
    responses = design.responses[0] * design.scale[:, None, None] * 0.1
    design = made_design(knots=(0.15,), responses=responses[None] / design.scale[:, None, None])
    controller, wanted = LinearOptimalPitch(turbine, design), drawn_disturbances(n)
    drawn = np.radians(1.0) * np.random.default_rng(9).uniform(-1.0, 1.0, (3, n))
    if not told:
        controller.see_demand = lambda *_: None
    acting, found, shown = driven(controller, wanted, responses, drawn=drawn)
    return controller, wanted / design.scale[:, None], found / design.scale[:, None], shown, acting


def test_what_neither_the_model_nor_an_agent_explains_is_the_disturbance(turbine):
    controller, wanted, found, *_ = driven_with_an_agent(turbine)
    np.testing.assert_allclose(found, wanted, atol=1e-6)
    _, _, untold, *_ = driven_with_an_agent(turbine, told=False)
    assert np.abs(untold - wanted).max() > 0.01
    before = memory_of(controller).values
    controller.known(signals_of(drawn_disturbances(1)[:, 0], 1.0))  # looking changes nothing
    np.testing.assert_array_equal(memory_of(controller).values, before)


def test_what_an_agent_sees_is_the_past_with_the_present_instant(turbine):
    controller, wanted, _, seen, _ = driven_with_an_agent(turbine)
    design, bins = controller.design, controller.bins
    assert bins[0] == (0, 1)
    assert bins[-1][1] == design.gains.shape[-1]
    past = np.stack([without_lasting(row, tau, DT) for row, tau in zip(wanted, design.washout, strict=True)])
    expected = np.stack([bin_means(row, bins) for row in past])  # of a past that stood still before
    started = design.gains.shape[-1]
    expected[:, 1:] = expected[:, :-1] - expected[:, 1:]
    shown = seen[:, : 6 * len(bins)].reshape(-1, 6, len(bins)).transpose(1, 2, 0)
    np.testing.assert_allclose(shown[..., started:], expected[..., started:], atol=1e-6)
    np.testing.assert_allclose(seen[:, -24:-22], [[1.0, 0.15]] * len(seen), atol=0.01)


def test_an_agent_sees_how_the_model_fits(turbine):
    """The fit of what the controller finds to what its model explains, up to the last step."""
    controller, _, found, seen, acting = driven_with_an_agent(turbine)
    design = controller.design
    explained = respond(design.responses[0], acting)
    fit = ModelFit(6, DT)
    for k in range(found.shape[1]):
        np.testing.assert_allclose(seen[k, -22:-10], fit.values, atol=1e-6)
        fit.update(found[:, k], explained[:, k], int(k > 0))
    assert np.abs(fit.values).max() > 0.1


def test_an_agent_sees_what_offsets_did_and_how_the_tower_moves(turbine):
    """Its own response by the model, and velocity and displacement of a tower that swings for a while."""
    controller, _, _, seen, acting = driven_with_an_agent(turbine)
    explained = respond(controller.design.responses[0], acting)[:, : len(seen)]
    np.testing.assert_allclose(seen[:, -10:-4], explained.T, atol=1e-6)
    frequency, dt, outputs = 1j * controller.natural, 0.01, np.array([6e6, 0.0, 0.0, 0.0, 0.0, SPEED])
    integrator = frequency / (frequency + MOTION_CORNER * controller.natural) ** 2
    controller.start(signals_of(outputs, 0.0))
    for k in range(6000):
        swing = np.exp(frequency * k * dt) * (0.3, 0.1)
        outputs[3:5] = swing.imag
        controller.step(signals_of(outputs, 0.0), dt, above_rated())
    shown = controller.known(signals_of(outputs, 0.0) | {"pitch": np.full(3, 0.2)})[-4:]
    velocity = integrator * swing
    np.testing.assert_allclose(shown, np.concatenate([velocity, integrator * velocity]).imag, atol=2e-3)
    assert (np.abs(velocity) > 0.9 * np.array([0.3, 0.1]) / controller.natural).all()


def test_offsets_are_the_filtered_past_times_the_gains(turbine):
    design, wanted = free_design(limit=3.0), drawn_disturbances()
    acting, *_ = driven(LinearOptimalPitch(turbine, design, gain=0.5), wanted, NONE)
    scaled = wanted / design.scale[:, None]
    past = np.stack([without_lasting(row, tau, DT) for row, tau in zip(scaled, design.washout, strict=True)])
    padded = np.concatenate([np.repeat(past[:, :1], 8, axis=1), past], axis=1)
    for j in range(3):
        expected = 0.5 * sum(np.convolve(padded[k], design.gains[0, j, k], "valid") for k in range(6))
        np.testing.assert_allclose(acting[j], expected, atol=1e-10)


def test_designs_are_blended_by_the_slow_pitch(turbine):
    both = made_design(knots=(0.1, 0.3), responses=np.zeros((2, 6, 3, 12)), rate_limit=100.0)
    designs = [both, *(free_design(gains=both.gains[k : k + 1]) for k in range(2))]
    first = [driven(LinearOptimalPitch(turbine, one), drawn_disturbances(3), NONE)[0][:, 0] for one in designs]
    np.testing.assert_allclose(first[0], 0.75 * first[1] + 0.25 * first[2], atol=1e-12)


def test_a_finer_step_decides_as_often(turbine):
    coarse, *_ = driven(LinearOptimalPitch(turbine, free_design()), drawn_disturbances(), NONE)
    fine, *_ = driven(LinearOptimalPitch(turbine, free_design()), drawn_disturbances(), NONE, DT / 2, 2)
    np.testing.assert_allclose(fine, coarse, atol=1e-12)


def test_a_coarser_step_keeps_the_time(turbine):
    """Disturbances that are held as long as the step: what is decided is the same."""
    design, wanted = free_design(), drawn_disturbances(40)
    washed = design.washout > 0.0  # the low-pass of a held signal is the same only at the end of a step
    only = np.where(washed[:, None], wanted[:, :1], wanted)
    fine, *_ = driven(LinearOptimalPitch(turbine, design), np.repeat(only, 2, axis=1), NONE)
    coarse, *_ = driven(LinearOptimalPitch(turbine, design), only, NONE, 2 * DT)
    np.testing.assert_allclose(coarse, fine[:, ::2], atol=1e-12)


@pytest.mark.parametrize("dt", [0.4, 0.07, 5.0])
def test_any_step_will_do(turbine, dt):
    controller = LinearOptimalPitch(turbine, made_design())
    wanted = drawn_disturbances()
    controller.start(signals_of(wanted[:, 0], 0.0))
    pitch = [controller.step(signals_of(wanted[:, k], k * dt), dt, above_rated()).pitch for k in range(60)]
    assert np.isfinite(pitch).all()
    assert np.ptp(pitch) > 1e-4


def test_a_memory_goes_on_alike(turbine):
    design, wanted = made_design(), drawn_disturbances()
    controller = Combined(make_controller("discon", turbine), LinearOptimalPitch(turbine, design))
    more = {"generator_speed": SPEED * 97, "generator_torque": 43_093.5}

    def pitches(first, last):
        return [controller.step(signals_of(wanted[:, k], 0.1 * k) | more, DT).pitch for k in range(first, last)]

    controller.start(signals_of(wanted[:, 0], 0.0) | more, above_rated())
    pitches(0, 60)
    memory = memory_of(controller)
    after = pitches(60, 80)
    remember(controller, memory, np.ones(len(memory.sizes), dtype=bool))
    np.testing.assert_array_equal(after, pitches(60, 80))
    assert memory.values.size < design.gains.size + design.responses.size  # what never changes is no memory


def test_the_mirror_image_is_pitched_alike(turbine):
    one, image = (
        driven(LinearOptimalPitch(side, made_design(knots=(0.15,))), drawn_disturbances(), NONE, sign=sign)[0]
        for side, sign in ((turbine, 1.0), (mirrored(turbine), -1.0))
    )
    np.testing.assert_allclose(image, one, atol=1e-12)


def test_names_and_files_of_the_catalog(turbine, tmp_path):
    path = tmp_path / "mine.npz"
    save_design(made_design(), path)
    controller = make_controller(f"linear_optimal:file={path},gain=0.5", turbine)
    assert [type(part).__name__ for part in controller.additions] == ["SideSideDamper", "LinearOptimalPitch"]
    assert controller.additions[1].gain == 0.5
    assert "root_flap_moment_1" in controller.channels
    with pytest.raises(ValueError, match="wt-gym design"):
        make_controller("linear_optimal", load_turbine("nada_small"))
    make_controller("linear_optimal", mirrored(turbine))
    with pytest.raises(FileNotFoundError, match="no design"):
        make_controller("linear_optimal:file=nowhere.npz", turbine)


@pytest.mark.parametrize("name", SHIPPED)
def test_offsets_by_default_are_within_what_the_drives_of_a_turbine_can_follow(name):
    """At rated speed, cyclic pitch of the largest amplitude whose direction turns at the largest rate."""
    turbine = load_turbine(name)
    limit, rate = default_limits(turbine)
    speed, dt = turbine.drivetrain.rated_rotor_speed, 1e-4
    changes = [
        np.subtract(to_blades((0.0, limit, side * rate * dt), a + speed * dt, 3), to_blades((0.0, limit, 0.0), a, 3))
        for a in np.linspace(0.0, 2.0 * math.pi, 721)
        for side in (-1.0, 1.0)
    ]
    assert 0.9 * turbine.pitch.max_rate < np.abs(changes).max() / dt <= 1.001 * turbine.pitch.max_rate
    assert limit <= math.radians(4.0)
    assert rate <= math.radians(3.0)


# ---------------------------------------------------------------- the design as a whole


@pytest.fixture
def toy_runs(monkeypatch):
    """Runs of the toy plant in place of the simulator; those that were made."""
    made = []

    def make(task, turbine, run):
        speed, seed, excited = run
        made.append(run)
        n = round(task.duration / DT)
        levels = task.excitation.draw(n, DT, seed) if excited else None
        found = toy_recording(seed, levels, n)
        return Recording(**vars(found) | {"pitch": found.pitch + 0.01 * speed})

    monkeypatch.setattr(designing, "_make", make)
    return made


TOY_TASK = {"seeds": (1, 2, 3), "duration": 60.0, "memory": 4.0, "feedback": FeedbackOptions(skip=5.0, longest=3.0)}


def test_a_design_for_a_floating_turbine_holds_two_periods_of_its_pitch(turbine):
    assert design_task(turbine, speeds=(15.0,)) == LinearDesignTask(speeds=(15.0,))
    oc4 = load_turbine("oc4_nrel_5mw")
    task = design_task(oc4, speeds=(15.0,), feedback={"travel_weight": 2.0})
    period = 2.0 * math.pi / platform_pitch_frequency(oc4)
    assert min(task.memory, task.feedback.longest, 0.5 * task.feedback.smooth) > 2.0 * period
    assert task.feedback.travel_weight == 2.0
    assert task.feedback.weights["platform_pitch_std"] > 0.0
    assert n_read(task, oc4) == n_read(replace(task, waves=True), oc4) - 1 == 8
    assert sea_of_training(turbine, Wind(15.0, 3)) is None
    seas = [sea_of_training(oc4, Wind(speed, seed)) for speed, seed in ((15.0, 3), (15.0, 4), (18.0, 3))]
    heights = [4.0 * math.sqrt(0.5 * float(np.sum(sea.amplitude**2))) for sea in seas]
    assert heights == pytest.approx([4.0, 4.0, 5.0], rel=0.1)
    assert np.ptp([sea.direction.mean() for sea in seas[:2]]) > 0.0


def test_a_design_goes_on_where_it_was_stopped(turbine, toy_runs, tmp_path):
    task = LinearDesignTask(speeds=(15.0, 18.0), excited=2, ridge=0.0, **TOY_TASK)
    store = RecordingStore(tmp_path / "runs", Recording)

    def stop(line):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        design(turbine, task, store, progress=stop)
    assert len(toy_runs) == 1
    lines = []
    made = design(turbine, task, store, progress=lines.append)
    assert len(toy_runs) == len(task.runs) == 10
    again = design(turbine, task, store)
    assert len(toy_runs) == 10
    file = next((tmp_path / "runs").glob("*.npz"))
    file.write_bytes(b"half")
    with pytest.raises(ValueError, match=f"{file.name} is damaged"):
        design(turbine, task, store)
    np.testing.assert_array_equal(made.gains, again.gains)
    assert sum("explained" in line for line in lines) == 2
    found = made.record["speeds"][0]
    assert found["explained"]["flap_mean"] == pytest.approx(1.0, abs=1e-6)
    assert found["forecast"]["cost"] < -0.02
    np.testing.assert_allclose(
        made.responses[0, :, :, :30] * made.scale[:, None, None], TOY[:6], atol=1e-6 * np.abs(TOY[:6]).max()
    )
    save_design(made, tmp_path / "made.npz")
    assert load_design(tmp_path / "made.npz").record["task"]["seeds"] == [1, 2, 3]


def test_winds_of_the_same_pitch_are_refused(turbine, toy_runs, monkeypatch):
    task = LinearDesignTask(speeds=(14.0, 15.0), excited=2, **TOY_TASK)
    toy = designing._make
    monkeypatch.setattr(designing, "_make", lambda task, turbine, run: toy(task, turbine, (15.0, *run[1:])))
    with pytest.raises(ValueError, match="pitch must rise"):
        design(turbine, task)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--wind-seeds", "1", "1001"], "training winds, 1 to 24; got 1001"),
        (["--wind-seeds", "1", "1"], "different"),
        (["--wind-speed", "18", "12"], "rising wind speeds"),
        (["--duration", "30"], "at least"),
        (["--base", "ipd"], "a controller must be among"),
        (["--turbine", "nrel_6mw"], "nrel_6mw"),
    ],
)
def test_the_command_refuses(words, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as end:
        run_command("design", ["linear_optimal", "--out", "mine.npz", *words])
    assert message in str(end.value)
    assert not list(tmp_path.iterdir())


def test_the_command_writes_a_design(toy_runs, tmp_path, capsys):
    path = tmp_path / "mine.npz"
    words = ["linear_optimal", "--wind-speed", "15", "--wind-seeds", "1", "2", "--excited", "2", "--duration", "75"]
    run_command("design", [*words, "--travel-weight", "2", "--out", str(path), "--json"])
    shown = capsys.readouterr()
    assert json.loads(shown.out.splitlines()[-1])["task"]["feedback"]["travel_weight"] == 2.0
    assert "run 4 of 4: 15 m/s, seed 2, with drawn offsets" in shown.err
    assert load_design(path).record["task"]["speeds"] == [15.0]


@pytest.mark.slow
def test_the_shipped_design_improves_a_wind_that_it_has_not_seen(turbine):
    task, metrics = load_task("load-reduction-15"), {}
    for name in ("discon", "tuned", "linear_optimal"):
        simulator = Simulator(turbine, inflow_of(turbine, Wind(15.0, 1013)), "training")
        run = run_controller(simulator, make_controller(name, turbine), 210.0)
        metrics[name] = benchmark_metrics(run.to_dataset(), turbine, 30.0)
    gains = {name: task.improvement(found, metrics["discon"]) for name, found in metrics.items()}
    assert gains["linear_optimal"] > gains["tuned"] + 0.02
    assert gains["linear_optimal"] > 0.08
    assert not task.broken_limits(metrics["linear_optimal"], metrics["discon"])


def test_the_shipped_design_was_made_in_training_winds_of_its_turbine(turbine):
    record = make_controller("linear_optimal", turbine).additions[1].design.record
    assert record["turbine"] == turbine.name
    assert LinearDesignTask(speeds=(15.0,), seeds=tuple(record["task"]["seeds"])).seeds
    explained = {part["speed"]: part["explained"] for part in record["speeds"]}
    for speed in (15.0, 18.0):
        assert min(explained[speed][name] for name in ("flap_tilt", "flap_yaw")) > 0.95
        assert explained[speed]["flap_mean"] > 0.9
