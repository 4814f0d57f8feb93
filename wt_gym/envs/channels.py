"""Everything that can be observed: channels with unit, scale, range and noise for a turbine, and how each is read."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import attrgetter
from typing import Any

import numpy as np

from wt_gym.base.errors import did_you_mean
from wt_gym.base.quantities import GRAVITY
from wt_gym.control import ActionMap, Channel, NacelleAnemometer, torque_curve
from wt_gym.control.controllers import Controller
from wt_gym.control.controllers.additions import ResidualPitch, yaw_drive_of
from wt_gym.control.controllers.linear_optimal import LinearOptimalPitch, linear_part
from wt_gym.control.controllers.supervisor import STATES, supervisor_of
from wt_gym.control.controllers.tsr_tracking import WindEstimator
from wt_gym.control.design import reference_flap_moment, reference_tower_moment
from wt_gym.control.sensors import FIXED_FRAME, to_fixed_frame
from wt_gym.simulation import Signals
from wt_gym.simulation.channels import EVEN, ODD, channel_table
from wt_gym.turbines import Turbine

OBSERVATION_GROUPS = (
    "rotor", "power", "pitch", "wind", "wind_estimate", "blades", "fixed_frame", "tower", "azimuth", "controller",
    "offsets", "lidar", "previous_action", "measurable", "dead_band", "disturbances", "own_response", "model_fit",
    "supervisor", "power_reference", "power_forecast", "dial", "platform", "platform_position", "wave",
)  # fmt: skip
DEFAULT_GROUPS = ("rotor", "power", "pitch", "wind", "blades", "tower", "azimuth", "previous_action")
RESIDUAL_GROUPS = ("rotor", "power", "pitch", "wind", "fixed_frame", "tower", "controller", "offsets")
"""Groups that are observed by default on top of a controller, in coordinates that do not turn with the rotor."""
_LOADS = ("root_", "tip_", "tower_", "nacelle_acceleration_")
"""Beginnings of the names of what a washout is for: loads, deflections and accelerations of blades and tower."""
_CYCLIC = ("root_flap_", "root_out_of_plane_", "tip_")
"""Beginnings of the names whose tilt and yaw parts pass no washout: in a frame that does not turn, the offset of a
strain gauge moves once a revolution, so their means are those of the loads, which cyclic pitch acts against."""
_WASHED_SCALES = {"root_edge_moment_mean": 0.4, "root_edge_moment_tilt": 0.3, "root_edge_moment_yaw": 0.3}
"""Deviation behind a washout over that before it, where the weight of the blades or the torque makes the latter."""

# ---- readers ----


class Sensors:
    """Sensors with a memory: wind vane, anemometer, wind estimator, pitch for its rate."""

    wind_speed: float  #: filtered reading of the nacelle's anemometer [m/s]
    yaw_error: float  #: filtered reading of the nacelle's vane [rad]
    pitch: list[float]  #: of each blade now [rad]
    pitch_before: list[float]  #: and a control step before [rad]
    dt: float  #: length of that step [s], infinite before the first one

    def __init__(self, estimator: WindEstimator | None = None):
        self.estimator: Any = estimator
        self._anemometer = NacelleAnemometer()

    def reset(self, signals: Signals) -> None:
        """Start the filters in steady state."""
        wind = signals["wind_x"], signals["wind_y"], signals["yaw_error"]
        self.wind_speed, self.yaw_error = self._anemometer.reset(*wind)
        self.pitch_before = self.pitch = signals["pitch"].tolist()
        self.dt = math.inf
        if self.estimator is not None:
            self.estimator.start(signals)

    def advance(self, signals: Signals, dt: float) -> None:
        """Let the filters take the signals of a step of length ``dt`` [s]."""
        wind = signals["wind_x"], signals["wind_y"], signals["yaw_error"]
        self.wind_speed, self.yaw_error = self._anemometer.update(*wind, dt)
        if self.estimator is not None:
            self.estimator.update(signals, dt)
        self.pitch_before, self.pitch, self.dt = self.pitch, signals["pitch"].tolist(), dt


class Situation:
    """All that can be observed at an instant of an `wt_gym.envs.operation.Operation`; readers of channels take it."""

    signals: Signals  #: readings of the agent
    action: np.ndarray  #: shape (n_act,), the last one
    offsets: np.ndarray | None = None  #: shape (n_signals,), of the sensors, at a start

    def __init__(self, operation: Any, sensors: Sensors):

        self.operation, self.sensors = operation, sensors


@dataclass(frozen=True)
class Observed:
    """A channel and how it is read: a signal of the simulator, a coordinate of one in the fixed frame, or computed.

    Attributes
    ----------
    signal : str
        Of the simulator; with a ``part`` without the number of the blade.
    part : int, optional
        Place in `wt_gym.control.sensors.FIXED_FRAME`.
    function : callable, optional
        Of a `Situation`, at the top level of a module, so that an observer can be pickled.
    index : int, optional
        Place among the values that the function gives at once.
    """

    channel: Channel
    signal: str = ""
    part: int | None = None
    function: Callable[[Situation], Any] | None = None
    index: int | None = None
    estimates: bool = False  #: the function needs the wind estimator
    circular: bool = False  #: it is a direction: with noise it is wrapped around the circle
    washed: bool = False  #: it passes a high-pass filter


def _mean(of_blades: Sequence[float] | np.ndarray) -> float:
    """Mean of one number a blade; of so few, numpy's own is slow."""
    return float(np.add.reduce(of_blades)) / len(of_blades)


def _states(situation: Situation) -> list[float]:
    """1 in the state of the supervisor and 0 in the others, mean wind [m/s], set point [-], share of the torque [-]."""
    supervisor = situation.operation.supervisor
    present = [float(supervisor.state_index == k) for k in range(len(STATES))]
    return [*present, supervisor.mean_wind, supervisor.set_point, supervisor.load]


def _dead_band(situation: Situation) -> tuple[float, float]:
    """Yaw error behind the slow filter of the dead-band controller [rad], direction in which it turns the nacelle."""
    drive = situation.operation.yaw_drive
    return drive.slow_error, float(drive.turning)


def _disturbances(situation: Situation) -> np.ndarray:
    """Knowledge of the linear optimal pitch of the base controller."""
    result: np.ndarray = situation.operation.known_disturbances()
    return result


def _azimuth_sin(situation: Situation) -> float:
    return math.sin(situation.signals["azimuth"])


def _azimuth_cos(situation: Situation) -> float:
    return math.cos(situation.signals["azimuth"])


def out_of_plane_moments(situation: Situation) -> list[float]:
    """Out-of-plane root moments of coned blades that do not pitch [N m]."""
    signals, moments = situation.signals, []
    for b in range(signals.n_blades):
        pitch = signals["pitch"].item(b)
        flap, edge = signals["root_flap_moment"].item(b), signals["root_edge_moment"].item(b)
        moments.append(float(flap * math.cos(pitch) - edge * math.sin(pitch)))
    return moments


def _out_of_plane_fixed_frame(situation: Situation) -> np.ndarray:
    """Out-of-plane root moments in the frame that does not turn [N m]."""
    return to_fixed_frame(out_of_plane_moments(situation), situation.signals["azimuth"])


def _pitch_rates(situation: Situation) -> list[float]:
    """Rates of the blades over the last step [rad/s]."""
    sensors = situation.sensors
    return [float((now - before) / sensors.dt) for now, before in zip(sensors.pitch, sensors.pitch_before, strict=True)]


def _mean_pitch_rate(situation: Situation) -> float:
    sensors = situation.sensors
    return _mean(np.subtract(sensors.pitch, sensors.pitch_before)) / sensors.dt


def _mean_of(path: str, situation: Situation) -> float:
    return _mean(attrgetter(path)(situation))


_mean_pitch, _mean_pitch_demand = partial(_mean_of, "sensors.pitch"), partial(_mean_of, "operation.demand.pitch")
_controller_pitch = partial(_mean_of, "operation.base.pitch")
_wind_speed, _yaw_error = attrgetter("sensors.wind_speed"), attrgetter("sensors.yaw_error")
_rotor_wind = attrgetter("sensors.estimator.wind")
_previous_action = attrgetter("action")
_pitch_demands, _torque_demand = attrgetter("operation.demand.pitch"), attrgetter("operation.demand.generator_torque")
_controller_torque = attrgetter("operation.base.generator_torque")
_pitch_offsets, _set_point_offset = attrgetter("operation.setpoint.pitch"), attrgetter("operation.setpoint.set_point")
_torque_offset = attrgetter("operation.setpoint.generator_torque")
_residual_share, _residual_mean = attrgetter("operation.residual.share"), attrgetter("operation.residual.mean")


# ---- channels ----


def blade_static_moment(turbine: Turbine) -> float:
    """Root moment of a horizontal blade under its own weight [N m]."""
    structure = turbine.blade.structure
    return float(GRAVITY * np.trapezoid(structure.inertia[:, 0, 0] * structure.station, structure.station))


def _families(names: Iterable[str]) -> str:
    """Names in a line, those that differ by their number alone as one: ``pitch_1 … 3``."""
    last: dict[str, str] = {}
    for name in names:
        stem, _, number = name.rpartition("_")
        last[f"{stem}_1 …" if number.isdecimal() else name] = f" {number}" if number.isdecimal() else ""
    return ", ".join((head + number).replace("_1 … 1", "_1") for head, number in last.items())


class Observable:
    """All channels of a turbine and an action.

    Parameters
    ----------
    features : mapping
        Channels of features by the group that they make: lidar, power reference, dial.
    controller : Controller, optional
        Base controller: the states of its supervisor, its dead band and its linear optimal pitch are observable.
    washout : float, optional
        Time constant of the high-pass filter on loads, deflections and accelerations [s].
    """

    def __init__(
        self,
        turbine: Turbine,
        action: ActionMap,
        features: Mapping[str, list[Observed]] | None = None,
        controller: Controller | None = None,
        residual: ResidualPitch | None = None,
        washout: float | None = None,
    ):
        self._turbine, self._action, self._features = turbine, action, features or {}
        self._washout, self._supervisor = washout, supervisor_of(controller)
        self._yaw_drive, self._linear = yaw_drive_of(controller), linear_part(controller)
        self._fades = residual is not None and residual.fades
        self._washes = residual is not None and residual.washes
        self._parities = {channel.name: channel.parity for channel in channel_table(turbine.n_blades, turbine.n_lines)}

    def choose(self, choice: Sequence[str]) -> tuple[tuple[str, ...], list[Observed]]:
        """Groups and channels that are observed.

        Parameters
        ----------
        choice : sequence of str
            `OBSERVATION_GROUPS` and single channels, in any order; groups come in the order of that tuple, then
            single channels as named.

        Raises
        ------
        ValueError
            If a group or channel is unknown or not there, or none is given.
        """
        choice = choice if isinstance(choice, str) else tuple(choice)
        if isinstance(choice, str) or not choice:
            raise ValueError(f"observation must name groups of {OBSERVATION_GROUPS} or channels, got {choice!r}")
        builders = {
            "rotor": self._rotor, "power": self._power, "pitch": self._pitch, "wind": self._wind,
            "wind_estimate": self._wind_estimate, "blades": self._blades, "fixed_frame": self._fixed_frame,
            "tower": self._tower, "azimuth": self._azimuth, "controller": self._controller, "offsets": self._offsets,
            "previous_action": self._previous_action, "measurable": self._measurable,
            "dead_band": self._dead_band, "disturbances": self._disturbances,
            "own_response": self._own_response, "model_fit": self._model_fit,
            "supervisor": self._states,
        }  # fmt: skip
        channels = {
            name: builders[name]() if name in builders else self._features.get(name, []) for name in OBSERVATION_GROUPS
        }
        groups = tuple(group for group in OBSERVATION_GROUPS if group in choice)
        others = (*self._pitch_forms(), self._every_fixed_frame(), self._out_of_plane(), self._more())
        singles = {c.channel.name: c for several in (*channels.values(), *others) for c in several}
        unknown = [name for name in choice if name not in OBSERVATION_GROUPS and name not in singles]
        if unknown:
            raise ValueError(
                f"observation has {unknown}; must be among the groups {OBSERVATION_GROUPS} and the channels "
                f"{_families(singles)}{did_you_mean(unknown[0], (*OBSERVATION_GROUPS, *singles))}"
            )
        empty = [group for group in groups if not channels[group]]
        if empty:
            raise ValueError(
                f"observation {empty} must be left out: with this action, base controller, power reference or dial "
                "there is no such quantity"
            )
        # groups overlap, and a single channel may be in one of them
        chosen = {observed.channel.name: observed for group in groups for observed in channels[group]}
        for name in dict.fromkeys(choice):
            if name not in OBSERVATION_GROUPS:
                chosen.setdefault(name, singles[name])
        return groups, [self._washed(self._as_it_turns(observed)) for observed in chosen.values()]

    def _washed(self, observed: Observed) -> Observed:
        """Channel of a load behind the washout, with a mean of zero."""
        channel = observed.channel
        cyclic = channel.name.startswith(_CYCLIC) and channel.name.endswith(("_tilt", "_yaw"))
        if self._washout is None or cyclic or not channel.name.startswith(_LOADS):
            return observed
        text = f"{channel.description}, behind a high-pass filter of {self._washout:g} s"
        scale = _WASHED_SCALES.get(channel.name, 1.0) * channel.scale
        return replace(observed, channel=replace(channel, offset=0.0, scale=scale, description=text), washed=True)

    def of_signals(self) -> dict[str, Channel]:
        """Channels by the signal that they read; the mean of the blades as ``NAME_mean``, the anemometer by its name.

        Those of a rotor that turns clockwise. The channel of the mean pitch stands for the pitch of each blade.
        """
        rows = [*self._rotor(), *self._power(), *self._blades(), *self._tower(), *self._more()]
        found = {one.signal: one.channel for one in rows if one.signal}
        found |= {one.channel.name: one.channel for one in self._every_fixed_frame() if one.part == 0}
        found |= {one.channel.name: one.channel for one in self._wind()}
        pitch = self._pitch_forms()[0][0].channel
        return found | {f"pitch_{b + 1}": pitch for b in range(self._turbine.n_blades)}

    def _as_it_turns(self, observed: Observed) -> Observed:
        """Odd channel with the offset and range of a turbine of this rotation."""
        c = observed.channel
        if c.parity == EVEN or self._turbine.rotation == "clockwise":
            return observed
        return replace(observed, channel=replace(c, offset=0.0 - c.offset, low=-c.high, high=-c.low))

    # ---- channels; scales are the standard deviations under the baseline controller in turbulence of class B ----

    def _signal(self, name: str, *row: Any) -> Observed:
        """A signal of the simulator; the row is that of `Channel` behind the name, from the unit to the description."""
        return Observed(replace(Channel(name, *row), parity=self._parities[name]), name)

    def _computed(
        self, function: Callable[[Situation], Any], name: str, *row: Any, parity: int = EVEN, **reading: Any
    ) -> Observed:
        """A function of the situation; the row is that of `Channel` behind the name, the rest goes to `Observed`."""
        return Observed(replace(Channel(name, *row), parity=parity), function=function, **reading)

    def _per_blade(self, function: Callable[[Situation], Any] | None, name: str, *row: Any) -> list[Observed]:
        """The same channel for every blade; without a function the signal of that name."""
        *numbers, text = row
        rows = [(f"{name}_{b + 1}", *numbers, f"{text}, blade {b + 1}") for b in range(self._turbine.n_blades)]
        if function is None:
            return [self._signal(*each) for each in rows]
        return [self._computed(function, *each, index=b) for b, each in enumerate(rows)]

    def _rotor(self) -> list[Observed]:
        drivetrain = self._turbine.drivetrain
        rated, ratio = drivetrain.rated_rotor_speed, drivetrain.gear_ratio
        rows = (("rotor_speed", rated, "rotor speed"), ("generator_speed", rated * ratio, "generator speed, HSS"))
        return [self._signal(name, "rad/s", w, 0.1 * w, 0.0, 2 * w, 1e-3 * w, text) for name, w, text in rows]

    def _torque_row(self) -> tuple[float, float, float]:
        curve = torque_curve(self._turbine)
        torque = curve.rated_power / curve.rated_generator_speed
        return 0.8 * torque, 0.25 * torque, self._action.torque_limits[1]

    def _power(self) -> list[Observed]:
        power = self._turbine.drivetrain.rated_power
        middle, scale, limit = self._torque_row()
        row = ("W", 0.8 * power, 0.25 * power, -power, 2 * power, 5e-3 * power, "electrical power")
        torque = ("N m", middle, scale, -limit, 2 * limit, 0.02 * scale, "generator torque, HSS")
        return [
            self._signal("generator_power", *row),
            self._signal("generator_torque", *torque),
            *self._torque_demand(_torque_demand, "generator_torque_demand", "demanded generator torque, HSS"),
        ]

    def _torque_demand(self, function: Callable[[Situation], Any], name: str, text: str) -> list[Observed]:
        """A demand for torque, where the generator takes one."""
        middle, scale, limit = self._torque_row()
        row = (name, "N m", middle, scale, 0.0, limit, 0.0, text)
        return [self._computed(function, *row)] if self._action.takes_torque else []

    def _pitch(self) -> list[Observed]:
        return self._pitch_forms()[self._action.pitch != "collective"]

    def _pitch_forms(self) -> tuple[list[Observed], list[Observed]]:
        """Pitch as the mean of the blades and of each."""
        low, high = self._action.pitch_limits
        rate, noise = self._action.max_pitch_rate, math.radians(0.05)
        # A servo may overshoot its limits and its greatest rate a little.
        margin = 0.1
        rows: tuple[tuple[Any, ...], ...] = (
            (_mean_pitch, None, "pitch", "rad", 0.1, 0.1, low - margin, high + margin, noise, "blade pitch"),
            (_mean_pitch_rate, _pitch_rates, "pitch_rate", "rad/s", 0.0, 0.15 * rate, -2 * rate, 2 * rate,
             0.02 * rate, "blade pitch rate of the step"),
            (_mean_pitch_demand, _pitch_demands, "pitch_demand", "rad", 0.1, 0.1, low, high, 0.0,
             "demanded blade pitch"),
        )  # fmt: skip
        mean = [self._computed(of_all, *row[:-1], f"{row[-1]}, mean of the blades") for of_all, _, *row in rows]
        return mean, [channel for _, of_one, *row in rows for channel in self._per_blade(of_one, *row)]

    def _wind(self) -> list[Observed]:
        speed = ("wind_speed", "m/s", 12.0, 4.0, 0.0, 60.0, 0.2, "nacelle anemometer, filtered over 1 s")
        error = ("yaw_error", "rad", 0.0, 0.1, -math.pi, math.pi, 0.02, "wind vane, filtered over 5 s")
        return [self._computed(_wind_speed, *speed), self._computed(_yaw_error, *error, parity=ODD, circular=True)]

    def _wind_estimate(self) -> list[Observed]:
        text = "rotor-effective wind, estimated from rotor speed, torque and pitch"
        return [self._computed(_rotor_wind, "rotor_wind", "m/s", 12.0, 4.0, 0.0, 60.0, 0.0, text, estimates=True)]

    def _blade_rows(self) -> tuple[tuple[Any, ...], ...]:
        """Name, unit, offset and scale of a blade, offset and scale of mean and of tilt and yaw, reference, text."""
        tip = 0.1 * self._turbine.blade.length
        flap, edge = reference_flap_moment(self._turbine), blade_static_moment(self._turbine)
        return (
            ("tip_out_of_plane", "m", (0.53, 0.2), (0.53, 0.2), (0.08, 0.075), tip, "tip deflection downwind"),
            ("tip_in_plane", "m", (-0.1, 0.075), (-0.1, 0.025), (0.0, 0.025), tip, "tip deflection in the rotor plane"),
            ("root_flap_moment", "N m", (0.5, 0.18), (0.5, 0.15), (0.07, 0.075), flap, "flapwise root moment"),
            ("root_edge_moment", "N m", (0.0, 0.75), (0.2, 0.1), (0.0, 0.5), edge, "edgewise root moment"),
        )

    def _blades(self) -> list[Observed]:
        return [channel for name, *_ in self._blade_rows() for channel in self._of_each_blade(name)]

    def _of_each_blade(self, signal: str) -> list[Observed]:
        """A signal of `_blade_rows` of every blade."""
        name, unit, (middle, scale), _, _, size, text = next(row for row in self._blade_rows() if row[0] == signal)
        reach = 20 * size if name == "root_edge_moment" else 10 * size
        return self._per_blade(None, name, unit, middle * size, scale * size, -reach, reach, 0.01 * size, text)

    def _fixed_frame(self) -> list[Observed]:
        return self._fixed_frame_of("tip_out_of_plane") + self._fixed_frame_of("root_flap_moment")

    def _every_fixed_frame(self) -> list[Observed]:
        """Mean, tilt and yaw of every signal of the blades."""
        return [channel for name, *_ in self._blade_rows() for channel in self._fixed_frame_of(name)]

    def _fixed_frame_of(self, signal: str) -> list[Observed]:
        """Mean, tilt and yaw of a signal; the azimuth counts in the sense of rotation, hence all are even."""
        name, unit, _, mean, cyclic, size, text = next(row for row in self._blade_rows() if row[0] == signal)
        channels = []
        for k, (part, (middle, scale)) in enumerate(zip(FIXED_FRAME, (mean, cyclic, cyclic), strict=True)):
            row = (unit, middle * size, scale * size, -20 * size, 20 * size, 0.005 * size)
            channel = Channel(f"{name}_{part}", *row, f"{text}, {part} of the blades")
            channels.append(Observed(channel, name, k))
        return channels

    def _out_of_plane(self) -> list[Observed]:
        """Out-of-plane root moments, of each blade and in the fixed frame: what other codes' controllers measure."""
        size, text = reference_flap_moment(self._turbine), "out-of-plane root moment of the blade that does not pitch"
        row = ("N m", 0.5 * size, 0.2 * size, -10 * size, 10 * size, 0.01 * size, text)
        channels = self._per_blade(out_of_plane_moments, "root_out_of_plane_moment", *row)
        for k, (part, middle, scale) in enumerate(zip(FIXED_FRAME, (0.5, 0.07, 0.0), (0.15, 0.1, 0.1), strict=True)):
            row = ("N m", middle * size, scale * size, -20 * size, 20 * size, 0.005 * size, f"{text}, {part}")
            name = f"root_out_of_plane_moment_{part}"
            channels.append(self._computed(_out_of_plane_fixed_frame, name, *row, index=k))
        return channels

    def _tower(self) -> list[Observed]:
        h, displacement, acceleration = self._turbine.hub_height, [], []
        for axis, middle, scale, rate in (("fore-aft", 3.1e-3, 9e-4, 0.11), ("side-side", -5e-4, 2.5e-4, 0.065)):
            row = ("m", middle * h, scale * h, -0.1 * h, 0.1 * h, 5e-5 * h, f"tower-top position {axis}")
            name = axis.replace("-", "_")
            displacement.append(self._signal(f"tower_top_{name}", *row))
            row = ("m/s^2", 0.0, rate, -20.0, 20.0, 0.01, f"nacelle acceleration {axis}")
            acceleration.append(self._signal(f"nacelle_acceleration_{name}", *row))
        return displacement + acceleration

    def _azimuth(self) -> list[Observed]:
        row, text = ("-", 0.0, 0.7, -1.0, 1.0, 0.0), "of the azimuth of blade 1 (0 = up)"
        return [
            self._computed(_azimuth_sin, "azimuth_sin", *row, f"sine {text}"),
            self._computed(_azimuth_cos, "azimuth_cos", *row, f"cosine {text}"),
        ]

    def _controller(self) -> list[Observed]:
        if not self._action.needs_controller:
            return []
        row = ("rad", 0.1, 0.1, *self._action.pitch_limits, 0.0, "pitch that the base controller demands")
        torque = self._torque_demand(_controller_torque, "controller_torque", "torque that it demands, HSS")
        return [self._computed(_controller_pitch, "controller_pitch", *row), *torque]

    def _offsets(self) -> list[Observed]:
        action, channels = self._action, []
        if action.mode != "residual":
            return []
        if "pitch" in action.components:
            limits, text = action.pitch_high[: action.n_pitch], "residual pitch, coordinate {} of the action"
            channels += [
                self._computed(_pitch_offsets, f"pitch_offset_{k}", "rad", 0.0, 0.5 * limit, -limit, limit, 0.0,
                               text.format(k), index=k - 1)
                for k, limit in enumerate(limits, start=1)
            ]  # fmt: skip
        for component, unit, function, text in (
            ("torque", "N m", _torque_offset, "residual torque"),
            ("set_point", "-", _set_point_offset, "residual set point of the rotor speed"),
        ):
            if component in action.components:
                limit = action.spans[component]
                row = (f"{component}_offset", unit, 0.0, 0.5 * limit, -limit, limit, 0.0, text)
                channels.append(self._computed(function, *row))
        return channels

    def _dead_band(self) -> list[Observed]:
        if self._yaw_drive is None or not self._action.needs_controller:
            return []
        scale, text = 0.5 * self._yaw_drive.dead_band, "direction in which the base controller turns the nacelle"
        error = ("dead_band_error", "rad", 0.0, scale, -math.pi, math.pi, 0.0,
                 "yaw error behind the slow filter of the base controller's dead band")  # fmt: skip
        return [
            self._computed(_dead_band, *error, parity=ODD, index=0, circular=True),
            self._computed(_dead_band, "dead_band_turning", "-", 0.0, 1.0, -1.0, 1.0, 0.0, text, parity=ODD, index=1),
        ]

    def _states(self) -> list[Observed]:
        """Channel of each state of the supervisor, its mean wind, set point and load."""
        if self._supervisor is None or not self._action.needs_controller:
            return []
        wind = "mean wind by which the base controller starts, stops and is held back"
        rows = [
            *((f"state_{name}", "-", 0.0, 1.0, 0.0, 1.0, 0.0,
               f"1 in the state {name.replace('_', ' ')} of the base controller, else 0") for name in STATES),
            ("mean_wind", "m/s", 15.0, 8.0, 0.0, 60.0, 0.0, wind),
            ("set_point", "-", 1.0, 0.2, 0.0, 1.0, 0.0, "set point of the rotor speed over rated"),
            ("load_share", "-", 1.0, 0.5, 0.0, 1.0, 0.0, "share of the torque that a start-up has reached"),
        ]  # fmt: skip
        return [self._computed(_states, *row, index=k) for k, row in enumerate(rows)]

    def _previous_action(self) -> list[Observed]:
        row, parities = ("-", 0.0, 1.0, -1.0, 1.0, 0.0), self._action.parity.tolist()
        return [
            self._computed(_previous_action, f"previous_{name}", *row, f"last action, component {name}",
                           parity=int(parities[k]), index=k)
            for k, name in enumerate(self._action.names)
        ]  # fmt: skip

    def _measurable(self) -> list[Observed]:
        """Quantities that a controller with the Bladed interface reads or remembers: all leave with an exported agent.

        On top of a controller, in coordinates that do not turn with the rotor, moments have them too, unless the
        actions are those of each blade.
        """
        still = self._action.mode == "residual" and self._action.pitch != "individual" and self._turbine.n_blades > 2
        of_blades, moments = self._fixed_frame_of if still else self._of_each_blade, []
        for name in ("root_flap_moment", "root_edge_moment"):
            moments += of_blades(name)
        accelerations = [one for one in self._tower() if one.channel.name.startswith("nacelle_acceleration")]
        return [
            *self._rotor(), *self._power(), *self._pitch(), *self._wind(), *moments, *accelerations, *self._azimuth(),
            *self._controller(), *self._offsets(),
        ]  # fmt: skip

    def _disturbances(self) -> list[Observed]:
        """Results of the linear optimal pitch of the base controller from its readings."""
        if self._linear is None:
            return []
        design, text = self._linear.design, "pitch that the linear optimal pitch asks for"
        rows: list[tuple[Any, ...]] = [
            (f"disturbance_{name}_{k + 1}", "-", 0.0, scale, -20.0, 20.0, 0.0,
             f"disturbance of {name}, over its scale, {about}")
            for name in design.outputs for k, (scale, about) in enumerate(self._disturbed_bins())
        ]  # fmt: skip
        limit, row = 10.0 * design.limit, (0.0, math.radians(1.0))
        rows += [(f"linear_pitch_{name}", "rad", *row, -limit, limit, 0.0, f"{name} {text}") for name in FIXED_FRAME]
        share, schedule = "share in which the linear optimal pitch acts", "slow pitch that chooses between its designs"
        rows.append(("linear_pitch_share", "-", 0.5, 0.5, 0.0, 1.0, 0.0, share))
        rows.append(("linear_pitch_schedule", "rad", 0.1, 0.1, *self._action.pitch_limits, 0.0, schedule))
        placed = list(enumerate(rows))
        if not isinstance(self._linear, LinearOptimalPitch):  # an observer asks for nothing
            del placed[-2 - len(FIXED_FRAME) : -2]
        return [self._computed(_disturbances, *row, index=k) for k, row in placed]

    def _disturbed_bins(self) -> list[tuple[float, str]]:
        """Scale and meaning of the disturbance in each bin of delays: a random walk moves by the root of the time."""
        assert self._linear is not None
        interval, rows = self._linear.design.interval, []
        for k, (first, last) in enumerate(self._linear.bins):
            text = f"mean of {first * interval:g} to {last * interval:g} s ago"
            if k == 0:
                rows.append((1.0, text))
                continue
            earlier = self._linear.bins[k - 1]
            apart = 0.5 * interval * (first + last - sum(earlier))
            rows.append((min(math.sqrt(apart), 1.0), f"change since the {text}"))
        return rows

    def _own_response(self) -> list[Observed]:
        """Effect of past offsets on what is measured, and motion of the tower top."""
        if self._linear is None:
            return []
        design, natural = self._linear.design, self._linear.natural
        rows: list[tuple[Any, ...]] = [
            (f"response_{name}", "-", 0.0, 1.0, -20.0, 20.0, 0.0, f"what offsets did to {name}, over its scale")
            for name in design.outputs
        ]
        for power, unit, what in ((1, "m/s", "velocity"), (2, "m", "displacement")):
            for k, axis in enumerate(("fore_aft", "side_side")):
                scale = float(design.scale[3 + k] / natural[k] ** power)
                text = f"{what} of the tower top, {axis.replace('_', '-')}, from accelerations"
                rows.append((f"tower_{what}_{axis}", unit, 0.0, scale, -20.0 * scale, 20.0 * scale, 0.0, text))
        first = len(design.outputs) * (len(self._linear.bins) + 2) + len(FIXED_FRAME) + 2
        return [self._computed(_disturbances, *row, index=k) for k, row in enumerate(rows, start=first)]

    def _model_fit(self) -> list[Observed]:
        """Fit of the model of the linear optimal pitch, where readings are late, drives slow or gauges dead."""
        if not isinstance(self._linear, LinearOptimalPitch):
            return []
        outputs = self._linear.design.outputs
        first = len(outputs) * len(self._linear.bins) + len(FIXED_FRAME) + 2
        rows = [
            (f"model_{part}_{name}", unit, middle, scale, -limit, limit, 0.0,
             f"{part} that the model of {name} leaves out")
            for part, unit, middle, scale, limit in (("gain", "-", -0.7, 0.5, 20.0), ("lag", "s", 0.1, 0.1, 10.0))
            for name in outputs
        ]  # fmt: skip
        return [self._computed(_disturbances, *row, index=k) for k, row in enumerate(rows, start=first)]

    def _more(self) -> list[Observed]:
        """Channels of no group."""
        moment, channels = reference_tower_moment(self._turbine), []
        if self._fades:
            row: tuple[Any, ...] = ("-", 0.5, 0.5, 0.0, 1.0, 0.0, "share of residual pitch that acts")
            channels.append(self._computed(_residual_share, "residual_share", *row))
        if self._washes:
            limit = 2.0 * float(self._action.pitch_high[0])
            row = ("rad", 0.0, 0.25 * limit, -limit, limit, 0.0, "mean of the blades' residual pitch that acts")
            channels.append(self._computed(_residual_mean, "residual_mean", *row))
        for axis, middle, scale, text in (
            ("fore_aft", 0.55, 0.15, "tower-base moment, positive for a downwind push"),
            ("side_side", 0.055, 0.04, "tower-base moment about the wind's direction"),
        ):
            row = ("N m", middle * moment, scale * moment, -10 * moment, 10 * moment, 0.005 * moment, text)
            channels.append(self._signal(f"tower_base_{axis}_moment", *row))
        return channels
