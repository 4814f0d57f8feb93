"""Measure speed and memory: real-time factors, steps of environments, structural steps, induction, start-up.

    python scripts/bench/speed.py                        # everything, for all three fidelities
    python scripts/bench/speed.py --fidelity training --json

Numbers of docs/performance.md. Every measurement runs in a process of its own, after compilation, and on one thread
where it does not say otherwise; the machine should be otherwise idle. The real-time factor is simulated seconds by wall
seconds of the whole simulator (NREL 5-MW, turbulent wind at 12 m/s, baseline controller).
"""

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
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import wt_gym  # noqa: F401 - registers the environments
from wt_gym.base.processes import peak_memory
from wt_gym.simulation import FIDELITIES, Simulator
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow, TurbulenceBox, TurbulentInflow

CLONE = Path(__file__).resolve().parents[2]
SINGLE_THREAD = dict.fromkeys(("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
_ENV_ID = "wt_gym/NREL5MW-Turbulent-v1"
_RESIDUAL: dict[str, Any] = {"action_mode": "residual", "pitch": "fixed-frame", "wind_speed": (12.0, 20.0)}
_MOST_TURBINES = 8  # beside each other in the measurement of many: each process takes some hundred MB
_WAKES = ((23, 8), (101, 17), (576, 29))
"""Rows and nodes of a blade of the wakes: thousand, ten thousand and hundred thousand segments."""


# ---- measurements, each in its own process: figures, and lines that show them ----


def measure_simulator(fidelity: str, wall: float) -> tuple[dict[str, Any], str]:
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
    factor, best, memory = float(np.median(factors)), max(factors), peak_memory()
    figures = {"real_time_factor": factor, "real_time_factor_best": best, "peak_memory_mib": memory}
    return figures, f"{fidelity}: {factor:.1f} x real time (best {best:.1f}), {memory:.0f} MiB"


def measure_environment(fidelity: str, wall: float) -> tuple[dict[str, Any], str]:
    """Steps of the environment per second with random actions, and the time of a reset."""
    env = gym.make(_ENV_ID, fidelity=fidelity, disable_env_checker=True)
    env.reset(seed=0)
    env.action_space.seed(0)
    actions = itertools.cycle([0.2 * env.action_space.sample() for _ in range(1000)])  # to draw one takes 1 % of a step
    steps, resets = 0, []

    def reset() -> None:
        before = time.perf_counter()
        env.reset()
        resets.append(time.perf_counter() - before)

    start = time.perf_counter()
    while time.perf_counter() - start < wall / 2:
        *_, terminated, truncated, _ = env.step(next(actions))
        steps += 1
        if terminated or truncated:
            reset()
    rate = steps / (time.perf_counter() - start - sum(resets))
    reset()
    figures = {"env_steps_per_s": rate, "env_reset_s": float(np.mean(resets)), "env_peak_memory_mib": peak_memory()}
    return figures, f"{fidelity}: {rate:.0f} env steps/s, reset {np.mean(resets):.2f} s, {peak_memory():.0f} MiB"


def measure_vector(fidelity: str, wall: float) -> tuple[dict[str, Any], str]:
    """Steps of turbines per second: one alone, several by threads of one process, and by a process each.

    Taken in turns, so that a machine that changes its pace changes the ratios little.
    """
    number, arguments = min(2 * (os.cpu_count() or 1), _MOST_TURBINES), {"fidelity": fidelity, **_RESIDUAL}
    envs = {
        "one": gym.make_vec(_ENV_ID, 1, **arguments),
        "threads": gym.make_vec(_ENV_ID, number, **arguments),
        "processes": gym.make_vec(_ENV_ID, number, "async", vector_kwargs={"context": "spawn"}, **arguments),
    }
    rates: dict[str, list[float]] = {way: [] for way in envs}
    actions = {way: np.zeros(env.action_space.shape, dtype=np.float32) for way, env in envs.items()}
    for way, env in envs.items():
        env.reset(seed=0)
        env.step(actions[way])
    for _ in range(5):
        for way, env in envs.items():
            steps, start = 0, time.perf_counter()
            while (elapsed := time.perf_counter() - start) < wall / 15:
                env.step(actions[way])
                steps += env.num_envs
            rates[way].append(steps / elapsed)
    for env in envs.values():
        env.close()
    over_one = {way: float(np.median(np.divide(rates[way], rates["one"]))) for way in envs}
    per_s = {way: float(np.median(values)) for way, values in rates.items()}
    return {"turbines": number, "steps_per_s": per_s, "over_one": over_one}, f"{number} turbines: " + ", ".join(
        f"{way} {per_s[way]:.0f} steps/s ({over_one[way]:.2f} x one)" for way in envs
    )


def measure_start(fidelity: str, wall: float) -> tuple[dict[str, Any], str]:
    """Time to import the package, and to build the simulator and take the first step, imports included [s]."""
    program = "import time; start = time.perf_counter(); import wt_gym; imported = time.perf_counter() - start; "
    program += "from wt_gym.simulation import Simulator; from wt_gym.wind import SteadyInflow; "
    program += f"simulator = Simulator('nrel_5mw', SteadyInflow(12.0), {fidelity!r}); "
    program += "simulator.reset(rotor_speed=1.267); simulator.advance(0.2, pitch=0.07, generator_torque=43e3); "
    program += "print(imported, time.perf_counter() - start)"
    imported, first = map(float, output_of([sys.executable, "-c", program])[-1].split())
    return {"import_s": imported, "first_step_s": first}, f"first step {first:.1f} s, import of wt_gym {imported:.2f} s"


def measure_threads(fidelity: str, wall: float) -> tuple[dict[str, Any], str]:
    """Wall time of an aerodynamic step on one and on two threads, ten steps in turn."""
    simulators = [Simulator("nrel_5mw", SteadyInflow(8.0), fidelity, threads=n) for n in (1, 2)]
    torque = [simulator.reset(rotor_speed=0.96).generator_torque for simulator in simulators]
    for simulator, demand in zip(simulators, torque, strict=True):
        simulator.advance(simulator.time_step, pitch=0.0, generator_torque=demand)
    best, start = [math.inf, math.inf], time.perf_counter()
    while time.perf_counter() - start < wall:
        for k, simulator in enumerate(simulators):
            before = time.perf_counter()
            simulator.advance(10 * simulator.time_step, pitch=0.0, generator_torque=torque[k])
            best[k] = min(best[k], (time.perf_counter() - before) / 10)
    one, two = best
    text = f"{fidelity}, one step: {one * 1e3:.1f} ms on one thread, {two * 1e3:.1f} ms on two ({one / two:.2f} x)"
    return {"step_s_one_thread": one, "step_s_two_threads": two}, text


def measure_turbulence(fidelity: str, wall: float) -> tuple[dict[str, Any], str]:
    """Time to synthesize a turbulence box of ten minutes for rotors of three sizes."""
    seconds = {}
    for name in ("nrel_5mw", "iea_15mw", "iea_22mw"):
        turbine, seeds = load_turbine(name), itertools.count(1)  # a box of the same seed would come from memory
        size = turbine.hub_height, turbine.rotor_diameter
        seconds[name] = best_of(
            lambda size=size, seeds=seeds: TurbulenceBox.kaimal(12.0, *size, seed=next(seeds), cache=False), wall, 2
        )
    return {"box_s": seconds}, "box of 600 s: " + ", ".join(f"{name} {s:.1f} s" for name, s in seconds.items())


def measure_structures(fidelity: str, wall: float) -> tuple[dict[str, Any], str]:
    """Time of a structural step, by formulation: the turbine, and the examples of the other two."""
    from envs_tests.physics.cases import observer_frame, small_turbine
    from wt_gym.multibody.integrators.schemes import HammingIntegrator

    figures = {}
    for form in ("embedded", "constrained"):
        simulator = Simulator("nrel_5mw", SteadyInflow(12.0), replace(FIDELITIES[fidelity], formulation=form))
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
    return {"structural": figures}, "\n".join(
        f"{form}: {cost['step_us']:.1f} us per structural step"
        + (f", {cost['rhs_us']:.2f} us per right-hand side" if "rhs_us" in cost else "")
        + f" ({cost['velocities']} velocities, {cost['multipliers']} multipliers)"
        for form, cost in figures.items()
    )


def structural_cost(integrator: Any, wall: float, n: int = 20) -> dict[str, Any]:
    """Unknowns of a system and the cost of a step, from calls of a few milliseconds that are seldom interrupted."""
    system = integrator.system
    step = best_of(lambda: integrator.advance(n), wall, most=500) / n * 1e6
    if hasattr(system, "n_u"):
        unknowns = {"velocities": system.n_u, "multipliers": system.n_constraints}
        return unknowns | {"step_us": step, "rhs_us": step / (integrator.n_corrections + 1)}
    velocities, multipliers = sum(body.n for body in system.bodies), len(integrator.state.multiplier)
    return {"velocities": velocities, "multipliers": multipliers, "step_us": step}


def measure_induction(fidelity: str, wall: float) -> tuple[dict[str, Any], str]:
    """Time of the velocities at the nodes of helical wakes, by sums over all segments and by the tree code."""
    from envs_tests.unit.test_tree_induction import helical_wake
    from wt_gym.aerodynamics.induction.induction_kernels import direct_induction
    from wt_gym.aerodynamics.induction.simd_kernels import WIDTH
    from wt_gym.aerodynamics.induction.tree_induction import TreeInduction

    rows = []
    for n_row, n_node in _WAKES:
        sheet = helical_wake(n_row, n_node)
        nodes = sheet[..., :3].reshape(-1, 3).T
        targets = np.ascontiguousarray(nodes[:, : nodes.shape[1] // WIDTH * WIDTH])
        few = np.ascontiguousarray(targets[:, : 128 * WIDTH])  # sums take the same time for each target
        direct, velocity = np.zeros_like(few), np.zeros_like(targets)
        scratch, tree = np.zeros(8 * WIDTH * n_node, np.float32), TreeInduction(n_row, 3, n_node, targets.shape[1])
        direct_induction(sheet, few, direct, 0, few.shape[1], scratch)
        error = 1e-3 * float(np.linalg.norm(direct, axis=0).mean())
        of_few = best_of(partial(direct_induction, sheet, few, direct, 0, few.shape[1], scratch), wall / 6)
        by_tree = best_of(partial(tree.add_velocity, sheet, targets, velocity, error), wall / 6)
        segments = 3 * ((n_row - 1) * n_node + n_row * (n_node - 1))
        sums = of_few * targets.shape[1] / few.shape[1]
        rows.append({"segments": segments, "sums_s": sums, "tree_s": by_tree,
                     "segments_per_s": segments * few.shape[1] / of_few})  # fmt: skip
    return {"induction": rows}, "\n".join(
        f"{row['segments']} segments: sums {row['sums_s']:.3g} s, {row['segments_per_s'] / 1e9:.2f}e9 segments/s; "
        f"tree {row['tree_s']:.3g} s"
        for row in rows
    )


def best_of(call: Callable[[], object], wall: float, most: float = math.inf) -> float:
    """Shortest time of a call within a wall time [s] and a number of calls."""
    call()
    best, calls, start = math.inf, 0, time.perf_counter()
    while time.perf_counter() - start < wall and calls < most:
        calls += 1
        before = time.perf_counter()
        call()
        best = min(best, time.perf_counter() - before)
    return best


WORKERS = {name.removeprefix("measure_"): value for name, value in globals().items() if name.startswith("measure_")}


# ---- the parent ----


def output_of(command: list[str], **environment: str) -> list[str]:
    """Lines that a program of one thread prints."""
    paths = os.pathsep.join([str(CLONE), *filter(None, [os.environ.get("PYTHONPATH")])])
    variables = os.environ | SINGLE_THREAD | {"PYTHONPATH": paths} | environment
    return subprocess.run(command, env=variables, stdout=subprocess.PIPE, text=True, check=True).stdout.splitlines()


def processor() -> str:
    """Name of the processor."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as info:
            return next(line.split(":", 1)[1].strip() for line in info if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def main() -> None:
    """Measure everything, and print it as it comes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fidelity", nargs="+", default=["training", "engineering", "reference"], choices=FIDELITIES)
    parser.add_argument("--seconds", type=float, default=20.0, help="wall time of a measurement (default: %(default)s)")
    parser.add_argument("--no-cold", action="store_true", help="skip the start with an empty compilation cache")
    parser.add_argument("--json", action="store_true", help="print all figures as JSON at the end")
    parser.add_argument("--worker", choices=WORKERS, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.worker:
        print(json.dumps(WORKERS[arguments.worker](arguments.fidelity[0], arguments.seconds)))
        return

    def measure(name: str, fidelity: str = "training", **environment: str) -> Any:
        command = [sys.executable, __file__, "--worker", name, "--fidelity", fidelity]
        command += ["--seconds", str(arguments.seconds)]
        figures, text = json.loads(output_of(command, **environment)[-1])
        print(text, flush=True)
        return figures

    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else math.nan
    figures: dict[str, Any] = {"processor": processor(), "python": platform.python_version(), "load_at_start": load}
    print(f"{figures['processor']}, {os.cpu_count()} cores, load {load:.2f}, Python {figures['python']}, one thread")
    if not arguments.no_cold:
        with tempfile.TemporaryDirectory() as empty:
            figures["cold"] = measure("start", NUMBA_CACHE_DIR=empty)
    measure("start")  # fills the cache
    for name in ("start", "turbulence", "structures", "induction"):
        figures[name] = measure(name)
    for fidelity in arguments.fidelity:
        figures[fidelity] = measure("simulator", fidelity) | measure("environment", fidelity)
    figures["vector"] = measure("vector")
    if "reference" in arguments.fidelity:
        figures["threads"] = measure("threads", "reference")
    if arguments.json:
        print(json.dumps(figures))


if __name__ == "__main__":
    main()
