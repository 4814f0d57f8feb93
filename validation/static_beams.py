"""Static and free-vibration cases of one beam against beam theory."""

from __future__ import annotations

import numpy as np

from validation.case import CaseResult, Check, Curve, Figure, absolute, case
from validation.tree_tools import body_pose, frequencies, static_balance
from wt_gym.multibody.integrators.schemes import HammingIntegrator
from wt_gym.multibody.system import Joint, MultibodySystem
from wt_gym.structure.beam import Beam, BeamSections
from wt_gym.structure.flexible_body import FlexibleBody
from wt_gym.structure.modes import body_from_beam, circular_sections, clamped_modes, select_modes
from wt_gym.turbines.beam import inertia_matrix

LENGTH = 12.0
THEORY = "Euler–Bernoulli beam theory"


def uniform(n_elements, **changes):
    """Uniform beam with different stiffness in both planes."""
    properties = {"EA": 3e8, "EIx": 5e6, "EIy": 2e6, "GJ": 1e6, "mass": 20.0, "Ix": 1e-6, "Iy": 1e-6} | changes
    return Beam(BeamSections.uniform(LENGTH, **properties), n_elements)


def small_load_tip(beam, force, moment, scale=1e-5):
    """Tip displacement and rotation (6,) in the multibody tree for end loads, scaled down and the answer up again.

    Small loads show the linear response alone: the second-order shortening of a bent beam vanishes with their square.
    """
    system = MultibodySystem((0.0, 0.0, 0.0))
    root = system.add(body_from_beam("beam", beam, "nodal"), Joint("fixed"))
    tip = system.add(FlexibleBody.rigid("tip", 0.0, np.zeros(3), np.zeros((3, 3))), Joint("fixed"), root, "tip")
    system.build()

    def set_loads(_, inputs, work):
        inputs.body_loads[:, tip, :3] = scale * work.rot[tip].T @ force
        inputs.body_loads[:, tip, 3:6] = scale * work.rot[tip].T @ moment

    y = static_balance(system, system.initial_state(), set_loads, tolerance=1e-15, step=1e-6)
    position, turn = body_pose(system, y, tip)
    angles = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return np.concatenate([position - [0.0, 0.0, LENGTH], angles]) / scale


@case("beam-static", "Cantilever under end loads: uniform, tapered and shear-flexible", THEORY)
def beam_static() -> list[Check]:
    """P L³/3EI and relatives, through the multibody tree in nodal coordinates."""
    tip = small_load_tip(uniform(3), np.array([100.0, 200.0, 0.0]), np.array([0.0, 0.0, 50.0]))
    tip[2] = small_load_tip(uniform(3), np.array([0.0, 0.0, 300.0]), np.zeros(3), 1.0)[2]
    expected = {
        "displacement along x, P L³/3EI": (100.0 * LENGTH**3 / (3 * 2e6), tip[0], "m"),
        "displacement along y, P L³/3EI": (200.0 * LENGTH**3 / (3 * 5e6), tip[1], "m"),
        "extension, N L/EA": (300.0 * LENGTH / 3e8, tip[2], "m"),
        "slope about x, −P L²/2EI": (-200.0 * LENGTH**2 / (2 * 5e6), tip[3], "rad"),
        "slope about y, P L²/2EI": (100.0 * LENGTH**2 / (2 * 2e6), tip[4], "rad"),
        "twist, T L/GJ": (50.0 * LENGTH / 1e6, tip[5], "rad"),
    }
    checks = [Check(name, e, o, 1e-5, unit, source=THEORY) for name, (e, o, unit) in expected.items()]
    s = np.array([0.0, LENGTH])
    axis = np.column_stack([0 * s, 0 * s, s])
    inertia = np.tile(inertia_matrix(1.0, 0.0, 0.0, 0.1, 0.1, 0.0), (2, 1, 1))
    taper = np.array([np.diag([np.inf, np.inf, 1e9, 1e6 * k, 1e6 * k, 1e6]) for k in (2.0, 1.0)])
    tip = small_load_tip(Beam(BeamSections(s, taper, inertia, axis), 1), np.array([1000.0, 0.0, 0.0]), np.zeros(3))
    # δ = P ∫ (L − s)²/EI ds with EI = EI₀ (2 − s/L): P L³/EI₀ (3/2 − 2 + ln 2)
    exact = 1000.0 * LENGTH**3 / 1e6 * (np.log(2.0) - 0.5)
    checks.append(Check("tapered beam, one element, P L³/EI₀ (ln 2 − ½)", exact, tip[0], 1e-5, "m", source=THEORY))
    shear = np.tile(np.diag([4e5, 5e5, 1e9, 5e6, 2e6, 1e6]), (2, 1, 1))
    tip = small_load_tip(Beam(BeamSections(s, shear, inertia, axis), 2), np.array([100.0, 0.0, 0.0]), np.zeros(3))
    exact = 100.0 * LENGTH**3 / (3 * 2e6) + 100.0 * LENGTH / 4e5
    source = "Timoshenko beam theory"
    checks.append(Check("shear-flexible beam, P L³/3EI + P L/kGA", exact, tip[0], 1e-5, "m", source=source))
    return checks


@case("beam-free-vibration", "Clamped–free beam: natural frequencies and a free vibration in time", THEORY)
def beam_free_vibration() -> CaseResult:
    """β L = 1.87510, 4.69409, 7.85476; torsion and extension as quarter waves; vibration of the first mode in time."""
    beam = uniform(12, Ix=0.4, Iy=0.9)
    slender = uniform(12)
    beta = np.array([1.87510407, 4.69409113, 7.85475744])
    checks = []
    modes = clamped_modes(slender, 30)
    for kind, stiffness in (("flap", 2e6), ("edge", 5e6)):
        exact = beta**2 * np.sqrt(stiffness / (20.0 * LENGTH**4)) / (2.0 * np.pi)
        for i, k in enumerate(select_modes(modes, **{kind: 3})):
            checks.append(
                Check(f"{kind} {i + 1}", exact[i], modes.frequency[k], 1e-3, "Hz", source="cosh βL cos βL = −1")
            )
    thick = clamped_modes(beam, 40)
    torsion = thick.frequency[select_modes(thick, torsion=1)[0]]
    checks.append(Check("torsion 1", np.sqrt(1e6 / 1.3) / (4 * LENGTH), torsion, 2e-3, "Hz", source="√(GJ/Ip)/4L"))
    axial = thick.frequency[select_modes(thick, axial=1)[0]]
    checks.append(Check("axial 1", np.sqrt(3e8 / 20.0) / (4 * LENGTH), axial, 2e-3, "Hz", source="√(EA/m)/4L"))

    # in time: released from a small multiple of the first mode, ten periods
    system = MultibodySystem((0.0, 0.0, 0.0))
    body = FlexibleBody.from_beam("beam", slender, modes.shape[:, :4])
    system.add(body, Joint("fixed"))
    y = system.build().initial_state()
    y[0] = 1e-3
    exact = beta[0] ** 2 * np.sqrt(2e6 / (20.0 * LENGTH**4))
    period = 2.0 * np.pi / exact
    step = period / 400.0
    integrator = HammingIntegrator(system, step)
    integrator.start(y)
    history = [y[0]]
    for _ in range(4000):
        integrator.advance()
        history.append(float(integrator.state[0]))
    deflection = np.array(history)
    up = np.flatnonzero((deflection[:-1] < 0.0) & (deflection[1:] >= 0.0))
    crossing = (up + deflection[up] / (deflection[up] - deflection[up + 1])) * step
    checks += [
        Check("period of the free vibration", period, np.diff(crossing).mean(), 1e-3, "s", source="β₁L"),
        Check("amplitude after ten periods per start", 1.0, deflection[-400:].max() / y[0], 1e-4),
    ]
    time = np.arange(len(history)) * step
    return CaseResult(checks, {"free vibration of the first mode": Figure((Curve(time, history),), "t [s]", "q")})


def circular_element_matrices(length, area, second_moment, youngs_modulus, shear_modulus, density):
    """Stiffness and consistent mass (12, 12) of the classical two-node element of circular section along z.

    Nodal coordinates (u, v, w, θx, θy, θz) twice. Bending in x–z and y–z: cubic shape functions with rotary inertia;
    extension and torsion: linear ones (Przemieniecki 1968, eqs 5.116 and 11.31 for equal second moments, no shear).
    """
    k, m = np.zeros((12, 12)), np.zeros((12, 12))
    l = length
    bending_k = youngs_modulus * second_moment / l**3
    bending_k = bending_k * np.array([[12, 6 * l, -12, 6 * l], [6 * l, 4 * l**2, -6 * l, 2 * l**2],
                                      [-12, -6 * l, 12, -6 * l], [6 * l, 2 * l**2, -6 * l, 4 * l**2]])  # fmt: skip
    along = density * area * l / 420.0
    along = along * np.array([[156, 22 * l, 54, -13 * l], [22 * l, 4 * l**2, 13 * l, -3 * l**2],
                              [54, 13 * l, 156, -22 * l], [-13 * l, -3 * l**2, -22 * l, 4 * l**2]])  # fmt: skip
    rotary = density * second_moment / (30.0 * l)
    rotary = rotary * np.array([[36, 3 * l, -36, 3 * l], [3 * l, 4 * l**2, -3 * l, -(l**2)],
                                [-36, -3 * l, 36, -3 * l], [3 * l, -(l**2), -3 * l, 4 * l**2]])  # fmt: skip
    for dofs, sign in (([0, 4, 6, 10], 1.0), ([1, 3, 7, 9], -1.0)):
        flip = np.diag([1.0, sign, 1.0, sign])  # a slope dv/dz is a turn about −x
        k[np.ix_(dofs, dofs)] += flip @ bending_k @ flip
        m[np.ix_(dofs, dofs)] += flip @ (along + rotary) @ flip
    for dofs, stiffness, inertia in (
        ([2, 8], youngs_modulus * area, density * area),
        ([5, 11], 2.0 * shear_modulus * second_moment, 2.0 * density * second_moment),
    ):
        k[np.ix_(dofs, dofs)] += stiffness / l * np.array([[1.0, -1.0], [-1.0, 1.0]])
        m[np.ix_(dofs, dofs)] += inertia * l / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
    return k, m


@case(
    "circular-element",
    "Three-dimensional two-node element of circular section",
    "Przemieniecki 1968, Theory of Matrix Structural Analysis; the element of Nada & Al-Shahrani 2019",
)
def circular_element() -> list[Check]:
    """The force-based element of this package with a circular section against the classical matrices."""
    length, diameter, e, g, rho = 0.2, 0.010, 1.17e11, 4.4e10, 8940.0
    sections = circular_sections(length, diameter, youngs_modulus=e, shear_modulus=g, density=rho)
    beam = Beam(sections, 1)
    area, second_moment = np.pi * diameter**2 / 4.0, np.pi * diameter**4 / 64.0
    k, m = circular_element_matrices(length, area, second_moment, e, g, rho)
    checks = []
    for name, exact, found in (("stiffness", k, beam.stiffness), ("mass", m, beam.mass)):
        # every entry against the size its row and column give it
        size = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
        error = float((np.abs(found - exact) / size).max())
        checks.append(
            Check(f"largest error of the {name} matrix (12 × 12) per √(diagonals)", 0.0, error, absolute(1e-9), "")
        )
    # a flap frequency through the tree in nodal coordinates, 6 elements
    system = MultibodySystem((0.0, 0.0, 0.0))
    system.add(body_from_beam("rod", Beam(sections, 6), "nodal"), Joint("fixed"))
    system.build()
    exact = 1.87510407**2 * np.sqrt(e * second_moment / (rho * area * length**4)) / (2.0 * np.pi)
    found = frequencies(system, system.initial_state(), step=1e-7)[0] / (2.0 * np.pi)
    checks.append(Check("first bending frequency of a clamped rod", exact, found, 1e-3, "Hz", source=THEORY))
    return checks
