"""Flexible multibody systems of tree topology, assembled from bodies and joints.

``MultibodySystem`` collects bodies, each hung by a joint on a marker of an earlier body (or on the ground), and packs
them into plain arrays for the compiled equations of motion in :mod:`wt_gym.multibody.tree_kernels`.
"""

from collections import namedtuple
from dataclasses import dataclass

import numpy as np

from wt_gym.multibody import integrator_kernels, tree_kernels
from wt_gym.structure.flexible_body import FlexibleBody, Marker

__all__ = ["HammingIntegrator", "Joint", "MultibodyError", "MultibodySystem", "Points"]

from wt_gym.errors import WtGymError

_KINDS = {"fixed": 0, "revolute": 1, "prismatic": 2, "spherical": 3, "free": 4, "servo": 5}
_N_POSITION = (0, 1, 1, 4, 7, 0)
_N_VELOCITY = (0, 1, 1, 3, 6, 0)

TREE_FIELDS = (
    "parent kind axis joint_rotation joint_offset marker_position marker_linear marker_second marker_rotation "
    "n_elastic joint_q joint_u elastic_q elastic_u servo mass c0 c1 c2 j0 j1 j2 d0 d1 m0 m1 stiffness damping "
    "cols n_col dof_stiffness dof_damping dof_q servo_frequency servo_damping gravity n_q n_u n_servo"
)
WORK_FIELDS = (
    "rot r v omega vl va bias_lin bias_ang nl na nb_lin nb_ang nv wn wb x xd xb th thd lever rn ti rj rb s_eff mc jj "
    "jd cc dk cd dd h a al c1 c2 mass force loads servo_acceleration predictor corrector rate"
)
Tree = namedtuple("Tree", TREE_FIELDS)
Work = namedtuple("Work", WORK_FIELDS)
Inputs = namedtuple("Inputs", "body_loads dof_force reference reference_rate servo_command")
HammingHistory = namedtuple("HammingHistory", "y f error filled")
Points = namedtuple("Points", "position linear second")


class MultibodyError(WtGymError, ValueError):
    """A system of bodies and joints that cannot be built or integrated."""


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
        Spring [N m/rad or N/m] and damper about the reference given as an input (revolute and prismatic).
    servo_frequency, servo_damping : float
        ω [rad/s] and ζ of a servo.
    name : str
        Name of the coordinate(s).
    """

    kind: str = "fixed"
    axis: tuple = (0.0, 0.0, 1.0)
    rotation: np.ndarray | None = None
    offset: tuple = (0.0, 0.0, 0.0)
    stiffness: float = 0.0
    damping: float = 0.0
    servo_frequency: float = 0.0
    servo_damping: float = 1.0
    name: str = ""

    def __post_init__(self):
        if self.kind not in _KINDS:
            raise MultibodyError(f"joint kind {self.kind!r} is unknown; allowed: {', '.join(_KINDS)}")
        if self.kind == "servo" and not self.servo_frequency > 0.0:
            raise MultibodyError(f"servo joint {self.name!r} needs servo_frequency > 0, got {self.servo_frequency}")
        if self.kind in ("revolute", "prismatic", "servo") and not np.isclose(
            np.linalg.norm(self.axis), 1.0, atol=1e-9
        ):
            raise MultibodyError(f"joint {self.name!r}: axis {tuple(self.axis)} is not a unit vector")


class MultibodySystem:
    """A tree of rigid and flexible bodies.

    Parameters
    ----------
    gravity : array (3,)
        [m/s²], default (0, 0, −9.81).

    Examples
    --------
    >>> system = MultibodySystem()
    >>> bob = FlexibleBody.rigid("bob", 1.0, (0.0, 0.0, -1.0), np.zeros((3, 3)))
    >>> system.add(bob, Joint("revolute", axis=(0.0, 1.0, 0.0), name="swing"))
    0
    >>> system.build().n_u
    1
    """

    def __init__(self, gravity=(0.0, 0.0, -9.81)):
        self.gravity = np.asarray(gravity, dtype=float)
        self.bodies: list[FlexibleBody] = []
        self.joints: list[Joint] = []
        self.parents: list[int] = []
        self._markers: list[Marker | None] = []
        self.tree = None

    def add(self, body, joint, parent=None, marker="origin"):
        """Add a body; returns its index.

        Parameters
        ----------
        body : FlexibleBody
        joint : Joint
        parent : int, optional
            Index of an earlier body; None hangs the joint on the ground (position = joint.offset).
        marker : str
            Marker of the parent that carries the joint.

        Raises
        ------
        MultibodyError
            For an unknown parent or marker.
        """
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
            self._markers.append(markers[marker])
        self.bodies.append(body)
        self.joints.append(joint)
        self.parents.append(-1 if parent is None else parent)
        return len(self.bodies) - 1

    def build(self):
        """Pack everything into arrays; returns self."""
        if not self.bodies:
            raise MultibodyError("a multibody system needs at least one body")
        self._number_coordinates()
        self.tree = Tree(**self._topology(), **self._joint_arrays(), **self._body_arrays())
        return self

    # ---- coordinates -----------------------------------------------------------------------------------------------

    def _number_coordinates(self):
        """Positions, velocities and servo states: joint first, then elastic coordinates, body by body."""
        n_q = n_u = n_servo = 0
        self._index = []
        self.coordinate_names, self.velocity_names = [], []
        for body, joint in zip(self.bodies, self.joints, strict=True):
            kind = _KINDS[joint.kind]
            entry = {"joint_q": n_q, "joint_u": n_u, "servo": n_servo}
            name = joint.name or f"{body.name}_joint"
            self.coordinate_names += _joint_names(name, _N_POSITION[kind])
            self.velocity_names += _joint_names(name, _N_VELOCITY[kind])
            n_q, n_u = n_q + _N_POSITION[kind], n_u + _N_VELOCITY[kind]
            n_servo += joint.kind == "servo"
            entry |= {"elastic_q": n_q, "elastic_u": n_u}
            self.coordinate_names += body.coordinate_names
            self.velocity_names += body.coordinate_names
            n_q, n_u = n_q + body.n_elastic, n_u + body.n_elastic
            self._index.append(entry)
        self.n_q, self.n_u, self.n_servo = n_q, n_u, n_servo
        if n_u == 0:
            raise MultibodyError("the system has no degree of freedom")

    @property
    def n_state(self):
        """Length of the state vector [positions, velocities, servo angles, servo rates]."""
        return self.n_q + self.n_u + 2 * self.n_servo

    @property
    def state_names(self):
        """Names of the entries of the state vector."""
        servo = [j.name or f"servo_{i}" for i, j in enumerate(self.joints) if j.kind == "servo"]
        rate = [f"{n}_rate" for n in self.velocity_names]
        return [*self.coordinate_names, *rate, *servo, *(f"{n}_rate" for n in servo)]

    def index(self, body, what):
        """Index of the first "joint_q", "joint_u", "elastic_q", "elastic_u" or "servo" entry of a body."""
        return self._index[body][what]

    def initial_state(self):
        """State (n_state,) at rest with all coordinates zero and unit quaternions."""
        y = np.zeros(self.n_state)
        for entry, joint in zip(self._index, self.joints, strict=True):
            if joint.kind == "spherical":
                y[entry["joint_q"]] = 1.0
            elif joint.kind == "free":
                y[entry["joint_q"] + 3] = 1.0
        return y

    # ---- packing ---------------------------------------------------------------------------------------------------

    def _topology(self):
        n_b = len(self.bodies)
        cols, n_col = np.zeros((n_b, self.n_u), dtype=np.int64), np.zeros(n_b, dtype=np.int64)
        inherited = []
        for b in range(n_b):
            p, entry = self.parents[b], self._index[b]
            chain = []
            if p >= 0:
                first = self._index[p]["elastic_u"]
                chain = inherited[p] + list(range(first, first + self.bodies[p].n_elastic))
            chain = chain + list(range(entry["joint_u"], entry["joint_u"] + _N_VELOCITY[_KINDS[self.joints[b].kind]]))
            inherited.append(chain)
            n_col[b] = len(chain)
            cols[b, : len(chain)] = chain
        index = {key: np.array([e[key] for e in self._index]) for key in self._index[0]}
        return {
            "parent": np.array(self.parents),
            "kind": np.array([_KINDS[j.kind] for j in self.joints]),
            "n_elastic": np.array([b.n_elastic for b in self.bodies]),
            "cols": cols,
            "n_col": n_col,
            "n_q": self.n_q,
            "n_u": self.n_u,
            "n_servo": self.n_servo,
            "gravity": self.gravity,
            **index,
        }

    def _joint_arrays(self):
        n_b = len(self.bodies)
        nf = self._max_elastic
        out = {
            "axis": np.array([j.axis for j in self.joints], dtype=float),
            "joint_rotation": np.array(
                [np.eye(3) if j.rotation is None else j.rotation for j in self.joints], dtype=float
            ),
            "joint_offset": np.array([j.offset for j in self.joints], dtype=float),
            "marker_position": np.zeros((n_b, 3)),
            "marker_linear": np.zeros((n_b, 3, nf)),
            "marker_second": np.zeros((n_b, 3, nf, nf)),
            "marker_rotation": np.zeros((n_b, 3, nf)),
            "dof_stiffness": np.zeros(self.n_u),
            "dof_damping": np.zeros(self.n_u),
            "dof_q": np.full(self.n_u, -1),
            "servo_frequency": np.array([j.servo_frequency for j in self.joints if j.kind == "servo"], dtype=float),
            "servo_damping": np.array([j.servo_damping for j in self.joints if j.kind == "servo"], dtype=float),
        }
        for b, (marker, joint, entry) in enumerate(zip(self._markers, self.joints, self._index, strict=True)):
            if marker is not None:
                n = marker.linear.shape[1]
                out["marker_position"][b] = marker.position
                out["marker_linear"][b, :, :n] = marker.linear
                out["marker_second"][b, :, :n, :n] = marker.second
                out["marker_rotation"][b, :, :n] = marker.rotation
            u, q = entry["joint_u"], entry["joint_q"]
            n_slide = {"revolute": 1, "prismatic": 1, "free": 3}.get(joint.kind, 0)
            out["dof_q"][u : u + n_slide] = np.arange(q, q + n_slide)
            if joint.kind in ("revolute", "prismatic"):
                out["dof_stiffness"][u], out["dof_damping"][u] = joint.stiffness, joint.damping
            n = self.bodies[b].n_elastic
            out["dof_q"][entry["elastic_u"] : entry["elastic_u"] + n] = entry["elastic_q"] + np.arange(n)
        return out

    @property
    def _max_elastic(self):
        return max(1, *(b.n_elastic for b in self.bodies))

    def _body_arrays(self):
        n_b, nf = len(self.bodies), self._max_elastic
        shapes = {
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
        }
        out = {key: np.zeros((n_b, *shape)) for key, shape in shapes.items()}
        out["mass"] = np.array([b.inertia.mass for b in self.bodies])
        out["stiffness"], out["damping"] = np.zeros((n_b, nf, nf)), np.zeros((n_b, nf, nf))
        for b, body in enumerate(self.bodies):
            for key in shapes:
                value = getattr(body.inertia, key)
                out[key][(b, *(slice(0, n) for n in value.shape))] = value
            n = body.n_elastic
            out["stiffness"][b, :n, :n], out["damping"][b, :n, :n] = body.stiffness, body.damping
        return out

    def new_work(self):
        """Scratch arrays for one user of the compiled kernels."""
        n_b, nf, n_u = len(self.bodies), self._max_elastic, self.n_u
        shapes = dict.fromkeys(WORK_FIELDS.split(), (3,))
        shapes |= dict.fromkeys(("r", "v", "omega", "bias_lin", "bias_ang", "mc"), (n_b, 3))
        shapes |= dict.fromkeys(("rn", "ti", "rj", "rb", "jd"), (3, 3))
        shapes |= dict.fromkeys(("rot", "jj"), (n_b, 3, 3))
        shapes |= dict.fromkeys(("vl", "va"), (n_b, 3, n_u))
        shapes |= dict.fromkeys(("nl", "na"), (3, n_u))
        shapes |= dict.fromkeys(("cc", "dk"), (n_b, 3, nf))
        shapes |= dict.fromkeys(("h", "loads"), (n_b, 6 + nf))
        shapes |= dict.fromkeys(("predictor", "corrector", "rate"), (self.n_state,))
        shapes |= {"s_eff": (3, nf), "mass": (n_u, n_u), "force": (n_u,), "servo_acceleration": (self.n_servo,)}
        return Work(**{key: np.zeros(shapes[key]) for key in WORK_FIELDS.split()})

    def new_inputs(self):
        """Inputs at the start [0] and the end [1] of an interval, all zero."""
        n_b, nf, n_u = len(self.bodies), self._max_elastic, self.n_u
        z = np.zeros
        return Inputs(z((2, n_b, 6 + nf)), z((2, n_u)), z((2, n_u)), z((2, n_u)), z((2, self.n_servo)))

    # ---- evaluation (convenience around the kernels, one state at a time) ------------------------------------------

    def rates(self, y, inputs=None, work=None):
        """dy/dt (n_state,) for a state and constant inputs.

        Raises
        ------
        MultibodyError
            When the mass matrix is not positive definite.
        """
        y, dy = np.ascontiguousarray(y, dtype=float), np.zeros(self.n_state)
        if not tree_kernels.rates(y, 0.0, inputs or self.new_inputs(), self.tree, work or self.new_work(), dy):
            raise MultibodyError("the mass matrix is not positive definite: a coordinate moves no mass")
        return dy

    def energy(self, y):
        """Kinetic, elastic and gravitational energy [J]."""
        return tree_kernels.energies(np.ascontiguousarray(y, dtype=float), self.tree, self.new_work())


def _joint_names(name, count):
    return [name] if count == 1 else [f"{name}_{i}" for i in range(count)]


class HammingIntegrator:
    """The modified Hamming scheme on a system, with its history.

    Parameters
    ----------
    system : MultibodySystem
    step : float
        Step length [s].
    n_corrections : int
        Corrector passes a step; three make the scheme usable on an undamped structure (up to ω h ≈ 1).
    """

    def __init__(self, system, step, n_corrections=3):
        if not step > 0.0:
            raise MultibodyError(f"integration step must be positive, got {step}")
        self.system, self.step, self.n_corrections = system, float(step), int(n_corrections)
        self.work, self.inputs = system.new_work(), system.new_inputs()
        n = system.n_state
        self.history = HammingHistory(np.zeros((4, n)), np.zeros((4, n)), np.zeros(n), np.zeros(1, dtype=np.int64))

    def start(self, y):
        """Begin at the state y; the starters run again."""
        self.history.y[3] = y
        self.history.error[:] = 0.0
        self.history.filled[0] = 0
        self.history.f[3] = self.system.rates(y, self.inputs, self.work)

    @property
    def state(self):
        """Current state (n_state,), a view."""
        return self.history.y[3]

    @property
    def state_rate(self):
        """Current dy/dt (n_state,), a view."""
        return self.history.f[3]

    def advance(self, n_steps=1):
        """Take n_steps with the inputs running linearly from ``inputs[…][0]`` to ``inputs[…][1]``.

        Raises
        ------
        MultibodyError
            When the mass matrix is singular or the state diverges.
        """
        code = integrator_kernels.hamming_advance(
            self.history, self.inputs, self.system.tree, self.work, self.step, int(n_steps), self.n_corrections
        )
        if code == integrator_kernels.SINGULAR:
            raise MultibodyError("the mass matrix is not positive definite: a coordinate moves no mass")
        if code == integrator_kernels.DIVERGED:
            raise MultibodyError(f"the integration diverged; the step {self.step} s may exceed the stability limit")
