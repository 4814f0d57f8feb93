"""Matrices of one body in a local observer frame: envelope storage, factors, products, inertia and stiffness.

Row i of ``low`` holds A[i, j] and row i of ``up`` holds A[j, i] for j = first[i] … i (the diagonal lives in ``up``).
Elastic coordinates come first and the six rigid-body coordinates last, so that finite elements give a narrow band with
a six-row border and a modal basis a small full matrix: both are factorized by the same loops at the cost their shape
deserves. Of the constant matrices only the lower triangles are read.
"""

from wt_gym.base.compiled import kernel

# ---- envelope matrices ---------------------------------------------------------------------------------------------


@kernel
def factorize_envelope(start, n, first, low, up, definite):
    """A = L U in place, L with unit diagonal, from the row start on; False when a pivot is not positive.

    No pivoting is needed: the matrices have a positive definite symmetric part. Where they are not ``definite``, since
    the inertia of a rotor is shared out between bodies, pivots have either sign and must not vanish.
    """
    for i in range(start, n):
        fi = first[i]
        for j in range(fi, i):
            lower, upper = low[i, j], up[i, j]
            for k in range(max(fi, first[j]), j):
                lower -= low[i, k] * up[j, k]
                upper -= low[j, k] * up[i, k]
            low[i, j] = lower / up[j, j]
            up[i, j] = upper
        pivot = up[i, i]
        for k in range(fi, i):
            pivot -= low[i, k] * up[i, k]
        size = pivot if definite else abs(pivot)
        if not size > 1e-13 * abs(up[i, i]):
            return False
        up[i, i] = pivot
    return True


@kernel
def solve_envelope(n, first, low, up, x):
    """Solve x ← A⁻¹ x with the factors of `factorize_envelope`."""
    for i in range(n):
        value = x[i]
        for k in range(first[i], i):
            value -= low[i, k] * x[k]
        x[i] = value
    for i in range(n - 1, -1, -1):
        value = x[i] / up[i, i]
        x[i] = value
        for k in range(first[i], i):
            x[k] -= up[i, k] * value


# ---- inertia and stiffness of one body -----------------------------------------------------------------------------


@kernel
def gyroscopic_product(b, w, model, x, out):
    """Out += G(w) x with G(w) = w₁ G₁ + w₂ G₂ + w₃ G₃ (skew-symmetric)."""
    g = model.gyro[b]
    for i in range(model.n[b]):
        total = 0.0
        for j in range(model.first[b, i], i):
            entry = w[0] * g[0, i, j] + w[1] * g[1, i, j] + w[2] * g[2, i, j]
            total += entry * x[j]
            out[j] -= entry * x[i]
        out[i] += total


@kernel
def mass_product(b, model, x, out):
    """Out += M x."""
    second = model.second[b]
    for i in range(model.n[b]):
        total = 0.0
        for j in range(model.first[b, i], i):
            entry = second[0, i, j] + second[1, i, j] + second[2, i, j]
            total += entry * x[j]
            out[j] += entry * x[i]
        out[i] += total + (second[0, i, i] + second[1, i, i] + second[2, i, i]) * x[i]
    if model.bends[b]:
        extra = model.extra_mass[b]
        for i in range(model.n[b] - 6):
            for j in range(model.n[b] - 6):
                out[i] += extra[i, j] * x[j]


@kernel
def step_matrix(b, h, model, state, low, up):
    """S = (1−αm)/(1−αf)/(β h²) M + γ/(β h) (2 G + C) + K + Ġ + D + K_g, the matrix of a step of `model.rule`."""
    beta, gamma, alpha_m, alpha_f = model.rule
    cd = gamma / (beta * h)
    g, a, stiffness, damping = model.gyro[b], model.second[b], model.stiffness[b], model.damping[b]
    w0, w1, w2 = state.omega[b, 0], state.omega[b, 1], state.omega[b, 2]
    # odd part: 2γ/(βh) G(ω) + G(α)
    c0 = 2.0 * cd * w0 + state.alpha[b, 0]
    c1 = 2.0 * cd * w1 + state.alpha[b, 1]
    c2 = 2.0 * cd * w2 + state.alpha[b, 2]
    inertia = (1.0 - alpha_m) / ((1.0 - alpha_f) * beta * h * h)
    cm = inertia - (w0 * w0 + w1 * w1 + w2 * w2)
    d00, d11, d22 = cm + w0 * w0, cm + w1 * w1, cm + w2 * w2
    d01, d02, d12 = w0 * w1, w0 * w2, w1 * w2
    for i in range(model.n[b]):
        for j in range(model.first[b, i], i + 1):
            even = d00 * a[0, i, j] + d11 * a[1, i, j] + d22 * a[2, i, j] + stiffness[i, j] + cd * damping[i, j]
            even += d01 * a[3, i, j] + d02 * a[4, i, j] + d12 * a[5, i, j]
            odd = c0 * g[0, i, j] + c1 * g[1, i, j] + c2 * g[2, i, j]
            low[i, j] = even + odd
            up[i, j] = even - odd
    if model.bends[b]:
        extra, geometric = model.extra_mass[b], model.geometric[b]
        for i in range(model.n[b] - 6):
            for j in range(i + 1):
                more = inertia * extra[i, j] + geometric[i, j]
                low[i, j] += more
                up[i, j] += more


@kernel
def inner_forces(b, model, state, q, v, out):
    """Out = −(K + Ġ + D) q − (2 G + C) v − M₀ᵀ (a_c − g) − J̇₀ᵀ + J₂ᵀ at the frame's present motion."""
    gyro, a, stiffness, damping = model.gyro[b], model.second[b], model.stiffness[b], model.damping[b]
    w0, w1, w2 = state.omega[b, 0], state.omega[b, 1], state.omega[b, 2]
    a0, a1, a2 = state.alpha[b, 0], state.alpha[b, 1], state.alpha[b, 2]
    square = w0 * w0 + w1 * w1 + w2 * w2
    d00, d11, d22 = w0 * w0 - square, w1 * w1 - square, w2 * w2 - square
    d01, d02, d12 = w0 * w1, w0 * w2, w1 * w2
    n = model.n[b]
    for i in range(n):
        out[i] = 0.0
    for i in range(n):
        total, qi, vi = 0.0, q[i], v[i]
        for j in range(model.first[b, i], i + 1):
            c = damping[i, j]
            even = stiffness[i, j] + d00 * a[0, i, j] + d11 * a[1, i, j] + d22 * a[2, i, j]
            even += d01 * a[3, i, j] + d02 * a[4, i, j] + d12 * a[5, i, j]
            g0, g1, g2 = gyro[0, i, j], gyro[1, i, j], gyro[2, i, j]
            euler = a0 * g0 + a1 * g1 + a2 * g2
            coriolis = 2.0 * (w0 * g0 + w1 * g1 + w2 * g2)
            total += (even + euler) * q[j] + (coriolis + c) * v[j]
            if j < i:
                out[j] -= (even - euler) * qi + (c - coriolis) * vi
        out[i] -= total
    # frame acceleration without gravity, in frame axes, and (α̃ + ω̃ ω̃) for the forces on the undeformed body
    r = state.rotation[b]
    f0 = state.acceleration[b, 0] - model.gravity[0]
    f1 = state.acceleration[b, 1] - model.gravity[1]
    f2 = state.acceleration[b, 2] - model.gravity[2]
    b0 = r[0, 0] * f0 + r[1, 0] * f1 + r[2, 0] * f2
    b1 = r[0, 1] * f0 + r[1, 1] * f1 + r[2, 1] * f2
    b2 = r[0, 2] * f0 + r[1, 2] * f1 + r[2, 2] * f2
    m0, x = model.first_moment[b], model.reference_moment[b]
    for i in range(n):
        out[i] -= (
            m0[i, 0] * b0
            + m0[i, 1] * b1
            + m0[i, 2] * b2
            + x[i, 0] * d00
            + x[i, 4] * d11
            + x[i, 8] * d22
            + x[i, 1] * (d01 - a2)
            + x[i, 3] * (d01 + a2)
            + x[i, 2] * (d02 + a1)
            + x[i, 6] * (d02 - a1)
            + x[i, 5] * (d12 - a0)
            + x[i, 7] * (d12 + a0)
        )
