"""Compiled assembly of the coherence matrices of a Kaimal box."""

import math

from wt_gym.base.compiled import kernel

_HALF_ROOT = math.sqrt(0.5)


@kernel(fastmath=False)
def parity_block(table, m_z, m_y, out):
    """Lower triangles of the coherence matrices between basis vectors of one parity per axis, the last vector first.

    For vectors (i_z, i_y) and (j_z, j_y) that are even (σ = 1) or odd (σ = −1) under the mirrors of the grid, and the
    coherence c of two points by their distance in steps along z and y,
    w_i w_j [c(|Δz|, |Δy|) + σ_y c(|Δz|, Σy) + σ_z (c(Σz, |Δy|) + σ_y c(Σz, Σy))], Δ = i − j, Σ = n − 1 − i − j. The
    middle line of points is its own image: w = √½ for each axis along which an even vector stands on it, otherwise 1.

    Parameters
    ----------
    table : numpy.ndarray
        Coherence of two points by frequency and distance in grid steps, shape (n_frequencies, n_z, n_y).
    m_z, m_y : int
        Vectors along each axis: n // 2 + 1 that are even, or n // 2 that are odd.
    out : numpy.ndarray
        Shape (n_frequencies, m_z m_y, m_z m_y). What lies above the diagonals is left as it is.
    """
    n_frequencies, n_z, n_y = table.shape
    half_z, half_y = n_z // 2, n_y // 2
    last = m_z * m_y - 1
    sign_z, sign_y = 1.0 if m_z > half_z else -1.0, 1.0 if m_y > half_y else -1.0
    for f in range(n_frequencies):
        for i_z in range(m_z):
            for i_y in range(m_y):
                row = last - (i_z * m_y + i_y)
                weight_i = (_HALF_ROOT if i_z == half_z else 1.0) * (_HALF_ROOT if i_y == half_y else 1.0)
                for j_z in range(i_z, m_z):
                    along_z, across_z = j_z - i_z, n_z - 1 - i_z - j_z
                    weight_z = _HALF_ROOT if j_z == half_z else 1.0
                    for j_y in range(i_y if j_z == i_z else 0, m_y):
                        along_y, across_y = abs(i_y - j_y), n_y - 1 - i_y - j_y
                        weight_j = weight_z * (_HALF_ROOT if j_y == half_y else 1.0)
                        same = table[f, along_z, along_y] + sign_y * table[f, along_z, across_y]
                        mirrored = table[f, across_z, along_y] + sign_y * table[f, across_z, across_y]
                        value = same + sign_z * mirrored
                        out[f, row, last - (j_z * m_y + j_y)] = weight_i * value * weight_j
