"""The mirror image of a turbine at the vertical plane through its tower and its shaft.

A turbine whose rotor turns counter-clockwise is the mirror image, y to -y, of one that turns clockwise. With
S = diag(1, -1, 1) positions, velocities and forces become S p; angular velocities and moments, which are
pseudovectors, -S m; rotations and inertias S R S. A matrix (6, 6) of stiffness or inertia, which maps three
displacements and three rotations to forces and moments, becomes T M T with T = diag(1, -1, 1, -1, 1, -1).

All of the turbine that is described in the frame of a blade stays as it is: that frame (z to the tip, x to the suction
side, y to the trailing edge) is reflected with the blade and is left-handed where the rotor turns counter-clockwise.
What is described in axes that the direction of rotation does not turn, nacelle and tower, is reflected.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from wt_gym.turbines.beam import BeamStations
from wt_gym.turbines.model import Nacelle, Tower, Turbine

__all__ = ["REFLECTION", "REFLECTION_6", "clockwise_image", "mirrored"]

REFLECTION = np.array([1.0, -1.0, 1.0])
"""Signs of a vector's components after the reflection."""
REFLECTION_6 = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
"""Signs of the components of a vector and a pseudovector: displacement and rotation, or force and moment."""
REFLECTION.flags.writeable = REFLECTION_6.flags.writeable = False

_OPPOSITE = {"clockwise": "counter-clockwise", "counter-clockwise": "clockwise"}


def mirrored(turbine: Turbine) -> Turbine:
    """Return the mirror image of a turbine, whose rotor turns the other way.

    Parameters
    ----------
    turbine : Turbine

    Examples
    --------
    >>> from wt_gym.turbines import load_turbine
    >>> mirrored(load_turbine("nrel_5mw")).rotation
    'counter-clockwise'
    """
    return replace(
        turbine,
        nacelle=_mirrored_nacelle(turbine.nacelle),
        tower=_mirrored_tower(turbine.tower),
        rotation=_OPPOSITE[turbine.rotation],
    )


def clockwise_image(turbine: Turbine) -> Turbine:
    """Return the turbine if its rotor turns clockwise, else its mirror image, whose rotor does."""
    return turbine if turbine.rotation == "clockwise" else mirrored(turbine)


def _mirrored_nacelle(nacelle: Nacelle) -> Nacelle:
    cm = _signed(nacelle.cm, REFLECTION)
    return replace(nacelle, cm=cm, inertia=_signed(nacelle.inertia, np.outer(REFLECTION, REFLECTION)))


def _mirrored_tower(tower: Tower) -> Tower:
    support = tower.support
    if support is not None:
        foundation = None if support.foundation is None else _mirrored_matrix(support.foundation)
        support = replace(support, structure=_mirrored_beam(support.structure), foundation=foundation)
    return replace(tower, structure=_mirrored_beam(tower.structure), support=support)


def _mirrored_beam(beam: BeamStations) -> BeamStations:
    return replace(beam, stiffness=_mirrored_matrix(beam.stiffness), inertia=_mirrored_matrix(beam.inertia))


def _mirrored_matrix(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Reflect matrices (..., 6, 6) of displacements and rotations."""
    return _signed(matrix, np.outer(REFLECTION_6, REFLECTION_6))


def _signed(values: NDArray[np.float64], signs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values with signs; zeros stay as they are, so that what is alike on both sides is bit for bit its own image."""
    return np.where(values == 0.0, values, values * signs)
