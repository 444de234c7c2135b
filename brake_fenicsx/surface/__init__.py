"""Scan -> statistics -> artificial surfaces. Imports no dolfinx."""

from brake_fenicsx.surface.hdf import HeightDistribution, match_moments
from brake_fenicsx.surface.psd import RadialPsd, radial_psd
from brake_fenicsx.surface.readers import read_topography
from brake_fenicsx.surface.record import SurfaceStatistics
from brake_fenicsx.surface.spectrum import BiFractal, fit_bifractal
from brake_fenicsx.surface.statistics import averaged, characterise, given_statistics
from brake_fenicsx.surface.synthesis import resampled, synthesise
from brake_fenicsx.surface.topography import Topography, make_topography

__all__ = [
    "BiFractal", "HeightDistribution", "RadialPsd", "SurfaceStatistics", "Topography", "averaged",
    "characterise", "fit_bifractal", "given_statistics", "make_topography", "match_moments",
    "radial_psd", "read_topography", "resampled", "synthesise",
]  # fmt: skip
