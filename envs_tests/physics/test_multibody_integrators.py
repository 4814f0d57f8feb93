"""The family of time integrators: stability, order, energy, rotations, drives, errors."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from envs_tests.physics.cases.mechanisms import (
    amplification,
    oscillator,
    pendulum,
    pendulum_state,
    spectral_radius,
    top_state,
    top_system,
)
from wt_gym.base.errors import SimulationError
from wt_gym.base.quantities import GRAVITY
from wt_gym.multibody.arrays import MultibodyError
from wt_gym.multibody.integrators.integrator_kernels import hamming_advance
from wt_gym.multibody.integrators.schemes import (
    INTEGRATORS,
    ImplicitIntegrator,
    IntegratorEntry,
    coupled_integrator,
    make_integrator,
    method_of,
)
from wt_gym.multibody.integrators.stability import hamming_matrix, predicted_growth
from wt_gym.multibody.system import Joint, MultibodySystem
from wt_gym.simulation import Fidelity
from wt_gym.structure.flexible_body import FlexibleBody

IMPLICIT = [("newmark", {}), ("generalized_alpha", {"rho_inf": 0.8}), ("generalized_alpha", {"rho_inf": 0.0})]
EVERY = [("hamming", {}), *IMPLICIT]


def test_hamming_matches_its_formulas():
    """The compiled step has the roots of the written scheme with f evaluated again at the final state."""
    for h in (0.3, 0.9):
        expected = spectral_radius(hamming_matrix(1j * h, 3))
        found = spectral_radius(amplification(make_integrator("hamming", oscillator(), h), h))
        assert found == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("n_corrections", [0, 3])
def test_hamming_without_its_last_rate_reaches_the_same_state(n_corrections):
    """Only the rate of the newest state is left out; asked for later, it is the same."""
    system = pendulum()
    histories = []
    for last_rate in (True, False):
        integrator = make_integrator("hamming", system, 0.05)
        integrator.start(pendulum_state(1.0))
        integrator.advance(6)
        h, tail = integrator.history, (system.tree, integrator.work)
        hamming_advance(h, integrator.inputs, *tail, 0.05, 3, n_corrections, None, last_rate)
        if not last_rate:
            hamming_advance(h, integrator.inputs, *tail, 1.0, 0, 0, None, True)
        histories.append(h)
    np.testing.assert_array_equal(histories[1].y, histories[0].y)
    np.testing.assert_array_equal(histories[1].f, histories[0].f)


def test_runge_kutta_start_takes_the_inputs_at_their_times():
    """A force that grows like t on an oscillator at rest: x = t − sin t; order four and more only with the middle."""
    errors = []
    for n in (20, 40):
        integrator = make_integrator("hamming", oscillator(), 1.0 / n, starter="runge-kutta")
        integrator.inputs.dof_force[1] = 1.0
        integrator.start(np.zeros(2))
        integrator.advance(n)
        errors.append(abs(integrator.state[0] - (1.0 - np.sin(1.0))))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(5.0, abs=0.15)


def spinning_top(theta=0.4, spin=40.0):
    """Heavy top in steady precession: system, state, precession rate (root of A Ω² cos θ − C s Ω + m g l = 0)."""
    mass, length, axial, transverse = 2.0, 0.5, 0.3, 0.8
    precession = np.roots([(transverse - axial) * np.cos(theta), -axial * spin, mass * GRAVITY * length]).min()
    system = top_system(mass, length, axial, transverse)
    upright = Rotation.from_euler("y", theta).inv()
    rate = upright.apply([0.0, 0.0, precession]) + np.array([0.0, 0.0, spin])
    return system, top_state(system, theta, rate), precession


@pytest.mark.parametrize(("name", "options"), IMPLICIT[:2])
def test_rotations_by_increments(name, options):
    """Second order on the heavy top, with a unit quaternion at every step."""
    system, y, precession = spinning_top()
    errors = []
    for n in (500, 1000):
        integrator = make_integrator(name, system, 1.0 / n, **options)
        integrator.start(y)
        integrator.advance(n)
        assert np.linalg.norm(integrator.state[:4]) == pytest.approx(1.0, abs=1e-14)
        axis = Rotation.from_quat(integrator.state[[1, 2, 3, 0]]).apply([0.0, 0.0, 1.0])
        exact = [np.sin(0.4) * np.cos(precession), np.sin(0.4) * np.sin(precession), np.cos(0.4)]
        errors.append(np.linalg.norm(axis - exact))
    assert errors[1] < 1e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.2)


@pytest.mark.parametrize(("name", "options"), EVERY)
def test_servo_follows_its_command(name, options):
    """Critically damped step response 1 − (1 + ω t) e^(−ω t)."""
    system = MultibodySystem()
    system.add(FlexibleBody.rigid("wheel", 1.0, np.zeros(3), np.eye(3)), Joint("servo", servo_frequency=5.0))
    ball = FlexibleBody.rigid("ball", 1.0, np.zeros(3), np.eye(3))
    system.add(ball, Joint("revolute", stiffness=1.0), 0)
    system.build()
    integrator = make_integrator(name, system, 0.002, **options)
    integrator.inputs.servo_command[:] = 0.3
    integrator.start(system.initial_state())
    integrator.advance(250)
    expected = 0.3 * (1.0 - (1.0 + 2.5) * np.exp(-2.5))
    assert integrator.state[2] == pytest.approx(expected, abs=2e-5)


@pytest.mark.parametrize(("name", "options"), EVERY)
def test_inputs_run_linearly_through_the_steps(name, options):
    """A force that grows linearly gives a velocity t²/2: exact for every scheme of second order."""
    system = oscillator(0.0)
    integrator = make_integrator(name, system, 0.1, **options)
    integrator.inputs.dof_force[1] = 2.0
    integrator.start(np.zeros(2))
    integrator.advance(20)
    # schemes with αf average the force of a step's ends with the step before
    assert integrator.state[1] == pytest.approx(2.0, abs=0.06 if "rho_inf" in options else 1e-9)
    assert integrator.state_rate[1] == pytest.approx(2.0, abs=1e-9)


def test_stored_rate_belongs_to_the_stored_state():
    system = pendulum()
    for name in INTEGRATORS:
        integrator = make_integrator(name, system, 0.01)
        integrator.start(pendulum_state(0.0))
        integrator.advance(7)
        np.testing.assert_allclose(integrator.state_rate, system.rates(integrator.state), atol=1e-12)


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        *((name, {"step": step}, "step must be positive") for name in INTEGRATORS for step in (0.0, -0.1, np.nan)),
        ("hamming", {"step": np.inf}, "step"),
        ("hamming", {"n_corrections": 0}, "n_corrections"),
        ("hamming", {"n_corrections": 1.5}, "n_corrections"),
        ("euler", {}, "integrator must be one of hamming, newmark, generalized_alpha"),
        ("newmark", {"rho_inf": 0.5}, "does not take"),
        ("hamming", {"starter": "euler"}, "must be one of adams, runge-kutta"),
        ("newmark", {"gamma": 0.4}, "gamma >= 1/2"),
        ("newmark", {"beta": -0.1}, "beta >= 0"),
        ("newmark", {"tangent": "exact"}, "must be 'difference' or 'structure', got 'exact'"),
        ("generalized_alpha", {"rho_inf": 1.2}, "0 … 1"),
        ("newmark", {"tolerance": 0.0}, "tolerance must be positive"),
        ("newmark", {"max_iterations": 0}, "max_iterations"),
    ],
)
def test_options_without_meaning_are_refused(name, options, message):
    with pytest.raises(ValueError, match=message):
        make_integrator(name, pendulum(), **({"step": 0.01} | options))


def test_newton_that_does_not_converge_says_so():
    integrator = make_integrator("newmark", pendulum(), 0.3, max_iterations=2)
    integrator.start(pendulum_state(0.0))
    with pytest.raises(MultibodyError, match="did not converge in 2 iterations"):
        integrator.advance(50)


BEYOND = [
    ("hamming", {}, 1.2),
    ("hamming", {"n_corrections": 2}, 0.85),
    ("hamming", {"n_corrections": 1}, 0.4),
    ("newmark", {"beta": 0.0}, 2.1),
]


@pytest.mark.parametrize(("name", "options", "step"), BEYOND)
def test_step_beyond_the_stability_limit_is_refused_at_the_start(name, options, step):
    integrator = make_integrator(name, oscillator(), step, **options)
    with pytest.raises(MultibodyError, match=rf"stability limit: a motion with ω = 1 rad/s .* ω h = {step}"):
        integrator.start(np.array([1.0, 0.0]))


@pytest.mark.parametrize(("name", "options", "step"), [BEYOND[0], BEYOND[3]])
def test_instability_during_a_run_is_named_too(name, options, step):
    integrator = make_integrator(name, oscillator(), step, **options)
    integrator.start(np.array([1.0, 0.0]), check=False)
    with pytest.raises(MultibodyError, match="stability limit"):
        integrator.advance(5000)


@pytest.mark.parametrize(("passes", "step"), [(1, 0.26), (2, 0.76), (3, 1.06)])
def test_step_within_the_stability_limit_is_taken(passes, step):
    integrator = make_integrator("hamming", oscillator(), step, n_corrections=passes)
    integrator.start(np.array([1.0, 0.0]))
    integrator.advance(1000)
    assert abs(integrator.state[0]) <= 1.01


def test_falling_pendulum_is_no_unstable_scheme():
    """The upright pendulum falls: a root that grows belongs to the motion."""
    integrator = make_integrator("hamming", pendulum(), 0.02)
    integrator.start(np.array([np.pi - 1e-3, 0.0]))
    integrator.advance(100)


def test_singular_mass_is_named():
    system = MultibodySystem()
    system.add(FlexibleBody.rigid("nothing", 0.0, np.zeros(3), np.zeros((3, 3))), Joint("revolute", (1.0, 0.0, 0.0)))
    system.build()
    for name in INTEGRATORS:
        with pytest.raises(MultibodyError, match="mass matrix"):
            make_integrator(name, system, 0.01).start(system.initial_state())


# ---- registry --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", INTEGRATORS)
def test_a_coupled_simulation_gets_what_its_fidelity_says(name):
    """Of each integrator: class, options, limit of the step, and what compiled steps take."""
    fidelity, entry = Fidelity(integrator=name, corrections=2, starter="runge-kutta"), INTEGRATORS[name]
    integrator = coupled_integrator(name, pendulum(), 0.01, fidelity.scheme_settings)
    assert type(integrator) is entry.kind
    highest, longest = 100.0, fidelity.max_substep
    needed = 0.75 * 0.78 / highest if entry.explicit else longest  # the undamped limit of two passes, with its reserve
    assert fidelity.substeps_for(1.0, highest) == int(np.ceil(1.0 / min(longest, needed)))
    newton = method_of(integrator).implicit
    if entry.explicit:
        assert (integrator.n_corrections, integrator.starter) == (2, "runge-kutta")
        assert newton is None
    else:
        assert integrator.tangent == "structure"
        assert newton.difference is None
        assert newton.rough_tolerance == 100.0 * newton.tolerance
        np.testing.assert_array_equal(newton.scheme, entry.rule(fidelity.scheme_settings))


@pytest.mark.parametrize(("phase", "count"), [(0.60, 3), (0.66, 3), (0.67, 4), (0.80, 4)])
def test_three_structural_steps_are_taken_only_where_their_prediction_is_stable(phase, count):
    """The interval of the air is 0.1 s; its three steps would do for an undamped mode up to 0.75 * 1.078."""
    fidelity, highest = Fidelity(), phase / (0.1 / 3)
    assert fidelity.substeps_for(0.1, highest) == count
    assert replace(fidelity, coupling_iterations=3).substeps_for(0.1, highest) == 3
    assert predicted_growth(highest * 0.1 / count, count, 3, 2) < 0.0
    assert (predicted_growth(phase, 3, 3, 2) > 0.0) == (count == 4)


@pytest.mark.parametrize("steps", [1, 2, 4])
def test_predictions_of_other_numbers_of_steps_are_stable_in_the_whole_range(steps):
    growth = [predicted_growth(phase, steps, 3, 2) for phase in np.linspace(0.05, 0.8, 31)]
    assert max(growth) < 1e-9


class HilberHughesTaylor(ImplicitIntegrator):
    """The α method (Hilber, Hughes & Taylor 1977) in the form of the generalized-α scheme."""

    def __init__(self, system, step, alpha=0.1, tolerance=1e-9, tangent="difference", trail=0):
        scheme = 0.25 * (1.0 + alpha) ** 2, 0.5 + alpha, 0.0, alpha
        super().__init__(system, step, scheme, tolerance, 20, 1e-6, tangent, trail)


def test_a_further_integrator_is_one_entry(monkeypatch):
    """Fidelities know it and coupled simulations make and move it, with numerical damping as by its theory."""
    entry = IntegratorEntry(
        kind=HilberHughesTaylor,
        explicit=False,
        phase_limit=lambda settings: np.inf,
        options=lambda settings: {"tolerance": settings.tolerance},
        method=INTEGRATORS["newmark"].method,
        rule=lambda settings: (0.3025, 0.6, 0.0, 0.1),
    )
    monkeypatch.setitem(INTEGRATORS, "hht", entry)
    fidelity, h, alpha = Fidelity(integrator="hht", blade_bodies=2), 0.5, 0.1
    integrator = coupled_integrator("hht", oscillator(), h, fidelity.scheme_settings)
    assert method_of(integrator).implicit.scheme.tolist() == pytest.approx([0.3025, 0.6, 0.0, 0.1])
    # the balance a₁ + (1 − α) ω² u₁ + α ω² u₀ = 0 with Newmark's formulas, ω = 1, on (u, h u̇, h² a)
    beta, gamma = 0.25 * (1.0 + alpha) ** 2, 0.5 + alpha
    left = np.array([[1.0, 0.0, -beta], [0.0, 1.0, -gamma], [(1.0 - alpha) * h * h, 0.0, 1.0]])
    right = np.array([[1.0, 1.0, 0.5 - beta], [0.0, 1.0, 1.0 - gamma], [-alpha * h * h, 0.0, 0.0]])
    expected = spectral_radius(np.linalg.solve(left, right))
    assert 0.98 < expected < 0.9999
    assert spectral_radius(amplification(integrator, h)) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("copied", INTEGRATORS)
def test_fidelities_ask_the_entry_of_an_integrator_and_not_its_name(monkeypatch, copied):
    """An integrator by another name allows what its entry says: several bodies a blade, modes that follow, motions."""
    entry = INTEGRATORS[copied]
    monkeypatch.setitem(INTEGRATORS, "dummy", entry)
    assert Fidelity(integrator="dummy").takes_motion == entry.explicit
    for changes, allowed in (
        ({"blade_bodies": 2}, not entry.explicit),
        ({"blade_basis": "deformed"}, entry.keeps_states),
    ):
        if allowed:
            assert Fidelity(integrator="dummy", **changes).integrator == "dummy"
        else:
            with pytest.raises(SimulationError, match="'dummy'"):
                Fidelity(integrator="dummy", **changes)
