"""Options of the command line for site, winds from files and simulator. Imports nothing heavy, for --help."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = [
    "OWN_SIMULATOR",
    "add_simulator_option",
    "add_site_option",
    "add_wind_option",
    "site_word",
    "wind_word",
    "with_options",
]

OWN_SIMULATOR = "wt_gym"
"""Name of the simulator of this package, what ``--simulator`` is by default."""


def site_word(word: str) -> tuple[str, float | str]:
    """Read ``NAME=VALUE`` of the option ``--site``: a number, or the name of a class."""
    name, equals, value = word.partition("=")
    if not (name and equals and value):
        raise argparse.ArgumentTypeError(f"{word:.60} must be NAME=VALUE, for example air_density=1.1")
    try:
        return name, float(value)
    except ValueError:
        return name, value


def wind_word(word: str) -> str | dict[str, Any]:
    """Read a word, as a wind or a simulator: a name or path, or a mapping as JSON."""
    if not word.lstrip().startswith("{"):
        return word
    try:
        out: str | dict[str, Any] = json.loads(word)
        return out
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{word:.60} is not valid JSON: {error}") from error


def add_site_option(parser: argparse._ActionsContainer) -> None:
    """Add ``--site``."""
    parser.add_argument(
        "--site", type=site_word, nargs="+", metavar="NAME=VALUE",
        help="numbers of the site instead of those of the turbine: air_density, cut_in, cut_out, iec_class, "
        "turbulence_class, controller_air_density, rotation",
    )  # fmt: skip


def add_wind_option(parser: argparse._ActionsContainer) -> None:
    """Add ``--wind``."""
    parser.add_argument(
        "--wind", type=wind_word, nargs="+", metavar="FILE",
        help="winds from files (.bts, .csv, .wnd, .hh, .nc, .json) or as JSON, see docs/wind.md",
    )  # fmt: skip


def add_simulator_option(parser: argparse._ActionsContainer, default: str = OWN_SIMULATOR) -> None:
    """Add ``--simulator``."""
    parser.add_argument(
        "--simulator", type=wind_word, default=default, metavar="NAME",
        help="wt_gym or openfast (default: %(default)s), or JSON with options: "
        '\'{"name": "openfast", "openfast_library": "libopenfastlib.so"}\', see docs/howto/openfast.md',
    )  # fmt: skip


def with_options(
    kwargs: Mapping[str, Any],
    site: Sequence[tuple[str, float | str]] | None,
    wind: Sequence[str | dict[str, Any]] | None = None,
    simulator: str | dict[str, Any] = OWN_SIMULATOR,
) -> dict[str, Any]:
    """Arguments of an environment with a site, winds and a simulator, which count where both name one.

    Parameters
    ----------
    kwargs : mapping
    site : sequence of (str, float or str), optional
        Added to the site among ``kwargs``.
    wind : sequence, optional
    simulator : str or mapping
        See `wt_gym.envs.operation.simulator_maker`.

    Raises
    ------
    ValueError
        If ``kwargs`` is not a mapping.
    """
    if not isinstance(kwargs, dict):
        raise ValueError(f"the arguments of the environment must be a JSON object, got {kwargs!r}")
    found = dict(kwargs)
    if site:
        found["site"] = {**(found.get("site") or {}), **dict(site)}
    if wind:
        found["inflow"] = list(wind) if len(wind) > 1 else wind[0]
    if simulator != OWN_SIMULATOR:
        found["simulator"] = simulator
    return found
