"""Work on a thread of its own, left behind when nothing comes of it any more."""

from __future__ import annotations

import threading
import time
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

_Result = TypeVar("_Result")

_INTERVAL = 0.5
"""s; how long an interruption may wait."""

_FAREWELL = 2.0
"""s that work which was given up has to put its things away."""


class StalledError(Exception):
    """Nothing came of the work for too long."""


class _GivenUp(BaseException):
    """Nobody waits for the work any more."""


def watched(
    work: Callable[[Callable[[int, int | None], None]], _Result],
    progress: Callable[[int, int | None], None] | None,
    *,
    patience: float,
) -> _Result:
    """Return what ``work`` returns, or raise what it raises.

    Parameters
    ----------
    work : callable
        Gets a function to call with (done, in all or None). Once it is given up, that function
        raises.
    progress : callable or None
        Called on this thread with the same words.
    patience : float
        s without a word from ``work``, after which it is given up. Code that never comes back does
        not end with the process: its thread is left behind.

    Raises
    ------
    StalledError
        ``work`` was given up.
    """
    events: SimpleQueue[tuple[str, Any]] = SimpleQueue()
    is_over = threading.Event()

    def tell(done: int, total: int | None) -> None:
        if is_over.is_set():
            raise _GivenUp
        events.put(("progress", (done, total)))

    def run() -> None:
        try:
            events.put(("result", work(tell)))
        except BaseException as error:  # raised again where it is waited for
            events.put(("error", error))

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        while True:
            kind, value = _next(events, patience)
            if kind == "result":
                return value
            if kind == "error":
                try:
                    raise value
                finally:
                    del value  # it knows this frame: what it holds would live on
            if progress is not None:
                progress(*value)
    finally:
        is_over.set()
        thread.join(_FAREWELL)


def _next(events: SimpleQueue[tuple[str, Any]], patience: float) -> tuple[str, Any]:
    end = time.monotonic() + patience
    while True:
        try:
            return events.get(timeout=_INTERVAL)
        except Empty:
            if time.monotonic() > end:
                raise StalledError from None
