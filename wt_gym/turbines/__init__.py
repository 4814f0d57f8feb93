"""What a turbine is: windIO files and OpenFAST models turned into validated, frozen dataclasses.

``load_turbine("nrel_5mw")``, ``load_turbine("my_turbine.yaml")`` and ``load_turbine("model.fst")`` return a
:class:`Turbine`; ``catalog()`` lists the names.
"""

from wt_gym.turbines.airfoil import Airfoil, Polar, RotationalAugmentation
from wt_gym.turbines.blade import BeamStations, Blade, BladeIce
from wt_gym.turbines.catalog import catalog, load_turbine
from wt_gym.turbines.model import ControlData, Drivetrain, Hub, Nacelle, PitchSystem, Support, Tower, Turbine

__all__ = [
    "Airfoil",
    "BeamStations",
    "Blade",
    "BladeIce",
    "ControlData",
    "Drivetrain",
    "Hub",
    "Nacelle",
    "PitchSystem",
    "Polar",
    "RotationalAugmentation",
    "Support",
    "Tower",
    "Turbine",
    "catalog",
    "load_turbine",
]
