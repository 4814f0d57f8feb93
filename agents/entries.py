"""What takes part in the benchmark: words of the command line into agents and the environment each of them wants."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from wt_gym.agents.choices import (
    BASELINE,
    default_name,
    each_seed,
    env_choices_of,
    fingerprint,
    is_base_controller,
    read_name,
    split_name,
)
from wt_gym.agents.comparison import RESIDUAL_INTERFACE
from wt_gym.agents.constant import ConstantAgent
from wt_gym.agents.environments import load_agent, load_model
from wt_gym.agents.planning import check_settings
from wt_gym.agents.trained_environment import environment_of_training
from wt_gym.benchmark import INTERFACE
from wt_gym.control.controllers.parameters import did_you_mean
from wt_gym.envs.layout import layout_of

if TYPE_CHECKING:
    from collections.abc import Iterable

    import gymnasium as gym

    from wt_gym.agents.trained_agent import TrainedAgent
    from wt_gym.control.controllers import Name

__all__ = ["BASELINE", "LEVELS", "WORDS", "Entry", "entries_of", "entry_of"]

LEVELS = (0.03, 0.06, 0.1, 0.15, 0.2)
"""Bands of constrained individual pitch in the word "baselines", in `reference_flap_moment`."""

WORDS = {
    "baselines": (
        "zero",
        "random",
        BASELINE,
        "retuned",
        "tuned",
        "ipc",
        *(f"constrained_ipc:level={x:g}" for x in LEVELS),
    ),
}
"""Words that stand for several entries."""


@dataclass(frozen=True)
class Entry:
    """An agent with the environment it wants.

    Attributes
    ----------
    name : str
        Shown in tables.
    choice : str
        From which the agent is made: "zero", "random", "planner", a controller, or the path of a trained model.
    definition : dict
        JSON values that tell it from every other agent.
    interface : dict
        Arguments of the environment, see `wt_gym.benchmark.INTERFACE`.
    """

    name: str
    choice: str
    definition: dict[str, Any]
    interface: dict[str, Any] = field(default_factory=dict)

    def make(self, env: gym.Env):
        """Make the agent for an environment; it has stable-baselines3's ``predict``."""
        layout = layout_of(env)
        if self.definition["kind"] == "controller":  # which runs beneath
            return ConstantAgent(layout)
        agent = load_agent(self.choice, layout, env)
        if self.definition["kind"] == "trained":
            cast("TrainedAgent", agent).enter(layout)
        return agent


def entry_of(text: str) -> Entry:
    """Entry of one word, path or ``NAME=CHOICE``.

    Parameters
    ----------
    text : str
        "zero" (zero actions on the baseline controller), "random" (even draws), "planner", with parameters as
        ``planner:horizon=2.0``, a controller (`wt_gym.control.controllers.CONTROLLERS`, joined with "+"), with
        parameters as ``constrained_ipc:level=0.1``, or the path of a trained model or its folder.

    Raises
    ------
    ValueError
        If it is none of them, or a setting of a planner is out of range.
    """
    label, choice = split_name(text)
    name = read_name(choice)
    return _entry(label or _default_name(name), name)


def _default_name(name: Name) -> str:
    """Label of an entry: what is said, of a path its last part."""
    return Path(name.target).name if name.kind == "trained" else default_name(name)


def _entry(label: str, name: Name) -> Entry:
    """Entry of a name."""
    text = name.text
    if name.kind == "word" and name.target == "planner":
        check_settings(name.parameters)
        return Entry(label, text, {"kind": "planner", "parameters": name.parameters})
    if name.kind == "word":
        return Entry(label, text, {"kind": name.target})
    if name.kind == "trained":
        return _trained(label, name)
    if name.kind == "class":
        known = fingerprint(text)
        source = {"class": known["class"], "parameters": name.parameters, "sha256": [*known["sha256"].values()]}
        if not is_base_controller(text):
            return Entry(label, text, {"kind": "class", **source}, env_choices_of(text))
        beneath = {**RESIDUAL_INTERFACE, "controller": [name.target, name.parameters]}
        return Entry(label, text, {"kind": "controller", **source}, beneath)
    definition = {"kind": "controller", "controller": name.target, "parameters": name.parameters}
    return Entry(label, text, definition, {**RESIDUAL_INTERFACE, "controller": [name.target, name.parameters]})


def entries_of(texts: Iterable[str]) -> list[Entry]:
    """Entries of a command line, each once; the folder of a training with several seeds is one a seed.

    Raises
    ------
    ValueError
        If one is no agent, or two different ones have the same name.
    """
    entries: dict[str, Entry] = {}
    for text in texts:
        for word in WORDS.get(text, (text,)):
            label, choice = split_name(word)
            name = _read(choice)
            for suffix, single in each_seed(name):
                entry = _entry((label or _default_name(name)) + suffix, read_name(single))
                if entries.setdefault(entry.name, entry) != entry:
                    raise ValueError(f"two agents are called {entry.name!r}; give them names as NAME=CHOICE")
    return list(entries.values())


def _read(choice: str) -> Name:
    """What a choice means, with the words that stand for several in the message."""
    try:
        return read_name(choice)
    except ValueError as error:
        raise ValueError(f"{error}{did_you_mean(choice, WORDS)}") from error


def _trained(label: str, name: Name) -> Entry:
    """Entry of a trained model, in the environment it was trained in, or in the one that it chooses."""
    from wt_gym.agents.trained_agent import model_digests

    agent, chosen = load_model(name), env_choices_of(name.text)
    record = agent.record or {}
    algorithm = record.get("algorithm") or type(agent.model).__name__
    definition = {"kind": "trained", "algorithm": algorithm, "sha256": model_digests(name.target)}
    return Entry(label, name.text, definition, environment_of_training(record, INTERFACE) | chosen)
