"""Faults that are drawn: by seed, in their ranges, for agent and base controller; an early end never pays."""

import math

import gymnasium as gym
import numpy as np
import pytest

from envs_tests.env.scripted_simulator import ScriptedSimulator, use
from wt_gym.control.design import reference_flap_moment
from wt_gym.envs.faults import FAULT_KINDS, SIZE_RANGES, FaultOptions, FaultTerm
from wt_gym.envs.turbine_env import WindTurbineEnv
from wt_gym.turbines import load_turbine
from wt_gym.wind import SteadyInflow

TURBINE = load_turbine("nrel_5mw")
MADE = {
    "inflow": SteadyInflow(15.0), "action_mode": "residual", "pitch": "fixed-frame", "action_components": ("pitch",),
    "controller": "ipc+yaw+fault_supervisor", "fault_kinds": "all", "control_dt": 0.1, "observation": ("measurable",),
}  # fmt: skip
FAULT = {"kind": "stuck_blade", "time": 0.5, "blade": 2}


def play(env, steps, action=None):
    chosen = np.zeros(env.action_space.shape) if action is None else action
    return [env.step(chosen)[:2] for _ in range(steps)]


# ---- agents under the fault supervisor ----


def test_disturbances_that_an_agent_sees_are_those_of_repaired_readings():
    """A dead gauge takes a third of the moments away; the supervisor puts its estimate in its place."""
    made = MADE | {"observation": ("disturbances",), "inflow": SteadyInflow(15.0, shear_exponent=0.2)}
    found = []
    for controller in ("linear_optimal", "linear_optimal+fault_supervisor"):
        env = WindTurbineEnv(**made | {"controller": controller})
        names = [k for k, name in enumerate(env.layout.observation.names) if name.startswith("disturbance_")]
        of_each = []
        for kind in ("none", "dead_moment"):
            env.reset(seed=1, options={"fault": {"kind": kind, **({} if kind == "none" else FAULT | {"kind": kind})}})
            of_each.append(play(env, 60)[-1][0][names])
        found.append(np.abs(of_each[1] - of_each[0]).max())
    assert found[1] < 0.2 * found[0]


# ---- draws ----


@pytest.mark.parametrize("sizes", ["train", "held_back"])
def test_kinds_blades_times_and_sizes_are_drawn_in_their_ranges(sizes):
    draws = FaultTerm(TURBINE, FaultOptions(kinds="all", sizes=sizes))
    found = [draws.drawn(np.random.default_rng(seed)) for seed in range(1500)]
    assert {one.kind for one in found} == set(FAULT_KINDS)
    for kind in FAULT_KINDS:
        own = [one for one in found if one.kind == kind]
        assert {one.blade for one in own} == {1, 2, 3}
        if kind not in ("none", "iced_blade"):
            times = [one.time for one in own]
            assert 5.0 <= min(times) < 8.0 < 17.0 < max(times) <= 20.0
        if kind in SIZE_RANGES:
            ends, held = SIZE_RANGES[kind]["train"], SIZE_RANGES[kind]["held_back"]
            size = [abs(one.size) for one in own]
            assert min(SIZE_RANGES[kind][sizes]) <= min(size) <= max(size) <= max(SIZE_RANGES[kind][sizes])
            assert max(ends) <= min(held) or max(held) <= min(ends)  # nothing of the one is in the other
            signs = {math.copysign(1.0, one.size) for one in own}
            assert signs == ({1.0} if kind in ("slow_drive", "iced_blade") else {1.0, -1.0})
    assert found[3] == draws.drawn(np.random.default_rng(3))


def test_the_mirror_image_has_the_mirrored_fault():
    image = FaultTerm(load_turbine("nrel_5mw", rotation="counter-clockwise"), FaultOptions(kinds="all"))
    for kind, sign in (("biased_vane", -1.0), ("biased_moment", 1.0), ("biased_pitch", 1.0)):
        (own,) = FaultTerm(TURBINE, FaultOptions(kinds=kind)).drawn(np.random.default_rng(1)).faults
        (other,) = image.drawn(np.random.default_rng(1), kind).faults
        assert other.offset == sign * own.offset
        assert (other.time, other.channels) == (own.time, own.channels)


def test_one_number_is_drawn_whatever_breaks():
    draws = FaultTerm(TURBINE, FaultOptions(kinds=("none", "dead_vane")))
    rest = set()
    for chosen in (None, "none", "iced_blade", FAULT):
        rng = np.random.default_rng(1)
        draws.drawn(rng, chosen)
        rest.add(rng.random())
    assert len(rest) == 1


@pytest.mark.parametrize(
    ("chosen", "message"),
    [
        ("stuck", r"the kind of a fault must be among none, .*got 'stuck'"),
        ({"kinds": "none"}, r"fault must have the keys kind, blade, time, size, got 'kinds'; did you mean 'kind'"),
        ({"blade": 4}, "the blade of a fault must be 1 to 3, got 4"),
        ({"kind": "iced_blade", "size": -0.1}, "the size of an iced_blade must be above 0"),
        ({"time": -1.0}, "the time of a fault must be at least 0 s"),
        (3, "fault must be a kind or a mapping"),
    ],
)
def test_what_is_chosen_without_meaning_is_refused(chosen, message):
    draws = FaultTerm(TURBINE, FaultOptions(kinds="all"))
    with pytest.raises(ValueError, match=message):
        draws.drawn(np.random.default_rng(0), chosen)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"fault_sizes": "train"}, "fault_sizes must be left out, or given with fault_kinds"),
        ({"fault_kinds": "voltage_dip", "generator": "damper", "turbine": "gebhardt_45m"}, "without voltage_dip where"),
        ({"fault_kinds": "all", "simulator": "openfast"}, "fault_kinds must be without iced_blade"),
    ],
)
def test_options_without_meaning_are_refused(given, message):
    with pytest.raises(ValueError, match=message):
        WindTurbineEnv(**given)


# ---- episodes ----


def test_no_fault_is_the_environment_without_faults(scripted):
    courses = []
    for kinds in (None, "none"):
        env = WindTurbineEnv(**MADE | {"fault_kinds": kinds})
        observation, info = env.reset(seed=4)
        assert ("fault" in info) == (kinds is not None)
        courses.append([observation, *(row[0] for row in play(env, 15, np.array([0.2, -0.3, 0.1])))])
    np.testing.assert_array_equal(*courses)


@pytest.mark.parametrize(
    ("kind", "channel", "read"),
    [
        ("biased_rotor_speed", "rotor_speed", lambda true: 1.06 * true),
        ("biased_generator_speed", "generator_speed", lambda true: 1.06 * true),
        ("biased_moment", "root_flap_moment_2", lambda true: true + 0.06 * reference_flap_moment(TURBINE)),
        ("dead_moment", "root_flap_moment_2", lambda true: 0.0),
        ("biased_pitch", "pitch_2", lambda true: true + 0.06),
        ("dead_pitch", "pitch_2", lambda true: 0.0),
        ("biased_vane", "yaw_error", lambda true: true + 0.06),
        ("misaligned_blade", "pitch_2", lambda true: true - 0.06),
    ],
)
def test_sensors_of_agent_and_controller_show_it_and_signals_do_not(kind, channel, read):
    env = WindTurbineEnv(**MADE | {"wind_direction": 0.05, "inflow": "steady", "wind_speed": 15.0})
    env.reset(seed=0, options={"fault": {"kind": kind, "time": 0.2, "blade": 2, "size": 0.06}})
    play(env, 20)
    shown, true = env.operation.readings(), env.signals
    assert shown[channel] == pytest.approx(read(true[channel]), rel=1e-9, abs=1e-12)
    assert shown[channel] != true[channel]
    others = [name for name in true if name.split("_")[0] != channel.split("_")[0]]
    assert all(shown[name] == true[name] for name in others)


def test_stuck_and_slow_blades_are_in_the_simulator():
    for kind, size, least, most in (("stuck_blade", 0.0, 0.0, 1e-9), ("slow_drive", 0.02, 1e-3, 3e-3)):
        env = WindTurbineEnv(**MADE)
        env.reset(seed=0, options={"fault": {"kind": kind, "time": 0.5, "blade": 2, "size": size}})
        play(env, 6)
        before = env.signals.pitch.copy()
        play(env, 10, np.array([0.0, 1.0, 0.0]))
        moved = np.abs(env.signals.pitch - before)
        assert least <= moved[1] <= most
        assert moved[[0, 2]].min() > 0.01


def test_ice_lasts_and_only_blades_without_it_take_the_motion_of_a_record():
    env = gym.make("wt_gym/Faults-v1").unwrapped
    starts = {}
    for kind in ("none", "iced_blade"):
        env.reset(seed=1, options={"start_number": 3, "fault": kind})
        starts[kind] = env.starts.draw(np.random.default_rng(0), {"start_number": 3, "fault": kind}, None).start
    assert starts["none"].motion is not None
    assert starts["iced_blade"].motion is None


# ---- no way to earn by an early end ----


def test_an_end_costs_more_than_running_with_the_worst_controller_in_every_fault(monkeypatch):
    """Blades that are driven to and fro in each fault, for as long as an episode lasts, against an end at once."""
    use(monkeypatch, ScriptedSimulator)
    env = gym.make("wt_gym/Faults-v1").unwrapped
    for kind in FAULT_KINDS:
        env.reset(seed=0, options={"fault": {"kind": kind, "time": 1.0}})
        total = sum(env.step(np.full(3, (-1.0) ** (k // 5)))[1] for k in range(300))
        assert total > -env.limits.penalty


def test_a_stopped_turbine_goes_on_and_earns_less_than_one_that_runs(monkeypatch):
    """The task has no limit at standstill: a supervisor may stop, and the time without power is paid for."""
    use(monkeypatch, ScriptedSimulator)
    returns = []
    for script in ({}, {1.0: {"rotor_speed": 0.0}}):
        monkeypatch.setattr(ScriptedSimulator, "script", script)
        alone = {"relative_reward": False, "reward_credit": False, "observation": None}
        env = gym.make("wt_gym/Faults-v1", controller="discon+supervisor+yaw", **alone).unwrapped
        env.reset(seed=0, options={"fault": "none"})
        returns.append(sum(reward for _, reward in play(env, 60)))
    assert returns[1] < returns[0] - 2.0
