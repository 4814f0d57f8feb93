"""The tower in the flow: potential flow past a slender cylinder, felt by the blades in front of it."""

import numpy as np

from wt_gym.aerodynamics.errors import AerodynamicsError

__all__ = ["tower_perturbation"]


def tower_perturbation(points, wind, base, top, stations, diameters):
    """Velocity that a tower adds to the wind.

    At each height the tower is an infinite cylinder of the local diameter: with a the radius, r the vector from the
    axis and V the wind across the axis, v = a^2/r^2 (V - 2 (V . r) r / r^2) (doublet in a uniform stream, e.g. Katz &
    Plotkin, Low-Speed Aerodynamics, section 3.11). It fades over one radius beyond each end. Inside the tower, which
    no blade reaches before the simulation ends, the value of the surface holds.

    Parameters
    ----------
    points : ndarray, shape (..., 3)
        Where the wind is felt [m].
    wind : ndarray, shape (..., 3)
        Undisturbed wind there [m/s].
    base, top : array_like, shape (3,)
        Ends of the tower axis [m].
    stations : array_like, shape (n,)
        Increasing distances from the base at which diameters are given [m].
    diameters : array_like, shape (n,)
        Outer diameters [m].

    Returns
    -------
    velocity : ndarray, shape (..., 3)
        To be added to the wind [m/s].

    Raises
    ------
    AerodynamicsError
        If base and top coincide or the diameters are not positive at increasing stations.
    """
    base, stations, diameters = (np.asarray(x, dtype=np.float64) for x in (base, stations, diameters))
    axis = np.asarray(top, dtype=np.float64) - base
    height = float(np.linalg.norm(axis))
    if not height > 0.0:
        raise AerodynamicsError(f"the tower has no height: base {base}, top {top}")
    if stations.shape != diameters.shape or np.any(np.diff(stations) <= 0.0) or not np.all(diameters > 0.0):
        raise AerodynamicsError(f"tower diameters {diameters} must be positive, at increasing stations {stations}")
    axis = axis / height
    arm = points - base
    along = arm @ axis
    radius = 0.5 * np.interp(along, stations, diameters)
    across = arm - along[..., None] * axis
    distance2 = np.einsum("...i,...i->...", across, across)
    # Distance from the nearer end, positive inside: the disturbance is halved at the very end.
    inside = np.minimum(along, height - along)
    fade = 0.5 * (1.0 + np.tanh(2.0 * inside / radius))
    stream = wind - (wind @ axis)[..., None] * axis
    radial = np.einsum("...i,...i->...", stream, across) / np.maximum(distance2, 1e-12)
    strength = fade * radius**2 / np.maximum(distance2, radius**2)
    return strength[..., None] * (stream - 2.0 * radial[..., None] * across)
