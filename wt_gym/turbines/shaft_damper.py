"""Damper of the shaft's torsion, as a record; `wt_gym.turbines.shaft_damping` makes one for a turbine."""

from __future__ import annotations

from dataclasses import dataclass

from wt_gym.turbines.checks import check_number

__all__ = ["STRONGEST", "ShaftDamper"]

STRONGEST = 0.2
"""Damping ratio that a converter may add [-]."""
_BIG = 1e15


@dataclass(frozen=True)
class ShaftDamper:
    """What the converter does against the torsion of the shaft.

    Attributes
    ----------
    coefficient : float
        c, torque over speed on the low-speed shaft [N m s/rad].
    frequency : float
        omega, of rotor and generator against each other [rad/s].
    """

    coefficient: float
    frequency: float

    def __post_init__(self) -> None:
        for name in ("coefficient", "frequency"):
            check_number(f"ShaftDamper.{name}", getattr(self, name), 0.0, _BIG, open_low=True)
