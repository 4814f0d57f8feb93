"""The observation: options, and the observer, which measures with noise, delay, washout and memory."""

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, cast

import numpy as np

from wt_gym.base.options import Options, as_tuple, option, option_record, shown
from wt_gym.base.quantities import wrapped
from wt_gym.control import ActionMap, Lidar
from wt_gym.control.controllers.tsr_tracking import WindEstimator
from wt_gym.envs.channels import DEFAULT_GROUPS, Observable, Observed, Sensors, Situation
from wt_gym.envs.layout import ObservationLayout
from wt_gym.envs.observation_kernels import read_signals
from wt_gym.envs.terms import Stateful
from wt_gym.simulation import Signals
from wt_gym.simulation.channels import EVEN, ODD, channel_table
from wt_gym.turbines import Turbine

MOST_READINGS = 1000
"""Most readings in an observation, and most control steps by which they are late: 200 s at the usual step of 0.2 s."""


def _checked_lidar(lidar: Any) -> Lidar:
    if not isinstance(lidar, Lidar):
        raise ValueError(f"must be a wt_gym.control.Lidar or None, got {shown(lidar)}")
    return lidar


@option_record
class ObservationOptions(Options):
    """Channels of an observation, and how sensors read them."""

    title = "observations"
    objects = {"lidar": Lidar}  # noqa: RUF012 - of the class, as its base says

    channels: str | tuple[str, ...] | None = option(
        "Groups and channels to observe, in any order, or one; default: those of the action mode, see above",
        default=None,
        flat="observation",
        kind="str or sequence of str, optional",
        check=as_tuple,
    )
    noise: float = option(
        "Level of white measurement noise: 0 none, 1 typical instruments",
        default=0.0,
        flat="sensor_noise",
        unit="-",
        low=0.0,
    )
    delay: float = option(
        f"Time by which readings are late, a multiple of ``control_dt`` and at most {MOST_READINGS} of them; with "
        '``sensors="all"`` of the simulator\'s step',
        default=0.0,
        flat="sensor_delay",
        unit="s",
        low=0.0,
    )
    washout: float | None = option(
        "Time constant of a first-order high-pass filter on loads, deflections and accelerations: what lasts of them, "
        "as the offset of a strain gauge or the difference of two simulators, is not observed. Tilt and yaw of "
        "flapwise moments and tip deflections do not pass it. An episode starts with the mean of the time before, "
        "where that is recorded",
        default=None,
        flat="sensor_washout",
        unit="s",
        low=0.0,
        above=True,
    )
    history: int = option(
        "Readings in an observation: the current one, then those of the steps before",
        default=1,
        low=1,
        high=MOST_READINGS,
    )
    sensors: str | None = option(
        "Whose readings are noisy, late and shifted: the agent's alone, channel by channel, or one set of readings at "
        "every step of the simulator, which the base controller and its lidar read too, as on a turbine "
        '(`wt_gym.envs.instruments`). Default: "all" with a variation of plant, sensors or wind, else "agent"',
        default=None,
        choices=("agent", "all"),
    )
    lidar: Lidar | None = option(
        'Ranges and cone of the group "lidar", a mapping has the arguments of `wt_gym.control.Lidar`, with '
        "``apart=True`` for a channel of each beam. Where the base controller reads a lidar, all else must be as "
        "there; default: the lidar that the base controller reads, if it does, else `wt_gym.control.Lidar.for_rotor`",
        default=None,
        kind="Lidar or mapping, optional",
        check=_checked_lidar,
    )


class Observer(Stateful):
    """Turns the situation after a step into an observation.

    Parameters
    ----------
    operation : wt_gym.envs.operation.Operation
        With the base controller, whose states can then be observed; or an object with its readings and set points.
    choice : sequence of str
        As of `wt_gym.envs.channels.Observable.choose`.
    noise_level : float
        Factor on the noise of every sensor; zero for none.
    delay : int
        Control steps by which every reading is late, up to `MOST_READINGS`.
    features : mapping
        Channels of features by the group that they make.

    Raises
    ------
    ValueError
        If a group or channel is unknown or none is given, or the delay is too long.
    """

    washed: tuple[str, ...]  #: channels behind the high-pass filter
    remembered = ("_sensors", "_readings", "_lasting")

    def __init__(
        self,
        turbine: Turbine,
        action: ActionMap,
        operation: Any,
        options: ObservationOptions,
        choice: Sequence[str] = DEFAULT_GROUPS,
        noise_level: float = 0.0,
        delay: int = 0,
        features: Mapping[str, list[Observed]] | None = None,
    ):
        if not 0 <= delay <= MOST_READINGS:
            raise ValueError(f"sensor_delay must be 0 to {MOST_READINGS} control steps, got {delay}")
        self._turbine, self._operation, self._noise_level = turbine, operation, noise_level
        self._delay, self._history, self._washout = int(delay), options.history, options.washout
        controller, residual = operation.controller, operation.residual
        self.groups, observed = Observable(
            turbine, action, features, controller, residual, options.washout
        ).choose(choice)  # fmt: skip
        channels = [one.channel for one in observed]
        layers = [channels] + [
            [replace(c, name=f"{c.name}@{k}", description=f"{c.description}, {k} steps ago") for c in channels]
            for k in range(1, self._history)
        ]
        self.layout = ObservationLayout([channel for layer in layers for channel in layer])
        turning = EVEN if turbine.rotation == "clockwise" else ODD
        # that of the image, of the same random numbers
        self._noise = np.array([c.noise * (turning if c.parity == ODD else EVEN) for c in channels])
        self._prepare(observed)

    def _prepare(self, observed: list[Observed]) -> None:
        """Sort the channels by their readers: those of signals come from their vector at once."""
        index = {c.name: i for i, c in enumerate(channel_table(self._turbine.n_blades, self._turbine.n_lines))}
        rows = list(enumerate(observed))
        signals = [(k, index[one.signal]) for k, one in rows if one.signal and one.part is None]
        self._at, self._from = np.array(signals, dtype=np.int64).reshape(-1, 2).T.copy()
        cyclic = [(k, one.part, index[f"{one.signal}_1"]) for k, one in rows if one.part is not None]
        self._cyclic_at, self._cyclic_part, first = np.array(cyclic, dtype=np.int64).reshape(-1, 3).T.copy()
        self._cyclic_from = first[:, None] + np.arange(self._turbine.n_blades)
        computed = [(k, one.function, one.index) for k, one in rows if one.function is not None]
        self._single = [(k, function) for k, function, place in computed if place is None]
        several = [(k, function, place) for k, function, place in computed if place is not None]
        self._several = [  # each function is called once
            (function, [(k, place) for k, other, place in several if other == function])
            for function in dict.fromkeys(function for _, function, _ in several)
        ]
        estimates = any(one.estimates for one in observed)  # another turbine's table takes a while to make
        self._sensors = Sensors(WindEstimator.of_turbine(self._turbine) if estimates else None)
        self._situation = Situation(self._operation, self._sensors)
        self._directions = [k for k, one in rows if one.circular]
        self._size = len(observed)
        self.washed = tuple(one.channel.name for one in observed if one.washed)
        self._washed = np.array([k for k, one in rows if one.washed], dtype=np.int64)
        self._means = [_mean_reader(observed[k]) for k in self._washed.tolist()]

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Continue with a memory."""
        super().recall(memory)
        self._situation.sensors = self._sensors

    # ---- readings ----

    def reset(self, action: np.ndarray, trail: np.ndarray | None = None) -> None:
        """Start the filters in steady state, with the action (n_act,) before the first one.

        Parameters
        ----------
        trail : numpy.ndarray, shape (n_signals,), optional
            Means of the signals before, from which the washout starts; NaN where there is none.
        """
        situation, operation = self._situation, self._operation
        situation.signals, situation.action = operation.readings(), action
        situation.offsets = None if operation.instruments is None else operation.instruments.offset
        self._sensors.reset(situation.signals)
        self._lasting = self._means_before(trail) if len(self._washed) else np.empty(0)
        self._readings: deque[np.ndarray] = deque(maxlen=self._delay + self._history)

    def _means_before(self, trail: np.ndarray | None) -> np.ndarray:
        """Means of the washed channels at the start (n_washed,): those recorded before, else what is measured now."""
        situation, now = self._situation, self._situation.signals
        present = self._means_now()
        if trail is None:
            return present
        read = trail if situation.offsets is None else trail + situation.offsets
        situation.signals = Signals(read, now.n_blades)
        means = self._means_now()
        situation.signals = now
        return np.where(np.isfinite(means), means, present)

    def _means_now(self) -> np.ndarray:
        """Washed channels in the situation (n_washed,), of a blade as the mean of the blades."""
        values = self._read()[self._washed]
        for k, mean in enumerate(self._means):
            if mean is not None:
                values[k] = mean(self._situation)
        return values

    def _read(self) -> np.ndarray:
        """Physical values of all channels (n_own,)."""
        situation = self._situation
        values, signals = np.empty(self._size), situation.signals
        read_signals(
            signals.values, self._from, self._at, self._cyclic_from, self._cyclic_part, signals["azimuth"],
            self._cyclic_at, values,
        )  # fmt: skip
        for k, function in self._single:
            values[k] = function(situation)
        for function, places in self._several:
            several = function(situation)
            for k, place in places:
                values[k] = several[place]
        return values

    def advance(self, dt: float) -> None:
        """Let the filters take the readings of a step of length ``dt`` [s]."""
        self._sensors.advance(self._operation.readings(), dt)

    def observe(self, action: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, tuple[str, ...]]:
        """Measure once a control step, after an action (n_act,), with noise of a generator.

        Returns
        -------
        observation : numpy.ndarray, float32, shape (n_obs,)
        saturated : tuple of str
            Sensors at the end of their range.
        """
        self._situation.signals, self._situation.action = self._operation.readings(), action
        values = self._read()
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


def _mean_reader(observed: Observed) -> Callable[[Situation], float] | None:
    """Reader of the mean that a washed channel starts from; None: of the channel itself."""
    stem, _, number = observed.channel.name.rpartition("_")
    if observed.channel.name.startswith("nacelle_acceleration_"):
        return partial(_offset, observed.signal)
    if not number.isdecimal():
        return None
    return partial(_mean_of_blades, observed.function) if observed.function else partial(_mean_of_signal, stem)


def _offset(name: str, situation: Situation) -> float:
    """Offset of a sensor whose true mean is zero."""
    if situation.offsets is None:
        return 0.0
    return float(Signals(situation.offsets, situation.signals.n_blades)[name])


def _mean_of_signal(name: str, situation: Situation) -> float:
    return float(situation.signals[name].mean())


def _mean_of_blades(function: Callable[[Situation], Sequence[float]], situation: Situation) -> float:
    return sum(function(situation)) / situation.signals.n_blades
