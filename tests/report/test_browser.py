"""The page in a real browser, where Playwright and Chromium are there."""

import re
import shutil

import pytest

from brake_fenicsx.report.html import write_report
from brake_fenicsx.results.squeal import squeals
from run_tables import read_run

playwright = pytest.importorskip(
    "playwright.sync_api", reason="the browser tests need Playwright: pip install playwright"
)


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as driver:
        installed = next(filter(None, map(shutil.which, ("chromium", "google-chrome"))), None)
        try:
            found = driver.chromium.launch(executable_path=installed, args=["--no-sandbox"])
        except playwright.Error as error:
            pytest.skip(f"no Chromium that starts: apt install chromium ({str(error)[:200]})")
        yield found
        found.close()


@pytest.fixture
def opened(browser, shaped):
    """The page, and what went wrong or out to a network since it was opened."""
    path = write_report(read_run(shaped[0]), redraw=False)
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    found = []
    page.on("console", lambda message: found.append(message.text))
    page.on("pageerror", lambda error: found.append(str(error)))
    page.on("request", lambda request: found.append(request.url))
    page.goto(path.as_uri())
    assert found == [path.as_uri()]
    found.clear()
    yield page
    page.close()
    assert [url for url in found if not url.startswith("data:")] == []


def step_to(page, words):
    """Step through the modes until one says some words; its place in the window [px]."""
    page.focus("#map-plot")
    for _ in range(400):
        page.keyboard.press("ArrowRight")
        said = page.inner_text("#map-tip")
        if all(word in said for word in words):
            box, ring = page.locator("#map-plot").bounding_box(), page.locator("#map-plot .ring")
            x, y = (float(ring.get_attribute(name)) for name in ("cx", "cy"))
            return box["x"] + x, box["y"] + y
    raise AssertionError(f"no mode says {words}")


def test_pointing_at_a_mode_shows_its_numbers_and_a_click_its_shape(opened, shaped):
    family = next(row[1] for row in shaped[1] if row[0] == "multi-scale")
    page = opened
    page.select_option("#map-family", f"2:{family}")
    x, y = step_to(page, ["\nsqueal"])
    page.mouse.move(x + 3, y)
    page.mouse.move(x, 1)
    assert not page.is_visible("#map-tip")
    page.mouse.move(x + 3, y)
    said = page.inner_text("#map-tip")
    assert re.search(r"^\d+\.\d{3} kHz, damping .0\.\d+\nMulti-scale, sample \d+, mode \d+", said)
    assert f"\nsqueal\nfamily {family}: squeals in" in said
    assert re.search(r"relative error of the eigenvalue \d", said)
    page.mouse.click(x + 3, y)
    assert page.is_visible("#viewer")
    drawn = page.locator("#viewer img")
    assert drawn.get_attribute("src").startswith("data:image/webp;base64,")
    assert drawn.evaluate("image => image.decode().then(() => image.naturalWidth)") == 60
    assert re.search(r"The shape of (this|the) mode", page.inner_text("#viewer-text"))
    page.click("#viewer button")
    assert not page.is_visible("#viewer")


def test_filters_count_what_the_tables_count(opened, shaped):
    run, page = read_run(shaped[0]), opened
    own = run.modes["approach"] == "multi-scale"
    for threshold in (0.0, 0.01):
        page.fill("#map-threshold", str(threshold))
        hits = own & squeals(run.modes, threshold)
        samples = len({*run.modes["sample"][hits]})
        assert page.inner_text("#map-count") == (f"{hits.sum()} squeal modes in {samples} samples")
    page.select_option("#map-approach", "0")
    page.fill("#map-threshold", "0")
    assert page.inner_text("#map-count") == "2 squeal modes in 1 sample"


def test_a_shape_moves_under_the_pointer_and_opens(opened):
    image = opened.locator("header .card img").first
    still = image.get_attribute("src")
    image.hover()
    assert image.get_attribute("src") == image.get_attribute("data-moving") != still
    image.click()
    assert opened.inner_text("#viewer-title").endswith(" kHz")


def test_a_link_to_the_appendix_unfolds_it(opened):
    assert not opened.is_visible("#settings table")
    opened.click("nav a[href='#settings']")
    opened.wait_for_selector("#settings table")


def test_nothing_is_cut_off_on_a_phone(opened):
    opened.set_viewport_size({"width": 390, "height": 844})
    opened.evaluate("for (const d of document.querySelectorAll('details')) { d.open = true; }")
    wide = opened.evaluate(
        """[...document.querySelectorAll("body *")].filter((e) => !e.closest("dialog, svg")
        && (e.getBoundingClientRect().right > innerWidth + 1 || e.scrollWidth > e.clientWidth + 1
        && getComputedStyle(e).display !== "inline")).map((e) => e.outerHTML.slice(0, 120))"""
    )
    assert wide == []
    assert opened.evaluate("document.documentElement.scrollWidth") == 390


def test_print_has_the_static_map_the_whole_appendix_and_page_breaks(opened):
    opened.emulate_media(media="print")
    assert not opened.is_visible(".plane") and opened.is_visible("figure.still img")
    breaks = opened.evaluate(
        """[...document.querySelectorAll(".appendix, .appendix section + section")].map(
        (part) => getComputedStyle(part).breakBefore)"""
    )
    assert breaks and {*breaks} == {"page"}
    pages = len(re.findall(rb"/Type\s*/Page\b", opened.pdf(prefer_css_page_size=True)))
    assert pages > len(breaks) + 1
