"""scikit-build-core, with sources that lie above this folder.

In the repository CMake reads the folder above. An sdist has to hold everything: there the same files lie in `engine`.
"""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from pathlib import Path

from scikit_build_core import build as scikit
from scikit_build_core.build import (
    build_editable,
    build_wheel,
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    get_requires_for_build_wheel,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)

__all__ = [
    "build_editable",
    "build_sdist",
    "build_wheel",
    "get_requires_for_build_editable",
    "get_requires_for_build_sdist",
    "get_requires_for_build_wheel",
    "prepare_metadata_for_build_editable",
    "prepare_metadata_for_build_wheel",
]

HERE = Path(__file__).resolve().parent
# What CMake reads for the package.
PARTS = ("CMakeLists.txt", "LICENSE", "app", "bench/studies", "circuits", "cmake", "core", "cpu", "examples", "files", "kernels", "mpi")
PARTS += ("python/CMakeLists.txt", "python/cuda.cmake", "python/src", "python/stubs.py", "python/variants.cmake")
PARTS += ("batch", "catalogue", "derivatives", "include", "mechanics", "nonlinear", "ranks", "complementarity")
PARTS += ("capi", "docs/scene.schema.json", "report", "scripts/install-deps", "third_party")
SKIPPED = shutil.ignore_patterns("__pycache__", "*.pyc", "build", "*.so", "*.pyi")


def build_sdist(sdist_directory: str, config_settings: dict | None = None) -> str:
    where = Path(sdist_directory).resolve()
    root = HERE if (HERE / "engine").is_dir() else HERE.parent
    with tempfile.TemporaryDirectory() as folder:
        staged = Path(folder) / "bromwich"
        shutil.copytree(HERE, staged, ignore=SKIPPED)
        if root != HERE:
            _stage(root, staged)
        before = Path.cwd()
        os.chdir(staged)
        try:
            return scikit.build_sdist(str(where), config_settings)
        finally:
            os.chdir(before)


def _stage(root: Path, staged: Path) -> None:
    for part in PARTS:
        source, target = root / part, staged / "engine" / part
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, target, ignore=SKIPPED)
        else:
            shutil.copy2(source, target)
    shutil.copytree(staged / "bromwich", staged / "engine" / "python" / "bromwich", ignore=SKIPPED)
    for part in ("src", "CMakeLists.txt", "cuda.cmake", "stubs.py", "variants.cmake", "prebuilt"):
        path = staged / part
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    shutil.copy2(root / "LICENSE", staged / "LICENSE")
    project = staged / "pyproject.toml"
    text = project.read_text()
    text, times = re.subn(r'"\.\.(/CMakeLists\.txt)?"', lambda m: f'"engine{m[1] or ""}"', text)
    if times != 2:
        raise RuntimeError(f"pyproject.toml names the folder above {times} times, not 2")
    project.write_text(text)
