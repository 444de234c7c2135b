"""A results folder after power cuts, kills and damage: nothing is lost that was found."""

import os
import shutil
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx import pipeline, run
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder import arrays, files
from brake_fenicsx.folder.files import PART, whole_file
from brake_fenicsx.folder.lock import Lock, has_ended, process_name
from brake_fenicsx.folder.store import RUNNING, Store, read_status
from brake_fenicsx.micro.library import LawRecipe
from brake_fenicsx.scene import read_scene
from brake_fenicsx.scene.digest import result_digest
from places import SQUEALING

PLAIN = [
    "stages=['surface','equilibrium','stability','uncertainty']", "samples.n=2",
    "countermeasures=[]", "contact.block_plate.friction=0.55",
    "stability.damping={ rayleigh = ['0 1/s', '4e-7 s'] }",
]  # fmt: skip
TABLES = ("modes.csv", "samples.csv", "contact.csv")


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run") / "out"
    run(SQUEALING, MPI.COMM_SELF, folder, PLAIN)
    return folder


def same_tables(one, two):
    return all((one / name).read_bytes() == (two / name).read_bytes() for name in TABLES)


MARKS = {
    "a digit": lambda text: ("0" if text[0] != "0" else "1") + text[1:],
    "a byte lost": lambda text: text[:-1],
    "empty": lambda text: "",
    "no UTF-8": lambda text: b"\xff\xfe" + text.encode()[2:],
    "none": lambda text: None,
}


@pytest.mark.hard
@pytest.mark.parametrize("kind", MARKS)
def test_samples_say_which_scene_a_folder_is_of(done, tmp_path, kind):
    """scene.sha256 changed, cut, emptied, garbled or gone: the run goes on with its samples."""
    folder = shutil.copytree(done, tmp_path / "out")
    mark = folder / "scene.sha256"
    text = mark.read_text()
    content = MARKS[kind](text)
    mark.unlink()
    if content is not None:
        mark.write_bytes(content if isinstance(content, bytes) else content.encode())
    assert read_status(folder).done == {"multi-scale": 2}
    before = {p.name: p.stat().st_mtime_ns for p in (folder / "samples").iterdir()}
    run(SQUEALING, MPI.COMM_SELF, folder, PLAIN)
    assert mark.read_text() == text and same_tables(done, folder)
    assert before == {p.name: p.stat().st_mtime_ns for p in (folder / "samples").iterdir()}
    with pytest.raises(SceneError, match="results of another scene"):
        run(SQUEALING, MPI.COMM_SELF, folder, [*PLAIN, "contact.block_plate.friction=0.5"])


def test_a_damaged_mark_without_samples_is_named(done, tmp_path):
    """Nothing says which scene it is: neither taken for another scene, nor for this one."""
    folder = shutil.copytree(done, tmp_path / "out")
    shutil.rmtree(folder / "samples")
    (folder / "scene.sha256").write_text("")
    with pytest.raises(SceneError, match=r"scene\.sha256: damaged, and no sample says"):
        run(SQUEALING, MPI.COMM_SELF, folder, PLAIN)


@pytest.mark.hard
def test_links_to_a_larger_disc_outlive_a_stage_run_again(done, tmp_path):
    """cache and samples are links: --from empties what they lead to, and the links stay."""
    folder, disc = shutil.copytree(done, tmp_path / "out"), tmp_path / "disc"
    disc.mkdir()
    for name in ("cache", "samples"):
        shutil.move(folder / name, disc / name)
        (folder / name).symlink_to(disc / name)
    run(SQUEALING, MPI.COMM_SELF, folder, PLAIN, from_stage="equilibrium")
    assert (folder / "cache").is_symlink() and (folder / "samples").is_symlink()
    assert len(list((disc / "samples").iterdir())) == 2 and same_tables(done, folder)


def test_what_processes_that_ended_were_writing_goes(done, tmp_path):
    """Parts of a process that ended go with the next run; those of one at work stay."""
    folder, own = shutil.copytree(done, tmp_path / "out"), process_name()
    host, process, start = own.rsplit("-", 2)
    ended, at_work = f"{host}-{process}-{int(start) + 1}", f"elsewhere-{process}-1"
    assert has_ended(ended) and not has_ended(own) and not has_ended(at_work)
    assert not has_ended("no name")
    for name in (ended, own, at_work):
        (folder / "samples" / f".multi-scale-00034.npz~{name}{PART}").write_text("x")
    run(SQUEALING, MPI.COMM_SELF, folder, PLAIN)
    left = {p.name.partition("~")[2] for p in folder.rglob(f".*{PART}")}
    assert left == {own + PART, at_work + PART}


@pytest.mark.hard
def test_laws_are_stored_as_they_finish(tmp_path, monkeypatch):
    """A kill in stage micro: laws and scans that were solved are not solved again, same bytes."""
    rng, text = np.random.default_rng(0), "stages = ['surface', 'micro']\n[surface]\n"
    x = np.cumsum(np.cumsum(rng.normal(size=(64, 64)), 0), 1)
    np.savez(tmp_path / "scan.npz", heights=1e-5 * x / x.std(), size=np.array([1e-3, 1e-3]))
    text += "scan = 'scan.npz'\n[micro]\npatch = '1 mm'\npixels = 32\nlaws = 4\nscans = 3\n"
    (tmp_path / "a.toml").write_text(text)
    solved = []
    law = LawRecipe.law

    def killed(self, seed, number, *pressure):
        if len(solved) == 2:
            raise KeyboardInterrupt
        solved.append(number)
        return law(self, seed, number, *pressure)

    monkeypatch.setattr(LawRecipe, "law", killed)
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "a.toml", MPI.COMM_SELF, tmp_path / "out")
    monkeypatch.setattr(LawRecipe, "law", lambda *a: (solved.append(a[2]), law(*a))[1])
    damaged = tmp_path / "out" / "cache" / "laws" / "law-00001.npz"
    damaged.write_bytes(damaged.read_bytes()[:-99])
    run(tmp_path / "a.toml", MPI.COMM_SELF, tmp_path / "out")
    assert solved == [0, 1, 1, 2, 3]
    assert not (tmp_path / "out" / "cache" / "laws").exists()
    run(tmp_path / "a.toml", MPI.COMM_SELF, tmp_path / "whole")
    one, two = (tmp_path / name / "laws.npz" for name in ("out", "whole"))
    assert arrays.read_npz(one).keys() == arrays.read_npz(two).keys()
    for name, a in arrays.read_npz(one).items():
        assert np.array_equal(a, arrays.read_npz(two)[name])


@pytest.mark.hard
def test_two_changed_bytes_of_the_cache_are_found(done, tmp_path, monkeypatch):
    """A mapped array of the reduced model changes: it is made again, and more samples are right."""
    monkeypatch.setattr(arrays, "MAPPED", 2**12)
    four = [*PLAIN, "samples.n=4"]
    run(SQUEALING, MPI.COMM_SELF, tmp_path / "whole", four)
    folder = shutil.copytree(done, tmp_path / "out")
    (cache,) = (folder / "cache").glob("*damped.npz")
    with arrays.zipfile.ZipFile(cache) as archive:
        largest = max(archive.infolist(), key=lambda entry: entry.file_size)
    content = bytearray(cache.read_bytes())
    at = largest.header_offset + largest.file_size // 2
    content[at], content[at + 4096 // 2] = content[at] ^ 1, content[at + 4096 // 2] ^ 255
    cache.write_bytes(content)
    run(SQUEALING, MPI.COMM_SELF, folder, four)
    assert "another checksum" in (folder / "log.txt").read_text()
    assert same_tables(tmp_path / "whole", folder)


@pytest.mark.parametrize("content", ["no name", "", "a-b-c", "\udcff", "x" * 200])
def test_a_damaged_claim_is_taken_over(tmp_path, content):
    """A claim that names no process: stale, whatever stands in it."""
    lock = Lock(tmp_path / RUNNING)
    (lock.folder / "folder.claim").write_bytes(content.encode("utf-8", "surrogateescape"))
    assert lock.claim("folder") is None
    assert Lock.watched(lock.folder)[0][1] == "folder"
    lock.leave()


def test_files_that_decide_are_on_the_disc_before_their_name(tmp_path, monkeypatch):
    """The content is synced before the file is renamed, the folder after it."""
    done, replace, sync = [], os.replace, os.fsync

    def synced(number):
        name = Path(os.readlink(f"/proc/self/fd/{number}")).name
        done.append(name.partition("~")[0])
        sync(number)

    def renamed(*names):
        done.append("renamed")
        replace(*names)

    monkeypatch.setattr(files.os, "fsync", synced)
    monkeypatch.setattr(files.os, "replace", renamed)
    store = Store(tmp_path)
    store.digest = "0" * 64
    store.open("")
    assert done[:3] == [".scene.sha256", "renamed", tmp_path.name]
    done.clear()
    store.samples.save(("joint", 0), x=np.zeros(3))
    assert done == [".joint-00000.npz", "renamed", "samples"]


def test_a_file_that_cannot_be_written_is_named_by_its_own_name(tmp_path):
    """Whatever a library says of the file it was given."""

    def write():
        with whole_file(tmp_path / "fields.vtkhdf") as part:
            raise OSError(f"Unable to create file (name = '{part}')")

    with pytest.raises(OSError, match=r"fields\.vtkhdf: cannot be written") as caught:
        write()
    assert PART not in str(caught.value)


def test_hashes_of_a_scene_are_what_is_stored(done):
    assert Store(done).known() == result_digest(read_scene(SQUEALING, PLAIN))
    assert pipeline.earlier_run(done)["scene_sha256"] == Store(done).known()
