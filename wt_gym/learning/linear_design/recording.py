"""Runs of a base controller with and without drawn offsets of the pitch: what a plant is identified from."""

from __future__ import annotations

import json
import math
import zipfile
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from wt_gym.analysis.results import Wind
from wt_gym.base.canary import differing
from wt_gym.base.files import whole_file
from wt_gym.control.controllers import make_controller
from wt_gym.control.controllers.controller import Combined, parts_of
from wt_gym.control.controllers.linear_optimal import PitchOffsets, recorded_outputs, side_sign
from wt_gym.experiment.comparison import inflow_of
from wt_gym.experiment.run import run_controller
from wt_gym.experiment.store import run_digest
from wt_gym.simulation import Simulator

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from wt_gym.control.actions import Demand
    from wt_gym.control.controllers.controller import Readings
    from wt_gym.turbines import Turbine

__all__ = ["LOADS", "DrawnOffsets", "Excitation", "Recording", "RecordingStore", "record"]

_R = TypeVar("_R")
LOADS = ("tower_fore_aft", "tower_side_side", "power")
"""Loads that a controller does not read [N m], and the power of the generator [W]."""


@dataclass(frozen=True)
class Excitation:
    """Offsets drawn for an identification: levels that are held, evenly drawn, for times drawn evenly in the logarithm.

    They are small, and a level of the mean is followed by its opposite for as long: so the azimuth stays near that of
    the run without offsets, and blades meet the same eddies.

    Attributes
    ----------
    mean, tilt_yaw : float
        Greatest level of the mean, and of tilt and of yaw [rad].
    shortest, longest : float
        Time that a level is held [s].
    """

    mean: float = math.radians(0.2)
    tilt_yaw: float = math.radians(0.6)
    shortest: float = 0.2
    longest: float = 5.0

    def __post_init__(self) -> None:
        if not (self.mean >= 0.0 and self.tilt_yaw >= 0.0 and 0.0 < self.shortest <= self.longest):
            raise ValueError(f"an excitation must have levels of at least 0 and rising positive times, got {self}")

    def draw(self, steps: int, dt: float, seed: int) -> NDArray[np.float64]:
        """Levels (3, steps) of mean, tilt and yaw [rad]."""
        rng = np.random.default_rng(seed)
        out = np.zeros((3, steps))
        for which, size in enumerate((self.mean, self.tilt_yaw, self.tilt_yaw)):
            row, k = out[which], 0
            while k < steps:
                held = math.exp(rng.uniform(math.log(self.shortest), math.log(self.longest)))
                n, level = max(round(held / dt), 1), size * rng.uniform(-1.0, 1.0)
                row[k : k + n] = level
                k += n
                if which == 0:
                    row[k : k + n] = -level
                    k += n
        return out


class DrawnOffsets:
    """Addition that plays offsets and remembers what reached the drives.

    Parameters
    ----------
    offsets : PitchOffsets
    levels : numpy.ndarray, shape (3, n)
        [rad]; after the last there are none.
    """

    channels = ("azimuth", "rotor_speed")

    def __init__(self, offsets: PitchOffsets, levels: NDArray[np.float64]) -> None:
        self.offsets, self.levels = offsets, levels
        self.acting: list[tuple[float, float, float]] = []
        self.share: list[float] = []

    def start(self, signals: Readings) -> None:
        """Begin with the first level."""
        self.offsets.start()
        self.acting, self.share = [], []

    def step(self, signals: Readings, dt: float, demand: Demand) -> Demand:
        """Add the offsets of this step."""
        k = len(self.acting)
        share = self.offsets.update_share(demand, signals["rotor_speed"], dt)
        level = self.levels[:, k] if k < self.levels.shape[1] else np.zeros(3)
        changed = self.offsets.added((share * level).tolist(), demand, signals["azimuth"], signals["rotor_speed"], dt)
        self.acting.append(self.offsets.acting)
        self.share.append(share)
        return changed


@dataclass(frozen=True)
class Recording:
    """A run, sample k at the instant at which offset k was decided; the last sample has no offset any more.

    Attributes
    ----------
    dt : float
        [s].
    outputs : numpy.ndarray, shape (6, n + 1)
        `OUTPUTS` of `wt_gym.control.controllers.linear_optimal`.
    loads : numpy.ndarray, shape (3, n + 1)
        `LOADS`.
    flap, edge, pitch : numpy.ndarray, shape (n_blades, n + 1)
        Root moments [N m], pitch [rad].
    azimuth : numpy.ndarray, shape (n + 1,)
        [rad].
    offsets : numpy.ndarray, shape (3, n)
        That reached the drives [rad].
    share : numpy.ndarray, shape (n,)
        In which offsets may act.
    """

    dt: float
    outputs: NDArray[np.float64]
    loads: NDArray[np.float64]
    flap: NDArray[np.float64]
    edge: NDArray[np.float64]
    pitch: NDArray[np.float64]
    azimuth: NDArray[np.float64]
    offsets: NDArray[np.float64]
    share: NDArray[np.float64]

    @classmethod
    def of_channels(
        cls,
        channels: Mapping[str, NDArray[np.float64]],
        turbine: Turbine,
        dt: float,
        offsets: NDArray[np.float64],
        share: NDArray[np.float64],
    ) -> Recording:
        """Recording of signals by name.

        Parameters
        ----------
        channels : mapping
            Of names to arrays, shape (n + 1,).
        turbine : Turbine
        dt, offsets, share
            As the attributes.
        """
        sign = side_sign(turbine)

        def of_blades(name: str) -> NDArray[np.float64]:
            return np.stack([channels[f"{name}_{b + 1}"] for b in range(turbine.n_blades)])

        return cls(
            dt=dt,
            outputs=recorded_outputs(channels, turbine.n_blades, sign),
            loads=np.stack([
                channels["tower_base_fore_aft_moment"],
                sign * channels["tower_base_side_side_moment"],
                channels["generator_power"],
            ]),
            flap=of_blades("root_flap_moment"),
            edge=of_blades("root_edge_moment"),
            pitch=of_blades("pitch"),
            azimuth=channels["azimuth"],
            offsets=offsets,
            share=share,
        )  # fmt: skip

    @property
    def steps(self) -> int:
        """N."""
        return int(self.offsets.shape[1])


class RecordingStore(Generic[_R]):
    """Folder of recordings, one file each, found by the digest of what defines it.

    Parameters
    ----------
    folder : path
    kind : type
        Dataclass of the recordings, of numbers and arrays.
    """

    def __init__(self, folder: Path, kind: type[_R]) -> None:
        self.folder, self._kind = folder, kind

    def file(self, definition: dict[str, Any]) -> Path:
        """Where a recording stands, or would."""
        return self.folder / f"{run_digest(definition)}.npz"

    def find(self, definition: dict[str, Any]) -> _R | None:
        """Return a recording; None if it has not been made, or by a version of the package with another behavior.

        Raises
        ------
        ValueError
            If its file is damaged.
        """
        file = self.file(definition)
        if not file.exists():
            return None
        try:
            with np.load(file, allow_pickle=False) as found:
                fingerprint = json.loads(str(found["fingerprint"]))
                arrays = {part.name: found[part.name] for part in fields(self._kind)}  # type: ignore[arg-type]
        except (KeyError, ValueError, EOFError, zipfile.BadZipFile) as error:
            raise ValueError(f"{file} is damaged: {error}; remove it to have the run made again") from error
        if differing(fingerprint, definition["fingerprint"]):
            return None
        return self._kind(**{name: array if array.ndim else array.item() for name, array in arrays.items()})

    def keep(self, definition: dict[str, Any], recording: _R) -> None:
        """Write a recording: there is all of it or nothing."""
        self.folder.mkdir(parents=True, exist_ok=True)
        names = [part.name for part in fields(self._kind)]  # type: ignore[arg-type]
        arrays: dict[str, Any] = {name: np.asarray(getattr(recording, name)) for name in names}
        with whole_file(self.file(definition)) as partial, partial.open("wb") as file:
            np.savez(file, fingerprint=json.dumps(definition["fingerprint"]), **arrays)


def record(
    turbine: Turbine,
    base: str,
    wind_speed: float,
    seed: int,
    duration: float,
    offsets: PitchOffsets,
    drawn: tuple[Excitation, int] | None = None,
    fidelity: str | None = None,
) -> Recording:
    """Run a base controller in a wind, with offsets or without.

    Parameters
    ----------
    turbine : Turbine
    base : str
        As `make_controller` takes it.
    wind_speed : float
        [m/s].
    seed : int
        Of the turbulence.
    duration : float
        [s].
    offsets : PitchOffsets
        Is started.
    drawn : (Excitation, int), optional
        What offsets are drawn from, and with which seed; by default there are none.
    fidelity : str, optional
        As of the simulator.

    Raises
    ------
    wt_gym.base.errors.SimulationError
        If the simulation fails.
    """
    simulator = Simulator(turbine, inflow_of(turbine, Wind(wind_speed, seed)), fidelity)
    levels = np.zeros((3, 0))
    if drawn is not None:
        excitation, own_seed = drawn
        levels = excitation.draw(round(duration / simulator.time_step), simulator.time_step, own_seed)
    controller = make_controller(base, turbine)
    played = DrawnOffsets(offsets, levels)
    parts = parts_of(controller)
    combined = Combined(parts[0], *parts[1:], played)  # type: ignore[arg-type]  # the first part is a controller
    data = run_controller(simulator, combined, duration).to_dataset()
    channels = {str(name): data[name].values.astype(float) for name in data.data_vars}
    return Recording.of_channels(
        channels, turbine, simulator.time_step, np.array(played.acting).T, np.array(played.share)
    )
