"""Export of a trained policy."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wt_gym.base.files import write_text_whole
from wt_gym.control.controllers import parse_name
from wt_gym.deployment.export.card import card_of, card_text
from wt_gym.deployment.export.network import network_of
from wt_gym.deployment.export.onnx_file import check_onnx, write_onnx
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.experiment.pool import load_model
from wt_gym.experiment.trained_agent import model_card
from wt_gym.experiment.trained_environment import training_arguments

if TYPE_CHECKING:
    from wt_gym.envs.layout import EnvLayout
    from wt_gym.experiment.trained_agent import TrainedAgent

__all__ = [
    "CARD_FILE", "POLICY_FILE", "export_onnx", "training_environment",
    "training_layout",
]  # fmt: skip

POLICY_FILE, CARD_FILE = "policy.onnx", "README.md"


def training_environment(agent: TrainedAgent, env_kwargs: dict[str, Any]) -> WindTurbineEnv:
    """Environment that an agent was trained in, without a limit of time or a twin."""
    arguments = training_arguments(agent.record, env_kwargs)
    return WindTurbineEnv(**(arguments | {"relative_reward": False, "episode_length": None}))


def training_layout(agent: TrainedAgent, env_kwargs: dict[str, Any]) -> EnvLayout:
    """Layout of `training_environment`."""
    env = training_environment(agent, env_kwargs)
    try:
        return env.layout
    finally:
        env.close()


def export_onnx(choice: str, folder: str | Path) -> dict[str, Any]:
    """Write a trained agent's policy as an ONNX file with a card beside it, and check it.

    Parameters
    ----------
    choice : str
        Name of a trained agent: a folder or a file.
    folder : str or path

    Returns
    -------
    dict
        ``files`` and ``largest_difference`` of the actions of the file against those of the policy.

    Raises
    ------
    ValueError
        If the name is not a trained agent, its policy cannot be exported (`network_of`), or the file gives other
        actions.
    FileNotFoundError
        If there is no model.
    """
    name = parse_name(choice)
    if name.kind != "trained":
        raise ValueError(f"an agent must be a trained one to be exported as a policy, got the {name.kind} {choice!r}")
    agent = load_model(name)
    layout = training_layout(agent, model_card(name.target, name.parameters.get("env")).get("env_kwargs", {}))
    network = network_of(agent, layout)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    card = card_of(Path(name.target).stem, agent.record or {}, layout, network)
    write_onnx(network, folder / POLICY_FILE, {key: card[key] for key in _KEPT})
    difference = check_onnx(network, folder / POLICY_FILE)
    write_text_whole(folder / "card.json", json.dumps(card, indent=1) + "\n")
    write_text_whole(folder / CARD_FILE, card_text(card, [POLICY_FILE, "card.json"]))
    return {
        "files": [str(folder / file) for file in (POLICY_FILE, "card.json", CARD_FILE)],
        "largest_difference": difference,
    }


_KEPT = ("agent", "turbine", "control_step_s", "reading_delay_steps", "action_mode", "base_controller", "wt_gym")
