"""The closed loop below rated: linear modes beside the controller that runs, and what replaces unstable numbers."""

import math
from dataclasses import replace

import numpy as np
import pytest

from wt_gym.base.errors import ControllerError
from wt_gym.control import Demand, operating_point
from wt_gym.control.controllers import TsrTrackingController, WindEstimator, make_controller
from wt_gym.control.controllers.own import own_law
from wt_gym.control.design import rotor_inertia
from wt_gym.control.rotor import rotor_of
from wt_gym.control.stability import LEAST_GROWTH, LoopMode, growing_mode, torque_loop_modes, winds_below_rated
from wt_gym.experiment.steady_check import DURATION
from wt_gym.turbines import ControlData, load_turbine

CATALOG = ("nrel_5mw", "nrel_5mw_monopile", "iea_15mw", "iea_15mw_monopile", "iea_22mw")
WIND = 9.0


@pytest.fixture(scope="module")
def heavy_generator():
    """The NREL 5-MW with a generator of ten times the rotor's inertia on a soft shaft, as some public models have it.

    Its torque gains place the poles of the rotor alone; the least pitch rises steeply around 9 m/s.
    """
    turbine = load_turbine("nrel_5mw")
    train, rotor = turbine.drivetrain, 3.9e7
    control = ControlData(
        optimal_tip_speed_ratio=7.55,
        torque_proportional_gain=2.0 * 0.7 * 0.2 * rotor / train.gear_ratio**2,
        torque_integral_gain=0.2**2 * rotor / train.gear_ratio**2,
        min_pitch_wind=np.array([3.0, 8.5, 9.5, 12.0]),
        min_pitch=np.radians([0.0, 0.0, 3.0, 8.0]),
        speed_filter_frequency=2.4,
        constant_power=False,
    )
    train = replace(train, generator_inertia=10.0 * rotor / train.gear_ratio**2, spring=9.0e8, damper=2.0e5)
    return replace(turbine, drivetrain=train, control=control)


def controllers(turbine):
    """That of a turbine, and the same with an estimator that reads the rotor's speed alone."""
    made = make_controller("discon", turbine)
    alone = WindEstimator.of_turbine(turbine, None, made.parameters.table)
    return made, TsrTrackingController(made.parameters, alone)


@pytest.mark.parametrize("name", CATALOG)
def test_controllers_of_the_catalog_are_stable_below_rated(name):
    turbine = load_turbine(name)
    winds = winds_below_rated(turbine)
    assert winds[0] == turbine.cut_in
    assert winds[-1] > turbine.rated_wind_speed - 2.0
    for checked in (turbine, replace(turbine, control=None)):
        made = make_controller("discon", checked)
        assert growing_mode(checked, made.parameters, getattr(made, "estimator", None)) is None


def test_torsion_that_is_taken_for_wind_grows(heavy_generator):
    own, alone = controllers(heavy_generator)
    mode = growing_mode(heavy_generator, alone.parameters, alone.estimator)
    generator = heavy_generator.drivetrain.generator_inertia * heavy_generator.drivetrain.gear_ratio**2
    rotor = rotor_inertia(heavy_generator) - generator
    torsion = math.sqrt(heavy_generator.drivetrain.spring * (1.0 / rotor + 1.0 / generator))
    assert mode.frequency == pytest.approx(torsion, rel=0.1)
    assert growing_mode(heavy_generator, own.parameters, own.estimator) is None


def simulated_growth(turbine, controller, duration=30.0, step=0.1, parts=50):
    """Growth of the torsion [1/s] under the controller as it runs, with a linear rotor behind its wake."""
    train, rotor, point = turbine.drivetrain, rotor_of(turbine), operating_point(turbine, WIND)
    where = WIND, point.rotor_speed, point.pitch
    generator, load = train.gear_ratio**2 * train.generator_inertia, train.gear_ratio / train.gearbox_efficiency
    (_, by_speed, by_pitch), induction = rotor.frozen_torque_slopes(*where)
    settled, lag = rotor.slopes(*where), 1.1 / (1.0 - 1.3 * induction) * rotor.radius / WIND
    inertia, moment = rotor_inertia(turbine) - generator, float(rotor.power(*where)[0]) / point.rotor_speed
    speed, turning, pitch, torque, wake = point.rotor_speed, point.rotor_speed, point.pitch, point.generator_torque, 0.0
    twist, time, torsion = 1.001 * load * torque / train.spring, step / parts, []
    for k in range(round(duration / step)):
        readings = {"rotor_speed": speed, "generator_speed": turning * train.gear_ratio, "generator_torque": torque}
        readings |= {f"pitch_{b}": pitch for b in (1, 2, 3)}
        if k == 0:
            controller.start(readings, Demand(np.full(3, pitch), 0.0, torque))
        made = controller.step(readings, step)
        torque, change = made.generator_torque, (float(made.pitch[0]) - pitch) / parts
        for _ in range(parts):
            pitch += change
            faster, turned = speed - point.rotor_speed, pitch - point.pitch
            towards = (settled.torque_speed - by_speed) * faster + (settled.torque_pitch - by_pitch) * turned
            wake += (towards - wake) / lag * time
            shaft = train.spring * twist + train.damper * (speed - turning)
            turning += (shaft - load * torque) / generator * time
            speed += (moment + by_speed * faster + by_pitch * turned + wake - shaft) / inertia * time
            twist += (speed - turning) * time
        torsion.append(speed - turning)
    early, late = np.split(np.array(torsion[100:]), 2)
    return math.log(np.std(late) / np.std(early)) / (len(early) * step)


def test_the_decay_is_that_of_the_controller_as_it_runs(heavy_generator, monkeypatch):
    """With short steps; the lags that stand for long ones are larger than those of this rotor on rigid blades."""
    step = 0.01
    monkeypatch.setattr("wt_gym.control.stability.INTERVAL", step)
    for made in controllers(heavy_generator):
        mode = torque_loop_modes(heavy_generator, made.parameters, WIND, made.estimator)[0]
        growth = simulated_growth(heavy_generator, made, step=step, parts=5)
        assert growth == pytest.approx(-mode.damping * mode.frequency, rel=0.1)


def test_unstable_numbers_are_replaced_with_a_note(heavy_generator):
    wild = replace(heavy_generator.control, torque_proportional_gain=1.0, torque_integral_gain=5e4)
    turbine = replace(heavy_generator, control=wild)
    with pytest.warns(UserWarning, match=r"unstable below rated: at \d+\.0 m/s a mode of .* grows at .* torque gains"):
        made = make_controller("discon", turbine)
    rule = make_controller("tsr_tracking:tip_speed_ratio=7.55", turbine).parameters
    assert made.parameters.torque_integral_gain == rule.torque_integral_gain
    np.testing.assert_array_equal(made.parameters.schedule_pitch, wild.min_pitch)
    assert "published: filter of the speed, least pitch over the wind; by rule: gains of the" in own_law(turbine)
    assert "published: filter of the speed, torque gains, least pitch" in own_law(heavy_generator)


@pytest.mark.parametrize(("factor", "grows"), [(0.9, False), (1.1, True)])
def test_a_mode_grows_by_an_e_fold_in_the_check_in_steady_winds(heavy_generator, monkeypatch, factor, grows):
    """Growth of 0.0004 to 0.001 1/s in the linear model decays in simulations of public models."""
    slow = LoopMode(WIND, 0.05, -factor / DURATION / 0.05, 0.0)
    monkeypatch.setattr("wt_gym.control.stability.torque_loop_modes", lambda *_: [slow])
    assert pytest.approx(1.0 / DURATION) == LEAST_GROWTH
    assert (growing_mode(heavy_generator, None) is slow) is grows


def test_an_unstable_torque_curve_is_refused():
    turbine = load_turbine("nrel_5mw")
    steep = replace(turbine, control=replace(turbine.control, slip=1e-4))
    with pytest.raises(ControllerError, match=r"torque curve of NREL .* unstable: at \d+\.0 m/s a mode of .* grows at"):
        make_controller("discon", steep)
