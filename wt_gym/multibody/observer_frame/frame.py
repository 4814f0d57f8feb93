r"""Flexible multibody dynamics in local observer frames.

Each substructure is seen from a moving frame that is *not* a degree of freedom: the frame follows a prediction, and
the motion of the body relative to it, rigid-body modes included, is small and linear (eq. 2). Masses and stiffnesses
are constant; only the known rotation of the frame enters the coefficients. (K. Holm-Jørgensen, S. R. K. Nielsen,
R. Rubak, System reduction in nonlinear multibody dynamics of wind turbines; after A. Kawamoto, M. Inagaki, T. Aoyama,
K. Yasuda, DETC99/VIB-8232, 1999. Equation numbers are those of the first paper.)

Derivation
----------
In frame axes, with v_c and ω of the frame, the velocity of the material point s is (eq. 3)

    v = v_c + ω̃ (s + N q) + N q̇.

From T = ½ ∫ v·v dm, using ω̃ᵀ = −ω̃,

    ∂T/∂q̇ = M₀ᵀ v_c + J₀ᵀ + G q + M q̇
    ∂T/∂q  = −M₀ᵀ ω̃ v_c + J₂ᵀ − D q − G q̇

with M = ∫NᵀN, M₀ = ∫N, D = ∫Nᵀω̃ω̃N (eq. 7), G = ∫Nᵀω̃N, J₀ = ωᵀ∫s̃N, J₂ = ωᵀ∫s̃ω̃N (eq. 8; integrals over dm). The
time derivative of the first brings Ġ q + G q̇, J̇₀ᵀ and M₀ᵀ v̇_c; with a_c = v̇_c + ω̃ v_c Lagrange's equations are

    M q̈ + 2 G q̇ + (K + Ġ + D) q + Bᵀ λ = −M₀ᵀ a_c − J̇₀ᵀ + J₂ᵀ + Q_c + Q_nc,      B q + b = 0          (eqs 5, 6)

where the rate-of-rotation matrix Ġ = ∫Nᵀα̃N and J̇₀ = αᵀ∫s̃N carry the angular acceleration α of the frame, and
J₂ᵀ − J̇₀ᵀ = −∫Nᵀ(α̃ + ω̃ω̃)s. Gravity enters as a_c − g. The total apparent inertia operator is α̃ + ω̃ω̃ + 2ω̃ d/dt + d²/dt².

The strain energy ½ qᵀK q knows no geometric stiffness: rotation softens by D but centrifugal tension stiffens nothing.
A beam clamped at the axis of rotation keeps its flap frequency ω₀ and has the lag frequency √(ω₀² − Ω²).

Second-order displacement
-------------------------
What is missing is a matter of eq. (2), and not of the frame. A beam that is inextensible and bends by w is shorter,
along its axis, by ½ ∫ w'² ds, and the axial force N works on that. With

    u = N q + ½ qᵀ H q                                                                                 (eq. 2, extended)

for all points (`displacement="second_order"` of a `Substructure`; H as in :mod:`wt_gym.structure.beam`) the virtual
displacement is (N + H q)ᵀ δq, and every force f that acts on the body, inertia, weight, loads and what other bodies
exert on its markers, adds −f · H to the stiffness:

    K_g = Σ ∫ H_k [a_c − g + ü_r + (α̃ + φ̈~ + ω̃ω̃) s]_k + Σ H_k(marker) λ_k.

For a straight blade that turns about its root H_z(r) = −∫₀ʳ N'ᵀN' dσ, and by parts K_g = Ω² ∫ m r ∫₀ʳ N'ᵀN' dσ dr =
∫ F N'ᵀN' dr with the centrifugal force F(r) = Ω² ∫ᵣ m σ dσ: the geometric stiffness of the axial force, of the weight
on a tower's top (P-Δ) likewise. It is that of the floating frame (:mod:`wt_gym.structure.flexible_body`).

As with the rotation modes below, the shapes are renewed in each step. The body is linear about the known q = q_d,

    N → N + H q_d,    s → s − ½ q_dᵀ H q_d,

in M₀, J₀, J₂, X and in what couples elastic and rigid-body coordinates; the elastic mass matrix becomes ∫NᵀN + (P + Pᵀ)
q_d with P_ijm = ∫ N_i · H_jm; G and D of elastic coordinates among themselves stay (kinetic energy of second order in
q, of third where two of them are rates, as in the floating frame). In the matrix of the step K_g is the tangent, with
accelerations and reactions of the last instant; the balance at the end of the step, with shapes renewed, needs none.
The velocities H(Δq) q̇ that change their name with the shapes are taken out of q̇ like those of the rotation modes, and
with them the Coriolis force 2 ω̃ H(Δq) q̇ on the rigid-body coordinates is made up for, without which a rotor would lose
the power h q̇ᵀ K_g q̇. The shortening of the lever is in the inertia: ∫ y yᵀ with y = s + N q + ½ qᵀ H q.

Constraints
-----------
Point constraints hold d·(x_a − x_b) = 0 along fixed directions d (eqs 13, 15). Rotation constraints are written with
section-fixed vectors, (S_a p)·(S_b r) = 0, S = R exp(φ̃): the linear form (14) follows for small φ, but finite rotations
of the frames against each other accumulate no error. Each is linearized about the last known q, so that a step stays
linear in the unknowns. Bearings hold points in the fixed frame, which coincides with (15) when the frame of the shaft
turns about its axis only.

Frames
------
Over a step the frame moves uniformly (``prediction="uniform"``, a_c = α = 0), or with the mean acceleration since its
last update, constant in fixed axes, and the mean α, constant in frame axes (``"accelerated"``). At the end of the step
the frame is moved onto the rigid-body motion (eqs 9–12, with ω_s turned into the new axes), either every step or when
the rigid-body displacement exceeds a threshold; then q_r = 0. Rotations count towards the threshold with the largest
distance that any body has from its origin: a shaft that turns about its own axis is updated with the blade it carries.
The main error of rare updates is linear in the rotation φ from the frame: D gives a body with the moment of inertia J
the moment J ω² φ, since its points move along the tangents of the undeformed place.

``"printed"`` takes equations (9)–(12) literally: θ_s is a sum of rotation vectors, ω_s is not turned, and a_s and α_s
contain ü and φ̈ of the last instant. That feeds the step-to-step oscillation of the accelerations of stiff modes back
into the frame: fine for a reduced model and for slow rotation, unstable for finite elements at 1.6 rad/s.

The rotation modes of eq. (2) turn the body about the frame origin. With ``rigid_modes="undeformed"`` they are e_k × s
throughout and M, K, M₀ are constant; inertia forces, weight and (unless eq. (4) adds a moment) loads then act on the
undeformed lever s, so that a deflection u under an axial force N leaves a moment N u unbalanced. Over long
rotating runs that pumps energy. With ``"deformed"`` (default) the modes are e_k × (s + N_f q_f), renewed each step:
three rows and columns of the same matrices change, moments act where the body is, the angular momentum balances, and
for frequent updates the method becomes the floating frame with linear deformations. φ × u̇_f + φ̇ × Δu_f, the
velocities that change their name in an update, are taken out of q̇ in the mean weighted with the mass.

Time stepping
-------------
Newmark with (β, γ) = (¼, ½) on eq. (6) at the end of the step; loads and constraint directions from the last known q,
renewed by optional iterations (the matrices do not change in an iteration). With a spectral radius the step is that of
the generalized-α scheme (J. Chung, G. M. Hulbert, J. Appl. Mech. 60, 1993) in the form of M. Arnold and O. Brüls
(Multibody Syst. Dyn. 18, 2007): eq. (6) still holds at the end of the step, and Newmark's formulas carry q and q̇ on
with

    (1 − αm) a₊ + αm a = (1 − αf) q̈₊ + αf q̈

in the place of q̈. What is kept from step to step is the lead a − q̈, in which the acceleration of the frame cancels:
it means the same before and after an update, except for the small turn of the axes, of higher order. The trapezoidal
rule on constrained coordinates lets errors of multipliers grow; after each step velocities are therefore projected on
Φ̇ = 0 (in the metric of M), and accelerations and multipliers recomputed from eq. (6) with Φ̈ = 0. Tangential to the
constraints this changes nothing. Rigid and small motions are of second order in the step; the lag of one step in the
deformed rotation modes and in loads that depend on q is of first order with a small factor.

Loads
-----
A load is given in the fixed frame, or in the moving frame and applied at the undeformed place, or in the deformed state

    p = R′p′,    m = u × p + R′m′,    R′ = 1 + φ̃                                                       (eq. 4).

The moment u × p refers p to the undeformed axis. As a couple at the loaded section (``"deformed"``) it gives every
section σ the moment (s + u − σ) × p: right at the root, too much by u(σ) × p near the load. Where the beam is soft the
couple turns the section, the turned force has a longer lever, and above some load no state of rest exists.
``"consistent"`` acts in the deformed state for every section, (s + u − σ − u(σ)) × p. By parts, and for an
inextensible axis, that is the virtual work of p on the second-order displacement ½ qᵀ H q of its point, the field that
gives the floating frame its geometric stiffness: Q = (N + H q)ᵀ p. ``"turned"`` is p = R′p′ alone, Q = Nᵀ p.

None of them shortens the lever of p itself, (s − σ), by the deflection, so that none is exact to second order; and
since u and φ are relative to the frame, the result depends on the reference condition when deflections are large.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from wt_gym.base.quantities import Array
from wt_gym.multibody.integrators.schemes import NEWMARK
from wt_gym.multibody.observer_frame import observer_frame_constraint_kernels as constraint
from wt_gym.multibody.observer_frame import observer_frame_matrix_kernels as matrix
from wt_gym.multibody.observer_frame.observer_frame_body import Model, ObserverFrameError, State, Substructure, Work
from wt_gym.multibody.observer_frame.observer_frame_kernels import renew

LOAD_AXES = {"fixed": constraint.FIXED, "undeformed": constraint.UNDEFORMED, "deformed": constraint.DEFORMED}
LOAD_AXES |= {"turned": constraint.TURNED, "consistent": constraint.CONSISTENT}
RIGID_MODES = ("deformed", "undeformed")
_ACROSS = ((0, 1), (1, 2), (2, 0))
"""Axes of the first and the second section that stay across each other."""
Three = tuple[float, float, float]
Course = Callable[[float], Three]
"""Three numbers as functions of time [s]."""


@dataclass(frozen=True)
class _Row:
    """One scalar constraint: kind, markers (indices, −1 the ground) and the two vectors of the kernel.

    A drive (index, −1: none) turns the second vector about an axis of the second section; a spring (index) acts between
    the two vectors about this axis.
    """

    kind: int
    markers: tuple[int, int]
    vectors: tuple[Array, Array]
    connection: str
    drive: int = -1
    axis: ArrayLike = (0.0, 0.0, 0.0)
    spring: int = -1


@dataclass
class Drive:
    """What turns a section against another about an axis.

    Attributes
    ----------
    motion : callable or None
        Angle [rad], rate [rad/s] and acceleration [rad/s²] as functions of time [s]; None keeps the angle zero.
    """

    name: str
    motion: Course | None = None

    def at(self, time: float) -> Three:
        """Angle, rate and acceleration."""
        return (0.0, 0.0, 0.0) if self.motion is None else self.motion(time)


@dataclass
class Spring:
    """Spring, damper, drive torque and inertia of a hinge: k (θ_r − θ) + c (θ̇_r − θ̇) + τ − I θ̈ on its first section.

    Attributes
    ----------
    stiffness, damping : float
        k [N m/rad] and c [N m s/rad].
    acting : callable or None
        θ_r [rad], θ̇_r [rad/s] and τ [N m] as functions of time [s]; None: all zero.
    angle : float
        θ at the start [rad]; it continues from there through whole turns.
    inertia : float
        I [kg m²], of either sign: what a rotor that gears couple to the hinge adds to the inertia of the sections.
    """

    name: str
    stiffness: float
    damping: float
    acting: Course | None = None
    angle: float = 0.0
    inertia: float = 0.0

    def at(self, time: float) -> Three:
        """References of angle and rate, and torque."""
        return (0.0, 0.0, 0.0) if self.acting is None else self.acting(time)


class ObserverFrameSystem:
    """Substructures in local observer frames, their connections and loads.

    Parameters
    ----------
    gravity : array (3,)
        [m/s²], default none.
    rigid_modes : str
        "deformed": rotations turn the body as it is deformed; "undeformed": constant matrices throughout.

    Examples
    --------
    >>> from wt_gym.structure.beam import Beam, BeamSections
    >>> beam = Beam(BeamSections.uniform(2.0, EA=1e7, EIx=1e4, EIy=1e4, GJ=1e4, mass=5.0, Ix=0.1, Iy=0.1), 4)
    >>> system = ObserverFrameSystem(gravity=(0.0, 0.0, -9.80665))
    >>> system.add(Substructure.from_beam("arm", beam, n_modes=4))
    0
    >>> system.hinge("arm", "root", axis=(0.0, 1.0, 0.0))
    >>> from wt_gym.multibody.observer_frame.observer_frame_integrator import ObserverFrameIntegrator
    >>> integrator = ObserverFrameIntegrator(system, step=0.001)
    >>> integrator.advance(10)
    """

    def __init__(self, gravity: ArrayLike = (0.0, 0.0, 0.0), rigid_modes: str = "deformed") -> None:
        if rigid_modes not in RIGID_MODES:
            raise ObserverFrameError(f"rigid_modes must be one of {', '.join(RIGID_MODES)}, got {rigid_modes!r}")
        self.gravity: Array = np.asarray(gravity, dtype=float)
        self.rigid_modes = rigid_modes
        self.bodies: list[Substructure] = []
        self.frames: list[tuple[Array, Array]] = []
        self.motions: list[tuple[Array, Array, Array, Array]] = []
        self.loads: list[tuple[int, ArrayLike | Callable[[float], ArrayLike], str]] = []
        self.drives: list[Drive] = []
        self.springs: list[Spring] = []
        self._rows: list[_Row] = []
        self._markers: list[tuple[int, str]] = []

    # ---- assembly --------------------------------------------------------------------------------------------------

    def add(
        self,
        body: Substructure,
        position: ArrayLike = (0.0, 0.0, 0.0),
        rotation: ArrayLike | None = None,
        velocity: ArrayLike = (0.0, 0.0, 0.0),
        angular_velocity: ArrayLike = (0.0, 0.0, 0.0),
        coordinates: ArrayLike | None = None,
        rates: ArrayLike | None = None,
    ) -> int:
        """Add a substructure with the initial place and motion of its frame; returns its index.

        Parameters
        ----------
        position, velocity, angular_velocity : array (3,)
            Of the frame origin, fixed axes [m, m/s, rad/s].
        rotation : array (3, 3), optional
            Frame to fixed axes, default the identity.
        coordinates, rates : array (n,), optional
            Initial q = [q_f, q_r] and q̇, default zero.

        Raises
        ------
        ObserverFrameError
            When the name is taken, the rotation is none or coordinates have the wrong length.
        """
        if any(body.name == b.name for b in self.bodies):
            raise ObserverFrameError(f"a substructure named {body.name!r} exists already")
        r: Array = np.eye(3) if rotation is None else np.asarray(rotation, dtype=float)
        if r.shape != (3, 3) or np.abs(r.T @ r - np.eye(3)).max() > 1e-9 or np.linalg.det(r) < 0.0:
            raise ObserverFrameError(f"substructure {body.name!r}: the rotation is not a proper rotation matrix (3, 3)")
        relative: list[Array] = []
        for what, given in (("coordinates", coordinates), ("rates", rates)):
            value = np.zeros(body.n) if given is None else np.asarray(given, dtype=float)
            if value.shape != (body.n,):
                raise ObserverFrameError(
                    f"substructure {body.name!r}: {what} have shape {value.shape}, expected ({body.n},)"
                )
            relative.append(value)
        self.bodies.append(body)
        self.frames.append((np.asarray(position, dtype=float), r))
        spin = r.T @ np.asarray(angular_velocity, dtype=float)
        self.motions.append((np.asarray(velocity, dtype=float), spin, relative[0], relative[1]))
        return len(self.bodies) - 1

    def weld(self, body: str, marker: str, other: str, other_marker: str) -> None:
        """Join two markers in displacement and rotation (eqs 13, 14), in the relative orientation they have now."""
        self.join(body, marker, other, other_marker)
        # rows of S are the fixed axes seen from the section: vectors that coincide now
        mine, yours = (self._displaced(self._index(b), m)[1] for b, m in ((body, marker), (other, other_marker)))
        self._orthogonal(body, marker, other, other_marker, [(mine[i], yours[j]) for i, j in _ACROSS], "weld")

    def join(self, body: str, marker: str, other: str, other_marker: str) -> None:
        """Join two markers in displacement only (a ball joint, eq. 13)."""
        a, b = self._marker(body, marker), self._marker(other, other_marker)
        name = f"{body}.{marker} to {other}.{other_marker}"
        for d in np.eye(3):
            self._rows.append(_Row(constraint.DISPLACEMENT, (a, b), (d, np.zeros(3)), name))

    def support(
        self, body: str, marker: str, directions: ArrayLike = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    ) -> None:
        """Hold a marker where it is along unit directions (n, 3) of the fixed frame (a bearing, eq. 15)."""
        a = self._marker(body, marker)
        index = self._index(body)
        position, rotation = self.frames[index]
        place = position + rotation @ self._displaced(index, marker)[0]
        for d in np.atleast_2d(np.asarray(directions, dtype=float)):
            if not np.isclose(np.linalg.norm(d), 1.0, atol=1e-9):
                raise ObserverFrameError(f"support of {body}.{marker}: direction {tuple(d)} is not a unit vector")
            self._rows.append(_Row(constraint.DISPLACEMENT, (a, -1), (d, place), f"support of {body}.{marker}"))

    def hinge(
        self, body: str, marker: str, axis: ArrayLike, other: str | None = None, other_marker: str | None = None
    ) -> None:
        """Hold a marker on the ground or on another marker and let its section turn about a unit axis only.

        Parameters
        ----------
        axis : array (3,)
            In the fixed frame, as things stand now; it stays with the second section.
        other, other_marker : str, optional
            The second section; None is the ground.
        """
        axis = np.asarray(axis, dtype=float)
        if axis.shape != (3,) or not np.isclose(np.linalg.norm(axis), 1.0, atol=1e-9):
            raise ObserverFrameError(f"hinge of {body}.{marker}: axis {tuple(axis)} is not a unit vector")
        yours = np.eye(3)
        if other is None or other_marker is None:
            self.support(body, marker)
        else:
            self.join(body, marker, other, other_marker)
            yours = self._displaced(self._index(other), other_marker)[1]
        mine = self._displaced(self._index(body), marker)[1]
        across = np.linalg.svd(axis[None])[2][1:]
        self._orthogonal(body, marker, other, other_marker, [(mine.T @ axis, yours.T @ t) for t in across], "hinge")

    def clamp(self, body: str, marker: str) -> None:
        """Hold a marker and its section fast."""
        self.support(body, marker)
        mine = self._displaced(self._index(body), marker)[1].T
        self._orthogonal(body, marker, None, None, [(mine[:, i], np.eye(3)[j]) for i, j in _ACROSS], "clamp")

    def turn(
        self,
        body: str,
        marker: str,
        other: str | None,
        other_marker: str | None,
        axis: ArrayLike,
        name: str,
        rotation: ArrayLike | None = None,
        motion: Course | None = None,
    ) -> None:
        """Join two markers in displacement, while a drive turns the first section against the second.

        Parameters
        ----------
        body, marker, other, other_marker : str
            The other body may be None, the ground.
        axis : array (3,)
            Unit axis in the second section, which stays with it.
        name : str
            Of the drive.
        rotation : array (3, 3), optional
            Orientation of the first section relative to the second at the angle zero; default the identity.
        motion : callable, optional
            See :class:`Drive`.
        """
        turned = np.eye(3) if rotation is None else np.asarray(rotation, dtype=float)
        if other is None or other_marker is None:
            self.support(body, marker)
        else:
            self.join(body, marker, other, other_marker)
        self.drives.append(Drive(name, motion))
        pairs = [(np.eye(3)[i], turned[:, j]) for i, j in _ACROSS]
        self._orthogonal(body, marker, other, other_marker, pairs, f"drive {name}", len(self.drives) - 1, axis)

    def spring(
        self,
        body: str,
        marker: str,
        other: str | None,
        other_marker: str | None,
        axis: ArrayLike,
        vectors: tuple[ArrayLike, ArrayLike],
        spring: Spring,
        drive: int = -1,
    ) -> None:
        """Let a torque act between two sections that are hinged about an axis.

        Parameters
        ----------
        body, marker, other, other_marker : str
            The torque acts on the first section, its reaction on the second; the other body may be None, the ground.
        axis : array (3,)
            Unit axis in the second section.
        vectors : (array (3,), array (3,))
            Across the axis, fixed in the first and in the second section; the angle is the one between them.
        drive : int
            Number of a drive that turns the second vector about the axis; −1: none.
        """
        self.springs.append(spring)
        pairs = [(np.asarray(vectors[0], dtype=float), np.asarray(vectors[1], dtype=float))]
        self._orthogonal(
            body, marker, other, other_marker, pairs, f"spring {spring.name}", drive, axis, len(self.springs) - 1
        )

    def load(
        self, body: str, marker: str, value: ArrayLike | Callable[[float], ArrayLike], axes: str = "fixed"
    ) -> None:
        """Apply a force and a moment at a marker.

        Parameters
        ----------
        value : array (6,) or callable
            Force [N] and moment [N m], constant or as a function of time [s].
        axes : str
            "fixed": components in the fixed frame; "undeformed": in the moving frame; the others in the axes of the
            deformed section: "deformed" with the moment u × p at the section (eq. 4 as printed), "consistent" with the
            lever of the deformed axis in every section, "turned" without a moment of the deflection.

        Raises
        ------
        ObserverFrameError
            For unknown axes, body or marker.
        """
        if axes not in LOAD_AXES:
            raise ObserverFrameError(f"load axes must be one of {', '.join(LOAD_AXES)}, got {axes!r}")
        if axes == "deformed" and self.bodies[self._index(body)].second_order is not None:
            raise ObserverFrameError(
                f"load on {body}.{marker}: 'deformed' adds the moment of the deflection to linear displacements; with "
                "'second_order' it is there already: 'consistent' or 'turned'"
            )
        if not callable(value) and np.shape(value) != (6,):
            raise ObserverFrameError(f"load on {body}.{marker}: expected force and moment (6,), got {np.shape(value)}")
        self.loads.append((self._marker(body, marker), value, axes))

    def _orthogonal(  # noqa: PLR0913
        self,
        body: str,
        marker: str,
        other: str | None,
        other_marker: str | None,
        pairs: Sequence[tuple[ArrayLike, ArrayLike]],
        kind: str,
        drive: int = -1,
        axis: ArrayLike = (0.0, 0.0, 0.0),
        spring: int = -1,
    ) -> None:
        row = constraint.ORTHOGONAL if spring < 0 else constraint.TORQUE
        axis = np.asarray(axis, dtype=float)
        if (drive >= 0 or spring >= 0) and (axis.shape != (3,) or not np.isclose(np.linalg.norm(axis), 1.0, atol=1e-9)):
            raise ObserverFrameError(f"{kind} of {body}.{marker}: axis {tuple(axis)} is not a unit vector")
        a = self._marker(body, marker)
        b = -1 if other is None or other_marker is None else self._marker(other, other_marker)
        name = f"{kind} of {body}.{marker}" + ("" if other is None else f" to {other}.{other_marker}")
        for mine, yours in pairs:
            self._rows.append(_Row(row, (a, b), (np.array(mine), np.array(yours)), name, drive, axis, spring))

    def _displaced(self, index: int, marker: str) -> tuple[Array, Array]:
        """Place (3,) and section orientation (3, 3, to fixed axes) of a marker at the initial coordinates."""
        body, q = self.bodies[index], self.motions[index][2]
        field = body.marker_shape(marker) @ q
        if body.second_order is not None:
            field[:3] += 0.5 * body.places[marker].second_order() @ q[:-6] @ q[:-6]
        turn = self.frames[index][1] @ Rotation.from_rotvec(field[3:]).as_matrix()
        return body.marker_position(marker) + field[:3], turn

    def _index(self, name: str) -> int:
        for i, body in enumerate(self.bodies):
            if body.name == name:
                return i
        known = ", ".join(repr(b.name) for b in self.bodies)
        raise ObserverFrameError(f"no substructure is named {name!r}, only {known or 'none at all'}")

    def _marker(self, body: str, marker: str) -> int:
        index = self._index(body)
        if marker not in self.bodies[index].places:
            known = sorted(self.bodies[index].places)
            raise ObserverFrameError(f"substructure {body!r} has no marker {marker!r}, only {known}")
        if (index, marker) not in self._markers:
            self._markers.append((index, marker))
        return self._markers.index((index, marker))

    # ---- packing ---------------------------------------------------------------------------------------------------

    def pack(self, prediction: int = 0) -> tuple[Model, State, Work]:
        """Arrays for the kernels.

        Parameters
        ----------
        prediction : int
            Code of the motion of the frames over a step.

        Returns
        -------
        (Model, State, Work)

        Raises
        ------
        ObserverFrameError
            When there is no body, a mass matrix is singular, or the constraints depend on each other or are violated.
        """
        if not self.bodies:
            raise ObserverFrameError("a system in local observer frames needs at least one substructure")
        n_b, n_max = len(self.bodies), max(b.n for b in self.bodies)
        n_m, n_row = len(self._markers), len(self._rows)
        bends = np.array([b.second_order is not None for b in self.bodies])
        if bends.any() and self.rigid_modes != "deformed":
            raise ObserverFrameError("second-order displacements need the rigid_modes 'deformed'")
        bent = max(b.n_elastic for b in self.bodies) if bends.any() else 0
        held = np.zeros(n_m, dtype=np.int64)
        for row in self._rows:
            for m in row.markers:
                if m >= 0:
                    held[m] = max(held[m], 3 if row.kind == constraint.DISPLACEMENT else 6)
        springs = [self.springs[r.spring] if r.spring >= 0 else Spring("", 0.0, 0.0) for r in self._rows]
        model = Model(
            n=np.array([b.n for b in self.bodies]),
            first=np.zeros((n_b, n_max), dtype=np.int64),
            ends=np.array([b.ends for b in self.bodies]),
            reach=max(float(np.linalg.norm(b.ends, axis=1).max()) for b in self.bodies),
            gravity=self.gravity,
            marker_body=np.array([b for b, _ in self._markers], dtype=np.int64),
            marker_held=held,
            row_kind=np.array([r.kind for r in self._rows], dtype=np.int64),
            row_marker=np.array([r.markers for r in self._rows], dtype=np.int64).reshape(n_row, 2),
            row_vector=np.array([r.vectors for r in self._rows], dtype=float).reshape(n_row, 2, 3),
            load_marker=np.array([m for m, _, _ in self.loads], dtype=np.int64),
            load_axes=np.array([LOAD_AXES[axes] for _, _, axes in self.loads], dtype=np.int64),
            load_field=np.cumsum([axes == "consistent" for _, _, axes in self.loads], dtype=np.int64) - 1,
            load_second=self._second_order_fields(n_max),
            deformed_modes=self.rigid_modes == "deformed",
            prediction=prediction,
            row_drive=np.array([r.drive for r in self._rows], dtype=np.int64),
            row_axis=np.array([r.axis for r in self._rows], dtype=float).reshape(n_row, 3),
            row_spring=np.array([r.spring for r in self._rows], dtype=np.int64),
            row_stiffness=np.array([spring.stiffness for spring in springs]),
            row_damping=np.array([spring.damping for spring in springs]),
            row_inertia=np.array([spring.inertia for spring in springs]),
            load_section=np.full(n_b, -1, dtype=np.int64),
            rule=np.array(NEWMARK),
            definite=np.array([b.definite for b in self.bodies]),
            bends=bends,
            **_zeros({
                "stiffness damping mass_low mass_up": (n_b, n_max, n_max), "gyro": (n_b, 3, n_max, n_max),
                "second": (n_b, 6, n_max, n_max), "first_moment": (n_b, n_max, 3), "reference_moment": (n_b, n_max, 9),
                "reference_first": (n_b, 3), "reference_second": (n_b, 3, 3), "extra_mass geometric": (n_b, bent, bent),
                "bend_first": (n_b, 3, bent, bent), "bend_moment": (n_b, 9, bent, bent),
                "bend_mass": (n_b, bent, bent, bent), "elastic_first": (n_b, bent, 3), "elastic_moment": (n_b, bent, 9),
            }),
            **_zeros({
                "marker_position marker_lever marker_place": (n_m, 3), "marker_shape mass_columns": (n_m, 6, n_max),
                "mass_pairs": (n_m, n_m, 6, 6), "bend_marker": (n_m, 3, bent, bent), "marker_linear": (n_m, 3, bent),
            }),
        )  # fmt: skip
        self._pack_bodies(model)
        self._pack_markers(model)
        state = self._new_state(n_b, n_max, n_row)
        work = _new_work(n_b, n_max, n_m, n_row, len(self.drives), len(self.springs))
        for k, drive in enumerate(self.drives):
            work.drive[k] = drive.at(0.0)
        for k, spring in enumerate(self.springs):
            work.spring[k] = spring.at(0.0)
        if model.deformed_modes:
            for b, body in enumerate(self.bodies):
                if bends[b]:
                    state.deformed[b, : body.n_elastic] = state.q[b, : body.n_elastic]  # rates are those of this shape
                renew(b, 0.0, model, state, work)
            constraint.marker_pairs(model, model.mass_columns, model.mass_pairs)
        self._check_constraints(model, state, work)
        return model, state, work

    def _pack_bodies(self, model: Model) -> None:
        for i, body in enumerate(self.bodies):
            n = body.n
            model.first[i, :n] = body.envelope()
            model.stiffness[i, :n, :n], model.damping[i, :n, :n] = body.stiffness, body.damping
            model.gyro[i, :, :n, :n], model.second[i, :, :n, :n] = body.gyro, body.second
            model.first_moment[i, :n], model.reference_moment[i, :n] = body.first_moment, body.reference_moment
            model.mass_low[i, :n, :n] = model.mass_up[i, :n, :n] = body.mass_matrix
            m, s = body.particle_mass, body.particle_position
            model.reference_first[i], model.reference_second[i] = m @ s, (m[:, None] * s).T @ s
            if body.second_order is not None:
                nf, more = body.n_elastic, body.second_order
                model.bend_first[i, :, :nf, :nf], model.bend_moment[i, :, :nf, :nf] = more.first, more.moment
                model.bend_mass[i, :nf, :nf, :nf] = more.mass
                model.elastic_first[i, :nf] = body.first_moment[:nf]
                model.elastic_moment[i, :nf] = body.reference_moment[:nf]
            if not matrix.factorize_envelope(0, n, model.first[i], model.mass_low[i], model.mass_up[i], body.definite):
                raise ObserverFrameError(f"substructure {body.name!r}: the mass matrix is singular")

    def _pack_markers(self, model: Model) -> None:
        for m, (index, name) in enumerate(self._markers):
            body = self.bodies[index]
            model.marker_position[m] = model.marker_place[m] = body.marker_position(name)
            model.marker_shape[m, :, : body.n] = body.marker_shape(name)
            if body.second_order is not None:
                nf = body.n_elastic
                model.marker_linear[m, :, :nf] = body.places[name].field[:3]
                model.bend_marker[m, :, :nf, :nf] = body.places[name].second_order()
            model.mass_columns[m] = model.marker_shape[m]
            for column in model.mass_columns[m]:
                matrix.solve_envelope(body.n, model.first[index], model.mass_low[index], model.mass_up[index], column)
        constraint.marker_pairs(model, model.mass_columns, model.mass_pairs)

    def _second_order_fields(self, n_max: int) -> Array:
        """Second-order displacement H of the points of consistent loads (n, 3, n_max, n_max)."""
        fields = []
        for marker, _, axes in self.loads:
            if axes == "consistent":
                index, name = self._markers[marker]
                body, out = self.bodies[index], np.zeros((3, n_max, n_max))
                nf = body.n_elastic
                out[:, :nf, :nf] = body.places[name].second_order()
                fields.append(out)
        return np.array(fields).reshape(-1, 3, n_max, n_max)

    def _new_state(self, n_b: int, n_max: int, n_row: int) -> State:
        state = State(
            n_updates=np.zeros(n_b, dtype=np.int64),
            angle=np.array([spring.angle for spring in self.springs]),
            reaction=np.zeros((len(self._markers), 3)),
            rotation=np.zeros((n_b, 3, 3)),
            multiplier=np.zeros(n_row),
            age=np.zeros(n_b),
            **_zeros({
                "position velocity omega acceleration alpha turned": (n_b, 3), "q v a lead deformed": (n_b, n_max)
            }),
        )  # fmt: skip
        for i, ((position, rotation), motion) in enumerate(zip(self.frames, self.motions, strict=True)):
            n = self.bodies[i].n
            state.position[i], state.rotation[i] = position, rotation
            state.velocity[i], state.omega[i], state.q[i, :n], state.v[i, :n] = motion
        return state

    def _check_constraints(self, model: Model, state: State, work: Work) -> None:
        """Refuse redundant and violated constraints, by name."""
        constraint.constraint_rows(model, state, state.q, state.v, work)
        jacobian = np.zeros((len(self._rows), state.q.size))
        for r, row in enumerate(self._rows):
            for side, m in enumerate(row.markers):
                if m >= 0:
                    b, n = model.marker_body[m], state.q.shape[1]
                    jacobian[r, b * n : b * n + n] += work.weight[r, side] @ model.marker_shape[m]
        rank = 0
        held = [r for r, row in enumerate(self._rows) if row.kind != constraint.TORQUE]
        jacobian = jacobian[held]
        for r, row in enumerate(self._rows[i] for i in held):
            unit = jacobian[: r + 1] / np.maximum(np.linalg.norm(jacobian[: r + 1], axis=1, keepdims=True), 1e-300)
            now = np.linalg.matrix_rank(unit, tol=1e-9)
            if now == rank:
                raise ObserverFrameError(
                    f"inconsistent constraints: {row.connection} repeats what is held already "
                    f"(rank {rank} of {r + 1} rows)"
                )
            rank = now
            if abs(work.row_value[held[r]]) > 1e-6:
                violation = work.row_value[held[r]]
                raise ObserverFrameError(
                    f"inconsistent constraints: {row.connection} is violated by {violation:.3g} at the start"
                )


def _zeros(shapes: dict[str, tuple[int, ...]]) -> dict[str, Any]:
    """Arrays by name, from their shapes by names with spaces between."""
    return {name: np.zeros(shape) for names, shape in shapes.items() for name in names.split()}


def _new_work(n_b: int, n_max: int, n_m: int, n_row: int, n_drive: int, n_spring: int) -> Work:
    arrays = _zeros({
        **dict.fromkeys(Work._fields, (3,)),
        "low up": (n_b, n_max, n_max), "base rhs next vector ahead body_load": (n_b, n_max),
        "multiplier row_value row_rate row_bias row_change row_scale": (n_row,),
        "marker_rotation marker_tangent": (n_m, 3, 3), "marker_rate marker_bias marker_field": (n_m, 6),
        "field field_rate rate bias pull load": (6,), "turn tangent second mixed pair": (3, 3),
        "columns": (n_m, 6, n_max), "pairs": (n_m, n_m, 6, 6), "schur": (n_row, n_row), "marker_point": (n_m, 3),
        "weight": (n_row, 2, 6), "moments": (n_max, 9), "drive": (n_drive, 3), "spring": (n_spring, 3),
        "row_reach": (n_row, n_m, 6),
    })  # fmt: skip
    return Work(**(arrays | {"order": np.zeros(n_row, dtype=np.int64)}))
