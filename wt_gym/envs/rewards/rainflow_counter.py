"""Rainflow counting of a load while it comes in."""

from __future__ import annotations

import itertools

__all__ = ["RainflowCounter"]


class RainflowCounter:
    """Damage of a load by rainflow cycles, after every sample exactly that of the history so far.

    Counting follows ASTM E1049-85, section 5.4.4: of the last three turning points the older range Y is counted as soon
    as the newer range X reaches it, as a half cycle where Y holds the start of the history, as a full one elsewhere;
    what is left at the end counts as half cycles. The present sample stands for a turning point, which decides nothing
    too early, because the range that ends in it can only grow before it turns. Damage never falls: a range that X just
    reaches has the same damage in the residue, as two halves, as it has when counted.

    Parameters
    ----------
    exponent : float
        Woehler exponent m [-].
    scale : float
        Range that counts as 1, in the unit of the load.

    Attributes
    ----------
    closed : float
        Sum of n_i (S_i / scale)^m over the counted cycles [-].
    turning_points : list of float
        Residue, the present sample last.
    """

    def __init__(self, exponent: float, scale: float = 1.0):
        if not (exponent > 0.0 and scale > 0.0):
            raise ValueError(f"exponent and scale must be positive, got {exponent!r} and {scale!r}")
        self.exponent, self.scale = float(exponent), float(scale)
        self.closed = 0.0
        self.turning_points: list[float] = []

    def add(self, value: float) -> None:
        """Take the next sample."""
        points = self.turning_points
        if points and value == points[-1]:
            return
        if len(points) >= 2 and (value > points[-1]) == (points[-1] > points[-2]):
            points[-1] = value
        else:
            points.append(value)
        while len(points) >= 3:
            older, newer = abs(points[-2] - points[-3]), abs(points[-1] - points[-2])
            if newer < older:
                break
            if len(points) == 3:
                self.closed += 0.5 * self._damage(older)
                del points[0]
            else:
                self.closed += self._damage(older)
                del points[-3:-1]

    @property
    def damage(self) -> float:
        """Sum of n_i (S_i / scale)^m over counted cycles and the half cycles of the residue [-]."""
        points = self.turning_points
        return self.closed + 0.5 * sum(self._damage(abs(b - a)) for a, b in itertools.pairwise(points))

    def equivalent_load(self, duration: float) -> float:
        """Damage-equivalent load at 1 Hz over a duration [s], in the unit of the load."""
        if not duration > 0.0:
            raise ValueError(f"duration must be positive, got {duration!r} s")
        return float(self.scale * (self.damage / duration) ** (1.0 / self.exponent))

    def _damage(self, span: float) -> float:
        """Damage of one full cycle [-]."""
        return float((span / self.scale) ** self.exponent)
