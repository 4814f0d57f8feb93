"""Bounds of energy and tracking error: against rotors whose optimum is known in closed form."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import power_bounds as study
import pytest
from power_bounds import RotorHull, disc_speeds, energy_bound, tracking_bound

from wt_gym.control.design import rotor_inertia
from wt_gym.control.rotor import rotor_table
from wt_gym.envs.power import efficiency
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow

TURBINE = load_turbine("nrel_5mw")
DRIVE = TURBINE.drivetrain


def flat(coefficient):
    """Rotor that takes the same share of the wind at any speed but near standstill."""
    table = rotor_table(TURBINE)
    return replace(
        table, tip_speed_ratio=np.array([0.5, 20.0]), pitch=np.array([0.0, 0.1]),
        power=np.full((2, 2), coefficient), thrust=np.ones((2, 2)),
    )  # fmt: skip


def test_hull_is_concave_above_the_table_and_meets_it():
    table = rotor_table(TURBINE)
    hull = RotorHull.of(table)
    ratio, best = table.tip_speed_ratio, table.power.max(axis=1)
    above = np.min(hull.slope[:, None] * ratio**2 + hull.intercept[:, None], axis=0) - best
    assert above.min() > -1e-12
    assert np.count_nonzero(above < 1e-12) == len(hull.slope) - 1  # and the origin
    assert np.all(np.diff(hull.slope) < 0.0)
    assert hull.peak == best.max()


def test_most_energy_of_a_steady_wind_is_that_of_the_largest_coefficient():
    """Of a long run: a rotor may spend what it holds, which counts, and slow down or speed up to its best speed."""
    low, n = 7.0, 3000
    area = 0.5 * TURBINE.air_density * math.pi * (TURBINE.rotor_diameter / 2) ** 2
    expected = efficiency(TURBINE) * area * rotor_table(TURBINE).power.max() * low**3
    assert energy_bound(TURBINE, np.full(n, low), 0.5, 1.1) == pytest.approx(expected, rel=2e-3)
    assert energy_bound(TURBINE, np.full(n, 20.0), 0.5, 1.1) == pytest.approx(DRIVE.rated_power, rel=5e-3)


def test_a_rotor_stores_what_is_beyond_rated_power_for_the_lull():
    wind = np.where(np.arange(600) % 40 < 20, 13.0, 9.0)
    found = energy_bound(TURBINE, wind, 0.5, 1.2)
    at_once = np.mean([energy_bound(TURBINE, np.full(3000, v), 0.5, 1.2) for v in (13.0, 9.0)])
    assert found > 1.01 * at_once
    assert found <= DRIVE.rated_power


@pytest.mark.parametrize("task", ["FullOperation", "MaxPower"])
def test_no_recorded_run_has_more_energy_than_its_bound(task):
    home = Path(__file__).parents[2] / "docs" / "data"
    rows = [row for row in json.loads((home / "power_bounds.json").read_text()) if row["task"] == task]
    bounds = {row["wind"]: row["power"] for row in rows if "wind" in row}
    runs = json.loads((home / "task_scores.json").read_text())[task]["runs"]
    shares = [run["metrics"]["corrected_power"] / bounds[run["wind"]] for run in runs]
    assert 0.5 < min(shares) < max(shares) <= 1.0
    assert all(0.9 < row["share"] < 1.0 for row in rows if "steady" in row)


def test_wind_that_suffices_needs_no_error():
    assert tracking_bound(TURBINE, np.full(300, 13.0), np.full(300, 4e6), 0.1, 5.0, 1.1) == pytest.approx(0.0, abs=1.0)


def test_what_is_missing_is_made_up_by_the_kinetic_energy(monkeypatch):
    """A rotor that takes the same at any speed spends all that it holds: error = deficit - eta E_0 / T."""
    monkeypatch.setattr(study, "rotor_table", lambda turbine: flat(0.4))
    n, dt, wind, demanded = 600, 0.1, 8.0, 3e6
    table = flat(0.4)
    eta = efficiency(TURBINE)
    taken = eta * 0.5 * table.air_density * math.pi * table.radius**2 * 0.4 * wind**3
    held = 0.5 * rotor_inertia(TURBINE) * DRIVE.rated_rotor_speed**2
    expected = demanded - taken - eta * held / (n * dt)
    assert expected > 5e5
    found = tracking_bound(TURBINE, np.full(n, wind), np.full(n, demanded), dt, 0.0, 1.1)
    assert found == pytest.approx(expected, rel=5e-3)


def test_a_real_rotor_takes_less_as_it_slows_down():
    n, dt, wind, demanded = 600, 0.1, 8.0, 3e6
    found = tracking_bound(TURBINE, np.full(n, wind), np.full(n, demanded), dt, 0.0, 1.1)
    available = energy_bound(TURBINE, np.full(3000, wind), 0.5, 1.1)
    held = 0.5 * rotor_inertia(TURBINE) * DRIVE.rated_rotor_speed**2
    assert demanded - available - efficiency(TURBINE) * held / (n * dt) < found < demanded - available


def test_a_uniform_wind_is_that_of_the_disc():
    np.testing.assert_allclose(disc_speeds(TURBINE, SteadyInflow(9.0), np.arange(5) * 0.1), 9.0, rtol=1e-12)


@pytest.mark.parametrize("task", study.PAGES)
def test_the_page_says_what_the_records_give(task):
    runs = json.loads(study.SCORES.read_text(encoding="utf-8"))[task]["runs"]
    page = (study.ROOT / "docs" / "tasks" / f"{study.PAGES[task]}.md").read_text(encoding="utf-8")
    assert study.sentence(task, json.loads(study.RECORD.read_text(encoding="utf-8")), runs) in page.splitlines()
