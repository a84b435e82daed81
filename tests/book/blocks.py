#!/usr/bin/env python3
"""blocks.py SOURCE BUILD [FILE...]: every code block of README and docs runs.
blocks.py SOURCE --cpp OUT: writes one program of all blocks of C++; the build compiles it, a test runs it.

    python   executed, the blocks of a page one after the other, in a scratch folder
    sh       executed by bash; `bromwich` is the command of BUILD
    toml     a file of that page: solved, or parsed if it is a part of a scene
    cpp      all pages together one program

A comment in the line before the fence says what else a block is:

    <!-- file: NAME -->      the block is written to NAME for the blocks behind it
    <!-- output -->          the block is what the block before it prints; numbers may differ in rounding, times in all
    <!-- not run: REASON --> the block is only shown; at most EXEMPT blocks of all pages

A block of any other language, or of none since it is made by indentation, is text: it must not begin like a command or a
program.
"""

import argparse
import contextlib
import importlib.util
import io
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

EXEMPT = 16
PAGES = ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "examples/README.md", "python/README.md"]
COMMAND = re.compile(r"\s*(\$ |bromwich [a-z]|pip |python3? |scripts/|import |from \w+ import |#include|\[\w+\]\s*$)")
DURATION = re.compile(r"\d+(\.\d+)?(e[-+]?\d+)? (ns|us|µs|ms|s)\b")
NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?")
# Results below are rounding: of values of order one, after some thousand steps.
ROUNDING = 1e-10


class Block:
    def __init__(self, page, line, language, text, mark):
        self.page, self.line, self.language, self.text, self.mark = page, line, language, text, mark

    def __str__(self):
        return f"{self.page}:{self.line}"


class Fault(Exception):
    pass


def blocks_of(page, text):
    """The blocks of a page, with the comment before each."""
    found, fence, start, mark = [], None, 0, ""
    indented = []
    before_blank, in_list, body = True, False, []
    for number, line in enumerate(text.split("\n"), 1):
        if fence is None:
            opening = re.match(r"(\s*)(```+|~~~+)\s*(\S*)", line)
            if opening:
                fence, start, language, body = opening, number, opening[3], []
                continue
            if re.match(r"    +\S", line) and not in_list and (before_blank or indented):
                indented.append(line[4:])
                continue
            if indented and line.strip():
                found.append(Block(page, number - 1, "", "\n".join(indented) + "\n", ""))
                indented = []
            comment = re.match(r"\s*<!-- ((?:file|not run): .*|output) -->$", line)
            mark = comment[1] if comment else mark if not line.strip() else ""
            if re.match(r"\s*([-*]|\d+\.) ", line):
                in_list = True
            elif line.strip() and not line.startswith(" "):
                in_list = False
            before_blank = not line.strip()
        elif line.strip().startswith(fence[2]) and not line.strip().strip(fence[2][0]):
            found.append(Block(page, start, language, "\n".join(body) + "\n", mark))
            fence, mark, before_blank = None, "", False
        else:
            body.append(line[len(fence[1]):])
    if fence is not None:
        raise Fault(f"{page}:{start}: the block has no end")
    return found


def same_output(expected, found):
    """Whether two texts agree but for times and the rounding of numbers."""
    def normal(text):
        return "\n".join(" ".join(DURATION.sub("TIME", line).split()) for line in text.strip().splitlines())

    expected, found = normal(expected), normal(found)
    if NUMBER.sub("0", expected).replace("0", "") != NUMBER.sub("0", found).replace("0", ""):
        return False
    pairs = zip(NUMBER.findall(expected), NUMBER.findall(found))
    return all(
        math.isclose(float(a), float(b), rel_tol=1e-6, abs_tol=ROUNDING)
        or ("." in a and abs(float(a) - float(b)) <= 1.001 * 10.0 ** -len(a.split(".")[1].split("e")[0]) * 10 ** exponent(a))
        for a, b in pairs
    )


def exponent(number):
    return int(number.split("e")[1]) if "e" in number else 0


def run_python(block, names, folder):
    """What the block prints. Figures are drawn without a screen."""
    out = io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stdout(out):
        exec(compile("\n" * block.line + block.text, block.page, "exec"), names)
    return out.getvalue()


def run_shell(block, folder, build):
    environment = dict(os.environ, PATH=f"{folder / '.bin'}:{os.path.dirname(sys.executable)}:{os.environ['PATH']}")
    done = subprocess.run(["bash", "-euo", "pipefail", "-c", block.text], cwd=folder, env=environment, timeout=1800,
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    if done.returncode:
        raise Fault(f"{block}: exit code {done.returncode}: {done.stderr.strip() or done.stdout.strip()}")
    return done.stdout


def run_toml(block, name, folder):
    """A whole scene is solved; a part of one has to be TOML."""
    import tomllib

    keys = tomllib.loads(block.text).keys()
    (folder / name).write_text(block.text, encoding="utf-8")
    if {"dynamics", "port"} & keys and "time" in keys:
        run_shell(Block(block.page, block.line, "sh", f"bromwich solve '{name}'\n", ""), folder, None)


def scratch(folder, source, build):
    """The folder where a page runs: beside the examples and with the command in the path."""
    (folder / ".bin").mkdir(parents=True)
    (folder / ".bin" / "bromwich").symlink_to(build / "bromwich")
    (folder / "examples").symlink_to(source / "examples")


def run_page(source, build, page, folder):
    """Runs the blocks of one page in order. Returns those that are only shown."""
    scratch(folder, source, build)
    names, printed, shown = {"__name__": page}, None, []
    for block in blocks_of(page, (source / page).read_text(encoding="utf-8")):
        if block.mark.startswith("not run: "):
            shown.append(block)
        elif block.mark == "output":
            if printed is None or not same_output(block.text, printed):
                raise Fault(f"{block}: the block before prints\n{printed}")
        elif block.mark.startswith("file: ") and block.language != "toml":
            (folder / block.mark[6:]).write_text(block.text, encoding="utf-8")
        elif block.language == "python":
            printed = run_python(block, names, folder)
        elif block.language in ("sh", "bash"):
            printed = run_shell(block, folder, build)
        elif block.language == "toml":
            run_toml(block, block.mark[6:] or f"block-{block.line}.toml", folder)
        elif block.language != "cpp" and COMMAND.match(block.text):
            raise Fault(f"{block}: begins like a program; name its language, or say '<!-- not run: why -->'")
    return shown


def program(blocks):
    """One C++ source whose main executes every block in a function of its own; a block may have parts before main."""
    head = ["#include <bromwich/bromwich.hpp>", "#include <bromwich/cpu/cpu_backend.hpp>", "#include <cstdio>"]
    bodies, calls = [], []
    for number, block in enumerate(blocks):
        lines = block.text.split("\n")
        head += [line for line in lines if line.startswith("#include")]
        text = "\n".join("" if line.startswith("#include") else line for line in lines)
        place = f'#line {block.line + 1} "{block.page}"\n'
        bodies.append(f"namespace block_{number} {{ using namespace bromwich;\nvoid run() {{\n{place}{text}\n}} }}")
        calls.append(f"  block_{number}::run();")
    head = list(dict.fromkeys(head))
    return "\n".join(head + bodies + ["int main() {", *calls, "}"]) + "\n"


def write_program(source, out):
    """One program of all blocks of C++; written only where it changes, so that it is not compiled in vain."""
    pages = pages_of(source)
    blocks = [b for page in pages for b in blocks_of(page, (source / page).read_text(encoding="utf-8"))]
    text = program([b for b in blocks if b.language == "cpp" and not b.mark.startswith("not run: ")])
    if not out.is_file() or out.read_text(encoding="utf-8") != text:
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(text, encoding="utf-8")


def pages_of(source):
    return [*PAGES, *sorted(str(p.relative_to(source)) for p in (source / "docs").rglob("*.md"))]


def accepts_anything():
    """The check itself has to find what is wrong."""
    assert not same_output("[0.0028]", "[0.0031]") and not same_output("solved", "infeasible")
    assert same_output("x 3.4e-16, 21.9 ms", "x 2.9e-16, 3 s") and same_output("1.25", "1.25000001")
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        (root / "examples").mkdir()
        for number, text in enumerate(["```python\n1/0\n```", "```sh\nfalse\n```", "```toml\nx\n```", "    bromwich scenes\n\ntext",
                                       "```text\n$ bromwich\n```", "```sh\necho 1\n```\n<!-- output -->\n```text\n2\n```",
                                       "```sh\ntrue"]):
            (root / "page.md").write_text(text + "\n")
            try:
                run_page(root, root, "page.md", root / str(number))
            except Exception:
                continue
            return True
    return False


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("source", type=Path)
    parser.add_argument("build", type=Path, nargs="?", default=Path("build/cpu"))
    parser.add_argument("--cpp", type=Path)
    parser.add_argument("pages", nargs="*")
    arguments = parser.parse_args()
    source, build = arguments.source.resolve(), arguments.build.resolve()
    if arguments.cpp:
        return write_program(source, arguments.cpp)
    for module in ("bromwich._core", "scipy", "matplotlib"):
        try:
            missing = importlib.util.find_spec(module) is None
        except ModuleNotFoundError:
            missing = True
        if missing:
            print(f"blocks: skipped, there is no {module} (scripts/python-env installs what is needed)")
            return 77
    os.environ.update(MPLBACKEND="Agg", OMP_NUM_THREADS="2", OMP_WAIT_POLICY="PASSIVE")
    if accepts_anything():
        return "blocks: a block that fails was accepted"
    pages = arguments.pages or pages_of(source)
    faults, shown = [], []
    out = build / "book" / "blocks"
    shutil.rmtree(out, ignore_errors=True)
    for page in pages:
        try:
            shown += run_page(source, build, page, out / page.replace("/", "-"))
        except Fault as fault:
            faults.append(str(fault))
        except Exception as error:
            faults.append(f"{page}: {type(error).__name__}: {error}")
    if len(shown) > EXEMPT:
        faults.append(f"{len(shown)} blocks are not run, at most {EXEMPT} may be: {', '.join(map(str, shown))}")
    print(f"blocks: {len(pages)} pages, {len(shown)} blocks not run")
    return "\n".join(faults) or 0


if __name__ == "__main__":
    sys.exit(main())
