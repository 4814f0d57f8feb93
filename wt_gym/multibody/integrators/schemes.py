"""Time integrators of a multibody system: one family with one contract, and the registry of its members.

Every one is an `Integrator`. `INTEGRATORS` says of each by which name it is chosen, what it needs, up to which step it
is stable, and how a coupled simulation makes and moves it:

- ``"hamming"``: the explicit modified Hamming scheme, stable on an undamped structure up to ω h = 1.08; of fourth order
  from a Runge–Kutta start, of third from the published starters, which are the default;
- ``"newmark"``: Newmark's implicit scheme, by default the average-acceleration rule (no numerical damping);
- ``"generalized_alpha"``: Chung & Hulbert's implicit scheme with a chosen damping of high frequencies.

A further one is an entry of `INTEGRATORS`, and no other file names it; where it needs another kernel than those that
exist, the kernel and its branch in :mod:`wt_gym.multibody.integrators.advance_kernels` come with a field of `Method`.

All take systems with constraint equations too: these are solved for the accelerations at every evaluation, with
Baumgarte's stabilization, so that the schemes see a plain differential equation and keep their order.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from wt_gym.base.quantities import Array
from wt_gym.multibody.arrays import (
    FAILURES,
    Drift,
    History,
    Inputs,
    MultibodyError,
    Work,
    failure_of_a_step,
    new_history,
)
from wt_gym.multibody.integrators import implicit_kernels, integrator_kernels
from wt_gym.multibody.integrators.stability import check_conditional_step, check_hamming_step, undamped_limit
from wt_gym.multibody.system import MultibodySystem, check_residuals, check_state
from wt_gym.multibody.tree import rate_kernels, tree_kernels

STARTERS = {"adams": 0, "runge-kutta": -3}
"""What the counter of an empty history is."""


def checked_start(system: MultibodySystem, y: ArrayLike, inputs: Inputs, work: Work) -> Array:
    """A copy of the state y, put exactly onto the constraint equations that it satisfies nearly.

    Raises
    ------
    MultibodyError
        For a state without meaning, or one that is farther from the constraint equations than
        :data:`wt_gym.multibody.system.CONSISTENT`.
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
    step : float
        [s].
    inputs : Inputs
        What acts on the system.
    work : Work
        Kinematics of the state evaluated last.
    history : History
        Everything needed to continue bit for bit.
    """

    system: MultibodySystem
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
    def state(self) -> Array:
        """Current state (n_state,), a view."""
        return cast(Array, self.history.y[-1])

    @property
    def state_rate(self) -> Array:
        """Current dy/dt (n_state,), a view."""
        return cast(Array, self.history.f[-1])

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
        self, system: MultibodySystem, step: float, n_corrections: int = 3, starter: str = "adams", trail: int = 0
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


NEWMARK = (0.25, 0.5, 0.0, 0.0)
"""β, γ, αm, αf of the average-acceleration rule."""
ROUGH = 100.0
"""Tolerance of an implicit step that only predicts a motion, over that of others."""

TANGENTS = ("difference", "structure")


class ImplicitScratch(NamedTuple):
    """Scratch arrays of the implicit schemes; n_v = n_u + n_servo."""

    trial: Array  # (n_state,) state at the end of the step
    rate: Array  # (n_state,) its rate
    acceleration: Array  # (n_v,) x, the unknowns: accelerations at the end of the step
    pseudo: Array  # (n_v,) pseudo-accelerations a₁
    increment: Array  # (n_v,) Δ, of the positions over the step [m, rad]
    residual: Array  # (n_v,) what is left of the equations of motion
    shifted: Array  # (n_v,) the same for a changed unknown


class Newton(NamedTuple):
    """How an implicit scheme solves for the end of a step, as kernels take it."""

    scratch: ImplicitScratch
    scheme: Array  # (4,) β, γ, αm, αf
    tolerance: float  # change of the position increments at which the iteration ends, over 1 + their size [m, rad]
    rough_tolerance: float  # the same where a motion is only predicted
    max_iterations: int
    difference: float | None  # change of the increments for the matrix [m, rad]; None: matrix of the structure


class Method(NamedTuple):
    """How a scheme moves a structure on, as kernels take it: all fields None are the Hamming scheme."""

    implicit: Newton | None


class ImplicitIntegrator(Integrator):
    """Newton iteration on the accelerations at the end of the step, shared by the implicit schemes.

    Parameters
    ----------
    step : float
        Step length [s].
    scheme : tuple of float
        β, γ, αm, αf.
    tolerance : float
        Newton's iteration ends when the position increments [m or rad] change by less than ``tolerance`` (1 + their
        size).
    max_iterations : int
        Most Newton iterations in a step.
    difference : float
        Change of the position increments [m or rad] from which Newton's matrix is made.
    tangent : {"difference", "structure"}
        Newton's matrix from differences of the equations of motion, kept as long as it serves; or, for systems without
        constraint equations, from mass, damping and stiffness, made at every step for little more than the mass matrix.
    trail : int
        Steps of one call whose states and rates are kept in ``work``, see `MultibodySystem.new_work`.

    Raises
    ------
    MultibodyError
        For a step, tolerance or number of iterations that is not positive, and for a tangent that does not exist.
    """

    def __init__(
        self,
        system: MultibodySystem,
        step: float,
        scheme: tuple[float, float, float, float],
        tolerance: float = 1e-9,
        max_iterations: int = 20,
        difference: float = 1e-6,
        tangent: str = "difference",
        trail: int = 0,
    ) -> None:
        system.require_built()
        for name, value in (("step", step), ("tolerance", tolerance), ("difference", difference)):
            if not 0.0 < value < np.inf:
                raise MultibodyError(f"integration {name} must be positive and finite, got {value}")
        if max_iterations < 1:
            raise MultibodyError(f"max_iterations must be at least 1, got {max_iterations}")
        if tangent not in TANGENTS or (tangent == "structure" and system.constraints):
            allowed = "'difference'" if system.constraints else " or ".join(map(repr, TANGENTS))
            raise MultibodyError(f"the tangent of this system must be {allowed}, got {tangent!r}")
        self.tangent = tangent
        self.system, self.step, self.scheme = system, float(step), np.array(scheme, dtype=float)
        self.tolerance, self.max_iterations = float(tolerance), int(max_iterations)
        self.difference = None if tangent == "structure" else float(difference)
        self.work, self.inputs = system.new_work(trail), system.new_inputs()
        n, n_v = system.n_state, system.n_u + system.n_servo
        self.history = History(
            np.zeros((1, n)), np.zeros((1, n)), np.zeros(n_v), np.zeros(3, dtype=np.int64), np.zeros((n_v, n_v)),
            np.zeros(n_v, dtype=np.int64),
        )  # fmt: skip
        self.scratch = ImplicitScratch(np.zeros(n), np.zeros(n), *(np.zeros(n_v) for _ in range(5)))

    @property
    def phase_limit(self) -> float:
        """Largest ω h of an undamped mode: (γ/2 − β)^(−½), infinite for an unconditionally stable scheme."""
        beta, gamma, alpha_m, _ = self.scheme
        if alpha_m != 0.0 or gamma <= 2.0 * beta:
            return math.inf
        return float((0.5 * gamma - beta) ** -0.5)

    def start(self, y: ArrayLike, check: bool = True) -> None:
        """Begin at a state.

        Parameters
        ----------
        y : array (n_state,)
        check : bool
            Refuse states off the constraint equations and steps beyond the stability limit.

        Raises
        ------
        MultibodyError
            As for :meth:`HammingIntegrator.start`.
        """
        system, history = self.system, self.history
        if check:
            y = state = checked_start(system, y, self.inputs, self.work)
            if np.isfinite(self.phase_limit):
                check_conditional_step(system, state, self.step, self.phase_limit, self.inputs, self.work)
        history.y[0] = check_state(system, y)
        history.f[0] = self._rates(history.y[0])
        implicit_kernels.begin_memory(history, system.tree, system.constrained)
        history.counters[:] = 0

    def _rates(self, y: Array) -> Array:
        """dy/dt (n_state,) under the inputs at their start."""
        if self.tangent == "difference":
            return self.system.rates(y, self.inputs, self.work)
        rate = np.zeros(self.system.n_state)
        code = rate_kernels.tree_rates(y, 0.0, self.inputs, self.system.tree, self.work, rate)
        if code != tree_kernels.OK:
            raise MultibodyError(FAILURES[code])
        return rate

    def advance(self, n_steps: int = 1) -> None:
        """Take n_steps with the inputs running linearly from ``inputs[…][0]`` to ``inputs[…][1]``.

        Raises
        ------
        MultibodyError
            When Newton's iteration does not converge, the state diverges or the mass matrix is singular.
        """
        code = implicit_kernels.implicit_advance(
            self.history, self.inputs, self.system.tree, self.work, self.scratch, self.step, self.scheme,
            int(n_steps), self.tolerance, self.max_iterations, self.difference, self.system.constrained,
        )  # fmt: skip
        if code == tree_kernels.OK:
            return
        self.history.counters[implicit_kernels.FRESH] = 0
        if code == tree_kernels.NOT_CONVERGED:
            raise MultibodyError(
                f"Newton's iteration did not converge in {self.max_iterations} iterations; the step {self.step} s may "
                "be too long for the motion"
            )
        raise MultibodyError(failure_of_a_step(code, self.step))


class NewmarkIntegrator(ImplicitIntegrator):
    """Newmark's scheme with Newton iteration on the equations of motion at the end of the step.

    Parameters
    ----------
    step : float
        Step length [s].
    beta, gamma : float
        (¼, ½), the default, is the average-acceleration rule: second order, stable at every step, no numerical damping.
        (0, ½) is the central-difference rule, stable for ω h < 2.
    **options
        Of `ImplicitIntegrator`.

    Raises
    ------
    MultibodyError
        For parameters that make no stable scheme.
    """

    def __init__(
        self, system: MultibodySystem, step: float, beta: float = 0.25, gamma: float = 0.5, **options: Any
    ) -> None:
        if not (gamma >= 0.5 and beta >= 0.0):
            raise MultibodyError(f"Newmark needs gamma >= 1/2 and beta >= 0, got gamma = {gamma}, beta = {beta}")
        self.beta, self.gamma = float(beta), float(gamma)
        super().__init__(system, step, (beta, gamma, 0.0, 0.0), **options)


def generalized_alpha(rho_inf: float) -> tuple[float, float, float, float]:
    """β, γ, αm, αf of the scheme that is optimal for a spectral radius (0 … 1) at ω h → ∞.

    αm = (2ρ − 1)/(ρ + 1), αf = ρ/(ρ + 1), γ = ½ − αm + αf, β = ¼ (1 − αm + αf)² (Chung & Hulbert 1993).
    """
    alpha_m, alpha_f = (2.0 * rho_inf - 1.0) / (rho_inf + 1.0), rho_inf / (rho_inf + 1.0)
    return 0.25 * (1.0 - alpha_m + alpha_f) ** 2, 0.5 - alpha_m + alpha_f, alpha_m, alpha_f


class GeneralizedAlphaIntegrator(ImplicitIntegrator):
    """Chung & Hulbert's generalized-α scheme (J. Appl. Mech. 60, 1993), optimal for a given spectral radius at ω h → ∞.

    Its parameters are those of `generalized_alpha`; second order, stable at every step.

    Parameters
    ----------
    step : float
        Step length [s].
    rho_inf : float
        Spectral radius at infinite frequency: 1 keeps all frequencies, 0 removes the highest within one step.
    **options
        Of `ImplicitIntegrator`.

    Raises
    ------
    MultibodyError
        For a spectral radius outside 0 … 1.
    """

    def __init__(self, system: MultibodySystem, step: float, rho_inf: float = 0.8, **options: Any) -> None:
        if not 0.0 <= rho_inf <= 1.0:
            raise MultibodyError(f"the spectral radius rho_inf must lie in 0 … 1, got {rho_inf}")
        self.rho_inf = float(rho_inf)
        super().__init__(system, step, generalized_alpha(rho_inf), **options)


# ---- registry --------------------------------------------------------------------------------------------------------


class SchemeSettings(NamedTuple):
    """What a coupled simulation chooses for its integrator; each takes from it what concerns its scheme."""

    corrections: int = 3  # corrector passes of an explicit scheme
    starter: str = "adams"  # first steps of a scheme of several steps
    spectral_radius: float = 0.8  # at infinite frequency, of a scheme with numerical damping
    tolerance: float = 1e-9  # change of the increments at which Newton's iteration ends [m, rad]
    trail: int = 0  # steps of one call whose states are kept


@dataclass(frozen=True)
class IntegratorEntry:
    """What the registry says of an integrator.

    Attributes
    ----------
    kind : subclass of Integrator
    explicit : bool
        It needs steps that resolve the highest frequency of the structure, also where this is not of interest, and
        takes the accelerations of the start as they are.
    phase_limit : callable
        Largest ω h of an undamped mode, of `SchemeSettings`; infinite for a scheme that is stable at every step.
    options : callable
        Arguments of ``kind`` in a coupled simulation, of `SchemeSettings`.
    method : callable
        `Method` of an integrator.
    rule : callable
        β, γ, αm, αf of the steps of observer frames, of `SchemeSettings`; an explicit scheme has none, and they take
        Newmark's.
    keeps_states : bool
        What its `History` carries from step to step are states, their rates and differences of them alone, newest last:
        a linear change of coordinates passes it on.
    """

    kind: Callable[..., Integrator]
    explicit: bool
    phase_limit: Callable[[SchemeSettings], float]
    options: Callable[[SchemeSettings], dict[str, Any]]
    method: Callable[[Any], Method]
    rule: Callable[[SchemeSettings], tuple[float, float, float, float]]
    keeps_states: bool = False


def _newton(integrator: ImplicitIntegrator) -> Method:
    i = integrator
    return Method(Newton(i.scratch, i.scheme, i.tolerance, ROUGH * i.tolerance, i.max_iterations, i.difference))


INTEGRATORS = {
    "hamming": IntegratorEntry(
        kind=HammingIntegrator,
        explicit=True,
        phase_limit=lambda settings: undamped_limit(settings.corrections),
        options=lambda settings: {"n_corrections": settings.corrections, "starter": settings.starter},
        method=lambda integrator: Method(None),
        rule=lambda settings: NEWMARK,
        keeps_states=True,
    ),
    "newmark": IntegratorEntry(
        kind=NewmarkIntegrator,
        explicit=False,
        phase_limit=lambda settings: math.inf,
        options=lambda settings: {"tolerance": settings.tolerance},
        method=_newton,
        rule=lambda settings: NEWMARK,
    ),
    "generalized_alpha": IntegratorEntry(
        kind=GeneralizedAlphaIntegrator,
        explicit=False,
        phase_limit=lambda settings: math.inf,
        options=lambda settings: {"rho_inf": settings.spectral_radius, "tolerance": settings.tolerance},
        method=_newton,
        rule=lambda settings: generalized_alpha(settings.spectral_radius),
    ),
}
DEFAULT = "hamming"
"""The integrator where none is named; of a structure that its observer frames move, it holds the state."""


def _entry(name: str) -> IntegratorEntry:
    if name not in INTEGRATORS:
        raise MultibodyError(f"integrator must be one of {', '.join(INTEGRATORS)}, got {name!r}")
    return INTEGRATORS[name]


def make_integrator(name: str, system: MultibodySystem, step: float, **options: Any) -> Integrator:
    """Integrator of the family by its name.

    Parameters
    ----------
    name : str
        "hamming" (options n_corrections, starter), "newmark" (beta, gamma) or "generalized_alpha" (rho_inf); the
        implicit ones also take tolerance, max_iterations, difference and tangent, all of them trail.
    step : float
        [s].
    **options
        Of the scheme.

    Returns
    -------
    HammingIntegrator, NewmarkIntegrator or GeneralizedAlphaIntegrator

    Raises
    ------
    MultibodyError
        For an unknown name or option, or a value without meaning.

    Examples
    --------
    >>> from wt_gym.multibody.system import Joint, MultibodySystem
    >>> from wt_gym.structure.flexible_body import FlexibleBody
    >>> system = MultibodySystem()
    >>> bob = FlexibleBody.rigid("bob", 1.0, (0.0, 0.0, -1.0), np.zeros((3, 3)))
    >>> body = system.add(bob, Joint("revolute", axis=(0.0, 1.0, 0.0), name="swing"))
    >>> integrator = make_integrator("newmark", system.build(), 0.01)
    >>> integrator.start(np.array([0.1, 0.0]))
    >>> integrator.advance(100)
    """
    kind = _entry(name).kind
    try:
        return kind(system, step, **options)
    except TypeError as error:
        raise MultibodyError(f"integrator {name!r} does not take these options: {error}") from error


def coupled_integrator(name: str, system: MultibodySystem, step: float, settings: SchemeSettings) -> Integrator:
    """Integrator of a structure that is coupled to the air, in steps [s].

    An implicit one takes the matrix of the structure, where there are no constraint equations.

    Raises
    ------
    MultibodyError
        For an unknown name, or a value without meaning.
    """
    entry = _entry(name)
    options = entry.options(settings) | {"trail": settings.trail}
    if not entry.explicit and not system.constraints:
        options["tangent"] = "structure"
    return entry.kind(system, step, **options)


def method_of(integrator: Integrator) -> Method:
    """How kernels move the structure of an integrator on."""
    return next(entry for entry in INTEGRATORS.values() if type(integrator) is entry.kind).method(integrator)
