"""Ids and the manual of the environment, from its registration, its docstring and its layout."""

import inspect

import gymnasium as gym
import numpy as np

import wt_gym  # noqa: F401 - registers the ids
from site_parts.markdown import first_sentence, meaning, table
from wt_gym.base.options import options_of
from wt_gym.envs import manual as manual_of_class
from wt_gym.envs import rewards as terms
from wt_gym.envs.options import GROUPS, EnvOptions, argument_default
from wt_gym.tasks import TASKS

_WIND = {
    "steady": "steady, sheared", "turbulent": "Kaimal turbulence", "gusts": "IEC gusts",
    "path": "turbulence of a mean speed that changes",
}  # fmt: skip


def ids():
    """Every registered id with its sizes."""
    rows, speeds = [], argument_default("wind_speed")
    for name in sorted(gym.registry):
        if not name.startswith("wt_gym/"):
            continue
        spec = gym.spec(name)
        modeled = spec.kwargs.get("modeled")  # by a linear model in recorded winds, which need not be made here
        env = gym.make(modeled or name).unwrapped
        given, step = gym.spec(modeled or name).kwargs, env.layout.control_dt
        low, high = np.broadcast_to(given.get("wind_speed", speeds), 2)
        length = (spec.max_episode_steps or env.length.steps) * step
        wind = f"{'recorded ' if modeled else ''}{_WIND[given['inflow']]}"
        rows.append(
            (f"`{name}`", f"`{given['turbine']}`", f"{wind}, {low:g}–{high:g}\u00a0m/s",
             f"{env.action_space.shape[0]} / {env.observation_space.shape[0]}",
             f"{length:g}\u00a0s by {step:g}\u00a0s")
        )  # fmt: skip
    headings = ("id", "turbine", "wind", "actions / observations", "episode by control step")
    goals = table(("task", "goal", "score"), [(f"`{t.id}`", t.goal, t.score) for t in TASKS.values()])
    return table(headings, rows, "options") + "\n## Goals of the tasks\n\n" + goals


def manual():
    """The class documentation, with a table of the options of each group."""
    head = manual_of_class.HEAD.replace("``docs/rewards.md``", "[Rewards](../rewards.md)")
    parts = [head, "## Arguments\n", manual_of_class.ARGUMENTS, _options(EnvOptions, "argument")]
    for title, group in GROUPS.items():
        about = first_sentence(group)
        parts.append(f"\n### `{title}`: `{group.__name__}`\n\n{about}\n\n{_options(group, 'also as')}")
    return "\n".join([*parts, f"\n## Notes\n\n{manual_of_class.NOTES}\n"])


def _options(group, flat):
    """Table of the options of a group, from what its fields say."""
    rows = [
        (f"`{one.name}`", f"`{one.flat}`", one.kind, f"`{one.default_text}`", *meaning(one))
        for one in options_of(group)
    ]
    return table(("option", flat, "type", "default", "unit", "allowed", "meaning"), rows, "options")


def observation(name):
    """What an id observes."""
    layout, numbers = gym.make(name).unwrapped.layout.observation, ("offset", "scale", "min", "max")
    rows = [
        (f"`{row['name']}`", k, row["unit"], *(f"{row[name]:.4g}" for name in numbers), row["description"])
        for k, row in enumerate(layout.table())
    ]
    return table(("channel", "index", "unit", *numbers, "what"), rows, "channels")


def action(name):
    """What the actions of an id mean."""
    rows = gym.make(name).unwrapped.layout.action.table()
    headings = list(rows[0])
    cells = [[f"{v:.4g}" if isinstance(v, float) else v for v in row.values()] for row in rows]
    return table([heading.replace("_", " ") for heading in headings], cells)


def rewards():
    """Named terms with their default weights."""
    weights = terms.DEFAULT_WEIGHTS
    made = sorted(terms.compose(dict.fromkeys(weights, 1.0)), key=lambda term: -weights[term.name])
    rows = [(f"`{t.name}`", f"`{type(t).__name__}`", f"{weights[t.name]:g}", _sentence(t)) for t in made]
    return table(("name", "class", "weight", "what it is"), rows, "options")


def _sentence(term):
    return " ".join(inspect.getdoc(type(term)).split("\n\n")[0].split()).replace("``", "`")
