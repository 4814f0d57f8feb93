"""Pickled parts of models read without running code: only what a policy needs, by a list of harmless names."""

from __future__ import annotations

import base64
import io
import json
import pickle
import zipfile
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["UnsafePickleError", "algorithm_of", "read_data", "safe_loads", "safe_objects"]

_NUMPY = ("numpy._core", "numpy.core")
_NAMES = {
    ("numpy", "dtype"), ("numpy", "ndarray"), ("collections", "deque"), ("collections", "OrderedDict"),
    *((f"{core}.multiarray", name) for core in _NUMPY for name in ("_reconstruct", "scalar")),
    *((f"{core}.numeric", "_frombuffer") for core in _NUMPY),
    ("gymnasium.spaces.box", "Box"), ("gymnasium.spaces.discrete", "Discrete"),
    ("numpy.random._pickle", "__generator_ctor"), ("numpy.random._pickle", "__bit_generator_ctor"),
    ("numpy.random._generator", "Generator"), ("numpy.random._pcg64", "PCG64"),
    ("numpy.random.bit_generator", "__pyx_unpickle_SeedSequence"), ("numpy.random.bit_generator", "SeedSequence"),
    *(("stable_baselines3.common.utils", f"{kind}Schedule") for kind in ("Float", "Linear", "Constant")),
    ("stable_baselines3.common.type_aliases", "TrainFreq"),
    ("stable_baselines3.common.type_aliases", "TrainFrequencyUnit"),
    ("stable_baselines3.common.running_mean_std", "RunningMeanStd"),
    ("stable_baselines3.common.vec_env.vec_normalize", "VecNormalize"),
    ("torch.optim.adam", "Adam"), ("torch.optim.rmsprop", "RMSprop"), ("torch.optim.adamw", "AdamW"),
    ("stable_baselines3.common.sb2_compat.rmsprop_tf_like", "RMSpropTFLike"),
    *(("torch.nn.modules.activation", name) for name in ("ReLU", "Tanh", "ELU", "LeakyReLU", "SiLU", "GELU")),
    ("stable_baselines3.common.torch_layers", "FlattenExtractor"),
    ("stable_baselines3.common.noise", "NormalActionNoise"),
    *(("stable_baselines3.common.buffers", f"{kind}Buffer") for kind in ("Rollout", "Replay")),
    ("stable_baselines3.common.policies", "ActorCriticPolicy"), ("stable_baselines3.sac.policies", "SACPolicy"),
    ("stable_baselines3.td3.policies", "TD3Policy"), ("stable_baselines3.dqn.policies", "DQNPolicy"),
    ("sb3_contrib.tqc.policies", "TQCPolicy"), ("sb3_contrib.crossq.policies", "CrossQPolicy"),
    ("sb3_contrib.ars.policies", "ARSPolicy"), ("sb3_contrib.ars.policies", "ARSLinearPolicy"),
    ("sb3_contrib.common.recurrent.policies", "RecurrentActorCriticPolicy"),
}  # fmt: skip
"""Classes and functions by module that do nothing but hold what they are given."""

_NEEDED = ("policy_class", "policy_kwargs", "observation_space", "action_space")
_IN_PLACE: dict[str, Any] = {"learning_rate": 0.0, "clip_range": 0.2, "train_freq": 1}
"""What stands in for parts of a training that a policy does not need; None for others."""


class UnsafePickleError(ValueError):
    """A pickled object asks for a class or function that could do anything."""


class _Restricted(pickle.Unpickler):
    """Knows nothing but `_NAMES`."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in _NAMES:
            raise UnsafePickleError(f"{module}.{name}")
        return super().find_class(module, name)


def safe_loads(data: bytes) -> Any:
    """Read a pickled object that is made of `_NAMES` only.

    Raises
    ------
    UnsafePickleError
        With the first name that is none of them; nothing of it has been called.
    """
    return _Restricted(io.BytesIO(data)).load()


def read_data(model_file: Path) -> dict[str, Any]:
    """What a stable-baselines3 zip says of its model, pickled parts as text.

    Raises
    ------
    ValueError
        If it is not such a file.
    """
    try:
        with zipfile.ZipFile(model_file) as archive:
            data = json.loads(archive.read("data"))
    except (zipfile.BadZipFile, KeyError, ValueError, EOFError, OSError) as error:
        raise ValueError(
            f"{model_file} is damaged, or not a model of stable-baselines3: {type(error).__name__}: {error!s:.200}"
        ) from error
    if not isinstance(data, dict):
        raise ValueError(f"{model_file} is not a model of stable-baselines3: its data must be a mapping")
    return data


def algorithm_of(data: dict[str, Any]) -> str | None:
    """Algorithm that a model was trained with, by its class of policies or the settings that only it has; None where
    neither is known.
    """
    policy = data.get("policy_class")
    module = str(policy.get("__module__", "")) if isinstance(policy, dict) else ""
    for name, part in (("CrossQ", ".crossq."), ("ARS", ".ars."), ("RecurrentPPO", ".recurrent.")):
        if module.startswith("sb3_contrib") and part in module:
            return name
    for name, key in (
        ("TQC", "top_quantiles_to_drop_per_net"),
        ("SAC", "target_entropy"),
        ("TD3", "policy_delay"),  # DDPG is TD3 with a delay of one, and predicts the same
        ("DQN", "exploration_fraction"),
        ("TRPO", "cg_max_steps"),
        ("PPO", "clip_range"),
        ("A2C", "gae_lambda"),
    ):
        if key in data:
            return name
    return None


def safe_objects(data: dict[str, Any], model_file: Path) -> dict[str, Any]:
    """Pickled parts of a model, read by `safe_loads`; what a policy does not need is replaced where it is unsafe.

    Parameters
    ----------
    data : dict
        Of `read_data`.
    model_file : path
        For messages.

    Returns
    -------
    dict
        ``custom_objects`` for ``load`` of stable-baselines3, which then unpickles nothing itself.

    Raises
    ------
    UnsafePickleError
        If spaces, policy or its arguments are made of anything else.
    """
    found: dict[str, Any] = {}
    for key, value in data.items():
        if not (isinstance(value, dict) and ":serialized:" in value):
            continue
        try:
            found[key] = safe_loads(base64.b64decode(value[":serialized:"]))
        except UnsafePickleError as error:
            if key in _NEEDED:
                raise UnsafePickleError(
                    f"{model_file} needs {error} for its {key}: to load that could run any code. If you know who made "
                    "the file, say so by --trust, or by trust=True behind its name"
                ) from error
            found[key] = _IN_PLACE.get(key)
    return found
