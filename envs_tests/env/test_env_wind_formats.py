"""Winds from files and descriptions, still air, storms and sites, wherever an environment or a command takes them."""

import json
import warnings

import gymnasium as gym
import numpy as np
import pytest

from envs_tests.hawc2 import write_hawc2
from wt_gym.base.errors import InflowError, SimulationError, TurbineDefinitionError
from wt_gym.commands import evaluate
from wt_gym.commands import parse as parse_command
from wt_gym.commands import run as run_command
from wt_gym.commands.options import environment_of, wind_word
from wt_gym.commands.train import configuration
from wt_gym.envs.options import wind_files_of, with_whole_paths
from wt_gym.envs.wind_sampler import WindOptions, WindSampler
from wt_gym.experiment.evaluation import EvaluationConfig
from wt_gym.simulation import Simulator
from wt_gym.turbines import load_turbine
from wt_gym.wind import SeriesInflow, SteadyInflow, TurbulenceBox, TurbulentInflow, read_bts, write_bts

TURBINE = load_turbine("nrel_5mw")
STEADY = "wt_gym/NREL5MW-Steady-v1"
HUB = np.array([[0.0, 0.0, 90.0]])


@pytest.fixture
def files(tmp_path):
    """One wind of each format, by suffix; ``small`` does not reach around the rotor."""
    box = TurbulenceBox.kaimal(12.0, 90.0, 126.0, seed=1, duration=40.0, grid=(5, 5), cache=False)
    small = TurbulenceBox.kaimal(12.0, 90.0, 126.0, seed=1, duration=40.0, grid=(3, 3), width=54.0, cache=False)
    write_bts(box, tmp_path / "a.bts")
    write_bts(small, tmp_path / "small.bts")
    (tmp_path / "a.csv").write_text("time,speed\n0,8\n20,8\n20,12\n")
    (tmp_path / "a.wnd").write_text("0 9 10 0 0 0.2 0 0\n100 9 10 0 0 0.2 0 0\n")
    parts = [str(tmp_path / f"{name}.bin") for name in "uvw"]
    spacing = write_hawc2(box, parts)
    hawc2 = {"file": parts, "shape": [160, 5, 5], "spacing": list(spacing), "mean_speed": 12.0, "shear_exponent": 0.2}
    told = {**hawc2, "file": [f"{name}.bin" for name in "uvw"]}
    (tmp_path / "hawc2.json").write_text(json.dumps(told))
    return {
        ".bts": str(tmp_path / "a.bts"), ".csv": str(tmp_path / "a.csv"), ".wnd": str(tmp_path / "a.wnd"),
        "hawc2": hawc2, ".json": str(tmp_path / "hawc2.json"), "small": str(tmp_path / "small.bts"),
    }  # fmt: skip


@pytest.mark.usefixtures("scripted")
@pytest.mark.parametrize(
    ("form", "kind", "speed"),
    [
        (".bts", TurbulentInflow, 12.0), (".csv", SeriesInflow, 8.0), (".wnd", SeriesInflow, 9.0),
        ("hawc2", TurbulentInflow, 12.0), (".json", TurbulentInflow, 12.0),
    ],
)  # fmt: skip
def test_environments_take_every_format(files, form, kind, speed):
    env = gym.make(STEADY, inflow=files[form], episode_length=10.0)
    _, info = env.reset(seed=3)
    wind = env.unwrapped.episode_wind
    assert isinstance(wind.inflow, kind)
    assert info["wind_speed"] == speed
    if kind is SeriesInflow:
        assert wind.time_offset == 0.0  # a series is met from its beginning
        _, _ = env.reset(seed=4, options={"time_offset": 25.0})
        expected = 12.0 if form == ".csv" else 9.0
        velocity = env.unwrapped.episode_wind.inflow.velocity(HUB, 0.0)[0]
        assert np.hypot(*velocity[:2]) == pytest.approx(expected)
    else:
        offsets = {env.reset(seed=s) and env.unwrapped.episode_wind.time_offset for s in range(4)}
        assert len(offsets) == 4
    given = env.reset(options={"inflow": files[".csv"]})[1]
    assert given["wind_speed"] == 8.0


@pytest.mark.usefixtures("scripted")
def test_winds_without_a_file_are_described_too():
    env = gym.make(STEADY, inflow={"kind": "step", "before": 7.0, "after": 11.0, "time": 5.0})
    _, _ = env.reset(seed=0)
    inflow = env.unwrapped.episode_wind.inflow
    assert inflow.hub_height == 90.0
    assert [inflow.velocity(HUB, t)[0, 0] for t in (0.0, 5.0)] == [7.0, 11.0]
    started = env.unwrapped.signals["rotor_speed"]
    env.reset(options={"inflow": SteadyInflow(7.0)})
    assert env.unwrapped.signals["rotor_speed"] == started  # of the wind at the start, not of the mean
    with pytest.raises(InflowError, match="has no option 'befor'"):
        gym.make(STEADY, inflow={"kind": "step", "befor": 7.0})


@pytest.mark.usefixtures("scripted")
def test_a_grid_that_does_not_reach_around_the_rotor_is_refused_everywhere(files):
    numbers = "y from -27 to 27 m and z from 63 to 117 m; the rotor needs y from -63 to 63 m and z from 27 to 153 m"
    box = TurbulentInflow(read_bts(files["small"]))
    for given in (files["small"], [SteadyInflow(8.0), box]):
        with pytest.raises(InflowError, match=numbers):
            gym.make(STEADY, inflow=given)
    with pytest.raises(InflowError, match=numbers):
        gym.make(STEADY, inflow=lambda rng: box).reset(seed=0)
    with pytest.warns(UserWarning, match=numbers):
        held = gym.make(STEADY, inflow={"file": files["small"], "beyond_grid": "hold"})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        held.reset(seed=0)
    assert "held at the edge of its grid" in held.unwrapped.episode_wind.inflow.description


def test_simulators_take_descriptions_and_refuse_what_is_no_wind(files):
    simulator = Simulator(TURBINE, inflow=files[".csv"])
    assert simulator.inflow.mean_speed == 8.0
    simulator.inflow = {"kind": "steady", "speed": 0.0}
    assert simulator.inflow == SteadyInflow(0.0, TURBINE.hub_height)
    with pytest.raises(SimulationError, match="needs an inflow with velocity"):
        simulator.inflow = 8.0


def test_whole_paths_and_digests_of_every_format(files, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    given = {"inflow": [{**files["hawc2"], "file": ["u.bin", "v.bin", "w.bin"]}, "a.csv", "hawc2.json"]}
    whole = with_whole_paths(given)["inflow"]
    assert whole == [files["hawc2"], files[".csv"], files[".json"]]
    json.dumps(whole)
    digests = wind_files_of({"inflow": whole})
    assert set(digests) == {*files["hawc2"]["file"], files[".csv"], files[".json"]}
    config = EvaluationConfig(STEADY, given)
    assert config.env_kwargs["inflow"] == whole
    (tmp_path / "u.bin").write_bytes((tmp_path / "v.bin").read_bytes())
    changed = wind_files_of({"inflow": whole})
    assert [path for path in digests if changed[path] != digests[path]] == [files["hawc2"]["file"][0]]


@pytest.mark.parametrize("speed", [0.7, 50.0])
def test_a_box_is_made_at_no_more_than_twice_the_speed(speed):
    options = WindOptions("turbulent", speed)
    box = WindSampler(TURBINE, options).sample(np.random.default_rng(0), wind_seed=3).inflow.box
    assert box.mean_speed == speed
    assert box.time_step <= 0.5


@pytest.mark.usefixtures("scripted")
@pytest.mark.parametrize("action_mode", ["rate", "absolute", "residual"])
def test_environments_start_in_still_air_and_in_a_storm(action_mode):
    env = gym.make(STEADY, wind_speed=(0.0, 30.0), action_mode=action_mode)
    for speed in (30.0, 0.0):
        observation, info = env.reset(seed=1, options={"wind_speed": speed})
        assert np.isfinite(observation).all()
        assert info["wind_speed"] == speed
    assert env.unwrapped.demand.generator_torque == 0.0


@pytest.mark.usefixtures("scripted")
def test_a_site_reaches_the_environment():
    env = gym.make(STEADY, site={"air_density": 1.0, "cut_out": 30.0, "turbulence_class": "A"}, inflow="turbulent")
    turbine = env.unwrapped.turbine
    assert (turbine.air_density, turbine.cut_out, turbine.turbulence_class) == (1.0, 30.0, "A")
    env.reset(seed=0, options={"wind_speed": 12.0})
    assert "class A" in env.unwrapped.episode_wind.inflow.description
    twin = gym.make(STEADY, site={"air_density": 1.0}, action_mode="residual", relative_reward=True)
    assert twin.unwrapped.terms["twin"].env.turbine.air_density == 1.0
    with pytest.raises(TurbineDefinitionError, match="did you mean 'cut_out'"):
        gym.make(STEADY, site={"cutout": 30.0})


def test_words_of_the_command_line(files):
    assert wind_word(' {"kind": "step"}') == {"kind": "step"}
    more = ["--env-kwargs", '{"site": {"cut_in": 4.0}}', "--site", "cut_out=30", "--wind", "a.csv"]
    kwargs = environment_of(parse_command("evaluate", more))
    assert kwargs == {"site": {"cut_in": 4.0, "cut_out": 30.0}, "inflow": "a.csv"}
    words = ["--site", "air_density=1.1", "--wind", files[".csv"], files[".wnd"], "--env", STEADY]
    config = evaluate.configuration(parse_command("evaluate", [*words, "--duration", "40"]))
    assert config.env_kwargs == {"site": {"air_density": 1.1}, "inflow": [files[".csv"], files[".wnd"]]}
    trained = configuration(parse_command("train", words))
    assert trained.env_kwargs == config.env_kwargs
    for wrong in (["--site", "air_density"], ["--wind", files[".csv"], "--wind-speed", "8"]):
        with pytest.raises(SystemExit):
            parse_command("simulate", wrong)


def test_simulate_runs_in_winds_from_files(files, tmp_path, capsys):
    out = tmp_path / "run.nc"
    words = ["--wind", files[".csv"], json.dumps({"kind": "steady", "speed": 7.0}), "--duration", "2"]
    run_command("simulate", [*words, "--out", str(out), "--site", "air_density=1.1", "--json"])
    printed = json.loads(capsys.readouterr().out.strip().splitlines()[-1])
    assert [point["wind_m_s"] for point in printed["points"]] == [8.0, 7.0]
    assert (tmp_path / "run_a.nc").is_file()
    assert (tmp_path / "run_steady.nc").is_file()
