"""The closed loop below rated power, linear about steady operating points: is the torque law stable there?

States are the speeds of rotor and generator and the twist of the shaft between them, the wake, the fore-aft motion of
the tower top, and those of the controller: the filter of the measured speed, the wind estimate and its filter, the
integral of the torque law, the delays of both demands, and the pitch drive, which follows the least pitch over the
estimated wind. With the wind v, the rotor's speed w, the generator's speed g over the gear ratio N, and the pitch
theta,

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
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.base.errors import ControllerError
from wt_gym.control.design import rotor_inertia
from wt_gym.control.operating_point import operating_point
from wt_gym.control.rotor import rotor_of
from wt_gym.control.speed_loop import INTERVAL, LoopMode, modes_of_loop

if TYPE_CHECKING:
    from typing import Any

    from numpy.typing import NDArray

    from wt_gym.control.controllers.discon import BaselineParameters
    from wt_gym.control.controllers.tsr_tracking import TsrTrackingParameters
    from wt_gym.control.controllers.wind_estimator import WindEstimator
    from wt_gym.control.operating_point import OperatingPoint
    from wt_gym.turbines import Turbine

__all__ = ["LEAST_GROWTH", "check_torque_curve", "growing_mode", "growth", "torque_loop_modes", "winds_below_rated"]

_STIFFEST_SHAFT = 8.0
"""Torsional frequency above which a shaft is rigid [Hz], that of `training` (`Fidelity.stiffest_shaft`)."""
_SPACING = 1.0
"""Distance of the winds that are checked [m/s]."""
LEAST_GROWTH = 0.01
"""Growth from which on a mode counts as growing [1/s].

It is one e-fold in the 100 s of the check in steady winds (`wt_gym.runs.steady_check`). Slower growth is less than the
error of the linear model: simulations of public models with a growth of 0.001 1/s decay.
"""
_NAMES = (
    "rotor", "generator", "twist", "wake", "position", "velocity", "filter", "filter_rate", "estimate", "wind",
    "integral", "torque", "delay", "pitch", "pitch_rate",
)  # fmt: skip
"""Names of the states."""
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
    """Oscillating and growing modes of the closed loop in a steady wind below rated.

    Parameters
    ----------
    turbine : Turbine
    parameters : TsrTrackingParameters or BaselineParameters
        Numbers of a law that tracks the tip-speed ratio, or of one with a torque curve.
    wind : float
        [m/s].
    estimator : WindEstimator, optional
        Estimator of a law that tracks the tip-speed ratio.

    Returns
    -------
    list of LoopMode
        The least damped first. A growing mode that does not oscillate has the damping -1.
    """
    point = operating_point(turbine, wind)
    plant = _Plant(turbine, wind, point)
    if estimator is None:
        matrix = plant.with_torque_curve(parameters)  # type: ignore[arg-type]  # as documented
    else:
        matrix = plant.with_estimate(parameters, estimator)  # type: ignore[arg-type]  # as documented
    rotor, tower = (_NAMES.index("rotor"), plant.inertia), (_NAMES.index("velocity"), plant.top.mass)
    return modes_of_loop(matrix, wind, rotor, tower)


def growing_mode(
    turbine: Turbine,
    parameters: TsrTrackingParameters | BaselineParameters,
    estimator: WindEstimator | None = None,
) -> LoopMode | None:
    """Fastest growing mode in the winds of `winds_below_rated`, None where none grows by `LEAST_GROWTH`.

    Parameters
    ----------
    turbine, parameters, estimator
        As those of `torque_loop_modes`.
    """
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

    Parameters
    ----------
    turbine : Turbine
    parameters : BaselineParameters

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
    """The turbine without its controller."""

    turbine: Turbine
    wind: float
    point: OperatingPoint

    def __post_init__(self) -> None:
        from wt_gym.control.controllers.rotor_rules import tower_top  # controllers know this check

        turbine, drivetrain = self.turbine, self.turbine.drivetrain
        point, rotor = self.point, rotor_of(turbine)
        where = self.wind, point.rotor_speed, point.pitch
        self.steady, (self.frozen, induction) = rotor.slopes(*where), rotor.frozen_torque_slopes(*where)
        self.lag = 1.1 / (1.0 - 1.3 * min(induction, _LARGEST_INDUCTION)) * rotor.radius / self.wind
        self.top, self.inertia = tower_top(turbine), rotor_inertia(turbine)
        self.generator = drivetrain.gear_ratio**2 * drivetrain.generator_inertia
        reduced = 1.0 / (1.0 / self.generator + 1.0 / (self.inertia - self.generator))
        self.rigid = math.sqrt(drivetrain.spring / reduced) > 2.0 * math.pi * _STIFFEST_SHAFT

    def _open(self) -> tuple[dict[str, NDArray[np.float64]], dict[str, NDArray[np.float64]]]:
        """Rows that pick a state, and rates of the states without those of the controller."""
        turbine, drivetrain, top = self.turbine, self.turbine.drivetrain, self.top
        x = dict(zip(_NAMES, np.eye(len(_NAMES)), strict=True))
        frozen, steady = np.array(self.frozen), self.steady
        settled = np.array([steady.torque_wind, steady.torque_speed, steady.torque_pitch])
        inputs = np.array([-x["velocity"], x["rotor"], x["pitch"]])
        air, load = frozen @ inputs + x["wake"], drivetrain.gear_ratio / drivetrain.gearbox_efficiency * x["torque"]
        rates = {name: -row for name, row in x.items()}  # what a controller does not use decays
        if self.rigid:
            rates["rotor"] = (air - load) / self.inertia
        else:
            shaft = drivetrain.spring * x["twist"] + drivetrain.damper * (x["rotor"] - x["generator"])
            rates["rotor"] = (air - shaft) / (self.inertia - self.generator)
            rates["generator"] = (shaft - load) / self.generator
            rates["twist"] = x["rotor"] - x["generator"]
        rates["wake"] = ((settled - frozen) @ inputs - x["wake"]) / self.lag
        thrust = np.array([steady.thrust_wind, steady.thrust_speed, steady.thrust_pitch]) @ inputs
        rates["position"] = x["velocity"]
        structure = 2.0 * turbine.tower.damping_ratio * top.fore_aft * x["velocity"] + top.fore_aft**2 * x["position"]
        rates["velocity"] = thrust / top.mass - structure
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
        servo = self.turbine.pitch.servo_frequency
        if servo is None:
            rates["pitch"] = (demand - x["pitch"]) / (1.5 * INTERVAL)
        else:
            rates["delay"] = (demand - x["delay"]) / INTERVAL
            rates["pitch"] = x["pitch_rate"]
            damping = 2.0 * self.turbine.pitch.servo_damping * servo
            rates["pitch_rate"] = servo**2 * (x["delay"] - x["pitch"]) - damping * x["pitch_rate"]
        return np.array([rates[name] for name in _NAMES])

    @property
    def _torque_delay(self) -> float:
        """Half a step, over which a demand is held, and the lag of the converter [s]."""
        return 0.5 * INTERVAL + self.turbine.drivetrain.torque_lag
