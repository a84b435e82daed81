#!/usr/bin/env python3
"""rooms.py SOURCE [--draw OUT.dot]: the include graph of core/ and of the folders beside it, held against their order.

A room is a folder of core/, or a folder beside it with a library of its own. core/ROOMS lists them from the ground up.
Below them all are the public headers (include/bromwich), which include each other alone. A file may include files of its
own room and of the rooms below it. Fails on a room or file that is not listed, on an include that points up, and on a
circle of files (a header and its source count as one). They include no other folder.
No file of core asks for the kind of dynamics: methods ask for capabilities (core/dynamics/linear_system.hpp). Nothing
outside core/lcp compares the name of a class of complementarity matrices: it asks for a trait
(core/lcp/class_traits.hpp). `--classes` lists where classes are named. Examples include what is installed.
"""

import re
import sys
from pathlib import Path

INCLUDE = re.compile(r'^\s*#\s*include\s+"([^"]+)"', re.M)
CLASS = re.compile(r"[=!]=\s*LcpClass::|case\s+LcpClass::|LcpClass::\w+\s*[=!]=")
KIND = re.compile(r"\b(?:get|get_if|holds|made_from)<\w+Dynamics>")


def included(root, path):
    """Files of the project that `path` includes, relative to the root."""
    for name in INCLUDE.findall(path.read_text()):
        for folder in (path.parent, root, root / "include"):
            found = (folder / name).resolve()
            if found.is_file() and found.is_relative_to(root):
                yield found.relative_to(root)
                break


def unit(path):
    return str(path.with_suffix(""))


def graph_of(root, beside):
    graph = {}
    for path in sorted(p for folder in ("include", "core", *beside) for p in (root / folder).rglob("*")):
        if path.suffix in (".hpp", ".cpp"):
            own = path.relative_to(root)
            edges = graph.setdefault(unit(own), {})
            for other in included(root, path):
                if unit(other) != unit(own):
                    edges.setdefault(unit(other), own)
    return graph


def circles(graph):
    """Strongly connected components of more than one unit (Tarjan), each sorted."""
    index, low, stack, found = {}, {}, [], []

    def visit(v):
        index[v] = low[v] = len(index)
        stack.append(v)
        for w in graph.get(v, ()):
            if w not in index:
                visit(w)
                low[v] = min(low[v], low[w])
            elif w in stack:
                low[v] = min(low[v], index[w])
        if low[v] == index[v]:
            component = stack[stack.index(v):]
            del stack[stack.index(v):]
            if len(component) > 1:
                found.append(sorted(component))

    sys.setrecursionlimit(10000)
    for v in graph:
        if v not in index:
            visit(v)
    return found


def rooms_of(root):
    """The rooms of core, and the folders beside it."""
    parts = (root / "core" / "ROOMS").read_text().split("# beside core\n")
    within, beside = [[line.split()[0] for line in part.splitlines() if line.strip() and not line.startswith("#")]
                      for part in (*parts, "")[:2]]
    return within, beside


def room_of(name):
    """The room of a file: core/ROOM/NAME, ROOM/NAME, or "include" of all public headers."""
    parts = name.split("/")[:-1]
    if parts[0] == "include":
        return "include"
    return parts[0] if parts[0] != "core" else "/".join(parts[1:])


def named_classes(root):
    """Lines outside core/lcp that name an LcpClass; tests may ask for what they like."""
    for folder in ("core", *rooms_of(root)[1], "cpu", "kernels", "files", "app", "mpi", "report", "bench", "python",
                   "examples"):
        for path in sorted((root / folder).rglob("*")):
            own = path.relative_to(root)
            if path.suffix not in (".hpp", ".cpp", ".cu", ".cuh") or own.parts[:2] == ("core", "lcp"):
                continue
            for number, line in enumerate(path.read_text().splitlines(), 1):
                if "LcpClass::" in line:
                    yield own, number, line.strip()


def faults(root):
    within, beside = rooms_of(root)
    graph = graph_of(root, beside)
    level = {name: i for i, name in enumerate(["include", *within, *beside])}
    room = {u: room_of(u) for u in graph}
    for u, name in room.items():
        if name not in level:
            yield f"{u}: its folder is not listed in core/ROOMS"
    for name in (*within, *beside):
        if name not in room.values():
            yield f"core/ROOMS: {name} has no files"
    for u, edges in graph.items():
        for other, where in edges.items():
            if other not in room:
                yield f"{where}: includes {other}; core/ and what is beside it stand alone"
            elif level.get(room[other], 99) > level.get(room[u], 99):
                yield f"{where}: includes {other}, which is above {room[u]}"
    for u, edges in graph.items():
        for path in (root / f"{u}{suffix}" for suffix in (".hpp", ".cpp")):
            if path.is_file() and KIND.search(path.read_text()):
                yield f"{path.relative_to(root)}: asks for the kind of dynamics; ask for a capability"
    for path, number, line in named_classes(root):
        if CLASS.search(line):
            yield f"{path}:{number}: asks for the name of a class; ask for a trait (core/lcp/class_traits.hpp)"
    for path in sorted((root / "examples").glob("*.cpp")):
        if INCLUDE.search(path.read_text()):
            yield f"{path.relative_to(root)}: includes a header that is not installed; name it <bromwich/...>"
    for circle in circles(graph):
        yield "circle of includes: " + ", ".join(circle)


def draw(root, out):
    within, beside = rooms_of(root)
    graph = graph_of(root, beside)
    counts = {}
    for u, edges in graph.items():
        for other in edges:
            pair = (room_of(u), room_of(other))
            if pair[0] != pair[1]:
                counts[pair] = counts.get(pair, 0) + 1
    lines = ["digraph rooms {", "  rankdir=BT; node [shape=box];"]
    lines += [f"  {name};" for name in ("include", *within, *beside)]
    lines += [f'  {a} -> {b} [label="{n}"];' for (a, b), n in sorted(counts.items())]
    Path(out).write_text("\n".join(lines) + "\n}\n")


def accepts_anything():
    """The check itself: each fault has to be found in a tree that has it."""
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder).resolve()
        for name, text in {"low/a.hpp": '#include "../high/b.hpp"\n', "high/b.hpp": '#include "../low/a.hpp"\n',
                           "high/c.cpp": "if (holds<DenseDynamics>(d)) return;\n",
                           "high/d.cpp": '#include "../../beside/f.hpp"\nif (c == LcpClass::P) return;\n',
                           "../beside/f.hpp": '#include "../app/g.hpp"\n', "../app/g.hpp": "",
                           "../include/bromwich/h.hpp": '#include "core/low/a.hpp"\n'}.items():
            path = root / "core" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        (root / "examples").mkdir()
        (root / "examples" / "e.cpp").write_text('#include "core/low/a.hpp"\n')
        (root / "core" / "ROOMS").write_text("low\nhigh\n# beside core\nbeside\n")
        found = list(faults(root))
        expected = ("above low", "above high", "above include", "stand alone", "circle", "asks for the kind", "asks for the name",
                    "not installed")
        return not all(any(word in f for f in found) for word in expected)


def main():
    root = Path(sys.argv[1]).resolve()
    if "--draw" in sys.argv:
        draw(root, sys.argv[sys.argv.index("--draw") + 1])
        return 0
    if "--classes" in sys.argv:
        for path, number, line in named_classes(root):
            print(f"{path}:{number}: {line}")
        return 0
    if accepts_anything():
        print("rooms: a fault was accepted")
        return 1
    found = list(faults(root))
    for fault in found:
        print("rooms: " + fault)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
