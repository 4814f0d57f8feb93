#!/usr/bin/env python3
"""The table of README.md, from the record of the crosscheck.

    scripts/readme_table.py            # write it
    scripts/readme_table.py --check    # exit status 1 where it is another one

README.md says for which agent: ``<!-- crosscheck: AGENT -->``, a name in docs/data/crosscheck.json.
"""

import argparse
import json
import re
from pathlib import Path

import use_venv  # noqa: F401 - finds packages and interpreter

ROOT = Path(__file__).resolve().parents[1]
RECORD = ROOT / "docs" / "data" / "crosscheck.json"
COLUMNS = {
    "blade_flap_del": "flap fatigue",
    "tower_fore_aft_del": "tower fore-aft",
    "tower_side_side_del": "tower side-side",
    "mean_power": "power",
}
LEAST_SPEED = 10.0  # [m/s]; below rated wind the agents of the load tasks rest
BLOCK = re.compile(r"(<!-- crosscheck: (\S+) -->\n)(.*?)(<!-- end -->)", re.DOTALL)


def table(content, agent):
    """Rows by wind speed: change in both simulators.

    Raises
    ------
    KeyError
        If the record does not have the agent.
    """
    speeds = sorted({row["wind_speed"] for row in content["metrics"] if (row["wind_speed"] or 0.0) > LEAST_SPEED})
    found = {(row["wind_speed"], row["metric"]): row["changes"] for row in content["metrics"]}
    lines = ["| mean wind | " + " | ".join(COLUMNS.values()) + " |", "|---|" + "---|" * len(COLUMNS)]
    for speed in speeds:
        cells = [_pair(found[speed, metric][agent]) for metric in COLUMNS]
        lines.append(f"| {speed:g} m/s | " + " | ".join(cells) + " |")
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


def written(text, content):
    """The text of README.md with its table as the record has it."""
    if not BLOCK.search(text):
        raise ValueError("README.md must have a block <!-- crosscheck: AGENT --> … <!-- end -->")
    return BLOCK.sub(lambda found: found[1] + table(content, found[2]) + found[4], text)


def main(words=None):
    """Write or check the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing")
    arguments = parser.parse_args(words)
    page = ROOT / "README.md"
    old = page.read_text(encoding="utf-8")
    new = written(old, json.loads(RECORD.read_text(encoding="utf-8")))
    if not arguments.check:
        page.write_text(new, encoding="utf-8")
    return int(arguments.check and new != old)


if __name__ == "__main__":
    raise SystemExit(main())
