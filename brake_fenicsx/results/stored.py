"""Stored samples of a folder, read block by block: their modes and inputs as columns, families.

Rows stand in the order of the tasks: no order of work shows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.arguments import AnyArray, Array, Complex, Index
from brake_fenicsx.folder.sample_files import Task
from brake_fenicsx.folder.store import Store

from .families import ModeFamilies
from .sample_blocks import SampleBlock, StoredBlocks, Tabulation
from .tables import MODES, TEXTS, Columns, Value, as_array, ma

Data = dict[str, Any]

PROVEN = "proven"  # kind of a count, see ``brake_fenicsx.stability.modes.Count``
# Numbers and texts of every sample, for samples.csv and the summary.
KNOWN = "tolerance_missed", "count_kind", "counted", "lost", "beyond_laws"
TOOK = "stability_seconds", "equilibrium_seconds", "equilibrium_iterations"
SCALARS = "status", "seed", "mean_mu", "rejected", *KNOWN, *TOOK


class StoredSamples:
    """Samples of a folder.

    Attributes:
        store: the results folder.
        tasks: approach and number of each sample that is asked for.
        first: approach and number of the first good sample of each approach, and its arrays.
        members: vectors and frequencies of the first mode of each family.
        modes: columns of modes.csv.
    """

    def __init__(self, store: Store, tasks: Sequence[Task], tabulate: Tabulation | None = None):
        """Read the samples.

        Args:
            store: the results folder.
            tasks: approach and number of each sample.
            tabulate: how samples become columns; with what all scenes have in common if None.
        """
        self.store, self.tasks = store, [*tasks]
        tabulate = tabulate or Tabulation()
        self.first: dict[Task, Data] = {}
        self.members = ModeFamilies(known=tabulate.founders)
        self._squealing: dict[int, NDArray[np.complex64]] = {}
        self._beyond = ModeFamilies()
        self._blocks = StoredBlocks(store, tasks, tabulate)
        self._there: list[Task] = []
        self._scalars: dict[str, list[Any]] = {name: [] for name in SCALARS}
        self._random: list[dict[str, float]] = []
        self._forces: dict[str, list[Array]] = {}
        families: list[NDArray[np.int32]] = []
        layers: list[str] = []
        for block in self._blocks:
            for task, status in zip(block.tasks, block.scalars("status", ""), strict=True):
                if status == "ok" and all(task[0] != name for name, _ in self.first):
                    self.first[task] = store.samples.load(task) or {}
            families.append(self._families(block, len(tabulate.founders.vectors)))
            self._there += block.tasks
            for name, values in self._scalars.items():
                values += block.scalars(name, None)
            drawn = zip(block.each("random_names"), block.each("random"), strict=True)
            self._random += [
                {} if n is None or x is None else dict(zip(map(str, n), map(float, x), strict=True))
                for n, x in drawn
            ]
            for (approach, _), forces in zip(block.tasks, block.each("forces"), strict=True):
                if forces is not None:
                    self._forces.setdefault(approach, []).append(forces.copy())
            if not layers:
                named = (names for names in block.each("layers") if names is not None)
                layers = [str(name) for name in next(named, ())]
        self.modes = StoredModes(self._blocks, families, layers)

    def _families(self, block: SampleBlock, known: int) -> NDArray[np.int32]:
        """Number of every family that the block knows, shape (families + 1,), the last one -1.

        Families of the block are matched to those of earlier ones, not to the ones that it knew:
        their modes did not match these, or another mode of the sample did.
        """
        new = block.beside("vectors")
        numbers = np.arange(known + len(new))
        if len(new):
            more = self._beyond.add(new.T, block.beside("frequencies"), block.beside("grow"))
            numbers[known:] = known + more
            founded = slice(len(self.members.vectors) - known, None)
            self.members.vectors += self._beyond.vectors[founded]
            self.members.frequencies += self._beyond.frequencies[founded]
        squealing = zip(block.beside("squealing"), block.beside("squealing_vectors"), strict=True)
        for n, vector in squealing:
            self._squealing.setdefault(int(numbers[n]), vector)
        # Modes of no family have the number -1, that of the last one.
        return np.append(numbers, -1).astype(np.int32)

    def of_each(self, name: str) -> list[Any]:
        """A number or text of each sample that is there, see ``SCALARS``; None of those without."""
        return self._scalars[name]

    def forces(self) -> dict[str, Array]:
        """Forces on the pads of each approach, shape (good samples, pads, numbers)."""
        return {name: np.array(values) for name, values in self._forces.items()}

    @cached_property
    def rows(self) -> dict[str, list[Value]]:
        """Columns of samples.csv.

        There is a column for each random input, one of rejected draws where materials are random,
        and, where there are modes, two of what they leave open: tolerance_missed, the modes whose
        estimated error exceeds stability.tolerance, and complete, whether it is proven that no mode
        is missing.
        """
        columns: dict[str, list[Value]] = {"approach": [name for name, _ in self._there]}
        columns |= {"sample": [k for _, k in self._there], "status": self.of_each("status")}
        columns |= {"seed": self.of_each("seed"), "mu": self.of_each("mean_mu")}
        names = sorted({name for drawn in self._random for name in drawn})
        columns |= {name: [drawn.get(name) for drawn in self._random] for name in names}
        if any(name.startswith("materials.") for name in names):
            columns["rejected"] = self.of_each("rejected")
        kinds = self.of_each("count_kind")
        if any(kind is not None for kind in kinds):
            columns["tolerance_missed"] = self.of_each("tolerance_missed")
            columns["complete"] = [k and ("yes" if k == PROVEN else "no") for k in kinds]
        return columns

    @property
    def samples(self) -> dict[str, AnyArray]:
        """The same as arrays, shape (samples,)."""
        return {name: as_array(values, name in TEXTS) for name, values in self.rows.items()}

    def with_arrays(self, *starts: str) -> Iterator[tuple[Task, Data, NDArray[np.int32]]]:
        """Samples that have arrays of their own, such as derivatives or limit cycles.

        Args:
            starts: how the names of the arrays begin.

        Yields:
            The task, arrays by name with "s", "damping", "verdict" and "condition", and the family
            of each mode.
        """
        for block, numbers in zip(self._blocks, self.modes.families, strict=True):
            if not (names := [name for name in block.names if name.startswith(starts)]):
                continue
            every = [*names, "s", "damping", "verdict", "condition", "family"]
            for task, *arrays in zip(block.tasks, *map(block.each, every), strict=True):
                data = {n: a for n, a in zip(every, arrays, strict=True) if a is not None}
                if any(name in data for name in names):
                    yield task, data, numbers[data.pop("family")]

    @property
    def squealing_members(self) -> dict[int, Complex]:
        """Vector of the first mode that squeals of each family, by its number."""
        return {n: self._squealing[n].astype(complex) for n in sorted(self._squealing)}


class StoredModes(Mapping[str, Any]):
    """Columns of modes.csv, put together from the blocks each time they are asked for.

    A study has 10^8 cells; those of few samples are kept. Where there are several blocks, texts are
    pandas categories.

    Attributes:
        families: of each block the number of every family that it knows.
    """

    def __init__(
        self, blocks: StoredBlocks, families: list[NDArray[np.int32]], layers: Sequence[str]
    ):
        """Take the blocks.

        Args:
            blocks: the blocks.
            families: of each of them the number of every family that it knows.
            layers: of the brake, that have a share of the energy of a mode.
        """
        self.families = families
        self._blocks, self._layers = blocks, layers
        self._kept: dict[str, Any] = {}
        self._names = [*MODES]
        if self.any:
            self._names += ["partner", *(f"share_{name}" for name in layers)]

    @cached_property
    def any(self) -> bool:
        """Whether a sample has modes."""
        return any("s" in block for block in self._blocks)

    @property
    def rows(self) -> int:
        """Number of modes of all samples."""
        return sum(int(block.sizes("s").sum()) for block in self._blocks if "s" in block)

    def parts(self, *names: str) -> Iterator[Columns]:
        """Columns of each block that has modes, by default all; masked values are empty cells."""
        for columns in self._columns():
            yield {name: columns[name]() for name in names or self._names}

    def rows_of(self, which: Index) -> dict[str, Any]:
        """Some rows, by ascending number, of all columns: none of these is put together whole."""
        parts: dict[str, list[Any]] = {name: [] for name in self._names}
        first, empty = 0, set[str]()
        for columns in self._columns():
            last = first + len(columns["mode"]())
            here = which[slice(*np.searchsorted(which, (first, last)))] - first
            for name, part in parts.items():
                whole = columns[name]()
                empty |= {name} if _has_empty(whole) else set()
                part.append(self._compact(whole[here]))
            first = last
        return {name: self._joined(name, part, name in empty) for name, part in parts.items()}

    def _columns(self) -> Iterator[dict[str, Callable[[], Any]]]:
        for block, numbers in zip(self._blocks, self.families, strict=True):
            if "s" in block:
                yield _mode_columns(block, numbers, self._layers)

    def __getitem__(self, name: str) -> Any:
        if name not in self._names:
            raise KeyError(name)
        if name in self._kept:
            return self._kept[name]
        parts = [self._compact(columns[name]()) for columns in self._columns()]
        whole = self._joined(name, parts, any(map(_has_empty, parts)))
        if len(self._blocks) == 1:
            self._kept[name] = whole
        return whole

    def _compact(self, part: Any) -> Any:
        """A column of a block; texts as numbers of categories, where there are several blocks."""
        if len(self._blocks) == 1 or part.dtype.kind != "U":
            return part
        import pandas as pd

        return pd.Categorical(part)

    def _joined(self, name: str, parts: list[Any], empty: bool) -> Any:
        """A column of those of all blocks: floats are double, and empty cells nan, if any are."""
        if not parts:
            return as_array([], name in TEXTS)
        kind = parts[0].dtype.kind
        if kind == "O":
            from pandas.api.types import union_categoricals

            return union_categoricals(parts)
        if kind not in "iuf" or (kind in "iu" and not empty):
            return np.concatenate([ma.getdata(part) for part in parts])
        whole = np.empty(sum(map(len, parts)))
        ends = np.cumsum([len(part) for part in parts])
        for part, end in zip(parts, ends, strict=True):
            here = whole[end - len(part) : end]
            here[:] = ma.getdata(part)
            here[ma.getmaskarray(part)] = np.nan
        return whole

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


def _has_empty(part: Any) -> bool:
    return isinstance(part, ma.MaskedArray) and bool(ma.getmaskarray(part).any())


def _mode_columns(
    block: SampleBlock, numbers: NDArray[np.int32], layers: Sequence[str]
) -> dict[str, Callable[[], Any]]:
    """What makes each column: the fixed ones, the flutter partner, and one share per layer."""
    sizes = block.sizes("s")
    approaches, samples = (np.array(values) for values in zip(*block.tasks, strict=True))

    def mode() -> NDArray[np.int16]:
        start = np.repeat(np.cumsum(sizes) - sizes, sizes)
        return (np.arange(sizes.sum()) - start).astype(np.int16)

    def partners() -> Any:
        pairs = zip(block.each("partner"), sizes, strict=True)
        whole = np.concatenate([np.full(n, -1) if a is None else a for a, n in pairs])
        return ma.masked_less(whole.astype(np.int32), 0)

    def share(i: int) -> Any:
        pairs = zip(block.each("shares"), sizes, strict=True)
        return ma.masked_invalid(
            np.concatenate([np.full(n, np.nan) if a is None else a[i] for a, n in pairs])
        )

    def stored(name: str) -> Callable[[], AnyArray]:
        # A view would hold all the pages of its file that were read.
        return lambda: block.column(name).copy()

    return {
        "approach": lambda: np.repeat(approaches, sizes),
        "sample": lambda: np.repeat(samples.astype(np.int32), sizes),
        "mode": mode,
        "frequency_hz": lambda: np.abs(block.column("s").imag) / (2 * np.pi),
        "real_1_s": lambda: block.column("s").real.copy(),
        "damping": stored("damping"), "residual": stored("residual"),
        "error_estimate": stored("error"), "condition": stored("condition"),
        "verdict": stored("verdict"), "family": lambda: numbers[block.column("family")],
        "partner": partners,
        **{f"share_{name}": partial(share, i) for i, name in enumerate(layers)},
    }  # fmt: skip
