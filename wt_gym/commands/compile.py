"""Compile the simulator of environments, in two processes, so that no later run has to wait for it.

    wt-gym compile
    wt-gym compile wt_gym/LoadReduction-v3 wt_gym/IEA15MW-Turbulent-v2

Compiled kernels stay in the cache (NUMBA_CACHE_DIR, else beside the package). One that has them already is done within
seconds. On a cluster run it once on every kind of node, before the workers start.
"""

import argparse
import time

from wt_gym.commands.options import check_environment

STOPPED = "what is compiled so far stays"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    default = ["wt_gym/NREL5MW-Turbulent-v1"]
    parser.add_argument("env", nargs="*", default=default, metavar="ENV", help="environment ids (default: %(default)s)")


def run(arguments: argparse.Namespace) -> None:
    """Compile one after the other."""
    import gymnasium as gym

    from wt_gym.envs.turbine_env import turbine_env_of
    from wt_gym.experiment.environments import compile_kernels
    from wt_gym.simulation import Simulator
    from wt_gym.simulation.compilation import compile_ahead

    for env_id in arguments.env:
        check_environment(env_id, {})
        began = time.perf_counter()
        env = gym.make(env_id)
        plain = turbine_env_of(env)
        compile_ahead(Simulator, plain.turbine, plain.fidelity)
        compile_kernels(env)
        print(f"{env_id}: ready after {time.perf_counter() - began:.0f} s", flush=True)
