"""Measurements of a controller: channels, instruments, filters and multi-blade coordinates.

Multi-blade (Coleman) coordinates describe in the frame that does not turn what the blades do together. With the azimuth
psi_b of blade b in the sense of rotation, zero when it points up,

    mean = sum(x_b) / n,   tilt = 2 / n sum(x_b cos psi_b),   yaw = 2 / n sum(x_b sin psi_b),

    x_b = mean + tilt cos psi_b + yaw sin psi_b,

each the inverse of the other for three blades (Coleman & Feingold, NACA TR 1351, 1958; Bossanyi, Wind Energ. 6 (2003)
119). A mean downwind force pushes all blades, tilt is more of it above than below, yaw more of it on the side of
positive psi: the right, looking downwind, of a clockwise rotor, the left of a counter-clockwise one.

Filters are exact for an input held over each step, whatever its length.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm

from wt_gym.base.quantities import wrapped
from wt_gym.wind import Inflow
from wt_gym.wind.inflow import velocity_ahead

FIXED_FRAME = ("mean", "tilt", "yaw")


def _directions(azimuth: float, n_blades: int) -> NDArray[np.float64]:
    """One, cosine and sine of the azimuth of every blade, shape (3, n_blades), blade 1 at ``azimuth`` [rad]."""
    psi = [azimuth + 2.0 * math.pi / n_blades * b for b in range(n_blades)]
    return np.array([[1.0] * n_blades, [math.cos(p) for p in psi], [math.sin(p) for p in psi]])


def to_fixed_frame(values: ArrayLike, azimuth: float) -> NDArray[np.float64]:
    """Mean, tilt and yaw (..., 3) of a value of every blade (..., n_blades), blade 1 at ``azimuth`` [rad]."""
    values = np.asarray(values, dtype=np.float64)
    n_blades = values.shape[-1]
    out: NDArray[np.float64] = (values[..., None, :] * _directions(azimuth, n_blades)).sum(axis=-1) * (
        np.array([1.0, 2.0, 2.0]) / n_blades
    )
    return out


def to_blades(coordinates: Sequence[float] | NDArray[np.float64], azimuth: float, n_blades: int) -> list[float]:
    """Value of every blade from mean, tilt and yaw, blade 1 at ``azimuth`` [rad]."""
    mean, tilt, yaw = coordinates
    return [mean + change for change in harmonic_of_blades(tilt, yaw, azimuth, n_blades)]


def to_harmonic(
    values: Sequence[float] | NDArray[np.float64], azimuth: float, harmonic: int = 1
) -> tuple[float, float]:
    """Cosine (tilt) and sine (yaw) component of a quantity of the blades (n_blades,).

    ``2/B sum x_b cos(n psi_b)`` and ``2/B sum x_b sin(n psi_b)`` with ``psi_b = azimuth + 2 pi b / B``, b = 0 … B - 1;
    the azimuth is that of blade 1, zero when it points up [rad]; n = 1 for loads once per revolution, 2 for twice.
    """
    # numbers one by one: arrays of three are slow
    n_blades, cosine, sine = len(values), 0.0, 0.0
    for b, value in enumerate(values):
        angle = harmonic * (azimuth + 2.0 * math.pi * b / n_blades)
        cosine += value * math.cos(angle)
        sine += value * math.sin(angle)
    return 2.0 / n_blades * cosine, 2.0 / n_blades * sine


def from_harmonic(tilt: float, yaw: float, azimuth: float, n_blades: int = 3, harmonic: int = 1) -> NDArray[np.float64]:
    """Values of the blades ``tilt cos(n psi_b) + yaw sin(n psi_b)``, shape (n_blades,); see `to_harmonic`."""
    return np.array(harmonic_of_blades(tilt, yaw, azimuth, n_blades, harmonic))


def harmonic_of_blades(tilt: float, yaw: float, azimuth: float, n_blades: int, harmonic: int = 1) -> list[float]:
    """The same as a list, for callers that use numbers one by one."""
    angles = [harmonic * (azimuth + 2.0 * math.pi * b / n_blades) for b in range(n_blades)]
    return [tilt * math.cos(angle) + yaw * math.sin(angle) for angle in angles]


def within(vector: Sequence[float], size: float) -> Sequence[float]:
    """Vector shortened to a size."""
    length = math.hypot(*vector)
    return vector if length <= size else [x * size / length for x in vector]


@dataclass(frozen=True)
class Channel:
    """One measured quantity."""

    name: str
    unit: str
    offset: float
    scale: float  #: the normalized value is ``(value - offset) / scale``
    low: float
    high: float  #: range of the sensor in physical units: what lies outside reads as the end of the range
    noise: float  #: standard deviation of white measurement noise at noise level 1, in physical units
    description: str
    parity: int = 1
    """+1 or -1: sign with which the quantity goes into that of the mirror image, see
    `wt_gym.simulation.channels.Channel`."""

    def __post_init__(self) -> None:
        if self.parity not in (1, -1):
            raise ValueError(f"channel {self.name!r} needs a parity of 1 or -1, got {self.parity!r}")
        if not (self.scale > 0 and self.low < self.high and self.noise >= 0):
            raise ValueError(f"channel {self.name!r} needs scale > 0, low < high and noise >= 0, got {self}")


class LowPass:
    """First-order low-pass filter, exact for a signal held over a step: ``y = a y + (1 - a) u``, ``a = exp(-dt/tau)``.

    A time constant tau of zero [s] passes the signal through.
    """

    def __init__(self, time_constant: float):
        if not time_constant >= 0:
            raise ValueError(f"a filter's time constant must not be negative, got {time_constant!r} s")
        self.time_constant = time_constant
        self.value = math.nan

    def reset(self, value: float) -> float:
        """Start in steady state at a value."""
        self.value = float(value)
        return self.value

    def update(self, value: float, dt: float) -> float:
        """Take the value of a step of length ``dt`` [s] and return the filtered one."""
        memory = math.exp(-dt / self.time_constant) if self.time_constant > 0 else 0.0
        self.value = memory * self.value + (1.0 - memory) * float(value)
        return self.value


class AngleLowPass(LowPass):
    """First-order low-pass filter of a direction: its value moves along the shorter way around the circle.

    ``y = y + (1 - a) wrapped(u - y)``, the same as `LowPass` as long as the input stays within half a turn of the
    value. An input that flips from +180 to -180 degrees has hardly moved.
    """

    def reset(self, value: float) -> float:
        """Start in steady state at an angle [rad]."""
        return super().reset(wrapped(float(value)))

    def update(self, value: float, dt: float) -> float:
        """Take the angle of a step of length ``dt`` [s] and return the filtered one, within [-π, π) [rad]."""
        near = self.value + wrapped(float(value) - self.value)
        self.value = wrapped(super().update(near, dt))
        return self.value


class Notch:
    """Second-order notch ``(s^2 + w^2) / (s^2 + 2 zeta w s + w^2)``, by the bilinear transform that is exact at w.

    The frequency w does not pass [rad/s]; 0 passes everything. With the damping ratio zeta [-], less than 0.7 passes
    between ``(sqrt(1 + zeta^2) - zeta) w`` and ``(sqrt(1 + zeta^2) + zeta) w``.
    """

    def __init__(self, frequency: float, damping_ratio: float = 0.5):
        self.frequency, self.damping_ratio = frequency, damping_ratio
        self._inputs, self._outputs = (math.nan, math.nan), (math.nan, math.nan)

    def reset(self, value: float) -> float:
        """Start in steady state at a value."""
        value = float(value)
        self._inputs = self._outputs = (value, value)
        return value

    def update(self, value: float, dt: float) -> float:
        """Take the value of a step of length ``dt`` [s] and return the filtered one.

        What samples at this distance cannot show (``w dt >= pi``) is passed: it would alias. The filter then resumes
        from the value that passed.
        """
        value, angle = float(value), self.frequency * dt
        if not 0.0 < angle < math.pi:
            return self.reset(value)
        (last_in, earlier_in), (last_out, earlier_out) = self._inputs, self._outputs
        width, middle = self.damping_ratio * math.sin(angle), 2.0 * math.cos(angle)
        output = value + earlier_in - (1.0 - width) * earlier_out + middle * (last_out - last_in)
        output /= 1.0 + width
        self._inputs, self._outputs = (value, last_in), (output, last_out)
        return output


class NacelleAnemometer:
    """Cup anemometer and wind vane: horizontal wind speed and direction at the hub, low-pass filtered.

    The reading is that of a calibrated instrument: the undisturbed wind at the hub, without the rotor's induction. The
    time constants are those of the cup anemometer and of the vane with its averaging [s].
    """

    def __init__(self, speed_time_constant: float = 1.0, direction_time_constant: float = 5.0):
        self._speed = LowPass(speed_time_constant)
        self._direction = AngleLowPass(direction_time_constant)

    def reset(self, wind_x: float, wind_y: float, yaw_error: float) -> tuple[float, float]:
        """Start in steady state; arguments and result as `update`."""
        return self._speed.reset(np.hypot(wind_x, wind_y)), self._direction.reset(yaw_error)

    def update(self, wind_x: float, wind_y: float, yaw_error: float, dt: float) -> tuple[float, float]:
        """Wind speed [m/s] and yaw error [rad] ``dt`` [s] after the last measurement.

        The horizontal wind is that at the hub [m/s], the yaw error the wind's minus the nacelle's direction [rad].
        """
        return self._speed.update(np.hypot(wind_x, wind_y), dt), self._direction.update(yaw_error, dt)


@dataclass(frozen=True)
class Lidar:
    """A lidar on the nacelle: what the wind will be, by beams on a cone about the shaft.

    At each range the reading is the mean over the beams of the speed along the beam, divided by the cosine of the
    cone's half angle: the wind along the axis, if it is uniform. With the beams apart there is one reading for each
    range and beam, without the mean: their differences forecast what the wind does to the tilt and yaw moments of the
    rotor. Ranges may be near for this, a quarter of a rotor diameter or less: what differs from beam to beam is
    smaller than the rotor, and loses its coherence on a longer way. A point is measured, no volume; the wind is without
    the rotor's induction. Turbulence that is seen is not quite what arrives: it changes on its way
    (`wt_gym.wind.turbulent`). The cone has its tip on the tower axis at hub height and a level
    axis that yaws with the nacelle: no overhang, no tilt of the shaft, no motion of the tower. Nothing keeps a beam
    above the ground, where the inflows have values too that mean nothing: ``range * tan(half_angle)`` should be less
    than the hub height.

    Beams count in the sense in which the rotor turns, as the azimuth does: of four beams on a clockwise rotor
    the second one looks to the right, seen looking downwind.

    Raises
    ------
    ValueError
        For ranges that are not positive, an angle outside [0, 80 degrees], no beam, or several beams apart that all
        lie on the axis.
    """

    ranges: tuple[float, ...]  #: distances ahead of the tower axis, along the axis of the cone [m]
    half_angle: float = math.radians(15.0)  #: of the cone [rad]
    n_beams: int = 4  #: evenly spaced, the first one upward
    frozen: bool = False  #: True: turbulence arrives as it is seen (Taylor's hypothesis)
    apart: bool = False  #: True: a reading for each range and beam

    def __post_init__(self) -> None:
        object.__setattr__(self, "ranges", tuple(map(float, self.ranges)))
        if not len(self.ranges) or not all(0.0 < r < math.inf for r in self.ranges):
            raise ValueError(f"a lidar needs positive ranges [m], got {self.ranges!r}")
        if not 0.0 <= self.half_angle <= math.radians(80.0) or self.n_beams < 1:
            raise ValueError(
                f"a lidar needs a half angle of 0 to 80 degrees and a beam, got {self.half_angle!r} rad and "
                f"{self.n_beams!r} beams"
            )
        for name in ("frozen", "apart"):
            if not isinstance(getattr(self, name), bool):
                raise ValueError(f"{name} must be True or False, got {getattr(self, name)!r}")
        if self.apart and self.n_beams > 1 and self.half_angle == 0.0:
            raise ValueError(
                f"half_angle must be above 0 for beams apart, got 0.0 rad: all {self.n_beams} beams would see the same"
            )

    @classmethod
    def for_rotor(cls, diameter: float) -> "Lidar":
        """Ranges of a half, one and one and a half rotor diameters [m].

        They are for preview of the mean wind over the rotor; what makes tilt and yaw moments is smaller than the rotor,
        and ranges for it have to be nearer.
        """
        return cls((0.5 * diameter, diameter, 1.5 * diameter))

    @property
    def n_readings(self) -> int:
        """Numbers that a look gives."""
        return len(self.ranges) * self.n_beams if self.apart else len(self.ranges)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the readings: ``lidar_2`` of the second gate, ``lidar_2_3`` of its third beam."""
        gates = [f"lidar_{gate + 1}" for gate in range(len(self.ranges))]
        if not self.apart:
            return tuple(gates)
        return tuple(f"{gate}_{beam + 1}" for gate in gates for beam in range(self.n_beams))

    def serves(self, other: "Lidar") -> bool:
        """Whether its readings, or their means over the beams of a gate, are those of another lidar."""
        return other in (self, replace(self, apart=False))

    def gate_means(self, readings: ArrayLike) -> NDArray[np.float64]:
        """Mean over the beams of each gate, shape (n_ranges,), of readings in their order [m/s]."""
        means: NDArray[np.float64] = np.asarray(readings, dtype=np.float64).reshape(len(self.ranges), -1).mean(axis=1)
        return means

    @cached_property
    def _side(self) -> NDArray[np.float64]:
        """Way of the beams off the axis, to the left and upward, per way along it, shape (2, n_beams)."""
        angle = 2.0 * math.pi * np.arange(self.n_beams) / self.n_beams
        # a mean is the same in either sense but for its rounding, which recorded numbers have
        turn = -1.0 if self.apart else 1.0
        return math.tan(self.half_angle) * np.array([turn * np.sin(angle), np.cos(angle)])

    def sides(self, rotation: str = "clockwise") -> NDArray[np.float64]:
        """Way of the beams off the axis per way along it, to the left looking downwind, and upward, (2, n_beams) [-].

        Beams apart are counted by the rotation of the rotor, "clockwise" or "counter-clockwise".
        """
        return self._side[:, self._beam_order(rotation)]

    def _beam_order(self, rotation: str) -> NDArray[np.int64]:
        """Places of the beams in the order in which a rotor of this rotation counts them."""
        order = np.arange(self.n_beams)
        return -order % self.n_beams if self.apart and rotation != "clockwise" else order

    @lru_cache(maxsize=4)  # noqa: B019 - a lidar is small, and the nacelle seldom yaws
    def _beams(self, yaw: float, height: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Points that are measured [m], shape (n_ranges, n_beams, 3), and minus the beams over those in a mean."""
        side = self._side
        ahead = np.array([-math.cos(yaw), -math.sin(yaw), 0.0])
        across = np.array([-math.sin(yaw), math.cos(yaw), 0.0])
        beams = ahead + side[0][:, None] * across + side[1][:, None] * np.array([0.0, 0.0, 1.0])
        points = np.multiply.outer(np.asarray(self.ranges), beams) + np.array([0.0, 0.0, height])
        points.setflags(write=False)
        return points, (beams / -(1 if self.apart else self.n_beams)).ravel()

    def places(self, yaw: float, height: float, rotation: str = "clockwise") -> NDArray[np.float64]:
        """Points that are measured, from the foot of the tower, shape (n_ranges, n_beams, 3) [m].

        Parameters as of `read`.
        """
        return self._beams(yaw, height)[0][:, self._beam_order(rotation)]

    def read(
        self, inflow: Inflow, time: float, yaw: float, height: float, rotation: str = "clockwise"
    ) -> NDArray[np.float64]:
        """Readings (n_readings,) gate by gate, and beam by beam where they are apart [m/s].

        At a time [s], with the yaw of the nacelle [rad], the height of the hub [m], and the rotation of the rotor,
        "clockwise" or "counter-clockwise", by which beams apart are counted.
        """
        points, weights = self._beams(yaw, height)
        if self.frozen:
            velocity = np.asarray(inflow.velocity(points, time))
        else:
            velocity = velocity_ahead(inflow, points, time, self.ranges)
        # the speed along a beam over the cosine is the product with a beam that is one long along the shaft
        if not self.apart:
            return velocity.reshape(len(points), -1) @ weights
        along: NDArray[np.float64] = np.add.reduce(velocity.reshape(points.shape) * weights.reshape(-1, 3), axis=-1)
        return along[:, self._beam_order(rotation)].ravel()


class BandLimitedIntegrator:
    """Integral of a signal without its slow part: ``s / (s + w)^2``, a high-pass filter twice over the integral.

    Far above the corner it integrates; a constant input, and a drifting one, give nothing in the end. From an
    acceleration it makes the velocity of a vibration. With ``e = exp(-w dt)`` the two states, both from the input u,

        ``x1 <- e x1 + (1 - e) u / w``,
        ``x2 <- e x2 + dt e x1 + (1 - e - w dt e) u / w^2``,

    give the output ``x1 - w x2`` exactly for an input held over dt. The corner is w [rad/s].
    """

    def __init__(self, corner: float):
        self.corner = float(corner)
        self._first = self._second = 0.0

    def reset(self, value: float = 0.0) -> float:
        """Start in the steady state of a constant input: nothing comes out."""
        self._first, self._second = value / self.corner, value / self.corner**2
        return 0.0

    def update(self, value: float, dt: float) -> float:
        """Take the input of a step of ``dt`` [s] and return the output at its end."""
        w = self.corner
        e = math.exp(-w * dt)
        first = self._first
        self._first = e * first + (1.0 - e) / w * value
        self._second = e * self._second + dt * e * first + (1.0 - e - w * dt * e) / w**2 * value
        return self._first - w * self._second


class SecondOrderLowPass:
    """Low-pass filter ``w^2/(s^2 + 2 zeta w s + w^2)``, exact for an input held over a step.

    Its parameters are the frequency w [rad/s] and the damping ratio zeta [-].
    """

    def __init__(self, frequency: float, damping_ratio: float):
        self.frequency, self.damping_ratio = float(frequency), float(damping_ratio)
        self.reset(math.nan)

    def reset(self, value: float) -> float:
        """Start in steady state at a value, as a new filter does: nothing of former steps stays."""
        self.value, self._rate = float(value), 0.0
        self._step, self._transition = math.nan, (math.nan,) * 4
        return self.value

    def update(self, value: float, dt: float) -> float:
        """Take the value of a step of length ``dt`` [s] and return the filtered one."""
        if dt != self._step:
            w, z = self.frequency, self.damping_ratio
            matrix = expm(dt * np.array([[0.0, 1.0], [-(w**2), -2.0 * z * w]]))
            self._step, self._transition = dt, tuple(matrix.ravel().tolist())
        a, b, c, d = self._transition
        deviation = self.value - value
        self.value, self._rate = value + a * deviation + b * self._rate, c * deviation + d * self._rate
        return self.value
