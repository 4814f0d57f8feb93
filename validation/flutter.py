"""Classical flutter of rotors in overspeed: how small motions of turning blades grow or die on the lattice.

The rotor is held at a speed, on a rigid tower and shaft, in a wind of the same tip-speed ratio at all speeds and
pitched so that the air hardly bends the blades. Two runs that differ by a short kick of all pitch angles give a
difference that obeys the linear equations about the motion of the rotor, gravity, tilt and shed wake included. What is
left of it once the kick's own response has died is the least damped mode of the blades. The same marching and the same
reading of the modes find the flutter of a clamped wing (case ``goland-flutter``).

Beside it stands an independent calculation for one clamped, untwisted blade in still air: four flapwise and two
torsional modes with the section tables of the same files, strips with Jones's two-lag lift of slope 2 pi, centrifugal,
propeller and center-of-mass terms; it gives Goland's wing its published 137 m/s. A lattice should come out later, since
the lift of its tips falls off. The critical speeds that are quoted for the NREL 5-MW, 24 to 25 rpm, could not be
traced to printed tables.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from validation.case import CaseResult, Check, Curve, Figure, case
from validation.goland_wing import dominant_mode
from wt_gym.aerodynamics import AeroOptions
from wt_gym.control.operating_point import rotor_inertia
from wt_gym.simulation import Fidelity, Simulator
from wt_gym.simulation.drivetrain.drives import TorqueCommand
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow

__all__ = ["march", "unloaded_pitch"]

SPEEDS = {"nrel_5mw": (18.0, 19.5, 20.5, 21.5), "iea_15mw": (10.0, 11.5, 12.5)}
"""Rotor speeds [rpm]. Further below flutter the motion dies so fast that its least damped part cannot be told from what
the wake adds."""
STRIPS = {"nrel_5mw": 18.9, "iea_15mw": 11.5}
STRIPS_SOURCE = "strip theory with the same tables, lift slope 2 pi"
STRIP_FREQUENCY, QUOTED = 3.55, 25.0
"""Of the 5-MW's flutter [Hz]; the highest critical speed that is quoted for it [rpm]."""
TIME_STEP = 0.01
SETTLING, KICKED, FADING, MEASURED = 2.0, 0.1, 0.5, 2.0
KICK = np.radians(0.8)
TIP_SPEED_RATIO, PITCH_RANGE = 10.0, np.radians((2.0, 13.0))
"""The ratio, and so the flow about the blades, is the same at all speeds; where the pitch without thrust lies."""
HOLDING = 3.0
"""Feedback of the machine on the speed, in inertias of the rotor a second."""
AIR = AeroOptions(
    n_chord=4, n_span=16, azimuth_step_deg=1.5, wake_rows=80, full_rows=80, fresh_rows=8, refresh_stride=8,
    wind_stride=8, far_wake_rows=20, viscous=False,
)  # fmt: skip
RIGID_TOWER = Fidelity(
    "flutter", AIR, time_step=TIME_STEP, max_substep=0.005, stiffest_shaft=0.0, coupling_iterations=8,
    coupling_tolerance=1e-6, tower_coordinates="rigid", blade_modes=(4, 2, 2), integrator="generalized_alpha",
    spectral_radius=0.8,  # these steps resolve the twist, whose damping is what is asked for
    tower_shadow=False,
)  # fmt: skip


@dataclass(frozen=True)
class HeldSpeed(TorqueCommand):
    """A machine that brakes and drives without limits and holds the speed at which it was started."""

    damping: float = 0.0

    def first(self, value, speed):
        """Any torque [N m]."""
        return np.array([value])

    def balance(self, moment, speed):
        """The torque that balances the moment [N m]."""
        return (moment - self.damping * speed) / self.drivetrain.gear_ratio

    def follow(self, command, demand, dt, speed):
        """Keep the torque of the start."""


def march(turbine, rotor_speed, fidelity=RIGID_TOWER):
    """Motion that a kick of the pitch leaves, at a rotor speed [rad/s].

    Returns
    -------
    time : ndarray, shape (n,)
        Since the end of the kick [s].
    motion : ndarray, shape (n, 2)
        What the kick changes in the torsional and the flapwise moment at the root of the first blade, over the
        largest change of each [-].
    """
    wind = rotor_speed * turbine.rotor_diameter / 2.0 / TIP_SPEED_RATIO
    machine = HeldSpeed(turbine.drivetrain, HOLDING * rotor_inertia(turbine))
    simulator = Simulator(turbine, SteadyInflow(wind), fidelity, generator=machine)
    pitch = unloaded_pitch(simulator, rotor_speed)
    kicked, plain = (_moments(simulator, rotor_speed, pitch, kick) for kick in (KICK, 0.0))
    motion = kicked - plain
    return TIME_STEP * np.arange(len(motion)), motion / np.abs(motion).max(axis=0)


def _least_damped(turbine, rotor_speed) -> complex:
    """Growth [1/s] and circular frequency [rad/s] of the least damped mode, after the others have faded."""
    time, motion = march(turbine, rotor_speed)
    return dominant_mode(time, motion, start=FADING)


def unloaded_pitch(simulator, rotor_speed):
    """Pitch [rad] without thrust, from a steady state at a rotor speed [rad/s]: blades then bend neither way."""

    def thrust(pitch):
        return float(simulator.reset(rotor_speed=rotor_speed, pitch=pitch)["aero_thrust"])

    return brentq(thrust, *PITCH_RANGE, xtol=1e-3)


def _moments(simulator, rotor_speed, pitch, kick):
    """Torsional and flapwise moment (n, 2) [N m] after a kick of the pitch [rad]."""
    simulator.reset(rotor_speed=rotor_speed, pitch=pitch)
    simulator.advance(SETTLING, pitch=pitch)
    simulator.advance(KICKED, pitch=pitch + kick)
    rows = []
    for _ in range(round(MEASURED / TIME_STEP)):
        signals = simulator.advance(TIME_STEP, pitch=pitch)
        rows.append((signals["root_torsion"][0], signals["root_flap_moment"][0]))
    return np.array(rows)


@case(
    "rotor-flutter",
    "Overspeed until blades flutter: NREL 5-MW and IEA 15-MW with torsion, marched on the lattice",
    "strip theory with Jones's lags (18.9 and 11.5 rpm); quoted for the 5-MW: 24 to 25 rpm",
    slow=True,
)
def rotor_flutter() -> CaseResult:
    """Growth of the least damped mode over the rotor speed; the 5-MW's falls through zero between two speeds."""
    checks, curves, lines = [], [], []
    for name, speeds in SPEEDS.items():
        turbine = load_turbine(name)
        rated = turbine.drivetrain.rated_rotor_speed * 30.0 / np.pi
        modes = np.array([_least_damped(turbine, rpm * np.pi / 30.0) for rpm in speeds])
        lines += [
            f"{name} {rpm:6.2f} rpm ({rpm / rated:.2f} rated): {mode.imag / (2.0 * np.pi):.2f} Hz, growth "
            f"{mode.real:+.2f} 1/s, damping ratio {-mode.real / abs(mode):+.4f}"
            for rpm, mode in zip(speeds, modes, strict=True)
        ]
        curves.append(Curve(np.array(speeds) / rated, modes.real, name, "o-"))
        checks += _of_nrel_5mw(speeds, modes) if name == "nrel_5mw" else _of_iea_15mw(speeds, modes)
    figure = Figure(tuple(curves), "rotor speed over rated", "growth of the least damped mode [1/s]")
    return CaseResult(checks, {"growth": figure}, "\n".join(lines))


def _of_nrel_5mw(speeds, modes):
    """The speed at which a mode begins to grow."""
    k = int(np.argmax(modes.real > 0.0))  # 0 where none grows: then the speed below is no number
    share = -modes[k - 1].real / (modes[k].real - modes[k - 1].real) if k else np.nan
    critical = speeds[k - 1] + share * (speeds[k] - speeds[k - 1])
    frequency = (modes[k - 1] + share * (modes[k] - modes[k - 1])).imag / (2.0 * np.pi)
    return [
        Check("5-MW, flutter", f"in [{STRIPS['nrel_5mw']}, {QUOTED}]", critical, unit="rpm",
              source="strip theory below, quoted figures above"),
        Check("5-MW, frequency of flutter", STRIP_FREQUENCY, frequency, 0.15, "Hz", source=STRIPS_SOURCE),
    ]  # fmt: skip


def _of_iea_15mw(speeds, modes):
    """Nothing grows up to beyond the speed at which strips flutter; what outlives the rest is slow, flapwise motion."""
    return [
        Check(f"15-MW, growth at {rpm:g} rpm", "<= 0", mode.real, unit="1/s", source=STRIPS_SOURCE)
        for rpm, mode in zip(speeds, modes, strict=True)
    ]
