"""Ice on one blade: mass by the guideline, and a rotor that is out of balance by exactly that."""

from dataclasses import replace

import numpy as np
import pytest

from wt_gym.base.errors import SimulationError, TurbineDefinitionError
from wt_gym.simulation import FIDELITIES, Simulator
from wt_gym.simulation.models import blade_planform
from wt_gym.turbines import BladeIce, load_turbine
from wt_gym.turbines.blade import LIFT_LOSS, MORE_DRAG, ice_mass, iced_structure, spread
from wt_gym.turbines.variants import mirrored
from wt_gym.turbines.windio_writer import write_windio
from wt_gym.wind import SteadyInflow

TURBINE = load_turbine("nrel_5mw")
BLADE = TURBINE.blade
WIND = SteadyInflow(9.0)


def iced(blade=2, level=1.0):
    return replace(TURBINE, ice=BladeIce(blade, level))


def run(turbine, steps=60, azimuth=0.0):
    """Flapwise moments (steps, 3)."""
    simulator = Simulator(turbine, inflow=WIND)
    signals = simulator.reset(rotor_speed=1.1, pitch=0.0, azimuth=azimuth)
    found = []
    for _ in range(steps):
        signals = simulator.advance(simulator.time_step, 0.0, 0.0, signals["generator_torque"])
        found.append(signals.root_flap_moment)
    return np.array(found), simulator


def test_the_mass_is_that_of_the_guideline():
    """mu_E over the outer half and a triangle within: between the root and half the radius by hand."""
    radius, full = BLADE.root_radius + BLADE.length, ice_mass(BLADE)
    inner = full / radius * (0.25 * radius**2 - BLADE.root_radius**2)
    more = iced_structure(BLADE, 1.0).mass_moment() - BLADE.structure.mass_moment()
    assert more == pytest.approx(inner + 0.5 * full * radius, rel=2e-3)
    half = iced_structure(BLADE, 0.5).mass_moment() - BLADE.structure.mass_moment()
    assert half == pytest.approx(0.5 * more)
    np.testing.assert_allclose(spread(BLADE, np.array([0.5 * radius - BLADE.root_radius, BLADE.length])), 1.0)
    # c_max 4.65 m and a tip of some 1.5 to 2 m of the NREL 5-MW: 700 kg/m^3 * 0.00675 * c_min (c_max + c_min)
    assert 700.0 * 0.00675 * 1.4 * 6.0 < full < 700.0 * 0.00675 * 2.0 * 6.7


def test_ice_is_at_the_leading_edge():
    change = iced_structure(BLADE, 1.0).inertia - BLADE.structure.inertia
    outer = BLADE.structure.station > 0.6 * BLADE.length
    assert np.all(change[outer, 2, 3] < 0.0)  # m y_c, and y points to the trailing edge
    assert np.all(np.linalg.eigvalsh(change) > -1e-6)


def test_lift_and_drag_are_those_of_one_blade():
    aero = FIDELITIES["training"].aero
    sound, own = blade_planform(TURBINE, aero).polars, blade_planform(iced(2, 0.5), aero).polars
    n = len(sound)
    assert own.shape[0] == 3 * n
    np.testing.assert_array_equal(own[:n], sound)
    np.testing.assert_array_equal(own[2 * n :], sound)
    np.testing.assert_allclose(own[2 * n - 1, :, 0], (1.0 - 0.5 * LIFT_LOSS) * sound[-1, :, 0])
    np.testing.assert_allclose(own[2 * n - 1, :, 1], (1.0 + 0.5 * MORE_DRAG) * sound[-1, :, 1])


def test_the_rotor_weighs_what_the_ice_adds_and_is_out_of_balance():
    """First moment of the rotor about its axis: that of the ice on the one blade."""
    bodies = Simulator(iced(), inflow=WIND).structure
    first, second, third = (bodies.system.bodies[b].inertia for b in bodies.blades)
    assert first.mass == third.mass
    more = iced_structure(BLADE, 1.0)
    assert second.mass - first.mass == pytest.approx(more.mass_moment() - BLADE.structure.mass_moment(), rel=1e-3)
    assert second.c0[2] - first.c0[2] == pytest.approx(more.mass_moment(1) - BLADE.structure.mass_moment(1), rel=1e-3)


def test_whichever_blade_is_iced_the_loads_are_the_same_a_third_of_a_turn_on():
    ahead = 2.0 * np.pi / 3.0
    first, simulator = run(iced(1), azimuth=0.7)
    second, _ = run(iced(2), azimuth=0.7 - ahead)
    np.testing.assert_allclose(second[:, [1, 2, 0]], first, rtol=1e-6)
    assert first[30:, 0].mean() < 0.9 * first[30:, 1].mean()
    turned = mirrored(simulator.turbine)
    assert turned.ice == simulator.turbine.ice
    image, _ = run(turned, azimuth=0.7)
    np.testing.assert_allclose(image, first, rtol=1e-6)


def test_an_iced_turbine_is_another_model():
    _, sound = run(TURBINE, steps=1)
    state = sound.state()
    with pytest.raises(SimulationError):
        run(iced(), steps=1)[1].restore(state)


def test_what_cannot_have_ice_says_so(tmp_path):
    with pytest.raises(TurbineDefinitionError, match=r"Turbine\.ice must be None or ice on one of the 3 blades"):
        iced(4)
    with pytest.raises(TurbineDefinitionError, match=r"BladeIce.level"):
        BladeIce(1, 0.0)
    with pytest.raises(TurbineDefinitionError, match=r"Turbine\.ice must be None"):
        write_windio(iced(), tmp_path / "iced.yaml")
    fidelity = replace(FIDELITIES["training"], blade_coordinates="rigid")
    with pytest.raises(SimulationError, match=r"ice on a blade needs Fidelity.blade_bodies 1, .* got 1, 'rigid' and"):
        Simulator(iced(), inflow=WIND, fidelity=fidelity)
