"""ROSCO's ZeroMQ interface: messages in both directions, and the server."""

import contextlib
import importlib.util
import math
import re
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest

zmq = pytest.importorskip("zmq")

from envs_tests.unit.rosco_client import NEUTRAL, Client, read_as_c, text_of  # noqa: E402
from wt_gym.base.errors import ServerError  # noqa: E402
from wt_gym.bridges.rosco import (  # noqa: E402
    READINGS,
    SET_POINTS,
    MessageError,
    RoscoServer,
    SetPoints,
    read_message,
    write_set_points,
)

VALUES = [3, 1, 12.5, 5.3e6, 5.0e6, 122.9, 1.267, 43093.55, -10.0, 4.0, 16.2, 5.1e6, -5.2e6, 5.3e6, -0.12, 0.01, 6.1]


class Counting:
    """Answers with the torque offset counting the messages of a turbine."""

    def __init__(self):
        self.counts, self.forgotten = {}, []

    def answer(self, message):
        self.counts[message.turbine_id] = self.counts.get(message.turbine_id, 0) + 1
        if message.generator_power < 0.0:
            raise ArithmeticError("broken")
        return SetPoints(torque_offset=float(self.counts[message.turbine_id]))

    def forget(self, turbine_id):
        self.forgotten.append(turbine_id)


@contextlib.contextmanager
def serving(answers, *numbers, timeout=20.0, **options):
    """Clients of turbines with these numbers at a server in a thread of its own, and what that ended with."""
    with RoscoServer("tcp://127.0.0.1:*", answers, timeout) as server, contextlib.ExitStack() as stack:
        ended = []

        def serve():
            try:
                ended.append(server.serve(**options))
            except (ServerError, ArithmeticError) as error:
                ended.append(error)

        thread = threading.Thread(target=serve)
        thread.start()
        yield *(stack.enter_context(contextlib.closing(Client(server.address, n))) for n in numbers), ended
        stack.close()
        thread.join(30.0)
        assert not thread.is_alive()


def first(number):
    return [number, 0, 0.0, *VALUES[3:]]


def last(number):
    return [number, -1, 9.0, *VALUES[3:]]


def test_readings_come_in_si_units():
    found = read_message(text_of(VALUES))
    assert (found.turbine_id, found.status, found.time) == (3, 1, 12.5)
    assert found.yaw == pytest.approx(math.radians(-10.0), rel=1e-6)
    assert found.yaw_error == pytest.approx(math.radians(4.0), rel=1e-6)
    assert (found.shaft_power, found.generator_power) == (5.3e6, 5.0e6)
    assert (found.generator_speed, found.rotor_speed, found.generator_torque) == (122.9, 1.267, 43093.55)
    assert (found.wind_speed, found.out_of_plane_moments) == (16.2, (5.1e6, -5.2e6, 5.3e6))
    assert (found.acceleration_fore_aft, found.angular_acceleration, found.azimuth) == (-0.12, 0.01, 6.1)


@pytest.mark.parametrize(
    ("message", "said"),
    [
        (b"", "17 numbers, got 1"),
        (text_of(VALUES[:16]), "17 numbers, got 16"),
        (text_of([*VALUES, 1.0]), "17 numbers, got 18"),
        (text_of(VALUES).replace(b"1.620000e+01", b"hello"), "HorWindV must be a number, got 'hello'"),
        (b"\xff" * 30, "17 numbers"),
        (text_of([0.5, *VALUES[1:]]), "ZMQ_ID must be a whole number from 0 to 9999, got 0.5"),
        (text_of([10000, *VALUES[1:]]), "ZMQ_ID"),
        (text_of([math.nan, *VALUES[1:]]), "ZMQ_ID"),
        (text_of([0, math.inf, *VALUES[2:]]), "iStatus must be a whole number"),
        (text_of([0, 1, math.nan, *VALUES[3:]]), "Time must be finite"),
    ],
)
def test_what_is_no_message_is_refused(message, said):
    with pytest.raises(MessageError, match=said):
        read_message(message)


def test_a_reading_that_is_left_out_is_not_a_number():
    found = read_message(text_of(VALUES).replace(b"1.620000e+01", b"").replace(b"6.100000e+00", b"-nan"))
    assert math.isnan(found.wind_speed)
    assert math.isnan(found.azimuth)


def test_set_points_go_out_in_roscos_order_and_units():
    reply = write_set_points(SetPoints(-1234.5, math.radians(20.0), 0.01, -1e-9, 1 / 3, 0.9, 0.8, 0.7))
    assert read_as_c(reply) == pytest.approx([-1234.5, 20.0, 0.01, -1e-9, 1 / 3, 0.9, 0.8, 0.7], rel=1e-14)
    assert read_as_c(write_set_points(SetPoints())) == NEUTRAL
    longest = -1.23456789012345e-300
    assert len(write_set_points(SetPoints(*[longest] * 8))) < 357
    with pytest.raises(ValueError, match="finite"):
        write_set_points(SetPoints(pitch_offset_2=math.nan))


def test_order_and_neutral_values_are_those_of_the_package():
    """Of its registry, which its own server reads."""
    spec = importlib.util.find_spec("rosco")
    if spec is None:
        pytest.skip("the package rosco is not installed: pip install --no-deps rosco")
    yaml = pytest.importorskip("yaml")
    (folder,) = spec.submodule_search_locations
    registry = Path(folder) / "controller" / "rosco_registry" / "wfc_interface.yaml"
    told = yaml.safe_load(registry.read_text(encoding="utf-8"))
    assert [field.name for field in READINGS] == told["measurements"]
    assert [field.name for field in SET_POINTS] == told["setpoints"]
    assert [field.neutral for field in SET_POINTS] == told["setpoints_default"]


def test_the_packages_own_server_reads_the_same(monkeypatch):
    """Its parser on the same bytes, and what it sends read by this client."""
    if importlib.util.find_spec("rosco") is None:
        pytest.skip("the package rosco is not installed: pip install --no-deps rosco")
    yaml = pytest.importorskip("yaml")
    files = SimpleNamespace(load_yaml=lambda path: yaml.safe_load(Path(path).read_text(encoding="utf-8")))
    monkeypatch.setitem(sys.modules, "rosco.toolbox.ofTools.util.FileTools", files)  # which needs more packages
    module = importlib.import_module("rosco.toolbox.control_interface")
    with monkeypatch.context() as quiet:
        quiet.setattr(module.logging, "disable", lambda: None)  # for the whole process
        theirs = module.wfc_zmq_server("tcp://127.0.0.1:*", timeout=20.0)
    with contextlib.closing(zmq.Context().socket(zmq.REQ)) as client:
        client.connect(theirs.socket.getsockopt_string(zmq.LAST_ENDPOINT))
        client.send(text_of(VALUES))
        found, ours = theirs._get_measurements(), read_message(text_of(VALUES))
        assert (found["HorWindV"], found["NacVane"]) == (ours.wind_speed, pytest.approx(math.degrees(ours.yaw_error)))
        assert tuple(found[f"rootMOOP({b})"] for b in (1, 2, 3)) == ours.out_of_plane_moments
        theirs.connections._add_unique(3)
        theirs.connections.setpoints[3] = dict(zip(theirs.wfc_interface["setpoints"], NEUTRAL, strict=True))
        theirs._send_setpoints(3)
        assert read_as_c(client.recv() + b"\0") == NEUTRAL
        theirs._disconnect()


def test_each_turbine_has_its_own_answers_and_the_last_one_ends_the_server():
    answers = Counting()
    with serving(answers, 0, 7) as (one, two, ended):
        assert one.ask(first(0))[0] == 1.0
        assert [two.ask(first(7))[0], two.ask([7, 1, 0.1, *VALUES[3:]])[0]] == [1.0, 2.0]
        assert one.ask([0, 1, 0.1, *VALUES[3:]])[0] == 2.0
        assert one.ask(last(0)) == NEUTRAL
        assert two.ask([7, 1, 0.2, *VALUES[3:]])[0] == 3.0
        assert two.ask(last(7)) == NEUTRAL
    assert ended == [7]
    assert answers.forgotten == [0, 7]


def test_what_is_not_understood_is_answered_and_said(caplog):
    with serving(Counting(), 0) as (client, _):
        assert client.ask_raw(b"hello") == NEUTRAL
        assert "message not understood, ROSCO acts alone" in caplog.text
        assert client.ask(first(0))[0] == 1.0
        client.ask(last(0))


def test_a_turbine_whose_answer_fails_has_rosco_alone_and_the_others_go_on(caplog):
    answers = Counting()
    with serving(answers, 0, 7, turbines=2) as (one, two, ended):
        assert one.ask(first(0))[0] == 1.0
        assert two.ask(first(7))[0] == 1.0
        assert one.ask([0, 1, 0.1, 0.0, -1.0, *VALUES[5:]]) == NEUTRAL
        assert one.ask([0, 1, 0.2, *VALUES[3:]]) == NEUTRAL
        assert two.ask([7, 1, 0.2, *VALUES[3:]])[0] == 2.0
        one.ask(last(0))
        assert one.ask(first(0))[0] == 3.0  # the next simulation is another one
        one.ask(last(0))
        two.ask(last(7))
    assert ended == [9]
    assert caplog.text.count("turbine 0: no answer at 0.1 s, ROSCO acts alone from now on") == 1
    assert "ArithmeticError: broken" in caplog.text


def test_the_server_waits_for_turbines_that_have_not_reported_yet():
    with serving(Counting(), 0, 7, turbines=2) as (one, two, ended):
        one.ask(first(0))
        one.ask(last(0))
        assert two.ask(first(7))[0] == 1.0
        two.ask(last(7))
    assert ended == [4]
    with RoscoServer("tcp://127.0.0.1:*", Counting()) as server, pytest.raises(ValueError, match="must be 1 or more"):
        server.serve(turbines=0)


def test_a_client_that_is_gone_before_its_answer_holds_nobody_up():
    with serving(Counting(), 1, 0) as (gone, client, _):
        gone.socket.setsockopt(zmq.LINGER, 5000)
        gone.socket.send(text_of(first(1)))
        gone.close()
        assert client.ask(first(0))[0] == 1.0
        client.ask(last(1))
        client.ask(last(0))


def test_silence_ends_the_server():
    with serving(Counting(), 4, timeout=0.5) as (client, ended):
        client.ask(first(4))
    assert "no message of turbine 4 came for 0.5 s" in str(ended[0])
    with serving(answers := Counting(), 0, timeout=1.0, stay=True) as (client, ended):
        for _ in range(2):  # a turbine may begin again
            client.ask(first(0))
            client.ask(last(0))
    assert answers.forgotten == [0, 0]
    assert "no message of any turbine came for 1 s" in str(ended[0])


def test_an_address_that_is_taken_or_none_is_refused():
    with (
        RoscoServer("tcp://127.0.0.1:*", Counting()) as server,
        pytest.raises(ServerError, match=rf"must be free, got {re.escape(server.address)}"),
    ):
        RoscoServer(server.address, Counting())
    with pytest.raises(ServerError, match="must be one of ZeroMQ as 'tcp://\\*:5555', got 'nonsense'"):
        RoscoServer("nonsense", Counting())
    with pytest.raises(ValueError, match="timeout must be positive and finite, got 0"):
        RoscoServer("tcp://127.0.0.1:*", Counting(), 0)
