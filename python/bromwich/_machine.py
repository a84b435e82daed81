"""What a solve is asked to run on: backend, device and threads."""

from __future__ import annotations

from typing import Any

from . import _core
from ._arrays import whole, word
from ._errors import Error
from ._ranks import Ranks

MOST_THREADS = 2**20


def wanted(backend: Any, device: Any, threads: Any, ranks: Ranks | None = None) -> _core.Wanted:
    """As the compiled part takes it. Ranks share the devices and the cores of their machine."""
    word(backend, "backend")
    if device is not None:
        whole(device, "device", 0)
        if backend == "cpu":
            raise Error(f"device: found {device} with backend='cpu'; leave it out, or use backend='cuda'", "device")
        device = min(int(device), 2**31 - 1)  # more than there are
    number_here = 0 if ranks is None or backend == "cpu" else ranks.number_here()
    threads = _host_threads(threads)
    return _core.Wanted(backend, device, number_here, threads if ranks is None else ranks.threads(threads))


def _host_threads(threads: Any) -> int:
    """A number of threads, 0 for all cores."""
    if not 0 <= whole(threads, "threads") <= MOST_THREADS:
        raise Error(f"threads: found {threads}; give 0 for all cores, or a number up to {MOST_THREADS}", "threads")
    return int(threads)
