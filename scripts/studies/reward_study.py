"""Do the rewards pay for what users want? Reward terms against loads, power and a lifetime cost over many controllers.

    python scripts/studies/reward_study.py                          # tables and figure
    python scripts/studies/reward_study.py --runs runs/rewards      # a table of runs of the present controllers
    python scripts/studies/reward_study.py --weights power=1 blade_fatigue=0.8 tower_fore_aft_fatigue=0.4

The rate of every reward term at weight 1, averaged over a run, stands beside the damage-equivalent loads, the power and
the actuator use of the same run. All comparisons are differences to the baseline controller in the same wind, so that
the wind's share drops out. The runs in the folder stay: the same command resumes where it was stopped. The record
docs/data/reward_study.csv has controllers that are not in the library; with --out the figure is written.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import spearmanr

from wt_gym.analysis.metrics import LIFETIME_COST_WEIGHTS
from wt_gym.envs import rewards
from wt_gym.tasks import TASKS

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

ROOT = Path(__file__).resolve().parents[2]
RECORD = ROOT / "docs" / "data" / "reward_study.csv"
BASELINE = "baseline"
LIBRARY = (
    "retuned", "tsr_tracking", "ipc", "ipc_2p", "constrained_ipc", "fore_aft_damper", "side_side_damper",
    "tsr_tracking+ipc+tower_dampers",
)  # fmt: skip
"""Controllers of the library on which the weights of the reward were not chosen."""

LOADS = {
    "flap": "blade_flap_del",
    "edge": "blade_edge_del",
    "fore_aft": "tower_fore_aft_del",
    "side_side": "tower_side_side_del",
}
"""Short names of the damage-equivalent loads and their keys in `wt_gym.analysis.metrics.METRICS`."""

_EXPONENTS = {"flap": 10.0, "edge": 10.0, "fore_aft": 4.0, "side_side": 4.0}

RELATIVE = (*LOADS, "mean_power")
"""Columns of which the difference to the baseline is taken relative to it."""

_COST_METRICS = {
    "mean_power": "captured_power",
    **LOADS,
    "pitch_duty": "pitch_duty_cycle",
    "torque_duty": "torque_rate",
}
COST_WEIGHTS = {name: LIFETIME_COST_WEIGHTS[metric] for name, metric in _COST_METRICS.items()}
"""Weights of the lifetime cost by the names of this study; duty cycles count as they are, over their full use."""

FORMER_WEIGHTS = {
    "former_power": 1.0, "tip_deflection": 0.1, "tower_load": 0.2, "actuator_use": 0.1, "overspeed": 0.6,
}  # fmt: skip
"""The reward of the first version, of which only the record has the term of the power."""

_OF_A_DEMAND = ("power_tracking",)
"""Terms that need a power reference, which no run of the study has."""


def parse_arguments(words: list[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--csv", type=Path, help=f"table of runs (default: {RECORD.relative_to(ROOT)}, with --runs that of the folder)"
    )
    parser.add_argument(
        "--runs", type=Path, metavar="FOLDER", help="make the table from the runs in this folder; simulate missing ones"
    )
    parser.add_argument(
        "--controllers", nargs="+", default=LIBRARY, metavar="NAME", help="of wt-gym evaluate (default: %(default)s)"
    )
    parser.add_argument("--winds", type=float, nargs="+", default=[8.0, 12.0, 16.0], metavar="M_S")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1001, 1002], help="turbulence seeds")
    parser.add_argument("--duration", type=float, default=160.0, help="of a run [s] (default: %(default)s)")
    parser.add_argument("--skip", type=float, default=20.0, help="start left out [s] (default: %(default)s)")
    parser.add_argument("--weights", nargs="+", default=[], metavar="TERM=W", help="other weights than the defaults")
    parser.add_argument("--out", type=Path, help="folder for the figure reward_study.svg")
    return parser.parse_args(words)


def measured(arguments: argparse.Namespace) -> list[dict]:
    """Run controllers in every wind; a row a run."""
    from wt_gym.analysis.results import Wind
    from wt_gym.experiment.evaluation import EvaluationConfig, evaluate
    from wt_gym.experiment.names import RESIDUAL_INTERFACE
    from wt_gym.turbines import load_turbine

    most = load_turbine("nrel_5mw").drivetrain.max_torque_rate
    config = EvaluationConfig(
        "wt_gym/NREL5MW-Turbulent-v1",
        {**RESIDUAL_INTERFACE, "reward": {name: float(name not in _OF_A_DEMAND) for name in rewards.DEFAULT_WEIGHTS}},
        tuple(Wind(wind, seed) for seed in arguments.seeds for wind in arguments.winds),
        duration=arguments.duration, skip=arguments.skip, replay=0.0,
    )  # fmt: skip
    table = {BASELINE: "discon"} | {name: name for name in arguments.controllers}
    return [
        {
            "controller": run.agent, "wind_speed": run.wind.speed, "seed": run.wind.seed,
            **{term: total / run.duration for term, total in run.reward_terms.items()},
            **{load: run.metrics[key] for load, key in LOADS.items()},
            "mean_power": run.metrics["mean_power"], "pitch_duty": run.metrics["pitch_duty_cycle"],
            "torque_duty": run.metrics["torque_rate"] / most,
        }
        for run in evaluate(table, config, folder=arguments.runs).runs
    ]  # fmt: skip


def write(rows: list[dict], path: Path) -> None:
    """Write the table."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows({key: f"{v:.6g}" if isinstance(v, float) else v for key, v in row.items()} for row in rows)


def differences(rows: Iterable[Mapping]) -> list[dict]:
    """Differences of every run to the baseline in the same wind.

    Parameters
    ----------
    rows : iterable of mapping
        Columns as `measured` gives them, with ``controller``, ``wind_speed`` and ``seed``; the baseline among them.

    Returns
    -------
    list of dict
        The rows of the other controllers: the columns `RELATIVE` as relative differences, all others, rates and duty
        cycles, as they are subtracted. ``cost`` is the `cost` of the row.

    Raises
    ------
    ValueError
        If the baseline is missing in a wind.
    """
    rows = list(rows)
    baselines = {(row["wind_speed"], row["seed"]): row for row in rows if row["controller"] == BASELINE}
    result = []
    for row in rows:
        wind = row["wind_speed"], row["seed"]
        if wind not in baselines:
            raise ValueError(f"there is no run of the baseline at {wind[0]:g} m/s with seed {wind[1]}")
        if row["controller"] != BASELINE:
            result.append(_difference(row, baselines[wind]))
    return result


def _difference(row: Mapping, base: Mapping) -> dict:
    """Row less baseline, with its cost."""
    labels = ("controller", "wind_speed", "seed")
    change = {key: row[key] for key in labels if key in row}
    change |= {key: row[key] - base[key] for key in row if key not in labels}
    change |= {key: change[key] / base[key] for key in RELATIVE}
    return change | {"cost": cost(change)}


def cost(change: Mapping[str, float], weights: Mapping[str, float] | None = None) -> float:
    """Relative change of the cost of energy by differences to the baseline, by default with `COST_WEIGHTS` [-]."""
    return sum(weight * change[key] for key, weight in (COST_WEIGHTS if weights is None else weights).items())


def total_rate(row: Mapping[str, float], weights: Mapping[str, float] | None = None) -> float:
    """Sum of the terms of a row with weights, by default `rewards.DEFAULT_WEIGHTS` [1/s]."""
    weights = rewards.DEFAULT_WEIGHTS if weights is None else weights
    return sum(weight * row[name] for name, weight in weights.items() if weight)  # others may not be recorded


def task_weights() -> dict[str, dict[str, float]]:
    """Weights of the reward of each task that changes them and is in the study's operation.

    That is turbulence of one mean, without a power that is demanded from outside.
    """
    given = {
        name: task.arguments.get("reward", {})
        for name, task in TASKS.items()
        if task.arguments["inflow"] == "turbulent" and "power_reference" not in task.arguments
    }
    return {name: rewards.DEFAULT_WEIGHTS | changed for name, changed in given.items() if changed}


def lifetime(rows: Iterable[Mapping], mean_wind: float = 10.0) -> list[dict]:
    """What each controller amounts to over the winds of a site, as differences to the baseline.

    Wind speeds follow the Rayleigh distribution of IEC 61400-1; each one simulated stands for the speeds nearer to it
    than to its neighbors, from 3 to 25 m/s. Means are weighted with that probability p, damage-equivalent loads by
    their damage: ``(sum p DEL^m)^(1/m)``.

    Parameters
    ----------
    rows : iterable of mapping
        As for `differences`.
    mean_wind : float
        Annual mean of the wind speed at hub height, 10 m/s for class I [m/s].

    Returns
    -------
    list of dict
        As `differences`, one row a controller.
    """
    rows = list(rows)
    winds = sorted({row["wind_speed"] for row in rows})
    edges = [3.0, *((low + high) / 2 for low, high in itertools.pairwise(winds)), 25.0]
    beyond = [math.exp(-math.pi / 4 * (edge / mean_wind) ** 2) for edge in edges]
    probability = {wind: low - high for wind, (low, high) in zip(winds, itertools.pairwise(beyond), strict=True)}
    whole = sum(probability.values())
    sums = {}
    for name in dict.fromkeys(row["controller"] for row in rows):
        own = [row for row in rows if row["controller"] == name]
        count = {wind: sum(row["wind_speed"] == wind for row in own) for wind in winds}
        share = [probability[row["wind_speed"]] / whole / count[row["wind_speed"]] for row in own]
        if not math.isclose(sum(share), 1.0):
            raise ValueError(f"controller {name!r} has no run in some of the winds {winds}")
        sums[name] = {"controller": name}
        for key in own[0].keys() - {"controller", "wind_speed", "seed"}:
            exponent = _EXPONENTS.get(key, 1.0)
            mean = sum(p * row[key] ** exponent for p, row in zip(share, own, strict=True))
            sums[name][key] = mean ** (1.0 / exponent) if key in _EXPONENTS else mean
    return [_difference(row, sums[BASELINE]) for name, row in sums.items() if name != BASELINE]


def correlation(first: Iterable[float], second: Iterable[float]) -> float:
    """Spearman's rank correlation of two columns; NaN where one of them is constant."""
    first, second = np.array(list(first)), np.array(list(second))
    if np.ptp(first) == 0.0 or np.ptp(second) == 0.0:
        return math.nan
    return float(spearmanr(first, second).statistic)


def read(path: Path) -> list[dict]:
    """Rows of the table, numbers as numbers."""
    kinds = {"controller": str, "seed": int}
    with path.open(newline="", encoding="utf-8") as file:
        return [{key: kinds.get(key, float)(value) for key, value in row.items()} for row in csv.DictReader(file)]


def analyze(rows: list[dict], weights: dict[str, float]) -> dict:
    """Correlations of the terms with the loads and of the total with the lifetime cost."""
    first = rows[0]["seed"]
    # on the record the library is apart from the controllers that the weights were chosen on
    apart = LIBRARY if {row["controller"] for row in rows} - {BASELINE, *LIBRARY} else ()
    known = [row for row in rows if row["controller"] not in apart]
    unseen = [row for row in rows if row["controller"] in (BASELINE, *apart) and row["seed"] == first]
    runs, lifetimes, library = differences(known), lifetime(known), lifetime(unseen)
    recorded = "former_power" in rows[0]
    for row in (*runs, *lifetimes, *library):
        row["total"] = total_rate(row, weights)
        row["former_total"] = total_rate(row, FORMER_WEIGHTS) if recorded else math.nan
    columns = (*LOADS, "mean_power", "pitch_duty", "cost")
    winds = sorted({row["wind_speed"] for row in runs})
    others = {"controller", "wind_speed", "seed", *LOADS, "mean_power", "pitch_duty", "torque_duty"}
    rates = [key for key in rows[0] if key not in others]

    def at_wind(wind: float) -> list[dict]:
        return [row for row in runs if row["wind_speed"] == wind]

    def table(chosen: list[dict]) -> dict:
        return {
            rate: {c: correlation([row[rate] for row in chosen], [row[c] for row in chosen]) for c in columns}
            for rate in (*rates, "former_total", "total")
        }

    def against_cost(chosen: list[dict], **factors: float) -> float:
        costs = [cost(row, {key: w * factors.get(key, 1.0) for key, w in COST_WEIGHTS.items()}) for row in chosen]
        return correlation([row["total"] for row in chosen], costs)

    def by_task(own: dict[str, float]) -> dict:
        found, compared = {}, ("cost", "mean_power", "power")
        for key, chosen in (("lifetime", lifetimes), *((wind, at_wind(wind)) for wind in winds)):
            totals = [total_rate(row, own) for row in chosen]
            found[key] = {c: correlation(totals, [row[c] for row in chosen]) for c in compared}
        return found

    return {
        "runs": runs,
        "lifetimes": lifetimes,
        "library": library,
        "other_weights": {
            f"{name} x {factor:g}": correlation(
                [total_rate(row, weights | {name: factor * weights[name]}) for row in lifetimes],
                [row["cost"] for row in lifetimes],
            )
            for name in weights
            if weights[name] > 0
            for factor in (0.5, 2.0)
        },
        "other_costs": {
            f"{key} x {factor:g}": against_cost(lifetimes, **{key: factor})
            for key in COST_WEIGHTS
            for factor in (0.5, 2.0)
        },
        "all_runs": table(runs),
        "lifetime": table(lifetimes),
        "tasks": {name: by_task(own) for name, own in task_weights().items()},
    }


def show(result: dict, weights: dict[str, float]) -> None:
    """Print the tables."""
    print(f"weights: {', '.join(f'{name} {weight:g}' for name, weight in weights.items() if weight)}")
    for title, key in (("all runs", "all_runs"), ("lifetime, one point a controller", "lifetime")):
        columns = next(iter(result[key].values()))
        print(f"\nSpearman correlation, {title}\n{'':26s}" + "".join(f"{column:>11s}" for column in columns))
        for rate, values in result[key].items():
            print(f"{rate:26s}" + "".join(f"{value:+11.2f}" for value in values.values()))
    for title, values in (
        ("lifetimes, other weights in the cost", result["other_costs"].items()),
        ("lifetimes, other weights in the reward", result["other_weights"].items()),
    ):
        print(f"\ntotal against cost, {title}: " + ", ".join(f"{value:+.2f} {label}" for label, value in values))
    print("\nSpearman correlation of the reward of each task with cost, energy and the term power")
    for name, found in result["tasks"].items():
        values = (
            " ".join((kind if isinstance(kind, str) else f"{kind:g} m/s", *(f"{v:+.2f}" for v in with_them.values())))
            for kind, with_them in found.items()
        )
        print(f"{name:26s}" + ", ".join(values))
    columns = ("flap", "edge", "fore_aft", "side_side", "mean_power", "pitch_duty", "cost")
    for title, key in (("varied", "lifetimes"), ("of the library, first seed", "library")):
        print(
            f"\nLifetime of the controllers {title}: differences to the baseline in per cent (duty cycle: of full use)"
        )
        print(f"{'':32s}" + "".join(f"{column:>11s}" for column in columns) + f"{'total [1/s]':>13s}")
        for row in sorted(result[key], key=lambda row: row["cost"]):
            values = "".join(f"{100 * row[column]:+11.2f}" for column in columns)
            print(f"{row['controller']:32s}{values}{row['total']:+13.4f}")


def draw(result: dict, folder: Path) -> Path:
    """Reward against cost, each run and each controller's lifetime."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    from wt_gym.base.picture_style import COLORS, INK, MARKERS, SVG, baseline, plain

    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    plots = (
        ("former_total", "lifetimes", "earlier weights"),
        ("total", "lifetimes", "default reward"),
        ("total", "runs", "default reward, every run"),
    )
    for axis, (column, kind, title) in zip(figure.subplots(1, 3), plots, strict=True):
        rows = result[kind]
        table = result["lifetime" if kind == "lifetimes" else "all_runs"]
        winds = sorted({row.get("wind_speed", 0.0) for row in rows})
        for k, wind in enumerate(winds):
            chosen = [row for row in rows if row.get("wind_speed", 0.0) == wind]
            axis.plot(
                [100 * row["cost"] for row in chosen], [row[column] for row in chosen], MARKERS[k % len(MARKERS)], ms=4,
                color=COLORS[k % len(COLORS)], alpha=0.75, label=f"{wind:g} m/s" if wind else "varied controllers",
            )  # fmt: skip
        if kind == "lifetimes":
            unseen = result["library"]
            axis.plot([100 * row["cost"] for row in unseen], [row[column] for row in unseen], "x", ms=6, color=INK,
                      label="controllers of the library")  # fmt: skip
        plain(axis, "lifetime cost against the baseline [%]", "",
              f"{title}: Spearman {table[column]['cost']:+.2f}".replace("-", "−"))  # fmt: skip
        baseline(axis, 0.0, "baseline")
        baseline(axis, 0.0, vertical=True)
        axis.legend(frameon=False, fontsize=8)
    figure.axes[0].set_ylabel("reward against the baseline [1/s]", fontsize=9, color=INK)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "reward_study.svg"
    with mpl.rc_context({**SVG, "svg.hashsalt": "reward_study"}):
        figure.savefig(path, metadata={"Date": None})
    return path


def main() -> int:
    """Simulate if asked to, then analyze."""
    arguments = parse_arguments()
    weights = dict(rewards.DEFAULT_WEIGHTS)
    for given in arguments.weights:
        name, _, value = given.partition("=")
        if name not in weights:
            print(f"there is no reward term {name!r}; there are {', '.join(weights)}", file=sys.stderr)
            return 2
        weights[name] = float(value)
    path = arguments.csv or (arguments.runs / RECORD.name if arguments.runs else RECORD)
    if arguments.runs is not None:
        write(measured(arguments), path)
    if not path.exists():
        print(f"{path} does not exist; simulate it with --runs FOLDER", file=sys.stderr)
        return 2
    result = analyze(read(path), weights)
    show(result, weights)
    if arguments.out is not None:
        print(f"\nfigure: {draw(result, arguments.out)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
