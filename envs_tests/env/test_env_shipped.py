"""The agents that come with the project."""

import json
from itertools import filterfalse

import pytest

from wt_gym.analysis.results import Wind
from wt_gym.base.files import shipped_folder
from wt_gym.commands import parse as parse_command
from wt_gym.commands.train import configuration
from wt_gym.envs.options import registered_arguments
from wt_gym.experiment.benchmark_tasks import load_task
from wt_gym.experiment.evaluation import EvaluationConfig, evaluate
from wt_gym.experiment.trained_agent import TrainedAgent

FOLDERS = sorted(path.parent for path in (shipped_folder() / "trained").glob("*/model.zip"))


def moves_blades(folder):
    """Whether an agent acts by the pitch."""
    return any(name.startswith("pitch") for name in TrainedAgent.load(folder).record["action"])


def of_the_pitch():
    """Agents that act by the pitch; a simulator of the IEA turbines takes minutes to compile and to start."""
    for folder in filter(moves_blades, FOLDERS):
        large = "/IEA" in TrainedAgent.load(folder).record["config"]["env_id"]
        yield pytest.param(folder, id=folder.name, marks=[pytest.mark.slow] if large else [])


def in_a_wind(folder, wind, duration, skip):
    """Metrics in a wind that an agent has not seen: of its task's controller, of what it acts on, and of the agent."""
    record = TrainedAgent.load(folder).record
    assert wind.seed not in record["wind_seeds"]
    config = record["config"]
    env_id = config["env_id"]
    baseline = registered_arguments(env_id, {}).get("controller", "baseline")
    base = config["env_kwargs"].get("controller", baseline)
    evaluation = EvaluationConfig(env_id, {"start": "steady"}, (wind,), duration=duration, skip=skip)
    runs = evaluate({"agent": str(folder), baseline: baseline, base: base}, evaluation).runs
    found = {run.agent: run.metrics for run in runs}
    return found[baseline], found[base], found["agent"]


def improvement(metrics, base):
    """Of the cost of energy [-]; short runs outside the benchmark have the mean power for what it counts of it."""
    power = [{"captured_power": each["mean_power"]} for each in (metrics, base)]
    return load_task("load-reduction-18").improvement(metrics | power[0], base | power[1])


@pytest.mark.parametrize("folder", list(of_the_pitch()))
def test_an_agent_of_the_pitch_spares_the_blades(folder):
    """Two minutes at 18 m/s, where all agents act. Pages have the means over many winds, of a per cent and less."""
    baseline, base, agent = in_a_wind(folder, Wind(18.0, 1014), 120.0, 10.0)
    assert agent["blade_flap_del"] < 0.85 * baseline["blade_flap_del"]
    assert agent["mean_power"] > 0.99 * baseline["mean_power"]
    assert improvement(agent, base) > 0.003


@pytest.mark.parametrize("folder", list(filterfalse(moves_blades, FOLDERS)), ids=lambda path: path.name)
def test_an_agent_of_the_torque_makes_more_energy(folder):
    """Two minutes at 8 m/s, with what the rotor stores counted as energy."""
    baseline, _, agent = in_a_wind(folder, Wind(8.0, 1013), 120.0, 20.0)
    assert agent["corrected_power"] > 1.004 * baseline["corrected_power"]


def not_a_number(name):
    raise ValueError(f"{name} is not JSON")


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda path: path.name)
def test_its_record_is_strict_json(folder):
    """A figure that is not finite is one of a training that went wrong."""
    json.loads((folder / "training.json").read_text(encoding="utf-8"), parse_constant=not_a_number)


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda path: path.name)
def test_its_file_is_the_training_of_its_record(folder):
    config = configuration(parse_command("train", ["--config", str(folder / "training.yml")]))
    record = TrainedAgent.load(folder).record["config"]
    assert config.continues(record)
    assert (config.seed, config.total_steps) == (record["seed"], record["total_steps"])
