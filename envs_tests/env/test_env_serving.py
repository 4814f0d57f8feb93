"""Agents served to turbines under ROSCO: what they do there is what they do in their environment."""

import logging
import math
import re
import shlex
import threading
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("zmq")

from envs_tests.unit.rosco_client import Client, WithServer, readings, text_of
from wt_gym.base.errors import ControllerError
from wt_gym.bridges.rosco import RoscoServer, SetPoints, read_message
from wt_gym.commands import parse as parse_command
from wt_gym.commands import run as run_command
from wt_gym.commands.train import configuration
from wt_gym.deployment.serving import ServedAgent, answers_of, check_expressible
from wt_gym.envs.options import registered_arguments
from wt_gym.envs.turbine_env import WindTurbineEnv

SENT = [
    "rotor", "wind", "offsets", "previous_action", "azimuth", "generator_power", "generator_torque",
    "nacelle_acceleration_fore_aft", *(f"root_out_of_plane_moment_{part}" for part in ("mean", "tilt", "yaw", 1, 2, 3)),
]  # fmt: skip
KWARGS = {
    "turbine": "nrel_5mw", "inflow": "turbulent", "wind_speed": 16.0, "start": "steady", "action_mode": "residual",
    "action_components": ["pitch"], "pitch": "fixed-frame", "observation": SENT,
}  # fmt: skip
RATE = math.radians(1.5)
"""Greatest rate of the offsets."""


class Linear:
    """An agent that acts on all that it observes."""

    def __init__(self, layout, gain=0.3):
        rng = np.random.default_rng(5)
        self.weights = gain * rng.standard_normal((layout.action.size, len(layout.observation)))

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.tanh(self.weights @ observation).astype(np.float32), state


class Steady:
    """An agent with one action; records its observations."""

    def __init__(self, action=(1.0, -0.5, 0.0)):
        self.action, self.seen = np.array(action), []

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        self.seen.append(np.array(observation))
        return self.action, state


def flown(env, agent, duration):
    """Demands beyond `discon` at every step of the simulator [rad], and the signals at the end."""
    observation, _ = env.reset(seed=2, options={"wind_seed": 7})
    offsets, advance = [], env.simulator.advance

    def noted(dt, pitch, *rest, **options):
        offsets.append(pitch - env.base.pitch)
        return advance(dt, pitch, *rest, **options)

    env.simulator.advance = noted
    for _ in range(round(duration / env.control_dt)):
        action = np.zeros(env.layout.action.size) if agent is None else agent.predict(observation)[0]
        observation, _, terminated, _, info = env.step(action)
        assert not terminated, info["termination"]
    return np.array(offsets), env.signals


@pytest.mark.parametrize(
    "more",
    [{"history": 2, "sensor_delay": 0.2, "residual_washout": 20.0}, {"pitch": "individual"}],
    ids=["fixed frame", "individual"],
)
def test_an_agent_over_the_server_is_the_agent_itself(more):
    """In the same turbulence: what differs is the seventh digit of the readings."""
    env = WindTurbineEnv(**(KWARGS | more))
    offsets, signals = flown(env, Linear(env.layout), 20.0)
    there = WindTurbineEnv(**(KWARGS | more))
    answers = ServedAgent(lambda: Linear(env.layout), env)
    with RoscoServer("tcp://127.0.0.1:*", answers, 60.0) as server:
        thread = threading.Thread(target=server.serve)
        thread.start()
        client = Client(server.address, 5)
        served = there.operation.controller = WithServer(there.operation.controller, client)
        _, other = flown(there, None, 20.0)
        client.ask(readings(other, 5, -1))
        client.close()
        thread.join(30.0)
    assert np.abs(offsets).max() > 0.5 * RATE
    assert np.abs(np.array(served.offsets) - offsets).max() < 1e-5
    assert other["rotor_speed"] == pytest.approx(signals["rotor_speed"], rel=1e-6)
    assert other["root_flap_moment_1"] == pytest.approx(signals["root_flap_moment_1"], rel=1e-4)


# ---- without a simulation ----


@pytest.fixture(scope="module")
def env():
    return WindTurbineEnv(**(KWARGS | {"pitch": "individual"}))


def message(time, number=0, status=1, **changed):
    """A message at a time [s], as it comes over the line."""
    values = [number, status, time, 5.3e6, 5.0e6, 122.9, 1.267, 4.3e4, 0.0, 4.0, 16.0, 5e6, 5e6, 5e6, 0.1, 0.0, 1.0]
    for place, value in changed.items():
        values[int(place.removeprefix("n")) - 1] = value
    return read_message(text_of(values))


def offsets_of(points):
    return [points.pitch_offset_1, points.pitch_offset_2, points.pitch_offset_3]


@pytest.mark.parametrize("interval", [0.0125, 0.1, 0.2, 0.4])
def test_offsets_move_evenly_whatever_the_interval(env, interval, caplog):
    """At the end of the interval they are where they have been moved by then; the agent acts every 0.2 s."""
    agent = Steady()
    served = ServedAgent(lambda: agent, env)
    for k in range(round(2.0 / interval) + 1):
        points = served.answer(message(k * interval, status=int(k > 0)))
        if k > 0:  # before the second message the interval is not known
            expected = (min(k * interval + interval, 2.4) - (interval > 0.2) * 0.2) * RATE
            assert offsets_of(points) == pytest.approx([expected, -0.5 * expected, 0.0], rel=1e-6, abs=1e-12)
    assert len(agent.seen) == 11
    assert ("messages come every 0.4 s" in caplog.text) == (interval > 0.2)


def test_late_times_are_exact(env):
    """At 1000 s a time comes in steps of a millisecond; the offsets do not tremble with it."""
    served = ServedAgent(Steady, env)
    for k in range(161):
        points = served.answer(message(1000.0 + 0.0125 * k, status=int(k > 0)))
    assert points.pitch_offset_1 == pytest.approx(161 * 0.0125 * RATE, abs=0.0015 * RATE)


def test_a_missing_reading_lets_rosco_act_alone(env, caplog):
    caplog.set_level(logging.INFO)
    served = ServedAgent(Steady, env)
    for k in range(6):
        before = served.answer(message(0.1 * k, status=int(k > 0)))
    gone = [served.answer(message(0.1 * k, n7=math.nan)) for k in range(6, 14)]
    assert gone[0].pitch_offset_1 == pytest.approx(before.pitch_offset_1 - 0.1 * RATE)
    assert gone[0].pitch_offset_2 == pytest.approx(min(before.pitch_offset_2 + 0.1 * RATE, 0.0))
    assert offsets_of(gone[-1]) == [0.0, 0.0, 0.0]
    assert caplog.text.count("no RotSpeed at 0.6 s, ROSCO acts alone") == 1
    back = served.answer(message(1.4))
    assert back.pitch_offset_1 == pytest.approx(0.1 * RATE)
    assert caplog.text.count("all readings are back at 1.4 s") == 1


@pytest.mark.parametrize("heading", [0.0, 20.0, -25.0, 340.0, 170.0])
def test_the_acceleration_of_a_nacelle_that_heads_elsewhere_is_its_own(env, heading):
    """ROSCO sends the acceleration along an axis that does not yaw: a part of the fore-aft one, of either sign."""
    agent = Steady()
    for turned in (0.4 * math.cos(math.radians(heading)), 0.4):
        served = ServedAgent(lambda: agent, env)
        served.answer(message(0.0, status=0, n9=heading if len(agent.seen) == 0 else 0.0, n15=turned))
    assert agent.seen[0] == pytest.approx(agent.seen[1], rel=1e-5)
    assert abs(agent.seen[1][env.layout.observation.index("nacelle_acceleration_fore_aft")]) > 0.01


@pytest.mark.parametrize(("heading", "said"), [(45.0, r"NacHeading must be within 30 deg"), (math.nan, "no FA_Acc_TT")])
def test_an_acceleration_across_the_nacelle_lets_rosco_act_alone(env, heading, said, caplog):
    points = ServedAgent(Steady, env).answer(message(0.0, status=0, n9=heading))
    assert points == SetPoints()
    assert said in caplog.text


def test_a_reading_that_the_agent_does_not_need_may_be_missing():
    env = WindTurbineEnv(**(KWARGS | {"pitch": "individual", "observation": ["rotor_speed"]}))
    served = ServedAgent(Steady, env)
    missing = {f"n{place}": math.nan for place in range(4, 18) if place != 7}
    assert served.answer(message(0.0, status=0, **missing)).pitch_offset_1 > 0.0
    turning = WindTurbineEnv(**(KWARGS | {"observation": ["rotor_speed"]}))
    assert ServedAgent(Steady, turning).answer(message(0.0, status=0, n17=math.nan)) == SetPoints()


def test_turbines_do_not_know_each_other_and_begin_again(env):
    served = ServedAgent(Steady, env)
    for k in range(10):
        first = served.answer(message(0.1 * k, status=int(k > 0)))
    second = served.answer(message(0.0, number=1, status=0))
    assert second.pitch_offset_1 == pytest.approx(0.1 * RATE)
    assert served.answer(message(1.0)).pitch_offset_1 == pytest.approx(first.pitch_offset_1 + 0.1 * RATE)
    assert served.answer(message(0.0, status=0)) == second
    assert served.answer(message(50.0)) == second  # 50 s are no interval
    assert served.answer(message(3.0)) == second
    served.forget(0)
    assert served.answer(message(3.1)) == second


def test_an_agent_whose_action_means_nothing_is_left_out(env, caplog):
    agent = Steady()
    served = ServedAgent(lambda: agent, env)
    served.answer(message(0.0, status=0))
    agent.action = np.array([math.nan, 0.0, 0.0])
    for k in range(2, 7):
        points = served.answer(message(0.2 * k - 0.2))
    assert points == SetPoints()
    assert caplog.text.count("ROSCO acts alone from now on: action components must be finite") == 1


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"observation": ["rotor", "pitch", "controller"]}, "it does not send pitch_1, pitch_2, pitch_3, pitch_rate_1"),
        ({"observation": ["lidar", "root_flap_moment_tilt"], "history": 2}, "lidar_1, .*, root_flap_moment_tilt;"),
        ({"action_components": ["pitch", "torque"]}, "version 2.10 does not apply it"),
        ({"action_components": ["pitch", "yaw"]}, "an offset of the yaw error and no yaw rate"),
        ({"residual_fade": True}, "it does not send the pitch, by which residual_fade fades"),
        ({"action_mode": "rate", "pitch": "individual", "observation": ["rotor"]}, "must be 'residual', got 'rate'"),
    ],
)  # fmt: skip
def test_what_cannot_be_said_over_the_interface_is_refused(more, said):
    with pytest.raises(ControllerError, match=said):
        check_expressible(WindTurbineEnv(**(KWARGS | more)))


def test_the_training_of_the_page_gives_an_agent_that_is_served():
    """Its printed words, as the command reads them, under the check of the server."""
    page = Path(__file__).resolve().parents[2] / "docs" / "howto" / "serve.md"
    (found,) = re.findall(r"^wt-gym train (.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    config = configuration(parse_command("train", shlex.split(found)))
    assert config.env_kwargs["controller"] == "rosco"
    without_rosco = config.env_kwargs | {"controller": "discon"}  # which is not installed everywhere
    env = WindTurbineEnv(**registered_arguments(config.env_id, without_rosco))
    check_expressible(env)
    assert "root_out_of_plane_moment_tilt" in env.layout.observation.names


OWN = '''
class Agent:
    env_kwargs = {"observation": ["rotor_speed"], "action_components": ["pitch"], "residual_fade": False}

    def __init__(self, layout, size=1.0):
        self.action = [size] * layout.action.size

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return self.action, state


class Farm:
    """As users of ROSCO write it."""

    def __init__(self, speed=0.9):
        self.speed = speed

    def update_setpoints(self, id, current_time, measurements):
        return {"ZMQ_YawOffset": 10.0 * id + measurements["NacVane"], "ZMQ_R_Speed": self.speed}


class Wrong:
    def update_setpoints(self, id, current_time, measurements):
        return {"YawOffset": 1.0} if id else {"ZMQ_R_Speed": float("nan")}


class Neither:
    pass
'''


@pytest.fixture
def own(tmp_path):
    file = tmp_path / "own.py"
    file.write_text(OWN, encoding="utf-8")
    return file


def test_agents_of_the_user_are_served_and_wrong_set_points_refused(own):
    agent = answers_of(f"{own}:Agent:size=0.5", turbine="nrel_5mw")
    assert agent.answer(message(0.0, status=0)).pitch_offset_1 != 0.0
    assert answers_of("zero").answer(message(0.0, status=0)) == SetPoints()
    points = SetPoints(yaw_offset=math.radians(24.0), speed_rating=0.8)
    assert answers_of(f"{own}:Farm:speed=0.8").answer(message(0.0, number=2)) == pytest.approx(points)
    wrong = answers_of(f"{own}:Wrong")
    with pytest.raises(ControllerError, match=r"set points must be among ZMQ_TorqueOffset, .*, got YawOffset"):
        wrong.answer(message(0.0, number=1))
    with pytest.raises(ControllerError, match="must be finite, got ZMQ_R_Speed = nan"):
        wrong.answer(message(0.0))
    with pytest.raises(ControllerError, match="must have predict, of an agent, or update_setpoints"):
        answers_of(f"{own}:Neither")
    with pytest.raises(ControllerError, match="offsets on ROSCO's own demands; the controller ipc"):
        answers_of("ipc")
    with pytest.raises(ControllerError, match=r"must see what ROSCO sends, got disturbance_flap_mean_1.*export it"):
        answers_of("agents/trained/load_reduction")


def test_the_command_serves_until_the_last_call(capsys, tmp_path):
    """On a port of its own, with the last call right after the first."""
    with RoscoServer("tcp://127.0.0.1:*", answers_of("zero")) as free:
        port = free.address.rpartition(":")[2]
    ended = threading.Event()

    def turbine():
        client = Client(f"tcp://127.0.0.1:{port}")
        for status in (0, 1, -1):
            client.ask([0, status, 0.1, 5e6, 5e6, 122.0, 1.2, 4e4, 0, 0, 16.0, 5e6, 5e6, 5e6, 0, 0, 1.0])
        client.close()
        ended.set()

    threading.Thread(target=turbine).start()
    run_command("serve", ["zero", "--port", port, "--timeout", "60", "--log", str(tmp_path / "log.txt")])
    assert ended.wait(10.0)
    assert capsys.readouterr().out.splitlines() == [
        f"listening at tcp://127.0.0.1:{port}; Ctrl-C ends",
        "3 messages answered",
    ]
    with pytest.raises(SystemExit, match="port must be from 1 to 65535, got 0"):
        run_command("serve", ["zero", "--port", "0"])


@pytest.mark.parametrize(
    ("words", "idle"), [([], 600.0), (["--stay"], None), (["--stay", "--timeout", "5"], 5.0), (["--timeout", "5"], 5.0)]
)
def test_a_server_that_stays_has_no_time_out_unless_one_is_given(words, idle, monkeypatch):
    made = []

    class Noted(RoscoServer):
        def __init__(self, address, answers, timeout=None):
            made.append(timeout)
            super().__init__("tcp://127.0.0.1:*", answers, timeout)

        def serve(self, stay=False, turbines=1):
            made.append((stay, turbines))
            return 0

    monkeypatch.setattr("wt_gym.bridges.rosco.RoscoServer", Noted)
    run_command("serve", ["zero", "--turbines", "3", *words])
    assert made == [idle, ("--stay" in words, 3)]
