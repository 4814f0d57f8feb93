"""Controllers and models of one's own in the comparisons: classes of a file, models of stable-baselines3."""

import base64
import json
import pickle
import zipfile

import gymnasium as gym
import numpy as np
import pytest
from sb3_contrib import TQC
from stable_baselines3 import PPO, SAC, TD3

from wt_gym.envs.layout import layout_of
from wt_gym.envs.turbine_env import WindTurbineEnv, turbine_env_of
from wt_gym.experiment.benchmark import entries_of, entry_of
from wt_gym.experiment.environments import AgentExperiment
from wt_gym.experiment.names import env_choices_of, named_choices

RESIDUAL = "wt_gym/LoadReduction-v3"
STEADY = "wt_gym/NREL5MW-Steady-v1"
pytestmark = pytest.mark.usefixtures("scripted")


def saved(path, cls, **env_kwargs):
    """An untrained model of an environment."""
    env = gym.make(STEADY, **env_kwargs)
    more = {"buffer_size": 10} if cls.__name__ not in ("PPO", "A2C") else {"n_steps": 8}
    cls("MlpPolicy", env, policy_kwargs={"net_arch": [8]}, device="cpu", seed=1, **more).save(path)
    env.close()
    return path


def with_part(path, key, value):
    """Put a pickled part into a model."""
    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    data = json.loads(parts["data"])
    data[key] = {":type:": "x", ":serialized:": base64.b64encode(pickle.dumps(value)).decode()}
    parts["data"] = json.dumps(data).encode()
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in parts.items():
            archive.writestr(name, content)


class Evil:
    """Writes a file when it is loaded."""

    def __init__(self, file):
        self.file = file

    def __reduce__(self):
        return open, (str(self.file), "w")


def test_a_controller_of_ones_own_runs_beneath(mine):
    env = gym.make(RESIDUAL, controller=f"{mine}:Hold:gain=2", observation=None, reward_credit=False)
    assert turbine_env_of(env).controller.gain == 2
    env.close()
    own = "discon+side_side_damper+observer"
    agents = {"a": "baseline", "b": f"{mine}:Hold:gain=3", "c": own, "d": "discon"}
    with AgentExperiment(agents, RESIDUAL, {}) as pool:
        assert turbine_env_of(pool["b"][0]).controller.gain == 3
        assert pool["a"][0] is pool["c"][0] is not pool["d"][0]  # one name for one thing, in one environment
    with AgentExperiment({"b": agents["b"]}, STEADY, {}) as pool:
        assert pool.agents["b"].controller.gain == 3


def test_a_class_with_predict_runs_in_the_environment_that_it_chooses(mine):
    with AgentExperiment({"a": "baseline", "b": f"{mine}:Rests:offset=0.5"}, RESIDUAL, {}) as pool:
        env, agent = pool["b"]
        layout = layout_of(env)
        assert layout.action.mode == "absolute"
        assert agent.predict(np.zeros(len(layout.observation)))[0].tolist() == [0.5] * layout.action.size
    with pytest.raises(ValueError, match="got turbine: turbine and wind are the same for all"):
        env_choices_of(f"{mine}:Cheats")
    with pytest.raises(ValueError, match="got a class with predict"):
        WindTurbineEnv(action_mode="residual", controller=f"{mine}:Rests")


def test_classes_enter_the_benchmark(mine):
    beneath, rests = entries_of([f"{mine}:Hold:gain=2", f"{mine}:Rests"])
    assert (beneath.name, beneath.interface["controller"]) == ("Hold:gain=2", [f"{mine}:Hold", {"gain": 2}])
    assert rests.interface == {"action_mode": "absolute", "residual_form": "rate", "observation": ["rotor"]}
    assert beneath.definition["sha256"] == rests.definition["sha256"]
    assert [entry.name for entry in entries_of(["baseline", "discon", "constant"])] == ["discon", "zero"]


@pytest.mark.parametrize("cls", [PPO, TQC, TD3])
def test_any_model_of_stable_baselines_enters(tmp_path, cls):
    path = saved(tmp_path / "model.zip", cls, pitch="collective")
    (tmp_path / "model.json").write_text(json.dumps({"env_kwargs": {"pitch": "collective", "action_mode": "rate"}}))
    for text in (str(path), f"{path}:algo={cls.__name__}"):
        with AgentExperiment(named_choices(["baseline", f"m={text}"]), STEADY, {}) as pool:
            env, agent = pool["m"]
            observation, _ = env.reset(seed=1)
            action, _ = agent.predict(observation)
            plain = cls.load(path, device="cpu").predict(observation, deterministic=True)[0]
            np.testing.assert_allclose(action, plain, atol=1e-6)  # of 32 bits
            assert action.dtype == plain.dtype
    assert entry_of(f"m={path}").interface == {"pitch": "collective", "action_mode": "rate"}


def refuse(text, message, **arguments):
    """The model is refused with this message."""
    with pytest.raises(ValueError, match=message), AgentExperiment({"m": str(text)}, STEADY, arguments):
        pass


def test_models_that_do_not_fit_are_refused(tmp_path):
    path = saved(tmp_path / "model.zip", SAC)
    refuse(f"{path}:algo=PPO", "is not a model of PPO but of SAC")
    refuse(f"{path}:algo=SAK", r"must be one of .*got 'SAK'; did you mean 'SAC'")
    refuse(path, "m: the model takes observations", pitch="individual")
    (tmp_path / "model.json").write_text('{"env": {}}')
    with pytest.raises(ValueError, match="must hold a table of algo and env_kwargs, got env"):
        env_choices_of(str(path))
    no_model = tmp_path / "other.zip"
    no_model.write_bytes(b"no zip")
    refuse(no_model, "damaged, or not a model of stable-baselines3")


def test_no_code_in_a_model_is_run_unless_it_is_trusted(tmp_path):
    path, trace = saved(tmp_path / "model.zip", PPO), tmp_path / "trace"
    with_part(path, "ep_info_buffer", Evil(trace))  # nothing that a policy needs
    with AgentExperiment({"m": str(path)}, STEADY, {}):
        assert not trace.exists()
    with_part(path, "policy_class", Evil(trace))
    refuse(path, r"needs \S+open for its policy_class: .*--trust")
    (tmp_path / "vecnormalize.pkl").write_bytes(pickle.dumps(Evil(trace)))
    refuse(path, r"statistics .* hold \S+open: .*--trust")
    assert not trace.exists()
    refuse(f"{path}:trust=True", "no statistics of a training")
    assert trace.exists()  # trusted: it was run
