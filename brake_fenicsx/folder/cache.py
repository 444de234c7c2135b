"""Cache of files that results folders share, each under a hash of what it depends on.

Laws, the order of the dofs and the reduced models depend on a part of a scene alone. Of scenes that
differ elsewhere (seed, friction, its distribution, a load) the first makes them, the others link
to them.
"""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mpi4py import MPI

from brake_fenicsx import __version__
from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.log import logger
from brake_fenicsx.folder.store import Store
from brake_fenicsx.folder.versions import FORMAT
from brake_fenicsx.scene import Scene
from brake_fenicsx.scene.files import file_digests

# Keys of an interface that mesh, matrices and contact elements do not depend on.
_LAWS = ("law", "gap", "friction", "friction_in_equilibrium")


class SharedCache:
    """Files that one results folder shares with others."""

    def __init__(self, store: Store, directory: Path | None = None):
        """Look at the directory.

        Args:
            store: the results folder.
            directory: the shared folder, made if it is not there; None: nothing is shared.

        Raises:
            SceneError: it is no folder, or cannot be written to.
        """
        self.store, self.directory = store, directory
        if directory is None:
            return
        try:
            directory.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise SceneError(f"--cache {directory}: {error.strerror}; name a folder") from None
        if not os.access(directory, os.W_OK):
            raise SceneError(f"--cache {directory}: cannot be written to; name another folder")

    @contextmanager
    def shared(self, name: str, depends: Callable[[], Any], comm: MPI.Comm) -> Iterator[None]:
        """Take a file before it is asked for, and leave it after it was made; collective.

        Args:
            name: the file's name in the results folder.
            depends: gives all that its content depends on, plain values; called by process 0, and
                only where there is a shared folder.
            comm: processes of the run.
        """
        if self.directory is None:
            yield
            return
        if comm.rank > 0:
            comm.Barrier()
            yield
            return
        stem, suffix = os.path.splitext(os.path.basename(name))
        there = self.directory / f"{stem}-{_digest(depends())}{suffix}"
        own = self.store.path(name)
        if there.exists() and not own.exists():
            logger.info("%s: from %s", name, there)
            _link(there, own)
        comm.Barrier()
        yield
        if own.exists() and not there.exists():
            try:
                _link(own, there)
            except OSError as error:
                why = error.strerror or error
                logger.warning(
                    "%s: cannot be written (%s); the run continues without it", there, why
                )


def bodies_key(scene: Scene) -> dict[str, Any]:
    """Key of the bodies: what mesh, matrices and contact elements of a scene depend on."""
    names = ("parts", "mesh", "materials", "supports", "springs", "masses")
    out: dict[str, Any] = {name: scene.table.get(name) for name in names}
    if "ties" in scene.table:
        out["ties"] = scene.table["ties"]
    out["contact"] = {
        name: {k: v for k, v in table.items() if k not in _LAWS}
        for name, table in scene.table.get("contact", {}).items()
    }
    out["loads"] = [
        face if load.pressure is not None else [face, load.force, load.moment, load.displacement]
        for face, load in sorted(scene.loads.items())
    ]
    out["motion"] = {k: v for k, v in scene.table.get("motion", {}).items() if k != "speed"}
    out["files"] = _files(scene, "mesh.", "parts.")
    versions = (getattr(sys.modules.get(name), "__version__", "") for name in ("dolfinx", "gmsh"))
    return {**out, "versions": [__version__, *map(str, versions)]}


def laws_key(scene: Scene) -> dict[str, Any]:
    """Key of the laws: what the laws of a scene depend on."""
    surface = scene.table.get("surface")
    out = {"surface": surface, "micro": scene.table.get("micro"), "versions": [__version__, FORMAT]}
    out["patch"] = scene.micro.patch if scene.micro else None  # that of the mesh as a length
    return {**out, "files": _files(scene, "surface.")}


def _digest(content: Any) -> str:
    return Scene.hash(content)[:16]


def _files(scene: Scene, *sections: str) -> dict[str, str]:
    return {key: d for key, d in file_digests(scene).items() if key.startswith(sections)}


def _link(source: Path, target: Path) -> None:
    """The same file where the file system allows it, else a copy; whole or not at all."""
    part = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        try:
            os.link(source, part)
        except OSError:
            shutil.copyfile(source, part)
        os.replace(part, target)
    finally:
        part.unlink(missing_ok=True)
