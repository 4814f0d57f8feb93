"""Test the model of train_sb3.py in held-out winds, beside the controllers that it has to beat.

    python agents/evaluate_sb3.py                      # runs/sb3/model.zip
    python agents/evaluate_sb3.py runs/other/model.zip --winds 12

All agents meet the same turbulence, of seeds that no training draws, from the same start. Each metric is compared in
the same wind, which removes most of the variance of the wind; the mean change has a 95 % interval over the winds.
"""

import argparse

from wt_gym.analysis.metrics import METRICS
from wt_gym.analysis.results import Wind
from wt_gym.analysis.statistics import paired_change
from wt_gym.envs.wind_sampler import EVALUATION_WIND_SEEDS
from wt_gym.experiment.evaluation import EvaluationConfig, evaluate

SHOWN = ("blade_flap_del", "tower_fore_aft_del", "tower_side_side_del", "mean_power", "pitch_travel")


def main():
    """Run all agents in all winds, and print the changes against the baseline."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", nargs="?", default="runs/sb3/model.zip", help="(default: %(default)s)")
    parser.add_argument("--winds", type=int, default=6, help="at each of 15 and 18 m/s (default: %(default)s)")
    parser.add_argument("--duration", type=float, default=180.0, help="of a run, s (default: %(default)s)")
    arguments = parser.parse_args()
    agents = {  # the first is the baseline; model.json beside the model has its base controller
        "discon": "discon", "zero actions": "discon+side_side_damper", "ipc": "ipc",
        "linear_optimal": "linear_optimal", "PPO": arguments.model,
    }  # fmt: skip
    winds = tuple(Wind(speed, seed) for speed in (15.0, 18.0) for seed in EVALUATION_WIND_SEEDS[: arguments.winds])
    config = EvaluationConfig(
        "wt_gym/LoadReduction-v3", {}, winds, duration=arguments.duration,
        skip=min(30.0, arguments.duration / 3), replay=0.0,
    )  # fmt: skip
    evaluation = evaluate(agents, config)
    print(f"changes against {evaluation.baseline} in {len(winds)} winds of {arguments.duration:g} s, 95 % intervals")
    for agent in list(agents)[1:]:
        for key in SHOWN:
            change = paired_change(evaluation, agent, key)
            if change is None:
                print(f"{agent}: no run lasted")
                break
            factor, unit = (100.0, "%") if change.relative else (1.0, METRICS[key].unit)
            value, low, high = (factor * x for x in (change.value, change.low, change.high))
            print(f"{agent:14s} {METRICS[key].label:30s} {value:+6.1f} [{low:+.1f}, {high:+.1f}] {unit}")


if __name__ == "__main__":
    main()
