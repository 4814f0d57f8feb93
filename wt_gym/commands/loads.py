"""Loads of runs of OpenFAST, from the outputs that its driver writes, side by side.

    wt-gym loads flight/model.out
    wt-gym loads baseline/model.out flight/model.out --skip 60

The files are those of models that wt-gym export --to openfast writes, with the turbine in turbine.json beside them, or
have the same outputs, with the turbine named by --turbine. With several, changes are against the first. DELs are those
of wt-gym evaluate.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from wt_gym.commands.options import add_shared

if TYPE_CHECKING:
    from wt_gym.turbines import Turbine

SHOWN = (
    "mean_power", "rotor_speed_max", "blade_flap_del", "blade_edge_del", "tower_fore_aft_del", "tower_side_side_del",
    "pitch_travel",
)  # fmt: skip
"""Metrics of the table."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("outputs", nargs="+", metavar="FILE", help="text files of outputs (.out)")
    turbine_help = "that was simulated (default: turbine.json beside each file)"
    add_shared(parser, "turbine", "skip", "json", turbine={"default": None, "help": turbine_help}, skip=20.0)


def run(arguments: argparse.Namespace) -> dict[str, dict[str, float]]:
    """Read and print."""
    from wt_gym.analysis.metrics import run_metrics
    from wt_gym.bridges.openfast import read_outputs

    metrics = {}
    for path in arguments.outputs:
        turbine = _turbine_of(path, arguments.turbine)
        metrics[path] = run_metrics(read_outputs(path, turbine), turbine, arguments.skip)
    print(table(metrics, arguments.outputs[0]))
    return metrics


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
    """Metrics of runs by their names, as paths of files, below each other, with the changes against the baseline."""
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
