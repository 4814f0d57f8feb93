"""Flexible multibody systems of tree topology, assembled from bodies and joints.

``MultibodySystem`` collects bodies, each hung by a joint on a marker of an earlier body (or on the ground), and packs
them into plain arrays for the compiled equations of motion in :mod:`wt_gym.multibody.tree.tree_kernels`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from wt_gym.base.compiled import compiled_for
from wt_gym.base.quantities import GRAVITY, MOTIONS, Array, Integers
from wt_gym.multibody.arrays import (
    FAILURES,
    Inputs,
    MultibodyError,
    Tree,
    Work,
    check_body,
    check_number,
    check_rotation,
    check_unique,
    check_vector,
    new_history,
    numbers,
)
from wt_gym.multibody.arrays import Points as Points  # as kernels import it
from wt_gym.multibody.constraints import constraint_kernels
from wt_gym.multibody.integrators import integrator_kernels
from wt_gym.multibody.tree import output_kernels, rate_kernels, tree_kernels
from wt_gym.structure.flexible_body import FlexibleBody, Marker

UNIT_NORM = 1e-6
"""Largest deviation of a quaternion's norm from one in a given state. Integrators keep it below 1e-15."""
CONSISTENT = 1e-5
"""Largest residual of a constraint equation at the start [m, rad, m/s, rad/s]."""


class MultibodySystem:
    """A tree of rigid and flexible bodies, and constraint equations between them.

    Parameters
    ----------
    gravity : array (3,)
        [m/s²], by default straight down with :data:`wt_gym.base.quantities.GRAVITY`.
    stabilization : float
        Baumgarte's α = β [1/s]: constraint errors decay like exp(−α t). Explicit schemes need α h < 1.29 (0.87 with one
        corrector pass, 0.72 with two).
    projection : bool
        Put the state back onto the constraint equations after each step of the Hamming scheme; without it the
        stabilization alone holds what steps drift by.

    Examples
    --------
    >>> system = MultibodySystem()
    >>> bob = FlexibleBody.rigid("bob", 1.0, (0.0, 0.0, -1.0), np.zeros((3, 3)))
    >>> system.add(bob, Joint("revolute", axis=(0.0, 1.0, 0.0), name="swing"))
    0
    >>> system.build().n_u
    1
    """

    def __init__(
        self, gravity: ArrayLike = (0.0, 0.0, -GRAVITY), stabilization: float = 10.0, projection: bool = True
    ) -> None:
        check_vector("multibody system", "gravity", gravity)
        check_number("multibody system", "stabilization", stabilization)
        self.gravity, self.stabilization = np.asarray(gravity, dtype=float), float(stabilization)
        self.projection = bool(projection)
        self.bodies: list[FlexibleBody] = []
        self.joints: list[Joint] = []
        self.parents: list[int] = []
        self._markers: list[Marker | None] = []
        self.constraints: list[Constraint] = []
        self._tied: list[tuple[int, int, Marker | None, Marker | None]] = []
        self._added: tuple[int, Array] = -1, np.zeros((6, 6))
        self.tree: Any = None  # Tree, once it is built
        self._compiled_rates: Callable[..., int] | None = None  # for the types of this system

    def __getstate__(self) -> dict[str, Any]:
        """What a pickle takes along: all but compiled code."""
        return self.__dict__ | {"_compiled_rates": None}

    def add(self, body: FlexibleBody, joint: "Joint", parent: int | None = None, marker: str = "origin") -> int:
        """Add a body; returns its index.

        Parameters
        ----------
        parent : int, optional
            Index of an earlier body; None hangs the joint on the ground (position = joint.offset).
        marker : str
            Marker of the parent that carries the joint.

        Raises
        ------
        MultibodyError
            For an unknown parent or marker, a body with negative mass or inertia, a rotor geared to a joint on a
            flexible parent, or a system that is already built.
        """
        self._check_open(f"body {body.name!r}")
        check_body(body)
        if parent is None:
            self._markers.append(None)
        else:
            if not 0 <= parent < len(self.bodies):
                raise MultibodyError(f"body {body.name!r}: parent {parent} is not one of the {len(self.bodies)} bodies")
            markers = self.bodies[parent].markers
            if marker not in markers:
                raise MultibodyError(
                    f"body {body.name!r}: {self.bodies[parent].name!r} has no marker {marker!r}, only {sorted(markers)}"
                )
            if joint.rotor_inertia > 0.0 and self.bodies[parent].n_elastic:
                raise MultibodyError(
                    f"body {body.name!r}: the rotor geared to its joint needs bearings in a rigid body, but "
                    f"{self.bodies[parent].name!r} has {self.bodies[parent].n_elastic} elastic coordinates"
                )
            self._markers.append(markers[marker])
        self.bodies.append(body)
        self.joints.append(joint)
        self.parents.append(-1 if parent is None else parent)
        return len(self.bodies) - 1

    def add_constraint(
        self,
        constraint: "Constraint",
        first: int | None,
        second: int | None,
        marker: str = "origin",
        second_marker: str = "origin",
    ) -> int:
        """Tie two bodies; returns the index of the constraint.

        Parameters
        ----------
        first, second : int or None
            Bodies; None is the ground. The multipliers are the forces (and moments) on the second body, in the axes of
            the first frame. A free second body that hangs on the ground counts as carried by the first.
        marker, second_marker : str
            Markers of the bodies.

        Raises
        ------
        MultibodyError
            For unknown bodies or markers, or a system that is already built.
        """
        self._check_open(f"constraint {constraint.name!r}")
        ends: list[Marker | None] = []
        for body, name in ((first, marker), (second, second_marker)):
            if body is None:
                ends.append(None)
                continue
            if not 0 <= body < len(self.bodies):
                raise MultibodyError(
                    f"constraint {constraint.name!r}: body {body} is not one of {len(self.bodies)} bodies"
                )
            if name not in self.bodies[body].markers:
                raise MultibodyError(
                    f"constraint {constraint.name!r}: {self.bodies[body].name!r} has no marker {name!r}, only "
                    f"{sorted(self.bodies[body].markers)}"
                )
            ends.append(self.bodies[body].markers[name])
        self.constraints.append(constraint)
        self._tied.append((-1 if first is None else first, -1 if second is None else second, ends[0], ends[1]))
        return len(self.constraints) - 1

    def add_water(self, body: int, added_mass: ArrayLike) -> None:
        """Let water move with a body that floats.

        Parameters
        ----------
        body : int
            On a Cardan joint to the ground.
        added_mass : array (6, 6)
            Symmetric, at the origin of the body along global axes, positive semidefinite [kg, kg m, kg m²].

        Raises
        ------
        MultibodyError
            For another joint, a second body in water, or a matrix that is no inertia.
        """
        name = self.bodies[body].name
        self._check_open(f"the added mass of {name!r}")
        if self.joints[body].kind != "cardan" or self.parents[body] >= 0 or self._added[0] >= 0:
            raise MultibodyError(f"added mass must belong to one body on a Cardan joint to the ground, got {name!r}")
        matrix = numbers(f"body {name!r}", "added_mass", added_mass)
        if matrix.shape != (6, 6) or not np.isfinite(matrix).all() or not np.allclose(matrix, matrix.T, rtol=1e-6):
            raise MultibodyError(f"the added mass of {name!r} must be a symmetric finite matrix (6, 6)")
        if not np.linalg.eigvalsh(matrix)[0] >= -1e-9 * np.abs(matrix).max():
            raise MultibodyError(f"the added mass of {name!r} must be positive semidefinite")
        self._added = body, np.ascontiguousarray(matrix)

    def build(self) -> "MultibodySystem":
        """Pack everything into arrays; returns self.

        Raises
        ------
        MultibodyError
            Without bodies or degrees of freedom, and for names of coordinates that occur twice.
        """
        if not self.bodies:
            raise MultibodyError("a multibody system needs at least one body")
        self._number_coordinates()
        self.quaternions = self._find_quaternions()
        check_unique("state", self.state_names)
        self.tree = Tree(**self._topology(), **self._joint_arrays(), **self._body_arrays())
        return self

    def _check_open(self, what: str) -> None:
        if self.tree is not None:
            raise MultibodyError(f"{what} comes too late: the system is built; add everything before build()")

    def require_built(self) -> None:
        """Refuse the use of a system that is not built.

        Raises
        ------
        MultibodyError
        """
        if self.tree is None:
            raise MultibodyError("the system is not built yet: call build() after adding bodies and constraints")

    # ---- coordinates -----------------------------------------------------------------------------------------------

    def _number_coordinates(self) -> None:
        """Positions, velocities and servo states: joint first, then elastic coordinates, body by body."""
        n_q = n_u = n_servo = 0
        self._index: list[dict[str, int]] = []
        self.coordinate_names: list[str] = []
        self.velocity_names: list[str] = []
        for body, joint in zip(self.bodies, self.joints, strict=True):
            entry = {"joint_q": n_q, "joint_u": n_u, "servo": n_servo}
            name = joint.name or f"{body.name}_joint"
            self.coordinate_names += _joint_names(name, joint.kind, joint.n_position)
            self.velocity_names += _joint_names(name, joint.kind, joint.n_velocity)
            n_q, n_u = n_q + joint.n_position, n_u + joint.n_velocity
            n_servo += joint.kind == "servo"
            entry |= {"elastic_q": n_q, "elastic_u": n_u}
            self.coordinate_names += body.coordinate_names
            self.velocity_names += body.coordinate_names
            n_q, n_u = n_q + body.n_elastic, n_u + body.n_elastic
            self._index.append(entry)
        self._constraint_servo: list[int] = []
        for constraint in self.constraints:
            driven = constraint.servo_frequency > 0.0
            self._constraint_servo.append(n_servo if driven else -1)
            n_servo += driven
        self.n_q, self.n_u, self.n_servo = n_q, n_u, n_servo
        self.n_constraints = sum(c.n_rows for c in self.constraints)
        if n_u == 0:
            raise MultibodyError("the system has no degree of freedom")

    @property
    def n_state(self) -> int:
        """Length of the state vector [positions, velocities, servo angles, servo rates]."""
        return self.n_q + self.n_u + 2 * self.n_servo

    @property
    def state_names(self) -> list[str]:
        """Names of the entries of the state vector."""
        servo = [drive.name or f"servo_{i}" for i, drive in enumerate(self._servos)]
        rate = [f"{n}_rate" for n in self.velocity_names]
        return [*self.coordinate_names, *rate, *servo, *(f"{n}_rate" for n in servo)]

    @property
    def constrained(self) -> int | None:
        """What the kernels take for ``constrained``: None without constraint equations."""
        return 1 if self.constraints else None

    @property
    def _servos(self) -> "list[Joint | Constraint]":
        """Joints and constraints with a servo, in the order of their states."""
        joints = [j for j in self.joints if j.kind == "servo"]
        return [*joints, *(c for c in self.constraints if c.servo_frequency > 0.0)]

    def _find_quaternions(self) -> list[tuple[int, str]]:
        """First index of each quaternion among the coordinates, with the name of its body: list of (int, str)."""
        return [
            (entry["joint_q"] + (3 if joint.kind == "free" else 0), body.name)
            for entry, joint, body in zip(self._index, self.joints, self.bodies, strict=True)
            if joint.kind in ("spherical", "free")
        ]

    def position_change(self, y: Array, u: int) -> Array:
        """Change of the positions (n_q,) per motion along the velocity number u, in the state y."""
        velocity, change, tree = np.zeros(self.n_u), np.zeros(self.n_state), self.tree
        velocity[u] = 1.0
        rate_kernels.position_rates(y, velocity, tree.dof_q, tree.kind, tree.joint_q, tree.joint_u, change)
        return change[: self.n_q]

    def multiplier_rows(self, constraint: int) -> slice:
        """Slice of ``work.multipliers`` that belongs to a constraint."""
        rows = [c.n_rows for c in self.constraints]
        start = sum(rows[:constraint])
        return slice(start, start + rows[constraint])

    def index(self, body: int, what: str) -> int:
        """Index of the first "joint_q", "joint_u", "elastic_q", "elastic_u" or "servo" entry of a body.

        Where it has no such entry the index is that of the next body.
        """
        return self._index[body][what]

    def initial_state(self) -> Array:
        """State (n_state,) at rest with all coordinates zero and unit quaternions."""
        self.require_built()
        y = np.zeros(self.n_state)
        for entry, joint in zip(self._index, self.joints, strict=True):
            if joint.kind == "spherical":
                y[entry["joint_q"]] = 1.0
            elif joint.kind == "free":
                y[entry["joint_q"] + 3] = 1.0
        return y

    # ---- packing ---------------------------------------------------------------------------------------------------

    def _topology(self) -> dict[str, Any]:
        n_b = len(self.bodies)
        cols, n_col = np.zeros((n_b, self.n_u), dtype=np.int64), np.zeros(n_b, dtype=np.int64)
        inherited: list[list[int]] = []
        for b in range(n_b):
            p, entry = self.parents[b], self._index[b]
            chain: list[int] = []
            if p >= 0:
                first = self._index[p]["elastic_u"]
                chain = inherited[p] + list(range(first, first + self.bodies[p].n_elastic))
            chain = chain + list(range(entry["joint_u"], entry["joint_u"] + self.joints[b].n_velocity))
            inherited.append(chain)
            n_col[b] = len(chain)
            cols[b, : len(chain)] = chain
        index = {key: np.array([e[key] for e in self._index]) for key in self._index[0]}
        return {
            "parent": np.array(self.parents),
            "dof_parent": self._previous_velocities(inherited),
            "kind": np.array([j.code for j in self.joints]),
            "n_elastic": np.array([b.n_elastic for b in self.bodies]),
            "cols": cols,
            "n_col": n_col,
            "n_q": self.n_q,
            "n_u": self.n_u,
            "n_servo": self.n_servo,
            "gravity": self.gravity,
            "added_body": self._added[0],
            "added_mass": self._added[1],
            **index,
            **self._constraint_arrays(),
        }

    def _previous_velocities(self, chains: Sequence[Sequence[int]]) -> Integers:
        """Velocity before each one on its way from the ground, -1 for the first; chains: those up to a body's joint."""
        previous = np.full(self.n_u, -1)
        for b, chain in enumerate(chains):
            first = self._index[b]["elastic_u"]
            way = [*chain, *range(first, first + self.bodies[b].n_elastic)]
            previous[way[1:]] = way[:-1]
        return previous

    def _constraint_arrays(self) -> dict[str, Any]:
        """Constraint equations, and the body that carries each body's loads."""
        carrier = list(self.parents)
        turn = np.zeros((len(self.constraints), 3, 3))
        for c, (constraint, (first, second, _, _)) in enumerate(zip(self.constraints, self._tied, strict=True)):
            if second >= 0 and self.joints[second].kind == "free" and carrier[second] < 0:
                if first >= second:
                    raise MultibodyError(f"constraint {constraint.name!r}: the carrying body must be added before")
                carrier[second] = first
            turn[c] = np.eye(3)
            if constraint.kind == "hinge":
                turn[c, :2] = _across(np.asarray(constraint.axis, dtype=float))
        return {
            "load_parent": np.array(carrier),
            "constraint_kind": np.array([c.code for c in self.constraints], dtype=np.int64),
            "constraint_body": np.array([t[:2] for t in self._tied], dtype=np.int64).reshape(-1, 2),
            "constraint_axis": np.array([c.axis for c in self.constraints], dtype=float).reshape(-1, 3),
            "constraint_turn": turn,
            "constraint_servo": np.array(self._constraint_servo, dtype=np.int64),
            "stabilization": self.stabilization,
            "projection": int(self.projection),
        }

    def _frames(self) -> list[tuple[Marker | None, ArrayLike | None, ArrayLike]]:
        """Markers, orientations and offsets of all joints, then of both ends of every constraint."""
        frames = [(m, j.rotation, j.offset) for m, j in zip(self._markers, self.joints, strict=True)]
        for constraint, (_, _, first, second) in zip(self.constraints, self._tied, strict=True):
            frames.append((first, constraint.rotation, constraint.offset))
            frames.append((second, constraint.second_rotation, constraint.second_offset))
        return frames

    def _joint_arrays(self) -> dict[str, Any]:
        frames, nf, servos = self._frames(), self._max_elastic, self._servos
        n = len(frames)
        out = {
            "axis": np.array([j.axis for j in self.joints], dtype=float),
            "joint_rotation": np.array([np.eye(3) if r is None else r for _, r, _ in frames], dtype=float),
            "joint_offset": np.array([o for _, _, o in frames], dtype=float),
            "marker_position": np.zeros((n, 3)),
            "marker_linear": np.zeros((n, 3, nf)),
            "marker_second": np.zeros((n, 3, nf, nf)),
            "marker_rotation": np.zeros((n, 3, nf)),
            "dof_stiffness": np.zeros(self.n_u),
            "dof_damping": np.zeros(self.n_u),
            "dof_inertia": np.zeros(self.n_u),
            "dof_q": np.full(self.n_u, -1),
            "servo_frequency": np.array([d.servo_frequency for d in servos], dtype=float),
            "servo_damping": np.array([d.servo_damping for d in servos], dtype=float),
        }
        for k, (marker, _, _) in enumerate(frames):
            if marker is not None:
                m = marker.linear.shape[1]
                out["marker_position"][k] = marker.position
                out["marker_linear"][k, :, :m] = marker.linear
                out["marker_second"][k, :, :m, :m] = marker.second
                out["marker_rotation"][k, :, :m] = marker.rotation
        for body, joint, entry in zip(self.bodies, self.joints, self._index, strict=True):
            u, q = entry["joint_u"], entry["joint_q"]
            n_slide = {"revolute": 1, "prismatic": 1, "free": 3, "cardan": 6}.get(joint.kind, 0)
            out["dof_q"][u : u + n_slide] = np.arange(q, q + n_slide)
            if joint.kind in ("revolute", "prismatic"):
                out["dof_stiffness"][u], out["dof_damping"][u] = joint.stiffness, joint.damping
                out["dof_inertia"][u] = joint.rotor_tensors[2]
            first = entry["elastic_u"]
            out["dof_q"][first : first + body.n_elastic] = entry["elastic_q"] + np.arange(body.n_elastic)
        return out

    @property
    def _max_elastic(self) -> int:
        return max(1, *(b.n_elastic for b in self.bodies))

    @property
    def _max_complete(self) -> int:
        return max(1, *(len(b.inertia.m2) for b in self.bodies))

    def _body_arrays(self) -> dict[str, Any]:
        n_b, nf, n_full = len(self.bodies), self._max_elastic, self._max_complete
        shapes: dict[str, tuple[int, ...]] = {
            "c0": (3,),
            "c1": (3, nf),
            "c2": (3, nf, nf),
            "j0": (3, 3),
            "j1": (nf, 3, 3),
            "j2": (nf, nf, 3, 3),
            "d0": (nf, 3),
            "d1": (nf, nf, 3),
            "m0": (nf, nf),
            "m1": (nf, nf, nf),
            "d2": (n_full, n_full, n_full, 3),
            "m2": (n_full, n_full, n_full, n_full),
        }
        out = {key: np.zeros((n_b, *shape)) for key, shape in shapes.items()}
        out["mass"] = np.array([b.inertia.mass for b in self.bodies])
        out["n_complete"] = np.array([len(b.inertia.m2) for b in self.bodies])
        out["stiffness"], out["damping"] = np.zeros((n_b, nf, nf)), np.zeros((n_b, nf, nf))
        for b, body in enumerate(self.bodies):
            for key in shapes:
                value = getattr(body.inertia, key)
                part: tuple[Any, ...] = (b, *(slice(0, n) for n in value.shape))
                out[key][part] = value
            n = body.n_elastic
            out["stiffness"][b, :n, :n], out["damping"][b, :n, :n] = body.stiffness, body.damping
        out["j0"] += self.rotor_tensors
        return out

    @property
    def rotor_tensors(self) -> Array:
        """Inertia tensors (n_b, 3, 3) that rotors geared to joints add to the bodies; see `Joint.rotor_tensors`."""
        out = np.zeros((len(self.bodies), 3, 3))
        for b, (joint, parent) in enumerate(zip(self.joints, self.parents, strict=True)):
            of_parent, of_body, _ = joint.rotor_tensors
            out[b] += of_body
            if parent >= 0:
                out[parent] += of_parent
        return out

    def new_work(self, trail: int = 0) -> Work:
        """Scratch arrays for one user of the compiled kernels.

        Parameters
        ----------
        trail : int
            Steps within one call of an integrator whose states and rates are kept, ``trail`` and ``trail_rate``
            (n_trail, n_state).
        """
        self.require_built()
        n_b, nf, n_u = len(self.bodies), self._max_elastic, self.n_u
        shapes: dict[str, tuple[int, ...]] = dict.fromkeys(Work._fields, (3,))
        shapes |= dict.fromkeys(("r", "v", "omega", "bias_lin", "bias_ang", "first_moment"), (n_b, 3))
        shapes |= dict.fromkeys(("turn_rot", "tangent", "joint_rot", "child_rot", "inertia_rate"), (3, 3))
        shapes |= dict.fromkeys(("rot", "inertia"), (n_b, 3, 3))
        shapes |= dict.fromkeys(("vl", "va"), (n_b, 3, n_u))
        shapes |= dict.fromkeys(("joint_vl", "joint_va"), (3, n_u))
        shapes |= dict.fromkeys(("coupling_lin", "coupling_ang"), (n_b, 3, nf))
        shapes |= {"coupling_slope": (nf, nf, 3), "elastic_mass": (n_b, nf, nf)}
        shapes |= {"reach": (self._max_complete,) * 3}
        shapes |= dict.fromkeys(("bias_force", "loads"), (n_b, 6 + nf))
        shapes |= dict.fromkeys(("predictor", "corrector", "rate"), (self.n_state,))
        shapes |= dict.fromkeys(("trail", "trail_rate"), (trail, self.n_state))
        n_c = self.n_constraints
        shapes |= dict.fromkeys(("frame_r", "frame_v", "frame_w", "frame_bl", "frame_ba"), (2, 3))
        shapes |= {"frame_rot": (2, 3, 3), "frame_jl": (2, 3, n_u), "frame_ja": (2, 3, n_u), "schur": (n_c, n_c)}
        shapes |= dict.fromkeys(("jacobian", "half_jacobian"), (n_c, n_u))
        shapes |= dict.fromkeys(("gamma", "residual", "residual_rate", "multipliers", "weight"), (n_c,))
        shapes |= {"drift": (3,)}
        shapes |= {"marker_shape": (3, nf), "mass": (n_u, n_u), "force": (n_u,), "servo_acceleration": (self.n_servo,)}
        return Work(**{key: np.zeros(shapes[key]) for key in Work._fields})

    def new_inputs(self) -> Inputs:
        """Inputs at the start [0] and the end [1] of an interval, all zero."""
        self.require_built()
        n_b, nf, n_u, n_s = len(self.bodies), self._max_elastic, self.n_u, self.n_servo
        z = np.zeros
        return Inputs(z((2, n_b, 6 + nf)), *(z((2, n_u)) for _ in range(3)), *(z((2, n_s)) for _ in range(3)))

    # ---- evaluation (convenience around the kernels, one state at a time) ------------------------------------------

    def balance(self, y: Array, inputs: Inputs, work: Work) -> tuple[Array, Array]:
        """Mass matrix (n_u, n_u) and forces (n_u,) of M u̇ = f for a state and the inputs at the start of an interval.

        Views of ``work``, of the matrix its lower triangle; without constraint forces. The arguments are not checked.
        """
        rate_kernels.force_balance(y, inputs, self.tree, work, np.zeros(self.n_state))
        return work.mass, work.force

    def rates(self, y: ArrayLike, inputs: Inputs | None = None, work: Work | None = None) -> Array:
        """dy/dt (n_state,) for a state and the inputs at the start of their interval.

        Raises
        ------
        MultibodyError
            When the system is not built, the state has no meaning (length, finite numbers, unit quaternions), the mass
            matrix is singular or constraints depend on each other.
        """
        self.require_built()
        history = new_history(self.n_state)
        history.y[3] = check_state(self, y)
        arguments = (
            history, inputs or self.new_inputs(), self.tree, work or self.new_work(), 0.0, 0, 0, self.constrained, True,
        )  # fmt: skip
        if self._compiled_rates is None:
            self._compiled_rates = compiled_for(integrator_kernels.hamming_advance, arguments)
        code = self._compiled_rates(*arguments)
        if code != tree_kernels.OK:
            raise MultibodyError(FAILURES[code])
        return cast("Array", history.f[3])

    def constraint_residuals(self, y: ArrayLike) -> tuple[Array, Array]:
        """Residuals φ and φ̇ (n_constraints,) of the constraint equations for a state [m, rad; m/s, rad/s]."""
        work = self.new_work()
        self.rates(y, work=work)
        return work.residual, work.residual_rate

    def project(self, y: Array, inputs: Inputs | None = None, passes: int = 2) -> None:
        """Move a state onto the constraint equations φ = 0, φ̇ = 0, by the smallest change; y changes in place.

        Parameters
        ----------
        y : array (n_state,)
            Close to the constraints.
        inputs : Inputs, optional
            Of the commands of the servos only their acceleration matters.
        passes : int
            Newton steps, each of which squares the error.
        """
        work, change, shift = self.new_work(), np.zeros(self.n_state), np.zeros(self.n_state)
        for _ in range(passes if self.constraints else 0):
            self.rates(y, inputs, work)
            rate_kernels.project(y, self.tree, work, change, shift)
            for first, _ in self.quaternions:
                y[first : first + 4] /= np.linalg.norm(y[first : first + 4])

    def place_free_bodies(self, y: Array) -> None:
        """Put every free body that a weld ties to an earlier one in its place, with its velocity; y changes in place.

        Needs the other coordinates and the servo states of y. Bodies are placed in the order of their constraints.
        """
        for c, (constraint, (_, second, _, marker)) in enumerate(zip(self.constraints, self._tied, strict=True)):
            if constraint.kind != "weld" or second < 0 or marker is None or self.joints[second].kind != "free":
                continue
            moved = np.abs(marker.linear).max(initial=0.0) + np.abs(marker.rotation).max(initial=0.0)
            if moved > 0.0 or constraint.second_rotation is not None or np.any(constraint.second_offset):
                raise MultibodyError(f"constraint {constraint.name!r}: only a body tied at its own frame can be placed")
            work = self.new_work()
            self.rates(y, work=work)
            yd = y[self.n_q : self.n_q + self.n_u]
            constraint_kernels.constraint_frame(c, 0, y, yd, self.tree, work)
            if self._constraint_servo[c] >= 0:
                constraint_kernels.turn_by_servo(c, y, self.tree, work)
            q, u = self._index[second]["joint_q"], self.n_q + self._index[second]["joint_u"]
            rotation = work.frame_rot[0]
            y[q : q + 3] = work.frame_r[0] - rotation @ marker.position
            y[q + 3 : q + 7] = Rotation.from_matrix(rotation).as_quat()[[3, 0, 1, 2]]  # scalar first
            y[u + 3 : u + 6] = rotation.T @ work.frame_w[0]
            y[u : u + 3] = work.frame_v[0] - np.cross(work.frame_w[0], rotation @ marker.position)

    def energy(self, y: ArrayLike) -> tuple[float, float, float]:
        """Kinetic, elastic and gravitational energy [J]."""
        self.require_built()
        energies = output_kernels.energies(check_state(self, y), self.tree, self.new_work())
        return cast("tuple[float, float, float]", energies)


def _across(axis: Array) -> Array:
    """Two unit vectors (2, 3) across an axis and each other."""
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(axis, first)])


def _joint_names(name: str, kind: str, count: int) -> list[str]:
    if kind == "cardan":
        return [f"{name}_{motion}" for motion in MOTIONS]
    return [name] if count == 1 else [f"{name}_{i}" for i in range(count)]


_JOINTS = {  # code in the kernels, positions, velocities
    "fixed": (tree_kernels.FIXED, 0, 0),
    "revolute": (tree_kernels.REVOLUTE, 1, 1),
    "prismatic": (tree_kernels.PRISMATIC, 1, 1),
    "spherical": (tree_kernels.SPHERICAL, 4, 3),
    "free": (tree_kernels.FREE, 7, 6),
    "servo": (tree_kernels.SERVO, 0, 0),
    "cardan": (tree_kernels.CARDAN, 6, 6),
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
        "fixed", "revolute", "prismatic", "spherical", "free", "servo": a rotation driven by a second-order servo that
        follows a command, θ̈ = ω² (θ_c − θ) − 2 ζ ω θ̇, or "cardan": three displacements along the axes of the joint
        frame, then roll, pitch and yaw with R = R_z R_y R_x, singular at a pitch of 90°.
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
    def rotor_tensors(self) -> tuple[Array, Array, float]:
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


def check_state(system: MultibodySystem, y: ArrayLike) -> Array:
    """A state as a vector (n_state,) of finite numbers with unit quaternions.

    Parameters
    ----------
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
    state = np.ascontiguousarray(numbers("state", "y", y))
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


def check_residuals(system: MultibodySystem, residual: Array, residual_rate: Array) -> None:
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
