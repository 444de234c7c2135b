"""Stiffness and mass of a layer over its thickness.

Stretched by s along z, a body has derivatives along z that are 1/s of what they were, and s times
its volume. Strains are linear in derivatives, so that with any quadrature, to round-off,

    K(s) = s A + B + D / s,      M(s) = s M(1).

What lies on a stretched layer is shifted along z, which changes neither.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import scipy.sparse as sp
import ufl

from brake_fenicsx import compat
from brake_fenicsx.errors import SceneError

from .elasticity import face_tag, measured_area
from .mesh import Mesh

# A power of the stretch whose matrix is less than this share of the others is round-off.
ROUND_OFF = 1e-12


@contextmanager
def stretched(mesh: Mesh, factor: float) -> Iterator[None]:
    """The whole mesh stretched along z, and back again."""
    x = mesh.domain.geometry.x
    z = x[:, 2].copy()
    x[:, 2] = factor * z
    try:
        yield
    finally:
        x[:, 2] = z


def powers_of_stretch(
    mesh: Mesh, assemble: Callable[[], sp.csr_matrix]
) -> dict[int, sp.csr_matrix]:
    """The matrices A, B and D of the stiffness of a stretched body.

    Args:
        mesh: the tagged mesh.
        assemble: assembles the stiffness on the mesh as it is then, with one pattern always.

    Returns:
        Power of the stretch (1, 0, -1) -> matrix [N/m]; those that are zero are left out.
    """
    K = []
    for factor in (1.0, 2.0, 0.5):
        with stretched(mesh, factor):
            K.append(assemble())
    longer, shorter = K[1] - K[0], K[2] - K[0]
    D = (4 / 3) * (0.5 * longer + shorter)
    A = longer + 0.5 * D
    found = {1: A, 0: K[0] - A - D, -1: D}
    size = max(abs(matrix).max() for matrix in found.values())
    return {
        power: matrix.tocsr()
        for power, matrix in found.items()
        if abs(matrix).max() > ROUND_OFF * size
    }


def check_flat(mesh: Mesh, layer: str, faces: dict[str, str]) -> None:
    """Refuse a layer with faces that grow with its thickness.

    Args:
        mesh: the tagged mesh.
        layer: "part.layer".
        faces: key of the scene that depends on the area or the shape of a face -> the face.

    Raises:
        SceneError: the key and the face.
    """
    domain = mesh.domain
    domain.topology.create_connectivity(3, 2)
    facets_of = domain.topology.connectivity(3, 2)
    cells = mesh.cell_tags.find(mesh.layers[layer])
    around = np.unique(np.concatenate([facets_of.links(cell) for cell in cells]))
    for key, face in faces.items():
        own = np.intersect1d(mesh.facet_tags.find(face_tag(mesh, face, key)), around)
        tags = compat.meshtags(domain, 2, own.astype(np.int32), 1)
        ds = ufl.Measure("ds", domain=domain, subdomain_data=tags)(1)
        area = measured_area(mesh, ds)
        with stretched(mesh, 2.0):
            grown = measured_area(mesh, ds) - area
        if grown > ROUND_OFF * area:
            raise SceneError(
                f"{key}: the face {face} lies on the sides of the layer {layer}, whose thickness is"
                " random or swept; only flat faces across z may carry anything then: run the scene"
                " once for each thickness"
            )
