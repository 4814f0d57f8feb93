"""Tasks: environments as people train on them, each with its wind, its action and its score, a table of ``tasks.toml``.

Importing this module loads nothing heavy; `wt_gym` registers the tasks under ``wt_gym/<name>-v<version>``. Any argument
of `wt_gym.envs.turbine_env.WindTurbineEnv` can be given to ``gymnasium.make`` on top.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wt_gym.base.files import read_toml
from wt_gym.turbine_records import RECORDS

__all__ = ["DEFAULT_ENV", "TASKS", "Task", "task_of"]


@dataclass(frozen=True)
class Task:
    """One task.

    Attributes
    ----------
    name : str
    version : int
        ``wt_gym/<name>-v<version>`` is the id (``docs/versions.md``).
    goal : str
        What is to be done, in one sentence.
    score : str
        What counts, as metrics of `wt_gym.analysis.metrics`, against the base controller in the same winds.
    episode : float
        Length of an episode [s]; ``max_episode_steps`` of the id.
    arguments : dict
        Arguments of the environment.
    """

    name: str
    version: int
    goal: str
    score: str
    episode: float
    arguments: dict[str, Any]

    @property
    def id(self) -> str:
        """Id of the environment."""
        return f"wt_gym/{self.name}-v{self.version}"

    @property
    def max_episode_steps(self) -> int:
        """Control steps of an episode."""
        return round(self.episode / float(self.arguments["control_dt"]))


def _value(value: Any) -> Any:
    """Value of an argument as the file says it."""
    if isinstance(value, dict):
        return dict(_item(*item) for item in value.items())
    if isinstance(value, list):
        return tuple(map(_value, value))
    return None if value == "none" else value


def _item(name: str, value: Any) -> tuple[str, Any]:
    """Name and value of an argument; an angle in degrees becomes one in radians."""
    if name.endswith("_deg"):
        return name.removesuffix("_deg"), math.radians(value)
    return name, _value(value)


def _read_tasks() -> dict[str, Task]:
    """Tasks of the file; arguments that a turbine needs take the place of those that its task shares with others."""
    tables = read_toml(Path(__file__).with_name("tasks.toml"))
    shared: dict[str, dict[str, Any]] = {}
    for name, values in tables.pop("like").items():
        shared[name] = shared.get(values.pop("like", ""), {}) | _value(values)
    tasks = {}
    for name, table in tables.items():
        arguments = _value(table.pop("arguments"))
        base = shared[arguments.pop("like")]
        turbine = RECORDS[arguments.get("turbine", base["turbine"])]
        tasks[name] = Task(name, **table, arguments=base | turbine.arguments | arguments)
    return tasks


TASKS = _read_tasks()
"""Tasks by name."""


LINEAR = ("LoadReduction", "IEA15MW-LoadReduction", "IEA22MW-LoadReduction")
"""Tasks with a linear model to learn on, ``wt_gym/<name>-Linear-v0`` (`wt_gym.learning.linear_env`)."""


def task_of(env_id: str) -> Task | None:
    """Task with an id; None where there is none."""
    return next((task for task in TASKS.values() if task.id == env_id), None)


DEFAULT_ENV = TASKS["LoadReduction"].id
"""Environment of commands that are not told another one."""
