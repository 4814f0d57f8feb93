"""The same bodies and joints in local observer frames: a tree or a constrained system, described once.

Every joint and constraint of a :class:`MultibodySystem` becomes rows of the constraint equations (5) between bodies
that move freely otherwise; every flexible body keeps its elastic coordinates and their shapes. What the local observer
frame does not know is left out: the second-order displacements, and with them the geometric stiffness.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from wt_gym.multibody.observer_frame.frame import ObserverFrameError, ObserverFrameSystem, Place, Substructure
from wt_gym.multibody.tree import tree_kernels
from wt_gym.structure.beam import SecondOrderField, skew
from wt_gym.structure.flexible_body import particle_fields

__all__ = ["mass_points", "observer_frame_from_system", "substructure_from_body"]

FRAME = "frame"
"""Name of the place where the frame of a body is: what its joint holds."""


def observer_frame_from_system(system, beams=None, y=None, rigid_modes="deformed"):
    """A system in local observer frames from a built multibody system.

    Parameters
    ----------
    system : MultibodySystem
        Built; with joints that are fixed, revolute (without spring and damper), spherical or free, and with constraints
        that are welds, hinges or balls.
    beams : dict of str to (Beam, array (n_dof, n)), optional
        Beam and basis from which each flexible body was made, by the name of the body.
    y : array (n_state,), optional
        State of the multibody system in which the motion begins, default its initial state.
    rigid_modes : str
        Of :class:`ObserverFrameSystem`.

    Returns
    -------
    ObserverFrameSystem
        With one substructure for each body, under the same names, and with the places of their markers and of their
        joints. Loads are still to be added.

    Raises
    ------
    ObserverFrameError
        For joints and constraints that have no such form, and for beams that do not belong to their bodies.

    Examples
    --------
    >>> from wt_gym.multibody.system import Joint, MultibodySystem
    >>> from wt_gym.structure.flexible_body import FlexibleBody
    >>> tree = MultibodySystem()
    >>> bob = FlexibleBody.rigid("bob", 1.0, (0.0, 0.0, -1.0), 0.01 * np.eye(3))
    >>> tree.add(bob, Joint("revolute", axis=(0.0, 1.0, 0.0)))
    0
    >>> observed = observer_frame_from_system(tree.build())
    >>> [body.name for body in observed.bodies]
    ['bob']
    """
    return _Translation(system, beams or {}, system.initial_state() if y is None else y, rigid_modes).observed


def mass_points(inertia):
    """Masses (6,) and positions (6, 3) of points with the mass, mass centre and inertia tensor of a rigid body.

    Two points on each principal axis, at ± √(3 e/m) from the mass centre for the second moment e = ∫ x² dm.
    """
    centre = inertia.c0 / inertia.mass
    second = 0.5 * np.trace(inertia.j0) * np.eye(3) - inertia.j0 - inertia.mass * np.outer(centre, centre)
    value, axis = np.linalg.eigh(second)
    if value[0] < -1e-9 * max(np.abs(value).max(), 1e-300):
        raise ObserverFrameError(f"no mass distribution has the inertia tensor {inertia.j0.tolist()}")
    reach = np.sqrt(3.0 * np.maximum(value, 0.0) / inertia.mass) * axis
    return np.full(6, inertia.mass / 6.0), centre + np.concatenate([reach.T, -reach.T])


def substructure_from_body(body, beam=None, basis=None):
    """A substructure with the elastic coordinates, markers and mass of a body.

    Parameters
    ----------
    body : FlexibleBody
    beam : Beam, optional
    basis : array (n_dof, n), optional
        What :meth:`FlexibleBody.from_beam` was given; not needed for a rigid body.

    Raises
    ------
    ObserverFrameError
        When a flexible body comes without beam and basis, or with those of another body.
    """
    if body.n_elastic == 0:
        mass, position = mass_points(body.inertia)
        points = mass, position, np.zeros((6, 3, 0))
        ends = position[:2]
    else:
        if beam is None or basis is None:
            raise ObserverFrameError(f"body {body.name!r} is flexible: its beam and basis are needed")
        fields = particle_fields(beam, basis)
        points = beam.particle_mass, fields.position, fields.linear
        generalised = np.einsum("p,pij,pik->jk", points[0], points[2], points[2], optimize=True)
        expected = body.inertia.m0
        if generalised.shape != expected.shape or np.abs(generalised - expected).max() > 1e-9 * np.abs(expected).max():
            raise ObserverFrameError(f"body {body.name!r} was not made from the beam and basis given for it")
        ends = beam.node_position[[0, -1]]
    places = {key: _place(marker, np.zeros(3)) for key, marker in body.markers.items()}
    none = np.zeros((3, body.n_elastic, body.n_elastic))
    places[FRAME] = Place(np.zeros(3), np.zeros((6, body.n_elastic)), lambda: none)
    return Substructure.from_points(body.name, points, body.stiffness, body.damping, places, ends)


def _place(marker, offset):
    """The point at an offset (3,) from a marker, carried by its section."""
    linear = marker.linear - skew(offset) @ marker.rotation

    def second_order():
        return marker.second + SecondOrderField.of_offset(marker.rotation[None], offset[None])[0]

    return Place(marker.position + offset, np.vstack([linear, marker.rotation]), second_order)


class _Translation:
    """One use of :func:`observer_frame_from_system`."""

    def __init__(self, system, beams, y, rigid_modes):
        unknown = sorted(set(beams) - {body.name for body in system.bodies})
        if unknown:
            raise ObserverFrameError(
                f"beams are given for {unknown}, but the bodies are {[b.name for b in system.bodies]}"
            )
        self.system, self.y = system, np.ascontiguousarray(y, dtype=float)
        self.work = system.new_work()
        tree_kernels.kinematics(self.y, system.tree, self.work)
        self.observed = ObserverFrameSystem(system.gravity, rigid_modes)
        self.bodies = [substructure_from_body(body, *beams.get(body.name, ())) for body in system.bodies]
        self.frames = []
        for b in range(len(system.bodies)):
            self._place_by_joint(b)
        for c in range(len(system.constraints)):
            self._place_by_constraint(c)
        for b, body in enumerate(self.bodies):
            self._add(b, body)
        for b in range(len(system.bodies)):
            self._hold_by_joint(b)
        for c in range(len(system.constraints)):
            self._hold_by_constraint(c)

    def _elastic(self, b):
        """Elastic coordinates and rates (n_f,) of a body."""
        n = self.bodies[b].n_elastic
        q, u = self.system.index(b, "elastic_q"), self.system.n_q + self.system.index(b, "elastic_u")
        return self.y[q : q + n], self.y[u : u + n]

    def _carried(self, b, marker, offset, rotation):
        """Position and orientation of a frame on a marker of a body (on the ground for −1), and its place."""
        offset = np.asarray(offset, dtype=float)
        rotation = np.eye(3) if rotation is None else np.asarray(rotation, dtype=float)
        if b < 0:
            return offset, rotation, None
        place = _place(marker, offset)
        field = place.field @ self._elastic(b)[0]
        position, frame = self.frames[b]
        turn = Rotation.from_rotvec(field[3:]).as_matrix()
        return position + frame @ (place.position + field[:3]), frame @ turn @ rotation, place

    def _place_by_joint(self, b):
        """Frames are placed by the linear displacements of this formulation, so that its constraints hold exactly."""
        joint, kind = self.system.joints[b], self.system.joints[b].kind
        if kind in ("prismatic", "servo"):
            raise ObserverFrameError(f"joint {joint.name!r}: a {kind} joint has no form in local observer frames")
        if joint.stiffness or joint.damping:
            raise ObserverFrameError(f"joint {joint.name!r}: springs and dampers have no form in local observer frames")
        p = self.system.parents[b]
        position, rotation, place = self._carried(p, self.system._markers[b], joint.offset, joint.rotation)
        if place is not None:
            self.bodies[p].places[_joint_place(self.bodies[b].name)] = place
        first = self.system.index(b, "joint_q")
        if kind == "revolute":
            rotation = rotation @ Rotation.from_rotvec(self.y[first] * np.asarray(joint.axis)).as_matrix()
        elif kind == "spherical":
            rotation = rotation @ _matrix(self.y[first : first + 4])
        elif kind == "free":
            position = position + rotation @ self.y[first : first + 3]
            rotation = rotation @ _matrix(self.y[first + 3 : first + 7])
        self.frames.append((position, rotation))

    def _place_by_constraint(self, c):
        """A free body is put where its constraint holds it; names the places on both sides."""
        constraint, (first, second, marker, second_marker) = self.system.constraints[c], self.system._tied[c]
        if constraint.servo_frequency > 0.0:
            raise ObserverFrameError(f"constraint {constraint.name!r}: a servo has no form in local observer frames")
        one = self._carried(first, marker, constraint.offset, constraint.rotation)
        two = self._carried(second, second_marker, constraint.second_offset, constraint.second_rotation)
        for b, place in ((first, one[2]), (second, two[2])):
            if place is not None:
                self.bodies[b].places[_constraint_place(c)] = place
        if second >= 0 and self.system.joints[second].kind == "free":
            position, rotation = self.frames[second]
            turn = one[1] @ two[1].T if constraint.kind == "weld" else np.eye(3)
            self.frames[second] = one[0] + turn @ (position - two[0]), turn @ rotation

    def _add(self, b, body):
        position, rotation = self.frames[b]
        q, rate = self._elastic(b)
        none, own = np.zeros(6), self.work.rot[b]
        self.observed.add(
            body,
            position,
            rotation,
            own @ self.work.v[b],
            own @ self.work.omega[b],
            np.concatenate([q, none]),
            np.concatenate([rate, none]),
        )

    def _hold_by_joint(self, b):
        joint, name, p = self.system.joints[b], self.bodies[b].name, self.system.parents[b]
        other = None if p < 0 else self.bodies[p].name
        axis = self.frames[b][1] @ np.asarray(joint.axis)
        self._hold({"fixed": "weld", "revolute": "hinge", "spherical": "ball", "free": ""}[joint.kind],
                   (name, FRAME), (other, _joint_place(name)), axis)  # fmt: skip

    def _hold_by_constraint(self, c):
        constraint, (first, second, marker, _) = self.system.constraints[c], self.system._tied[c]
        here = _constraint_place(c)
        axis = self._carried(first, marker, constraint.offset, constraint.rotation)[1] @ np.asarray(constraint.axis)
        ends = [(None if b < 0 else self.bodies[b].name, here) for b in (second, first)]
        self._hold(constraint.kind, *(ends if second >= 0 else ends[::-1]), axis)

    def _hold(self, kind, mine, yours, axis):
        """Weld, hinge or ball between two places (body, place); the second body may be the ground, None."""
        ground = yours[0] is None
        if kind == "weld":
            self.observed.clamp(*mine) if ground else self.observed.weld(*yours, *mine)
        elif kind == "ball":
            self.observed.support(*mine) if ground else self.observed.join(*yours, *mine)
        elif kind == "hinge":
            self.observed.hinge(*mine, axis, *(() if ground else yours))


def _joint_place(name):
    return f"joint of {name}"


def _constraint_place(c):
    return f"constraint {c}"


def _matrix(quaternion):
    """Rotation matrix of a scalar-first quaternion."""
    return Rotation.from_quat(np.roll(quaternion, -1)).as_matrix()
