"""Measure speed and memory: real-time factors, kernels, start-up.

    wt-gym bench                                # everything, for all three fidelities
    wt-gym bench --fidelity training --no-induction --json
    wt-gym bench --learning 1000000             # PPO beside the bare environments, for so many steps each
    wt-gym bench --pterasoftware                # with a comparison; installs PteraSoftware for itself (in a clone)

Every measurement runs in a process of its own, after compilation, and on one thread where it does not say otherwise;
the machine should be otherwise idle.
The real-time factor is simulated seconds by wall seconds of the whole simulator (NREL 5-MW, turbulent wind at 12 m/s,
baseline controller). Structural steps and induction are measured in a clone only: their examples are not part of the
installed package.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import os
import platform
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

from wt_gym.base.errors import did_you_mean
from wt_gym.base.process_memory import peak_memory
from wt_gym.commands.program import CLONE, IN_CLONE, OneLineParser, stoppable, user_errors

if TYPE_CHECKING:
    from argparse import ArgumentParser, Namespace
    from collections.abc import Callable

    import gymnasium as gym

    from wt_gym.simulation.channels import Signals

SINGLE_THREAD = dict.fromkeys(("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
_MOST_TURBINES = 8  # beside each other in the measurement of many: each process takes some hundred MB
RUNGS = ["training", "engineering", "reference"]
LIDAR_CONTROLLER = "lidar+constrained_ipc+tower_dampers"
LIDAR_OBSERVATION = ("rotor", "power", "pitch", "wind", "fixed_frame", "tower", "controller", "offsets", "lidar")


def parse_arguments(words: list[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = OneLineParser("bench", description=__doc__)
    parser.add_argument("--fidelity", nargs="+", default=RUNGS, help="fidelities to measure")
    parser.add_argument("--seconds", type=float, default=20.0, help="wall time of a measurement (default: %(default)s)")
    parser.add_argument("--no-cold", action="store_true", help="skip the start with an empty compilation cache")
    parser.add_argument("--no-induction", action="store_true", help="skip the table of direct sums and tree code")
    parser.add_argument(
        "--learning", type=int, metavar="STEPS",
        help="train PPO for so many steps, beside environments without a learner and other ways (extra train)",
    )  # fmt: skip
    parser.add_argument("--pterasoftware", action="store_true", help="set up PteraSoftware and run it side by side")
    parser.add_argument("--json", action="store_true", help="print all figures as JSON at the end")
    parser.add_argument("--worker", nargs=2, metavar=("WHAT", "FIDELITY"), help=argparse.SUPPRESS)
    arguments = parser.parse_args(words)
    if not arguments.worker:
        check(parser, arguments)
    return arguments


def check(parser: ArgumentParser, arguments: Namespace) -> None:
    """Refuse what cannot be measured before anything is."""
    from wt_gym.simulation import FIDELITIES

    unknown = [name for name in arguments.fidelity if name not in FIDELITIES]
    if unknown:
        parser.error(
            f"fidelity must be one of {', '.join(FIDELITIES)}, got {', '.join(unknown)}"
            + did_you_mean(unknown[0], FIDELITIES)
        )
    if arguments.pterasoftware and not IN_CLONE:
        parser.error("--pterasoftware: the comparison is in a clone of the project only")
    if arguments.learning is not None and arguments.learning < 1:
        parser.error(f"--learning {arguments.learning}: at least one step is needed")
    if not (math.isfinite(arguments.seconds) and arguments.seconds > 0.0):
        parser.error(f"--seconds {arguments.seconds}: a finite time above 0 is needed")


# ---- measurements, each in its own process ----


def measure_simulator(fidelity: str, wall: float) -> dict[str, Any]:
    """Real-time factor and memory of the simulator under the baseline controller."""
    import numpy as np

    from wt_gym.control.controllers.discon import BaselineController
    from wt_gym.simulation import Simulator
    from wt_gym.wind import SteadyInflow, TurbulenceBox, TurbulentInflow

    box = TurbulenceBox.kaimal(12.0, 90.0, 126.0, "B", seed=1)
    simulator = Simulator("nrel_5mw", TurbulentInflow(box, SteadyInflow(12.0, shear_exponent=0.2)), fidelity)
    signals = simulator.reset(rotor_speed=1.267, pitch=np.radians(3.8))
    controller = BaselineController()
    controller.start(signals.generator_speed, signals.pitch, signals.generator_torque)
    dt = 0.2

    def run(seconds: float) -> float:
        nonlocal signals
        steps, start = 0, time.perf_counter()
        while time.perf_counter() - start < seconds:
            pitch, torque = controller.step(signals.generator_speed, dt)
            signals = simulator.advance(dt, pitch=pitch, generator_torque=torque)
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
    import gymnasium

    import wt_gym  # noqa: F401 - registers the environments

    env = gymnasium.make("wt_gym/NREL5MW-Turbulent-v1", fidelity=fidelity, disable_env_checker=True)
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
    """Share of a step of LoadReduction that passes outside the simulator: actions, controller, observation, reward.

    Of a single turbine, of one on the best controller with its lidar, and of four in a vector environment on one
    thread, a third of the wall time each.
    """
    import gymnasium

    import wt_gym  # noqa: F401 - registers the environments

    name = "wt_gym/LoadReduction-v1"
    lidar: dict[str, Any] = {"controller": LIDAR_CONTROLLER, "observation": LIDAR_OBSERVATION}
    single = gymnasium.make(name, disable_env_checker=True, fidelity=fidelity)
    seeing = gymnasium.make(name, disable_env_checker=True, fidelity=fidelity, **lidar)
    several = gymnasium.make_vec(name, 4, threads=1, fidelity=fidelity)
    return {
        "share_outside": share_outside(single, [single.unwrapped], wall / 3),
        "share_outside_lidar": share_outside(seeing, [seeing.unwrapped], wall / 3),
        "share_outside_vector": share_outside(several, cast(Any, several).envs, wall / 3),
    }


def share_outside(
    env: gym.Env[Any, Any] | gym.vector.VectorEnv[Any, Any, Any], turbines: list[Any], wall: float
) -> float:
    """Median share of hundred steps without an action that is not spent in the simulators of an environment."""
    import numpy as np

    env.reset(seed=0)
    within = 0.0

    def timed(advance: Callable[..., Signals]) -> Callable[..., Signals]:
        def call(*arguments: Any, **named: Any) -> Signals:
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

    import wt_gym  # noqa: F401 - registers the environments

    name, number = "wt_gym/LoadReduction-v1", min(2 * (os.cpu_count() or 1), _MOST_TURBINES)
    made = {
        "one": gymnasium.make_vec(name, 1, fidelity=fidelity),
        "threads": gymnasium.make_vec(name, number, fidelity=fidelity),
        "processes": gymnasium.make_vec(name, number, "async", vector_kwargs={"context": "spawn"}, fidelity=fidelity),
    }
    rates: dict[str, list[float]] = {way: [] for way in made}
    for env in made.values():
        env.reset(seed=0)
        env.step(np.zeros(cast(tuple[int, ...], env.action_space.shape), dtype=np.float32))
    for _ in range(5):
        for way, env in made.items():
            actions, steps = np.zeros(cast(tuple[int, ...], env.action_space.shape), dtype=np.float32), 0
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
    import numpy as np
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import CallbackList
    from stable_baselines3.common.logger import Logger
    from stable_baselines3.common.vec_env import SubprocVecEnv

    from wt_gym.learning.training.callbacks import EpisodeFigures, StopRequest, Watch
    from wt_gym.learning.training.config import TrainingConfig
    from wt_gym.learning.training.environments import START_METHOD, make_training_env, monitored, normalized
    from wt_gym.learning.training.models import make_model

    torch.set_num_threads(1)  # as a training does
    config = TrainingConfig(env_kwargs={"fidelity": fidelity}, eval_every=0)
    number = config.n_envs
    processes = SubprocVecEnv([monitored(config.env_id, config.env_kwargs)] * number, start_method=START_METHOD)
    learning: dict[str, Any] = {
        "threads": make_training_env(config),
        "stable_baselines": make_training_env(config),
        "processes": normalized(processes, config),
    }
    bare = make_training_env(config).venv.venv  # type: ignore[attr-defined] # without statistics and monitor
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


def measure_import(fidelity: str, wall: float) -> dict[str, Any]:
    """Time to import the package, in an interpreter that has imported nothing yet."""
    program = "import time; start = time.perf_counter(); import wt_gym; print(time.perf_counter() - start)"
    return {"import_s": min(float(output_of([sys.executable, "-c", program])[-1]) for _ in range(3))}


def measure_start(fidelity: str, wall: float) -> dict[str, Any]:
    """Time to build the simulator and to take the first step, imports included."""
    start = time.perf_counter()
    from wt_gym.simulation import Simulator
    from wt_gym.wind import SteadyInflow

    simulator = Simulator("nrel_5mw", SteadyInflow(12.0), fidelity)
    simulator.reset(rotor_speed=1.267)
    simulator.advance(0.2, pitch=0.07, generator_torque=43e3)
    return {"first_step_s": time.perf_counter() - start}


def measure_threads(fidelity: str, wall: float) -> dict[str, Any]:
    """Wall time of an aerodynamic step on one and on two threads, ten steps in turn."""
    from wt_gym.simulation import Simulator
    from wt_gym.wind import SteadyInflow

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
    from wt_gym.turbines import load_turbine
    from wt_gym.wind import TurbulenceBox

    def seconds(name: str) -> float:
        turbine, seeds = load_turbine(name), itertools.count(1)  # a box of the same seed would come from memory

        def make() -> TurbulenceBox:
            size = turbine.hub_height, turbine.rotor_diameter
            return TurbulenceBox.kaimal(12.0, *size, seed=next(seeds), cache=False)

        return best_of(make, wall, most=2)

    return {"box_s": {name: seconds(name) for name in ("nrel_5mw", "iea_15mw", "iea_22mw")}}


def measure_structures(fidelity: str, wall: float) -> dict[str, Any]:
    """Time of a structural step, by formulation: the turbine, and the examples of the other two."""
    from validation import mixed_coordinates, observer_frame
    from wt_gym.multibody.integrators.schemes import HammingIntegrator
    from wt_gym.simulation import FIDELITIES, Simulator
    from wt_gym.wind import SteadyInflow

    figures = {}
    for form in ("embedded", "constrained"):
        chosen = replace(FIDELITIES[fidelity], formulation=form)
        simulator = Simulator("nrel_5mw", SteadyInflow(12.0), chosen)
        simulator.reset(rotor_speed=1.267, pitch=0.07)
        integrator = HammingIntegrator(simulator.structure.system, 0.01)
        integrator.start(simulator.coupling.integrator.state.copy())
        figures[f"turbine, {form}"] = structural_cost(integrator, wall / 5)
    small = mixed_coordinates.small_turbine(speed=mixed_coordinates.Disc().speed)
    integrator = HammingIntegrator(small.system, mixed_coordinates.STEP)
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
    "import": measure_import,
    "learning": measure_learning,
    "outside": measure_outside,
    "start": measure_start,
    "threads": measure_threads,
    "structures": measure_structures,
    "turbulence": measure_turbulence,
    "vector": measure_vector,
}


# ---- the parent ----


def in_process(what: str, fidelity: str, wall: float, **environment: str) -> dict[str, Any]:
    """Run one measurement in a fresh interpreter."""
    command = [sys.executable, "-m", "wt_gym", "bench", "--worker", what, fidelity, "--seconds", str(wall)]
    own = {"PYTHONPATH": package_path(), "PYTHONSAFEPATH": "1"}
    out: dict[str, Any] = json.loads(output_of(command, own | environment)[-1])
    return out


def output_of(command: list[str], environment: dict[str, str] | None = None) -> list[str]:
    """Lines that a program of one thread prints; where this is broken off, the program ends with all it has begun.

    Raises
    ------
    ChildProcessError
        If the program fails, which it has then explained itself.
    """
    with subprocess.Popen(
        command, env=os.environ | SINGLE_THREAD | (environment or {}), stdout=subprocess.PIPE, text=True,
        process_group=0,  # which Ctrl-C in a terminal does not reach: each would end in a traceback of its own
    ) as process:  # fmt: skip
        try:
            lines = process.communicate()[0].splitlines()
        except BaseException:
            _end(process)
            raise
    if process.returncode:
        raise ChildProcessError(f"a measurement failed with status {process.returncode}: {' '.join(command)}")
    return lines


def _end(process: subprocess.Popen[str]) -> None:
    """End a program with all it has begun; on Windows the program alone, whose own programs end by themselves."""
    if hasattr(os, "killpg"):
        with suppress(ProcessLookupError):  # all have ended meanwhile
            os.killpg(process.pid, signal.SIGKILL)
    else:
        process.kill()


def package_path() -> str:
    """Search path of the workers: this very package first, installed or not."""
    return os.pathsep.join([str(CLONE), *filter(None, [os.environ.get("PYTHONPATH")])])


def beside(script: str, *options: str) -> dict[str, Any]:
    """Run another benchmark script, show what it prints and return its figures."""
    command = [sys.executable, str(CLONE / "scripts" / script), *options, "--json"]
    *lines, figures = output_of(command)
    print("\n".join(lines))
    out: dict[str, Any] = json.loads(figures)
    return out


def processor() -> str:
    """Name of the processor."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as info:
            return next(line.split(":", 1)[1].strip() for line in info if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def main(words: list[str] | None = None) -> None:
    """Measure and print."""
    with user_errors(), stoppable("what was measured is printed above"):
        arguments = parse_arguments(words)
        if not arguments.worker:
            measure(arguments)
            return
    what, fidelity = arguments.worker
    print(json.dumps(WORKERS[what](fidelity, arguments.seconds)))


def measure(arguments: argparse.Namespace) -> None:
    """Measure everything that is asked for, and print it as it comes."""
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    figures: dict[str, Any]
    figures = {"processor": processor(), "python": platform.python_version(), "load_at_start": load}
    print(f"{figures['processor']}, {os.cpu_count()} cores, load {load:.2f}, Python {figures['python']}, one thread")
    wall = arguments.seconds
    if not arguments.no_cold:
        with tempfile.TemporaryDirectory() as empty:
            figures["cold"] = in_process("start", "training", wall, NUMBA_CACHE_DIR=empty)
        print(f"first step, cold compilation cache: {figures['cold']['first_step_s']:6.1f} s")
    in_process("start", "training", wall)
    figures["warm"] = in_process("start", "training", wall) | in_process("import", "training", wall)
    print(f"first step, warm compilation cache: {figures['warm']['first_step_s']:6.1f} s")
    print(f"import of wt_gym:                   {figures['warm']['import_s']:6.2f} s")
    figures["turbulence"] = in_process("turbulence", "training", wall)
    boxes = ", ".join(f"{name} {seconds:.1f} s" for name, seconds in figures["turbulence"]["box_s"].items())
    print(f"turbulence box of 600 s:            {boxes}")
    figures["kernels"] = in_process("structures", "training", wall) if IN_CLONE else {"structural": {}}
    for form, cost in figures["kernels"]["structural"].items():
        rhs = f", {cost['rhs_us']:5.2f} us per right-hand side" if "rhs_us" in cost else ""
        print(
            f"{form + ':':35s} {cost['step_us']:6.1f} us per structural step{rhs} "
            f"({cost['velocities'] + cost['multipliers']} unknowns: "
            f"{cost['velocities']} velocities, {cost['multipliers']} multipliers)"
        )
    for fidelity in arguments.fidelity:
        figures[fidelity] = in_process("simulator", fidelity, wall) | in_process("environment", fidelity, wall)
        f = figures[fidelity]
        print(
            f"{fidelity + ':':12s} {f['real_time_factor']:7.1f} x real time "
            f"(best {f['real_time_factor_best']:.1f}), "
            f"{f['env_steps_per_s']:6.0f} env steps/s, reset {f['env_reset_s']:.2f} s, "
            f"{f['peak_memory_mib']:.0f} MiB simulator, {f['env_peak_memory_mib']:.0f} MiB env"
        )
    figures["outside"] = in_process("outside", "training", wall / 2)
    o = figures["outside"]
    print(
        f"LoadReduction: {100 * o['share_outside']:.1f} % of a step outside the simulator, "
        f"{100 * o['share_outside_lidar']:.1f} % with a lidar, "
        f"{100 * o['share_outside_vector']:.1f} % of four turbines in one vector environment"
    )
    figures["vector"] = v = in_process("vector", "training", wall)
    print(
        f"one turbine: {v['one_per_s']:.0f} steps/s; {v['turbines']}: {v['threads_per_s']:.0f} by threads "
        f"({v['threads_over_one']:.2f} x one), "
        f"{v['processes_per_s']:.0f} by processes ({v['processes_over_one']:.2f} x)"
    )
    if "reference" in arguments.fidelity:
        figures["threads"] = t = in_process("threads", "reference", wall)
        one, two = t["step_s_one_thread"], t["step_s_two_threads"]
        print(f"reference, one step: {one * 1e3:.1f} ms on one thread, {two * 1e3:.1f} ms on two ({one / two:.2f} x)")
    if arguments.learning:
        figures["learning"] = learned = in_process("learning", "training", arguments.learning)
        ways = {
            "bare": "no learner, threads",
            "threads": "PPO, threads",
            "stable_baselines": "PPO of stable-baselines3, threads",
            "processes": "PPO, a process each",
        }
        for way, label in ways.items():
            share = learned["learner_over_environment"].get(way)
            print(
                f"{learned['turbines']} turbines, {label}: {learned['steps_per_s'][way]:.0f} steps/s"
                + (
                    f"; learner {100 * share:.1f} % of the processor time of the environment"
                    if share is not None
                    else ""
                )
            )
    if IN_CLONE and not arguments.no_induction:
        figures["induction"] = beside("bench_induction.py")
    if arguments.pterasoftware:
        figures["pterasoftware"] = beside("bench_pterasoftware.py", "--set-up")
    if arguments.json:
        print(json.dumps(figures))
