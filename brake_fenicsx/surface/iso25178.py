"""Areal surface texture parameters by the names of ISO 25178-2, and the bearing curve.

Gradients are differences of neighbouring pixels that were both measured. There is no S-filter
beyond the pixel and no L-filter beyond the form that was removed from the scan.
"""

from __future__ import annotations

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from brake_fenicsx.surface.topography import Topography

Array = NDArray[np.float64]
DECAY = 0.2  # of the autocorrelation, for S_al and S_tr
DIRECTIONS = 180


def iso_parameters(topo: Topography) -> dict[str, float]:
    """Height, hybrid and spatial parameters of a levelled surface.

    Args:
        topo: heights about their mean plane [m].

    Returns:
        S_a, S_p, S_v, S_z, S_al [m], S_dq, S_dr, S_tr [-]; nan where the surface does not define
        one: S_al and S_tr where the autocorrelation does not fall to 0.2 inside the scan.
    """
    z = topo.heights - np.nanmean(topo.heights)
    h = z[np.isfinite(z)]
    S_al, S_tr = _decay(np.where(np.isfinite(z), z, 0.0), np.isfinite(z), topo.pixel)
    S_dq, S_dr = _gradients(z, topo.pixel)
    return {
        "S_a": float(np.mean(np.abs(h))),
        "S_p": float(h.max()),
        "S_v": float(-h.min()),
        "S_z": float(h.max() - h.min()),
        "S_dq": S_dq,
        "S_dr": S_dr,
        "S_al": S_al,
        "S_tr": S_tr,
    }


def bearing_curve(heights: Array, points: int = 201) -> tuple[Array, Array]:
    """Material ratio curve (Abbott curve) of a surface.

    Args:
        heights: heights [m], any shape; nan where missing.
        points: of the curve.

    Returns:
        Material ratios from 0 to 1 and the heights [m] above which such a share of the surface
        lies, shape (points,) each.
    """
    share: Array = np.asarray(np.linspace(0.0, 1.0, points), dtype=float)
    return share, np.asarray(np.nanquantile(heights, 1.0 - share))


def _gradients(z: Array, pixel: Array) -> tuple[float, float]:
    """Root mean square gradient, and how much larger the surface is than its projection."""
    corner = z[:-1, :-1]
    along, across = (z[1:, :-1] - corner) / pixel[0], (z[:-1, 1:] - corner) / pixel[1]
    square = along**2 + across**2
    square = square[np.isfinite(square)]
    return float(np.sqrt(np.mean(square))), float(np.mean(np.sqrt(1 + square)) - 1)


def _decay(z: Array, valid: NDArray[np.bool_], pixel: Array) -> tuple[float, float]:
    """Shortest lag at which the autocorrelation falls to 0.2, and its ratio to the longest.

    Args:
        z: heights [m], 0 where missing, shape (nx, ny).
        valid: where they were measured.
        pixel: lengths of a pixel [m], shape (2,).
    """
    half = [n // 2 for n in z.shape]
    shape = [scipy.fft.next_fast_len(n + m, real=True) for n, m in zip(z.shape, half, strict=True)]
    both = [scipy.fft.rfft2(a, shape) for a in (z, valid.astype(float))]
    product, pairs = (scipy.fft.irfft2(np.abs(a) ** 2, shape) for a in both)
    rows, columns = np.arange(-half[0], half[0] + 1), np.arange(half[1] + 1)
    lags = np.ix_(rows, columns)
    with np.errstate(divide="ignore", invalid="ignore"):
        acf = np.where(pairs[lags] > 0.5, product[lags] / pairs[lags], 0.0)
    if acf[half[0], 0] <= 0:
        return float("nan"), float("nan")
    acf = acf / acf[half[0], 0]
    angle = np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    direction = np.array([np.cos(angle), np.sin(angle)])
    # Lengths along each ray in steps of the finer pixel, up to the end of the scan's half.
    reach = np.array(half) * pixel
    with np.errstate(divide="ignore"):
        ends = np.min(reach[:, None] / np.abs(direction), axis=0)
    step = float(pixel.min())
    found = []
    for (x, y), end in zip(direction.T, ends, strict=True):
        s = step * np.arange(int(end / step * (1 + 1e-12)) + 1)
        places = np.array([half[0] + s * x / pixel[0], s * y / pixel[1]])
        along = map_coordinates(acf, places, order=1, mode="nearest")
        below = np.flatnonzero(along <= DECAY)
        if below.size == 0:
            found.append(np.inf)
            continue
        j = int(below[0])
        found.append(s[j] - step * (DECAY - along[j]) / (along[j - 1] - along[j]))
    shortest, longest = min(found), max(found)
    if not np.isfinite(shortest):
        return float("nan"), float("nan")
    return float(shortest), float(shortest / longest) if np.isfinite(longest) else float("nan")
