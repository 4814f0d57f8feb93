"""Snapshots of a simulation: plain arrays that can be copied, compared, saved and restored."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, fields, is_dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from wt_gym.base.errors import SimulationError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from os import PathLike

    from numpy.typing import NDArray

__all__ = ["SimulatorState", "fingerprint"]


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
    """Every number a simulation needs to continue bit for bit.

    Attributes
    ----------
    arrays : dict of str to array
        Own copies.
    n_steps : int
        Aerodynamic steps since the start.
    model : str
        Fingerprint of the simulator's turbine and fidelity.
    """

    arrays: dict[str, NDArray[Any]]
    n_steps: int
    model: str

    @classmethod
    def take(cls, arrays: Mapping[str, NDArray[Any]], n_steps: int, model: str) -> SimulatorState:
        """Copy the given arrays."""
        return cls({key: np.array(a) for key, a in arrays.items()}, int(n_steps), model)

    def put(self, arrays: Mapping[str, NDArray[Any]], model: str) -> None:
        """Write the snapshot back into the arrays of a simulator with the same fingerprint.

        Raises
        ------
        SimulationError
            When turbine or fidelity differ.
        """
        same = set(arrays) == set(self.arrays) and all(arrays[k].shape == a.shape for k, a in self.arrays.items())
        if self.model != model or not same:
            raise SimulationError("the snapshot belongs to a simulator with another turbine or fidelity")
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
