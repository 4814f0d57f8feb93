"""What the names of agents mean: those of controllers (`wt_gym.control.controllers.names`), and words for agents."""

import hashlib
import importlib.util
import logging
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from wt_gym.control.controllers.names import (
    ALIASES,
    BASELINE,
    PREFIX,
    Name,
    compiled_files,
    is_agent_class,
    load_class,
    parse_name,
    source_digest,
)

_log = logging.getLogger(__name__)
WORDS = ("zero", "random", "planner")
"""Agents by word: zero actions, which leave everything to the base controller; even draws; planning on a copy of the
simulator. A controller, a class of yours and a path are read by `wt_gym.control.controllers.names.parse_name`."""
LEVELS = (0.03, 0.06, 0.1, 0.15, 0.2)
"""Bands of constrained individual pitch in the word "baselines", in `reference_flap_moment`."""
ROSCO = "rosco"
"""The controller that a package brings; lists of controllers go without it where that is not installed."""
GROUPS = {
    "baselines": (
        "zero", "random", BASELINE, ROSCO, "retuned", "tuned", "ipc", *(f"constrained_ipc:level={x:g}" for x in LEVELS)
    ),
}  # fmt: skip
"""Words of the benchmark that stand for several agents."""
COMPARED = (BASELINE, ROSCO, "tsr_tracking", "ipc", "tuned")
"""Controllers that are compared where none is named."""
INTERFACE = (
    "action_mode", "pitch", "action_components", "action_spans", "residual_fade", "residual_washout", "residual_form",
    "controller", "observation", "history", "sensor_washout",
)  # fmt: skip
"""Arguments of the environment that an agent may choose: what it sees, what its actions mean, its base controller."""
RESIDUAL_INTERFACE: dict[str, Any] = {"action_mode": "residual", "pitch": "fixed-frame", "action_components": ["pitch"]}
"""Arguments of an environment in which a controller is the base controller of zero actions."""
_WORD_ALIASES = {"constant": "zero", "Constant action": "zero"}
_MODEL_PARAMETERS = ("algo", "env", "trust")


def read_name(choice: str, near: Iterable[str] = ()) -> Name:
    """Meaning of the name of an agent; a `ValueError` if it is none, or has parameters that it cannot have.

    ``near`` are further names that may have been meant, for the message.
    """
    name = parse_name(choice, WORDS, _WORD_ALIASES, near)
    allowed = _MODEL_PARAMETERS if name.kind == "trained" else ()
    if name.kind == "trained" or (name.kind == "word" and name.target != "planner"):
        for key in name.parameters:
            if key not in allowed:
                raise ValueError(f"parameters of {choice!r} must be among {', '.join(allowed) or 'none'}, got {key!r}")
    return name


def available(choices: Iterable[str]) -> tuple[str, ...]:
    """Choices of a ready-made list, without ROSCO where its package is not installed; a line of the log says so."""
    found = tuple(choices)
    if ROSCO not in found or importlib.util.find_spec(ROSCO) is not None:
        return found
    _log.warning("rosco is left out: the package rosco is not installed (pip install --no-deps rosco)")
    return tuple(choice for choice in found if choice != ROSCO)


def is_base_controller(choice: str) -> bool:
    """Whether a choice is a controller, of the library or a class of yours, which is loaded."""
    name = read_name(choice)
    return name.kind == "controller" or (name.kind == "class" and not is_agent_class(load_class(name.target)))


def env_choices_of(choice: str) -> dict[str, Any]:
    """Arguments of the environment that an agent chooses for itself: what it sees, what its actions mean.

    Of a class its attribute ``env_kwargs``; of a model those in the file ``env=``, else in a file of its name ending in
    ``.json`` beside it (``{"algo": "SAC", "env_kwargs": {...}}``).

    Raises
    ------
    ValueError
        If they are no table, one is not the agent's to choose, or the file is damaged.
    """
    name, given = read_name(choice), dict[str, Any]()
    if name.kind == "class" and is_agent_class(maker := load_class(name.target)):
        given = getattr(maker, "env_kwargs", {})
    elif name.kind == "trained":
        from wt_gym.experiment.trained_agent import model_card  # torch takes seconds to import

        given = model_card(name.target, name.parameters.get("env")).get("env_kwargs", {})
    if not isinstance(given, dict):
        raise ValueError(f"env_kwargs of {choice} must be a table of arguments of the environment, got {given!r}")
    if foreign := [key for key in given if key not in INTERFACE]:
        raise ValueError(
            f"env_kwargs of {choice} must be some of {', '.join(INTERFACE)}, got {', '.join(foreign)}: turbine and "
            "wind are the same for all"
        )
    return given


def split_name(text: str) -> tuple[str, str]:
    """Name and choice of ``NAME=CHOICE``; the name is empty where there is none.

    A name has no colon, so that ``constrained_ipc:level=0.1`` is a controller with a parameter.
    """
    name, separator, choice = text.partition("=")
    return (name, choice) if separator and ":" not in name else ("", text)


def own_controller(env_id: str, env_kwargs: Mapping[str, Any]) -> str:
    """Meaning of "baseline" in an environment: the base controller of residual actions, else `BASELINE`."""
    from wt_gym.envs.options import registered_arguments

    arguments = registered_arguments(env_id, env_kwargs)
    given = arguments.get("controller", BASELINE)
    residual = arguments.get("action_mode") == "residual" and isinstance(given, str)
    return parse_name(given).text if residual else BASELINE


def with_model_options(choices: Iterable[str], algo: str | None = None, trust: bool = False) -> list[str]:
    """Names in which trained models carry algorithm and trust of a command line, where they say nothing themselves.

    Names may have ``NAME=`` in front; with trust a model is loaded that could run code.
    """
    made = []
    for given in choices:
        label, choice = split_name(given)
        more: dict[str, Any] = ({"algo": algo} if algo else {}) | ({"trust": True} if trust else {})
        if more:
            with suppress(ValueError, FileNotFoundError):  # what is no name at all is refused where it is used
                name = read_name(choice)
                if name.kind == "trained":
                    choice = Name(name.kind, name.target, more | name.parameters).text
        made.append(f"{label}={choice}" if label else choice)
    return made


def named_choices(choices: Iterable[str], own: str = BASELINE) -> dict[str, str]:
    """Names for the agents of a command line: ``NAME=CHOICE``, or a name that follows from the choice.

    The folder of a training with several seeds stands for one agent a seed; ``own`` is what "baseline" means, see
    `own_controller`. Returns label to name, aliases resolved, in the given order. Raises a `ValueError` if two agents
    get the same label, or a choice is none.
    """
    named = dict[str, str]()
    for shown, single in each_named(choices, own):
        if shown in named:
            raise ValueError(f"two agents are called {shown!r}; give them names as NAME={single}")
        named[shown] = single
    return named


def each_named(
    choices: Iterable[str], own: str = BASELINE, groups: Mapping[str, Iterable[str]] | None = None
) -> Iterator[tuple[str, str]]:
    """Label and name of each agent of a command line, aliases resolved; arguments as of `named_choices`.

    ``groups`` has words that stand for several choices. Raises a `ValueError` if a choice is none.
    """
    known = groups or {}
    for given in (single for word in choices for single in (available(known[word]) if word in known else (word,))):
        label, choice = split_name(given)
        name = read_name(own if choice in ALIASES else choice, known)
        for suffix, single in each_seed(name):
            yield (label or default_name(name)) + suffix, single


def each_seed(name: Name) -> list[tuple[str, str]]:
    """Suffix of the label and text of each seed where a name is the folder of a training with several seeds.

    One pair with an empty suffix for anything else. Raises a `FileNotFoundError` if no seed has been trained, and a
    `ValueError` if the plan of the training is damaged.
    """
    if name.kind != "trained":
        return [("", name.text)]
    from wt_gym.experiment.run_folder import SEEDS_FILE, read_plan, seed_folder
    from wt_gym.experiment.trained_agent import MODEL_FILE  # torch takes seconds to import

    folder = Path(name.target)
    if not (folder / SEEDS_FILE).is_file():
        return [("", name.text)]
    folders = {seed: seed_folder(folder, seed) for seed in sorted(read_plan(folder)["seeds"])}
    trained = {seed: path for seed, path in folders.items() if (path / MODEL_FILE).is_file()}
    if not trained:
        raise FileNotFoundError(f"no trained model in {name.target} yet: none of its seeds has one")
    return [(f" seed {seed}", Name(name.kind, str(path), name.parameters).text) for seed, path in trained.items()]


def fingerprint(choice: str) -> dict[str, Any]:
    """What an agent is, to tell whether a stopped evaluation can resume with it.

    For a trained model or a class of yours the SHA-256 sums of its files too, and what else makes it up; raises a
    `FileNotFoundError` if there is no such model or file.
    """
    name = read_name(choice)
    if name.kind == "class":
        made_of = {"class": name.target.rpartition(":")[2], "parameters": name.parameters}
        return {"choice": name.text, "sha256": {name.target: source_digest(name.target)}, **made_of}
    if name.kind == "controller" and (files := compiled_files(name.target, name.parameters)):
        digests = {str(file): hashlib.sha256(file.read_bytes()).hexdigest() for file in files}
        return {"choice": name.text, "sha256": digests}
    if name.kind != "trained":
        return {"choice": choice if choice in ALIASES else name.text}
    from wt_gym.experiment.trained_agent import model_digests  # torch takes seconds to import

    found: dict[str, Any] = {"choice": name.text, "sha256": model_digests(name.target)}
    if "algo" in name.parameters:
        found["algo"] = name.parameters["algo"]
    if chosen := env_choices_of(choice):
        found["env_kwargs"] = chosen
    return found


def default_name(name: Name) -> str:
    """Label that says what a name is, the same in every command.

    Of a trained model the name of its folder, of a file without the record of a training beside it that of the file; of
    a class its name; of all else what is said.
    """
    if name.kind == "class":
        return Name("class", name.target.rpartition(":")[2], name.parameters).text
    if name.kind != "trained":
        return name.text.removeprefix(PREFIX)
    from wt_gym.experiment.trained_agent import RECORD_FILE

    path = Path(os.path.abspath(name.target))  # a folder said as "." has a name too; links keep theirs
    if path.is_dir():
        return path.name
    return path.parent.name if (path.parent / RECORD_FILE).is_file() else path.stem
