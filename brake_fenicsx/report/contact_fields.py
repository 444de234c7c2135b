"""What the contact elements carry, for ParaView: as points, and on the facets of the pad's face."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from .xdmf_text import add_item, write_tree


def write_points(path: str | Path, points: NDArray, fields: Mapping[str, NDArray]) -> Path:
    """Write contact elements as points with their pressure, gap, ... for ParaView.

    Args:
        path: the XDMF file; the data stand in it as text.
        points: positions [m], shape (n, 3).
        fields: by name, shape (n,) or (n, 3).

    Returns:
        The path; nothing of it is collective: call it on one process.
    """
    cells = np.arange(len(points))[:, None]
    return _write(Path(path), "Polyvertex", cells, np.asarray(points, float), fields, "Node")


def write_facets(path: str | Path, corners: NDArray, fields: Mapping[str, NDArray]) -> Path:
    """Write the facets of a face with one value each.

    Args:
        path: the XDMF file; the data stand in it as text.
        corners: of each facet in cyclic order [m], shape (n, 3 or 4, 3).
        fields: by name, shape (n,) or (n, 3).

    Returns:
        The path; nothing of it is collective: call it on one process.
    """
    kind = {3: "Triangle", 4: "Quadrilateral"}[corners.shape[1]]
    cells = np.arange(corners.shape[0] * corners.shape[1]).reshape(corners.shape[:2])
    return _write(Path(path), kind, cells, corners.reshape(-1, 3).astype(float), fields, "Cell")


def facet_means(facet: NDArray, w: NDArray, values: NDArray, facets: int) -> NDArray:
    """Means over the elements of each facet, weighted with their areas.

    Args:
        facet: facet of each element, -1: none, shape (elements,).
        w: areas [m^2].
        values: one per element.
        facets: number of facets.

    Returns:
        One per facet, nan where a facet holds no element.
    """
    held = facet >= 0
    total = np.bincount(facet[held], w[held], facets)
    mean = np.full(facets, np.nan)
    full = total > 0
    mean[full] = np.bincount(facet[held], (w * values)[held], facets)[full] / total[full]
    return mean


def _write(
    path: Path,
    kind: str,
    cells: NDArray,
    points: NDArray,
    fields: Mapping[str, NDArray],
    centre: str,
) -> Path:
    root = ElementTree.Element("Xdmf", Version="3.0")
    grid = ElementTree.SubElement(ElementTree.SubElement(root, "Domain"), "Grid", Name="contact")
    about = {"TopologyType": kind, "NumberOfElements": str(len(cells))}
    if kind == "Polyvertex":
        about["NodesPerElement"] = "1"
    add_item(ElementTree.SubElement(grid, "Topology", about), cells)
    add_item(ElementTree.SubElement(grid, "Geometry", GeometryType="XYZ"), points)
    for name, values in fields.items():
        values = np.asarray(values, float)
        shape = "Vector" if values.ndim == 2 else "Scalar"
        attribute = ElementTree.SubElement(
            grid, "Attribute", Name=name, AttributeType=shape, Center=centre
        )
        add_item(attribute, values.reshape(len(values), -1))
    write_tree(path, root)
    return path
