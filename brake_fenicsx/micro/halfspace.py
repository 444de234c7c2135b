"""Elastic half-space on a grid of pixels: normal displacement of normal pressure, by FFT.

All of it is in units of the composite modulus: pressures are p / E*, so displacements come in
metres. The contact is frictionless, strains are small, the plane is rigid.

- ``"free"``: nothing outside the patch is loaded. Each pixel carries a uniform pressure; the
  displacement at the pixel centres is Love's. The convolution is done on a grid of twice the
  length, so it is exact.
- ``"periodic"``: the patch repeats itself. In Fourier space u = 2 p / |q|; the mean displacement is
  not defined and set to zero, so displacements and separations are taken from the mean plane of the
  deformed surface.

References: A. E. H. Love, Phil. Trans. R. Soc. A 228 (1929) 377, doi:10.1098/rsta.1929.0009;
K. L. Johnson, Contact Mechanics (1985), Eq. 3.25; H. M. Stanley, T. Kato, J. Tribology 119 (1997)
481, doi:10.1115/1.2833523.
"""

from __future__ import annotations

import functools
from typing import Protocol

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from brake_fenicsx.errors import SceneError

try:
    import pyfftw
except ImportError:  # the extra [micro] is not installed: SciPy's transforms, somewhat slower
    pyfftw = None

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]

BOUNDARIES = ("free", "periodic")


class Transform(Protocol):
    """A real convolution on a zero-padded grid."""

    def convolve(self, p: Array, symbol: Array) -> Array:
        """Inverse transform of ``symbol`` times the transform of p, cut to the shape of p."""


class _Scipy:
    """Zero-padded convolution with ``scipy.fft``."""

    def __init__(self, shape: tuple[int, int], padded: tuple[int, int]):
        self.shape, self.padded = shape, padded

    def convolve(self, p: Array, symbol: Array) -> Array:
        """See ``Transform``."""
        nx, ny = self.shape
        rows = scipy.fft.rfft(p, self.padded[1], axis=1)
        waves = scipy.fft.fft(rows, self.padded[0], axis=0)
        waves *= symbol
        rows = scipy.fft.ifft(waves, axis=0, overwrite_x=True)[:nx]
        return np.asarray(scipy.fft.irfft(rows, self.padded[1], axis=1)[:, :ny])


class _Fftw:
    """Zero-padded convolution with FFTW: rows known to be zero are not transformed.

    Plans are estimated, not measured: a measured plan takes 0.25 s and saves 0.1 ms a product.
    """

    def __init__(self, shape: tuple[int, int], padded: tuple[int, int]):
        nx, ny = shape
        self.nx, self.ny = nx, ny
        self.real = pyfftw.zeros_aligned((nx, padded[1]), "float64")
        self.back = pyfftw.zeros_aligned((nx, padded[1]), "float64")
        self.waves = pyfftw.zeros_aligned((padded[0], padded[1] // 2 + 1), "complex128")
        plan = functools.partial(pyfftw.FFTW, flags=("FFTW_ESTIMATE",), threads=1)
        self.rows = plan(self.real, self.waves[:nx], axes=(1,))
        self.columns = plan(self.waves, self.waves, axes=(0,))
        inverse = functools.partial(plan, direction="FFTW_BACKWARD")
        self.columns_back = inverse(self.waves, self.waves, axes=(0,))
        self.rows_back = inverse(self.waves[:nx], self.back, axes=(1,))
        self.scale = 1.0 / (padded[0] * padded[1])

    def convolve(self, p: Array, symbol: Array) -> Array:
        """See ``Transform``."""
        self.real[:, : self.ny] = p
        self.rows.execute()
        self.waves[self.nx :] = 0.0
        self.columns.execute()
        np.multiply(self.waves, symbol, out=self.waves)
        self.columns_back.execute()
        self.rows_back.execute()
        return np.asarray(self.back[:, : self.ny] * self.scale)


def _transform(shape: tuple[int, int], padded: tuple[int, int]) -> Transform:
    """The fastest transform at hand."""
    return _Scipy(shape, padded) if pyfftw is None else _Fftw(shape, padded)


class HalfSpace:
    """Displacement of pressure on a grid, and an approximate inverse of it.

    Products share work arrays: one thread at a time.

    Attributes:
        shape: pixels (nx, ny).
        pixel: lengths of a pixel [m], shape (2,).
        boundary: ``"free"`` or ``"periodic"``.
        diagonal: displacement of a pixel's centre under its own unit pressure p / E* [m].
        largest: bound on the largest eigenvalue of the influence [m].
        products: number of products done so far.
    """

    def __init__(self, shape: tuple[int, int], pixel: Array, boundary: str = "free"):
        if boundary not in BOUNDARIES:
            raise SceneError(f"boundary = {boundary!r}; choose one of {', '.join(BOUNDARIES)}")
        self.shape, self.pixel, self.boundary = shape, np.asarray(pixel, dtype=float), boundary
        if boundary == "free":
            padded = (_fast(2 * shape[0] - 1), _fast(2 * shape[1] - 1))
            kernel = _free_kernel(padded, self.pixel)
            self.symbol = scipy.fft.rfft2(kernel).real.copy()
        else:
            padded = shape
            q = _wave_numbers(shape, self.pixel)
            q[0, 0] = np.inf
            self.symbol = 2.0 / q
            kernel = scipy.fft.irfft2(self.symbol, s=shape)
        self.diagonal = float(kernel[0, 0])
        self._transform = _transform(shape, padded)
        self._small = self._transform if padded == shape else _transform(shape, shape)
        self._inverse = self._inverse_symbol()
        self._unfold(kernel)
        self.largest = float(np.abs(self.symbol).max())
        self.products = 0

    def apply(self, p: Array) -> Array:
        """Displacement [m] of the pressure p / E* [-], both of the grid's shape."""
        self.products += 1
        return self._transform.convolve(p, self.symbol)

    def precondition(self, r: Array) -> Array:
        """Pressure whose displacement is about r [m]: |q| r / 2 on the periodic grid."""
        return self._small.convolve(r, self._inverse)

    def full_contact(self, h: Array) -> Array:
        """Pressure of zero mean that makes the periodic heights h [m] flat."""
        q = _wave_numbers(self.shape, self.pixel)
        return self._small.convolve(h, 0.5 * q)

    @functools.cached_property
    def uniform_stiffness(self) -> float:
        """Sum of the uniform pressure that displaces every pixel by one metre or more [1/m]."""
        u = self._transform.convolve(np.ones(self.shape), self.symbol)
        return float(u.size / u.min())

    def block(self, rows: Index, columns: Index) -> Array:
        """Dense influence of the pixels ``columns`` on the pixels ``rows`` (flat indices) [m]."""
        a, b = self._address(rows), self._address(columns)
        return np.asarray(self._flat.take(np.subtract.outer(a, b) + self._centre))

    def _inverse_symbol(self) -> Array:
        """Symbol of the preconditioner on the grid without padding."""
        inverse = 0.5 * _wave_numbers(self.shape, self.pixel)
        # The mean: a patch under uniform pressure sinks by about 0.95 of its length.
        inverse[0, 0] = 1.0 / float(np.sqrt(np.prod(self.pixel * self.shape)))
        return inverse

    def _unfold(self, kernel: Array) -> None:
        """Kernel over offsets -(n-1)..n-1, flat: one subtraction finds an entry of the matrix."""
        nx, ny = self.shape
        i, j = np.arange(1 - nx, nx), np.arange(1 - ny, ny)
        self._flat = kernel[np.ix_(i % kernel.shape[0], j % kernel.shape[1])].ravel()
        self._centre = (nx - 1) * (2 * ny - 1) + ny - 1

    def _address(self, points: Index) -> Index:
        """Flat index of pixels in the table of offsets."""
        i, j = np.divmod(points, self.shape[1])
        return np.asarray(i * (2 * self.shape[1] - 1) + j)


@functools.lru_cache(maxsize=4)
def half_space(
    shape: tuple[int, int], pixel: tuple[float, float], boundary: str = "free"
) -> HalfSpace:
    """Half-space of this grid; made once and kept, since a library uses it hundreds of times."""
    return HalfSpace(shape, np.array(pixel), boundary)


def love(x: Array, y: Array, a: float, b: float) -> Array:
    """Displacement [m] at (x, y) of unit p / E* on the rectangle |x| < a/2, |y| < b/2.

    Args:
        x: coordinate [m].
        y: coordinate [m].
        a: side along x [m].
        b: side along y [m].
    """
    xs, ys = (x - a / 2, x + a / 2), (y - b / 2, y + b / 2)
    total = _corner(xs[1], ys[1]) - _corner(xs[1], ys[0]) - _corner(xs[0], ys[1])
    return np.asarray((total + _corner(xs[0], ys[0])) / np.pi)


def _corner(x: Array, y: Array) -> Array:
    """Integral of 1/r over the rectangle from the origin to (x, y)."""
    ax, ay = np.abs(x), np.abs(y)
    tiny = np.finfo(float).tiny
    t = np.arcsinh(ay / np.maximum(ax, tiny)) * ax + np.arcsinh(ax / np.maximum(ay, tiny)) * ay
    return np.asarray(np.where((ax == 0) | (ay == 0), 0.0, np.sign(x) * np.sign(y) * t))


def _free_kernel(padded: tuple[int, int], pixel: Array) -> Array:
    """Love's displacement [m] at all offsets of the padded grid, wrapped around."""
    i, j = (np.minimum(np.arange(n), n - np.arange(n)) for n in padded)
    return love(i[:, None] * pixel[0], j[None, :] * pixel[1], pixel[0], pixel[1])


def _wave_numbers(shape: tuple[int, int], pixel: Array) -> Array:
    """Wave numbers |q| [rad/m] of ``rfft2``."""
    qx = 2.0 * np.pi * np.fft.fftfreq(shape[0], pixel[0])
    qy = 2.0 * np.pi * np.fft.rfftfreq(shape[1], pixel[1])
    return np.hypot(qx[:, None], qy[None, :])


def _fast(n: int) -> int:
    """Next even length that transforms fast."""
    return 2 * int(scipy.fft.next_fast_len((n + 1) // 2, real=False))
