"""The one way in which controllers and agents are named, on every command line and in ``gym.make(controller=...)``.

======================================  ===========================================================================
``NAME+NAME:key=value,...``             controllers of the catalogue; ``controller:`` may stand in front
``bladed:LIBRARY:key=value,...``        a compiled controller with the Bladed interface
``path/file.py:Class:key=value,...``    your own class, or a function, in a file
``module:Class:key=value,...``          the same in a module
``FOLDER``, ``FILE.zip:key=value,...``  a trained model
another word, ``WORD:key=value,...``    what a command knows besides, see `wt_gym.experiment.names`
======================================  ===========================================================================
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wt_gym.base.errors import did_you_mean
from wt_gym.control.controllers.catalogue import CONTROLLERS, catalogue_controller, declared_parameters
from wt_gym.control.controllers.controller import Combined, Controller, is_addition, is_controller
from wt_gym.control.controllers.own_class import call_maker, classes_in, load_class

if TYPE_CHECKING:
    from wt_gym.turbines import Turbine

__all__ = [
    "ALIASES",
    "BASELINE",
    "PREFIX",
    "Name",
    "is_agent_class",
    "make_controller",
    "name_and_parameters",
    "parse_name",
]

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
    """What a name means.

    Attributes
    ----------
    kind : {"word", "controller", "class", "trained"}
    target : str
        Word, names of the catalogue joined with "+", ``file.py:Class`` or ``module:Class``, or path; aliases resolved.
    parameters : dict
        By key.
    """

    kind: str
    target: str
    parameters: dict[str, Any] = field(default_factory=dict)

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
    text : str
    words : collection of str
        That mean something here besides.
    aliases : mapping, optional
        Of those words.
    near : iterable of str
        Further names that may have been meant, for the message.

    Raises
    ------
    ValueError
        If it is none of them, with what is allowed and what is near; or if parameters are malformed.
    FileNotFoundError
        If it looks like a path, and nothing is there.

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
    if text.startswith(PREFIX):
        return Name("controller", *name_and_parameters(text.removeprefix(PREFIX)))
    if _all_known(_canonical(head)):
        return Name("controller", *name_and_parameters(text))
    if found := _FILE_CLASS.fullmatch(text):
        return Name("class", found["target"], _parameters(found["rest"], text, strings=True))
    if text.endswith(".py"):
        inside = classes_in(Path(text))
        raise ValueError(f"{text!r} must name a class behind a colon, as {text}:{inside[0] if inside else 'Class'}")
    if text and Path(text).exists():
        return Name("trained", text)
    if (found := _MODEL.fullmatch(text)) and Path(found["target"]).exists():
        return Name("trained", found["target"], _parameters(found["rest"], text, strings=True))
    folder, _, rest = text.rpartition(":")
    if "=" in rest and folder and Path(folder).exists():
        return Name("trained", folder, _parameters(rest, text, strings=True))
    if (found := _MODULE_CLASS.fullmatch(text)) and "=" not in found["target"]:
        return Name("class", found["target"], _parameters(found["rest"], text, strings=True))
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
    """Names of the catalogue with aliases resolved."""
    return "+".join(ALIASES.get(name, name) for name in names.split("+"))


def _parameters(rest: str | None, text: str, strings: bool | Collection[str] = False) -> dict[str, Any]:
    """Parameters of ``key=value,key=value``: numbers, True, False, None, and words, for all keys or for some."""
    if not rest:
        if text.endswith(":"):
            raise ValueError(f"the colon of {text!r} must be followed by key=value, or left out")
        return {}
    if found := _NAME_BEHIND_PARAMETERS.search(rest):
        head = text[: len(text) - len(rest)].rstrip(":")
        pairs = [rest[: found.start()], *filter(None, [(found["rest"] or "").lstrip(":")])]
        raise ValueError(
            f"the names of {text!r} must all stand before the colon, the parameters of all parts behind it: "
            f"{head}+{found['name']}:{','.join(pairs)}"
        )
    parameters: dict[str, Any] = {}
    for pair in rest.split(","):
        key, separator, value = pair.partition("=")
        if not (separator and key):
            raise ValueError(f"a parameter of a controller must be key=value, got {pair!r} in {text!r}")
        if key in parameters:
            raise ValueError(f"every parameter must be given once, got {key} twice in {text!r}")
        try:
            parameters[key] = ast.literal_eval(value)
        except (ValueError, SyntaxError):
            parameters[key] = value
        worded = strings if isinstance(strings, bool) else key in strings
        if worded and not isinstance(strings, bool):
            parameters[key] = value
        if not isinstance(parameters[key], int | float | None) and not (worded and isinstance(parameters[key], str)):
            words = ", a word" if worded else ""
            raise ValueError(
                f"the value of {key!r} in {text!r} must be a number{words}, True, False or None, got {value!r}"
            )
    return parameters


def name_and_parameters(choice: str) -> tuple[str, dict[str, Any]]:
    """Name and parameters of a controller from ``name:key=value,key=value``.

    Parameters
    ----------
    choice : str
        Values are Python literals: numbers, True, False or None; words too for your own class. Aliases are
        resolved.

    Raises
    ------
    ValueError
        If a parameter is not of the form ``key=value`` with such a value.

    Examples
    --------
    >>> name_and_parameters("constrained_ipc+yaw:level=0.1,dead_band=0.05")
    ('constrained_ipc+yaw', {'level': 0.1, 'dead_band': 0.05})
    >>> name_and_parameters("baseline")
    ('discon', {})
    >>> name_and_parameters("bladed:lib/mine.so:interval=0.0125,input_file=mine.in")
    ('bladed', {'library': 'lib/mine.so', 'interval': 0.0125, 'input_file': 'mine.in'})
    """
    if found := _FILE_CLASS.fullmatch(choice) or _MODULE_CLASS.fullmatch(choice):
        head = choice.partition(":")[0]
        if not _all_known(_canonical(head)):
            return found["target"], _parameters(found["rest"], choice, strings=True)
    name, _, rest = choice.partition(":")
    name = _canonical(name)
    declared = [
        (key, parameter)
        for part in name.split("+")
        if part in CONTROLLERS
        for parameter in declared_parameters(part)  # those of a name that stands for several are part__parameter
        for key in (parameter.name, f"{part}__{parameter.name}", parameter.name.rpartition("__")[2])
    ]
    words = {key for key, parameter in declared if parameter.word}
    library, rest = _library(rest, {key for key, _ in declared}) if _LIBRARY in name.split("+") else ("", rest)
    return name, ({"library": library} if library else {}) | _parameters(rest, choice, words)


def _library(rest: str, keys: Collection[str]) -> tuple[str, str]:
    """Path of a library, "" where a parameter names it, and the text of the parameters behind it.

    The path may have colons and equality signs of its own.
    """
    path, separator, pairs = rest.rpartition(":")
    if separator and pairs.partition("=")[0] in keys:
        return path, pairs
    return ("", rest) if rest.partition("=")[0] in keys else (rest, "")


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
    turbine : Turbine
    **parameters
        Of the parts, see `declared_parameters`. One that belongs to several parts of the name is told apart by the
        name of the part and two underscores: ``ipc__limit=0.05``. For a class or function they are its keyword
        arguments.

    Returns
    -------
    Controller
        Not started.

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
        parameters = beside | parameters
        if ":" in target:
            return _of_own_class(target, turbine, parameters)
        if not _all_known(target) and (target.endswith((".py", ".zip")) or (target and Path(target).exists())):
            _refuse_path(target)
        return catalogue_controller(target, turbine, parameters)
    if is_controller(choice):
        if parameters:
            raise TypeError(f"a controller that is made already takes no parameters, got {', '.join(parameters)}")
        return choice
    if is_addition(choice) or not callable(choice):
        raise TypeError(
            f"controller must be a name ({', '.join(CONTROLLERS)}), a Controller or a function, got {_what(choice)}"
        )
    made = choice(turbine, **parameters)
    if not is_controller(made):
        raise TypeError(
            f"{choice!r} gave {_what(made)}; it must give a Controller: channels, start(signals, demand), "
            "step(signals, dt)"
        )
    return made


def _refuse_path(target: str) -> None:
    """Say what to do with a path that does not name a controller."""
    if target.endswith(".py"):
        parse_name(target)  # which says what is missing
    raise ValueError(
        f"{target!r} must be a controller (channels, start, step): a trained model acts on observations and cannot run "
        "below actions or without an environment; name it as an agent, as in wt-gym evaluate"
    )


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
        return Combined(catalogue_controller(BASELINE, turbine, {}), made)
    if not is_controller(made):
        raise TypeError(
            f"{target} gave {made!r}; it must give a Controller: channels, start(signals, demand), step(signals, dt)"
        )
    return made


def _what(given: object) -> str:
    """Name a thing that is not a controller."""
    if is_addition(given):
        return f"the addition {given!r}, which changes the demand of a controller: use Combined(controller, addition)"
    return repr(given)
