"""Mooring lines: elastic catenaries with touch-down, without inertia and without drag."""

from __future__ import annotations

import math

import numpy as np

from wt_gym.base.errors import SimulationError, TurbineDefinitionError
from wt_gym.base.options import option, option_record
from wt_gym.base.quantities import Array
from wt_gym.hydrodynamics.mooring_kernels import SOLVED, anchor_tension, solve_line
from wt_gym.hydrodynamics.record import Record, fail


@option_record
class MooringLine(Record):
    """Mooring line from an anchor to a fairlead of the platform.

    Its statics are those of J. M. Jonkman, NREL/TP-500-41958 (2007), section 2.5. Part of a line whose anchor is on the
    seabed may rest on it; another line hangs free.
    """

    anchor: Array = option("anchor in axes of the sea, z up from still water", unit="m", shape=(3,), low=-1e5, high=1e5)
    fairlead: Array = option("upper end in axes of the platform", unit="m", shape=(3,), low=-1e4, high=1e4)
    length: float = option("length without load", unit="m", low=0, above=True, high=1e5)
    mass_per_length: float = option("mass per length in air", unit="kg/m", low=0, above=True, high=1e5)
    diameter: float = option("diameter of a cylinder of the same volume", unit="m", low=0, high=10)
    axial_stiffness: float = option("EA", unit="N", low=1, high=1e15)
    seabed_friction: float = option("coefficient of friction of the seabed", default=0.0, unit="-", low=0, high=10)

    def weight(self, water_density: float, gravity: float) -> float:
        """Return the weight in water per length [N/m].

        Raises
        ------
        TurbineDefinitionError
            If the line floats.
        """
        weight = (self.mass_per_length - water_density * 0.25 * math.pi * self.diameter**2) * gravity
        if weight <= 0.0:
            water = water_density * 0.25 * math.pi * self.diameter**2
            raise fail("MooringLine.mass_per_length", self.mass_per_length, f"above that of the water, {water:g} kg/m")
        return weight

    def pull(self, water_density: float, gravity: float, water_depth: float, name: str = "MooringLine") -> float:
        """Return the force down on a platform at its place without displacement [N]; ``name`` is for messages.

        Raises
        ------
        TurbineDefinitionError
            If the line floats, does not reach, lies slack on the seabed or hangs through it.
        """
        weight, (x, y, z) = self.weight(water_density, gravity), self.fairlead - self.anchor
        across, rests, stretch = math.hypot(x, y), self.rests(water_depth), self.axial_stiffness / weight
        try:
            line = self.length, weight, self.axial_stiffness
            h, v, _ = line_forces(across, z, *line, friction=self.seabed_friction, rests=rests)
        except SimulationError as error:
            raise TurbineDefinitionError(f"{name}: {error}") from error
        longest = across + math.sqrt(stretch**2 + 2.0 * stretch * abs(z)) - stretch
        if rests and self.length > longest:
            allowed = f"at most {longest:g} m ({across:g} m on the seabed, {z:g} m up to the fairlead), or it is slack"
            raise fail(f"{name}.length", self.length, allowed)
        anchor = min(v - weight * self.length, 0.0)
        lowest = self.anchor[2] - (math.hypot(h, anchor) - h) / weight
        if not rests and lowest < -water_depth:
            allowed = f"on the seabed, {-water_depth:g} m: a line of {self.length:g} m hangs down to {lowest:g} m"
            raise fail(f"{name}.anchor[2]", self.anchor[2], allowed)
        return v

    def rests(self, water_depth: float) -> bool:
        """Return whether the anchor is on the seabed, on which a part of the line may rest."""
        return bool(self.anchor[2] < 0.1 - water_depth)


def line_forces(
    x: float, z: float, length: float, weight: float, stiffness: float, *, friction: float = 0.0, rests: bool = True
) -> tuple[float, float, float]:
    """Forces that hold a line.

    Parameters
    ----------
    x, z : float
        Position of the upper end across and above the anchor [m].
    length, weight, stiffness : float
        Length without load [m], weight in water per length [N/m], EA [N].
    friction : float
        Of the seabed.
    rests : bool
        The anchor is on the seabed.

    Returns
    -------
    tuple of float
        Horizontal and vertical force at the upper end, tension at the anchor [N].

    Raises
    ------
    SimulationError
        If there is no solution.
    """
    unknown = np.zeros(2)
    if solve_line(unknown, x, z, length, weight, stiffness, friction, int(rests)) != SOLVED:
        raise unsolved(x, z, length)
    h, v = float(unknown[0]), float(unknown[1])
    return h, v, float(anchor_tension(h, v, length, weight, friction, int(rests)))


def unsolved(x: float, z: float, length: float) -> SimulationError:
    """Error about a line whose ends are too far from each other, or whose upper end is not above its anchor."""
    return SimulationError(
        f"the fairlead must be above the seabed and within reach of a line of {length:g} m, "
        f"got {x:g} m across and {z:g} m above its anchor, {math.hypot(x, z):g} m"
    )


def line_shape(
    h: float, v: float, length: float, weight: float, stiffness: float, *, rests: bool = True, count: int = 30
) -> Array:
    """Points of a line for pictures, without the friction of the seabed.

    Parameters
    ----------
    h, v, length, weight, stiffness, rests
        As in `line_forces`.
    count : int
        Number of points, equally spaced along the line without load.

    Returns
    -------
    ndarray, shape (count, 2)
        Positions across and above the anchor [m], the anchor first.
    """
    s = np.linspace(0.0, length, count)
    lower = v - weight * length
    bottom = max(-lower / weight, 0.0) if rests else 0.0
    start = max(lower, 0.0) if rests else lower
    free = np.maximum(s - bottom, 0.0)
    force = start + weight * free
    x = np.minimum(s, bottom) + h / weight * (np.arcsinh(force / h) - math.asinh(start / h)) + h * s / stiffness
    z = (np.hypot(h, force) - math.hypot(h, start)) / weight + (start * free + 0.5 * weight * free**2) / stiffness
    return np.column_stack([x, z])
