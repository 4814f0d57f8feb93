#!/usr/bin/env python3
"""Drawn policies, winds, turbines and arguments against the environment's contract and the balance of energy.

    scripts/fuzz.py                                    # 10 000 steps
    scripts/fuzz.py --steps 1000000 --out runs/fuzz.txt
    scripts/fuzz.py --case 17                          # one case again, as a finding names it
    scripts/fuzz.py --memory --steps 100000            # growth of the resident memory over steps and resets

Findings are written as they come, one line each, with the command that shows it again: "contract" and "exception" are
faults of the environment and end the command with status 1; "failure" is a simulation that ended with a message, as
documented, "start" one that found no steady state to begin with.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import use_venv  # noqa: F401 - finds packages and interpreter

from wt_gym.base.files import require_writable
from wt_gym.commands.program import FIDELITIES_HELP, OneLineParser, stoppable, user_errors

if TYPE_CHECKING:
    from fuzzing.run import CaseResult, Finding

TURBINES = ["nrel_5mw", "iea_15mw", "gebhardt_45m", "nada_small", "nrel_5mw_monopile", "iea_15mw_monopile"]


def parse_arguments(words: list[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = OneLineParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=10_000, help="control steps altogether (default: %(default)s)")
    parser.add_argument("--first", type=int, default=0, metavar="N", help="first case (default: %(default)s)")
    parser.add_argument("--case", type=int, metavar="N", help="this case only")
    parser.add_argument("--turbine", nargs="+", default=TURBINES, help="to draw from (default: %(default)s)")
    parser.add_argument("--fidelity", default="training", help=FIDELITIES_HELP)
    parser.add_argument("--out", type=Path, metavar="FILE", help="text file that findings are added to")
    parser.add_argument("--memory", action="store_true", help="measure memory instead")
    parser.add_argument("--json", action="store_true", help="print the counts as JSON at the end")
    arguments = parser.parse_args(words)
    for name in ("steps", "first", "case"):
        value = getattr(arguments, name)
        if value is not None and value < (name == "steps"):
            parser.error(f"--{name} {value}: a whole number of at least {int(name == 'steps')} is needed")
    return arguments


def line_of(finding: Finding, arguments: argparse.Namespace) -> str:
    """What was found, with the command that shows it again."""
    turbines = "" if arguments.turbine == TURBINES else f" --turbine {' '.join(arguments.turbine)}"
    fidelity = "" if arguments.fidelity == "training" else f" --fidelity {arguments.fidelity}"
    again = f"scripts/fuzz.py --case {finding.case.number}{turbines}{fidelity}"
    return f"{finding.kind} at step {finding.step} of {finding.case}: {finding.message} | {again}"


def run(arguments: argparse.Namespace, total: Counter, endings: Counter) -> None:
    """Run cases and count what they came to."""
    from fuzzing.cases import draw_case
    from fuzzing.run import fuzz, run_case

    with ExitStack() as stack:
        file = None
        if arguments.out is not None:
            require_writable(arguments.out.parent)
            file = stack.enter_context(arguments.out.open("a", encoding="utf-8", buffering=1))

        def note(finding: Finding) -> None:
            total[finding.kind] += 1
            line = line_of(finding, arguments)
            print(line, flush=True)
            if file is not None:
                file.write(line + "\n")

        def count(result: CaseResult) -> None:
            total.update(cases=1, steps=result.steps, episodes=result.episodes)
            endings.update(result.endings)

        if arguments.case is not None:
            case = draw_case(arguments.case, arguments.turbine, arguments.fidelity)
            print(f"{case}\n{case.arguments}")
            count(run_case(case, on_finding=note))
            return
        begin = last = time.monotonic()
        for result in fuzz(arguments.steps, arguments.turbine, arguments.first, arguments.fidelity, note):
            count(result)
            if time.monotonic() - last > 60.0:
                last = time.monotonic()
                rate = total["steps"] / (last - begin)
                print(f"{total['steps']} steps, {rate:.0f} a second, to case {result.case.number}", file=sys.stderr)


def main(words: list[str] | None = None) -> None:
    """Fuzz, or measure memory."""
    arguments = parse_arguments(words)
    total: Counter = Counter()
    endings: Counter = Counter()
    where = f" and in {arguments.out}" if arguments.out else ""
    with user_errors(), stoppable(f"what was found stands above{where}; --first goes on with a later case"):
        if arguments.memory:
            from fuzzing.memory import measure_memory

            record = measure_memory(arguments.steps)
            print(
                f"{arguments.steps} steps, {record.resets} resets: {record.resident[record.warm]:.1f} MiB after "
                f"{record.steps[record.warm]} steps, {record.resident[-1]:.1f} MiB at the end, at most "
                f"{max(record.resident):.1f}; {record.growth:+.2f} KiB per 1000 steps"
            )
            if arguments.json:
                print(json.dumps({"steps": record.steps, "resident_mib": record.resident, "resets": record.resets}))
            return
        try:
            run(arguments, total, endings)
        finally:  # of a stopped series too
            ends = ", ".join(f"{name} {number}" for name, number in endings.most_common()) or "none"
            kinds = ", ".join(f"{total[kind]} {kind}" for kind in ("contract", "exception", "failure", "start"))
            print(
                f"{total['steps']} steps, {total['cases']} cases, {total['episodes']} episodes (ends: {ends}): {kinds}"
            )
    if arguments.json:
        print(json.dumps(dict(total) | {"endings": dict(endings)}))
    if total["contract"] + total["exception"]:
        sys.exit(1)


if __name__ == "__main__":
    main()
