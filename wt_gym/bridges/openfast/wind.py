"""Winds and lidars of this package for OpenFAST: any inflow as a wind file, and what InflowWind reads of a lidar.

InflowWind (5.0, ``Lidar.f90``) has three sensors. Single points (``SensorType`` 1) are up to five anywhere, of one
gate; each gives the magnitude of the wind there. A continuous-wave lidar (2) has one beam and one point, a pulsed
one (3) one beam along x with up to five gates. All are fixed in the global frame, whatever the nacelle's heading, in
turbulence that does not change on its way. ServoDyn hands speeds and points to the controller library in the records
from 2001 on. Single points are taken here: they alone lie across the rotor.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wt_gym.base.errors import InflowError
from wt_gym.base.quantities import Array
from wt_gym.bridges.openfast.model import write_inflow
from wt_gym.control.sensors import Lidar
from wt_gym.turbines import Turbine
from wt_gym.wind import Inflow, MirroredInflow, SteadyInflow, TurbulentInflow
from wt_gym.wind.files import BtsContent

_WIDTH = 1.3  # Of the grid for an inflow that has none [rotor diameters]: the rotor with its deflection, and some air
_POINTS = 15
_STEP = 0.1
_STEADY_LENGTH = 10.0
_LEAD = 30.0  # Record before time zero [s]: what is downwind of the origin was there before
_ALIGNED, _FINER = 1e-6, 8
_LEAST_HEIGHT = 0.5  # Of the lowest points, down the tower [m]


def write_wind(inflow: Inflow, turbine: Turbine, folder: Path, duration: float) -> Path:
    """Write the input file of InflowWind for an inflow, with a TurbSim file (``.bts``) where OpenFAST has no formula.

    A power-law profile along x is OpenFAST's own steady wind. All else is sampled on a grid at x = 0: turbulence at the
    points and instants of its box, so that OpenFAST's interpolation meets the same samples; others on a grid of 15 × 15
    points ten times a second. OpenFAST carries the samples along x with the mean speed, as the turbulence here is; what
    changes everywhere at once, as a gust, comes later by the distance from x = 0.

    The file is marked as periodic in any case, since OpenFAST lets other files begin half a grid width early. A record
    that is not, lasts for ``duration`` and holds its last sample for half a minute, followed by the half minute before
    time zero.

    Parameters
    ----------
    folder : Path
        Receives ``inflowwind.dat`` and ``wind.bts``.
    duration : float
        Of the simulation [s].

    Returns
    -------
    Path
        Of the input file of InflowWind.

    Raises
    ------
    InflowError
        If there is no wind along x to carry the samples.
    """
    path, steady = folder / "inflowwind.dat", _power_law(inflow)
    if steady is not None:
        profile = {"HWindSpeed": steady.speed, "RefHt": steady.hub_height, "PLExp": steady.shear_exponent}
        write_inflow(path, {"WindType": 1, **profile})
        return path
    sampled(inflow, turbine, duration).write(folder / "wind.bts")
    write_inflow(path, {"WindType": 3, "FileName_BTS": "wind.bts"})
    return path


def repeats(inflow: Inflow) -> bool:
    """Whether the file of an inflow holds for any time: a steady wind, or turbulence that is periodic."""
    return _is_steady(inflow) or _period(inflow) is not None


def sampled(inflow: Inflow, turbine: Turbine, duration: float) -> BtsContent:
    """Velocities of an inflow on a grid across the rotor, as `write_wind` describes."""
    speed = float(inflow.mean_speed)
    if not speed > 0.0:
        raise InflowError(f"a wind file for OpenFAST needs a mean speed above 0 m/s; got {speed:g} ({inflow})")
    y, z, step, length = _grid(inflow, turbine, duration)
    spacing_y, spacing_z = y[1] - y[0], z[1] - z[0]
    below = z[0] - spacing_z * np.arange(1, math.ceil(max(z[0], spacing_z) / spacing_z) + 1)  # the last in the ground
    points = np.zeros((z.size * y.size + below.size, 3))
    rows = points[: z.size * y.size].reshape(z.size, y.size, 3)
    rows[..., 1], rows[..., 2] = y, z[:, None]
    points[z.size * y.size :, 2] = below
    count = round(length / step)
    times = np.arange(count) * step
    if not repeats(inflow):
        # what is upwind of the origin at the end is read behind it
        times = np.where(times > duration + _LEAD, times - count * step, np.minimum(times, duration))
    velocity = np.empty((count, len(points), 3), dtype=np.float32)
    for k, time in enumerate(times):
        velocity[k] = inflow.velocity(points, float(time))
    grid = velocity[:, : z.size * y.size].reshape(count, z.size, y.size, 3)
    return BtsContent(
        grid=grid, tower=velocity[:, z.size * y.size :], time_step=step, spacing_y=spacing_y, spacing_z=spacing_z,
        z_bottom=float(z[0]), mean_speed=speed, hub_height=float(inflow.hub_height), periodic=True,
        description=f"wt_gym: {inflow.description}"[:190].encode("ascii", "replace").decode(),
    )  # fmt: skip


def _power_law(inflow: Inflow) -> SteadyInflow | None:
    """A steady wind that OpenFAST has a formula for."""
    inflow = _unmirrored(inflow)
    if not isinstance(inflow, SteadyInflow):
        return None
    turned = inflow.veer or inflow.yaw_misalignment or inflow.inclination
    shaped = inflow.roughness_length is not None or inflow.jet_height is not None or inflow.shear_exponent < 0.0
    return None if turned or shaped else inflow


def _unmirrored(inflow: Inflow) -> Inflow:
    while isinstance(inflow, MirroredInflow):
        inflow = inflow.inner
    return inflow


def _is_steady(inflow: Inflow) -> bool:
    return isinstance(_unmirrored(inflow), SteadyInflow)


def _turbulent(inflow: Inflow | None) -> TurbulentInflow | None:
    """Turbulence as it is or within what turns or reflects it."""
    while not (inflow is None or isinstance(inflow, TurbulentInflow)):
        inflow = getattr(inflow, "inner", None)
    return inflow


def _period(inflow: Inflow) -> float | None:
    """Time after which a wind repeats itself [s]."""
    inflow = _unmirrored(inflow)
    return inflow.box.duration if isinstance(inflow, TurbulentInflow) and inflow.box.periodic else None


def _grid(
    inflow: Inflow, turbine: Turbine, duration: float
) -> tuple[NDArray[np.floating[Any]], NDArray[np.floating[Any]], float, float]:
    """Points across and upwards [m], time step and length of the record [s]."""
    turbulent, period = _turbulent(inflow), _period(inflow)
    if turbulent is not None and turbulent.box.y_center == 0.0:
        box = turbulent.box
        _, n_z, n_y, _ = box.fluctuation.shape
        y = (np.arange(n_y) - 0.5 * (n_y - 1)) * box.spacing_y
        z = box.z_bottom + np.arange(n_z) * box.spacing_z
        step = box.time_step
        late = (turbulent.time_offset / step) % 1.0
        if min(late, 1.0 - late) > _ALIGNED:  # instants between the samples: close ones, so that their peaks stay
            step /= _FINER
    else:
        half = 0.5 * _WIDTH * turbine.rotor_diameter
        y = np.linspace(-half, half, _POINTS)
        z = np.linspace(_LEAST_HEIGHT, turbine.hub_height + half, _POINTS)
        step = _STEP
    if _is_steady(inflow):
        return y, z, step, _STEADY_LENGTH
    if period is not None:
        return y, z, step, period
    return y, z, step, step * math.ceil((duration + 2.0 * _LEAD) / step)


MOST_POINTS = 5
"""Single points that InflowWind reads."""
_DIGITS = 9  # Of places in m: a cosine of a quarter turn is 0


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
    def of(cls, lidar: Lidar) -> "PointLidar":
        """What InflowWind can read of a lidar."""
        return cls(lidar.ranges, lidar.half_angle, lidar.n_beams, lidar.frozen, lidar.apart)

    @property
    def whole(self) -> bool:
        """Whether all points are read."""
        return len(self.ranges) * self.n_beams <= MOST_POINTS

    @cached_property
    def points(self) -> Array:
        """Places from the tower axis at hub height, gate after gate [m], shape (n_points, 3)."""
        return np.concatenate(self._by_gate)

    @cached_property
    def _by_gate(self) -> tuple[Array, ...]:
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

    def read(self, inflow: Inflow, time: float, yaw: float, height: float, rotation: str = "clockwise") -> Array:
        """Measure: magnitude of the wind, of each beam or mean over the points of a gate, shape (n_readings,) [m/s].

        Parameters
        ----------
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
            by_gate: Array = speeds.reshape(len(self.ranges), self.n_beams)
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
