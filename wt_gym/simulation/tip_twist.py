"""Twist of a blade's tip under the steady loads of rated wind, and the fidelity that follows from it.

A blade twists where the air acts beside the shear centers of its sections, and where its sections or its curved axis
couple bending and torsion. By the principle of virtual forces (Przemieniecki, Theory of Matrix Structural Analysis,
1968, ch. 5) the rotation of the tip about its tangent is

    theta = integral of s1(z)^T C(z) s(z) dz,

with C the inverse of the section stiffness, s the forces and moments at a section of all loads farther out, and s1
those of a unit moment about the tangent of the tip. A cantilever is statically determinate, so both follow from
equilibrium alone, about the undeformed axis. Where the axis is straight and runs through the shear centers, this is the
integral of T / GJ with T = integral of (L e + M) dz, L the lift, e the distance of the quarter chord from the shear
center and M the moment of the profile about the quarter chord.

The loads are those of blade elements (`wt_gym.turbines.blade_element`) at rated speed in rated wind, at the least pitch
of the turbine's own controller or beyond, where the rotor has no more than rated power. Neither the loads nor their
lever arms follow the deformation.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.base.errors import SimulationError
from wt_gym.base.warn_once import warn_once
from wt_gym.simulation.fidelity import FIDELITIES, Fidelity, fidelity
from wt_gym.structure.beam import skew
from wt_gym.turbines.blade_element import BladeElementRotor, BladeElements

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.turbines import Blade, Turbine

__all__ = ["LARGEST_TWIST", "NOTABLE_TWIST", "choose_fidelity", "rated_tip_twist", "suited_fidelity", "tip_twist"]

NOTABLE_TWIST = math.radians(0.5)
"""Twist of the tip at rated thrust from which on blades are simulated with torsion [rad]."""
LARGEST_TWIST = math.radians(10.0)
"""Twist of the tip at rated thrust beyond which the torsional stiffness is taken for a fault of the file [rad]; blades
of the IEA 22-MW, the softest of known data, twist by 6 deg."""
_SECTIONS = 60
"""Along the blade; the twist changes by less than 2 % with twice as many."""
_PITCH_STEP = math.radians(0.5)
_PITCH_RANGE = math.radians(12.0)
"""Range of the pitch angles among which that of rated power is looked for [rad]."""
_LEAST_PITCH = math.radians(-5.0)
"""Where the turbine's data have none."""
_TORSION = "-torsion"


def suited_fidelity(turbine: Turbine) -> str:
    """Return "training-torsion" where the tip twists by more than `NOTABLE_TWIST` at rated thrust, else "training".

    Raises
    ------
    SimulationError
        If it twists by more than `LARGEST_TWIST`.
    """
    twist = abs(rated_tip_twist(turbine))
    if twist > LARGEST_TWIST:
        stiffness = turbine.blade.structure.stiffness
        midspan = stiffness[len(stiffness) // 2, 5, 5]
        raise SimulationError(
            f"the blades of {turbine.name!r} must twist by at most {math.degrees(LARGEST_TWIST):g} deg at rated "
            f"thrust, got {math.degrees(twist):.0f} deg from a torsional stiffness GJ of {midspan:.2g} "
            'N m^2 at midspan: correct it in the file, or name a fidelity, "training" for blades without torsion'
        )
    return f"training{_TORSION}" if twist > NOTABLE_TWIST else "training"


def choose_fidelity(turbine: Turbine, choice: str | Fidelity | None) -> str | Fidelity:
    """Return the fidelity of a simulation.

    Without a choice it is the one that suits the turbine. A name with torsion for blades that hardly twist, or without
    for others, brings a warning with the twist, once in a process; a `Fidelity` is taken as it is.

    Parameters
    ----------
    turbine : Turbine
    choice : str, Fidelity or None

    Raises
    ------
    SimulationError
        For an unknown name; as `suited_fidelity`.
    """
    if isinstance(choice, Fidelity):
        return choice
    if choice is None:
        return suited_fidelity(turbine)
    chosen = fidelity(choice)
    twists, other = chosen.blade_modes[2] > 0, choice.removesuffix(_TORSION)
    other = f"{choice}{_TORSION}" if choice == other else other
    if other in FIDELITIES:
        twist = rated_tip_twist(turbine)
        if twists != (abs(twist) > NOTABLE_TWIST):
            warn_once(
                f"the blades of {turbine.name!r} twist by {abs(math.degrees(twist)):.2f} deg at rated thrust, "
                f"{'less' if twists else 'more'} than {math.degrees(NOTABLE_TWIST):g} deg: fidelity {other!r} suits "
                f"them, got {choice!r}",
                stacklevel=3,
            )
    return choice


@lru_cache(maxsize=32)
def rated_tip_twist(turbine: Turbine) -> float:
    """Twist of the tip at rated thrust, see the module [rad]; positive turns the nose to the suction side.

    Blades of OpenFAST's ElastoDyn have no torsional stiffness of their own; with the estimate of their reader they
    hardly twist.
    """
    elements = BladeElements(BladeElementRotor.of_turbine(turbine), _SECTIONS)
    force, moment = _rated_loads(turbine, elements)
    return tip_twist(turbine.blade, elements.span - turbine.blade.root_radius, force, moment)


def _rated_loads(turbine: Turbine, elements: BladeElements) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Force (n, 3) in the axes of the pitched blade [N] and moment about the quarter chord (n,) [N m] of sections."""
    drivetrain = turbine.drivetrain
    power = drivetrain.rated_power / drivetrain.generator_efficiency / drivetrain.gearbox_efficiency
    pitch = _least_pitch(turbine) + np.arange(0.0, _PITCH_RANGE, _PITCH_STEP)
    solved = elements.solve(turbine.rated_wind_speed, drivetrain.rated_rotor_speed, pitch)
    k = int(np.argmax(solved["power"]))  # beyond it the blade feathers
    k += int(np.argmax(solved["power"][k:] <= power))
    normal, driving, alpha, speed = (solved[name][k] for name in ("normal", "driving", "alpha", "speed"))
    cm = np.array([p.coefficients(a)[2] for p, a in zip(elements.polars, alpha.tolist(), strict=True)])
    c, s, width = math.cos(pitch[k]), math.sin(pitch[k]), elements.width
    force = width * np.column_stack([normal * c + driving * s, normal * s - driving * c, np.zeros(_SECTIONS)])
    return force, 0.5 * turbine.air_density * speed**2 * elements.chord**2 * cm * width


def _least_pitch(turbine: Turbine) -> float:
    """Least pitch of the turbine's own controller in rated wind [rad]."""
    own, lowest = turbine.control, turbine.pitch.min_pitch
    if own is not None and own.min_pitch_wind is not None and own.min_pitch is not None:
        return max(float(np.interp(turbine.rated_wind_speed, own.min_pitch_wind, own.min_pitch)), lowest)
    return max(_LEAST_PITCH if own is None or own.fine_pitch is None else own.fine_pitch, lowest)


def tip_twist(blade: Blade, z: NDArray[np.float64], force: NDArray[np.float64], moment: NDArray[np.float64]) -> float:
    """Rotation of the tip under forces (n, 3) at the quarter chords and moments about z (n,) of equal sections [rad].

    Parameters
    ----------
    blade : Blade
    z : ndarray, shape (n,)
        Middles of the sections from the root [m].
    """
    half = 0.5 * (z[1] - z[0])
    axis, ends = blade.axis_at(z), blade.axis_at(np.clip(np.append(z - half, z[-1] + half), 0.0, blade.length))
    step = np.diff(ends, axis=0)
    length = np.linalg.norm(step, axis=1)
    tangent = step / length[:, None]
    twist = blade.twist_at(z)
    aft = (0.25 - blade.le_offset_at(z)) * blade.chord_at(z)
    couple = np.cross(axis + aft[:, None] * np.column_stack([np.sin(twist), np.cos(twist), 0.0 * twist]), force)
    couple[:, 2] += moment
    # of all that acts farther out, and half of the section itself
    outer_force = np.cumsum(force[::-1], axis=0)[::-1] - 0.5 * force
    outer_moment = np.cumsum(couple[::-1], axis=0)[::-1] - 0.5 * couple - np.cross(axis, outer_force)
    turn = skew(np.cross([0.0, 0.0, 1.0], tangent))  # z of the section matrices is the tangent, by the shortest way
    to_local = np.swapaxes(np.eye(3) + turn + turn @ turn / (1.0 + tangent[:, 2, None, None]), 1, 2)
    loads = np.einsum("sij,skj->ski", to_local, np.stack([outer_force, outer_moment], axis=1)).reshape(-1, 6)
    unit = np.hstack([np.zeros_like(axis), to_local @ tangent[-1]])
    stiffness = blade.structure.stiffness_at(blade.station_at(z))
    first = 2 if blade.structure.shear_rigid else 0  # what is rigid has no compliance
    strain = np.linalg.solve(stiffness[:, first:, first:], loads[:, first:, None])[..., 0]
    return float(np.sum(np.sum(unit[:, first:] * strain, axis=1) * length))
