"""The records of running turbines that come with the package."""

from unittest.mock import Mock

import gymnasium as gym
import numpy as np
import pytest

from wt_gym.base.canary import canary_differences
from wt_gym.envs import running_record
from wt_gym.envs.record_store import CATALOG, FOLDER, StartFile
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.turbine_records import RECORDS


def test_the_package_has_a_file_for_each_record_and_no_other():
    assert {path.stem for path in FOLDER.glob("*.npz")} == {recorded.name for recorded in CATALOG}


@pytest.mark.parametrize("recorded", CATALOG, ids=[recorded.name for recorded in CATALOG])
def test_a_file_says_of_what_it_is_a_record(recorded):
    head = StartFile.of(FOLDER / f"{recorded.name}.npz")
    assert (head.controller, head.level, head.fidelity) == (recorded.controller, recorded.level, recorded.run_fidelity)


def test_turbines_are_recorded_at_the_fidelity_of_their_environments():
    chosen = {recorded.turbine: recorded.run_fidelity for recorded in CATALOG}
    assert chosen["iea_15mw_monopile"] == "training-torsion"
    for name, record in RECORDS.items():
        assert record.arguments.get("fidelity", chosen[name]) == chosen[name]


@pytest.mark.slow
@pytest.mark.parametrize("recorded", CATALOG, ids=[recorded.name for recorded in CATALOG])
def test_the_program_moves_the_turbine_as_the_one_that_recorded_it(recorded):
    """If it fails: wt-gym record --package."""
    assert canary_differences(StartFile.of(FOLDER / f"{recorded.name}.npz").canary, recorded.canary()) == []


def test_a_power_tracking_controller_starts_with_its_recorded_memory(monkeypatch):
    remembered = Mock(wraps=running_record.remember)
    monkeypatch.setattr(running_record, "remember", remembered)
    gym.make("wt_gym/PowerTracking-v1").reset(seed=1)
    assert remembered.called


@pytest.mark.parametrize("recorded", CATALOG, ids=[recorded.name for recorded in CATALOG])
def test_a_second_reset_with_the_seed_gives_the_same_episode(recorded, monkeypatch):
    """Controllers that have run hold numbers that new ones do not; the recorded memory goes into both."""
    remembered = Mock(wraps=running_record.remember)
    monkeypatch.setattr(running_record, "remember", remembered)
    env = WindTurbineEnv(recorded.turbine, inflow="turbulent", action_mode="residual", controller=recorded.controller)
    nothing, episodes = np.zeros(env.action_space.shape, np.float32), []
    for _ in range(2):
        env.reset(seed=2)  # in winds of every record
        episodes.append([env.step(nothing)[0] for _ in range(3)])
    np.testing.assert_array_equal(*episodes)
    # the numbers are in their present order; the record at another level serves a power reference, see above
    assert remembered.call_count == (2 if recorded.level == 1.0 else 0)
