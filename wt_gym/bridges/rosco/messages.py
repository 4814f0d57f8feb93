"""The messages of ROSCO's ZeroMQ interface (``ZMQ_Mode`` 1), as of its version 2.10.

A turbine sends its readings as numbers in text, separated by commas, with a null behind them, and waits for the set
points in the same form. Order and units follow ROSCO's ``ZeroMQInterface.f90``, ``ReadSetParameters.f90`` and
``wfc_interface.yaml`` (github.com/NREL/ROSCO); numbers come with seven digits.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass

from wt_gym.base.errors import WtGymError

__all__ = [
    "FIRST_CALL", "LAST_CALL", "MOST_BLADES", "READINGS", "SET_POINTS", "Field", "Message", "MessageError", "SetPoints",
    "read_message", "write_set_points",
]  # fmt: skip

FIRST_CALL, LAST_CALL = 0, -1
"""Status of the first message of a simulation and of the last one."""
MOST_BLADES = 3


class MessageError(WtGymError, ValueError):
    """A message is not one of ROSCO's."""


@dataclass(frozen=True)
class Field:
    """One number of a message.

    Attributes
    ----------
    name : str
        Of ROSCO's registry.
    unit : str
    meaning : str
    neutral : float
        Of a set point: the value with which ROSCO acts alone.
    """

    name: str
    unit: str
    meaning: str
    neutral: float = math.nan


READINGS = (
    Field("ZMQ_ID", "-", "number of the turbine, 0 to 9999"),
    Field("iStatus", "-", "0 first call, 1 later calls, -1 last call"),
    Field("Time", "s", "time"),
    Field("VS_MechGenPwr", "W", "shaft power"),
    Field("VS_GenPwr", "W", "electrical power"),
    Field("GenSpeed", "rad/s", "generator speed"),
    Field("RotSpeed", "rad/s", "rotor speed"),
    Field("GenTqMeas", "N m", "generator torque"),
    Field("NacHeading", "deg", "nacelle yaw"),
    Field("NacVane", "deg", "wind direction minus nacelle yaw"),
    Field("HorWindV", "m/s", "horizontal wind speed at the hub"),
    Field("rootMOOP(1)", "N m", "out-of-plane root moment, blade 1"),
    Field("rootMOOP(2)", "N m", "out-of-plane root moment, blade 2"),
    Field("rootMOOP(3)", "N m", "out-of-plane root moment, blade 3"),
    Field("FA_Acc_TT", "m/s²", "tower-top acceleration, fore-aft"),
    Field("NacIMU_FA_RAcc", "rad/s²", "angular acceleration of the nacelle, fore-aft"),
    Field("Azimuth", "rad", "azimuth of blade 1"),
)
SET_POINTS = (
    Field("ZMQ_TorqueOffset", "N m", "torque offset; ROSCO 2.10 takes it and does not apply it", 0.0),
    Field("ZMQ_YawOffset", "deg", "offset of the yaw error that ROSCO's yaw control aims at", 0.0),
    Field("ZMQ_PitOffset(1)", "rad", "offset on the pitch demand, blade 1", 0.0),
    Field("ZMQ_PitOffset(2)", "rad", "offset on the pitch demand, blade 2", 0.0),
    Field("ZMQ_PitOffset(3)", "rad", "offset on the pitch demand, blade 3", 0.0),
    Field("ZMQ_R_Speed", "-", "factor on the rated speed, with PRC_Mode 2 and PRC_Comm 2", 1.0),
    Field("ZMQ_R_Torque", "-", "factor on the rated torque, likewise", 1.0),
    Field("ZMQ_R_Pitch", "-", "power rating by the fine pitch, likewise", 1.0),
)
_GREATEST_ID = 9999


@dataclass(frozen=True)
class Message:
    """Readings of a turbine at an instant, in SI units and radians.

    Attributes
    ----------
    turbine_id : int
    status : int
    time : float
        [s]
    shaft_power, generator_power : float
        [W]
    generator_speed, rotor_speed : float
        [rad/s]
    generator_torque : float
        [N m]
    yaw, yaw_error : float
        Of the nacelle, and wind direction minus it [rad].
    wind_speed : float
        [m/s]
    out_of_plane_moments : tuple of float
        Of three blades [N m].
    acceleration_fore_aft : float
        [m/s²]
    angular_acceleration : float
        [rad/s²]
    azimuth : float
        [rad]
    """

    turbine_id: int
    status: int
    time: float
    shaft_power: float
    generator_power: float
    generator_speed: float
    rotor_speed: float
    generator_torque: float
    yaw: float
    yaw_error: float
    wind_speed: float
    out_of_plane_moments: tuple[float, float, float]
    acceleration_fore_aft: float
    angular_acceleration: float
    azimuth: float


@dataclass(frozen=True)
class SetPoints:
    """What a turbine is asked for; by default ROSCO acts alone.

    Attributes
    ----------
    torque_offset : float
        [N m]; ROSCO 2.10 does not apply it.
    yaw_offset : float
        [rad]
    pitch_offset_1, pitch_offset_2, pitch_offset_3 : float
        [rad]
    speed_rating, torque_rating, pitch_rating : float
        [-]
    """

    torque_offset: float = 0.0
    yaw_offset: float = 0.0
    pitch_offset_1: float = 0.0
    pitch_offset_2: float = 0.0
    pitch_offset_3: float = 0.0
    speed_rating: float = 1.0
    torque_rating: float = 1.0
    pitch_rating: float = 1.0


def read_numbers(message: bytes) -> list[float]:
    """Numbers of a message in the order of `READINGS` and in ROSCO's units; what is left out is not a number.

    Raises
    ------
    MessageError
        If it is not text, holds anything but numbers, or not as many as ROSCO sends.
    """
    text = message.partition(b"\0")[0].decode("ascii", errors="replace")
    words = [word.strip() for word in text.split(",")]
    if len(words) != len(READINGS):
        raise MessageError(f"a message must have {len(READINGS)} numbers, got {len(words)}: {text[:200]!r}")
    values = []
    for field, word in zip(READINGS, words, strict=True):
        try:
            values.append(float(word or "nan"))
        except ValueError:
            raise MessageError(f"{field.name} must be a number, got {word[:30]!r}") from None
    return values


def read_message(message: bytes) -> Message:
    """Read what a turbine sends.

    Parameters
    ----------
    message : bytes

    Returns
    -------
    Message
        A reading that is left out or no number is nan.

    Raises
    ------
    MessageError
        If it is not one of ROSCO's, or has no number of a turbine, no status or no time.
    """
    values = read_numbers(message)
    given, status, time = values[:3]
    if not (given.is_integer() and 0 <= given <= _GREATEST_ID):
        raise MessageError(f"ZMQ_ID must be a whole number from 0 to {_GREATEST_ID}, got {given!r}")
    if not status.is_integer():
        raise MessageError(f"iStatus must be a whole number, got {status!r}")
    if not math.isfinite(time):
        raise MessageError(f"Time must be finite, got {time!r}")
    first, second, third = values[11:14]
    return Message(
        turbine_id=int(given), status=int(status), time=time, shaft_power=values[3], generator_power=values[4],
        generator_speed=values[5], rotor_speed=values[6], generator_torque=values[7], yaw=math.radians(values[8]),
        yaw_error=math.radians(values[9]), wind_speed=values[10], out_of_plane_moments=(first, second, third),
        acceleration_fore_aft=values[14], angular_acceleration=values[15], azimuth=values[16],
    )  # fmt: skip


def write_set_points(points: SetPoints) -> bytes:
    """Write what a turbine is to get.

    ROSCO's client does not end the text itself, so the message ends with a null; it has room for 357 characters.

    Raises
    ------
    ValueError
        If a set point is not finite.
    """
    values = list(astuple(points))
    if not all(map(math.isfinite, values)):
        raise ValueError(f"set points must be finite, got {points}")
    values[1] = math.degrees(values[1])
    return ",".join(format(value, ".15g") for value in values).encode("ascii") + b"\0"
