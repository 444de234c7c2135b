"""Modes of a body as functions of the constants of one of its materials.

The stiffness is linear in the C_ij of the material. Modes at some constants span a basis on which
those at other constants are computed (Rayleigh-Ritz); the basis takes in further modes until
frequencies at the wanted constants agree with those at full order.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from brake_fenicsx.build.changes import VOIGT, moved_entries, unit_change
from brake_fenicsx.build.material_table import constants, stiffness, varied_stiffness
from brake_fenicsx.errors import InaccurateResult, SceneError
from brake_fenicsx.folder.log import logger
from brake_fenicsx.macro.elasticity import affine_parts
from brake_fenicsx.scene import Scene
from brake_fenicsx.stability.eigensolvers.symmetric import count_below

from .part_modes import elastic_modes, part_body

Array = NDArray[np.float64]
# Directions of the basis smaller than this share of the largest are left out.
SMALL = 1e-6
# Step of the difference of C_ij by the logarithm of a constant; exact where they are linear.
STEP = 1e-4


@dataclass(frozen=True, slots=True)
class BodyModes:
    """Modes at some constants.

    Attributes:
        frequency: ascending, shape (modes,) [Hz].
        slope: of its logarithm by that of each constant, shape (modes, constants).
        share: part of the strain energy of each that is in the material, shape (modes,).
    """

    frequency: Array
    slope: Array
    share: Array


class VariedBody:
    """A body and the logarithms of the constants of one of its materials.

    Attributes:
        names: of the constants.
        nominal: logarithms of the scene's values.
        highest: end of the frequencies [Hz].
    """

    def __init__(self, scene: Scene, part: str, material: str, highest: float, supported: bool):
        """Assemble the body; see ``part_modes``."""
        self._table, self.highest = scene.materials[material], highest
        self._where = f"{scene.file}: materials.{material}"
        usual, given = constants(self._table), self._table.C11 is not None
        known = [name for name in usual if (name[0] == "C") == given]
        # Of what is zero there is no logarithm: it stays.
        self.names = [name for name in known if usual[name] > 0]
        if held := [name for name in known if name not in self.names]:
            logger.warning("%s: %s stay as they are: not above zero", self._where, ", ".join(held))
        self.nominal = np.log([usual[name] for name in self.names])
        mesh, elastic = part_body(scene, part, np.zeros((1, 3)), supported)
        self._K, self._M = elastic.K, elastic.M
        entries = moved_entries(scene, material, self.names)
        self._index = tuple(np.array([VOIGT[entry] for entry in entries]).T)
        directions = [unit_change(scene, mesh, material, entry) for entry in entries]
        if not all(directions):
            raise SceneError(f"{self._where}: of no layer of parts.{part}; name another --material")
        self._A = affine_parts(mesh, elastic.free, directions)
        self._C = stiffness(self._table)[self._index]
        self._count, self._W = 0, np.zeros((elastic.M.shape[0], 0))

    def count(self) -> int:
        """Modes below the highest frequency at the scene's constants, rigid-body modes included."""
        return count_below(self._K, self._M, (2 * np.pi * self.highest) ** 2)[0]

    def _entries(self, theta: Array) -> Array:
        """The C_ij that change, at logarithms of the constants."""
        values = dict(zip(self.names, np.exp(theta), strict=True))
        try:
            C = varied_stiffness(self._table, values)
        except SceneError as error:  # as of nu beyond 0.5
            raise InaccurateResult(f"{self._where}: {error}") from None
        if not la.eigvalsh(C)[0] > 0:
            raise InaccurateResult(f"{self._where}: constants are not positive definite")
        return np.asarray(C[self._index])

    def take_in(self, theta: Array) -> Array:
        """Take the modes at some constants into the basis.

        Returns:
            Their frequencies at full order [Hz].
        """
        change = self._entries(theta) - self._C
        K = self._K + sum(c * A for c, A in zip(change, self._A, strict=True))
        frequency, shapes, _ = elastic_modes(self._where, K.tocsr(), self._M, self.highest)
        if not frequency.size:
            return frequency
        self._count = max(self._count, frequency.size)
        S = np.column_stack([self._W, shapes])
        values, turn = la.eigh(S.T @ (self._M @ S))
        kept = values > SMALL**2 * values[-1]
        self._W = S @ (turn[:, kept] / np.sqrt(values[kept]))
        self._modal_K = self._W.T @ (self._K @ self._W)
        self._modal_A = np.array([self._W.T @ (A @ self._W) for A in self._A])
        return frequency

    def modes(self, theta: Array) -> BodyModes:
        """As many modes as were ever taken in, at some constants, on the basis.

        Raises:
            InaccurateResult: no material has these constants.
        """
        C = self._entries(theta)
        K = self._modal_K + np.tensordot(C - self._C, self._modal_A, 1)
        kappa, phi = la.eigh(K, subset_by_index=(0, self._count - 1))
        energy = np.einsum("im,jik,km->mj", phi, self._modal_A, phi, optimize=True)
        energy = energy / kappa[:, None]
        step = STEP * np.eye(theta.size)
        slope = [(self._entries(theta + s) - self._entries(theta - s)) / (2 * STEP) for s in step]
        return BodyModes(
            np.sqrt(kappa) / (2 * np.pi), 0.5 * energy @ np.array(slope).T, energy @ C
        )  # fmt: skip
