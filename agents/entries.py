"""What takes part in the benchmark: words of the command line into agents and the environment each of them wants."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wt_gym.agents.choices import controller_of, expand_seeds, kind_of, split_name
from wt_gym.agents.constant import ConstantAgent
from wt_gym.agents.planning import ShootingPlanner, check_settings
from wt_gym.agents.trained_environment import environment_of_training
from wt_gym.agents.uniform import UniformAgent
from wt_gym.benchmark import INTERFACE
from wt_gym.envs.layout import layout_of

if TYPE_CHECKING:
    from collections.abc import Iterable

    import gymnasium as gym

__all__ = ["BASELINE", "LEVELS", "WORDS", "Entry", "entries_of", "entry_of"]

BASELINE = "discon"
"""Entry whose score is zero."""

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

_BENEATH = {"action_mode": "residual", "pitch": "fixed-frame", "action_components": ["pitch"]}


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
        kind = self.definition["kind"]
        if kind == "random":
            return UniformAgent(layout)
        if kind == "planner":
            return ShootingPlanner(env, **self.definition["parameters"])
        if kind == "trained":
            from wt_gym.agents.trained_agent import TrainedAgent  # torch takes seconds to import

            agent = TrainedAgent.load(self.choice)
            agent.enter(layout)
            return agent
        return ConstantAgent(layout)


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
    name, choice = split_name(text)
    return _entry(name or _default_name(choice), choice)


def _default_name(choice: str) -> str:
    """Name of an entry: the choice, of a path its last part."""
    return Path(choice).name if Path(choice).exists() else choice


def _kind(choice: str) -> str:
    """Kind of a choice: "planner", or as `wt_gym.agents.choices.kind_of` says."""
    if choice.partition(":")[0] == "planner":
        return "planner"
    return kind_of(choice, ("zero", "random"), ("planner", *WORDS))


def _entry(name: str, choice: str) -> Entry:
    """Entry of a choice."""
    kind = _kind(choice)
    if kind == "planner":
        parameters = controller_of(choice)[1]
        check_settings(parameters)
        return Entry(name, choice, {"kind": kind, "parameters": parameters})
    if kind == "word":
        return Entry(name, choice, {"kind": choice})
    if kind == "trained":
        return _trained(name, Path(choice))
    controller, parameters = controller_of(choice)
    definition = {"kind": kind, "controller": controller, "parameters": parameters}
    return Entry(name, choice, definition, {**_BENEATH, "controller": [controller, parameters]})


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
            name, choice = split_name(word)
            for suffix, single in expand_seeds(choice, _kind(choice)):
                entry = _entry((name or _default_name(choice)) + suffix, single)
                if entries.setdefault(entry.name, entry) != entry:
                    raise ValueError(f"two agents are called {entry.name!r}; give them names as NAME=CHOICE")
    return list(entries.values())


def _trained(name: str, path: Path) -> Entry:
    """Entry of a trained model, in the environment it was trained in."""
    from wt_gym.agents.trained_agent import TrainedAgent, model_digests

    record = TrainedAgent.load(path).record or {}
    interface = environment_of_training(record, INTERFACE)
    definition = {"kind": "trained", "algorithm": record.get("algorithm"), "sha256": model_digests(path)}
    return Entry(name, str(path), definition, interface)
