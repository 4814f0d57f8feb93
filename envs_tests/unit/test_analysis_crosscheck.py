"""Two simulators side by side: changes, order of the agents, levels, signals and spectra."""

import json
import math

import numpy as np
import pytest
import xarray as xr

from wt_gym.analysis.crosscheck import SERIES, Crosscheck, changes_figure, tables, write_crosscheck
from wt_gym.analysis.metrics import METRICS
from wt_gym.analysis.results import Evaluation, Run, Wind

WINDS = (Wind(12.0, 1001), Wind(12.0, 1002), Wind(16.0, 1001))
TIME = np.arange(0, 601) * 0.2
MEAN = {key: 1.0 / metric.factor for key, metric in METRICS.items()}
SIGNALS = (*SERIES, "tower_base_side_side_moment")
FLAP = {"discon": 1.0, "ipc": 0.8, "a|b": 0.7, "last": 0.9}
OTHER_FLAP = {"discon": 1.2, "ipc": 1.2 * 0.85, "a|b": 1.2 * 0.75, "last": 1.2 * 0.99}


def evaluation(flap, frequency=0.2, phase=0.0, length=120.0, winds=WINDS):
    runs = []
    time = TIME[: round(length / 0.2) + 1]
    wave = np.sin(2 * np.pi * frequency * time + phase)
    data = xr.Dataset({name: ("time", 5.0 + wave, {"units": "N m"}) for name in SIGNALS}, {"time": time})
    for wind in winds:
        for agent, factor in flap.items():
            metrics = MEAN | {"blade_flap_del": MEAN["blade_flap_del"] * factor}
            runs.append(Run(agent, wind, data, metrics, 1.0, {}, 120.0, length, "time"))
    settings = {"skip": 20.0, "env_id": "wt_gym/LoadReduction-v3", "duration": 120.0}
    return Evaluation("Turbine", settings, runs, "discon")


@pytest.fixture
def check():
    return Crosscheck(("wt_gym", "openfast"), (evaluation(FLAP), evaluation(OTHER_FLAP, phase=math.pi / 3)))


def test_changes_are_against_the_baseline_of_the_same_simulator(check):
    first, second = check.changes("ipc", "blade_flap_del", 12.0)
    assert (first.value, second.value) == (pytest.approx(-0.2), pytest.approx(-0.15))
    assert check.level("blade_flap_del") == pytest.approx(1.0 / 1.2 - 1.0)


def test_the_order_of_agents(check):
    assert check.rank_correlation("blade_flap_del") == pytest.approx(1.0)
    assert math.isnan(check.rank_correlation("tower_fore_aft_del"))  # none has an effect
    turned = dict(zip(FLAP, (1.0, 0.7, 0.8, 0.9), strict=True))  # the first two change places
    other = Crosscheck(("a", "b"), (evaluation(FLAP), evaluation(turned)))
    assert other.rank_correlation("blade_flap_del") == pytest.approx(0.8)


def test_signals_are_compared_after_the_start_and_as_long_as_both_last():
    other = evaluation(OTHER_FLAP, phase=math.pi / 3, length=80.0)
    check = Crosscheck(("a", "b"), (evaluation(FLAP), other))
    first, second = check.common("ipc", WINDS[0])
    assert (float(first.time[0]), float(first.time[-1])) == (pytest.approx(20.0), pytest.approx(80.0))
    assert first.sizes == second.sizes
    # whole periods of two waves apart by 60 degrees
    assert check.sample_correlation("ipc", "wind_x") == pytest.approx(0.5, abs=0.01)


def test_spectra_are_means_over_the_winds(check):
    frequency, first, second = check.spectra("ipc", "pitch_1")
    assert frequency[first.argmax()] == pytest.approx(0.2)
    assert np.trapezoid(first, frequency) == pytest.approx(0.5, rel=0.05)
    np.testing.assert_allclose(first, second, rtol=0.05, atol=0.02)


def test_other_agents_or_winds_are_refused():
    with pytest.raises(ValueError, match="agents of both evaluations must be the same"):
        Crosscheck(("a", "b"), (evaluation(FLAP), evaluation({"discon": 1.0})))
    with pytest.raises(ValueError, match="winds of both evaluations must be the same"):
        Crosscheck(("a", "b"), (evaluation(FLAP), evaluation(FLAP, winds=WINDS[:1])))


def test_the_page(check, tmp_path):
    text = tables(json.loads(json.dumps(check.content, default=str)))
    assert "| 12 m/s | ipc | −20.0 % / −15.0 % |" in text
    assert "| 12 m/s | a\\|b | −30.0 % / −25.0 % |" in text
    assert "| 16 m/s | level | −16.7 % |" in text
    path, _ = write_crosscheck(check, tmp_path, "wt-gym crosscheck discon ipc")
    written = path.read_text(encoding="utf-8")
    assert "wt-gym crosscheck discon ipc\n" in written
    figures = [line.split("(")[1].rstrip(")") for line in written.splitlines() if line.startswith("![")]
    assert len(figures) == 1 + 2 * 4
    assert all((tmp_path / figure).stat().st_size > 5000 for figure in figures)
    content = json.loads((tmp_path / "crosscheck.json").read_text())
    (row,) = [r for r in content["metrics"] if r["metric"] == "blade_flap_del" and r["wind_speed"] is None]
    assert [change["value"] for change in row["changes"]["last"]] == [pytest.approx(-0.1), pytest.approx(-0.01)]
    assert all(change["relative"] and change["n_winds"] == len(WINDS) for change in row["changes"]["last"])
    assert row["rank_correlation"] == pytest.approx(1.0)


def test_changes_of_both_are_the_coordinates_of_a_point(check):
    flap = changes_figure(check.content).axes[0]
    points = {(round(float(line.get_xdata()[0]), 6), round(float(line.get_ydata()[0]), 6))
              for line in flap.lines if len(line.get_xdata()) == 1}  # fmt: skip
    assert {(-20.0, -15.0), (-30.0, -25.0)} <= points
    assert len(points) == 3  # the same at each of the speeds
    (diagonal,) = [line for line in flap.lines if len(line.get_xdata()) == 2]
    np.testing.assert_array_equal(diagonal.get_xdata(), diagonal.get_ydata())


def test_runs_that_ended_early_are_named(tmp_path):
    second = evaluation(FLAP)
    run = second.runs[1]
    second.runs[1] = Run(run.agent, run.wind, run.data, {}, 0.0, {}, 120.0, 33.0, "failure", "OpenFAST: it broke")
    path, _ = write_crosscheck(Crosscheck(("wt_gym", "openfast"), (evaluation(FLAP), second)), tmp_path)
    text = path.read_text(encoding="utf-8")
    assert "openfast: ipc at 12 m/s, seed 1001 ended after 33 s (failure) OpenFAST: it broke" in text


def test_the_report_answers_first_and_links_to_both_evaluations(check, tmp_path):
    for name, each in zip(check.names, check.evaluations, strict=True):
        each.save(tmp_path / name)
    _, report = write_crosscheck(check, tmp_path, "wt-gym crosscheck discon <ipc>")
    page = report.read_text(encoding="utf-8")
    header, body = page.split("</header>")[0], page.split("</header>")[1]
    # each agent at two speeds; the last loses 10 % in one simulator and 1 % in the other
    assert "wt_gym and openfast agree on what gets better and worse in 6 of 6 changes of fatigue loads" in header
    first = body.split("</section>")[0]
    places = [first.index(mark) for mark in ("class='legend'", "<table>", "class='plot'")]
    assert places == sorted(places)
    assert "\u221220.0 %<small>wt_gym" in first
    assert "\u221215.0 %<small>openfast" in first
    assert "a|b" in first
    assert "wt-gym crosscheck discon &lt;ipc&gt;" in body
    for name in check.names:
        assert f"href='{name}/evaluation.json'" in body
        links = [link.split("'")[0] for link in body.split("href='")[1:] if link.startswith(f"{name}/runs/")]
        assert len(links) == len(WINDS) * len(FLAP)
        assert all((tmp_path / link.replace("%7C", "|")).exists() for link in links)
