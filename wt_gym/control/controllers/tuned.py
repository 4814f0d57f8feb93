"""Parameters that a search found: the reference that learned control is compared with.

The records of `wt_gym.experiment.tuning` lie in ``data/tuned*.json`` with the cost, the winds, the seeds and every
trial; docs/baselines.md says what they are worth. They were found on the NREL 5-MW. On another turbine the numbers
without a dimension are the same, and times go with the turn of the rotor.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wt_gym.control.controllers.rotor_rules import same_rotor
from wt_gym.turbines import load_turbine

if TYPE_CHECKING:
    from wt_gym.turbines import Turbine

__all__ = ["TUNED", "record_of", "tuned_parameters"]

TUNED: dict[str, tuple[str, ...]] = {
    "tuned": ("constrained_ipc", "fore_aft_damper", "side_side_damper"),
    "tuned_lidar": ("lidar", "constrained_ipc", "fore_aft_damper", "side_side_damper"),
}
"""Names of controllers with a record, and the parts that the search had."""

_HOME = "nrel_5mw"
"""Turbine of the records."""
_TIMES = ("leak_time", "proportional_time", "delay")


def tuned_parameters(name: str, turbine: Turbine) -> dict[str, float]:
    """Parameters of least cost of a name of `TUNED`, keyed ``part__parameter``.

    Parameters
    ----------
    name : str
    turbine : Turbine
        Another one than that of the record gets them scaled, see above.
    """
    found: dict[str, float] = record_of(name)["best"]["parameters"]
    home = load_turbine(_HOME)
    if same_rotor(home, turbine):
        return dict(found)
    slower = home.drivetrain.rated_rotor_speed / turbine.drivetrain.rated_rotor_speed
    return {key: value * (slower if _name(key) in _TIMES else 1.0) for key, value in found.items()}


def _name(key: str) -> str:
    return key.rpartition("__")[2]


@cache
def record_of(name: str) -> dict[str, Any]:
    """Record of the search behind a name of `TUNED`, as `wt_gym.experiment.tuning.tune` writes it."""
    path = Path(__file__).with_name("data") / f"{name}.json"
    out: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return out
