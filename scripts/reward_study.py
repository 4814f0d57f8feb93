#!/usr/bin/env python3
"""Do the rewards pay for what users want? Reward terms against loads, power and a lifetime cost over many controllers.

    scripts/reward_study.py                                  # from docs/data/reward_study.csv: tables and figure
    scripts/reward_study.py --runs runs/rewards --csv runs/rewards.csv    # simulate anew: 138 runs, 15 min
    scripts/reward_study.py --weights power=1 blade_fatigue=0.8 tower_fore_aft_fatigue=0.4

The runs in the folder stay: after a change of a reward term only the table is made anew. With --json the figures are
printed as one JSON object last.
"""

import argparse
import csv
import itertools
import json
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))


def parse_arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--csv", type=Path, default=ROOT / "docs" / "data" / "reward_study.csv", help="table of runs")
    parser.add_argument(
        "--runs", type=Path, metavar="FOLDER", help="make the table from the runs in this folder; simulate missing ones"
    )
    parser.add_argument(
        "--library", action="store_true", help="with --runs: the controllers of the library too, with the first seed"
    )
    parser.add_argument("--winds", type=float, nargs="+", default=[8.0, 12.0, 16.0], metavar="M_S")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1001, 1002], help="turbulence seeds")
    parser.add_argument("--duration", type=float, default=160.0, help="of a run [s] (default: %(default)s)")
    parser.add_argument("--skip", type=float, default=20.0, help="start left out [s] (default: %(default)s)")
    parser.add_argument("--weights", nargs="+", default=[], metavar="TERM=W", help="other weights than the defaults")
    parser.add_argument("--out", type=Path, help="folder for the figure reward_study.svg")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON at the end")
    return parser.parse_args()


def simulate(arguments: argparse.Namespace) -> None:
    """Run every controller in every wind and write the table; runs that are kept are not simulated again."""
    import numpy as np

    from wt_gym.agents import reward_study as study
    from wt_gym.simulation import Simulator
    from wt_gym.turbines import load_turbine
    from wt_gym.wind import SteadyInflow

    turbine = load_turbine("nrel_5mw")
    simulator = Simulator(turbine, inflow=SteadyInflow(8.0))
    runs = [
        (name, controller, wind, seed)
        for seed in arguments.seeds for wind in arguments.winds for name, controller in study.controllers().items()
    ]  # fmt: skip
    if arguments.library:
        runs += [(name, name, wind, arguments.seeds[0]) for wind in arguments.winds for name in study.LIBRARY]
    rows, started = [], time.monotonic()
    arguments.runs.mkdir(parents=True, exist_ok=True)
    for k, (name, controller, wind, seed) in enumerate(runs, start=1):
        simulator.inflow = study.wind(turbine, wind, seed)
        path = arguments.runs / f"{name.replace(' ', '_')}-{wind:g}-{seed}-{arguments.duration:g}.npy"
        if not path.exists():
            np.save(path, study.simulate(controller, simulator, arguments.duration))
        values = study.evaluate(turbine, simulator.inflow, np.load(path), arguments.skip)
        rows.append({"controller": name, "wind_speed": f"{wind:g}", "seed": seed})
        rows[-1] |= {key: f"{value:.6g}" for key, value in values.items()}
        print(
            f"{k} of {len(runs)} in {time.monotonic() - started:.0f} s: {name}, {wind:g} m/s, seed {seed}", flush=True
        )
    arguments.csv.parent.mkdir(parents=True, exist_ok=True)
    with arguments.csv.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def read(path: Path) -> list[dict]:
    """Rows of the table, numbers as numbers."""
    kinds = {"controller": str, "seed": int}
    with path.open(newline="", encoding="utf-8") as file:
        return [{key: kinds.get(key, float)(value) for key, value in row.items()} for row in csv.DictReader(file)]


def analyze(rows: list[dict], weights: dict[str, float]) -> dict:
    """Correlations of the terms with the loads and of the total with the lifetime cost."""
    from wt_gym.agents import reward_study as study

    first = rows[0]["seed"]
    known = [row for row in rows if row["controller"] not in study.LIBRARY]
    unseen = [row for row in rows if row["controller"] in (study.BASELINE, *study.LIBRARY) and row["seed"] == first]
    runs, lifetimes, library = study.differences(known), study.lifetime(known), study.lifetime(unseen)
    by_seed = {seed: study.lifetime(row for row in known if row["seed"] == seed) for seed in {r["seed"] for r in known}}
    former = study.FORMER_WEIGHTS
    for row in (*runs, *lifetimes, *library, *itertools.chain(*by_seed.values())):
        row["total"], row["former_total"] = study.total_rate(row, weights), study.total_rate(row, former)
    columns = (*study.LOADS, "mean_power", "pitch_duty", "cost")
    winds = sorted({row["wind_speed"] for row in runs})
    rates = [key for key in rows[0] if key in {term.name for term in study.study_terms()}]

    def at_wind(wind: float) -> list[dict]:
        return [row for row in runs if row["wind_speed"] == wind]

    def table(chosen: list[dict]) -> dict:
        return {
            rate: {c: study.correlation([row[rate] for row in chosen], [row[c] for row in chosen]) for c in columns}
            for rate in (*rates, "former_total", "total")
        }

    def against_cost(chosen: list[dict], **factors: float) -> float:
        costs = [
            study.cost(row, {key: w * factors.get(key, 1.0) for key, w in study.COST_WEIGHTS.items()}) for row in chosen
        ]
        return study.correlation([row["total"] for row in chosen], costs)

    def by_task(own: dict[str, float]) -> dict:
        found, compared = {}, ("cost", "mean_power", "power")
        for key, chosen in (("lifetime", lifetimes), *((wind, at_wind(wind)) for wind in winds)):
            totals = [study.total_rate(row, own) for row in chosen]
            found[key] = {c: study.correlation(totals, [row[c] for row in chosen]) for c in compared}
        return found

    def mild(chosen: list[dict]) -> dict:
        kept = sorted(chosen, key=lambda row: row["cost"])[: 2 * len(chosen) // 3 + 1]
        costs = [row["cost"] for row in kept]
        return {"count": len(kept)} | {
            name: study.correlation([row[name] for row in kept], costs) for name in ("total", "former_total")
        }

    return {
        "runs": runs,
        "lifetimes": lifetimes,
        "library": library,
        "by_seed": {seed: against_cost(chosen) for seed, chosen in by_seed.items()},
        "other_weights": {
            f"{name} x {factor:g}": study.correlation(
                [study.total_rate(row, weights | {name: factor * weights[name]}) for row in lifetimes],
                [row["cost"] for row in lifetimes],
            )
            for name in weights
            if weights[name] > 0
            for factor in (0.5, 2.0)
        },
        "with_library": against_cost([*lifetimes, *library]),
        "mild": mild(lifetimes),
        "other_costs": {
            f"{key} x {factor:g}": against_cost(lifetimes, **{key: factor})
            for key in study.COST_WEIGHTS
            for factor in (0.5, 2.0)
        },
        "all_runs": table(runs),
        "by_wind": {wind: table(at_wind(wind)) for wind in winds},
        "lifetime": table(lifetimes),
        "tasks": {name: by_task(own) for name, own in study.task_weights().items()},
    }


def show(result: dict, weights: dict[str, float]) -> None:
    """Print the tables."""
    print(f"weights: {', '.join(f'{name} {weight:g}' for name, weight in weights.items() if weight)}")
    for title, key in (("all runs", "all_runs"), ("lifetime, one point a controller", "lifetime")):
        columns = next(iter(result[key].values()))
        print(f"\nSpearman correlation, {title}\n{'':26s}" + "".join(f"{column:>11s}" for column in columns))
        for rate, values in result[key].items():
            print(f"{rate:26s}" + "".join(f"{value:+11.2f}" for value in values.values()))
    by_wind = ((f"{wind:g} m/s", table["total"]["cost"]) for wind, table in sorted(result["by_wind"].items()))
    by_seed = ((f"seed {seed}", value) for seed, value in sorted(result["by_seed"].items()))
    with_library = ("with the library's", result["with_library"])
    for title, values in (
        ("runs of one wind", by_wind),
        ("lifetimes", (*by_seed, with_library)),
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
    mild = result["mild"]
    print(
        f"\nwithout the costliest, {mild['count']} controllers: {mild['total']:+.2f}, "
        f"reward of the first version {mild['former_total']:+.2f}"
    )
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

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    mpl.rcParams["svg.fonttype"] = "none"
    mpl.rcParams["svg.hashsalt"] = "reward_study"
    figure, axes = plt.subplots(1, 3, figsize=(13, 4.4), layout="constrained")
    plots = (
        ("former_total", "lifetimes", "reward of the first version"),
        ("total", "lifetimes", "default reward"),
        ("total", "runs", "default reward, every run"),
    )
    for axis, (column, kind, title) in zip(axes, plots, strict=True):
        rows = result[kind]
        table = result["lifetime" if kind == "lifetimes" else "all_runs"]
        for wind in sorted({row.get("wind_speed", 0.0) for row in rows}):
            chosen = [row for row in rows if row.get("wind_speed", 0.0) == wind]
            label = f"{wind:g} m/s" if wind else None
            axis.plot([100 * row["cost"] for row in chosen], [row[column] for row in chosen], "o", ms=5, label=label)
        if kind == "lifetimes":
            unseen = result["library"]
            axis.plot([100 * row["cost"] for row in unseen], [row[column] for row in unseen], "x", ms=6, color="0.3")
        if kind == "runs":
            axis.legend(frameon=False)
        axis.set_title(f"{title}: Spearman {table[column]['cost']:+.2f}", fontsize=11)
        axis.set_xlabel("lifetime cost against the baseline [%]")
        axis.axhline(0, color="0.8", lw=0.8, zorder=0)
        axis.axvline(0, color="0.8", lw=0.8, zorder=0)
        axis.spines[["top", "right"]].set_visible(False)
    axes[0].set_ylabel("reward against the baseline [1/s]")
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "reward_study.svg"
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)
    return path


def main() -> int:
    """Simulate if asked to, then analyze."""
    arguments = parse_arguments()
    from wt_gym.envs import rewards

    weights = dict(rewards.DEFAULT_WEIGHTS)
    for given in arguments.weights:
        name, _, value = given.partition("=")
        if name not in weights:
            print(f"there is no reward term {name!r}; there are {', '.join(weights)}", file=sys.stderr)
            return 2
        weights[name] = float(value)
    if arguments.runs is not None:
        simulate(arguments)
    if not arguments.csv.exists():
        print(f"{arguments.csv} does not exist; simulate it with --runs FOLDER", file=sys.stderr)
        return 2
    result = analyze(read(arguments.csv), weights)
    show(result, weights)
    if arguments.out is not None:
        print(f"\nfigure: {draw(result, arguments.out)}")
    if arguments.json:
        print(json.dumps({key: value for key, value in result.items() if key != "runs"}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
