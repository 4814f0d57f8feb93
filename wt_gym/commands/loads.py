"""Loads of runs of OpenFAST, from the outputs that its driver writes, side by side.

    wt-gym loads flight/model.out
    wt-gym loads baseline/model.out flight/model.out --skip 60

The files are those of models that wt-gym export --to openfast writes, with the turbine in turbine.json beside them, or
have the same outputs, with the turbine named by --turbine. With several, changes are against the first. DELs are those
of wt-gym evaluate.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from wt_gym.commands.program import OneLineParser, user_errors

if TYPE_CHECKING:
    from collections.abc import Mapping

    from wt_gym.turbines import Turbine

SHOWN = (
    "mean_power", "rotor_speed_max", "blade_flap_del", "blade_edge_del", "tower_fore_aft_del", "tower_side_side_del",
    "pitch_travel",
)  # fmt: skip
"""Metrics of the table."""


def parse_arguments(words: list[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = OneLineParser("loads", description=__doc__)
    parser.add_argument("outputs", nargs="+", metavar="FILE", help="text files of outputs (.out)")
    parser.add_argument("--turbine", help="that was simulated (default: turbine.json beside each file)")
    parser.add_argument(
        "--skip", type=float, default=20.0, metavar="S", help="start left out in s (default: %(default)s)"
    )
    parser.add_argument("--json", action="store_true", help="print all metrics as JSON at the end")
    return parser.parse_args(words)


def main(words: list[str] | None = None) -> None:
    """Read and print."""
    arguments = parse_arguments(words)
    with user_errors():
        from wt_gym.analysis.metrics import run_metrics
        from wt_gym.bridges.openfast import read_outputs

        found = {}
        for path in arguments.outputs:
            turbine = _turbine_of(path, arguments.turbine)
            found[path] = run_metrics(read_outputs(path, turbine), turbine, arguments.skip)
    print(table(found, arguments.outputs[0]))
    if arguments.json:
        print(json.dumps(found))


def _turbine_of(path: str, named: str | None) -> Turbine:
    """Turbine that outputs are of: the one that is named, or that of the file beside them."""
    from wt_gym.bridges.openfast.driver import TURBINE_FILE, read_turbine
    from wt_gym.turbines import load_turbine

    if named is not None:
        return load_turbine(named)
    beside = Path(path).with_name(TURBINE_FILE)
    if not beside.is_file():
        raise ValueError(f"--turbine must name the turbine of {path}: there is no {TURBINE_FILE} beside it")
    return read_turbine(beside)


def table(metrics: Mapping[str, Mapping[str, float]], baseline: str | None) -> str:
    """Metrics of runs below each other.

    Parameters
    ----------
    metrics : mapping
        Of each run by its name, the path of a file for example.
    baseline : str, optional
        Run against which changes are shown.
    """
    from wt_gym.analysis.metrics import METRICS
    from wt_gym.analysis.page import format_difference

    names = {run: Path(run).parent.name or run if run.endswith(".out") else run for run in metrics}
    width = max(map(len, names.values()))
    lines = [f"{'':44s}" + "".join(f"  {name:>{max(width, 18)}s}" for name in names.values())]
    for key in SHOWN:
        metric, cells = METRICS[key], []
        for run, values in metrics.items():
            text = f"{metric.factor * values[key]:.{metric.digits}f}"
            if baseline is not None and run != baseline:
                text += f" ({format_difference(key, values[key], metrics[baseline][key])})"
            cells.append(f"  {text:>{max(width, 18)}s}")
        lines.append(f"{f'{metric.label} [{metric.unit}]':44s}" + "".join(cells))
    return "\n".join(lines)
