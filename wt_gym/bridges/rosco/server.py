"""A server for turbines under ROSCO: each of their messages is answered with set points."""

from __future__ import annotations

import logging
import math
import time
from typing import TYPE_CHECKING, Protocol

from wt_gym.bridges.rosco.messages import (
    FIRST_CALL,
    LAST_CALL,
    Message,
    MessageError,
    SetPoints,
    read_message,
    write_set_points,
)
from wt_gym.errors import ServerError

if TYPE_CHECKING:
    from types import TracebackType
    from typing import Self

__all__ = ["Answers", "RoscoServer"]

_log = logging.getLogger(__name__)
_SLICE = 0.2
"""Longest wait at a time [s], so that an interrupt is heard on every system."""


class Answers(Protocol):
    """What gives set points for messages."""

    def answer(self, message: Message) -> SetPoints:
        """Set points for a turbine from its readings."""
        ...

    def forget(self, turbine_id: int) -> None:
        """Drop what is remembered of a turbine."""
        ...


class RoscoServer:
    """Answers turbines under ROSCO over ZeroMQ, one message after another; a context, which closes the socket.

    ROSCO's client waits without limit for its answer. Hence every message gets one: what cannot be read, or fails to be
    answered, gets the set points with which ROSCO acts alone.

    Parameters
    ----------
    address : str
        Of ZeroMQ, as ``"tcp://*:5555"``.
    answers : Answers
    timeout : float, optional
        Longest time without a message [s]; None: no limit.

    Raises
    ------
    ModuleNotFoundError
        Without the package pyzmq.
    wt_gym.errors.ServerError
        If the address is none, or taken.
    """

    def __init__(self, address: str, answers: Answers, timeout: float | None = None):
        import zmq  # an extra

        if timeout is not None and not 0.0 < timeout < math.inf:
            raise ValueError(f"timeout must be positive and finite, got {timeout!r} s")
        self._answers, self._timeout = answers, timeout
        self._connected: dict[int, bool] = {}
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.REP)
        self._socket.setsockopt(zmq.LINGER, 1000)  # the last answer is sent, an unread one holds nobody up [ms]
        try:
            self._socket.bind(address)
        except zmq.ZMQError as error:
            self.close()
            if error.errno == zmq.EADDRINUSE:
                raise ServerError(
                    f"the address must be free, got {address}, on which another program listens: give another port"
                ) from error
            raise ServerError(
                f"the address must be one of ZeroMQ as 'tcp://*:5555', got {address!r}: {error}"
            ) from error
        self.address = self._socket.getsockopt_string(zmq.LAST_ENDPOINT)
        """Address at which it listens, with the port that was found for ``:*``."""

    def serve(self, stay: bool = False) -> int:
        """Answer until every turbine that has reported has made its last call.

        Parameters
        ----------
        stay : bool
            Wait for the next simulation instead.

        Returns
        -------
        int
            Messages answered.

        Raises
        ------
        wt_gym.errors.ServerError
            If no message comes for too long.
        """
        count = 0
        while stay or not self._connected or any(self._connected.values()):
            self._wait()
            self._answer()
            count += 1
        _log.info("every turbine has made its last call")
        return count

    def _wait(self) -> None:
        """Wait for a message."""
        begin = time.monotonic()
        while not self._socket.poll(round(1000 * _SLICE)):
            if self._timeout is not None and time.monotonic() - begin > self._timeout:
                connected = [str(number) for number, is_connected in self._connected.items() if is_connected]
                of = f"turbine {', '.join(connected)}" if connected else "any turbine"
                raise ServerError(f"no message of {of} came for {self._timeout:g} s")

    def _answer(self) -> None:
        """Receive a message and answer it."""
        message, reply = self._socket.recv(), write_set_points(SetPoints())
        try:
            reply = write_set_points(self._points(message))
        finally:  # whatever happened, the client waits
            self._socket.send(reply)

    def _points(self, message: bytes) -> SetPoints:
        try:
            readings = read_message(message)
        except MessageError as error:
            _log.warning("message not understood, ROSCO acts alone: %s", error)
            return SetPoints()
        number = readings.turbine_id
        if readings.status == LAST_CALL:
            _log.info("turbine %d: last call at %g s", number, readings.time)
            self._connected[number] = False
            self._answers.forget(number)
            return SetPoints()
        if readings.status == FIRST_CALL or not self._connected.get(number):
            _log.info("turbine %d: begins at %g s", number, readings.time)
        self._connected[number] = True
        return self._answers.answer(readings)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
        self._context.term()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
