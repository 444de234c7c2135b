"""XDMF files whose data stand in them as text: written at once, every digit kept."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.folder.files import whole_file


def add_item(parent: ElementTree.Element, values: NDArray) -> None:
    """Add an array to an element, as text that reads back to the same numbers."""
    kind = "Int" if np.issubdtype(values.dtype, np.integer) else "Float"
    item = ElementTree.SubElement(
        parent,
        "DataItem",
        Dimensions=" ".join(map(str, values.shape)),
        NumberType=kind,
        Precision="8",
        Format="XML",
    )
    item.text = "\n" + "\n".join(" ".join(map(repr, row)) for row in values.tolist()) + "\n"


def write_tree(path: Path, root: ElementTree.Element, note: str = "") -> None:
    """Write the tree at once, with a comment at its head."""
    ElementTree.register_namespace("xi", "http://www.w3.org/2001/XInclude")
    ElementTree.indent(root)
    comment = f"<!-- {note} -->\n" if note else ""
    text = ElementTree.tostring(root, encoding="unicode")
    with whole_file(path) as part:
        part.write_text(f'<?xml version="1.0" encoding="utf-8"?>\n{comment}{text}\n', "utf-8")
