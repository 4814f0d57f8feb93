"""Signals, spectra and loads of the published controller, the linear optimum and the best agent, side by side.

    python scripts/studies/good_agent.py             # docs/data/good_agent.svg, table of docs/tutorials/good_agent.md
    python scripts/studies/good_agent.py --jobs 2

Runs are those of `wt-gym evaluate` in two held-out winds of 15 m/s.
"""

import argparse
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from study_pages import DATA, ROOT, TRAINED, markdown, percent, renew, save_svg, signed

from wt_gym.analysis.metrics import LIFETIME_COST_WEIGHTS, mean_spectrum
from wt_gym.analysis.results import Wind
from wt_gym.base.picture_style import COLORS, plain
from wt_gym.experiment.evaluation import EvaluationConfig, evaluate
from wt_gym.learning.linear_design import forecast_change

PAGE = ROOT / "docs" / "tutorials" / "good_agent.md"
AGENTS = {"baseline": "discon", "linear optimum": "linear_optimal", "agent": str(TRAINED / "load_reduction")}
WINDS = (Wind(15.0, 1001), Wind(15.0, 1002))
SPAN = (100.0, 130.0)  # part of the first run that is drawn [s]
SIGNALS = (
    ("root_flap_moment_1", 1e-6, "Flapwise root moment of blade 1 [MN m]"),
    ("pitch_1", 180.0 / np.pi, "Pitch of blade 1 [deg]"),
    ("tower_base_fore_aft_moment", 1e-6, "Fore-aft moment of the tower base [MN m]"),
)
WEIGHTS = {"mean_power" if name == "captured_power" else name: w for name, w in LIFETIME_COST_WEIGHTS.items()}
LOADS = ("blade_flap_del", "tower_fore_aft_del", "tower_side_side_del", "blade_edge_del")


def means(runs):
    """Metrics over the winds, and the rewards of a second by term."""
    metrics = {name: np.mean([run.metrics[name] for run in runs]) for name in runs[0].metrics}
    time = sum(run.duration for run in runs)
    return metrics, {term: sum(run.reward_terms[term] for run in runs) / time for term in runs[0].reward_terms}


def cost(metrics, reference):
    """Change of the cost of energy by the weights of `wt_gym.analysis.metrics.LIFETIME_COST_WEIGHTS`."""
    counted = {name: value for name, value in metrics.items() if name in WEIGHTS}
    return forecast_change(counted, reference, WEIGHTS)


def table(runs):
    """Rows of the quantities, a column for each agent; behind a change is what it earns in a minute."""
    found = {name: means(of) for name, of in runs.items()}
    reference, first = found["baseline"]

    def row(title, quantity, term=None):
        cells = [quantity(metrics) for metrics, _ in found.values()]
        earned = [signed(60.0 * (terms[term] - first[term]), 1) for _, terms in found.values()] if term else cells
        return [title, *(f"{cell} ({gain})" if term else cell for cell, gain in zip(cells, earned, strict=True))]

    def change(name):
        return lambda metrics: percent(metrics[name] / reference[name] - 1.0, 1)

    terms = ("blade_fatigue", "tower_fore_aft_fatigue", "tower_side_side_fatigue", None)
    rows = [row("mean power", change("mean_power"), "power")]
    rows += [row(f"DEL, {_label(name)}", change(name), term) for name, term in zip(LOADS, terms, strict=True)]
    rows.append(row("pitch duty cycle", lambda m: percent(m["pitch_duty_cycle"], 1, plus=False), "actuator_use"))
    total = [60.0 * (sum(terms.values()) - sum(first.values())) for _, terms in found.values()]
    rows.append(["reward of a minute", *(signed(each, 1) for each in total)])
    rows.append(row("cost of energy", lambda m: percent(cost(m, reference), 1)))
    return markdown(["against the baseline (reward of a minute)", *found], rows)


def _label(load):
    """Name of a load in words."""
    return load.removesuffix("_del").replace("fore_aft", "fore-aft").replace("side_side", "side-side").replace("_", " ")


def draw(runs):
    """Signals above, spectra and loads below."""
    figure = Figure(figsize=(9.0, 8.0), layout="constrained")
    axes = figure.subplot_mosaic([[0, 0], [1, 1], [2, 2], ["spectrum", "loads"]], height_ratios=(1, 1, 1, 1.4))
    width = 0.8 / len(runs)
    reference, _ = means(runs["baseline"])
    plain(axes["spectrum"], "frequency [Hz]", title="Spectrum of the flapwise root moment [(MN m)²/Hz]")
    plain(axes["loads"], title="Damage-equivalent loads over those of the baseline")
    for row, (name, factor, title) in enumerate(SIGNALS):
        plain(axes[row], "time [s]" if row == len(SIGNALS) - 1 else "", title=title)
        for (agent, of), color in zip(runs.items(), COLORS, strict=False):
            part = of[0].data.sel(time=slice(*SPAN))
            axes[row].plot(part.time, factor * part[name], color=color, linewidth=1.2, label=agent)
    axes[0].legend(frameon=False, fontsize=8, ncols=3, loc="upper right")
    for k, (of, color) in enumerate(zip(runs.values(), COLORS, strict=False)):
        frequency, density = mean_spectrum([run.data for run in of], "root_flap_moment_1")
        axes["spectrum"].loglog(frequency, 1e-12 * density, color=color, linewidth=1.0)
        metrics, _ = means(of)
        places = np.arange(len(LOADS)) + (k - 1) * width
        axes["loads"].bar(places, [metrics[name] / reference[name] for name in LOADS], width, color=color)
    axes["loads"].set_xticks(range(len(LOADS)), [_label(name).replace(" ", "\n") for name in LOADS])
    return figure


def main():
    """Evaluate, draw and fill in the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--duration", type=float, default=330.0, help="of a run [s]")
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "good_agent", help="folder of the runs")
    arguments = parser.parse_args()
    config = EvaluationConfig(winds=WINDS, duration=arguments.duration, replay=0.0)
    found = evaluate(AGENTS, config, folder=arguments.out).runs
    runs = {agent: [run for run in found if run.agent == agent] for agent in AGENTS}
    save_svg(draw(runs), DATA / "good_agent.svg")
    renew(PAGE, {"good_agent": lambda _: table(runs)})


if __name__ == "__main__":
    main()
