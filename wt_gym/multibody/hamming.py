"""The modified Hamming predictor–corrector scheme on a multibody system."""

from collections import namedtuple

import numpy as np

from wt_gym.multibody import integrator_kernels, tree_kernels
from wt_gym.multibody.errors import FAILURES, MultibodyError

__all__ = ["HammingIntegrator", "new_history"]

HammingHistory = namedtuple("HammingHistory", "y f error filled")
STARTERS = {"adams": 0, "runge-kutta": -3}
"""What ``filled`` of an empty history is."""


def new_history(n):
    """Empty history of the Hamming scheme for a state of length n."""
    return HammingHistory(np.zeros((4, n)), np.zeros((4, n)), np.zeros(n), np.zeros(1, dtype=np.int64))


class HammingIntegrator:
    """The modified Hamming scheme on a system, with its history.

    Parameters
    ----------
    system : MultibodySystem
    step : float
        Step length [s].
    n_corrections : int
        Corrector passes a step; three make the scheme usable on an undamped structure (up to ω h ≈ 1).
    starter : {"adams", "runge-kutta"}
        Of the first three steps. "adams", the default, are the published starters (modified Euler, two- and three-step
        Adams–Moulton); the first leaves an error of order h³, which is then the order of a run that does not start at
        rest. "runge-kutta" takes the classical scheme of fourth order at the same cost: a run is then as exact as one
        from exact starting values.

    Raises
    ------
    MultibodyError
        For a step that is not positive or an unknown starter.
    """

    def __init__(self, system, step, n_corrections=3, starter="adams"):
        if not step > 0.0:
            raise MultibodyError(f"integration step must be positive, got {step}")
        if starter not in STARTERS:
            raise MultibodyError(f"starter {starter!r} is unknown; allowed: {', '.join(STARTERS)}")
        self.system, self.step, self.n_corrections = system, float(step), int(n_corrections)
        self.starter = starter
        self.work, self.inputs = system.new_work(), system.new_inputs()
        self.history = new_history(system.n_state)

    def start(self, y):
        """Begin at the state y; the starters run again."""
        self.history.y[3] = y
        self.history.error[:] = 0.0
        self.history.filled[0] = STARTERS[self.starter]
        self.history.f[3] = self.system.rates(y, self.inputs, self.work)

    @property
    def state(self):
        """Current state (n_state,), a view."""
        return self.history.y[3]

    @property
    def state_rate(self):
        """Current dy/dt (n_state,), a view."""
        return self.history.f[3]

    def advance(self, n_steps=1):
        """Take n_steps with the inputs running linearly from ``inputs[…][0]`` to ``inputs[…][1]``.

        Raises
        ------
        MultibodyError
            When the mass matrix is singular or the state diverges.
        """
        code = integrator_kernels.hamming_advance(
            self.history, self.inputs, self.system.tree, self.work, self.step, int(n_steps), self.n_corrections,
            self.system.constrained,
        )  # fmt: skip
        if code in (tree_kernels.DIVERGED, tree_kernels.SINGULAR_MASS):
            # the mass matrix was sound at the start: a diverging state spoils it before its numbers overflow
            raise MultibodyError(f"{FAILURES[tree_kernels.DIVERGED]} (step {self.step} s)")
        if code != tree_kernels.OK:
            raise MultibodyError(FAILURES[code])
