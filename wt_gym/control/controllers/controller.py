"""The contract of every controller, how controllers are put together, and their memory as numbers.

A controller reads *signals*, anything that gives a channel of `wt_gym.simulation.channels` by name
(``signals["generator_speed"]``), and answers with a `wt_gym.control.Demand`. It is stepped at any interval: at the
simulator's own step (0.1 s in "training") or at the control step of an environment. All that it remembers lies in plain
attributes, so that ``copy.deepcopy`` of a controller is a snapshot which continues identically. A part that works on
another controller has it as its attribute ``base``, by which `part_of` looks for parts.

The numbers among the attributes, and among the attributes of the parts, have a fixed order (`memory_of`): attributes,
entries of dictionaries and sequences as they stand, arrays element by element. Whole numbers and flags stay what they
are when they are put back into another controller of the same kind (`remember`).
"""

from __future__ import annotations

import inspect
import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache, cached_property, partial
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeGuard, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from wt_gym.base.errors import ControllerError
from wt_gym.control.actions import Demand
from wt_gym.control.sensors import Lidar
from wt_gym.simulation import Signals
from wt_gym.turbines import Turbine
from wt_gym.wind import Inflow

T = TypeVar("T")

# ---- the contract ----


class Readings(Protocol):
    """Readings of a controller: `wt_gym.simulation.Signals`, a dict, or the channels of an observation."""

    def __getitem__(self, name: str) -> float:
        """Value of a channel in SI units; KeyError if there is none."""
        ...


class Reads(Protocol):
    """A part of a controller that reads signals."""

    if TYPE_CHECKING:  # read only: a property or an attribute of the class will do

        @property
        def channels(self) -> tuple[str, ...]:
            """Names of the signals that are read."""
            ...

    else:
        channels: tuple[str, ...]


@runtime_checkable
class Controller(Reads, Protocol):
    """A part that decides on all demands of a turbine."""

    def start(self, signals: Readings, demand: Demand) -> None:
        """Start bumplessly: forget everything and continue from the current demand on the actuators."""
        ...

    def step(self, signals: Readings, dt: float) -> Demand:
        """Give the demand that is held over the next ``dt`` [s], which is the time since the last step too."""
        ...


@runtime_checkable
class Addition(Reads, Protocol):
    """A part that changes the demand of a controller: individual pitch, a damper, a yaw drive."""

    def start(self, signals: Readings) -> None:
        """Forget everything: nothing is added at this instant."""
        ...

    def step(self, signals: Readings, dt: float, demand: Demand) -> Demand:
        """Change a demand that is to be held over the next ``dt`` [s]; the one given stays as it is."""
        ...


@runtime_checkable
class StartsTurbine(Protocol):
    """A controller that starts a parked turbine."""

    def runs_in(self, wind: float) -> bool:
        """Whether a turbine runs in a mean wind [m/s] at a start; else it stands with feathered blades."""
        ...


# ---- readings ----


class RepairedReadings:
    """Readings some of which are replaced by others, or that have further ones; ``measured`` are those underneath."""

    __slots__ = ("_values", "measured", "reference")

    def __init__(self, signals: Readings, values: Mapping[str, float]) -> None:
        self.measured, self._values = signals, values
        self.reference = getattr(signals, "reference", None)  # demanded power at any time, see `WithDemandedPower`

    def __getitem__(self, name: str) -> float:
        value = self._values.get(name)
        return self.measured[name] if value is None else value


@cache
def _gates(count: int) -> tuple[str, ...]:
    """Names of what the gates of a lidar see."""
    return tuple(f"lidar_{k + 1}" for k in range(count))


class WithLidar(RepairedReadings):
    """Signals, and the readings of a lidar as ``lidar_1`` … by gate [m/s].

    Parameters
    ----------
    seen : sequence of float
        Readings of the lidar, gate by gate [m/s].
    lidar : Lidar, optional
        Whose readings they are. With its beams apart ``lidar_1_1`` … are the readings, and ``lidar_1`` … the means over
        the beams of a gate.
    """

    __slots__ = ()

    def __init__(
        self, signals: Readings, seen: Sequence[float] | NDArray[np.float64], lidar: Lidar | None = None
    ) -> None:
        apart = lidar is not None and lidar.apart
        means = lidar.gate_means(seen).tolist() if lidar is not None and apart else list(map(float, seen))
        values = dict(zip(_gates(len(means)), means, strict=True))
        if lidar is not None and apart:
            values.update(zip(lidar.names, map(float, seen), strict=True))
        super().__init__(signals, values)


class WithDemandedPower(RepairedReadings):
    """Readings, and the power that a grid operator asks for as ``demanded_power`` [W].

    Parameters
    ----------
    demanded : float
        Present power [W].
    reference : object, optional
        Power at any time, for controllers that take it as a whole.
    """

    __slots__ = ()

    def __init__(self, signals: Readings, demanded: float, reference: object = None) -> None:
        super().__init__(signals, {"demanded_power": demanded})
        self.reference = reference


class AtSetPoint:
    """Readings with the speeds of the rotor over a set point: a controller then holds that set point in their place.

    Parameters
    ----------
    signals : Readings
        As they are measured.
    share : float
        Set point of the rotor speed over rated [-].
    power_share : float
        Factor on the power that the controller makes of these readings [-]; the demanded power is divided by it.

    Attributes
    ----------
    demanded : float or None
        Power that the controller is to make of these readings [W], None where nothing is asked for.
    """

    __slots__ = ("demanded", "measured", "share")

    def __init__(self, signals: Readings, share: float, power_share: float = 1.0) -> None:
        self.measured, self.share = signals, share
        demanded = demanded_power_of(signals)
        self.demanded = None if demanded is None else demanded / power_share

    def __getitem__(self, name: str) -> float:
        if name == "demanded_power" and self.demanded is not None:
            return self.demanded
        value = self.measured[name]
        return value / self.share if name in ("generator_speed", "rotor_speed") else value


def demanded_power_of(signals: Readings) -> float | None:
    """Power that a grid operator asks for [W]; None where nothing is asked for."""
    while not isinstance(signals, AtSetPoint | WithDemandedPower):
        if not isinstance(signals, RepairedReadings):
            known = isinstance(signals, Mapping) and "demanded_power" in signals
            return float(signals["demanded_power"]) if known else None
        signals = signals.measured
    return signals.demanded if isinstance(signals, AtSetPoint) else signals["demanded_power"]


# ---- parts ----


def parts_of(controller: Controller | Addition) -> tuple[Controller | Addition, ...]:
    """A controller alone, or the base and the additions that it is combined of."""
    return (controller.base, *controller.additions) if isinstance(controller, Combined) else (controller,)


def standing(controller: Controller | None) -> Iterator[Any]:
    """A controller, its base, the base of that, and so on; then the same of the additions that it is combined of."""
    for part in (controller, *(controller.additions if isinstance(controller, Combined) else ())):
        inner: Any = part
        while inner is not None:
            yield inner
            inner = getattr(inner, "base", None)


def part_of(controller: Controller | None, kind: type[T]) -> T | None:
    """Part of a class among the parts of a controller and what these stand on, the outermost; None without any."""
    return next((inner for inner in standing(controller) if isinstance(inner, kind)), None)


def starting_part(controller: Controller | None) -> StartsTurbine | None:
    """The outermost part of a controller that starts a parked turbine, None without any."""
    return part_of(controller, StartsTurbine)  # type: ignore[type-abstract]  # a protocol that can be asked for


def lidar_of(controller: Controller | None) -> Lidar | None:
    """Lidar that a controller or its base reads: the attribute ``lidar``, if that is a `Lidar`; None without any."""
    lidars = (getattr(inner, "lidar", None) for inner in standing(controller))
    return next((lidar for lidar in lidars if isinstance(lidar, Lidar)), None)


def damps_platform(controller: Controller | None) -> bool:
    """Return True if a part answers to the motion of a platform, by its attribute ``damps_platform``."""
    return any(getattr(inner, "damps_platform", False) for inner in standing(controller))


def readings_of(
    controller: Controller, signals: Signals, inflow: Inflow, hub_height: float, rotation: str = "clockwise"
) -> Readings:
    """Signals of the current instant for a controller, with the readings of its lidar if it has one.

    The hub height is in m; the rotation of the rotor, "clockwise" or "counter-clockwise", counts beams that are apart.
    """
    lidar = lidar_of(controller)
    if lidar is None:
        return signals
    return WithLidar(signals, lidar.read(inflow, signals["time"], signals["yaw"], hub_height, rotation), lidar)


def is_controller(candidate: object) -> TypeGuard[Controller]:
    """Whether something is a `Controller`; an `Addition` has the same names, but its methods take other arguments."""
    return _keeps(candidate, Controller, start=2, step=2)


def is_addition(candidate: object) -> TypeGuard[Addition]:
    """Whether something is an `Addition`."""
    return _keeps(candidate, Addition, start=1, step=3)


def _keeps(candidate: object, contract: type, **counts: int) -> bool:
    """Whether an object has what a contract names and its methods can be called with so many arguments."""
    if inspect.isclass(candidate) or not isinstance(candidate, contract):
        return False
    return all(_takes(getattr(candidate, name), count) for name, count in counts.items())


def _takes(method: Callable[..., Any], count: int) -> bool:
    try:
        inspect.signature(method).bind(*range(count))
    except TypeError:
        return False
    return True


def checked_demand(demand: Demand, controller: Controller, n_blades: int) -> Demand:
    """Give back the demand of a controller if a turbine with so many blades can be asked for it.

    Raises
    ------
    wt_gym.base.errors.ControllerError
        If it is not a `Demand`, has not one finite angle a blade, or a yaw rate or torque that is not finite.
    """
    if not isinstance(demand, Demand):
        raise ControllerError(f"the controller {_name(controller)} gave {demand!r}; must be a Demand")
    try:
        pitch = np.asarray(demand.pitch, dtype=np.float64)
        finite = all(map(math.isfinite, (demand.yaw_rate, demand.generator_torque, *pitch.ravel().tolist())))
    except (TypeError, ValueError) as error:
        raise ControllerError(f"the controller {_name(controller)} gave {demand!r}: {error}") from error
    if pitch.shape != (n_blades,):
        raise ControllerError(
            f"the pitch demand of the controller {_name(controller)} must have shape ({n_blades},), one angle a blade; "
            f"got {pitch.shape}"
        )
    if not finite:
        raise ControllerError(f"the demand of the controller {_name(controller)} must be finite, got {demand!r}")
    return demand if demand.pitch is pitch else replace(demand, pitch=pitch)


def _name(controller: Controller) -> str:
    """Classes of the parts of a controller."""
    return " + ".join(type(part).__name__ for part in parts_of(controller))


class Combined:
    """A controller with additions, each of which changes the demand of what stands before it, in their order.

    Examples
    --------
    >>> from wt_gym.control.controllers import Combined, DisconController, YawByDeadBand
    >>> from wt_gym.turbines import load_turbine
    >>> controller = Combined(DisconController(), YawByDeadBand(load_turbine("nrel_5mw")))
    >>> controller.channels
    ('generator_speed', 'yaw_error')
    """

    def __init__(self, base: Controller, *additions: Addition):
        if not is_controller(base):
            raise TypeError(
                f"the base must be a Controller (channels, start(signals, demand), step(signals, dt)), got {base!r}"
            )
        for addition in additions:
            if not is_addition(addition):
                raise TypeError(
                    f"an addition needs channels, start(signals) and step(signals, dt, demand), got {addition!r}"
                )
        self.base, self.additions = base, additions

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the signals that any part reads."""
        parts: tuple[Controller | Addition, ...] = (self.base, *self.additions)
        return tuple(dict.fromkeys(name for part in parts for name in part.channels))

    def start(self, signals: Readings, demand: Demand) -> None:
        """Start the base from the current demand, the additions from nothing."""
        self.base.start(signals, demand)
        for addition in self.additions:
            addition.start(signals)

    def step(self, signals: Readings, dt: float) -> Demand:
        """Demand of the base, changed by each addition in turn."""
        demand = self.base.step(signals, dt)
        for addition in self.additions:
            demand = addition.step(signals, dt, demand)
        return demand


# ---- memory ----

_CONSTANT = (str, bytes, Turbine, Lidar, type(None), np.random.Generator)
_LISTS = (list, deque)
_NUMBER = (bool, int, float, np.number)


class Memory(NamedTuple):
    """Numbers of a controller."""

    values: NDArray[np.float64]  #: shape (n,)
    sizes: NDArray[np.int_]
    """Of the parts: numbers, arrays, and lists of numbers, which may grow and shrink, shape (n_parts,)."""


def memory_of(controller: Controller) -> Memory:
    """All numbers in a controller."""
    parts = [np.ravel(value).astype(np.float64) for value, _ in _numbers(controller)]
    return Memory(np.concatenate([np.zeros(0), *parts]), np.array([part.size for part in parts], dtype=int))


def changing_parts(memories: Sequence[Memory]) -> NDArray[np.bool_]:
    """Which parts differ between memories of one controller, shape (n_parts,), bool: the others are its parameters."""
    first = _split(memories[0])
    changing = np.zeros(len(first), dtype=bool)
    for memory in memories[1:]:
        for k, (part, other) in enumerate(zip(first, _split(memory), strict=True)):
            changing[k] = changing[k] or not np.array_equal(part, other, equal_nan=True)
    return changing


def _split(memory: Memory) -> list[NDArray[np.float64]]:
    return np.split(memory.values[: memory.sizes.sum()], np.cumsum(memory.sizes)[:-1])


def remember(controller: Controller, memory: Memory, changing: NDArray[np.bool_]) -> None:
    """Put numbers of a controller of the same kind into one with its own copies of everything that changes.

    ``changing`` (n_parts,) says which parts to put; the others, its parameters, stay.

    Raises
    ------
    ValueError
        If the controller has other parts.
    """
    numbers = list(_numbers(controller))
    fixed = [not isinstance(value, _LISTS) for value, _ in numbers]
    if len(numbers) != len(memory.sizes) or any(
        is_fixed and np.size(value) != size
        for is_fixed, (value, _), size in zip(fixed, numbers, memory.sizes, strict=True)
    ):
        raise ValueError(f"the controller {type(controller).__name__} has other parts than those that are remembered")
    for (value, put), part, changes in zip(numbers, _split(memory), changing, strict=True):
        if changes and not np.array_equal(np.ravel(value), part, equal_nan=True):
            put(_like(value, part))


def _like(value: Any, numbers: NDArray[np.float64]) -> Any:
    """Numbers in the form of a value."""
    if isinstance(value, np.ndarray):
        return numbers.reshape(value.shape).astype(value.dtype)
    if isinstance(value, _LISTS):
        width = len(value[0]) if len(value) and isinstance(value[0], tuple) else 0
        entries = [tuple(row) for row in numbers.reshape(-1, width).tolist()] if width else numbers.tolist()
        return deque(entries, value.maxlen) if isinstance(value, deque) else entries
    number = float(numbers[0])
    return number if isinstance(value, float) or not math.isfinite(number) else type(value)(number)


def _numbers(thing: Any) -> Iterator[tuple[Any, Callable[[Any], None]]]:
    """Numbers, arrays and lists of numbers in a thing, each with a function that replaces it."""
    for value, put in _parts(thing):
        yield from _numbers_at(value, put)


def _numbers_at(value: Any, put: Callable[[Any], None]) -> Iterator[tuple[Any, Callable[[Any], None]]]:
    """Those of a value that something holds."""
    if isinstance(value, np.ndarray):
        if value.dtype.kind in "biuf":
            yield value, put
    elif isinstance(value, _NUMBER) or _is_series(value):
        yield value, put
    elif isinstance(value, tuple):
        entries = list(value)
        for k, entry in enumerate(value):
            yield from _numbers_at(entry, partial(_put_into_tuple, entries, type(value), put, k))
    elif not (isinstance(value, _CONSTANT) or callable(value) or getattr(value, "is_constant", False)):
        yield from _numbers(value)


def _is_series(value: Any) -> bool:
    """Whether it is a list of numbers, or of tuples of as many numbers each."""
    if not isinstance(value, _LISTS):
        return False
    if all(isinstance(entry, tuple) for entry in value):
        return len({len(entry) for entry in value}) < 2 and all(isinstance(v, _NUMBER) for e in value for v in e)
    return all(isinstance(entry, _NUMBER) for entry in value)


def _put_into_tuple(entries: list[Any], kind: type, put: Callable[[Any], None], k: int, entry: Any) -> None:
    """Replace a tuple by one with another entry, and with those that were replaced before."""
    entries[k] = entry
    put(kind(*entries) if hasattr(kind, "_fields") else kind(entries))


def _parts(thing: Any) -> Iterator[tuple[Any, Callable[[Any], None]]]:
    """Contents of an object, a dictionary or a list, each with a function that replaces it."""
    if isinstance(thing, dict):
        for key in thing:
            yield thing[key], partial(thing.__setitem__, key)
    elif isinstance(thing, _LISTS):
        for k in range(len(thing)):
            yield thing[k], partial(thing.__setitem__, k)
    else:
        slots = [name for kind in type(thing).__mro__ for name in getattr(kind, "__slots__", ())]
        for name in (*getattr(thing, "__dict__", {}), *slots):
            derived = isinstance(getattr(type(thing), name, None), cached_property)  # there once it was asked for
            if hasattr(thing, name) and not derived:
                yield getattr(thing, name), partial(object.__setattr__, thing, name)
