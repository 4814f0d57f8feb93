#!/usr/bin/env python3
"""Train a PPO policy on a wt_gym environment.

Writes the model, the statistics of its rewards, checkpoints and a record of the training into a folder that
scripts/evaluate.py takes.
"""

import argparse
import json


def parse_arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", default="wt_gym/LoadReduction-v0", help="environment id (default: %(default)s)")
    parser.add_argument("--out", default="runs/ppo", help="folder for the results (default: %(default)s)")
    parser.add_argument("--steps", type=int, default=200_000, help="environment steps (default: %(default)s)")
    parser.add_argument("--max-seconds", type=float, help="stop after this wall time")
    parser.add_argument("--n-envs", type=int, default=1, help="environments in parallel (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="seed of policy and environments (default: %(default)s)")
    parser.add_argument(
        "--wind-speed", type=float, nargs="+", metavar="M_S", help="mean wind speed, or the range to draw it from [m/s]"
    )
    parser.add_argument("--episode-length", type=float, help="length of an episode [s]")
    parser.add_argument("--fidelity", help="training, engineering or reference")
    kwargs_help = 'more arguments of the environment, e.g. \'{"pitch": "individual"}\''
    parser.add_argument("--env-kwargs", type=json.loads, default={}, metavar="JSON", help=kwargs_help)
    parser.add_argument("--json", action="store_true", help="print the record of the training as JSON at the end")
    arguments = parser.parse_args()
    if arguments.wind_speed and len(arguments.wind_speed) > 2:
        parser.error("--wind-speed takes one number or two")
    return arguments


def main() -> None:
    """Train."""
    arguments = parse_arguments()
    from agents.command_line import environment_arguments, user_errors
    from agents.train import TrainingConfig, train  # torch takes seconds to import: not for --help

    with user_errors():
        environment_arguments(arguments.env, arguments.env_kwargs)
    kwargs = dict(arguments.env_kwargs)
    if arguments.wind_speed:
        low, *high = arguments.wind_speed
        kwargs["wind_speed"] = (low, high[0]) if high else low
    for name in ("episode_length", "fidelity"):
        if getattr(arguments, name) is not None:
            kwargs[name] = getattr(arguments, name)
    config = TrainingConfig(
        env_id=arguments.env,
        env_kwargs=kwargs,
        total_steps=arguments.steps,
        max_seconds=arguments.max_seconds,
        n_envs=arguments.n_envs,
        seed=arguments.seed,
    )
    with user_errors():
        record = train(config, arguments.out)
    print(f"{record['steps']} steps in {record['wall_seconds']:.0f} s; model and statistics in {arguments.out}")
    if arguments.json:
        print(json.dumps(record, default=str))


if __name__ == "__main__":
    main()
