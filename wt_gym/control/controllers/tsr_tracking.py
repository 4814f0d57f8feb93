"""A controller of the kind of ROSCO: it tracks the best tip-speed ratio with an estimate of the wind.

After the description of NREL's reference open-source controller (Abbas, Zalkind, Pao and Wright, Wind Energ. Sci. 7
(2022) 53), own, smaller: a proportional-integral law for the torque that follows the tip-speed ratio, the
gain-scheduled pitch law of the baseline, set points of both moved apart so that only one acts at a time (section 3.4),
and a lower limit of the pitch that rises with the estimated wind: for power where the rotor cannot turn slowly enough,
and near rated to cut the peak of the thrust ("peak shaving", section 3.3).

A turbine whose data publish such a controller gets its own numbers (`TsrTrackingParameters.published`): gains of torque
and pitch, filters, tip-speed ratio, least pitch over the wind. Its wind estimate then reads a table by blade
elements, as the published controller does. What is not published follows by the rules of
`TsrTrackingParameters.from_turbine`. Times and rates of those rules were chosen for a rotor of 12.1 rpm, and go with
the turn of the rotor.

*Rotor-effective wind speed* (`WindEstimator`): the rotor is the anemometer. With the moment of the air
``Q(v, Omega, theta)`` from the rotor's table,

    ``J dOmega/dt = Q(v, Omega, theta) - N M_gen / eta``,

and the wind is what explains the acceleration. The estimator is that of immersion and invariance (Ortega,
Mancilla-David and Jaramillo, Int. J. Robust Nonlinear Control 23 (2013) 1346):

    ``v = beta + gamma Omega``,  ``d beta/dt = (gamma / J) (N M_gen / eta - Q(v, Omega, theta))``.

Its error decays at the rate ``(gamma/J) dQ/dv`` wherever Q grows with v. Here gamma follows that slope so that the rate
is one chosen bandwidth in every wind (beta is set again with it, so that the estimate does not jump).

A shaft that twists lets rotor and generator swing against each other: to the rotor's speed alone, with the inertia of
both, this is wind. Their momentum ``J_r Omega_r + J_g Omega_g`` does not know it. A generator with most of the inertia
(a rotor of 8.6e6 kg m^2 before one of 122e6 kg m^2 in a public model) otherwise feeds its torsion back through the
estimate, with a mode that grows; Omega then is the mean of both speeds by inertia.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wt_gym.base.options import Options, option, option_record
from wt_gym.control.actions import Demand
from wt_gym.control.controllers.controller import AtSetPoint, Readings
from wt_gym.control.controllers.discon import PITCH_OF_REGION_3, BaselineParameters
from wt_gym.control.design import rated_mechanical_power, rotor_inertia, slower_than_reference, tower_top
from wt_gym.control.operating_point import least_pitch
from wt_gym.control.rotor import RotorTable, blade_element_table, fine_pitch, rotor_table
from wt_gym.control.sensors import LowPass, Notch
from wt_gym.turbines import Turbine

# ---- estimated wind ----

LOWEST, HIGHEST = 2.0, 40.0
"""Range of the estimate [m/s]."""


def bandwidth_of(turbine: Turbine) -> float:
    """Bandwidth of the estimator by rule [rad/s]: 0.5 rad/s for a rotor of 12.1 rpm, in proportion to the rated
    speed.
    """
    return 0.5 / slower_than_reference(turbine)


class WindEstimator:
    """Estimator of the rotor-effective wind speed.

    A step takes measurements that are held over it. The estimate moves to the fixed point of the equation with the
    exponential of the local rate, exact for the equation linearized in v.

    Parameters
    ----------
    inertia : float
        Of rotor and generator about the low-speed shaft [kg m^2].
    gear_ratio, gearbox_efficiency : float
        [-].
    bandwidth : float
        Rate at which an error of the estimate decays [rad/s].
    lowest_speed : float
        Rotor speed below which the estimate is held [rad/s]: a rotor at rest tells nothing.
    generator_share : float
        Share of the generator in the inertia, by which its speed counts [-]; 0: the rotor's speed is read alone.

    Attributes
    ----------
    wind : float
        Present estimate [m/s]; NaN before `start`.
    """

    def __init__(
        self, table: RotorTable, inertia: float, gear_ratio: float = 1.0, gearbox_efficiency: float = 1.0,
        n_blades: int = 3, bandwidth: float = 0.5, lowest_speed: float = 0.1, generator_share: float = 0.0,
    ) -> None:  # fmt: skip
        self.table, self.inertia, self.bandwidth, self.lowest_speed = table, inertia, bandwidth, lowest_speed
        self._gear_ratio, self._to_moment = gear_ratio, gear_ratio / gearbox_efficiency
        self.generator_share = generator_share
        self._pitch_names = tuple(f"pitch_{b + 1}" for b in range(n_blades))
        shaft = ("generator_speed",) if generator_share > 0.0 else ()
        self.channels = ("rotor_speed", *shaft, "generator_torque", *self._pitch_names)
        self.wind, self._speed = math.nan, math.nan

    @classmethod
    def of_turbine(
        cls, turbine: Turbine, bandwidth: float | None = None, table: RotorTable | None = None,
        reads_generator: bool = False,
    ) -> "WindEstimator":  # fmt: skip
        """Make the estimator of a turbine.

        By default it has the table of `rotor_table.rotor_table` and the bandwidth of `bandwidth_of`. With
        ``reads_generator`` it reads the speed of the generator too, by its share in the inertia.
        """
        drivetrain, inertia = turbine.drivetrain, rotor_inertia(turbine)
        generator = drivetrain.gear_ratio**2 * drivetrain.generator_inertia
        return cls(
            rotor_table(turbine) if table is None else table,
            inertia,
            drivetrain.gear_ratio,
            drivetrain.gearbox_efficiency,
            turbine.n_blades,
            bandwidth_of(turbine) if bandwidth is None else bandwidth,
            0.1 * drivetrain.rated_rotor_speed,
            generator / inertia if reads_generator else 0.0,
        )

    def start(self, signals: Readings) -> float:
        """Start from the wind in which the current torque holds the current speed; return it [m/s]."""
        speed, pitch = self._speed_of(signals), self._pitch(signals)
        self._speed = speed
        if speed < self.lowest_speed:
            self.wind = LOWEST
            return self.wind
        winds = np.linspace(LOWEST, HIGHEST, 153)
        moment = np.array([self.table.torque(v, speed, pitch) for v in winds])
        enough = np.flatnonzero(moment >= self._to_moment * signals["generator_torque"])
        self.wind = float(winds[enough[0]]) if enough.size else LOWEST
        return self.wind

    def update(self, signals: Readings, dt: float) -> float:
        """Take the measurements after a step of ``dt`` [s] and return the estimate [m/s]."""
        speed, pitch = self._speed_of(signals), self._pitch(signals)
        before, self._speed = self._speed, speed
        if min(speed, before) < self.lowest_speed:
            return self.wind
        v, small = self.wind, 0.1
        slope = (self.table.torque(v + small, speed, pitch) - self.table.torque(v - small, speed, pitch)) / (2 * small)
        # where the table falls with the wind, deep in stall, the estimator would run away: there it only creeps
        slope = max(slope, _least_slope(self.table, v))
        surplus = self._to_moment * signals["generator_torque"] - self.table.torque(v, speed, pitch)
        acceleration = self.inertia * (speed - before) / dt
        self.wind = v + (acceleration + surplus) / slope * -math.expm1(-self.bandwidth * dt)
        self.wind = min(max(self.wind, LOWEST), HIGHEST)
        return self.wind

    def _speed_of(self, signals: Readings) -> float:
        """Speed of the drive train [rad/s]: that of the rotor, or the mean of rotor and generator by inertia."""
        speed = signals["rotor_speed"]
        if self.generator_share == 0.0:
            return speed
        return speed + self.generator_share * (signals["generator_speed"] / self._gear_ratio - speed)

    def _pitch(self, signals: Readings) -> float:
        return sum(signals[name] for name in self._pitch_names) / len(self._pitch_names)


def _least_slope(table: RotorTable, wind: float) -> float:
    """A tenth of the slope of the moment at the best power and that wind [N m s/m]."""
    ratio, best = table.optimum
    return 0.1 * 0.5 * table.air_density * math.pi * table.radius**3 * best / ratio * 2.0 * wind


# ---- speeds that a set point passes quickly ----


def resonant_speed(turbine: Turbine) -> float | None:
    """Speed of operation at which the passing blades, else one turn, meet the first tower mode [rad/s].

    None where there is none from 10 % below the least to rated rotor speed.
    """
    drivetrain, tower = turbine.drivetrain, tower_top(turbine)
    for frequency in (tower.fore_aft / turbine.n_blades, tower.fore_aft):
        if 0.9 * drivetrain.min_rotor_speed < frequency < drivetrain.rated_rotor_speed:
            return frequency
    return None


class SpeedExclusion:
    """Set point that waits at one end of a band of speeds, and then crosses it.

    A set point that rises into the band stays at its lower end until the requested one has passed the upper end, and
    the other way round: as the resonance avoidance of ROSCO 2.10 (TRA_ExclSpeed, TRA_ExclBand, TRA_RateLimit), with
    a hysteresis of the whole band. It crosses at a limited rate, and keeps to that until it has reached the requested
    one.

    Parameters
    ----------
    low, high : float
        Of the band, generator speed [rad/s].
    rate : float
        At which the set point moves [rad/s^2].
    least : float
        Least set point; where the band reaches below it, the set point waits above the band alone [rad/s].
    """

    def __init__(self, low: float, high: float, rate: float, least: float = 0.0):
        self.low, self.high, self.rate = float(low), float(high), float(rate)
        self._always_above = low < least
        self.start()

    @classmethod
    def of_turbine(cls, turbine: Turbine, half_width: float, crossing: float = 5.0) -> "SpeedExclusion":
        """Band about the resonance of a turbine: half width over the resonant speed [-], and time to cross it [s].

        Raises
        ------
        ValueError
            If the turbine has no resonance within its speeds.
        """
        center, drivetrain = resonant_speed(turbine), turbine.drivetrain
        if center is None:
            raise ValueError(
                f"resonance must be 0 for {turbine.name}: neither the passing blades nor one turn meet the tower's "
                f"frequency between its least and its rated rotor speed; got {half_width!r}"
            )
        center *= drivetrain.gear_ratio
        width = 2.0 * half_width * center
        least = drivetrain.min_rotor_speed * drivetrain.gear_ratio
        return cls(center - 0.5 * width, center + 0.5 * width, width / crossing, least)

    def start(self) -> None:
        """Forget the set point."""
        self.value, self._above, self._crossing = math.nan, 0.0, False

    def moved(self, requested: float, dt: float) -> float:
        """Set point for a requested one [rad/s] after another ``dt`` [s]."""
        if math.isnan(self.value):
            self._above = float(requested > 0.5 * (self.low + self.high))
        if requested >= self.high:
            self._above = 1.0
        elif requested <= self.low:
            self._above = 0.0
        if self.low < requested < self.high or self._always_above:
            requested = max(requested, self.high) if self._above or self._always_above else self.low
        if math.isnan(self.value):
            self.value = requested
        elif self._crossing or (min(self.value, requested) < self.high and max(self.value, requested) > self.low):
            self.value += min(max(requested - self.value, -self.rate * dt), self.rate * dt)
            self._crossing = self.value != requested  # beyond the band too: the requested one may lie far behind it
        else:
            self.value = requested
        return self.value


# ---- the controller ----

_TORQUE_FREQUENCY, _WIND_TIME, _SMOOTHING_TIME = 0.25, 3.0, 5.0
"""Of a rotor of 12.1 rpm [rad/s], [s], [s]."""


@option_record
class TsrTrackingOptions(Options):
    """Parameters of a `TsrTrackingController` by rule."""

    title = "tsr_tracking"

    tip_speed_ratio: float | None = option(
        "ratio that is tracked below rated", default=None, unit="-", low=0.0, above=True,
        otherwise="of the largest power in the turbine's table", in_use=lambda t: rotor_table(t).optimum[0],
    )  # fmt: skip
    thrust_limit: float = option(
        "largest steady thrust over the peak that it has without a limit (peak shaving); 1: none", default=1.0,
        unit="-", low=0.0, high=1.0, above=True,
    )  # fmt: skip
    torque_frequency: float | None = option(
        "poles of the rotor speed under the torque law below rated", default=None, unit="rad/s", low=0.0, above=True,
        otherwise="0.25 rad/s for a rotor of 12.1 rpm", in_use=lambda t: _TORQUE_FREQUENCY / slower_than_reference(t),
    )  # fmt: skip
    torque_damping: float = option("damping ratio of these poles", default=1.0, unit="-", low=0.0)
    wind_time_constant: float | None = option(
        "of the filter on the estimated wind", default=None, unit="s", low=0.0, above=True,
        otherwise="3 s for a rotor of 12.1 rpm", in_use=lambda t: _WIND_TIME * slower_than_reference(t),
    )  # fmt: skip
    pitch_to_speed: float = option(
        "shift of the torque's set point, in rated speeds, for pitch over its range", default=1.0, unit="-", low=0.0
    )
    torque_to_speed: float = option(
        "shift of the pitch's set point, in rated speeds, for torque missing to rated", default=0.1, unit="-", low=0.0
    )
    smoothing_time_constant: float | None = option(
        "of the filter on these shifts", default=None, unit="s", low=0.0, above=True,
        otherwise="5 s for a rotor of 12.1 rpm", in_use=lambda t: _SMOOTHING_TIME * slower_than_reference(t),
    )  # fmt: skip
    estimator_bandwidth: float | None = option(
        "rate at which an error of the estimated wind decays", default=None, unit="rad/s", low=0.0, above=True,
        otherwise="0.5 rad/s for a rotor of 12.1 rpm", in_use=bandwidth_of,
    )  # fmt: skip
    baseline: BaselineParameters | None = option(
        "speed filter, pitch gains and limits", default=None, unit="-", kinds=(BaselineParameters,),
        otherwise="those of `discon` without parameters",
    )  # fmt: skip
    table: RotorTable | None = option(
        "coefficients behind the estimated wind, the least pitch and the gains", default=None, unit="-",
        kinds=(RotorTable,), otherwise="the turbine's table",
    )  # fmt: skip


def pitch_schedule(
    table: RotorTable, turbine: Turbine, tip_speed_ratio: float, thrust_limit: float = 1.0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Winds (n,) [m/s] and the least pitch there (n,) [rad]: best below rated, and limiting the thrust.

    ``tip_speed_ratio`` is tracked while the rotor's speed range allows; ``thrust_limit`` is the largest steady thrust
    over the peak that it has without a limit [-]; 1 limits nothing.
    """
    drivetrain, radius = turbine.drivetrain, table.radius
    winds = np.linspace(turbine.cut_in, turbine.cut_out, 89)
    speeds = np.clip(tip_speed_ratio * winds / radius, drivetrain.min_rotor_speed, drivetrain.rated_rotor_speed)
    fine = fine_pitch(turbine)
    # where the rotor tracks the best ratio, fine pitch is best; only a ratio above it, at low wind, asks for more
    ratios = speeds * radius / winds
    best = np.array([table.best_pitch(r) if r > 1.02 * tip_speed_ratio else fine for r in ratios])
    best = np.maximum(best, fine)
    rated = rated_mechanical_power(turbine)
    powers = [table.torque(*point) * point[1] for point in zip(winds, speeds, best, strict=True)]
    below_rated = np.array(powers) < rated
    peak = max(
        table.thrust_force(*p) for p in zip(winds[below_rated], speeds[below_rated], best[below_rated], strict=True)
    )
    pitch = []
    for wind, speed, least in zip(winds, speeds, best, strict=True):
        angles = np.linspace(least, table.pitch[-1], 241)
        within = [table.thrust_force(wind, speed, a) <= thrust_limit * peak for a in angles]
        pitch.append(angles[int(np.argmax(within))] if thrust_limit < 1.0 and any(within) else least)
    return winds, np.array(pitch)


@dataclass(frozen=True)
class TsrTrackingParameters:
    """Constants of the controller."""

    baseline: BaselineParameters  #: speed filter, pitch gains and limits
    speed_per_wind: float  #: generator speed to be tracked per wind: tip-speed ratio, gear ratio over radius [rad/m]
    torque_gain: float  #: from generator speed error to torque [N m s]
    torque_integral_gain: float  #: [N m]
    min_speed: float  #: of the generator [rad/s]
    rated_speed: float  #: of the generator [rad/s]
    rated_torque: float  #: [N m]
    wind_time_constant: float  #: of the filter on the estimated wind [s]
    pitch_to_speed: float  #: how far the set point moves, in rated speeds, for pitch over its range [-]
    torque_to_speed: float  #: how far it moves, in rated speeds, for torque missing to rated [-]
    smoothing_time_constant: float  #: of the filter on both [s]
    schedule_wind: NDArray[np.float64]  #: shape (n,) [m/s]
    schedule_pitch: NDArray[np.float64]  #: least pitch over the wind, shape (n,) [rad]
    table: RotorTable  #: behind the estimated wind
    constant_power_pitch: float = 0.0
    """Pitch above the least one from which on the torque may pass rated torque by a tenth, so that power is held while
    the speed is below rated [rad]; 0: always."""

    @classmethod
    def published(cls, turbine: Turbine, baseline: BaselineParameters, **parameters: Any) -> "TsrTrackingParameters":
        """Numbers of the turbine's own controller, by rule where its data say nothing.

        The baseline is that of the pitch law, the filter and the limits; parameters, of `TsrTrackingOptions`, go before
        what is published.
        """
        own = turbine.control
        assert own is not None  # asked for such turbines only
        if parameters.get("tip_speed_ratio") is None:
            parameters["tip_speed_ratio"] = own.optimal_tip_speed_ratio
        made = cls.from_turbine(turbine, baseline=baseline, table=blade_element_table(turbine), **parameters)
        # below region 3 the published torque ends at rated torque, and the speed rises to rated
        given: dict[str, object] = {"constant_power_pitch": PITCH_OF_REGION_3}
        shifts = {
            "pitch_to_speed": own.speed_shift_per_pitch
            and own.speed_shift_per_pitch * (baseline.max_pitch - baseline.min_pitch),
            "torque_to_speed": own.speed_shift_per_power,
            "smoothing_time_constant": own.speed_shift_frequency and 1.0 / own.speed_shift_frequency,
        }
        given |= {name: value for name, value in shifts.items() if value is not None and name not in parameters}
        if own.torque_proportional_gain and own.torque_integral_gain:
            given["torque_gain"] = own.torque_proportional_gain
            given["torque_integral_gain"] = own.torque_integral_gain
        if own.min_pitch_wind is not None and "thrust_limit" not in parameters:
            given["schedule_wind"] = own.min_pitch_wind
            given["schedule_pitch"] = np.array([least_pitch(turbine, wind) for wind in own.min_pitch_wind.tolist()])
        return replace(made, **given)  # type: ignore[arg-type]  # each by its own field

    @classmethod
    def from_turbine(cls, turbine: Turbine, **parameters: Any) -> "TsrTrackingParameters":
        """By rule, with parameters of `TsrTrackingOptions`.

        The torque gains place the poles of the rotor speed at ``torque_frequency`` [rad/s] and ``torque_damping``:
        ``J dw/dt = Q(w) - N M`` with ``dQ/dw = -P/w^2`` at the best power in half the rated wind.
        """
        o, drivetrain, slower = TsrTrackingOptions(**parameters), turbine.drivetrain, slower_than_reference(turbine)
        table = rotor_table(turbine) if o.table is None else o.table
        baseline = BaselineParameters.from_turbine(turbine) if o.baseline is None else o.baseline
        frequency = _TORQUE_FREQUENCY / slower if o.torque_frequency is None else o.torque_frequency
        wind_time = _WIND_TIME * slower if o.wind_time_constant is None else o.wind_time_constant
        smoothing = _SMOOTHING_TIME * slower if o.smoothing_time_constant is None else o.smoothing_time_constant
        ratio = table.optimum[0] if o.tip_speed_ratio is None else o.tip_speed_ratio
        inertia, gear = rotor_inertia(turbine), drivetrain.gear_ratio
        wind = 0.5 * turbine.rated_wind_speed
        speed = ratio * wind / table.radius
        slope = -table.torque(wind, speed, float(table.pitch[0])) / speed
        to_generator = drivetrain.gearbox_efficiency / gear**2
        gain = max(2.0 * o.torque_damping * frequency * inertia + slope, 0.0) * to_generator
        winds, pitch = pitch_schedule(table, turbine, ratio, o.thrust_limit)
        rated_speed = baseline.reference_speed
        return cls(
            baseline=baseline,
            speed_per_wind=ratio * gear / table.radius,
            torque_gain=gain,
            torque_integral_gain=frequency**2 * inertia * to_generator,
            min_speed=drivetrain.min_rotor_speed * gear,
            rated_speed=rated_speed,
            rated_torque=baseline.torque.rated_power / rated_speed,
            wind_time_constant=wind_time,
            pitch_to_speed=o.pitch_to_speed,
            torque_to_speed=o.torque_to_speed,
            smoothing_time_constant=smoothing,
            schedule_wind=winds,
            schedule_pitch=pitch,
            table=table,
        )


class TsrTrackingController:
    """Tip-speed-ratio tracking, set-point smoothing and a least pitch over the estimated wind.

    Each step, with the filtered generator speed w and estimated wind v:

    1. set points: ``w_torque = clip(lambda v N / R, w_min, w_rated)`` and ``w_pitch = w_rated``. The shift
       ``d = k_p (theta - theta_min)/(theta_max - theta_min) - k_t (M_rated - M)/M_rated``, low-pass filtered, lowers
       ``w_torque`` where positive (pitched: the torque stays at its upper end) and raises ``w_pitch`` where negative;
    2. torque ``M = K_P (w - w_torque) + I``, I its integral with K_I; both within 0 and the torque of rated power,
       ``P/w``, at most a tenth above rated torque (with published numbers rated torque while the pitch is the least
       one); where region 3 holds the torque, within 0 and rated torque; limited in rate;
    3. pitch: the baseline's gain-scheduled law on ``w - w_pitch``, within theta_min(v) and the upper limit, limited in
       rate.

    Where the speeds that are read are over a set point (`wt_gym.control.controllers.controller.AtSetPoint`), w is that
    speed; the wind is estimated from, and the excluded band lies in, speeds as they are measured.

    Attributes
    ----------
    wind : float
        Estimated rotor-effective wind behind the filter [m/s].
    exclusion : SpeedExclusion or None
        Speeds that the set point of the torque passes quickly.
    """

    def __init__(self, parameters: TsrTrackingParameters, estimator: WindEstimator):
        self.parameters, self.estimator = parameters, estimator
        self.channels = tuple(dict.fromkeys(("generator_speed", *estimator.channels)))
        self._notch = Notch(parameters.baseline.notch_frequency)
        self._speed = parameters.baseline.speed_filter()
        self._wind = LowPass(parameters.wind_time_constant)
        self._shift = LowPass(parameters.smoothing_time_constant)
        self.exclusion: SpeedExclusion | None = None
        self._share = 1.0
        self._pitch = self._torque = self._pitch_integral = self._torque_integral = math.nan

    @property
    def wind(self) -> float:
        """Estimated rotor-effective wind behind the filter [m/s]."""
        return self._wind.value

    @classmethod
    def of_turbine(cls, turbine: Turbine, **parameters: Any) -> "TsrTrackingController":
        """By rule, with parameters of `TsrTrackingOptions`."""
        made = TsrTrackingParameters.from_turbine(turbine, **parameters)
        return cls(made, WindEstimator.of_turbine(turbine, parameters.get("estimator_bandwidth"), made.table))

    def start(self, signals: Readings, demand: Demand) -> None:
        """Start bumplessly from the mean of the pitch demands and the torque demand."""
        p = self.parameters
        measured = self._measured(signals)
        self._speed.reset(self._notch.reset(signals["generator_speed"]))
        self._wind.reset(self.estimator.start(measured))
        self._pitch, self._torque = float(np.mean(demand.pitch)), float(demand.generator_torque)
        self._shift.reset(self._wanted_shift(self._least_pitch()))
        if self.exclusion is not None:
            self.exclusion.start()
        torque_error, pitch_error = self._errors(0.0)
        self._torque_integral = self._torque - p.torque_gain * torque_error
        self._pitch_integral = p.baseline.pitch_law.holding(self._pitch, pitch_error)

    def step(self, signals: Readings, dt: float) -> Demand:
        """Demand for the next ``dt`` [s]."""
        p, b = self.parameters, self.parameters.baseline
        speed = self._speed.update(self._notch.update(signals["generator_speed"], dt), dt)
        self._wind.update(self.estimator.update(self._measured(signals), dt), dt)
        least = self._least_pitch()
        self._shift.update(self._wanted_shift(least), dt)
        torque_error, pitch_error = self._errors(dt)

        highest = min(self._most_torque(least, speed), b.max_torque)
        integral = self._torque_integral + p.torque_integral_gain * torque_error * dt
        self._torque_integral = min(max(integral, 0.0), highest)
        torque = min(max(p.torque_gain * torque_error + self._torque_integral, 0.0), highest)
        self._torque += min(max(torque - self._torque, -b.max_torque_rate * dt), b.max_torque_rate * dt)

        pitch, self._pitch_integral = b.pitch_law.step(
            self._pitch, self._pitch_integral, pitch_error, dt, least, b.max_pitch
        )
        self._pitch += min(max(pitch - self._pitch, -b.max_pitch_rate * dt), b.max_pitch_rate * dt)
        return Demand(np.full(b.n_blades, self._pitch), 0.0, self._torque)

    def shift_pitch(self, change: float) -> None:
        """Move the current demand and its integral, and with them the next one, by so much [rad], within the limits."""
        b, before = self.parameters.baseline, self._pitch
        least = min(before, self._least_pitch())  # what is below the schedule rises to it at the limit of the rate
        self._pitch = min(max(before + change, least), b.max_pitch)
        self._pitch_integral = b.pitch_law.moved(before, self._pitch - before, self._pitch_integral)

    def _measured(self, signals: Readings) -> Readings:
        """Readings for the estimator: speeds over a set point would be another rotor's; the set point is kept."""
        if isinstance(signals, AtSetPoint):
            self._share = signals.share
            return signals.measured
        self._share = 1.0
        return signals

    def _most_torque(self, least: float, speed: float) -> float:
        """Largest torque at a speed [rad/s]: rated torque, or that of rated power up to a tenth above it [N m]."""
        p = self.parameters
        if not p.baseline.constant_power:
            return p.rated_torque
        pitched = 1.0 if p.constant_power_pitch == 0.0 else (self._pitch - least) / p.constant_power_pitch
        most = (1.0 + 0.1 * min(max(pitched, 0.0), 1.0)) * p.rated_torque
        return min(p.baseline.torque.rated_power / max(speed, 1e-3), most)

    def _errors(self, dt: float) -> tuple[float, float]:
        """Generator speed errors of torque and pitch [rad/s], ``dt`` [s] after the last."""
        p, speed = self.parameters, self._speed.value
        shift = self._shift.value * p.rated_speed
        tracked = min(max(p.speed_per_wind * self.wind, p.min_speed), p.rated_speed)
        if self.exclusion is not None:
            tracked = self.exclusion.moved(tracked * self._share, dt) / self._share
        return speed - (tracked - max(shift, 0.0)), speed - (p.rated_speed - min(shift, 0.0))

    def _wanted_shift(self, least: float) -> float:
        """Shift of the set points in rated speeds [-]."""
        p, b = self.parameters, self.parameters.baseline
        pitched = (self._pitch - least) / (b.max_pitch - b.min_pitch)
        return p.pitch_to_speed * pitched - p.torque_to_speed * (p.rated_torque - self._torque) / p.rated_torque

    def _least_pitch(self) -> float:
        """Lower limit of the pitch [rad]."""
        return float(np.interp(self.wind, self.parameters.schedule_wind, self.parameters.schedule_pitch))
