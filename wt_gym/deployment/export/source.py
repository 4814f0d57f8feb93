"""The C source of an exported controller: its numbers, and the laws of ``runtime.c``."""

from __future__ import annotations

import hashlib
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.control.bladed.records import LIDAR_SENSOR, LIDAR_SPEEDS, MOST_LIDAR_POINTS
from wt_gym.control.controllers.lidar_feedforward import SPACING
from wt_gym.control.design import reference_flap_moment
from wt_gym.deployment.export.agent_parts import KINDS
from wt_gym.deployment.export.controller_parts import FASTEST_LIDAR_WIND, LONGEST_LIDAR_DELAY
from wt_gym.deployment.export.parameters import PARAMETERS
from wt_gym.envs.options.dial import DIAL_NAMES

if TYPE_CHECKING:
    from collections.abc import Iterable

    from wt_gym.control import Lidar
    from wt_gym.control.controllers import LidarFeedforward
    from wt_gym.control.rotor import RotorTable
    from wt_gym.deployment.export.agent_parts import Seen
    from wt_gym.deployment.export.controller_parts import LinearPitch, Parts
    from wt_gym.deployment.export.network import Network
    from wt_gym.turbines import Turbine

__all__ = ["c_source", "readings"]

_MARK = "/* DATA */"
_MAKER = "wt_gym "
"""First bytes of every checkpoint, whichever controller it belongs to."""
_BESIDE = 0.2
"""Of a range, from the only beam of a lidar, where a point still belongs to it."""
_USERS = ("BASE", "IPC", "DAMPER", "YAW", "AGENT", "LINEAR", "LIDAR", "GUARD", "SUPERVISOR")
_ADDITIONS = ("NONE_ADDED", "INDIVIDUAL_PITCH", "FORE_AFT_DAMPER", "SIDE_SIDE_DAMPER", "YAW", "LINEAR_PITCH_ADDED")
_DERATED = ("NOT_DERATED", "BY_SPEED", "BY_TORQUE", "BY_PITCH", "BY_ROTOR_ENERGY")
_FORMS = ("NO_PITCH", "COLLECTIVE", "INDIVIDUAL", "FIXED_FRAME", "CYCLIC")
_ACTIVATIONS = ("NO_ACTIVATION", "TANH", "RELU", "ELU")
_FIRST = {
    "pitch": "READ_PITCH", "out_of_plane": "READ_OUT_OF_PLANE", "in_plane": "READ_IN_PLANE",
    "generator_speed": "READ_GENERATOR_SPEED", "rotor_speed": "READ_ROTOR_SPEED", "power": "READ_POWER",
    "generator_torque": "READ_TORQUE", "yaw_error": "READ_YAW_ERROR", "wind": "READ_WIND",
    "fore_aft": "READ_FORE_AFT", "side_side": "READ_SIDE_SIDE", "azimuth": "READ_AZIMUTH",
    "nacelle_yaw": "READ_NACELLE_YAW", "demanded_power": "READ_DEMANDED_POWER", "lidar": "READ_LIDAR",
}  # fmt: skip
"""Names of the first reading of each kind in the C source."""

_LISTS = {
    "supervisor_gain_pitch", "supervisor_proportional_gains", "supervisor_integral_gains",
    "power_shares", "power_pitch", "dial",
    "gain_pitch", "proportional_gains", "integral_gains", "schedule_wind", "schedule_pitch", "ipc_integral_gain",
    "ipc_proportional_gain", "ipc_level", "ipc_leak", "ipc_limit", "ipc_rate_limit", "offset_pitch_limit",
    "ipc_fade_pitch", "ipc_fade_speed", "fore_aft_fade_pitch", "fore_aft_fade_speed", "offset_fade_pitch",
    "offset_fade_speed", "linear_fade_pitch", "linear_fade_speed",
    "lidar_fade_pitch", "lidar_fade_speed", "lidar_fade_fine_speed",
    "ipc_fade_fine_speed", "fore_aft_fade_fine_speed", "offset_fade_fine_speed", "linear_fade_fine_speed",
}  # fmt: skip
"""Parameters with several values."""


def readings(parts: Parts) -> list[tuple[str, int, str, float, float, set[str]]]:
    """Readings with kind, record, name, plausible range, and who needs them.

    Parameters
    ----------
    parts : Parts
    """
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
        ("nacelle_yaw", 37, "nacelle yaw", 1e4),
        ("demanded_power", 13, "demanded power", 5.0 * drive.rated_power),
    ]
    if parts.lidar is not None:  # behind all others, which are one record each
        rows.append(("lidar", LIDAR_SPEEDS, "lidar", FASTEST_LIDAR_WIND))
    needed = {kind: {user for user in _USERS if kind in parts.reads.get(user, set())} for kind in _FIRST}
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
        if entry.name in _LISTS and not count:
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
            _enum([f"N_SEEN_AHEAD = {math.ceil(way / spacing) + 3}", f"N_WINDS = {feedforward._winds.size}"]),
            _array("double", "STEADY_WIND", feedforward._winds),
            _array("double", "STEADY_PITCH", feedforward._steady),
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
    """Text of the C99 file.

    Parameters
    ----------
    title : str
    parts : Parts
    network : Network, optional
        Of an agent.
    seen : list of Seen, optional
        Channels of a reading of the agent.
    """
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
        "N_START_GAINS": len(values.get("supervisor_gain_pitch", [0.0, 0.0])),  # type: ignore[arg-type]
        "N_GAINS": len(values.get("gain_pitch", [0.0, 0.0])),  # type: ignore[arg-type]
        "N_SHARES": len(values.get("power_shares", [0.0, 0.0])),  # type: ignore[arg-type]
        "N_SCHEDULE": len(values.get("schedule_wind", [0.0, 0.0])),  # type: ignore[arg-type]
        "N_ADDITIONS": len(parts.additions),
    } | parts.constants
    constants["WITH_ESTIMATOR"] = int(bool(parts.tables))
    rows = readings(parts)
    lines = [f"#define {name} {value}" for name, value in constants.items()]
    kinds = [row[0] for row in rows]
    firsts = {first: kinds.index(kind) for kind, first in _FIRST.items() if kind in kinds}
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
