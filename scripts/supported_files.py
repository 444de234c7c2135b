#!/usr/bin/env python3
"""Write docs/supported_files.md: what is read of each kind of file, and of each keyword of a deck.

The rows on files are what the readers find in the small files of tests/files, of which right.toml
has the writer and what is right. The rows on scans and keywords are the tables of the readers.

Run as: scripts/supported_files.py [FILE]
"""

from __future__ import annotations

import re
import tempfile
import tomllib
from pathlib import Path

import numpy as np

from brake_fenicsx.extras.decks.draft.text import write_scene
from brake_fenicsx.extras.decks.keywords import HARMLESS, KNOWN, Known
from brake_fenicsx.extras.measured.posterior import read_peaks
from brake_fenicsx.meshing.meshfile import read_mesh_file
from brake_fenicsx.scene import Scene, read_scene
from brake_fenicsx.surface import read_topography
from brake_fenicsx.surface.instruments import FORMATS

ROOT = Path(__file__).parents[1]
FILES, OUT = ROOT / "tests" / "files", ROOT / "docs" / "supported_files.md"
SCANS, MODES = (".txt", ".sdf"), (".unv", ".csv")
HEAD = """\
# Files that are read

Written by `scripts/supported_files.py`; do not edit it here.

## What is found in small files of each kind

The files are those of `tests/files`, each with its right values in `tests/files/right.toml`. Other
files of a program may hold more: what is not taken over has its line in the scene of `init`.
"""
SCAN_FORMATS = """\
## Scans of instruments, by release of SurfaceTopography

| file | 1.18.2 | 1.27.1 | this program |
| --- | --- | --- | --- |"""
KEYWORDS = """\
## Keywords of Abaqus and CalculiX

The steps are walked in their order; the scene is of the first step of complex modes, else of the
first one of modes, else of the last. An option or a data line that is not in this table has its
line in the scene, and what it would change is left out; so has a keyword that is not here. Only
output and what others name is silent:
"""


def facts(path: Path) -> dict[str, str]:
    """What the readers find in a file, in words."""
    if path.suffix in SCANS:
        topo = read_topography(path)
        sides = " x ".join(f"{1e6 * side:.6g}" for side in topo.size)
        rms = 1e6 * float(np.std(topo.heights))
        points = " x ".join(map(str, topo.heights.shape))
        return {"found": f"{points} points, {sides} um, rms {rms:.4g} um"}
    if path.suffix in MODES:
        (peaks,) = read_peaks(path)
        pairs = zip(peaks.frequency, peaks.q, strict=True)
        modes = (f"{f:.5g} Hz" + (f" (Q {q:.4g})" if np.isfinite(q) else "") for f, q in pairs)
        return {"found": ", ".join(modes)}
    mesh = read_mesh_file(path)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "scene.toml")
        write_scene(path, file, ["mm", "t", "s"])
        text = file.read_text(encoding="utf-8")
        missing = dict.fromkeys(re.findall("# missing: ([^ =]+)", text), "")
        iron = "{model='isotropic', E='125 GPa', nu=0.24, rho='7200 kg/m^3'}"
        scene = read_scene(file, [f"materials.{name}={iron}" for name in missing])
    sides = " x ".join(f"{side:.6g}" for side in np.ptp(mesh.points[mesh.cells], axis=(0, 1)))
    groups = {"cells": mesh.cell_groups, "facets": mesh.facet_groups, "nodes": mesh.node_groups}
    found = (f"{len(own)} of {kind}" for kind, own in groups.items() if own)
    lost = re.findall(r"# not taken over: (.*?)(?: \(|$)", text, re.M)
    return {
        "cells": f"{len(mesh.cells)} {mesh.shape} of {mesh.cells.shape[1]} nodes, {sides} mm",
        "sets": ", ".join(found),
        "materials": ", ".join(m.model for n, m in scene.materials.items() if n not in missing),
        "contact": ", ".join(_contact(scene)),
        "supports": ", ".join(f"{n} {''.join(held)}" for n, held in scene.supports.items()),
        "loads": ", ".join(_loads(scene)),
        "step": re.sub(r" \(.*", "", mesh.step) + (mesh.step and ", " + _band(scene)),
        "left out": ", ".join(lost),
    }


def _contact(scene: Scene) -> list[str]:
    """Friction of each interface."""
    mu = (c.friction for c in scene.contact.values())
    return [f"{m:g}" if isinstance(m, float) else f"{m.static:g} to {m.kinetic:g}" for m in mu]


def _loads(scene: Scene) -> list[str]:
    """Pressures [MPa] and forces [N]."""
    loads = scene.loads.items()
    pressures = [f"{n} {1e-6 * p.pressure:.6g} MPa" for n, p in loads if p.pressure is not None]
    forces = [(n, " ".join(f"{f:.6g}" for f in p.force)) for n, p in loads if p.force]
    return pressures + [f"{name} {force} N" for name, force in forces]


def _band(scene: Scene) -> str:
    band = scene.stability.band if scene.stability else (0.0, 0.0)
    return f"{band[0]:g} to {band[1]:g} Hz"


def page() -> str:
    """The whole page."""
    right = tomllib.loads((FILES / "right.toml").read_text(encoding="utf-8"))
    lines = [HEAD, "| file | written by | found | left out |", "| --- | --- | --- | --- |"]
    for name, own in right.items():
        rows = facts(FILES / name)
        lost = rows.pop("left out", "")
        found = "; ".join(f"{key}: {value}" for key, value in rows.items() if value)
        lines.append(f"| `{name}` | {own['written']} | {found.removeprefix('found: ')} | {lost} |")
    formats = (f"| `{end}` | {f.now} | {f.later} | {f.here} |" for end, f in FORMATS.items())
    lines += ["", SCAN_FORMATS, *formats, ""]
    lines += [f"{KEYWORDS}{', '.join(f'`*{word}`' for word in sorted(HARMLESS['abaqus']))}.", ""]
    lines += ["| keyword | options that are read | said, the rest is read | data lines |"]
    lines += ["| --- | --- | --- | --- |"]
    lines += [_row(word, KNOWN[word]) for word in sorted(KNOWN)]
    return "\n".join(lines) + "\n"


def _row(word: str, known: Known) -> str:
    """A keyword of the table."""
    options = ", ".join(f"{n}={p}" if p not in (".*", "") else n for n, p in known.patterns.items())
    aside = "; ".join(f"{name}: {said}" for name, said in known.aside.items())
    (few, most), (low, high) = known.words, known.lines
    words = f"{few} to {most} words" if few != most else f"{most} words"
    many = "any" if high > 99 else f"{low} to {high}" if low != high else f"{low}"
    data = f"{many} of {words}" if most else "none"
    cells = (f"`*{word}`", options or "-", aside or "-", data)
    return f"| {' | '.join(cell.replace('|', ' or ') for cell in cells)} |"


if __name__ == "__main__":
    from generated_page import write_page

    write_page(__doc__, OUT, page)
