"""Deterministic transients of IEC 61400-1: operating gust, direction change, coherent gust, extreme shear."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.base.errors import InflowError
from wt_gym.wind import iec
from wt_gym.wind.inflow_kernels import transient_velocity
from wt_gym.wind.protocol import PointInflow, require_number
from wt_gym.wind.steady import SteadyInflow

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["TransientInflow"]

_KINDS = ("EOG", "EDC", "ECD", "EWS-vertical", "EWS-horizontal")


@dataclass(frozen=True)
class TransientInflow(PointInflow):
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
        if not isinstance(self.steady, SteadyInflow):
            raise InflowError(f"steady must be a SteadyInflow; got {type(self.steady).__name__}")
        if self.kind not in _KINDS:
            raise InflowError(f"kind must be one of {', '.join(map(repr, _KINDS))}; got {self.kind!r}")
        require_number(self.speed_amplitude, "speed_amplitude", "m/s")
        require_number(self.direction_amplitude, "direction_amplitude", "rad", -math.pi, math.pi)
        require_number(self.rotor_diameter, "rotor_diameter", "m", 0.0, open_minimum=True)
        require_number(self.start_time, "start_time", "s")
        if not isinstance(self.travels, bool):
            raise InflowError(f"travels must be True or False; got {self.travels!r}")

    @classmethod
    def eog(
        cls,
        speed: float,
        hub_height: float,
        rotor_diameter: float,
        turbulence_class: str = "B",
        turbine_class: str = "I",
        start_time: float = 0.0,
    ) -> TransientInflow:
        """Extreme operating gust on the normal wind profile."""
        steady = _normal_profile(speed, hub_height)
        amplitude = iec.operating_gust_amplitude(speed, hub_height, rotor_diameter, turbulence_class, turbine_class)
        return cls(steady, "EOG", amplitude, 0.0, rotor_diameter, start_time)

    @classmethod
    def edc(
        cls,
        speed: float,
        hub_height: float,
        rotor_diameter: float,
        turbulence_class: str = "B",
        sign: int = 1,
        start_time: float = 0.0,
    ) -> TransientInflow:
        """Extreme direction change on the normal wind profile; ``sign`` +1 turns counter-clockwise from above."""
        steady = _normal_profile(speed, hub_height)
        angle = iec.direction_change_amplitude(speed, hub_height, rotor_diameter, turbulence_class)
        return cls(steady, "EDC", 0.0, _sign(sign) * angle, rotor_diameter, start_time)

    @classmethod
    def ecd(
        cls, speed: float, hub_height: float, rotor_diameter: float, sign: int = 1, start_time: float = 0.0
    ) -> TransientInflow:
        """Extreme coherent gust with direction change; ``sign`` +1 turns counter-clockwise from above."""
        steady = _normal_profile(speed, hub_height)
        angle = _sign(sign) * iec.coherent_gust_direction(speed)
        return cls(steady, "ECD", iec.COHERENT_GUST_SPEED, angle, rotor_diameter, start_time)

    @classmethod
    def ews(
        cls,
        speed: float,
        hub_height: float,
        rotor_diameter: float,
        turbulence_class: str = "B",
        axis: str = "vertical",
        sign: int = 1,
        start_time: float = 0.0,
    ) -> TransientInflow:
        """Extreme wind shear; ``sign`` +1 speeds up the top (``"vertical"``) or the left (``"horizontal"``, +y)."""
        steady = _normal_profile(speed, hub_height)
        amplitude = _sign(sign) * iec.wind_shear_amplitude(speed, hub_height, rotor_diameter, turbulence_class)
        return cls(steady, f"EWS-{axis}", amplitude, 0.0, rotor_diameter, start_time)

    @property
    def mean_speed(self) -> float:
        """Wind speed at hub height before the transient [m/s]."""
        return self.steady.speed

    @property
    def hub_height(self) -> float:
        """Hub height [m]."""
        return self.steady.hub_height

    @property
    def description(self) -> str:
        """One line that tells a person what wind this is."""
        parts = [f"IEC {self.kind} at {self.start_time:g} s"]
        if self.speed_amplitude:
            parts.append(f"amplitude {self.speed_amplitude:.3g} m/s")
        if self.direction_amplitude:
            parts.append(f"turning {math.degrees(self.direction_amplitude):.3g} deg")
        return ", ".join(parts) + f", on {self.steady.description}"

    def _fill(self, rows: NDArray[np.float64], time: float, out: NDArray[np.float64]) -> int:
        elapsed = self._elapsed(rows, time)
        none: float | NDArray[np.float64] = np.zeros(len(rows))
        changes = dict.fromkeys(("increment", "turn", "lateral", "vertical"), none)
        if self.kind == "EOG":
            changes["increment"] = iec.operating_gust(elapsed, self.speed_amplitude)
        elif self.kind == "EDC":
            changes["turn"] = iec.direction_change(elapsed, self.direction_amplitude)
        elif self.kind == "ECD":
            changes["increment"] = iec.coherent_gust_speed(elapsed, self.speed_amplitude)
            changes["turn"] = iec.coherent_gust_speed(elapsed, self.direction_amplitude)
        else:
            axis = "vertical" if self.kind == "EWS-vertical" else "lateral"
            changes[axis] = self.speed_amplitude / self.rotor_diameter * iec.wind_shear_envelope(elapsed)
        steady = self.steady
        angles = steady.yaw_misalignment, steady.inclination
        reach = 0.5 * self.rotor_diameter
        return int(transient_velocity(rows, steady.kernel_profile, *angles, *changes.values(), reach, out))

    def _elapsed(self, rows: NDArray[np.float64], time: float) -> NDArray[np.float64]:
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
    require_number(speed, "speed", "m/s", 0.0, open_minimum=True)
    return SteadyInflow(speed, hub_height, shear_exponent=iec.NORMAL_SHEAR_EXPONENT)


def _sign(sign: int) -> int:
    if sign not in (1, -1):
        raise InflowError(f"sign must be +1 or -1; got {sign!r}")
    return sign
