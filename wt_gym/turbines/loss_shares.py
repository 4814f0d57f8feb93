"""What the losses of a generator with its converter consist of, and how slow its torque may be.

See `wt_gym.turbines.electrical`.
"""

from __future__ import annotations

from dataclasses import dataclass

from wt_gym.turbines.checks import check_number, fail

__all__ = ["LONGEST_LAG", "LossShares"]

LONGEST_LAG = 2.0
"""Of a generator torque [s]."""


@dataclass(frozen=True)
class LossShares:
    """What the losses of generator and converter consist of at rated operation.

    Attributes
    ----------
    copper, iron, converter : float
        c, i and k; their sum is 1 [-].
    """

    copper: float = 0.45
    iron: float = 0.15
    converter: float = 0.4

    def __post_init__(self) -> None:
        for name in ("copper", "iron", "converter"):
            check_number(f"LossShares.{name}", getattr(self, name), 0.0, 1.0)
        if abs(self.copper + self.iron + self.converter - 1.0) > 1e-9:
            raise fail("LossShares", self, "shares whose sum is 1")
