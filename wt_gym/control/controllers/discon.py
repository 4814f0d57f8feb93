"""The baseline controller: the law of the NREL 5-MW's (DISCON) with the constants of any turbine.

Variable-speed torque control and gain-scheduled collective pitch control as published by Jonkman et al. (Definition of
a 5-MW Reference Wind Turbine, NREL/TP-500-38060, 2009, section 7).

Gains of the collective pitch (`PitchLaw`) come in one of two forms. As published for the NREL 5-MW (NREL/TP-500-38060,
section 7.3), a factor
``GK = 1/(1 + theta/theta_K)`` before both gains and the integral of the speed error. Or as a table over the pitch, as
in ROSCO's input files (Abbas et al., Wind Energ. Sci. 7 (2022) 53, section 3.2): then the integral gain stands inside
the integral, so that a gain that changes with the pitch does not move the demand.
"""

import math
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from wt_gym.base.errors import ControllerError
from wt_gym.control.actions import Demand
from wt_gym.control.controllers.controller import Readings
from wt_gym.control.design import FILTER_OVER_ROTOR_SPEED, DesignPoint, design_point, drive_mode, rotor_inertia
from wt_gym.control.operating_point import TorqueCurve, operating_point, torque_curve
from wt_gym.control.sensors import LowPass, Notch, SecondOrderLowPass
from wt_gym.turbines import Turbine, load_turbine


@dataclass(frozen=True)
class GainTable:
    """Gains over the pitch, linear between the points and held beyond the ends."""

    pitch: tuple[float, ...]  #: ascending [rad]
    proportional: tuple[float, ...]  #: from generator speed error [rad/s] to pitch [s]
    integral: tuple[float, ...]  #: [-]

    def __post_init__(self) -> None:
        if not len(self.pitch) == len(self.proportional) == len(self.integral) > 0:
            raise ControllerError(
                f"a gain table needs as many gains as pitch angles, at least one, got {len(self.pitch)} angles, "
                f"{len(self.proportional)} and {len(self.integral)} gains"
            )
        if not all(gain > 0.0 for gain in self.integral):
            raise ControllerError(f"integral gains of a table must be positive, got {self.integral}")

    def at(self, pitch: float) -> tuple[float, float]:
        """Proportional and integral gain at a pitch [rad]."""
        return (
            float(np.interp(pitch, self.pitch, self.proportional)),
            float(np.interp(pitch, self.pitch, self.integral)),
        )


@dataclass(frozen=True)
class PitchLaw:
    """The law; its memory, the integral, is given and returned."""

    proportional_gain: float  #: at zero pitch [s]
    integral_gain: float  #: at zero pitch [-]
    gain_doubling_pitch: float  #: pitch at which the gains are halved [rad]
    table: GainTable | None = None  #: takes the place of the three

    def factor(self, pitch: float) -> float:
        """Gain reduction GK for the stronger response of the rotor at larger pitch [-]."""
        return 1.0 / (1.0 + pitch / self.gain_doubling_pitch)

    def gains(self, pitch: float) -> tuple[float, float]:
        """Proportional and integral gain at a pitch [rad]."""
        if self.table is not None:
            return self.table.at(pitch)
        factor = self.factor(pitch)
        return factor * self.proportional_gain, factor * self.integral_gain

    def answer(self, pitch: float) -> tuple[float, float]:
        """Gains of small changes about a pitch [rad]: the published factor falls as the pitch that it makes rises."""
        proportional, integral = self.gains(pitch)
        fall = 0.0 if self.table is not None else self.factor(pitch) * pitch / self.gain_doubling_pitch
        return proportional / (1.0 + fall), integral / (1.0 + fall)

    def holding(self, pitch: float, error: float | None = None) -> float:
        """Integral with which the law demands the current pitch [rad] at a speed error [rad/s].

        Without an error the integral alone holds the pitch.
        """
        if self.table is not None:
            return pitch - (0.0 if error is None else self.table.at(pitch)[0] * error)
        if error is None:
            return pitch / (self.factor(pitch) * self.integral_gain)
        return (pitch / self.factor(pitch) - self.proportional_gain * error) / self.integral_gain

    def step(
        self, pitch: float, integral: float, error: float, dt: float, low: float, high: float
    ) -> tuple[float, float]:
        """Pitch demand within the limits ``low`` and ``high`` [rad], and the integral, held there too (anti-windup).

        Gains are those of the previous demand ``pitch`` [rad]; the integral is that of the speed error [rad], or with a
        table that of the pitch [rad]; the error is one of the speed [rad/s], over ``dt`` [s].
        """
        if self.table is not None:
            proportional, gain = self.table.at(pitch)
            integral = min(max(integral + gain * error * dt, low), high)
            return min(max(proportional * error + integral, low), high), integral
        factor = self.factor(pitch)
        to_integral = 1.0 / (factor * self.integral_gain)
        integral = integral + error * dt
        integral = min(max(integral, low * to_integral), high * to_integral)
        demand = factor * (self.proportional_gain * error + self.integral_gain * integral)
        return min(max(demand, low), high), integral

    def moved(self, before: float, change: float, integral: float) -> float:
        """Integral with which the next demand is moved by ``change`` [rad] from the current one ``before`` [rad].

        The gain factor stands before the integral too: a shift of the integral alone would shrink with the factor that
        belongs to the new pitch.
        """
        if self.table is not None:
            return integral + change
        integral = self.factor(before) * integral + change / self.integral_gain
        return integral / self.factor(before + change)


PITCH_OF_REGION_3 = math.radians(1.0)
"""Pitch above fine pitch from which on the torque controller holds constant power where nothing is published [rad]."""
# Of the pitch loop at the collective edgewise mode: a margin of two. The rule gives 0.29 for the IEA 15-MW and 0.488
# for the NREL 5-MW, whose published controller has no notch and needs none; without material damping it is infinite.
_LARGEST_LOOP_GAIN = 0.5


@dataclass(frozen=True)
class BaselineParameters:
    """Constants of the controller; the published names are given in brackets."""

    corner_frequency: float  #: of the low-pass filter on the generator speed [rad/s] (CornerFreq)
    proportional_gain: float  #: at fine pitch, from generator speed error [rad/s] to pitch [rad] [s] (PC_KP)
    integral_gain: float  #: at fine pitch [-] (PC_KI)
    gain_doubling_pitch: float  #: at which the rotor's response has doubled and the gains are halved [rad] (PC_KK)
    reference_speed: float  #: generator speed held above rated wind [rad/s] (PC_RefSpd)
    min_pitch: float  #: [rad] (PC_MinPit)
    max_pitch: float  #: [rad] (PC_MaxPit)
    max_pitch_rate: float  #: [rad/s] (PC_MaxRat)
    torque: TorqueCurve  #: regions 1 to 3 of the torque controller
    max_torque: float  #: [N m] (VS_MaxTq)
    max_torque_rate: float  #: [N m/s] (VS_MaxRat)
    region_3_min_pitch: float  #: pitch from which on the torque controller holds constant power [rad] (VS_Rgn3MP)
    n_blades: int = 3
    notch_frequency: float = 0.0  #: of a notch before the filter on the speed [rad/s]; 0: none, as published
    gain_table: GainTable | None = None  #: gains over the pitch, in place of the three above
    filter_damping: float = 0.0  #: damping ratio of a second-order filter on the speed [-]; 0: first order
    constant_power: bool = True  #: whether region 3 holds power or torque

    @cached_property
    def pitch_law(self) -> PitchLaw:
        """The law of the pitch with these gains."""
        return PitchLaw(self.proportional_gain, self.integral_gain, self.gain_doubling_pitch, self.gain_table)

    @property
    def rated_torque(self) -> float:
        """Torque of rated power at the reference speed [N m]."""
        return self.torque.rated_power / self.reference_speed

    def speed_filter(self) -> LowPass | SecondOrderLowPass:
        """A new filter for the generator speed."""
        if self.filter_damping > 0.0:
            return SecondOrderLowPass(self.corner_frequency, self.filter_damping)
        return LowPass(1.0 / self.corner_frequency)

    @classmethod
    def from_turbine(cls, turbine: Turbine) -> "BaselineParameters":
        """Constants for a turbine: what its data publish (`wt_gym.turbines.ControlData`), the rest `by_rule`.

        A notch belongs to gains by rule: published gains stand as they are published.
        """
        rule, own = cls.by_rule(turbine), turbine.control
        if own is None:
            return rule
        given: dict[str, object] = {
            "corner_frequency": own.speed_filter_frequency,
            "reference_speed": own.reference_generator_speed,
            "region_3_min_pitch": own.region_3_min_pitch,
            "max_pitch": own.max_pitch,
            "max_pitch_rate": own.max_pitch_rate,
            "constant_power": own.constant_power,
        }
        if own.speed_filter_frequency is not None:
            given["filter_damping"] = own.speed_filter_damping
        kp, ki = own.pitch_proportional_gain, own.pitch_integral_gain
        if own.gain_pitch is not None and kp is not None and ki is not None:
            given["notch_frequency"] = 0.0
            if own.gain_doubling_pitch is not None:
                given |= {"proportional_gain": float(kp[0]), "integral_gain": float(ki[0])}
                given["gain_doubling_pitch"] = own.gain_doubling_pitch
            else:
                given["gain_table"] = GainTable(*(tuple(row.tolist()) for row in (own.gain_pitch, kp, ki)))
        known = {name: value for name, value in given.items() if value is not None}
        return replace(rule, **known)  # type: ignore[arg-type]  # each by its own field

    @classmethod
    def by_rule(cls, turbine: Turbine, design: DesignPoint | None = None) -> "BaselineParameters":
        """Derive the constants from a turbine.

        The pitch gains place the closed-loop poles of the rotor speed (NREL/TP-500-38060, equations 7-15 and 7-16):
        ``KP = 2 I Omega zeta omega_n / (N |dP/dtheta|)``, ``KI = I Omega omega_n^2 / (N |dP/dtheta|)``. The corner
        frequency of the speed filter scales with the rated rotor speed. Frequency, damping and ``dP/dtheta`` are
        those of `wt_gym.control.design`. Fine pitch is that of the design point; under a damper, against which a
        rotor at fine pitch stalls, it is that of the operating point in rated wind.

        A notch takes the collective edgewise mode out of the measured speed where the pitch loop, by the amplification
        of a rotor that only its material damps, has a gain of more than one half there (a margin of less than two):
        the light hub of ``gebhardt_45m``, whose blades have no material damping.
        """
        design, drivetrain, pitch = design or design_point(turbine), turbine.drivetrain, turbine.pitch
        curve = torque_curve(turbine)
        gain = (
            rotor_inertia(turbine) * drivetrain.rated_rotor_speed
            / (drivetrain.gear_ratio * abs(design.pitch_sensitivity) * curve.rated_power)
        )  # fmt: skip
        fine_pitch = design.fine_pitch
        if not drivetrain.takes_torque:
            fine_pitch = operating_point(turbine, turbine.rated_wind_speed).pitch
        corner_frequency = FILTER_OVER_ROTOR_SPEED * drivetrain.rated_rotor_speed
        mode = drive_mode(turbine)
        rigid_gain = 2 * design.damping_ratio * design.natural_frequency / mode.frequency
        loop_gain = rigid_gain * mode.amplification() / math.hypot(1.0, mode.frequency / corner_frequency)
        return cls(
            corner_frequency=corner_frequency,
            proportional_gain=2 * gain * design.damping_ratio * design.natural_frequency,
            integral_gain=gain * design.natural_frequency**2,
            gain_doubling_pitch=design.gain_doubling_pitch,
            reference_speed=drivetrain.rated_rotor_speed * drivetrain.gear_ratio,
            min_pitch=fine_pitch,
            max_pitch=pitch.max_pitch,
            max_pitch_rate=pitch.max_rate,
            torque=curve,
            max_torque=drivetrain.max_generator_torque,
            max_torque_rate=drivetrain.max_torque_rate,
            region_3_min_pitch=fine_pitch + PITCH_OF_REGION_3,
            n_blades=turbine.n_blades,
            notch_frequency=mode.frequency if loop_gain > _LARGEST_LOOP_GAIN else 0.0,
        )


@cache
def nrel_5mw_parameters() -> BaselineParameters:
    """Constants of the published controller of the NREL 5-MW, from that turbine's data."""
    return BaselineParameters.from_turbine(load_turbine("nrel_5mw"))


class DisconController:
    """Torque and pitch controller of the generator speed, by default that of the NREL 5-MW; the yaw rests.

    Attributes
    ----------
    filtered_speed : float
        Generator speed behind the low-pass filter [rad/s].
    speed_integral : float
        Of the speed error [rad], or with a table of gains of the pitch [rad], see `PitchLaw`.
    pitch : numpy.ndarray, shape (n_blades,)
        Commands [rad].
    torque : float
        Command [N m]; NaN before the first one of a controller that was started without a torque, which is not limited
        in rate.
    """

    channels = ("generator_speed",)

    def __init__(self, parameters: BaselineParameters | None = None):
        self.parameters = p = nrel_5mw_parameters() if parameters is None else parameters
        self.filtered_speed = self.speed_integral = math.nan
        self.pitch: NDArray[np.float64] = np.full(p.n_blades, math.nan)
        self.torque = math.nan
        self._notch = Notch(p.notch_frequency)
        damping = p.filter_damping
        self._filter = SecondOrderLowPass(p.corner_frequency, damping) if damping > 0.0 else None

    def start(self, signals: Readings, demand: Demand) -> None:
        """Start bumplessly: the first command continues from the current pitch, of all blades or each.

        Raises
        ------
        wt_gym.base.errors.ControllerError
            For a turbine with another number of blades.
        """
        p, pitch = self.parameters, np.asarray(demand.pitch, dtype=np.float64)
        if pitch.shape not in ((), (p.n_blades,)):
            raise ControllerError(
                f"the baseline controller is made for {p.n_blades} blades, got pitch of shape {pitch.shape}"
            )
        self.pitch, self.torque = np.broadcast_to(pitch, p.n_blades).copy(), float(demand.generator_torque)
        self.speed_integral = float(p.pitch_law.holding(float(self.pitch[0])))
        self.filtered_speed = float(signals["generator_speed"])
        speed = self._notch.reset(self.filtered_speed)
        if self._filter is not None:
            self._filter.reset(speed)

    def step(self, signals: Readings, dt: float) -> Demand:
        """Demand for the next ``dt`` [s]."""
        p, measured = self.parameters, self._notch.update(signals["generator_speed"], dt)
        if self._filter is None:
            memory = math.exp(-dt * p.corner_frequency)
            self.filtered_speed = (1.0 - memory) * measured + memory * self.filtered_speed
        else:
            self.filtered_speed = self._filter.update(measured, dt)
        before = self.pitch.tolist()  # arrays of three are slow
        torque, step = self._torque_law(before[0]), p.max_torque_rate * dt
        if not math.isnan(self.torque):
            torque = min(max(torque, self.torque - step), self.torque + step)
        self.torque, self.pitch = torque, np.array(self._pitch_commands(before, dt))
        return Demand(self.pitch.copy(), 0.0, torque)

    def shift_pitch(self, change: float) -> None:
        """Move the current command and its integral, and with them the next one, by so much [rad], within limits."""
        p, angles = self.parameters, self.pitch.tolist()
        pitch = [min(max(angle + change, p.min_pitch), p.max_pitch) for angle in angles]
        self.speed_integral = p.pitch_law.moved(angles[0], pitch[0] - angles[0], self.speed_integral)
        self.pitch = np.array(pitch)

    def _torque_law(self, pitch: float) -> float:
        """Torque [N m] at the filtered speed: law of the region, saturation."""
        p, speed, pitched = self.parameters, self.filtered_speed, pitch >= self.parameters.region_3_min_pitch
        if p.constant_power:
            return min(p.torque.torque(speed, constant_power=pitched), p.max_torque)
        held = pitched or speed >= p.torque.rated_generator_speed
        return p.rated_torque if held else min(p.torque.torque(speed), p.rated_torque)

    def _pitch_commands(self, previous: list[float], dt: float) -> list[float]:
        """Pitch commands [rad]: gain-scheduled PI with anti-windup."""
        p = self.parameters
        error, step = self.filtered_speed - p.reference_speed, p.max_pitch_rate * dt
        low, high = p.min_pitch, p.max_pitch
        demand, self.speed_integral = p.pitch_law.step(previous[0], self.speed_integral, error, dt, low, high)
        return [min(max(min(max(demand, now - step), now + step), low), high) for now in previous]
