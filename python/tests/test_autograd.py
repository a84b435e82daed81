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
