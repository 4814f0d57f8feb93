"""Arrays of the running balances of energy of one turbine."""

import math
from typing import NamedTuple

import numpy as np

from wt_gym.simulation.model.turbine_structure import rotor_axial_inertia
from wt_gym.simulation.step.energy_kernels import BETZ

__all__ = ["EnergyBalance"]

RESERVE = 0.01
"""Energy from nothing that is let pass once, in kinetic energies of the rotor at rated speed: rounding of the sums."""


class EnergyBalance(NamedTuple):
    """What the balances of :mod:`wt_gym.simulation.step.energy_kernels` know of a turbine, and where they stand."""

    reserve: float  # [J] that the structure may gain at most
    flux: float  # 16/27 of rho A / 2 [kg/m]
    sphere: float  # half the mass of air in the sphere round the rotor [kg]
    per_force: float  # 1 / (2 rho A) [m/kg]: induced speed squared by force
    share: np.ndarray  # (n_span + 1,) shares of the swept area that the span nodes stand for
    is_blade: np.ndarray  # bool (n_b,)
    servo_body: np.ndarray  # (n_servo,) body that each servo turns
    servo_axis: np.ndarray  # (n_servo, 3) its axis, body components
    force: np.ndarray  # (3,) work
    # the state, each (1,)
    looked: np.ndarray  # int64: steps since the energy of the structure was looked at, -1 at the start
    held: np.ndarray  # that energy [J]
    work: np.ndarray  # given since [J]
    traffic: np.ndarray  # the same of the sizes of all parts [J]
    gained: np.ndarray  # gained from nothing so far [J]
    borrowed: np.ndarray  # taken from the air beyond Betz's limit [J]
    lively: np.ndarray  # mean square of the wind and what the rotor induces [m²/s²]
    given: np.ndarray  # powers of the last step [W]: given to the structure, sizes of its parts, of the air on blades
    passing: np.ndarray
    of_air: np.ndarray
    carried: np.ndarray  # mean cube of the wind of the last step [m³/s³]

    @classmethod
    def of(cls, models):
        """Balances of a turbine at a start."""
        turbine, structure = models.turbine, models.structure
        system = structure.system
        radius, density = 0.5 * turbine.rotor_diameter, turbine.air_density
        area, n_b = math.pi * radius**2, len(system.bodies)
        inertia = rotor_axial_inertia(turbine, structure.blade_inertia)
        driven = system.tree.constraint_servo >= 0
        turned = [b for b, joint in enumerate(system.joints) if joint.kind == "servo"]
        axes = [system.joints[b].axis for b in turned]
        state = {name: np.zeros(1) for name in STATE}
        return cls(
            reserve=RESERVE * 0.5 * inertia * turbine.drivetrain.rated_rotor_speed**2,
            flux=BETZ * 0.5 * density * area, sphere=0.5 * density * 4.0 / 3.0 * math.pi * radius**3,
            per_force=0.5 / (density * area), share=_disc_shares(models),
            is_blade=np.isin(np.arange(n_b), structure.lattice_bodies),
            servo_body=np.concatenate([turned, system.tree.constraint_body[driven, 1]]).astype(np.int64),
            servo_axis=np.concatenate([axes, system.tree.constraint_axis[driven]]),
            force=np.zeros(3), **(state | {"looked": np.full(1, -1)}),
        )  # fmt: skip

    @property
    def excess_limit(self):
        """What the air may give beyond Betz's limit [J]."""
        return self.sphere * self.lively[0]

    def state(self):
        """Arrays that carry state, by name."""
        return {name: getattr(self, name) for name in STATE}

    def begin(self):
        """Start anew."""
        for array in self.state().values():
            array[:] = 0
        self.looked[:] = -1


STATE = EnergyBalance._fields[EnergyBalance._fields.index("looked") :]


def _disc_shares(models):
    """Shares of the swept area round each span node: annuli between middles of strips, the inner to the axis."""
    span = models.turbine.hub.radius + models.lattice.planform.nodes[0, :, 2]
    edges = np.concatenate([[0.0], 0.5 * (span[1:] + span[:-1]), [span[-1]]])
    area = np.diff(edges**2)
    return area / area.sum()
