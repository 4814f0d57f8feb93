"""What connects bodies: joints of the tree, and constraint equations between its bodies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.multibody.checks import check_number, check_rotation, check_vector
from wt_gym.multibody.constraints import constraint_kernels
from wt_gym.multibody.errors import MultibodyError
from wt_gym.multibody.tree import tree_kernels

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = ["Constraint", "Joint"]

_JOINTS = {  # code in the kernels, positions, velocities
    "fixed": (tree_kernels.FIXED, 0, 0),
    "revolute": (tree_kernels.REVOLUTE, 1, 1),
    "prismatic": (tree_kernels.PRISMATIC, 1, 1),
    "spherical": (tree_kernels.SPHERICAL, 4, 3),
    "free": (tree_kernels.FREE, 7, 6),
    "servo": (tree_kernels.SERVO, 0, 0),
}
_CONSTRAINTS = {  # code in the kernels, equations
    "weld": (constraint_kernels.WELD, 6),
    "hinge": (constraint_kernels.HINGE, 5),
    "ball": (constraint_kernels.BALL, 3),
}


@dataclass(frozen=True)
class Joint:
    """Connection of a body to a marker of its parent.

    Attributes
    ----------
    kind : str
        "fixed", "revolute", "prismatic", "spherical", "free", or "servo": a rotation driven by a second-order servo
        that follows a command, θ̈ = ω² (θ_c − θ) − 2 ζ ω θ̇.
    axis : array (3,)
        Unit axis of a revolute, servo or prismatic joint, in the joint frame.
    rotation : array (3, 3)
        Orientation of the joint frame relative to the marker.
    offset : array (3,)
        Origin of the joint frame relative to the marker, marker axes [m].
    stiffness, damping : float
        Spring [N m/rad or N/m] and damper about the reference given as an input (revolute and prismatic only).
    servo_frequency, servo_damping : float
        ω [rad/s] and ζ of a servo.
    name : str
        Name of the coordinate(s).
    rotor_inertia : float
        Axial moment of inertia [kg m²] of a rotor in bearings of the parent, parallel to the axis of a revolute joint
        and geared to it. Its mass and its transverse inertia are part of the parent.
    rotor_ratio : float
        Speed of the rotor against the parent over the rate of the joint; negative: it turns against the joint.

    Raises
    ------
    MultibodyError
        For an unknown kind, vectors that are not three finite numbers, an axis that is not a unit vector, a matrix
        that is not a proper rotation, negative values, and springs, dampers, servos or rotors that the kind does not
        support.
    """

    kind: str = "fixed"
    axis: ArrayLike = (0.0, 0.0, 1.0)
    rotation: ArrayLike | None = None
    offset: ArrayLike = (0.0, 0.0, 0.0)
    stiffness: float = 0.0
    damping: float = 0.0
    servo_frequency: float = 0.0
    servo_damping: float = 1.0
    name: str = ""
    rotor_inertia: float = 0.0
    rotor_ratio: float = 1.0

    def __post_init__(self) -> None:
        if self.kind not in _JOINTS:
            raise MultibodyError(f"joint kind must be one of {', '.join(_JOINTS)}, got {self.kind!r}")
        owner = f"{self.kind} joint {self.name!r}"
        check_vector(owner, "axis", self.axis, unit=self.kind in ("revolute", "prismatic", "servo"))
        check_vector(owner, "offset", self.offset)
        check_rotation(owner, "rotation", self.rotation)
        allowed = {"servo_frequency": ("servo",), "rotor_inertia": ("revolute",)}
        for name in ("stiffness", "damping", "servo_frequency", "rotor_inertia"):
            kinds = allowed.get(name, ("revolute", "prismatic"))
            check_number(owner, name, getattr(self, name), positive=self.kind == "servo" and name == "servo_frequency")
            if getattr(self, name) != 0.0 and self.kind not in kinds:
                raise MultibodyError(
                    f"{owner}: {name} must be 0, got {getattr(self, name)}: joint type {self.kind!r} does not support "
                    f"it; allowed: {' and '.join(kinds)}"
                )
        check_number(owner, "servo_damping", self.servo_damping)
        check_number(owner, "rotor_ratio", self.rotor_ratio, signed=True)

    @property
    def rotor_tensors(self) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """Inertia tensors (3, 3) of parent and body, and inertia of the coordinate, that stand for the geared rotor.

        With n the ratio, a the axis, ω the angular velocity of the parent and u the rate of the joint, the rotor has
        the kinetic energy (Kane & Levinson, Dynamics: Theory and Applications, 1985, section 3.9, gyrostats)

            T = ½ J (a·ω + n u)² = ½ (1 − n) J (a·ω)² + ½ n J (a·ω + u)² + ½ n (n − 1) J u².

        The first term is an axial inertia of the parent, the second one of the body, the third one of the coordinate
        alone; the equations of motion and all loads in joints follow from their sum. Single terms may be negative.
        """
        axis = np.asarray(self.axis, dtype=float)
        turned = axis if self.rotation is None else np.asarray(self.rotation, dtype=float) @ axis
        inertia, n = self.rotor_inertia, self.rotor_ratio
        body = n * inertia * np.outer(axis, axis)
        return (1.0 - n) * inertia * np.outer(turned, turned), body, n * (n - 1.0) * inertia

    @property
    def code(self) -> int:
        """Number of the kind in the compiled kernels."""
        return _JOINTS[self.kind][0]

    @property
    def n_position(self) -> int:
        """Number of position coordinates; a quaternion has four."""
        return _JOINTS[self.kind][1]

    @property
    def n_velocity(self) -> int:
        """Number of velocities."""
        return _JOINTS[self.kind][2]


@dataclass(frozen=True)
class Constraint:
    """Equations that tie a frame of one body to a frame of another.

    Attributes
    ----------
    kind : str
        "weld" (six equations), "hinge" (five, free rotation about ``axis``) or "ball" (three).
    rotation, second_rotation : array (3, 3)
        Orientation of the frames relative to their markers.
    offset, second_offset : array (3,)
        Origins of the frames relative to their markers [m].
    axis : array (3,)
        Hinge axis, or axis of the servo, in the first frame.
    servo_frequency, servo_damping : float
        A positive frequency [rad/s] turns the first frame by a servo about ``axis`` (a commanded pitch bearing).
    name : str
    """

    kind: str = "weld"
    rotation: ArrayLike | None = None
    offset: ArrayLike = (0.0, 0.0, 0.0)
    second_rotation: ArrayLike | None = None
    second_offset: ArrayLike = (0.0, 0.0, 0.0)
    axis: ArrayLike = (0.0, 0.0, 1.0)
    servo_frequency: float = 0.0
    servo_damping: float = 1.0
    name: str = ""

    def __post_init__(self) -> None:
        if self.kind not in _CONSTRAINTS:
            raise MultibodyError(f"constraint kind must be one of {', '.join(_CONSTRAINTS)}, got {self.kind!r}")
        owner = f"{self.kind} constraint {self.name!r}"
        check_vector(owner, "axis", self.axis, unit=True)
        for frame in ("", "second_"):
            check_vector(owner, f"{frame}offset", getattr(self, f"{frame}offset"))
            check_rotation(owner, f"{frame}rotation", getattr(self, f"{frame}rotation"))
        for name in ("servo_frequency", "servo_damping"):
            check_number(owner, name, getattr(self, name))

    @property
    def code(self) -> int:
        """Number of the kind in the compiled kernels."""
        return _CONSTRAINTS[self.kind][0]

    @property
    def n_rows(self) -> int:
        """Number of equations."""
        return _CONSTRAINTS[self.kind][1]
