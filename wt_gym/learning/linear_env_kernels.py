"""Compiled step of many linear models of a turbine, see `wt_gym.learning.linear_env`."""

import math

from wt_gym.base.compiled import kernel
from wt_gym.envs.credit_kernels import effect_to_come, fatigue_rate


@kernel(fastmath=False)
def advance_all(
    running, actions, spans, reach, share, run, time, offset, acted, changes, first, loads, responses, azimuth, pitch,
    lead, weights, use, power, rated, taken, power_at, lasting, credited, effects, rewards, now, scratch,
):  # fmt: skip
    """Advance by one control step: offsets, what they change, and rewards beside zero actions.

    Parameters
    ----------
    running : bool (n_envs,)
        Who advances; the others earn nothing.
    actions : (n_envs, 3)
        Within [-1, 1].
    spans : (3,)
        Offsets at 1 [rad]; ``reach`` is the most that they move in a step [rad].
    share : (n_runs, n)
        In which offsets act.
    run, time : int64 (n_envs,)
    offset, acted : (n_envs, 3)
        Set point, and mean of what acted in the step before [rad].
    changes : (n_envs, n_lags, n_out)
        Changes of outputs by past offsets, in a ring from ``first`` on; the first five are normalized loads.
    loads : (n_runs, n, 5)
    responses : (n_runs, n_lags, n_out, 3)
    azimuth : (n_runs, n)
    pitch : (n_runs, n, n_blades)
    lead : float
        Time from a demand to the pitch over the control step.
    weights : (4,)
        Of `wt_gym.envs.credit_kernels.fatigue_rate`.
    use : float
        Reward of pitch travel [1/rad].
    power : (n_runs, n)
        Recorded [W]; its effect is the output ``power_at``.
    rated : (2,)
        Power up to which there is a reward [W], and that [1/W].
    taken : (n_runs,)
        Cost of the square of the offsets, in power [1/rad^2].
    lasting : int
        Steps that count for the credit; 0: none.
    credited, rewards : (n_envs,)
    effects : (n_envs, n_out)
        Changes of the outputs at the end of the step.
    now, scratch : (3,), (5,)
    """
    for k in range(actions.shape[0]):
        rewards[k] = 0.0
        if not running[k]:
            continue
        row, instant = run[k], time[k]
        size, n_out = changes.shape[1], changes.shape[2]
        part = share[row, instant]
        square = 0.0
        for j in range(3):
            wanted = actions[k, j] * spans[j]
            move = min(max(wanted - offset[k, j], -reach), reach)
            now[j] = part * (offset[k, j] + lead * move)
            offset[k, j] += move
            square += now[j] * now[j]
        place = first[k]
        for lag in range(size):
            at = (place + lag) % size
            for c in range(n_out):
                changes[k, at, c] += (
                    responses[row, lag, c, 0] * now[0]
                    + responses[row, lag, c, 1] * now[1]
                    + responses[row, lag, c, 2] * now[2]
                )
        time[k] = instant + 1
        for c in range(n_out):
            effects[k, c] = changes[k, place, c]
            changes[k, place, c] = 0.0
        first[k] = (place + 1) % size
        for j in range(5):
            scratch[j] = loads[row, instant + 1, j] + effects[k, j]
        reward = fatigue_rate(scratch, weights) - fatigue_rate(loads[row, instant + 1], weights)
        n_blades, travel = pitch.shape[2], 0.0
        for b in range(n_blades):
            before = azimuth[row, instant] + 2.0 * math.pi * b / n_blades
            after = azimuth[row, instant + 1] + 2.0 * math.pi * b / n_blades
            own = pitch[row, instant + 1, b] - pitch[row, instant, b]
            added = now[0] + now[1] * math.cos(after) + now[2] * math.sin(after)
            added -= acted[k, 0] + acted[k, 1] * math.cos(before) + acted[k, 2] * math.sin(before)
            travel += (abs(own + added) - abs(own)) / n_blades
        for j in range(3):
            acted[k, j] = now[j]
        more = min(power[row, time[k]] + effects[k, power_at], rated[0]) - min(power[row, time[k]], rated[0])
        reward += rated[1] * more - use * travel - taken[row] * square
        if lasting > 0:
            ahead = loads[row, instant + 2 : min(instant + 2 + lasting, loads.shape[1])]
            effect = effect_to_come(ahead, changes[k], first[k], weights, scratch)
            reward += effect - credited[k]
            credited[k] = effect
        rewards[k] = reward


@kernel(fastmath=False)
def observe_all(run, time, offset, spans, effects, observations, added, places, offset_places, low, high, out):
    """Observations (n_envs, n_obs), as recorded, with the effects of the own offsets.

    Parameters
    ----------
    observations : (n_runs, n, n_obs)
        Recorded without offsets.
    added : int
        First output that is an effect on an observation; ``places`` (n_added,) says on which.
    offset_places : int64 (n_offsets,)
        Channels of the offsets, of which half the span is one.
    low, high : (n_obs,)
        Ranges.
    """
    for k in range(out.shape[0]):
        recorded = observations[run[k], time[k]]
        for c in range(recorded.shape[0]):
            out[k, c] = recorded[c]
        for c in range(places.shape[0]):
            value = recorded[places[c]] + effects[k, added + c]
            out[k, places[c]] = min(max(value, low[places[c]]), high[places[c]])
        for j in range(offset_places.shape[0]):
            out[k, offset_places[j]] = offset[k, j] / (0.5 * spans[j])
