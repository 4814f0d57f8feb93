"""The same turbine in every formulation, integrator and set of coordinates."""

import time
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from scipy.linalg import eigh

from envs_tests.physics.validation import DATA, CaseResult, Check, Curve, Figure, case
from wt_gym.analysis.metrics import run_metrics
from wt_gym.base.files import read_toml
from wt_gym.envs.turbine_env import turbine_env_of
from wt_gym.multibody.constraints.descriptor import descriptor_form
from wt_gym.multibody.integrators.schemes import HammingIntegrator
from wt_gym.multibody.tree import output_kernels, tree_kernels
from wt_gym.simulation import FIDELITIES, Recorder, Simulator
from wt_gym.simulation.models import assemble
from wt_gym.simulation.start import elastic_equilibrium
from wt_gym.turbine_records import RECORDS
from wt_gym.wind.steady import SteadyInflow

# ---- joints against multipliers -------------------------------------------------------------------------------------
# The NREL 5-MW turns under the air loads of one instant of a simulation at 11 m/s, which the blades carry in their own
# frames, while its pitch and yaw drives follow moving commands. The generator holds the rotor near its speed by a
# torque that rises with it (slip).

SOURCE = "both forms follow from the same kinetic energy; Gebhardt et al. 2012, eqs. (2)–(11)"
FORMS = ("embedded", "constrained")
SPEED = 1.2
"""Rotor speed that the generator holds [rad/s]."""
PITCH = (0.02, 0.05, 0.08)
"""Pitch at the start [rad]."""
SLIP = 4e7
"""Rise of the generator's torque with the speed of the shaft [N m s/rad]: the speed settles within a second."""
GAINS = (0.0, 2.0, 10.0, 40.0)
"""Baumgarte's gains of the runs without projection [1/s]."""
TURNED_AWAY = 1.0
"""Angle by which a difference of the azimuth is divided [rad]."""


@cache
def _turbines(name):
    """For each form: simulator and state after four seconds of coupled simulation, and the loads at that time."""
    simulators = {}
    for form in FORMS:
        fidelity = replace(FIDELITIES[name], formulation=form)
        simulators[form] = Simulator("nrel_5mw", SteadyInflow(11.0, shear_exponent=0.2), fidelity)
    embedded = simulators["embedded"]
    embedded.reset(rotor_speed=SPEED, pitch=0.02, azimuth=0.3)
    signals = embedded.advance(4.0, pitch=PITCH, generator_torque=38e3)
    state = embedded.coupling.integrator.state.copy()
    states = {"embedded": state}
    tied = simulators["constrained"].structure
    states["constrained"] = tied.adopt(embedded.structure, state)
    for simulator in simulators.values():
        simulator.structure.system.tree.dof_damping[simulator.structure.azimuth_u] = SLIP
    return simulators, states, embedded.coupling.integrator.inputs.body_loads[1].copy(), signals.generator_torque


def _set_inputs(inputs, structure, loads, torque, start, interval):
    """Loads, generator torque and the moving commands of the drives over one interval [s]."""
    inputs.body_loads[:] = loads
    inputs.dof_force[:, structure.azimuth_u] = -97.0 * torque
    inputs.reference_rate[:, structure.azimuth_u] = SPEED
    for end, t in enumerate((start, start + interval)):
        inputs.servo_command[end, 0] = 0.02 * (1.0 - np.cos(0.3 * t))
        inputs.servo_command[end, 1:] = _pitch_demand(t)


def _pitch_demand(t):
    """Pitch demands (3,) that leave PITCH smoothly [rad]."""
    return np.array(PITCH) + np.array([0.05, 0.02, -0.02]) * (1.0 - np.cos(0.8 * t))


@dataclass(frozen=True)
class _Run:
    """Histories of a run.

    ``coordinates`` (n_times, n) are the elastic ones of tower and blades and the azimuth, ten times a second; speed the
    least and largest rotor speed [rad/s]; position and velocity the largest constraint residuals [m or rad; per second]
    of the states from which steps start, drift those before the projection, with the largest | |q| − 1 | of a
    quaternion before it is rescaled.
    """

    coordinates: np.ndarray
    speed: tuple[float, float]
    position: float = 0.0
    velocity: float = 0.0
    drift: tuple[float, float, float] = (0.0, 0.0, 0.0)


def _run(name, form, duration, step, starter="adams"):
    """Run one form of a fidelity; constraint residuals are taken at every step."""
    simulators, states, loads, torque = _turbines(name)
    structure = simulators[form].structure
    system = structure.system
    integrator = HammingIntegrator(system, step, starter=starter)
    _set_inputs(integrator.inputs, structure, loads, torque, 0.0, step)
    integrator.start(states[form])
    rows, speeds, position, velocity = [], [], 0.0, 0.0
    every = round(0.1 / step)
    for k in range(round(duration / step)):
        _set_inputs(integrator.inputs, structure, loads, torque, k * step, step)
        integrator.advance()
        if system.constraints:
            position = max(position, np.abs(integrator.work.residual).max())
            velocity = max(velocity, np.abs(integrator.work.residual_rate).max())
        if (k + 1) % every == 0:
            y = integrator.state
            elastic = [structure.elastic(b, y)[0] for b in (structure.tower, *structure.blades)]
            rows.append(np.concatenate([*elastic, [y[structure.azimuth_q]]]))
            speeds.append(y[system.n_q + structure.azimuth_u])
    return _Run(np.array(rows), (min(speeds), max(speeds)), float(position), float(velocity), integrator.drift)


@case("formulations-accelerations", "Constrained and embedded form: accelerations, multipliers, hub loads", SOURCE)
def accelerations() -> list[Check]:
    """One state, three solutions: embedded, constrained, and eq. (7) with quaternions."""
    simulators, states, loads, torque = _turbines("training")
    structures = {form: simulators[form].structure for form in FORMS}
    results = {}
    for form in FORMS:
        system = structures[form].system
        inputs, work = system.new_inputs(), system.new_work()
        _set_inputs(inputs, structures[form], loads, torque, 0.0, 0.1)
        y = states[form]
        rate = system.rates(y, inputs, work)
        u = rate[system.n_q : system.n_q + system.n_u]
        common = [structures[form].elastic(b, rate[: system.n_q + system.n_u])[1] for b in range(len(system.bodies))]
        wrench = np.zeros((len(system.bodies), 6))
        tree_kernels.kinematics(y, system.tree, work)
        multipliers = work.multipliers.copy()
        output_kernels.joint_wrenches(y, u, loads, system.tree, work, wrench)
        results[form] = np.concatenate([*common, [u[structures[form].azimuth_u]]]), wrench, multipliers, u, inputs
    one, two = results["embedded"], results["constrained"]
    blades = list(structures["embedded"].blades)
    descriptor = descriptor_form(structures["constrained"].system, states["constrained"], two[4])
    paper, paper_multipliers = descriptor.solve()
    scale, load = np.abs(one[0]).max(), np.abs(one[1]).max()
    return [
        Check("largest difference of an acceleration / largest acceleration", 0.0, _gap(one[0], two[0], scale), 1e-9),
        Check("multipliers against hub loads of the embedded form / largest", 0.0,
              _gap(two[2].reshape(-1, 6), one[1][blades], load), 1e-9),
        Check("all joint loads of both forms / largest", 0.0, _gap(two[1], one[1], load), 1e-9),
        Check("eq. (7) with quaternions: accelerations / largest", 0.0,
              _gap(descriptor.to_velocities @ paper, two[3], scale), 1e-9),
        Check("eq. (7) with quaternions: multipliers / largest", 0.0,
              _gap(-paper_multipliers[: len(two[2])], two[2], load), 1e-9),
    ]  # fmt: skip


def _gap(a, b, scale):
    return float(np.abs(a - b).max() / scale)


def coordinate_gaps(name, step, duration=20.0, starter="runge-kutta"):
    """Largest difference of each coordinate between the forms, by the largest size of that coordinate itself.

    The azimuth, which grows with time, is compared with one radian.
    """
    one, two = (_run(name, form, duration, step, starter).coordinates for form in FORMS)
    size = np.abs(one).max(axis=0)
    size[-1] = TURNED_AWAY
    return np.abs(one - two).max(axis=0) / size


@case(
    "formulations-trajectories",
    "Constrained and embedded form: 20 s of a loaded, pitching, yawing turbine",
    SOURCE,
    slow=True,
)
def trajectories() -> CaseResult:
    """The same commands and loads; every coordinate against its own size, and the difference over the step."""
    simulators = _turbines("training")[0]
    structure = simulators["embedded"].structure
    names = [n for b in (structure.tower, *structure.blades) for n in structure.system.bodies[b].coordinate_names]
    names.append("azimuth")
    steps, own = (0.01, 0.005, 0.0025), simulators["constrained"].coupling.scheme.h
    gaps = [coordinate_gaps("training", step) for step in steps]
    product = coordinate_gaps("training", own, starter="adams")
    finest = gaps[-1]
    checks = [
        Check(f"{name}: largest difference over 20 s / its largest value, step {steps[-1]} s", 0.0, gap, 1e-6)
        for name, gap in zip(names, finest, strict=True)
    ]
    notes = [
        "Three Runge–Kutta steps start the runs. The difference is the integration error of the constraint equations;",
        "its largest value by step: "
        + ", ".join(f"{g.max():.2e} at {s} s" for g, s in zip(gaps, steps, strict=True))
        + ".",
        f"At the step of the training fidelity, {own:.4g} s, and with its starters: {product.max():.2e} "
        f"({names[int(product.argmax())]}), median {np.median(product):.2e}.",
    ]
    figure = Figure((Curve(steps, [g.max() for g in gaps], style="o-"),), "step [s]", "difference", True, True)
    return CaseResult(checks, {"largest difference against step": figure}, "\n".join(notes))


def coupled_drift(duration, **changes):
    """The shipped preset in the wind with moving pitch and yaw: residuals after each aerodynamic step, and drift."""
    fidelity = replace(FIDELITIES["gebhardt"], **changes)
    simulator = Simulator("nrel_5mw", SteadyInflow(11.0, shear_exponent=0.2), fidelity)
    simulator.reset(rotor_speed=SPEED, pitch=PITCH)
    work, position = simulator.coupling.integrator.work, 0.0
    simulator.constraint_drift()
    for k in range(round(duration / simulator.time_step)):
        t = k * simulator.time_step
        torque = 30e3 + 60e3 * (simulator.signals.rotor_speed - SPEED)
        simulator.advance(simulator.time_step, _pitch_demand(t), 0.004 * np.sin(0.3 * t), max(torque, 0.0))
        position = max(position, float(np.abs(work.residual).max()))
    return position, simulator.constraint_drift(), simulator.signals.rotor_speed


@case("formulations-drift", "Constrained form: constraint drift over 600 s", SOURCE, slow=True)
def drift() -> CaseResult:
    """The preset of Gebhardt et al. at its own step with its own starters; residuals at every step."""
    simulator = _turbines("gebhardt")[0]["constrained"]
    step, starter = simulator.coupling.integrator.step, simulator.fidelity.starter
    run = _run("gebhardt", "constrained", 600.0, step, starter)
    position, coupled, speed = coupled_drift(30.0)
    return CaseResult(
        [
            Check("largest constraint residual of all steps", "<= 1e-6", run.position, unit="m or rad"),
            Check("largest residual of a step before the projection", "<= 1e-6", run.drift.position, unit="m or rad"),
            Check("largest error of a quaternion norm before rescaling", "<= 1e-8", run.drift.norm),
            Check("largest constraint residual, 30 s in the wind", "<= 1e-6", position, unit="m or rad"),
            Check("the same before the projection", "<= 1e-6", coupled.position, unit="m or rad"),
            Check("largest error of a quaternion norm, 30 s in the wind", "<= 1e-8", coupled.norm),
            Check("least rotor speed", f">= {0.8 * SPEED}", run.speed[0], unit="rad/s"),
            Check("largest rotor speed", f"<= {1.2 * SPEED}", run.speed[1], unit="rad/s"),
        ],
        notes=(
            f"Step {step:.4g} s, starter {starter}; largest residual of velocities {run.velocity:.2e} m/s or rad/s. "
            f"Rotor speed in the wind at the end {speed:.3f} rad/s. States are put back onto the constraints after "
            f"each step, quaternions rescaled. Before that the rates of a step are off by at most "
            f"{run.drift.velocity:.2e} m/s or rad/s, in the wind {coupled.velocity:.2e}."
        ),
    )


@case("formulations-gain", "Constrained form: drift over Baumgarte's gain, without projection", SOURCE, slow=True)
def gain() -> CaseResult:
    """30 s in the wind with moving pitch and yaw; stabilization alone, weak, as shipped and strong, and none."""
    found = {gain: coupled_drift(30.0, projection=False, stabilization=gain)[1] for gain in GAINS}
    projected = coupled_drift(30.0)[1]
    own = found[10.0].position
    checks = [
        Check("drift of positions with projection", "<= 1e-6", projected.position, unit="m or rad"),
        Check("with the shipped gain alone", "<= 1e-6", own, unit="m or rad"),
        Check("without either over that with the shipped gain", ">= 10", found[0.0].position / own),
    ]
    lines = [
        f"α = {gain} 1/s: |φ| up to {drift.position:.2e}, |φ̇| up to {drift.velocity:.2e}"
        for gain, drift in found.items()
    ]
    lines.append(f"with projection: {projected.position:.2e} and {projected.velocity:.2e} before it")
    return CaseResult(checks, notes="\n".join(lines))


# ---- coupled turbines -----------------------------------------------------------------------------------------------
# Each combination runs an episode in turbulence under the baseline controller, random actions, and a snapshot; what it
# costs and how far it is from the default of the same turbine is a table (docs/formulations.md). Nodal blades are also
# compared with modal ones, both with torsion: deflection in steady wind and frequencies at rest.


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
_IDS = {env_id.rpartition("-v")[0]: env_id for record in RECORDS.values() for env_id, _ in record.ids}
"""Ids by their names without version."""
WINDS = {"NREL5MW": 10.0, "IEA15MW": 10.0, "Gebhardt45m": 10.0, "NadaSmall": 8.0}


@dataclass(frozen=True)
class Combination:
    """What differs from the training fidelity of a turbine.

    ``turbine`` as in the ids of the environments; ``like``: whether the same turbine is described with the same shapes,
    so that power and loads have to be nearly the same; ``ending``: how its episode has to end, where the formulation
    leaves out what this rotor stands by.
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


def _combination(turbine, name, like, changes):
    """A row of the file."""
    ending, base = changes.pop("ending", None), changes.pop("fidelity", "training")
    return Combination(turbine, name, replace(FIDELITIES[base], **changes), like, ending)


COMBINATIONS = tuple(_combination(*row) for row in read_toml(DATA / "formulations.toml")["combinations"])

_TWISTING = "embedded, generalized-α, {} bodies, torsion"
NODAL_AND_MODAL = (
    ("NREL5MW", _TWISTING.format("12 nodal"), _TWISTING.format("4 modal")),
    ("IEA15MW", _TWISTING.format("12 nodal"), _TWISTING.format("8 modal")),
)
"""Turbine, and combinations that have to agree. Blades of the IEA 15-MW bend so far that four bodies are too few: their
tips are 4 % farther out than those of twelve, be they modal or nodal."""


def measure(combination):
    """An episode, random actions and a snapshot of a combination.

    Returns dict of "power" [kW], "flap_DEL" [MN m], "tip" mean of blade 1 [m], "ms" of processor time per control step,
    "frequencies" [Hz] of the parked turbine, lowest first (None without them), "repeats" whether the snapshot goes on
    bit for bit, "failure" of an episode or None.
    """
    times = combination.times
    env = gym.make(
        _IDS[f"wt_gym/{combination.turbine}-Turbulent"], fidelity=combination.fidelity, action_mode="residual",
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

    Returns (LOWEST,): ascending; None with constraint equations, and for observer frames that no coordinates of the
    tree describe.
    """
    structure = assemble(turbine, fidelity).structure
    system = structure.system
    if system.constraints or fidelity.reference_condition != "clamped":
        return None
    y, inputs, work = system.initial_state(), system.new_inputs(), system.new_work()
    elastic_equilibrium(system, y, inputs, work, (structure.azimuth_u,), True)
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
        _IDS[f"wt_gym/{combination.turbine}-Steady"], fidelity=combination.fidelity, action_mode="residual",
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
