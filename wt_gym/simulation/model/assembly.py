"""The models of a turbine, put together: everything that depends on the meshes alone and no step changes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from wt_gym.aerodynamics import TowerFlow, VortexLattice
from wt_gym.base.blas_threads import one_blas_thread
from wt_gym.multibody.integrators.schemes import INTEGRATORS
from wt_gym.simulation.fidelity import Fidelity
from wt_gym.simulation.model.blade_lattice import blade_planform
from wt_gym.simulation.model.equilibrium import highest_frequency
from wt_gym.simulation.model.turbine_bodies import turbine_bodies
from wt_gym.simulation.model.turbine_structure import TurbineStructure, build_structure
from wt_gym.turbines import Turbine

__all__ = ["TurbineModels", "assemble", "build_lattice"]


@dataclass(frozen=True)
class TurbineModels:
    """A turbine as structure and lattice.

    Attributes
    ----------
    turbine : Turbine
    fidelity : Fidelity
    structure : TurbineStructure
    lattice : VortexLattice
    tower_flow : TowerFlow
        The cheap form of the tower in the flow.
    time_step : float
        Aerodynamic step [s].
    n_substeps : int
        Structural steps in it.
    embedded : TurbineModels or None
        The same turbine without constraint equations, if these have them: they leave the motion, and so its
        frequencies and its steady state, as they are.
    """

    turbine: Turbine
    fidelity: Fidelity
    structure: TurbineStructure
    lattice: VortexLattice
    tower_flow: TowerFlow
    time_step: float
    n_substeps: int
    embedded: TurbineModels | None = None


def assemble(turbine: Turbine, fidelity: Fidelity, threads: int = 1, generator_damping: float = 0.0) -> TurbineModels:
    """Models of a turbine.

    Parameters
    ----------
    turbine : Turbine
    fidelity : Fidelity
    threads : int
        That share the tree code of the wake.
    generator_damping : float
        Damper between nacelle and rotor [N m s/rad, low-speed shaft].

    Returns
    -------
    TurbineModels

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


def build_lattice(turbine: Turbine, fidelity: Fidelity, threads: int = 1) -> VortexLattice:
    """Vortex lattice of the blades, and of the bodies that the fidelity closes; arguments as of `assemble`."""
    aero = fidelity.aero_for(turbine.drivetrain.rated_rotor_speed)
    planform = blade_planform(turbine, aero)
    bodies = turbine_bodies(turbine, fidelity, planform.nodes)
    return VortexLattice(planform, turbine.n_blades, aero, turbine.air_density, bodies, threads)
