"""Command line of sweeps: options into an executor. Imports nothing heavy, for --help."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import argparse

    from wt_gym.experiment.execute import Executor

__all__ = ["add_address_options", "add_engine_options", "add_model_options", "executor_of"]


def add_address_options(parser: argparse._ActionsContainer) -> None:
    """Add where the work is done."""
    parser.add_argument(
        "--engine", choices=("local", "ray"), default="local", help="this machine's processes, or a Ray cluster (extra "
        "ray; default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--address", metavar="HOST:PORT", help="of the Ray cluster, or auto (default: RAY_ADDRESS, else a Ray of this "
        "machine alone)",
    )  # fmt: skip


def add_engine_options(parser: argparse.ArgumentParser, what: str) -> None:
    """Add who does the jobs of a sweep, and how many at a time.

    Parameters
    ----------
    parser : argparse.ArgumentParser
    what : str
        What the jobs are called.
    """
    parser.add_argument(
        "--jobs", type=int, metavar="N", help=f"{what} at a time, in processes (default: 1; with Ray all processors of "
        "the cluster)",
    )  # fmt: skip
    add_address_options(parser)


def add_model_options(parser: argparse._ActionsContainer) -> None:
    """Add what is said of stable-baselines3 models that were trained elsewhere."""
    parser.add_argument(
        "--algo", metavar="NAME", help="algorithm of models without a record of their training: PPO, A2C, SAC, TQC, "
        "TD3, DDPG or DQN (default: as the file shows; for one of several, model.zip:algo=NAME)",
    )  # fmt: skip
    parser.add_argument(
        "--trust", action="store_true", help="load models that hold more than a policy needs, with whatever code is in "
        "them",
    )  # fmt: skip


def executor_of(arguments: argparse.Namespace) -> Executor:
    """Executor of the options that `add_engine_options` has added.

    Raises
    ------
    ValueError
        As `wt_gym.experiment.execute.executor_for`.
    """
    from wt_gym.experiment.execute import executor_for

    return executor_for(arguments.engine, arguments.jobs, arguments.address)
