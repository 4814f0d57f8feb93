"""Tools for cases: static balance and small motions of multibody trees, cut beams, data tables, blade elements."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wt_gym.base.errors import WtGymError
from wt_gym.multibody.tree import tree_kernels
from wt_gym.structure.substructure import SubBody, sub_body_at
from wt_gym.turbines.blade_element import BladeElementRotor, BladeElements

if TYPE_CHECKING:
    from wt_gym.multibody.arrays import Inputs, Work
    from wt_gym.multibody.system import MultibodySystem


class NoBalance(WtGymError, ValueError):
    """No static balance was found for a system of bodies under the given loads."""


def rate_jacobian(
    system: MultibodySystem, y: NDArray[np.float64], step: float | NDArray[np.float64] = 1e-6
) -> NDArray[np.float64]:
    """∂(u̇)/∂(q, u), shape (n_u, 2 n_u), at a state (n_state,) by central differences of size ``step``, (n_u,) or one.

    Without quaternions, so that q and u have the same meaning one by one.
    """
    n = system.n_u
    if system.n_q != n:
        raise NoBalance(f"{system.n_q} coordinates for {n} velocities: systems with quaternions have no such Jacobian")
    inputs, work = system.new_inputs(), system.new_work()
    step = np.broadcast_to(step, (n,))
    out = np.zeros((n, 2 * n))
    for k in range(2 * n):
        up, down = np.array(y, dtype=float), np.array(y, dtype=float)
        up[k] += step[k % n]
        down[k] -= step[k % n]
        difference = system.rates(up, inputs, work)[n : 2 * n] - system.rates(down, inputs, work)[n : 2 * n]
        out[:, k] = difference / (2.0 * step[k % n])
    return out


def eigenfrequencies(jacobian: NDArray[np.float64]) -> NDArray[np.float64]:
    """Circular frequencies [rad/s], ascending, of q̈ = J (q, q̇) with the Jacobian J (n, 2 n)."""
    n = len(jacobian)
    a = np.block([[np.zeros((n, n)), np.eye(n)], [jacobian]])
    return np.sort(np.abs(np.linalg.eigvals(a).imag))[::2]


def frequencies(
    system: MultibodySystem, y: NDArray[np.float64], step: float | NDArray[np.float64] = 1e-6
) -> NDArray[np.float64]:
    """Circular natural frequencies [rad/s], ascending, of small motions about the steady state y."""
    return eigenfrequencies(rate_jacobian(system, y, step))


def mass_matrix(system: MultibodySystem, y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mass matrix (n_u, n_u) of the tree in the state y."""
    work = system.new_work()
    y = np.ascontiguousarray(y, dtype=float)
    tree_kernels.kinematics(y, system.tree, work)
    tree_kernels.assemble(y, work.loads, system.tree, work)
    lower = np.tril(work.mass)
    return lower + np.tril(work.mass, -1).T


def static_balance(
    system: MultibodySystem,
    y: NDArray[np.float64],
    set_loads: Callable[[NDArray[np.float64], Inputs, Work], None] | None = None,
    *,
    tolerance: float = 1e-10,
    step: float = 1e-6,
) -> NDArray[np.float64]:
    """State (n_state,) of rest whose accelerations vanish, by Newton's method from the state y; its rates stay.

    ``set_loads(y, inputs, work)`` writes the loads for the state y, whose kinematics are up to date in ``work``. It
    ends when the largest change of a coordinate is below the tolerance times the largest coordinate, or raises
    `NoBalance`; ``step`` is the difference for the Jacobian. Without quaternions.
    """
    n = system.n_u
    inputs, work = system.new_inputs(), system.new_work()
    y = np.array(y, dtype=float)

    def forces(state: NDArray[np.float64]) -> NDArray[np.float64]:
        """Generalized forces: applied, elastic and of gravity (inertia is absent at rest)."""
        tree_kernels.kinematics(state, system.tree, work)
        inputs.body_loads[:] = 0.0
        if set_loads is not None:
            set_loads(state, inputs, work)
        tree_kernels.assemble(state, inputs.body_loads[0], system.tree, work)
        spring = system.tree.dof_stiffness * (inputs.reference[0] - state[:n])
        return work.force + inputs.dof_force[0] + spring

    jacobian = np.zeros((n, n))
    for _ in range(40):
        residual = forces(y)
        for k in range(n):
            shifted = y.copy()
            shifted[k] += step
            jacobian[:, k] = (forces(shifted) - residual) / step
        change = np.linalg.solve(jacobian, -residual)
        y[:n] += change
        if not np.all(np.isfinite(y)):
            break
        if np.abs(change).max() < tolerance * max(1.0, np.abs(y[:n]).max()):
            return y
    raise NoBalance(f"Newton's method did not settle in 40 iterations (last change {np.abs(change).max():.2e})")


def body_pose(
    system: MultibodySystem, y: NDArray[np.float64], body: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Global position (3,) and orientation (3, 3) of a body's frame in the state y."""
    work = system.new_work()
    tree_kernels.kinematics(np.ascontiguousarray(y, dtype=float), system.tree, work)
    return work.r[body].copy(), work.rot[body].copy()


def upward_crossings(x: ArrayLike, step: float) -> NDArray[np.float64]:
    """Times at which a series with samples every ``step`` rises through zero, between samples along a line."""
    x = np.asarray(x)
    up = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))
    crossing: NDArray[np.float64] = (up + x[up] / (x[up] - x[up + 1])) * step
    return crossing


def crossing_frequency(x: ArrayLike, step: float) -> float:
    """Circular frequency [rad/s] of a series about zero with samples every ``step``, from its upward crossings."""
    crossing = upward_crossings(x, step)
    return float(2.0 * np.pi * (len(crossing) - 1) / (crossing[-1] - crossing[0]))


class ChainPoints:
    """Points on the axis of a beam cut into bodies: where they are, and dead forces on them.

    ``bodies``: body index of each piece; ``stations`` (n,): arc lengths of the points on the whole beam [m].
    """

    def __init__(
        self, system: MultibodySystem, sub_bodies: Sequence[SubBody], bodies: Sequence[int], stations: ArrayLike
    ):
        self.system = system
        self.stations = np.asarray(stations, dtype=float)
        owner = np.array([sub_body_at(sub_bodies, s) for s in self.stations])
        self._groups = []
        for k, body in enumerate(bodies):
            rows = np.flatnonzero(owner == k)
            if len(rows):
                markers = [sub_bodies[k].marker(self.stations[row]) for row in rows]
                fields = [np.array([getattr(m, key) for m in markers]) for key in ("position", "linear", "second")]
                first = system.index(body, "elastic_q")
                self._groups.append((body, rows, slice(first, first + sub_bodies[k].body.n_elastic), fields))

    def positions(self, y: NDArray[np.float64]) -> NDArray[np.float64]:
        """Global positions (n, 3) in the state y."""
        y = np.ascontiguousarray(y, dtype=float)
        work = self.system.new_work()
        tree_kernels.kinematics(y, self.system.tree, work)
        out = np.zeros((len(self.stations), 3))
        for body, rows, elastic, (position, linear, second) in self._groups:
            q = y[elastic]
            local = position + (linear + 0.5 * second @ q) @ q
            out[rows] = work.r[body] + local @ work.rot[body].T
        return out

    def add_forces(self, y: NDArray[np.float64], inputs: Inputs, work: Work, force: NDArray[np.float64]) -> None:
        """Add dead forces (n, 3), global components [N], by virtual work; ``work`` holds the kinematics of y."""
        for body, rows, elastic, (position, linear, second) in self._groups:
            q = y[elastic]
            local = position + (linear + 0.5 * second @ q) @ q
            own = force[rows] @ work.rot[body]
            inputs.body_loads[:, body, :3] += own.sum(axis=0)
            inputs.body_loads[:, body, 3:6] += np.cross(local, own).sum(axis=0)
            inputs.body_loads[:, body, 6 : 6 + len(q)] += np.einsum("pi,pik->k", own, linear + second @ q)


def blade_element(
    rotor: BladeElementRotor, wind: float, rotor_speed: float, pitch: float = 0.0, n_span: int = 60
) -> SimpleNamespace:
    """One point [m/s], [rad/s], [rad] of `BladeElements`: ``power`` [W], ``thrust`` [N], ``cp`` and ``ct``.

    Of its sections (n_span,) it has ``axial`` and ``tangential`` induction and ``normal`` forces per length [N/m].
    """
    solved = {name: values[0] for name, values in BladeElements(rotor, n_span).solve(wind, rotor_speed, pitch).items()}
    reference = 0.5 * rotor.air_density * np.pi * rotor.radius**2 * wind**2
    return SimpleNamespace(**solved, cp=solved["power"] / (reference * wind), ct=solved["thrust"] / reference)
