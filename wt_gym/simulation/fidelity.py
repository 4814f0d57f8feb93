"""Fidelities: how finely air and structure are resolved, and at what price."""

import math
import numbers
from dataclasses import dataclass, field

from wt_gym.aerodynamics.options import ENGINEERING, REFERENCE, TRAINING, AeroOptions
from wt_gym.errors import SimulationError
from wt_gym.multibody.stability import undamped_limit

__all__ = ["FIDELITIES", "Fidelity", "fidelity"]


RESERVE = 0.75
"""Largest ω h of the structural integration, in limits of an undamped mode: modes stiffen with rotation."""


@dataclass(frozen=True)
class Fidelity:
    """Resolution of a simulation.

    Attributes
    ----------
    name : str
    aero : AeroOptions
        Lattice and wake.
    time_step : float or None
        Aerodynamic step [s]. None: the largest step that divides ``step_base`` and turns the rotor at rated speed by no
        more than ``aero.azimuth_step_deg``.
    step_base : float
        Interval [s] that the automatic time step divides; control intervals are multiples of it.
    max_substep : float
        Longest structural step [s]; the aerodynamic step is divided into equal sub-steps, short enough also for the
        stability of the highest structural mode.
    stiffest_shaft : float
        A drivetrain whose torsional frequency [Hz] is higher than this is taken as rigid.
    corrections : int
        Corrector passes of the Hamming scheme in each sub-step.
    coupling_iterations : int
        Most passes of structure and loads through one aerodynamic step.
    coupling_tolerance : float
        The passes end when the loads change by less than this fraction of their size.
    tower_modes : (int, int, int)
        Fore-aft, side-side and torsion modes.
    blade_modes : (int, int, int)
        Flap, edge and torsion modes of each blade.
    tower_elements, blade_elements : int
        Finite elements from which the modes come.
    tower_shadow : bool
        Potential flow round the tower acts on the blades.
    formulation : str
        "embedded": blades on joints, velocities of the joints only; "constrained": free blades held to the hub by
        constraint equations with Lagrange multipliers (Gebhardt et al. 2012). Both describe the same turbine; the
        embedded form is several times faster.
    """

    name: str = "custom"
    aero: AeroOptions = field(default_factory=lambda: TRAINING)
    time_step: float | None = None
    step_base: float = 0.2
    max_substep: float = 0.034
    stiffest_shaft: float = 8.0
    corrections: int = 3
    coupling_iterations: int = 2
    coupling_tolerance: float = 1e-3
    tower_modes: tuple = (2, 2, 1)
    blade_modes: tuple = (2, 1, 0)
    tower_elements: int = 12
    blade_elements: int = 24
    tower_shadow: bool = True
    formulation: str = "embedded"

    def __post_init__(self):
        """Refuse values without meaning."""
        if self.time_step is not None and not 0.0 < self.time_step < 10.0:
            raise SimulationError(f"Fidelity.time_step is {self.time_step}; allowed: None or 0 … 10 s")
        for name, low in (("corrections", 1), ("coupling_iterations", 1), ("tower_elements", 4), ("blade_elements", 4)):
            value = getattr(self, name)
            if not isinstance(value, numbers.Integral) or value < low:
                raise SimulationError(f"Fidelity.{name} is {value!r}; a whole number of at least {low} is needed")
        if not 0.0 < self.max_substep <= 0.5:
            raise SimulationError(f"Fidelity.max_substep is {self.max_substep}; allowed: 0 … 0.5 s")
        if self.formulation not in ("embedded", "constrained"):
            raise SimulationError(f"formulation {self.formulation!r} is unknown; allowed: embedded, constrained")
        for name in ("tower_modes", "blade_modes"):
            modes = getattr(self, name)
            whole = len(modes) == 3 and all(isinstance(count, numbers.Integral) and count >= 0 for count in modes)
            if not whole or sum(modes) < 1:
                raise SimulationError(
                    f"Fidelity.{name} is {modes}; three whole counts with at least one mode are needed"
                )

    def step_for(self, rated_speed):
        """Aerodynamic time step [s] for a rotor with this rated speed [rad/s]."""
        if self.time_step is not None:
            return self.time_step
        longest = math.radians(self.aero.azimuth_step_deg) / rated_speed
        return self.step_base / math.ceil(self.step_base / longest - 1e-9)

    def substeps_for(self, time_step, highest):
        """Number of structural steps in an aerodynamic step, for a highest structural mode [rad/s].

        One, two and three corrector passes are stable up to ω h = 0.276, 0.78 and 1.08 without damping; a quarter is
        kept in reserve.
        """
        phase = RESERVE * undamped_limit(self.corrections)
        return math.ceil(time_step / min(self.max_substep, phase / highest) - 1e-9)


FIDELITIES = {
    "training": Fidelity("training", TRAINING),
    "engineering": Fidelity(
        "engineering", ENGINEERING, max_substep=0.025, coupling_iterations=3, blade_modes=(3, 2, 0)
    ),
    "reference": Fidelity(
        "reference",
        REFERENCE,
        max_substep=0.01,
        stiffest_shaft=50.0,
        coupling_iterations=5,
        coupling_tolerance=1e-5,
        tower_modes=(2, 2, 1),
        blade_modes=(4, 3, 1),
    ),
    # the 13 degrees of freedom of Gebhardt et al. 2012: three of the tower, the rotor, three of each blade
    "gebhardt": Fidelity(
        "gebhardt",
        TRAINING,
        tower_modes=(1, 1, 1),
        blade_modes=(2, 1, 0),
        blade_elements=21,
        stiffest_shaft=0.0,
        coupling_iterations=5,
        formulation="constrained",
    ),
}


def fidelity(choice):
    """Fidelity from a name or a :class:`Fidelity`.

    Raises
    ------
    SimulationError
        For an unknown name.
    """
    if isinstance(choice, Fidelity):
        return choice
    if choice not in FIDELITIES:
        raise SimulationError(f"fidelity {choice!r} is unknown; allowed: {', '.join(FIDELITIES)} or a Fidelity")
    return FIDELITIES[choice]
