"""Static balance of the elastic coordinates, and the highest frequency of the structure."""

import numpy as np

from wt_gym.errors import SimulationError
from wt_gym.multibody.errors import MultibodyError

__all__ = ["elastic_equilibrium", "highest_frequency"]

SMALLEST_SHARE = 1.0 / 256.0
"""Of a step of Newton's method, below which there is no balance."""


def elastic_equilibrium(system, y, inputs, work, azimuth_q, azimuth_u, iterations=40, tolerance=1e-9):
    """Newton's method for elastic coordinates that do not accelerate; the rotor's own acceleration stays free.

    The derivatives serve as long as each step is less than half of the one before. A step is halved until the next
    one, with the same derivatives, is shorter than it: of strong loads on a slender blade whole steps lead away.

    Parameters
    ----------
    system : MultibodySystem
        Every velocity but ``azimuth_u`` belongs to an elastic coordinate or spring.
    y : array (n_state,)
        State with zero elastic rates; the elastic coordinates change in place.
    inputs, work : arrays of the system
    azimuth_q, azimuth_u : int
        The coordinate and velocity that turn freely.

    Raises
    ------
    SimulationError
        When no balance is found.
    MultibodyError
        When the mass matrix is singular at the start.
    """
    q = np.array([i for i in range(system.n_q) if i != azimuth_q], dtype=int)
    u = np.array([i for i in range(system.n_u) if i != azimuth_u], dtype=int) + system.n_q
    if len(q) == 0:
        return

    def residual(state):
        return system.rates(state, inputs, work)[u]

    r = residual(y)
    jacobian = _derivatives(residual, y, q, r)
    change = np.linalg.solve(jacobian, -r)
    fresh = True
    for _ in range(iterations):
        if np.abs(change).max() < tolerance * max(1.0, np.abs(y[q]).max()):
            y[q] += change
            return
        origin, share = y[q].copy(), 1.0
        while True:
            y[q] = origin + share * change
            r, following = _step_from(residual, y, jacobian)
            if r is not None and np.linalg.norm(following) < (1.0 - 0.25 * share) * np.linalg.norm(change):
                break
            share *= 0.5
            if share < (SMALLEST_SHARE if fresh else 1.0):
                break
        if share < SMALLEST_SHARE or (not fresh and share < 1.0):
            y[q] = origin
            if fresh:
                raise SimulationError("no static balance of the structure was found for the given start")
            r = residual(y)
        fresh = share < 1.0 or np.linalg.norm(following) > 0.5 * np.linalg.norm(change)
        if fresh:
            jacobian = _derivatives(residual, y, q, r)
            following = np.linalg.solve(jacobian, -r)
        change = following
    raise SimulationError("no static balance of the structure was found for the given start")


def _derivatives(residual, y, q, r, step=1e-4):
    """Of the residual by the coordinates q."""
    jacobian = np.zeros((len(r), len(q)))
    for i, place in enumerate(q):
        origin = y[place]
        y[place] = origin + step
        jacobian[:, i] = (residual(y) - r) / step
        y[place] = origin
    return jacobian


def _step_from(residual, y, jacobian):
    """Residual at y and the step that follows from it; None, None where the structure has left its model."""
    try:
        r = residual(y)
    except MultibodyError:
        return None, None
    return r, np.linalg.solve(jacobian, -r)


def highest_frequency(system, step=1e-5):
    """Highest natural frequency of a system at rest without loads [rad/s]: root of the largest |eigenvalue| of −∂u̇/∂q.

    Only for systems whose positions are joint angles, slides and elastic coordinates.
    """
    origin = system.initial_state()
    accelerations = slice(system.n_q, system.n_q + system.n_u)
    columns = []
    for i in range(system.n_q):
        y = origin.copy()
        y[i] += step
        columns.append(system.rates(y)[accelerations])
    base = system.rates(origin)[accelerations]
    jacobian = (np.array(columns) - base).T / step
    return float(np.sqrt(np.abs(np.linalg.eigvals(jacobian)).max()))
