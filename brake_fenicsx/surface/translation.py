"""Translation fields: a Gaussian field of which every height is mapped to another distribution.

With x a Gaussian field of unit variance, z = T(x) has the distribution whose quantile function is
T(x) = P^-1(Phi(x)). Expanded in Hermite polynomials, T = sum_k t_k He_k / sqrt(k!), the
correlation r of x becomes g(r) = sum_k t_k^2 r^k, a monotone function. The field x therefore gets
the correlation g^-1(R), where R belongs to the wanted spectrum. Neighbouring heights depend on
each other as the spectrum says, so that the highest summit converges with the number of pixels.

Reference: M. Grigoriu, J. Eng. Mech. 124 (1998) 121,
doi:10.1061/(ASCE)0733-9399(1998)124:2(121); M. D. Shields, G. Deodatis, P. Bocchini, Prob. Eng.
Mech. 26 (2011) 511, doi:10.1016/j.probengmech.2011.04.003 (iteration on the spectrum).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.fft
from scipy.special import ndtr

from brake_fenicsx.surface.hdf import HeightDistribution
from brake_fenicsx.surface.psd import half_plane_weights, wave_numbers
from brake_fenicsx.surface.topography import Array

_polynomial: Any = np.polynomial.polynomial
TERMS = 40  # Hermite polynomials; a Johnson distribution of kurtosis 10 needs about 20
REACH = 7.0  # standard deviations of x that are tabulated: 3e-12 of the points lie beyond
ENOUGH = 1e-3  # error of the spectrum at which the iteration stops


@dataclass(frozen=True, slots=True)
class TranslationField:
    """A family of surfaces, prepared once.

    Attributes:
        amplitude: amplitudes of the Gaussian field on the half plane of ``rfft2``, for white noise.
        x: Gaussian heights of the table [-], ascending.
        z: heights they are mapped to, of zero mean and unit variance [-].
        shape: pixels (nx, ny).
        psd_error: rms over the rings of the family's mean spectrum over the wanted one, minus one;
            rings weigh as in the mean square slope.
        slope_ratio: rms slope of the family over that of the wanted spectrum [-].
    """

    amplitude: Array
    x: Array
    z: Array
    shape: tuple[int, int]
    psd_error: float
    slope_ratio: float

    def sample(self, rng: np.random.Generator) -> Array:
        """One surface of unit variance in the mean of the family [-], shape (nx, ny)."""
        noise = scipy.fft.rfft2(rng.standard_normal(self.shape))
        gaussian = scipy.fft.irfft2(noise * self.amplitude, s=self.shape)
        return np.asarray(np.interp(gaussian, self.x, self.z))


def translation_field(
    shares: Array,
    hdf: HeightDistribution,
    shape: tuple[int, int],
    size: Array,
    iterations: int = 20,
) -> TranslationField:
    """Prepare the field of a spectrum and a distribution.

    Args:
        shares: share of every wave vector of ``rfft2`` in the variance, zero at the mean plane;
            their sum over the full plane is one, shape (nx, ny // 2 + 1).
        hdf: distribution of the heights; its shape counts, not its spread.
        shape: pixels (nx, ny).
        size: lengths [m], shape (2,).
        iterations: corrections of the spectrum at most; they act where g^-1(R) is not the
            correlation of any field and its negative part has been cut off.
    """
    weights = half_plane_weights(shape)
    x: Array = np.linspace(-REACH, REACH, 8001, dtype=float)
    z, powers = expansion(hdf, x)
    r = np.linspace(-1.0, 1.0, 4001)
    g = _polynomial.polyval(r, powers)
    wanted: Array = np.asarray(shares / float((weights * shares).sum()), float)
    own = _spectrum(np.interp(_correlation(wanted, shape), g, r), shape)
    q = wave_numbers(shape, size)
    ring, slopes = np.rint(q / q[q > 0.0].min()).astype(np.intp).ravel(), weights * q**2
    best, lowest, slope = own, np.inf, np.inf
    for _ in range(iterations):
        own = np.maximum(own, 0.0)
        own[0, 0] = 0.0
        own /= float((weights * own).sum())
        mapped = _polynomial.polyval(_correlation(own, shape), powers)
        found = _spectrum(mapped, shape)
        asked, got = (np.bincount(ring, (slopes * a).ravel()) for a in (wanted, found))
        missed = np.divide(got - asked, asked, out=np.zeros_like(got), where=asked > 0.0)
        error = float(np.sqrt(asked @ missed**2 / asked.sum()))
        if error < lowest:
            best, lowest, slope = own, error, float(np.sqrt(got.sum() / asked.sum()))
        if lowest <= ENOUGH or error > 2.0 * lowest:
            break
        ratio = np.divide(wanted, found, out=np.ones_like(found), where=found > 0.0)
        own = own * np.clip(ratio, 0.5, 2.0)
    amplitude = np.asarray(np.sqrt(best * (shape[0] * shape[1])), float)
    return TranslationField(amplitude, x, z, shape, lowest, slope)


def expansion(hdf: HeightDistribution, x: Array) -> tuple[Array, Array]:
    """Heights T(x) of zero mean and unit variance, and the squares t_k^2, whose sum is one.

    Args:
        hdf: distribution of the heights.
        x: normal heights [-], evenly spaced from -7 to 7.
    """
    weight = np.exp(-0.5 * x**2)
    weight = weight / weight.sum()
    z = hdf.ppf(ndtr(x))
    z = z - weight @ z
    z = z / np.sqrt(weight @ z**2)
    before, now = np.ones_like(x), x
    terms = [0.0, float(weight @ (z * now))]
    for k in range(2, TERMS):
        before, now = now, (x * now - np.sqrt(k - 1.0) * before) / np.sqrt(k)
        terms.append(float(weight @ (z * now)))
    powers = np.array(terms) ** 2
    return z, powers / powers.sum()


def _correlation(shares: Array, shape: tuple[int, int]) -> Array:
    """Correlation of a spectrum given as shares of the variance [-], shape (nx, ny)."""
    return np.asarray(scipy.fft.irfft2(shares * (shape[0] * shape[1]), s=shape))


def _spectrum(correlation: Array, shape: tuple[int, int]) -> Array:
    """Shares of the variance, the inverse of ``_correlation``."""
    return np.asarray(scipy.fft.rfft2(correlation).real / (shape[0] * shape[1]))
