"""A whole-field wind step on the rigid 5-MW rotor: overshoot of thrust and rotor speed, the far wake's memory.

The rotor turns with its inertia against a torque that grows with the square of its speed, as below rated power. While
it speeds up, the wake keeps the induction of before, and takes half a minute to follow.
"""

from __future__ import annotations

from typing import Any

from validation.case import CaseResult, Check, Curve, Figure, absolute, case
from validation.dynamic_inflow import DynamicRotor
from validation.rotor_transients import INERTIA, Ramp, five_megawatt_step, long_wake
from wt_gym.aerodynamics import ENGINEERING, TRAINING
from wt_gym.turbines import load_turbine
from wt_gym.turbines.blade_element import BladeElementRotor

SOURCE = "unthinned wake of 16 turns with an open end; blade elements with Øye's filter, own calculation"
WIND = Ramp(8.0, 9.0)
ROTOR_SPEED = 0.95
"""At the start [rad/s]."""
DURATION = 100.0
"""After the step [s]."""


def element_step():
    """The same step in blade-element theory with Øye's filter."""

    def acceleration(torque, speed, settled):
        return (torque - settled * (speed / ROTOR_SPEED) ** 2) / INERTIA

    rotor = DynamicRotor(BladeElementRotor.of_turbine(load_turbine("nrel_5mw")), 30)
    return rotor.respond(WIND, lambda time: 0.0 * time, ROTOR_SPEED, DURATION, acceleration=acceleration)


@case("wind-step", "Rigid 5-MW rotor, wind step 8 → 9 m/s: overshoot of thrust and rotor speed", SOURCE, slow=True)
def wind_step() -> CaseResult:
    """Overshoot of the fidelities within 0.03 of the change of that of a long unthinned wake."""
    settings: dict[str, Any] = {"coupled": True, "rotor_speed": ROTOR_SPEED, "duration": DURATION, "settling": 100.0}
    runs = {
        "16 turns, open": five_megawatt_step(long_wake(16.0, 24, n_span=10), WIND, **settings),
        "blade elements with Øye's filter": element_step(),
        "training": five_megawatt_step(TRAINING, WIND, **settings),
        "engineering": five_megawatt_step(ENGINEERING, WIND, **settings),
    }
    checks, lines = [], []
    signals = {"thrust": "thrust", "rotor speed": "rotor_speed"}
    wanted = {name: runs["16 turns, open"].overshoot(signal).ratio for name, signal in signals.items()}
    for run_name, run in runs.items():
        found = {name: run.overshoot(signal) for name, signal in signals.items()}
        if run_name != "16 turns, open":
            checks += [
                Check(f"{run_name}: change of the {name} to the extreme by the lasting one", wanted[name],
                      found[name].ratio, absolute(0.03), source=SOURCE)
                for name in signals
            ]  # fmt: skip
        lines.append(f"{run_name}: " + ", ".join(f"{name} {found[name].ratio:.3f}" for name in signals))
    figures = {
        f"{name} after a wind step": Figure(tuple(
            Curve(run.time[run.time > -5.0], getattr(run, signal)[run.time > -5.0], label)
            for label, run in runs.items()
        ), "time [s]", f"{name} [{unit}]")
        for (name, signal), unit in zip(signals.items(), ("N", "rad/s"), strict=True)
    }  # fmt: skip
    return CaseResult(checks, figures, "\n".join(lines))
