"""The table of README.md, from the records of the crosschecks.

    python scripts/studies/readme_table.py

README.md names the agents: ``<!-- crosscheck: AGENT ... -->``, of a record docs/data/crosscheck*.json.
"""

from study_pages import DATA, ROOT, read_json, renew, signed

COLUMNS = {
    "blade_flap_del": "flap fatigue",
    "tower_fore_aft_del": "tower fore-aft",
    "tower_side_side_del": "tower side-side",
    "mean_power": "power",
}
LEAST_SPEED = 10.0  # [m/s]; below rated wind the agents of the load tasks rest


def table(words):
    """Rows by wind speed and agent: change in both simulators.

    Raises
    ------
    ValueError
        If no record has all agents.
    """
    agents = words.split()
    records = [read_json(path) for path in sorted(DATA.glob("crosscheck*.json"))]
    content = next((one for one in records if set(agents) <= set(one["metrics"][0]["changes"])), None)
    if content is None:
        raise ValueError(f"a record of docs/data must have the agents of the table, got {words}")
    speeds = sorted({row["wind_speed"] for row in content["metrics"] if (row["wind_speed"] or 0.0) > LEAST_SPEED})
    changes = {(row["wind_speed"], row["metric"]): row["changes"] for row in content["metrics"]}
    lines = ["| mean wind | agent | " + " | ".join(COLUMNS.values()) + " |", "|---|---|" + "---|" * len(COLUMNS)]
    for speed in speeds:
        for agent in agents:
            pairs = ([signed(100 * one["value"], 1) for one in changes[speed, metric][agent]] for metric in COLUMNS)
            cells = " | ".join(f"{here} / {there} %" for here, there in pairs)
            lines.append(f"| {speed:g} m/s | `{agent}` | {cells} |")
    runs = content["settings"][0]
    seeds = sum(wind.startswith(f"{speeds[0]:g} m/s") for wind in content["winds"])
    note = (
        f"wt_gym / OpenFAST, {content['turbine'].split(' baseline')[0]}, means of {seeds} winds a speed, "
        f"{runs['duration'] - runs['skip']:g} s each."
    )
    return "\n".join([*lines, "", note])


if __name__ == "__main__":
    renew(ROOT / "README.md", {"crosscheck": table})
