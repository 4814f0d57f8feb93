"""Compiled vibration modes of symmetric matrices: the same bits whatever the threads of a linear-algebra library."""

import math

from wt_gym.base.compiled import kernel

OK, NOT_DEFINITE, NOT_CONVERGED = 0, 1, 2
EPSILON = 2.0**-53
MOST_SWEEPS = 60


@kernel
def cholesky(matrix, lower):
    """Lower triangle L (n, n) with L Lᵀ = matrix; false where the matrix is not positive definite."""
    for i in range(matrix.shape[0]):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= lower[i, k] * lower[j, k]
            if j < i:
                lower[i, j] = total / lower[j, j]
            elif total > 0.0:
                lower[i, i] = math.sqrt(total)
            else:
                return False
    return True


@kernel
def solve_rows(lower, rows):
    """Replace every row x (…, n) by L⁻¹ x."""
    for r in range(rows.shape[0]):
        for i in range(lower.shape[0]):
            total = rows[r, i]
            for k in range(i):
                total -= lower[i, k] * rows[r, k]
            rows[r, i] = total / lower[i, i]


@kernel
def transpose(matrix):
    """Transpose a square matrix in place."""
    for i in range(matrix.shape[0]):
        for j in range(i):
            matrix[i, j], matrix[j, i] = matrix[j, i], matrix[i, j]


@kernel
def rotate(matrix, vectors, p, q):
    """Make the entry (p, q) of a symmetric matrix zero by a turn in the plane of p and q, which the vectors follow."""
    n = matrix.shape[0]
    theta = 0.5 * (matrix[q, q] - matrix[p, p]) / matrix[p, q]
    t = math.copysign(1.0, theta) / (abs(theta) + math.hypot(theta, 1.0))
    c = 1.0 / math.sqrt(t * t + 1.0)
    s = t * c
    shift = t * matrix[p, q]
    matrix[p, p] -= shift
    matrix[q, q] += shift
    matrix[p, q] = matrix[q, p] = 0.0
    for k in range(n):
        if k != p and k != q:
            first, second = matrix[p, k], matrix[q, k]
            matrix[p, k] = c * first - s * second
            matrix[q, k] = s * first + c * second
            matrix[k, p], matrix[k, q] = matrix[p, k], matrix[q, k]
    for k in range(n):
        first, second = vectors[p, k], vectors[q, k]
        vectors[p, k] = c * first - s * second
        vectors[q, k] = s * first + c * second


@kernel
def jacobi(matrix, vectors):
    """Diagonalise a symmetric matrix in place by turns in all planes in turn; the rows of ``vectors`` follow.

    (Jacobi's method, cyclic by rows: Golub & Van Loan, Matrix Computations, section 8.5.) An entry counts as zero when
    it is below the rounding of the two diagonal entries beside it. Returns the number of sweeps, or zero when
    `MOST_SWEEPS` were not enough.
    """
    n = matrix.shape[0]
    for i in range(n):
        for k in range(n):
            vectors[i, k] = 1.0 if i == k else 0.0
    for sweep in range(MOST_SWEEPS):
        turned = False
        for p in range(n - 1):
            for q in range(p + 1, n):
                size = math.sqrt(abs(matrix[p, p])) * math.sqrt(abs(matrix[q, q]))
                if abs(matrix[p, q]) > EPSILON * size:
                    rotate(matrix, vectors, p, q)
                    turned = True
        if not turned:
            return sweep + 1
    return 0


@kernel
def symmetric_modes(stiffness, mass, lower, reduced, vectors):
    """All solutions of K φ = λ M φ.

    With M = L Lᵀ the eigenvectors ψ of L⁻¹ K L⁻ᵀ give φ = L⁻ᵀ ψ, with φᵀ M φ = 1.

    Parameters
    ----------
    stiffness, mass : (n, n)
        K and M, symmetric; M positive definite.
    lower : (n, n)
        Work.
    reduced : (n, n)
        Result: the eigenvalues on the diagonal, in no order.
    vectors : (n, n)
        Result: the eigenvectors φ as rows.

    Returns
    -------
    int
        OK, NOT_DEFINITE or NOT_CONVERGED.
    """
    n = mass.shape[0]
    if not cholesky(mass, lower):
        return NOT_DEFINITE
    for i in range(n):
        for k in range(n):
            reduced[i, k] = stiffness[i, k]
    solve_rows(lower, reduced)
    transpose(reduced)
    solve_rows(lower, reduced)
    for i in range(n):
        for k in range(i):
            reduced[i, k] = reduced[k, i] = 0.5 * (reduced[i, k] + reduced[k, i])
    if jacobi(reduced, vectors) == 0:
        return NOT_CONVERGED
    for r in range(n):
        for i in range(n - 1, -1, -1):
            total = vectors[r, i]
            for k in range(i + 1, n):
                total -= lower[k, i] * vectors[r, k]
            vectors[r, i] = total / lower[i, i]
    return OK
