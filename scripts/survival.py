#!/usr/bin/env python3
"""How many episodes a random policy survives: uniform actions, drawn anew in every step or held for a while.

    scripts/survival.py                                   # 200 episodes of residual fixed-frame actions, 6 to 18 m/s
    scripts/survival.py --env wt_gym/FullRange-v2 --episodes 50

It prints how the episodes ended.
"""

import argparse
import json
from collections import Counter


def parse_arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", default="wt_gym/NREL5MW-Turbulent-v1", help="environment id (default: %(default)s)")
    default = {"action_mode": "residual", "pitch": "fixed-frame", "wind_speed": [6.0, 18.0], "episode_length": 60.0}
    parser.add_argument("--env-kwargs", type=json.loads, metavar="JSON", help=f"by default {json.dumps(default)}")
    parser.add_argument("--episodes", type=int, default=200, help="number of episodes (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of winds and actions (default: %(default)s)")
    arguments = parser.parse_args()
    if arguments.env_kwargs is None:
        arguments.env_kwargs = default if arguments.env == "wt_gym/NREL5MW-Turbulent-v1" else {}
    return arguments


def main() -> None:
    """Play the episodes."""
    arguments = parse_arguments()
    import gymnasium as gym
    import numpy as np

    from wt_gym.commands.program import user_errors

    with user_errors():
        env = gym.make(arguments.env, **arguments.env_kwargs)
    ends = {}
    for held in (1, 25):  # steps; a rate held for 5 s goes to its limit
        rng, counts = np.random.default_rng(arguments.seed), Counter()
        for episode in range((arguments.episodes + 1) // 2):
            env.reset(seed=arguments.seed + episode)
            done, step = False, 0
            while not done:
                if step % held == 0:
                    action = rng.uniform(-1.0, 1.0, env.action_space.shape).astype(np.float32)
                _, _, terminated, truncated, info = env.step(action)
                done, step = terminated or truncated, step + 1
            counts[info.get("termination", "survived")] += 1
        ends[held] = dict(counts)
        print(f"actions held for {held} steps: {ends[held]}", flush=True)


if __name__ == "__main__":
    main()
