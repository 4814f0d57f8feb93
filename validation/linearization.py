"""Linear models of the turbine: exact properties, and their forecast of the non-linear simulation."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, cast

import numpy as np
from scipy.linalg import expm

from validation.case import CaseResult, Check, Curve, Figure, case
from wt_gym.multibody.integrators.schemes import make_integrator
from wt_gym.simulation import Simulator
from wt_gym.simulation.linear_model import multiblade_transform
from wt_gym.simulation.linearization import FrozenPlant, linearize
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow

if TYPE_CHECKING:
    from wt_gym.simulation.linear_model import SteadyPoint

__all__ = ["free_vibration", "rigid_support", "weightless_simulator", "whirl_frequencies"]

RPM = np.pi / 30.0


def weightless_simulator(turbine="nrel_5mw"):
    """A simulator whose structure feels no gravity: an isotropic rotor then has the same equations at every azimuth."""
    simulator = Simulator(turbine, inflow=SteadyInflow(10.0))
    simulator.structure.system.tree.gravity[:] = 0.0
    return simulator


def rigid_support(turbine, factor=1e5):
    """The turbine on a tower that much stiffer, with a drive train that much stiffer."""
    tower = turbine.tower
    stiff = replace(tower.structure, stiffness=tower.structure.stiffness * factor)
    drive = replace(turbine.drivetrain, spring=turbine.drivetrain.spring * factor)
    return replace(turbine, tower=replace(tower, structure=stiff), drivetrain=drive)


def whirl_frequencies(simulator, rotor_speed):
    """Frequencies [Hz] of the first flap and edge modes of the rotor by name, generator locked, without air."""
    model = linearize(
        simulator, rotor_speed=rotor_speed, aerodynamics="none", generator="locked", multiblade=True, n_azimuths=1,
        outputs=("rotor_speed",),
    )  # fmt: skip
    return {mode.name: mode.natural_frequency for mode in model.modes()}


@case(
    "linear-whirl",
    "Whirl of a rotor on a rigid support: regressive and progressive modes lie one rotor speed from the blade's",
    "transformation of a rotating blade's coordinates to the fixed frame: exact for equal blades on a rigid support",
)
def whirl() -> CaseResult:
    """A vibration of the blades with ω has multi-blade coordinates q cos ψ_i, ψ_i = Ω t: in the fixed frame ω ± Ω."""
    simulator = weightless_simulator(rigid_support(load_turbine("nrel_5mw")))
    checks, speeds, table = [], np.array([0.0, 4.0, 8.0, 12.1]), []
    for rpm in speeds:
        table.append(whirl_frequencies(simulator, rpm * RPM))
        shift = rpm / 60.0
        for base in ("flap_1", "edge_1"):
            blade = table[-1][f"{base} collective"]
            pair = ("regressive", "progressive") if rpm else ("yaw", "tilt")
            for name, sign in zip(pair, (-1.0, 1.0), strict=True):
                expected = blade + sign * shift
                checks.append(Check(f"{rpm:g} rpm: {base} {name}", expected, table[-1][f"{base} {name}"], 1e-3, "Hz",
                                    source="collective ∓ rotor speed"))  # fmt: skip
    curves = tuple(
        Curve(speeds[1:], [row[f"{base} {part}"] for row in table[1:]], f"{base} {part}", "o-")
        for base in ("flap_1", "edge_1")
        for part in ("regressive", "collective", "progressive")
    )
    return CaseResult(checks, {"Whirl": Figure(curves, "rotor speed [rpm]", "frequency [Hz]")})


def free_vibration(simulator, rotor_speed, amplitude=1e-3, duration=3.0, interval=0.05, substeps=20, seed=0):
    """Small vibration about the steady state: by the non-linear equations and by the linear model.

    The model is in multi-blade coordinates at the first azimuth; for an isotropic rotor it holds at all times.

    Parameters
    ----------
    amplitude : float
        Displacement of the rotor's points by each coordinate at the start [m], random in size.

    Returns
    -------
    tuple of array (n_times, n_state)
        Deviations of the state, non-linear and linear.
    """
    model = linearize(simulator, rotor_speed=rotor_speed, aerodynamics="none", multiblade=True, n_azimuths=1)
    point = cast("SteadyPoint", model.operating_point)
    plant, system = FrozenPlant(simulator, simulator.inflow, "none"), simulator.structure.system
    plant.set_commands(point.generator_torque, point.yaw, point.pitch)
    start = np.zeros(system.n_state)
    start[: system.n_u] = amplitude * np.random.default_rng(seed).standard_normal(system.n_u) / plant.reach

    def run(y):
        integrator = make_integrator("hamming", system, interval / substeps)
        for array, values in zip(integrator.inputs, plant.inputs, strict=True):
            array[:] = values
        integrator.start(y)
        out = [y.copy()]
        for _ in range(round(duration / interval)):
            integrator.advance(substeps)
            out.append(integrator.state.copy())
        return np.array(out)

    names = system.state_names
    difference = run(point.states[0] + start) - run(point.states[0])
    azimuth = point.azimuth[0]
    z = np.linalg.solve(multiblade_transform(names, azimuth, rotor_speed)[0], start)
    step, linear = expm(model.A * interval), []
    for k in range(len(difference)):
        transform = multiblade_transform(names, azimuth + rotor_speed * k * interval, rotor_speed)[0]
        linear.append(transform @ z)
        z = step @ z
    return difference, np.array(linear)


@case(
    "linear-free-vibration",
    "Small free vibration without air: linear model against the non-linear equations of motion",
    "the linear model is the derivative of the non-linear equations",
)
def vibration() -> CaseResult:
    """Largest difference over 3 s of each coordinate, relative to its own largest value."""
    checks, figures = [], {}
    cases = (
        ("parked, gravity", Simulator("nrel_5mw", inflow=SteadyInflow(10.0)), 0.0),
        ("12.1 rpm, weightless", weightless_simulator(), 12.1 * RPM),
    )
    for label, simulator, speed in cases:
        exact, linear = free_vibration(simulator, speed, amplitude=1e-4)
        n = simulator.structure.system.n_u
        error = np.abs(exact - linear)[:, :n].max(axis=0) / np.abs(exact)[:, :n].max(axis=0)
        names = simulator.structure.system.state_names
        worst = int(np.argmax(error))
        checks.append(Check(f"{label}: largest difference, {names[worst]}", "<= 1e-4", error[worst]))
        time, k = 0.05 * np.arange(len(exact)), names.index("blade_1_flap_1")
        figures[label] = Figure(
            (Curve(time, exact[:, k], "non-linear"), Curve(time, linear[:, k], "linear", "--")), "time [s]", names[k]
        )
    return CaseResult(checks, figures)


STEPS = {
    "pitch + 0.5°": ({"pitch": np.radians(0.5)}, "pitch_collective", np.radians(0.5)),
    "torque + 2 kN m": ({"torque": 2000.0}, "generator_torque", 2000.0),
    "wind + 0.2 m/s": ({"wind": 0.2}, "wind_speed", 0.2),
}
TOLERANCES = {
    "rotor_speed": 0.1,
    "tower_top_fore_aft": 0.1,
    "tip_out_of_plane": 0.25,
    "root_flap_moment": 0.35,
}


def step_responses(wind=18.0, pitch_deg=14.92, rpm=12.1, settle=60.0, duration=6.0):
    """Deviations after small steps from a settled run of the simulator, and what the linear model says.

    Yields
    ------
    tuple
        Name of the step, times [s], and {channel: (non-linear, linear)}; blade channels are means over the blades.
    """
    simulator = Simulator("nrel_5mw", inflow=SteadyInflow(wind))
    speed, pitch = rpm * RPM, np.radians(pitch_deg)
    signals = simulator.reset(rotor_speed=speed, pitch=pitch)
    torque = signals.generator_torque
    for _ in range(round(settle / 0.2)):
        signals = simulator.advance(0.2, pitch=pitch, generator_torque=torque)
        # a slow integral action on the torque keeps the speed while the wake settles
        torque += 2e4 * (signals.rotor_speed - speed)
    settled = simulator.state()
    model = linearize(simulator, rotor_speed=speed, pitch=pitch, multiblade=True, outputs=tuple(TOLERANCES))

    def run(change):
        simulator.restore(settled)
        simulator.inflow = SteadyInflow(wind + change.get("wind", 0.0))
        out = []
        for _ in range(round(duration / 0.2)):
            s = simulator.advance(
                0.2, pitch=pitch + change.get("pitch", 0.0), generator_torque=torque + change.get("torque", 0.0)
            )
            out.append([np.mean(s[name]) for name in TOLERANCES])
        return np.array(out)

    base = run({})
    fine = np.arange(0.0, duration + 1e-9, 0.01)
    limits = {"pitch_collective": simulator.turbine.pitch.max_rate,
              "generator_torque": simulator.turbine.drivetrain.max_torque_rate}  # fmt: skip
    columns = [n if n in model.output_names else f"{n}_collective" for n in TOLERANCES]
    for label, (change, name, size) in STEPS.items():
        demand = np.minimum(size, limits.get(name, np.inf) * np.maximum(fine, 1e-300))
        linear = model.select(outputs=columns).response(fine, {name: demand})[20::20]
        exact = run(change) - base
        pairs = {key: (exact[:, k], linear[:, k]) for k, key in enumerate(TOLERANCES)}
        yield label, 0.2 * np.arange(1, len(exact) + 1), pairs


@case(
    "linear-step-response",
    "Steps of pitch, torque and wind at 18 m/s: quasi-steady linear model against the coupled simulation",
    "the linear model is the derivative of the simulation but for added mass and the memory of the wake",
)
def forecast() -> CaseResult:
    """Largest difference over 6 s, relative to the largest response; the induction of the wake changes in about 7 s."""
    checks, figures = [], {}
    for label, time, pairs in step_responses():
        for name, (exact, linear) in pairs.items():
            error = float(np.abs(exact - linear).max() / np.abs(exact).max())
            checks.append(Check(f"{label}: {name}", f"<= {TOLERANCES[name]}", error))
            figures[f"{label}: {name}"] = Figure(
                (Curve(time, exact, "simulation"), Curve(time, linear, "linear model", "--")), "time [s]", name
            )
    notes = (
        "Linear models leave added mass, shed vorticity and the answer of the whole wake out; the bounds allow for it."
    )
    return CaseResult(checks, figures, notes)
