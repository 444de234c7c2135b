import base64
import re
import shutil
import subprocess
import sys
from xml.etree import ElementTree

import pytest

from brake_fenicsx.errors import SceneError
from brake_fenicsx.report.html import _percent, render_page, write_report
from brake_fenicsx.report.rundata import RunData, read_run
from brake_fenicsx.tables import write_rows
from brake_fenicsx.uncertainty.probabilities import PROBABILITIES

X = "{http://www.w3.org/1999/xhtml}"


@pytest.fixture(scope="module")
def page(drawn):
    directory, _ = drawn
    folder = directory / "figures"
    shutil.copy(folder / "stages.png", folder / "mode_classical_0_3.png")
    return write_report(directory, redraw=False)


def test_page_is_well_formed_with_all_sections(page):
    root = ElementTree.parse(page).getroot()
    sections = [s.get("id") for s in root.iter(f"{X}section")]
    assert sections == [
        "squeal",
        "probability",
        "sweep",
        "inputs",
        "drivers",
        "pressure",
        "shapes",
        "laws",
        "surface",
        "accuracy",
        "settings",
    ]
    links = [a.get("href") for a in root.iter(f"{X}a")]
    assert links == [f"#{key}" for key in sections]
    assert root.find(f"{X}head/{X}title").text.endswith("run & <one>")


def test_page_needs_no_network_and_no_script(page):
    text = page.read_text()
    without_images = re.sub(r'src="data:[^"]*"', "", text)
    namespaces = re.sub(r'xmlns="[^"]*"', "", without_images)
    assert not re.search(r"https?:|//|@import|<script|<link|<iframe|url\(", namespaces)
    sources = re.findall(r'src="([^"]*)"', text)
    assert len(sources) == 22
    assert all(source.startswith("data:image/png;base64,") for source in sources)


def test_settings_in_effect_stand_beside_those_of_the_scene(page):
    text = page.read_text()
    assert "<h3>In effect</h3>" in text and "stability.tolerance" in text


def test_images_are_the_files_of_the_run(page):
    inside = {
        base64.b64decode(source)
        for source in re.findall(r'src="data:image/png;base64,([^"]*)"', page.read_text())
    }
    on_disk = {path.read_bytes() for path in (page.parent / "figures").glob("*.png")}
    assert inside == on_disk


def test_every_setting_seed_and_version_is_listed(page):
    root = ElementTree.parse(page).getroot()
    rows = [[c.text for c in row] for row in root.iter(f"{X}tr")]
    for row in (
        ["stability.band", "[0.0, 16000.0]"],
        ["stability.band", "0, 16000"],
        ["samples.seed", "1"],
        ["laws", "2"],
        ["dolfinx", "0.5.2"],
        ["note", "<script>alert(1)</script> & more"],
        ["reduction.max_error", "0.00013"],
        ["counts.contact_elements", "1110"],
        ["micro", "40.5", "330"],
    ):
        assert row in rows
    assert "<b>E</b>" in root.find(f".//{X}pre").text


def test_numbers_of_the_answer_stand_at_the_head(page):
    root = ElementTree.parse(page).getroot()
    rows = [[c.text for c in row] for row in root.find(f".//{X}header").iter(f"{X}tr")]
    assert rows[3][:8] == ["Multi-scale", "60", "0", "1920", "96", "1728", "96", "54"]
    assert rows[3][8] == "90 % (80 to 95 %)"
    assert rows[1][8] == "-"
    assert rows[0][6] == "squeal modes (damping below 0)"


def test_mode_shapes_stand_under_their_approach(drawn, tmp_path):
    """In the order of the other sections; an approach that is stable throughout says so."""
    directory = tmp_path / "run"
    shutil.copytree(drawn[0], directory)
    folder = directory / "figures"
    for old in folder.glob("mode_*.png"):
        old.unlink()
    names = ("mode_multi-scale_00900Hz", "mode_multi-scale_07000Hz", "mode_classical_01000Hz")
    for name in names:
        shutil.copy(folder / "stages.png", folder / f"{name}.png")
    table = (directory / "modes.csv").read_text()
    section = shapes(directory)
    heads = [e.text for e in section.iter(f"{X}h3")]
    assert heads == ["Classical", "Multi-scale"]
    captions = [e.text for e in section.iter(f"{X}figcaption")]
    assert captions == [n.replace("_", " ") for n in (names[2], *names[:2])]
    lines = [
        line.replace("unstable", "stable") if line.startswith("classical") else line
        for line in table.splitlines()
    ]
    (directory / "modes.csv").write_text("\n".join(lines) + "\n")
    (folder / f"{names[2]}.png").unlink()
    section = shapes(directory)
    assert [e.text for e in section.iter(f"{X}h3")] == ["Classical", "Multi-scale"]
    assert any("No mode of any sample squeals" in p.text for p in section.iter(f"{X}p"))


def shapes(directory):
    """Section of the mode shapes on the page of a run."""
    root = ElementTree.fromstring(render_page(read_run(directory)))
    return next(s for s in root.iter(f"{X}section") if s.get("id") == "shapes")


def test_every_table_and_caption_of_squeal_names_the_threshold(drawn):
    """Also where the tables of causes do."""
    run = read_run(drawn[0])
    run.summary["in_effect"]["stability"]["threshold"] = 0.006
    place = ["parametric", 0.006, "family", "0", 1900.0, 40, 9, 0.2, 0.1, 0.4, -0.01, 2e-3]
    write_rows(
        run.directory / "probabilities.csv", PROBABILITIES,
        [[*place, "no", *[None] * (len(PROBABILITIES) - len(place) - 1)]],
    )  # fmt: skip
    try:
        root = ElementTree.fromstring(render_page(run))
    finally:
        (run.directory / "probabilities.csv").unlink()
    said = "damping below -0.006"
    assert any(said in (p.text or "") for p in root.find(f".//{X}header").iter(f"{X}p"))
    for key, tables in (("squeal", 1), ("probability", 0), ("inputs", 1)):
        section = next(s for s in root.iter(f"{X}section") if s.get("id") == key)
        captions = [e.text for e in section.iter(f"{X}figcaption")]
        assert captions and all(said in text for text in captions)
        heads = [[h.text for h in t.iter(f"{X}th")] for t in section.iter(f"{X}table")]
        assert len(heads) == tables
        assert all(any(said in text for text in row) for row in heads)


def test_a_table_of_causes_of_an_older_version_is_named(drawn, tmp_path):
    write_rows(tmp_path / "probabilities.csv", ("approach", "scope", "where"), [])
    shutil.copy(drawn[0] / "modes.csv", tmp_path)
    with pytest.raises(SceneError, match=r"probabilities\.csv: column .*severity is missing"):
        render_page(read_run(tmp_path))


def test_damping_is_named_and_an_open_count_admitted(drawn, tmp_path):
    directory = tmp_path / "run"
    shutil.copytree(drawn[0], directory)
    plain = render_page(read_run(directory))
    assert "Damping that acts" not in plain
    run = read_run(directory)
    terms = {"rayleigh": {"alpha_1_s": 50.0}, "sliding": {}}
    for number in (1, 0):
        about = {"good": 1, "modes": 9, "tolerance_missed": 0, "not_complete": number}
        run.summary.update(damping=terms, samples={"classical": about})
        page = render_page(run)
        assert "(settings below): rayleigh, sliding." in page
        assert ("<p>Warning: Classical: in 1 of 1 samples the number" in page) == bool(number)


def test_every_parameter_of_the_fit_has_its_error(page):
    """Those of q_c and C0 are stored as errors of their logarithms."""
    rows = [[c.text for c in r] for r in ElementTree.parse(page).getroot().iter(f"{X}tr")]
    found = {row[0].split(",")[0]: row[1:] for row in rows if len(row) == 3}
    assert found["c1"] == ["-2.01", "0.04"]
    assert found["q_c"] == ["3e+04", "900"]
    assert found["C0"] == ["1.2e-18", "1.2e-19"]
    assert found["root mean square of ln(spectrum / fit) [-]"] == ["0.2", "-"]


def test_every_image_has_a_text(page):
    root = ElementTree.parse(page).getroot()
    assert all(image.get("alt") for image in root.iter(f"{X}img"))


def test_what_is_wider_than_a_phone_scrolls_in_a_box(page):
    """A table or figure outside one makes the whole page scroll sideways."""
    root = ElementTree.parse(page).getroot()
    wide = [e for e in root.iter(f"{X}div") if e.get("class") == "wide"]
    held = {id(child) for box in wide for child in box}
    shown = [*root.iter(f"{X}table"), *root.iter(f"{X}img")]
    assert len(shown) > 10
    assert all(id(e) in held for e in shown)
    assert ".wide { overflow-x: auto; }" in root.find(f".//{X}style").text


def test_shares_have_no_negative_zero():
    assert [_percent(v) for v in (-0.001, 0.0, -0.24, 1.0, None)] == [
        "0 %", "0 %", "-24 %", "100 %", "-",
    ]  # fmt: skip


def test_a_run_of_the_surface_alone_has_no_other_sections(run_directory, tmp_path):
    shutil.copy(run_directory / "surface.npz", tmp_path)
    root = ElementTree.parse(write_report(tmp_path)).getroot()
    assert [s.get("id") for s in root.iter(f"{X}section")] == ["surface"]
    assert len(list(root.iter(f"{X}img"))) == 3


def test_an_empty_summary_leaves_no_empty_section(tmp_path):
    root = ElementTree.fromstring(render_page(RunData(tmp_path, summary={"name": "bare"})))
    assert list(root.iter(f"{X}section")) == []
    assert root.find(f".//{X}h1").text == "Brake squeal study: bare"


def test_long_lists_are_shortened_and_say_so(tmp_path):
    text = render_page(RunData(tmp_path, summary={"settings": {"long": list(range(100))}}))
    assert "[0, 1, 2, 3, 4, ...] (100 values)" in text
    assert "95" not in text.split("<main>")[1]


def test_page_is_the_same_for_the_same_run(page):
    assert render_page(read_run(page.parent)) == page.read_text()


def test_importing_the_report_imports_no_heavy_library():
    code = (
        "import sys, brake_fenicsx.report.html, brake_fenicsx.report.overview\n"
        "heavy = {'dolfinx', 'petsc4py', 'mpi4py', 'matplotlib', 'pyvista'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
