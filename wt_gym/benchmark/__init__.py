"""The benchmark: frozen tasks, runs of agents in them, scores over the baseline controller by a yardstick.

A task (`load_task`) says where an agent runs; `play` makes one run of it; `score` compares the runs of an agent with
the reference numbers that stand in the task's file. docs/benchmark.md has the rules.
"""

from wt_gym.benchmark.ceiling import Ceiling, ceiling_file, ceiling_of
from wt_gym.benchmark.reference import Reference, make_reference, reference_of, write_reference
from wt_gym.benchmark.results import ResultFolder, result_key
from wt_gym.benchmark.run import INTERFACE, benchmark_fingerprint, play, run_definition
from wt_gym.benchmark.scoring import Score, score
from wt_gym.benchmark.table import into_page, leaderboard, to_markdown
from wt_gym.benchmark.tasks import BenchmarkTask, BenchmarkWind, Limit, Term, load_task, task_names

__all__ = [
    "INTERFACE",
    "BenchmarkTask",
    "BenchmarkWind",
    "Ceiling",
    "Limit",
    "Reference",
    "ResultFolder",
    "Score",
    "Term",
    "benchmark_fingerprint",
    "ceiling_file",
    "ceiling_of",
    "into_page",
    "leaderboard",
    "load_task",
    "make_reference",
    "play",
    "reference_of",
    "result_key",
    "run_definition",
    "score",
    "task_names",
    "to_markdown",
    "write_reference",
]
