#!/usr/bin/env python3
"""Measure a structural step by formulation: the turbine, and the validation examples of the other formulations.

scripts/bench_structures.py --seconds 20 --json
"""

import argparse
import json
import sys
import time
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # the cases are no part of the installed package
from envs_tests.physics.cases import observer_frame, small_turbine
from wt_gym.multibody.system import HammingIntegrator
from wt_gym.simulation import FIDELITIES, Simulator
from wt_gym.wind import SteadyInflow


def measure(wall):
    """Unknowns and cost of a step by formulation, within a wall time [s]."""
    costs = {}
    for form in ("embedded", "constrained"):
        fidelity = replace(FIDELITIES["training"], formulation=form)
        simulator = Simulator("nrel_5mw", SteadyInflow(12.0), fidelity)
        simulator.reset(rotor_speed=1.267, pitch=0.07)
        integrator = HammingIntegrator(simulator.structure.system, 0.01)
        integrator.start(simulator.coupling.integrator.state.copy())
        costs[f"turbine, {form}"] = structural_cost(integrator, wall / 5)
    small = small_turbine.small_turbine(speed=small_turbine.Disc().speed)
    integrator = HammingIntegrator(small.system, small_turbine.STEP)
    integrator.start(small.start)
    costs["mixed coordinates"] = structural_cost(integrator, wall / 5)
    load = observer_frame.ramp(observer_frame.FLAP_LOAD, observer_frame.edge_load()[0], 3.0)
    for label, n_modes in (("finite elements", None), ("16 modes", 16)):
        integrator = observer_frame.rotor(load, "undeformed", n_modes=n_modes)
        costs[f"observer frame, {label}"] = structural_cost(integrator, wall / 5)
    return costs


def structural_cost(integrator, wall, n=20, most=500):
    """Unknowns of a system and the cost of a step: the shortest of calls of a few milliseconds, seldom interrupted."""
    integrator.advance(n)
    best, calls, start = float("inf"), 0, time.perf_counter()
    while time.perf_counter() - start < wall and calls < most:
        calls += 1
        before = time.perf_counter()
        integrator.advance(n)
        best = min(best, time.perf_counter() - before)
    system, step = integrator.system, best / n * 1e6
    if hasattr(system, "n_u"):
        unknowns = {"velocities": system.n_u, "multipliers": system.n_constraints}
        return unknowns | {"step_us": step, "rhs_us": step / (integrator.n_corrections + 1)}
    return {
        "velocities": sum(body.n for body in system.bodies),
        "multipliers": len(integrator.state.multiplier),
        "step_us": step,
    }


def main(arguments=None):
    """Print the costs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=20.0, help="wall time (default: %(default)s)")
    parser.add_argument("--json", action="store_true", help="print one JSON object last")
    options = parser.parse_args(arguments)
    costs = measure(options.seconds)
    for form, cost in costs.items():
        rhs = f", {cost['rhs_us']:5.2f} us per right-hand side" if "rhs_us" in cost else ""
        print(
            f"{form + ':':35s} {cost['step_us']:6.1f} us per structural step{rhs} "
            f"({cost['velocities'] + cost['multipliers']} unknowns: "
            f"{cost['velocities']} velocities, {cost['multipliers']} multipliers)"
        )
    if options.json:
        print(json.dumps({"structural": costs}))


if __name__ == "__main__":
    main()
