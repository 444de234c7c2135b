"""The page in a real browser, where Playwright and Chromium are there: pointer, keyboard, phone."""

import re
import shutil

import pytest

from brake_fenicsx.report.html import write_report
from brake_fenicsx.results.squeal import squeals
from run_tables import read_run

playwright = pytest.importorskip(
    "playwright.sync_api", reason="the browser tests need Playwright: pip install playwright"
)
DESK, PHONE = {"width": 1280, "height": 900}, {"width": 390, "height": 844}


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


def _opened(browser, directory, **device):
    """The page, of which nothing goes wrong or out to a network since it was opened."""
    path = write_report(read_run(directory), redraw=False)
    page = browser.new_page(**device)
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


@pytest.fixture
def opened(browser, shaped):
    yield from _opened(browser, shaped[0], viewport=DESK)


@pytest.fixture
def phone(browser, shaped):
    yield from _opened(browser, shaped[0], viewport=PHONE, has_touch=True, is_mobile=True)


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


def chosen_mode(page):
    """Frequency [kHz] and mode that the box beside the chosen point names."""
    found = re.search(r"^([\d.]+) kHz.*\n.*, sample (\d+), mode (\d+)", page.inner_text("#map-tip"))
    return float(found[1]), (int(found[2]), int(found[3]))


def shape_is_shown(page):
    """The dialog shows a moving picture, and closes."""
    drawn = page.locator("#viewer img")
    assert drawn.get_attribute("src").startswith("data:image/webp;base64,")
    assert drawn.evaluate("image => image.decode().then(() => image.naturalWidth)") == 60
    page.keyboard.press("Escape")
    assert not page.is_visible("#viewer")


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
    assert re.search(r"The shape of (this|the) mode", page.inner_text("#viewer-text"))
    shape_is_shown(page)


def test_the_keyboard_steps_through_the_map_and_opens_a_shape(opened, shaped):
    """In the order of frequency, around the ends; the focus is where it was after the dialog."""
    page, run = opened, read_run(shaped[0])
    page.select_option("#map-approach", "0")
    own = (run.modes["approach"] == "classical") & (run.modes["frequency_hz"] > 0)
    every = sorted(1e-3 * run.modes["frequency_hz"][own])
    page.focus("#map-plot")
    for key, place in (("End", -1), ("ArrowRight", 0), ("ArrowRight", 1), ("ArrowLeft", 0),
                       ("ArrowLeft", -1), ("Home", 0)):  # fmt: skip
        page.keyboard.press(key)
        assert chosen_mode(page)[0] == pytest.approx(every[place], abs=6e-4), key
    family = next(row[1] for row in shaped[1] if row[0] == "classical")
    for key in ("Enter", " "):
        step_to(page, ["\nsqueal", f"family {family}:"])
        page.keyboard.press(key)
        shape_is_shown(page)
        assert page.evaluate("document.activeElement.id") == "map-plot"


def test_a_finger_opens_modes_and_shapes(phone, shaped):
    """Beside the point too: a finger is wider than a pointer."""
    family = next(row[1] for row in shaped[1] if row[0] == "multi-scale")
    phone.select_option("#map-family", f"2:{family}")
    step_to(phone, ["\nsqueal"])
    phone.locator("#map-plot").scroll_into_view_if_needed()
    x, y = step_to(phone, ["\nsqueal"])
    phone.touchscreen.tap(x + 18, y)
    assert f"family {family}: squeals in" in phone.inner_text("#viewer-text")
    shape_is_shown(phone)
    phone.locator("header .card img").first.tap()
    assert phone.inner_text("#viewer-title").endswith(" kHz")
    phone.locator("#viewer button").tap()
    assert not phone.is_visible("#viewer")
    phone.locator("section#probability figure img").first.tap()
    assert phone.locator("#viewer img").bounding_box()["width"] > PHONE["width"]


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


@pytest.mark.parametrize("way", ["pointer", "keyboard"])
def test_a_shape_moves_and_opens(opened, way):
    image = opened.locator("header .card img").first
    still, moving = (image.get_attribute(name) for name in ("src", "data-moving"))
    if way == "pointer":
        image.hover()
        assert image.get_attribute("src") == moving != still
        image.click()
    else:
        opened.focus("#print")
        opened.keyboard.press("Tab")
        assert image.evaluate("image => image === document.activeElement")
        assert image.get_attribute("src") == moving != still
        opened.keyboard.press("Enter")
    assert opened.inner_text("#viewer-title").endswith(" kHz")
    shape_is_shown(opened)
    opened.mouse.move(1, 1)
    opened.focus("#print")
    assert image.get_attribute("src") == still


@pytest.mark.parametrize("way", ["pointer", "keyboard"])
def test_a_figure_opens_larger(opened, way):
    image = opened.locator("section#probability figure img").first
    small = image.bounding_box()["width"]
    if way == "pointer":
        image.click()
    else:
        image.focus()
        opened.keyboard.press(" ")
    assert opened.locator("#viewer img").bounding_box()["width"] > small
    opened.mouse.click(2, 2)
    assert not opened.is_visible("#viewer")


def test_a_link_to_the_appendix_unfolds_it(opened):
    assert not opened.is_visible("#settings .pairs")
    opened.focus("nav a[href='#settings']")
    opened.keyboard.press("Enter")
    opened.wait_for_selector("#settings .pairs")


def test_nothing_is_cut_off_on_a_phone(phone):
    phone.evaluate("for (const d of document.querySelectorAll('details')) { d.open = true; }")
    wide = phone.evaluate(
        """[...document.querySelectorAll("body *")].filter((e) => !e.closest("dialog, svg")
        && (e.getBoundingClientRect().right > innerWidth + 1 || e.scrollWidth > e.clientWidth + 1
        && getComputedStyle(e).display !== "inline")).map((e) => e.outerHTML.slice(0, 120))"""
    )
    assert wide == []
    assert phone.evaluate("document.documentElement.scrollWidth") == PHONE["width"]


def test_print_has_the_static_map_and_the_whole_appendix_on_full_sheets(opened):
    """A4 less margins is 184 x 271 mm^2; before, each section of the appendix began a sheet."""
    opened.emulate_media(media="print")
    assert not opened.is_visible(".plane") and opened.is_visible("figure.still img")
    opened.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert opened.is_visible("#settings .pairs")
    mm = 96 / 25.4
    opened.set_viewport_size({"width": round(184 * mm), "height": round(271 * mm)})
    least = opened.evaluate("document.body.scrollHeight") / (271 * mm)
    number = len(re.findall(rb"/Type\s*/Page\b", opened.pdf(prefer_css_page_size=True)))
    assert least <= number <= 1.25 * least + 1
