"""A controller taken apart into what its C source needs: parameters, tables, additions, readings."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.control.bladed.records import MOST_LIDAR_POINTS
from wt_gym.control.controllers import (
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
from wt_gym.control.controllers.linear_optimal import SCHEDULE_TIME, LinearOptimalPitch
from wt_gym.control.controllers.power_tracking import WAYS, PowerTracking
from wt_gym.control.controllers.tsr_tracking import TsrTrackingController
from wt_gym.simulation.drivetrain.drives import pitch_delay

if TYPE_CHECKING:
    from wt_gym.control import Lidar
    from wt_gym.control.controllers import AboveRated, Controller
    from wt_gym.control.controllers.discon import BaselineParameters
    from wt_gym.control.controllers.linear_optimal import LinearDesign
    from wt_gym.control.controllers.tsr_tracking import WindEstimator
    from wt_gym.control.rotor import RotorTable
    from wt_gym.turbines import Turbine

__all__ = [
    "ACCELERATION", "FASTEST_LIDAR_WIND", "LINEAR_READS", "LONGEST_LIDAR_DELAY", "MOST_SEEN_BINS", "SUPPORTED",
    "LinearPitch", "Parts", "controller_parts", "estimator_values", "note_fade", "note_lidar",
]  # fmt: skip

SUPPORTED = ("discon", "retuned", "tsr_tracking", "derate_speed", "derate_torque", "derate_pitch", "derate_kinetic",
             "lidar", "ipc", "ipc_2p", "constrained_ipc", "fore_aft_damper",
             "side_side_damper", "tower_dampers", "tuned", "tuned_lidar", "yaw",
             "linear_pitch", "linear_optimal", "fault_supervisor", "supervisor")  # fmt: skip
"""Names of controllers that can be exported."""
ACCELERATION = frozenset({"fore_aft", "side_side", "nacelle_yaw"})
"""Readings behind either tower-top acceleration: records have both along axes that do not yaw."""
LINEAR_READS = {"pitch", "out_of_plane", "in_plane", "azimuth", "rotor_speed"} | ACCELERATION
"""Readings of linear optimal pitch."""
MOST_SEEN_BINS = 100
"""More than the bins of delays of any design; what the number of a channel counts outputs by."""
LONGEST_LIDAR_DELAY = 10.0
"""Greatest delay of the feed-forward that the parameter file of a library may have [s]."""
FASTEST_LIDAR_WIND = 60.0
"""Greatest wind that the gates of a lidar are believed to see [m/s]."""


@dataclass(frozen=True)
class LinearPitch:
    """Linear optimal pitch as the C source has it.

    Attributes
    ----------
    sign : float
        Of accelerations to the side.
    bins : tuple of (int, int)
        Of delays, over which an agent sees means of the disturbances.
    """

    design: LinearDesign
    sign: float
    bins: tuple[tuple[int, int], ...]


@dataclass
class Parts:
    """What a controller, and an agent on it, put into the C source.

    Attributes
    ----------
    values : dict
        Of `wt_gym.deployment.export.source.PARAMETERS`, numbers or lists.
    groups : set of str
        Of parameters.
    constants : dict
        Whole numbers of the preprocessor, by name.
    additions : list of str
        Names of the C source, in the order in which they act.
    tables : dict
        Rotor tables by the name in the C source.
    reads : dict
        Names of readings by who needs them: "BASE", "IPC", "DAMPER", "YAW", "AGENT", "LINEAR", "LIDAR", "GUARD",
        "SUPERVISOR".
    linear : LinearPitch or None
        Arrays of linear optimal pitch.
    lidar : Lidar or None
        That is read, with its beams apart where an agent reads them.
    feedforward : LidarFeedforward or None
        That moves the collective pitch.
    supervisor : Supervisor or None
        That starts and stops the turbine.
    """

    turbine: Turbine
    values: dict[str, float | list[float]] = field(default_factory=dict)
    groups: set[str] = field(default_factory=lambda: {"all", "base"})
    constants: dict[str, int] = field(default_factory=dict)
    additions: list[str] = field(default_factory=list)
    tables: dict[str, RotorTable] = field(default_factory=dict)
    reads: dict[str, set[str]] = field(default_factory=dict)
    linear: LinearPitch | None = None
    lidar: Lidar | None = None
    feedforward: LidarFeedforward | None = None
    supervisor: Supervisor | None = None

    def parks_in(self, wind: float) -> bool:
        """Whether the turbine stands at a start in a wind [m/s]."""
        return self.supervisor is not None and not self.supervisor.runs_in(wind)


def controller_parts(controller: Controller, turbine: Turbine, step: float) -> Parts:
    """Take a controller apart.

    Parameters
    ----------
    step : float
        Of the controller [s].

    Raises
    ------
    ValueError
        For a part, or a turbine, that cannot be exported.
    """
    if not turbine.drivetrain.takes_torque:
        raise ValueError(f"the generator must take a torque to be exported, that of {turbine.name} is a damper")
    if turbine.n_blades > 3:
        raise ValueError(
            f"a turbine must have at most 3 blades for the Bladed interface, {turbine.name} has {turbine.n_blades}"
        )
    parts = Parts(turbine)
    drive, pitch = turbine.drivetrain, turbine.pitch
    parts.values |= {
        "controller_step": step,
        "gear_ratio": drive.gear_ratio,
        "rated_rotor_speed": drive.rated_rotor_speed,
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
    flags = (
        "GAIN_TABLE",
        "TRACKS_TIP_SPEED_RATIO",
        "FADE_IPC",
        "FADE_FORE_AFT",
        "FADE_LINEAR",
        "FADE_LIDAR",
        "N_HARMONICS",
        "INDIVIDUAL_BLADES",
        "DERATE",
        "WITH_EXCLUSION",
        "START_GAIN_TABLE",
    )
    parts.constants |= dict.fromkeys(flags, 0)
    base: Any
    base, *additions = parts_of(controller)
    if type(base) is Supervisor:
        _supervision(parts, base)
        base = base.base
    if type(base) is LidarFeedforward:
        _feedforward(parts, base)
        base = base.base
    if type(base) is DisconController:  # what is derived from it may do something else
        _torque_curve(parts, base.parameters)
    elif type(base) is PowerTracking:
        _torque_curve(parts, base.parameters)
        _power_tracking(parts, base)
    elif type(base) is TsrTrackingController:
        _tracking(parts, base)
    else:
        raise _refused(base)
    for addition in additions:
        if type(addition) is IndividualPitch:
            _individual_pitch(parts, addition, step)
        elif type(addition) is LinearOptimalPitch:
            _linear_pitch(parts, addition, step)
        elif type(addition) is ForeAftDamper:
            _fore_aft(parts, addition)
        elif type(addition) is SideSideDamper:
            _side_side(parts, addition)
        elif type(addition) is YawByDeadBand:
            _yaw(parts, addition)
        else:
            raise _refused(addition)
    if type(controller) is FaultSupervisor:
        _guard(parts, controller)
    if len(set(parts.additions)) < len(parts.additions):
        raise ValueError("each kind of addition must be there once to be exported, individual pitch is there twice")
    return parts


def _refused(part: object) -> ValueError:
    return ValueError(f"a controller to be exported must be made of {', '.join(SUPPORTED)}, got {type(part).__name__}")


def note_lidar(parts: Parts, lidar: Lidar, apart: bool = False) -> None:
    """Note the lidar that a controller or an agent reads.

    Parameters
    ----------
    parts : Parts
        Changed.
    apart : bool
        Whether its beams are read apart.

    Raises
    ------
    ValueError
        For more gates, or beams apart, than the interface has records for.
    """
    lidar = replace(lidar, apart=apart)
    if lidar.n_readings > MOST_LIDAR_POINTS:
        what = "beams over all gates" if apart else "gates"
        raise ValueError(
            f"a lidar to be exported must have at most {MOST_LIDAR_POINTS} {what}, for which the Bladed interface has "
            f"records, got {lidar.n_readings}"
        )
    parts.groups.add("lidar")
    parts.lidar = lidar
    parts.values["lidar_speed_factor"] = 1.0


def _feedforward(parts: Parts, wrapper: LidarFeedforward) -> None:
    """Collective pitch ahead of the wind: ranges and steady pitch go into the source, the rest into the parameters."""
    note_lidar(parts, wrapper.lidar)
    parts.groups.add("feedforward")
    parts.feedforward = wrapper
    parts.values |= {"lidar_gain": 1.0, "lidar_delay": wrapper.delay, "lidar_wavenumber": wrapper.wavenumber}
    if wrapper.delay > LONGEST_LIDAR_DELAY:
        raise ValueError(
            f"the delay of a lidar's feed-forward must be at most {LONGEST_LIDAR_DELAY:g} s to be exported, got "
            f"{wrapper.delay!r} s"
        )
    note_fade(parts, wrapper.fade, "lidar", "lidar", "FADE_LIDAR")
    parts.reads["LIDAR"] = {"lidar", "nacelle_yaw", "rotor_speed"}


def _supervision(parts: Parts, wrapper: Supervisor) -> None:
    """Supervisory control: its numbers, and the pitch law of its start-up."""
    p, law = wrapper.parameters, wrapper.pitch_law
    parts.supervisor = wrapper
    parts.groups.add("supervisor")
    names = ("cut_in", "restart", "derate_from", "cut_out", "least_speed", "least_power", "averaging", "restart_delay",
             "run_up", "gust", "overspeed", "stop_rate", "start_rate", "feather", "fine_pitch", "cut_in_speed",
             "radius", "rated_speed", "rated_torque")  # fmt: skip
    parts.values |= {f"supervisor_{name}": getattr(p, name) for name in names}
    parts.values["supervisor_to_generator"] = p.rated_speed * p.gear_ratio
    if law.table is None:
        parts.groups.add("supervisor_gains")
        parts.values |= {
            "supervisor_proportional_gain": law.proportional_gain,
            "supervisor_integral_gain": law.integral_gain,
            "supervisor_gain_doubling_pitch": law.gain_doubling_pitch,
        }
    else:
        parts.groups.add("supervisor_gain_table")
        parts.constants["START_GAIN_TABLE"] = 1
        parts.values |= {
            "supervisor_gain_pitch": list(law.table.pitch),
            "supervisor_proportional_gains": list(law.table.proportional),
            "supervisor_integral_gains": list(law.table.integral),
        }
    parts.reads["SUPERVISOR"] = {"rotor_speed", "wind"}


def _baseline(parts: Parts, p: BaselineParameters) -> None:
    """Speed filter, pitch law and limits."""
    parts.values |= {
        "corner_frequency": p.corner_frequency,
        "filter_damping": p.filter_damping,
        "notch_frequency": p.notch_frequency,
        "reference_speed": p.reference_speed,
        "min_pitch": p.min_pitch,
        "max_pitch": p.max_pitch,
        "max_pitch_rate": p.max_pitch_rate,
        "rated_power": p.torque.rated_power,
        "max_torque": p.max_torque,
        "max_torque_rate": p.max_torque_rate,
        "constant_power": float(p.constant_power),
    }
    table = p.gain_table
    if table is None:
        parts.groups.add("gains")
        parts.values |= {
            "proportional_gain": p.proportional_gain,
            "integral_gain": p.integral_gain,
            "gain_doubling_pitch": p.gain_doubling_pitch,
        }
        return
    parts.groups.add("gain_table")
    parts.constants["GAIN_TABLE"] = 1
    parts.values |= {
        "gain_pitch": list(table.pitch),
        "proportional_gains": list(table.proportional),
        "integral_gains": list(table.integral),
    }


def _torque_curve(parts: Parts, p: BaselineParameters) -> None:
    _baseline(parts, p)
    parts.groups.add("torque_curve")
    curve = p.torque
    parts.values |= {
        "cut_in_speed": curve.cut_in_speed,
        "region_2_speed": curve.region_2_speed,
        "rated_generator_speed": curve.rated_generator_speed,
        "region_2_gain": curve.region_2_gain,
        "slip": curve.slip,
        "region_3_min_pitch": p.region_3_min_pitch,
    }
    parts.reads["BASE"] = {"pitch", "generator_speed"}


def _power_tracking(parts: Parts, base: PowerTracking) -> None:
    """What follows a demanded power beyond the torque curve."""
    law = base.law
    if law.way == "pitch" and parts.feedforward is not None:
        raise ValueError(
            "a controller to be exported must have derate_pitch or lidar, not both: one moves the least pitch"
        )
    parts.constants["DERATE"] = 1 + WAYS.index(law.way)
    parts.groups.add("power")
    parts.values |= {"generator_efficiency": base.generator_efficiency, "power_level": base.level}
    if law.way == "pitch":
        parts.groups.add("power_pitch")
        parts.values |= {"power_shares": law._shares.tolist(), "power_pitch": law._share_pitch.tolist()}
    if law.way == "kinetic":
        parts.groups.add("power_store")
        parts.values |= {
            "store_lowest_speed": law.lowest_speed,
            "store_band": law.band,
            "store_raised": law.raised,
        }
    parts.reads["BASE"] = {"pitch", "generator_speed", "demanded_power"}


def _tracking(parts: Parts, base: TsrTrackingController) -> None:
    p = base.parameters
    _baseline(parts, p.baseline)
    parts.groups.add("tracking")
    parts.constants["TRACKS_TIP_SPEED_RATIO"] = 1
    parts.tables["BASE_TABLE"] = base.estimator.table
    parts.values |= estimator_values(base.estimator)
    parts.values |= {
        "speed_per_wind": p.speed_per_wind,
        "min_generator_speed": p.min_speed,
        "torque_gain": p.torque_gain,
        "torque_integral_gain": p.torque_integral_gain,
        "estimator_bandwidth": base.estimator.bandwidth,
        "wind_time_constant": p.wind_time_constant,
        "smoothing_time_constant": p.smoothing_time_constant,
        "pitch_to_speed": p.pitch_to_speed,
        "torque_to_speed": p.torque_to_speed,
        "constant_power_pitch": p.constant_power_pitch,
        "generator_share": base.estimator.generator_share,
        "schedule_wind": np.asarray(p.schedule_wind).tolist(),
        "schedule_pitch": np.asarray(p.schedule_pitch).tolist(),
    }
    parts.reads["BASE"] = {"pitch", "generator_speed", "rotor_speed", "generator_torque"}
    if (band := base.exclusion) is not None:
        parts.groups.add("exclusion")
        parts.constants["WITH_EXCLUSION"] = 1
        parts.values |= {
            "exclusion_low": band.low,
            "exclusion_high": band.high,
            "exclusion_rate": band.rate,
            "exclusion_above": float(band._always_above),
        }


def estimator_values(estimator: WindEstimator) -> dict[str, float | list[float]]:
    """Values of a wind estimator but its bandwidth and table, the same for all of a turbine."""
    return {
        "torque_to_moment": estimator._to_moment,
        "rotor_inertia": estimator.inertia,
        "estimator_lowest_speed": estimator.lowest_speed,
    }


def note_fade(parts: Parts, fade: AboveRated | None, group: str, name: str, constant: str) -> None:
    """Note a fade below rated wind, if there is one."""
    parts.constants[constant] = int(fade is not None)
    if fade is None:
        return
    p = fade.parameters
    parts.groups.add(f"{group}_fade")
    parts.values |= {
        "fade_fine_pitch": fade.fine_pitch,
        f"{name}_fade_pitch": list(p.pitch),
        f"{name}_fade_speed": list(p.speed),
        f"{name}_fade_fine_speed": [1e3, 2e3] if p.fine_speed is None else list(p.fine_speed),
        f"{name}_fade_time": p.time_constant,
    }


def _individual_pitch(parts: Parts, addition: IndividualPitch, step: float) -> None:
    parts.additions.append("INDIVIDUAL_PITCH")
    parts.groups.add("ipc")
    found = [harmonic.parameters for harmonic in addition.harmonics]
    if [p.harmonic for p in found] != list(range(1, len(found) + 1)):
        raise ValueError(
            f"the harmonics of individual pitch to be exported must be 1, or 1 and 2, got {[p.harmonic for p in found]}"
        )
    parts.constants |= {"N_HARMONICS": len(found), "INDIVIDUAL_BLADES": 1}
    names = ("integral_gain", "proportional_gain", "level", "leak", "limit", "rate_limit")
    parts.values |= {f"ipc_{name}": [getattr(p, name) for p in found] for name in names}
    lead = pitch_delay(addition.drive, step, addition.simulator_step) if addition.lead is None else addition.lead
    parts.values["ipc_lead"] = lead
    note_fade(parts, addition.fade, "ipc", "ipc", "FADE_IPC")
    parts.reads["IPC"] = {"pitch", "out_of_plane", "in_plane", "azimuth", "rotor_speed"}


def _linear_pitch(parts: Parts, addition: LinearOptimalPitch, step: float) -> None:
    """Linear optimal pitch: its matrices go into the source, its limits into the parameters."""
    parts.additions.append("LINEAR_PITCH_ADDED")
    parts.groups |= {"linear", "acceleration"}
    design, offsets = addition.design, addition.offsets
    n_designs, n_outputs, _, n_taps = design.responses.shape
    parts.linear = LinearPitch(design, addition.sign, addition.bins)
    parts.constants |= {
        "N_DESIGNS": n_designs,
        "N_OUTPUTS": n_outputs,
        "N_TAPS": n_taps,
        "N_DELAYS": design.gains.shape[-1],
        "INDIVIDUAL_BLADES": 1,
    }
    parts.values |= {
        "linear_gain": addition.gain,
        "linear_limit": offsets.limit,
        "linear_rate_limit": offsets.rate_limit,
        "linear_lead": pitch_delay(offsets.drive, step),
        "linear_schedule_time": SCHEDULE_TIME,
    }
    note_fade(parts, offsets.fade, "linear", "linear", "FADE_LINEAR")
    parts.constants |= {"N_SEEN_BINS": len(addition.bins), "MOST_SEEN_BINS": MOST_SEEN_BINS}
    parts.reads["LINEAR"] = LINEAR_READS


def _fore_aft(parts: Parts, addition: ForeAftDamper) -> None:
    parts.additions.append("FORE_AFT_DAMPER")
    parts.groups.add("fore_aft")
    low, high = addition.pitch_limits
    if not math.isclose(high, parts.turbine.pitch.max_pitch):
        raise ValueError(f"the fore-aft damper must end at the greatest pitch of the drives, got {high!r} rad")
    parts.values |= {
        "fore_aft_gain": addition.gain,
        "fore_aft_corner": addition._velocity.corner,
        "fore_aft_limit": addition.limit,
        "fore_aft_min_pitch": low,
    }
    note_fade(parts, addition.fade, "fore_aft", "fore_aft", "FADE_FORE_AFT")
    parts.groups.add("acceleration")
    parts.reads.setdefault("DAMPER", set()).update(ACCELERATION | {"rotor_speed"})


def _side_side(parts: Parts, addition: SideSideDamper) -> None:
    parts.additions.append("SIDE_SIDE_DAMPER")
    parts.groups.add("side_side")
    parts.values |= {
        "side_side_gain": addition.gain,
        "side_side_corner": addition._velocity.corner,
        "side_side_limit": addition.limit,
    }
    parts.groups.add("acceleration")
    parts.reads.setdefault("DAMPER", set()).update(ACCELERATION)


def _guard(parts: Parts, guard: FaultSupervisor) -> None:
    """A supervisor of faults around the controller."""
    p = guard.parameters
    parts.groups.add("guard")
    parts.constants["INDIVIDUAL_BLADES"] = 1
    names = ("speed_tolerance", "moment_jump", "frozen_time", "vane_jump", "pitch_tolerance", "pitch_time", "fade_time",
             "efficiency", "least_torque")  # fmt: skip
    parts.values |= {f"guard_{name}": getattr(p, name) for name in names}
    if "supervisor" in parts.groups:
        parts.groups.add("guard_stop")
        parts.values["guard_stop_deviation"] = p.stop_deviation
    parts.reads["GUARD"] = {
        "pitch", "out_of_plane", "in_plane", "rotor_speed", "generator_speed", "generator_torque", "power", "yaw_error",
        "wind", "azimuth",
    }  # fmt: skip


def _yaw(parts: Parts, addition: YawByDeadBand) -> None:
    parts.additions.append("YAW")
    parts.groups.add("yaw")
    parts.values |= {
        "yaw_rate": addition.rate,
        "yaw_dead_band": addition.dead_band,
        "yaw_stop": addition.stop,
        "yaw_slow_time": addition._slow.time_constant,
        "yaw_fast_time": addition._fast.time_constant,
    }
    parts.reads["YAW"] = {"yaw_error"}
