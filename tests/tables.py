"""Tables of test cases."""

import pytest


def turns(rows, columns):
    """Every row with every column; fast are those along the diagonals, where each has a turn."""
    columns = list(columns)
    return [
        pytest.param(*row, *column, marks=() if (i - j) % len(columns) == 0 else pytest.mark.slow)
        for i, row in enumerate(rows)
        for j, column in enumerate(columns)
    ]
