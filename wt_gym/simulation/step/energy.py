"""Arrays of the running balances of energy of one turbine."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from wt_gym.simulation.model.turbine_structure import rotor_axial_inertia
from wt_gym.simulation.step.energy_kernels import BETZ

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.simulation.model.assembly import TurbineModels

__all__ = ["EnergyBalance"]

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


def _disc_shares(models: TurbineModels) -> NDArray[np.float64]:
    """Shares of the swept area round each span node: annuli between middles of strips, the inner to the axis."""
    span = models.turbine.hub.radius + models.lattice.planform.nodes[0, :, 2]
    edges = np.concatenate([[0.0], 0.5 * (span[1:] + span[:-1]), [span[-1]]])
    area = np.diff(edges**2)
    shares: NDArray[np.float64] = area / area.sum()
    return shares
