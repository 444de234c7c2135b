"""A scene's parts to its mesh: builders, the user's own file, or both."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module

from mpi4py import MPI

from brake_fenicsx.errors import SceneError
from brake_fenicsx.scene import Scene

from .mesh import Builder, Mesh, build_mesh, check_parts


def scene_parts(scene: Scene) -> dict[str, Builder]:
    """Builder module and parameters of each part that has a builder."""
    return {
        name: (import_module(f"brake_fenicsx.geometry.{part.builder}"), part.parameters)
        for name, part in scene.parts.items()
        if part.builder is not None
    }


def scene_mesh(scene: Scene, comm: MPI.Comm) -> Mesh:
    """Mesh of all parts of a scene.

    Raises:
        SceneError: a part or the mesh file is wrong, or the mesh too bad; on all ranks.
    """
    try:
        return build_mesh(scene_parts(scene), comm, scene.mesh)
    except SceneError as error:
        raise SceneError(f"{scene.file}: {error}") from None


def check_mesh(scene: Scene, faces: Mapping[str, str], comm: MPI.Comm) -> None:
    """Refuse what cannot be built, before anything is meshed.

    Args:
        scene: the scene.
        faces: key of the scene -> face that it names.
        comm: communicator of the run.

    Raises:
        SceneError: a part's parameters, the mesh file or a face's name is wrong; on all ranks.
    """
    try:
        check_parts(scene_parts(scene), faces, comm, scene.mesh)
    except SceneError as error:
        raise SceneError(f"{scene.file}: {error}") from None
