"""Every id that is registered keeps the contracts of Gymnasium and stable-baselines3, on the real simulator."""

import re

import gymnasium as gym
import pytest
from turbine_contract import both_checkers_are_content

import wt_gym  # noqa: F401 - registers the environments
from wt_gym.base.ids import present_id
from wt_gym.envs.wind_sampler import GUSTS
from wt_gym.tasks import TASKS

IDS = sorted(name for name in gym.registry if name.startswith("wt_gym/"))
# Each box of turbulence for a rotor of 240 m takes ten to forty seconds to make where it is not on disk yet.
SLOW = {name for name in IDS if re.search("IEA(15|22)MW", name) and gym.spec(name).kwargs["inflow"] == "turbulent"}
OLD = {name for name in IDS if any(other > name for other in IDS if other[:-1] == name[:-1])}
"""Earlier versions, whose arguments the tests of the present ones exercise."""


def test_every_task_is_among_the_ids():
    assert {env_id for task in TASKS.values() for env_id in task.ids} < set(IDS)
    assert 0 < len(SLOW) < len(IDS) / 2


def test_ids_are_what_their_versions_say():
    assert gym.spec("wt_gym/Gusts-v2").kwargs["gusts"] == GUSTS
    for name in ("LoadReduction", "Turbulent", "Steady"):
        assert gym.spec(f"wt_gym/IEA15MW-{name}-v2").kwargs["fidelity"] == "training-torsion"


@pytest.mark.parametrize("name", sorted({env_id.rpartition("-v")[0] for env_id in IDS}))
def test_an_id_that_is_gone_names_the_present_one(name):
    """Versions with tower signals along global axes cannot be repeated."""
    present = present_id(f"{name}-v0")
    assert present in IDS
    assert present_id(present) == present
    if present != f"{name}-v0":
        newest = max(env_id for env_id in IDS if env_id.rpartition("-v")[0] == name)
        with pytest.raises(gym.error.DeprecatedEnv, match=newest):
            gym.make(f"{name}-v0")


def test_ids_without_a_present_one_stay_as_they_are():
    for env_id in ("wt_gym/LoadReduction-v99", "wt_gym/Nothing-v0", "wt_gym/Nothing", "other"):
        assert present_id(env_id) == env_id


@pytest.mark.parametrize("env_id", [pytest.param(i, marks=pytest.mark.slow) if i in SLOW | OLD else i for i in IDS])
def test_checkers_have_nothing_to_say(env_id):
    """In winds of one seed: the checkers reset without a seed of their own."""
    both_checkers_are_content(env_id, wind_seeds=(1,))
