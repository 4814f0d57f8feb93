"""Snapshots of a simulation: plain arrays that can be copied, compared, saved and restored."""

from dataclasses import dataclass

import numpy as np

from wt_gym.errors import SimulationError

__all__ = ["SimulatorState"]


@dataclass(frozen=True, eq=False)
class SimulatorState:
    """Every number a simulation needs to continue bit for bit.

    Attributes
    ----------
    arrays : dict of str to array
        Own copies.
    n_steps : int
        Aerodynamic steps since the start.
    """

    arrays: dict
    n_steps: int

    @classmethod
    def take(cls, arrays, n_steps):
        """Copy the given arrays."""
        return cls({key: np.array(a) for key, a in arrays.items()}, int(n_steps))

    def put(self, arrays):
        """Write the snapshot back into arrays of the same names and shapes."""
        if set(arrays) != set(self.arrays) or any(arrays[k].shape != a.shape for k, a in self.arrays.items()):
            raise SimulationError("the snapshot belongs to a simulator with another turbine or fidelity")
        for key, array in arrays.items():
            array[...] = self.arrays[key]

    def __eq__(self, other):
        if not isinstance(other, SimulatorState):
            return NotImplemented
        same = self.n_steps == other.n_steps and set(self.arrays) == set(other.arrays)
        return same and all(np.array_equal(a, other.arrays[k], equal_nan=True) for k, a in self.arrays.items())

    __hash__ = None

    def save(self, path):
        """Write to a compressed .npz file (plain numbers, no pickle)."""
        np.savez_compressed(path, n_steps=self.n_steps, **self.arrays)

    @classmethod
    def load(cls, path):
        """Read a file written by :meth:`save`."""
        with np.load(path, allow_pickle=False) as data:
            return cls({key: data[key] for key in data.files if key != "n_steps"}, int(data["n_steps"]))
