"""Environments as they are named on a command line."""

from __future__ import annotations

from typing import Any

import gymnasium as gym

import wt_gym  # noqa: F401 - registers the environments
from wt_gym.base.errors import did_you_mean
from wt_gym.envs.options import env_arguments, flat_arguments, registered_arguments
from wt_gym.envs.turbine_env import WindTurbineEnv

__all__ = ["chosen_arguments", "environment_arguments"]

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
        If the environment is not one of this package, or takes no such argument.
    gymnasium.error.Error
        If there is no such environment.
    """
    spec = gym.spec(env_id)
    if spec.entry_point != _ENTRY_POINT:
        known = sorted(name for name, entry in gym.registry.items() if entry.entry_point == _ENTRY_POINT)
        raise ValueError(
            f"the environment must be one of {', '.join(known)}, got {env_id!r}{did_you_mean(env_id, known)}"
        )
    if not isinstance(kwargs, dict):
        raise ValueError(f"the arguments of the environment must be a JSON object, got {kwargs!r}")
    arguments = env_arguments()
    for name in kwargs:
        if name not in arguments:
            raise ValueError(
                f"the environment has no argument {name!r}{did_you_mean(name, arguments, '.')} Its arguments are "
                f"{', '.join(arguments)}"
            )
    return registered_arguments(env_id, kwargs)


def chosen_arguments(env_id: str, kwargs: dict[str, Any], fidelity: str | None) -> dict[str, Any]:
    """Arguments of the options ``--env-kwargs`` and ``--fidelity`` together; the latter counts where both name one.

    Parameters
    ----------
    env_id : str
    kwargs : dict
    fidelity : str or None

    Raises
    ------
    ValueError, gymnasium.error.Error
        As `environment_arguments`.
    """
    environment_arguments(env_id, kwargs)
    return flat_arguments(kwargs) | ({"fidelity": fidelity} if fidelity else {})
