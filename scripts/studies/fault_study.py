"""What controllers and a shipped agent keep of their gain in each fault, for the page of the task Faults.

    python scripts/studies/fault_study.py run      # all faults, ten minutes on a free core
    python scripts/studies/fault_study.py run --conditions fault-dead-moment    # the others keep theirs
    python scripts/studies/fault_study.py pages    # put the table into docs/tasks/faults.md

Runs are kept in the folder as soon as they are done, the record in docs/data/fault_study.json. The gain is that of the
load-reduction tasks of the benchmark, over `discon` in the same fault and wind; what is kept is its share of the gain
without a fault.
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from study_pages import DATA, ROOT, STEADY, TASK_PAGES, TRAINED, markdown, percent, read_json, renew, with_runs

from wt_gym.analysis.statistics import relative_change
from wt_gym.base.files import write_text_whole
from wt_gym.experiment.benchmark_tasks import load_task
from wt_gym.experiment.evaluation import EvaluationConfig, evaluate, winds_for
from wt_gym.experiment.robustness import CONDITIONS, COST_TASK, FAULT_CONDITIONS, NOMINAL, chosen
from wt_gym.experiment.run import benchmark_metrics
from wt_gym.tasks import DEFAULT_ENV
from wt_gym.turbines import load_turbine

RECORD, PAGE = DATA / "fault_study.json", TASK_PAGES / "faults.md"
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


def table(record: dict) -> str:
    """Markdown of the record."""
    improvement = load_task(COST_TASK).improvement
    by = {(row["condition"], row["agent"], row["wind"]): row for row in record["runs"]}
    winds = list(dict.fromkeys(row["wind"] for row in record["runs"]))
    others = [agent for agent in AGENTS if agent != REFERENCE]

    def pairs(condition: str, agent: str, base: tuple[str, str]) -> list[tuple[dict, dict]]:
        """Metrics of an agent and a base in the winds that both came through."""
        both = [(by[condition, agent, wind]["metrics"], by[(*base, wind)]["metrics"]) for wind in winds]
        return [(mine, theirs) for mine, theirs in both if mine and theirs]

    def change(condition: str, agent: str, base: tuple[str, str]) -> str:
        values = [relative_change(mine[FLAP], theirs[FLAP]) for mine, theirs in pairs(condition, agent, base)]
        return percent(np.mean(values), 0) if values else "–"

    def gain(condition: str, agent: str) -> float | None:
        values = [improvement(mine, theirs) for mine, theirs in pairs(condition, agent, (condition, REFERENCE))]
        return float(np.mean(values)) if len(values) == len(winds) else None

    rows = []
    for condition in dict.fromkeys(row["condition"] for row in record["runs"]):
        if condition == NOMINAL:
            flap = np.mean([by[condition, REFERENCE, wind]["metrics"][FLAP] for wind in winds])
            cells = ["none", f"{flap / 1e6:.2f} MN m"]
        else:
            text = (CONDITIONS | FAULT_CONDITIONS)[condition].text
            cells = [text, change(condition, REFERENCE, (NOMINAL, REFERENCE))]
        for agent in others:
            own, nominal = gain(condition, agent), gain(NOMINAL, agent)
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
    """Measure, or renew the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", choices=("run", "pages", "show"))
    parser.add_argument("--folder", type=Path, default=ROOT / "runs" / "faults", help="of the runs")
    parser.add_argument("--conditions", nargs="+", default=[], metavar="NAME", help="as of wt-gym robustness --list")
    arguments = parser.parse_args(words)
    if arguments.command == "run":
        run(arguments.folder, arguments.conditions)
    text = table(read_json(RECORD))
    if arguments.command == "pages":
        renew(PAGE, {"fault study": lambda _: text})
    else:
        print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
