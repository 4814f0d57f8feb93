"""The tasks of floating load reduction: terms of the reward, ends of episodes, and what an agent could exploit."""

import math
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest

from wt_gym.base.errors import InflowError
from wt_gym.envs.platform_rewards import PlatformMotion
from wt_gym.envs.rewards import HighSpeed
from wt_gym.envs.sea import SeaTerm
from wt_gym.envs.terminations import Limits
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.turbines import load_turbine

OC4 = "wt_gym/OC4-FloatingLoadReduction-v1"


@pytest.fixture(scope="module")
def turbine():
    return load_turbine("oc4_nrel_5mw")


# ---- terms and limits ----


def rates(term, turbine, angles, dt=0.5):
    """Rates of a term over roll and pitch [deg]."""
    signals = [dict(zip(("platform_roll", "platform_pitch"), np.radians(pair), strict=True)) for pair in angles]
    term.reset(turbine, signals[0])
    steps = [SimpleNamespace(turbine=turbine, after=one, dt=dt) for one in signals]
    return np.array([term(step) for step in steps])


def test_platform_motion_is_priced_as_its_formula(turbine):
    time = np.arange(0.0, 600.0, 0.5)
    swing = 1.5 * np.sin(2.0 * np.pi / 26.0 * time)
    still = np.zeros_like(time)
    passed = 1.0 / math.hypot(1.0, 26.0 / (2.0 * np.pi * 60.0))
    for angles in ((still, 3.0 + swing), (swing, 3.0 + still)):  # roll for pitch is no gain
        late = rates(PlatformMotion(2.0), turbine, np.column_stack(angles))[-416:]  # whole periods
        x = passed * np.abs(swing[-416:]) / 1.5
        assert late.mean() == pytest.approx(-2.0 * np.mean(x**2 / (1.0 + x**2)), rel=0.02)
    lean = rates(PlatformMotion(2.0), turbine, np.column_stack((still, 8.0 + still)))
    assert lean == pytest.approx(np.full(len(time), -2.0 * 0.5))  # 2 deg beyond the margin
    assert rates(PlatformMotion(2.0), turbine, [(3.0, 4.0)]) == pytest.approx([0.0])
    with pytest.raises(ValueError, match="must be that of a floating turbine"):
        PlatformMotion(1.0).reset(load_turbine("nrel_5mw"), {})


def test_the_sea_of_an_episode_without_end_repeats_after_an_hour(turbine):
    """A longer one than any memory holds is asked for by runs whose duration is the only limit."""
    term, rng = SeaTerm(turbine, None, False), np.random.default_rng(2)
    spacings = []
    for length in (300.0, 1200.0, 3e8):
        request = SimpleNamespace(
            options={}, rng=rng, wind=SimpleNamespace(wind_speed=12.0), length=length, drawn={}
        )  # fmt: skip
        term.draw(request)
        spacings.append(np.diff(request.drawn["sea"].components.frequency).min())
    np.testing.assert_allclose(2.0 * np.pi / np.array(spacings), [600.0, 1200.0, 3600.0], rtol=1e-6)


def test_seas_that_are_none_are_refused(turbine):
    """A peak beyond the cut-off once left 0.16 m of 30 m without a word."""
    for sea in ({"significant_height": 30.0, "peak_period": 3.0}, {"low_cutoff": 0.7, "peak_period": 10.0}):
        with pytest.raises(InflowError, match="peak_period must lie between the cut-offs"):
            SeaTerm(turbine, sea, False)
    for sea in ({"significant_height": 0.0}, {"peak_period": 12.0}):  # neither may pass for the sea of the wind
        with pytest.raises(ValueError, match="'significant_height' above 0 m"):
            SeaTerm(turbine, sea, False)
    for value in (None, True, "wide", math.nan, 30.0):
        with pytest.raises(ValueError, match="'misalignment' must be between 0 and pi rad"):
            SeaTerm(turbine, {"misalignment": value}, False)


def test_period_of_a_sea_is_told_as_it_is(turbine, tmp_path):
    """A file, white noise and still water have not the ten seconds of a default."""
    time = np.arange(0.0, 600.0, 0.5)
    file = tmp_path / "waves.csv"
    file.write_text("t,z\n" + "\n".join(f"{t},{math.sin(0.9 * t)}" for t in time))
    periods = [
        SeaTerm(turbine, sea, False).sea(np.random.default_rng(0), 12.0, 300.0).first_info()["peak_wave_period"]
        for sea in (
            {"kind": "file", "file": file}, "still", {"kind": "white", "significant_height": 2.0},
            {"significant_height": 3.0, "peak_period": 8.0},
        )
    ]  # fmt: skip
    assert periods == pytest.approx([2.0 * math.pi / 0.9, 0.0, 0.0, 8.0], rel=0.02)


def test_high_speed_costs_from_115_percent_on(turbine):
    rated = turbine.drivetrain.rated_rotor_speed
    values = [
        HighSpeed(2.0)(SimpleNamespace(turbine=turbine, after={"rotor_speed": share * rated})) for share in (1.14, 1.2)
    ]
    assert values == pytest.approx([0.0, -1.0])


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({}, None),
        ({"platform_roll": 0.2, "platform_pitch": 0.2}, "platform_tilt"),
        ({"platform_pitch": -0.27}, "platform_tilt"),
        ({"fairlead_tension": np.array([1e6, 6.1e6, 1e6])}, "line_tension"),
        ({"rotor_speed_max": 1.26}, "overspeed"),
    ],
)
def test_limits_of_a_floater(changes, reason):
    signals = {
        "rotor_speed_max": 1.1, "rotor_speed": 1.0, "platform_roll": 0.1, "platform_pitch": 0.2,
        "fairlead_tension": np.full(3, 1e6),
    }  # fmt: skip
    limits = Limits(1.0, 1.25, 0.2, 100.0, floats=True, line_tension=6e6)
    assert limits.ending(signals | changes, clearance=1.0) == reason


def test_a_turbine_on_land_has_no_lines():
    with pytest.raises(ValueError, match="line_tension_limit must be left out for 'NREL 5-MW"):
        WindTurbineEnv(turbine="nrel_5mw", line_tension_limit=1e6)


# ---- the task ----


def test_the_wash_out_is_no_shorter_than_a_minute_and_training_looks_a_minute_ahead():
    for name in (OC4, OC4.replace("OC4", "VolturnUS")):
        env = gym.make(name).unwrapped
        assert env.options.controller.residual_washout >= 60.0
        assert env.control_dt / (1.0 - 0.995) == pytest.approx(60.0)
        assert {"platform_pitch", "platform_pitch_rate", "platform_roll"} <= set(env.observer.layout.names)
        assert not {"wave_elevation", "platform_surge"} & set(env.observer.layout.names)


@pytest.fixture(scope="module")
def env():
    """OC4 in 14 m/s with its waves; the controller alone earns what every episode is compared with."""
    return gym.make(OC4, relative_reward=False, starts=None, start="steady")


def episode(env, act, seconds=150.0):
    """Return, sums of the terms, and mean power [MW] and wave-free pitch [deg] of an episode in wind and waves."""
    env.reset(seed=3, options={"wind_speed": 14.0, "wind_seed": 1001})
    total, terms, power, lean = 0.0, {}, [], []
    for k in range(round(seconds / env.unwrapped.control_dt)):
        action = np.clip(np.asarray(act(k, env.unwrapped.signals), dtype=np.float32), -1.0, 1.0)
        _, reward, terminated, _, info = env.step(action)
        total += reward
        terms = {name: terms.get(name, 0.0) + value for name, value in info["reward_terms"].items()}
        power.append(env.unwrapped.signals["generator_power"] / 1e6)
        lean.append(math.degrees(env.unwrapped.signals["platform_pitch"]))
        if terminated:
            break
    return SimpleNamespace(total=total, terms=terms, power=np.mean(power), lean=np.mean(lean), terminated=terminated)


@pytest.fixture(scope="module")
def alone(env):
    return episode(env, lambda k, signals: np.zeros(4))


@pytest.mark.slow
@pytest.mark.parametrize(
    "act",
    [
        pytest.param(lambda k, signals: (1.0, 0.0, 0.0, 0.0), id="rest at a pitch that lowers the thrust"),
        pytest.param(lambda k, signals: ((k % 400) / 200.0 - 1.0, 0.0, 0.0, 0.0), id="slow saw-tooth of the mean"),
        pytest.param(lambda k, signals: (0.0, 0.0, 1.0, 0.0), id="yaw the platform out of the wind"),
        pytest.param(lambda k, signals: (0.0, 0.0, 0.0, -1.0), id="less torque"),
        pytest.param(
            lambda k, signals: (0.0, 0.0, 0.0, math.copysign(1.0, signals["platform_roll_rate"])),
            id="torque that switches with the roll rate",
        ),
        pytest.param(
            lambda k, signals: (-60.0 * signals["platform_pitch_rate"], 0.0, 0.0, 0.0), id="pump the platform"
        ),
    ],
)
def test_an_exploit_earns_less_than_nothing(env, alone, act):
    tried = episode(env, act)
    assert not tried.terminated
    assert tried.total < alone.total


@pytest.mark.slow
def test_an_early_end_costs_more_than_the_rest_of_an_episode(env, alone):
    """The penalty exceeds what the controller alone loses in a whole episode, by a factor."""
    assert env.unwrapped.limits.penalty > 3.0 * abs(alone.total) * 300.0 / 150.0


@pytest.mark.slow
def test_pitch_that_feeds_the_platform_back_lowers_the_price_of_its_motion(env, alone):
    """Blades that feather while the hub moves downwind; the other sign pumps the platform."""
    damped = episode(env, lambda k, signals: (25.0 * signals["platform_pitch_rate"], 0.0, 0.0, 0.0))
    assert damped.terms["platform_motion"] > alone.terms["platform_motion"]
