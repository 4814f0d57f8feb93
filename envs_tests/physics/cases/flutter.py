"""Flutter of Goland's wing and of rotors in overspeed."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.optimize import brentq, fsolve

from envs_tests.physics.cases.airfoils import (
    DRIFTING,
    INVISCID,
    MIRRORED,
    UniformStream,
    flat_planform,
    half_span_edges,
    panels_of,
    theodorsen,
)
from envs_tests.physics.validation import CaseResult, Check, Curve, Figure, absolute, case
from wt_gym.aerodynamics import AeroOptions, VortexLattice
from wt_gym.control.design import rotor_inertia
from wt_gym.multibody.integrators.integrator_kernels import hamming_advance
from wt_gym.multibody.integrators.schemes import HammingIntegrator
from wt_gym.multibody.system import Joint, MultibodySystem
from wt_gym.multibody.tree.point_kernels import point_loads, point_motion
from wt_gym.simulation import Fidelity, Simulator, TorqueCommand
from wt_gym.simulation.turbine_structure import body_points
from wt_gym.structure.beam import Beam, BeamSections
from wt_gym.structure.flexible_body import FlexibleBody
from wt_gym.structure.modes import clamped_modes
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow

# ---- linear lattice in the frequency domain -------------------------------------------------------------------------
# Nothing is shared with the lattice of the package: double precision, vortices without core, the wake summed as a
# geometric series of its rows, and Kutta-Joukowski loads with the vorticity of the last quarter panel taken into
# account. The wing lies in the plane x = 0, chord along y, span along z from the plane of symmetry z = 0.


def _segment(start, end, points):
    """Velocity across the plane of unit segments (n_segment, 2) at points (n_point, 2), (n_point, n_segment)."""
    first, second = points[:, None] - start, points[:, None] - end
    cross = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    near, far = np.linalg.norm(first, axis=-1), np.linalg.norm(second, axis=-1)
    return (near + far) * cross / (4.0 * np.pi * near * far * (near * far + (first * second).sum(axis=-1)))


class LinearLattice:
    """Half wing of constant chord with panels of even size and a time step of one panel.

    ``chord``, ``axis``: chord [m] and distance from the leading edge to the axis y = 0 of twist, in chords; ``edges``
    (n_span + 1,): span edges, from 0 [m]; ``wake_chords``: length of the wake.
    """

    def __init__(self, chord: float, axis: float, edges, n_chord: int, wake_chords: float):
        self.panel = chord / n_chord
        self.edges, self.width = np.asarray(edges, dtype=float), np.diff(edges)
        self.middle = 0.5 * (self.edges[1:] + self.edges[:-1])
        self.vortex = -axis * chord + (np.arange(n_chord) + 0.25) * self.panel
        self.control = self.vortex + 0.5 * self.panel
        self._points = np.array([(y, z) for y in self.control for z in self.middle])
        self._bound = np.hstack([self._row(y) for y in self.vortex])
        rows = self.vortex[-1] + self.panel * np.arange(1, round(wake_chords * n_chord) + 1)
        self._wake = np.array([self._row(y) for y in rows])

    def _row(self, y):
        """Velocity of unit rings from y to one panel behind it, with their mirror images, (n_point, n_span)."""
        total = 0.0
        for left, right in ((self.edges[:-1], self.edges[1:]), (-self.edges[1:], -self.edges[:-1])):
            ys = (y, y, y + self.panel, y + self.panel)
            corners = [np.column_stack([np.full(len(left), a), z]) for a, z in zip(ys, (left, right, right, left),
                                                                                   strict=True)]  # fmt: skip
            for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
                total = total + _segment(a, b, self._points)
        return total

    def modal_forces(self, heave, twist, omega: float, speed: float, density: float) -> np.ndarray:
        """Generalized forces (n_mode, n_mode) of the air for harmonic unit modes.

        ``heave``, ``twist`` (n_span, n_mode): displacement along x of the axis and nose-up rotation of the strips;
        ``omega``, ``speed``, ``density`` [rad/s], [m/s], [kg/m³].
        """
        n_span, n_chord = len(self.middle), len(self.vortex)
        step = self.panel / speed
        shift = np.exp(1j * omega * step)
        influence = self._bound.astype(complex)
        behind = shift ** -np.arange(1.0, len(self._wake) + 1.0)
        influence[:, (n_chord - 1) * n_span :] += np.tensordot(behind, self._wake, axes=1)
        wash = [speed * twist - 1j * omega * (heave - y * twist) for y in self.control]
        ring = np.linalg.solve(influence, -np.vstack(wash)).reshape(n_chord, n_span, -1)
        bound = np.diff(ring, axis=0, prepend=0.0)
        rate = (1.5 - 2.0 / shift + 0.5 / shift**2) / step * ring
        total = np.zeros((heave.shape[1],) * 2, dtype=complex)
        for i, y in enumerate(self.vortex):
            # The vorticity -rate/V behind the last bound vortex carries -rate p/4: half of the last ring counts.
            length = self.panel if i < n_chord - 1 else 0.5 * self.panel
            for arm, force in ((y, speed * bound[i]), (y + 0.5 * length, length * rate[i])):
                total += density * (heave - arm * twist).T @ (self.width[:, None] * force)
        return total

    def flutter(self, heave, twist, frequency, density: float, guess) -> tuple[float, float]:
        """Flutter speed [m/s] and frequency [rad/s] of mass-normalized modes.

        ``heave``, ``twist`` (n_span, n_mode); ``frequency`` (n_mode,) of the modes in vacuum [rad/s]; ``density``
        [kg/m³]; ``guess``: speed and frequency to start from.
        """

        def determinant(unknown):
            speed, omega = unknown
            air = self.modal_forces(heave, twist, omega, speed, density)
            value = np.linalg.det((np.diag(frequency**2 - omega**2) - air) / 1e4)
            return [value.real, value.imag]

        speed, omega = fsolve(determinant, guess)
        return float(speed), float(omega)


# ---- Goland's wing --------------------------------------------------------------------------------------------------
# A uniform cantilever, clamped at its root in the plane of symmetry, in a steady stream without incidence. Data:
# Goland, J. Appl. Mech. 12 (1945) A197, in SI units as in the later literature: half span 6.096 m (20 ft), chord 1.8288
# m (6 ft), 35.71 kg/m (0.746 slug/ft), elastic axis at 33 % and mass center at 43 % of the chord, EI = 9.77e6 N m², GJ
# = 0.987e6 N m². The moment of inertia, 8.64 kg m (1.943 slug ft²/ft), is about the elastic axis: it is m (r² + x²)
# with the radius of gyration r of a quarter chord about the mass center and x = 0.1 chord.

LENGTH, CHORD, MASS, INERTIA = 6.096, 1.8288, 35.71, 8.64
EI, GJ = 9.77e6, 0.987e6
AXIS, CENTER = 0.33, 0.43
"""Elastic axis and mass center, chords behind the leading edge."""
DENSITY = 1.02
"""Of the air in the published results with unsteady vortex lattices [kg/m³]."""
UVLM_SOURCE = (
    "165 ± 4 m/s, about 69 rad/s (ρ = 1.02, α = 0): published unsteady vortex lattices with beams; SHARPy's regression "
    "values are 169 m/s (14 × 16 panels a half) and 166 m/s (16 × 16), each within 1 %"
)
STRIP_SOURCE = "exact solution of the continuous wing with Theodorsen's strips, 136.98 m/s and 70.03 rad/s (ρ = 1.225)"
STIFF = 1e10
"""Axial and chordwise stiffness; neither moves."""


def goland_beam(center: float = CENTER, n_elements: int = 12) -> Beam:
    """Beam on the elastic axis: z along the span, x up, y towards the trailing edge; mass center in chords."""
    arm = (center - AXIS) * CHORD
    sections = BeamSections.uniform(
        LENGTH, EA=STIFF, EIx=STIFF, EIy=EI, GJ=GJ, mass=MASS, Ix=INERTIA - MASS * arm**2, Iy=0.0, offset=(0.0, arm)
    )
    return Beam(sections, n_elements)


def goland_modes(beam: Beam, n_modes: int):
    """Coupled modes of bending out of the wing's plane and torsion."""
    return clamped_modes(beam, n_modes, node_dofs=(0, 4, 5))


def mode_fields(span, n_modes: int):
    """Heave along x and nose-up twist (n, n_modes) at span stations (n,), frequencies [rad/s] (n_modes,)."""
    beam = goland_beam()
    modes = goland_modes(beam, n_modes)
    fields = [beam.linear_field(s, modes.shape) for s in span]
    return np.array([u[0] for u, _ in fields]), np.array([t[2] for _, t in fields]), 2.0 * np.pi * modes.frequency


# ---- strip theory ----------------------------------------------------------------------------------------------------


def strip_flutter(density: float, n_modes: int = 8) -> tuple[float, float]:
    """Flutter speed [m/s] and frequency [rad/s] of the beam with Theodorsen's strips.

    Both from the determinant of −ω² + K − A(iω) in the modes, with lift and moment about the elastic axis of Theodorsen
    1935, eqs XVIII and XX, h positive up and θ nose up.
    """
    x, weight = np.polynomial.legendre.leggauss(24)
    heave, twist, frequency = mode_fields(0.5 * LENGTH * (x + 1.0), n_modes)

    def project(left, right):
        return np.einsum("g,gi,gj->ij", 0.5 * LENGTH * weight, left, right)

    shapes = [[project(a, b) for b in (heave, twist)] for a in (heave, twist)]
    stiffness = np.diag(frequency**2)
    b, a = 0.5 * CHORD, 2.0 * AXIS - 1.0

    def determinant(unknown):
        omega, speed = unknown
        s = 1j * omega
        added = np.pi * density * b**2
        lag = 2.0 * np.pi * density * speed * b * theodorsen(omega * b / speed)
        down_h, down_t = -s, speed + b * (0.5 - a) * s  # downwash at three quarters chord
        lift_h, lift_t = -added * s**2 + lag * down_h, added * (speed * s - b * a * s**2) + lag * down_t
        moment_h = -added * b * a * s**2 + lag * b * (a + 0.5) * down_h
        moment_t = -added * (speed * b * (0.5 - a) * s + b**2 * (0.125 + a**2) * s**2) + lag * b * (a + 0.5) * down_t
        air = lift_h * shapes[0][0] + lift_t * shapes[0][1] + moment_h * shapes[1][0] + moment_t * shapes[1][1]
        value = np.linalg.det((s**2 * np.eye(n_modes) + stiffness - air) / 1e4)
        return [value.real, value.imag]

    omega, speed = fsolve(determinant, [70.0, 140.0])
    return float(speed), float(omega)


# ---- time marching ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Resolution:
    """Panels along chord and half span, wake length [chords], time [s], modes, last edge before the tip [strips]."""

    n_chord: int = 8
    n_span: int = 10
    wake_chords: float = 15.0
    duration: float = 0.9
    n_modes: int = 6
    inset: float = 0.25


class GolandWing:
    """The wing as a flexible body in a stream of one speed, mirrored in the plane of symmetry.

    ``speed`` [m/s]; ``resolution``: a time step is the time in which the stream passes one panel.
    """

    TOLERANCE, MOST_ITERATIONS = 1e-6, 8

    def __init__(self, speed: float, resolution: Resolution):
        n_chord = resolution.n_chord
        self.dt = CHORD / (n_chord * speed)
        beam = goland_beam()
        modes = goland_modes(beam, resolution.n_modes)
        system = MultibodySystem(gravity=(0.0, 0.0, 0.0))
        self._body = system.add(FlexibleBody.from_beam("wing", beam, modes.shape), Joint("fixed"))
        self._system = system.build()
        planform = flat_planform(half_span_edges(LENGTH, resolution.n_span, resolution.inset), CHORD, n_chord, AXIS)
        rows = round(resolution.wake_chords * n_chord)
        chosen = INVISCID | MIRRORED | DRIFTING | panels_of(planform) | {"wake_rows": rows, "full_rows": rows}
        options = AeroOptions(**chosen)
        self.lattice = VortexLattice(planform, 1, options, DENSITY)
        self.state = self.lattice.new_state()
        self.stream = UniformStream.at_incidence(0.0, speed)
        self._points = body_points(beam, modes.shape, planform.nodes.reshape(-1, 3))
        self._tip = body_points(beam, modes.shape, np.array([[0.0, 0.0, LENGTH]]))
        self._tip_twist = beam.linear_field(LENGTH, modes.shape)[1][2]
        self._n_sub = int(np.ceil(2.0 * np.pi * modes.frequency[-1] * self.dt / 0.5))
        self.integrator = HammingIntegrator(self._system, self.dt / self._n_sub)
        self._nodes = np.zeros(self.lattice.nodes_shape)
        self._velocities = np.zeros_like(self._nodes)
        self._wind = self._velocities + self.stream.vector
        self._previous = np.zeros_like(self.integrator.inputs.body_loads[0])

    def start(self, tip_speed: float = 0.05):
        """Begin undeformed, moving in the first mode."""
        y = self._system.initial_state()
        _, rate = self._split(y)
        rate[0] = tip_speed / self._tip.linear[0, 0, 0]
        self.integrator.start(y)
        self._move(self.integrator.state)
        self.lattice.reset(self.state, self._nodes, self._velocities, self._wind)

    def _split(self, y):
        """Elastic coordinates and rates, views into the state."""
        q = self._system.index(self._body, "elastic_q")
        u = self._system.n_q + self._system.index(self._body, "elastic_u")
        n = self._system.bodies[self._body].n_elastic
        return y[q : q + n], y[u : u + n]

    def _move(self, y):
        q, rate = self._split(y)
        frame = np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3)
        point_motion(*frame, q.copy(), rate.copy(), self._points, self._nodes.reshape(-1, 3),
                     self._velocities.reshape(-1, 3))  # fmt: skip

    def step(self, time: float):
        """One aerodynamic step; the loads at its end and the motion they cause are iterated to agreement."""
        integrator, inputs, history = self.integrator, self.integrator.inputs, self.integrator.history
        self.lattice.convect_wake(self.state, self.stream, time, self.dt)
        saved = [a.copy() for a in history]
        first, last = inputs.body_loads
        last[:] = 2.0 * first - self._previous
        for _ in range(self.MOST_ITERATIONS):
            for array, old in zip(history, saved, strict=True):
                array[:] = old
            integrator.advance(self._n_sub)
            self._move(integrator.state)
            forces = self.lattice.solve(self.state, self._nodes, self._velocities, self._wind, self.dt)
            before = last[self._body].copy()
            last[self._body] = 0.0
            q, _ = self._split(integrator.state)
            point_loads(np.eye(3), q.copy(), self._points, forces.reshape(-1, 3), last[self._body])
            if np.abs(last - before).max() <= self.TOLERANCE * np.abs(last).max():
                break
        self.lattice.accept(self.state)
        # the stored rate belongs to the stored state and the final loads
        hamming_advance(history, inputs, self._system.tree, integrator.work, 1.0, 0, 0, self._system.constrained, True)
        self._previous[:] = first
        first[:] = last

    def tip(self):
        """Heave [m] and twist times semi-chord [m] of the tip."""
        q, _ = self._split(self.integrator.state)
        return float(self._tip.linear[0, 0] @ q), float(0.5 * CHORD * self._tip_twist @ q)


def march(speed: float, resolution: Resolution) -> tuple[np.ndarray, np.ndarray]:
    """Time (n,) [s] and tip motion (n, 2) [m] after a kick."""
    wing = GolandWing(speed, resolution)
    wing.start()
    n = round(resolution.duration / wing.dt)
    motion = np.zeros((n, 2))
    for m in range(n):
        wing.step(m * wing.dt)
        motion[m] = wing.tip()
    return wing.dt * np.arange(1, n + 1), motion


def dominant_mode(time: np.ndarray, motion: np.ndarray, start: float = 0.25, order: int = 8) -> complex:
    """Eigenvalue σ + iω of the fastest growing oscillation in the motion after ``start`` [s].

    Eigensystem realization (Juang & Pappa 1985) with at most ``order`` states; of the oscillations that make up a
    twentieth of the largest at the end, the one with the greatest growth.
    """
    stride = max(1, int(0.002 / (time[1] - time[0])))
    data = motion[time > start][::stride]
    dt = stride * (time[1] - time[0])
    half = len(data) // 2
    hankel = np.array([data[i : i + half].ravel() for i in range(len(data) - half + 1)])
    left, size, right = np.linalg.svd(hankel[:-1], full_matrices=False)
    order = min(order, int(np.sum(size > 1e-6 * size[0])))  # what is smaller is rounding
    root = 1.0 / np.sqrt(size[:order])
    transition = (root[:, None] * left[:, :order].T) @ hankel[1:] @ (right[:order].T * root)
    factors = np.linalg.eigvals(transition).astype(complex)
    parts = np.linalg.lstsq(factors ** np.arange(len(data))[:, None], data.astype(complex), rcond=None)[0]
    at_end = np.linalg.norm(parts, axis=1) * np.abs(factors) ** (len(data) - 1)
    poles = np.log(factors) / dt
    oscillation = poles.imag > 0.0
    strong = oscillation & (at_end > 0.05 * at_end[oscillation].max())
    return complex(poles[strong][np.argmax(poles[strong].real)])


@lru_cache(maxsize=64)
def growth(speed: float, resolution: Resolution) -> complex:
    """Growth rate + i frequency [1/s, rad/s] of the flutter mode."""
    return dominant_mode(*march(speed, resolution))


def flutter_point(resolution: Resolution, low: float = 150.0, high: float = 180.0, tolerance: float = 0.1):
    """Speed [m/s] without growth by regula falsi (Illinois), frequency there [rad/s] and all points that were marched.

    Raises `ValueError` if the wing is not stable at ``low`` or not unstable at ``high``.
    """
    points = {v: growth(v, resolution) for v in (low, high)}
    left, right = points[low].real, points[high].real
    if not left < 0.0 < right:
        raise ValueError(f"growth is {left:.3f}/s at {low} m/s and {right:.3f}/s at {high} m/s: no flutter between")
    previous = low
    for _ in range(8):
        speed = (low * right - high * left) / (right - left)
        points[speed] = growth(speed, resolution)
        value = points[speed].real
        if abs(speed - previous) < tolerance:
            break
        previous = speed
        if value > 0.0:
            high, right, left = speed, value, 0.5 * left
        else:
            low, left, right = speed, value, 0.5 * right
    return speed, points[speed].imag, points


def linear_flutter(n_chord: int, n_span: int, inset: float = 0.25, wake_chords: float = 15.0, n_modes: int = 6):
    """Flutter speed [m/s] and frequency [rad/s] with the linear lattice in the frequency domain."""
    lattice = LinearLattice(CHORD, AXIS, half_span_edges(LENGTH, n_span, inset), n_chord, wake_chords)
    heave, twist, frequency = mode_fields(lattice.middle, n_modes)
    return lattice.flutter(heave, twist, frequency, DENSITY, (170.0, 69.0))


# ---- cases -----------------------------------------------------------------------------------------------------------


@case("goland-strip-theory", "Goland's wing with Theodorsen's strips: frequencies and flutter", STRIP_SOURCE)
def goland_strip_theory() -> list[Check]:
    """The beam alone: vacuum frequencies without static moment are closed forms, flutter is known exactly."""
    speed, omega = strip_flutter(1.225)
    uncoupled = 2.0 * np.pi * goland_modes(goland_beam(center=AXIS), 2).frequency
    bending = 1.8751041**2 * np.sqrt(EI / (MASS * LENGTH**4))
    torsion = 0.5 * np.pi / LENGTH * np.sqrt(GJ / INERTIA)
    return [
        Check("bending without static moment", bending, uncoupled[0], 1e-3, "rad/s", source="uniform cantilever"),
        Check("torsion without static moment", torsion, uncoupled[1], 1e-3, "rad/s", source="uniform clamped rod"),
        Check("flutter speed", 136.98, speed, 0.005, "m/s", source=STRIP_SOURCE),
        Check("flutter frequency", 70.03, omega, 0.005, "rad/s", source=STRIP_SOURCE),
    ]


@case("goland-flutter", "Flutter of Goland's wing: beam and vortex lattice marched in time", UVLM_SOURCE, slow=True)
def goland_flutter() -> CaseResult:
    """Growth rates over the speed, the speed without growth, its convergence, and where published values lie."""
    kinds = {"inset tips": Resolution(), "to the tips": Resolution(n_span=16, wake_chords=10.0, inset=0.0)}
    runs, extrapolated, linear = {}, {}, {}
    for kind, resolution in kinds.items():
        for n_chord in (4, 8):
            runs[kind, n_chord] = flutter_point(replace(resolution, n_chord=n_chord), 160.0, 182.0)
        extrapolated[kind] = [(4.0 * runs[kind, 8][k] - runs[kind, 4][k]) / 3.0 for k in (0, 1)]
        linear[kind] = linear_flutter(16, resolution.n_span, resolution.inset, resolution.wake_chords)
    reference = "linear lattice in the frequency domain, double precision, 16 panels along the chord, same strips"
    checks = []
    for kind, text in (("inset tips", "10 strips, the last edge a quarter strip before the tip"),
                       ("to the tips", "16 strips up to the tips, as SHARPy's")):  # fmt: skip
        (speed, omega), exact = extrapolated[kind], linear[kind]
        checks += [
            Check(f"flutter speed, {text}", 165.0, speed, absolute(4.0), "m/s", source=UVLM_SOURCE),
            Check(f"flutter frequency, {text}", 69.0, omega, 0.03, "rad/s", source=UVLM_SOURCE),
            Check("the same speed against the linear lattice", exact[0], speed, 0.005, "m/s", source=reference),
            Check("the same frequency against the linear lattice", exact[1], omega, 0.01, "rad/s", source=reference),
        ]
    growth_curves, frequency_curves = [], []
    for (kind, n_chord), (_, _, points) in runs.items():
        speeds, label = sorted(points), f"{n_chord} × {kinds[kind].n_span} panels, {kind}"
        growth_curves.append(Curve(speeds, [points[v].real for v in speeds], label, "o-"))
        frequency_curves.append(Curve(speeds, [points[v].imag for v in speeds], label, "o-"))
    strips = np.array([4, 6, 8, 12, 16, 24, 32])
    to_tip, inside = ([linear_flutter(8, n, edge)[0] for n in strips] for edge in (0.0, 0.25))
    time, motion = march(runs["inset tips", 8][0] + 5.0, kinds["inset tips"])
    figures = {
        "growth rate over the speed": Figure(tuple(growth_curves), "V [m/s]", "growth rate [1/s]"),
        "frequency over the speed": Figure(tuple(frequency_curves), "V [m/s]", "frequency [rad/s]"),
        "flutter speed over the strips of the half span (linear lattice)": Figure(
            (
                Curve(strips, to_tip, "up to the tips", "o-"),
                Curve(strips, inside, "a quarter strip inside", "x-"),
                Curve(strips, np.full(len(strips), 161.0), "165 ± 4 m/s", "k:"),
                Curve(strips, np.full(len(strips), 169.0), "", "k:"),
            ),
            "strips",
            "flutter speed [m/s]",
        ),
        "tip motion 5 m/s above the flutter speed": Figure(
            (Curve(time, motion[:, 0], "heave"), Curve(time, motion[:, 1], "twist × semi-chord")), "t [s]", "m"
        ),
    }
    found = ", ".join(
        f"{speed:.1f} m/s ({n} × {kinds[kind].n_span}, {kind})" for (kind, n), (speed, *_) in runs.items()
    )
    notes = (
        f"No growth at {found}; the checked values are extrapolated from 4 and 8 panels along the chord (second "
        f"order). The converged potential flow flutters at about {linear_flutter(8, 32)[0]:.0f} m/s, beyond 165 ± 4 "
        "m/s. Even lattices up to the tips act as a wing longer by a quarter strip at each tip and flutter earlier: "
        f"{to_tip[2]:.1f}, {to_tip[3]:.1f}, {to_tip[4]:.1f}, {to_tip[6]:.1f} m/s with 8, 12, 16, 32 strips (linear). "
        "Halving a wake of 20 chords changes 0.05 m/s, two more modes 0.01 m/s."
    )
    return CaseResult(checks, figures, notes)


# ---- rotors in overspeed --------------------------------------------------------------------------------------------
# The rotor is held at a speed, on a rigid tower and shaft, in a wind of one tip-speed ratio, pitched so that the air
# hardly bends the blades. The difference of two runs, one with a short kick of all pitch angles, obeys the linear
# equations about the motion of the rotor; what is left of it after the kick's own response is the least damped mode.
#
# Beside it stands an independent calculation for one clamped, untwisted blade in still air: four flapwise and two
# torsional modes of the same section tables, strips with Jones's two-lag lift of slope 2 pi, centrifugal, propeller and
# center-of-mass terms; it gives Goland's wing its published 137 m/s. The critical speeds that are quoted for the NREL
# 5-MW, 24 to 25 rpm, could not be traced to printed tables.

ROTOR_SPEEDS = {"nrel_5mw": (18.0, 19.5, 20.5, 21.5), "iea_15mw": (10.0, 11.5, 12.5)}
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


def kicked_motion(turbine, rotor_speed):
    """Motion that a kick of the pitch leaves, at a rotor speed [rad/s].

    Returns ``time`` (n,): since the end of the kick [s]; ``motion`` (n, 2): what the kick changes in the torsional and
    the flapwise moment at the root of the first blade, over the largest change of each [-].
    """
    wind = rotor_speed * turbine.rotor_diameter / 2.0 / TIP_SPEED_RATIO
    machine = HeldSpeed(turbine.drivetrain, HOLDING * rotor_inertia(turbine))
    simulator = Simulator(turbine, SteadyInflow(wind), RIGID_TOWER, generator=machine)
    pitch = unloaded_pitch(simulator, rotor_speed)
    kicked, plain = (_moments(simulator, rotor_speed, pitch, kick) for kick in (KICK, 0.0))
    motion = kicked - plain
    return TIME_STEP * np.arange(len(motion)), motion / np.abs(motion).max(axis=0)


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
    for name, speeds in ROTOR_SPEEDS.items():
        turbine = load_turbine(name)
        rated = turbine.drivetrain.rated_rotor_speed * 30.0 / np.pi
        motions = [kicked_motion(turbine, rpm * np.pi / 30.0) for rpm in speeds]
        # of the least damped mode, after the others have faded
        modes = np.array([dominant_mode(time, motion, start=FADING) for time, motion in motions])
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
