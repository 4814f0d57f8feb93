"""Compiled assembly of an observation: what comes from the signals, and scales and ranges."""

import math

from wt_gym.base.compiled import kernel

MEAN, TILT = 0, 1  # of `FIXED_FRAME`


@kernel(fastmath=False)
def read_signals(signals, places, into, blades, parts, azimuth, cyclic_into, values):
    """Channels of the simulator, and coordinates of the blades in the fixed frame (`wt_gym.control.sensors`).

    Parameters
    ----------
    signals : (n_signals,)
    places, into : int64 (n_own,)
        Where the channels stand in the signals, and in the values.
    blades : int64 (n_cyclic, n_blades)
        Where the quantities stand in the signals of which a coordinate is observed.
    parts : int64 (n_cyclic,)
        Which coordinate, by its place in `wt_gym.control.sensors.FIXED_FRAME`.
    azimuth : float
        Of blade 1 [rad].
    cyclic_into : int64 (n_cyclic,)
        Where the coordinates stand in the values.
    values : (n,)
    """
    for k in range(places.shape[0]):
        values[into[k]] = signals[places[k]]
    n_blades = blades.shape[1]
    for k in range(blades.shape[0]):
        total, factor = 0.0, 1.0 if parts[k] == MEAN else 2.0
        for b in range(n_blades):
            psi, direction = azimuth + 2.0 * math.pi / n_blades * b, 1.0
            if parts[k] != MEAN:
                direction = math.cos(psi) if parts[k] == TILT else math.sin(psi)
            total += signals[blades[k, b]] * direction
        values[cyclic_into[k]] = total * (factor / n_blades)


@kernel(fastmath=False)
def normalize(values, low, high, offset, scale, observation):
    """Kept within their range, less the offset and over the scale; returns how many lie outside of it.

    values, low, high, offset, scale : (n,); observation : float32 (n,)
    """
    outside = 0
    for k in range(values.shape[0]):
        value = values[k]
        if value < low[k] or value > high[k]:
            value = low[k] if value < low[k] else high[k]
            outside += 1
        observation[k] = (value - offset[k]) / scale[k]
    return outside
