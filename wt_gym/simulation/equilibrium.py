"""Static balance of the elastic coordinates, and the highest frequency of the structure."""

import numpy as np

from wt_gym.errors import SimulationError

__all__ = ["elastic_equilibrium", "highest_frequency"]

RENEWED = 6
"""Steps of Newton's method with the same derivatives."""


def elastic_equilibrium(system, y, inputs, work, azimuth_q, azimuth_u, iterations=24, tolerance=1e-9):
    """Newton's method for elastic coordinates that do not accelerate; the rotor's own acceleration stays free.

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
        When the mass matrix is singular.
    """
    q = np.array([i for i in range(system.n_q) if i != azimuth_q], dtype=int)
    u = np.array([i for i in range(system.n_u) if i != azimuth_u], dtype=int) + system.n_q
    step = 1e-4
    if len(q) == 0:
        return

    def residual(state):
        return system.rates(state, inputs, work)[u]

    jacobian = np.zeros((len(u), len(q)))

    for k in range(iterations):
        r = residual(y)
        if k % RENEWED == 0:  # nearly linear: the first derivatives serve for a while
            for i, place in enumerate(q):
                origin = y[place]
                y[place] = origin + step
                jacobian[:, i] = (residual(y) - r) / step
                y[place] = origin
        change = np.linalg.solve(jacobian, -r)
        y[q] += change
        if np.abs(change).max() < tolerance * max(1.0, np.abs(y[q]).max()):
            return
    if np.abs(change).max() > 1e-3 * max(1.0, np.abs(y[q]).max()):
        raise SimulationError("no static balance of the structure was found for the given start")


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
