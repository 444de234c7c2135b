import base64
import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from brake_fenicsx.report.html import render_page, write_report
from brake_fenicsx.report.mode_cards import ModePictures
from brake_fenicsx.report.page_blocks import SMALL
from brake_fenicsx.report.sections import percent
from brake_fenicsx.report.squeal_figures import squeal_map
from brake_fenicsx.results.probabilities import Probability
from brake_fenicsx.results.run import RunData
from brake_fenicsx.results.tables import MODES, SAMPLES, RowTable, write_rows
from run_tables import PROBABILITIES, mode, read_run

X = "{http://www.w3.org/1999/xhtml}"


@pytest.fixture(scope="module")
def page(drawn):
    directory, _ = drawn
    folder = directory / "figures"
    shutil.copy(folder / "eigenvalue_errors.png", folder / "mode_classical_0_3.png")
    return write_report(read_run(directory), redraw=False)


def test_page_is_well_formed_with_all_sections(page):
    root = ElementTree.parse(page).getroot()
    sections = [s.get("id") for s in root.iter(f"{X}section")]
    assert sections == [
        "squeal", "shapes", "probability", "sweep", "inputs", "drivers", "pressure",
        "driver-maps", "surface", "laws", "accuracy", "settings",
    ]  # fmt: skip
    links = [a.get("href") for a in root.iter(f"{X}a")]
    assert links == [f"#{key}" for key in sections]
    folded = [s.get("id") for s in root.iter(f"{X}section") if s.find(f"{X}details") is not None]
    assert folded == sections[7:]
    assert root.find(f"{X}head/{X}title").text.endswith("run & <one>")


def test_page_needs_no_network(page):
    """Neither by an address nor by what the browser allows the page."""
    text = page.read_text()
    without_images = re.sub(r'(src|data-moving)="data:[^"]*"', "", text)
    namespaces = re.sub(r'xmlns="[^"]*"', "", without_images)
    assert not re.search(r"https?:|//|@import|<link|<iframe|url\(|fetch|XMLHttp", namespaces)
    sources = re.findall(r'src="([^"]*)"', text)
    assert len(sources) == 21
    assert all(re.match(r"data:image/(png|webp);base64,", source) for source in sources)
    assert "default-src 'none'; img-src data:" in text


def test_small_pictures_are_the_files_of_the_run(page):
    """Larger ones are stored as WebP: the page stays below the sum of the files."""
    inside = {
        base64.b64decode(source)
        for source in re.findall(r'src="data:image/png;base64,([^"]*)"', page.read_text())
    }
    # Of mode shapes the page has thumbnails.
    on_disk = {
        path.read_bytes()
        for path in (page.parent / "figures").glob("*.png")
        if not path.stem.startswith("mode_")
    }
    assert inside and inside < on_disk
    assert all(len(data) <= SMALL for data in inside)
    left = [data for data in on_disk - inside if len(data) <= SMALL]
    assert left == []
    assert page.stat().st_size < 1.34 * sum(map(len, on_disk))


def test_every_setting_seed_and_version_is_listed(page):
    """Settings as the scene writes them, and each once."""
    root = ElementTree.parse(page).getroot()
    rows = [[c.text for c in row] for row in root.iter(f"{X}tr")]
    assert ["contact laws", "40.5", "330"] in rows
    pairs = [(d[0].text or "", d[1].text) for e in root.iter(f"{X}dl") if e.get("class") == "pairs"
             for d in e]  # fmt: skip
    for pair in (
        ("", 'stages = ["surface", "stability"]'),
        ("[samples]", "n = 60"),
        ('[loads."pad.piston"]', 'pressure = "5 bar"'),
        ("[samples.random]", '"contact.c.friction" = { law = "normal", sd = 0.05 }'),
        ("reduction.max_error", "0.00013"),
        ("counts.contact_elements", "1110"),
        ("reference_stiffness_N_per_mm3", "58"),
    ):
        assert pairs.count(pair) == 1, pair
    text = "".join(root.itertext())
    assert "Seeds: surface 1, laws 2, samples 3." in text
    assert "dolfinx 0.5.2, note <script>alert(1)</script> & more." in text


def test_the_scene_file_is_shown_where_nothing_else_names_the_settings(tmp_path):
    text = render_page(RunData(tmp_path, summary={"name": "a"}, scene='E = "1 GPa"  # <b>E</b>'))
    assert ElementTree.fromstring(text).find(f".//{X}pre").text.endswith("# <b>E</b>")


def test_numbers_of_the_answer_stand_in_the_first_table(page):
    root = ElementTree.parse(page).getroot()
    limits, table = root.findall(f".//{X}table")[:2]
    chosen, usual = [[c.text for c in row] for row in limits.iter(f"{X}tr")][1:]
    assert chosen == [
        "limit of the scene; every unstable mode (the model has no damping)", "0",
        "54 of 60: 90 % (80 to 95 %)",
    ]  # fmt: skip
    assert usual[:2] == ["customary limit in Abaqus", "-0.01"]
    rows = [[c.text for c in row] for row in table.iter(f"{X}tr")]
    assert rows[3][:8] == ["Multi-scale", "60", "0", "1920", "96", "1728", "96", "54"]
    assert rows[3][8] == "90 % (80 to 95 %)"
    assert rows[1][8] == "-"
    assert rows[0][6] == "squeal modes (damping below 0)"


def test_the_first_screen_names_verdict_candidates_and_conditions(page):
    """Of the approach with several samples and the most of what varies."""
    head = ElementTree.parse(page).getroot().find(f".//{X}header")
    verdict = next(d for d in head.iter(f"{X}div") if "verdict" in d.get("class"))
    assert verdict.get("class") == "verdict squeal"
    text = "".join(verdict.itertext())
    assert (
        "At least one squeal mode with a damping below 0 in 54 of 60 samples (95 % interval 80 to"
        " 95 %)." in text
    )
    assert verdict.find(f"{X}table") is not None and head.find(f".//{X}strong") is None
    assert "Classical: 2 squeal modes" in text
    run = read_run(page.parent)
    strongest = run.squeal.families("multi-scale")[:3]
    cards = [d for d in head.iter(f"{X}div") if d.get("class") == "card shape"]
    assert [c.find(f".//{X}h3").text for c in cards] == [
        f"{f.frequency / 1e3:.3f} kHz" for f in strongest
    ]
    assert all("Multi-scale" in "".join(card.itertext()) for card in cards)
    said = "".join(cards[0].itertext())
    assert f"{strongest[0].share.hits} of 60:" in said and f"{strongest[0].median:.2g}" in said
    facts = dict(facts_of(head))
    assert facts["Squeal"] == "unstable mode with damping below 0, 0 to 16 kHz"
    assert facts["Samples"] == "Classical 1, Parametric 39 (1 failed), Multi-scale 60"
    assert facts["Damping"] == "none named"


def facts_of(head):
    """Names and values of the conditions."""
    table = next(d for d in head.iter(f"{X}dl") if d.get("class") == "facts")
    return [("".join(row[0].itertext()), "".join(row[1].itertext())) for row in table]


@pytest.mark.parametrize(
    ("hits", "samples", "starts"),
    [
        (0, 20, "No squeal was found: a squeal mode with a damping below 0 in 0 of 20 samples (9"),
        (2, 20, "Squeal is possible: 1.000 kHz, in 2 of 20 samples (95 % interval 3 to 30 %; Jo"),
        (
            9,
            20,
            "Squeal is possible, its probability may lie on either side of 50 %: 1.000 kHz, in",
        ),
        (18, 20, "Squeal is likely at the limit of the scene: 1.000 kHz, in 18 of 20"),
        (1, 1, "Squeal is predicted at 1.000 kHz: 1 squeal mode with a damping below 0 in one run"),
        (0, 1, "No squeal mode with a damping below 0 in one run"),
    ],
)
def test_the_verdict_says_what_the_interval_allows(tmp_path, hits, samples, starts):
    rows = [mode("joint", k, 0, 1e3, -0.01 if k < hits else 0.01, 0) for k in range(samples)]
    write_rows(tmp_path / "modes.csv", MODES, rows)
    page = ElementTree.fromstring(render_page(read_run(tmp_path)))
    said = "".join(page.find(f".//{X}header//{X}div/{X}p").itertext())
    assert said.startswith(starts)
    assert ("95 %" in said) == (samples > 1)


def header(directory, rows, damping=None, **settings):
    """What the page of some modes has above its sections."""
    write_rows(directory / "modes.csv", MODES, rows)
    summary = {"in_effect": {"stability": settings}, "damping": damping or {}}
    page = render_page(replace(read_run(directory), summary=summary))
    return ElementTree.fromstring(page).find(f".//{X}header")


def first_screen(directory, rows):
    """Its text."""
    return " ".join("".join(header(directory, rows).itertext()).split())


def table_of_limits(*given, **settings):
    """Lines of its first table without the heading."""
    rows = header(*given, **settings).find(f".//{X}table").iter(f"{X}tr")
    return [[c.text for c in row] for row in rows][1:]


ANY = "every unstable mode (the model has no damping)"


@pytest.mark.parametrize(
    ("threshold", "said"),
    [
        (1e-3, [("limit of the scene", "-0.001", 4), ("customary limit in Abaqus", "-0.01", 3),
                (ANY, "0", 4)]),
        (0.0, [(f"limit of the scene; {ANY}", "0", 4), ("customary limit in Abaqus", "-0.01", 3)]),
        (0.01, [("limit of the scene; customary limit in Abaqus", "-0.01", 3), (ANY, "0", 4)]),
    ],
)  # fmt: skip
def test_the_verdict_is_a_table_of_limits(tmp_path, threshold, said):
    """Samples of damping -0.003, -0.02, -0.03 and -0.04; equal limits have one line."""
    rows = [mode("joint", k, 0, 1e3, x, 0) for k, x in enumerate((-0.003, -0.02, -0.03, -0.04))]
    found = table_of_limits(tmp_path, rows, threshold=threshold)
    assert [tuple(row[:2]) for row in found] == [line[:2] for line in said]
    assert [row[2].split(":")[0] for row in found] == [f"{line[2]} of 4" for line in said]
    assert all("%" in row[2] for row in found)


def test_limits_count_the_modes_of_a_single_run_and_name_its_damping(tmp_path):
    rows = [mode("joint", 0, n, 1e3 * n, x, -1) for n, x in ((1, -0.003), (2, -0.02), (3, -2e-5))]
    damping = {"lining": 0.02, "gyroscopic": "on"}
    assert table_of_limits(tmp_path, rows, damping, threshold=1e-3) == [
        ["limit of the scene", "-0.001", "2"],
        ["customary limit in Abaqus", "-0.01", "1"],
        ["every unstable mode (damping of the scene: lining, gyroscopic)", "0", "3"],
    ]


def test_families_that_may_be_a_doublet_are_counted_together(tmp_path):
    """One squeals in samples 0 and 1, the other in 1 and 2, and one 2 % beside them in 3."""
    place = {(0, 0): 3150.0, (1, 0): 3150.0, (1, 1): 3140.0, (2, 1): 3140.0, (3, 2): 3215.0}
    rows = [mode("joint", k, n, f, -0.02 + 0.001 * n, n) for (k, n), f in place.items()]
    text = first_screen(tmp_path, rows)
    assert text.count("lie close together") == 1
    assert (
        "3.150 and 3.140 kHz lie close together and may be one doublet: at least one squeals in"
        " 3 of 4 samples." in text
    )


def test_a_worse_mode_of_another_approach_is_named(tmp_path):
    """With its own frequency, and only where it is worse than all candidates."""
    rough = [mode("multi-scale", k, 0, 2e3, -0.02, 0) for k in range(4)]
    for lowest, named in ((-0.05, True), (-0.01, False)):
        perfect = [mode("classical", 0, n, 1e3 * n, lowest / (6 - n), n) for n in (4, 5)]
        text = first_screen(tmp_path, rough + perfect)
        said = "Another approach has a mode with a lower damping: 5.000 kHz, damping -0.05 (Classic"
        assert (said in text) == named == ("Another approach" in text)


@pytest.mark.parametrize(
    ("errors", "said"),
    [
        (["no equilibrium at 1.2."], "the only sample failed (Joint). Its error: no equilibrium "),
        (
            ["sample lost", "no equilibrium at 1.2", "no equilibrium at 1.35"],
            "all 3 samples failed (Joint). The most frequent error (2 of 3), here of sample 1: no"
            " equilibrium at 1.2.",
        ),
    ],
)
def test_a_run_without_a_good_sample_names_its_most_frequent_error(tmp_path, errors, said):
    rows = [["joint", k, text, 1] for k, text in enumerate(errors)]
    write_rows(tmp_path / "samples.csv", SAMPLES, rows)
    text = first_screen(tmp_path, [])
    assert f"No verdict: {said}" in text and ".." not in text


def test_conditions_come_from_the_summary(drawn):
    """Load, forces and friction of the approach that the first screen is about."""
    run = read_run(drawn[0])
    pads = {f"pad {j}": {"normal_N": 1000.04, "torque_N_m": 60.0, "friction_N": 500.0,
                         "effective_radius_mm": 120.0, "contact_area_mm2": 1.0,
                         "face_area_mm2": 2.0, "largest_pressure_MPa": 1.0,
                         "centre_towards_leading_edge_mm": 1.0, "leading_half_share": 0.5}
            for j in (1, 2)}  # fmt: skip
    summary = {
        **run.summary,
        "in_effect": {**run.summary["in_effect"], "motion": {"speed": "5 rad/s"},
                      "loads": {"pad.piston": {"pressure": 5e5, "steps": 1}}},
        "friction": {"classical": "0.5", "multi-scale": "random"},
        "contact_forces": {"multi-scale": pads}, "finished": "2026-01-02 03:04 UTC",
        "scene_sha256": "0123456789abcdef",
    }  # fmt: skip
    root = ElementTree.fromstring(render_page(replace(run, summary=summary)))
    facts = dict(facts_of(root.find(f".//{X}header")))
    assert facts["Load"] == "0.5 MPa on pad.piston"
    assert facts["Normal force"] == "1000 N on each of 2 pads"
    assert facts["Brake torque"] == "120 N m"
    assert facts["Friction coefficient"] == "Classical 0.5, Multi-scale random"
    meta = next(p for p in root.iter(f"{X}p") if p.get("class") == "meta").text
    assert meta == "2026-01-02 03:04 UTC · scene 0123456789ab · brake_fenicsx 0.1.0"


def test_every_picture_of_a_mode_is_on_the_page_once(shaped):
    """Those of the candidates on the first screen, with their pattern; the others in a section."""
    directory, rows = shaped
    run = read_run(directory)
    root = ElementTree.fromstring(render_page(run))
    pictures = [i for i in root.iter(f"{X}img") if (i.get("id") or "").startswith("shape-")]
    assert sorted(i.get("id") for i in pictures) == sorted(f"shape-{row[6]}" for row in rows)
    assert all(i.get("data-moving").startswith("data:image/webp;base64,") for i in pictures)
    first = [i for i in root.find(f".//{X}header").iter(f"{X}img")]
    best = [row[6] for row in rows if row[0] == "multi-scale"][:3]
    assert [i.get("id") for i in first] == [f"shape-{name}" for name in best]
    said = "".join(root.find(f".//{X}header").itertext())
    assert "7 nodal diameters, out of plane (90 % of the rim's motion)" in said
    data = json.loads(next(s for s in root.iter(f"{X}script") if s.get("id") == "map-data").text)
    assert len(data["shapes"]) == len(rows)
    shown = {key: f["shape"] for key, f in data["families"].items() if f["shape"]}
    assert sorted(shown.values()) == sorted(row[6] for row in rows)
    assert shown["2:" + str(rows[-4][1])] == rows[-4][6]


def test_the_map_holds_every_mode_or_says_which(drawn):
    run = read_run(drawn[0])
    every = squeal_map(run, ModePictures(run))
    good = (run.modes["approach"] != "parametric") | (run.modes["sample"] != 39)
    assert every["shown"] == every["total"] == good.sum()
    data = every["data"]
    keys = ("approach", "sample", "mode", "frequency", "damping", "error", "verdict", "family")
    assert {len(data[key]) for key in (*keys, "partner")} == {every["total"]}
    assert data["frequency"][0] == pytest.approx(run.modes["frequency_hz"][0], rel=1e-6)
    unstable = np.array(data["verdict"]) == 1
    assert unstable.sum() == np.sum((run.modes["verdict"] == "unstable") & good)
    few = squeal_map(run, ModePictures(run), most=1000)
    assert few["shown"] <= 1000 < few["total"] and few["data"]["thinned"]
    assert few["selection"].startswith("all squeal modes and one in ")
    assert np.sum(np.array(few["data"]["verdict"]) == 1) == unstable.sum()
    fewer = squeal_map(run, ModePictures(run), most=100)
    assert fewer["shown"] <= 100 and "one in 4 of the squeal modes" in fewer["selection"]


def test_every_table_and_caption_of_squeal_names_the_threshold(drawn):
    """Also where the tables of causes do."""
    run = read_run(drawn[0])
    run.summary["in_effect"]["stability"]["threshold"] = 0.006
    place = ["parametric", 0.006, "family", "0", 1900.0, 40, 9, 0.2, 0.1, 0.4, -0.01, 2e-3]
    row = [*place, "no", *[None] * (len(PROBABILITIES) - len(place) - 1)]
    causes = {**run.causes, "probabilities": RowTable.of(Probability, [Probability(*row)]).columns}
    root = ElementTree.fromstring(render_page(replace(run, causes=causes)))
    said = "damping below -0.006"
    assert dict(facts_of(root.find(f".//{X}header")))["Squeal"].startswith(
        f"unstable mode with {said}"
    )
    for key, tables in (("squeal", 2), ("probability", 0), ("inputs", 1)):
        section = next(s for s in root.iter(f"{X}section") if s.get("id") == key)
        captions = [e.text for e in section.iter(f"{X}figcaption")]
        assert captions and all(said in text for text in captions)
        heads = [[h.text for h in t.iter(f"{X}th")] for t in section.iter(f"{X}table")]
        assert len(heads) == tables
        assert all(any(said in text for text in row) for row in heads)


def test_damping_is_named_and_an_open_count_admitted(drawn, tmp_path):
    directory = tmp_path / "run"
    shutil.copytree(drawn[0], directory)
    run = read_run(directory)
    terms = {"rayleigh": {"alpha_1_s": 50.0}, "sliding": {}}
    for number in (1, 0):
        about = {"good": 1, "modes": 9, "tolerance_missed": 0, "not_complete": number}
        run.summary.update(damping=terms, samples={"classical": about})
        page = render_page(run)
        head = ElementTree.fromstring(page).find(f".//{X}header")
        assert dict(facts_of(head))["Damping"] == "rayleigh, sliding"
        assert ("<li>Warning: Classical: in 1 of 1 samples the number" in page) == bool(number)


def test_every_parameter_of_the_fit_has_its_error(page):
    """Those of q_c and C0 are stored as errors of their logarithms."""
    rows = [[c.text for c in r] for r in ElementTree.parse(page).getroot().iter(f"{X}tr")]
    found = {row[0].split(",")[0]: row[1:] for row in rows if len(row) == 4}
    assert found["c1"] == ["-2.01", "0.04", "-"]
    assert found["q_c"] == ["30", "0.9", "1/mm"]
    assert found["C0"] == ["1.2e-18", "1.2e-19", "m⁴"]
    assert found["root mean square of ln(spectrum / fit)"] == ["0.2", "-", "-"]


def test_images_have_texts_and_rows_of_tables_the_headings_for_a_phone(page):
    root = ElementTree.parse(page).getroot()
    assert all(image.get("alt") for image in root.iter(f"{X}img"))
    for table in root.iter(f"{X}table"):
        heads = [h.text for h in table.iter(f"{X}th")]
        for row in table.find(f"{X}tbody"):
            assert [cell.get("data-label") for cell in row] == heads


def test_shares_have_no_negative_zero():
    assert [percent(v) for v in (-0.001, 0.0, -0.24, 1.0, np.nan)] == [
        "0 %", "0 %", "-24 %", "100 %", None,
    ]  # fmt: skip


def test_the_page_of_a_surface_alone_names_its_parameters(run_directory, tmp_path, without_pixels):
    for name in ("surface.npz", "laws.npz"):
        shutil.copy(run_directory / name, tmp_path)
    run = read_run(tmp_path)
    root = ElementTree.parse(write_report(run)).getroot()
    assert [s.get("id") for s in root.iter(f"{X}section")] == ["surface", "laws"]
    assert root.find(f".//{X}h1").text == f"Surface and contact laws: {tmp_path.name}"
    assert len(list(root.iter(f"{X}img"))) == 5
    assert "squeal" not in "".join(root.find(f"{X}body/{X}header").itertext())
    facts = dict(facts_of(root))
    assert facts["S_sk, skewness"] == "-0.241"
    S_q = 1e6 * np.nanstd(run.surface["heights"])
    assert facts["S_q, root mean square height"] == f"{S_q:.3g} µm"


def test_parameters_that_a_scan_hardly_determines_are_warned_of(run_directory, tmp_path):
    with np.load(run_directory / "surface.npz") as file:
        arrays = dict(file)
    stats = json.loads(str(arrays["stats"])) | {"c1": -2.1, "c1_error": 1.7}
    np.savez(tmp_path / "surface.npz", **arrays | {"stats": np.array(json.dumps(stats))})
    page = render_page(read_run(tmp_path))
    said = "the standard error of c1, slope of the power spectrum below q_c is 1.7 at a value"
    assert page.count("<li>Warning: ") == 1 and f"<li>Warning: {said} of -2.1" in page


def test_an_empty_summary_leaves_no_empty_section(tmp_path):
    root = ElementTree.fromstring(render_page(RunData(tmp_path, summary={"name": "bare"})))
    assert list(root.iter(f"{X}section")) == []
    assert root.find(f".//{X}h1").text == "Brake squeal study: bare"


def test_long_lists_are_shortened_and_say_so(tmp_path):
    given = {"facts": list(range(100)), "settings": {"sweep": {"values": list(range(100))}}}
    text = render_page(RunData(tmp_path, summary=given))
    assert "58, 59, ... (100 values)" in text and "values = [0, 1, " in text
    assert "58, 59, ...]" in text and "95" not in text.split("<main>")[1].split("<script>")[0]


def test_page_is_the_same_for_the_same_run(page):
    assert render_page(read_run(page.parent)) == page.read_text()


def test_importing_the_report_imports_no_heavy_library():
    code = (
        "import sys, brake_fenicsx.report.html, brake_fenicsx.results.answer\n"
        "heavy = {'dolfinx', 'petsc4py', 'mpi4py', 'matplotlib', 'vtkmodules'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_forces_of_a_pad_on_a_disc_explain_the_missing_friction(tmp_path):
    """Straight sliding has no torque, and its friction force is mu times the normal force."""
    pad = {
        "normal_N": 1029.0, "friction_N": 498.0, "contact_area_mm2": 1.0, "face_area_mm2": 2.0,
        "largest_pressure_MPa": 1.0, "centre_towards_leading_edge_mm": 1.0,
        "leading_half_share": 0.5,
    }  # fmt: skip
    turning = {**pad, "torque_N_m": 62.0, "effective_radius_mm": 120.0}
    write_rows(tmp_path / "modes.csv", MODES, [mode("joint", 0, 0, 1e3, -0.02, 0)])
    for forces, said in ((pad, False), (turning, True)):
        summary = {"contact_forces": {"joint": {"pad": forces}}}
        page = render_page(replace(read_run(tmp_path), summary=summary))
        assert ("the direction of friction turns along the pad" in page) == said
