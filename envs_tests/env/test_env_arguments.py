"""Arguments of the environment of the wrong type, as JSON gives them: refused in one line, each of them."""

import json

import gymnasium as gym
import pytest

from wt_gym.base.errors import WtGymError
from wt_gym.commands import run as run_command
from wt_gym.envs.options import env_arguments
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.envs.vector_env import WindTurbineVectorEnv

WRONG = {"text": "x", "nested list": [[1, 2], 3], "mapping": {"a": 1}, "huge": 10**400, "no number": float("nan")}
"""Values that no argument takes, some in disguise."""


@pytest.mark.parametrize("name", env_arguments())
def test_every_argument_refuses_what_it_cannot_be(name):
    """The environment gives each of them to the option that checks it."""
    for kind, value in WRONG.items():
        with pytest.raises((ValueError, WtGymError)) as error:
            WindTurbineEnv(**{name: value})
        message = str(error.value)
        assert "\n" not in message, kind
        assert len(message) < 1500, kind
        assert name.split("_")[0] in message.replace(" ", "_"), f"{kind}: {message}"


@pytest.mark.parametrize("given", ['{"episode_length": "long"}', '{"controller": 3}', '{"lidar": {"range": 3}}'])
def test_on_a_command_line_too(given, tmp_path):
    words = ["baseline", "--env-kwargs", given, "--out", str(tmp_path / "out"), "--duration", "2", "--skip", "0"]
    with pytest.raises(SystemExit) as end:
        run_command("evaluate", words)
    message = end.value.code
    assert message.startswith("error: ")
    assert "\n" not in message
    assert next(iter(json.loads(given))) in message


@pytest.mark.parametrize(
    "options", [{"rotor_speed": [1.0]}, {"pitch": "0"}, {"azimuth": True}, {"wind_speed": {}}, [1]]
)
def test_options_of_a_reset_too(options):
    env = WindTurbineEnv()
    with pytest.raises(ValueError, match="must be"):
        env.reset(options=options)


def test_an_unknown_argument_is_told_with_the_one_it_resembles():
    for make in (gym.make, gym.make_vec):
        words = r"got an unexpected keyword argument 'wind_sped'; did you mean 'wind_speed'\? Its arguments are"
        with pytest.raises(TypeError, match=words):
            make("wt_gym/NREL5MW-Steady-v1", wind_sped=8.0)
    with pytest.raises(TypeError, match=r"argument 'color'\. Its arguments are turbine, .*, residual_washout"):
        gym.make("wt_gym/NREL5MW-Steady-v1", color=8.0)


def test_an_unknown_argument_is_refused_in_the_words_of_python():
    """TorchRL tries ``frameskip`` and takes it back where the message has these words."""

    def function(frames):
        """Take another argument."""

    with pytest.raises(TypeError) as of_python:
        function(frameskip=1)
    words = str(of_python.value)[str(of_python.value).index("got an") :]
    for make in (WindTurbineEnv, WindTurbineVectorEnv):
        with pytest.raises(TypeError) as ours:
            make(frameskip=1)
        assert words in str(ours.value)


def test_names_and_units_are_arrays():
    env = WindTurbineEnv(observation=("rotor", "azimuth"), pitch="individual", history=2)
    assert env.observation_names.shape == env.observation_units.shape == env.observation_space.shape
    assert dict(zip(env.observation_names, env.observation_units, strict=True)) == {
        "rotor_speed": "rad/s", "generator_speed": "rad/s", "azimuth_sin": "-", "azimuth_cos": "-",
        "rotor_speed@1": "rad/s", "generator_speed@1": "rad/s", "azimuth_sin@1": "-", "azimuth_cos@1": "-",
    }  # fmt: skip
    assert env.action_names.tolist() == ["pitch_1_rate", "pitch_2_rate", "pitch_3_rate", "yaw_rate",
                                         "generator_torque_rate"]  # fmt: skip
    assert env.action_units.tolist() == ["rad/s"] * 4 + ["N m/s"]
    vec = gym.make_vec("wt_gym/NREL5MW-Steady-v1", num_envs=2)
    assert vec.unwrapped.action_names.tolist() == ["pitch_rate", "yaw_rate", "generator_torque_rate"]
    assert vec.unwrapped.observation_names.shape == vec.single_observation_space.shape
    vec.close()
