"""scripts/promises: its table lacks nothing that is promised, and what is not kept is named."""

import json
import re
import subprocess
import tomllib
from copy import deepcopy

import pytest

from places import ROOT
from processes import script

SCENES = sorted((ROOT / "scripts" / "scenes").rglob("*.toml"))
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
promises = script("promises")
TABLE = tomllib.loads(promises.TABLE.read_text())
KEYS = {"when", "sh", "by", "why", "page", "place", "given", "says", "files", "runs", "warnings",
        "pictures"}  # fmt: skip
PICTURE = b"\x89PNG" + bytes(5000)
SHOWN = f'<img alt="a" src="data:image/png;base64,iVBORw0KGgo{"A" * 5000}">'


def lines_of(shell):
    """Lines of a shell, as one types them."""
    lines = (
        re.sub(r"\s+#\s.*|\|\| test \$\? -eq \d+$", "", line)
        for line in shell.replace("\\\n", " ").splitlines()
    )
    return [" ".join(line.split()) for line in lines if line.strip()]


def lines_of_page(page):
    blocks = re.findall(r"^ *```sh\n(.*?)^ *```$", page.read_text(), re.M | re.S)
    return [line for block in blocks for line in lines_of(block)]


def lines_of_rows(*when):
    return {line for row in TABLE.values() if row["when"] in when for line in lines_of(row["sh"])}


def test_rows_have_known_keys_and_what_is_not_run_a_reason():
    for name, row in TABLE.items():
        assert row["when"] in ("ci", "nightly", "example") and row.keys() <= KEYS, name
        assert ("why" in row) == (row["when"] == "example"), name
        assert ("pictures" in row) == ("runs" in row) and not ("by" in row and "page" in row), name
        if "by" in row:
            text = (ROOT / row["by"]).read_text()
            assert all(re.search(rf"^{re.escape(x)}\b", text, re.M) for x in lines_of(row["sh"]))


@pytest.mark.parametrize("scene", SCENES, ids=lambda path: path.stem)
def test_every_scene_is_checked_as_it_stands_and_used(scene):
    name = scene.relative_to(ROOT).as_posix()
    assert f"brake-fenicsx check {name}" in lines_of_rows("ci")
    run = rf"\b(run|identify) {re.escape(name)}( |$)"
    used = any(re.search(run, line) for line in lines_of_rows("ci", "nightly"))
    assert used or not tomllib.loads(scene.read_text())["stages"]


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_every_line_of_a_shell_is_in_the_table(page):
    known = lines_of_rows("ci", *(["nightly", "example"] if page.name != "README.md" else []))
    assert [line for line in lines_of_page(page) if line not in known] == []


def test_ci_runs_the_two_commands_of_the_readme_and_the_table():
    first = lines_of_page(ROOT / "README.md")[:2]
    assert first == ["scripts/demo", "scripts/test"]
    script = lines_of((ROOT / ".ci" / "run").read_text())
    places = [
        next(i for i, line in enumerate(script) if re.match(rf"{re.escape(words)}\b", line))
        for words in (*first, "scripts/promises ci --made demo")
    ]
    assert places == sorted(places)


FACTS = {
    "warnings": ["2 laws for 576 elements"], "failed_samples": 0,
    "samples": {"multi-scale": {"good": 2, "not_complete": 0, "tolerance_missed": 0}},
    "verification": {
        "samples_asked": 1, "samples_compared": 1, "wrong_verdicts": 0,
        "errors_beyond_estimates": 0, "eigenvalues": 9, "largest_relative_error": 1e-7,
    },
    "in_effect": {"stages": ["stability", "report"], "stability": {"verify": 1}},
}  # fmt: skip
ROW = {"warnings": ["^2 laws"], "pictures": ["mesh", "mode_*"]}


@pytest.fixture
def results(tmp_path):
    """A results folder of FACTS as they are changed, with its page and two pictures."""

    def make(changes=()):
        facts = deepcopy(FACTS)
        for path, value in dict(changes).items():
            *above, last = path.split(".")
            table = facts
            for key in above:
                table = table[key]
            table[last] = value
        (tmp_path / "figures").mkdir(exist_ok=True)
        (tmp_path / "summary.json").write_text(json.dumps(facts))
        for name in ("mesh", "mode_1"):
            (tmp_path / "figures" / f"{name}.png").write_bytes(PICTURE)
        (tmp_path / "report.html").write_text(2 * SHOWN)
        return tmp_path

    return make


def test_a_run_that_keeps_its_promise_says_what_it_shows(results):
    said = promises.judged(results(), ROW)
    assert "2 multi-scale, 9 modes within 1.0e-07 of full order, as stated, 2 pictures" in said
    said = promises.judged(results({"samples.multi-scale.tolerance_missed": 3}), ROW)
    assert "2 multi-scale, 3 estimates above the tolerance, 9 modes" in said


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"failed_samples": 1}, "1 samples failed"),
        ({"samples.multi-scale.good": 0}, "no sample of multi-scale"),
        ({"samples.multi-scale.not_complete": 1}, "number of modes of 1 samples is not proven"),
        ({"verification.samples_compared": 0}, "0 of 1 samples compared"),
        ({"verification.wrong_verdicts": 2}, "2 wrong verdicts"),
        ({"verification.errors_beyond_estimates": 1}, "1 of 9 errors are beyond their estimates"),
        ({"warnings": ["drivers left out: singular"]}, "warns: drivers left out"),
    ],
)  # fmt: skip
def test_what_a_summary_admits_breaks_the_promise(results, change, said):
    with pytest.raises(promises.Broken, match=re.escape(said)):
        promises.judged(results(change), ROW)


@pytest.mark.parametrize(
    ("path", "content", "said"),
    [
        ("figures/mesh.png", b"one pixel", "not drawn: mesh"),
        ("figures/figure9_squeal_map.lost", b"figure9 left out: nan", "figure9 left out: nan"),
        ("report.html", SHOWN.encode(), "1 pictures on the page, 2 promised"),
        ("report.html", 2 * b'<img src="figures/mesh.png">', "an image of the page is no picture"),
        ("report.html", None, "no report.html"), ("summary.json", None, "has no summary.json"),
    ],
)  # fmt: skip
def test_what_is_not_shown_breaks_the_promise(results, path, content, said):
    folder = results()
    (folder / path).unlink(missing_ok=True)
    if content is not None:
        (folder / path).write_bytes(content)
    with pytest.raises(promises.Broken, match=re.escape(said)):
        promises.judged(folder, ROW)


@pytest.fixture
def rows(tmp_path, monkeypatch, capsys):
    """What a table of rows ends with and prints; in a place of its own."""

    def run(table, *words):
        (tmp_path / "promises.toml").write_text(table)
        for name, path in (
            ("TABLE", "promises.toml"),
            ("PLACE", "place"),
            ("RECORD", "nightly.md"),
        ):
            monkeypatch.setattr(promises, name, tmp_path / path)
        monkeypatch.setattr("sys.argv", ["promises", *words])
        return promises.main(), capsys.readouterr().out

    return run


def test_rows_are_run_in_a_checkout_of_links(rows, tmp_path):
    """Nothing is written beside the scripts, and a folder that shows what went wrong stays."""
    table = """
    [good]
    when = "ci"
    given = { "a.txt" = "5 bar" }
    sh = "ls scripts/setup; cat a.txt; mkdir more-results; echo >more-results/b"
    says = ['\\d bar']
    files = ["more-results/b"]
    [bad]
    when = "nightly"
    sh = "echo before; false; echo behind"
    [silent]
    when = "nightly"
    sh = "true"
    says = ["anything"]
    """
    assert rows(table, "ci")[0] == 0
    assert not (ROOT / "more-results").exists() and not (tmp_path / "place" / "good").exists()
    status, printed = rows(table, "nightly")
    assert status == 1 and "1 of 3 promises are kept" in printed
    assert re.search(r"^\| good .* kept \| \d+ \| \d+ \| 5 bar; more-results/b \|$", printed, re.M)
    assert re.search(r"^\| bad .* BROKEN \| \d+ \| \d+ \| status 1: before ", printed, re.M)
    assert "nothing printed matches 'anything'" in printed
    assert (tmp_path / "place" / "bad" / "printed.txt").read_text() == "before\n"


def test_a_nightly_run_leaves_the_commit_and_date_of_each_row(rows, tmp_path):
    """Rows that were not run keep theirs: a night may be run in pieces."""
    table = '[one]\nwhen = "ci"\nsh = "echo 1"\n[two]\nwhen = "nightly"\nsh = "echo 2"\n'
    record = tmp_path / "nightly.md"
    for words in (["ci"], ["one"]):
        assert rows(table, *words)[0] == 0 and not record.exists()
    assert rows(table, "two")[0] == 0
    kept = record.read_text().splitlines()[-1]
    git = ["git", "-c", "safe.directory=*", "-C", ROOT, "rev-parse", "--short=10", "HEAD"]
    commit = subprocess.run(git, capture_output=True, text=True).stdout.strip() or "unknown"
    assert re.match(rf"\| two \| {commit}[\w ]* \| \d{{4}}-\d\d-\d\d \d\d:\d\d \| kept \|", kept)
    _, printed = rows(table, "nightly", "--go-on")
    assert "| one |" in printed and "| two |" not in printed
    assert record.read_text().splitlines()[-2:] == [printed.splitlines()[4], kept]
    _, printed = rows(table, "nightly")
    assert "2 of 2" in printed and "| two |" in printed


def test_rows_of_one_process_run_beside_those_of_several(rows, tmp_path):
    """Each waits for the other."""
    wait = "touch {0}/{1}; until [ -e {0}/{2} ]; do sleep 0.05; done"
    table = f"""
    [one]
    when = "ci"
    sh = "{wait.format(tmp_path, "a", "b")}; true"
    [two]
    when = "ci"
    sh = "{wait.format(tmp_path, "b", "a")}  # scripts/launch 2"
    """
    status, printed = rows(table, "ci", "--beside")
    assert status == 0 and "2 of 2" in printed


def test_results_that_are_there_are_judged_and_not_made(rows, tmp_path):
    table = '[a]\nwhen = "ci"\nsh = "exit 3"\nfiles = ["there"]\n'
    assert rows(table, "ci", "--made", "a")[0] == 1
    (tmp_path / "place" / "a").mkdir(parents=True)
    (tmp_path / "place" / "a" / "there").write_text("x")
    assert rows(table, "ci", "--made", "a")[0] == 0


def test_rows_that_stand_elsewhere_say_where(rows):
    table = '[a]\nwhen = "example"\nwhy = "a cluster"\nsh = "exit 3"\n'
    table += '[b]\nwhen = "ci"\nby = ".ci/run"\nsh = "exit 3"\n'
    status, printed = rows(table, "a", "b")
    assert status == 0 and "not run here: a cluster" in printed and "run by .ci/run" in printed


def test_a_row_that_is_not_there_is_refused(rows, capsys):
    with pytest.raises(SystemExit) as stop:
        rows('[a]\nwhen = "ci"\nsh = "true"\n', "b")
    assert stop.value.code == 2 and "there are a" in capsys.readouterr().err


def test_scenes_and_scripts_of_a_page_are_files(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("```toml\n# own.toml\nn = 1\n```\n\n```sh\nls\n```\n\n  ```python\nx\n  ```\n")
    promises.write_blocks(page, tmp_path / "in")
    files = {path.name: path.read_text() for path in (tmp_path / "in").iterdir()}
    assert files == {"own.toml": "# own.toml\nn = 1\n", "page_1.py": "x\n"}


def test_scripts_install_and_build_in_the_checkout_that_links_lead_to(tmp_path):
    """As in a checkout of links, where a second environment would be made beside them."""
    (tmp_path / "scripts").symlink_to(ROOT / "scripts")
    for path in (ROOT / "scripts").iterdir():
        text = path.read_text() if path.is_file() and path.suffix == "" else ""
        for place in re.findall(r'cd [^)&|;\n]*"\$\(dirname "\$0"\)[^"]*"', text):
            words = ["bash", "-c", f"{place} && pwd", f"{tmp_path}/scripts/{path.name}"]
            done = subprocess.run(words, capture_output=True, text=True)
            assert done.stdout.startswith(str(ROOT)), path.name
