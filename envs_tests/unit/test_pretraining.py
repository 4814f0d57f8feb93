"""Pretraining: fatigue with a gradient, costs of an episode under another policy, recordings, refusals."""

import json
import math
import signal
from dataclasses import asdict, replace

import gymnasium as gym
import numpy as np
import pytest
import torch

from wt_gym.analysis import metrics
from wt_gym.control.sensors import to_blades
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.learning import pretraining, pretraining_episodes
from wt_gym.learning.callbacks import StopRequest
from wt_gym.learning.options import PretrainingOptions, TrainingConfig
from wt_gym.learning.pretraining_episodes import (
    EpisodeJob,
    Limits,
    LinearizedEpisode,
    Plants,
    PlayedActions,
    RecordedEpisode,
    check_environment,
    damage_equivalent_load,
    load_metrics,
    plant_outputs,
    record_episode,
    tensor,
)
from wt_gym.learning.recording import respond
from wt_gym.learning.train import train
from wt_gym.tasks import TASKS

DT, STEPS, RATED, FULL = 0.1, 400, 5e6, math.radians(8.0)
SPEEDS = (14.0, 18.0)
BASE = {
    "blade_flap_del": 9.0, "tower_fore_aft_del": 30.0, "tower_side_side_del": 10.0, "pitch_duty_cycle": 0.01,
    "captured_power": 4.0, "blade_edge_del": 7.0, "platform_pitch_std": 0.5,
}  # fmt: skip
EXPONENTS = (metrics.BLADE_EXPONENT, metrics.TOWER_EXPONENT)
ARGUMENTS = {
    "controller": "linear_optimal", "observation": ["disturbances"], "control_dt": 0.1, "residual_form": "offset",
    "residual_washout": None, "sensor_washout": None, "relative_reward": False, "reward_credit": False,
}  # fmt: skip


# ---------------------------------------------------------------- fatigue


def test_fatigue_and_its_gradient_are_those_of_the_metrics():
    """With a gradient by central differences; a constant load has none."""
    signal = np.random.default_rng(2).normal(size=60)
    given = torch.from_numpy(signal).requires_grad_()
    load = damage_equivalent_load(given, 6.0, 4.0)
    load.backward()
    assert float(load.detach()) == pytest.approx(metrics.damage_equivalent_load(signal, 6.0, 4.0), rel=1e-12)
    for k in (0, 7, 20, 59):
        step = 1e-6 * np.eye(60)[k]
        moved = [metrics.damage_equivalent_load(signal + sign * step, 6.0, 4.0) for sign in (1.0, -1.0)]
        assert float(given.grad[k]) == pytest.approx((moved[0] - moved[1]) / 2e-6, abs=1e-6)
    still = torch.full((20,), 3.0, requires_grad=True)
    damage_equivalent_load(still, 2.0, 4.0).backward()
    assert not still.grad.any()


# ---------------------------------------------------------------- what an episode would cost


SIZES = np.array([30, 30, 30, 60, 20, 1, 4, 4, 4, 0.01])  # of a floating turbine


def plants():
    rng = np.random.default_rng(3)
    decaying = np.exp(-np.arange(30) / 8.0)
    return Plants(SPEEDS, rng.normal(size=(2, 10, 3, 30)) * decaying * SIZES[:, None, None])


def limits(washout=None, **more):
    return Limits(math.radians(1.0), math.radians(2.0), washout, FULL, RATED, 5.0, **more)


def share():
    return np.linspace(0.2, 1.0, STEPS)


def actions(seed):
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-1.0, 1.0, (STEPS // 8, 3)), 8, axis=0).astype(np.float32)


def simulated(acting, speed, individual=None, gain=1.0):
    """Episode of a turbine that the plants describe exactly, under offsets (3, n)."""
    rng = np.random.default_rng(4)
    azimuth, rotor_speed = 1.2 * DT * np.arange(STEPS + 1), np.full(STEPS + 1, 1.2)
    changed = respond(plants().at(speed), acting) * 1e6
    calm = np.cumsum(rng.normal(size=(10, STEPS + 1)) * 1e5, axis=1) + 8e6
    outputs = calm + changed
    outputs[5] = 4e6 + 1e-3 * calm[5] + changed[5]
    angles = azimuth + 2.0 * np.pi / 3.0 * np.arange(3)[:, None]
    turned = zip(acting.T, azimuth[:-1] + 0.3 * 1.2, strict=True)
    left = np.ones(STEPS) if individual is None else individual
    moved = gain * np.array([to_blades(u.tolist(), a, 3) for u, a in turned]).T
    return RecordedEpisode(
        speed=speed, seed=1, dt=DT, observations=np.arange(STEPS, dtype=np.float32)[:, None], offsets=acting,
        share=share(),
        flap=outputs[0] + outputs[1] * np.cos(angles) + outputs[2] * np.sin(angles),
        edge=outputs[6] + outputs[7] * np.cos(angles) + outputs[8] * np.sin(angles),
        pitch=0.2 + np.concatenate([np.zeros((3, 1)), moved], axis=1), tower=outputs[3:5], platform=outputs[9:] / 1e6,
        power=outputs[5], azimuth=azimuth, read_azimuth=azimuth[:-1], read_speed=rotor_speed[:-1], individual=left,
        lead=0.3, pitch_gain=gain,
    )  # fmt: skip


def playing(which):
    """Policy that plays actions by the number of the step, which it sees."""
    table = torch.from_numpy(which)
    return lambda observations: table[observations[:, 0].long()]


def linearized(episode, actor, washout=None, seen=None, **more):
    return LinearizedEpisode(episode, actor, plants(), limits(washout, **more), BASE, seen)


def own_metrics(episode):
    flap, edge, tower = (tensor(moments / 1e6) for moments in (episode.flap, episode.edge, episode.tower))
    platform = tensor(episode.platform)
    return load_metrics((flap, edge), tower, tensor(episode.pitch), DT, FULL, 50, EXPONENTS, platform)


@pytest.mark.parametrize(
    ("speed", "washout", "left", "gain"),
    [
        (14.0, None, np.ones(STEPS), 1.0),
        (16.0, 10.0, np.ones(STEPS), 1.0),
        (15.0, None, np.linspace(1.0, 0.0, STEPS), 1.3),  # a supervisor's share of tilt and yaw, and a gain of pitch
    ],
)
def test_loads_under_another_policy_are_those_of_a_simulation_of_it(speed, washout, left, gain):
    """A linear plant has no other answer."""
    first, second = (playing(actions(seed)) for seed in (5, 6))
    seen = torch.arange(STEPS, dtype=torch.float32)[:, None]
    shares = tensor(np.stack([share(), share() * left, share() * left]))
    acted = [limits(washout).offsets(actor(seen), shares, DT).double().numpy() for actor in (first, second)]
    recorded, expected = (simulated(offsets, speed, left, gain) for offsets in acted)
    episode = linearized(recorded, first, washout)
    np.testing.assert_allclose(episode.offsets(second), acted[1], atol=1e-7)
    result = episode.metrics(episode.offsets(second), EXPONENTS)
    for name, value in own_metrics(expected).items():
        assert float(result[name]) == pytest.approx(float(value), rel=1e-3), name


STILL = playing(np.zeros((STEPS, 3), dtype=np.float32))


def test_the_recorded_policy_costs_what_its_metrics_say():
    recorded = simulated(np.zeros((3, STEPS)), 15.0)
    episode = linearized(recorded, STILL)
    offsets = episode.offsets(STILL)
    own = {name: float(value) for name, value in own_metrics(recorded).items()}
    power = recorded.power[50:].mean() / 1e6
    expected = (
        0.2 * (own["blade_flap_del"] / 9.0 - 1.0) + 0.15 * (own["tower_fore_aft_del"] / 30.0 - 1.0)
        + 0.05 * (own["tower_side_side_del"] / 10.0 - 1.0) + 0.05 * (own["blade_edge_del"] / 7.0 - 1.0)
        + 0.1 * (own["pitch_duty_cycle"] - 0.01) + 0.1 * (recorded.platform[0, 50:].std() / 0.5 - 1.0)
        - (power / 4.0 - 1.0)
    )  # fmt: skip
    assert float(episode.cost(offsets)) == pytest.approx(expected, abs=1e-6)
    assert float(episode.cost(offsets, (6.0, 3.0))) == pytest.approx(expected, abs=1e-6)


def optimized_within(limit, shaking=0.0):
    """Costs before and after, pitch travel before and after, and multiplier, with a base controller that shakes."""
    rng = np.random.default_rng(8)
    times, waves = DT * np.arange(STEPS), rng.uniform(0.1, 2.0, 12)
    features = np.concatenate([np.sin(np.outer(times, waves)), np.cos(np.outer(times, waves))], axis=1)
    recorded = simulated(np.zeros((3, STEPS)), 15.0)
    pitch = recorded.pitch + shaking * (-1.0) ** np.arange(STEPS + 1)
    recorded = replace(recorded, observations=features.astype(np.float32), pitch=pitch)
    torch.manual_seed(0)
    policy = torch.nn.Module()
    policy.mlp_extractor = torch.nn.Module()
    policy.mlp_extractor.policy_net = torch.nn.Sequential(torch.nn.Linear(24, 24), torch.nn.Tanh())
    policy.action_net = torch.nn.Linear(24, 3)
    torch.nn.init.zeros_(policy.action_net.weight)
    torch.nn.init.zeros_(policy.action_net.bias)
    actor = pretraining._actor(policy)
    episode, budget = linearized(recorded, actor), pretraining._Budget(limit)
    options = PretrainingOptions(
        episodes=2, held_out=1, iterations=300, learning_rate=1e-2, noise=0.0, duration=60.0, memory=3.0
    )
    own, execution = pretraining._travel(actor, [episode]), pretraining.Execution(Here())
    before, after, _, _ = pretraining._optimized(
        policy, [episode, episode], options, np.random.default_rng(0), execution, budget
    )
    return before, after, own, pretraining._travel(actor, [episode]), budget.multiplier


def test_a_multiplier_holds_the_pitch_travel_within_its_limit():
    """Of what the plant allows a policy, the cheapest within the limit: dearer than without one, cheaper than none."""
    before, free, _, far, price = optimized_within(math.inf)
    assert price == 0.0
    _, held, _, near, price = optimized_within(0.4 * far)
    assert 0.2 * far < near <= 0.4 * far
    assert price > 0.0
    assert free < held < before


def test_out_of_reach_of_a_limit_the_policy_nearest_to_it_is_kept():
    """The base controller alone travels twice as much, in each step, which no offset of this policy takes back."""
    *_, own, free, _ = optimized_within(math.inf, shaking=0.002)
    *_, near, price = optimized_within(0.5 * own, shaking=0.002)
    assert 0.5 * own < near <= own
    assert near < free
    assert price > 0.2  # it has grown in each of the 300 steps, by a third of the most


def test_power_above_the_recorded_one_earns_nothing():
    episode = linearized(simulated(np.zeros((3, STEPS)), 15.0), STILL)
    now, *both = (
        float(episode.metrics(torch.full((3, STEPS), u), EXPONENTS)["captured_power"]) for u in (0.0, 0.01, -0.01)
    )
    assert max(both) == pytest.approx(now)
    assert min(both) < now - 1e-3


def test_a_dial_weighs_the_parts_of_the_cost_and_is_what_the_policy_sees():
    """Of a policy whose mean offset is the logarithm of the factor on travel."""
    recorded = simulated(np.zeros((3, STEPS)), 15.0)
    rows = np.zeros((STEPS, 4), dtype=np.float32)
    rows[:, 1:] = np.log2([1.5, 1.0, 0.5])
    recorded = replace(recorded, observations=rows)

    def by_travel(observations):
        return torch.stack([0.1 * observations[:, 3], torch.zeros(STEPS), torch.zeros(STEPS)], dim=1)

    episode = linearized(recorded, by_travel, dial_at=(1, 2, 3))
    own, turned = episode.offsets(by_travel), episode.offsets(by_travel, dial=(1.0, 1.0, 1.0))
    np.testing.assert_allclose(own[0], tensor(-0.1 * math.radians(1.0) * share()), rtol=1e-5)
    assert not turned.any()
    assert episode.observations[0, 3] == -1.0  # the recording stays
    plain = float(episode.cost(turned))
    assert float(episode.cost(turned, dial=(1.0, 1.0, 1.0))) == pytest.approx(plain, abs=1e-7)
    alone = [float(episode.cost(turned, dial=dial)) for dial in np.eye(3).tolist()]
    assert sum(alone) == pytest.approx(plain, abs=1e-6)
    now = {name: float(value) for name, value in episode.metrics(turned, EXPONENTS).items()}
    expected = -(now["captured_power"] / 4.0 - 1.0), 0.1 * (now["pitch_duty_cycle"] - 0.01)
    assert alone[1:] == pytest.approx(expected, abs=1e-6)
    noisy = episode.offsets(by_travel, noise=0.5, dial=(1.0, 1.0, 1.0))
    assert not noisy.any()  # what a user sets has no noise


def test_a_policy_that_sees_what_it_does_acts_as_in_a_simulation_of_the_loop():
    """Where the model of the base controller fails: offsets come back in the observations."""
    rng = np.random.default_rng(7)
    taps = 30
    loop = Plants(SPEEDS, rng.normal(size=(2, 2, 3, taps)) * np.exp(-np.arange(taps) / 5.0) * 3.0)
    calm = 0.3 * np.cumsum(rng.normal(size=(STEPS, 2)), axis=0) / np.sqrt(np.arange(1, STEPS + 1))[:, None]
    weights = [tensor(0.1 * rng.normal(size=(3, 2))) for _ in range(2)]

    def simulated_loop(weight):
        """Observations and offsets, step by step."""
        seen, acted = calm.copy(), np.zeros((3, STEPS))
        for k in range(STEPS):
            past = acted[:, max(k - taps, 0) : k][:, ::-1]
            seen[k] += np.einsum("ojl,jl->o", loop.at(16.0)[:, :, : past.shape[1]], past)
            action = np.clip(weight.numpy() @ seen[k], -1.0, 1.0)
            acted[:, k] = share()[k] * np.array([math.radians(1.0), *[math.radians(2.0)] * 2]) * action
        return seen, acted

    first, second = (lambda seen, weight=weight: seen @ weight.T for weight in weights)
    seen, acted = simulated_loop(weights[0])
    recorded = replace(simulated(acted, 16.0), observations=seen.astype(np.float32))
    episode = linearized(recorded, first, seen=loop)
    np.testing.assert_allclose(episode.offsets(first), acted, atol=1e-7)
    expected = simulated_loop(weights[1])[1]
    open_loop = limits().offsets(second(tensor(seen)), tensor(share()), DT).numpy()
    missed = np.abs(open_loop - expected).max()
    assert missed > 0.02 * np.abs(expected).max()  # the loop matters
    assert np.abs(episode.offsets(second).numpy() - expected).max() < 0.05 * missed


# ---------------------------------------------------------------- environments, options


def test_a_condition_is_that_of_the_recorded_episode():
    """Slow drives lag more, and a dead gauge reaches what the agent sees, not the loads."""
    job = EpisodeJob("wt_gym/LoadReduction-v3", json.dumps(ARGUMENTS), 17.0, 3, 4.0)
    nominal, slow, dead = (
        record_episode(replace(job, condition=json.dumps({"variation": one})))
        for one in ({}, {"drive_lag": 0.3}, {"dead_sensor": ["root_flap_moment_1"]})
    )
    assert slow.lead == pytest.approx(0.15 - (0.1 + 0.3 - 0.15))
    assert nominal.lead == pytest.approx(0.1 + 0.05)
    assert abs(dead.observations[0] - nominal.observations[0]).max() > 0.5
    np.testing.assert_allclose(dead.flap[:, 0], nominal.flap[:, 0], rtol=1e-6)


@pytest.mark.parametrize(
    ("controller", "condition"),
    [
        ("linear_optimal", {"variation": {"sensor_delay": 0.2}}),
        ("linear_optimal+fault_supervisor", {"fault_kinds": ["dead_rotor_speed"], "fault_time": 0.0}),
        ("linear_optimal+fault_supervisor", {"fault_kinds": ["stuck_blade"], "fault_time": 0.0}),
    ],
)
def test_offsets_that_are_recorded_are_those_that_the_objective_takes_of_the_policy(controller, condition):
    """In the frame of the readings, with what a supervisor leaves of them."""
    asked = np.tile(np.array([0.1, 0.5, -0.25], dtype=np.float32), (60, 1))
    spans = {"pitch_mean": math.radians(0.5)}
    arguments = json.dumps(ARGUMENTS | {"controller": controller, "residual_fade": False, "action_spans": spans})
    played, told = PlayedActions(asked), json.dumps(condition)
    found = record_episode(EpisodeJob("wt_gym/LoadReduction-v3", arguments, 17.0, 3, 6.0, played, condition=told))
    assert (found.steps, found.flap.shape, found.observations.shape[0]) == (60, (3, 61), 60)
    limits = Limits(math.radians(0.5), math.radians(4.0), None, FULL, RATED, 5.0)
    cyclic = found.share * found.individual
    expected = limits.offsets(torch.from_numpy(asked), tensor(np.stack([found.share, cyclic, cyclic])), DT).numpy()
    reached = slice(40, None)  # offsets move at their greatest rate
    np.testing.assert_allclose(found.offsets[:, reached], expected[:, reached], atol=2e-4)
    assert (found.individual[-1] == 0.0) == (condition.get("fault_kinds") == ["stuck_blade"])
    outputs, psi = plant_outputs(found), found.azimuth[7] + 2.0 * np.pi / 3.0 * np.arange(3)
    flap = outputs[0, 7] + outputs[1, 7] * np.cos(psi) + outputs[2, 7] * np.sin(psi)
    np.testing.assert_allclose(1e6 * flap, found.flap[:, 7])
    edge = outputs[6, 7] + outputs[7, 7] * np.cos(psi) + outputs[8, 7] * np.sin(psi)
    np.testing.assert_allclose(1e6 * edge, found.edge[:, 7])
    assert np.ptp(found.edge[:, 7]) > 2e6  # gravity, which flapwise moments hardly have


def drawn(job, seed, stands=False):
    """Episode of random numbers; where the turbine stands, its loads do not depend on the offsets."""
    rng = np.random.default_rng(seed)
    inputs = rng.normal(size=(3, 600)) * (job.agent is not None)
    rng = np.random.default_rng(job.seed) if stands else rng
    return RecordedEpisode(
        speed=job.speed, seed=job.seed, dt=0.1, observations=rng.normal(size=(600, 77)).astype(np.float32),
        offsets=inputs, share=np.ones(600), flap=rng.normal(size=(3, 601)), edge=rng.normal(size=(3, 601)),
        pitch=rng.normal(size=(3, 601)), tower=rng.normal(size=(2, 601)), platform=np.zeros((0, 601)),
        power=rng.normal(size=601),
        azimuth=np.arange(601.0), read_azimuth=np.arange(600.0), read_speed=np.ones(600),
        individual=np.ones(600), lead=0.1,
    )  # fmt: skip


class Here:
    """Jobs one after another."""

    def results(self, work, jobs):
        return ((job, work(job)) for job in jobs)


def work_of(progress=lambda _: None, recordings=None, limits=None, **options):
    """Recordings and identification of a pretraining at one wind speed."""
    few = {"episodes": 6, "held_out": 3, "duration": 60.0, "memory": 5.0, "plant_speeds": 1, "excited": 2}
    execution = pretraining.Execution(Here(), progress, recordings=recordings)
    arguments = ARGUMENTS | {"wind_speed": (15.0, 17.0)} | ({"cost_limits": limits} if limits else {})
    return pretraining._Work(
        "wt_gym/LoadReduction-v3", arguments, PretrainingOptions.from_dict(few | options), execution
    )


def test_winds_in_which_the_turbine_stands_are_refused(monkeypatch):
    """Offsets change nothing: the explained share would be no number."""
    monkeypatch.setattr(pretraining_episodes, "record_episode", lambda job: drawn(job, id(job), stands=True))
    with pytest.raises(ValueError, match="at 16 m/s offsets change nothing: give wind_speed a lower upper end"):
        work_of().identified()


def test_conditions_are_recorded_in_turns_and_each_is_identified_once(monkeypatch):
    delay = {"vary_sensor_delay": 0.2}
    asked: list[EpisodeJob] = []

    def record(job):
        asked.append(job)
        return drawn(job, len(asked))

    monkeypatch.setattr(pretraining_episodes, "record_episode", record)
    work = work_of(conditions=[{}, {"variation": {"sensor_delay": 0.2}}, {}])
    found, baselines = work.identified()
    assert list(baselines) == [16.0]
    assert [one.condition for one in asked].count(json.dumps(delay)) == 4  # two winds, with and without offsets
    assert len(asked) == 2 + 4 + 4
    assert found[0] is found[2] is not found[1]
    assert found[0].seen is None
    assert found[1].seen.responses.shape == (1, 77, 3, 50)
    asked.clear()
    work.recorded(None, 0)
    assert sorted(one.condition for one in asked) == [json.dumps(delay)] * 2 + ["{}"] * 4
    assert [work.in_turns(found)[k] is found[1] for k in range(6)] == [False, True, False] * 2
    assert {one.seed for one in asked if one.condition == json.dumps(delay)} == {2, 5}


def test_a_recording_has_no_faults_and_its_own_length():
    """Whatever the arguments of the training say of both."""
    arguments = ARGUMENTS | {"fault_kinds": ["stuck_blade"], "fault_time": 1.0, "episode_length": 2.0}
    found = record_episode(EpisodeJob("wt_gym/Faults-v1", json.dumps(arguments), 17.0, 3, 4.0, None))
    assert found.steps == 40


def test_a_pretraining_that_is_stopped_keeps_its_recordings(tmp_path, monkeypatch):
    """After the episode that is under way, with the request that Ctrl-C and SIGTERM make."""
    recorded = []
    monkeypatch.setattr(
        pretraining_episodes, "record_episode", lambda job: recorded.append(job) or drawn(job, len(recorded))
    )
    few = {"episodes": 3, "held_out": 1, "duration": 60.0, "memory": 5.0, "plant_speeds": 1, "excited": 2}
    config = TrainingConfig(env_kwargs=ARGUMENTS, pretraining=few, total_steps=0, n_envs=1, tensorboard=False)
    request = StopRequest()
    request.signal_number = signal.SIGTERM
    for count in (1, 2):  # the second resumes with the recording of the first
        with pytest.raises(KeyboardInterrupt, match=r"stopped by SIGTERM; its recordings are in .* resumes with them"):
            train(config, tmp_path / "run", progress=False, stop=request)
        assert len(recorded) == len({job.seed for job in recorded}) == count
        assert len(list((tmp_path / "run" / "recordings").glob("*.npz"))) == count
    assert not (tmp_path / "run" / "model.zip").exists()


def test_episodes_that_are_recorded_are_not_recorded_again(tmp_path, monkeypatch):
    """Whatever the budget; another policy has other episodes."""
    recorded, lines = [], []
    monkeypatch.setattr(
        pretraining_episodes, "record_episode", lambda job: recorded.append(job) or drawn(job, len(recorded))
    )

    def run(factor, limits=None):
        work = work_of(lines.append, tmp_path, limits)
        plants = work.identified()[0][0].plants
        work.recorded(PlayedActions(np.full((3, 3), factor)), 1)
        return plants.responses

    first = run(0.0)
    assert len(recorded) == 12
    assert lines[0] == "baseline runs: 0/2 recorded, 60 s each"
    lines.clear()
    np.testing.assert_array_equal(run(0.0, {"pitch_travel": 3000.0}), first)
    assert len(recorded) == 12
    assert lines[0] == "baseline runs: 2/2 recorded, 60 s each"
    run(1.0)
    assert len(recorded) == 18


@pytest.fixture
def config():
    return TrainingConfig(
        env_kwargs=ARGUMENTS, pretraining={}, total_steps=0, eval_every=0, n_envs=1, tensorboard=False
    )


def test_a_pretraining_alone_begins_no_episode(config, tmp_path, monkeypatch):
    monkeypatch.setattr(pretraining, "pretrain", lambda *arguments: {"rounds": []})

    def refuse(*arguments, **more):
        raise AssertionError("an episode began")

    monkeypatch.setattr(WindTurbineEnv, "reset", refuse)
    record = train(config, tmp_path / "run", progress=False)
    assert (record["status"], record["steps"], record["pretraining"]["rounds"]) == ("finished", 0, [])
    assert (tmp_path / "run" / "model.zip").exists()


def test_a_training_hands_its_budget_of_travel_to_the_pretraining_and_refuses_others(config, tmp_path, monkeypatch):
    limits = []
    monkeypatch.setattr(pretraining, "pretrain", lambda *args: limits.append(args[-1]) or {"rounds": []})
    train(config, tmp_path / "without", progress=False)
    train(replace(config, budgets={"pitch_travel": 2000.0}), tmp_path / "with", progress=False)
    assert limits == [None, 2000.0]
    with pytest.raises(ValueError, match=r"alone keeps a budget of pitch_travel.*leave out rotor_speed"):
        replace(config, budgets={"pitch_travel": 2000.0, "rotor_speed": 1.1})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"controller": "discon", "observation": ["rotor"]}, "linear_pitch"),
        ({"observation": ["disturbances", "rotor"]}, "do not depend on the actions.*rotor_speed"),
        ({"control_dt": 0.2}, "control_dt=0.1"),
        ({"history": 2}, "history=1"),
        ({"pitch": "cyclic"}, "pitch='fixed-frame' and residual_form='offset'"),
    ],
)
def test_environments_that_cannot_be_pretrained_on(changes, message):
    env = gym.make("wt_gym/LoadReduction-v3", **(ARGUMENTS | changes)).unwrapped
    with pytest.raises(ValueError, match=message):
        check_environment(env)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"episodes": 4, "held_out": 4}, "held_out must be less than the 4 episodes"),
        ({"memory": 1000.0}, "memory must be at most half"),
        ({"first_wind_seed": 990}, "held back for evaluations, 1001 to"),
        ({"conditions": ["delay"]}, "must be a mapping of arguments of the environment, got 'delay'"),
        (
            {"conditions": [{"controller": "ipc"}]},
            "must have variation, sensors, faults, simulator alone, got controller",
        ),
        ({"conditions": [{"variation": {"drive_lag": [0.0, 0.3]}}]}, "drive_lag of a condition must be one number"),
        ({"conditions": [{"faults": {"kinds": "all"}}]}, "must be of one kind, got 'all'"),
        ({"conditions": [{"faults": {"kinds": "iced_blade", "time": 21.0}}]}, "at one time within the 20 s"),
        ({"conditions": [{}] * 49}, "held_out must be at least the number of conditions, 49"),
    ],
)
def test_options_are_refused(values, message):
    with pytest.raises(ValueError, match=message):
        PretrainingOptions.from_dict(values)


def test_a_pretraining_needs_ppo_and_a_training_steps():
    with pytest.raises(ValueError, match="except with the algorithm PPO, got 'SAC'"):
        TrainingConfig("SAC", pretraining={})
    with pytest.raises(ValueError, match="total_steps must be at least 1"):
        TrainingConfig(total_steps=0)


PITCH_OFFSETS = [
    task.id
    for task in TASKS.values()
    if task.arguments["inflow"] == "turbulent"
    and "pitch" in task.arguments
    and not task.id.startswith(("wt_gym/OC4", "wt_gym/VolturnUS"))  # no design is shipped
]


def test_no_action_changes_the_observation_of_a_lidar():
    seen = {"observation": ["disturbances", "lidar"], "lidar": {"ranges": [30.0, 60.0], "apart": True}}
    check_environment(gym.make("wt_gym/LoadReduction-v3", **(ARGUMENTS | seen)).unwrapped)


@pytest.mark.parametrize("env_id", PITCH_OFFSETS)
def test_pretraining_brings_the_arguments_that_it_needs(env_id):
    config = TrainingConfig(env_id=env_id, pretraining={}, total_steps=0, env_kwargs={"wind_speed": 15.0})
    assert config.env_kwargs["wind_speed"] == 15.0
    env = gym.make(env_id, **config.env_kwargs)
    check_environment(env.unwrapped)
    env.close()


def test_the_linear_optimal_controller_takes_the_place_of_the_published_one_below_the_additions_of_a_task():
    config = TrainingConfig(env_id="wt_gym/FullOperation-v0", pretraining={}, total_steps=0)
    assert config.env_kwargs["controller"] == "linear_optimal+supervisor:averaging=60"
    assert config.env_kwargs["action_components"] == ["pitch"]
    faults = TrainingConfig(env_id="wt_gym/Faults-v1", pretraining={}, total_steps=0)
    assert faults.env_kwargs["controller"] == "linear_optimal+yaw"  # with damper and observer of its own


def test_given_arguments_come_before_those_of_pretraining_single_or_in_groups():
    spans = {"pitch": 0.01, "pitch_mean": 0.01, "pitch_rate": 0.02}
    arguments = {"residual_fade": False, "action_components": None, "actions": {"spans": spans}}
    config = TrainingConfig(pretraining={"rounds": 3}, total_steps=0, env_kwargs=arguments)
    expected = {"residual_fade": False, "action_components": None, "action_spans": spans}
    assert {name: config.env_kwargs[name] for name in expected} == expected
    assert config.env_kwargs["observation"] == ["disturbances"]
    assert TrainingConfig.from_dict(json.loads(json.dumps(asdict(config)))) == config
    assert TrainingConfig().env_kwargs == {}
    with pytest.raises(ValueError, match="move the pitch, and wt_gym/Yaw-v3 has yaw"):
        TrainingConfig(env_id="wt_gym/Yaw-v3", pretraining={}, total_steps=0)
