"""Options of generator and converter."""

from __future__ import annotations

from wt_gym.envs.arguments import check_number
from wt_gym.envs.options.group import OptionGroup, option, option_group
from wt_gym.turbines.model import STRONGEST
from wt_gym.turbines.variants import LONGEST_LAG

__all__ = ["ElectricalOptions"]


@option_group
class ElectricalOptions(OptionGroup):
    """Generator and converter, see `wt_gym.turbines.variants`."""

    title = "electrical"

    torque_lag: float = option(
        "float",
        "Time constant with which the generator torque follows its demand; 0: at once, within its greatest rate",
        default=0.0,
        unit="s",
        allowed=f"0 to {LONGEST_LAG:g}",
    )
    loss_map: bool = option(
        "bool",
        "Whether the losses of generator and converter depend on speed and torque; else the efficiency is one number",
        default=False,
    )
    shaft_damping: float = option(
        "float",
        "Damping ratio that the converter adds to the torsion of the shaft by the generator torque; 0: none",
        default=0.0,
        unit="-",
        allowed=f"0 to {STRONGEST:g}",
    )

    def check(self) -> None:
        """Refuse what has no meaning."""
        self._set_all(check_number, "torque_lag", unit="s")
        if not 0.0 <= self.torque_lag <= LONGEST_LAG:
            raise ValueError(f"torque_lag must be from 0 to {LONGEST_LAG:g} s, got {self.torque_lag!r} s")
        self._set_all(check_number, "shaft_damping", unit="-")
        if not 0.0 <= self.shaft_damping <= STRONGEST:
            raise ValueError(f"shaft_damping must be from 0 to {STRONGEST:g}, got {self.shaft_damping!r}")
        if not isinstance(self.loss_map, bool):
            raise ValueError(f"loss_map must be True or False, got {self.loss_map!r}")
