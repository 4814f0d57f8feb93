"""Compiled choice of the scheme that moves a structure on; a further scheme brings a kernel and a branch.

The fields of `wt_gym.multibody.integrators.schemes.Method` are None except for that of the scheme, whose type chooses,
so that a compiled step contains one scheme only. Constants among the arguments of big kernels stand as ``bool(True)``
or ``int(0)``: a bare one would compile a form of the kernel for this value alone, beside the one that Python calls.
"""

from wt_gym.base.compiled import kernel
from wt_gym.multibody.integrators.implicit_kernels import implicit_advance
from wt_gym.multibody.integrators.integrator_kernels import hamming_advance
from wt_gym.multibody.tree.rate_kernels import rates, tree_rates

# The predictor alone is unstable: what it amplifies in so few steps is less than the change of the loads.
MOST_UNCORRECTED = 4


@kernel
def advance(method, history, inputs, tree, work, h, n_steps, n_corrections, rough, constrained):
    """Advance the state by n_steps of length h, without the rates at the end; `end_rates` gives these.

    Parameters
    ----------
    method : Method
    history : History
    inputs : Inputs
    tree : Tree
    work : Work
    h : float
        Step [s].
    n_steps : int
    n_corrections : int
        Corrector passes of an explicit scheme.
    rough : bool
        The state only has to be near: an explicit scheme predicts it, as far as that is stable, and an implicit one
        solves to its rough tolerance.
    constrained : None or int
        See :func:`wt_gym.multibody.tree.rate_kernels.rates`.

    Returns
    -------
    int
        OK, or a code of the scheme.
    """
    return advance_by(method.implicit, history, inputs, tree, work, h, n_steps, n_corrections, rough, constrained)


@kernel
def advance_by(implicit, history, inputs, tree, work, h, n_steps, n_corrections, rough, constrained):
    """As `advance`, by the scheme that the type of the first argument chooses."""
    if implicit is None:
        # The Cartesian coordinates of a free blade turn with the rotor: their prediction needs a correction.
        predicted = rough and n_steps <= MOST_UNCORRECTED and constrained is None
        n_passes = 0 if predicted else n_corrections
        return hamming_advance(history, inputs, tree, work, h, n_steps, n_passes, constrained, bool(False))
    tolerance = implicit.rough_tolerance if rough else implicit.tolerance
    return implicit_advance(history, inputs, tree, work, implicit.scratch, h, implicit.scheme, n_steps, tolerance,
                            implicit.max_iterations, implicit.difference, constrained)  # fmt: skip


@kernel
def end_rates(method, history, inputs, tree, work, state, rate, constrained):
    """Rates that belong to the newest state and the inputs at the end; the kinematics too. Returns a code.

    state, rate (n_state,) are views of the newest ones in the history; the other arguments are those of `advance`.
    """
    return end_rates_by(method.implicit, history, inputs, tree, work, state, rate, constrained)


@kernel
def end_rates_by(implicit, history, inputs, tree, work, state, rate, constrained):
    """As `end_rates`, by the scheme that the type of the first argument chooses."""
    if implicit is None:
        return hamming_advance(history, inputs, tree, work, 1.0, int(0), int(0), constrained, bool(True))
    if constrained is None:
        return tree_rates(state, 1.0, inputs, tree, work, rate)
    return rates(state, 1.0, inputs, tree, work, rate, constrained)
