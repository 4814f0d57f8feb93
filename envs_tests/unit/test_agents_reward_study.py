"""Arithmetic of the study of the rewards, on tables by hand; one short run."""

import math

import pytest
import reward_study as study

from wt_gym.envs import rewards


def row(controller, wind_speed=8.0, **changes):
    """A row of the table."""
    values = {"flap": 4.0, "edge": 5.0, "fore_aft": 20.0, "side_side": 2.0, "mean_power": 1e6}
    values |= {"pitch_duty": 0.04, "torque_duty": 0.01, "damage": -0.5}
    return {"controller": controller, "wind_speed": wind_speed, "seed": 1, **values, **changes}


def test_differences_are_to_the_baseline_in_the_same_wind():
    rows = [
        row("baseline"), row("baseline", 16.0, flap=8.0, mean_power=5e6),
        row("other", flap=3.0, mean_power=0.9e6, pitch_duty=0.14),
        row("other", 16.0, flap=10.0, mean_power=5e6, damage=-0.7),
    ]  # fmt: skip
    low, high = study.differences(rows)
    assert (low["flap"], low["mean_power"], low["pitch_duty"]) == pytest.approx((-0.25, -0.1, 0.1))
    assert (high["flap"], high["mean_power"], high["damage"]) == pytest.approx((0.25, 0.0, -0.2))
    weights = study.COST_WEIGHTS
    assert low["cost"] == pytest.approx(-0.25 * weights["flap"] + 0.1 + 0.1 * weights["pitch_duty"])
    assert high["cost"] == pytest.approx(0.25 * weights["flap"])
    with pytest.raises(ValueError, match="baseline"):
        study.differences([row("baseline"), row("other", 16.0)])


def test_lifetime_adds_damage_and_averages_power():
    rows = [
        row("baseline"),
        row("baseline", 16.0, mean_power=5e6),
        row("other"),
        row("other", 16.0, mean_power=4e6, flap=8.0),
    ]
    (other,) = study.lifetime(rows, mean_wind=10.0)
    low, middle, high = (math.exp(-math.pi / 4 * (v / 10) ** 2) for v in (3, 12, 25))
    share = (middle - high) / (low - high)
    assert other["mean_power"] == pytest.approx(-share * 1e6 / ((1 - share) * 1e6 + share * 5e6))
    assert other["flap"] == pytest.approx((1 - share + share * 2**10) ** 0.1 - 1)
    assert other["fore_aft"] == pytest.approx(0.0)
    with pytest.raises(ValueError, match="no run"):
        study.lifetime([row("baseline"), row("baseline", 16.0), row("other")])


def test_total_and_correlation():
    assert study.total_rate({"a": 2.0, "b": -1.0}, {"a": 0.5, "b": 2.0}) == -1.0
    assert study.correlation([1, 2, 3, 4], [1, 4, 9, 16]) == pytest.approx(1.0)
    assert study.correlation([1, 2, 3], [1, 3, 2]) == pytest.approx(0.5)
    assert math.isnan(study.correlation([1, 2, 3], [1, 1, 1]))


def test_a_table_of_runs_of_todays_controllers(tmp_path):
    words = ["--runs", str(tmp_path), "--controllers", "ipc", "--winds", "16", "--seeds", "1001"]
    rows = study.measured(study.parse_arguments([*words, "--duration", "6", "--skip", "2"]))
    assert [(row["controller"], row["wind_speed"], row["seed"]) for row in rows] == [
        ("baseline", 16.0, 1001), ("ipc", 16.0, 1001)
    ]  # fmt: skip
    assert all(math.isfinite(value) for row in rows for key, value in row.items() if key != "controller")
    for row in rows:
        assert set(study.COST_WEIGHTS) | set(rewards.DEFAULT_WEIGHTS) - {"power_tracking"} <= set(row)
        assert -1.0 <= row["blade_fatigue"] < 0.0 < row["power"] <= 2.0
        assert 0.5 < row["mean_power"] / 5e6 < 1.5
    study.write(rows, tmp_path / "table.csv")
    (change,) = study.analyze(study.read(tmp_path / "table.csv"), rewards.DEFAULT_WEIGHTS)["runs"]
    assert change["controller"] == "ipc"
    assert change["pitch_duty"] == pytest.approx(rows[1]["pitch_duty"] - rows[0]["pitch_duty"], abs=1e-5)
