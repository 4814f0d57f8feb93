"""Closed bodies that follow the deflected tower, and the force of the air on that of the tower.

The panels of the tower are carried by its sections, the body of hub and nacelle by the nacelle; both stand where the
structure was at the beginning of the step. The force of the air on each ring of panels (a strip) follows by Lagally's
theorem (`wt_gym.aerodynamics.bodies.lagally`) from what the lattice knows of it: source strengths, and the velocity of
wind, wake, blades and nacelle there. It acts, by virtual work, at the middle of the strip, on top of the drag
(`coupling_kernels.tower_drag`). Mirror images of the tower itself are left out: level forces of a body and its image on
each other cancel.

Forces belong to the end of an accepted step. The next step takes them continued in a straight line, and does not
iterate them with the structure: the air that moves with a tower has a two-hundredth of its mass.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from wt_gym.aerodynamics.bodies.lagally import convective_force, impulse
from wt_gym.multibody.tree.point_kernels import point_motion
from wt_gym.simulation.model.turbine_bodies import NACELLE
from wt_gym.simulation.model.turbine_structure import body_points

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.aerodynamics.bodies.body_set import BodySurface
    from wt_gym.aerodynamics.state import AeroArrays
    from wt_gym.multibody.arrays import Points, Work
    from wt_gym.simulation.model.assembly import TurbineModels
    from wt_gym.turbines.model import Tower

    Floats = NDArray[np.float64]

__all__ = ["MovingBodies"]

TOWER = "tower"


class MovingBodies:
    """Places the bodies of a turbine, and loads its tower.

    Parameters
    ----------
    models : TurbineModels
        With closed bodies in the lattice.

    Attributes
    ----------
    force : array (2, n_strips, 3)
        Of the air on the strips at the ends of the last two steps, newest last [N].
    height : array (n_strips,)
        Of the strips above the base of the tower [m].
    """

    def __init__(self, models: TurbineModels) -> None:
        turbine, self._structure, self._lattice = models.turbine, models.structure, models.lattice
        bodies = models.lattice.bodies
        assert bodies is not None  # a fidelity has bodies where it moves them
        self._bodies = bodies
        self._dt, self._density = models.time_step, turbine.air_density
        self._top = np.array([0.0, 0.0, turbine.tower.height])
        self._tower = bodies.names.index(TOWER) if TOWER in bodies.names else None
        self._nacelle = bodies.names.index(NACELLE) if NACELLE in bodies.names else None
        self.height = np.zeros(0)
        if self._tower is not None:
            self._lay_out_tower(bodies.bodies[self._tower], turbine.tower, bodies.first_panel[self._tower :])
        n = len(self.height)
        self.force, self._impulse, self._filled = np.zeros((2, n, 3)), np.zeros((3, n, 3)), np.zeros(1, dtype=np.int64)

    def _lay_out_tower(self, surface: BodySurface, tower: Tower, panels: NDArray[np.int64]) -> None:
        """Corners of the panels and middles of the strips as points of the tower; its first panel is ``panels[0]``."""
        beam, basis = self._structure.tower_field
        base = np.array([0.0, 0.0, tower.base_height])
        self._corners = body_points(beam, basis, surface.vertices - base)
        self._panels = slice(panels[0], panels[1])
        levels = np.unique(np.round(surface.vertices[:, 2], 9)) - base[2]
        self.height = 0.5 * (levels[1:] + levels[:-1])
        # a disc at an end belongs to the strip beside it
        of_panel = np.searchsorted(levels, surface.center[:, 2] - base[2]) - 1
        strip = np.clip(of_panel, 0, len(self.height) - 1)
        self._member = (strip == np.arange(len(self.height))[:, None]).astype(float)  # (n_strips, n_panels)
        radii = 0.5 * np.interp(levels, tower.diameter_station, tower.diameter)
        a, b = radii[:-1], radii[1:]
        self._volume = np.pi / 3.0 * (a * a + a * b + b * b) * np.diff(levels)
        self._middles = body_points(beam, basis, self.height[:, None] * [0.0, 0.0, 1.0])

    def restart(self) -> None:
        """Forget the forces of a run before."""
        self.force[:], self._impulse[:], self._filled[:] = 0.0, 0.0, 0

    def state(self) -> dict[str, NDArray[Any]]:
        """Arrays that carry state, by name."""
        return {"tower_force": self.force, "tower_impulse": self._impulse, "tower_filled": self._filled}

    # ---- places ----

    def place(self, y: Floats, work: Work) -> None:
        """Put the bodies where the structure is in a state y with these kinematics."""
        bodies = self._bodies
        rotations = np.tile(np.eye(3), (len(bodies.names), 1, 1))
        origins, velocities, spins = (np.zeros((len(bodies.names), 3)) for _ in range(3))
        if self._nacelle is not None:
            k, n = self._nacelle, self._structure.nacelle
            rotations[k] = work.rot[n]
            origins[k] = work.r[n] - work.rot[n] @ self._top
            spins[k] = work.rot[n] @ work.omega[n]
            velocities[k] = work.rot[n] @ work.v[n] + np.cross(spins[k], origins[k] - work.r[n])
        if self._tower is not None:
            corners, moves = self._motion(self._corners, y, work)
            bodies.bend(self._tower, corners)
        bodies.place(rotations, origins, velocities, spins)
        if self._tower is not None:
            quads = bodies.bodies[self._tower].quads  # a panel moves with the mean of its corners
            bodies.arrays.motion[:, self._panels] = moves[quads].mean(axis=1).T

    def _motion(self, points: Points, y: Floats, work: Work) -> tuple[Floats, Floats]:
        """Places (n, 3) [m] and velocities [m/s] of points of the tower."""
        s = self._structure
        q, rate = s.elastic(s.tower, y)
        place, velocity = np.zeros_like(points.position), np.zeros_like(points.position)
        point_motion(work.rot[s.tower], work.r[s.tower], work.v[s.tower], work.omega[s.tower], q, rate, points, place,
                     velocity)  # fmt: skip
        return place, velocity

    # ---- loads ----

    def take_force(self, aero: AeroArrays, y: Floats, work: Work) -> None:
        """Force of the air on the strips at the end of a step; the kinematics belong to the state y."""
        if self._tower is None:
            return
        bodies, flow = self._bodies, self._flow(aero)
        flux = (aero.body_strength * bodies.area)[self._panels] * self._member
        place, velocity = self._motion(self._middles, y, work)
        arm = bodies.arrays.center[:, self._panels].T - place[:, None]
        self._impulse[:2] = self._impulse[1:]
        self._impulse[2] = impulse(flux, arm, self._volume, velocity, self._density)
        self._filled[0] = min(self._filled[0] + 1, 3)
        rate = np.zeros_like(velocity)
        if self._filled[0] == 2:
            rate = (self._impulse[2] - self._impulse[1]) / self._dt
        elif self._filled[0] == 3:
            rate = (1.5 * self._impulse[2] - 2.0 * self._impulse[1] + 0.5 * self._impulse[0]) / self._dt
        self.force[0] = self.force[1]
        self.force[1] = rate + convective_force(flux, flow, velocity, self._density)
        if self._filled[0] == 1:
            self.force[0] = self.force[1]

    def _flow(self, aero: AeroArrays) -> Floats:
        """Velocity of everything but the tower at its panels (n, 3) [m/s]."""
        work, bodies, p = self._lattice.body_arrays[1], self._bodies, self._panels
        assert work is not None
        rings = np.tensordot(aero.gamma.ravel(), work.ring_influence[:, :, p], axes=1)
        flow: Floats = work.wind[p] + (work.wake_flow[:, p] + rings).T
        if len(bodies.names) > 1:
            others = aero.body_strength.copy()
            others[p] = 0.0
            flow = flow + bodies.velocity(bodies.control_points[p], others)
        return flow

    def load(self, y: Floats, work: Work, out: Floats) -> None:
        """Loads (6 + n_f,) of the tower at the end of the next step, from the forces of the last two continued."""
        out[:] = 0.0
        if self._tower is None:
            return
        s, points = self._structure, self._middles
        force = (2.0 * self.force[1] - self.force[0]) @ work.rot[s.tower]  # body axes
        q, _ = s.elastic(s.tower, y)
        bend = points.second @ q
        place = points.position + (points.linear + 0.5 * bend) @ q
        out[:3] = force.sum(axis=0)
        out[3:6] = np.cross(place, force).sum(axis=0)
        out[6 : 6 + len(q)] = np.einsum("pi,pik->k", force, points.linear + bend)
