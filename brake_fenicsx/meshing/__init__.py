"""Plain meshes on one process: from gmsh builders or files, swept, mirrored, measured."""
