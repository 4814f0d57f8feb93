"""The lidar of OpenFAST's InflowWind: what of a lidar of this package it can read, and its input.

InflowWind (5.0, ``Lidar.f90``) has three sensors. Single points (``SensorType`` 1) are up to five anywhere, of one
gate; each gives the magnitude of the wind there. A continuous-wave lidar (2) has one beam and one point, a pulsed
one (3) one beam along x with up to five gates. All are fixed in the global frame, whatever the nacelle's heading, in
turbulence that does not change on its way. ServoDyn hands speeds and points to the controller library in the records
from 2001 on. Single points are taken here: they alone lie across the rotor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.control.sensors import Lidar

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.wind import Inflow

__all__ = ["MOST_POINTS", "PointLidar"]

MOST_POINTS = 5
"""Single points that InflowWind reads."""
_DIGITS = 9
"""Of places in m: a cosine of a quarter turn is 0."""


@dataclass(frozen=True)
class PointLidar(Lidar):
    """A lidar as InflowWind reads it: magnitudes of the wind at no more than five points, which do not yaw.

    All points of a lidar with no more than five. Of others each gate keeps some, the farther ones more: one on the
    axis, two on opposite sides, level and upright in turn, three and more around.

    Parameters
    ----------
    ranges, half_angle, n_beams, frozen, apart
        As of `wt_gym.control.Lidar`; the wind does not change on its way in any case.

    Raises
    ------
    ValueError
        For more than five gates, or more than five beams apart.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.ranges) > MOST_POINTS:
            raise ValueError(
                f"a lidar in OpenFAST must have at most {MOST_POINTS} gates, as many points as InflowWind reads; got "
                f"{len(self.ranges)}"
            )
        if self.apart and not self.whole:
            raise ValueError(
                f"a lidar in OpenFAST must have at most {MOST_POINTS} beams over all gates where they are apart, as "
                f"many as the points that InflowWind reads; got {self.n_readings}"
            )

    @classmethod
    def of(cls, lidar: Lidar) -> PointLidar:
        """What InflowWind can read of a lidar."""
        return cls(lidar.ranges, lidar.half_angle, lidar.n_beams, lidar.frozen, lidar.apart)

    @property
    def whole(self) -> bool:
        """Whether all points are read."""
        return len(self.ranges) * self.n_beams <= MOST_POINTS

    @cached_property
    def points(self) -> NDArray[np.float64]:
        """Places from the tower axis at hub height, gate after gate [m], shape (n_points, 3)."""
        return np.concatenate(self._by_gate)

    @cached_property
    def _by_gate(self) -> tuple[NDArray[np.float64], ...]:
        """Places of the points of each gate."""
        n, spread = len(self.ranges), math.tan(self.half_angle)
        places = []
        for gate, distance in enumerate(self.ranges):
            count = self.n_beams if self.whole else MOST_POINTS // n + (gate >= n - MOST_POINTS % n)
            angle = 2.0 * math.pi * np.arange(count) / count
            if not self.whole and count == 2 and gate % 2:
                angle = angle + 0.5 * math.pi
            aside = 0.0 if count == 1 and not self.whole else spread
            level, up = self.sides() if self.apart else (aside * np.sin(angle), aside * np.cos(angle))
            row = (np.full(count, -1.0), level, up)
            places.append((distance * np.array(row).T).round(_DIGITS) + 0.0)
        return tuple(places)

    def read(
        self, inflow: Inflow, time: float, yaw: float, height: float, rotation: str = "clockwise"
    ) -> NDArray[np.float64]:
        """Measure: magnitude of the wind, of each beam or mean over the points of a gate, shape (n_readings,) [m/s].

        Parameters
        ----------
        inflow : Inflow
        time : float
            [s]
        yaw : float
            Of the nacelle, with which these points do not turn [rad].
        height : float
            Of the hub [m].
        rotation : {"clockwise", "counter-clockwise"}
            Of the rotor, by which beams apart are counted.
        """
        velocity = np.asarray(inflow.velocity(self.points + np.array([0.0, 0.0, height]), time))
        speeds, ends = np.linalg.norm(velocity, axis=-1), np.cumsum([len(places) for places in self._by_gate])
        if self.apart:
            by_gate: NDArray[np.float64] = speeds.reshape(len(self.ranges), self.n_beams)
            return by_gate[:, self._beam_order(rotation)].ravel()
        return np.array([part.mean() for part in np.split(speeds, ends[:-1])])

    def inputs(self, hub: tuple[float, float, float], height: float, interval: float) -> dict[str, object]:
        """Values of InflowWind's keywords.

        Parameters
        ----------
        hub : (float, float, float)
            Apex of the rotor, from which OpenFAST counts [m].
        height : float
            Of the hub [m], at which the tip of the cone is on the tower axis.
        interval : float
            Between readings [s].
        """
        x, y, z = (column.tolist() for column in self.points.T)
        return {
            "SensorType": 1, "NumPulseGate": 1, "NumBeam": len(x), "FocalDistanceX": x, "FocalDistanceY": y,
            "FocalDistanceZ": z, "RotorApexOffsetPos": [-hub[0], -hub[1], height - hub[2]],
            "MeasurementInterval": interval, "LidRadialVel": False, "ConsiderHubMotion": 0,
        }  # fmt: skip
