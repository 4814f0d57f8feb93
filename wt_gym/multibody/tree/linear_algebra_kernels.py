"""Compiled factorizations of small dense matrices, in place."""

import math

from wt_gym.base.compiled import kernel


@kernel
def cholesky(a):
    """Factor a = L Lᵀ in place (lower triangle); False if a is not positive definite, which spares row exchanges."""
    n = a.shape[0]
    for j in range(n):
        s = a[j, j]
        full = s
        for k in range(j):
            s -= a[j, k] * a[j, k]
        if not s > 1e-14 * full:
            return False
        root = math.sqrt(s)
        a[j, j] = root
        inverse = 1.0 / root
        for i in range(j + 1, n):
            s = a[i, j]
            for k in range(j):
                s -= a[i, k] * a[j, k]
            a[i, j] = s * inverse
    return True


@kernel
def solve_lower(a, b):
    """Replace b by L⁻¹ b."""
    for i in range(b.shape[0]):
        s = b[i]
        for k in range(i):
            s -= a[i, k] * b[k]
        b[i] = s / a[i, i]


@kernel
def solve_upper(a, b):
    """Replace b by L⁻ᵀ b."""
    n = b.shape[0]
    for i in range(n - 1, -1, -1):
        s = b[i]
        for k in range(i + 1, n):
            s -= a[k, i] * b[k]
        b[i] = s / a[i, i]


@kernel
def factorize(a, order):
    """P a = L U in place with row exchanges, which ``order`` (n,) keeps; False if a is singular.

    For general matrices. Others have cheaper factors without exchanges: symmetric positive definite ones `cholesky`,
    those with the pattern of a tree `factorize_tree` (`wt_gym.multibody.tree.sparse_kernels`), and those of a band with
    a positive definite symmetric part `factorize_envelope` (in the matrices of observer frames).
    """
    n, scale = a.shape[0], 0.0
    for i in range(n):
        for j in range(n):
            scale = max(scale, abs(a[i, j]))
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(a[i, k]) > abs(a[best, k]):
                best = i
        if not abs(a[best, k]) > 1e-14 * scale:
            return False
        order[k] = best
        if best != k:
            for j in range(n):
                a[k, j], a[best, j] = a[best, j], a[k, j]
        inverse = 1.0 / a[k, k]
        for i in range(k + 1, n):
            if a[i, k] != 0.0:
                factor = a[i, k] * inverse
                a[i, k] = factor
                for j in range(k + 1, n):
                    a[i, j] -= factor * a[k, j]
    return True


@kernel
def solve_factorized(a, order, b):
    """Replace b by a⁻¹ b with the factors of `factorize`."""
    n = a.shape[0]
    for k in range(n):
        p = order[k]
        if p != k:
            b[k], b[p] = b[p], b[k]
    for i in range(n):
        s = b[i]
        for k in range(i):
            s -= a[i, k] * b[k]
        b[i] = s
    for i in range(n - 1, -1, -1):
        s = b[i]
        for k in range(i + 1, n):
            s -= a[i, k] * b[k]
        b[i] = s / a[i, i]
