"""Work of a group ends well on all its processes or on none, wherever one of them fails."""

from mpi4py import MPI

import pytest

from brake_fenicsx.errors import InaccurateResult, NotConverged
from brake_fenicsx.uncertainty.group import split

COMM = MPI.COMM_WORLD
LAST = COMM.size - 1


@pytest.fixture
def group():
    """All processes of the test run as one group."""
    made = split(COMM, COMM.size)
    yield made
    made.Free()


def test_common_calls_give_what_they_should(group):
    assert group.allgather(group.rank**2) == [i**2 for i in range(COMM.size)]
    assert group.bcast(group.rank + 7, root=LAST) == LAST + 7
    assert group.allreduce(2) == 2 * COMM.size
    assert group.allreduce(float(group.rank), MPI.MAX) == LAST
    assert group.run(lambda: group.rank) == group.rank


def fails_before_a_call(group, error):
    if group.rank == LAST:
        raise error
    group.bcast(1)
    group.allgather(1)


def fails_between_calls(group, error):
    group.allgather(1)
    fails_before_a_call(group, error)


def fails_after_the_last_call(group, error):
    group.bcast(1)
    if group.rank == LAST:
        raise error


PLACES = [fails_before_a_call, fails_between_calls, fails_after_the_last_call]


@pytest.mark.parametrize("work", PLACES)
def test_named_error_of_one_is_that_of_all(group, work):
    with pytest.raises(NotConverged, match="stalls"):
        group.run(lambda: work(group, NotConverged("stalls")))
    # The group goes on as if nothing had been.
    assert group.allgather(group.rank) == list(range(COMM.size))


@pytest.mark.parametrize("work", PLACES)
def test_defect_of_one_reaches_all(group, work):
    """As it is where it was met, with its traceback elsewhere."""
    kind = ZeroDivisionError if group.rank == LAST else RuntimeError
    with pytest.raises(kind, match="a defect") as caught:
        group.run(lambda: work(group, ZeroDivisionError("a defect")))
    assert group.rank == LAST or work.__name__ in str(caught.value)
    assert group.allgather(group.rank) == list(range(COMM.size))


def test_defect_comes_before_a_named_error(group):
    """Both at once, on different processes."""

    def work():
        raise ZeroDivisionError("a defect") if group.rank == LAST else NotConverged("stalls")

    kind = ZeroDivisionError if group.rank == LAST else RuntimeError
    with pytest.raises(kind, match="a defect"):
        group.run(work)


def test_another_error_after_the_first_was_handled(group):
    """What is met while an error is dealt with is told as well; so is the same error once more."""

    def work():
        with pytest.raises(NotConverged):
            group.run(lambda: fails_before_a_call(group, NotConverged("stalls")))
        if group.rank == 0:
            raise InaccurateResult("disc full")
        group.bcast(1)

    for _ in range(2):
        with pytest.raises(InaccurateResult, match="disc full"):
            group.run(work)
    assert group.allgather(group.rank) == list(range(COMM.size))


def test_error_passes_through_nested_work_once(group):
    def inner():
        fails_between_calls(group, NotConverged("stalls"))

    with pytest.raises(NotConverged, match="stalls"):
        group.run(lambda: group.run(inner))
    assert group.allgather(group.rank) == list(range(COMM.size))


def test_groups_are_neighbours():
    made = split(COMM, 1)
    assert (made.size, made.rank) == (1, 0)
    made.Free()
    made = split(COMM, COMM.size)
    assert (made.size, made.rank) == (COMM.size, COMM.rank)
    made.Free()
