"""Refusals at the door: vectors, rotations, bodies, states and constraint residuals that have no meaning."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.multibody.errors import MultibodyError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from wt_gym.multibody.arrays import System
    from wt_gym.structure.flexible_body import FlexibleBody

__all__ = ["CONSISTENT", "UNIT_NORM", "check_body", "check_number", "check_residuals", "check_rotation", "check_state",
           "check_unique", "check_vector"]  # fmt: skip

UNIT_NORM = 1e-6
"""Largest deviation of a quaternion's norm from one in a given state. Integrators keep it below 1e-15."""
CONSISTENT = 1e-5
"""Largest residual of a constraint equation at the start [m, rad, m/s, rad/s]."""
_EXACT = 1e-9
"""Largest deviation of an axis from unit length and of a rotation matrix from orthogonality."""


def check_vector(owner: str, name: str, value: ArrayLike, unit: bool = False) -> None:
    """A finite vector (3,), of unit length on request.

    Raises
    ------
    MultibodyError
    """
    vector = _numbers(owner, name, value)
    if vector.shape != (3,) or not np.all(np.isfinite(vector)):
        raise MultibodyError(f"{owner}: {name} must be three finite numbers, got {value!r}")
    if unit and abs(np.linalg.norm(vector) - 1.0) > _EXACT:
        raise MultibodyError(f"{owner}: {name} {tuple(vector.tolist())} is not a unit vector, its length is "
                             f"{np.linalg.norm(vector):.6g}")  # fmt: skip


def check_rotation(owner: str, name: str, value: ArrayLike | None) -> None:
    """A proper rotation matrix (3, 3), or None.

    Raises
    ------
    MultibodyError
    """
    if value is None:
        return
    matrix = _numbers(owner, name, value)
    if matrix.shape != (3, 3):
        raise MultibodyError(f"{owner}: {name} must be a rotation matrix (3, 3), got shape {matrix.shape}")
    error = np.abs(matrix @ matrix.T - np.eye(3)).max()
    if not error <= _EXACT:
        raise MultibodyError(f"{owner}: {name} is not orthogonal, R Rᵀ differs from one by {error:.3g}")
    if np.linalg.det(matrix) < 0.0:
        raise MultibodyError(f"{owner}: {name} is a reflection (determinant −1); must be a proper rotation")


def check_number(owner: str, name: str, value: Any, positive: bool = False, signed: bool = False) -> None:
    """A finite number that is not negative, or not zero either, or of any sign where it is ``signed``.

    Raises
    ------
    MultibodyError
    """
    number = _numbers(owner, name, value)
    low = not signed and (number < 0.0 if number.shape == () else True)
    if number.shape != () or not np.isfinite(number) or low or (positive and number == 0.0):
        bound = "" if signed else " > 0" if positive else " >= 0"
        raise MultibodyError(f"{owner}: {name} must be a finite number{bound}, got {value!r}")


def _numbers(owner: str, name: str, value: Any) -> NDArray[np.float64]:
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise MultibodyError(f"{owner}: {name} must be numbers, got {value!r}") from None


def check_body(body: FlexibleBody) -> None:
    """A body whose kinetic energy is not negative for any rigid or elastic motion.

    A body may be massless; whether a coordinate moves no mass at all shows only in the assembled system.

    Raises
    ------
    MultibodyError
    """
    inertia, owner = body.inertia, f"body {body.name!r}"
    check_number(owner, "mass", inertia.mass)
    c = inertia.c0
    lever = np.array([[0.0, -c[2], c[1]], [c[2], 0.0, -c[0]], [-c[1], c[0], 0.0]])
    rigid = np.block([[inertia.mass * np.eye(3), -lever], [lever, inertia.j0]])
    for name, matrix in (("inertia", rigid), ("elastic mass matrix", inertia.m0), ("stiffness", body.stiffness),
                         ("damping", body.damping)):  # fmt: skip
        if not np.all(np.isfinite(matrix)):
            raise MultibodyError(f"{owner}: its {name} is not finite")
        size = np.abs(matrix).max(initial=0.0)
        if np.abs(matrix - matrix.T).max(initial=0.0) > 1e-6 * size:
            raise MultibodyError(f"{owner}: its {name} is not symmetric")
        if name in ("stiffness", "damping") or size == 0.0:
            continue
        # unit diagonal, so that units do not matter; what moves no mass has a zero row
        diagonal = np.diag(matrix)
        scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, size))
        lowest = np.linalg.eigvalsh(matrix * np.outer(scale, scale))[0]
        if diagonal.min() < 0.0 or lowest < -1e-7:
            raise MultibodyError(
                f"{owner}: its {name} is negative for a motion; about the body frame's origin its diagonal is "
                f"{np.array2string(diagonal, precision=4)}"
            )


def check_unique(what: str, names: Sequence[str]) -> None:
    """Names that occur once each.

    Raises
    ------
    MultibodyError
    """
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise MultibodyError(f"{what} names occur twice: {', '.join(twice)}; name bodies and joints differently")


def check_state(system: System, y: ArrayLike) -> NDArray[np.float64]:
    """A state as a vector (n_state,) of finite numbers with unit quaternions.

    Parameters
    ----------
    system : MultibodySystem
    y : array (n_state,)

    Returns
    -------
    array (n_state,)
        Contiguous; y itself where it already is.

    Raises
    ------
    MultibodyError
        Naming the body and the norm for a quaternion whose length differs from one by more than `UNIT_NORM`.
    """
    state = np.ascontiguousarray(_numbers("state", "y", y))
    if state.shape != (system.n_state,):
        raise MultibodyError(f"the state has shape {state.shape}; must be ({system.n_state},), see state_names")
    for first, body in system.quaternions:
        norm = float(np.linalg.norm(state[first : first + 4]))
        if not abs(norm - 1.0) <= UNIT_NORM:
            raise MultibodyError(
                f"body {body!r}: its quaternion {state[first : first + 4].tolist()} has norm {norm:.9g}; must be 1 ± "
                f"{UNIT_NORM:g}"
            )
    if not np.isfinite(state).all():
        bad = [name for name, value in zip(system.state_names, state, strict=True) if not np.isfinite(value)]
        raise MultibodyError(f"the state is not finite in {', '.join(bad)}")
    return state


def check_residuals(system: System, residual: NDArray[np.float64], residual_rate: NDArray[np.float64]) -> None:
    """Constraint residuals φ and φ̇ (n_constraints,) below `CONSISTENT`.

    Raises
    ------
    MultibodyError
        Naming the constraint that is violated most.
    """
    for values, what, unit in ((residual, "position", "m or rad"), (residual_rate, "velocity", "m/s or rad/s")):
        worst = [float(np.abs(values[system.multiplier_rows(c)]).max()) for c in range(len(system.constraints))]
        k = int(np.argmax(worst))
        if not worst[k] <= CONSISTENT:
            name = system.constraints[k].name or f"number {k}"
            raise MultibodyError(
                f"the start does not satisfy constraint {name!r}: its {what} residual is {worst[k]:.3g} {unit}, "
                f"allowed: {CONSISTENT:g} (place_free_bodies puts welded free bodies in place)"
            )
