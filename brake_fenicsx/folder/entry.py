"""A run enters its results folder: alone, or as one of several shares of the samples."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from typing import TypeVar

from mpi4py import MPI

from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.lock import BEAT, Lock
from brake_fenicsx.folder.log import logger
from brake_fenicsx.folder.processes import on_first
from brake_fenicsx.folder.store import PREPARED, RUNNING, Store

T = TypeVar("T")

FOLDER, SHARE = "folder", "share"  # what a run claims


def check_folder(store: Store, digest: str, comm: MPI.Comm) -> None:
    """Refuse a folder of another scene; collective.

    The first process alone looks into it: it may be writing there already while others look.

    Args:
        store: the folder.
        digest: hash of the scene.
        comm: processes of the run.

    Raises:
        SceneError: as ``Store.check``.
    """
    _on_first(lambda: store.check(digest), store, comm)
    store.digest = digest


def open_folder(store: Store, scene: str, from_stage: str | None, comm: MPI.Comm) -> None:
    """Make or enter the results folder and have it alone; collective.

    Args:
        store: the folder.
        scene: text of the scene's file.
        from_stage: stage whose results are forgotten, with those of all later ones.
        comm: processes of the run.

    Raises:
        SceneError: it cannot be written, belongs to another scene, or another run is in it.
    """

    def work() -> None:
        store.lock = lock = Lock(store.path(RUNNING))
        _take(store, lock, FOLDER, f"{SHARE}-*")
        # Another run may have been quicker with another scene.
        store.check(store.digest)
        store.open(scene, from_stage)

    _on_first(work, store, comm)


def enter_prepared(store: Store, wanted: Sequence[str], command: str, comm: MPI.Comm) -> None:
    """Enter a folder that was prepared, to compute a share of its samples; collective.

    Args:
        store: the folder, with the share.
        wanted: approaches of the scene.
        command: what prepares the folder.
        comm: processes of the run.

    Raises:
        SceneError: it was not prepared for all approaches; another run has it, or this share.
    """

    def work() -> None:
        mark = store.path(PREPARED)
        missing = {*wanted} - {*(json.loads(mark.read_text("utf-8")) if mark.exists() else ())}
        if missing:
            raise SceneError(f"""-o {store.directory}: not prepared for
                {", ".join(sorted(missing))}; {command}, with the same changes, makes what all
                shares need""")
        store.lock = lock = Lock(store.path(RUNNING))
        _take(store, lock, f"{SHARE}-{store.share}".replace(" ", "-"), FOLDER)

    _on_first(work, store, comm)


def _take(store: Store, lock: Lock, claim: str, others: str) -> None:
    """Take the claim, where no other run has it or one of the others."""
    while owner := lock.claim(claim) or lock.owner(others):
        if not lock.overdue(owner):
            break
        logger.info("waiting for a sign of life, or the end of it: %s", lock.described(owner))
        time.sleep(BEAT)
    else:
        return
    raise SceneError(f"""-o {store.directory}: another run is at work there,
        {lock.described(owner)}; wait for its end or stop it, or choose another folder; to divide
        the samples among runs, see `prepare` and --share""")


def _on_first(work: Callable[[], T], store: Store, comm: MPI.Comm) -> T:
    """What the first process does in the folder; what goes wrong there is raised on all."""

    def guarded() -> T:
        try:
            return work()
        except OSError as error:
            why = error.strerror or str(error)
            raise SceneError(f"""-o {store.directory}: cannot be written ({why}); choose another
                folder with -o""") from None

    return on_first(guarded, comm)
