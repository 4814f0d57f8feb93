"""Faults of drives and sensors: what breaks, and when.

A drive that fails is a law that wraps the sound one (`wt_gym.simulation.drivetrain.drives`): it acts once an
aerodynamic step, at the simulator's own step, for any source of demands. All that a law remembers is its command; what
the time is it asks a clock. A sensor that fails changes what controllers and agents read, and nothing else.

Times count from the reset. A fault acts in the first step that begins at its time or later.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cache, partial
from itertools import pairwise
from typing import Any, ClassVar, cast

import numpy as np
from numpy.typing import ArrayLike

from wt_gym.base.errors import ActionError, did_you_mean
from wt_gym.base.quantities import Array, wrapped
from wt_gym.simulation.channels import Signals, channel_table
from wt_gym.simulation.drivetrain.drives import Drives, GeneratorLaw, PitchLaw
from wt_gym.turbines import Drivetrain

FEATHER = 0.5 * math.pi
"""Pitch of a feathered blade [rad], where the range of the drive reaches that far."""
SLIP_RATE = math.radians(4.0)
"""At which a blade slips on its bearing [rad/s]."""
_ROUNDING = 1e-6
"""Part of a step by which a time may be missed: steps are counted, times are products."""


@dataclass(frozen=True)
class _InPlace:
    """A law in the place of a sound one: it moves as its fault lets it, and is the sound one in all else."""

    law: Any
    fault: "DriveFault"
    move: Callable[[Any, float, Array, Any, float, float], None]
    clock: Callable[[], float] = field(repr=False)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name == "law":  # asked for while a copy is being made
            raise AttributeError(name)
        return getattr(self.law, name)

    def follow(self, command: Array, demand: Any, dt: float, speed: float) -> None:
        """Move the command as far as the fault lets it."""
        now = self.clock()
        if self.fault.begun(now, dt):
            self.move(self.law, now, command, demand, dt, speed)
        else:
            self.law.follow(command, demand, dt, speed)


@dataclass(frozen=True)
class DriveFault:
    """Something that happens to the drives; an `ActionError` for values without meaning."""

    time: float
    """When it begins [s]."""
    _numbers: ClassVar[tuple[tuple[Any, ...], ...]] = ()
    """Name, meaning, unit, bound of a field and whether it is open, see `_require`."""

    def __post_init__(self) -> None:
        _require("time of a fault", self.time, "s", 0.0)
        for name, meaning, *limits in self._numbers:
            _require(meaning, getattr(self, name), *limits)

    def fail(self, drives: Drives, clock: Callable[[], float]) -> None:
        """Put laws that fail in the place of those that the drives have; the clock gives the time of the step [s]."""
        raise NotImplementedError

    def begun(self, now: float, dt: float) -> bool:
        """Whether a step of dt [s] that begins now [s] feels it."""
        return now > self.time - _ROUNDING * dt


@dataclass(frozen=True)
class _BladeFault(DriveFault):
    """Something that happens to the pitch of one blade."""

    blade: int = 1
    """From 1 on."""
    _what: ClassVar[str]

    def fail(self, drives: Drives, clock: Callable[[], float]) -> None:
        """See `DriveFault.fail`."""
        n = drives.pitch.n_blades
        if not (isinstance(cast(object, self.blade), int) and 1 <= self.blade <= n):
            raise ActionError(f"blade {self.blade!r} cannot {self._what}; the turbine has the blades 1 to {n}")
        drives.pitch = cast(Any, _InPlace(drives.pitch, self, self.move_pitch, clock))

    def move_pitch(self, law: PitchLaw, now: float, command: Array, demand: ArrayLike, dt: float, speed: float) -> None:
        """Move the commands under the fault, in a step from now [s] on that feels it."""
        raise NotImplementedError


@dataclass(frozen=True)
class StuckPitch(_BladeFault):
    """From a time on one blade stays at the pitch it has been commanded to: its rate is zero."""

    _what = "be stuck"

    def move_pitch(self, law: PitchLaw, now: float, command: Array, demand: ArrayLike, dt: float, speed: float) -> None:
        """Let all blades but one follow."""
        stays = command[self.blade - 1]
        law.follow(command, demand, dt, speed)
        command[self.blade - 1] = stays


@dataclass(frozen=True)
class SlowPitch(_BladeFault):
    """From a time on the drive of one blade turns no faster than at a rate of its own."""

    rate: float = math.radians(1.0)
    """[rad/s]."""
    _what = "be slow"
    _numbers = (("rate", "rate of a slow pitch drive", "rad/s", 0.0),)

    def move_pitch(self, law: PitchLaw, now: float, command: Array, demand: ArrayLike, dt: float, speed: float) -> None:
        """Let all blades but one follow as fast as they can."""
        before, reach = command[self.blade - 1], self.rate * dt
        law.follow(command, demand, dt, speed)
        command[self.blade - 1] = min(max(command[self.blade - 1], before - reach), before + reach)


@dataclass(frozen=True)
class PitchMisalignment(_BladeFault):
    """From a time on one blade stands by an angle away from where its drive has put it: it has slipped on its bearing.

    It slips at `SLIP_RATE`. The encoder is on the drive and does not see it (`read`), and the range of the drive is
    shifted with the blade. An offset that is there from the start of an episode is the error of a blade that was
    mounted wrongly.
    """

    offset: float = math.radians(2.0)
    """Positive to feather [rad]."""
    _what = "slip"
    _numbers = (("offset", "offset of a blade", "rad"),)

    def begun(self, now: float, dt: float) -> bool:
        """Every step: it begins within one."""
        return True

    def move_pitch(self, law: PitchLaw, now: float, command: Array, demand: ArrayLike, dt: float, speed: float) -> None:
        """Move the drives, and the blade with what it has slipped."""
        command[self.blade - 1] -= self.slipped(now)
        law.follow(command, demand, dt, speed)
        command[self.blade - 1] += self.slipped(now + dt)

    def slipped(self, time: float) -> float:
        """Angle of the blade against its drive at a time [rad]."""
        return math.copysign(min(SLIP_RATE * max(time - self.time, 0.0), abs(self.offset)), self.offset)

    def read(self, signals: Signals) -> Signals:
        """Give the signals as the encoder of the blade does; the given ones stay as they are."""
        slipped = self.slipped(signals["time"])
        if slipped == 0.0:
            return signals
        read = Signals(signals.values.copy(), signals.n_blades)
        for name in (f"pitch_{self.blade}", f"pitch_command_{self.blade}"):
            read.set(name, signals[name] - slipped)
        return read


@dataclass(frozen=True)
class ShutDown(DriveFault):
    """From a time on all blades go to feather at a rate of their own and no torque is demanded, whatever is asked for.

    The torque falls at the greatest rate of the generator. Pitch rates beyond those of the drive are the drive's.
    """

    rate: float = math.radians(8.0)
    """Of the pitch [rad/s]."""
    _numbers = (("rate", "pitch rate of a shut-down", "rad/s", 0.0, True),)

    def fail(self, drives: Drives, clock: Callable[[], float]) -> None:
        """See `DriveFault.fail`."""
        drives.pitch = cast(Any, _InPlace(drives.pitch, self, self.move_pitch, clock))
        drives.generator = cast(Any, _InPlace(drives.generator, self, self.move_torque, clock))

    def move_pitch(self, law: PitchLaw, now: float, command: Array, demand: ArrayLike, dt: float, speed: float) -> None:
        """Let the blades follow a demand for feather."""
        reach = self.rate * dt
        law.follow(command, [now + min(max(FEATHER - now, -reach), reach) for now in command.tolist()], dt, speed)

    def move_torque(
        self, law: GeneratorLaw, now: float, command: Array, demand: float, dt: float, speed: float
    ) -> None:
        """Let the torque go."""
        law.follow(command, 0.0, dt, speed)


@dataclass(frozen=True)
class GeneratorLoss(DriveFault):
    """From a time on the generator brakes no more: the grid is lost, and with it the torque, within one step."""

    def fail(self, drives: Drives, clock: Callable[[], float]) -> None:
        """See `DriveFault.fail`."""
        if drives.generator.damping:
            raise ActionError("the torque of a damper that is part of the rotor cannot be lost")
        drives.generator = cast(Any, _InPlace(drives.generator, self, self.move_torque, clock))

    def move_torque(
        self, law: GeneratorLaw, now: float, command: Array, demand: float, dt: float, speed: float
    ) -> None:
        """No torque."""
        command[0] = 0.0


@dataclass(frozen=True)
class VoltageDip(DriveFault):
    """The voltage of the grid falls to a share, and comes back in a ramp; the turbine stays connected.

    At the greatest current of the converter the electrical power is at most the remaining share of the rated power, and
    with it the torque, P_rated v / (eta omega), within the step; the rotor takes up the difference, J dOmega/dt =
    M_aero - N T, and its speed rises. A slow recovery ramps the active power up, which reduces the shock to the shaft.
    A step of the simulator that is longer than the dip feels its mean, so that the impulse is that of the dip.

    The torque that is asked for returns no faster than at the greatest rate of the generator. What a converter adds
    against the torsion of the shaft (`wt_gym.simulation.drivetrain.drives.DampingTorque`) is cut with it.
    """

    remaining: float = 0.0
    """Voltage over nominal during the dip [-]."""
    duration: float = 0.15
    """[s]; 150 ms are those of the usual grid codes for a dip to zero."""
    recovery: float = 1.0
    """Rate at which the power that is allowed comes back, over rated [1/s]."""
    _numbers = (
        ("remaining", "remaining voltage of a dip", "", 0.0),
        ("duration", "duration of a voltage dip", "s", 0.0, True),
        ("recovery", "recovery after a voltage dip", "1/s", 0.0, True),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.remaining > 1.0:
            raise ActionError(f"the remaining voltage of a dip must be at most 1, got {self.remaining!r}")

    def fail(self, drives: Drives, clock: Callable[[], float]) -> None:
        """See `DriveFault.fail`."""
        if drives.generator.damping:
            raise ActionError("a damper that is part of the rotor has no grid whose voltage could dip")
        cut = partial(self.move_torque, drives.drivetrain)
        drives.generator = cast(Any, _InPlace(drives.generator, self, cut, clock))

    def begun(self, now: float, dt: float) -> bool:
        """Every step: it begins within one, and ends."""
        return True

    def move_torque(
        self, drivetrain: Drivetrain, law: GeneratorLaw, now: float, command: Array, demand: float, dt: float,
        speed: float,
    ) -> None:  # fmt: skip
        """Move the command, and cut it to what the grid takes."""
        law.follow(command, demand, dt, speed)
        if now + dt <= self.time or now >= self.recovered or speed <= 0.0:
            return
        full = drivetrain.rated_power / (drivetrain.generator_efficiency * speed * drivetrain.gear_ratio)
        command[0] = full * self.mean_limited(command.item(0) / full, now, dt)

    @property
    def recovered(self) -> float:
        """When the grid takes the rated power again [s]."""
        return self.time + self.duration + (1.0 - self.remaining) / self.recovery

    def voltage(self, time: float) -> float:
        """Share of the rated power that the grid takes at a time [-]."""
        since = time - self.time - self.duration
        if since < -self.duration:
            return 1.0
        return min(self.remaining + self.recovery * max(since, 0.0), 1.0)

    def mean_limited(self, share: float, start: float, dt: float) -> float:
        """Mean of a power [rated] over a step of dt [s] from a start [s], where it is no more than the grid takes."""
        over, back = self.time + self.duration, self.recovered
        crossed = over + (share - self.remaining) / self.recovery
        inside = (time for time in (self.time, over, crossed, back) if start < time < start + dt)
        ends = [start, *sorted(inside), start + dt]
        total = 0.0
        for first, last in pairwise(ends):  # linear between them
            middle = 0.5 * (first + last)
            limit = self.voltage(middle) if self.time <= middle < back else math.inf
            total += (last - first) * min(share, limit)
        return total / dt


@cache
def _places(names: tuple[str, ...], n_blades: int, n_lines: int | None) -> tuple[int, ...]:
    """See `SensorBias.places`: sensors are read in every step of the simulator."""
    index = {channel.name: k for k, channel in enumerate(channel_table(n_blades, n_lines))}
    unknown = [name for name in names if name not in index or name == "time"]
    if unknown:
        known = list(index)[1:]
        raise ActionError(
            f"channels of a sensor fault must be among {', '.join(known)}; got {unknown}"
            f"{did_you_mean(unknown[0], known)}"
        )
    return tuple(index[name] for name in names)


@dataclass(frozen=True)
class SensorBias:
    """From a time on sensors read ``factor`` times the truth plus ``offset``: what is read, not what is.

    Base controllers and observations see it; rewards, ends of episodes and recorded signals do
    not. A yaw error or azimuth that leaves the range of its channel comes in again at the other end. An `ActionError`
    for values without meaning.
    """

    time: float
    """When it begins [s]."""
    channels: tuple[str, ...]
    """Of `wt_gym.simulation.channels.channel_table`; what one sensor gives in several units belongs together, for
    example ``("rotor_speed", "generator_speed")``."""
    factor: float = 1.0
    offset: float = 0.0
    """In the unit of the channels."""

    def __post_init__(self) -> None:
        _require("time of a fault", self.time, "s", 0.0)
        _require("factor of a sensor", self.factor, "")
        _require("offset of a sensor", self.offset, "in the unit of the channel")
        if isinstance(cast(object, self.channels), str) or not self.channels:
            raise ActionError(f"channels of a sensor must be a tuple of names, got {self.channels!r}")

    def places(self, n_blades: int, n_lines: int | None = None) -> list[int]:
        """Where the channels stand in the signals of a turbine; an `ActionError` if there is no such channel."""
        return list(_places(tuple(self.channels), n_blades, n_lines))

    def read(self, signals: Signals) -> Signals:
        """Give the signals as the sensors do; the given ones stay as they are."""
        if signals["time"] < self.time - _ROUNDING:
            return signals
        values, places = signals.values.copy(), self.places(signals.n_blades, signals.n_lines)
        values[places] = self.factor * values[places] + self.offset
        for name, place in zip(self.channels, places, strict=True):
            if name == "yaw_error":
                values[place] = wrapped(values[place])
            elif name == "azimuth":
                values[place] %= 2.0 * math.pi
        return Signals(values, signals.n_blades)


def checked_faults(
    faults: DriveFault | SensorBias | Iterable[DriveFault | SensorBias], n_blades: int
) -> tuple[DriveFault | SensorBias, ...]:
    """Faults of one turbine, as a tuple.

    Raises
    ------
    ActionError
        If one is none, or names what the turbine does not have.
    """
    given = tuple(faults) if isinstance(faults, Iterable) else (faults,)
    for fault in given:
        if isinstance(fault, SensorBias):
            fault.places(n_blades)
        elif not isinstance(fault, DriveFault):
            raise ActionError(
                "a fault is a StuckPitch, SlowPitch, PitchMisalignment, ShutDown, GeneratorLoss, VoltageDip or "
                f"SensorBias, got {fault!r}"
            )
    return given


def _require(name: str, value: float, unit: str, low: float = -math.inf, open_low: bool = False) -> None:
    """Refuse what is not a finite number from a bound on."""
    number = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    if not (number and math.isfinite(value) and (value > low if open_low else value >= low)):
        bound = "" if low == -math.inf else f" {'above' if open_low else 'of at least'} {low:g}"
        raise ActionError(f"the {name} must be a finite number{bound} {unit}".rstrip() + f", got {value!r}")
