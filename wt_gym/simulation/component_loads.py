"""Loads and deflections beyond the channels: tower top, hub, blade roots, tower base, and sections of blades and tower.

Names, axes and points of reference are those of ElastoDyn's outputs: every load is that of the part farther from the
ground, or nearer to the blade tip, on its neighbor. A load in a joint is the wrench that the multibody system transmits
there. That of a section is in balance with weight, inertia and air of all that lies beyond it, which is how ElastoDyn
sums up the loads of its strain gages; no stiffness enters, and few modes suffice.

Axes, all right-handed: those of the nacelle (OpenFAST's suffix n) turn with the yaw, those of the tower top (p) do not;
those of the shaft turn with the hub (a; z along blade 1 as it would be without cone) or stay with the nacelle (s). Axes
of a blade are pitched (b) or only coned (c). Local axes of a section move with it; those of a blade are the principal
axes of bending.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from wt_gym.base.compiled import compiled_for
from wt_gym.base.errors import SimulationError
from wt_gym.base.quantities import Array
from wt_gym.simulation.channels import EVEN, ODD, Channel
from wt_gym.simulation.simulator import Simulator
from wt_gym.simulation.step.coupling_kernels import read_gauges
from wt_gym.simulation.step.measurement_kernels import AZIMUTH, YAW
from wt_gym.simulation.turbine_structure import drag_heights, rotation_x
from wt_gym.structure.beam import N_GAUSS, Beam
from wt_gym.structure.flexible_body import offset_marker, particle_fields
from wt_gym.turbines.blade import bending_matrices, principal_bending, rotation_about_z

KINDS = ("none", "joints", "sections")
"""Loads to record: none, those in the joints, or those of sections too."""
N_SECTIONS = 9
"""Sections of a blade and of the tower, evenly spaced: at 10, 20 … 90 % of the length."""
_AXES = "xyz"
_UNITS = {"force": "N", "moment": "N m", "deflection": "m"}


def _vector(
    name: str, openfast: str, place: str, quantity: str, axes: str = _AXES, parities: bool = True
) -> list[Channel]:
    """Channels of the components of a vector; a star in OpenFAST's name stands for the axis.

    The frame of a blade is reflected with it, so that its components are even (``parities`` False).
    """
    out = []
    for axis in axes:
        odd = parities and (axis == "y") != (quantity == "moment")
        full = f"{name}_{axis}"
        text = f"{quantity.capitalize()} {place}, {'about' if quantity == 'moment' else 'along'} {axis}"
        out.append(Channel(full, _UNITS[quantity], openfast.replace("*", axis), ODD if odd else EVEN, text, full))
    return out


def joint_channels(n_blades: int) -> tuple[Channel, ...]:
    """Channels of the loads in joints."""
    out: list[Channel] = []
    for name, suffix, place in (
        ("yaw_bearing", "n", "of the nacelle on the yaw bearing, axes of the nacelle"),
        ("tower_top", "p", "of the nacelle on the yaw bearing, axes of the tower top"),
    ):
        out += _vector(f"{name}_force", f"YawBrF*{suffix}", place, "force")
        out += _vector(f"{name}_moment", f"YawBrM*{suffix}", place, "moment")
    for name, suffix, place in (
        ("hub_rotating", "a", "of the hub on the shaft at the apex, axes that turn with the hub"),
        ("hub_fixed", "s", "of the hub on the shaft at the apex, axes that stay with the nacelle"),
    ):
        out += _vector(f"{name}_force", f"LSShftF*{suffix}", place, "force", "yz")
        out += _vector(f"{name}_moment", f"LSSTipM*{suffix}", place, "moment", "yz")
    out += _vector("tower_base_force", "TwrBsF*t", "of the tower on its base", "force")
    for b in range(1, n_blades + 1):
        root, coned = f"of blade {b} on its root, axes of the pitched blade", f"of blade {b} on its root, not pitched"
        out += _vector(f"root_force_{b}", f"RootF*b{b}", root, "force", parities=False)
        out += _vector(f"root_coned_force_{b}", f"RootF*c{b}", coned, "force", "xy", parities=False)
        out += _vector(f"root_coned_moment_{b}", f"RootM*c{b}", coned, "moment", "xy", parities=False)
    return tuple(out)


def section_channels(n_blades: int) -> tuple[Channel, ...]:
    """Channels of the loads and deflections of sections: the tower, then blade by blade, from root to tip."""
    out: list[Channel] = []
    beams = [("tower", "TwHt{}{}*t"), *((f"blade_{b}", f"Spn{{}}{{}}*b{b}") for b in range(1, n_blades + 1))]
    quantities = ("force", "FL", "section"), ("moment", "ML", "section"), ("deflection", "TD", "root")
    for (name, openfast), k in product(beams, range(1, N_SECTIONS + 1)):
        place = f"at {k * 100 // (N_SECTIONS + 1)} % of {name.replace('_', ' ')}, axes of the"
        for quantity, letters, frame in quantities:
            full, code = f"{name}_section_{k}_{quantity}", openfast.format(k, letters)
            out += _vector(full, code, f"{place} {frame}", quantity, parities=name == "tower")
    return tuple(out)


class _Lumps(NamedTuple):
    """Parts of a beam, each concentrated at a point, and how much of each lies beyond each section."""

    share: Array  # (n_sections, n_lumps)
    shift: Array  # (n_sections, n_lumps) from the point to the middle of that share, along z [m], times the share

    @classmethod
    def of(cls, low: Array, high: Array, places: Array) -> _Lumps:
        """Lumps that stand for the lengths from ``low`` to ``high`` (n_lumps,) [m]."""
        length = np.maximum(high - low, 1e-12)
        share = np.clip((high - places[:, None]) / length, 0.0, 1.0)
        return cls(share, 0.5 * share * (1.0 - share) * length)

    def load(self, position: Array, force: Array) -> Array:
        """Force and moment (n_sections, 6) about the origin of forces (n_lumps, 3) beyond the sections."""
        moment = self.share @ np.cross(position, force)
        moment[:, 0] -= self.shift @ force[:, 1]
        moment[:, 1] += self.shift @ force[:, 0]
        return np.hstack([self.share @ force, moment])


class _SectionedBeam:
    """Sections of one beam and the masses beyond them, in the axes of its body.

    Parameters
    ----------
    places : array (n_sections,)
        Arc lengths of the sections [m].
    twist : array (n_sections,)
        Of the local axes, clockwise about z [rad].
    """

    def __init__(self, beam: Beam, basis: Array, places: Array, twist: Array) -> None:
        self._mass = beam.particle_mass
        fields = particle_fields(beam, basis)
        self._position, self._linear, self._second = fields.position, fields.linear, fields.second
        self._untwist = rotation_about_z(twist)[..., :3, :3]
        second = beam.second_order_field(basis)
        markers = [offset_marker(beam, basis, s, np.zeros(3), second) for s in places]
        self._at, self._moves, self._bends, self._turns = (
            np.array([getattr(marker, name) for marker in markers])
            for name in ("position", "linear", "second", "rotation")
        )
        ends = np.cumsum(0.5 * np.polynomial.legendre.leggauss(N_GAUSS)[1])
        high = beam.nodes[:-1, None] + np.diff(beam.nodes)[:, None] * ends
        low = np.column_stack([beam.nodes[:-1], high[:, :-1]])
        self._lumps = _Lumps.of(low.ravel()[beam.particle_gauss], high.ravel()[beam.particle_gauss], places)

    def inertial_load(self, q: Array, rate: Array, change: Array, frame: tuple[Array, Array, Array]) -> Array:
        """Weight and inertia (n_sections, 6) of what lies beyond, about the origin of the body.

        Parameters
        ----------
        q, rate, change : array (n_f,)
            Elastic coordinates, rates and accelerations.
        frame : three arrays (3,)
            Acceleration of the origin minus gravity [m/s²], angular velocity [rad/s] and acceleration [rad/s²].
        """
        origin, spin, turn = frame
        second = np.tensordot(self._second, q, 1)
        position = self._position + (self._linear + 0.5 * second) @ q
        slope = self._linear + second
        velocity = slope @ rate
        acceleration = origin + np.cross(turn, position) + np.cross(spin, np.cross(spin, position) + 2.0 * velocity)
        acceleration += slope @ change + np.tensordot(self._second, rate, 1) @ rate
        return self._lumps.load(position, -self._mass[:, None] * acceleration)

    def local(self, load: Array, q: Array) -> Array:
        """Loads in local axes at the sections and their deflections (n_sections, 9) of loads about the origin."""
        moved = (self._moves + 0.5 * self._bends @ q) @ q
        axes = self._untwist @ np.swapaxes(Rotation.from_rotvec(self._turns @ q).as_matrix(), -1, -2)
        force, moment = load[:, :3], load[:, 3:] - np.cross(self._at + moved, load[:, :3])
        return np.hstack([*(np.einsum("sij,sj->si", axes, vector) for vector in (force, moment)), moved])


class ComponentLoads:
    """Loads of one simulator at its current instant.

    Parameters
    ----------
    simulator : Simulator
    kind : {"joints", "sections"}
        "sections" adds to the loads in joints those of sections along blades and tower.

    Attributes
    ----------
    channels : tuple of Channel
        In the order of the values.

    Raises
    ------
    SimulationError
        If the simulator is another code, or its blades or tower are not plain beams in modes that stay.
    """

    def __init__(self, simulator: Simulator, kind: str) -> None:
        if kind not in KINDS[1:]:
            raise SimulationError(f"loads must be one of {', '.join(KINDS)}; got {kind!r}")
        if not hasattr(simulator, "coupling"):
            raise SimulationError(f"loads must be 'none' with {type(simulator).__name__}, got {kind!r}")
        self.simulator, self._gravity = simulator, simulator.structure.system.tree.gravity
        self.channels = joint_channels(simulator.turbine.n_blades)
        self._signs = np.ones(1)
        self._beams: tuple[_SectionedBeam, ...] = ()
        if kind == "sections":
            self._lay_out_sections()
            self.channels += section_channels(simulator.turbine.n_blades)
        if simulator.mirrored:
            self._signs = np.array([float(channel.parity) for channel in self.channels])
        coupling, i = simulator.coupling, simulator.coupling.instant
        self._arguments = i.y, i.dy, i.body_loads, simulator.structure.system.tree, i.work, coupling.gauges
        self._read_gauges = compiled_for(read_gauges, self._arguments)

    def _lay_out_sections(self) -> None:
        """Sections, and shares of the air's forces beyond them."""
        simulator, fidelity = self.simulator, self.simulator.fidelity
        turbine, structure = simulator.turbine, simulator.structure
        plain = {"formulation": "embedded", "tower_body": None, "tower_coordinates": "modal", "blade_bodies": 1}
        plain |= {"blade_coordinates": "modal", "blade_basis": "fixed"}
        for name, value in plain.items():
            if getattr(fidelity, name) != value:
                raise SimulationError(
                    f"loads 'sections' need Fidelity.{name} = {value!r}, got {getattr(fidelity, name)!r}"
                )
        if turbine.ice is not None:
            raise SimulationError("loads 'sections' need blades without ice")
        part = np.arange(1, N_SECTIONS + 1) / (N_SECTIONS + 1)
        blade, (beam, basis) = turbine.blade, structure.blade_field
        place = part * beam.nodes[-1]
        height = np.interp(place, blade.axis_station, blade.axis[:, 2])
        twist = principal_bending(bending_matrices(blade.structure, place), blade.twist_at(height))[2]
        tower, (tower_beam, tower_basis) = turbine.tower, structure.tower_field
        below = tower_beam.sections.station[-1] - tower.length
        at = part * tower.length
        self._beams = (
            _SectionedBeam(tower_beam, tower_basis, below + at, np.zeros(N_SECTIONS)),
            _SectionedBeam(beam, basis, place, twist),
        )
        strips = np.interp(simulator.lattice.planform.nodes[0, :, 2], blade.axis[:, 2], blade.axis_station)
        edges = np.concatenate([strips[:1], 0.5 * (strips[1:] + strips[:-1]), strips[-1:]])
        rows = simulator.coupling.exchange.nodes.shape[1]
        self._blade_air = _Lumps.of(np.tile(edges[:-1], rows), np.tile(edges[1:], rows), place)
        heights = drag_heights(tower)
        simpson = np.array([1.0, *[4.0, 2.0] * (len(heights) // 2 - 1), 4.0, 1.0])
        ends = np.cumsum(simpson) * (heights[1] - heights[0]) / 3.0
        self._tower_air = _Lumps.of(np.append(0.0, ends[:-1]), ends, at)

    def read(self) -> Array:
        """Loads and deflections now (n,), in the order of ``channels``.

        Raises
        ------
        SimulationError
            If the simulator is not running.
        """
        _ = self.simulator.signals  # refuses where there are none
        self._read_gauges(*self._arguments)
        out = self._joints()
        if self._beams:
            out = np.concatenate([out, self._sections()])
        return out * self._signs

    def _joints(self) -> Array:
        """Loads in the joints, in the order of `joint_channels`."""
        simulator, g, work = self.simulator, self.simulator.coupling.gauges, self._arguments[4]
        load, nacelle = -g.wrench, g.nacelle
        bearing, hub = load[nacelle].copy(), load[g.hub].reshape(2, 3)
        # ElastoDyn counts the yaw bearing itself to the tower
        felt = g.nacelle_acceleration - work.rot[nacelle].T @ self._gravity
        bearing[:3] += simulator.turbine.nacelle.yaw_bearing_mass * felt
        top = rotation_about_z(g.values[g.at[YAW]]) @ bearing
        fixed = hub @ rotation_x(g.values[g.at[AZIMUTH]]).T
        parts = [bearing, top, hub[:, 1:].ravel(), fixed[:, 1:].ravel(), load[g.indices.tower, :3]]
        for blade, angle in zip(g.blades, simulator.coupling.pitch, strict=True):
            coned = rotation_about_z(-angle) @ load[blade]
            parts += [load[blade, :3], coned[:2], coned[3:5]]
        return np.concatenate(parts)

    def _sections(self) -> Array:
        """Loads and deflections of sections, in the order of `section_channels`."""
        structure, coupling = self.simulator.structure, self.simulator.coupling
        g, work, air = coupling.gauges, self._arguments[4], coupling.exchange.tower
        tower, nacelle = structure.tower, structure.nacelle
        load, local = self._beyond(tower, self._beams[0], self._tower_air, air.position, air.force)
        turn = work.rot[tower].T @ work.rot[nacelle]
        force, moment = -(g.wrench[nacelle].reshape(2, 3) @ turn.T)
        arm = work.rot[tower].T @ (work.r[nacelle] - work.r[tower])
        load += np.concatenate([force, moment + np.cross(arm, force)])
        parts = [self._beams[0].local(load, local)]
        for blade, nodes, forces in zip(structure.blades, coupling.blade_nodes, coupling.blade_forces, strict=True):
            load, local = self._beyond(blade, self._beams[1], self._blade_air, nodes, forces)
            parts.append(self._beams[1].local(load, local))
        return np.concatenate(parts, axis=None)

    def _beyond(
        self, body: int, beam: _SectionedBeam, air: _Lumps, position: Array, force: Array
    ) -> tuple[Array, Array]:
        """Loads (n_sections, 6) of a body's own parts beyond its sections, about its origin; its elastic coordinates.

        Positions and forces of the air (n, 3) are global.
        """
        y, dy, _, tree, work, _ = self._arguments
        accelerations = dy[tree.n_q : tree.n_q + tree.n_u]
        moving = accelerations[tree.cols[body, : tree.n_col[body]]]
        rot, n = work.rot[body], len(moving)
        origin = work.bias_lin[body] + work.vl[body][:, :n] @ moving - rot.T @ self._gravity
        turn = work.bias_ang[body] + work.va[body][:, :n] @ moving
        q, rate = self.simulator.structure.elastic(body, y)
        u = tree.elastic_u[body]
        change = accelerations[u : u + len(q)]
        inertial = beam.inertial_load(q, rate, change, (origin, work.omega[body], turn))
        return inertial + air.load((position - work.r[body]) @ rot, force @ rot), q
