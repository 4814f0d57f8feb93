"""The report holds its parts, and its replay what was recorded."""

import base64
import json
import re
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from wt_gym.analysis.figures import (
    learning_figure,
    median_and_range,
    pareto_figure,
    running_mean,
    time_series_figure,
    trainings,
    verdict_figure,
)
from wt_gym.analysis.metrics import METRICS
from wt_gym.analysis.report import _GROUPS, encode, opening_agent, write_report
from wt_gym.analysis.results import Evaluation, Replay, ReplayRecorder, Run, Wind, kept_filaments, trailing_strength
from wt_gym.analysis.statistics import WindClimate

SPEEDS = (12.0, 16.0)
WINDS = tuple(Wind(speed, seed) for speed in SPEEDS for seed in (1001, 1002, 1003))
MEAN = {key: 1.0 / metric.factor for key, metric in METRICS.items()}
TIME = np.arange(1, 401) * 0.2
FLAP = {"Baseline": 1.0, "<PPO>": 0.8, "ipc": 0.7}
DUTY = {"Baseline": 0.05, "<PPO>": 0.3, "ipc": 0.2}


def geometry(k=0, n_rows=7):
    rng = np.random.default_rng(k)
    return {
        "blades": rng.normal(size=(3, 3, 5, 3)) + np.array([0.0, 0.0, 90.0]),
        "wake": rng.normal(size=(n_rows, 3, 5, 3)) + np.array([0.0, 0.0, 90.0]),
        "wake_circulation": rng.uniform(10, 20, (n_rows - 1, 3, 4)),
        "tower": np.column_stack([np.zeros(4), np.zeros(4), np.linspace(0, 87, 4)]),
        "tower_radius": np.linspace(3, 2, 4),
        "hub": np.array([-5.0, 0.0, 90.0]),
    }


@pytest.fixture(scope="module")
def evaluation():
    wave = np.sin(2 * np.pi * 0.2 * TIME)
    names = ["wind_x", "generator_power", "rotor_speed", "generator_torque", "tower_base_fore_aft_moment",
             "tower_base_side_side_moment", "root_flap_moment_1", "root_edge_moment_1"]  # fmt: skip
    names += [f"{name}_{b}" for name in ("pitch", "tip_out_of_plane") for b in (1, 2, 3)]
    data = xr.Dataset({name: ("time", 5.0 + wave) for name in names}, {"time": TIME})
    recorder = ReplayRecorder(5)
    for k, time in enumerate(TIME):
        if k > 380:
            recorder.append(time, geometry(k, n_rows=5 + k % 3))
    runs = []
    for k, wind in enumerate(WINDS):
        for agent, factor in FLAP.items():
            flap = MEAN["blade_flap_del"] * factor * (1.0 + 0.01 * k * (agent == "ipc"))
            metrics = MEAN | {"blade_flap_del": flap, "pitch_duty_cycle": DUTY[agent]}
            replay = recorder.to_replay() if k == 0 else None
            runs.append(Run(agent, wind, data, metrics, 1.0, {}, 80.0, 80.0, "time", replay=replay))
    steps = np.arange(100, 2100, 100)
    curve = {"steps": steps.tolist(), "episode_return": (steps / 100).tolist(), "episode_length": [60.0] * 20}
    record = {"steps": 2000, "wall_seconds": 60.0, "control_dt": 0.2, "wind_seeds": [1], "curve": curve}
    limits = {"rated_power": 5e6}
    return Evaluation("Turbine", {"skip": 10.0}, runs, "Baseline", limits, {"<PPO>": record}, WindClimate(10.0))


@pytest.fixture(scope="module")
def page(evaluation, tmp_path_factory):
    return write_report(evaluation, tmp_path_factory.mktemp("report") / "report.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def data(page):
    """JSON in the page, by the id of its script."""
    scripts = re.findall(r"<script type='application/json' id='([\w-]+)'>(.*?)</script>", page, re.DOTALL)
    return {name: json.loads(text) for name, text in scripts}


def test_report_answers_first(page):
    body = re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    tags = ("section", "div", "table", "tr", "td", "th", "details", "span", "small", "ul", "li", "p")
    assert all(len(re.findall(rf"<{tag}[ >]", body)) == body.count(f"</{tag}>") for tag in tags)
    assert " ".join(re.findall(r"<section id='(\w+)'", page)) == (
        "verdict summary comparison lifetime pareto replay training0 time spectra runs method"
    )
    headings = re.findall("<h[12]>(.*?)</h[12]>", page)
    assert headings[:2] == ["Turbine: evaluation of controllers", "Is any of these better than Baseline?"]
    assert "<PPO>" not in page.split("<script")[0]  # names are escaped
    assert "&lt;PPO&gt;" in page
    assert "\u221220.0 %<small>[\u221220.0, \u221220.0]</small>" in page  # flap DEL of PPO, the same in every wind
    for address in ("src=", "http-equiv", "@import", "url("):
        assert address not in page.split("<script")[0]


def part(page, name):
    """HTML of a section."""
    return page.split(f"<section id='{name}'>")[1].split("</section>")[0]


def test_the_result_is_one_sentence_before_all_else(page):
    header = page.split("<header>")[1].split("</header>")[0]
    assert (
        "Against Baseline in six winds, ipc lowers flapwise blade fatigue by 28.2\u00a0% at the same power." in header
    )
    for name, value in (("Mean wind speed", "12, 16 m/s"), ("Winds", "6 winds (3 each), turbulent, unseen in training"),
                        ("Duration", "80 s each, without the first 10 s")):  # fmt: skip
        assert f"<dt>{name}</dt><dd>{value}</dd>" in header


def test_legend_then_verdicts_then_picture(page):
    verdict = part(page, "verdict")
    places = [verdict.index(mark) for mark in ("class='legend'", "<table>", "class='plot'")]
    assert places == sorted(places)
    assert verdict.count("1.00 m") == 3  # the reference's and those of both agents


def test_every_metric_is_in_one_group():
    assert sorted(key for keys in _GROUPS.values() for key in keys) == sorted(METRICS)


def test_every_cell_has_its_label_for_narrow_screens(page):
    body = page.split("</style>")[1].split("<script>")[0]
    cells = [cell for table in body.split("<table>")[1:] for cell in table.split("</table>")[0].split("<td")[1:]]
    assert len(cells) > 100
    assert all(cell.startswith("></td>") or "><span class='label'" in cell for cell in cells)


def test_shown_equal_is_another_mark_than_no_difference_seen(evaluation, tmp_path):
    runs = []
    for run in evaluation.runs:
        scatter = run.wind.seed - 1002  # -1, 0 and 1 at each speed
        change = {"ipc": 0.05 * scatter + 0.02, "<PPO>": 0.001 * scatter}.get(run.agent, 0.0)
        runs.append(replace(run, metrics=MEAN | {"blade_flap_del": (1.0 + change) * MEAN["blade_flap_del"]}))
    page = write_report(replace(evaluation, runs=runs, training={}), tmp_path / "report.html").read_text("utf-8")
    rows = {row.split("</th>")[0].split("</i>")[-1]: row for row in part(page, "verdict").split("<tr")[2:]}
    assert "<span class='diff main equal'>" in rows["&lt;PPO&gt;"]
    assert "<span class='badge equal'>Equal" in rows["&lt;PPO&gt;"]
    assert "<span class='diff main open'>" in rows["ipc"]
    assert "<span class='badge open'>No difference seen" in rows["ipc"]
    assert "No agent is better than Baseline in six winds." in page


def test_runs_are_linked(evaluation, page, tmp_path):
    assert "<a href=" not in part(page, "runs")
    files = [f"runs/{run.agent.strip('<>')} {k}.nc" for k, run in enumerate(evaluation.runs)]
    linked = part(write_report(evaluation, tmp_path / "report.html", files=files).read_text("utf-8"), "runs")
    assert [f"href='{file.replace(' ', '%20')}'" in linked for file in files] == [True] * len(files)
    assert "href='metrics.csv'" in linked
    with pytest.raises(ValueError, match="one for each of 18 runs, got 1"):
        write_report(evaluation, tmp_path / "report.html", files=files[:1])


def test_another_simulators_figures_stand_beside(evaluation, tmp_path):
    winds = [run.wind for run in evaluation.runs if run.wind.speed == 12.0]
    one_speed = replace(evaluation, runs=[run for run in evaluation.runs if run.wind in winds], training={})
    change = {"value": -0.25, "low": None, "high": None, "relative": True, "n_winds": 2}
    record = {
        "simulators": ["wt_gym", "openfast"], "baseline": "Baseline", "winds": ["12 m/s, seed 7", "15 m/s, seed 7"],
        "settings": [{}, {"duration": 260.0, "skip": 60.0}],
        "metrics": [{"wind_speed": 12.0, "metric": "blade_flap_del", "changes": {"ipc": [None, change]}}],
    }  # fmt: skip
    page = write_report(one_speed, tmp_path / "report.html", crosscheck=record).read_text("utf-8")
    verdict = part(page, "verdict")
    assert verdict.count("in OpenFAST</th>") == 1  # PPO has none
    assert "\u221225.0 %" in verdict.split("in OpenFAST</th>")[1].split("</tr>")[0]
    assert "in 1 wind of 200 s" in verdict.split("<table>")[0]
    other = write_report(one_speed, tmp_path / "report.html", crosscheck=record | {"baseline": "discon"})
    assert "in OpenFAST</th>" not in other.read_text("utf-8")


@pytest.mark.parametrize(("lengths", "panels"), [([60.0] * 20, 1), ([60.0] * 19 + [31.0], 2)])
def test_lengths_that_are_all_the_same_have_no_axis(evaluation, lengths, panels):
    record = evaluation.training["<PPO>"]
    record = record | {"curve": record["curve"] | {"episode_length": lengths}}
    figure = learning_figure(replace(evaluation, training={"<PPO>": record}), ["<PPO>"])
    assert len(figure.layout.annotations) == panels


def test_verdict_shows_changes_with_intervals(evaluation, data):
    points = [trace for trace in data["changes-data"]["data"] if trace["mode"] == "markers"]
    assert [trace["name"] for trace in points] == ["<PPO>", "ipc"] * 2
    loads = verdict_figure(evaluation).data[-2]
    expected = 100 * (0.7 * (1.0 + 0.01 * np.arange(6)) - 1.0)
    assert loads.x[0] == pytest.approx(expected[1:-1].mean())
    low, high = loads.x[0] - loads.error_x.arrayminus[0], loads.x[0] + loads.error_x.array[0]
    assert expected.min() < low < loads.x[0] < high < expected.max()


def test_front_has_a_panel_a_wind_speed_and_joins_the_best(evaluation):
    figure = pareto_figure(evaluation)
    assert [title.text for title in figure.layout.annotations] == ["12 m/s", "16 m/s"]
    first = [trace for trace in figure.data if trace.xaxis == "x"]
    front, *points = first
    assert {trace.name: (trace.x[0], round(trace.y[0], 1)) for trace in points} == {
        "Baseline": (5.0, 0.0),
        "<PPO>": (30.0, -20.0),
        "ipc": (20.0, -29.3),
    }
    assert front.x == (5.0, 20.0)  # PPO pitches more than ipc for less


def test_replay_holds_what_was_recorded(evaluation, data):
    assert not data["replay-data"]["sea"]
    data = data["replay-data"]
    assert [agent["name"] for agent in data["agents"]] == list(FLAP)
    assert data["dt"] == pytest.approx(0.2)
    replay = evaluation.runs[0].replay
    assert data["agents"][0]["time"] == pytest.approx(replay.time)
    for name in ("blades", "wake", "strength", "hub"):
        entry, values = data["agents"][0]["shapes"][name], getattr(replay, name)
        assert entry["shape"] == list(values.shape)
        raw = np.frombuffer(base64.b64decode(entry["data"]), f"<i{entry['bits'] // 8}").astype(float)
        full = 2 ** (entry["bits"] - 1) - 1
        decoded = np.where(raw < -full, np.nan, entry["offset"] + entry["scale"] * raw / full).reshape(values.shape)
        np.testing.assert_allclose(decoded, values, atol=0.51 * entry["scale"] / full)
    assert encode(np.full(3, 7.0))["offset"] == 7.0


def test_replay_opens_on_the_trained_agent_with_the_lowest_load_else_on_the_last(evaluation):
    agents, record = list(FLAP), evaluation.training["<PPO>"]
    assert opening_agent(evaluation, agents) == "<PPO>"
    assert opening_agent(replace(evaluation, training={"<PPO>": record, "ipc": record}), agents) == "ipc"
    assert opening_agent(evaluation, ["Baseline", "ipc"]) == "ipc"


def test_recorder_keeps_the_end_and_pads_short_wakes(tmp_path):
    recorder = ReplayRecorder(3)
    assert recorder.to_replay() is None
    for k, n_rows in enumerate((9, 4, 6, 5)):
        recorder.append(float(k), geometry(k, n_rows))
    replay = recorder.to_replay()
    assert replay.time.tolist() == [1.0, 2.0, 3.0]
    assert replay.wake.shape == (3, 6, 3, 5, 3)
    assert np.isnan(replay.wake[0, 4:]).all()
    assert np.isfinite(replay.wake[1]).all()
    np.testing.assert_allclose(replay.blades[2], geometry(3)["blades"][:, [0, 2]], rtol=1e-6)
    rings = trailing_strength(geometry(2, 6)["wake_circulation"])
    np.testing.assert_allclose(replay.strength[1], np.concatenate([rings, rings[-1:]]), rtol=1e-6)
    replay.save(tmp_path / "replay.npz")
    np.testing.assert_array_equal(Replay.load(tmp_path / "replay.npz").wake, replay.wake)
    rng = np.random.default_rng(0)
    large = {"wake": rng.normal(size=(300, 3, 21, 3)), "wake_circulation": rng.normal(size=(299, 3, 20))}
    recorder.append(4.0, geometry() | large)
    assert recorder.to_replay().wake.shape == (3, 64, 3, 5, 3)
    assert np.all(np.diff(kept_filaments(17), 2) < 0)  # closer towards the tip


def test_a_floating_turbine_has_its_sea_platform_and_lines(evaluation, tmp_path):
    recorder, line = ReplayRecorder(3), np.linspace([800.0, 0.0, -200.0], [40.0, 0.0, -14.0], 30)
    for k in (0, 1):
        platform = {"platform": np.array([[[0.0, 0.0, -20.0], [0.0, 0.0, 10.0]]]), "platform_radius": np.array([6.0])}
        sea = np.stack([*np.mgrid[0.0:3.0, 0.0:2.0], np.full((3, 2), 1.0 - 2.0 * k)], axis=2)
        recorder.append(TIME[k], geometry(k) | platform | {"lines": line[None], "sea": sea})
    replay = recorder.to_replay()
    assert replay.floater_radius.tolist() == [6.0] + 12 * [0.0]
    assert np.allclose(replay.floater[0, 1:, 0][0], line[0])
    assert np.allclose(replay.floater[0, -1, 1], line[-1])

    names = ("wave_elevation", "platform_pitch", "platform_surge", "fairlead_tension_1", "fairlead_tension_2")
    more = {name: evaluation.runs[0].data.wind_x * (k + 1) for k, name in enumerate(names)}
    runs = []
    for run in evaluation.runs:
        sea = f"Hs {run.wind.speed / 4:g} m, Tp 9.68 s, towards {run.wind.seed - 1003} deg"
        runs.append(replace(run, data=run.data.assign(more).assign_attrs(sea=sea), replay=replay))
    floating = replace(evaluation, runs=runs)
    land, figure = (time_series_figure(one, WINDS[0]) for one in (evaluation, floating))
    added = [trace.name for trace in figure.data if trace.yaxis in ("y8", "y9", "y10", "y11")]
    assert sorted(added) == sorted(["sea"] + 3 * list(FLAP))
    assert len(figure.data) == len(land.data) + len(added)
    tensions = next(trace.y for trace in figure.data if trace.yaxis == "y11")
    assert np.allclose(tensions, 5e-6 * runs[0].data.wind_x, rtol=1e-3)

    page = write_report(floating, tmp_path / "report.html").read_text(encoding="utf-8")
    shown = json.loads(re.search(r"id='replay-data'>(.*?)</script>", page, re.DOTALL)[1])
    assert shown["sea"]
    assert shown["floater_radius"] == [6.0] + 12 * [0.0]
    assert np.shape(shown["sea_place"]) == (3, 2, 2)
    assert shown["agents"][0]["shapes"]["sea"] == encode([[[1.0] * 2] * 3, [[-1.0] * 2] * 3], 8)
    assert "<dt>Sea</dt><dd>Hs 3 to 4 m, Tp 9.68 s, towards \u22122 to 0 deg</dd>" in page
    assert part(page, "verdict").count("Platform pitch, std</span>1.000 deg") == 3


def test_seeds_of_a_training_share_a_figure(evaluation):
    record = evaluation.training["<PPO>"]
    config = {"algorithm": "PPO", "gamma": 0.98}

    def seed(number, offset):
        curve = record["curve"] | {"episode_return": [value + offset for value in record["curve"]["episode_return"]]}
        return record | {"algorithm": "PPO", "config": config | {"seed": number}, "curve": curve}

    training = {"Baseline": seed(0, 0.0), "<PPO>": seed(1, 5.0), "ipc": seed(2, 1.0)}
    several = Evaluation("Turbine", {}, evaluation.runs, "Baseline", training=training)
    assert trainings(several) == [["Baseline", "<PPO>", "ipc"]]
    low, high, median = learning_figure(several, trainings(several)[0]).data[:3]
    np.testing.assert_allclose(median.y, low.y + 1.0)
    np.testing.assert_allclose(high.y, low.y + 5.0)
    other = training | {"ipc": seed(2, 1.0) | {"config": {"gamma": 0.9, "seed": 2}}}
    assert trainings(replace(several, training=other)) == [["Baseline", "<PPO>"], ["ipc"]]


def test_curves_are_compared_where_all_of_them_are():
    curves = [(np.array([0.0, 10.0]), np.array([0.0, 10.0])), (np.array([2.0, 6.0]), np.array([0.0, 0.0]))]
    steps, median, low, high = median_and_range(curves)
    assert (steps[0], steps[-1]) == (2.0, 6.0)
    np.testing.assert_allclose(median, steps / 2)
    np.testing.assert_allclose([low, high], [0.0 * steps, steps])
    assert running_mean(np.array([1.0, 2.0, 6.0]), 1).tolist() == [1.5, 3.0, 4.0]
