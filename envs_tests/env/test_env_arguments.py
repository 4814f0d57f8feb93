"""Arguments of the environment of the wrong type, as JSON gives them: refused in one line, each of them."""

import json

import gymnasium as gym
import numpy as np
import pytest

import wt_gym  # noqa: F401 - registers the environments
from wt_gym.base.errors import InflowError, WtGymError
from wt_gym.base.options import check_flag, check_mapping, check_names, check_number, options_of, real_numbers
from wt_gym.commands import evaluate
from wt_gym.envs.options import GROUPS, EnvOptions, env_arguments
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.envs.vector_env import WindTurbineVectorEnv
from wt_gym.envs.wind_sampler import WindOptions, WindSampler
from wt_gym.turbines import load_turbine

WRONG = {"text": "x", "number as text": "12", "nested list": [[1, 2], 3], "mapping": {"a": 1}, "huge": 10**400}
"""Values of JSON that no argument takes, some in disguise."""
DECLARED = {one.flat: one for group in (EnvOptions, *GROUPS.values()) for one in options_of(group)}


@pytest.mark.parametrize("name", env_arguments())
def test_every_argument_refuses_what_it_cannot_be(name):
    needs_value = name in DECLARED and not DECLARED[name].takes_none
    for kind, value in (WRONG | ({"nothing": None} if needs_value else {})).items():
        with pytest.raises((ValueError, WtGymError)) as error:
            WindTurbineEnv(**{name: value})
        message = str(error.value)
        assert "\n" not in message, kind
        assert len(message) < 1500, kind
        assert name.split("_")[0] in message.replace(" ", "_"), f"{kind}: {message}"


@pytest.mark.parametrize("name", env_arguments())
def test_numbers_without_end_or_meaning_are_refused(name):
    for value in (float("nan"), float("inf"), -1e300):
        with pytest.raises((ValueError, WtGymError)):
            WindTurbineEnv(**{name: value})


@pytest.mark.parametrize(
    "given",
    ['{"control_dt": [1]}', '{"episode_length": "long"}', '{"reward": {"power": "much"}}', '{"controller": 3}',
     '{"fidelity": ["training"]}', '{"action_spans": [1]}', '{"lidar": {"range": 3}}', '{"vector_reward": "no"}'],
)  # fmt: skip
def test_on_a_command_line_too(given, tmp_path):
    words = ["baseline", "--env-kwargs", given, "--out", str(tmp_path / "out"), "--duration", "2", "--skip", "0"]
    with pytest.raises(SystemExit) as end:
        evaluate.main(words)
    message = end.value.code
    assert message.startswith("error: ")
    assert "\n" not in message
    assert next(iter(json.loads(given))) in message


@pytest.mark.parametrize(
    "options",
    [{"rotor_speed": [1.0]}, {"pitch": "0"}, {"azimuth": True}, {"wind_speed": {}}, [1]],
)
def test_options_of_a_reset_too(options):
    env = WindTurbineEnv()
    with pytest.raises(ValueError, match="must be"):
        env.reset(options=options)


@pytest.mark.parametrize(
    "given", [{"direction": "0.1"}, {"direction": True}, {"wander": "12"}, {"turbulence_class": "Z"}, {"direction": []}]
)
def test_winds_take_no_texts_for_numbers_and_no_unknown_class(given):
    with pytest.raises(InflowError):
        WindSampler(load_turbine("nrel_5mw"), WindOptions("steady", 8.0, **given))


def test_numbers_of_numpy_are_numbers():
    assert check_number("x", np.float32(0.5)) == 0.5
    assert check_number("x", np.int64(3)) == 3.0
    assert check_number("x", np.array(2.0)) == 2.0
    assert real_numbers(np.array([1.0, 2.0])) == (1.0, 2.0)
    assert real_numbers([[1.0], 2.0]) == real_numbers([1.0, None]) == real_numbers(np.ones((2, 2))) == ()
    assert check_flag("x", np.bool_(True)) is True
    assert check_names("x", iter(("a", "b"))) == ("a", "b")
    assert check_mapping("x", {"a": 1}) == {"a": 1.0}


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"sensor_delay": 200.2}, "sensor_delay must be 0 to 1000 control steps, got 1001"),
        ({"sensor_delay": 1e30}, "sensor_delay must be 0 to 1000 control steps, got"),
    ],
)
def test_memory_of_the_sensors_has_an_end(given, message):
    with pytest.raises(ValueError, match=message):
        WindTurbineEnv(**given)


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


def test_one_group_can_be_named_alone():
    one, several = (WindTurbineEnv(observation=choice) for choice in ("measurable", ["measurable"]))
    assert one.observation_names.tolist() == several.observation_names.tolist()
    assert one.options.to_json() == several.options.to_json()
    assert gym.make("wt_gym/LoadReduction-v2", observations={"channels": "rotor"}).observation_space.shape == (2,)
    with pytest.raises(ValueError, match=r"observation has \['rotors'\]; must be among the groups"):
        WindTurbineEnv(observation="rotors")


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


def test_environments_and_layouts_print_in_a_line():
    env = WindTurbineEnv(inflow="turbulent")
    sizes = "31 observations, rate actions (pitch_rate, yaw_rate, generator_torque_rate) every 0.2 s>"
    assert repr(env) == (f"<WindTurbineEnv: NREL 5-MW baseline, land based, turbulent, training fidelity, {sizes}")
    assert repr(env.layout) == f"<EnvLayout: NREL 5-MW baseline, land based, {sizes}"
    assert repr(env.layout.observation) == (
        "<ObservationLayout: 31 channels, rotor_speed, generator_speed, generator_power, generator_torque, …>"
    )
    vec = gym.make_vec("wt_gym/NREL5MW-Steady-v1", num_envs=2)
    assert repr(vec).startswith("<WindTurbineVectorEnv: 2 of <WindTurbineEnv: NREL")
    vec.close()
