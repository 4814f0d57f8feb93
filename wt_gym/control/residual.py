"""What of a residual pitch reaches the blades: offsets that last, and those below rated wind, can be kept from them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, cast

import numpy as np

from wt_gym.control.sensors import LowPass

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.control.controllers.fading import AboveRated

__all__ = ["ResidualPitch"]


class ResidualPitch:
    """Residual pitch behind a fade and a washout.

    The fade multiplies all offsets by the share of `AboveRated`. The washout lets the mean of the blades' offsets pass
    a high-pass filter, tau s / (1 + tau s): what lasts is the business of the base controller, whose integrator
    takes it back above rated wind, so that there no reward depends on it, while below it only costs power. Tilt and
    yaw, or the differences of the blades from their mean, pass as they are.

    Parameters
    ----------
    fade : AboveRated or None
    washout : float or None
        tau [s].
    n_mean : int
        Of how many coordinates, the first ones, the mean is that of the blades; with none there is nothing to wash out.

    Attributes
    ----------
    share : float
        Of the fade [-].
    mean : float
        Mean offset that acts, the share included, where there is a washout [rad].
    fades, washes : bool

    Raises
    ------
    ValueError
        If tau is not positive.
    """

    def __init__(self, fade: AboveRated | None, washout: float | None, n_mean: int):
        if washout is not None and not 0.0 < washout < math.inf:
            raise ValueError(f"residual_washout must be a positive time in s or None, got {washout!r}")
        self.fades, self.washes = fade is not None, washout is not None and n_mean > 0
        self._fade, self._n_mean = fade, n_mean
        self._lasting = LowPass(cast(float, washout)) if self.washes else None
        self.share, self.mean = 1.0, 0.0

    def start(self, pitch: float, rotor_speed: float, dt: float) -> None:
        """Start without offset, in steady state at a pitch [rad] and a rotor speed [rad/s]."""
        self.mean = 0.0
        if self._fade is not None:
            self._fade.start(pitch)
            self.share = self._fade.update((pitch,), rotor_speed, dt)
        if self._lasting is not None:
            self._lasting.reset(0.0)

    def acting(
        self, offsets: NDArray[np.float64], base_pitch: NDArray[np.float64], rotor_speed: float, dt: float
    ) -> NDArray[np.float64]:
        """Offsets that act in a step.

        Parameters
        ----------
        offsets : numpy.ndarray, shape (n_pitch,)
            That the agent asks for, in its coordinates [rad].
        base_pitch : numpy.ndarray, shape (n_blades,)
            Demand of the base controller [rad].
        rotor_speed : float
            [rad/s].
        dt : float
            [s].
        """
        if self._fade is not None:
            self.share = self._fade.update(base_pitch.tolist(), rotor_speed, dt)
        if self._lasting is not None:
            own = offsets[: self._n_mean]
            mean = float(np.add.reduce(own)) / len(own)
            lasting = self._lasting.update(mean, dt)
            self.mean = self.share * (mean - lasting)
            offsets = np.concatenate((own - lasting, offsets[self._n_mean :]))
        return self.share * offsets
