"""A line with the progress of a solve and an estimate of the time left, on terminals and in notebooks."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TextIO

from . import _core
from ._errors import Error

QUIET = 1.0  # seconds; shorter solves show no line
PAUSE = 0.1  # between two lines


def duration(seconds: float) -> str:
    """7 s, 3 min 20 s, 5 h 10 min: an estimate has no more digits."""
    whole = math.ceil(seconds)
    if whole < 100:
        return f"{whole} s"
    if whole < 6000:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole // 60 % 60} min"


class ProgressLine:
    """Called with (done, total, change) as ``progress`` of :func:`bromwich.solve` is.

    Args:
        tolerance: the change of y at which sweeps end.
        show: receives each line; "" removes it.
        clock: seconds.
    """

    def __init__(
        self, tolerance: float, show: Callable[[str], object], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._left = _core.TimeLeft(tolerance)
        self._show = show
        self._clock = clock
        self._start = clock()
        self._next = self._start + QUIET
        self._shown = False

    def __call__(self, done: int, total: int, change: float) -> None:
        now = self._clock()
        left = self._left.after(done, total, change, now - self._start)
        if now < self._next:
            return
        self._next = now + PAUSE
        self._shown = True
        line = f"step {done} of {total}" if total > 0 else f"sweep {done}, change {change:.1e}"
        self._show(line if left is None else f"{line}, about {duration(left)} left")

    def close(self) -> None:
        if self._shown:
            self._show("")


def _on_terminal(stream: TextIO) -> Callable[[str], object]:
    def show(line: str) -> None:
        stream.write("\r\033[K" + line)
        stream.flush()

    return show


def _in_notebook() -> Callable[[str], object] | None:
    shell = sys.modules.get("IPython") and sys.modules["IPython"].get_ipython()
    if shell is None or not hasattr(shell, "kernel"):
        return None
    from IPython.display import display

    handle: list[Any] = []

    def show(line: str) -> None:
        data = {"text/plain": line}
        if not handle:
            handle.append(display(data, raw=True, display_id=True))
        else:
            handle[0].update(data, raw=True)

    return show


@contextmanager
def reporting(progress: Any, tolerance: float) -> Iterator[Any]:
    """The function for the argument ``progress``: itself; or for True a line in a notebook or on a terminal, if any."""
    if progress is None or progress is False:
        yield None
        return
    if progress is not True:
        if not callable(progress):
            raise Error(f"progress: is a {type(progress).__name__}; give True, or a function of (done, total, change)", "progress")
        yield progress
        return
    show = _in_notebook() or (_on_terminal(sys.stderr) if sys.stderr is not None and sys.stderr.isatty() else None)
    if show is None:
        yield None
        return
    line = ProgressLine(tolerance, show)
    try:
        yield line
    finally:
        line.close()
