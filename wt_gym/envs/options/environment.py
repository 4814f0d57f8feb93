"""All options of the environment: in groups, or each by its flat name.

``wind={"speed": 12}``, ``wind=WindOptions(speed=12)`` and ``wind_speed=12`` mean the same. An id of the registry says
some options itself; what is given takes their place option by option.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import gymnasium as gym

from wt_gym.base.errors import did_you_mean
from wt_gym.envs.arguments import check_number, shown
from wt_gym.envs.options.actions import ActionOptions
from wt_gym.envs.options.controller import ControllerOptions
from wt_gym.envs.options.dial import DialOptions
from wt_gym.envs.options.electrical import ElectricalOptions
from wt_gym.envs.options.faults import FaultOptions
from wt_gym.envs.options.grid import GridOptions
from wt_gym.envs.options.group import Described, OptionGroup, described, option, option_group, plain_value, section
from wt_gym.envs.options.limits import LimitOptions
from wt_gym.envs.options.observations import ObservationOptions
from wt_gym.envs.options.rewards import RewardOptions
from wt_gym.envs.options.variation import Variation
from wt_gym.envs.options.wind import WindOptions
from wt_gym.simulation import Fidelity
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.turbines import Turbine
from wt_gym.turbines.variants import GENERATORS

if TYPE_CHECKING:
    from gymnasium.envs.registration import EnvSpec

__all__ = [
    "GROUPS",
    "RENDER_MODES",
    "STARTS",
    "EnvOptions",
    "argument_default",
    "documentation",
    "env_arguments",
    "flat_arguments",
    "named_arguments",
    "options_of",
    "plain_spec",
    "registered_arguments",
    "signature",
]

STARTS = ("running", "steady")
"""What state an episode in turbulence begins with."""
RENDER_MODES = ("rgb_array",)
MOST_STARTS = 1_000_000
"""Numbered beginnings."""
GROUPS: dict[str, type[OptionGroup]] = {
    group.title: group
    for group in (
        WindOptions,
        ActionOptions,
        ObservationOptions,
        RewardOptions,
        LimitOptions,
        ControllerOptions,
        GridOptions,
        DialOptions,
        ElectricalOptions,
        FaultOptions,
        Variation,
    )
}
"""Groups by the argument that takes them."""
_BASE = "controller"  # the one argument that takes a group or the value of a field of it
_ID = "env_id"


@option_group
class EnvOptions(OptionGroup):
    """Everything that an environment is made of; its groups are `GROUPS`."""

    title = "environment"

    turbine: str | Path | Turbine = option(
        "str, path or Turbine",
        "Name in the catalogue, a windIO file, an OpenFAST model (.fst), or a turbine",
        default="nrel_5mw",
    )
    generator: str | None = option(
        '{"torque", "damper"}, optional',
        "A torque that is demanded, or the damper of the turbine, M = c Ω, which takes no demand; default: what the "
        "turbine has. With the damper there is no torque component, rated rotor speed is that at which it makes the "
        "rated power (`wt_gym.turbines.variants.with_damper`), and of a base controller only pitch and yaw act",
        default=None,
    )
    site: Mapping[str, Any] | None = option(
        "mapping, optional",
        "Numbers of the site that replace those of the turbine: ``air_density`` [kg/m^3], ``cut_in``, ``cut_out`` "
        "[m/s], ``iec_class``, ``turbulence_class``, and ``controller_air_density``, the density that the controller "
        "is designed for, by default that of the turbine (`wt_gym.turbines.model.with_site`)",
        default=None,
    )
    fidelity: str | Fidelity | None = option(
        "str or Fidelity, optional",
        'Of the simulator: ``"training"``, ``"engineering"``, either with ``"-torsion"`` behind it for blades that '
        'twist, ``"reference"``, another of `wt_gym.simulation.FIDELITIES` or your own; default: '
        '``"training-torsion"`` where the tips twist by more than 0.5 deg at rated thrust, else ``"training"``',
        default=None,
    )
    control_dt: float = option(
        "float", "Control step", default=0.2, unit="s", allowed="a multiple of the aerodynamic step of the simulator"
    )
    start: str = option(
        '{"running", "steady"}',
        'What an episode in turbulence begins with, see "Starting state"',
        default="running",
    )
    starts: int | None = option(
        "int, optional",
        "Number of beginnings, each a wind, a time in it and a state of the turbine, that episodes are drawn from; "
        'None: every episode has another one. ``reset(options={"start_number": 3})`` chooses one, from 0',
        default=None,
        allowed=f"1 to {MOST_STARTS}",
    )
    simulator: str | Mapping[str, Any] | Callable[..., Any] = option(
        '{"wt_gym", "openfast"}, mapping or callable',
        "What simulates the turbine: this package; OpenFAST (`wt_gym.bridges.openfast.OpenFASTSimulator`, slow, "
        'without pictures and snapshots), with further arguments of it in a mapping beside ``"name"``; or a function '
        "(turbine, inflow, fidelity) that makes a `wt_gym.simulation.contract.TurbineSimulator`. Running starts are "
        "those of this package in any case",
        default="wt_gym",
    )
    render_mode: str | None = option(
        '{"rgb_array"}, optional',
        "Picture of turbine and wake with the recent course of the key signals",
        default=None,
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
        """Refuse unknown names and numbers of the wrong type."""
        if self.render_mode is not None and self.render_mode not in RENDER_MODES:
            raise ValueError(
                f"render_mode must be one of {list(RENDER_MODES)} or None, got {self.render_mode!r}"
                f"{did_you_mean(self.render_mode, RENDER_MODES)}"
            )
        if self.start not in STARTS:
            raise ValueError(
                f"start must be one of {STARTS}, got {shown(self.start)}{did_you_mean(self.start, STARTS)}"
            )
        self._set_all(check_number, "control_dt", unit="s")
        if self.control_dt <= 0.0:
            raise ValueError(f"control_dt must be positive, got {self.control_dt!r} s")
        starts = self.starts
        is_count = isinstance(starts, int) and not isinstance(starts, bool) and 1 <= starts <= MOST_STARTS
        if starts is not None and not is_count:
            raise ValueError(f"starts must be a whole number from 1 to {MOST_STARTS} or None, got {shown(starts)}")
        if self.generator is not None and self.generator not in GENERATORS:
            raise ValueError(
                f"generator must be one of {GENERATORS} or None, got {self.generator!r}"
                f"{did_you_mean(self.generator, GENERATORS)}"
            )
        if self.fidelity is not None:
            fidelity_of(self.fidelity)
        if self.grid.reference is None and (alone := [name for name in self.grid.given if name != "reference"]):
            names = ", ".join(f"power_reference_{name}" for name in alone)
            raise ValueError(f"{names} must be left out, or given with a power_reference: nothing is asked for")
        if self.dial.weights is None and (alone := [name for name in self.dial.given if name != "weights"]):
            names = ", ".join(f"dial_{name}" for name in alone)
            raise ValueError(f"{names} must be left out, or given with dial_weights: there is no dial")
        if self.faults.kinds is None and (alone := [name for name in self.faults.given if name != "kinds"]):
            names = ", ".join(f"fault_{name}" for name in alone)
            raise ValueError(f"{names} must be left out, or given with fault_kinds: nothing breaks")

    @property
    def given(self) -> dict[str, Any]:
        """Options that were given, groups among them."""
        groups = {title: getattr(self, title) for title in GROUPS}
        return self._plain_given | {title: group for title, group in groups.items() if group.given}

    @property
    def _plain_given(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in _PLAIN if name in self._given}

    def as_dict(self) -> dict[str, Any]:
        """Options that were given, as values of JSON: groups as mappings. `from_dict` makes equal options of it.

        Raises
        ------
        ValueError
            If an object has no form in JSON; the message names its option.
        """
        return {
            name: value.as_dict() if isinstance(value, OptionGroup) else plain_value(name, value)
            for name, value in self.given.items()
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Options of a mapping of arguments of the environment, see `options_of`."""
        return cls(**_fields_of(flat_arguments(values)))


_FLAT: dict[str, tuple[str, Described]] = {
    one.flat: (title, one) for title, group in GROUPS.items() for one in described(group)
}
"""Group and field of every flat name."""
_PLAIN = {one.name: one for one in described(EnvOptions)}


def env_arguments() -> tuple[str, ...]:
    """Names of the arguments of the environment: those without a group, the groups, the flat names of their fields."""
    return tuple(dict.fromkeys((*_PLAIN, *GROUPS, *_FLAT)))


def argument_default(name: str) -> Any:
    """Default of an argument outside the groups, by its flat name."""
    return _PLAIN[name].default if name in _PLAIN else _FLAT[name][1].default


def options_of(arguments: Mapping[str, Any]) -> EnvOptions:
    """Options of arguments of the environment.

    Parameters
    ----------
    arguments : mapping
        Groups, as objects or mappings, flat names, or both.

    Raises
    ------
    TypeError
        If there is no such argument.
    ValueError, wt_gym.base.errors.InflowError
        If something is given twice, or has no meaning.
    """
    return EnvOptions.from_dict(arguments)


def _fields_of(flat: Mapping[str, Any]) -> dict[str, Any]:
    fields: dict[str, Any] = {name: flat[name] for name in _PLAIN if name in flat}
    for title, group in GROUPS.items():
        fields[title] = group(**{one.name: flat[one.flat] for one in described(group) if one.flat in flat})
    return fields


def named_arguments(positional: tuple[Any, ...], named: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments by name; without a name come the turbine and then the options of the wind, in their order.

    Raises
    ------
    TypeError
        If there are too many of them, or one is named too.
    """
    names = ("turbine", *(one.flat for one in described(WindOptions)))
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
    """Arguments of the environment by their flat names alone.

    Parameters
    ----------
    arguments : mapping
        Where it has an ``env_id``, groups replace what that id of the registry says.

    Raises
    ------
    TypeError
        If there is no such argument, in Python's words for an unexpected keyword argument; the message names the one
        that it resembles.
    ValueError
        If a group is neither an object nor a mapping of its options, or something is given twice.
    """
    known, registered = env_arguments(), _registered(arguments.get(_ID))
    flat: dict[str, Any] = {}
    for name, value in arguments.items():
        if name == _ID or (name in GROUPS and not (name == _BASE and not _is_group(value))):
            continue
        if name not in known:
            raise TypeError(  # in Python's words: tools that try arguments, as TorchRL does, look for them
                f"the environment got an unexpected keyword argument {name!r}{did_you_mean(name, known, '.')} Its "
                f"arguments are {', '.join(known)}"
            )
        flat[name] = value
    for title, group in GROUPS.items():
        if title not in arguments or (title == _BASE and not _is_group(arguments[title])):
            continue
        if title == _BASE and title in registered:
            flat[title] = registered[title]  # the mapping stood in its place
        value = arguments[title]
        given = value.given if isinstance(value, group) else group.named(value)
        for one in described(group):
            if one.name not in given:
                continue
            if one.flat in flat and not _same(registered, one.flat, flat[one.flat]):
                raise ValueError(
                    f"{one.flat} must be given once, got {title}.{one.name} = {shown(given[one.name])} and {one.flat} "
                    f"= {shown(flat[one.flat])}, which is the same option"
                )
            flat[one.flat] = given[one.name]
    return flat


def registered_arguments(env_id: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments, by flat names, that an id is registered with, replaced by those that are given.

    Parameters
    ----------
    env_id : str
    arguments : mapping

    Raises
    ------
    gymnasium.error.Error
        If there is no such id.
    TypeError, ValueError
        As of `flat_arguments`.
    """
    return flat_arguments({**gym.spec(env_id).kwargs, **arguments})


def _is_group(value: Any) -> bool:
    return isinstance(value, Mapping | OptionGroup)


def _registered(env_id: Any) -> Mapping[str, Any]:
    """What an id says itself."""
    spec = gym.registry.get(env_id) if isinstance(env_id, str) else None
    return {} if spec is None else spec.kwargs


def _same(registered: Mapping[str, Any], name: str, value: Any) -> bool:
    """Whether a value is that of the id, also after a way through JSON."""
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
        for one in described(group):
            entries.append((f"{title}.{one.name}, or {one.flat}", one.kind, one.text))
    return section(entries, indent)


def plain_spec(spec: EnvSpec | None) -> EnvSpec | None:
    """Put mappings of what was given in the place of groups, in what an environment was made of; they have a JSON."""
    if spec is not None:
        kwargs = spec.kwargs
        spec.kwargs = {name: value.given if isinstance(value, OptionGroup) else value for name, value in kwargs.items()}
    return spec
