"""Every id that is registered keeps the contracts of Gymnasium and stable-baselines3, on the real simulator."""

import re

import gymnasium as gym
import pytest
from turbine_contract import both_checkers_are_content

from wt_gym.tasks import TASKS

# linear models are recorded first: envs_tests/unit/test_linear_env.py checks them on one that is made up
IDS = sorted(name for name in gym.registry if name.startswith("wt_gym/") and "-Linear-" not in name)
# Each box of turbulence for a rotor of 240 m takes ten to forty seconds to make where it is not on disk yet.
SLOW = {name for name in IDS if re.search("IEA(15|22)MW", name) and gym.spec(name).kwargs["inflow"] == "turbulent"}


def test_every_task_is_among_the_ids():
    assert {task.id for task in TASKS.values()} < set(IDS)
    assert 0 < len(SLOW) < len(IDS) / 2
    assert len({name.rpartition("-v")[0] for name in IDS}) == len(IDS)  # one version of each


@pytest.mark.parametrize("env_id", [pytest.param(i, marks=pytest.mark.slow) if i in SLOW else i for i in IDS])
def test_checkers_have_nothing_to_say(env_id):
    """In winds of one seed: the checkers reset without a seed of their own."""
    both_checkers_are_content(env_id, wind_seeds=(1,))
