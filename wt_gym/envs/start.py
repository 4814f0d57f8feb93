"""Start of an episode: state of the turbine, and memory of its controller."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.control.controllers.controller import Memory, memory_of, remember
from wt_gym.simulation import Signals
from wt_gym.simulation.channels import TOWER_TOP_PARITIES, parities

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.control import Demand
    from wt_gym.control.controllers import Controller, Readings

__all__ = ["ControllerMemory", "Start", "Trail", "kind_of", "steady_start"]


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
class ControllerMemory:
    """Memory of a controller that ran before the start of an episode.

    Attributes
    ----------
    kind : str
        Module and name of its class.
    memory : Memory
        Parameters included.
    changing : numpy.ndarray, shape (n_parts,), bool
        Parts that are no parameters.
    """

    kind: str
    memory: Memory
    changing: NDArray[np.bool_]

    def put(self, controller: Controller) -> None:
        """Put it into a controller of that kind and with those parameters, or into such a base of it; into no other."""
        inner: Any = controller
        while inner is not None and kind_of(inner) != self.kind:
            inner = getattr(inner, "base", None)
        if inner is None:
            return
        values, sizes = memory_of(inner)
        if not np.array_equal(sizes, self.memory.sizes):
            return
        # a number that the first step sets, as the step of a filter, is none before
        fixed = np.repeat(~self.changing, sizes) & ~np.isnan(values)
        if np.allclose(values[fixed], self.memory.values[fixed], rtol=1e-6, atol=0.0, equal_nan=True):
            remember(inner, self.memory, self.changing)


def kind_of(controller: Controller) -> str:
    """Module and name of the class of a controller."""
    return f"{type(controller).__module__}.{type(controller).__qualname__}"


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
    memory : ControllerMemory, optional
        Of the controller that ran before.
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
    memory: ControllerMemory | None = None
    trail: Trail | None = None

    def mirrored(self, n_blades: int) -> Start:
        """Start of the mirror image of the turbine in the mirrored wind, see `wt_gym.simulation.channels`.

        The motion stays: it is that of the clockwise image, as in snapshots. So does the memory of a controller that
        acts on rotor and pitch alone.
        """
        signs = parities(n_blades)
        of = Signals(signs, n_blades)
        return replace(
            self,
            tower_top=None if self.tower_top is None else self.tower_top * TOWER_TOP_PARITIES,
            deviations={name: deviation * of[name] for name, deviation in self.deviations.items()},
            trail=None if self.trail is None else replace(self.trail, signals=self.trail.signals * signs),
        )

    def start(self, controller: Controller, readings: Readings, demand: Demand) -> None:
        """Start a controller from the present demand, with the memory that fits it.

        Parameters
        ----------
        controller : Controller
        readings : Readings
            Of the present instant.
        demand : Demand
            Of the present instant.
        """
        controller.start(readings, demand)
        if self.memory is not None:
            self.memory.put(controller)

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
