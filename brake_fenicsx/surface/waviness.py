"""Mean heights of the patches of a face: the part of the spectrum that is longer than a patch.

The laws hold the waves of a patch of side L, those of the wave vectors 2 pi (i, j) / L without
(0, 0). What they leave out is the height of the patch's mean plane. It is a Gaussian field whose
spectrum is that of the surface times the square of the transform of a patch,
W = sinc(q_x L / 2) sinc(q_y L / 2): heights averaged over every patch, correlated between
neighbours as the spectrum says. The sum of both variances is that of the surface, to one or two
per cent where the spectrum rolls off at waves shorter than a patch; for patches shorter than that
the sum is too low, by 15 % at half of it.

Reference: E. Vanmarcke, Random Fields (1983), chapter 5 (local averages).
"""

from dataclasses import dataclass

import numpy as np
import scipy.fft
from scipy.ndimage import map_coordinates

from brake_fenicsx.arguments import Array
from brake_fenicsx.errors import SurfaceError
from brake_fenicsx.surface.psd import half_plane_weights, wave_vectors
from brake_fenicsx.surface.spectrum import BiFractal

PER_PATCH = 4  # grid points along a patch: the averaged field has no shorter waves than a patch
MOST = 4096  # grid points along a side of the field


@dataclass(frozen=True, slots=True)
class Waviness:
    """Field of the mean heights of patches.

    Attributes:
        psd: spectrum of the surface.
        patch: side L of a patch [m].
        low: treatment of waves longer than the scan, ``"flat"`` or ``"extend"``.
    """

    psd: BiFractal
    patch: float
    low: str = "flat"

    def variance(self, length: float) -> float:
        """Variance [m^2] of the mean heights on a face of this length [m]."""
        shape, size = self._grid((length, length))
        return float((half_plane_weights(shape) * self._powers(shape, size)).sum())

    def sample(self, points: Array, rng: np.random.Generator) -> Array:
        """Mean heights of the patches about some points of one face.

        Args:
            points: coordinates in the plane of the face [m], shape (n, 2).
            rng: random numbers of the sample.

        Returns:
            Heights [m], shape (n,).

        Raises:
            SurfaceError: the face is too long for its patches.
        """
        low = points.min(axis=0)
        shape, size = self._grid(points.max(axis=0) - low)
        noise = scipy.fft.rfft2(rng.standard_normal(shape))
        amplitude = np.sqrt(self._powers(shape, size) * (shape[0] * shape[1]))
        field = scipy.fft.irfft2(noise * amplitude, s=shape)
        at = (points - low) / size * shape
        return np.asarray(map_coordinates(field, at.T, order=3, mode="grid-wrap"))

    def _grid(self, extent: tuple[float, float] | Array) -> tuple[tuple[int, int], Array]:
        """Points and lengths of a periodic field twice as long as the face."""
        step = self.patch / PER_PATCH
        least = [int(np.ceil(2.0 * e / step)) + PER_PATCH for e in extent]
        counts = [scipy.fft.next_fast_len(n, real=True) for n in least]
        if max(counts) > MOST:
            raise SurfaceError(f"""waviness: a face of {1e3 * float(max(extent)):.3g} mm has too
                many patches of {1e3 * self.patch:.3g} mm; make the patches larger""")
        return (counts[0], counts[1]), step * np.array(counts)

    def _powers(self, shape: tuple[int, int], size: Array) -> Array:
        """Variance of every wave vector of ``rfft2`` [m^2]."""
        qx, qy = wave_vectors(shape, size)
        # numpy's sinc(x) is sin(pi x) / (pi x).
        mean = np.sinc(qx * self.patch / (2.0 * np.pi)) * np.sinc(qy * self.patch / (2.0 * np.pi))
        C = self.psd.on(qx, qy, self.low)
        return np.asarray(C * mean**2 * 4.0 * np.pi**2 / np.prod(size))
