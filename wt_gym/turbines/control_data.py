"""What is published with a turbine about its controller: gains, filters and schedules, in SI units and radians."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wt_gym.turbines.checks import ArrayRecord, check_array, check_ascending, check_number, fail

__all__ = ["ControlData"]

_ANGLE = np.pi
_BIG = 1e12


@dataclass(frozen=True, eq=False, repr=False)
class ControlData(ArrayRecord):
    """Numbers of a turbine's own controller, as far as they are known; None stands for what is not published.

    Speeds are those of the generator and torques those on the high-speed shaft, as in a Bladed-style controller: a file
    with gains for the rotor speed is converted with the gear ratio by its reader. All gains are those of the sign
    convention in which more pitch and more torque slow the rotor down, so all are positive.

    Attributes
    ----------
    fine_pitch : float or None
        Pitch of optimal power below rated [rad].
    optimal_tip_speed_ratio : float or None
        [-].
    peak_power_coefficient : float or None
        Aerodynamic power coefficient at fine pitch and optimal tip-speed ratio [-].
    region_2_gain : float or None
        Generator torque over the square of the generator speed below rated [N m/(rad/s)^2].
    air_density : float or None
        For which the region-2 gain is made [kg/m^3]; None for the standard atmosphere at sea level.
    cut_in_generator_speed, region_2_speed, region_3_speed : float or None
        Generator speeds at which torque begins, at which region 2 begins, and from which on region 3 holds [rad/s]
        (VS_CtInSp, VS_Rgn2Sp, VS_RtGnSp).
    slip : float or None
        Slip of region 2 1/2 as a fraction (VS_SlPc / 100).
    rated_mechanical_power : float or None
        Power on the high-speed shaft that region 3 holds [W] (VS_RtPwr).
    torque_proportional_gain, torque_integral_gain : float or None
        From generator speed error to generator torque [N m s/rad], [N m/rad].
    constant_power : bool or None
        Whether region 3 holds power (True) or torque (False). A held torque makes more than rated power while the rotor
        is faster than rated, as in ROSCO.
    speed_shift_per_pitch : float or None
        Fall of the speed that the torque law tracks, over rated speed, per pitch above the least pitch [1/rad]: the
        set-point smoother (Abbas et al., Wind Energ. Sci. 7 (2022) 53, section 3.4).
    speed_shift_per_power : float or None
        Rise of the speed that the pitch law holds, over rated speed, per power missing to rated, over rated power [-].
    speed_shift_frequency : float or None
        Corner frequency of the low-pass filter on both shifts [rad/s].
    gain_pitch : ndarray (n,) or None
        Pitch of the gain schedule, ascending [rad].
    pitch_proportional_gain, pitch_integral_gain : ndarray (n,) or None
        From generator speed error [rad/s] to pitch [rad] at ``gain_pitch`` [s], [-]. Both come with ``gain_pitch``. The
        proportional gain may turn negative at a large pitch, where the air damps more than is required.
    gain_doubling_pitch : float or None
        Pitch at which the gains are half of those at zero pitch [rad] (PC_KK); ``gain_pitch`` is then the one value 0.
    power_per_pitch : float or None
        Change of the aerodynamic power with the pitch at rated and fine pitch [W/rad], negative.
    reference_generator_speed : float or None
        Generator speed that the pitch controller holds [rad/s] (PC_RefSpd).
    speed_filter_frequency : float or None
        Corner frequency of the low-pass filter on the generator speed [rad/s].
    speed_filter_damping : float or None
        Its damping ratio where the filter is of second order [-]; None for first order.
    min_pitch_wind, min_pitch : ndarray (m,) or None
        Wind speed at hub height, ascending [m/s], and the least pitch there [rad]: peak shaving and power below rated.
        Both or neither.
    pitch_actuator_frequency, pitch_actuator_damping : float or None
        Natural frequency [rad/s] and damping ratio [-] of the pitch actuator as a second-order system.
    natural_frequency, damping_ratio : float or None
        Of the speed loop for which the pitch gains were made [rad/s], [-].
    region_3_min_pitch : float or None
        Pitch from which on the torque controller is in region 3 [rad] (VS_Rgn3MP).
    max_pitch, max_pitch_rate : float or None
        Limits of the pitch controller where they are not those of the drives [rad], [rad/s] (PC_MaxPit, PC_MaxRat).
    trim_wind, trim_pitch : ndarray (k,) or None
        Wind speed at hub height from rated on, ascending [m/s], and the steady pitch there [rad]. Both or neither.

    Raises
    ------
    wt_gym.base.errors.TurbineDefinitionError
        For a number out of range, or a table with a part missing.
    """

    fine_pitch: float | None = None
    optimal_tip_speed_ratio: float | None = None
    peak_power_coefficient: float | None = None
    region_2_gain: float | None = None
    air_density: float | None = None
    cut_in_generator_speed: float | None = None
    region_2_speed: float | None = None
    region_3_speed: float | None = None
    slip: float | None = None
    rated_mechanical_power: float | None = None
    torque_proportional_gain: float | None = None
    torque_integral_gain: float | None = None
    constant_power: bool | None = None
    gain_pitch: NDArray[np.float64] | None = None
    pitch_proportional_gain: NDArray[np.float64] | None = None
    pitch_integral_gain: NDArray[np.float64] | None = None
    reference_generator_speed: float | None = None
    speed_filter_frequency: float | None = None
    speed_filter_damping: float | None = None
    gain_doubling_pitch: float | None = None
    power_per_pitch: float | None = None
    min_pitch_wind: NDArray[np.float64] | None = None
    min_pitch: NDArray[np.float64] | None = None
    pitch_actuator_frequency: float | None = None
    pitch_actuator_damping: float | None = None
    natural_frequency: float | None = None
    damping_ratio: float | None = None
    region_3_min_pitch: float | None = None
    max_pitch: float | None = None
    max_pitch_rate: float | None = None
    trim_wind: NDArray[np.float64] | None = None
    trim_pitch: NDArray[np.float64] | None = None
    speed_shift_per_pitch: float | None = None
    speed_shift_per_power: float | None = None
    speed_shift_frequency: float | None = None

    def __post_init__(self) -> None:
        """Check the fields and make the arrays read-only."""
        ranges = {
            "fine_pitch": (-_ANGLE, _ANGLE),
            "optimal_tip_speed_ratio": (0.1, 50.0),
            "peak_power_coefficient": (0.01, 0.7),
            "region_2_gain": (0.0, _BIG),
            "air_density": (0.1, 10.0),
            "cut_in_generator_speed": (0.0, 1e4),
            "region_2_speed": (0.0, 1e4),
            "region_3_speed": (0.0, 1e4),
            "slip": (0.0, 1.0),
            "rated_mechanical_power": (0.0, 1e9),
            "torque_proportional_gain": (0.0, _BIG),
            "torque_integral_gain": (0.0, _BIG),
            "speed_shift_per_pitch": (0.0, 1e3),
            "speed_shift_per_power": (0.0, 1e3),
            "speed_shift_frequency": (1e-4, 1e3),
            "reference_generator_speed": (0.0, 1e4),
            "speed_filter_frequency": (1e-3, 1e3),
            "speed_filter_damping": (0.0, 10.0),
            "pitch_actuator_frequency": (1e-2, 1e3),
            "pitch_actuator_damping": (0.0, 10.0),
            "natural_frequency": (1e-3, 100.0),
            "damping_ratio": (0.0, 10.0),
            "region_3_min_pitch": (-_ANGLE, _ANGLE),
            "gain_doubling_pitch": (1e-4, 10.0),
            "power_per_pitch": (-_BIG, 0.0),
            "max_pitch": (-_ANGLE, _ANGLE),
            "max_pitch_rate": (1e-6, 10.0),
        }
        for name, (low, high) in ranges.items():
            value = getattr(self, name)
            if value is not None:
                self._set(**{name: check_number(f"ControlData.{name}", value, low, high)})
        if self.constant_power is not None and not isinstance(self.constant_power, bool):
            raise fail("ControlData.constant_power", self.constant_power, "True, False or None")
        self._check_table("gain_pitch", _ANGLE, {"pitch_proportional_gain": -_BIG, "pitch_integral_gain": 0.0})
        self._check_table("trim_wind", 200.0, {"trim_pitch": -_ANGLE})
        self._check_table("min_pitch_wind", 200.0, {"min_pitch": -_ANGLE})
        if self.gain_doubling_pitch is not None and (self.gain_pitch is None or self.gain_pitch.tolist() != [0.0]):
            raise fail("ControlData.gain_doubling_pitch", self.gain_doubling_pitch, "None unless gain_pitch is [0]")

    def _check_table(self, grid_name: str, high: float, columns: dict[str, float]) -> None:
        """Check a grid and its columns (name: least value), which stand together or not at all."""
        grid = getattr(self, grid_name)
        given = [name for name in columns if getattr(self, name) is not None]
        if grid is None:
            if given:
                raise fail(f"ControlData.{given[0]}", getattr(self, given[0]), f"None without {grid_name}")
            return
        grid = check_array(f"ControlData.{grid_name}", grid, (None,), low=-high, high=high)
        if grid.size > 1:
            check_ascending(f"ControlData.{grid_name}", grid)
        self._set(**{grid_name: grid})
        for name, low in columns.items():
            values = getattr(self, name)
            if values is None:
                raise fail(f"ControlData.{name}", values, f"as many numbers as {grid_name}")
            self._set(**{name: check_array(f"ControlData.{name}", values, (grid.size,), low=low)})
