"""Several local observer frames a beam: the geometric stiffness that one frame lacks comes back.

Within a body the formulation of Holm-Jørgensen, Nielsen & Rubak is linear and knows no geometric stiffness (case
`observer-second-order` has what brings it), but the
frames of a beam that is cut into bodies turn with it, and what acts along them acts along the deformed beam. Of the
second-order work ½ ∫ N (u')² ds of an axial force N only the part ½ ∫ N (u' − ū')² ds is left out, ū' being the slope
of the root of each body: a quarter with twice as many bodies. Two beams show it in time, each released with the
velocities of its first mode: a rotating blade, which centrifugal tension stiffens, and a tower, which the weight on its
top softens (P-Δ).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from validation.case import CaseResult, Check, Curve, Figure, case
from validation.three_formulations import EI, LENGTH, MASS
from wt_gym.multibody.observer_frame.observer_frame_from_system import observer_frame_from_system
from wt_gym.multibody.observer_frame.observer_frame_integrator import ObserverFrameIntegrator
from wt_gym.multibody.system import Joint, MultibodySystem
from wt_gym.simulation.turbine_structure import tower_beam
from wt_gym.structure.beam import BeamSections
from wt_gym.structure.flexible_body import FlexibleBody, without_second_order
from wt_gym.structure.substructure import add_chain, cut_beam
from wt_gym.turbines import load_turbine

__all__ = ["chain", "first_mode", "period"]

PIECES = (1, 2, 4, 8)
ELEMENTS, INTERIOR = 16, 3
SPEED = 1.14
"""Of the rotating blade [rad/s], 0.3 of its flap frequency at rest as in the NREL 5-MW turbine at rated speed."""
TOP = 350e3
"""Mass on the tower [kg]."""
BENDING = (0, 4)


def chain(what, n_sub_bodies, linear=True):
    """A "blade" on a turning hub or a "tower" with a mass on top, cut into pieces; system, beams and bodies.

    ``linear``: pieces without second-order displacement, as the observer frame has them.
    """
    tower = what == "tower"
    if tower:
        sections = tower_beam(load_turbine("nrel_5mw").tower, ELEMENTS).sections
    else:
        sections = BeamSections.uniform(LENGTH, EA=1e8, EIx=4 * EI, EIy=EI, GJ=1e6, mass=MASS, Ix=1e-4, Iy=1e-4)
    sub_bodies = cut_beam(what, sections, ELEMENTS, n_sub_bodies, "modal", INTERIOR, BENDING)
    if linear:
        sub_bodies = tuple(replace(p, body=without_second_order(p.body, p.beam, p.basis)) for p in sub_bodies)
    system = MultibodySystem(gravity=(0.0, 0.0, -9.80665 if tower else 0.0))
    turned = FlexibleBody.rigid("hub", 10.0, np.zeros(3), np.diag([2.0, 1.5, 1.5]))
    drive = Joint("fixed") if tower else Joint("servo", (1.0, 0.0, 0.0), servo_frequency=1.0, name="spin")
    hub = system.add(turned, drive)
    bodies = add_chain(system, sub_bodies, Joint(), hub)
    if tower:
        top = FlexibleBody.rigid("top", TOP, np.zeros(3), 1e6 * np.eye(3))
        system.add(top, Joint(), bodies[-1], "tip")
    return system.build(), {p.body.name: (p.beam, p.basis) for p in sub_bodies}, bodies


def inputs_of(system, speed):
    """Inputs under which a servo turns at a constant speed, and the state in which it does."""
    inputs, y = system.new_inputs(), system.initial_state()
    if system.n_servo:
        inputs.servo_interval[:], inputs.servo_rate[:], inputs.servo_command[1] = 1.0, speed, speed
        y[-1] = speed
    return inputs, y


def first_mode(system, speed=0.0, step=1e-5):
    """Lowest circular frequency about the straight beam and its shape (n_q,) in the tree's equations."""
    inputs, y = inputs_of(system, speed)
    work, n = system.new_work(), system.n_q
    unit = step * np.eye(n)

    def accelerations(q):
        state = y.copy()
        state[:n] += q
        return system.rates(state, inputs, work)[n : 2 * n]

    jacobian = np.array([(accelerations(e) - accelerations(-e)) / (2.0 * step) for e in unit]).T
    value, vector = np.linalg.eig(-jacobian)
    lowest = np.argmin(value.real)
    return float(np.sqrt(value[lowest].real)), vector[:, lowest].real


def period(what, n_sub_bodies, speed=0.0, periods=10, per_period=300, displacement="linear"):
    """Circular frequency of a run in observer frames from the first mode's velocities: upward zero crossings."""
    system, beams, bodies = chain(what, n_sub_bodies, displacement == "linear")
    frequency, shape = first_mode(system, speed)
    _, y = inputs_of(system, speed)
    tip = system.bodies[bodies[0]].markers["tip"].linear[0]
    size = tip @ shape[: len(tip)] * n_sub_bodies**2
    y[system.n_q : 2 * system.n_q] = 1e-3 * frequency * LENGTH / size * shape
    motions = {"spin": lambda t: (speed * t, speed, 0.0)} if system.n_servo else None
    step = 2.0 * np.pi / frequency / per_period
    observed = observer_frame_from_system(system, beams, y, motions=motions, displacement=displacement)
    run = ObserverFrameIntegrator(observed, step)
    name, out = system.bodies[bodies[-1]].name, []
    for _ in range(round((periods + 0.75) * per_period)):
        run.advance()
        out.append(run.position(name, "tip")[0])
    x = np.array(out)
    up = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))
    crossing = step * (up + x[up] / (x[up] - x[up + 1]))
    return 2.0 * np.pi * (len(crossing) - 1) / (crossing[-1] - crossing[0])


@case(
    "observer-substructures",
    "Rotating blade and loaded tower in several local observer frames: the geometric stiffness comes back",
    "the same beams in one body with second-order displacements; Southwell's coefficient of the uniform blade",
)
def substructures() -> CaseResult:
    """First frequency of one to eight bodies against that of one body with geometric stiffness."""
    checks, curves, lines = [], [], []
    for what, speed in (("blade", SPEED), ("tower", 0.0)):
        known = first_mode(chain(what, 1, linear=False)[0], speed)[0]
        found = np.array([period(what, n, speed) for n in PIECES])
        error = found / known - 1.0
        lines.append(f"{what}: " + ", ".join(f"{n} {100 * e:+.3f} %" for n, e in zip(PIECES, error, strict=True)))
        curves.append(Curve(np.array(PIECES, dtype=float), np.abs(error), what))
        checks += [
            Check(f"{what}: error of the first frequency with 4 bodies over that with 2", 0.25, error[2] / error[1],
                  0.2, source="the slope within a body falls with its length, its square counts"),
            Check(f"{what}: first frequency with 8 bodies against one with geometric stiffness", "<= 0.005",
                  abs(error[3]), source="the same beam"),
        ]  # fmt: skip
        if what == "blade":
            rest = first_mode(chain(what, 1)[0])[0]
            checks.append(Check("blade: one body keeps its frequency at rest when it turns", rest, found[0], 1e-4,
                                "rad/s", source="no geometric stiffness within a body"))  # fmt: skip
    figures = {"First frequency": Figure(tuple(curves), "bodies", "relative error [-]")}
    return CaseResult(checks, figures, "Error of the first frequency by the number of bodies. " + "; ".join(lines))
