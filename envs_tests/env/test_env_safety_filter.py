"""The safety filter: what it replaces, what it leaves as it is, and what it refuses."""

import numpy as np
import pytest

from wt_gym.envs import SafetyFilter, WindTurbineEnv
from wt_gym.envs.wrappers import retreat

ARGUMENTS = {
    "inflow": "steady", "wind_speed": 14.0, "action_mode": "residual", "control_dt": 0.2, "pitch": "collective",
    "action_components": ("pitch", "torque"), "observation": ("rotor",), "episode_length": 12.0,
}  # fmt: skip
LIMIT = 1.04
LIMITED = ARGUMENTS | {"cost_limits": {"rotor_speed": LIMIT, "pitch_travel": 100.0}}
PUSHED = np.array([-1.0, -1.0], dtype=np.float32)
"""Less pitch and less torque: the rotor runs faster."""


def fastest(env, action=PUSHED, steps=60):
    """Highest rotor speed over rated, rewards and what was told under one action."""
    env.reset(seed=0, options={"azimuth": 0.0})
    out, rewards, told = 0.0, [], []
    for _ in range(steps):
        _, reward, terminated, _, info = env.step(action)
        assert not terminated
        out = max(out, info["rotor_speed_max"] / env.unwrapped.turbine.drivetrain.rated_rotor_speed)
        rewards.append(reward)
        told.append(info)
    return out, rewards, told


def test_an_agent_that_runs_the_rotor_up_is_held_within_the_limit():
    free, *_ = fastest(WindTurbineEnv(**LIMITED))
    env = SafetyFilter(WindTurbineEnv(**LIMITED), horizon=6.0, watch=0.1)
    held, _, told = fastest(env)
    assert free > LIMIT + 0.005
    assert held <= LIMIT
    shares = [info["filtered_share"] for info in told]
    assert not told[0]["filtered"]  # it acts once it is near
    assert any(info["filtered"] for info in told)
    assert shares[-1] == pytest.approx(np.mean([info["filtered"] for info in told]))
    assert 0.0 < shares[-1] < 1.0


def test_trials_leave_no_trace_in_an_episode_that_keeps_its_limits():
    """With noise, a twin and every step tried."""
    arguments = LIMITED | {
        "cost_limits": {"rotor_speed": 1.2}, "sensor_noise": 1.0, "relative_reward": True, "episode_length": 3.0,
    }  # fmt: skip
    rest = np.array([0.2, -0.1], dtype=np.float32)
    _, plain, _ = fastest(WindTurbineEnv(**arguments), rest, 12)
    _, tried, told = fastest(SafetyFilter(WindTurbineEnv(**arguments), horizon=0.6, watch=0.0), rest, 12)
    assert tried == plain
    assert not any(info["filtered"] for info in told)


@pytest.mark.parametrize("form", ["rate", "offset"])
def test_offsets_go_back_as_fast_as_they_move(form):
    env = WindTurbineEnv(**ARGUMENTS | {"residual_form": form})
    env.reset(seed=0)
    for _ in range(5):
        env.step(PUSHED)
    sizes = [abs(float(env.setpoint.pitch[0]))]
    assert sizes[0] > 0.01
    torque = abs(env.setpoint.generator_torque)
    for _ in range(6):
        env.step(retreat(env))
        sizes.append(abs(float(env.setpoint.pitch[0])))
    spans = env.layout.action.spans
    np.testing.assert_allclose(-np.diff(sizes)[:3], spans["pitch_rate"] * 0.2, rtol=1e-5)
    assert sizes[-1] == pytest.approx(0.0, abs=1e-8)
    assert abs(env.setpoint.generator_torque) < 1e-3 * torque


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ({"action_mode": "rate"}, {}, "needs action_mode='residual', got 'rate'"),
        ({"cost_limits": None}, {}, "needs cost_limits on rotor_speed"),
        ({}, {"horizon": 0.0}, "horizon must be at least 0.2 s"),
        ({}, {"watch": 1.0}, "watch from 0 to below 1"),
    ],
)
def test_environments_and_numbers_without_meaning_are_refused(arguments, options, message):
    with pytest.raises(ValueError, match=message):
        SafetyFilter(WindTurbineEnv(**LIMITED | arguments), **options)
