"""Parameters of a turbulence box, and Kaimal turbulence of IEC 61400-1 on a grid: spectra, coherence and synthesis.

Interpolation
-------------
Samples dt apart are read by linear interpolation. A harmonic of frequency f, x = f dt, keeps the amplitude sinc²(x),
sinc(x) = sin(πx)/(πx): the Fourier transform of the triangle with which linear interpolation convolves the samples
(Oppenheim and Schafer, Discrete-Time Signal Processing, section 4.6). The rest appears as images at |m/dt ± f| with the
amplitudes sinc²(m ± x). Together they hold the share (2 + cos 2πx)/3 of the variance: the mean square on the line from
a to b is (a² + ab + b²)/3. Samples whose amplitudes are divided by sinc² therefore give the interpolated wind exactly
the required spectrum up to half the sampling frequency. x depends only on the number of the harmonic in the record, so
that this holds at every speed at which a box is carried along.

Synthesis
---------
The three components are stationary processes with the one-sided Kaimal spectra of IEC 61400-1 (edition 4, annex C.2)
and, between two points a distance r apart at frequency f, the coherence exp(−κ(f) r). Following Veers
(Three-dimensional wind simulation, SAND88-0152, 1988) the Fourier coefficients at each frequency are √S(f) A(f) ζ with
A Aᵀ the coherence matrix and ζ_j = exp(iφ_j) of random phase. The hub is the reference point, ζ of one number only: its
harmonics have the amplitudes of the spectrum in every seed. The other points mix several phases: their standard
deviations scatter by a tenth between seeds, because a few slow harmonics hold most of the variance. (Were the
amplitudes random at the hub too, a scaling to the target σ would multiply all frequencies by 0.8 to 1.35, by the chance
of those few harmonics.)

On a regular grid the coherence matrix is unchanged when the grid is mirrored left-right or top-bottom. In a
basis of even and odd vectors it falls apart into four blocks of a quarter of the size, and their Cholesky factors
cost a sixteenth of the full one.

Standard deviation of a box
---------------------------
The spectrum integrates to σ² over all frequencies. A record of period T has the harmonics n/T up to half the sampling
frequency, and Σ S(n/T)/T falls short of σ²: of the slow variations below 1.5/T only the first harmonic is left, and
eddies too fast for the sampling are missing. At 12 m/s, 600 s and 0.25 s, σ_u comes out as 0.945 of the target. Three
answers (``scaling``), all without chance, because the amplitudes at the hub are certain. All count the wind as it is
read, in straight lines between the samples (`wt_gym.wind.kaimal`), unless ``spectrum_of="samples"``:

``"low_frequency"`` (default)
    The first harmonic carries the missing variance: σ at the hub is the target of the load cases, and every other
    harmonic is that of the spectrum. Its period is the record itself, so it shifts the operating point slowly and
    loads no structure; the range of the rotor's harmonics and natural frequencies is neither too hot nor too cold.
``"uniform"``
    All harmonics are multiplied by the same factor: σ at the hub is the target, all frequencies are too strong by the
    factor (1.06 in the example). Use it to compare with generators that scale this way.
``"none"``
    Every harmonic is that of the spectrum, σ falls short. Use it to compare spectra.
"""

import math
from dataclasses import KW_ONLY, asdict, dataclass
from typing import ClassVar

import numpy as np
import scipy.fft
from numpy.typing import ArrayLike, NDArray

from wt_gym.base.errors import InflowError
from wt_gym.base.processes import one_blas_thread
from wt_gym.base.quantities import Array
from wt_gym.wind.coherence_kernels import parity_block
from wt_gym.wind.iec import length_scale, turbulence_sigma
from wt_gym.wind.inflow import POSITIVE, check_numbers, fill_in

SPECTRUM_OF = ("interpolated", "samples")
"""Of what a box has the spectrum and the standard deviation: of the wind as it is read, or of the bare samples."""


def sample_gain(n_times: int, spectrum_of: str) -> Array:
    """Variance of the samples over the required one, of the harmonics 1, 2, … below half the sampling frequency.

    Parameters
    ----------
    n_times
        Number of samples.
    spectrum_of
        Of `SPECTRUM_OF`.

    Returns
    -------
    numpy.ndarray
        Shape ((n_times - 1) // 2,).
    """
    place = _places(n_times)
    return np.ones(place.size) if spectrum_of == "samples" else np.sinc(place) ** -4


def variance_read(n_times: int, spectrum_of: str) -> Array:
    """Variance that counts for the standard deviation of a box over the required one, by harmonic with its images.

    Parameters
    ----------
    n_times, spectrum_of
        As of `sample_gain`.

    Returns
    -------
    numpy.ndarray
        Shape ((n_times - 1) // 2,).
    """
    place = _places(n_times)
    if spectrum_of == "samples":
        return np.ones(place.size)
    return (2.0 + np.cos(2.0 * np.pi * place)) / 3.0 * sample_gain(n_times, spectrum_of)


def _places(n_times: int) -> Array:
    """Frequencies of the harmonics times the sampling interval."""
    return np.arange(1, (n_times - 1) // 2 + 1) / n_times


SIGMA_RATIO = np.array([1.0, 0.8, 0.5])
LENGTH_RATIO = np.array([8.1, 2.7, 0.66])
COHERENCE_DECREMENT = 12.0
COHERENCE_OFFSET = 0.12
SCALINGS = ("low_frequency", "uniform", "none")

_FREQUENCIES_PER_BATCH = 64  # the largest block of a batch takes 3 MB for 17 x 17 points, 26 MB for 29 x 29
_NOTHING = 1e-60
"""Coherence that is none."""
_DEFAULT_SPACING = 10.0
_DEFAULT_MARGIN = 1.15


@dataclass(frozen=True)
class BoxParameters:
    """What determines a box of any model: the arguments of `TurbulenceBox.kaimal`, checked, defaults filled in."""

    model: ClassVar[str]

    mean_speed: float
    hub_height: float
    rotor_diameter: float
    turbulence_class: str = "B"
    _: KW_ONLY
    seed: int
    duration: float = 600.0
    time_step: float = 0.25
    grid: tuple[int, int] = None  # type: ignore[assignment]  # (n_y, n_z); filled in
    width: float = None  # type: ignore[assignment]  # side of the square grid [m]; filled in
    turbulence: str = "NTM"
    turbine_class: str = "I"
    scaling: str = "low_frequency"
    spectrum_of: str = "interpolated"

    def __post_init__(self) -> None:
        check_numbers(self, mean_speed=("m/s", *POSITIVE), hub_height=("m", *POSITIVE), time_step=("s", *POSITIVE))
        check_numbers(
            self, rotor_diameter=("m", 0.0, 2.0 * self.hub_height, True),
            duration=("s", 4.0 * self.time_step),
        )  # fmt: skip
        # refuses unknown classes
        turbulence_sigma(self.mean_speed, self.turbulence_class, self.turbulence, self.turbine_class)
        if isinstance(self.seed, bool) or not isinstance(self.seed, int | np.integer) or self.seed < 0:
            raise InflowError(f"seed must be an integer of at least 0; got {self.seed!r}")
        object.__setattr__(self, "seed", int(self.seed))
        for name, allowed in (("scaling", SCALINGS), ("spectrum_of", SPECTRUM_OF)):
            if (value := getattr(self, name)) not in allowed:
                raise InflowError(f"{name} must be one of {', '.join(map(repr, allowed))}; got {value!r}")
        if abs(self.n_times * self.time_step - self.duration) > 1e-6 * self.duration:
            raise InflowError(f"duration must be a multiple of time_step; got {self.duration} s and {self.time_step} s")
        fill_in(self, width=min(_DEFAULT_MARGIN * self.rotor_diameter, 1.98 * self.hub_height))  # above the ground
        check_numbers(self, width=("m", 0.0, 2.0 * self.hub_height, True))
        n_points = 2 * math.ceil(0.5 * self.width / _DEFAULT_SPACING) + 1
        fill_in(self, grid=(n_points, n_points))
        object.__setattr__(self, "grid", _checked_grid(self.grid))

    def synthesize(self) -> NDArray[np.float32]:
        """Fluctuations of the realization [m/s], float32, shape (n_times, n_z, n_y, 3).

        Every point has zero mean over the period. The Nyquist frequency carries nothing.
        """
        raise NotImplementedError

    @property
    def description(self) -> str:
        """One line that tells a person what turbulence this is."""
        raise NotImplementedError

    @property
    def n_times(self) -> int:
        """Number of time steps."""
        return round(self.duration / self.time_step)

    @property
    def spacing(self) -> tuple[float, float]:
        """Distance between grid points along y and z [m]."""
        return self.width / (self.grid[0] - 1), self.width / (self.grid[1] - 1)

    @property
    def frequency(self) -> Array:
        """Frequencies of the harmonics [Hz], shape (n,): multiples of 1/T below half the sampling frequency."""
        return np.arange(1, (self.n_times - 1) // 2 + 1) / (self.n_times * self.time_step)

    def as_dict(self) -> dict[str, object]:
        """Return the parameters as plain values that JSON can hold."""
        return {"model": self.model, **asdict(self), "grid": list(self.grid)}


@dataclass(frozen=True)
class KaimalParameters(BoxParameters):
    """Everything that determines a Kaimal box, see :meth:`TurbulenceBox.kaimal`."""

    model: ClassVar[str] = "kaimal"

    lateral_coherence: bool = True

    def synthesize(self) -> NDArray[np.float32]:
        """See `BoxParameters.synthesize`; by Veers' method."""
        with one_blas_thread():
            return _synthesized(self)

    @property
    def sigma(self) -> Array:
        """Standard deviations of u, v and w [m/s], shape (3,)."""
        return SIGMA_RATIO * turbulence_sigma(
            self.mean_speed, self.turbulence_class, self.turbulence, self.turbine_class
        )

    @property
    def unscaled_variance(self) -> Array:
        """Variance S(f)/T of each harmonic by the spectrum [m²/s²], shape (n, 3), of what ``spectrum_of`` names."""
        spectrum = kaimal_spectrum(self.frequency, self.mean_speed, self.hub_height, self.sigma[0])
        return spectrum / (self.n_times * self.time_step)

    @property
    def amplitude_factor(self) -> Array:
        """Factor on the amplitudes of u, v and w, shape (3,): of the first harmonic or of all (``scaling``)."""
        variance = self._variance_read
        total = variance.sum(axis=0)
        if self.scaling == "low_frequency":  # S falls with f, so the sum never reaches the integral σ²
            result: Array = np.sqrt(1.0 + (self.sigma**2 - total) / variance[0])
            return result
        if self.scaling == "uniform":
            result = self.sigma / np.sqrt(total)
            return result
        return np.ones(3)

    @property
    def _variance_read(self) -> Array:
        """What each harmonic without a scaling adds to σ² [m²/s²], shape (n, 3)."""
        return self.unscaled_variance * variance_read(self.n_times, self.spectrum_of)[:, None]

    @property
    def harmonic_variance(self) -> Array:
        """Variance of each harmonic of the samples at the hub [m²/s²], shape (n, 3)."""
        variance = self.unscaled_variance * sample_gain(self.n_times, self.spectrum_of)[:, None]
        variance[: 1 if self.scaling == "low_frequency" else None] *= self.amplitude_factor**2
        return variance

    @property
    def description(self) -> str:
        """One line that tells a person what turbulence this is."""
        return (
            f"Kaimal {self.turbulence} class {self.turbulence_class} at {self.mean_speed:g} m/s "
            f"(sigma_u {self.sigma[0]:.3g} m/s), seed {self.seed}, {self.scaling_description}"
        )

    @property
    def scaling_description(self) -> str:
        """What was done about the variance that the record leaves out, with the factors of u, v and w."""
        if self.scaling == "none":
            share = np.sqrt(self._variance_read.sum(axis=0)) / self.sigma
            return f"unscaled: {_three(share)} of sigma"
        what = "first harmonic" if self.scaling == "low_frequency" else "all amplitudes"
        return f"{what} times {_three(self.amplitude_factor)}"


def _three(numbers: Array) -> str:
    return "/".join(f"{number:.3g}" for number in numbers)


def _checked_grid(grid: tuple[int, int]) -> tuple[int, int]:
    try:
        n_y, n_z = (int(n) for n in grid)
    except (TypeError, ValueError) as error:
        raise InflowError(f"grid must be two numbers of points (n_y, n_z); got {grid!r}") from error
    if min(n_y, n_z) < 3 or n_y % 2 == 0 or n_z % 2 == 0:
        raise InflowError(
            f"grid needs odd numbers of points of at least 3, so that one lies at the hub; got {(n_y, n_z)}"
        )
    return n_y, n_z


def kaimal_spectrum(frequency: ArrayLike, mean_speed: float, hub_height: float, sigma_u: float) -> Array:
    """One-sided Kaimal spectra S_k(f) of u, v and w [m²/s²/Hz].

    f S_k/σ_k² = 4 (f L_k/V) / (1 + 6 f L_k/V)^(5/3) with L = (8.1, 2.7, 0.66) Λ₁ and σ = (1, 0.8, 0.5) σ_u
    (IEC 61400-1, equation C.14 and table C.1).

    Parameters
    ----------
    frequency
        Frequencies [Hz], shape (n,).
    mean_speed, hub_height, sigma_u
        Mean speed at the hub [m/s], hub height [m], standard deviation of u [m/s].

    Returns
    -------
    numpy.ndarray
        Shape (n, 3).
    """
    time_scale = LENGTH_RATIO * length_scale(hub_height) / mean_speed
    reduced = np.asarray(frequency, dtype=np.float64)[..., None] * time_scale
    return (SIGMA_RATIO * sigma_u) ** 2 * 4.0 * time_scale / (1.0 + 6.0 * reduced) ** (5.0 / 3.0)


def coherence_decay(frequency: ArrayLike, mean_speed: float, hub_height: float) -> Array:
    """Decay rate κ(f) [1/m] of the coherence exp(−κ r) between points a distance r apart across the wind.

    κ = 12 √((f/V)² + (0.12/L_c)²), L_c = 8.1 Λ₁ (IEC 61400-1, equation C.16, with r taken out of the root).
    """
    scale = LENGTH_RATIO[0] * length_scale(hub_height)
    result: Array = COHERENCE_DECREMENT * np.hypot(
        np.asarray(frequency, dtype=np.float64) / mean_speed, COHERENCE_OFFSET / scale
    )
    return result


def _synthesized(parameters: KaimalParameters) -> NDArray[np.float32]:
    """See `KaimalParameters.synthesize`."""
    n_times, (n_y, n_z) = parameters.n_times, parameters.grid
    rng = np.random.default_rng(parameters.seed)
    frequency = parameters.frequency
    decay = coherence_decay(frequency, parameters.mean_speed, parameters.hub_height)

    coefficients = np.zeros((n_times // 2 + 1, n_z, n_y, 3), dtype=np.complex128)
    for start in range(0, frequency.size, _FREQUENCIES_PER_BATCH):
        batch = slice(start, min(start + _FREQUENCIES_PER_BATCH, frequency.size))
        noise = _coherent_noise(rng, decay[batch], parameters)
        coefficients[1 + batch.start : 1 + batch.stop] = noise[..., :3] + 1j * noise[..., 3:]
    # A harmonic a cos + b sin holds the variance (a² + b²)/2; its coefficient is n/2 (a − ib).
    amplitude = n_times * np.sqrt(0.5 * parameters.harmonic_variance)
    coefficients[1 : frequency.size + 1] *= amplitude[:, None, None, :]
    result: NDArray[np.float32] = scipy.fft.irfft(coefficients, n=n_times, axis=0, overwrite_x=True).astype(np.float32)
    return result


def _coherent_noise(rng: np.random.Generator, decay: Array, parameters: KaimalParameters) -> Array:
    """Noise of unit mean square with the coherence at each frequency, shape (n_frequencies, n_z, n_y, 6).

    The last axis holds three real and three imaginary parts. At the hub the modulus is exactly one.
    """
    n_y, n_z = parameters.grid
    noise = rng.standard_normal((decay.size, n_z, n_y, 6))
    radius = np.hypot(noise[..., :3], noise[..., 3:])
    noise /= np.concatenate((radius, radius), axis=-1)  # only the phase is random
    # Rows of these orthogonal matrices: even vectors first, then odd ones.
    basis_y, basis_z = _reflection_basis(n_y), _reflection_basis(n_z)
    halves_y, halves_z = _halves(n_y), _halves(n_z)
    table = _coherence_table(decay, parameters)
    blocks = np.empty_like(noise)
    for rows in halves_z:
        for columns in halves_y:
            part = noise[:, rows, columns]
            factor = _upper_factor(table, *part.shape[1:3])
            blocks[:, rows, columns] = (factor @ part.reshape(decay.size, -1, 6)).reshape(part.shape)
    coherent: Array = np.einsum("fabc,az,by->fzyc", blocks, basis_z, basis_y, optimize=True)
    if not parameters.lateral_coherence:
        coherent[..., [1, 2, 4, 5]] = noise[..., [1, 2, 4, 5]]
    return coherent


def _coherence_table(decay: Array, parameters: KaimalParameters) -> Array:
    """Coherence of two points by their distance in grid steps along z and y, shape (n_frequencies, n_z, n_y)."""
    (n_y, n_z), (spacing_y, spacing_z) = parameters.grid, parameters.spacing
    distance = np.hypot(spacing_z * np.arange(n_z)[:, None], spacing_y * np.arange(n_y))
    out: Array = np.exp(-decay[:, None, None] * distance)
    out[out < _NOTHING] = 0.0  # repeated products of still smaller ones are denormal, which is slow
    return out


def _upper_factor(table: Array, n_rows: int, n_columns: int) -> Array:
    """Upper triangular U with U Uᵀ the coherence matrices (n, m, m) of one parity per axis, m = ``n_rows n_columns``.

    The hub is the last vector of the even-even block, and the last row of U holds its diagonal only: one number of the
    noise decides the hub.
    """
    size = n_rows * n_columns
    reversed_block = np.zeros((len(table), size, size))
    parity_block(table, n_rows, n_columns, reversed_block)
    lower = np.linalg.cholesky(reversed_block)  # which reads the lower triangle alone
    return lower[:, ::-1, ::-1]  # type: ignore[return-value]  # its stubs know floating alone


def _halves(n: int) -> tuple[slice, slice]:
    """Where the even and the odd vectors of n points stand."""
    n_even = n - n // 2
    return slice(0, n_even), slice(n_even, n)


def _reflection_basis(n: int) -> Array:
    """Orthogonal matrix (n, n) whose rows are even, then odd, under reversal of n (odd) points."""
    half = n // 2
    basis = np.zeros((n, n))
    for i in range(half):
        basis[i, [i, n - 1 - i]] = math.sqrt(0.5)
        basis[half + 1 + i, [i, n - 1 - i]] = math.sqrt(0.5), -math.sqrt(0.5)
    basis[half, half] = 1.0
    return basis
