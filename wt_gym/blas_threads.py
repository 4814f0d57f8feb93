"""Linear algebra on one thread.

Several threads round products of large matrices otherwise, so that no run is repeatable, and where the cores have other
work they wait for one another a thousand times as long as the factorization of a small matrix takes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np  # noqa: F401  a limit is one of the libraries that are loaded when the controller is made:
import scipy.linalg  # noqa: F401  those of both
from threadpoolctl import ThreadpoolController

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

__all__ = ["one_blas_thread"]

_LIBRARIES = ThreadpoolController().select(user_api="blas")


def one_blas_thread() -> AbstractContextManager[Any]:
    """Limit the BLAS libraries of NumPy and SciPy to one thread each; at the end they have as many as before.

    The number belongs to the process or to the calling thread, which depends on how a library was built. So work that
    needs the limit takes it, and who starts threads with such work side by side holds it around them: otherwise the
    first of them to end sets the number back for the others.

    Returns
    -------
    context manager
    """
    limit: AbstractContextManager[Any] = _LIBRARIES.limit(limits=1)
    return limit
