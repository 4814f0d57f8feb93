"""What controllers and a shipped agent keep of their gain in each fault, for the page of the task Faults.

    python scripts/studies/fault_study.py run      # all faults, ten minutes on a free core
    python scripts/studies/fault_study.py run --conditions fault-dead-moment    # the others keep theirs

Runs are kept in the folder as soon as they are done, the record in docs/data/fault_study.json. The gain is that of the
load-reduction tasks of the benchmark, over `discon` in the same fault and wind; what is kept is its share of the gain
without a fault.
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from study_pages import DATA, ROOT, STEADY, TRAINED, markdown, percent, read_json, with_runs

from wt_gym.analysis.statistics import relative_change
from wt_gym.base.files import write_text_whole
from wt_gym.experiment.benchmark_tasks import load_task
from wt_gym.experiment.evaluation import EvaluationConfig, evaluate, winds_for
from wt_gym.experiment.robustness import CONDITIONS, COST_TASK, FAULT_CONDITIONS, NOMINAL, chosen
from wt_gym.experiment.run import benchmark_metrics
from wt_gym.tasks import DEFAULT_ENV
from wt_gym.turbines import load_turbine

RECORD = DATA / "fault_study.json"
REFERENCE, FLAP = "discon", "blade_flap_del"
AGENTS = {name: name for name in (REFERENCE, "linear_optimal", "linear_optimal+fault_supervisor")}
AGENTS["faults"] = str(TRAINED / "faults")
WITHOUT_YAW = ("fault-biased-vane", "fault-dead-vane")
"""Conditions that `discon` and `linear_optimal` do not feel."""
DURATION, SPEEDS, SEEDS = 120.0, (15.0, 18.0), (1001, 1002)


def run(folder: Path, names: list[str]) -> None:
    """Measure conditions, by default all; the record keeps its figures of others."""
    turbine, keys = load_turbine("nrel_5mw"), [term.metric for term in load_task(COST_TASK).terms]
    winds = winds_for(DEFAULT_ENV, {}, SPEEDS, SEEDS, None, DURATION)
    config = EvaluationConfig(DEFAULT_ENV, STEADY, winds, duration=DURATION, skip=30.0, replay=0.0)
    kept = read_json(RECORD)["runs"] if names else []
    rows = []
    for condition in chosen(["faults"]):
        if condition.name in WITHOUT_YAW:
            continue
        if names and condition.name not in names:
            rows += [row for row in kept if row["condition"] == condition.name]
            continue
        print(condition.text, flush=True)
        own = replace(config, env_kwargs=STEADY | condition.arguments)
        for made in evaluate(AGENTS, own, folder=folder / condition.name, progress=False).runs:
            data = made.data.isel(time=slice(1, None))
            metrics = benchmark_metrics(data, turbine, config.skip) if made.ending == "time" else {}
            shown = {key: float(f"{metrics[key]:.6g}") for key in dict.fromkeys((*keys, FLAP)) if metrics}
            row = {"condition": condition.name, "agent": made.agent, "wind": made.wind.label, "ending": made.ending}
            rows.append(row | {"metrics": shown})
    record = {"env_id": DEFAULT_ENV, "speeds": SPEEDS, "seeds": SEEDS, "duration": DURATION, "runs": rows}
    write_text_whole(RECORD, with_runs(record) + "\n")


def gains(record: dict) -> dict[tuple[str, str], float | None]:
    """Mean gain by condition and agent, over the reference in the same winds; None where a run ended early."""
    improvement, runs = load_task(COST_TASK).improvement, {}
    for row in record["runs"]:
        runs.setdefault((row["condition"], row["agent"]), {})[row["wind"]] = row["metrics"]
    found = {}
    for (condition, agent), mine in runs.items():
        pairs = [(metrics, runs[condition, REFERENCE][wind]) for wind, metrics in mine.items()]
        complete = all(own and base for own, base in pairs)
        found[condition, agent] = float(np.mean([improvement(*pair) for pair in pairs])) if complete else None
    return found


def table(record: dict) -> str:
    """Markdown of the record."""
    by = {(row["condition"], row["agent"], row["wind"]): row for row in record["runs"]}
    winds, gain = list(dict.fromkeys(row["wind"] for row in record["runs"])), gains(record)
    others = [agent for agent in AGENTS if agent != REFERENCE]

    def change(condition: str, agent: str, base: tuple[str, str]) -> str:
        """Mean change of the flap DEL over the winds that both came through."""
        pairs = [(by[condition, agent, wind]["metrics"], by[(*base, wind)]["metrics"]) for wind in winds]
        values = [relative_change(mine[FLAP], theirs[FLAP]) for mine, theirs in pairs if mine and theirs]
        return percent(np.mean(values), 0) if values else "–"

    rows = []
    for condition in dict.fromkeys(row["condition"] for row in record["runs"]):
        if condition == NOMINAL:
            flap = np.mean([by[condition, REFERENCE, wind]["metrics"][FLAP] for wind in winds])
            cells = ["none", f"{flap / 1e6:.2f} MN m"]
        else:
            text = (CONDITIONS | FAULT_CONDITIONS)[condition].text
            cells = [text, change(condition, REFERENCE, (NOMINAL, REFERENCE))]
        for agent in others:
            own, nominal = gain[condition, agent], gain[NOMINAL, agent]
            ended = sum(by[condition, agent, wind]["ending"] != "time" for wind in winds)
            cells += [
                f"{ended} of {len(winds)} ended" if own is None else percent(own, 1),
                "–" if own is None or nominal is None else percent(own / nominal, 0, plus=False),
                change(condition, agent, (condition, REFERENCE)),
            ]
        rows.append(cells)
    headings = [text for agent in others for text in (f"`{agent}`: gain", "kept", "flap DEL")]
    return markdown(["fault", f"`{REFERENCE}`: flap DEL", *headings], rows)


def main(words: list[str] | None = None) -> int:
    """Measure, or show the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", choices=("run", "show"))
    parser.add_argument("--folder", type=Path, default=ROOT / "runs" / "faults", help="of the runs")
    parser.add_argument("--conditions", nargs="+", default=[], metavar="NAME", help="as of wt-gym robustness --list")
    arguments = parser.parse_args(words)
    if arguments.command == "run":
        run(arguments.folder, arguments.conditions)
    print(table(read_json(RECORD)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
