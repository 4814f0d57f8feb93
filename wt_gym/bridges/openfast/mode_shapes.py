"""Mode shapes of ElastoDyn: polynomials that vanish with their slope at the clamped end and are one at the free end."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import eigh

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = ["POWERS", "TopBody", "bending_shapes"]

POWERS = np.arange(2, 7)
"""Powers of the relative height in ElastoDyn's shapes."""
_POINTS = 2000


class TopBody:
    """Rigid body on the free end of a beam.

    Parameters
    ----------
    mass : float
        [kg].
    height : float
        Of its center of mass above the end of the beam [m].
    inertia : float
        About the axis of bending through the center of mass [kg m²].
    """

    def __init__(self, mass: float, height: float, inertia: float):
        self.mass, self.height, self.inertia = mass, height, inertia


def bending_shapes(
    station: ArrayLike,
    mass: ArrayLike,
    stiffness: ArrayLike,
    count: int,
    *,
    pull: ArrayLike | None = None,
    top: TopBody | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest modes of a clamped Euler-Bernoulli beam in the space of ElastoDyn's polynomials.

    The modes are those of the Rayleigh-Ritz method with the functions x², …, x⁶, x = s/L: the best that ElastoDyn can
    represent, so that no fit follows. With the axial force N its potential is ½ ∫ (EI w''² + N w'²) ds.

    Parameters
    ----------
    station : array (n,)
        Distance from the clamped end [m], from 0 on; properties are linear between.
    mass : array (n,)
        Per length [kg/m].
    stiffness : array (n,)
        Bending stiffness [N m²].
    count : int
        Modes, at most five.
    pull : array (n,), optional
        Axial force [N], positive in tension.
    top : TopBody, optional

    Returns
    -------
    shapes : ndarray (count, 5)
        Coefficients of x², …, x⁶, with sum one.
    frequencies : ndarray (count,)
        [Hz].
    """
    station = np.asarray(station, dtype=float)
    length = station[-1]
    edges = np.linspace(0.0, 1.0, _POINTS + 1)
    x, width = 0.5 * (edges[1:] + edges[:-1]), np.diff(edges)
    density, rigidity = (
        np.interp(x * length, station, np.asarray(values, dtype=float)) for values in (mass, stiffness)
    )
    value = x[:, None] ** POWERS
    slope = POWERS * x[:, None] ** (POWERS - 1) / length
    curvature = POWERS * (POWERS - 1) * x[:, None] ** (POWERS - 2) / length**2
    inertia = _product(value, density * width * length)
    spring = _product(curvature, rigidity * width * length)
    if pull is not None:
        spring += _product(slope, np.interp(x * length, station, np.asarray(pull, dtype=float)) * width * length)
    if top is not None:
        turn = POWERS / length
        move = 1.0 + top.height * turn
        inertia += top.mass * np.outer(move, move) + top.inertia * np.outer(turn, turn)
    squares, vectors = eigh(spring, inertia)
    shapes = vectors[:, :count].T
    return shapes / shapes.sum(axis=1, keepdims=True), np.sqrt(np.maximum(squares[:count], 0.0)) / (2.0 * np.pi)


def _product(functions: NDArray[np.float64], weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """Integrals of the products of functions (n_points, n) with weights (n_points,)."""
    return functions.T @ (weight[:, None] * functions)
