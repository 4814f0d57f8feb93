"""Trained agents as ONNX files: the same actions, with what they are made for beside them."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wt_gym.commands import run as run_command
from wt_gym.deployment.export.policy import (
    INPUT,
    OUTPUT,
    check_onnx,
    export_onnx,
    network_of,
    training_environment,
    write_onnx,
)
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.experiment.trained_agent import ALGORITHM_CLASSES, TrainedAgent

onnxruntime = pytest.importorskip("onnxruntime", reason="onnxruntime is not installed: the extra export brings it")
TRAINED = Path(__file__).resolve().parents[2] / "agents" / "trained"
KWARGS = {"turbine": "nrel_5mw", "inflow": "steady", "wind_speed": 15.0, "action_mode": "residual"}


def test_a_shipped_agent_acts_alike_in_an_episode(tmp_path):
    """Actions of the file for the physical values of the channels against those of the agent in its environment."""
    agent = TrainedAgent.load(TRAINED / "load_reduction")
    made = export_onnx(str(TRAINED / "load_reduction"), tmp_path)
    session = onnxruntime.InferenceSession(made["files"][0])
    env = training_environment(agent, {})
    layout = env.layout
    observation, _ = env.reset(seed=1)
    for _ in range(20):
        values = [layout.observation.value(observation.astype(np.float64), n) for n in layout.observation.names]
        action, _ = agent.predict(observation)
        (found,) = session.run([OUTPUT], {INPUT: np.array([values])})
        assert found[0] == pytest.approx(action, abs=1e-5)  # the observation is single precision
        observation, *_ = env.step(action)


@pytest.mark.parametrize("algorithm", ["PPO", "A2C", "SAC", "TQC", "TD3", "DDPG"])
def test_every_algorithm_gives_its_own_actions(algorithm, tmp_path):
    """The network taken apart against stable-baselines3, and the file against the network."""
    env = WindTurbineEnv(**KWARGS)
    model = ALGORITHM_CLASSES[algorithm]("MlpPolicy", env, policy_kwargs={"net_arch": [16, 8]}, seed=3)
    path = tmp_path / "model.zip"
    model.save(path)
    path.with_suffix(".json").write_text(json.dumps({"algo": algorithm, "env_kwargs": KWARGS}), encoding="utf-8")
    export_onnx(str(path), tmp_path / "exported")  # refuses other actions
    network = network_of(TrainedAgent(model), env.layout)
    rng = np.random.default_rng(0)
    values = network.offset + network.scale * rng.normal(size=(50, network.offset.size))
    for row in values:
        observation, _ = env.layout.observation.normalize(row)
        expected, _ = model.predict(observation, deterministic=True)
        assert network.action(row) == pytest.approx(expected, abs=2e-6)
        assert np.ptp(network.action(values), axis=0).min() > 1e-4  # it does depend on what is measured


@pytest.mark.parametrize("net_arch", [None, [16, 8]])
def test_default_networks_round_and_wrong_files_are_refused(net_arch, tmp_path):
    """TD3 has layers of 400 and 300 by default, which sum hundreds of products."""
    env = WindTurbineEnv(**KWARGS)
    policy = {} if net_arch is None else {"net_arch": net_arch}
    model = ALGORITHM_CLASSES["TD3"]("MlpPolicy", env, policy_kwargs=policy, seed=0)
    network = network_of(TrainedAgent(model), env.layout)
    write_onnx(network, tmp_path / "policy.onnx", {})
    check_onnx(network, tmp_path / "policy.onnx")
    changed = network.layers[-1].weight.copy()
    changed[0] += 0.01
    layers = (*network.layers[:-1], replace(network.layers[-1], weight=changed))
    with pytest.raises(ValueError, match=r"within .* the rounding of single precision, they differ by"):
        check_onnx(replace(network, layers=layers), tmp_path / "policy.onnx")


def test_statistics_of_the_training_are_inside():
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

    env = WindTurbineEnv(**KWARGS)
    venv = VecNormalize(DummyVecEnv([lambda: env]), norm_reward=False)
    rng = np.random.default_rng(1)
    venv.obs_rms.update(rng.normal(0.3, 0.1, (100, len(env.layout.observation))))
    agent = TrainedAgent(PPO("MlpPolicy", venv, seed=2), venv)
    network = network_of(agent, env.layout)
    for row in network.offset + network.scale * rng.normal(0.3, 0.3, size=(20, network.offset.size)):
        observation, _ = env.layout.observation.normalize(row)
        assert network.action(row) == pytest.approx(agent.predict(observation)[0], abs=2e-6)


def test_the_card_says_what_the_agent_is_made_for(tmp_path, capsys):
    run_command("export", [str(TRAINED / "load_reduction"), "--out", str(tmp_path), "--json"])
    printed = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert {Path(file).name for file in printed["files"]} == {"policy.onnx", "card.json", "README.md"}
    card = json.loads((tmp_path / "card.json").read_text(encoding="utf-8"))
    assert card["base_controller"] == "linear_optimal"
    assert card["control_step_s"] == 0.1
    assert [channel["name"] for channel in card["channels"]][:2] == [
        "disturbance_flap_mean_1",
        "disturbance_flap_mean_2",
    ]
    text = (tmp_path / "README.md").read_text(encoding="utf-8")
    assert all(f"| {channel['name']} | {channel['unit']} |" in text for channel in card["channels"])
    session = onnxruntime.InferenceSession(tmp_path / "policy.onnx")
    kept = session.get_modelmeta().custom_metadata_map
    assert json.loads(kept["channels"]) == [channel["name"] for channel in card["channels"]]


@pytest.mark.parametrize(
    ("agent", "message"),
    [("ipc", "must be a trained one to be exported as a policy"), ("nothing.zip", "no trained model")],
)
def test_what_has_no_policy_is_refused(agent, message, tmp_path):
    with pytest.raises(SystemExit, match=message):
        run_command("export", [agent, "--out", str(tmp_path)])
