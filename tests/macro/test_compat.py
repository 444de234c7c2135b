"""What differs between builds of the libraries: refused with one line, or not noticed at all."""

import os

import numpy as np
import pytest
from dolfinx import mesh

from brake_fenicsx import compat
from brake_fenicsx.cli import main
from brake_fenicsx.errors import SceneError


@pytest.mark.together
def test_a_petsc_of_complex_scalars_is_refused_before_anything_is_written(
    comm, tmp_path, monkeypatch, capsys
):
    """One line with the build and the remedy, exit status 2, no results folder."""
    from pathlib import Path

    scene = Path(__file__).parents[2] / "scripts" / "scenes" / "block_on_plate.toml"

    class Complex:
        ScalarType = np.complex128

    monkeypatch.setattr(compat, "PETSc", Complex)
    monkeypatch.setenv("PETSC_DIR", "/usr/lib/petscdir/petsc-complex")
    monkeypatch.chdir(tmp_path)
    assert main(["run", str(scene)]) == 2
    error = capsys.readouterr().err
    # The first process speaks for all.
    assert error.count("\n") == (comm.rank == 0)
    for words in ("petsc-complex", "complex numbers", "python3-dolfinx-real"):
        assert (words in error) == (comm.rank == 0)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(SceneError, match="complex"):
        compat.require_real_petsc()


def test_the_petsc_of_the_tests_is_real():
    compat.require_real_petsc()


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_what_versions_say_differently_is_the_same(comm, cell):
    """Names, degrees, geometry and dof tables of a cube of two cells a side."""
    domain = mesh.create_unit_cube(comm, 2, 2, 2, getattr(mesh.CellType, cell))
    V = compat.vector_space(domain, 2)
    assert compat.cell_name(domain) == cell
    assert compat.degree(V) == 2
    nodes = {"tetrahedron": (4, 10, 3), "hexahedron": (8, 27, 4)}[cell]
    assert compat.geometry_dofs(domain).shape[1] == nodes[0]
    assert compat.cell_dofs(V, np.arange(1)).shape == (1, nodes[1])
    assert {len(f) for f in compat.facet_vertices(domain)} == {nodes[2]}
    x, w = compat.triangle_rule(4)
    assert w.sum() == pytest.approx(0.5, rel=1e-14)
    # A quartic: int x^3 y over the triangle is 3! 1! / 6!.
    assert np.sum(w * x[:, 0] ** 3 * x[:, 1]) == pytest.approx(6 / 720, rel=1e-13)


def test_forms_of_a_folder_that_cannot_be_written_to_are_linked_into_one_that_can(
    tmp_path, monkeypatch
):
    """As in a read-only image: what was compiled is found, what is missing finds a place."""
    given = tmp_path / "fenics"
    given.mkdir()
    (given / "form.c").write_text("compiled")
    assert compat.forms_folder(given) == given
    real = os.access
    # Root may write anywhere, whatever the mode.
    monkeypatch.setattr(
        os, "access", lambda path, mode: not (path == given and mode & os.W_OK) and real(path, mode)
    )
    own = compat.forms_folder(given)
    assert own != given
    assert (own / "form.c").read_text() == "compiled"
    (own / "new.c").write_text("new")
    assert [file.name for file in given.iterdir()] == ["form.c"]


def test_forms_find_a_place_where_the_folder_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("")
    own = compat.forms_folder(tmp_path / "file" / "fenics")
    assert own.is_dir() and list(own.iterdir()) == []
