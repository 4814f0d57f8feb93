"""Export of a controller or a trained agent as one C99 file and a library with the Bladed interface."""

from __future__ import annotations

import math
import re
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wt_gym.base.files import write_text_whole
from wt_gym.bridges.compiler import compile_library, library_name
from wt_gym.control.controllers import make_controller, parse_name
from wt_gym.deployment.export.controller_parts import SUPPORTED, Parts, controller_parts
from wt_gym.deployment.export.source import c_source, parameter_file, readings
from wt_gym.envs.options.dial import checked_dial
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.turbines import Turbine, load_turbine

if TYPE_CHECKING:
    from collections.abc import Mapping

    from wt_gym.deployment.export.agent_parts import Seen
    from wt_gym.deployment.export.policy import Network

__all__ = ["export_discon"]


def export_discon(
    choice: str,
    folder: str | Path,
    *,
    turbine: str | Turbine | None = None,
    interval: float | None = None,
    target: str | None = None,
    hold_missing: bool = False,
    drive: bool = False,
    dial: Mapping[str, float] | None = None,
    wind: float | None = None,
) -> dict[str, Any]:
    """Write a controller or a trained agent on its controller as C source, library and parameter file.

    Parameters
    ----------
    choice : str
        Name of a controller or a trained agent.
    turbine : str or Turbine, optional
        Of a controller, by default the NREL 5-MW; that of an agent is the one of its training.
    interval : float, optional
        Step of a controller [s], by default that of the simulator; that of an agent is the one of its training.
    target : str, optional
        Machine, of `wt_gym.bridges.compiler.TARGETS`; by default this one.
    hold_missing : bool
        Whether channels that the interface does not have are held at the middle of their scale.
    drive : bool
        Whether the library has pitch drives and limits the rates, for codes that have none.
    dial : mapping, optional
        Constant ``dial_weights`` that an agent with a dial keeps to; by default those of its training where they are
        constant, else equal ones.
    wind : float, optional
        Of a start [m/s].

    Returns
    -------
    dict
        ``files``, ``held``: names of the channels that are held, ``lidar``: arguments of the `wt_gym.control.Lidar`
        that is read, or None, and ``parked``: whether supervisory control lets the turbine stand in the wind.

    Raises
    ------
    ValueError
        For what cannot be exported, with what can.
    wt_gym.bridges.compiler.CompilerError
        If there is no compiler.
    """
    name = parse_name(choice)
    network: Network | None = None
    seen: list[Seen] = []
    if name.kind == "trained":
        if turbine is not None or interval is not None:
            raise ValueError("turbine and interval are those of the agent's training; they must be left out")
        stem, (parts, network, seen, base) = Path(name.target).stem, _agent_parts(name, hold_missing)
        title = f"The agent {stem} on the controller {base}, {parts.turbine.name}"
    elif name.kind == "controller":
        made = turbine if isinstance(turbine, Turbine) else load_turbine(turbine or "nrel_5mw")
        step = fidelity_of("training").step_for(made.drivetrain.rated_rotor_speed) if interval is None else interval
        if not 0.0 < step <= 10.0:
            raise ValueError(f"interval must be above 0 and at most 10 s, got {step!r}")
        stem, parts = name.target, controller_parts(make_controller(choice, made), made, step)
        title = f"The controller {name.text}, {made.name}"
    else:
        raise ValueError(
            f"what is exported must be a trained agent or a controller of {', '.join(SUPPORTED)}, got {choice!r}"
        )
    parts.values["drive"] = float(drive)
    if dial is not None and "dial" in parts.values:
        parts.values["dial"] = list(checked_dial(dial).values())
    stem = re.sub(r"\W+", "_", stem)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    source, library, parameters, page = (
        folder / file for file in (f"{stem}.c", library_name(stem, target), f"{stem}.in", "README.md")
    )
    write_text_whole(source, c_source(title, parts, network, seen))
    write_text_whole(parameters, parameter_file(title, parts.groups, parts.values))
    compile_library(source, library, target)
    held = [one.channel.name for one in seen if one.kind == "HELD"]
    write_text_whole(page, _page(title, parts, [source, library, parameters], held))
    lidar = None if parts.lidar is None else asdict(parts.lidar)
    return {
        "files": [str(file) for file in (source, library, parameters, page)],
        "held": held,
        "lidar": lidar,
        "parked": wind is not None and parts.parks_in(wind),
    }


def _agent_parts(name: Any, hold_missing: bool) -> tuple[Parts, Network, list[Seen], str]:
    """Parts of an agent's base controller with the agent, its network, its channels, and the name of the base."""
    from wt_gym.deployment.export.agent_parts import add_agent, seen_channels
    from wt_gym.deployment.export.policy import network_of, training_environment
    from wt_gym.experiment.agents import load_model
    from wt_gym.experiment.trained_agent import model_card

    agent = load_model(name)
    env = training_environment(agent, model_card(name.target, name.parameters.get("env")).get("env_kwargs", {}))
    try:
        if env.layout.action.mode != "residual":
            raise ValueError(
                f"an agent must have residual actions to be exported as a controller, got {env.layout.action.mode!r}"
            )
        assert env.controller is not None  # residual actions have one
        parts = controller_parts(env.controller, env.turbine, env.operation.step)
        seen, network = seen_channels(env.layout, hold_missing), network_of(agent, env.layout)
        add_agent(parts, env, network, seen)
    finally:
        env.close()
    base = env.options.controller.base
    return parts, network, seen, base if isinstance(base, str) else type(base).__name__


def _page(title: str, parts: Parts, files: list[Path], held: list[str]) -> str:
    """What stands beside the library."""
    source, library, parameters = (file.name for file in files)
    step = parts.values["controller_step"]
    individual = parts.constants["INDIVIDUAL_BLADES"]
    yaws = "yaw" in parts.groups or bool(parts.constants.get("HAS_YAW"))
    lines = [
        f"# {title}", "",
        f"- `{library}`: library with the Bladed interface, function `DISCON`; one instance a loaded file.",
        f"- `{parameters}`: its parameters, read at the first call.",
        f"- `{source}`: its source, C99: `cc -std=c99 -O2 -shared -fPIC -o {library} {source} -lm`.",
        "", f"It acts every {step:g} s, whatever the step of the caller.", "",
        f"In OpenFAST's ServoDyn: {'`PCMode`, `VSContrl` and `YCMode`' if yaws else '`PCMode` and `VSContrl`'} 5, "
        f"`DLL_FileName` \"{library}\", `DLL_InFile` \"{parameters}\"" + (", `Ptch_Cntrl` 1." if individual else ".")
        + " ServoDyn has no pitch drives: set `drive = 1` in the parameter file."
        + (" The yaw needs `YawDOF` True in ElastoDyn." if yaws else ""),
        "", "## Readings", "", "| record | reading | plausible range | needed by |", "|---|---|---|---|",
    ]  # fmt: skip
    words = {
        "BASE": "controller",
        "IPC": "individual pitch",
        "DAMPER": "dampers",
        "YAW": "yaw",
        "AGENT": "agent",
        "LINEAR": "linear optimal pitch",
        "LIDAR": "lidar preview",
        "GUARD": "fault supervisor",
        "SUPERVISOR": "supervisory control",
    }
    for kind, record, name, low, high, users in readings(parts):
        needed = sorted(words[user] for user in users) + ["in place of record 20"] * (kind == "rotor_speed")
        if needed:
            lines.append(f"| {record} | {name} | {low:.4g} to {high:.4g} | {', '.join(needed)} |")
    lines += [
        "", "A reading that is not a number or out of its range keeps its last value, and what acts on it rests: the "
        "agent's offsets, individual and linear optimal pitch return to zero at their greatest rate. Without the "
        "generator speed the rotor speed stands in. The library says so once.",
        "", "Demands: records 42 to 44 (pitch), 45 (their mean), 47 (torque), 48 (yaw rate). Status -8 writes and -9 "
        "reads a checkpoint: the file that is named in place of the parameter file, as by OpenFAST, else "
        "`OUTNAME.MILLISECONDS.checkpoint`.",
    ]  # fmt: skip
    if "dial" in parts.groups:
        lines += ["", f"The agent keeps to the factors on fatigue, power and travel of `dial` in `{parameters}`; their "
                  "ratios count."]  # fmt: skip
    if parts.lidar is not None:
        lines += _lidar_page(parts, library)
    if held:
        lines += ["", "## Held channels", "", f"The interface does not have {', '.join(held)}: the agent sees the "
                  "middle of their scale. It was not trained so, and does less than in its training."]  # fmt: skip
    return "\n".join(lines) + "\n"


def _lidar_page(parts: Parts, library: str) -> list[str]:
    """What the library reads of a lidar."""
    lidar = parts.lidar
    assert lidar is not None
    ranges = ", ".join(f"{value:.4g}" for value in lidar.ranges)
    what, rests, beams = "gate", "", []
    if lidar.apart:
        what, rests = "beam", ", the offsets of the agent return to zero"
        beams = [
            "", f"The agent reads the {lidar.n_beams} beam(s) of a gate apart: evenly spaced, the first one upward, "
            "the others in the sense of rotation. A point belongs to the nearest beam of its gate, unless it is "
            "farther from it than half of the way between two beams; a beam reads the mean over its points.",
        ]  # fmt: skip
    return [
        "", "## Lidar", "", f"Gates {ranges} m ahead of the tower axis, made for {lidar.n_beams} beam(s) on a cone of "
        f"{math.degrees(lidar.half_angle):.3g}° half angle about a level axis at hub height.",
        "", "| record | reading |", "|---|---|", "| 129 | length of the array, 2004 + 4 n at least |",
        "| 2002, 2003 | beams and gates; n = beams × gates points, at most 124 |",
        "| 2005 to 2004 + n | speeds along the axis [m/s], -60 to 60 |",
        "| 2005 + n to 2004 + 4 n | x of all points, then y, then z [m], from the foot of the tower |",
        "", "A point belongs to the gate whose range is nearest to its distance ahead of the tower axis along the "
        "heading of the nacelle (record 37); points farther than a fifth of the range from every gate are not read. "
        "A gate reads the mean over its points, times `lidar_speed_factor`: 1 over the cosine of the half angle where "
        "the records hold speeds along the beams.",
        *beams,
        "", f"While a {what} has no point, or a point no speed, the pitch does not follow the wind ahead{rests}; "
        "the rest of the controller continues.",
        "", "In wt_gym: `BladedController(turbine, library, lidar=Lidar(..., apart=True))`."
        if lidar.apart else f"In wt_gym: `bladed:{library}:lidar=True` for the lidar by the rotor's size, else "
        "`BladedController(turbine, library, lidar=Lidar(...))`.",
    ]  # fmt: skip
