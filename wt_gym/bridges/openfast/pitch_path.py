"""How the pitch gets from command to command within a step: the pitch drives of the simulator, for OpenFAST's steps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import expm

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.turbines import PitchSystem

__all__ = ["PitchPath"]


class PitchPath:
    """Pitch of the blades behind their commands; OpenFAST itself sets the pitch that it is given.

    An ideal drive turns at a rate that changes evenly within a step, from that of the command in the step before to
    that in this one (`wt_gym.simulation.drivetrain.drives.PitchDrives`). A servo, θ̈ = ω² (c − θ) − 2 ζ ω θ̇, follows a
    command that moves evenly; it is integrated exactly.

    Parameters
    ----------
    limits : PitchSystem
    step : float
        Between commands [s].
    count : int
        Steps of OpenFAST in it.

    Attributes
    ----------
    angle, rate : ndarray (n_blades,)
        Now [rad], [rad/s].
    """

    def __init__(self, limits: PitchSystem, step: float, count: int):
        self._step, self._count = step, count
        self._part = np.arange(1, count + 1)[:, None] * (step / count)
        self._servo = None
        if limits.servo_frequency is not None:
            omega, damping = limits.servo_frequency, limits.servo_damping
            # states: angle, rate, command, rate of the command
            system = np.zeros((4, 4))
            system[0, 1] = system[2, 3] = 1.0
            system[1] = [-(omega**2), -2.0 * damping * omega, omega**2, 0.0]
            self._servo = expm(system * (step / count))
        self.angle = self.rate = self._command = np.zeros(0)

    def start(self, pitch: NDArray[np.float64]) -> None:
        """Stand at an angle for each blade (n_blades,) [rad]."""
        self.angle, self._command, self.rate = pitch.copy(), pitch.copy(), np.zeros(pitch.size)

    def follow(self, command: NDArray[np.float64]) -> NDArray[np.float64]:
        """Follow the commands (n_blades,) [rad] through a step; the angles (count, n_blades) at OpenFAST's steps."""
        required = (command - self._command) / self._step
        if self._servo is None:
            turn = (required - self.rate) / (2.0 * self._step)
            path = self.angle + self.rate * self._part + turn * self._part**2
            self.rate = required
        else:
            state = np.stack([self.angle, self.rate, self._command, required])
            path = np.empty((self._count, command.size))
            for k in range(self._count):
                state = self._servo @ state
                path[k] = state[0]
            self.rate = state[1]
        self.angle, self._command = path[-1].copy(), command.copy()
        return path
