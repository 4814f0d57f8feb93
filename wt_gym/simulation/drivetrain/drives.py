"""The drives between demands and the structure: pitch, yaw and generator, each a law behind one contract.

A law takes a demand and moves a *command* towards it, once an aerodynamic step, as fast and as far as the drive can.
The command enters the inputs of the structure, where a servo or a torque follows it continuously. Laws are immutable;
all they remember is the command, an array that belongs to the state of the simulation, so that a snapshot holds it. A
custom law, or one that wraps another and fails in some way, needs the same two methods (see `Law`).
"""

import cmath
import math
import numbers
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from wt_gym.base.errors import ActionError, SimulationError
from wt_gym.base.quantities import Array
from wt_gym.multibody.arrays import Inputs
from wt_gym.simulation.drivetrain.drive_kernels import act
from wt_gym.turbines import Drivetrain, PitchSystem, Turbine

FULL_TORQUE_SPEED = 0.05
"""Speed, in rated speeds, below which the available torque falls to zero: a generator brakes, it never drives."""
START_MARGIN = 0.1
"""By how much the pitch at the start may lie outside the range of the drives [rad]."""
TORQUE, YAW, PITCH = slice(0, 1), slice(1, 2), slice(2, None)
"""Parts of the command."""
DAMPER_CORNER = 1.0 / 6.0
"""Below which a damper of the shaft takes the speed for the mean one, over the frequency of the shaft [-]."""
LONGEST_DAMPER_STEP = 2.0
"""Angle of the shaft's torsion within an aerodynamic step up to which a damper can follow it [rad]."""


def check_finite(**values: float) -> None:
    """Refuse what is not a finite number, with an `ActionError` that names the value."""
    for name, value in values.items():
        if not isinstance(value, (float, numbers.Real)) or not math.isfinite(value):
            raise ActionError(f"{name} is {value!r}; must be a finite number")


def available_torque(drivetrain: Drivetrain, speed: float) -> float:
    """Largest torque [N m, high-speed shaft] that a generator can brake with at a rotor speed [rad/s].

    Parameters
    ----------
    speed : float
        Low-speed shaft; below 5 % of the rated speed the torque falls to zero in proportion.
    """
    turning = speed / drivetrain.rated_rotor_speed / FULL_TORQUE_SPEED
    return drivetrain.max_generator_torque * min(max(turning, 0.0), 1.0)


def pitch_delay(drive: PitchSystem, interval: float, step: float | None = None) -> float:
    """Time from a demand for a moving pitch to the pitch itself [s].

    At t, a multiple of the interval T, a controller asks for d(t) = r t. The command gets there at t + T: evenly, over
    the steps of the simulator, as the environments move their demands, or at once if T is such a step. So the command
    is T late. The pitch is late behind the command in turn: an ideal drive by half a step Δt, for at the end of a step
    it stands midway between the commands of this step and the one before (`PitchDrives`); a servo of frequency ω and
    damping ratio ζ, ω²/(s² + 2 ζ ω s + ω²), by 2 ζ/ω. A pitch that turns with the rotor is thus led by Ω (T + Δt/2) or
    Ω (T + 2 ζ/ω).

    Parameters
    ----------
    interval : float
        T, of the controller [s].
    step : float, optional
        Δt, of the simulator [s]; by default the interval.
    """
    if drive.servo_frequency is None:
        return interval + 0.5 * (interval if step is None else step)
    return interval + 2.0 * drive.servo_damping / drive.servo_frequency


Demand = TypeVar("Demand", contravariant=True)


class Law(Protocol[Demand]):
    """What turns demands into commands: numbers of the generator and the yaw drive, angles of the pitch drives."""

    def first(self, value: Demand, speed: float) -> Array:
        """Command at the start, for a rotor speed [rad/s]; an `ActionError` for a value without meaning."""
        ...

    def follow(self, command: Array, demand: Demand, dt: float, speed: float) -> None:
        """Move the command, in place, through a step of dt [s] at a generator speed [rad/s, low-speed shaft]."""
        ...


@dataclass(frozen=True)
class PitchDrives:
    """Drives of all blades: the command moves to the demand at no more than the greatest rate, within the range.

    The pitch bearing follows the command: with the servo of the turbine, or ideally. The rate of an ideal drive changes
    smoothly within an aerodynamic step of length Δt, from that of the command in the step before to that in this one
    (`wt_gym.multibody.tree.rate_kernels.prescribe_servos`), and is never greater than the command's. The drive thus
    lags Δt/2 behind a moving command and stops on it. At the end of a step it is the mean of two commands: a filter
    with the gain cos(ω Δt/2), and a command that goes to and fro at every step moves nothing. What a real drive does
    with such a demand is a matter of its servo (`PitchSystem.servo_frequency`, `servo_damping`).
    """

    limits: PitchSystem
    n_blades: int

    def vector(self, pitch: ArrayLike) -> Array:
        """One angle or one a blade [rad] as an array (n_blades,); an `ActionError` for anything else, and degrees."""
        n = self.n_blades
        try:
            vector = np.asarray(pitch, dtype=float)
        except (TypeError, ValueError):
            raise ActionError(f"pitch is {pitch!r}; must be one angle or {n} angles [rad]") from None
        if vector.shape not in ((), (n,)):
            raise ActionError(f"pitch has shape {vector.shape}; must be one angle or {n} angles [rad]")
        angles = vector.ravel().tolist()  # numbers one by one: numpy's functions are slow on arrays of three
        if not all(map(math.isfinite, angles)):
            raise ActionError(f"pitch {pitch!r} is not finite")
        if max(angles) > math.pi or min(angles) < -math.pi:
            raise ActionError(f"pitch {pitch!r} is beyond ±π rad; are these degrees?")
        return np.array(angles if len(angles) == n else angles * n)

    def first(self, value: ArrayLike, speed: float) -> Array:
        """Command (n_blades,) at the start [rad]."""
        pitch, low, high = self.vector(value), self.limits.min_pitch, self.limits.max_pitch
        if pitch.min() < low - START_MARGIN or pitch.max() > high + START_MARGIN:
            raise ActionError(f"pitch {pitch} rad at the start; must be {low:.3f} … {high:.3f} rad (± {START_MARGIN})")
        return pitch

    def follow(self, command: Array, demand: ArrayLike, dt: float, speed: float) -> None:
        """Move the commands (n_blades,) towards the demanded angles (n_blades,) [rad]."""
        low, high, reach = self.limits.min_pitch, self.limits.max_pitch, self.limits.max_rate * dt
        moved = zip(command.tolist(), np.asarray(demand).tolist(), strict=True)
        command[:] = [now + min(max(min(max(angle, low), high) - now, -reach), reach) for now, angle in moved]


@dataclass(frozen=True)
class YawDrive:
    """Turns the nacelle at the demanded rate, up to its greatest, and holds it otherwise."""

    max_rate: float
    """[rad/s]; zero without a drive."""

    def first(self, value: float, speed: float) -> Array:
        """Command (1,) at the start: an angle [rad]."""
        check_finite(yaw=value)
        return np.array([value])

    def follow(self, command: Array, demand: float, dt: float, speed: float) -> None:
        """Move the command (1,) with the demanded rate [rad/s]."""
        command[0] += dt * min(max(demand, -self.max_rate), self.max_rate)


class PitchLaw(Law["ArrayLike"], Protocol):
    """What moves the blades; demands are angles [rad], one or one a blade."""

    @property
    def n_blades(self) -> int:
        """Number of blades."""

    def vector(self, pitch: ArrayLike) -> Array:
        """One angle or one a blade [rad] as an array (n_blades,); an `ActionError` for anything else."""
        ...


class GeneratorLaw(Law[float], Protocol):
    """What loads the rotor.

    The torque of a law whose attribute ``held`` is true jumps to its command at the start of a step; otherwise, and in
    a law without it, it goes there evenly within the step.
    """

    @property
    def damping(self) -> float:
        """Of a damper that the structure holds between nacelle and rotor [N m s/rad, low-speed shaft].

        It acts at every stage of the integration; held over an aerodynamic step, a strong one would drive a light hub
        unstable.
        """

    def balance(self, moment: float, speed: float) -> float:
        """The torque [N m, high-speed shaft] that comes closest to holding a moment of the air [N m, low-speed]."""
        ...

    def moment(self, command: Array) -> float:
        """Moment [N m, low-speed shaft] with which the command brakes the rotor, beside the damper."""
        ...

    def torque(self, command: Array, speed: float) -> float:
        """Torque of the generator [N m, high-speed shaft], damper included."""
        ...


def holds_torque(law: GeneratorLaw) -> bool:
    """Whether the torque of a law is held over a step; users' laws need not say so."""
    return bool(getattr(law, "held", False))


@dataclass(frozen=True)
class TorqueCommand:
    """A generator with the torque that is asked for, limited in rate and size."""

    drivetrain: Drivetrain
    damping = 0.0
    held = False

    def first(self, value: float, speed: float) -> Array:
        """Command (1,) at the start [N m, high-speed shaft]."""
        check_finite(generator_torque=value)
        limit = available_torque(self.drivetrain, speed)
        if not 0.0 <= value <= limit:
            raise ActionError(
                f"generator_torque is {value} N m; allowed at a rotor speed of {speed:.4g} rad/s: 0 … {limit:.6g} N m"
            )
        return np.array([value])

    def balance(self, moment: float, speed: float) -> float:
        """The torque that balances the moment, as far as there is one; what the gearbox loses balances its part."""
        torque = moment * self.drivetrain.gearbox_efficiency / self.drivetrain.gear_ratio
        return min(max(torque, 0.0), available_torque(self.drivetrain, speed))

    def follow(self, command: Array, demand: float, dt: float, speed: float) -> None:
        """Move the command (1,) towards the demanded torque [N m], from 0 to what is available at this speed."""
        now, reach = command.item(0), self.drivetrain.max_torque_rate * dt
        command[0] = min(max(demand, now - reach, 0.0), now + reach, available_torque(self.drivetrain, speed))

    def moment(self, command: Array) -> float:
        """Moment on the rotor [N m]; what the gearbox loses brakes it too."""
        return command.item(0) * self.drivetrain.gear_ratio / self.drivetrain.gearbox_efficiency

    def torque(self, command: Array, speed: float) -> float:
        """Torque of the generator [N m, high-speed shaft]."""
        return command.item(0)


@dataclass(frozen=True)
class LaggedTorque(TorqueCommand):
    """A generator whose torque follows its demand with a lag of first order, within the same limits.

    A demand that is held over a step Δt leaves exp(-Δt/τ) of its distance from the torque
    (`wt_gym.turbines.variants`).
    """

    def follow(self, command: Array, demand: float, dt: float, speed: float) -> None:
        """Move the command (1,) towards the demanded torque [N m], from 0 to what is available at this speed."""
        now, drivetrain = command.item(0), self.drivetrain
        target = min(max(demand, 0.0), available_torque(drivetrain, speed))
        super().follow(command, now - math.expm1(-dt / drivetrain.torque_lag) * (target - now), dt, speed)


def check_damper_step(drivetrain: Drivetrain, time_step: float) -> None:
    """Refuse a damper of the shaft whose torsion is too fast for a step of the simulator [s]: a `SimulationError`."""
    damper = drivetrain.shaft_damper
    if damper is not None and (angle := damper.frequency * time_step) > LONGEST_DAMPER_STEP:
        raise SimulationError(
            f"a shaft_damper must have an aerodynamic step of at most {LONGEST_DAMPER_STEP / damper.frequency:.3g} s "
            f"at {damper.frequency / (2.0 * math.pi):.3g} Hz of the shaft, got {time_step:g} s ({angle:.3g} rad)"
        )


@lru_cache(maxsize=32)
def damper_weights(angle: float) -> tuple[float, float, float]:
    """Weights with which a damper that holds its torque over a step damps as a continuous one.

    The high-passed speed h has the transfer H = 1 - κ/(z - 1 + κ) from the samples of the speed. A torque that is held
    over a step is late by half of it and weaker by sin(θ/2)/(θ/2), θ the angle of the torsion in a step. a h[k] +
    b h[k-1] makes up for both, and for H, at the frequency of the torsion:

        H(e^{iθ}) (a + b e^{-iθ}) = e^{iθ/2} (θ/2)/sin(θ/2).

    Parameters
    ----------
    angle : float
        θ [rad].

    Returns
    -------
    a, b, kappa : float
    """
    z, kappa = cmath.exp(1j * angle), -math.expm1(-DAMPER_CORNER * angle)
    passed = 1.0 - kappa / (z - 1.0 + kappa)
    added = cmath.exp(0.5j * angle) * (0.5 * angle / math.sin(0.5 * angle)) / passed
    before = -added.imag / math.sin(angle)
    return added.real - before * math.cos(angle), before, kappa


@dataclass(frozen=True)
class DampingTorque(TorqueCommand):
    """A generator that damps the torsion of the shaft, on top of a law for the torque that is asked for.

    The converter adds c (Ω - mean) to the torque, c and the frequency of the torsion as in
    `wt_gym.turbines.model`, in samples of an aerodynamic step (`damper_weights`). The sum is within what the
    generator can brake with; the greatest rate of the torque is that of demands and does not bind the converter. A
    generator without a demand is off and damps nothing.

    Its command is the torque that acts, the torque that is asked for, the sum of it and of the damping as it was set
    [N m, high-speed shaft], the low-passed speed and the high-passed one a step ago [rad/s, low-speed shaft]. Where the
    torque that acts is less than was set, a fault has cut it, and the demand begins again from there. The drivetrain
    must have a ``shaft_damper``.
    """

    law: TorqueCommand
    held = True

    def first(self, value: float, speed: float) -> Array:
        """Command (5,) at the start, for a torque [N m] and a rotor speed [rad/s]."""
        torque = self.law.first(value, speed).item()
        return np.array([torque, torque, torque, speed, 0.0])

    def follow(self, command: Array, demand: float, dt: float, speed: float) -> None:
        """Move the command (5,) towards the demanded torque [N m] and against the torsion."""
        drivetrain, damper = self.drivetrain, self.drivetrain.shaft_damper
        assert damper is not None
        acts, asked, was_set, mean, passed_before = command.tolist()
        moved = np.array([min(asked, acts) if acts < was_set else asked])
        self.law.follow(moved, demand, dt, speed)
        now, before, kappa = damper_weights(damper.frequency * dt)
        passed = speed - mean
        moment = damper.coefficient * (now * passed + before * passed_before)
        asked = moved.item()
        damping = moment * drivetrain.gearbox_efficiency / drivetrain.gear_ratio if asked > 0.0 else 0.0
        acts = min(max(asked + damping, 0.0), available_torque(drivetrain, speed))
        command[:] = acts, asked, acts, mean + kappa * passed, passed


@dataclass(frozen=True)
class LinearDamper:
    """A generator whose torque is proportional to its speed, M = c Ω (Gebhardt et al. 2012); it takes no demand."""

    damping: float
    """c, on the low-speed shaft [N m s/rad]."""
    drivetrain: Drivetrain
    held = False

    def __post_init__(self) -> None:
        if not 0.0 <= self.damping < math.inf:
            raise ActionError(f"generator damping is {self.damping} N m s/rad; must be a finite value from 0 on")

    def first(self, value: float, speed: float) -> Array:
        """Nothing is commanded."""
        self._refuse(value)
        return np.zeros(1)

    def balance(self, moment: float, speed: float) -> float:
        """Nothing can be chosen."""
        return 0.0

    def follow(self, command: Array, demand: float, dt: float, speed: float) -> None:
        """The damper acts in the structure."""
        self._refuse(demand)

    def moment(self, command: Array) -> float:
        """The damper acts in the structure."""
        return 0.0

    def torque(self, command: Array, speed: float) -> float:
        """Torque of the generator [N m, high-speed shaft]."""
        return self.damping * speed * self.drivetrain.gearbox_efficiency / self.drivetrain.gear_ratio

    @staticmethod
    def _refuse(demand: float) -> None:
        if demand != 0.0:
            raise ActionError(f"generator_torque is {demand} N m; a generator that is a linear damper takes no demand")


def _own_law(drivetrain: Drivetrain) -> GeneratorLaw:
    """Law of a generator as its drivetrain describes it."""
    if not drivetrain.takes_torque:
        return LinearDamper(drivetrain.generator_damping, drivetrain)
    law = LaggedTorque(drivetrain) if drivetrain.torque_lag > 0.0 else TorqueCommand(drivetrain)
    return law if drivetrain.shaft_damper is None else DampingTorque(drivetrain, law)


class Fault(Protocol):
    """What happens to drives, see `wt_gym.simulation.drivetrain.faults`."""

    def fail(self, drives: "Drives", clock: Callable[[], float]) -> None:
        """Put laws that fail in the place of those that the drives have."""
        ...


class Drives:
    """All drives of a turbine and their commands.

    Parameters
    ----------
    generator : GeneratorLaw, optional
        By default a `TorqueCommand`, or a `LinearDamper` where the drivetrain takes no demand.

    Attributes
    ----------
    pitch, yaw, generator : Law
        As they act now, see `fail`.
    sound_generator : GeneratorLaw
        Without faults.
    command : array (2 + n_blades,)
        Generator torque [N m], yaw and pitch of each blade [rad]; part of the state of the simulation.
    generator_command : array (n,)
        All that the law of the generator remembers, the torque first; that part of ``command`` if there is no more,
        else part of the state beside it.
    """

    def __init__(self, turbine: Turbine, generator: GeneratorLaw | None = None) -> None:
        self.pitch: PitchLaw = PitchDrives(turbine.pitch, turbine.n_blades)
        self.yaw: Law[float] = YawDrive(turbine.nacelle.max_yaw_rate)
        self.generator: GeneratorLaw = _own_law(turbine.drivetrain) if generator is None else generator
        self._sound_pitch, self.sound_generator = self.pitch, self.generator
        self.command, self.drivetrain = np.zeros(2 + turbine.n_blades), turbine.drivetrain
        remembered = self.generator.first(0.0, 0.0).size
        self.generator_command = self.command[TORQUE] if remembered == 1 else np.zeros(remembered)
        self._ideal_pitch = turbine.pitch.servo_frequency is None
        self._step, self._before = 0.0, np.zeros(turbine.n_blades)  # the last step, and the pitch command before it

    def fail(self, faults: Iterable[Fault], clock: Callable[[], float]) -> None:
        """Let the drives have these faults and no others.

        Parameters
        ----------
        faults : iterable of Fault
            Later ones act upon what earlier ones have left.
        clock : callable
            Gives the time at the start of the current step [s].

        Raises
        ------
        ActionError
            If the turbine does not have what fails; the drives are then sound.
        """
        self.pitch, self.generator = self._sound_pitch, self.sound_generator
        try:
            for fault in faults:
                fault.fail(self, clock)
        except ActionError:
            self.pitch, self.generator = self._sound_pitch, self.sound_generator
            raise

    def start(self, pitch: ArrayLike, yaw: float, speed: float, generator_torque: float | None = None) -> None:
        """Place pitch [rad], yaw [rad] and torque [N m] at a rotor speed [rad/s]; without a torque see `load`.

        Raises
        ------
        ActionError
            For values that a drive refuses; the commands are then as they were.
        """
        first = self.yaw.first(yaw, speed), self.pitch.first(pitch, speed)
        torque = self.generator.first(0.0 if generator_torque is None else generator_torque, speed)
        self._generate(torque)
        self.command[YAW], self.command[PITCH] = first
        self._step, self._before[:] = 0.0, self.command[PITCH]

    def load(self, moment: float, speed: float, generator_torque: float | None = None) -> None:
        """Load a rotor on which the air acts with a moment [N m], with a torque or with what balances the moment."""
        chosen = self.generator.balance(moment, speed) if generator_torque is None else generator_torque
        self._generate(self.generator.first(chosen, speed))

    def _generate(self, command: Array) -> None:
        self.generator_command[:] = command
        self.command[TORQUE] = command[0]

    def follow(self, pitch: ArrayLike, yaw_rate: float, generator_torque: float, dt: float, speed: float) -> None:
        """Move all commands towards the demands through one step of dt [s]."""
        pitch_command = self.command[PITCH]
        self.generator.follow(self.generator_command, generator_torque, dt, speed)
        self.command[TORQUE] = self.generator_command[0]
        self.yaw.follow(self.command[YAW], yaw_rate, dt, speed)
        self._before[:] = pitch_command
        self.pitch.follow(pitch_command, pitch, dt, speed)
        self._step = dt

    def act(self, inputs: Inputs, azimuth_u: int, first: int = 1) -> None:
        """Write all commands into the inputs of the structure.

        Parameters
        ----------
        inputs : Inputs
            Of the multibody system; the yaw drive is its first servo, the pitch drives follow.
        azimuth_u : int
            The velocity of the generator.
        first : int
            1: at the end of a step; 0: at both ends.
        """
        act(
            self.command, self._before, self._step, float(self.generator.moment(self.generator_command)),
            self._ideal_pitch, azimuth_u, first, inputs.dof_force, inputs.servo_command, inputs.servo_rate,
            inputs.servo_interval,
        )  # fmt: skip
        if holds_torque(self.generator):
            inputs.dof_force[0, azimuth_u] = inputs.dof_force[1, azimuth_u]

    def torque(self, speed: float) -> float:
        """Torque of the generator [N m, high-speed shaft] at a speed of the rotor [rad/s]."""
        return self.generator.torque(self.generator_command, speed)
