"""Design wind conditions of IEC 61400-1: turbulence levels, extreme speeds and the time laws of the transients.

Formulas of IEC 61400-1, edition 4 (2019), clause 6.3. Every function takes SI units and radians; functions of
time take the seconds since the transient began, as a float or an array.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, cast

import numpy as np

from wt_gym.base.errors import InflowError, did_you_mean

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = [
    "coherent_gust_direction",
    "coherent_gust_speed",
    "direction_change",
    "direction_change_amplitude",
    "extreme_wind_speed",
    "length_scale",
    "operating_gust",
    "operating_gust_amplitude",
    "reference_intensity",
    "reference_speed",
    "turbulence_sigma",
    "wind_shear_amplitude",
    "wind_shear_envelope",
]

REFERENCE_SPEED = {"I": 50.0, "II": 42.5, "III": 37.5}
REFERENCE_INTENSITY = {"A+": 0.18, "A": 0.16, "B": 0.14, "C": 0.12}
AVERAGE_OVER_REFERENCE_SPEED = 0.2
NORMAL_SHEAR_EXPONENT = 0.2
EXTREME_SHEAR_EXPONENT = 0.11
EXTREME_WIND_INTENSITY = 0.11
"""σ₁ over the mean speed in the turbulent extreme wind model."""

OPERATING_GUST_DURATION = 10.5
DIRECTION_CHANGE_DURATION = 6.0
COHERENT_GUST_DURATION = 10.0
COHERENT_GUST_SPEED = 15.0
WIND_SHEAR_DURATION = 12.0


def reference_speed(turbine_class: str) -> float:
    """Reference wind speed V_ref [m/s] of turbine class ``"I"``, ``"II"`` or ``"III"``."""
    return _look_up(REFERENCE_SPEED, turbine_class, "turbine_class")


def reference_intensity(turbulence_class: str) -> float:
    """Reference turbulence intensity I_ref of class ``"A+"``, ``"A"``, ``"B"`` or ``"C"``."""
    return _look_up(REFERENCE_INTENSITY, turbulence_class, "turbulence_class")


def _look_up(table: dict[str, float], name: str, argument: str) -> float:
    if not isinstance(name, str) or name not in table:
        raise InflowError(
            f"{argument} must be one of {', '.join(map(repr, table))}; got {name!r}{did_you_mean(name, table)}"
        )
    return table[name]


def length_scale(hub_height: float) -> float:
    """Longitudinal turbulence scale Λ₁ [m]: 0.7 z up to 60 m, 42 m above (equation 5)."""
    return 0.7 * min(hub_height, 60.0)


def turbulence_sigma(
    mean_speed: float, turbulence_class: str = "B", turbulence: str = "NTM", turbine_class: str = "I"
) -> float:
    """Standard deviation σ₁ of the longitudinal wind component [m/s].

    Parameters
    ----------
    mean_speed
        Ten-minute mean at hub height [m/s].
    turbulence_class
        ``"A+"``, ``"A"``, ``"B"`` or ``"C"``.
    turbulence
        ``"NTM"``, the normal turbulence model (90 % quantile), or ``"ETM"``, the extreme one.
    turbine_class
        ``"I"``, ``"II"`` or ``"III"``; matters for ``"ETM"`` only, through the annual average speed.

    Raises
    ------
    InflowError
        A class or model is unknown.
    """
    intensity = reference_intensity(turbulence_class)
    average_speed = AVERAGE_OVER_REFERENCE_SPEED * reference_speed(turbine_class)
    if turbulence == "NTM":
        return intensity * (0.75 * mean_speed + 5.6)
    if turbulence == "ETM":
        scale = 2.0  # m/s, the constant c of the standard
        return scale * intensity * (0.072 * (average_speed / scale + 3.0) * (mean_speed / scale - 4.0) + 10.0)
    raise InflowError(f"turbulence must be 'NTM' or 'ETM'; got {turbulence!r}")


def extreme_wind_speed(
    height: float | NDArray[np.float64],
    hub_height: float,
    turbine_class: str = "I",
    return_period: int = 50,
    turbulent: bool = False,
) -> float | NDArray[np.float64]:
    """Extreme wind speed (EWM) [m/s] at a height [m] for a return period of 50 years or of one year.

    ``turbulent=False`` gives the steady model (gust speed, 1.4 V_ref at the hub), ``turbulent=True`` the ten-minute
    mean of the turbulent model (V_ref at the hub, to be used with σ₁ = 0.11 V_hub).
    """
    if return_period not in (1, 50):
        raise InflowError(f"return_period must be 1 or 50 years; got {return_period!r}")
    hub_speed = reference_speed(turbine_class) * (1.0 if turbulent else 1.4) * (0.8 if return_period == 1 else 1.0)
    return hub_speed * (height / hub_height) ** EXTREME_SHEAR_EXPONENT


def _size_ratio(hub_height: float, rotor_diameter: float) -> float:
    return rotor_diameter / length_scale(hub_height)


def operating_gust_amplitude(
    mean_speed: float, hub_height: float, rotor_diameter: float, turbulence_class: str = "B", turbine_class: str = "I"
) -> float:
    """Gust magnitude V_gust [m/s] of the extreme operating gust (EOG)."""
    sigma = turbulence_sigma(mean_speed, turbulence_class)
    yearly_extreme = cast(float, extreme_wind_speed(hub_height, hub_height, turbine_class, return_period=1))
    return min(
        1.35 * (yearly_extreme - mean_speed), 3.3 * sigma / (1.0 + 0.1 * _size_ratio(hub_height, rotor_diameter))
    )


def operating_gust(time: float | NDArray[np.float64], amplitude: float) -> float | NDArray[np.float64]:
    """Speed added by the extreme operating gust [m/s]: a dip, a rise and a dip within 10.5 s."""
    phase = 2.0 * np.pi * _within(time, OPERATING_GUST_DURATION) / OPERATING_GUST_DURATION
    return -0.37 * amplitude * np.sin(1.5 * phase) * (1.0 - np.cos(phase))


def direction_change_amplitude(
    mean_speed: float, hub_height: float, rotor_diameter: float, turbulence_class: str = "B"
) -> float:
    """Angle θ_e [rad] of the extreme direction change (EDC), at most π."""
    sigma = turbulence_sigma(mean_speed, turbulence_class)
    slope = sigma / (mean_speed * (1.0 + 0.1 * _size_ratio(hub_height, rotor_diameter)))
    return min(4.0 * math.atan(slope), math.pi)


def direction_change(time: float | NDArray[np.float64], angle: float) -> float | NDArray[np.float64]:
    """Direction [rad] during the extreme direction change: half a cosine over 6 s, then held."""
    return angle * _half_cosine_rise(time, DIRECTION_CHANGE_DURATION)


def coherent_gust_direction(mean_speed: float) -> float:
    """Angle θ_cg [rad] of the extreme coherent gust with direction change (ECD)."""
    return math.pi if mean_speed < 4.0 else math.radians(720.0) / mean_speed


def coherent_gust_speed(
    time: float | NDArray[np.float64], amplitude: float = COHERENT_GUST_SPEED
) -> float | NDArray[np.float64]:
    """Speed added by the extreme coherent gust [m/s] (or its angle [rad]): half a cosine over 10 s, then held."""
    return amplitude * _half_cosine_rise(time, COHERENT_GUST_DURATION)


def wind_shear_amplitude(
    mean_speed: float, hub_height: float, rotor_diameter: float, turbulence_class: str = "B"
) -> float:
    """Amplitude A [m/s] of the extreme wind shear (EWS): the speed across D changes by 2 A at the peak."""
    sigma = turbulence_sigma(mean_speed, turbulence_class)
    return float(2.5 + 0.2 * 6.4 * sigma * _size_ratio(hub_height, rotor_diameter) ** 0.25)


def wind_shear_envelope(time: float | NDArray[np.float64]) -> float | NDArray[np.float64]:
    """Time factor 1 − cos(2πt/T) of the extreme wind shear, T = 12 s; zero outside."""
    return 1.0 - np.cos(2.0 * np.pi * _within(time, WIND_SHEAR_DURATION) / WIND_SHEAR_DURATION)


def _within(time: float | NDArray[np.float64], duration: float) -> float | NDArray[np.float64]:
    """Time held at the two ends of a transient, where its law has returned to zero or reached its final value."""
    return np.minimum(np.maximum(time, 0.0), duration)


def _half_cosine_rise(time: float | NDArray[np.float64], duration: float) -> float | NDArray[np.float64]:
    return 0.5 * (1.0 - np.cos(np.pi * _within(time, duration) / duration))
