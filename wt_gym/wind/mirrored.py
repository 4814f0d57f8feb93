"""A wind seen in a mirror: any inflow reflected at the vertical plane y = 0."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.wind.protocol import Inflow, WrappedInflow, fill_velocity, read_only, velocity_ahead

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["MirroredInflow"]

_REFLECTION = np.array([1.0, -1.0, 1.0])


@dataclass(frozen=True)
class MirroredInflow(WrappedInflow):
    """The mirror image of another inflow at the plane y = 0.

    With S = diag(1, -1, 1) the wind at a point x is S u(S x, t): what blew to the left blows to the right, and
    direction, veer, horizontal shear, gusts and turbulence change sides. Both reflections are exact in floating-point
    numbers, so that the image of the image is the inner inflow bit for bit.

    Parameters
    ----------
    inner : Inflow
    """

    @classmethod
    def of(cls, inflow: Inflow) -> Inflow:
        """Return the mirror image of an inflow, of a mirror image what is seen in it."""
        return inflow.inner if isinstance(inflow, cls) else cls(inflow)

    @property
    def description(self) -> str:
        """One line that tells a person what wind this is."""
        return f"{self.inner.description}, mirrored"

    def _fill(self, rows: NDArray[np.float64], time: float, out: NDArray[np.float64]) -> int:
        fill_velocity(self.inner, read_only(rows * _REFLECTION), time, out)
        out[:, 1] *= -1.0
        return -1

    def _fill_ahead(
        self, gates: NDArray[np.float64], time: float, distances: tuple[float, ...], out: NDArray[np.float64]
    ) -> int:
        np.multiply(velocity_ahead(self.inner, gates * _REFLECTION, time, distances), _REFLECTION, out=out)
        return -1
