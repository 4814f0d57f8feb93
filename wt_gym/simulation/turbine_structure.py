"""The turbine as a multibody system: tower, yawing nacelle, generator, hub and pitching blades.

Every joint is written in the conventions of the project: global x downwind, z up; the shaft frame is the nacelle frame
turned by the tilt about y; blade i hangs on the hub turned by 2πi/n about the shaft and by the cone about y; a positive
pitch turns the blade about its z axis by minus the angle.

Blades of several floating-frame bodies: large deflections, and the torsion that bending makes, from small ones.

A blade is cut into sub-bodies (:mod:`wt_gym.structure.substructure`), each a body whose frame is clamped to the tip
section of the sub-body before it. The lattice nodes of a blade are shared out among the sub-bodies that carry their
sections.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypedDict

import numpy as np

from wt_gym.base.errors import SimulationError
from wt_gym.base.quantities import Array, Integers
from wt_gym.multibody.arrays import Points, Work
from wt_gym.multibody.system import Constraint, Joint, MultibodySystem
from wt_gym.simulation.fidelity import Fidelity
from wt_gym.structure.beam import Beam, BeamSections, skew
from wt_gym.structure.flexible_body import BodyInertia, FlexibleBody, offset_marker, without_second_order
from wt_gym.structure.modes import body_from_beam, clamped_modes, nodal_basis, node_names, select_modes
from wt_gym.structure.substructure import SubBody, cut_beam, sub_body_at
from wt_gym.turbines import Blade, Tower, Turbine
from wt_gym.turbines.blade import iced_structure

IDEAL_PITCH_SERVO = 4.0 * np.pi
"""Frequency of the servo that stands for an ideal pitch drive [rad/s] in linear models; in simulations such a drive is
prescribed (`wt_gym.simulation.drivetrain.drives.PitchDrives`)."""
DRAG_POINTS = 7
"""Points of the tower that bear its drag, an odd number: Simpson's rule is exact for a cone in a uniform wind."""
_GAP = 1e-9
"""Over which the sections of a support change into those of its tower, over the length of the support."""
YAW_SERVO = 2.0 * np.pi
"""Natural frequency of the yaw drive, critically damped [rad/s]."""


@dataclass(frozen=True)
class TurbineStructure:
    """Multibody model of a turbine with what the coupling to the air needs."""

    system: MultibodySystem
    tower: int
    nacelle: int
    generator: int
    hub: int  #: tower, nacelle, generator, hub: body indices
    blades: tuple[int, ...]  #: Body indices; of the roots, where a blade has several bodies
    parts: tuple[tuple[int, ...], ...]  #: Of each blade the indices of its bodies, from root to tip
    blade_inertia: BodyInertia  #: Of a whole undeformed blade
    lattice_points: Points
    """Material points of one blade, (n_bodies, n, 3), and their mode shapes, by the bodies of the blade: mostly one."""
    sub_body_nodes: SubBodyNodes | None  #: Which lattice nodes each body of a blade carries; None: a blade is one body
    tip_points: Points  #: The blade tip, one point of the last body of a blade
    tip_rest: Array  #: The undeformed tip in the frame of the whole blade [m]; array (3,)
    tower_points: Points  #: Tower axis, for pictures
    tower_radius: Array  #: At the tower points [m]; array (n,)
    drag_points: Points  #: Points of the tower that bear its drag
    blade_field: tuple[Beam, Array]
    tower_field: tuple[Beam, Array]
    """blade_field, tower_field: finite elements of a blade and the tower, and the nodal displacements of their
    coordinates; (Beam, array (n_dof, n))."""
    floater: int | None  #: Body index of a platform, on a Cardan joint at the still water level; None on the ground
    tower_sway: Array
    """Elastic coordinates of the tower as it swings in the first mode along global x and y, for 1 m of its top; array
    (n_f, 2)."""

    def elastic(self, body: int, y: Array) -> tuple[Array, Array]:
        """Elastic coordinates and rates (n_f,) of a body in a state, views."""
        q, u = self.system.index(body, "elastic_q"), self.system.n_q + self.system.index(body, "elastic_u")
        n = self.system.bodies[body].n_elastic
        return y[q : q + n], y[u : u + n]

    @property
    def n_motion(self) -> int:
        """Numbers of a `motion`."""
        return sum(map(len, self._moving))

    @property
    def _moving(self) -> tuple[Integers, Integers, Integers]:
        """Places of all that moves beside generator and drives, (coordinates, velocities), in a state and its rate."""
        system = self.system
        q, u = np.arange(system.n_q), system.n_q + np.arange(system.n_u)
        others = u[u != system.n_q + self.azimuth_u]
        return q[q != self.azimuth_q], others, others

    def motion(self, y: Array, dy: Array, heading: float) -> Array:
        """Deformation, its rates and accelerations, those of the tower along and across a heading.

        Parameters
        ----------
        y, dy : array (n_state,)
            State and its rate.
        heading : float
            Counter-clockwise from x [rad].

        Returns
        -------
        array (n_motion,)
        """
        y, dy = y.copy(), dy.copy()
        for each in (y, dy):
            self._turn_tower(each, -heading)
        q, u, a = self._moving
        return np.concatenate([y[q], y[u], dy[a]])

    def move(self, y: Array, motion: Array, heading: float) -> Array:
        """Put deformation and rates of a `motion` into a state, in place; returns the accelerations (n_u - 1,)."""
        q, u, a = self._moving
        dy = np.zeros(len(y))
        y[q], y[u], dy[a] = np.split(motion, [len(q), len(q) + len(u)])
        for each in (y, dy):
            self._turn_tower(each, heading)
        return dy[a]

    def _turn_tower(self, y: Array, angle: float) -> None:
        """Turn the bending of the tower about z, in place: its modes have the same shapes along x and y."""
        _, basis = self.tower_field
        top = basis[-6:-4]  # displacement of the top along x and y
        along, across = np.flatnonzero(top[0]), np.flatnonzero(top[1])
        cos, sin = np.cos(angle), np.sin(angle)
        for part in self.elastic(self.tower, y):
            x, z = top[0, along] * part[along], top[1, across] * part[across]
            part[along] = (cos * x - sin * z) / top[0, along]
            part[across] = (sin * x + cos * z) / top[1, across]

    def platform(self, y: Array) -> Array:
        """Coordinates of a floater and their rates (12,) in a state y [m, rad; m/s, rad/s]."""
        assert self.floater is not None
        q, n = self.system.index(self.floater, "joint_q"), self.system.n_q
        u = n + self.system.index(self.floater, "joint_u")
        return np.concatenate([y[q : q + 6], y[u : u + 6]])

    def tower_deflection(self, work: Work) -> tuple[Array, Array]:
        """Displacement (2,) of the tower top along x and y of the tower's base, and its rate [m], [m/s]."""
        tower, nacelle = self.tower, self.nacelle
        turn = work.rot[tower].T
        lever = turn @ (work.r[nacelle] - work.r[tower])
        rate = turn @ work.rot[nacelle] @ work.v[nacelle] - work.v[tower] - np.cross(work.omega[tower], lever)
        return lever[:2], rate[:2]

    def adopt(self, other: TurbineStructure, y: Array) -> Array:
        """State of this structure for the same motion as the state y of another formulation of the same turbine.

        Parameters
        ----------
        y : array (other.system.n_state,)

        Returns
        -------
        array (n_state,)
        """
        mine, theirs = self.system, other.system
        z: Array = mine.initial_state()
        for body in range(len(mine.bodies)):
            for own, given in zip(self.elastic(body, z), other.elastic(body, y), strict=True):
                own[:] = given
            if mine.joints[body].kind in ("revolute", "cardan"):
                n = mine.joints[body].n_velocity
                for what, here, there in (("joint_q", 0, 0), ("joint_u", mine.n_q, theirs.n_q)):
                    here, there = here + mine.index(body, what), there + theirs.index(body, what)
                    z[here : here + n] = y[there : there + n]
        z[mine.n_q + mine.n_u :] = y[theirs.n_q + theirs.n_u :]
        mine.place_free_bodies(z)
        return z

    @property
    def beams(self) -> dict[str, tuple[Beam, Array]]:
        """Finite elements and basis (Beam, array) of the flexible bodies, by the name of the body."""
        return {"tower": self.tower_field} | {self.system.bodies[b].name: self.blade_field for b in self.blades}

    @property
    def lattice_bodies(self) -> Integers:
        """Bodies that carry lattice points (n_blades n_sub_bodies,), blade by blade."""
        return np.array([b for parts in self.parts for b in parts])

    @property
    def azimuth_q(self) -> int:
        """Index of the generator azimuth among the coordinates."""
        return int(self.system.index(self.generator, "joint_q"))

    @property
    def yaw_flexible(self) -> bool:
        """Whether a spring connects the nacelle to its yaw drive."""
        return self.system.joints[self.nacelle].kind == "revolute"

    @property
    def shaft_flexible(self) -> bool:
        """Whether the shaft has a torsion coordinate."""
        return self.system.joints[self.hub].kind == "revolute"

    @property
    def azimuth_u(self) -> int:
        """Index of the generator speed among the velocities."""
        return int(self.system.index(self.generator, "joint_u"))


def rotation_y(angle: float) -> Array:
    """Rotation matrix about y."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def rotation_x(angle: float) -> Array:
    """Rotation matrix about x."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def build_structure(
    turbine: Turbine, fidelity: Fidelity, lattice_nodes: Array, generator_damping: float = 0.0
) -> TurbineStructure:
    """Assemble the multibody system of a turbine.

    Parameters
    ----------
    lattice_nodes : array (..., 3)
        Points of the undeformed blade in the blade frame [m] that will carry aerodynamic loads.
    generator_damping : float
        Damper between nacelle and rotor [N m s/rad, low-speed shaft].
    """
    blade_beam, blade_basis, blade_body = _blade(turbine.blade, fidelity)
    if _deforms_linearly(fidelity):
        blade_body = without_second_order(blade_body, blade_beam, blade_basis)
    system = MultibodySystem(stabilization=fidelity.stabilization, projection=fidelity.projection)
    tower_body, tower_points, tower_radius, drag_points, tower_field, sway = _tower(turbine, fidelity, blade_body)
    floater = _add_floater(system, turbine, fidelity)
    tower = system.add(tower_body, Joint("fixed", offset=(0.0, 0.0, turbine.tower.base_height)), floater)
    nacelle = _add_nacelle(system, turbine, tower, fidelity.yaw_drive)
    inertia = blade_body.inertia
    generator, hub = _add_drivetrain(system, turbine, nacelle, inertia, fidelity.stiffest_shaft, generator_damping)
    sub_bodies: tuple[SubBody, ...] = ()
    if fidelity.blade_bodies > 1:
        sub_bodies = cut_blade(turbine.blade, blade_beam, fidelity, _blade_dofs(turbine.blade, blade_beam, fidelity))
    bodies: list[FlexibleBody | tuple[SubBody, ...]] = [sub_bodies or blade_body] * turbine.n_blades
    if turbine.ice is not None:
        bodies[turbine.ice.blade - 1] = _iced_body(turbine.blade, turbine.ice.level, blade_basis, blade_body, fidelity)
    parts = tuple(_add_blade(system, turbine, hub, body, i, fidelity.formulation) for i, body in enumerate(bodies))
    tip = np.asarray(turbine.blade.axis_at(turbine.blade.length))
    nodes, carried = np.reshape(lattice_nodes, (-1, 3)), None
    if sub_bodies:
        lattice_points, carried = sub_body_points(sub_bodies, nodes)
        tip_points = tip_of_last_sub_body(sub_bodies, tip)
    else:
        whole = body_points(blade_beam, blade_basis, nodes)
        lattice_points = Points(*(shapes[None] for shapes in whole))
        tip_points = body_points(blade_beam, blade_basis, tip[None])
    return TurbineStructure(
        system=system.build(),
        tower=tower,
        nacelle=nacelle,
        generator=generator,
        hub=hub,
        blades=tuple(bodies[0] for bodies in parts),
        parts=parts,
        blade_inertia=blade_body.inertia,
        lattice_points=lattice_points,
        sub_body_nodes=carried,
        tip_points=tip_points,
        tip_rest=tip if sub_bodies else tip_points.position[0],
        tower_points=tower_points,
        tower_radius=tower_radius,
        drag_points=drag_points,
        blade_field=(blade_beam, blade_basis),
        tower_field=tower_field,
        floater=floater,
        tower_sway=sway,
    )


def _blade(blade: Blade, fidelity: Fidelity) -> tuple[Beam, Array, FlexibleBody]:
    """Finite-element model, modal basis and body of one blade (the same for all blades)."""
    axis = _axis_at_stations(blade)
    sections = BeamSections(blade.structure.station, blade.structure.stiffness, blade.structure.inertia, axis)
    beam = Beam(sections, fidelity.blade_elements)
    if fidelity.blade_bodies > 1:  # its sub-bodies bend: what shapes the tower and sizes the shaft is the blade at rest
        basis = nodal_basis(beam, ())
        body = FlexibleBody.from_beam("blade", beam, basis)
    elif fidelity.blade_coordinates == "modal":
        basis, names = _blade_modes(beam, fidelity)
        twists = fidelity.blade_modes[2] > 0
        body = FlexibleBody.from_beam("blade", beam, basis, blade.damping_ratio, None, names, twists)
    else:
        dofs = _blade_dofs(blade, beam, fidelity) if fidelity.blade_coordinates == "nodal" else ()
        basis = nodal_basis(beam, dofs)
        body = body_from_beam("blade", beam, "nodal", dofs=dofs, damping_ratio=blade.damping_ratio)
        body = replace(body, coordinate_names=tuple(node_names(beam, dofs)))  # the blades get numbers on the hub
    return beam, basis, body


def _iced_body(blade: Blade, level: float, basis: Array, sound: FlexibleBody, fidelity: Fidelity) -> FlexibleBody:
    """Body of a blade with ice, in the coordinates of the others: their shapes, stiffness and damping."""
    if fidelity.blade_bodies > 1 or fidelity.blade_coordinates != "modal" or fidelity.blade_basis != "fixed":
        raise SimulationError(
            "ice on a blade needs Fidelity.blade_bodies 1, blade_coordinates 'modal' and blade_basis 'fixed', got "
            f"{fidelity.blade_bodies}, {fidelity.blade_coordinates!r} and {fidelity.blade_basis!r}"
        )
    sections = BeamSections(
        blade.structure.station, blade.structure.stiffness, iced_structure(blade, level).inertia,
        _axis_at_stations(blade),
    )  # fmt: skip
    beam = Beam(sections, fidelity.blade_elements)
    twists = fidelity.blade_modes[2] > 0
    made = FlexibleBody.from_beam("blade", beam, basis, 0.0, None, sound.coordinate_names, twists)
    if _deforms_linearly(fidelity):
        made = without_second_order(made, beam, basis)
    return replace(sound, inertia=made.inertia, markers=made.markers)


def _blade_dofs(blade: Blade, beam: Beam, fidelity: Fidelity) -> tuple[int, ...]:
    """Degrees of freedom of the nodes of a blade."""
    dofs = _moving_dofs(fidelity.blade_modes)
    if np.ptp(beam.sections.axis[:, :2], axis=0).max() > 1e-6 * blade.length:
        dofs = tuple(sorted({*dofs, 2}))  # a curved axis bends only if its nodes may also move along z
    return dofs


def _moving_dofs(modes: tuple[int, int, int]) -> tuple[int, ...]:
    """Degrees of freedom of a node for the counts of modes along x, along y and in torsion."""
    planes = ((0, 4), (1, 3), (5,))
    return tuple(sorted(dof for plane, count in zip(planes, modes, strict=True) if count for dof in plane))


def _blade_modes(beam: Beam, fidelity: Fidelity) -> tuple[Array, list[str]]:
    """Modes of a blade and their names."""
    flap, edge, torsion = fidelity.blade_modes
    node_dofs = bending_dofs(fidelity.blade_modes)
    modes = clamped_modes(beam, min(len(node_dofs) * fidelity.blade_elements, 40), node_dofs=node_dofs)
    try:
        chosen = select_modes(modes, flap=flap, edge=edge, torsion=torsion)
    except ValueError as error:
        raise SimulationError(
            f"Fidelity.blade_modes is {fidelity.blade_modes}: {error}, from Fidelity.blade_elements = "
            f"{fidelity.blade_elements}"
        ) from error
    names = [f"flap_{i + 1}" for i in range(flap)] + [f"edge_{i + 1}" for i in range(edge)]
    names += [f"torsion_{i + 1}" for i in range(torsion)]
    return modes.shape[:, chosen], names


def bending_dofs(counts: tuple[int, int, int]) -> tuple[int, ...]:
    """Directions in which the nodes of a blade move in its modes, for the counts of flap, edge and torsion modes.

    A bending mode carries the twist that its inertial loads make as it vibrates. Without torsion modes nothing could
    undo that twist under other loads: flap would feather the blade by 0.3 degrees a meter, so bending stays bending.
    """
    return (0, 1, 2, 3, 4, 5) if counts[2] else (0, 1, 2, 3, 4)


def _axis_at_stations(blade: Blade) -> Array:
    """Reference axis at the structural stations (n, 3)."""
    s = blade.structure.station
    return np.column_stack([np.interp(s, blade.axis_station, blade.axis[:, k]) for k in range(3)])


def rotor_nacelle_inertia(turbine: Turbine, blade_inertia: BodyInertia) -> Array:
    """Mass matrix (6, 6) of everything on the tower top about the yaw bearing, symmetric about the x–z plane.

    Used only to shape the tower's modes: the blades enter by their rigid-body inertia averaged over the azimuth.
    """
    hub, nacelle, drive = turbine.hub, turbine.nacelle, turbine.drivetrain
    n = turbine.n_blades
    blade_mass = blade_inertia.mass
    reach = hub.radius + blade_inertia.c0[2] / blade_mass
    rotor_inertia = rotor_axial_inertia(turbine, blade_inertia)
    rotor_mass = hub.mass + n * blade_mass
    axial = rotor_inertia + drive.generator_inertia  # neither shaft turns against the nacelle
    across = hub.inertia_transverse + 0.5 * (rotor_inertia - hub.inertia_axial)
    tilt = rotation_y(nacelle.tilt)
    center = np.array([0.0, 0.0, nacelle.tower_top_to_shaft]) + tilt @ [-nacelle.overhang, 0.0, 0.0]
    center = center + tilt @ [-np.sin(hub.cone) * reach * n * blade_mass / rotor_mass, 0.0, 0.0]
    total = np.zeros((6, 6))
    parts = [
        (rotor_mass, center, tilt @ np.diag([axial, across, across]) @ tilt.T),
        (nacelle.mass, nacelle.cm, nacelle.inertia),
        (nacelle.yaw_bearing_mass, np.zeros(3), np.zeros((3, 3))),
    ]
    for mass, c, inertia in parts:
        r = skew(c)
        total[:3, :3] += mass * np.eye(3)
        total[:3, 3:] -= mass * r
        total[3:, :3] += mass * r
        total[3:, 3:] += inertia - mass * r @ r
    return total


def averaged_over_yaw(mass: Array) -> Array:
    """Mean of a mass matrix (6, 6) on the tower top over the yaw angle of the nacelle.

    With it the bending modes of a round tower have the same shapes in both planes, so that they span the same
    deflections whichever way the nacelle faces. The mean over four quarter turns is that over all angles: a tensor of
    second rank has no harmonic of the angle beyond the second.
    """
    quarter = np.kron(np.eye(2), [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turns = [np.linalg.matrix_power(quarter, k) for k in range(4)]
    return np.asarray(np.mean([turn @ mass @ turn.T for turn in turns], axis=0))


def tower_beam(tower: Tower, elements: int) -> Beam:
    """Finite-element model of a tower in that many elements, and in as short ones of the support it may stand on.

    The frame lies at the base of the tower; a support reaches below it.
    """
    table, support = tower.structure, tower.support
    if support is None:
        return Beam(_upright(table.station, table.stiffness, table.inertia, 0.0), elements)
    below = support.length
    n_below = max(round(elements * below / tower.length), 2)
    nodes = np.concatenate(
        [np.linspace(0.0, below, n_below + 1)[:-1], below + np.linspace(0.0, tower.length, elements + 1)]
    )
    station = np.concatenate([support.structure.station, below + table.station])
    station[len(support.structure.station)] += _GAP * below
    stiffness = np.concatenate([support.structure.stiffness, table.stiffness])
    inertia = np.concatenate([support.structure.inertia, table.inertia])
    lumps = [(n_below, support.top_mass)] if support.top_mass > 0.0 else []
    return Beam(_upright(station, stiffness, inertia, below), nodes, support.foundation, support.added_mass_at, lumps)


def _upright(station: Array, stiffness: Array, inertia: Array, below: float) -> BeamSections:
    """Sections of a straight beam along z that begins below the origin [m]."""
    axis = np.zeros((len(station), 3))
    axis[:, 2] = station - below
    return BeamSections(station, stiffness, inertia, axis)


def _deforms_linearly(fidelity: Fidelity) -> bool:
    """Whether bodies have no second-order displacement, as in observer frames as published."""
    return fidelity.formulation == "observer" and fidelity.frame_displacement == "linear"


def _tower(
    turbine: Turbine, fidelity: Fidelity, blade_body: FlexibleBody
) -> tuple[FlexibleBody, Points, Array, Points, tuple[Beam, Array], Array]:
    """Tower body in plane bending and torsion modes shaped by the tower-top mass, with the support below."""
    _check_support(turbine, fidelity)
    tower, beam = turbine.tower, tower_beam(turbine.tower, fidelity.tower_elements)
    top = averaged_over_yaw(rotor_nacelle_inertia(turbine, blade_body.inertia))
    if fidelity.tower_coordinates == "modal":
        basis, names = _tower_modes(beam, fidelity, top)
        body = FlexibleBody.from_beam("tower", beam, basis, tower.damping_ratio, None, names)
    else:
        dofs = _moving_dofs(fidelity.tower_modes) if fidelity.tower_coordinates == "nodal" else ()
        basis, ratio = nodal_basis(beam, dofs), tower.damping_ratio
        body = body_from_beam("tower", beam, "nodal", dofs=dofs, tip_mass=top, damping_ratio=ratio)
    if _deforms_linearly(fidelity):
        body = without_second_order(body, beam, basis)
    height, radius = _axis_points(tower)
    points, for_drag = (body_points(beam, basis, z[:, None] * [0.0, 0.0, 1.0]) for z in (height, drag_heights(tower)))
    return body, points, radius, for_drag, (beam, basis), _first_modes(beam, basis, top)


def _first_modes(beam: Beam, basis: Array, top: Array) -> Array:
    """Coordinates of the first bending mode under the top mass in either plane (n, 2), for 1 m of the tower top.

    Of coordinates that do not span the mode, the nearest in displacement of the nodes; zero where there are none.
    """
    sway = np.zeros((basis.shape[1], 2))
    for k, dofs in enumerate(((0, 4), (1, 3))):
        mode = clamped_modes(beam, 1, tip_mass=top, node_dofs=dofs).shape[:, 0]
        mode /= mode[-6 + dofs[0]]
        sway[:, k] = np.linalg.lstsq(basis, mode, rcond=None)[0]
        reached = basis[-6 + dofs[0]] @ sway[:, k]
        sway[:, k] = sway[:, k] / reached if abs(reached) > 0.5 else 0.0
    return sway


def _check_support(turbine: Turbine, fidelity: Fidelity) -> None:
    """Refuse what takes the base of the tower as clamped."""
    if turbine.tower.support is None:
        return
    for name, given in (("formulation", fidelity.formulation == "observer"), ("tower_shapes", fidelity.tower_shapes)):
        if given:
            raise SimulationError(
                f"turbine {turbine.name!r} stands on a support; Fidelity.{name} = {getattr(fidelity, name)!r} needs a "
                "tower that is clamped at its base: choose another, or a turbine whose tower.support is None"
            )


def _axis_points(tower: Tower) -> tuple[Array, Array]:
    """Heights above the base [m] of points of the axis, with those of a support, and the radii there [m]."""
    height = np.linspace(0.0, tower.length, 13)
    radius = 0.5 * np.asarray(tower.diameter_at(height))
    if tower.support is None:
        return height, radius
    below = np.linspace(0.0, tower.support.length, 5)[:-1]
    return (
        np.concatenate([below - tower.support.length, height]),
        np.concatenate([0.5 * tower.support.diameter_at(below), radius]),
    )


def drag_heights(tower: Tower) -> Array:
    """Distances from its base [m] at which the drag of a tower acts, the places of Simpson's rule."""
    return np.linspace(0.0, tower.length, DRAG_POINTS)


def _tower_modes(beam: Beam, fidelity: Fidelity, top: Array) -> tuple[Array, list[str]]:
    """Plane modes or prescribed shapes of the tower under its top mass, and their names."""
    planes = {"fore_aft": (0, 4), "side_side": (1, 3), "torsion": (5,)}
    basis, names = [], []
    for (plane, dofs), count in zip(planes.items(), fidelity.tower_modes, strict=True):
        if count == 0:
            continue
        names += [f"{plane}_{i + 1}" for i in range(count)]
        if fidelity.tower_shapes is not None and plane != "torsion":
            basis.append(_polynomial_shapes(beam, plane, fidelity.tower_shapes[plane == "side_side"]))
            continue
        most = len(dofs) * fidelity.tower_elements
        if count > most:
            raise SimulationError(
                f"Fidelity.tower_modes is {fidelity.tower_modes}: {plane} modes must be at most {most} "
                f"with Fidelity.tower_elements = {fidelity.tower_elements}, got {count}"
            )
        basis.append(clamped_modes(beam, count, tip_mass=top, node_dofs=dofs).shape)
    return np.hstack(basis), names


def _polynomial_shapes(beam: Beam, plane: str, shapes: Sequence[Sequence[float]]) -> Array:
    """Nodal displacements (n_dof, n) of bending shapes given by the coefficients of (z/H)², (z/H)³, …"""
    height = beam.nodes[-1]
    basis = np.zeros((beam.n_dof, len(shapes)))
    # a displacement along y turns the section about −x
    move, turn, sign = (0, 4, 1.0) if plane == "fore_aft" else (1, 3, -1.0)
    for k, coefficients in enumerate(shapes):
        polynomial = np.polynomial.Polynomial([0.0, 0.0, *coefficients])
        scale = 1.0 / polynomial(1.0)
        basis[move::6, k] = scale * polynomial(beam.nodes / height)
        basis[turn::6, k] = sign * scale * polynomial.deriv()(beam.nodes / height) / height
    return basis


def _add_floater(system: MultibodySystem, turbine: Turbine, fidelity: Fidelity) -> int | None:
    """Rigid platform with the water that moves with it, if the turbine floats."""
    floater = turbine.floater
    if floater is None:
        return None
    if fidelity.formulation == "observer" or fidelity.tower_body is not None or fidelity.nacelle_body is not None:
        raise SimulationError(
            f"{turbine.name!r} floats: Fidelity.formulation must be 'embedded' or 'constrained' without tower_body and "
            f"nacelle_body, got {fidelity.formulation!r}, {fidelity.tower_body} and {fidelity.nacelle_body}"
        )
    body = FlexibleBody.rigid("floater", floater.mass, floater.center, floater.inertia)
    index = int(system.add(body, Joint("cardan", name="platform")))
    added = floater.radiation.added_mass_infinite
    system.add_water(index, 0.5 * (added + added.T))  # of panel codes the two sides differ in the fifth digit
    return index


def _add_nacelle(system: MultibodySystem, turbine: Turbine, tower: int, yaw_drive: str) -> int:
    """Rigid nacelle with the yaw bearing, driven about the tower's z axis, on request through the yaw spring."""
    nacelle = turbine.nacelle
    mass = nacelle.mass + nacelle.yaw_bearing_mass
    center = nacelle.mass * nacelle.cm / mass
    r, b = skew(nacelle.cm - center), skew(-center)
    inertia = nacelle.inertia - nacelle.mass * r @ r - nacelle.yaw_bearing_mass * b @ b
    body = FlexibleBody.rigid("nacelle", mass, center, inertia)
    drive = Joint("servo", (0.0, 0.0, 1.0), servo_frequency=YAW_SERVO, servo_damping=1.0, name="yaw")
    if yaw_drive == "stiff":
        return int(system.add(body, drive, tower, "tip"))
    if not nacelle.yaw_spring > 0.0:
        raise SimulationError(
            f"turbine {turbine.name!r}: yaw spring is {nacelle.yaw_spring}; yaw_drive='spring' needs one"
        )
    gear = system.add(FlexibleBody.rigid("yaw_drive", 0.0, np.zeros(3), np.zeros((3, 3))), drive, tower, "tip")
    spring = Joint(
        "revolute", (0.0, 0.0, 1.0), None, (0.0, 0.0, 0.0), nacelle.yaw_spring, nacelle.yaw_damper, name="yaw_twist"
    )
    return int(system.add(body, spring, gear))


def rotor_axial_inertia(turbine: Turbine, blade_inertia: BodyInertia) -> float:
    """Inertia of hub and undeformed blades about the shaft [kg m²], cone neglected."""
    radius, mass = turbine.hub.radius, blade_inertia.mass
    second = 0.5 * float(np.trace(blade_inertia.j0)) + 2.0 * radius * blade_inertia.c0[2] + mass * radius**2
    return float(turbine.hub.inertia_axial + turbine.n_blades * second)


def _add_drivetrain(
    system: MultibodySystem, turbine: Turbine, nacelle: int, blade_inertia: BodyInertia, stiffest: float, damping: float
) -> tuple[int, int]:
    """Generator and damper on the shaft axis, hub behind the shaft's torsion spring, if that is not too stiff.

    The body "generator" is the massless end of the low-speed shaft in the gearbox. The rotor of the generator is geared
    to its joint: it turns in the nacelle at ± N times the speed, so that it weighs N² J_g on the shaft, while nacelle
    and yaw bearing feel its angular momentum ± N J_g Ω and the torque that reaches the gearbox (`Joint.rotor_inertia`).
    """
    drive, hub = turbine.drivetrain, turbine.hub
    generator = FlexibleBody.rigid("generator", 0.0, np.zeros(3), np.zeros((3, 3)))
    joint = Joint(
        "revolute",
        (1.0, 0.0, 0.0),
        rotation=rotation_y(turbine.nacelle.tilt),
        offset=(0.0, 0.0, turbine.nacelle.tower_top_to_shaft),
        damping=damping,
        name="azimuth",
        rotor_inertia=drive.generator_inertia,
        rotor_ratio=drive.speed_ratio,
    )
    shaft = system.add(generator, joint, nacelle)
    if not drive.spring > 0.0:
        raise SimulationError(f"turbine {turbine.name!r}: drivetrain spring is {drive.spring}; it must be positive")
    body = FlexibleBody.rigid(
        "hub",
        hub.mass,
        (hub.cm_offset_along_shaft, 0.0, 0.0),
        np.diag([hub.inertia_axial, hub.inertia_transverse, hub.inertia_transverse]),
    )
    offset = (-turbine.nacelle.overhang, 0.0, 0.0)
    at_shaft = drive.generator_inertia * drive.gear_ratio**2
    compliance = 1.0 / at_shaft + 1.0 / rotor_axial_inertia(turbine, blade_inertia)
    if np.sqrt(drive.spring * compliance) > 2.0 * np.pi * stiffest:
        torsion = Joint("fixed", offset=offset, name="shaft")
    else:
        torsion = Joint("revolute", (1.0, 0.0, 0.0), None, offset, drive.spring, drive.damper, name="shaft_torsion")
    return shaft, system.add(body, torsion, shaft)


class _Bearing(TypedDict):
    """A pitch bearing, as joint or constraint; see `Joint`."""

    axis: tuple[float, float, float]
    rotation: Array
    offset: tuple[float, float, float]
    servo_frequency: float
    servo_damping: float
    name: str


def _add_blade(
    system: MultibodySystem,
    turbine: Turbine,
    hub: int,
    blade: FlexibleBody | tuple[SubBody, ...],
    i: int,
    formulation: str,
) -> tuple[int, ...]:
    """Blade i, one body or several, on its pitch bearing, a joint or six equations; its bodies from root to tip.

    The servo angle is the pitch (about minus z).
    """
    root = rotation_x(2.0 * np.pi * i / turbine.n_blades) @ rotation_y(-turbine.hub.cone)
    bearing: _Bearing = {
        "axis": (0.0, 0.0, -1.0),
        "rotation": root,
        "offset": tuple((root @ [0.0, 0.0, turbine.hub.radius]).tolist()),
        "servo_frequency": turbine.pitch.servo_frequency or IDEAL_PITCH_SERVO,
        "servo_damping": turbine.pitch.servo_damping,
        "name": f"pitch_{i + 1}",
    }
    name = f"blade_{i + 1}"

    def add_root(body: FlexibleBody) -> int:
        if formulation != "constrained":
            return system.add(body, Joint("servo", **bearing), hub)
        root_body = int(system.add(body, Joint("free", name=f"{name}_frame")))
        system.add_constraint(Constraint("weld", **bearing), hub, root_body, second_marker="root")
        return root_body

    if isinstance(blade, FlexibleBody):
        names = tuple(f"{name}_{n}" for n in blade.coordinate_names)
        return (add_root(replace(blade, name=name, coordinate_names=names)),)
    return add_sub_bodies(system, blade, add_root, name)


def body_points(beam: Beam, basis: Array, points: Array) -> Points:
    """Shapes of points (n, 3) carried rigidly by the beam section at the same height z of the body frame."""
    second = beam.second_order_field(basis)
    axis_z = beam.sections.axis[:, 2]
    markers = []
    for p in points:
        s = float(np.interp(p[2], axis_z, beam.sections.station))
        markers.append(offset_marker(beam, basis, s, p - beam.sections.axis_at(s), second))
    return Points(
        np.array([m.position for m in markers]),
        np.ascontiguousarray([m.linear for m in markers]),
        np.ascontiguousarray([m.second for m in markers]),
    )


class SubBodyNodes(NamedTuple):
    """Which lattice nodes of a blade each of its n sub-bodies carries, and room for them; short rows end in zeros."""

    count: Integers  # type: ignore[assignment]  # (n,); hides the method of tuples
    node: Integers  # (n, n_most) among the nodes of a blade
    position: Array  # (n_most, 3) scratch: of the nodes of one sub-body, or their forces
    velocity: Array  # (n_most, 3) scratch


def cut_blade(blade: Blade, beam: Beam, fidelity: Fidelity, dofs: tuple[int, ...]) -> tuple[SubBody, ...]:
    """Sub-bodies of a blade, from root to tip.

    Nodal sub-bodies have the displacements of their nodes as coordinates, modal ones the static shapes of their tip,
    one for each degree of freedom.

    The damping of a sub-body is in proportion to its stiffness, direction by direction, C_jk = K_jk √(β_j β_k), as in
    geometrically exact beam codes (Wang et al., Wind Energy 20, 2017, 1439, section 2): β = 2 ζ/ω, with the lowest
    frequency ω of the whole blade, clamped, for flap, edge and torsion. These modes then have the published ratio, and
    higher ones more, in proportion to their frequencies.

    Parameters
    ----------
    beam : Beam
        Of the whole blade.
    dofs : tuple of int
        Degrees of freedom of a node that may move.

    Raises
    ------
    SimulationError
        If there are more sub-bodies than finite elements.
    """
    if fidelity.blade_bodies > fidelity.blade_elements:
        raise SimulationError(
            f"Fidelity.blade_bodies is {fidelity.blade_bodies}: Fidelity.blade_elements = {fidelity.blade_elements} "
            f"make at most as many bodies"
        )
    if np.abs(beam.sections.axis[0]).max() > 1e-9:
        raise SimulationError(
            f"Fidelity.blade_bodies is {fidelity.blade_bodies}: the axis of the blade begins at "
            f"{beam.sections.axis[0]} m from the pitch axis; sub-bodies need one that begins there"
        )
    sub_bodies = cut_beam(
        "blade", beam.sections, beam.nodes, fidelity.blade_bodies, fidelity.blade_coordinates, dofs=dofs
    )
    by_dof = np.sqrt(_damping_times(blade, beam, dofs))
    damped = []
    for sub_body in sub_bodies:
        scale = np.tile(by_dof[list(dofs)], sub_body.basis.shape[1] // len(dofs))
        body = replace(sub_body.body, damping=scale[:, None] * sub_body.body.stiffness * scale)
        damped.append(replace(sub_body, body=body))
    return tuple(damped)


def _damping_times(blade: Blade, beam: Beam, dofs: tuple[int, ...]) -> Array:
    """β [s] of displacements and rotations along and about x, y, z (6,)."""
    if blade.damping_ratio == 0.0:
        return np.zeros(6)
    modes = clamped_modes(beam, min(len(dofs) * beam.n_elements, 40), node_dofs=dofs)
    flap, edge, torsion = (int(dof in dofs) for dof in (0, 1, 5))
    chosen = select_modes(modes, flap=flap, edge=edge, torsion=torsion)
    found = iter(blade.damping_ratio / (np.pi * modes.frequency[chosen]))
    times = [next(found) if present else 0.0 for present in (flap, edge, torsion)]
    return np.array([times[0], times[1], max(times[:2]), times[1], times[0], times[2]])


def add_sub_bodies(
    system: MultibodySystem, sub_bodies: Sequence[SubBody], add_root: Callable[[FlexibleBody], int], name: str
) -> tuple[int, ...]:
    """Add the sub-bodies of a blade, each fixed to the tip of the one before; returns their indices from the root on.

    Parameters
    ----------
    add_root : callable
        Adds the first body and returns its index.
    name : str
        Of the blade.
    """
    parts: list[int] = []
    for k, sub_body in enumerate(sub_bodies, start=1):
        own = f"{name}_piece_{k}"
        names = tuple(f"{own}_{i + 1}" for i in range(sub_body.basis.shape[1]))
        body = replace(sub_body.body, name=own, coordinate_names=names)
        parts.append(system.add(body, Joint("fixed"), parts[-1], "tip") if parts else add_root(body))
    return tuple(parts)


def sub_body_points(sub_bodies: Sequence[SubBody], points: Array) -> tuple[Points, SubBodyNodes]:
    """Shapes of points (n_points, 3) in the frame of the whole blade, shared out among its sub-bodies.

    Returns
    -------
    points : Points
        position (n_sub_bodies, n_most, 3), linear (n_sub_bodies, n_most, 3, n_f),
        second (n_sub_bodies, n_most, 3, n_f, n_f).
    nodes : SubBodyNodes
    """
    sections = sub_bodies[0].beam.sections
    arc = np.interp(points[:, 2], sections.axis[:, 2], sections.station)
    carrier = np.array([sub_body_at(sub_bodies, s) for s in arc])
    count = np.bincount(carrier, minlength=len(sub_bodies))
    most, n_f = int(count.max()), max(p.basis.shape[1] for p in sub_bodies)
    node = np.zeros((len(sub_bodies), most), dtype=np.int64)
    shapes = Points(np.zeros((len(sub_bodies), most, 3)), np.zeros((len(sub_bodies), most, 3, n_f)),
                    np.zeros((len(sub_bodies), most, 3, n_f, n_f)))  # fmt: skip
    for k, sub_body in enumerate(sub_bodies):
        second, n = sub_body.beam.second_order_field(sub_body.basis), sub_body.basis.shape[1]
        origin = _origin(sub_bodies, k)
        for row, i in enumerate(np.flatnonzero(carrier == k)):
            node[k, row] = i
            offset = points[i] - origin - sub_body.beam.sections.axis_at(arc[i])
            marker = offset_marker(sub_body.beam, sub_body.basis, arc[i], offset, second)
            shapes.position[k, row] = marker.position
            shapes.linear[k, row, :, :n], shapes.second[k, row, :, :n, :n] = marker.linear, marker.second
    return shapes, SubBodyNodes(count.astype(np.int64), node, np.zeros((most, 3)), np.zeros((most, 3)))


def tip_of_last_sub_body(sub_bodies: Sequence[SubBody], tip: Array) -> Points:
    """The tip of a blade (3,), given in its frame, as a point of the last sub-body."""
    last = sub_bodies[-1]
    offset = tip - _origin(sub_bodies, -1) - last.beam.sections.axis_at(last.end)
    marker = offset_marker(last.beam, last.basis, last.end, offset)
    return Points(marker.position[None], np.ascontiguousarray(marker.linear[None]), marker.second[None].copy())


def _origin(sub_bodies: Sequence[SubBody], k: int) -> Array:
    """Origin of the frame of sub-body k in the frame of the blade (3,) [m]: all are parallel to it."""
    return sub_bodies[0].beam.sections.axis_at(sub_bodies[k].start)
