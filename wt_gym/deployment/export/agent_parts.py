"""A trained residual agent taken apart into what its C source needs: channels, network, limits of the offsets."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from wt_gym.control import NacelleAnemometer
from wt_gym.control.controllers import STATES
from wt_gym.control.controllers.linear_optimal import OUTPUTS
from wt_gym.control.controllers.tsr_tracking import WindEstimator
from wt_gym.control.operating_point import rotor_inertia
from wt_gym.deployment.export.controller_parts import (
    ACCELERATION,
    LINEAR_READS,
    MOST_SEEN_BINS,
    Parts,
)
from wt_gym.envs.dial import DIAL_NAMES
from wt_gym.envs.power import available_power

if TYPE_CHECKING:
    from wt_gym.deployment.export.policy import Network
    from wt_gym.envs.layout import EnvLayout
    from wt_gym.envs.turbine_env import WindTurbineEnv

__all__ = ["KINDS", "Seen", "add_agent", "seen_channels"]

_PARTS = {"mean": 0, "tilt": 1, "yaw": 2}
_LINEAR = _PARTS | {"share": 3, "schedule": 4}
_PLAIN = {
    "rotor_speed": ("ROTOR_SPEED", {"rotor_speed"}),
    "generator_speed": ("GENERATOR_SPEED", {"generator_speed"}),
    "generator_power": ("GENERATOR_POWER", {"power"}),
    "generator_torque": ("GENERATOR_TORQUE", {"generator_torque"}),
    "nacelle_acceleration_fore_aft": ("ACCELERATION_FORE_AFT", set(ACCELERATION)),
    "nacelle_acceleration_side_side": ("ACCELERATION_SIDE_SIDE", set(ACCELERATION)),
    "pitch": ("MEAN_PITCH", {"pitch"}),
    "pitch_rate": ("MEAN_PITCH_RATE", {"pitch"}),
    "pitch_demand": ("MEAN_PITCH_DEMAND", set()),
    "generator_torque_demand": ("TORQUE_DEMAND", set()),
    "wind_speed": ("WIND_SPEED", {"wind"}),
    "yaw_error": ("YAW_ERROR", {"yaw_error"}),
    "rotor_wind": ("ROTOR_WIND", {"rotor_speed", "generator_torque", "pitch"}),
    "azimuth_sin": ("AZIMUTH_SIN", {"azimuth"}),
    "azimuth_cos": ("AZIMUTH_COS", {"azimuth"}),
    "controller_pitch": ("CONTROLLER_PITCH", set()),
    "controller_torque": ("CONTROLLER_TORQUE", set()),
    "residual_share": ("SHARE", {"rotor_speed"}),
    "residual_mean": ("MEAN_OFFSET", set()),
    "dead_band_error": ("DEAD_BAND_ERROR", set()),
    "dead_band_turning": ("DEAD_BAND_TURNING", set()),
    "mean_wind": ("SUPERVISOR_WIND", {"wind"}),
    "set_point": ("SUPERVISOR_SET_POINT", set()),
    "load_share": ("SUPERVISOR_LOAD", set()),
    "set_point_offset": ("SET_POINT_OFFSET", set()),
    "demanded_power": ("DEMANDED_POWER", {"demanded_power"}),
    "power_error": ("POWER_ERROR", {"demanded_power", "power"}),
    "rotor_energy": ("ROTOR_ENERGY", {"rotor_speed"}),
    "power_headroom": ("POWER_HEADROOM", {"demanded_power", "rotor_speed", "generator_torque", "pitch"}),
}
"""Channels without a number: how the C source calls them, and the readings that they need."""
_MOMENTS = {"pitch", "out_of_plane", "in_plane"}
_BY_BLADE = {
    "pitch": ("PITCH", {"pitch"}),
    "pitch_rate": ("PITCH_RATE", {"pitch"}),
    "pitch_demand": ("PITCH_DEMAND", set()),
    "root_flap_moment": ("FLAP_MOMENT", _MOMENTS),
    "root_edge_moment": ("EDGE_MOMENT", _MOMENTS),
    "root_out_of_plane_moment": ("OUT_OF_PLANE_MOMENT", _MOMENTS),
}
_FIXED_FRAME = {
    "root_flap_moment": "FLAP_FIXED_FRAME",
    "root_edge_moment": "EDGE_FIXED_FRAME",
    "root_out_of_plane_moment": "OUT_OF_PLANE_FIXED_FRAME",
}
KINDS = (
    *(kind for kind, _ in _PLAIN.values()), *(kind for kind, _ in _BY_BLADE.values()), *_FIXED_FRAME.values(),
    "SETPOINT", "PREVIOUS_ACTION", "DISTURBANCE", "LINEAR_PITCH", "MODEL_FIT", "LIDAR", "LIDAR_BEAM", "DIAL",
    "SUPERVISOR_STATE", "HELD",
)  # fmt: skip
"""Ways to read a channel, by name in the C source."""


@dataclass(frozen=True)
class Seen:
    """One channel of a reading."""

    kind: str
    """Of `KINDS`."""
    index: int
    """Blade, coordinate or component, from 0."""
    channel: Any
    reads: set[str]
    """Readings that it needs."""
    washed: bool = False
    """Whether it passes the high-pass filter of the observation."""


def seen_channels(layout: EnvLayout, hold_missing: bool) -> list[Seen]:
    """Channels of one reading, in order, without those of earlier readings.

    Parameters
    ----------
    hold_missing : bool
        Whether channels that the interface does not have are held at the middle of their scale.

    Raises
    ------
    ValueError
        If there are such channels and they are not held.
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
    if parted := re.fullmatch(rf"({'|'.join(_FIXED_FRAME)})_(mean|tilt|yaw)", name):
        return Seen(_FIXED_FRAME[parted[1]], _PARTS[parted[2]], channel, _MOMENTS | {"azimuth"})
    if parted := re.fullmatch(rf"disturbance_({'|'.join(OUTPUTS)})_(\d+)", name):
        place = MOST_SEEN_BINS * OUTPUTS.index(parted[1]) + int(parted[2]) - 1
        return Seen("DISTURBANCE", place, channel, LINEAR_READS)
    if parted := re.fullmatch(rf"linear_pitch_({'|'.join(_LINEAR)})", name):
        return Seen("LINEAR_PITCH", _LINEAR[parted[1]], channel, LINEAR_READS)
    if parted := re.fullmatch(rf"model_(gain|lag)_({'|'.join(OUTPUTS)})", name):
        place = OUTPUTS.index(parted[2]) + (len(OUTPUTS) if parted[1] == "lag" else 0)
        return Seen("MODEL_FIT", place, channel, LINEAR_READS)
    if parted := re.fullmatch(r"lidar_(\d+)", name):
        return Seen("LIDAR", int(parted[1]) - 1, channel, {"lidar", "nacelle_yaw"})
    if re.fullmatch(r"lidar_\d+_\d+", name):
        assert layout.lidar is not None  # what the channels are read by
        return Seen("LIDAR_BEAM", layout.lidar.names.index(name), channel, {"lidar", "nacelle_yaw"})
    if parted := re.fullmatch(rf"dial_({'|'.join(DIAL_NAMES)})", name):
        return Seen("DIAL", DIAL_NAMES.index(parted[1]), channel, set())
    if parted := re.fullmatch(rf"state_({'|'.join(STATES)})", name):
        return Seen("SUPERVISOR_STATE", STATES.index(parted[1]), channel, set())
    if numbered := re.fullmatch(r"(.+)_(\d)", name):
        index = int(numbered[2]) - 1
        if numbered[1] == "pitch_offset":
            return Seen("SETPOINT", index, channel, set())
        if numbered[1] in _BY_BLADE:
            kind, reads = _BY_BLADE[numbered[1]]
            return Seen(kind, index, channel, reads)
    return Seen("HELD", 0, channel, set())


def _n_pitch(layout: EnvLayout) -> int:
    return layout.action.n_pitch if "pitch" in layout.action.components else 0


def add_agent(parts: Parts, env: WindTurbineEnv, network: Network, seen: list[Seen]) -> None:
    """Add an agent to the parts of its base controller.

    Parameters
    ----------
    parts : Parts
        Changed.
    env : WindTurbineEnv
        In which it was trained.

    Raises
    ------
    ValueError
        If its actions are not residual.
    """
    layout, action, residual = env.layout, env.layout.action, env.operation.residual
    if action.mode != "residual":
        raise ValueError(f"an agent must have residual actions to be exported as a controller, got {action.mode!r}")
    parts.groups.add("agent")
    n_pitch, torque = _n_pitch(layout), "torque" in action.components
    forms = {"collective": "COLLECTIVE", "individual": "INDIVIDUAL", "fixed-frame": "FIXED_FRAME", "cyclic": "CYCLIC"}
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
    parts.constants["PITCH_FORM"] = ("NONE", *forms.values()).index(forms[action.pitch] if n_pitch else "NONE")
    if n_pitch and action.pitch != "collective":
        parts.constants["INDIVIDUAL_BLADES"] = 1
    parts.take_fade(residual._fade if residual is not None else None, "FADE_AGENT", "offset", "agent")
    spans = action._spans
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
    }
    if "set_point" in action.components:
        parts.groups.add("agent_set_point")
        parts.values |= {
            "offset_set_point_limit": spans["set_point"],
            "offset_set_point_rate": spans["set_point_rate"],
        }
    rated = parts.turbine.drivetrain.rated_power
    parts.values |= {
        "rotor_inertia": rotor_inertia(parts.turbine),
        "headroom_factor": available_power(parts.turbine, 1.0),
        "headroom_most": 1.5 * rated,
    }
    if "power" not in parts.groups:
        efficiency = parts.turbine.drivetrain.generator_efficiency
        parts.values |= {"generator_efficiency": efficiency, "power_level": 1.0}
    if parts.constants["SENSES_WIND"]:
        estimator = WindEstimator.of_turbine(parts.turbine)
        parts.take_estimator(estimator)
        parts.values["sensor_bandwidth"] = estimator.bandwidth
        parts.tables["SENSOR_TABLE"] = estimator.table
    reads = set().union(*(one.reads for one in seen))
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
