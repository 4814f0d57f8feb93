"""Additions to a controller: individual pitch, dampers of the tower and the yaw drive.

*Individual pitch*: the multi-blade (Coleman) transform takes the moments of the turning blades to a tilt and a yaw
component; what is constant in the rotating frame's harmonic is constant there, so an integrator per component suffices
(Bossanyi, Wind Energy 6 (2003) 119; azimuth lead of the inverse transform: Mulders et al., arXiv:1808.08976;
twice-per-revolution loads by the transform of twice the azimuth: van Engelen, EWEC 2006). The band on the 2-norm of the
two components follows Hummel, Kober and Mulders, Wind Energ. Sci. 10 (2025) 2005.

*Dampers of the tower*: fore-aft by collective pitch, side-side by generator torque. The acceleration of the nacelle,
integrated and high-passed (`BandLimitedIntegrator`), is the velocity of the vibration. A nacelle that moves downwind is
met by less wind; blades that feather then take off thrust and add to the damping of the air (Bossanyi, Wind Energy 6
(2003) 119; ROSCO's FA_KI). The torque of the generator turns nacelle and tower top about the wind's axis; more of it
pushes a clockwise turbine's tower top to the right (looking downwind), against a motion to the left, and a
counter-clockwise turbine's to the left.

*Yaw by dead-band*: real yaw drives are slow and wear. The reading of the vane, averaged over about a minute, must leave
a dead-band of several degrees before the drive starts (compare ROSCO's Y_ErrThresh of 4 … 8 degrees and Y_uSwitch;
Bossanyi et al., Energy Procedia 35 (2013) 177).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from wt_gym.base.options import Options, option, option_record
from wt_gym.control.actions import Demand
from wt_gym.control.controllers.controller import Controller, Readings, part_of
from wt_gym.control.design import (
    design_point,
    flap_moment_sensitivity,
    rated_mechanical_power,
    reference_flap_moment,
    tower_top,
)
from wt_gym.control.operating_point import least_pitch
from wt_gym.control.rotor import fine_pitch
from wt_gym.control.sensors import AngleLowPass, BandLimitedIntegrator, LowPass, harmonic_of_blades, to_harmonic, within
from wt_gym.simulation.drivetrain.drives import pitch_delay
from wt_gym.turbines import Turbine

# ---- fade below rated ----


def _ramp(value: float, low: float, high: float) -> float:
    """Rise from 0 at low to 1 at high with continuous slope."""
    x = min(max((value - low) / (high - low), 0.0), 1.0)
    return x * x * (3.0 - 2.0 * x)


@option_record
class FadeParameters(Options):
    """Range in which an addition begins to act until it acts in full."""

    title = "fade"

    pitch: tuple[float, float] = option(
        "collective pitch above fine pitch", default=(math.radians(0.5), math.radians(3.0)), unit="rad"
    )
    speed: tuple[float, float] = option("rotor speed over rated speed", default=(0.85, 0.95), unit="-")
    time_constant: float = option(
        "low-pass filter on the pitch, so that an oscillation of the collective pitch does not switch", default=5.0,
        unit="s", low=0.0,
    )  # fmt: skip
    fine_speed: tuple[float, float] | None = option(
        "rotor speed over rated speed at fine pitch, where by default nothing acts. About rated wind the loads are "
        "largest, the blades stand at fine pitch and the rotor near its rated speed", default=None, unit="-",
    )  # fmt: skip

    def check(self) -> None:
        """Refuse ranges without a width."""
        for name in ("pitch", "speed") if self.fine_speed is None else ("pitch", "speed", "fine_speed"):
            low, high = getattr(self, name)
            if not low < high:
                raise ValueError(f"fade {name} must be two rising numbers, got {getattr(self, name)!r}")


def fade_option() -> Any:
    """Parameter ``fade`` of every addition that fades below rated."""
    return option(
        "collective pitch above fine pitch from which on it acts in full, beginning at a sixth of it; True: 0.5° to "
        "3°; False: always in full", default=True, unit="rad", low=0.001, high=0.5, kinds=(FadeParameters,)
    )  # fmt: skip


class AboveRated:
    """Factor from 0 (below rated: leave the blades where they make the most power) to 1 (well above it).

    The product of a ramp in the collective pitch, low-pass filtered, and one in the rotor speed: blades at fine pitch
    mean that the wind is too weak for rated power. With ``fine_speed``, a ramp of its own in the rotor speed holds
    there.
    """

    def __init__(self, parameters: FadeParameters, fine_pitch: float, rated_speed: float):
        self.parameters, self.fine_pitch, self.rated_speed = parameters, fine_pitch, rated_speed
        self._pitch, self._fresh = LowPass(parameters.time_constant), True

    @classmethod
    def of_turbine(cls, turbine: Turbine, fade: FadeParameters | bool | float = True) -> "AboveRated | None":
        """Fade of a turbine, by `fade_option`; None where nothing is to fade."""
        if fade is False:
            return None
        if fade is True:
            fade = FadeParameters()
        parameters = fade if isinstance(fade, FadeParameters) else FadeParameters(pitch=(fade / 6.0, float(fade)))
        # with peak shaving the blades are pitched below rated too: what counts begins above the least pitch at rated
        fine = least_pitch(turbine, turbine.rated_wind_speed)
        return cls(parameters, fine, turbine.drivetrain.rated_rotor_speed)

    def start(self, pitch: float | None = None) -> None:
        """Start in steady state at a collective pitch [rad], by default that of the first update."""
        self._fresh = pitch is None
        if pitch is not None:
            self._pitch.reset(pitch)

    def update(self, pitch: Sequence[float], rotor_speed: float, dt: float) -> float:
        """Factor after a step of ``dt`` [s] with these pitch demands [rad] at a rotor speed [rad/s]."""
        p, mean = self.parameters, sum(pitch) / len(pitch)
        if self._fresh:
            self.start(mean)
        filtered = self._pitch.update(mean, dt)
        pitched, ratio = _ramp(filtered - self.fine_pitch, *p.pitch), rotor_speed / self.rated_speed
        share = pitched * _ramp(ratio, *p.speed)
        return share if p.fine_speed is None else share + (1.0 - pitched) * _ramp(ratio, *p.fine_speed)


class ResidualPitch:
    """Residual pitch behind a fade and a washout.

    The fade multiplies all offsets by the share of `AboveRated`. The washout lets the mean of the blades' offsets pass
    a high-pass filter, tau s / (1 + tau s): what lasts is the business of the base controller, whose integrator
    takes it back above rated wind, so that there no reward depends on it, while below it only costs power. Tilt and
    yaw, or the differences of the blades from their mean, pass as they are.

    Parameters
    ----------
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
        """Offsets (n_pitch,) that act in a step, of those that the agent asks for, in its coordinates [rad].

        The demand of the base controller (n_blades,) [rad] and the rotor speed [rad/s] decide on the fade.
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


# ---- individual pitch ----


@option_record
class IndividualPitchOptions(Options):
    """Parameters of an `IndividualPitch` by rule."""

    title = "ipc"

    bandwidth: float = option(
        "bandwidth of the integral loop in rated rotor speeds", default=0.2, unit="-", low=0.0
    )  # fmt: skip
    proportional_time: float = option(
        "proportional over integral gain; 0: integral control", default=0.0, unit="s", low=0.0
    )
    level: float = option(
        "edge of the band within which nothing is done, in the flap moment at rated power; 0: no band", default=0.0,
        unit="-", low=0.0,
    )  # fmt: skip
    leak_time: float = option(
        "time constant with which the pitch returns within the band", default=10.0, unit="s", low=0.0, above=True
    )
    limit: float = option(
        "largest amplitude of the pitch", default=math.radians(4.0), unit="rad", low=0.0, high=math.pi
    )
    rate_limit: float = option(
        "largest rate of the amplitude in the fixed frame", default=math.radians(1.5), unit="rad/s", low=0.0
    )
    lead: float | None = option(
        "time by which the azimuth of the pitch leads", default=None, unit="s", low=0.0,
        otherwise="the delay of the pitch drive",
    )  # fmt: skip
    simulator_step: float | None = option(
        "step of the simulator, where the controller runs at longer intervals", default=None, unit="s", low=0.0,
        above=True, otherwise="the interval of the controller",
    )  # fmt: skip
    second_harmonic: float = option(
        "gain against the load twice per revolution over that against the first; 0: none", default=0.0, unit="-",
        low=0.0,
    )  # fmt: skip
    fade: bool | float | FadeParameters = fade_option()


@dataclass(frozen=True)
class HarmonicPitchParameters:
    """Constants of the control of one harmonic."""

    harmonic: int = 1  #: 1 or 2, in revolutions
    integral_gain: float = 0.0  #: from moment to rate of pitch [rad/(N m s)]
    proportional_gain: float = 0.0  #: from moment to pitch [rad/(N m)]
    level: float = 0.0  #: moment (2-norm of tilt and yaw) up to which nothing is done [N m]
    leak: float = 0.0  #: rate at which the pitch returns while the moment is inside a band [1/s]
    limit: float = math.radians(4.0)  #: largest amplitude [rad]
    rate_limit: float = math.radians(1.5)  #: largest rate of the amplitude in the fixed frame [rad/s]


class HarmonicPitch:
    """Tilt and yaw pitch of one harmonic: an integrator each, or a proportional-integral law.

    With the moment M = (tilt, yaw) and its part beyond the band, ``e = M max(0, 1 - level/|M|)``,

        ``I <- I + (integral_gain e - leak I [if |M| < level]) dt`` (the leak by its exponential),
        ``theta = I + proportional_gain e``.

    Positive pitch feathers and lowers the moment, hence the signs. The rate of theta, and theta itself, are limited in
    their 2-norm; the integral is set to what the limits let through (anti-windup).
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
        self, moments: Sequence[float] | NDArray[np.float64], azimuth: float, dt: float, lead: float = 0.0,
        share: float = 1.0,
    ) -> list[float]:  # fmt: skip
        """Pitch to be added to each blade [rad], from flapwise root moments (n_blades,) [N m] at an azimuth [rad].

        ``lead`` is the azimuth through which the rotor turns until the blades have the pitch [rad], ``share`` that of
        the gains and of the limit that may be used, 0 … 1; at 0 the pitch returns at the rate limit.
        """
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
        limited, now = within(wanted, share * p.limit), self._pitch
        move = within([w - x for w, x in zip(limited, now, strict=True)], p.rate_limit * dt)
        self._pitch = (now[0] + move[0], now[1] + move[1])
        # without saturation this is the integral again; what did not get through does not pile up
        self._integral = tuple(x - proportional * m for x, m in zip(self._pitch, self._moment, strict=True))
        return harmonic_of_blades(*self._pitch, azimuth + lead, len(moments), p.harmonic)


class IndividualPitch:
    """Addition that pitches each blade against its once- and, on request, twice-per-revolution flapwise moment.

    Below rated it fades out (`AboveRated`): there it would cost power. No blade is pitched below the lower limit of
    the pitch drive, which would turn the pitch of one blade into collective pitch.

    The integral gain is ``bandwidth * Omega / flap_moment_sensitivity``, 3.9e-9 rad/(N m s) for the NREL 5-MW, the
    level that of `reference_flap_moment`. Level and limit of the second harmonic are half those of the first. The lead
    is by default `pitch_delay`; at twice the step of the simulator it is half a step too long, 3.6 degrees for the NREL
    5-MW, without ``simulator_step``.

    Parameters
    ----------
    **parameters
        Of `IndividualPitchOptions`.

    """

    def __init__(self, turbine: Turbine, **parameters: Any):
        o = IndividualPitchOptions(**parameters)
        if turbine.n_blades < 3:
            raise ValueError(f"individual pitch in the fixed frame needs at least 3 blades, got {turbine.n_blades}")
        gain = o.bandwidth * turbine.drivetrain.rated_rotor_speed / flap_moment_sensitivity(turbine)
        first = HarmonicPitchParameters(
            integral_gain=gain, proportional_gain=o.proportional_time * gain,
            level=o.level * reference_flap_moment(turbine), leak=1.0 / o.leak_time, limit=o.limit,
            rate_limit=o.rate_limit,
        )  # fmt: skip
        laws, share = [first], o.second_harmonic
        if share > 0.0:
            second = replace(
                first, harmonic=2, integral_gain=share * gain, proportional_gain=share * first.proportional_gain,
                level=0.5 * first.level, limit=0.5 * o.limit,
            )  # fmt: skip
            laws.append(second)
        self.harmonics = tuple(HarmonicPitch(law) for law in laws)
        self.fade, self.drive, self.n_blades = AboveRated.of_turbine(turbine, o.fade), turbine.pitch, turbine.n_blades
        self.lead, self.simulator_step, self.share = o.lead, o.simulator_step, 0.0
        self._moment_names = tuple(f"root_flap_moment_{b + 1}" for b in range(self.n_blades))
        self.channels = ("azimuth", "rotor_speed", *self._moment_names)

    def start(self, signals: Readings) -> None:
        """Forget everything: nothing is added at this instant."""
        for harmonic in self.harmonics:
            harmonic.start()
        if self.fade is not None:
            self.fade.start()

    def step(self, signals: Readings, dt: float, demand: Demand) -> Demand:
        """Add the pitch of all harmonics."""
        speed, azimuth = signals["rotor_speed"], signals["azimuth"]
        moments = [signals[name] for name in self._moment_names]
        before = list(map(float, demand.pitch))  # arrays of three are slow
        self.share = 1.0 if self.fade is None else self.fade.update(before, speed, dt)
        lead = speed * (pitch_delay(self.drive, dt, self.simulator_step) if self.lead is None else self.lead)
        added = zip(*(h.step(moments, azimuth, dt, lead, self.share) for h in self.harmonics), strict=True)
        wanted = [angle + sum(own) for angle, own in zip(before, added, strict=True)]
        low, high = self.drive.min_pitch, self.drive.max_pitch
        pitch = np.array([min(max(angle, low), high) for angle in wanted])
        return Demand(pitch, demand.yaw_rate, demand.generator_torque)


# ---- dampers of the tower ----


@option_record
class ForeAftOptions(Options):
    """Parameters of a `ForeAftDamper` by rule."""

    title = "fore_aft_damper"

    damping: float = option(
        "damping ratio to be added to the first fore-aft mode", default=0.05, unit="-", low=0.0
    )  # fmt: skip
    limit: float = option(
        "largest pitch added or taken off", default=math.radians(1.5), unit="rad", low=0.0, high=math.pi
    )
    fade: bool | float | FadeParameters = fade_option()


@option_record
class SideSideOptions(Options):
    """Parameters of a `SideSideDamper` by rule."""

    title = "side_side_damper"

    damping: float = option("damping ratio to be added to the first side-side mode", default=0.03, unit="-", low=0.0)
    limit: float = option("largest torque added or taken off, in rated torques", default=0.1, unit="-", low=0.0)


CORNER = 0.2
"""Corner of the high-pass filter in natural frequencies of the tower [-]."""


def with_added_pitch(demand: Demand, added: float, limits: tuple[float, float]) -> Demand:
    """A demand with the same pitch added to all blades [rad], within the least and the greatest pitch.

    No blade is taken below the least pitch, but one stays there that the controller has put there.
    """
    low, high = limits
    angles = map(float, demand.pitch)  # arrays of three are slow
    pitch = np.array([min(max(angle + added, min(angle, low)), high) for angle in angles])
    return Demand(pitch, demand.yaw_rate, demand.generator_torque)


class ForeAftDamper:
    """Addition: collective pitch in proportion to the fore-aft velocity of the nacelle.

    The gain is ``2 damping omega m / |dT/dtheta|`` [rad s/m]. The sensitivity of the thrust is taken from that of the
    power at rated (`design_point`): a rotor whose pitch reduces the power by dP reduces the thrust by dP/V, the
    momentum of a wind of speed V with a third of it left. It fades below rated, where pitch costs power.

    Parameters
    ----------
    **parameters
        Of `ForeAftOptions`.
    """

    channels = ("nacelle_acceleration_fore_aft", "rotor_speed")

    def __init__(self, turbine: Turbine, **parameters: Any):
        o, tower = ForeAftOptions(**parameters), tower_top(turbine)
        power = abs(design_point(turbine).pitch_sensitivity) * rated_mechanical_power(turbine)
        self.gain = 2.0 * o.damping * tower.fore_aft * tower.mass * turbine.rated_wind_speed / power
        self.limit, self.fade = o.limit, AboveRated.of_turbine(turbine, o.fade)
        self.pitch_limits = (fine_pitch(turbine), turbine.pitch.max_pitch)
        self._velocity = BandLimitedIntegrator(CORNER * tower.fore_aft)

    def start(self, signals: Readings) -> None:
        """Forget everything: nothing is added at this instant."""
        self._velocity.reset(signals["nacelle_acceleration_fore_aft"])
        if self.fade is not None:
            self.fade.start()

    def step(self, signals: Readings, dt: float, demand: Demand) -> Demand:
        """Add the pitch."""
        velocity = self._velocity.update(signals["nacelle_acceleration_fore_aft"], dt)
        before = list(map(float, demand.pitch))  # arrays of three are slow
        share = 1.0 if self.fade is None else self.fade.update(before, signals["rotor_speed"], dt)
        added = share * min(max(self.gain * velocity, -self.limit), self.limit)
        return with_added_pitch(demand, added, self.pitch_limits)


class SideSideDamper:
    """Addition: generator torque in proportion to the side-side velocity of the nacelle.

    The gain is ``2 damping omega m / (N c)`` [N m s/m, high-speed shaft], negative for a rotor that turns
    counter-clockwise; N is the gear ratio, and c the force at the top that bends the tower as far as a moment there
    does (`wt_gym.control.design.TowerTop.force_per_moment`).

    Parameters
    ----------
    **parameters
        Of `SideSideOptions`.
    """

    channels = ("nacelle_acceleration_side_side",)

    def __init__(self, turbine: Turbine, **parameters: Any):
        o, tower, drive = SideSideOptions(**parameters), tower_top(turbine), turbine.drivetrain
        gain = 2.0 * o.damping * tower.side_side * tower.mass / (drive.gear_ratio * tower.force_per_moment)
        self.gain = gain if turbine.rotation == "clockwise" else -gain
        rated = rated_mechanical_power(turbine) / (drive.rated_rotor_speed * drive.gear_ratio)
        self.limit, self.max_torque = o.limit * rated, drive.max_generator_torque
        self._velocity = BandLimitedIntegrator(CORNER * tower.side_side)

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


# ---- yaw ----


@option_record
class YawOptions(Options):
    """Parameters of a `YawByDeadBand`."""

    title = "yaw"

    dead_band: float = option(
        "filtered yaw error beyond which the drive starts", default=math.radians(8.0), unit="rad", low=0.0,
        high=math.pi, above=True,
    )  # fmt: skip
    stop: float = option(
        "yaw error at which the drive stops, below the dead band",
        default=math.radians(0.5),
        unit="rad",
        low=0.0,
        high=math.pi,
    )
    slow: float = option(
        "time constant of the filter on the yaw error while the nacelle rests", default=30.0, unit="s", low=0.0
    )
    fast: float = option(
        "time constant of the filter on the yaw error while the nacelle turns", default=5.0, unit="s", low=0.0
    )

    def check(self) -> None:
        """Refuse a drive that stops outside of its dead-band."""
        if not self.stop < self.dead_band:
            raise ValueError(
                f"stop must be at least 0 and below dead_band, got {self.stop!r} and {self.dead_band!r} rad"
            )


class YawByDeadBand:
    """Addition that turns the nacelle into the wind at the greatest rate of its drive.

    At rest the yaw error passes a slow low-pass filter; the drive starts when that leaves the dead-band. Turning, a
    faster filter is read, and the drive stops when the error has become small or has changed sign through zero; the
    slow filter then resumes at that reading. A wind from behind, whose error flips between 180 and -180 degrees, does
    not turn the drive back. A filter of time constant tau delays as much as an average over 2 tau.

    Parameters
    ----------
    **parameters
        Of `YawOptions`.

    Attributes
    ----------
    turning : int
        +1 or -1 while the drive turns, else 0.
    """

    channels = ("yaw_error",)

    def __init__(self, turbine: Turbine, **parameters: Any):
        o = YawOptions(**parameters)
        self.rate, self.dead_band, self.stop = float(turbine.nacelle.max_yaw_rate), o.dead_band, o.stop
        self._slow, self._fast, self.turning = AngleLowPass(o.slow), AngleLowPass(o.fast), 0

    @property
    def slow_error(self) -> float:
        """Yaw error behind the slow filter, which starts the drive beyond the dead-band [rad]."""
        return self._slow.value

    def start(self, signals: Readings) -> None:
        """Start at rest, as if the current error had been there for long, but no further than the dead-band."""
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
    return part_of(controller, YawByDeadBand)
