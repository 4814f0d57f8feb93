"""Modes of action, base controllers, tasks, snapshots: on the real simulator."""

import copy
import warnings

import gymnasium as gym
import numpy as np
import pytest
from turbine_contract import both_checkers_are_content

from wt_gym.base.errors import SimulationError
from wt_gym.control.controllers.names import make_controller
from wt_gym.control.sensors import to_fixed_frame
from wt_gym.envs import rewards
from wt_gym.envs.dial import factor_of
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.experiment.benchmark import make_env
from wt_gym.experiment.benchmark_tasks import load_task
from wt_gym.experiment.environments import Environments
from wt_gym.experiment.run import run_baseline
from wt_gym.learning.hyperparameters import hyperparameters_for
from wt_gym.simulation import Simulator, channel_table
from wt_gym.tasks import DEFAULT_ENV, TASKS
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow

TURBULENT = "wt_gym/NREL5MW-Turbulent-v1"
RESIDUAL = {"action_mode": "residual", "pitch": "fixed-frame"}


# ---- contract of every choice ----


@pytest.mark.parametrize(
    ("mode", "pitch"),
    [
        ("rate", "individual"), ("rate", "fixed-frame"), ("absolute", "collective"), ("absolute", "fixed-frame"),
        ("residual", "collective"), ("residual", "individual"), ("residual", "cyclic"),
    ],
)  # fmt: skip
def test_both_checkers_have_nothing_to_say(mode, pitch):
    both_checkers_are_content(TURBULENT, action_mode=mode, pitch=pitch, episode_length=10.0)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if name.startswith("IEA") else name for name in TASKS]
)  # turbulence over a rotor of 284 m takes half a minute a box to make
def test_tasks_start_step_and_tell_their_length(name):
    env = gym.make(TASKS[name].id)
    assert env.spec.max_episode_steps * env.unwrapped.control_dt == TASKS[name].episode
    observation, _ = env.reset(seed=4)
    for _ in range(3):
        observation, reward, terminated, truncated, _ = env.step(np.zeros(env.action_space.shape, dtype=np.float32))
    assert env.observation_space.contains(observation)
    assert np.isfinite(reward)
    assert not terminated
    assert not truncated


def _worst(env, dial):
    """Lower bound of the reward of a second with these factors."""
    most = sum(factor_of(t.name, dial) * 2.0 * t.weight for t in env.reward_terms if t.name == "power")
    worst = sum(factor_of(t.name, dial) * rewards.worst_rate([t]) for t in env.reward_terms)
    return worst - most * env.options.rewards.relative


@pytest.mark.parametrize("name", TASKS)
def test_ending_a_task_early_never_pays(name):
    """The worst operation for ever, discounted as in training, costs less than the end of the episode.

    Of a reward relative to the controller goes what that earns at most: twice the weight of the power.
    """
    env = gym.make(TASKS[name].id).unwrapped
    dials = [(1.0, 1.0, 1.0)] if "dial" not in env.terms else [(3.0, 0.0, 0.0), (0.0, 3.0, 0.0), (0.0, 0.0, 3.0)]
    worst = min(_worst(env, dial) for dial in dials)  # the reward is linear in the factors: at a corner
    gamma = hyperparameters_for("PPO", TASKS[name].id)["gamma"]
    assert -worst * env.control_dt / (1.0 - gamma) < env.limits.penalty


def test_a_length_beyond_the_limit_of_the_id_is_a_warning(scripted):
    """Made with episode_length=120 a task of 60 s stays at 60 s, which shows when its first episode has ended there."""

    def warned(steps=300, **kwargs):
        alone = {"relative_reward": False, "reward_credit": False, "starts": None}
        env = gym.make("wt_gym/LoadReduction-v3", **alone, **kwargs)
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always")
            env.reset(seed=0)
            for _ in range(steps):
                if env.step(np.zeros(env.action_space.shape))[3]:
                    break
            env.reset(seed=1)
        return [str(w.message) for w in found if "max_episode_steps" in str(w.message)]

    (message,) = warned(episode_length=120.0)
    assert "the limit of wt_gym/LoadReduction-v3 ends episodes after 300 steps, 60 s, before the" in message
    assert "episode_length of 120 s: make it with max_episode_steps=600 instead" in message
    for quiet in ({"max_episode_steps": 600}, {"episode_length": 30.0}, {"episode_length": 60.0}, {}):
        assert warned(**quiet) == []
    assert warned(600, episode_length=120.0, max_episode_steps=600) == []
    assert warned(299, episode_length=120.0) == []  # ended by its user


def test_evaluations_take_the_limit_away_without_a_warning(scripted):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Environments(DEFAULT_ENV, {}, 120.0).plain.reset(seed=0)
        task = load_task("load-reduction-15")
        make_env(task, task.winds[0]).reset(seed=0)


# ---- a base controller ----


def test_zero_residual_is_the_controller_at_the_step_of_the_simulator():
    wind = SteadyInflow(14.0, shear_exponent=0.2)
    run = run_baseline(Simulator("nrel_5mw", inflow=wind), 6.0).to_dataset().isel(time=slice(0, None, 2))
    env = WindTurbineEnv(inflow=wind, episode_length=6.0, **RESIDUAL)
    env.reset(seed=0, options={"azimuth": 0.0, "generator_torque": float(run.generator_torque[0])})
    found = [env.signals.values]
    for _ in range(30):
        env.step(np.zeros(env.action_space.shape))
        found.append(env.signals.values)
    for name in ("rotor_speed", "pitch_1", "generator_power", "root_flap_moment_2", "tower_top_fore_aft"):
        column = [c.name for c in channel_table(3)].index(name)
        found_values = [values[column] for values in found]
        np.testing.assert_allclose(found_values, run[name].values, rtol=1e-5, atol=1e-9)


def test_pitch_in_the_fixed_frame_arrives_at_its_azimuth():
    """Two degrees of tilt, held: what the blades do, seen from the fixed frame, is tilt within a degree of azimuth."""
    env = WindTurbineEnv(inflow=SteadyInflow(14.0), episode_length=30.0, action_components=("pitch",), **RESIDUAL)
    env.reset(seed=0)
    for k in range(60):
        env.step(np.array([0.0, 1.0 if k < 10 else 0.0, 0.0]))
        if k < 20:
            continue
        mean, tilt, yaw = to_fixed_frame(env.signals.pitch - env.base.pitch, env.signals["azimuth"])
        assert tilt == pytest.approx(np.radians(3.0), rel=0.01)
        assert abs(np.degrees(np.arctan2(yaw, tilt))) < 1.0
        assert abs(mean) < 0.1 * tilt


@pytest.mark.parametrize(("wind_speed", "share"), [(8.0, 0.0), (18.0, 1.0)])
def test_residual_pitch_fades_below_rated_wind_and_its_mean_is_washed_out(wind_speed, share):
    env = WindTurbineEnv(
        inflow=SteadyInflow(wind_speed), episode_length=10.0, action_components=("pitch",), residual_fade=True,
        residual_washout=4.0, observation=("offsets", "residual_share", "residual_mean"), **RESIDUAL,
    )  # fmt: skip
    env.reset(seed=0)
    for k in range(25):
        observation, *_ = env.step(np.full(3, 1.0 if k < 5 else 0.0))
    assert env.layout.observation.value(observation, "residual_share") == pytest.approx(share, abs=1e-6)
    mean, tilt, yaw = to_fixed_frame(env.demand.pitch - env.base.pitch, env.signals["azimuth"])
    step = share * np.radians(1.5)
    assert np.hypot(tilt, yaw) == pytest.approx(np.sqrt(2.0) * step, rel=0.01, abs=1e-12)
    decay = np.exp(-4.0 / 4.0) - np.exp(-5.0 / 4.0)  # of a ramp of 1 s
    assert mean == pytest.approx(step * 4.0 * decay, rel=0.02, abs=1e-12)
    assert env.layout.observation.value(observation, "residual_mean") == pytest.approx(mean, rel=1e-5, abs=1e-9)


def test_cyclic_pitch_is_that_of_the_fixed_frame_without_its_mean():
    """The same tilt and yaw by both, and a refusal where there is no controller for the mean."""
    ends = []
    for pitch, ahead in (("cyclic", ()), ("fixed-frame", (0.0,))):
        choice = {"action_mode": "residual", "pitch": pitch, "action_components": ("pitch",)}
        env = WindTurbineEnv(inflow=SteadyInflow(16.0), episode_length=4.0, **choice)
        env.reset(seed=0)
        for _ in range(10):
            env.step(np.array([*ahead, 0.7, -0.4]))
        ends.append(env.demand.pitch)
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-12)
    assert np.ptp(ends[0]) > np.radians(1.0)
    for pitch, n in (("collective", 1), ("fixed-frame", 3)):
        env = WindTurbineEnv(action_mode="residual", pitch=pitch, action_spans={"pitch_mean": 0.01})
        limits = env.unwrapped.layout.action.pitch_high
        np.testing.assert_allclose(limits, [0.01, *np.radians([4.0] * (n - 1))])
    with pytest.raises(ValueError, match="pitch='cyclic' needs action_mode='residual'"):
        WindTurbineEnv(pitch="cyclic", action_mode="rate")


def test_components_left_out_are_the_controllers():
    """Torque alone in rate mode: the pitch follows the base controller."""
    env = WindTurbineEnv(inflow=SteadyInflow(16.0), action_components=("torque",), episode_length=10.0)
    env.reset(seed=0)
    for _ in range(10):
        env.step(np.zeros(1))
    np.testing.assert_array_equal(env.demand.pitch, env.base.pitch)
    assert env.demand.generator_torque == env.setpoint.generator_torque


def test_a_constant_residual_against_the_controller_alone():
    """Relative rewards: nothing for doing nothing, the difference otherwise."""
    env = WindTurbineEnv(inflow=SteadyInflow(9.0), relative_reward=True, episode_length=20.0, **RESIDUAL)
    env.reset(seed=0)
    for _ in range(10):
        _, reward, _, _, info = env.step(np.zeros(env.action_space.shape))
        assert reward == 0.0
        assert set(info["reward_terms"].values()) == {0.0}
    total = sum(env.step(np.array([1.0, 0.0, 0.0, 0.0, 0.0]))[1] for _ in range(20))
    assert total < -0.05  # four degrees of pitch below rated cost power


def test_vector_reward_has_the_terms_and_a_space():
    env = gym.make("wt_gym/NREL5MW-Steady-v1", vector_reward=True)
    env.reset(seed=0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # of Gymnasium
        _, reward, _, _, info = env.step(np.zeros(3, dtype=np.float32))
    bare = env.unwrapped
    assert bare.reward_space.contains(reward)
    assert bare.reward_names[-1] == "termination"
    np.testing.assert_allclose(reward[:-1], [info["reward_terms"][n] for n in bare.reward_names[:-1]], rtol=1e-6)


# ---- observations ----


def test_delay_and_history_repeat_what_was_seen():
    rng = np.random.default_rng(0)
    actions = rng.uniform(-0.3, 0.3, (12, 5))
    seen = {}
    for name, choice in (("now", {}), ("late", {"sensor_delay": 0.6}), ("both", {"sensor_delay": 0.2, "history": 2})):
        env = WindTurbineEnv(inflow=SteadyInflow(11.0), episode_length=10.0, **RESIDUAL, **choice)
        first, _ = env.reset(seed=0, options={"azimuth": 1.0})
        seen[name] = np.array([first, *(env.step(action)[0] for action in actions)])
    now, size = seen["now"], seen["now"].shape[1]
    np.testing.assert_array_equal(seen["late"][3:], now[:-3])
    np.testing.assert_array_equal(seen["late"][:3], now[[0, 0, 0]])
    np.testing.assert_array_equal(seen["both"][2:, :size], now[1:-1])
    np.testing.assert_array_equal(seen["both"][2:, size:], now[:-2])
    assert env.layout.observation.names[size] == "rotor_speed@1"


def test_single_channels_and_lidar():
    """The lidar reads the wind along the shaft, also of a wind that is sheared or turned with the nacelle."""
    choice = ("root_flap_moment_tilt", "tower_base_fore_aft_moment", "lidar", "rotor_speed")
    env = WindTurbineEnv(inflow=SteadyInflow(11.0), observation=choice, episode_length=10.0)
    observation, _ = env.reset(seed=0)
    names = env.layout.observation.names
    assert names == ("lidar_1", "lidar_2", "lidar_3", *choice[:2], "rotor_speed")
    for k in (1, 2, 3):
        assert env.layout.observation.value(observation, f"lidar_{k}") == pytest.approx(11.0, rel=1e-5)
    moments = [env.signals[f"root_flap_moment_{b}"] for b in (1, 2, 3)]
    tilt = to_fixed_frame(moments, env.signals["azimuth"])[1]
    assert env.layout.observation.value(observation, "root_flap_moment_tilt") == pytest.approx(tilt, rel=1e-4)


def test_the_estimated_wind_follows_the_wind():
    env = WindTurbineEnv(inflow=SteadyInflow(9.0), observation=("wind_estimate",), action_mode="residual",
                         episode_length=60.0)  # fmt: skip
    env.reset(seed=0)
    for _ in range(200):
        observation, *_ = env.step(np.zeros(env.action_space.shape))
    assert env.layout.observation.value(observation, "rotor_wind") == pytest.approx(9.0, abs=0.25)


# ---- snapshots and copies in the middle of an episode ----


def test_an_episode_that_is_over_stays_over_after_restoring():
    env = WindTurbineEnv(inflow=SteadyInflow(11.0), episode_length=0.4)
    env.reset(seed=0)
    env.step(np.zeros(3))
    before = env.snapshot()
    assert env.step(np.zeros(3))[3]
    over = env.snapshot()
    env.restore(before)
    assert env.step(np.zeros(3))[3]
    env.restore(over)
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.zeros(3))


def test_pictures_go_back_with_the_episode():
    """A restored picture is that of the snapshot: turbine and course of the signals, also when the episode is over."""
    env = WindTurbineEnv(inflow=SteadyInflow(11.0), episode_length=0.6, render_mode="rgb_array")
    env.reset(seed=0)
    env.step(np.zeros(3))
    middle, first = env.snapshot(), env.render()
    for _ in range(2):
        env.step(np.ones(3))
    over, last = env.snapshot(), env.render()
    env.restore(middle)
    np.testing.assert_array_equal(env.render(), first)
    env.step(np.zeros(3))
    env.restore(over)
    np.testing.assert_array_equal(env.render(), last)
    blind = WindTurbineEnv(inflow=SteadyInflow(11.0), episode_length=0.6)
    blind.reset(seed=0)
    env.restore(blind.snapshot())
    assert env.render().shape == last.shape
    assert [row[0] for row in env.terms["renderer"].memory()["history"]] == [0.0]


def test_a_failed_simulation_is_kept_and_shown_as_far_as_it_came(monkeypatch):
    env = WindTurbineEnv(inflow=SteadyInflow(11.0), episode_length=10.0, render_mode="rgb_array")
    env.reset(seed=0)
    picture = env.render()
    good = env.snapshot()

    def fail(*_args, **_kwargs):
        env.simulator._started = False
        raise SimulationError("diverged")

    with monkeypatch.context() as broken:
        broken.setattr(env.simulator, "advance", fail)
        last, _, terminated, _, info = env.step(np.zeros(3))
    assert (terminated, info["termination"]) == (True, "failure")
    np.testing.assert_array_equal(env.render(), picture)
    failed = env.snapshot()
    env.restore(good)
    env.step(np.zeros(3))
    np.testing.assert_array_equal(env.restore(failed), last)
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.zeros(3))
    assert env.render().shape == picture.shape
    env.restore(good)
    env.step(np.zeros(3))


# ---- winds ----


def test_directions_are_drawn():
    env = WindTurbineEnv(inflow="steady", wind_speed=9.0, wind_direction=(-0.3, 0.3), observation=("wind",))
    drawn = [env.layout.observation.value(env.reset(seed=seed)[0], "yaw_error") for seed in range(8)]
    assert -0.3 - 1e-6 <= min(drawn) < -0.05 < 0.05 < max(drawn) <= 0.3 + 1e-6


@pytest.mark.parametrize("inflow", ["extreme", "extreme-turbulent"])
def test_a_parked_turbine_idles_in_extreme_wind(inflow):
    env = WindTurbineEnv(inflow=inflow, wind_seeds=(1,), standstill_limit=-0.5, episode_length=4.0)
    env.reset(seed=0)
    assert (env.signals["rotor_speed"], env.demand.generator_torque) == (0.0, 0.0)
    ends = [env.step(np.zeros(3))[2] for _ in range(20)]
    assert not any(ends)
    assert abs(env.signals["rotor_speed"]) < 0.15 * env.turbine.drivetrain.rated_rotor_speed
    np.testing.assert_allclose(env.signals.pitch, 0.5 * np.pi, atol=1e-3)
    for limit in (None, 0.0):
        with pytest.raises(ValueError, match="starts a parked rotor"):
            WindTurbineEnv(inflow=inflow, standstill_limit=limit)
    absolute = WindTurbineEnv(inflow=inflow, standstill_limit=-0.5, action_mode="absolute")
    assert absolute.layout.action.high[0] == pytest.approx(0.5 * np.pi)


def test_environments_do_not_share_a_controller():
    """Resetting one does not start the controller of the other anew."""
    own = make_controller("discon", load_turbine("nrel_5mw"))
    first, second = (WindTurbineEnv(inflow=SteadyInflow(15.0), controller=own, **RESIDUAL) for _ in range(2))
    first.reset(seed=0)
    first.step(np.zeros(5))
    before = copy.deepcopy(first.controller)
    second.reset(seed=0, options={"pitch": 0.3})
    assert first.controller is not second.controller
    assert first.controller.filtered_speed == before.filtered_speed
    np.testing.assert_array_equal(first.controller.pitch, before.pitch)


def test_iterators_serve_the_environment_and_its_twin():
    """Generators of terms, winds, seeds, components and channels."""
    env = WindTurbineEnv(
        inflow=(SteadyInflow(speed) for speed in (9.0,)), reward=(term for term in rewards.compose({"power": 2.0})),
        wind_seeds=iter((1, 2)), action_components=(name for name in ("pitch",)), relative_reward=True,
        observation=(name for name in ("rotor", "lidar_1")), episode_length=2.0, **RESIDUAL,
    )  # fmt: skip
    assert env.layout.observation.names == ("rotor_speed", "generator_speed", "lidar_1")
    assert env.layout.action.components == ("pitch",)
    assert env.reset(seed=0)[1]["wind_speed"] == 9.0
    assert env.step(np.zeros(3))[1] == 0.0


def test_a_relative_reward_pays_no_luck_when_the_controller_fails():
    """The twin's end is no income, and what it earned last goes on being taken off."""
    env = WindTurbineEnv(inflow=SteadyInflow(15.0), relative_reward=True, episode_length=4.0, **RESIDUAL)
    env.terms["twin"].env.limits.overspeed = 0.5
    env.reset(seed=0)
    rewards = [env.step(np.zeros(5))[1] for _ in range(5)]
    assert env.terms["twin"].course.ended
    assert len(env.terms["twin"].course) == 1
    assert np.abs(rewards).max() < 0.1


def test_yaw_task_is_on_top_of_the_dead_band():
    relative = {"relative_reward": False, "starts": None}
    env = gym.make("wt_gym/Yaw-v3", sensor_noise=0.0, wind_direction=0.3, wind_wander=None, **relative).unwrapped
    env.reset(seed=0)
    for _ in range(1200):
        env.step(np.zeros(1))
    assert env.signals["yaw"] > 0.1  # towards the wind, within two minutes
