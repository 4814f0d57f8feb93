"""The study of the rewards, and the page that states its figures."""

import math
import re
from pathlib import Path

import pandas as pd
import pytest
import reward_study as study
from site_parts import studies

from wt_gym.envs import rewards
from wt_gym.envs.turbine_env import WindTurbineEnv

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "rewards.md").read_text(encoding="utf-8")


def table(*rows):
    """Runs of (controller, wind speed, changes)."""
    values = {"flap": 4.0, "edge": 5.0, "fore_aft": 20.0, "side_side": 2.0, "mean_power": 1e6}
    values |= {"pitch_duty": 0.04, "torque_duty": 0.01, "damage": -0.5}
    return pd.DataFrame([{"controller": c, "wind_speed": w, "seed": 1, **values, **changes} for c, w, changes in rows])


@pytest.fixture(scope="module")
def record():
    return study.analyze(pd.read_csv(study.RECORD), rewards.DEFAULT_WEIGHTS)


def test_differences_are_to_the_baseline_in_the_same_wind():
    runs = table(
        ("baseline", 8.0, {}), ("baseline", 16.0, {"flap": 8.0, "mean_power": 5e6}),
        ("other", 8.0, {"flap": 3.0, "mean_power": 0.9e6, "pitch_duty": 0.14}),
        ("other", 16.0, {"flap": 10.0, "mean_power": 5e6, "damage": -0.7}),
    )  # fmt: skip
    found, weights = study.differences(runs), study.COST_WEIGHTS
    assert found["flap"].tolist() == pytest.approx([-0.25, 0.25])
    assert found["mean_power"].tolist() == pytest.approx([-0.1, 0.0])
    assert found["damage"].tolist() == pytest.approx([0.0, -0.2])
    expected = [-0.25 * weights["flap"] + 0.1 + 0.1 * weights["pitch_duty"], 0.25 * weights["flap"]]
    assert found["cost"].tolist() == pytest.approx(expected)
    with pytest.raises(ValueError, match="no run of the baseline at 16 m/s with seed 1"):
        study.differences(table(("baseline", 8.0, {}), ("other", 16.0, {})))


def test_lifetime_adds_damage_and_averages_power():
    runs = table(
        ("baseline", 8.0, {}), ("baseline", 16.0, {"mean_power": 5e6}),
        ("other", 8.0, {}), ("other", 16.0, {"mean_power": 4e6, "flap": 8.0}),
    )  # fmt: skip
    other = study.lifetime(runs, mean_wind=10.0).iloc[0]
    low, middle, high = (math.exp(-math.pi / 4 * (v / 10) ** 2) for v in (3, 12, 25))
    share = (middle - high) / (low - high)
    assert other["mean_power"] == pytest.approx(-share * 1e6 / ((1 - share) * 1e6 + share * 5e6))
    assert other["flap"] == pytest.approx((1 - share + share * 2**10) ** 0.1 - 1)
    assert other["fore_aft"] == pytest.approx(0.0)
    with pytest.raises(ValueError, match="no run in some of the winds"):
        study.lifetime(runs.iloc[:3])


def test_a_table_of_runs_of_todays_controllers(tmp_path):
    words = ["--runs", str(tmp_path), "--controllers", "ipc", "--winds", "16", "--seeds", "1001"]
    runs = study.measured(study.parse_arguments([*words, "--duration", "6", "--skip", "2"]))
    assert set(study.COST_WEIGHTS) | set(rewards.DEFAULT_WEIGHTS) - {"power_tracking", "platform_motion"} <= set(runs)
    assert runs["blade_fatigue"].between(-1.0, -1e-9).all()
    assert runs["power"].between(0.0, 2.0).all()
    change = study.analyze(runs, rewards.DEFAULT_WEIGHTS)["runs"].iloc[0]
    assert (change["controller"], change["wind_speed"], change["seed"]) == ("ipc", 16.0, 1001)
    assert change["pitch_duty"] == pytest.approx(runs["pitch_duty"][1] - runs["pitch_duty"][0])


# ---- the page ----


def test_weights_on_the_pages():
    listed = {name: float(weight) for name, weight in re.findall(r"^\| `(\w+)` \| ([\d.]+) \|", PAGE, re.MULTILINE)}
    assert listed == rewards.DEFAULT_WEIGHTS
    manual = re.findall(r"^ *\| (\w+) +\| ([\d.]+) +\|", WindTurbineEnv.__doc__, re.MULTILINE)
    default = {name: weight for name, weight in rewards.DEFAULT_WEIGHTS.items() if weight > 0}
    assert {name: float(weight) for name, weight in manual if name in rewards.DEFAULT_WEIGHTS} == default


def test_the_default_reward_ranks_the_controllers_as_the_page_states(record):
    lifetimes = record["lifetimes"]
    assert len(lifetimes) == 22
    assert study.against_cost(record["runs"]) <= -0.8
    for page, text, weights in (
        (PAGE, r"correlation of \*\*(\S+)\*\*", rewards.DEFAULT_WEIGHTS),
        (studies.study("rewards", "correlations"), r"default reward \| (\S+)", rewards.DEFAULT_WEIGHTS),
        (studies.study("rewards", "correlations"), r"earlier weights \| (\S+)", study.FORMER_WEIGHTS),
    ):
        stated = float(re.search(text, page)[1].replace("−", "-"))
        assert stated == pytest.approx(study.against_cost(lifetimes, weights), abs=0.0051)
    for term, load in (
        ("blade_fatigue", "flap"), ("tower_fore_aft_fatigue", "fore_aft"), ("tower_side_side_fatigue", "side_side")
    ):  # fmt: skip
        assert study.correlation(lifetimes[term], lifetimes[load]) < -0.65


def test_figures_of_the_tasks(record):
    """One row a reward: lifetime cost, then cost and energy in single winds."""
    text, shown = (ROOT / "docs" / "studies" / "rewards.md").read_text(encoding="utf-8"), {}
    for names, *cells in re.findall(r"^\| ((?:`\w[\w-]+`(?:, )?)+)" + r" \| (\S+)" * 6 + r" \|$", text, re.MULTILINE):
        for name in re.findall(r"`([\w-]+)`", names):
            shown[name] = [float(cell.replace("−", "-")) for cell in cells]
    found = study.of_tasks(record["runs"], record["lifetimes"])
    columns = [f"cost, {place}" for place in ("lifetime", "8 m/s", "12 m/s", "16 m/s")]
    found = found[[*columns, "mean_power, 8 m/s", "power, 8 m/s"]]
    assert shown == {name: pytest.approx(row.tolist(), abs=0.0051) for name, row in found.iterrows()}
