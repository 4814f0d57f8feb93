"""Options of the environment: in groups, or each by its flat name.

``wind={"speed": 12}``, ``wind=WindOptions(speed=12)`` and ``wind_speed=12`` mean the same. An id of the registry says
some options itself; what is given takes their place option by option.
"""

import hashlib
import inspect
import os
from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, Self

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec

from wt_gym.base.errors import InflowError, did_you_mean
from wt_gym.base.options import (
    Option,
    Options,
    not_empty,
    option,
    option_record,
    options_of,
    plain_value,
    section,
    shown,
)
from wt_gym.control.actions import ACTION_MODES, COMPONENTS, PITCH_FORMS, RESIDUAL_FORMS
from wt_gym.control.controllers import Controller, FadeParameters
from wt_gym.envs.dial import DialOptions
from wt_gym.envs.faults import FaultOptions
from wt_gym.envs.observations import ObservationOptions
from wt_gym.envs.power_reference import GridOptions
from wt_gym.envs.rewards import RewardOptions
from wt_gym.envs.sea import SeaChoice
from wt_gym.envs.terminations import LimitOptions
from wt_gym.envs.variation import Variation
from wt_gym.envs.wind_sampler import WindOptions, is_wind_file
from wt_gym.hydrodynamics.waves import SeaState
from wt_gym.simulation import Fidelity
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.turbines import Turbine
from wt_gym.turbines.model import LONGEST_LAG, STRONGEST
from wt_gym.turbines.variants import GENERATORS
from wt_gym.wind.files import files_of, is_wind_path, whole_description

__all__ = [
    "GROUPS",
    "RENDER_MODES",
    "ActionOptions",
    "ControllerOptions",
    "DialOptions",
    "ElectricalOptions",
    "EnvOptions",
    "FaultOptions",
    "GridOptions",
    "LimitOptions",
    "ObservationOptions",
    "PlainSpec",
    "RewardOptions",
    "Variation",
    "WindOptions",
    "argument_default",
    "documentation",
    "env_arguments",
    "flat_arguments",
    "named_arguments",
    "registered_arguments",
    "signature",
    "wind_files_of",
    "with_whole_paths",
]  # fmt: skip


@option_record
class ActionOptions(Options):
    """Components of an action and their meaning, see `wt_gym.control.ActionMap`."""

    title = "actions"

    mode: str = option("What an action moves", default="rate", flat="action_mode", choices=ACTION_MODES)
    pitch: str = option(
        'Coordinates of the pitch: "cyclic" with mode "residual", the latter two with three blades or more',
        default="collective",
        choices=PITCH_FORMS,
    )
    components: tuple[str, ...] | None = option(
        'Components of the action, by default the first three as far as there are any; "set_point" moves that of '
        "a supervisor",
        default=None,
        flat="action_components",
        choices=COMPONENTS,
        check=not_empty,
    )
    spans: Mapping[str, float] | None = option(
        'Rates and limits other than the default ones: "pitch", "pitch_mean" [rad], "pitch_rate", "yaw_rate" [rad/s], '
        '"torque" [N m], "torque_rate" [N m/s], "set_point" [-], "set_point_rate" [1/s]; positive, rates at most those '
        "of the drives; see `wt_gym.control.ActionMap`",
        default=None,
        flat="action_spans",
    )
    residual: str = option(
        'Meaning of actions of mode "residual": the rate of an offset, or the offset itself, to which the current one '
        "moves at no more than the greatest rate",
        default="rate",
        flat="residual_form",
        choices=RESIDUAL_FORMS,
    )

    def check(self) -> None:
        """Refuse forms of residual actions in other modes."""
        for name, value, usual in (("pitch", self.pitch, PITCH_FORMS[:3]), ("residual_form", self.residual, ("rate",))):
            if value not in usual and self.mode != "residual":
                raise ValueError(f"{name}={value!r} needs action_mode='residual', got {self.mode!r}")


def _checked_base(base: Any) -> Any:
    if not (isinstance(base, str) or callable(base) or hasattr(base, "start")):
        raise ValueError(f"must be a name, a Controller or a function, got {shown(base)}")
    return base


def _checked_sea(value: Any) -> Any:
    SeaChoice.of(value)
    return value


@option_record
class ControllerOptions(Options):
    """The base controller, and how residual pitch adds to it."""

    title = "controller"
    objects = {"residual_fade": FadeParameters}  # noqa: RUF012 - of the class, as its base says

    base: str | Controller | Callable[..., Any] = option(
        "What runs under residual actions, or decides on components left out: a name for "
        '`wt_gym.control.controllers.make_controller` (``"path/file.py:Class"`` among them), a controller, or a '
        "function that makes one for a turbine",
        default="discon",
        flat="controller",
        kind="str, Controller or callable",
        check=_checked_base,
    )
    residual_fade: bool | float | FadeParameters = option(
        "Whether residual pitch acts only above rated wind, as additions to industrial controllers do "
        "(`wt_gym.control.controllers.additions.AboveRated`): blades at fine pitch stay where they make most power; "
        "a number is the pitch above fine pitch from which on it acts in full, in rad, a mapping has the arguments of "
        'FadeParameters. The share that acts can be observed as "residual_share". Other modes have none to fade',
        default=False,
        unit="rad",
        low=0.001,
        high=0.5,
        kind="bool, float, FadeParameters or mapping",
        kinds=(FadeParameters,),
    )
    residual_washout: float | None = option(
        "Time constant of a high-pass filter on the mean of the blades' residual pitch: lasting offsets of all blades "
        "are left to the base controller, see `wt_gym.control.controllers.additions`. What acts can be observed as "
        '"residual_mean". It has no effect on tilt and yaw alone, or in other modes',
        default=None,
        unit="s",
        low=0.0,
        above=True,
    )


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


STARTS = ("running", "steady")
"""States with which an episode in turbulence starts."""
RENDER_MODES = ("rgb_array", "human")
_BASE = "controller"  # the one argument that takes a group or the value of a field of it
_ID = "env_id"


@option_record
class EnvOptions(Options):
    """Everything that an environment is made of; its groups are `GROUPS`."""

    title = "environment"

    turbine: str | Path | Turbine = option(
        "Name in the catalog, a windIO file, an OpenFAST model (.fst), or a turbine", default="nrel_5mw"
    )
    generator: str | None = option(
        "A torque that is demanded, or the damper of the turbine, M = c Ω, which takes no demand; default: what the "
        "turbine has. With the damper there is no torque component, rated rotor speed is that at which it makes the "
        "rated power (`wt_gym.turbines.variants.with_damper`), and of a base controller only pitch and yaw act",
        default=None,
        choices=GENERATORS,
    )
    site: Mapping[str, Any] | None = option(
        "Numbers of the site that replace those of the turbine: ``air_density`` [kg/m^3], ``cut_in``, ``cut_out`` "
        "[m/s], ``iec_class``, ``turbulence_class``, and ``controller_air_density``, the density that the controller "
        "is designed for, by default that of the turbine (`wt_gym.turbines.model.with_site`)",
        default=None,
        kind="mapping, optional",
    )
    fidelity: str | Fidelity | None = option(
        'Fidelity of the simulator: ``"training"``, ``"engineering"``, either with ``"-torsion"`` behind it for blades '
        'that twist, ``"reference"``, another of `wt_gym.simulation.FIDELITIES` or your own; default: '
        '``"training-torsion"`` where the tips twist by more than 0.5 deg at rated thrust, else ``"training"``',
        default=None,
    )
    control_dt: float = option(
        "Control step, a multiple of the aerodynamic step of the simulator", default=0.2, unit="s", low=0.0, above=True
    )
    start: str = option(
        'What an episode in turbulence begins with, see "Starting state"', default="running", choices=STARTS
    )
    starts: int | None = option(
        "Number of beginnings, each a wind, a time in it and a state of the turbine, that episodes are drawn from; "
        'None: every episode has another one. ``reset(options={"start_number": 3})`` chooses one, from 0',
        default=None,
        low=1,
        high=1_000_000,
    )
    simulator: str | Mapping[str, Any] | Callable[..., Any] = option(
        "What simulates the turbine: this package; OpenFAST (`wt_gym.bridges.openfast.OpenFASTSimulator`, slow, "
        'without pictures and snapshots), with further arguments of it in a mapping beside ``"name"``; or a function '
        "(turbine, inflow, fidelity) that makes a `wt_gym.simulation.contract.TurbineSimulator`. Running starts are "
        "those of this package in any case",
        default="wt_gym",
        kind="{'wt_gym', 'openfast'}, mapping or callable",
    )
    render_mode: str | None = option(
        "Picture of turbine and wake with the recent course of the key signals; ``human`` shows it at every step, in a "
        "window or, without a display, in a file",
        default=None,
        choices=RENDER_MODES,
    )
    sea: str | Mapping[str, Any] | SeaState | None = option(
        "Sea of a turbine that floats: None for waves that grow with a turbulent wind, still water in a steady one; "
        '"still"; or a `wt_gym.hydrodynamics.waves.SeaState` or a mapping of its fields, with "misalignment" [rad] up '
        "to which the direction of an episode is drawn to either side, and the height of the wind's sea if it has none",
        default=None,
        kind="str, mapping or SeaState",
        check=_checked_sea,
    )
    wind: WindOptions = WindOptions()
    actions: ActionOptions = ActionOptions()
    observations: ObservationOptions = ObservationOptions()
    rewards: RewardOptions = RewardOptions()
    limits: LimitOptions = LimitOptions()
    controller: ControllerOptions = ControllerOptions()
    grid: GridOptions = GridOptions()
    dial: DialOptions = DialOptions()
    electrical: ElectricalOptions = ElectricalOptions()
    faults: FaultOptions = FaultOptions()
    variation: Variation = Variation()

    def check(self) -> None:
        """Refuse an unknown fidelity, and options of a feature that is off."""
        if self.fidelity is not None:
            fidelity_of(self.fidelity)
        for group in (getattr(self, title) for title in GROUPS):
            if group.switch and getattr(group, group.switch) is None and (alone := group.given.keys() - {group.switch}):
                flat = {one.name: one.flat for one in options_of(group)}
                names = ", ".join(flat[name] for name in flat if name in alone)
                raise ValueError(f"{names} must be left out, or given with {flat[group.switch]}, got it without")

    @property
    def given(self) -> dict[str, Any]:
        """Options that were given, groups among them."""
        groups = {title: getattr(self, title) for title in GROUPS}
        return super().given | {title: group for title, group in groups.items() if group.given}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Options of arguments of the environment: groups, as objects or mappings, flat names, or both.

        Raises
        ------
        TypeError
            If there is no such argument.
        ValueError, wt_gym.base.errors.InflowError
            If something is given twice, or has no meaning.
        """
        flat = flat_arguments(values)
        parts: dict[str, Any] = {name: flat[name] for name in _PLAIN if name in flat}
        for title, group in GROUPS.items():
            parts[title] = group(**{one.name: flat[one.flat] for one in options_of(group) if one.flat in flat})
        return cls(**parts)


GROUPS: dict[str, type[Options]] = {
    one.name: type(one.default) for one in fields(EnvOptions) if isinstance(one.default, Options)
}
"""Groups by the argument that takes them."""
_FLAT: dict[str, tuple[str, Option]] = {
    one.flat: (title, one) for title, group in GROUPS.items() for one in options_of(group)
}
"""Group and field of every flat name."""
_PLAIN = {one.name: one for one in options_of(EnvOptions)}


def env_arguments() -> tuple[str, ...]:
    """Names of the arguments of the environment: those without a group, the groups, the flat names of their fields."""
    return tuple(dict.fromkeys((*_PLAIN, *GROUPS, *_FLAT)))


def argument_default(name: str) -> Any:
    """Default of an argument outside the groups, by its flat name."""
    return _PLAIN[name].default if name in _PLAIN else _FLAT[name][1].default


def named_arguments(positional: tuple[Any, ...], named: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments by name; without a name come the turbine and then the options of the wind, in their order.

    Raises
    ------
    TypeError
        If there are too many of them, or one is named too.
    """
    names = ("turbine", *(one.flat for one in options_of(WindOptions)))
    if len(positional) > len(names):
        raise TypeError(f"the environment takes at most {len(names)} arguments without names, got {len(positional)}")
    placed = dict(zip(names, positional, strict=False))
    if twice := [name for name in placed if name in named]:
        raise TypeError(f"{', '.join(twice)} of the environment must be given once, got two values")
    return placed | dict(named)


def signature() -> inspect.Signature:
    """Signature of the environment: what is in no group, the groups, any flat name."""
    kind = inspect.Parameter.KEYWORD_ONLY
    parameters = [inspect.Parameter(one.name, kind, default=one.default) for one in _PLAIN.values()]
    parameters += [inspect.Parameter(title, kind, default=group()) for title, group in GROUPS.items()]
    return inspect.Signature([*parameters, inspect.Parameter("flat", inspect.Parameter.VAR_KEYWORD)])


def flat_arguments(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of the environment by their flat names alone; with an ``env_id`` groups replace what that id says.

    Raises
    ------
    TypeError
        If there is no such argument, in Python's words for an unexpected keyword argument; the message names the one
        that it resembles.
    ValueError
        If a group is neither an object nor a mapping of its options, or something is given twice.
    """
    known, env_id = env_arguments(), arguments.get(_ID)
    spec = gym.registry.get(env_id) if isinstance(env_id, str) else None
    registered: Mapping[str, Any] = {} if spec is None else spec.kwargs
    flat: dict[str, Any] = {}
    groups: dict[str, Any] = {}
    for name, value in arguments.items():
        if name in GROUPS and (name != _BASE or isinstance(value, Mapping | Options)):
            groups[name] = value
        elif name in known:
            flat[name] = value
        elif name != _ID:
            raise TypeError(  # in Python's words: tools that try arguments, as TorchRL does, look for them
                f"the environment got an unexpected keyword argument {name!r}{did_you_mean(name, known, '.')} Its "
                f"arguments are {', '.join(known)}"
            )
    for title in (one for one in GROUPS if one in groups):
        group, value = GROUPS[title], groups[title]
        if title == _BASE and title in registered:
            flat[title] = registered[title]  # the mapping stood in its place
        given = value.given if isinstance(value, group) else group.named(value)
        for one in (each for each in options_of(group) if each.name in given):
            if one.flat in flat and not _same(registered, one.flat, flat[one.flat]):
                raise ValueError(
                    f"{one.flat} must be given once, got {title}.{one.name} = {shown(given[one.name])} and {one.flat} "
                    f"= {shown(flat[one.flat])}, which is the same option"
                )
            flat[one.flat] = given[one.name]
    return flat


def registered_arguments(env_id: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments, by flat names, that an id is registered with, replaced by those that are given.

    Raises
    ------
    gymnasium.error.Error
        If there is no such id.
    TypeError, ValueError
        As of `flat_arguments`.
    """
    return flat_arguments({**gym.spec(env_id).kwargs, **arguments})


def _same(registered: Mapping[str, Any], name: str, value: Any) -> bool:
    """Return True if a value is that of the id, also after a way through JSON."""
    if name not in registered:
        return False
    try:
        return bool(plain_value(name, registered[name]) == plain_value(name, value))
    except ValueError:  # an object, which no id has
        return False


def documentation(indent: str = "    ") -> str:
    """Section of the arguments in the documentation of the environment."""
    entries = [(one.name, one.kind, one.text) for one in _PLAIN.values()]
    for title, group in GROUPS.items():
        about = (group.__doc__ or "").strip().partition("\n")[0]
        entries.append((title, f"{group.__name__} or mapping", f"{about} Its options:"))
        for one in options_of(group):
            entries.append((f"{title}.{one.name}, or {one.flat}", one.kind, one.text))
    return section(entries, indent)


class PlainSpec:
    """An environment whose definition has mappings of what was given in the place of groups: they have a JSON form."""

    @property
    def spec(self) -> EnvSpec | None:
        """Definition of `gymnasium.make` or `gymnasium.make_vec`, groups of options as mappings."""
        return self.__dict__.get("_spec")

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None:
            values = spec.kwargs.items()
            spec.kwargs = {name: value.given if isinstance(value, Options) else value for name, value in values}
        self._spec = spec


# ---- files of wind among the arguments ----


def with_whole_paths(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of an environment in which the files of wind have whole paths, as texts.

    They then mean the same files in JSON, in other processes and in other working directories.

    Raises
    ------
    InflowError
        If a mapping names no files.
    """
    arguments = flat_arguments(arguments) if "wind" in arguments else arguments
    given: Any = arguments.get("inflow")
    if isinstance(given, list | tuple):
        return {**arguments, "inflow": [_whole(one) for one in given]}
    return {**arguments, "inflow": _whole(given)} if is_wind_file(given) else dict(arguments)


def _whole(given: Any) -> Any:
    if is_wind_path(given):
        return os.path.abspath(given)
    return whole_description(given) if is_wind_file(given) else given


def wind_files_of(arguments: Mapping[str, Any]) -> dict[str, str]:
    """Digests of the files of wind among the arguments of an environment, by their whole paths.

    Raises
    ------
    InflowError
        If one cannot be read.
    """
    given: Any = with_whole_paths(arguments).get("inflow")
    described = [one for one in (given if isinstance(given, list) else [given]) if is_wind_file(one)]
    paths = [one for one in described if is_wind_path(one)]
    paths += [path for one in described for path in files_of(whole_description(one))]
    return {path: _digest(path) for path in dict.fromkeys(paths)}


def _digest(path: str) -> str:
    try:
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()[:16]
    except OSError as error:
        raise InflowError(f"{path} cannot be read: {error.strerror}") from error
