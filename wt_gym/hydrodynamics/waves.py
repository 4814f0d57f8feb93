"""Linear waves in water of finite depth: dispersion, spectra, spreading, and the components of an episode."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from wt_gym.base.errors import InflowError
from wt_gym.base.options import LONGEST, option, option_record
from wt_gym.base.quantities import GRAVITY, Array
from wt_gym.hydrodynamics.record import Record

_TIDE = 120.0  # Period beyond which an elevation is none of waves [s]
KINDS = ("still", "regular", "jonswap", "pierson_moskowitz", "white", "file")
_PEAKED = ("jonswap", "pierson_moskowitz")


def wave_number(frequency: ArrayLike, depth: float, gravity: float = GRAVITY) -> Array:
    """Return the wave number k [1/m] of ω² = g k tanh(k h).

    Parameters
    ----------
    frequency : array_like
        Angular frequency ω [rad/s], above 0.
    depth : float
        Of the water [m]; infinity is deep water.
    gravity : float
        [m/s^2].

    Raises
    ------
    InflowError
        If a frequency, the depth or the gravity is not above 0.
    """
    omega = np.asarray(frequency, dtype=np.float64)
    if not (np.all(omega > 0.0) and depth > 0.0 and gravity > 0.0):
        raise InflowError(f"frequency, depth and gravity must be above 0, got {np.min(omega, initial=math.inf):g}, "
                          f"{depth:g}, {gravity:g}")  # fmt: skip
    deep = omega**2 / gravity
    if math.isinf(depth):
        return deep
    target = deep * depth
    x = target / np.sqrt(np.tanh(target))  # within 6 % (C. Eckart, 1952)
    for _ in range(8):
        tanh = np.tanh(x)
        x = x - (x * tanh - target) / (tanh + x * (1.0 - tanh**2))
    return x / depth


class WaveRecord(Record):
    """Record whose errors are those of an inflow."""

    error: ClassVar[type[Exception]] = InflowError


@option_record
class WaveComponents(WaveRecord):
    """Sum of linear waves: elevation Σ a cos(ω t + φ - k (x cos β + y sin β))."""

    frequency: Array = option("ω", unit="rad/s", shape=("component",), low=1e-4, high=100)
    amplitude: Array = option("a", unit="m", shape=("component",), low=0, high=100)
    phase: Array = option("φ", unit="rad", shape=("component",))
    direction: Array = option("β, towards which it travels, from x to y", unit="rad", shape=("component",))
    depth: float | None = option(
        "depth of the water", default=None, unit="m", low=0, above=True, high=1e5, otherwise="deep water"
    )
    gravity: float = option("acceleration of free fall", default=GRAVITY, unit="m/s^2", low=0, above=True, high=100)
    current: tuple[float, ...] = option(
        "uniform velocity of the water in x and y", default=(0.0, 0.0), unit="m/s", low=-10, high=10
    )

    def check(self) -> None:
        """Check the current."""
        if len(self.current) != 2:
            raise InflowError(f"WaveComponents.current must be two numbers, got {self.current}")

    def mirrored(self) -> WaveComponents:
        """Return the mirror image of the sea, y → −y."""
        return replace(self, direction=-self.direction, current=(self.current[0], -self.current[1]))

    @property
    def description(self) -> str:
        """Height, peak period and mean direction of the waves, and the current, as text."""
        height, flow, waves = self.height, math.hypot(*self.current), "no waves"
        if height > 0.0:
            h, t = ("H", "T") if len(self.amplitude) == 1 else ("Hs", "Tp")
            peak = f"{t} {2.0 * math.pi / float(self.frequency[np.argmax(self.amplitude)]):.3g} s, "
            has_peak = t == "T" or np.ptp(self.amplitude) > 1e-6 * self.amplitude.max()
            to = np.angle(np.sum(self.amplitude**2 * np.exp(1j * self.direction)), deg=True)
            waves = f"{h} {height:.3g} m, {peak if has_peak else ''}towards {to:.0f} deg"
        towards = math.degrees(math.atan2(self.current[1], self.current[0]))
        return waves if flow == 0.0 else f"{waves}, current of {flow:.3g} m/s towards {towards:.0f} deg"

    @property
    def height(self) -> float:
        """Significant height, four standard deviations of the elevation; of one wave from trough to crest [m]."""
        if len(self.amplitude) == 1:
            return 2.0 * float(self.amplitude[0])
        return 4.0 * math.sqrt(0.5 * float(np.sum(self.amplitude**2)))

    @property
    def wave_number(self) -> Array:
        """Wave numbers k [1/m], shape (component,)."""
        return wave_number(self.frequency, self.depth or math.inf, self.gravity)

    def elevation(self, time: ArrayLike, x: ArrayLike = 0.0, y: ArrayLike = 0.0) -> Array:
        """Return the elevation [m] at times [s] and positions [m], which broadcast against each other."""
        t, x, y = (np.asarray(values, dtype=np.float64)[..., None] for values in (time, x, y))
        k = self.wave_number
        along = x * np.cos(self.direction) + y * np.sin(self.direction)
        result: Array = (self.amplitude * np.cos(self.frequency * t + self.phase - k * along)).sum(axis=-1)
        return result


@option_record
class SeaState(WaveRecord):
    """Waves and current of an episode.

    Spectra are those of IEC 61400-3-1 (2019), annex B: JONSWAP with its peak factor from height and period where none
    is given, Pierson-Moskowitz with a peak factor of 1. Components are 2π / duration apart, so that nothing repeats;
    their amplitudes follow from the spectrum, their phases are random. A spread sea draws the direction of each
    component from a density proportional to cos^2s within a right angle from the main direction (DNV-RP-C205 (2010),
    section 3.5.8).
    """

    kind: str = option("kind of sea", default="still", choices=KINDS)
    significant_height: float = option(
        "significant wave height; height of regular waves", default=0.0, unit="m", low=0, high=30
    )
    peak_period: float = option("peak period; period of regular waves", default=10.0, unit="s", low=1, high=60)
    peak_factor: float | None = option(
        "peak factor of JONSWAP", default=None, unit="-", low=1, high=10, otherwise="from height and period"
    )
    direction: float = option(
        "towards which waves go, counter-clockwise from x", default=0.0, unit="rad", low=-2 * math.pi, high=2 * math.pi
    )
    spreading: float | None = option(
        "exponent s of cos^2s; 0: none", default=None, unit="-", low=0, high=200, otherwise="long crests"
    )
    low_cutoff: float = option("least frequency of components", default=0.2, unit="rad/s", low=1e-3, high=10)
    high_cutoff: float = option("largest frequency of components", default=1.25, unit="rad/s", low=1e-2, high=20)
    file: Path | None = option(
        "CSV file of time [s] and elevation [m] at the origin, with or without lines of names and units",
        default=None,
        otherwise="none",
    )
    duration: float = option("time within which nothing repeats", default=600.0, unit="s", low=10, high=LONGEST)
    current: tuple[float, ...] = option(
        "uniform velocity of the water in x and y", default=(0.0, 0.0), unit="m/s", low=-10, high=10
    )

    def check(self) -> None:
        """Check what belongs together."""
        if len(self.current) != 2:
            raise InflowError(f"SeaState.current must be two numbers, got {self.current}")
        if (self.kind == "file") != (self.file is not None):
            raise InflowError(
                f"SeaState.file must be given for kind 'file' and no other, got {self.file} for {self.kind!r}"
            )
        if self.kind in ("still", "file") and self.significant_height:
            raise InflowError(
                f"SeaState.significant_height must be 0 for kind {self.kind!r}, got {self.significant_height:g}"
            )
        if self.high_cutoff - self.low_cutoff < 2.0 * 2.0 * math.pi / self.duration:
            raise InflowError(
                f"SeaState.high_cutoff must be at least two components above low_cutoff {self.low_cutoff:g}, "
                f"got {self.high_cutoff:g} rad/s"
            )
        peak = 2.0 * math.pi / self.peak_period
        if self.kind in _PEAKED and not 0.98 * self.low_cutoff < peak < 1.02 * self.high_cutoff:
            raise InflowError(
                f"SeaState.peak_period must lie between the cut-offs, {2.0 * math.pi / self.high_cutoff:.3g} to "
                f"{2.0 * math.pi / self.low_cutoff:.3g} s, or most waves are left out; got {self.peak_period:g} s"
            )
        breaking = 0.142 * GRAVITY * self.peak_period**2 / (2.0 * math.pi)  # Miche (1944), in deep water
        if self.kind == "regular" and self.significant_height > breaking:
            raise InflowError(
                f"SeaState.significant_height must be at most {breaking:.3g} m, where waves of {self.peak_period:g} s "
                f"break; got {self.significant_height:g} m"
            )
        if self.spreading and self.kind == "regular":
            raise InflowError(f"SeaState.spreading must be None or 0 for regular waves, got {self.spreading:g}")
        if self.peak_factor is not None and self.kind != "jonswap":
            raise InflowError(f"SeaState.peak_factor must be None for kind {self.kind!r}, got {self.peak_factor:g}")

    @property
    def gamma(self) -> float:
        """Peak factor in use (IEC 61400-3-1, equation B.7, with the period in seconds and the height in meters)."""
        if self.kind == "pierson_moskowitz":
            return 1.0
        if self.peak_factor is not None:
            return self.peak_factor
        if self.significant_height <= 0.0:
            return 1.0
        steepness = self.peak_period / math.sqrt(self.significant_height)
        if steepness <= 3.6:
            return 5.0
        return 1.0 if steepness > 5.0 else math.exp(5.75 - 1.15 * steepness)

    def spectrum(self, frequency: ArrayLike) -> Array:
        """Return the one-sided spectral density [m^2 s/rad] of JONSWAP, Pierson-Moskowitz or white noise.

        White noise has the whole variance, a sixteenth of the square of the significant height, between the cut-offs.

        Raises
        ------
        InflowError
            If the kind has no spectrum.
        """
        omega = np.asarray(frequency, dtype=np.float64)
        if self.kind == "white":
            inside = (omega >= self.low_cutoff) & (omega <= self.high_cutoff)
            return np.where(inside, self.significant_height**2 / 16.0 / (self.high_cutoff - self.low_cutoff), 0.0)
        if self.kind not in _PEAKED:
            raise InflowError(f"kind must be jonswap, pierson_moskowitz or white for a spectrum, got {self.kind!r}")
        peak = 2.0 * math.pi / self.peak_period
        ratio = omega / peak
        width = np.where(ratio <= 1.0, 0.07, 0.09)
        sharper = self.gamma ** np.exp(-0.5 * ((ratio - 1.0) / width) ** 2)
        base = 0.3125 * self.significant_height**2 / peak * ratio**-5 * np.exp(-1.25 * ratio**-4)
        return base * (1.0 - 0.287 * math.log(self.gamma)) * sharper

    def components(self, rng: np.random.Generator, depth: float, gravity: float = GRAVITY) -> WaveComponents:
        """Return the components of one episode.

        Regular waves have a crest at the origin at t = 0.

        Parameters
        ----------
        rng : Generator
            Draws phases, then directions.
        depth : float
            Of the water [m].
        gravity : float
            [m/s^2].

        Raises
        ------
        InflowError
            If the file cannot be read, is not equally spaced, shorter than the duration or too coarse.
        """
        if self.kind == "still":
            frequency, amplitude, phase = np.ones(1), np.zeros(1), np.zeros(1)  # a wave of no height
        elif self.kind == "regular":
            frequency, phase = np.array([2.0 * math.pi / self.peak_period]), np.zeros(1)
            amplitude = np.array([0.5 * self.significant_height])
        elif self.kind == "file":
            frequency, amplitude, phase = self._from_file()
        else:
            spacing = 2.0 * math.pi / self.duration
            first, last = math.ceil(self.low_cutoff / spacing), math.floor(self.high_cutoff / spacing)
            frequency = spacing * np.arange(first, last + 1, dtype=np.float64)
            amplitude = np.sqrt(2.0 * self.spectrum(frequency) * spacing)
            phase = rng.uniform(-math.pi, math.pi, len(frequency))
        direction = np.full(len(frequency), self.direction)
        if self.spreading:
            direction = direction + self._spread(rng.random(len(frequency)))
        return WaveComponents(frequency, amplitude, phase, direction, depth, gravity, self.current)

    def spreading_density(self, angle: ArrayLike) -> Array:
        """Return the density [1/rad] of directions at an angle [rad] from the main direction.

        Raises
        ------
        InflowError
            If the crests are long.
        """
        if not self.spreading:
            raise InflowError(f"spreading must be above 0 for a density of directions, got {self.spreading}")
        s, theta = self.spreading, np.asarray(angle, dtype=np.float64)
        factor = math.exp(math.lgamma(1.0 + s) - math.lgamma(0.5 + s)) / math.sqrt(math.pi)
        return np.where(np.abs(theta) < 0.5 * math.pi, factor * np.maximum(np.cos(theta), 0.0) ** (2.0 * s), 0.0)

    def _spread(self, share: Array) -> Array:
        """Angles at shares of the distribution of directions."""
        theta = np.linspace(-0.5 * math.pi, 0.5 * math.pi, 4001)
        density = self.spreading_density(theta)
        total = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
        return np.interp(share, total / total[-1], theta)

    def _from_file(self) -> tuple[Array, Array, Array]:
        try:
            rows = Path(str(self.file)).read_text(encoding="utf-8-sig").splitlines()
            for _ in ("names", "units"):  # numbers have nan, inf and e
                if set(filter(str.isalpha, "".join(rows[:1]).lower())) - set("nanife"):
                    rows = rows[1:]
            data = np.loadtxt(rows, delimiter=",", ndmin=2)
        except (OSError, ValueError) as error:
            raise InflowError(f"SeaState.file must be a CSV file of numbers, {self.file} is not: {error}") from error
        if data.ndim != 2 or data.shape[1] < 2 or len(data) < 4 or not np.isfinite(data).all():
            raise InflowError(f"SeaState.file must have 2 columns of finite times and elevations, got {data.shape}")
        time, step = data[:, 0], (data[-1, 0] - data[0, 0]) / (len(data) - 1)
        if step <= 0.0 or np.max(np.abs(np.diff(time) - step)) > 1e-3 * step:
            raise InflowError(f"times in {self.file} must be equally spaced and ascend")
        if len(data) * step < self.duration * (1.0 - 1e-9):
            raise InflowError(f"{self.file} must cover the duration of {self.duration:g} s, got {len(data) * step:g} s")
        transform = np.fft.rfft(data[:, 1]) / len(data)
        frequency = 2.0 * math.pi * np.fft.rfftfreq(len(data), step)
        inside = (frequency >= self.low_cutoff) & (frequency <= self.high_cutoff)
        power = np.abs(transform) ** 2 * (frequency > 2.0 * math.pi / _TIDE)
        share = power[inside].sum() / max(power.sum(), 1e-300)
        if math.pi / step <= self.high_cutoff or share < 0.9:
            raise InflowError(
                f"SeaState.file must resolve waves up to high_cutoff, {self.high_cutoff:g} rad/s, and hold nine tenths "
                f"of the variance of periods up to {_TIDE:g} s between the cut-offs; {self.file} has steps of {step:g} "
                f"s and {share:.0%}"
            )
        frequency, transform = frequency[inside], transform[inside]
        twice = 2.0 * transform * np.exp(-1j * frequency * time[0])
        return frequency, np.abs(twice), np.angle(twice)
