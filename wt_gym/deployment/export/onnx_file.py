"""A policy as an ONNX file: measured channels in, action out, scaling and clipping inside."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from pathlib import Path

    from wt_gym.deployment.export.network import Network

__all__ = ["INPUT", "OPSET", "OUTPUT", "check_onnx", "write_onnx"]

INPUT, OUTPUT = "channels", "action"
"""Names of the tensors: float64 (n, n_obs) in SI units, and float32 (n, n_act)."""
OPSET = 17
"""Version of the operators; runtimes read it since 2022."""
_OPERATORS = {"tanh": "Tanh", "relu": "Relu", "elu": "Elu"}


def write_onnx(network: Network, path: Path, metadata: dict[str, Any]) -> None:
    """Write a policy.

    Parameters
    ----------
    network : Network
    path : pathlib.Path
    metadata : dict
        JSON values kept in the file beside the names and units of the channels.
    """
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
    """Compare the actions of a file with those of a network, over drawn values.

    The values go a tenth beyond the ranges of the sensors.

    Returns
    -------
    float
        Largest difference [-].

    Raises
    ------
    ModuleNotFoundError
        If onnxruntime is not installed.
    ValueError
        If an action differs by more than the rounding of single precision (`Network.rounding`).
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
