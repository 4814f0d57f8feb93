"""Runs: what one is, how it is played, who does many of them, and where their results are kept.

    definition   what decides on the numbers of a run: plain data with a digest
    playing      an agent in an environment, or a controller on a simulator, from the reset to the end
    executors    this process, several of this machine, or a Ray cluster
    store        a file a run, found by its digest
    table        a list of runs: those that are kept as they are, the others made and kept

Evaluation, load cases, benchmark and comparisons are tables of runs and what is made of them. Nothing here knows an
agent by name; `wt_gym.experiment.names` reads names and `wt_gym.experiment.pool` makes agents of them, each in its
environment.
"""

from wt_gym.runs.definition import RunDefinition, digest
from wt_gym.runs.playing import Episode, play, run_baseline, run_controller
from wt_gym.runs.store import RunStore
from wt_gym.runs.table import make_runs

__all__ = ["Episode", "RunDefinition", "RunStore", "digest", "make_runs", "play", "run_baseline", "run_controller"]
