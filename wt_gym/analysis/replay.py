"""The last seconds of a run as shapes of blades, tower and wake, small enough for a page."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.base.files import write_whole

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

__all__ = ["Replay", "ReplayRecorder", "kept_filaments", "trailing_strength"]

# A wake is thinned to this many rows and filaments a blade, which keeps a replay of 20 s below 1 MB.
_MOST_ROWS, _MOST_FILAMENTS = 64, 5


def trailing_strength(circulation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Circulation of the trailing filaments between rings side by side.

    Parameters
    ----------
    circulation : numpy.ndarray, shape (n_rows, n_blades, n_span)
        Of the wake's rings [m^2/s].

    Returns
    -------
    numpy.ndarray, shape (n_rows, n_blades, n_span + 1)
        Magnitude of the difference across each filament [m^2/s].
    """
    padded = np.pad(np.asarray(circulation, dtype=np.float64), ((0, 0), (0, 0), (1, 1)))
    return np.abs(np.diff(padded, axis=2))


@dataclass(frozen=True)
class Replay:
    """Shapes over time, global frame, meters.

    Attributes
    ----------
    time : numpy.ndarray, shape (n,)
        [s]
    blades : numpy.ndarray, shape (n, n_blades, 2, n_span + 1, 3)
        Leading and trailing edges.
    wake : numpy.ndarray, shape (n, n_rows, n_blades, n_filaments, 3)
        Nodes of trailing filaments, the newest row first; NaN where the wake is shorter.
    strength : numpy.ndarray, shape (n, n_rows, n_blades, n_filaments)
        Size of the filaments' circulation [m^2/s].
    tower : numpy.ndarray, shape (n, n_tower, 3)
        Axis, from the ground up.
    tower_radius : numpy.ndarray, shape (n_tower,)
    hub : numpy.ndarray, shape (n, 3)
    """

    time: NDArray[np.float64]
    blades: NDArray[np.float64]
    wake: NDArray[np.float64]
    strength: NDArray[np.float64]
    tower: NDArray[np.float64]
    tower_radius: NDArray[np.float64]
    hub: NDArray[np.float64]

    def save(self, path: Path) -> None:
        """Write a compressed NumPy archive, which is there when it is whole."""
        shapes = {f.name: getattr(self, f.name) for f in fields(self)}
        write_whole(path, lambda file: np.savez_compressed(file, **shapes))

    @classmethod
    def load(cls, path: Path) -> Replay:
        """Read what `save` wrote."""
        with np.load(path) as arrays:
            return cls(**{f.name: arrays[f.name] for f in fields(cls)})


class ReplayRecorder:
    """Keeps the shapes of the last seconds while a simulation runs.

    Parameters
    ----------
    n_frames : int
        Number of instants to keep.
    """

    def __init__(self, n_frames: int):
        self._frames: deque[tuple[float, dict[str, NDArray[np.float64]]]] = deque(maxlen=n_frames)

    def append(self, time: float, geometry: Mapping[str, NDArray[np.float64]]) -> None:
        """Keep an instant.

        Parameters
        ----------
        time : float
            [s]
        geometry : mapping
            As given by ``Simulator.geometry()``.
        """
        self._frames.append((time, _thinned(geometry)))

    def to_replay(self) -> Replay | None:
        """What is kept, None if nothing is."""
        if not self._frames:
            return None
        times, shapes = zip(*self._frames, strict=True)
        n_rows = max(len(shape["wake"]) for shape in shapes)
        stacked = {
            name: np.stack([_padded(shape[name], n_rows) if name in ("wake", "strength") else shape[name]
                            for shape in shapes])
            for name in ("blades", "wake", "strength", "tower", "hub")
        }  # fmt: skip
        return Replay(time=np.array(times), tower_radius=shapes[0]["tower_radius"], **stacked)


def _thinned(geometry: Mapping[str, NDArray[np.float64]]) -> dict[str, NDArray[np.float64]]:
    """Shapes of an instant as single-precision numbers, the wake with fewer rows and filaments."""
    wake, rings = np.asarray(geometry["wake"]), trailing_strength(geometry["wake_circulation"])
    strength = np.zeros(wake.shape[:3])
    strength[: len(rings)] = rings
    if len(rings):  # one ring less than rows of nodes: the last node ends the last ring
        strength[len(rings) :] = rings[-1]
    rows = np.unique(np.linspace(0, len(wake) - 1, min(len(wake), _MOST_ROWS)).round().astype(int))
    filaments = kept_filaments(wake.shape[2])
    shapes = {
        "blades": np.asarray(geometry["blades"])[:, [0, -1]],
        "wake": wake[rows][:, :, filaments],
        "strength": strength[rows][:, :, filaments],
        "tower": geometry["tower"],
        "tower_radius": geometry["tower_radius"],
        "hub": geometry["hub"],
    }
    return {name: np.array(values, dtype=np.float32) for name, values in shapes.items()}


def kept_filaments(n_filaments: int) -> NDArray[np.int_]:
    """Filaments of a blade that a replay keeps, from root to tip, closer to each other towards the tip.

    Parameters
    ----------
    n_filaments : int

    Returns
    -------
    numpy.ndarray of int, shape (n,)
        The first and the last among them.
    """
    if n_filaments <= _MOST_FILAMENTS:
        return np.arange(n_filaments)
    places = (n_filaments - 1) * np.sin(np.linspace(0.0, 0.5 * np.pi, _MOST_FILAMENTS))
    return np.unique(places.round().astype(int))


def _padded(values: NDArray[np.float32], n_rows: int) -> NDArray[np.float32]:
    """Array with rows of NaN behind it."""
    missing = np.full((n_rows - len(values), *values.shape[1:]), np.nan, dtype=values.dtype)
    return np.concatenate([values, missing])
