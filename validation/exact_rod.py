"""Reference solutions for large deflections, independent of the multibody core.

* `exact_rod`: static balance of a geometrically exact rod with any section matrix, by shooting.
* `BarChain`: planar dynamics of an inextensible beam as rigid bars with springs in the hinges (Hencky's chain), which
  converges to the dynamic elastica with the square of the bar length.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.integrate import solve_ivp

from wt_gym.base.errors import WtGymError
from wt_gym.structure.beam import skew

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import ArrayLike

    from wt_gym.structure.beam import BeamSections

__all__ = ["BarChain", "NoRodBalance", "exact_rod"]


AXIAL = np.array([0.0, 0.0, 1.0])


class NoRodBalance(WtGymError, ValueError):
    """The shooting method found no balance of the rod."""


def _turn(frame: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Rotation matrix exp(ṽ) applied on the right of a frame."""
    angle = np.linalg.norm(rotation)
    v = skew(rotation)
    if angle < 1e-12:
        return frame @ (np.eye(3) + v)
    return frame @ (np.eye(3) + np.sin(angle) / angle * v + (1.0 - np.cos(angle)) / angle**2 * v @ v)


def _shortest_frame(tangent: np.ndarray) -> np.ndarray:
    """Rotation that turns z into the tangent without turning about it: the section frame of the undeformed axis."""
    a = skew(np.cross([0.0, 0.0, 1.0], tangent))
    return np.eye(3) + a + a @ a / (1.0 + tangent[2])


def exact_rod(
    sections: BeamSections,
    distributed: Callable[[float], ArrayLike] | None = None,
    tip_force: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0),
    tip_moment: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0),
    n: int = 400,
    load_steps: int = 5,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Deflected axis of a rod clamped at its root under dead loads.

    With the section forces N and moments M in global components and the section frame R,

        r' = R (e_z + γ),  R' = R (κ̃₀ + κ̃),  N' = −p,  M' = −r' × N,  (γ, κ) = C Rᵀ (N, M)

    (Reissner 1981, Z. Angew. Math. Phys. 32; Simo 1985, Comput. Methods Appl. Mech. Eng. 49, 55–70). N follows from the
    loads; the three components of the root moment are found by Newton's method from M(L).

    Parameters
    ----------
    sections : BeamSections
    distributed : callable, optional
        Dead load per arc length p(s) (3,) [N/m].
    tip_force, tip_moment : array (3,)
        [N], [N m]; dead.
    n : int
        Steps of the midpoint Lie-group rule (second order) along the rod.
    load_steps : int
        Load increments.

    Returns
    -------
    (array (n + 1,), array (n + 1, 3), array (n + 1, 3, 3))
        Arc length, deflected position and section frames.

    Raises
    ------
    NoRodBalance
        When Newton's method does not settle.
    """
    s = np.linspace(sections.station[0], sections.station[-1], n + 1)
    h, middle = s[1] - s[0], 0.5 * (s[1:] + s[:-1])
    compliance = sections.compliance_at(middle)
    axis = sections.axis_at(s)
    chord = np.diff(axis, axis=0)
    tangent = chord / np.linalg.norm(chord, axis=1)[:, None]
    stretch = np.linalg.norm(chord, axis=1) / h  # arc length along the table against the chord
    frames = np.array([_shortest_frame(t) for t in tangent])
    load = np.zeros((n, 3)) if distributed is None else np.array([distributed(x) for x in middle])
    outer = np.cumsum(load[::-1], axis=0)[::-1] * h - 0.5 * h * load

    def shoot(root_moment: np.ndarray, factor: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Tip moment error, positions and frames for a root moment."""
        position, turn = np.zeros((n + 1, 3)), np.eye(3)
        position[0] = axis[0]
        moment = np.array(root_moment, dtype=float)
        deformed = np.zeros((n + 1, 3, 3))
        deformed[0] = frames[0]
        for k in range(n):
            force = factor * (outer[k] + np.asarray(tip_force))
            # the section turns by the rotation accumulated so far and half of the change in this step
            change, half = np.zeros(3), moment.copy()
            for _ in range(3):
                section = _turn(turn, 0.5 * change) @ frames[k]
                strain = compliance[k] @ np.concatenate([section.T @ force, section.T @ half])
                step = section @ (strain[:3] + AXIAL) * h * stretch[k]
                half = moment - 0.5 * np.cross(step, force)
                change = frames[k] @ strain[3:] * h * stretch[k]
            turn = _turn(turn, change)
            position[k + 1] = position[k] + step
            moment = moment - np.cross(step, force)
            deformed[k + 1] = turn @ frames[min(k + 1, n - 1)]
        return moment - factor * np.asarray(tip_moment), position, deformed

    arm = axis - axis[0]
    root = np.zeros(3)
    previous = np.cross(arm[-1], tip_force) + tip_moment + h * np.cross(0.5 * (arm[1:] + arm[:-1]), load).sum(axis=0)
    scale = np.linalg.norm(previous) + 1e-30
    for step in range(1, load_steps + 1):
        factor = step / load_steps
        root = root + previous / load_steps if step == 1 else root * factor / ((step - 1) / load_steps)
        for _ in range(30):
            error, position, deformed = shoot(root, factor)
            if np.abs(error).max() < 1e-9 * scale:
                break
            jacobian = np.zeros((3, 3))
            for i in range(3):
                shifted = root.copy()
                shifted[i] += 1e-6 * scale
                jacobian[:, i] = (shoot(shifted, factor)[0] - error) / (1e-6 * scale)
            root = root - np.linalg.solve(jacobian, error)
        else:
            raise NoRodBalance(f"no balance of the rod at {factor:.2f} of the load; tip moment error {error}")
    return s, position, deformed


def _integrals(function: Callable[[np.ndarray], np.ndarray], bounds: np.ndarray, n: int = 64) -> np.ndarray:
    """Integrals of a function between successive bounds, midpoint rule with n points each."""
    inside = (np.arange(n) + 0.5) / n
    lower, width = bounds[:-1, None], np.diff(bounds)[:, None]
    return (function(lower + width * inside) * width / n).sum(axis=1)


class BarChain:
    """Planar inextensible cantilever as a chain of n rigid massless bars with point masses and rotational springs.

    Bar k has the angle θ_k against the undeformed axis. The hinge before it carries the bending flexibility ∫ ds/EI
    between the middles of its two bars (the root hinge that of the first half bar), the joint behind it the mass
    between the same points, so that properties which change within a bar are kept to second order.

    Parameters
    ----------
    length : float
        [m].
    bending_stiffness, mass : callable
        EI(s) [N m²] and mass per length [kg/m] for arrays of arc lengths.
    n : int
        Number of bars.
    """

    def __init__(
        self,
        length: float,
        bending_stiffness: Callable[[np.ndarray], np.ndarray],
        mass: Callable[[np.ndarray], np.ndarray],
        n: int = 48,
    ):
        self.n, self.bar = n, length / n
        self.outer = (np.arange(n) + 1.0) * self.bar
        middle = self.outer - 0.5 * self.bar
        self.spring = 1.0 / _integrals(lambda s: 1.0 / bending_stiffness(s), np.concatenate([[0.0], middle]))
        self.bounds = np.concatenate([middle, [length]])
        self.mass = _integrals(mass, self.bounds)  # at the outer end of each bar
        beyond = np.cumsum(self.mass[::-1])[::-1]
        self._coupling = beyond[np.maximum.outer(np.arange(n), np.arange(n))] * self.bar**2

    def lump(self, load: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Forces (n,) at the outer ends of the bars from a transverse load per length, a callable of arc lengths."""
        return _integrals(load, self.bounds)

    def elastic_moment(self, theta: np.ndarray) -> np.ndarray:
        """Moments (n,) of the springs on the bars."""
        bend = self.spring * np.diff(theta, prepend=0.0)
        return -bend + np.append(bend[1:], 0.0)

    def load_moment(self, theta: np.ndarray, force: np.ndarray) -> np.ndarray:
        """Moments (n,) of dead transverse forces (n,) at the outer ends of the bars."""
        return np.cumsum(force[::-1])[::-1] * self.bar * np.cos(theta)

    def tip(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Transverse and axial position of the tip for angles (..., n)."""
        return self.bar * np.sin(theta).sum(axis=-1), self.bar * np.cos(theta).sum(axis=-1)

    def static(self, force: np.ndarray, steps: int = 10) -> np.ndarray:
        """Angles in balance under dead transverse forces (n,), by Newton's method in load steps."""
        theta = np.zeros(self.n)
        stiffness = np.diag(self.spring + np.append(self.spring[1:], 0.0))
        stiffness -= np.diag(self.spring[1:], 1) + np.diag(self.spring[1:], -1)
        lever = np.cumsum(force[::-1])[::-1] * self.bar
        for step in range(1, steps + 1):
            for _ in range(30):
                f = step / steps
                residual = self.elastic_moment(theta) + f * lever * np.cos(theta)
                change = np.linalg.solve(stiffness + np.diag(f * lever * np.sin(theta)), residual)
                theta = theta + change
                if np.abs(change).max() < 1e-12:
                    break
        return theta

    def simulate(self, theta: np.ndarray, times: np.ndarray, force: np.ndarray | None = None) -> np.ndarray:
        """Angles (n_times, n) at the given times for a start at rest, with dead transverse forces (n,)."""
        n = self.n

        def rate(_: float, state: np.ndarray) -> np.ndarray:
            angle, speed = state[:n], state[n:]
            difference = angle[:, None] - angle[None, :]
            matrix = self._coupling * np.cos(difference)
            moment = self.elastic_moment(angle) - (self._coupling * np.sin(difference)) @ speed**2
            if force is not None:
                moment = moment + self.load_moment(angle, force)
            return np.concatenate([speed, np.linalg.solve(matrix, moment)])

        start = np.concatenate([theta, np.zeros(n)])
        span = (times[0], times[-1])
        solution = solve_ivp(rate, span, start, method="DOP853", t_eval=times, rtol=1e-6, atol=1e-8)
        if not solution.success:
            raise NoRodBalance(f"the bar chain could not be integrated: {solution.message}")
        return solution.y[:n].T
