"""Export of a controller or a trained agent: one C99 file, a library with the Bladed interface, a parameter file."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.base.files import write_text_whole
from wt_gym.bridges.compiler import compile_library, library_name
from wt_gym.control import Lidar
from wt_gym.control.bladed.records import LIDAR_SENSOR, LIDAR_SPEEDS, MOST_LIDAR_POINTS
from wt_gym.control.controllers import LidarFeedforward, make_controller, parse_name
from wt_gym.control.controllers.lidar_feedforward import SPACING
from wt_gym.control.design import reference_flap_moment
from wt_gym.control.rotor import RotorTable
from wt_gym.deployment.export.parts import (
    FASTEST_LIDAR_WIND,
    KINDS,
    LONGEST_LIDAR_DELAY,
    PARAMETERS,
    PLATFORM,
    SUPPORTED,
    LinearPitch,
    Parts,
    Seen,
    controller_parts,
)
from wt_gym.envs.dial import DIAL_NAMES, constant_factors
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.turbines import Turbine, load_turbine

if TYPE_CHECKING:
    from wt_gym.deployment.export.policy import Network

_MARK = "/* DATA */"
_MAKER = "wt_gym "
"""First bytes of every checkpoint, whichever controller it belongs to."""
_BESIDE = 0.2
"""Of a range, from the only beam of a lidar, where a point still belongs to it."""
_USERS = {
    "BASE": "controller", "IPC": "individual pitch", "DAMPER": "dampers", "YAW": "yaw", "AGENT": "agent",
    "LINEAR": "linear optimal pitch", "LIDAR": "lidar preview", "GUARD": "fault supervisor",
    "SUPERVISOR": "supervisory control", "FLOATING": "floating feedback",
}  # fmt: skip
"""Who needs readings, in the C source and in words."""
_ADDITIONS = ("NONE_ADDED", "INDIVIDUAL_PITCH", "FORE_AFT_DAMPER", "SIDE_SIDE_DAMPER", "YAW", "LINEAR_PITCH_ADDED",
              "FLOATING_FEEDBACK")  # fmt: skip
_DERATED = ("NOT_DERATED", "BY_SPEED", "BY_TORQUE", "BY_PITCH", "BY_ROTOR_ENERGY")
_FORMS = ("NO_PITCH", "COLLECTIVE", "INDIVIDUAL", "FIXED_FRAME", "CYCLIC")
_ACTIVATIONS = ("NO_ACTIVATION", "TANH", "RELU", "ELU")
_KINDS = (
    "pitch", "out_of_plane", "in_plane", "generator_speed", "rotor_speed", "power", "generator_torque", "yaw_error",
    "wind", "fore_aft", "side_side", "azimuth", "nacelle_yaw", "demanded_power", "platform", "lidar",
)  # fmt: skip
"""Kinds of readings; the first of each is called READ_… in the C source."""

_SEVERAL = re.compile(
    r"(.*_)?(gain_pitch|proportional_gains|integral_gains)|(schedule|power)_(wind|shares|pitch)|dial|offset_pitch_limit"
    r"|.+_fade_(pitch|speed|fine_speed)|ipc_(integral_gain|proportional_gain|level|leak|limit|rate_limit)"
)
"""Parameters with several values."""
_LENGTHS = {"N_START_GAINS": "supervisor_gain_pitch", "N_GAINS": "gain_pitch", "N_SHARES": "power_shares",
            "N_SCHEDULE": "schedule_wind"}  # fmt: skip


def readings(parts: Parts) -> list[tuple[str, int, str, float, float, set[str]]]:
    """Readings with kind, record, name, plausible range, and who needs them."""
    turbine = parts.turbine
    drive, n = turbine.drivetrain, turbine.n_blades
    speed, moment = drive.rated_rotor_speed, 40.0 * reference_flap_moment(turbine)
    rows = [("pitch", record, f"pitch of blade {b + 1}", 3.2) for b, record in enumerate((4, 33, 34)[:n])]
    rows += [("out_of_plane", 30 + b, f"out-of-plane moment of blade {b + 1}", moment) for b in range(n)]
    rows += [("in_plane", 69 + b, f"in-plane moment of blade {b + 1}", moment) for b in range(n)]
    rows += [
        ("generator_speed", 20, "generator speed", 3.0 * speed * drive.gear_ratio),
        ("rotor_speed", 21, "rotor speed", 3.0 * speed),
        ("power", 15, "electrical power", 5.0 * drive.rated_power),
        ("generator_torque", 23, "generator torque", 5.0 * drive.max_generator_torque),
        ("yaw_error", 24, "yaw error", 6.5),
        ("wind", 27, "wind speed at the hub", 150.0),
        ("fore_aft", 53, "fore-aft acceleration", 50.0),
        ("side_side", 54, "side-side acceleration", 50.0),
        ("azimuth", 60, "azimuth", 1e4),
        ("nacelle_yaw", 37, "nacelle yaw" + (", less record 1006" if turbine.floater is not None else ""), 1e4),
        ("demanded_power", 13, "demanded power", 5.0 * drive.rated_power),
    ]
    if turbine.floater is not None:
        rows += [
            ("platform", record, name.replace("_", " ") + " of the platform", 100.0)
            for name, record in PLATFORM.items()
        ]
    if parts.lidar is not None:  # behind all others, which are one record each
        rows.append(("lidar", LIDAR_SPEEDS, "lidar", FASTEST_LIDAR_WIND))
    needed = {kind: {user for user in _USERS if kind in parts.reads.get(user, set())} for kind in _KINDS}
    return [(kind, record, name, -most, most, needed[kind]) for kind, record, name, most in rows]


def _number(value: float, single: bool = False) -> str:
    """Literal with every digit."""
    text = repr(float(np.float32(value))) if single else repr(float(value))
    return text if any(c in text for c in ".e") else f"{text}.0"


def _bound(value: float) -> str:
    return ("HUGE_VAL" if value > 0 else "-HUGE_VAL") if math.isinf(value) else _number(value)


def _array(kind: str, name: str, values: Any) -> str:
    single = kind == "float"
    numbers = [_number(x, single) + ("f" if single else "") for x in np.asarray(values).ravel().tolist()]
    lines = [", ".join(numbers[k : k + 8]) for k in range(0, len(numbers), 8)]
    return f"static const {kind} {name}[{len(numbers)}] = {{\n    " + ",\n    ".join(lines) + "\n};"


def _enum(names: Iterable[str]) -> str:
    return f"enum {{ {', '.join(names)} }};"


def _parameters(parts: Parts) -> list[str]:
    """Structure, values and names of the parameters."""
    values = {entry.name: parts.values.get(entry.name, 1.0) for entry in PARAMETERS}
    counts = {name: len(value) if isinstance(value, list) else 0 for name, value in values.items()}
    fields, given, entries = [], [], []
    for entry in PARAMETERS:
        value, count = values[entry.name], counts[entry.name]
        if not count and _SEVERAL.fullmatch(entry.name):
            value, count = [1.0, 2.0], 2  # not used, and not read from a file
        shown = "{" + ", ".join(map(_number, value)) + "}" if isinstance(value, list) else _number(value)
        fields.append(f"    double {entry.name}{f'[{count}]' if count else ''}; /* {entry.unit}, {entry.meaning} */")
        given.append(f"    .{entry.name} = {shown},")
        if entry.group in parts.groups:
            at = f"offsetof(struct parameters, {entry.name})"
            entries.append(f'    {{"{entry.name}", {at}, {max(count, 1)}, {_bound(entry.low)}, {_bound(entry.high)}}},')
    return [
        "struct parameters {", *fields, "};",
        "static const struct parameters DEFAULTS = {", *given, "};",
        "struct entry { const char *name; size_t offset; int count; double low, high; };",
        "static const struct entry ENTRIES[] = {", *entries, "};",
        "#define N_ENTRIES (sizeof ENTRIES / sizeof ENTRIES[0])",
    ]  # fmt: skip


def _table(name: str, table: RotorTable) -> list[str]:
    ratio, best = table.optimum
    low = name.lower()
    return [
        _array("double", f"{low}_ratio", table.tip_speed_ratio),
        _array("double", f"{low}_pitch", table.pitch),
        _array("double", f"{low}_power", table.power),
        f"static const struct rotor_table {name} = {{{low}_ratio, {low}_pitch, {low}_power, {table.power.shape[0]}, "
        f"{table.power.shape[1]}, {_number(table.radius)}, {_number(table.air_density)}, {_number(ratio)}, "
        f"{_number(best)}}};",
    ]


def _linear(linear: LinearPitch) -> list[str]:
    """Arrays of a design of linear optimal pitch."""
    design = linear.design
    return [
        f"static const double LINEAR_INTERVAL = {_number(design.interval)}, LINEAR_SIDE = {_number(linear.sign)};",
        "#if WITH_AGENT",
        f"static const int SEEN_BINS[] = {{0{''.join(f', {last}' for _, last in linear.bins)}}};",
        _array("double", "LINEAR_CORNER", linear.corners),
        "#endif",
        _array("double", "LINEAR_PITCH", design.pitch),
        _array("double", "LINEAR_SCALE", design.scale),
        _array("double", "LINEAR_WASHOUT", design.washout),
        _array("float", "LINEAR_RESPONSES", design.responses),
        _array("float", "LINEAR_GAINS", design.gains),
    ]


def _lidar(lidar: Lidar, turbine: Turbine, feedforward: LidarFeedforward | None) -> list[str]:
    """Gates of a lidar, its beams where they are apart, and the steady pitch of a feed-forward."""
    lines = [
        _enum([f"LIDAR_SENSOR = {LIDAR_SENSOR}", f"LIDAR_SPEEDS = {LIDAR_SPEEDS}",
               f"MOST_LIDAR_POINTS = {MOST_LIDAR_POINTS}", f"N_GATES = {len(lidar.ranges)}"]),
        _array("double", "LIDAR_RANGES", lidar.ranges),
    ]  # fmt: skip
    if lidar.apart:
        left, up = lidar.sides(turbine.rotation)
        # half of the way between neighbors; a beam alone has none
        beside = math.tan(lidar.half_angle) * math.sin(math.pi / lidar.n_beams) if lidar.n_beams > 1 else _BESIDE
        lines += [
            _enum([f"N_BEAMS = {lidar.n_beams}"]),
            _array("double", "BEAM_LEFT", left),
            _array("double", "BEAM_UP", up),
            f"static const double BEAM_TOLERANCE = {_number(beside)}, HUB_HEIGHT = {_number(turbine.hub_height)};",
        ]
    if feedforward is not None:
        # way of the air from the farthest gate to where the filter takes it, over the way between two readings
        way = max(lidar.ranges) + FASTEST_LIDAR_WIND * LONGEST_LIDAR_DELAY
        spacing = SPACING / feedforward.wavenumber
        lines += [
            f"static const double LIDAR_SPACING = {_number(spacing)};",
            _enum([f"N_SEEN_AHEAD = {math.ceil(way / spacing) + 3}", f"N_WINDS = {feedforward.winds.size}"]),
            _array("double", "STEADY_WIND", feedforward.winds),
            _array("double", "STEADY_PITCH", feedforward.steady_pitch),
        ]
    return lines


def _agent(network: Network, seen: list[Seen]) -> list[str]:
    """Channels and network."""
    lines = [
        _enum(f"SEE_{kind}" for kind in KINDS),
        "struct channel { int kind, index, washed; double offset, scale, low, high; };",
        "static const struct channel CHANNELS[N_CHANNELS] = {",
    ]
    for one in seen:
        c = one.channel
        numbers = ", ".join(_number(x) for x in (c.offset, c.scale, c.low, c.high))
        lines.append(f"    {{SEE_{one.kind}, {one.index}, {int(one.washed)}, {numbers}}}, /* {c.name}, {c.unit} */")
    lines.append("};")
    n = network.normalization
    count = len(network.channels)
    lines += [
        _array("double", "NORMAL_MEAN", np.zeros(count) if n is None else n.mean),
        _array("double", "NORMAL_DEVIATION", np.ones(count) if n is None else n.deviation),
        f"static const double NORMAL_LIMIT = {_number(1.0 if n is None else n.limit)};",
        "struct layer { const float *weight, *bias; int n_in, n_out, activation; };",
    ]
    rows = []
    for k, layer in enumerate(network.layers):
        lines += [_array("float", f"WEIGHT_{k}", layer.weight), _array("float", f"BIAS_{k}", layer.bias)]
        n_out, n_in = layer.weight.shape
        rows.append(f"    {{WEIGHT_{k}, BIAS_{k}, {n_in}, {n_out}, {layer.activation.upper() or 'NO_ACTIVATION'}}},")
    return [*lines, "static const struct layer LAYERS[N_LAYERS] = {", *rows, "};"]


def c_source(title: str, parts: Parts, network: Network | None = None, seen: list[Seen] | None = None) -> str:
    """Text of the C99 file; the network and the channels that it sees are those of an agent."""
    values = parts.values
    constants = {
        "N_BLADES": parts.turbine.n_blades,
        "WITH_AGENT": int(network is not None),
        "SENSES_WIND": 0,
        "WITH_DIAL": 0,
        "N_DIAL": len(DIAL_NAMES),
        "WITH_LINEAR": int(parts.linear is not None),
        "WITH_LIDAR": int(parts.lidar is not None),
        "WITH_BEAMS": int(parts.lidar is not None and parts.lidar.apart),
        "WITH_FEEDFORWARD": int(parts.feedforward is not None),
        "WITH_GUARD": int("guard" in parts.groups),
        "WITH_SUPERVISOR": int("supervisor" in parts.groups),
        "HAS_SET_POINT": 0,
        **{name: len(values.get(of, [0.0, 0.0])) for name, of in _LENGTHS.items()},  # type: ignore[arg-type]
        "N_ADDITIONS": len(parts.additions),
    } | parts.constants
    constants["WITH_ESTIMATOR"] = int(bool(parts.tables))
    rows = readings(parts)
    lines = [f"#define {name} {value}" for name, value in constants.items()]
    kinds = [row[0] for row in rows]
    short = {kind: kind.replace("generator_torque", "torque").upper() for kind in _KINDS if kind in kinds}
    firsts = {f"READ_{name}": kinds.index(kind) for kind, name in short.items()}
    lines += [
        _enum(f"{name} = {k}" for name, k in firsts.items()),
        _enum(f"FOR_{user} = {1 << k}" for k, user in enumerate(_USERS)),
        f"#define N_READINGS {len(rows)}",
        "struct reading { int record; const char *name; double low, high; unsigned users; };",
        "static const struct reading READINGS[N_READINGS] = {",
    ]
    for _, record, name, low, high, users in rows:
        of = " | ".join(f"FOR_{user}" for user in _USERS if user in users) or "0"
        lines.append(f'    {{{record}, "{name}", {_number(low)}, {_number(high)}, {of}}},')
    lines += ["};", _enum(_ADDITIONS), _enum(_DERATED)]
    lines.append(f"static const int ADDITIONS[] = {{{', '.join(parts.additions) or 'NONE_ADDED'}}};")
    lines += _parameters(parts)
    if parts.tables:
        lines.append(
            "struct rotor_table { const double *ratio, *pitch, *power; int n_ratio, n_pitch; double radius, "
            "air_density, best_ratio, best_power; };"
        )
        for name, table in parts.tables.items():
            lines += _table(name, table)
    if parts.linear is not None:
        lines += _linear(parts.linear)
    if parts.lidar is not None:
        lines += _lidar(parts.lidar, parts.turbine, parts.feedforward)
    if network is not None and seen is not None:
        lines += [_enum(_FORMS), _enum(_ACTIVATIONS), *_agent(network, seen)]
    runtime = Path(__file__).with_name("runtime.c").read_text(encoding="utf-8")
    data = "\n".join(lines)
    mark = hashlib.sha256((data + runtime).encode()).hexdigest()[:16]
    data += f'\n#define FINGERPRINT "{_MAKER}{mark}"\n#define MAKER "{_MAKER}"\n'
    head = f"/* {title}\n *\n * Made by wt_gym: one C99 file, a shared library with the Bladed interface. */\n"
    return head + runtime.replace(_MARK, data)


def parameter_file(title: str, groups: set[str], values: dict[str, float | list[float]]) -> str:
    """Text of a parameter file: the values by name of the groups that a controller has."""
    lines = [f"# {title}", "# name = value(s)  # unit, meaning; what is left out is as it was exported", ""]
    for entry in PARAMETERS:
        if entry.group in groups:
            value = values[entry.name]
            numbers = " ".join(f"{x!r}" for x in (value if isinstance(value, list) else [value]))
            lines.append(f"{entry.name} = {numbers}  # {entry.unit}, {entry.meaning}")
    return "\n".join(lines) + "\n"


def export_discon(  # noqa: PLR0913
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
    ValueError, wt_gym.bridges.compiler.CompilerError
        For what cannot be exported, with what can; if there is no compiler.
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
        parts.values["dial"] = list(constant_factors(dial))
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
        "parked": wind is not None and parts.supervisor is not None and not parts.supervisor.runs_in(wind),
    }


def _agent_parts(name: Any, hold_missing: bool) -> tuple[Parts, Network, list[Seen], str]:
    """Parts of an agent's base controller with the agent, its network, its channels, and the name of the base."""
    from wt_gym.deployment.export.parts import add_agent, seen_channels
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
    for kind, record, name, low, high, users in readings(parts):
        needed = sorted(_USERS[user] for user in users) + ["in place of record 20"] * (kind == "rotor_speed")
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
        "yaw of the nacelle (record 37, afloat less 1006); points farther than a fifth of the range from every gate "
        "are not read. A gate reads the mean over its points, times `lidar_speed_factor`: 1 over the cosine of the "
        "half angle where the records hold speeds along the beams.",
        *beams,
        "", f"While a {what} has no point, or a point no speed, the pitch does not follow the wind ahead{rests}; "
        "the rest of the controller continues.",
        "", "In wt_gym: `BladedController(turbine, library, lidar=Lidar(..., apart=True))`."
        if lidar.apart else f"In wt_gym: `bladed:{library}:lidar=True` for the lidar by the rotor's size, else "
        "`BladedController(turbine, library, lidar=Lidar(...))`.",
    ]  # fmt: skip
