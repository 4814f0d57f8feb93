"""What ``print`` shows of an environment."""

import html
import json
import re

import gymnasium as gym
import pytest

from wt_gym.commands import run as run_command
from wt_gym.control.controllers import make_controller
from wt_gym.envs.manual import observation_rows, source
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.tasks import TASKS
from wt_gym.turbines import load_turbine

LINES = ("task", "turbine", "wind", "controller", "actions", "reward", "episode", "observations")


def rows(env):
    """Text by the first word of each line, those that continue one put behind it."""
    found = {}
    for line in str(env).splitlines():
        assert len(line) <= 120
        if re.match(r"  \S", line):  # an observation
            continue
        name, text = line[:14].strip(), line[14:]
        last = name or last  # noqa: F821 - the first line has a name
        found[last] = f"{found[last]} {text}" if last in found else text
    return found


TASKS_OF_NREL = [task for task in TASKS.values() if not task.name.startswith("IEA")]


@pytest.mark.parametrize("task", TASKS_OF_NREL, ids=lambda task: task.name)
def test_every_task_has_its_goal_wind_and_names(task):
    env = gym.make(task.id).unwrapped
    found = rows(env)
    assert len(str(env).splitlines()) <= 60
    assert tuple(name for name in found if name != "conditions") == LINES
    assert found["task"] == f"{task.id}: {task.goal}"
    assert env.turbine.heading in found["turbine"]
    assert f"{env.wind.speeds[1]:.4g} m/s" in found["wind"]
    for name in env.action_names:
        assert name in found["actions"]
    assert found["observations"].startswith(f"{env.observation_space.shape[0]}, unit, range")
    listed = [re.split(r"  +", line.strip()) for line in str(env).split("observations")[1].splitlines()[1:]]
    names = []
    for name, *_ in listed:
        stem, _, last = name.partition(" … ")
        stem, _, first = stem.rpartition("_") if last else (stem, "", "")
        names += [f"{stem}_{k}" for k in range(int(first), int(last) + 1)] if last else [name]
    assert sorted(names) == sorted(env.observation_names)
    assert all(f"{term.name} {term.weight:g}" in found["reward"] for term in env.reward_terms)


def test_an_observation_has_its_source_on_a_turbine():
    """The group of what a turbine measures has an instrument or the memory of a controller for each."""
    env = WindTurbineEnv(
        pitch="individual", observation=("measurable", "tip_out_of_plane_1", "tower_base_fore_aft_moment", "lidar")
    )
    sources = {row[0]: row[3] for row in observation_rows(env.layout.observation.channels)}
    assert sources["wind_speed"] == "anemometer of the nacelle"
    assert sources["pitch_1 … 3"] == "encoders of the pitch drives"
    assert sources["root_flap_moment_1 … 3"] == "strain gauges at the blade roots"
    assert sources["tower_base_fore_aft_moment"] == "strain gauges at the tower base"
    assert sources["tip_out_of_plane_1"] == "no standard instrument"
    assert sources["generator_torque_demand"] == sources["pitch_demand_1 … 3"] == "memory of the controller"
    assert source("root_flap_moment_tilt") == "strain gauges at the blade roots, azimuth"


def test_the_command_prints_and_writes_tables(tmp_path, capsys):
    run_command("describe", ["wt_gym/LoadReduction-v3", "--out", str(tmp_path / "page.html"), "--json"])
    text, page = capsys.readouterr().out, (tmp_path / "page.html").read_text(encoding="utf-8")
    found = json.loads(text.splitlines()[-1])
    env = gym.make("wt_gym/LoadReduction-v3").unwrapped
    assert {row["term"]: float(row["weight"]) for row in found["reward"]} == {
        t.name: t.weight for t in env.reward_terms
    }
    assert [row["part"] for row in found["base controller"]] == ["discon", "side_side_damper", "observer"]
    assert [row["action"] for row in found["actions"]] == list(env.action_names)
    for row in (row for rows in found.values() for row in rows):
        assert all(cell in text for cell in list(row.values())[:3])
        assert all(html.escape(cell) in page for cell in row.values())


def test_conditions_are_those_that_differ_from_nothing():
    assert rows(gym.make("wt_gym/Dial-v1").unwrapped)["conditions"] == "a dial on the weights of the reward"
    assert rows(gym.make("wt_gym/PowerTracking-v1").unwrapped)["conditions"] == "a power reference"
    env = WindTurbineEnv(fault_kinds=("stuck_blade",), variation={"air_density": 0.9})
    assert rows(env)["conditions"] == "faults: stuck_blade; variation: air_density"
    assert "conditions" not in rows(WindTurbineEnv())


def test_controllers_by_name_and_as_objects():
    own = make_controller("tsr_tracking", load_turbine("nrel_5mw"))
    for arguments, text in (
        ({}, "none: the actions are the demands"),
        ({"controller": own, "action_mode": "residual"}, "TsrTrackingController, changed by the actions"),
        ({"controller": lambda _: own, "action_components": ("pitch",)}, "TsrTrackingController, beside the actions"),
    ):
        assert rows(WindTurbineEnv(**arguments))["controller"] == text


def test_wrappers_and_texts_show_one_line():
    env = gym.make("wt_gym/NREL5MW-Steady-v1")
    assert str(env) == repr(env) == "<OrderEnforcing<WindTurbineEnv<wt_gym/NREL5MW-Steady-v1>>>"
    assert f"{env.unwrapped}" == "<WindTurbineEnv<wt_gym/NREL5MW-Steady-v1>>"
    assert f"{WindTurbineEnv()}" == "<WindTurbineEnv instance>"
    assert "\n" not in repr(env.unwrapped)


def test_vector_environments_say_how_many():
    envs = gym.make_vec("wt_gym/LoadReduction-v3", num_envs=3)
    assert rows(envs)["task"].startswith("3 turbines, wt_gym/LoadReduction-v3: Less blade fatigue")
    assert "\n" not in str(gym.wrappers.vector.RecordEpisodeStatistics(envs)) + repr(envs) + f"{envs}"
    envs.close()
