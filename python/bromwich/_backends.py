"""The backends: the processor and CUDA devices."""

from __future__ import annotations

import os
from typing import NamedTuple

from . import _core, _load

PLUGIN = _load.HERE / "_cuda.so"
_core.set_cuda_plugin(str(PLUGIN) if PLUGIN.exists() else "")


class BackendInfo(NamedTuple):
    """One of :func:`backends`."""

    available: bool
    detail: str  #: threads or devices, or why it cannot be used


def cuda_devices() -> list[str]:
    """Names of the CUDA devices that can be used; empty where there is none, or no CUDA backend (:func:`backends`)."""
    return _core.cuda_devices()


def backends() -> dict[str, BackendInfo]:
    """``"cpu"`` and ``"cuda"``, the values of ``backend=``: whether they can be used, and their details.

    Asks for CUDA devices, which loads the CUDA libraries; ``import bromwich`` does not.
    """
    cpu = f"{_core.threads()} threads, {_load.variant} (for {_core.built_for}), {_core.transform}, OpenMP of {_load.runtime}"
    missing = _core.cuda_missing()
    devices = [] if missing else _core.cuda_devices()
    why = missing or "no CUDA device, or no driver for it"
    return {
        "cpu": BackendInfo(True, cpu),
        "cuda": BackendInfo(bool(devices), ", ".join(devices) or os.fspath(why)),
    }
