"""Configuration of the documentation site: Sphinx with MyST, built by scripts/docs, offline."""

import json
import re
from collections.abc import Iterator
from pathlib import Path

from sphinx.application import Sphinx

import brake_fenicsx
from brake_fenicsx import macro, micro
from brake_fenicsx.scene import scene_type
from brake_fenicsx.scene.keys import json_schema

# Names that are imported on use, so that autodoc finds them.
for package in (macro, micro):
    vars(package).update({name: getattr(package, name) for name in package.__all__})

project = "brake_fenicsx"
author = "brake_fenicsx developers"
copyright = author
release = version = brake_fenicsx.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
source_suffix = {".md": "markdown", ".py": "markdown"}  # scripts of the gallery, see below
exclude_patterns = ["conf.py"]

highlight_language = "none"  # of blocks without a name
myst_heading_anchors = 4
myst_enable_extensions = ["attrs_block", "colon_fence", "deflist"]

html_theme = "furo"
html_title = f"brake_fenicsx {release}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_copy_source = False

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_attr_annotations = False

# Types of signatures are named, linked where the site has them.
nitpick_ignore_regex = [("py:.*", ".*")]


def write_schema(app: Sphinx, _: Exception | None) -> None:
    """The JSON Schema of a scene beside the pages, as the command ``schema`` prints it."""
    if app.builder.format == "html":
        text = json.dumps(json_schema(scene_type()), indent=2)
        (Path(app.outdir) / "scene.schema.json").write_text(text + "\n")


def keep_bars(app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]):
    """Show |lambda| of a docstring as it stands, where reStructuredText sees a substitution."""
    lines[:] = [re.sub(r"(``.*?``)|\|", lambda m: m[1] or r"\|", line) for line in lines]


def read_script(app: Sphinx, page: str, source: list[str]) -> None:
    """A script in jupytext's light format as Markdown: comments are text, all else is code."""
    path = Path(app.env.doc2path(page))
    if path.suffix != ".py":
        return
    if (notebook := path.with_suffix(".ipynb")).is_file():
        source[0] = "\n\n".join(_cells(notebook))
        return
    pieces: list[tuple[bool, list[str]]] = [(False, [])]
    in_cell = False
    for line in source[0].splitlines():
        if line in ("# +", "# -"):
            in_cell = line == "# +"
        is_code = in_cell or not line.startswith("#")
        if is_code != pieces[-1][0] and line:
            pieces.append((is_code, []))
        if line not in ("# +", "# -"):
            pieces[-1][1].append(line if is_code else line[2:])
    texts = (("\n".join(lines).strip("\n"), is_code) for is_code, lines in pieces)
    parts = [f"```python\n{t}\n```" if is_code else t for t, is_code in texts if t]
    parts.append(
        f"This page is the script `docs/gallery/{path.name}`; see the [gallery](index.md)."
    )
    source[0] = "\n\n".join(parts)


def _cells(notebook: Path) -> Iterator[str]:
    """Text, code and printed output of an executed notebook, and where to get it."""
    for cell in json.loads(notebook.read_text())["cells"]:
        text = "".join(cell["source"])
        yield f"```python\n{text}\n```" if cell["cell_type"] == "code" else text
        for output in cell.get("outputs", []):
            shown = output.get("data", {})
            said = "".join(output.get("text", shown.get("text/plain", "")))
            if said and "image/png" not in shown:  # the picture stands above
                yield f":::{{code-block}} text\n:class: output\n\n{said.rstrip()}\n:::"
    name = notebook.stem
    yield (
        f"{{download}}`Notebook with its output <{name}.ipynb>`; the page is the script"
        f" `docs/gallery/{name}.py`, see the [gallery](index.md)."
    )


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("source-read", read_script)
    app.connect("autodoc-process-docstring", keep_bars)
    app.connect("build-finished", write_schema)
