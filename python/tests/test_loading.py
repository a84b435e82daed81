"""Which compiled part is imported, and with which OpenMP runtime."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import bromwich
import numpy as np
import pytest
from bromwich import _load

SOLVES = """
import sys
import numpy as np
import bromwich

scenes = {name: bromwich.scene(name, **q) for name, q in
          (("dlcp-small", {}), ("signorini", {"Q": 31}), ("bridge", {}), ("nash-game", {}))}
found = {name: bromwich.solve(scene, steps=200, check=True).y for name, scene in scenes.items()}
found["fft"] = bromwich.solve(bromwich.scene("signorini", Q=159), steps=20, method="contour", check=True).y
found["lags"] = bromwich.solve(scenes["signorini"], steps=300, method="contour", check=True).y
np.savez(sys.argv[1], variant=np.array(bromwich._variant), **found)
"""


def run(code, *words, check=True, **environment):
    """A Python of its own."""
    return subprocess.run(
        [sys.executable, "-c", code, *map(str, words)],
        capture_output=True,
        text=True,
        check=check,
        env={**os.environ, **environment},
    )


def fits(variant):
    return _load.LEVELS[variant] <= _load._level()


@pytest.fixture(scope="module")
def of_base(tmp_path_factory):
    file = tmp_path_factory.mktemp("base") / "base.npz"
    run(SOLVES, file, BROMWICH_VECTORS="base")
    return np.load(file)


@pytest.mark.parametrize("variant", _load.variants())
def test_variants_agree(variant, of_base, tmp_path):
    """The same sums in another order: the scenes are well conditioned, so 1e-10 is a thousand times their rounding."""
    if not fits(variant):
        pytest.skip(f"this processor has no {variant}")
    file = tmp_path / "found.npz"
    run(SOLVES, file, BROMWICH_VECTORS=variant)
    found = np.load(file)
    assert found["variant"] == variant
    for name in set(found.files) - {"variant"}:
        scale = np.nanmax(np.abs(of_base[name]))
        assert scale > 0
        np.testing.assert_allclose(found[name], of_base[name], atol=1e-10 * scale, rtol=0)


def test_a_variant_that_is_not_there():
    found = run("import bromwich", check=False, BROMWICH_VECTORS="mmx")
    assert found.returncode != 0
    assert "BROMWICH_VECTORS: found 'mmx'; this package has base" in found.stderr


def test_the_widest_that_fits(monkeypatch):
    monkeypatch.delenv("BROMWICH_VECTORS", raising=False)
    monkeypatch.setattr(_load, "_file", lambda name: Path(name))
    for level, expected in ((0, "base"), (1, "base"), (3, "avx2"), (4, "avx512")):
        monkeypatch.setattr(_load, "_level", lambda level=level: level)
        assert _load.chosen() == expected
    monkeypatch.setattr(_load, "_level", lambda: 3)
    monkeypatch.setenv("BROMWICH_VECTORS", "avx512")
    with pytest.raises(ImportError, match="this processor does not have"):
        _load.chosen()
    monkeypatch.setattr(_load, "_file", lambda name: None if name == "avx2" else Path(name))
    monkeypatch.delenv("BROMWICH_VECTORS")
    assert _load.chosen() == "base"


def test_the_processor():
    """Linux knows it too."""
    flags = Path("/proc/cpuinfo").read_text().split("flags")[1].split("\n")[0].split()
    level = 1
    if {"avx2", "fma", "bmi1", "bmi2"} <= set(flags):
        level = 4 if {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"} <= set(flags) else 3
    assert _load._level() == level


# ---- One OpenMP runtime.

RUNTIMES = """
import ctypes, json, sys
before, after = sys.argv[1:]
if before != "-":
    ctypes.CDLL(before)
import bromwich
bromwich.solve(bromwich.scene("signorini", Q=63), steps=300, threads=2)
if after != "-":
    ctypes.CDLL(after)
from bromwich import _load
print(json.dumps({"runtime": bromwich._openmp, "loaded": _load._in_process()}))
"""


@pytest.fixture
def runtime(tmp_path):
    """A copy of the runtime under another name, as PyTorch has it."""
    if "gomp" not in bromwich._openmp:
        pytest.skip(f"the runtime is {bromwich._openmp}")
    file = tmp_path / "torch" / "lib" / "libgomp-0123abcd.so.1"
    file.parent.mkdir(parents=True)
    (file.parent.parent / "__init__.py").write_text("raise RuntimeError('it is not imported')")
    return Path(shutil.copy(bromwich._openmp, file))


def test_a_runtime_in_the_process_is_shared(runtime):
    found = json.loads(run(RUNTIMES, runtime, "-").stdout)
    assert found == {"runtime": str(runtime), "loaded": [str(runtime)]}


def test_that_of_pytorch_is_taken_before_it_is_imported(runtime):
    path = os.pathsep.join([str(runtime.parents[2]), os.environ.get("PYTHONPATH", "")])
    found = json.loads(run(RUNTIMES, "-", runtime, PYTHONPATH=path).stdout)
    assert found == {"runtime": str(runtime), "loaded": [str(runtime)]}


@pytest.mark.parametrize("order", ["torch, bromwich", "bromwich, torch"])
def test_beside_pytorch(order):
    pytest.importorskip("torch")
    code = f"import {order}\nimport torch, bromwich\nfrom bromwich import _load\nprint(len(_load._in_process()))\n"
    code += "torch.ones(1000, 1000) @ torch.ones(1000, 1000)\n"
    code += "bromwich.solve(bromwich.scene('signorini', Q=63), steps=300, check=True)"
    assert run(code).stdout.strip() == "1"


def test_no_runtime(monkeypatch):
    for name in ("_in_process", "_of_torch", "_own"):
        monkeypatch.setattr(_load, name, lambda: [])
    monkeypatch.setattr(_load.ctypes, "CDLL", lambda *_, **__: (_ for _ in ()).throw(OSError("no such file")))
    with pytest.raises(ImportError, match="install libgomp1"):
        _load.openmp()


# ---- CUDA, which is never needed.


def test_backends():
    found = bromwich.backends()
    assert found["cpu"].available and "threads" in found["cpu"].detail and "pocketfft" in found["cpu"].detail
    cuda = found["cuda"]
    assert cuda.available == bool(bromwich.cuda_devices()) and cuda.detail
    assert cuda.detail == ", ".join(bromwich.cuda_devices()) or not cuda.available


def test_import_loads_no_cuda():
    code = """
import bromwich
files = {line.rsplit("/", 1)[-1] for line in open("/proc/self/maps")}
print([name for name in files if "cuda" in name or "cublas" in name])
"""
    assert run(code).stdout.strip() == "[]"


def test_a_plugin_that_cannot_be_loaded(tmp_path):
    """It is named and refused; `auto` solves on the processor."""
    broken = tmp_path / "_cuda.so"
    broken.write_bytes(b"no shared object")
    code = f"""
import bromwich
bromwich._core.set_cuda_plugin({str(broken)!r})
print(bromwich.backends()["cuda"])
print(bromwich.solve(bromwich.scene("signorini", Q=9), steps=20).status)
try:
    bromwich.solve(bromwich.scene("signorini", Q=9), steps=20, backend="cuda")
except bromwich.DeviceError as error:
    print(error)
"""
    lines = run(code).stdout.splitlines()
    assert "available=False" in lines[0] and "cannot be loaded" in lines[0] and "_cuda.so" in lines[0]
    assert "needs libcudart, libcublas and libcufft" in lines[0]
    assert lines[1] == "solved"
    assert lines[2].startswith("backend: found 'cuda' but the CUDA backend cannot be loaded")


def test_a_wrong_cuda_library(tmp_path):
    """A file in the place of libcudart that is none: named, and only where a device is wanted."""
    plugin = _load.HERE / "_cuda.so"
    if not plugin.exists():
        pytest.skip("this package has no CUDA backend")
    needed = re.search(rb"libcudart\.so\.\d+", plugin.read_bytes())[0].decode()
    (tmp_path / needed).write_bytes(b"no shared object")
    code = """
import bromwich
print(bromwich.solve(bromwich.scene("dlcp-small"), steps=20).status)
print(bromwich.backends()["cuda"])
"""
    found = run(code, LD_LIBRARY_PATH=str(tmp_path)).stdout.splitlines()
    assert found[0] == "solved"
    assert "available=False" in found[1] and str(tmp_path / needed) in found[1] and "needs libcudart" in found[1]


def test_a_shared_object_that_is_no_plugin():
    code = f"""
import bromwich
bromwich._core.set_cuda_plugin({str(_load.HERE / "_processor.so")!r})
print(bromwich.backends()["cuda"].detail)
"""
    assert "is no CUDA backend of bromwich" in run(code).stdout


def test_a_loaded_backend():
    """A backend of another shared object (pretended_cuda.cpp): solves, its errors, and the switch to it."""
    file = os.environ.get("BROMWICH_PRETENDED_CUDA", "")
    if not file:
        pytest.skip("BROMWICH_PRETENDED_CUDA is not set")
    code = f"""
import bromwich, numpy as np
bromwich._core.set_cuda_plugin({file!r})
assert bromwich.backends()["cuda"] == (True, "naive loops, more of them")
scene = bromwich.scene("signorini", Q=9)
for method in ("contour", "march", "multigrid", "euler"):
    expected = bromwich.solve(scene, steps=40, method=method, backend="cpu")
    found = bromwich.solve(scene, steps=40, method=method, backend="cuda", check=False)
    assert (found.backend, found.status) == ("reference", expected.status), found
    np.testing.assert_allclose(found.y, expected.y, atol=1e-9)
solver = bromwich.Solver(scene, steps=40, backend="cuda")
np.testing.assert_array_equal(solver.solve().y, solver.solve().y)
arrays = bromwich.ArraySolver(scene, steps=40, backend="cuda").solve(g=np.full((41, scene.constraints), -0.3))
other = bromwich.ArraySolver(scene, steps=40, backend="cpu").solve(g=np.full((41, scene.constraints), -0.3))
assert arrays.backend == "reference"
np.testing.assert_allclose(np.from_dlpack(arrays.y), np.from_dlpack(other.y), atol=1e-9)
try:
    bromwich.solve(scene, steps=40, backend="cuda", threads=3)
except bromwich.DeviceError as error:
    print(type(error).__name__, error)
"""
    assert run(code).stdout.strip() == "DeviceError device: 0 is at work; try again"


def test_the_device_of_a_solve():
    """Its number reaches the backend from every function that takes one; where there is no such device, that is said."""
    file = os.environ.get("BROMWICH_PRETENDED_CUDA", "")
    if not file:
        pytest.skip("BROMWICH_PRETENDED_CUDA is not set")
    code = f"""
import bromwich
bromwich._core.set_cuda_plugin({file!r})
scene = bromwich.scene("dlcp-small")
solves = [lambda **on: bromwich.solve(scene, steps=20, **on), lambda **on: bromwich.Solver(scene, steps=20, **on),
          lambda **on: bromwich.solve_batch([scene, scene], steps=20, **on),
          lambda **on: bromwich.solve_nonlinear(scene, steps=20, **on), lambda **on: bromwich.ArraySolver(scene, steps=20, **on)]
def refused(work, on, kind, message):
    try:
        work(**on)
    except bromwich.Error as error:
        assert type(error) is kind and error.argument == "device" and str(error) == message, error
    else:
        raise AssertionError("not refused")
for work in solves:
    for number in (0, 1):
        refused(work, dict(backend="cuda", device=number, threads=3), bromwich.DeviceError, f"device: {{number}} is at work; try again")
    refused(work, dict(backend="cuda", threads=3), bromwich.DeviceError, "device: 0 is at work; try again")
    none = "device: found 2, and there are 2 CUDA devices; give 0 to 1"
    refused(work, dict(backend="cuda", device=2), bromwich.DeviceError, none)
    refused(work, dict(backend="auto", device=2), bromwich.DeviceError, none)
    refused(work, dict(backend="cpu", device=0), bromwich.Error, "device: found 0 with backend='cpu'; leave it out, or use backend='cuda'")
    refused(work, dict(backend="cuda", device=-1), bromwich.Error, "device: found -1; give a whole number from 0 on")
    refused(work, dict(backend="cuda", device="first"), bromwich.Error, "device: found 'first'; give a number")
one, other = (bromwich.solve(scene, steps=20, backend="cuda", device=number, method="march") for number in (0, 1))
assert one.backend == other.backend == "reference" and (one.y == other.y).all()
print("done")
"""
    assert run(code).stdout.strip() == "done"


def test_a_device_where_there_is_none():
    if bromwich.cuda_devices():
        pytest.skip("there is one")
    with pytest.raises(bromwich.Error, match="device: found 0, and there is no CUDA device; use the backend cpu|backend: found 'cuda'"):
        bromwich.solve(bromwich.scene("dlcp-small"), steps=20, backend="cuda", device=0)


def test_derivatives_on_a_loaded_backend():
    """Where the backend says that single steps are expensive, the derivative of a scene of many states is the one over all
    time points; elsewhere, and for few values, the one in modes. They agree."""
    file = os.environ.get("BROMWICH_PRETENDED_CUDA", "")
    if not file:
        pytest.skip("BROMWICH_PRETENDED_CUDA is not set")
    code = f"""
import bromwich, numpy as np
bromwich._core.set_cuda_plugin({file!r})
scene = bromwich.scene("signorini", Q=33)
def derivative(threads, steps):
    return bromwich.solve(scene, steps=steps, method="march", states=None, backend="cuda", threads=threads).derivative()
forms = [derivative(threads, steps).form for threads, steps in ((2, 32), (1, 32), (2, 20))]
assert forms == ["over all time points", "modes", "modes"], forms
weights = np.random.default_rng(1).normal(size=(33, 33))
over_time, by_modes = (derivative(threads, 32).vjp(y=weights) for threads in (2, 1))
for name in ("x0", "f", "g", "M"):
    one, other = getattr(over_time, name), getattr(by_modes, name)
    np.testing.assert_allclose(one, other, atol=1e-9 * np.abs(other).max())
print("agree")
"""
    assert run(code).stdout.strip() == "agree"


def test_on_a_device():
    """The same answers as on the processor, through the loaded backend."""
    if not bromwich.cuda_devices():
        pytest.skip(bromwich.backends()["cuda"].detail)
    scene = bromwich.scene("signorini", Q=31)
    for method in ("contour", "multigrid", "march"):
        device = bromwich.solve(scene, steps=200, method=method, backend="cuda", check=True)
        assert device.backend == "cuda"
        host = bromwich.solve(scene, steps=200, method=method, backend="cpu", check=True)
        np.testing.assert_allclose(device.y, host.y, atol=1e-9 * np.max(np.abs(host.y)))
    with pytest.raises(bromwich.Error):
        bromwich.solve(scene, steps=200, backend="cuda", method="nothing")
