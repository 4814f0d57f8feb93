"""Closed bodies of source panels against exact potential flows: sphere, spheroid, cylinder, wall, and a tower."""

import numpy as np
from scipy.integrate import quad

from envs_tests.physics.cases.airfoils import UniformStream
from envs_tests.physics.validation import CaseResult, Check, Curve, Figure, absolute, case
from wt_gym.aerodynamics import AeroOptions, VortexLattice
from wt_gym.aerodynamics.bodies.body_set import (
    BodySet,
    BodySurface,
    TowerFlow,
    ellipsoid_body,
    revolution_body,
    tower_body,
    tower_perturbation,
)
from wt_gym.simulation.models import blade_planform
from wt_gym.turbines import load_turbine

LAMB = "Lamb 1932, Hydrodynamics, §§ 92, 114–115"
KATZ = "Katz & Plotkin 2001, Low-Speed Aerodynamics, sections 3.11 and 10.4"


def stream_strengths(bodies, stream):
    """Strengths of a set of bodies in a uniform stream."""
    return bodies.strengths(np.tile(stream, (bodies.n_panels, 1)))


def surface_speed(bodies, strengths, stream):
    """Tangential speed at the control points, shape (n_panel,)."""
    v = bodies.velocity(bodies.control_points, strengths) + stream
    return np.linalg.norm(v - np.einsum("pi,pi->p", v, bodies.arrays.normal)[:, None] * bodies.arrays.normal, axis=1)


def dipole(bodies, strengths):
    """First moment of the sources, (volume + added mass / density) times the stream with opposite sign [m^4/s]."""
    return (strengths * bodies.area) @ bodies.control_points


def speed_factor(bodies, strengths, stream, chosen=slice(None)):
    """Factor k in the surface speed k V sin θ that fits the control points best, θ from the stagnation point."""
    direction = stream / np.linalg.norm(stream)
    outward = bodies.arrays.normal[chosen]
    sine = np.sqrt(1.0 - np.square(outward @ direction))
    speed = surface_speed(bodies, strengths, stream)[chosen] / np.linalg.norm(stream)
    return float(speed @ sine / (sine @ sine))


def order(values, exact):
    """Observed order of convergence of the last two of values with twice as many panels each time."""
    return float(np.log2(abs(values[-2] - exact) / abs(values[-1] - exact)))


@case("body-sphere", "Sphere in a stream: surface speed 3/2 V sin θ, flow around, convergence", LAMB)
def sphere() -> CaseResult:
    """Meshes of n x n panels whose poles lie across the stream, n = 8, 16, 32."""
    stream, sizes = np.array([0.0, 0.0, 1.0]), (8, 16, 32)
    speed, moment, ahead, curves = [], [], [], []
    for n in sizes:
        bodies = BodySet([ellipsoid_body((1.0, 1.0, 1.0), n, n)])
        s = stream_strengths(bodies, stream)
        speed.append(speed_factor(bodies, s, stream))
        moment.append(-dipole(bodies, s)[2] / (2.0 * np.pi))
        around = bodies.velocity([[0.0, 0.0, -1.5], [0.0, 1.5, 0.0]], s)[:, 2] * 1.5**3
        ahead.append(around)
        angle = np.arccos(np.clip(bodies.arrays.normal @ stream, -1.0, 1.0))
        curves.append(Curve(np.degrees(angle), surface_speed(bodies, s, stream), f"{n} x {n} panels", "."))
    theta = np.linspace(0.0, np.pi, 91)
    net = abs(s @ bodies.area)
    checks = [
        Check("surface speed / (V sin θ), extrapolated with the first order", 1.5, 2.0 * speed[2] - speed[1], 0.005),
        Check("surface speed / (V sin θ), 32 x 32 panels", 1.5, speed[2], 0.03),
        Check("dipole moment / (2 π a³ V), 32 x 32 panels", 1.0, moment[2], 0.002),
        Check("order of convergence of the dipole moment", ">= 1.8", order(moment, 1.0)),
        Check("velocity half a radius ahead × (r/a)³ / V, 32 x 32 panels", -1.0, ahead[2][0], 0.005),
        Check("velocity half a radius beside × (r/a)³ / V, 32 x 32 panels", 0.5, ahead[2][1], 0.005),
        Check("net source / (V a²)", 0.0, net, 1e-12),
    ]
    curves.append(Curve(np.degrees(theta), 1.5 * np.sin(theta), "exact"))
    figure = Figure(tuple(curves), "angle from the stagnation point [deg]", "surface speed / V")
    notes = (
        "The flow around converges with the second order. The speed at the control points themselves converges with "
        "the first: a panel of constant strength lacks the tangential velocity of its own strength gradient."
    )
    return CaseResult(checks, {"surface speed of a sphere": figure}, notes)


def spheroid_integrals(long, short, x=None):
    """Lamb's α (along) and β (across) of a prolate spheroid, at the confocal surface through x; of itself for None."""
    lam = 0.0
    if x is not None:
        r2 = x[1] ** 2 + x[2] ** 2
        half = 0.5 * (x[0] ** 2 + r2 - long**2 - short**2)
        lam = half + np.sqrt(half**2 + (x[0] * short) ** 2 + r2 * long**2 - (long * short) ** 2)

    def integral(axis):
        def f(u):
            return 1.0 / ((axis**2 + u) * np.sqrt(long**2 + u) * (short**2 + u))

        return long * short**2 * quad(f, lam, np.inf, epsabs=1e-13, epsrel=1e-11)[0]

    return np.array([integral(long), integral(short), integral(short)])


@case("body-spheroid", "Prolate spheroid 4:1: added mass, moment of Munk, flow around at an angle", LAMB)
def spheroid() -> CaseResult:
    """Against closed forms; Lamb's table gives k1 = 0.082 and k2 = 0.860 for this slenderness."""
    long, short, sizes = 4.0, 1.0, (12, 24)
    own = spheroid_integrals(long, short)
    k = own / (2.0 - own)
    volume = 4.0 / 3.0 * np.pi * long * short**2
    angle = np.radians(30.0)
    stream = np.array([np.cos(angle), 0.0, np.sin(angle)])
    moments, errors = [], []
    points = [[-4.5, 0.3, 0.2], [-3.0, 0.4, -1.3], [0.0, 1.6, 0.0], [0.5, 0.2, -1.6], [1.0, -1.2, 1.2], [4.6, 0.0, 0.7]]

    def potential(x):
        return float(x * stream @ (spheroid_integrals(long, short, x) / (2.0 - own)))

    h = 1e-3
    exact = [[(potential(x + d) - potential(x - d)) / (2.0 * h) for d in h * np.eye(3)] for x in np.array(points)]
    for n in sizes:
        bodies = BodySet([ellipsoid_body((long, short, short), n, 2 * n)])
        s = stream_strengths(bodies, stream)
        moments.append(-dipole(bodies, s) / volume / np.where(stream == 0.0, 1.0, stream))
        errors.append(np.abs(bodies.velocity(points, s) - exact).max())
    d = dipole(bodies, s)
    # Lagally: sources in a stream feel the moment -ρ Σ x × V s A
    munk = float(np.cross(-d, stream)[1])
    expected = volume * (k[2] - k[0]) * np.sin(angle) * np.cos(angle)
    checks = [
        Check("k1 of the closed form", 0.082, k[0], absolute(0.0005), source="Lamb, table of § 115"),
        Check("k2 of the closed form", 0.860, k[2], absolute(0.0005), source="Lamb, table of § 115"),
        Check("1 + k1 (along)", 1.0 + k[0], moments[1][0], 0.01, source=LAMB),
        Check("1 + k2 (across)", 1.0 + k[2], moments[1][2], 0.01, source=LAMB),
        Check("order of convergence of 1 + k2", ">= 1.8", order([m[2] for m in moments], 1.0 + k[2])),
        Check(
            "moment / (ρ V² m³) at 30°", expected, munk, 0.02, source="Munk 1924, NACA TR 184: ρ V² (k2 − k1) sin 2α/2"
        ),
        Check("largest velocity error at six points 0.5 m off / V", 0.0, errors[1], 0.01),
    ]
    return CaseResult(checks, notes=f"Largest velocity error with 12 panels around: {errors[0]:.2g}.")


@case("body-no-force", "Pear in an oblique stream: no net source, no force (d'Alembert)", LAMB)
def no_force() -> list[Check]:
    """Body of revolution without symmetry fore and aft, widest radius about 1 m, length 4 m, stream at 30°."""
    stream, sizes, forces = np.array([np.cos(np.pi / 6.0), 0.0, 0.5]), (16, 32), []
    for n in sizes:
        angle = np.linspace(np.pi, 0.0, n + 1)
        radii = np.sin(angle) * (1.0 + 0.35 * np.cos(angle))
        radii[[0, -1]] = 0.0
        bodies = BodySet([revolution_body(2.0 * np.cos(angle), radii, n, axis=(1.0, 0.0, 0.0))])
        s = stream_strengths(bodies, stream)
        pressure = 1.0 - surface_speed(bodies, s, stream) ** 2
        forces.append(-(pressure * bodies.area) @ bodies.arrays.normal / np.pi)
    extrapolated = np.linalg.norm(2.0 * forces[1] - forces[0])
    return [
        Check("net source / (V m²)", 0.0, abs(float(s @ bodies.area)), 1e-12),
        Check("force of the pressure / (½ ρ V² π m²), extrapolated", 0.0, float(extrapolated), 0.005),
        Check("ratio of that force with 32 and 16 panels", 0.5, np.divide(*np.linalg.norm(forces[::-1], axis=1)), 0.05,
              source="first order of the speed at the surface"),
    ]  # fmt: skip


@case("body-cylinder", "Long cylinder in cross flow: deficit a²/r², flow around, surface speed 2 V sin θ", KATZ)
def cylinder() -> list[Check]:
    """Cylinder 120 radii long, at its middle, where its ends count for less than 0.2 %."""
    stream, length, sizes = np.array([1.0, 0.0, 0.0]), 120.0, (12, 24)
    speed, ahead = [], []
    for n in sizes:
        bodies = BodySet([tower_body([0.0, length], [2.0, 2.0], (0, 0, 0), (0, 0, length), n, 25)])
        s = stream_strengths(bodies, stream)
        middle = np.abs(bodies.control_points[:, 2] - 0.5 * length) < 1.0
        speed.append(speed_factor(bodies, s, stream, middle))
        radii = np.array([1.5, 2.0, 3.0])
        points = np.column_stack([-radii, 0.0 * radii, 0.0 * radii + 0.5 * length])
        ahead.append(bodies.velocity(points, s)[:, 0] * radii**2)
    angle = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)
    ring = np.concatenate([r * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle]) for r in (1.5, 2.0, 3.0)])
    ring[:, 2] = 0.5 * length
    wind = np.tile(stream, (len(ring), 1))
    formula = tower_perturbation(ring, wind, (0, 0, 0), (0, 0, length), [0.0, length], [2.0, 2.0])
    difference = np.abs(bodies.velocity(ring, s) - formula).max()
    checks = [
        Check(f"velocity ahead × (r/a)² / V, r = {r:g} a, {n} panels around", -1.0, v, tolerance)
        for n, values, tolerance in zip(sizes, ahead, (0.02, 0.01), strict=True)
        for r, v in zip(radii, values, strict=True)
    ]
    checks += [
        Check("difference to the doublet formula for towers, r = 1.5 … 3 a / V", 0.0, difference, 0.01),
        Check("surface speed / (V sin θ), extrapolated with the first order", 2.0, 2.0 * speed[1] - speed[0], 0.01),
        Check("net source / (V a²)", 0.0, abs(float(s @ bodies.area)), 1e-10),
    ]
    return checks


def ring_velocity(corners, points):
    """Velocity of a vortex ring of unit circulation at points (n, 3), from its straight segments."""
    total = np.zeros_like(points)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        a, b = points - start, points - end
        ra, rb = np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1)
        factor = (ra + rb) / (4.0 * np.pi * ra * rb * (ra * rb + np.einsum("ni,ni->n", a, b)))
        total += factor[:, None] * np.cross(a, b)
    return total


def box_body(edges):
    """Box of panels between the coordinates ``edges`` (three increasing arrays)."""
    vertices: list[list[float]] = []
    quads: list[list[int]] = []
    known: dict[tuple[int, ...], int] = {}

    def vertex(index):
        if index not in known:
            known[index] = len(vertices)
            vertices.append([edges[c][index[c]] for c in range(3)])
        return known[index]

    for c in range(3):
        i, j = (c + 1) % 3, (c + 2) % 3
        for side in (0, len(edges[c]) - 1):
            for m in range(len(edges[i]) - 1):
                for n in range(len(edges[j]) - 1):
                    corners = [(m, n), (m + 1, n), (m + 1, n + 1), (m, n + 1)]
                    index = []
                    for a, b in corners if side else corners[::-1]:
                        place = [0, 0, 0]
                        place[c], place[i], place[j] = side, a, b
                        index.append(vertex(tuple(place)))
                    quads.append(index)
    return BodySurface(np.array(vertices), np.array(quads), name="box")


@case("body-wall", "A vortex ring before a wall: box of panels against the mirror image; bodies over a ground", KATZ)
def wall() -> list[Check]:
    """The ring, 1 m square and tilted by 20°, stands 1 m over the middle of a box of 16 m × 16 m × 6 m."""
    tilt, height = np.radians(20.0), 1.0
    flat = np.array([[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.5, 0.0], [-0.5, 0.5, 0.0]])
    turn = np.array([[np.cos(tilt), 0.0, np.sin(tilt)], [0.0, 1.0, 0.0], [-np.sin(tilt), 0.0, np.cos(tilt)]])
    corners = flat @ turn.T + [0.0, 0.0, height]
    inner = np.linspace(-2.0, 2.0, 13)
    across = np.concatenate([[-8.0, -5.5, -4.0, -2.8], inner, [2.8, 4.0, 5.5, 8.0]])
    box = BodySet([box_body([across, across, np.array([-6.0, -3.0, -1.0, 0.0])])])
    s = box.strengths(ring_velocity(corners, box.control_points))
    points = np.array([[0.0, 0.0, 1.0], [0.3, 0.0, 0.7], [-0.6, 0.4, 1.3], [0.0, 0.8, 0.6]])
    image = -ring_velocity(corners * [1.0, 1.0, -1.0], points)
    size = np.linalg.norm(image, axis=1).max()
    error = float(np.abs(box.velocity(points, s) - image).max() / size)
    # a body over the ground against the body and its mirror image as two bodies
    above = ellipsoid_body((2.0, 1.0, 1.0), 12, 16, (0.0, 0.0, 1.5))
    below = ellipsoid_body((2.0, 1.0, 1.0), 12, 16, (0.0, 0.0, -1.5), "image")
    stream = np.array([1.0, 0.4, 0.0])
    single, pair = BodySet([above], ground=0.0), BodySet([above, below])
    field = np.array([[-3.0, 0.5, 0.8], [0.4, 1.5, 2.0], [3.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    one = single.velocity(field, stream_strengths(single, stream))
    two = pair.velocity(field, stream_strengths(pair, stream))
    difference = float(np.abs(one - two).max())
    return [
        Check("velocity of the box against the mirror image, largest error / largest value", 0.0, error, 0.02),
        Check("ground by images against a second body, largest difference / V", 0.0, difference, 2e-3),
        Check("velocity through the ground / V", 0.0, np.abs(one[2:, 2]).max(), 1e-12),
    ]


def _rotor(planform, center, azimuth, speed):
    """Nodes of three rigid blades and their velocities for a rotor that turns about x."""
    turned = []
    for k in range(3):
        c, s = np.cos(azimuth + 2.0 * np.pi * k / 3.0), np.sin(azimuth + 2.0 * np.pi * k / 3.0)
        turned.append(planform.nodes @ np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]).T)
    nodes = np.array(turned)
    return nodes + center, np.cross([speed, 0.0, 0.0], nodes)


@case("body-tower-passage", "NREL 5-MW blade passing its tower: closed body against the flow past a cylinder", KATZ)
def tower_passage() -> CaseResult:
    """Circulation of the blade's strips with the wind disturbed by either model, 8 m/s, 9.15 rpm, steps of 3°."""
    turbine = load_turbine("nrel_5mw")
    tower, speed, rotor_speed, step = turbine.tower, 8.0, 9.15 * np.pi / 30.0, np.radians(3.0)
    base = np.array([0.0, 0.0, tower.base_height])
    top = np.array([0.0, 0.0, tower.height])
    stream = np.array([speed, 0.0, 0.0])
    length = tower.height - tower.base_height
    body = tower_body(tower.diameter_station, tower.diameter, base, top, 16, 16, ground=tower.base_height)
    bodies = BodySet([body], ground=tower.base_height)
    s = stream_strengths(bodies, stream)
    flow = TowerFlow(base, tower.diameter_station, tower.diameter)

    def past_cylinder(nodes, wind):
        flow.add(nodes, wind, top)
        return wind

    models = {
        "no tower": lambda nodes, wind: wind,
        "cylinder": past_cylinder,
        "body": lambda nodes, wind: wind + bodies.velocity(nodes, s),
    }
    options = AeroOptions(n_chord=2, n_span=12, wake_rows=60, full_rows=60, fresh_rows=3, refresh_stride=6)
    planform = blade_planform(turbine, options)
    # without tilt, cone and prebend, so that both models are compared at equal distances
    center = np.array([-turbine.nacelle.overhang, 0.0, turbine.hub_height])
    azimuth = np.radians(135.0) + step * np.arange(31)
    found = {}
    for name, disturb in models.items():
        solver = VortexLattice(planform, 3, options, turbine.air_density)
        state, inflow, dt = solver.new_state(), UniformStream(stream), step / rotor_speed
        nodes, velocities = _rotor(planform, center, azimuth[0], rotor_speed)
        wind = disturb(nodes, np.tile(stream, (*nodes.shape[:3], 1)))
        solver.initialize_helix(state, nodes, velocities, wind, center, [1.0, 0.0, 0.0], rotor_speed, dt)
        found[name] = [state.circulation[0].copy()]
        for k, angle in enumerate(azimuth[1:]):
            solver.convect_wake(state, inflow, k * dt, dt)
            nodes, velocities = _rotor(planform, center, angle, rotor_speed)
            solver.solve(state, nodes, velocities, disturb(nodes, np.tile(stream, (*nodes.shape[:3], 1))), dt)
            solver.accept(state)
            found[name].append(state.circulation[0].copy())
    change = {name: np.array(g) / np.array(found["no tower"]) - 1.0 for name, g in found.items()}
    middle = 0.5 * (planform.span_edges[1:] + planform.span_edges[:-1]) + turbine.hub.radius
    checks, curves = [], []
    for j in np.searchsorted(middle, (25.0, 35.0, 45.0, 55.0)):
        cylinder, closed = (float(change[name][:, j].min()) for name in ("cylinder", "body"))
        checks.append(
            Check(f"deepest change of circulation at r = {middle[j]:.1f} m", cylinder, closed, 0.1, source=KATZ)
        )
        curves += [
            Curve(np.degrees(azimuth), 100.0 * change[name][:, j], f"{name}, r = {middle[j]:.1f} m", style)
            for name, style in (("cylinder", "-"), ("body", "o"))
        ]
    heights = base[2] + np.array([0.3, 0.5, 0.7]) * length
    radius = 0.5 * np.interp(heights - base[2], tower.diameter_station, tower.diameter)
    points = np.column_stack([-2.0 * radius, 0.0 * radius, heights])
    for z, v in zip(heights, bodies.velocity(points, s)[:, 0], strict=True):
        text = f"velocity two radii ahead of the tower × 4 / V, z = {z:.1f} m"
        checks.append(Check(text, -1.0, 4.0 * float(v) / speed, 0.03, source=KATZ))
    figure = Figure(tuple(curves), "azimuth [deg]", "change of circulation [%]")
    notes = (
        "Both models feel the undisturbed wind here. Coupled with the lattice, the body feels the wind behind the rotor"
        " and the circulation of the passing blade, which makes the dip about a third smaller."
    )
    return CaseResult(checks, {"blade passing the tower": figure}, notes)
