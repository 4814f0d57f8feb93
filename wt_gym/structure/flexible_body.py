"""One body of a multibody system: rigid, or flexible in a reduced basis, with its constant inertia integrals.

A material point of the body sits, in the body frame, at

    r(q) = x₀ + S q + ½ qᵀ H q,

with the linear modes S and the second-order field H (foreshortening). The kinetic energy is kept complete up to second
order in the elastic coordinates (third order where two of them are rates); it then needs only the constant integrals
collected in :class:`BodyInertia`. One order more belongs to blades that twist: where a bent blade twists, the mass
outboard of the bend swings sideways, by H and in proportion to q; the square of that motion outweighs the small inertia
of torsion, and without it the mass matrix loses its definiteness at tip deflections of 7 % of the length.
The terms with H are what stiffens a rotating blade and what makes a loaded tower lean (P-Δ).
(Floating frame of reference: Shabana, Dynamics of Multibody Systems, ch. 5; second-order terms: Wallrapp &
Schwertassek 1991, Int. J. Numer. Methods Eng. 32, 1833–1850.)
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wt_gym.base.quantities import Array
from wt_gym.structure.beam import Beam, SecondOrderField, skew


@dataclass(frozen=True)
class Marker:
    """A point (with an orientation) that moves with a body.

    Attributes
    ----------
    position : array (3,)
        Undeformed position in the body frame [m].
    linear : array (3, n)
        Displacement per elastic coordinate.
    second : array (3, n, n)
        Second-order displacement H.
    rotation : array (3, n)
        Rotation vector per elastic coordinate.
    """

    position: Array
    linear: Array
    second: Array
    rotation: Array


class MassPointFields(Protocol):
    """Displacement fields of mass points, as :class:`ParticleFields` has them."""

    @property
    def position(self) -> Array:
        """Undeformed positions (n_p, 3)."""

    @property
    def linear(self) -> Array:
        """Displacement per elastic coordinate (n_p, 3, n)."""

    @property
    def second(self) -> Array:
        """Second-order displacement (n_p, 3, n, n)."""


@dataclass(frozen=True)
class BodyInertia:
    """Constant inertia integrals of a body, second order in its n elastic coordinates q.

    The first moment is mc = c0 + c1 q + ½ qᵀ c2 q, the inertia tensor about the frame origin
    J = j0 + j1 q + ½ qᵀ j2 q, the coupling of rotation and deformation D_k = d0_k + d1_kj q_j + d2_kjl q_j q_l.

    Attributes
    ----------
    mass : float
        ∫ dm [kg].
    c0 : array (3,); c1 : array (3, n); c2 : array (3, n, n)
        First moments.
    j0 : array (3, 3); j1 : array (n, 3, 3); j2 : array (n, n, 3, 3)
        Inertia tensor.
    d0 : array (n, 3); d1 : array (n, n, 3)
        ∫ x₀ × S_k dm and ∫ (S_j × S_k + x₀ × H_kj) dm, indexed [k, j].
    d2 : array (n, n, n, 3)
        ∫ ½ (S_j × H_kl + S_l × H_kj + H_jl × S_k) dm, indexed [k, j, l]; empty unless complete.
    m0 : array (n, n); m1 : array (n, n, n); m2 : array (n, n, n, n)
        Elastic mass matrix M_kl = m0_kl + m1_klj q_j + m2_kmlj q_m q_j: ∫ S_k · S_l dm,
        ∫ (S_k · H_lj + S_l · H_kj) dm and ∫ H_km · H_lj dm; m2 is empty unless complete.
    """

    mass: float
    c0: Array
    c1: Array
    c2: Array
    j0: Array
    j1: Array
    j2: Array
    d0: Array
    d1: Array
    d2: Array
    m0: Array
    m1: Array
    m2: Array

    @classmethod
    def rigid(cls, mass: float, center: ArrayLike, inertia_about_center: ArrayLike) -> "BodyInertia":
        """Inertia of a rigid body from mass, mass center (3,) and inertia tensor (3, 3) about the mass center."""
        center = np.asarray(center, dtype=float)
        r = skew(center)
        j0 = np.asarray(inertia_about_center, dtype=float) - mass * r @ r
        z = np.zeros
        return cls(
            mass=mass,
            c0=mass * center,
            c1=z((3, 0)),
            c2=z((3, 0, 0)),
            j0=j0,
            j1=z((0, 3, 3)),
            j2=z((0, 0, 3, 3)),
            d0=z((0, 3)),
            d1=z((0, 0, 3)),
            d2=z((0, 0, 0, 3)),
            m0=z((0, 0)),
            m1=z((0, 0, 0)),
            m2=z((0, 0, 0, 0)),
        )

    @classmethod
    def from_particles(cls, mass: Array, fields: MassPointFields, complete: bool = False) -> "BodyInertia":
        """Sum over mass points (n_p,) with their :class:`ParticleFields`; ``complete``: with d2 and m2."""
        x0, s = fields.position, fields.linear
        n = s.shape[-1]
        h = fields.second if n else np.zeros((len(mass), 3, 0, 0))
        ms = mass[:, None, None] * s
        mx = mass[:, None] * x0

        def second_moment_to_inertia(e: Array) -> Array:
            result: Array = np.trace(e, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - e
            return result

        e0 = np.einsum("pi,pj->ij", mx, x0)
        e1 = np.einsum("pi,pjk->kij", mx, s)
        ss = np.einsum("pij,pkl->jlik", ms, s, optimize=True)
        xh = np.einsum("pi,pjkl->klij", mx, h, optimize=True)
        e2 = ss + np.swapaxes(ss, -1, -2) + xh + np.swapaxes(xh, -1, -2)
        sh = np.einsum("pik,pilj->klj", ms, h, optimize=True)
        cross_s = np.swapaxes(_axial(ss), 0, 1)
        cross_h = _axial(xh)
        d2, m2 = np.zeros((0, 0, 0, 3)), np.zeros((0, 0, 0, 0))
        if complete:
            swing = _axial(np.einsum("pij,pmkl->jklim", ms, h, optimize=True))  # ∫ S_j × H_kl dm
            outer = np.swapaxes(swing, 0, 1)
            d2 = 0.5 * (outer + np.swapaxes(outer, 1, 2) - swing)
            m2 = np.einsum("p,pikm,pilj->kmlj", mass, h, h, optimize=True)
        return cls(
            mass=float(mass.sum()),
            c0=mx.sum(axis=0),
            c1=ms.sum(axis=0),
            c2=np.einsum("p,pijk->ijk", mass, h),
            j0=second_moment_to_inertia(e0),
            j1=second_moment_to_inertia(e1 + np.swapaxes(e1, -1, -2)),
            j2=second_moment_to_inertia(e2),
            d0=_axial(e1),
            d1=cross_s + cross_h,
            d2=d2,
            m0=np.einsum("pij,pik->jk", ms, s, optimize=True),
            m1=sh + np.swapaxes(sh, 0, 1),
            m2=m2,
        )


def _axial(t: Array) -> Array:
    """∫ a × b dm from ∫ a bᵀ dm (…, 3, 3)."""
    return np.stack([t[..., 1, 2] - t[..., 2, 1], t[..., 2, 0] - t[..., 0, 2], t[..., 0, 1] - t[..., 1, 0]], -1)


@dataclass(frozen=True)
class ParticleFields:
    """Position (n_p, 3), linear (n_p, 3, n) and second-order (n_p, 3, n, n) displacement of mass points."""

    position: Array
    linear: Array
    _axis_second: Array = field(repr=False)
    _rotation: Array = field(repr=False)
    _offset: Array = field(repr=False)
    _gauss: NDArray[np.intp] = field(repr=False)

    @property
    def second(self) -> Array:
        """H of every mass point; large for nodal bases."""
        return self._axis_second[self._gauss] + SecondOrderField.of_offset(self._rotation[self._gauss], self._offset)

    def second_along(self, q: Array) -> Array:
        """H_p q (n_p, 3, n): how the displacement per coordinate changes with a deformation q (n,)."""
        axis = np.einsum("gijk,k->gij", self._axis_second, q, optimize=True)[self._gauss]
        theta, d = self._rotation[self._gauss], self._offset
        turned = theta @ q
        # ½ [θ_j (θ·d) + θ (θ_j·d)] − d (θ_j·θ)
        along = np.einsum("pi,pi->p", turned, d)
        mixed = theta * along[:, None, None] + np.einsum("pi,pj,pjk->pik", turned, d, theta, optimize=True)
        result: Array = axis + 0.5 * mixed - np.einsum("pi,pj,pjk->pik", d, turned, theta, optimize=True)
        return result

    def contract_second(self, force: Array) -> Array:
        """Σ_p force_p · H_p (n, n) without storing H of all points; force (n_p, 3)."""
        n_g = len(self._axis_second)
        per_gauss = np.zeros((n_g, 3))
        np.add.at(per_gauss, self._gauss, force)
        out = np.einsum("gi,gijk->jk", per_gauss, self._axis_second, optimize=True)
        theta = self._rotation[self._gauss]
        # ½ (θ_j·f θ_k·d + θ_k·f θ_j·d) − (f·d) θ_j·θ_k
        moment = np.einsum("pi,pj->pij", force, self._offset)
        trace = np.trace(moment, axis1=1, axis2=2)
        symmetric = 0.5 * (moment + np.swapaxes(moment, 1, 2)) - trace[:, None, None] * np.eye(3)
        result: Array = out + np.einsum("pij,pia,pjb->ab", symmetric, theta, theta, optimize=True)
        return result


def particle_fields(beam: Beam, basis: Array) -> ParticleFields:
    """Displacement fields of a beam's mass points for a basis (n_dof, n)."""
    basis = np.asarray(basis, dtype=float)
    theta = beam.gauss_rotation(basis)
    theta = theta.reshape(theta.shape[0] * theta.shape[1], 3, basis.shape[1])  # a basis may be empty
    return ParticleFields(
        position=beam.particle_position,
        linear=np.einsum("pia,an->pin", beam.particle_shape, basis, optimize=True),
        _axis_second=beam.second_order_field(basis).at_gauss(),
        _rotation=theta,
        _offset=beam._particle_offset,
        _gauss=beam.particle_gauss,
    )


@dataclass(frozen=True)
class FlexibleBody:
    """A body ready for a multibody system.

    Attributes
    ----------
    stiffness, damping : array (n, n)
        Of the elastic coordinates.
    markers : dict of str to Marker
        Named points to which joints attach.
    coordinate_names : tuple of str
        Names of the n elastic coordinates.
    """

    name: str
    inertia: BodyInertia
    stiffness: Array
    damping: Array
    markers: dict[str, Marker]
    coordinate_names: tuple[str, ...] = ()

    @property
    def n_elastic(self) -> int:
        """Number of elastic coordinates."""
        return len(self.stiffness)

    @classmethod
    def rigid(
        cls,
        name: str,
        mass: float,
        center: ArrayLike,
        inertia_about_center: ArrayLike,
        markers: Mapping[str, ArrayLike] | None = None,
    ) -> "FlexibleBody":
        """A rigid body; markers are given as name → position (3,)."""
        none = np.zeros
        points = {
            key: Marker(np.asarray(p, dtype=float), none((3, 0)), none((3, 0, 0)), none((3, 0)))
            for key, p in (markers or {"origin": np.zeros(3)}).items()
        }
        return cls(name, BodyInertia.rigid(mass, center, inertia_about_center), none((0, 0)), none((0, 0)), points)

    @classmethod
    def from_beam(
        cls,
        name: str,
        beam: Beam,
        basis: Array,
        damping_ratio: float = 0.0,
        markers: Mapping[str, float] | None = None,
        coordinate_names: Sequence[str] | None = None,
        complete: bool = False,
    ) -> "FlexibleBody":
        """A flexible body from a beam and a basis of nodal displacements.

        Parameters
        ----------
        basis : array (n_dof, n)
            Modes or unit vectors of nodal coordinates.
        damping_ratio : float
            Structural damping ratio of every column of the basis vibrating on its own in this body alone, clamped,
            without what other bodies will put on it; see :func:`shape_damping`.
        markers : dict of str to float, optional
            Arc lengths of named points on the axis, default {"root": 0, "tip": end}.
        coordinate_names : sequence of str, optional
        complete : bool
            Keep the fourth order of the elastic kinetic energy: for beams that bend by more than some per cent of their
            length and also twist. Its integrals and its cost grow with n⁴; meant for a dozen modes, not for nodes.
        """
        basis = np.asarray(basis, dtype=float)
        stiffness = basis.T @ beam.stiffness @ basis
        second = beam.second_order_field(basis)
        ends = {"root": beam.nodes[0], "tip": beam.nodes[-1]}
        points = {}
        for key, s in (ends | dict(markers or {})).items():
            u, theta = beam.linear_field(s, basis)
            points[key] = Marker(beam.sections.axis_at(s), u, second.at(s), theta)
        inertia = BodyInertia.from_particles(beam.particle_mass, particle_fields(beam, basis), complete)
        if beam.fluid_mass is not None:
            inertia = replace(inertia, m0=inertia.m0 + basis.T @ beam.fluid_mass @ basis)
        names = tuple(coordinate_names or (f"{name}_{i + 1}" for i in range(basis.shape[1])))
        return cls(name, inertia, stiffness, shape_damping(stiffness, inertia.m0, damping_ratio), points, names)


def without_second_order(body: FlexibleBody, beam: Beam, basis: Array) -> FlexibleBody:
    """The same body with the displacement r = x₀ + S q alone, and so without geometric stiffness.

    Parameters
    ----------
    basis : array (n_dof, n)
        From which the body was made.
    """
    fields, n = particle_fields(beam, basis), body.n_elastic
    none = np.zeros((len(beam.particle_mass), 3, n, n))
    linear = SimpleNamespace(position=fields.position, linear=fields.linear, second=none)
    inertia = BodyInertia.from_particles(beam.particle_mass, linear)
    markers = {key: replace(marker, second=np.zeros_like(marker.second)) for key, marker in body.markers.items()}
    return replace(body, inertia=inertia, markers=markers)


def shape_damping(stiffness: Array, mass: Array, ratio: float) -> Array:
    """Damping matrix of a body whose shapes, each vibrating in the body alone, all have the same damping ratio.

    In proportion to the stiffness, shape by shape (meant for modes or the like, not for unit displacements of nodes),

        C_jk = K_jk √(β_j β_k),   β_j = 2 ζ / ω_j,   ω_j² = K_jj / M_jj,

    with the frequency ω_j of shape j without anything else on the body. That is what published ratios mean (ElastoDyn's
    theory: ζ_j / (π f_j) K_jk with the frequencies of the tower without rotor and nacelle; J. M. Jonkman, Modeling of
    the UAE wind turbine for refinement of FAST_AD, NREL/TP-500-34755, 2003). Carrying something, the shape vibrates
    more slowly, at f, with the ratio ζ f / f_j: a tower of 1 % keeps about a third under its rotor.

    Parameters
    ----------
    stiffness, mass : array (n, n)
        Of the shapes, of the body alone.
    ratio : float
        ζ.

    Returns
    -------
    array (n, n)
    """
    if ratio == 0.0:
        return np.zeros_like(stiffness)
    scale = np.sqrt(2.0 * ratio) * (np.diag(mass) / np.diag(stiffness)) ** 0.25
    result: Array = scale[:, None] * stiffness * scale
    return result


def offset_marker(
    beam: Beam, basis: Array, s: float, offset: ArrayLike, second: SecondOrderField | None = None
) -> Marker:
    """Marker of a point rigidly carried by the section at arc length s.

    Parameters
    ----------
    basis : array (n_dof, n)
    s : float
        Arc length [m].
    offset : array (3,)
        From the reference axis to the point, in the body frame [m].
    second : SecondOrderField, optional
        Of the basis, to avoid computing it for each point.
    """
    second = second or beam.second_order_field(basis)
    u, theta = beam.linear_field(s, basis)
    offset = np.asarray(offset, dtype=float)
    quadratic = second.at(s) + SecondOrderField.of_offset(theta[None], offset[None])[0]
    return Marker(beam.sections.axis_at(s) + offset, u - skew(offset) @ theta, quadratic, theta)
