"""The one opener of array files: damage, sizes that are not there, and files that would be run."""

import io
import re
import tracemalloc
import zipfile
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.sparse as sp

from brake_fenicsx.errors import SceneError, SurfaceError
from brake_fenicsx.extras.decks.matrix_files import read_matrix
from brake_fenicsx.extras.measured.universal import read_sets
from brake_fenicsx.extras.variants.comparison import shapes_of
from brake_fenicsx.folder import arrays
from brake_fenicsx.folder.arrays import read_npz, reading
from brake_fenicsx.folder.store import Store
from brake_fenicsx.meshing.gmsh_mesh import gmsh_session
from brake_fenicsx.meshing.meshfile import read_mesh_file
from brake_fenicsx.micro import load_laws
from brake_fenicsx.results.run import read_run
from brake_fenicsx.scene.samples_section import Distribution, complete
from brake_fenicsx.surface import read_topography

PACKAGE = Path(arrays.__file__).parents[1]
HUGE = 2**40


def sample(path):
    store = Store(path.parents[1])
    return store.samples.load(("joint", 0))


def shapes(path):
    class Run:
        directory = path.parent

    return shapes_of(Run)


# Where an npz file is read -> its name there, and what reads it.
NPZ = {
    "scan": ("scan.npz", read_topography),
    "random values": (
        "values.npz",
        lambda p: complete(Distribution("measured", file=p.name), "contact.a.friction", p.parent),
    ),
    "matrix": ("K.npz", read_matrix),
    "laws": ("laws.npz", load_laws),
    "surface of a run": ("surface.npz", lambda p: read_run(p.parent)),
    "faces of a run": ("contact_faces.npz", lambda p: read_run(p.parent)),
    "shapes of a run": ("shapes.npz", shapes),
    "cache": ("cache/undamped.npz", lambda p: Store(p.parents[1]).load("cache/undamped.npz")),
    "mapped cache": (
        "cache/a.npz", lambda p: Store(p.parents[1]).load("cache/a.npz", mapped=True),
    ),
    "sample": ("samples/joint-00000.npz", sample),
}  # fmt: skip


def npz(array, compressed=False, name="heights"):
    out = io.BytesIO()
    (np.savez_compressed if compressed else np.savez)(out, **{name: array})
    return out.getvalue()


def member(content, name="heights.npy", compressed=True):
    """An npz file of one member with any content."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", 8 if compressed else 0) as archive:
        archive.writestr(name, content)
    return out.getvalue()


def declared(shape, there=b"12345678", kind="<f8"):
    """A npy file whose header declares more than follows."""
    out = io.BytesIO()
    about = {"descr": kind, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(out, about)
    return out.getvalue() + there


WHOLE = npz(np.arange(1000.0).reshape(20, 50))


def changed(content, at, to):
    return content[:at] + to + content[at + len(to) :]


def everywhere(content, signature, offset, to):
    """A field of every header of a zip file set to other bytes."""
    for match in re.finditer(re.escape(signature), content):
        content = changed(content, match.start() + offset, to)
    return content


def flagged(content):
    """The flag of encryption in both headers."""
    return everywhere(everywhere(content, b"PK\1\2", 8, b"\1\0"), b"PK\3\4", 6, b"\1\0")


def unknown(content):
    """A kind of compression that nobody has."""
    return everywhere(everywhere(content, b"PK\1\2", 10, b"\x63\0"), b"PK\3\4", 8, b"\x63\0")


DAMAGE = {
    "empty": b"",
    "halved": WHOLE[: len(WHOLE) // 2],
    "no archive": b"heights" * 50,
    "a byte": changed(WHOLE, 500, b"\xff"),
    "a compressed byte": changed(npz(np.arange(1000.0), True), 700, b"\xff\xfe"),
    "encrypted": flagged(WHOLE),
    "unknown compression": unknown(WHOLE),
    "more than follows": member(declared((HUGE,))),
    "negative sides": member(declared((-1, -1))),
    "an object": npz(np.array([{}], dtype=object)),
    "no header": member(b"\x93NUMPY\1\0\xff\xff"),
    "text": member(b"1 2 3\n"),
}


@pytest.mark.hard
@pytest.mark.parametrize("kind", DAMAGE)
@pytest.mark.parametrize("place", NPZ)
def test_a_damaged_npz_file_is_one_line_wherever_it_is_read(tmp_path, place, kind):
    """Damaged npz files (cut, changed, encrypted, oversized): one line each in all ten readers."""
    name, read = NPZ[place]
    file = tmp_path / name
    file.parent.mkdir(exist_ok=True)
    file.write_bytes(DAMAGE[kind])
    with pytest.raises(SceneError, match=r"cannot be read") as caught:
        read(file)
    text = str(caught.value)
    assert len(text) < 500 and ("npz" in text or "as " in text)
    if place != "matrix":  # whose reader is told the file by the key of the scene
        assert file.name in text


def test_compressed_zeros_take_no_more_than_a_stated_limit(tmp_path):
    """A hundred million zeros compress to a thousandth; measured heights never do."""
    (tmp_path / "a.npz").write_bytes(npz(np.zeros(10**8, np.int8), True))
    with pytest.raises(SurfaceError, match="declares 100000128 bytes"):
        read_topography(tmp_path / "a.npz", size=(1e-3, 1e-3))


def test_arrays_that_nobody_asked_for_are_not_read(tmp_path):
    """An unused array may be damaged: it is not opened."""
    file = tmp_path / "a.npz"
    np.savez(file, heights=np.random.default_rng(1).normal(size=(9, 7)), other=np.zeros(99))
    content = file.read_bytes()
    at = content.rindex(np.zeros(9).tobytes())
    file.write_bytes(changed(content, at, b"\1"))
    assert read_topography(file, size=(1e-3, 1e-3)).shape == (9, 7)
    with pytest.raises(SceneError, match="CRC"), reading(file, "as an npz file"):
        read_npz(file)


def test_arrays_come_back_as_they_were(tmp_path):
    """Kinds, orders and shapes that numpy writes: read as numpy reads them."""
    rng = np.random.default_rng(2)
    given = {
        "a": rng.normal(size=(3, 4)), "b": np.asfortranarray(rng.normal(size=(3, 4))),
        "c": np.array("text"), "d": np.array(["a", "bcd"]), "e": np.zeros((0, 5)),
        "f": rng.normal(size=7) + 1j, "g": np.array(True), "h": np.arange(5, dtype=">i2"),
        "i": np.array("", dtype=str), "j": np.uint64(2**63),
    }  # fmt: skip
    for save in (np.savez, np.savez_compressed):
        save(tmp_path / "a.npz", **given)
        own = read_npz(tmp_path / "a.npz")
        with np.load(tmp_path / "a.npz") as theirs:
            assert [*own] == theirs.files
            for name, a in own.items():
                b = theirs[name]
                assert a.dtype == b.dtype and a.shape == b.shape and np.array_equal(a, b)
                assert a.flags.writeable and a.flags.f_contiguous == b.flags.f_contiguous


def test_mapped_arrays_are_compared_with_their_checksums(tmp_path):
    """Two changed bytes of a large array: not seen when it is mapped, found by the check."""
    store = Store(tmp_path)
    large = np.arange(2**18, dtype=float)
    store.save("a.npz", large=large, small=np.arange(3))
    store.check_mapped("a.npz")
    file = tmp_path / "a.npz"
    at = file.read_bytes().index(large[1000:1002].tobytes())
    file.write_bytes(changed(file.read_bytes(), at, b"\7\7"))
    assert store.load("a.npz", mapped=True)["large"][1000] != 1000
    with pytest.raises(SceneError, match=r"a\.npz: .*another checksum.*remove this file"):
        store.check_mapped("a.npz")
    store.check_mapped("none.npz")


def test_hdf5_is_neither_followed_nor_believed(tmp_path):
    """Links to other files, sizes without content, groups and texts: a line each."""
    other = tmp_path / "other.h5"
    with h5py.File(other, "w") as file:
        file["heights"] = np.zeros((4, 4))
    makes = {
        "is a link": lambda f: f.__setitem__("heights", h5py.ExternalLink("other.h5", "heights")),
        "is a link;": lambda f: f.__setitem__("heights", h5py.SoftLink("/size")),
        "declares 3200000000 bytes": lambda f: f.create_dataset(
            "heights", (20000, 20000), "f8", chunks=(100, 100)
        ),
        "no data set of numbers": lambda f: f.create_group("heights"),
        "no data set": lambda f: f.__setitem__("heights", "text"),
        "in other files": lambda f: f.create_dataset(
            "heights", (4, 4), "f8", external=[("raw.bin", 0, 128)]
        ),
    }
    for text, make in makes.items():
        with h5py.File(tmp_path / "scan.h5", "w") as file:
            file["size"] = np.ones(2)
            make(file)
        with pytest.raises(SurfaceError, match=text):
            read_topography(tmp_path / "scan.h5")
    (tmp_path / "scan.h5").write_bytes(other.read_bytes()[:900])
    with pytest.raises(SurfaceError, match="cannot be read as an HDF5 file"):
        read_topography(tmp_path / "scan.h5")


MARKET = "%%MatrixMarket matrix "


@pytest.mark.parametrize(
    ("name", "content", "text"),
    [
        ("K.mtx", f"{MARKET}coordinate real general\n9 9 9000000000\n1 1 1\n", "entries"),
        ("K.mtx", f"{MARKET}coordinate real general\n9000000000 9000000000 1\n1 1 1\n", "rows"),
        ("K.mtx", f"{MARKET}array real general\n100000 100000\n1\n", "entries"),
        ("K.txt", "1 1 1.0\n4000000000 4000000000 1.0\n", "rows"),
    ],
)
def test_sizes_of_matrices_are_compared_with_the_file(tmp_path, name, content, text):
    """Four matrices of some ten bytes that declare up to 72 GB: a line each, no memory taken."""
    (tmp_path / name).write_text(content)
    with pytest.raises(SceneError, match=rf"cannot be read as a matrix \(.*{text}"):
        read_matrix(tmp_path / name)


def test_indices_of_sparse_matrices_are_not_believed(tmp_path):
    """An index beyond the columns would be read from foreign memory."""
    A = sp.identity(4, format="csr")
    for change in ({"indices": np.array([0, 1, 2, 10**6], np.int32)}, {"shape": [4, HUGE]}):
        held = {"format": "csr", "shape": A.shape, "data": A.data, "indices": A.indices,
                "indptr": A.indptr} | change  # fmt: skip
        np.savez(tmp_path / "K.npz", **held)
        with pytest.raises(SceneError, match="cannot be read as a matrix"):
            read_matrix(tmp_path / "K.npz")
    for kind in ("csr", "csc", "coo", "bsr", "dia"):
        sp.save_npz(tmp_path / "K.npz", sp.identity(4, format=kind))
        assert (read_matrix(tmp_path / "K.npz").A != A).nnz == 0


BOX = """$MeshFormat
2.2 0 8
$EndMeshFormat
$Nodes
4
1 0 0 0
2 1 0 0
3 0 1 0
4 0 0 1
$EndNodes
$Elements
1
1 4 2 1 1 1 2 3 4
$EndElements
"""


def options_after(path, name):
    """An option of gmsh while the file is read."""
    found = []
    with gmsh_session() as gmsh:
        finalize, gmsh.finalize = gmsh.finalize, lambda: None
        try:
            read_mesh_file(path)
        except SceneError as error:
            found.append(str(error))
        finally:
            gmsh.finalize = finalize
        return [gmsh.option.getNumber(name), *found]


@pytest.mark.hard
@pytest.mark.parametrize(
    "content",
    [
        "// nothing\nMesh.MeshSizeFactor = 7;\n",
        "\n" + BOX,
        " " + BOX,
        "",
        "$Mesh",
        "$MeshFormats\n",
    ],
)
def test_a_mesh_file_that_is_none_never_reaches_gmsh(tmp_path, content):
    """A .msh that does not begin as a mesh is refused by its first line: gmsh would run it."""
    (tmp_path / "a.msh").write_text(content)
    value, text = options_after(tmp_path / "a.msh", "Mesh.MeshSizeFactor")
    assert value == 1 and "does not begin with $MeshFormat" in text


def test_options_beside_a_mesh_file_are_not_read(tmp_path):
    """Gmsh reads a.msh.opt with a.msh: here it is shown the mesh alone."""
    (tmp_path / "a.msh").write_text(BOX)
    (tmp_path / "a.msh.opt").write_text("Mesh.MeshSizeFactor = 7;\n")
    assert options_after(tmp_path / "a.msh", "Mesh.MeshSizeFactor") == [1]
    with gmsh_session() as gmsh:  # so that the test sees it where it is not so
        gmsh.open(str(tmp_path / "a.msh"))
        assert gmsh.option.getNumber("Mesh.MeshSizeFactor") == 7


@pytest.mark.parametrize("name", ["a.msh", "a.vtu", "a.med", "a.bdf", "a.inp", "a.cdb", "a.mesh"])
@pytest.mark.parametrize("content", [b"", b"\0\1\2\3" * 40, b"$MeshFormat\n2.2 0 8\n$EndMesh"])
def test_damaged_meshes_are_one_line_that_names_the_reader(tmp_path, name, content):
    """Whatever gmsh, meshio and our own readers stumble over: a SceneError."""
    (tmp_path / name).write_bytes(content)
    with pytest.raises(SceneError) as caught:
        read_mesh_file(tmp_path / name)
    assert "whole mesh file" not in str(caught.value)


def test_a_deck_that_includes_itself_or_doubles_ends(tmp_path):
    """A ring of includes, and thirty files that each include the next one twice: a line each."""
    (tmp_path / "a.inp").write_text("*INCLUDE, INPUT=b.inp\n")
    (tmp_path / "b.inp").write_text("*INCLUDE, INPUT=a.inp\n")
    for k in range(30):
        (tmp_path / f"{k}.inp").write_text(f"*INCLUDE, INPUT={k + 1}.inp\n" * 2)
    (tmp_path / "30.inp").write_text("*NODE\n1,0,0,0\n")
    (tmp_path / "many.inp").write_text("*NODE\n1,0,0,0\n*NSET, NSET=a, GENERATE\n1, 1000000000\n")
    for name, text in (
        ("a", "includes itself"),
        ("0", "more than 1000"),
        ("many", "more than 1000"),
    ):
        with pytest.raises(SceneError, match=text):
            read_mesh_file(tmp_path / f"{name}.inp")


def test_pipes_and_devices_are_no_files(tmp_path):
    """A named pipe would wait for ever, a device never end."""
    import os

    os.mkfifo(tmp_path / "pipe.inp")
    (tmp_path / "a.inp").write_text("*INCLUDE, INPUT=pipe.inp\n")
    (tmp_path / "zero.npz").symlink_to("/dev/zero")
    for read, name in (
        (read_mesh_file, "pipe.inp"), (read_mesh_file, "a.inp"), (read_matrix, "zero.npz"),
        (lambda p: read_sets(p, {55}), "pipe.inp"),
    ):  # fmt: skip
        with pytest.raises(SceneError, match="a device or pipe"):
            read(tmp_path / name)
    with pytest.raises(SceneError, match="a folder"), reading(tmp_path, "as text"):
        pass


def test_nobody_else_opens_array_files():
    """What opens them is called in one module; HDF5 is read in a block of ``reading``."""
    opens = re.compile(r"np\.load\(|load_npz\(|np\.fromfile|np\.memmap|allow_pickle=True")
    found = {
        str(p.relative_to(PACKAGE)) for p in PACKAGE.rglob("*.py") if opens.search(p.read_text())
    }
    assert not found
    parses = re.compile(
        r"csv\.reader\(|loadtxt\(|h5py\.File\(\w+\)|\.open_topography|meshio\.read\(|UFF\(str\(file"
    )
    read = {p for p in PACKAGE.rglob("*.py") if parses.search(p.read_text())}
    assert len(read) > 4 and all(re.search(r"\breading[(,]", p.read_text()) for p in read)


def test_a_grid_that_its_points_do_not_fill_takes_no_memory(tmp_path):
    """Points along a diagonal: a grid of a hundred million places for ten thousand heights."""
    k = np.arange(10_000.0)
    np.savetxt(tmp_path / "a.txt", np.column_stack([k, k, np.sin(k)]), fmt="%.6g")
    tracemalloc.start()
    with pytest.raises(SurfaceError, match="fill no grid"):
        read_topography(tmp_path / "a.txt", height_unit="um")
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 0.1 * 8 * k.size**2
