"""The tasks of floating load reduction: terms of the reward, ends of episodes, and what an agent could exploit."""

import math
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest

from wt_gym.base.errors import InflowError
from wt_gym.envs.platform_rewards import PlatformMotion
from wt_gym.envs.record_store import CATALOG, find_record, recorded_speeds
from wt_gym.envs.rewards import HighSpeed
from wt_gym.envs.running_record import PLAN
from wt_gym.envs.sea import SeaTerm
from wt_gym.envs.terminations import Limits
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.envs.wind_sampler import WindOptions, WindSampler
from wt_gym.hydrodynamics.waves import SeaState
from wt_gym.turbines import load_turbine

OC4, VOLTURNUS = (f"wt_gym/{name}-FloatingLoadReduction-v1" for name in ("OC4", "VolturnUS"))
FLOATING = [recorded for recorded in CATALOG if recorded.turbine in ("oc4_nrel_5mw", "volturnus_iea_15mw")]


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
    for length in (300.0, 1200.0, 3e8, None):
        wind = SimpleNamespace(wind_speed=12.0)
        request = SimpleNamespace(options={}, rng=rng, wind=wind, length=length, drawn={})
        term.draw(request)
        spacings.append(np.diff(request.drawn["sea"].components.frequency).min())
    np.testing.assert_allclose(2.0 * np.pi / np.array(spacings), [600.0, 1200.0, 3600.0, 3600.0], rtol=1e-6)


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
    request = SimpleNamespace(options={"sea": "rough"}, rng=np.random.default_rng(0))
    with pytest.raises(ValueError, match=r"^sea must be None for that of the wind"):
        SeaTerm(turbine, None, False).draw(request)
    with pytest.raises(ValueError, match=r"^sea must be None for that of the wind"):
        WindTurbineEnv(turbine="oc4_nrel_5mw", sea="rough")


def test_period_of_a_sea_is_told_as_it_is(turbine, tmp_path):
    """A file, white noise and still water have not the ten seconds of a default."""
    time, file = np.arange(0.0, 600.0, 0.5), tmp_path / "waves.csv"
    file.write_text("t,z\n" + "\n".join(f"{t},{math.sin(0.9 * t)}" for t in time))
    periods = [
        SeaTerm(turbine, sea, False).sea(np.random.default_rng(0), 12.0, 300.0).first_info()["peak_wave_period"]
        for sea in (
            {"kind": "file", "file": file}, "still", {"kind": "white", "significant_height": 2.0},
            {"significant_height": 3.0, "peak_period": 8.0},
        )
    ]  # fmt: skip
    assert periods == pytest.approx([2.0 * math.pi / 0.9, 0.0, 0.0, 8.0], rel=0.02)
    given = SimpleNamespace(options={"sea": SeaState("regular", 2.0, 7.0).components(None, 200.0)},
                            rng=np.random.default_rng(0), drawn={})  # fmt: skip
    SeaTerm(turbine, None, False).draw(given)
    assert given.drawn["sea"].first_info()["peak_wave_period"] == pytest.approx(7.0)
    regular = SeaState("regular", 2.0, 8.0).components(np.random.default_rng(0), 200.0)
    assert regular.height == pytest.approx(2.0)  # not four standard deviations, 2.83 m


def test_wave_files_have_names_units_and_no_slow_content(tmp_path):
    """The mark of a spreadsheet and a line of units were no numbers; a swell of 40 s went without a word."""
    time, file = np.arange(0.0, 600.0, 0.5), tmp_path / "waves.csv"

    def written(head, elevation):
        lines = "".join(f"{t},{z}\n" for t, z in zip(time, elevation, strict=True))
        file.write_text(head + lines, encoding="utf-8")
        return SeaState("file", file=file).components(np.random.default_rng(0), 200.0)

    waves = np.sin(0.9 * time)
    for head in ("", "\ufefftime,elevation\n", "time,elevation\n(s),(m)\n"):
        tide = written(head, waves + 5.0 + 2.0 * np.sin(2.0 * np.pi / 600.0 * time))
        assert 0.5 * np.sum(tide.amplitude**2) == pytest.approx(0.5, rel=0.02)
    with pytest.raises(InflowError, match="periods up to 120 s between the cut-offs"):
        written("", waves + 3.0 * np.sin(2.0 * np.pi / 40.0 * time))
    with pytest.raises(InflowError, match="CSV file of numbers"):
        written("three\nlines\nof words\n", waves)
    with pytest.raises(InflowError, match="spreading must be None or 0 for regular waves"):
        SeaState("regular", 2.0, 10.0, spreading=2.0)


# ---- starts ----


@pytest.mark.parametrize("recorded", FLOATING, ids=lambda one: one.name)
def test_the_slow_motion_of_a_start_fits_the_wind(recorded):
    """Between two recorded winds it has the mean between them, and no more spread than they have."""
    turbine, rng = load_turbine(recorded.turbine), np.random.default_rng(0)
    (_, record), winds = (
        find_record(turbine, 1.0, recorded.controller == "floating"),
        WindSampler(turbine, WindOptions(inflow="turbulent")),
    )
    count, first = recorded.runs * PLAN.instants, recorded_speeds(turbine).tolist().index(14.0)
    beside = [np.array([record.at(turbine, (first + k) * count + i).platform for i in range(count)]) for k in (0, 1)]
    mean, spread = (0.5 * sum(f(each, axis=0) for each in beside) for f in (np.mean, np.std))
    inflows = [winds.sample(rng, wind_speed=15.0, length=300.0).inflow for _ in range(60)]
    drawn = [record.start(turbine, inflow, 15.0, 0.0, rng.random(), None, np.inf) for inflow in inflows]
    starts = np.array([start.platform for start in drawn])
    for place in (0, 4):
        assert starts[:, place].mean() == pytest.approx(mean[place], abs=0.45 * spread[place])
        assert 0.6 < starts[:, place].std() / spread[place] < 1.4


@pytest.mark.parametrize("controller", ["discon", "rosco:floating=0", "rosco:floating=2", "floating+linear_optimal"])
def test_a_controller_that_damps_the_platform_starts_as_one_that_did(controller):
    """The pitch of VolturnUS-S swings under `discon` by 2 to 4 deg, under floating feedback by less than half of it."""
    if controller.startswith("rosco"):
        pytest.importorskip("rosco")
    env = gym.make(VOLTURNUS, controller=controller, wind_speed=14.0, starts=None, relative_reward=False).unwrapped
    env.reset(seed=0)
    memory = env.starts.draw(np.random.default_rng(0), None, None).start.memory
    assert memory.kind.endswith("FloatingFeedback") == (controller[-1] in "2l")


@pytest.mark.slow
@pytest.mark.parametrize(("task", "controller"), [(OC4, "discon"), (VOLTURNUS, "floating")])
def test_the_first_minute_is_as_unsteady_as_the_later_ones(task, controller):
    """Variance over starts and time; surge had 2.5 times the settled one from records of two runs in still water."""

    def motion(seed, steps):
        env = gym.make(
            task, steps, controller=controller, wind_speed=15.0, starts=None, relative_reward=False, overspeed_limit=1.4
        )
        env.reset(seed=seed)
        rows = []
        for _ in range(steps):
            assert not env.step(np.zeros(env.action_space.shape))[2]
            signals = env.unwrapped.signals
            rows.append([signals[name] for name in ("platform_pitch", "platform_surge", "tower_base_fore_aft_moment")])
        return np.array(rows)

    first = np.array([motion(seed, 200) for seed in range(80)])
    later = np.array([motion(seed, 2700)[1350:] for seed in range(900, 916)])
    ratio = np.log(first.var(axis=(0, 1)) / later.var(axis=(0, 1)))
    np.testing.assert_array_less(np.abs(ratio), np.log([1.4, 1.7, 1.3]))  # thrice the noise of so many runs


def test_high_speed_costs_from_115_percent_on(turbine):
    rated, term = turbine.drivetrain.rated_rotor_speed, HighSpeed(2.0)
    values = [term(SimpleNamespace(turbine=turbine, after={"rotor_speed": x * rated})) for x in (1.14, 1.2)]
    assert values == pytest.approx([0.0, -1.0])


@pytest.mark.parametrize(("changes", "reason"), [
    ({}, None), ({"platform_roll": 0.2, "platform_pitch": 0.2}, "platform_tilt"),
    ({"platform_pitch": -0.27}, "platform_tilt"), ({"rotor_speed_max": 1.26}, "overspeed"),
    ({"fairlead_tension": np.array([1e6, 6.1e6, 1e6])}, "line_tension"),
])  # fmt: skip
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
    for name in (OC4, VOLTURNUS):
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


EXPLOITS = {
    "rest at a pitch that lowers the thrust": lambda k, signals: (1.0, 0.0, 0.0, 0.0),
    "slow saw-tooth of the mean": lambda k, signals: ((k % 400) / 200.0 - 1.0, 0.0, 0.0, 0.0),
    "yaw the platform out of the wind": lambda k, signals: (0.0, 0.0, 1.0, 0.0),
    "less torque": lambda k, signals: (0.0, 0.0, 0.0, -1.0),
    "switch with the roll": lambda k, signals: (0.0, 0.0, 0.0, math.copysign(1.0, signals["platform_roll_rate"])),
    "pump the platform": lambda k, signals: (-60.0 * signals["platform_pitch_rate"], 0.0, 0.0, 0.0),
}


@pytest.mark.slow
@pytest.mark.parametrize("act", EXPLOITS.values(), ids=EXPLOITS)
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
