"""Options of the environment: in groups, by flat names, as JSON, on top of ids."""

import inspect
import json

import gymnasium as gym
import pytest
from gymnasium.envs.registration import EnvSpec

from wt_gym.base.options import options_of
from wt_gym.control import Lidar
from wt_gym.control.controllers import FadeParameters
from wt_gym.envs.observations import ObservationOptions
from wt_gym.envs.options import (
    GROUPS,
    ActionOptions,
    ControllerOptions,
    EnvOptions,
    argument_default,
    env_arguments,
    flat_arguments,
    registered_arguments,
    with_whole_paths,
)
from wt_gym.envs.rewards import RewardOptions
from wt_gym.envs.terminations import LimitOptions
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.envs.wind_sampler import WindOptions
from wt_gym.simulation import Simulator
from wt_gym.simulation.contract import TurbineSimulator
from wt_gym.wind import SteadyInflow

TASK = "wt_gym/LoadReduction-v3"

GIVEN = [
    WindOptions(inflow="turbulent", speed=[8.0, 9.0], seeds=iter((3, 4)), direction=0.1, wander=(0.1, 60.0)),
    ActionOptions(mode="residual", pitch="cyclic", components=["pitch"], spans={"pitch": 0.02}),
    ObservationOptions(channels=["rotor", "lidar"], noise=0.5, delay=0.2, history=2, lidar=Lidar((50.0, 100.0))),
    RewardOptions(terms={"power": 2.0}, relative=True, vector=False, termination_penalty=60),
    LimitOptions(episode_length=None, overspeed=1.4, standstill=-0.1),
    ControllerOptions(base="ipc", residual_fade=FadeParameters(pitch=(0.01, 0.05)), residual_washout=10),
]


def test_all_options_have_a_form_in_json():
    options = EnvOptions(turbine="nrel_5mw", control_dt=0.1, **{group.title: group for group in GIVEN})
    assert EnvOptions.from_json(options.to_json()) == options
    env = WindTurbineEnv(**json.loads(options.to_json()))
    assert env.options == options
    assert EnvOptions.from_json(env.options.to_json()).limits.standstill == -0.1


@pytest.mark.parametrize(
    ("group", "name"),
    [
        (RewardOptions(terms=["power", lambda step: 0.0]), r"rewards.terms\[1\]"),
        (EnvOptions(wind=WindOptions(inflow=lambda rng: SteadyInflow(9.0))), "wind.inflow"),
    ],
)
def test_objects_without_a_form_in_json_are_named(group, name):
    with pytest.raises(ValueError, match=f"^{name} must be a number, a text, a list or a mapping for a form in JSON"):
        group.to_json()


@pytest.mark.parametrize("group", GIVEN, ids=lambda group: group.title)
def test_a_group_and_flat_names_make_the_same(group):
    flat = {one.flat: group.given[one.name] for one in options_of(group) if one.name in group.given}
    others = {"action_mode": "residual"} if group.title in ("rewards", "controller") else {}
    made = [
        WindTurbineEnv(**others, **arguments).options
        for arguments in ({group.title: group}, {group.title: group.as_dict()}, flat)
    ]
    assert made[0] == made[1] == made[2]
    assert getattr(made[0], group.title) == group


def test_every_option_is_said_once_and_has_one_name():
    names = [one.flat for group in (EnvOptions, *GROUPS.values()) for one in options_of(group)]
    assert len(set(names)) == len(names)
    assert set(env_arguments()) == {*names, *GROUPS}
    text = inspect.getdoc(WindTurbineEnv)
    for group in (EnvOptions, *GROUPS.values()):
        for one in options_of(group):
            said = " ".join(one.text.split())
            assert " ".join(text.split()).count(said) == 1, one.flat
            assert said in " ".join(inspect.getdoc(group).split()), one.flat
    assert argument_default("wind_speed") == (6.0, 18.0)
    assert argument_default("control_dt") == 0.2
    assert list(inspect.signature(WindTurbineEnv).parameters)[-1] == "flat"


@pytest.mark.parametrize("wind", [{"speed": 15.0}, WindOptions(speed=15.0)], ids=["mapping", "object"])
@pytest.mark.parametrize("many", [False, True], ids=["one", "vector"])
def test_a_group_on_top_of_an_id_replaces_what_it_names(wind, many):
    made = gym.make_vec(TASK, num_envs=2, wind=wind) if many else gym.make(TASK, wind=wind)
    env = made.unwrapped.envs[1] if many else made.unwrapped
    assert (env.wind.speeds, env.wind.label) == ((15.0, 15.0), "turbulent")
    again = EnvSpec.from_json(made.spec.to_json())
    assert again.kwargs["wind"] == {"speed": 15.0}
    if not many:
        assert gym.make(again).unwrapped.options == env.options
    made.close()


def test_a_controller_on_top_of_an_id_is_a_name_or_a_group():
    def made(controller):
        return gym.make("wt_gym/Yaw-v3", controller=controller, observation="measurable").unwrapped.options.controller

    assert made("ipc+yaw").base == "ipc+yaw"
    assert made({"base": "ipc"}).base == "ipc"
    faded = made({"residual_fade": {"pitch": [0.0, 0.05]}})
    assert (faded.base, faded.residual_fade) == ("discon+yaw", FadeParameters(pitch=(0.0, 0.05)))
    changed = gym.make(TASK, controller=ControllerOptions(residual_washout=5.0)).unwrapped.options.controller
    assert (changed.residual_fade, changed.residual_washout) == (True, 5.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"wind": {"speed": 12.0}, "wind_speed": 9.0}, r"wind_speed must be given once, got wind\.speed = 12\.0 and"),
        ({"limits": LimitOptions(overspeed=1.3), "overspeed_limit": 1.3}, "overspeed_limit must be given once"),
        ({"wind": {"sped": 12.0}}, "wind has no option 'sped'; did you mean 'speed'"),
        ({"wind": 12.0}, "wind must be a WindOptions or a mapping of options, got 12.0"),
        ({"wind": ActionOptions()}, "wind must be a WindOptions or a mapping"),
        ({"observations": {"lidar": {"range": 3}}}, "lidar must be a Lidar, or its arguments by name: .*'range'"),
    ],
)
def test_what_is_wrong_with_groups_is_said(arguments, message):
    for make in (lambda **given: gym.make(TASK, **given), lambda **given: gym.make_vec(TASK, num_envs=1, **given)):
        with pytest.raises(ValueError, match=message):
            make(**arguments)


def test_arguments_without_names_are_turbine_and_wind():
    env = WindTurbineEnv("nrel_5mw", "turbulent", 9.0)
    assert env.wind.speeds == (9.0, 9.0)
    with pytest.raises(TypeError, match="inflow of the environment must be given once"):
        WindTurbineEnv("nrel_5mw", "turbulent", inflow="steady")
    with pytest.raises(TypeError, match="at most 15 arguments without names, got 20"):
        WindTurbineEnv(*range(20))


def test_arguments_by_flat_names():
    flat = registered_arguments(TASK, {"wind": {"speed": 9.0}, "history": 2})
    assert (flat["wind_speed"], flat["inflow"], flat["history"]) == (9.0, "turbulent", 2)
    assert "wind" not in flat
    assert "env_id" not in flat
    assert WindTurbineEnv(**flat).options == gym.make(TASK, wind_speed=9.0, history=2).unwrapped.options
    assert flat_arguments({"controller": "ipc"}) == flat_arguments({"controller": {"base": "ipc"}})
    assert with_whole_paths({"wind": {"inflow": "a.bts"}})["inflow"].endswith("/a.bts")


def test_simulators_keep_the_contract():
    methods = ("reset", "advance", "state", "restore", "geometry")
    assert {name for name in vars(TurbineSimulator) if not name.startswith("_")} == {*methods}
    for name in methods:
        wanted, there = (inspect.signature(getattr(kind, name)).parameters for kind in (TurbineSimulator, Simulator))
        assert {key: p.default for key, p in wanted.items()} == {key: p.default for key, p in there.items()}
    for name in ("turbine", "inflow", "fidelity", "time_step", "time", "faults"):
        assert name in inspect.getdoc(TurbineSimulator)
