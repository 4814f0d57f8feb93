"""Turbulence of the uniform shear model of Mann on a grid: tensor, spectra and the synthesis of one realization.

Isotropic turbulence with the spectrum of von Kármán is sheared by the mean wind for as long as its eddies live
(Mann, The spatial structure of neutral atmospheric surface-layer turbulence, J. Fluid Mech. 273, 1994; Wind field
simulation, Prob. Engng. Mech. 13, 1998; IEC 61400-1, edition 4, annex C.1). Unlike the Kaimal model (`kaimal`) it
couples the three components: it has the shear stress, eddies that lean forward with height, and a coherence of v and w
of its own.

x points along the wind, y to its left, z up. With the wave vector k = (k₁, k₂, k₃), that before the shearing
k₀ = (k₁, k₂, k₃ + βk₁), and the life time in units of the shear

    β = Γ (kL)^(-2/3) / √₂F₁(1/3, 17/6; 4/3; −(kL)⁻²),

the amplitude of a wave is D (k₀ × n) √(E(k₀)/4π) / k₀², n being white noise, E the spectrum of energy

    E(k) = αε^(2/3) L^(5/3) (kL)⁴ / (1 + (kL)²)^(17/6),

and D the solution of rapid distortion in a uniform shear (Mann 1994, equations 3.12 to 3.18): it adds ζ₁ and ζ₂ times
the third component to the first two, and multiplies the third with k₀²/k².

Parameters: L = 0.8 Λ₁ and Γ = 3.9 are the standard's; αε^(2/3) follows from the required standard deviation σ_u.
What comes out for v and w follows: σ_v/σ_u and σ_w/σ_u are functions of Γ alone.

The box
-------
A grid that samples the field across the wind has the tensor of the field summed over its aliases in k₂ and k₃; of these
the first on either side are taken. For each k₁ the three components are then scaled to the one-point spectra of the
model, integrated over all k₂ and k₃: what the grid, the finite box and the other aliases leave out is made up for. The
field is made wider than the grid, at least by four L and at least eight L, and cut: it would repeat at its edges. Waves
of k₁ = 0 have no place in the box, so every point has zero mean. Amplitudes are Gaussian: standard deviations scatter
from seed to seed and from point to point, σ is that of many of them. ``scaling`` as in `kaimal`.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, cast

import numpy as np
import scipy.fft
import scipy.interpolate
import scipy.special
from numpy.typing import ArrayLike, NDArray

from wt_gym.base.quantities import Array
from wt_gym.wind.iec import length_scale, turbulence_sigma
from wt_gym.wind.inflow import POSITIVE, check_numbers, fill_in
from wt_gym.wind.kaimal import BoxParameters, sample_gain, variance_read

SHEAR = 3.9
"""Γ of the standard."""
LENGTH_SHARE = 0.8
"""L in Λ₁."""
_ALIASES = 1
_WAVES_PER_BATCH = 64
# Wave numbers k₁L at which one-point spectra are tabulated, and of the integration across them.
_TABLE = np.geomspace(1e-3, 1e3, 121)
_RADII, _ANGLES = 280, 32


@dataclass(frozen=True)
class MannParameters(BoxParameters):
    """Everything that determines a Mann box, see :meth:`TurbulenceBox.mann`: ``length`` is L [m], ``shear`` Γ."""

    model: ClassVar[str] = "mann"

    length: float = None  # type: ignore[assignment]  # L [m]; filled in
    shear: float = SHEAR

    def __post_init__(self) -> None:
        super().__post_init__()
        fill_in(self, length=LENGTH_SHARE * length_scale(self.hub_height))
        check_numbers(self, length=("m", *POSITIVE), shear=("", 0.0))

    def synthesize(self) -> NDArray[np.float32]:
        """See `BoxParameters.synthesize`."""
        n_times, (n_y, n_z) = self.n_times, self.grid
        rng, wave = np.random.default_rng(self.seed), self.wave_number
        amplitude = n_times * np.sqrt(0.5 * self.harmonic_variance)
        coefficients = np.zeros((n_times // 2 + 1, n_z, n_y, 3), dtype=np.complex128)
        for start in range(0, wave.size, _WAVES_PER_BATCH):
            batch = slice(start, min(start + _WAVES_PER_BATCH, wave.size))
            # What passes a point at time t has come from x = −V t: the frequency f belongs to k1 = −2πf/V.
            noise = _plane_noise(rng, -wave[batch] * self.length, self)
            coefficients[1 + batch.start : 1 + batch.stop] = noise * amplitude[batch, None, None, :]
        out: Array = scipy.fft.irfft(coefficients, n=n_times, axis=0, overwrite_x=True)
        return out.astype(np.float32)

    @property
    def sigma(self) -> Array:
        """Standard deviations of u, v and w [m/s], shape (3,): that of u is the standard's, the others the model's."""
        target = turbulence_sigma(self.mean_speed, self.turbulence_class, self.turbulence, self.turbine_class)
        variance = _unit_variance(self.shear)
        result: Array = target * np.sqrt(variance[:3] / variance[0])
        return result

    @property
    def dissipation(self) -> float:
        """αε^(2/3) [m^(4/3)/s²], with which the model has σ_u."""
        return float(self.sigma[0] ** 2 / (_unit_variance(self.shear)[0] * self.length ** (2.0 / 3.0)))

    @property
    def wave_number(self) -> Array:
        """k₁ of the harmonics 1/T, 2/T, … below half the sampling frequency [rad/m], shape (n,)."""
        return 2.0 * np.pi * self.frequency / self.mean_speed

    @property
    def unscaled_variance(self) -> Array:
        """Variance of each harmonic by the model [m²/s²], shape (n, 3): 2 F(k₁) Δk₁."""
        spectra = one_point_spectra(self.wave_number, self.length, self.shear, self.dissipation)
        result: Array = 2.0 * spectra[:, :3] * self.wave_number[0]
        return result

    @property
    def harmonic_variance(self) -> Array:
        """Variance of each harmonic of the samples [m²/s²], shape (n, 3), after ``scaling``."""
        share, gain = (f(self.n_times, self.spectrum_of)[:, None] for f in (variance_read, sample_gain))
        variance = self.unscaled_variance
        total = (share * variance).sum(axis=0)
        if self.scaling == "low_frequency":
            variance[0] += (self.sigma**2 - total) / share[0]
        elif self.scaling == "uniform":
            variance *= self.sigma**2 / total
        return gain * variance

    @property
    def description(self) -> str:
        """One line that tells a person what turbulence this is."""
        return (
            f"Mann {self.turbulence} class {self.turbulence_class} at {self.mean_speed:g} m/s "
            f"(sigma_u {self.sigma[0]:.3g} m/s, L {self.length:.3g} m, shear {self.shear:g}), seed {self.seed}, "
            f"scaling {self.scaling}"
        )


def life_time(wave_number: Array, shear: float) -> Array:
    """Life time β of eddies in units of the mean shear, for kL (Mann 1994, equation 3.6).

    Parameters
    ----------
    wave_number
        kL, positive, any shape.
    shear
        Γ.
    """
    k = np.asarray(wave_number, dtype=np.float64)
    if shear == 0.0:
        return np.zeros_like(k)
    result: Array = (
        shear * k ** (-2.0 / 3.0) / np.sqrt(scipy.special.hyp2f1(1.0 / 3.0, 17.0 / 6.0, 4.0 / 3.0, -(k**-2.0)))
    )
    return result


@lru_cache(maxsize=8)
def _life_time_table(shear: float) -> tuple[Array, Array]:
    """Logarithms of kL and β: between them β is a power of k to 1e-5, and the hypergeometric function is slow."""
    k = np.geomspace(1e-5, 1e5, 4001)
    return np.log(k), np.log(life_time(k, shear))


def distortion(k1: Array, k2: Array, k3: Array, beta: Array) -> tuple[Array, Array, Array, Array]:
    """What shearing has done to a wave: k₃ before it, ζ₁, ζ₂ and the factor k₀²/k² (Mann 1994, equations 3.12 to 3.18).

    Parameters
    ----------
    k1, k2, k3
        Wave vector after the shearing; k₁ is not zero.
    beta
        Time of shearing in units of the shear.
    """
    k30 = k3 + beta * k1
    level = k1**2 + k2**2
    k_squared, k0_squared = level + k3**2, level + k30**2
    c1 = beta * k1**2 * (k0_squared - 2.0 * k30**2 + beta * k1 * k30) / (k_squared * level)
    turned = np.arctan2(beta * k1 * np.sqrt(level), k0_squared - k30 * k1 * beta)
    c2 = k2 * k0_squared / level**1.5 * turned
    return k30, c1 - k2 / k1 * c2, k2 / k1 * c1 + c2, k0_squared / k_squared


def spectral_tensor(k1: ArrayLike, k2: ArrayLike, k3: ArrayLike, shear: float) -> Array:
    """Spectral tensor Φ of the model in units of L and αε^(2/3) L^(2/3): Φ_ij(kL) has the unit L³.

    Parameters
    ----------
    k1, k2, k3
        kL, shapes that fit each other; k₁ is not zero.
    shear
        Γ.

    Returns
    -------
    numpy.ndarray
        Shape (..., 6): uu, vv, ww, uv, uw, vw. Real: the model has no helicity.
    """
    k1, k2, k3 = np.broadcast_arrays(*(np.asarray(k, dtype=np.float64) for k in (k1, k2, k3)))
    size = np.sqrt(k1**2 + k2**2 + k3**2)
    beta = np.zeros_like(size) if shear == 0.0 else np.exp(np.interp(np.log(size), *_life_time_table(shear)))
    k30, zeta1, zeta2, factor = distortion(k1, k2, k3, beta)
    level = k1**2 + k2**2
    k0_squared = level + k30**2
    scale = (1.0 + k0_squared) ** (-17.0 / 6.0) / (4.0 * np.pi)  # E(k0) / (4π k0⁴)
    # of isotropic turbulence, k0² δ_ij − k0_i k0_j, then D Φ Dᵀ
    uw0, vw0 = -k1 * k30, -k2 * k30
    tensor = np.empty((*k1.shape, 6))
    tensor[..., 0] = k0_squared - k1**2 + 2.0 * zeta1 * uw0 + zeta1**2 * level
    tensor[..., 1] = k0_squared - k2**2 + 2.0 * zeta2 * vw0 + zeta2**2 * level
    tensor[..., 2] = factor**2 * level
    tensor[..., 3] = -k1 * k2 + zeta2 * uw0 + zeta1 * vw0 + zeta1 * zeta2 * level
    tensor[..., 4] = factor * (uw0 + zeta1 * level)
    tensor[..., 5] = factor * (vw0 + zeta2 * level)
    result: Array = scale[..., None] * tensor
    return result


@lru_cache(maxsize=8)
def _unit_spectra(shear: float) -> Array:
    """∬ Φ dk₂ dk₃ at the wave numbers of the table, in units of L, shape (n, 4): uu, vv, ww, uw.

    In polar coordinates across the wind, by the trapezoidal rule over the angle, where the integrand is periodic, and
    over the logarithm of the radius; what is the same for k₂ and −k₂ is taken twice.
    """
    radius = np.geomspace(1e-4, 1e7, _RADII)
    angle = np.pi * ((np.arange(_ANGLES) + 0.5) / _ANGLES - 0.5)
    k2, k3 = np.multiply.outer(radius, np.cos(angle)), np.multiply.outer(radius, np.sin(angle))
    weight = radius**2 * math.log(radius[1] / radius[0]) * 2.0 * np.pi / _ANGLES
    spectra = [np.einsum("r,ras->s", weight, spectral_tensor(k1, k2, k3, shear)) for k1 in _TABLE]
    return np.array(spectra)[:, [0, 1, 2, 4]]


def one_point_spectra(k1: Array, length: float, shear: float, dissipation: float = 1.0) -> Array:
    """Spectra of the wind at a point over k₁, two-sided: ∫F dk₁ from −∞ to ∞ is the variance.

    Parameters
    ----------
    k1
        Positive [rad/m], shape (n,).
    length, shear, dissipation
        L [m], Γ, αε^(2/3) [m^(4/3)/s²].

    Returns
    -------
    numpy.ndarray
        Shape (n, 4): those of u, v and w, and the cospectrum of u and w [m³/s²]. Below and beyond the table they are
        constant, or continue with the power −5/3 (the cospectrum −7/3).
    """
    k, ends = np.log(np.asarray(k1, dtype=np.float64) * length), np.log(_TABLE[[0, -1]])
    sign, power = np.array([1.0, 1.0, 1.0, -1.0]), np.array([-5.0, -5.0, -5.0, -7.0]) / 3.0
    values = _log_spectra(float(shear))(np.clip(k, *ends)) + np.maximum(k - ends[1], 0.0)[..., None] * power
    result: Array = dissipation * length ** (5.0 / 3.0) * sign * np.exp(values)
    return result


@lru_cache(maxsize=8)
def _log_spectra(shear: float) -> scipy.interpolate.CubicSpline:
    """Logarithms of the sizes of the spectra over log k₁L, smooth between the points of the table."""
    size = np.maximum(np.abs(_unit_spectra(shear)), 1e-300)  # isotropic turbulence has no cospectrum
    return scipy.interpolate.CubicSpline(np.log(_TABLE), np.log(size))


@lru_cache(maxsize=8)
def _unit_variance(shear: float) -> Array:
    """Variances of u, v and w and the covariance of u and w, in units of αε^(2/3) L^(2/3), shape (4,)."""
    k = np.geomspace(1e-4, 1e6, 4001)
    spectra = one_point_spectra(k, 1.0, shear)
    result: Array = 2.0 * (np.trapezoid(spectra * k[:, None], np.log(k), axis=0) + k[0] * spectra[0])
    return result


def _plane_noise(rng: np.random.Generator, k1: Array, parameters: MannParameters) -> NDArray[np.complex128]:
    """Complex noise of unit mean square with the cross-spectra of the model, shape (n, n_z, n_y, 3), for k₁L (n,)."""
    n_y, n_z = parameters.grid
    spacing_y, spacing_z = (d / parameters.length for d in parameters.spacing)
    m_y, m_z = (_wide(n, d) for n, d in ((n_y, spacing_y), (n_z, spacing_z)))
    k2, k3 = (2.0 * np.pi * scipy.fft.fftfreq(m, d) for m, d in ((m_y, spacing_y), (m_z, spacing_z)))
    turn_y, turn_z = 2.0 * np.pi / spacing_y, 2.0 * np.pi / spacing_z
    around = range(-_ALIASES, _ALIASES + 1)
    terms = (
        spectral_tensor(k1[:, None, None], k2 + i * turn_y, k3[:, None] + j * turn_z, parameters.shear)
        for i in around
        for j in around
    )
    tensor = cast(Array, sum(terms))
    white = rng.standard_normal((2, k1.size, m_z, m_y, 3)) * math.sqrt(0.5)
    waves = _correlated(tensor, white[0] + 1j * white[1])
    field = scipy.fft.ifft2(waves, axes=(1, 2), norm="forward", overwrite_x=True)[:, :n_z, :n_y]
    result: NDArray[np.complex128] = field / np.sqrt(tensor[..., :3].sum(axis=(1, 2)))[:, None, None, :]
    return result


def _wide(n_points: int, spacing: float) -> int:
    """Number of points of a field that may repeat, for a grid of so many, with the spacing in L."""
    least = max(n_points + math.ceil(4.0 / spacing), math.ceil(8.0 / spacing))
    return int(scipy.fft.next_fast_len(least))


def _correlated(tensor: Array, white: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """White noise (..., 3) with the covariance of the tensor (..., 6): the Cholesky factor times it."""
    uu, vv, ww, uv, uw, vw = np.moveaxis(tensor, -1, 0)
    a = np.sqrt(uu)
    b, c = uv / a, uw / a
    d = np.sqrt(np.maximum(vv - b**2, 0.0))  # a wave has two degrees of freedom: rounding decides on the sign of zero
    e = np.divide(vw - b * c, d, out=np.zeros_like(d), where=d > 1e-7 * np.sqrt(vv))
    f = np.sqrt(np.maximum(ww - c**2 - e**2, 0.0))
    u, v, w = np.moveaxis(white, -1, 0)
    return np.stack((a * u, b * u + d * v, c * u + e * v + f * w), axis=-1)
