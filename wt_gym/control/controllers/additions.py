"""Additions to a controller: individual pitch, dampers of the tower and the yaw drive.

How far additions that cost power below rated may act.

Individual pitch control: the flapwise moments of the blades in the fixed frame, driven to zero or into a band.

The multi-blade (Coleman) transform takes the moments of the turning blades to a tilt and a yaw component; what is
constant in the rotating frame's harmonic is constant there, so an integrator per component suffices (Bossanyi, Wind
Energy 6 (2003) 119; azimuth lead of the inverse transform: Mulders et al., arXiv:1808.08976; twice-per-revolution loads
by the transform of twice the azimuth: van Engelen, EWEC 2006). The band on the 2-norm of the two components follows
Hummel, Kober and Mulders, Wind Energ. Sci. 10 (2025) 2005.

Dampers of the tower: fore-aft by collective pitch, side-side by generator torque, both on nacelle accelerations.

The acceleration, integrated and high-passed (`BandLimitedIntegrator`), is the velocity of the vibration. A nacelle that
moves downwind is met by less wind; blades that feather then take off thrust and add to the damping of the air
(Bossanyi, Wind Energy 6 (2003) 119; ROSCO's FA_KI). The torque of the generator turns nacelle and tower top about the
wind's axis; more of it pushes a clockwise turbine's tower top to the right (looking downwind), against a motion to the
left, and a counter-clockwise turbine's to the left.

Yaw by dead-band: the nacelle turns only when it has stood wrong for a while, then until it faces the wind.

The habit of real yaw drives, which are slow and wear: the reading of the vane, averaged over about a minute, must leave
a dead-band of several degrees before the drive starts (compare ROSCO's Y_ErrThresh of 4 … 8 degrees and
Y_uSwitch; Bossanyi et al., Energy Procedia 35 (2013) 177).
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.control.actions import Demand
from wt_gym.control.controllers.controller import parts_of
from wt_gym.control.controllers.parameters import Parameter
from wt_gym.control.design import (
    design_point,
    flap_moment_sensitivity,
    rated_mechanical_power,
    reference_flap_moment,
    tower_top,
)
from wt_gym.control.operating_point import least_pitch
from wt_gym.control.rotor import fine_pitch
from wt_gym.control.sensors import AngleLowPass, BandLimitedIntegrator, LowPass, harmonic_of_blades, to_harmonic
from wt_gym.simulation.drivetrain.drives import pitch_delay

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from typing import Any

    from numpy.typing import NDArray

    from wt_gym.control.controllers.controller import Controller, Readings
    from wt_gym.turbines import PitchSystem, Turbine

__all__ = [
    "FADE", "FORE_AFT_PARAMETERS", "PARAMETERS", "SIDE_SIDE_PARAMETERS", "AboveRated", "FadeParameters",
    "ForeAftDamper", "HarmonicPitch", "HarmonicPitchParameters", "IndividualPitch", "SideSideDamper", "YawByDeadBand",
    "yaw_drive_of",
]  # fmt: skip

_LEAST_FADE, _MOST_FADE = 0.001, 0.5  # [rad]

FADE = Parameter(
    "fade",
    "rad",
    "collective pitch above fine pitch from which on it acts in full, beginning at a sixth of it; True: 0.5° to 3°; "
    "False: always in full",
    _LEAST_FADE,
    _MOST_FADE,
    switch=True,
    kind="FadeParameters",
)
"""Of every addition that fades below rated."""


def _ramp(value: float, low: float, high: float) -> float:
    """Rise from 0 at low to 1 at high with continuous slope."""
    x = min(max((value - low) / (high - low), 0.0), 1.0)
    return x * x * (3.0 - 2.0 * x)


@dataclass(frozen=True)
class FadeParameters:
    """Where an addition begins to act and where it acts in full.

    Attributes
    ----------
    pitch : (float, float)
        Collective pitch above fine pitch [rad].
    speed : (float, float)
        Rotor speed over rated speed [-].
    time_constant : float
        Of the low-pass filter on the pitch [s], so that a swing of the collective pitch does not switch.
    fine_speed : (float, float), optional
        Rotor speed over rated speed at fine pitch [-], where by default nothing acts. About rated wind the loads are
        largest, the blades stand at fine pitch and the rotor near its rated speed.
    """

    pitch: tuple[float, float] = (math.radians(0.5), math.radians(3.0))
    speed: tuple[float, float] = (0.85, 0.95)
    time_constant: float = 5.0
    fine_speed: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for name in ("pitch", "speed") if self.fine_speed is None else ("pitch", "speed", "fine_speed"):
            low, high = getattr(self, name)
            if not low < high:
                raise ValueError(f"fade {name} must be two rising numbers, got {getattr(self, name)!r}")


class AboveRated:
    """Factor from 0 (below rated: leave the blades where they make the most power) to 1 (well above it).

    The product of a ramp in the collective pitch, low-pass filtered, and one in the rotor speed: blades at fine pitch
    mean that the wind is too weak for rated power. With ``fine_speed``, a ramp of its own in the rotor speed holds
    there.

    Parameters
    ----------
    parameters : FadeParameters
    fine_pitch : float
        [rad].
    rated_speed : float
        Of the rotor [rad/s].
    """

    def __init__(self, parameters: FadeParameters, fine_pitch: float, rated_speed: float):
        self.parameters, self.fine_pitch, self.rated_speed = parameters, fine_pitch, rated_speed
        self._pitch = LowPass(parameters.time_constant)

    @classmethod
    def of_turbine(cls, turbine: Turbine, fade: FadeParameters | bool | float = True) -> AboveRated | None:
        """Of a turbine; None where nothing is to fade.

        Parameters
        ----------
        turbine : Turbine
        fade : FadeParameters, bool or float
            True: the default parameters; False: none; a number: the collective pitch above fine pitch from which on the
            addition acts in full [rad], beginning at a sixth of it as by default.

        Raises
        ------
        ValueError
            For a pitch that is not a number from 0.001 to 0.5 rad.
        """
        if fade is False:
            return None
        parameters = FadeParameters() if fade is True else fade
        if not isinstance(parameters, FadeParameters):
            if not (isinstance(fade, int | float | np.floating) and _LEAST_FADE <= fade <= _MOST_FADE):
                raise ValueError(
                    f"fade must be True, False, FadeParameters or a pitch from {_LEAST_FADE:g} to {_MOST_FADE:g} rad, "
                    f"got {fade!r}"
                )
            parameters = FadeParameters(pitch=(fade / 6.0, float(fade)))
        # with peak shaving the blades are pitched below rated too: what counts begins above the least pitch at rated
        fine = least_pitch(turbine, turbine.rated_wind_speed)
        return cls(parameters, fine, turbine.drivetrain.rated_rotor_speed)

    def start(self, pitch: float) -> None:
        """Start in steady state at a collective pitch [rad]."""
        self._pitch.reset(pitch)

    def update(self, pitch: Sequence[float], rotor_speed: float, dt: float) -> float:
        """Factor after a step of ``dt`` [s] with these pitch demands [rad] at a rotor speed [rad/s]."""
        p = self.parameters
        filtered = self._pitch.update(sum(pitch) / len(pitch), dt)
        pitched, ratio = _ramp(filtered - self.fine_pitch, *p.pitch), rotor_speed / self.rated_speed
        share = pitched * _ramp(ratio, *p.speed)
        return share if p.fine_speed is None else share + (1.0 - pitched) * _ramp(ratio, *p.fine_speed)


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


YAW_PARAMETERS = (
    Parameter("dead_band", "rad", "filtered yaw error beyond which the drive starts", 0.0, math.pi, above=True),
    Parameter("stop", "rad", "yaw error at which the drive stops, below the dead band", 0.0, math.pi),
    Parameter("slow", "s", "time constant of the filter on the yaw error while the nacelle rests", 0.0, above=True),
    Parameter("fast", "s", "time constant of the filter on the yaw error while the nacelle turns", 0.0, above=True),
)
"""What can be chosen (`wt_gym.control.controllers.parameters`)."""


class YawByDeadBand:
    """Addition that turns the nacelle into the wind at the greatest rate of its drive.

    At rest the yaw error passes a slow low-pass filter; the drive starts when that leaves the dead-band. Turning, a
    faster filter is read, and the drive stops when the error has become small or has changed sign through zero; the
    slow filter then resumes at that reading. A wind from behind, whose error flips between 180 and -180 degrees, does
    not turn the drive back. A filter of time constant tau delays as much as an average over 2 tau.

    Parameters
    ----------
    rate : float
        Of the drive [rad/s].
    dead_band : float
        Filtered yaw error beyond which the drive starts [rad].
    stop : float
        Error at which it stops [rad].
    slow, fast : float
        Time constants at rest and while turning [s].

    Attributes
    ----------
    turning : int
        +1 or -1 while the drive turns, else 0.
    """

    channels = ("yaw_error",)

    def __init__(
        self,
        rate: float,
        dead_band: float = math.radians(8.0),
        stop: float = math.radians(0.5),
        slow: float = 30.0,
        fast: float = 5.0,
    ):
        if not 0.0 <= stop < dead_band:
            raise ValueError(f"a yaw drive needs 0 <= stop < dead_band, got {stop!r} and {dead_band!r} rad")
        self.rate, self.dead_band, self.stop = float(rate), float(dead_band), float(stop)
        self._slow, self._fast, self.turning = AngleLowPass(slow), AngleLowPass(fast), 0

    @property
    def slow_error(self) -> float:
        """Yaw error behind the slow filter, which starts the drive beyond the dead-band [rad]."""
        return self._slow.value

    @classmethod
    def of_turbine(cls, turbine: Turbine, **parameters: Any) -> YawByDeadBand:
        """With the yaw drive of a turbine; parameters as those of the class."""
        return cls(turbine.nacelle.max_yaw_rate, **parameters)

    def start(self, signals: Readings) -> None:
        """Start at rest, as if the present error had been there for long, but no further than the dead-band."""
        error = signals["yaw_error"]
        self._slow.reset(min(max(error, -self.dead_band), self.dead_band))
        self._fast.reset(error)
        self.turning = 0

    def step(self, signals: Readings, dt: float, demand: Demand) -> Demand:
        """Set the yaw rate."""
        error = signals["yaw_error"]
        slow, fast = self._slow.update(error, dt), self._fast.update(error, dt)
        if self.turning == 0 and abs(slow) > self.dead_band:
            self.turning = 1 if slow > 0.0 else -1
        elif self.turning != 0 and self.turning * fast <= self.stop and abs(fast) < 0.5 * math.pi:
            self.turning = 0
            self._slow.reset(fast)
        return Demand(demand.pitch, self.turning * self.rate, demand.generator_torque)


def yaw_drive_of(controller: Controller | None) -> YawByDeadBand | None:
    """Dead-band control among the parts of a controller, None without any."""
    parts = () if controller is None else parts_of(controller)
    return next((part for part in parts if isinstance(part, YawByDeadBand)), None)
