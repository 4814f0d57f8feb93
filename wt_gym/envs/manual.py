"""The environment in words: the documentation of its class, and what one that was made observes, does and earns."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from textwrap import TextWrapper
from typing import TYPE_CHECKING

from wt_gym.control import Channel
from wt_gym.control.controllers.names import controller_summary
from wt_gym.envs.operation import OWN
from wt_gym.envs.options import documentation
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.tasks import task_of

if TYPE_CHECKING:
    from gymnasium.envs.registration import EnvSpec

    from wt_gym.envs.turbine_env import WindTurbineEnv


HEAD, ARGUMENTS, _ATTRIBUTES, NOTES = re.split(
    "<!-- .+ -->", Path(__file__).with_name("manual.md").read_text(encoding="utf-8")
)
"""Actions, observations, reward and info; how options are given; attributes and errors; what else is to be known."""


def manual() -> str:
    """Give the documentation of the class."""
    parameters = f"Parameters\n----------\n{documentation('')}\n"
    return f"{HEAD}\n## Arguments\n{ARGUMENTS}\n{parameters}{_ATTRIBUTES}\nNotes\n-----{NOTES}"


_WIDTH, _INDENT = 120, 14


def describe(env: WindTurbineEnv, spec: EnvSpec | None, count: int = 1) -> str:
    """Text about an environment: ten lines, then what it observes; nothing is simulated for it.

    Parameters
    ----------
    spec : EnvSpec or None
        Definition that it or its vector environment was made of.
    count : int
        Number of turbines.
    """
    turbine, options, (low, high), action = env.turbine, env.options, env.wind.speeds, env.layout.action
    task = None if spec is None else task_of(spec.id)
    title = type(env).__name__ if spec is None else spec.id if task is None else f"{spec.id}: {task.goal}"
    speeds = f"{low:.4g} m/s" if low == high else f"{low:.4g} to {high:.4g} m/s"
    base, beside = options.controller.base, "changed by" if action.mode == "residual" else "beside"
    controller = f"{base if isinstance(base, str) else type(env.controller).__name__}, {beside} the actions"
    conditions = (
        f"faults: {', '.join(options.faults.kinds or ())}" if options.faults.kinds is not None else "",
        f"variation: {', '.join(options.variation.varies)}" if options.variation.varies else "",
        "a power reference" if options.grid.reference is not None else "",
        "a dial on the weights of the reward" if options.dial.weights is not None else "",
    )
    units = set(action.units)
    names = [f"{name} [{unit}]" for name, unit in zip(action.names, action.units, strict=True)]
    actions = ", ".join(names) if len(units) > 1 else f"{', '.join(action.names)} [{units.pop()}]"
    longest = env.length.longest(env.spec, env.outer_steps)
    choice = options.simulator
    simulator = choice if isinstance(choice, str) else choice["name"] if isinstance(choice, Mapping) else "your own"
    rows = {
        "task": ("" if count == 1 else f"{count} turbines, ") + title,
        "turbine": f"{turbine.heading}, {turbine.drivetrain.rated_power / 1e6:.4g} MW, rotor "
        f"{turbine.rotor_diameter:.4g} m, hub {turbine.hub_height:.4g} m",
        "wind": f"{env.wind.label}, {speeds} at hub height",
        "controller": "none: the actions are the demands" if env.controller is None else controller,
        "conditions": "; ".join(part for part in conditions if part),
        "actions": f"{action.size}, {action.mode}, every {env.control_dt:g} s: {actions}",
        "reward": ", ".join(f"{term.name} {term.weight:g}" for term in env.reward_terms),
        "episode": f"{'without a limit of time' if longest is None else f'{longest:g} s'}, start {options.start}, "
        f"fidelity {fidelity_of(env.fidelity).name}{'' if simulator == OWN else f', simulator {simulator}'}",
        "observations": f"{len(env.layout.observation)}, unit, range and source on a real turbine",
    }
    wrap = TextWrapper(_WIDTH, subsequent_indent=" " * _INDENT, break_on_hyphens=False)
    lines = [wrap.fill(f"{name:{_INDENT}}{text}") for name, text in rows.items() if text]
    observed = [row[:-1] for row in observation_rows(env.layout.observation.channels)]
    return "\n".join([*lines, *aligned(observed, indent=2)])


_MEMORY, _ESTIMATE, _GAUGES = "memory of the controller", "estimate of the controller", "strain gauges"
_SOURCES = {
    "rotor_speed": "encoder of the shaft", "generator_speed": "encoder of the shaft", "azimuth": "encoder of the shaft",
    "generator_torque_demand": _MEMORY, "generator_": "converter", "rotor_wind": _ESTIMATE,
    "rotor_energy": "encoder of the shaft", "pitch_demand": _MEMORY, "pitch_offset": _MEMORY,
    "pitch": "encoders of the pitch drives", "wind_speed": "anemometer of the nacelle", "yaw_error": "wind vane",
    "root_out_of_plane": f"{_GAUGES} at the blade roots, pitch", "root_": f"{_GAUGES} at the blade roots",
    "tip_": "no standard instrument", "tower_base": f"{_GAUGES} at the tower base", "tower_top": "satellite receiver",
    "tower_": "accelerometers of the nacelle, integrated", "nacelle_acceleration": "accelerometers of the nacelle",
    "lidar": "lidar of the nacelle", "demanded_power": "grid operator", "power_headroom": _ESTIMATE,
    "power_error": "converter, grid operator", "power_in": "grid operator", "dial": "operator of the wind farm",
    "disturbance": _ESTIMATE, "response": _ESTIMATE, "linear_pitch": _ESTIMATE, "model_": _ESTIMATE,
}  # fmt: skip
"""Source on a real turbine by the beginning of a channel's name; the rest is memory of the controller."""


def source(name: str) -> str:
    """Instrument of a real turbine from which an observed channel comes, or who else knows it."""
    origin = next((text for head, text in _SOURCES.items() if name.startswith(head)), _MEMORY)
    turns = name.endswith(("_mean", "_tilt", "_yaw")) and origin.startswith(_GAUGES)
    return f"{origin}, azimuth" if turns and not name.endswith("_mean") else origin


def observation_rows(channels: Iterable[Channel]) -> list[tuple[str, str, str, str, str]]:
    """Name, unit, range, source on a real turbine and meaning of observed channels, numbered ones of a kind as one."""
    families: dict[tuple[str, str, str], list[tuple[str, str]]] = {}
    for channel in channels:
        stem, _, number = channel.name.rpartition("_")
        name, number = (stem, f"_{number}") if number.isdecimal() else (channel.name, "")
        span = f"{channel.low:.4g} … {channel.high:.4g}"
        families.setdefault((name, channel.unit, span), []).append((number, channel.description))
    rows = []
    for (name, unit, span), members in families.items():
        (first, text), (last, _) = members[0], members[-1]
        rows.append((name + first + (f" … {last[1:]}" if len(members) > 1 else ""), unit, span, source(name), text))
    return rows


def reward_rows(env: WindTurbineEnv) -> list[tuple[str, str, str]]:
    """Name, weight and meaning of the terms of the reward."""
    rows = []
    for term in env.reward_terms:
        text = " ".join((inspect.getdoc(type(term)) or "").split("\n\n")[0].split()).replace("``", "")
        rows.append((term.name, f"{term.weight:g}", text))
    return rows


def controller_rows(env: WindTurbineEnv) -> list[tuple[str, str]]:
    """Name and meaning of the parts of a base controller that has a name."""
    base = env.options.controller.base
    names = [part.partition(":")[0] for part in base.split("+")] if isinstance(base, str) else []
    return [(name, controller_summary(name)) for name in names]


def aligned(rows: Iterable[Sequence[str]], indent: int = 0) -> list[str]:
    """Lines of a table, each column as wide as its widest cell."""
    cells = [tuple(row) for row in rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return [
        " " * indent + "  ".join(f"{text:{width}}" for text, width in zip(row, widths, strict=True)).rstrip()
        for row in cells
    ]
