"""Chooses the compiled part for this processor, and the OpenMP runtime that it shares with other packages.

The environment variable ``BROMWICH_VECTORS`` chooses among :func:`variants`, from ``base`` to ``avx512``. Without it the
widest vector instructions of the processor are used.
"""

from __future__ import annotations

import ctypes
import importlib.util
import os
import re
import sys
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from types import ModuleType

HERE = Path(__file__).parent
LEVELS = {"base": 0, "avx2": 3, "avx512": 4}  # levels of x86-64 (v3 is AVX2); a build may have only `base`
RUNTIME = re.compile(r"/lib(gomp|omp|iomp5)[-.][^/]*so[^/]*$")


def openmp() -> str:
    """Loads an OpenMP runtime and returns its file.

    With one runtime there is one pool of threads. The first of these is taken: a runtime that the process has loaded;
    that of PyTorch, which may be imported later; that of the environment or the system; the package's own.
    """
    tried = []
    for file in (*_in_process(), *_of_torch(), Path(sys.prefix) / "lib" / "libgomp.so.1", "libgomp.so.1", *_own()):
        try:
            library = ctypes.CDLL(str(file), mode=os.RTLD_GLOBAL | os.RTLD_NOW)
            library.GOMP_loop_nonmonotonic_dynamic_start  # AttributeError in runtimes older than OpenMP 4.5
        except (OSError, AttributeError) as error:
            tried.append(f"{file}: {error}")
            continue
        _for_libraries()
        return next(iter(_in_process()), str(file))
    raise ImportError("bromwich: no OpenMP runtime; install libgomp1 (" + "; ".join(tried) + ")")


def _for_libraries() -> None:
    """Loads a libgomp.so.1 for Debian's muParser, which needs it by this name; PyTorch's runtime has another name.

    Symbols are looked up in the runtime of :func:`openmp` first, so that this one starts no threads."""
    for file in ("libgomp.so.1", *_own()):
        try:
            ctypes.CDLL(str(file), mode=os.RTLD_LOCAL | os.RTLD_NOW)
        except OSError:
            continue
        return


def _in_process() -> list[str]:
    try:
        with open("/proc/self/maps", encoding="utf-8", errors="replace") as maps:
            files = dict.fromkeys(line.split(maxsplit=5)[5].strip() for line in maps if line.count("/"))
    except OSError:
        return []
    return [file for file in files if RUNTIME.search(file)]


def _of_torch() -> list[Path]:
    if "torch" in sys.modules:
        return []  # _in_process has found its runtime
    try:
        spec = importlib.util.find_spec("torch")
    except (ImportError, ValueError):
        return []
    folders = (spec.submodule_search_locations or []) if spec else []
    places = [place for folder in folders for place in (Path(folder) / "lib", Path(folder).parent / "torch.libs")]
    return [file for place in places for file in sorted(place.glob("libgomp*.so*"))]


def _own() -> list[Path]:
    return sorted((HERE / "_lib").glob("libgomp.so*"))


def variants() -> list[str]:
    """The installed variants of the compiled part, the widest last."""
    return [name for name in LEVELS if name == "base" or _file(name)]


def chosen() -> str:
    """The variant to import."""
    level = _level()
    word = os.environ.get("BROMWICH_VECTORS", "")
    if not word:
        return [name for name in variants() if LEVELS[name] <= level][-1]
    if word not in variants():
        raise ImportError(f"BROMWICH_VECTORS: found {word!r}; this package has {', '.join(variants())}")
    if LEVELS[word] > level:
        raise ImportError(f"BROMWICH_VECTORS: found {word!r}, which this processor does not have; use base, or unset it")
    return word


def _level() -> int:
    library = HERE / "_processor.so"
    return ctypes.CDLL(str(library)).bromwich_processor_level() if library.exists() else 0


def _file(variant: str) -> Path | None:
    folder = HERE / "_variants" / variant
    files = (folder / f"_core{suffix}" for suffix in EXTENSION_SUFFIXES)
    return next((file for file in files if file.exists()), None)


#: Of the compiled part that core() has imported.
variant, runtime = "", ""


def core() -> tuple[str, str]:
    """Imports the variant for this processor as ``bromwich._core``; returns its name and the OpenMP runtime."""
    global variant, runtime
    runtime, variant = openmp(), chosen()
    file = _file(variant)
    if file is not None:
        spec = importlib.util.spec_from_file_location("bromwich._core", file)
        assert spec is not None and spec.loader is not None
        module: ModuleType = importlib.util.module_from_spec(spec)
        sys.modules["bromwich._core"] = module
        spec.loader.exec_module(module)
        sys.modules["bromwich"]._core = module  # type: ignore[attr-defined]
    return variant, runtime
