"""Work arrays that begin at a cache line and share none with another array."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from typing import Any

    from numpy.typing import DTypeLike, NDArray

__all__ = ["aligned_zeros"]

LINES = 128
"""Bytes that the processor fetches together: two cache lines."""


def aligned_zeros(shape: int | tuple[int, ...], dtype: DTypeLike = np.float64) -> NDArray[Any]:
    """Zeros of a shape and type, in C order, in cache lines of their own.

    Vectors of 16 float32 numbers then lie in one cache line each, and threads do not wait for each other's writes.

    Parameters
    ----------
    shape : int or tuple of int
    dtype : data type

    Returns
    -------
    ndarray
    """
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    memory = np.zeros(size + 2 * LINES, dtype=np.uint8)
    first = -memory.ctypes.data % LINES
    return memory[first : first + size].view(dtype).reshape(shape)
