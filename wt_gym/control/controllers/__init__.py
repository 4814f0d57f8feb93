"""Controllers that read signals and answer with demands: baselines, additions to them, and the wind estimator.

`make_controller` makes any of them by name. docs/baselines.md says what each does and what it was measured to do.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from wt_gym.control.controllers.additions import (
    AboveRated,
    FadeParameters,
    ForeAftDamper,
    HarmonicPitch,
    HarmonicPitchParameters,
    IndividualPitch,
    SideSideDamper,
    YawByDeadBand,
)
from wt_gym.control.controllers.controller import (
    Addition,
    Combined,
    Controller,
    Readings,
    RepairedReadings,
    WithDemandedPower,
    WithLidar,
    checked_demand,
    lidar_of,
    part_of,
    parts_of,
    readings_of,
)
from wt_gym.control.controllers.discon import BaselineParameters, DisconController, nrel_5mw_parameters
from wt_gym.control.controllers.lidar_feedforward import LidarFeedforward
from wt_gym.control.controllers.own import retuned_parameters
from wt_gym.control.controllers.supervisor import STATES, Supervisor, supervisor_of
from wt_gym.control.controllers.tsr_tracking import TsrTrackingController, TsrTrackingParameters, WindEstimator
from wt_gym.control.rotor import RotorTable, rotor_table
from wt_gym.control.sensors import from_harmonic, to_harmonic

if TYPE_CHECKING:
    from wt_gym.control.controllers.fault_supervisor import FaultSupervisor, fault_supervisor_of
    from wt_gym.control.controllers.names import (
        ADDITIONS,
        BASES,
        COMPILED,
        CONTROLLERS,
        GUARDS,
        WRAPPERS,
        Name,
        controller_parameters,
        controller_summary,
        declared_parameters,
        make_controller,
        name_and_parameters,
        parse_name,
    )

__all__ = [
    "ADDITIONS", "BASES", "COMPILED", "CONTROLLERS", "GUARDS", "STATES", "WRAPPERS", "AboveRated", "Addition",
    "BaselineParameters", "Combined", "Controller", "DisconController",
    "FadeParameters", "FaultSupervisor", "ForeAftDamper", "HarmonicPitch", "HarmonicPitchParameters",
    "IndividualPitch", "LidarFeedforward", "Name", "Readings", "RepairedReadings", "RotorTable", "SideSideDamper",
    "Supervisor", "TsrTrackingController", "TsrTrackingParameters", "WindEstimator",
    "WithDemandedPower", "WithLidar", "YawByDeadBand", "checked_demand", "controller_parameters",
    "controller_summary", "declared_parameters", "fault_supervisor_of", "from_harmonic", "lidar_of",
    "make_controller", "name_and_parameters", "nrel_5mw_parameters", "parse_name", "part_of", "parts_of",
    "readings_of", "retuned_parameters", "rotor_table", "supervisor_of", "to_harmonic",
]  # fmt: skip


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


if not TYPE_CHECKING:  # which would take every name for one of this module

    def __getattr__(name: str) -> Any:
        """Names of the modules that stand above `wt_gym.control.bladed`, which needs modules of this package."""
        for module in ("fault_supervisor", "names") if name in __all__ else ():
            if hasattr(home := import_module(f"{__name__}.{module}"), name):
                globals()[name] = getattr(home, name)
                return globals()[name]
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
