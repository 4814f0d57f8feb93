"""Design wind conditions of IEC 61400-1: turbulence levels, extreme speeds, and the transients on a steady wind.

Formulas of IEC 61400-1, edition 4 (2019), clause 6.3. Every function takes SI units and radians; functions of
time take the seconds since the transient began, as a float or an array.
"""

import math
from dataclasses import dataclass
from typing import cast

import numpy as np

from wt_gym.base.errors import InflowError, did_you_mean
from wt_gym.base.quantities import Array
from wt_gym.wind.inflow import POSITIVE, check_flag, check_numbers, require_number
from wt_gym.wind.inflow_kernels import transient_velocity
from wt_gym.wind.steady import OnSteadyWind, SteadyInflow

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
    height: float | Array, hub_height: float, turbine_class: str = "I", return_period: int = 50, turbulent: bool = False
) -> float | Array:
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


def operating_gust(time: float | Array, amplitude: float) -> float | Array:
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


def direction_change(time: float | Array, angle: float) -> float | Array:
    """Direction [rad] during the extreme direction change: half a cosine over 6 s, then held."""
    return angle * _half_cosine_rise(time, DIRECTION_CHANGE_DURATION)


def coherent_gust_direction(mean_speed: float) -> float:
    """Angle θ_cg [rad] of the extreme coherent gust with direction change (ECD)."""
    return math.pi if mean_speed < 4.0 else math.radians(720.0) / mean_speed


def coherent_gust_speed(time: float | Array, amplitude: float = COHERENT_GUST_SPEED) -> float | Array:
    """Speed added by the extreme coherent gust [m/s] (or its angle [rad]): half a cosine over 10 s, then held."""
    return amplitude * _half_cosine_rise(time, COHERENT_GUST_DURATION)


def wind_shear_amplitude(
    mean_speed: float, hub_height: float, rotor_diameter: float, turbulence_class: str = "B"
) -> float:
    """Amplitude A [m/s] of the extreme wind shear (EWS): the speed across D changes by 2 A at the peak."""
    sigma = turbulence_sigma(mean_speed, turbulence_class)
    return float(2.5 + 0.2 * 6.4 * sigma * _size_ratio(hub_height, rotor_diameter) ** 0.25)


def wind_shear_envelope(time: float | Array) -> float | Array:
    """Time factor 1 − cos(2πt/T) of the extreme wind shear, T = 12 s; zero outside."""
    return 1.0 - np.cos(2.0 * np.pi * _within(time, WIND_SHEAR_DURATION) / WIND_SHEAR_DURATION)


def _within(time: float | Array, duration: float) -> float | Array:
    """Time held at the two ends of a transient, where its law has returned to zero or reached its final value."""
    return np.minimum(np.maximum(time, 0.0), duration)


def _half_cosine_rise(time: float | Array, duration: float) -> float | Array:
    return 0.5 * (1.0 - np.cos(np.pi * _within(time, duration) / duration))


_KINDS = ("EOG", "EDC", "ECD", "EWS-vertical", "EWS-horizontal")


@dataclass(frozen=True)
class TransientInflow(OnSteadyWind):
    """A steady wind with one transient of IEC 61400-1 on it.

    Build one with :meth:`eog`, :meth:`edc`, :meth:`ecd` or :meth:`ews`, which take the amplitudes from the
    standard. It travels with the wind: what acts at the tower now acted a distance d upwind of it a time d/U ago, so
    that a lidar sees it coming. The linear shear of EWS is held at its edge value beyond half a rotor diameter from
    the hub, where the standard's formula would soon reverse the wind.

    Parameters
    ----------
    steady
        The wind before the transient.
    kind
        ``"EOG"``, ``"EDC"``, ``"ECD"``, ``"EWS-vertical"`` or ``"EWS-horizontal"``.
    speed_amplitude
        V_gust (EOG), V_cg (ECD) or A (EWS) [m/s]; for EWS, negative values reverse the shear. Unused in EDC.
    direction_amplitude
        θ_e (EDC) or θ_cg (ECD) [rad], counter-clockwise from above positive. Unused in EOG and EWS.
    rotor_diameter
        Rotor diameter D [m].
    start_time
        Time at which the transient begins at the tower [s].
    travels
        False: it acts at all distances at once, as in the uniform wind files of the industry's tools.
    """

    steady: SteadyInflow
    kind: str
    speed_amplitude: float
    direction_amplitude: float
    rotor_diameter: float
    start_time: float = 0.0
    travels: bool = True

    def __post_init__(self) -> None:
        self._check_steady()
        if self.kind not in _KINDS:
            raise InflowError(f"kind must be one of {', '.join(map(repr, _KINDS))}; got {self.kind!r}")
        check_numbers(
            self, speed_amplitude=("m/s",), direction_amplitude=("rad", -math.pi, math.pi),
            rotor_diameter=("m", *POSITIVE), start_time=("s",),
        )  # fmt: skip
        check_flag(self, "travels")

    @classmethod
    def eog(
        cls,
        speed: float,
        hub_height: float,
        rotor_diameter: float,
        turbulence_class: str = "B",
        turbine_class: str = "I",
        start_time: float = 0.0,
    ) -> "TransientInflow":
        """Extreme operating gust on the normal wind profile."""
        steady = _normal_profile(speed, hub_height)
        amplitude = operating_gust_amplitude(speed, hub_height, rotor_diameter, turbulence_class, turbine_class)
        return cls(steady, "EOG", amplitude, 0.0, rotor_diameter, start_time)

    @classmethod
    def edc(
        cls, speed: float, hub_height: float, rotor_diameter: float, turbulence_class: str = "B", sign: int = 1,
        start_time: float = 0.0,
    ) -> "TransientInflow":  # fmt: skip
        """Extreme direction change on the normal wind profile; ``sign`` +1 turns counter-clockwise from above."""
        steady = _normal_profile(speed, hub_height)
        angle = direction_change_amplitude(speed, hub_height, rotor_diameter, turbulence_class)
        return cls(steady, "EDC", 0.0, _sign(sign) * angle, rotor_diameter, start_time)

    @classmethod
    def ecd(
        cls, speed: float, hub_height: float, rotor_diameter: float, sign: int = 1, start_time: float = 0.0
    ) -> "TransientInflow":
        """Extreme coherent gust with direction change; ``sign`` +1 turns counter-clockwise from above."""
        steady = _normal_profile(speed, hub_height)
        angle = _sign(sign) * coherent_gust_direction(speed)
        return cls(steady, "ECD", COHERENT_GUST_SPEED, angle, rotor_diameter, start_time)

    @classmethod
    def ews(
        cls, speed: float, hub_height: float, rotor_diameter: float, turbulence_class: str = "B",
        axis: str = "vertical", sign: int = 1, start_time: float = 0.0,
    ) -> "TransientInflow":  # fmt: skip
        """Extreme wind shear; ``sign`` +1 speeds up the top (``"vertical"``) or the left (``"horizontal"``, +y)."""
        steady = _normal_profile(speed, hub_height)
        amplitude = _sign(sign) * wind_shear_amplitude(speed, hub_height, rotor_diameter, turbulence_class)
        return cls(steady, f"EWS-{axis}", amplitude, 0.0, rotor_diameter, start_time)

    @property
    def description(self) -> str:
        """One line that tells a person what wind this is."""
        parts = [f"IEC {self.kind} at {self.start_time:g} s"]
        if self.speed_amplitude:
            parts.append(f"amplitude {self.speed_amplitude:.3g} m/s")
        if self.direction_amplitude:
            parts.append(f"turning {math.degrees(self.direction_amplitude):.3g} deg")
        return ", ".join(parts) + f", on {self.steady.description}"

    def _fill(self, rows: Array, time: float, out: Array) -> int:
        elapsed = self._elapsed(rows, time)
        none: float | Array = np.zeros(len(rows))
        changes = dict.fromkeys(("increment", "turn", "lateral", "vertical"), none)
        if self.kind == "EOG":
            changes["increment"] = operating_gust(elapsed, self.speed_amplitude)
        elif self.kind == "EDC":
            changes["turn"] = direction_change(elapsed, self.direction_amplitude)
        elif self.kind == "ECD":
            changes["increment"] = coherent_gust_speed(elapsed, self.speed_amplitude)
            changes["turn"] = coherent_gust_speed(elapsed, self.direction_amplitude)
        else:
            axis = "vertical" if self.kind == "EWS-vertical" else "lateral"
            changes[axis] = self.speed_amplitude / self.rotor_diameter * wind_shear_envelope(elapsed)
        steady = self.steady
        angles = steady.yaw_misalignment, steady.inclination
        reach = 0.5 * self.rotor_diameter
        return int(transient_velocity(rows, steady.kernel_profile, *angles, *changes.values(), reach, out))

    def _elapsed(self, rows: Array, time: float) -> Array:
        """Time since the transient began at each point [s], shape (n,)."""
        elapsed = np.full(len(rows), time - self.start_time)
        steady = self.steady
        if self.travels and steady.speed > 0.0:
            cos, sin = math.cos(steady.inclination), math.sin(steady.inclination)
            along = cos * math.cos(steady.yaw_misalignment), cos * math.sin(steady.yaw_misalignment), sin
            with np.errstate(invalid="ignore"):  # points that are not finite are found by the kernel
                elapsed -= ((rows - (0.0, 0.0, steady.hub_height)) @ along) / steady.speed
        return elapsed


def _normal_profile(speed: float, hub_height: float) -> SteadyInflow:
    require_number(speed, "speed", "m/s", *POSITIVE)
    return SteadyInflow(speed, hub_height, shear_exponent=NORMAL_SHEAR_EXPONENT)


def _sign(sign: int) -> int:
    if sign not in (1, -1):
        raise InflowError(f"sign must be +1 or -1; got {sign!r}")
    return sign
