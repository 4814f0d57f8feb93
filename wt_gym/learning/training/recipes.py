"""Recipes: the recommended training of each task, a file of options of ``wt-gym train`` for its id."""

from __future__ import annotations

from typing import TYPE_CHECKING

from wt_gym.base.errors import did_you_mean
from wt_gym.base.files import shipped_folder
from wt_gym.tasks import TASKS

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["recipe_file", "recipe_names"]

_FOLDER = shipped_folder() / "recipes"


def recipe_names() -> tuple[str, ...]:
    """Tasks that have a recipe, in the order of `wt_gym.tasks.TASKS`."""
    return tuple(name for name in TASKS if _file(name).is_file())


def recipe_file(env_id: str) -> Path:
    """File with the recipe of an environment.

    Parameters
    ----------
    env_id : str
        Id of a task.

    Returns
    -------
    pathlib.Path

    Raises
    ------
    ValueError
        If the id is that of no task with a recipe.
    """
    tasks = {TASKS[name].id: name for name in recipe_names()}
    if env_id not in tasks:
        raise ValueError(
            f"--recipe needs an environment that has one, got {env_id!r}; must be one of {', '.join(tasks)}"
            f"{did_you_mean(env_id, tasks)}"
        )
    return _file(tasks[env_id])


def _file(name: str) -> Path:
    return _FOLDER / f"{name}.yml"
