"""Hypervolume and monotony of one policy with a dial beside policies for single weights.

    python scripts/studies/dial_front.py                        # the tables of docs/tasks/dial.md
    python scripts/studies/dial_front.py train --out runs/dial  # the policy with the dial, and one for each setting
    python scripts/studies/dial_front.py run --out runs/dial    # measure them in held-out winds and write the record

Writes docs/data/dial_front.json. All policies are trained by the file of agents/trained/dial; those for single settings
have constant weights. "run" takes the policy with the dial from --dial, by default that of "train".

A setting of the dial gives a point (fatigue, power, travel): the parts of the lifetime cost
(`wt_gym.analysis.metrics`) less those of the base controller in the same winds. The hypervolume of several points
is the volume that they dominate up to a reference point (Zitzler and Thiele, IEEE Trans. Evol. Comp. 3, 1999).
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from study_pages import DATA, ROOT, TRAINED, markdown, read_json, write_entries

from wt_gym.analysis.metrics import LIFETIME_COST_WEIGHTS
from wt_gym.analysis.results import Wind
from wt_gym.commands import parse
from wt_gym.commands.train import configuration
from wt_gym.envs.dial import DIAL_NAMES
from wt_gym.experiment.evaluation import EvaluationConfig, evaluate
from wt_gym.experiment.trained_agent import TrainedAgent
from wt_gym.learning.linear_design import forecast_change
from wt_gym.learning.pretraining import FRONT_SETTINGS
from wt_gym.learning.train import train as train_policy

RECORD = DATA / "dial_front.json"
TRAINING = TRAINED / "dial" / "training.yml"
WINDS = ((13.0, 1001), (16.0, 1002), (19.0, 1003))
DURATION, SKIP = 150.0, 30.0
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
    counted = [{metric: metrics[metric] for metric in PARTS[name]} for name in DIAL_NAMES]
    return np.array([forecast_change(part, base, _WEIGHTS) for part in counted])


def covered(dial: Mapping[str, Sequence[float]], single: Mapping[str, Sequence[float]]) -> float:
    """Hypervolume of a policy with a dial over that of policies for single settings.

    The reference point is the worst of each part and a tenth of its range.

    Parameters
    ----------
    dial, single : mapping
        Parts of the cost (k,) by name of `SETTINGS`.
    """
    one, several = (np.array([points[name] for name in SETTINGS]) for points in (dial, single))
    both = np.vstack([one, several])
    reference = both.max(axis=0) + 0.1 * np.ptp(both, axis=0)
    return hypervolume(one, reference) / hypervolume(several, reference)


def hypervolume(points: ArrayLike, reference: NDArray[np.float64]) -> float:
    """Volume that points dominate up to a reference point, less being better.

    Slices across the last part: between two levels of it the area is that of the points below.

    Parameters
    ----------
    points : array_like, shape (n, k)
    reference : numpy.ndarray, shape (k,)
    """
    below = np.asarray(points, dtype=np.float64).reshape(-1, len(reference))
    below = below[(below < reference).all(axis=1)]
    if not len(below):
        return 0.0
    if len(reference) == 1:
        return float(reference[0] - below.min())
    below = below[np.argsort(below[:, -1])]
    heights = np.diff(below[:, -1], append=reference[-1])
    return float(sum(h * hypervolume(below[: k + 1, :-1], reference[:-1]) for k, h in enumerate(heights) if h > 0.0))


def train(out: Path) -> None:
    """Train the policy with the dial, and one for each setting; what is there stays."""
    config = configuration(parse("train", ["--config", str(TRAINING)]))
    for name, chosen in ({"dial": None} | SETTINGS).items():
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
    config = EvaluationConfig("wt_gym/Dial-v1", kwargs, winds, duration=DURATION, skip=SKIP, replay=0.0)
    names = sorted(name for part in PARTS.values() for name in part)
    runs = evaluate({"agent": agent}, config, progress=False).runs
    assert all(run.complete for run in runs)
    return [{name: float(f"{run.metrics[name]:.6g}") for name in names} for run in runs]


def run(out: Path, dial: Path) -> None:
    """Measure all policies and keep the record."""

    def front(folder: Path) -> dict[str, list[float]]:
        """Parts of the cost that a pretraining forecast in its held-out winds, by setting."""
        return TrainedAgent.load(folder).record["pretraining"]["front"]

    folders = {name: out / name.replace(" ", "_") for name in SETTINGS}
    single = {name: front(folder)["own"] for name, folder in folders.items()}
    record = {
        "winds": WINDS, "duration": DURATION, "skip": SKIP, "forecast": {"dial": front(dial), "single": single},
        "base": measured("linear_optimal", {}),
        "dial": {name: measured(str(dial), weights) for name, weights in FRONT_SETTINGS.items()},
        "single": {name: measured(str(folders[name]), weights) for name, weights in SETTINGS.items()},
    }  # fmt: skip
    write_entries(RECORD, record)


def tables(record: dict) -> str:
    """Markdown: parts by setting of both kinds of policies, the hypervolumes, and each part over its own factor."""

    def simulated(kind: str) -> dict[str, NDArray[np.float64]]:
        """Mean parts of the cost over the winds of the simulator, by setting."""
        return {
            name: np.mean([cost_parts(m, b) for m, b in zip(rows, record["base"], strict=True)], axis=0)
            for name, rows in record[kind].items()
        }

    def cell(part: float) -> str:
        return f"{100.0 * part:+.2f} %".replace("-", "−")

    model, single, dial = record["forecast"]["dial"], record["forecast"]["single"], simulated("dial")
    parts = [
        [name, *(cell(part) for pair in zip(model[name], single[name], strict=True) for part in pair)]
        for name in SETTINGS
    ]
    monotony = [
        [name, where, *(cell(points[setting][k]) for setting in (f"little {name}", "equal", name))]
        for k, name in enumerate(PARTS)
        for where, points in (("model", model), ("simulator", dial))
    ]
    return "\n\n".join([
        markdown(["factors", *(f"{part}, {whose} policy" for part in PARTS for whose in ("one", "own"))], parts),
        f"Hypervolume of the one policy over that of the five: {100.0 * covered(model, single):.0f} % on the model, "
        f"{100.0 * covered(dial, simulated('single')):.0f} % in the simulator.",
        markdown(["part of the cost", "where", "factor at a quarter", "equal", "at four times"], monotony),
    ])  # fmt: skip


def main() -> None:
    """Train, measure or show."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", nargs="?", choices=("show", "train", "run"), default="show")
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "dial", help="folder of the policies")
    parser.add_argument("--dial", type=Path, help="folder of the policy with the dial")
    arguments = parser.parse_args()
    if arguments.command == "train":
        train(arguments.out)
        return
    if arguments.command == "run":
        run(arguments.out, arguments.dial or arguments.out / "dial")
    print(tables(read_json(RECORD)))


if __name__ == "__main__":
    main()
