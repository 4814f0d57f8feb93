"""The tower in front of which the blades pass: third harmonic of the thrust against strip theory.

The cylinder of the tower disturbs a wind that the rotor has slowed by its induced velocity. Each section of a blade
meets that disturbance once a turn; its harmonics add up where they are multiples of the number of blades. Sections
answer with Loewy's function, since all blades do the same a passing time apart (`dynamic_inflow`), and the induced
velocity has no time to follow.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from validation.carried_gust import five_megawatt_elements
from validation.case import CaseResult, Check, case
from validation.dynamic_inflow import loewy
from wt_gym.aerodynamics import tower_perturbation
from wt_gym.simulation import FIDELITIES, Simulator
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow

__all__ = ["measured_harmonics", "strip_theory"]

WIND = 8.0
ROTOR_SPEED = 0.963
"""In balance with the baseline's torque at this wind [rad/s]."""
TORQUE_GAIN = 2.332287
"""Of the baseline below rated power [N m s²/rad²], generator side (NREL/TP-500-38060, table 7-1)."""
HARMONICS = (3, 6)
SOURCE = "doublet in the slowed wind, blade elements with Loewy's function, own calculation"


def strip_theory(slowed: bool = True, lag: bool = True):
    """Amplitudes of the thrust's harmonics [N], complex with the azimuth's sign, shape (2,).

    ``slowed`` False: the undisturbed wind meets the tower; ``lag`` False: sections answer at once.
    """
    rotor, turbine = five_megawatt_elements(), load_turbine("nrel_5mw")
    induced, tower = rotor.equilibrium(WIND, ROTOR_SPEED, 0.0), turbine.tower
    axial, turning = WIND * rotor.cos_cone - induced[0], ROTOR_SPEED * rotor.radius + induced[1]
    small = 0.01
    ahead, behind = (rotor.forces(axial + sign * small, turning, 0.0)[0] for sign in (1.0, -1.0))
    slope = (ahead - behind) / (2.0 * small) * rotor.rotor.n_blades * rotor.width * rotor.cos_cone
    felt = WIND - (rotor.mean_induction(induced, WIND) * WIND if slowed else 0.0)
    psi = np.radians(np.arange(0.0, 360.0, 0.5))
    cone, tilt = turbine.hub.cone, turbine.nacelle.tilt
    along = rotor.radius / rotor.cos_cone
    upwind, out = -along * np.sin(cone), along * np.cos(cone)
    ahead_of_shaft = turbine.nacelle.overhang
    rise, across = out * np.cos(psi)[:, None], -out * np.sin(psi)[:, None]
    x = (upwind - ahead_of_shaft) * np.cos(tilt) + rise * np.sin(tilt)
    z = turbine.hub_height - (upwind * np.sin(tilt)) + rise * np.cos(tilt)
    points = np.stack([x, np.broadcast_to(across, x.shape), z], axis=-1)
    wind = np.zeros_like(points)
    wind[..., 0] = felt
    base = np.array([0.0, 0.0, tower.base_height])
    top = np.array([0.0, 0.0, tower.base_height + tower.length])
    dip = tower_perturbation(points, wind, base, top, tower.diameter_station, tower.diameter)[..., 0]
    passing = 2.0 * np.pi / (rotor.rotor.n_blades * ROTOR_SPEED)
    found = []
    for n in HARMONICS:
        omega = n * ROTOR_SPEED
        k = 0.5 * omega * rotor.chord / np.hypot(axial, turning)
        answer = loewy(k, axial * passing / (0.5 * rotor.chord), omega * passing) + 0.5j * k if lag else 1.0 + 0.0 * k
        gust = 2.0 * np.mean(dip * np.exp(-1j * n * psi)[:, None], axis=0)
        found.append(np.conj((slope * gust) @ answer))
    return np.array(found)


def measured_harmonics(fidelity, duration: float = 100.0, turns: int = 6):
    """Harmonics of the thrust that the tower makes [N], complex, shape (2,): with it less without it."""
    found = []
    for shadow in (True, False):
        body = fidelity.tower_body if shadow else None
        simulator = Simulator(
            "nrel_5mw", inflow=SteadyInflow(WIND), fidelity=replace(fidelity, tower_shadow=shadow, tower_body=body)
        )
        torque = TORQUE_GAIN * (97.0 * ROTOR_SPEED) ** 2
        signals = simulator.reset(rotor_speed=ROTOR_SPEED, pitch=0.0, generator_torque=torque)
        rows = []
        while signals.time < duration:
            torque = TORQUE_GAIN * signals.generator_speed**2
            signals = simulator.advance(0.1, pitch=(0.0, 0.0, 0.0), generator_torque=torque)
            rows.append((signals.azimuth, signals.aero_thrust))
        azimuth, thrust = np.array(rows).T
        azimuth = np.unwrap(azimuth)
        last = azimuth > azimuth[-1] - 2.0 * np.pi * turns
        fluctuation = thrust[last] - thrust[last].mean()
        found.append([2.0 * np.mean(fluctuation * np.exp(1j * n * azimuth[last])) for n in HARMONICS])
    return np.subtract(*np.array(found))


@case("tower-shadow", "5-MW turbine at 8 m/s: thrust at multiples of the blades' passing of the tower", SOURCE,
      slow=True)  # fmt: skip
def tower_shadow() -> CaseResult:
    """Third and sixth harmonic of the thrust within 0.25 of strip theory; half the time step changes 0.05 of it."""
    theory, lines, checks = strip_theory(), [], []
    rigid: dict[str, Any] = {"tower_coordinates": "rigid", "blade_coordinates": "rigid"}
    training = replace(FIDELITIES["training"], name="rigid", **rigid)
    engineering = replace(FIDELITIES["engineering"], name="rigid", **rigid)
    cheap = {}
    for name, fidelity in (("training", training), ("engineering", engineering)):
        cheap[name] = measured_harmonics(fidelity)
        for n, wanted, got in zip(HARMONICS, theory, cheap[name], strict=True):
            checks.append(Check(f"{name}: amplitude of harmonic {n}", abs(wanted) / 1e3, abs(got) / 1e3, 0.25, "kN",
                                source=SOURCE))  # fmt: skip
    half = measured_harmonics(replace(training, time_step=0.05))
    for n, wanted, got in zip(HARMONICS, cheap["training"], half, strict=True):
        checks.append(Check(f"training, half the time step: amplitude of harmonic {n}", abs(wanted) / 1e3,
                            abs(got) / 1e3, 0.05, "kN", source="with the whole time step"))  # fmt: skip
    body = measured_harmonics(replace(training, tower_body=(16, 24)))
    for name, values in (("theory", theory), ("theory, undisturbed wind", strip_theory(slowed=False)),
                         ("theory, sections that answer at once", strip_theory(lag=False)),
                         *cheap.items(), ("training with the tower as a closed body", body)):  # fmt: skip
        told = ", ".join(
            f"{n}P {abs(v) / 1e3:.2f} kN {np.degrees(np.angle(v)):.0f}°" for n, v in zip(HARMONICS, values, strict=True)
        )
        lines.append(f"{name}: {told}")
    return CaseResult(checks, {}, "\n".join(lines))
