#!/usr/bin/env python3
"""Compare the simulator with exact, published and independently computed numbers.

    python scripts/validate.py list
    python scripts/validate.py run southwell spin-up
    python scripts/validate.py run all --report report/
    python scripts/validate.py run all --fast --json
    python scripts/validate.py run all --record docs/data/validation.json     # the tables of the documentation

Prints, per case, the quantity, the expected and the obtained value, the error, the tolerance and whether it passes. The
exit status is 1 if a check fails.
"""

import argparse
import json
import math
import sys
import traceback
from pathlib import Path

import use_venv  # noqa: F401 - finds packages and interpreter

from rich.console import Console
from rich.table import Table

from envs_tests.physics.validation import (
    CaseResult,
    Check,
    as_dict,
    load_cases,
    run_case,
    source_commit,
    update_record,
    write_report,
)


def make_parser():
    """Parser of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__.splitlines()[0], epilog="Exit status: 0 all checks pass, 1 one fails, 2 wrong usage."
    )
    commands = parser.add_subparsers(dest="command", required=True)
    listing = commands.add_parser("list", help="names and titles of all cases")
    listing.add_argument("--json", action="store_true", help="print one JSON object")
    run = commands.add_parser("run", help="run cases and compare")
    run.add_argument("cases", nargs="+", metavar="CASE", help="names of cases, or 'all'")
    run.add_argument("--fast", action="store_true", help="leave out the slow cases")
    run.add_argument("--report", type=Path, metavar="DIR", help="write DIR/validation.html with all numbers and plots")
    run.add_argument(
        "--record", type=Path, metavar="FILE", help="keep the numbers of these cases in a JSON file, case by case"
    )
    run.add_argument("--json", action="store_true", help="print one JSON object last")
    return parser


def choose(parser, names, fast):
    """The cases of the given names, in alphabetical order for 'all'."""
    known = load_cases()
    unknown = [name for name in names if name != "all" and name not in known]
    if unknown:
        parser.error(f"unknown case {', '.join(unknown)}; known: {', '.join(known)}")
    chosen = list(known.values()) if "all" in names else [known[name] for name in names]
    left = [case for case in chosen if not (fast and case.slow)]
    if not left:
        parser.error(f"nothing to run: with --fast no case is left of {', '.join(names)}, which are all slow")
    return left


def run_safely(case):
    """Result of a case; one that raises an exception fails and says how, and the others still run."""
    try:
        return run_case(case)
    except Exception as error:  # whatever it is, it is shown whole and counts as a failure
        message = "".join(traceback.format_exception(error)).rstrip()
        return CaseResult([Check(f"the case runs ({type(error).__name__})", 1.0, math.nan, 0.0)], notes=message)


def open_console(to_error_stream=False):
    """Console that does not fold tables into 80 columns where the output is a file."""
    console = Console(stderr=to_error_stream)
    return console if console.is_terminal else Console(stderr=to_error_stream, width=150)


def show(console, case, result):
    """Print the table of one case."""
    table = Table(title=f"{case.name}: {case.title}", title_justify="left", title_style="bold", expand=False)
    for heading in ("quantity", "expected", "obtained", "error", "tolerance", ""):
        table.add_column(heading, justify="left" if heading == "quantity" else "right", overflow="fold")
    for check in result.checks:
        table.add_row(check.quantity, *check.cells, "[green]pass[/]" if check.passed else "[bold red]FAIL[/]")
    console.print(table)
    if result.notes:
        console.print(result.notes, style="dim", highlight=False, markup=False)
    console.print(f"source: {case.source}  ({result.wall_time:.1f} s)\n", style="dim", highlight=False, markup=False)


def main(arguments=None):
    """Run the command line; returns the exit status."""
    parser = make_parser()
    options = parser.parse_args(arguments)
    if options.command == "list":
        cases = load_cases().values()
        if options.json:
            print(json.dumps([{"name": c.name, "title": c.title, "source": c.source, "slow": c.slow} for c in cases]))
            return 0
        table = Table("name", "title", "source", "slow", box=None)
        for case in cases:
            table.add_row(case.name, case.title, case.source, "slow" if case.slow else "")
        open_console().print(table)
        return 0
    # with --json the tables go to the error stream, so that the output is one JSON object
    console = open_console(options.json)
    cases = choose(parser, options.cases, options.fast)
    commit = source_commit(options.record) if options.record else None
    results = []
    for number, case in enumerate(cases, 1):
        console.print(f"[{number}/{len(cases)}] {case.name} …", style="cyan", highlight=False, markup=False)
        results.append(run_safely(case))
        show(console, case, results[-1])
        if options.record:
            update_record(options.record, [(case, results[-1])], commit)
    failed = [case.name for case, result in zip(cases, results, strict=True) if not result.passed]
    n_checks = sum(len(result.checks) for result in results)
    n_failed = sum(not check.passed for result in results for check in result.checks)
    console.print(
        f"{len(cases)} cases, {n_checks} checks, {n_failed} failed" + (f": {', '.join(failed)}" if failed else "")
    )
    if options.report:
        console.print(f"report: {write_report(options.report, list(zip(cases, results, strict=True)))}")
    if options.json:
        both = zip(cases, results, strict=True)
        print(json.dumps({"passed": not failed, "cases": [as_dict(case, result) for case, result in both]}))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
