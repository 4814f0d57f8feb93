#!/usr/bin/env python3
"""One policy with a dial beside policies for single weights: hypervolume and monotony of the parts of the cost.

    scripts/dial_front.py                            # the tables of docs/tasks/dial.md, from docs/data/dial_front.json
    scripts/dial_front.py train --out runs/dial      # the policy with the dial, and one for each setting
    scripts/dial_front.py run --out runs/dial        # measure them in held-out winds and keep the record

All policies are trained by the file of agents/trained/dial_on_linear_optimal; those for single settings have constant
weights. "run" takes the policy with the dial from --dial, by default that of "train".
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path

import use_venv  # noqa: F401 - finds packages and interpreter

import numpy as np

from wt_gym.experiment.dial_front import PARTS, SETTINGS, TURNED, cost_parts, covered

ROOT = Path(__file__).resolve().parent.parent
RECORD = ROOT / "docs" / "data" / "dial_front.json"
TRAINING = ROOT / "agents" / "trained" / "dial_on_linear_optimal" / "training.yml"
WINDS = ((13.0, 1001), (16.0, 1002), (19.0, 1003))
DURATION, SKIP = 150.0, 30.0
BASE = "linear_optimal"


def parse_arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", nargs="?", choices=("show", "train", "run"), default="show")
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "dial", help="folder of the policies")
    parser.add_argument("--dial", type=Path, help="folder of the policy with the dial")
    return parser.parse_args()


def train(out: Path) -> None:
    """Train the policy with the dial, and one for each setting; what is there stays."""
    from wt_gym.commands.train import configuration
    from wt_gym.commands.train import parse_arguments as words_of_training
    from wt_gym.learning.train import train as train_one

    config = configuration(words_of_training(["--config", str(TRAINING)]))
    weights = {"dial": None} | SETTINGS
    for name, chosen in weights.items():
        folder = out / name.replace(" ", "_")
        if (folder / "model.zip").is_file():
            continue
        kwargs = config.env_kwargs | ({} if chosen is None else {"dial_weights": {"fatigue": 1.0, **chosen}})
        record = train_one(replace(config, env_kwargs=kwargs), folder)
        print(f"{name}: {record['pretraining']['rounds']}", file=sys.stderr, flush=True)


def measured(agent: str, weights: dict[str, float]) -> list[dict[str, float]]:
    """Metrics of an agent at a setting of the dial, by wind."""
    from wt_gym.analysis.results import Wind
    from wt_gym.experiment.evaluation import EvaluationConfig, evaluate

    kwargs = {"dial_weights": {"fatigue": 1.0, **weights}, "start": "steady", "wind_speed": [11.5, 22.0]}
    winds = tuple(Wind(speed, seed) for speed, seed in WINDS)
    config = EvaluationConfig("wt_gym/Dial-v0", kwargs, winds, duration=DURATION, skip=SKIP, replay=0.0)
    kept = {name for names in PARTS.values() for name in names}
    runs = evaluate({"agent": agent}, config, progress=False).runs
    assert all(run.complete for run in runs)
    return [{name: float(f"{run.metrics[name]:.6g}") for name in sorted(kept)} for run in runs]


def forecast(folder: Path, name: str | None = None) -> dict[str, list[float]]:
    """Parts of the cost that a pretraining forecast in its held-out winds, by setting."""
    from wt_gym.experiment.trained_agent import TrainedAgent

    front = TrainedAgent.load(folder).record["pretraining"]["front"]
    return front if name is None else {name: front["own"]}


def run(out: Path, dial: Path) -> None:
    """Measure all policies and keep the record."""
    from wt_gym.base.files import write_text_whole

    folders = {name: out / name.replace(" ", "_") for name in SETTINGS}
    single = [forecast(folder, name) for name, folder in folders.items()]
    record = {
        "winds": [list(wind) for wind in WINDS], "duration": DURATION, "skip": SKIP,
        "forecast": {"dial": forecast(dial), "single": {name: row for one in single for name, row in one.items()}},
        "base": measured(BASE, {}),
        "dial": {name: measured(str(dial), weights) for name, weights in TURNED.items()},
        "single": {name: measured(str(folders[name]), weights) for name, weights in SETTINGS.items()},
    }  # fmt: skip
    write_text_whole(RECORD, text_of(record))


def text_of(record: dict) -> str:
    """JSON, a line an entry."""
    lines = ",\n".join(f"{json.dumps(name)}: {json.dumps(value)}" for name, value in record.items())
    return f"{{\n{lines}\n}}\n"


def measured_parts(record: dict, kind: str) -> dict[str, np.ndarray]:
    """Mean parts of the cost over the winds of the simulator, by setting."""
    return {
        name: np.mean([cost_parts(m, b) for m, b in zip(rows, record["base"], strict=True)], axis=0)
        for name, rows in record[kind].items()
    }


def rows_of(dial: dict, single: dict) -> str:
    """Rows of the parts of both kinds of policies, in per cent."""
    return "\n".join(
        f"| {name} | "
        + " | ".join(f"{100 * a:+.2f} % | {100 * b:+.2f} %" for a, b in zip(dial[name], single[name], strict=True))
        + " |"
        for name in SETTINGS
    )


def tables(record: dict) -> str:
    """Markdown: parts by setting of both kinds of policies, the hypervolumes, and each part over its own factor."""
    head = "| factors | " + " | ".join(f"{part}, one policy | {part}, own policy" for part in PARTS) + " |"
    forecast_dial = record["forecast"]["dial"]
    forecast_single, simulated = record["forecast"]["single"], measured_parts(record, "dial")
    of_model, of_simulator = (
        covered(forecast_dial, forecast_single),
        covered(simulated, measured_parts(record, "single")),
    )
    lines = [
        head, "|---" * (1 + 2 * len(PARTS)) + "|", rows_of(forecast_dial, forecast_single), "",
        f"Hypervolume of the one policy over that of the five: {100.0 * of_model:.0f} % on the model, "
        f"{100.0 * of_simulator:.0f} % in the simulator.", "",
        "| part of the cost | where | factor at a quarter | equal | at four times |", "|---|---|---|---|---|",
    ]  # fmt: skip
    for k, name in enumerate(PARTS):
        for where, points in (("model", forecast_dial), ("simulator", simulated)):
            cells = [f"{100.0 * points[setting][k]:+.2f} %" for setting in (f"little {name}", "equal", name)]
            lines.append(f"| {name} | {where} | " + " | ".join(cells) + " |")
    return "\n".join(line if line.startswith("|---") else line.replace("-", "−") for line in lines)


def main() -> None:
    """Do what is asked for."""
    arguments = parse_arguments()
    if arguments.command == "train":
        train(arguments.out)
    elif arguments.command == "run":
        run(arguments.out, arguments.dial or arguments.out / "dial")
    if arguments.command != "train":
        print(tables(json.loads(RECORD.read_text(encoding="utf-8"))))


if __name__ == "__main__":
    main()
