"""Every formulation, integrator and set of coordinates as the coupled turbine of an environment.

Each combination runs an episode in turbulence under the baseline controller, random actions, and a snapshot; what it
costs and how far it is from the default of the same turbine is a table (docs/formulations.md).
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import gymnasium as gym
import numpy as np

from validation.case import CaseResult, Check, case
from wt_gym.analysis.metrics import run_metrics
from wt_gym.errors import SimulationError
from wt_gym.simulation import FIDELITIES, Recorder, Simulator
from wt_gym.wind import SteadyInflow

__all__ = ["COMBINATIONS", "Combination", "measure"]

SKIP, DURATION, RANDOM = 30.0, 90.0, 20.0
"""Beginning that is left out, whole time, and time under random actions afterwards [s]."""
LOWEST = 8
"""Lowest parked frequencies that are compared: two of the tower, the drivetrain's, three flapwise, two edgewise."""
TRAINING = FIDELITIES["training"]
IMPLICIT = {"integrator": "generalised_alpha"}
TORSION = {"blade_modes": (2, 1, 1)}
WINDS = {"NREL5MW": 10.0, "IEA15MW": 10.0, "Gebhardt45m": 10.0}


@dataclass(frozen=True)
class Combination:
    """What differs from the training fidelity of a turbine.

    Attributes
    ----------
    turbine : str
        As in the ids of the environments.
    name : str
    fidelity : Fidelity
    like : bool
        Whether the same turbine is described with the same shapes, so that power and loads have to be nearly the same.
    """

    turbine: str
    name: str
    fidelity: object
    like: bool = True


def _of(turbine, name, like=True, **changes):
    return Combination(turbine, name, replace(TRAINING, **changes), like)


COMBINATIONS = (
    _of("NREL5MW", "embedded, Hamming, modal"),
    _of("NREL5MW", "embedded, Newmark, modal", integrator="newmark"),
    _of("NREL5MW", "embedded, generalised-α, modal", **IMPLICIT),
    _of("NREL5MW", "embedded, generalised-α, 4 modal bodies, torsion", False, blade_bodies=4, **IMPLICIT, **TORSION),
    _of("NREL5MW", "embedded, generalised-α, 12 nodal bodies, torsion", False, blade_bodies=12, blade_elements=12,
        blade_coordinates="nodal", **IMPLICIT, **TORSION),
    _of("NREL5MW", "embedded, generalised-α, nodal tower", tower_coordinates="nodal", tower_elements=6, **IMPLICIT),
    _of("NREL5MW", "constrained, Hamming, modal", formulation="constrained"),
    _of("NREL5MW", "constrained, generalised-α, modal", formulation="constrained", **IMPLICIT),
    _of("NREL5MW", "constrained, generalised-α, 4 modal bodies", False, formulation="constrained", blade_bodies=4,
        **IMPLICIT),
    _of("NREL5MW", "observer, clamped", False, formulation="observer"),
    _of("NREL5MW", "observer, clamped, generalised-α", False, formulation="observer", **IMPLICIT),
    _of("NREL5MW", "observer, simply supported", False, formulation="observer", reference_condition="simply_supported"),
    _of("NREL5MW", "observer, supported at 3/4", False, formulation="observer", reference_condition="three_quarter"),
    _of("IEA15MW", "embedded, Hamming, modal"),
    _of("IEA15MW", "embedded, generalised-α, 4 modal bodies, torsion", False, blade_bodies=4, **IMPLICIT, **TORSION),
    _of("IEA15MW", "embedded, generalised-α, 8 modal bodies, torsion", False, blade_bodies=8, **IMPLICIT, **TORSION),
    _of("IEA15MW", "embedded, generalised-α, 12 nodal bodies, torsion", False, blade_bodies=12, blade_elements=12,
        blade_coordinates="nodal", **IMPLICIT, **TORSION),
    _of("IEA15MW", "constrained, Hamming, modal", formulation="constrained"),
    _of("IEA15MW", "observer, clamped", False, formulation="observer"),
    _of("Gebhardt45m", "embedded, Hamming, modal"),
    _of("Gebhardt45m", "embedded, generalised-α, 4 modal bodies, torsion", False, blade_bodies=4, **IMPLICIT,
        **TORSION),
    Combination("Gebhardt45m", "fidelity gebhardt (constrained)", FIDELITIES["gebhardt"], False),
    _of("Gebhardt45m", "observer, clamped", False, formulation="observer"),
)  # fmt: skip


def measure(combination):
    """An episode, random actions and a snapshot of a combination.

    Returns
    -------
    dict
        "power" [kW], "flap_DEL" [MN m], "tip" mean of blade 1 [m], "ms" of processor time per control step of 0.2 s,
        "frequencies" [Hz] of the parked turbine, lowest first (None without a linear model), "repeats" whether the
        snapshot goes on bit for bit, "failure" of an episode or None.
    """
    env = gym.make(
        f"wt_gym/{combination.turbine}-Turbulent-v0", fidelity=combination.fidelity, action_mode="residual",
        wind_speed=WINDS[combination.turbine], episode_length=DURATION + RANDOM, max_episode_steps=10**9,
    )  # fmt: skip
    raw, found = env.unwrapped, {"failure": None}
    env.reset(seed=1)
    zero, dt = np.zeros(env.action_space.shape, dtype=np.float32), raw.control_dt
    found["repeats"] = goes_on_alike(env, zero)
    env.reset(seed=1)
    recorder, began, info = Recorder(raw.simulator), time.process_time(), {}
    for _ in range(round(DURATION / dt)):
        *_, terminated, _, info = env.step(zero)
        if terminated:
            break
        recorder.append(raw.signals)
    found["ms"] = 1e3 * (time.process_time() - began) / max(len(recorder), 1)
    rng = np.random.default_rng(1)
    while "termination" not in info and raw.signals.time < DURATION + RANDOM - 2.0:
        *_, info = env.step(rng.uniform(-1.0, 1.0, env.action_space.shape).astype(np.float32))
    found["failure"] = info.get("termination")
    if len(recorder) * dt > SKIP + 10.0:
        data = recorder.to_dataset()
        metrics = run_metrics(data, raw.turbine, SKIP)
        found |= {"power": metrics["mean_power"] / 1e3, "flap_DEL": metrics["blade_flap_del"] / 1e6,
                  "tip": float(data.tip_out_of_plane_1.values[data.time.values > SKIP].mean())}  # fmt: skip
    found["frequencies"] = parked_frequencies(raw.turbine, combination.fidelity)
    env.close()
    return found


def goes_on_alike(env, action):
    """Whether an episode goes on from a snapshot bit for bit; all is compiled then."""
    raw, ends = env.unwrapped, []
    for _ in range(5):
        env.step(action)
    state = raw.snapshot()
    for _ in range(2):
        raw.restore(state)
        for _ in range(5):
            env.step(action)
        ends.append(raw.signals.values.copy())
    return bool(np.array_equal(*ends))


def parked_frequencies(turbine, fidelity):
    """Lowest natural frequencies of the parked turbine [Hz], None for structures that have no linear model."""
    simulator = Simulator(turbine, SteadyInflow(8.0), fidelity)
    try:
        model = simulator.linearize(rotor_speed=0.0, aerodynamics="none", generator="locked", outputs=("rotor_speed",))
    except SimulationError:
        return None
    found = np.sort([mode.frequency for mode in model.modes() if mode.frequency > 0.0])
    return found[:LOWEST]


@case(
    "formulations-coupled",
    "Every formulation, integrator and set of coordinates as an environment, against the default of the turbine",
    "the same turbine in the embedded form with modal bodies, Hamming's scheme",
    slow=True,
)
def formulations_coupled():
    """Each runs, repeats from a snapshot, and is the same turbine as far as it has the same shapes."""
    checks, lines, defaults = [], [], {}
    lines.append("turbine, combination: ms a step, power, flap DEL and mean tip deflection against the default [%], "
                 "largest change of the lowest parked frequencies [%]")  # fmt: skip
    for combination in COMBINATIONS:
        found, label = measure(combination), f"{combination.turbine}, {combination.name}"
        default = defaults.setdefault(combination.turbine, found)
        changes = {key: 100.0 * (found[key] / default[key] - 1.0) if key in found else float("nan")
                   for key in ("power", "flap_DEL", "tip")}  # fmt: skip
        shift = float("nan")
        if found["frequencies"] is not None and default["frequencies"] is not None:
            shift = float(np.abs(100.0 * (found["frequencies"] / default["frequencies"] - 1.0)).max())
        checks.append(Check(f"{label}: episodes that end early", 0.0, float(found["failure"] is not None), 0.0))
        checks.append(Check(f"{label}: snapshots that do not repeat", 0.0, float(not found["repeats"]), 0.0))
        if combination.like:
            checks += [
                Check(f"{label}: power against the default", "in [-0.5, 0.5]", changes["power"], 0.0, "%"),
                Check(f"{label}: flap DEL against the default", "in [-2, 2]", changes["flap_DEL"], 0.0, "%"),
            ]
        lines.append(
            f"{label}: {found['ms']:.2f}, {changes['power']:+.2f}, {changes['flap_DEL']:+.2f}, {changes['tip']:+.2f}, "
            f"{shift:.2f}{'' if found['failure'] is None else ', ended by ' + found['failure']}"
        )
        print(lines[-1], flush=True)
    return CaseResult(checks, notes="\n".join(lines))
