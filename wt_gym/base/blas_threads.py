"""Linear algebra on one thread.

With several threads, products of large matrices are rounded differently, so runs are not repeatable. On busy cores the
threads also wait for each other, a thousand times as long as the factorization of a small matrix takes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np  # noqa: F401
import scipy.linalg  # noqa: F401
from threadpoolctl import ThreadpoolController

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

# NumPy and SciPy are imported above so that their libraries are loaded when they are looked up here.
_LIBRARIES = ThreadpoolController().select(user_api="blas")


def one_blas_thread() -> AbstractContextManager[Any]:
    """Limit the BLAS libraries of NumPy and SciPy to one thread each; at the end they have as many as before.

    The limit holds from the call on, so use it in a ``with`` statement.

    The number belongs to the process or to the calling thread, which depends on how a library was built. So work that
    needs the limit takes it, and who starts threads with such work side by side holds it around them: otherwise the
    first of them to end sets the number back for the others.
    """
    limit: AbstractContextManager[Any] = _LIBRARIES.limit(limits=1)
    return limit
