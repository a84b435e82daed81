#!/usr/bin/env python3
"""abi.py SOURCE GENERATED LIBRARY CC OUT [--write]: the binary interface of the C library against that of the last release.

1. LIBRARY exports the functions of bromwich.h and nothing else, and has the SONAME of its version.
2. Every function of the last release (capi/abi/*.abi) is there.
3. Where abidw and abidiff are installed (Debian: abigail-tools): functions have the same types, structs have grown at their
   end alone. They read a library of empty functions that is made from the header, since that has what C programs see and no
   types of C++.

--write stores the interface as that of this version: after a release.
"""

import re
import shutil
import subprocess
import sys
from pathlib import Path

FUNCTION = re.compile(r"BROMWICH_API\s+([\w\s\*]+?)(\w+)\(([^;]*)\);")
SUPPRESSED = """[suppress_type]
  name = bromwich_summary
  has_data_member_inserted_at = end
[suppress_type]
  name = bromwich_hooks
  has_data_member_inserted_at = end
"""


def functions(header):
    """Return type, name and parameters of each function."""
    text = re.sub(r"/\*.*?\*/", "", header, flags=re.S)
    return [(kind.strip(), name, " ".join(parameters.split())) for kind, name, parameters in FUNCTION.findall(text)]


def exported(library):
    lines = subprocess.run(["nm", "-D", "--defined-only", library], check=True, capture_output=True, text=True).stdout
    names = {line.split()[-1].split("@")[0] for line in lines.splitlines() if line.split()[1] != "A"}
    return names


def soname(library):
    lines = subprocess.run(["readelf", "-d", library], check=True, capture_output=True, text=True).stdout
    return re.search(r"SONAME.*\[(.*)\]", lines)[1]


def empty_library(found, header, generated, compiler, out, name="empty"):
    lines = ["#include <bromwich/bromwich.h>"]
    for kind, function, parameters in found:
        body = "" if kind == "void" else "return 0;"
        lines.append(f"{kind} {function}({parameters}) {{ {body} }}")
    source = out / f"{name}.c"
    source.write_text("\n".join(lines) + "\n")
    library = out / f"lib{name}.so"
    subprocess.run([compiler, "-g", "-shared", "-fPIC", "-w", f"-I{header}", f"-I{generated}", source, "-o", library], check=True)
    return library


def faults_of_library(found, library, source):
    names = {name for _, name, _ in found}
    symbols = exported(library)
    for name in sorted(symbols - names):
        yield f"{name} is exported and not in bromwich.h"
    for name in sorted(names - symbols):
        yield f"{name} is in bromwich.h and not exported"
    number = re.search(r"set\(BROMWICH_SOVERSION (\d+)\)", (source / "CMakeLists.txt").read_text())[1]
    if soname(library) != f"libbromwich.so.{number}":
        yield f"the SONAME is {soname(library)}, not libbromwich.so.{number}"


def write(library, target):
    subprocess.run(["abidw", "--no-show-locs", "--no-comp-dir-path", "--no-corpus-path", "--out-file", target, library], check=True)


def faults_of_change(library, reference, out):
    symbols = exported(library)
    for name in re.findall(r"<elf-symbol name='(\w+)'", reference.read_text()):
        if name not in symbols:
            yield f"{name} of {reference.stem} is gone"
    if not shutil.which("abidw") or not shutil.which("abidiff"):
        print("capi.abi: types are not compared, no abidw and abidiff (Debian: abigail-tools)")
        return
    now, suppressed = out / "now.abi", out / "suppressed"
    suppressed.write_text(SUPPRESSED)
    write(library, now)
    run = subprocess.run(["abidiff", "--suppressions", suppressed, "--no-added-syms", reference, now], capture_output=True, text=True)
    if run.returncode:
        yield f"the interface of {reference.stem} has changed:\n{run.stdout}{run.stderr}"


def accepts_anything(found, header, generated, compiler, out):
    """The check itself: a function that is gone and a parameter of another type have to be found."""
    before = empty_library(found, header, generated, compiler, out, "before")
    reference = out / "before.abi"
    if not shutil.which("abidw"):
        reference.write_text("".join(f"<elf-symbol name='{name}'/>\n" for name in exported(before)))
    else:
        write(before, reference)
    fewer = empty_library(found[1:], header, generated, compiler, out, "fewer")
    if found[0][1] not in "\n".join(faults_of_change(fewer, reference, out)):
        return True
    if not shutil.which("abidw"):
        return False
    altered = out / "header" / "bromwich"
    altered.mkdir(parents=True, exist_ok=True)
    text = (header / "bromwich/bromwich.h").read_text().replace("int64_t count", "int count")
    (altered / "bromwich.h").write_text(text)
    other = empty_library(functions(text), altered.parent, generated, compiler, out, "other")
    return "int64_t" not in "\n".join(faults_of_change(other, reference, out))


def main():
    source, generated, library, compiler, out = sys.argv[1:6]
    source, out = Path(source), Path(out)
    if not all(shutil.which(tool) for tool in ("nm", "readelf", compiler)):
        print("capi.abi: skipped, no binutils")
        return 77
    found = functions((source / "include/bromwich/bromwich.h").read_text())
    version = re.search(r'BROMWICH_VERSION "(.*)"', (Path(generated) / "bromwich/version.h").read_text())[1]
    empty = empty_library(found, source / "include", generated, compiler, out)
    stored = source / "capi" / "abi"
    if "--write" in sys.argv:
        target = stored / f"bromwich-{version}.abi"
        write(empty, target)
        print(f"capi.abi: {target} written")
        return 0
    if accepts_anything(found, source / "include", generated, compiler, out):
        print("capi.abi: a changed interface was accepted")
        return 1
    faults = list(faults_of_library(found, library, source))
    for reference in sorted(stored.glob("*.abi")):
        faults += faults_of_change(empty, reference, out)
    for fault in faults:
        print("capi.abi: " + fault)
    print(f"capi.abi: {len(found)} functions, {len(faults)} faults")
    return 1 if faults or len(found) < 30 else 0


if __name__ == "__main__":
    sys.exit(main())
