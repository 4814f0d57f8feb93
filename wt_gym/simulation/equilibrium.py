"""Static balance of the elastic coordinates under given loads and a given steady rotation."""

import numpy as np

from wt_gym.errors import SimulationError
from wt_gym.multibody import tree_kernels

__all__ = ["elastic_equilibrium"]


def elastic_equilibrium(system, y, inputs, work, azimuth_q, azimuth_u, iterations=12, tolerance=1e-9):
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
    """
    q = np.array([i for i in range(system.n_q) if i != azimuth_q])
    u = np.array([i for i in range(system.n_u) if i != azimuth_u]) + system.n_q
    dy, step = np.zeros(system.n_state), 1e-4

    def residual(state):
        if not tree_kernels.rates(state, 0.0, inputs, system.tree, work, dy):
            raise SimulationError("no static balance: singular mass matrix")
        return dy[u].copy()

    jacobian = np.zeros((len(u), len(q)))
    for _ in range(iterations):
        r = residual(y)
        for k, i in enumerate(q):
            origin = y[i]
            y[i] = origin + step
            jacobian[:, k] = (residual(y) - r) / step
            y[i] = origin
        change = np.linalg.solve(jacobian, -r)
        y[q] += change
        if np.abs(change).max() < tolerance * max(1.0, np.abs(y[q]).max()):
            return
    if np.abs(change).max() > 1e-3 * max(1.0, np.abs(y[q]).max()):
        raise SimulationError("no static balance of the structure was found for the given start")
