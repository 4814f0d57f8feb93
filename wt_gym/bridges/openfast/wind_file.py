"""Any inflow of this package as a wind file of OpenFAST."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.base.errors import InflowError
from wt_gym.bridges.openfast.model_files import write_inflow
from wt_gym.wind import MirroredInflow, SteadyInflow, TurbulentInflow, bts

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from wt_gym.turbines import Turbine
    from wt_gym.wind import Inflow

__all__ = ["repeats", "sampled", "write_wind"]

_WIDTH = 1.3
"""Of the grid for an inflow that has none [rotor diameters]: the rotor with its deflection, and some air."""
_POINTS = 15
_STEP = 0.1
_STEADY_LENGTH = 10.0
_LEAD = 30.0
"""Record before time zero [s]: what is downwind of the origin was there before."""
_ALIGNED, _FINER = 1e-6, 8
_LEAST_HEIGHT = 0.5
"""Of the lowest points, down the tower [m]."""


def write_wind(inflow: Inflow, turbine: Turbine, folder: Path, duration: float, yaw: float = 0.0) -> Path:
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
    inflow : Inflow
    turbine : Turbine
    folder : Path
        Receives ``inflowwind.dat`` and ``wind.bts``.
    duration : float
        Of the simulation [s].
    yaw : float
        Of the nacelle at the start [rad]: the wind is read where the apex of the rotor is then.

    Returns
    -------
    Path
        Of the input file of InflowWind.

    Raises
    ------
    InflowError
        If there is no wind along x to carry the samples.
    """
    path, nacelle = folder / "inflowwind.dat", turbine.nacelle
    ahead = nacelle.overhang * math.cos(nacelle.tilt)
    read_at = {
        "WindVxiList": -ahead * math.cos(yaw),
        "WindVyiList": -ahead * math.sin(yaw),
        "WindVziList": turbine.hub_height,
    }
    steady = _power_law(inflow)
    if steady is not None:
        profile = {"HWindSpeed": steady.speed, "RefHt": steady.hub_height, "PLExp": steady.shear_exponent}
        write_inflow(path, {"WindType": 1, **profile, **read_at})
        return path
    bts.write(folder / "wind.bts", sampled(inflow, turbine, duration))
    write_inflow(path, {"WindType": 3, "FileName_BTS": "wind.bts", **read_at})
    return path


def repeats(inflow: Inflow) -> bool:
    """Whether the file of an inflow holds for any time: a steady wind, or turbulence that is periodic."""
    return _is_steady(inflow) or _period(inflow) is not None


def sampled(inflow: Inflow, turbine: Turbine, duration: float) -> bts.BtsContent:
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
    return bts.BtsContent(
        grid=grid, tower=velocity[:, z.size * y.size :], time_step=step, spacing_y=spacing_y, spacing_z=spacing_z,
        z_bottom=float(z[0]), mean_speed=speed, hub_height=float(inflow.hub_height), periodic=True,
        description=f"wt_gym: {inflow.description}"[:190].encode("ascii", "replace").decode(),
    )  # fmt: skip


def _power_law(inflow: Inflow) -> SteadyInflow | None:
    """A steady wind that OpenFAST has a formula for."""
    if isinstance(inflow, MirroredInflow):
        return _power_law(inflow.inner)
    if not isinstance(inflow, SteadyInflow):
        return None
    turned = inflow.veer or inflow.yaw_misalignment or inflow.inclination
    shaped = inflow.roughness_length is not None or inflow.jet_height is not None or inflow.shear_exponent < 0.0
    return None if turned or shaped else inflow


def _is_steady(inflow: Inflow) -> bool:
    if isinstance(inflow, MirroredInflow):
        return _is_steady(inflow.inner)
    return isinstance(inflow, SteadyInflow)


def _turbulent(inflow: Inflow) -> TurbulentInflow | None:
    """Turbulence as it is or within what turns or reflects it."""
    while not isinstance(inflow, TurbulentInflow):
        inner = getattr(inflow, "inner", None)
        if inner is None:
            return None
        inflow = inner
    return inflow


def _period(inflow: Inflow) -> float | None:
    """Time after which a wind repeats itself [s]."""
    if isinstance(inflow, MirroredInflow):
        return _period(inflow.inner)
    if isinstance(inflow, TurbulentInflow) and inflow.box.periodic:
        return inflow.box.duration
    return None


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
