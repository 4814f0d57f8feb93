"""What stands in for ROSCO: a client that speaks as its own does, and a controller with it beneath."""

import math

import zmq

from wt_gym.control import Demand

ROOM = 17 * (20 + 1)
"""Characters of the client's buffers."""
NEUTRAL = [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0]


def text_of(values):
    """Message of ROSCO's client: seven digits, commas, and the whole buffer, filled up with nulls."""
    text = ",".join(f"{value:.6e}" for value in values).encode()
    return text + bytes(ROOM - len(text))


def read_as_c(reply):
    """Eight numbers as the client reads them: up to a null, divided at commas, each by ``atof``."""
    assert len(reply) <= ROOM
    text, null, _ = reply.partition(b"\0")
    assert null, "the client's buffer holds anything behind the reply"
    return [float(word) for word in text.decode().split(",")]


class Client:
    """One turbine's end of the line.

    Parameters
    ----------
    address : str
    number : int
        ZMQ_ID.
    """

    def __init__(self, address, number=0):
        self.context = zmq.Context()
        self.socket = self.context.socket(zmq.REQ)
        self.socket.setsockopt(zmq.LINGER, 0)
        self.socket.setsockopt(zmq.RCVTIMEO, 20000)
        self.socket.connect(address)
        self.number = number

    def ask(self, values):
        """Set points for 17 readings."""
        return self.ask_raw(text_of(values))

    def ask_raw(self, message):
        self.socket.send(message)
        return read_as_c(self.socket.recv())

    def close(self):
        self.socket.close()
        self.context.term()


def readings(signals, number, status):
    """Readings of a turbine at an instant, in ROSCO's order and units."""
    moments = []
    for b in (1, 2, 3):
        pitch = signals[f"pitch_{b}"]
        flap, edge = signals[f"root_flap_moment_{b}"], signals[f"root_edge_moment_{b}"]
        moments.append(flap * math.cos(pitch) - edge * math.sin(pitch))
    yaw, fore_aft = signals["yaw"], signals["nacelle_acceleration_fore_aft"]
    along_x = fore_aft * math.cos(yaw) - signals["nacelle_acceleration_side_side"] * math.sin(yaw)
    return [
        number, status, signals["time"], signals["shaft_torque"] * signals["rotor_speed"], signals["generator_power"],
        signals["generator_speed"], signals["rotor_speed"], signals["generator_torque"], math.degrees(signals["yaw"]),
        math.degrees(signals["yaw_error"]), math.hypot(signals["wind_x"], signals["wind_y"]), *moments,
        along_x, 0.0, signals["azimuth"],
    ]  # fmt: skip


class WithServer:
    """A controller that adds the pitch offsets of a server to those of another one, as ROSCO does."""

    def __init__(self, base, client):
        self.base, self.client, self.status, self.offsets = base, client, 0, []
        self.channels = base.channels

    def start(self, signals, demand):
        self.base.start(signals, demand)

    def step(self, signals, dt):
        own = self.base.step(signals, dt)
        points = self.client.ask(readings(signals, self.client.number, self.status))
        self.status = 1
        self.offsets.append(points[2:5])
        return Demand(own.pitch + points[2:5], own.yaw_rate, own.generator_torque)
