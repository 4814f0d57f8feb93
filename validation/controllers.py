"""What the controllers of the library do in turbulence, each against the published baseline in the same winds."""

from __future__ import annotations

import numpy as np

from agents.comparison import Case, change, run_cases, table
from validation.case import CaseResult, Check, Curve, Figure, case
from wt_gym.turbines import load_turbine

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
    "rosco": ("rosco", {}),
    "rosco, thrust 0.95": ("rosco", {"thrust_limit": 0.95}),
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

    checks = [Check("runs that failed", "<= 0", float(sum(len(run.failures) for run in runs)), 0.0)]
    for wind in (15.0, 18.0):
        text = f"at {wind:g} m/s"
        flap, side = percent("ipc", wind, "blade_flap_del"), percent("tower_dampers", wind, "tower_side_side_del")
        checks += [
            Check(f"individual pitch, flap DEL {text}", "in [-35, -14]", flap, 0.0, "%", source=PUBLISHED),
            Check(f"individual pitch, power {text}", ">= -0.5", percent("ipc", wind, "mean_power"), 0.0, "%"),
            Check(f"tower dampers, side-side DEL {text}", "<= -15", side, 0.0, "%"),
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
