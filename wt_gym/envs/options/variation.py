"""Options of the variation: what of plant, sensors and wind differs from episode to episode."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from wt_gym.base.errors import InflowError, did_you_mean
from wt_gym.envs.arguments import check_names, real_number, real_numbers, shown
from wt_gym.envs.options.group import OptionGroup, option, option_group
from wt_gym.wind.iec import reference_intensity

__all__ = ["CHOICES", "HELD_BACK", "NO_SENSOR", "PRESETS", "RANGES", "STRUCTURAL", "TRAIN", "Variation"]

NO_SENSOR = ""
"""Among the sensors that may be dead: none is."""
STRUCTURAL = ("tower_frequency", "tower_damping", "blade_stiffness", "air_density", "drive_lag", "pitch_rate")
"""What makes another turbine of it: drawn from a finite set."""
MOST_PLANTS = 64


@dataclass(frozen=True)
class _Range:
    """Allowed values of a quantity."""

    low: float
    high: float
    unit: str = ""


RANGES = {
    "pitch_gain": _Range(0.2, 3.0),
    "tower_frequency": _Range(0.5, 2.0),
    "tower_damping": _Range(0.0, 10.0),
    "blade_stiffness": _Range(0.3, 3.0),
    "air_density": _Range(0.5, 2.0),
    "drive_lag": _Range(0.0, 5.0, "s"),
    "pitch_rate": _Range(0.1, 10.0),
    "sensor_delay": _Range(0.0, 10.0, "s"),
    "sensor_offset": _Range(-5.0, 5.0),
    "sensor_noise": _Range(0.0, 20.0),
    "shear_exponent": _Range(-0.5, 1.0),
    "yaw_error": _Range(-math.pi / 2, math.pi / 2, "rad"),
}
"""Quantities drawn from a range."""
CHOICES = ("turbulence_class", "dead_sensor")
"""Quantities drawn from a list of names."""

_KIND = "float or (float, float), optional"


def _range(name: str, meaning: str, unit: str = "-") -> Any:
    allowed = RANGES[name]
    return option(
        _KIND, meaning, default=None, flat=f"vary_{name}", unit=unit, allowed=f"{allowed.low:.4g} to {allowed.high:.4g}"
    )


@option_group
class Variation(OptionGroup):
    """What of plant, sensors and wind differs from episode to episode, see `wt_gym.envs.variation`."""

    title = "variation"

    pitch_gain: float | Sequence[float] | None = _range(
        "pitch_gain",
        "Factor on the response of the turbine to pitch: blades move by this factor times the deviation of their "
        "demand from the mean of the last 10 s, and the encoders read the demand, see `wt_gym.envs.pitch_gain`",
    )
    tower_frequency: float | Sequence[float] | None = _range(
        "tower_frequency", "Factor on the frequencies of the tower (`wt_gym.envs.varied_turbine`)"
    )
    tower_damping: float | Sequence[float] | None = _range(
        "tower_damping", "Factor on the damping ratio of the tower's modes"
    )
    blade_stiffness: float | Sequence[float] | None = _range(
        "blade_stiffness", "Factor on the stiffness of the blades' sections"
    )
    air_density: float | Sequence[float] | None = _range("air_density", "Factor on the density of the air")
    drive_lag: float | Sequence[float] | None = _range("drive_lag", "Additional lag of the pitch drives", "s")
    pitch_rate: float | Sequence[float] | None = _range("pitch_rate", "Factor on the greatest pitch rate")
    sensor_delay: float | Sequence[float] | None = _range(
        "sensor_delay", "Time by which readings are late, rounded to steps of the simulator", "s"
    )
    sensor_offset: float | Sequence[float] | None = _range(
        "sensor_offset",
        "Offset of every load, motion and wind sensor in scales of its channel, drawn for each sensor by itself; the "
        "blades share theirs. Encoders and electrical readings have none (`wt_gym.envs.instruments`)",
    )
    sensor_noise: float | Sequence[float] | None = _range(
        "sensor_noise", "Level of white measurement noise of every sensor: 1 typical instruments"
    )
    turbulence_class: Sequence[str] | None = option(
        "sequence of str, optional",
        "Turbulence classes of IEC 61400-1 to draw from",
        default=None,
        flat="vary_turbulence_class",
        allowed='of "A+", "A", "B" and "C"',
    )
    shear_exponent: float | Sequence[float] | None = _range("shear_exponent", "Exponent of the power-law profile")
    yaw_error: float | Sequence[float] | None = _range(
        "yaw_error", "Direction by which the wind is turned against the nacelle, on top of ``wind.direction``", "rad"
    )
    dead_sensor: Sequence[str] | None = option(
        "sequence of str, optional",
        f'Channels of the simulator: one is drawn and reads zero in the episode; "{NO_SENSOR}": all are sound',
        default=None,
        flat="vary_dead_sensor",
    )
    plants: int = option(
        "int",
        "Number of turbines in the set that the structural quantities are drawn from: a Latin hypercube over their "
        "ranges, the same in every environment",
        default=8,
        flat="vary_plants",
        allowed=f"1 to {MOST_PLANTS}",
    )

    def check(self) -> None:
        """Refuse what has no meaning."""
        for name, allowed in RANGES.items():
            value = getattr(self, name)
            if value is not None:
                self._set(name, _checked_range(f"vary_{name}", value, allowed))
        for name in CHOICES:
            value = getattr(self, name)
            if value is None:
                continue
            names = check_names(f"vary_{name}", (value,) if isinstance(value, str) else value)
            if not names or len(set(names)) < len(names):
                raise ValueError(f"vary_{name} must have names, each once, got {shown(names)}")
            self._set(name, names)
        for name in self.turbulence_class or ():
            try:
                reference_intensity(name)
            except InflowError as error:
                raise InflowError(f"vary_{error}") from error
        plants = real_number(self.plants)
        if plants is None or not 1 <= plants <= MOST_PLANTS or plants != math.floor(plants):
            raise ValueError(f"vary_plants must be a whole number from 1 to {MOST_PLANTS}, got {shown(self.plants)}")
        self._set("plants", int(plants))

    @property
    def varies(self) -> tuple[str, ...]:
        """Names of the quantities that are given, those of the set of plants first."""
        order = (*STRUCTURAL, *(name for name in (*RANGES, *CHOICES) if name not in STRUCTURAL))
        return tuple(name for name in order if getattr(self, name) is not None)

    def ends(self, name: str) -> tuple[float, float] | None:
        """Lower and upper end of the range of a quantity, None where it is not given."""
        value = getattr(self, name)
        return (value, value) if isinstance(value, float) else value

    @classmethod
    def named(cls, values: Any) -> Mapping[str, Any]:
        """Values by names of fields; the name of one of `PRESETS` stands for its values.

        Raises
        ------
        ValueError
            If there is no such preset or field.
        """
        if not isinstance(values, str):
            return super().named(values)
        if values not in PRESETS:
            raise ValueError(
                f"variation must be a Variation, a mapping or one of {', '.join(PRESETS)}, got {values!r:.100}"
                f"{did_you_mean(values, PRESETS)}"
            )
        return PRESETS[values].given


def _checked_range(name: str, value: Any, allowed: _Range) -> float | tuple[float, float]:
    """Return what is drawn from: a fixed value, or lower and upper end."""
    ends = real_numbers(value)
    unit = f" {allowed.unit}" if allowed.unit else ""
    inside = len(ends) in (1, 2) and all(allowed.low <= end <= allowed.high for end in ends) and ends[0] <= ends[-1]
    if not inside:
        raise ValueError(
            f"{name} must be a number or a range (low, high) within {allowed.low:.4g} to {allowed.high:.4g}{unit}, got "
            f"{shown(value)}"
        )
    return ends[0] if len(ends) == 1 else (ends[0], ends[1])


_DEGREE = math.pi / 180.0

TRAIN = Variation(
    pitch_gain=(0.75, 1.25),
    tower_frequency=(0.93, 1.07),
    tower_damping=(0.5, 2.0),
    blade_stiffness=(0.9, 1.15),
    air_density=(0.93, 1.05),
    drive_lag=(0.0, 0.3),
    pitch_rate=(0.7, 1.0),
    sensor_delay=(0.0, 0.2),
    sensor_offset=(-0.4, 0.4),
    sensor_noise=(0.0, 1.0),
    turbulence_class=("A", "B", "C"),
    shear_exponent=(-0.1, 0.3),
    yaw_error=(-15.0 * _DEGREE, 15.0 * _DEGREE),
)
"""Ranges for training."""
HELD_BACK = Variation(
    pitch_gain=(1.25, 1.4),
    tower_frequency=(1.07, 1.14),
    tower_damping=(0.3, 0.5),
    blade_stiffness=(0.8, 0.9),
    air_density=(0.85, 0.93),
    drive_lag=(0.3, 0.5),
    pitch_rate=(0.5, 0.7),
    sensor_delay=(0.2, 0.4),
    sensor_offset=(0.4, 0.6),
    sensor_noise=(1.0, 2.0),
    turbulence_class=("A+",),
    shear_exponent=(0.3, 0.4),
    yaw_error=(15.0 * _DEGREE, 20.0 * _DEGREE),
)
"""Ranges held back for tests: of every quantity an interval beyond that of `TRAIN`, with which it shares an end."""
PRESETS: dict[str, Variation] = {"train": TRAIN, "held_back": HELD_BACK}
"""Variations by name."""
