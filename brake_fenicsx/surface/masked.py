"""Spectrum of a surface of which a scan shows only a part.

Missing points are filled harmonically, and the filled surface is smoother than the measured one: by
how much at every wave number depends on the sizes of the holes. Random surfaces of the spectrum
that is sought lose the same points and are levelled, filled and transformed like the scan; what
they lose on average is what the scan has lost (indirect inference).

Reference: C. Gourieroux, A. Monfort, E. Renault, J. Appl. Econometrics 8 (1993) S85,
doi:10.1002/jae.3950080507.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import scipy.fft

from brake_fenicsx.arguments import Array
from brake_fenicsx.surface.psd import Density, RadialPsd, ring_sums, wave_numbers, waves_of
from brake_fenicsx.surface.topography import Scans, Topography, filling, form

SURFACES = 16  # of all scans together
ROUNDS = 2
FEW = 0.01  # share of missing points that changes no ring by more
LIKE = 0.7  # coherence over the share of measured points below which waves are not shown
Filling = Callable[[Array], Array]


def without_holes(
    psd: RadialPsd, scans: Scans, level: str, spectrum: Callable[[RadialPsd], Density]
) -> RadialPsd:
    """The radial PSD that scans would have without missing points, on average.

    Its reliable band ends where the filled scans no longer show the waves of the surface.

    Args:
        psd: that of the filled scans.
        scans: levelled scan, or several.
        level: form that was removed from them.
        spectrum: of a radial PSD, what surfaces are made from.
    """
    every = [scans] if isinstance(scans, Topography) else list(scans)
    measured = float(np.mean([scan.valid.mean() for scan in every]))
    if measured > 1.0 - FEW:
        return psd
    fillings = [filling(~scan.valid) for scan in every]
    found = psd
    for _ in range(ROUNDS):
        share, likeness = _shown(spectrum(found), every, fillings, level)
        found = replace(psd, C=psd.C / share)
        short = psd.reliable & (psd.q > np.sqrt(psd.band[0] * psd.band[1]))
        unlike = psd.q[short & (likeness < LIKE * measured)]
        if unlike.size:
            found = replace(found, band=(psd.band[0], min(psd.band[1], float(unlike[0]))))
    return found


def _shown(
    C: Density, scans: Sequence[Topography], fillings: Sequence[Filling], level: str
) -> tuple[Array, Array]:
    """Share of the density that filled scans show of every ring, and their coherence with it [-].

    Coherence of the waves of the filled and of the complete surface: their mean product squared,
    over the product of their mean squares.
    """
    rng = np.random.default_rng(0)  # the same surfaces for every spectrum
    sums: Any = 0.0
    for k in range(max(SURFACES, len(scans))):
        scan, filled = scans[k % len(scans)], fillings[k % len(scans)]
        complete = _levelled(replace(scan, heights=_cut(C, scan, rng)), level)
        seen = np.where(scan.valid, complete.heights, np.nan)
        shown = filled(_levelled(replace(scan, heights=seen), level).heights)
        one, other = waves_of(shown, scan), waves_of(complete.heights, scan)
        sums = sums + np.array([np.abs(one) ** 2, np.abs(other) ** 2, (one * other.conj()).real])
    shown, whole, both = (ring_sums(part, scans[0]) for part in sums)
    return shown / whole, both**2 / (shown * whole)


def _levelled(topo: Topography, level: str) -> Topography:
    return replace(topo, heights=topo.heights - form(topo, level))


def _cut(C: Density, scan: Topography, rng: np.random.Generator) -> Array:
    """Normally distributed heights of the size of a scan, cut from a surface twice as long [m]."""
    times = 1 if scan.periodic else 2
    shape, size = (times * scan.shape[0], times * scan.shape[1]), times * scan.size
    q = wave_numbers(shape, size)
    amplitude = np.sqrt(C(q) * 4.0 * np.pi**2 * (shape[0] * shape[1]) / np.prod(size))
    noise = scipy.fft.rfft2(rng.standard_normal(shape))
    heights = scipy.fft.irfft2(noise * amplitude, s=shape)
    return np.asarray(heights[: scan.shape[0], : scan.shape[1]])
