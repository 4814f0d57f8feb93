"""Options of the variation: what of plant, sensors and wind differs from episode to episode."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from wt_gym.base.errors import did_you_mean
from wt_gym.base.options import Options, as_tuple, not_empty, option, option_record, options_of
from wt_gym.wind.iec import REFERENCE_INTENSITY

__all__ = ["CHOICES", "HELD_BACK", "NO_SENSOR", "PRESETS", "RANGES", "STRUCTURAL", "TRAIN", "Variation"]

NO_SENSOR = ""
"""Among the sensors that may be dead: none is."""
STRUCTURAL = ("tower_frequency", "tower_damping", "blade_stiffness", "air_density", "drive_lag", "pitch_rate")
"""What makes another turbine of it: drawn from a finite set."""


def _range(name: str, meaning: str, low: float, high: float, unit: str = "-") -> Any:
    return option(meaning, default=None, flat=f"vary_{name}", unit=unit, low=low, high=high)


def _names(name: str, meaning: str, choices: tuple[str, ...] = ()) -> Any:
    def check(names: str | tuple[str, ...]) -> tuple[str, ...]:
        return not_empty(as_tuple(names))

    return option(meaning, default=None, flat=f"vary_{name}", choices=choices, check=check)


@option_record
class Variation(Options):
    """Quantities of plant, sensors and wind that differ from episode to episode, see `wt_gym.envs.variation`."""

    title = "variation"

    pitch_gain: float | tuple[float, float] | None = _range(
        "pitch_gain",
        "Factor on the response of the turbine to pitch: blades move by this factor times the deviation of their "
        "demand from the mean of the last 10 s, and the encoders read the demand, see `wt_gym.envs.pitch_gain`",
        0.2, 3.0,
    )  # fmt: skip
    tower_frequency: float | tuple[float, float] | None = _range(
        "tower_frequency", "Factor on the frequencies of the tower (`wt_gym.envs.varied_turbine`)", 0.5, 2.0
    )
    tower_damping: float | tuple[float, float] | None = _range(
        "tower_damping", "Factor on the damping ratio of the tower's modes", 0.0, 10.0
    )
    blade_stiffness: float | tuple[float, float] | None = _range(
        "blade_stiffness", "Factor on the stiffness of the blades' sections", 0.3, 3.0
    )
    air_density: float | tuple[float, float] | None = _range(
        "air_density", "Factor on the density of the air", 0.5, 2.0
    )
    drive_lag: float | tuple[float, float] | None = _range(
        "drive_lag", "Additional lag of the pitch drives", 0.0, 5.0, "s"
    )
    pitch_rate: float | tuple[float, float] | None = _range(
        "pitch_rate", "Factor on the greatest pitch rate", 0.1, 10.0
    )
    sensor_delay: float | tuple[float, float] | None = _range(
        "sensor_delay", "Time by which readings are late, rounded to steps of the simulator", 0.0, 10.0, "s"
    )
    sensor_offset: float | tuple[float, float] | None = _range(
        "sensor_offset",
        "Offset of every load, motion and wind sensor in scales of its channel, drawn for each sensor by itself; the "
        "blades share theirs. Encoders and electrical readings have none (`wt_gym.envs.instruments`)",
        -5.0, 5.0,
    )  # fmt: skip
    sensor_noise: float | tuple[float, float] | None = _range(
        "sensor_noise", "Level of white measurement noise of every sensor: 1 typical instruments", 0.0, 20.0
    )
    turbulence_class: str | tuple[str, ...] | None = _names(
        "turbulence_class", "Turbulence classes of IEC 61400-1 to draw from", tuple(REFERENCE_INTENSITY)
    )
    shear_exponent: float | tuple[float, float] | None = _range(
        "shear_exponent", "Exponent of the power-law profile", -0.5, 1.0
    )
    yaw_error: float | tuple[float, float] | None = _range(
        "yaw_error", "Direction by which the wind is turned against the nacelle, on top of ``wind.direction``",
        -math.pi / 2, math.pi / 2, "rad",
    )  # fmt: skip
    dead_sensor: str | tuple[str, ...] | None = _names(
        "dead_sensor",
        f'Channels of the simulator: one is drawn and reads zero in the episode; "{NO_SENSOR}": all are sound',
    )
    plants: int = option(
        "Number of turbines in the set that the structural quantities are drawn from: a Latin hypercube over their "
        "ranges, the same in every environment",
        default=8,
        flat="vary_plants",
        low=1,
        high=64,
    )

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


CHOICES = ("turbulence_class", "dead_sensor")
"""Quantities drawn from a list of names."""
RANGES = {one.name: one for one in options_of(Variation) if one.name not in (*CHOICES, "plants")}
"""Quantities drawn from a range."""
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
