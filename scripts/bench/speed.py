"""Measure speed and memory: real-time factors, steps of environments, structural steps, start-up.

    python scripts/bench/speed.py                        # everything, for all three fidelities
    python scripts/bench/speed.py --fidelity training --json
    python scripts/bench/speed.py --learning 1000000     # PPO beside the bare environments, for so many steps each

Numbers of docs/performance.md. Every measurement runs in a process of its own, after compilation, and on one thread
where it does not say otherwise; the machine should be otherwise idle. The real-time factor is simulated seconds by wall
seconds of the whole simulator (NREL 5-MW, turbulent wind at 12 m/s, baseline controller).
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import os
import platform
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np

import wt_gym  # noqa: F401 - registers the environments
from wt_gym.base.process_memory import peak_memory
from wt_gym.simulation import FIDELITIES, Simulator
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow, TurbulenceBox, TurbulentInflow

if TYPE_CHECKING:
    from collections.abc import Callable

CLONE = Path(__file__).resolve().parents[2]
SINGLE_THREAD = dict.fromkeys(("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
_ENV_ID = "wt_gym/NREL5MW-Turbulent-v1"
_RESIDUAL: dict[str, Any] = {"action_mode": "residual", "pitch": "fixed-frame", "wind_speed": (12.0, 20.0)}
_MOST_TURBINES = 8  # beside each other in the measurement of many: each process takes some hundred MB
RUNGS = ["training", "engineering", "reference"]
TASK = "wt_gym/LoadReduction-v2"
LIDAR_CONTROLLER = "lidar+constrained_ipc+tower_dampers"
LIDAR_OBSERVATION = ("rotor", "power", "pitch", "wind", "fixed_frame", "tower", "controller", "offsets", "lidar")


# ---- measurements, each in its own process ----


def measure_simulator(fidelity: str, wall: float) -> dict[str, Any]:
    """Real-time factor and memory of the simulator under the baseline controller."""
    from wt_gym.control import Demand
    from wt_gym.control.controllers import DisconController

    box = TurbulenceBox.kaimal(12.0, 90.0, 126.0, "B", seed=1)
    simulator = Simulator("nrel_5mw", TurbulentInflow(box, SteadyInflow(12.0, shear_exponent=0.2)), fidelity)
    signals = simulator.reset(rotor_speed=1.267, pitch=np.radians(3.8))
    controller = DisconController()
    controller.start(signals, Demand(signals.pitch, 0.0, signals.generator_torque))
    dt = 0.2

    def run(seconds: float) -> float:
        nonlocal signals
        steps, start = 0, time.perf_counter()
        while time.perf_counter() - start < seconds:
            demand = controller.step(signals, dt)
            signals = simulator.advance(dt, pitch=demand.pitch, generator_torque=demand.generator_torque)
            steps += 1
        return steps * dt / (time.perf_counter() - start)

    run(min(2.0, 0.2 * wall))
    factors = [run(wall / 5) for _ in range(5)]
    return {
        "real_time_factor": float(np.median(factors)),
        "real_time_factor_best": max(factors),
        "aero_step_s": simulator.time_step,
        "peak_memory_mib": peak_memory(),
    }


def measure_environment(fidelity: str, wall: float) -> dict[str, Any]:
    """Steps of the environment per second with random actions, and the time of a reset."""
    env = gym.make("wt_gym/NREL5MW-Turbulent-v1", fidelity=fidelity, disable_env_checker=True)
    env.reset(seed=0)
    env.action_space.seed(0)
    actions = itertools.cycle([0.2 * env.action_space.sample() for _ in range(1000)])  # to draw one takes 1 % of a step
    steps = resets = 0
    reset_time, start = 0.0, time.perf_counter()
    while time.perf_counter() - start < wall / 2:
        *_, terminated, truncated, _ = env.step(next(actions))
        steps += 1
        if terminated or truncated:
            before = time.perf_counter()
            env.reset()
            reset_time += time.perf_counter() - before
            resets += 1
    before = time.perf_counter()
    env.reset()
    reset_time += time.perf_counter() - before
    elapsed = time.perf_counter() - start - reset_time
    return {
        "env_steps_per_s": steps / elapsed,
        "env_reset_s": reset_time / (resets + 1),
        "env_peak_memory_mib": peak_memory(),
    }


def measure_outside(fidelity: str, wall: float) -> dict[str, Any]:
    """Share of a step with residual pitch that passes outside the simulator: actions, controller, observation, reward.

    Of a single turbine, of one on the best controller with its lidar, and of four in a vector environment on one
    thread, a third of the wall time each.
    """
    import gymnasium

    lidar: dict[str, Any] = {"controller": LIDAR_CONTROLLER, "observation": LIDAR_OBSERVATION}
    single = gymnasium.make(_ENV_ID, disable_env_checker=True, fidelity=fidelity, **_RESIDUAL)
    seeing = gymnasium.make(_ENV_ID, disable_env_checker=True, fidelity=fidelity, **_RESIDUAL, **lidar)
    several = gymnasium.make_vec(_ENV_ID, 4, threads=1, fidelity=fidelity, **_RESIDUAL)
    return {
        "share_outside": share_outside(single, [single.unwrapped], wall / 3),
        "share_outside_lidar": share_outside(seeing, [seeing.unwrapped], wall / 3),
        "share_outside_vector": share_outside(several, several.envs, wall / 3),
    }


def share_outside(env: gym.Env | gym.vector.VectorEnv, turbines: list[Any], wall: float) -> float:
    """Median share of hundred steps without an action that is not spent in the simulators of an environment."""
    env.reset(seed=0)
    within = 0.0

    def timed(advance: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **named: Any) -> Any:
            nonlocal within
            start = time.perf_counter()
            signals = advance(*arguments, **named)
            within += time.perf_counter() - start
            return signals

        return call

    for turbine in turbines:
        turbine.simulator.advance = timed(turbine.simulator.advance)
    shares: list[float] = []
    action = np.zeros_like(env.action_space.sample())
    end = time.perf_counter() + wall
    while time.perf_counter() < end or not shares:
        within, start = 0.0, time.perf_counter()
        for _ in range(100):
            env.step(action)
        shares.append(1.0 - within / (time.perf_counter() - start))
        env.reset()
    env.close()
    return float(np.median(shares))


def measure_vector(fidelity: str, wall: float) -> dict[str, Any]:
    """Steps of turbines per second: one alone, several by threads of one process, and by a process each.

    Taken in turns, so that a machine that changes its pace changes the ratios little.
    """
    import gymnasium
    import numpy as np

    number, arguments = min(2 * (os.cpu_count() or 1), _MOST_TURBINES), {"fidelity": fidelity, **_RESIDUAL}
    made = {
        "one": gymnasium.make_vec(_ENV_ID, 1, **arguments),
        "threads": gymnasium.make_vec(_ENV_ID, number, **arguments),
        "processes": gymnasium.make_vec(_ENV_ID, number, "async", vector_kwargs={"context": "spawn"}, **arguments),
    }
    rates: dict[str, list[float]] = {way: [] for way in made}
    for env in made.values():
        env.reset(seed=0)
        env.step(np.zeros(env.action_space.shape, dtype=np.float32))
    for _ in range(5):
        for way, env in made.items():
            actions, steps = np.zeros(env.action_space.shape, dtype=np.float32), 0
            start = time.perf_counter()
            while (elapsed := time.perf_counter() - start) < wall / 15:
                env.step(actions)
                steps += env.num_envs
            rates[way].append(steps / elapsed)
    for env in made.values():
        env.close()
    median = {way: float(np.median(values)) for way, values in rates.items()}
    return {
        "turbines": number,
        "one_per_s": median["one"],
        "threads_per_s": median["threads"],
        "processes_per_s": median["processes"],
        "threads_over_one": float(np.median(np.divide(rates["threads"], rates["one"]))),
        "processes_over_one": float(np.median(np.divide(rates["processes"], rates["one"]))),
    }


def measure_learning(fidelity: str, steps: float) -> dict[str, Any]:
    """Wall and processor time of so many steps of turbines: of PPO by threads and by a process each, and of no learner.

    A tenth of the steps in turn, so that a machine that changes its pace changes the ratios little. ``bare`` steps
    turbines with the actions of an untrained policy; ``stable_baselines`` learns with the PPO of stable-baselines3.
    Where threads step turbines, ``learner_over_environment`` is the ratio of the processor time of policy, update,
    statistics and callbacks to that of the steps of the environments.
    """
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import CallbackList
    from stable_baselines3.common.logger import Logger
    from stable_baselines3.common.vec_env import SubprocVecEnv

    from wt_gym.learning.callbacks import EpisodeFigures, StopRequest, Watch
    from wt_gym.learning.environments import START_METHOD, make_training_env, monitored, normalized
    from wt_gym.learning.models import make_model
    from wt_gym.learning.options import TrainingConfig

    torch.set_num_threads(1)  # as a training does
    config = TrainingConfig(env_kwargs={"fidelity": fidelity}, eval_every=0)
    number = config.n_envs
    processes = SubprocVecEnv([monitored(config.env_id, config.env_kwargs)] * number, start_method=START_METHOD)
    learning: dict[str, Any] = {
        "threads": make_training_env(config),
        "stable_baselines": make_training_env(config),
        "processes": normalized(processes, config),
    }
    bare = make_training_env(config).venv.venv  # without statistics and monitor
    models = {way: make_model(config, venv) for way, venv in learning.items()}
    models["stable_baselines"].__class__ = PPO  # which has the same attributes
    watch = Watch(config, 0.2, {"steps": [], "episode_return": [], "episode_length": []}, StopRequest(), False)
    within = dict.fromkeys(("threads", "stable_baselines"), 0.0)

    def timed(way: str, venv: Any) -> None:
        wait = venv.step_wait

        def call() -> Any:
            start = time.process_time()
            outcome = wait()
            within[way] += time.process_time() - start
            return outcome

        venv.step_wait = call

    for way in within:
        timed(way, learning[way].venv.venv)
    rng = np.random.default_rng(0)
    low, high = bare.action_space.low, bare.action_space.high

    def step_bare(count: int) -> int:
        for _ in range(math.ceil(count / number)):
            bare.step(np.clip(0.3 * rng.standard_normal((number, *low.shape), np.float32), low, high))
        return number * math.ceil(count / number)

    bare.reset()
    step_bare(1)  # kernels are there
    for model in models.values():
        model.set_logger(Logger(None, []))
    elapsed, used, done = (dict.fromkeys((*models, "bare"), 0.0) for _ in range(3))
    share = math.ceil(steps / 10)
    for _ in range(10):
        for way in elapsed:
            start, start_used = time.perf_counter(), time.process_time()
            if way == "bare":
                done[way] += step_bare(share)
            else:
                before = models[way].num_timesteps
                models[way].learn(share, callback=CallbackList([watch, EpisodeFigures()]), reset_num_timesteps=False)
                done[way] += models[way].num_timesteps - before
            used[way] += time.process_time() - start_used
            elapsed[way] += time.perf_counter() - start
    for venv in (*learning.values(), bare):
        venv.close()
    rates = {way: done[way] / elapsed[way] for way in elapsed}
    return {
        "turbines": number,
        "steps": done,
        "seconds": elapsed,
        "steps_per_s": rates,
        "over_bare": {way: rates[way] / rates["bare"] for way in models},
        "learner_over_environment": {way: (used[way] - within[way]) / within[way] for way in within},
        "learner_us_per_step": {way: 1e6 * (used[way] - within[way]) / done[way] for way in within},
    }


def measure_start(fidelity: str, wall: float) -> dict[str, Any]:
    """Time to import the package, and to build the simulator and take the first step, imports included [s]."""
    program = "import time; start = time.perf_counter(); import wt_gym; imported = time.perf_counter() - start; "
    program += "from wt_gym.simulation import Simulator; from wt_gym.wind import SteadyInflow; "
    program += f"simulator = Simulator('nrel_5mw', SteadyInflow(12.0), {fidelity!r}); "
    program += "simulator.reset(rotor_speed=1.267); simulator.advance(0.2, pitch=0.07, generator_torque=43e3); "
    program += "print(imported, time.perf_counter() - start)"
    imported, first = output_of([sys.executable, "-c", program])[-1].split()
    return {"import_s": float(imported), "first_step_s": float(first)}


def measure_threads(fidelity: str, wall: float) -> dict[str, Any]:
    """Wall time of an aerodynamic step on one and on two threads, ten steps in turn."""
    simulators = [Simulator("nrel_5mw", SteadyInflow(8.0), fidelity, threads=n) for n in (1, 2)]
    torque = [simulator.reset(rotor_speed=0.96).generator_torque for simulator in simulators]
    for simulator, demand in zip(simulators, torque, strict=True):
        simulator.advance(simulator.time_step, pitch=0.0, generator_torque=demand)
    best, start = [float("inf"), float("inf")], time.perf_counter()
    while time.perf_counter() - start < wall:
        for k, simulator in enumerate(simulators):
            before = time.perf_counter()
            simulator.advance(10 * simulator.time_step, pitch=0.0, generator_torque=torque[k])
            best[k] = min(best[k], (time.perf_counter() - before) / 10)
    return {"step_s_one_thread": best[0], "step_s_two_threads": best[1]}


def measure_turbulence(fidelity: str, wall: float) -> dict[str, Any]:
    """Time to synthesize a turbulence box of ten minutes for rotors of three sizes."""

    def seconds(name: str) -> float:
        turbine, seeds = load_turbine(name), itertools.count(1)  # a box of the same seed would come from memory

        def make() -> TurbulenceBox:
            size = turbine.hub_height, turbine.rotor_diameter
            return TurbulenceBox.kaimal(12.0, *size, seed=next(seeds), cache=False)

        return best_of(make, wall, most=2)

    return {"box_s": {name: seconds(name) for name in ("nrel_5mw", "iea_15mw", "iea_22mw")}}


def measure_structures(fidelity: str, wall: float) -> dict[str, Any]:
    """Time of a structural step, by formulation: the turbine, and the examples of the other two."""
    from envs_tests.physics.cases import observer_frame, small_turbine
    from wt_gym.multibody.integrators.schemes import HammingIntegrator

    figures = {}
    for form in ("embedded", "constrained"):
        chosen = replace(FIDELITIES[fidelity], formulation=form)
        simulator = Simulator("nrel_5mw", SteadyInflow(12.0), chosen)
        simulator.reset(rotor_speed=1.267, pitch=0.07)
        integrator = HammingIntegrator(simulator.structure.system, 0.01)
        integrator.start(simulator.coupling.integrator.state.copy())
        figures[f"turbine, {form}"] = structural_cost(integrator, wall / 5)
    small = small_turbine.small_turbine(speed=small_turbine.Disc().speed)
    integrator = HammingIntegrator(small.system, small_turbine.STEP)
    integrator.start(small.start)
    figures["mixed coordinates"] = structural_cost(integrator, wall / 5)
    load = observer_frame.ramp(observer_frame.FLAP_LOAD, observer_frame.edge_load()[0], 3.0)
    for label, n_modes in (("finite elements", None), ("16 modes", 16)):
        integrator = observer_frame.rotor(load, "undeformed", n_modes=n_modes)
        figures[f"observer frame, {label}"] = structural_cost(integrator, wall / 5)
    return {"structural": figures}


def structural_cost(integrator: Any, wall: float, n: int = 20) -> dict[str, Any]:
    """Unknowns of a system and the cost of a step, from calls of a few milliseconds that are seldom interrupted."""
    system = integrator.system
    step = best_of(lambda: integrator.advance(n), wall, most=500) / n * 1e6
    if hasattr(system, "n_u"):
        unknowns = {"velocities": system.n_u, "multipliers": system.n_constraints}
        return unknowns | {"step_us": step, "rhs_us": step / (integrator.n_corrections + 1)}
    return {
        "velocities": sum(body.n for body in system.bodies),
        "multipliers": len(integrator.state.multiplier),
        "step_us": step,
    }


def best_of(call: Callable[[], object], wall: float, most: float = float("inf")) -> float:
    """Shortest time of a call within a wall time [s] and a number of calls."""
    call()
    best, calls, start = float("inf"), 0, time.perf_counter()
    while time.perf_counter() - start < wall and calls < most:
        calls += 1
        before = time.perf_counter()
        call()
        best = min(best, time.perf_counter() - before)
    return best


WORKERS = {
    "simulator": measure_simulator,
    "environment": measure_environment,
    "learning": measure_learning,
    "outside": measure_outside,
    "start": measure_start,
    "threads": measure_threads,
    "turbulence": measure_turbulence,
    "vector": measure_vector,
}


# ---- the parent ----


def output_of(command: list[str], **environment: str) -> list[str]:
    """Lines that a program of one thread prints."""
    paths = os.pathsep.join([str(CLONE), *filter(None, [os.environ.get("PYTHONPATH")])])
    variables = os.environ | SINGLE_THREAD | {"PYTHONPATH": paths} | environment
    return subprocess.run(command, env=variables, stdout=subprocess.PIPE, text=True, check=True).stdout.splitlines()


def in_process(name: str, fidelity: str, wall: float, **environment: str) -> dict[str, Any]:
    """Figures of one measurement in a fresh interpreter."""
    command = [sys.executable, __file__, "--worker", name, "--fidelity", fidelity, "--seconds", str(wall)]
    return json.loads(output_of(command, **environment)[-1])


def processor() -> str:
    """Name of the processor."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as info:
            return next(line.split(":", 1)[1].strip() for line in info if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def report(name: str, fidelity: str, f: dict[str, Any]) -> str:
    """Lines that show the figures of a measurement."""
    if name == "start":
        return f"first step {f['first_step_s']:.1f} s, import of wt_gym {f['import_s']:.2f} s"
    if name == "turbulence":
        return "turbulence box of 600 s: " + ", ".join(f"{name} {s:.1f} s" for name, s in f["box_s"].items())
    if name == "structures":
        return "\n".join(
            f"{form}: {cost['step_us']:.1f} us per structural step"
            + (f", {cost['rhs_us']:.2f} us per right-hand side" if "rhs_us" in cost else "")
            + f" ({cost['velocities']} velocities, {cost['multipliers']} multipliers)"
            for form, cost in f["structural"].items()
        )
    if name == "simulator":
        return (
            f"{fidelity}: {f['real_time_factor']:.1f} x real time (best {f['real_time_factor_best']:.1f}), "
            f"{f['peak_memory_mib']:.0f} MiB"
        )
    if name == "environment":
        return (
            f"{fidelity}: {f['env_steps_per_s']:.0f} env steps/s, reset {f['env_reset_s']:.2f} s, "
            f"{f['env_peak_memory_mib']:.0f} MiB"
        )
    if name == "outside":
        return (
            f"LoadReduction: {100 * f['share_outside']:.1f} % of a step outside the simulator, "
            f"{100 * f['share_outside_lidar']:.1f} % with a lidar, "
            f"{100 * f['share_outside_vector']:.1f} % of four turbines in one vector environment"
        )
    if name == "vector":
        return (
            f"one turbine: {f['one_per_s']:.0f} steps/s; {f['turbines']}: {f['threads_per_s']:.0f} by threads "
            f"({f['threads_over_one']:.2f} x one), "
            f"{f['processes_per_s']:.0f} by processes ({f['processes_over_one']:.2f} x)"
        )
    if name == "threads":
        one, two = f["step_s_one_thread"], f["step_s_two_threads"]
        return f"{fidelity}, one step: {one * 1e3:.1f} ms on one thread, {two * 1e3:.1f} ms on two ({one / two:.2f} x)"
    shares = f["learner_over_environment"]
    return "\n".join(
        f"{f['turbines']} turbines, {way}: {rate:.0f} steps/s"
        + (f"; learner {100 * shares[way]:.1f} % of the processor time of the environment" if way in shares else "")
        for way, rate in f["steps_per_s"].items()
    )


def parse_arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fidelity", nargs="+", default=RUNGS, choices=FIDELITIES, help="(default: %(default)s)")
    parser.add_argument("--seconds", type=float, default=20.0, help="wall time of a measurement (default: %(default)s)")
    parser.add_argument("--no-cold", action="store_true", help="skip the start with an empty compilation cache")
    parser.add_argument("--learning", type=int, metavar="STEPS", help="train PPO for so many steps (extra train)")
    parser.add_argument("--json", action="store_true", help="print all figures as JSON at the end")
    parser.add_argument("--worker", choices=WORKERS, help=argparse.SUPPRESS)
    return parser.parse_args()


def main() -> None:
    """Measure everything that is asked for, and print it as it comes."""
    arguments = parse_arguments()
    wall = arguments.seconds
    if arguments.worker:
        print(json.dumps(WORKERS[arguments.worker](arguments.fidelity[0], wall)))
        return
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else math.nan
    figures: dict[str, Any] = {"processor": processor(), "python": platform.python_version(), "load_at_start": load}
    print(f"{figures['processor']}, {os.cpu_count()} cores, load {load:.2f}, Python {figures['python']}, one thread")

    def measure(name: str, fidelity: str = "training", wall: float = wall, **environment: str) -> dict[str, Any]:
        found = in_process(name, fidelity, wall, **environment)
        print(report(name, fidelity, found), flush=True)
        return found

    if not arguments.no_cold:
        with tempfile.TemporaryDirectory() as empty:
            figures["cold"] = measure("start", NUMBA_CACHE_DIR=empty)
    in_process("start", "training", wall)
    figures["warm"] = measure("start")
    figures["turbulence"] = measure("turbulence")
    figures["kernels"] = measure("structures")
    for fidelity in arguments.fidelity:
        figures[fidelity] = measure("simulator", fidelity) | measure("environment", fidelity)
    figures["outside"] = measure("outside", wall=wall / 2)
    figures["vector"] = measure("vector")
    if "reference" in arguments.fidelity:
        figures["threads"] = measure("threads", "reference")
    if arguments.learning:
        figures["learning"] = measure("learning", wall=arguments.learning)
    if arguments.json:
        print(json.dumps(figures))


if __name__ == "__main__":
    main()
