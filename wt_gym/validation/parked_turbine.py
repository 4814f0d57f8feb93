"""Natural frequencies of the parked NREL 5-MW turbine: which assumption each published column needs.

The published frequencies (generator locked, rotor at rest, pitch 0, no air, gravity on) come from two programs.

* FAST describes the tower by four *given* polynomials, two fore-aft and two side-side. The first fore-aft polynomial is
  not the shape in which this tower vibrates with its tower-top mass: by Rayleigh's principle its frequency is too high,
  by 3.4 %. FAST has no tower torsion; the yaw drive is a spring.
* ADAMS has elements with torsion in the tower, which lowers the modes in which the rotor turns about the vertical.

Model "FAST" below takes FAST's tower polynomials, no torsion, and the yaw spring; model "complete" takes finite-element
modes with the true tower-top inertia, tower torsion and the yaw spring. Both are otherwise the catalogue's turbine.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import eig

from wt_gym.multibody.system import Joint, MultibodySystem
from wt_gym.simulation.fidelity import FIDELITIES
from wt_gym.simulation.turbine_structure import build_structure
from wt_gym.structure.beam import Beam, BeamSections
from wt_gym.structure.flexible_body import FlexibleBody
from wt_gym.turbines import load_turbine
from wt_gym.validation.case import CaseResult, Check, case
from wt_gym.validation.tree_tools import mass_matrix, rate_jacobian, static_balance

JONKMAN = "Jonkman, Butterfield, Musial & Scott 2009, NREL/TP-500-38060, Table 9-1"
FAST_TOWER = {
    "fore_aft_1": (0.7004, 2.1963, -5.6202, 6.2275, -2.504),
    "fore_aft_2": (-70.5319, -63.7623, 289.737, -176.513, 22.0706),
    "side_side_1": (1.385, -1.7684, 3.0871, -2.2395, 0.5357),
    "side_side_2": (-121.21, 184.415, -224.904, 298.536, -135.838),
}
"""Coefficients of x² … x⁶, x = height/87.6 m, of the tower shapes of the ElastoDyn input file of this turbine."""


@dataclass(frozen=True)
class PublishedMode:
    """A row of the published table with the coordinates that recognise it.

    ``shape`` weighs coordinates by name; the mode whose mass-weighted motion fits it best carries the name.
    """

    name: str
    fast: float
    adams: float
    shape: dict


PUBLISHED = (
    PublishedMode("tower fore-aft 1", 0.3240, 0.3195, {"fore_aft_1": 1.0}),
    PublishedMode("tower side-side 1", 0.3120, 0.3164, {"side_side_1": 1.0}),
    PublishedMode("drivetrain torsion", 0.6205, 0.6094, {"shaft_torsion": 1.0}),
    PublishedMode("flap 1, asymmetric (yaw)", 0.6664, 0.6296, {"blade_2_flap_1": 1.0, "blade_3_flap_1": -1.0}),
    PublishedMode(
        "flap 1, asymmetric (pitch)",
        0.6675,
        0.6686,
        {"blade_1_flap_1": 1.0, "blade_2_flap_1": -0.5, "blade_3_flap_1": -0.5},
    ),
    PublishedMode("flap 1, collective", 0.6993, 0.7019, {f"blade_{i}_flap_1": 1.0 for i in (1, 2, 3)}),
    PublishedMode("edge 1, asymmetric (pitch)", 1.0793, 1.0740, {"blade_2_edge_1": 1.0, "blade_3_edge_1": -1.0}),
    PublishedMode(
        "edge 1, asymmetric (yaw)",
        1.0898,
        1.0877,
        {"blade_1_edge_1": 1.0, "blade_2_edge_1": -0.5, "blade_3_edge_1": -0.5},
    ),
    PublishedMode("flap 2, asymmetric (yaw)", 1.9337, 1.6507, {"blade_2_flap_2": 1.0, "blade_3_flap_2": -1.0}),
    PublishedMode(
        "flap 2, asymmetric (pitch)",
        1.9223,
        1.8558,
        {"blade_1_flap_2": 1.0, "blade_2_flap_2": -0.5, "blade_3_flap_2": -0.5},
    ),
    PublishedMode("flap 2, collective", 2.0205, 1.9601, {f"blade_{i}_flap_2": 1.0 for i in (1, 2, 3)}),
    PublishedMode("tower fore-aft 2", 2.9003, 2.8590, {"fore_aft_2": 1.0}),
    PublishedMode("tower side-side 2", 2.9361, 2.9408, {"side_side_2": 1.0}),
)


def polynomial_tower(tower):
    """Tower body in FAST's polynomial shapes, unit displacement at the top."""
    stations = tower.structure
    axis = np.column_stack([0.0 * stations.station, 0.0 * stations.station, stations.station])
    beam = Beam(BeamSections(stations.station, stations.stiffness, stations.inertia, axis), 40)
    height = stations.station[-1]
    x = beam.nodes / height
    basis = np.zeros((beam.n_dof, len(FAST_TOWER)))
    for k, (name, coefficients) in enumerate(FAST_TOWER.items()):
        polynomial = np.polynomial.Polynomial([0.0, 0.0, *coefficients])
        shape, slope = polynomial(x), polynomial.deriv()(x) / height
        # a displacement along y turns the section about −x
        move, turn, sign = (0, 4, 1.0) if name.startswith("fore") else (1, 3, -1.0)
        basis[move::6, k], basis[turn::6, k] = shape, sign * slope
    basis /= np.abs(np.vstack([basis[-6:-4]])).max(axis=0)
    return FlexibleBody.from_beam("tower", beam, basis, coordinate_names=tuple(FAST_TOWER))


def parked_modes(tower=None, yaw_spring=True, gravity=True, **fidelity):
    """Frequencies [Hz], mode shapes (n, n) and mass matrix of the parked turbine with the names of its coordinates.

    Parameters
    ----------
    tower : FlexibleBody, optional
        Takes the place of the finite-element tower.
    yaw_spring : bool
        The yaw drive yields (spring of the turbine's definition) instead of following its command.
    gravity : bool
    **fidelity
        Changes of the "engineering" fidelity, such as ``tower_modes=(2, 2, 0)``.
    """
    turbine = load_turbine("nrel_5mw")
    chosen = replace(FIDELITIES["engineering"], **({"blade_modes": (2, 1, 0)} | fidelity))
    full = build_structure(turbine, chosen, np.array([[0.0, 0.0, 10.0], [0.0, 1.0, 61.5]]))
    system = MultibodySystem((0.0, 0.0, -9.81 if gravity else 0.0))
    for body, joint, parent in zip(full.system.bodies, full.system.joints, full.system.parents, strict=True):
        if joint.name == "yaw" and yaw_spring:
            joint = Joint("revolute", joint.axis, stiffness=turbine.nacelle.yaw_spring, name="yaw")
        chosen_body = tower if tower is not None and body.name == "tower" else body
        system.add(chosen_body, joint, None if parent < 0 else parent, "tip" if parent == full.tower else "origin")
    system.build()
    names = system.velocity_names
    locked = [names.index("azimuth")]
    y = static_balance(system, system.initial_state(), locked=locked)
    free = [i for i in range(system.n_u) if i not in locked]
    mass = mass_matrix(system, y)
    stiffness = -(mass @ rate_jacobian(system, y))[np.ix_(free, free)]
    mass = mass[np.ix_(free, free)]
    value, vector = eig(stiffness, mass)
    order = np.argsort(value.real)
    return np.sqrt(value.real[order]) / (2.0 * np.pi), vector.real[:, order], mass, [names[i] for i in free]


def named_frequencies(modes):
    """Frequency of each published mode by the modal assurance criterion with the mass matrix, each mode used once.

    (pᵀ M φ)² / (pᵀ M p)(φᵀ M φ) with the pattern p: a coordinate counts with all that it carries along.
    """
    frequency, vector, mass, names = modes
    own = np.einsum("ik,ij,jk->k", vector, mass, vector)
    out, taken = {}, []
    for row in PUBLISHED:
        pattern = np.array([row.shape.get(name, 0.0) for name in names])
        fit = (pattern @ mass @ vector) ** 2 / (pattern @ mass @ pattern * own)
        fit[taken] = 0.0
        taken.append(int(fit.argmax()))
        out[row.name] = float(frequency[taken[-1]])
    return out


@case("parked-nrel-5mw", "Natural frequencies of the parked NREL 5-MW turbine", JONKMAN)
def parked_nrel_5mw():
    """First ten published modes within 3 % of the FAST column; the ADAMS column and the complete model beside them."""
    turbine = load_turbine("nrel_5mw")
    fast = named_frequencies(parked_modes(polynomial_tower(turbine.tower), tower_modes=(2, 2, 0)))
    complete = named_frequencies(parked_modes(tower_modes=(4, 4, 2), blade_modes=(4, 3, 1)))
    plain = named_frequencies(parked_modes(yaw_spring=False, tower_modes=(2, 2, 1)))
    weightless = named_frequencies(parked_modes(gravity=False, tower_modes=(4, 4, 2), blade_modes=(4, 3, 1)))
    lowest = sorted(PUBLISHED, key=lambda row: row.fast)[:10]
    checks = [
        Check(f"{row.name}, model F", row.fast, fast[row.name], 0.03, "Hz", True, "FAST column") for row in lowest
    ]
    checks += [
        Check(f"{row.name}, model C", row.adams, complete[row.name], 0.03, "Hz", True, "ADAMS column")
        for row in sorted(PUBLISHED, key=lambda row: row.adams)[:10]
    ]
    lines = [
        f"{'':28s}    FAST  model F            ADAMS  model C          no grav.  default",
        *(
            f"{row.name:28s}{row.fast:8.4f}{fast[row.name]:9.4f}{100 * (fast[row.name] / row.fast - 1):+7.1f}%"
            f"{row.adams:9.4f}{complete[row.name]:9.4f}{100 * (complete[row.name] / row.adams - 1):+7.1f}%"
            f"{weightless[row.name]:10.4f}{plain[row.name]:9.4f}"
            for row in PUBLISHED
        ),
        "Model F has FAST's tower polynomials, no tower torsion and the yaw spring.",
        "Model C has finite-element tower modes (4 + 4 + 2), 4 + 3 + 1 modes a blade and the yaw spring; 'no grav.' is",
        "model C without gravity, with which ADAMS' first two tower frequencies agree to 0.1 %.",
        "The tower's second side-side motion is shared by two modes (model C: 2.66 and 2.94 Hz, with the collective",
        "second edge mode), so that the last row depends on which of them carries the name; it is not checked.",
        "'default' is the training fidelity with the yaw drive held, which the simulator runs.",
    ]
    return CaseResult(checks, notes="\n".join(lines))
