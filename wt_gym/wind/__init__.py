"""The undisturbed wind: velocity at points and a time, steady, with the IEC's transients, turbulent, or from files.

>>> from wt_gym.wind import SteadyInflow
>>> SteadyInflow(8.0, hub_height=90.0, shear_exponent=0.2).velocity([0.0, 0.0, 90.0], time=0.0).tolist()
[8.0, 0.0, 0.0]
"""

from wt_gym.wind.files import read_bts, wind_from, write_bts
from wt_gym.wind.iec import TransientInflow
from wt_gym.wind.inflow import Inflow, MirroredInflow, TurningInflow
from wt_gym.wind.series import SeriesInflow
from wt_gym.wind.steady import SteadyInflow
from wt_gym.wind.turbulence_box import TurbulenceBox
from wt_gym.wind.turbulent import PathInflow, TurbulentInflow

__all__ = [
    "Inflow", "MirroredInflow", "PathInflow", "SeriesInflow", "SteadyInflow", "TransientInflow", "TurbulenceBox",
    "TurbulentInflow", "TurningInflow", "read_bts", "wind_from", "write_bts",
]  # fmt: skip
