"""The command line as a user meets it: endings, mistakes, full discs, signals, other programs."""

import importlib.util
import json
import os
import py_compile
import signal
import subprocess
import sys
import time
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx import pipeline
from brake_fenicsx.cli import main
from brake_fenicsx.description import time_text
from brake_fenicsx.folder.files import SharedCache
from brake_fenicsx.folder.log import Progress
from brake_fenicsx.folder.processes import Terminated
from brake_fenicsx.folder.store import Store
from brake_fenicsx.report.html import FIRST
from brake_fenicsx.results.answer import summary_table
from brake_fenicsx.results.run import read_run
from brake_fenicsx.samples.ensemble import run_ensemble
from brake_fenicsx.samples.study import Study
from brake_fenicsx.scene import read_scene
from brake_fenicsx.scene.units import several
from brake_fenicsx.stages import Run
from brake_fenicsx.surface import read_topography
from places import BLOCK
from processes import parallel

SURFACE = ["--set", "stages=['surface']", "--set", "surface.statistics={ S_q = '3 um' }"]
# A program that ends itself, or is ended, after some seconds at most.
PROGRAM = [sys.executable, "-m", "brake_fenicsx"]


def one_line(capsys, *words):
    """What is said of a mistake, and the exit status."""
    status = main([*map(str, words)])
    said = capsys.readouterr().err.splitlines()
    errors = [line for line in said if line.startswith("brake-fenicsx: ")]
    assert len(errors) == 1 and not any("Traceback" in line for line in said)
    return status, errors[0]


def test_a_run_ends_with_its_ending(tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["run", str(BLOCK), "-o", str(out), *SURFACE]) == 0
    assert capsys.readouterr().err.splitlines()[-1] == f"done; results are in {out}"
    assert (out / "log.txt").read_text().splitlines()[-1].endswith(f"results are in {out}")


def test_the_ending_counts_failed_samples_and_names_the_page(tmp_path):
    scene = read_scene(BLOCK)
    store = Store(tmp_path)
    run = Run(scene, MPI.COMM_SELF, store, SharedCache(store))
    run.facts = {"samples": {"parametric": {"good": 17}}, "failed_samples": 3}
    assert run.ending() == (
        f"done, 3 of 20 samples failed: see {tmp_path}/samples.csv; open {tmp_path}/report.html"
    )


def test_quiet_verbose_and_json(tmp_path, capsys):
    out = tmp_path / "out"
    words = ["run", str(BLOCK), "-o", str(out), *SURFACE]
    assert main([*words, "-q", "--json"]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    outcome = json.loads(said.out)
    assert outcome["directory"] == str(out) and outcome["page"] is None
    assert outcome["failed_samples"] == 0 and "surface" in outcome["seconds"]
    assert "done" in (out / "log.txt").read_text()
    # -v shows where an error arose.
    assert main(["check", str(tmp_path / "none.toml"), "-v"]) == 2
    assert "Traceback" in capsys.readouterr().err


def test_missing_points_are_said_once_and_stand_in_the_log(tmp_path, capsys):
    """So do warnings of what was read before the folder was opened."""
    scan = read_topography(BLOCK.parent / "pad_scan.npz")
    scan.heights[:4, :5] = 900e-6
    np.savez(tmp_path / "scan.npz", heights=scan.heights, size=scan.size)
    lost = np.isnan(scan.heights).sum()
    (tmp_path / "s.toml").write_text('stages = ["surface"]\n[surface]\nscan = "scan.npz"\n')
    out = tmp_path / "out"
    assert main(["run", str(tmp_path / "s.toml"), "-o", str(out)]) == 0
    for said in (capsys.readouterr().err, (out / "log.txt").read_text()):
        assert said.count(f"{lost} points missing") == 1
        assert said.count("20 points at exactly 900 um") == 1
    assert main(["check", str(tmp_path / "s.toml")]) == 0
    assert capsys.readouterr().out.count(f"{lost} points missing") == 1


def test_check_q_prints_warnings_alone(capsys):
    """Nothing for a scene without a doubt; a pressure p0 of 10 Pa was taken without one."""
    assert main(["check", str(BLOCK), "-q", *SURFACE]) == 0
    assert capsys.readouterr() == ("", "")
    law = "contact.block_plate.law={ p0 = '10 Pa', u0 = '0.3 um' }"
    assert main(["check", "-q", str(BLOCK), *SURFACE, "--set", law]) == 0
    said = capsys.readouterr().out.splitlines()
    assert "law.p0 = 1e-05 MPa: unusual" in said[0]
    assert all(line.startswith("warning: ") for line in said)


def test_a_missing_argument_is_named_and_no_option_that_may_be_left_out(capsys):
    status, line = one_line(capsys, "run")
    assert status == 2 and "required: SCENE.toml;" in line


def test_words_of_the_program():
    """Long times in days and years; numbers with their noun."""
    assert [time_text(x) for x in (1e5, 3e5, 1.29e9)] == ["27.8 h", "3.47 days", "40.9 years"]
    said = several(1, "line"), several(2, "line"), several(2, "branch ends", "branches end")
    assert said == ("1 line", "2 lines", "2 branches end")


def test_a_report_without_modes_says_so(tmp_path, caplog):
    stability = {"in_effect": {"stages": ["stability"], "stability": {"band": [0.0, 1e3]}}}
    (tmp_path / "summary.json").write_text(json.dumps(stability))
    with caplog.at_level("WARNING", "brake_fenicsx"):
        pipeline.report(tmp_path)
    assert "samples are missing, and the page has no modes" in caplog.text


def test_check_as_json(capsys):
    assert main(["check", str(BLOCK), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["samples"] == {"multi-scale": 1} and found["dofs"] > 1000
    assert found["gigabytes_per_process"] > 0 and found["gigabytes_on_disc"] > 0


def test_versions_of_the_solvers(capsys):
    import dolfinx

    with pytest.raises(SystemExit) as stop:
        main(["--version"])
    assert stop.value.code == 0
    said = dict(line.split() for line in capsys.readouterr().out.splitlines())
    assert said["DOLFINx"] == dolfinx.__version__
    assert {"brake-fenicsx", "PETSc", "SLEPc"} < {*said}


def test_a_folder_of_something_else_is_refused(tmp_path, capsys):
    photos = tmp_path / "photos"
    photos.mkdir()
    (photos / "cat.png").touch()
    nowhere, file = tmp_path / "link", tmp_path / "file"
    nowhere.symlink_to(tmp_path / "gone")
    file.touch()
    for out, what in (
        (photos, "cat.png"),
        (nowhere, "a broken symbolic link"),
        (file, "cannot be written"),
    ):
        status, said = one_line(capsys, "run", BLOCK, "-o", out, *SURFACE)
        assert status == 2 and what in said and str(out) in said
    assert os.listdir(photos) == ["cat.png"] and not (tmp_path / "gone").exists()


# No file may become larger than this, as on a full disc; MPI has files of its own.
FULL = """
import resource, sys
from mpi4py import MPI
from brake_fenicsx.cli import main
resource.setrlimit(resource.RLIMIT_FSIZE, (4000, 4000))
sys.exit(main())
"""


def test_a_full_disc_is_one_line(tmp_path):
    words = [sys.executable, "-c", FULL, "run", str(BLOCK), "-o", str(tmp_path / "out"), *SURFACE]
    # Python 3.11 keeps compiled modules that are cut off, which every later start would read.
    environment = os.environ | {"PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(words, env=environment, capture_output=True, text=True)
    assert done.returncode == 1
    assert "Traceback" not in done.stderr and "Exception ignored" not in done.stderr
    last = done.stderr.splitlines()[-1]
    assert last.startswith("brake-fenicsx: ") and "surface.npz: cannot be written" in last
    assert not list((tmp_path / "out").glob(".*.part"))


def test_a_compiled_module_that_a_full_disc_cut_off_is_named(tmp_path):
    """Up to 3.13 Python keeps it, and every later start reads it: the remedy is said."""
    source = tmp_path / "scipy.py"
    source.write_text("x = 1\n")
    compiled = Path(importlib.util.cache_from_source(str(source)))
    py_compile.compile(str(source))
    compiled.write_bytes(compiled.read_bytes()[:-8])
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    words = [*PROGRAM, "run", BLOCK, "-o", tmp_path / "out"]
    done = subprocess.run(words, env=environment, capture_output=True, text=True)
    last = done.stderr.splitlines()[-1]
    assert done.returncode == 1 and "Traceback" not in done.stderr
    assert last.startswith(f"brake-fenicsx: {compiled}: cut off") and sys.prefix in last


def test_a_full_disc_ends_the_samples_by_its_name(tmp_path):
    """Raised by one process while the others compute; the same on all."""
    from brake_fenicsx.errors import StorageError

    store = Store(tmp_path)
    with pytest.raises(StorageError, match="cannot be written"):
        run_ensemble([("parametric", 1)], lambda *_: {}, store, MPI.COMM_SELF)


def test_a_cache_that_cannot_be_written_does_not_stop_the_run(tmp_path, monkeypatch, caplog):
    from brake_fenicsx.folder import files as module

    def full(source, target):
        raise OSError(28, "No space left on device")

    store = Store(tmp_path)
    monkeypatch.setattr(module.os, "link", full)
    monkeypatch.setattr(module.shutil, "copyfile", full)
    cache = SharedCache(store, tmp_path / "cache")
    with cache.shared("laws.npz", lambda: 1, MPI.COMM_SELF):
        store.save("laws.npz", x=1)
    assert "No space left" in caplog.text and "continues without it" in caplog.text
    assert not list((tmp_path / "cache").iterdir())


def test_output_that_nobody_reads(tmp_path):
    """As of "schema | head -1", where the reader is gone before the last line."""
    read, write = os.pipe()
    os.close(read)
    words = [*PROGRAM, "schema"]
    done = subprocess.run(words, stdout=write, stderr=subprocess.PIPE)
    os.close(write)
    assert (done.returncode, done.stderr) == (141, b"")
    with open("/dev/full", "w") as full:
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE)
    assert done.returncode == 1
    assert done.stderr.decode() == "brake-fenicsx: the output: No space left on device\n"


def test_ctrl_c_while_libraries_are_loaded(tmp_path):
    """An interruption by the very import of mpi4py."""
    (tmp_path / "mpi4py.py").write_text("raise KeyboardInterrupt")
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    done = subprocess.run(
        [*PROGRAM, "check", BLOCK], env=environment, capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (
        130, "brake-fenicsx: interrupted; the same command resumes the run\n",
    )  # fmt: skip


def test_sigterm_finishes_the_sample_and_nothing_new(tmp_path, monkeypatch, capsys):
    """SLURM sends it before a job's time is over."""
    store = Store(tmp_path)
    store.path("samples").mkdir()
    begun = []

    def work(task):
        begun.append(task)
        if task[1] == 2:
            os.kill(os.getpid(), signal.SIGTERM)
        return {"x": np.array(task[1])}

    def run(*_, **__):
        run_ensemble([("parametric", k) for k in range(6)], work, store, MPI.COMM_SELF)

    monkeypatch.setattr(pipeline, "run", run)
    status, said = one_line(capsys, "run", BLOCK)
    assert status == 143 and "laws and samples are stored" in said
    assert [k for _, k in begun] == [0, 1, 2]
    assert store.samples.load(("parametric", 2)) is not None


def test_sigterm_elsewhere_ends_at_once(tmp_path):
    """While the program waits for a sign of life of another run in its folder."""
    out = tmp_path / "out"
    out.joinpath("running").mkdir(parents=True)
    other = out / "running" / "another-machine-7-7.run"
    other.touch()
    then = time.time() - 100.0
    os.utime(other, (then, then))
    (out / "running" / "folder.claim").write_text("another-machine-7-7")
    words = [*PROGRAM, "run", str(BLOCK), "-o", str(out), *SURFACE]
    going = subprocess.Popen(words, stderr=subprocess.PIPE, text=True)
    assert "waiting for a sign of life" in going.stderr.readline()
    going.send_signal(signal.SIGTERM)
    assert going.communicate()[1].startswith("brake-fenicsx: terminated")
    assert going.returncode == 143
    assert len(list((out / "running").iterdir())) == 2


def test_termination_is_none_of_the_errors_that_samples_survive():
    assert not issubclass(Terminated, Exception)


def test_gmsh_never_asks():
    """Its question about many elements would wait on the terminal for ever."""
    from brake_fenicsx.meshing.gmsh_mesh import gmsh_session

    with gmsh_session() as gmsh:
        assert gmsh.option.getNumber("General.ExpertMode") == 1


def test_time_to_go_is_that_of_the_samples_left(caplog, monkeypatch):
    """By the mean of those of their kind; the laws of resampled scans came after "0 s to go"."""
    now = iter([0.0, 500.0, 506.0, 520.0, 1e3, 1030.0, 1040.0, 1100.0])
    monkeypatch.setattr(time, "perf_counter", lambda: next(now))
    with caplog.at_level("INFO", logger="brake_fenicsx"):
        progress = Progress("samples", 1, 8)
        for _ in range(3):
            progress.advance()
        assert progress.to_go() == "60 s to go"
        shared = Progress("pieces", 2, 4, processes=2)
        for n in (1, 3, 2):
            shared.advance(n)
    assert caplog.messages == [
        "samples: 1 of 9, time to go not known yet",
        "samples: 2 of 9, 42 s to go",
        "samples: 3 of 9, 60 s to go",
        "pieces: 1 of 6, time to go not known yet",
        "pieces: 4 of 6, 10 s to go",
        "pieces: 6 of 6, in 2 min",
    ]


def test_no_pictures(tmp_path, capsys, monkeypatch):
    """Tables, fields and page are the same; report makes figures of them, or takes them away.

    A page stands before verification and pictures begin, and says what it lacks.
    """
    begun, beside = list[str](), Study.verified_beside

    def noted(self, works, together):
        def first(comm):
            more = together(comm)
            begun.append((tmp_path / "a" / "report.html").read_text())
            return more

        return beside(self, works, first)

    monkeypatch.setattr(Study, "verified_beside", noted)
    few = ["--set", "parts.block.size='14 mm'", "--set", "parts.plate.size='20 mm'"]
    assert main(["run", str(BLOCK), "-o", str(tmp_path / "a"), "--no-pictures", *few]) == 0
    page = tmp_path / "a" / "report.html"
    assert {p.name for p in (tmp_path / "a" / "figures").iterdir()} <= {"mode_shapes.csv"}
    assert (tmp_path / "a" / "modes.csv").is_file() and any((tmp_path / "a" / "fields").iterdir())
    assert "<table>" in page.read_text() and "<img" not in page.read_text()
    assert "<table>" in begun[0] and [FIRST in x for x in (*begun, page.read_text())] == [
        True,
        False,
    ]
    # Line by line: the time stamp of the file would shift the heading of the table alone.
    table = summary_table(read_run(tmp_path / "a")).splitlines()
    log = (tmp_path / "a" / "log.txt").read_text().splitlines()
    begin = next(i for i, line in enumerate(log) if line.endswith(f"INFO {table[0]}"))
    assert [x.partition("INFO ")[2] for x in log[begin : begin + len(table)]] == table
    assert main(["report", str(tmp_path / "a")]) == 0
    assert "<img" in page.read_text() and any((tmp_path / "a" / "figures").glob("*.png"))
    assert main(["report", str(tmp_path / "a"), "--no-pictures"]) == 0
    assert "<img" not in page.read_text() and "squeal:" in capsys.readouterr().err
    # Of two processes the first one draws alone: PETSc must not wait for the other.
    two = ["mpirun", "-n", "2", "--oversubscribe", sys.executable, "-m", "brake_fenicsx"]
    subprocess.run([*two, "report", tmp_path / "a"], timeout=300, check=True, **parallel())
    assert "<img" in page.read_text()


def test_words_that_mean_nothing_are_named(capsys):
    """A word after the scene was ignored."""
    assert "unrecognized arguments: word" in one_line(capsys, "run", BLOCK, "word")[1]


WRONG_WORDS = [
    (["brake.toml"], "brake.toml: no command; write brake-fenicsx run brake.toml"),
    (["a.inp"], "a.inp: no command; write brake-fenicsx init a.inp"),
    (["run", "a.inp"], "a mesh file; brake-fenicsx init"),
    (["init", "b.toml"], "b.toml: is a scene; give the mesh file"),
    (["init", "a.inp", "-o", "b.toml"], "b.toml: is there already; name another file with -o"),
    (["report", "b.toml"], "b.toml: a file, and no folder of results"),
    (["check", "win.toml"], "write paths with / or in single quotes"),
    (["check", "pipe.toml"], "pipe.toml: a device or pipe, no file"),
    (["check", "b.toml", "--set", "contact.block_plate.friction='0.5'"], "without quotes, 0.5"),
    (["check", "b.toml", "--set", "contact.block_plate.friction=0,4"],
     "decimals have a point, 0.4"),
    (["check", "b.toml", "--set", "motion.speed=300 rpm"],
     "with this speed write motion.axis, and no motion.direction"),
    (["check", "b.toml", "--set", "materials.wood.E='1 GPa'"],
     "materials.wood.model: missing; it has no default"),
]  # fmt: skip


@pytest.mark.parametrize(("words", "said"), WRONG_WORDS)
def test_slips_are_told_what_to_write(tmp_path, monkeypatch, capsys, words, said):
    """What people do by mistake: one line with the right remedy, status 2, nothing removed."""
    monkeypatch.chdir(tmp_path)
    scene = Path(BLOCK).read_text()
    (tmp_path / "b.toml").write_text(scene)
    (tmp_path / "a.inp").write_text("*NODE\n1, 0, 0, 0\n")
    windows = 'stages = ["surface"]\n[surface]\nscan = "C:\\scans\\new.txt"\n'
    (tmp_path / "win.toml").write_text(windows)
    os.mkfifo(tmp_path / "pipe.toml")
    assert main(words) == 2
    line = capsys.readouterr().err.strip()
    assert said in line and "\n" not in line
    assert (tmp_path / "b.toml").read_text() == scene and not list(tmp_path.glob("*-results"))


def test_a_page_without_modes_that_nobody_asked_for(tmp_path, capsys):
    """stages = ["surface", "report"] beside a section [stability]: no word of missing modes."""
    (tmp_path / "a.toml").write_text(
        'stages = ["surface", "report"]\nsurface = { statistics = { S_q = "3 um" } }\n'
        'stability = { band = ["0 Hz", "5 kHz"] }\n'
    )
    words = ["run", str(tmp_path / "a.toml"), "-o", str(tmp_path / "out"), "--no-pictures"]
    assert main(words) == 0
    assert "modes.csv" not in capsys.readouterr().err
