"""Columns of a block of samples: what the tables need of them, tabulated once by who packs them.

Modes of different blocks belong to one family where both know it: families are founded by the first
samples of every approach, before any block is full. A mode that matches none of these founds a
family of its block, and families of blocks are matched when the tables are written. A study of no
more samples than a block has one pass over them.
"""

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brake_fenicsx.arguments import AnyArray, Ints
from brake_fenicsx.folder import sample_files
from brake_fenicsx.folder.arrays import Arrays
from brake_fenicsx.folder.sample_files import FOLDER, Task
from brake_fenicsx.folder.store import Store

from .families import ModeFamilies
from .squeal import squeals

# Of every contact element, coordinate or degree of freedom: no table has them of all samples.
OF_MODES = "coordinates", "driver_map", "driver_work", "vectors", "vector_mode"
OF_CONTACT = "g", "g_cr", "p", "k", "k_vibration", "law", "mu", "mu_equilibrium", "moved"
LARGE = frozenset({*OF_MODES, *OF_CONTACT})
FOUNDING = 64  # samples of each approach whose families all blocks know
FOUNDERS = f"{FOLDER}/families.npz"


@dataclass(frozen=True)
class Tabulation:
    """How the samples of a study become columns.

    Attributes:
        threshold: a mode squeals where its damping lies below minus this.
        founders: families that all blocks know.
    """

    threshold: float = 0.0
    founders: ModeFamilies = field(default_factory=ModeFamilies)

    @cached_property
    def mark(self) -> str:
        """Hash of the families that all blocks know, and of how modes are matched to them."""
        vectors = [*self.founders.vectors, *self.founders.grown.values()]
        return hashlib.sha256(b"planes" + b"".join(v.tobytes() for v in vectors)).hexdigest()

    def __call__(self, tasks: Sequence[Task], load: Callable[[Task], Arrays | None]) -> Arrays:
        """Columns of some samples.

        Args:
            tasks: approach and number of each.
            load: arrays of a sample; None where it is not there.
        """
        members = ModeFamilies(known=self.founders)
        squealing: dict[int, NDArray[np.complex64]] = {}
        rows, there = [], []
        for task in tasks:
            data = load(task)
            if data is None:
                continue
            row = {name: v for name, v in data.items() if name not in LARGE}
            if str(data["status"]) == "ok":
                row |= self._of_good(data, members, squealing)
            rows.append(row)
            there.append(task)
        new = len(self.founders.vectors)
        loud = [squealing[n] for n in sorted(squealing)]
        return {
            **_packed(rows), "approaches": np.array([name for name, _ in there], dtype=str),
            "numbers": np.array([number for _, number in there], dtype=np.int64),
            "founders": np.array(self.mark), "vectors": np.array(members.vectors[new:]),
            "frequencies": np.array(members.frequencies[new:]),
            "grow": np.array([n in members.grown for n in range(new, len(members.vectors))], bool),
            "squealing": np.array(sorted(squealing), dtype=np.int64),
            "squealing_vectors": np.array(loud),
        }  # fmt: skip

    def _of_good(
        self, data: Mapping[str, Any], members: ModeFamilies, squealing: dict[int, AnyArray]
    ) -> Arrays:
        """Families of the modes of a good sample."""
        if "s" not in data:
            return {}
        if "coordinates" not in data:
            return {"family": np.full(data["s"].size, -1, dtype=np.int32)}
        family = _added(members, data)
        for i in np.flatnonzero(squeals(data, self.threshold)):
            squealing.setdefault(int(family[i]), data["coordinates"][:, i].copy())
        return {"family": family}


def tabulation_of(store: Store, tasks: Sequence[Task], threshold: float | None) -> Tabulation:
    """How the samples of a folder become columns; its founders are found where there are many.

    Args:
        store: the results folder.
        tasks: approach and number of each sample.
        threshold: a mode squeals where its damping lies below minus this; None without modes.
    """
    many = threshold is not None and len(tasks) > sample_files.BLOCK
    return Tabulation(threshold or 0.0, founders_of(store, tasks) if many else ModeFamilies())


def founders_of(store: Store, tasks: Sequence[Task]) -> ModeFamilies:
    """Families of the first samples of every approach, those kept in the folder if they are."""
    made, known = ModeFamilies(), store.load(FOUNDERS)
    if known is not None and "grown" in known:
        made.vectors = [*known["vectors"]]
        made.frequencies = [float(f) for f in known["frequencies"]]
        made.grown = {int(n): v for n, v in zip(known["grown"], known["growing"], strict=True)}
        return made
    for task in tasks:
        data = store.samples.load(task) if task[1] < FOUNDING else None
        if data is not None and "coordinates" in data:
            _added(made, data)
    return made


def keep_founders(store: Store, tasks: Sequence[Task]) -> None:
    """Keep these families in the folder, for all blocks that are packed from now on."""
    made = founders_of(store, tasks)
    every = {"vectors": np.array(made.vectors), "frequencies": np.array(made.frequencies)}
    grown = {"grown": np.array([*made.grown], int), "growing": np.array([*made.grown.values()])}
    store.save(FOUNDERS, **every, **grown)


def _added(members: ModeFamilies, data: Mapping[str, Any]) -> NDArray[np.int32]:
    """Family of each mode of one more sample."""
    frequencies = np.abs(data["s"].imag) / 2 / np.pi
    grows = data["verdict"] == "unstable"
    return members.add(data["coordinates"].astype(complex), frequencies, grows).astype(np.int32)


class SampleBlock:
    """Samples of a block, as columns.

    Attributes:
        tasks: approach and number of each sample that is there.
    """

    def __init__(self, columns: Arrays):
        """Take columns as ``Tabulation`` makes them."""
        pairs = zip(columns["approaches"], columns["numbers"], strict=True)
        self.tasks: list[Task] = [(str(approach), int(number)) for approach, number in pairs]
        self._columns = columns
        self._shapes = dict(zip(map(str, columns["names"]), columns["shapes"], strict=True))

    def beside(self, name: str) -> AnyArray:
        """A copy of an array of the block itself, beside those of its samples."""
        # All columns share the bytes of their file, which what is kept must not hold.
        return self._columns[name].copy()

    def __contains__(self, name: str) -> bool:
        return name in self._shapes

    @property
    def names(self) -> list[str]:
        """Names of the arrays of the samples."""
        return [*self._shapes]

    def sizes(self, name: str) -> Ints:
        """Number of values of each sample, shape (samples,)."""
        shapes = self._shapes[name]
        return np.where(shapes[:, 0] < 0, 0, shapes[:, 1:].prod(axis=1, dtype=np.int64))

    def column(self, name: str) -> AnyArray:
        """Values of all samples that have the array, one after the other, shape (values,)."""
        values = self._columns[name]
        words = self._columns.get(f"{name}.words")
        return values if words is None else words[values]

    def each(self, name: str) -> list[AnyArray | None]:
        """The array of each sample, in its shape; None of those without."""
        if name not in self:
            return [None] * len(self.tasks)
        values, shapes, sizes = self.column(name), self._shapes[name], self.sizes(name)
        ends = np.cumsum(sizes)
        return [
            None if shape[0] < 0 else values[i:j].reshape(shape[1 : 1 + shape[0]])
            for i, j, shape in zip(ends - sizes, ends, shapes, strict=True)
        ]

    def scalars(self, name: str, default: Any) -> list[Any]:
        """The number or text of each sample, and what stands for it where there is none."""
        if name not in self:
            return [default] * len(self.tasks)
        values = iter(self.column(name))
        return [next(values).item() if there else default for there in self.sizes(name)]


class StoredBlocks:
    """All blocks of some samples, in the order of the tasks; looked at again and again."""

    def __init__(self, store: Store, tasks: Sequence[Task], tabulate: Tabulation):
        """Group the samples.

        Args:
            store: the results folder.
            tasks: approach and number of each sample wanted.
            tabulate: how samples become columns that are not packed, or not with its founders.
        """
        self._store, self._tabulate = store, tabulate
        self._made: dict[tuple[str, int], SampleBlock] = {}
        self._groups: dict[tuple[str, int], list[Task]] = {}
        for task in tasks:
            many = len(tasks) > sample_files.BLOCK
            key = (task[0], task[1] // sample_files.BLOCK) if many else ("", 0)
            self._groups.setdefault(key, []).append(task)

    def __len__(self) -> int:
        return len(self._groups)

    def __iter__(self) -> Iterator[SampleBlock]:
        """Columns of each block: of an archive mapped into memory, else tabulated once."""
        for key, group in self._groups.items():
            if key not in self._made:
                columns = None
                if len(group) == sample_files.BLOCK and len({name for name, _ in group}) == 1:
                    columns = self._store.samples.columns(group[0])
                if columns is not None and str(columns["founders"]) == self._tabulate.mark:
                    yield SampleBlock(columns)
                    continue
                self._made[key] = SampleBlock(self._tabulate(group, self._store.samples.load))
            yield self._made[key]


def _packed(rows: Sequence[Mapping[str, AnyArray]]) -> Arrays:
    """Arrays of several samples as one array a name; texts are numbers of words.

    ``shapes`` has for each name and sample the number of dimensions, -1 where a sample has no such
    array, and the lengths, shape (names, samples, 3).
    """
    names = list(dict.fromkeys(name for row in rows for name in row))
    shapes = np.ones((len(names), len(rows), 3), dtype=np.int32)
    out: Arrays = {"names": np.array(names, dtype=str), "shapes": shapes}
    for name, own in zip(names, shapes, strict=True):
        arrays = [np.asarray(row[name]) if name in row else None for row in rows]
        for shape, a in zip(own, arrays, strict=True):
            shape[: 1 if a is None else 1 + a.ndim] = (-1,) if a is None else (a.ndim, *a.shape)
        values = np.concatenate([a.ravel() for a in arrays if a is not None])
        if values.dtype.kind == "U":
            out[f"{name}.words"], places = np.unique(values, return_inverse=True)
            values = places.astype(np.int32)
        out[name] = values
    return out
