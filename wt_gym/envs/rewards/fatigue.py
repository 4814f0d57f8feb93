"""Penalties on what wears blades and tower: moments freed of their slow mean, squared.

Damage grows with the ranges of a load and hardly with its mean. The square of a moment behind a high-pass filter is a
local measure of those ranges: unlike the change of a moment per step it keeps the slow, large swings that dominate the
damage of blades and tower (``docs/rewards.md``).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from wt_gym.control.design import reference_flap_moment, reference_tower_moment
from wt_gym.control.sensors import to_harmonic
from wt_gym.envs.rewards.term import HighPass, bounded_square

if TYPE_CHECKING:
    from wt_gym.envs.rewards.term import Transition
    from wt_gym.simulation import Signals
    from wt_gym.turbines import Turbine

__all__ = ["AVERAGED", "BladeFatigue", "TowerForeAftFatigue", "TowerSideSideFatigue"]

AVERAGED = ("root_flap_moment", "tower_base_fore_aft_moment", "tower_base_side_side_moment")
"""Loads whose high-pass filters begin an episode with the running mean of the turbine that runs before it."""


class BladeFatigue:
    """Penalty on the flapwise root moments freed of their mean: blade by blade and in the fixed frame.

    With m_b the high-passed moment of blade b at azimuth psi_b the tilt and yaw moments of the rotor are
    ``m_t = 2/N sum m_b cos psi_b`` and ``m_y = 2/N sum m_b sin psi_b`` (Coleman's transformation, e.g. Bir,
    NREL/CP-500-42553). The penalty is on ``x^2 = ((1 - s) mean(m_b^2) + s (m_t^2 + m_y^2) / 2) / (scale M)^2`` with M
    of `reference_loads.reference_flap_moment`. For three blades ``mean(m_b^2) = m_0^2 + (m_t^2 + m_y^2) / 2``,
    m_0 being the mean of the blades: the share s takes weight from m_0, which follows the turbulence that is common to
    all blades and that nobody can control much.

    Parameters
    ----------
    weight : float
    scale : float
        x is 1 for a moment of this share of the reference moment [-].
    fixed_frame : float
        Share s of the tilt and yaw moments, from 0 to 1 [-].
    time_constant : float
        Of the high-pass filter [s]; the load of one turn passes.
    name : str
    """

    begins_with_means = True

    def __init__(
        self,
        weight: float = 1.5,
        scale: float = 0.35,
        fixed_frame: float = 0.5,
        time_constant: float = 10.0,
        name: str = "blade_fatigue",
    ):
        self.weight, self.scale, self.fixed_frame = weight, scale, fixed_frame
        self.time_constant, self.name = time_constant, name
        self._started = False

    def reset(self, turbine: Turbine, signals: Signals) -> None:
        """Start an episode with the mean moment of all blades, of the signals given, as the mean of each."""
        self._started, n = True, turbine.n_blades
        mean = sum(signals["root_flap_moment"].tolist()) / n
        self._filters = [HighPass(self.time_constant, mean) for _ in range(n)]
        self._reference = self.scale * reference_flap_moment(turbine)

    def __call__(self, transition: Transition) -> float:
        """Rate of reward [1/s]."""
        if not self._started:
            self.reset(transition.turbine, transition.before)
        after, dt = transition.after, transition.dt
        measured = after["root_flap_moment"].tolist()  # numbers one by one: arrays of three are slow
        moments = [high_pass(moment, dt) for high_pass, moment in zip(self._filters, measured, strict=True)]
        tilt, yaw = to_harmonic(moments, after["azimuth"])
        single = sum([m * m for m in moments]) / len(moments)
        square = (1.0 - self.fixed_frame) * single + self.fixed_frame * 0.5 * (tilt * tilt + yaw * yaw)
        return -self.weight * bounded_square(square / (self._reference * self._reference))


class _TowerFatigue:
    """Penalty on a bending moment of the tower base freed of its mean; x = moment / (``scale`` M).

    M is the moment of the Betz thrust at rated wind at hub height.
    """

    _channel: str
    begins_with_means = True

    def __init__(self, weight: float, scale: float, time_constant: float, name: str):
        self.weight, self.scale, self.time_constant, self.name = weight, scale, time_constant, name
        self._started = False

    def reset(self, turbine: Turbine, signals: Signals) -> None:
        """Start an episode with the first moment as the mean."""
        self._started = True
        self._filter = HighPass(self.time_constant, signals[self._channel])
        self._reference = self.scale * reference_tower_moment(turbine)

    def __call__(self, transition: Transition) -> float:
        """Rate of reward [1/s]."""
        if not self._started:
            self.reset(transition.turbine, transition.before)
        x = self._filter(transition.after[self._channel], transition.dt) / self._reference
        return -self.weight * bounded_square(x * x)


class TowerForeAftFatigue(_TowerFatigue):
    """Penalty on the fore-aft moment of the tower base freed of its mean; x = moment / (``scale`` M).

    Parameters
    ----------
    weight : float
    scale : float
        x is 1 for a moment of this share of that of the Betz thrust at rated wind at hub height [-].
    time_constant : float
        Of the high-pass filter [s].
    name : str
    """

    _channel = "tower_base_fore_aft_moment"

    def __init__(
        self,
        weight: float = 1.0,
        scale: float = 0.33,
        time_constant: float = 10.0,
        name: str = "tower_fore_aft_fatigue",
    ):
        super().__init__(weight, scale, time_constant, name)


class TowerSideSideFatigue(_TowerFatigue):
    """Penalty on the side-side moment of the tower base freed of its mean; x = moment / (``scale`` M).

    Parameters
    ----------
    weight : float
    scale : float
        x is 1 for a moment of this share of that of the Betz thrust at rated wind at hub height [-].
    time_constant : float
        Of the high-pass filter [s].
    name : str
    """

    _channel = "tower_base_side_side_moment"

    def __init__(
        self,
        weight: float = 1.0,
        scale: float = 0.08,
        time_constant: float = 10.0,
        name: str = "tower_side_side_fatigue",
    ):
        super().__init__(weight, scale, time_constant, name)
