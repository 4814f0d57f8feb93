"""The turbine's own controller: with what its data publish, and by rule where they say nothing.

Two laws share one set of constants (`BaselineParameters`). A turbine whose data have the gains of a torque controller
that tracks the tip-speed ratio, or a least pitch over the wind (peak shaving), gets the one that estimates the wind
(`TsrTrackingController.published`); any other the torque curve of the NREL 5-MW's (`DisconController`).

The baseline controller with a region-2 gain that fits the turbine as simulated.

The published gain belongs to the rotor of blade-element momentum theory. The lattice's rotor has its best power at a
higher tip-speed ratio, so that a smaller gain makes more power. `FOUND` holds the multiple of the published gain that
made the most power in coupled runs (the turbine's record); docs/baselines.md says how it was found. It belongs to the
rotor and its drive train, whatever tower or monopile these stand on. Any other turbine gets the gain of the optimum
of its own table, ``rho pi R^5 Cp / (2 lambda^3 N^3)`` times the gearbox efficiency.

Parameters that a search found: the reference that learned control is compared with.

The records of `wt_gym.experiment.tuning` lie in ``data/tuned*.json`` with the cost, the winds, the seeds and every
trial; docs/baselines.md says what they are worth. They were found on the NREL 5-MW. On another turbine the numbers
without a dimension are the same, and times go with the turn of the rotor.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from functools import cache, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wt_gym.base.errors import ControllerError
from wt_gym.base.warn_once import warn_once
from wt_gym.control.controllers.discon import BaselineParameters, DisconController, GainTable
from wt_gym.control.controllers.parameters import Parameter
from wt_gym.control.controllers.tsr_tracking import TsrTrackingController, TsrTrackingParameters, WindEstimator
from wt_gym.control.design import same_rotor
from wt_gym.control.operating_point import design_point, tracks_tip_speed_ratio
from wt_gym.control.rotor import RotorTable, blade_element_table, rotor_table
from wt_gym.control.stability import check_speed_loop, check_torque_curve, growing_mode, growth
from wt_gym.turbine_records import RECORDS
from wt_gym.turbines import load_turbine

if TYPE_CHECKING:
    from collections.abc import Callable

    from wt_gym.control.controllers.controller import Controller
    from wt_gym.turbines import Turbine

__all__ = [
    "PARAMETERS", "TUNED", "own_controller", "own_law", "own_parameters", "record_of", "tuned_parameters",
]  # fmt: skip


def _field(name: str) -> Callable[[Turbine], float]:
    """A number of the turbine's own controller."""
    return lambda turbine: float(getattr(BaselineParameters.from_turbine(turbine), name))


def _gain(row: str, otherwise: str) -> Callable[[Turbine], float]:
    """First gain of the table, or that without a table."""

    def in_use(turbine: Turbine) -> float:
        made = BaselineParameters.from_turbine(turbine)
        return float(getattr(made, otherwise) if made.gain_table is None else getattr(made.gain_table, row)[0])

    return in_use


def _doubling(turbine: Turbine) -> float | None:
    made = BaselineParameters.from_turbine(turbine)
    return made.gain_doubling_pitch if made.gain_table is None else None


def _pole(name: str) -> Callable[[Turbine], float | None]:
    """Frequency or damping ratio of gains by rule; None where gains are published."""

    def in_use(turbine: Turbine) -> float | None:
        by_rule = turbine.control is None or turbine.control.gain_pitch is None
        return float(getattr(design_point(turbine), name)) if by_rule else None

    return in_use


def _region_2_gain(turbine: Turbine) -> float:
    return BaselineParameters.from_turbine(turbine).torque.region_2_gain


def _tip_speed_ratio(turbine: Turbine) -> float:
    if not tracks_tip_speed_ratio(turbine):
        return design_point(turbine).tip_speed_ratio
    own = turbine.control
    return (own and own.optimal_tip_speed_ratio) or blade_element_table(turbine).optimum[0]


def _has_torque_curve(turbine: Turbine) -> bool:
    return not tracks_tip_speed_ratio(turbine)


_ITS_OWN = "the turbine's own"
PARAMETERS = (
    Parameter(
        "kp", "s", "proportional gain from generator speed to pitch at zero pitch, or at the first of a table", 0.0,
        otherwise=_ITS_OWN, in_use=_gain("proportional", "proportional_gain"),
    ),
    Parameter(
        "ki", "-", "integral gain from generator speed to pitch, likewise", 0.0, above=True, otherwise=_ITS_OWN,
        in_use=_gain("integral", "integral_gain"),
    ),
    Parameter(
        "gain_doubling_pitch", "rad", "pitch at which the gains are halved; takes the place of a table", 0.0,
        above=True, otherwise=_ITS_OWN, in_use=_doubling,
    ),
    Parameter(
        "natural_frequency", "rad/s", "of the speed loop: gains by rule in place of published ones", 0.0, above=True,
        otherwise="gains as published, else by rule", in_use=_pole("natural_frequency"),
    ),
    Parameter(
        "damping_ratio", "-", "of the speed loop: gains by rule in place of published ones", 0.0, above=True,
        otherwise="gains as published, else by rule", in_use=_pole("damping_ratio"),
    ),
    Parameter(
        "corner_frequency", "rad/s", "of the low-pass filter on the generator speed", 0.0, above=True,
        otherwise=_ITS_OWN, in_use=_field("corner_frequency"),
    ),
    Parameter(
        "filter_damping", "-", "of that filter; 0: first order", 0.0, otherwise=_ITS_OWN,
        in_use=_field("filter_damping"),
    ),
    Parameter(
        "notch_frequency", "rad/s", "of a notch before that filter; 0: none", 0.0, otherwise=_ITS_OWN,
        in_use=_field("notch_frequency"),
    ),
    Parameter(
        "reference_speed", "rad/s", "generator speed that is held above rated", 0.0, above=True, otherwise=_ITS_OWN,
        in_use=_field("reference_speed"),
    ),
    Parameter(
        "min_pitch", "rad", "least pitch, of a controller with a torque curve", -math.pi, math.pi,
        otherwise=_ITS_OWN, in_use=_field("min_pitch"), only_of=_has_torque_curve,
    ),
    Parameter(
        "region_3_min_pitch", "rad", "pitch from which on region 3 holds, of a controller with a torque curve",
        -math.pi, math.pi, otherwise=_ITS_OWN, in_use=_field("region_3_min_pitch"), only_of=_has_torque_curve,
    ),
    Parameter(
        "region_2_gain", "N m s²/rad²", "torque over generator speed squared below rated, of a torque curve", 0.0,
        above=True, otherwise=_ITS_OWN, in_use=_region_2_gain, only_of=_has_torque_curve,
    ),
    Parameter(
        "tip_speed_ratio", "-", "ratio that is run at below rated", 0.0, above=True, otherwise=_ITS_OWN,
        in_use=_tip_speed_ratio,
    ),
    Parameter(
        "thrust_limit", "-", "largest steady thrust over the peak that it has without a limit, of a controller that "
        "estimates the wind", 0.0, 1.0, above=True, otherwise="the published least pitch, if any",
        only_of=tracks_tip_speed_ratio,
    ),
)  # fmt: skip
"""What can be chosen (`wt_gym.control.controllers.parameters`)."""


def own_parameters(
    turbine: Turbine,
    kp: float | None = None,
    ki: float | None = None,
    gain_doubling_pitch: float | None = None,
    natural_frequency: float | None = None,
    damping_ratio: float | None = None,
    corner_frequency: float | None = None,
    filter_damping: float | None = None,
    notch_frequency: float | None = None,
    reference_speed: float | None = None,
    min_pitch: float | None = None,
    region_3_min_pitch: float | None = None,
) -> BaselineParameters:
    """Constants of pitch law, filter and limits of a turbine's own controller, some of them chosen.

    Parameters
    ----------
    turbine : Turbine
    kp, ki : float, optional
        Gains at zero pitch from generator speed error to pitch [s], [-]. Where the turbine has a table of gains over
        the pitch, those at its first pitch; the others keep their ratio to it.
    gain_doubling_pitch : float, optional
        Pitch at which the gains are halved [rad]; takes the place of a table.
    natural_frequency, damping_ratio : float, optional
        Gains by rule for these poles of the speed loop [rad/s], [-], in place of published ones.
    corner_frequency, filter_damping : float, optional
        Of the filter on the generator speed [rad/s], [-]; a damping of 0 makes it one of first order.
    notch_frequency : float, optional
        [rad/s]; 0 for none.
    reference_speed : float, optional
        Generator speed that is held above rated [rad/s].
    min_pitch, region_3_min_pitch : float, optional
        Least pitch, and pitch from which on the torque controller is in region 3 [rad].
    """
    made = BaselineParameters.from_turbine(turbine)
    if natural_frequency is not None or damping_ratio is not None:
        design = design_point(turbine)
        design = replace(
            design,
            natural_frequency=design.natural_frequency if natural_frequency is None else natural_frequency,
            damping_ratio=design.damping_ratio if damping_ratio is None else damping_ratio,
        )
        rule = BaselineParameters.by_rule(turbine, design)
        made = replace(
            made,
            proportional_gain=rule.proportional_gain,
            integral_gain=rule.integral_gain,
            gain_doubling_pitch=rule.gain_doubling_pitch,
            notch_frequency=rule.notch_frequency,
            gain_table=None,
        )
    if gain_doubling_pitch is not None:
        made = replace(made, gain_doubling_pitch=gain_doubling_pitch, gain_table=None)
    table = made.gain_table
    if table is not None:
        made = replace(made, gain_table=_scaled(table, kp, ki))
    given: dict[str, Any] = {
        "proportional_gain": kp,
        "integral_gain": ki,
        "corner_frequency": corner_frequency,
        "filter_damping": filter_damping,
        "notch_frequency": notch_frequency,
        "reference_speed": reference_speed,
        "min_pitch": min_pitch,
        "region_3_min_pitch": region_3_min_pitch,
    }
    return replace(made, **{name: value for name, value in given.items() if value is not None})


def _scaled(table: GainTable, kp: float | None, ki: float | None) -> GainTable:
    """Table whose first gains are those given."""

    def row(values: tuple[float, ...], first: float | None) -> tuple[float, ...]:
        return values if first is None else tuple(first / values[0] * value for value in values)

    return GainTable(table.pitch, row(table.proportional, kp), row(table.integral, ki))


def own_controller(
    turbine: Turbine,
    region_2_gain: float | None = None,
    tip_speed_ratio: float | None = None,
    thrust_limit: float | None = None,
    **parameters: Any,
) -> Controller:
    """Make the turbine's own controller and look at its loop, above rated and below.

    See `wt_gym.control.stability.check_speed_loop` and `wt_gym.control.stability`. Where the published numbers of a
    controller that estimates the wind leave a growing mode below rated, its torque gains are those by rule, else its
    least pitch, else both, with a warning.

    Parameters
    ----------
    turbine : Turbine
    region_2_gain : float, optional
        Torque over the square of the generator speed below rated [N m/(rad/s)^2], for a controller with a torque curve.
    tip_speed_ratio : float, optional
        That below rated is run at [-]: tracked, or by the gain of region 2, which goes with its inverse cube.
    thrust_limit : float, optional
        Peak shaving by rule in place of a published least pitch, see `wt_gym.control.controllers.tsr_tracking` [-]; for
        a controller that estimates the wind.
    **parameters
        Of `own_parameters`.

    Raises
    ------
    wt_gym.base.errors.ControllerError
        If the closed loop is unstable.
    ValueError
        For a parameter that the turbine's controller does not have.
    """
    tracks = tracks_tip_speed_ratio(turbine)
    if tracks and (unused := [name for name in ("min_pitch", "region_3_min_pitch") if name in parameters]):
        raise ValueError(
            f"{' and '.join(unused)} must be left out for {turbine.name}, whose controller has a least pitch over the "
            f"estimated wind and no region 3 by pitch; thrust_limit changes that least pitch"
        )
    made = own_parameters(turbine, **parameters)
    check_speed_loop(turbine, made)
    if tracks:
        if region_2_gain is not None:
            raise ValueError(
                f"region_2_gain must be left out for {turbine.name}, whose controller tracks the tip-speed ratio: give "
                f"tip_speed_ratio, got region_2_gain={region_2_gain!r}"
            )
        tracked: dict[str, float] = {}
        if tip_speed_ratio is not None:
            tracked["tip_speed_ratio"] = tip_speed_ratio
        if thrust_limit is not None:
            tracked["thrust_limit"] = thrust_limit
        stable, _, note = _stable(turbine, made, tuple(tracked.items()))
        if note:
            warn_once(note, stacklevel=2)
        return TsrTrackingController(stable, _estimator(turbine, stable))
    if thrust_limit is not None:
        raise ValueError(
            f"thrust_limit must be left out for {turbine.name}, whose controller estimates no wind: give it to "
            f"'tsr_tracking', got thrust_limit={thrust_limit!r}"
        )
    if region_2_gain is not None and tip_speed_ratio is not None:
        raise ValueError("region_2_gain and tip_speed_ratio say the same; one of them must be left out")
    curve = made.torque
    if tip_speed_ratio is not None:
        region_2_gain = curve.region_2_gain * (design_point(turbine).tip_speed_ratio / tip_speed_ratio) ** 3
    if region_2_gain is not None:
        made = replace(made, torque=replace(curve, region_2_gain=region_2_gain))
    check_torque_curve(turbine, made)
    return DisconController(made)


_PARTS = {
    "gains of the pitch": "gain_pitch",
    "filter of the speed": "speed_filter_frequency",
}
_PARTS_OF_CURVE = _PARTS | {"gain of region 2": "region_2_gain"}
_PARTS_OF_TRACKING = _PARTS | {
    "torque gains": "torque_proportional_gain",
    "least pitch over the wind": "min_pitch",
    "set-point smoother": "speed_shift_per_pitch",
}
"""Parts of a controller, by the field of `wt_gym.turbines.ControlData` that holds a published one."""


def own_law(turbine: Turbine) -> str:
    """Return in words which law a turbine's own controller has, and which of its parts are published.

    Parameters
    ----------
    turbine : Turbine

    Raises
    ------
    wt_gym.base.errors.ControllerError
        If the loop below rated is unstable with published numbers and with those of the rule.
    """
    tracks = tracks_tip_speed_ratio(turbine)
    words = ["tracks the tip-speed ratio with an estimate of the wind" if tracks else "has a torque curve"]
    parts = _PARTS_OF_TRACKING if tracks else _PARTS_OF_CURVE
    replaced = _stable(turbine, own_parameters(turbine), ())[1] if tracks else ()
    published = [
        part
        for part, field in parts.items()
        if part not in replaced and getattr(turbine.control, field, None) is not None
    ]
    by_rule = [part for part in parts if part not in published]
    words += [f"{kind}: {', '.join(made)}" for kind, made in (("published", published), ("by rule", by_rule)) if made]
    return "; ".join(words)


_BY_RULE = {
    "torque gains": ("torque_gain", "torque_integral_gain"),
    "least pitch over the wind": ("schedule_wind", "schedule_pitch"),
}
"""Parts of `_PARTS_OF_TRACKING` that the rule replaces where the loop is unstable, with their numbers."""


@lru_cache(maxsize=64)
def _stable(
    turbine: Turbine, baseline: BaselineParameters, parameters: tuple[tuple[str, float], ...]
) -> tuple[TsrTrackingParameters, tuple[str, ...], str]:
    """Numbers of a stable loop, the parts that the rule replaces, and a note on these."""
    published = TsrTrackingParameters.published(turbine, baseline, **dict(parameters))
    mode = growing_mode(turbine, published, _estimator(turbine, published))
    if mode is None:
        return published, (), ""
    ratio = published.speed_per_wind * published.table.radius / turbine.drivetrain.gear_ratio
    rule = TsrTrackingParameters.from_turbine(
        turbine, baseline=baseline, table=published.table, **{"tip_speed_ratio": ratio, **dict(parameters)}
    )
    trouble = f"the published controller of {turbine.name} is unstable below rated: {growth(mode)}"
    for parts in (*((part,) for part in _BY_RULE), tuple(_BY_RULE)):
        made = replace(published, **{name: getattr(rule, name) for part in parts for name in _BY_RULE[part]})
        if growing_mode(turbine, made, _estimator(turbine, made)) is None:
            return made, parts, f"{trouble}; its {' and '.join(parts)} are replaced by those of the rule"
    raise ControllerError(f"{trouble}, and stays so with torque gains and least pitch by rule")


def _estimator(turbine: Turbine, made: TsrTrackingParameters) -> WindEstimator:
    return WindEstimator.of_turbine(turbine, None, made.table, reads_generator=True)


FOUND: dict[str, float] = {
    name: record.region_2_gain_factor for name, record in RECORDS.items() if record.region_2_gain_factor is not None
}
"""Multiple of the published region-2 gain, by the turbine of the catalogue with the rotor and drive train."""


def _factor(turbine: Turbine) -> float | None:
    """Factor that a turbine's controller has by default; None where the table of the turbine gives the gain."""
    return None if tracks_tip_speed_ratio(turbine) else found_factor(turbine)


RETUNED_PARAMETERS = (
    Parameter(
        "gain_factor",
        "-",
        "torque over speed squared below rated, in that of `discon`",
        0.0,
        above=True,
        otherwise="the optimum of the turbine's table",
        in_use=_factor,
    ),
)
"""What can be chosen (`wt_gym.control.controllers.parameters`)."""


def gain_of_table(turbine: Turbine, table: RotorTable) -> float:
    """Region-2 gain that holds a rotor at the optimum of its table [N m/(rad/s)^2, high-speed shaft]."""
    ratio, best = table.optimum
    drivetrain = turbine.drivetrain
    moment = 0.5 * turbine.controller_air_density * math.pi * table.radius**5 * best / ratio**3
    return moment * drivetrain.gearbox_efficiency / drivetrain.gear_ratio**3


def with_region_2_gain(parameters: BaselineParameters, gain: float) -> BaselineParameters:
    """Return constants with another region-2 gain [N m/(rad/s)^2]."""
    return replace(parameters, torque=replace(parameters.torque, region_2_gain=gain))


def found_factor(turbine: Turbine) -> float | None:
    """Multiple of the published region-2 gain that was found for the rotor and drive train of a turbine, if any.

    Parameters
    ----------
    turbine : Turbine
    """
    for name, factor in FOUND.items():
        if same_rotor(load_turbine(name), turbine):
            return factor
    return None


def retuned_parameters(turbine: Turbine, gain_factor: float | None = None) -> BaselineParameters:
    """Constants of the baseline controller with a region-2 gain for the turbine as simulated.

    Parameters
    ----------
    turbine : Turbine
    gain_factor : float, optional
        Multiple of the gain of `BaselineParameters.from_turbine`; by default what was found for this rotor, else what
        the table of the turbine gives.
    """
    parameters = BaselineParameters.from_turbine(turbine)
    factor = found_factor(turbine) if gain_factor is None else gain_factor
    if factor is None:
        return with_region_2_gain(parameters, gain_of_table(turbine, rotor_table(turbine)))
    return with_region_2_gain(parameters, factor * parameters.torque.region_2_gain)


def retuned_controller(turbine: Turbine, gain_factor: float | None = None) -> Controller:
    """The turbine's own controller with a torque below rated that fits the turbine as simulated.

    Where it tracks the tip-speed ratio, that ratio takes the place of the gain, which goes with its inverse cube: by
    default the optimum of the turbine's table.

    Parameters
    ----------
    turbine : Turbine
    gain_factor : float, optional
        As of `retuned_parameters`.
    """
    if not tracks_tip_speed_ratio(turbine):
        parameters = retuned_parameters(turbine, gain_factor)
        check_speed_loop(turbine, parameters)
        check_torque_curve(turbine, parameters)
        return DisconController(parameters)
    if gain_factor is None:
        return own_controller(turbine, tip_speed_ratio=rotor_table(turbine).optimum[0])
    return own_controller(turbine, tip_speed_ratio=design_point(turbine).tip_speed_ratio * gain_factor ** (-1 / 3))


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
