"""Rotating beams: cantilevers over their speed, and one rotor in all three formulations."""

from functools import cache

import numpy as np
from scipy.linalg import block_diag, eigh, null_space
from scipy.spatial.transform import Rotation

from envs_tests.physics.cases.tools import body_pose, eigenfrequencies, frequencies, rate_jacobian
from envs_tests.physics.validation import CaseResult, Check, Curve, Figure, case, read_table, worst
from wt_gym.multibody.integrators.schemes import HammingIntegrator
from wt_gym.multibody.observer_frame.observer_frame_from_system import observer_frame_from_system
from wt_gym.multibody.observer_frame.observer_frame_integrator import ObserverFrameIntegrator
from wt_gym.multibody.system import Constraint, Joint, MultibodySystem
from wt_gym.structure.beam import Beam, BeamSections
from wt_gym.structure.flexible_body import FlexibleBody, without_second_order
from wt_gym.structure.modes import clamped_modes
from wt_gym.turbines.blade import inertia_matrix

# ---- rotating cantilevers -------------------------------------------------------------------------------------------
# A beam clamped to a hub that turns at constant speed about x: flap is motion along x (along the spin axis), lag along
# y (in the plane of rotation). Frequencies are made dimensionless with √(m L⁴/EI) and the speed η = Ω √(m L⁴/EI).

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


def bending_basis(beam, coordinates):
    """Modes of the clamped beam, or unit vectors of the bending coordinates of every node but the root.

    Axial coordinates are left out: the second-order field already keeps the axis inextensible, as the tables assume.
    """
    if coordinates == "modal":
        return np.hstack([clamped_modes(beam, 8, node_dofs=plane).shape for plane in ((0, 4), (1, 3))])
    keep = [6 * node + k for node in range(1, beam.n_dof // 6) for k in (0, 1, 3, 4)]
    return np.eye(beam.n_dof)[:, keep]


def on_spinning_hub(body, delta):
    """System of a body on a hub of radius δ L driven about x."""
    system = MultibodySystem(gravity=(0.0, 0.0, 0.0))
    turned = FlexibleBody.rigid("hub", 1.0, np.zeros(3), np.eye(3))
    drive = Joint("servo", (1.0, 0.0, 0.0), servo_frequency=1.0, servo_damping=0.0, name="spin")
    system.add(body, Joint("fixed", offset=(0.0, 0.0, delta * LENGTH)), system.add(turned, drive))
    return system.build()


def spinning_beam(sections, coordinates, delta=0.0):
    """System of one beam on a hub of radius δ L driven about x, with the scale and the plane of its coordinates."""
    beam = Beam(sections, 8 if coordinates == "nodal" else 16)
    basis = bending_basis(beam, coordinates)
    moves = np.abs(basis).reshape(-1, 6, basis.shape[1]).max(axis=0)
    planes = [np.flatnonzero(moves[0] + moves[4] > 0.0), np.flatnonzero(moves[1] + moves[3] > 0.0)]
    system = on_spinning_hub(FlexibleBody.from_beam("blade", beam, basis), delta)
    return system, 1e-4 / np.maximum(moves.max(axis=0), 1e-3), planes


def spinning_frequencies(model, eta):
    """Dimensionless frequencies in flap and in lag, ascending, at the dimensionless speed η."""
    system, scale, planes = model
    y = system.initial_state()
    y[-1] = eta / UNIT  # the rate of the drive: its angle and command are zero, so that it does not accelerate
    n = system.n_u
    jacobian = rate_jacobian(system, y, step=scale)
    out = []
    for chosen in planes:
        out.append(eigenfrequencies(jacobian[np.ix_(chosen, np.concatenate([chosen, n + chosen]))]) * UNIT)
    return out


def branches(sections, coordinates, eta, delta=0.0):
    """Frequencies of flap 1 to 3 and lag 1 over the speeds, shape (n, 4)."""
    model = spinning_beam(sections, coordinates, delta)
    return np.array([[*flap[:3], lag[0]] for flap, lag in (spinning_frequencies(model, e) for e in eta)])


def compared(coordinates, eta, expected, found, source, where="", of_lag=""):
    """Checks of the four branches, each at the speed at which it fits worst."""
    names = [(f"{where}{name}, {coordinates}", source) for name in ("flap 1", "flap 2", "flap 3")]
    names.append((f"{where}lag 1, {coordinates}", source + of_lag))
    return [
        worst(name, "speeds: η = {:g}", eta, expected[:, i], found[:, i], TOLERANCE, source=origin)
        for i, (name, origin) in enumerate(names)
    ]


@case("rotating-cantilever", "Uniform rotating cantilever: flap 1–3, lag 1, nodal and modal coordinates", WRIGHT)
def rotating_cantilever() -> CaseResult:
    """Hub radius zero, η = 0 … 12."""
    table, columns = read_table("rotating_uniform_cantilever.csv")
    eta, exact = table[:, 0], table[:, [columns.index(name) for name in ("flap1", "flap2", "flap3", "lag1")]]
    checks, figures = [], {}
    for coordinates in ("modal", "nodal"):
        found = branches(uniform_sections(), coordinates, eta)
        checks += compared(coordinates, eta, exact, found, WRIGHT)
        names = ("flap 1", "flap 2", "flap 3", "lag 1")
        curves = [Curve(eta, exact[:, i], f"{name}, exact") for i, name in enumerate(names)]
        curves += [Curve(eta, found[:, i], name, "x" if i == 3 else "o") for i, name in enumerate(names)]
        figures[f"uniform cantilever, {coordinates} coordinates"] = Figure(
            tuple(curves), "η = Ω √(m L⁴/EI)", "ω √(m L⁴/EI)"
        )
    return CaseResult(checks, figures)


LAG = "; lag² = flap² − η², exact for a beam with equal stiffness in both planes"


def with_lag(eta, flap):
    """Flap and the exact frequency in the plane of rotation, whose equation has the softening −m Ω² v besides."""
    return np.column_stack([flap, np.sqrt(flap[:, 0] ** 2 - eta**2)])


@case("rotating-cantilever-hub", "Rotating cantilever on hubs of radius 0.05 L … 5 L: flap 1–3, lag 1", WRIGHT)
def rotating_cantilever_hub() -> CaseResult:
    """Speeds up to η = 12 are checked; η = 50 of the table belongs to a string rather than a beam."""
    table, _ = read_table("rotating_uniform_cantilever_hub_offset.csv")
    table = table[table[:, 1] <= 12.0]
    checks, figures = [], {}
    for coordinates in ("modal", "nodal"):
        curves = []
        for delta in np.unique(table[:, 0]):
            eta, *flap = table[table[:, 0] == delta, 1:5].T
            exact, found = with_lag(eta, np.transpose(flap)), branches(uniform_sections(), coordinates, eta, delta)
            checks += compared(coordinates, eta, exact, found, WRIGHT, f"hub {delta:g} L, ", LAG)
            curves += [Curve(eta, exact[:, 0], f"flap 1, δ = {delta:g}"), Curve(eta, found[:, 0], "", "o")]
        figures[f"hub offsets, {coordinates} coordinates"] = Figure(tuple(curves), "η", "ω √(m L⁴/EI)")
    return CaseResult(checks, figures)


HODGES = "Hodges & Rutkowski 1981"


@case("rotating-tapered", "Tapered rotating cantilever: flap 1–3, lag 1", f"{HODGES}, AIAA J. 19, case 2; computed")
def rotating_tapered() -> CaseResult:
    """Linearly tapered wedge, hub radius zero."""
    table, _ = read_table("rotating_tapered_cantilever.csv")
    eta, checks, curves = table[:, 0], [], []
    exact = with_lag(eta, table[:, 1:4])
    for coordinates, style in (("modal", "o"), ("nodal", "x")):
        found = branches(tapered_sections(), coordinates, eta)
        checks += compared(coordinates, eta, exact, found, HODGES, of_lag=LAG)
        curves += [Curve(eta, found[:, i], f"flap {i + 1}, {coordinates}", style) for i in range(3)]
    curves += [Curve(eta, exact[:, i], f"flap {i + 1}, reference") for i in range(3)]
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
            system = on_spinning_hub(body, delta)
            y = system.initial_state()
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


# ---- one rotor in three formulations --------------------------------------------------------------------------------
# A flexible shaft in a bearing at its rear end carries a rigid hub with three flexible blades, which the constrained
# form hangs on the hub by Lagrange multipliers; both descriptions are translated to local observer frames. Without the
# second-order displacement these lack the geometric stiffness K Ω² of rotation, K = 1.193 for the first flap mode of a
# uniform blade (Southwell): the frequency ω₀ is too low by K Ω²/2ω₀, the phase after a time t by K Ω² t/2ω₀.

SHAFT = 2.0
PUSH, TORQUE, RAMP, STRIKE = 0.4, 12.0, 1.0, 0.2
"""Uniform acceleration along the shaft [m/s²], drive torque [N m] and its duration [s], and the rate of the first flap
coordinate of blade 1 at the start [√kg m/s]."""
SLOW, FAST = 0.05, 1.5
"""Speeds of rotation [rad/s]."""
DURATION = 4.0
Z_TO_X = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


@cache
def rotor_beams():
    """Beam and basis of the flexible bodies, by name: three blades (flap and lag) and the shaft (bending, torsion)."""
    sections = BeamSections.uniform(LENGTH, EA=1e8, EIx=4 * EI, EIy=EI, GJ=1e6, mass=MASS, Ix=1e-4, Iy=1e-4)
    blade = Beam(sections, 8)
    shape = np.hstack([clamped_modes(blade, 3, node_dofs=plane).shape for plane in ((0, 4), (1, 3))])
    shaft = Beam(BeamSections.uniform(SHAFT, EA=1e8, EIx=4e5, EIy=4e5, GJ=2e4, mass=20.0, Ix=0.1, Iy=0.1), 4)
    heavy = np.diag([46.0, 46.0, 46.0, 700.0, 700.0, 1210.0])
    modes = clamped_modes(shaft, 3, tip_mass=heavy, node_dofs=(0, 1, 3, 4, 5)).shape
    return {"shaft": (shaft, modes), **{f"blade {k + 1}": (blade, shape) for k in range(3)}}


def flexible(name, geometric=True):
    """A flexible body of the rotor, with or without second-order displacements."""
    beam, basis = rotor_beams()[name]
    body = FlexibleBody.from_beam(name, beam, basis)
    return body if geometric else without_second_order(body, beam, basis)


def build(form="embedded", geometric=True, push=PUSH):
    """The rotor as a multibody system: "embedded" or "constrained"."""
    system = MultibodySystem(gravity=(push, 0.0, 0.0))
    shaft = system.add(
        flexible("shaft", geometric), Joint("revolute", (0.0, 0.0, 1.0), rotation=Z_TO_X, name="azimuth")
    )
    turned = FlexibleBody.rigid("hub", 10.0, np.zeros(3), np.diag([2.0, 1.5, 1.5]), {"center": np.zeros(3)})
    hub = system.add(turned, Joint("fixed", rotation=Z_TO_X.T), shaft, "tip")
    for k in range(3):
        body, turn = flexible(f"blade {k + 1}", geometric), Rotation.from_rotvec([2.0 * np.pi * k / 3.0, 0.0, 0.0])
        if form == "embedded":
            system.add(body, Joint("fixed", rotation=turn.as_matrix()), hub, "center")
        else:
            placed = system.add(body, Joint("free", name=f"place of {body.name}"))
            weld = Constraint("weld", rotation=turn.as_matrix(), name=f"root of {body.name}")
            system.add_constraint(weld, hub, placed, "center", "root")
    return system.build()


def begin(system, speed):
    """State of the undeformed rotor that turns at a speed [rad/s], while blade 1 has been struck."""
    y = system.initial_state()
    y[system.n_q + system.index(0, "joint_u")] = speed
    y[system.n_q + system.index(2, "elastic_u")] = STRIKE
    system.place_free_bodies(y)
    return y


def torque(time):
    """Drive torque [N m], which acts for one second."""
    return TORQUE * np.sin(np.pi * time / RAMP) ** 2 if time < RAMP else 0.0


# ---- frequencies at rest ---------------------------------------------------------------------------------------------


def observed_frequencies(system):
    """Circular frequencies at rest of a system in observer frames: K and M on the null space of the constraints.

    Springs of hinges add k bᵀb with the row b of their angle, rotors geared to them I bᵀb to the mass.
    """
    model, state, work = system.pack()
    system._check_constraints(model, state, work)
    rows, springs = [], []
    for r in range(len(model.row_kind)):
        row = [np.zeros(body.n) for body in system.bodies]
        for side in range(2):
            m = model.row_marker[r, side]
            if m >= 0:
                b = model.marker_body[m]
                row[b] = row[b] + work.weight[r, side] @ model.marker_shape[m, :, : system.bodies[b].n]
        if model.row_spring[r] >= 0:
            springs.append((model.row_stiffness[r], model.row_inertia[r], np.concatenate(row)))
        else:
            rows.append(np.concatenate(row))
    free = null_space(np.array(rows))
    stiffness, mass = (
        free.T @ block_diag(*blocks) @ free
        for blocks in ([b.stiffness for b in system.bodies], [b.mass_matrix for b in system.bodies])
    )
    for spring, rotor, twist in springs:
        angle = np.outer(twist @ free, twist @ free)
        stiffness += spring * angle
        mass += rotor * angle
    return np.sqrt(np.maximum(eigh(stiffness, mass, eigvals_only=True), 0.0))


def constrained_frequencies(system, y, step=1e-5):
    """Circular frequencies of the constrained form: free bodies follow the coordinates that remain."""
    work, inputs = system.new_work(), system.new_inputs()
    kept = [(system.index(0, "joint_q"), system.index(0, "joint_u"))]
    for b, body in enumerate(system.bodies):
        kept += [(system.index(b, "elastic_q") + i, system.index(b, "elastic_u") + i) for i in range(body.n_elastic)]
    at, rate = np.array([q for q, _ in kept]), np.array([u for _, u in kept])

    def accelerations(change):
        moved = y.copy()
        moved[at] += change
        system.place_free_bodies(moved)
        return system.rates(moved, inputs, work)[system.n_q + rate]

    unit = step * np.eye(len(at))
    jacobian = np.array([(accelerations(e) - accelerations(-e)) / (2.0 * step) for e in unit]).T
    return np.sqrt(np.maximum(np.sort(np.linalg.eigvals(-jacobian).real), 0.0))


# ---- response --------------------------------------------------------------------------------------------------------


def tree_response(form, speed, geometric=True, step=0.002, every=10):
    """Time (n,), tips (n, 3, 3) of the blades in the fixed frame [m] and hub speed (n,) of a multibody system."""
    system = build(form, geometric)
    run = HammingIntegrator(system, step)
    u = system.n_q + system.index(0, "joint_u")
    run.start(begin(system, speed))
    out = []
    for k in range(round(DURATION / step) + 1):
        if k:
            for end in range(2):
                run.inputs.dof_force[end, system.index(0, "joint_u")] = torque((k - 1 + end) * step)
            run.advance()
        if k % every == 0:
            y, tips = run.state.copy(), []
            for b in range(2, 5):
                tip, first = system.bodies[b].markers["tip"], system.index(b, "elastic_q")
                q = y[first : first + system.bodies[b].n_elastic]
                position, rotation = body_pose(system, y, b)
                tips.append(position + rotation @ (tip.position + tip.linear @ q + 0.5 * (tip.second @ q) @ q))
            out.append((k * step, np.array(tips), y[u]))
    return tuple(np.array(x) for x in zip(*out, strict=True))


def observed_response(system, speed, step=0.002, every=10, **options):
    """The same of the system in local observer frames."""
    other = observer_frame_from_system(system, rotor_beams(), begin(system, speed))
    other.load("shaft", "root", lambda t: np.array([0.0, 0.0, 0.0, torque(t), 0.0, 0.0]), "fixed")
    run, out = ObserverFrameIntegrator(other, step, **options), []
    for k in range(round(DURATION / step) + 1):
        if k:
            run.advance()
        if k % every == 0:
            tips = [run.position(f"blade {b + 1}", "tip") for b in range(3)]
            out.append((k * step, np.array(tips), run.velocity("shaft", "root")[3]))
    return tuple(np.array(x) for x in zip(*out, strict=True))


# ---- the case --------------------------------------------------------------------------------------------------------


def collective_flap(geometric, speed):
    """First circular frequency of the three blades flapping together at a speed, in the embedded form [rad/s].

    The shaft does not stretch: this motion leaves it at rest.
    """
    system = build("embedded", geometric, push=0.0)
    y = system.initial_state()
    y[system.n_q + system.index(0, "joint_u")] = speed
    together = np.zeros((system.n_u, 3))
    for b in range(2, 5):
        together[system.index(b, "elastic_u") + np.arange(3), np.arange(3)] = 1.0 / np.sqrt(3.0)
    jacobian = together.T @ rate_jacobian(system, y, step=1e-4) @ block_diag(together, together)
    return float(eigenfrequencies(jacobian)[0])


def flap_history(time, frequency):
    """Mean flapwise displacement of the tips [m] in the first mode after the push and the strike, at one frequency."""
    beam, basis = rotor_beams()["blade 1"]
    mode = basis[:, 0]
    push = PUSH * beam.particle_mass @ (beam.particle_shape[:, 0] @ mode)
    q = push / frequency**2 * (1.0 - np.cos(frequency * time)) + STRIKE / 3.0 / frequency * np.sin(frequency * time)
    return q * mode[-6]


@case(
    "one-rotor-three-formulations",
    "One rotor in the embedded, the constrained and the observer-frame form: frequencies and response",
    "the same bodies, joints and loads; Southwell's coefficient of the uniform blade",
    quick={"speeds": ()},
)
def one_rotor(speeds=(SLOW, FAST)) -> CaseResult:
    """At rest, turning slowly, and at a speed at which the missing geometric stiffness shows."""
    rest, tied_rest = build(push=0.0), build("constrained", push=0.0)
    still = rest.initial_state()
    known = frequencies(rest, still)[1:]
    alone = tied_rest.initial_state()
    tied_rest.place_free_bodies(alone)
    at_rest = {
        "constrained": constrained_frequencies(tied_rest, alone)[1:],
        "observer frame": observed_frequencies(observer_frame_from_system(rest, rotor_beams()))[1:],
        "observer frame, from the constrained form": observed_frequencies(
            observer_frame_from_system(tied_rest, rotor_beams(), alone)
        )[1:],
    }
    checks = [
        Check(f"{len(known)} frequencies at rest, {name} against embedded: largest relative difference", "<= 1e-6",
              np.abs(found / known - 1.0).max(), source="the same linear equations")
        for name, found in at_rest.items()
    ]  # fmt: skip
    embedded, constrained = build(), build("constrained")
    flap, southwell = collective_flap(True, 0.0), read_table("southwell_uniform_cantilever.csv")[0][0, 2]
    figures = {}
    for speed in speeds:
        full = tree_response("embedded", speed)
        tied = tree_response("constrained", speed)
        linear = tree_response("embedded", speed, geometric=False)
        steps = {0.004: 5, 0.002: 10, 0.001: 20}
        seen = {step: observed_response(embedded, speed, step, every) for step, every in steps.items()}
        gap = {step: np.abs(run[1] - linear[1]).max() for step, run in seen.items()}
        amplitude = np.abs(full[1][:, :, 0] - SHAFT).max()
        at = f"Ω = {speed:g} rad/s"
        checks += [
            Check(f"{at}: tips, constrained against embedded, largest difference over the amplitude", "<= 1e-6",
                  np.abs(tied[1] - full[1]).max() / amplitude, source="the same equations"),
            Check(f"{at}: tips, observer frame against the embedded form without second-order displacements, step 1 ms",
                  "<= 2e-4", gap[0.001] / amplitude,
                  source="the same equations; Newmark's period error (ω h)² ω t/12 of the flap mode is 2e-5"),
            Check(f"{at}: that difference with the step halved from 0.004 s", 4.0, gap[0.004] / gap[0.002], 0.15,
                  source="order two"),
        ]  # fmt: skip
        late = (full[1] - seen[0.001][1])[:, :, 0]
        if speed == SLOW:
            bound = southwell * full[2].max() ** 2 * DURATION / (2.0 * flap)
            checks.append(
                Check(f"{at}: flapwise tips, observer frame against embedded, largest difference over the amplitude",
                      f"<= {bound:.2e}", np.abs(late).max() / amplitude,
                      source="K Ω² t/2ω₀, the phase that the geometric stiffness makes")
            )  # fmt: skip
            other = observed_response(constrained, speed, 0.004, 5)
            checks.append(Check(f"{at}: tips, observer frame from the constrained and from the embedded description",
                                "<= 1e-9", np.abs(other[1] - seen[0.004][1]).max() / amplitude,
                                source="the same constraints"))  # fmt: skip
        else:
            stiff, soft = collective_flap(True, speed), collective_flap(False, speed)
            time, mean = full[0], full[2].mean()
            expected = flap_history(time, np.sqrt(flap**2 + southwell * mean**2)) - flap_history(time, flap)
            found = late.mean(axis=1)
            checks += [
                Check(f"{at}: (ω² − ω₀²)/Ω² of the collective flap mode, embedded", southwell,
                      (stiff**2 - flap**2) / speed**2, 0.01, source="Southwell's coefficient"),
                Check(f"{at}: collective flap frequency without second-order displacements, as in the observer frame",
                      flap, soft, 1e-6, "rad/s", source="no geometric stiffness, no softening in flap"),
                Check(f"{at}: mean flapwise tip, embedded less observer frame, largest difference",
                      np.abs(expected).max(), np.abs(found).max(), 0.03, "m",
                      source="first mode at ω₀ and at √(ω₀² + K Ω²)"),
            ]  # fmt: skip
        figures[f"Blade 1 flapwise, {at}"] = Figure((
            Curve(full[0], full[1][:, 0, 0] - SHAFT, "embedded"),
            Curve(tied[0][::5], tied[1][::5, 0, 0] - SHAFT, "constrained", "x"),
            Curve(full[0], seen[0.001][1][:, 0, 0] - SHAFT, "observer frame", "--"),
        ), "time [s]", "tip along the shaft [m]")  # fmt: skip
        figures[f"Hub speed, {at}"] = Figure((
            Curve(full[0], full[2], "embedded"),
            Curve(tied[0][::5], tied[2][::5], "constrained", "x"),
            Curve(full[0], seen[0.001][2], "observer frame", "--"),
        ), "time [s]", "Ω [rad/s]")  # fmt: skip
    notes = (
        "The observer frame suits slowly turning machines: its flap frequency is too low by about K Ω²/2ω₀, "
        f"{100 * (collective_flap(True, FAST) / flap - 1.0):.1f} % for this rotor at {FAST:g} rad/s."
    )
    return CaseResult(checks, figures, notes)
