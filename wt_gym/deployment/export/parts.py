"""Controllers and trained residual agents taken apart into what their C source needs: parameters, tables, readings."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from wt_gym.base.files import read_rows
from wt_gym.control import Lidar, NacelleAnemometer
from wt_gym.control.bladed.records import check_points
from wt_gym.control.controllers import (
    STATES,
    AboveRated,
    Controller,
    DisconController,
    FaultSupervisor,
    ForeAftDamper,
    IndividualPitch,
    LidarFeedforward,
    SideSideDamper,
    Supervisor,
    YawByDeadBand,
)
from wt_gym.control.controllers.controller import parts_of
from wt_gym.control.controllers.discon import BaselineParameters, PitchLaw
from wt_gym.control.controllers.floating_feedback import FloatingFeedback
from wt_gym.control.controllers.linear_optimal import (
    FLOATING_OUTPUTS,
    MOTION_CORNER,
    OUTPUTS,
    SCHEDULE_TIME,
    LinearDesign,
    LinearOptimalPitch,
    LoadObserver,
)
from wt_gym.control.controllers.power_tracking import WAYS, PowerTracking
from wt_gym.control.controllers.tsr_tracking import TsrTrackingController, WindEstimator
from wt_gym.control.design import rotor_inertia
from wt_gym.control.rotor import RotorTable
from wt_gym.envs.dial import DIAL_NAMES, LEAST_FACTOR, MOST_FACTOR
from wt_gym.envs.layout import EnvLayout
from wt_gym.envs.power import available_power
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.simulation.drivetrain.drives import pitch_delay
from wt_gym.turbines import Turbine

if TYPE_CHECKING:
    from wt_gym.deployment.export.policy import Network

SUPPORTED = ("discon", "retuned", "tsr_tracking", "derate_speed", "derate_torque", "derate_pitch", "derate_kinetic",
             "floating", "lidar", "ipc", "ipc_2p", "constrained_ipc", "fore_aft_damper",
             "side_side_damper", "tower_dampers", "tuned", "tuned_lidar", "yaw",
             "linear_pitch", "linear_optimal", "observer", "fault_supervisor", "supervisor")  # fmt: skip
"""Names of controllers that can be exported."""
ACCELERATION = frozenset({"fore_aft", "side_side", "nacelle_yaw"})
"""Readings behind either tower-top acceleration: records have both along axes that do not yaw."""
PLATFORM = {
    "surge": 1001, "sway": 1002, "roll": 1004, "pitch": 1005, "roll_rate": 1010, "pitch_rate": 1011,
    "surge_acceleration": 1013, "sway_acceleration": 1014,
}  # fmt: skip
"""Motion of a floating platform that a controller can read, and its records."""
LINEAR_READS = {"pitch", "out_of_plane", "in_plane", "azimuth", "rotor_speed"} | ACCELERATION
"""Readings of linear optimal pitch."""
MOST_SEEN_BINS = 100
"""More than the bins of delays of any design; what the number of a channel counts outputs by."""
LONGEST_LIDAR_DELAY = 10.0
"""Greatest delay of the feed-forward that the parameter file of a library may have [s]."""
FASTEST_LIDAR_WIND = 60.0
"""Greatest wind that the gates of a lidar are believed to see [m/s]."""


@dataclass(frozen=True)
class Entry:
    """One parameter."""

    name: str  #: of the field in the C structure and of the line in the file
    unit: str
    meaning: str
    group: str = ""  #: part of the controller that it belongs to; "" for what the file does not show
    low: float = -math.inf  #: least value that the library accepts from the file
    high: float = math.inf


_BOUNDS = {"pi": math.pi, "-pi": -math.pi, "longest_lidar_delay": LONGEST_LIDAR_DELAY,
           "least_factor": LEAST_FACTOR, "most_factor": MOST_FACTOR}  # fmt: skip
"""Limits that the table of parameters has by name."""


def _read_parameters(path: Path) -> tuple[Entry, ...]:
    """Read the table of parameters, where an empty limit is none."""

    def limit(text: str, otherwise: float) -> float:
        return float(_BOUNDS.get(text, text)) if text else otherwise

    return tuple(
        Entry(name, unit, meaning, group, limit(low, -math.inf), limit(high, math.inf))
        for name, unit, meaning, group, low, high in (row.values() for row in read_rows(path))
    )


# Which axes a code means by records 53 and 54: OpenFAST's ServoDyn hands over ElastoDyn's YawBrTAxp and YawBrTAyp,
# along axes of the tower top, which do not yaw with the nacelle (modules/servodyn/src/BladedInterface.f90). In DNV's
# documentation of Bladed's outputs fore-aft and side-side accelerations of the nacelle are "corrected by the yaw angle"
# (bladednextgen.dnv.com, page "Nacelle outputs"): along the nacelle.
PARAMETERS = _read_parameters(Path(__file__).with_name("parameters.csv"))
"""Every parameter; those of groups that a controller does not have are left out of its file."""


@dataclass(frozen=True)
class LinearPitch:
    """Linear optimal pitch as the C source has it."""

    design: LinearDesign
    sign: float  #: of accelerations to the side
    bins: tuple[tuple[int, int], ...]  #: of delays, over which an agent sees means of the disturbances
    corners: NDArray[np.float64]  #: of the integrators that make the motion of the tower top [rad/s], shape (2,)


@dataclass
class Parts:
    """What a controller, and an agent on it, put into the C source."""

    turbine: Turbine
    values: dict[str, float | list[float]] = field(default_factory=dict)  #: of `PARAMETERS`
    groups: set[str] = field(default_factory=lambda: {"all", "base"})  #: of parameters
    constants: dict[str, int] = field(default_factory=dict)  #: whole numbers of the preprocessor, by name
    additions: list[str] = field(default_factory=list)  #: names of the C source, in the order in which they act
    tables: dict[str, RotorTable] = field(default_factory=dict)  #: rotor tables by the name in the C source
    reads: dict[str, set[str]] = field(default_factory=dict)  #: readings by who needs them, of `discon._USERS`
    linear: LinearPitch | None = None
    lidar: Lidar | None = None  #: with its beams apart where an agent reads them
    feedforward: LidarFeedforward | None = None
    supervisor: Supervisor | None = None

    def take(self, group: str, source: Any, prefix: str = "") -> None:
        """Take the attributes of an object that are parameters of a group, under their names behind a prefix."""
        self.groups.add(group)
        names = [entry.name.removeprefix(prefix) for entry in PARAMETERS if entry.group == group]
        self.values |= {f"{prefix}{name}": getattr(source, name) for name in names if hasattr(source, name)}

    def take_gains(self, law: PitchLaw, group: str, flag: str, prefix: str = "") -> None:
        """Take the gains of a pitch law, whose table, where it has one, is told by a constant of the preprocessor."""
        table = law.table
        self.constants[flag] = int(table is not None)
        if table is None:
            self.take(group + "gains", law, prefix)
            return
        self.groups.add(group + "gain_table")
        columns = "gain_pitch", "proportional_gains", "integral_gains"
        for name, column in zip(columns, (table.pitch, table.proportional, table.integral), strict=True):
            self.values[f"{prefix}{name}"] = list(column)

    def take_estimator(self, estimator: WindEstimator) -> None:
        """Take the parameters of a wind estimator except its bandwidth and table, the same for all of a turbine."""
        self.values |= {
            "torque_to_moment": estimator._to_moment,
            "rotor_inertia": estimator.inertia,
            "estimator_lowest_speed": estimator.lowest_speed,
        }

    def take_fade(self, fade: AboveRated | None, constant: str, name: str, group: str = "") -> None:
        """Take a fade below rated wind, if there is one."""
        self.constants[constant] = int(fade is not None)
        if fade is None:
            return
        p = fade.parameters
        self.groups.add(f"{group or name}_fade")
        self.values |= {
            "fade_fine_pitch": fade.fine_pitch,
            f"{name}_fade_pitch": list(p.pitch),
            f"{name}_fade_speed": list(p.speed),
            f"{name}_fade_fine_speed": [1e3, 2e3] if p.fine_speed is None else list(p.fine_speed),
            f"{name}_fade_time": p.time_constant,
        }

    def take_lidar(self, lidar: Lidar, apart: bool = False) -> None:
        """Take the lidar that a controller or an agent reads, its beams apart or not."""
        lidar = replace(lidar, apart=apart)
        check_points(lidar, "to be exported")
        self.groups.add("lidar")
        self.lidar = lidar
        self.values["lidar_speed_factor"] = 1.0


_FLAGS = (
    "GAIN_TABLE", "TRACKS_TIP_SPEED_RATIO", "FADE_IPC", "FADE_FORE_AFT", "FADE_LINEAR", "FADE_LIDAR", "FADE_FLOATING",
    "N_HARMONICS", "INDIVIDUAL_BLADES", "DERATE", "WITH_EXCLUSION", "START_GAIN_TABLE",
)  # fmt: skip
"""Constants that are 0 for a controller without the part."""


def controller_parts(controller: Controller, turbine: Turbine, step: float) -> Parts:
    """Take a controller with a step [s] apart."""
    if not turbine.drivetrain.takes_torque:
        raise ValueError(f"the generator must take a torque to be exported, that of {turbine.name} is a damper")
    if turbine.n_blades > 3:
        raise ValueError(
            f"a turbine must have at most 3 blades for the Bladed interface, {turbine.name} has {turbine.n_blades}"
        )
    parts = Parts(turbine)
    drive, pitch = turbine.drivetrain, turbine.pitch
    parts.values |= {
        "gear_ratio": drive.gear_ratio,
        "rated_rotor_speed": drive.rated_rotor_speed,
        "controller_step": step,
        "drive": 0.0,
        "acceleration_axes": 0.0,
        "drive_min_pitch": pitch.min_pitch,
        "drive_max_pitch": pitch.max_pitch,
        "drive_pitch_rate": pitch.max_rate,
        "drive_servo_frequency": pitch.servo_frequency or 0.0,
        "drive_servo_damping": pitch.servo_damping,
        "drive_max_torque": drive.max_generator_torque,
        "drive_torque_rate": drive.max_torque_rate,
        "drive_yaw_rate": turbine.nacelle.max_yaw_rate,
    }
    parts.constants |= dict.fromkeys(_FLAGS, 0) | {"WITH_PLATFORM": int(turbine.floater is not None)}
    base: Any
    base, *additions = parts_of(controller)
    if type(base) is FloatingFeedback:
        parts.additions.append("FLOATING_FEEDBACK")
        _floating(parts, base)
        base = base.base
    if type(base) is Supervisor:
        _supervision(parts, base)
        base = base.base
    if type(base) is LidarFeedforward:
        _feedforward(parts, base)
        base = base.base
    if type(base) not in _BASES:  # what is derived from one may do something else
        raise _refused(base)
    _BASES[type(base)](parts, base)
    for addition in additions:
        if type(addition) not in _ADDITIONS:
            raise _refused(addition)
        name, take = _ADDITIONS[type(addition)]
        parts.additions.append(name)
        take(parts, addition, step)
    if type(controller) is FaultSupervisor:
        _guard(parts, controller)
    if len(set(parts.additions)) < len(parts.additions):
        kinds = ", ".join(type(addition).__name__ for addition in additions)
        raise ValueError(f"each kind of addition must be there once to be exported, got {kinds}")
    return parts


def _refused(part: object) -> ValueError:
    return ValueError(f"a controller to be exported must be made of {', '.join(SUPPORTED)}, got {type(part).__name__}")


def _feedforward(parts: Parts, wrapper: LidarFeedforward) -> None:
    """Collective pitch ahead of the wind: ranges and steady pitch go into the source, the rest into the parameters."""
    parts.take_lidar(wrapper.lidar)
    parts.groups.add("feedforward")
    parts.feedforward = wrapper
    parts.values |= {"lidar_gain": 1.0, "lidar_delay": wrapper.delay, "lidar_wavenumber": wrapper.wavenumber}
    if wrapper.delay > LONGEST_LIDAR_DELAY:
        raise ValueError(
            f"the delay of a lidar's feed-forward must be at most {LONGEST_LIDAR_DELAY:g} s to be exported, got "
            f"{wrapper.delay!r} s"
        )
    parts.take_fade(wrapper.fade, "FADE_LIDAR", "lidar")
    parts.reads["LIDAR"] = {"lidar", "nacelle_yaw", "rotor_speed"}


def _supervision(parts: Parts, wrapper: Supervisor) -> None:
    """Supervisory control: its numbers, and the pitch law of its start-up."""
    parts.supervisor = wrapper
    parts.take("supervisor", wrapper, "supervisor_")
    hidden = "radius", "rated_speed", "rated_torque", "to_generator"
    parts.values |= {f"supervisor_{name}": getattr(wrapper, name) for name in hidden}
    parts.take_gains(wrapper.pitch_law, "supervisor_", "START_GAIN_TABLE", "supervisor_")
    parts.reads["SUPERVISOR"] = {"rotor_speed", "wind"}


def _baseline(parts: Parts, p: BaselineParameters) -> None:
    """Speed filter, pitch law and limits."""
    parts.take("base", p)
    parts.values |= {"rated_power": p.torque.rated_power, "constant_power": float(p.constant_power)}
    parts.take_gains(p.pitch_law, "", "GAIN_TABLE")


def _torque_curve(parts: Parts, base: DisconController | PowerTracking) -> None:
    p = base.parameters
    _baseline(parts, p)
    parts.take("torque_curve", p.torque)
    parts.values["region_3_min_pitch"] = p.region_3_min_pitch
    parts.reads["BASE"] = {"pitch", "generator_speed"}


def _power_tracking(parts: Parts, base: PowerTracking) -> None:
    """Torque curve that follows a demanded power."""
    _torque_curve(parts, base)
    if base.way == "pitch" and parts.feedforward is not None:
        raise ValueError(
            "a controller to be exported must have derate_pitch or lidar, not both: one moves the least pitch"
        )
    parts.constants["DERATE"] = 1 + WAYS.index(base.way)
    parts.groups.add("power")
    parts.values |= {"generator_efficiency": base.generator_efficiency, "power_level": base.level}
    if base.way == "pitch":
        parts.groups.add("power_pitch")
        parts.values |= {"power_shares": base.shares.tolist(), "power_pitch": base.share_pitch.tolist()}
    if base.way == "kinetic":
        parts.take("power_store", base, "store_")
    parts.reads["BASE"] = {"pitch", "generator_speed", "demanded_power"}


def _tracking(parts: Parts, base: TsrTrackingController) -> None:
    p, estimator = base.parameters, base.estimator
    _baseline(parts, p.baseline)
    parts.constants["TRACKS_TIP_SPEED_RATIO"] = 1
    parts.tables["BASE_TABLE"] = estimator.table
    parts.take_estimator(estimator)
    parts.take("tracking", p)
    parts.values |= {
        "min_generator_speed": p.min_speed,
        "estimator_bandwidth": estimator.bandwidth,
        "generator_share": estimator.generator_share,
        "schedule_wind": np.asarray(p.schedule_wind).tolist(),
        "schedule_pitch": np.asarray(p.schedule_pitch).tolist(),
    }
    parts.reads["BASE"] = {"pitch", "generator_speed", "rotor_speed", "generator_torque"}
    if (band := base.exclusion) is not None:
        parts.constants["WITH_EXCLUSION"] = 1
        parts.take("exclusion", band, "exclusion_")
        parts.values["exclusion_above"] = float(band._always_above)


def _individual_pitch(parts: Parts, addition: IndividualPitch, step: float) -> None:
    parts.groups.add("ipc")
    laws = [harmonic.parameters for harmonic in addition.harmonics]
    if [p.harmonic for p in laws] != list(range(1, len(laws) + 1)):
        raise ValueError(
            f"the harmonics of individual pitch to be exported must be 1, or 1 and 2, got {[p.harmonic for p in laws]}"
        )
    parts.constants |= {"N_HARMONICS": len(laws), "INDIVIDUAL_BLADES": 1}
    names = ("integral_gain", "proportional_gain", "level", "leak", "limit", "rate_limit")
    parts.values |= {f"ipc_{name}": [getattr(p, name) for p in laws] for name in names}
    lead = pitch_delay(addition.drive, step, addition.simulator_step) if addition.lead is None else addition.lead
    parts.values["ipc_lead"] = lead
    parts.take_fade(addition.fade, "FADE_IPC", "ipc")
    parts.reads["IPC"] = {"pitch", "out_of_plane", "in_plane", "azimuth", "rotor_speed"}


def _linear_pitch(parts: Parts, addition: LoadObserver, step: float) -> None:
    """Linear optimal pitch: its matrices go into the source, its limits into the parameters."""
    parts.groups |= {"linear", "acceleration"}
    design, offsets = addition.design, addition.offsets
    n_designs, n_outputs, _, n_taps = design.responses.shape
    if "wave_elevation" in design.outputs:
        raise ValueError("linear optimal pitch to be exported must read no waves, got a design with wave_elevation")
    parts.linear = LinearPitch(design, addition.sign, addition.bins, MOTION_CORNER * addition.natural)
    parts.constants |= {"N_DESIGNS": n_designs, "N_OUTPUTS": n_outputs, "N_TAPS": n_taps}
    parts.constants |= {"N_DELAYS": design.gains.shape[-1], "INDIVIDUAL_BLADES": 1}
    parts.values |= {
        "linear_gain": addition.gain,
        "linear_limit": offsets.limit,
        "linear_rate_limit": offsets.rate_limit,
        "linear_lead": pitch_delay(offsets.drive, step),
        "linear_schedule_time": SCHEDULE_TIME,
    }
    parts.take_fade(offsets.fade, "FADE_LINEAR", "linear")
    parts.constants |= {"N_SEEN_BINS": len(addition.bins), "MOST_SEEN_BINS": MOST_SEEN_BINS}
    parts.reads["LINEAR"] = LINEAR_READS if n_outputs == len(OUTPUTS) else LINEAR_READS | _FLOATS


def _fore_aft(parts: Parts, addition: ForeAftDamper, step: float) -> None:
    low, high = addition.pitch_limits
    if not math.isclose(high, parts.turbine.pitch.max_pitch):
        raise ValueError(f"the fore-aft damper must end at the greatest pitch of the drives, got {high!r} rad")
    parts.take("fore_aft", addition, "fore_aft_")
    parts.values |= {"fore_aft_corner": addition._velocity.corner, "fore_aft_min_pitch": low}
    parts.take_fade(addition.fade, "FADE_FORE_AFT", "fore_aft")
    parts.groups.add("acceleration")
    parts.reads.setdefault("DAMPER", set()).update(ACCELERATION | {"rotor_speed"})


def _floating(parts: Parts, wrapper: FloatingFeedback) -> None:
    parts.take("floating", wrapper, "floating_")
    parts.values["floating_min_pitch"] = wrapper.pitch_limits[0]
    parts.take_fade(wrapper.fade, "FADE_FLOATING", "floating")
    parts.reads["FLOATING"] = _FLOATS | {"rotor_speed"}


def _side_side(parts: Parts, addition: SideSideDamper, step: float) -> None:
    parts.take("side_side", addition, "side_side_")
    parts.values["side_side_corner"] = addition._velocity.corner
    parts.groups.add("acceleration")
    parts.reads.setdefault("DAMPER", set()).update(ACCELERATION)


def _yaw(parts: Parts, addition: YawByDeadBand, step: float) -> None:
    parts.take("yaw", addition, "yaw_")
    parts.values |= {"yaw_slow_time": addition._slow.time_constant, "yaw_fast_time": addition._fast.time_constant}
    parts.reads["YAW"] = {"yaw_error"}


def _guard(parts: Parts, guard: FaultSupervisor) -> None:
    """A supervisor of faults around the controller."""
    parts.constants["INDIVIDUAL_BLADES"] = 1
    parts.take("guard", guard, "guard_")
    if "supervisor" in parts.groups:
        parts.take("guard_stop", guard, "guard_")
    parts.reads["GUARD"] = {
        "pitch", "out_of_plane", "in_plane", "rotor_speed", "generator_speed", "generator_torque", "power", "yaw_error",
        "wind", "azimuth",
    }  # fmt: skip


_BASES: dict[type[Any], Callable[[Parts, Any], None]] = {
    DisconController: _torque_curve,
    PowerTracking: _power_tracking,
    TsrTrackingController: _tracking,
}
_ADDITIONS: dict[type[Any], tuple[str, Callable[[Parts, Any, float], None]]] = {
    IndividualPitch: ("INDIVIDUAL_PITCH", _individual_pitch),
    LinearOptimalPitch: ("LINEAR_PITCH_ADDED", _linear_pitch),
    LoadObserver: ("LINEAR_PITCH_ADDED", _linear_pitch),
    ForeAftDamper: ("FORE_AFT_DAMPER", _fore_aft),
    SideSideDamper: ("SIDE_SIDE_DAMPER", _side_side),
    YawByDeadBand: ("YAW", _yaw),
}
"""Names of the C source, and what takes the parameters of an addition."""


_PARTS = {"mean": 0, "tilt": 1, "yaw": 2}
_LINEAR = _PARTS | {"share": 3, "schedule": 4}
_MOTION = [f"{what}_{axis}" for what in ("velocity", "displacement") for axis in ("fore_aft", "side_side")]


def _read_channels(each: str) -> dict[str, tuple[str, set[str]]]:
    """Channels of the table that the turbine or each blade has: how the C source calls them, and what they need."""
    rows = [row for row in read_rows(Path(__file__).with_name("channels.csv")) if row["each"] == each]
    return {row["name"]: (row["kind"], set(row["reads"].split())) for row in rows}


_PLAIN, _BY_BLADE = _read_channels("turbine"), _read_channels("blade")
_MOMENTS = {"pitch", "out_of_plane", "in_plane"}
_FIXED_FRAME = {
    "root_flap_moment": "FLAP_FIXED_FRAME",
    "root_edge_moment": "EDGE_FIXED_FRAME",
    "root_out_of_plane_moment": "OUT_OF_PLANE_FIXED_FRAME",
}
_LIDAR = {"lidar", "nacelle_yaw"}
_FLOATS = {"platform", "nacelle_yaw"}
_DIAL, _STATE, _OUTPUT = ("|".join(names) for names in (DIAL_NAMES, STATES, FLOATING_OUTPUTS[:8]))
_PATTERNS: dict[str, Callable[[re.Match[str]], tuple[str, int, set[str]]]] = {
    rf"({'|'.join(_FIXED_FRAME)})_(mean|tilt|yaw)":
        lambda m: (_FIXED_FRAME[m[1]], _PARTS[m[2]], _MOMENTS | {"azimuth"}),
    rf"disturbance_({_OUTPUT})_(\d+)":
        lambda m: ("DISTURBANCE", MOST_SEEN_BINS * FLOATING_OUTPUTS.index(m[1]) + int(m[2]) - 1, LINEAR_READS),
    rf"linear_pitch_({'|'.join(_LINEAR)})": lambda m: ("LINEAR_PITCH", _LINEAR[m[1]], LINEAR_READS),
    rf"model_(gain|lag)_({_OUTPUT})":
        lambda m: (f"MODEL_{m[1].upper()}", FLOATING_OUTPUTS.index(m[2]), LINEAR_READS),
    rf"response_({_OUTPUT})": lambda m: ("OWN_RESPONSE", FLOATING_OUTPUTS.index(m[1]), LINEAR_READS),
    rf"tower_({'|'.join(_MOTION)})":
        lambda m: ("TOWER_MOTION", _MOTION.index(m[1]), LINEAR_READS),
    rf"platform_({'|'.join(PLATFORM)})": lambda m: ("PLATFORM", list(PLATFORM).index(m[1]), {"platform"}),
    r"lidar_(\d+)": lambda m: ("LIDAR", int(m[1]) - 1, _LIDAR),
    rf"dial_({_DIAL})": lambda m: ("DIAL", DIAL_NAMES.index(m[1]), set()),
    rf"state_({_STATE})": lambda m: ("SUPERVISOR_STATE", STATES.index(m[1]), set()),
    r"pitch_offset_(\d)": lambda m: ("SETPOINT", int(m[1]) - 1, set()),
    rf"({'|'.join(_BY_BLADE)})_(\d)": lambda m: (_BY_BLADE[m[1]][0], int(m[2]) - 1, _BY_BLADE[m[1]][1]),
}  # fmt: skip
"""Channels with a number or a name in theirs: kind, index and readings."""
KINDS = (
    *(kind for kind, _ in _PLAIN.values()), *(kind for kind, _ in _BY_BLADE.values()), *_FIXED_FRAME.values(),
    "SETPOINT", "PREVIOUS_ACTION", "DISTURBANCE", "LINEAR_PITCH", "MODEL_GAIN", "MODEL_LAG", "OWN_RESPONSE",
    "TOWER_MOTION", "PLATFORM", "LIDAR", "LIDAR_BEAM", "DIAL", "SUPERVISOR_STATE", "HELD",
)  # fmt: skip
"""Ways to read a channel, by name in the C source."""


@dataclass(frozen=True)
class Seen:
    """One channel of a reading."""

    kind: str  #: of `KINDS`
    index: int  #: blade, coordinate or component, from 0
    channel: Any
    reads: set[str]  #: readings that it needs
    washed: bool = False  #: whether it passes the high-pass filter of the observation


def seen_channels(layout: EnvLayout, hold_missing: bool) -> list[Seen]:
    """Channels of one reading, in order, without those of earlier readings.

    Those that the interface does not have are held at the middle of their scale if ``hold_missing``.
    """
    found = [
        replace(_seen(channel, layout), washed=channel.name in layout.washed)
        for channel in layout.observation.channels
        if "@" not in channel.name
    ]
    missing = [one.channel.name for one in found if one.kind == "HELD"]
    if missing and not hold_missing:
        raise ValueError(
            f"channels of the agent must be on the Bladed interface, got {', '.join(missing)}, which are not. Train it "
            "with observation='measurable', all that there is (docs/howto/export.md), or have them held at the middle "
            "of their scale: --hold-missing"
        )
    return found


def _seen(channel: Any, layout: EnvLayout) -> Seen:
    name: str = channel.name
    if name in _PLAIN:
        return Seen(_PLAIN[name][0], 0, channel, _PLAIN[name][1])
    if name == "torque_offset":
        return Seen("SETPOINT", _n_pitch(layout), channel, set())
    if name.startswith("previous_"):
        return Seen("PREVIOUS_ACTION", layout.action.names.index(name.removeprefix("previous_")), channel, set())
    if re.fullmatch(r"lidar_\d+_\d+", name):
        assert layout.lidar is not None  # what the channels are read by
        return Seen("LIDAR_BEAM", layout.lidar.names.index(name), channel, _LIDAR)
    for pattern, parts_of_name in _PATTERNS.items():
        if match := re.fullmatch(pattern, name):
            kind, index, reads = parts_of_name(match)
            return Seen(kind, index, channel, reads)
    return Seen("HELD", 0, channel, set())


def _n_pitch(layout: EnvLayout) -> int:
    return layout.action.n_pitch if "pitch" in layout.action.components else 0


def add_agent(parts: Parts, env: WindTurbineEnv, network: Network, seen: list[Seen]) -> None:
    """Add an agent to the parts of its base controller, with the environment in which it was trained."""
    layout, action, residual = env.layout, env.layout.action, env.operation.residual
    parts.groups.add("agent")
    n_pitch, torque = _n_pitch(layout), "torque" in action.components
    forms = "none", "collective", "individual", "fixed-frame", "cyclic"
    history = len(layout.observation) // len(seen)
    anemometer = NacelleAnemometer()
    turning = action.pitch in ("fixed-frame", "cyclic") and n_pitch > 0
    parts.constants |= {
        "N_PITCH": n_pitch,
        "N_COORDINATES": n_pitch + torque,
        "N_SETPOINT": max(n_pitch + torque, 1),
        "N_MEAN": action.n_mean if n_pitch else 0,
        "N_ACT": action.size,
        "N_CHANNELS": len(seen),
        "N_OBS": len(layout.observation),
        "N_HISTORY": layout.delay + history,
        "DELAY": layout.delay,
        "OFFSET_FORM": int(action.residual == "offset"),
        "HAS_YAW": int(action.has_yaw),
        "HAS_TORQUE": int(torque),
        "HAS_SET_POINT": int("set_point" in action.components),
        "SUBSTEPS": env.operation.count,
        "SENSES_WIND": int(any(one.kind in ("ROTOR_WIND", "POWER_HEADROOM") for one in seen)),
        "SQUASHED": int(network.squashed),
        "NORMALIZED": int(network.normalization is not None),
        "N_LAYERS": len(network.layers),
        "WIDTH": max(len(layout.observation), *(max(layer.weight.shape) for layer in network.layers)),
    }
    if any(one.kind == "DIAL" for one in seen):
        parts.groups.add("dial")
        parts.constants["WITH_DIAL"] = 1
        weights = env.options.dial.weights  # of drawn ones an export keeps to equal ones
        chosen = weights if isinstance(weights, Mapping) else {}
        parts.values["dial"] = [float(chosen.get(name, 1.0)) for name in DIAL_NAMES]
    parts.constants["PITCH_FORM"] = forms.index(action.pitch if n_pitch else "none")
    if n_pitch and action.pitch != "collective":
        parts.constants["INDIVIDUAL_BLADES"] = 1
    parts.take_fade(residual._fade if residual is not None else None, "FADE_AGENT", "offset", "agent")
    spans = action.spans
    parts.values |= {
        "agent": 1.0,
        "control_step": layout.control_dt,
        "most_shaft_power": action._most_shaft_power,
        "offset_pitch_limit": action.pitch_high.tolist() if n_pitch else [0.0],
        "offset_pitch_rate": spans["pitch_rate"],
        "offset_torque_limit": spans["torque"],
        "offset_torque_rate": spans["torque_rate"],
        "offset_yaw_rate": spans["yaw_rate"],
        "offset_lead": action.delay,
        "sensor_washout": env.options.observations.washout or 0.0,
        "offset_washout": residual._lasting.time_constant if residual is not None and residual._lasting else 0.0,
        "anemometer_time": anemometer._speed.time_constant,
        "vane_time": anemometer._direction.time_constant,
        "rotor_inertia": rotor_inertia(parts.turbine),
        "headroom_factor": available_power(parts.turbine, 1.0),
        "headroom_most": 1.5 * parts.turbine.drivetrain.rated_power,
    }
    if "set_point" in action.components:
        parts.groups.add("agent_set_point")
        parts.values["offset_set_point_limit"] = spans["set_point"]
        parts.values["offset_set_point_rate"] = spans["set_point_rate"]
    if "power" not in parts.groups:
        efficiency = parts.turbine.drivetrain.generator_efficiency
        parts.values |= {"generator_efficiency": efficiency, "power_level": 1.0}
    if parts.constants["SENSES_WIND"]:
        estimator = WindEstimator.of_turbine(parts.turbine)
        parts.take_estimator(estimator)
        parts.values["sensor_bandwidth"] = estimator.bandwidth
        parts.tables["SENSOR_TABLE"] = estimator.table
    reads = set().union(*(one.reads for one in seen))
    if reads >= LINEAR_READS:
        reads |= parts.reads.get("LINEAR", set())
    if "lidar" in reads:
        assert layout.lidar is not None  # what the channels are read by
        parts.take_lidar(layout.lidar, any(one.kind == "LIDAR_BEAM" for one in seen))
    if turning:
        reads |= {"azimuth", "rotor_speed"}
    if parts.constants["FADE_AGENT"] or torque:
        reads.add("rotor_speed")
    if reads & (ACCELERATION - {"nacelle_yaw"}):
        parts.groups.add("acceleration")
    parts.reads["AGENT"] = reads
