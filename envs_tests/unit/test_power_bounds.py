"""Bounds of energy and tracking error: against rotors whose optimum is known in closed form."""

import math
from dataclasses import replace

import numpy as np
import power_bounds as study
import pytest
from power_bounds import disc_speeds, energy_bound, hull_edges, tracking_bound
from study_pages import DATA, TASK_PAGES, filled, read_json

from wt_gym.control.design import rotor_inertia
from wt_gym.control.rotor import rotor_table
from wt_gym.envs.power import efficiency
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow

TURBINE = load_turbine("nrel_5mw")
DRIVE = TURBINE.drivetrain
AREA = 0.5 * TURBINE.air_density * math.pi * (TURBINE.rotor_diameter / 2) ** 2
HELD = 0.5 * rotor_inertia(TURBINE) * DRIVE.rated_rotor_speed**2


def test_hull_is_concave_above_the_table_and_meets_it():
    table = rotor_table(TURBINE)
    slope, intercept = hull_edges(table)
    ratio, best = table.tip_speed_ratio, table.power.max(axis=1)
    above = np.min(slope[:, None] * ratio**2 + intercept[:, None], axis=0) - best
    assert above.min() > -1e-12
    assert np.count_nonzero(above < 1e-12) == len(slope) - 1  # and the origin
    assert np.all(np.diff(slope) < 0.0)
    assert intercept[-1] == best.max()


def test_most_energy_of_a_steady_wind_is_that_of_the_largest_coefficient():
    """Of a long run: a rotor may spend what it holds, which counts, and slow down or speed up to its best speed."""
    low, n = 7.0, 3000
    expected = efficiency(TURBINE) * AREA * rotor_table(TURBINE).power.max() * low**3
    assert energy_bound(TURBINE, np.full(n, low), 0.5, 1.1) == pytest.approx(expected, rel=2e-3)
    assert energy_bound(TURBINE, np.full(n, 20.0), 0.5, 1.1) == pytest.approx(DRIVE.rated_power, rel=5e-3)


def test_a_rotor_stores_what_is_beyond_rated_power_for_the_lull():
    wind = np.where(np.arange(600) % 40 < 20, 13.0, 9.0)
    found = energy_bound(TURBINE, wind, 0.5, 1.2)
    at_once = np.mean([energy_bound(TURBINE, np.full(3000, v), 0.5, 1.2) for v in (13.0, 9.0)])
    assert found > 1.01 * at_once
    assert found <= DRIVE.rated_power


def test_wind_that_suffices_needs_no_error():
    assert tracking_bound(TURBINE, np.full(300, 13.0), np.full(300, 4e6), 0.1, 5.0, 1.1) == pytest.approx(0.0, abs=1.0)


def test_what_is_missing_is_made_up_by_the_kinetic_energy(monkeypatch):
    """A rotor that takes the same at any speed spends all that it holds: error = deficit - eta E_0 / T.

    A real one takes less as it slows down.
    """
    n, dt, wind, demanded, eta = 600, 0.1, 8.0, 3e6, efficiency(TURBINE)
    spent = eta * HELD / (n * dt)
    case = TURBINE, np.full(n, wind), np.full(n, demanded), dt, 0.0, 1.1
    available = energy_bound(TURBINE, np.full(3000, wind), 0.5, 1.1)
    assert demanded - available - spent < tracking_bound(*case) < demanded - available
    flat = replace(
        rotor_table(TURBINE), tip_speed_ratio=np.array([0.5, 20.0]), pitch=np.array([0.0, 0.1]),
        power=np.full((2, 2), 0.4), thrust=np.ones((2, 2)),
    )  # fmt: skip
    monkeypatch.setattr(study, "rotor_table", lambda turbine: flat)
    assert tracking_bound(*case) == pytest.approx(demanded - eta * AREA * 0.4 * wind**3 - spent, rel=5e-3)


def test_a_uniform_wind_is_that_of_the_disc():
    np.testing.assert_allclose(disc_speeds(TURBINE, SteadyInflow(9.0), np.arange(5) * 0.1), 9.0, rtol=1e-12)


@pytest.mark.parametrize("task", ["FullOperation", "MaxPower"])
def test_no_recorded_run_has_more_energy_than_its_bound(task):
    rows = [row for row in read_json(study.RECORD) if row["task"] == task]
    bounds = {row["wind"]: row["power"] for row in rows if "wind" in row}
    runs = read_json(DATA / "task_scores.json")[task]["runs"]
    shares = [run["metrics"]["corrected_power"] / bounds[run["wind"]] for run in runs]
    assert 0.5 < min(shares) < max(shares) <= 1.0
    assert all(0.9 < row["share"] < 1.0 for row in rows if "steady" in row)


@pytest.mark.parametrize("page", study.PAGES.values())
def test_the_page_has_the_bound_of_the_records(page):
    text = (TASK_PAGES / f"{page}.md").read_text(encoding="utf-8")
    assert filled(text, {"bound": study.bound}) == text
