"""Policies trained with stable-baselines3, with the statistics that normalize their observations."""

from __future__ import annotations

import base64
import hashlib
import io
import json
import pickle
import re
import zipfile
import zlib
from collections.abc import Mapping
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray
from sb3_contrib import ARS, TQC, TRPO, CrossQ, RecurrentPPO
from stable_baselines3 import A2C, DDPG, DQN, PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecNormalize

from wt_gym.base.errors import did_you_mean
from wt_gym.base.files import read_json
from wt_gym.experiment.policy_arrays import PolicyArrays

if TYPE_CHECKING:
    from gymnasium import spaces

    from wt_gym.envs.layout import EnvLayout

__all__ = [
    "ALGORITHM_CLASSES", "BEST_MODEL_FILE", "BEST_NORMALIZATION_FILE", "DAMAGE", "MODEL_FILE", "NORMALIZATION_FILE",
    "RECORD_FILE", "TrainedAgent", "UnsafePickleError", "model_card", "model_digests", "model_files", "read_record",
]  # fmt: skip

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
    """Read a pickled object of `_NAMES` only; an `UnsafePickleError` names the first other, which is not called."""
    return _Restricted(io.BytesIO(data)).load()


def read_data(model_file: Path) -> dict[str, Any]:
    """Data of the model in a stable-baselines3 zip, pickled parts as text; a `ValueError` if it is no such file."""
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
    """Algorithm of a model by its class of policies or the settings that only it has; None where neither is known."""
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

    Gives ``custom_objects`` for ``load`` of stable-baselines3, which then unpickles nothing itself. Raises an
    `UnsafePickleError` if spaces, policy or its arguments are made of anything else.
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


MODEL_FILE, NORMALIZATION_FILE, RECORD_FILE = "model.zip", "vecnormalize.pkl", "training.json"
BEST_MODEL_FILE, BEST_NORMALIZATION_FILE = "best_model.zip", "best_model_vecnormalize.pkl"

ALGORITHM_CLASSES = {cls.__name__: cls for cls in (PPO, A2C, SAC, TQC, TD3, DDPG, DQN, CrossQ, RecurrentPPO, TRPO, ARS)}
"""Algorithms whose models can be loaded."""

DAMAGE = (
    pickle.UnpicklingError, zipfile.BadZipFile, zlib.error, EOFError, ImportError, AssertionError, AttributeError,
    KeyError, IndexError, TypeError, ValueError, RuntimeError, OverflowError, MemoryError,
)  # fmt: skip
"""What pickle, zipfile, torch and stable-baselines3 raise where a file is damaged, or holds something else."""

_CARD = ("algo", "env_kwargs")
_CHECKPOINT = re.compile(r"(?P<prefix>.+)_(?P<steps>\d+)_steps\.zip")


def read_record(path: Path) -> dict[str, Any]:
    """Read how a model was trained; a `ValueError` if the file is damaged."""
    record: dict[str, Any] = read_json(path)
    if not isinstance(record.get("algorithm"), str):
        raise ValueError(f"{path} is not the record of a training: it names no algorithm")
    return record


def read_normalization(path: Path, trust: bool = False) -> VecNormalize:
    """Read the statistics of a training. They are pickled; what could run code is refused unless it is trusted.

    Raises
    ------
    wt_gym.experiment.trained_agent.UnsafePickleError
        If they hold anything but arrays, spaces and statistics.
    ValueError
        If the file is damaged, or holds something else.
    """
    try:
        data = path.read_bytes()
        normalization = pickle.loads(data) if trust else safe_loads(data)
    except UnsafePickleError as error:
        raise UnsafePickleError(
            f"the statistics {path} hold {error}: to load that could run any code. If you know who made the file, say "
            "so by --trust, or by trust=True behind its name"
        ) from error
    except DAMAGE as error:
        raise ValueError(f"the statistics {path} are damaged: {type(error).__name__}: {error}") from error
    if not isinstance(normalization, VecNormalize) or "observation_space" not in vars(normalization):
        raise ValueError(f"{path} holds no statistics of a training but a {type(normalization).__name__}")
    return normalization


def model_card(path: str | Path, file: str | Path | None = None) -> dict[str, Any]:
    """Card of a model that was trained elsewhere: ``algo``, and ``env_kwargs`` that it wants; empty without one.

    ``file`` is by default the JSON file beside the model with its name. Raises a `FileNotFoundError` if a named file is
    not there, a `ValueError` if it is damaged or says something else.
    """
    path = Path(path)
    beside = path.with_suffix(".json") if file is None else Path(file)
    if file is None and (path.is_dir() or not beside.is_file()):
        return {}
    card: dict[str, Any] = read_json(beside)
    if other := [key for key in card if key not in _CARD]:
        raise ValueError(f"{beside} must hold a table of {' and '.join(_CARD)}, got {', '.join(other)}")
    return card


def _record_of(model_file: Path) -> dict[str, Any] | None:
    """How a model was trained, with ``checkpoint``, the steps until then, for a checkpoint; None if unknown."""
    checkpoint = _CHECKPOINT.fullmatch(model_file.name)
    folders = [model_file.parent, model_file.absolute().parent.parent] if checkpoint else [model_file.parent]
    for folder in folders:
        if (folder / RECORD_FILE).is_file():
            record = read_record(folder / RECORD_FILE)
            return record | {"checkpoint": int(checkpoint["steps"])} if checkpoint else record
    return None


def _statistics_file(model_file: Path) -> Path | None:
    """Statistics that belong to a model: those of the checkpoint or of the best model, else those beside the model."""
    names = [NORMALIZATION_FILE]
    if checkpoint := _CHECKPOINT.fullmatch(model_file.name):
        names.insert(0, f"{checkpoint['prefix']}_vecnormalize_{checkpoint['steps']}_steps.pkl")
    elif model_file.name == BEST_MODEL_FILE:
        names.insert(0, BEST_NORMALIZATION_FILE)
    return next((model_file.parent / name for name in names if (model_file.parent / name).is_file()), None)


def model_files(path: str | Path) -> tuple[Path, ...]:
    """Files that a trained agent is loaded from: the model and, where there are any, its statistics.

    Parameters
    ----------
    path : str or path
        Folder with ``model.zip``, or a model file.

    Raises
    ------
    FileNotFoundError
        If there is no model.
    """
    path = Path(path)
    model_file = path / MODEL_FILE if path.is_dir() else path
    if not model_file.is_file():
        raise FileNotFoundError(f"no trained model at {model_file}")
    statistics_file = _statistics_file(model_file)
    return (model_file,) if statistics_file is None else (model_file, statistics_file)


def model_digests(path: str | Path) -> dict[str, str]:
    """SHA-256 sums of the `model_files` of a trained agent by name: what tells it from every other one."""
    return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in model_files(path)}


class TrainedAgent:
    """A stable-baselines3 model that takes the environment's own observations.

    Parameters
    ----------
    normalization : VecNormalize, optional
        Statistics of the training; None if the model was trained on plain observations.
    record : dict, optional
        How it was trained, as written by `wt_gym.learning.train.train`.
    """

    def __init__(
        self, model: BaseAlgorithm, normalization: VecNormalize | None = None, record: dict[str, Any] | None = None
    ):
        self.model, self.normalization, self.record = model, normalization, record
        self._arrays: tuple[list[Any], PolicyArrays | None] | None = None  # what `_means` computes with
        self._signs: tuple[np.ndarray, np.ndarray] | None = None  # of observation and action, through the mirror
        self._held, self._steps = 1, 0  # control steps that an action is held for, and those since the start
        self._last: np.ndarray | None = None

    @classmethod
    def load(
        cls,
        path: str | Path,
        algorithm: str | None = None,
        trust: bool = False,
        classes: Mapping[str, type[BaseAlgorithm]] | None = None,
    ) -> TrainedAgent:
        """Load a model from its zip file or from the folder that training wrote.

        The files hold pickled Python objects, which can run any code when they are loaded. What a policy needs of them
        is read by a list of harmless names; the rest of a training, as schedules and buffers, is left out where it is
        not on that list.

        Parameters
        ----------
        path : str or path
            Folder with ``model.zip``, or a model file. ``vecnormalize.pkl`` and ``training.json`` beside it are used if
            they exist. A checkpoint ``<prefix>_<n>_steps.zip`` takes its own statistics
            ``<prefix>_vecnormalize_<n>_steps.pkl`` first, and a ``training.json`` in the folder above too;
            ``best_model.zip`` has statistics of its own as well.
        algorithm : str, optional
            Class of the model; default: that of the training record, else what the file itself shows.
        trust : bool
            Load everything as stable-baselines3 does, with whatever code is in it.
        classes : mapping, optional
            Class of the model by algorithm; default: `ALGORITHM_CLASSES`.

        Raises
        ------
        FileNotFoundError
            If there is no model, or no statistics although the record says that observations were normalized.
        ValueError
            If the algorithm is unknown or another one than the model's, or a file is damaged.
        wt_gym.experiment.trained_agent.UnsafePickleError
            If policy, spaces or statistics need anything else, and the file is not trusted.
        """
        model_file, *statistics = model_files(path)
        record, statistics_file = _record_of(model_file), statistics[0] if statistics else None
        if statistics_file is None and (record or {}).get("normalized"):
            raise FileNotFoundError(
                f"{model_file} was trained on normalized observations, but their statistics are not beside it"
            )
        data = read_data(model_file)
        shown = algorithm_of(data)
        name = algorithm or (record or {}).get("algorithm") or shown
        if name not in ALGORITHM_CLASSES:
            known = ", ".join(ALGORITHM_CLASSES)
            if name is None:
                raise ValueError(
                    f"{model_file} does not show its algorithm: state it by --algo, or by algo= behind its name, one "
                    f"of {known}; a model of another library runs as a class with predict (docs/howto/own_agent.md)"
                )
            near = did_you_mean(str(name), ALGORITHM_CLASSES)
            raise ValueError(f"algorithm must be one of {known}, got {name!r}{near}")
        if shown is not None and name != shown and {name, shown} != {"TD3", "DDPG"}:
            raise ValueError(f"{model_file} is not a model of {name} but of {shown}, as its settings show")
        normalization = None if statistics_file is None else read_normalization(statistics_file, trust)
        try:
            objects = None if trust else safe_objects(data, model_file)
            model = (classes or ALGORITHM_CLASSES)[name].load(model_file, device="cpu", custom_objects=objects)
        except UnsafePickleError:
            raise
        except DAMAGE as error:
            raise ValueError(
                f"{model_file} is damaged, or not a model of {name}: {type(error).__name__}: {error!s:.200}"
            ) from error
        if normalization is not None and normalization.observation_space.shape != model.observation_space.shape:
            raise ValueError(f"the statistics {statistics_file} do not belong to the model {model_file}")
        return cls(model, normalization, record)

    def check_fits(self, layout: EnvLayout) -> None:
        """Refuse an environment whose observation or action the model was not made for.

        Raises
        ------
        ValueError
            With the first component in which they differ from the record of the training, or, without one, with the
            shapes of both; or with the control steps of both.
        """
        for what, offered in (("observation", layout.observation.names), ("action", layout.action.names)):
            required = (self.record or {}).get(what, offered)
            for k, (trained, found) in enumerate(zip_longest(required, offered)):
                if trained != found:
                    raise ValueError(
                        f"the model was trained with {trained or 'nothing'} as component {k} of the {what}, the "
                        f"environment has {found or 'nothing'} there"
                    )
        trained_at = (self.record or {}).get("control_dt", layout.control_dt)
        held = round(trained_at / layout.control_dt)
        remembers = any("@" in name for name in layout.observation.names)  # readings of earlier steps
        if abs(held * layout.control_dt - trained_at) > 1e-9 or held < 1 or (held > 1 and remembers):
            raise ValueError(
                f"the model was trained with a control step of {trained_at} s, that of the environment must be the "
                f"same{'' if remembers else ' or go into it a whole number of times'}, got {layout.control_dt} s"
            )
        required = (self.model.observation_space.shape, self.model.action_space.shape)
        offered = ((len(layout.observation),), (layout.action.size,))
        if required != offered:
            raise ValueError(
                f"the model takes observations and actions of shapes {required}, the environment has {offered}"
            )

    def enter(self, layout: EnvLayout) -> None:
        """Get ready for an environment: check that the model fits, and mirror a rotor that turns the other way.

        An agent that was trained on a rotor that turns clockwise sees a counter-clockwise one in a mirror, and acts
        through it: the components of observations and actions change their signs by their parity. In an environment
        with a shorter control step than that of its training an agent acts as often as in its training, and its action
        is held between; that is for one turbine at a time.

        Raises
        ------
        ValueError
            See `check_fits`.
        """
        self.check_fits(layout)
        self._held = round((self.record or {}).get("control_dt", layout.control_dt) / layout.control_dt)
        self._steps = 0
        self._signs = None
        if layout.turbine.rotation != (self.record or {}).get("rotation", "clockwise"):
            signs = layout.observation.parity, layout.action.parity
            self._signs = signs[0].astype(np.float32), signs[1].astype(np.float32)

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[NDArray[np.float32], Any]:
        """Action for an observation of the environment, not normalized yet.

        Returns
        -------
        action : numpy.ndarray, float32
        state
            As the model gives it (None for policies without memory).
        """
        observation = np.asarray(observation)
        if self._held > 1:
            if episode_start is not None and np.any(episode_start):
                self._steps = 0
            self._steps += 1
            if (self._steps - 1) % self._held:
                return cast("np.ndarray", self._last).copy(), state
        if self._signs is not None:
            observation = observation * self._signs[0]
        if self.normalization is not None:
            observation = self.normalization.normalize_obs(observation)
        means = self._means(observation) if deterministic else None
        if means is None:
            action, state = self.model.predict(observation, state, episode_start, deterministic)
        else:
            box = cast("spaces.Box", self.model.action_space)
            action = np.clip(means, box.low, box.high)
        action = action if self._signs is None else action * self._signs[1]
        self._last = action
        return action, state

    def __getstate__(self) -> dict[str, Any]:
        """Without the views of the parameters, which a copy would not share with its own model."""
        return vars(self) | {"_arrays": None}

    def _means(self, observation: NDArray[Any]) -> NDArray[np.float32] | None:
        """Actions before they are clipped, of a small network without torch; None where the model itself is asked.

        For one observation torch takes a multiple of the time, and far more where other processes keep the cores busy.
        The model itself says what is wrong with an observation.
        """
        model: Any = self.model
        asks = getattr(model.predict, "__func__", None)  # not so where a class or an object has its own
        if asks is not BaseAlgorithm.predict or not isinstance(model, (PPO, A2C)):
            return None
        policy = model.policy
        viewed = PolicyArrays.viewed(policy)
        if self._arrays is None or self._arrays[0] != viewed:
            self._arrays = viewed, PolicyArrays(policy) if PolicyArrays.represents(policy) else None
        arrays = self._arrays[1]
        if arrays is None or observation.ndim > 2 or observation.shape[-1:] != model.observation_space.shape:
            return None
        means = arrays.means(np.atleast_2d(observation))
        if not np.isfinite(means).all():
            return None
        return means if observation.ndim == 2 else means[0]
