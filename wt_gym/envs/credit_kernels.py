"""Compiled sum of the effects that past offsets have on the fatigue terms of a reward."""

from wt_gym.base.compiled import kernel

FLAP_MEAN, FLAP_TILT, FLAP_YAW, FORE_AFT, SIDE_SIDE = range(5)  # of `wt_gym.envs.fatigue.LOADS`


@kernel(fastmath=False)
def fatigue_rate(loads, weights):
    """Rate of reward of `wt_gym.envs.fatigue` for normalized loads (5,), as of `wt_gym.envs.fatigue.LOADS` [1/s].

    Parameters
    ----------
    weights : (4,)
        Of the blades, their share in the fixed frame, of the tower fore-aft and side-side.
    """
    turning = 0.5 * (loads[FLAP_TILT] ** 2 + loads[FLAP_YAW] ** 2)
    blade = (1.0 - weights[1]) * loads[FLAP_MEAN] ** 2 + turning
    fore_aft, side_side = loads[FORE_AFT] ** 2, loads[SIDE_SIDE] ** 2
    return (
        -weights[0] * blade / (1.0 + blade)
        - weights[2] * fore_aft / (1.0 + fore_aft)
        - weights[3] * side_side / (1.0 + side_side)
    )


@kernel(fastmath=False)
def effect_to_come(loads, changes, first, weights, scratch):
    """Sum of the changes of the rate by changes of loads (m, 5 or more), which stand in a ring from ``first`` on.

    Parameters
    ----------
    loads : (n, 5)
        Without changes, in the next steps; the first of the m changes belong to them, n <= m.
    scratch : (5,)
    """
    total, size = 0.0, changes.shape[0]
    for k in range(loads.shape[0]):
        row = (first + k) % size
        for j in range(5):
            scratch[j] = loads[k, j] + changes[row, j]
        total += fatigue_rate(scratch, weights) - fatigue_rate(loads[k], weights)
    return total
