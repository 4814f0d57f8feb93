"""ROSCO, NREL's reference open-source controller, as the PyPI package ``rosco`` brings it.

N. J. Abbas, D. S. Zalkind, L. Pao and A. Wright, A reference open-source controller for fixed and floating offshore
wind turbines, Wind Energ. Sci. 7 (2022) 53. The package brings the library, and input files that were tuned for some
turbines; any other turbine gets an input file that `write_rosco_input` makes from its data.

The gains of such a file are those of the turbine's own controller where its data publish them, else those of the rules
of `wt_gym.control.controllers`; ROSCO's signs are the other way round (its errors are reference minus measurement). The
performance table comes from blade elements (`wt_gym.control.rotor`). The extended Kalman filter that estimates the wind
wants the pole of the rotor speed at each wind, ``A(v) = (∂Q/∂Ω)/J`` at the operating point (Abbas et al. 2022,
section 3.5); here it is a central difference of the same coefficients.
"""

import importlib.util
import math
import re
import sys
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from wt_gym.base.errors import ControllerError
from wt_gym.base.files import HeldFolder, write_text_whole
from wt_gym.base.options import Options, option, option_record
from wt_gym.control.actions import Demand
from wt_gym.control.bladed.controller import BladedController
from wt_gym.control.controllers.controller import Readings, demanded_power_of
from wt_gym.control.controllers.discon import BaselineParameters
from wt_gym.control.controllers.tsr_tracking import TsrTrackingParameters
from wt_gym.control.design import (
    full_power_wind,
    platform_pitch_frequency,
    rotor_inertia,
    same_rotor,
    slower_than_reference,
    trim_pitch,
)
from wt_gym.control.operating_point import operating_point, torque_curve, tracks_tip_speed_ratio
from wt_gym.control.rotor import RotorTable, rotor_of
from wt_gym.turbines import Turbine, load_turbine
from wt_gym.turbines.openfast_text import TextFile

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
        "PRC_Mode": 0, "WE_Mode": 2, "PS_Mode": 1, "SU_Mode": 0, "SD_Mode": 0, "Fl_Mode": 0, "TD_Mode": 0,
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


def _feedback_values(turbine: Turbine, mode: int) -> dict[str, object]:
    """Values of the floating feedback (Fl_*, F_Fl*), by the rules of ROSCO's tuning tools.

    The gain is minus the slope of the steady pitch over the wind just above rated, for the pitch rate (mode 2) times
    the height of the hub; the filter has its corner at the natural frequency of the platform's pitch.
    """
    wind = _FEEDBACK_WIND * full_power_wind(turbine)
    around = trim_pitch(turbine, wind * np.array([0.99, 1.01]))
    gain = -float(around[1] - around[0]) / (0.02 * wind) * (turbine.hub_height if mode == 2 else 1.0)
    corner = platform_pitch_frequency(turbine)
    return {"Fl_n": 1, "Fl_Kp": gain, "Fl_U": wind, "F_FlCornerFreq": (corner, 1.0)}


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


_FACTORS = {
    "speed": ("Ind_R_Speed", "Ind_R_Torque"),
    "torque": ("Ind_R_Torque",),
    "pitch": ("Ind_R_Pitch", "Ind_R_Torque"),
}
"""Columns of the open-loop file by the way of derating.

Where ROSCO holds the power, its factor on rated torque is that on the power. Without it a slower turbine makes up to a
tenth more than R, one with a higher fine pitch all above rated wind.
"""
_FLOATING_TUNED = {"volturnus_iea_15mw": "IEA-15-240-RWT/IEA-15-240-RWT-UMaineSemi/IEA-15-240-RWT-UMaineSemi_DISCON.IN"}
"""Those for turbines with rotor and platform of one of the catalog."""
_FEEDBACK_WIND = 1.05
"""Wind of the gain of ROSCO's floating feedback in rated wind speeds [-]."""
_COURSE, _STEP, _LONGEST = "demanded_power.dat", 0.01, 1e5
LONGEST_INTERVAL = 0.0125
"""Longest time between calls [s], the step with which ROSCO is used in OpenFAST."""


@option_record
class RoscoOptions(Options):
    """Parameters of a `RoscoController`."""

    title = "rosco"

    input_file: Path | None = option(
        "path of a DISCON.IN", default=None, unit="-",
        otherwise="the one that the package brings for the turbine, else one made from its data",
    )  # fmt: skip
    interval: float | None = option(
        "longest time between calls", default=LONGEST_INTERVAL, unit="s", low=0.0, above=True,
        otherwise="the controller's step",
    )  # fmt: skip
    derate: str | None = option(
        "what a demanded power lowers: ROSCO's factor on rated torque, and beside it that on rated speed or on the "
        "power at fine pitch", default=None, unit="-", choices=tuple(_FACTORS), otherwise="nothing",
    )  # fmt: skip
    start_stop: bool = option(
        "whether it starts a parked turbine and stops it for good where the pitch or the speed is high (SU_Mode, "
        "SD_Mode)", default=False, unit="-",
    )  # fmt: skip
    time_scale: float = option(
        "factor on ROSCO's durations of a start-up, and on the 600 s over which the pitch is averaged that stops the "
        "turbine", default=1.0, unit="-", low=0.0, above=True,
    )  # fmt: skip
    floating: int | None = option(
        "feedback of the motion of a platform, Fl_Mode: 0 none, 1 velocity of the nacelle fore-aft, 2 its pitch rate",
        default=None, unit="-", low=0, high=2, otherwise="that of the input file; 2 in one made here",
        only_of=lambda turbine: turbine.floater is not None,
    )  # fmt: skip
    isolated: bool = option("whether it runs in a process of its own", default=False, unit="-")


_TUNED = {
    "nrel_5mw": "NREL-5MW/DISCON.IN",
    "iea_15mw": "IEA-15-240-RWT/IEA-15-240-RWT-Monopile/IEA-15-240-RWT-Monopile_DISCON.IN",
}
"""Input files of the package's test cases for turbines with the rotor of one of the catalog."""


def _package() -> Path:
    """Folder of the package; refused where it is not installed."""
    spec = importlib.util.find_spec("rosco")
    if spec is None or not spec.submodule_search_locations:
        raise ControllerError(
            "the controller 'rosco' needs the package rosco: pip install 'wt_gym[rosco]' (without its tuning tools: "
            "pip install --no-deps rosco)"
        )
    return Path(next(iter(spec.submodule_search_locations)))


def rosco_library() -> Path:
    """Path of ROSCO's library.

    Raises
    ------
    wt_gym.base.errors.ControllerError
        If the package ``rosco`` is not installed, or brings no library for this machine.
    """
    folder = _package() / "lib"
    ending = {"win32": "dll", "darwin": "dylib"}.get(sys.platform, "so")
    library = folder / f"libdiscon.{ending}"
    if not library.is_file():
        raise ControllerError(f"the package rosco must bring {library.name}; there is none in {folder}")
    return library


def tuned_input(turbine: Turbine) -> Path | None:
    """Input file of the package for a turbine; None where it brings none."""
    for name, case in (_TUNED if turbine.floater is None else _FLOATING_TUNED).items():
        known = _known(name)
        if known.floater is not None and turbine.floater is not None and known.floater.name != turbine.floater.name:
            continue
        if known.rotor_diameter == turbine.rotor_diameter and same_rotor(known, turbine):
            path = _package().parent / "Examples" / "Test_Cases" / case
            return path if path.is_file() else None
    return None


_known = cache(load_turbine)


class RoscoController(BladedController):
    """ROSCO's library behind the contract of controllers.

    The library gets a copy of the input file with logging switched off and paths made absolute. A demanded power that
    is to be followed goes into an open-loop file of ROSCO's power reference control (PRC_Mode 2, PRC_Comm 1), its whole
    course, as it is known at a start. With ``start_stop`` the start-up is on only where the controller starts on a
    turbine that stands with feathered blades: on one that runs it would take the torque away. Its numbers are those of
    `start_stop_values`; in an ``input_file`` that is given its own hold.

    Parameters
    ----------
    **parameters
        Of `RoscoOptions`.

    Raises
    ------
    wt_gym.base.errors.ControllerError, FileNotFoundError
        If the package ``rosco`` is not installed; if there is no such input file.
    """

    def __init__(self, turbine: Turbine, **parameters: Any) -> None:
        o = RoscoOptions(**parameters)
        library = rosco_library()
        folder = HeldFolder("wt_gym_rosco_")
        target = folder.path / "DISCON.IN"
        source = tuned_input(turbine) if o.input_file is None else Path(o.input_file).expanduser()
        if source is None:
            write_rosco_input(turbine, target)
        elif source.is_file():
            target.write_text(quiet_input(source), encoding="utf-8")
        else:
            raise FileNotFoundError(f"there is no input file {source} of ROSCO")
        if turbine.floater is not None and (o.floating is not None or source is None):
            mode = 2 if o.floating is None else o.floating
            # the gain of the package's file belongs to the pitch rate
            has_own = o.input_file is not None or (source is not None and mode != 1)
            values = {"Fl_Mode": mode} | ({} if has_own else _feedback_values(turbine, mode))
            target.write_text(with_values(target.read_text(encoding="utf-8"), values), encoding="utf-8")
        super().__init__(turbine, library, target, interval=o.interval, isolated=o.isolated)
        self.input_folder = folder
        """Holds the input file as long as this controller or a copy of it lives."""
        self._derate, self._plain_input = o.derate, target.read_text(encoding="utf-8")
        self._start_stop: dict[str, object] | None = None
        if o.start_stop:
            self._start_stop = start_stop_values(turbine, o.time_scale) if o.input_file is None else {}

    @property
    def holds_set_point(self) -> bool:
        """Whether it holds what a `Supervisor` asks for, by readings of the speeds over their set point.

        The demand of a power and the stages of a start-up are about speeds as they are.
        """
        return self._derate is None and self._start_stop is None

    @property
    def damps_platform(self) -> bool:
        """Its floating feedback is on."""
        return TextFile(Path(self.input_file), titles=0).integer("Fl_Mode", 0) > 0

    @property
    def in_production(self) -> bool:
        """True unless it may stop the turbine: with ``start_stop`` the library does not tell its stages."""
        return self._start_stop is None

    def runs_in(self, wind: float) -> bool:
        """Whether a turbine runs in a mean wind [m/s] at a start: with ``start_stop`` from cut-in to cut-out.

        See `wt_gym.control.controllers.controller.starting_part`.
        """
        return self._start_stop is None or self.turbine.cut_in <= wind <= self.turbine.cut_out

    def start(self, signals: Readings, demand: Demand) -> None:
        """Load the library afresh, with what this start alone has in its files.

        That is the course of a demanded power if it is to follow one, and start-up and shut-down.
        """
        if self._derate is not None or self._start_stop is not None:
            self._write_input(signals, demand)
        super().start(signals, demand)

    def _write_input(self, signals: Readings, demand: Demand) -> None:
        """Write the input file of this start into a folder of its own: copies keep theirs."""
        before = Path(self.input_file).parent
        folder = HeldFolder("wt_gym_rosco_")
        made = folder.path
        for file in before.iterdir():
            (made / file.name).write_bytes(file.read_bytes())
        values: dict[str, object] = {}
        if self._derate is not None:
            values |= self._write_course(signals, made)
        if self._start_stop is not None:
            parked = self._is_parked(signals, demand)
            values |= self._start_stop | {"SU_Mode": int(parked), "SD_Mode": 1}
            if self._start_stop and not parked:
                values["SD_TimeActivate"] = 0.0
        (made / "DISCON.IN").write_text(with_values(self._plain_input, values), encoding="utf-8")
        self.input_file, self.input_folder = str(made / "DISCON.IN"), folder

    def _is_parked(self, signals: Readings, demand: Demand) -> bool:
        """Whether the rotor barely turns and the blades are feathered."""
        feather = min(self.turbine.pitch.max_pitch, 0.5 * math.pi)
        slow = signals["rotor_speed"] < 0.25 * self.turbine.drivetrain.rated_rotor_speed
        return slow and float(sum(demand.pitch)) / len(demand.pitch) > 0.5 * feather

    def _write_course(self, signals: Readings, folder: Path) -> dict[str, object]:
        """Write an open-loop file; values of the input file that have ROSCO follow it."""
        factors = _FACTORS[self._derate or ""]
        course = _course(signals, self.turbine.drivetrain.rated_power, len(factors))
        (folder / _COURSE).write_text(course, encoding="utf-8")
        values = {"PRC_Mode": 2, "PRC_Comm": 1, "OL_Mode": 1, "OL_Filename": f'"{folder / _COURSE}"'}
        columns = {name: column for column, name in enumerate(factors, start=2)}  # each wants one of its own
        return values | {"Ind_Breakpoint": 1} | columns


def _course(signals: Readings, rated_power: float, columns: int = 1) -> str:
    """Rows of time since the start [s] and, in so many columns, power over rated [-]."""
    reference = getattr(signals, "reference", None)
    if reference is None:
        demanded = demanded_power_of(signals)
        share = 1.0 if demanded is None else demanded / rated_power
        rows = [(0.0, share), (_LONGEST, share)]
    else:
        begin = signals["time"]
        points = zip(reference.times, reference.powers, strict=True)
        later = [(time - begin, power / rated_power) for time, power in points if time > begin]
        rows = [(0.0, reference.at(begin) / rated_power), *later]
        rows.append((max(_LONGEST, rows[-1][0] + 1.0), rows[-1][1]))
    lines, last = ["! time  share", "! s  -"], -math.inf
    for time, share in rows:
        last = max(time, last + _STEP)  # interpolation wants times that rise
        lines.append(f"{last:.4f}" + columns * f" {min(max(share, 0.0), 1.0):.6f}")
    return "\n".join(lines) + "\n"


def with_values(text: str, values: Mapping[str, object]) -> str:
    """Text of an input file with other values of some parameters; those that it does not have are added."""
    left, lines = dict(values), []
    for line in text.rstrip("\n").split("\n"):
        _, mark, comment = line.partition("!")
        found = re.match(r"\s*(\w+)", comment)
        if found is not None and found[1] in left:
            line = f"{value_text(left.pop(found[1]))} {mark}{comment}"
        lines.append(line)
    return "\n".join([*lines, *(f"{value_text(value)} ! {name}" for name, value in left.items())]) + "\n"


def quiet_input(source: Path) -> str:
    """Text of an input file without logging and echo, and with absolute paths of the files that it names."""
    file = TextFile(source, titles=0)
    for key in ("LoggingLevel", "Echo"):
        if key in file:
            file.lines[file.line_of(key)] = f"0 ! {key}"
    for key in ("PerfFileName", "OL_Filename"):
        path = source.parent / file.text(key).replace("\\", "/") if key in file else source.parent
        if path.is_file():
            file.lines[file.line_of(key)] = f'"{path.resolve()}" ! {key}'
    return "\n".join(file.lines) + "\n"
