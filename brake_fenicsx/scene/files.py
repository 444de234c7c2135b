"""Meshes, matrices and scans that a scene names, by their content."""

from __future__ import annotations

import hashlib
from dataclasses import fields

from brake_fenicsx.scene.sections import Scene


def file_digests(scene: Scene) -> dict[str, str]:
    """Hash of the content of each file, by the key that names it; of files that are there.

    Args:
        scene: the scene.
    """
    table = scene.table
    named = {"mesh.file": (table.get("mesh") or {}).get("file")}
    surface = table.get("surface") or {}
    named["surface.form"] = surface.get("form")
    scans = surface.get("scan")
    if isinstance(scans, list):
        named |= {f"surface.scan.{k}": file for k, file in enumerate(scans, 1)}
    else:
        named["surface.scan"] = scans
    for name, part in scene.parts.items():
        for f in fields(part.matrices) if part.matrices else ():
            if isinstance(value := getattr(part.matrices, f.name), str):
                named[f"parts.{name}.matrices.{f.name}"] = value
    files = {key: scene.path(file) for key, file in named.items() if file is not None}
    return {
        key: hashlib.sha256(path.read_bytes()).hexdigest()
        for key, path in files.items()
        if path.is_file()
    }
