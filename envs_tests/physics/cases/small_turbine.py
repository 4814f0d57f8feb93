"""The small turbine of Nada & Al-Shahrani: mixed coordinates in one model, and in the coupled simulation."""

from dataclasses import dataclass, replace

import numpy as np

from envs_tests.physics.cases.tools import body_pose, crossing_frequency
from envs_tests.physics.validation import CaseResult, Check, Curve, Figure, absolute, case
from wt_gym.multibody.integrators.schemes import HammingIntegrator
from wt_gym.multibody.system import Constraint, Joint, MultibodySystem
from wt_gym.simulation import FIDELITIES, Simulator
from wt_gym.structure.beam import Beam, BeamSections
from wt_gym.structure.flexible_body import FlexibleBody
from wt_gym.structure.modes import body_from_beam, circular_sections, clamped_modes
from wt_gym.turbines import load_turbine
from wt_gym.turbines.blade import inertia_matrix
from wt_gym.turbines.catalog import nada_data, nada_speed
from wt_gym.wind import SteadyInflow

# ---- mixed coordinates ----------------------------------------------------------------------------------------------
# Rigid nacelle and hub in Cartesian coordinates with Euler parameters, tied by constraint equations; blades in nodal
# coordinates with the geometric stiffness of their rotation; a tower of circular section in modal coordinates. The
# paper's numbers are not legible in the copies at hand: its statements become criteria on a stand-in rig of the same
# kind (``wt_gym/turbines/data/nada_small.json``). The air is a quasi-steady disc: thrust ½ρA V²C_T and torque
# ½ρAR V² (a − b λ) with the wind relative to the nacelle, V = 8 m/s − ẋ.

NADA = "Nada & Al-Shahrani 2019, Mech. Sci. 10, 35–46"
STEP = 5e-5


def rig():
    """Data of the stand-in rig, those of the turbine "nada_small"."""
    return nada_data()


def tower_beam(n_elements=6):
    """Finite elements of the circular tower."""
    tower = rig()["stand_in"]["tower"]
    sections = circular_sections(
        tower["length_m"],
        tower["diameter_m"],
        youngs_modulus=tower["youngs_modulus_Pa"],
        shear_modulus=tower["shear_modulus_Pa"],
        density=tower["density_kg_m3"],
    )
    return Beam(sections, n_elements)


def blade_beam(n_elements=3):
    """Finite elements of one blade: a tapered strip, x across its flat side."""
    blade, hub = rig()["stand_in"]["blade"], rig()["stand_in"]["hub"]
    length, t = blade["tip_radius_m"] - hub["radius_m"], blade["thickness_m"]
    s = np.array([0.0, length])
    stiffness, inertia = [], []
    for chord in (blade["chord_root_m"], blade["chord_tip_m"]):
        e, rho, area = blade["youngs_modulus_Pa"], blade["density_kg_m3"], chord * t
        flat, edge = chord * t**3 / 12.0, t * chord**3 / 12.0
        torsion = e / 2.6 * chord * t**3 / 3.0
        stiffness.append(np.diag([np.inf, np.inf, e * area, e * edge, e * flat, torsion]))
        inertia.append(inertia_matrix(rho * area, 0.0, 0.0, rho * edge, rho * flat, 0.0))
    axis = np.column_stack([0.0 * s, 0.0 * s, s])
    return Beam(BeamSections(s, np.array(stiffness), np.array(inertia), axis), n_elements)


@dataclass(frozen=True)
class SmallTurbine:
    """The assembled model: system, body indices, rotor inertia about the shaft [kg m²] and start state."""

    system: MultibodySystem
    nacelle: int
    hub: int
    rotor_inertia: float
    start: np.ndarray


def small_turbine(tower="modal", blades="nodal", reference="cartesian", speed=0.0, tower_elements=6) -> SmallTurbine:
    """Assemble the rig.

    ``tower``, ``blades``: "nodal" or "modal" or "rigid": coordinates of the flexible bodies; ``reference``: "cartesian"
    or "joint": nacelle and hub with Cartesian coordinates and Euler parameters, tied by a weld and a hinge (Lagrange
    multipliers), or carried by joints whose constraints are eliminated; ``speed``: rotor speed of the start state
    [rad/s]; ``tower_elements``: finite elements of the tower.
    """
    data = rig()["stand_in"]
    hub_data, blade_data = data["hub"], data["blade"]
    # bending across the flat side alone: bending in the plane of the strip is some twenty times stiffer
    body = body_from_beam(
        "blade", blade_beam(), blades, n_modes=3, dofs=(0, 4), damping_ratio=blade_data["damping_ratio"]
    )
    n_blades, blade_mass = blade_data["number"], body.inertia.mass
    nacelle_mass = data["nacelle_rotor_mass_kg"] - hub_data["mass_kg"] - n_blades * blade_mass
    top = np.zeros((6, 6))
    top[:3, :3] = data["nacelle_rotor_mass_kg"] * np.eye(3)
    tower_body = body_from_beam(
        "tower",
        tower_beam(tower_elements),
        tower,
        n_modes=6,
        dofs=(0, 1, 3, 4),
        tip_mass=top,
        damping_ratio=data["tower"]["damping_ratio"],
    )
    nacelle_inertia = nacelle_mass * data["nacelle_radius_of_gyration_m"] ** 2 * np.eye(3)
    nacelle_body = FlexibleBody.rigid("nacelle", nacelle_mass, np.zeros(3), nacelle_inertia)
    hub_inertia = 0.5 * hub_data["mass_kg"] * hub_data["radius_m"] ** 2
    hub_body = FlexibleBody.rigid("hub", hub_data["mass_kg"], np.zeros(3), hub_inertia * np.diag([1.0, 0.5, 0.5]))
    overhang = (-hub_data["overhang_m"], 0.0, 0.0)

    system = MultibodySystem(stabilization=200.0)
    foot = system.add(tower_body, Joint("fixed"))
    if reference == "cartesian":
        nacelle = system.add(nacelle_body, Joint("free", name="nacelle"))
        system.add_constraint(Constraint("weld", name="tower_top"), foot, nacelle, "tip", "origin")
        hub = system.add(hub_body, Joint("free", name="hub"))
        shaft = Constraint("hinge", axis=(1.0, 0.0, 0.0), offset=overhang, name="shaft")
        system.add_constraint(shaft, nacelle, hub, "origin", "origin")
    elif reference == "joint":
        nacelle = system.add(nacelle_body, Joint("fixed"), foot, "tip")
        hub = system.add(hub_body, Joint("revolute", (1.0, 0.0, 0.0), offset=overhang, name="azimuth"), nacelle)
    else:
        raise ValueError(f"reference coordinates are 'cartesian' or 'joint', got {reference!r}")
    twist = np.radians(0.25 * blade_data["twist_root_deg"] + 0.75 * blade_data["twist_tip_deg"])
    c, s = np.cos(twist), np.sin(twist)
    pitch = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])  # about −z
    for i in range(n_blades):
        angle = 2.0 * np.pi * i / n_blades
        turn = np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])
        offset = turn @ [0.0, 0.0, hub_data["radius_m"]]
        names = tuple(name.replace("blade", f"blade_{i + 1}", 1) for name in body.coordinate_names)
        blade = replace(body, name=f"blade_{i + 1}", coordinate_names=names)
        system.add(blade, Joint("fixed", rotation=turn @ pitch, offset=offset), hub)
    system.build()

    y = system.initial_state()
    if reference == "cartesian":
        height = data["tower"]["length_m"]
        for index, place in ((nacelle, [0.0, 0.0, height]), (hub, [*overhang[:2], height])):
            q = system.index(index, "joint_q")
            y[q : q + 3] = place
        y[system.n_q + system.index(hub, "joint_u") + 3] = speed
    else:
        y[system.n_q + system.index(hub, "joint_u")] = speed
    reach = hub_data["radius_m"]
    blade_inertia = body.inertia.j0[1, 1] + 2.0 * reach * body.inertia.c0[2] + blade_mass * reach**2
    return SmallTurbine(system, nacelle, hub, hub_inertia + n_blades * blade_inertia, y)


class Disc:
    """Quasi-steady thrust and torque of the rotor, and the generator, a linear damper that balances λ = 5 at 8 m/s."""

    def __init__(self):
        data = rig()["stand_in"]
        self.wind = rig()["published"]["test_wind_speed_m_s"]
        self.radius = data["blade"]["tip_radius_m"]
        self.pressure_area = 0.5 * data["air_density_kg_m3"] * np.pi * self.radius**2
        self.a = data["torque_coefficient_at_standstill"]
        self.b = self.a / data["runaway_tip_speed_ratio"]
        self.thrust_coefficient = data["thrust_coefficient"]
        self.speed = data["tip_speed_ratio"] * self.wind / self.radius
        self.damper = self.torque(self.wind, self.speed) / self.speed

    def torque(self, wind, speed):
        """Aerodynamic torque [N m]."""
        return self.pressure_area * self.radius * wind * (self.a * wind - self.b * speed * self.radius)

    def thrust(self, wind):
        """Thrust [N]."""
        return self.pressure_area * self.thrust_coefficient * wind**2

    def slopes(self):
        """∂Q/∂V and −∂(Q − Q_gen)/∂Ω at the operating point."""
        to_wind = self.pressure_area * self.radius * (2.0 * self.a * self.wind - self.b * self.speed * self.radius)
        return to_wind, self.pressure_area * self.radius**2 * self.wind * self.b + self.damper


def simulate(model, duration, step=STEP, every=20):
    """Time (n,), nacelle displacement (n, 3) and rotor speed (n,) after the wind of 8 m/s is switched on."""
    disc, system = Disc(), model.system
    integrator = HammingIntegrator(system, step)
    integrator.start(model.start)
    home = body_pose(system, model.start, model.nacelle)[0]
    times, where, speeds = [], [], []
    n_q, previous = system.n_q, home
    # turning about x, relative to the nacelle: its own rocking is part of the absolute rate of a free hub
    first, rocking = n_q + system.index(model.hub, "joint_u"), None
    if system.joints[model.hub].kind == "free":
        first, rocking = first + 3, n_q + system.index(model.nacelle, "joint_u") + 3
    loads = integrator.inputs.body_loads
    for k in range(round(duration / (step * every)) + 1):
        y = integrator.state
        place, turn = body_pose(system, y, model.nacelle)
        speed = float(y[first] - (0.0 if rocking is None else y[rocking]))
        times.append(k * step * every)
        where.append(place - home)
        speeds.append(speed)
        velocity = (place - previous) / (step * every)
        previous = place
        wind = disc.wind - float(turn[:, 0] @ velocity)
        generator = disc.damper * speed
        loads[:, model.hub, 0] = disc.thrust(wind)
        loads[:, model.hub, 3] = disc.torque(wind, speed) - generator
        loads[:, model.nacelle, 3] = generator
        integrator.advance(every)
    return np.array(times), np.array(where), np.array(speeds), integrator


def oscillation(times, signal, frequency, start):
    """Complex amplitude of a signal at a frequency [Hz] after a start time, trend removed, Hann window."""
    late = times >= start
    t, s = times[late], signal[late]
    s = s - np.polyval(np.polyfit(t - t[0], s, 3), t - t[0])
    window = np.hanning(len(t))
    return 2.0 * np.sum(window * s * np.exp(-2j * np.pi * frequency * t)) / window.sum()


def mean_frequency(times, signal):
    """Mean frequency [Hz] of a signal about its mean."""
    return crossing_frequency(signal - signal.mean(), times[1] - times[0]) / (2.0 * np.pi)


@case(
    "mixed-coordinates",
    "Small turbine with modal tower, nodal blades, Cartesian nacelle and rotor",
    NADA,
    quick={"short": 0.05, "long": 0.05},
)
def mixed_coordinates(short=0.3, long=1.2) -> CaseResult:
    """Tower frequencies, equivalence of the coordinate sets, and the effect of the tower on rotor speed and nacelle."""
    data, disc = rig(), Disc()
    checks, figures = [], {}
    beam = tower_beam(16)
    mass = np.zeros((6, 6))
    mass[:3, :3] = data["stand_in"]["nacelle_rotor_mass_kg"] * np.eye(3)
    for name, tip, expected in (
        ("bare tower", None, data["computed"]["bare_tower_bending_Hz"]),
        ("tower with a point mass on top", mass, data["computed"]["tower_with_top_mass_Hz"]),
    ):
        found = clamped_modes(beam, 3, tip_mass=tip, node_dofs=(0, 4)).frequency
        source = "Euler–Bernoulli rod, computed independently"
        checks += [
            Check(f"{name}, bending mode {i + 1}", expected[i], found[i], 0.005, "Hz", source=source) for i in range(3)
        ]

    mixed = small_turbine(speed=disc.speed)
    times, nacelle, speed, integrator = simulate(mixed, long)
    position_error, _ = mixed.system.constraint_residuals(integrator.state)
    checks.append(
        Check(f"constraint drift after {long:g} s ({25 * long:.0f} turns)", 0.0, np.abs(position_error).max(),
              absolute(1e-6), "m, rad")
    )  # fmt: skip

    # the same machine with its constraints eliminated, and with other coordinates
    early = times <= short + 1e-9
    joint = simulate(small_turbine(reference="joint", speed=disc.speed), short)
    size = np.abs(nacelle[early, 0]).max()
    difference = np.abs(joint[1][:, 0] - nacelle[early, 0]).max() / size
    source = (
        f"the same equations of motion in other coordinates; largest difference in {short:g} s per largest displacement"
    )
    name = "nacelle displacement: Cartesian with multipliers against eliminated constraints"
    checks.append(Check(name, 0.0, difference, absolute(1e-4), "", source=source))
    modal = simulate(small_turbine(reference="joint", blades="modal", speed=disc.speed), short)
    difference = np.abs(modal[1][:, 0] - joint[1][:, 0]).max() / size
    checks.append(
        Check("nacelle displacement: modal against nodal blades", 0.0, difference, absolute(0.01), "", source=source)
    )
    in_nodes = small_turbine(reference="joint", tower="nodal", speed=disc.speed, tower_elements=3)
    nodal = simulate(in_nodes, short, STEP / 2.0, 40)
    difference = np.abs(nodal[1][:, 0] - joint[1][:, 0]).max() / size
    checks.append(
        Check("nacelle displacement: nodal against modal tower", 0.0, difference, absolute(0.01), "", source=source)
    )

    if long <= short:
        return CaseResult(checks)
    # effect of the tower: the nacelle swings about F L³/3EI, and the rotor speed ripples at the tower's frequency
    tower = data["stand_in"]["tower"]
    stiffness = 3.0 * tower["youngs_modulus_Pa"] * np.pi * tower["diameter_m"] ** 4 / 64.0 / tower["length_m"] ** 3
    late = times > 0.2
    _, stiff_blades, speed_stiff, _ = simulate(small_turbine(blades="rigid", speed=disc.speed), long)
    _, _, rigid_speed, _ = simulate(small_turbine(tower="rigid", speed=disc.speed), long)
    frequency = mean_frequency(times[late], stiff_blades[late, 0])
    point_mass = data["computed"]["tower_with_top_mass_Hz"][0]
    lean = float(nacelle[late, 0].mean())
    near = "beam theory with a point mass; weight, lever and rotor inertia change it by some percent"
    checks += [
        Check("mean nacelle displacement, F L³/3EI", disc.thrust(disc.wind) / stiffness, lean, 0.05, "m", source=near),
        Check("frequency of the nacelle's motion with rigid blades", point_mass, frequency, 0.05, "Hz", source=near),
    ]
    to_wind, to_speed = disc.slopes()
    swing, ripple = (abs(oscillation(times, s, frequency, 0.2)) for s in (stiff_blades[:, 0], speed_stiff))
    circular = 2.0 * np.pi * frequency
    expected = to_wind * circular / np.hypot(mixed.rotor_inertia * circular, to_speed)
    still, moved = (abs(oscillation(times, s, frequency, 0.2)) for s in (rigid_speed, speed))
    linear, balance = "J Ω̇ = (∂Q/∂V)(−ẋ) − k Ω, linear", "balance of aerodynamic and generator torque"
    affects = "the tower affects the rotor speed: ripple at the tower's frequency, flexible per rigid tower"
    mean = float(speed[late].mean() / disc.speed)
    checks += [
        Check("rotor-speed ripple per nacelle swing, rigid blades", expected, ripple / swing, 0.05, "1/(m s)",
              source=linear),
        Check(affects, ">= 10", moved / max(still, 1e-12), source=NADA),
        Check("mean rotor speed per design speed", 1.0, mean, 0.01, source=balance),
    ]  # fmt: skip
    figures["nacelle displacement downwind"] = Figure((Curve(times, 1e3 * nacelle[:, 0]),), "t [s]", "mm")
    figures["rotor speed"] = Figure(
        (Curve(times, speed, "flexible tower"), Curve(times, rigid_speed, "rigid tower", "--")), "t [s]", "rad/s"
    )
    notes = (
        "The regressive flap mode (32.7 − 25.5 = 7.2 Hz seen from the ground) meets the first tower mode: with "
        "flexible blades the nacelle swings at 6.4 and 8.3 Hz and beats. The two checks against linear theory use "
        "rigid blades."
    )
    return CaseResult(checks, figures, notes)


@case("nodal-geometric-stiffness", "Blades of the small turbine at high speed: geometric stiffness", NADA)
def nodal_geometric_stiffness() -> CaseResult:
    """The statement 'geometric stiffness cannot be ignored': the frequency of a blade with it against the spin alone.

    Southwell with the exact coefficients would be for a uniform blade; here the criterion is the frequency per turn: a
    flap frequency above once per turn is possible only with geometric stiffness, because a slender strip on a shaft at
    infinite speed becomes a string, whose first flap frequency is at least the speed itself.
    """
    disc, beam = Disc(), blade_beam(6)
    hub = rig()["stand_in"]["hub"]["radius_m"]
    still = clamped_modes(beam, 1, node_dofs=(0, 4)).frequency[0]
    spinning = clamped_modes(beam, 1, spin=disc.speed, center=(0.0, 0.0, -hub), node_dofs=(0, 4)).frequency[0]
    per_turn = disc.speed / (2.0 * np.pi)
    notes = f"at rest {still:.2f} Hz, at {per_turn:.1f} turns/s {spinning:.2f} Hz"
    return CaseResult([Check("first flap frequency per turn of the rotor", ">= 1", spinning / per_turn, unit="",
                             source=NADA),
                       Check("increase of the first flap frequency by rotation", ">= 2", spinning / still, unit="",
                             source=NADA)], notes=notes)  # fmt: skip


# ---- coupled simulation ---------------------------------------------------------------------------------------------
# Modal tower and nodal blades whose frames carry Euler parameters (fidelity "mixed"), in the wake of the vortex
# lattice. The wind is turned up from 7 to 8 m/s: the nacelle swings and the rotor spins up.

BEFORE, SLOW = 7.0, 150.0
"""Wind [m/s] and rotor speed [rad/s] at the start: slower, the plates of the blades stall in 8 m/s."""
DURATION = 0.8
"""Six periods of the tower, twenty turns of the rotor [s]."""


def coupled_run(duration=DURATION, before=BEFORE, start=SLOW, **changes):
    """Time [s], nacelle displacement downwind [m], rotor speed [rad/s], thrust [N] and the simulator."""
    turbine, wind = load_turbine("nada_small"), rig()["published"]["test_wind_speed_m_s"]
    fidelity = replace(FIDELITIES["mixed"], **changes)
    simulator = Simulator(turbine, SteadyInflow(before, turbine.hub_height, 0.0), fidelity, generator="damper")
    simulator.reset(rotor_speed=start)
    simulator.inflow = SteadyInflow(wind, turbine.hub_height, 0.0)
    rows = []
    for _ in range(round(duration / simulator.time_step)):
        signals = simulator.advance(simulator.time_step, pitch=0.0)
        rows.append([simulator.time, *(signals[k] for k in ("tower_top_fore_aft", "rotor_speed", "aero_thrust"))])
    return (*np.array(rows).T, simulator)


def spin_up(run):
    """Mean speed [rad/s] and acceleration [rad/s²] of a run after the first 0.2 s."""
    late = run[0] > 0.2
    slope, _ = np.polyfit(run[0][late], run[2][late], 1)
    return float(run[2][late].mean()), float(slope)


def differences(one, other):
    """Largest differences of nacelle displacement and rotor speed over the largest changes of the first run."""
    n = min(len(one[0]), len(other[0]))
    return [float(np.abs(one[k][:n] - other[k][:n]).max() / np.ptp(one[k][:n])) for k in (1, 2)]


@case("nada-small-turbine", "Small turbine, mixed coordinates in the coupled simulation", NADA, slow=True)
def nada_small_turbine() -> CaseResult:
    """Nacelle, rotor speed with and without a flexible tower, and other coordinates for the same turbine."""
    data, design = rig(), nada_speed()
    times, nacelle, speed, thrust, simulator = mixed = coupled_run()
    _, _, stiff_speed, _, _ = coupled_run(tower_coordinates="rigid")
    residual, _ = simulator.structure.system.constraint_residuals(simulator.coupling.integrator.state)
    tower = data["stand_in"]["tower"]
    bending = 3.0 * tower["youngs_modulus_Pa"] * np.pi * tower["diameter_m"] ** 4 / 64.0 / tower["length_m"] ** 3
    swing = nacelle - np.polyval(np.polyfit(times, nacelle, 2), times)
    frequency = mean_frequency(times, swing)
    point_mass = data["computed"]["tower_with_top_mass_Hz"][0]
    near = "beam theory with a point mass; weight, lever and rotor inertia change it by some percent"
    last = times > times[-1] - 2.0 / point_mass
    start = 0.05
    still, moved = (abs(oscillation(times, s, frequency, start)) for s in (stiff_speed, speed))
    small = "small deformations of the tower, which modal coordinates describe"
    reduced = "a reduced set of modes stands for the nodes of the tower; over the range of the motion"
    checks = [
        Check("constraint equations at the end", 0.0, np.abs(residual).max(), absolute(1e-6), "m, rad"),
        Check("frequency of the nacelle", point_mass, frequency, 0.05, "Hz", source=near),
        Check("nacelle over thrust L³/3EI, the last two swings", 1.0,
              nacelle[last].mean() * bending / thrust[last].mean(), 0.05, "", source="Euler–Bernoulli cantilever"),
        Check("largest nacelle displacement over the length of the tower", "<= 0.03",
              np.abs(nacelle).max() / tower["length_m"], unit="", source=f"{NADA}: {small}"),
        Check("the tower affects the rotor speed: ripple at its frequency, flexible per rigid tower", ">= 2",
              moved / max(still, 1e-12), unit="", source=NADA),
        Check("the tower changes the rotor speed: largest difference over the gain in speed", ">= 0.001",
              np.abs(speed - stiff_speed).max() / np.ptp(stiff_speed), unit="", source=NADA),
    ]  # fmt: skip
    for name, changes in (
        ("nodal tower of four elements", {"tower_coordinates": "nodal", "tower_elements": 4}),
        ("one tower mode in each plane", {"tower_modes": (1, 1, 0)}),
        ("joints in place of the constraint equations", {"formulation": "embedded"}),
    ):
        limit = 1e-3 if "formulation" in changes else 0.02
        for what, error in zip(
            ("nacelle", "rotor speed"), differences(mixed, coupled_run(0.3, **changes)), strict=True
        ):
            checks.append(Check(f"{name}: {what}", 0.0, error, absolute(limit), "", source=f"{NADA}: {reduced}"))
    test = data["published"]["test_wind_speed_m_s"]
    slow, fast = (spin_up(coupled_run(0.5, test, w, tower_coordinates="rigid")) for w in (SLOW, design))
    steady = fast[0] - fast[1] * (fast[0] - slow[0]) / (fast[1] - slow[1])
    meets = "stand-in of the test: the damper meets the air at λ = 5; of a line through accelerations at two speeds"
    checks.append(Check("steady rotor speed at 8 m/s", design, steady, 0.03, "rad/s", source=meets))
    figures = {
        "nacelle displacement downwind": Figure((Curve(times, 1e3 * nacelle),), "t [s]", "mm"),
        "rotor speed": Figure(
            (Curve(times, speed, "flexible tower"), Curve(times, stiff_speed, "rigid tower", "--")), "t [s]", "rad/s"
        ),
    }
    notes = (
        f"nacelle {1e3 * nacelle.min():.2f} to {1e3 * nacelle.max():.2f} mm; rotor from {speed[0]:.1f} to "
        f"{speed[-1]:.2f} rad/s, {stiff_speed[-1]:.2f} with a rigid tower; ripple {moved:.3g} against {still:.3g} "
        "rad/s."
    )
    return CaseResult(checks, figures, notes)
