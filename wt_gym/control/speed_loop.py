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
import warnings
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.control.design import rotor_inertia
from wt_gym.control.operating_point import operating_point
from wt_gym.control.rotor import rotor_of
from wt_gym.errors import ControllerError

if TYPE_CHECKING:
    from wt_gym.control.controllers.discon import BaselineParameters
    from wt_gym.turbines import Turbine

__all__ = ["LEAST_DAMPING", "LoopMode", "check_speed_loop", "checked_winds", "speed_loop_modes"]

LEAST_DAMPING = 0.05
"""Damping ratio of the speed loop below which a controller is warned of: a swing then halves in more than two turns
of it [-]."""
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
    """Five winds above rated in which the loop is looked at [m/s], up to cut-out."""
    first = 1.1 * turbine.rated_wind_speed
    return tuple(np.linspace(first, max(turbine.cut_out, 1.05 * first), 5).tolist())


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
    values, vectors = np.linalg.eig(matrix)
    modes = []
    for value, vector in zip(values, vectors.T, strict=True):
        size = abs(value)
        growing = value.real > 1e-9 * max(size, 1.0)
        if not (value.imag > 1e-9 or (growing and abs(value.imag) <= 1e-9)):
            continue
        tower, rotor = mass * abs(vector[2]) ** 2, inertia * abs(vector[0]) ** 2
        modes.append(LoopMode(wind, float(size), float(-value.real / size), tower / max(tower + rotor, 1e-300)))
    return sorted(modes, key=lambda mode: mode.damping)


def _matrix(turbine: Turbine, p: BaselineParameters, wind: float) -> tuple[np.ndarray, float, float]:
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
        a[8, 6], a[8, 7], a[8, 8] = servo**2, -(servo**2), -2.0 * servo
    return a, top.mass, inertia


def _log_slope(p: BaselineParameters, pitch: float) -> float:
    """Relative change of the gain factor with the pitch [1/rad]."""
    return -p.pitch_law.factor(pitch) / p.gain_doubling_pitch


@lru_cache(maxsize=64)
def _worst(turbine: Turbine, parameters: BaselineParameters) -> tuple[LoopMode, ...]:
    """Least damped mode in each of the winds, without those of the tower that its own damping decides."""
    found = []
    for wind in checked_winds(turbine):
        modes = [m for m in speed_loop_modes(turbine, parameters, wind) if m.tower_share < 0.9 or m.damping < 0.0]
        if modes:
            found.append(modes[0])
    return tuple(found)


def check_speed_loop(turbine: Turbine, parameters: BaselineParameters) -> tuple[LoopMode, ...]:
    """Look at the closed loop in five winds above rated.

    Parameters
    ----------
    turbine : Turbine
    parameters : BaselineParameters

    Returns
    -------
    tuple of LoopMode
        The least damped mode in each wind; none for a generator that takes no demand.

    Raises
    ------
    wt_gym.errors.ControllerError
        If a mode grows.

    Warns
    -----
    UserWarning
        If a mode has less damping than `LEAST_DAMPING`.
    """
    if not turbine.drivetrain.takes_torque:
        return ()
    modes = _worst(turbine, parameters)
    if not modes:
        return modes
    worst = min(modes, key=lambda mode: mode.damping)
    if worst.damping < LEAST_DAMPING:
        what = (
            f"the speed loop of {turbine.name} at {worst.wind:.1f} m/s has a mode of {worst.frequency:.2f} rad/s with "
            f"a damping ratio of {worst.damping:+.3f} ({_gains(turbine, parameters, worst.wind)})"
        )
        if worst.damping < 0.0:
            raise ControllerError(f"{what}; it must be positive: choose smaller gains or a lower natural_frequency")
        warnings.warn(f"{what}; at least {LEAST_DAMPING} is advisable", stacklevel=3)
    return modes


def _gains(turbine: Turbine, parameters: BaselineParameters, wind: float) -> str:
    """Gains at the operating point, in words."""
    pitch = operating_point(turbine, wind).pitch
    kp, ki = parameters.pitch_law.gains(pitch)
    return f"gains {kp:.4g} s and {ki:.4g} at a pitch of {math.degrees(pitch):.1f} deg"
