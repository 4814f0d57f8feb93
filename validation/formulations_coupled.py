"""Every formulation, integrator and set of coordinates as the coupled turbine of an environment.

Each combination runs an episode in turbulence under the baseline controller, random actions, and a snapshot; what it
costs and how far it is from the default of the same turbine is a table (docs/formulations.md). Nodal blades are also
compared with modal ones, both with torsion: deflection in steady wind and frequencies at rest.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from scipy.linalg import eigh

from validation.case import CaseResult, Check, case
from wt_gym.analysis.metrics import run_metrics
from wt_gym.base.ids import present_id
from wt_gym.envs.turbine_env import turbine_env_of
from wt_gym.simulation import FIDELITIES, Recorder
from wt_gym.simulation.models import assemble
from wt_gym.simulation.start import elastic_equilibrium

__all__ = ["COMBINATIONS", "NODAL_AND_MODAL", "Combination", "measure", "parked_frequencies", "steady_tip"]


class Times(NamedTuple):
    """Of an episode [s]."""

    skip: float
    """Beginning that is left out."""
    duration: float
    """Whole time under the controller."""
    random: float
    """Under random actions afterwards."""


LARGE, SMALL = Times(30.0, 90.0, 20.0), Times(0.6, 1.8, 0.4)
"""Some twenty turns of a large rotor, and fifty of the small one, whose control steps are a tenth as long."""
STEADY, SETTLED = 60.0, 30.0
"""Time in steady wind, and the end of it over which the deflection is averaged [s]."""
LOWEST = 8
"""Lowest parked frequencies that are compared: two of the tower, the drivetrain's, three flapwise, two edgewise."""
TRAINING = FIDELITIES["training"]
IMPLICIT = {"integrator": "generalized_alpha"}
LINEAR: dict[str, Any] = {"formulation": "observer", "frame_displacement": "linear"}
"""Observer frames as published."""
TORSION: dict[str, Any] = {"blade_modes": (2, 1, 1)}
WINDS = {"NREL5MW": 10.0, "IEA15MW": 10.0, "Gebhardt45m": 10.0, "NadaSmall": 8.0}


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
    ending : str, optional
        How its episode has to end, where the formulation leaves out what this rotor stands by.
    """

    turbine: str
    name: str
    fidelity: object
    like: bool = True
    ending: str | None = None

    @property
    def label(self):
        """Turbine and name."""
        return f"{self.turbine}, {self.name}"

    @property
    def times(self):
        """Of its episode."""
        return SMALL if self.turbine == "NadaSmall" else LARGE


def _of(turbine, name, like=True, **changes):
    return Combination(turbine, name, replace(TRAINING, **changes), like)


COMBINATIONS = (
    _of("NREL5MW", "embedded, Hamming, modal"),
    _of("NREL5MW", "embedded, Newmark, modal", integrator="newmark"),
    _of("NREL5MW", "embedded, generalized-α, modal", **IMPLICIT),
    _of("NREL5MW", "embedded, generalized-α, 4 modal bodies, torsion", False, blade_bodies=4, **IMPLICIT, **TORSION),
    _of("NREL5MW", "embedded, generalized-α, 12 nodal bodies, torsion", False, blade_bodies=12, blade_elements=12,
        blade_coordinates="nodal", **IMPLICIT, **TORSION),
    _of("NREL5MW", "embedded, generalized-α, nodal tower", tower_coordinates="nodal", tower_elements=6, **IMPLICIT),
    _of("NREL5MW", "constrained, Hamming, modal", formulation="constrained"),
    _of("NREL5MW", "constrained, generalized-α, modal", formulation="constrained", **IMPLICIT),
    _of("NREL5MW", "constrained, generalized-α, 4 modal bodies", False, formulation="constrained", blade_bodies=4,
        **IMPLICIT),
    _of("NREL5MW", "observer, clamped", False, **LINEAR),
    _of("NREL5MW", "observer, clamped, generalized-α", False, **LINEAR, **IMPLICIT),
    _of("NREL5MW", "observer, simply supported", False, **LINEAR, reference_condition="simply_supported"),
    _of("NREL5MW", "observer, supported at 3/4", False, **LINEAR, reference_condition="three_quarter"),
    _of("IEA15MW", "embedded, Hamming, modal"),
    _of("IEA15MW", "embedded, generalized-α, 4 modal bodies, torsion", False, blade_bodies=4, **IMPLICIT, **TORSION),
    _of("IEA15MW", "embedded, generalized-α, 8 modal bodies, torsion", False, blade_bodies=8, **IMPLICIT, **TORSION),
    _of("IEA15MW", "embedded, generalized-α, 12 nodal bodies, torsion", False, blade_bodies=12, blade_elements=12,
        blade_coordinates="nodal", **IMPLICIT, **TORSION),
    _of("IEA15MW", "constrained, Hamming, modal", formulation="constrained"),
    _of("IEA15MW", "embedded, generalized-α, 4 modal bodies", False, blade_bodies=4, **IMPLICIT),
    _of("IEA15MW", "observer, clamped", False, **LINEAR),
    _of("Gebhardt45m", "embedded, Hamming, modal"),
    _of("Gebhardt45m", "embedded, generalized-α, 4 modal bodies, torsion", False, blade_bodies=4, **IMPLICIT,
        **TORSION),
    Combination("Gebhardt45m", "fidelity gebhardt (constrained)", FIDELITIES["gebhardt"], False),
    Combination("Gebhardt45m", "fidelity gebhardt-full (constrained)", FIDELITIES["gebhardt-full"], False),
    _of("Gebhardt45m", "observer, clamped", False, **LINEAR),
    _of("NadaSmall", "embedded, Hamming, modal"),
    Combination("NadaSmall", "fidelity mixed (constrained, Newmark, nodal)", FIDELITIES["mixed"], False),
    # its blades are held against the wind by their rotation, which a body in one linear observer frame does not feel
    Combination("NadaSmall", "observer, clamped", replace(TRAINING, **LINEAR), False, "tower_strike"),
)  # fmt: skip

_TWISTING = "embedded, generalized-α, {} bodies, torsion"
NODAL_AND_MODAL = (
    ("NREL5MW", _TWISTING.format("12 nodal"), _TWISTING.format("4 modal")),
    ("IEA15MW", _TWISTING.format("12 nodal"), _TWISTING.format("8 modal")),
)
"""Turbine, and combinations that have to agree. Blades of the IEA 15-MW bend so far that four bodies are too few: their
tips are 4 % farther out than those of twelve, be they modal or nodal."""


def measure(combination):
    """An episode, random actions and a snapshot of a combination.

    Returns
    -------
    dict
        "power" [kW], "flap_DEL" [MN m], "tip" mean of blade 1 [m], "ms" of processor time per control step,
        "frequencies" [Hz] of the parked turbine, lowest first (None without them), "repeats" whether the
        snapshot goes on bit for bit, "failure" of an episode or None.
    """
    times = combination.times
    env = gym.make(
        present_id(f"wt_gym/{combination.turbine}-Turbulent-v0"), fidelity=combination.fidelity, action_mode="residual",
        wind_speed=WINDS[combination.turbine], episode_length=times.duration + times.random, max_episode_steps=10**9,
    )  # fmt: skip
    raw = turbine_env_of(env)
    found: dict[str, Any] = {"failure": None}
    env.reset(seed=1)
    zero, dt = np.zeros(raw.layout.action.size, dtype=np.float32), raw.control_dt
    found["repeats"] = goes_on_alike(env, zero)
    env.reset(seed=1)
    recorder, began = Recorder(raw.simulator), time.process_time()
    info: dict[str, Any] = {}
    for _ in range(round(times.duration / dt)):
        *_, terminated, _, info = env.step(zero)
        if terminated:
            break
        recorder.append(raw.signals)
    found["ms"] = 1e3 * (time.process_time() - began) / max(len(recorder), 1)
    rng = np.random.default_rng(1)
    while "termination" not in info and raw.signals.time < times.duration + 0.9 * times.random:
        *_, info = env.step(rng.uniform(-1.0, 1.0, zero.shape).astype(np.float32))
    found["failure"] = info.get("termination")
    if len(recorder) * dt > times.skip + 0.1 * times.duration:
        data = recorder.to_dataset()
        metrics = run_metrics(data, raw.turbine, times.skip)
        found |= {"power": metrics["mean_power"] / 1e3, "flap_DEL": metrics["blade_flap_del"] / 1e6,
                  "tip": float(data.tip_out_of_plane_1.values[data.time.values > times.skip].mean())}  # fmt: skip
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


def parked_frequencies(turbine, fidelity, step=1e-5):
    """Lowest undamped frequencies of the parked turbine, which its weight bends [Hz].

    From the derivatives of its forces, not of its accelerations: those of short bodies and of nodes exceed those of the
    bent blade so far that differences show nothing of these.

    Returns
    -------
    array (LOWEST,) or None
        Ascending; None with constraint equations, and for observer frames that no coordinates of the tree describe.
    """
    structure = assemble(turbine, fidelity).structure
    system = structure.system
    if system.constraints or fidelity.reference_condition != "clamped":
        return None
    y, inputs, work = system.initial_state(), system.new_inputs(), system.new_work()
    elastic_equilibrium(system, y, inputs, work, structure.azimuth_q, structure.azimuth_u, True)
    columns = []
    for k in range(system.n_q):
        forces = []
        for side in (step, -step):
            moved = y.copy()
            moved[k] += side
            forces.append(system.balance(moved, inputs, work)[1].copy())
        columns.append((forces[1] - forces[0]) / (2.0 * step))
    mass = np.tril(system.balance(y, inputs, work)[0])
    mass += np.tril(mass, -1).T
    free = np.delete(np.arange(system.n_u), structure.azimuth_u)  # the generator is locked
    stiffness = np.delete(np.array(columns).T, structure.azimuth_q, axis=1)[free]
    squares = eigh(0.5 * (stiffness + stiffness.T), mass[np.ix_(free, free)], eigvals_only=True)
    return np.sqrt(squares[:LOWEST]) / (2.0 * np.pi)


def steady_tip(combination, wind_speed=9.0):
    """Mean deflection of all tips in steady, sheared wind under the baseline controller [m]."""
    env = gym.make(
        present_id(f"wt_gym/{combination.turbine}-Steady-v0"), fidelity=combination.fidelity, action_mode="residual",
        wind_speed=wind_speed, episode_length=STEADY, max_episode_steps=10**9,
    )  # fmt: skip
    env.reset(seed=1)
    raw, tips = turbine_env_of(env), []
    zero = np.zeros(raw.layout.action.size, dtype=np.float32)
    for _ in range(round(STEADY / raw.control_dt)):
        env.step(zero)
        tips.append(raw.signals.tip_out_of_plane.mean())
    env.close()
    return float(np.mean(tips[-round(SETTLED / raw.control_dt) :]))


def nodal_against_modal(results):
    """Checks of nodal blades against modal ones, from what `measure` found by the labels of the combinations."""
    known, checks = {combination.label: combination for combination in COMBINATIONS}, []
    for turbine, nodal, modal in NODAL_AND_MODAL:
        pair = [f"{turbine}, {name}" for name in (nodal, modal)]
        tips = [steady_tip(known[label]) for label in pair]
        frequencies = [results[label]["frequencies"] for label in pair]
        shift = float(np.abs(100.0 * (frequencies[0] / frequencies[1] - 1.0)).max())
        what = f"{pair[0]} against {modal}"
        checks += [
            Check(f"{what}: tip deflection in steady wind of 9 m/s", tips[1], tips[0], 0.01, "m"),
            Check(f"{what}: largest change of the lowest parked frequencies", "<= 0.5", shift, unit="%"),
        ]
    return checks


@case(
    "formulations-coupled",
    "Every formulation, integrator and set of coordinates as an environment, against the default of the turbine",
    "the same turbine in the embedded form with modal bodies, Hamming's scheme",
    slow=True,
)
def formulations_coupled() -> CaseResult:
    """Each runs, repeats from a snapshot, and is the same turbine as far as it has the same shapes."""
    checks, lines, results = [], [], {}
    defaults: dict[str, dict[str, Any]] = {}
    lines.append("turbine, combination: ms a step, power, flap DEL and mean tip deflection against the default [%], "
                 "largest change of the lowest parked frequencies [%]")  # fmt: skip
    for combination in COMBINATIONS:
        found = results[combination.label] = measure(combination)
        more, line = compare(combination, found, defaults.setdefault(combination.turbine, found))
        checks += more
        lines.append(line)
        print(line, flush=True)
    return CaseResult(checks + nodal_against_modal(results), notes="\n".join(lines))


def compare(combination, found, default):
    """Checks of a combination and its line of the table, from what `measure` found for it and for the default."""
    label = combination.label
    changes = {key: 100.0 * (found[key] / default[key] - 1.0) if key in found else float("nan")
               for key in ("power", "flap_DEL", "tip")}  # fmt: skip
    shift = float("nan")
    if found["frequencies"] is not None and default["frequencies"] is not None:
        shift = float(np.abs(100.0 * (found["frequencies"] / default["frequencies"] - 1.0)).max())
    expected = "early" if combination.ending is None else f"otherwise than by {combination.ending}"
    checks = [
        Check(f"{label}: episodes that end {expected}", 0.0, found["failure"] != combination.ending, 0.0),
        Check(f"{label}: snapshots that do not repeat", 0.0, not found["repeats"], 0.0),
    ]
    if combination.like:
        checks += [
            Check(f"{label}: power against the default", "in [-0.5, 0.5]", changes["power"], unit="%"),
            Check(f"{label}: flap DEL against the default", "in [-2, 2]", changes["flap_DEL"], unit="%"),
        ]
    line = (
        f"{label}: {found['ms']:.2f}, {changes['power']:+.2f}, {changes['flap_DEL']:+.2f}, {changes['tip']:+.2f}, "
        f"{shift:.2f}{'' if found['failure'] is None else ', ended by ' + found['failure']}"
    )
    return checks, line
