"""The turbine's own controller: with what its data publish, and by rule where they say nothing.

Two laws share one set of constants (`BaselineParameters`). A turbine whose data have the gains of a torque controller
that tracks the tip-speed ratio, or a least pitch over the wind (peak shaving), gets the one that estimates the wind
(`TsrTrackingController.published`); any other the torque curve of the NREL 5-MW's (`DisconController`).

*Retuned*: the published gain of region 2 belongs to the rotor of blade-element momentum theory. The lattice's rotor has
its best power at a higher tip-speed ratio, so that a smaller gain makes more power. `FOUND` holds the multiple of the
published gain that made the most power in coupled runs (the turbine's record); docs/baselines.md says how it was found.
It belongs to the rotor and its drive train, whatever tower or monopile these stand on. Any other turbine gets the gain
of the optimum of its own table, ``rho pi R^5 Cp / (2 lambda^3 N^3)`` times the gearbox efficiency.

*Tuned*: parameters that a search found are the reference that learned control is compared with. The records of
`wt_gym.experiment.tuning` lie in ``data/tuned*.json`` with the cost, the winds, the seeds and every trial;
docs/baselines.md says what they are worth. They were found on the NREL 5-MW. On another turbine the numbers without a
dimension are the same, and times go with the turn of the rotor.
"""

import json
import math
from dataclasses import replace
from functools import cache, lru_cache
from operator import attrgetter
from pathlib import Path
from typing import Any

from wt_gym.base.errors import ControllerError, warn_once
from wt_gym.base.options import Options, option, option_record
from wt_gym.control.controllers.controller import Controller
from wt_gym.control.controllers.discon import BaselineParameters, DisconController, GainTable
from wt_gym.control.controllers.tsr_tracking import TsrTrackingController, TsrTrackingParameters, WindEstimator
from wt_gym.control.design import design_point, same_rotor
from wt_gym.control.operating_point import tracks_tip_speed_ratio
from wt_gym.control.rotor import RotorTable, blade_element_table, rotor_table
from wt_gym.control.stability import check_speed_loop, check_torque_curve, growing_mode, growth
from wt_gym.turbine_records import RECORDS
from wt_gym.turbines import Turbine, load_turbine


def _own(meaning: str, unit: str, name: str, row: str = "", **more: Any) -> Any:
    """Option that is the turbine's own number by default; with a table of gains the first one of a row, or none."""

    def in_use(turbine: Turbine) -> float | None:
        made = BaselineParameters.from_turbine(turbine)
        if made.gain_table is not None and name in ("proportional_gain", "integral_gain", "gain_doubling_pitch"):
            return float(getattr(made.gain_table, row)[0]) if row else None
        return float(attrgetter(name)(made))

    limits: dict[str, Any] = {"low": 0.0, "in_use": in_use} | more
    return option(meaning, default=None, unit=unit, otherwise="the turbine's own", **limits)


def _pole(name: str, unit: str) -> Any:
    """Frequency or damping ratio of gains by rule; None where gains are published."""

    def in_use(turbine: Turbine) -> float | None:
        by_rule = turbine.control is None or turbine.control.gain_pitch is None
        return float(getattr(design_point(turbine), name)) if by_rule else None

    meaning, otherwise = (
        "of the speed loop: gains by rule in place of published ones",
        "gains as published, else by rule",
    )
    return option(meaning, default=None, unit=unit, low=0.0, above=True, otherwise=otherwise, in_use=in_use)


def _tip_speed_ratio(turbine: Turbine) -> float:
    if not tracks_tip_speed_ratio(turbine):
        return design_point(turbine).tip_speed_ratio
    own = turbine.control
    return (own and own.optimal_tip_speed_ratio) or blade_element_table(turbine).optimum[0]


def _has_torque_curve(turbine: Turbine) -> bool:
    return not tracks_tip_speed_ratio(turbine)


@lru_cache(maxsize=8)
def on_land(turbine: Turbine) -> Turbine:
    """A floating turbine with the control data of the turbine of the catalog that has its rotor and stands on land.

    Raises
    ------
    wt_gym.base.errors.ControllerError
        If the catalog has none.
    """
    for name in RECORDS:
        land = load_turbine(name)
        if land.floater is None and land.rotor_diameter == turbine.rotor_diameter and same_rotor(land, turbine):
            return replace(turbine, control=land.control)
    raise ControllerError(
        f"land_gains needs a turbine of the catalog with the rotor of {turbine.name!r}; there is none"
    )


_ANGLES: dict[str, Any] = {"low": -math.pi, "high": math.pi, "only_of": _has_torque_curve}


@option_record
class OwnOptions(Options):
    """Parameters of the turbine's own controller."""

    title = "discon"

    kp: float | None = _own(
        "proportional gain from generator speed to pitch at zero pitch, or at the first of a table, whose other gains "
        "keep their ratio to it", "s", "proportional_gain", "proportional",
    )  # fmt: skip
    ki: float | None = _own(
        "integral gain from generator speed to pitch, likewise", "-", "integral_gain", "integral", above=True
    )
    gain_doubling_pitch: float | None = _own(
        "pitch at which the gains are halved; takes the place of a table", "rad", "gain_doubling_pitch", above=True
    )
    natural_frequency: float | None = _pole("natural_frequency", "rad/s")
    damping_ratio: float | None = _pole("damping_ratio", "-")
    corner_frequency: float | None = _own(
        "of the low-pass filter on the generator speed", "rad/s", "corner_frequency", above=True
    )
    filter_damping: float | None = _own("of that filter; 0: first order", "-", "filter_damping")
    notch_frequency: float | None = _own("of a notch before that filter; 0: none", "rad/s", "notch_frequency")
    reference_speed: float | None = _own(
        "generator speed that is held above rated", "rad/s", "reference_speed", above=True
    )
    min_pitch: float | None = _own("least pitch, of a controller with a torque curve", "rad", "min_pitch", **_ANGLES)
    region_3_min_pitch: float | None = _own(
        "pitch from which on region 3 holds, of a controller with a torque curve",
        "rad",
        "region_3_min_pitch",
        **_ANGLES,
    )
    region_2_gain: float | None = _own(
        "torque over generator speed squared below rated, of a torque curve", "N m s²/rad²", "torque.region_2_gain",
        above=True, only_of=_has_torque_curve,
    )  # fmt: skip
    tip_speed_ratio: float | None = _own(
        "ratio that is run at below rated", "-", "", above=True, in_use=_tip_speed_ratio
    )
    thrust_limit: float | None = option(
        "largest steady thrust over the peak that it has without a limit, of a controller that estimates the wind",
        default=None, unit="-", low=0.0, high=1.0, above=True, otherwise="the published least pitch, if any",
        only_of=tracks_tip_speed_ratio,
    )  # fmt: skip
    land_gains: bool = option(
        "use of the controller of the turbine of the catalog with the same rotor on land, whose speed loop drives a "
        "platform", default=False, unit="-", only_of=lambda turbine: turbine.floater is not None,
    )  # fmt: skip
    constant_power: bool | None = option(
        "torque above rated that holds the power; else it is rated torque", default=None, unit="-",
        otherwise="the turbine's own", in_use=lambda turbine: BaselineParameters.from_turbine(turbine).constant_power,
    )  # fmt: skip


def own_parameters(turbine: Turbine, **parameters: Any) -> BaselineParameters:
    """Constants of pitch law, filter and limits of a turbine's own controller, with parameters of `OwnOptions`.

    Those of the torque below rated have no effect here.
    """
    o = OwnOptions(**parameters)
    if o.land_gains:
        turbine = on_land(turbine)
    made = BaselineParameters.from_turbine(turbine)
    if o.natural_frequency is not None or o.damping_ratio is not None:
        design = design_point(turbine)
        poles = {"natural_frequency": o.natural_frequency, "damping_ratio": o.damping_ratio}
        design = replace(design, **{name: value for name, value in poles.items() if value is not None})
        rule = BaselineParameters.by_rule(turbine, design)
        names = ("proportional_gain", "integral_gain", "gain_doubling_pitch", "notch_frequency")
        made = replace(made, gain_table=None, **{name: getattr(rule, name) for name in names})
    if o.gain_doubling_pitch is not None:
        made = replace(made, gain_doubling_pitch=o.gain_doubling_pitch, gain_table=None)
    if made.gain_table is not None:
        made = replace(made, gain_table=_scaled(made.gain_table, o.kp, o.ki))
    same = ("corner_frequency", "filter_damping", "notch_frequency", "reference_speed", "min_pitch",
            "region_3_min_pitch", "constant_power")  # fmt: skip
    values = {"proportional_gain": o.kp, "integral_gain": o.ki} | {name: getattr(o, name) for name in same}
    return replace(made, **{name: value for name, value in values.items() if value is not None})


def _scaled(table: GainTable, kp: float | None, ki: float | None) -> GainTable:
    """Table whose first gains are those given."""

    def row(values: tuple[float, ...], first: float | None) -> tuple[float, ...]:
        return values if first is None else tuple(first / values[0] * value for value in values)

    return GainTable(table.pitch, row(table.proportional, kp), row(table.integral, ki))


def own_controller(turbine: Turbine, **parameters: Any) -> Controller:
    """Make the turbine's own controller with parameters of `OwnOptions`, and look at its loop, above rated and below.

    See `wt_gym.control.stability`. Where the published numbers of a controller that estimates the wind leave a growing
    mode below rated, its torque gains are those by rule, else its least pitch, else both, with a warning.

    Raises
    ------
    wt_gym.base.errors.ControllerError, ValueError
        If the closed loop is unstable; for parameters that say the same.
    """
    o, made = OwnOptions(**parameters), own_parameters(turbine, **parameters)
    if o.land_gains:
        turbine = on_land(turbine)
    check_speed_loop(turbine, made)
    if tracks_tip_speed_ratio(turbine):
        tracked = {"tip_speed_ratio": o.tip_speed_ratio, "thrust_limit": o.thrust_limit}
        stable, _, note = _stable(turbine, made, tuple((k, v) for k, v in tracked.items() if v is not None))
        if note:
            warn_once(note, stacklevel=2)
        return TsrTrackingController(stable, _estimator(turbine, stable))
    gain = o.region_2_gain
    if gain is not None and o.tip_speed_ratio is not None:
        raise ValueError("region_2_gain and tip_speed_ratio say the same; one of them must be left out")
    if o.tip_speed_ratio is not None:  # the gain goes with the inverse cube of the ratio
        gain = made.torque.region_2_gain * (design_point(turbine).tip_speed_ratio / o.tip_speed_ratio) ** 3
    if gain is not None:
        made = with_region_2_gain(made, gain)
    check_torque_curve(turbine, made)
    return DisconController(made)


_PARTS = {"gains of the pitch": "gain_pitch", "filter of the speed": "speed_filter_frequency"}
_PARTS_OF_CURVE = _PARTS | {"gain of region 2": "region_2_gain"}
_PARTS_OF_TRACKING = _PARTS | {
    "torque gains": "torque_proportional_gain",
    "least pitch over the wind": "min_pitch",
    "set-point smoother": "speed_shift_per_pitch",
}
"""Parts of a controller, by the field of `wt_gym.turbines.ControlData` that holds a published one."""


def own_law(turbine: Turbine) -> str:
    """Return in words which law a turbine's own controller has, and which of its parts are published.

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
"""Multiple of the published region-2 gain, by the turbine of the catalog with the rotor and drive train."""


@option_record
class RetunedOptions(Options):
    """Parameters of the retuned controller."""

    title = "retuned"

    gain_factor: float | None = option(
        "torque over speed squared below rated, in that of `discon`", default=None, unit="-", low=0.0, above=True,
        otherwise="the optimum of the turbine's table",
        in_use=lambda turbine: None if tracks_tip_speed_ratio(turbine) else found_factor(turbine),
    )  # fmt: skip


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
    """Multiple of the published region-2 gain that was found for the rotor and drive train of a turbine, if any."""
    for name, factor in FOUND.items():
        if same_rotor(load_turbine(name), turbine):
            return factor
    return None


def retuned_parameters(turbine: Turbine, gain_factor: float | None = None) -> BaselineParameters:
    """Constants of the baseline controller with a region-2 gain for the turbine as simulated.

    ``gain_factor`` is the multiple of the gain of `BaselineParameters.from_turbine`; by default that of `FOUND` for
    this rotor, else what the table of the turbine gives.
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
    """Parameters of least cost of a name of `TUNED`, keyed ``part__parameter``, scaled to a turbine, see above."""
    best: dict[str, float] = record_of(name)["best"]["parameters"]
    home = load_turbine(_HOME)
    if same_rotor(home, turbine):
        return dict(best)
    slower = home.drivetrain.rated_rotor_speed / turbine.drivetrain.rated_rotor_speed
    return {key: value * (slower if key.rpartition("__")[2] in _TIMES else 1.0) for key, value in best.items()}


@cache
def record_of(name: str) -> dict[str, Any]:
    """Record of the search behind a name of `TUNED`, as `wt_gym.experiment.tuning.tune` writes it."""
    path = Path(__file__).with_name("data") / f"{name}.json"
    out: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return out
