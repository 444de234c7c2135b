"""Endings of files that a command is given where it needs another kind."""

# Mesh files of which init writes a first scene.
MESH_FILES = frozenset({
    ".inp", ".cdb", ".bdf", ".nas", ".fem", ".msh", ".med", ".vtu", ".vtk", ".exo", ".e", ".mesh",
    ".cgns", ".mdpa", ".xdmf",
})  # fmt: skip
