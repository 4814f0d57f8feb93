"""Local observer frames with second-order displacements: the geometric stiffness of axial forces within one body.

As published the displacement from a moving frame is linear, and the strain energy knows no axial force. With the
second-order displacement ½ qᵀ H q the centrifugal tension of a rotating blade stiffens it and the weight on a tower
softens it (:mod:`wt_gym.multibody.observer_frame.frame`). Both are seen in time, released with the velocities of the
first mode, and on the turbine in the wind.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from validation.case import CaseResult, Check, case
from validation.observer_substructures import chain, first_mode, period
from wt_gym.multibody.observer_frame.frame import ObserverFrameSystem
from wt_gym.multibody.observer_frame.observer_frame_body import Substructure
from wt_gym.multibody.observer_frame.observer_frame_integrator import ObserverFrameIntegrator
from wt_gym.runs.playing import run_baseline
from wt_gym.simulation import FIDELITIES, Simulator
from wt_gym.structure.beam import Beam, BeamSections
from wt_gym.wind import SteadyInflow

__all__ = ["TABLE", "rotating_frequency", "steady_tips"]

LENGTH, EI, MASS = 10.0, 1.4e4, 1.2
TABLE = {0.0: (3.5160, 3.5160), 2.0: (4.1373, 3.6218), 4.0: (5.5850, 3.8977), 8.0: (9.2568, 4.6571)}
"""ω √(m L⁴/EI) of the first flap and lag mode of a rotating cantilever without hub, by Ω √(m L⁴/EI)."""
SOURCE = "Wright, Smith, Thresher & Wang, J. Appl. Mech. 49, 1982; computed again from the beam's equation"


def rotating_frequency(eta, plane, displacement="second_order", n_modes=8, periods=20, per_period=150):
    """ω √(m L⁴/EI) of the first mode of a blade that a massive hub turns, from upward zero crossings of its tip.

    Parameters
    ----------
    eta : float
        Ω √(m L⁴/EI).
    plane : str
        "flap", along the axis of rotation, or "lag", across it.
    displacement : str
        From the observer frame, "linear" or "second_order".
    n_modes, periods, per_period : int
        Modes of the blade, periods that are watched and steps in each.
    """
    about_x, about_y = (16.0 * EI, EI) if plane == "flap" else (EI, 16.0 * EI)
    sections = BeamSections.uniform(LENGTH, EA=1e8, EIx=about_x, EIy=about_y, GJ=1e6, mass=MASS, Ix=1e-7, Iy=1e-7)
    beam, unit = Beam(sections, 12), np.sqrt(MASS * LENGTH**4 / EI)
    body = Substructure.from_beam("blade", beam, "clamped", n_modes, displacement=displacement)
    across = np.array([1.0, 0.0, 0.0]) if plane == "flap" else np.array([0.0, 1.0, 0.0])
    rates, spin = np.zeros(body.n), np.array([eta / unit, 0.0, 0.0])
    moves = across @ body.places["tip"].field[:3]
    first = int(np.argmax(np.abs(moves) > 0.5 * np.abs(moves).max()))
    rates[first] = 1e-3 * LENGTH / unit / moves[first]
    system = ObserverFrameSystem()
    system.add(body, angular_velocity=spin, rates=rates)
    system.add(_hub(1e6), angular_velocity=spin)
    system.hinge("hub", "root", (1.0, 0.0, 0.0))
    system.weld("hub", "root", "blade", "root")
    expected = TABLE[eta][0 if plane == "flap" else 1] / unit
    step = 2.0 * np.pi / expected / per_period
    run, out = ObserverFrameIntegrator(system, step), []
    for _ in range(round((periods + 0.75) * per_period)):
        run.advance()
        out.append(run.displacement("blade", "tip")[:3] @ across)
    x = np.array(out)
    up = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))
    crossing = step * (up + x[up] / (x[up] - x[up + 1]))
    return float(2.0 * np.pi * (len(crossing) - 1) / (crossing[-1] - crossing[0]) * unit)


def _hub(mass):
    """A rigid ball of points about the axis, so heavy that the blade does not slow it down."""
    beam = Beam(BeamSections.uniform(1.0, EA=1.0, EIx=1.0, EIy=1.0, GJ=1.0, mass=mass, Ix=mass, Iy=mass), 1)
    return Substructure.from_beam("hub", beam, n_modes=0)


def steady_tips(turbine, wind, fidelity, duration=30.0):
    """Mean deflection of the tips out of the plane [m] and root flap moment [N m] under the baseline controller.

    Over the second half of a run in steady wind with shear; the start is balanced by the equations of the tree in any
    formulation, and says nothing.
    """
    simulator, rows = Simulator(turbine, SteadyInflow(wind, shear_exponent=0.14), fidelity), []
    run_baseline(
        simulator, duration, on_step=lambda s: rows.append((s.tip_out_of_plane.mean(), s.root_flap_moment.mean()))
    )
    tip, moment = np.mean(rows[len(rows) // 2 :], axis=0)
    return float(tip), float(moment)


@case(
    "observer-second-order",
    "Observer frames with second-order displacements: rotating blade, loaded tower, turbine at rated wind",
    SOURCE,
)
def second_order() -> CaseResult:
    """Rotating-beam table, P-Δ of a tower in one body, tips of the turbine against the embedded form."""
    checks, lines = [], []
    for eta in TABLE:
        for k, plane in enumerate(("flap", "lag")):
            found = rotating_frequency(eta, plane)
            checks.append(Check(f"{plane} 1 at η = {eta:g}", TABLE[eta][k], found, 2e-3, source=SOURCE))
    known = first_mode(chain("tower", 1, linear=False)[0])[0]
    found = period("tower", 1, displacement="second_order")
    checks.append(Check("tower under 350 t in one body: first frequency", known, found, 2e-3, "rad/s",
                        source="the same body on joints, with second-order displacements"))  # fmt: skip
    base = FIDELITIES["training"]
    for name, wind in (("nrel_5mw", 8.0), ("nrel_5mw", 11.4), ("iea_15mw", 10.5)):
        tip, moment = steady_tips(name, wind, base)
        for displacement in ("second_order", "linear"):
            fidelity = replace(base, formulation="observer", frame_displacement=displacement)
            other, other_moment = steady_tips(name, wind, fidelity)
            lines.append(f"{name}, {wind:g} m/s, {displacement}: tips {100 * (other / tip - 1):+.3f} %, "
                         f"flap moment {100 * (other_moment / moment - 1):+.3f} %")  # fmt: skip
            if displacement == "second_order":
                checks.append(
                    Check(f"{name}, {wind:g} m/s: mean tip deflection", tip, other, 0.02, "m", source="embedded form")
                )
    return CaseResult(checks, notes="Observer frames against the embedded form. " + "; ".join(lines))
