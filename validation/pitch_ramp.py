"""Fast pitch: what the rows of the wake that are not computed anew in every step cost when the loads change."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from validation.case import CaseResult, Check, Curve, Figure, case
from validation.rigid_rotor import RigidRotor, UniformWind
from wt_gym.simulation.fidelity import FIDELITIES
from wt_gym.turbines import load_turbine

RUNGS = ("training", "engineering")
WINDS = {8.0: 7.55, 11.4: 7.0}
"""Wind [m/s] and tip-speed ratio, which is held."""
RATE, ANGLE = np.radians(8.0), np.radians(10.0)
SETTLE, HOLD = 25.0, 12.0
"""Time before the ramp, and after each ramp [s]."""
TOLERANCE = 0.02


def ramps(time):
    """Pitch [rad]: 0, up to `ANGLE` at `RATE`, and back after `HOLD`."""
    up, down = RATE * (time - SETTLE), ANGLE - RATE * (time - SETTLE - ANGLE / RATE - HOLD)
    return min(max(up, 0.0), ANGLE, max(down, 0.0))


def ramp_run(options, rung, wind):
    """Time [s], thrust [N] and torque [N m] of the rigid rotor at the time step that the rung has in the simulator."""
    turbine = load_turbine("nrel_5mw")
    rotor = RigidRotor.of_turbine(turbine, options)
    speed = WINDS[wind] * wind / rotor.radius
    dt = FIDELITIES[rung].step_for(turbine.drivetrain.rated_rotor_speed)
    n_steps = round((SETTLE + 2.0 * (ANGLE / RATE + HOLD)) / dt)
    steps = rotor.march(options, UniformWind(wind), speed, ramps, dt, n_steps)
    return np.array([(step.time, step.thrust, step.torque) for step in steps]).T


@case(
    "pitch-ramp",
    "Rigid NREL 5-MW rotor pitched at 8 deg/s to 10 deg and back: rows in turn against all rows in every step",
    "the same lattice with every row of the wake computed anew in every step",
)
def pitch_ramp() -> CaseResult:
    """Largest difference at any instant from the ramp on, over the change that the first ramp makes."""
    checks, figures, lines = [], {}, []
    rated_speed = load_turbine("nrel_5mw").drivetrain.rated_rotor_speed
    for rung in RUNGS:
        options = FIDELITIES[rung].aero_for(rated_speed)
        every = replace(options, fresh_rows=options.wake_rows, refresh_stride=1)
        for wind in WINDS:
            time, *found = ramp_run(options, rung, wind)
            _, *expected = ramp_run(every, rung, wind)
            before, after = time < SETTLE, time >= SETTLE
            for name, obtained, exact in zip(("thrust", "torque"), found, expected, strict=True):
                change = exact[before][-1] - exact[after].min()
                error = np.abs(obtained - exact)[after] / change
                checks.append(Check(f"{rung}, {wind:g} m/s: largest error of {name} over its change", f"<= {TOLERANCE}",
                                    error.max(), source="every row in every step"))  # fmt: skip
                lines.append(
                    f"{rung:12s} {wind:5g} m/s {name}: change {change:.4g}, largest error {100 * error.max():.2f} % at "
                    f"{time[after][error.argmax()] - SETTLE:.1f} s, rms {100 * np.sqrt((error**2).mean()):.2f} %; "
                    f"before the ramp {100 * (obtained[before][-1] / exact[before][-1] - 1):+.2f} %"
                )
                figures[f"{name}, {rung}, {wind:g} m/s"] = Figure((
                    Curve(time[after] - SETTLE, exact[after], "every row in every step", "--"),
                    Curve(time[after] - SETTLE, obtained[after], rung),
                ), "time [s]", name)  # fmt: skip
    return CaseResult(checks, figures, "\n".join(lines))
