"""Command line of training and search: options into a configuration. Imports nothing heavy, for --help."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from wt_gym.commands.program import FIDELITIES_HELP, json_value
from wt_gym.commands.site_options import add_site_option, add_wind_option, with_options
from wt_gym.tasks import DEFAULT_ENV

if TYPE_CHECKING:
    from wt_gym.learning.training.config import TrainingConfig

__all__ = ["add_training_options", "config_from"]


def add_training_options(parser: argparse.ArgumentParser) -> None:
    """Add what a configuration is made of. Options that are not given stay out of the result."""
    options = parser.add_argument_group("what to train on", argument_default=argparse.SUPPRESS)
    options.add_argument("--env", help=f"environment id (default: {DEFAULT_ENV})")
    options.add_argument(
        "--wind-speed", type=float, nargs="+", metavar="M_S", help="mean wind speed, or the range to draw it from [m/s]"
    )
    options.add_argument("--episode-length", type=float, metavar="S", help="length of an episode [s]")
    options.add_argument("--fidelity", help=FIDELITIES_HELP)
    options.add_argument(
        "--env-kwargs", type=json_value, metavar="JSON",
        help='more arguments of the environment, e.g. \'{"pitch": "individual"}\'',
    )  # fmt: skip
    add_site_option(options)
    add_wind_option(options)
    options.add_argument("--n-envs", type=int, metavar="N", help="environments in parallel (default: 8)")
    options = parser.add_argument_group("how", argument_default=argparse.SUPPRESS)
    options.add_argument("--algo", type=str.upper, help="PPO, SAC or TQC (default: PPO)")
    options.add_argument(
        "--hyperparameters", metavar="FILE", help="YAML file on top of those in agents/hyperparameters"
    )
    options.add_argument(
        "--hyper", nargs="+", action="extend", metavar="NAME=VALUE", help="single hyperparameters, on top of all files"
    )
    options.add_argument("--eval-every", type=int, metavar="STEPS", help="steps between evaluations against the "
        "baseline controller in other winds; 0: none (default: 20000)")  # fmt: skip
    options.add_argument("--eval-winds", type=int, metavar="N", help="number of these winds (default: 2)")
    options.add_argument("--eval-seconds", type=float, metavar="S", help="length of each [s] (default: 60)")


def config_from(arguments: argparse.Namespace, **more: Any) -> TrainingConfig:
    """Configuration of the options that were given.

    Parameters
    ----------
    arguments : argparse.Namespace
    **more
        Further fields of the configuration.

    Raises
    ------
    FileNotFoundError, ValueError, gymnasium.error.Error
        If something is refused.
    """
    from wt_gym.commands.environment_options import environment_arguments
    from wt_gym.learning.training.config import TrainingConfig
    from wt_gym.learning.training.hyperparameters import hyperparameters_for, parse_override

    given = vars(arguments)
    env_id, algorithm = given.get("env", TrainingConfig.env_id), given.get("algo", TrainingConfig.algorithm)
    kwargs = with_options(given.get("env_kwargs", {}), given.get("site"), given.get("wind"))
    environment_arguments(env_id, kwargs)  # refuses what the environment does not take
    kwargs = dict(kwargs)
    if "wind_speed" in given:
        if len(given["wind_speed"]) > 2:
            raise ValueError(f"--wind-speed must be one number or two, got {given['wind_speed']}")
        low, *high = given["wind_speed"]
        kwargs["wind_speed"] = (low, high[0]) if high else low
    kwargs |= {name: given[name] for name in ("episode_length", "fidelity") if name in given}
    overrides = dict(parse_override(text) for text in given.get("hyper", ()))
    hyperparameters = hyperparameters_for(algorithm, env_id, given.get("hyperparameters"), overrides)
    fields = {name: given[name] for name in ("n_envs", "eval_every", "eval_winds", "eval_seconds") if name in given}
    return TrainingConfig(algorithm, env_id, kwargs, hyperparameters, **fields, **more)
