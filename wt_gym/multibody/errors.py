"""What is said when a multibody system cannot be built or integrated."""

from wt_gym.base.errors import WtGymError
from wt_gym.multibody.tree import tree_kernels

__all__ = ["FAILURES", "MultibodyError", "failure_of_a_step"]


class MultibodyError(WtGymError, ValueError):
    """A system of bodies and joints that cannot be built or integrated."""


FAILURES = {
    tree_kernels.SINGULAR_MASS: "the mass matrix is not positive definite: a coordinate moves no mass",
    tree_kernels.SINGULAR_CONSTRAINTS: "the constraint equations depend on each other: a motion is locked twice",
    tree_kernels.DIVERGED: "the integration diverged; the step may exceed the stability limit",
    tree_kernels.NOT_CONVERGED: "Newton's iteration did not converge; the step may be too long for the motion",
}
"""Messages for the codes that the compiled kernels return."""


def failure_of_a_step(code: int, step: float) -> str:
    """Message for a code that a compiled integrator returned during a step [s], for everything that takes steps.

    The mass matrix was sound at the start: when it is singular in a step, a diverging state has spoiled it before its
    numbers overflowed.
    """
    if code in (tree_kernels.DIVERGED, tree_kernels.SINGULAR_MASS):
        return f"{FAILURES[tree_kernels.DIVERGED]} (step {step:.6g} s)"
    return FAILURES[code]
