"""The agents that come with the project."""

from pathlib import Path

import numpy as np
import pytest

import wt_gym
from wt_gym.agents.evaluation import EvaluationConfig, evaluate
from wt_gym.agents.trained_agent import TrainedAgent
from wt_gym.analysis.results import Wind
from wt_gym.commands.train import configuration, parse_arguments
from wt_gym.envs.options.environment import registered_arguments
from wt_gym.ids import present_id

FOLDERS = sorted(path.parent for path in (Path(wt_gym.agents.__file__).parent / "trained").glob("*/model.zip"))


def test_there_are_agents():
    assert FOLDERS


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda path: path.name)
def test_it_spares_the_blades_in_a_wind_it_has_not_seen(folder):
    """A minute at 16 m/s against the controller of its task; wt-gym evaluate measures the damage of ten minutes."""
    wind = Wind(16.0, 1013)
    record = TrainedAgent.load(folder).record
    assert wind.seed not in record["wind_seeds"]
    env_id = present_id(record["config"]["env_id"])
    config = EvaluationConfig(env_id=env_id, winds=(wind,), duration=60.0, skip=10.0)
    baseline = registered_arguments(env_id, {}).get("controller", "baseline")
    found = evaluate({"baseline": baseline, "agent": str(folder)}, config)
    flap, power = ([run.metrics[name] for run in found.runs] for name in ("blade_flap_del", "mean_power"))
    assert np.isfinite(flap).all()
    assert flap[1] < 0.95 * flap[0]
    assert power[1] > 0.99 * power[0]


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda path: path.name)
def test_its_file_is_the_training_of_its_record(folder):
    config = configuration(parse_arguments(["--config", str(folder / "training.yml")]))
    record = TrainedAgent.load(folder).record["config"]
    assert config.continues(record | {"env_id": present_id(record["env_id"])})
    assert (config.seed, config.total_steps) == (record["seed"], record["total_steps"])
