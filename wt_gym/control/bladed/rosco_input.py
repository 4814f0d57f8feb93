"""Input files for ROSCO from the data of any turbine.

The gains are those of the turbine's own controller where its data publish them, else those of the rules of
`wt_gym.control.controllers`; ROSCO's signs are the other way round (its errors are reference minus measurement). The
performance table comes from blade elements (`wt_gym.control.rotor`). The extended Kalman filter that estimates the wind
wants the pole of the rotor speed at each wind, ``A(v) = (∂Q/∂Ω)/J`` at the operating point (Abbas et al. 2022,
section 3.5); here it is a central difference of the same coefficients.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.base.files import write_text_whole
from wt_gym.control.controllers.discon import BaselineParameters
from wt_gym.control.controllers.rotor_rules import slower_than_reference
from wt_gym.control.controllers.tsr_tracking import TsrTrackingParameters
from wt_gym.control.operating_point import operating_point, rotor_inertia, torque_curve, tracks_tip_speed_ratio
from wt_gym.control.rotor import rotor_of
from wt_gym.control.rotor_table import RotorTable

if TYPE_CHECKING:
    from collections.abc import Iterable

    from wt_gym.turbines import Turbine

__all__ = ["performance_table", "start_stop_values", "value_text", "write_rosco_input"]

PERFORMANCE_FILE = "Cp_Ct_Cq.txt"
_PITCH = np.radians(np.arange(-5.0, 41.0, 1.0))
_RATIOS = np.concatenate([np.arange(1.0, 6.0, 0.5), np.arange(6.0, 11.0, 0.25), np.arange(11.0, 17.1, 0.5)])
_GAIN_POINTS = 30
_WIND, _SMOOTHING = 0.20944, 0.62830
"""Corner frequencies of a rotor of 12.1 rpm, of ROSCO's input for the NREL 5-MW [rad/s]."""
_WAIT, _FREE_WHEELING, _LOADS, _RAMPS, _HOLDS = 120.0, 200.0, (0.2, 1.0), (100.0, 100.0), (200.0, 100.0)
"""Start-up by default (``toolbox_schema.yaml`` of ROSCO): durations [s] and shares of the load."""
_CORNER = 0.41888
"""Corner frequency of the filters of start-up and shut-down there [rad/s]."""
_FILTER = 300.0
"""Time constant of the filter of the pitch that stops the turbine [s]: `Supervisor` has the same for the wind."""
_LEFT = 4.0
"""Time constants after which a filter has forgotten where it began: 2 % are left."""
_SMALL = 1e-3
"""Step of the central difference over the rotor speed."""


def write_rosco_input(turbine: Turbine, path: Path) -> None:
    """Write an input file, and beside it the performance table (`PERFORMANCE_FILE`).

    Tip-speed-ratio tracking with a Kalman filter, constant power above rated if the turbine's own controller holds it,
    set-point smoothing, a least pitch over the wind; individual pitch, dampers and yaw are off.

    Parameters
    ----------
    turbine : Turbine
    path : pathlib.Path
    """
    table = _coefficients(turbine)
    write_text_whole(path.with_name(PERFORMANCE_FILE), performance_table(table))
    rows = [f"{value_text(value)}  ! {key}" for key, value in _parameters(turbine, table).items()]
    write_text_whole(path, "\n".join([f"! ROSCO input file for {turbine.name}", *rows]) + "\n")


def start_stop_values(turbine: Turbine, time_scale: float = 1.0) -> dict[str, object]:
    """Values of ROSCO's start-up and shut-down (inputs SU_* and SD_*), by the rules of its tuning tools.

    The start-up of a parked turbine: a wait with the blades where they are, free-wheeling of the unloaded rotor at its
    least speed, a fifth of the load, all of it. The shut-down is triggered by the pitch behind a low-pass filter, above
    the steady one in the cut-out wind, or by a generator speed of 1.2 times rated; then pitch and torque go at constant
    rates, and nothing ends it. It watches only after the pitch of the parked blades has left the filter.

    Parameters
    ----------
    turbine : Turbine
    time_scale : float
        Factor on the durations of the start-up, which are ROSCO's own, and on the time constant of the filter of the
        pitch, half of the ten minutes of a mean wind: winds that are compressed in time need less than 1 [-].
    """
    drive, rated = turbine.drivetrain, BaselineParameters.from_turbine(turbine).reference_speed
    time_constant = _FILTER * time_scale
    wait, feather = _WAIT * time_scale, min(turbine.pitch.max_pitch, 0.5 * math.pi)
    least = max(torque_curve(turbine).cut_in_speed / drive.gear_ratio, drive.min_rotor_speed)
    return {
        "SU_StartTime": wait, "SU_FW_MinDuration": _FREE_WHEELING * time_scale, "SU_RotorSpeedThresh": least,
        "SU_RotorSpeedCornerFreq": _CORNER, "SU_LoadStages_N": len(_LOADS), "SU_LoadStages": _LOADS,
        "SU_LoadRampDuration": tuple(time_scale * time for time in _RAMPS),
        "SU_LoadHoldDuration": tuple(time_scale * time for time in _HOLDS),
        "SD_TimeActivate": wait + feather / turbine.pitch.max_rate + _LEFT * time_constant,
        "SD_EnablePitch": 1, "SD_EnableYawError": 0, "SD_EnableGenSpeed": 1, "SD_EnableTime": 0,
        "SD_MaxPit": operating_point(turbine, turbine.cut_out).pitch, "SD_PitchCornerFreq": 1.0 / time_constant,
        "SD_MaxYawError": 30.0, "SD_YawErrorCornerFreq": _CORNER, "SD_MaxGenSpd": 1.2 * rated,
        "SD_GenSpdCornerFreq": _CORNER, "SD_Time": 9999.0, "SD_Method": 1, "SD_Stage_N": 1, "SD_StageTime": 1000.0,
        "SD_StagePitch": feather, "SD_MaxTorqueRate": 0.05 * drive.max_torque_rate,
        "SD_MaxPitchRate": 0.125 * turbine.pitch.max_rate,
    }  # fmt: skip


def _coefficients(turbine: Turbine) -> RotorTable:
    rotor = rotor_of(turbine)
    power, thrust = rotor.coefficients(_RATIOS, _PITCH)
    return RotorTable(
        turbine.name, rotor.radius, turbine.air_density, _RATIOS, _PITCH, power, thrust, made_by="blade elements"
    )


def performance_table(table: RotorTable) -> str:
    """Text of a performance table: coefficients of power, thrust and torque over pitch and tip-speed ratio."""
    torque = table.power / table.tip_speed_ratio[:, np.newaxis]
    text = [
        f"# Rotor performance tables for {table.turbine}", "# by blade elements", "",
        f"# Pitch angle vector, {table.pitch.size} entries - x axis (matrix columns) (deg)",
        _row(np.degrees(table.pitch), 3),
        f"# TSR vector, {table.tip_speed_ratio.size} entries - y axis (matrix rows) (-)",
        _row(table.tip_speed_ratio, 3),
        "# Wind speed vector - z axis (m/s)", _row([10.0], 3), "",
    ]  # fmt: skip
    for title, values in (("Power", table.power), ("Thrust", table.thrust), ("Torque", torque)):
        text += [f"# {title} coefficient", "", *(_row(row, 6) for row in values), "", ""]
    return "\n".join(text)


def _parameters(turbine: Turbine, table: RotorTable) -> dict[str, object]:
    """Values of the input file by their names."""
    base = BaselineParameters.from_turbine(turbine)
    made = TsrTrackingParameters
    tracking = (
        made.published(turbine, base) if tracks_tip_speed_ratio(turbine) else made.from_turbine(turbine, baseline=base)
    )
    drive, gear = turbine.drivetrain, turbine.drivetrain.gear_ratio
    law, least = base.pitch_law, float(np.min(tracking.schedule_pitch))
    angles = (
        law.table.pitch if law.table is not None else np.linspace(base.min_pitch, base.min_pitch + 0.45, _GAIN_POINTS)
    )
    gains = np.array([law.gains(float(angle)) for angle in angles])
    wind = tracking.schedule_wind
    notch, slower = base.notch_frequency, slower_than_reference(turbine)
    return {
        "LoggingLevel": 0, "Echo": 0, "DT_Out": 0, "Ext_Interface": 1,
        "F_LPFType": 2 if base.filter_damping > 0.0 else 1, "IPC_ControlMode": 0, "VS_ControlMode": 2,
        "VS_ConstPower": int(base.constant_power), "VS_FBP": 0, "PC_ControlMode": 1, "Y_ControlMode": 0, "SS_Mode": 1,
        "PRC_Mode": 0, "WE_Mode": 2, "PS_Mode": 1, "SU_Mode": 0, "SD_Mode": 0, "FL_Mode": 0, "TD_Mode": 0,
        "TRA_Mode": 0, "Flp_Mode": 0, "OL_Mode": 0, "PA_Mode": 0, "PF_Mode": 0, "AWC_Mode": 0, "Ext_Mode": 0,
        "ZMQ_Mode": 0, "CC_Mode": 0, "StC_Mode": 0,
        "F_LPFCornerFreq": base.corner_frequency, "F_LPFDamping": base.filter_damping,
        "F_NumNotchFilts": int(notch > 0.0), "F_NotchFreqs": notch, "F_NotchBetaNum": 0.0, "F_NotchBetaDen": 0.25,
        "F_GenSpdNotch_N": int(notch > 0.0), "F_GenSpdNotch_Ind": int(notch > 0.0), "F_TwrTopNotch_N": 0,
        "F_TwrTopNotch_Ind": 0,
        "F_SSCornerFreq": _SMOOTHING / slower, "F_WECornerFreq": _WIND / slower, "F_YawErr": 0.18,
        "F_FlCornerFreq": (0.0, 1.0), "F_FlHighPassFreq": 0.01, "F_FlpCornerFreq": (0.0, 1.0),
        "F_VSRefSpdCornerFreq": _WIND / slower,
        "PC_GS_n": len(gains), "PC_GS_angles": angles, "PC_GS_KP": -gains[:, 0], "PC_GS_KI": -gains[:, 1],
        "PC_GS_KD": np.zeros(len(gains)), "PC_GS_TF": np.zeros(len(gains)),
        "PC_MaxPit": base.max_pitch, "PC_MinPit": least, "PC_MaxRat": base.max_pitch_rate,
        "PC_MinRat": -base.max_pitch_rate, "PC_RefSpd": base.reference_speed, "PC_FinePit": least,
        "PC_Switch": math.radians(1.0),
        "VS_GenEff": 100.0 * drive.generator_efficiency, "VS_MaxRat": base.max_torque_rate,
        "VS_MaxTq": base.max_torque, "VS_MinTq": 0.0, "VS_ArSatTq": tracking.rated_torque,
        "VS_MinOMSpd": tracking.min_speed, "VS_Rgn2K": base.torque.region_2_gain, "VS_RtPwr": drive.rated_power,
        "VS_RtTq": tracking.rated_torque, "VS_RefSpd": base.reference_speed, "VS_n": 1,
        "VS_KP": -tracking.torque_gain, "VS_KI": -tracking.torque_integral_gain,
        "VS_TSRopt": tracking.speed_per_wind * table.radius / gear,
        "SS_VSGain": 1.0, "SS_PCGain": 0.001,
        "WE_BladeRadius": table.radius, "WE_Gamma": 0.0, "WE_GearboxRatio": gear, "WE_Jtot": rotor_inertia(turbine),
        "WE_RhoAir": turbine.air_density, "PerfFileName": f'"{PERFORMANCE_FILE}"',
        "PerfTableSize": (table.pitch.size, table.tip_speed_ratio.size),
        "WE_FOPoles_N": wind.size, "WE_FOPoles_v": wind, "WE_FOPoles": _poles(turbine, table, wind),
        "PS_BldPitchMin_N": wind.size, "PS_WindSpeeds": wind, "PS_BldPitchMin": tracking.schedule_pitch,
        "Ind_Breakpoint": 0, "Ind_BldPitch": (0, 0, 0), "Ind_GenTq": 0, "Ind_YawRate": 0,
    }  # fmt: skip


def _poles(turbine: Turbine, table: RotorTable, winds: np.ndarray) -> np.ndarray:
    """Poles of the rotor speed at constant pitch and torque, shape (n,) [1/s]."""
    inertia, poles = rotor_inertia(turbine), []
    for wind in winds.tolist():
        point = operating_point(turbine, wind)
        step = _SMALL * point.rotor_speed
        above, below = (table.torque(wind, point.rotor_speed + change, point.pitch) for change in (step, -step))
        poles.append((above - below) / (2.0 * step) / inertia)
    return np.array(poles)


def _row(values: Iterable[float], digits: int) -> str:
    return "   ".join(f"{value:.{digits}f}" for value in values)


def value_text(value: object) -> str:
    """A value as ROSCO reads it."""
    if isinstance(value, np.ndarray | tuple):
        return " ".join(map(value_text, np.asarray(value).tolist()))
    return f"{value:.8g}" if isinstance(value, float) else str(value)
