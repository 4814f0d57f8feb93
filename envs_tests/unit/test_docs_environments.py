"""The page about the environments: its examples run, and its tables are those of the code."""

import inspect
import re
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from wt_gym.envs.options import EnvOptions, env_arguments
from wt_gym.envs.vector_env import WindTurbineVectorEnv
from wt_gym.envs.wind_sampler import KINDS
from wt_gym.tasks import TASKS
from wt_gym.wind import TurbulenceBox, TurbulentInflow, write_bts

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGE = "".join((DOCS / name).read_text(encoding="utf-8") for name in ("environments.md", "episodes.md"))
TASK_PAGE = (DOCS / "tasks" / "index.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
TABLES = re.findall(r"^\| `([^`|]+)` \|.*\| ([^|]*) \|$", PAGE, re.MULTILINE)
TASK_ROWS = re.findall(r"^\| \[`([^`|]+)`\]\((\w+\.md)\) \|.*\| ([^|]*) \|$", TASK_PAGE, re.MULTILINE)


@pytest.fixture(scope="module")
def left(tmp_path_factory):
    """Names that the examples leave behind, each run after those before it, with a wind file of every name."""
    folder = tmp_path_factory.mktemp("winds")
    for seed, name in enumerate(sorted(set(re.findall(r'"(\w+\.bts)"', PAGE)))):
        box = TurbulenceBox.kaimal(14.0, 90.0, 126.0, "B", seed=seed, duration=20.0, grid=(3, 3), cache=False)
        write_bts(box, folder / name)
    found = []
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        names = {}
        for example in EXAMPLES:
            exec(compile(example, "docs/environments.md", "exec"), names)
            found.append(dict(names))
    return found


def test_examples_run(left):
    grouped, many, vector, planned, parked, read, drawn, demanded, broken, offshore, soil, boundary = left
    assert boundary["env"].action_space.shape == (1,)
    assert 12.0 < boundary["info"]["wind_speed"] < 16.1  # at the hub
    assert offshore["env"].unwrapped.turbine.tower.support.base_height == -20.0
    assert soil["turbine"].tower.support.foundation[0, 0] == soil["ground"][0, 0] > 1e9
    assert EnvOptions.from_json(grouped["text"]) == grouped["env"].unwrapped.options
    assert grouped["env"].unwrapped.wind.speeds == (12.0, 12.0)
    assert demanded["env"].unwrapped.options.grid.reference == ((0.0, 4.5e6), (30.0, 4.5e6), (30.0, 4.0e6))
    assert broken["info"]["fault"] | {"time": 0.0} == {"kind": "dead_moment", "blade": 2, "time": 0.0, "size": 0.0}
    assert (parked["terminated"], parked["truncated"]) == (False, False)
    assert abs(parked["info"]["rotor_speed"]) < 0.1
    assert read["env"].unwrapped.episode_wind.inflow.description.startswith(("first.bts", "second.bts"))
    assert isinstance(drawn["env"].unwrapped.episode_wind.inflow, TurbulentInflow)
    assert 13.0 < drawn["info"]["wind_speed"] < 15.0
    assert many["observations"].shape == many["envs"].observation_space.shape
    assert many["infos"]["time"] == pytest.approx(0.2)
    assert vector["scalar"] == pytest.approx(vector["info"]["scalar_reward"], rel=1e-5)
    value, tilt = planned["best"]
    assert np.isfinite(value)
    assert tilt in (-0.2, 0.0, 0.2)


def test_every_task_and_every_wind_stands_on_the_page():
    assert [task.id for task in TASKS.values()] == [name for name, *_ in TASK_ROWS]
    assert all(task.id.removeprefix("wt_gym/") in PAGE for task in TASKS.values())
    assert {f'"{kind}"' for kind in KINDS} == {name for name, _ in TABLES if name.startswith('"')}


def test_lengths_of_episodes_are_those_of_the_tasks():
    lengths = {name: last for name, _, last in TASK_ROWS}
    assert {name: gym.spec(name).max_episode_steps * gym.spec(name).kwargs["control_dt"] for name in lengths} == {
        name: float(length.removesuffix(" s")) for name, length in lengths.items()
    }


def test_arguments_on_the_page_are_those_of_the_environment():
    known = {*env_arguments(), *inspect.signature(WindTurbineVectorEnv).parameters}
    named = set(re.findall(r"`(\w+)=", PAGE))
    assert len(named) > 8
    assert named <= known
    columns = [name for kind, last in TABLES if kind.startswith('"') for name in re.findall(r"`(\w+)`", last)]
    assert set(columns) <= known
