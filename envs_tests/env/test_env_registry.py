"""Every id that is registered keeps the contracts of Gymnasium and stable-baselines3, on the real simulator."""

import gymnasium as gym
import pytest
from turbine_contract import both_checkers_are_content

import wt_gym  # noqa: F401 - registers the environments
from wt_gym.envs.wind_sampler import GUSTS
from wt_gym.tasks import TASKS

IDS = sorted(name for name in gym.registry if name.startswith("wt_gym/"))
# Each box of turbulence for a rotor of 240 m takes ten to forty seconds to make where it is not on disk yet.
SLOW = {name for name in IDS if "IEA15MW" in name and gym.spec(name).kwargs["inflow"] == "turbulent"}


def test_every_task_is_among_the_ids():
    assert {env_id for task in TASKS.values() for env_id in task.ids} < set(IDS)
    assert {f"wt_gym/{name}-v0" for name in TASKS} < set(IDS)
    assert 0 < len(SLOW) < len(IDS) / 2


def test_versions_change_what_their_task_says():
    assert gym.spec("wt_gym/Gusts-v1").kwargs == {**gym.spec("wt_gym/Gusts-v0").kwargs, "gusts": GUSTS}
    for turbine in ("LoadReduction", "Turbulent", "Steady"):
        old, new = (gym.spec(f"wt_gym/IEA15MW-{turbine}-v{version}").kwargs for version in (0, 1))
        assert new == {**old, "fidelity": "training-torsion"}


@pytest.mark.parametrize("env_id", [pytest.param(i, marks=pytest.mark.slow) if i in SLOW else i for i in IDS])
def test_checkers_have_nothing_to_say(env_id):
    """In winds of one seed: the checkers reset without a seed of their own."""
    both_checkers_are_content(env_id, wind_seeds=(1,))
