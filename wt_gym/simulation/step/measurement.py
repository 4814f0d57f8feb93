"""From the state of the coupled system to the signals an engineer reads."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol, cast

import numpy as np

from wt_gym.base.compiled import compiled_for
from wt_gym.simulation.channels import new_values
from wt_gym.simulation.model.turbine_structure import rotation_x, rotation_y
from wt_gym.simulation.step import measurement_kernels
from wt_gym.turbines.variants import electrical_power

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from wt_gym.multibody.arrays import Points, Work
    from wt_gym.simulation.model.turbine_structure import TurbineStructure
    from wt_gym.simulation.step.monitor import Extremes
    from wt_gym.turbines import Turbine

__all__ = ["Gauges", "MeasuredState", "Measurement"]


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
            q, u = s.system.index(body, "joint_q"), n_q + s.system.index(body, "joint_u")
            return (q, u) if flexible else (-1, -1)

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
        values, at = new_values(n)
        single = [at[name] for name in measurement_kernels.SINGLE]
        return cls(
            hub=structure.hub, nacelle=structure.nacelle, blades=np.array(structure.blades),
            tip_bodies=np.array([parts[-1] for parts in structure.parts]), tip_points=structure.tip_points,
            tip_rest=structure.tip_rest,
            root_rotation=np.array([rotation_x(2.0 * np.pi * i / n) @ cone for i in range(n)]),
            tower_base=np.array([0.0, 0.0, turbine.tower.base_height]),
            tower_height=np.ascontiguousarray(structure.tower_points.position[:, 2]),
            tower_radius=structure.tower_radius, wrench=np.zeros((len(structure.system.bodies), 6)),
            tips=np.zeros((n, 3)), tip_velocity=np.zeros((n, 3)), deflection=np.zeros((n, 3)),
            tower_view=np.zeros((n, 4)), clearance=np.zeros(n), nacelle_acceleration=np.zeros(3),
            hub_wind=np.zeros(3), indices=StateIndices.of(turbine, structure), values=values,
            at=np.array(single + [cast("slice", at[name]).start for name in measurement_kernels.PER_BLADE]),
        )  # fmt: skip


class UndisturbedWind(Protocol):
    """What the hub's wind is read from."""

    def velocity(self, points: NDArray[np.float64], time: float) -> NDArray[np.float64]:
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
    turbine : Turbine
    structure : TurbineStructure
    gauges : Gauges, optional
        Those that the compiled step reads; by default others.

    Attributes
    ----------
    gauges : Gauges
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
        self, time: float, instant: MeasuredState, torque: float, command: NDArray[np.float64], inflow: UndisturbedWind
    ) -> None:
        """Fill ``values`` from a state to which the kinematics belong. Extremes are the present values, travel is none.

        Parameters
        ----------
        time : float
            [s].
        instant : MeasuredState
        torque : float
            Of the generator [N m, high-speed shaft].
        command : array (2 + n_blades,)
            Of the drives: generator torque [N m], yaw and pitch [rad].
        inflow : UndisturbedWind
        """
        i = instant
        self.gauges.hub_wind[:] = inflow.velocity(i.work.r[self._structure.hub], time)
        arguments = i.y, i.dy, i.body_loads, i.nodes, i.forces, self._structure.system.tree, i.work, self.gauges
        if self._measure is None:
            self._measure = compiled_for(measurement_kernels.measure, arguments)
        self._measure(*arguments)
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

    def complete(self, time: float, torque: float, command: NDArray[np.float64], extremes: Extremes) -> None:
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
