"""Runs of a scene with some keys replaced, each in a folder of its own below one."""

import gc
import json
import resource
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

from mpi4py import MPI

from brake_fenicsx import pipeline
from brake_fenicsx.errors import BrakeError, StorageError
from brake_fenicsx.folder import files, processes, store
from brake_fenicsx.folder.log import logger, start_log
from brake_fenicsx.scene import Scene, read_scene
from brake_fenicsx.scene.digest import result_digest

RECORD = "runs.json"
T = TypeVar("T")


class Runs:
    """The runs of one folder, collective; what is finished is not done again.

    Attributes:
        file: path of the scene.
        comm: processes that share the work.
        folder: where the runs are.
        overrides: "key=value" replacements of all of them.
        cache: folder of laws and reduced models that they share.
        record: of every finished run, by its name, a hash of what was asked, and the seconds and
            memory [MB] that it took.
    """

    def __init__(
        self, file: str | Path, comm: MPI.Comm, folder: Path, overrides: Sequence[str],
        cache: str | Path | None = None,
    ):  # fmt: skip
        """Read what an earlier call recorded; nothing is written."""
        self.file, self.comm, self.folder, self.overrides = file, comm, folder, list(overrides)
        self.cache = Path(cache) if cache else folder / "cache"
        self.record: dict[str, dict[str, Any]] = processes.on_first(self._recorded, comm)
        self._held = comm.allreduce(_resident())

    def _recorded(self) -> dict[str, dict[str, Any]]:
        with suppress(FileNotFoundError, ValueError):
            kept = json.loads((self.folder / RECORD).read_text("utf-8"))
            return {name: entry for name, entry in kept.items() if "seconds" in entry}
        return {}

    def read(self, changes: Sequence[str] = ()) -> Scene:
        """The scene with some changes."""
        return read_scene(self.file, [*self.overrides, *changes])

    def is_done(self, name: str, changes: Sequence[str] = ()) -> bool:
        """Whether a run is finished, of the scene as it is now."""
        return self.record.get(name, {}).get("asked") == self._asked(changes)

    def run(self, name: str, changes: Sequence[str] = (), limit: float | None = None) -> Path:
        """Run the scene with some changes, or what is left of it, and record what it took.

        Args:
            name: of its folder.
            changes: "key=value" replacements beside those of all runs.
            limit: time for it [s]; without a limit if None.

        Returns:
            Its results folder.

        Raises:
            BrakeError: the run failed, or its time was over.
        """
        folder = self.folder / name
        if self.is_done(name, changes):
            return folder
        logger.info("%s ...", folder)
        left, start = self.comm.allreduce(_resident()) - self._held, time.perf_counter()
        try:
            with processes.limited(limit, self.comm):
                done = pipeline.run(
                    self.file, self.comm, folder, [*self.overrides, *changes], cache=self.cache
                )
        except processes.TimeUp:
            took = time.perf_counter() - start
            raise BrakeError(f"stopped after {took:.0f} s, no time is left") from None
        finally:
            # What follows is not of this run.
            kept = self.comm.rank == 0 and self.folder.is_dir()
            start_log(self.comm.rank, self.folder / "log.txt" if kept else None)
        peak, seconds = max(done.peak_memory_mb.values()), time.perf_counter() - start
        entry = {"memory_mb": round(peak - max(left, 0.0)), "seconds": seconds}
        self.record[name] = self.comm.bcast(entry | {"asked": self._asked(changes)}, root=0)
        if kept:
            store.Store(self.folder).save_json(RECORD, self.record)
        return folder

    def _asked(self, changes: Sequence[str]) -> str:
        scene = self.read(changes)
        return files.digest([result_digest(scene), scene.table])


def or_note(work: Callable[[], T]) -> tuple[T | None, str]:
    """What some work gives, or nothing and why; a folder that cannot be written ends all work."""
    try:
        return work(), ""
    except StorageError:
        raise
    except BrakeError as error:
        logger.warning("%s", error)
        return None, str(error)


def _resident() -> float:
    """Memory that this process holds between two runs [MB]; its peak begins anew from here.

    Matrices of a run may outlive it; what is held when a run begins is no part of its peak. Those
    of PETSc are destroyed on all processes together, as MPI asks for.
    """
    gc.collect()
    processes.release_memory()
    with suppress(OSError):  # Where the system is no Linux, nothing is taken off.
        Path("/proc/self/clear_refs").write_text("5", "utf-8")
        pages = int(Path("/proc/self/statm").read_text("utf-8").split()[1])
        return pages * resource.getpagesize() / 2**20
    return 0.0
