"""Winds that carry a box of turbulence along: what arrives at the rotor, and what a lidar sees ahead of it."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING

from wt_gym.wind.evolution import evolved_boxes
from wt_gym.wind.protocol import PointInflow

if TYPE_CHECKING:
    from typing import Any

    import numpy as np
    from numpy.typing import NDArray

    from wt_gym.wind.turbulence_box import TurbulenceBox

__all__ = ["CarriedInflow"]


class CarriedInflow(PointInflow):
    """Base of winds with a box, whose fields ahead of the rotor are made when they are first seen.

    Attributes
    ----------
    box : TurbulenceBox or None
    """

    box: TurbulenceBox | None
    _evolved: dict[tuple[float, ...], tuple[TurbulenceBox, ...]]

    @abstractmethod
    def _fill_from(self, box: Any, rows: NDArray[np.float64], time: float, out: NDArray[np.float64]) -> int:
        """Fill in the wind with a box in place of that of the rotor; the first row that is not finite, or -1."""

    def __getstate__(self) -> dict[str, Any]:
        """What a copy or a pickle takes along: the field ahead is remade."""
        return {**self.__dict__, "_evolved": {}}

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            object.__setattr__(self, name, value)

    def _fill(self, rows: NDArray[np.float64], time: float, out: NDArray[np.float64]) -> int:
        return self._fill_from(self.box, rows, time, out)

    def _fill_ahead(
        self, gates: NDArray[np.float64], time: float, distances: tuple[float, ...], out: NDArray[np.float64]
    ) -> int:
        if self.box is None:
            return super()._fill_ahead(gates, time, distances, out)
        if distances not in self._evolved:
            self._evolved[distances] = evolved_boxes(self.box, distances)
        before = 0
        for rows, box, seen in zip(gates, self._evolved[distances], out, strict=True):
            bad = self._fill_from(box, rows, time, seen)
            if bad >= 0:
                return before + bad
            before += len(rows)
        return -1
