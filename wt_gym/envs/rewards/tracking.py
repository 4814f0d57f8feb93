"""Penalty on the difference between the electrical power and the power that a grid operator asks for."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from wt_gym.control.operating_point import rotor_inertia
from wt_gym.envs.rewards.power import efficiency

if TYPE_CHECKING:
    from wt_gym.envs.rewards.term import Transition
    from wt_gym.simulation import Signals
    from wt_gym.turbines import Turbine

__all__ = ["PowerTracking"]


class PowerTracking:
    """Penalty on the tracking error, with the kinetic energy of the rotor as a store that is to be given back.

    The rate is ``-w (sqrt(1 + x^2) - 1) - w f dF/dt / (s P_rated)`` with ``x = (P - P_demanded) / (s P_rated)`` at the
    end of the step: quadratic for errors within the scale s, even beyond, the same above and below the reference.

    - The error always counts, also where the wind allows less than what is asked for: a turbine that makes less than
      it could loses as much for every joule then as in any lull. Being even, the penalty gives nothing for shifting
      energy from one deficit to another, and torque that swings about the reference costs.
    - F is how much kinetic energy of rotor and generator, times the efficiency of the drivetrain, is missing to that
      of the start of the episode; never negative. That start may be above rated speed, where controllers hold a rotor
      as a store: what they hold there is not to be sold either. Being a function of the state, ``F`` sums to what is
      missing at the end: taking energy out of the rotor in a lull costs nothing if it comes back, an episode that ends
      with a slower rotor pays f > 1 times what the deficit would have cost, and one that ends with a faster rotor gets
      nothing for it.

    Parameters
    ----------
    weight : float
    scale : float
        s [-].
    missing : float
        f [-].
    name : str
    """

    needs_reference = True

    def __init__(self, weight: float = 0.0, scale: float = 0.05, missing: float = 1.1, name: str = "power_tracking"):
        self.weight, self.scale, self.missing, self.name = weight, scale, missing, name
        self._started = False

    @property
    def worst_rate(self) -> float:
        """Lower bound of the rate [1/s].

        It holds where power and demanded power lie between nothing and twice the rated power, and
        whose rotor loses no more than that.
        """
        most = 2.0 / self.scale
        return -self.weight * (math.hypot(1.0, most) - 1.0 + self.missing * most)

    def reset(self, turbine: Turbine, signals: Signals) -> None:
        """Start an episode."""
        drivetrain = turbine.drivetrain
        self._started = True
        self._unit = self.scale * drivetrain.rated_power
        self._half_inertia = 0.5 * rotor_inertia(turbine) * efficiency(turbine)
        self._full = self._half_inertia * max(signals["rotor_speed"], 0.0) ** 2

    def __call__(self, transition: Transition) -> float:
        """Rate of reward [1/s].

        Raises
        ------
        ValueError
            If nothing is asked for.
        """
        if transition.demanded_power is None:
            raise ValueError("the reward term power_tracking needs a power_reference, got an environment without")
        if not self._started:
            self.reset(transition.turbine, transition.before)
        before, after = transition.before, transition.after
        error = (after["generator_power"] - transition.demanded_power) / self._unit
        grown = (self._lack(after["rotor_speed"]) - self._lack(before["rotor_speed"])) / (transition.dt * self._unit)
        return -self.weight * (math.hypot(1.0, error) - 1.0 + self.missing * grown)

    def _lack(self, rotor_speed: float) -> float:
        """Kinetic energy that is missing [J]."""
        return float(max(self._full - self._half_inertia * max(rotor_speed, 0.0) ** 2, 0.0))
