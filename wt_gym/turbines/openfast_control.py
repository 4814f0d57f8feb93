"""Rating and controller of an OpenFAST model, and the table of steady states that comes with one.

Rating and controller stand in ROSCO's DISCON.IN or are those of ServoDyn's generator model. OpenFAST has no format for
tables of power, thrust, speed and pitch over the wind. Public models bring text files with one line of column names, as
CCBlade, WISDEM and WEIS write them: names with units, or none, between commas or tabs. `find_steady_table` looks for
such a file beside a model and takes it where its largest power is the rated power of the turbine.
"""

import logging
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wt_gym.base.errors import TurbineDefinitionError
from wt_gym.base.files import read_toml
from wt_gym.base.quantities import Array
from wt_gym.turbines.checks import check_number
from wt_gym.turbines.model import ControlData
from wt_gym.turbines.openfast_text import Model, TextFile, as_number

_log = logging.getLogger(__name__)
_RPM = np.pi / 30.0
_TIP_SPEEDS = 10.0, 250.0
"""Tip speeds of rated operation [m/s]; others come from placeholders and from laws without region 2."""
_BLADED, _SIMPLE = 5, 1
"""Values of VSContrl: a library as Bladed takes it, ServoDyn's own torque law."""
_SMOOTHER_PITCH = 0.524
"""Pitch over which the gain SS_VSGain of ROSCO's set-point smoother shifts the speed by rated speed [rad]."""


@dataclass(frozen=True)
class Rating:
    """Rated operation."""

    power: float
    """Electrical [W]."""
    rotor_speed: float
    """[rad/s]."""
    gear_ratio: float
    generator_efficiency: float

    @property
    def mechanical_power(self) -> float:
        """Power on the high-speed shaft [W]."""
        return self.power / self.generator_efficiency


def read_rating(model: Model, rated_power: float | None, rated_rotor_speed: float | None) -> Rating:
    """Return rated operation, as far as it is not given from outside [W], [rad/s].

    The model says it where ROSCO's DISCON.IN (VSContrl 5) or ServoDyn's own law (VSContrl 1) controls the torque. With
    the latter, a pitch controller of ROSCO (PCMode 5) holds its own speed.
    """
    elastodyn, servodyn, torque, pitch = model.elastodyn, model.servodyn, model.torque, model.pitch
    ratio = elastodyn.number("GBRatio")
    if ratio <= 0.0:
        raise elastodyn.fail("GBRatio", ratio, "a number above 0")
    if torque is not None and "VS_GenEff" in torque:
        efficiency = torque.number("VS_GenEff") / 100.0
    else:
        efficiency = model.number(servodyn, "GenEff", 100.0, "a generator without losses") / 100.0
    power, speed, reason = None, None, _no_rating(servodyn)
    if torque is not None:
        power = torque.number("VS_RtPwr")
        speed = torque.number("PC_RefSpd" if "PC_RefSpd" in torque else "VS_RefSpd") / ratio
    elif servodyn is not None and servodyn.integer("VSContrl", 0) == _SIMPLE:
        rated = servodyn.number("VS_RtGnSp") * _RPM
        if pitch is not None and "PC_RefSpd" in pitch:
            rated = pitch.number("PC_RefSpd")
        tip_speed = rated / ratio * elastodyn.number("TipRad")
        if _TIP_SPEEDS[0] <= tip_speed <= _TIP_SPEEDS[1]:
            power, speed = servodyn.number("VS_RtTq") * rated * efficiency, rated / ratio
        else:
            reason = (
                f"{servodyn.path.name}: VS_RtGnSp {servodyn.number('VS_RtGnSp'):g} rpm is not a rated speed (tips at "
                f"{tip_speed:.3g} m/s), as in models for linearization, whose torque is constant"
            )
    power = power if rated_power is None else rated_power
    speed = speed if rated_rotor_speed is None else rated_rotor_speed
    if power is not None and speed is None and elastodyn.number("RotSpeed", 0.0) > 0.0:
        speed = elastodyn.number("RotSpeed") * _RPM
        model.note(
            f"rated rotor speed: not in the model, the initial {speed / _RPM:.4g} rpm (RotSpeed) is taken; give "
            "rated_rotor_speed (--rated-rotor-speed) if it is another"
        )
    if power is None or speed is None:
        missing = "rated power" if power is None else "rated rotor speed"
        raise TurbineDefinitionError(
            f"{missing}: the model has neither a DISCON.IN of ROSCO nor ServoDyn's VS_RtGnSp and VS_RtTq in force: "
            f"{reason}; give it (read_openfast, wt-gym import --rated-power and --rated-rotor-speed)"
        )
    return Rating(
        check_number("rated power [W] (VS_RtPwr, or VS_RtTq and VS_RtGnSp)", power, 1.0, 1e9),
        check_number("rated rotor speed [rad/s] (PC_RefSpd or VS_RtGnSp over GBRatio)", speed, 1e-3, 1000.0),
        ratio,
        check_number("efficiency of the generator (VS_GenEff or GenEff)", efficiency, 0.3, 1.0),
    )


def _no_rating(servodyn: TextFile | None) -> str:
    """Return why the files of ServoDyn and the controller say nothing about the rating."""
    if servodyn is None:
        return "CompServo is 0"
    mode = servodyn.integer("VSContrl", 0)
    if mode == _BLADED:
        return "VSContrl is 5, and DLL_InFile is not a DISCON.IN of ROSCO"
    return f"VSContrl is {mode}" + (", a generator without control of its speed" if mode == 0 else "")


_DISCON = (
    ("fine_pitch", "PC_FinePit"),
    ("region_2_gain", "VS_Rgn2K"),
    ("region_2_speed", "VS_MinOMSpd"),
    ("region_3_speed", "VS_RefSpd"),
    ("reference_generator_speed", "PC_RefSpd"),
    ("speed_filter_frequency", "F_LPFCornerFreq"),
)
"""Numbers that `ControlData` has as they are in DISCON.IN."""
_TORQUE_NUMBERS = (
    "region_2_gain", "region_2_speed", "region_3_speed", "optimal_tip_speed_ratio", "torque_proportional_gain",
    "torque_integral_gain", "constant_power", "region_3_min_pitch",
)  # fmt: skip
_PITCH_NUMBERS = (
    "fine_pitch", "reference_generator_speed", "gain_pitch", "pitch_proportional_gain", "pitch_integral_gain",
    "min_pitch_wind", "min_pitch", "pitch_actuator_frequency", "pitch_actuator_damping",
)  # fmt: skip
"""Numbers of DISCON.IN that act through the torque and through the pitch."""
ASIDE = read_toml(Path(__file__).with_name("openfast_aside.toml"))
"""Keywords that no turbine here holds, see the file."""


def read_openfast_control(model: Model, rating: Rating, radius: float, density: float) -> ControlData | None:
    """Return the numbers of the turbine's controller, None where the model has none.

    ROSCO's gains are negative (more pitch and torque for more speed); here they are positive.

    Parameters
    ----------
    radius : float
        Of the rotor [m].
    density : float
        Of the air [kg/m^3].
    """
    values: dict[str, Any] = {}
    servodyn, file = model.servodyn, model.torque or model.pitch
    if file is not None:
        values = _from_discon(model, file, rating, radius, density)
        for part, names in ((model.torque, _TORQUE_NUMBERS), (model.pitch, _PITCH_NUMBERS)):
            if part is None:
                values = {name: value for name, value in values.items() if name not in names}
    if servodyn is not None and servodyn.integer("VSContrl", 0) == _SIMPLE:
        slip = 0.01 * servodyn.number("VS_SlPc")
        values |= {
            "region_2_gain": servodyn.number("VS_Rgn2K") / _RPM**2,
            "air_density": density,
            "region_3_speed": servodyn.number("VS_RtGnSp") * _RPM,
            "slip": slip if slip <= 1.0 else None,
            "rated_mechanical_power": rating.mechanical_power,
            "constant_power": False,
        }
    return ControlData(**values) if values else None


def _from_discon(model: Model, file: TextFile, rating: Rating, radius: float, density: float) -> dict[str, Any]:
    values: dict[str, Any] = {"rated_mechanical_power": rating.mechanical_power, "air_density": density}
    values |= {name: file.number(key) for name, key in _DISCON if key in file}
    ratio = file.number("VS_TSRopt", 0.0)
    if ratio > 0.0:
        values["optimal_tip_speed_ratio"] = ratio
    cp = _tabulated_power_coefficient(file, values.get("fine_pitch", 0.0), ratio)
    if cp is None and ratio > 0.0 and values.get("region_2_gain", 0.0) > 0.0:
        # K = pi rho R^5 Cp/(2 lambda^3 N^3), K on the high-speed shaft behind a gearbox without losses
        cp = 2.0 * values["region_2_gain"] * (ratio * rating.gear_ratio) ** 3 / (np.pi * density * radius**5)
    if cp is not None and 0.01 <= cp <= 16.0 / 27.0:
        values["peak_power_coefficient"] = cp
    elif cp is not None:
        model.note(f"a power coefficient of {cp:.3f} at VS_TSRopt is left aside", file)
    if file.integer("F_LPFType", 1) == 2:
        values["speed_filter_damping"] = file.number("F_LPFDamping")
    values |= _torque_gains(model, file)
    if "VS_ConstPower" in file:
        values["constant_power"] = file.integer("VS_ConstPower") == 1
    else:  # before ROSCO 2.9
        values["constant_power"] = file.integer("VS_ControlMode", 0) in (1, 3)
    if "SS_Mode" in file:
        values |= _set_point_smoother(file)
    if "PC_GS_angles" in file:
        values |= _schedule(model, file)
        if "PC_GS_KD" in file and np.any(file.array("PC_GS_KD")):
            model.note("PC_GS_KD: left aside, the pitch controller has no derivative part", file)
    if file.integer("PS_Mode", 0) > 0 and "PS_WindSpeeds" in file:
        values |= {"min_pitch_wind": file.array("PS_WindSpeeds"), "min_pitch": file.array("PS_BldPitchMin")}
    if "PC_Switch" in file and "PC_FinePit" in file:
        values["region_3_min_pitch"] = file.number("PC_FinePit") + file.number("PC_Switch")
    values |= _pitch_actuator(file)
    active = [
        f"{what} ({key})" for key, what in ASIDE["discon_modes"].items() if key in file and file.number(key) != 0.0
    ]
    if active:
        model.note(f"left aside: {', '.join(active)}", file)
    if file.integer("PC_ControlMode", 1) == 0:
        model.note("PC_ControlMode 0: ROSCO holds the fine pitch; here its gains are used", file)
    return values


def _torque_gains(model: Model, file: TextFile) -> dict[str, float]:
    """Return the gains of the torque control, which ROSCO writes with either sign."""
    values = {}
    for name, key in (("torque_proportional_gain", "VS_KP"), ("torque_integral_gain", "VS_KI")):
        if key in file:
            gains = file.array(key)
            if np.any(gains < 0.0) and np.any(gains > 0.0):
                raise file.fail(key, gains.tolist(), "gains of one sign")
            values[name] = abs(float(gains[0]))
            if gains.size > 1:
                model.note(f"{key} has several gains, the first is taken", file)
    return values


def _pitch_actuator(file: TextFile) -> dict[str, float]:
    """Return corner frequency and damping of the pitch drive where ROSCO filters by one."""
    mode = file.integer("PA_Mode", 0)
    values = {"pitch_actuator_frequency": file.number("PA_CornerFreq")} if mode > 0 else {}
    return values | ({"pitch_actuator_damping": file.number("PA_Damping")} if mode == 2 else {})


def _set_point_smoother(file: TextFile) -> dict[str, float]:
    """Return the gains and the filter of the set-point smoother; without it the shifts are zero.

    ROSCO shifts by ``SS_VSGain (theta - theta_min)/0.524 - SS_PCGain (P_rated - P)/P_rated`` in rated speeds (Abbas et
    al., Wind Energ. Sci. 7 (2022) 53, section 3.4, and ROSCO's ControllerBlocks.f90).
    """
    if file.integer("SS_Mode") == 0:
        return {"speed_shift_per_pitch": 0.0, "speed_shift_per_power": 0.0}
    values = {
        "speed_shift_per_pitch": file.number("SS_VSGain") / _SMOOTHER_PITCH,
        "speed_shift_per_power": file.number("SS_PCGain"),
    }
    if "F_SSCornerFreq" in file:
        values["speed_shift_frequency"] = file.number("F_SSCornerFreq")
    return values


def _schedule(model: Model, file: TextFile) -> dict[str, Array]:
    """Return the schedule of the pitch gains up to where one of them changes its sign.

    ROSCO's tuning subtracts the rotor's own damping from the proportional gain, which at large pitch may leave one of
    the other sign.
    """
    angles = file.array("PC_GS_angles")
    gains = {"pitch_proportional_gain": -file.array("PC_GS_KP"), "pitch_integral_gain": -file.array("PC_GS_KI")}
    for name, table in gains.items():
        if table.size != angles.size:
            raise file.fail(name, f"{table.size} gains", f"as many as PC_GS_angles, {angles.size}")
    wrong = np.flatnonzero(np.any([table < 0.0 for table in gains.values()], axis=0))
    if wrong.size and wrong[0] == 0:
        raise file.fail("PC_GS_KP, PC_GS_KI", float(file.array("PC_GS_KP")[0]), "gains up to 0 (ROSCO's sign)")
    if wrong.size:
        end = int(wrong[0])
        model.note(
            f"PC_GS_KP or PC_GS_KI changes its sign at {np.degrees(angles[end]):.1f} deg pitch; the schedule ends "
            f"before, at {np.degrees(angles[end - 1]):.1f} deg", file,
        )  # fmt: skip
        angles = angles[:end]
        gains = {name: table[:end] for name, table in gains.items()}
    return {"gain_pitch": angles, **gains}


def _tabulated_power_coefficient(file: TextFile, pitch: float, tip_speed_ratio: float) -> float | None:
    """Return Cp at a pitch [rad] and tip-speed ratio from ROSCO's file of rotor performance, None without the file.

    Lines of numbers are the pitch angles [deg], the tip-speed ratios, wind speeds and then tables of Cp, Ct and Cq with
    a row for each ratio. ROSCO counts lines; what the lines between them say is free.
    """
    if "PerfFileName" not in file or tip_speed_ratio <= 0.0:
        return None
    path = file.path.parent / file.text("PerfFileName").replace("\\", "/")
    if not path.is_file():
        return None
    lines = [[as_number(word) for word in line.replace(",", " ").split()] for line in TextFile(path).lines]
    rows = [[number for number in line if number is not None] for line in lines if line and None not in line]
    if len(rows) < 3:
        raise file.fail("PerfFileName", path.name, "a file with pitch angles, tip-speed ratios and a table of Cp")
    n, m = len(rows[0]), len(rows[1])
    if "PerfTableSize" in file:
        n, m = file.array("PerfTableSize")[:2].astype(int).tolist()
    numbers = np.concatenate([np.array(row) for row in rows])
    rest = numbers.size - n - m
    if min(n, m) < 2 or rest < n * m or len(rows[0]) > n or len(rows[1]) > m or not np.all(np.isfinite(numbers)):
        raise file.fail("PerfFileName", f"{numbers.size} numbers", f"a table of Cp {m} x {n} ({path.name})")
    pitches, ratios = numbers[:n], numbers[n : n + m]
    first = n + m + rest % (n * m)
    table = numbers[first : first + n * m].reshape(m, n)
    if np.any(np.diff(pitches) <= 0.0) or np.any(np.diff(ratios) <= 0.0):
        allowed = f"ascending pitch angles and tip-speed ratios, {n} and {m} ({path.name})"
        raise file.fail("PerfFileName", [*pitches[:2].tolist(), *ratios[:2].tolist()], allowed)
    if not (ratios[0] <= tip_speed_ratio <= ratios[-1] and pitches[0] <= np.degrees(pitch) <= pitches[-1]):
        return None
    at_pitch = [float(np.interp(np.degrees(pitch), pitches, row)) for row in table]
    return float(np.interp(tip_speed_ratio, ratios, at_pitch))


# ---- tables of steady states -----------------------------------------------------------------------------------------

_COLUMNS = {
    "wind": (r"wind1velx|wind ?speed|v|u", {"m/s": 1.0, "": 1.0}),
    "power": (r"gen(erator)? ?(pwr|power)|(rotor )?electrical power", {"w": 1.0, "kw": 1e3, "mw": 1e6}),
    "rotor_speed": (r"rot(or)? ?speed|rotor rotational speed|rotor rpm", {"rpm": _RPM, "rad/s": 1.0, "": _RPM}),
    "pitch": (r"blade ?pitch|bldpitch1|pitch( angle)?", {"deg": np.pi / 180.0, "rad": 1.0}),
    "thrust": (r"(rotor|aero|aerodynamic) ?thrust|thrust", {"n": 1.0, "kn": 1e3, "mn": 1e6}),
}
"""Names of the columns, and factors of their units to SI units; the first two are needed."""
_ENDINGS = (".csv", ".dat", ".txt")
_TOLERANCE = 0.05  # Largest deviation of the largest power of a table from rated power, over rated power [-]


@dataclass(frozen=True)
class SteadyTable:
    """Steady states over the wind (n,); an array is None where the file has no such column."""

    path: Path
    wind: Array
    """Ascending [m/s]."""
    power: Array
    """Electrical [W]."""
    rotor_speed: Array | None
    """[rad/s]."""
    pitch: Array | None
    """[rad]."""
    thrust: Array | None
    """[N]."""

    def at(self, wind: float, column: str) -> float | None:
        """Value of a column in a wind [m/s]; None outside the table or without the column.

        Power is interpolated by its cube root, which is linear in the wind at a constant power coefficient.
        """
        values = getattr(self, column)
        if values is None or not self.wind[0] <= wind <= self.wind[-1]:
            return None
        if column == "power":
            return float(np.interp(wind, self.wind, np.cbrt(values)) ** 3)
        return float(np.interp(wind, self.wind, values))


def find_steady_table(model: Path, rated_power: float) -> SteadyTable | None:
    """Return the table that comes with a model, None where there is none.

    It is looked for in the folder of the model, the two folders above it, and the folders ``performance`` in these. Of
    several tables one of OpenFAST goes before others. A file that `read_steady_table` refuses is skipped with a note.

    Parameters
    ----------
    model : Path
        Primary file (``.fst``).
    rated_power : float
        Electrical [W]; the largest power of the table must be within 5 % of it.
    """
    above = [model.resolve().parent, *model.resolve().parents[1:3]]
    folders = [place for folder in above for place in (folder, folder / "performance") if place.is_dir()]
    files = [file for folder in folders for file in sorted(folder.iterdir()) if file.suffix.lower() in _ENDINGS]
    for file in sorted(files, key=lambda file: "openfast" not in file.name.lower()):  # stable: the nearest first
        try:
            table = read_steady_table(file)
        except TurbineDefinitionError as error:  # a time series has the same columns
            _log.warning("not taken as the table of steady states: %s", error)
            continue
        if table is not None and abs(table.power.max() / rated_power - 1.0) <= _TOLERANCE:
            return table
    return None


def read_steady_table(path: Path) -> SteadyTable | None:
    """Read a table, None for a file whose first line does not name the wind and the electrical power."""
    with path.open(encoding="utf-8", errors="replace") as file:
        separator, places = _places(file.readline())
        if not {"wind", "power"} <= places.keys():
            return None
        lines = [line for line in file if line.strip()]
    try:
        rows = [[float(word) for word in line.strip().split(separator)] for line in lines]
        columns = {
            name: np.array([row[place] for row in rows]) * factor if rows else np.zeros(0)
            for name, (place, factor) in places.items()
        }
    except (ValueError, IndexError) as error:
        raise TurbineDefinitionError(f"{path}: a table of steady states must have rows of numbers: {error}") from error
    if not (columns["wind"].size > 1 and np.all(np.diff(columns["wind"]) > 0.0)):
        raise TurbineDefinitionError(f"{path}: a table of steady states must have at least two winds that rise")
    return SteadyTable(path, **{name: columns.get(name) for name in _COLUMNS})  # type: ignore[arg-type]  # two are there


def _places(header: str) -> tuple[str | None, dict[str, tuple[int, float]]]:
    """Separator of a line of column names, and the places of known columns with the factors of their units."""
    separator = next((mark for mark in (",", "\t") if mark in header), None)
    places: dict[str, tuple[int, float]] = {}
    for place, word in enumerate(header.lstrip("#").strip().split(separator)):
        name, unit = _name_and_unit(word)
        for column, (pattern, units) in _COLUMNS.items():
            if column not in places and re.fullmatch(pattern, name) and unit in units:
                places[column] = place, units[unit]
    return separator, places


def _name_and_unit(word: str) -> tuple[str, str]:
    """Name of a column and its unit, in lower case: ``Generator Power [kW]``, ``RotSpeed_(rpm)``."""
    match = re.fullmatch(r"([^(\[]*)[(\[]([^)\]]*)[)\]]", word.strip().lower())
    name, unit = match.groups() if match else (word.lower(), "")
    return name.replace("_", " ").strip(), unit.strip()
