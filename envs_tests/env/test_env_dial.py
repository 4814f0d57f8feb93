"""The environment with a dial, rewards as vectors, and limits that cost."""

import math

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import ResetNeeded

from envs_tests.env.scripted_simulator import ScriptedSimulator, use
from wt_gym.analysis.results import Wind
from wt_gym.analysis.summary import results_table
from wt_gym.base.files import shipped_folder
from wt_gym.deployment.export.openfast_flight import Scene, fly
from wt_gym.envs import VectorReward
from wt_gym.envs import twin as reward_store
from wt_gym.envs.dial import DIAL_NAMES, factor_of
from wt_gym.envs.terminations import Costs, violated
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.experiment.agents import ConstantAgent, UniformAgent
from wt_gym.experiment.environments import trained_arguments
from wt_gym.experiment.evaluation import EvaluationConfig, evaluate
from wt_gym.experiment.trained_agent import TrainedAgent
from wt_gym.tasks import TASKS
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow

DIAL = TASKS["Dial"].id
TURBINE = load_turbine("nrel_5mw")
STEADY = {
    "inflow": "steady", "wind_speed": 15.0, "action_mode": "residual", "pitch": "fixed-frame", "control_dt": 0.1,
    "action_components": ("pitch",), "observation": ("rotor", "dial"), "episode_length": 4.0,
}  # fmt: skip
ROWS = [[0.0, 1.0, 1.0, 1.0], [1.0, 4.0, 1.0, 1.0], [2.0, 1.0, 1.0, 4.0]]


def run(env, steps=40, seed=0, options=None, actions=1):
    """Observations, rewards and infos under drawn actions."""
    rng = np.random.default_rng(actions)
    found = [(*env.reset(seed=seed, options=options)[:1], None, env.unwrapped.dial)]
    for _ in range(steps):
        observation, reward, _, _, info = env.step(rng.uniform(-1.0, 1.0, 3))
        found.append((observation, reward, info))
    return found


# ---- what is paid and seen ----


def test_each_step_pays_by_the_factors_that_its_observation_showed(scripted):
    env, plain = (WindTurbineEnv(**STEADY | more) for more in ({"dial_weights": ROWS}, {"observation": ("rotor",)}))
    turned, straight = run(env), run(plain)
    seen = [tuple(2.0 ** observation[-3:].astype(float)) for observation, *_ in turned]
    for k, ((_, reward, info), (_, _, other)) in enumerate(zip(turned[1:], straight[1:], strict=True)):
        paid = {name: factor_of(name, seen[k]) * value for name, value in other["reward_terms"].items()}
        assert info["reward_terms"] == pytest.approx(paid, rel=1e-6)
        assert reward == pytest.approx(sum(paid.values()), rel=1e-6)
        assert [info["dial"][name] for name in DIAL_NAMES] == pytest.approx(seen[k + 1], rel=1e-6)
    assert [seen[k] for k in (0, 15, 25)] == [
        pytest.approx(factors) for factors in ((1.0, 1.0, 1.0), (2.0, 0.5, 0.5), (0.5, 0.5, 2.0))
    ]
    assert min(min(other["reward_terms"].values()) for *_, other in straight[1:]) < 0.0
    later = run(WindTurbineEnv(**STEADY, dial_weights=[*ROWS[:2], [2.0, 4.0, 1.0, 0.25]]))
    for (observation, reward, _), (other, equal, _) in zip(turned[:20], later[:20], strict=True):
        np.testing.assert_array_equal(observation, other)
        assert reward == equal


def test_a_seed_repeats_the_dial_and_an_option_of_the_reset_fixes_it(scripted):
    arguments = STEADY | {"dial_weights": "log_uniform", "dial_interval": 1.0}
    env = WindTurbineEnv(**arguments)
    dials = [[info["dial"] for *_, info in run(env, seed=seed)[1:]] for seed in (3, 3, 4)]
    assert dials[0] == dials[1] != dials[2]
    assert len({tuple(dial.values()) for dial in dials[0]}) >= 3
    fixed = [info["dial"] for *_, info in run(env, options={"dial": {"travel": 4.0}})[1:]]
    assert all(dial == {"fatigue": 0.5, "power": 0.5, "travel": 2.0} for dial in fixed)
    with pytest.raises(ValueError, match="dial_weights must be one of"):
        env.reset(options={"dial": {"wear": 1.0}})


def test_the_dial_is_turned_from_the_next_observation_on(scripted):
    env = WindTurbineEnv(**STEADY, dial_weights={"fatigue": 1.0})
    with pytest.raises(ResetNeeded, match="call reset"):
        env.set_dial(travel=4.0)
    plain = [info["reward_terms"] for *_, info in run(env)[1:]]
    env.reset(seed=0)
    rng, found = np.random.default_rng(1), []
    for k in range(40):
        if k == 10:
            env.set_dial(travel=4.0)
            assert env.dial == {"fatigue": 1.0, "power": 1.0, "travel": 1.0}
        observation, *_, info = env.step(rng.uniform(-1.0, 1.0, 3))
        found.append((observation[-1], info["reward_terms"]["actuator_use"] / plain[k]["actuator_use"]))
    assert [value for value, _ in found] == pytest.approx([0.0] * 10 + [1.0] * 30, abs=1e-6)
    assert [ratio for _, ratio in found] == pytest.approx([1.0] * 11 + [2.0] * 29)
    with pytest.raises(ValueError, match="the environment must have dial_weights"):
        WindTurbineEnv(inflow="steady", wind_speed=12.0).set_dial(travel=4.0)


def test_a_relative_reward_needs_one_record_for_all_dials(tmp_path, monkeypatch):
    """Recorded by term: what the controller alone earns is taken off before the factors."""
    monkeypatch.setattr(reward_store, "cached_file", tmp_path.joinpath)
    reward_store._courses.clear()
    arguments = {"start": "steady", "starts": 2, "wind_seeds": (1,), "max_episode_steps": 12}
    keys, paid = set(), []
    for dial in ({"fatigue": 1.0}, {"fatigue": 4.0}):
        env = gym.make(DIAL, **arguments)
        found = run(env, 12, options={"start_number": 1, "dial": dial})
        keys.add(env.unwrapped.terms["twin"].course.key)
        paid.append([info["reward_terms"] for *_, info in found[1:]])
        env.close()
    assert len(keys) == 1
    assert None not in keys
    for one, four in zip(*paid, strict=True):
        assert four["blade_fatigue"] == pytest.approx(2.0 * one["blade_fatigue"], rel=1e-12, abs=1e-15)
        assert four["actuator_use"] == pytest.approx(0.5 * one["actuator_use"], rel=1e-12, abs=1e-15)
    resting = gym.make(DIAL, **arguments)
    resting.reset(seed=0)
    for _ in range(5):
        assert resting.step(np.zeros(3, dtype=np.float32))[1] == 0.0
    reward_store._courses.clear()


SHIPPED = shipped_folder() / "trained" / "dial"


def test_pitch_does_not_jump_where_the_dial_does():
    """Offsets move at no more than their greatest rate, before, at and after a change between the ends of the range."""
    rows = [[0.0, 4.0, 1.0, 0.25], [4.0, 0.25, 1.0, 4.0], [6.0, 4.0, 1.0, 0.25]]
    agent = TrainedAgent.load(SHIPPED)
    arguments = trained_arguments(agent.record) | {"relative_reward": False, "start": "steady", "dial_weights": rows}
    env = WindTurbineEnv(**arguments)
    observation, _ = env.reset(seed=0, options={"wind_speed": 17.0, "wind_seed": 1001, "azimuth": 0.0})
    offsets = [np.array(env.setpoint.pitch)]
    for _ in range(round(8.0 / env.control_dt)):
        observation, _, terminated, _, _ = env.step(agent.predict(observation)[0])
        assert not terminated
        offsets.append(np.array(env.setpoint.pitch))
    steps = np.abs(np.diff(offsets, axis=0))
    most = env.options.actions.spans["pitch_rate"] * env.control_dt
    assert steps[:, 0].max() <= most * (1.0 + 1e-9)
    assert np.hypot(steps[:, 1], steps[:, 2]).max() <= math.sqrt(2.0) * most * (1.0 + 1e-9)
    change = round(4.0 / env.control_dt)
    assert steps[change : change + 5].max() > 1e-6  # it acts


def test_flights_need_a_constant_dial(tmp_path):
    scene = Scene(STEADY | {"dial_weights": "simplex"}, TURBINE, SteadyInflow(15.0, 90.0), 0.1)
    with pytest.raises(ValueError, match="dial_weights must be constant in a flight"):
        fly("discon", tmp_path, scene, duration=10.0)


# ---- vectors ----


def test_objectives_times_the_dial_are_the_reward(scripted):
    env = VectorReward(WindTurbineEnv(**STEADY, dial_weights=ROWS))
    plain = WindTurbineEnv(**STEADY, dial_weights=ROWS)
    assert env.objectives == ("fatigue", "power", "travel", "protection")
    assert env.unwrapped.reward_space.shape == (env.unwrapped.reward_dim,) == (4,)  # where MO-Gymnasium looks
    env.reset(seed=0)
    scalars = run(plain)
    rng, dial = np.random.default_rng(1), env.unwrapped.dial
    for _, scalar, _ in scalars[1:]:
        _, reward, _, _, info = env.step(rng.uniform(-1.0, 1.0, 3))
        assert env.unwrapped.reward_space.contains(reward)
        assert info["scalar_reward"] == scalar
        assert np.dot(reward, [*dial.values(), 1.0]) == pytest.approx(scalar, rel=1e-5, abs=1e-7)
        assert list(info["objectives"].values()) == reward.tolist()
        dial = info["dial"]


def run_vector(objectives, steps=10, actions=1, **arguments):
    """Objectives of an environment, its rewards and infos under drawn actions."""
    env = VectorReward(WindTurbineEnv(**STEADY | {"observation": ("rotor",)} | arguments), objectives)
    rng = np.random.default_rng(actions)
    env.reset(seed=0)
    return env.objectives, [env.step(rng.uniform(-1.0, 1.0, 3))[1::3] for _ in range(steps)]


def test_terms_are_given_over_their_weights_and_named_as_chosen(scripted):
    (names, doubled), (_, single) = (run_vector("terms", reward={"blade_fatigue": w}) for w in (3.0, 1.5))
    assert names[-1] == "termination"
    np.testing.assert_allclose([row[0] for row in doubled], [row[0] for row in single], rtol=1e-6)
    chosen = {"loads": ["blade_fatigue", "tower_fore_aft_fatigue"]}
    names, rows = run_vector(chosen)
    assert names == ("loads", "protection")
    for reward, info in rows:
        assert reward.sum() == pytest.approx(info["scalar_reward"], rel=1e-5)
        assert reward[0] == pytest.approx(sum(info["reward_terms"][name] for name in chosen["loads"]), rel=1e-6)


def test_an_early_end_is_a_component(monkeypatch):
    class Runaway(ScriptedSimulator):
        script = {0.3: {"rotor_speed": 1.3 * TURBINE.drivetrain.rated_rotor_speed}}  # noqa: RUF012

    use(monkeypatch, Runaway)
    for objectives, penalty in (("terms", -1.0), ("dial", -120.0)):
        last = [reward[-1] for reward, _ in run_vector(objectives, steps=3)[1]]
        assert last == [0.0, 0.0, pytest.approx(penalty, rel=0.01)]  # under "dial" with the cost of the overspeed


def test_objectives_without_meaning_are_refused():
    env = WindTurbineEnv(inflow="steady", wind_speed=12.0)
    for given, message in (
        ("all", "objectives must be 'dial', 'terms' or a mapping"),
        ({"loads": ["wear"]}, "objectives must have terms among"),
        ({"a": ["power"], "b": ["power"]}, "each term once"),
        ({"protection": ["power"]}, "no name 'protection'"),
    ):
        with pytest.raises(ValueError, match=message):
            VectorReward(env, given)
    with pytest.raises(ValueError, match="must be a number, got vector_reward=True"):
        VectorReward(WindTurbineEnv(inflow="steady", wind_speed=12.0, vector_reward=True))


# ---- limits ----


def test_steps_cost_by_the_limits_of_the_user(monkeypatch):
    class Scripted(ScriptedSimulator):
        script = {  # noqa: RUF012
            0.2: {"rotor_speed_max": 1.11 * TURBINE.drivetrain.rated_rotor_speed},
            0.3: {"tip_clearance_min_2": 4.0},
            0.4: {
                "tip_clearance_min_2": 6.0,
                "nacelle_acceleration_fore_aft": 0.3,
                "nacelle_acceleration_side_side": 0.4,
            },
        }

    use(monkeypatch, Scripted)
    limits = {"rotor_speed": 1.1, "tip_clearance": 5.0, "tower_acceleration": 0.45, "pitch_travel": 500.0}
    arguments = STEADY | {"observation": ("rotor",), "action_mode": "rate", "pitch": "collective"}
    env = WindTurbineEnv(**arguments, cost_limits=limits)
    env.reset(seed=0)
    found = [env.step([0.1])[4] for _ in range(4)]
    travel = 0.1 * TURBINE.pitch.max_rate * 86400.0 / 500.0  # at a tenth of the greatest rate
    assert [info["costs"]["rotor_speed"] for info in found] == [0.0, 1.0, 0.0, 0.0]
    assert [info["costs"]["tip_clearance"] for info in found] == [0.0, 0.0, 1.0, 0.0]
    assert [info["costs"]["tower_acceleration"] for info in found] == [0.0, 0.0, 0.0, 1.0]
    assert [info["costs"]["pitch_travel"] for info in found] == pytest.approx([travel] * 4)
    assert all(info["cost"] == sum(info["costs"].values()) for info in found)
    assert Costs(TURBINE, 0.1, 1.25, limits).of_failure() == dict.fromkeys(limits, 1.0)
    assert violated({"pitch_travel": 1.0, "rotor_speed": 0.0}) == ()
    assert violated({"pitch_travel": 1.01, "rotor_speed": 0.001}) == ("pitch_travel", "rotor_speed")


def test_an_evaluation_counts_the_runs_beyond_a_limit(scripted):
    """One agent moves the blades, one does not."""
    arguments = STEADY | {"observation": ["rotor"]}
    del arguments["episode_length"]
    config = EvaluationConfig(
        "wt_gym/NREL5MW-Steady-v1", arguments | {"cost_limits": {"pitch_travel": 800.0}}, (Wind(15.0),), 4.0, 0.0
    )
    layout = WindTurbineEnv(**STEADY | {"observation": ["rotor"]}).layout
    agents = {"resting": ConstantAgent(layout), "moving": UniformAgent(layout, seed=0)}
    found = evaluate(agents, config, progress=False)
    shares = {run.agent: run.metrics["limits_violated"] for run in found.runs}
    assert shares == {"resting": 0.0, "moving": 1.0}
    head, _, resting, moving, *_ = results_table(found)
    place = [cell.strip() for cell in head.split("|")].index("beyond a limit")
    assert [line.split("|")[place].strip() for line in (resting, moving)] == ["0.0 %", "+100.0 %"]
