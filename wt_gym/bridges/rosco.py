"""ROSCO's ZeroMQ interface (``ZMQ_Mode`` 1), as of its version 2.10: its messages, and a server that answers them.

A turbine sends its readings as numbers in text, separated by commas, with a null behind them, and waits for the set
points in the same form. Order and units follow ROSCO's ``ZeroMQInterface.f90``, ``ReadSetParameters.f90`` and
``wfc_interface.yaml`` (github.com/NREL/ROSCO); numbers come with seven digits.
"""

import logging
import math
import time
from dataclasses import astuple, dataclass
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

from wt_gym.base.errors import ServerError, WtGymError
from wt_gym.base.files import read_rows

FIRST_CALL, LAST_CALL = 0, -1
"""Status of the first message of a simulation and of the last one."""
MOST_BLADES = 3


class MessageError(WtGymError, ValueError):
    """A message is not one of ROSCO's."""


@dataclass(frozen=True)
class Field:
    """One number of a message: name in ROSCO's registry, unit, meaning, and the value with which ROSCO acts alone."""

    name: str
    unit: str
    meaning: str
    neutral: float = math.nan


def _read_fields(message: str) -> tuple[Field, ...]:
    """Fields of a message in the table; a reading has no neutral value."""
    rows = [row for row in read_rows(Path(__file__).with_suffix(".csv")) if row["message"] == message]
    return tuple(Field(row["name"], row["unit"], row["meaning"], float(row["neutral"] or math.nan)) for row in rows)


READINGS, SET_POINTS = _read_fields("readings"), _read_fields("set_points")
"""Fields of `Message`, whose moments are one of three, and of `SetPoints`."""
_GREATEST_ID = 9999


@dataclass(frozen=True)
class Message:
    """Readings of a turbine at an instant, in SI units and radians, in the order of `READINGS`."""

    turbine_id: int
    status: int
    time: float
    shaft_power: float
    generator_power: float
    generator_speed: float
    rotor_speed: float
    generator_torque: float
    yaw: float
    yaw_error: float
    wind_speed: float
    out_of_plane_moments: tuple[float, float, float]
    acceleration_fore_aft: float
    angular_acceleration: float
    azimuth: float


@dataclass(frozen=True)
class SetPoints:
    """Demands on a turbine, in SI units and radians, in the order of `SET_POINTS`; by default ROSCO acts alone."""

    torque_offset: float = 0.0
    yaw_offset: float = 0.0
    pitch_offset_1: float = 0.0
    pitch_offset_2: float = 0.0
    pitch_offset_3: float = 0.0
    speed_rating: float = 1.0
    torque_rating: float = 1.0
    pitch_rating: float = 1.0


def read_numbers(message: bytes) -> list[float]:
    """Numbers of a message in the order of `READINGS` and in ROSCO's units; what is left out is not a number."""
    text = message.partition(b"\0")[0].decode("ascii", errors="replace")
    words = [word.strip() for word in text.split(",")]
    if len(words) != len(READINGS):
        raise MessageError(f"a message must have {len(READINGS)} numbers, got {len(words)}: {text[:200]!r}")
    values = []
    for field, word in zip(READINGS, words, strict=True):
        try:
            values.append(float(word or "nan"))
        except ValueError:
            raise MessageError(f"{field.name} must be a number, got {word[:30]!r}") from None
    return values


def read_message(message: bytes) -> Message:
    """Read what a turbine sends; a reading that is left out or no number is nan."""
    values = read_numbers(message)
    given, status, time = values[:3]
    if not (given.is_integer() and 0 <= given <= _GREATEST_ID):
        raise MessageError(f"ZMQ_ID must be a whole number from 0 to {_GREATEST_ID}, got {given!r}")
    if not status.is_integer():
        raise MessageError(f"iStatus must be a whole number, got {status!r}")
    if not math.isfinite(time):
        raise MessageError(f"Time must be finite, got {time!r}")
    si = [math.radians(v) if field.unit == "deg" else v for field, v in zip(READINGS, values, strict=True)]
    return Message(int(given), int(status), *si[2:11], tuple(si[11:14]), *si[14:])  # type: ignore[arg-type, call-arg]


def write_set_points(points: SetPoints) -> bytes:
    """Write what a turbine is to get.

    ROSCO's client does not end the text itself, so the message ends with a null; it has room for 357 characters.
    """
    if not all(map(math.isfinite, astuple(points))):
        raise ValueError(f"set points must be finite, got {points}")
    pairs = zip(SET_POINTS, astuple(points), strict=True)
    values = [math.degrees(v) if field.unit == "deg" else v for field, v in pairs]
    return ",".join(format(value, ".15g") for value in values).encode("ascii") + b"\0"


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
