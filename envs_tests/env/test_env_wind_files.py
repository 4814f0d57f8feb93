"""Files of TurbSim as the wind of episodes."""

import os
import re
import warnings
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from envs_tests.env.scripted_simulator import ScriptedSimulator, use
from wt_gym.analysis.results import Wind
from wt_gym.base.errors import InflowError
from wt_gym.commands import parse as parse_command
from wt_gym.commands.evaluate import configuration
from wt_gym.envs.wind_sampler import TRANSIENTS, WindOptions, WindSampler
from wt_gym.experiment import evaluation
from wt_gym.experiment.evaluation import EvaluationConfig, EvaluationFolder, evaluate, winds_of
from wt_gym.learning.callbacks import SelectionEvaluation
from wt_gym.learning.options import DatasetConfig, TrainingConfig
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow, TurbulenceBox, read_bts, write_bts

TURBINE = load_turbine("nrel_5mw")
STEADY = "wt_gym/NREL5MW-Steady-v1"
DURATION = 42.0


@pytest.fixture
def files(tmp_path):
    """Two periodic files at 12 and 9 m/s and one at 15 m/s that is not."""
    for name, speed, periodic in (("a", 12.0, True), ("b", 9.0, True), ("once", 15.0, False)):
        box = TurbulenceBox.kaimal(speed, 90.0, 126.0, seed=1, duration=DURATION, grid=(3, 3), cache=False)
        write_bts(replace(box, periodic=periodic), tmp_path / f"{name}.bts")
    return tmp_path


def sampled(sampler, n=200, **more):
    rng = np.random.default_rng(0)
    return [sampler.sample(rng, **more) for _ in range(n)]


def test_a_periodic_file_is_entered_anywhere(files):
    sampler = WindSampler(TURBINE, WindOptions(str(files / "a.bts"), None))
    assert (sampler.speeds, sampler.seeds, sampler.options) == ((12.0, 12.0), None, ("time_offset",))
    winds = sampled(sampler, length=120.0)
    offsets = np.array([wind.time_offset for wind in winds])
    assert 0.0 <= offsets.min() < 1.0
    assert DURATION - 1.0 < offsets.max() < DURATION
    assert {wind.wind_seed for wind in winds} == {-1}
    box, hub = read_bts(files / "a.bts"), np.array([[0.0, 0.0, 90.0]])
    first = winds[0]
    k = 7.0 + first.time_offset
    expected = np.interp(k, np.arange(168) * 0.25, box.fluctuation[:, 1, 1, 0], period=DURATION)
    assert first.inflow.velocity(hub, 7.0)[0, 0] == pytest.approx(12.0 + expected, abs=1e-5)
    assert first.inflow.description.startswith("a.bts: ")


def test_episodes_in_a_file_that_is_not_periodic_end_before_it_does(files):
    sampler = WindSampler(TURBINE, WindOptions(str(files / "once.bts"), None))
    offsets = np.array([wind.time_offset for wind in sampled(sampler, length=30.0)])
    assert offsets.min() < 0.5
    assert 11.0 < offsets.max() <= DURATION - 30.0
    assert {wind.time_offset for wind in sampled(sampler, 9)} == {0.0}  # it may last as long as it likes
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert sampler.sample(np.random.default_rng(0), length=DURATION).time_offset == 0.0
    with pytest.warns(UserWarning, match=r"once\.bts is not periodic and lasts 42 s, an episode 43 s"):
        assert sampler.sample(np.random.default_rng(0), length=43.0).time_offset == 0.0


def test_one_of_several_is_drawn_and_inflows_may_be_among_them(files):
    calm = SteadyInflow(8.0)
    several = WindSampler(TURBINE, WindOptions([files / "a.bts", str(files / "b.bts"), calm], None))
    winds = sampled(several)
    assert several.speeds == (8.0, 12.0)
    assert {wind.wind_speed for wind in winds} == {8.0, 9.0, 12.0}
    assert {wind.inflow.description.split(":")[0] for wind in winds} == {"a.bts", "b.bts", calm.description}
    assert {wind.time_offset for wind in winds if wind.inflow is calm} == {0.0}
    assert several.options == ()  # the steady one has no time
    with pytest.raises(InflowError, match="time_offset to files of wind"):
        several.sample(np.random.default_rng(0), time_offset=1.0)
    drawn = WindSampler(TURBINE, WindOptions(lambda rng: files / "b.bts", None)).sample(np.random.default_rng(0))
    assert drawn.wind_speed == 9.0


@pytest.mark.usefixtures("scripted")
def test_environments_know_how_long_their_episodes_are(files):
    """By their own length, the limit of the id, or that of a vector environment."""
    once = str(files / "once.bts")
    for env in (
        gym.make(STEADY, inflow=once, episode_length=40.0),
        gym.make("wt_gym/Gusts-v3", inflow=once, gusts=TRANSIENTS),
        gym.make_vec(STEADY, num_envs=2, inflow=once, episode_length=None, max_episode_steps=200).envs[0],
    ):
        offsets = []
        for seed in range(20):
            env.reset(seed=seed)
            offsets.append(env.unwrapped.episode_wind.time_offset)
        assert 1.5 < max(offsets) <= 2.0 + 1e-9
    env = gym.make(STEADY, inflow=[files / "a.bts"])
    _, info = env.reset(seed=0, options={"time_offset": 3.5})
    assert (env.unwrapped.episode_wind.time_offset, info["wind_speed"], info["wind_seed"]) == (3.5, 12.0, -1)
    env.reset(options={"inflow": files / "b.bts"})
    assert env.unwrapped.episode_wind.time_offset == 0.0
    assert env.unwrapped.episode_wind.wind_speed == 9.0


@pytest.mark.parametrize("several", [False, True])
@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("absent.bts", None, r"cannot read the turbulence file \S+absent\.bts"),
        ("cut.bts", "cut", r"\S+cut\.bts is truncated"),
    ],
)
def test_missing_and_damaged_files_are_refused_when_the_environment_is_made(files, name, content, message, several):
    if content is not None:
        (files / name).write_bytes((files / "a.bts").read_bytes()[:-6] if content == "cut" else content)
    given = str(files / name)
    with pytest.raises(InflowError, match=message) as caught:
        gym.make(STEADY, inflow=[str(files / "a.bts"), given] if several else given)
    assert "\n" not in str(caught.value)


def test_a_file_that_was_replaced_is_read_again(files):
    sampler = WindSampler(TURBINE, WindOptions(files / "a.bts", None))
    sampler.sample(np.random.default_rng(0))
    write_bts(read_bts(files / "b.bts"), files / "a.bts")
    os.utime(files / "a.bts", (1.0, 1.0))
    assert WindSampler(TURBINE, WindOptions(files / "a.bts", None)).speeds == (9.0, 9.0)


@pytest.mark.parametrize("given", ["wind", "wind.bts.txt", Path("wind.dat"), ["steady"]])
def test_other_words_and_paths_are_refused_with_what_is_allowed(given):
    with pytest.raises(InflowError, match=re.escape("'extreme-turbulent'), an Inflow, a file of wind (.bts, .csv")):
        gym.make(STEADY, inflow=given)


def test_paths_outlast_the_working_directory(files, monkeypatch):
    """Commands pass arguments on as JSON and to processes that may run elsewhere."""
    monkeypatch.chdir(files)
    given, whole = {"inflow": [Path("a.bts"), "b.bts"]}, {"inflow": [str(files / "a.bts"), str(files / "b.bts")]}
    configs = (
        TrainingConfig(env_kwargs=given),
        EvaluationConfig(env_kwargs=given),
        DatasetConfig("x", "y/z-v0", env_kwargs=given),
    )
    assert [config.env_kwargs for config in configs] == [whole] * 3
    words = ["--env-kwargs", '{"inflow": "a.bts"}']
    assert configuration(parse_command("evaluate", words)).env_kwargs == {"inflow": str(files / "a.bts")}
    monkeypatch.chdir(files.parent)
    assert gym.make(STEADY, **configs[0].env_kwargs).unwrapped.wind.speeds == (9.0, 12.0)


def test_evaluations_take_pieces_of_files_that_have_nothing_in_common(files):
    sampler = WindSampler(TURBINE, WindOptions([files / "a.bts", files / "once.bts"], None))
    names = [(Path(file.path).name, start) for file, start in sampler.windows(20.0)]
    assert names == [("a.bts", 0.0), ("once.bts", 0.0), ("a.bts", 20.0), ("once.bts", 20.0)]
    assert [start for _, start in sampler.windows(60.0)] == [0.0, 0.0]
    assert WindSampler(TURBINE, WindOptions([files / "a.bts", SteadyInflow(9.0, 90.0)], None)).windows(20.0) == ()
    assert WindSampler(TURBINE, WindOptions(files / "a.bts", None, direction=(-0.1, 0.1))).windows(20.0) == ()
    assert [wind.draw for wind in winds_of(sampler, length=20.0)] == [1, 2, 3, 4]
    assert [wind.draw for wind in winds_of(sampler, draws=3, length=20.0)] == [1, 2, 3]
    with pytest.raises(ValueError, match=r"draws must be at most 4, .* 20 s in the files; got 5"):
        winds_of(sampler, draws=5, length=20.0)


def test_runs_of_an_evaluation_begin_where_the_pieces_do(files, monkeypatch):
    begun = []

    class Watched(ScriptedSimulator):
        def reset(self, **given):
            begun.append(self.inflow.time_offset)
            return super().reset(**given)

    use(monkeypatch, Watched)
    monkeypatch.setattr(evaluation, "run_metrics", lambda *_: {"mean_power": 1.0})
    winds = tuple(Wind(15.0, draw=k) for k in (1, 2))
    config = EvaluationConfig(STEADY, {"inflow": str(files / "once.bts")}, winds, duration=20.0, skip=1.0, replay=0.0)
    evaluate({"a": "constant"}, config, progress=False)
    assert begun[-2:] == [0.0, 20.0]


def test_an_evaluation_is_another_one_where_a_file_has_changed(files, tmp_path):
    config = EvaluationConfig(STEADY, {"inflow": str(files / "a.bts")}, (Wind(12.0, draw=1),))

    def kept():
        with EvaluationFolder(tmp_path / "kept", {"a": "constant"}, config) as folder:
            folder.begin({}, False)

    kept()
    kept()
    (files / "a.bts").write_bytes((files / "b.bts").read_bytes())
    with pytest.raises(ValueError, match="holds another evaluation, with other wind_files"):
        kept()


def test_training_is_watched_in_several_pieces_of_a_file(files):
    config = TrainingConfig(env_id=STEADY, env_kwargs={"inflow": str(files / "a.bts")}, eval_winds=2)
    winds = SelectionEvaluation(config, WindSampler(TURBINE, WindOptions(files / "a.bts", None))).winds
    assert [wind.draw for wind in winds] == [1, 2]
