"""Arrays that stay where they are: on the host here, on a CUDA device where there is one, with any of PyTorch, CuPy and
JAX that is installed (JAX with jax_enable_x64)."""

import importlib

import bromwich
import numpy as np
import pytest

STEPS = 200


def tables(scene, T):
    t = np.linspace(0, T, STEPS + 1)[:, None]
    i = np.arange(scene.constraints)
    return -0.5 * np.sin(2 * t + 0.1 * i), 0.3 * np.cos(3 * t + i)


@pytest.fixture
def small():
    return bromwich.scene("signorini", Q=15)


def marched(scene, g, f, x0=None):
    """Another method, with the same sources as tables."""
    solver = bromwich.Solver(scene, steps=STEPS, method="march", backend="cpu", states="none")
    solver.set_sources(f=(np.linspace(0, scene.T, STEPS + 1), f), g=(np.linspace(0, scene.T, STEPS + 1), g))
    if x0 is not None:
        solver.set_x0(x0)
    return solver.solve(check=True)


def close(found, expected):
    """Sweeps end below 1e-12; the weights of both methods are those of one kernel, to 1e-10."""
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8 * max(1.0, np.max(np.abs(expected))))


# ---- On the host.


def test_host_arrays(small):
    g, f = tables(small, small.T)
    solver = bromwich.ArraySolver(small, steps=STEPS, backend="cpu")
    assert solver.device == (1, 0)
    r = solver.solve(g=g, f=f, check=True)
    expected = marched(small, g, f)
    y, w = np.from_dlpack(r.y), np.from_dlpack(r.w)
    assert y.shape == r.y.shape == (STEPS + 1, 15) and r.y.__dlpack_device__() == (1, 0)
    assert np.max(y) > 1e-3 and r.residual < 1e-10 and r.iterations > 1 and r.t[-1] == small.T
    close(y, expected.y)
    close(w, expected.w)
    assert np.shares_memory(y, np.from_dlpack(r.y))
    np.testing.assert_array_equal(np.asarray(r.y), y)


def test_results_outlive_their_solver(small):
    g, f = tables(small, small.T)
    solver = bromwich.ArraySolver(small, steps=STEPS, backend="cpu")
    first = solver.solve(g=g, f=f)
    kept = np.from_dlpack(first.y)
    before = kept.copy()
    second = solver.solve(g=0.5 * g)  # f stays
    del first, solver
    np.testing.assert_array_equal(kept, before)
    close(np.from_dlpack(second.y), marched(small, 0.5 * g, f).y)


def test_another_x0(small):
    g, f = tables(small, small.T)
    x0 = np.linspace(0, 0.3, small.states)
    solver = bromwich.ArraySolver(small, steps=STEPS, backend="cpu")
    solver.solve(g=g, f=f)
    solver.set_x0(x0)
    close(np.from_dlpack(solver.solve().y), marched(small, g, f, x0).y)


def test_what_is_refused(small):
    solver = bromwich.ArraySolver(small, steps=STEPS, backend="cpu")
    with pytest.raises(bromwich.Error, match=r"g: has shape \(7, 15\); give \(201, 15\)"):
        solver.solve(g=np.zeros((7, 15)))
    with pytest.raises(bromwich.Error, match="boundary values"):
        bromwich.ArraySolver(bromwich.scene("periodic-rectifier"))
    with pytest.raises(bromwich.Error, match="bromwich.Scene"):
        bromwich.ArraySolver("signorini")

    class Elsewhere:
        dtype = np.dtype(np.float64)

        def __dlpack_device__(self):
            return (2, 0)

    with pytest.raises(bromwich.Error, match=r"g: lies on device \(2, 0\); give an array on device \(1, 0\)"):
        solver.solve(g=Elsewhere())
    g, f = tables(small, small.T)
    with pytest.warns(bromwich.NotSolvedWarning):
        assert solver.solve(g=np.full_like(g, np.nan)).status != "solved"
    assert solver.solve(g=g).status == "solved"  # nothing of it stays


def test_interruption(small):
    g, f = tables(small, small.T)
    solver = bromwich.ArraySolver(small, steps=STEPS, backend="cpu")
    assert solver.solve(g=g, f=f, stop=lambda: True).status == "interrupted"

    def broken():
        raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        solver.solve(g=g, f=f, stop=broken)


# ---- On a device.


def numpy_of(a):
    return np.asarray(a.cpu() if hasattr(a, "cpu") else a.get() if hasattr(a, "get") else a)


def library(name):
    """(array of NumPy -> array on the device, DLPack -> array of the library, its address)."""
    if not bromwich.cuda_devices():
        pytest.skip(bromwich.backends()["cuda"].detail)
    module = pytest.importorskip(name)
    if name == "torch":
        return lambda a: module.asarray(a, device="cuda"), module.from_dlpack, lambda a: a.data_ptr()
    if name == "cupy":
        return module.asarray, module.from_dlpack, lambda a: a.data.ptr
    module.config.update("jax_enable_x64", True)
    jnp = importlib.import_module("jax.numpy")
    device = module.devices("gpu")[0]
    return (
        lambda a: module.device_put(jnp.asarray(a), device),
        importlib.import_module("jax.dlpack").from_dlpack,
        lambda a: a.unsafe_buffer_pointer(),
    )


LIBRARIES = ["torch", "cupy", "jax"]


@pytest.mark.parametrize("name", LIBRARIES)
def test_device_arrays(name, small):
    """In and out on the device; out without a copy: the address of the array is that of the result."""
    put, take, address = library(name)
    g, f = tables(small, small.T)
    solver = bromwich.ArraySolver(small, steps=STEPS, backend="cuda")
    assert solver.device[0] == 2
    r = solver.solve(g=put(g), f=put(f), check=True)
    assert r.backend == "cuda" and r.y.__dlpack_device__() == solver.device
    expected = marched(small, g, f)
    y, w = take(r.y), take(r.w)
    assert address(y) == r.y.__cuda_array_interface__["data"][0]
    assert not isinstance(y, np.ndarray)
    close(numpy_of(y), expected.y)
    close(numpy_of(w), expected.w)
    close(np.asarray(r.y), expected.y)


@pytest.mark.parametrize("name", LIBRARIES)
def test_work_of_the_library_is_waited_for(name, small):
    """g is still being computed when it is handed over; the result is there when `solve` returns."""
    put, take, _ = library(name)
    g, f = tables(small, small.T)
    solver = bromwich.ArraySolver(small, steps=STEPS, backend="cuda")
    expected = marched(small, g, f).y
    for _ in range(5):
        late = put(np.eye(1200)) * 0.5
        for _ in range(20):
            late = late @ late * 2  # 0.5 I again and again
        scale = 2 * late[0, 0]
        r = solver.solve(g=put(g) * scale, f=put(f), check=True)
        close(numpy_of(take(r.y) + 0), expected)


@pytest.mark.parametrize("name", LIBRARIES)
def test_solve_copies_what_lies_on_a_device(name, small):
    put, _, _ = library(name)
    given = dict(A=-np.eye(2), B=np.eye(2), N=np.eye(2), M=np.eye(2), x0=np.array([0.1, 0.2]))
    given["g"] = -np.sin(np.linspace(0, 6, 101))[:, None] * [1.0, 0.5]
    found = bromwich.solve(**{k: put(v) for k, v in given.items()}, T=2.0, check=True)
    np.testing.assert_array_equal(found.y, bromwich.solve(**given, T=2.0).y)


@pytest.mark.parametrize("name", LIBRARIES)
def test_arrays_in_the_wrong_place(name, small):
    put, _, _ = library(name)
    g, _ = tables(small, small.T)
    solver = bromwich.ArraySolver(small, steps=STEPS, backend="cuda")
    with pytest.raises(bromwich.Error, match="g: lies on the host"):
        solver.solve(g=g)
    with pytest.raises(bromwich.Error, match="float64"):
        solver.solve(g=put(g.astype(np.float32)))
    with pytest.raises(bromwich.Error, match="shape"):
        solver.solve(g=put(g[:7].copy()))
    with pytest.raises(bromwich.Error, match=r"device \(2, 0\)"):
        bromwich.ArraySolver(small, steps=STEPS, backend="cpu").solve(g=put(g))


@pytest.mark.parametrize("size", [1, 5, 15, 16, 63])
def test_widths_on_a_device(size):
    """Rows of the device's arrays are padded from 16 on: signorini has a tridiagonal M; here dense ones too."""
    put, take, _ = library("torch")
    rng = np.random.default_rng(size)
    A = -np.diag(np.linspace(1, 2, size))
    M = np.eye(size) * 3 + rng.uniform(-0.5, 0.5, (size, size)) / size
    scene = bromwich.Scene(A=A, B=np.eye(size), N=np.eye(size), M=M, x0=np.zeros(size), T=2.0)
    t = np.linspace(0, 2, STEPS + 1)[:, None]
    g = -np.sin(3 * t + np.arange(size))
    r = bromwich.ArraySolver(scene, steps=STEPS, backend="cuda").solve(g=put(g), check=True)
    host = bromwich.ArraySolver(scene, steps=STEPS, backend="cpu").solve(g=g, check=True)
    close(numpy_of(take(r.y)), np.asarray(host.y))
    close(numpy_of(take(r.w)), np.asarray(host.w))


@pytest.mark.parametrize("name", LIBRARIES)
def test_batches_stay_on_the_device(name):
    """Their rows there are those that the processor gives, also of scenes that the device has not settled."""
    _, take, address = library(name)
    rng = np.random.default_rng(5)
    scenes = dict(A=-np.eye(2) + 0.2 * rng.normal(size=(80, 2, 2)), B=np.eye(2), N=np.eye(2), M=np.eye(2), T=3.0, steps=64)
    x0 = rng.normal(size=(80, 2))
    x0[7] = np.nan  # refused, and a row of NaN
    scenes |= dict(g=["-sin(3*t)", "0.3 - cos(t)"], f=["cos(2*t)", "0"], x0=x0, check=False)
    on_host = bromwich.solve_batch(**scenes, backend="cpu")
    r = bromwich.solve_batch(**scenes, backend="cuda", results="device")
    assert r.y.shape == (80, 65, 2) and r.status == on_host.status and r.w.shape == (80, 65, 0)
    y, x = take(r.y), take(r.x)
    assert address(y) == r.y.__cuda_array_interface__["data"][0]
    for found, expected in ((y, on_host.y), (x, on_host.x), (r.y, on_host.y)):
        found = numpy_of(found)
        np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
        assert np.nanmax(np.abs(found - expected)) <= 1e-12
    np.testing.assert_allclose(r.mean("x0")[:5], on_host.mean("x0")[:5], rtol=0, atol=1e-12)
    with pytest.raises(bromwich.Error, match="results"):
        r.derivative()
