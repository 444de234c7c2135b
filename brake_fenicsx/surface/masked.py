"""Spectrum of a surface of which a scan shows only a part.

Missing points are filled harmonically, and the filled surface is smoother than the measured one: by
how much at every wave number depends on the sizes of the holes. Random surfaces of the spectrum
that is sought lose the same points and are levelled, filled and transformed like the scan; what
they lose on average is what the scan has lost (indirect inference).

Reference: C. Gourieroux, A. Monfort, E. Renault, J. Appl. Econometrics 8 (1993) S85,
doi:10.1002/jae.3950080507.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import scipy.fft

from brake_fenicsx.surface.psd import Density, RadialPsd, radial_psd, wave_numbers
from brake_fenicsx.surface.topography import Array, Scans, Topography, form

SURFACES = 16  # of all scans together
ROUNDS = 2
FEW = 0.01  # share of missing points that changes no ring by more


def without_holes(
    psd: RadialPsd, scans: Scans, level: str, spectrum: Callable[[RadialPsd], Density]
) -> RadialPsd:
    """The radial PSD that scans would have without missing points, on average.

    Args:
        psd: that of the filled scans.
        scans: levelled scan, or several.
        level: form that was removed from them.
        spectrum: of a radial PSD, what surfaces are made from.
    """
    every = [scans] if isinstance(scans, Topography) else list(scans)
    if np.mean([scan.valid.mean() for scan in every]) > 1.0 - FEW:
        return psd
    found = psd
    for _ in range(ROUNDS):
        found = replace(psd, C=psd.C / _shown(spectrum(found), every, level))
    return found


def _shown(C: Density, scans: Sequence[Topography], level: str) -> Array:
    """Share of the density that filled scans show of every ring [-], shape (n,)."""
    rng = np.random.default_rng(0)  # the same surfaces for every spectrum
    whole, filled = [], []
    for k in range(max(SURFACES, len(scans))):
        scan = scans[k % len(scans)]
        complete = _levelled(replace(scan, heights=_cut(C, scan, rng)), level)
        whole.append(complete)
        seen = replace(scan, heights=np.where(scan.valid, complete.heights, np.nan))
        filled.append(_levelled(seen, level))
    return np.asarray(radial_psd(filled).C / radial_psd(whole).C)


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
