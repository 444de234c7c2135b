"""Statistics of scans as a record, and what makes them unlike those of the surface."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from brake_fenicsx.arguments import Array
from brake_fenicsx.errors import SurfaceError, lines
from brake_fenicsx.surface.hdf import HeightDistribution
from brake_fenicsx.surface.psd import RadialPsd
from brake_fenicsx.surface.spectrum import BiFractal, variance_on
from brake_fenicsx.surface.topography import Topography

MANY_OUTLIERS = 0.05  # share of the points
NOISE = -1.0  # white noise has a slope of 0; a steeper spectrum is that of a rough surface
MISSED = 2.0  # times the measured variance of an octave
FORM = 0.5  # share of the variance in a second-order form
DIRECTED = 0.5  # anisotropy; (r - 1) / (r + 1) of a surface stretched by r: three times as long
OTHER = 0.15  # relative difference of S_q of artificial surfaces and scan


@dataclass(frozen=True, slots=True)
class SurfaceStatistics:
    """Statistics of scans, or given by numbers alone (then without heights and PSD).

    Attributes:
        mean: mean height over the instrument's zero [m].
        median: median height over the instrument's zero [m].
        S_q: root-mean-square height about the mean plane [m].
        S_sk: skewness [-].
        S_ku: kurtosis, 3 for a normal distribution [-].
        errors: standard errors of (mean, S_q, S_sk, S_ku), from blocks of the scan, or from the
            scatter of several scans; nan if given.
        hdf: distribution new heights are drawn from, zero mean.
        bifractal: broken power law of the PSD.
        spectrum: what artificial surfaces are made from: that, or the measured one.
        psd: radial PSD of the scan, or the mean of several.
        anisotropy: second angular harmonic of the variance, 0 for an isotropic surface [-].
        direction: angle of the strongest waves from the x axis [rad].
        topography: levelled heights, zero mean, outliers and missing points nan; None for several
            scans, each of which has its own.
        level: form that was removed.
        missing: points without a height in the scans.
        lost: where they are (``topography.where_missing``); where the deepest are missing, heights
            and spectrum of artificial surfaces are those of the scan with its holes filled.
        outliers: points masked by the outlier rule.
        curvature: share of the variance in a second-order form, largest of the scans [-].
        doubts: what is implausible about the scans as they were read.
        scans: statistics of each scan, where several are averaged.
    """

    mean: float
    median: float
    S_q: float
    S_sk: float
    S_ku: float
    errors: tuple[float, float, float, float]
    hdf: HeightDistribution
    bifractal: BiFractal
    spectrum: BiFractal
    psd: RadialPsd | None = None
    anisotropy: float = np.nan
    direction: float = np.nan
    topography: Topography | None = None
    level: str = "none"
    missing: int = 0
    lost: str = "anywhere"
    outliers: int = 0
    curvature: float = 0.0
    doubts: tuple[str, ...] = ()
    scans: "tuple[SurfaceStatistics, ...]" = ()

    @property
    def each(self) -> "tuple[SurfaceStatistics, ...]":
        """Statistics of each scan, also of a single one; none where numbers were given."""
        return self.scans or ((self,) if self.topography is not None else ())

    @property
    def topographies(self) -> tuple[Topography, ...]:
        """Levelled heights of each scan, on one grid; none where numbers were given."""
        return tuple(s.topography for s in self.each if s.topography is not None)

    @property
    def told(self) -> str:
        """Heights and spectrum in a line."""
        fit = self.bifractal
        return (
            f"S_q {1e6 * self.S_q:.2f} um, S_sk {self.S_sk:.3f}, S_ku {self.S_ku:.3f}; power"
            f" spectrum: slopes {fit.c1:.2f} and {fit.c2:.2f}, which meet at q_c ="
            f" {fit.q_c / 1e3:.1f} 1/mm"
        )

    @property
    def pixel(self) -> float:
        """Half of the shortest wave length of the reliable band [m], which the scan resolves."""
        return float(np.pi / self.bifractal.band[1])

    @property
    def variance_ratio(self) -> float:
        """S_q of artificial surfaces with the sides and pixels of the scan over that of it [-]."""
        if not self.topographies:
            return 1.0
        return float(np.sqrt(variance_on(self.spectrum, self.topographies[0])) / self.S_q)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is doubtful about the statistics, one line each with its remedy."""
        lines = [line for one in self.each for line in (*one.doubts, *_lost(one))]
        return (*lines, *_spectrum(self), *_form(self))

    @property
    def heights(self) -> Array:
        """Levelled valid heights of all scans about their mean planes [m], shape (n,)."""
        if not self.topographies:
            raise SurfaceError("these statistics were given by numbers; there is no scan in them")
        return np.concatenate([t.heights[t.valid] for t in self.topographies])

    def pixels_above(self, height: float, S_q: float) -> int:
        """How many pixels of the scans carry an artificial surface where it is pressed this far.

        Args:
            height: separation of the plane from the mean of the artificial surface [m].
            S_q: root-mean-square height of the artificial surfaces [m].
        """
        return int(np.count_nonzero(self.heights * S_q > height * self.hdf.S_q))


@lines
def _lost(stats: SurfaceStatistics) -> Iterator[str]:
    """Points that are missing by a rule, and too many outliers."""
    topo = stats.topography
    if topo is None:
        return
    share = stats.missing / topo.heights.size
    if stats.lost == "deepest":
        yield f"""{topo.source}: the deepest {share:.0%} of the surface are missing: how deep they
            are is not known; laws take them for as deep as the rims of the holes, and S_q, S_sk and
            S_ku are those of the rest"""
    if stats.lost == "highest":
        yield f"""{topo.source}: the highest {share:.0%} of the surface are missing, which carry the
            load: no law can be told from this scan; measure it with less light"""
    if (marked := stats.outliers / topo.heights.size) > MANY_OUTLIERS:
        yield f"""{topo.source}: {marked:.0%} of the points are spikes and were masked: no usual
            measurement; measure again"""


@lines
def _spectrum(stats: SurfaceStatistics) -> Iterator[str]:
    """Noise, and a spectrum that is not that of the scan."""
    fit, fitted = stats.bifractal, stats.spectrum.misfit is None
    if fit.convex:
        cut = f'surface.cutoff = "{2e6 * np.pi / fit.q_c:.3g} um"'
        why = f"this is usually instrument noise; set {cut}"
        if fit.c2 < NOISE:
            why = f"if this is instrument noise, set {cut}" + (
                '; if not, surface.spectrum = "measured"' if fitted else ""
            )
        yield f"""the PSD flattens above {fit.q_c / 1e3:.3g} 1/mm (slope {fit.c2:.2f} after
            {fit.c1:.2f}){", which the bi-fractal model cannot represent" * fitted}: {why}"""
    wave, ratio = worst_octave(stats.psd, fit) if stats.psd and fitted else (np.nan, 1.0)
    if not 1 / MISSED < ratio < MISSED:
        more, times = ("more", ratio) if ratio > 1 else ("less", 1 / ratio)
        yield f"""the bi-fractal fit misses the spectrum: about a wavelength of {1e6 * wave:.3g} um
            artificial surfaces have {times:.1f} times {more} variance than the scan; use
            surface.spectrum = "measured" """
    elif abs((times := stats.variance_ratio) - 1.0) > OTHER:
        cause = "waves longer than the scan, or heights that differ from place to place; scan more"
        if fitted:
            cause = 'the bi-fractal fit; use surface.spectrum = "measured"'
        elif any(one.lost != "anywhere" for one in stats.each):
            cause = "the missing points"
        yield f"artificial surfaces as large as the scan have {times:.2f} times its S_q: {cause}"


@lines
def _form(stats: SurfaceStatistics) -> Iterator[str]:
    """A direction that isotropic surfaces lack, and a bow or bend that was not removed."""
    if stats.anisotropy > DIRECTED and stats.spectrum.lay is None:
        grooves = np.degrees(stats.direction) % 180.0 - 90.0
        yield f"""the scan has a direction: grooves at {grooves:.0f} deg from its x axis, anisotropy
            {stats.anisotropy:.2f}; the artificial surfaces have none: write surface.spectrum =
            "directional" """
    if stats.level != "second-order" and stats.curvature > FORM:
        yield f"""level = {stats.level!r} leaves a bow or bend with {stats.curvature:.0%} of the
            variance of the scan, which is form and not roughness: remove it with surface.level =
            "second-order" """


def worst_octave(psd: RadialPsd, fit: BiFractal) -> tuple[float, float]:
    """Where a fit is worst: wavelength [m] at the middle of the octave, and variance over measured.

    Args:
        psd: measured spectrum.
        fit: of it.
    """
    q, C = psd.q[psd.reliable], psd.C[psd.reliable]
    octave = np.floor(np.log2(q / q[0])).astype(int)
    many = np.bincount(octave) > 0
    own, other = (np.bincount(octave, q * density)[many] for density in (C, fit(q)))
    worst = int(np.argmax(np.abs(np.log(other / own))))
    middle = q[0] * 2.0 ** (np.flatnonzero(many)[worst] + 0.5)
    return float(2.0 * np.pi / middle), float(other[worst] / own[worst])
