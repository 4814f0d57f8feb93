#!/usr/bin/env python3
"""What controllers and shipped agents score in each task, for the pages of docs/tasks.

scripts/task_scores.py                         # the tables, from docs/data/task_scores.json
scripts/task_scores.py run                     # measure all tasks anew, a quarter of an hour on a free core
scripts/task_scores.py run Yaw MaxPower        # some of them: the others keep their figures
scripts/task_scores.py pages                   # put the tables into the pages

Runs are kept in runs/task_scores as soon as they are done: "run" goes on where it was stopped.
"""

import argparse
import json
import re
import sys
import time
from datetime import UTC, datetime
from pathlib import Path

import use_venv  # noqa: F401 - finds packages and interpreter

ROOT = Path(__file__).resolve().parent.parent
RECORD = ROOT / "docs" / "data" / "task_scores.json"
PAGES = ROOT / "docs" / "tasks"
_MARKED = re.compile(r"(<!-- (scores|kinds): ([^>]+?) -->\n).*?(<!-- end -->)", re.DOTALL)


def parse_arguments(studies) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", nargs="?", choices=("show", "run", "pages"), default="show")
    parser.add_argument("names", nargs="*", metavar="TABLE", help=f"which (default: all): {', '.join(studies)}")
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "task_scores", help="folder of the runs")
    parser.add_argument("--overwrite", action="store_true", help="make runs anew that are there")
    arguments = parser.parse_args()
    if unknown := [name for name in arguments.names if name not in studies]:
        parser.error(f"unknown table {', '.join(unknown)}; known: {', '.join(studies)}")
    return arguments


def read_record(path: Path = RECORD) -> dict:
    """Measurements by the name of the table."""
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


def write_record(record: dict, path: Path = RECORD) -> None:
    """Write measurements, a line a run: a later one shows in the history which numbers it moved."""
    from wt_gym.base.files import write_text_whole

    def entry(study: dict) -> str:
        head = json.dumps({key: value for key, value in study.items() if key != "runs"})
        runs = ",\n  ".join(json.dumps(run, ensure_ascii=False) for run in study["runs"])
        return f'{head[:-1]}, "runs": [\n  {runs}]}}'

    text = ",\n".join(f"{json.dumps(name)}: {entry(study)}" for name, study in record.items())
    write_text_whole(path, f"{{\n{text}\n}}\n")


def run(names: list[str], folder: Path, overwrite: bool) -> None:
    """Measure tasks and keep the figures of each as soon as it is done."""
    import wt_gym
    from envs_tests.physics.validation import source_commit
    from wt_gym.experiment.task_scores import STUDIES, measure

    commit, started = source_commit(RECORD), time.process_time()

    def on_progress(text: str) -> None:
        print(f"{time.process_time() - started:6.0f} s  {text}", flush=True)

    for name in names:
        begun, runs = time.process_time(), measure(STUDIES[name], on_progress, folder / name, overwrite)
        made = {
            "date": datetime.now(UTC).strftime("%Y-%m-%d"), "version": wt_gym.__version__, "commit": commit,
            "processor_time_s": round(time.process_time() - begun), "env_id": STUDIES[name].env_id, "runs": runs,
        }  # fmt: skip
        record = read_record() | {name: made}
        write_record({key: record[key] for key in STUDIES if key in record})


def tables(text: str, record: dict) -> str:
    """A page with its tables as the record has them."""
    from wt_gym.experiment.task_scores import kinds_table, measured_line, score_table

    def table(found: re.Match) -> str:
        head, kind, words, end = found.groups()
        if kind == "scores":
            study = record[words]
            return f"{head}{measured_line(study['env_id'])}\n\n{score_table(words, study['runs'])}\n{end}"
        name, key = words.split()
        return f"{head}{kinds_table(name, key, record[name]['runs'])}\n{end}"

    return _MARKED.sub(table, text)


def main() -> int:
    """Show, measure, or renew the pages."""
    from wt_gym.base.files import write_text_whole
    from wt_gym.experiment.task_scores import STUDIES, score_table

    arguments = parse_arguments(STUDIES)
    names = arguments.names or list(STUDIES)
    if arguments.command == "run":
        from wt_gym.commands.program import stoppable, user_errors

        with user_errors(), stoppable(f"the same command goes on with the runs in {arguments.out}"):
            run(names, arguments.out, arguments.overwrite)
    record = read_record()
    if arguments.command == "pages":
        for page in sorted(PAGES.glob("*.md")):
            write_text_whole(page, tables(page.read_text(encoding="utf-8"), record))
        return 0
    for name in (name for name in names if name in record):
        print(f"\n{name}: {record[name]['env_id']}, {record[name]['date']}\n{score_table(name, record[name]['runs'])}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
