"""Compiled factorization of the mass matrix of a tree, which leaves out what the branches keep zero.

An entry M_ij is zero unless one of the velocities i, j lies on the way of the other to the ground. With λ(i) the
velocity next to i on that way the factorization M = Lᵀ L, begun at the tips, fills nothing in: three blades cost three
times one (Featherstone, Rigid Body Dynamics Algorithms, 2008, section 6.4).
It serves any symmetric matrix of that pattern.
"""

import math

from wt_gym.base.compiled import kernel


@kernel
def factorize_tree(a, parent):
    """Replace the lower triangle of a = Lᵀ L by that of L; False if a is not positive definite.

    parent (n,) is λ, −1 at the ground.
    """
    for k in range(parent.shape[0] - 1, -1, -1):
        if not a[k, k] > 0.0:
            return False
        a[k, k] = math.sqrt(a[k, k])
        inverse = 1.0 / a[k, k]
        i = parent[k]
        while i >= 0:
            a[k, i] *= inverse
            i = parent[i]
        i = parent[k]
        while i >= 0:
            factor = a[k, i]
            j = i
            while j >= 0:
                a[i, j] -= factor * a[k, j]
                j = parent[j]
            i = parent[i]
    return True


@kernel
def solve_tree(a, parent, b):
    """Solve with the factor of `factorize_tree`, in place of b."""
    n = parent.shape[0]
    for i in range(n - 1, -1, -1):
        b[i] /= a[i, i]
        j = parent[i]
        while j >= 0:
            b[j] -= a[i, j] * b[i]
            j = parent[j]
    for i in range(n):
        j = parent[i]
        while j >= 0:
            b[i] -= a[i, j] * b[j]
            j = parent[j]
        b[i] /= a[i, i]


@kernel
def multiply_tree(a, parent, x, out):
    """Out = a x for the symmetric matrix of which the lower triangle of a holds the tree's entries."""
    n = parent.shape[0]
    for i in range(n):
        out[i] = a[i, i] * x[i]
    for i in range(n):
        j = parent[i]
        while j >= 0:
            out[i] += a[i, j] * x[j]
            out[j] += a[i, j] * x[i]
            j = parent[j]
