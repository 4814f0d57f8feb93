"""The observation: which quantities an agent measures, over which range and scale."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.constants import GRAVITY
from wt_gym.control import ActionMap, Channel, Demand, NacelleAnemometer, torque_curve
from wt_gym.envs.layout import ObservationLayout

if TYPE_CHECKING:
    from wt_gym.simulation import Signals
    from wt_gym.turbines import Turbine

__all__ = ["OBSERVATION_GROUPS", "Observer", "blade_static_moment", "reference_flap_moment"]

OBSERVATION_GROUPS = ("rotor", "power", "pitch", "wind", "blades", "tower", "azimuth", "previous_action")


def reference_flap_moment(turbine: Turbine) -> float:
    """Root moment of a blade that carries its share of the Betz thrust at rated wind at 2/3 of the radius [N m]."""
    radius = turbine.rotor_diameter / 2
    dynamic_pressure = 0.5 * turbine.air_density * turbine.rated_wind_speed**2
    thrust = 8 / 9 * dynamic_pressure * math.pi * radius**2
    return thrust / turbine.n_blades * 2 / 3 * radius


def blade_static_moment(turbine: Turbine) -> float:
    """Root moment of a horizontal blade under its own weight [N m]."""
    structure = turbine.blade.structure
    return float(GRAVITY * np.trapezoid(structure.inertia[:, 0, 0] * structure.station, structure.station))


class Observer:
    """Turns the signals of the simulator into observations.

    Parameters
    ----------
    turbine : Turbine
    action : ActionMap
        Collective maps give one pitch, individual ones one a blade.
    groups : sequence of str
        Some of `OBSERVATION_GROUPS`, in any order; the observation keeps the order of that tuple.
    noise_level : float
        Factor on the noise of every sensor; zero for none.

    Raises
    ------
    ValueError
        If a group is unknown or none is given, or the noise level is negative or not finite.
    """

    def __init__(self, turbine: Turbine, action: ActionMap, groups=OBSERVATION_GROUPS, noise_level: float = 0.0):
        unknown = [group for group in groups if group not in OBSERVATION_GROUPS]
        if unknown or not groups:
            raise ValueError(f"observation must name some of {OBSERVATION_GROUPS}, got {tuple(groups)}")
        if not 0.0 <= noise_level < math.inf:
            raise ValueError(f"sensor_noise must be finite and not negative, got {noise_level!r}")
        self._turbine, self._action, self._noise_level = turbine, action, noise_level
        self._anemometer = NacelleAnemometer()
        builders = {
            "rotor": self._rotor,
            "power": self._power,
            "pitch": self._pitch,
            "wind": self._wind,
            "blades": self._blades,
            "tower": self._tower,
            "azimuth": self._azimuth,
            "previous_action": self._previous_action,
        }
        self.groups = tuple(group for group in OBSERVATION_GROUPS if group in groups)
        self.layout = ObservationLayout([channel for group in self.groups for channel in builders[group]()])

    def reset(self, signals: Signals) -> None:
        """Start the filters in steady state."""
        self._wind_reading = self._anemometer.reset(signals["wind_x"], signals["wind_y"], signals["yaw_error"])

    def advance(self, signals: Signals, dt: float) -> None:
        """Let the filters take the signals of a step of length ``dt`` [s]."""
        wind = signals["wind_x"], signals["wind_y"], signals["yaw_error"]
        self._wind_reading = self._anemometer.update(*wind, dt)

    def observe(
        self, signals: Signals, demand: Demand, action: np.ndarray, rng: np.random.Generator
    ) -> tuple[np.ndarray, tuple[str, ...]]:
        """Measure.

        Parameters
        ----------
        signals : Signals
        demand : Demand
            Present demands on the actuators.
        action : numpy.ndarray, shape (n_act,)
            The action that led here.
        rng : numpy.random.Generator
            Source of the measurement noise.

        Returns
        -------
        observation : numpy.ndarray, float32, shape (n_obs,)
        saturated : tuple of str
            Sensors at the end of their range.
        """
        values = np.array([self._read(name, signals, demand, action) for name in self.layout.names])
        if self._noise_level > 0:
            values += self._noise_level * self.layout.noise * rng.standard_normal(len(values))
        return self.layout.normalise(values)

    def _read(self, name: str, signals: Signals, demand: Demand, action: np.ndarray) -> float:
        """Value of a channel in physical units."""
        if name.startswith("previous_"):
            return action[self._action.names.index(name.removeprefix("previous_"))]
        match name:
            case "wind_speed":
                return self._wind_reading[0]
            case "yaw_error":
                return self._wind_reading[1]
            case "azimuth_sin":
                return math.sin(signals["azimuth"])
            case "azimuth_cos":
                return math.cos(signals["azimuth"])
            case "generator_torque_demand":
                return demand.generator_torque
            case "pitch" | "pitch_rate":
                return float(np.mean([signals[f"{name}_{b + 1}"] for b in range(self._turbine.n_blades)]))
            case "pitch_demand":
                return float(np.mean(demand.pitch))
        if name.startswith("pitch_demand_"):
            return demand.pitch[int(name.rsplit("_", 1)[1]) - 1]
        return signals[name]

    def _per_blade(self, name: str, *args) -> list[Channel]:
        """The same channel for every blade."""
        *numbers, text = args
        return [Channel(f"{name}_{b + 1}", *numbers, f"{text}, blade {b + 1}") for b in range(self._turbine.n_blades)]

    def _rotor(self) -> list[Channel]:
        drivetrain = self._turbine.drivetrain
        rated, ratio = drivetrain.rated_rotor_speed, drivetrain.gear_ratio
        rows = (("rotor_speed", rated, "rotor speed"), ("generator_speed", rated * ratio, "generator speed, HSS"))
        return [Channel(name, "rad/s", w, 0.1 * w, 0.0, 2 * w, 1e-3 * w, text) for name, w, text in rows]

    def _power(self) -> list[Channel]:
        power = self._turbine.drivetrain.rated_power
        curve = torque_curve(self._turbine)
        torque, limit = curve.rated_power / curve.rated_generator_speed, self._action.torque_limits[1]
        return [
            Channel("generator_power", "W", 0.0, power, -power, 2 * power, 5e-3 * power, "electrical power"),
            Channel("generator_torque", "N m", 0.0, torque, -limit, 2 * limit, 5e-3 * torque, "generator torque, HSS"),
            Channel("generator_torque_demand", "N m", 0.0, torque, 0.0, limit, 0.0, "demanded generator torque, HSS"),
        ]

    def _pitch(self) -> list[Channel]:
        low, high = self._action.pitch_limits
        rate, scale, noise = self._action.max_pitch_rate, 0.2, math.radians(0.05)
        # A servo may overshoot its limits and its greatest rate a little.
        margin = 0.1
        rows = (
            ("pitch", "rad", 0.0, scale, low - margin, high + margin, noise, "blade pitch"),
            ("pitch_rate", "rad/s", 0.0, rate, -2 * rate, 2 * rate, 0.02 * rate, "blade pitch rate"),
            ("pitch_demand", "rad", 0.0, scale, low, high, 0.0, "demanded blade pitch"),
        )
        if self._action.pitch == "collective":
            return [Channel(*row[:-1], f"{row[-1]}, mean of the blades") for row in rows]
        return [channel for row in rows for channel in self._per_blade(*row)]

    def _wind(self) -> list[Channel]:
        return [
            Channel("wind_speed", "m/s", 12.0, 6.0, 0.0, 60.0, 0.2, "nacelle anemometer, filtered over 1 s"),
            Channel("yaw_error", "rad", 0.0, 0.2, -math.pi, math.pi, 0.02, "wind vane, filtered over 5 s"),
        ]

    def _blades(self) -> list[Channel]:
        tip = 0.1 * self._turbine.blade.length
        flap, edge = reference_flap_moment(self._turbine), blade_static_moment(self._turbine)
        rows = (
            ("tip_out_of_plane", "m", 0.0, tip, -10 * tip, 10 * tip, 0.01 * tip, "tip deflection, positive downwind"),
            ("tip_in_plane", "m", 0.0, tip, -10 * tip, 10 * tip, 0.01 * tip, "tip deflection in the rotor plane"),
            ("root_flap_moment", "N m", 0.0, flap, -10 * flap, 10 * flap, 0.01 * flap, "flapwise root moment"),
            ("root_edge_moment", "N m", 0.0, edge, -20 * edge, 20 * edge, 0.01 * edge, "edgewise root moment"),
        )
        return [channel for row in rows for channel in self._per_blade(*row)]

    def _tower(self) -> list[Channel]:
        top = 0.005 * self._turbine.hub_height
        rows = (("fore_aft", "fore-aft, positive downwind"), ("side_side", "side-side"))
        displacement = [
            Channel(f"tower_top_{axis}", "m", 0.0, top, -20 * top, 20 * top, 0.01 * top, f"tower-top position {text}")
            for axis, text in rows
        ]
        acceleration = [
            Channel(
                f"nacelle_acceleration_{axis}", "m/s^2", 0.0, 1.0, -20.0, 20.0, 0.01, f"nacelle acceleration {text}"
            )
            for axis, text in rows
        ]
        return displacement + acceleration

    def _azimuth(self) -> list[Channel]:
        return [
            Channel(f"azimuth_{name}", "-", 0.0, 1.0, -1.0, 1.0, 0.0, f"{text} of the azimuth of blade 1 (0 = up)")
            for name, text in (("sin", "sine"), ("cos", "cosine"))
        ]

    def _previous_action(self) -> list[Channel]:
        return [
            Channel(f"previous_{name}", "-", 0.0, 1.0, -1.0, 1.0, 0.0, f"last action, component {name}")
            for name in self._action.names
        ]
