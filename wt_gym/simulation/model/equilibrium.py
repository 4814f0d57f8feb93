"""Static balance of the elastic coordinates, and the highest frequency of the structure."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wt_gym.base.errors import SimulationError
from wt_gym.multibody.errors import MultibodyError

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from wt_gym.multibody.arrays import Inputs, Work
    from wt_gym.multibody.system import MultibodySystem

__all__ = ["elastic_equilibrium", "highest_frequency"]

ROUNDING = 1e-6
"""Change of the coordinates, over their size, below which a step that leads no nearer is rounding: nodal coordinates
are 1e9 times as stiff against each other as the blade as a whole."""
SMALLEST_SHARE = 1.0 / 256.0
"""Of a step of Newton's method, below which there is no balance."""


def elastic_equilibrium(
    system: MultibodySystem,
    y: NDArray[np.float64],
    inputs: Inputs,
    work: Work,
    azimuth_q: int,
    azimuth_u: int,
    of_forces: bool = False,
    iterations: int = 40,
    tolerance: float = 1e-9,
    accelerations: float | NDArray[np.float64] = 0.0,
) -> None:
    """Newton's method for elastic coordinates that do not accelerate, or as told; the rotor's own acceleration is free.

    A step is halved until the next one, with the same derivatives, is shorter: where strong loads bend slender blades
    far, whole steps lead away (natural monotonicity, Deuflhard, Newton Methods for Nonlinear Problems, 2004).

    Parameters
    ----------
    system : MultibodySystem
        Every velocity but ``azimuth_u`` belongs to an elastic coordinate or spring.
    y : array (n_state,)
        State, of whose coordinates the elastic ones change in place.
    inputs, work : arrays of the system
    azimuth_q, azimuth_u : int
        The coordinate and velocity that turn freely.
    of_forces : bool
        Balance forces, r = f − M_a u̇_a with the column M_a of the velocity that turns freely and u̇_a = f_a/M_aa,
        instead of accelerations. In nodal coordinates the accelerations of one small turn of a node exceed those of a
        bent blade so far that differences show nothing of these.
    accelerations : float or array (n_u - 1,)
        That the elastic velocities are to have; with forces 0.

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

    def residual(state: NDArray[np.float64]) -> NDArray[np.float64]:
        if not of_forces:
            rates: NDArray[np.float64] = system.rates(state, inputs, work)[u] - accelerations
            return rates
        mass, force = system.balance(state, inputs, work)
        column = np.concatenate([mass[azimuth_u, :azimuth_u], mass[azimuth_u:, azimuth_u]])
        free: NDArray[np.float64] = (force - column * (force[azimuth_u] / mass[azimuth_u, azimuth_u]))[u - system.n_q]
        return free

    following: NDArray[np.float64] | None
    (jacobian, change), fresh = _newton_step(residual, y, q), True
    for _ in range(iterations):
        if np.abs(change).max() < tolerance * max(1.0, np.abs(y[q]).max()):
            y[q] += change
            return
        following = _shortened_step(residual, y, q, change, jacobian, SMALLEST_SHARE if fresh else 1.0)
        if following is None and fresh:
            if np.abs(change).max() < ROUNDING * max(1.0, np.abs(y[q]).max()):
                return
            break
        # nearly linear: the derivatives serve as long as they bring the balance nearer by half
        fresh = following is None or bool(np.linalg.norm(following) > 0.5 * np.linalg.norm(change))
        if following is None or fresh:
            jacobian, following = _newton_step(residual, y, q)
        change = following
    raise SimulationError("the static equilibrium of the structure did not converge under its loads")


def _shortened_step(
    residual: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    y: NDArray[np.float64],
    q: NDArray[np.int64],
    change: NDArray[np.float64],
    jacobian: NDArray[np.float64],
    smallest: float,
) -> NDArray[np.float64] | None:
    """Take a step, or the largest half, quarter, … of it after which the next one is shorter.

    Returns
    -------
    array or None
        The next step, with the same derivatives; None, and y as it was, if a share below ``smallest`` was needed.
    """
    origin, share = y[q].copy(), 1.0
    while share >= smallest:
        y[q] = origin + share * change
        try:
            following = np.asarray(np.linalg.solve(jacobian, -residual(y)), dtype=np.float64)
        except MultibodyError:  # the structure has left its model
            following = None
        if following is not None and np.linalg.norm(following) < (1.0 - 0.25 * share) * np.linalg.norm(change):
            return following
        share *= 0.5
    y[q] = origin
    return None


def _newton_step(
    residual: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    y: NDArray[np.float64],
    q: NDArray[np.int64],
    step: float = 1e-4,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Derivatives of the residual by the coordinates q, and the step that follows from them."""
    here, columns = residual(y), []
    for place in q:
        origin = y[place]
        y[place] = origin + step
        columns.append((residual(y) - here) / step)
        y[place] = origin
    jacobian = np.array(columns).T
    return jacobian, np.asarray(np.linalg.solve(jacobian, -here), dtype=np.float64)


def highest_frequency(system: MultibodySystem, step: float = 1e-5) -> float:
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
