"""Cache of files that results folders share, each under a hash of what it depends on.

Laws, the order of the dofs and the reduced models depend on a part of a scene alone. Of scenes that
differ elsewhere (seed, friction, its distribution, a load) the first makes them, the others link
to them.
"""

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mpi4py import MPI

from brake_fenicsx.errors import SceneError, StorageError

from .files import digest, whole_file
from .log import logger
from .store import Store


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
        there = self.directory / f"{stem}-{digest(depends())[:16]}{suffix}"
        own = self.store.path(name)
        if there.exists() and not own.exists():
            logger.info("%s: from %s", name, there)
            _link(there, own)
        comm.Barrier()
        yield
        if own.exists() and not there.exists():
            try:
                _link(own, there)
            except StorageError as error:
                text = "%s: cannot be written (%s); the run continues without it"
                logger.warning(text, there, error.__cause__)


def _link(source: Path, target: Path) -> None:
    """The same file where the file system allows it, else a copy; whole or not at all."""
    with whole_file(target) as part:
        try:
            os.link(source, part)
        except OSError:
            shutil.copyfile(source, part)
