"""Reward terms by hand, their bounds, and what an agent could try."""

import copy
import itertools
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import rainflow
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_numpy

from envs_tests.env.scripted_simulator import scripted_signals
from wt_gym.analysis.metrics import damage_equivalent_load
from wt_gym.control.design import reference_flap_moment, rotor_inertia
from wt_gym.envs import rewards
from wt_gym.envs.fatigue import Load, RainflowCounter
from wt_gym.envs.power import available_power
from wt_gym.envs.terms import HighPass, Transition
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.turbines import load_turbine

TURBINE = load_turbine("nrel_5mw")
RATED = TURBINE.drivetrain.rated_rotor_speed
DT = 0.2
# Betz thrust of a 126 m rotor at 11.4 m/s, 90 m above ground: 79.4 MN m.
TOWER_MOMENT = 8 / 9 * 0.5 * 1.225 * 11.4**2 * math.pi * 63**2 * 90


def signals(**changes):
    """Signals of a quiet turbine with changes."""
    values = {
        "wind_x": 20.0, "generator_power": 5e6, "rotor_speed": RATED, "generator_torque": 43e3,
        "tower_base_fore_aft_moment": 5e7,
    }  # fmt: skip
    for b in (1, 2, 3):
        values |= {f"pitch_travel_{b}": 0.0, f"tip_out_of_plane_{b}": 0.0, f"root_flap_moment_{b}": 8e6}
    return scripted_signals(values | changes)


def rate(term, before=None, **after):
    """Rate of a fresh term for a step of 0.2 s."""
    first = signals(**(before or {}))
    rewards.reset([term], TURBINE, first)
    return term(Transition(TURBINE, first, signals(**after), DT))


def course(term, samples, inflow=None, dt=DT):
    """Rates of a term over an episode whose signals are given, the starting ones first."""
    samples = [signals(**{"time": k * dt} | sample) for k, sample in enumerate(samples)]
    rewards.reset([term], TURBINE, samples[0])
    steps = itertools.pairwise(samples)
    return np.array([term(Transition(TURBINE, before, after, dt, inflow)) for before, after in steps])


# Power


@pytest.mark.parametrize(
    ("power", "value"), [(0.0, 0.0), (2.5e6, 0.5), (5e6, 1.0), (5.15e6, 1.0), (6e6, 0.66), (50e6, -1.0), (-5e6, -1.0)]
)
def test_power_above_rated_wind(power, value):
    both = {"generator_power": power}
    assert rate(rewards.Power(), before=both, **both) == pytest.approx(value)


def test_power_below_rated_is_relative_to_the_wind():
    # 8 m/s: 0.5 rho A Cp eta V^3 with the coned rotor (2.5 deg), Cp 0.482 and eta 0.944.
    available = 0.5 * 1.225 * math.pi * (63 * math.cos(math.radians(2.5))) ** 2 * 0.482 * 0.944 * 8**3
    assert available_power(TURBINE, 8.0) == pytest.approx(available, rel=1e-6)
    assert available_power(TURBINE, 12.0) == 5e6
    wind = {"wind_x": 8.0, "generator_power": available}
    assert rate(rewards.Power(), before=wind, **wind) == pytest.approx(1.0)
    idle = {"wind_x": 8.0, "generator_power": 0.0}
    assert rate(rewards.Power(weight=2.0), before=idle, **idle) == pytest.approx(2.0 * (1 - available / 5e6))


@pytest.mark.parametrize("speed", [8.0, 0.5])
@pytest.mark.parametrize("angle", [0.0, 0.5, 0.5 * math.pi, 4.0])
def test_the_disc_of_the_wind_stands_across_it(angle, speed):
    """V (1 + a y^2 + 2 a x^2) in one direction: the mean over a disc across it is V (1 + a (cos^2 + 2 sin^2) R^2/4)."""
    across = math.cos(angle) ** 2 + 2.0 * math.sin(angle) ** 2

    class Hollow:
        def velocity(self, points, time):
            direction = np.array([math.cos(angle), math.sin(angle), 0.0])
            return speed * (1.0 + 1e-4 * (points[:, 1:2] ** 2 + 2.0 * points[:, :1] ** 2)) * direction

    low = {"wind_x": speed * math.cos(angle), "wind_y": speed * math.sin(angle), "generator_power": 1e6}
    mean = speed * (1.0 + 1e-4 * across * 63.0**2 / 4.0)
    expected = 1.0 + (1e6 - available_power(TURBINE, mean)) / 5e6
    assert course(rewards.Power(), [low | {"rotor_speed": 1.0}] * 20, Hollow()) == pytest.approx(expected, rel=1e-9)


def test_wind_is_filtered_and_its_size_counts():
    term = rewards.Power(time_constant=5.0)
    low = {"wind_x": 8.0, "wind_y": 0.0, "generator_power": 1e6}
    turned = low | {"wind_x": 0.0, "wind_y": -8.0}
    assert course(term, [low, low, turned, turned]) == pytest.approx(rate(rewards.Power(), before=low, **low))
    gust = course(term, [low, *[low | {"wind_x": 9.0}] * 60])
    memory = math.exp(-DT / 5.0)
    filtered = [9.0 - memory**k for k in range(1, 61)]
    assert gust == pytest.approx([1.0 + (1e6 - available_power(TURBINE, v)) / 5e6 for v in filtered])


def kinetic_energy(speed):
    """Of rotor and generator in electrical energy [J]."""
    return 0.944 * 0.5 * rotor_inertia(TURBINE) * speed**2


def test_kinetic_energy_telescopes_over_an_episode():
    rng = np.random.default_rng(1)
    speeds = RATED * np.clip(0.9 + 0.02 * rng.standard_normal(200).cumsum() * 0.3, 0.5, 0.99)
    values = course(
        rewards.Power(), [{"rotor_speed": speed, "generator_power": 2e6, "wind_x": 10.0} for speed in speeds]
    )
    constant = 1.0 + (2e6 - available_power(TURBINE, 10.0)) / 5e6
    credit = (kinetic_energy(speeds[-1]) - kinetic_energy(speeds[0])) / 5e6
    assert DT * (values - constant).sum() == pytest.approx(credit, rel=1e-9)


def test_driving_the_rotor_with_the_generator_costs():
    """A motor of 1 MW gives the rotor 0.944 MW, worth 0.944^2 MW of electrical power."""
    energy = 0.944 * 1e6 * DT
    speed = math.sqrt(0.8**2 * RATED**2 + 2 * energy / rotor_inertia(TURBINE))
    motor = {"generator_power": -1e6, "wind_x": 5.0}
    driven = rate(rewards.Power(), before=motor | {"rotor_speed": 0.8 * RATED}, rotor_speed=speed, **motor)
    off = {"generator_power": 0.0, "wind_x": 5.0, "rotor_speed": 0.8 * RATED}
    assert driven - rate(rewards.Power(), before=off, **off) == pytest.approx(-(1.0 - 0.944**2) / 5, rel=1e-6)


# Fatigue


def blades(collective, tilt, yaw, azimuth):
    """Flapwise moments of three blades from the fixed frame."""
    angles = azimuth + 2 * np.pi * np.arange(3) / 3
    moments = collective + tilt * np.cos(angles) + yaw * np.sin(angles)
    return {"azimuth": azimuth, **{f"root_flap_moment_{b + 1}": m for b, m in enumerate(moments)}}


@pytest.mark.parametrize("fixed_frame", [0.0, 0.3, 1.0])
def test_blade_fatigue_is_the_collective_tilt_and_yaw_moment(fixed_frame):
    term = rewards.BladeFatigue(weight=1.0, scale=0.4, fixed_frame=fixed_frame)
    kept = math.exp(-DT / 10.0)
    value = rate(term, before=blades(5e6, 0, 0, 1.3), **blades(6e6, 2e6, -3e6, 1.3))
    square = (
        kept**2 * ((1 - fixed_frame) * 1e6**2 + (2e6**2 + 3e6**2) / 2) / (0.4 * reference_flap_moment(TURBINE)) ** 2
    )
    assert value == pytest.approx(-square / (1 + square), rel=1e-9)


@pytest.mark.parametrize(
    ("term", "moment", "square"),
    [
        (rewards.TowerForeAftFatigue(), {"tower_base_fore_aft_moment": 0.33 * TOWER_MOMENT}, 1.0),
        (rewards.TowerSideSideFatigue(), {"tower_base_side_side_moment": 0.08 * TOWER_MOMENT}, 1.0),
        (rewards.BladeFatigue(), blades(0.35 * 12.35e6, 0, 0, 1.3), 0.5),  # half of what is common to all blades
        (rewards.BladeFatigue(), blades(0, 0.35 * 12.35e6, 0, 1.3), 0.5),  # each blade feels its mean square
        (rewards.BladeFatigue(), blades(0, 0, 0.35 * 12.35e6, 1.3), 0.5),
    ],
)
def test_loads_at_the_scale_of_their_terms(term, moment, square):
    """0.33 and 0.08 of the moment of the Betz thrust, 0.35 of 12.35 MN m; filters of 10 s begin at zero."""
    square *= math.exp(-DT / 10.0) ** 2
    value = rate(term, before=dict.fromkeys(moment, 0.0), **moment)
    assert value == pytest.approx(-term.weight * square / (1.0 + square), rel=2e-3)


# Damage


@given(
    st_numpy.arrays(float, st.integers(1, 60), elements=st.integers(-20, 20).map(float)),
    st.sampled_from([1.0, 3.0, 4.0, 10.0]),
)
def test_streaming_rainflow_is_the_batch_one_after_every_sample(history, exponent):
    counter, previous = RainflowCounter(exponent), 0.0
    for n, value in enumerate(history, start=1):
        counter.add(value)
        if n < 3:  # where the library counts nothing
            continue
        batch = sum(count * span**exponent for span, _, count, _, _ in rainflow.extract_cycles(history[:n]))
        assert counter.damage == pytest.approx(batch, rel=1e-12)
        assert counter.damage >= previous * (1 - 1e-12)
        previous = counter.damage


def test_damage_term_sums_to_the_equivalent_load():
    rng = np.random.default_rng(2)
    n, load = 500, "root_flap_moment_2"
    moments = 8e6 + 2e6 * rng.standard_normal((n, 3)).cumsum(axis=0) * 0.2
    tower = 5e7 + 1e7 * rng.standard_normal((n, 2))
    samples = [
        {f"root_flap_moment_{b + 1}": row[b] for b in range(3)}
        | {"tower_base_fore_aft_moment": fa, "tower_base_side_side_moment": ss}
        for row, (fa, ss) in zip(moments, tower, strict=True)
    ]
    term = rewards.Damage(weight=1.0)
    paid = DT * course(term, samples).sum()
    duration = n * DT
    expected = 0.0
    for part in term.loads:
        history = np.array([sample[part.channel] for sample in samples])
        batch = damage_equivalent_load(history, duration, part.exponent)
        expected += part.share * duration * (batch / part.reference) ** part.exponent
    assert paid == pytest.approx(-expected, rel=1e-12)
    assert sum(part.share for part in term.loads) == pytest.approx(1.0)
    other = load_turbine("iea_15mw")
    term.reset(other, scripted_signals({}))
    assert term.loads[0].reference == 0.5 * reference_flap_moment(other)

    alone = rewards.Damage(weight=1.0, loads=[Load(load, 10.0, 3e6, 1.0)])
    wave = [{load: 8e6 + 1.5e6 * (-1) ** k} for k in range(1001)]
    assert DT * course(alone, wave).sum() == pytest.approx(-500.0)  # 500 cycles with the range of the reference


# Operation and other loads


@pytest.mark.parametrize(
    ("term", "before", "after", "share"),
    [
        (rewards.Overspeed, {}, {"rotor_speed": 1.22 * RATED}, 0.8),
        (rewards.TipDeflection, {}, {f"tip_out_of_plane_{b}": 0.3 * 61.5 for b in (1, 2, 3)}, 0.8),
        (rewards.TowerLoad, {}, {"tower_base_fore_aft_moment": 5e7 - 0.5 * TOWER_MOMENT * DT}, 0.8),
        (rewards.TowerLoad, {"tower_base_side_side_moment": 9e6}, {"tower_base_side_side_moment": 9e6}, 0.0),
        (rewards.TowerForeAftFatigue, {}, {"tower_base_fore_aft_moment": 1e200}, 1.0),
    ],
)
def test_penalties_away_from_the_middle(term, before, after, share):
    """x^2/(1 + x^2) at twice the scale is 0.8."""
    assert rate(term(weight=2.0), before, **after) == pytest.approx(-2.0 * share, rel=1e-3)


@pytest.mark.parametrize("dt", [0.1, 1.0])
def test_a_high_pass_filter_is_exact_for_any_step(dt):
    high_pass = HighPass(4.0, 1.0)
    assert [high_pass(3.0, dt) for _ in range(3)] == pytest.approx([2.0 * math.exp(-k * dt / 4.0) for k in (1, 2, 3)])


@pytest.mark.parametrize("term", [rewards.BladeFatigue, rewards.TowerForeAftFatigue, rewards.TowerSideSideFatigue])
def test_loads_lose_the_mean_that_they_are_reset_with(term):
    """An environment resets them with running means; they do not begin anew with the first step."""
    one, loads = term(weight=1.0), ("tower_base_fore_aft_moment", "tower_base_side_side_moment")
    high = dict.fromkeys([*loads, *(f"root_flap_moment_{b}" for b in (1, 2, 3))], 3e7)
    low = dict.fromkeys(high, 0.0)
    one.reset(TURBINE, signals(**low))
    assert one(Transition(TURBINE, signals(**high), signals(**high), DT)) < -0.01
    assert one.begins_with_means


def test_actuator_use_is_the_duty_cycle():
    term, full = rewards.ActuatorUse(weight=3.0), {f"pitch_travel_{b}": DT * TURBINE.pitch.max_rate for b in (1, 2, 3)}
    assert rate(term, **full) == pytest.approx(-1.0)
    assert rate(term, yaw_rate=-0.5 * TURBINE.nacelle.max_yaw_rate) == pytest.approx(-0.5)
    assert rate(term, generator_torque=43e3 + DT * 15e3) == pytest.approx(-1.0, rel=1e-6)
    no_yaw_drive = replace(TURBINE, nacelle=replace(TURBINE.nacelle, max_yaw_rate=0.0))
    assert term(Transition(no_yaw_drive, signals(), signals(**full), DT)) == pytest.approx(-1.5)


# The sum


@given(
    power=st.floats(-1e8, 1e8), speed=st.floats(-10, 10), moment=st.floats(-1e100, 1e100), tip=st.floats(-1e3, 1e3),
    travel=st.floats(0, 10), torque=st.floats(-1e6, 1e6), yaw_rate=st.floats(-1, 1), wind=st.floats(-80, 80),
)  # fmt: skip
def test_every_term_is_bounded(power, speed, moment, tip, travel, torque, yaw_rate, wind):
    after = signals(
        generator_power=power, rotor_speed=speed, tower_base_fore_aft_moment=moment, tip_out_of_plane_2=tip,
        root_flap_moment_1=moment, tower_base_side_side_moment=moment, pitch_travel_3=travel,
        generator_torque=torque, yaw_rate=yaw_rate, wind_x=wind,
    )  # fmt: skip
    transition = Transition(TURBINE, signals(), after, DT)
    terms = rewards.compose({"tip_deflection": 0.1, "tower_load": 0.2})
    rewards.reset(terms, TURBINE, signals())
    total, values = rewards.total(terms, transition)
    for term in terms:
        highest = 2.0 * term.weight if term.name == "power" else 0.0
        assert -DT * term.weight * (1 + 1e-12) <= values[term.name] <= DT * highest
    assert total == pytest.approx(sum(values.values()))
    assert total >= DT * rewards.worst_rate(terms) * (1 + 1e-12)


def test_ending_early_never_pays():
    terms = rewards.compose(None)
    assert rewards.worst_rate(terms) == pytest.approx(-5.0)
    discounted_worst = rewards.worst_rate(terms) * DT / (1 - 0.99)
    assert -WindTurbineEnv(turbine=TURBINE).limits.penalty < discounted_worst
    assert rewards.worst_rate(rewards.compose({"damage": 0.1})) == -math.inf
    idle = {"generator_power": 0.0, "generator_torque": 0.0, "rotor_speed": 0.3 * RATED}
    rewards.reset(terms, TURBINE, signals(**idle))
    assert rewards.total(terms, Transition(TURBINE, signals(**idle), signals(**idle), DT))[0] == 0.0


def noisy_course(terms, seed, steps=30):
    """Rewards of a course of random moments from a start that does not depend on the seed."""
    rng = np.random.default_rng(seed)
    values, before = [], signals()
    for k in range(1, steps + 1):
        after = signals(
            time=k * DT, wind_x=rng.uniform(5, 15), tower_base_fore_aft_moment=rng.uniform(0, 1e8),
            tower_base_side_side_moment=rng.uniform(-1e7, 1e7), root_flap_moment_2=rng.uniform(0, 1e7),
            rotor_speed=RATED * rng.uniform(0.7, 1.1), azimuth=rng.uniform(0, 6.28),
        )  # fmt: skip
        values.append(rewards.total(terms, Transition(TURBINE, before, after, DT, demanded_power=4e6))[0])
        before = after
    return values


ALL_TERMS = dict.fromkeys(rewards.DEFAULT_WEIGHTS.keys() - {"platform_motion"}, 0.5)


def test_reset_forgets_everything_and_a_deep_copy_is_a_snapshot():
    terms, fresh = rewards.compose(ALL_TERMS), rewards.compose(ALL_TERMS)
    for _ in range(2):
        rewards.reset(terms, TURBINE, signals(), demanded_power=4e6)
        first = noisy_course(terms, seed=0)
        assert first == noisy_course(fresh, seed=0)  # as if started by the first transition
        fresh, snapshot = rewards.compose(ALL_TERMS), copy.deepcopy(terms)
        assert noisy_course(terms, seed=1) == noisy_course(copy.deepcopy(snapshot), seed=1)


def steady(step):
    """A rate."""
    return -2.0 * step.after["rotor_speed"]


def test_names_functions_and_terms_make_rewards():
    def terms(reward):
        return [(term.name, term.weight) for term in rewards.compose(reward)]

    assert terms("power") == terms(["power"]) == [("power", 1.0)]
    assert terms("blade_fatigue") == [("blade_fatigue", 1.5)]
    assert terms("damage") == [("damage", 1.0)]  # of weight 0 unless it is asked for
    assert terms(steady) == [("steady", 1.0)]
    assert terms(rewards.Power(weight=2.0)) == [("power", 2.0)]
    mixed = ["power", steady, rewards.Overspeed(), rewards.FunctionTerm(steady, 0.5, "half"), lambda step: 0.0]
    assert [name for name, _ in terms(mixed)] == ["power", "steady", "overspeed", "half", "function"]
    assert rewards.worst_rate(rewards.compose(steady)) == -math.inf


@pytest.mark.parametrize(
    ("reward", "message"),
    [
        ("powr", r"no term 'powr'; did you mean 'power'\? There are power, "),
        ([], "reward"),
        ([steady, steady], "different names"),
        (3.0, "must map names of terms to weights, or be a name, a function"),
        ([3.0], "a reward term needs a name"),
        ([SimpleNamespace(name="still", weight=1.0)], "must be callable"),
        ({"power": -1.0}, "weight of reward term 'power' must be finite and not negative, got -1"),
        (dict.fromkeys(rewards.DEFAULT_WEIGHTS, 0.0), "reward"),
    ],
)
def test_wrong_rewards_are_refused(reward, message):
    with pytest.raises(ValueError, match=message):
        rewards.compose(reward)


def test_a_function_is_called_with_the_step():
    transition = Transition(None, None, {"rotor_speed": 1.5}, DT)
    assert rewards.total(rewards.compose(steady), transition) == (-3.0 * DT, {"steady": -3.0 * DT})
    with pytest.raises(ValueError, match="reward function 'function' must give a finite rate"):
        rewards.total(rewards.compose(lambda step: math.nan), transition)
