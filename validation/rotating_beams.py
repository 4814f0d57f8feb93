"""Rotating cantilevers: frequencies over the speed of rotation, Southwell coefficients, and the spin-up maneuver.

A beam clamped to a hub that turns at constant speed about x: flap is motion along x (along the spin axis), lag along y
(in the plane of rotation). Frequencies are made dimensionless with √(m L⁴/EI) and the speed η = Ω √(m L⁴/EI).
"""

from __future__ import annotations

import numpy as np

from validation.case import CaseResult, Check, Curve, Figure, case, worst
from validation.tree_tools import frequencies, rate_jacobian, read_table
from wt_gym.multibody.integrators.schemes import HammingIntegrator
from wt_gym.multibody.system import Joint, MultibodySystem
from wt_gym.structure.beam import Beam, BeamSections
from wt_gym.structure.flexible_body import FlexibleBody
from wt_gym.structure.modes import clamped_modes
from wt_gym.turbines.beam import inertia_matrix

LENGTH, EI, MASS = 10.0, 1.4e4, 1.2
UNIT = np.sqrt(MASS * LENGTH**4 / EI)
"""√(m L⁴/EI) [s]."""
TOLERANCE = 0.005
WRIGHT = "Wright, Smith, Thresher & Wang 1982, J. Appl. Mech. 49, 197–202; computed to all digits shown"
ROTARY = 1e-7
"""Rotary inertia per length [kg m], small against m L²: the tables are for Euler–Bernoulli beams."""


def uniform_sections():
    """Uniform beam with equal bending stiffness in both planes."""
    return BeamSections.uniform(LENGTH, EA=1e8, EIx=EI, EIy=EI, GJ=1e6, mass=MASS, Ix=ROTARY, Iy=ROTARY)


def tapered_sections(n=161):
    """Wedge with m = m₀ (1 − x/2L) and EI = EI₀ (1 − x/2L)³, both planes alike."""
    s = np.linspace(0.0, LENGTH, n)
    taper = 1.0 - 0.5 * s / LENGTH
    stiffness = np.array([np.diag([np.inf, np.inf, 1e8 * t, EI * t**3, EI * t**3, 1e6 * t**3]) for t in taper])
    inertia = inertia_matrix(MASS * taper, 0.0, 0.0, ROTARY, ROTARY, 0.0)
    return BeamSections(s, stiffness, inertia, np.column_stack([0.0 * s, 0.0 * s, s]))


def bending_basis(beam, coordinates, n_modes=16):
    """Modes of the clamped beam, or unit vectors of the bending coordinates of every node but the root.

    Axial coordinates are left out: the second-order field already keeps the axis inextensible, as the tables assume.
    """
    if coordinates == "modal":
        return np.hstack([clamped_modes(beam, n_modes // 2, node_dofs=plane).shape for plane in ((0, 4), (1, 3))])
    keep = [6 * node + k for node in range(1, beam.n_dof // 6) for k in (0, 1, 3, 4)]
    return np.eye(beam.n_dof)[:, keep]


def spinning_beam(sections, coordinates, delta=0.0, n_elements=None):
    """System of one beam on a hub of radius δ L driven about x, with the scale and the plane of its coordinates."""
    beam = Beam(sections, n_elements or (8 if coordinates == "nodal" else 16))
    basis = bending_basis(beam, coordinates)
    body = FlexibleBody.from_beam("blade", beam, basis)
    system = MultibodySystem(gravity=(0.0, 0.0, 0.0))
    turned = FlexibleBody.rigid("hub", 1.0, np.zeros(3), np.eye(3))
    drive = Joint("servo", (1.0, 0.0, 0.0), servo_frequency=1.0, servo_damping=0.0, name="spin")
    hub = system.add(turned, drive)
    system.add(body, Joint("fixed", offset=(0.0, 0.0, delta * LENGTH)), hub)
    moves = np.abs(basis).reshape(-1, 6, basis.shape[1]).max(axis=0)
    planes = [np.flatnonzero(moves[0] + moves[4] > 0.0), np.flatnonzero(moves[1] + moves[3] > 0.0)]
    return system.build(), 1e-4 / np.maximum(moves.max(axis=0), 1e-3), planes


def spinning_frequencies(model, eta):
    """Dimensionless frequencies in flap and in lag, ascending, at the dimensionless speed η."""
    system, scale, planes = model
    y = system.initial_state()
    y[-1] = eta / UNIT  # the rate of the drive: its angle and command are zero, so that it does not accelerate
    n = system.n_u
    jacobian = rate_jacobian(system, y, step=scale)
    out = []
    for chosen in planes:
        both, m = np.concatenate([chosen, n + chosen]), len(chosen)
        a = np.block([[np.zeros((m, m)), np.eye(m)], [jacobian[np.ix_(chosen, both)]]])
        out.append(np.sort(np.abs(np.linalg.eigvals(a).imag))[::2] * UNIT)
    return out


def branch(quantity, eta, expected, obtained, source):
    """Check of one branch of frequencies at the speed at which it fits worst."""
    return worst(quantity, "speeds: η = {:g}", eta, expected, obtained, TOLERANCE, source=source)


@case("rotating-cantilever", "Uniform rotating cantilever: flap 1–3, lag 1, nodal and modal coordinates", WRIGHT)
def rotating_cantilever() -> CaseResult:
    """Hub radius zero, η = 0 … 12."""
    table, columns = read_table("rotating_uniform_cantilever.csv")
    eta, column = table[:, 0], {name: table[:, i] for i, name in enumerate(columns)}
    checks, figures = [], {}
    for coordinates in ("modal", "nodal"):
        model = spinning_beam(uniform_sections(), coordinates)
        found = [spinning_frequencies(model, e) for e in eta]
        flap, lag = (np.array([f[plane][:3] for f in found]) for plane in (0, 1))
        for i in range(3):
            checks.append(branch(f"flap {i + 1}, {coordinates}", eta, column[f"flap{i + 1}"], flap[:, i], WRIGHT))
        checks.append(branch(f"lag 1, {coordinates}", eta, column["lag1"], lag[:, 0], WRIGHT))
        figures[f"uniform cantilever, {coordinates} coordinates"] = Figure((
            *(Curve(eta, column[f"flap{i}"], f"flap {i}, exact") for i in (1, 2, 3)),
            Curve(eta, column["lag1"], "lag 1, exact"),
            *(Curve(eta, flap[:, i], f"flap {i + 1}", "o") for i in range(3)),
            Curve(eta, lag[:, 0], "lag 1", "x"),
        ), "η = Ω √(m L⁴/EI)", "ω √(m L⁴/EI)")  # fmt: skip
    return CaseResult(checks, figures)


LAG = "; lag² = flap² − η², exact for a beam with equal stiffness in both planes"


def lag_of(flap, eta):
    """Exact frequency in the plane of rotation, whose equation differs from that of flap by the softening −m Ω² v."""
    return np.sqrt(flap**2 - eta**2)


@case("rotating-cantilever-hub", "Rotating cantilever on hubs of radius 0.05 L … 5 L: flap 1–3, lag 1", WRIGHT)
def rotating_cantilever_hub() -> CaseResult:
    """Speeds up to η = 12 are checked; η = 50 of the table belongs to a string rather than a beam."""
    table, _ = read_table("rotating_uniform_cantilever_hub_offset.csv")
    checks, figures = [], {}
    for coordinates in ("modal", "nodal"):
        found = np.zeros((len(table), 4))
        for delta in np.unique(table[:, 0]):
            model = spinning_beam(uniform_sections(), coordinates, delta)
            for k in np.flatnonzero((table[:, 0] == delta) & (table[:, 1] <= 12.0)):
                flap, lag = spinning_frequencies(model, table[k, 1])
                found[k] = [*flap[:3], lag[0]]
        rows = table[:, 1] <= 12.0
        for delta in np.unique(table[:, 0]):
            k = rows & (table[:, 0] == delta)
            for i in range(3):
                name = f"hub {delta:g} L, flap {i + 1}, {coordinates}"
                checks.append(branch(name, table[k, 1], table[k, 2 + i], found[k, i], WRIGHT))
            exact = lag_of(table[k, 2], table[k, 1])
            name = f"hub {delta:g} L, lag 1, {coordinates}"
            checks.append(branch(name, table[k, 1], exact, found[k, 3], WRIGHT + LAG))
        figures[f"hub offsets, {coordinates} coordinates"] = Figure(
            tuple(
                curve
                for delta in np.unique(table[:, 0])
                for k in [rows & (table[:, 0] == delta)]
                for curve in (
                    Curve(table[k, 1], table[k, 2], f"flap 1, δ = {delta:g}"),
                    Curve(table[k, 1], found[k, 0], "", "o"),
                )
            ),
            "η",
            "ω √(m L⁴/EI)",
        )
    return CaseResult(checks, figures)


@case(
    "rotating-tapered",
    "Tapered rotating cantilever: flap 1–3, lag 1",
    "Hodges & Rutkowski 1981, AIAA J. 19, case 2; computed",
)
def rotating_tapered() -> CaseResult:
    """Linearly tapered wedge, hub radius zero."""
    table, _ = read_table("rotating_tapered_cantilever.csv")
    eta, checks, curves = table[:, 0], [], []
    for coordinates in ("modal", "nodal"):
        model = spinning_beam(tapered_sections(), coordinates)
        both = [spinning_frequencies(model, e) for e in eta]
        flap, lag = np.array([f[0][:3] for f in both]), np.array([f[1][0] for f in both])
        for i in range(3):
            checks.append(
                branch(f"flap {i + 1}, {coordinates}", eta, table[:, 1 + i], flap[:, i], "Hodges & Rutkowski 1981")
            )
            curves.append(
                Curve(eta, flap[:, i], f"flap {i + 1}, {coordinates}", "o" if coordinates == "modal" else "x")
            )
        exact = lag_of(table[:, 1], eta)
        checks.append(branch(f"lag 1, {coordinates}", eta, exact, lag, "Hodges & Rutkowski 1981" + LAG))
    curves += [Curve(eta, table[:, 1 + i], f"flap {i + 1}, reference") for i in range(3)]
    return CaseResult(checks, {"tapered cantilever": Figure(tuple(curves), "η", "ω √(m₀ L⁴/EI₀)")})


@case("southwell", "Southwell coefficients of the uniform cantilever", "ω² = ω₀² + (K + K₁ δ) Ω² with exact modes")
def southwell() -> list[Check]:
    """One exact non-rotating mode a body: its frequency over the speed is then exactly Southwell's line."""
    table, _ = read_table("southwell_uniform_cantilever.csv")
    beam = Beam(uniform_sections(), 24)
    modes = clamped_modes(beam, 4, node_dofs=(0, 4)).shape
    source = "Rayleigh quotient with the exact modes, by quadrature"
    checks = []
    for row, mode in zip(table, modes.T, strict=True):
        body = FlexibleBody.from_beam("blade", beam, mode[:, None])
        squared = {}
        for delta, eta in ((0.0, 0.0), (0.0, 10.0), (1.0, 10.0)):
            system = MultibodySystem(gravity=(0.0, 0.0, 0.0))
            turned = FlexibleBody.rigid("hub", 1.0, np.zeros(3), np.eye(3))
            drive = Joint("servo", (1.0, 0.0, 0.0), servo_frequency=1.0, servo_damping=0.0, name="spin")
            hub = system.add(turned, drive)
            system.add(body, Joint("fixed", offset=(0.0, 0.0, delta * LENGTH)), hub)
            y = system.build().initial_state()
            y[-1] = eta / UNIT
            squared[delta, eta] = (frequencies(system, y, step=1e-3)[0] * UNIT) ** 2
        k = (squared[0.0, 10.0] - squared[0.0, 0.0]) / 100.0
        k1 = (squared[1.0, 10.0] - squared[0.0, 10.0]) / 100.0
        name = int(row[0])
        checks.append(Check(f"K of flap {name}", row[2], k, TOLERANCE, source=source))
        checks.append(Check(f"K₁ of flap {name}", row[3], k1, TOLERANCE, source=source))
    return checks


# ---- spin-up ---------------------------------------------------------------------------------------------------------

SPIN_SPEED, SPIN_TIME = 6.0, 15.0
"""Final speed [rad/s] and duration of the maneuver [s]."""
SPIN_SOURCE = "Simo & Vu-Quoc 1986 type maneuver; inextensible beam computed independently to −0.574 m"


def spin_angle(t):
    """Angle, speed and acceleration of Ω = 6 [t/15 − sin(2πt/15)/2π] up to 15 s, 6 rad/s after."""
    late = t >= SPIN_TIME
    w = 2.0 * np.pi / SPIN_TIME
    angle = SPIN_SPEED * (t**2 / (2.0 * SPIN_TIME) + (np.cos(w * t) - 1.0) / (2.0 * np.pi * w))
    end = SPIN_SPEED * SPIN_TIME / 2.0
    return (
        np.where(late, end + SPIN_SPEED * (t - SPIN_TIME), angle),
        np.where(late, SPIN_SPEED, SPIN_SPEED * (t / SPIN_TIME - np.sin(w * t) / (2.0 * np.pi))),
        np.where(late, 0.0, SPIN_SPEED * (1.0 - np.cos(w * t)) / SPIN_TIME),
    )


def spin_up(coordinates, end_time=20.0):
    """Histories of time, in-plane tip displacement and axial tip displacement of the driven beam.

    The drive is a servo whose command leads by what its own equation needs, so that the hub follows Ω(t) exactly.
    """
    sections = BeamSections.uniform(LENGTH, EA=2.8e7, EIx=EI, EIy=EI, GJ=1e6, mass=MASS, Ix=1e-6, Iy=1e-6)
    beam = Beam(sections, 12 if coordinates == "modal" else 4)
    # extension under the centrifugal load: one static shape is exact for the steady state
    pull = np.einsum("p,pa,p->a", beam.particle_mass, beam.particle_shape[:, 2], beam.particle_position[:, 2])
    axial = np.zeros((beam.n_dof, 1))
    axial[8::6, 0] = np.linalg.solve(beam.stiffness[8::6, 8::6], pull[8::6])
    axial /= axial[-4, 0]
    if coordinates == "modal":
        basis = np.hstack([clamped_modes(beam, 4, node_dofs=(1, 3)).shape, axial])
    else:
        keep = [6 * node + k for node in range(1, beam.n_dof // 6) for k in (1, 3)]
        basis = np.hstack([np.eye(beam.n_dof)[:, keep], axial])
    system = MultibodySystem(gravity=(0.0, 0.0, 0.0))
    servo, zeta = 20.0, 1.0
    drive = Joint("servo", (1.0, 0.0, 0.0), servo_frequency=servo, servo_damping=zeta, name="spin")
    body = FlexibleBody.from_beam("beam", beam, basis)
    system.add(body, drive)
    system.build()
    integrator = HammingIntegrator(system, 0.8e-3)
    integrator.start(system.initial_state())
    tip, n = body.markers["tip"], body.n_elastic
    chunk = 10
    time = np.arange(0, int(end_time / integrator.step) + 1, chunk) * integrator.step
    angle, speed, acceleration = spin_angle(time)
    command = angle + 2.0 * zeta / servo * speed + acceleration / servo**2
    history = np.zeros((len(time), 3))
    for k in range(1, len(time)):
        integrator.inputs.servo_command[0, 0], integrator.inputs.servo_command[1, 0] = command[k - 1], command[k]
        integrator.advance(chunk)
        q = integrator.state[:n]
        history[k] = tip.linear @ q + 0.5 * np.einsum("ijk,j,k->i", tip.second, q, q)
    return time, history[:, 1], history[:, 2]


@case("spin-up", "Spin-up of a flexible beam", SPIN_SOURCE)
def spin_up_case() -> CaseResult:
    """Beam turned up to 6 rad/s in 15 s: it lags behind, recovers and ends stretched by the centrifugal force."""
    checks, curves = [], []
    steady = MASS * SPIN_SPEED**2 * LENGTH**3 / (3.0 * 2.8e7)
    for coordinates in ("modal", "nodal"):
        time, across, along = spin_up(coordinates)
        sign = -np.sign(across[np.argmax(np.abs(across))])
        lowest = int(np.argmin(sign * across))
        late = time > 16.0
        checks += [
            Check(f"least tip displacement, {coordinates}", -0.574, sign * across[lowest], 0.015, "m",
                  source=SPIN_SOURCE),
            Check(f"time of it, {coordinates}", 6.76, time[lowest], 0.015, "s", source=SPIN_SOURCE),
            Check(f"mean axial tip displacement after 16 s, {coordinates}", steady, along[late].mean(), 0.015, "m",
                  source="ρA Ω² L³/3EA"),
        ]  # fmt: skip
        curves.append(Curve(time, sign * across, coordinates, "-" if coordinates == "modal" else "--"))
    return CaseResult(checks, {"tip displacement across the rotating axis [m]": Figure(tuple(curves), "t [s]", "m")})
