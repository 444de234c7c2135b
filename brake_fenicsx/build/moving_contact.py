"""Contact elements that lengths move along their faces: chamfer, slot, outline of a face.

The facets stay the same ones and slide over the other face, so that areas and rows follow a length
with as many derivatives as the shape functions leave: no series of matrices holds them, and they
are integrated anew for each sample. Gaps stay those of the scene.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import product

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.build.brake import Brake
from brake_fenicsx.build.interfaces import interface_elements
from brake_fenicsx.errors import SceneError
from brake_fenicsx.macro.contact_elements import Contact, join, restricted
from brake_fenicsx.macro.morphing import Moving
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.keys import key_parts

Array = NDArray[np.float64]

# Decimals of the lengths, relative to those of the scene, by which contact elements are told apart.
DIGITS = 12
# Centres of contact elements move at most this multiple of what nodes do.
FAST = 2.0


class MovingContact:
    """Contact elements of a scene at other lengths.

    Attributes:
        names: the lengths that move them.
    """

    def __init__(self, scene: Scene, brake: Brake, shapes: Mapping[tuple[str, ...], object]):
        """Ask which lengths move which interfaces.

        Args:
            scene: the scene.
            brake: its operators.
            shapes: what lengths do, by their dotted keys.

        Raises:
            SceneError: an interface that may not move.
        """
        self._scene, self._brake = scene, brake
        self._interfaces: set[str] = set()
        # Length in the scene, and movement of the nodes per length.
        self._moves: dict[str, tuple[float, Array]] = {}
        for names, shape in shapes.items():
            if not isinstance(shape, Moving):
                continue
            for name, usual, v, slides in zip(
                names, shape.usual, shape.v, shape.slides, strict=True
            ):
                interfaces = {key_parts(key)[1] for key in slides}
                if interfaces:
                    self._moves[name] = float(usual), v
                self._interfaces |= interfaces
                for interface, key in product(interfaces, ("zone", "tangential_stiffness")):
                    if getattr(scene.contact[interface], key) is not None:
                        raise SceneError(
                            f"{name}: moves the facets of contact.{interface}, which its {key}"
                            " does not follow: leave that out, or run the scene once for each value"
                        )
        self.names: list[str] = list(self._moves)
        self._latest: tuple[Array, Contact] | None = None

    def at(self, values: Mapping[str, float]) -> Contact:
        """The contact elements by the scalars that differ from the scene, SI; the latest are kept.

        Raises:
            SceneError: facets come into contact, or leave it.
        """
        share = [values.get(n, own) / own - 1 for n, (own, _) in self._moves.items()]
        mark = np.round(share, DIGITS)
        if not mark.any():
            return self._brake.contact
        if self._latest is None or not np.array_equal(self._latest[0], mark):
            moves = zip(share, self._moves.values(), strict=True)
            step = sum(part * own * v for part, (own, v) in moves)
            try:
                self._latest = mark, self._integrated(np.asarray(step, float))
            except SceneError as error:
                said = (f"{n} = {values.get(n, own):.4g} m" for n, (own, _) in self._moves.items())
                raise SceneError(f"{', '.join(said)}: {error}") from None
        return self._latest[1]

    def _integrated(self, step: Array) -> Contact:
        """The elements where the nodes of the mesh have moved, shape (nodes, 3)."""
        b, every = self._brake, list[Contact]()
        x, reach = b.mesh.domain.geometry.x, FAST * float(np.linalg.norm(step, axis=1).max())
        before = x.copy()
        x += step
        try:
            for i, name in enumerate(self._scene.contact):
                there = here = restricted(b.contact, b.contact.interface == i)
                if name in self._interfaces:
                    there = interface_elements(
                        self._scene, name, b.mesh, b.elastic.free, MPI.COMM_SELF
                    )
                if len(here.w) != len(there.w) or np.any(abs(here.points - there.points) > reach):
                    raise SceneError(
                        f"facets of contact.{name} come into contact or leave it: narrow the range"
                    )
                every.append(there)
        finally:
            x[:] = before
        return replace(join(every), g0=b.g0, uncovered=b.contact.uncovered)
