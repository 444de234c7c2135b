"""Artificial rough surfaces with a given spectrum and a given height distribution.

The spectrum is that of the scan; the variance of the surface follows from it, since a surface
longer than the scan has longer waves too. The height distribution gives the shape: skewness,
kurtosis and tails. Surfaces are translation fields (``translation.py``): both are those of the
family, and single surfaces scatter about them as cuts of one long surface do, the highest points
included.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from brake_fenicsx.arguments import one_of
from brake_fenicsx.errors import SurfaceError
from brake_fenicsx.surface.hdf import HeightDistribution
from brake_fenicsx.surface.psd import Density, half_plane_weights, wave_numbers
from brake_fenicsx.surface.spectrum import LOW, BiFractal
from brake_fenicsx.surface.topography import Array, Topography
from brake_fenicsx.surface.translation import TranslationField, translation_field

VARIANCES = ("spectrum", "scan")
UNSEEN = 0.5  # share of the variance in waves that the scan never saw that is worth a warning
POOR = 0.05  # error of the radial PSD that is worth a warning
WRONG = 0.25  # error of the rms slope that no law survives


@dataclass(frozen=True, slots=True)
class SynthesisRecord:
    """What the synthesis reached.

    Attributes:
        psd_error: rms over the rings of C / C_target - 1 of the family's mean, every ring with its
            weight in the mean square slope [-].
        slope_ratio: rms slope of the family over that of the spectrum [-].
        C0_scale: factor between the given PSD and the one imposed: 1, unless the variance is that
            of the scan [-].
        S_q: root-mean-square height of the family [m].
        low: treatment of the wave numbers below the scan's band.
        low_share: share of the variance in those wave numbers [-].
    """

    psd_error: float
    slope_ratio: float
    C0_scale: float
    S_q: float
    low: str
    low_share: float


def synthesise(
    psd: BiFractal | Density,
    hdf: HeightDistribution,
    shape: tuple[int, int],
    size: tuple[float, float],
    rng: np.random.Generator,
    low: str = "flat",
    variance: str = "spectrum",
) -> Topography:
    """Make one periodic artificial surface.

    Args:
        psd: density C(q) [m^4] of the wave number [rad/m].
        hdf: distribution of the heights.
        shape: pixels (nx, ny).
        size: lengths [m], shape (2,).
        rng: source of the random field.
        low: where the surface is longer than the scan, ``"extend"`` the power law or hold it
            ``"flat"``; for a plain function of q it has no effect.
        variance: ``"spectrum"``: that of ``psd`` on this grid, and ``hdf`` is scaled to it;
            ``"scan"``: that of ``hdf``, and ``psd`` is scaled to it (the source's reading, which
            puts a surface longer than the scan below its spectrum).

    Returns:
        Surface with zero mean; its ``record`` tells the errors reached, its ``warnings`` what is
        doubtful about it.

    Raises:
        SurfaceError: an argument without meaning, a PSD without power on this grid, or one that
            such heights cannot have.
    """
    if min(shape) < 2 or min(size) <= 0.0:
        raise SurfaceError(f"surface of {shape} pixels and {size} m; at least 2 x 2 and positive")
    one_of("variance", variance, VARIANCES)
    one_of("low", low, LOW)
    grid = (shape[0], shape[1]), (float(size[0]), float(size[1]))
    asked, low_share, field = _family(psd, hdf, *grid, low)
    S_q = hdf.S_q if variance == "scan" else float(np.sqrt(asked))
    heights = S_q * field.sample(rng)
    record = SynthesisRecord(
        field.psd_error, field.slope_ratio, S_q**2 / asked, S_q, low, low_share
    )
    lengths = np.array(size, dtype=float)
    surface = heights - heights.mean()
    return Topography(surface, lengths, True, "artificial surface", _doubts(record), record)


@functools.lru_cache(maxsize=4)
def _family(
    psd: BiFractal | Density, hdf: HeightDistribution, shape: tuple[int, int],
    size: tuple[float, float], low: str,
) -> tuple[float, float, TranslationField]:  # fmt: skip
    """Of all surfaces of a grid, once: variance [m^2], its share below the band, the field."""
    powers, variance, low_share = _powers(psd, shape, np.array(size), low)
    field = translation_field(powers * (1.0 / variance), hdf, shape, np.array(size))
    if not abs(field.slope_ratio - 1.0) < WRONG:
        raise SurfaceError(
            f"artificial surfaces of {shape[0]} x {shape[1]} pixels have {field.slope_ratio:.3g}"
            " times the rms slope of the spectrum: no surface has these heights and this spectrum;"
            " check the scan for steps and noise, or choose another 'distribution'"
        )
    return variance, low_share, field


def _powers(
    psd: BiFractal | Density, shape: tuple[int, int], size: Array, low: str
) -> tuple[Array, float, float]:
    """Variance of every wave vector [m^2], of all, and the share of those below the band [-]."""
    q = wave_numbers(shape, size)
    if isinstance(psd, BiFractal):
        C, lo = psd(q, low), (psd.form or psd).band[0]
    else:
        C, lo = np.where(q > 0.0, psd(np.where(q > 0.0, q, q[q > 0.0].min())), 0.0), 0.0
    powers = C * (4.0 * np.pi**2 / float(np.prod(size)))
    weighted = half_plane_weights(shape) * powers
    variance = float(weighted.sum())
    if not 0.0 < variance < np.inf:
        raise SurfaceError(
            f"the variance of the PSD on this grid is {variance:.3g} m^2; a rough surface needs"
            " some roughness, and a finite one"
        )
    below = float(weighted[q < lo * (1.0 - 1e-12)].sum()) / variance
    return powers, variance, below


def _doubts(record: SynthesisRecord) -> tuple[str, ...]:
    """What a user should know of this surface, one line each."""
    found = []
    if record.psd_error > POOR:
        found.append(
            f"PSD missed by {record.psd_error:.1%} rms: heights and spectrum contradict each other;"
            " choose another 'distribution'"
        )
    if record.low_share > UNSEEN:
        flat = " or hold the PSD 'flat'" if record.low == "extend" else ""
        found.append(
            f"{record.low_share:.0%} of the variance lies in waves longer than those that the scan"
            f" measures reliably (low = {record.low!r}); scan a larger area, make smaller"
            f" patches{flat}"
        )
    return tuple(f"artificial surface: {text}" for text in found)
