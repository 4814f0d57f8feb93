"""The environment that a model was trained in, and whether another one is like it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec

from wt_gym.base.files import json_values
from wt_gym.envs.layout import layout_of
from wt_gym.envs.options import argument_default, flat_arguments, registered_arguments
from wt_gym.experiment.names import read_name

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

__all__ = [
    "KEPT",
    "check_environment",
    "controller_of_training",
    "environment_of_training",
    "interface_of_training",
    "resolved_arguments",
    "trained_arguments",
    "training_arguments",
]

KEPT = (
    "action_spans", "residual_fade", "residual_washout", "residual_form", "controller", "sensor_noise", "sensor_delay",
    "sensor_washout", "sensors",
)  # fmt: skip
"""Arguments of the environment that decide on what actions and observations of the same names mean. Turbine, fidelity,
inflow and wind are not among them: to carry an agent over to others is an experiment."""
_SEEN = ("observation", "history", "sensor_washout")
_MEANT = ("pitch", "action_components", "action_spans", "residual_fade", "residual_washout", "residual_form")


def resolved_arguments(env_id: str, env_kwargs: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of an environment, registered and given ones, as a record keeps them: JSON values.

    An id may mean other arguments in a later version of the package; a record says what they were.

    Raises
    ------
    gymnasium.error.Error
        If the environment is not registered.
    """
    return json_values(registered_arguments(env_id, env_kwargs))


def trained_arguments(record: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of the environment that a model is to run in: those of its training, registered and given ones.

    Parameters
    ----------
    record : mapping
        As `wt_gym.learning.train.train` writes it.

    Returns
    -------
    dict
        Empty if the record does not say.
    """
    return dict(record.get("environment", {}))


def training_arguments(
    record: Mapping[str, Any] | None, env_kwargs: dict[str, Any], model: str | None = None
) -> dict[str, Any]:
    """Arguments of the environment that a model was trained in, which must be known.

    Parameters
    ----------
    record : mapping or None
        Of the training, see `trained_arguments`.
    env_kwargs : dict
        What a card says, where there is no record.
    model : str, optional
        Path of the model, for the message.

    Raises
    ------
    ValueError
        If neither says what the environment was.
    """
    arguments = trained_arguments(record or {}) or env_kwargs
    if not arguments:
        of = "" if model is None else f" of {model}"
        raise ValueError(
            f"the environment of the training{of} must be known, by training.json beside the model or a card "
            'MODEL.json with "env_kwargs"; got neither'
        )
    return arguments


def environment_of_training(record: Mapping[str, Any], names: Iterable[str]) -> dict[str, Any]:
    """Arguments of the environment that a model is to run in, those left to their defaults included.

    In another id than that of the training what is not named would be that id's own.

    Parameters
    ----------
    record : mapping
        As of `trained_arguments`.
    names : iterable of str
        Which arguments.

    Returns
    -------
    dict
        JSON values; empty if the record does not say.
    """
    arguments = trained_arguments(record)
    return _with_defaults(arguments, names) if arguments else {}


def controller_of_training(record: Mapping[str, Any], env: gym.Env) -> str | None:
    """Base controller by name of the training of a model, where an environment has another one.

    Under residual actions it belongs to the agent: the model without it is not what was trained.

    Parameters
    ----------
    record : mapping
        As of `trained_arguments`.
    env : gymnasium.Env
        Made by `gymnasium.make`.

    Returns
    -------
    str or None
        None where the actions have no base controller, the controllers are the same, or the record has no name for it.
    """
    if not (trained_arguments(record) and layout_of(env).action.needs_controller):
        return None
    given = flat_arguments(cast(EnvSpec, env.spec).kwargs)
    trained, here = (_kept(arguments)["controller"] for arguments in (trained_arguments(record), given))
    if not isinstance(trained, str) or (isinstance(here, str) and read_name(trained) == read_name(here)):
        return None
    return trained if trained != here and read_name(trained).kind in ("controller", "class") else None


def interface_of_training(record: Mapping[str, Any], env: gym.Env, meaning: bool = True) -> dict[str, Any]:
    """What a model saw and what its residual actions meant in its training, where an environment has it otherwise.

    Both belong to the model, as in the benchmark: it cannot read other observations, and offsets from a controller are
    nobody else's business.

    Parameters
    ----------
    record : mapping
        As of `trained_arguments`.
    env : gymnasium.Env
        Made by `gymnasium.make`.
    meaning : bool
        False: observation and history only.

    Returns
    -------
    dict
        Arguments of the environment; empty where it has the same, or the record does not say.
    """
    residual = layout_of(env).action.mode == "residual"
    names = (*_SEEN, *_MEANT) if meaning and residual else _SEEN
    trained = environment_of_training(record, names)
    here = _with_defaults(flat_arguments(cast(EnvSpec, env.spec).kwargs), names)
    return trained if trained != here else {}


def check_environment(record: Mapping[str, Any], env: gym.Env) -> None:
    """Refuse an environment in which what a model sees and does means something else than in its training.

    Parameters
    ----------
    record : mapping
        Of the training; without its environment nothing can be said, and nothing is refused.
    env : gymnasium.Env
        Made by `gymnasium.make`.

    Raises
    ------
    ValueError
        With the arguments out of `KEPT` that differ, in the training and here.
    """
    if not trained_arguments(record):
        return
    trained, here = _kept(trained_arguments(record)), _kept(flat_arguments(cast(EnvSpec, env.spec).kwargs))
    if not layout_of(env).action.needs_controller:
        del trained["controller"], here["controller"]  # the actions have no base controller
    differing = [f"{name} {trained[name]!r}, here {here[name]!r}" for name in trained if trained[name] != here[name]]
    if differing:
        raise ValueError(
            f"the model is for another environment: with {'; '.join(differing)}; give the environment the "
            "same, or ask for the other one by --allow-other-environment (allow_other_environment=True)"
        )


def _kept(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Values of `KEPT`, as a record would have them."""
    values = _with_defaults(arguments, KEPT)
    return values | {"action_spans": values["action_spans"] or {}}


def _with_defaults(arguments: Mapping[str, Any], names: Iterable[str]) -> dict[str, Any]:
    """Arguments of these names, the environment's defaults where they are not given, as JSON values."""
    values = {name: arguments.get(name, argument_default(name)) for name in names}
    return json_values(values)
