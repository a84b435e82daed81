"""Gradients by PyTorch and JAX, where they are installed, against differences and against Derivative."""

import bromwich
import numpy as np
import pytest

STEPS = 60
T = 2.0


@pytest.fixture
def data():
    rng = np.random.default_rng(3)
    P = rng.normal(size=(2, 2))
    t = np.linspace(0, T, STEPS + 1)[:, None]
    return dict(
        A=rng.normal(size=(3, 3)) - np.eye(3),
        B=rng.normal(size=(3, 2)),
        N=rng.normal(size=(2, 3)),
        M=P @ P.T + np.eye(2),
        x0=rng.normal(size=3),
        g=np.sin(3 * t + np.array([0.3, 1.1])),
    )


def expected(data):
    r = bromwich.solve(**data, T=T, steps=STEPS, method="march", states="all")
    bar = r.derivative().vjp(y=2 * r.y, x=np.cos(r.x))
    return (r.y**2).sum() + np.sin(r.x).sum(), bar._asdict()


def one_by_one(data, scenes, weights):
    """The gradients of sum(weights * y) of each scene alone."""
    bars = []
    for changes in scenes:
        r = bromwich.solve(**{**data, **changes}, T=T, steps=STEPS, method="march", states="all")
        bars.append(r.derivative().vjp(y=weights)._asdict())
    return {name: np.stack([bar[name] for bar in bars]) for name in data}


def test_leading_axes_are_scenes(data):
    from bromwich._differentiable import DATA, Solved

    x0 = np.stack([data["x0"] * (1 + 0.1 * k) for k in range(3)])
    M = np.stack([data["M"] + 0.1 * k * np.eye(2) for k in range(2)])
    arrays = {name: data.get(name) for name in DATA}
    solved = Solved({**arrays, "x0": x0[:, None], "M": M}, T, STEPS, "march", 1)
    y, x, w = solved.outputs()
    assert (y.shape, x.shape, w.shape) == ((3, 2, STEPS + 1, 2), (3, 2, STEPS + 1, 3), (3, 2, STEPS + 1, 2))
    weights = np.cos(np.arange(2.0 * (STEPS + 1))).reshape(STEPS + 1, 2)
    alone = one_by_one(data, [dict(x0=a, M=b) for a in x0 for b in M], weights)
    of = tuple(np.broadcast_to(v, (3, 2, *v.shape)) for v in (weights, np.zeros((STEPS + 1, 3)), 0 * weights))
    each = dict(zip(DATA, solved.gradient(of)))
    shapes = [None if name == "f" else np.shape(v) for name, v in {**arrays, "x0": x0[:, None], "M": M}.items()]
    total = dict(zip(DATA, solved.gradient(of, shapes)))
    assert each["f"] is None and total["f"] is None
    for name in data:
        own = alone[name].reshape(3, 2, *alone[name].shape[1:])
        np.testing.assert_allclose(each[name], own, rtol=1e-9, atol=1e-10)
        expect = {"x0": own.sum(1, keepdims=True), "M": own.sum(0)}.get(name, own.sum((0, 1)))
        np.testing.assert_allclose(total[name], expect, rtol=1e-9, atol=1e-9)
    # Several weights of scenes that have one axis less.
    rows = Solved({**arrays, "x0": x0}, T, STEPS, "march", 1)
    several = tuple(np.stack([v[:, 0], 2 * v[:, 0]], 1) for v in of)
    found = dict(zip(DATA, rows.gradient(several, mapped=(True, False))))
    for k in (0, 1):
        np.testing.assert_allclose(found["M"][:, k], (1 + k) * alone["M"].reshape(3, 2, 2, 2)[:, 0], rtol=1e-9, atol=1e-9)


def test_no_scene_and_one_scene(data):
    from bromwich._differentiable import DATA, Solved

    arrays = {name: data.get(name) for name in DATA}
    for count in (0, 1):
        solved = Solved({**arrays, "x0": np.tile(data["x0"], (count, 1))}, T, STEPS, "march", 1)
        y, x, w = solved.outputs()
        assert y.shape == (count, STEPS + 1, 2)
        assert solved.gradient((y, x, w))[3].shape == (count, 3, 3)


def test_refusals_of_arrays(data):
    from bromwich._differentiable import DATA, Solved, whole

    arrays = {name: data.get(name) for name in DATA}
    for change, words in [
        (dict(x0=1.0), "x0: has 0 axes"),
        (dict(g=data["g"][:-1]), "g: has 60 rows; give 61"),
        (dict(x0=np.zeros((3, 3)), M=np.zeros((2, 2, 2))), "leading axes: do not fit"),
    ]:
        with pytest.raises(bromwich.Error, match=words):
            Solved({**arrays, **change}, T, STEPS, "march", 1)
    with pytest.raises(bromwich.NotSolved, match="scene 1: unsupported: x0"):
        Solved({**arrays, "x0": np.array([data["x0"], [np.nan, 0, 0]])}, T, STEPS, "march", 1)
    # The derivative of one scene is refused: y = w = 0 from x0 = 0.
    eye = np.eye(1)
    flat = Solved(dict(x0=np.array([[-1.0], [0.0]]), A=-eye, B=eye, N=eye, M=eye, f=None, g=None), 1.0, 20, "march", 1)
    with pytest.raises(bromwich.Error, match="scene 1: .*not differentiable here"):
        flat.gradient(flat.outputs())
    for bad in (2.5, True):
        with pytest.raises(bromwich.Error, match="steps"):
            whole(bad)
    assert whole(3.0) == 3


def test_torch(data):
    torch = pytest.importorskip("torch")
    from bromwich.torch import solve

    tensors = {name: torch.tensor(v, dtype=torch.float64, requires_grad=True) for name, v in data.items()}
    y, x, w = solve(**tensors, T=T, steps=STEPS)
    loss = (y**2).sum() + torch.sin(x).sum()
    loss.backward()
    value, bar = expected(data)
    assert loss.item() == pytest.approx(value, rel=1e-13)
    for name, tensor in tensors.items():
        np.testing.assert_allclose(tensor.grad.numpy(), bar[name], rtol=1e-11, atol=1e-11)


def test_torch_scenes(data):
    torch = pytest.importorskip("torch")
    from bromwich.torch import solve

    tensors = {name: torch.tensor(v) for name, v in data.items()}
    x0 = torch.stack([tensors["x0"] * (1 + 0.1 * k) for k in range(3)])
    weights = torch.cos(torch.arange(2.0 * (STEPS + 1), dtype=torch.float64)).reshape(STEPS + 1, 2)
    alone = one_by_one(data, [dict(x0=v) for v in x0.numpy()], weights.numpy())

    def number(A, x):
        return (weights * solve(**{**tensors, "A": A, "x0": x}, T=T, steps=STEPS)[0]).sum((-2, -1))

    A = tensors["A"].clone().requires_grad_()
    number(A, x0).sum().backward()
    np.testing.assert_allclose(A.grad, alone["A"].sum(0), rtol=1e-9, atol=1e-9)
    each = torch.vmap(torch.func.grad(number), (None, 0))(tensors["A"], x0)
    np.testing.assert_allclose(each, alone["A"], rtol=1e-9, atol=1e-9)
    rows = torch.func.jacrev(lambda x: solve(**{**tensors, "x0": x}, T=T, steps=STEPS)[0])(x0[0])
    np.testing.assert_allclose((weights[..., None] * rows).sum((0, 1)), alone["x0"][0], rtol=1e-9, atol=1e-9)
    with pytest.raises(bromwich.Error, match="derivative of a derivative|of a derivative is not there"):
        torch.autograd.functional.hessian(lambda x: number(tensors["A"], x), x0[0])
    whole = solve(**{**tensors, "x0": torch.tensor([1, 0, 0])}, T=T, steps=STEPS)
    assert whole[0].dtype == torch.float64
    for name, bad in [("A", tensors["A"].numpy()), ("A", tensors["A"].to(torch.complex128))]:
        with pytest.raises(bromwich.Error, match="A: is"):
            solve(**{**tensors, name: bad}, T=T, steps=STEPS)
    sparse = solve(**{**tensors, "A": tensors["A"].to_sparse()}, T=T, steps=STEPS)
    assert torch.equal(sparse[0], solve(**tensors, T=T, steps=STEPS)[0])


def test_jax(data):
    jax = pytest.importorskip("jax")
    from bromwich.jax import solve

    jax.config.update("jax_enable_x64", True)

    def loss(d):
        y, x, w = solve(**d, T=T, steps=STEPS)
        return (y**2).sum() + jax.numpy.sin(x).sum()

    value, bar = expected(data)
    for gradient in (jax.grad(loss)(data), jax.jit(jax.grad(loss))(data)):
        for name in data:
            np.testing.assert_allclose(gradient[name], bar[name], rtol=1e-11, atol=1e-11)
    several = np.stack([data["x0"], 2 * data["x0"]])
    mapped = jax.vmap(lambda x0: loss({**data, "x0": x0}))(several)
    assert mapped[0] == pytest.approx(value, rel=1e-13)
    assert mapped[1] == pytest.approx(float(loss({**data, "x0": several[1]})), rel=1e-13)
    each = jax.vmap(lambda x0: jax.grad(loss)({**data, "x0": x0}))(several)
    second = jax.grad(loss)({**data, "x0": several[1]})
    for name in data:
        np.testing.assert_allclose(each[name][1], second[name], rtol=1e-9, atol=1e-9)
    rows = jax.jacrev(lambda M: solve(**{**data, "M": M}, T=T, steps=STEPS)[0])(data["M"])
    np.testing.assert_allclose((2 * solve(**data, T=T, steps=STEPS)[0][..., None, None] * rows).sum((0, 1)) +
                               jax.grad(lambda M: jax.numpy.sin(solve(**{**data, "M": M}, T=T, steps=STEPS)[1]).sum())(data["M"]),
                               bar["M"], rtol=1e-9, atol=1e-9)
    with pytest.raises(bromwich.Error, match="more by jax.vmap"):
        loss({**data, "x0": several})
