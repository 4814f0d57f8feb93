"""What the scripts share: environments by name and errors of the user in one line."""

from __future__ import annotations

import inspect
import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import gymnasium as gym

import wt_gym  # noqa: F401 - registers the environments
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.errors import WtGymError

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["environment_arguments", "user_errors"]

_ENTRY_POINT = f"{WindTurbineEnv.__module__}:{WindTurbineEnv.__name__}"


def environment_arguments(env_id: str, kwargs: dict[str, Any]) -> dict[str, Any]:
    """Arguments that an environment is made with: those it is registered with, replaced by the given ones.

    Parameters
    ----------
    env_id : str
    kwargs : dict

    Returns
    -------
    dict

    Raises
    ------
    ValueError
        If the environment is none of this package, or takes no such argument.
    gymnasium.error.Error
        If there is no such environment.
    """
    spec = gym.spec(env_id)
    if spec.entry_point != _ENTRY_POINT:
        known = sorted(name for name, entry in gym.registry.items() if entry.entry_point == _ENTRY_POINT)
        raise ValueError(f"the environment must be one of {', '.join(known)}, got {env_id!r}")
    if not isinstance(kwargs, dict):
        raise ValueError(f"the arguments of the environment must be a JSON object, got {kwargs!r}")
    unknown = [name for name in kwargs if name not in inspect.signature(WindTurbineEnv).parameters]
    if unknown:
        raise ValueError(f"the environment has no arguments {unknown}")
    return {**spec.kwargs, **kwargs}


@contextmanager
def user_errors() -> Iterator[None]:
    """End the program with one line and status 1 where what the user asked for is refused."""
    try:
        yield
    except (WtGymError, ValueError, OSError, gym.error.Error) as error:
        sys.exit(f"error: {' '.join(str(error).split())}")
