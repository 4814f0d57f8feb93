"""The observation: which quantities an agent measures, over which range and scale, with noise, delay and memory."""

from __future__ import annotations

import copy
import math
from collections import deque
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.angles import wrapped
from wt_gym.constants import GRAVITY
from wt_gym.control import ActionMap, Aim, Channel, Demand, Lidar, NacelleAnemometer, torque_curve
from wt_gym.control.coleman import FIXED_FRAME
from wt_gym.control.controllers.wind_estimator import WindEstimator
from wt_gym.control.reference_loads import reference_flap_moment, reference_tower_moment
from wt_gym.envs.arguments import shown
from wt_gym.envs.layout import ObservationLayout
from wt_gym.envs.observation_kernels import read_signals
from wt_gym.simulation.channels import channel_table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from wt_gym.control.residual import ResidualPitch
    from wt_gym.simulation import Signals
    from wt_gym.turbines import Turbine

__all__ = [
    "DEFAULT_GROUPS",
    "MOST_READINGS",
    "OBSERVATION_GROUPS",
    "RESIDUAL_GROUPS",
    "Observer",
    "Situation",
    "blade_static_moment",
]

OBSERVATION_GROUPS = (
    "rotor", "power", "pitch", "wind", "wind_estimate", "blades", "fixed_frame", "tower", "azimuth", "controller",
    "offsets", "lidar", "previous_action",
)  # fmt: skip
DEFAULT_GROUPS = ("rotor", "power", "pitch", "wind", "blades", "tower", "azimuth", "previous_action")
MOST_READINGS = 1000
"""Most readings in an observation, and most control steps by which they are late: 200 s at the usual step of 0.2 s."""
_BLADE_SIGNALS = ("tip_out_of_plane", "tip_in_plane", "root_flap_moment", "root_edge_moment")
_EVEN, _ODD = 1, -1
_PARITY = {
    "wind_speed": _EVEN,
    "rotor_wind": _EVEN,
    "azimuth_sin": _EVEN,
    "azimuth_cos": _EVEN,
    "generator_torque_demand": _EVEN,
    "pitch": _EVEN,
    "pitch_rate": _EVEN,
    "pitch_demand": _EVEN,
    "pitch_offset": _EVEN,
    "controller_pitch": _EVEN,
    "controller_torque": _EVEN,
    "torque_offset": _EVEN,
    "residual_share": _EVEN,
    "residual_mean": _EVEN,
    "lidar": _EVEN,
    **{f"{signal}_{part}": _EVEN for signal in _BLADE_SIGNALS for part in FIXED_FRAME},
}
"""Parity (`wt_gym.simulation.channels.Channel`) of what is observed beside the simulator's channels and the previous
action, numbers of blades, gates and coordinates left out. Azimuth, and with it tilt and yaw in the fixed frame, count
in the sense of rotation; the beams of a lidar are their own mirror image."""
_MEMORY = ("_estimator", "_anemometer", "_wind_reading", "_pitch_before", "_pitch_now", "_dt", "_readings")
RESIDUAL_GROUPS = ("rotor", "power", "pitch", "wind", "fixed_frame", "tower", "controller", "offsets")
"""What is observed by default on top of a controller, in coordinates that do not turn with the rotor."""


def blade_static_moment(turbine: Turbine) -> float:
    """Root moment of a horizontal blade under its own weight [N m]."""
    structure = turbine.blade.structure
    return float(GRAVITY * np.trapezoid(structure.inertia[:, 0, 0] * structure.station, structure.station))


def _mean(of_blades) -> float:
    """Mean of one number a blade; of so few, numpy's own is slow."""
    return float(np.add.reduce(of_blades)) / len(of_blades)


@dataclass(frozen=True)
class Situation:
    """All that can be observed after a control step.

    Attributes
    ----------
    signals : Signals
    demand : Demand
        Present demands on the actuators.
    aim : Aim
        Of the agent; its offsets in mode "residual".
    base : Demand or None
        Of the controller beneath.
    action : numpy.ndarray, shape (n_act,)
        That led here.
    seen : numpy.ndarray, shape (n_ranges,), optional
        By the lidar, for an observer that `Observer.sees_lidar` [m/s].
    residual : ResidualPitch, optional
        What residual pitch passes.
    """

    signals: Signals
    demand: Demand
    aim: Aim
    base: Demand | None
    action: np.ndarray
    seen: np.ndarray | None = None
    residual: ResidualPitch | None = None


class Observer:
    """Turns what is the case into observations.

    Parameters
    ----------
    turbine : Turbine
    action : ActionMap
        Collective maps give one pitch, others one a blade.
    choice : sequence of str
        Groups (`OBSERVATION_GROUPS`) and single channels, in any order; groups come in the order of that tuple, then
        single channels as named.
    noise_level : float
        Factor on the noise of every sensor; zero for none.
    delay : int
        Control steps by which every reading is late, up to `MOST_READINGS`.
    history : int
        Readings in an observation, up to `MOST_READINGS`: this one, then those before it.
    lidar : Lidar, optional
    residual : ResidualPitch, optional
        What residual pitch passes, if anything; what acts of it can then be observed.

    Attributes
    ----------
    sees_lidar : bool
        Whether there is a channel of the lidar.

    Raises
    ------
    ValueError
        If a group or channel is unknown or none is given, or noise, delay or history is out of range.
    """

    def __init__(
        self,
        turbine: Turbine,
        action: ActionMap,
        choice: Sequence[str] = DEFAULT_GROUPS,
        noise_level: float = 0.0,
        delay: int = 0,
        history: int = 1,
        lidar: Lidar | None = None,
        residual: ResidualPitch | None = None,
    ):
        if not 0.0 <= noise_level < math.inf:
            raise ValueError(f"sensor_noise must be finite and not negative, got {noise_level!r}")
        if not 1 <= history <= MOST_READINGS or history != int(history):
            raise ValueError(f"history must be a whole number of readings, 1 to {MOST_READINGS}, got {history!r}")
        if not 0 <= delay <= MOST_READINGS:
            raise ValueError(f"sensor_delay must be 0 to {MOST_READINGS} control steps, got {delay}")
        if lidar is not None and not isinstance(lidar, Lidar):
            raise ValueError(f"lidar must be a wt_gym.control.Lidar or None, got {shown(lidar)}")
        self._turbine, self._action, self._noise_level = turbine, action, noise_level
        self._delay, self._history = int(delay), int(history)
        self._fades = residual is not None and residual.fades
        self._washes = residual is not None and residual.washes
        self._anemometer = NacelleAnemometer()
        self._estimator: WindEstimator | None = None
        self.lidar = lidar or Lidar.for_rotor(turbine.rotor_diameter)
        self.groups, channels = self._choose(choice)
        channels = [self._with_parity(channel) for channel in channels]
        layers = [channels] + [
            [replace(c, name=f"{c.name}@{k}", description=f"{c.description}, {k} steps ago") for c in channels]
            for k in range(1, self._history)
        ]
        self.layout = ObservationLayout([channel for layer in layers for channel in layer])
        turning = _EVEN if turbine.rotation == "clockwise" else _ODD
        # that of the image, of the same random numbers
        self._noise = np.array([c.noise * (turning if c.parity == _ODD else _EVEN) for c in channels])
        self._prepare([channel.name for channel in channels])

    def _choose(self, choice) -> tuple[tuple[str, ...], list[Channel]]:
        """Groups and channels that are observed."""
        choice = choice if isinstance(choice, str) else tuple(choice)
        if isinstance(choice, str) or not choice:
            raise ValueError(f"observation must name groups of {OBSERVATION_GROUPS} or channels, got {choice!r}")
        builders = {
            "rotor": self._rotor, "power": self._power, "pitch": self._pitch, "wind": self._wind,
            "wind_estimate": self._wind_estimate, "blades": self._blades, "fixed_frame": self._fixed_frame,
            "tower": self._tower, "azimuth": self._azimuth, "controller": self._controller, "offsets": self._offsets,
            "lidar": self._lidar_channels, "previous_action": self._previous_action,
        }  # fmt: skip
        groups = tuple(group for group in OBSERVATION_GROUPS if group in choice)
        others = (*self._pitch_forms(), self._every_fixed_frame(), self._more())
        singles = {c.name: c for found in (*(build() for build in builders.values()), *others) for c in found}
        unknown = [name for name in choice if name not in OBSERVATION_GROUPS and name not in singles]
        if unknown:
            raise ValueError(
                f"observation has no {unknown}; there are the groups {OBSERVATION_GROUPS} and the channels "
                f"{tuple(singles)}"
            )
        empty = [group for group in groups if not builders[group]()]
        if empty:
            raise ValueError(f"observation {empty}: with this action there is no controller beneath, or no offset")
        channels = [channel for group in groups for channel in builders[group]()]
        taken = {channel.name for channel in channels}
        wanted = [name for name in dict.fromkeys(choice) if name not in OBSERVATION_GROUPS and name not in taken]
        return groups, channels + [singles[name] for name in wanted]

    def _with_parity(self, channel: Channel) -> Channel:
        """A channel with its parity, and of an odd one the offset and range that a turbine of this rotation has.

        Raises
        ------
        KeyError
            If no parity is known of it.
        """
        name = channel.name
        known = {c.name: c.parity for c in channel_table(self._turbine.n_blades)} | _PARITY
        known |= {f"previous_{n}": int(p) for n, p in zip(self._action.names, self._action.parity, strict=True)}
        stem, _, number = name.rpartition("_")
        parity = known[stem if name not in known and number.isdigit() else name]
        if parity == _EVEN or self._turbine.rotation == "clockwise":
            return replace(channel, parity=parity)
        return replace(channel, parity=parity, offset=0.0 - channel.offset, low=-channel.high, high=-channel.low)

    def _prepare(self, names) -> None:
        """Sort the channels: those that the simulator has come from its vector at once, others from functions."""
        index = {c.name: i for i, c in enumerate(channel_table(self._turbine.n_blades))}
        own = [name for name in names if self._special(name) is None]
        self._at = np.array([names.index(name) for name in own], dtype=np.int64)
        self._from = np.array([index[name] for name in own], dtype=np.int64)
        cyclic = [(k, *part) for k, name in enumerate(names) if (part := self._fixed_frame_part(name))]
        self._cyclic_at = np.array([k for k, _, _ in cyclic], dtype=np.int64)
        self._cyclic_part = np.array([part for _, _, part in cyclic], dtype=np.int64)
        first = np.array([index[f"{signal}_1"] for _, signal, _ in cyclic], dtype=np.int64)
        self._cyclic_from = first[:, None] + np.arange(self._turbine.n_blades)
        self._functions = [(k, f) for k, name in enumerate(names) if callable(f := self._special(name))]
        if "rotor_wind" in names and self._estimator is None:  # another turbine's table takes a while to make
            self._estimator = WindEstimator.of_turbine(self._turbine)
        self.sees_lidar = any(name.startswith("lidar_") for name in names)
        self._directions = [k for k, name in enumerate(names) if name == "yaw_error"]
        self._size = len(names)

    def __getstate__(self):
        """What a copy or a pickle takes along: functions are made anew."""
        kept = dict(self.__dict__)
        del kept["_functions"]
        return kept

    def __setstate__(self, kept) -> None:
        """Take over a state and make the functions."""
        self.__dict__.update(kept)
        self._prepare([channel.name for channel in self.layout.channels[: self._size]])

    def memory(self) -> dict:
        """Give what the sensors remember within an episode, a copy, for `recall`."""
        return copy.deepcopy({name: self.__dict__[name] for name in _MEMORY})

    def recall(self, memory: dict) -> None:
        """Continue with a memory."""
        self.__dict__.update(copy.deepcopy(memory))

    # ---- readings ----

    def reset(self, situation: Situation) -> None:
        """Start the filters in steady state."""
        signals = situation.signals
        self._wind_reading = self._anemometer.reset(signals["wind_x"], signals["wind_y"], signals["yaw_error"])
        self._pitch_before = self._pitch_now = signals["pitch"].tolist()
        self._dt = math.inf
        if self._estimator is not None:
            self._estimator.start(signals)
        self._readings: deque[np.ndarray] = deque(maxlen=self._delay + self._history)

    def advance(self, signals: Signals, dt: float) -> None:
        """Let the filters take the signals of a step of length ``dt`` [s]."""
        wind = signals["wind_x"], signals["wind_y"], signals["yaw_error"]
        self._wind_reading = self._anemometer.update(*wind, dt)
        if self._estimator is not None:
            self._estimator.update(signals, dt)
        self._pitch_before, self._pitch_now, self._dt = self._pitch_now, signals["pitch"].tolist(), dt

    def observe(self, situation: Situation, rng: np.random.Generator) -> tuple[np.ndarray, tuple[str, ...]]:
        """Measure once a control step.

        Parameters
        ----------
        situation : Situation
        rng : numpy.random.Generator
            Source of the measurement noise.

        Returns
        -------
        observation : numpy.ndarray, float32, shape (n_obs,)
        saturated : tuple of str
            Sensors at the end of their range.
        """
        values, signals = np.empty(self._size), situation.signals
        read_signals(
            signals.values, self._from, self._at, self._cyclic_from, self._cyclic_part, signals["azimuth"],
            self._cyclic_at, values,
        )  # fmt: skip
        for k, function in self._functions:
            values[k] = function(situation)
        if self._noise_level > 0:
            values += self._noise_level * self._noise * rng.standard_normal(self._size)
            for k in self._directions:
                values[k] = wrapped(values[k])
        readings = self._readings
        readings.append(values)
        if self._history == 1:
            return self.layout.normalise(readings[0])
        late = [readings[max(len(readings) - 1 - self._delay - k, 0)] for k in range(self._history)]
        return self.layout.normalise(np.concatenate(late))

    @staticmethod
    def _fixed_frame_part(name) -> tuple[str, int] | None:
        """Signal of the blades and number of the coordinate, of a channel in the fixed frame."""
        signal, _, part = name.rpartition("_")
        return (signal, FIXED_FRAME.index(part)) if part in FIXED_FRAME and signal in _BLADE_SIGNALS else None

    def _special(self, name):
        """Function that reads a channel, True for one in the fixed frame, None for one that the simulator has."""
        if name.startswith("previous_") and name.removeprefix("previous_") in self._action.names:
            k = self._action.names.index(name.removeprefix("previous_"))
            return lambda s: s.action[k]
        if name.startswith("lidar_"):
            k = int(name.removeprefix("lidar_")) - 1
            return lambda s: s.seen[k]
        if name.startswith("pitch_demand_"):
            b = int(name.rsplit("_", 1)[1]) - 1
            return lambda s: s.demand.pitch[b]
        if name.startswith("pitch_rate_"):
            b = int(name.rsplit("_", 1)[1]) - 1
            return lambda s: (self._pitch_now[b] - self._pitch_before[b]) / self._dt
        if name.startswith("pitch_offset_"):
            k = int(name.rsplit("_", 1)[1]) - 1
            return lambda s: s.aim.pitch[k]
        if self._fixed_frame_part(name) is not None:
            return True
        return {
            "wind_speed": lambda s: self._wind_reading[0],
            "rotor_wind": lambda s: self._estimator.wind,
            "yaw_error": lambda s: self._wind_reading[1],
            "azimuth_sin": lambda s: math.sin(s.signals["azimuth"]),
            "azimuth_cos": lambda s: math.cos(s.signals["azimuth"]),
            "generator_torque_demand": lambda s: s.demand.generator_torque,
            "pitch": lambda s: _mean(self._pitch_now),
            "pitch_rate": lambda s: _mean(np.subtract(self._pitch_now, self._pitch_before)) / self._dt,
            "pitch_demand": lambda s: _mean(s.demand.pitch),
            "controller_pitch": lambda s: _mean(s.base.pitch),
            "controller_torque": lambda s: s.base.generator_torque,
            "torque_offset": lambda s: s.aim.generator_torque,
            "residual_share": lambda s: s.residual.share,
            "residual_mean": lambda s: s.residual.mean,
        }.get(name)

    # ---- channels; scales are the standard deviations under the baseline controller in turbulence of class B ----

    def _per_blade(self, name: str, *args) -> list[Channel]:
        """The same channel for every blade."""
        unit, offset, scale, low, high, noise, text = args
        return [
            Channel(f"{name}_{b + 1}", unit, offset, scale, low, high, noise, f"{text}, blade {b + 1}")
            for b in range(self._turbine.n_blades)
        ]

    def _rotor(self) -> list[Channel]:
        drivetrain = self._turbine.drivetrain
        rated, ratio = drivetrain.rated_rotor_speed, drivetrain.gear_ratio
        rows = (("rotor_speed", rated, "rotor speed"), ("generator_speed", rated * ratio, "generator speed, HSS"))
        return [Channel(name, "rad/s", w, 0.1 * w, 0.0, 2 * w, 1e-3 * w, text) for name, w, text in rows]

    def _torque_row(self) -> tuple[float, float, float]:
        curve = torque_curve(self._turbine)
        torque = curve.rated_power / curve.rated_generator_speed
        return 0.8 * torque, 0.25 * torque, self._action.torque_limits[1]

    def _power(self) -> list[Channel]:
        power = self._turbine.drivetrain.rated_power
        middle, scale, limit = self._torque_row()
        return [
            Channel("generator_power", "W", 0.8 * power, 0.25 * power, -power, 2 * power, 5e-3 * power,
                    "electrical power"),
            Channel("generator_torque", "N m", middle, scale, -limit, 2 * limit, 0.02 * scale, "generator torque, HSS"),
            *self._torque_demand("generator_torque_demand", "demanded generator torque, HSS"),
        ]  # fmt: skip

    def _torque_demand(self, name: str, text: str) -> list[Channel]:
        """A demand for torque, where the generator takes one."""
        middle, scale, limit = self._torque_row()
        return [Channel(name, "N m", middle, scale, 0.0, limit, 0.0, text)] if self._action.takes_torque else []

    def _pitch(self) -> list[Channel]:
        mean, each = self._pitch_forms()
        return mean if self._action.pitch == "collective" else each

    def _pitch_forms(self) -> tuple[list[Channel], list[Channel]]:
        """Pitch as the mean of the blades and of each."""
        low, high = self._action.pitch_limits
        rate, noise = self._action.max_pitch_rate, math.radians(0.05)
        # A servo may overshoot its limits and its greatest rate a little.
        margin = 0.1
        rows = (
            ("pitch", "rad", 0.1, 0.1, low - margin, high + margin, noise, "blade pitch"),
            ("pitch_rate", "rad/s", 0.0, 0.15 * rate, -2 * rate, 2 * rate, 0.02 * rate, "blade pitch rate of the step"),
            ("pitch_demand", "rad", 0.1, 0.1, low, high, 0.0, "demanded blade pitch"),
        )
        mean = [Channel(*row[:-1], f"{row[-1]}, mean of the blades") for row in rows]
        return mean, [channel for row in rows for channel in self._per_blade(*row)]

    def _wind(self) -> list[Channel]:
        return [
            Channel("wind_speed", "m/s", 12.0, 4.0, 0.0, 60.0, 0.2, "nacelle anemometer, filtered over 1 s"),
            Channel("yaw_error", "rad", 0.0, 0.1, -math.pi, math.pi, 0.02, "wind vane, filtered over 5 s"),
        ]

    def _wind_estimate(self) -> list[Channel]:
        text = "rotor-effective wind, estimated from rotor speed, torque and pitch"
        return [Channel("rotor_wind", "m/s", 12.0, 4.0, 0.0, 60.0, 0.0, text)]

    def _blade_rows(self):
        """Name, unit, offset and scale of a blade, offset and scale of mean and of tilt and yaw, reference, text."""
        tip = 0.1 * self._turbine.blade.length
        flap, edge = reference_flap_moment(self._turbine), blade_static_moment(self._turbine)
        return (
            ("tip_out_of_plane", "m", (0.53, 0.2), (0.53, 0.2), (0.08, 0.075), tip, "tip deflection downwind"),
            ("tip_in_plane", "m", (-0.1, 0.075), (-0.1, 0.025), (0.0, 0.025), tip, "tip deflection in the rotor plane"),
            ("root_flap_moment", "N m", (0.5, 0.18), (0.5, 0.15), (0.07, 0.075), flap, "flapwise root moment"),
            ("root_edge_moment", "N m", (0.0, 0.75), (0.2, 0.1), (0.0, 0.5), edge, "edgewise root moment"),
        )

    def _blades(self) -> list[Channel]:
        channels = []
        for name, unit, (middle, scale), _, _, size, text in self._blade_rows():
            reach = 20 * size if name == "root_edge_moment" else 10 * size
            row = (unit, middle * size, scale * size, -reach, reach, 0.01 * size, text)
            channels += self._per_blade(name, *row)
        return channels

    def _fixed_frame(self) -> list[Channel]:
        observed = ("tip_out_of_plane", "root_flap_moment")
        return [channel for channel in self._every_fixed_frame() if channel.name.startswith(observed)]

    def _every_fixed_frame(self) -> list[Channel]:
        """Mean, tilt and yaw of every signal of the blades."""
        channels = []
        for name, unit, _, mean, cyclic, size, text in self._blade_rows():
            reach = 20 * size
            channels += [
                Channel(f"{name}_{part}", unit, middle * size, scale * size, -reach, reach, 0.005 * size,
                        f"{text}, {part} of the blades")
                for part, (middle, scale) in zip(FIXED_FRAME, (mean, cyclic, cyclic), strict=True)
            ]  # fmt: skip
        return channels

    def _tower(self) -> list[Channel]:
        height = self._turbine.hub_height
        reach, rows = 0.1 * height, (("fore_aft", 3.1e-3, 9e-4, 0.11), ("side_side", -5e-4, 2.5e-4, 0.065))
        displacement = [
            Channel(f"tower_top_{axis}", "m", middle * height, scale * height, -reach, reach, 5e-5 * height,
                    f"tower-top position {axis.replace('_', '-')}")
            for axis, middle, scale, _ in rows
        ]  # fmt: skip
        acceleration = [
            Channel(f"nacelle_acceleration_{axis}", "m/s^2", 0.0, scale, -20.0, 20.0, 0.01,
                    f"nacelle acceleration {axis.replace('_', '-')}")
            for axis, _, _, scale in rows
        ]  # fmt: skip
        return displacement + acceleration

    def _azimuth(self) -> list[Channel]:
        return [
            Channel(f"azimuth_{name}", "-", 0.0, 0.7, -1.0, 1.0, 0.0, f"{text} of the azimuth of blade 1 (0 = up)")
            for name, text in (("sin", "sine"), ("cos", "cosine"))
        ]

    def _controller(self) -> list[Channel]:
        if not self._action.needs_controller:
            return []
        low, high = self._action.pitch_limits
        return [
            Channel("controller_pitch", "rad", 0.1, 0.1, low, high, 0.0, "pitch that the controller beneath demands"),
            *self._torque_demand("controller_torque", "torque that it demands, HSS"),
        ]

    def _offsets(self) -> list[Channel]:
        if self._action.mode != "residual":
            return []
        channels = []
        if "pitch" in self._action.components:
            limit = self._action.pitch_high
            channels += [
                Channel(f"pitch_offset_{k + 1}", "rad", 0.0, 0.5 * limit[k], -limit[k], limit[k], 0.0,
                        f"residual pitch, coordinate {k + 1} of the action")
                for k in range(self._action.n_pitch)
            ]  # fmt: skip
        if "torque" in self._action.components:
            most = self._action.torque_offset_limit
            channels.append(Channel("torque_offset", "N m", 0.0, 0.5 * most, -most, most, 0.0, "residual torque"))
        return channels

    def _lidar_channels(self) -> list[Channel]:
        return [
            Channel(f"lidar_{k + 1}", "m/s", 12.0, 4.0, 0.0, 60.0, 0.1,
                    f"wind {distance:.0f} m ahead, mean over the beams of a cone")
            for k, distance in enumerate(self.lidar.ranges)
        ]  # fmt: skip

    def _previous_action(self) -> list[Channel]:
        return [
            Channel(f"previous_{name}", "-", 0.0, 1.0, -1.0, 1.0, 0.0, f"last action, component {name}")
            for name in self._action.names
        ]

    def _more(self) -> list[Channel]:
        """Channels of no group."""
        moment = reference_tower_moment(self._turbine)
        acting = []
        if self._fades:
            text = "share of residual pitch that acts"
            acting.append(Channel("residual_share", "-", 0.5, 0.5, 0.0, 1.0, 0.0, text))
        if self._washes:
            limit = 2.0 * float(self._action.pitch_high[0])
            text = "mean of the blades' residual pitch that acts"
            acting.append(Channel("residual_mean", "rad", 0.0, 0.25 * limit, -limit, limit, 0.0, text))
        return [
            *acting,
            Channel("tower_base_fore_aft_moment", "N m", 0.55 * moment, 0.15 * moment, -10 * moment, 10 * moment,
                    0.005 * moment, "tower-base moment, positive for a downwind push"),
            Channel("tower_base_side_side_moment", "N m", 0.055 * moment, 0.04 * moment, -10 * moment, 10 * moment,
                    0.005 * moment, "tower-base moment about the wind's direction"),
        ]  # fmt: skip
