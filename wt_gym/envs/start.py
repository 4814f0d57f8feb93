"""What an episode begins with: the state of the turbine, and what its controller has read before."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.control import Demand
from wt_gym.control.controllers import WithLidar, lidar_of
from wt_gym.control.controllers.memory import Memory, remember
from wt_gym.simulation import Signals

if TYPE_CHECKING:
    from wt_gym.control import Lidar
    from wt_gym.control.controllers import Controller, Readings

__all__ = ["ControllerHistory", "Start", "Trail", "steady_start"]


@dataclass(frozen=True)
class Trail:
    """Signals at times before the start of an episode, the latest last.

    Attributes
    ----------
    signals : numpy.ndarray, shape (n_times, n_channels)
        Not a number where a signal is not recorded.
    spacing : float
        Between the times, and from the last one to the start [s].
    """

    signals: np.ndarray
    spacing: float


@dataclass(frozen=True)
class ControllerHistory:
    """What a controller has read and demanded before the start of an episode, oldest first.

    Attributes
    ----------
    signals : numpy.ndarray, shape (n_times, n_channels)
        Not a number where a signal is not recorded.
    pitch : numpy.ndarray, shape (n_times, n_blades)
        Demanded [rad].
    torque : numpy.ndarray, shape (n_times,)
        Demanded [N m].
    lidar : numpy.ndarray, shape (n_times, n_readings)
        Readings of the controller's lidar [m/s].
    dt : float
        Between the times [s].
    memory : Memory
        What the controller remembers then.
    changing : numpy.ndarray, shape (n_parts,), bool
        Which parts of it are no parameters.
    """

    signals: np.ndarray
    pitch: np.ndarray
    torque: np.ndarray
    lidar: np.ndarray
    dt: float
    memory: Memory
    changing: np.ndarray

    def feed(self, controller: Controller) -> None:
        """Let a controller read, after which it has the form to remember what it would after a longer time."""
        lidar = lidar_of(controller)
        controller.start(self._readings(0, lidar), Demand(self.pitch[0], 0.0, float(self.torque[0])))
        for k in range(len(self.signals)):
            controller.step(self._readings(k, lidar), self.dt)
        remember(controller, self.memory, self.changing)

    def _readings(self, k: int, lidar: Lidar | None) -> Readings:
        signals = Signals(self.signals[k], self.pitch.shape[1])
        return WithLidar(signals, self.lidar[k], lidar) if self.lidar.shape[1] else signals


@dataclass(frozen=True)
class Start:
    """What an episode begins with.

    Attributes
    ----------
    rotor_speed : float
        [rad/s].
    pitch : numpy.ndarray, shape (n_blades,)
        [rad].
    generator_torque : float
        High-speed shaft [N m].
    azimuth : float
        Of blade 1 [rad].
    tower_top : numpy.ndarray, shape (4,), optional
        As `wt_gym.simulation.Simulator.reset` takes it; None: at rest in balance.
    motion : numpy.ndarray, shape (n,), optional
        Of the structure, as `wt_gym.simulation.Simulator.reset` takes it, where fidelity and azimuth are those of the
        record.
    wake_thrust : float, optional
        Mean thrust of the air in the time before, to which the wake belongs [N].
    deviations : dict
        Of the running means of channels from their present values, by name.
    before : Before, optional
        What the base controller has read until then.
    trail : Trail, optional
        Signals before.
    """

    rotor_speed: float
    pitch: np.ndarray
    generator_torque: float
    azimuth: float
    tower_top: np.ndarray | None = None
    motion: np.ndarray | None = None
    wake_thrust: float | None = None
    deviations: dict[str, float | np.ndarray] = field(default_factory=dict)
    before: ControllerHistory | None = None
    trail: Trail | None = None

    def start(self, controller: Controller, readings: Readings, demand: Demand) -> None:
        """Start a controller with the memory of what it has read before; without any, from the present demand.

        Parameters
        ----------
        controller : Controller
        readings : Readings
            Of the present instant.
        demand : Demand
            Of the present instant.
        """
        if self.before is None:
            controller.start(readings, demand)
        else:
            self.before.feed(controller)

    def averaged(self, signals: Signals) -> Signals:
        """Signals with the running means in place of the present values of the loads.

        What a load is above its mean is that of the record; in another wind both may be higher.
        """
        if not self.deviations:
            return signals
        averaged = Signals(signals.values.copy(), signals.n_blades)
        for name, deviation in self.deviations.items():
            averaged.set(name, signals[name] + deviation)
        return averaged


def steady_start(rotor_speed: float, pitch: float, generator_torque: float, azimuth: float, n_blades: int) -> Start:
    """Start at rest in balance, with equal pitch of all blades."""
    return Start(rotor_speed, np.full(n_blades, pitch), generator_torque, azimuth)
