"""What becomes of the jobs of a sweep."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

__all__ = ["ATTEMPTS", "ONE_THREAD", "Tally"]

ATTEMPTS = 3
"""Times that a job is begun whose process ends each time."""
ONE_THREAD = {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
"""Environment of a process that computes in one thread; read when it imports numpy and numba."""


@dataclass
class Tally:
    """What became of the jobs of a sweep.

    A job whose simulation diverged is done: that is its result. What counts here is what happens to processes and
    machines.

    Attributes
    ----------
    done : int
        Jobs with a result.
    retried : int
        Times that a job was begun again because the process or the machine that did it was gone.
    lost : list
        Jobs given up after `ATTEMPTS` of these.
    """

    done: int = 0
    retried: int = 0
    lost: list[Any] = field(default_factory=list)

    def may_retry(self, job: Any, attempt: int) -> bool:
        """Whether a job whose process is gone is to be begun once more; counts it."""
        if attempt < ATTEMPTS:
            self.retried += 1
            return True
        self.lost.append(job)
        return False

    def raise_lost(self) -> None:
        """Say that jobs were lost.

        Raises
        ------
        ChildProcessError
            If there are any.
        """
        if self.lost:
            raise ChildProcessError(
                f"{len(self.lost)} of {self.done + len(self.lost)} jobs were lost: {ATTEMPTS} times the process that "
                "did them has ended; was there too little memory for so many at a time? what was done is kept"
            )
