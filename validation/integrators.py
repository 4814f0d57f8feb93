"""Time integrators: stability limits, order of accuracy and energy behavior against exact values."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.special import ellipj, ellipk

from validation.case import CaseResult, Check, Curve, Figure, absolute, case
from wt_gym.base.constants import GRAVITY
from wt_gym.multibody.integrators.schemes import HammingIntegrator, make_integrator
from wt_gym.multibody.integrators.stability import hamming_matrix
from wt_gym.multibody.system import Joint, MultibodySystem
from wt_gym.structure.flexible_body import FlexibleBody

__all__ = ["amplification", "oscillator", "spectral_radius", "stability_limit"]

GROWTHS = (1e-8, 1e-6)
"""Growths in a step above which a scheme counts as unstable: a published limit, whose growth is not told, must lie
between the limits at these two. Only weak instabilities depend on it: on an undamped structure the scheme without final
step has 0.079 … 0.171 and that with one corrector pass 0.275 … 0.286; others change by less than a hundredth."""

HAMMING_TABLE = (  # corrector passes (None: converged), final step, −λh real, ωh undamped, ωh with 1 % damping
    (None, False, 2.67, 0.116, 0.84),
    (None, True, 1.29, 1.086, 1.17),
    (1, True, 0.87, 0.276, 0.68),
    (2, True, 0.72, 0.78, 0.86),
    (3, True, 1.46, 1.08, 1.10),
    (5, True, 1.76, 1.06, 1.17),
)
LINES = ("real −λh", "undamped ωh", "ωh at 1 % damping")


def oscillator(stiffness=1.0, damping=0.0):
    """Unit mass on a slide with a spring [N/m] and a damper [N s/m], without gravity."""
    system = MultibodySystem(gravity=(0.0, 0.0, 0.0))
    mass = FlexibleBody.rigid("mass", 1.0, np.zeros(3), np.eye(3))
    system.add(mass, Joint("prismatic", (1.0, 0.0, 0.0), stiffness=stiffness, damping=damping, name="slide"))
    return system.build()


def _line_system(line):
    """The system whose eigenvalue times h runs along a line of the table."""
    return {0: oscillator(0.0, 1.0), 1: oscillator(), 2: oscillator(1.0, 0.02)}[line]


def amplification(integrator, step):
    """Matrix that one step applies to everything the integrator carries, for a linear system without loads.

    Parameters
    ----------
    integrator : any of the family
    step : float
        [s].

    Returns
    -------
    array (n, n)
        n = 9 n_state for the Hamming scheme (four states, four rates, error estimate), else 2 n_state + n_velocity.
    """
    integrator.step = step
    history = integrator.history
    hamming = isinstance(integrator, HammingIntegrator)
    carried = history.y, history.f, history.memory
    sizes = [a.size for a in carried]
    cuts = np.cumsum(sizes)[:-1]
    columns = []
    for unit in np.eye(sum(sizes)):
        for array, part in zip(carried, np.split(unit, cuts), strict=True):
            array[...] = part.reshape(array.shape)
        if hamming:
            history.counters[0] = 3
        else:
            history.counters[:] = 0
        integrator.advance()
        columns.append(np.concatenate([a.ravel() for a in carried]))
    return np.array(columns).T


def spectral_radius(matrix):
    """Largest absolute eigenvalue."""
    return float(np.abs(np.linalg.eigvals(matrix)).max())


def stability_limit(radius, growth=1e-7, highest=3.0, width=0.04):
    """Smallest step at which the function radius(h) exceeds 1 + growth."""
    steps = np.arange(width, highest, width)
    high = next((h for h in steps if radius(h) > 1.0 + growth), np.inf)
    low = high - width
    while np.isfinite(high) and high - low > 1e-4:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if radius(middle) > 1.0 + growth else (middle, high)
    return high


def _eigenvalue(line, h):
    return {0: -h, 1: 1j * h, 2: h * complex(-0.01, np.sqrt(1.0 - 1e-4))}[line]


@case(
    "integrator-stability",
    "Stability limits of the modified Hamming scheme, spectral radius of the implicit schemes",
    "Gebhardt et al. 2012 with limits measured independently on y' = λy; Chung & Hulbert 1993",
)
def stability() -> CaseResult:
    """The table of limits; the default scheme of the simulator is the row of three corrector passes."""
    checks = []
    for passes, final, *limits in HAMMING_TABLE:
        label = f"{'converged' if passes is None else passes} corrector pass(es), {'' if final else 'no '}final step"
        for line, expected in enumerate(limits):
            if final:
                # a hundred passes stand for the converged corrector
                integrator = make_integrator("hamming", _line_system(line), 1.0, n_corrections=passes or 100)

                def radius(h, i=integrator):
                    return spectral_radius(amplification(i, h))
            else:

                def radius(h, k=line):
                    return spectral_radius(hamming_matrix(_eigenvalue(k, h), None, False))

            low, high = (stability_limit(radius, growth, width=0.04 if final else 0.01) for growth in GROWTHS)
            name = f"{label}: {LINES[line]}"
            if high - low < 0.01 * expected:
                checks.append(Check(name, expected, 0.5 * (low + high), 0.01))
            else:
                text = f"{name}, weak: published {expected} within the limits at growths of 1e-8 and 1e-6 a step"
                checks.append(Check(text, f"in [{low:.4f}, {high:.4f}]", expected))
    for rho in (0.0, 0.5, 0.8, 1.0):
        integrator = make_integrator("generalized_alpha", oscillator(), 1.0, rho_inf=rho, tolerance=1e-6)
        obtained = spectral_radius(amplification(integrator, 1e4))
        checks.append(Check(f"generalized-α at ωh = 10⁴, ρ∞ = {rho}", rho, obtained, absolute(5e-3)))
    central = make_integrator("newmark", oscillator(), 1.0, beta=0.0)
    limit = stability_limit(lambda h: spectral_radius(amplification(central, h)))
    checks.append(Check("central differences (β = 0): undamped ωh", 2.0, limit, 1e-3))
    h = np.linspace(0.02, 3.0, 150)
    schemes: tuple[tuple[str, str, dict[str, Any]], ...] = (
        ("modified Hamming", "hamming", {}), ("Newmark ¼, ½", "newmark", {}),
        ("generalized-α, ρ∞ = 0.8", "generalized_alpha", {"rho_inf": 0.8}),
        ("generalized-α, ρ∞ = 0", "generalized_alpha", {"rho_inf": 0.0}),
    )  # fmt: skip
    curves = []
    for label, name, options in schemes:
        integrator = make_integrator(name, oscillator(), 1.0, **options)
        radii = np.array([spectral_radius(amplification(integrator, x)) for x in h])
        curves.append(Curve(h, np.minimum(radii, 1.5), label))
    figure = Figure(tuple(curves), "ω h", "spectral radius (cut at 1.5)")
    notes = "The row without final step comes from the formulas of the scheme; all others from the compiled integrator."
    return CaseResult(checks, {"Spectral radius, undamped oscillator": figure}, notes)


# ---- order -----------------------------------------------------------------------------------------------------------

PERIOD = 4.0 * ellipk(0.5) / np.sqrt(GRAVITY)


def pendulum():
    """Point mass of 1 kg on a massless rod of 1 m, hanging at angle zero."""
    system = MultibodySystem()
    bob = FlexibleBody.rigid("bob", 1.0, (0.0, 0.0, -1.0), np.zeros((3, 3)))
    system.add(bob, Joint("revolute", (0.0, 1.0, 0.0), name="swing"))
    return system.build()


def pendulum_state(time):
    """Exact angle and rate after a release at 90°: θ = 2 asin(k sn(K − ω t, k)), k² = ½."""
    omega = np.sqrt(GRAVITY)
    sn, cn, dn, _ = ellipj(ellipk(0.5) - omega * time, 0.5)
    k = np.sqrt(0.5)
    return np.array([2.0 * np.arcsin(k * sn), -2.0 * k * omega * cn * dn / np.sqrt(1.0 - (k * sn) ** 2)])


def pendulum_error(name, n_steps, exact_history=False, duration=2.0, **options):
    """Error of angle and scaled rate after a time, with exact starting values on request (Hamming)."""
    system, h = pendulum(), duration / n_steps
    integrator = make_integrator(name, system, h, **options)
    begin, first = 0.3, 0
    integrator.start(pendulum_state(begin))
    if exact_history:
        for k in range(4):
            integrator.history.y[k] = pendulum_state(begin + k * h)
            integrator.history.f[k] = system.rates(integrator.history.y[k])
        integrator.history.counters[0], first = 3, 3
    integrator.advance(n_steps - first)
    return float(np.linalg.norm((integrator.state - pendulum_state(begin + duration)) / [1.0, np.sqrt(GRAVITY)]))


@case(
    "integrator-order",
    "Order of accuracy on the pendulum released horizontally",
    "exact solution by Jacobi's elliptic functions; orders of the schemes",
)
def order() -> CaseResult:
    """Slope of log error against log step between two steps, small enough to be in the asymptotic range.

    Hamming's corrector is of order four: its local error is −1/40 h⁵ y⁽⁵⁾, that of the predictor 14/45 h⁵ y⁽⁵⁾. The
    final step takes 9/121 of their difference away, which is the corrector's error: h⁶ remains, order five in all.
    """
    rows: tuple[tuple[str, str, dict[str, Any], float, tuple[int, ...]], ...] = (
        ("modified Hamming, exact starting values", "hamming", {"exact_history": True}, 5.0, (200, 400, 800)),
        ("modified Hamming, Runge–Kutta start", "hamming", {"starter": "runge-kutta"}, 5.0, (200, 400, 800)),
        ("modified Hamming with its starters", "hamming", {}, 3.0, (800, 1600, 3200)),
        ("Newmark ¼, ½", "newmark", {}, 2.0, (200, 400, 800)),
        ("generalized-α, ρ∞ = 0.8", "generalized_alpha", {"rho_inf": 0.8}, 2.0, (200, 400, 800)),
        ("generalized-α, ρ∞ = 0", "generalized_alpha", {"rho_inf": 0.0}, 2.0, (200, 400, 800)),
    )
    checks, curves = [], []
    for label, name, options, expected, counts in rows:
        errors = np.array([pendulum_error(name, n, **options) for n in counts])
        checks.append(Check(label, expected, np.log2(errors[-2] / errors[-1]), absolute(0.15)))
        curves.append(Curve(2.0 / np.array(counts), errors, label, "o-"))
    figure = Figure(tuple(curves), "step [s]", "error of the angle at 2 s [rad]", True, True)
    notes = (
        "The first of the published starters, a trapezoidal step, leaves an error of order h³ that stays: a run from "
        "its start converges with order 3. The corrector alone has order 4; with the final correction and a smooth "
        "motion it is 5, from exact starting values as from three Runge–Kutta steps (starter='runge-kutta')."
    )
    return CaseResult(checks, {"Convergence": figure}, notes)


# ---- energy ----------------------------------------------------------------------------------------------------------


@case(
    "integrator-energy",
    "Energy of an undamped oscillator over 1000 periods and of a pendulum over 50",
    "conservation of energy; amplification of the schemes; exact period of the pendulum",
)
def energy() -> CaseResult:
    """ω h = 0.2 (31 steps a period). Newmark: phase 2 atan(ωh/2) and no loss. The others lose what their roots say."""
    h, n_steps = 0.2, 31416
    checks = []
    for label, name, options, tolerance in (
        ("Newmark ¼, ½", "newmark", {}, 1e-6),
        ("generalized-α, ρ∞ = 1", "generalized_alpha", {"rho_inf": 1.0}, 1e-6),
    ):
        integrator = make_integrator(name, oscillator(), h, tolerance=1e-12, **options)
        integrator.start(np.array([1.0, 0.0]))
        integrator.advance(n_steps)
        kept = float(np.sum(np.square(integrator.state)))
        checks.append(Check(f"{label}: energy left of the oscillator", 1.0, kept, tolerance))
    roots = np.linalg.eigvals(hamming_matrix(1j * h, 3))
    principal = float(np.abs(roots[np.argmin(np.abs(roots - np.exp(1j * h)))]))
    integrator = make_integrator("hamming", oscillator(), h)
    integrator.start(np.array([1.0, 0.0]))
    integrator.advance(n_steps // 2)
    middle = float(np.sum(np.square(integrator.state)))
    integrator.advance(n_steps - n_steps // 2)
    obtained = (np.sum(np.square(integrator.state)) / middle) ** (0.5 / (n_steps - n_steps // 2))
    checks.append(Check("modified Hamming: amplification per step", principal, obtained, 1e-7, source="principal root"))
    phase_steps = 314
    integrator = make_integrator("newmark", oscillator(), h, tolerance=1e-12)
    integrator.start(np.array([1.0, 0.0]))
    integrator.advance(phase_steps)
    exact = np.cos(phase_steps * 2.0 * np.arctan(0.5 * h))
    checks.append(Check("Newmark: state after 314 steps", exact, integrator.state[0], 1e-6))
    curves = []
    for label, name, bound in (("modified Hamming", "hamming", 5e-5), ("Newmark ¼, ½", "newmark", 2e-3)):
        system = pendulum()
        integrator = make_integrator(name, system, PERIOD / 200.0)
        integrator.start(pendulum_state(0.0))
        start, error = sum(system.energy(integrator.state)), np.zeros(10_000)
        for k in range(len(error)):
            integrator.advance()
            error[k] = abs(sum(system.energy(integrator.state)) - start)
        quantity = f"{label}: largest energy error of the pendulum in 50 periods"
        checks.append(Check(quantity, f"<= {bound}", error.max(), unit="J", source="5e-5 J: IFToMM library, 10 s"))
        if name == "newmark":
            growth = float(error[-2000:].max() / error[:2000].max())
            checks.append(Check(f"{label}: growth of that error, last to first 10 periods", 1.0, growth, 0.02))
        curves.append(Curve(np.arange(1, len(error) + 1) / 200.0, np.maximum(error, 1e-12), label))
    figure = Figure(tuple(curves), "periods", "energy error [J]", log_y=True)
    return CaseResult(checks, {"Pendulum, 200 steps a period": figure})
