"""What happens between two samples: extremes over every structural step, so that control steps miss nothing.

A blade tip passes the tower in a tenth of a second, and a shaft or a blade swings faster than a controller samples.
The largest and smallest values since the last sample are therefore taken at every structural step, and the clearance
of the tips along the straight ways between them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.simulation.model.turbine_structure import TurbineStructure

__all__ = ["Extremes", "Monitor"]


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
    def of(cls, structure: TurbineStructure, body_loads: NDArray[np.float64], n_blades: int) -> Monitor:
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
