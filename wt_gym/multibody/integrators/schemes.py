"""Time integrators of a multibody system: one family with one contract.

Every integrator has ``start(y)``, ``advance(n_steps)``, ``state``, ``state_rate``, ``step``, ``inputs``, ``work`` and
``history`` (arrays that carry everything needed to continue bit for bit):

- ``"hamming"``: the explicit modified Hamming scheme, stable on an undamped structure up to ω h = 1.08; of fourth order
  from a Runge–Kutta start, of third from the published starters, which are the default;
- ``"newmark"``: Newmark's implicit scheme, by default the average-acceleration rule (no numerical damping);
- ``"generalized-alpha"``: Chung & Hulbert's implicit scheme with a chosen damping of high frequencies.

All take systems with constraint equations too: these are solved for the accelerations at every evaluation, with
Baumgarte's stabilization, so that the schemes see a plain differential equation and keep their order.
"""

from collections import namedtuple

import numpy as np

from wt_gym.multibody.checks import check_state
from wt_gym.multibody.errors import FAILURES, MultibodyError, failure_of_a_step
from wt_gym.multibody.integrators import implicit_kernels, structural_newton_kernels
from wt_gym.multibody.integrators.hamming import HammingIntegrator, History, checked_start
from wt_gym.multibody.integrators.stability import check_conditional_step
from wt_gym.multibody.tree import tree_kernels

__all__ = [
    "INTEGRATORS",
    "NEWMARK",
    "GeneralizedAlphaIntegrator",
    "NewmarkIntegrator",
    "generalised_alpha",
    "make_integrator",
]

NEWMARK = (0.25, 0.5, 0.0, 0.0)
"""β, γ, αm, αf of the average-acceleration rule."""

TANGENTS = ("difference", "structure")
ImplicitScratch = namedtuple("ImplicitScratch", "trial rate acceleration pseudo increment residual shifted")


class _ImplicitIntegrator:
    """Newton iteration on the accelerations at the end of the step, shared by the implicit schemes.

    Parameters
    ----------
    system : MultibodySystem
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

    def __init__(self, system, step, scheme, tolerance, max_iterations, difference, tangent, trail):
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
        self.difference = float(difference)
        self.work, self.inputs = system.new_work(trail), system.new_inputs()
        n, n_v = system.n_state, system.n_u + system.n_servo
        self.history = History(
            np.zeros((1, n)), np.zeros((1, n)), np.zeros(n_v), np.zeros(3, dtype=np.int64), np.zeros((n_v, n_v)),
            np.zeros(n_v, dtype=np.int64),
        )  # fmt: skip
        self.scratch = ImplicitScratch(np.zeros(n), np.zeros(n), *(np.zeros(n_v) for _ in range(5)))

    @property
    def phase_limit(self):
        """Largest ω h of an undamped mode: (γ/2 − β)^(−½), infinite for an unconditionally stable scheme."""
        beta, gamma, alpha_m, _ = self.scheme
        if alpha_m != 0.0 or gamma <= 2.0 * beta:
            return np.inf
        return float((0.5 * gamma - beta) ** -0.5)

    def start(self, y, check=True):
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
            y = checked_start(system, y, self.inputs, self.work)
            if np.isfinite(self.phase_limit):
                check_conditional_step(system, y, self.step, self.phase_limit, self.inputs, self.work)
        history.y[0] = check_state(system, y)
        history.f[0] = self._rates(history.y[0])
        implicit_kernels.begin_memory(history, system.tree, system.constrained)
        history.counters[:] = 0

    def _rates(self, y):
        """dy/dt (n_state,) under the inputs at their start."""
        if self.tangent == "difference":
            return self.system.rates(y, self.inputs, self.work)
        rate = np.zeros(self.system.n_state)
        code = structural_newton_kernels.tree_rates(y, 0.0, self.inputs, self.system.tree, self.work, rate)
        if code != tree_kernels.OK:
            raise MultibodyError(FAILURES[code])
        return rate

    drift, restart_drift = HammingIntegrator.drift, HammingIntegrator.restart_drift

    @property
    def state(self):
        """Current state (n_state,), a view."""
        return self.history.y[0]

    @property
    def state_rate(self):
        """Current dy/dt (n_state,), a view."""
        return self.history.f[0]

    @property
    def n_evaluations(self):
        """Right-hand sides evaluated since the start."""
        return int(self.history.counters[implicit_kernels.EVALUATIONS])

    def advance(self, n_steps=1):
        """Take n_steps with the inputs running linearly from ``inputs[…][0]`` to ``inputs[…][1]``.

        Raises
        ------
        MultibodyError
            When Newton's iteration does not converge, the state diverges or the mass matrix is singular.
        """
        if self.tangent == "structure":
            code = structural_newton_kernels.structural_advance(
                self.history, self.inputs, self.system.tree, self.work, self.scratch, self.step, self.scheme,
                int(n_steps), self.tolerance, self.max_iterations,
            )  # fmt: skip
        else:
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


class NewmarkIntegrator(_ImplicitIntegrator):
    """Newmark's scheme with Newton iteration on the equations of motion at the end of the step.

    Parameters
    ----------
    system : MultibodySystem
    step : float
        Step length [s].
    beta, gamma : float
        (¼, ½), the default, is the average-acceleration rule: second order, stable at every step, no numerical damping.
        (0, ½) is the central-difference rule, stable for ω h < 2.
    tolerance, max_iterations, difference, tangent
        Of Newton's iteration: smallest change of the position increments [m or rad], most iterations in a step, change
        of the increments from which the matrix is made; "structure" instead of "difference" makes it from the masses
        and stiffnesses of the bodies.
    trail : int
        Steps of one call whose states are kept in ``work``.

    Raises
    ------
    MultibodyError
        For parameters that make no stable scheme.
    """

    def __init__(self, system, step, beta=0.25, gamma=0.5, tolerance=1e-9, max_iterations=20, difference=1e-6,
                 tangent="difference", trail=0):  # fmt: skip
        if not (gamma >= 0.5 and beta >= 0.0):
            raise MultibodyError(f"Newmark needs gamma >= 1/2 and beta >= 0, got gamma = {gamma}, beta = {beta}")
        self.beta, self.gamma = float(beta), float(gamma)
        super().__init__(system, step, (beta, gamma, 0.0, 0.0), tolerance, max_iterations, difference, tangent, trail)


def generalised_alpha(rho_inf):
    """β, γ, αm, αf of the scheme that is optimal for a spectral radius (0 … 1) at ω h → ∞.

    αm = (2ρ − 1)/(ρ + 1), αf = ρ/(ρ + 1), γ = ½ − αm + αf, β = ¼ (1 − αm + αf)² (Chung & Hulbert 1993).
    """
    alpha_m, alpha_f = (2.0 * rho_inf - 1.0) / (rho_inf + 1.0), rho_inf / (rho_inf + 1.0)
    return 0.25 * (1.0 - alpha_m + alpha_f) ** 2, 0.5 - alpha_m + alpha_f, alpha_m, alpha_f


class GeneralizedAlphaIntegrator(_ImplicitIntegrator):
    """Chung & Hulbert's generalized-α scheme (J. Appl. Mech. 60, 1993), optimal for a given spectral radius at ω h → ∞.

    Its parameters are those of `generalised_alpha`; second order, stable at every step.

    Parameters
    ----------
    system : MultibodySystem
    step : float
        Step length [s].
    rho_inf : float
        Spectral radius at infinite frequency: 1 keeps all frequencies, 0 removes the highest within one step.
    tolerance, max_iterations, difference, tangent, trail
        As for :class:`NewmarkIntegrator`.

    Raises
    ------
    MultibodyError
        For a spectral radius outside 0 … 1.
    """

    def __init__(self, system, step, rho_inf=0.8, tolerance=1e-9, max_iterations=20, difference=1e-6,
                 tangent="difference", trail=0):  # fmt: skip
        if not 0.0 <= rho_inf <= 1.0:
            raise MultibodyError(f"the spectral radius rho_inf must lie in 0 … 1, got {rho_inf}")
        self.rho_inf = float(rho_inf)
        super().__init__(
            system, step, generalised_alpha(rho_inf), tolerance, max_iterations, difference, tangent, trail
        )


INTEGRATORS = {
    "hamming": HammingIntegrator,
    "newmark": NewmarkIntegrator,
    "generalized-alpha": GeneralizedAlphaIntegrator,
}


def make_integrator(name, system, step, **options):
    """Integrator of the family by its name.

    Parameters
    ----------
    name : str
        "hamming" (options n_corrections, starter), "newmark" (beta, gamma) or "generalized-alpha" (rho_inf); the
        implicit ones also take tolerance, max_iterations, difference, tangent and trail.
    system : MultibodySystem
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
    if name not in INTEGRATORS:
        raise MultibodyError(f"integrator must be one of {', '.join(INTEGRATORS)}, got {name!r}")
    try:
        return INTEGRATORS[name](system, step, **options)
    except TypeError as error:
        raise MultibodyError(f"integrator {name!r} does not take these options: {error}") from error
