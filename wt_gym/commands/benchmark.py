"""The benchmark: agents in frozen tasks, their scores, and the reference numbers.

    wt-gym benchmark tasks
    wt-gym benchmark run baselines runs/ppo --task load-reduction-15 --out runs/benchmark --jobs 2
    wt-gym benchmark table runs/benchmark
    wt-gym benchmark archive runs/benchmark --models runs/ppo --out entry.tar.xz
    wt-gym benchmark verify entry.tar.xz --jobs 2       # repeats six of its runs
    wt-gym benchmark reference --task all --jobs 2      # after a change of the physics

An agent is zero, random, a controller with parameters behind a colon (constrained_ipc:level=0.1), a class of your own
(file.py:Class), planner, the path of a trained model, or baselines, which stands for twelve of them (with rosco, where
its package is installed); NAME=AGENT names it. Every run is kept when it is done: who stops a command and starts it
again loses no finished run. docs/benchmark.md has the rules.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wt_gym.commands.options import MODELS, WORKERS, add_shared, executor_of
from wt_gym.commands.program import CLONE, IN_CLONE, UNSAFE, OneLineParser, file_ending_in

if TYPE_CHECKING:
    from wt_gym.experiment.benchmark_tasks import BenchmarkTask

KEPT = "runs/benchmark"
EPILOG = UNSAFE
STOPPED = "the same command resumes with the runs that are kept"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    commands = parser.add_subparsers(dest="command", required=True, parser_class=OneLineParser)
    commands.add_parser("tasks", description="List the tasks.")
    run = commands.add_parser("run", description="Run agents in tasks.", epilog=UNSAFE)
    run.add_argument("agents", nargs="+", metavar="AGENT")
    table = commands.add_parser("table", description="Scores of a folder of results: leaderboard.md and .json in it.")
    table.add_argument("folder", type=Path, metavar="DIR")
    table.add_argument("--page", type=file_ending_in(".md"), metavar="FILE", help="put the table into this page too")
    archive = commands.add_parser("archive", description="Put results and the models that made them into one file.")
    archive.add_argument("folder", type=Path, metavar="DIR")
    archive.add_argument(
        "--models", nargs="+", type=Path, default=[], metavar="PATH", help="trained models that made runs of the folder"
    )
    archive.add_argument(
        "--out", type=file_ending_in(".tar.xz"), default=Path("benchmark.tar.xz"), metavar="FILE", help="%(default)s"
    )
    verify = commands.add_parser(
        "verify",
        description="Repeat some runs of an archive or a folder of results and compare every metric with the recorded "
        "one; the exit status is 1 where one differs.",
        epilog=UNSAFE,
    )
    verify.add_argument("source", type=Path, metavar="FILE_OR_DIR")
    verify.add_argument("--sample", type=int, default=6, metavar="N", help="runs; 0: all (default: %(default)s)")
    verify.add_argument("--seed", type=int, default=0, metavar="N", help="of the draw (default: %(default)s)")
    verify.add_argument(
        "--agents", nargs="+", default=[], metavar="NAME=AGENT", help="agents that are not in the archive"
    )
    add_shared(verify, *WORKERS)
    reference = commands.add_parser("reference", description="Renew the reference numbers in the files of tasks.")
    for command in (run, reference):
        command.add_argument(
            "--task", nargs="+", default=["all"], metavar="NAME", help="tasks, or the beginning of their names, or all"
        )
        add_shared(command, "out", *WORKERS, out={"type": Path, "default": Path(KEPT)})
    add_shared(run, *MODELS)
    for command in (table, run, reference, archive, verify):
        add_shared(command, "json")


def chosen(names: list[str]) -> list[BenchmarkTask]:
    """Tasks of the words of the command line."""
    from wt_gym.experiment.benchmark_tasks import load_task, task_names

    known, found = task_names(), list[str]()
    for name in names:
        exact = (name,) if name in known else tuple(task for task in known if name == "all" or task.startswith(name))
        found += exact or (name,)  # which is refused
    return [load_task(name) for name in dict.fromkeys(found)]


def tasks(_: argparse.Namespace) -> None:
    """List the tasks."""
    for task in chosen(["all"]):
        known = f"100: {task.reference['best_agent']}" if task.reference else "no reference numbers yet"
        print(f"{task.id}: {task.goal} {len(task.winds)} winds of {task.duration:g} s; {known}")


def warnings_of_scores(tasks: list[BenchmarkTask]) -> list[str]:
    """Lines on tasks in which what is run now can have no score: their reference numbers do not fit the sources."""
    from wt_gym.base.canary import differing
    from wt_gym.base.errors import BenchmarkError
    from wt_gym.experiment.benchmark import task_fingerprint
    from wt_gym.experiment.benchmark_tasks import reference_of

    lines: list[str] = []
    others: dict[str, list[str]] = {}
    for task in tasks:
        try:
            known = reference_of(task)
        except BenchmarkError as error:
            lines.append(str(error))
            continue
        if parts := differing(known.fingerprint, task_fingerprint(task)):
            others.setdefault(", ".join(parts), []).append(task.name)
    where = "" if IN_CLONE else "in a clone of the project "
    renew = f"{where}wt-gym benchmark reference"
    return lines + [
        f"runs of {', '.join(names)} will have no score: the reference numbers were made with another {parts}; {renew} "
        f"--task {' '.join(names)} makes them again"
        for parts, names in others.items()
    ]


def idle_lines(results: Iterable[dict[str, Any]]) -> list[str]:
    """Sentences on agents under which the turbine made no power without a reason."""
    from wt_gym.analysis.metrics import idle_sentence

    spells: dict[str, list[tuple[str, float]]] = {}
    for result in results:
        definition = result["definition"]
        seed = definition["wind"].get("seed")
        wind = f"{definition['wind']['speed']:g} m/s" + ("" if seed is None else f", seed {seed}")
        spell = f"{wind} of {definition['task']}", result.get("idle_time", 0.0)
        spells.setdefault(result["agent"], []).append(spell)
    return [line for agent, times in spells.items() if (line := idle_sentence(agent, times)) is not None]


def run_agents(arguments: argparse.Namespace) -> dict[str, Any]:
    """Run agents."""
    from wt_gym.experiment.benchmark import ResultFolder, entries_of, jobs_of, run_jobs
    from wt_gym.experiment.names import with_model_options

    tasks = chosen(arguments.task)
    jobs = jobs_of(tasks, entries_of(with_model_options(arguments.agents, arguments.algo, arguments.trust)))
    for line in warnings_of_scores(tasks):
        print(f"warning: {line}", file=sys.stderr, flush=True)
    folder = ResultFolder(arguments.out)
    with executor_of(arguments) as executor:
        made = run_jobs(jobs, folder, executor)
    print(f"{made} runs made, {len(jobs) - made} were there")
    print("".join(f"{line}\n" for line in idle_lines(folder.read(job.definition) for job in jobs)), end="")
    print(f"scores: wt-gym benchmark table {arguments.out}")
    return {"runs": len(jobs), "made": made, "folder": str(arguments.out)}


def table(arguments: argparse.Namespace) -> dict[str, Any]:
    """Score a folder."""
    from wt_gym.base.errors import BenchmarkError
    from wt_gym.base.files import write_text_whole
    from wt_gym.experiment.benchmark import ResultFolder, into_page, leaderboard, to_markdown

    results = list(ResultFolder(arguments.folder))
    if not results:
        raise BenchmarkError(f"{arguments.folder} holds no results; wt-gym benchmark run makes them")
    board = leaderboard(results)
    text = to_markdown(board)
    write_text_whole(arguments.folder / "leaderboard.md", text)
    write_text_whole(arguments.folder / "leaderboard.json", json.dumps(board, indent=1) + "\n")
    if arguments.page is not None:
        write_text_whole(arguments.page, into_page(text, arguments.page.read_text(encoding="utf-8")))
    print("\n".join([text, *idle_lines(results)]))
    return board


def archive(arguments: argparse.Namespace) -> dict[str, Any]:
    """Pack a folder."""
    from wt_gym.experiment.benchmark import ResultFolder
    from wt_gym.experiment.benchmark_archive import pack

    found = pack(ResultFolder(arguments.folder), arguments.models, arguments.out)
    print(f"{arguments.out}: {found['runs']} runs, {found['models']} models, {found['bytes'] / 1e3:.0f} kB")
    if found["missing"]:
        print(f"warning: without the models of {', '.join(found['missing'])}: name them with --models", file=sys.stderr)
    return found


def verify(arguments: argparse.Namespace) -> dict[str, Any]:
    """Repeat runs of others."""
    from wt_gym.experiment.benchmark_archive import opened
    from wt_gym.experiment.benchmark_archive import verify as repeat

    if arguments.sample < 0:
        raise ValueError(f"--sample must be at least 0, got {arguments.sample}")
    with opened(arguments.source) as (folder, models), executor_of(arguments) as executor:
        made = repeat(folder, models, arguments.agents, arguments.sample or None, arguments.seed, executor)
    for one in made:
        sources = f" (recorded with another {', '.join(one.other)})" if one.other else ""
        print(f"{'same' if one.same else 'DIFFERS'}: {one.label}: at most {one.deviation:.1e} in {one.metric}{sources}")
    wrong = [one.label for one in made if not one.same]
    print(f"{len(made) - len(wrong)} of {len(made)} repeated runs have the recorded metrics")
    arguments.status = 1 if wrong else 0
    return {"repeated": len(made), "different": wrong}


def reference(arguments: argparse.Namespace) -> dict[str, Any]:
    """Renew reference numbers."""
    from wt_gym.base.errors import BenchmarkError
    from wt_gym.experiment.benchmark import ResultFolder, entries_of, jobs_of, run_jobs
    from wt_gym.experiment.benchmark_tasks import make_reference, write_reference

    if not IN_CLONE:
        raise BenchmarkError(
            "reference numbers stand in the files of the package: a clone of the project makes them, not what is "
            f"installed in {CLONE}"
        )
    best, folder, jobs = {}, ResultFolder(arguments.out), {}
    for task in chosen(arguments.task):
        jobs[task.name] = jobs_of([task], entries_of([task.baseline, *task.measures]))
    with executor_of(arguments) as executor:
        run_jobs([job for of_task in jobs.values() for job in of_task], folder, executor)
    for of_task in jobs.values():
        task = of_task[0].task
        found: dict[str, dict[str, Any]] = {}
        for job in of_task:
            found.setdefault(job.entry.name, {})[job.wind.label] = folder.read(job.definition)
        made = make_reference(task, found.pop(of_task[0].entry.name), found)
        path = write_reference(task, made)
        best[task.name] = made.improvements
        print(f"{task.id}: 100 is {made.best_agent}, an improvement of {100 * made.best_improvement:.2f} % ({path})")
    return best


_COMMANDS = {
    "tasks": tasks, "run": run_agents, "table": table, "archive": archive, "verify": verify, "reference": reference,
}  # fmt: skip


def run(arguments: argparse.Namespace) -> dict[str, Any] | None:
    """Do what the second word says."""
    return _COMMANDS[arguments.command](arguments)
