"""Floating feedback: the blades answer to the pitch of the platform, so that the speed loop does not drive it.

A platform that pitches with the velocity u of the hub is met by the wind v - u. A controller that holds the speed of
the rotor answers by pitch, and that takes thrust off a rotor that moves upwind: the platform is driven (Larsen and
Hanson, J. Phys. Conf. Ser. 75 (2007) 012073; Jonkman, AIAA 2008-1298). Parallel compensation adds pitch by the motion
of the platform itself (Abbas, Zalkind, Pao and Wright, Wind Energ. Sci. 7 (2022) 53, section 3.6; ``Fl_Kp`` of ROSCO).

Gain and filter follow from the linear speed loop at one steady point above rated (`wt_gym.control.design.DESIGN_WIND`).
With the slopes Q_v, Q_θ, Q_w of the moment of the air about the shaft over wind, pitch and rotor speed, the slope M_w
of the generator's torque, the inertia J, and a law C(s) from rotor speed to pitch with the filter of the speed, the
speed w answers to the velocity u and to a pitch K(s) u that is added:

    J s w = (Q_w - M_w) w + Q_θ (C w + K u) - Q_v u.

With a = (M_w - Q_w)/J, L = -Q_θ C/J and g = -Q_v/Q_θ, which is the slope of the steady pitch over the wind where the
generator holds its torque, the whole pitch is

    θ = C w + K u = (S K - H g) u,   S = (s + a)/(s + a + L),   H = 1 - S.

Thrust changes by T_θ θ with T_θ < 0: the part of θ in phase with u damps the platform where it is positive. At the
natural frequency p of the platform's pitch the loop alone contributes -g Re H(jp), which is negative. A fast loop
takes back what is added: its S(jp) is small and leads u by up to half a turn, so that pitch in phase with u would do no
good. Hence K lags by as much: it is a critically damped low-pass filter of second order with the corner
ω_f = p/tan(½ arg S(jp)) and the gain

    k = g Re H(jp) (1 + p²/ω_f²)/|S(jp)|,

with which Re θ/u = 0 at p: the platform is damped as with blades that rest. For a loop as slow as the platform the
corner is about p and k about g, as ROSCO's tuning has them. Waves are faster than the platform and pass the filter
weakly.

The motion is the pitch rate of the platform about the axis across the nacelle, times the height of the hub: unlike the
acceleration of the nacelle it holds neither surge nor the bending of the tower, nor weight.
"""

import cmath
import math
from typing import Any

import numpy as np

from wt_gym.base.errors import ControllerError
from wt_gym.base.options import Options, option, option_record
from wt_gym.control.actions import Demand
from wt_gym.control.controllers.additions import AboveRated, FadeParameters, fade_option, with_added_pitch
from wt_gym.control.controllers.controller import Controller, Readings, part_of
from wt_gym.control.controllers.discon import BaselineParameters, DisconController
from wt_gym.control.controllers.tsr_tracking import TsrTrackingController
from wt_gym.control.design import DESIGN_WIND, full_power_wind, platform_pitch_frequency, rotor_inertia, trim_pitch
from wt_gym.control.rotor import fine_pitch, rotor_of
from wt_gym.control.sensors import SecondOrderLowPass
from wt_gym.turbines import Turbine


@option_record
class FloatingOptions(Options):
    """Parameters of a `FloatingFeedback`."""

    title = "floating"

    share: float = option(
        "gain over that which takes the speed loop's effect on the damping of the platform's pitch away", default=1.0,
        unit="-", low=0.0, high=20.0,
    )  # fmt: skip
    limit: float = option(
        "largest pitch added or taken off", default=math.radians(6.0), unit="rad", low=0.0, high=math.pi
    )
    fade: bool | float | FadeParameters = fade_option()


def floating_gain(turbine: Turbine, parameters: BaselineParameters) -> tuple[float, float]:
    """Gain from the velocity of the hub to pitch [rad s/m], and corner of the filter [rad/s], see this module.

    Raises
    ------
    wt_gym.base.errors.ControllerError
        For a turbine that does not float; for a loop that no filter of second order makes up for.
    """
    p, wind = platform_pitch_frequency(turbine), DESIGN_WIND * full_power_wind(turbine)
    drive, inertia = turbine.drivetrain, rotor_inertia(turbine)
    speed, pitch = drive.rated_rotor_speed, float(trim_pitch(turbine, np.array([wind]))[0])
    slopes, s = rotor_of(turbine).slopes(wind, speed, pitch), 1j * p
    proportional, integral = parameters.pitch_law.answer(pitch)
    x = s / parameters.corner_frequency
    damping = parameters.filter_damping
    law = (proportional + integral / s) / (1.0 + 2.0 * damping * x + x * x if damping > 0.0 else 1.0 + x)
    power = parameters.torque.rated_power if parameters.constant_power else 0.0
    own = s - (slopes.torque_speed + power / speed**2) / inertia  # a torque that holds the power falls with the speed
    loop = -slopes.torque_pitch * drive.gear_ratio * law / inertia
    passed, answer = own / (own + loop), loop / (own + loop)
    lead = cmath.phase(passed)
    if not 0.0 < lead < math.pi:
        raise ControllerError(
            f"the speed loop of {turbine.name!r} must lead the platform's pitch by 0 to 180 deg for floating feedback, "
            f"got {math.degrees(lead):.0f} deg"
        )
    corner = p / math.tan(0.5 * lead)
    per_wind = -slopes.torque_wind / slopes.torque_pitch
    return per_wind * max(answer.real, 0.0) * (1.0 + (p / corner) ** 2) / abs(passed), corner


class FloatingFeedback:
    """Wrapper: collective pitch by the pitch rate of the platform, on a base whose speed loop it makes up for.

    It fades below rated, where pitch costs power.

    Parameters
    ----------
    base : Controller
        `DisconController` or `TsrTrackingController`, or a wrapper around one.
    **parameters
        Of `FloatingOptions`.

    Attributes
    ----------
    gain : float
        From the filtered velocity of the hub to pitch [rad s/m].
    corner_frequency : float
        Of the filter on the velocity [rad/s].

    Raises
    ------
    wt_gym.base.errors.ControllerError
        See `floating_gain`; for a base whose pitch law is not known.
    """

    def __init__(self, turbine: Turbine, base: Controller, **parameters: Any):
        o = FloatingOptions(**parameters)
        law = part_of(base, DisconController)
        tracking = part_of(base, TsrTrackingController)
        if law is None and tracking is None:
            raise ControllerError(
                f"floating feedback must stand on discon, retuned or tsr_tracking, got {type(base).__name__}; "
                "ROSCO has its own, rosco:floating=2"
            )
        constants = law.parameters if law is not None else tracking.parameters.baseline  # type: ignore[union-attr]
        gain, self.corner_frequency = floating_gain(turbine, constants)
        self.base, self.gain, self.limit = base, o.share * gain, o.limit
        self.height, self.fade = turbine.hub_height, AboveRated.of_turbine(turbine, o.fade)
        self.pitch_limits = (fine_pitch(turbine), turbine.pitch.max_pitch)
        rates = ("platform_roll_rate", "platform_pitch_rate")
        self.channels = tuple(dict.fromkeys((*base.channels, "rotor_speed", "yaw", *rates)))
        self._filter = SecondOrderLowPass(self.corner_frequency, 1.0)

    @property
    def damps_platform(self) -> bool:
        """Its gain is not 0."""
        return self.gain > 0.0

    def start(self, signals: Readings, demand: Demand) -> None:
        """Start the base from the present demand, with nothing added."""
        self.base.start(signals, demand)
        self._filter.reset(0.0)
        if self.fade is not None:
            self.fade.start(float(np.mean(demand.pitch)))

    def step(self, signals: Readings, dt: float) -> Demand:
        """Demand of the base with the pitch of the feedback."""
        demand, yaw = self.base.step(signals, dt), signals["yaw"]
        rate = math.cos(yaw) * signals["platform_pitch_rate"] - math.sin(yaw) * signals["platform_roll_rate"]
        velocity = self._filter.update(self.height * rate, dt)
        before = list(map(float, demand.pitch))  # arrays of three are slow
        share = 1.0 if self.fade is None else self.fade.update(before, signals["rotor_speed"], dt)
        added = share * min(max(self.gain * velocity, -self.limit), self.limit)
        return with_added_pitch(demand, added, self.pitch_limits)
