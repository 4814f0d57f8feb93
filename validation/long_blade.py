"""The blade of the IEA 15-MW turbine as one linear floating-frame body and as a chain of eight.

The load is a thrust of 0.8 MN on the blade, a third of the rotor's near rated wind, growing linearly from the root
(root moment about 62 MN m: more outboard than in operation), with a tenth of it in the direction of rotation. It bends
the blade by 17 % of its length.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from validation.case import CaseResult, Check, Curve, Figure, absolute, case
from validation.exact_rod import BarChain, exact_rod
from validation.tree_tools import ChainPoints, static_balance
from wt_gym.multibody.arrays import MultibodyError
from wt_gym.multibody.integrators.schemes import HammingIntegrator
from wt_gym.multibody.system import Joint, MultibodySystem
from wt_gym.structure.beam import BeamSections
from wt_gym.structure.modes import ALL_DOFS
from wt_gym.structure.substructure import add_chain, cut_beam
from wt_gym.turbines import load_turbine
from wt_gym.turbines.beam import inertia_matrix

THRUST = 0.8e6
"""Flapwise load on the blade [N]."""
IEA = "IEA-15-240-RWT (Gaertner et al. 2020, NREL/TP-5000-75698), definition of the catalogue"
N_STATIONS = 32


def blade_sections():
    """Section tables of the blade along its prebent axis."""
    blade = load_turbine("iea_15mw").blade
    s = blade.structure.station
    axis = np.column_stack([np.interp(s, blade.axis_station, blade.axis[:, k]) for k in range(3)])
    return BeamSections(s, blade.structure.stiffness, blade.structure.inertia, axis)


def load_at(s: float, length: float, factor: float = 1.0) -> np.ndarray:
    """Dead load per length (3,) [N/m] at arc length s."""
    flap = 2.0 * THRUST / length * s / length
    return factor * np.array([flap, -0.1 * flap, 0.0])


class LoadedBlade:
    """A cut blade clamped at its root with point forces that stand for the distributed load.

    ``elements`` is the number of finite elements of the whole blade.
    """

    def __init__(self, sections, n_bodies, elements=16, dofs=(0, 1, 3, 4, 5), n_modes=0, damping=0.0):
        self.sub_bodies = cut_beam("blade", sections, elements, n_bodies, "modal", n_modes, dofs, damping)
        self.system = MultibodySystem((0.0, 0.0, 0.0))
        self.bodies = add_chain(self.system, self.sub_bodies, Joint("fixed"))
        self.system.build()
        length = sections.station[-1] - sections.station[0]
        edges = np.linspace(0.0, length, N_STATIONS + 1)
        middle = 0.5 * (edges[1:] + edges[:-1])
        self.force = np.array([load_at(s, length) for s in middle]) * np.diff(edges)[:, None]
        self.loaded = ChainPoints(self.system, self.sub_bodies, self.bodies, middle)
        self.shown = ChainPoints(self.system, self.sub_bodies, self.bodies, np.linspace(0.0, length, 33))

    def deflect(self, factor=1.0, steps=4):
        """State in static balance under a multiple of the load."""
        y = self.system.initial_state()
        for part in np.linspace(factor / steps, factor, steps):

            def set_loads(state, inputs, work, part=part):
                self.loaded.add_forces(state, inputs, work, part * self.force)

            y = static_balance(self.system, y, set_loads, tolerance=1e-8)
        return y


@case("iea-15mw-blade-static", "IEA 15-MW blade under its load near rated: one body against eight", IEA, slow=True)
def long_blade_static() -> CaseResult:
    """Tip position of both models against the geometrically exact rod with the same section tables."""
    sections = blade_sections()
    length = sections.station[-1]
    start = sections.axis[-1]
    source = "geometrically exact rod by shooting, same 6 × 6 section tables"
    checks, notes, curves = [], [], []
    # every vibration mode between fixed ends: the single body is the complete linear finite-element model
    single = LoadedBlade(sections, 1, n_modes=200, dofs=(0, 1, 2, 3, 4, 5))
    chain = LoadedBlade(sections, 8, n_modes=200, dofs=(0, 1, 2, 3, 4, 5))
    for factor in (0.5, 1.0, 1.5):
        _, exact, _ = exact_rod(sections, partial(load_at, length=length, factor=factor), n=300, load_steps=3)
        moved = exact[-1] - start
        tips = {}
        for name, model in (("1 body", single), ("8 bodies", chain)):
            where = model.shown.positions(model.deflect(factor))
            tips[name] = where[-1] - start
            if factor == 1.0:
                curves.append(Curve(where[:, 2], where[:, 0], name, "o" if name == "8 bodies" else "x"))
        if factor == 1.0:
            curves.append(Curve(exact[:, 2], exact[:, 0], "exact rod"))
        for axis, name in ((0, "flapwise"), (1, "edgewise"), (2, "spanwise")):
            text = f"{name} tip displacement at {factor:g} × load, 8 bodies (error per tip displacement)"
            size = np.linalg.norm(moved)
            checks.append(Check(text, moved[axis], tips["8 bodies"][axis], absolute(0.01 * size), "m",
                                source=source + "; 1 % of |u|"))  # fmt: skip
        error = tips["1 body"] - moved
        notes.append(
            f"{factor:g} × load: exact tip displacement ({moved[0]:.3f}, {moved[1]:.3f}, {moved[2]:.3f}) m = "
            f"{100 * np.linalg.norm(moved) / length:.1f} % of the length; one linear body misses it by "
            f"({error[0]:+.3f}, {error[1]:+.3f}, {error[2]:+.3f}) m = {100 * np.linalg.norm(error) / size:.2f} %, "
            f"eight bodies by {100 * np.linalg.norm(tips['8 bodies'] - moved) / size:.2f} %"
        )
    figure = Figure(tuple(curves), "z [m]", "x [m] (downwind)")
    return CaseResult(checks, {"deflected axis at 1 × load": figure}, "\n".join(notes))


# ---- dynamic ---------------------------------------------------------------------------------------------------------


def planar_sections():
    """The blade straightened and untwisted: flapwise bending stiffness and mass only (all other stiffnesses unused)."""
    full = blade_sections()
    s = full.station
    stiffness = np.array([np.diag([np.inf, np.inf, 1e10, 1e12, k, 1e9]) for k in full.stiffness[:, 4, 4]])
    inertia = inertia_matrix(full.inertia[:, 0, 0], 0.0, 0.0, 1e-4, 1e-4, 0.0)
    return BeamSections(s, stiffness, inertia, np.column_stack([0.0 * s, 0.0 * s, s]))


def released(model, factor, times, step):
    """Tip displacement (n_times, 3) after release from the deflection under a multiple of the load."""
    integrator = HammingIntegrator(model.system, step)
    integrator.start(model.deflect(factor))
    tip = np.zeros((len(times), 3))
    tip[0] = model.shown.positions(integrator.state)[-1]
    every = round((times[1] - times[0]) / step)
    energy = [sum(model.system.energy(integrator.state))]
    for k in range(1, len(times)):
        integrator.advance(every)
        tip[k] = model.shown.positions(integrator.state)[-1]
        energy.append(sum(model.system.energy(integrator.state)))
    return tip, np.array(energy)


@case(
    "iea-15mw-blade-dynamic",
    "IEA 15-MW blade released from a large flapwise deflection: one body against eight",
    "planar elastica dynamics: chain of 48 rigid bars, integrated by DOP853",
    slow=True,
)
def long_blade_dynamic() -> CaseResult:
    """Straightened blade in flap only, released from rest under 1.5 times the load, undamped, six seconds.

    Then the curved, twisted blade with its full sections: no exact motion is known, but its start and its energy are.
    """
    sections = planar_sections()
    length = sections.station[-1]
    times = np.arange(0.0, 6.0 + 1e-9, 0.05)
    factor = 1.5
    bars = BarChain(
        length,
        lambda s: np.interp(s, sections.station, sections.stiffness[:, 4, 4]),
        lambda s: np.interp(s, sections.station, sections.inertia[:, 0, 0]),
        48,
    )
    force = bars.lump(lambda s: factor * 2.0 * THRUST * s / length**2)
    angles = bars.simulate(bars.static(force), times)
    exact, axial = bars.tip(angles)
    checks, notes = [], [f"released from {exact[0]:.2f} m = {100 * exact[0] / length:.1f} % of the length"]
    curves = [Curve(times, exact, "elastica (48 bars)")]
    models = {
        "1 body": (LoadedBlade(sections, 1, dofs=(0, 4), n_modes=3), 0.0005),
        "8 bodies": (LoadedBlade(sections, 8, dofs=(0, 4), n_modes=2), 0.0001),
    }
    source, errors = "chain of 48 rigid bars", {}
    for name, (model, step) in models.items():
        tip, energy = released(model, factor, times, step)
        across = np.sqrt(np.mean((tip[:, 0] - exact) ** 2)) / np.abs(exact).max()
        along = np.sqrt(np.mean((tip[:, 2] - axial) ** 2)) / np.abs(exact).max()
        drift = np.abs(energy - energy[0]).max() / energy[0]
        notes.append(
            f"{name}: start at {tip[0, 0]:.3f} m (exact {exact[0]:.3f}), rms difference from the elastica over 6 s "
            f"{100 * across:.2f} % of the release across and {100 * along:.2f} % along; energy drift {drift:.1e}"
        )
        curves.append(Curve(times, tip[:, 0], name, "--" if name == "1 body" else ":"))
        errors[name] = across
        if name == "1 body":
            checks.append(Check("energy drift, 1 body", "<= 1e-3", drift, unit="", source="conservation of energy"))
        else:
            checks += [
                Check("start of the tip, 8 bodies", exact[0], tip[0, 0], 0.01, "m", source=source),
                Check("rms error of the tip across per release, 8 bodies", "<= 0.02", across, unit="", source=source),
                Check("rms error of the tip along per release, 8 bodies", "<= 0.02", along, unit="", source=source),
                Check("energy drift, 8 bodies", "<= 1e-3", drift, unit="", source="conservation of energy"),
            ]
    notes.append("the reference itself is within about 1 %: halving its bars moves it four times less each time")
    statement = "geometric non-linearity by substructuring: the linear body is off by what the bodies recover"
    ratio = errors["1 body"] / errors["8 bodies"]
    checks.append(Check("rms error across: 1 body / 8 bodies, at least 3", ">= 3", ratio, unit="", source=statement))
    more, figure, lines = _real_blade(times)
    figures = {"flapwise tip position after release": Figure(tuple(curves), "t [s]", "m")} | figure
    return CaseResult([*checks, *more], figures, "\n".join([*notes, *lines]))


def _real_blade(times):
    """Checks, figure and notes of the curved, twisted blade with all its section stiffnesses, undamped.

    One body cannot be released from the full load: the mass matrix, of first order in the coordinates, is no longer
    positive definite there. Both are released from a quarter of the load, eight bodies from the full load as well.
    """
    sections = blade_sections()
    length, start = sections.station[-1], sections.axis[-1]
    models = {
        "1 body": LoadedBlade(sections, 1, dofs=ALL_DOFS, n_modes=4),
        "8 bodies": LoadedBlade(sections, 8, dofs=ALL_DOFS),
    }
    checks, tips = [], {}
    for name, factor in (("1 body", 0.25), ("8 bodies", 0.25), ("8 bodies", 1.0)):
        _, exact, _ = exact_rod(sections, partial(load_at, length=length, factor=factor), n=300, load_steps=3)
        size = np.linalg.norm(exact[-1] - start)
        tip, energy = released(models[name], factor, times, 0.00025)
        tips[name, factor] = tip - start
        error = np.linalg.norm(tip[0] - exact[-1]) / size
        drift = np.abs(energy - energy[0]).max() / energy[0]
        label = f"curved, twisted blade, {factor:g} × load, {name}"
        checks += [
            Check(f"{label}: error of the start of the tip per displacement", "<= 0.01", float(error), unit="",
                  source="geometrically exact rod"),
            Check(f"{label}: energy drift", "<= 1e-3", drift, unit="", source="conservation of energy"),
        ]  # fmt: skip
    one, eight = tips["1 body", 0.25], tips["8 bodies", 0.25]
    apart = np.sqrt(np.mean(np.sum((one - eight) ** 2, axis=1))) / np.linalg.norm(eight[0])
    notes = [
        f"curved, twisted blade, 0.25 × load: one body and eight are {100 * apart:.1f} % of the release apart (rms)",
    ]
    try:
        released(models["1 body"], 1.0, times[:2], 0.00025)
    except MultibodyError as error:
        notes.append(f"curved, twisted blade, 1 × load: one body cannot be released: {error}")
    curves = tuple(
        (
            Curve(times, tip[:, 0], f"{name}, {factor:g} × load", "--" if name == "1 body" else "-")
            for (name, factor), tip in tips.items()
        )
    )
    return checks, {"flapwise tip displacement of the curved, twisted blade": Figure(curves, "t [s]", "m")}, notes
