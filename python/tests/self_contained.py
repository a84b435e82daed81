"""self_contained.py PACKAGE: what the shared objects of an installed package need is in the package or on every Linux.

No FFTW (GPL), no CUDA library save in _cuda.so, no OpenMP runtime that the loader would choose by itself."""

import re
import subprocess
import sys
from pathlib import Path

EVERYWHERE = re.compile(r"^(ld-linux.*|libc|libdl|libgcc_s|libm|libpthread|librt|libstdc\+\+|libz)\.so[.\d]*$")
OF_CUDA = re.compile(r"^lib(cuda|cudart|cublas|cublasLt|cufft)\.so[.\d]*$")


def needed(file):
    lines = subprocess.run(["readelf", "-d", str(file)], capture_output=True, text=True, check=True).stdout
    return re.findall(r"\(NEEDED\).*\[(.*)\]", lines)


def faults(package):
    folders = [package, package.parent / "bromwich.libs"]
    files = sorted(file for folder in folders for file in folder.rglob("*.so*"))
    if not any(file.name.startswith("_core") for file in files):
        yield f"{package}: has no _core"
    own = {file.name for file in files}
    for file in files:
        for name in needed(file):
            if name == "libgomp.so.1" and file.name.startswith("libmuparser"):
                continue  # that of Debian; bromwich._load has one in the process before it
            cuda = file.name == "_cuda.so" and OF_CUDA.match(name)
            if re.search("fftw|gomp|iomp", name) or not (name in own or EVERYWHERE.match(name) or cuda):
                yield f"{file.name} needs {name}"
        print(file.name, file.stat().st_size, *needed(file))


found = list(faults(Path(sys.argv[1])))
print(*found, sep="\n")
sys.exit(1 if found else 0)
