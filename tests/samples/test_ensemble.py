"""Samples over processes: all done once, failures kept, defects not hidden."""

import signal
import time

from mpi4py import MPI

import numpy as np
import pytest

from brake_fenicsx.errors import NotConverged
from brake_fenicsx.folder.processes import Terminated, TimeUp, in_turns, meanwhile, watching
from brake_fenicsx.samples import ensemble
from brake_fenicsx.samples.ensemble import run_ensemble

pytestmark = pytest.mark.together

COMM = MPI.COMM_WORLD
TASKS = [("multi-scale", k) for k in range(12)]


def value(store, task):
    return store.samples.load(task)


def test_every_sample_is_done_exactly_once(store):
    done = []
    run_ensemble(TASKS, lambda t: done.append(t) or {"x": np.array(t[1] ** 2)}, store, COMM)
    everyone = [t for part in COMM.allgather(done) for t in part]
    assert sorted(everyone) == TASKS
    assert [int(value(store, t)["x"]) for t in TASKS] == [k**2 for k in range(12)]


def test_finished_samples_are_not_done_again(store):
    if COMM.rank == 0:
        store.samples.save(TASKS[4], status="ok", x=np.array(-1))
    COMM.Barrier()
    run_ensemble(TASKS, lambda t: {"x": np.array(t[1])}, store, COMM)
    assert int(value(store, TASKS[4])["x"]) == -1
    assert int(value(store, TASKS[5])["x"]) == 5


def test_failing_sample_is_kept_with_its_error(store):
    def work(task):
        if task[1] == 7:
            raise NotConverged("stalls")
        return {}

    run_ensemble(TASKS, work, store, COMM)
    assert str(value(store, TASKS[7])["status"]) == "stalls"
    assert {str(value(store, t)["status"]) for t in TASKS if t[1] != 7} == {"ok"}


def test_defect_of_the_program_is_raised_on_all_processes(store):
    def work(task):
        if task[1] == 3:
            raise ZeroDivisionError("a defect")
        return {}

    with pytest.raises(RuntimeError, match="a defect"):
        run_ensemble(TASKS, work, store, COMM)
    assert value(store, TASKS[3]) is None


def test_large_samples_come_first(store):
    """They take longest: none is begun while others wait for the end of the run."""
    done = []
    large = [("classical", k) for k in range(3)]
    run_ensemble(TASKS, lambda t: done.append(t) or {}, store, COMM, large)
    everyone = sorted(t for part in COMM.allgather(done) for t in part)
    assert everyone == sorted([*large, *TASKS])
    own = [t in large for t in done]
    assert own == sorted(own, reverse=True)


@pytest.mark.parametrize("number", [1, 3])
def test_two_processes_share_a_long_sample_that_is_left_over(store, number):
    """Each other long one is computed by one process; all are stored once, failures too."""
    done = []
    large = [("classical", k) for k in range(number)]

    def work(task, comm=MPI.COMM_SELF):
        done.append((task, comm.size))
        if task == large[0]:
            # Both meet here, and one error reaches both.
            def fails(i):
                if i == comm.size - 1:
                    raise NotConverged("stalls")

            list(in_turns(comm.size, fails, comm))
        return {"x": np.array(comm.allreduce(1))}

    run_ensemble(TASKS, work, store, COMM, large, paired=True)
    together = min(number % COMM.size, COMM.size // 2)
    everyone = sorted(t for part in COMM.allgather(done) for t in part)
    first = [(t, 2) for t in large[:together] for _ in range(2)]
    assert everyone == sorted([*first, *((t, 1) for t in [*large[together:], *TASKS])])
    assert str(value(store, large[0])["status"]) == "stalls"
    sizes = [int(value(store, t)["x"]) for t in [*large[1:], *TASKS]]
    assert sizes == [2] * max(together - 1, 0) + [1] * (len(sizes) - max(together - 1, 0))


def test_a_long_sample_is_not_shared_where_others_keep_all_busy(store, monkeypatch):
    """Two processes that share it do more work in all."""
    monkeypatch.setattr(ensemble, "AS_LONG", len(TASKS) // COMM.size)
    sizes = []

    def work(task, comm=MPI.COMM_SELF):
        sizes.append(comm.size)
        return {"x": np.array(1)}

    run_ensemble(TASKS, work, store, COMM, [("classical", 0)], paired=True)
    assert sizes == [1] * len(sizes)


@pytest.mark.parametrize("paired", [False, True])
def test_work_together_beside_a_long_sample(store, paired):
    """The last process begins with the sample, the others with what they do together."""
    began = []

    def work(task, comm=MPI.COMM_SELF):
        began.append((task, comm.size))
        return {"x": np.array(COMM.rank)}

    def together(team):
        assert team.allreduce(1) == team.size
        began.append(("together", team.size))
        return [lambda i=i: ("team", i) for i in range(3)]

    works = [lambda i=i: ("beside", i) for i in range(2)]
    made = run_ensemble((), work, store, COMM, [("classical", 0)], "", paired, works, together)
    assert made == [*(("team", i) for i in range(3)), *(("beside", i) for i in range(2))]
    shared = 2 if paired and COMM.size > 2 else 1
    team = max(COMM.size - shared, 1)
    begun = [one for part in COMM.allgather(began) for one in part]
    assert begun.count(("together", team)) == team
    assert begun.count((("classical", 0), shared)) == shared
    assert int(value(store, ("classical", 0))["x"]) == COMM.size - shared


def test_other_work_waits_for_what_is_done_together(store):
    """A process that has its long sample soon does not draw what the others have not written."""
    written = store.path("table.txt")

    def together(team):
        time.sleep(0.3)
        if team.rank == 0:
            written.write_text("a table")
        return []

    works = [written.read_text] * 4
    large = [("classical", 0)]
    assert run_ensemble((), lambda _: {}, store, COMM, large, "", False, works, together) == (
        ["a table"] * 4
    )


@pytest.mark.parametrize("end", [NotConverged("stalls"), ZeroDivisionError("a defect"), TimeUp()])
def test_what_ends_the_work_together_ends_the_run_on_all(store, end):
    """The long sample is stored; other work, which may need the rest, is not begun."""
    begun = []

    def together(team):
        raise end

    given = [("classical", 0)], "", False, [lambda: begun.append(1)], together
    with pytest.raises(RuntimeError if isinstance(end, ZeroDivisionError) else type(end)):
        run_ensemble((), lambda _: {}, store, COMM, *given)
    assert not begun
    assert (value(store, ("classical", 0)) is not None) == (COMM.size > 1)


def test_samples_within_the_work_of_some_processes(store):
    """A signal to end that comes among them ends them all, and is not lost before the last."""
    done = []

    def work(task, comm=MPI.COMM_SELF):
        done.append(task)
        if task == TASKS[2]:
            signal.raise_signal(signal.SIGTERM)
        return {"x": np.array(1)}

    def together(team):
        run_ensemble(TASKS, work, store, team)
        return []

    with watching(), pytest.raises(Terminated) as error:
        run_ensemble((), work, store, COMM, [("classical", 0)], "", False, (), together)
    assert error.value.together
    everyone = [t for part in COMM.allgather(done) for t in part]
    assert TASKS[2] in everyone and len(everyone) < len(TASKS)
    assert all(value(store, t) is not None for t in everyone)


def test_a_second_signal_ends_a_process_at_once(store):
    """It waits for no other, which may never come: the command ends them all."""

    def together(team):
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGTERM)

    def work(task, comm=MPI.COMM_SELF):
        together(comm)

    with watching(), pytest.raises(Terminated) as error:
        run_ensemble((), work, store, COMM, [("classical", 0)], "", False, (), together)
    assert not error.value.together


def test_the_first_process_does_other_work_meanwhile():
    """It takes no turn where there are others, and what it raises reaches all at the end."""
    began = []

    def fails():
        began.append(COMM.rank)
        raise NotConverged("stalls")

    end = meanwhile(fails, COMM)
    ranks = list(in_turns(4, lambda i: COMM.rank, COMM, aside=1))
    assert ranks == [1 + i % (COMM.size - 1) if COMM.size > 1 else 0 for i in range(4)]
    assert began == [0] * (COMM.rank == 0)
    with pytest.raises(NotConverged, match="stalls"):
        end()


@pytest.mark.skipif(COMM.size == 1, reason="needs other processes")
def test_others_do_not_wait_for_the_first_process():
    """They do all of their turns while it is busy, however large the results are."""
    last, heard = COMM.size - 1, []
    number = 3 * last

    def busy():
        until = time.monotonic() + 60
        while not COMM.Iprobe(source=last) and time.monotonic() < until:
            time.sleep(0.01)
        heard.append(COMM.Iprobe(source=last) and COMM.recv(source=last))

    def work(i):
        if i == number - 1:
            COMM.send("all done", 0)
        return np.full(10**6, float(i))

    end = meanwhile(busy, COMM)
    found = [int(a[0]) for a in in_turns(number, work, COMM, aside=1)]
    end()
    assert found == [*range(number)]
    assert heard == ["all done"] * (COMM.rank == 0)


def test_results_that_cannot_be_stored_end_the_run_on_all(store):
    """A full disc."""

    def full(name, **_):
        raise OSError("no space left")

    store.save = full
    with pytest.raises(OSError, match="no space left"):
        run_ensemble(TASKS, lambda _: {}, store, COMM)
