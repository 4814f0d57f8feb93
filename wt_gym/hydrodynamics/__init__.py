"""Floating platforms: waves, potential flow, drag and mooring. Knows no turbine and no multibody system.

>>> from wt_gym.hydrodynamics import PlatformLoads, load_platform
>>> loads = PlatformLoads(load_platform("oc4_semi"), dt=0.1)
>>> bool(loads.static_force([10.0, 0.0, 0.0], [[1, 0, 0], [0, 1, 0], [0, 0, 1]])[0] < -8e5)
True
"""

from wt_gym.hydrodynamics.drag import DragMember, HeavePlate
from wt_gym.hydrodynamics.loads import PlatformArrays, PlatformLoads
from wt_gym.hydrodynamics.mooring import MooringLine
from wt_gym.hydrodynamics.platform import PLATFORMS, Platform, load_platform
from wt_gym.hydrodynamics.potential import ExcitationTable, MeanDrift, RadiationTable, StateSpace, fit_radiation
from wt_gym.hydrodynamics.waves import SeaState, WaveComponents, wave_number

__all__ = [
    "PLATFORMS", "DragMember", "ExcitationTable", "HeavePlate", "MeanDrift", "MooringLine", "Platform",
    "PlatformArrays", "PlatformLoads", "RadiationTable", "SeaState", "StateSpace", "WaveComponents", "fit_radiation",
    "load_platform", "wave_number",
]  # fmt: skip
