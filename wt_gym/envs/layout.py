"""Which number of an observation or action is which: for controllers, wrappers, reports and documentation."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from wt_gym.control import ActionMap, Channel, Lidar
from wt_gym.envs.observation_kernels import normalize
from wt_gym.turbines import Turbine


class ObservationLayout:
    """Order, scales and ranges of an observation vector.

    Parameters
    ----------
    channels : sequence of Channel
        One a component, in order.

    Attributes
    ----------
    names : tuple of str
    low, high : numpy.ndarray, float32, shape (n,)
        Bounds of the normalized values.
    noise : numpy.ndarray, shape (n,)
        Standard deviations of the measurement noise in physical units.
    parity : numpy.ndarray, shape (n,)
        +1 or -1: sign with which each component goes into the observation of the mirror image, in which the rotor turns
        the other way.
    """

    def __init__(self, channels: Iterable[Channel]) -> None:
        self.channels: tuple[Channel, ...] = tuple(channels)
        self.names = tuple(channel.name for channel in self.channels)
        if len(set(self.names)) != len(self.names):
            raise ValueError(f"channel names must differ, got {self.names}")
        self._index = {name: i for i, name in enumerate(self.names)}
        self._offset, self._scale, self._low, self._high, self.noise, self.parity = (
            np.array([getattr(channel, key) for channel in self.channels], dtype=np.float64)
            for key in ("offset", "scale", "low", "high", "noise", "parity")
        )
        self.low, self.high = (
            ((end - self._offset) / self._scale).astype(np.float32) for end in (self._low, self._high)
        )

    def __len__(self) -> int:
        return len(self.channels)

    def index(self, name: str) -> int:
        """Position of a channel.

        Raises
        ------
        KeyError
            If the observation has no such channel; the message lists those it has.
        """
        try:
            return self._index[name]
        except KeyError:
            raise KeyError(f"the observation has no channel {name!r}; it has {', '.join(self.names)}") from None

    def value(self, observation: np.ndarray, name: str) -> Any:
        """Physical value of a channel, as a float or of shape (...).

        Parameters
        ----------
        observation : numpy.ndarray, shape (..., n)
            As given by the environment, not scaled any further by a wrapper.
        """
        i = self.index(name)
        return observation[..., i] * self._scale[i] + self._offset[i]

    def normalize(self, values: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
        """Observation from physical values.

        Parameters
        ----------
        values : numpy.ndarray, shape (n,)
            Physical values in the order of the channels.

        Returns
        -------
        observation : numpy.ndarray, float32, shape (n,)
            Within the bounds: a sensor at the end of its range stays there.
        saturated : tuple of str
            Channels whose value lies outside the range of the sensor.
        """
        observation = np.empty(len(self.names), dtype=np.float32)
        # It stays within the bounds: they were made by the same steps, each of which keeps the order of two values.
        if not normalize(values, self._low, self._high, self._offset, self._scale, observation):
            return observation, ()
        outside = np.flatnonzero((values < self._low) | (values > self._high))
        return observation, tuple(self.names[i] for i in outside)

    def __repr__(self) -> str:
        more = ", …" if len(self) > 4 else ""
        return f"<{type(self).__name__}: {len(self)} channels, {', '.join(self.names[:4])}{more}>"

    def table(self) -> list[dict[str, Any]]:
        """Rows (name, unit, offset, scale, min, max, description) for documentation and reports."""
        return [
            {"name": c.name, "unit": c.unit, "offset": c.offset, "scale": c.scale, "min": c.low, "max": c.high,
             "description": c.description}
            for c in self.channels
        ]  # fmt: skip


@dataclass(frozen=True)
class EnvLayout:
    """Everything a controller must know of an environment to read its observation and write its action.

    Attributes
    ----------
    control_dt : float
        [s]
    delay : int
        Control steps by which observations are late.
    lidar : Lidar or None
        Reads the channels ``lidar_1`` …, with its beams apart ``lidar_1_1`` ….
    washed : tuple of str
        Channels behind the high-pass filter of the observation.
    """

    turbine: Turbine
    observation: ObservationLayout
    action: ActionMap
    control_dt: float
    delay: int = 0
    lidar: Lidar | None = None
    washed: tuple[str, ...] = ()

    @property
    def sizes(self) -> str:
        """Numbers of observations and of actions with their names, and the control step, in one line."""
        names = ", ".join(self.action.names)
        return f"{len(self.observation)} observations, {self.action.mode} actions ({names}) every {self.control_dt:g} s"

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.turbine.name}, {self.sizes}>"


def layout_of(env: Any) -> EnvLayout:
    """Layout of an environment behind any wrappers.

    Parameters
    ----------
    env : gymnasium.Env, gymnasium.vector.VectorEnv or stable_baselines3 VecEnv
        Observations must not be scaled by a wrapper (as VecNormalize does) where the layout is used to read them.

    Raises
    ------
    TypeError
        If the environment is none of wt_gym's.
    """
    plain = env.unwrapped
    layout = plain.get_attr("layout")[0] if hasattr(env, "num_envs") else getattr(plain, "layout", None)
    if not isinstance(layout, EnvLayout):
        raise TypeError(f"{env} is not a wt_gym environment: it has no layout")
    return layout
