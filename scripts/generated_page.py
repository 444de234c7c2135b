"""Write a page of docs/ that a script makes; its command line may name another file."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path


def write_page(said: str | None, out: Path, page: Callable[[], str]) -> None:
    """The command line of a script that writes one page.

    Args:
        said: docstring of the script.
        out: file of the page.
        page: makes its text.
    """
    arguments = argparse.ArgumentParser(description=(said or "").splitlines()[0])
    arguments.add_argument("file", nargs="?", default=out, type=Path, metavar="FILE")
    path = arguments.parse_args().file
    path.write_text(page(), encoding="utf-8")
    print(f"wrote {path}")
