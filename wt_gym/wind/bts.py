"""TurbSim full-field binary files (``.bts``): velocities on a y-z grid over time, packed in 16-bit integers.

Little-endian, no padding: a header of 70 bytes, a description, then for each time step the grid (rows upwards,
columns towards +y, components u, v, w) followed by the tower points (downwards). A velocity is
(integer − offset)/slope with one slope and offset a component. Described by the readers NREL publishes with TurbSim.
"""

from __future__ import annotations

import os
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.base.errors import InflowError

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["BtsContent", "read", "write"]

_HEADER = struct.Struct("<h4i12fi")
_NOT_PERIODIC, _PERIODIC = 7, 8
_MAX_DESCRIPTION = 200  # of TurbSim's own files; readers take any length
_FASTEST = 200.0  # m/s; no gust has ever come near, so what is above is damage or another unit


@dataclass(frozen=True)
class BtsContent:
    """Content of a ``.bts`` file.

    ``grid`` (n_times, n_z, n_y, 3) and ``tower`` (n_times, n_tower, 3) are full velocities [m/s] in float32, the mean
    included; lengths in meters, times in seconds.
    """

    grid: NDArray[np.float32]
    tower: NDArray[np.float32]
    time_step: float
    spacing_y: float
    spacing_z: float
    z_bottom: float
    mean_speed: float
    hub_height: float
    periodic: bool
    description: str


def read(path: str | os.PathLike[str]) -> BtsContent:
    """Read a file; raise InflowError if it is missing, truncated or something else."""
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise InflowError(f"cannot read the turbulence file {path}: {error}") from error
    if len(data) < _HEADER.size:
        raise InflowError(f"{path} is not a .bts file: {len(data)} bytes are less than its header of {_HEADER.size}")
    identifier, n_z, n_y, n_tower, n_times, *numbers, n_characters = _HEADER.unpack_from(data)
    spacing_z, spacing_y, time_step, mean_speed, hub_height, z_bottom = numbers[:6]
    slope, offset = np.array(numbers[6::2]), np.array(numbers[7::2])
    if identifier not in (_NOT_PERIODIC, _PERIODIC):
        raise InflowError(f"{path} is not a .bts file: it starts with {identifier}, not {_NOT_PERIODIC} or {_PERIODIC}")
    longest = max(_MAX_DESCRIPTION, len(data) - _HEADER.size)
    if min(n_z, n_y, n_times) < 2 or n_tower < 0 or not 0 <= n_characters <= longest:
        raise InflowError(
            f"{path} has an impossible header: {n_y} x {n_z} grid points (at least 2 x 2), {n_tower} tower points, "
            f"{n_times} time steps (at least 2), {n_characters} characters of description (at most {longest})"
        )
    positive = [spacing_z, spacing_y, time_step, mean_speed, hub_height]
    if not np.isfinite(numbers).all() or min(positive) <= 0.0 or (slope == 0.0).any():
        raise InflowError(
            f"{path} has an impossible header: spacings {spacing_y} and {spacing_z} m, time step {time_step} s, hub "
            f"speed {mean_speed} m/s, hub height {hub_height} m must be positive, slopes {slope.tolist()} not zero"
        )
    start = _HEADER.size + n_characters
    points = n_z * n_y + n_tower
    expected = start + 6 * n_times * points
    if len(data) != expected:
        state = "truncated" if len(data) < expected else "too long"
        raise InflowError(f"{path} is {state}: {len(data)} bytes where its header asks for {expected}")
    packed = np.frombuffer(data, dtype="<i2", offset=start).reshape(n_times, points, 3)
    velocity = ((packed - offset) / slope).astype(np.float32)
    fastest = float(np.abs(velocity).max())
    if not fastest <= _FASTEST:
        raise InflowError(f"{path} holds velocities of up to {fastest:.3g} m/s; must be at most {_FASTEST:g} m/s")
    return BtsContent(
        grid=velocity[:, : n_z * n_y].reshape(n_times, n_z, n_y, 3),
        tower=velocity[:, n_z * n_y :],
        time_step=time_step,
        spacing_y=spacing_y,
        spacing_z=spacing_z,
        z_bottom=z_bottom,
        mean_speed=mean_speed,
        hub_height=hub_height,
        periodic=identifier == _PERIODIC,
        description=data[_HEADER.size : start].decode("ascii", errors="replace").strip(),
    )


def write(path: str | os.PathLike[str], content: BtsContent) -> None:
    """Write a file; velocities are rounded to 1/65535 of each component's range."""
    n_times, n_z, n_y, _ = content.grid.shape
    velocity = np.concatenate([content.grid.reshape(n_times, n_z * n_y, 3), content.tower], axis=1)
    slope, offset = _scaling(velocity)
    packed = np.rint(slope * velocity + offset).astype("<i2")
    description = content.description.encode("ascii", errors="replace")[:_MAX_DESCRIPTION]
    header = _HEADER.pack(
        _PERIODIC if content.periodic else _NOT_PERIODIC,
        n_z,
        n_y,
        content.tower.shape[1],
        n_times,
        content.spacing_z,
        content.spacing_y,
        content.time_step,
        content.mean_speed,
        content.hub_height,
        content.z_bottom,
        *np.column_stack([slope, offset]).ravel(),
        len(description),
    )
    Path(path).write_bytes(header + description + packed.tobytes())


def _scaling(velocity: NDArray[np.float32]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Slope and offset of each component that map its range to −32768 … 32767, as the file's float32 holds them.

    A range below a hundredth of the largest speed is widened: float32 could not hold its offset to one count.
    """
    low, high = velocity.min(axis=(0, 1)).astype(float), velocity.max(axis=(0, 1)).astype(float)
    largest = np.maximum(np.abs(low), np.abs(high))
    span = np.maximum(high - low, 0.01 * largest)
    span[span == 0.0] = 1.0
    slope = (65535.0 / span).astype(np.float32).astype(float)
    offset = (-32768.0 - slope * low).astype(np.float32).astype(float)
    return slope, offset
