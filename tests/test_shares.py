"""Shares of a job array: parts of the samples, in any order, killed and started again."""

import itertools
import json
import os
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from brake_fenicsx.cli import main
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder import sample_files
from brake_fenicsx.folder.lock import ARRAYS, Share, read_share
from brake_fenicsx.results import sample_blocks as blocks
from places import BLOCK, ROOT

STUDY = [
    "stages=['surface','equilibrium','stability','uncertainty']",
    "surface.statistics={ S_q = '3 um' }", "contact.block_plate.gap=hdf",
    "parts.block.size='10 mm'", "parts.plate.size='14 mm'", "stability.band=['0 Hz','20 kHz']",
    "samples.random.\"contact.block_plate.friction\"={ law='uniform', min=0.3, max=0.7 }",
    "stability.method=reduced", "stability.verify=1", "samples.n=30",
]  # fmt: skip
SETS = [word for change in STUDY for word in ("--set", change)]
TABLES = ("modes", "samples", "contact", "probabilities", "convergence")
PROGRAM = """
import sys
from brake_fenicsx.folder import sample_files
from brake_fenicsx.results import sample_blocks as blocks
sample_files.BLOCK, blocks.FOUNDING = 4, 2
from brake_fenicsx.cli import main
sys.exit(main(sys.argv[1:]))
"""


def words(command, out, *more):
    return [command, str(BLOCK), "-o", str(out), *SETS, *more]


def one_line(capsys):
    (line,) = capsys.readouterr().err.splitlines()
    return line


@pytest.fixture(autouse=True, scope="module")
def small_archives():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sample_files, "BLOCK", 4)
        patch.setattr(blocks, "FOUNDING", 2)
        yield


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Folder of a run that was not divided."""
    out = tmp_path_factory.mktemp("whole") / "out"
    assert main(words("run", out, "-q")) == 0
    return out


def same_tables(out, whole):
    for name in TABLES:
        assert (out / f"{name}.csv").read_bytes() == (whole / f"{name}.csv").read_bytes(), name


@pytest.mark.parametrize("of", [1, 3, 7, 40])
def test_shares_hold_every_task_once(of):
    parts = [Share(k, of).part(range(30)) for k in range(1, of + 1)]
    assert [task for part in parts for task in part] == list(range(30))
    assert max(map(len, parts)) - min(map(len, parts)) <= 1


def slurm(task, low, high, count):
    names = ("ID", task), ("MIN", low), ("MAX", high), ("COUNT", count)
    return {f"SLURM_ARRAY_TASK_{name}": value for name, value in names}


def grid_engine(task, first, last, step):
    names = ("ID", task), ("FIRST", first), ("LAST", last), ("STEPSIZE", step)
    return {f"SGE_TASK_{name}": value for name, value in names}


def lsf(task, end, step=1):
    return {"LSB_JOBINDEX": task, "LSB_JOBINDEX_END": end, "LSB_JOBINDEX_STEP": step}


@pytest.fixture
def no_array(monkeypatch):
    for name in itertools.chain(*ARRAYS):
        monkeypatch.delenv(name or "none", raising=False)


@pytest.mark.parametrize(
    ("task", "text", "share"),
    [
        (slurm(0, 0, 15, 16), "", (1, 16)), (slurm(16, 1, 16, 16), "", (16, 16)),
        (slurm(4, 0, 6, 4), "", (3, 4)), (slurm(9, 9, 9, 1), "", (1, 1)),
        (slurm(5, 1, 5, 3), "", (3, 3)), (slurm(4, 1, 5, 3), "", "not evenly spaced"),
        (slurm(2, 1, 7, 3), "", "not evenly spaced"), (slurm(3, 1, 8, 8), "/8", (3, 8)),
        (slurm(3, 1, 8, 8), "/16", "has 8 tasks"), (slurm(3, 1, 8, 8), "2/16", (2, 16)),
        (grid_engine(7, 1, 9, 2), "", (4, 5)),
        (grid_engine("undefined", "undefined", "undefined", "undefined"), "", "no task of"),
        (lsf(3, 8), "", (3, 8)), (lsf(5, 9, 2), "", (3, 5)), (lsf(0, 0, 0), "", "no task of"),
        ({"PBS_ARRAY_INDEX": 3}, "/8", (3, 8)), ({"PBS_ARRAY_INDEX": 3}, "", "write --share /N"),
        ({"PBS_ARRAY_INDEX": 9}, "/8", "I from 1 to N"),
    ],
)  # fmt: skip
def test_share_of_a_job_array(monkeypatch, no_array, task, text, share):
    for name, value in task.items():
        monkeypatch.setenv(name, str(value))
    if isinstance(share, str):
        with pytest.raises(SceneError, match=share):
            read_share(text)
    else:
        assert read_share(text) == Share(*share)


@pytest.mark.long
def test_shares_make_the_tables_of_one_run(whole, tmp_path, capsys):
    """In any order, one of them twice; what is left out is done by the run that writes."""
    out = tmp_path / "out"
    assert main(words("prepare", out)) == 0
    assert capsys.readouterr().err.splitlines()[-1].startswith("prepared; `run`")
    first = {f"multi-scale-0000{k}.npz" for k in (0, 1)} | {"families.npz"}
    assert {p.name for p in (out / "samples").iterdir()} == first
    stored = []
    for share in ("3/4", "1/4", "3/4"):
        assert main(words("run", out, "--share", share, "-q")) == 0
        stored.append({p.name: p.stat().st_mtime_ns for p in (out / "samples").iterdir()})
    assert len(stored[0]) < len(stored[1]) and stored[1] == stored[2]
    assert not any((out / f"{name}.csv").exists() for name in TABLES)
    assert main(["report", str(out)]) == 0
    assert "samples without tables; `run` of the scene" in capsys.readouterr().err
    assert "share 3 of 4" in (out / "log-3-of-4.txt").read_text()
    assert main(words("run", out, "-q")) == 0
    same_tables(out, whole)
    after = {p.name for p in (out / "samples").iterdir()}
    assert sum(name.endswith(".zip") for name in after) == 7 and len(after) == 7 + 2 + 1 + 1


def test_mistakes_of_shares(whole, tmp_path, capsys, no_array):
    """One line each, and nothing is written."""
    for share in ("0/4", "5/4", "4", "a/b", "1/0"):
        assert main(words("run", whole, "--share", share)) == 2
        assert "write I/N with I from 1 to N" in one_line(capsys)
    assert main(words("run", whole, "--share")) == 2
    assert "no task of a job array" in one_line(capsys)
    assert main(words("run", whole, "--share", "1/2", "--from", "report")) == 2
    assert "--from" in one_line(capsys)
    none = tmp_path / "none"
    assert main(words("run", none, "--share", "1/2")) == 2
    assert f"brake-fenicsx prepare {BLOCK} -o {none}" in one_line(capsys)
    more = "--set", "samples.approaches=['multi-scale','joint']"
    assert main(words("run", whole, "--share", "1/2", *more)) == 2
    assert "another scene" in one_line(capsys)
    surface = ["--set", "stages=['surface']", "--set", "contact={}", "--set", "samples.random={}"]
    assert main([*words("prepare", none), *surface]) == 2
    assert "no samples to be shared" in one_line(capsys)
    assert not none.exists()


FAKE = """#!/usr/bin/env python3
# Runs a job at once, each task of an array after the other.
import os, subprocess, sys
count = os.environ["COUNTER"]
number = int(open(count).read()) + 1 if os.path.exists(count) else 1
open(count, "w").write(str(number))
words = sys.argv[1:]
options = [w for w in words if w.startswith("--")][: 3]
command = words[next(i for i, w in enumerate(words) if not w.startswith("--")):]
with open(os.environ["CALLS"], "a") as calls:
    print(" ".join(words[: len(words) - len(command)]), command[1], *command[-1:], file=calls)
array = [w for w in options if w.startswith("--array=")]
low, high = map(int, array[0].partition("=")[2].split("-")) if array else (0, 0)
for k in range(low, high + 1):
    task = {"ID": k, "MIN": low, "MAX": high, "COUNT": high - low + 1} if array else {}
    env = {f"SLURM_ARRAY_TASK_{name}": str(value) for name, value in task.items()}
    subprocess.run(command, env=os.environ | env, check=True, stdout=sys.stderr)
print(number)
"""


@pytest.mark.slow
def test_a_real_slurm():
    """One node, four shares, one of them killed and requeued: the tables of one run."""
    program = Path(sys.executable).with_name("brake-fenicsx")
    done = subprocess.run(
        [ROOT / "scripts" / "test_slurm"], capture_output=True, text=True,
        env=os.environ | {"BRAKE_FENICSX": str(program)},
    )  # fmt: skip
    if done.returncode == 77:
        pytest.skip(done.stderr.strip())
    assert done.returncode == 0, done.stdout + done.stderr
    assert "restarts 1" in done.stdout and "the same bytes" in done.stdout


@pytest.mark.slow
def test_job_array_with_dependent_jobs(whole, tmp_path):
    """The script against a stand-in of sbatch that runs its jobs at once."""
    sbatch, out = tmp_path / "sbatch", tmp_path / "out"
    sbatch.write_text(FAKE)
    sbatch.chmod(0o755)
    program = tmp_path / "brake-fenicsx"
    program.write_text(f"#!{sys.executable}\n{PROGRAM}")
    program.chmod(0o755)
    env = os.environ | {
        "PATH": f"{tmp_path}:{os.environ['PATH']}", "COUNTER": str(tmp_path / "count"),
        "CALLS": str(tmp_path / "calls"), "BRAKE_FENICSX": str(program), "MPI_LAUNCHER": "env",
        "PYTHONPATH": f"{ROOT}:{os.environ.get('PYTHONPATH', '')}",
    }  # fmt: skip
    done = subprocess.run(
        [ROOT / "scripts" / "launch_array", "3", *words("run", out)[1:], "-q"],
        env=env, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "prepare 1, array 2, tables and page 3"
    calls = (tmp_path / "calls").read_text().splitlines()
    assert [line.split()[-2] for line in calls] == ["prepare", "run", "run"]
    assert "--dependency=afterok:1 --array=1-3" in calls[1] and calls[1].endswith("--share")
    assert "--dependency=afterany:2" in calls[2]
    same_tables(out, whole)


@pytest.mark.slow
def test_shares_as_rules_of_snakemake(whole, tmp_path):
    """Three of them on this machine; a second call has nothing to do."""
    snakemake, out = shutil.which("snakemake"), tmp_path / "out"
    if snakemake is None:
        pytest.skip("no snakemake: pip install snakemake, in an environment of its own")
    program = tmp_path / "brake-fenicsx"
    program.write_text(f"#!{sys.executable}\nimport sys\nsys.path[:0] = [{str(ROOT)!r}]\n{PROGRAM}")
    program.chmod(0o755)
    options = shlex.join([*SETS, "-q"])
    command = [snakemake, "-s", str(ROOT / "scripts" / "Snakefile"), "-c", "2", "--config"]
    command += [f"scene={BLOCK}", f"out={out}", "shares=3", f"options={options}"]
    env = os.environ | {"BRAKE_FENICSX": str(program)}
    env.pop("PYTHONPATH", None)  # what it names is not for the environment of Snakemake
    said = []
    for _ in range(2):
        done = subprocess.run(command, env=env, cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        said.append(done.stderr + done.stdout)
    assert "5 of 5 steps" in said[0] and "Nothing to be done" in said[1]
    assert {p.name for p in out.glob("log*.txt")} >= {f"log-{k}-of-3.txt" for k in (1, 2, 3)}
    same_tables(out, whole)


@pytest.mark.slow
def test_eight_shares_killed_at_random(whole, tmp_path):
    """Two at a time, killed with SIGKILL or SIGTERM at random moments and started again."""
    out, rng = tmp_path / "out", np.random.default_rng(8)
    assert main(words("prepare", out, "-q")) == 0
    env = os.environ | {"PYTHONPATH": f"{ROOT}:{os.environ.get('PYTHONPATH', '')}"}

    def start(k):
        command = [sys.executable, "-c", PROGRAM, *words("run", out, "--share", f"{k}/8", "-q")]
        return subprocess.Popen(command, env=env, stderr=subprocess.PIPE)

    waiting, working, hit = [*rng.permutation(np.arange(1, 9))], {}, 0
    while waiting or working:
        while waiting and len(working) < 8:
            k = int(waiting.pop())
            working[k] = start(k)
        time.sleep(float(rng.uniform(0.3, 1.5)))
        if hit < 24:
            k = int(rng.choice([*working]))
            working[k].kill() if rng.random() < 0.7 else working[k].terminate()
        for k, process in list(working.items()):
            if process.poll() is None:
                continue
            _, said = process.communicate()
            del working[k]
            if process.returncode != 0:
                assert process.returncode in (-9, -15, 143), said.decode()
                hit += 1
                waiting.append(k)
    assert hit >= 12
    stored = json.dumps(sorted(p.name for p in (out / "samples").iterdir()))
    assert stored.count(".zip") == 7
    assert main(words("run", out, "-q")) == 0
    same_tables(out, whole)
    assert not (out / "running").exists()
