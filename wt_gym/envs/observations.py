"""The observation: which quantities an agent measures, over which range and scale, with noise, delay and memory."""

from __future__ import annotations

import copy
import math
from collections import deque
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from wt_gym.base.angles import wrapped
from wt_gym.control import Lidar
from wt_gym.control.controllers.tsr_tracking import WindEstimator
from wt_gym.envs.arguments import shown
from wt_gym.envs.layout import ObservationLayout
from wt_gym.envs.observable import DEFAULT_GROUPS, OBSERVATION_GROUPS, RESIDUAL_GROUPS, Observable
from wt_gym.envs.observation_kernels import read_signals
from wt_gym.envs.options.observations import MOST_READINGS
from wt_gym.envs.readers import Computed, FromSignals, InFixedFrame, ObservationContext, Observed, Sensors
from wt_gym.simulation import Signals
from wt_gym.simulation.channels import EVEN, ODD, channel_table

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from wt_gym.control import ActionMap
    from wt_gym.control.controllers.additions import ResidualPitch, YawByDeadBand
    from wt_gym.control.controllers.linear_optimal import LinearOptimalPitch
    from wt_gym.control.controllers.supervisor import Supervisor
    from wt_gym.envs.readers import Quantity
    from wt_gym.envs.start import Trail
    from wt_gym.turbines import Turbine

__all__ = ["DEFAULT_GROUPS", "MOST_READINGS", "OBSERVATION_GROUPS", "RESIDUAL_GROUPS", "Observer"]

_MEMORY = ("_sensors", "_readings", "_lasting")


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
    washout : float, optional
        Time constant of the high-pass filter on loads, deflections and accelerations [s].
    yaw_drive : YawByDeadBand, optional
        Dead-band control of the base controller, whose state can then be observed.
    linear : LinearOptimalPitch, optional
        That of the base controller, if it has one; what it knows of the disturbances can then be observed.
    supervisor : Supervisor, optional
        That of the base controller, if it has one; its state can then be observed.
    follows_power : bool
        Whether a grid operator asks for a power, which can then be observed.
    has_dial : bool
        Whether there is a dial, which can then be observed.

    Attributes
    ----------
    sees_lidar : bool
        Whether there is a channel of the lidar.
    sees_disturbances : bool
        Whether there is a channel of the disturbances.
    washed : tuple of str
        Channels behind the high-pass filter.

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
        washout: float | None = None,
        yaw_drive: YawByDeadBand | None = None,
        linear: LinearOptimalPitch | None = None,
        supervisor: Supervisor | None = None,
        follows_power: bool = False,
        has_dial: bool = False,
    ):
        if not 0.0 <= noise_level < math.inf:
            raise ValueError(f"sensor_noise must be finite and not negative, got {noise_level!r}")
        if not 1 <= history <= MOST_READINGS or history != int(history):
            raise ValueError(f"history must be a whole number of readings, 1 to {MOST_READINGS}, got {history!r}")
        if not 0 <= delay <= MOST_READINGS:
            raise ValueError(f"sensor_delay must be 0 to {MOST_READINGS} control steps, got {delay}")
        if lidar is not None and not isinstance(lidar, Lidar):
            raise ValueError(f"lidar must be a wt_gym.control.Lidar or None, got {shown(lidar)}")
        self._turbine, self._noise_level = turbine, noise_level
        self._delay, self._history = int(delay), int(history)
        self.lidar = lidar or Lidar.for_rotor(turbine.rotor_diameter)
        self.groups, observed = Observable(
            turbine, action, self.lidar, residual, washout, yaw_drive, linear, supervisor, follows_power, has_dial
        ).choose(choice)
        channels = [one.channel for one in observed]
        layers = [channels] + [
            [replace(c, name=f"{c.name}@{k}", description=f"{c.description}, {k} steps ago") for c in channels]
            for k in range(1, self._history)
        ]
        self.layout = ObservationLayout([channel for layer in layers for channel in layer])
        turning = EVEN if turbine.rotation == "clockwise" else ODD
        # that of the image, of the same random numbers
        self._noise = np.array([c.noise * (turning if c.parity == ODD else EVEN) for c in channels])
        self._washout = washout
        self._prepare(observed)

    def _prepare(self, observed: list[Observed]) -> None:
        """Sort the channels by their readers: those of signals come from their vector at once."""
        index = {c.name: i for i, c in enumerate(channel_table(self._turbine.n_blades))}
        read = [(k, one.reader) for k, one in enumerate(observed)]
        signals = [(k, index[reader.name]) for k, reader in read if isinstance(reader, FromSignals)]
        self._at, self._from = np.array(signals, dtype=np.int64).reshape(-1, 2).T.copy()
        cyclic = [
            (k, reader.part, index[f"{reader.signal}_1"]) for k, reader in read if isinstance(reader, InFixedFrame)
        ]
        self._cyclic_at, self._cyclic_part, first = np.array(cyclic, dtype=np.int64).reshape(-1, 3).T.copy()
        self._cyclic_from = first[:, None] + np.arange(self._turbine.n_blades)
        computed = [(k, reader) for k, reader in read if isinstance(reader, Computed)]
        self._functions = [(k, reader.function, reader.index) for k, reader in computed]
        needs = {reader.needs for _, reader in computed}
        self.sees_lidar, self.sees_disturbances = "lidar" in needs, "disturbances" in needs
        # another turbine's table takes a while to make
        self._sensors = Sensors(WindEstimator.of_turbine(self._turbine) if "estimator" in needs else None)
        self._directions = [k for k, one in enumerate(observed) if one.circular]
        self._size = len(observed)
        self.washed = tuple(one.channel.name for one in observed if one.washed)
        self._washed = np.array([k for k, one in enumerate(observed) if one.washed], dtype=np.int64)
        self._means = [_mean_reader(observed[k]) for k in self._washed.tolist()]

    def memory(self) -> dict[str, Any]:
        """Give what the sensors remember within an episode, a copy, for `recall`."""
        return copy.deepcopy({name: self.__dict__[name] for name in _MEMORY})

    def recall(self, memory: dict[str, Any]) -> None:
        """Continue with a memory."""
        self.__dict__.update(copy.deepcopy(memory))

    # ---- readings ----

    def reset(self, context: ObservationContext, trail: Trail | None = None, offsets: np.ndarray | None = None) -> None:
        """Start the filters in steady state.

        Parameters
        ----------
        context : ObservationContext
        trail : Trail, optional
            Earlier signals, whose means the washout takes.
        offsets : numpy.ndarray, shape (n_signals,), optional
            Of the sensors, in the units of the signals.
        """
        self._sensors.reset(context.signals)
        context = replace(context, offsets=offsets)
        self._lasting = self._means_before(context, trail) if len(self._washed) else np.empty(0)
        self._readings: deque[np.ndarray] = deque(maxlen=self._delay + self._history)

    def _means_before(self, context: ObservationContext, trail: Trail | None) -> np.ndarray:
        """What lasts of the washed channels at the start (n_washed,): means weighted as the filter weighs.

        A channel that the trail does not hold starts from what is measured now.
        """
        present = self._means_of(context)
        if trail is None or not len(trail.signals):
            return present
        n_blades = context.signals.n_blades
        read = trail.signals if context.offsets is None else trail.signals + context.offsets
        rows = [replace(context, signals=Signals(row, n_blades)) for row in read]
        means = np.array([self._means_of(row) for row in rows])
        ages = trail.spacing * np.arange(len(rows), 0, -1)
        weights = np.exp(-ages / cast("float", self._washout))
        found = weights @ means / weights.sum()
        return np.where(np.isfinite(found), found, present)

    def _means_of(self, context: ObservationContext) -> np.ndarray:
        """Washed channels in a situation (n_washed,), of a blade as the mean of the blades."""
        values = self._read(context)[self._washed]
        for k, mean in enumerate(self._means):
            if mean is not None:
                values[k] = mean(self._sensors, context)
        return values

    def _read(self, context: ObservationContext) -> np.ndarray:
        """Physical values of all channels (n_own,)."""
        values, signals = np.empty(self._size), context.signals
        read_signals(
            signals.values, self._from, self._at, self._cyclic_from, self._cyclic_part, signals["azimuth"],
            self._cyclic_at, values,
        )  # fmt: skip
        sensors = self._sensors
        for k, function, index in self._functions:
            values[k] = function(sensors, context, index)
        return values

    def advance(self, signals: Signals, dt: float) -> None:
        """Let the filters take the signals of a step of length ``dt`` [s]."""
        self._sensors.advance(signals, dt)

    def observe(self, context: ObservationContext, rng: np.random.Generator) -> tuple[np.ndarray, tuple[str, ...]]:
        """Measure once a control step.

        Parameters
        ----------
        context : ObservationContext
        rng : numpy.random.Generator
            Source of the measurement noise.

        Returns
        -------
        observation : numpy.ndarray, float32, shape (n_obs,)
        saturated : tuple of str
            Sensors at the end of their range.
        """
        values = self._read(context)
        if self._noise_level > 0:
            values += self._noise_level * self._noise * rng.standard_normal(self._size)
            for k in self._directions:
                values[k] = wrapped(values[k])
        if len(self._washed):
            self._wash(values)
        readings = self._readings
        readings.append(values)
        if self._history == 1:
            return self.layout.normalize(readings[0])
        late = [readings[max(len(readings) - 1 - self._delay - k, 0)] for k in range(self._history)]
        return self.layout.normalize(np.concatenate(late))

    def _wash(self, values: np.ndarray) -> None:
        """Take off what lasts of the washed channels."""
        dt, found = self._sensors.dt, values[self._washed]
        if math.isfinite(dt):  # a step has been made
            self._lasting += -math.expm1(-dt / cast("float", self._washout)) * (found - self._lasting)
        values[self._washed] = found - self._lasting


def _mean_reader(observed: Observed) -> Callable[[Sensors, ObservationContext], float] | None:
    """Reader of the mean that a washed channel starts from; None: of the channel itself."""
    name, reader = observed.channel.name, observed.reader
    stem, _, number = name.rpartition("_")
    if name.startswith("nacelle_acceleration_"):
        return partial(_offset, cast("FromSignals", reader).name)
    if not number.isdecimal():
        return None
    if isinstance(reader, FromSignals):
        return partial(_mean_of_signal, stem)
    return partial(_mean_of_blades, cast("Computed", reader).function)


def _offset(name: str, _: Sensors, context: ObservationContext) -> float:
    """Of a sensor whose true mean is zero."""
    if context.offsets is None:
        return 0.0
    return float(Signals(context.offsets, context.signals.n_blades)[name])


def _mean_of_signal(name: str, _: Sensors, context: ObservationContext) -> float:
    return float(context.signals[name].mean())


def _mean_of_blades(function: Quantity, sensors: Sensors, context: ObservationContext) -> float:
    n_blades = context.signals.n_blades
    return sum(function(sensors, context, b) for b in range(n_blades)) / n_blades
