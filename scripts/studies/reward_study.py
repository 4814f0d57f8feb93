"""Do the rewards pay for what users want? Reward terms against loads, power and a lifetime cost over many controllers.

    python scripts/studies/reward_study.py                          # tables and figure
    python scripts/studies/reward_study.py --runs runs/rewards      # a table of runs of the current controllers
    python scripts/studies/reward_study.py --weights power=1 blade_fatigue=0.8 tower_fore_aft_fatigue=0.4

The rate of every reward term at weight 1, averaged over a run, stands beside the damage-equivalent loads, the power and
the actuator use of the same run. All comparisons are differences to the baseline controller in the same wind, so that
the wind's share drops out. The runs in the folder stay: the same command resumes where it was stopped. The record
docs/data/reward_study.csv has controllers that are not in the library; with --out the figure is written.
"""

import argparse
import math
import sys
from collections.abc import Mapping
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure
from study_pages import DATA, ROOT, save_svg

from wt_gym.analysis.metrics import LIFETIME_COST_WEIGHTS
from wt_gym.analysis.results import Wind
from wt_gym.analysis.statistics import LIFETIME_EXPONENTS, WindClimate, lifetime_load, wind_weights
from wt_gym.base.picture_style import COLORS, INK, MARKERS, baseline, plain
from wt_gym.envs import rewards
from wt_gym.experiment.evaluation import EvaluationConfig, evaluate
from wt_gym.experiment.names import RESIDUAL_INTERFACE
from wt_gym.tasks import TASKS
from wt_gym.turbines import load_turbine

RECORD = DATA / "reward_study.csv"
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
RELATIVE = [*LOADS, "mean_power"]
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
_LABELS = ["controller", "wind_speed", "seed"]
_OF_OTHERS = ("power_tracking", "platform_motion")
"""Terms that need a power reference or a platform, which no run of the study has."""


def parse_arguments(words: list[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--csv", type=Path, default=RECORD, help=f"table of runs ({RECORD.relative_to(ROOT)})")
    parser.add_argument("--runs", type=Path, metavar="FOLDER", help="take the runs in this folder; make missing ones")
    parser.add_argument("--controllers", nargs="+", default=LIBRARY, metavar="NAME", help="(default: %(default)s)")
    parser.add_argument("--winds", type=float, nargs="+", default=[8.0, 12.0, 16.0], metavar="M_S")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1001, 1002], help="turbulence seeds")
    parser.add_argument("--duration", type=float, default=160.0, help="of a run [s] (default: %(default)s)")
    parser.add_argument("--skip", type=float, default=20.0, help="start left out [s] (default: %(default)s)")
    parser.add_argument("--weights", nargs="+", default=[], metavar="TERM=W", help="other weights than the defaults")
    parser.add_argument("--out", type=Path, help="folder for the figure reward_study.svg")
    return parser.parse_args(words)


def measured(arguments: argparse.Namespace) -> pd.DataFrame:
    """Run controllers in every wind; a row a run."""
    most = load_turbine("nrel_5mw").drivetrain.max_torque_rate
    config = EvaluationConfig(
        "wt_gym/NREL5MW-Turbulent-v1",
        {**RESIDUAL_INTERFACE, "reward": {name: float(name not in _OF_OTHERS) for name in rewards.DEFAULT_WEIGHTS}},
        tuple(Wind(wind, seed) for seed in arguments.seeds for wind in arguments.winds),
        duration=arguments.duration, skip=arguments.skip, replay=0.0,
    )  # fmt: skip
    agents = {BASELINE: "discon"} | {name: name for name in arguments.controllers}
    return pd.DataFrame(
        {
            "controller": run.agent, "wind_speed": run.wind.speed, "seed": run.wind.seed,
            **{term: total / run.duration for term, total in run.reward_terms.items()},
            **{load: run.metrics[key] for load, key in LOADS.items()},
            "mean_power": run.metrics["mean_power"], "pitch_duty": run.metrics["pitch_duty_cycle"],
            "torque_duty": run.metrics["torque_rate"] / most,
        }
        for run in evaluate(agents, config, folder=arguments.runs).runs
    )  # fmt: skip


def differences(table: pd.DataFrame) -> pd.DataFrame:
    """Differences of every run to the baseline in the same wind.

    Parameters
    ----------
    table : pandas.DataFrame
        Columns as `measured` gives them; the baseline among the controllers.

    Returns
    -------
    pandas.DataFrame
        The rows of the other controllers: the columns `RELATIVE` as relative differences, all others, rates and duty
        cycles, as they are subtracted. ``cost`` is the `cost` of the row.

    Raises
    ------
    ValueError
        If the baseline is missing in a wind.
    """
    wind = ["wind_speed", "seed"]
    base = table[table["controller"] == BASELINE].set_index(wind).drop(columns="controller")
    others = table[table["controller"] != BASELINE].set_index([*wind, "controller"])
    for speed, seed in others.index.droplevel("controller").difference(base.index):
        raise ValueError(f"there is no run of the baseline at {speed:g} m/s with seed {seed}")
    return _difference(others, base.loc[others.index.droplevel("controller")]).reset_index()


def _difference(values: pd.DataFrame, base: pd.DataFrame) -> pd.DataFrame:
    """Values less those of the baseline, row by row, with their cost."""
    change = values - base.to_numpy()
    change[RELATIVE] /= base[RELATIVE].to_numpy()
    return change.assign(cost=weighted(change, COST_WEIGHTS))


def weighted(table: pd.DataFrame, weights: Mapping[str, float]) -> pd.Series:
    """Sum of the columns of a table by weights; others may not be recorded."""
    return sum(weight * table[name] for name, weight in weights.items() if weight)


def task_weights() -> dict[str, dict[str, float]]:
    """Weights of the reward of each task that changes them and is in the study's operation.

    That is turbulence of one mean, on the ground, without a power that is demanded from outside.
    """
    changes = {
        name: task.arguments.get("reward", {})
        for name, task in TASKS.items()
        if task.arguments["inflow"] == "turbulent" and not task.arguments.keys() & {"power_reference", "sea"}
    }
    return {name: rewards.DEFAULT_WEIGHTS | changed for name, changed in changes.items() if changed}


def lifetime(table: pd.DataFrame, mean_wind: float = 10.0) -> pd.DataFrame:
    """Differences of each controller to the baseline over the winds of a site.

    Wind speeds follow the Rayleigh distribution of IEC 61400-1; each one simulated stands for the speeds nearer to it
    than to its neighbors, from 3 to 25 m/s. Means are weighted with that probability p, damage-equivalent loads by
    their damage: ``(sum p DEL^m)^(1/m)``.

    Parameters
    ----------
    table : pandas.DataFrame
        As for `differences`.
    mean_wind : float
        Annual mean of the wind speed at hub height, 10 m/s for class I [m/s].

    Returns
    -------
    pandas.DataFrame
        As `differences`, one row a controller.
    """
    winds = sorted(table["wind_speed"].unique())
    probability = dict(zip(winds, wind_weights(WindClimate(mean_wind), winds), strict=True))
    rows = {}
    for name, own in table.groupby("controller", sort=False):
        counts = own["wind_speed"].value_counts()
        if len(counts) < len(winds):
            raise ValueError(f"controller {name!r} has no run in some of the winds {winds}")
        share = own["wind_speed"].map(lambda wind, counts=counts: probability[wind] / counts[wind]).to_numpy()
        rows[name] = {
            key: float(lifetime_load(values, share, LIFETIME_EXPONENTS[LOADS[key]]) if key in LOADS else share @ values)
            for key, values in own.drop(columns=_LABELS).items()
        }
    sums = pd.DataFrame.from_dict(rows, orient="index").rename_axis("controller")
    return _difference(sums.drop(BASELINE), sums.loc[[BASELINE]]).reset_index()


def correlation(first: pd.Series, second: pd.Series) -> float:
    """Spearman's rank correlation of two columns; NaN where one of them is constant."""
    return math.nan if first.nunique() == 1 or second.nunique() == 1 else float(first.corr(second, "spearman"))


def against_cost(table: pd.DataFrame, weights: Mapping[str, float] = rewards.DEFAULT_WEIGHTS) -> float:
    """Correlation of a reward with the lifetime cost."""
    return correlation(weighted(table, weights), table["cost"])


def analyze(table: pd.DataFrame, weights: dict[str, float]) -> dict:
    """Differences and lifetimes with their rewards, and correlations."""
    # on the record the library is apart from the controllers that the weights were chosen on
    unseen = table["controller"].isin(LIBRARY if set(table["controller"]) - {BASELINE, *LIBRARY} else ())
    base, first = table["controller"] == BASELINE, table["seed"] == table["seed"].iloc[0]
    result = {
        "runs": differences(table[~unseen]),
        "lifetimes": lifetime(table[~unseen]),
        "library": lifetime(table[(base | unseen) & first]),
    }
    for frame in result.values():
        frame["former_total"] = weighted(frame, FORMER_WEIGHTS) if "former_power" in frame else math.nan
        frame["total"] = weighted(frame, weights)
    return result


def correlations(table: pd.DataFrame) -> pd.DataFrame:
    """Spearman correlations of the rates and of both rewards with the columns that users want."""
    columns = [*LOADS, "mean_power", "pitch_duty", "cost"]
    rates = [name for name in table.columns if name not in {*_LABELS, *columns, "torque_duty"}]
    return pd.DataFrame({c: {rate: correlation(table[rate], table[c]) for rate in rates} for c in columns})


def sensitivities(table: pd.DataFrame, weights: dict[str, float]) -> pd.Series:
    """Correlations of reward and cost with half and twice each weight of either."""
    found = {}
    for factor in (0.5, 2.0):
        for name, weight in weights.items():
            if weight > 0.0:
                found[f"{name} x {factor:g} in the reward"] = against_cost(table, weights | {name: factor * weight})
        for name, weight in COST_WEIGHTS.items():
            cost = weighted(table, COST_WEIGHTS | {name: factor * weight})
            found[f"{name} x {factor:g} in the cost"] = correlation(table["total"], cost)
    return pd.Series(found)


def of_tasks(runs: pd.DataFrame, lifetimes: pd.DataFrame) -> pd.DataFrame:
    """Correlations of the reward of each task with cost, energy and the term power, over a life and in single winds."""
    tables = {"lifetime": lifetimes} | {f"{wind:g} m/s": rows for wind, rows in runs.groupby("wind_speed")}
    return pd.DataFrame({
        task: {
            f"{column}, {place}": correlation(weighted(table, weights), table[column])
            for place, table in tables.items()
            for column in ("cost", "mean_power", "power")
        }
        for task, weights in task_weights().items()
    }).T  # fmt: skip


def show(result: dict, weights: dict[str, float]) -> None:
    """Print the tables."""
    runs, lifetimes = result["runs"], result["lifetimes"]
    columns = ["flap", "edge", "fore_aft", "side_side", "mean_power", "pitch_duty", "cost"]

    def of_lives(table: pd.DataFrame) -> pd.DataFrame:
        rows = table.set_index("controller").sort_values("cost")
        return (100.0 * rows[columns]).assign(**{"1000 x total": 1000.0 * rows["total"]})

    for title, table in (
        ("weights", pd.Series(weights)),
        ("Spearman correlation, all runs", correlations(runs)),
        ("Spearman correlation, lifetime, one point a controller", correlations(lifetimes)),
        ("Spearman correlation of reward and cost over the lifetimes, with other weights",
         sensitivities(lifetimes, weights)),
        ("Spearman correlation of the reward of each task with cost, energy and the term power",
         of_tasks(runs, lifetimes)),
        ("Lifetime of the varied controllers: differences to the baseline in per cent (duty cycle: of full use)",
         of_lives(lifetimes)),
        ("The same of the library, first seed", of_lives(result["library"])),
    ):  # fmt: skip
        print(f"\n{title}\n{table.to_string(float_format='{:+.2f}'.format)}")


def draw(result: dict, folder: Path) -> Path:
    """Reward against cost, each run and each controller's lifetime."""
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    plots = (
        ("former_total", "lifetimes", "earlier weights"),
        ("total", "lifetimes", "default reward"),
        ("total", "runs", "default reward, every run"),
    )
    for axis, (column, kind, title) in zip(figure.subplots(1, 3), plots, strict=True):
        table = result[kind]
        winds = dict(list(table.groupby("wind_speed"))) if kind == "runs" else {0.0: table}
        for (wind, rows), marker, color in zip(winds.items(), MARKERS, COLORS, strict=False):
            axis.plot(100 * rows["cost"], rows[column], marker, ms=4, color=color, alpha=0.75,
                      label=f"{wind:g} m/s" if wind else "varied controllers")  # fmt: skip
        if kind == "lifetimes":
            unseen = result["library"]
            axis.plot(100 * unseen["cost"], unseen[column], "x", ms=6, color=INK, label="controllers of the library")
        figure_of = correlation(table[column], table["cost"])
        plain(axis, "lifetime cost against the baseline [%]", "",
              f"{title}: Spearman {figure_of:+.2f}".replace("-", "−"))  # fmt: skip
        baseline(axis, 0.0, "baseline")
        baseline(axis, 0.0, vertical=True)
        axis.legend(frameon=False, fontsize=8)
    figure.axes[0].set_ylabel("reward against the baseline [1/s]", fontsize=9, color=INK)
    return save_svg(figure, folder / "reward_study.svg")


def main() -> int:
    """Simulate if asked to, then analyze."""
    arguments = parse_arguments()
    weights = dict(rewards.DEFAULT_WEIGHTS)
    for text in arguments.weights:
        name, _, value = text.partition("=")
        if name not in weights:
            print(f"there is no reward term {name!r}; there are {', '.join(weights)}", file=sys.stderr)
            return 2
        weights[name] = float(value)
    result = analyze(measured(arguments) if arguments.runs else pd.read_csv(arguments.csv), weights)
    show(result, weights)
    if arguments.out is not None:
        print(f"\nfigure: {draw(result, arguments.out)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
