"""Outputs of OpenFAST as the signals of this package: frames, signs and units of `wt_gym.simulation.channels`."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wt_gym.base.errors import SimulationError
from wt_gym.base.quantities import Array
from wt_gym.bridges.openfast.water import TENSION_OUTPUTS, WAVE_OUTPUT
from wt_gym.simulation.channels import Channel, Signals, channel_table, new_values
from wt_gym.simulation.recorder import openfast_unit
from wt_gym.simulation.step.coupling_kernels import passing_clearance, view_from_tower
from wt_gym.simulation.turbine_structure import rotation_x, rotation_y
from wt_gym.turbines import Turbine
from wt_gym.turbines.blade import rotation_about_z
from wt_gym.turbines.variants import electrical_power

_RPM, _DEGREE, _KILO = math.pi / 30.0, math.pi / 180.0, 1e3

_DERIVED = ("time", "azimuth", "generator_torque", "generator_power", "yaw_error", "tip_clearance")
"""Signals with a name in OpenFAST that are no output in another unit here."""
_TOWER_TOP = ("TTDspFA", "TTDspSS", "TTDspAx", "TTDspRoll", "TTDspPtch")
_ACCELERATION = ("YawBrTAxp", "YawBrTAyp")
_TIP_AXIAL = "TipDzc"
TORQUE_OUTPUT, PITCH_COMMAND_OUTPUT = "GenTq", "BlPitchC"
INFLOW_OUTPUTS = ("WindHubVelX", "WindHubVelY", "WindHubVelZ")
"""At the hub where it is, as the signals here; Wind1VelX … would be at a point that does not move."""
AERODYN_OUTPUTS = ("RtAeroFxh", "RtAeroMxh", "RtAeroPwr")


def _scaled(n_blades: int, n_lines: int | None) -> list[Channel]:
    """Signals that are an output of OpenFAST in another unit."""
    return [one for one in channel_table(n_blades, n_lines) if one.openfast and one.group not in _DERIVED]


def elastodyn_outputs(n_blades: int, floats: bool = False) -> tuple[str, ...]:
    """All outputs of ElastoDyn that are asked for."""
    others, blades = (*INFLOW_OUTPUTS, *AERODYN_OUTPUTS, WAVE_OUTPUT), range(1, n_blades + 1)
    names = [one.openfast for one in _scaled(n_blades, 0 if floats else None) if one.openfast not in others]
    return (*names, "Azimuth", *_TOWER_TOP[2:], *_ACCELERATION, *(f"{_TIP_AXIAL}{blade}" for blade in blades))


def water_outputs(n_lines: int | None) -> tuple[str, ...]:
    """Outputs of SeaState and MoorDyn about a floating turbine with so many mooring lines."""
    if n_lines is None:
        return ()
    return (WAVE_OUTPUT, *(f"{name}{line}" for name in TENSION_OUTPUTS for line in range(1, n_lines + 1)))


def servodyn_outputs(n_blades: int) -> tuple[str, ...]:
    """Outputs of ServoDyn from which the demands of a controller follow, where none are known here."""
    return (TORQUE_OUTPUT, *(f"{PITCH_COMMAND_OUTPUT}{blade}" for blade in range(1, n_blades + 1)))


class Measurement:
    """Signals of a turbine, from the outputs of OpenFAST and the commands of the drives.

    Parameters
    ----------
    turbine : Turbine
        Whose rotor turns clockwise.
    names : sequence of str
        Of OpenFAST's outputs, in their order.

    Raises
    ------
    SimulationError
        If outputs about a floating turbine are missing.

    Attributes
    ----------
    values : ndarray (n_channels,)
        In the order of `wt_gym.simulation.channels.channel_table`.
    """

    def __init__(self, turbine: Turbine, names: Sequence[str]):
        self.turbine, n = turbine, turbine.n_blades
        self.values, self._place = new_values(n, turbine.n_lines)
        self._column = {name.lower(): k for k, name in enumerate(names)}
        scaled, water = _scaled(n, turbine.n_lines), water_outputs(turbine.n_lines)
        if missing := [name for name in water if name.lower() not in self._column]:
            raise SimulationError(
                f"the model must have the outputs {', '.join(water)}; {', '.join(missing)} are missing"
            )
        self._targets = np.array([self._place[one.name] for one in scaled])
        self._sources = np.array([self._column[one.openfast.lower()] for one in scaled])
        self._factors = np.array([1.0 / openfast_unit(one.openfast, one.unit)[0] for one in scaled])
        self._tower_top, self._bends, self._axials, self._flaps, self._accelerations = (
            np.array([self._column[name.lower()] for name in group])
            for group in (
                _TOWER_TOP,
                [f"{name}{b}" for name in ("OoPDefl", "IPDefl") for b in range(1, n + 1)],
                [f"{_TIP_AXIAL}{b}" for b in range(1, n + 1)],
                [f"RootMyb{b}" for b in range(1, n + 1)],
                _ACCELERATION,
            )
        )
        tower = turbine.tower
        stations = np.unique(np.concatenate([tower.diameter_station, [0.0, tower.length]]))
        self._heights, self._radii = stations, 0.5 * tower.diameter_at(stations)
        self._view, self._before, self._between = np.zeros(4), np.zeros((n, 4)), np.zeros(4)
        self._tips = np.zeros((n, 3))

    def signals(self, signs: Array | None = None) -> Signals:
        """A copy of the signals, multiplied by signs where a reflection wants that."""
        return Signals(self.values.copy() if signs is None else self.values * signs, self.turbine.n_blades)

    @property
    def generator_speed(self) -> float:
        """Speed of the generator on the low-speed shaft [rad/s]."""
        return float(self.values[self._place["generator_speed"]]) / self.turbine.drivetrain.gear_ratio

    def aero_torque(self, row: Array) -> float:
        """Moment of the air about the shaft [N m] in a row of outputs."""
        return float(row[self._column["rtaeromxh"]])

    def take(
        self,
        time: float,
        rows: Array,
        torque: float,
        command: Array,
        pitch_rate: Array,
        travel: Array,
        accumulate: bool,
    ) -> None:
        """Take the outputs of all steps since the last sample.

        Parameters
        ----------
        time : float
            Of the last row [s].
        rows : array (n, n_outputs)
            One a step of OpenFAST.
        torque : float
            Of the generator [N m].
        command, pitch_rate, travel : array (n_blades,)
            Command of the pitch drives [rad], rate at the end [rad/s], way over the steps [rad].
        accumulate : bool
            Whether extremes and travel continue those of the sample before.
        """
        values, place, turbine, last = self.values, self._place, self.turbine, rows[-1]
        n = turbine.n_blades
        before = {
            name: values[place[name]].copy() if accumulate else None
            for name in ("rotor_speed_max", "tower_base_moment_max", "tip_clearance_min", "tip_out_of_plane_max",
                         "root_flap_moment_max", "pitch_travel")
        }  # fmt: skip
        values[self._targets] = self._factors * last[self._sources]

        def put(name: str, value: ArrayLike) -> None:
            values[place[name]] = value

        def extreme(name: str, found: ArrayLike, choose: Callable[[Any, Any], ArrayLike]) -> None:
            old = before[name]
            put(name, found if old is None else choose(old, found))

        yaw = values[place["yaw"]]
        cos, sin = math.cos(yaw), math.sin(yaw)
        x, y = (values[place[name]] for name in ("tower_top_x", "tower_top_y"))
        put("tower_top_fore_aft", cos * x + sin * y)
        put("tower_top_side_side", cos * y - sin * x)
        m_x, m_y = (values[place[name]] for name in ("tower_base_moment_x", "tower_base_moment_y"))
        put("tower_base_fore_aft_moment", cos * m_y - sin * m_x)
        put("tower_base_side_side_moment", cos * m_x + sin * m_y)
        a_x, a_y = last[self._accelerations]
        put("nacelle_acceleration_fore_aft", cos * a_x + sin * a_y)
        put("nacelle_acceleration_side_side", cos * a_y - sin * a_x)
        put("time", time)
        put("azimuth", last[self._column["azimuth"]] * _DEGREE % (2.0 * math.pi))
        put("generator_torque", torque)
        speed = float(values[place["generator_speed"]])
        put("generator_power", electrical_power(turbine.drivetrain, speed, torque))
        direction = math.atan2(values[place["wind_y"]], values[place["wind_x"]])
        heading = yaw if turbine.floater is None else yaw + values[place["platform_yaw"]]
        put("yaw_error", (direction - heading + math.pi) % (2.0 * math.pi) - math.pi)
        put("pitch_command", command)
        put("pitch_rate", pitch_rate)
        old = before["pitch_travel"]
        put("pitch_travel", travel if old is None else old + travel)
        extreme("rotor_speed_max", rows[:, self._column["rotspeed"]].max() * _RPM, max)
        moments = np.hypot(rows[:, self._column["twrbsmxt"]], rows[:, self._column["twrbsmyt"]])
        extreme("tower_base_moment_max", _KILO * moments.max(), max)
        extreme("tip_out_of_plane_max", rows[:, self._bends[:n]].max(axis=0), np.maximum)
        extreme("root_flap_moment_max", _KILO * np.abs(rows[:, self._flaps]).max(axis=0), np.maximum)
        now, least = self._clearances(rows, time == 0.0)
        put("tip_clearance", now)
        extreme("tip_clearance_min", least, np.minimum)

    def _clearances(self, rows: Array, first: bool) -> tuple[Array, Array]:
        """Signed clearance of each tip from the tower in the last row, and the least on the way through all rows."""
        n = self.turbine.n_blades
        least, now = np.full(n, np.inf), np.zeros(n)
        base = np.array([0.0, 0.0, self.turbine.tower.base_height])
        for k, row in enumerate(rows):
            axis, top = self._place_tips(row)
            for b in range(n):
                view_from_tower(self._tips[b], base, top, axis, self._heights, self._radii, self._view)
                if first and k == 0:
                    self._before[b] = self._view
                least[b] = min(least[b], passing_clearance(self._before[b], self._view, self._between))
                if k == len(rows) - 1:
                    now[b] = passing_clearance(self._view, self._view, self._between)
                self._before[b] = self._view
        return now, least

    def _place_tips(self, row: Array) -> tuple[Array, Array]:
        """Place the tips in global axes [m]; the axis of the nacelle, downwind, and the tower top."""
        turbine, n = self.turbine, self.turbine.n_blades
        nacelle, blade, cone = turbine.nacelle, turbine.blade, turbine.hub.cone
        fore, side, up, roll, lean = row[self._tower_top]
        yaw = row[self._column["yawpzn"]] * _DEGREE
        turned = rotation_x(roll * _DEGREE) @ rotation_y(lean * _DEGREE) @ rotation_about_z(yaw)[:3, :3]
        top = np.array([fore, side, turbine.tower.height + up])
        tilted = turned @ rotation_y(nacelle.tilt)
        hub = top + turned @ np.array([0.0, 0.0, nacelle.tower_top_to_shaft]) - tilted[:, 0] * nacelle.overhang
        prebend, sweep = blade.axis_at(blade.length)[:2]
        azimuth = row[self._column["azimuth"]] * _DEGREE
        out, beside = row[self._bends[:n]], row[self._bends[n:]]
        for b in range(n):
            rotor = tilted @ rotation_x(azimuth + 2.0 * math.pi * b / n) @ rotation_y(-cone)
            reach = turbine.hub.radius + blade.length + row[self._axials[b]]
            self._tips[b] = hub + rotor @ np.array([prebend + out[b], sweep + beside[b], reach])
        return np.ascontiguousarray(turned[:, 0]), top
