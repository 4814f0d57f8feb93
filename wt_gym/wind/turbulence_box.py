"""A frozen field of turbulence on a y-z grid over time, and the boxes that are kept on disk.

Files live in ``$WT_GYM_CACHE/turbulence``, or without that variable in the user's cache directory. Each holds, one
after the other in NumPy's format, the parameters of a box, a checksum and the samples: read in a third of the time
that an archive of them takes. A file that cannot be read, or that belongs to other parameters, is made again; a
directory that cannot be written costs only the time of the next synthesis and is reported to the log. The folder is
kept below :data:`MAX_BYTES` by removing the boxes not used for longest.
"""

import contextlib
import hashlib
import json
import os
import tokenize
import warnings
import zipfile
import zlib
from dataclasses import dataclass, field, fields
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wt_gym.base.errors import InflowError
from wt_gym.base.files import write_whole
from wt_gym.base.quantities import Array
from wt_gym.base.user_cache import cached_file, prune, read_cached, write_cached
from wt_gym.wind.inflow import POSITIVE, check_numbers, fill_in, require_number, set_read_only
from wt_gym.wind.kaimal import BoxParameters, KaimalParameters
from wt_gym.wind.mann import MannParameters
from wt_gym.wind.steady import SteadyInflow

MAX_BYTES = 2 * 1024**3

_FORMAT = 5  # raise when the synthesis changes its results
# What numpy raises on damaged files: the errors of syntax and tokens where a bit of an array's header is wrong.
_DAMAGE = (
    OSError, ValueError, KeyError, TypeError, EOFError, OverflowError, MemoryError, BufferError, SyntaxError,
    tokenize.TokenError, zipfile.BadZipFile,
)  # fmt: skip


def cache_file(parameters: BoxParameters) -> Path | None:
    """File in which the box of these parameters is or would be kept."""
    digest = hashlib.sha256(_label(parameters).encode()).hexdigest()[:20]
    return cached_file("turbulence", f"{parameters.model}-{digest}.npy")


def _label(parameters: BoxParameters) -> str:
    return json.dumps({"format": _FORMAT, **parameters.as_dict()}, sort_keys=True)


def load(parameters: BoxParameters) -> NDArray[np.float32] | None:
    """Fluctuations (n_times, n_z, n_y, 3) from the cache, or None if there is no intact file."""

    def read(path: Path) -> NDArray[np.float32]:
        with path.open("rb") as file:
            label, checksum, fluctuation = (np.load(file, allow_pickle=False) for _ in range(3))
        if zlib.crc32(fluctuation.data) != checksum:
            raise ValueError("its samples do not have their checksum")
        shape = (parameters.n_times, parameters.grid[1], parameters.grid[0], 3)
        if str(label) != _label(parameters) or fluctuation.shape != shape or fluctuation.dtype != np.float32:
            raise ValueError("it holds another box")
        with contextlib.suppress(OSError):  # a read-only cache is still a good cache
            os.utime(path)
        found: NDArray[np.float32] = fluctuation
        return found

    return read_cached("turbulence", cache_file(parameters), read, _DAMAGE)


def store(parameters: BoxParameters, fluctuation: NDArray[np.float32]) -> None:
    """Write the box so that other processes see either the whole file or none."""

    def write(file: Any) -> None:
        for array in (np.array(_label(parameters)), np.uint32(zlib.crc32(fluctuation.data)), fluctuation):
            np.save(file, array)

    path = cache_file(parameters)
    if path is not None and write_cached("turbulence", path, lambda file: write_whole(file, write)):
        prune((*path.parent.glob("kaimal-*"), *path.parent.glob("mann-*")), MAX_BYTES, in_bytes=True)


_BOXES_IN_MEMORY = 8


@dataclass(frozen=True, eq=False)
class TurbulenceBox:
    """Velocity fluctuations at the points of a plane across the wind, sampled in time.

    Make one with :meth:`kaimal` or :meth:`mann`, or read it with `read_bts`. Boxes are immutable and can be shared.

    Parameters
    ----------
    fluctuation
        Velocity minus ``mean_speed`` along the wind over ``scale`` [m/s], float32, shape (n_times, n_z, n_y, 3): u
        along the mean wind, v to the left of it, w up. Rows go upwards, columns to the left (+y).
    time_step
        Sampling interval [s].
    spacing_y, spacing_z
        Distance between grid points [m].
    z_bottom
        Height of the lowest row [m].
    mean_speed
        Mean speed at the hub [m/s], with which the field is carried along.
    hub_height
        Hub height [m].
    periodic
        Whether the last sample leads smoothly to the first. A box is repeated in time either way; one that is not
        periodic jumps within one time step at its end.
    holds_profile
        Whether the fluctuation contains a mean profile (shear, veer), as read from a file.
    tower
        Fluctuations at points below the grid, on the tower axis, from the top down with ``spacing_z``: shape
        (n_times, n_tower, 3). Below the grid the wind is interpolated between them and the lowest row.
    scale
        By which the samples are multiplied where the wind is read [-]: boxes of one field at other speeds and
        intensities share their samples.
    y_center
        Lateral position of the middle of the grid [m].
    description
        What this box is, in words.

    Raises
    ------
    InflowError
        Shapes do not fit, or a value is not finite or out of range.
    """

    fluctuation: NDArray[np.float32] = field(repr=False)
    time_step: float
    spacing_y: float
    spacing_z: float
    z_bottom: float
    mean_speed: float
    hub_height: float
    periodic: bool = True
    holds_profile: bool = False
    tower: NDArray[np.float32] = field(default=None, repr=False)  # type: ignore[arg-type]  # none: an empty array
    scale: float = 1.0
    description: str = "turbulence box"
    y_center: float = 0.0

    def __post_init__(self) -> None:
        check_numbers(
            self, time_step=("s", *POSITIVE), spacing_y=("m", *POSITIVE), spacing_z=("m", *POSITIVE),
            mean_speed=("m/s", *POSITIVE), hub_height=("m", *POSITIVE), scale=("-", *POSITIVE), z_bottom=("m",),
            y_center=("m",),
        )  # fmt: skip
        samples = _frozen_samples(self.fluctuation, "fluctuation")
        if samples.ndim != 4 or samples.shape[3] != 3 or min(samples.shape[:3]) < 2:
            raise InflowError(
                "fluctuation must have shape (n_times, n_z, n_y, 3) with at least two points along each of the "
                f"first three axes; got {samples.shape}"
            )
        fill_in(self, tower=np.empty((samples.shape[0], 0, 3)))
        tower = _frozen_samples(self.tower, "tower")
        if tower.ndim != 3 or tower.shape[0] != samples.shape[0] or tower.shape[2] != 3:
            raise InflowError(f"tower must have shape ({samples.shape[0]}, n_tower, 3); got {tower.shape}")
        set_read_only(self, fluctuation=samples, tower=tower)

    def carried_along(self, mean_speed: float, scale: float, description: str) -> "TurbulenceBox":
        """The same field carried along at another speed [m/s] and multiplied by another ``scale``.

        The samples are shared, and not looked at again: a box of them takes no time.
        """
        box = object.__new__(TurbulenceBox)
        speed = require_number(mean_speed, "mean_speed", "m/s", *POSITIVE)
        changes = {
            "time_step": self.time_step * self.mean_speed / speed,
            "mean_speed": speed,
            "scale": require_number(scale, "scale", "-", *POSITIVE),
            "description": description,
        }
        for field_ in fields(self):  # not the profile, which holds for one speed
            object.__setattr__(box, field_.name, changes.get(field_.name, getattr(self, field_.name)))
        return box

    def __copy__(self) -> "TurbulenceBox":
        return self

    def __deepcopy__(self, memo: dict[int, object]) -> "TurbulenceBox":
        return self

    def __setstate__(self, state: dict[str, Any]) -> None:
        # NumPy does not carry the read-only flag through pickle; without it another form of the kernels would run.
        for name, value in state.items():
            object.__setattr__(self, name, value)
        for samples in (self.fluctuation, self.tower):
            samples.setflags(write=False)

    @classmethod
    def kaimal(
        cls,
        mean_speed: float,
        hub_height: float,
        rotor_diameter: float,
        turbulence_class: str = "B",
        *,
        cache: bool = True,
        **options: Any,
    ) -> "TurbulenceBox":
        """Kaimal turbulence of IEC 61400-1 around a rotor, periodic in time.

        Each component has exactly zero mean (to float32 rounding) over the period at every point. The components
        are independent of each other.

        Parameters
        ----------
        mean_speed
            Ten-minute mean speed at the hub [m/s].
        hub_height, rotor_diameter
            Of the turbine [m].
        turbulence_class
            ``"A+"``, ``"A"``, ``"B"`` or ``"C"``.
        seed
            Seed of the random generator, an integer of at least 0. The same arguments give the same bits.
        duration, time_step
            Period and sampling interval [s]; the period must be a multiple of the interval.
        grid
            Numbers of points (n_y, n_z), both odd so that one point is the hub. By default as many as a spacing of
            at most 10 m needs.
        width
            Side of the square grid centered on the hub [m]; by default 1.15 rotor diameters, at most 1.98 hub
            heights.
        turbulence
            ``"NTM"`` (normal) or ``"ETM"`` (extreme) turbulence.
        turbine_class
            ``"I"``, ``"II"`` or ``"III"``, for the extreme model.
        scaling
            What to do about the variance below one cycle per period and above half the sampling frequency, which the
            harmonics of the record leave out (σ_u at 12 m/s in 600 s: 0.945 of the target). ``"low_frequency"``: the
            first harmonic carries it, all others follow the spectrum. ``"uniform"``: all amplitudes are multiplied
            by one factor for each component. ``"none"``: every harmonic follows the spectrum. The first two give
            exactly the standard's σ at the hub in every seed; the factors stand in the box's ``description``.
        lateral_coherence
            Give v and w the coherence of u. The standard leaves theirs open; without, neighboring points are
            independent in v and w, and interpolation between them loses variance.
        spectrum_of
            Whose spectrum and σ are the standard's: ``"interpolated"``, those of the wind in straight lines between
            the samples, as `TurbulentInflow` and other tools read a box (`wt_gym.wind.kaimal`); the samples
            themselves are then stronger near half the sampling frequency. ``"samples"``: those of the samples; the
            wind between them lacks a third of the variance at a quarter of the sampling frequency.
        cache
            Read and write the cache on disk (folder ``$WT_GYM_CACHE`` or the user's cache directory). The last
            few boxes are kept in memory in any case.

        Raises
        ------
        InflowError
            An argument is out of range or does not fit the others.
        """
        place = mean_speed, hub_height, rotor_diameter, turbulence_class
        return _made_box(KaimalParameters(*place, **options), bool(cache))

    @classmethod
    def mann(
        cls,
        mean_speed: float,
        hub_height: float,
        rotor_diameter: float,
        turbulence_class: str = "B",
        *,
        cache: bool = True,
        **options: Any,
    ) -> "TurbulenceBox":
        """Turbulence of Mann's uniform shear model around a rotor, periodic in time; see `wt_gym.wind.mann`.

        Parameters
        ----------
        mean_speed, hub_height, rotor_diameter, turbulence_class, seed, duration, time_step, grid, width, turbulence, \
turbine_class, spectrum_of, cache
            As of :meth:`kaimal`.
        scaling
            As of :meth:`kaimal`, for the mean over many seeds and points: amplitudes are random here at the hub too.
        length
            L [m]; by default the standard's, 0.8 Λ₁: 33.6 m for hubs from 60 m on.
        shear
            Γ; by default the standard's, 3.9. With 0 the turbulence is isotropic.

        Raises
        ------
        InflowError
            An argument is out of range or does not fit the others.
        """
        place = mean_speed, hub_height, rotor_diameter, turbulence_class
        return _made_box(MannParameters(*place, **options), bool(cache))

    def require_fitting(self, steady: SteadyInflow) -> None:
        """Refuse a mean wind that does not belong to this box (speed, hub height, a second profile)."""
        for name, ours, theirs in (
            ("speed", self.mean_speed, steady.speed),
            ("hub_height", self.hub_height, steady.hub_height),
        ):
            if abs(ours - theirs) > 0.01 * ours:
                raise InflowError(f"{name} of the mean wind must be within 1 % of the box's {ours:g}; got {theirs:g}")
        if self.holds_profile and not steady.is_uniform:
            raise InflowError(
                "the box holds a mean profile already: give a uniform mean wind, or read it with remove_profile=True"
            )

    @property
    def duration(self) -> float:
        """Period of the box [s]."""
        return float(self.fluctuation.shape[0] * self.time_step)

    @property
    def y(self) -> Array:
        """Lateral positions of the columns [m], shape (n_y,)."""
        n = self.fluctuation.shape[2]
        result: Array = self.y_center + self.spacing_y * (np.arange(n) - 0.5 * (n - 1))
        return result

    @property
    def z(self) -> Array:
        """Heights of the rows [m], shape (n_z,)."""
        return np.asarray(self.z_bottom + self.spacing_z * np.arange(self.fluctuation.shape[1]), dtype=np.float64)

    @cached_property
    def profile_description(self) -> str:
        """The mean profile that the box holds, in words; of a box that holds none it says so."""
        if not self.holds_profile:
            return "no profile"
        mean = self.scale * self.fluctuation.mean(axis=(0, 2), dtype=np.float64)
        along, height = self.mean_speed + mean[:, 0], self.z
        text = (
            f"profile of the file: {along[0]:.3g} m/s at {height[0]:.4g} m to {along[-1]:.3g} m/s at {height[-1]:.4g} m"
        )
        above = (height > 0.0) & (along > 0.0)
        if above.sum() >= 2:
            exponent = np.polyfit(np.log(height[above]), np.log(along[above]), 1)[0] + 0.0
            text += f" (exponent of a power law through it {exponent:.2f})"
        turn = np.degrees(np.arctan2(mean[:, 1], along))
        if np.ptp(turn) > 0.5:
            text += f", veer {turn[0]:.1f} to {turn[-1]:.1f} deg"
        return text

    def require_cover(self, hub_height: float, rotor_diameter: float, *, hold: bool = False) -> None:
        """Refuse a grid that does not reach around a rotor.

        Parameters
        ----------
        hub_height, rotor_diameter
            Of the turbine [m].
        hold
            Warn only: beyond the grid the wind is held at its edge.

        Raises
        ------
        InflowError
            If the rotor disc reaches beyond the grid by more than a hundredth of its diameter.
        """
        y, z, radius = self.y, self.z, 0.5 * rotor_diameter
        margin = 0.01 * rotor_diameter
        beyond = max(y[0] + radius, radius - y[-1], z[0] - (hub_height - radius), hub_height + radius - z[-1])
        if beyond <= margin:
            return
        text = (
            f"the grid of '{self.description}' covers y from {y[0]:.4g} to {y[-1]:.4g} m and z from {z[0]:.4g} to "
            f"{z[-1]:.4g} m; the rotor needs y from {-radius:.4g} to {radius:.4g} m and z from "
            f"{hub_height - radius:.4g} to {hub_height + radius:.4g} m"
        )
        if not hold:
            raise InflowError(f"{text}: make a larger grid, or hold the wind at its edge with beyond_grid='hold'")
        warnings.warn(
            f"{text}: the wind there is held at the edge of the grid, so that loads are wrong by the eddies and the "
            "shear that are missing",
            stacklevel=2,
        )

    def _key(self) -> tuple[object, ...]:
        numbers = (self.time_step, self.spacing_y, self.spacing_z, self.z_bottom, self.mean_speed, self.hub_height)
        return (
            *numbers,
            self.y_center,
            self.scale,
            self.periodic,
            self.holds_profile,
            self.description,
            self.fluctuation.shape,
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, TurbulenceBox):
            return NotImplemented
        if self is other:
            return True
        same_samples = np.array_equal(self.fluctuation, other.fluctuation) and np.array_equal(self.tower, other.tower)
        return self._key() == other._key() and same_samples

    def __hash__(self) -> int:
        return hash(self._key())

    def __repr__(self) -> str:
        _, n_z, n_y, _ = self.fluctuation.shape
        return (
            f"<TurbulenceBox: {self.description}; {self.duration:g} s at {self.time_step:g} s, "
            f"{n_y} x {n_z} points at {self.spacing_y:.3g} x {self.spacing_z:.3g} m>"
        )


def _frozen_samples(samples: ArrayLike, name: str) -> NDArray[np.float32]:
    """Return a contiguous float32 array; a copy unless it is one already, and read-only."""
    array = np.asarray(samples)
    if array.dtype != np.float32 or not array.flags.c_contiguous or array.flags.writeable:
        array = np.array(samples, dtype=np.float32, order="C")
    if not np.isfinite(array).all():
        raise InflowError(f"{name} must be finite everywhere")
    return array


@lru_cache(maxsize=_BOXES_IN_MEMORY)
def _made_box(parameters: BoxParameters, use_disk: bool) -> TurbulenceBox:
    fluctuation = load(parameters) if use_disk else None
    if fluctuation is None:
        fluctuation = parameters.synthesize()
        if use_disk:
            store(parameters, fluctuation)
    fluctuation.setflags(write=False)  # or it would be copied
    spacing_y, spacing_z = parameters.spacing
    return TurbulenceBox(
        fluctuation=fluctuation,
        time_step=parameters.time_step,
        spacing_y=spacing_y,
        spacing_z=spacing_z,
        z_bottom=parameters.hub_height - 0.5 * parameters.width,
        mean_speed=parameters.mean_speed,
        hub_height=parameters.hub_height,
        description=parameters.description,
    )
