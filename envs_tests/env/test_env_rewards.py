"""Reward terms by hand, and their bounds."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wt_gym.constants import GRAVITY
from wt_gym.envs import rewards
from wt_gym.envs.observations import blade_static_moment, reference_flap_moment
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.turbines import load_turbine

TURBINE = load_turbine("nrel_5mw")
RATED = TURBINE.drivetrain.rated_rotor_speed


def signals(**changes):
    """Signals of a quiet turbine with changes."""
    values = {
        "generator_power": 5e6,
        "rotor_speed": RATED,
        "generator_torque": 43e3,
        "yaw_rate": 0.0,
        "tower_base_fore_aft_moment": 5e7,
        "tower_base_side_side_moment": 0.0,
    }
    for b in (1, 2, 3):
        values |= {f"pitch_rate_{b}": 0.0, f"tip_out_of_plane_{b}": 0.0}
    return values | changes


def rate(term, before=None, **after):
    """Rate of a term for a step of 0.2 s."""
    return term(rewards.Transition(TURBINE, signals(**(before or {})), signals(**after), 0.2))


@pytest.mark.parametrize(
    ("power", "value"), [(0.0, 0.0), (2.5e6, 0.5), (5e6, 1.0), (6e6, 0.6), (20e6, -1.0), (-5e6, -1.0)]
)
def test_power(power, value):
    assert rate(rewards.Power(), generator_power=power) == pytest.approx(value)


def test_tip_deflection():
    reference = 0.15 * 61.5
    assert rate(rewards.TipDeflection(weight=0.3), tip_out_of_plane_1=reference) == pytest.approx(-0.3 * 0.5 / 3)
    assert rate(rewards.TipDeflection(), tip_out_of_plane_1=-3.0) == 0.0


def test_tower_load():
    # Betz thrust of a 126 m rotor at 11.4 m/s, 90 m above ground: 79.4 MN m.
    reference = 8 / 9 * 0.5 * 1.225 * 11.4**2 * math.pi * 63**2 * 90
    change = 0.25 * reference * 0.2
    term = rewards.TowerLoad(weight=1.0)
    assert rate(term, tower_base_fore_aft_moment=5e7 + change) == pytest.approx(-0.5, rel=1e-3)
    assert rate(term, tower_base_side_side_moment=change) == pytest.approx(-0.5, rel=1e-3)
    assert rate(term) == 0.0


def test_actuator_use_is_the_duty_cycle():
    term = rewards.ActuatorUse(weight=3.0)
    full = {f"pitch_rate_{b}": TURBINE.pitch.max_rate for b in (1, 2, 3)}
    assert rate(term, **full) == pytest.approx(-1.0)
    assert rate(term, yaw_rate=-0.5 * TURBINE.nacelle.max_yaw_rate) == pytest.approx(-0.5)
    assert rate(term, generator_torque=43e3 + 0.2 * 15e3) == pytest.approx(-1.0, rel=1e-6)


def test_actuator_use_without_yaw_drive():
    fixed = replace(TURBINE, nacelle=replace(TURBINE.nacelle, max_yaw_rate=0.0))
    full = {f"pitch_rate_{b}": TURBINE.pitch.max_rate for b in (1, 2, 3)}
    transition = rewards.Transition(fixed, signals(), signals(**full), 0.2)
    assert rewards.ActuatorUse(weight=1.0)(transition) == pytest.approx(-0.5)


def test_overspeed():
    term = rewards.Overspeed(weight=1.0)
    assert rate(term, rotor_speed=1.02 * RATED) == 0.0
    assert rate(term, rotor_speed=1.12 * RATED) == pytest.approx(-0.5)


@given(
    power=st.floats(-1e8, 1e8), speed=st.floats(-10, 10), moment=st.floats(-1e10, 1e10), tip=st.floats(-1e3, 1e3),
    pitch_rate=st.floats(-10, 10), torque=st.floats(-1e6, 1e6), yaw_rate=st.floats(-1, 1),
)  # fmt: skip
def test_every_term_is_bounded_by_its_weight(power, speed, moment, tip, pitch_rate, torque, yaw_rate):
    after = signals(
        generator_power=power, rotor_speed=speed, tower_base_fore_aft_moment=moment, tip_out_of_plane_2=tip,
        pitch_rate_3=pitch_rate, generator_torque=torque, yaw_rate=yaw_rate,
    )  # fmt: skip
    transition = rewards.Transition(TURBINE, signals(), after, 0.2)
    for term in rewards.compose(None):
        assert abs(term(transition)) <= term.weight * (1 + 1e-12)
    total, values = rewards.total(rewards.compose(None), transition)
    assert total == pytest.approx(sum(values.values()))
    assert total >= 0.2 * rewards.worst_rate(rewards.compose(None)) * (1 + 1e-12)


def test_ending_early_never_pays():
    terms = rewards.compose(None)
    assert rewards.worst_rate(terms) == pytest.approx(-2.0)
    discounted_worst = rewards.worst_rate(terms) * 0.2 / (1 - 0.99)
    assert -WindTurbineEnv(turbine=TURBINE).termination_penalty < discounted_worst


def test_terms_of_ones_own():
    class Constant:
        name, weight = "constant", 2.0

        def __call__(self, transition):
            return 2.0

    terms = rewards.compose([rewards.Power(), Constant()])
    total, values = rewards.total(terms, rewards.Transition(TURBINE, signals(), signals(), 0.5))
    assert values == {"power": 0.5, "constant": 1.0}
    assert total == 1.5


@pytest.mark.parametrize("reward", [[], [rewards.Power(), rewards.Power()], ["power"], {name: 0.0 for name in
    ("power", "tip_deflection", "tower_load", "actuator_use", "overspeed")}])  # fmt: skip
def test_impossible_rewards_are_refused(reward):
    with pytest.raises(ValueError, match="reward"):
        rewards.compose(reward)


def test_reference_loads_of_the_nrel_5mw():
    # 17 740 kg with the centre of mass 20.475 m from the root (NREL/TP-500-38060, Table 2-2).
    assert blade_static_moment(TURBINE) == pytest.approx(17_740 * GRAVITY * 20.475, rel=0.01)
    assert reference_flap_moment(TURBINE) == pytest.approx(12.35e6, rel=1e-3)
