"""Areal surface texture parameters by the names of ISO 25178-2, and the bearing curve.

Gradients are differences of neighbouring pixels that were both measured. There is no S-filter
beyond the pixel and no L-filter beyond the form that was removed from the scan. S_k and its
relatives are those of ISO 13565-2, from the secant of the bearing curve. Surfalize 0.19.2 agrees in
S_al and S_tr to 0.1 % at the same cost, and refuses a surface with missing points.
"""

import numpy as np
import scipy.fft
from scipy.ndimage import map_coordinates

from brake_fenicsx.arguments import Array, Mask
from brake_fenicsx.surface.topography import Topography

DECAY = 0.2  # of the autocorrelation, for S_al and S_tr
DIRECTIONS = 180
CORE = 0.4  # share of the bearing curve below the secant that defines the core


def iso_parameters(topo: Topography) -> dict[str, float]:
    """Height, hybrid, spatial and functional parameters of a levelled surface.

    Args:
        topo: heights about their mean plane [m].

    Returns:
        S_a, S_p, S_v, S_z, S_al [m], S_dq, S_dr, S_tr [-], and those of ``core_parameters``; S_al
        and S_tr of a flat surface are nan. ``S_tr_open`` is the share of the directions in which
        the autocorrelation does not fall to 0.2 within half of the scan, as along grooves: where it
        is above zero S_tr is the largest value possible, with the length of the scan's half there,
        and S_al is the shortest of the lengths that are known.
    """
    z = topo.heights - np.nanmean(topo.heights)
    h = z[np.isfinite(z)]
    S_al, S_tr, S_tr_open = _decay(np.where(np.isfinite(z), z, 0.0), np.isfinite(z), topo.pixel)
    S_dq, S_dr = gradients(z, topo.pixel)
    return {
        "S_a": float(np.mean(np.abs(h))),
        "S_p": float(h.max()),
        "S_v": float(-h.min()),
        "S_z": float(h.max() - h.min()),
        "S_dq": S_dq,
        "S_dr": S_dr,
        "S_al": S_al,
        "S_tr": S_tr,
        "S_tr_open": S_tr_open,
        **core_parameters(h),
    }


def core_parameters(heights: Array) -> dict[str, float]:
    """Core, peaks and valleys of the bearing curve, by ISO 13565-2 and ISO 25178-2.

    The core is where the secant over 40 % of the curve is least steep, the uppermost such place
    where there are several. The line that fits the curve there in the mean square has the heights
    of the core's ends at the ratios 0 and 1. Peaks above and valleys below are replaced by
    triangles of their area.

    Args:
        heights: heights [m], any shape; nan where missing.

    Returns:
        S_k, S_pk, S_vk [m] and the material ratios S_mr1, S_mr2 [-] at the upper and the lower end
        of the core.
    """
    z = np.sort(heights[np.isfinite(heights)])[::-1]
    n = z.size
    span = min(max(round(CORE * n), 1), n - 1)
    drop = z[: n - span] - z[span:]
    # Sums of rounded heights differ in their last digits where the curve is straight.
    least = float(drop.min()) + 1e-12 * float(z[0] - z[-1])
    start = int(np.argmax(drop <= least))
    core = z[start : start + span + 1]
    ratio = (np.arange(start, start + span + 1) + 0.5) / n
    centred = ratio - ratio.mean()
    slope = float(centred @ core / (centred @ centred))
    upper = float(core.mean() - slope * ratio.mean())
    lower = upper + slope
    # Within rounding of the line a height is of the core.
    room = 1e-9 * float(z[0] - z[-1])
    peaks, valleys = z[z > upper + room] - upper, lower - z[z < lower - room]
    return {
        "S_k": upper - lower,
        "S_pk": 2.0 * float(peaks.mean()) if peaks.size else 0.0,
        "S_vk": 2.0 * float(valleys.mean()) if valleys.size else 0.0,
        "S_mr1": peaks.size / n,
        "S_mr2": 1.0 - valleys.size / n,
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


def gradients(z: Array, pixel: Array) -> tuple[float, float]:
    """Root mean square gradient, and how much larger the surface is than its projection."""
    corner = z[:-1, :-1]
    along, across = (z[1:, :-1] - corner) / pixel[0], (z[:-1, 1:] - corner) / pixel[1]
    square = along**2 + across**2
    square = square[np.isfinite(square)]
    return float(np.sqrt(np.mean(square))), float(np.mean(np.sqrt(1 + square)) - 1)


def _decay(z: Array, valid: Mask, pixel: Array) -> tuple[float, float, float]:
    """Shortest lag at which the autocorrelation falls to 0.2, its ratio to the longest, open rays.

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
        return float("nan"), float("nan"), 0.0
    acf = acf / acf[half[0], 0]
    angle = np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    direction = np.array([np.cos(angle), np.sin(angle)])
    # Lengths along each ray in steps of the finer pixel, up to the end of the scan's half.
    step = float(pixel.min())
    with np.errstate(divide="ignore"):
        ends = np.min((np.array(half) * pixel)[:, None] / np.abs(direction), axis=0)
    s = step * np.arange(int(ends.max() / step * (1 + 1e-12)) + 1)
    x, y = direction[:, :, None] * s / pixel[:, None, None]
    along = map_coordinates(acf, [half[0] + x, y], order=1, mode="nearest")
    along[s > ends[:, None] * (1 + 1e-12)] = np.inf
    j = np.argmax(along <= DECAY, axis=1)
    ray = np.arange(DIRECTIONS)
    with np.errstate(divide="ignore", invalid="ignore"):  # rays without a fall: not used below
        part = (DECAY - along[ray, j]) / (along[ray, np.maximum(j - 1, 0)] - along[ray, j])
    lag = np.where(j > 0, s[j] - step * part, ends)
    # Heights without their mean fall in some direction; the other case is a safeguard.
    shortest = lag[j > 0].min() if j.any() else ends.max()
    return float(shortest), float(shortest / lag.max()), float(np.mean(j == 0))
