"""Files and descriptions of winds.

TurbSim full-field binary files (``.bts``): velocities on a y-z grid over time, packed in 16-bit integers.

Little-endian, no padding: a header of 70 bytes, a description, then for each time step the grid (rows upwards,
columns towards +y, components u, v, w) followed by the tower points (downwards). A velocity is
(integer − offset)/slope with one slope and offset a component. Described by the readers NREL publishes with TurbSim.

Boxes of Mann's turbulence in the formats of HAWC2 and hipersim.

HAWC2 keeps each of u, v and w in a file of float32 numbers, little-endian, without header, of shape (n_x, n_y, n_z),
the last index fastest. x points downwind: the first plane meets the rotor last. y points to the left looking downwind,
z upwards; u, v and w are along x, y and z. hipersim documents these directions for its arrays, which it writes to such
files and to netCDF (`MannTurbulenceField.to_xarray`, `to_hawc2`). They are ours except for the order of the planes.
OpenFAST's reader takes the first plane as the one that arrives first and the first column as the leftmost one: there
the same file gives a field that is reversed along x and y.

The boxes hold no mean wind: they are carried along at a given mean speed on a mean profile.

Winds by description: the path of a file, or a mapping that JSON can hold.

The suffix of a path tells the format: ``.bts`` (TurbSim), ``.csv``, ``.wnd`` or ``.hh`` (series), ``.nc`` (hipersim),
``.json`` (a mapping in a file; relative paths in it count from its folder). A mapping has either ``file``, a path or
the three paths of a HAWC2 box, or ``kind``, and options:

==================================== ===================================================================================
``{"file": "a.bts"}``                ``remove_profile``, ``beyond_grid``, ``time_offset``, and after ``remove_profile``
                                     the options of the mean wind
``{"file": "a.csv"}``, .wnd, .hh     ``hub_height``, ``reference_length``, ``travels``, ``time_offset``
``{"file": ["u", "v", "w"]}``        required: ``shape``, ``spacing``, ``mean_speed``; ``hub_height``, ``factors``,
                                     ``y_center``, ``z_center``, ``beyond_grid``, ``time_offset``, the mean wind
``{"file": "a.nc"}``                 required: ``mean_speed``; otherwise as above without shape and spacing
``{"kind": "steady"}``               required: ``speed``; ``hub_height``, the mean wind
``{"kind": "step"}``                 required: ``before``, ``after``, ``time``; ``hub_height``, ``shear_exponent``,
                                     ``reference_length``, ``travels``
``{"kind": "ramp"}``                 required: ``before``, ``after``, ``time``, ``duration``; otherwise as step
==================================== ===================================================================================

The options of the mean wind are those of `SteadyInflow`: ``shear_exponent``, ``roughness_length``, ``veer``,
``yaw_misalignment``, ``inclination``, ``jet_height``, ``jet_share``. Defaults of ``hub_height`` and
``reference_length`` are hub height and rotor diameter of the turbine.
"""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, TypeGuard

import numpy as np
from numpy.typing import NDArray

from wt_gym.base.errors import InflowError, did_you_mean
from wt_gym.base.quantities import Array
from wt_gym.wind.inflow import POSITIVE, Inflow, require_number
from wt_gym.wind.series import SeriesInflow, read_csv, read_uniform
from wt_gym.wind.steady import SteadyInflow
from wt_gym.wind.turbulence_box import TurbulenceBox
from wt_gym.wind.turbulent import TurbulentInflow

_PathLike = str | os.PathLike[str]
_Three = tuple[float, float, float]
_FASTEST = 200.0  # m/s; no gust has ever come near: what is above is damage, another number of points or another unit


def _bytes(path: _PathLike) -> bytes:
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise InflowError(f"cannot read the turbulence file {path}: {error}") from error


def _check_speeds(velocity: NDArray[np.float32], name: object) -> None:
    """Refuse velocities that no wind has."""
    fastest = float(np.abs(velocity).max())
    if not fastest <= _FASTEST:
        raise InflowError(f"{name} holds velocities of up to {fastest:.3g} m/s; must be at most {_FASTEST:g} m/s")


# ---- TurbSim ---------------------------------------------------------------------------------------------------------

_HEADER = struct.Struct("<h4i12fi")
_NOT_PERIODIC, _PERIODIC = 7, 8
_MAX_DESCRIPTION = 200  # of TurbSim's own files; readers take any length


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

    @classmethod
    def read(cls, path: _PathLike) -> BtsContent:
        """Read a file; raise InflowError if it is missing, truncated or something else."""
        data = _bytes(path)
        if len(data) < _HEADER.size:
            raise InflowError(
                f"{path} is not a .bts file: {len(data)} bytes are less than its header of {_HEADER.size}"
            )
        identifier, n_z, n_y, n_tower, n_times, *numbers, n_characters = _HEADER.unpack_from(data)
        spacing_z, spacing_y, time_step, mean_speed, hub_height, z_bottom = numbers[:6]
        slope, offset = np.array(numbers[6::2]), np.array(numbers[7::2])
        if identifier not in (_NOT_PERIODIC, _PERIODIC):
            raise InflowError(
                f"{path} is not a .bts file: it starts with {identifier}, not {_NOT_PERIODIC} or {_PERIODIC}"
            )
        longest = max(_MAX_DESCRIPTION, len(data) - _HEADER.size)
        if min(n_z, n_y, n_times) < 2 or n_tower < 0 or not 0 <= n_characters <= longest:
            raise InflowError(
                f"{path} has an impossible header: {n_y} x {n_z} grid points (at least 2 x 2), {n_tower} tower points, "
                f"{n_times} time steps (at least 2), {n_characters} characters of description (at most {longest})"
            )
        positive = [spacing_z, spacing_y, time_step, mean_speed, hub_height]
        if not np.isfinite(numbers).all() or min(positive) <= 0.0 or (slope == 0.0).any():
            raise InflowError(
                f"{path} has an impossible header: spacings {spacing_y} and {spacing_z} m, time step {time_step} s, "
                f"hub speed {mean_speed} m/s, hub height {hub_height} m must be positive, slopes {slope.tolist()} not "
                "zero"
            )
        start, points = _HEADER.size + n_characters, n_z * n_y + n_tower
        expected = start + 6 * n_times * points
        if len(data) != expected:
            state = "truncated" if len(data) < expected else "too long"
            raise InflowError(f"{path} is {state}: {len(data)} bytes where its header asks for {expected}")
        packed = np.frombuffer(data, dtype="<i2", offset=start).reshape(n_times, points, 3)
        velocity = ((packed - offset) / slope).astype(np.float32)
        _check_speeds(velocity, path)
        grid, tower = velocity[:, : n_z * n_y].reshape(n_times, n_z, n_y, 3), velocity[:, n_z * n_y :]
        description = data[_HEADER.size : start].decode("ascii", errors="replace").strip()
        return cls(
            grid, tower, time_step, spacing_y, spacing_z, z_bottom, mean_speed, hub_height, identifier == _PERIODIC,
            description,
        )  # fmt: skip

    def write(self, path: _PathLike) -> None:
        """Write a file; velocities are rounded to 1/65535 of each component's range."""
        n_times, n_z, n_y, _ = self.grid.shape
        velocity = np.concatenate([self.grid.reshape(n_times, n_z * n_y, 3), self.tower], axis=1)
        slope, offset = _scaling(velocity)
        packed = np.rint(slope * velocity + offset).astype("<i2")
        description = self.description.encode("ascii", errors="replace")[:_MAX_DESCRIPTION]
        header = _HEADER.pack(
            _PERIODIC if self.periodic else _NOT_PERIODIC, n_z, n_y, self.tower.shape[1], n_times, self.spacing_z,
            self.spacing_y, self.time_step, self.mean_speed, self.hub_height, self.z_bottom,
            *np.column_stack([slope, offset]).ravel(), len(description),
        )  # fmt: skip
        Path(path).write_bytes(header + description + packed.tobytes())


def _scaling(velocity: NDArray[np.float32]) -> tuple[Array, Array]:
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


def read_bts(path: _PathLike, *, remove_profile: bool = False) -> TurbulenceBox:
    """Read a TurbSim full-field file (``.bts``).

    Parameters
    ----------
    path
        The file.
    remove_profile
        Subtract the time mean at every point, so that another profile can be added. By default
        only the hub speed of the header is subtracted and the file's shear stays in the fluctuation.

    Raises
    ------
    InflowError
        The file is missing, truncated or no ``.bts`` file.
    """
    c = BtsContent.read(path)
    fluctuation, tower = c.grid, c.tower
    if remove_profile:
        fluctuation = fluctuation - fluctuation.mean(axis=0, dtype=np.float64).astype(np.float32)
        tower = tower - tower.mean(axis=0, dtype=np.float64).astype(np.float32)
    else:
        hub_velocity = np.array([c.mean_speed, 0.0, 0.0], dtype=np.float32)
        fluctuation, tower = fluctuation - hub_velocity, tower - hub_velocity
    return TurbulenceBox(
        fluctuation, c.time_step, c.spacing_y, c.spacing_z, c.z_bottom, c.mean_speed, c.hub_height, c.periodic,
        holds_profile=not remove_profile, tower=tower, description=c.description,
    )  # fmt: skip


def write_bts(box: TurbulenceBox, path: _PathLike, steady: SteadyInflow | None = None) -> None:
    """Write a box as a TurbSim full-field file (``.bts``).

    Parameters
    ----------
    box
        Centered on the tower.
    path
        The file; replaced if it exists.
    steady
        Mean profile to add, by default uniform at ``mean_speed``. Its yaw misalignment and inclination turn
        the whole field and have no place in the file: they must be zero.
    """
    steady = SteadyInflow(box.mean_speed, box.hub_height) if steady is None else steady
    box.require_fitting(steady)
    if box.y_center != 0.0:
        raise InflowError(f"a .bts file is centered on the tower: y_center must be 0; got {box.y_center:g} m")
    if steady.yaw_misalignment != 0.0 or steady.inclination != 0.0:
        raise InflowError("a .bts file is aligned with the wind: yaw_misalignment and inclination must be zero")
    points, tower_points = np.zeros((box.z.size, box.y.size, 3)), np.zeros((box.tower.shape[1], 3))
    points[..., 1], points[..., 2] = box.y, box.z[:, None]
    tower_points[:, 2] = box.z_bottom - box.spacing_z * np.arange(box.tower.shape[1])
    grid, tower = (
        box.scale * samples + steady.velocity(place, 0.0).astype(np.float32)
        for samples, place in ((box.fluctuation, points), (box.tower, tower_points))
    )
    BtsContent(
        grid, tower, box.time_step, box.spacing_y, box.spacing_z, box.z_bottom, box.mean_speed, box.hub_height,
        box.periodic, box.description,
    ).write(path)  # fmt: skip


# ---- boxes of Mann's turbulence --------------------------------------------------------------------------------------

_DIMS = ("uvw", "x", "y", "z")


def read_hawc2(
    files: Sequence[_PathLike],
    shape: tuple[int, int, int],
    spacing: _Three,
    mean_speed: float,
    hub_height: float,
    **options: Any,
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
    **options
        ``factors`` by which u, v and w are multiplied [-], as HAWC2 scales boxes to a target intensity, 1 by default;
        ``y_center`` and ``z_center``, where the middle of the grid is [m], by default at the hub.

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
        data = _bytes(path)
        if len(data) != 4 * n_x * n_y * n_z:
            raise InflowError(
                f"{path} has {len(data)} bytes where {n_x} x {n_y} x {n_z} numbers of 4 bytes are {4 * n_x * n_y * n_z}"
            )
        parts.append(np.frombuffer(data, dtype="<f4").reshape(n_x, n_y, n_z))
    return _mann_box(np.stack(parts), spacing, mean_speed, hub_height, Path(files[0]).name, **options)


def read_hipersim(path: _PathLike, mean_speed: float, hub_height: float, **options: Any) -> TurbulenceBox:
    """Read a box that hipersim has written as netCDF: one variable of the dimensions uvw, x, y, z with coordinates.

    Parameters
    ----------
    path
        The file.
    mean_speed, hub_height, **options
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
    return _mann_box(array.values.astype(np.float32), spacing, mean_speed, hub_height, Path(path).name, **options)


def _mann_box(
    samples: NDArray[np.float32],
    spacing: Sequence[float],
    mean_speed: float,
    hub_height: float,
    name: str,
    *,
    factors: Sequence[float] = (1.0, 1.0, 1.0),
    y_center: float = 0.0,
    z_center: float | None = None,
) -> TurbulenceBox:
    """Box of samples (3, n_x, n_y, n_z)."""
    dx, dy, dz = (
        require_number(d, f"spacing along {axis}", "m", *POSITIVE)
        for d, axis in zip(_three(spacing, "spacing", "m"), "xyz", strict=True)
    )
    speed = require_number(mean_speed, "mean_speed", "m/s", *POSITIVE)
    factors = [require_number(f, "factors", "-", 0.0) for f in _three(factors, "factors", "-")]
    samples = samples * np.array(factors, dtype=np.float32)[:, None, None, None]
    _check_speeds(samples, name)
    center = hub_height if z_center is None else require_number(z_center, "z_center", "m")
    fluctuation = np.moveaxis(samples[:, ::-1], (0, 1, 2, 3), (3, 0, 2, 1))
    sigma = fluctuation[..., 0].std(dtype=np.float64)
    return TurbulenceBox(
        fluctuation, dx / speed, dy, dz, center - 0.5 * dz * (samples.shape[3] - 1), speed, hub_height,
        y_center=y_center, description=f"{name}: Mann box at {speed:g} m/s (sigma_u {sigma:.3g} m/s)",
    )  # fmt: skip


def _three(values: Sequence[float], name: str, unit: str) -> _Three:
    try:
        a, b, c = values
    except (TypeError, ValueError) as error:
        raise InflowError(f"{name} must be three numbers [{unit}]; got {values!r:.100}") from error
    return require_number(a, name, unit), require_number(b, name, unit), require_number(c, name, unit)


# ---- descriptions ----------------------------------------------------------------------------------------------------

_MEAN_WIND = (
    "shear_exponent", "roughness_length", "veer", "yaw_misalignment", "inclination", "jet_height", "jet_share",
)  # fmt: skip
_SERIES = ("hub_height", "reference_length", "travels", "time_offset")
_BOX = ("hub_height", "factors", "y_center", "z_center")
_CARRIED = ("beyond_grid", "time_offset", *_MEAN_WIND)
_CHANGES = ("hub_height", "reference_length", "travels", "shear_exponent")


def _from_bts(path: str, **options: Any) -> TurbulentInflow:
    remove = options.pop("remove_profile", False)
    if not isinstance(remove, bool):
        raise InflowError(f"remove_profile must be True or False; got {remove!r}")
    box = read_bts(path, remove_profile=remove)
    return _carried(replace(box, description=f"{Path(path).name}: {box.description}"), options)


def _from_mann(files: Any, **options: Any) -> TurbulentInflow:
    carried = {name: options.pop(name) for name in _CARRIED if name in options}
    return _carried(
        read_hipersim(files, **options) if isinstance(files, str) else read_hawc2(files, **options), carried
    )


def _carried(box: TurbulenceBox, options: dict[str, Any]) -> TurbulentInflow:
    """Box on a mean wind of its own speed and height."""
    mean = {name: options.pop(name) for name in _MEAN_WIND if name in options}
    return TurbulentInflow(box, SteadyInflow(box.mean_speed, box.hub_height, **mean), **options)


class _Form(NamedTuple):
    """A form of a description."""

    make: Callable[..., Inflow]  # of the file or files, if there are any, and the options
    needed: tuple[str, ...]
    allowed: tuple[str, ...]
    of_turbine: tuple[str, ...] = ()  # options that the turbine fills in


_FILES = {
    ".bts": _Form(_from_bts, (), ("remove_profile", *_CARRIED)),
    ".csv": _Form(read_csv, (), _SERIES, _SERIES[:2]),
    ".wnd": _Form(read_uniform, (), _SERIES, _SERIES[:2]),
    ".hh": _Form(read_uniform, (), _SERIES, _SERIES[:2]),
    ".nc": _Form(_from_mann, ("mean_speed",), (*_BOX, *_CARRIED), _BOX[:1]),
    "three files": _Form(_from_mann, ("shape", "spacing", "mean_speed"), (*_BOX, *_CARRIED), _BOX[:1]),
}
_KINDS = {
    "steady": _Form(SteadyInflow, ("speed",), ("hub_height", *_MEAN_WIND), ("hub_height",)),
    "step": _Form(SeriesInflow.ramp, ("before", "after", "time"), _CHANGES, _CHANGES[:2]),
    "ramp": _Form(SeriesInflow.ramp, ("before", "after", "time", "duration"), _CHANGES, _CHANGES[:2]),
}
SUFFIXES = (*(suffix for suffix in _FILES if suffix.startswith(".")), ".json")
"""Of files of wind."""


def is_wind_path(value: object) -> bool:
    """Whether a value is the path of a file of wind, by its suffix."""
    return isinstance(value, str | os.PathLike) and os.path.splitext(os.fspath(value))[1].lower() in SUFFIXES


def is_described(value: object) -> TypeGuard[str | os.PathLike[str] | Mapping[str, Any]]:
    """Whether a value is a path or a mapping that describes a wind."""
    return isinstance(value, Mapping) or is_wind_path(value)


def whole_description(description: str | os.PathLike[str] | Mapping[str, Any]) -> dict[str, Any]:
    """A description as a mapping with whole paths: it means the same in other folders and processes.

    Parameters
    ----------
    description
        A path or a mapping.

    Raises
    ------
    InflowError
        If it is neither, a ``.json`` file cannot be read, or a path has no suffix of `SUFFIXES`.
    """
    folder, given = ".", description
    if not isinstance(description, Mapping) and is_wind_path(description):
        path = os.path.abspath(os.fspath(description))
        if not path.lower().endswith(".json"):
            return {"file": path}
        folder, given = os.path.dirname(path), _json(path)
    if not isinstance(given, Mapping):
        raise InflowError(
            f"a wind is described by a mapping or by a file that ends in {', '.join(SUFFIXES)}; got {given!r:.100}"
        )
    found = dict(given)
    if ("file" in found) == ("kind" in found):
        raise InflowError(f"the description of a wind has either 'file' or 'kind'; got {sorted(map(str, found))}")
    if "kind" in found:
        return found
    files = found["file"]
    several = isinstance(files, list | tuple)
    paths = [os.fspath(one) for one in (files if several else [files]) if isinstance(one, str | os.PathLike)]
    if len(paths) != (len(files) if several else 1) or (several and len(paths) != 3):
        raise InflowError(f"file must be a path, or the paths of u, v and w of a HAWC2 box; got {files!r:.200}")
    if not several and (not is_wind_path(paths[0]) or paths[0].lower().endswith(".json")):
        raise InflowError(f"file must end in {', '.join(s for s in SUFFIXES if s != '.json')}; got {paths[0]!r}")
    paths = [os.path.abspath(os.path.join(folder, path)) for path in paths]
    return {**found, "file": paths if several else paths[0]}


def files_of(description: Mapping[str, Any]) -> tuple[str, ...]:
    """Paths of the files that a whole description names."""
    files = description.get("file", ())
    return (files,) if isinstance(files, str) else tuple(files)


def wind_from(
    description: str | os.PathLike[str] | Mapping[str, Any], hub_height: float = 90.0, rotor_diameter: float = 126.0
) -> Inflow:
    """Make the wind of a description.

    Parameters
    ----------
    description
        A path or a mapping, see the module.
    hub_height, rotor_diameter
        Of the turbine [m], for what the description leaves open.

    Raises
    ------
    InflowError
        If an option is unknown, missing or out of range, or a file cannot be read.

    Examples
    --------
    >>> print(wind_from({"kind": "step", "before": 8.0, "after": 11.0, "time": 30.0}))
    step from 8 to 11 m/s at 30 s: 8 to 11 m/s at 90 m, uniform profile
    """
    options = whole_description(description)
    files, kind = options.pop("file", None), options.pop("kind", None)
    name = kind if files is None else "three files" if isinstance(files, list) else Path(files).suffix.lower()
    form = (_KINDS if files is None else _FILES).get(name)
    if form is None:
        raise InflowError(
            f"kind must be one of {', '.join(map(repr, _KINDS))}; got {kind!r:.100}{did_you_mean(kind, _KINDS)}"
        )
    names = (*form.needed, *form.allowed)
    for option in options:
        if option not in names:
            near = did_you_mean(option, names, ".")
            raise InflowError(
                f"a wind of the form {name!r} has no option {option!r:.60}{near} Allowed: {', '.join(names)}"
            )
    if missing := [option for option in form.needed if option not in options]:
        raise InflowError(f"a wind of the form {name!r} needs {', '.join(missing)}")
    turbine = {"hub_height": hub_height, "reference_length": rotor_diameter}
    options = {**{option: turbine[option] for option in form.of_turbine}, **options}
    return form.make(**options) if files is None else form.make(files, **options)


def _json(path: str) -> Any:
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InflowError(f"cannot read the description of a wind {path}: {error}") from error
