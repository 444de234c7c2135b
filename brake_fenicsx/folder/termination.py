"""SIGTERM, as a batch system sends it before a job's time is over.

While samples are computed the sample at hand is finished and stored, and none is begun after it;
elsewhere, and at the second signal, the run ends at once.
"""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

STATUS = 128 + signal.SIGTERM


class Terminated(BaseException):
    """SIGTERM ended the run.

    Attributes:
        together: whether all processes of the run raise it.
    """

    def __init__(self, together: bool = False):
        super().__init__()
        self.together = together


class _State:
    asked = finishing = False


@contextmanager
def watching() -> Iterator[None]:
    """A block in which SIGTERM is ours."""
    _State.asked = _State.finishing = False
    before = signal.signal(signal.SIGTERM, _on_signal)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def asked() -> bool:
    """Whether nothing new may be begun."""
    return _State.asked


@contextmanager
def finishing() -> Iterator[None]:
    """A block that looks at ``asked`` by itself."""
    _State.finishing = True
    try:
        yield
    finally:
        _State.asked = _State.finishing = False


def _on_signal(*_: Any) -> None:
    again, _State.asked = _State.asked, True
    if again or not _State.finishing:
        raise Terminated
