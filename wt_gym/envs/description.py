"""Ten lines on an environment: task, turbine, wind, controller, names of actions and observations."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from wt_gym.envs.simulators import OWN
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.tasks import task_of

if TYPE_CHECKING:
    from collections.abc import Iterable

    from gymnasium.envs.registration import EnvSpec


__all__ = ["describe"]

_WIDTH, _INDENT = 120, 14


def describe(env: Any, spec: EnvSpec | None, count: int = 1) -> str:
    """Text about an environment, of about ten lines; nothing is simulated for it.

    Parameters
    ----------
    env : WindTurbineEnv
    spec : EnvSpec or None
        Definition that it or its vector environment was made of.
    count : int
        Number of turbines.
    """
    rows = [
        ("task", ("" if count == 1 else f"{count} turbines, ") + _task(env, spec)),
        ("turbine", _turbine(env)),
        ("wind", _wind(env)),
        ("controller", _controller(env)),
        ("conditions", _conditions(env)),
        ("actions", _actions(env)),
        ("observations", f"{len(env.layout.observation)}: {_short(env.layout.observation.names)}"),
        ("reward", ", ".join(term.name for term in env.reward_terms)),
        ("episode", _episode(env)),
    ]
    return "\n".join(_row(name, text) for name, text in rows if text)


def _row(name: str, text: str) -> str:
    """Name and text, which continues below its own beginning."""
    first, rest = f"{name:{_INDENT}}", " " * _INDENT
    return textwrap.fill(text, _WIDTH, initial_indent=first, subsequent_indent=rest, break_on_hyphens=False)


def _task(env: Any, spec: EnvSpec | None) -> str:
    """Id with the goal of its task; the class where there is no id."""
    if spec is None:
        return type(env).__name__
    task = task_of(spec.id)
    return spec.id if task is None else f"{spec.id}: {task.goal}"


def _turbine(env: Any) -> str:
    turbine = env.turbine
    return (
        f"{turbine.title}, {turbine.drivetrain.rated_power / 1e6:.4g} MW, rotor {turbine.rotor_diameter:.4g} m, hub "
        f"{turbine.hub_height:.4g} m"
    )


def _wind(env: Any) -> str:
    low, high = env.wind.speeds
    speeds = f"{low:.4g} m/s" if low == high else f"{low:.4g} to {high:.4g} m/s"
    return f"{env.wind.label}, {speeds} at hub height"


def _controller(env: Any) -> str:
    """Base controller, where one runs: its name, or the class of an object."""
    if env.controller is None:
        return "none: the actions are the demands"
    base = env.options.controller.base
    name = base if isinstance(base, str) else type(env.controller).__name__
    return f"{name}, {'changed by the actions' if env.layout.action.mode == 'residual' else 'beside the actions'}"


def _conditions(env: Any) -> str:
    """Faults, variation, power reference and dial, where there are any."""
    options = env.options
    parts = [
        "" if options.faults.kinds is None else f"faults: {', '.join(options.faults.kinds)}",
        f"variation: {', '.join(options.variation.varies)}" if options.variation.varies else "",
        "" if options.grid.reference is None else "a power reference",
        "" if options.dial.weights is None else "a dial on the weights of the reward",
    ]
    return "; ".join(part for part in parts if part)


def _actions(env: Any) -> str:
    action = env.layout.action
    units = set(action.units)
    names = [
        name if len(units) == 1 else f"{name} [{unit}]" for name, unit in zip(action.names, action.units, strict=True)
    ]
    unit = f" [{units.pop()}]" if len(units) == 1 else ""
    return f"{action.size}, {action.mode}, every {env.control_dt:g} s: {', '.join(names)}{unit}"


def _short(names: Iterable[str]) -> str:
    """Names in a line, neighbors that differ by their last word alone as one: ``pitch_1/2/3``."""
    parts: list[str] = []
    before = None
    for name in names:
        stem, _, last = name.rpartition("_")
        if stem and stem == before:
            parts[-1] += f"/{last}"
        else:
            parts.append(name)
        before = stem
    return ", ".join(parts)


def _episode(env: Any) -> str:
    longest = env.length.longest(env.spec, env.outer_steps)
    length = "without a limit of time" if longest is None else f"{longest:g} s"
    choice = env.options.simulator
    name = choice if isinstance(choice, str) else choice["name"] if isinstance(choice, Mapping) else "your own"
    simulator = "" if name == OWN else f", simulator {name}"
    return f"{length}, start {env.options.start}, fidelity {fidelity_of(env.fidelity).name}{simulator}"
