"""Large deflections by cutting a beam into floating-frame bodies."""

from __future__ import annotations

import numpy as np

from validation.case import CaseResult, Check, Curve, Figure, absolute, case
from validation.exact_rod import exact_rod
from validation.tree_tools import ChainPoints, body_pose, static_balance
from wt_gym.multibody.system import Joint, MultibodySystem
from wt_gym.structure.beam import BeamSections
from wt_gym.structure.flexible_body import FlexibleBody
from wt_gym.structure.substructure import add_chain, cut_beam

NO_GRAVITY = (0.0, 0.0, 0.0)
BATHE = "Bathe & Bolourchi 1979, Int. J. Numer. Methods Eng. 14, 961–986; Simo & Vu-Quoc 1986; Wang et al. 2015"


def chain_with_tip(sub_bodies, gravity=NO_GRAVITY):
    """System of a cut beam with a massless body on its tip that takes tip loads; body indices of pieces and tip."""
    system = MultibodySystem(gravity)
    bodies = add_chain(system, sub_bodies, Joint("fixed"))
    tip = system.add(FlexibleBody.rigid("tip", 0.0, np.zeros(3), np.zeros((3, 3))), Joint("fixed"), bodies[-1], "tip")
    return system.build(), bodies, tip


def tip_loads(tip, force=(0.0, 0.0, 0.0), moment=(0.0, 0.0, 0.0), follower=False):
    """Loads for `static_balance`: force and moment on the tip body, dead (global axes) or following the tip."""

    def set_loads(_, inputs, work):
        turn = np.eye(3) if follower else work.rot[tip].T
        inputs.body_loads[:, tip, :3] = turn @ force
        inputs.body_loads[:, tip, 3:6] = turn @ moment

    return set_loads


# ---- Bathe's bend ----------------------------------------------------------------------------------------------------


def bathe_sections(n=361):
    """Circular arc of 45°, radius 100 in, unit square section, in the x–z plane from the root along +z towards +x."""
    angle = np.linspace(0.0, np.pi / 4.0, n)
    axis = 100.0 * np.column_stack([1.0 - np.cos(angle), 0.0 * angle, np.sin(angle)])
    stiffness = np.diag([np.inf, np.inf, 1e7, 1e7 / 12.0, 1e7 / 12.0, 0.5e7 / 6.0])
    inertia = np.diag([1.0, 1.0, 1.0, 1.0 / 12.0, 1.0 / 12.0, 1.0 / 6.0])
    return BeamSections(100.0 * angle, np.tile(stiffness, (n, 1, 1)), np.tile(inertia, (n, 1, 1)), axis)


def bathe_displacement(n_bodies, elements_each=2):
    """Tip displacement (3,) under 600 lb across the plane of the arc, from Newton's method in six load steps."""
    sub_bodies = cut_beam("bend", bathe_sections(), n_bodies * elements_each, n_bodies)
    system, _, tip = chain_with_tip(sub_bodies)
    y = system.initial_state()
    start = body_pose(system, y, tip)[0]
    for force in np.linspace(100.0, 600.0, 6):
        y = static_balance(system, y, tip_loads(tip, (0.0, force, 0.0)), tolerance=1e-8)
    return body_pose(system, y, tip)[0] - start


@case("bathe-bend", "Bathe's 45° bend: 600 lb at the tip of an arc, 8 and 16 bodies", BATHE)
def bathe_bend() -> CaseResult:
    """The published axes are x = towards the center, y = along the root tangent, z = across the plane."""
    checks, notes = [], []
    for n_bodies in (8, 16):
        moved = bathe_displacement(n_bodies, 16 // n_bodies)
        published = (
            ("towards the center", 0, -13.6, -13.4),
            ("along the root tangent", 2, -23.7, -23.5),
            ("across the plane", 1, 53.4, 53.5),
        )
        for name, component, low, high in published:
            # the arc bends towards +x here; towards the center the published displacement is negative (it unbends)
            text = f"tip displacement {name}, {n_bodies} bodies (2 % of the middle of the published values)"
            value = moved[component]
            checks.append(Check(text, 0.5 * (low + high), value, 0.02, "in", source=BATHE))
        notes.append(f"{n_bodies} bodies: ({moved[0]:.3f}, {moved[2]:.3f}, {moved[1]:.3f}) in")
    rod = exact_rod(bathe_sections(), tip_force=(0.0, 600.0, 0.0))[1]
    moved = rod[-1] - bathe_sections().axis[-1]
    notes.append(f"geometrically exact rod by shooting: ({moved[0]:.3f}, {moved[2]:.3f}, {moved[1]:.3f}) in")
    return CaseResult(checks, notes="\n".join(notes))


# ---- roll-up ---------------------------------------------------------------------------------------------------------


def roll_up(n_bodies, turns=1.0, elements_each=1):
    """Positions (n, 3) along a unit-stiffness cantilever of length 2π rolled up by the end moment 2π EI/L · turns."""
    length = 2.0 * np.pi
    sections = BeamSections.uniform(length, EA=1e6, EIx=1.0, EIy=1.0, GJ=1.0, mass=1.0, Ix=1e-4, Iy=1e-4)
    sub_bodies = cut_beam("roll", sections, n_bodies * elements_each, n_bodies, dofs=(0, 4))
    system, bodies, tip = chain_with_tip(sub_bodies)
    y = system.initial_state()
    for factor in np.linspace(0.25, 1.0, 4):
        y = static_balance(system, y, tip_loads(tip, moment=(0.0, factor * turns, 0.0)), tolerance=1e-9)
    stations = np.linspace(0.0, length, 16 * 8 + 1)
    return stations, ChainPoints(system, sub_bodies, bodies, stations).positions(y), body_pose(system, y, tip)


@case("roll-up", "Roll-up of a cantilever into a full circle by an end moment", "exact circle of radius EI/M")
def roll_up_case() -> CaseResult:
    """Length 2π, EI = 1, M = 1: a circle of radius 1 whose tip comes back to the root."""
    curves, found = [], {}
    source = "Euler's elastica: curvature M/EI"
    for n_bodies in (8, 16):
        _, where, (end, turn) = roll_up(n_bodies)
        radius = np.linalg.norm(where[:, [0, 2]] - [1.0, 0.0], axis=1)
        angle = np.pi + np.arctan2(-turn[0, 2], -turn[2, 2])  # between 0 and 2π, continuous at the full turn below
        found[n_bodies] = {
            "slope": angle if angle > np.pi else angle + 2.0 * np.pi,
            "gap": float(np.linalg.norm(end)) / (2.0 * np.pi),
            "half": float(where[len(where) // 2, 0]),
            "quarter": float(where[len(where) // 4, 0]),
            "deviation": float(np.abs(radius - 1.0).max()),
        }
        curves.append(Curve(where[:, 0], where[:, 2], f"{n_bodies} bodies", "--"))
    sixteen, eight = found[16], found[8]
    checks = [
        Check("tip slope, 16 bodies", 2.0 * np.pi, sixteen["slope"], 0.02, "rad", source=source),
        Check("distance of the tip from the root per length, 16 bodies", 0.0, sixteen["gap"], absolute(0.02), "",
              source=source),
        Check("height of the half-way point, 16 bodies", 2.0, sixteen["half"], 0.02, "m", source=source),
        Check("height of the quarter point, 16 bodies", 1.0, sixteen["quarter"], 0.02, "m", source=source),
        Check("distance from the circle per radius, 16 bodies", "<= 0.02", sixteen["deviation"], source=source),
    ]  # fmt: skip
    notes = (
        f"With 8 bodies (45° each) the slope is exact too, the half-way point lies at {eight['half']:.4f} m, and the "
        f"axis leaves the circle by {100 * eight['deviation']:.1f} % of the radius at most: within 2 % it takes 16."
    )
    around = np.linspace(0.0, 2.0 * np.pi, 200)
    curves.append(Curve(1.0 - np.cos(around), np.sin(around), "exact circle", "-"))
    return CaseResult(
        checks, {"cantilever rolled up by an end moment": Figure(tuple(curves), "x", "z", equal_axes=True)}, notes
    )
