"""Columns of blocks of samples: what the tables read is what the samples hold, packed or not."""

import numpy as np
import pytest

from brake_fenicsx.folder import sample_files
from brake_fenicsx.folder.store import Store
from brake_fenicsx.results import sample_blocks as blocks
from brake_fenicsx.results.output import sample_facts
from brake_fenicsx.results.run import eigenvalue_errors
from brake_fenicsx.results.sample_blocks import SampleBlock, Tabulation
from brake_fenicsx.results.stored import StoredSamples

TASKS = [("joint", k) for k in range(10)]
TABULATE = Tabulation(1e-3)


def sample(k, rng):
    """A sample; every fourth fails, and numbers of modes differ."""
    if k % 4 == 3:
        return {"status": f"error {k}", "seed": k}
    modes = 3 + k % 2
    damping = rng.normal(size=modes)
    # One of five directions and some noise, so that families recur.
    shapes = np.eye(5)[:, rng.permutation(5)[:modes]] + 0.1 * rng.normal(size=(5, modes))
    return {
        "status": "ok", "seed": k, "mu": rng.random(3), "p": rng.random(4), "g": rng.random(4),
        "mean_mu": rng.random(), "forces": rng.random((1, 2)),
        "random_names": np.array(["contact.a.friction", "materials.b.E"]), "random": rng.random(2),
        "rejected": k, "s": damping + 1j * (1.0 + 0.01 * rng.random(modes)), "damping": damping,
        "residual": rng.random(modes), "error": rng.random(modes), "condition": np.ones(modes),
        "verdict": np.where(damping < 0, "unstable", "stable"), "count_kind": "proven",
        "counted": "inertia",
        "tolerance_missed": k, "partner": np.arange(modes) - 1, "layers": np.array(["a", "b"]),
        "shares": rng.random((2, modes)), "coordinates": shapes.astype(np.complex64),
        **{f"{name}_seconds": 1.0 + k for name in ("stability", "equilibrium")},
        "equilibrium_iterations": k,
    }  # fmt: skip


@pytest.fixture
def stored(tmp_path, monkeypatch):
    """What makes a folder of ten samples in blocks of four."""
    monkeypatch.setattr(sample_files, "BLOCK", 4)
    monkeypatch.setattr(blocks, "FOUNDING", 3)

    def make(name, tabulate=None):
        store = Store(tmp_path / name)
        store.digest = "this"
        store.path("samples").mkdir(parents=True)
        store.samples.tabulate = tabulate
        rng = np.random.default_rng(1)
        for task in TASKS:
            store.samples.save(task, **sample(task[1], rng))
        return store

    return make


def tables(store, tabulate, tasks=TASKS):
    """Rows of both tables, figures of the summary, families."""
    stored = StoredSamples(store, tasks, tabulate)
    parts = [*stored.modes.parts()]
    modes = {name: np.ma.concatenate([p[name] for p in parts]).tolist() for name in parts[0]}
    for name, values in modes.items():
        column = np.asarray(stored.modes[name])
        wanted = np.array([np.nan if v is None else v for v in values])
        assert np.array_equal(column, wanted, equal_nan=column.dtype.kind == "f")
        for some in (np.arange(0, column.size, 3), np.arange(0)):
            chosen = np.asarray(stored.modes.rows_of(some)[name])
            assert chosen.dtype.kind == column.dtype.kind
            assert np.array_equal(chosen, column[some], equal_nan=column.dtype.kind == "f")
    whole = eigenvalue_errors({name: np.asarray(stored.modes[name]) for name in modes})
    assert np.array_equal(eigenvalue_errors(stored.modes), whole, equal_nan=True)
    heads, rows = [*stored.rows], [*map(list, zip(*stored.rows.values(), strict=True))]
    forces = {name: values.tolist() for name, values in stored.forces().items()}
    vectors = np.array(stored.members.vectors)
    squealing = {n: v.tolist() for n, v in stored.squealing_members.items()}
    return modes, heads, rows, sample_facts(stored), forces, vectors.tolist(), squealing


def with_founders(store):
    return Tabulation(TABULATE.threshold, blocks.founders_of(store, TASKS))


def test_columns_give_back_each_array(tmp_path):
    """Of every shape, with samples that lack it, and texts."""
    rows = [{"a": np.arange(6.0).reshape(2, 3), "t": np.array(["x", "yy"]), "n": np.array(3)},
            {"t": np.array([""])}, {"a": np.zeros((2, 0)), "n": np.array(4)}]  # fmt: skip
    data = dict(zip(TASKS, rows, strict=False))
    columns = Tabulation()(
        TASKS[:4], lambda task: data.get(task) and {"status": "no", **data[task]}
    )
    block = SampleBlock(columns)
    assert block.tasks == TASKS[:3]
    for name in ("a", "t", "n"):
        for row, there in zip(rows, block.each(name), strict=True):
            assert (there is None) == (name not in row)
            assert there is None or (there.shape, there.tolist()) == (
                row[name].shape, row[name].tolist()
            )  # fmt: skip
    assert block.scalars("n", -1) == [3, -1, 4] and block.scalars("b", None) == [None] * 3


def test_packed_blocks_give_the_tables_of_the_samples(stored, monkeypatch):
    """And no sample of theirs is read, but the first good one."""
    plain = stored("plain")
    tabulate = with_founders(plain)
    packed = stored("packed", tabulate)
    one, read = tables(plain, tabulate), []
    load = packed.samples.load
    monkeypatch.setattr(packed.samples, "load", lambda task: read.append(task[1]) or load(task))
    two = tables(packed, tabulate)
    assert one == two
    assert sorted(read) == [0, 8, 9]


def test_rows_are_those_of_the_samples(stored):
    store = stored("plain")
    modes, heads, rows, facts, forces, *_ = tables(store, with_founders(store))
    good = {k: store.samples.load(("joint", k)) for k in range(10) if k % 4 != 3}
    assert modes["sample"] == [k for k, d in good.items() for _ in d["s"]]
    assert modes["mode"] == [i for d in good.values() for i in range(d["s"].size)]
    assert modes["damping"] == [x for d in good.values() for x in d["damping"]]
    assert modes["partner"] == [p if p >= 0 else None for d in good.values() for p in d["partner"]]
    assert modes["share_b"] == [x for d in good.values() for x in d["shares"][1]]
    assert heads[4:] == ["mu", "contact.a.friction", "materials.b.E", "rejected",
                         "tolerance_missed", "complete"]  # fmt: skip
    assert rows[3] == ["joint", 3, "error 3", 3, *[None] * 6]
    d = good[2]
    assert rows[2] == ["joint", 2, "ok", 2, d["mean_mu"], *d["random"], 2, 2, "yes"]
    assert facts["failed_samples"] == 2 and facts["samples"]["joint"]["good"] == 8
    assert facts["samples"]["joint"]["rejected_draws"] == sum(good)
    assert forces["joint"] == [d["forces"].tolist() for d in good.values()]


def test_families_of_blocks_are_those_of_one_pass(stored, monkeypatch):
    """Where the first samples have them all; a mode of each sample at most has a family."""
    store = stored("plain")
    tabulate = with_founders(store)
    modes = tables(store, tabulate)[0]
    monkeypatch.setattr(sample_files, "BLOCK", 10)
    whole = tables(stored("whole"), TABULATE)[0]
    pairs = {*zip(modes["family"], whole["family"], strict=True)}
    assert len(pairs) == len({a for a, _ in pairs}) == len({b for _, b in pairs})
    keys = [*zip(modes["sample"], modes["family"], strict=True)]
    assert len({*keys}) == len(keys)


def test_columns_made_with_other_families_or_of_more_samples_are_made_again(stored):
    """A folder of few samples that got more, and one of many that is read in part."""
    plain = stored("plain")
    tabulate = with_founders(plain)
    for name, mine, tasks in (("few", TABULATE, TASKS), ("part", tabulate, TASKS[:6])):
        packed = stored(name, mine)
        one, two = tables(plain, tabulate, tasks), tables(packed, tabulate, tasks)
        assert one == two
