"""Dynamic stall: the separation point of each strip and the drag that goes with it."""

import numpy as np

from wt_gym.aerodynamics.lattice.section_kernels import DRAG, POINT, linear_at
from wt_gym.base.compiled import kernel

STATIC = -1.0  # in the place of a separation point: the flow follows the static polar


@kernel(fastmath=False, separate=True)
def reset_separation(p, o, a):
    """Separation points of the static polars at the present angles of attack; `STATIC` without a dynamic model."""
    for k in range(a.alpha.shape[0]):
        static = linear_at(p.separation[k % p.separation.shape[0]], POINT, a.alpha[k]) if o.dynamic_stall else STATIC
        a.separation[0, k], a.separation[1, k] = static, static


@kernel(fastmath=False)
def advance_separation(p, o, a):
    """Move the separation points f of all strips through the step a.dt.

    df/dt = (fst(alpha) - f) / tau, tau = separation_lag c / V (Oeye 1991). The static point fst is continued in a
    straight line from the last two accepted steps, for which the solution is exact: with h = dt / tau and
    d = (fst - fst_before) dt / dt_before,

        f = fst + (f - fst) exp(-h) + d (1 - (1 - exp(-h)) / h).

    Held constant instead, it would lag behind by half a step, one chord length in coarse steps.
    """
    n_span = p.chord.shape[0]
    ratio = a.dt[0] / a.last_dt[0] if a.last_dt[0] > 0.0 else 0.0
    for k in range(a.alpha.shape[0]):
        j = k % n_span
        static = linear_at(p.separation[k % p.separation.shape[0]], POINT, a.alpha[k])
        h = a.dt[0] * a.speed[k] / (o.separation_lag * p.chord[j])
        gone = -np.expm1(-h)
        drift = (static - a.separation[1, k]) * ratio * (1.0 - gone / h if h > 1e-6 else 0.5 * h)
        point = a.separation[0, k] + (static - a.separation[0, k]) * gone + drift
        a.separation[0, k] = min(max(point, 0.0), 1.0)
        a.separation[1, k] = static


@kernel(fastmath=False)
def separation_drag(separation, point, alpha):
    """Drag coefficient above the static one while the flow is separated ``point`` chords aft (n_alpha, 4).

    [cd(alpha) - cd(alpha0)] [(sqrt fst - sqrt f) / 2 - (fst - f) / 4] (Hansen, Gaunaa & Madsen, Risoe-R-1354, 2004):
    less while the flow is still attached.
    """
    if point < 0.0:
        return 0.0
    static = max(linear_at(separation, POINT, alpha), 0.0)
    return linear_at(separation, DRAG, alpha) * (0.5 * (np.sqrt(static) - np.sqrt(point)) - 0.25 * (static - point))
