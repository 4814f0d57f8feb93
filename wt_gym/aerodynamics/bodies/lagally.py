"""Force of the flow on a closed body of sources: Lagally's theorem for unsteady flow.

Sources of the fluxes m at r, of vanishing sum, stand for a body of the volume V that moves with the velocity u in the
velocity v of all that is outside it. The force of the potential flow on the body is

    F = −ρ Σ m (v − u) + d/dt P,    P = −ρ Σ m r + ρ V u

(Lagally 1922; W. E. Cummins, The force and moment on a body in a time-varying potential flow, J. Ship Research 1, 1957;
the last term is the inertia of the fluid that the body displaces). In a steady uniform flow the force is zero. A sphere
in an accelerating stream U has Σ m r = −3/2 V U and so F = 3/2 ρ V dU/dt; one that accelerates in fluid at rest has
Σ m r = 3/2 V u and F = −1/2 ρ V du/dt, its added mass.

Unlike an integral of the pressure the sum needs neither velocities along the surface nor the potential, and it can be
taken strip by strip of a slender body: a strip of the area S has Σ m r = −2 S U dz, so that the force per length is
2 ρ S (dU/dt + U·∇U) − ρ S du/dt, twice and once the mass of the displaced air.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = ["convective_force", "impulse"]


def convective_force(
    flux: NDArray[np.float64], flow: NDArray[np.float64], velocity: ArrayLike, density: float
) -> NDArray[np.float64]:
    """−ρ Σ m (v − u) [N].

    Parameters
    ----------
    flux : array (..., n)
        Strengths times areas of panels [m³/s].
    flow : array (..., n, 3)
        Velocity of everything outside the body at the panels [m/s].
    velocity : array (..., 3)
        Of the body [m/s].
    density : float
        [kg/m³].

    Returns
    -------
    array (..., 3)
    """
    out: NDArray[np.float64] = -density * np.einsum("...n,...ni->...i", flux, flow - np.asarray(velocity)[..., None, :])
    return out


def impulse(
    flux: NDArray[np.float64],
    arm: NDArray[np.float64],
    volume: ArrayLike,
    velocity: NDArray[np.float64],
    density: float,
) -> NDArray[np.float64]:
    """P = −ρ Σ m r + ρ V u [kg m/s].

    Parameters
    ----------
    flux : array (..., n)
        [m³/s].
    arm : array (..., n, 3)
        From a point that moves with the body to the panels [m].
    volume : array (...)
        [m³].
    velocity : array (..., 3)
        Of the body [m/s].
    density : float
        [kg/m³].

    Returns
    -------
    array (..., 3)
    """
    inertia = np.asarray(volume)[..., None] * velocity
    out: NDArray[np.float64] = density * (inertia - np.einsum("...n,...ni->...i", flux, arm))
    return out
