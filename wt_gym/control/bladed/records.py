"""The records of the Bladed interface: what a simulation and a controller library exchange in the array ``avrSWAP``.

Record numbers count from 1, as in the Bladed documentation (DNV, Bladed User Manual, appendix A, "Communication between
Bladed and external controllers") and in OpenFAST's ServoDyn (``BladedInterface.f90``). All values are single precision,
in SI units and radians.

Root moments belong to the axes of the coned blade that does not pitch (OpenFAST's RootMyc and RootMxc), while the
channels `root_flap_moment` and `root_edge_moment` belong to the pitched blade. With the pitch angle θ of a blade

``My_c = M_flap cos θ − M_edge sin θ``,   ``Mx_c = M_flap sin θ + M_edge cos θ``.

Tower-top accelerations belong to the axes of the tower top, which do not yaw with the nacelle (OpenFAST's YawBrTAxp and
YawBrTAyp), while the channels are along the axes of the nacelle. With the yaw ψ of record 37

``a_x = a_fore-aft cos ψ − a_side-side sin ψ``,   ``a_y = a_fore-aft sin ψ + a_side-side cos ψ``.

A lidar has the records from 2001 on (OpenFAST's ``BladedInterface_EX.f90``): its kind, beams and gates, then for n =
beams times gates points all speeds, all x, all y and all z of the points.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wt_gym.base.files import read_rows
from wt_gym.base.quantities import MOTIONS
from wt_gym.control.actions import Demand
from wt_gym.control.controllers.controller import Readings, demanded_power_of
from wt_gym.control.sensors import Lidar
from wt_gym.turbines import Turbine

SIZE = 3500
"""Length of ``avrSWAP``; OpenFAST's extended interface uses records up to 3300."""
MAX_BLADES = 3
"""Blades that the interface has records for."""
FIRST_CALL, STEP, LAST_CALL = 0, 1, -1
"""Status of a call, record 1."""
LIDAR_SENSOR, LIDAR_SPEEDS, MOST_LIDAR_POINTS = 2001, 2005, 124
"""Record of the kind of a lidar, that of its first speed, and most points that the records up to 2500 have room for."""
_PULSED = 3.0
MESSAGE_LENGTH = 1025
"""Characters of the message that a library may return, with the final null."""


@dataclass(frozen=True)
class Record:
    """One record."""

    numbers: tuple[int, ...]  #: from 1; one per blade where the record is given per blade
    unit: str
    given_by: str
    """"simulation" in each call, "controller", "turbine": the simulation once from its data, "lidar": the simulation in
    each call where the controller has one."""
    meaning: str


RECORDS = tuple(
    Record(tuple(map(int, row.pop("numbers").split())), **row)
    for row in read_rows(Path(__file__).with_name("records.csv"))
)
"""Records that are exchanged; every other one is zero."""

AZIMUTH = 60 - 1
"""Index of the azimuth, the one reading that wraps."""
_PITCH, _OUT_OF_PLANE, _IN_PLANE = (4, 33, 34), (30, 31, 32), (69, 70, 71)
_SINGLE = (
    (20, "generator_speed"), (21, "rotor_speed"), (15, "generator_power"), (23, "generator_torque"),
    (24, "yaw_error"), (37, "yaw"), (60, "azimuth"), (109, "shaft_torque"), (110, "rotor_thrust"),
)  # fmt: skip
"""Records that are a channel as it is."""
_ACCELERATIONS = ("nacelle_acceleration_fore_aft", "nacelle_acceleration_side_side")


PLATFORM_CHANNELS = tuple(f"platform_{motion}{of}" for of in ("", "_rate", "_acceleration") for motion in MOTIONS)
"""Channels of the records from 1001 on."""


def channels_read(n_blades: int, lidar: Lidar | None = None, floats: bool = False) -> tuple[str, ...]:
    """Channels behind the readings of a turbine with so many blades, of a lidar, and of a platform."""
    per_blade = ("pitch", "root_flap_moment", "root_edge_moment")
    blades = [f"{name}_{b}" for name in per_blade for b in range(1, n_blades + 1)]
    seen = (*(() if lidar is None else lidar.names), *(PLATFORM_CHANNELS if floats else ()))
    return ("time", "wind_x", "wind_y", *_ACCELERATIONS, *(name for _, name in _SINGLE), *blades, *seen)


def lidar_indices(lidar: Lidar | None) -> np.ndarray:
    """Indices of the records of a lidar; none without one."""
    first = LIDAR_SENSOR - 1
    return np.arange(first, first if lidar is None else LIDAR_SPEEDS - 1 + 4 * lidar.n_readings)


def check_points(lidar: Lidar, where: str) -> None:
    """Refuse a lidar with more points than there are records for, with words for where it is read."""
    if lidar.n_readings > MOST_LIDAR_POINTS:
        what = "beams over all gates" if lidar.apart else "gates"
        raise ValueError(f"a lidar {where} must have at most {MOST_LIDAR_POINTS} {what}, got {lidar.n_readings}")


def new_swap() -> np.ndarray:
    """Give an empty array, shape (`SIZE`,), float32."""
    return np.zeros(SIZE, dtype=np.float32)


def write_turbine(swap: np.ndarray, turbine: Turbine, individual_pitch: bool, strings: Sequence[str]) -> None:
    """Write what does not change, with the input file name and the output name that the calls get."""
    drive, pitch, own = turbine.drivetrain, turbine.pitch, turbine.control
    gear = drive.gear_ratio
    rated = drive.rated_rotor_speed * gear
    fine = own.fine_pitch if own is not None and own.fine_pitch is not None else pitch.min_pitch
    gain = own.region_2_gain if own is not None and own.region_2_gain is not None else 0.0
    efficiency = drive.gearbox_efficiency * drive.generator_efficiency
    values = {
        5: fine, 6: pitch.min_pitch, 7: pitch.max_pitch, 8: -pitch.max_rate, 9: pitch.max_rate, 10: 0.0, 16: gain,
        17: drive.min_rotor_speed * gear, 18: rated, 19: rated,
        22: drive.rated_power / efficiency / rated * drive.gearbox_efficiency,
        28: float(individual_pitch), 29: 0.0, 35: 1.0, 49: MESSAGE_LENGTH,
        50: len(strings[0].encode()) + 1, 51: len(strings[1].encode()) + 1, 61: turbine.n_blades,
        62: 300, 63: 163, 64: 12001, 95: turbine.air_density, 129: swap.size,
    }  # fmt: skip
    for number, value in values.items():
        swap[number - 1] = value


def write_platform(swap: np.ndarray, signals: Readings) -> None:
    """Write the motion of a platform; the nacelle turns with it, as if the tower did not bend."""
    first, yaw = 1001 - 1, signals["yaw"]
    motion = [signals[name] for name in PLATFORM_CHANNELS]
    swap[first : first + len(motion)] = motion
    swap[37 - 1] = yaw + signals["platform_yaw"]
    roll, pitch, turn = motion[-3:]
    c, s = math.cos(yaw), math.sin(yaw)
    swap[82 - 1 : 84] = c * roll + s * pitch, c * pitch - s * roll, turn


def write_readings(swap: np.ndarray, signals: Readings, n_blades: int) -> None:
    """Write the readings of an instant (channels of `channels_read`), without status, time and interval."""
    for number, name in _SINGLE:
        swap[number - 1] = signals[name]
    demanded = demanded_power_of(signals)
    swap[13 - 1] = 0.0 if demanded is None else demanded
    swap[14 - 1] = signals["shaft_torque"] * signals["rotor_speed"]
    yaw, fore_aft, side_side = (signals[name] for name in ("yaw", *_ACCELERATIONS))
    swap[53 - 1] = fore_aft * math.cos(yaw) - side_side * math.sin(yaw)
    swap[54 - 1] = fore_aft * math.sin(yaw) + side_side * math.cos(yaw)
    swap[27 - 1] = math.hypot(signals["wind_x"], signals["wind_y"])
    for b in range(n_blades):
        pitch, flap, edge = (signals[f"{name}_{b + 1}"] for name in ("pitch", "root_flap_moment", "root_edge_moment"))
        c, s = math.cos(pitch), math.sin(pitch)
        swap[_PITCH[b] - 1] = pitch
        swap[_OUT_OF_PLANE[b] - 1] = flap * c - edge * s
        swap[_IN_PLANE[b] - 1] = flap * s + edge * c


def write_lidar(
    swap: np.ndarray, signals: Readings, lidar: Lidar, hub_height: float, rotation: str = "clockwise"
) -> None:
    """Write the readings of a lidar: one beam along the axis with a gate at each range, or each beam apart.

    The hub height is in m; beams apart are counted by the rotation of the rotor, "clockwise" or "counter-clockwise".
    """
    n, yaw, first = lidar.n_readings, signals["yaw"], LIDAR_SPEEDS - 1
    beams = lidar.n_beams if lidar.apart else 1
    swap[LIDAR_SENSOR - 1 : first] = _PULSED, beams, len(lidar.ranges), 0.0
    swap[first : first + n] = [signals[name] for name in lidar.names]
    if lidar.apart:
        places = lidar.places(yaw, hub_height, rotation).reshape(n, 3).T
    else:
        ahead = np.asarray(lidar.ranges)
        places = np.stack([-ahead * math.cos(yaw), -ahead * math.sin(yaw), np.full(n, hub_height)])
    swap[first + n : first + 4 * n] = np.concatenate(places)


def write_demand(swap: np.ndarray, demand: Demand) -> None:
    """Write a demand where a library reads and writes its own: what holds until it writes another one."""
    for b, angle in enumerate(np.asarray(demand.pitch).tolist()):
        swap[42 - 1 + b] = angle
    swap[45 - 1] = float(np.mean(demand.pitch))
    swap[47 - 1], swap[48 - 1] = demand.generator_torque, demand.yaw_rate


def demand_of(swap: np.ndarray, n_blades: int, individual_pitch: bool) -> tuple[np.ndarray, float, float]:
    """Demand that a library wrote: pitch (n_blades,) [rad], yaw rate [rad/s] and generator torque [N m]."""
    if individual_pitch:
        pitch = swap[42 - 1 : 42 - 1 + n_blades].astype(np.float64)
    else:
        pitch = np.full(n_blades, float(swap[45 - 1]))
    return pitch, float(swap[48 - 1]), float(swap[47 - 1])
