"""The exception of this room."""

from wt_gym.base.errors import WtGymError

__all__ = ["AerodynamicsError"]


class AerodynamicsError(WtGymError, ValueError):
    """A lattice, an option or an inflow with which the vortex lattice cannot work."""
