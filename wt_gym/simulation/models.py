"""The models of a turbine, put together: everything that depends on the meshes alone and no step changes."""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from wt_gym.aerodynamics import (
    AerodynamicsError,
    BodySet,
    BodySurface,
    TowerFlow,
    VortexLattice,
    build_planform,
    revolution_body,
    span_distribution,
    tower_body,
)
from wt_gym.aerodynamics.lattice.planform import LatticePlanform
from wt_gym.aerodynamics.options import AeroOptions
from wt_gym.base.errors import SimulationError
from wt_gym.base.processes import one_blas_thread
from wt_gym.base.quantities import Array
from wt_gym.multibody.integrators.schemes import INTEGRATORS
from wt_gym.multibody.system import MultibodySystem
from wt_gym.simulation.fidelity import Fidelity
from wt_gym.simulation.turbine_structure import TurbineStructure, build_structure
from wt_gym.turbines import Blade, Turbine
from wt_gym.turbines.blade import iced_polar, spread


@dataclass(frozen=True)
class TurbineModels:
    """A turbine as structure and lattice."""

    turbine: Turbine
    fidelity: Fidelity
    structure: TurbineStructure
    lattice: VortexLattice
    tower_flow: TowerFlow  #: The cheap form of the tower in the flow
    time_step: float  #: Aerodynamic step [s]
    n_substeps: int  #: Structural steps in it
    embedded: "TurbineModels | None" = None
    """The same turbine without constraint equations, if these have them: they leave the motion, and so its frequencies
    and its steady state, as they are."""


def assemble(turbine: Turbine, fidelity: Fidelity, threads: int = 1, generator_damping: float = 0.0) -> TurbineModels:
    """Models of a turbine.

    Parameters
    ----------
    threads : int
        That share the tree code of the wake.
    generator_damping : float
        Damper between nacelle and rotor [N m s/rad, low-speed shaft].

    Raises
    ------
    SimulationError
        For fidelities that the turbine does not support.
    """
    with one_blas_thread():
        return _assembled(turbine, fidelity, threads, generator_damping)


def _assembled(turbine: Turbine, fidelity: Fidelity, threads: int, generator_damping: float) -> TurbineModels:
    """See `assemble`."""
    rated_speed = turbine.drivetrain.rated_rotor_speed
    lattice = build_lattice(turbine, fidelity, threads)
    structure = build_structure(turbine, fidelity, lattice.planform.nodes, generator_damping)
    tower, base = turbine.tower, np.array([0.0, 0.0, turbine.tower.base_height])
    time_step, embedded = fidelity.step_for(rated_speed), None
    if fidelity.formulation == "embedded":
        explicit = INTEGRATORS[fidelity.integrator].explicit
        n_substeps = fidelity.substeps_for(time_step, highest_frequency(structure.system) if explicit else None)
    elif fidelity.formulation == "observer":
        n_substeps = fidelity.substeps_for(time_step, None)  # implicit schemes are stable with any step
    else:
        embedded = _assembled(turbine, replace(fidelity, formulation="embedded"), threads, generator_damping)
        n_substeps = embedded.n_substeps
    return TurbineModels(
        turbine=turbine,
        fidelity=fidelity,
        structure=structure,
        lattice=lattice,
        tower_flow=TowerFlow(base, tower.diameter_station, tower.diameter),
        time_step=time_step,
        n_substeps=n_substeps,
        embedded=embedded,
    )


def highest_frequency(system: MultibodySystem, step: float = 1e-5) -> float:
    """Highest natural frequency of a system at rest without loads [rad/s]: root of the largest |eigenvalue| of −∂u̇/∂q.

    Only for systems whose positions are joint angles, slides and elastic coordinates.
    """
    origin = system.initial_state()
    accelerations = slice(system.n_q, system.n_q + system.n_u)
    columns = []
    for i in range(system.n_q):
        y = origin.copy()
        y[i] += step
        columns.append(system.rates(y)[accelerations])
    base = system.rates(origin)[accelerations]
    jacobian = (np.array(columns) - base).T / step
    return float(np.sqrt(np.abs(np.linalg.eigvals(jacobian)).max()))


def build_lattice(turbine: Turbine, fidelity: Fidelity, threads: int = 1) -> VortexLattice:
    """Vortex lattice of the blades, and of the bodies that the fidelity closes; arguments as of `assemble`."""
    aero = fidelity.aero_for(turbine.drivetrain.rated_rotor_speed)
    planform = blade_planform(turbine, aero)
    bodies = turbine_bodies(turbine, fidelity, planform.nodes)
    return VortexLattice(planform, turbine.n_blades, aero, turbine.air_density, bodies, threads)


N_ALPHA = 720
"""Angles of attack in the polar tables: one each half degree, as fine as published polars near stall."""
TOWARDS_ENDS, TOWARDS_TIP = 0.3, 0.5
"""Share of cosines, or sines, in the distribution of the strips of a blade."""
SAMPLES = 16
"""Sections over which chord and polar of a strip are averaged."""


def blade_planform(turbine: Turbine, options: AeroOptions) -> LatticePlanform:
    """Lattice of one blade.

    Parameters
    ----------
    options : AeroOptions
        Panels along chord and span.
    """
    blade = turbine.blade
    edges = span_edges(blade, options.n_span, options.narrow_strips)
    return build_planform(
        edges,
        blade.axis_at(edges),
        blade.chord_at(edges),
        blade.twist_at(edges),
        blade.le_offset_at(edges),
        _polars(turbine, edges),
        options.n_chord,
        blade.camber_at,
        np.array([blade.chord_at(_samples(*ends)).mean() for ends in pairwise(edges)]),
        blade.root_radius,
    )


def _polars(turbine: Turbine, edges: Array) -> Array:
    """Polars of the strips of a blade, with ice on one of them of all blades."""
    blade, ice = turbine.blade, turbine.ice
    polars = np.array([strip_polar(blade, *ends) for ends in pairwise(edges)])
    if ice is None:
        return polars
    share = ice.level * spread(blade, 0.5 * (edges[1:] + edges[:-1]))
    iced = np.array([iced_polar(polar, part) for polar, part in zip(polars, share.tolist(), strict=True)])
    return np.concatenate([iced if b + 1 == ice.blade else polars for b in range(turbine.n_blades)])


def span_edges(blade: Blade, n_span: int, narrow: str = "ends") -> Array:
    """Span edges (n_span + 1,) of the strips of a blade [m].

    A root without lift gets strips of its own, half as many as an even lattice would have there: no strip is cylinder
    and airfoil at once, and where lift sets in, with the vortex that this sheds, the strips are the finer for it. With
    few strips those that carry lift are better narrow at the tip alone (``narrow``), where it falls steeply: ten of
    them then have the loads of forty within 1 %, else 2 to 3 % less.
    """
    edges, start = _lifting(0.0, blade.length, n_span, narrow), blade.lift_start
    if n_span < 2 or start < 0.5 * edges[1]:
        return edges
    n_root = min(max(round(0.5 * np.searchsorted(edges, start)), 1), n_span - 1)
    root = np.linspace(0.0, start, n_root + 1)
    return np.concatenate((root[:-1], _lifting(start, blade.length, n_span - n_root, narrow)))


def _lifting(root: float, tip: float, n_span: int, narrow: str) -> Array:
    """Edges of the strips that carry lift [m]."""
    return span_distribution(root, tip, n_span, TOWARDS_TIP if narrow == "tip" else TOWARDS_ENDS, towards=narrow)


def strip_polar(blade: Blade, low: float, high: float) -> Array:
    """Mean polar (N_ALPHA, 3) of a strip: cl, cd, cm from -pi on.

    The mean over the span, weighted with the chord and the square of the radius: at one angle of attack the strip then
    has the forces of its sections in the flow of the rotation.
    """
    alpha = -np.pi + 2.0 * np.pi / N_ALPHA * np.arange(N_ALPHA)
    z = _samples(low, high)
    weight = blade.chord_at(z) * (blade.root_radius + z) ** 2
    polars = [np.column_stack(blade.polar_at(section).coefficients(alpha)) for section in z]
    return np.asarray(np.einsum("s,sac->ac", weight / weight.sum(), np.array(polars)))


def _samples(low: float, high: float) -> Array:
    """Places of `SAMPLES` sections, in the middles of equal parts of a strip [m]."""
    return low + (high - low) * (np.arange(SAMPLES) + 0.5) / SAMPLES


NACELLE = "nacelle"
"""Name of the body of hub and nacelle."""
SLENDERNESS = 0.75
"""Radius of the body of hub and nacelle over the hub radius: the blade roots and their vortices pass outside."""
ROOT_GAP = 0.05
"""Least distance of that body from the lattice of the blades, in hub radii: room for side-side deflections."""
TOWER_GAP = 0.25
"""Least distance of that body from the top of the tower, in radii of the body."""
HEADING_STEP = math.radians(0.25)
"""The body is turned in steps of this angle [rad]; the influence of all bodies is inverted again at each."""


def turbine_bodies(turbine: Turbine, fidelity: Fidelity, nodes: Array) -> BodySet | None:
    """Closed bodies that a fidelity puts into the flow, with the nacelle at zero yaw.

    Parameters
    ----------
    nodes : array (..., 3)
        Lattice nodes of an undeformed blade in the blade frame [m].

    Raises
    ------
    SimulationError
        If the bodies cannot be built, or would intersect the blades or each other.
    """
    if fidelity.tower_body is None and fidelity.nacelle_body is None:
        return None
    tower, ground, surfaces = turbine.tower, fidelity.aero.ground_height, []
    base, top = np.array([0.0, 0.0, tower.base_height]), np.array([0.0, 0.0, tower.height])
    try:
        nacelle = None
        if fidelity.nacelle_body is not None:
            nacelle = nacelle_surface(turbine, *fidelity.nacelle_body)
            _check_blades(turbine, nacelle, nodes)
        if fidelity.tower_body is not None:
            if nacelle is not None:
                top[2] = _free_height(turbine, nacelle)
            around, along = fidelity.tower_body
            surfaces.append(tower_body(tower.diameter_station, tower.diameter, base, top, around, along, ground=ground))
        if nacelle is not None:
            surfaces.append(nacelle)
        return BodySet(surfaces, ground)
    except AerodynamicsError as error:
        raise SimulationError(f"the bodies of {turbine.name} cannot stand in the flow: {error}") from error


def nacelle_surface(turbine: Turbine, n_around: int, n_along: int) -> BodySurface:
    """Hub and nacelle as one body of revolution about the shaft, which the rotation of the hub leaves as it is.

    A turbine gives no shape of its nacelle. The body has three quarters of the hub radius throughout, less than most
    nacelles, so that the root vortices pass outside. Its nose is half an ellipsoid, one hub radius long upwind of the
    apex. Its tail is half a ball that ends as far downwind of the nacelle's center of mass as the back of the hub, one
    hub radius downwind of the apex, lies upwind of it; at least a tower-top radius downwind of the yaw axis, and at
    least three hub radii behind the nose.

    Parameters
    ----------
    n_around, n_along : int
        Panels; those along are shorter at the ends.

    Returns
    -------
    BodySurface
        In global coordinates, for zero yaw and an undeformed tower.

    Raises
    ------
    SimulationError
        If the hub has no radius.
    """
    hub, nacelle, tower = turbine.hub, turbine.nacelle, turbine.tower
    if not hub.radius > 0.0:
        raise SimulationError(
            f"Fidelity.nacelle_body needs a hub with a radius; that of {turbine.name} is {hub.radius}"
        )
    radius = SLENDERNESS * hub.radius
    front = -nacelle.overhang - hub.radius
    back = max(2.0 * nacelle.cm[0] + nacelle.overhang - hub.radius, 0.5 * tower.diameter[-1], front + 3.0 * hub.radius)
    along = front + 0.5 * (back - front) * (1.0 - np.cos(np.linspace(0.0, np.pi, n_along + 1)))
    nose = np.clip((front + hub.radius - along) / hub.radius, 0.0, 1.0)
    tail = np.clip((along - back + radius) / radius, 0.0, 1.0)
    radii = radius * np.sqrt(np.maximum(1.0 - nose**2 - tail**2, 0.0))
    radii[[0, -1]] = 0.0
    return revolution_body(along, radii, n_around, _shaft_on_yaw_axis(turbine), _shaft(turbine), NACELLE)


def place_nacelle(bodies: BodySet | None, rotation: Array, angular_velocity: Array) -> None:
    """Turn the body of hub and nacelle, if there is one, to the heading of the nacelle, in steps of `HEADING_STEP`.

    Parameters
    ----------
    rotation : array (3, 3)
        From nacelle axes to global ones.
    angular_velocity : array (3,)
        Of the nacelle, global [rad/s]; the rate of the heading moves the surface.
    """
    if bodies is None or NACELLE not in bodies.names:
        return
    heading = HEADING_STEP * round(math.atan2(rotation[1, 0], rotation[0, 0]) / HEADING_STEP)
    n, b = len(bodies.names), bodies.names.index(NACELLE)
    rotations, spins = np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3))
    c, s = math.cos(heading), math.sin(heading)
    rotations[b, :2, :2] = (c, -s), (s, c)
    spins[b, 2] = angular_velocity[2]
    bodies.place(rotations, np.zeros((n, 3)), None, spins)


def _shaft(turbine: Turbine) -> Array:
    """Unit vector along the shaft, downwind, at zero yaw."""
    tilt = turbine.nacelle.tilt
    return np.array([math.cos(tilt), 0.0, -math.sin(tilt)])


def _shaft_on_yaw_axis(turbine: Turbine) -> Array:
    return np.array([0.0, 0.0, turbine.tower.height + turbine.nacelle.tower_top_to_shaft])


def _check_blades(turbine: Turbine, surface: BodySurface, nodes: Array) -> None:
    """Refuse a body that comes close to the lattice of the blades at any pitch."""
    hub, x = turbine.hub, np.reshape(nodes, (-1, 3))
    outward = (hub.radius + x[:, 2]) * math.cos(hub.cone)
    least = float((outward - np.hypot(x[:, 0], x[:, 1]) * abs(math.sin(hub.cone))).min())
    arms = surface.vertices - _shaft_on_yaw_axis(turbine)
    widest = float(np.linalg.norm(np.cross(arms, _shaft(turbine)), axis=1).max())
    if widest > least - ROOT_GAP * hub.radius:
        raise SimulationError(
            f"Fidelity.nacelle_body of {turbine.name}: the body reaches {widest:.3f} m from the shaft, the blade roots "
            f"come to {least:.3f} m; the gap must be at least {ROOT_GAP * hub.radius:.3f} m"
        )


def _free_height(turbine: Turbine, surface: BodySurface) -> float:
    """Height at which the body of the tower ends below that of the nacelle, whatever the yaw [m]."""
    tower, hub, shaft = turbine.tower, turbine.hub, _shaft(turbine)
    arms = surface.vertices - _shaft_on_yaw_axis(turbine)
    widest = float(np.linalg.norm(np.cross(arms, shaft), axis=1).max())
    # the lower side of a cylinder, over the disc on which the tower ends
    lowest = tower.height + turbine.nacelle.tower_top_to_shaft
    lowest -= widest / shaft[0] + 0.5 * tower.diameter[-1] * abs(shaft[2] / shaft[0])
    height = min(tower.height, lowest - TOWER_GAP * SLENDERNESS * hub.radius)
    if not height > tower.base_height:
        raise SimulationError(
            f"Fidelity.nacelle_body of {turbine.name}: the body reaches down to {lowest:.3f} m and leaves no tower body"
        )
    return float(height)
