"""A server for turbines under ROSCO: each of their messages is answered with set points."""

from __future__ import annotations

import logging
import math
import time
from typing import TYPE_CHECKING, Protocol

from wt_gym.base.errors import ServerError
from wt_gym.bridges.rosco.messages import (
    FIRST_CALL,
    LAST_CALL,
    Message,
    MessageError,
    SetPoints,
    read_message,
    write_set_points,
)

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
    answered, gets the set points with which ROSCO acts alone. A turbine whose answer has failed gets these until it
    begins again; the others continue.

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
    wt_gym.base.errors.ServerError
        If the address is none, or taken.
    """

    def __init__(self, address: str, answers: Answers, timeout: float | None = None):
        import zmq  # an extra

        if timeout is not None and not 0.0 < timeout < math.inf:
            raise ValueError(f"timeout must be positive and finite, got {timeout!r} s")
        self._answers, self._timeout = answers, timeout
        self._connected: dict[int, bool] = {}
        self._failed: set[int] = set()
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

    def serve(self, stay: bool = False, turbines: int = 1) -> int:
        """Answer until every turbine that has reported has made its last call.

        Parameters
        ----------
        stay : bool
            Wait for the next simulation instead.
        turbines : int
            Turbines that must have reported before the last call of all of them is the end.

        Returns
        -------
        int
            Messages answered.

        Raises
        ------
        wt_gym.base.errors.ServerError
            If no message comes for too long.
        ValueError
            If the number of turbines is below 1.
        """
        if turbines < 1:
            raise ValueError(f"turbines must be 1 or more, got {turbines!r}")
        count = 0
        while stay or len(self._connected) < turbines or any(self._connected.values()):
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
        reply = write_set_points(SetPoints())
        message = self._socket.recv()
        try:
            reply = self._reply(message)
        finally:  # the client waits, after an interrupt too
            self._socket.send(reply)

    def _reply(self, message: bytes) -> bytes:
        try:
            readings = read_message(message)
        except MessageError as error:
            _log.warning("message not understood, ROSCO acts alone: %s", error)
            return write_set_points(SetPoints())
        try:
            return write_set_points(self._points(readings))
        except Exception:  # agents are anybody's code: one that fails must not end the simulations of other turbines
            _log.exception(
                "turbine %d: no answer at %g s, ROSCO acts alone from now on", readings.turbine_id, readings.time
            )
            self._failed.add(readings.turbine_id)
            return write_set_points(SetPoints())

    def _points(self, readings: Message) -> SetPoints:
        number = readings.turbine_id
        if readings.status == LAST_CALL:
            _log.info("turbine %d: last call at %g s", number, readings.time)
            self._connected[number] = False
            self._failed.discard(number)
            self._answers.forget(number)
            return SetPoints()
        if readings.status == FIRST_CALL or not self._connected.get(number):
            _log.info("turbine %d: begins at %g s", number, readings.time)
            self._failed.discard(number)
        self._connected[number] = True
        if number in self._failed:
            return SetPoints()
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
