"""Tables of text files: delimiters, decimals, units, and what is none."""

import numpy as np
import pytest

from brake_fenicsx.errors import SceneError
from brake_fenicsx.folder.arrays import TextTable

ROWS = "# test 7\na [Hz],b\n\n1.5,x\n 2e3 , y\n3,\n"


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_cells_are_the_same_with_any_delimiter(tmp_path, delimiter):
    """Beside semicolons and tabs decimals may have commas; the end of a row may be left out."""
    text = ROWS if delimiter == "," else ROWS.replace(",", delimiter).replace("1.5", "1,5")
    (tmp_path / "t.csv").write_text("\ufeff" + text.replace("3" + delimiter, "3"), "utf-8")
    table = TextTable.read(tmp_path / "t.csv")
    assert (table.heading, [*table.lines]) == (["a [Hz]", "b"], [4, 5, 6])
    np.testing.assert_array_equal(table.numbers("a [Hz]"), [1.5, 2e3, 3])
    assert (table.texts("b"), table.texts("c")) == (["x", "y", ""], [""] * 3)
    assert np.isnan(table.numbers("c", optional=True)).all()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no line of values"),
        ("a,b\n", "no line of values"),
        ("a,a\n1,2\n", "a heading twice"),
        ("a\n1,5\n", "line 2: more cells than the heading has"),
        ("a;b\n1;2;3\n", "line 2: more cells"),
        ("a,b\n1,2\n\n,3\n", "line 4: a = '': write a positive number"),
        ("a,b\nnan,2\n", "line 2: a = 'nan': write a positive"),
        ("a,b\ninf,2\n", "line 2: a = 'inf'"),
        ("a,b\n0,2\n", "line 2: a = '0': write a positive number"),
    ],
)
def test_what_is_no_table_is_named(tmp_path, text, said):
    """File, line, heading and cell."""
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(SceneError, match=f"t.csv: .*{said}"):
        TextTable.read(tmp_path / "t.csv").numbers("a", positive=True)
