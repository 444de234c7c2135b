"""The named errors of the program: text = what, where, value, remedy, in one line."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import wraps
from types import MappingProxyType
from typing import Any, ParamSpec

P = ParamSpec("P")


def one_line(text: object) -> str:
    """A text of any number of lines as one."""
    return " ".join(str(text).split())


def lines(rule: Callable[P, Iterable[str]]) -> Callable[P, list[str]]:
    """Make a generator of texts, each of any number of lines, a list with each as one line."""

    @wraps(rule)
    def listed(*args: P.args, **keys: P.kwargs) -> list[str]:
        return [one_line(text) for text in rule(*args, **keys)]

    return listed


class BrakeError(Exception):
    """Base of all named errors; the command line prints its text as one line.

    Attributes:
        known: seed and inputs of the sample that failed, as arrays to store.
    """

    known: Mapping[str, Any] = MappingProxyType({})

    def __init__(self, text: object = ""):
        """Begin.

        Args:
            text: in any number of lines, which become one.
        """
        super().__init__(one_line(text))


class SceneError(BrakeError, ValueError):
    """The scene or an input file is wrong: a user's mistake, exit status 2."""


class SurfaceError(SceneError):
    """A scan or a surface cannot be used (no valid point, flat where roughness is needed, ...)."""


class StorageError(BrakeError, OSError):
    """A result cannot be written: the disc is full, or no longer there."""


class NotConverged(BrakeError, RuntimeError):
    """An iteration did not reach its tolerance; the last iterate is not returned."""


class InaccurateResult(BrakeError, RuntimeError):
    """A result was found but its own check (residual, count of modes, ...) fails."""


class Separated(NotConverged):
    """No equilibrium: the loads leave a part without contact and without support."""


class OfOneProcess:
    """What holds a mesh, matrices or processes of MPI, which no other process can be sent."""

    __slots__ = ()

    def __reduce__(self) -> str:
        """Refuse, in place of the libraries' own errors."""
        raise BrakeError(f"""pickle: {type(self).__name__} has a mesh or matrices of this process;
            send the model of brake_fenicsx.prepare, which loads its folder there, or prepare in
            each process""")


@contextmanager
def located(where: object, kind: type[Exception] = SceneError) -> Iterator[None]:
    """Name the place of a mistake: errors raised within become ``SceneError("where: text")``.

    Args:
        where: file, section or key, that stands before the text of the error.
        kind: of these errors.
    """
    try:
        yield
    except kind as error:
        raise SceneError(f"{where}: {error}") from None
