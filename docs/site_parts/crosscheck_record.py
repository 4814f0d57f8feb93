"""Tables of the crosscheck between simulators, from its record."""

from __future__ import annotations

import json
from pathlib import Path

from wt_gym.analysis.crosscheck_page import tables

RECORD = Path(__file__).resolve().parents[1] / "data" / "crosscheck.json"


def crosscheck():
    """How the runs were made, and all tables."""
    content = json.loads(RECORD.read_text(encoding="utf-8"))
    settings = content["settings"][0]
    head = (
        f"{content['turbine']}, `{settings['env_id']}`, {settings['duration']:g} s a run, of which the first "
        f"{settings['skip']:g} s are left out; {len(content['winds'])} winds: {'; '.join(content['winds'])}.\n\n"
    )
    return f"{head}{tables(content)}\n"
