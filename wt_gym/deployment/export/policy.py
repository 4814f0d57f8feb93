"""Trained policies as arrays and as ONNX files, with a card.

A policy computes, from the measured channels to the action, ``observation = clip(channels, low, high)``, then
``(observation − offset)/scale`` (`wt_gym.envs.layout`), then the statistics of the training where it normalized
observations, then fully connected layers, then the mean of the policy's distribution, squashed where the algorithm does
that, within the range of the actions. An ONNX file has all of it inside. The card says what an agent is made for, what
it reads and gives, and what it did in its training.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import FlattenExtractor

import wt_gym
from wt_gym.analysis.statistics import relative_change
from wt_gym.base.files import write_text_whole
from wt_gym.control.controllers import parse_name
from wt_gym.control.controllers.names import BASELINE
from wt_gym.envs.layout import EnvLayout
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.experiment.agents import load_model
from wt_gym.experiment.environments import trained_arguments, training_arguments
from wt_gym.experiment.trained_agent import TrainedAgent, model_card

if TYPE_CHECKING:
    from stable_baselines3.common.running_mean_std import RunningMeanStd

POLICY_FILE, CARD_FILE = "policy.onnx", "README.md"
_KEPT = ("agent", "turbine", "control_step_s", "reading_delay_steps", "action_mode", "base_controller", "wt_gym")


def training_environment(agent: TrainedAgent, env_kwargs: dict[str, Any]) -> WindTurbineEnv:
    """Environment that an agent was trained in, without a limit of time or a twin."""
    arguments = training_arguments(agent.record, env_kwargs)
    alone = {"relative_reward": False, "reward_credit": False, "episode_length": None}
    return WindTurbineEnv(**(arguments | alone))


def export_onnx(choice: str, folder: str | Path) -> dict[str, Any]:
    """Write a trained agent's policy as an ONNX file with a card beside it, and check it.

    Returns
    -------
    dict
        ``files`` and ``largest_difference`` of the actions of the file against those of the policy.

    Raises
    ------
    ValueError, FileNotFoundError
        If the name is not a trained agent, its policy cannot be exported (`network_of`), or the file gives other
        actions; if there is no model.
    """
    name = parse_name(choice)
    if name.kind != "trained":
        raise ValueError(f"an agent must be a trained one to be exported as a policy, got the {name.kind} {choice!r}")
    agent = load_model(name)
    env = training_environment(agent, model_card(name.target, name.parameters.get("env")).get("env_kwargs", {}))
    layout = env.layout
    env.close()
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


_UNIT = 2.0**-24
"""Relative error of rounding in single precision [-]."""
_OF_ACTIVATION = 2.0 * _UNIT
"""Error of a hyperbolic tangent or exponential in single precision; they are at most 1 [-]."""
ACTIVATIONS = {torch.nn.Tanh: "tanh", torch.nn.ReLU: "relu", torch.nn.ELU: "elu"}
"""Activations of layers, and their names here."""


@dataclass(frozen=True)
class Layer:
    """``activation(weight x + bias)``."""

    weight: np.ndarray  #: shape (n_out, n_in), float32
    bias: np.ndarray  #: shape (n_out,), float32
    activation: str  #: of `ACTIVATIONS`, or "" for none


@dataclass(frozen=True)
class Normalization:
    """``clip((x − mean)/sqrt(variance + epsilon), −limit, limit)``, statistics of the training."""

    mean: np.ndarray  #: shape (n,)
    deviation: np.ndarray  #: ``sqrt(variance + epsilon)``, shape (n,)
    limit: float


@dataclass(frozen=True)
class Network:
    """A policy from measured channels to the action."""

    channels: tuple[Any, ...]
    """In SI units, as the environment lists them; those of earlier readings are called ``NAME@k``."""
    offset: np.ndarray
    """Of the channels, shape (n_obs,), as the next three."""
    scale: np.ndarray
    low: np.ndarray
    high: np.ndarray
    normalization: Normalization | None
    layers: tuple[Layer, ...]
    action_names: tuple[str, ...]
    action_low: np.ndarray
    """Range of the actions, shape (n_act,), float32."""
    action_high: np.ndarray
    squashed: bool
    """Whether the last layer's output goes from −1 to 1 over the range, not clipped to it."""

    def action(self, values: np.ndarray) -> np.ndarray:
        """Action (..., n_act), float32, for measured values (..., n_obs) in SI units, with NumPy alone."""
        return self.of_observation(self._observation(values))

    def _observation(self, values: np.ndarray) -> np.ndarray:
        observation: np.ndarray = (np.clip(values, self.low, self.high) - self.offset) / self.scale
        return observation

    def _standardized(self, observation: np.ndarray) -> np.ndarray:
        """Input of the first layer, float32."""
        x = np.asarray(observation).astype(np.float32)
        if self.normalization is not None:
            n = self.normalization
            x = np.clip((x - n.mean) / n.deviation, -n.limit, n.limit).astype(np.float32)
        return x

    def rounding(self, values: np.ndarray) -> np.ndarray:
        """Bound on the difference (..., n_act) of two single-precision computations of an action, in any order of sums.

        Rounding errors are independent, with zero mean and at most u = 2⁻²⁴ of the rounded number, as in the analysis
        of Higham and Mary (SIAM J. Sci. Comput. 41, 2019, A2815). Each of the n additions of a sum s of products p
        rounds a partial sum, whose mean square over all orders is at most s² + Σ p²; so the error of the sum has the
        variance n u² (s² + Σ p²). A layer passes on the root sum square of the errors of its inputs times its weights;
        activations enlarge none and add a unit in the last place. The bound is seven standard deviations.
        """
        x = self._standardized(self._observation(values)).astype(np.float64)
        error = _UNIT * np.abs(x)
        for layer in self.layers:
            squares = (layer.weight.astype(np.float64) ** 2).T
            sums = x @ layer.weight.T + layer.bias
            own = len(squares) * _UNIT**2 * (sums**2 + x**2 @ squares + layer.bias**2)
            error = np.sqrt(error**2 @ squares + own)
            x = _APPLIED[layer.activation](sums)
            error = error + (_OF_ACTIVATION if layer.activation else 0.0)
        if self.squashed:
            error = 0.5 * (self.action_high - self.action_low) * (error + _OF_ACTIVATION)
        ends = np.maximum(np.abs(self.action_low), np.abs(self.action_high))
        bound: np.ndarray = 7.0 * math.sqrt(2.0) * error + 4.0 * _UNIT * ends
        return bound

    def of_observation(self, observation: np.ndarray) -> np.ndarray:
        """Action (..., n_act), float32, for an observation (..., n_obs) as the environment gives it."""
        x = self._standardized(observation)
        for layer in self.layers:
            x = _APPLIED[layer.activation](x @ layer.weight.T + layer.bias)
        if self.squashed:
            x = self.action_low + 0.5 * (np.tanh(x) + 1.0) * (self.action_high - self.action_low)
        action: np.ndarray = np.clip(x, self.action_low, self.action_high).astype(np.float32)
        return action


_APPLIED: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "": lambda x: x,
    "tanh": np.tanh,
    "relu": lambda x: np.maximum(x, 0.0),
    "elu": lambda x: np.where(x > 0.0, x, np.expm1(np.minimum(x, 0.0))),
}


def network_of(agent: TrainedAgent, layout: EnvLayout) -> Network:
    """Take a policy apart, for the layout of an environment that it fits."""
    agent.check_fits(layout)
    policy, space = agent.model.policy, agent.model.action_space
    if not isinstance(space, spaces.Box):
        raise ValueError(f"the policy must have a continuous action (Box) to be exported, got {space}")
    if not hasattr(policy, "actor") and (hasattr(policy, "lstm_actor") or not hasattr(policy, "mlp_extractor")):
        raise ValueError(
            "a policy to be exported must be one of PPO, A2C, TRPO, SAC, TQC, TD3 or DDPG, got "
            f"{type(policy).__name__} of {type(agent.model).__name__}"
        )
    extractor = getattr(getattr(policy, "actor", policy), "features_extractor", None)
    if not isinstance(extractor, FlattenExtractor):
        raise ValueError(
            f"the policy must take the observation as it is (FlattenExtractor) to be exported, got {extractor!r}"
        )
    observation = layout.observation
    arrays = {
        name: np.array([getattr(channel, name) for channel in observation.channels])
        for name in ("offset", "scale", "low", "high")
    }
    modules, squashed = _modules(policy)
    return Network(
        channels=observation.channels,
        **arrays,
        normalization=_normalization(agent),
        layers=_layers(modules),
        action_names=tuple(layout.action.names),
        action_low=space.low.astype(np.float32),
        action_high=space.high.astype(np.float32),
        squashed=squashed,
    )


def _normalization(agent: TrainedAgent) -> Normalization | None:
    made = agent.normalization
    if made is None or not made.norm_obs:
        return None
    statistics = cast("RunningMeanStd", made.obs_rms)  # of a flat observation
    return Normalization(statistics.mean.copy(), np.sqrt(statistics.var + made.epsilon), float(made.clip_obs))


def _modules(policy: Any) -> tuple[list[Any], bool]:
    """Modules of a policy in the order in which they act, and whether the output is squashed."""
    actor = getattr(policy, "actor", None)
    if actor is None:  # PPO, A2C
        return [*policy.mlp_extractor.policy_net, policy.action_net], False
    if hasattr(actor, "latent_pi"):  # SAC, TQC
        return [*actor.latent_pi, *(actor.mu if isinstance(actor.mu, torch.nn.Sequential) else [actor.mu])], True
    return list(actor.mu)[:-1], True  # TD3, DDPG: the last one is the tanh


def _layers(modules: Iterable[Any]) -> tuple[Layer, ...]:
    layers: list[Layer] = []
    for module in modules:
        if isinstance(module, torch.nn.Linear):
            weight, bias = (p.detach().cpu().numpy().astype(np.float32) for p in (module.weight, module.bias))
            layers.append(Layer(weight.copy(), bias.copy(), ""))
        elif type(module) in ACTIVATIONS and layers and not layers[-1].activation:
            layers[-1] = Layer(layers[-1].weight, layers[-1].bias, ACTIVATIONS[type(module)])
        else:
            raise ValueError(
                f"a policy to be exported must be made of fully connected layers with "
                f"{', '.join(ACTIVATIONS.values())}, got {module!r}"
            )
    return tuple(layers)


INPUT, OUTPUT = "channels", "action"
"""Names of the tensors: float64 (n, n_obs) in SI units, and float32 (n, n_act)."""
OPSET = 17
"""Version of the operators; runtimes read it since 2022."""
_OPERATORS = {"tanh": "Tanh", "relu": "Relu", "elu": "Elu"}


def write_onnx(network: Network, path: Path, metadata: dict[str, Any]) -> None:
    """Write a policy, with metadata of JSON values beside the names and units of the channels."""
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    constants: list[Any] = []
    nodes: list[Any] = []

    def constant(name: str, value: Any) -> str:
        constants.append(numpy_helper.from_array(np.asarray(value), name))
        return name

    def node(kind: str, inputs: list[str], output: str, **attributes: Any) -> str:
        nodes.append(helper.make_node(kind, inputs, [output], **attributes))
        return output

    def clip(x: str, low: Any, high: Any, name: str) -> str:
        above = node("Max", [x, constant(f"{name}_low", low)], f"{name}_above")
        return node("Min", [above, constant(f"{name}_high", high)], name)

    x = clip(INPUT, network.low, network.high, "measured")
    x = node("Sub", [x, constant("offset", network.offset)], "centered")
    x = node("Div", [x, constant("scale", network.scale)], "scaled")
    x = node("Cast", [x], "observation", to=TensorProto.FLOAT)
    if network.normalization is not None:
        n = network.normalization
        x = node("Cast", [x], "observation_64", to=TensorProto.DOUBLE)
        x = node("Sub", [x, constant("mean", n.mean)], "deviation_from_mean")
        x = node("Div", [x, constant("deviation", n.deviation)], "standardized_64")
        x = clip(x, np.float64(-n.limit), np.float64(n.limit), "limited_64")
        x = node("Cast", [x], "standardized", to=TensorProto.FLOAT)
    for k, layer in enumerate(network.layers):
        weights = [constant(f"weight_{k}", layer.weight), constant(f"bias_{k}", layer.bias)]
        x = node("Gemm", [x, *weights], f"layer_{k}", transB=1)
        if layer.activation:
            x = node(_OPERATORS[layer.activation], [x], f"activated_{k}")
    low, high = network.action_low, network.action_high
    if network.squashed:
        x = node("Tanh", [x], "squashed")
        x = node("Mul", [x, constant("half_range", 0.5 * (high - low))], "spread")
        x = node("Add", [x, constant("middle", 0.5 * (high + low))], "unclipped")
    node("Identity", [clip(x, low, high, "clipped")], OUTPUT)

    n_obs, n_act = len(network.channels), len(network.action_names)
    graph = helper.make_graph(
        nodes, "policy",
        [helper.make_tensor_value_info(INPUT, TensorProto.DOUBLE, ["n", n_obs])],
        [helper.make_tensor_value_info(OUTPUT, TensorProto.FLOAT, ["n", n_act])],
        constants,
    )  # fmt: skip
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=8)
    kept = metadata | {
        "channels": [channel.name for channel in network.channels],
        "units": [channel.unit for channel in network.channels],
        "actions": list(network.action_names),
    }
    helper.set_model_props(model, {key: json.dumps(value) for key, value in kept.items()})
    onnx.checker.check_model(model, full_check=True)
    path.write_bytes(model.SerializeToString())


def check_onnx(network: Network, path: Path, count: int = 1000, seed: int = 0) -> float:
    """Largest difference of the actions of a file from those of a network [-], over drawn values.

    The values go a tenth beyond the ranges of the sensors.

    Raises
    ------
    ModuleNotFoundError, ValueError
        If onnxruntime is not installed; if an action differs by more than the rounding of single precision
        (`Network.rounding`).
    """
    import onnxruntime

    rng = np.random.default_rng(seed)
    middle, half = 0.5 * (network.high + network.low), 0.55 * (network.high - network.low)
    values = middle + half * rng.uniform(-1.0, 1.0, (count, middle.size))
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    (found,) = session.run([OUTPUT], {INPUT: values})
    difference, bound = np.abs(found - network.action(values)), network.rounding(values)
    if not np.all(difference <= bound):
        worst = np.unravel_index(np.argmax(difference - bound), bound.shape)
        raise ValueError(
            f"the actions of {path} must be those of the policy within {bound[worst]:.1e}, the rounding of single "
            f"precision, they differ by {difference[worst]:.1e}"
        )
    return float(np.max(difference))


_EFFECTS = {
    "mean_power": "mean power",
    "blade_flap_del": "flapwise blade-root DEL",
    "tower_fore_aft_del": "tower-base fore-aft DEL",
    "tower_side_side_del": "tower-base side-side DEL",
}


def card_of(name: str, record: Mapping[str, Any], layout: EnvLayout, network: Network) -> dict[str, Any]:
    """Facts of an agent as JSON values; the record of its training is empty where there is none."""
    arguments = trained_arguments(record)
    observation = layout.observation
    return {
        "agent": name,
        "wt_gym": wt_gym.__version__,
        "turbine": layout.turbine.name,
        "algorithm": record.get("algorithm"),
        "training_steps": record.get("steps"),
        "training_wind_seeds": record.get("wind_seeds"),
        "training_wind_speed": arguments.get("wind_speed"),
        "control_step_s": layout.control_dt,
        "reading_delay_steps": layout.delay,
        "action_mode": layout.action.mode,
        "base_controller": arguments.get("controller") or (BASELINE if layout.action.needs_controller else None),
        "layers": [list(layer.weight.shape) for layer in network.layers],
        "channels": [
            {"name": c.name, "unit": c.unit, "low": c.low, "high": c.high, "meaning": c.description}
            for c in observation.channels
        ],
        "actions": [
            {"name": action, "low": float(low), "high": float(high)}
            for action, low, high in zip(
                network.action_names, network.action_low, network.action_high, strict=True
            )
        ],
        "effects": _effects(record),
    }  # fmt: skip


def _effects(record: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Changes against the baseline in the last evaluation of the training, by wind."""
    evaluation = record.get("evaluation") or {}
    winds, before, after = (evaluation.get(key) or [] for key in ("winds", "baseline", "agent"))
    return [
        {"wind": wind, **{k: relative_change(new[k], old[k]) for k in _EFFECTS if old.get(k) and k in new}}
        for wind, old, new in zip(winds, before, after, strict=False)
        if isinstance(old, dict) and isinstance(new, dict)
    ]


def card_text(card: Mapping[str, Any], files: Iterable[str]) -> str:
    """Card as a page in Markdown."""
    steps = card["training_steps"]
    trained = f"{card['algorithm']}, {steps:,} steps" if steps else "no record of a training"
    seeds = card["training_wind_seeds"]
    facts = {
        "turbine": card["turbine"],
        "training": trained,
        "training winds": f"{card['training_wind_speed']} m/s, {len(seeds)} turbulence seeds" if seeds else "unknown",
        "control step": f"{card['control_step_s']:g} s",
        "delay of the readings": f"{card['reading_delay_steps']} control steps",
        "actions": card["action_mode"],
        "base controller": card["base_controller"] or "none",
        "layers": ", ".join("x".join(map(str, shape)) for shape in card["layers"]),
        "made with": f"wt_gym {card['wt_gym']}",
        "files": ", ".join(files),
    }
    lines = [f"# {card['agent']}", "", "| | |", "|---|---|", *(f"| {k} | {v} |" for k, v in facts.items()), ""]
    lines += ["## Inputs", "", "In this order, in SI units. Values beyond the range read as its end.", ""]
    lines += _table(("name", "unit", "low", "high", "meaning"), card["channels"])
    lines += ["", "## Outputs", ""]
    lines += _table(("name", "low", "high"), card["actions"])
    lines += ["", "## Measured effects", ""]
    if card["effects"]:
        lines += ["Against the baseline in the last evaluation of the training.", ""]
        rows = [
            {"wind": _wind(row["wind"])} | {_EFFECTS[k]: f"{100 * row[k]:+.1f} %" for k in _EFFECTS if k in row}
            for row in card["effects"]
        ]
        lines += _table(tuple(rows[0]), rows)
    else:
        lines.append("The record of the training holds none.")
    lines += [
        "", "## Limits", "",
        "The policy holds for the turbine, the winds and the base controller above. It does not check its inputs for "
        "faults: a missing reading is for the caller to handle, by resting the actions.",
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def _wind(wind: Any) -> str:
    return f"{wind['speed']:g} m/s, seed {wind['seed']}" if isinstance(wind, dict) else str(wind)


def _table(columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Rows as a table in Markdown."""

    def shown(value: Any) -> str:
        return f"{value:.6g}" if isinstance(value, float) else str(value)

    lines = [f"| {' | '.join(columns)} |", "|---" * len(columns) + "|"]
    return lines + [f"| {' | '.join(shown(row.get(c, '')) for c in columns)} |" for row in rows]
