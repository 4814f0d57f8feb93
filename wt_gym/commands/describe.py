"""Describe an environment: observations, actions, reward, base controller; nothing is simulated.

    wt-gym describe wt_gym/LoadReduction-v3
    wt-gym describe wt_gym/Yaw-v3 --env-kwargs '{"sensor_noise": 1}' --out runs/yaw.html

An observation has its unit, the range of its sensor and its source on a real turbine.
"""

import argparse
from collections.abc import Sequence
from html import escape
from typing import Any

from wt_gym.commands.options import add_shared
from wt_gym.commands.program import file_ending_in


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("env", metavar="ENV", help="environment id")
    add_shared(parser, "env_kwargs", "json")
    parser.add_argument("--out", type=file_ending_in(".html"), metavar="FILE", help="page to write (.html)")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Print the description, or write a page of it."""
    import gymnasium as gym

    from wt_gym.envs.manual import aligned, controller_rows, describe, observation_rows, reward_rows
    from wt_gym.envs.turbine_env import turbine_env_of

    env = turbine_env_of(gym.make(arguments.env, disable_env_checker=True, **arguments.env_kwargs))
    actions = [(row["name"], row["unit"], f"{row['min']:.4g} … {row['max']:.4g}") for row in env.layout.action.table()]
    tables: dict[str, tuple[Sequence[str], Sequence[Sequence[str]]]] = {
        "actions": (("action", "unit", "at -1 and +1"), actions),
        "reward": (("term", "weight", "meaning"), reward_rows(env)),
        "base controller": (("part", "meaning"), controller_rows(env)),
    }
    print(describe(env, env.spec))
    for title, (_, rows) in tables.items():
        print("\n".join(["", title, *aligned(rows, indent=2)]) if rows else f"\n{title}\n  none")
    head = ("observation", "unit", "range", "source on a real turbine", "meaning")
    tables = {"observations": (head, observation_rows(env.layout.observation.channels)), **tables}
    if arguments.out:
        print(f"\npage: {_write(arguments.out, arguments.env, env.layout.sizes, tables)}")
    return {title: [dict(zip(head, row, strict=True)) for row in rows] for title, (head, rows) in tables.items()}


def _write(path: Any, title: str, sizes: str, tables: dict[str, Any]) -> Any:
    """Page with the tables."""
    from wt_gym.analysis.page import Row, Section, table, write_page

    sections = []
    for name, (head, rows) in tables.items():
        cells = [Row(escape(first), [escape(cell) for cell in others]) for first, *others in rows]
        content = table(head, cells, texts=range(1, len(head))) if rows else ""
        sections.append(Section(name.replace(" ", "-"), name.capitalize(), content))
    return write_page(path, title=title, result=f"{sizes[0].upper()}{sizes[1:]}.", facts={}, sections=sections)
