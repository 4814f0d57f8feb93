"""The modified Hamming predictor–corrector scheme on a multibody system."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from wt_gym.multibody.checks import check_residuals, check_state
from wt_gym.multibody.errors import MultibodyError, failure_of_a_step
from wt_gym.multibody.integrators import integrator_kernels
from wt_gym.multibody.integrators.stability import check_hamming_step
from wt_gym.multibody.tree import tree_kernels

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from wt_gym.multibody.arrays import Inputs, System, Work

__all__ = ["Drift", "HammingIntegrator", "History", "Integrator", "checked_start", "new_history"]


class History(NamedTuple):
    """What an integration continues from, of one type for all schemes; n_v counts velocities and servos.

    The Hamming scheme keeps four points and no matrix, implicit schemes one point.
    """

    y: NDArray[np.float64]  # (n_points, n_state) states, newest last
    f: NDArray[np.float64]  # (n_points, n_state) their rates
    memory: NDArray[np.float64]
    # (n_state,) error estimate of the Hamming scheme; (n_v,) pseudo-accelerations of implicit ones, of the origins of
    # constrained free bodies in body axes
    counters: NDArray[np.int64]  # (1,) how many older points count; (3,) counters of the implicit schemes
    matrix: NDArray[np.float64]  # (n_v, n_v) factors of Newton's matrix
    pivot: NDArray[np.int64]  # (n_v,) its row exchanges


class Drift(NamedTuple):
    """What steps have drifted by before they were put back."""

    norm: float  # of quaternions, | |q| − 1 |
    position: float  # of constraint equations, |φ| [m, rad]
    velocity: float  # |φ̇| [m/s, rad/s]


STARTERS = {"adams": 0, "runge-kutta": -3}
"""What the counter of an empty history is."""


def new_history(n: int) -> History:
    """Empty history of the Hamming scheme for a state of length n."""
    points, count = np.zeros((4, n)), np.zeros(1, dtype=np.int64)
    return History(points, points.copy(), np.zeros(n), count, np.zeros((0, 0)), np.zeros(0, dtype=np.int64))


def checked_start(system: System, y: ArrayLike, inputs: Inputs, work: Work) -> NDArray[np.float64]:
    """A copy of the state y, put exactly onto the constraint equations that it satisfies nearly.

    Raises
    ------
    MultibodyError
        For a state without meaning, or one that is farther from the constraint equations than
        :data:`wt_gym.multibody.checks.CONSISTENT`.
    """
    state = check_state(system, y).copy()
    if system.constraints:
        system.rates(state, inputs, work)
        check_residuals(system, work.residual, work.residual_rate)
        system.project(state, inputs)
    return state


class Integrator:
    """What all integrators of a multibody system have: its arrays, the newest state, and the drift of the steps.

    Attributes
    ----------
    system : MultibodySystem
    step : float
        [s].
    inputs : Inputs
        What acts on the system.
    work : Work
        Kinematics of the state evaluated last.
    history : History
        Everything needed to continue bit for bit.
    """

    system: System
    step: float
    inputs: Inputs
    work: Work
    history: History

    @property
    def drift(self) -> Drift:
        """What steps have drifted by before they were put back, the largest since `restart_drift`.

        Returns
        -------
        Drift
            Of any quaternion | |q| − 1 |; of any constraint equation |φ| [m or rad] and |φ̇| [m/s or rad/s], as they
            were at the end of the corrector passes, before the projection onto the constraints.
        """
        return Drift(*self.work.drift.tolist())

    def restart_drift(self) -> None:
        """Forget the drift of the steps so far."""
        self.work.drift[:] = 0.0

    @property
    def state(self) -> NDArray[np.float64]:
        """Current state (n_state,), a view."""
        return cast("NDArray[np.float64]", self.history.y[-1])

    @property
    def state_rate(self) -> NDArray[np.float64]:
        """Current dy/dt (n_state,), a view."""
        return cast("NDArray[np.float64]", self.history.f[-1])

    def start(self, y: ArrayLike, check: bool = True) -> None:
        """Begin at a state (n_state,)."""
        raise NotImplementedError

    def advance(self, n_steps: int = 1) -> None:
        """Take n_steps with the inputs running linearly from ``inputs[…][0]`` to ``inputs[…][1]``."""
        raise NotImplementedError


class HammingIntegrator(Integrator):
    """The modified Hamming scheme on a system, with its history.

    Parameters
    ----------
    system : MultibodySystem
    step : float
        Step length [s].
    n_corrections : int
        Corrector passes a step; one, two and three are stable up to ω h = 0.276, 0.78 and 1.08 without damping.
    starter : {"adams", "runge-kutta"}
        Of the first three steps. "adams", the default, are the published starters (modified Euler, two- and three-step
        Adams–Moulton); the first leaves an error of order h³, which is then the order of a run that does not start at
        rest. "runge-kutta" takes the classical scheme of fourth order at the same cost: a run is then as exact as one
        from exact starting values.
    trail : int
        Steps of one call whose states and rates are kept in ``work``, see `MultibodySystem.new_work`.

    Raises
    ------
    MultibodyError
        For a step or a number of passes that is not positive and finite, an unknown starter or a system not yet built.
    """

    def __init__(
        self, system: System, step: float, n_corrections: int = 3, starter: str = "adams", trail: int = 0
    ) -> None:
        system.require_built()
        if not 0.0 < step < np.inf:
            raise MultibodyError(f"integration step must be positive and finite, got {step}")
        if int(n_corrections) != n_corrections or n_corrections < 1:
            raise MultibodyError(f"n_corrections is {n_corrections!r}; must be a whole number of at least 1")
        if starter not in STARTERS:
            raise MultibodyError(f"starter must be one of {', '.join(STARTERS)}, got {starter!r}")
        self.system, self.step, self.n_corrections = system, float(step), int(n_corrections)
        self.starter = starter
        self.work, self.inputs = system.new_work(trail), system.new_inputs()
        self.history = new_history(system.n_state)

    def start(self, y: ArrayLike, check: bool = True) -> None:
        """Begin at a state; the starters run again.

        Parameters
        ----------
        y : array (n_state,)
        check : bool
            Refuse states off the constraint equations and steps beyond the stability limit. Without it Baumgarte's
            stabilization pulls in what is inconsistent.

        Raises
        ------
        MultibodyError
            For a state without meaning (length, finite numbers, unit quaternions); constraint residuals above 1e-5 (m,
            rad, m/s, rad/s), naming the constraint; a step with which the scheme is unstable, naming ω h or α h; a
            singular mass matrix.
        """
        system, history = self.system, self.history
        if check:
            y = state = checked_start(system, y, self.inputs, self.work)
            check_hamming_step(system, state, self.step, self.n_corrections, self.inputs, self.work)
        history.y[3] = check_state(system, y)
        history.memory[:] = 0.0
        history.counters[0] = STARTERS[self.starter]
        history.f[3] = system.rates(y, self.inputs, self.work)

    def advance(self, n_steps: int = 1) -> None:
        """Take n_steps with the inputs running linearly from ``inputs[…][0]`` to ``inputs[…][1]``.

        Raises
        ------
        MultibodyError
            When the mass matrix is singular or the state diverges.
        """
        code = integrator_kernels.hamming_advance(
            self.history, self.inputs, self.system.tree, self.work, self.step, int(n_steps), self.n_corrections,
            self.system.constrained, True,
        )  # fmt: skip
        if code != tree_kernels.OK:
            raise MultibodyError(failure_of_a_step(code, self.step))
