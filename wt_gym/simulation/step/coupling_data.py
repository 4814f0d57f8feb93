"""What the coupled step is given beside the structure: the air, how a step is taken, and what passes between them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from wt_gym.aerodynamics.bodies.body_set import BodyArrays, BodyWork
from wt_gym.aerodynamics.state import AeroArrays, AeroConstants, AeroWork, PlanformArrays
from wt_gym.multibody.arrays import Points
from wt_gym.simulation.model.turbine_structure import TurbineStructure, drag_heights
from wt_gym.simulation.step.energy import EnergyBalance

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.simulation.model.assembly import TurbineModels
    from wt_gym.simulation.model.blade_sub_bodies import SubBodyNodes
    from wt_gym.turbines import Turbine

__all__ = ["Air", "CouplingData", "Scheme", "TowerAir"]

MAX_DEFLECTION = 0.4
"""Elastic tip displacement, in blade lengths, beyond which a linear elastic blade has lost its meaning."""
MAX_OVERSPEED = 3.0
"""Rotor speed, in rated speeds, at which a simulation is given up."""


class Air(NamedTuple):
    """The lattice, as the compiled step takes it."""

    planform: PlanformArrays
    constants: AeroConstants
    arrays: AeroArrays  # the state
    work: AeroWork
    bodies: BodyArrays | None  # closed bodies in the flow
    body_work: BodyWork | None


class Scheme(NamedTuple):
    """How a step is taken."""

    dt: float  # aerodynamic step [s]
    h: float  # structural step [s]
    n_sub: int  # structural steps in an aerodynamic one
    n_corrections: int  # corrector passes of the structure
    iterations: int  # most passes of structure and loads
    tolerance: float  # relative change of the loads at which the passes end
    loosest: float  # relative change of the loads with which a step may end


class TowerAir(NamedTuple):
    """The tower in the wind: points that bear its drag, their motion, and the wind and forces there."""

    body: int  # of the multibody system
    points: Points  # n points of the axis, in the frame of the tower
    drag: np.ndarray  # (n,) drag over the square of the speed [kg/m]
    wind: np.ndarray  # (n, 3) [m/s]
    position: np.ndarray  # (n, 3) [m]
    velocity: np.ndarray  # (n, 3) [m/s]
    force: np.ndarray  # (n, 3) [N]
    given: np.ndarray  # (6 + n_f,) loads of the tower beside the drag [N, N m, generalized]

    @classmethod
    def of(cls, turbine: Turbine, structure: TurbineStructure) -> TowerAir:
        """The tower of a turbine at rest; a force per length is integrated over its height by Simpson's rule."""
        tower, points = turbine.tower, structure.drag_points
        height = drag_heights(tower)
        length = (height[1] - height[0]) / 3.0 * np.array([1.0, *[4.0, 2.0] * (len(height) // 2 - 1), 4.0, 1.0])
        pressure_width = 0.5 * turbine.air_density * tower.drag_coefficient * tower.diameter_at(height)
        rest = points.position + np.array([0.0, 0.0, tower.base_height])
        free = np.zeros((3, *rest.shape))
        given = np.zeros(structure.system.new_inputs().body_loads.shape[2])
        return cls(structure.tower, points, pressure_width * length, free[0], rest, free[1], free[2], given)


class CouplingData(NamedTuple):
    """What passes between structure and air, and the limits of the model."""

    nodes: np.ndarray  # (n_blades, n_chord + 1, n_span + 1, 3) lattice nodes [m]
    velocities: np.ndarray  # same shape, of the nodes [m/s]
    points: Points  # of the lattice on a blade, or on its sub-bodies
    lattice_bodies: (
        np.ndarray
    )  # int64 (n_lattice_bodies,) bodies that carry them: the blades, or their sub-bodies blade by blade
    sub_bodies: SubBodyNodes | None  # None: a blade is one body
    elastic_q: np.ndarray  # int64 (n_lattice_bodies, n_f) where the coordinates of a carrier are in the state
    elastic_u: np.ndarray  # int64 (n_lattice_bodies, n_f) and their rates
    elastic: np.ndarray  # (n_lattice_bodies, n_f) coordinates of the carriers [m, rad, 1]
    elastic_rate: np.ndarray  # (n_lattice_bodies, n_f) and their rates [1/s of these]
    previous_loads: np.ndarray  # (n_b, 6 + n_f) of the bodies, one step ago [N, N m, generalized]
    passes: np.ndarray  # (2, n_b, 6 + n_f) loads under which the blades moved, and their last change [the same]
    relaxation: np.ndarray  # (3,) share taken of a change of the loads, and sums of its secants [the squares]
    energy: EnergyBalance
    tip: np.ndarray  # (3, n_f) displacement of a tip per elastic coordinate
    tower: TowerAir
    max_speed: float  # [rad/s]
    max_deflection: float  # [m]

    @classmethod
    def of(cls, models: TurbineModels, body_loads: NDArray[np.float64]) -> CouplingData:
        """Arrays for a turbine whose bodies bear loads of the shape of ``body_loads`` (2, n_b, 6 + n_f)."""
        structure, shape = models.structure, models.lattice.nodes_shape
        system, points = structure.system, structure.lattice_points
        lattice_bodies, each = structure.lattice_bodies, np.arange(points.linear.shape[-1])
        q = np.add.outer([system.index(body, "elastic_q") for body in lattice_bodies], each)
        u = np.add.outer([system.index(body, "elastic_u") for body in lattice_bodies], each) + system.n_q
        return cls(
            nodes=np.zeros(shape), velocities=np.zeros(shape), points=points, lattice_bodies=lattice_bodies,
            sub_bodies=structure.sub_body_nodes,
            elastic_q=q, elastic_u=u, elastic=np.zeros(q.shape), elastic_rate=np.zeros(q.shape),
            previous_loads=np.zeros_like(body_loads[0]), passes=np.zeros_like(body_loads),
            relaxation=np.array([1.0, 0.0, 0.0]), energy=EnergyBalance.of(models),
            tip=np.ascontiguousarray(structure.tip_points.linear[0]), tower=TowerAir.of(models.turbine, structure),
            max_speed=MAX_OVERSPEED * models.turbine.drivetrain.rated_rotor_speed,
            max_deflection=MAX_DEFLECTION * models.turbine.blade.length,
        )  # fmt: skip
