"""Floating turbines against OpenFAST: free decays, regular waves, control in steady wind, turbulence with waves.

OpenFAST has blade elements with DBEMT, no drag of the tower and no shadow, a rigid drive train and blades without
torsion. Runs begin at rest, the platform displaced; for VolturnUS-S in waves OpenFAST's response has settled first.
"""

import json
from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.signal import butter, sosfiltfilt

from envs_tests.physics.validation import DATA, CaseResult, Check, Curve, Figure, absolute, case, worst
from wt_gym.analysis.metrics import damage_equivalent_load
from wt_gym.base.quantities import MOTIONS
from wt_gym.control import Demand
from wt_gym.control.controllers import make_controller
from wt_gym.hydrodynamics.waves import WaveComponents
from wt_gym.simulation import Simulator
from wt_gym.simulation.fidelity import fidelity
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow, TurbulenceBox, TurbulentInflow

OPENFAST = "OpenFAST 5.0 (ElastoDyn, AeroDyn, HydroDyn, MAP++)"
OC4, VOLTURN = "oc4_nrel_5mw", "volturnus_iea_15mw"
SHORT = {OC4: "OC4", VOLTURN: "VolturnUS-S"}
UNITS = np.array([1.0, 1.0, 1.0, *[np.pi / 180.0] * 3])
COLUMNS = {"surge": (1, "m"), "heave": (2, "m"), "pitch": (3, "deg"), "rotor speed": (4, "rpm"), "power": (5, "kW"),
           "thrust": (6, "kN"), "tower base": (7, "kN m"), "blade root": (8, "kN m")}  # fmt: skip
"""Of the quantities in the signals of `controlled`, with their units."""
SETTLED = 200.0
"""Time from which turbulence is judged [s]."""


@lru_cache
def reference():
    """Figures of OpenFAST; units stand in the file."""
    return json.loads((DATA / "floating.json").read_text(encoding="utf-8"))


@lru_cache
def simulator(name, with_air=True):
    """A floating turbine as OpenFAST has it; without air it is parked and feathered in thin air that rests."""
    turbine = load_turbine(name)
    turbine = replace(turbine, tower=replace(turbine.tower, drag_coefficient=0.0))
    if not with_air:
        turbine = replace(turbine, air_density=0.1)
    inflow = SteadyInflow(18.0 if with_air else 0.01, turbine.hub_height)
    return Simulator(turbine, inflow, replace(fidelity("training"), tower_shadow=False))


def displaced(**motions):
    """Slow motion (12,) of a platform at rest, from displacements by name [m, deg]."""
    out = np.zeros(12)
    for name, value in motions.items():
        out[MOTIONS.index(name)] = value * UNITS[MOTIONS.index(name)]
    return out


def platform(signals):
    """Displacements (6,) of the platform [m, rad]."""
    return np.array([signals[f"platform_{motion}"] for motion in MOTIONS])


def released(sim, duration, slow=None, sea=None):
    """Signals of a parked turbine at each step from its start on, with a slow motion (12,) of its platform if given."""
    sim.sea = sea
    signals = [sim.reset(0.0, pitch=0.5 * np.pi, generator_torque=0.0, platform=slow)]
    steps = round(duration / sim.time_step)
    return signals + [sim.advance(sim.time_step, pitch=0.5 * np.pi) for _ in range(steps)]


def parked(name, duration, slow=None, sea=None):
    """Times, motions (n, 6) [m, deg] and tower-base moments [kN m] of a parked turbine."""
    sim = simulator(name, with_air=False)
    signals = released(sim, duration, slow, sea)
    moments = np.array([at["tower_base_fore_aft_moment"] for at in signals])
    return sim.time_step * np.arange(len(signals)), np.array([platform(at) for at in signals]) / UNITS, moments / 1e3


def peaks(time, values):
    """Times and heights of the maxima above zero, by parabolas through three points."""
    k = np.flatnonzero((values[1:-1] > values[:-2]) & (values[1:-1] >= values[2:]) & (values[1:-1] > 0.0)) + 1
    before, top, after = values[k - 1], values[k], values[k + 1]
    shift = 0.5 * (before - after) / (before - 2.0 * top + after)
    return time[k] + shift * (time[1] - time[0]), top - 0.25 * (before - after) * shift


def damping(sizes):
    """Damping ratios of the cycles between maxima."""
    decrement = np.log(sizes[:-1] / sizes[1:])
    return decrement / np.hypot(2.0 * np.pi, decrement)


@case("floating-decays", "Free decays of two floating turbines in still water, cycle by cycle", OPENFAST, slow=True,
      quick={"platforms": (OC4,), "motions": ("heave",)})  # fmt: skip
def floating_decays(platforms=(OC4, VOLTURN), motions=MOTIONS) -> CaseResult:
    """Period and damping ratio of each cycle, without wind, rotor parked."""
    checks, figures = [], {}
    for run in reference()["decays"]:
        name, motion = run["turbine"], run["motion"]
        if name not in platforms or motion not in motions:
            continue
        slow = displaced(**dict(zip(MOTIONS, run["start"], strict=True)))
        time, rows, _ = parked(name, run["duration"], slow)
        values = rows[:, MOTIONS.index(motion)] - run["rest"]
        own, other = peaks(time, values), (np.array(run["peak_time"]), np.array(run["peak"]))
        n = min(len(own[0]), len(other[0]))
        title, where = f"{SHORT[name]}, {motion}", "cycles: number {:g}"
        cycle, ((times, sizes), (own_times, own_sizes)) = (
            np.arange(1.0, n),
            ((e[0][:n], e[1][:n]) for e in (other, own)),
        )
        checks += [
            worst(f"{title}: period", where, cycle, np.diff(times), np.diff(own_times), 0.02, "s"),
            worst(f"{title}: damping ratio", where, cycle, damping(sizes), damping(own_sizes), 0.1),
        ]
        figures[title] = Figure((Curve(*other, "OpenFAST, maxima", "o"), Curve(time, values, "simulator")), "time [s]")
    return CaseResult(checks, figures)


@case("floating-waves", "Motions and tower-base moment of floating turbines in regular waves", OPENFAST, slow=True)
def floating_waves(cycles=8) -> CaseResult:
    """Amplitude over that of the wave and phase after its crest, by a harmonic fit beside slow transients."""
    checks = []
    for run in reference()["waves"]:
        omega, height = 2.0 * np.pi / run["period"], run["amplitude"]
        sea = WaveComponents(*np.array([[omega], [height], [0.0], [0.0]]))
        time, rows, moment = parked(run["turbine"], 60.0 + cycles * run["period"], sea=sea)
        late = time >= 60.0
        time = time[late]
        columns = [np.cos(omega * time), np.sin(omega * time), *(time**k for k in range(4))]
        for quantity, unit in (("surge", "m/m"), ("heave", "m/m"), ("pitch", "deg/m"), ("tower base", "kN m/m")):
            values = moment if quantity == "tower base" else rows[:, MOTIONS.index(quantity)]
            fit = np.linalg.lstsq(np.column_stack(columns), values[late], rcond=None)[0]
            response, (size, phase) = (fit[0] - 1j * fit[1]) / height, run[quantity]
            lag = np.degrees(np.angle(response * np.exp(-1j * np.radians(phase))))
            title = f"{SHORT[run['turbine']]}, {run['period']:g} s, {2.0 * height:g} m: {quantity}"
            checks += [
                Check(title, size, abs(response), 0.08 if quantity == "tower base" else 0.05, unit),
                Check(f"{title}, phase", phase, phase + lag, absolute(5.0), "deg"),
            ]
    return CaseResult(checks)


def controlled(name, inflow, choice, duration, start, sea=None):
    """Signals (n, 9) under a controller: time, surge, heave, pitch, speed, power, thrust, tower base, blade root.

    Units m, deg, rpm, kW, kN, kN m; the start has ``surge``, ``pitch``, ``rotor_speed`` and ``blade_pitch``.
    """
    sim = simulator(name)
    sim.inflow, sim.sea = inflow, sea
    point = {"rotor_speed": start["rotor_speed"] * np.pi / 30.0, "pitch": np.radians(start["blade_pitch"])}
    waves = np.zeros(12)
    if sea is not None:  # the simulator adds the answer to the waves of the start
        signals = sim.reset(**point, platform=waves)
        waves[:6] = platform(signals)
    sim.reset(**point, platform=displaced(surge=start["surge"], pitch=start["pitch"]) - waves)
    signals, controller = sim.signals, make_controller(choice, sim.turbine)
    controller.start(signals, Demand(np.full(3, point["pitch"]), 0.0, signals["generator_torque"]))
    rows = []
    for _ in range(round(duration / sim.time_step)):
        demand = controller.step(signals, sim.time_step)
        signals = sim.advance(sim.time_step, pitch=demand.pitch, generator_torque=demand.generator_torque)
        rows.append((
            signals["time"], signals["platform_surge"], signals["platform_heave"],
            np.degrees(signals["platform_pitch"]), signals["rotor_speed"] * 30.0 / np.pi,
            signals["generator_power"] / 1e3, signals["aero_thrust"] / 1e3,
            signals["tower_base_fore_aft_moment"] / 1e3, signals["root_flap_moment_1"] / 1e3,
        ))  # fmt: skip
    return np.array(rows)


def half_cycles(time, pitch):
    """Times and half ranges of the pitch between turning points at least 6 s apart, from 10 s on."""
    time, pitch = time[time >= 10.0], pitch[time >= 10.0]
    turns = 1 + np.flatnonzero((pitch[1:-1] - pitch[:-2]) * (pitch[2:] - pitch[1:-1]) <= 0.0)
    kept = [turns[0]]
    for k in turns[1:]:
        if time[k] - time[kept[-1]] > 6.0:
            kept.append(k)
    return 0.5 * (time[kept[1:]] + time[kept[:-1]]), 0.5 * np.abs(np.diff(pitch[kept]))


def growth(time, pitch):
    """Growth rate of the swing in pitch [1/s] as long as it exceeds 0.15 deg, and its damping ratio."""
    time, size = half_cycles(time, pitch)
    count = len(size) if (size > 0.15).all() else int(np.argmax(size <= 0.15))
    rate = float(np.polyfit(time[:count], np.log(size[:count]), 1)[0])
    return rate, -rate * float(np.diff(time[:count]).mean()) / np.pi


@case("floating-control", "Floating turbines under control in steady wind and still water", OPENFAST, slow=True)
def floating_control() -> CaseResult:
    """Steady states, damping with detuned gains and floating feedback, and negative damping with gains of the land.

    Means are those of the last 110 s; where a swing lasts, of three cycles of 33 s.
    """
    checks, figures = [], {}
    for run in reference()["control"]:
        name, wind, choice, duration = (run[key] for key in ("turbine", "wind", "controller", "duration"))
        ratio, swing = run["damping"], run["half_range"]
        rows = controlled(name, SteadyInflow(wind, load_turbine(name).hub_height), choice, duration, run["start"])
        time, pitch = rows[:, 0], rows[:, 3]
        last = rows[time > duration - (100.0 if choice == "rosco:floating=0" else 110.0)]
        title = f"{SHORT[name]}, {wind:g} m/s, {choice}"
        for quantity, mean in run["last"].items():
            column, unit = COLUMNS[quantity]
            checks.append(Check(f"{title}: {quantity}", mean, last[:, column].mean(), 0.04, unit))
        if ratio is not None:
            checks.append(Check(f"{title}: damping ratio of pitch", ratio, growth(time, pitch)[1], absolute(0.015)))
        if swing is not None:
            tolerance = 0.15 if swing > 1.0 else absolute(0.1)
            half = 0.5 * float(np.ptp(pitch[time > duration - 110.0]))
            checks.append(Check(f"{title}: half range of pitch in the end", swing, half, tolerance, "deg"))
        figures[title] = Figure((Curve(time, pitch),), "time [s]", "pitch of the platform [deg]")
    return CaseResult(checks, figures)


def in_bands(values, dt):
    """Standard deviations below 0.05 Hz, from there to 0.2 Hz and above."""
    low = [sosfiltfilt(butter(4, f, fs=1.0 / dt, output="sos"), values - values.mean()) for f in (0.05, 0.2)]
    return [float(np.std(part)) for part in (low[0], low[1] - low[0], values - low[1])]


@case("floating-turbulence", "Floating turbines in turbulent wind and irregular waves, 10 minutes", OPENFAST, slow=True)
def floating_turbulence(cases=(0, 1, 2, 3)) -> CaseResult:
    """The same turbulence, wave components and controllers in both: means, standard deviations by band, DELs."""
    checks = []
    bands = ("below 0.05 Hz", "0.05 to 0.2 Hz", "above 0.2 Hz")
    for k in cases:
        run = reference()["turbulence"][k]
        turbine, wind = load_turbine(run["turbine"]), run["wind"]
        width, points, size = (150.0, 13, 126.0) if run["turbine"] == OC4 else (270.0, 11, 240.0)
        box = TurbulenceBox.kaimal(wind, turbine.hub_height, size, "B", seed=run["seed"], duration=800.0, time_step=0.5,
                                   width=width, grid=(points, points))  # fmt: skip
        inflow = TurbulentInflow(box, SteadyInflow(wind, turbine.hub_height, shear_exponent=0.14))
        frequency, amplitude, phase = np.array(run["waves"])
        sea = WaveComponents(frequency, amplitude, phase, np.zeros_like(phase))
        rows = controlled(run["turbine"], inflow, run["controller"], run["duration"], run["start"], sea)
        dt, rows = rows[1, 0] - rows[0, 0], rows[rows[:, 0] >= SETTLED]
        title = f"{SHORT[run['turbine']]}, {wind:g} m/s, {run['controller']}"
        for quantity, known in run["statistics"].items():
            column, unit = COLUMNS[quantity]
            values = rows[:, column]
            if quantity not in ("heave", "blade root"):
                checks.append(Check(f"{title}: mean {quantity}", known["mean"], values.mean(), 0.05, unit))
            checks += [
                Check(f"{title}: standard deviation of {quantity} {band}", expected, found, 0.1, unit)
                for band, expected, found in zip(bands, known["bands"], in_bands(values, dt), strict=True)
                if expected > 0.1 * known["std"]  # smaller parts do not show in any load
            ]
            if "del" in known:
                exponent = 4 if quantity == "tower base" else 10
                found = damage_equivalent_load(values, len(values) * dt, exponent)
                checks.append(Check(f"{title}: DEL of {quantity}", known["del"], found, 0.1, unit))
    return CaseResult(checks)
