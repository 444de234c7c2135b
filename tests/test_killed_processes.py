"""Runs on two processes, killed as a whole or one process of them, and started again."""

import csv
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.pipeline import run
from places import BLOCK
from processes import parallel

ROUGH = [
    "stages=['surface','equilibrium','stability','uncertainty']",
    "surface.statistics={ S_q = '3 um' }", "contact.block_plate.gap=hdf",
    "parts.block.size='14 mm'", "parts.plate.size='20 mm'", "stability.band=['0 Hz','20 kHz']",
    "samples.random.\"contact.block_plate.friction\"={ law='uniform', min=0.3, max=0.7 }",
]  # fmt: skip
STUDIES = {
    "reduced": ["stability.method=reduced", "stability.verify=1", "samples.n=30"],
    "full": ["stability.method=full", "samples.n=6"],
}
TABLES = ("modes", "samples", "contact", "probabilities", "convergence")


class Job:
    """A run on two processes."""

    def __init__(self, out, study):
        mpirun = shutil.which("mpirun")
        if mpirun is None:
            pytest.skip("no mpirun")
        code = "import sys; from brake_fenicsx.cli import main; sys.exit(main(sys.argv[1:]))"
        sets = [word for change in (*ROUGH, *STUDIES[study]) for word in ("--set", change)]
        self.out, self.start = out, time.perf_counter()
        self.mpirun = subprocess.Popen(
            [mpirun, "-n", "2", "--oversubscribe", sys.executable, "-c", code,
             "run", str(BLOCK), "-o", str(out), *sets],
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, **parallel(),
        )  # fmt: skip

    def finish(self):
        """Wait for a run that must end well; its seconds."""
        _, said = self.mpirun.communicate()
        assert self.mpirun.returncode == 0, said.decode()
        return time.perf_counter() - self.start

    def ranks(self):
        """The processes that mpirun started and that live."""
        tree = Path(f"/proc/{self.mpirun.pid}/task")
        try:
            return [int(p) for t in tree.iterdir() for p in (t / "children").read_text().split()]
        except FileNotFoundError:
            return []

    def kill(self, whole):
        """SIGKILL to one process or to all; returns how many were hit when nothing lives."""
        ranks = self.ranks()
        hit = 0
        for pid in [self.mpirun.pid, *ranks] if whole else ranks[:1]:
            try:
                os.kill(pid, signal.SIGKILL)
                hit += 1
            except ProcessLookupError:
                pass
        self.mpirun.communicate()
        # Those that outlive their mpirun end by themselves, but not at once.
        while any(Path(f"/proc/{pid}").exists() for pid in ranks):
            time.sleep(0.01)
        return hit


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """``whole(study)``: its folder and seconds, unbroken; made once."""
    made = {}

    def make(study):
        if study not in made:
            out = tmp_path_factory.mktemp(study) / "out"
            made[study] = out, Job(out, study).finish()
        return made[study]

    return make


def goes_on(out, study, unbroken):
    """Started again: the bytes of the unbroken run, and no finished sample computed once more."""
    before = {p.name: p.stat().st_mtime_ns for p in out.glob("samples/*.npz")}
    Job(out, study).finish()
    for name in TABLES:
        assert (out / f"{name}.csv").read_bytes() == (unbroken / f"{name}.csv").read_bytes(), name
    after = {p.name: p.stat().st_mtime_ns for p in out.glob("samples/*.npz")}
    assert {name: after[name] for name in before} == before
    with (out / "samples.csv").open() as file:
        assert {row["status"] for row in csv.DictReader(file)} == {"ok"}


@pytest.mark.slow
@pytest.mark.parametrize("all_of_them", [True, False])
@pytest.mark.parametrize("study", ["reduced", "full"])
def test_killed_at_random_moments(study, all_of_them, whole, tmp_path):
    """Again and again, also while a file is written or the processes are in a common call."""
    unbroken, seconds = whole(study)
    rng, hit = np.random.default_rng([len(study), all_of_them]), 0
    for k, share in enumerate(rng.uniform(0.3, 0.95, 8)):
        job, start = Job(tmp_path / f"killed{k}", study), time.monotonic()
        try:
            job.mpirun.wait(share * seconds)
            # It was done by then: the machine is less busy than it was for the unbroken run.
            seconds = min(seconds, time.monotonic() - start)
        except subprocess.TimeoutExpired:
            hit += job.kill(all_of_them) > 0
        goes_on(job.out, study, unbroken)
        if hit == 4:
            break
    assert hit >= 3


@pytest.mark.parametrize("study", ["reduced", pytest.param("full", marks=pytest.mark.slow)])
@pytest.mark.together
def test_run_goes_on_with_another_number_of_processes(study, processes, tmp_path):
    """What the samples share was made for another numbering of the dofs; families are the same."""
    comm, folder = processes
    unbroken, out, changes = folder / "all", tmp_path / "out", [*ROUGH, *STUDIES[study]]
    run(BLOCK, comm, unbroken, changes)
    comm.Barrier()
    shutil.copytree(unbroken, out)
    samples = sorted(out.glob("samples/*.npz"))
    for path in samples[1::2]:
        path.unlink()
    run(BLOCK, MPI.COMM_SELF, out, changes)
    one, two = (list(csv.DictReader((f / "modes.csv").open())) for f in (unbroken, out))
    assert len(one) == len(two) > 50
    for a, b in zip(one, two, strict=True):
        for name in ("approach", "sample", "mode", "verdict", "family"):
            assert a[name] == b[name], name
        s = [complex(float(m["real_1_s"]), 2 * np.pi * float(m["frequency_hz"])) for m in (a, b)]
        assert abs(s[0] - s[1]) <= 2 * float(a["error_estimate"])
        assert float(b["error_estimate"]) <= 1.01 * float(a["error_estimate"]) + 1e-12 * abs(s[0])
