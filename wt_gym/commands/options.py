"""Options that several commands share, and what follows from them. Imports nothing heavy, for --help."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wt_gym.base.errors import did_you_mean
from wt_gym.base.files import read_toml
from wt_gym.base.options import Options, add_options, chosen_options, named_value, options_of
from wt_gym.commands.program import FIDELITIES_HELP, folder_path, json_value
from wt_gym.tasks import DEFAULT_ENV

if TYPE_CHECKING:
    from wt_gym.deployment.export.openfast_flight import Scene
    from wt_gym.experiment.evaluation import EvaluationConfig
    from wt_gym.experiment.execute import Executor
    from wt_gym.experiment.options import ClimateOptions
    from wt_gym.turbines import Turbine

OWN_SIMULATOR = "wt_gym"
"""Name of the simulator of this package, the default of ``--simulator``."""


def wind_word(word: str) -> Any:
    """Read a word, as a wind or a simulator: a name or path, or a mapping as JSON."""
    return json_value(word) if word.lstrip().startswith("{") else word


_TYPES = {
    "float": float, "int": int, "json": json_value, "named_value": named_value, "wind_word": wind_word,
    "folder": folder_path,
}  # fmt: skip


def _read_shared() -> dict[str, dict[str, Any]]:
    """Settings of ``add_argument`` by the name of the option."""
    shared = read_toml(Path(__file__).with_suffix(".toml"))
    for settings in shared.values():
        if "type" in settings:
            settings["type"] = _TYPES[settings["type"]]
    shared["fidelity"]["help"] = FIDELITIES_HELP
    shared["env"]["default"], shared["simulator"]["default"] = DEFAULT_ENV, OWN_SIMULATOR
    return shared


_SHARED = _read_shared()
WORKERS = ("jobs", "engine", "address")
"""Options of who does the jobs of a sweep, and how many at a time."""
MODELS = ("algo", "trust")
"""Options about models of stable-baselines3 that were trained elsewhere."""


def add_shared(parser: argparse._ActionsContainer, *names: str, **changes: Any) -> None:
    """Add shared options by name.

    Parameters
    ----------
    **changes
        By name of the option: settings of ``add_argument`` in place of the shared ones, or another default alone.
    """
    for name in (*names, *(name for name in changes if name not in names)):
        change = changes.get(name, {})
        settings = change if isinstance(change, dict) else {"default": change}
        parser.add_argument(f"--{name.replace('_', '-')}", **(_SHARED[name] | settings))


def add_climate(parser: argparse.ArgumentParser) -> None:
    """Add the wind climate that weighs loads over a life."""
    from wt_gym.experiment.options import ClimateOptions

    climate = parser.add_argument_group("wind climate, for loads over a life")
    add_options(climate.add_mutually_exclusive_group(), ClimateOptions, "iec_class", "mean_wind_speed")
    add_options(climate, ClimateOptions, "weibull_shape")


def with_record(arguments: argparse.Namespace, record: type[Options]) -> None:
    """Check the options of a record, and give the arguments its fields."""
    made = record(**chosen_options(arguments, record))
    vars(arguments).update({one.name: getattr(made, one.name) for one in options_of(record)})


def climate_of(arguments: argparse.Namespace) -> ClimateOptions:
    """Wind climate of the options."""
    from wt_gym.experiment.options import ClimateOptions

    return ClimateOptions(**chosen_options(arguments, ClimateOptions))


def evaluation_of(arguments: argparse.Namespace, kwargs: dict[str, Any], **fields: Any) -> EvaluationConfig:
    """Evaluation in the winds of the options, in the environment of ``--env`` with these arguments and more fields."""
    from wt_gym.experiment.evaluation import EvaluationConfig, winds_for

    draws = getattr(arguments, "draws", None)
    winds = winds_for(arguments.env, kwargs, arguments.wind_speed, arguments.wind_seeds, draws, arguments.duration)
    return EvaluationConfig(
        env_id=arguments.env, env_kwargs=kwargs, winds=winds, duration=arguments.duration, skip=arguments.skip, **fields
    )


def turbine_of(arguments: argparse.Namespace) -> Turbine:
    """Turbine of ``--turbine`` at ``--site``; where no fidelity was chosen, the arguments get the one that suits it."""
    from wt_gym.simulation.fidelity import suited_fidelity
    from wt_gym.turbines import load_turbine
    from wt_gym.turbines.model import with_site

    turbine = with_site(load_turbine(arguments.turbine), dict(arguments.site or ()))
    arguments.fidelity = arguments.fidelity or suited_fidelity(turbine)
    return turbine


def executor_of(arguments: argparse.Namespace) -> Executor:
    """Executor of `WORKERS`, see `wt_gym.experiment.execute.executor_for`."""
    from wt_gym.experiment.execute import executor_for

    return executor_for(arguments.engine, arguments.jobs, arguments.address)


def agents_of(
    arguments: argparse.Namespace, words: Sequence[str], env_id: str | None = None, kwargs: Any = None
) -> dict[str, str]:
    """Agents by the names that are shown, of the words typed and the options `MODELS`.

    "baseline" stands for the own controller of an environment, where one is given with its arguments.
    """
    from wt_gym.experiment.names import named_choices, own_controller, with_model_options

    given = with_model_options(words, arguments.algo, arguments.trust)
    return named_choices(given, own_controller(env_id, kwargs)) if env_id is not None else named_choices(given)


def environment_of(
    arguments: argparse.Namespace, simulator: str | dict[str, Any] | None = None, **first: Any
) -> dict[str, Any]:
    """Arguments of the environment of ``--env-kwargs``, ``--site``, ``--wind``, ``--simulator`` and ``--fidelity``.

    Where two of them name the same argument, the option of its own counts. ``simulator`` stands for that of the
    options (`wt_gym.envs.operation.simulator_maker`); ``first`` are arguments that ``--env-kwargs`` replaces. Raises a
    `ValueError` if ``--env-kwargs`` is no mapping, and as `check_environment`.
    """
    from wt_gym.envs.options import flat_arguments

    given = vars(arguments)
    kwargs = given.get("env_kwargs", {})
    if not isinstance(kwargs, dict):
        raise ValueError(f"the arguments of the environment must be a JSON object, got {kwargs!r}")
    kwargs = first | kwargs
    if given.get("site"):
        site = kwargs.get("site") or {}
        if not isinstance(site, dict):
            raise ValueError(f"site must be a JSON object, got {site!r}")
        kwargs["site"] = site | dict(given["site"])
    if wind := given.get("wind"):
        kwargs["inflow"] = list(wind) if len(wind) > 1 else wind[0]
    simulator = simulator or given.get("simulator", OWN_SIMULATOR)
    if simulator != OWN_SIMULATOR:
        kwargs["simulator"] = simulator
    if given.get("env") is not None:
        check_environment(given["env"], kwargs)
    return flat_arguments(kwargs) | ({"fidelity": given["fidelity"]} if given.get("fidelity") else {})


def check_environment(env_id: str, kwargs: dict[str, Any]) -> None:
    """Refuse an environment that is not one of this package, and arguments that it does not take.

    Raises a `ValueError`, and a `gymnasium.error.Error` if there is no such environment.
    """
    import gymnasium as gym

    from wt_gym.envs.options import env_arguments, registered_arguments
    from wt_gym.envs.turbine_env import WindTurbineEnv

    entry_point = f"{WindTurbineEnv.__module__}:{WindTurbineEnv.__name__}"
    if gym.spec(env_id).entry_point != entry_point:
        known = sorted(name for name, entry in gym.registry.items() if entry.entry_point == entry_point)
        raise ValueError(
            f"the environment must be one of {', '.join(known)}, got {env_id!r}{did_you_mean(env_id, known)}"
        )
    arguments = env_arguments()
    for name in kwargs:
        if name not in arguments:
            raise ValueError(
                f"the environment has no argument {name!r}{did_you_mean(name, arguments, '.')} Its arguments are "
                f"{', '.join(arguments)}"
            )
    registered_arguments(env_id, kwargs)


def add_scene(parser: argparse._ActionsContainer, duration: float) -> None:
    """Add the options of turbine and wind of a flight, with the length by default [s]."""
    add_shared(
        parser, "wind_speed", "wind_seeds", "duration", "env_kwargs", duration=duration,
        wind_speed={"nargs": None, "help": "mean wind speed [m/s] (default: drawn)"},
        wind_seeds={"nargs": None, "help": "turbulence seed (default: drawn)"},
        env_kwargs={"help": 'other arguments of the environment: \'{"inflow": "steady", "wind_speed": 12}\''},
    )  # fmt: skip


def scene_of(arguments: argparse.Namespace) -> Scene:
    """Turbine and wind of the options of `add_scene`, see `wt_gym.deployment.export.openfast_flight.scene_of`."""
    from wt_gym.deployment.export import openfast_flight

    if not arguments.duration > 0.0:
        raise ValueError(f"--duration must be above 0 s, got {arguments.duration:g}")
    return openfast_flight.scene_of(
        arguments.agent, turbine=arguments.turbine, env_kwargs=arguments.env_kwargs, wind_speed=arguments.wind_speed,
        wind_seed=arguments.wind_seeds, duration=arguments.duration,
    )  # fmt: skip
