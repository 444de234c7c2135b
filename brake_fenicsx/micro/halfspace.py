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

import functools
from typing import Literal, Protocol

import numpy as np
import pyfftw
import scipy.fft
from scipy.linalg.blas import daxpy

from brake_fenicsx.arguments import Array, Index, Mask, one_of
from brake_fenicsx.errors import NotConverged
from brake_fenicsx.surface.psd import wave_numbers

Boundary = Literal["free", "periodic"]

MARGIN = 8  # pixels beyond a free patch in its approximate inverse: a seventh fewer iterations
LARGE = 2**19  # pixels of a grid whose transform as a whole no longer stays in a cache
BLOCK = 2**18  # bytes of columns transformed together: they stay in the second-level cache


class Product(Protocol):
    """A real convolution on a zero-padded grid."""

    def __call__(self, p: Array, out: Array) -> Array:
        """Inverse transform of the symbol times the transform of p, cut to the shape of p."""


class _Whole:
    """Convolution with FFTW on a grid that is not much longer than the patch.

    Plans are estimated, not measured: measured ones save a quarter of the time, take 0.3 s to make
    and differ from run to run, and the rounding errors of the results with them.
    """

    def __init__(self, shape: tuple[int, int], padded: tuple[int, int], symbol: Array):
        self.real = pyfftw.zeros_aligned(padded, "float64")
        self.inner = self.real[: shape[0], : shape[1]]
        self.margins = self.real[shape[0] :], self.real[:, shape[1] :]
        waves = pyfftw.zeros_aligned((padded[0], padded[1] // 2 + 1), "complex128")
        self.parts = waves.view("float64")
        plan = functools.partial(pyfftw.FFTW, axes=(0, 1), flags=("FFTW_ESTIMATE",), threads=1)
        self.forth = plan(self.real, waves)
        self.back = plan(waves, self.real, direction="FFTW_BACKWARD")
        self.symbol = _twice(symbol / self.real.size)

    def __call__(self, p: Array, out: Array) -> Array:
        for margin in self.margins:
            margin[:] = 0.0
        self.inner[:] = p
        self.forth.execute()
        self.parts *= self.symbol
        self.back.execute()
        out[:] = self.inner
        return out


class _Padded:
    """Zero-padded convolution with FFTW.

    Rows known to be zero are not transformed; columns are transformed, multiplied and transformed
    back block by block, so that the padded grid never goes through the memory as a whole. That
    pays for large grids without padding, too.
    """

    def __init__(self, shape: tuple[int, int], padded: tuple[int, int], symbol: Array):
        (nx, self.ny), columns = shape, padded[1] // 2 + 1
        self.nx = nx
        self.real = pyfftw.zeros_aligned((nx, padded[1]), "float64")
        self.result = pyfftw.zeros_aligned((nx, padded[1]), "float64")
        self.waves = pyfftw.zeros_aligned((nx, columns), "complex128")
        width = -(-columns // max(1, -(-columns * padded[0] * 16 // BLOCK)))
        self.some = pyfftw.zeros_aligned((width, padded[0]), "complex128")
        self.parts = self.some.view("float64")
        plan = functools.partial(pyfftw.FFTW, axes=(1,), flags=("FFTW_ESTIMATE",), threads=1)
        inverse = functools.partial(plan, direction="FFTW_BACKWARD")
        self.rows, self.columns = plan(self.real, self.waves), plan(self.some, self.some)
        self.columns_back = inverse(self.some, self.some)
        self.rows_back = inverse(self.waves, self.result)
        scaled = symbol.T / (padded[0] * padded[1])
        self.blocks = [
            (self.waves[:, j : j + width].T, _twice(scaled[j : j + width]))
            for j in range(0, columns, width)
        ]

    def __call__(self, p: Array, out: Array) -> Array:
        self.real[:, : self.ny] = p
        self.rows.execute()
        for block, symbol in self.blocks:
            count = len(block)
            self.some[:count, : self.nx] = block
            self.some[:, self.nx :] = 0.0
            self.columns.execute()
            self.parts[:count] *= symbol
            self.columns_back.execute()
            block[:] = self.some[:count, : self.nx]
        self.rows_back.execute()
        out[:] = self.result[:, : self.ny]
        return out


def _twice(symbol: Array) -> Array:
    """Real symbol for the real and imaginary part alike: real products are the faster ones."""
    return np.repeat(np.ascontiguousarray(symbol), 2, axis=1)


def _product(shape: tuple[int, int], padded: tuple[int, int], symbol: Array) -> Product:
    """The convolution that is faster on this grid."""
    wide = max(padded[0] / shape[0], padded[1] / shape[1]) > 1.5
    kind = _Padded if wide or padded[0] * padded[1] > LARGE else _Whole
    return kind(shape, padded, symbol)


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

    def __init__(self, shape: tuple[int, int], pixel: Array, boundary: Boundary = "free"):
        one_of("boundary", boundary, Boundary)
        self.shape, self.pixel, self.boundary = shape, np.asarray(pixel, dtype=float), boundary
        if boundary == "free":
            padded = (_fast(2 * shape[0] - 1), _fast(2 * shape[1] - 1))
            # Love's displacement at all offsets of the padded grid, wrapped around.
            i, j = (np.minimum(np.arange(n), n - np.arange(n)) for n in padded)
            kernel = love(i[:, None] * self.pixel[0], j * self.pixel[1], *self.pixel)
            symbol = scipy.fft.rfft2(kernel).real.copy()
        else:
            padded = shape
            q = wave_numbers(shape, np.multiply(self.pixel, shape))
            q[0, 0] = np.inf
            symbol = 2.0 / q
            kernel = scipy.fft.irfft2(symbol, s=shape)
        self.diagonal = float(kernel[0, 0])
        self.largest = float(np.abs(symbol).max())
        self._influence = _product(shape, padded, symbol)
        self._inverse = self._approximate_inverse()
        self._unfold(kernel)
        self._flattened: tuple[Array, Array] | None = None
        self.products = 0

    def apply(self, p: Array, out: Array | None = None) -> Array:
        """Displacement [m] of the pressure p / E* [-], both of the grid's shape; in ``out``."""
        self.products += 1
        return self._influence(p, np.empty(self.shape) if out is None else out)

    def precondition(self, r: Array, out: Array | None = None) -> Array:
        """Pressure whose displacement is about r [m]: |q| r / 2 on the periodic grid."""
        return self._inverse(r, np.empty(self.shape) if out is None else out)

    def full_contact(self, h: Array) -> Array:
        """Pressure of zero mean that makes the periodic heights h [m] flat; the last is kept."""
        if self._flattened is None or self._flattened[0] is not h:
            q = wave_numbers(self.shape, np.multiply(self.pixel, self.shape))
            self._flattened = h, scipy.fft.irfft2(scipy.fft.rfft2(h) * (0.5 * q), s=self.shape)
        return self._flattened[1]

    @functools.cached_property
    def uniform_stiffness(self) -> tuple[float, float]:
        """Uniform pressure that displaces every pixel by one metre or more.

        Its sum [1/m], and the largest displacement, less than two [m].
        """
        u = self._influence(np.ones(self.shape), np.empty(self.shape))
        return float(u.size / u.min()), float(u.max() / u.min())

    @functools.cached_property
    def punch(self) -> float:
        """Sinking of the whole free patch under a rigid flat punch, per sum of p / E* [m].

        The punch's force is F = 1.149208 E* L delta on 128 x 128 pixels of a square, so a mean
        pressure P sinks it by 0.8702 P L / E*.
        """
        full = np.ones(self.shape, dtype=bool)
        return 1.0 / float(self.unit_answer(full, self.precondition(full * 1.0), 1e-6).sum())

    def unit_answer(self, touching: Mask, x: Array, tolerance: float = 1e-2) -> Array:
        """Pressures -dp/dd [1/m] on fixed touching pixels that displace them by one.

        Their sum has the square of the error of x, so ``tolerance`` 1e-2 gives it to about 1e-4.

        Args:
            touching: touching pixels, shape (nx, ny).
            x: guess [1/m], shape (nx, ny).
            tolerance: energy norm of the error over that of x, as the preconditioner measures
                it [-].

        Raises:
            NotConverged: 200 iterations of preconditioned conjugate gradients are not enough.
        """
        mask = np.ascontiguousarray(touching, dtype=float)
        x = np.ascontiguousarray(mask * x)
        r = mask * (1.0 - self.apply(x))
        t, old = np.zeros_like(x), 1.0
        for _ in range(200):
            z = mask * self.precondition(r)
            new = float(np.vdot(z, r))
            if new <= tolerance**2 * float(x.sum()):
                return x
            t *= new / old
            t += z
            moved = mask * self.apply(t)
            step, old = new / float(np.vdot(t, moved)), new
            add_to(x, step, t)
            add_to(r, -step, moved)
        raise NotConverged("stiffness of the touching pixels: 200 iterations were not enough")

    def block(self, rows: Index, columns: Index) -> Array:
        """Dense influence of the pixels ``columns`` on the pixels ``rows`` (flat indices) [m]."""
        a, b = self._address(rows), self._address(columns)
        return np.asarray(self._flat.take(np.subtract.outer(a + self._centre, b)))

    def _approximate_inverse(self) -> Product:
        """Product with |q| / 2; a few pixels more part the opposite edges of a free patch."""
        nx, ny = self.shape
        periodic = self.boundary == "periodic"
        grid = (nx, ny) if periodic else (_fast(nx + MARGIN), _fast(ny + MARGIN))
        symbol = 0.5 * wave_numbers(grid, np.multiply(self.pixel, grid))
        # The mean: a patch under uniform pressure sinks by about 0.95 of its length.
        symbol[0, 0] = 1.0 / float(np.sqrt(np.prod(self.pixel * self.shape)))
        return _product(self.shape, grid, symbol)

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
    shape: tuple[int, int], pixel: tuple[float, float], boundary: Boundary = "free"
) -> HalfSpace:
    """Half-space of this grid; made once and kept, since a library uses it hundreds of times."""
    return HalfSpace(shape, np.array(pixel), boundary)


def half_space_of(h: Array, size: Array, boundary: Boundary) -> HalfSpace:
    """Half-space on the grid of heights, shape (nx, ny), of a patch of these lengths [m]."""
    return half_space(h.shape, (float(size[0] / h.shape[0]), float(size[1] / h.shape[1])), boundary)


def add_to(y: Array, a: float, x: Array) -> None:
    """Add a x to y in place, in one pass through the memory; both in the order of C."""
    daxpy(x.reshape(-1), y.reshape(-1), a=a)


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


def _fast(n: int) -> int:
    """Next even length that transforms fast: a power of two times an odd number below 16."""
    power = 2 ** max(1, (n - 1).bit_length() - 4)
    return power * -(-n // power)
