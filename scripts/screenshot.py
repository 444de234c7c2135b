#!/usr/bin/env python3
"""Picture of the first screen of a page: scripts/screenshot.py PAGE.html PICTURE.png.

Needs Playwright and Chromium: pip install playwright; apt install chromium.
"""

import argparse
import shutil
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

COLOURS = 128


def screenshot(page: Path, picture: Path, size: tuple[int, int]) -> None:
    """Open a page as a browser does and keep what it shows first.

    Args:
        page: HTML file.
        picture: PNG to write, with few colours.
        size: width and height of the window in pixels.
    """
    with sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        window = browser.new_page(viewport={"width": size[0], "height": size[1]})
        window.goto(page.resolve().as_uri())
        window.screenshot(path=str(picture))
        browser.close()
    with Image.open(picture) as drawn:
        small = drawn.convert("RGB").quantize(COLOURS)
    small.save(picture, optimize=True)


if __name__ == "__main__":
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("page", type=Path, metavar="PAGE.html")
    arguments.add_argument("picture", type=Path, metavar="PICTURE.png")
    arguments.add_argument("--size", type=int, nargs=2, default=(1180, 900), metavar=("W", "H"))
    given = arguments.parse_args()
    screenshot(given.page, given.picture, given.size)
