"""The decorator of every compiled kernel: common options and a cache that notices changes in any kernel file.

numba checks a cached kernel only against the file in which it stands; a kernel compiled into the kernel of another
file would stay there in its old form. All kernels of the package therefore share one stamp made from all kernel files.
"""

import math
from functools import cache
from pathlib import Path

import numba

__all__ = ["compiled_for", "kernel"]

FASTMATH = {"contract", "arcp", "nsz", "reassoc"}
"""Never nnan or ninf: the checks for states that are not finite must keep their meaning."""


@cache
def _stamp():
    """Version of numba, modification time and size of all kernel files together."""
    stats = [path.stat() for path in sorted(Path(__file__).parent.rglob("*_kernels.py"))]
    return f"{numba.__version__} {math.fsum(s.st_mtime for s in stats)} {sum(s.st_size for s in stats)}"


def kernel(function=None, **options):
    """Compile a function on plain arrays.

    Reference counting is off (arrays live in the caller), which trebles the speed of functions that pass many arrays;
    a kernel can therefore not allocate.

    Parameters
    ----------
    function : callable
    **options
        Further options of ``numba.njit``. ``inline="always"`` suits a kernel with a single caller: it is then compiled
        once, not on its own and again within its caller.
    """
    if function is None:
        return lambda f: kernel(f, **options)
    defaults = {"cache": True, "error_model": "numpy", "fastmath": FASTMATH, "_nrt": False}
    dispatcher = numba.njit(**(defaults | options))(function)
    # in the place of the version, because numba reads an old file no further: it may name types that have moved since
    dispatcher._cache._cache_file._version = _stamp()
    return dispatcher


def compiled_for(function, arguments):
    """Compiled form of a kernel for the types of these arguments, to be called with arguments of the same types only.

    A call of the kernel itself looks up the type of each array it is given: 25 µs for two hundred of them.
    """
    return function.compile(tuple(numba.typeof(argument) for argument in arguments))
