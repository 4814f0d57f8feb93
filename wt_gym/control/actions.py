"""From a normalized action to the demands on pitch drives, yaw drive and generator, and back."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wt_gym.base.errors import ActionError, did_you_mean
from wt_gym.control.operating_point import operating_point, torque_curve
from wt_gym.control.sensors import FIXED_FRAME, harmonic_of_blades, to_blades
from wt_gym.turbines import Turbine

ACTION_MODES = ("rate", "absolute", "residual")
RESIDUAL_FORMS = ("rate", "offset")
PITCH_FORMS = ("collective", "individual", "fixed-frame", "cyclic")
_TURNING = ("fixed-frame", "cyclic")
COMPONENTS = ("pitch", "yaw", "torque", "set_point")
SPANS = (
    "pitch", "pitch_mean", "pitch_rate", "yaw_rate", "torque", "torque_rate", "set_point", "set_point_rate",
)  # fmt: skip
ROUNDING = 2.0**-14
"""By which an action may leave [-1, 1]: rounding of float32, no more.

A wrapper that takes actions in [low, high], as Gymnasium's `RescaleAction`, computes (x - c) / g with
g = (high - low) / 2 and c = low + g. With m = max(|low|, |high|), float32 holds x and c to 2^-24 m each. Divided by g,
both together are 2^-22 m / (high - low). The bound is that of ranges whose distance from zero is 256 times their width.
"""
CYCLIC = math.radians(4.0)
"""Greatest pitch in tilt and yaw, and greatest residual pitch [rad]."""
RESIDUAL_PITCH_RATE = math.radians(1.5)
"""Greatest rate of residual pitch [rad/s]; the baseline controller uses 0.6 deg/s in the mean."""
RESIDUAL_TORQUE, RESIDUAL_TORQUE_RATE = 0.1, 0.05
"""Greatest residual torque and its rate, over the rated torque [-], [1/s]."""
SET_POINT, SET_POINT_RATE = 0.3, 0.02
"""Greatest residual set point of the rotor speed and its rate, over rated speed [-], [1/s]."""
RESIDUAL_OVERLOAD = 1.03
"""Electrical power, over the rated one, beyond which residual torque does not lift it [-]: a lasting offset would load
the generator with more than it is made for. The controllers themselves reach 1.02 in gusts."""
MARGIN = math.radians(5.0)
"""By which the range of absolute pitch goes beyond the operating points [rad]."""


@dataclass(frozen=True)
class Demand:
    """Demand on the actuators."""

    pitch: NDArray[np.float64]  #: blade pitch [rad], shape (n_blades,)
    yaw_rate: float  #: rate of the nacelle about the vertical, counter-clockwise from above [rad/s]
    generator_torque: float  #: torque on the high-speed shaft [N m]


@dataclass(frozen=True)
class AgentSetpoint:
    """Setpoint of an agent, in the coordinates of its action; offsets in mode "residual"."""

    pitch: NDArray[np.float64]  #: of all blades, of each, mean, tilt and yaw, or tilt and yaw [rad], shape (n_pitch,)
    yaw_rate: float  #: [rad/s]
    generator_torque: float  #: [N m]
    set_point: float = 0.0  #: of the rotor speed, over rated [-]; an offset from that of a supervisor


class ActionMap:
    """Meaning of the components of an action in [-1, 1].

    Components are, in this order, pitch, yaw (none for a turbine whose greatest yaw rate is 0), generator torque (none
    for a generator that is a damper), and the set point of the rotor speed, as far as they are chosen; the last only
    where it is named, of residual actions on a supervisor, whose set point it moves. Pitch has one component
    ("collective"), one a blade ("individual"), mean, tilt and yaw ("fixed-frame", see `coleman`), or tilt and yaw alone
    on top of a controller ("cyclic"). Of those in the fixed frame the blades get their share at every step of the
    simulator, with an azimuth that leads by the delay of the drives.

    - ``"rate"``: rates of the demand, held over a control step: it moves by ``action * rate * control_dt``.
    - ``"absolute"``: the demand itself; pitch from the operating points of the winds and 5 degrees beyond them on both
      sides, within the limits, torque from 0 to the largest. Tilt and yaw are the demands themselves about nothing.
    - ``"residual"``: an offset from the demand of a base controller: its rate, or with the residual form ``"offset"``
      the offset itself, to which the current one moves at no more than the greatest rate. Offsets end at their limits.

    The yaw component is a rate in all modes, because a yaw drive turns at a rate and holds otherwise. Demands end at
    the limits of the turbine. What an action has no component for is left to the controller.

    Parameters
    ----------
    control_dt : float
        Control step [s].
    mode : {"rate", "absolute", "residual"}
    pitch : {"collective", "individual", "fixed-frame", "cyclic"}
    components : sequence of {"pitch", "yaw", "torque", "set_point"}, optional
        By default the first three, as far as the turbine has them.
    spans : mapping, optional
        Other spans than the default ones: "pitch_rate" [rad/s], "yaw_rate" [rad/s], "torque_rate" [N m/s]: greatest
        rates; "pitch" [rad], "torque" [N m]: limits of the offsets (of tilt and yaw in all modes); "pitch_mean" [rad]:
        that of a residual mean, collective or in the fixed frame, by default as for tilt and yaw; "set_point" [-] and
        "set_point_rate" [1/s]: limit and greatest rate of the residual set point, over rated speed.
    wind_speeds : (float, float), optional
        Range of the mean winds, for mode "absolute" [m/s]; by default that in which the turbine operates.
    delay : float
        Time from a demand to the pitch, by which the azimuth leads [s]; see
        `wt_gym.simulation.drivetrain.drives.pitch_delay`.
    residual : {"rate", "offset"}
        Form of the actions of mode "residual".

    Attributes
    ----------
    low, high : numpy.ndarray, shape (n,)
        Physical value of an action component at -1 and +1.
    parity : numpy.ndarray, shape (n,)
        +1 or -1: sign with which each component goes into that of the mirror image, in which the rotor turns the other
        way. Only yaw changes it: pitch in the fixed frame is that of the azimuth in the sense of rotation.
    takes_torque : bool
        Whether the generator takes a demand; the demand for a damper is 0.
    spans : dict
        By the names of the parameter `spans`.

    Raises
    ------
    ValueError
        If a choice is none of those allowed.
    """

    def __init__(  # noqa: PLR0913
        self,
        turbine: Turbine,
        control_dt: float,
        mode: str = "rate",
        pitch: str = "collective",
        components: Sequence[str] | None = None,
        spans: Mapping[str, float] | None = None,
        wind_speeds: tuple[float, float] | None = None,
        delay: float = 0.0,
        residual: str = "rate",
    ):
        named = (
            ("action_mode", mode, ACTION_MODES),
            ("pitch", pitch, PITCH_FORMS),
            ("residual", residual, RESIDUAL_FORMS),
        )
        for name, value, allowed in named:
            if value not in allowed:
                raise ValueError(f"{name} must be one of {allowed}, got {value!r}{did_you_mean(value, allowed)}")
        if residual != "rate" and mode != "residual":
            raise ValueError(f"residual={residual!r} needs action_mode='residual', got {mode!r}")
        if not control_dt > 0:
            raise ValueError(f"control_dt must be positive, got {control_dt!r} s")
        self.mode, self.pitch, self.control_dt, self.delay = mode, pitch, float(control_dt), float(delay)
        self.residual = residual
        self.n_blades = turbine.n_blades
        if pitch in _TURNING and self.n_blades < 3:
            raise ValueError(f"pitch={pitch!r} needs three blades or more, the turbine has {self.n_blades}")
        if pitch == "cyclic" and mode != "residual":
            raise ValueError(f"pitch='cyclic' has no mean of its own: it needs action_mode='residual', got {mode!r}")
        self.takes_torque = turbine.drivetrain.takes_torque
        if components is not None and "set_point" in components and mode != "residual":
            raise ValueError(f"action_components 'set_point' needs action_mode='residual', got {mode!r}")
        self.components = self._chosen(components, turbine)
        self.has_yaw = "yaw" in self.components
        self.pitch_limits = (turbine.pitch.min_pitch, turbine.pitch.max_pitch)
        self.torque_limits = (0.0, turbine.drivetrain.max_generator_torque)
        self.max_pitch_rate, self.max_torque_rate = turbine.pitch.max_rate, turbine.drivetrain.max_torque_rate
        self.max_yaw_rate = turbine.nacelle.max_yaw_rate
        drive = turbine.drivetrain
        self._most_shaft_power = RESIDUAL_OVERLOAD * drive.rated_power / (drive.gear_ratio * drive.generator_efficiency)
        self.spans = self._chosen_spans(spans, turbine)
        self._coordinates = {
            "collective": ("pitch",),
            "individual": tuple(f"pitch_{b + 1}" for b in range(self.n_blades)),
            "fixed-frame": tuple(f"pitch_{name}" for name in FIXED_FRAME),
            "cyclic": tuple(f"pitch_{name}" for name in FIXED_FRAME[1:]),
        }[pitch]
        self.n_pitch = len(self._coordinates)
        self.pitch_low, self.pitch_high = self._pitch_range()
        rows = self._rows(turbine, wind_speeds)
        self.names, self.units, low, high = zip(*rows, strict=True)
        self.low, self.high, self.size = np.array(low), np.array(high), len(self.names)
        self._torque_at = -2 if "set_point" in self.components else -1
        self.parity = np.array([-1.0 if name == "yaw_rate" else 1.0 for name in self.names])
        self.low.flags.writeable = self.high.flags.writeable = self.parity.flags.writeable = False
        # what a step needs, as numbers: arrays of three are slow
        self._ranges = list(zip(self.low.tolist(), (self.high - self.low).tolist(), strict=True))
        limit = self.spans["torque"]
        self._torque_ends = (-limit, limit) if mode == "residual" else self.torque_limits
        self._pitch_ends = list(zip(self.pitch_low.tolist(), self.pitch_high.tolist(), strict=True))

    # ---- what the components mean ----

    @property
    def needs_controller(self) -> bool:
        """True where the action is added to a base controller."""
        torque = self.takes_torque and "torque" not in self.components
        return self.mode == "residual" or "pitch" not in self.components or torque

    @property
    def turns_with_rotor(self) -> bool:
        """True where the demand changes with the azimuth within a control step."""
        return self.pitch in _TURNING and "pitch" in self.components

    @property
    def n_mean(self) -> int:
        """Number of pitch coordinates, the first ones, whose mean is that of the blades: none of tilt and yaw."""
        return {"fixed-frame": 1, "cyclic": 0}.get(self.pitch, self.n_pitch)

    def _chosen(self, components: Sequence[str] | None, turbine: Turbine) -> tuple[str, ...]:
        if components is None:
            components = ("pitch", "yaw", "torque") if self.takes_torque else ("pitch", "yaw")
        components = components if isinstance(components, str) else tuple(components)
        unknown = [name for name in components if name not in COMPONENTS]
        if unknown or isinstance(components, str) or not len(components):
            raise ValueError(f"action_components must name some of {COMPONENTS}, got {components!r}")
        if "torque" in components and not self.takes_torque:
            raise ValueError(
                f"action_components is {components!r}, but the generator is a damper, whose torque follows its speed: "
                "leave out 'torque', or take generator='torque'"
            )
        chosen = tuple(name for name in COMPONENTS if name in components)
        if turbine.nacelle.max_yaw_rate > 0.0:
            return chosen
        if chosen == ("yaw",):
            raise ValueError("action_components is ('yaw',), but this turbine has no yaw drive (greatest rate 0)")
        return tuple(name for name in chosen if name != "yaw")

    def _chosen_spans(self, spans: Mapping[str, float] | None, turbine: Turbine) -> dict[str, float]:
        """Spans of this mode, with those that the user wants otherwise."""
        curve = torque_curve(turbine)
        rated_torque = curve.rated_power / curve.rated_generator_speed
        residual = self.mode == "residual"
        chosen = {
            "pitch": CYCLIC,
            "pitch_rate": RESIDUAL_PITCH_RATE if residual or self.pitch == "fixed-frame" else self.max_pitch_rate,
            "yaw_rate": self.max_yaw_rate,
            "torque": RESIDUAL_TORQUE * rated_torque,
            "torque_rate": RESIDUAL_TORQUE_RATE * rated_torque if residual else self.max_torque_rate,
            "set_point": SET_POINT,
            "set_point_rate": SET_POINT_RATE,
        }
        most = {"pitch_rate": self.max_pitch_rate, "yaw_rate": self.max_yaw_rate, "torque_rate": self.max_torque_rate}
        for name, value in (spans or {}).items():
            if name not in SPANS:
                raise ValueError(f"action_spans has no {name!r}; there are {SPANS}")
            if name in ("torque", "torque_rate") and not self.takes_torque:
                raise ValueError(f"action_spans[{name!r}]: the generator is a damper and takes no torque")
            limit = most.get(name, math.inf)
            if not 0.0 < value <= limit or not math.isfinite(value):
                allowed = f"positive and at most {limit:.6g}" if name in most else "positive and finite"
                raise ValueError(f"action_spans[{name!r}] must be {allowed}, got {value!r}")
            chosen[name] = float(value)
        return {"pitch_mean": chosen["pitch"]} | chosen

    def _pitch_range(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Limits of the pitch coordinates (n_pitch,) [rad]."""
        around = np.full(self.n_pitch, self.spans["pitch"])
        if self.pitch in ("collective", "fixed-frame"):
            around[0] = self.spans["pitch_mean"]
        low, high = -around, around
        if self.mode != "residual":
            own = 1 if self.pitch == "fixed-frame" else self.n_pitch  # tilt and yaw lie about nothing
            low[:own], high[:own] = self.pitch_limits
        return low, high

    def _rows(self, turbine: Turbine, wind_speeds: tuple[float, float] | None) -> list[tuple[str, str, float, float]]:
        """Name, unit, and value at -1 and +1 of each component."""
        spans, rows = self.spans, []
        suffix = "_offset_rate" if self.mode == "residual" else "_rate"
        torque = (f"generator_torque{suffix}", "N m/s", -spans["torque_rate"], spans["torque_rate"])
        pitch = [(f"{name}{suffix}", "rad/s", -spans["pitch_rate"], spans["pitch_rate"]) for name in self._coordinates]
        if self.mode == "absolute":
            low, high, top = self._operating_range(turbine, wind_speeds)
            pitch = [(name, "rad", low, high) for name in self._coordinates]
            if self.pitch == "fixed-frame":
                pitch[1:] = [(name, "rad", -spans["pitch"], spans["pitch"]) for name in self._coordinates[1:]]
            torque = ("generator_torque", "N m", 0.0, top)
        elif self.residual == "offset":
            ends = zip(self._coordinates, self.pitch_low.tolist(), self.pitch_high.tolist(), strict=True)
            pitch = [(f"{name}_offset", "rad", low, high) for name, low, high in ends]
            torque = ("generator_torque_offset", "N m", -spans["torque"], spans["torque"])
        set_point = ("set_point_offset_rate", "1/s", -spans["set_point_rate"], spans["set_point_rate"])
        if self.residual == "offset":
            set_point = ("set_point_offset", "-", -spans["set_point"], spans["set_point"])
        if "pitch" in self.components:
            rows += pitch
        if self.has_yaw:
            rows.append(("yaw_rate", "rad/s", -spans["yaw_rate"], spans["yaw_rate"]))
        if "torque" in self.components:
            rows.append(torque)
        if "set_point" in self.components:
            rows.append(set_point)
        return rows

    def _operating_range(self, turbine: Turbine, wind_speeds: tuple[float, float] | None) -> tuple[float, float, float]:
        """Lowest and highest absolute pitch [rad], highest torque [N m]."""
        low, high = wind_speeds or (turbine.cut_in, turbine.cut_out)
        least_wind = max(turbine.cut_in, 0.1)  # below cut-in the turbine stands ready as at cut-in
        winds = np.linspace(max(low, least_wind), max(high, least_wind), 25)
        points = [operating_point(turbine, float(v)) for v in winds]
        pitches = [point.pitch for point in points]
        least, most = self.pitch_limits
        highest = most if high > turbine.cut_out else min(max(pitches) + MARGIN, most)  # beyond cut-out blades feather
        return max(min(pitches) - MARGIN, least), highest, self.torque_limits[1]

    # ---- from actions to demands ----

    def validate(self, action: ArrayLike) -> NDArray[np.float64]:
        """Return an action (size,) as a copy in float64, or refuse it.

        Values beyond the bounds by rounding (`ROUNDING`, 6.1e-5) are put on them exactly. Nothing farther beyond is
        clipped.

        Raises
        ------
        ActionError
            If the shape is wrong or a component is not finite or outside [-1, 1].
        """
        try:
            values = np.array(action, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise ActionError(f"action must be {self.size} numbers {self.names}, got {action!r}") from error
        if values.shape != (self.size,):
            raise ActionError(f"action must have shape ({self.size},) for {self.names}, got shape {values.shape}")
        numbers = values.tolist()
        # The comparison is written so that NaN fails it.
        refused = [i for i, value in enumerate(numbers) if not abs(value) <= 1.0 + ROUNDING]
        if refused:
            wrong = ", ".join(f"{self.names[i]} (component {i}) = {values[i]}" for i in refused)
            raise ActionError(f"action components must be finite and within [-1, 1], got {wrong}")
        return np.array([min(max(value, -1.0), 1.0) for value in numbers])

    def start(self, demand: Demand) -> AgentSetpoint:
        """Setpoint with which an episode starts from a demand."""
        if self.mode == "residual":
            return AgentSetpoint(np.zeros(self.n_pitch), 0.0, 0.0)
        pitch = np.asarray(demand.pitch, dtype=np.float64)
        mean = pitch[0] + (pitch - pitch[0]).mean()  # exactly that of equal blades
        if self.pitch == "collective":
            pitch = np.array([mean])
        elif self.pitch == "fixed-frame":
            pitch = np.array([mean, 0.0, 0.0])
        return AgentSetpoint(pitch.copy(), 0.0, demand.generator_torque)

    def decode(self, action: NDArray[np.float64], previous: AgentSetpoint) -> AgentSetpoint:
        """Setpoint at the end of the next control step, from a validated action (size,) and the setpoint before."""
        pairs = zip(action.tolist(), self._ranges, strict=True)
        physical = [low + 0.5 * (value + 1.0) * span for value, (low, span) in pairs]
        pitch, yaw_rate, torque, set_point = previous.pitch, 0.0, previous.generator_torque, previous.set_point
        if "pitch" in self.components:
            rows = zip(pitch.tolist(), physical[: self.n_pitch], self._pitch_ends, strict=True)
            pitch = np.array([self._moved("pitch_rate", now, value, *ends) for now, value, ends in rows])
        if self.has_yaw:
            yaw_rate = physical[self.names.index("yaw_rate")]
        if "torque" in self.components:
            torque = self._moved("torque_rate", torque, physical[self._torque_at], *self._torque_ends)
        if "set_point" in self.components:
            limit = self.spans["set_point"]
            set_point = self._moved("set_point_rate", set_point, physical[-1], -limit, limit)
        return AgentSetpoint(pitch, yaw_rate, torque, set_point)

    def _moved(self, rate: str, now: float, value: float, low: float, high: float) -> float:
        """Component at the end of a control step, from that before and the physical value of its action."""
        if self.residual == "offset":  # it moves to the offset at no more than the greatest rate
            reach = self.spans[rate] * self.control_dt
            return now + min(max(value - now, -reach), reach)
        return min(max(value if self.mode == "absolute" else now + value * self.control_dt, low), high)

    def demand(
        self, setpoint: AgentSetpoint, base: Demand | None = None, azimuth: float = 0.0, rotor_speed: float = 0.0
    ) -> Demand:
        """Demand on the drives.

        It needs the demand of the base controller where `needs_controller` says so, and for pitch in the fixed frame
        the azimuth of blade 1 [rad] and the rotor speed [rad/s].
        """
        # numbers one by one: arrays of three are slow
        pitch, yaw_rate, torque = setpoint.pitch.tolist(), setpoint.yaw_rate, setpoint.generator_torque
        if self.pitch == "fixed-frame":
            pitch = to_blades(pitch, azimuth + rotor_speed * self.delay, self.n_blades)
        elif self.pitch == "cyclic":
            cosine, sine = pitch
            pitch = harmonic_of_blades(cosine, sine, azimuth + rotor_speed * self.delay, self.n_blades)
        residual = self.mode == "residual"
        demand: Any = base  # which is not asked where no controller runs; a cast would take time
        if len(pitch) != self.n_blades:
            pitch *= self.n_blades
        if "pitch" not in self.components:
            pitch = demand.pitch.tolist()
        elif residual:
            pitch = [of_controller + own for of_controller, own in zip(demand.pitch.tolist(), pitch, strict=True)]
        if not self.takes_torque:
            torque = 0.0
        elif "torque" not in self.components:
            torque = demand.generator_torque
        elif residual:
            torque = self._residual_torque(demand.generator_torque, torque, rotor_speed)
        if base is not None and (residual or not self.has_yaw):
            yaw_rate += base.yaw_rate
        low, high = self.pitch_limits
        return Demand(
            np.array([min(max(angle, low), high) for angle in pitch]),
            min(max(yaw_rate, -self.max_yaw_rate), self.max_yaw_rate),
            min(max(torque, self.torque_limits[0]), self.torque_limits[1]),
        )

    def _residual_torque(self, base: float, offset: float, rotor_speed: float) -> float:
        """Torque of the controller and the agent [N m]; beyond `RESIDUAL_OVERLOAD` the controller alone may load."""
        if rotor_speed <= 0.0:
            return base + offset
        return min(base + offset, max(base, self._most_shaft_power / rotor_speed))

    def encode(self, demand: Demand, previous: Demand | AgentSetpoint) -> NDArray[np.float64]:
        """Action (size,) with a given demand, or the nearest one that the spans allow, within [-1, 1].

        Collective maps take the mean of the blades' pitch.

        Raises
        ------
        ValueError
            For residual actions and pitch in the fixed frame, which base controllers may be part of.
        """
        if self.mode == "residual" or self.turns_with_rotor:
            raise ValueError(
                f"a controller's demand cannot be written as an action of mode {self.mode!r} with pitch "
                f"{self.pitch!r}; let it be the base controller: controller=..., and take zero actions"
            )
        pitch, torque = np.asarray(demand.pitch, dtype=np.float64), demand.generator_torque
        if self.mode == "rate":
            pitch = (pitch - previous.pitch) / self.control_dt
            torque = (torque - previous.generator_torque) / self.control_dt
        if self.pitch == "collective":
            pitch = pitch.mean(keepdims=True)
        parts = {"pitch": pitch, "yaw": [demand.yaw_rate], "torque": [torque]}
        physical = np.concatenate([parts[name] for name in self.components])
        out: NDArray[np.float64] = np.clip(2.0 * (physical - self.low) / (self.high - self.low) - 1.0, -1.0, 1.0)
        return out

    def table(self) -> list[dict[str, Any]]:
        """Rows (name, unit, value at -1, value at +1) of the action vector, for documentation and reports."""
        rows = zip(self.names, self.units, self.low, self.high, strict=True)
        return [{"name": n, "unit": u, "min": float(low), "max": float(high)} for n, u, low, high in rows]
