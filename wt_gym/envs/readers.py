"""How the channels of an observation are read: from signals of the simulator, sensors with memory, and demands."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from wt_gym.control import NacelleAnemometer
from wt_gym.control.sensors import to_fixed_frame

if TYPE_CHECKING:
    from wt_gym.control import AgentSetpoint, Channel, Demand, Lidar
    from wt_gym.control.controllers.additions import ResidualPitch, YawByDeadBand
    from wt_gym.control.controllers.supervisor import Supervisor
    from wt_gym.control.controllers.tsr_tracking import WindEstimator
    from wt_gym.simulation import Signals

__all__ = [
    "LIDAR_NOISE",
    "Computed",
    "FromSignals",
    "InFixedFrame",
    "ObservationContext",
    "Observed",
    "Quantity",
    "Reader",
    "Sensors",
    "lidar_noise",
]

LIDAR_NOISE = 0.1
"""Of the mean over the beams of a gate of a lidar, at level 1 [m/s]."""


def lidar_noise(lidar: Lidar) -> float:
    """Noise of a reading of a lidar at level 1 [m/s].

    That of a beam apart is so much larger that the mean over the beams of a gate, whose noises are independent, has
    `LIDAR_NOISE`.
    """
    return LIDAR_NOISE * math.sqrt(lidar.n_beams) if lidar.apart else LIDAR_NOISE


@dataclass(frozen=True)
class ObservationContext:
    """All that can be observed after a control step.

    Attributes
    ----------
    signals : Signals
    demand : Demand
        Present demands on the actuators.
    setpoint : AgentSetpoint
        Of the agent; its offsets in mode "residual".
    base : Demand or None
        Of the base controller.
    action : numpy.ndarray, shape (n_act,)
        That led here.
    lidar : numpy.ndarray, shape (n_readings,), optional
        By the lidar, for an observer that `wt_gym.envs.observations.Observer.sees_lidar` [m/s].
    residual : ResidualPitch, optional
        What residual pitch passes.
    yaw_drive : YawByDeadBand, optional
        Dead-band control of the yaw drive in the base controller.
    disturbances : numpy.ndarray, shape (n,), optional
        What the linear optimal pitch of the base controller knows, as of `LinearOptimalPitch.known`.
    offsets : numpy.ndarray, shape (n_signals,), optional
        Of the sensors, at a start.
    supervisor : Supervisor, optional
        Supervisory control in the base controller.
    demanded_power : tuple of float, optional
        That a grid operator asks for, now and in the times of `wt_gym.envs.power_reference.AHEAD` [W].
    dial : tuple of float, optional
        Present factors on the weights of the reward, see `wt_gym.envs.dial`.
    """

    signals: Signals
    demand: Demand
    setpoint: AgentSetpoint
    base: Demand | None
    action: np.ndarray
    lidar: np.ndarray | None = None
    residual: ResidualPitch | None = None
    yaw_drive: YawByDeadBand | None = None
    disturbances: np.ndarray | None = None
    offsets: np.ndarray | None = None
    supervisor: Supervisor | None = None
    demanded_power: tuple[float, ...] | None = None
    dial: tuple[float, ...] | None = None


class Sensors:
    """What remembers something from step to step: wind vane, anemometer, wind estimator, pitch for its rate.

    Parameters
    ----------
    estimator : WindEstimator, optional

    Attributes
    ----------
    wind_speed, yaw_error : float
        Filtered readings of the nacelle's anemometer and vane [m/s, rad].
    pitch, pitch_before : list of float
        Of each blade now and a control step before [rad].
    dt : float
        Length of that step [s], infinite before the first one.
    """

    def __init__(self, estimator: WindEstimator | None = None):
        self.estimator = estimator
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


Quantity: TypeAlias = Callable[[Sensors, ObservationContext, int], float]
"""Reads a quantity of sensors and situation; the number is that of a blade, component or reading of the lidar."""


@dataclass(frozen=True)
class FromSignals:
    """Reads a signal of the simulator as it is.

    Attributes
    ----------
    name : str
        Of the signal (`wt_gym.simulation.channels`).
    """

    name: str


@dataclass(frozen=True)
class InFixedFrame:
    """Reads a coordinate of a signal of the blades in the frame that does not turn.

    Attributes
    ----------
    signal : str
        Without the number of the blade.
    part : int
        Place in `wt_gym.control.sensors.FIXED_FRAME`.
    """

    signal: str
    part: int


@dataclass(frozen=True)
class Computed:
    """Reads by a function, which is called at every step.

    Attributes
    ----------
    function : callable
        Takes sensors, situation and the index; stands at the top level of a module, so that an observer can be pickled.
    index : int
        Blade, component or reading of the lidar, from 0.
    needs : {"", "lidar", "estimator", "disturbances"}
        What must be there for it.
    """

    function: Quantity
    index: int = 0
    needs: str = ""


Reader: TypeAlias = FromSignals | InFixedFrame | Computed


@dataclass(frozen=True)
class Observed:
    """A channel with its reader.

    Attributes
    ----------
    channel : Channel
    reader : FromSignals, InFixedFrame or Computed
    circular : bool
        Whether it is a direction: with noise it is wrapped around the circle.
    washed : bool
        Whether it passes a high-pass filter.
    """

    channel: Channel
    reader: Reader
    circular: bool = False
    washed: bool = False


def _mean(of_blades: Sequence[float] | np.ndarray) -> float:
    """Mean of one number a blade; of so few, numpy's own is slow."""
    return float(np.add.reduce(of_blades)) / len(of_blades)


# Functions for `Computed`: each takes sensors, situation and index. Those of a quantity that the observer was not asked
# for are not called, so what they need is there.


def previous_action(sensors: Sensors, context: ObservationContext, k: int) -> float:
    """Component of the last action."""
    return float(context.action[k])


def lidar(sensors: Sensors, context: ObservationContext, k: int) -> float:
    """Reading of the lidar [m/s]."""
    return float(context.lidar[k])  # type: ignore[index]


def wind_speed(sensors: Sensors, context: ObservationContext, _: int) -> float:
    """Nacelle anemometer [m/s]."""
    return sensors.wind_speed


def yaw_error(sensors: Sensors, context: ObservationContext, _: int) -> float:
    """Wind vane [rad]."""
    return sensors.yaw_error


def dead_band_error(sensors: Sensors, context: ObservationContext, _: int) -> float:
    """Yaw error behind the slow filter of the dead-band controller [rad]."""
    return context.yaw_drive.slow_error  # type: ignore[union-attr]


def dead_band_turning(sensors: Sensors, context: ObservationContext, _: int) -> float:
    """Direction in which the dead-band controller turns the nacelle."""
    return float(context.yaw_drive.turning)  # type: ignore[union-attr]


def supervisor_state(sensors: Sensors, context: ObservationContext, k: int) -> float:
    """Whether the supervisor is in a state, of `wt_gym.control.controllers.STATES`."""
    return float(context.supervisor.state_index == k)  # type: ignore[union-attr]


def supervisor_wind(sensors: Sensors, context: ObservationContext, _: int) -> float:
    """Mean wind by which the supervisor decides [m/s]."""
    return context.supervisor.mean_wind  # type: ignore[union-attr]


def supervisor_set_point(sensors: Sensors, context: ObservationContext, _: int) -> float:
    """Set point of the rotor speed over rated [-]."""
    return context.supervisor.set_point  # type: ignore[union-attr]


def supervisor_load(sensors: Sensors, context: ObservationContext, _: int) -> float:
    """Share of the base controller's torque that a start-up has reached [-]."""
    return context.supervisor.load  # type: ignore[union-attr]


def set_point_offset(sensors: Sensors, context: ObservationContext, _: int) -> float:
    """Residual set point of the rotor speed over rated [-]."""
    return context.setpoint.set_point


def rotor_wind(sensors: Sensors, context: ObservationContext, _: int) -> float:
    """Wind of the estimator [m/s]."""
    return sensors.estimator.wind  # type: ignore[union-attr]


def azimuth_sin(sensors: Sensors, context: ObservationContext, _: int) -> float:
    """Sine of the azimuth."""
    return math.sin(context.signals["azimuth"])


def azimuth_cos(sensors: Sensors, context: ObservationContext, _: int) -> float:
    """Cosine of the azimuth."""
    return math.cos(context.signals["azimuth"])


def out_of_plane_moment(sensors: Sensors, context: ObservationContext, b: int) -> float:
    """Out-of-plane root moment of the coned blade that does not pitch [N m]."""
    signals = context.signals
    pitch = signals["pitch"].item(b)
    flap, edge = signals["root_flap_moment"].item(b), signals["root_edge_moment"].item(b)
    return float(flap * math.cos(pitch) - edge * math.sin(pitch))


def out_of_plane_fixed_frame(sensors: Sensors, context: ObservationContext, part: int) -> float:
    """Coordinate of the out-of-plane root moments in the frame that does not turn [N m]."""
    moments = [out_of_plane_moment(sensors, context, b) for b in range(context.signals.n_blades)]
    return float(to_fixed_frame(moments, context.signals["azimuth"])[part])


def pitch_rate(sensors: Sensors, context: ObservationContext, b: int) -> float:
    """Rate of a blade over the last step [rad/s]."""
    return float((sensors.pitch[b] - sensors.pitch_before[b]) / sensors.dt)


def pitch_demand(sensors: Sensors, context: ObservationContext, b: int) -> float:
    """Demand on a blade [rad]."""
    return float(context.demand.pitch[b])


def mean_pitch(sensors: Sensors, context: ObservationContext, _: int) -> float:
    """Mean of the blades [rad]."""
    return _mean(sensors.pitch)


def mean_pitch_rate(sensors: Sensors, context: ObservationContext, _: int) -> float:
    """Mean rate of the blades [rad/s]."""
    return _mean(np.subtract(sensors.pitch, sensors.pitch_before)) / sensors.dt


def mean_pitch_demand(sensors: Sensors, context: ObservationContext, _: int) -> float:
    """Mean demand on the blades [rad]."""
    return _mean(context.demand.pitch)


def torque_demand(sensors: Sensors, context: ObservationContext, _: int) -> float:
    """Demand on the generator [N m]."""
    return context.demand.generator_torque


def controller_pitch(sensors: Sensors, context: ObservationContext, _: int) -> float:
    """Mean demand of the base controller on the blades [rad]."""
    return _mean(context.base.pitch)  # type: ignore[union-attr]


def controller_torque(sensors: Sensors, context: ObservationContext, _: int) -> float:
    """Demand of the base controller on the generator [N m]."""
    return context.base.generator_torque  # type: ignore[union-attr]


def pitch_offset(sensors: Sensors, context: ObservationContext, k: int) -> float:
    """Coordinate of the residual pitch [rad]."""
    return float(context.setpoint.pitch[k])


def torque_offset(sensors: Sensors, context: ObservationContext, _: int) -> float:
    """Residual torque [N m]."""
    return context.setpoint.generator_torque


def residual_share(sensors: Sensors, context: ObservationContext, _: int) -> float:
    """Share of the residual pitch that acts."""
    return context.residual.share  # type: ignore[union-attr]


def residual_mean(sensors: Sensors, context: ObservationContext, _: int) -> float:
    """Mean of the residual pitch that acts [rad]."""
    return context.residual.mean  # type: ignore[union-attr]


def disturbance(sensors: Sensors, context: ObservationContext, k: int) -> float:
    """Entry of what the linear optimal pitch of the base controller knows."""
    return float(context.disturbances[k])  # type: ignore[index]


def demanded_power(sensors: Sensors, context: ObservationContext, k: int) -> float:
    """Power that is asked for, now or in one of the times ahead [W]."""
    return context.demanded_power[k]  # type: ignore[index]


def power_error(sensors: Sensors, context: ObservationContext, _: int) -> float:
    """Electrical power less what is asked for [W]."""
    return float(context.signals["generator_power"] - context.demanded_power[0])  # type: ignore[index]


def rotor_energy(half_inertia: float, sensors: Sensors, context: ObservationContext, _: int) -> float:
    """Kinetic energy of rotor and generator [J]."""
    return float(half_inertia * context.signals["rotor_speed"] ** 2)


def power_headroom(factor: float, most: float, sensors: Sensors, context: ObservationContext, _: int) -> float:
    """Power that the wind of the estimator allows less what is asked for [W]."""
    available = min(factor * sensors.estimator.wind**3, most)  # type: ignore[union-attr]
    return available - context.demanded_power[0]  # type: ignore[index]


def dial(sensors: Sensors, context: ObservationContext, k: int) -> float:
    """Binary logarithm of a factor of the dial."""
    return math.log2(context.dial[k])  # type: ignore[index]
