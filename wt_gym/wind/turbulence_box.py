"""A frozen field of turbulence on a y-z grid over time."""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass, field, fields
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, cast

import numpy as np

from wt_gym.base.errors import InflowError
from wt_gym.wind import box_cache, bts
from wt_gym.wind.kaimal import KaimalParameters, synthesize
from wt_gym.wind.mann import SHEAR, MannParameters, synthesize_mann
from wt_gym.wind.protocol import require_number
from wt_gym.wind.steady import SteadyInflow

if TYPE_CHECKING:
    from typing import Any

    from numpy.typing import ArrayLike, NDArray

__all__ = ["TurbulenceBox"]

_BOXES_IN_MEMORY = 8


@dataclass(frozen=True, eq=False)
class TurbulenceBox:
    """Velocity fluctuations at the points of a plane across the wind, sampled in time.

    Make one with :meth:`kaimal`, :meth:`mann` or :meth:`from_bts`. Boxes are immutable and can be shared.

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
    tower: NDArray[np.float32] | None = field(default=None, repr=False)
    scale: float = 1.0
    description: str = "turbulence box"
    y_center: float = 0.0

    def __post_init__(self) -> None:
        for name, unit in (
            ("time_step", "s"),
            ("spacing_y", "m"),
            ("spacing_z", "m"),
            ("mean_speed", "m/s"),
            ("hub_height", "m"),
            ("scale", "-"),
        ):
            number = require_number(getattr(self, name), name, unit, 0.0, open_minimum=True)
            object.__setattr__(self, name, number)
        object.__setattr__(self, "z_bottom", require_number(self.z_bottom, "z_bottom", "m"))
        object.__setattr__(self, "y_center", require_number(self.y_center, "y_center", "m"))
        samples = _frozen_samples(self.fluctuation, "fluctuation")
        if samples.ndim != 4 or samples.shape[3] != 3 or min(samples.shape[:3]) < 2:
            raise InflowError(
                "fluctuation must have shape (n_times, n_z, n_y, 3) with at least two points along each of the "
                f"first three axes; got {samples.shape}"
            )
        tower = _frozen_samples(np.empty((samples.shape[0], 0, 3)) if self.tower is None else self.tower, "tower")
        if tower.ndim != 3 or tower.shape[0] != samples.shape[0] or tower.shape[2] != 3:
            raise InflowError(f"tower must have shape ({samples.shape[0]}, n_tower, 3); got {tower.shape}")
        object.__setattr__(self, "fluctuation", samples)
        object.__setattr__(self, "tower", tower)

    def carried_along(self, mean_speed: float, scale: float, description: str) -> TurbulenceBox:
        """The same field carried along at another speed [m/s] and multiplied by another ``scale``.

        The samples are shared, and not looked at again: a box of them takes no time.
        """
        box = object.__new__(TurbulenceBox)
        speed = require_number(mean_speed, "mean_speed", "m/s", 0.0, open_minimum=True)
        changes = {
            "time_step": self.time_step * self.mean_speed / speed,
            "mean_speed": speed,
            "scale": require_number(scale, "scale", "-", 0.0, open_minimum=True),
            "description": description,
        }
        for field_ in fields(self):  # not the profile, which holds for one speed
            object.__setattr__(box, field_.name, changes.get(field_.name, getattr(self, field_.name)))
        return box

    def __copy__(self) -> TurbulenceBox:
        return self

    def __deepcopy__(self, memo: dict[int, object]) -> TurbulenceBox:
        return self

    def __setstate__(self, state: dict[str, Any]) -> None:
        # NumPy does not carry the read-only flag through pickle; without it another form of the kernels would run.
        for name, value in state.items():
            object.__setattr__(self, name, value)
        for samples in (self.fluctuation, self._tower):
            samples.setflags(write=False)

    @property
    def _tower(self) -> NDArray[np.float32]:
        """``tower``, which is an array from the start, without points where none was given."""
        return cast("NDArray[np.float32]", self.tower)

    @classmethod
    def kaimal(
        cls,
        mean_speed: float,
        hub_height: float,
        rotor_diameter: float,
        turbulence_class: str = "B",
        *,
        seed: int,
        duration: float = 600.0,
        time_step: float = 0.25,
        grid: tuple[int, int] | None = None,
        width: float | None = None,
        turbulence: str = "NTM",
        turbine_class: str = "I",
        scaling: str = "low_frequency",
        lateral_coherence: bool = True,
        spectrum_of: str = "interpolated",
        cache: bool = True,
    ) -> TurbulenceBox:
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
            the samples, as `TurbulentInflow` and other tools read a box (`wt_gym.wind.interpolation`); the samples
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
        parameters = KaimalParameters.resolve(
            lateral_coherence,
            mean_speed=mean_speed,
            hub_height=hub_height,
            rotor_diameter=rotor_diameter,
            turbulence_class=turbulence_class,
            seed=seed,
            duration=duration,
            time_step=time_step,
            grid=grid,
            width=width,
            turbulence=turbulence,
            turbine_class=turbine_class,
            scaling=scaling,
            spectrum_of=spectrum_of,
        )
        return _made_box(parameters, bool(cache))

    @classmethod
    def mann(
        cls,
        mean_speed: float,
        hub_height: float,
        rotor_diameter: float,
        turbulence_class: str = "B",
        *,
        seed: int,
        duration: float = 600.0,
        time_step: float = 0.25,
        grid: tuple[int, int] | None = None,
        width: float | None = None,
        turbulence: str = "NTM",
        turbine_class: str = "I",
        scaling: str = "low_frequency",
        spectrum_of: str = "interpolated",
        length: float | None = None,
        shear: float = SHEAR,
        cache: bool = True,
    ) -> TurbulenceBox:
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
        parameters = MannParameters.resolve(
            length,
            shear,
            mean_speed=mean_speed,
            hub_height=hub_height,
            rotor_diameter=rotor_diameter,
            turbulence_class=turbulence_class,
            seed=seed,
            duration=duration,
            time_step=time_step,
            grid=grid,
            width=width,
            turbulence=turbulence,
            turbine_class=turbine_class,
            scaling=scaling,
            spectrum_of=spectrum_of,
        )
        return _made_box(parameters, bool(cache))

    @classmethod
    def from_bts(cls, path: str | os.PathLike[str], *, remove_profile: bool = False) -> TurbulenceBox:
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
        content = bts.read(path)
        fluctuation, tower = content.grid, content.tower
        if remove_profile:
            fluctuation = fluctuation - fluctuation.mean(axis=0, dtype=np.float64).astype(np.float32)
            tower = tower - tower.mean(axis=0, dtype=np.float64).astype(np.float32)
        else:
            hub_velocity = np.array([content.mean_speed, 0.0, 0.0], dtype=np.float32)
            fluctuation, tower = fluctuation - hub_velocity, tower - hub_velocity
        return cls(
            fluctuation=fluctuation,
            time_step=content.time_step,
            spacing_y=content.spacing_y,
            spacing_z=content.spacing_z,
            z_bottom=content.z_bottom,
            mean_speed=content.mean_speed,
            hub_height=content.hub_height,
            periodic=content.periodic,
            holds_profile=not remove_profile,
            tower=tower,
            description=content.description,
        )

    def to_bts(self, path: str | os.PathLike[str], steady: SteadyInflow | None = None) -> None:
        """Write a TurbSim full-field file (``.bts``).

        Parameters
        ----------
        path
            The file; replaced if it exists.
        steady
            Mean profile to add, by default uniform at ``mean_speed``. Its yaw misalignment and inclination turn
            the whole field and have no place in the file: they must be zero.
        """
        if steady is None:
            steady = SteadyInflow(self.mean_speed, self.hub_height)
        self.require_fitting(steady)
        if self.y_center != 0.0:
            raise InflowError(f"a .bts file is centered on the tower: y_center must be 0; got {self.y_center:g} m")
        if steady.yaw_misalignment != 0.0 or steady.inclination != 0.0:
            raise InflowError("a .bts file is aligned with the wind: yaw_misalignment and inclination must be zero")
        points = np.zeros((self.z.size, self.y.size, 3))
        points[..., 1] = self.y
        points[..., 2] = self.z[:, None]
        tower_points = np.zeros((self._tower.shape[1], 3))
        tower_points[:, 2] = self.z_bottom - self.spacing_z * np.arange(self._tower.shape[1])
        content = bts.BtsContent(
            grid=self.scale * self.fluctuation + steady.velocity(points, 0.0).astype(np.float32),
            tower=self.scale * self._tower + steady.velocity(tower_points, 0.0).astype(np.float32),
            time_step=self.time_step,
            spacing_y=self.spacing_y,
            spacing_z=self.spacing_z,
            z_bottom=self.z_bottom,
            mean_speed=self.mean_speed,
            hub_height=self.hub_height,
            periodic=self.periodic,
            description=self.description,
        )
        bts.write(path, content)

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
    def y(self) -> NDArray[np.float64]:
        """Lateral positions of the columns [m], shape (n_y,)."""
        n = self.fluctuation.shape[2]
        out: NDArray[np.float64] = self.y_center + self.spacing_y * (np.arange(n) - 0.5 * (n - 1))
        return out

    @property
    def z(self) -> NDArray[np.float64]:
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
        same_samples = np.array_equal(self.fluctuation, other.fluctuation) and np.array_equal(self._tower, other._tower)
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
    """Return a read-only, contiguous float32 array; a copy unless it is one already."""
    array = np.asarray(samples)
    if array.dtype != np.float32 or not array.flags.c_contiguous or array.flags.writeable:
        array = np.array(samples, dtype=np.float32, order="C")
    if not np.isfinite(array).all():
        raise InflowError(f"{name} must be finite everywhere")
    array.setflags(write=False)
    return array


@lru_cache(maxsize=_BOXES_IN_MEMORY)
def _made_box(parameters: KaimalParameters | MannParameters, use_disk: bool) -> TurbulenceBox:
    fluctuation = box_cache.load(parameters) if use_disk else None
    if fluctuation is None:
        if isinstance(parameters, MannParameters):
            fluctuation = synthesize_mann(parameters)
        else:
            fluctuation = synthesize(parameters)
        if use_disk:
            box_cache.store(parameters, fluctuation)
    fluctuation.setflags(write=False)
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
