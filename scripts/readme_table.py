#!/usr/bin/env python3
"""The table of README.md, from the records of the crosschecks.

    scripts/readme_table.py            # write it
    scripts/readme_table.py --check    # exit status 1 where it is another one

README.md says for which agents: ``<!-- crosscheck: AGENT ... -->``, names in a record docs/data/crosscheck*.json.
"""

import argparse
import json
import re
from pathlib import Path

import use_venv  # noqa: F401 - finds packages and interpreter

ROOT = Path(__file__).resolve().parents[1]
RECORDS = sorted((ROOT / "docs" / "data").glob("crosscheck*.json"))
COLUMNS = {
    "blade_flap_del": "flap fatigue",
    "tower_fore_aft_del": "tower fore-aft",
    "tower_side_side_del": "tower side-side",
    "mean_power": "power",
}
LEAST_SPEED = 10.0  # [m/s]; below rated wind the agents of the load tasks rest
BLOCK = re.compile(r"(<!-- crosscheck: ([^>]+?) -->\n)(.*?)(<!-- end -->)", re.DOTALL)


def table(content, agents):
    """Rows by wind speed and agent: change in both simulators."""
    speeds = sorted({row["wind_speed"] for row in content["metrics"] if (row["wind_speed"] or 0.0) > LEAST_SPEED})
    found = {(row["wind_speed"], row["metric"]): row["changes"] for row in content["metrics"]}
    lines = ["| mean wind | agent | " + " | ".join(COLUMNS.values()) + " |", "|---|---|" + "---|" * len(COLUMNS)]
    for speed in speeds:
        for agent in agents:
            cells = [_pair(found[speed, metric][agent]) for metric in COLUMNS]
            lines.append(f"| {speed:g} m/s | `{agent}` | " + " | ".join(cells) + " |")
    runs = content["settings"][0]
    seeds = sum(wind.startswith(f"{speeds[0]:g} m/s") for wind in content["winds"])
    note = (
        f"wt_gym / OpenFAST, {content['turbine'].split(' baseline')[0]}, means of {seeds} winds a speed, "
        f"{runs['duration'] - runs['skip']:g} s each."
    )
    return "\n".join([*lines, "", note, ""])


def _pair(changes):
    return " / ".join(_percent(change["value"]) for change in changes) + " %"


def _percent(value):
    text = f"{100 * value:+.1f}".replace("-", "−")
    return "0.0" if text[1:] == "0.0" else text


def written(text, contents):
    """The text of README.md with its table as the record that has the agent has it.

    Raises
    ------
    ValueError
        If there is no table, or its agents are in no record.
    """
    if not (block := BLOCK.search(text)):
        raise ValueError("README.md must have a block <!-- crosscheck: AGENT --> … <!-- end -->")
    agents = block[2].split()
    mine = [content for content in contents if set(agents) <= set(content["metrics"][0]["changes"])]
    if not mine:
        raise ValueError(f"a record of docs/data must have the agents of the table, got {block[2]}")
    return BLOCK.sub(lambda found: found[1] + table(mine[0], agents) + found[4], text)


def main(words=None):
    """Write or check the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing")
    arguments = parser.parse_args(words)
    page = ROOT / "README.md"
    old = page.read_text(encoding="utf-8")
    new = written(old, [json.loads(path.read_text(encoding="utf-8")) for path in RECORDS])
    if not arguments.check:
        page.write_text(new, encoding="utf-8")
    return int(arguments.check and new != old)


if __name__ == "__main__":
    raise SystemExit(main())
