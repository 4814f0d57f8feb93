"""Options of the command line for the turbine and the wind of a flight. Imports nothing heavy, for --help."""

from __future__ import annotations

from typing import TYPE_CHECKING

from wt_gym.commands.program import json_value

if TYPE_CHECKING:
    import argparse

    from wt_gym.deployment.export.openfast_flight import Scene

__all__ = ["add_scene_options", "chosen_scene"]


def add_scene_options(parser: argparse._ActionsContainer, duration: float) -> None:
    """Add ``--wind-speed``, ``--wind-seeds``, ``--duration`` and ``--env-kwargs``."""
    parser.add_argument("--wind-speed", type=float, metavar="M_S", help="mean wind speed in m/s (default: drawn)")
    parser.add_argument("--wind-seeds", type=int, metavar="SEED", help="turbulence seed (default: drawn)")
    parser.add_argument("--duration", type=float, default=duration, metavar="S", help="in s (default: %(default)s)")
    parser.add_argument(
        "--env-kwargs", type=json_value, default={}, metavar="JSON",
        help="other arguments of the environment: \'{\"inflow\": \"steady\", \"wind_speed\": 12}\'",
    )  # fmt: skip


def chosen_scene(arguments: argparse.Namespace) -> Scene:
    """Turbine and wind that the options of a command name.

    Raises
    ------
    ValueError
        As of `wt_gym.deployment.export.openfast_flight.scene_of`.
    """
    from wt_gym.deployment.export.openfast_flight import scene_of

    if not arguments.duration > 0.0:
        raise ValueError(f"--duration must be above 0 s, got {arguments.duration:g}")
    return scene_of(
        arguments.agent, turbine=arguments.turbine, env_kwargs=arguments.env_kwargs, wind_speed=arguments.wind_speed,
        wind_seed=arguments.wind_seeds, duration=arguments.duration,
    )  # fmt: skip
