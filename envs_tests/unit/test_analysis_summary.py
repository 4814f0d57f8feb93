"""The words of the report follow from the numbers."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from wt_gym.analysis.figures import spectra_figure, time_series_figure
from wt_gym.analysis.metrics import METRICS
from wt_gym.analysis.page import difference_class, format_difference
from wt_gym.analysis.report import write_report
from wt_gym.analysis.results import Evaluation, Run, Wind
from wt_gym.analysis.statistics import relative_change
from wt_gym.analysis.summary import format_value, headline, result_sentence, summarize, unseen, verdict

WINDS = (Wind(12.0, 1001), Wind(12.0, 1002))
TIME = np.arange(1, 401) * 0.2
MEAN = {key: 1.0 / metric.factor for key, metric in METRICS.items()} | {"overspeed_count": 0.0}


def run(agent, wind, ending="time", **changes):
    wave = np.sin(2 * np.pi * 0.2 * TIME)
    names = ("wind_x", "generator_power", "rotor_speed", "generator_torque", "pitch_1", "tip_out_of_plane_1",
             "tower_base_fore_aft_moment", "tower_base_side_side_moment", "root_flap_moment_1",
             "root_edge_moment_1")  # fmt: skip
    data = xr.Dataset({name: ("time", 5.0 + wave) for name in names}, {"time": TIME})
    duration = 80.0
    if ending != "time":
        data, duration = data.isel(time=slice(0, 200)), 40.0
    return Run(agent, wind, data, MEAN | changes, 10.0, {"power": 10.0}, 80.0, duration, ending)


def evaluation(training=None, endings=("time", "time"), **changes):
    runs = [run("Baseline", wind) for wind in WINDS]
    runs += [run("PPO", wind, ending, **changes) for wind, ending in zip(WINDS, endings, strict=True)]
    settings = {"skip": 10.0, "fidelity": "training", "control_dt": 0.2}
    return Evaluation("Turbine", settings, runs, "Baseline", {"rated_power": 5e6}, training or {})


def record(**changes):
    curve = {"steps": [10, 20], "episode_return": [1.0, 2.0], "episode_length": [10.0, 20.0]}
    return {"steps": 36_000, "wall_seconds": 180.0, "control_dt": 0.2, "wind_seeds": [1, 2], "curve": curve} | changes


def test_values_and_differences_are_shown_in_their_unit():
    assert format_value("pitch_duty_cycle", -0.0345) == "\u22123.45"
    assert format_difference("mean_power", 4.5e6, 5e6) == "\u221210.0 %"
    assert format_difference("overspeed_count", 3.0, 1.0) == "+2.0"
    assert format_difference("pitch_travel", np.radians(5.0), 0.0) == "+5.0 deg"
    assert format_difference("tip_clearance_min", -0.2, 0.3) == "\u22120.50 m"
    assert format_difference("yaw_travel", 0.0, 0.0) == "="
    for key, value, reference, kind in (
        ("mean_power", 5.2e6, 5e6, "better"), ("mean_power", 4.8e6, 5e6, "worse"), ("mean_power", 5.02e6, 5e6, "equal"),
        ("tower_fore_aft_del", 4e6, 5e6, "better"), ("tip_clearance_min", 4.0, 5.0, "worse"),
        ("rotor_speed_mean", 1.0, 2.0, "none"), ("overspeed_count", 1.0, 0.0, "worse"),
    ):  # fmt: skip
        assert difference_class(key, value, reference) == kind


def test_relative_changes_against_zero_have_no_number():
    changes = relative_change([1.5, 0.5, -1.5, 2.0, 0.0], [1.0, 1.0, -3.0, 0.0, 0.0])
    np.testing.assert_array_equal(changes, [0.5, -0.5, 0.5, np.nan, 0.0])
    assert relative_change(2.0, 1.0) == 1.0


SAID = {
    "better": "ahead of", "worse": "does not reach", "trade": "That is a trade", "equal": "do equally well",
    "open": "No difference between",
}  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "kind", "sentence"),
    [
        ({"blade_flap_del": 0.8e6}, "better", "PPO lowers flapwise blade fatigue by 20.0 % at the same power."),
        (
            {"blade_flap_del": 0.8e6, "tower_side_side_del": 1.1e6, "pitch_travel": np.radians(4.0)},
            "trade",
            "PPO lowers flapwise blade fatigue by 20.0 % and raises side-side tower fatigue by 10.0 % at the same power"
            " and with 4.0 times the pitch travel.",
        ),
        ({"corrected_power": 1.02e6}, "better", "PPO makes 2.0 % more power."),
        (
            {"tower_fore_aft_del": 2.5e6},
            "worse",
            "PPO is not better than Baseline: it raises fore-aft tower fatigue by a factor of 2.5 at the same power.",
        ),
        (
            {"pitch_travel": np.radians(1.5)},
            "worse",
            "PPO is not better than Baseline: it needs 50.0 % more pitch travel.",
        ),
        ({"corrected_power": 0.4e6, "tower_fore_aft_del": 0.5e6}, "worse", None),
        ({"corrected_power": 0.97e6, "tower_fore_aft_del": 0.5e6}, "trade", None),
        ({}, "equal", "PPO and Baseline do equally well."),
        # two winds give no interval that shows it to be small
        ({"corrected_power": 1.001e6}, "open", "No difference is seen between PPO and Baseline."),
    ],
)
def test_the_result_in_words(changes, kind, sentence):
    result = evaluation(**changes)
    assert verdict(result, "PPO").kind == kind
    assert SAID[kind] in summarize(result)[1]
    shown = result_sentence(result).replace("\u00a0", " ")
    assert "in two winds" in shown
    if sentence is not None:
        assert shown.replace("Against Baseline in two winds, ", "").replace(" in two winds.", ".") == sentence


def test_the_base_controller_and_learning_have_their_own_parts():
    """The agent PPO on the controller "linear", which is compared too; and the wear of a pitch bearing."""
    result = evaluation(blade_flap_del=0.6e6, pitch_duty_cycle=0.3)
    base = [
        replace(run, agent="linear", metrics=run.metrics | {"blade_flap_del": 0.8e6}) for run in result.runs_of("PPO")
    ]
    training = {"PPO": record(environment={"controller": "linear"})}
    both = replace(result, runs=[*result.runs, *base], training=training)
    shown = result_sentence(both).replace("\u00a0", " ")
    assert shown == (
        "Against Baseline in two winds, linear alone lowers flapwise blade fatigue by 20.0 % at the same power; with "
        "learning on top of it, PPO lowers flapwise blade fatigue by 40.0 % at the same power."
    )
    assert "typical individual pitch control has 20 % at 15 m/s" in " ".join(summarize(both)).replace("\u00a0", " ")


def test_an_early_end_is_told_and_not_compared(tmp_path):
    result = evaluation(endings=("time", "overspeed"), mean_power=2e6)
    text = summarize(result)[1]
    assert "ended early" in result_sentence(result)
    assert "lost the turbine in one of two winds (overspeed after 40 s at 12 m/s, seed 1002)" in text
    assert "produced 75 % of the energy" in text
    assert "cannot replace Baseline" in text
    assert "ahead" not in text
    page = write_report(result, tmp_path / "report.html").read_text(encoding="utf-8")
    assert "1 of 2" in page
    assert "\u2020" in page


def test_what_all_have_in_common_is_said_once():
    both = evaluation()
    assert summarize(both)[0].startswith("Both kept the turbine running in both winds. Baseline made 1.000 MW")
    assert " ".join(summarize(both)).count("kept the turbine running") == 1
    lost = [replace(one, ending="overspeed", duration=40.0) if one.wind == WINDS[1] else one for one in both.runs]
    text = summarize(replace(both, runs=lost))
    assert text[0] == "Both lost the turbine in one wind (12 m/s, seed 1002: overspeed after 40 s)."
    assert " ".join(text).count("lost the turbine") == 1
    ran = [replace(one, metrics=one.metrics | {"overspeed_count": 2.0}) for one in both.runs]
    assert "in number of events: Baseline 4, PPO 4." in summarize(replace(both, runs=ran))[0]


def test_trainings_are_named_as_such():
    def words(**changes):
        return summarize(evaluation(training={"PPO": record(**changes)}))

    assert words()[1].startswith("PPO was trained for 3.0 min on 36\u202f000 control steps (2.0 h")
    assert "the short training of PPO" in words()[-1]
    assert "short training" not in words(steps=2_000_000)[-1]
    pretrained = words(steps=0, pretraining={"seconds": 150.0})
    assert pretrained[1].startswith("PPO was pretrained on an identified model in 2.5 min. PPO made")
    assert "short training" not in pretrained[-1]
    assert "its checkpoint after 18\u202f000 steps" in words(checkpoint=18_000)[1]


@pytest.mark.parametrize(
    ("seeds", "winds", "words"),
    [
        ([1, 2], WINDS, "two unseen winds"),
        ([5, 1002], WINDS, "two winds"),
        (None, WINDS, "two winds"),  # nobody knows them
        ([], WINDS, "two unseen winds"),
        ([], (Wind(12.0),), "one wind"),  # without a seed it may have been met
    ],
)
def test_unseen_winds_are_only_those(seeds, winds, words):
    runs = [run(agent, wind) for agent in ("Baseline", "PPO") for wind in winds]
    result = replace(evaluation(training={"PPO": record(wind_seeds=seeds)}), runs=runs)
    assert unseen(result) is ("unseen" in words)
    assert headline(result) == f"PPO against Baseline in {words}"


def test_notes_on_trainings_are_shown_and_no_wind_is_called_unseen_then(tmp_path):
    note = "PPO was trained on wind seed 1001 of this evaluation: <its> figures there are no test in unseen winds."
    result = replace(evaluation(training={"PPO": record()}), notes={"PPO": note})
    assert note in summarize(result)
    assert not unseen(result)
    page = write_report(result, tmp_path / "report.html").read_text(encoding="utf-8")
    assert note.replace("<its>", "&lt;its&gt;") in page
    result.save(tmp_path)
    assert Evaluation.load(tmp_path).notes == {"PPO": note}


def test_runs_that_fail_at_once_are_reported(tmp_path):
    result = evaluation()
    nothing = {"data": result.runs[0].data.isel(time=[0]), "metrics": {}, "duration": 0.0, "ending": "failure"}
    result = replace(result, runs=[replace(one, **nothing) for one in result.runs])
    text = " ".join(summarize(result))
    assert "nan" not in text
    assert "the simulation failed after 0 s" in text
    write_report(result, tmp_path / "report.html")


def test_baseline_alone():
    alone = Evaluation("Turbine", {}, [run("Baseline", wind) for wind in WINDS], "Baseline")
    assert headline(alone) == "Baseline in two winds"
    assert summarize(alone)[0].startswith("Baseline kept the turbine running in both winds.")


def test_figures_hold_every_agent():
    result = evaluation(endings=("time", "standstill"))
    assert len(time_series_figure(result, WINDS[1]).data) == 1 + 2 * 6
    spectra = spectra_figure(result, skip=10.0)
    assert len(spectra.data) == 2 * 4
    peak = spectra.data[0].x[np.argmax(spectra.data[0].y)]
    assert peak == pytest.approx(0.2, abs=0.02)


def test_an_evaluation_as_a_table():
    found = evaluation(endings=("time", "overspeed"), mean_power=2e6)
    short = replace(found.runs[-1], wind=Wind(8.0), metrics={})
    table = replace(found, runs=[*found.runs[:-1], short]).to_dataframe()
    assert list(table.columns) == ["agent", "wind_speed", "wind_seed", "wind", "ending", "duration", "episode_return",
                                   *METRICS]  # fmt: skip
    assert table.wind_seed[:3].tolist() == [1001, 1002, 1001]
    assert table.wind_seed.isna().tolist() == [False, False, False, True]
    assert table.mean_power[2] == 2e6
    assert np.isnan(table.mean_power[3])
