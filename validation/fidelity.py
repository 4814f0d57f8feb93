"""What the cheap fidelities cost in accuracy: the ladder in one steady and one turbulent wind."""

import time

import numpy as np

from validation.case import CaseResult, Check, case
from wt_gym.analysis.metrics import damage_equivalent_load
from wt_gym.simulation import Simulator
from wt_gym.wind import SteadyInflow, TurbulenceBox, TurbulentInflow

SPEED = 9.0  # [m/s] of the turbulent wind, with the partial load of the rotor
DURATION, SKIP = 100.0, 20.0  # [s]
STEADY = 8.0, 0.958, 160.0  # wind [m/s], rotor speed [rad/s], duration [s]: a wake of 11 turns must have passed
RUNGS = ("reference", "engineering", "training")
TARGETS = {"power": 0.02, "thrust": 0.02, "flap DEL": 0.08, "tower DEL": 0.08}
SOURCE = "the same simulator at fidelity reference: ten times the panels, three times the wake, every row free"


def steady_coefficients(fidelity):
    """Cp and Ct of the NREL 5-MW rotor at 8 m/s, held near 9.15 rpm by its torque; means of the last quarter."""
    wind, rotor_speed, duration = STEADY
    simulator = Simulator("nrel_5mw", inflow=SteadyInflow(wind), fidelity=fidelity)
    signals = simulator.reset(rotor_speed=rotor_speed)
    torque, power, thrust = signals.generator_torque, [], []
    for k in range(round(duration / simulator.time_step)):
        hold = max(torque + 2e5 * (signals.rotor_speed - rotor_speed), 0.0)
        signals = simulator.advance(simulator.time_step, 0.0, 0.0, hold)
        if k * simulator.time_step > 0.75 * duration:
            power.append(signals.aero_power)
            thrust.append(signals.aero_thrust)
    turbine = simulator.turbine
    scale = 0.5 * turbine.air_density * np.pi * (0.5 * turbine.rotor_diameter) ** 2 * wind**2
    return np.mean(power) / (scale * wind), np.mean(thrust) / scale


def turbulent_run(fidelity):
    """Means, deviations and damage-equivalent loads in one turbulent wind, and processor seconds per second."""
    from agents.closed_loop import run_baseline  # controllers stand above the simulator

    box = TurbulenceBox.kaimal(SPEED, 90.0, 126.0, seed=3, duration=200.0)
    inflow = TurbulentInflow(box, steady=SteadyInflow(SPEED, hub_height=90.0, shear_exponent=0.14))
    simulator = Simulator("nrel_5mw", inflow=inflow, fidelity=fidelity)
    simulator.reset(rotor_speed=1.0)
    simulator.advance(simulator.time_step, 0.0)
    start = time.process_time()
    run = run_baseline(simulator, DURATION, control_dt=0.2).to_dataset()
    used = time.process_time() - start
    run = run.isel(time=np.flatnonzero(run.time.values >= SKIP))
    span = DURATION - SKIP
    return {
        "power": float(run.generator_power.mean()) / 1e3,
        "power deviation": float(run.generator_power.std()) / 1e3,
        "thrust": float(run.aero_thrust.mean()) / 1e3,
        "flap DEL": damage_equivalent_load(run.root_flap_moment_1.values, span, 10.0) / 1e6,
        "tower DEL": damage_equivalent_load(run.tower_base_fore_aft_moment.values, span, 4.0) / 1e6,
        "real-time factor": DURATION / used,
    }


@case("fidelity", "The ladder of fidelities in one steady and one turbulent wind", SOURCE, slow=True)
def fidelity_ladder():
    """Compare every rung with the reference."""
    steady = {name: steady_coefficients(name) for name in RUNGS}
    turbulent = {name: turbulent_run(name) for name in RUNGS}
    units = {"power": "kW", "power deviation": "kW", "thrust": "kN", "flap DEL": "MN m", "tower DEL": "MN m"}
    reference = turbulent["reference"]
    checks = [
        Check(f"training: {name}", reference[name], turbulent["training"][name], tolerance, units[name])
        for name, tolerance in TARGETS.items()
    ]
    checks += [
        Check(f"training: {name}, steady wind", steady["reference"][k], steady["training"][k], 0.02)
        for k, name in enumerate(("Cp", "Ct"))
    ]
    header = "rung           Cp     Ct    power   dev.  thrust  flap DEL tower DEL   x real time"
    rows = [header]
    for name in RUNGS:
        t, (cp, ct) = turbulent[name], steady[name]
        rows.append(
            f"{name:12s} {cp:.4f} {ct:.4f} {t['power']:7.1f} {t['power deviation']:6.1f} {t['thrust']:7.1f}"
            f" {t['flap DEL']:8.3f} {t['tower DEL']:9.3f} {t['real-time factor']:11.2f}"
        )
        if name != "reference":
            change = [100.0 * (t[key] / reference[key] - 1.0) for key in (*TARGETS, "power deviation")]
            rows.append(
                f"  difference: Cp {100 * (cp / steady['reference'][0] - 1):+.1f} %, Ct"
                f" {100 * (ct / steady['reference'][1] - 1):+.1f} %, power {change[0]:+.1f} %, deviation"
                f" {change[4]:+.1f} %, thrust {change[1]:+.1f} %, DEL flap {change[2]:+.1f} %, tower {change[3]:+.1f} %"
            )
    rows.append(
        "kW, kN, MN m; the factor is by processor time of one thread, with the controller. Cp and Ct: uniform wind of"
        " 8 m/s, where a thinned wake keeps its order and the fine one of the reference loses it after some turns."
    )
    return CaseResult(checks, notes="\n".join(rows))
