"""Arrays of the coupled step: energy, extremes, tower, what passes between structure and air, and the signals.

A blade tip passes the tower in a tenth of a second, and a shaft or a blade swings faster than a controller samples.
The largest and smallest values since the last sample are therefore taken at every structural step, and the clearance
of the tips along the straight ways between them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from wt_gym.aerodynamics.bodies.body_set import BodyArrays, BodyWork
from wt_gym.aerodynamics.state import AeroArrays, AeroConstants, AeroWork, PlanformArrays
from wt_gym.base.compiled import compiled_for
from wt_gym.base.quantities import Array
from wt_gym.hydrodynamics.loads import PlatformArrays
from wt_gym.multibody.arrays import Points, Work
from wt_gym.simulation.channels import new_values, place_of
from wt_gym.simulation.models import TurbineModels
from wt_gym.simulation.step import measurement_kernels, water_kernels
from wt_gym.simulation.step.energy_kernels import BETZ
from wt_gym.simulation.turbine_structure import (
    SubBodyNodes,
    TurbineStructure,
    drag_heights,
    rotation_x,
    rotation_y,
    rotor_axial_inertia,
)
from wt_gym.turbines import Turbine
from wt_gym.turbines.variants import electrical_power

RESERVE = 0.01
"""Energy beyond the work done that is let pass once, for the rounding of the sums, in kinetic energies of the rotor at
rated speed."""


class EnergyBalance(NamedTuple):
    """What the balances of :mod:`wt_gym.simulation.step.energy_kernels` know of a turbine, and where they stand."""

    reserve: float  # [J] that the structure may gain at most
    flux: float  # 16/27 of rho A / 2, A the swept area [kg/m]
    sphere: float  # half the mass of air in the sphere round the rotor [kg]
    per_force: float  # 1 / (2 rho A) [m/kg]: induced speed squared by force
    share: np.ndarray  # (n_span + 1,) shares of the swept area that the span nodes stand for, their sum is 1
    is_blade: np.ndarray  # bool (n_b,) bodies of blades
    servo_body: np.ndarray  # int64 (n_servo,) body that each servo turns
    servo_axis: np.ndarray  # (n_servo, 3) unit vector of its axis, body components
    force: np.ndarray  # (3,) scratch: of the air on the blades [N]
    # the state, each (1,)
    steps_since_check: np.ndarray  # int64: since the energy of the structure was summed, -1 at the start
    held: np.ndarray  # that energy [J]
    work: np.ndarray  # given since [J]
    traffic: np.ndarray  # the same of the sizes of all parts [J]
    gained: np.ndarray  # gained by the structure beyond the work done on it, so far [J]
    excess_energy: np.ndarray  # taken from the air beyond Betz's limit [J]
    mean_square_speed: np.ndarray  # of the wind and what the rotor induces [m²/s²]
    given: np.ndarray  # power given to the structure in the last step [W]
    passing: np.ndarray  # sum of the sizes of its parts [W]
    of_air: np.ndarray  # power of the air on the blades [W]
    convected_power: np.ndarray  # Betz's share of what the wind carried through the swept area in the last step [W]

    @classmethod
    def of(cls, models: TurbineModels) -> EnergyBalance:
        """Balances of a turbine at a start."""
        turbine, structure = models.turbine, models.structure
        system = structure.system
        radius, density = 0.5 * turbine.rotor_diameter, turbine.air_density
        area, n_b = math.pi * radius**2, len(system.bodies)
        inertia = rotor_axial_inertia(turbine, structure.blade_inertia)
        tree = system.tree
        driven = tree.constraint_servo >= 0
        turned = [b for b, joint in enumerate(system.joints) if joint.kind == "servo"]
        axes = [system.joints[b].axis for b in turned]
        state: dict[str, NDArray[Any]] = {name: np.zeros(1) for name in STATE}
        return cls(
            reserve=RESERVE * 0.5 * inertia * turbine.drivetrain.rated_rotor_speed**2,
            flux=BETZ * 0.5 * density * area, sphere=0.5 * density * 4.0 / 3.0 * math.pi * radius**3,
            per_force=0.5 / (density * area), share=_disc_shares(models),
            is_blade=np.isin(np.arange(n_b), structure.lattice_bodies),
            servo_body=np.concatenate([turned, tree.constraint_body[driven, 1]]).astype(np.int64),
            servo_axis=np.concatenate([axes, tree.constraint_axis[driven]]),
            force=np.zeros(3), **(state | {"steps_since_check": np.full(1, -1)}),
        )  # fmt: skip

    @property
    def excess_limit(self) -> float:
        """What the air may give beyond Betz's limit [J]."""
        return float(self.sphere * self.mean_square_speed[0])

    def state(self) -> dict[str, NDArray[Any]]:
        """Arrays that carry state, by name."""
        return {name: getattr(self, name) for name in STATE}

    def begin(self) -> None:
        """Restart the balance."""
        for array in self.state().values():
            array[:] = 0
        self.steps_since_check[:] = -1


STATE = EnergyBalance._fields[EnergyBalance._fields.index("steps_since_check") :]


def _disc_shares(models: TurbineModels) -> Array:
    """Shares of the swept area round each span node: annuli between middles of strips, the inner to the axis."""
    span = models.turbine.hub.radius + models.lattice.planform.nodes[0, :, 2]
    edges = np.concatenate([[0.0], 0.5 * (span[1:] + span[:-1]), [span[-1]]])
    area = np.diff(edges**2)
    return np.asarray(area / area.sum())


class Extremes(NamedTuple):
    """Largest and smallest values and pitch travel of an interval; the fields are channels of the signals."""

    rotor_speed_max: np.ndarray  # (1,) of the hub [rad/s]
    tower_base_moment_max: np.ndarray  # (1,) size of the bending moment [N m]
    tip_clearance_min: np.ndarray  # (n_blades,) signed [m]
    tip_out_of_plane_max: np.ndarray  # (n_blades,) [m]
    root_flap_moment_max: np.ndarray  # (n_blades,) size [N m]
    pitch_travel: np.ndarray  # (n_blades,) both directions, over the aerodynamic steps [rad]

    def restart(self) -> None:
        """Begin a new interval."""
        for array, begin in zip(self, _BEGIN, strict=True):
            array.fill(begin)


_BEGIN = [{"_min": np.inf, "_max": -np.inf}.get(name[-4:], 0.0) for name in Extremes._fields]


class Monitor(NamedTuple):
    """Extremes, and what the compiled step needs to take them."""

    extremes: Extremes
    pitch: np.ndarray  # (n_blades,) at the end of the last step [rad]
    passed: np.ndarray  # (n_blades, 4) where the tips were last, see coupling_kernels.view_from_tower [m]
    between: np.ndarray  # (4,) scratch: a view between two [m]
    loads: np.ndarray  # (n_b, 6 + n_f) scratch: loads of the air at a structural step [N, N m, generalized]
    tower: int  # body of the multibody system
    generator_u: int  # speed of the generator in the state
    first_pitch: int  # pitch of blade 1 in the state; those of the others follow
    torsion_u: int  # speed of the shaft's torsion in the state; -1 for a rigid shaft

    @classmethod
    def of(cls, structure: TurbineStructure, body_loads: Array, n_blades: int) -> Monitor:
        """Monitor of a structure whose bodies bear loads of the shape of ``body_loads`` (2, n_b, 6 + n_f)."""
        one, each = (1,), (n_blades,)
        system = structure.system
        torsion = system.n_q + system.index(structure.hub, "joint_u") if structure.shaft_flexible else -1
        extremes = Extremes(
            np.zeros(one), np.zeros(one), np.zeros(each), np.zeros(each), np.zeros(each), np.zeros(each)
        )
        first_pitch = system.n_q + system.n_u + 1  # behind the yaw drive
        return cls(
            extremes, np.zeros(each), np.zeros((n_blades, 4)), np.zeros(4), np.zeros_like(body_loads[0]),
            structure.tower, system.n_q + structure.azimuth_u, first_pitch, torsion,
        )  # fmt: skip


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


class Water(NamedTuple):
    """The floater in the water."""

    body: int  # of the multibody system
    platform: PlatformArrays  # its hydrodynamics, with their state
    at: int  # where its channels stand among the values
    velocity: np.ndarray  # (3,) scratch: of the floater's origin, global axes [m/s]
    spin: np.ndarray  # (3,) scratch: its angular velocity, global axes [rad/s]
    force: np.ndarray  # (6,) scratch: force and moment of the water and the lines, global axes [N, N m]

    @classmethod
    def of(cls, turbine: Turbine, structure: TurbineStructure, platform: PlatformArrays) -> Water:
        """The floater of a turbine."""
        assert structure.floater is not None
        at = place_of(turbine.n_blades, turbine.n_lines, "platform_surge")
        return cls(structure.floater, platform, at, np.zeros(3), np.zeros(3), np.zeros(6))


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
    water: Water | None  # None: the turbine stands on the ground
    max_speed: float  # [rad/s]
    max_deflection: float  # [m]

    @classmethod
    def of(cls, models: TurbineModels, body_loads: Array, platform: PlatformArrays | None) -> CouplingData:
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
            water=None if platform is None else Water.of(models.turbine, structure, platform),
            max_speed=MAX_OVERSPEED * models.turbine.drivetrain.rated_rotor_speed,
            max_deflection=MAX_DEFLECTION * models.turbine.blade.length,
        )  # fmt: skip


class StateIndices(NamedTuple):
    """Where in the state what is measured stands, and constants of the drive train."""

    azimuth_q: int  # of the generator
    azimuth_u: int  # its speed
    torsion_q: int  # of the shaft; -1 for a rigid one
    torsion_u: int  # its rate
    yaw_q: int  # of the yaw spring; -1 without
    yaw_u: int  # its rate
    tower: int  # body
    gear_ratio: float  # [-]
    generator_efficiency: float  # [-]

    @classmethod
    def of(cls, turbine: Turbine, structure: TurbineStructure) -> StateIndices:
        """Places of a turbine."""
        s, n_q, drive = structure, structure.system.n_q, turbine.drivetrain

        def joint(body: int, flexible: bool) -> tuple[int, int]:
            if not flexible:
                return -1, -1
            return s.system.index(body, "joint_q"), n_q + s.system.index(body, "joint_u")

        return cls(
            s.azimuth_q, n_q + s.azimuth_u, *joint(s.hub, s.shaft_flexible), *joint(s.nacelle, s.yaw_flexible), s.tower,
            drive.gear_ratio, drive.generator_efficiency,
        )  # fmt: skip


class Gauges(NamedTuple):
    """Where a turbine is measured, and what was read there last."""

    hub: int  # body
    nacelle: int  # body
    blades: np.ndarray  # int64 (n_blades,) bodies
    tip_bodies: np.ndarray  # int64 (n_blades,) bodies that carry the tips
    tip_points: Points  # the tip of a blade
    tip_rest: np.ndarray  # (3,) the undeformed tip in the axes of the pitched root [m]
    root_rotation: np.ndarray  # (n_blades, 3, 3) orientation of the unpitched blade roots in the hub
    tower_base: np.ndarray  # (3,) [m]
    tower_moves: bool  # whether it floats
    tower_height: np.ndarray  # (n,) above the base [m]
    tower_radius: np.ndarray  # (n,) [m]
    wrench: np.ndarray  # (n_b, 6) forces and moments in the joints, body axes [N, N m]
    tips: np.ndarray  # (n_blades, 3) [m]
    tip_velocity: np.ndarray  # (n_blades, 3) [m/s]
    deflection: np.ndarray  # (n_blades, 3) of the tips, axes of the unpitched roots [m]
    tower_view: np.ndarray  # (n_blades, 4) of the tips, see coupling_kernels.view_from_tower [m]
    clearance: np.ndarray  # (n_blades,) signed distance of the tips from the tower [m]
    nacelle_acceleration: np.ndarray  # (3,) nacelle axes [m/s²]
    hub_wind: np.ndarray  # (3,) undisturbed wind at the hub [m/s]
    indices: StateIndices
    values: np.ndarray  # (n_channels,) in the order of `wt_gym.simulation.channels.channel_table`
    at: np.ndarray  # int64 (n,) where the channels of `measurement_kernels` stand among them

    @classmethod
    def of(cls, turbine: Turbine, structure: TurbineStructure) -> Gauges:
        """Gauges of a turbine."""
        n, cone = turbine.n_blades, rotation_y(-turbine.hub.cone)
        values, at = new_values(n, turbine.n_lines)
        single = [at[name] for name in measurement_kernels.SINGLE]
        return cls(
            hub=structure.hub, nacelle=structure.nacelle, blades=np.array(structure.blades),
            tip_bodies=np.array([parts[-1] for parts in structure.parts]), tip_points=structure.tip_points,
            tip_rest=structure.tip_rest,
            root_rotation=np.array([rotation_x(2.0 * np.pi * i / n) @ cone for i in range(n)]),
            tower_base=np.array([0.0, 0.0, turbine.tower.base_height]),
            tower_moves=structure.floater is not None,
            tower_height=np.ascontiguousarray(structure.tower_points.position[:, 2]),
            tower_radius=structure.tower_radius, wrench=np.zeros((len(structure.system.bodies), 6)),
            tips=np.zeros((n, 3)), tip_velocity=np.zeros((n, 3)), deflection=np.zeros((n, 3)),
            tower_view=np.zeros((n, 4)), clearance=np.zeros(n), nacelle_acceleration=np.zeros(3),
            hub_wind=np.zeros(3), indices=StateIndices.of(turbine, structure), values=values,
            at=np.array(single + [cast("slice", at[name]).start for name in measurement_kernels.PER_BLADE]),
        )  # fmt: skip


class UndisturbedWind(Protocol):
    """What the hub's wind is read from."""

    def velocity(self, points: Array, time: float) -> Array:
        """Wind at points (n, 3) at a time [m/s]."""
        ...


class MeasuredState(NamedTuple):
    """What is measured: structure and air at one time."""

    y: np.ndarray  # (n_state,) state of the structure
    dy: np.ndarray  # (n_state,) its rate
    body_loads: np.ndarray  # (n_b, 6 + n_f) loads of the air on the bodies
    work: Work  # with the kinematics of the system
    nodes: np.ndarray  # (n_blades, n_points, 3) lattice points [m]
    forces: np.ndarray  # the same, forces of the air on them [N]


class Measurement:
    """Channel values of one simulator.

    Parameters
    ----------
    gauges : Gauges, optional
        Those that the compiled step reads; by default others.

    Attributes
    ----------
    values : array (n_channels,)
        In the order of :func:`wt_gym.simulation.channels.channel_table`, as of the last :meth:`take` or
        :meth:`complete`.
    """

    def __init__(self, turbine: Turbine, structure: TurbineStructure, gauges: Gauges | None = None) -> None:
        self._structure = structure
        self.gauges = Gauges.of(turbine, structure) if gauges is None else gauges
        self.values = self.gauges.values
        self._efficiency, self._drivetrain = float(self.gauges.indices.generator_efficiency), turbine.drivetrain
        self._measure: Callable[..., None] | None = None  # compiled for the types of this turbine
        self._complete: tuple[Callable[..., None], Callable[..., None]] | None = None

    def take(
        self, time: float, instant: MeasuredState, torque: float, command: Array, inflow: UndisturbedWind,
        water: Water | None = None,
    ) -> None:  # fmt: skip
        """Fill ``values`` from a state to which the kinematics belong. Extremes are the current values, travel is none.

        Parameters
        ----------
        time : float
            [s].
        torque : float
            Of the generator [N m, high-speed shaft].
        command : array (2 + n_blades,)
            Of the drives: generator torque [N m], yaw and pitch [rad].
        water : Water, optional
            Of a floater.
        """
        i = instant
        self.gauges.hub_wind[:] = inflow.velocity(i.work.r[self._structure.hub], time)
        arguments = i.y, i.dy, i.body_loads, i.nodes, i.forces, self._structure.system.tree, i.work, self.gauges
        if self._measure is None:
            self._measure = compiled_for(measurement_kernels.measure, arguments)
        self._measure(*arguments)
        if water is not None:
            floating = i.y, i.dy, self._structure.system.tree, i.work, water, self.values
            compiled_for(water_kernels.fill_platform, floating)(*floating)
        g = self.gauges
        efficiency = self._present_efficiency(torque)
        measurement_kernels.measure_rest(float(time), float(torque), efficiency, command, self.values, g.at)

    def _present_efficiency(self, torque: float) -> float:
        """Efficiency of the generator with a torque [N m] at the speed that is among the values [-]."""
        if self._drivetrain.losses is None:
            return self._efficiency
        speed = float(self.values[self.gauges.at[measurement_kernels.GENERATOR_SPEED]])
        shaft = speed * torque
        return self._efficiency if shaft == 0.0 else electrical_power(self._drivetrain, speed, torque) / shaft

    def complete(self, time: float, torque: float, command: Array, extremes: Extremes) -> None:
        """Fill in what the compiled step has left.

        Parameters
        ----------
        time, torque, command
            As for `take`.
        extremes : Extremes
            Since the last sample.
        """
        values, at = self.values, self.gauges.at
        laws = float(time), float(torque), self._present_efficiency(torque), command, values, at
        seen = extremes, values, at
        if self._complete is None:
            rest, extreme = measurement_kernels.measure_rest, measurement_kernels.measure_extremes
            self._complete = compiled_for(rest, laws), compiled_for(extreme, seen)
        fill_rest, fill_extremes = self._complete
        fill_rest(*laws)
        fill_extremes(*seen)
