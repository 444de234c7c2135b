#!/usr/bin/env python3
"""Executed notebooks of the gallery: scripts/gallery_notebooks.py [NAME ...].

Each script docs/gallery/NAME.py becomes docs/gallery/NAME.ipynb with the output of its cells, which
the site shows and offers for download. The results of a run are written into a temporary folder.
Needs the extra notebooks: pip install -e ".[notebooks]".
"""

import argparse
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import jupytext
import nbformat
from nbclient import NotebookClient

GALLERY = Path(__file__).resolve().parents[1] / "docs" / "gallery"
HOURS = 2


def executed(script: Path) -> nbformat.NotebookNode:
    """A script as a notebook with its output.

    Args:
        script: in jupytext's light format.
    """
    notebook = jupytext.read(script)
    # Scenes are found from the place of the script; figures are kept.
    before = f"%matplotlib inline\n__file__ = {str(script)!r}"
    notebook.cells.insert(0, nbformat.v4.new_code_cell(before))
    with TemporaryDirectory() as folder:
        client = NotebookClient(
            notebook,
            timeout=3600 * HOURS,
            kernel_name="python3",
            record_timing=False,
            resources={"metadata": {"path": folder}},
        )
        client.execute()
    del notebook.cells[0]
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    notebook.metadata = {"kernelspec": kernel}
    for number, cell in enumerate(notebook.cells):
        cell.id = f"cell-{number}"
        cell.metadata = {}
        if cell.cell_type == "code":
            cell.execution_count = None
            cell.outputs = [own for own in cell.outputs if own.get("name") != "stderr"]
            for output in cell.outputs:
                if "execution_count" in output:
                    output.execution_count = None
    return notebook


if __name__ == "__main__":
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("names", nargs="*", metavar="NAME", help="of a script; all if not given")
    names = arguments.parse_args().names or sorted(p.stem for p in GALLERY.glob("*.py"))
    for name in names:
        start = time.perf_counter()
        nbformat.write(executed(GALLERY / f"{name}.py"), GALLERY / f"{name}.ipynb")
        print(f"{name}: {time.perf_counter() - start:.0f} s")
