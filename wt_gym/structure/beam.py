"""Three-dimensional beams: section tables to finite elements.

The element has two nodes with six degrees of freedom each (three displacements, three rotations). It is
force-based: inside an element the section forces follow exactly from the end forces by equilibrium, and the
element flexibility is the integral of the section compliance,

    F = ∫ Bᵀ C B ds,      K_bb = F⁻¹,      B(s) = [[1, 0], [(L − s) ẽ_z, 1]],

so that tapered, twisted and fully coupled (6×6) sections need no assumed displacement field. With a constant
shear-rigid section it reduces to the classical Hermite element. (Flexibility method of structural mechanics, see
e.g. Przemieniecki, Theory of Matrix Structural Analysis, 1968, ch. 5 and 8.)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from wt_gym.base.options import option, option_record
from wt_gym.base.quantities import Array
from wt_gym.turbines.blade import BeamStations, inertia_matrix, interpolate

N_GAUSS = 4  # exact for the cubic displacement times linear mass of a uniform element


def skew(v: ArrayLike) -> Array:
    """Cross-product matrices of vectors.

    Parameters
    ----------
    v : array (..., 3)

    Returns
    -------
    array (..., 3, 3)
        ṽ with ṽ w = v × w.
    """
    v = np.asarray(v, dtype=float)
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out


@option_record
class BeamSections(BeamStations):
    """Section properties along a beam, all about the reference axis, and where that axis lies in the body."""

    axis: Array = option("position of the reference axis in the body frame", unit="m", shape=("station", 3))

    @classmethod
    def uniform(  # noqa: PLR0913
        cls,
        length: float,
        *,
        EA: float,
        EIx: float,
        EIy: float,
        GJ: float,
        mass: float,
        Ix: float = 0.0,
        Iy: float = 0.0,
        offset: tuple[float, float] = (0.0, 0.0),
        n: int = 2,
    ) -> BeamSections:
        """Sections of a straight uniform shear-rigid beam along z.

        Parameters
        ----------
        length : float
            [m].
        EA, EIx, EIy, GJ : float
            Axial [N], bending about x and about y [N m²] and torsional stiffness [N m²].
        mass : float
            Mass per length [kg/m].
        Ix, Iy : float
            Mass moments of inertia per length about the x and y axes through the mass center [kg m].
        offset : (float, float)
            Mass center relative to the axis [m].
        n : int
            Number of stations.
        """
        stiffness = np.diag([np.inf, np.inf, EA, EIx, EIy, GJ])
        x, y = offset
        inertia = inertia_matrix(mass, x, y, Ix + mass * y**2, Iy + mass * x**2, mass * x * y)
        s = np.linspace(0.0, length, n)
        axis = np.zeros((n, 3))
        axis[:, 2] = s
        return cls(s, np.tile(stiffness, (n, 1, 1)), np.tile(inertia, (n, 1, 1)), axis)

    def axis_at(self, s: ArrayLike) -> Array:
        """Position (..., 3) of the reference axis at arc length s."""
        return interpolate(s, self.station, self.axis)

    def compliance_at(self, s: ArrayLike) -> Array:
        """Compliance (..., 6, 6); rows and columns of rigid shear are zero."""
        k = self.stiffness_at(s)
        c = np.zeros_like(k)
        if self.shear_rigid:
            c[..., 2:, 2:] = np.linalg.inv(k[..., 2:, 2:])
        else:
            c[...] = np.linalg.inv(k)
        return c


def _frame_along(tangent: Array) -> Array:
    """Rotation (3, 3) that turns z into the tangent by the shortest way (no turn about the tangent)."""
    z = np.array([0.0, 0.0, 1.0])
    axis = np.cross(z, tangent)
    c = tangent[2]
    if c < -1.0 + 1e-9:
        raise ValueError("the reference axis of a beam must not run against its z axis")
    a = skew(axis)
    result: Array = np.eye(3) + a + a @ a / (1.0 + c)
    return result


def _lever(length: ArrayLike) -> Array:
    """Equilibrium matrices B (…, 6, 6) that carry an end force over a distance along z."""
    length = np.asarray(length, dtype=float)
    out = np.zeros((*length.shape, 6, 6))
    out[...] = np.eye(6)
    out[..., 3, 1] = -length
    out[..., 4, 0] = length
    return out


def _transpose(a: Array) -> Array:
    return np.swapaxes(a, -1, -2)


def _integration_row(nodes: Array, x: float) -> Array:
    """Weights w with ∫₀ˣ p(ξ) dξ = Σ w_k p(ξ_k) for polynomials through the given nodes."""
    powers = np.arange(len(nodes))
    moments = x ** (powers + 1) / (powers + 1)
    row = np.linalg.solve(np.vander(nodes, increasing=True).T, moments)
    return cast(Array, row)


class Beam:
    """Finite-element model of one beam from root (node 0) to tip (last node).

    Parameters
    ----------
    sections : BeamSections
        Property tables.
    nodes : array (n_nodes,) or int
        Arc lengths of the nodes [m], or the number of equal elements.
    foundation : array (6, 6), optional
        Stiffness that the ground has against the motion of node 0, body-frame axes; without, modes and nodal bases
        are those of a beam that is clamped there.
    added_mass : callable, optional
        Mass per length [kg/m] at arc lengths (n,) of a fluid around the beam that moves along with it across the z
        axis: inertia without weight, for a beam whose body frame stands still.
    lumps : sequence of (int, float)
        Nodes with point masses [kg].

    Attributes
    ----------
    stiffness, mass : array (6 n_nodes, 6 n_nodes)
        Assembled matrices; node i owns the rows 6 i … 6 i + 5 (displacements, then rotations, body-frame axes).
    first_free : int
        The first node that moves: 1 for a clamped beam, 0 on a foundation.
    fluid_mass : array (6 n_nodes, 6 n_nodes) or None
        What of the mass matrix belongs to the fluid.
    node_position : array (n_nodes, 3)
    particle_mass : array (n_p,)
        Equivalent mass points: four for each Gauss point, which carry mass, offset and rotary inertia of the section.
    particle_position : array (n_p, 3)
    particle_shape : array (n_p, 3, 6 n_nodes)
        Linear displacement of the mass points.
    particle_gauss : int array (n_p,)
        Gauss point of each, counted from the root.
    """

    def __init__(
        self,
        sections: BeamSections,
        nodes: ArrayLike,
        foundation: Array | None = None,
        added_mass: Callable[[Array], Array] | None = None,
        lumps: Sequence[tuple[int, float]] = (),
    ) -> None:
        self.sections = sections
        self._lumps = lumps
        if np.isscalar(nodes):
            nodes = np.linspace(sections.station[0], sections.station[-1], int(cast(float, nodes)) + 1)
        self.nodes = np.asarray(nodes, dtype=float)
        if self.nodes.ndim != 1 or len(self.nodes) < 2 or np.any(np.diff(self.nodes) <= 0.0):
            raise ValueError(f"beam nodes must be at least two increasing arc lengths, got {nodes!r}")
        if self.nodes[0] < sections.station[0] - 1e-9 or self.nodes[-1] > sections.station[-1] + 1e-9:
            raise ValueError(
                f"beam nodes [{self.nodes[0]}, {self.nodes[-1]}] lie outside the section table "
                f"[{sections.station[0]}, {sections.station[-1]}]"
            )
        self.node_position = sections.axis_at(self.nodes)
        x, w = np.polynomial.legendre.leggauss(N_GAUSS)
        self._xi, self._weight = 0.5 * (x + 1.0), 0.5 * w
        self._build_elements()
        self._assemble_stiffness()
        self._build_particles()
        self.first_free, self.fluid_mass = 1, None
        if foundation is not None:
            self.first_free = 0
            self.stiffness[:6, :6] += foundation
        if added_mass is not None:
            self.fluid_mass = self._assemble_fluid(added_mass)
            self.mass += self.fluid_mass

    @property
    def n_dof(self) -> int:
        """Number of nodal degrees of freedom."""
        return 6 * len(self.nodes)

    @property
    def n_elements(self) -> int:
        """Number of elements."""
        return len(self.nodes) - 1

    def _build_elements(self) -> None:
        """Frames, lengths and end stiffness K_bb of all elements."""
        chord = np.diff(self.node_position, axis=0)
        self._length = np.linalg.norm(chord, axis=1)
        self._frame = np.array([_frame_along(t) for t in chord / self._length[:, None]])
        self._flexibility = self._element_flexibility(np.arange(self.n_elements), np.ones(self.n_elements))
        self._end_stiffness = np.linalg.inv(self._flexibility)

    def _element_flexibility(self, e: ArrayLike, xi: ArrayLike) -> Array:
        """G(ξ) = ∫₀^{ξL} B_sᵀ C B dσ: displacement at ξ of a root-clamped element per end force (n, 6, 6)."""
        e, xi = np.atleast_1d(e), np.atleast_1d(xi)
        arc = np.diff(self.nodes)[e]
        length = self._length[e]
        out = np.zeros((len(e), 6, 6))
        # ten panels of Gauss points resolve section tables much finer than the element
        n_panel = 10
        for panel in range(n_panel):
            for x, w in zip(self._xi, self._weight, strict=True):
                sigma = xi * (panel + x) / n_panel
                compliance = self.sections.compliance_at(self.nodes[e] + sigma * arc)
                to_end = _lever((1.0 - sigma) * length)
                to_point = _lever((xi - sigma) * length)
                out += (w / n_panel * xi * length)[:, None, None] * (_transpose(to_point) @ compliance @ to_end)
        return out

    def shape(self, e: ArrayLike, xi: ArrayLike) -> Array:
        """Displacements and rotations inside elements per nodal coordinate, in the body frame.

        Parameters
        ----------
        e : int array (n,)
            Elements.
        xi : array (n,)
            Position in the element, 0 … 1.

        Returns
        -------
        array (n, 6, 12)
        """
        e, xi = np.atleast_1d(e), np.atleast_1d(xi)
        length = self._length[e]
        g = self._element_flexibility(e, xi) @ self._end_stiffness[e]
        local = np.concatenate([_transpose(_lever(xi * length)) - g @ _transpose(_lever(length)), g], axis=-1)
        r = self._frame[e]
        r2 = np.zeros((len(e), 6, 6))
        r2[:, :3, :3] = r2[:, 3:, 3:] = r
        r4 = np.zeros((len(e), 12, 12))
        r4[:, :6, :6] = r4[:, 6:, 6:] = r2
        result: Array = r2 @ local @ _transpose(r4)
        return result

    def _assemble_stiffness(self) -> None:
        """K_e = [[T K T^T, −T K], [−K Tᵀ, K]] rotated into the body frame."""
        self.stiffness = np.zeros((self.n_dof, self.n_dof))
        t = _lever(self._length)
        k = self._end_stiffness
        tk = t @ k
        local = np.block([[tk @ _transpose(t), -tk], [-_transpose(tk), k]])
        for e in range(self.n_elements):
            r = np.kron(np.eye(4), self._frame[e])
            i = slice(6 * e, 6 * e + 12)
            self.stiffness[i, i] += r @ local[e] @ r.T

    def _assemble_fluid(self, added_mass: Callable[[Array], Array]) -> Array:
        """∫ m (Sₓᵀ Sₓ + S_yᵀ S_y) ds over the displacements across the axis, in panels much finer than an element."""
        total, n_panel = np.zeros((self.n_dof, self.n_dof)), 20
        xi = np.concatenate([(panel + self._xi) / n_panel for panel in range(n_panel)])
        weight = np.tile(self._weight, n_panel) / n_panel
        for e in range(self.n_elements):
            density = added_mass(self.nodes[e] + xi * (self.nodes[e + 1] - self.nodes[e]))
            if not np.any(density):
                continue
            across = self.shape(np.full(len(xi), e), xi)[:, :2]
            i = slice(6 * e, 6 * e + 12)
            total[i, i] += np.einsum("g,gka,gkb->ab", density * weight * self._length[e], across, across, optimize=True)
        return total

    def _build_particles(self) -> None:
        """Replace each Gauss point's section by four mass points with the same mass, center and inertia."""
        n_e, n_g = self.n_elements, N_GAUSS
        e = np.repeat(np.arange(n_e), n_g)
        xi = np.tile(self._xi, n_e)
        arc = np.diff(self.nodes)
        inertia = self.sections.inertia_at(self.nodes[e] + xi * arc[e])
        weight = np.tile(self._weight, n_e) * arc[e]
        gauss_shape = self.shape(e, xi)
        self._gauss_shape = gauss_shape
        chord = np.diff(self.node_position, axis=0)
        center_line = self.node_position[e] + xi[:, None] * chord[e]

        mass, position, shape, gauss = [], [], [], []
        for g in range(n_e * n_g):
            rho = inertia[g, 0, 0]
            cx, cy = inertia[g, 5, 1] / rho, inertia[g, 3, 2] / rho
            second = np.array(
                [
                    [inertia[g, 4, 4] - rho * cx * cx, -inertia[g, 3, 4] - rho * cx * cy],
                    [-inertia[g, 3, 4] - rho * cx * cy, inertia[g, 3, 3] - rho * cy * cy],
                ]
            )  # ∫ (x², xy; xy, y²) dm about the mass center
            value, vector = np.linalg.eigh(second)
            if value[0] < -1e-6 * max(abs(value[1]), 1e-30):
                raise ValueError(f"section inertia at {self.nodes[e[g]]:.3f} m is not positive: {value}")
            for k in range(2):
                reach = np.sqrt(max(2.0 * value[k] / rho, 0.0))
                for sign in (-1.0, 1.0):
                    offset2 = np.array([cx, cy]) + sign * reach * vector[:, k]
                    offset = self._frame[e[g]] @ np.array([offset2[0], offset2[1], 0.0])
                    mass.append(0.25 * rho * weight[g])
                    position.append(center_line[g] + offset)
                    row = np.zeros((3, self.n_dof))
                    row[:, 6 * e[g] : 6 * e[g] + 12] = gauss_shape[g, :3] - skew(offset) @ gauss_shape[g, 3:]
                    shape.append(row)
                    gauss.append(g)
        for node, lump in self._lumps:
            row = np.zeros((3, self.n_dof))
            row[:, 6 * node : 6 * node + 3] = np.eye(3)
            mass.append(lump)
            position.append(self.node_position[node])
            shape.append(row)
            gauss.append(max(node * n_g - 1, 0))  # carried by the last section below
        self.particle_mass = np.array(mass)
        self.particle_position = np.array(position)
        self.particle_shape = np.array(shape)
        self.particle_gauss = np.array(gauss)
        self._particle_offset = self.particle_position - center_line[self.particle_gauss]
        weighted = self.particle_shape * self.particle_mass[:, None, None]
        self.mass = np.einsum("pia,pib->ab", weighted, self.particle_shape, optimize=True)

    # ---- fields for a reduced basis ------------------------------------------------------------------------------

    def locate(self, s: float) -> tuple[int, float]:
        """Element index and position inside it of an arc length s [m]."""
        e = int(np.clip(np.searchsorted(self.nodes, s, side="right") - 1, 0, self.n_elements - 1))
        return e, (s - self.nodes[e]) / (self.nodes[e + 1] - self.nodes[e])

    def linear_field(self, s: float, basis: Array) -> tuple[Array, Array]:
        """Displacement and rotation at arc length s for a basis.

        Parameters
        ----------
        s : float
            Arc length [m].
        basis : array (n_dof, n)
            Columns of nodal displacements.

        Returns
        -------
        (array (3, n), array (3, n))
            Displacements and rotations of the reference axis.
        """
        e, xi = self.locate(s)
        field = self.shape(e, xi)[0] @ basis[6 * e : 6 * e + 12]
        return field[:3], field[3:]

    def gauss_rotation(self, basis: Array) -> Array:
        """Rotation fields (n_elements, N_GAUSS, 3, n) at the Gauss points for a basis."""
        cols = np.array([np.arange(6 * e, 6 * e + 12) for e in range(self.n_elements)])
        rot = self._gauss_shape[:, 3:, :].reshape(self.n_elements, N_GAUSS, 3, 12)
        result: Array = np.einsum("egid,edn->egin", rot, basis[cols], optimize=True)
        return result

    def second_order_field(self, basis: Array) -> SecondOrderField:
        """Second-order displacement of the reference axis (foreshortening), the source of geometric stiffness.

        The beam axis keeps its length while its sections turn by the rotation vector θ = Θ q:
        r' = exp(θ̃) t ≈ t + θ̃ t + ½ θ̃ θ̃ t, hence the displacement ½ qᵀ H q with

            H_jk(s) = ∫₀ˢ ½ (θ̃_j θ̃_k + θ̃_k θ̃_j) t dσ.

        (Stress stiffening by quadratic deformation modes: Kane, Ryan & Banerjee 1987, J. Guidance 10, 139–151.)
        """
        theta = self.gauss_rotation(basis)
        return SecondOrderField(self, theta)


class SecondOrderField:
    """Quadratic displacement H_jk of a beam axis for the rotation fields of a basis."""

    def __init__(self, beam: Beam, theta: Array) -> None:
        self._beam = beam
        self._integrand = self._pair(theta, beam._frame[:, None, :, 2])
        step = np.einsum("g,egijk->eijk", beam._weight, self._integrand) * beam._length[:, None, None, None]
        n = theta.shape[-1]
        self._start = np.concatenate([np.zeros((1, 3, n, n)), np.cumsum(step, axis=0)])

    @staticmethod
    def _pair(theta: Array, v: Array) -> Array:
        """½ (θ̃_j θ̃_k + θ̃_k θ̃_j) v = ½ [θ_j (θ_k·v) + θ_k (θ_j·v)] − v (θ_j·θ_k), shapes (…, 3, n), (…, 3)."""
        along = np.einsum("...in,...i->...n", theta, np.broadcast_to(v, (*theta.shape[:-2], 3)))
        mixed = np.einsum("...ij,...k->...ijk", theta, along)
        dot = np.einsum("...ij,...ik->...jk", theta, theta)
        result: Array = 0.5 * (mixed + np.swapaxes(mixed, -1, -2)) - v[..., :, None, None] * dot[..., None, :, :]
        return result

    def at(self, s: float) -> Array:
        """H (3, n, n) of the reference axis at arc length s."""
        e, xi = self._beam.locate(s)
        row = _integration_row(self._beam._xi, xi) * self._beam._length[e]
        result: Array = self._start[e] + np.einsum("g,gijk->ijk", row, self._integrand[e])
        return result

    def at_gauss(self) -> Array:
        """H (n_elements · N_GAUSS, 3, n, n) at the Gauss points."""
        rows = np.array([_integration_row(self._beam._xi, x) for x in self._beam._xi])
        inner = np.einsum("gh,ehijk->egijk", rows, self._integrand) * self._beam._length[:, None, None, None, None]
        out = self._start[:-1, None] + inner
        result: Array = out.reshape(out.shape[0] * out.shape[1], *out.shape[2:])
        return result

    @classmethod
    def of_offset(cls, theta: Array, offset: Array) -> Array:
        """Quadratic displacement of a point carried at an offset by a section turning by θ (…, 3, n)."""
        return cls._pair(theta, offset)


ELEMENTS_PER_LENGTH = 8
"""Elements to the length 1/β = (4 EI/k)^¼ over which the deflection of a pile dies away: 1e-5 of the stiffness."""


def pile_head_stiffness(
    length: float,
    lateral: Callable[[Array], ArrayLike],
    *,
    EA: float,
    EI: float,
    GJ: float,
    axial: float,
    torsional: float,
    base_lateral: float = 0.0,
) -> Array:
    """Stiffness of the head of an upright pile on springs along its length (Winkler), all else condensed statically.

    The ground resists the displacement of the pile by k(d) per length at the depth d. On a pile much longer than
    1/β = (4 EI/k)^¼ with a constant k the head has (M. Hetényi, Beams on Elastic Foundation, 1946, section 10)

        K_uu = 4 EI β³,   K_uθ = ∓2 EI β²,   K_θθ = 2 EI β.

    Parameters
    ----------
    length : float
        Embedded length [m].
    lateral : callable
        k [N/m²] at depths (n,) below the head [m].
    EA, EI, GJ : float
        Axial [N], bending and torsional stiffness [N m²] of the pile.
    axial, torsional : float
        Friction along the shaft against settlement [N/m²] and against twist [N m/(rad m)].
    base_lateral : float
        Shear under the tip [N/m].

    Returns
    -------
    array (6, 6)
        For `wt_gym.turbines.Support.foundation`: displacements along and rotations about x, y, z (up).

    Raises
    ------
    ValueError
        For lengths or stiffnesses that are not positive.
    """
    depth = np.linspace(0.0, length, 201)
    springs = np.asarray(lateral(depth), dtype=float) * np.ones_like(depth)
    given = {"length": length, "EA": EA, "EI": EI, "GJ": GJ, "axial": axial, "torsional": torsional}
    for name, value in given.items():
        if not (np.isfinite(value) and value > 0.0):
            raise ValueError(f"{name} of a pile is {value}; it must be positive and finite")
    if not (np.all(np.isfinite(springs)) and np.all(springs >= 0.0) and np.any(springs > 0.0)):
        raise ValueError("lateral springs of a pile must be finite, nowhere negative, and somewhere positive [N/m^2]")
    beta = (springs.max() / (4.0 * EI)) ** 0.25
    sections = BeamSections.uniform(length, EA=EA, EIx=EI, EIy=EI, GJ=GJ, mass=1.0)
    beam = Beam(sections, max(int(np.ceil(ELEMENTS_PER_LENGTH * beta * length)), 8))
    total = beam.stiffness.copy()
    x, w = np.polynomial.legendre.leggauss(4)
    for e, (low, high) in enumerate(zip(beam.nodes[:-1], beam.nodes[1:], strict=True)):
        shape = beam.shape(np.full(4, e), 0.5 * (x + 1.0))
        # the beam's z axis points up from the tip of the pile
        place = low + 0.5 * (x + 1.0) * (high - low)
        resisting = np.zeros((4, 6))
        resisting[:, :2] = np.asarray(lateral(length - place), dtype=float).reshape(-1, 1) * np.ones((4, 1))
        resisting[:, 2], resisting[:, 5] = axial, torsional
        weight = 0.5 * w * (high - low)
        i = slice(6 * e, 6 * e + 12)
        total[i, i] += np.einsum("g,gk,gka,gkb->ab", weight, resisting, shape, shape, optimize=True)
    total[0, 0] += base_lateral
    total[1, 1] += base_lateral
    inner, head = slice(0, -6), slice(-6, None)
    condensed = total[head, head] - total[head, inner] @ np.linalg.solve(total[inner, inner], total[inner, head])
    return 0.5 * (condensed + condensed.T)
