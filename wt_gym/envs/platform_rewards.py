"""Reward of a floating platform: how far it swings, and how far it leans."""

import math
from dataclasses import dataclass, field

from wt_gym.envs.terms import HighPass, Transition, bounded_square
from wt_gym.simulation import Signals
from wt_gym.turbines import Turbine


@dataclass(eq=False)
class PlatformMotion:
    """Penalty on the swing of a platform, and on its lean beyond a margin.

    With roll and pitch freed of their mean, (r, p), and the lean t of the tower from upright,
    ``x^2 = (r^2 + p^2) / scale^2 + (max(t - margin, 0) / excess_scale)^2``. Roll counts as pitch does: a motion that is
    moved from one to the other is not less. The filter of the mean is slower than the swing in pitch, of 25 to 35 s,
    so that a lean that an action shifts slowly counts too.

    Parameters
    ----------
    scale : float
        x is 1 for a swing so far from the mean [rad].
    margin : float
        Lean that costs nothing [rad].
    excess_scale : float
        x is 1 for a lean so far beyond [rad].
    time_constant : float
        Of the high-pass filter [s].
    """

    weight: float = 0.0
    scale: float = math.radians(1.5)
    margin: float = math.radians(6.0)
    excess_scale: float = math.radians(2.0)
    time_constant: float = 60.0
    name: str = "platform_motion"
    _filters: tuple[HighPass, ...] = field(default=(), init=False)

    def reset(self, turbine: Turbine, signals: Signals) -> None:
        """Start an episode with the first angles as the mean.

        Raises
        ------
        ValueError
            If the turbine does not float.
        """
        if turbine.floater is None:
            raise ValueError(f"the reward term {self.name} must be that of a floating turbine, got {turbine.name!r}")
        self._filters = tuple(
            HighPass(self.time_constant, signals[name]) for name in ("platform_roll", "platform_pitch")
        )

    def __call__(self, transition: Transition) -> float:
        """Rate of reward [1/s]."""
        if not self._filters:
            self.reset(transition.turbine, transition.before)
        angles = transition.after["platform_roll"], transition.after["platform_pitch"]
        swing = sum(
            high_pass(angle, transition.dt) ** 2 for high_pass, angle in zip(self._filters, angles, strict=True)
        )
        excess = max(math.hypot(*angles) - self.margin, 0.0)
        return -self.weight * bounded_square(swing / self.scale**2 + (excess / self.excess_scale) ** 2)
