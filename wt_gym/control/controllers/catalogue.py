"""Controllers by name, with gains by rule for any turbine."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wt_gym.base.errors import did_you_mean
from wt_gym.control.bladed import controller as bladed
from wt_gym.control.bladed import rosco
from wt_gym.control.bladed.controller import BladedController
from wt_gym.control.bladed.rosco import RoscoController, rosco_library
from wt_gym.control.controllers import (
    additions,
    fault_supervisor,
    lidar_feedforward,
    linear_optimal,
    own,
    power_tracking,
    supervisor,
    tsr_tracking,
)
from wt_gym.control.controllers.additions import ForeAftDamper, IndividualPitch, SideSideDamper, YawByDeadBand
from wt_gym.control.controllers.controller import Addition, Combined, Controller
from wt_gym.control.controllers.fault_supervisor import FaultSupervisor
from wt_gym.control.controllers.lidar_feedforward import LidarFeedforward
from wt_gym.control.controllers.linear_optimal import LinearOptimalPitch
from wt_gym.control.controllers.own import (
    TUNED,
    own_controller,
    own_parameters,
    record_of,
    retuned_controller,
    tuned_parameters,
)
from wt_gym.control.controllers.parameters import PATH, Parameter, with_defaults
from wt_gym.control.controllers.power_tracking import PowerTracking, PowerTrackingLaw
from wt_gym.control.controllers.supervisor import Supervisor
from wt_gym.control.controllers.tsr_tracking import TsrTrackingController, TsrTrackingParameters

if TYPE_CHECKING:
    from wt_gym.turbines import Turbine

__all__ = [
    "ADDITIONS",
    "BASES",
    "COMPILED",
    "CONTROLLERS",
    "GUARDS",
    "WRAPPERS",
    "catalogue_controller",
    "compiled_files",
    "controller_parameters",
    "controller_summary",
    "declared_parameters",
]


def _discon(turbine: Turbine, **parameters: Any) -> Controller:
    """The turbine's own controller, with published constants where its data have them (`own`)."""
    return own_controller(turbine, **parameters)


def _retuned(turbine: Turbine, gain_factor: float | None = None) -> Controller:
    """The turbine's own controller, below rated at the best tip-speed ratio of the turbine as simulated (`retuned`)."""
    return retuned_controller(turbine, gain_factor)


def _rosco(turbine: Turbine, **parameters: Any) -> Controller:
    """Tip-speed-ratio tracking with a wind estimate, set-point smoothing, peak shaving (`tsr_tracking`)."""
    return TsrTrackingController.of_turbine(turbine, **parameters)


def _ipc(turbine: Turbine, **parameters: Any) -> Addition:
    """Individual pitch against the load once per revolution (`individual_pitch`)."""
    return IndividualPitch.of_turbine(turbine, **parameters)


def _ipc_2p(turbine: Turbine, second_harmonic: float = 0.5, **parameters: Any) -> Addition:
    """Individual pitch against the loads once and twice per revolution."""
    return IndividualPitch.of_turbine(turbine, second_harmonic=second_harmonic, **parameters)


def _constrained_ipc(turbine: Turbine, level: float = 0.1, **parameters: Any) -> Addition:
    """Individual pitch that acts only where the moment in the fixed frame leaves a band of this level."""
    return IndividualPitch.of_turbine(turbine, level=level, **parameters)


def _linear_pitch(turbine: Turbine, **parameters: Any) -> Addition:
    """Mean, tilt and yaw pitch that a least-squares design made, beside a side-side damper (`linear_optimal`)."""
    return LinearOptimalPitch.of_turbine(turbine, **parameters)


def _fore_aft_damper(turbine: Turbine, **parameters: Any) -> Addition:
    """Damper of the tower's fore-aft motion by collective pitch (`tower_dampers`)."""
    return ForeAftDamper.of_turbine(turbine, **parameters)


def _side_side_damper(turbine: Turbine, **parameters: Any) -> Addition:
    """Damper of the tower's side-side motion by generator torque (`tower_dampers`)."""
    return SideSideDamper.of_turbine(turbine, **parameters)


def _yaw(turbine: Turbine, **parameters: Any) -> Addition:
    """Yaw by dead-band (`yaw`)."""
    return YawByDeadBand.of_turbine(turbine, **parameters)


def _lidar(turbine: Turbine, base: Controller, **parameters: Any) -> Controller:
    """Collective pitch ahead of the wind that a lidar sees (`lidar_feedforward`)."""
    return LidarFeedforward.of_turbine(turbine, base, **parameters)  # type: ignore[arg-type]  # checked by the class


def _supervisor(turbine: Turbine, base: Controller, **parameters: Any) -> Controller:
    """Start-up, shut-down, soft or hard cut-out and restart around a base (`supervisor`)."""
    return Supervisor.of_turbine(turbine, base, **parameters)


def _derate_speed(turbine: Turbine, base: Controller, **parameters: Any) -> Controller:
    """No more power than is demanded, by a lower rotor speed (`power_tracking`)."""
    return PowerTracking.of_turbine(turbine, base, "speed", **parameters)


def _derate_torque(turbine: Turbine, base: Controller, **parameters: Any) -> Controller:
    """No more power than is demanded, by a lower torque at rated speed (`power_tracking`)."""
    return PowerTracking.of_turbine(turbine, base, "torque", **parameters)


def _derate_pitch(turbine: Turbine, base: Controller, **parameters: Any) -> Controller:
    """No more power than is demanded, by a higher least pitch that keeps a reserve (`power_tracking`)."""
    return PowerTracking.of_turbine(turbine, base, "pitch", **parameters)


def _derate_kinetic(turbine: Turbine, base: Controller, **parameters: Any) -> Controller:
    """The demanded power, by torque, with the rotor as a store where the wind is too weak (`power_tracking`)."""
    return PowerTracking.of_turbine(turbine, base, "kinetic", **parameters)


def _fault_supervisor(turbine: Turbine, base: Controller, *additions: Addition, **parameters: Any) -> Controller:
    """Watches drives and sensors, repairs readings, falls back to collective pitch (`fault_supervisor`)."""
    return FaultSupervisor.of_turbine(turbine, base, *additions, **parameters)


def _bladed(turbine: Turbine, library: str | None = None, **parameters: Any) -> Controller:
    """A compiled controller with the Bladed interface (`wt_gym.control.bladed`)."""
    if library is None:
        raise ValueError("the controller 'bladed' must be given a library: bladed:path/of/the/library.so")
    return BladedController.of_turbine(turbine, library, **parameters)


def _real_rosco(turbine: Turbine, **parameters: Any) -> Controller:
    """NREL's reference open-source controller itself, from the package rosco (`wt_gym.control.bladed`)."""
    return RoscoController.of_turbine(turbine, **parameters)


BASES: dict[str, Callable[..., Controller]] = {
    "discon": _discon,
    "retuned": _retuned,
    "tsr_tracking": _rosco,
    "rosco": _real_rosco,
    "bladed": _bladed,
}
"""Controllers that decide on pitch and torque."""
ADDITIONS: dict[str, Callable[..., Addition]] = {
    "ipc": _ipc,
    "ipc_2p": _ipc_2p,
    "constrained_ipc": _constrained_ipc,
    "linear_pitch": _linear_pitch,
    "fore_aft_damper": _fore_aft_damper,
    "side_side_damper": _side_side_damper,
    "yaw": _yaw,
}
"""What changes the demand of a controller."""
WRAPPERS: dict[str, Callable[..., Controller]] = {
    "derate_speed": _derate_speed,
    "derate_torque": _derate_torque,
    "derate_pitch": _derate_pitch,
    "derate_kinetic": _derate_kinetic,
    "lidar": _lidar,
    "supervisor": _supervisor,
}
"""What works on a base before all additions, the first within the others."""
GUARDS: dict[str, Callable[..., Controller]] = {"fault_supervisor": _fault_supervisor}
"""What stands around a base with all its additions."""
SHORT_FOR = {
    "tower_dampers": ("fore_aft_damper", "side_side_damper"),
    "linear_optimal": ("side_side_damper", "linear_pitch"),
    **TUNED,
}
"""Names that stand for several parts; those of `TUNED` bring parameters with them."""
CONTROLLERS = (*BASES, *WRAPPERS, *ADDITIONS, *GUARDS, *SHORT_FOR)
"""Every name; additions stand on "discon" where there is no base."""
COMPILED = ("rosco", "bladed")
"""Names of controllers that are libraries of others."""

_DECLARED: dict[str, tuple[tuple[Parameter, ...], tuple[Callable[..., Any], ...]]] = {
    "discon": (own.PARAMETERS, (own_controller, own_parameters)),
    "retuned": (own.RETUNED_PARAMETERS, (_retuned,)),
    "tsr_tracking": (tsr_tracking.PARAMETERS, (TsrTrackingController.of_turbine, TsrTrackingParameters.from_turbine)),
    "rosco": (rosco.PARAMETERS, (RoscoController.of_turbine,)),
    "bladed": (bladed.PARAMETERS, (_bladed, BladedController)),
    "lidar": (lidar_feedforward.PARAMETERS, (LidarFeedforward.of_turbine,)),
    "supervisor": (supervisor.PARAMETERS, (Supervisor.of_turbine,)),
    "derate_speed": (power_tracking.PARAMETERS, (PowerTracking.of_turbine,)),
    "derate_torque": (power_tracking.PARAMETERS, (PowerTracking.of_turbine,)),
    "derate_pitch": (power_tracking.PARAMETERS, (PowerTracking.of_turbine,)),
    "derate_kinetic": (power_tracking.KINETIC_PARAMETERS, (PowerTracking.of_turbine, PowerTrackingLaw)),
    "ipc": (additions.PARAMETERS, (IndividualPitch.of_turbine,)),
    "ipc_2p": (additions.PARAMETERS, (_ipc_2p, IndividualPitch.of_turbine)),
    "constrained_ipc": (additions.PARAMETERS, (_constrained_ipc, IndividualPitch.of_turbine)),
    "linear_pitch": (linear_optimal.PARAMETERS, (LinearOptimalPitch.of_turbine,)),
    "fore_aft_damper": (additions.FORE_AFT_PARAMETERS, (ForeAftDamper.of_turbine,)),
    "side_side_damper": (additions.SIDE_SIDE_PARAMETERS, (SideSideDamper.of_turbine,)),
    "yaw": (additions.YAW_PARAMETERS, (YawByDeadBand,)),
    "fault_supervisor": (fault_supervisor.PARAMETERS, (FaultSupervisor.of_turbine,)),
}
"""What the parts declare, and the functions whose defaults hold, the first before the others."""


@cache
def declared_parameters(name: str) -> tuple[Parameter, ...]:
    """Parameters of one name of the catalogue with unit, allowed values, default and meaning.

    Those of a name that stands for several parts are called ``part__parameter``; the defaults of tuned ones are what
    was found.

    Parameters
    ----------
    name : str
        Of `CONTROLLERS`.

    Raises
    ------
    ValueError
        For another name.

    Examples
    --------
    >>> [parameter.name for parameter in declared_parameters("yaw")]
    ['dead_band', 'stop', 'slow', 'fast']
    """
    if name not in CONTROLLERS:
        raise ValueError(_unknown(name, [name]))
    if name not in SHORT_FOR:
        parameters, makers = _DECLARED[name]
        return with_defaults(parameters, *makers)
    tuned = record_of(name)["best"]["parameters"] if name in TUNED else {}
    found = [
        replace(parameter, name=f"{part}__{parameter.name}")
        for part in SHORT_FOR[name]
        for parameter in declared_parameters(part)
    ]
    return tuple(replace(p, default=tuned[p.name]) if p.name in tuned else p for p in found)


def controller_parameters(name: str) -> dict[str, Any]:
    """Parameters of one name of the catalogue with their defaults; of tuned ones with what was found.

    Those of a name that stands for several parts are called ``part__parameter``.

    Examples
    --------
    >>> controller_parameters("retuned")
    {'gain_factor': None}
    """
    return {parameter.name: parameter.default for parameter in declared_parameters(name)}


def controller_summary(name: str) -> str:
    """What a controller is, in one sentence.

    Parameters
    ----------
    name : str
        Of `CONTROLLERS`.
    """
    if name in SHORT_FOR:
        parts = "+".join(SHORT_FOR[name])
        return f"Stands for {parts}" + (", with the parameters that a search found." if name in TUNED else ".")
    text = inspect.getdoc({**BASES, **WRAPPERS, **ADDITIONS, **GUARDS}[name]) or ""
    return re.sub(r" \(`[a-z_]+`\)(?=\.$)", "", " ".join(text.split()))


def _unknown(choice: str, unknown: list[str]) -> str:
    """Message for names that are none."""
    return (
        f"a controller must be among {', '.join(CONTROLLERS)}; got {', '.join(map(repr, unknown))} in {choice!r}; "
        f"several are joined with '+', for example 'retuned+ipc+yaw'{did_you_mean(unknown[0], CONTROLLERS)}"
    )


def _parts(choice: str) -> tuple[str, ...]:
    """Base, what works on its inside, and additions of a name, checked."""
    parts = [part for name in choice.split("+") for part in SHORT_FOR.get(name, (name,))]
    unknown = [part for part in parts if not any(part in known for known in (BASES, WRAPPERS, ADDITIONS, GUARDS))]
    if unknown:
        raise ValueError(_unknown(choice, unknown))
    if parts[0] not in BASES:
        parts.insert(0, "discon")
    if any(part in BASES for part in parts[1:]) or len(set(parts)) < len(parts):
        raise ValueError(
            f"controller {choice!r} must be one of {', '.join(BASES)} first, then additions "
            f"({', '.join((*WRAPPERS, *ADDITIONS, *GUARDS))}), each once"
        )
    inside = list(WRAPPERS)
    return tuple(
        sorted(
            parts,
            key=lambda part: 0 if part in BASES else 1 + inside.index(part) if part in inside else 1 + len(inside),
        )
    )


def catalogue_controller(choice: str, turbine: Turbine, parameters: dict[str, Any]) -> Controller:
    """Make a controller of names of the catalogue.

    Parameters
    ----------
    choice : str
        Names of `CONTROLLERS` joined with "+".
    turbine : Turbine
    parameters : dict
        As of `wt_gym.control.controllers.make_controller`.

    Raises
    ------
    ValueError
        See `wt_gym.control.controllers.make_controller`.
    """
    parts = _parts(choice)
    tuned = (tuned_parameters(name, turbine) for name in choice.split("+") if name in TUNED)
    given = _distribute(parts, {key: value for found in tuned for key, value in found.items()} | parameters)
    base = BASES[parts[0]](turbine, **given[parts[0]])
    for part in parts:
        if part in WRAPPERS:
            base = WRAPPERS[part](turbine, base, **given[part])
    additions = [ADDITIONS[part](turbine, **given[part]) for part in parts if part in ADDITIONS]
    for part in parts:
        if part in GUARDS:
            return GUARDS[part](turbine, base, *additions, **given[part])
    return Combined(base, *additions) if additions else base


def compiled_files(choice: str, parameters: dict[str, Any]) -> tuple[Path, ...]:
    """Files of others that decide on what a controller does: libraries and their input files.

    Parameters
    ----------
    choice : str
        Names of `CONTROLLERS` joined with "+".
    parameters : dict
        As of `catalogue_controller`.

    Raises
    ------
    ValueError
        See `wt_gym.control.controllers.make_controller`.
    wt_gym.base.errors.ControllerError
        If the package ``rosco`` is needed and not installed.
    """
    parts = _parts(choice)
    given = _distribute(parts, parameters)
    paths = [
        Path(value)
        for part in parts
        for parameter in declared_parameters(part)
        if parameter.word == PATH and (value := given[part].get(parameter.name))
    ]
    return (*paths, rosco_library()) if "rosco" in parts else tuple(paths)


def _distribute(parts: tuple[str, ...], parameters: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Parameters of each part, checked."""
    allowed = {part: {parameter.name: parameter for parameter in declared_parameters(part)} for part in parts}
    given: dict[str, dict[str, Any]] = {part: {} for part in parts}
    for key, value in parameters.items():
        part, _, name = key.rpartition("__")
        owners = [p for p in parts if name in allowed[p] and part in ("", p)]
        if not owners:
            known = "; ".join(f"{p}: {', '.join(names) or 'none'}" for p, names in allowed.items())
            near = did_you_mean(name, [n for p in parts for n in allowed[p] if part in ("", p)])
            raise ValueError(f"no parameter {key!r} in controller {'+'.join(parts)!r}; there are {known}{near}")
        if len(owners) > 1:
            raise ValueError(f"parameter {key!r} belongs to {' and '.join(owners)}; write {owners[0]}__{name}")
        allowed[owners[0]][name].check(value, owners[0])
        given[owners[0]][name] = value
    return given
