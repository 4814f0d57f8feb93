"""Boxes of Mann's turbulence in the formats of HAWC2 and hipersim.

HAWC2 keeps each of u, v and w in a file of float32 numbers, little-endian, without header, of shape (n_x, n_y, n_z),
the last index fastest. x points downwind: the first plane meets the rotor last. y points to the left looking downwind,
z upwards; u, v and w are along x, y and z. hipersim documents these directions for its arrays, which it writes to such
files and to netCDF (`MannTurbulenceField.to_xarray`, `to_hawc2`). They are ours except for the order of the planes.
OpenFAST's reader takes the first plane as the one that arrives first and the first column as the leftmost one: there
the same file gives a field that is reversed along x and y.

The boxes hold no mean wind: they are carried along at a given mean speed on a mean profile.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.base.errors import InflowError
from wt_gym.wind.protocol import require_number
from wt_gym.wind.turbulence_box import TurbulenceBox

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

__all__ = ["read_hawc2", "read_hipersim", "write_hawc2"]

_FASTEST = 200.0  # m/s; what is above is damage, another number of points or another unit
_DIMS = ("uvw", "x", "y", "z")


def read_hawc2(
    files: Sequence[str | os.PathLike[str]],
    shape: tuple[int, int, int],
    spacing: tuple[float, float, float],
    mean_speed: float,
    hub_height: float,
    *,
    factors: tuple[float, float, float] = (1.0, 1.0, 1.0),
    y_center: float = 0.0,
    z_center: float | None = None,
) -> TurbulenceBox:
    """Read a box of three files.

    Parameters
    ----------
    files
        Of u, v and w.
    shape
        Numbers of points (n_x, n_y, n_z).
    spacing
        Distances of points (dx, dy, dz) [m].
    mean_speed
        With which the box is carried along [m/s].
    hub_height
        [m]
    factors
        By which u, v and w are multiplied [-], as HAWC2 scales boxes to a target intensity.
    y_center, z_center
        Where the middle of the grid is [m]; by default at the hub.

    Raises
    ------
    InflowError
        If a file cannot be read or has another size than the shape asks for, or a number is out of range.
    """
    if isinstance(files, str | os.PathLike) or len(files) != 3:
        raise InflowError(f"a HAWC2 box has three files, of u, v and w; got {files!r:.200}")
    counts = _three(shape, "shape", "points")
    if any(n != int(n) or n < 2 for n in counts):
        raise InflowError(f"shape must be three whole numbers of at least 2 points (n_x, n_y, n_z); got {shape!r}")
    n_x, n_y, n_z = (int(n) for n in counts)
    parts = []
    for path in files:
        try:
            data = Path(path).read_bytes()
        except OSError as error:
            raise InflowError(f"cannot read the turbulence file {path}: {error}") from error
        if len(data) != 4 * n_x * n_y * n_z:
            raise InflowError(
                f"{path} has {len(data)} bytes where {n_x} x {n_y} x {n_z} numbers of 4 bytes are {4 * n_x * n_y * n_z}"
            )
        parts.append(np.frombuffer(data, dtype="<f4").reshape(n_x, n_y, n_z))
    return _box(np.stack(parts), spacing, mean_speed, hub_height, factors, y_center, z_center, Path(files[0]).name)


def read_hipersim(
    path: str | os.PathLike[str],
    mean_speed: float,
    hub_height: float,
    *,
    factors: tuple[float, float, float] = (1.0, 1.0, 1.0),
    y_center: float = 0.0,
    z_center: float | None = None,
) -> TurbulenceBox:
    """Read a box that hipersim has written as netCDF: one variable of the dimensions uvw, x, y, z with coordinates.

    Parameters
    ----------
    path
        The file.
    mean_speed, hub_height, factors, y_center, z_center
        As of `read_hawc2`. Coordinates give spacings only: where a box lies is for its user to say.

    Raises
    ------
    InflowError
        If the file cannot be read or holds something else.
    """
    import xarray as xr

    try:
        with xr.open_dataarray(path) as array:
            array = array.load()
    except (OSError, ValueError) as error:
        raise InflowError(f"cannot read the turbulence file {path}: {error}") from error
    if set(array.dims) != set(_DIMS):
        raise InflowError(f"{path} must hold one variable of the dimensions {_DIMS}; got {array.dims}")
    array = array.transpose(*_DIMS)
    if array.sizes["uvw"] != 3 or min(array.shape) < 2 or any(name not in array.coords for name in _DIMS[1:]):
        raise InflowError(
            f"{path} must hold u, v and w at two points or more along x, y and z, with their coordinates; got the "
            f"shape {array.shape} and the coordinates {list(array.coords)}"
        )
    if "uvw" in array.coords and [str(name) for name in array["uvw"].values] != ["u", "v", "w"]:
        raise InflowError(f"{path} must hold u, v and w in this order; got {array['uvw'].values.tolist()}")
    spacing = []
    for name in _DIMS[1:]:
        steps = np.diff(array[name].values.astype(float))
        if not np.allclose(steps, steps[0], rtol=1e-3, atol=0.0) or steps[0] <= 0.0:
            raise InflowError(f"{path}: {name} must ascend in equal steps")
        spacing.append(float(steps.mean()))
    samples = array.values.astype(np.float32)
    return _box(samples, spacing, mean_speed, hub_height, factors, y_center, z_center, Path(path).name)


def write_hawc2(box: TurbulenceBox, files: Sequence[str | os.PathLike[str]]) -> tuple[float, float, float]:
    """Write the fluctuations of a box as HAWC2's three files.

    Parameters
    ----------
    box
        With whatever it holds: of a profile of its own only the part about the mean speed.
    files
        Of u, v and w; replaced if they exist.

    Returns
    -------
    tuple of float
        Spacing (dx, dy, dz) [m].
    """
    if isinstance(files, str | os.PathLike) or len(files) != 3:
        raise InflowError(f"a HAWC2 box has three files, of u, v and w; got {files!r:.200}")
    samples = np.moveaxis(box.scale * box.fluctuation[::-1], (3, 0, 2, 1), (0, 1, 2, 3))
    for path, component in zip(files, samples, strict=True):
        Path(path).write_bytes(np.ascontiguousarray(component, dtype="<f4").tobytes())
    return box.time_step * box.mean_speed, box.spacing_y, box.spacing_z


def _box(
    samples: NDArray[np.float32],
    spacing: Sequence[float],
    mean_speed: float,
    hub_height: float,
    factors: Sequence[float],
    y_center: float,
    z_center: float | None,
    name: str,
) -> TurbulenceBox:
    """Box of samples (3, n_x, n_y, n_z)."""
    dx, dy, dz = (
        require_number(d, f"spacing along {axis}", "m", 0.0, open_minimum=True)
        for d, axis in zip(_three(spacing, "spacing", "m"), "xyz", strict=True)
    )
    speed = require_number(mean_speed, "mean_speed", "m/s", 0.0, open_minimum=True)
    factors = [require_number(f, "factors", "-", 0.0) for f in _three(factors, "factors", "-")]
    samples = samples * np.array(factors, dtype=np.float32)[:, None, None, None]
    fastest = float(np.abs(samples).max())
    if not fastest <= _FASTEST:
        raise InflowError(f"{name} holds velocities of up to {fastest:.3g} m/s; must be at most {_FASTEST:g} m/s")
    center = hub_height if z_center is None else require_number(z_center, "z_center", "m")
    fluctuation = np.moveaxis(samples[:, ::-1], (0, 1, 2, 3), (3, 0, 2, 1))
    sigma = fluctuation[..., 0].std(dtype=np.float64)
    return TurbulenceBox(
        fluctuation=fluctuation,
        time_step=dx / speed,
        spacing_y=dy,
        spacing_z=dz,
        z_bottom=center - 0.5 * dz * (samples.shape[3] - 1),
        mean_speed=speed,
        hub_height=hub_height,
        y_center=y_center,
        description=f"{name}: Mann box at {speed:g} m/s (sigma_u {sigma:.3g} m/s)",
    )


def _three(values: Sequence[float], name: str, unit: str) -> tuple[float, float, float]:
    try:
        a, b, c = values
    except (TypeError, ValueError) as error:
        raise InflowError(f"{name} must be three numbers [{unit}]; got {values!r:.100}") from error
    return require_number(a, name, unit), require_number(b, name, unit), require_number(c, name, unit)
