"""The bandwidth of the pitch drive: what a servo adds to the way of the pitch and to the loads in turbulence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from validation.case import CaseResult, Check, case
from wt_gym.analysis.metrics import damage_equivalent_load
from wt_gym.runs.playing import run_baseline
from wt_gym.simulation import Simulator
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow, TurbulenceBox, TurbulentInflow

WINDS = ((12.0, 3), (12.0, 5), (16.0, 3))
"""Mean wind [m/s] and seed of the turbulence, class B."""
FREQUENCIES = (None, 5.0, 2.0, 1.0)
"""Of the critically damped servo [Hz]; None: ideal."""
SKIP, DURATION = 30.0, 150.0
FAST, TOLERANCE = 5.0, 0.03


def travel_and_loads(inflow, frequency):
    """Way of blade 1's pitch [deg], mean power [kW] and flapwise DEL [MN m] under the baseline controller."""
    turbine = load_turbine("nrel_5mw")
    servo = None if frequency is None else 2.0 * np.pi * frequency
    turbine = replace(turbine, pitch=replace(turbine.pitch, servo_frequency=servo))
    rows = []

    def note(signals):
        rows.append((signals.time, signals.pitch_travel[0], signals.generator_power, signals.root_flap_moment[0]))

    run_baseline(Simulator(turbine, inflow), DURATION, on_step=note)
    time, travel, power, flap = np.array(rows).T
    kept = time > SKIP
    load = damage_equivalent_load(flap[kept], 10.0, time[kept][-1] - time[kept][0])
    return np.degrees(travel[kept].sum()), power[kept].mean() / 1e3, load / 1e6


@case(
    "pitch-drive",
    "NREL 5-MW in turbulence under the baseline controller: an ideal pitch drive and servos of 5, 2 and 1 Hz",
    "a critically damped servo becomes the ideal drive as its frequency grows",
    slow=True,
)
def pitch_drive() -> CaseResult:
    """Pitch travel and loads with a fast servo against those without any; slower ones in the notes."""
    checks, lines = [], ["wind [m/s], seed, servo [Hz]: pitch travel [deg], power [kW], flap DEL [MN m] of 120 s"]
    for wind, seed in WINDS:
        box = TurbulenceBox.kaimal(wind, 90.0, 126.0, "B", seed=seed)
        inflow = TurbulentInflow(box, SteadyInflow(wind, 90.0, shear_exponent=0.14))
        found = {frequency: travel_and_loads(inflow, frequency) for frequency in FREQUENCIES}
        for name, ideal, fast in zip(("pitch travel", "power", "flap DEL"), found[None], found[FAST], strict=True):
            checks.append(Check(f"{name} with {FAST:g} Hz over that of the ideal drive, {wind:g} m/s, seed {seed}", 1.0,
                                fast / ideal, TOLERANCE, source="limit of a fast servo"))  # fmt: skip
        for frequency, (travel, power, load) in found.items():
            drive = "ideal" if frequency is None else f"{frequency:g}"
            change = 100.0 * (travel / found[None][0] - 1.0)
            lines.append(f"{wind:g}, {seed}, {drive:5s}: {travel:6.1f} ({change:+.1f} %), {power:6.0f}, {load:.3f}")
    return CaseResult(checks, notes="\n".join(lines))
