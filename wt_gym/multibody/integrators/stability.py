"""Largest steps of the integrators: amplification of the schemes, and the roots of a system about a state.

A scheme is stable for a mode with eigenvalue λ when no root of its difference equation on y' = λy exceeds one. The
roots of a system come from its equations of motion linearized about the state from which it starts. They hold near
that state; a rotor that speeds up stiffens, so that the step should leave some reserve.
"""

from functools import cache
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wt_gym.base.quantities import Array
from wt_gym.multibody.arrays import Inputs, MultibodyError, Work
from wt_gym.multibody.system import MultibodySystem

Complex = NDArray[np.complex128]


BAUMGARTE_LIMIT = 1.29
"""Largest α h of the modified Hamming scheme with a converged corrector."""
GROWTH = 1e-7
"""Growth in a step above which a scheme counts as unstable in a limit."""
NOTABLE = 1e-6
"""Growth in a step from which a start is refused; difference quotients know the damping of a mode no better."""
AIR_DAMPING = 0.5
"""Rate kappa at which the air damps blades that move out of the rotor plane, times the interval between its loads.

kappa = rho a c V / 2 m' with a = 2 pi: 4 to 5 1/s at 70 % of the blades of the NREL 5-MW, and the interval is 0.1 s.
The product does not depend on the size of a turbine, whose interval turns the rotor by a given angle."""


def hamming_matrix(z: ArrayLike, passes: int | None, final: bool = True) -> Complex:
    """The modified Hamming scheme on y' = λ y with z = λ h, from its formulas.

    Carried are y and h f of four points and the error estimate; f is evaluated again at the final y.

    Parameters
    ----------
    z : complex or array
    passes : int or None
        Corrector passes; None is the converged corrector.
    final : bool
        With the final correction.

    Returns
    -------
    array (..., 8, 8), complex
        For z of shape (...).
    """
    z = np.asarray(z)[..., None]
    unit = np.eye(8, dtype=complex)
    y, f, e = unit[[3, 2, 1, 0]], [None, *unit[[6, 5, 4]]], unit[7]
    predicted = y[0] + 4.0 / 3.0 * (2.0 * f[3] - f[2] + 2.0 * f[1])
    known = (9.0 * y[3] - y[1] + 3.0 * (2.0 * f[3] - f[2])) / 8.0
    if passes is None:
        corrected = known / (1.0 - 3.0 * z / 8.0)
    else:
        corrected = predicted + 112.0 / 9.0 * e
        for _ in range(passes):
            corrected = known + 3.0 * z / 8.0 * corrected
    error = 9.0 / 121.0 * (corrected - predicted)
    new = corrected - error if final else corrected
    return np.stack(np.broadcast_arrays(new, y[3], y[2], y[1], z * new, f[3], f[2], error), axis=-2)


def _limit(direction: complex, passes: int | None) -> float:
    """Length of z along a direction of the complex plane up to which the scheme is stable."""
    step = 0.002
    for size in np.arange(step, 3.0, step):
        if np.abs(np.linalg.eigvals(hamming_matrix(direction * size, passes))).max() > 1.0 + GROWTH:
            return float(size - step)
    return 3.0


@cache
def undamped_limit(passes: int | None) -> float:
    """Largest ω h of an undamped mode: 0.276, 0.78 and 1.08 for one, two and three corrector passes."""
    return _limit(1j, passes)


@cache
def damped_limit(passes: int | None) -> float:
    """Largest α h of a real root −α: 0.87, 0.72 and 1.46 for one, two and three corrector passes."""
    return _limit(-1.0, passes)


def predicted_growth(phase: float, n_steps: int, passes: int, air_passes: int) -> float:
    """Growth of a mode in the interval between two loads of the air, the motion of whose first pass is only predicted.

    A mode q'' + omega^2 q = F feels F = -kappa q' with the velocity at the end of the interval, and F runs linearly
    from one end to the other. The first pass moves it by the predictor alone, under the extrapolated load 2 F_0 - F_-1;
    each further pass by the whole scheme, under F + (F_new - F) / (1 + kappa T / 2), the share that ends the iteration
    for a heavy mode; the last load stands. With kappa T = `AIR_DAMPING` and two passes, three steps have a root beyond
    -1 from omega h = 0.66 on, while two and four steps have none up to 0.8.

    Parameters
    ----------
    phase : float
        omega h of a structural step.
    n_steps : int
        Structural steps in the interval.
    passes : int
        Corrector passes of a structural step.
    air_passes : int
        Passes of loads and structure, at least 2.

    Returns
    -------
    float
        Spectral radius of the interval minus 1.
    """
    mode = np.array([[0.0, 1.0], [-(phase**2), 0.0]])
    damping = AIR_DAMPING / n_steps  # h is the unit of time
    share = 1.0 / (1.0 + 0.5 * AIR_DAMPING)
    unit = np.eye(20)  # y and f of four points, error estimate, the last two loads
    start = list(unit[:8].reshape(4, 2, 20)), list(unit[8:16].reshape(4, 2, 20)), unit[16:18]
    load, before = unit[18], unit[19]

    def move(end: Array, corrections: int) -> tuple[list[Any], list[Any], Any]:
        y, f, error = list(start[0]), list(start[1]), start[2]
        for k in range(n_steps):
            force = np.zeros((2, 20))
            force[1] = load + (k + 1.0) / n_steps * (end - load)
            predicted = y[0] + 4.0 / 3.0 * (2.0 * f[3] - f[2] + 2.0 * f[1])
            new = predicted + 112.0 / 9.0 * error
            for _ in range(corrections):
                new = (9.0 * y[3] - y[1] + 3.0 * (mode @ new + force + 2.0 * f[3] - f[2])) / 8.0
            if corrections:
                error = 9.0 / 121.0 * (new - predicted)
                new = new - error
            y, f = [*y[1:], new], [*f[1:], mode @ new + force]
        return y, f, error

    end = 2.0 * load - before
    y, f, error = move(end, 0)
    for _ in range(air_passes - 1):
        end = end + share * (-damping * y[3][1] - end)
        y, f, error = move(end, passes)
    last = -damping * y[3][1]
    f[3] = f[3] + np.array([[0.0], [1.0]]) * (last - end)
    interval = np.vstack((*y, *f, error, last, load))
    return float(np.abs(np.linalg.eigvals(interval)).max() - 1.0)


def system_eigenvalues(
    system: MultibodySystem, y: Array, inputs: Inputs | None = None, work: Work | None = None
) -> Complex:
    """Eigenvalues [1/s] of small motions about a state, servos included.

    Positions are perturbed along the velocities, so that quaternions turn by small rotations about body axes.

    Parameters
    ----------
    y : array (n_state,)
    inputs, work : arrays of the system, optional

    Returns
    -------
    array (2 n_u + 2 n_servo,), complex
    """
    n_q, n_u, step = system.n_q, system.n_u, 1e-6  # of the differences
    accelerations = slice(n_q, n_q + n_u)
    inputs, work = inputs or system.new_inputs(), work or system.new_work()
    matrix = np.zeros((2 * n_u, 2 * n_u))
    matrix[:n_u, n_u:] = np.eye(n_u)
    for u in range(n_u):
        direction = system.position_change(y, u)
        columns = []
        for sign in (1.0, -1.0):
            moved = y.copy()
            moved[:n_q] += sign * step * direction
            for first, _ in system.quaternions:
                moved[first : first + 4] /= np.linalg.norm(moved[first : first + 4])
            columns.append(system.rates(moved, inputs, work)[accelerations])
        matrix[n_u:, u] = (columns[0] - columns[1]) / (2.0 * step)
        columns = []
        for sign in (1.0, -1.0):
            moved = y.copy()
            moved[n_q + u] += sign * step
            columns.append(system.rates(moved, inputs, work)[accelerations])
        matrix[n_u:, n_u + u] = (columns[0] - columns[1]) / (2.0 * step)
    w, z = system.tree.servo_frequency, system.tree.servo_damping
    apart = np.emath.sqrt(z * z - 1.0)  # of s² + 2 ζ ω s + ω²
    return np.concatenate([np.linalg.eigvals(matrix), w * (-z + apart), w * (-z - apart)])


def hamming_growth(roots: ArrayLike, step: float, passes: int | None) -> Array:
    """Growth in a step of the modified Hamming scheme beyond that of the motion itself, for roots λ (n,) [1/s]."""
    z = np.asarray(roots) * step
    radius = np.abs(np.linalg.eigvals(hamming_matrix(z, passes))).max(axis=1)
    true = np.maximum(np.abs(np.exp(z)), 1.0)
    return np.asarray(radius - true - 0.5 * (true - 1.0))


def check_hamming_step(
    system: MultibodySystem, y: Array, step: float, passes: int, inputs: Inputs | None = None, work: Work | None = None
) -> None:
    """Refuse a step with which the modified Hamming scheme is unstable near a state.

    Every root of the system is held against the roots of the scheme, Baumgarte's stabilization against its limit too.

    Parameters
    ----------
    y : array (n_state,)
    step : float
        [s].
    passes : int
        Corrector passes.
    inputs, work : arrays of the system, optional

    Raises
    ------
    MultibodyError
        Naming ω or α, the step, their product and what is allowed.
    """
    alpha, limit = system.stabilization, min(BAUMGARTE_LIMIT, damped_limit(passes))
    if system.constraints and alpha * step > limit:
        raise MultibodyError(
            f"the step exceeds the stability limit: the stabilization α = {alpha:.4g} 1/s at a step of {step:.4g} s "
            f"gives α h = {alpha * step:.3g}; allowed with {passes} corrector pass(es): {limit:.3g}"
        )
    roots = system_eigenvalues(system, y, inputs, work)
    roots = roots[roots.imag >= 0.0]  # the conjugate ones grow alike
    growth = hamming_growth(roots, step, passes)
    k = int(np.argmax(growth))
    if growth[k] > NOTABLE:
        _refuse(roots[k], step, undamped_limit(passes), f"with {passes} corrector pass(es)")


def check_conditional_step(
    system: MultibodySystem, y: Array, step: float, limit: float, inputs: Inputs | None = None, work: Work | None = None
) -> None:
    """Refuse a step with ω h beyond the limit of a conditionally stable implicit scheme; arguments as above.

    Raises
    ------
    MultibodyError
        Naming ω, the step, their product and what is allowed.
    """
    roots = system_eigenvalues(system, y, inputs, work)
    k = int(np.argmax(np.abs(roots)))
    if abs(roots[k]) * step > limit:
        _refuse(roots[k], step, limit, "of this scheme")


def _refuse(root: complex, step: float, limit: float, scheme: str) -> NoReturn:
    raise MultibodyError(
        f"the step exceeds the stability limit: a motion with ω = {abs(root):.5g} rad/s (damping ratio "
        f"{-root.real / abs(root) + 0.0:.3g}) at a step of {step:.4g} s gives ω h = {abs(root) * step:.3g}; "
        f"the undamped limit {scheme} is {limit:.3g}"
    )
