from dataclasses import dataclass

import numpy as np
import pytest

from brake_fenicsx.results import tables
from brake_fenicsx.results.tables import Row, RowTable, show, text_table, write_rows
from run_tables import read_rows

NAMES = ("approach", "sample", "seed", "x", "note")
ROWS = [
    ["parametric", 0, 2**64 - 1, 0.1 + 0.2, None],
    ["a,b", np.int64(7), 3, np.float64(1e-300), 5e-324],
    ['say "no"', 1, 0, float("inf"), float("nan")],
    ["1", 2, 9, 1e22, -0.0],
]


def test_the_same_numbers_give_the_same_bytes_and_come_back_exactly(tmp_path):
    first = write_rows(tmp_path / "a.csv", NAMES, ROWS)
    rows = read_rows(first)
    second = write_rows(tmp_path / "b.csv", NAMES, rows)
    assert first.read_bytes() == second.read_bytes()
    assert b"\r" not in first.read_bytes()
    for row, given in zip(rows, ROWS, strict=True):
        for name, value in zip(NAMES, given, strict=True):
            expected = None if value is None else value
            assert row[name] == expected or (row[name] != row[name] and value != value)


def test_columns_have_their_types():
    table = RowTable(NAMES, ROWS, ["approach"]).columns
    assert table["sample"].dtype == np.int64
    assert table["seed"][0] == 2**64 - 1
    assert table["x"][0] == 0.1 + 0.2
    assert np.isnan(table["note"][0])
    assert table["approach"][3] == "1"


@dataclass(frozen=True, slots=True)
class Pair(Row):
    """Two columns."""

    name: str | None
    x: float | None


def test_a_table_of_rows_has_the_columns_of_their_class(tmp_path):
    """In their order, those that are left out not; texts are texts in an empty table too."""
    table = RowTable.of(Pair, [Pair("a", 0.5), Pair(None, None)])
    assert table.write(tmp_path / "a.csv").read_text() == "name,x\na,0.5\n,\n"
    assert table.columns["name"].tolist() == ["a", ""]
    assert RowTable.of(Pair, [Pair("a", 0.5)], ["name"]).cells == [[0.5]]
    assert RowTable.of(Pair, []).columns["name"].dtype.kind == "U"


def test_mapping_rows_may_come_in_any_order(tmp_path):
    path = write_rows(tmp_path / "a.csv", ["x", "sample"], [{"sample": 3, "x": 0.5}])
    assert path.read_text() == "x,sample\n0.5,3\n"


@pytest.mark.parametrize("row", [[1], [1, 2, 3], {"x": 1}, {"x": 1, "sample": 2, "y": 3}], ids=repr)
def test_a_wrong_row_is_named_and_the_old_file_stays(tmp_path, row):
    path = write_rows(tmp_path / "a.csv", ["x", "sample"], [[1.0, 2]])
    before = path.read_bytes()
    with pytest.raises(ValueError, match="row 2"):
        write_rows(path, ["x", "sample"], [[3.0, 4], row])
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.csv"]


@pytest.mark.parametrize("value", [True, 1j, [1], b"x"], ids=repr)
def test_other_types_are_refused(tmp_path, value):
    with pytest.raises(TypeError):
        write_rows(tmp_path / "a.csv", ["x"], [[value]])
    assert not any(tmp_path.iterdir())


def test_text_table_aligns_columns():
    text = text_table(["name", "value"], [["long name", 1.5], ["b", 12345.678], ["c", None]])
    lines = text.splitlines()
    assert lines[0] == "name           value"
    assert lines[2] == "long name        1.5"
    assert lines[3] == "b          1.235e+04"
    assert lines[4] == "c                  -"


@pytest.mark.parametrize(
    ("value", "text"), [(None, "-"), (True, "yes"), (3, "3"), (0.00012345, "0.0001234"), ("a", "a")]
)
def test_show(value, text):
    assert show(value) == text


def test_columns_of_mixed_cells_have_one_type():
    """Empty cells make numbers floats, words make text of all, as it is written."""
    names = ("approach", "late", "word", "empty", "whole")
    table = [["1", None if k < 4 else k, "all" if k > 4 else k, None, k] for k in range(6)]
    columns = RowTable(names, table).columns
    assert columns["approach"].tolist() == ["1"] * 6
    np.testing.assert_array_equal(columns["late"], [np.nan] * 4 + [4.0, 5.0])
    assert columns["word"].tolist() == ["0", "1", "2", "3", "4", "all"]
    assert np.isnan(columns["empty"].astype(float)).all()
    assert columns["whole"].dtype == np.int64
    empty = RowTable(names, []).columns
    assert {values.size for values in empty.values()} == {0}


def test_table_of_many_rows_is_parquet_and_csv_on_request(tmp_path, monkeypatch):
    """The same bytes as of few rows; columns are typed."""
    import pandas as pd

    pytest.importorskip("pyarrow")
    rng = np.random.default_rng(0)
    heads = ("approach", "sample", "damping", "partner")
    damping, partner = rng.normal(size=30), np.where(rng.random(30) < 0.5, -1, np.arange(30))
    damping[3] = np.nan
    rows = [["joint", k, float(d), int(p) if p >= 0 else None]
            for k, (d, p) in enumerate(zip(damping, partner, strict=True))]  # fmt: skip
    asked = write_rows(tmp_path / "asked.csv", heads, rows).read_bytes()

    def write(path):
        with tables.column_writer(path, heads, 30) as take:
            for own in (slice(0, 7), slice(7, 19), slice(19, 30)):
                take({
                    "approach": np.full(30, "joint")[own], "sample": np.arange(30)[own],
                    "damping": damping[own], "partner": np.ma.masked_less(partner, 0)[own],
                })  # fmt: skip
        return path

    few = write(tmp_path / "few.csv")
    assert few.read_bytes() == asked and not few.with_suffix(".parquet").exists()
    monkeypatch.setattr(tables, "MANY", 10)
    many = write(tmp_path / "many.csv")
    assert not many.exists() and many.with_suffix(".parquet").is_file()
    table, plain = (
        pd.read_parquet(many.with_suffix(".parquet")),
        pd.read_csv(few, float_precision="round_trip"),
    )
    assert [*table] == [*heads] and (table["approach"] == "joint").all()
    for name in heads[1:]:
        np.testing.assert_array_equal(table[name], plain[name])
    assert tables.write_csv(many).read_bytes() == asked
    assert tables.write_csv(few) is None
    monkeypatch.setattr(tables, "_pyarrow", lambda: None)
    assert write(tmp_path / "without.csv").read_bytes() == asked
