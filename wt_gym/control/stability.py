"""Closed loops of speed, pitch and torque, linear about steady operating points: is a controller stable there?

*Above rated*: is the loop of rotor speed and pitch stable? States are the rotor speed, the first fore-aft motion of the
tower top, the filter of the measured speed, the integral of the pitch law, the pitch drive, and the delay of a demand.
The rotor is quasi-steady by blade elements (`wt_gym.control.rotor.Rotor.slopes`), which leaves out the lag of the wake
and so gives the least answer of the moment to the pitch; blades are rigid, the shaft is stiff, drives have no limits.
With the speed w of the rotor, the pitch theta and the velocity u of the tower top,

``J w' = Q_w w + Q_theta theta - Q_V u - N (dM/dw_gen) N w``,
``m u' + (2 zeta m w_t + T_V) u + m w_t^2 x = T_w w + T_theta theta``.

A controller whose loop has a growing mode is refused; one whose loop is hardly damped is warned of.

*Below rated*: is the torque law stable? States are the speeds of rotor and generator and the twist of the shaft between
them, the wake, the fore-aft motion of the tower top, and those of the controller: the filter of the measured speed, the
wind estimate and its filter, the integral of the torque law, the delays of both demands, and the pitch drive, which
follows the least pitch over the estimated wind. With the wind v, the rotor's speed w, the generator's speed g over the
gear ratio N, and the pitch theta,

``J_r w' = F_w w + F_theta theta - F_v u + z - T``, ``J_g g' = T - N M/eta``, ``T = k phi + c (w - g)``,
``tau z' = (S_w - F_w) w + (S_theta - F_theta) theta - (S_v - F_v) u - z``,

where F are the slopes of the moment while the induced velocities rest and S those in equilibrium, both by blade
elements, and u is the velocity of the tower top. The wake answers with the time constant of Oye's model of dynamic
inflow, ``tau = 1.1/(1 - 1.3 a) R/v`` with the mean induction factor a up to 0.5 (Snel and Schepers, Joint investigation
of dynamic inflow effects and implementation of an engineering method, ECN-C--94-107, 1995). A shaft stiffer than the
one that fidelities take as rigid is rigid here too.

A torque law over the generator speed has neither estimate nor pitch; its slope is that of the torque curve.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from wt_gym.base.errors import ControllerError, warn_once
from wt_gym.control.design import rotor_inertia, tower_top
from wt_gym.control.operating_point import operating_point
from wt_gym.control.rotor import rotor_of
from wt_gym.turbines import Turbine
from wt_gym.wind.iec import REFERENCE_INTENSITY, turbulence_sigma

if TYPE_CHECKING:
    from wt_gym.control.controllers.discon import BaselineParameters
    from wt_gym.control.controllers.tsr_tracking import TsrTrackingParameters, WindEstimator

LEAST_DAMPING = 0.15
"""Damping ratio of the rotor's mode below which a controller is warned of: a step then overshoots by more than 62 %
[-]. The published controllers of the catalog have 0.25 and more."""
MOST_SPEED_RISE = 0.25
"""Rise of the rotor speed after a gust of one standard deviation, over rated, above which a controller is warned of:
that of the environments' overspeed limit. Published controllers of the catalog have up to 0.18 [-]."""
INTERVAL = 0.1
"""Step of the controller for the delay of its demand [s], that of `training`."""


@dataclass(frozen=True)
class LoopMode:
    """A mode of the closed loop."""

    wind: float  #: [m/s]
    frequency: float  #: natural frequency [rad/s]
    damping: float  #: damping ratio [-]; negative grows
    tower_share: float  #: kinetic energy of the tower top over that of tower top and rotor [-]


def checked_winds(turbine: Turbine) -> tuple[float, ...]:
    """Winds above rated in which the loop is looked at [m/s], no farther apart than 1 m/s, up to cut-out."""
    first = 1.1 * turbine.rated_wind_speed
    last = max(turbine.cut_out, 1.05 * first)
    return tuple(np.linspace(first, last, 1 + max(math.ceil(last - first), 4)).tolist())


def speed_loop_modes(turbine: Turbine, parameters: BaselineParameters, wind: float) -> list[LoopMode]:
    """Oscillating and growing modes of the closed loop in a steady wind above rated [m/s], the least damped first.

    A growing mode that does not oscillate has the damping -1.
    """
    plant = _Plant(turbine, wind, quasi_steady=True)
    return plant.modes(plant.with_pitch_law(parameters))


def gust_pitch_rate(turbine: Turbine, parameters: BaselineParameters, wind: float) -> float:
    """Largest pitch rate with which the linear loop answers a step of the wind [rad/s], in a wind [m/s].

    The step is one standard deviation of the normal turbulence model for the turbine's class. A loop that asks the
    drives for more than their rate gets the phase lag of the limit, and can swing although its linear model is well
    damped.
    """
    matrix, answers = _gust_answers(turbine, parameters, wind)
    return float(np.abs(answers @ matrix[_PLACE["pitch"]]).max())


def gust_speed_rise(turbine: Turbine, parameters: BaselineParameters, wind: float) -> float:
    """Largest rise of the rotor speed after that step of the wind, over rated speed [-]."""
    _, answers = _gust_answers(turbine, parameters, wind)
    return float(answers[:, _PLACE["rotor"]].max()) / turbine.drivetrain.rated_rotor_speed


def _gust_answers(
    turbine: Turbine, parameters: BaselineParameters, wind: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """State matrix (n, n), and states (m, n) after a step of the wind by one standard deviation, over five turns."""
    plant = _Plant(turbine, wind, quasi_steady=True)
    matrix = plant.with_pitch_law(parameters)
    turbulence = turbine.turbulence_class if turbine.turbulence_class in REFERENCE_INTENSITY else "B"
    gust = np.zeros(len(matrix))
    gust[_PLACE["rotor"]] = plant.steady.torque_wind / plant.inertia
    gust[_PLACE["velocity"]] = plant.steady.thrust_wind / plant.top.mass
    gust *= turbulence_sigma(wind, turbulence)
    # x' = A x + b: with the input as one more state, one exponential carries the response over a step
    step = 0.05 * 2.0 * math.pi / turbine.drivetrain.rated_rotor_speed / 5.0
    wide = np.zeros((len(matrix) + 1,) * 2)
    wide[:-1, :-1], wide[:-1, -1] = matrix, gust
    over, state, states = expm(step * wide), np.zeros(len(wide)), []
    state[-1] = 1.0
    for _ in range(500):
        state = over @ state
        states.append(state[:-1])
    return matrix, np.array(states)


@dataclass(frozen=True)
class LoopReport:
    """Result of `check_speed_loop`."""

    least_damped: LoopMode | None  #: of all modes that move the rotor more than the tower, and all that grow
    tower: LoopMode | None  #: the least damped of the tower
    pitch_rate: float  #: largest pitch rate after a gust over that of the drives, see `gust_pitch_rate` [-]
    speed_rise: float
    """Largest rise of the rotor speed after the same gust over rated speed, see `gust_speed_rise` [-]."""


@lru_cache(maxsize=64)
def _report(turbine: Turbine, parameters: BaselineParameters) -> LoopReport:
    checked = checked_winds(turbine)
    every = [mode for wind in checked for mode in speed_loop_modes(turbine, parameters, wind)]
    speed = [mode for mode in every if mode.tower_share < 0.5 or mode.damping < 0.0]
    tower = [mode for mode in every if mode.tower_share >= 0.5]
    winds = () if any(mode.damping < 0.0 for mode in speed) else checked[:: len(checked) // 4]
    rates = [gust_pitch_rate(turbine, parameters, wind) for wind in winds]
    rises = [gust_speed_rise(turbine, parameters, wind) for wind in winds]
    return LoopReport(
        min(speed, key=lambda mode: mode.damping, default=None),
        min(tower, key=lambda mode: mode.damping, default=None),
        max(rates, default=0.0) / turbine.pitch.max_rate,
        max(rises, default=0.0),
    )


def check_speed_loop(turbine: Turbine, parameters: BaselineParameters) -> LoopReport | None:
    """Check the closed loop in winds above rated (`checked_winds`); None for a generator that takes no demand.

    Raises
    ------
    wt_gym.base.errors.ControllerError
        If a mode grows.

    Warns
    -----
    UserWarning
        If the rotor's mode has less damping than `LEAST_DAMPING`, the tower's less than that of its structure alone, or
        a gust asks the drives for more than their pitch rate; the same message once in a process.
    """
    if not turbine.drivetrain.takes_torque:
        return None
    report, advice = _report(turbine, parameters), "choose smaller gains or a lower natural_frequency"
    worst, tower = report.least_damped, report.tower
    if worst is not None and worst.damping < 0.0:
        raise ControllerError(f"{_mode(turbine, parameters, worst)}; it must be positive: {advice}")
    if worst is not None and worst.damping < LEAST_DAMPING:
        warn_once(f"{_mode(turbine, parameters, worst)}; at least {LEAST_DAMPING} is advisable: {advice}", stacklevel=3)
    if tower is not None and tower.damping < turbine.tower.damping_ratio:
        what = f"less than the {turbine.tower.damping_ratio:.3f} of the tower alone"
        warn_once(f"{_mode(turbine, parameters, tower)}, {what}: {advice}", stacklevel=3)
    if report.pitch_rate > 1.0:
        warn_once(
            f"the speed loop of {turbine.name} answers a gust with {report.pitch_rate:.1f} times the pitch rate of the "
            f"drives, {math.degrees(turbine.pitch.max_rate):.1f} deg/s, and may swing: {advice}",
            stacklevel=3,
        )
    if report.speed_rise > MOST_SPEED_RISE:
        warn_once(
            f"the speed loop of {turbine.name} lets a gust of one standard deviation raise the rotor speed by "
            f"{100 * report.speed_rise:.0f} % of rated, more than {100 * MOST_SPEED_RISE:.0f} %: choose larger gains "
            "or a higher natural_frequency",
            stacklevel=3,
        )
    return report


def _mode(turbine: Turbine, parameters: BaselineParameters, mode: LoopMode) -> str:
    """A mode in words, with the gains at its operating point."""
    pitch = operating_point(turbine, mode.wind).pitch
    kp, ki = parameters.pitch_law.gains(pitch)
    return (
        f"the speed loop of {turbine.name} at {mode.wind:.1f} m/s has a mode of {mode.frequency:.2f} rad/s with a "
        f"damping ratio of {mode.damping:+.3f} (gains {kp:.4g} s and {ki:.4g} at a pitch of "
        f"{math.degrees(pitch):.1f} deg)"
    )


_STIFFEST_SHAFT = 8.0
"""Torsional frequency above which a shaft is rigid [Hz], that of `training` (`Fidelity.stiffest_shaft`)."""
_SPACING = 1.0
"""Distance of the winds that are checked [m/s]."""
LEAST_GROWTH = 0.01
"""Growth from which on a mode counts as growing [1/s].

It is one e-fold in the 100 s of the check in steady winds (`wt_gym.experiment.steady_check`). Slower growth is less
than the error of the linear model: simulations of public models with a growth of 0.001 1/s decay.
"""
_NAMES = (
    "rotor", "generator", "twist", "wake", "position", "velocity", "filter", "filter_rate", "estimate", "wind",
    "integral", "torque", "delay", "pitch", "pitch_rate",
)  # fmt: skip
"""Names of the states."""
_PLACE = {name: place for place, name in enumerate(_NAMES)}
_LARGEST_INDUCTION = 0.5


def winds_below_rated(turbine: Turbine) -> tuple[float, ...]:
    """Winds from cut-in on, every meter per second, in which the turbine makes less than rated torque [m/s]."""
    winds = np.arange(max(turbine.cut_in, _SPACING), turbine.rated_wind_speed + _SPACING, _SPACING).tolist()
    rated = operating_point(turbine, turbine.cut_out).generator_torque
    return tuple(wind for wind in winds if operating_point(turbine, wind).generator_torque < (1.0 - 1e-6) * rated)


def torque_loop_modes(
    turbine: Turbine,
    parameters: TsrTrackingParameters | BaselineParameters,
    wind: float,
    estimator: WindEstimator | None = None,
) -> list[LoopMode]:
    """Oscillating and growing modes of the closed loop in a steady wind below rated [m/s], the least damped first.

    The parameters are those of a law that tracks the tip-speed ratio, with its estimator, or of a torque curve.
    A growing mode that does not oscillate has the damping -1.
    """
    plant = _Plant(turbine, wind)
    if estimator is None:
        return plant.modes(plant.with_torque_curve(parameters))  # type: ignore[arg-type]  # as documented
    return plant.modes(plant.with_estimate(parameters, estimator))  # type: ignore[arg-type]  # as documented


def growing_mode(
    turbine: Turbine, parameters: TsrTrackingParameters | BaselineParameters, estimator: WindEstimator | None = None
) -> LoopMode | None:
    """Fastest growing mode in the winds of `winds_below_rated`, None where none grows by `LEAST_GROWTH`."""
    modes = [
        mode
        for wind in winds_below_rated(turbine)
        for mode in torque_loop_modes(turbine, parameters, wind, estimator)
        if -mode.damping * mode.frequency >= LEAST_GROWTH
    ]
    return min(modes, key=lambda mode: mode.damping * mode.frequency, default=None)


def growth(mode: LoopMode) -> str:
    """A growing mode in words."""
    return (
        f"at {mode.wind:.1f} m/s a mode of {mode.frequency:.2f} rad/s grows at {-mode.damping * mode.frequency:.2g} 1/s"
    )


@lru_cache(maxsize=64)
def check_torque_curve(turbine: Turbine, parameters: BaselineParameters) -> None:
    """Refuse a torque curve under which a mode grows below rated.

    Raises
    ------
    wt_gym.base.errors.ControllerError
        With the wind and the mode.
    """
    mode = growing_mode(turbine, parameters) if turbine.drivetrain.takes_torque else None
    if mode is not None:
        raise ControllerError(
            f"the torque curve of {turbine.name} is unstable: {growth(mode)}; choose a smaller region_2_gain or a "
            "higher corner_frequency"
        )


@dataclass
class _Plant:
    """The turbine without its controller; quasi-steady without the lag of the wake, and with a rigid shaft."""

    turbine: Turbine
    wind: float
    quasi_steady: bool = False

    def __post_init__(self) -> None:
        turbine, drivetrain, rotor = self.turbine, self.turbine.drivetrain, rotor_of(self.turbine)
        self.point = point = operating_point(turbine, self.wind)
        where = self.wind, point.rotor_speed, point.pitch
        self.steady, self.top, self.inertia = rotor.slopes(*where), tower_top(turbine), rotor_inertia(turbine)
        self.settled = np.array([self.steady.torque_wind, self.steady.torque_speed, self.steady.torque_pitch])
        self.generator = drivetrain.gear_ratio**2 * drivetrain.generator_inertia
        self.frozen, self.lag, self.rigid = self.settled, 1.0, True
        if not self.quasi_steady:
            frozen, induction = rotor.frozen_torque_slopes(*where)
            self.frozen = np.array(frozen)
            self.lag = 1.1 / (1.0 - 1.3 * min(induction, _LARGEST_INDUCTION)) * rotor.radius / self.wind
            reduced = 1.0 / (1.0 / self.generator + 1.0 / (self.inertia - self.generator))
            self.rigid = math.sqrt(drivetrain.spring / reduced) > 2.0 * math.pi * _STIFFEST_SHAFT

    def modes(self, matrix: NDArray[np.float64]) -> list[LoopMode]:
        """Oscillating and growing modes of a closed loop of a state matrix, the least damped first."""
        values, vectors = np.linalg.eig(matrix)
        modes = []
        for value, vector in zip(values, vectors.T, strict=True):
            size = abs(value)
            growing = value.real > 1e-9 * max(size, 1.0)
            if not (value.imag > 1e-9 or (growing and abs(value.imag) <= 1e-9)):
                continue
            tower = self.top.mass * abs(vector[_PLACE["velocity"]]) ** 2
            share = tower / max(tower + self.inertia * abs(vector[_PLACE["rotor"]]) ** 2, 1e-300)
            modes.append(LoopMode(self.wind, float(size), float(-value.real / size), share))
        return sorted(modes, key=lambda mode: mode.damping)

    def _open(
        self, torque_slope: float | None = None
    ) -> tuple[dict[str, NDArray[np.float64]], dict[str, NDArray[np.float64]]]:
        """Rows that pick a state, and rates of the states without those of the controller.

        With a slope the torque follows the generator speed at once [N m/(rad/s)].
        """
        drivetrain, top, steady = self.turbine.drivetrain, self.top, self.steady
        x = dict(zip(_NAMES, np.eye(len(_NAMES)), strict=True))
        rates = {name: -row for name, row in x.items()}  # what a controller does not use decays
        if torque_slope is not None:
            x["torque"] = torque_slope * drivetrain.gear_ratio * x["rotor"]
        inputs = np.array([-x["velocity"], x["rotor"], x["pitch"]])
        air, load = (
            self.frozen @ inputs + x["wake"],
            drivetrain.gear_ratio / drivetrain.gearbox_efficiency * x["torque"],
        )
        if self.rigid:
            rates["rotor"] = (air - load) / self.inertia
        else:
            shaft = drivetrain.spring * x["twist"] + drivetrain.damper * (x["rotor"] - x["generator"])
            rates["rotor"] = (air - shaft) / (self.inertia - self.generator)
            rates["generator"] = (shaft - load) / self.generator
            rates["twist"] = x["rotor"] - x["generator"]
        rates["wake"] = ((self.settled - self.frozen) @ inputs - x["wake"]) / self.lag
        thrust = np.array([steady.thrust_wind, steady.thrust_speed, steady.thrust_pitch]) @ inputs
        rates["position"], damping = x["velocity"], 2.0 * self.turbine.tower.damping_ratio * top.fore_aft
        rates["velocity"] = thrust / top.mass - (damping * x["velocity"] + top.fore_aft**2 * x["position"])
        return x, rates

    def _shaft_speed(self, x: dict[str, NDArray[np.float64]]) -> NDArray[np.float64]:
        """Speed of the generator over the gear ratio."""
        return x["rotor"] if self.rigid else x["generator"]

    def _filter(self, x: dict[str, Any], rates: dict[str, Any], p: BaselineParameters) -> None:
        """Filter of the measured generator speed."""
        corner, speed = p.corner_frequency, self.turbine.drivetrain.gear_ratio * self._shaft_speed(x)
        if p.filter_damping > 0.0:
            damping = 2.0 * p.filter_damping * corner * x["filter_rate"]
            rates["filter"], rates["filter_rate"] = x["filter_rate"], corner**2 * (speed - x["filter"]) - damping
        else:
            rates["filter"] = corner * (speed - x["filter"])

    def _follow(self, x: dict[str, Any], rates: dict[str, Any], demand: Any, growth: float = 0.0) -> None:
        """Pitch drive behind a demand that is late by a step, and grows with the pitch itself."""
        drive, servo = self.turbine.pitch, self.turbine.pitch.servo_frequency
        if servo is None:
            rates["pitch"] = (demand + (growth - 1.0) * x["pitch"]) / (1.5 * INTERVAL)
            return
        rates["delay"] = (demand + (growth - 1.0) * x["delay"]) / INTERVAL
        rates["pitch"], damping = x["pitch_rate"], 2.0 * drive.servo_damping * servo * x["pitch_rate"]
        rates["pitch_rate"] = servo**2 * (x["delay"] - x["pitch"]) - damping

    def with_pitch_law(self, p: BaselineParameters) -> NDArray[np.float64]:
        """State matrix with the pitch law on the filtered generator speed, and torque that holds power or itself."""
        point, gear = self.point, self.turbine.drivetrain.gear_ratio
        x, rates = self._open(-point.generator_torque / (gear * point.rotor_speed) if p.constant_power else 0.0)
        self._filter(x, rates, p)
        proportional, rates["integral"] = (gain * x["filter"] for gain in p.pitch_law.gains(point.pitch))
        # the published factor stands before the integral: as the pitch moves, its change moves the demand
        log_slope = 0.0 if p.gain_table is not None else -p.pitch_law.factor(point.pitch) / p.gain_doubling_pitch
        self._follow(x, rates, proportional + x["integral"], point.pitch * log_slope)
        return np.array([rates[name] for name in _NAMES])

    def with_torque_curve(self, p: BaselineParameters) -> NDArray[np.float64]:
        """State matrix with a torque over the filtered generator speed and a pitch that rests."""
        x, rates = self._open()
        self._filter(x, rates, p)
        speed = self.turbine.drivetrain.gear_ratio * self.point.rotor_speed
        change = 1e-4 * speed
        slope = (p.torque.torque(speed + change) - p.torque.torque(speed - change)) / (2.0 * change)
        rates["torque"] = (slope * x["filter"] - x["torque"]) / self._torque_delay
        return np.array([rates[name] for name in _NAMES])

    def with_estimate(self, p: TsrTrackingParameters, estimator: WindEstimator) -> NDArray[np.float64]:
        """State matrix with the law of `wt_gym.control.controllers.tsr_tracking`."""
        x, rates = self._open()
        self._filter(x, rates, p.baseline)
        wind, speed, pitch = self.wind, self.point.rotor_speed, self.point.pitch
        drivetrain, torque = self.turbine.drivetrain, p.table.torque
        to_moment = drivetrain.gear_ratio / drivetrain.gearbox_efficiency
        steps = 0.02 * wind, 0.01 * speed, math.radians(0.25)
        table = [
            (torque(*(a + b for a, b in zip((wind, speed, pitch), row, strict=True)))
             - torque(*(a - b for a, b in zip((wind, speed, pitch), row, strict=True)))) / (2.0 * step)
            for row, step in zip(np.diag(steps).tolist(), steps, strict=True)
        ]  # fmt: skip
        shaft = x["rotor"] + estimator.generator_share * (self._shaft_speed(x) - x["rotor"])
        # v = beta + gamma w with the bandwidth gamma/J dQ/dv
        gamma = estimator.bandwidth * estimator.inertia / table[0]
        estimate = x["estimate"] + gamma * shaft
        surplus = to_moment * x["torque"] - table[0] * estimate - table[1] * shaft - table[2] * x["pitch"]
        rates["estimate"] = gamma / estimator.inertia * surplus
        rates["wind"] = (estimate - x["wind"]) / p.wind_time_constant
        tracks = p.min_speed < p.speed_per_wind * wind < p.rated_speed
        error = x["filter"] - (p.speed_per_wind if tracks else 0.0) * x["wind"]
        rates["integral"] = p.torque_integral_gain * error
        rates["torque"] = (p.torque_gain * error + x["integral"] - x["torque"]) / self._torque_delay
        least = np.interp([wind - steps[0], wind + steps[0]], p.schedule_wind, p.schedule_pitch)
        demand = float(least[1] - least[0]) / (2.0 * steps[0]) * x["wind"]
        self._follow(x, rates, demand)
        return np.array([rates[name] for name in _NAMES])

    @property
    def _torque_delay(self) -> float:
        """Half a step, over which a demand is held, and the lag of the converter [s]."""
        return 0.5 * INTERVAL + self.turbine.drivetrain.torque_lag
