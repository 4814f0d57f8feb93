"""Geometric stiffness in local observer frames, and the reduction of a whole turbine."""

import time
from dataclasses import replace

import numpy as np

from envs_tests.physics.cases.rotating_beams import EI, LENGTH, MASS
from envs_tests.physics.cases.tools import crossing_frequency
from envs_tests.physics.validation import CaseResult, Check, Curve, Figure, case
from wt_gym.analysis.metrics import damage_equivalent_load
from wt_gym.experiment.run import run_baseline
from wt_gym.multibody.observer_frame.frame import ObserverFrameSystem
from wt_gym.multibody.observer_frame.observer_frame_body import Substructure
from wt_gym.multibody.observer_frame.observer_frame_from_system import observer_frame_from_system
from wt_gym.multibody.observer_frame.observer_frame_integrator import ObserverFrameIntegrator
from wt_gym.multibody.system import Joint, MultibodySystem
from wt_gym.simulation import FIDELITIES, Simulator
from wt_gym.simulation.turbine_structure import add_sub_bodies, tower_beam
from wt_gym.structure.beam import Beam, BeamSections
from wt_gym.structure.flexible_body import FlexibleBody, without_second_order
from wt_gym.structure.substructure import cut_beam
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow, TurbulenceBox, TurbulentInflow

# ---- several frames a beam ------------------------------------------------------------------------------------------
# A body in one frame is linear and knows no geometric stiffness, but the frames of a beam that is cut into bodies turn
# with it. Of the second-order work ½ ∫ N (u')² ds of an axial force N only ½ ∫ N (u' − ū')² ds is left out, ū' being
# the slope of the root of each body: a quarter with twice as many bodies. Two beams show it, released with the
# velocities of their first mode: a rotating blade, which tension stiffens, and a tower, which its top softens (P-Δ).

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
    bodies = add_sub_bodies(system, sub_bodies, lambda body: system.add(body, Joint(), hub), what)
    if tower:
        top = FlexibleBody.rigid("top", TOP, np.zeros(3), 1e6 * np.eye(3))
        system.add(top, Joint(), bodies[-1], "tip")
    return (
        system.build(),
        {system.bodies[b].name: (p.beam, p.basis) for b, p in zip(bodies, sub_bodies, strict=True)},
        bodies,
    )


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


def period(what, n_sub_bodies, speed=0.0, displacement="linear"):
    """Circular frequency of a run in observer frames from the first mode's velocities: upward zero crossings."""
    system, beams, bodies = chain(what, n_sub_bodies, displacement == "linear")
    frequency, shape = first_mode(system, speed)
    _, y = inputs_of(system, speed)
    tip = system.bodies[bodies[0]].markers["tip"].linear[0]
    size = tip @ shape[: len(tip)] * n_sub_bodies**2
    y[system.n_q : 2 * system.n_q] = 1e-3 * frequency * LENGTH / size * shape
    motions = {"spin": lambda t: (speed * t, speed, 0.0)} if system.n_servo else None
    step = 2.0 * np.pi / frequency / 300
    observed = observer_frame_from_system(system, beams, y, motions=motions, displacement=displacement)
    run = ObserverFrameIntegrator(observed, step)
    name, out = system.bodies[bodies[-1]].name, []
    for _ in range(round(10.75 * 300)):
        run.advance()
        out.append(run.position(name, "tip")[0])
    return crossing_frequency(out, step)


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


# ---- second-order displacements -------------------------------------------------------------------------------------
# With the second-order displacement ½ qᵀ H q the centrifugal tension of a rotating blade stiffens one body too, and the
# weight on a tower softens it (:mod:`wt_gym.multibody.observer_frame.frame`).

TABLE = {0.0: (3.5160, 3.5160), 2.0: (4.1373, 3.6218), 4.0: (5.5850, 3.8977), 8.0: (9.2568, 4.6571)}
"""ω √(m L⁴/EI) of the first flap and lag mode of a rotating cantilever without hub, by Ω √(m L⁴/EI)."""
ROTATING_SOURCE = "Wright, Smith, Thresher & Wang, J. Appl. Mech. 49, 1982; computed again from the beam's equation"


def rotating_frequency(eta, plane):
    """ω √(m L⁴/EI) of the first mode of a blade that a massive hub turns with Ω √(m L⁴/EI) = ``eta``.

    From upward zero crossings of its tip, along the axis of rotation ("flap") or across it ("lag").
    """
    about_x, about_y = (16.0 * EI, EI) if plane == "flap" else (EI, 16.0 * EI)
    sections = BeamSections.uniform(LENGTH, EA=1e8, EIx=about_x, EIy=about_y, GJ=1e6, mass=MASS, Ix=1e-7, Iy=1e-7)
    beam, unit = Beam(sections, 12), np.sqrt(MASS * LENGTH**4 / EI)
    body = Substructure.from_beam("blade", beam, "clamped", 8, displacement="second_order")
    across = np.array([1.0, 0.0, 0.0]) if plane == "flap" else np.array([0.0, 1.0, 0.0])
    rates, spin = np.zeros(body.n), np.array([eta / unit, 0.0, 0.0])
    moves = across @ body.places["tip"].field[:3]
    first = int(np.argmax(np.abs(moves) > 0.5 * np.abs(moves).max()))
    rates[first] = 1e-3 * LENGTH / unit / moves[first]
    system = ObserverFrameSystem()
    system.add(body, angular_velocity=spin, rates=rates)
    # points about the axis, so heavy that the blade does not slow them down
    ball = BeamSections.uniform(1.0, EA=1.0, EIx=1.0, EIy=1.0, GJ=1.0, mass=1e6, Ix=1e6, Iy=1e6)
    system.add(Substructure.from_beam("hub", Beam(ball, 1), n_modes=0), angular_velocity=spin)
    system.hinge("hub", "root", (1.0, 0.0, 0.0))
    system.weld("hub", "root", "blade", "root")
    expected = TABLE[eta][0 if plane == "flap" else 1] / unit
    step = 2.0 * np.pi / expected / 150
    run, out = ObserverFrameIntegrator(system, step), []
    for _ in range(round(20.75 * 150)):
        run.advance()
        out.append(run.displacement("blade", "tip")[:3] @ across)
    return crossing_frequency(out, step) * unit


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
    ROTATING_SOURCE,
    quick={"etas": (4.0,), "winds": ()},
)
def second_order(etas=tuple(TABLE), winds=(("nrel_5mw", 8.0), ("nrel_5mw", 11.4), ("iea_15mw", 10.5))) -> CaseResult:
    """Rotating-beam table, P-Δ of a tower in one body, tips of the turbine against the embedded form."""
    checks, lines = [], []
    for eta in etas:
        for k, plane in enumerate(("flap", "lag")):
            found = rotating_frequency(eta, plane)
            checks.append(Check(f"{plane} 1 at η = {eta:g}", TABLE[eta][k], found, 2e-3, source=ROTATING_SOURCE))
    known = first_mode(chain("tower", 1, linear=False)[0])[0]
    found = period("tower", 1, displacement="second_order")
    checks.append(Check("tower under 350 t in one body: first frequency", known, found, 2e-3, "rad/s",
                        source="the same body on joints, with second-order displacements"))  # fmt: skip
    base = FIDELITIES["training"]
    for name, wind in winds:
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


# ---- a whole turbine ------------------------------------------------------------------------------------------------
# Their blade under a follower load needs ten modes at a deflection of 0.15 of its length, three in free vibration. The
# blades of the IEA 15-MW turbine bend by 0.14 of their length near rated wind.

REDUCED_TURBINE, REDUCTION_WIND, REDUCTION_SEED, TURBULENCE_CLASS = "iea_15mw", 10.0, 1, "B"
REDUCTION_SKIP, REDUCTION_DURATION = 20.0, 120.0
"""Time before the sums begin, and whole time [s]."""
MODES = {3: (2, 1, 0), 5: (3, 2, 0), 10: (6, 4, 0), 16: (10, 6, 0)}
"""Modes of a blade in flap, edge and torsion, by their number."""
EXPONENT = 10.0


def turbulence(turbine):
    """Turbulent inflow of the study."""
    hub = turbine.tower.height + turbine.nacelle.tower_top_to_shaft
    box = TurbulenceBox.kaimal(REDUCTION_WIND, hub, turbine.rotor_diameter, TURBULENCE_CLASS, seed=REDUCTION_SEED)
    return TurbulentInflow(box, SteadyInflow(REDUCTION_WIND, hub, shear_exponent=0.14))


def centrifugal_stiffness(body, radius):
    """K of the stiffness K Ω² that rotation gives the first coordinate of a blade, in the units of its mass.

    The potential of the centrifugal force on the shortening ½ q² H_z is −Ω² ∫ (z + r) ½ q² H_z dm; ∫ z H_z dm is a
    quarter of j2_xx + j2_yy − j2_zz for shapes across z.

    ``body`` with second-order displacements; ``radius`` of the blade root [m].
    """
    j2 = body.inertia.j2[0, 0]
    return -(0.25 * (j2[0, 0] + j2[1, 1] - j2[2, 2]) + radius * body.inertia.c2[2, 0, 0])


def reduced_run(n_modes, formulation="observer", duration=REDUCTION_DURATION, **options):
    """Tip deflection and root moment of blade 1 with a number of modes, None for finite elements.

    Returns dict of "time" (n,) [s], "tip" (n,) [m] and "moment" (n,) [N m] flapwise, "length" of the blade [m], "cost"
    of an aerodynamic step [s], "speed" (n,) of the rotor [rad/s], the "blade" and the "radius" of its root [m].
    """
    turbine = load_turbine(REDUCED_TURBINE)
    chosen = (
        {"blade_modes": (1, 1, 0), "blade_coordinates": "nodal"} if n_modes is None else {"blade_modes": MODES[n_modes]}
    )
    if formulation == "observer":
        options = {"frame_displacement": "linear"} | options
    fidelity = replace(FIDELITIES["training"], blade_elements=ELEMENTS, formulation=formulation, **(chosen | options))
    simulator, rows = Simulator(turbine, turbulence(turbine), fidelity), []

    def note(signals):
        rows.append((signals.time, signals.tip_out_of_plane[0], signals.root_flap_moment[0], signals.rotor_speed))

    start = time.perf_counter()
    run_baseline(simulator, duration, on_step=note)
    wall = time.perf_counter() - start
    at, tip, moment, speed = np.array(rows).T
    return {
        "time": at, "tip": tip, "moment": moment, "speed": speed, "length": turbine.blade.length,
        "cost": wall * simulator.time_step / duration,
        "blade": simulator.structure.system.bodies[simulator.structure.blades[0]],
        "radius": turbine.hub.radius,
    }  # fmt: skip


def tip_and_moment(run):
    """Mean and largest tip deflection over the length, mean, largest and damage-equivalent root moment [MN m]."""
    kept = run["time"] > REDUCTION_SKIP
    tip, moment = run["tip"][kept] / run["length"], run["moment"][kept] / 1e6
    span = run["time"][kept][-1] - run["time"][kept][0]
    return np.array(
        [tip.mean(), tip.max(), moment.mean(), np.abs(moment).max(), damage_equivalent_load(moment, span, EXPONENT)]
    )


@case(
    "observer-turbine-reduction",
    "IEA 15-MW in turbulence, in local observer frames: 3, 5, 10 and 16 modes a blade against finite elements",
    "K. Holm-Jørgensen, S. R. K. Nielsen, R. Rubak, System reduction in nonlinear multibody dynamics of wind turbines",
    slow=True,
)
def reduction() -> CaseResult:
    """Tip deflection, root moment and its DEL over the number of modes; what sets them off from the embedded form."""
    runs = {f"{n} modes": reduced_run(n) for n in MODES}
    runs["finite elements"] = reduced_run(None)
    embedded = reduced_run(5, "embedded")
    others = {
        f"5 modes, {name}": reduced_run(5, reference_condition=name) for name in ("three_quarter", "simply_supported")
    }
    others["5 modes, second order"] = reduced_run(5, frame_displacement="second_order")
    others |= {"3 modes, embedded": reduced_run(3, "embedded"), "5 modes, embedded": embedded}
    table = {name: tip_and_moment(run) for name, run in (runs | others).items()}
    tip = np.array([table[name][0] for name in runs]) / table["finite elements"][0]
    body, speed = embedded["blade"], embedded["speed"][embedded["time"] > REDUCTION_SKIP]
    gain = centrifugal_stiffness(body, embedded["radius"]) / body.stiffness[0, 0] * np.mean(speed**2)
    paper = "3 and 5 modes fall short of finite elements, 10 do not (load in the deformed state, u/L = 0.15)"
    checks = [
        Check("u/L of the mean tip deflection, finite elements", "in [0.12, 0.18]", table["finite elements"][0],
              source="the paper's deflection, 0.15"),
        Check("mean tip deflection grows with the number of modes: least step", ">= 0", np.diff(tip).min(),
              source="more modes, a softer blade"),
        Check("mean tip deflection over that of finite elements, 3 modes", "<= 0.99", tip[0], source=paper),
        Check("the same with 10 modes", 1.0, tip[2], 0.005, source=paper),
        Check("5 modes, observer frame over embedded form: mean tip deflection less one", gain,
              table["5 modes"][0] / table["5 modes, embedded"][0] - 1.0, 0.15,
              source="K Ω²/ω₀² of the first flap mode: no geometric stiffness"),
        Check("the same with second-order displacements", table["5 modes, embedded"][0],
              table["5 modes, second order"][0], 0.02, source="embedded form"),
    ]  # fmt: skip
    lines = ["blade: mean and largest u/L, mean and largest root moment and its DEL [MN m], ms a step"]
    for name, run in (runs | others).items():
        mean, largest, moment, most, load = table[name]
        lines.append(
            f"{name}: {mean:.4f}, {largest:.4f}, {moment:.2f}, {most:.2f}, {load:.2f}, {1e3 * run['cost']:.1f}"
        )
    shown = [Curve(run["time"], run["tip"] / run["length"], name) for name, run in runs.items()]
    return CaseResult(checks, {"Tip of blade 1": Figure(tuple(shown), "time [s]", "u/L [-]")}, "\n".join(lines))
