"""Gradients of solves whose arrays stay on a CUDA device, by PyTorch and JAX where they are installed. Without a device, a
pretended one (pretended_cuda.cpp) counts the copies between it and the host."""

import os
import subprocess
import sys
import textwrap

import bromwich
import numpy as np
import pytest

STEPS, T, SCENES = 60, 2.0, 3


def drawn():
    rng = np.random.default_rng(3)
    P = rng.normal(size=(2, 2))
    t = np.linspace(0, T, STEPS + 1)[:, None]
    k = np.arange(SCENES)[:, None, None]
    return dict(
        A=rng.normal(size=(3, 3)) - np.eye(3),
        B=rng.normal(size=(3, 2)),
        N=rng.normal(size=(2, 3)),
        M=P @ P.T + np.eye(2),
        x0=rng.normal(size=(SCENES, 3)),
        f=0.3 * np.cos(2 * t + np.arange(3)),
        g=np.sin(3 * t + np.array([0.3, 1.1]) + 0.2 * k),
    )


def expected(data):
    """y, x and w, and the gradients of sum(y^2 + w) + sum(sin x), of the scenes one by one on the host."""
    rows, bars = [], []
    for k in range(SCENES):
        own = {**data, "x0": data["x0"][k], "g": data["g"][k]}
        r = bromwich.solve(**own, T=T, steps=STEPS, method="march", states="all", backend="cpu", check=True)
        rows.append((r.y, r.x, r.w))
        bars.append(r.derivative().vjp(y=2 * r.y, x=np.cos(r.x), w=np.ones_like(r.w))._asdict())
    each = {name: np.stack([bar[name] for bar in bars]) for name in data}
    total = {name: each[name] if name in ("x0", "g") else each[name].sum(0) for name in data}
    return tuple(np.stack(v) for v in zip(*rows)), total


def same(found, wanted):
    """The same steps in another order of operations: rounding times the condition of the problems."""
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-11 * max(1.0, np.max(np.abs(wanted))))


def with_torch(data, where, **on):
    import torch
    from bromwich.torch import solve

    tensors = {name: torch.tensor(v, dtype=torch.float64, device=where, requires_grad=True) for name, v in data.items()}
    found = solve(**tensors, T=T, steps=STEPS, backend="cuda", **on)
    assert all(v.device == tensors["x0"].device and v.dtype == torch.float64 for v in found)
    y, x, w = found
    ((y**2).sum() + torch.sin(x).sum() + w.sum()).backward()
    assert all(v.grad.device == v.device for v in tensors.values())
    return tuple(v.detach().cpu().numpy() for v in found), {name: v.grad.cpu().numpy() for name, v in tensors.items()}


def with_jax(data, where, **on):
    import jax
    from bromwich.jax import solve

    jax.config.update("jax_enable_x64", True)
    arrays = {name: jax.device_put(jax.numpy.asarray(v), where) for name, v in data.items()}

    def loss(d):
        y, x, w = solve(**d, T=T, steps=STEPS, backend="cuda", **on)
        return (y**2).sum() + jax.numpy.sin(x).sum() + w.sum(), (y, x, w)

    (_, found), bars = jax.value_and_grad(loss, has_aux=True)(arrays)
    assert all(v.devices() == arrays["x0"].devices() for v in (*found, *bars.values()))
    return tuple(np.asarray(v) for v in found), {name: np.asarray(v) for name, v in bars.items()}


def compare(found, data):
    rows, bars = expected(data)
    for one, other in zip(found[0], rows):
        same(one, other)
    for name in data:
        same(found[1][name], bars[name])


# ---- On a device.


def device():
    if not bromwich.cuda_devices():
        pytest.skip(bromwich.backends()["cuda"].detail)


def test_torch_on_a_device():
    device()
    torch = pytest.importorskip("torch")
    data = drawn()
    compare(with_torch(data, "cuda"), data)
    # Several in a row, while the library is still at work on what it hands over.
    from bromwich.torch import solve

    host = {name: torch.tensor(v) for name, v in data.items()}
    wanted = solve(**host, T=T, steps=STEPS)[0]
    late = torch.eye(1200, dtype=torch.float64, device="cuda") * 0.5
    for _ in range(5):
        for _ in range(20):
            late = late @ late * 2
        scaled = {name: v.cuda() * (2 * late[0, 0]) if name in ("x0", "f", "g") else v.cuda() for name, v in host.items()}
        same(solve(**scaled, T=T, steps=STEPS, backend="cuda")[0].cpu().numpy(), wanted.numpy())
    with pytest.raises(bromwich.Error, match="x0: lies on the host"):
        solve(**host, T=T, steps=STEPS, backend="cuda")
    mapped_with_torch("cuda")


def mapped_with_torch(where, **on):
    """A gradient for each scene by vmap, of x0 and of an A that the scenes share."""
    import torch
    from bromwich.torch import solve

    def gradients(where, **on):
        data = {name: torch.tensor(v, device=where) for name, v in drawn().items()}
        own = {**data, "g": data["g"][0]}
        number = lambda x, A: solve(**{**own, "x0": x, "A": A}, T=T, steps=STEPS, **on)[0].sum()
        return torch.vmap(torch.func.grad(number, (0, 1)), (0, None))(data["x0"], data["A"])

    for found, wanted in zip(gradients(where, backend="cuda", **on), gradients("cpu")):
        same(found.cpu().numpy(), wanted.numpy())


def test_jax_on_a_device():
    device()
    jax = pytest.importorskip("jax")
    try:
        gpu = jax.devices("gpu")[0]
    except RuntimeError as error:
        pytest.skip(str(error))
    data = drawn()
    compare(with_jax(data, gpu), data)


def test_many_scenes_on_a_device():
    """A batch above one warp, against the same solves on the host."""
    device()
    torch = pytest.importorskip("torch")
    from bromwich.torch import solve

    data = drawn()
    rng = np.random.default_rng(5)
    data["x0"], data["g"] = rng.normal(size=(300, 3)), data["g"][0]
    grads = []
    for where, on in (("cuda", dict(backend="cuda")), ("cpu", {})):
        tensors = {name: torch.tensor(v, device=where, requires_grad=True) for name, v in data.items()}
        solve(**tensors, T=T, steps=STEPS, **on)[0].square().sum().backward()
        grads.append({name: v.grad.cpu().numpy() for name, v in tensors.items()})
    for name in data:
        same(grads[0][name], grads[1][name])


def batch_and_host(**on):
    """The derivatives of a batch on a device and on the host: the same values, and the same scene without any."""
    rng = np.random.default_rng(6)
    data = drawn()
    data["x0"] = rng.normal(size=(40, 3))
    data["x0"][7, 0] = np.nan
    data["f"] = None
    times = np.linspace(0, T, STEPS + 1)
    g = lambda t: np.sin(3 * t + np.array([0.3, 1.1]))
    scenes = {name: v for name, v in data.items() if v is not None and name != "g"}
    found = []
    for where in (dict(backend="cuda", **on), dict(backend="cpu")):
        r = bromwich.solve_batch(**scenes, g=g, T=T, steps=STEPS, method="march", check=False, **where)
        found.append(r.derivative())
    one, other = found
    assert (one.side_by_side, other.side_by_side) == (39, 0)
    dA, weights = rng.normal(size=(3, 3)), np.cos(times)[:, None] * np.ones(2)
    (change, why), (wanted, why_not) = (d.jvp(A=dA, x0=np.ones(3)) for d in found)
    (bar, reason), (wanted_bar, reason_not) = (d.vjp(y=weights) for d in found)
    assert [bool(w) for w in why] == [bool(w) for w in why_not] == [k == 7 for k in range(40)] and len(reason) == len(reason_not)
    solved = [k for k in range(40) if k != 7]
    for name in ("y", "x", "w", "integral"):
        same(getattr(change, name)[solved], getattr(wanted, name)[solved])
    for name in ("x0", "f", "g", "A", "B", "N", "M"):
        same(getattr(bar, name)[solved], getattr(wanted_bar, name)[solved])
    assert np.isnan(change.y[7]).all() and np.isnan(bar.A[7]).all()


def test_derivatives_of_a_batch_on_a_device():
    device()
    batch_and_host()


# ---- Without one.

PRETENDED = os.environ.get("BROMWICH_PRETENDED_CUDA", "")


def pretended(code, tmp_path):
    """Runs in a process whose device counts copies; they are returned as (rows, columns)."""
    if not PRETENDED:
        pytest.skip("BROMWICH_PRETENDED_CUDA is not set")
    copies = tmp_path / "copies"
    copies.touch()
    head = f"""
import sys
sys.path.insert(0, {os.path.dirname(os.path.abspath(__file__))!r})
import bromwich, numpy as np
bromwich._core.set_cuda_plugin({PRETENDED!r})
from test_on_device import *
"""
    environment = {**os.environ, "BROMWICH_PRETENDED_COPIES": str(copies), "JAX_PLATFORMS": "cpu"}
    run = subprocess.run([sys.executable, "-c", head + textwrap.dedent(code)], env=environment, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr[-3000:]
    return [tuple(map(int, line.split()[1:])) for line in copies.read_text().splitlines()]


#: Gradients with respect to A (through the maps of a step), B, N and M, a row for each scene.
SMALL = (SCENES, 3 * 9 + 2 * 6 + 4)


@pytest.mark.parametrize("library", ["torch", "jax"])
def test_nothing_passes_through_the_host(library, tmp_path):
    pytest.importorskip(library)
    where = {"torch": '"cpu"', "jax": "jax.devices()[0]"}[library]
    found = pretended(
        f"""
        import {library}
        data = drawn()
        compare(with_{library}(data, {where}, threads=5), data)
        """,
        tmp_path,
    )
    assert found == [SMALL]


def test_gradients_of_each_scene_by_vmap(tmp_path):
    pytest.importorskip("torch")
    assert pretended('mapped_with_torch("cpu", threads=5)', tmp_path) == [SMALL]


def test_derivatives_of_a_batch(tmp_path):
    pretended("batch_and_host(threads=5)", tmp_path)


def test_jax_refuses_to_compile_it(tmp_path):
    pytest.importorskip("jax")
    pretended(
        """
        import jax
        from bromwich.jax import solve
        jax.config.update("jax_enable_x64", True)
        data = drawn()
        for wrapped in (jax.jit, jax.vmap):
            try:
                wrapped(lambda x: solve(**{**data, "x0": x, "g": data["g"][0]}, T=T, steps=STEPS, backend="cuda", threads=5)[0])(data["x0"])
            except bromwich.Error as error:
                assert "inside jax.jit or jax.vmap" in str(error)
            else:
                raise AssertionError("not refused")
        """,
        tmp_path,
    )


def test_the_interface_of_arrays(tmp_path):
    """The part that both wrappers share, with NumPy in the place of a library."""
    found = pretended(
        """
        from bromwich._differentiable import DATA
        from bromwich._on_device import Library, SolvedOnDevice
        numpy = Library(np.broadcast_to, lambda v, s: np.ascontiguousarray(v).reshape(s), np.from_dlpack, lambda v, _: v,
                        lambda v, axes, keep: v.sum(axis=axes, keepdims=keep), np.asarray)
        data = drawn()
        def solved(threads=5, **changes):
            arrays = {name: {**data, **changes}.get(name) for name in DATA}
            return arrays, SolvedOnDevice(numpy, arrays, T, STEPS, "march", threads, None)
        arrays, one = solved()
        rows = one.outputs()
        bars = one.gradient((2 * rows[0], np.cos(rows[1]), np.ones_like(rows[2])), [v.shape for v in arrays.values()])
        compare((rows, dict(zip(DATA, bars))), data)
        each = dict(zip(DATA, one.gradient((2 * rows[0], np.cos(rows[1]), np.ones_like(rows[2])))))
        assert each["A"].shape == (SCENES, 3, 3) and each["f"].shape == (SCENES, STEPS + 1, 3)
        same(each["A"].sum(0), bars[DATA.index("A")])
        alone = solved(f=None, x0=data["x0"][0], g=data["g"][0])[1]
        assert alone.outputs()[0].shape == (STEPS + 1, 2) and alone.gradient(alone.outputs())[1] is None
        def refused(match, kind=bromwich.Error, **changes):
            try:
                solved(**changes)[1].gradient((rows[0], rows[1], rows[2]))
            except kind as error:
                assert match in str(error), error
            else:
                raise AssertionError("not refused: " + match)
        refused("M: has leading axes", M=np.stack([data["M"]] * SCENES))
        refused("g: has 60 rows; give 61", g=data["g"][:, :-1])
        refused("y may jump", M=np.zeros((2, 2)))
        refused("has 9 states", A=-np.eye(9), B=np.ones((9, 2)), N=np.ones((2, 9)), x0=np.zeros(9), f=None)
        refused("scene 1: ", kind=bromwich.NotSolved, x0=np.array([[0, 0, 0], [np.nan, 0, 0], [0, 0, 0]]))
        refused("weights: have axes", x0=data["x0"][0], g=data["g"][0])
        """,
        tmp_path,
    )
    assert set(found) <= {SMALL, (1, SMALL[1])}
