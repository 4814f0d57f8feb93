"""The one way in which controllers and agents are named, on every command line and in ``gym.make(controller=...)``.

======================================  ===========================================================================
``NAME+NAME:key=value,...``             controllers of the catalog; ``controller:`` may stand in front
``bladed:LIBRARY:key=value,...``        a compiled controller with the Bladed interface
``path/file.py:Class:key=value,...``    your own class, or a function, in a file
``module:Class:key=value,...``          the same in a module
``FOLDER``, ``FILE.zip:key=value,...``  a trained model
another word, ``WORD:key=value,...``    further agents of a command, see `wt_gym.experiment.names`
======================================  ===========================================================================

The catalog is one table (`CATALOG`): a part's name, its place in a controller, the function that makes it for a
turbine, and the record that declares its parameters (`wt_gym.base.options`).
"""

import ast
import hashlib
import importlib
import importlib.util
import inspect
import math
import numbers
import os
import re
import sys
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

from wt_gym.base.errors import did_you_mean
from wt_gym.base.options import Option, Options, options_of
from wt_gym.control.bladed.controller import BladedController, BladedOptions
from wt_gym.control.bladed.rosco import RoscoController, RoscoOptions, rosco_library
from wt_gym.control.controllers import additions, linear_optimal, own, power_tracking, tsr_tracking
from wt_gym.control.controllers.controller import Combined, Controller, is_addition, is_controller
from wt_gym.control.controllers.fault_supervisor import FaultSupervisor, FaultSupervisorOptions
from wt_gym.control.controllers.floating_feedback import FloatingFeedback, FloatingOptions
from wt_gym.control.controllers.lidar_feedforward import LidarFeedforward, LidarOptions
from wt_gym.control.controllers.own import TUNED, record_of, tuned_parameters
from wt_gym.control.controllers.supervisor import Supervisor, SupervisorOptions
from wt_gym.turbines import Turbine

# ---- the catalog ----


@dataclass(frozen=True)
class Entry:
    """A part of controllers."""

    kind: str
    """One of "base", "wrapper", "addition", "guard". Decides on pitch and torque; works on a base before all
    additions; changes the demand of a controller; stands around a base with all its additions."""
    summary: str  #: one sentence
    make: Callable[..., Any]
    """From the turbine, what the part stands on (the base of a wrapper; base and additions of a guard) and its
    parameters."""
    options: type[Options]  #: declaration of the parameters
    defaults: Mapping[str, Any] = field(default_factory=dict)  #: defaults other than those of the declaration


CATALOG = {
    "discon": Entry(
        "base", "The turbine's own controller, with published constants where its data have them.", own.own_controller,
        own.OwnOptions,
    ),
    "retuned": Entry(
        "base", "The turbine's own controller, below rated at the best tip-speed ratio of the turbine as simulated.",
        own.retuned_controller, own.RetunedOptions,
    ),
    "tsr_tracking": Entry(
        "base", "Tip-speed-ratio tracking with a wind estimate, set-point smoothing, peak shaving.",
        tsr_tracking.TsrTrackingController.of_turbine, tsr_tracking.TsrTrackingOptions,
    ),
    "rosco": Entry(
        "base", "NREL's reference open-source controller itself, from the package rosco.", RoscoController,
        RoscoOptions,
    ),
    "bladed": Entry("base", "A compiled controller with the Bladed interface.", BladedController, BladedOptions),
    "derate_speed": Entry(
        "wrapper", "No more power than is demanded, by a lower rotor speed.",
        power_tracking.PowerTracking, power_tracking.DerateOptions, {"way": "speed"},
    ),
    "derate_torque": Entry(
        "wrapper", "No more power than is demanded, by a lower torque at rated speed.",
        power_tracking.PowerTracking, power_tracking.DerateOptions, {"way": "torque"},
    ),
    "derate_pitch": Entry(
        "wrapper", "No more power than is demanded, by a higher least pitch that keeps a reserve.",
        power_tracking.PowerTracking, power_tracking.DerateOptions, {"way": "pitch"},
    ),
    "derate_kinetic": Entry(
        "wrapper", "The demanded power, by torque, with the rotor as a store where the wind is too weak.",
        power_tracking.PowerTracking, power_tracking.KineticOptions, {"way": "kinetic"},
    ),
    "lidar": Entry(
        "wrapper", "Collective pitch ahead of the wind that a lidar sees.", LidarFeedforward, LidarOptions
    ),
    "floating": Entry(
        "wrapper", "Collective pitch by the pitch rate of a floating platform, against which a speed loop drives it.",
        FloatingFeedback, FloatingOptions,
    ),
    "supervisor": Entry(
        "wrapper", "Start-up, shut-down, soft or hard cut-out and restart around a base.", Supervisor,
        SupervisorOptions,
    ),
    "ipc": Entry(
        "addition", "Individual pitch against the load once per revolution.", additions.IndividualPitch,
        additions.IndividualPitchOptions,
    ),
    "ipc_2p": Entry(
        "addition", "Individual pitch against the loads once and twice per revolution.", additions.IndividualPitch,
        additions.IndividualPitchOptions, {"second_harmonic": 0.5},
    ),
    "constrained_ipc": Entry(
        "addition", "Individual pitch that acts only where the moment in the fixed frame leaves a band of this level.",
        additions.IndividualPitch, additions.IndividualPitchOptions, {"level": 0.1},
    ),
    "linear_pitch": Entry(
        "addition", "Mean, tilt and yaw pitch that a least-squares design made, beside a side-side damper.",
        linear_optimal.LinearOptimalPitch.of_turbine, linear_optimal.LinearOptions,
    ),
    "observer": Entry(
        "addition", "Observer of the disturbances of the loads, beside a side-side damper.",
        linear_optimal.LoadObserver.of_turbine, linear_optimal.ObserverOptions,
    ),
    "fore_aft_damper": Entry(
        "addition", "Damper of the tower's fore-aft motion by collective pitch.", additions.ForeAftDamper,
        additions.ForeAftOptions,
    ),
    "side_side_damper": Entry(
        "addition", "Damper of the tower's side-side motion by generator torque.", additions.SideSideDamper,
        additions.SideSideOptions,
    ),
    "yaw": Entry("addition", "Yaw by dead-band.", additions.YawByDeadBand, additions.YawOptions),
    "fault_supervisor": Entry(
        "guard", "Watches drives and sensors, repairs readings, falls back to collective pitch.",
        FaultSupervisor, FaultSupervisorOptions,
    ),
}  # fmt: skip
"""Parts by name; wrappers in the order in which they stand around a base, the first within the others."""


BASES = tuple(name for name, entry in CATALOG.items() if entry.kind == "base")
"""Controllers that decide on pitch and torque."""
WRAPPERS = tuple(name for name, entry in CATALOG.items() if entry.kind == "wrapper")
"""Parts that work on a base before all additions, the first within the others."""
ADDITIONS = tuple(name for name, entry in CATALOG.items() if entry.kind == "addition")
"""Parts that change the demand of a controller."""
GUARDS = tuple(name for name, entry in CATALOG.items() if entry.kind == "guard")
"""Parts that stand around a base with all its additions."""
SHORT_FOR = {
    "tower_dampers": ("fore_aft_damper", "side_side_damper"),
    "linear_optimal": ("side_side_damper", "linear_pitch"),
    **TUNED,
}
"""Names that stand for several parts; those of `TUNED` bring parameters with them."""
CONTROLLERS = (*CATALOG, *SHORT_FOR)
"""Every name; additions stand on "discon" where there is no base."""
COMPILED = ("rosco", "bladed")
"""Names of controllers that are libraries of others."""


@cache
def declared_parameters(name: str) -> tuple[Option, ...]:
    """Parameters of one name of `CONTROLLERS` with unit, allowed values, default and meaning.

    Those of a name that stands for several parts are called ``part__parameter``; the defaults of tuned ones are the
    results of the search.

    Examples
    --------
    >>> [parameter.name for parameter in declared_parameters("yaw")]
    ['dead_band', 'stop', 'slow', 'fast']
    """
    if name in CATALOG:
        entry = CATALOG[name]
        return tuple(
            replace(one, flat=f"{one.name} of controller {name!r}", default=entry.defaults.get(one.name, one.default))
            for one in options_of(entry.options)
        )
    if name not in SHORT_FOR:
        raise ValueError(_unknown(name, [name]))
    tuned = record_of(name)["best"]["parameters"] if name in TUNED else {}
    options = [(f"{part}__{one.name}", one) for part in SHORT_FOR[name] for one in declared_parameters(part)]
    return tuple(replace(one, name=key, default=tuned.get(key, one.default)) for key, one in options)


def controller_parameters(name: str) -> dict[str, Any]:
    """Parameters of one name of `CONTROLLERS` with their defaults, see `declared_parameters`."""
    return {parameter.name: parameter.default for parameter in declared_parameters(name)}


def controller_summary(name: str) -> str:
    """Say in one sentence what a name of `CONTROLLERS` stands for."""
    if name in CATALOG:
        return CATALOG[name].summary
    parts = "+".join(SHORT_FOR[name])
    return f"Stands for {parts}" + (", with the parameters that a search found." if name in TUNED else ".")


def default_text(parameter: Option, turbine: Turbine | None = None) -> str:
    """Default of a parameter in words, of a turbine where it follows from it; degrees behind radians."""
    value = parameter.default_of(turbine)
    if value is None:
        return parameter.otherwise or "None"
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        return str(value)
    degrees = f" ({math.degrees(value):.4g}°)" if parameter.unit == "rad" and value else ""
    return f"{value:.4g}{degrees}"


def _unknown(choice: str, unknown: list[str]) -> str:
    """Message for names that are none."""
    return (
        f"a controller must be among {', '.join(CONTROLLERS)}; got {', '.join(map(repr, unknown))} in {choice!r}; "
        f"several are joined with '+', for example 'retuned+ipc+yaw'{did_you_mean(unknown[0], CONTROLLERS)}"
    )


def _parts(choice: str) -> tuple[str, ...]:
    """Base, wrappers from the inside out, additions and guards of a name, checked."""
    parts = [part for name in choice.split("+") for part in SHORT_FOR.get(name, (name,))]
    if unknown := [part for part in parts if part not in CATALOG]:
        raise ValueError(_unknown(choice, unknown))
    if parts[0] not in BASES:
        parts.insert(0, BASELINE)
    if any(part in BASES for part in parts[1:]) or len(set(parts)) < len(parts):
        raise ValueError(
            f"controller {choice!r} must be one of {', '.join(BASES)} first, then additions "
            f"({', '.join((*WRAPPERS, *ADDITIONS, *GUARDS))}), each once"
        )
    kinds, wrappers = ("base", "wrapper", "addition", "guard"), list(WRAPPERS)
    place = {part: (kinds.index(CATALOG[part].kind), wrappers.index(part) if part in WRAPPERS else 0) for part in parts}
    return tuple(sorted(parts, key=lambda part: place[part]))


def _distribute(
    parts: tuple[str, ...], parameters: Mapping[str, Any], turbine: Turbine | None = None
) -> dict[str, dict[str, Any]]:
    """Parameters of each part, checked."""
    allowed = {part: {parameter.name: parameter for parameter in declared_parameters(part)} for part in parts}
    values: dict[str, dict[str, Any]] = {part: {} for part in parts}
    for key, value in parameters.items():
        part, _, name = key.rpartition("__")
        owners = [p for p in parts if name in allowed[p] and part in ("", p)]
        if not owners:
            known = "; ".join(f"{p}: {', '.join(names) or 'none'}" for p, names in allowed.items())
            near = did_you_mean(name, [n for p in parts for n in allowed[p] if part in ("", p)])
            raise ValueError(f"no parameter {key!r} in controller {'+'.join(parts)!r}; there are {known}{near}")
        if len(owners) > 1:
            raise ValueError(f"parameter {key!r} belongs to {' and '.join(owners)}; write {owners[0]}__{name}")
        parameter = allowed[owners[0]][name]
        if value is not None and turbine is not None and not parameter.belongs_to(turbine):
            raise ValueError(
                f"{name} must be left out for {turbine.name}: it is the {parameter.meaning}, got {value!r}"
            )
        values[owners[0]][name] = parameter.checked(value)
    return values


def _of_catalog(choice: str, turbine: Turbine, parameters: Mapping[str, Any]) -> Controller:
    """Controller of names of the catalog joined with "+"."""
    parts = _parts(choice)
    tuned = {k: v for name in choice.split("+") if name in TUNED for k, v in tuned_parameters(name, turbine).items()}
    values = _distribute(parts, tuned | dict(parameters), turbine)

    inside: list[Any] = []  # the controller so far, and its additions
    for part in parts:
        entry = CATALOG[part]
        stands_on = () if entry.kind == "addition" else inside
        made = entry.make(turbine, *stands_on, **{**entry.defaults, **values[part]})
        inside = [*inside, made] if entry.kind == "addition" else [made]
    controller: Controller = Combined(*inside) if len(inside) > 1 else inside[0]
    return controller


def compiled_files(choice: str, parameters: Mapping[str, Any]) -> tuple[Path, ...]:
    """Files of others that decide on what a controller does: libraries and their input files.

    Raises
    ------
    ValueError, wt_gym.base.errors.ControllerError
        See `make_controller`; if the package ``rosco`` is needed and not installed.
    """
    parts = _parts(choice)
    values = _distribute(parts, parameters)
    paths = [
        Path(value)
        for part in parts
        for parameter in declared_parameters(part)
        if "Path" in parameter.annotation and (value := values[part].get(parameter.name))
    ]
    return (*paths, rosco_library()) if "rosco" in parts else tuple(paths)


# ---- names ----

BASELINE = "discon"
"""The one name of the baseline: the turbine's own controller."""
ALIASES = {"baseline": BASELINE, "Baseline PI": BASELINE}
"""Other names that are accepted for controllers, and what they are shown as."""
PREFIX = "controller:"
"""In front of a controller whose name could be something else's."""

_LIBRARY = "bladed"
"""Controller whose first parameter stands without its name."""
_IDENTIFIER = r"[A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*"
_FILE_CLASS = re.compile(rf"(?P<target>.+\.py:{_IDENTIFIER})(?::(?P<rest>.*))?", re.DOTALL)
_MODULE_CLASS = re.compile(rf"(?P<target>{_IDENTIFIER}:{_IDENTIFIER})(?::(?P<rest>.*))?")
_MODEL = re.compile(r"(?P<target>.+\.zip)(?::(?P<rest>.*))?", re.DOTALL)
_NAME_BEHIND_PARAMETERS = re.compile(
    rf"\+(?P<name>{'|'.join(sorted(CONTROLLERS, key=len, reverse=True))})\b(?P<rest>.*)"
)


@dataclass(frozen=True)
class Name:
    """Meaning of a name."""

    kind: str  #: one of "word", "controller", "class", "trained"
    target: str
    """Word, names of the catalog joined with "+", ``file.py:Class`` or ``module:Class``, or path; aliases
    resolved."""
    parameters: dict[str, Any] = field(default_factory=dict)  #: by key

    @property
    def text(self) -> str:
        """The name as it is shown, from which the same is read again."""
        pairs = ",".join(f"{key}={value}" for key, value in self.parameters.items())
        shown = f"{PREFIX}{self.target}" if self.kind == "controller" and not _all_known(self.target) else self.target
        return f"{shown}:{pairs}" if pairs else shown


def parse_name(
    text: str, words: Collection[str] = (), aliases: Mapping[str, str] | None = None, near: Iterable[str] = ()
) -> Name:
    """Read a name: a word before a controller before a class in a file before a path before a class in a module.

    Nothing is loaded or executed.

    Parameters
    ----------
    words : collection of str
        Further words that have a meaning here.
    aliases : mapping, optional
        Of those words.
    near : iterable of str
        Further names that may have been meant, for the message.

    Raises
    ------
    ValueError, FileNotFoundError
        If it is none of them, with what is allowed and what is near, or if parameters are malformed; if it looks like a
        path, and nothing is there.

    Examples
    --------
    >>> parse_name("baseline+yaw:dead_band=0.05")
    Name(kind='controller', target='discon+yaw', parameters={'dead_band': 0.05})
    >>> parse_name("mine/controller.py:Mine:gain=2").text
    'mine/controller.py:Mine:gain=2'
    """
    head, _, rest = text.partition(":")
    word = (aliases or {}).get(head, head)
    if word in words:
        return Name("word", word, _parameters(rest, text))
    if text.startswith(PREFIX) or _all_known(_canonical(head)):
        return Name("controller", *name_and_parameters(text.removeprefix(PREFIX)))
    if match := _FILE_CLASS.fullmatch(text):
        return Name("class", match["target"], _parameters(match["rest"], text, strings=True))
    if text.endswith(".py"):
        _refuse_file(text)
    if text and Path(text).exists():
        return Name("trained", text)
    if (match := _MODEL.fullmatch(text)) and Path(match["target"]).exists():
        return Name("trained", match["target"], _parameters(match["rest"], text, strings=True))
    folder, _, rest = text.rpartition(":")
    if "=" in rest and folder and Path(folder).exists():
        return Name("trained", folder, _parameters(rest, text, strings=True))
    if (match := _MODULE_CLASS.fullmatch(text)) and "=" not in match["target"]:
        return Name("class", match["target"], _parameters(match["rest"], text, strings=True))
    if text.endswith(".zip") or "/" in text or "\\" in text:
        raise FileNotFoundError(
            f"an agent must be a controller or an existing path, got {text!r}: there is no trained model at {text}"
        )
    allowed = f"{', '.join(words)}, a controller" if words else "a controller"
    raise ValueError(
        f"an agent must be {allowed} ({', '.join(CONTROLLERS)}, joined with '+', parameters behind ':'), "
        f"a class of your own (path/file.py:Class or module:Class), or the path of a trained model; got {text!r}"
        + did_you_mean(head.rpartition("+")[2], (*words, *CONTROLLERS, *ALIASES, *near))
    )


def _all_known(names: str) -> bool:
    return all(name in CONTROLLERS for name in names.split("+"))


def _canonical(names: str) -> str:
    """Names of the catalog with aliases resolved."""
    return "+".join(ALIASES.get(name, name) for name in names.split("+"))


def _refuse_file(text: str) -> None:
    """Say that a file must be followed by one of its classes; the file is read but not executed."""
    try:
        tree = ast.parse(Path(text).read_bytes())
        first = next(node.name for node in tree.body if isinstance(node, ast.ClassDef))
    except (SyntaxError, ValueError, OSError, StopIteration):
        first = "Class"
    raise ValueError(f"{text!r} must name a class behind a colon, as {text}:{first}")


def _parameters(rest: str | None, text: str, strings: bool | Collection[str] = False) -> dict[str, Any]:
    """Parameters of ``key=value,key=value``: numbers, True, False, None, and words, for all keys or for some."""
    if not rest:
        if text.endswith(":"):
            raise ValueError(f"the colon of {text!r} must be followed by key=value, or left out")
        return {}
    if match := _NAME_BEHIND_PARAMETERS.search(rest):
        head = text[: len(text) - len(rest)].rstrip(":")
        pairs = [rest[: match.start()], *filter(None, [(match["rest"] or "").lstrip(":")])]
        raise ValueError(
            f"the names of {text!r} must all stand before the colon, the parameters of all parts behind it: "
            f"{head}+{match['name']}:{','.join(pairs)}"
        )
    parameters: dict[str, Any] = {}
    for pair in rest.split(","):
        key, separator, value = pair.partition("=")
        if not (separator and key):
            raise ValueError(f"a parameter of a controller must be key=value, got {pair!r} in {text!r}")
        if key in parameters:
            raise ValueError(f"every parameter must be given once, got {key} twice in {text!r}")
        parameters[key] = value if strings is not True and strings and key in strings else _literal(value)
        worded = strings if isinstance(strings, bool) else key in strings
        if not isinstance(parameters[key], int | float | None) and not (worded and isinstance(parameters[key], str)):
            words = ", a word" if worded else ""
            raise ValueError(
                f"the value of {key!r} in {text!r} must be a number{words}, True, False or None, got {value!r}"
            )
    return parameters


def _literal(value: str) -> Any:
    """Value of a Python literal; the text itself where it is none."""
    try:
        return ast.literal_eval(value)
    except (ValueError, SyntaxError):
        return value


def name_and_parameters(choice: str) -> tuple[str, dict[str, Any]]:
    """Name and parameters of a controller from ``name:key=value,key=value``; aliases are resolved.

    Values are Python literals: numbers, True, False or None; words too for your own class.

    Raises
    ------
    ValueError
        If a parameter is not of the form ``key=value`` with such a value.

    Examples
    --------
    >>> name_and_parameters("constrained_ipc+yaw:level=0.1,dead_band=0.05")
    ('constrained_ipc+yaw', {'level': 0.1, 'dead_band': 0.05})
    >>> name_and_parameters("bladed:lib/mine.so:interval=0.0125,input_file=mine.in")
    ('bladed', {'library': 'lib/mine.so', 'interval': 0.0125, 'input_file': 'mine.in'})
    """
    head, _, rest = choice.partition(":")
    name = _canonical(head)
    if not _all_known(name) and (match := _FILE_CLASS.fullmatch(choice) or _MODULE_CLASS.fullmatch(choice)):
        return match["target"], _parameters(match["rest"], choice, strings=True)
    declared = [
        (key, one)
        for part in name.split("+")
        if part in CONTROLLERS
        for one in declared_parameters(part)  # those of a name that stands for several are part__parameter
        for key in (one.name, f"{part}__{one.name}", one.name.rpartition("__")[2])
    ]
    library: dict[str, Any] = {}
    if _LIBRARY in name.split("+"):  # its path, which may have colons and equality signs, stands first
        keys, (path, separator, pairs) = {key for key, _ in declared}, rest.rpartition(":")
        if separator and pairs.partition("=")[0] in keys:
            library, rest = {"library": path}, pairs
        elif rest and rest.partition("=")[0] not in keys:
            library, rest = {"library": rest}, ""
    words = {key for key, one in declared if {"str", "Path"} & set(one.annotation.split("|"))}
    return name, library | _parameters(rest, choice, words)


# ---- classes of the user ----


def load_class(target: str) -> Any:
    """Load a class, or a function that makes something, from ``path/file.py:Class`` or ``module:Class``.

    The file or module is executed, with all that its author wrote into it. A file is executed once in a process and
    stays the same module, so that objects of its classes can be pickled and copied. Modules are looked for in the
    present folder too.

    Raises
    ------
    FileNotFoundError, ValueError
        If there is no such file; no such module, or it has no such name.
    """
    place, _, name = target.rpartition(":")
    module = _module_of_file(Path(place)) if place.endswith(".py") else _module(place, target)
    value: Any = module
    for part in name.split("."):
        if not hasattr(value, part):
            known = [key for key, entry in vars(value).items() if callable(entry) and not key.startswith("_")]
            there = ", ".join(known) or "no class or function"
            raise ValueError(f"{place} has no {name!r}; it has {there}{did_you_mean(name, known)}")
        value = getattr(value, part)
    if not callable(value):
        raise ValueError(f"{target} must be a class, or a function that makes a controller or an agent, got {value!r}")
    return value


def call_maker(target: str, maker: Callable[..., Any], arguments: dict[str, Any]) -> Any:
    """Call a class or function of a file, named ``target`` in the message, with keyword arguments."""
    try:
        signature = inspect.signature(maker)
        signature.bind(**arguments)
    except TypeError as error:
        raise ValueError(f"{target} takes the arguments {signature}, got {arguments}: {error}") from error
    return maker(**arguments)


def source_digest(target: str) -> str:
    """SHA-256 sum of the file in which a class is written, which identifies its version; its imports do not count."""
    place = target.rpartition(":")[0]
    source = _existing(Path(place)) if place.endswith(".py") else inspect.getsourcefile(_module(place, target))
    if source is None:
        raise ValueError(f"module {place!r} has no source file")
    return hashlib.sha256(Path(source).read_bytes()).hexdigest()


def _existing(file: Path) -> Path:
    if not file.is_file():
        raise FileNotFoundError(f"there is no file {file}")
    return file


def _module_of_file(file: Path) -> Any:
    """Module of a file, executed where it is not yet."""
    path = _existing(file).resolve()
    name = f"wt_gym_own_{path.stem}_{hashlib.sha256(str(path).encode()).hexdigest()[:8]}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ValueError(f"{file} cannot be loaded as Python")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def _module(name: str, target: str) -> Any:
    """Module by name; the current folder is looked in after all others."""
    here = os.getcwd()
    if here not in sys.path:
        sys.path.append(here)
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is not None and (name == error.name or name.startswith(f"{error.name}.")):
            raise ValueError(
                f"there is no module {error.name!r} for {target!r}; a file is named as path/file.py:Class"
            ) from error
        raise


# ---- controllers of names ----


def is_agent_class(maker: Any) -> bool:
    """Whether a class is an agent's, with stable-baselines3's ``predict``, and no controller's."""
    return callable(getattr(maker, "predict", None)) and not callable(getattr(maker, "step", None))


def make_controller(
    choice: str | Controller | Callable[[Turbine], Controller], turbine: Turbine, **parameters: Any
) -> Controller:
    """Make a controller for a turbine.

    Parameters
    ----------
    choice : str, Controller or callable
        Names of `CONTROLLERS` joined with ``+``: one of `BASES` (by default "discon", which "baseline" means too) and
        additions, for example ``"discon"``, ``"ipc"`` (the same as ``"discon+ipc"``),
        ``"tsr_tracking+constrained_ipc+tower_dampers+yaw"``; with parameters behind a colon as `name_and_parameters`
        reads them: ``"constrained_ipc:level=0.1"``. Or your own class or function, ``"path/file.py:Class"`` or
        ``"module:Class"``, whose code is run; it is made by its ``of_turbine(turbine, ...)`` where it has one, gets
        ``turbine`` where it takes an argument of this name, and stands on "discon" where it is an addition. Or a
        controller, which is returned as it is, or a function that makes one for the turbine.
    **parameters
        Of the parts, see `declared_parameters`. One that belongs to several parts of the name is told apart by the
        name of the part and two underscores: ``ipc__limit=0.05``. For a class or function they are its keyword
        arguments.

    Raises
    ------
    ValueError
        For an unknown name, which lists those allowed, a parameter that no part has or that several have, or a value
        that is not allowed; for a trained model or the class of an agent.
    TypeError
        If what is given, or what a function gives, is not a controller (an addition alone is none), or a controller
        comes with parameters.

    Examples
    --------
    >>> from wt_gym.turbines import load_turbine
    >>> controller = make_controller("ipc+yaw", load_turbine("nrel_5mw"), bandwidth=0.3)
    """
    if isinstance(choice, str):
        target, beside = name_and_parameters(choice.removeprefix(PREFIX))
        if both := [key for key in beside if key in parameters]:
            raise ValueError(f"{', '.join(both)} of controller {target!r} is given twice")
        if ":" in target:
            return _of_own_class(target, turbine, beside | parameters)
        if target.endswith(".py"):
            _refuse_file(target)
        if not _all_known(target) and (target.endswith(".zip") or (target and Path(target).exists())):
            raise ValueError(
                f"{target!r} must be a controller (channels, start, step): a trained model acts on observations and "
                "cannot run below actions or without an environment; name it as an agent, as in wt-gym evaluate"
            )
        return _of_catalog(target, turbine, beside | parameters)
    if is_controller(choice):
        if parameters:
            raise TypeError(f"a controller that is made already takes no parameters, got {', '.join(parameters)}")
        return choice
    if is_addition(choice) or not callable(choice):
        raise TypeError(
            f"controller must be a name ({', '.join(CONTROLLERS)}), a Controller or a function, got {_what(choice)}"
        )
    return _checked(choice(turbine, **parameters), repr(choice))


def _of_own_class(target: str, turbine: Turbine, parameters: dict[str, Any]) -> Controller:
    """Controller of a class or function of the user's."""
    maker = load_class(target)
    if is_agent_class(maker):
        raise ValueError(
            f"{target} must be a controller (channels, start, step), got a class with predict: it acts on observations "
            "and cannot be a base controller or run without an environment; name it as an agent, as in wt-gym evaluate"
        )
    if callable(getattr(maker, "of_turbine", None)):
        made = call_maker(target, partial(maker.of_turbine, turbine), parameters)
    else:
        wanted = {"turbine": turbine} if "turbine" in inspect.signature(maker).parameters else {}
        made = call_maker(target, partial(maker, **wanted), parameters)
    if is_addition(made):
        return Combined(_of_catalog(BASELINE, turbine, {}), made)
    return _checked(made, target)


def _checked(made: Any, maker: str) -> Controller:
    """Give back what a function has made if it is a controller."""
    if not is_controller(made):
        raise TypeError(
            f"{maker} gave {_what(made)}; it must give a Controller: channels, start(signals, demand), "
            "step(signals, dt)"
        )
    return made


def _what(given: object) -> str:
    """Name a thing that is not a controller."""
    if is_addition(given):
        return f"the addition {given!r}, which changes the demand of a controller: use Combined(controller, addition)"
    return repr(given)
