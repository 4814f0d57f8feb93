"""Options of generator and converter."""

from __future__ import annotations

from wt_gym.base.options import Options, option, option_record
from wt_gym.turbines.model import STRONGEST
from wt_gym.turbines.variants import LONGEST_LAG

__all__ = ["ElectricalOptions"]


@option_record
class ElectricalOptions(Options):
    """Generator and converter, see `wt_gym.turbines.variants`."""

    title = "electrical"

    torque_lag: float = option(
        "Time constant with which the generator torque follows its demand; 0: at once, within its greatest rate",
        default=0.0,
        unit="s",
        low=0.0,
        high=LONGEST_LAG,
    )
    loss_map: bool = option(
        "Losses of generator and converter that depend on speed and torque; else the efficiency is one number",
        default=False,
    )
    shaft_damping: float = option(
        "Damping ratio that the converter adds to the torsion of the shaft by the generator torque; 0: none",
        default=0.0,
        unit="-",
        low=0.0,
        high=STRONGEST,
    )
