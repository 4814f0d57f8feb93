"""A turbine's own controller: what its file says is used, any other turbine is controlled by rule, both are checked."""

import math
import shutil
import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from wt_gym.base.errors import ControllerError, TurbineDefinitionError
from wt_gym.control import Demand, operating_point
from wt_gym.control.controllers import TsrTrackingController, make_controller
from wt_gym.control.controllers.discon import BaselineParameters, DisconController, GainTable, PitchLaw
from wt_gym.control.controllers.own import own_parameters
from wt_gym.control.design import rotor_inertia
from wt_gym.control.rotor import rotor_of
from wt_gym.control.sensors import SecondOrderLowPass
from wt_gym.control.stability import check_speed_loop, checked_winds, gust_speed_rise, speed_loop_modes
from wt_gym.turbines import load_turbine
from wt_gym.turbines.catalog import turbine_file
from wt_gym.wind.iec import turbulence_sigma

CATALOG = ("nrel_5mw", "nrel_5mw_monopile", "iea_15mw", "iea_15mw_monopile", "iea_22mw")


# ---- what the file says ----


def test_control_section_of_the_22mw():
    """Numbers of windIO's file, by hand: deg/rpm to s is 1/6, N m/rpm to N m s is 30/pi; the drive is direct."""
    own = load_turbine("iea_22mw").control
    assert own.gain_pitch[0] == pytest.approx(math.radians(6.932789321))
    assert own.pitch_proportional_gain[0] == pytest.approx(5.1048 / 6)
    assert own.pitch_integral_gain[0] == pytest.approx(0.26094 / 6)
    assert own.torque_proportional_gain == pytest.approx(6759000.4585 * 30 / math.pi)
    assert own.torque_integral_gain == pytest.approx(1134397.69128 * 30 / math.pi)
    assert own.region_2_gain == pytest.approx(810380.0579 * (30 / math.pi) ** 2)
    assert math.degrees(own.min_pitch.min()) == pytest.approx(-1.283425461)
    assert (own.constant_power, own.speed_filter_frequency, own.speed_filter_damping) == (True, 0.91328, None)
    # 240.648348 N m/rpm^2 of a rotor behind a gearbox of 97 (the JSON beside the file has more digits)
    own = load_turbine("nrel_5mw").control
    assert own.region_2_gain == pytest.approx(240.648348 * (30 / math.pi) ** 2 / 97**2, rel=1e-5)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not JSON"),
        ("[1]", "must be a JSON object"),
        ('{"kp": 1}', "keys must be among .*; got 'kp'"),
        ('{"fine_pitch_deg": "x"}', "must be numbers"),
        ('{"gain_doubling_pitch": 0.1}', "None unless gain_pitch is"),
        ('{"fine_pitch_deg": 1.5, "natural_frequency": 0.4}', None),
    ],
)
def test_constants_beside_a_file_are_checked_and_used(text, message, tmp_path):
    path = tmp_path / "mine.yaml"
    shutil.copy(turbine_file("nrel_5mw"), path)
    (tmp_path / "mine.control.json").write_text(text, encoding="utf-8")
    if message is not None:
        with pytest.raises(TurbineDefinitionError, match=message):
            load_turbine(path)
    else:
        assert BaselineParameters.from_turbine(load_turbine(path)).min_pitch == pytest.approx(math.radians(1.5))


# ---- which controller ----


def test_published_gains_serve_the_turbines_that_have_them():
    controller = make_controller("discon", load_turbine("iea_22mw"))
    assert isinstance(controller, TsrTrackingController)
    p, own = controller.parameters, load_turbine("iea_22mw").control
    assert p.torque_gain == own.torque_proportional_gain
    assert p.baseline.gain_table.proportional[0] == own.pitch_proportional_gain[0]
    assert p.speed_per_wind == pytest.approx(9.15 / 142.0)
    np.testing.assert_array_equal(p.schedule_pitch, own.min_pitch)
    fifteen = make_controller("discon", load_turbine("iea_15mw")).parameters.baseline
    assert (fifteen.corner_frequency, fifteen.filter_damping, fifteen.constant_power) == (1.0081, 0.7, False)
    assert p.baseline.filter_damping == 0.0
    assert isinstance(make_controller("discon", load_turbine("nrel_5mw")), DisconController)
    assert isinstance(make_controller("discon", replace(load_turbine("iea_22mw"), control=None)), DisconController)


@pytest.mark.parametrize("dt", [0.05, 0.3])
def test_second_order_filter_is_exact_for_any_step(dt):
    made = SecondOrderLowPass(1.0081, 0.7)
    made.reset(2.0)
    time = dt * np.arange(1, 30)
    found = [made.update(5.0, dt) for _ in time]
    _, exact = signal.step(([1.0081**2], [1.0, 2 * 0.7 * 1.0081, 1.0081**2]), T=np.concatenate([[0.0], time]))
    np.testing.assert_allclose(found, 2.0 + 3.0 * exact[1:], rtol=1e-6)


def test_gains_of_the_pitch_law_halve_and_its_integral_holds_and_moves_the_demand():
    """GK = 1 / (1 + θ / θ_K); the demand is GK (k_p e + k_i ∫e), within limits that the integral does not pass."""
    law = PitchLaw(0.8, 0.1, 0.2)
    assert (law.gains(0.0), law.gains(0.2)) == (pytest.approx((0.8, 0.1)), pytest.approx((0.4, 0.05)))
    pitch, integral = law.step(0.2, 5.0, 0.02, 0.5, 0.0, 1.5)
    assert integral == pytest.approx(5.0 + 0.02 * 0.5)
    assert pitch == pytest.approx(0.5 * (0.8 * 0.02 + 0.1 * integral))
    for error in (0.0, -0.03):
        held, _ = law.step(0.3, law.holding(0.3, error), error, 0.0, 0.0, 1.5)
        assert held == pytest.approx(0.3)
    assert law.holding(0.3) == pytest.approx(law.holding(0.3, 0.0))
    moved, _ = law.step(0.25, law.moved(0.2, 0.05, law.holding(0.2)), 0.0, 0.0, 0.0, 1.5)
    assert moved == pytest.approx(0.25)
    for error, limit in ((-9.0, 0.1), (9.0, 0.4)):
        pitch, integral = law.step(0.2, law.holding(0.2), error, 5.0, 0.1, 0.4)
        assert (pitch, law.factor(0.2) * 0.1 * integral) == (pytest.approx(limit), pytest.approx(limit))


def test_with_a_table_the_integral_of_the_pitch_law_is_a_pitch():
    law = PitchLaw(1.0, 1.0, 1.0, GainTable((0.0,), (0.8,), (0.1,)))
    pitch, integral = law.step(0.2, 0.15, 0.02, 0.5, 0.0, 1.5)
    assert integral == pytest.approx(0.15 + 0.1 * 0.02 * 0.5)
    assert pitch == pytest.approx(0.8 * 0.02 + integral)
    assert law.step(0.3, law.holding(0.3, -0.03), -0.03, 0.0, 0.0, 1.5)[0] == pytest.approx(0.3)
    assert law.moved(0.3, 0.05, 0.3) == pytest.approx(0.35)


def test_a_table_of_gains_does_not_move_the_demand():
    """Where the integral gain changes fivefold over the pitch, a speed at its reference holds the pitch."""
    law = PitchLaw(1.0, 1.0, 1.0, GainTable((0.0, 0.2), (1.0, 0.5), (0.01, 0.05)))
    pitch = integral = law.holding(0.1)
    for _ in range(50):
        pitch, integral = law.step(pitch, integral, 0.0, 0.1, 0.0, 1.0)
    assert pitch == pytest.approx(0.1)
    moved, _ = law.step(0.1, law.moved(0.1, 0.03, law.holding(0.1)), 0.0, 0.1, 0.0, 1.0)
    assert moved == pytest.approx(0.13)
    with pytest.raises(ControllerError, match="integral gains of a table must be positive"):
        GainTable((0.0, 0.2), (1.0, 0.5), (0.01, 0.0))


def test_least_pitch_follows_the_estimated_wind():
    turbine = load_turbine("iea_22mw")
    controller = make_controller("discon", turbine)
    speed = 9.15 * 10.0 / 142.0
    torque = 0.9 * controller.estimator.table.torque(10.0, speed, 0.0)
    now = {"generator_speed": speed, "rotor_speed": speed, "generator_torque": torque}
    now |= {f"pitch_{b}": 0.0127 for b in (1, 2, 3)}
    controller.start(now, Demand(np.full(3, 0.0127), 0.0, torque))
    for _ in range(600):
        demand = controller.step(now, 0.1)
    own = turbine.control
    assert demand.pitch[0] == pytest.approx(np.interp(controller.wind, own.min_pitch_wind, own.min_pitch), abs=1e-4)


def test_a_published_set_point_smoother_holds_the_torque_in_a_lull():
    """At 6 deg above the least pitch and 7 % below rated speed ROSCO's shift, 0.105/0.524, exceeds the lull."""
    turbine = load_turbine("iea_22mw")
    shifts = {"speed_shift_per_pitch": 1.0 / 0.524, "speed_shift_per_power": 0.001, "speed_shift_frequency": 0.6283}
    least = {}
    for name, control in (("rule", turbine.control), ("published", replace(turbine.control, **shifts))):
        controller = make_controller("discon", replace(turbine, control=control))
        p = controller.parameters
        now = {"rotor_speed": p.rated_speed, "generator_speed": p.rated_speed, "generator_torque": p.rated_torque}
        for pitch in (0.2, None):  # the first start finds the wind
            pitch = controller._least_pitch() + 0.105 if pitch is None else pitch
            now |= {f"pitch_{b}": pitch for b in (1, 2, 3)}
            controller.start(now, Demand(np.full(3, pitch), 0.0, p.rated_torque))
        torques = []
        for k in range(60):
            speed = p.rated_speed * max(1.0 - 0.0014 * k, 0.93)
            demand = controller.step(now | {"rotor_speed": speed, "generator_speed": speed}, 0.1)
            torques.append(demand.generator_torque / p.rated_torque)
        least[name] = min(torques)
    assert least["published"] == pytest.approx(1.0)
    assert least["rule"] < 0.97


# ---- parameters by name ----


def test_discon_takes_parameters_by_name():
    turbine = load_turbine("nrel_5mw")
    parameters = make_controller("discon:kp=0.03,corner_frequency=1.2", turbine).parameters
    assert (parameters.proportional_gain, parameters.corner_frequency) == (0.03, 1.2)
    assert parameters.integral_gain == 0.008068634
    slower = make_controller("discon:natural_frequency=0.3", turbine).parameters
    assert slower.integral_gain == pytest.approx(0.25 * 0.008068634, rel=5e-3)
    gain = make_controller("discon+ipc:tip_speed_ratio=8.0", turbine).base.parameters.torque.region_2_gain
    assert gain == pytest.approx(2.332287 * (7.55 / 8.0) ** 3)
    large = load_turbine("iea_22mw")  # gains of a table keep their ratio
    table, changed = own_parameters(large).gain_table, own_parameters(large, kp=0.5).gain_table
    expected = 0.5 / table.proportional[0] * np.array(table.proportional)
    np.testing.assert_allclose(changed.proportional, expected, rtol=1e-12)
    assert changed.integral == table.integral


# ---- the check of the closed loop ----


@pytest.mark.parametrize("name", CATALOG)
def test_controllers_of_the_catalog_pass_the_check(name):
    turbine = load_turbine(name)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for checked in (turbine, replace(turbine, control=None)):
            report = check_speed_loop(checked, BaselineParameters.from_turbine(checked))
            assert max(np.diff(checked_winds(checked))) <= 1.0
            assert checked_winds(checked)[-1] == pytest.approx(checked.cut_out)
            assert report.pitch_rate < 1.0
            assert 0.02 < report.speed_rise < 0.25


@pytest.mark.parametrize(
    ("frequency", "turbine", "message"),
    [  # 0.6 rad/s, the frequency of the NREL 5-MW, makes the rotor of the 22-MW swing
        (0.6, "iea_22mw", r"IEA 22MW.*rad/s with a damping ratio of \+0\.1.*at least 0.15"),
        (0.04, "iea_15mw", r"IEA 15MW.* raise the rotor speed by \d\d % of rated, more than 25 %"),
    ],
)
def test_a_loop_that_swings_or_is_slow_is_warned_of(frequency, turbine, message):
    with pytest.warns(UserWarning, match=message):
        make_controller(f"discon:natural_frequency={frequency}", load_turbine(turbine))


def test_an_unstable_loop_is_refused():
    turbine = load_turbine("nrel_5mw")
    # Routh on J s^2 (s + c) + Q N c (kp s + ki) = 0: unstable where ki > kp c, but for the little that the rotor damps
    with pytest.raises(ControllerError, match="must be positive: choose smaller gains"):
        make_controller("discon:ki=0.2", turbine)


def test_the_loop_has_the_poles_that_its_gains_place_and_their_rise(monkeypatch):
    """With fast filter, frozen tower and the rotor's own damping known: s^2 + (2 zeta w + d) s + w^2.

    With hardly a delay a gust raises the speed, ``w' = (dQ - c w - k int w)/J``, by at most
    ``dQ/(J w_n) exp(-zeta/sqrt(1 - zeta^2) acos(zeta))``.
    """
    turbine, wind = load_turbine("nrel_5mw"), 18.0
    point, inertia = operating_point(turbine, wind), rotor_inertia(turbine)
    slopes = rotor_of(turbine).slopes(wind, point.rotor_speed, point.pitch)
    table = GainTable((0.0,), (0.004,), (0.004,))
    parameters = replace(own_parameters(turbine), corner_frequency=200.0, gain_table=table)

    def rotor_mode():
        return next(mode for mode in speed_loop_modes(turbine, parameters, wind) if mode.tower_share < 0.5)

    rotor, frequency = rotor_mode(), math.sqrt(-slopes.torque_pitch * 97 * 0.004 / inertia)
    assert rotor.frequency == pytest.approx(frequency, rel=0.1)
    power = 97.0 * point.generator_torque / point.rotor_speed  # constant power feeds: -P/w^2
    damping = (-slopes.torque_pitch * 97 * 0.004 - slopes.torque_speed - power) / inertia
    assert rotor.damping == pytest.approx(damping / (2 * frequency), rel=0.15)
    monkeypatch.setattr("wt_gym.control.stability.INTERVAL", 0.005)
    rotor = rotor_mode()
    rise = slopes.torque_wind * turbulence_sigma(wind, "B") / (inertia * rotor.frequency)
    rise *= math.exp(-rotor.damping / math.sqrt(1.0 - rotor.damping**2) * math.acos(rotor.damping))
    rated = turbine.drivetrain.rated_rotor_speed
    assert gust_speed_rise(turbine, parameters, wind) == pytest.approx(rise / rated, rel=0.1)


@pytest.mark.parametrize("choice", ["min_pitch=0.02", "region_3_min_pitch=0.02", "region_2_gain=1e7"])
def test_what_only_a_torque_curve_has_is_refused_elsewhere(choice):
    with pytest.raises(ValueError, match=r"must be left out for IEA 22MW .* torque curve"):
        make_controller(f"discon:{choice}", load_turbine("iea_22mw"))
