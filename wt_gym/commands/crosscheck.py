"""Run the same agents in the same winds in two simulators, and lay their effects side by side.

    wt-gym crosscheck baseline ipc agents/trained/load_reduction --wind-speed 15 18
    wt-gym crosscheck discon ipc tuned --simulator '{"name": "openfast", "changes": {"AeroDyn": {"UA_Mod": 3}}}'

Agents are those of wt-gym evaluate; the first is the baseline, in each simulator for itself. OpenFAST takes about ten
seconds of processor time for a minute of wind and is by far the slower one: --jobs shares the runs among processes.
Every run is kept as soon as it is done, and the same command resumes where it was stopped.

The folder gets report.html, crosscheck.md with figures, crosscheck.json with its numbers, and both evaluations. Runs
start from the steady operating point.
"""

import argparse
import shlex
from pathlib import Path

from wt_gym.commands.options import (
    MODELS,
    OWN_SIMULATOR,
    WORKERS,
    add_shared,
    agents_of,
    environment_of,
    evaluation_of,
    executor_of,
)
from wt_gym.commands.program import UNSAFE

EPILOG = UNSAFE
STOPPED = "the same command without --overwrite resumes with what is in {out}"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("agents", nargs="+", help="agents; the first is the baseline")
    add_shared(
        parser, "env", "out", "overwrite", "wind_speed", "wind_seeds", "duration", "skip", "fidelity", "env_kwargs",
        "site", "simulator", "allow_other_environment", *MODELS, *WORKERS, out="runs/crosscheck", wind_speed=[15.0],
        skip=60.0, simulator="openfast",
    )  # fmt: skip


def run(arguments: argparse.Namespace) -> None:
    """Run both and write the page."""
    out, other = Path(arguments.out), arguments.simulator
    name = other["name"] if isinstance(other, dict) and "name" in other else str(other)
    if other == OWN_SIMULATOR:
        raise ValueError(f"--simulator must be another one than {OWN_SIMULATOR}, which the crosscheck runs anyway")
    from wt_gym.analysis.crosscheck import Crosscheck, tables, write_crosscheck
    from wt_gym.experiment.evaluation import evaluate

    environments = [environment_of(arguments, simulator, start="steady") for simulator in (OWN_SIMULATOR, other)]
    configs = [evaluation_of(arguments, kwargs, replay=0.0) for kwargs in environments]
    agents = agents_of(arguments, arguments.agents, configs[0].env_id, configs[0].env_kwargs)
    evaluations = []
    for config, folder in zip(configs, (OWN_SIMULATOR, name), strict=True):
        with executor_of(arguments) as executor:
            evaluations.append(
                evaluate(
                    agents, config, folder=out / folder, overwrite=arguments.overwrite,
                    allow_other_environment=arguments.allow_other_environment, executor=executor,
                )
            )  # fmt: skip
    check = Crosscheck((OWN_SIMULATOR, name), (evaluations[0], evaluations[1]))
    command = shlex.join(["wt-gym", "crosscheck", *arguments.words])
    path, report = write_crosscheck(check, out, command)
    print(tables(check.content))
    print(f"\npage: {path}\nreport: {report}")
