"""Hypervolume and monotony of one policy with a dial beside policies for single weights.

    python scripts/studies/dial_front.py                        # the tables of docs/tasks/dial.md
    python scripts/studies/dial_front.py train --out runs/dial  # the policy with the dial, and one for each setting
    python scripts/studies/dial_front.py run --out runs/dial    # measure them in held-out winds and write the record

Writes docs/data/dial_front.json. All policies are trained by the file of agents/trained/dial_on_linear_optimal; those
for single settings have constant weights. "run" takes the policy with the dial from --dial, by default that of "train".

A setting of the dial gives a point (fatigue, power, travel): the parts of the lifetime cost
(`wt_gym.analysis.metrics`) less those of the base controller in the same winds. The hypervolume of several points
is the volume that they dominate up to a reference point (Zitzler and Thiele, IEEE Trans. Evol. Comp. 3, 1999).
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.analysis.metrics import LIFETIME_COST_WEIGHTS
from wt_gym.analysis.results import Wind
from wt_gym.base.files import write_text_whole
from wt_gym.commands import parse
from wt_gym.commands.train import configuration
from wt_gym.envs.dial import DIAL_NAMES
from wt_gym.experiment.evaluation import EvaluationConfig, evaluate
from wt_gym.experiment.trained_agent import TrainedAgent
from wt_gym.learning.pretraining import FRONT_SETTINGS
from wt_gym.learning.train import train as train_policy

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[2]
RECORD = ROOT / "docs" / "data" / "dial_front.json"
TRAINING = ROOT / "agents" / "trained" / "dial_on_linear_optimal" / "training.yml"
WINDS = ((13.0, 1001), (16.0, 1002), (19.0, 1003))
DURATION, SKIP = 150.0, 30.0
BASE = "linear_optimal"
SETTINGS = {name: FRONT_SETTINGS[name] for name in ("equal", "fatigue", "power", "travel", "little travel")}
"""Settings that are compared with a policy each."""
PARTS: dict[str, tuple[str, ...]] = {
    "fatigue": ("blade_flap_del", "tower_fore_aft_del", "tower_side_side_del"),
    "power": ("mean_power",),
    "travel": ("pitch_duty_cycle",),
}
"""Metrics of each part of the cost, in the order of `DIAL_NAMES`."""
_WEIGHTS = LIFETIME_COST_WEIGHTS | {"mean_power": LIFETIME_COST_WEIGHTS["captured_power"]}


def cost_parts(metrics: Mapping[str, float], base: Mapping[str, float]) -> NDArray[np.float64]:
    """Parts of the lifetime cost (3,) less those of the base controller.

    Parameters
    ----------
    metrics, base : mapping
        Of `wt_gym.analysis.metrics.run_metrics`, in the same wind.
    """

    def change(name: str) -> float:
        size = 1.0 if name == "pitch_duty_cycle" else base[name]
        return _WEIGHTS[name] * (metrics[name] - base[name]) / size

    return np.array([sum(change(metric) for metric in PARTS[name]) for name in DIAL_NAMES])


def nadir(points: NDArray[np.float64], margin: float = 0.1) -> NDArray[np.float64]:
    """Reference point (k,): the worst of each part, and a margin of its range.

    Parameters
    ----------
    points : numpy.ndarray, shape (n, k)
        Less is better.
    margin : float
    """
    worst: NDArray[np.float64] = points.max(axis=0)
    best: NDArray[np.float64] = points.min(axis=0)
    found: NDArray[np.float64] = worst + margin * (worst - best)
    return found


def covered(dial: Mapping[str, Sequence[float]], single: Mapping[str, Sequence[float]]) -> float:
    """Hypervolume of a policy with a dial over that of policies for single settings.

    Parameters
    ----------
    dial, single : mapping
        Parts of the cost (k,) by name of `SETTINGS`.
    """
    one, several = (np.array([points[name] for name in SETTINGS]) for points in (dial, single))
    reference = nadir(np.vstack([one, several]))
    return hypervolume(one, reference) / hypervolume(several, reference)


def hypervolume(points: NDArray[np.float64] | Sequence[Sequence[float]], reference: NDArray[np.float64]) -> float:
    """Volume that points dominate up to a reference point, less being better.

    Slices across the last part: between two levels of it the area is that of the points below.

    Parameters
    ----------
    points : numpy.ndarray, shape (n, k)
    reference : numpy.ndarray, shape (k,)
    """
    found = np.asarray(points, dtype=np.float64).reshape(-1, len(reference))
    found = found[(found < reference).all(axis=1)]
    if not len(found):
        return 0.0
    if found.shape[1] == 1:
        return float(reference[0] - found.min())
    found = found[np.argsort(found[:, -1])]
    levels = np.append(found[:, -1], reference[-1])
    return float(
        sum(
            (levels[k + 1] - levels[k]) * hypervolume(found[: k + 1, :-1], reference[:-1])
            for k in range(len(found))
            if levels[k + 1] > levels[k]
        )
    )


def parse_arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", nargs="?", choices=("show", "train", "run"), default="show")
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "dial", help="folder of the policies")
    parser.add_argument("--dial", type=Path, help="folder of the policy with the dial")
    return parser.parse_args()


def train(out: Path) -> None:
    """Train the policy with the dial, and one for each setting; what is there stays."""
    config = configuration(parse("train", ["--config", str(TRAINING)]))
    weights = {"dial": None} | SETTINGS
    for name, chosen in weights.items():
        folder = out / name.replace(" ", "_")
        if (folder / "model.zip").is_file():
            continue
        kwargs = config.env_kwargs | ({} if chosen is None else {"dial_weights": {"fatigue": 1.0, **chosen}})
        record = train_policy(replace(config, env_kwargs=kwargs), folder)
        print(f"{name}: {record['pretraining']['rounds']}", file=sys.stderr, flush=True)


def measured(agent: str, weights: dict[str, float]) -> list[dict[str, float]]:
    """Metrics of an agent at a setting of the dial, by wind."""
    kwargs = {"dial_weights": {"fatigue": 1.0, **weights}, "start": "steady", "wind_speed": [11.5, 22.0]}
    winds = tuple(Wind(speed, seed) for speed, seed in WINDS)
    config = EvaluationConfig("wt_gym/Dial-v0", kwargs, winds, duration=DURATION, skip=SKIP, replay=0.0)
    kept = {name for names in PARTS.values() for name in names}
    runs = evaluate({"agent": agent}, config, progress=False).runs
    assert all(run.complete for run in runs)
    return [{name: float(f"{run.metrics[name]:.6g}") for name in sorted(kept)} for run in runs]


def forecast(folder: Path, name: str | None = None) -> dict[str, list[float]]:
    """Parts of the cost that a pretraining forecast in its held-out winds, by setting."""
    front = TrainedAgent.load(folder).record["pretraining"]["front"]
    return front if name is None else {name: front["own"]}


def run(out: Path, dial: Path) -> None:
    """Measure all policies and keep the record."""
    folders = {name: out / name.replace(" ", "_") for name in SETTINGS}
    single = [forecast(folder, name) for name, folder in folders.items()]
    record = {
        "winds": [list(wind) for wind in WINDS], "duration": DURATION, "skip": SKIP,
        "forecast": {"dial": forecast(dial), "single": {name: row for one in single for name, row in one.items()}},
        "base": measured(BASE, {}),
        "dial": {name: measured(str(dial), weights) for name, weights in FRONT_SETTINGS.items()},
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
