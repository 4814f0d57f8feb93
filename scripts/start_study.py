#!/usr/bin/env python3
"""Fatigue terms of the first minute of episodes over those of the turbine that has run in the same wind for minutes.

    scripts/start_study.py                                # NREL 5-MW, 6 winds x 8 starts at 12, 15 and 18 m/s
    scripts/start_study.py --start steady
    scripts/start_study.py --winds 60 --starts 2 --settled 1     # side-side motion differs much from wind to wind

A start is physical where the ratios are one: less tells of a turbine that has to be excited first, more of a jolt. The
settled turbine runs in the same wind from five minutes before, under the base controller and from several azimuths of
the rotor, since they decide on the phase of its side-side motion.
"""

import argparse
import itertools
import json
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from multiprocessing import get_context
from typing import Any

import use_venv  # noqa: F401 - finds packages and interpreter

import numpy as np

TERMS = ("blade_fatigue", "tower_fore_aft_fatigue", "tower_side_side_fatigue")
LENGTH, SETTLING = 60.0, 300.0
"""Length of the compared time, and time before it [s]."""
WIND_SEED = 8_500_000
"""First seed of the winds, a thousand for each m/s."""
DRAWS = 1000
"""Draws of winds from those that were compared, of which the standard error is."""


def parse_arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", default="wt_gym/LoadReduction-v2", help="environment id (default: %(default)s)")
    parser.add_argument("--env-kwargs", type=json.loads, default={}, metavar="JSON", help="arguments on top")
    parser.add_argument("--wind-speeds", type=float, nargs="+", default=[12.0, 15.0, 18.0], help="[m/s]")
    parser.add_argument("--winds", type=int, default=6, help="at a wind speed (default: %(default)s)")
    parser.add_argument("--starts", type=int, default=8, help="in a wind (default: %(default)s)")
    parser.add_argument("--settled", type=int, default=4, help="settled runs in a wind (default: %(default)s)")
    parser.add_argument("--start", choices=("running", "steady"), default="running", help="default: %(default)s")
    parser.add_argument("--processes", type=int, default=2, help="default: %(default)s")
    return parser.parse_args()


@cache
def environment(name: str, options: str, start: str) -> Any:
    """Environment without the twin of relative rewards."""
    import gymnasium as gym

    import wt_gym  # noqa: F401 - registers the environments

    return gym.make(name, **json.loads(options), start=start, relative_reward=False, starts=None).unwrapped


def fatigue(job: tuple[Any, ...]) -> np.ndarray:
    """Sum of each term over the compared time of one run (n_terms,)."""
    name, options, start, speed, seed, number, settling = job
    env = environment(name, options, start)
    env.reset(seed=number, options={"wind_speed": speed, "wind_seed": seed, "time_offset": -settling})
    action, dt, total = np.zeros(env.action_space.shape, np.float32), env.control_dt, np.zeros(len(TERMS))
    for step in range(round((settling + LENGTH) / dt)):
        _, _, terminated, _, info = env.step(action)
        if terminated:
            raise RuntimeError(f"the turbine stops in {job}: {info}")
        if step >= round(settling / dt):
            total += [info["reward_terms"][name] for name in TERMS]
    return total


def main() -> None:
    """Compare."""
    arguments = parse_arguments()
    common = arguments.env, json.dumps(arguments.env_kwargs)
    sums = {}
    with ProcessPoolExecutor(arguments.processes, mp_context=get_context("spawn")) as pool:
        for speed in arguments.wind_speeds:
            seeds = [WIND_SEED + 1000 * round(speed) + k for k in range(arguments.winds)]
            places = list(itertools.product(seeds, range(arguments.starts)))
            first = pool.map(fatigue, [(*common, arguments.start, speed, *place, 0.0) for place in places])
            places = list(itertools.product(seeds, range(arguments.settled)))
            settled = pool.map(fatigue, [(*common, "steady", speed, *place, SETTLING) for place in places])
            first = np.array(list(first)).reshape(len(seeds), -1, len(TERMS)).mean(axis=1)
            settled = np.array(list(settled)).reshape(len(seeds), -1, len(TERMS)).mean(axis=1)
            sums[speed] = first, settled
            _print(f"{speed:g} m/s", *sums[speed])
    _print("all", *(np.concatenate([one[k] for one in sums.values()]) for k in range(2)))


def _print(label: str, first: np.ndarray, settled: np.ndarray) -> None:
    """Ratios of the sums over winds (n_winds, n_terms), with standard errors over draws of the winds."""
    ratios, n = first.sum(axis=0) / settled.sum(axis=0), len(first)
    drawn = np.random.default_rng(0).integers(n, size=(DRAWS, n))
    errors = (first[drawn].sum(axis=1) / settled[drawn].sum(axis=1)).std(axis=0)
    parts = [f"{name} {r:.2f} +- {e:.2f}" for name, r, e in zip(TERMS, ratios, errors, strict=True)]
    print(f"{label}: {', '.join(parts)}", flush=True)


if __name__ == "__main__":
    main()
