"""The networks of RLlib in those of stable-baselines3: layers of the same shapes by other names.

So a policy of RLlib is written, evaluated and compared as every other trained model, without Ray.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import torch

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from stable_baselines3.common.base_class import BaseAlgorithm

__all__ = ["first_weights", "take_weights"]


def take_weights(model: BaseAlgorithm, weights: Mapping[str, Any]) -> None:
    """Give a model the policy of RLlib, and PPO its value network too.

    The critics of SAC are built otherwise in RLlib: those of the model stay what they are, and no policy needs them.

    Parameters
    ----------
    model : BaseAlgorithm
        PPO or SAC of stable-baselines3.
    weights : mapping
        State of RLlib's module by name.
    """
    state = model.policy.state_dict()
    for theirs, ours in _names(model):
        parts = [state[name] for name in ours]
        value = torch.as_tensor(weights[theirs])
        for part, piece in zip(parts, value.split([len(part) for part in parts]), strict=True):
            part.copy_(piece)
    model.policy.load_state_dict(state)


def first_weights(model: BaseAlgorithm) -> dict[str, Any]:
    """Weights of a fresh model by RLlib's names: both begin with the same policy, ``log_std_init`` included.

    Returns
    -------
    dict
        Name to numpy.ndarray.
    """
    state = model.policy.state_dict()
    return {theirs: torch.cat([state[name] for name in ours]).numpy() for theirs, ours in _names(model)}


def _names(model: BaseAlgorithm) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Name in RLlib of each tensor, with those in stable-baselines3 that it is made of, one below the other."""
    squashed = type(model).__name__ == "SAC"
    layers = len(model.policy_kwargs["net_arch"])
    body, encoder = (
        ("actor.latent_pi", "pi_encoder") if squashed else ("mlp_extractor.policy_net", "encoder.actor_encoder")
    )
    heads = ("actor.mu", "actor.log_std") if squashed else ("action_net",)
    for kind in ("weight", "bias"):
        for k in range(0, 2 * layers, 2):  # activations stand between
            yield f"{encoder}.net.mlp.{k}.{kind}", (f"{body}.{k}.{kind}",)
            if not squashed:
                yield f"encoder.critic_encoder.net.mlp.{k}.{kind}", (f"mlp_extractor.value_net.{k}.{kind}",)
        yield f"pi.net.mlp.0.{kind}", tuple(f"{head}.{kind}" for head in heads)
        if not squashed:
            yield f"vf.net.mlp.0.{kind}", (f"value_net.{kind}",)
    if not squashed:
        yield "pi.log_std", ("log_std",)
