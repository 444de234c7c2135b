"""A scene prepared once, and its modes at any values of its scalars: for scripts and notebooks."""

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from mpi4py import MPI

import numpy as np
from numpy.typing import ArrayLike, NDArray

from brake_fenicsx.arguments import likely, listed, of_kind, positive, quantity, with_its_arguments
from brake_fenicsx.checks import check
from brake_fenicsx.display import html_table
from brake_fenicsx.errors import SceneError
from brake_fenicsx.executor import Source, loaded, samples_elsewhere, samples_here
from brake_fenicsx.extensions import Extensions
from brake_fenicsx.folder import files, lock
from brake_fenicsx.folder.store import Store, check_folder
from brake_fenicsx.macro.equilibrium import Equilibrium
from brake_fenicsx.pipeline import before_samples, make_study
from brake_fenicsx.samples.study import Study
from brake_fenicsx.scene import Scene, read_scene
from brake_fenicsx.scene.digest import result_digest
from brake_fenicsx.scene.keys import KeyMistake
from brake_fenicsx.scene.read import from_text, scene_text, toml_text, with_objects
from brake_fenicsx.scene.samples_section import Range, Sweep, unit_of
from brake_fenicsx.scene.scalars import check_scalar, meant, si_unit
from brake_fenicsx.stability.modes import Modes
from brake_fenicsx.stages import Run
from brake_fenicsx.sweeps.sweep_study import Branches

Array = NDArray[np.float64]


class Model:
    """A scene whose brake, laws and reduced model are made.

    Pickled, it is the folder that it was prepared in, which other processes load.

    Attributes:
        scene: the scene.
        study: its samples.
        source: what it was prepared from; None with extensions, which are no plain values.
    """

    _load: Callable[[], Study]

    def __init__(self, study: Study, source: Source | None, folder: TemporaryDirectory[str] | None):
        self.scene: Scene = study.scene
        self.study: Study = study
        self.source: Source | None = source
        self._folder = folder

    def __reduce__(self) -> tuple[Any, ...]:
        """Where the model was prepared, for another process."""
        if self.source is None:
            raise SceneError("""pickle: a model with extensions, objects of this process; name their
                classes in the section [extensions] of the scene""")
        return _sent, (self.source, self.study.store.digest)

    def __getattr__(self, name: str) -> Any:
        """Scene and samples of a model that was sent here, loaded when first asked for."""
        if name not in ("scene", "study") or "_load" not in self.__dict__:
            raise AttributeError(f"{type(self).__name__} has no attribute {name!r}")
        self.study = self._load()
        self.scene = self.study.scene
        return self.__dict__[name]

    def __repr__(self) -> str:
        """One line."""
        approaches = ", ".join(self.scene.samples.approaches)
        return (
            f"Model({self.scene.file.name}: {approaches}; {self.study.brake.size()['dofs']} dofs)"
        )

    def _repr_html_(self) -> str:
        """What was prepared, as a table of a notebook."""
        rows: list[list[Any]] = [["samples", len(self.study.tasks)]]
        rows += [[name.replace("_", " "), x] for name, x in self.study.brake.size().items()]
        if (stability := self.scene.stability) is not None:
            rows.append(["band [Hz]", "{:g} to {:g}".format(*stability.band)])
            rows.append(["threshold", stability.threshold])
        return html_table(repr(self), ("", ""), rows)

    @with_its_arguments
    def modes(
        self,
        values: Mapping[str, float | str] | None = None,
        approach: str | None = None,
        sample: int = 0,
    ) -> Modes:
        """Complex modes of a sample at its braking equilibrium.

        Args:
            values: scalars of the scene by dotted key, SI or with their unit, "1 bar"; others as
                in the sample.
            approach: one of the scene's; its first if None.
            sample: number of the sample.

        Raises:
            SceneError: no such approach, key or sample.
            NotConverged: no equilibrium.
        """
        return self.equilibrium_and_modes(values, approach, sample)[1]

    @with_its_arguments
    def equilibrium_and_modes(
        self,
        values: Mapping[str, float | str] | None = None,
        approach: str | None = None,
        sample: int = 0,
    ) -> tuple[Equilibrium, Modes]:
        """The same with the equilibrium."""
        return self.study.solved(self._task(approach, sample), self._si(values))

    def work_beside(
        self,
        what: str,
        values: Mapping[str, float | str] | None = None,
        approach: str | None = None,
        sample: int = 0,
    ) -> dict[str, Any]:
        """Arrays that an extra computes beside the modes of a sample, by name.

        Args:
            what: one of ``study.beside``.
            values: scalars of the scene, as in ``modes``.
            approach: likewise.
            sample: likewise.
        """
        return self.study.work_beside(what, self._task(approach, sample), self._si(values))

    @with_its_arguments
    def samples(
        self,
        n: int | None = None,
        approach: str | None = None,
        executor: Executor | None = None,
        chunksize: int = 1,
    ) -> Iterator[dict[str, Any]]:
        """Samples of the scene as ``run`` computes them, one after the other as they end.

        Each is stored in the folder of the model, where a later call, or ``run``, finds it. A
        worker loads that folder, which all of them must see, and computes with the BLAS threads of
        its environment: OMP_NUM_THREADS, set to 1 for processes that this one starts, if it is
        not set.

        Args:
            n: number of samples, the first ones; all of ``samples.n`` if None.
            approach: one of the scene's; its first if None.
            executor: of ``concurrent.futures`` (its processes spawned, not forked), mpi4py.futures,
                dask, parsl or submitit; this process computes them in order if None.
            chunksize: samples of a job of the executor.

        Yields:
            One record for each sample: ``approach``, ``sample``, ``status`` ("ok", or why it
            failed) and, of a good one, ``seed``, ``random_names`` and ``random`` [SI], the values
            of its inputs, and of its modes ``s`` = alpha + i omega [1/s], ``frequency`` [Hz],
            ``damping`` [-], ``verdict``, ``error`` and ``residual``, shape (modes,).

        Raises:
            SceneError: no such approach or number of samples; a worker cannot load the folder.
            BrakeError: workers ended before they had stored their samples, which it names; raised
                after all other samples.
        """
        of_kind("n", n, (int, np.integer, type(None)), "a number of samples")
        of_kind("chunksize", chunksize, (int, np.integer), "a number of samples")
        positive(chunksize=chunksize)
        chosen, _ = self._task(approach, 0 if n is None else n - 1)
        tasks = [task for task in self.study.tasks if task[0] == chosen][:n]
        if executor is None:
            return samples_here(self, tasks)
        if not hasattr(executor, "submit"):
            of_kind("executor", executor, Executor, "one of concurrent.futures, or None")
        if self.source is None:
            raise SceneError("executor: extensions are objects of this process alone; leave it out")
        return samples_elsewhere(self, tasks, self.source, executor, chunksize)

    @with_its_arguments
    def sweep(
        self,
        key: str,
        values: ArrayLike,
        approach: str | None = None,
        sample: int = 0,
        tolerance: float = 1e-4,
    ) -> Branches:
        """Follow the modes of a sample over a scalar of the scene.

        Args:
            key: dotted key of the scalar, as in ``[sweep.parameters]``.
            values: SI or with their unit, "1 bar", rising or falling, shape (values,).
            approach: one of the scene's; its first if None.
            sample: number of the sample.
            tolerance: accuracy of the events, relative to the range of the values.

        Raises:
            SceneError: no such approach, key or sample.
            NotConverged: no equilibrium at one of the values.
        """
        from brake_fenicsx.sweeps.branches import follow
        from brake_fenicsx.sweeps.events import find_events
        from brake_fenicsx.sweeps.matching import Points

        unit = _unit(self.scene, key)
        x = listed("values", values, unit)
        stability = self.scene.stability
        if stability is None:
            raise SceneError(f"{self.scene.file}: stability: the section is missing")
        solve = Points(self.study, self._task(approach, sample), key, ends=(x[0], x[-1]))
        followed = follow(solve, [float(v) for v in x], (stability.band[0], stability.band[1]))
        events = find_events(followed, solve, stability.threshold, tolerance)
        place = {float(v): i for i, v in enumerate(x)}
        frequency, damping = np.full((2, len(followed.branches), x.size), np.nan)
        for branch in followed.branches:
            for state, mode in zip(branch.states, branch.modes, strict=True):
                there = followed.states[state]
                if (i := place.get(there.x)) is not None:
                    frequency[branch.number, i] = there.frequency[mode]
                    damping[branch.number, i] = there.damping[mode]
        ends, name = [b.end for b in followed.branches], f"{key} [{unit or '-'}]"
        return Branches(x, frequency, damping, events, ends, name, stability.threshold)

    def _si(self, values: Mapping[str, float | str] | None) -> dict[str, float]:
        """Checked values of scalars, SI."""
        of_kind("values", values or {}, Mapping, "a mapping of keys to numbers")
        return {k: quantity(k, v, _unit(self.scene, k)) for k, v in (values or {}).items()}

    def _task(self, approach: str | None, sample: int) -> tuple[str, int]:
        named = self.scene.samples.approaches
        chosen = named[0] if approach is None else approach
        count = sum(task[0] == chosen for task in self.study.tasks)
        if sample not in range(count):
            raise SceneError(f"""{self.scene.file}: sample {sample} of {chosen!r}: approaches are
                {", ".join(named)}, and it has {count}
                samples{"" if count else likely(chosen, named)}""")
        return chosen, sample


def _sent(source: Source, digest: str) -> Model:
    """A model in the process that it was sent to."""
    model = Model.__new__(Model)
    model.source, model._load, model._folder = source, partial(loaded, source, digest), None
    return model


@with_its_arguments
def prepare(
    scene: str | Path | Mapping[str, Any],
    overrides: Sequence[str] = (),
    directory: str | Path | None = None,
    cache: str | Path | None = None,
    parameters: Mapping[str, Sequence[float | str]] | None = None,
    comm: MPI.Comm | None = None,
    extensions: Extensions | None = None,
) -> Model:
    """Make what the samples of a scene share: brake, laws, reduced model; collective.

    Args:
        scene: path of the scene, or its sections and keys as a mapping, whose paths start from
            the working directory.
        overrides: "key=value" replacements in the scene.
        directory: results folder, kept; a temporary one if not given.
        cache: folder of laws and reduced models that runs of similar scenes share.
        parameters: dotted key -> lowest and highest value, SI or with their unit, of scalars that
            enter the matrices of the bodies and will take other values than in the scene. A library
            of laws follows E* of the lining, laws that the scene writes do not.
        comm: processes; this process alone if None.
        extensions: laws of contact and friction, damping terms and laws of inputs in place of the
            scene's; then without directory and cache, whose files are known by the scene alone.

    Raises:
        SceneError: the scene is wrong, or has no stage equilibrium.

    Example:
        >>> band = ["stability.band=['0 Hz', '6 kHz']"]
        >>> model = prepare("scripts/scenes/block_on_plate.toml", band)
        >>> model.scene.samples.approaches, round(1e6 * float(model.study.brake.w.sum()))  # [mm^2]
        (('multi-scale',), 800)
    """
    comm = MPI.COMM_SELF if comm is None else comm
    parsed = read_scene(scene, overrides)
    given = {
        key: tuple(float(v) for v in listed(key, ends, _unit(parsed, key)))
        for key, ends in (parameters or {}).items()
    }
    parsed = _with_ranges(parsed, given)
    if extensions is not None and (directory is not None or cache is not None):
        raise SceneError(f"""{parsed.file}: extensions: leave out directory and cache, whose files
            are known by the scene alone""")
    folder = None
    if directory is None:
        # One folder of all processes; the first one removes it.
        if comm.rank == 0:
            folder = TemporaryDirectory(prefix="brake_fenicsx-")
        directory = comm.bcast(folder.name if folder is not None else None)
    shared = None if cache is None else Path(cache)
    study = _prepared(parsed, Store(Path(directory)), comm, shared, extensions)
    table = toml_text(scene) if isinstance(scene, Mapping) else ""
    paths = str(parsed.file.resolve()), str(Path(directory).resolve())
    source = Source(paths[0], tuple(overrides), tuple(given.items()), paths[1], table)
    return Model(study, None if extensions else source, folder)


def entered(source: Source) -> Study:
    """What the samples of a prepared model share, loaded from its folder as a share of a run does.

    Args:
        source: of the model.

    Raises:
        SceneError: the folder is of another scene.
    """
    store = Store(Path(source.directory))
    store.share = lock.Share(1, 1)
    scene = from_text(source.table) if source.table else source.scene
    parsed = read_scene(scene, source.overrides, Path(source.scene).parent)
    return _prepared(_with_ranges(parsed, dict(source.parameters)), store, MPI.COMM_SELF)


def _with_ranges(parsed: Scene, parameters: Mapping[str, Sequence[float]]) -> Scene:
    """A scene that sweeps over these ranges too: it prepares what many values share."""
    if "equilibrium" not in parsed.stages:
        raise SceneError(f"{parsed.file}: stages: 'equilibrium' is missing")
    ranges = {key: Range(values=tuple(values)) for key, values in parameters.items()}
    swept = parsed.sweep or Sweep()
    return replace(parsed, sweep=replace(swept, parameters={**swept.parameters, **ranges}))


def _prepared(
    parsed: Scene,
    store: Store,
    comm: MPI.Comm,
    cache: Path | None = None,
    extensions: Extensions | None = None,
) -> Study:
    """Brake, laws and reduced model, made or loaded from the folder; collective."""
    if comm.size == 1 and "mpi4py.futures" in sys.modules:
        from brake_fenicsx.libraries import start_petsc

        # PETSc starts on all processes together, and those of a pool wait for work elsewhere.
        start_petsc(comm=comm)
    check_folder(store, result_digest(parsed), comm)
    surfaces = check(parsed, comm)
    if extensions is not None:
        parsed = with_objects(parsed, extensions)
    this = Run(parsed, comm, store, files.SharedCache(store, cache))
    if store.share is None:
        store.open(scene_text(parsed))
    brake, library = before_samples(this, surfaces)
    if brake is None:
        raise SceneError(f"{parsed.file}: stages: 'equilibrium' is missing")
    return make_study(this, surfaces, library, brake)


def _unit(scene: Scene, key: str) -> str:
    """SI unit of a scalar; refused if it takes no other values, or acts on nothing."""
    try:
        unit_of(key)
        check_scalar(scene, key, key)
        return si_unit(scene, key)
    except KeyMistake as error:
        said = f"no such number of the scene{hint}" if (hint := meant(scene, key)) else str(error)
        raise SceneError(f"{scene.file}: {key}: {said}") from None
    except SceneError as error:
        hint = meant(scene, key) if "there is no" in str(error) else ""
        raise SceneError(f"{scene.file}: {error}{hint}") from None


@with_its_arguments
def sample(model: Model, inputs: Mapping[str, float | str] | None = None) -> Modes:
    """Complex modes of a prepared scene at some values of its scalars: a plain function of numbers.

    Args:
        model: the scene, see ``prepare``.
        inputs: dotted key -> value, SI or with its unit; the scene's own for all others.

    Raises:
        SceneError: no such key.
        NotConverged: no equilibrium.

    Example:
        >>> band = ["stability.band=['0 Hz', '6 kHz']"]
        >>> model = prepare("scripts/scenes/block_on_plate.toml", band)
        >>> modes = sample(model, {"contact.block_plate.friction": 0.3})
        >>> f"{modes.frequency[0] / 1e3:.1f} kHz, {sum(modes.damping < 0)} unstable"
        '1.9 kHz, 0 unstable'
    """
    of_kind("model", model, Model, "what `prepare` returns")
    return model.modes(inputs)


@with_its_arguments
def sweep(
    scene: str | Path | Mapping[str, Any] | Model, key: str, values: ArrayLike, **chosen: str | int
) -> Branches:
    """Follow the modes of a scene over one of its scalars.

    Args:
        scene: path of the scene, the scene as a mapping, or a model that was prepared.
        key: dotted key of the scalar, as in ``[sweep.parameters]``.
        values: SI or with their unit, rising or falling, shape (values,).
        **chosen: ``approach``, ``sample`` and ``tolerance`` of ``Model.sweep``.

    Example:
        >>> scene, key = "scripts/scenes/block_on_plate.toml", "contact.block_plate.friction"
        >>> found = sweep(prepare(scene, ["stability.band=['0 Hz', '6 kHz']"]), key, [0.0, 0.3])
        >>> found.frequency.shape[1], found.values
        (2, array([0. , 0.3]))
    """
    if not isinstance(scene, Model):
        x = listed("values", values, _unit(read_scene(scene), key))
        scene = prepare(scene, parameters={key: [float(x.min()), float(x.max())]})
    return scene.sweep(key, values, **chosen)  # type: ignore[arg-type]
