"""Command line of evaluations: options that several of them share. Imports nothing heavy, for --help."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import argparse

__all__ = ["add_climate_options", "add_other_environment_option"]


def add_other_environment_option(parser: argparse.ArgumentParser) -> None:
    """Add whether trained models may run where they were not trained."""
    parser.add_argument(
        "--allow-other-environment", action="store_true", help="take trained models into other noise, action spans or "
        "base controllers than those of their training",
    )  # fmt: skip


def add_climate_options(parser: argparse.ArgumentParser) -> None:
    """Add the wind climate that weighs loads over a life."""
    climate = parser.add_argument_group("wind climate, for loads over a life")
    one = climate.add_mutually_exclusive_group()
    one.add_argument("--iec-class", choices=("I", "II", "III"), help="class of IEC 61400-1 (default: the turbine's)")
    one.add_argument("--mean-wind-speed", type=float, metavar="M_S", help="annual mean in place of the class's [m/s]")
    climate.add_argument(
        "--weibull-shape", type=float, default=2.0, metavar="K", help="Weibull exponent (default: %(default)s)"
    )
