"""Dampers of the tower: fore-aft by collective pitch, side-side by generator torque, both on nacelle accelerations.

The acceleration, integrated and high-passed (`BandLimitedIntegrator`), is the velocity of the vibration. A nacelle that
moves downwind is met by less wind; blades that feather then take off thrust and add to the damping of the air
(Bossanyi, Wind Energy 6 (2003) 119; ROSCO's FA_KI). The torque of the generator turns nacelle and tower top about the
wind's axis; more of it pushes a clockwise turbine's tower top to the right (looking downwind), against a motion to the
left, and a counter-clockwise turbine's to the left.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.control.actions import Demand
from wt_gym.control.controllers.fading import FADE, AboveRated, FadeParameters
from wt_gym.control.controllers.filters import BandLimitedIntegrator
from wt_gym.control.controllers.parameters import Parameter
from wt_gym.control.controllers.rotor_rules import tower_top
from wt_gym.control.design import design_point, fine_pitch, rated_mechanical_power

if TYPE_CHECKING:
    from wt_gym.control.controllers.controller import Readings
    from wt_gym.turbines import Turbine

__all__ = ["FORE_AFT_PARAMETERS", "SIDE_SIDE_PARAMETERS", "ForeAftDamper", "SideSideDamper"]

FORE_AFT_PARAMETERS = (
    Parameter("damping", "-", "damping ratio to be added to the first fore-aft mode", 0.0),
    Parameter("limit", "rad", "largest pitch added or taken off", 0.0, math.pi),
    FADE,
)
SIDE_SIDE_PARAMETERS = (
    Parameter("damping", "-", "damping ratio to be added to the first side-side mode", 0.0),
    Parameter("limit", "-", "largest torque added or taken off, in rated torques", 0.0),
)
"""What can be chosen (`wt_gym.control.controllers.parameters`)."""

CORNER = 0.2
"""Corner of the high-pass filter in natural frequencies of the tower [-]."""


class ForeAftDamper:
    """Addition: collective pitch in proportion to the fore-aft velocity of the nacelle.

    Parameters
    ----------
    gain : float
        From velocity to pitch [rad s/m].
    corner : float
        Of the high-pass filter [rad/s].
    limit : float
        Largest pitch added or taken off [rad].
    fade : AboveRated or None
        Below rated, pitch costs power; None: always in full.
    pitch_limits : (float, float)
        [rad].
    """

    channels = ("nacelle_acceleration_fore_aft", "rotor_speed")

    def __init__(
        self, gain: float, corner: float, limit: float, fade: AboveRated | None, pitch_limits: tuple[float, float]
    ) -> None:
        self.gain, self.limit, self.fade, self.pitch_limits = gain, limit, fade, tuple(pitch_limits)
        self._velocity, self._fresh = BandLimitedIntegrator(corner), True

    @classmethod
    def of_turbine(
        cls,
        turbine: Turbine,
        damping: float = 0.05,
        limit: float = math.radians(1.5),
        fade: FadeParameters | bool | float = True,
    ) -> ForeAftDamper:
        """Gain by rule: ``2 damping omega m / |dT/dtheta|``.

        The sensitivity of the thrust is taken from that of the power at rated (`design_point`): a rotor whose pitch
        reduces the power by dP reduces the thrust by dP/V, the momentum of a wind of speed V with a third of it left.

        Parameters
        ----------
        turbine : Turbine
        damping : float
            Damping ratio of the first fore-aft mode to be added [-].
        limit : float
            [rad].
        fade : FadeParameters, bool or float
            As of `AboveRated.of_turbine`; False: always in full.
        """
        tower = tower_top(turbine)
        power = abs(design_point(turbine).pitch_sensitivity) * rated_mechanical_power(turbine)
        gain = 2.0 * damping * tower.fore_aft * tower.mass * turbine.rated_wind_speed / power
        fading = AboveRated.of_turbine(turbine, fade)
        limits = (fine_pitch(turbine), turbine.pitch.max_pitch)
        return cls(gain, CORNER * tower.fore_aft, limit, fading, limits)

    def start(self, signals: Readings) -> None:
        """Forget everything: nothing is added at this instant."""
        self._velocity.reset(signals["nacelle_acceleration_fore_aft"])
        self._fresh = True

    def step(self, signals: Readings, dt: float, demand: Demand) -> Demand:
        """Add the pitch."""
        velocity = self._velocity.update(signals["nacelle_acceleration_fore_aft"], dt)
        before = list(map(float, demand.pitch))  # arrays of three are slow
        share = 1.0
        if self.fade is not None:
            if self._fresh:
                self.fade.start(float(np.mean(demand.pitch)))
            share = self.fade.update(before, signals["rotor_speed"], dt)
        self._fresh = False
        added = share * min(max(self.gain * velocity, -self.limit), self.limit)
        # the damper takes no blade below fine pitch, but leaves one there that the controller has put there
        low, high = self.pitch_limits
        pitch = np.array([min(max(angle + added, min(angle, low)), high) for angle in before])
        return Demand(pitch, demand.yaw_rate, demand.generator_torque)


class SideSideDamper:
    """Addition: generator torque in proportion to the side-side velocity of the nacelle.

    Parameters
    ----------
    gain : float
        From velocity to torque on the high-speed shaft [N m s/m]; negative for a rotor that turns counter-clockwise.
    corner : float
        Of the high-pass filter [rad/s].
    limit : float
        Largest torque added or taken off [N m].
    max_torque : float
        [N m].
    """

    channels = ("nacelle_acceleration_side_side",)

    def __init__(self, gain: float, corner: float, limit: float, max_torque: float):
        self.gain, self.limit, self.max_torque = gain, limit, max_torque
        self._velocity = BandLimitedIntegrator(corner)

    @classmethod
    def of_turbine(cls, turbine: Turbine, damping: float = 0.03, limit: float = 0.1) -> SideSideDamper:
        """Gain by rule: ``2 damping omega m / (N c)``.

        c is the force at the top that bends the tower as far as a moment there does
        (`rotor_rules.TowerTop.force_per_moment`), N the gear ratio.

        Parameters
        ----------
        turbine : Turbine
        damping : float
            Damping ratio of the first side-side mode to be added [-].
        limit : float
            Largest torque added, in rated torques [-].
        """
        tower, drivetrain = tower_top(turbine), turbine.drivetrain
        gain = 2.0 * damping * tower.side_side * tower.mass / (drivetrain.gear_ratio * tower.force_per_moment)
        gain = gain if turbine.rotation == "clockwise" else -gain
        rated = rated_mechanical_power(turbine) / (drivetrain.rated_rotor_speed * drivetrain.gear_ratio)
        return cls(gain, CORNER * tower.side_side, limit * rated, drivetrain.max_generator_torque)

    def start(self, signals: Readings) -> None:
        """Forget everything: nothing is added at this instant."""
        self._velocity.reset(signals["nacelle_acceleration_side_side"])

    def step(self, signals: Readings, dt: float, demand: Demand) -> Demand:
        """Add the torque, where there is any: a generator without torque stays without."""
        velocity = self._velocity.update(signals["nacelle_acceleration_side_side"], dt)
        limit = min(self.limit, 0.5 * demand.generator_torque)
        added = min(max(self.gain * velocity, -limit), limit)
        torque = min(demand.generator_torque + added, max(self.max_torque, demand.generator_torque))
        return Demand(demand.pitch, demand.yaw_rate, torque)
