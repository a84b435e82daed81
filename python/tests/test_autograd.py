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


def several_scenes(data):
    """Four scenes of which the second is not solved, and what must not change for the others."""
    x0 = np.stack([data["x0"], np.full(3, np.nan), -data["x0"], 2 * data["x0"]])
    return x0, [0, 2, 3]


@pytest.mark.parametrize("failed, value", [("nan", np.nan), ("zero", 0)])
def test_one_scene_that_fails_spoils_nothing(data, failed, value):
    from bromwich._differentiable import DATA, STATUSES, Solved

    x0, good = several_scenes(data)
    arrays = {**{name: data.get(name) for name in DATA}, "x0": x0}
    solved = Solved(arrays, T, STEPS, "march", 1, None, 1, failed)
    assert [STATUSES[k] for k in solved.status] == ["solved", "unsupported", "solved", "solved"]
    y, x, w = solved.outputs()
    alone = Solved({**arrays, "x0": x0[good]}, T, STEPS, "march", 1)
    for found, expect in zip((y, x, w), alone.outputs()):
        assert np.isnan(found[1]).all()
        np.testing.assert_allclose(found[good], expect, rtol=1e-12, atol=1e-12)
    of = tuple(np.cos(v) for v in (y, x, w))  # NaN where there is no solution
    for found, expect in zip(solved.gradient(of), alone.gradient(tuple(v[good] for v in of))):
        if found is not None:
            np.testing.assert_array_equal(found[1], np.full_like(found[1], value))
            np.testing.assert_allclose(found[good], expect, rtol=1e-9, atol=1e-10)
    changes = dict(M=np.eye(2), x0=np.ones((4, 3)))
    for found, expect in zip(solved.tangent(changes), alone.tangent({**changes, "x0": np.ones((3, 3))})):
        np.testing.assert_array_equal(found[1], np.full_like(found[1], value))
        np.testing.assert_allclose(found[good], expect, rtol=1e-9, atol=1e-10)
    # One that is unstable: e^{2a} = 1e173 is its solution, and the sum of squares over all scenes overflows.
    A = np.stack([-np.eye(1), 200 * np.eye(1)])
    one = dict(zip(DATA, (np.ones((2, 1)), None, None, A, np.eye(1), np.eye(1), np.eye(1))))
    unstable = Solved(one, T, STEPS, "march", 1, None, 1, failed)
    assert [STATUSES[k] for k in unstable.status] == ["solved", "nonfinite"]
    bar = unstable.gradient(unstable.outputs())[DATA.index("A")]
    assert np.isfinite(bar[0]).all() and np.array_equal(bar[1], [[value]], equal_nan=True)
    with pytest.raises(bromwich.NotSolved, match="scene 1: nonfinite"):
        Solved(one, T, STEPS, "march", 1)
    # Numbers that all scenes share are as much those of each scene.
    shared = Solved({**arrays, "A": np.full((3, 3), np.inf), "x0": x0[good]}, T, STEPS, "march", 1, None, 1, failed)
    assert (shared.status != 0).all() and np.isnan(shared.outputs()[0]).all()


@pytest.mark.parametrize("tol, refine", [(None, 1), (None, 3), (1e-8, 1)])
def test_tangents_and_gradients_are_transposed(data, tol, refine):
    from bromwich._differentiable import DATA, Solved

    rng = np.random.default_rng(8)
    arrays = {**{name: data.get(name) for name in DATA}, "x0": np.stack([data["x0"], -data["x0"]])}
    solved = Solved(arrays, T, STEPS, "march", 1, tol, refine)
    of = tuple(rng.normal(size=v.shape) for v in solved.outputs())
    changes = {name: rng.normal(size=np.shape(v)) for name, v in arrays.items() if v is not None}
    shapes = [None if arrays[name] is None else np.shape(arrays[name]) for name in DATA]
    bars = dict(zip(DATA, solved.gradient(of, shapes)))
    forward = sum((a * b).sum() for a, b in zip(of, solved.tangent(changes)))
    assert forward == pytest.approx(sum((bars[name] * changes[name]).sum() for name in changes), rel=1e-9)
    # Several changes of scenes that have one axis less.
    two = {name: np.stack([v, 2 * v]) for name, v in changes.items() if name != "x0"} | {"x0": 0 * arrays["x0"]}
    two = {name: v[:, None] if name != "x0" else v for name, v in two.items()}
    several = solved.tangent(two, mapped=(False,))
    np.testing.assert_allclose(several[1][1], 2 * several[1][0], rtol=1e-9, atol=1e-12)


def test_refined_and_located_values(data):
    from bromwich._differentiable import DATA, Solved, how

    arrays = {name: data.get(name) for name in DATA}
    x0 = dict(x0=np.stack([data["x0"], data["x0"]]))
    fine = bromwich.solve(**data, T=T, steps=STEPS, method="events", tol=1e-7, states="all")
    exact = fine.at(np.linspace(0, T, STEPS + 1)).x
    located = Solved({**arrays, **x0}, T, STEPS, "march", 1, 1e-7).outputs()[1]
    np.testing.assert_allclose(located[0], exact, atol=1e-6 * np.abs(exact).max())
    off = [np.abs(Solved(arrays, T, STEPS, "march", 1, None, k).outputs()[1] - exact).max() for k in (1, 4)]
    assert off[1] <= off[0] / 4, "of order one at least"
    for change, words in [
        (dict(failed="skip"), "failed: found 'skip'; use raise, nan, zero"),
        (dict(refine=0), "refine: found 0"),
        (dict(tol=1e-6, method="contour"), "method: is given together with tol"),
        (dict(tol=1e-6, refine=2), "refine: is given together with tol"),
    ]:
        with pytest.raises(bromwich.Error, match=words):
            how(**{**dict(T=1.0, steps=10, method="march", threads=0, tol=None, refine=1, failed="raise"), **change})


@pytest.mark.parametrize("library", ["jax", "torch"])
def test_errors_of_gradients(data, library):
    """Of few steps, beside the gradient with located switches; both of the mean of x over the second half, by x0."""
    pytest.importorskip(library)
    rest = {name: v for name, v in data.items() if name != "x0"}
    if library == "jax":
        import jax
        import jax.numpy as own

        jax.config.update("jax_enable_x64", True)
        from bromwich.jax import gradient_and_error, solve

        start = own.asarray(data["x0"])
    else:
        import torch as own
        from bromwich.torch import gradient_and_error, solve

        rest = {name: own.tensor(v, dtype=own.float64) for name, v in rest.items()}
        start = own.tensor(data["x0"], dtype=own.float64, requires_grad=True)

    def loss(x0, refine=1, **how):
        return solve(**rest, x0=x0, T=T, steps=STEPS, refine=refine, **how)[1][STEPS // 2 :].mean()

    gradient, error = gradient_and_error(loss, start)
    if library == "jax":
        exact = jax.grad(lambda x0: loss(x0, tol=1e-8))(start)
    else:
        gradient, error = gradient[0], error[0]
        exact = own.autograd.grad(loss(start, tol=1e-8), start)[0]
    off = np.abs(np.asarray(gradient) - np.asarray(exact))
    assert (off <= np.asarray(error) + 1e-8).all(), (off, error)
    assert np.asarray(error).max() > 0


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


def test_jax_forward_mode_and_scenes_that_fail(data):
    jax = pytest.importorskip("jax")
    from bromwich.jax import STATUSES, solve

    jax.config.update("jax_enable_x64", True)
    jnp = jax.numpy

    def loss(d, **how):
        y, x, w = solve(**d, T=T, steps=STEPS, **how)[:3]
        return (y**2).sum() + jnp.sin(x).sum()

    bar = expected(data)[1]
    along = {name: np.cos(np.arange(v.size)).reshape(v.shape) for name, v in data.items()}
    slope = sum((bar[name] * along[name]).sum() for name in data)
    for function in (lambda d, v: jax.jvp(loss, (d,), (v,))[1], jax.jit(lambda d, v: jax.jvp(loss, (d,), (v,))[1])):
        assert float(function(data, along)) == pytest.approx(slope, rel=1e-9)
    states = lambda x0: solve(**{**data, "x0": x0}, T=T, steps=STEPS)[1]
    np.testing.assert_allclose(jax.jacfwd(states)(data["x0"]), jax.jacrev(states)(data["x0"]), rtol=1e-9, atol=1e-10)
    for twice in (jax.hessian, lambda f: jax.jacrev(jax.jacrev(f)), lambda f: jax.jacfwd(jax.jacfwd(f))):
        with pytest.raises(bromwich.Error, match="of a derivative is not there"):
            twice(lambda x0: loss({**data, "x0": x0}))(data["x0"])
    # Errors are those of Python, and under jit the last line has them.
    by_M = lambda M: solve(**{**data, "M": M}, T=T, steps=STEPS)
    nan = np.full((2, 2, 2), np.nan)
    for function, M, kind in ((by_M, nan[0], bromwich.Error), (jax.vmap(by_M), nan, bromwich.NotSolved)):
        with pytest.raises(kind, match="M: ") as caught:
            function(M)
        assert len(str(caught.value)) < 300
    with pytest.raises(Exception) as caught:
        jax.block_until_ready(jax.jit(by_M)(nan[0]))
    assert "M: " in str(caught.value).strip().splitlines()[-1]
    x0, good = several_scenes(data)
    for failed in ("nan", "zero"):
        one = lambda A, x: solve(**{**data, "A": A, "x0": x}, T=T, steps=STEPS, failed=failed)
        status = jax.vmap(one, (None, 0))(data["A"], x0)[3]
        assert [STATUSES[k] for k in status] == ["solved", "unsupported", "solved", "solved"]

        def total(A):
            y, x, w, status = jax.vmap(one, (None, 0))(A, x0)
            return jnp.where(status == 0, (y**2).sum((1, 2)), 0).sum()

        expect = sum(jax.grad(lambda A: (one(A, x0[k])[0] ** 2).sum())(data["A"]) for k in good)
        for gradient in (jax.grad(total), jax.jit(jax.grad(total))):
            found = gradient(data["A"])
            assert np.isnan(found).all() if failed == "nan" else np.allclose(found, expect, rtol=1e-9, atol=1e-10)
    fine = jax.grad(lambda x0: loss({**data, "x0": x0}, tol=1e-8))(data["x0"])
    step = 1e-4  # differences err by step^2, and by the tolerance of the values over the step
    for i, e in enumerate(np.eye(3)):
        up, down = (loss({**data, "x0": data["x0"] + by * e}, tol=1e-8) for by in (step, -step))
        assert float(up - down) / (2 * step) == pytest.approx(float(fine[i]), rel=1e-4, abs=1e-2)


@pytest.mark.filterwarnings("ignore:.*torch.jit.script")  # PyTorch uses it itself
def test_torch_forward_mode_and_scenes_that_fail(data):
    torch = pytest.importorskip("torch")
    from bromwich.torch import STATUSES, solve

    tensors = {name: torch.tensor(v) for name, v in data.items()}
    states = lambda x0: solve(**{**tensors, "x0": x0}, T=T, steps=STEPS)[1]
    forward, backward = torch.func.jacfwd(states)(tensors["x0"]), torch.func.jacrev(states)(tensors["x0"])
    np.testing.assert_allclose(forward, backward, rtol=1e-9, atol=1e-10)
    x0, good = several_scenes(data)
    weights = torch.cos(torch.arange(2.0 * (STEPS + 1), dtype=torch.float64)).reshape(STEPS + 1, 2)
    alone = one_by_one(data, [dict(x0=x0[k]) for k in good], weights.numpy())
    for failed in ("nan", "zero"):
        A = tensors["A"].clone().requires_grad_()
        y, x, w, status = solve(**{**tensors, "A": A, "x0": torch.tensor(x0)}, T=T, steps=STEPS, failed=failed)
        assert [STATUSES[k] for k in status] == ["solved", "unsupported", "solved", "solved"]
        torch.where(status == 0, (weights * y).sum((1, 2)), 0).sum().backward()
        if failed == "nan":
            assert A.grad.isnan().all()
        else:
            np.testing.assert_allclose(A.grad, alone["A"].sum(0), rtol=1e-9, atol=1e-9)
    located = solve(**tensors, T=T, steps=STEPS, tol=1e-8)[1]
    np.testing.assert_allclose(located, solve(**tensors, T=T, steps=STEPS, refine=16)[1], atol=1e-3)
