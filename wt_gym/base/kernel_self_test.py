"""Two small kernels that tell whether the linked way to compile works with the numba that is installed."""

from functools import partial

import numpy as np

from wt_gym.base.compiled import was_compiled
from wt_gym.base.kernel_linking import linked_kernel

__all__ = ["self_test"]


@partial(linked_kernel, separate=True, distinct=True, options={})
def leaf(x: np.ndarray, factor: float, out: np.ndarray) -> float:
    """Multiply and add."""
    total = 0.0
    for i in range(x.shape[0]):
        out[i] = factor * x[i]
        total += out[i]
    return total


@partial(linked_kernel, separate=False, distinct=False, options={})
def branch(x: np.ndarray, factor: float, out: np.ndarray) -> float:
    """Call the separate kernel, read backwards what it wrote."""
    total: float = leaf(x, factor, out)
    for i in range(x.shape[0]):
        total += out[x.shape[0] - 1 - i] * i
    return total


def self_test() -> str | None:
    """Compile, keep and run them.

    Returns
    -------
    str or None
        What is wrong.
    """
    x, out = np.arange(5.0), np.zeros(5)
    found, expected = branch(x, 2.0, out), 20.0 + 20.0
    if found != expected or out.tolist() != [0.0, 2.0, 4.0, 6.0, 8.0]:
        return f"a test kernel gives {found} and {out.tolist()}, must give {expected} and twice {x.tolist()}"
    if not all(was_compiled(kernel) and kernel._cache.kept() for kernel in (leaf, branch, branch.from_python)):
        return "the test kernels are not kept on disk"
    return None
