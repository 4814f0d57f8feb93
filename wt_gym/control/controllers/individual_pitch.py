"""Individual pitch control: the flapwise moments of the blades in the fixed frame, driven to zero or into a band.

The multi-blade (Coleman) transform takes the moments of the turning blades to a tilt and a yaw component; what is
constant in the rotating frame's harmonic is constant there, so an integrator per component suffices (Bossanyi, Wind
Energy 6 (2003) 119; azimuth lead of the inverse transform: Mulders et al., arXiv:1808.08976; twice-per-revolution loads
by the transform of twice the azimuth: van Engelen, EWEC 2006). The band on the 2-norm of the two components follows
Hummel, Kober and Mulders, Wind Energ. Sci. 10 (2025) 2005.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.control.actions import Demand
from wt_gym.control.coleman import harmonic_of_blades, to_harmonic
from wt_gym.control.controllers.fading import FADE, AboveRated, FadeParameters
from wt_gym.control.controllers.parameters import Parameter
from wt_gym.control.controllers.rotor_rules import flap_moment_sensitivity
from wt_gym.control.reference_loads import reference_flap_moment
from wt_gym.simulation.drivetrain.drives import pitch_delay

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from wt_gym.control.controllers.controller import Readings
    from wt_gym.turbines import PitchSystem, Turbine

__all__ = ["PARAMETERS", "HarmonicPitch", "HarmonicPitchParameters", "IndividualPitch"]

PARAMETERS = (
    Parameter("bandwidth", "-", "bandwidth of the integral loop in rated rotor speeds", 0.0),
    Parameter("proportional_time", "s", "proportional over integral gain; 0: integral control", 0.0),
    Parameter(
        "level",
        "-",
        "edge of the band within which nothing is done, in the flap moment at rated power; 0: no band",
        0.0,
    ),
    Parameter("leak_time", "s", "time constant with which the pitch returns within the band", 0.0, above=True),
    Parameter("limit", "rad", "largest amplitude of the pitch", 0.0, math.pi),
    Parameter("rate_limit", "rad/s", "largest rate of the amplitude in the fixed frame", 0.0),
    Parameter(
        "lead", "s", "time by which the azimuth of the pitch leads", 0.0, otherwise="the delay of the pitch drive"
    ),
    Parameter(
        "simulator_step",
        "s",
        "step of the simulator, where the controller runs at longer intervals",
        0.0,
        above=True,
        otherwise="the interval of the controller",
    ),
    Parameter(
        "second_harmonic", "-", "gain against the load twice per revolution over that against the first; 0: none", 0.0
    ),
    FADE,
)
"""What can be chosen (`wt_gym.control.controllers.parameters`)."""


@dataclass(frozen=True)
class HarmonicPitchParameters:
    """Constants of the control of one harmonic.

    Attributes
    ----------
    harmonic : int
        1 or 2, in revolutions.
    integral_gain : float
        From moment to rate of pitch [rad/(N m s)].
    proportional_gain : float
        From moment to pitch [rad/(N m)].
    level : float
        Moment (2-norm of tilt and yaw) up to which nothing is done [N m]; zero drives the moment to zero.
    leak : float
        Rate at which the pitch returns while the moment is inside a band [1/s]; without a band it is not used.
    limit : float
        Largest amplitude [rad].
    rate_limit : float
        Largest rate of the amplitude in the fixed frame [rad/s].
    """

    harmonic: int = 1
    integral_gain: float = 0.0
    proportional_gain: float = 0.0
    level: float = 0.0
    leak: float = 0.0
    limit: float = math.radians(4.0)
    rate_limit: float = math.radians(1.5)

    def __post_init__(self) -> None:
        if self.harmonic not in (1, 2):
            raise ValueError(f"harmonic must be 1 or 2, got {self.harmonic!r}")
        for name in ("integral_gain", "proportional_gain", "level", "leak", "limit", "rate_limit"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise ValueError(f"{name} must be finite and not negative, got {getattr(self, name)!r}")


class HarmonicPitch:
    """Tilt and yaw pitch of one harmonic: an integrator each, or a proportional-integral law.

    With the moment M = (tilt, yaw) and its part beyond the band, ``e = M max(0, 1 - level/|M|)``,

        ``I <- I + (integral_gain e - leak I [if |M| < level]) dt`` (the leak by its exponential),
        ``theta = I + proportional_gain e``.

    Positive pitch feathers and lowers the moment, hence the signs. The rate of theta, and theta itself, are limited in
    their 2-norm; the integral is set to what the limits let through (anti-windup).

    Parameters
    ----------
    parameters : HarmonicPitchParameters
    """

    def __init__(self, parameters: HarmonicPitchParameters):
        self.parameters = parameters
        self._integral: tuple[float, ...]
        self.start()

    def start(self) -> None:
        """Forget everything."""
        self._pitch = self._moment = self._integral = (0.0, 0.0)

    @property
    def pitch(self) -> NDArray[np.float64]:
        """Tilt and yaw component after the last step [rad], shape (2,)."""
        return np.array(self._pitch)

    @property
    def moment(self) -> NDArray[np.float64]:
        """Tilt and yaw component measured last [N m], shape (2,)."""
        return np.array(self._moment)

    def step(
        self,
        moments: Sequence[float] | NDArray[np.float64],
        azimuth: float,
        dt: float,
        lead: float = 0.0,
        share: float = 1.0,
    ) -> NDArray[np.float64]:
        """Pitch to be added to each blade [rad], shape (n_blades,).

        Parameters
        ----------
        moments : sequence of float, length n_blades
            Flapwise root moments [N m].
        azimuth, dt : float
            [rad], [s].
        lead : float
            Azimuth through which the rotor turns until the blades have the pitch [rad].
        share : float
            Of the gains and of the limit that may be used, 0 … 1; at 0 the pitch returns at the rate limit.
        """
        return np.array(self.turn(moments, azimuth, dt, lead, share))

    def turn(
        self,
        moments: Sequence[float] | NDArray[np.float64],
        azimuth: float,
        dt: float,
        lead: float = 0.0,
        share: float = 1.0,
    ) -> list[float]:
        """The same as a list, for callers that use numbers one by one."""
        p = self.parameters
        self._moment = to_harmonic(moments, azimuth, p.harmonic)
        size = math.hypot(*self._moment)
        beyond = 1.0 - p.level / size if size > p.level else 0.0
        kept = math.exp(-p.leak * dt) if size < p.level else 1.0
        integrated, proportional = share * p.integral_gain * dt * beyond, share * p.proportional_gain * beyond
        wanted = [
            kept * integral + (integrated + proportional) * moment
            for integral, moment in zip(self._integral, self._moment, strict=True)
        ]
        wanted = _within(wanted, share * p.limit)
        now = self._pitch
        move = _within([w - x for w, x in zip(wanted, now, strict=True)], p.rate_limit * dt)
        self._pitch = (now[0] + move[0], now[1] + move[1])
        # without saturation this is the integral again; what did not get through does not pile up
        self._integral = tuple(x - proportional * m for x, m in zip(self._pitch, self._moment, strict=True))
        return harmonic_of_blades(*self._pitch, azimuth + lead, len(moments), p.harmonic)


def _within(vector: list[float], size: float) -> list[float]:
    """Vector shortened to a size."""
    length = math.hypot(*vector)
    return vector if length <= size else [x * size / length for x in vector]


class IndividualPitch:
    """Addition that pitches each blade against its once- and, on request, twice-per-revolution flapwise moment.

    Below rated it fades out (`AboveRated`): there it would cost power. No blade is pitched below the lower limit of
    the pitch drive, which would turn the pitch of one blade into collective pitch.

    Parameters
    ----------
    harmonics : sequence of HarmonicPitchParameters
    fade : AboveRated or None
        None: always in full.
    drive : PitchSystem
        Its limits hold, and its delay leads the azimuth.
    n_blades : int
    lead : float, optional
        Time by which the azimuth leads [s]; by default `pitch_delay` at the interval of the controller.
    simulator_step : float, optional
        Step of the simulator [s], by default the interval of the controller. At twice the step the lead is else half a
        step too long, 3.6 degrees for the NREL 5-MW.

    Attributes
    ----------
    harmonics : tuple of HarmonicPitch
    share : float
        In which it acts at the moment.
    """

    def __init__(
        self,
        harmonics: Iterable[HarmonicPitchParameters],
        fade: AboveRated | None,
        drive: PitchSystem,
        n_blades: int = 3,
        lead: float | None = None,
        simulator_step: float | None = None,
    ) -> None:
        self.harmonics = tuple(HarmonicPitch(p) for p in harmonics)
        if n_blades < 3:
            raise ValueError(f"individual pitch in the fixed frame needs at least 3 blades, got {n_blades}")
        if lead is not None and not 0.0 <= lead < math.inf:
            raise ValueError(f"lead must be finite and not negative, got {lead!r}")
        if simulator_step is not None and not 0.0 < simulator_step < math.inf:
            raise ValueError(f"simulator_step must be finite and positive, got {simulator_step!r}")
        self.fade, self.drive, self.n_blades = fade, drive, n_blades
        self.lead, self.simulator_step = lead, simulator_step
        self.share, self._fresh = 0.0, True
        self._moment_names = tuple(f"root_flap_moment_{b + 1}" for b in range(n_blades))
        self.channels = ("azimuth", "rotor_speed", *self._moment_names)

    @classmethod
    def of_turbine(
        cls,
        turbine: Turbine,
        bandwidth: float = 0.2,
        proportional_time: float = 0.0,
        level: float = 0.0,
        leak_time: float = 10.0,
        limit: float = math.radians(4.0),
        rate_limit: float = math.radians(1.5),
        lead: float | None = None,
        simulator_step: float | None = None,
        second_harmonic: float = 0.0,
        fade: FadeParameters | bool | float = True,
    ) -> IndividualPitch:
        """Gains by rule for a turbine.

        Parameters
        ----------
        turbine : Turbine
        bandwidth : float
            Of the integral loop in rated rotor speeds [-]: the integral gain is
            ``bandwidth * Omega / flap_moment_sensitivity``, 3.9e-9 rad/(N m s) for the NREL 5-MW.
        proportional_time : float
            Proportional over integral gain [s]; zero for integral control.
        level : float
            Edge of the band, in `reference_flap_moment` [-].
        leak_time : float
            Time constant of the return inside the band [s].
        limit, rate_limit : float
            Of the amplitude [rad], [rad/s].
        lead, simulator_step : float, optional
            See the class.
        second_harmonic : float
            Gain of the second harmonic over that of the first; zero leaves it out. Its limit is half that of the first.
        fade : FadeParameters, bool or float
            As of `AboveRated.of_turbine`; False: always in full.
        """
        speed, sensitivity = turbine.drivetrain.rated_rotor_speed, flap_moment_sensitivity(turbine)
        gain = bandwidth * speed / sensitivity
        first = HarmonicPitchParameters(
            harmonic=1,
            integral_gain=gain,
            proportional_gain=proportional_time * gain,
            level=level * reference_flap_moment(turbine),
            leak=1.0 / leak_time,
            limit=limit,
            rate_limit=rate_limit,
        )
        harmonics = [first]
        if second_harmonic > 0.0:
            second = {"harmonic": 2, "integral_gain": second_harmonic * gain, "limit": 0.5 * limit}
            second |= {"proportional_gain": second_harmonic * first.proportional_gain, "level": 0.5 * first.level}
            harmonics.append(HarmonicPitchParameters(**{**asdict(first), **second}))
        fading = AboveRated.of_turbine(turbine, fade)
        return cls(harmonics, fading, turbine.pitch, turbine.n_blades, lead, simulator_step)

    def start(self, signals: Readings) -> None:
        """Forget everything: nothing is added at this instant."""
        for harmonic in self.harmonics:
            harmonic.start()
        self._fresh = True

    def step(self, signals: Readings, dt: float, demand: Demand) -> Demand:
        """Add the pitch of all harmonics."""
        speed, azimuth = signals["rotor_speed"], signals["azimuth"]
        moments = [signals[name] for name in self._moment_names]
        before = list(map(float, demand.pitch))  # arrays of three are slow
        self.share = 1.0
        if self.fade is not None:
            if self._fresh:
                self.fade.start(float(np.mean(demand.pitch)))
            self.share = self.fade.update(before, speed, dt)
        self._fresh = False
        lead = speed * (pitch_delay(self.drive, dt, self.simulator_step) if self.lead is None else self.lead)
        added = zip(*(h.turn(moments, azimuth, dt, lead, self.share) for h in self.harmonics), strict=True)
        wanted = [angle + sum(own) for angle, own in zip(before, added, strict=True)]
        low, high = self.drive.min_pitch, self.drive.max_pitch
        pitch = np.array([min(max(angle, low), high) for angle in wanted])
        return Demand(pitch, demand.yaw_rate, demand.generator_torque)
