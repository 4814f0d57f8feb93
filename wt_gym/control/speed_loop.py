"""The closed loop of rotor speed and pitch, linear about steady operating points: is a controller stable there?

States are the rotor speed, the first fore-aft motion of the tower top, the filter of the measured speed, the integral
of the pitch law, the pitch drive, and the delay of a demand. The rotor is quasi-steady by blade elements
(`wt_gym.control.rotor.Rotor.slopes`), which leaves out the lag of the wake and so gives the least answer of the
moment to the pitch; blades are rigid, the shaft is stiff, drives have no limits. With the speed w of the rotor, the
pitch theta and the velocity u of the tower top,

``J w' = Q_w w + Q_theta theta - Q_V u - N (dM/dw_gen) N w``,
``m u' + (2 zeta m w_t + T_V) u + m w_t^2 x = T_w w + T_theta theta``.

A controller whose loop has a growing mode is refused; one whose loop is hardly damped is warned of.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import expm

from wt_gym.base.errors import ControllerError
from wt_gym.base.warn_once import warn_once
from wt_gym.control.design import rotor_inertia
from wt_gym.control.operating_point import operating_point
from wt_gym.control.rotor import rotor_of
from wt_gym.wind.iec import REFERENCE_INTENSITY, turbulence_sigma

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.control.controllers.discon import BaselineParameters
    from wt_gym.turbines import Turbine

__all__ = [
    "LEAST_DAMPING",
    "LoopMode",
    "LoopReport",
    "check_speed_loop",
    "checked_winds",
    "gust_pitch_rate",
    "gust_speed_rise",
    "modes_of_loop",
    "speed_loop_modes",
]

LEAST_DAMPING = 0.15
"""Damping ratio of the rotor's mode below which a controller is warned of: a step then overshoots by more than 62 %
[-]. The published controllers of the catalogue have 0.25 and more."""
_PITCH = 7
"""Row of the pitch in the state matrix."""
MOST_SPEED_RISE = 0.25
"""Rise of the rotor speed after a gust of one standard deviation, over rated, above which a controller is warned of:
that of the environments' overspeed limit. Published controllers of the catalogue have up to 0.18 [-]."""
INTERVAL = 0.1
"""Step of the controller for the delay of its demand [s], that of `training`."""


@dataclass(frozen=True)
class LoopMode:
    """A mode of the closed loop.

    Attributes
    ----------
    wind : float
        [m/s].
    frequency : float
        Natural frequency [rad/s].
    damping : float
        Damping ratio [-]; negative grows.
    tower_share : float
        Kinetic energy of the tower top over that of tower top and rotor [-].
    """

    wind: float
    frequency: float
    damping: float
    tower_share: float


def checked_winds(turbine: Turbine) -> tuple[float, ...]:
    """Winds above rated in which the loop is looked at [m/s], no farther apart than 1 m/s, up to cut-out."""
    first = 1.1 * turbine.rated_wind_speed
    last = max(turbine.cut_out, 1.05 * first)
    return tuple(np.linspace(first, last, 1 + max(math.ceil(last - first), 4)).tolist())


def speed_loop_modes(turbine: Turbine, parameters: BaselineParameters, wind: float) -> list[LoopMode]:
    """Oscillating and growing modes of the closed loop in a steady wind.

    Parameters
    ----------
    turbine : Turbine
    parameters : BaselineParameters
        Of the pitch controller.
    wind : float
        Above rated [m/s].

    Returns
    -------
    list of LoopMode
        The least damped first. A growing mode that does not oscillate has the damping -1.
    """
    matrix, mass, inertia = _matrix(turbine, parameters, wind)
    return modes_of_loop(matrix, wind, (0, inertia), (2, mass))


def modes_of_loop(
    matrix: NDArray[np.float64], wind: float, rotor: tuple[int, float], tower: tuple[int, float]
) -> list[LoopMode]:
    """Oscillating and growing modes of a closed loop, the least damped first.

    Parameters
    ----------
    matrix : numpy.ndarray, shape (n, n)
        State matrix.
    wind : float
        [m/s].
    rotor, tower : tuple of int and float
        Places of the speed of the rotor and of the velocity of the tower top among the states, with the inertia
        [kg m^2] and the mass [kg] that move with them.
    """
    values, vectors = np.linalg.eig(matrix)
    modes = []
    for value, vector in zip(values, vectors.T, strict=True):
        size = abs(value)
        growing = value.real > 1e-9 * max(size, 1.0)
        if not (value.imag > 1e-9 or (growing and abs(value.imag) <= 1e-9)):
            continue
        energies = [inertia * abs(vector[place]) ** 2 for place, inertia in (tower, rotor)]
        share = energies[0] / max(sum(energies), 1e-300)
        modes.append(LoopMode(wind, float(size), float(-value.real / size), share))
    return sorted(modes, key=lambda mode: mode.damping)


def _matrix(turbine: Turbine, p: BaselineParameters, wind: float) -> tuple[NDArray[np.float64], float, float]:
    """State matrix of (speed, tower top, its velocity, filter (2), integral, delay, pitch (2)); mass and inertia."""
    from wt_gym.control.controllers.rotor_rules import tower_top  # controllers know this check

    drivetrain, top = turbine.drivetrain, tower_top(turbine)
    gear, inertia = drivetrain.gear_ratio, rotor_inertia(turbine)
    point = operating_point(turbine, wind)
    s = rotor_of(turbine).slopes(wind, point.rotor_speed, point.pitch)
    kp, ki = p.pitch_law.gains(point.pitch)
    if p.gain_table is None:
        # the published factor stands before the integral: as the pitch moves, its change moves the demand
        growth = point.pitch * _log_slope(p, point.pitch)
    else:
        growth = 0.0
    to_rotor = gear / drivetrain.gearbox_efficiency
    torque_slope = -point.generator_torque / (gear * point.rotor_speed) if p.constant_power else 0.0
    a = np.zeros((9, 9))
    a[0, 0] = (s.torque_speed - to_rotor * torque_slope * gear) / inertia
    a[0, 2], a[0, 7] = -s.torque_wind / inertia, s.torque_pitch / inertia
    a[1, 2] = 1.0
    damping = 2.0 * turbine.tower.damping_ratio * top.fore_aft * top.mass + s.thrust_wind
    a[2, 0], a[2, 1] = s.thrust_speed / top.mass, -(top.fore_aft**2)
    a[2, 2], a[2, 7] = -damping / top.mass, s.thrust_pitch / top.mass
    w = p.corner_frequency
    if p.filter_damping > 0.0:
        a[3, 4] = 1.0
        a[4, 0], a[4, 3], a[4, 4] = w**2 * gear, -(w**2), -2.0 * p.filter_damping * w
    else:
        a[3, 0], a[3, 3], a[4, 4] = w * gear, -w, -1.0
    a[5, 3] = ki
    # demand = kp filtered + integral + growth pitch, late by a step: first-order lag of the delay of the drive
    servo = turbine.pitch.servo_frequency
    lag = 1.5 * INTERVAL if servo is None else INTERVAL
    a[6, 3], a[6, 5], a[6, 6] = kp / lag, 1.0 / lag, (growth - 1.0) / lag
    if servo is None:
        a[7] = a[6]  # the drive follows the demand
        a[7, 7], a[7, 6] = a[6, 6], 0.0
        a[8, 8] = -1.0
    else:
        a[7, 8] = 1.0
        a[8, 6], a[8, 7], a[8, 8] = servo**2, -(servo**2), -2.0 * turbine.pitch.servo_damping * servo
    return a, top.mass, inertia


def _log_slope(p: BaselineParameters, pitch: float) -> float:
    """Relative change of the gain factor with the pitch [1/rad]."""
    return -p.pitch_law.factor(pitch) / p.gain_doubling_pitch


def gust_pitch_rate(turbine: Turbine, parameters: BaselineParameters, wind: float) -> float:
    """Largest pitch rate with which the linear loop answers a step of the wind [rad/s].

    The step is one standard deviation of the normal turbulence model for the turbine's class. A loop that asks the
    drives for more than their rate gets the phase lag of the limit, and can swing although its linear model is well
    damped.

    Parameters
    ----------
    turbine, parameters, wind
        As of `speed_loop_modes`.
    """
    matrix, answers = _gust_answers(turbine, parameters, wind)
    return float(np.abs(answers @ matrix[_PITCH]).max())


def gust_speed_rise(turbine: Turbine, parameters: BaselineParameters, wind: float) -> float:
    """Largest rise of the rotor speed after that step of the wind, over rated speed [-].

    Parameters
    ----------
    turbine, parameters, wind
        As of `speed_loop_modes`.
    """
    _, answers = _gust_answers(turbine, parameters, wind)
    return float(answers[:, 0].max()) / turbine.drivetrain.rated_rotor_speed


def _gust_answers(
    turbine: Turbine, parameters: BaselineParameters, wind: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """State matrix (n, n), and states (m, n) after a step of the wind by one standard deviation, over five turns."""
    matrix, mass, inertia = _matrix(turbine, parameters, wind)
    point = operating_point(turbine, wind)
    s = rotor_of(turbine).slopes(wind, point.rotor_speed, point.pitch)
    turbulence = turbine.turbulence_class if turbine.turbulence_class in REFERENCE_INTENSITY else "B"
    gust = np.zeros(len(matrix))
    gust[0], gust[2] = s.torque_wind / inertia, s.thrust_wind / mass
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
    """What `check_speed_loop` has found.

    Attributes
    ----------
    modes : tuple of LoopMode
        The least damped mode in each wind.
    least_damped : LoopMode or None
        Of all modes that move the rotor more than the tower, and all that grow.
    tower : LoopMode or None
        The least damped of the tower.
    pitch_rate : float
        Largest pitch rate after a gust over that of the drives, see `gust_pitch_rate` [-].
    speed_rise : float
        Largest rise of the rotor speed after the same gust over rated speed, see `gust_speed_rise` [-].
    """

    modes: tuple[LoopMode, ...]
    least_damped: LoopMode | None
    tower: LoopMode | None
    pitch_rate: float
    speed_rise: float


@lru_cache(maxsize=64)
def _report(turbine: Turbine, parameters: BaselineParameters) -> LoopReport:
    checked = checked_winds(turbine)
    by_wind = [speed_loop_modes(turbine, parameters, wind) for wind in checked]
    every = [mode for modes in by_wind for mode in modes]
    speed = [mode for mode in every if mode.tower_share < 0.5 or mode.damping < 0.0]
    tower = [mode for mode in every if mode.tower_share >= 0.5]
    winds = () if _grows(speed) else checked[:: len(checked) // 4]
    rates = [gust_pitch_rate(turbine, parameters, wind) for wind in winds]
    rises = [gust_speed_rise(turbine, parameters, wind) for wind in winds]
    return LoopReport(
        tuple(modes[0] for modes in by_wind if modes),
        min(speed, key=lambda mode: mode.damping, default=None),
        min(tower, key=lambda mode: mode.damping, default=None),
        max(rates, default=0.0) / turbine.pitch.max_rate,
        max(rises, default=0.0),
    )


def _grows(modes: list[LoopMode]) -> bool:
    return any(mode.damping < 0.0 for mode in modes)


def check_speed_loop(turbine: Turbine, parameters: BaselineParameters) -> LoopReport | None:
    """Look at the closed loop in winds above rated (`checked_winds`).

    Parameters
    ----------
    turbine : Turbine
    parameters : BaselineParameters

    Returns
    -------
    LoopReport or None
        None for a generator that takes no demand.

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
