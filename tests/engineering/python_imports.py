#!/usr/bin/env python3
"""python_imports.py SOURCE: the import graph of python/bromwich. Fails on a circle of modules, imports for annotations
included, and on an import of a module of the package inside a function, which hides one. Other packages may be imported
inside functions: they are optional."""

import ast
import sys
import tempfile
from pathlib import Path

from rooms import circles

COMPILED = "_core"  # a leaf


def imported(node, modules):
    """The modules of the package that an import statement names; `from . import name` means the package itself where
    the name is that of no module."""
    if isinstance(node, ast.Import):
        names = [alias.name.split(".") for alias in node.names]
        found = [(name[1:] or ["__init__"])[0] for name in names if name[0] == "bromwich"]
    elif isinstance(node, ast.ImportFrom) and (node.level == 1 or (node.module or "").split(".")[0] == "bromwich"):
        path = [part for part in (node.module or "").split(".") if part][0 if node.level else 1 :]
        found = path[:1] or [alias.name for alias in node.names]
    else:
        return []
    return [name if name in modules else "__init__" for name in found if name != COMPILED]


def faults(root):
    files = sorted((root / "python" / "bromwich").glob("*.py"))
    modules, graph = {file.stem for file in files}, {}
    for file in files:
        tree = ast.parse(file.read_text())
        graph[file.stem] = {name for node in ast.walk(tree) for name in imported(node, modules)}
        for function in ast.walk(tree):
            if not isinstance(function, (ast.FunctionDef, ast.AsyncFunctionDef)):
                continue
            for node in ast.walk(function):
                if imported(node, modules):
                    yield f"{file.relative_to(root)}:{node.lineno}: imports a module of the package in a function"
    for circle in circles(graph):
        yield "circle of imports: " + ", ".join(circle)


def accepts_anything():
    """The check itself: each fault has to be found in a package that has it."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        package = root / "python" / "bromwich"
        package.mkdir(parents=True)
        for text_of_a, text_of_b, expected in (
            ("from ._b import x\n", "from ._a import y\n", 1),
            ("from . import _b\n", "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from ._a import y\n", 1),
            ("from . import state\n", "", 1),
            ("def f():\n    from ._b import x\n", "", 1),
            ("from . import _core, _b\n", "def f():\n    import numpy\n", 0),
        ):
            (package / "__init__.py").write_text("from . import _a\n")
            (package / "_a.py").write_text(text_of_a)
            (package / "_b.py").write_text(text_of_b)
            if len(list(faults(root))) != expected:
                return True
    return False


def main():
    if accepts_anything():
        print("python_imports.py: does not find the faults that it looks for", file=sys.stderr)
        return 1
    found = list(faults(Path(sys.argv[1]).resolve()))
    print("\n".join(found), file=sys.stderr)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
