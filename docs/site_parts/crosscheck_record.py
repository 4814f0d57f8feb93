"""Tables of the crosscheck between simulators, from its record."""

from __future__ import annotations

import json
from pathlib import Path

from wt_gym.analysis.crosscheck import tables

DATA = Path(__file__).resolve().parents[1] / "data"


def crosscheck():
    """How the runs were made, and all tables."""
    return _record("crosscheck.json")


def crosscheck_linear():
    """The same of the linear optimal controller and the agent on it."""
    return _record("crosscheck_linear.json")


def _record(name):
    content = json.loads((DATA / name).read_text(encoding="utf-8"))
    settings = content["settings"][0]
    head = (
        f"{content['turbine']}, `{settings['env_id']}`, {settings['duration']:g} s a run, of which the first "
        f"{settings['skip']:g} s are left out; {len(content['winds'])} winds: {'; '.join(content['winds'])}.\n\n"
    )
    return f"{head}{tables(content)}\n"
