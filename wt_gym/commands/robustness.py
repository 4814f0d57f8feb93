"""Run agents on turbines, with sensors and in winds that they were not made for, and show what is left of their gain.

    wt-gym robustness ipc agents/trained/load_reduction
    wt-gym robustness runs/ppo --wind-speed 15 18 --conditions delay servo --jobs 2
    wt-gym robustness --list

Agents are those of wt-gym evaluate. In every condition each is compared with the baseline controller (--reference) and
with the controller that it acts on top of, in the same winds; the gain is that of the load-reduction tasks of the
benchmark, and "kept" is the share of the nominal gain over the base controller of an agent. Every run is kept in the
folder of the results as soon as it is done: the same command resumes. docs/howto/variation.md describes the conditions.
"""

import argparse
from pathlib import Path
from typing import Any

from wt_gym.commands.options import MODELS, WORKERS, add_shared, agents_of, environment_of, evaluation_of, executor_of
from wt_gym.commands.program import UNSAFE

EPILOG = UNSAFE
STOPPED = "the same command resumes with what is in {out}"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("agents", nargs="*", help="agents, see wt-gym evaluate")
    parser.add_argument("--list", action="store_true", help="list the conditions")
    parser.add_argument("--reference", default="discon", help="what all are compared with (default: %(default)s)")
    which = "conditions beside the nominal; faults: all with a fault (default: all without)"
    parser.add_argument("--conditions", nargs="+", metavar="NAME", help=which)
    add_shared(
        parser, "env", "env_kwargs", "fidelity", "wind_speed", "wind_seeds", "duration", "skip", "out", "overwrite",
        "allow_other_environment", *MODELS, *WORKERS, "json", wind_speed=[15.0], out="runs/robustness",
    )  # fmt: skip


def run(arguments: argparse.Namespace) -> dict[str, Any] | None:
    """Run the conditions and print the table, or list them."""
    from wt_gym.experiment.robustness import CONDITIONS, FAULT_CONDITIONS, chosen, run_robustness

    if arguments.list:
        known = CONDITIONS | FAULT_CONDITIONS
        width = max(map(len, known))
        print("\n".join(f"{one.name:{width}}  {one.text}" for one in known.values()))
        return None

    with executor_of(arguments) as executor:
        if not arguments.agents:
            raise ValueError("agents must be named, for example ipc; got none")
        conditions = chosen(arguments.conditions)
        config = evaluation_of(arguments, environment_of(arguments))
        results = run_robustness(
            agents_of(arguments, [arguments.reference, *arguments.agents]), config, conditions,
            folder=Path(arguments.out), overwrite=arguments.overwrite,
            allow_other_environment=arguments.allow_other_environment, executor=executor,
        )  # fmt: skip
    print(results.to_markdown())
    print(f"results: {arguments.out}")
    return results.to_json()
