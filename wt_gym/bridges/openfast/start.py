"""Where blades and tower stand at the start of a simulation of OpenFAST: bent as by a steady wind."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.bridges.openfast.mode_shapes import POWERS
from wt_gym.bridges.openfast.run_folder import RunStart
from wt_gym.bridges.openfast.sections import blade_sections, tower_sections
from wt_gym.turbines.blade_element import BladeElementRotor, BladeElements
from wt_gym.wind.inflow import start_speed

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.turbines import Turbine
    from wt_gym.wind import Inflow

__all__ = ["BentTurbine"]

_LEAST_SPEED = 1e-4
"""ElastoDyn needs a rotor that turns, if only just [rad/s]."""


@dataclass(frozen=True)
class Deflections:
    """Deflections of the tips out of and in the rotor plane, of the tower top fore-aft and side-side [m]."""

    out_of_plane: float
    in_plane: float
    fore_aft: float
    side_side: float


class BentTurbine:
    """First modes of blade and tower under steady loads.

    Parameters
    ----------
    turbine : Turbine
    """

    def __init__(self, turbine: Turbine):
        self._turbine = turbine
        self._elements = BladeElements(BladeElementRotor.of_turbine(turbine))
        blade = blade_sections(turbine)
        x = (self._elements.span - turbine.hub.radius) / turbine.blade.length
        self._mass = np.interp(x, blade.fraction, blade.mass)
        self._twist = np.interp(x, blade.fraction, blade.twist)
        flap, edge = (x[:, None] ** POWERS @ shape for shape in (blade.flap_shapes[0], blade.edge_shape))
        bends = x[:, None] ** (POWERS - 2) * POWERS * (POWERS - 1)
        self._curvatures = bends @ blade.flap_shapes[0], bends @ blade.edge_shape
        width = self._elements.width
        omega = 2.0 * np.pi * blade.frequencies
        rated = turbine.drivetrain.rated_rotor_speed
        self._stiffness = (
            omega[0] ** 2 * float(self._mass @ flap**2) * width,
            (omega[2] ** 2 + rated**2) * float(self._mass @ edge**2) * width,
        )
        if turbine.tower.support is not None:  # its compliance is not known here
            self._push = self._lean = 0.0
            return
        tower = tower_sections(turbine)
        shape = np.linspace(0.0, 1.0, 200)[:, None] ** POWERS @ tower.fore_aft_shapes[0]
        m0 = turbine.blade.structure.mass_moment()
        top = turbine.n_blades * m0 + turbine.hub.mass + turbine.nacelle.mass + turbine.nacelle.yaw_bearing_mass
        along = np.interp(np.linspace(0.0, 1.0, 200), tower.fraction, tower.mass)
        modal = top + float(np.mean(along * shape**2)) * turbine.tower.length
        self._push = 1.0 / float((2.0 * np.pi * tower.frequencies[0]) ** 2 * modal)
        slope = float(POWERS @ tower.side_side_shapes[0]) / turbine.tower.length
        self._lean = slope / float((2.0 * np.pi * tower.frequencies[2]) ** 2 * modal)

    def deflections(self, wind: float, rotor_speed: float, pitch: float) -> Deflections:
        """Deflections of a rotor that turns in a steady wind; of one that stands or barely turns none.

        Parameters
        ----------
        wind : float
            [m/s].
        rotor_speed : float
            [rad/s].
        pitch : float
            [rad].
        """
        turbine = self._turbine
        if rotor_speed < 0.1 * turbine.drivetrain.rated_rotor_speed or wind <= 0.0:
            return Deflections(0.0, 0.0, 0.0, 0.0)
        loads = self._elements.solve(wind, rotor_speed, pitch)
        normal, driving = loads["normal"][0], loads["driving"][0]
        # coned upwind, the centrifugal force bends the blades back
        cone = np.sin(turbine.hub.cone) * np.cos(turbine.hub.cone)
        normal = normal + self._mass * rotor_speed**2 * self._elements.span * cone
        force = np.stack([normal, -driving], axis=1)  # out of the plane, and to the trailing edge in it
        angle = self._twist + pitch
        axes = (np.cos(angle), -np.sin(angle)), (np.sin(angle), np.cos(angle))
        tip, width = np.zeros(2), self._elements.width
        for curvature, axis, stiffness in zip(self._curvatures, axes, self._stiffness, strict=True):
            slope = np.cumsum(curvature[:, None] * np.stack(axis, axis=1), axis=0)
            move = (np.cumsum(slope, axis=0) - 0.5 * slope) / len(slope) ** 2  # along the blade, of one unit
            tip += float(np.sum(force * move)) * width / stiffness * move[-1]
        moment = float(loads["power"][0]) / rotor_speed  # turns the tower top about x, to the right
        return Deflections(
            float(tip[0]), float(tip[1]), float(loads["thrust"][0]) * self._push, -moment * self._lean
        )  # fmt: skip

    def start(
        self,
        inflow: Inflow,
        rotor_speed: float,
        pitch: NDArray[np.float64],
        azimuth: float,
        yaw: float,
        tower_top: NDArray[np.float64] | None = None,
    ) -> RunStart:
        """Start of a run in a wind.

        Parameters
        ----------
        inflow : Inflow
        rotor_speed, azimuth, yaw : float
            [rad/s], [rad], [rad].
        pitch : array (n_blades,)
            [rad].
        tower_top : array (2,), optional
            Displacement along and across the nacelle [m], instead of that under the steady wind.
        """
        bent = self.deflections(start_speed(inflow), rotor_speed, float(pitch.mean()))
        fore, side = (bent.fore_aft, bent.side_side) if tower_top is None else tower_top.tolist()
        cos, sin = math.cos(yaw), math.sin(yaw)
        top = cos * fore - sin * side, sin * fore + cos * side
        tips = bent.out_of_plane, bent.in_plane
        return RunStart(max(rotor_speed, _LEAST_SPEED), azimuth, yaw, pitch, top, tips)
