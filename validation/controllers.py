"""What the controllers of the library do in turbulence, each against the published baseline in the same winds."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np

from validation.case import CaseResult, Check, Curve, Figure, case
from wt_gym.control.controllers import WindEstimator, make_controller
from wt_gym.experiment.comparison import Case, change, inflow_of, run_cases, table
from wt_gym.runs.playing import run_controller
from wt_gym.simulation import Simulator
from wt_gym.turbines import load_turbine

if TYPE_CHECKING:
    from wt_gym.wind import TurbulentInflow


WINDS = (12.0, 15.0, 18.0)
SEEDS = tuple(range(1001, 1007))
DURATION, SKIP = 600.0, 60.0
BANDS = (0.05, 0.1, 0.15, 0.2)
CONTROLLERS = {
    "discon": ("discon", {}),
    "retuned": ("retuned", {}),
    "ipc": ("ipc", {}),
    "ipc_2p": ("ipc_2p", {}),
    **{f"constrained_ipc, level {level:g}": ("constrained_ipc", {"level": level}) for level in BANDS},
    "tower_dampers": ("tower_dampers", {}),
    "ipc+tower_dampers": ("ipc+tower_dampers", {}),
    "tsr_tracking": ("tsr_tracking", {}),
    "tsr_tracking, thrust 0.95": ("tsr_tracking", {"thrust_limit": 0.95}),
}
PUBLISHED = "published cuts by individual pitch: 14 % (free wake, Perez-Becker 2021) to 25 % (Larsen et al. 2005)"


@case(
    "controllers",
    "Loads, power and pitch travel under every controller, 12/15/18 m/s, six seeds of 600 s",
    PUBLISHED,
    slow=True,
)
def controllers() -> CaseResult:
    """Bounds on what must hold of each controller; the table stands in the notes, the front in a figure."""
    turbine = load_turbine("nrel_5mw")
    cases = [Case(wind, seed) for wind in WINDS for seed in SEEDS]
    runs = run_cases(turbine, CONTROLLERS, cases, DURATION, SKIP)
    by_name, reference = {run.name: run for run in runs}, runs[0]

    def percent(name: str, wind: float, metric: str) -> float:
        return 100.0 * change(by_name[name], reference, wind, metric)[0]

    checks = [Check("runs that failed", "<= 0", sum(len(run.failures) for run in runs))]
    for wind in (15.0, 18.0):
        text = f"at {wind:g} m/s"
        flap, side = percent("ipc", wind, "blade_flap_del"), percent("tower_dampers", wind, "tower_side_side_del")
        checks += [
            Check(f"individual pitch, flap DEL {text}", "in [-35, -14]", flap, unit="%", source=PUBLISHED),
            Check(f"individual pitch, power {text}", ">= -0.5", percent("ipc", wind, "mean_power"), unit="%"),
            Check(f"tower dampers, side-side DEL {text}", "<= -15", side, unit="%"),
        ]
    curves = []
    for wind in WINDS:
        names = ["discon", *(n for n in CONTROLLERS if n.startswith("constrained")), "ipc", "ipc_2p"]
        duty = [np.mean([m["pitch_duty_cycle"] for c, m in by_name[n].metrics.items() if c.wind_speed == wind])
                for n in names]  # fmt: skip
        loads = [percent(n, wind, "blade_flap_del") for n in names]
        curves.append(Curve(np.array(duty), np.array(loads), f"{wind:g} m/s", "o"))
    figure = Figure(tuple(curves), "pitch duty cycle", "flap DEL against the baseline [%]")
    return CaseResult(checks, {"Front of load against pitch travel": figure}, table(runs))


@case(
    "wind-estimate",
    "Wind estimated from speed, torque and pitch against the rotor-effective wind of the inflow",
    "rotor-effective wind: mean of the undisturbed wind over the disc",
)
def wind_estimate() -> CaseResult:
    """8, 12 and 16 m/s, one seed of 200 s each, under the baseline controller."""
    turbine, checks, lines, figures = load_turbine("nrel_5mw"), [], [], {}
    simulator, dt, skip = None, 0.1, 300
    for wind in (8.0, 12.0, 16.0):
        inflow = cast("TurbulentInflow", inflow_of(turbine, Case(wind, SEEDS[0])))
        simulator = simulator or Simulator(turbine, inflow)
        simulator.inflow = inflow
        estimator = WindEstimator.of_turbine(turbine)
        found: list[float] = []

        def take(signals, estimator=estimator, found=found):
            if not found:
                estimator.start(signals)
            found.append(estimator.update(signals, dt))

        run_controller(simulator, make_controller("discon", turbine), 200.0, dt, take)
        times = dt * np.arange(1, len(found) + 1)[skip:]
        estimate, truth = np.array(found[skip:]), inflow.rotor_effective_speed(times, turbine.rotor_diameter)
        correlation, error = float(np.corrcoef(estimate, truth)[0, 1]), estimate - truth
        rms, bias = float(np.sqrt(np.mean(error**2))), float(error.mean())
        lines.append(f"{wind:g} m/s: correlation {correlation:.3f}, rms {rms:.2f} m/s, mean error {bias:+.2f} m/s")
        checks += [
            Check(f"correlation at {wind:g} m/s", ">= 0.9", correlation),
            Check(f"root mean square of the error at {wind:g} m/s", "<= 0.8", rms, unit="m/s"),
        ]
        pair = (Curve(times, truth, "rotor-effective wind"), Curve(times, estimate, "estimate"))
        figures[f"{wind:g} m/s"] = Figure(pair, "time [s]", "wind [m/s]")
    return CaseResult(checks, figures, "\n".join(lines))
