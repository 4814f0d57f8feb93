"""The blade-and-shaft example of Holm-Jørgensen, Nielsen & Rubak in local observer frames, and what the method gives.

A 46-m, 10-t blade on a 4-m shaft in two bearings, 20 + 4 elements, loaded at its tip. The section tables of the paper's
blade are not public: a stand-in of the same length and mass is used, with straight axes (no twist, no offset of the
mass center), so that flap, edge and torsion are uncoupled as in the paper's figures. Load amplitudes are not published
either: they follow from the published results (speed of 1.6 rad/s, u/L = 0.15).
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import eigh

from validation.case import CaseResult, Check, Curve, Figure, case
from validation.tree_tools import read_table
from wt_gym.multibody.observer_frame.frame import ObserverFrameSystem
from wt_gym.multibody.observer_frame.observer_frame_body import Substructure
from wt_gym.multibody.observer_frame.observer_frame_integrator import ObserverFrameIntegrator
from wt_gym.structure.beam import Beam, BeamSections
from wt_gym.turbines.beam import inertia_matrix

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

__all__ = ["blade_beam", "rotor", "shaft_beam"]

PAPER = "Holm-Jørgensen, Nielsen & Rubak, System reduction in nonlinear multibody dynamics of wind turbines"
LENGTH = 46.0
PERIOD = 1.09
"""First flap period of the clamped stand-in blade [s]."""
STEP = PERIOD / 150.0
"""150 steps a period, as in the paper."""
SPEED = 1.6
BACKWARDS = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Shaft to fixed axes: its z axis runs from the hub to the rear bearing, along x₁."""
FLAP_LOAD = 30e3
"""Final flap load of the first load case [N]; gives a tip deflection of about 5 % of the length."""
VISIBLE = 0.03
"""Difference that a reader sees in a figure, as a share of its axis."""


def blade_sections() -> BeamSections:
    """Piecewise constant sections (prismatic elements) of the stand-in blade."""
    table, columns = read_table("holm_jorgensen_blade.csv")
    value = dict(zip(columns, (0.5 * (table[1:] + table[:-1])).T, strict=True))
    span = table[:, columns.index("span_m")]
    stiffness, inertia = [], []
    for i in range(len(span) - 1):
        edge, flap = value["EI_edge_Nm2"][i], value["EI_flap_Nm2"][i]
        stiffness.append(np.diag([np.inf, np.inf, value["EA_N"][i], edge, flap, value["GJ_Nm2"][i]]))
        rotary = value["i_edge_kgm"][i], value["i_flap_kgm"][i]
        inertia.append(inertia_matrix(value["mass_kg_m"][i], 0.0, 0.0, *rotary, 0.0))
    # each element has its own pair of stations; the jump lies within a micrometer
    station = np.sort(np.concatenate([span[:-1], span[1:] - 1e-6]))
    station[-1] = span[-1]
    axis = np.column_stack([0.0 * station, 0.0 * station, station])
    return BeamSections(station, np.repeat(stiffness, 2, axis=0), np.repeat(inertia, 2, axis=0), axis)


@cache
def blade_beam() -> Beam:
    """Blade of 20 equal elements, z from root to tip, x flapwise, y edgewise."""
    return Beam(blade_sections(), 20)


@cache
def shaft_beam() -> Beam:
    """Steel shaft of 4 m and 0.4 m diameter in 4 elements, z from the hub to the rear bearing."""
    radius, young, shear, density = 0.2, 2.1e11, 8.08e10, 7850.0
    area, second = np.pi * radius**2, np.pi * radius**4 / 4.0
    bending, rotary = young * second, density * second
    sections = BeamSections.uniform(
        4.0,
        EA=young * area,
        EIx=bending,
        EIy=bending,
        GJ=2.0 * shear * second,
        mass=density * area,
        Ix=rotary,
        Iy=rotary,
    )
    return Beam(sections, 4)


def rotor(load, axes, reference="clamped", n_modes=None, step=STEP, **options):
    """Integrator of the example with a tip load.

    Parameters
    ----------
    load : callable
        Force and moment (6,) at the blade tip as a function of time.
    axes : str
        Of the load, see :meth:`ObserverFrameSystem.load`.
    reference : str
        Reference condition of the blade.
    n_modes : int, optional
        Elastic modes of the blade; None for finite elements. The shaft is always finite elements.
    step : float
        [s].
    **options
        Of :class:`ObserverFrameIntegrator`.
    """
    system = ObserverFrameSystem()
    system.add(Substructure.from_beam("blade", blade_beam(), reference, n_modes))
    system.add(Substructure.from_beam("shaft", shaft_beam(), markers={"front bearing": 2.0}), rotation=BACKWARDS)
    system.weld("blade", "root", "shaft", "root")
    system.support("shaft", "front bearing", [(0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
    system.support("shaft", "tip")
    system.load("blade", "tip", load, axes)
    return ObserverFrameIntegrator(system, step, **options)


def ramp(flap: float, edge: float, duration: float) -> Callable[[float], np.ndarray]:
    """Tip load that grows linearly for some seconds and is then removed."""

    def load(time: float) -> np.ndarray:
        share = time / duration if time <= duration + 1e-9 else 0.0
        return np.array([flap * share, edge * share, 0.0, 0.0, 0.0, 0.0])

    return load


def simulate(integrator, end):
    """Histories of the example.

    Returns
    -------
    dict of str to array
        time (n,); tip (n, 3) in the fixed frame [m]; relative (n, 3) displacement of the tip from the frame; largest
        (n,) flapwise displacement of any node from the frame; speed (n,) of the hub [rad/s]; power (n,) of a load
        on the undeformed lever [W]; energy [J] and momentum about the shaft [kg m²/s], every tenth step.
    """
    blade = integrator.system.bodies[0]
    flap_rows = blade.basis[0::6]
    history: dict[str, list[Any]] = {
        key: [] for key in ("time", "tip", "relative", "largest", "speed", "power", "energy", "momentum")
    }
    load = integrator.system.loads[0][1]
    for k in range(round(end / integrator.step) + 1):
        if k:
            integrator.advance()
        history["time"].append(integrator.time)
        history["tip"].append(integrator.position("blade", "tip"))
        history["relative"].append(integrator.displacement("blade", "tip")[:3])
        history["largest"].append(np.abs(flap_rows @ integrator.coordinates("blade")).max())
        history["speed"].append(integrator.velocity("shaft", "root")[3])
        history["power"].append(_power(integrator, load(integrator.time)[:3]))
        if k % 10 == 0:
            history["energy"].append(integrator.energy().sum())
            history["momentum"].append(integrator.momentum()[3])
    return {key: np.array(value) for key, value in history.items()}


def _power(integrator, force):
    """Power of a force at the tip in frame axes that turns the blade by the undeformed lever: p·(v − ω × u) [W]."""
    rotation = integrator.state.rotation[0]
    deflection = rotation @ integrator.displacement("blade", "tip")[:3]
    spin = integrator.velocity("blade", "root")[3:]
    return rotation @ force @ (integrator.velocity("blade", "tip")[:3] - np.cross(spin, deflection))


def edge_load():
    """Final edge load [N] that brings the rotor to 1.6 rad/s in a ramp of 3 s: ∫ F L dt = J Ω."""
    beam = blade_beam()
    _, y, z = beam.particle_position.T
    inertia = beam.particle_mass @ (y**2 + z**2)
    inertia += shaft_beam().particle_mass @ (shaft_beam().particle_position[:, :2] ** 2).sum(axis=1)
    return -inertia * SPEED / (1.5 * LENGTH), inertia


def difference(a: np.ndarray, b: np.ndarray) -> float:
    """Root-mean-square difference of two histories relative to the first."""
    return float(np.sqrt(np.mean((a - b) ** 2) / np.mean(a**2)))


def thinned(
    history: Mapping[str, NDArray[np.float64]], key: str, column: int | None = None, every: int = 8
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Time and a history with fewer points, for figures."""
    value = history[key] if column is None else history[key][:, column]
    return history["time"][::every], value[::every]


def edgewise_vibration(edge):
    """Frequency [rad/s] and amplitude in the hub's speed [rad/s] of the strongest vibration after the edge load.

    Linear finite elements of blade and shaft at rest, assembled here, with the response to a ramp in closed form.
    """
    blade, shaft = blade_beam(), shaft_beam()
    n_blade, n = blade.n_dof, blade.n_dof + shaft.n_dof - 6
    turn = np.kron(np.eye(2 * len(shaft.nodes)), BACKWARDS)
    of_shaft = np.concatenate([np.arange(6), np.arange(n_blade, n)])
    matrices = []
    for one, two in ((blade.stiffness, shaft.stiffness), (blade.mass, shaft.mass)):
        total = np.zeros((n, n))
        total[:n_blade, :n_blade] = one
        total[np.ix_(of_shaft, of_shaft)] += turn @ two @ turn.T
        matrices.append(total)
    front, rear = n_blade + 6, n_blade + 18
    free = np.setdiff1d(np.arange(n), [front + 1, front + 2, rear, rear + 1, rear + 2])
    square, mode = eigh(*(a[np.ix_(free, free)] for a in matrices))
    w, mode = np.sqrt(square[1:]), mode[:, 1:]
    push = mode[np.flatnonzero(free == n_blade - 5)[0]] * edge
    value = push / w**2 * (1.0 - np.sin(3.0 * w) / (3.0 * w))
    rate = push / w**2 / 3.0 * (1.0 - np.cos(3.0 * w))
    amplitude = np.abs(mode[np.flatnonzero(free == 3)[0]]) * np.hypot(w * value, rate)
    strongest = int(np.argmax(amplitude))
    return float(w[strongest]), float(amplitude[strongest])


def harmonic(time: np.ndarray, x: np.ndarray, low: float, high: float) -> tuple[float, float]:
    """Circular frequency between two bounds [rad/s] and amplitude of the strongest harmonic (Hann window)."""
    window, frequency = np.hanning(len(time)), np.linspace(low, high, 3001)
    found = np.abs(np.exp(-1j * np.outer(frequency, time)) @ (window * (x - x.mean()))) / (0.5 * window.sum())
    strongest = int(np.argmax(found))
    return float(frequency[strongest]), float(found[strongest])


@case("observer-frame-rotor", "Blade and shaft: tip loads spin the rotor up; 16 modes against finite elements", PAPER)
def spin_up() -> CaseResult:
    """Load case 1, figure 3."""
    edge, inertia = edge_load()
    load = ramp(FLAP_LOAD, edge, 3.0)
    full = simulate(rotor(load, "undeformed"), 10.0)
    modal = simulate(rotor(load, "undeformed", n_modes=16), 10.0)
    time, coarse = full["time"], full["time"][::10]
    late, free = time > 3.1, coarse > 3.1
    energy, momentum = full["energy"][free], full["momentum"][free]
    mean, spin = full["speed"][late].mean(), momentum.mean() / inertia
    natural, swing = edgewise_vibration(edge)
    found, found_swing = harmonic(time[late], full["speed"][late], 0.85 * natural, 1.15 * natural)
    # one period of the edgewise vibration of the hub
    share = round(2.0 * np.pi / natural / STEP)
    smooth = {name: np.convolve(run["speed"], np.full(share, 1.0 / share), "valid")
              for name, run in (("full", full), ("modal", modal))}  # fmt: skip
    after = smooth["full"][time[: len(smooth["full"])] > 3.1]
    work = np.trapezoid(full["power"], time)
    checks = [
        Check("mean hub speed after the loads (to which the edge load is chosen)", SPEED, mean, 0.01, "rad/s",
              source=f"{PAPER}, fig. 3b"),
        Check("angular momentum about the shaft after the loads, against ∫ F L dt", inertia * SPEED, momentum[0], 0.005,
              "kg m²/s", source="momentum balance about the undeformed lever"),
        Check("energy after the loads, against their work ∫ p·v dt", work, energy[0], 0.005, "J",
              source="energy balance"),
        Check("mean hub speed after the loads, against the angular momentum over the inertia of the straight blade",
              spin, mean, 0.005, "rad/s", source="the blade vibrates about a rotation with H = J Ω"),
        Check("energy after the loads: largest departure from its first value", "<= 0.01",
              np.abs(energy / energy[0] - 1.0).max(), source=f"{PAPER}: energy conservation"),
        Check("angular momentum after the loads: largest departure from its first value", "<= 0.005",
              np.abs(momentum / momentum[0] - 1.0).max(), source="no torque about the shaft"),
        Check("Ω almost constant: largest departure, over a period of the edgewise vibration, from its mean", "<= 0.02",
              np.abs(after / after.mean() - 1.0).max(),
              source=f"{PAPER}: “Ω is almost constant, a sign of energy conservation”"),
        Check("swing of the hub's own speed: frequency of its strongest harmonic", natural, found, 0.02, "rad/s",
              source="linear modes of blade and shaft after the ramp"),
        Check("swing of the hub's own speed: amplitude of that harmonic", swing, found_swing, 0.05, "rad/s",
              source="linear modes of blade and shaft after the ramp"),
        Check("16 modes against finite elements: rms difference of the tip in x₁, loading (0–3 s)", "<= 0.01",
              difference(full["tip"][~late, 0], modal["tip"][~late, 0]),
              source=f"{PAPER}, fig. 3a: “almost identical”"),
        Check("16 modes against finite elements: rms difference of the tip in x₁, 0–10 s", "<= 0.02",
              difference(full["tip"][:, 0], modal["tip"][:, 0]), source=f"{PAPER}, fig. 3a: “almost identical”"),
        Check("16 modes against finite elements: rms difference of Ω over a period of the edgewise vibration",
              "<= 0.005", difference(smooth["full"], smooth["modal"]), source=f"{PAPER}, fig. 3b: “identical”"),
        Check(f"16 modes against finite elements: rms difference of Ω over the axis of the figure (0–2 rad/s), visible "
              f"from {VISIBLE}", f"<= {VISIBLE}", np.sqrt(np.mean((full["speed"] - modal["speed"]) ** 2)) / 2.0,
              source=f"{PAPER}, fig. 3b: “identical”"),
    ]  # fmt: skip
    figures = {
        "Fig. 3a: tip displacement along x₁": Figure((
            Curve(*thinned(full, "tip", 0), "finite elements", "x"),
            Curve(*thinned(modal, "tip", 0), "16 modes", "o"),
        ), "time [s]", "x₁ [m]"),
        "Fig. 3b: angular velocity of the rotor": Figure((
            Curve(*thinned(full, "speed"), "finite elements", "x"),
            Curve(*thinned(modal, "speed"), "16 modes", "o"),
        ), "time [s]", "Ω [rad/s]"),
    }  # fmt: skip
    largest = np.abs(full["speed"][late] / mean - 1.0).max()
    notes = (
        f"Edge load {abs(edge):.0f} N from J Ω = ∫ F L dt, flap load {FLAP_LOAD:.0f} N (not published). The sudden end "
        "of the edge load leaves edgewise vibrations in many modes, which turn the light hub: its own speed swings by "
        f"up to ± {100 * largest:.0f} %, as the linear modes of blade and shaft say it must. What stays constant is "
        "the angular momentum, and Ω over a period of the vibration. In the hub's own speed the models differ by "
        f"{100 * difference(full['speed'], modal['speed']):.1f} % (rms), in the high modes of the sudden end that 16 "
        "do not have."
    )
    return CaseResult(checks, figures, notes)


def _frequencies(body, stiffness, gyroscopic, plane):
    """Circular frequencies, ascending, of the modes of a body that move in one plane (0 along x, 1 along y)."""
    moves = np.abs(body.marker_shape("tip")[:2, : body.n_elastic])
    chosen = np.flatnonzero(moves[plane] > 1e-6 * moves.max())
    n, block = len(chosen), np.ix_(chosen, chosen)
    inverse = np.linalg.inv(body.mass_matrix[block])
    a = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ stiffness[block], -inverse @ gyroscopic[block]]])
    return np.sort(np.abs(np.linalg.eigvals(a).imag))[::2]


@case("observer-frame-spin", "A spinning clamped beam without geometric stiffness", "eqs (6)–(7) at constant speed")
def spinning_frequencies() -> CaseResult:
    """Flap stays at ω₀, lag falls to √(ω₀² − Ω²): what a linear strain energy gives, not the rotating-beam table."""
    length, bending, mass = 10.0, 1.4e4, 1.2
    # four times as stiff in lag, so that every mode has one plane
    sections = BeamSections.uniform(length, EA=1e8, EIx=4 * bending, EIy=bending, GJ=1e6, mass=mass, Ix=1e-7, Iy=1e-7)
    body = Substructure.from_beam("blade", Beam(sections, 12), "clamped", 8)
    unit = np.sqrt(mass * length**4 / bending)
    n = body.n_elastic
    checks = []
    for eta in (0.0, 1.0, 2.0, 3.0):
        omega = np.array([eta / unit, 0.0, 0.0])
        stiffness = (body.stiffness + body.centrifugal_matrix(omega))[:n, :n]
        gyroscopic = 2.0 * body.gyroscopic_matrix(omega)[:n, :n]
        # flap moves along the spin axis x, lag along y: no matrix couples the planes of a straight beam without torsion
        for name, plane, expected in (("flap", 0, 3.5160), ("lag", 1, np.sqrt(4.0 * 3.5160**2 - eta**2))):
            found = _frequencies(body, stiffness, gyroscopic, plane)[0] * unit
            checks.append(Check(f"{name} 1 at η = {eta:g}", expected, found, 1e-4, source="ω₀² and ω₀² − Ω²"))
    return CaseResult(checks, notes="The true beam stiffens (flap 4.797 at η = 3): use the floating frame.")
