"""What controllers and a shipped agent keep of their gain in each fault, for the page of the task Faults.

    python scripts/studies/fault_study.py run      # all faults, ten minutes on a free core
    python scripts/studies/fault_study.py run --conditions fault-dead-moment    # the others keep theirs
    python scripts/studies/fault_study.py pages    # put the table into docs/tasks/faults.md

Runs are kept in the folder as soon as they are done, the record in docs/data/fault_study.json. The gain is that of the
load-reduction tasks of the benchmark, over `discon` in the same fault and wind; what is kept is its share of the gain
without a fault.
"""

import argparse
import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from task_scores import STEADY, signed

from wt_gym.analysis.statistics import relative_change
from wt_gym.base.files import write_text_whole
from wt_gym.experiment.benchmark_tasks import load_task
from wt_gym.experiment.evaluation import EvaluationConfig, evaluate, winds_for
from wt_gym.experiment.robustness import CONDITIONS, COST_TASK, FAULT_CONDITIONS, NOMINAL, chosen
from wt_gym.experiment.run import benchmark_metrics
from wt_gym.tasks import DEFAULT_ENV
from wt_gym.turbines import load_turbine

ROOT = Path(__file__).resolve().parents[2]
RECORD = ROOT / "docs" / "data" / "fault_study.json"
PAGE = ROOT / "docs" / "tasks" / "faults.md"
MARKED = re.compile(r"(<!-- fault study -->\n).*?(<!-- end -->)", re.DOTALL)
REFERENCE, FLAP = "discon", "blade_flap_del"
AGENTS = {
    REFERENCE: REFERENCE,
    "linear_optimal": "linear_optimal",
    "linear_optimal+fault_supervisor": "linear_optimal+fault_supervisor",
    "faults": str(ROOT / "agents" / "trained" / "faults"),
}
WITHOUT_YAW = ("fault-biased-vane", "fault-dead-vane")
"""Conditions that `discon` and `linear_optimal` do not feel."""


def run(
    folder: Path, names: list[str], measured: list[str], speeds: list[float], seeds: list[int], duration: float
) -> None:
    """Measure conditions; the record keeps its figures of others."""
    turbine, keys = load_turbine("nrel_5mw"), [term.metric for term in load_task(COST_TASK).terms]
    winds = winds_for(DEFAULT_ENV, {}, speeds, seeds, None, duration)
    config = EvaluationConfig(DEFAULT_ENV, STEADY, winds, duration=duration, skip=30.0, replay=0.0)
    rows = []
    every = [one for one in chosen(["faults"]) if one.name not in WITHOUT_YAW]
    partial = bool(names) or len(measured) < len(AGENTS)
    kept = json.loads(RECORD.read_text(encoding="utf-8"))["runs"] if partial else []
    for one in every:
        here = measured if not names or one.name in names else []
        others = AGENTS.keys() - set(here)
        rows += [row for row in kept if row["condition"] == one.name and row["agent"] in others]
        if not here:
            continue
        print(one.text, flush=True)
        own, agents = replace(config, env_kwargs=STEADY | one.arguments), {name: AGENTS[name] for name in measured}
        found = evaluate(agents, own, folder=folder / one.name, progress=False)
        for made in found.runs:
            complete = made.ending == "time"
            data = made.data.isel(time=slice(1, None))
            metrics = benchmark_metrics(data, turbine, config.skip) if complete else {}
            rows.append(
                {
                    "condition": one.name, "agent": made.agent, "wind": made.wind.label, "ending": made.ending,
                    "metrics": {key: float(f"{metrics[key]:.6g}") for key in dict.fromkeys((*keys, FLAP)) if metrics},
                }
            )  # fmt: skip
    head = {"env_id": DEFAULT_ENV, "speeds": speeds, "seeds": seeds, "duration": duration}
    lines = ",\n  ".join(json.dumps(row) for row in rows)
    write_text_whole(RECORD, f'{json.dumps(head)[:-1]}, "runs": [\n  {lines}]}}\n')


def table(record: dict) -> str:
    """Markdown of the record."""
    improvement = load_task(COST_TASK).improvement
    by = {(row["condition"], row["agent"], row["wind"]): row for row in record["runs"]}
    winds = list(dict.fromkeys(row["wind"] for row in record["runs"]))
    others = [agent for agent in AGENTS if agent != REFERENCE]

    def change(condition: str, agent: str, base: tuple[str, str], key: str = FLAP) -> str:
        """Mean change of a load over the winds that both came through."""
        pairs = [(by[condition, agent, wind]["metrics"], by[(*base, wind)]["metrics"]) for wind in winds]
        values = [relative_change(mine[key], theirs[key]) for mine, theirs in pairs if mine and theirs]
        return signed(100.0 * np.mean(values), 0) + " %" if values else "–"

    def gain(condition: str, agent: str) -> float | None:
        pairs = [(by[condition, agent, w]["metrics"], by[condition, REFERENCE, w]["metrics"]) for w in winds]
        if not all(mine and theirs for mine, theirs in pairs):
            return None
        return float(np.mean([improvement(mine, theirs) for mine, theirs in pairs]))

    heads = ["fault", f"`{REFERENCE}`: flap DEL"]
    for agent in others:
        heads += [f"`{agent}`: gain", "kept", "flap DEL"]
    lines = ["| " + " | ".join(heads) + " |", "|" + " --- |" * len(heads)]
    for condition in dict.fromkeys(row["condition"] for row in record["runs"]):
        text = (CONDITIONS | FAULT_CONDITIONS)[condition].text
        cells = ["none" if condition == NOMINAL else text]
        cells.append(
            f"{np.mean([by[condition, REFERENCE, w]['metrics'][FLAP] for w in winds]) / 1e6:.2f} MN m"
            if condition == NOMINAL
            else change(condition, REFERENCE, (NOMINAL, REFERENCE))
        )
        for agent in others:
            own, nominal = gain(condition, agent), gain(NOMINAL, agent)
            ended = sum(by[condition, agent, wind]["ending"] != "time" for wind in winds)
            cells.append(f"{ended} of {len(winds)} ended" if own is None else f"{signed(100.0 * own, 1)} %")
            cells.append("–" if own is None or nominal is None else f"{signed(100.0 * own / nominal, 0, plus=False)} %")
            cells.append(change(condition, agent, (condition, REFERENCE)))
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def with_table(text: str, record: dict) -> str:
    """A page with its table as the record has it."""
    return MARKED.sub(lambda found: f"{found[1]}{table(record)}\n{found[2]}", text)


def main(words: list[str] | None = None) -> int:
    """Measure, or renew the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", choices=("run", "pages", "show"))
    parser.add_argument("--folder", type=Path, default=ROOT / "runs" / "faults", help="of the runs")
    parser.add_argument("--conditions", nargs="+", default=[], metavar="NAME", help="as of wt-gym robustness --list")
    parser.add_argument("--agents", nargs="+", default=list(AGENTS), choices=AGENTS, help="the others are kept too")
    parser.add_argument("--speeds", type=float, nargs="+", default=[15.0, 18.0], help="mean winds, m/s")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1001, 1002], help="of the turbulence")
    parser.add_argument("--duration", type=float, default=120.0, help="of a run, s")
    arguments = parser.parse_args(words)
    if arguments.command == "run":
        run(
            arguments.folder,
            arguments.conditions,
            arguments.agents,
            arguments.speeds,
            arguments.seeds,
            arguments.duration,
        )
    record = json.loads(RECORD.read_text(encoding="utf-8"))
    if arguments.command == "pages":
        write_text_whole(PAGE, with_table(PAGE.read_text(encoding="utf-8"), record))
    else:
        print(table(record))
    return 0


if __name__ == "__main__":
    sys.exit(main())
