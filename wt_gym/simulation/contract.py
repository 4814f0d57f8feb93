"""Contract of a simulator: `wt_gym.simulation.Simulator` or that of another code; snapshots of a simulation."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from os import PathLike
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wt_gym.base.errors import ActionError, SimulationError
from wt_gym.base.quantities import Array
from wt_gym.hydrodynamics.waves import WaveComponents
from wt_gym.simulation.channels import TOWER_TOP_PARITIES, Signals
from wt_gym.simulation.drivetrain.drives import Drives, check_finite
from wt_gym.simulation.drivetrain.faults import DriveFault
from wt_gym.simulation.fidelity import Fidelity
from wt_gym.turbines import Turbine
from wt_gym.turbines.variants import REFLECTION_6
from wt_gym.wind import Inflow, MirroredInflow
from wt_gym.wind.files import is_described, wind_from
from wt_gym.wind.inflow import require_cover

LARGEST_SWAY = 5.0
"""Motion across the wind and up and down that a rotor on a floater is left within the bounds of a wind [m]."""
WindChoice = Inflow | str | PathLike[str] | Mapping[str, Any]
"""A wind, or what describes one."""


class TurbineSimulator(Protocol):
    """A turbine in the wind, moved on under demands.

    Attributes
    ----------
    inflow : Inflow
        Undisturbed wind; may be exchanged before a reset.
    fidelity : Fidelity
        Its name goes into records; with ``formulation="constrained"`` there is `wt_gym.simulation.Simulator`'s
        ``root_multipliers`` too.
    faults : tuple of DriveFault
        What fails, and when; may be exchanged before a reset.
    time_step : float
        [s]; `advance` takes whole numbers of it.
    time : float
        Simulated time [s].
    """

    if TYPE_CHECKING:  # what only is read may be a property

        @property
        def turbine(self) -> Turbine: ...

        @property
        def fidelity(self) -> Fidelity: ...

        @property
        def time_step(self) -> float: ...

        @property
        def time(self) -> float: ...

        inflow: Inflow
        faults: tuple[DriveFault, ...]

    def reset(  # noqa: PLR0913
        self,
        rotor_speed: float,
        pitch: ArrayLike = 0.0,
        azimuth: float = 0.0,
        yaw: float = 0.0,
        generator_torque: float | None = None,
        tower_top: ArrayLike | None = None,
        wake_thrust: float | None = None,
        motion: ArrayLike | None = None,
        platform: ArrayLike | None = None,
    ) -> Signals:
        """Start at time zero near a steady state; arguments as of `wt_gym.simulation.Simulator.reset`.

        A simulator may leave ``tower_top``, ``wake_thrust``, ``motion`` and ``platform`` aside, which say how the
        turbine ran before.

        Raises
        ------
        wt_gym.base.errors.SimulationError
            If there is no such start.
        """
        ...

    def advance(
        self, duration: float, pitch: ArrayLike, yaw_rate: float = 0.0, generator_torque: float = 0.0,
        accumulate: bool = False
    ) -> Signals:  # fmt: skip
        """Move on with constant demands; arguments as of `wt_gym.simulation.Simulator.advance`.

        Raises
        ------
        wt_gym.base.errors.SimulationError
            If the simulation fails; it must then be reset.
        """
        ...

    def state(self) -> Any:
        """Snapshot from which the simulation continues."""
        ...

    def restore(self, state: Any) -> None:
        """Continue from a snapshot of a simulator of the same turbine."""
        ...

    def geometry(self) -> Mapping[str, np.ndarray]:
        """Shapes for pictures, as of `wt_gym.simulation.Simulator.geometry`."""
        ...


SimulatorMaker: TypeAlias = "Callable[[Turbine, Inflow, str | Fidelity], TurbineSimulator]"
"""Makes a simulator of a turbine in a wind at a fidelity."""


class DrivenSimulator:
    """Base of the simulators whose drives are those of this package."""

    turbine: Turbine
    mirrored: bool
    drives: Drives
    time_step: float
    _n_steps: int
    _faults: tuple[DriveFault, ...] = ()
    _sea: WaveComponents | None = None

    @property
    def inflow(self) -> Inflow:
        """The undisturbed wind; it may be exchanged before a reset, also for the description of another one.

        Raises
        ------
        InflowError
            If a description is wrong, or the rotor reaches beyond the grid of a turbulence box.
        """
        return self._inflow

    @inflow.setter
    def inflow(self, inflow: WindChoice | None) -> None:
        turbine = self.turbine
        if is_described(inflow):
            inflow = wind_from(inflow, turbine.hub_height, turbine.rotor_diameter)
        if isinstance(inflow, str | PathLike | Mapping | None) or not callable(getattr(inflow, "velocity", None)):
            raise SimulationError(
                f"{type(self).__name__} needs an inflow with velocity(points, time), for example "
                f"wt_gym.wind.SteadyInflow(8.0), got {inflow!r:.100}"
            )
        sway = 0.0 if turbine.floater is None else 2.0 * LARGEST_SWAY
        require_cover(inflow, turbine.hub_height, turbine.rotor_diameter + sway)
        self._inflow = inflow
        self._felt = MirroredInflow.of(inflow) if self.mirrored else inflow  # by the image that is simulated

    @property
    def sea(self) -> WaveComponents | None:
        """Waves that a floating turbine meets, None for still water; they may be exchanged before a reset.

        Raises
        ------
        SimulationError
            If the turbine does not float, or for something else than `wt_gym.hydrodynamics.waves.WaveComponents`.
        """
        return self._sea

    @sea.setter
    def sea(self, sea: WaveComponents | None) -> None:
        if sea is not None and not isinstance(sea, WaveComponents):
            raise SimulationError(
                f"sea must be None or wave components, as SeaState.components gives them, got {sea!r:.100}"
            )
        if sea is not None and self.turbine.floater is None:
            raise SimulationError(f"sea must be None for {self.turbine.name!r}, which does not float")
        self._sea = sea

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._n_steps * self.time_step

    @property
    def faults(self) -> tuple[DriveFault, ...]:
        """What fails, and when."""
        return self._faults

    @faults.setter
    def faults(self, faults: Iterable[DriveFault]) -> None:
        self._faults = ()
        faults = tuple(faults)
        self.drives.fail(faults, lambda: self.time)
        self._faults = faults

    def _checked_tower_top(self, tower_top: ArrayLike | None) -> Array | None:
        """Displacement and rates of the tower top of the image that is simulated (4,)."""
        if tower_top is None:
            return None
        tower_top = np.asarray(tower_top, dtype=float)
        if tower_top.shape != (4,) or not np.isfinite(tower_top).all():
            raise ActionError(f"tower_top must be 4 finite numbers, m and m/s, got {tower_top!r:.100}")
        return tower_top * TOWER_TOP_PARITIES if self.mirrored else tower_top

    def _checked_platform(self, platform: ArrayLike | None) -> Array | None:
        """Slow motion of the platform of the image that is simulated (12,)."""
        if platform is None:
            return None
        platform = np.asarray(platform, dtype=float)
        if self.turbine.floater is None or platform.shape != (12,) or not np.isfinite(platform).all():
            raise ActionError(f"platform must be 12 finite numbers of a turbine that floats, got {platform!r:.100}")
        if np.abs(platform[3:6]).max() > 1.0:
            raise ActionError(f"angles of platform must be from -1 to 1 rad, got {platform[3:6].tolist()}")
        return platform * np.tile(REFLECTION_6, 2) if self.mirrored else platform

    def _steps_in(self, duration: float, **demands: float) -> int:
        """Number of time steps in a duration [s], of which there must be a whole number; demands must be finite."""
        check_finite(duration=duration, **demands)
        n = round(duration / self.time_step)
        if n < 1 or abs(n * self.time_step - duration) > 1e-6 * self.time_step:
            raise ActionError(f"duration {duration} s is not a whole number of time steps of {self.time_step} s")
        return n


def fingerprint(*parts: object) -> str:
    """Digest of nested dataclasses, arrays and plain values: equal content gives an equal text."""
    digest = hashlib.sha256()

    def feed(value: object) -> None:
        if is_dataclass(value) and not isinstance(value, type):
            digest.update(type(value).__name__.encode())
            for f in fields(value):
                digest.update(f.name.encode())
                feed(getattr(value, f.name))
        elif isinstance(value, np.ndarray):
            digest.update(str(value.shape).encode() + value.tobytes())
        elif isinstance(value, (tuple, list)):
            for item in value:
                feed(item)
        else:
            digest.update(repr(value).encode())

    for part in parts:
        feed(part)
    return digest.hexdigest()


@dataclass(frozen=True, eq=False)
class SimulatorState:
    """Every number a simulation needs to continue bit for bit."""

    arrays: dict[str, NDArray[Any]]  #: Own copies
    n_steps: int  #: Aerodynamic steps since the start
    model: str  #: Fingerprint of the simulator's turbine, fidelity and sea

    @classmethod
    def take(cls, arrays: Mapping[str, NDArray[Any]], n_steps: int, model: str) -> SimulatorState:
        """Copy the given arrays."""
        return cls({key: np.array(a) for key, a in arrays.items()}, int(n_steps), model)

    def put(self, arrays: Mapping[str, NDArray[Any]], model: str) -> None:
        """Write the snapshot back into the arrays of a simulator with the same fingerprint.

        Raises
        ------
        SimulationError
            When turbine, fidelity or sea differ.
        """
        same = set(arrays) == set(self.arrays) and all(arrays[k].shape == a.shape for k, a in self.arrays.items())
        if self.model != model or not same:
            raise SimulationError("the snapshot belongs to a simulator with another turbine, fidelity or sea")
        for key, array in arrays.items():
            array[...] = self.arrays[key]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, SimulatorState):
            return NotImplemented
        same = (self.n_steps, self.model) == (other.n_steps, other.model) and set(self.arrays) == set(other.arrays)
        return same and all(np.array_equal(a, other.arrays[k], equal_nan=True) for k, a in self.arrays.items())

    __hash__: ClassVar[Any] = None

    def save(self, path: str | PathLike[str]) -> None:
        """Write to a compressed .npz file (plain numbers, no pickle)."""
        members: dict[str, Any] = {"n_steps": self.n_steps, "model": self.model, **self.arrays}
        np.savez_compressed(path, **members)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> SimulatorState:
        """Read a file written by :meth:`save`."""
        with np.load(path, allow_pickle=False) as data:
            arrays = {key: data[key] for key in data.files if key not in ("n_steps", "model")}
            return cls(arrays, int(data["n_steps"]), str(data["model"]))
