"""Ceilings of the benchmark: learned offsets against exact optima, files and tables."""

import dataclasses
import json
import math
import re
from pathlib import Path

import ceiling as ceilings
import numpy as np
import pytest
from ceiling import CeilingOptions, ceiling_table, make_ceiling, write_ceiling
from ceiling_oracle import LoadQuadratic, OracleOptions, Played, best_of, learn_offsets, limited, optimal_change

from wt_gym.base.errors import BenchmarkError
from wt_gym.control import Demand
from wt_gym.control.controllers.linear_optimal import PitchOffsets
from wt_gym.experiment.benchmark import leaderboard, to_markdown
from wt_gym.experiment.benchmark_tasks import BenchmarkTask, Ceiling, ceiling_of, load_task, task_file, task_names
from wt_gym.learning.linear_design import Plant, forecast
from wt_gym.learning.options import FeedbackOptions
from wt_gym.learning.recording import Recording, respond
from wt_gym.simulation.drivetrain.drives import pitch_delay

DT, STEPS = 0.1, 600
SPEED = 12.1 * math.pi / 30
TASK = load_task("load-reduction-15")
ONLY_TOWER = FeedbackOptions(
    weights={"tower_fore_aft_del": 0.15}, speed_weight=0.0, mean_weight=0.0, tilt_yaw_weight=1e-6, skip=5.0
)
GAIN = -8e7
TAP = np.zeros((9, 3, 4))
TAP[6, 0, 0] = GAIN
"""A plant in which the mean offset of one step moves the tower's fore-aft moment of the next, and nothing else."""
WHOLE = np.zeros((9, 3, 20))
WHOLE[0, 0] = WHOLE[1, 1] = WHOLE[2, 2] = -2e7 * np.exp(-np.arange(20) / 3.0)
WHOLE[6, 0] = -8e7 * np.exp(-np.arange(20) / 5.0)
WHOLE[5, 0], WHOLE[7, 2] = -0.01, 1e6


def plant_of(responses, turbine):
    return Plant(responses, np.array([3e5, 3e5, 3e5, 0.02, 0.02, 0.003]), 0.0, pitch_delay(turbine.pitch, DT), DT)


def recording(responses, disturbance, offsets=None, power=5e6):
    """A run of a linear plant under disturbances (9, n + 1) of outputs and loads, at an even rotor speed."""
    n = disturbance.shape[1] - 1
    given = np.zeros((3, n)) if offsets is None else offsets
    both = disturbance + respond(responses, given)
    both[5] += SPEED
    both[8] += power
    azimuth = np.arange(n + 1) * DT * SPEED
    angles = azimuth + 2.0 * np.pi / 3.0 * np.arange(3)[:, None]
    flap = both[0] + both[1] * np.cos(angles) + both[2] * np.sin(angles)
    return Recording(DT, both[:6], both[6:], flap, 0.0 * flap, 0.1 * np.ones((3, n + 1)), azimuth, given, np.ones(n))


def rough(seed, time=1.0):
    """Disturbances with a memory [s]."""
    rng = np.random.default_rng(seed)
    smooth = np.exp(-np.arange(round(10 * time / DT)) * DT / time)
    found = np.stack([np.convolve(x, smooth, "valid") for x in rng.normal(size=(9, STEPS + smooth.size))])
    sizes = np.array([3e5, 3e5, 3e5, 0.02, 0.02, 0.0, 5e6, 1e6, 0.0])
    return sizes[:, None] * (found / found.std(1, keepdims=True))[:, : STEPS + 1]


def sine(amplitude, period=2.0):
    """A disturbance of the fore-aft moment alone, too fast to be taken for its mean."""
    out = np.zeros((9, STEPS + 1))
    out[6] = amplitude * np.sin(2.0 * np.pi * np.arange(STEPS + 1) * DT / period)
    out[7], out[0] = 1e3 * np.sin(np.arange(STEPS + 1)), 1e3 * np.cos(np.arange(STEPS + 1))
    return out


def fore_aft(run, offsets, plant):
    return forecast(run, plant, offsets).metrics(DT, 0.14, 5.0)["tower_fore_aft_del"]


# ---------------------------------------------------------------- offsets for a known wind


def test_the_transpose_is_one(turbine):
    run = recording(WHOLE, rough(1))
    quadratic = LoadQuadratic(run, run, plant_of(WHOLE, turbine), turbine, FeedbackOptions(skip=5.0))
    rng = np.random.default_rng(0)
    change, rows = rng.normal(size=(3, STEPS)), rng.normal(size=quadratic.there.size)
    assert quadratic.forward(change) @ rows == pytest.approx((change * quadratic.transposed(rows)).sum(), rel=1e-9)
    several = np.stack([change, 2.0 * change])
    np.testing.assert_allclose(quadratic.forward(several)[1], 2.0 * quadratic.forward(change), atol=1e-12)


def test_conjugate_gradients_find_the_least_squares(turbine):
    """Of a short run the matrix can be written out and solved by a factorization."""
    n = 80
    run = recording(WHOLE, rough(2)[:, : n + 1])
    options = FeedbackOptions(skip=1.0, smooth=3.0, mean_weight=2.0, tilt_yaw_weight=0.5)
    quadratic = LoadQuadratic(run, run, plant_of(WHOLE, turbine), turbine, options)
    matrix = quadratic.forward(np.eye(3 * n).reshape(3 * n, 3, n)).T
    expected = np.linalg.lstsq(matrix, -quadratic.there, rcond=None)[0].reshape(3, n)
    found = quadratic.minimum(2000, 1e-12)
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())


def test_limits_and_rates_are_those_of_the_drives(turbine):
    """Offsets as they are forecast are those that `PitchOffsets` lets act."""
    limit, rate, azimuth = 0.05, 0.04, 0.3
    wanted = 0.1 * np.random.default_rng(3).normal(size=(3, 60)).cumsum(1)
    drives = PitchOffsets(turbine, limit, rate, False)
    demand = Demand(np.full(3, 0.5), 0.0, 0.0)
    acted = []
    for level in wanted.T:
        drives.added(level.tolist(), demand, azimuth, SPEED, DT)
        acted.append(drives.acting)
    found = limited(wanted, limit, rate, DT)
    np.testing.assert_allclose(found, np.array(acted).T, atol=1e-12)
    assert np.abs(found[0]).max() <= limit + 1e-12
    assert np.hypot(found[1], found[2]).max() <= limit + 1e-12
    assert np.abs(np.diff(found[0], prepend=0.0)).max() <= rate * DT + 1e-12


def test_limits_that_bind_are_kept(turbine):
    run, plant = recording(TAP, sine(4e6)), plant_of(TAP, turbine)
    options = OracleOptions(feedback=ONLY_TOWER, rate_limit=0.02, limit=0.01)
    change = optimal_change(run, run, plant, turbine, options)
    assert np.abs(change).max() <= 0.01 + 1e-12
    assert np.abs(np.diff(change[0], prepend=0.0)).max() <= 0.02 * DT + 1e-12
    assert fore_aft(run, change, plant) < fore_aft(run, 0.0 * change, plant)


def test_the_optimum_of_one_tap_is_known_and_spared_in_lulls(turbine):
    """Of the cost a (d + g u)^2 + r u^2 at every step, the offset is -a g d / (a g^2 + r).

    Below rated power the square of the mean offset costs twenty times its mean square in power.
    """
    disturbance = sine(4e6)
    run, plant = recording(TAP, disturbance), plant_of(TAP, turbine)
    run.loads[2, : STEPS // 2] = 4e6
    options = dataclasses.replace(ONLY_TOWER, weights=ONLY_TOWER.weights | {"captured_power": -1.0}, mean_weight=0.8)
    found, *turning = LoadQuadratic(run, run, plant, turbine, options, even=True).minimum(500, 1e-10)
    assert np.abs(turning).max() < 1e-9
    moment = disturbance[6, 1:]
    a = 0.5 * 0.15 / (moment[50:] ** 2).sum()
    for counted, r in ((slice(130, 250), 20.8 / STEPS), (slice(350, 470), 0.8 / STEPS)):
        expected = -a * GAIN * moment[counted] / (a * GAIN**2 + r)
        answer = found[counted] - found[counted].mean()  # whole periods; the mean that is taken off may stay
        np.testing.assert_allclose(answer, expected, atol=0.02 * np.abs(expected).max())


def linear_world(turbine, factor=1.0, broken=lambda offsets: ()):
    """A player whose plant answers with a factor on what the model says."""
    truth, disturbance, plant = factor * TAP, sine(4e6), plant_of(TAP, turbine)
    options = OracleOptions(feedback=ONLY_TOWER, rate_limit=1.0, passes=5)
    still = recording(truth, disturbance)
    before = fore_aft(still, np.zeros((3, STEPS)), plant)
    asked = []

    def play(levels):
        asked.append(levels)
        run = recording(truth, disturbance, limited(levels, options.limit, options.rate_limit, DT))
        now = forecast(run, plant, np.zeros((3, STEPS))).metrics(DT, 0.14, 5.0)["tower_fore_aft_del"]
        return Played(run, 1.0 - now / before, broken(run.offsets))

    return play, Played(still, 0.0, ()), plant, options, asked


@pytest.mark.parametrize("factor", [0.7, 1.3])
def test_learning_gets_past_an_error_of_the_model(turbine, factor):
    play, base, plant, options, _ = linear_world(turbine, factor)
    passes = learn_offsets(play, base, plant, turbine, options)
    play, base, plant, options, _ = linear_world(turbine)
    without_error = best_of(learn_offsets(play, base, plant, turbine, options)).value
    assert len(passes) == 1 + 5
    assert passes[1].value == pytest.approx(0.7, abs=0.05)  # three tenths of the load are left by the model alone
    assert best_of(passes).value == pytest.approx(without_error, abs=0.01)


def test_a_pass_that_breaks_a_limit_does_not_count(turbine):
    play, base, plant, options, asked = linear_world(
        turbine, broken=lambda offsets: ("captured_power",) if np.abs(offsets).max() > 0.01 else ()
    )
    passes = learn_offsets(play, base, plant, turbine, options)
    assert passes[1].broken == ("captured_power",)
    assert best_of(passes).broken == ()
    always = [Played(None, None, ("overspeed",)), Played(None, None, ("tower_strike",))]
    assert best_of(always) is always[0]
    assert len(asked) == options.passes


def test_what_has_no_meaning_is_refused(turbine):
    with pytest.raises(ValueError, match=r"must last, it ended with overspeed"):
        learn_offsets(lambda levels: None, Played(None, None, ("overspeed",)), plant_of(TAP, turbine), turbine)


# ---------------------------------------------------------------- runs, files, tables


def test_runs_that_are_kept_are_not_made_again(monkeypatch, tmp_path):
    played = []

    class Player:
        def __init__(self, env, levels, limit, rate_limit):
            played.append(levels)

        def recording(self):
            return recording(WHOLE, rough(1))

    def play(task, wind, make_agent, interface):
        make_agent(None)
        return {"metrics": {"x": 1.0}, "ending": "time"}

    monkeypatch.setattr(ceilings, "play_task", play)
    monkeypatch.setattr(ceilings, "OffsetsPlayer", Player)
    runs = ceilings._Runs(TASK, CeilingOptions(), tmp_path)
    first = runs.offsets(TASK.winds[0], np.zeros((3, 4)))
    again = runs.offsets(TASK.winds[0], np.zeros((3, 4)))
    assert len(played) == 1
    assert again[0]["metrics"] == first[0]["metrics"]
    np.testing.assert_array_equal(again[1].flap, first[1].flap)
    runs.offsets(TASK.winds[0], np.full((3, 200), 0.01))
    runs.offsets(TASK.winds[0], np.full((3, 200), 0.02))
    assert len(played) == 3


def made(**more):
    values = {
        "task": TASK.name, "version": TASK.version, "definition": TASK.digest, "fingerprint": {"kernels": "a"},
        "made": {"date": "2026-01-02", "wt_gym": "0"}, "how": {"duration": 600.0}, "explained": {},
        "improvement": 0.18, "yardstick": "linear_optimal", "yardstick_improvement": 0.12,
        "winds": {"a": {"improvement": 0.18}, "b": {"improvement": 0.18}},
    }  # fmt: skip
    return Ceiling(**(values | more))


def test_a_ceiling_comes_back_from_its_file_with_its_score_over_the_yardstick(tmp_path):
    path = write_ceiling(made(), tmp_path / "new" / "x.json")
    assert ceiling_of(TASK, path) == made()
    assert made().score == pytest.approx(150.0)
    assert made(yardstick_improvement=-0.01).score is made(yardstick_improvement=None).score is None
    assert ceiling_of(TASK, tmp_path / "nothing.json") is None
    assert ceiling_of(TASK, write_ceiling(made(definition="other"), path)) is None
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_ceiling(made(improvement=math.nan), path)
    path.write_text('{"task": 1}', encoding="utf-8")
    with pytest.raises(BenchmarkError, match=r"must be a ceiling of scripts/studies/ceiling.py"):
        ceiling_of(TASK, path)


def test_the_table_says_how_high_the_ceiling_is(monkeypatch):
    definition = {
        "task": TASK.name, "version": TASK.version, "wind": TASK.winds[0].definition, "agent": {"name": "x"},
        "fingerprint": {"kernels": "a"},
    }  # fmt: skip
    result = {"definition": definition, "agent": "x", "ending": "time", "metrics": {}}
    monkeypatch.setattr("wt_gym.experiment.benchmark.ceiling_of", lambda task: made())
    text = to_markdown(leaderboard([result]))
    assert (
        "Ceiling with the wind known: an improvement of 18.00 %: 150 where `linear_optimal` has 100 (12.00 %), "
        "measured in 2 winds of 600 s, 2026-01-02." in text
    )
    known = dataclasses.replace(TASK, reference=TASK.reference | {"fingerprint": {"kernels": "b"}})
    monkeypatch.setattr("wt_gym.experiment.benchmark.load_task", lambda name: known)
    assert "made with another kernels than the reference numbers" in to_markdown(leaderboard([result]))
    monkeypatch.setattr("wt_gym.experiment.benchmark.ceiling_of", lambda task: None)
    assert "Ceiling" not in to_markdown(leaderboard([result]))


def test_a_task_has_a_yardstick_or_candidates():
    values = json.loads(task_file("load-reduction-15").read_text(encoding="utf-8"))
    assert TASK.measures == ("linear_optimal",)
    assert load_task("below-rated-8").measures == load_task("below-rated-8").candidates
    for wrong in ({"candidates": ["ipc"]}, {"yardstick": None}):
        with pytest.raises(BenchmarkError, match="either a yardstick or candidates"):
            BenchmarkTask.from_json(values | wrong)


@pytest.mark.parametrize("path", sorted((task_file("load-reduction-15").parent / "ceilings").glob("*.json")), ids=str)
def test_ceilings_of_the_package_are_above_the_yardstick(path):
    found = ceiling_of(load_task(path.stem))
    assert found is not None
    assert found.improvement > found.yardstick_improvement > 0.0
    for row in found.winds.values():
        assert row["improvement"] == max(value for value in row["passes"] if value is not None)
        assert row["changes"]["captured_power"] >= -0.005


def test_the_page_has_the_ceilings_as_they_are():
    known = {load_task(name).id: ceiling_of(load_task(name)) for name in task_names()}
    there = {name: found for name, found in known.items() if found is not None}
    page = (Path(__file__).resolve().parents[2] / "docs" / "benchmark.md").read_text(encoding="utf-8")
    stated = re.search(r"with the wind known, (\d+) at 15 m/s and (\d+) at 18 m/s", page)
    assert [f"{one.score:.0f}" for one in there.values()] == list(stated.groups())
    assert all(f"| {name} |" in ceiling_table(there) for name in there)


@pytest.mark.slow
def test_a_ceiling_is_learned_in_the_simulator(tmp_path):
    task = dataclasses.replace(TASK, duration=75.0, winds=TASK.winds[:1])
    options = CeilingOptions(winds=1, seeds=(1, 2), recorded=80.0, oracle=OracleOptions(passes=1))
    lines = []
    found = make_ceiling(task, tmp_path, options, progress=lines.append)
    (row,) = found.winds.values()
    assert row["passes"][1] > row["passes"][0] + 0.03
    files = sorted(tmp_path.rglob("*.*"))
    assert make_ceiling(task, tmp_path, options).winds == found.winds
    assert sorted(tmp_path.rglob("*.*")) == files
