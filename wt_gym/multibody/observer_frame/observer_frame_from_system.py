"""The same bodies and joints in local observer frames: a tree or a constrained system, described once.

Every joint and constraint of a :class:`MultibodySystem` becomes rows of the constraint equations (5) between bodies
that move freely otherwise; every flexible body keeps its elastic coordinates and their shapes. What the local observer
frame as published does not know is left out: the second-order displacements, and with them the geometric stiffness;
with the displacement "second_order" they are kept.

*Servos* make their rows rheonomic: a drive turns the axes of the second section. *Springs and dampers* are torques on
the hinge that they bridge. *Massless bodies* have no mass matrix of their own. One without any inertia, held by a servo
or fixed, becomes a turned section of its parent, to which what it carries is joined. One on a hinge
that a rotor is geared to (the shaft of a generator) borrows mass from its rigid parent: points on the axis of the hinge
move with both bodies alike, so that the machine stays the same when their mass is counted with the other. Of the rotor
itself both bodies get mass points and the hinge an inertia (`Joint.rotor_tensors`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import cast

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from wt_gym.base.quantities import Array
from wt_gym.multibody.observer_frame.frame import Course, Drive, ObserverFrameSystem, Spring
from wt_gym.multibody.observer_frame.observer_frame_body import (
    ObserverFrameError,
    Place,
    Substructure,
    check_displacement,
    reference_condition,
    rigid_modes,
    seen_from_frame,
)
from wt_gym.multibody.system import MultibodySystem
from wt_gym.multibody.tree import tree_kernels
from wt_gym.structure.beam import Beam, SecondOrderField, skew
from wt_gym.structure.flexible_body import BodyInertia, FlexibleBody, Marker, ParticleFields, particle_fields

FRAME = "frame"
"""Name of the place where the frame of a body is: what its joint holds."""
LENT = 0.05
"""Share of the mass of a rigid body, and of its least moment of inertia, that a massless one on its hinge borrows."""


def observer_frame_from_system(
    system: MultibodySystem,
    beams: Mapping[str, tuple[Beam, Array]] | None = None,
    y: ArrayLike | None = None,
    rigid_modes: str = "deformed",
    reference: str = "clamped",
    motions: Mapping[str, Course] | None = None,
    torques: Mapping[str, Course] | None = None,
    displacement: str = "linear",
) -> ObserverFrameSystem:
    """A system in local observer frames from a built multibody system.

    Parameters
    ----------
    system : MultibodySystem
        Built; all joints but prismatic ones, and constraints that are welds, hinges or balls.
    beams : dict of str to (Beam, array (n_dof, n)), optional
        Beam and basis from which each flexible body was made, by the name of the body.
    y : array (n_state,), optional
        State of the multibody system in which the motion begins, default its initial state.
    rigid_modes : str
        Of :class:`ObserverFrameSystem`.
    reference : str
        Reference condition of the flexible bodies. The shapes stay those of the bodies: they are seen from another
        frame, from which their rigid-body part is taken.
    motions : dict of str to callable, optional
        Angle, rate and acceleration of servos as functions of time, by the name of joint or constraint; a servo without
        one keeps its angle.
    torques : dict of str to callable, optional
        References of angle and rate and the torque of revolute joints as functions of time, by the name of the joint;
        see :class:`wt_gym.multibody.observer_frame.frame.Spring`.
    displacement : str
        "linear", as published, or "second_order", with the second-order displacements of the bodies and so with their
        geometric stiffness.

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
    start = system.initial_state() if y is None else y
    return Translation(
        system, beams or {}, start, rigid_modes, reference, motions or {}, torques or {}, displacement
    ).observed


def mass_points(inertia: BodyInertia) -> tuple[Array, Array]:
    """Masses (6,) and positions (6, 3) of points with the mass, mass center and inertia tensor of a rigid body.

    Two points on each principal axis, at ± √(3 e/m) from the mass center for the second moment e = ∫ x² dm.
    """
    center = inertia.c0 / inertia.mass
    second = 0.5 * np.trace(inertia.j0) * np.eye(3) - inertia.j0 - inertia.mass * np.outer(center, center)
    value, axis = np.linalg.eigh(second)
    if value[0] < -1e-9 * max(np.abs(value).max(), 1e-300):
        raise ObserverFrameError(f"no mass distribution has the inertia tensor {inertia.j0.tolist()}")
    reach = np.sqrt(3.0 * np.maximum(value, 0.0) / inertia.mass) * axis
    return np.full(6, inertia.mass / 6.0), center + np.concatenate([reach.T, -reach.T])


def _massless_points(tensor: Array) -> tuple[Array, Array]:
    """The same for an inertia tensor (3, 3) without mass: points one meter out on its axes, one that makes up for them.

    Some of their masses are negative; in the sums over mass points that does not matter.
    """
    value, axis = np.linalg.eigh(0.5 * np.trace(tensor) * np.eye(3) - tensor)
    masses = np.concatenate([np.repeat(0.5 * value, 2), [-value.sum()]])
    return masses, np.concatenate([np.stack([axis.T, -axis.T], axis=1).reshape(6, 3), np.zeros((1, 3))])


def substructure_from_body(
    body: FlexibleBody,
    beam: Beam | None = None,
    basis: Array | None = None,
    reference: str = "clamped",
    lumped_masses: Sequence[tuple[float, Array]] = (),
    displacement: str = "linear",
) -> Substructure:
    """A substructure with the elastic coordinates, markers and mass of a body.

    Parameters
    ----------
    basis : array (n_dof, n), optional
        What :meth:`FlexibleBody.from_beam` was given; not needed for a rigid body.
    reference : str
        Reference condition: the shapes of the body without the rigid-body motion that does not comply with it.
    lumped_masses : sequence of (float, array (3,))
        Further mass points of a rigid body, of any sign [kg, m].
    displacement : str
        "linear" or "second_order".

    Raises
    ------
    ObserverFrameError
        When a flexible body comes without beam and basis, or with those of another body.
    """
    n, second = body.n_elastic, None
    rigid: Array = np.zeros((6, n))
    check_displacement(displacement)
    if n == 0:
        whole = body.inertia.mass > 0.0
        mass, position = mass_points(body.inertia) if whole else _massless_points(body.inertia.j0)
        ends = position[:2]
        if lumped_masses:
            mass = np.concatenate([mass, [m for m, _ in lumped_masses]])
            position = np.concatenate([position, [x for _, x in lumped_masses]])
        points = mass, position, np.zeros((len(mass), 3, 0))
    else:
        if beam is None or basis is None:
            raise ObserverFrameError(f"body {body.name!r} is flexible: its beam and basis are needed")
        fields = particle_fields(beam, basis)
        points = beam.particle_mass, fields.position, fields.linear
        generalized = np.einsum("p,pij,pik->jk", points[0], points[2], points[2], optimize=True)
        expected = body.inertia.m0
        if generalized.shape != expected.shape or np.abs(generalized - expected).max() > 1e-9 * np.abs(expected).max():
            raise ObserverFrameError(f"body {body.name!r} was not made from the beam and basis given for it")
        ends = beam.node_position[[0, -1]]
        if reference != "clamped":
            rows = reference_condition(beam, reference)
            rigid = np.asarray(-np.linalg.solve(rows @ rigid_modes(beam), rows @ basis), dtype=float)
            points = *points[:2], points[2] + rigid[:3] - skew(points[1]) @ rigid[3:]
        if displacement == "second_order":
            second = partial(_second_of_points, fields, rigid)
    places = {key: _place(marker, np.zeros(3), rigid) for key, marker in body.markers.items()}
    none = np.zeros((3, n, n))
    places[FRAME] = Place(np.zeros(3), rigid, lambda: none)
    return Substructure.from_points(
        body.name, points, body.stiffness, body.damping, places, ends, reference=reference if n else "given",
        definite=not lumped_masses, second=second,
    )  # fmt: skip


def _second_of_points(fields: ParticleFields, rigid: Array) -> Array:
    return seen_from_frame(fields.second, fields.position, fields.linear, rigid)


def _place(marker: Marker, offset: Array, rigid: Array) -> Place:
    """The point at an offset (3,) from a marker, carried by its section; shapes with a rigid-body part (6, n)."""
    position = marker.position + offset
    clamped = marker.linear - skew(offset) @ marker.rotation
    linear = clamped + rigid[:3] - skew(position) @ rigid[3:]

    def second_order() -> Array:
        second = marker.second + SecondOrderField.of_offset(marker.rotation[None], offset[None])[0]
        return cast("Array", seen_from_frame(second[None], position[None], clamped[None], rigid)[0])

    return Place(position, np.vstack([linear, marker.rotation + rigid[3:]]), second_order)


@dataclass(frozen=True)
class _Base:
    """Where a joint is: on the ground or a section of a body, which a drive may turn before the joint.

    The axes of the joint are S exp(θ ã) R in those of the section S.
    """

    body: int  # −1: the ground
    place: str | None
    position: Array  # (3,) of the ground
    rotation: Array  # R (3, 3)
    drive: int = -1
    axis: Array | None = None  # a (3,)


class Translation:
    """One use of :func:`observer_frame_from_system`; its arguments are explained there.

    Attributes
    ----------
    tree_bodies : list of int
        Body of the multibody system from which each substructure is made.
    rigid_parts : list of array (6, n_f)
        Motion of the frame of the tree's body from the moving frame per elastic coordinate, by substructure.
    hinges : list of (int, int)
        Springs, and the bodies of the tree on whose revolute joints they act.
    servos : list of int
        State of a servo of the multibody system that each drive follows.
    """

    def __init__(
        self,
        system: MultibodySystem,
        beams: Mapping[str, tuple[Beam, Array]],
        y: ArrayLike,
        rigid_modes: str = "deformed",
        reference: str = "clamped",
        motions: Mapping[str, Course] | None = None,
        torques: Mapping[str, Course] | None = None,
        displacement: str = "linear",
    ) -> None:
        unknown = sorted(set(beams) - {body.name for body in system.bodies})
        if unknown:
            raise ObserverFrameError(
                f"beams are given for {unknown}, but the bodies are {[b.name for b in system.bodies]}"
            )
        self.system = system
        self.y: Array = np.ascontiguousarray(y, dtype=float)
        self._motions, self._torques = dict(motions or {}), torques
        self.work = system.new_work()
        tree_kernels.kinematics(self.y, system.tree, self.work)
        self.observed = ObserverFrameSystem(system.gravity, rigid_modes)
        self.hinges: list[tuple[int, int]] = []
        self.servos: list[int] = []
        self._is_carrier = [self._carries_only(b) for b in range(len(system.bodies))]
        self.tree_bodies = [b for b, carrier in enumerate(self._is_carrier) if not carrier]
        lumped_masses = self._lend()
        self.bodies = {  # by the body of the multibody system
            b: substructure_from_body(system.bodies[b], beam, basis, reference, lumped_masses[b], displacement)
            for b in self.tree_bodies
            for beam, basis in [beams.get(system.bodies[b].name, (None, None))]
        }
        self.rigid_parts = [self.bodies[b].places[FRAME].field for b in self.tree_bodies]
        self.frames: list[tuple[Array, Array]] = []
        self._bases: list[_Base] = []
        for b in range(len(system.bodies)):
            self._place_by_joint(b)
        for c in range(len(system.constraints)):
            self._place_by_constraint(c)
        for b in self.tree_bodies:
            self._add(b, self.bodies[b])
        for b in self.tree_bodies:
            self._hold_by_joint(b)
        for c in range(len(system.constraints)):
            self._hold_by_constraint(c)

    # ---- bodies without mass -----------------------------------------------------------------------------------------

    def _carries_only(self, b: int) -> bool:
        """Whether a body is nothing but a turned section of its parent."""
        body = self.system.bodies[b]
        nothing = body.n_elastic == 0 and body.inertia.mass == 0.0 and not np.any(body.inertia.j0)
        return nothing and self.system.joints[b].kind in ("fixed", "servo")

    def _lend(self) -> list[list[tuple[float, Array]]]:
        """Mass points (mass, place) that each body gets or gives.

        Bodies without mass borrow on their hinge; rotors geared to hinges have axial inertia in both bodies.
        """
        system = self.system
        lumped_masses: list[list[tuple[float, Array]]] = [[] for _ in system.bodies]
        for b, body in enumerate(system.bodies):
            if body.inertia.mass > 0.0 or self._is_carrier[b]:
                continue
            joint, p = system.joints[b], system.parents[b]
            lender = system.bodies[p] if p >= 0 else None
            if joint.kind != "revolute" or lender is None or lender.n_elastic or not lender.inertia.mass > 0.0:
                raise ObserverFrameError(
                    f"body {body.name!r} has no mass; in local observer frames it needs a revolute joint on a rigid "
                    "body with mass"
                )
            mass = lender.inertia.mass
            arm = skew(lender.inertia.c0 / mass)
            least = np.linalg.eigvalsh(lender.inertia.j0 + mass * arm @ arm)[0]
            axis, offset = np.asarray(joint.axis, dtype=float), np.asarray(joint.offset, dtype=float)
            turn = np.eye(3) if joint.rotation is None else joint.rotation
            there = cast("Marker", system._markers[b]).position + offset
            reach = np.sqrt(least / mass)
            for side in (-reach, reach):
                lumped_masses[b].append((0.5 * LENT * mass, side * axis))
                lumped_masses[p].append((-0.5 * LENT * mass, there + side * turn @ axis))
        for body, points, tensor in zip(system.bodies, lumped_masses, system.rotor_tensors, strict=True):
            if not np.any(tensor):
                continue
            if body.n_elastic:
                raise ObserverFrameError(
                    f"body {body.name!r} is flexible; in local observer frames a rotor may be geared to the joint of a "
                    "rigid body only"
                )
            points.extend(zip(*_massless_points(tensor), strict=True))
        return lumped_masses

    # ---- places ------------------------------------------------------------------------------------------------------

    def _elastic(self, b: int) -> tuple[Array, Array]:
        """Elastic coordinates and rates (n_f,) of a body."""
        n = self.system.bodies[b].n_elastic
        q, u = self.system.index(b, "elastic_q"), self.system.n_q + self.system.index(b, "elastic_u")
        return self.y[q : q + n], self.y[u : u + n]

    def _servo(self, number: int) -> float:
        """Angle of a servo."""
        return float(self.y[self.system.n_q + self.system.n_u + number])

    def _carried(
        self, b: int, marker: Marker | None, offset: ArrayLike, rotation: ArrayLike | None
    ) -> tuple[Array, Array, Place | None]:
        """Position and orientation of a frame on a marker of a body (on the ground for −1), and its place."""
        lever: Array = np.asarray(offset, dtype=float)
        turned: Array = np.eye(3) if rotation is None else np.asarray(rotation, dtype=float)
        if b < 0 or marker is None:
            return lever, turned, None
        place = _place(marker, lever, self.bodies[b].places[FRAME].field)
        field = self.bodies[b].displacement(place, self._elastic(b)[0])
        position, frame = self.frames[b]
        turn = Rotation.from_rotvec(field[3:]).as_matrix()
        return position + frame @ (place.position + field[:3]), frame @ turn @ turned, place

    def _base(self, b: int) -> tuple[Array, Array, _Base]:
        """Where the joint of a body is, with the section as it stands: (position, orientation of the joint, base)."""
        joint, p = self.system.joints[b], self.system.parents[b]
        rotation = np.eye(3) if joint.rotation is None else np.asarray(joint.rotation, dtype=float)
        if p >= 0 and self._is_carrier[p]:
            position, frame = self.frames[p]
            base = self._bases[p]
            if np.any(joint.offset):
                raise ObserverFrameError(f"joint {joint.name!r}: it must not be offset from a body without mass")
            turned = _Base(base.body, base.place, base.position, base.rotation @ rotation, base.drive, base.axis)
            return position, frame @ rotation, turned
        position, frame, place = self._carried(p, self.system._markers[b], joint.offset, rotation)
        if place is None:
            return position, frame, _Base(-1, None, position, rotation)
        name = f"joint of {self.system.bodies[b].name}"
        self.bodies[p].places[name] = place
        return position, frame, _Base(p, name, position, rotation)

    def _place_by_joint(self, b: int) -> None:
        """Frames are placed by the displacements of this formulation, so that its constraints hold exactly."""
        joint, kind = self.system.joints[b], self.system.joints[b].kind
        if kind == "prismatic":
            raise ObserverFrameError(f"joint {joint.name!r}: a prismatic joint has no form in local observer frames")
        position, rotation, base = self._base(b)
        first = self.system.index(b, "joint_q")
        if kind == "revolute":
            rotation = rotation @ Rotation.from_rotvec(self.y[first] * np.asarray(joint.axis)).as_matrix()
        elif kind == "servo":
            if base.drive >= 0:
                raise ObserverFrameError(f"joint {joint.name!r}: two servos need a body with mass between them")
            number = self.system.index(b, "servo")
            angle = self._servo(number)
            rotation = rotation @ Rotation.from_rotvec(angle * np.asarray(joint.axis)).as_matrix()
            drive = self._new_drive(joint.name or f"{self.system.bodies[b].name}_joint", number)
            base = _Base(
                base.body, base.place, base.position, base.rotation, drive, base.rotation @ np.asarray(joint.axis)
            )
        elif kind == "spherical":
            rotation = rotation @ _matrix(self.y[first : first + 4])
        elif kind == "free":
            position = position + rotation @ self.y[first : first + 3]
            rotation = rotation @ _matrix(self.y[first + 3 : first + 7])
        self._bases.append(base)
        if not self._is_carrier[b]:
            field = self.bodies[b].displacement(self.bodies[b].places[FRAME], self._elastic(b)[0])
            rotation = rotation @ Rotation.from_rotvec(field[3:]).as_matrix().T
            position = position - rotation @ field[:3]
        self.frames.append((position, rotation))

    def _new_drive(self, name: str, number: int) -> int:
        """A drive that follows a servo of the system, or keeps its current angle."""
        angle = self._servo(number)
        self.observed.drives.append(Drive(name, self._motions.get(name, lambda time: (angle, 0.0, 0.0))))
        self.servos.append(number)
        return len(self.servos) - 1

    def _place_by_constraint(self, c: int) -> None:
        """A free body is put where its constraint holds it; names the places on both sides."""
        constraint, (first, second, marker, second_marker) = self.system.constraints[c], self.system._tied[c]
        one = self._carried(first, marker, constraint.offset, constraint.rotation)
        two = self._carried(second, second_marker, constraint.second_offset, constraint.second_rotation)
        for b, place in ((first, one[2]), (second, two[2])):
            if place is not None:
                self.bodies[b].places[_constraint_place(c)] = place
        if second >= 0 and self.system.joints[second].kind == "free":
            position, rotation = self.frames[second]
            held = one[1]
            if constraint.servo_frequency > 0.0:
                angle = self._servo(self.system._constraint_servo[c])
                held = held @ Rotation.from_rotvec(angle * np.asarray(constraint.axis)).as_matrix()
            turn = held @ two[1].T if constraint.kind == "weld" else np.eye(3)
            self.frames[second] = one[0] + turn @ (position - two[0]), turn @ rotation

    def _add(self, b: int, body: Substructure) -> None:
        position, rotation = self.frames[b]
        q, rate = self._elastic(b)
        none, own = np.zeros(6), self.work.rot[b]
        turning = body.places[FRAME].field @ rate
        self.observed.add(
            body,
            position,
            rotation,
            own @ self.work.v[b],
            own @ self.work.omega[b] - rotation @ turning[3:],
            np.concatenate([q, none]),
            np.concatenate([rate, none]),
        )

    # ---- what holds them ---------------------------------------------------------------------------------------------

    def _hold_by_joint(self, b: int) -> None:
        joint, base, observed = self.system.joints[b], self._bases[b], self.observed
        kind, mine = joint.kind, (self.bodies[b].name, FRAME)
        if kind == "free":
            return
        other: tuple[str | None, str | None] = None, None
        if base.place is None:
            observed.support(*mine)
        else:
            other = self.bodies[base.body].name, base.place
            observed.join(*mine, self.bodies[base.body].name, base.place)
        axes, label = base.rotation, joint.name or f"{self.system.bodies[b].name}_joint"
        turned = np.zeros(3) if base.axis is None else base.axis
        if kind in ("fixed", "servo"):
            pairs = [(np.eye(3)[i], axes[:, j]) for i, j in ((0, 1), (1, 2), (2, 0))]
            observed._orthogonal(*mine, *other, pairs, f"{kind} joint {label}", base.drive, turned)
        elif kind == "revolute":
            axis = np.asarray(joint.axis, dtype=float)
            across = np.linalg.svd(axis[None])[2][1:]
            rows = [(axis, axes @ t) for t in across]
            observed._orthogonal(*mine, *other, rows, f"hinge {label}", base.drive, turned)
            acts = joint.stiffness or joint.damping or joint.rotor_inertia
            acts = acts or self._torques is None or label in self._torques
            if acts:
                self._bridge(b, mine, other, label, axes @ axis, (across[0], axes @ across[0]))

    def _bridge(
        self,
        b: int,
        mine: tuple[str, str],
        other: tuple[str | None, str | None],
        label: str,
        axis: Array,
        vectors: tuple[Array, Array],
    ) -> None:
        """Spring, damper and torque of a revolute joint."""
        joint, base = self.system.joints[b], self._bases[b]
        if base.axis is not None and base.axis @ axis < 1.0 - 1e-12:
            raise ObserverFrameError(f"joint {label!r}: a spring behind a servo needs the axis of the servo")
        along = axis if base.axis is None else base.axis
        spring = Spring(label, joint.stiffness, joint.damping, (self._torques or {}).get(label))
        spring.angle = float(self.y[self.system.index(b, "joint_q")])
        spring.inertia = joint.rotor_tensors[2]
        self.observed.spring(*mine, *other, along, vectors, spring, base.drive)
        self.hinges.append((len(self.observed.springs) - 1, b))

    def _hold_by_constraint(self, c: int) -> None:
        constraint, (first, second, marker, _) = self.system.constraints[c], self.system._tied[c]
        here = _constraint_place(c)
        names = [None if b < 0 else self.bodies[b].name for b in (first, second)]
        if constraint.servo_frequency > 0.0:
            if constraint.kind != "weld" or names[1] is None:
                raise ObserverFrameError(f"constraint {constraint.name!r}: only the weld of a body takes a servo")
            axes, own = (
                np.eye(3) if r is None else np.asarray(r, dtype=float)
                for r in (constraint.rotation, constraint.second_rotation)
            )
            drive = self._new_drive(constraint.name or here, self.system._constraint_servo[c])
            if names[0] is None:
                self.observed.support(names[1], here)
            else:
                self.observed.join(names[1], here, names[0], here)
            pairs = [(own[:, i], axes[:, j]) for i, j in ((0, 1), (1, 2), (2, 0))]
            place = None if first < 0 else here
            label, axis = f"servo {constraint.name}", axes @ np.asarray(constraint.axis)
            self.observed._orthogonal(names[1], here, names[0], place, pairs, label, drive, axis)
            return
        axis = self._carried(first, marker, constraint.offset, constraint.rotation)[1] @ np.asarray(constraint.axis)
        one, other = names if names[1] is None else names[::-1]
        self._hold(constraint.kind, cast("str", one), other, here, axis)

    def _hold(self, kind: str, body: str, other: str | None, here: str, axis: Array) -> None:
        """Weld, hinge or ball between the places ``here`` of two bodies; the second may be the ground, None."""
        observed = self.observed
        if kind == "weld":
            observed.clamp(body, here) if other is None else observed.weld(other, here, body, here)
        elif kind == "ball":
            observed.support(body, here) if other is None else observed.join(other, here, body, here)
        elif kind == "hinge":
            observed.hinge(body, here, axis, other, None if other is None else here)


def _constraint_place(c: int) -> str:
    return f"constraint {c}"


def _matrix(quaternion: Array) -> Array:
    """Rotation matrix of a scalar-first quaternion."""
    return cast("Array", Rotation.from_quat(np.roll(quaternion, -1)).as_matrix())
