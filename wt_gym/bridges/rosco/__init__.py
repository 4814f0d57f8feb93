"""ROSCO's ZeroMQ interface: its messages, and a server that answers them."""

from wt_gym.bridges.rosco.messages import (
    READINGS,
    SET_POINTS,
    Message,
    MessageError,
    SetPoints,
    read_message,
    write_set_points,
)
from wt_gym.bridges.rosco.server import RoscoServer

__all__ = [
    "READINGS",
    "SET_POINTS",
    "Message",
    "MessageError",
    "RoscoServer",
    "SetPoints",
    "read_message",
    "write_set_points",
]
