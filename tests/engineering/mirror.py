#!/usr/bin/env python3
"""mirror.py SOURCE: tests/ mirrors core/ and the folders beside it.

Every room (core/ROOMS) has a folder of tests. Every source ROOM/NAME.cpp has a test: tests/ROOM/test_NAME.cpp, or a
test that includes ROOM/NAME.hpp, or a line in tests/COVERED. No test lies in tests/ itself, and every one is in the
lists of tests/CMakeLists.txt.
"""

import re
import sys
from pathlib import Path

INCLUDE = re.compile(r'^\s*#\s*include\s+"(?:core/)?([^"]+)"', re.M)
IN_A_PROGRAM = re.compile(r"\b\w+/test_\w+\.cpp")  # of its own
LISTED = re.compile(r"bromwich_tests_of\(\s*(\w+)\s+([^)]*)\)")


def lines_of(path):
    return [line.split() for line in path.read_text().splitlines() if line.strip() and not line.startswith("#")]


def faults(root):
    core, tests = root / "core", root / "tests"
    rooms = [room for room, *_ in lines_of(core / "ROOMS")]
    for room in rooms:
        if not any((tests / room).glob("test_*.cpp")):
            yield f"{room} has no tests: tests/{room} is missing or empty"
    for path in sorted(tests.glob("*.[ch]pp")):
        yield f"tests/{path.name}: belongs into a folder"

    programs = (tests / "CMakeLists.txt").read_text()
    listed = {f"{folder}/{name}" for folder, names in LISTED.findall(programs) for name in names.split()}
    listed.update(IN_A_PROGRAM.findall(programs))
    included = set()
    for path in sorted(tests.glob("*/test_*.cpp")):
        included.update(INCLUDE.findall(path.read_text()))
        name = str(path.relative_to(tests))
        if path.parent.name != "engineering" and name not in listed:
            yield f"tests/{name}: is not in tests/CMakeLists.txt"

    sources = {str(path.relative_to(folder).with_suffix("")): path
               for folder in (core, root) for room in rooms for path in sorted((folder / room).glob("*.cpp"))}
    covered = {}
    for source, *by in lines_of(tests / "COVERED"):
        covered[source] = by
        if source not in sources:
            yield f"tests/COVERED: {source}.cpp does not exist"
        for name in by or ["(nothing)"]:
            if not (tests / name).is_file():
                yield f"tests/COVERED: {source}: tests/{name} does not exist"
    for unit, path in sources.items():
        own = tests / path.parent.name / f"test_{path.stem}.cpp"
        if not own.is_file() and f"{unit}.hpp" not in included and unit not in covered:
            yield f"{unit}.cpp has no test: write {own.relative_to(root)}, or say in tests/COVERED what tests it"


def accepts_anything():
    """The check itself: a room, a source and a test that are not as they should be have to be found."""
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        for name, text in {"core/ROOMS": "low\nhigh\n", "core/low/a.cpp": "", "core/low/b.cpp": "", "high/c.cpp": "",
                           "tests/COVERED": "low/gone low/test_a.cpp\n", "tests/low/test_a.cpp": "",
                           "tests/stray.cpp": "", "tests/CMakeLists.txt": ""}.items():
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (root / name).write_text(text)
        found = "\n".join(faults(root))
    expected = ["high has no tests", "low/b.cpp has no test", "high/c.cpp has no test", "stray.cpp",
                "test_a.cpp: is not in", "low/gone.cpp does not exist"]
    return any(part not in found for part in expected) or "low/a.cpp has no test" in found


def main():
    if accepts_anything():
        print("mirror: a tree with faults was accepted")
        return 1
    found = list(faults(Path(sys.argv[1]).resolve()))
    for fault in found:
        print("mirror: " + fault)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
