"""The front of linear optimal pitch: improvement of the cost over pitch travel, beside constrained individual pitch.

    python scripts/studies/linear_front.py --folder runs/front                       # designs, runs, table and figure
    python scripts/studies/linear_front.py --folder runs/front --weights 1 4 16 --wind-speed 18

One design for each weight of the travel, all from the same recordings, which stand in the folder. Table and figure:
docs/data/linear_front.csv and .svg. "Cost" is the improvement of the cost of energy of the load-reduction tasks.
"""

import argparse
import csv
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from wt_gym.analysis.results import Wind
from wt_gym.analysis.statistics import relative_change
from wt_gym.base.picture_style import COLORS, INK, LINE_STYLES, MARKERS, SVG, baseline, label_points, plain
from wt_gym.control.controllers.linear_optimal import save_design
from wt_gym.experiment.benchmark_tasks import load_task
from wt_gym.experiment.comparison import ComparisonConfig, run_cases
from wt_gym.learning.linear_design import default_speeds, design
from wt_gym.learning.options import LinearDesignTask
from wt_gym.learning.recording import Recording, RecordingStore
from wt_gym.turbines import load_turbine

ROOT = Path(__file__).resolve().parents[2]
SHOWN = ("captured_power", "blade_flap_del", "tower_fore_aft_del", "tower_side_side_del")
FAMILIES = {"linear_optimal": "linear optimal", "constrained_ipc": "constrained individual pitch"}


def parse_arguments(words=None):
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--turbine", default="nrel_5mw", help="(default: %(default)s)")
    parser.add_argument("--folder", type=Path, help="of recordings and designs")
    parser.add_argument("--draw-only", action="store_true", help="draw the figure again from the table")
    parser.add_argument("--weights", nargs="+", type=float, default=[1.0, 3.0, 8.0, 20.0], help="of the travel")
    parser.add_argument("--speeds", nargs="+", type=float, help="winds of the designs, m/s (default: as wt-gym design)")
    parser.add_argument("--wind-speed", type=float, default=15.0, help="of the runs, m/s (default: %(default)g)")
    parser.add_argument("--seeds", nargs="+", type=int, default=[1001, 1002, 1003, 1004], help="of the runs")
    parser.add_argument(
        "--duration", type=float, default=150.0, help="measured time of a run, s (default: %(default)g)"
    )
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "data", help="folder of table and figure")
    arguments = parser.parse_args(words)
    if arguments.folder is None and not arguments.draw_only:
        parser.error("--folder is required, unless --draw-only")
    return arguments


def designs(arguments, turbine):
    """File of the design of each weight."""
    store = RecordingStore(arguments.folder / "recordings", Recording)
    task = LinearDesignTask(tuple(arguments.speeds or default_speeds(turbine)))
    found = {}
    for weight in arguments.weights:
        path = found[weight] = arguments.folder / f"travel_{weight:g}.npz"
        if not path.exists():
            own = replace(task, feedback=replace(task.feedback, travel_weight=weight))
            save_design(design(turbine, own, store, progress=print), path)
    return found


def rows_of(turbine, controllers, arguments):
    """Mean change of each controller against the first in the same winds, with the standard error of the cost."""
    task = load_task("load-reduction-15")
    cases = [Wind(arguments.wind_speed, seed) for seed in arguments.seeds]
    runs = run_cases(
        turbine, {label: (choice, {}) for label, choice in controllers.items()}, cases,
        ComparisonConfig(duration=arguments.duration), progress=True,
    )  # fmt: skip
    for run in runs:
        if run.failures:
            raise SystemExit(f"{run.name} failed: {next(iter(run.failures.values()))}")
    base, rows = runs[0].metrics, []
    for run in runs:
        cost = [task.improvement(run.metrics[case], base[case]) for case in cases]
        rows.append(
            {
                "wind_speed": arguments.wind_speed,
                "controller": run.name,
                "winds": len(cases),
                "pitch_duty_cycle": np.mean([run.metrics[case]["pitch_duty_cycle"] for case in cases]),
                "cost": np.mean(cost),
                "cost_sem": np.std(cost, ddof=1) / np.sqrt(len(cost)),
            }
        )
        for key in SHOWN:
            rows[-1][key] = np.mean([relative_change(run.metrics[case][key], base[case][key]) for case in cases])
    return rows


def draw(rows, path):
    """Improvement of the cost over the pitch duty cycle."""
    figure = Figure(figsize=(7.4, 4.6), layout="constrained")
    axis = figure.subplots()
    plain(axis, "pitch duty cycle [%]", "improvement of the cost of energy [%]",
          f"{float(rows[0]['wind_speed']):g} m/s, {rows[0]['winds']} winds, bars: standard error")  # fmt: skip
    at, texts, colors = [], [], []
    for k, (start, name) in enumerate(FAMILIES.items()):
        points = [row for row in rows if row["controller"].startswith(start)]
        x, y, error = ([100.0 * float(row[key]) for row in points] for key in ("pitch_duty_cycle", "cost", "cost_sem"))
        setting = points[0]["controller"].partition(", ")[2].rpartition(" ")[0]
        axis.errorbar(x, y, error, marker=MARKERS[k], ls=LINE_STYLES[k], color=COLORS[k], ms=5, lw=1.4, capsize=2,
                      elinewidth=0.8, label=f"{name}, by {setting}")  # fmt: skip
        at += zip(x, y, strict=True)
        texts += [row["controller"].partition(", ")[2] for row in points]
        colors += [COLORS[k]] * len(points)
    others = [row for row in rows if not row["controller"].startswith(tuple(FAMILIES))]
    for row, marker in zip(others, "D*Pv", strict=False):
        place = 100.0 * float(row["pitch_duty_cycle"]), 100.0 * float(row["cost"])
        axis.plot(*place, marker, color=INK, ms=6)
        at.append(place)
        texts.append(f"{row['controller']}, the baseline" if row is rows[0] else row["controller"])
        colors.append(INK)
    baseline(axis, 0.0)
    axis.margins(x=0.15, y=0.1)
    axis.set_xlim(left=0.0)
    axis.legend(frameon=False, fontsize=8, loc="upper left")
    label_points(axis, at, texts, colors)
    with mpl.rc_context({**SVG, "svg.hashsalt": "linear_front"}):
        figure.savefig(path, metadata={"Date": None})


def main(words=None):
    """Design, run, write."""
    arguments = parse_arguments(words)
    table = arguments.out / "linear_front.csv"
    if arguments.draw_only:
        with table.open(newline="", encoding="utf-8") as file:
            draw(list(csv.DictReader(file)), table.with_suffix(".svg"))
        return
    arguments.folder.mkdir(parents=True, exist_ok=True)
    turbine = load_turbine(arguments.turbine)
    controllers = {"discon": "discon", "tuned": "tuned"}
    controllers |= {
        f"linear_optimal, travel weight {weight:g}": f"linear_optimal:file={path}"
        for weight, path in designs(arguments, turbine).items()
    }
    controllers |= {
        f"constrained_ipc, band {level:g}": f"constrained_ipc+side_side_damper:level={level:g}"
        for level in (0.03, 0.1, 0.2)
    }
    rows = rows_of(turbine, controllers, arguments)
    with table.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows({k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()} for row in rows)
    draw(rows, arguments.out / "linear_front.svg")
    print(f"{table}, {table.with_suffix('.svg')}")


if __name__ == "__main__":
    main()
