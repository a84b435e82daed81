"""Complementarity problems of their own, against an enumeration of all active sets, and their derivatives against differences.
Classes, units and sizes: tests/complementarity/test_lcp_batch.cpp."""

import itertools
import warnings

import bromwich
import numpy as np
import pytest


def random_P(rng, n, *leading):
    L, K = rng.uniform(-1, 1, (2, *leading, n, n))
    return L @ np.swapaxes(L, -1, -2) + K - np.swapaxes(K, -1, -2) + 0.3 * np.eye(n)


def enumerated(M, q):
    """The solution with a regular M_SS, or None."""
    n = q.size
    for S in (list(s) for k in range(n + 1) for s in itertools.combinations(range(n), k)):
        y = np.zeros(n)
        y[S] = np.linalg.solve(M[np.ix_(S, S)], -q[S])
        if y.min(initial=0) >= -1e-12 and (M @ y + q).min(initial=0) >= -1e-12:
            return y
    return None


@pytest.mark.parametrize("n", [1, 2, 5, 8])
def test_shared_and_own_matrices(n):
    rng = np.random.default_rng(n)
    own = random_P(rng, n, 3, 4)
    q = rng.uniform(-1, 1, (3, 4, n))
    r = bromwich.lcp(own, q, check=True)
    shared = bromwich.lcp(own[0, 0], q, check=True)
    assert r.y.shape == (3, 4, n) and r.status.shape == r.residual.shape == r.lcp_class.shape == (3, 4)
    for at in np.ndindex(3, 4):
        for found, M in ((r, own[at]), (shared, own[0, 0])):
            exact = enumerated(M, q[at])
            assert np.allclose(found.y[at], exact, rtol=1e-9, atol=1e-11)
            assert np.allclose(found.w[at], np.where(exact > 0, 0, M @ exact + q[at]), rtol=1e-9, atol=1e-11)
    assert np.all(r.residual < 1e-13) and np.array_equal(r.active, r.y > 0) and r.ok.all()


def test_one_problem_and_broadcasting():
    one = bromwich.lcp([[2.0, 1.0], [1.0, 2.0]], [-1.0, 1.0])
    assert one.status == "solved" and one.lcp_class == "P" and one.y.tolist() == [0.5, 0.0] and one.residual.shape == ()
    M = np.array([[[2.0]], [[4.0]]])
    assert bromwich.lcp(M, [-8.0]).y.tolist() == [[4.0], [2.0]]
    assert bromwich.lcp(np.zeros((0, 0)), np.zeros((3, 0))).y.shape == (3, 0)
    assert bromwich.lcp([[1.0]], np.zeros((0, 1))).y.shape == (0, 1)


def test_forms_of_matrices():
    sparse = pytest.importorskip("scipy.sparse")
    n = 400
    q = np.random.default_rng(0).uniform(-1, 1, (4, n))
    rows = sparse.diags_array([-1.0, 4.2, -1.0, -1.0, -1.0], offsets=[-1, 0, 1, 20, -20], shape=(n, n), format="csr")
    dense = bromwich.lcp(rows.toarray(), q, check=True)
    for other in (rows, rows.tocoo()):
        r = bromwich.lcp(other, q, check=True)
        assert np.allclose(r.y, dense.y, rtol=0, atol=1e-11) and np.allclose(r.w, dense.w, rtol=0, atol=1e-11)
    three = bromwich.lcp(bromwich.Tridiagonal(-1.0, np.full(n, 2.5), -1.0), q, check=True)
    again = bromwich.lcp(2.5 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1), q, check=True)
    assert np.allclose(three.y, again.y, rtol=0, atol=1e-11)


def test_classes_and_statuses():
    M = [[0.0, 1.0], [-1.0, 0.0]]  # skew: PSD
    r = bromwich.lcp(M, [[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [np.nan, 1.0]], check=False)
    assert r.status.tolist() == ["solved", "solved", "infeasible", "nonfinite"] and r.lcp_class == "PSD"
    assert np.isnan(r.y[2:]).all() and r.y[1].tolist() == [1.0, 1.0]
    least = bromwich.lcp([[1.0, 1.0], [1.0, 1.0]], [-2.0, -2.0])  # all y_1 + y_2 = 2
    assert np.allclose(least.y, [1.0, 1.0])
    with pytest.warns(bromwich.NotSolvedWarning, match="1 of 1 problems"):
        bromwich.lcp([[-1.0]], [-1.0])
    with pytest.raises(bromwich.NotSolved):
        bromwich.lcp([[-1.0]], [-1.0], check=True)
    bad = bromwich.lcp([[[np.inf]], [[1.0]]], [[-1.0], [-1.0]], check=False)
    assert bad.status.tolist() == ["nonfinite", "solved"]


def test_starts():
    rng = np.random.default_rng(2)
    M, q = random_P(rng, 40), rng.uniform(-1, 1, (10, 40))
    cold = bromwich.lcp(M, q)
    warm = bromwich.lcp(M, q, y0=cold.y)
    assert np.all(warm.iterations == 1) and np.allclose(warm.y, cold.y)


def test_derivatives_against_differences():
    rng = np.random.default_rng(5)
    n, count = 6, 8
    M, q = random_P(rng, n), rng.uniform(-1, 1, (count, n))
    dM, dq = rng.uniform(-1, 1, (n, n)), rng.uniform(-1, 1, (count, n))
    r = bromwich.lcp(M, q)
    h = 1e-6
    a, b = (bromwich.lcp(M + s * h * dM, q + s * h * dq) for s in (1, -1))
    tangent = r.jvp(q=dq, M=dM)
    assert np.all(r.margin > 1e-3)  # the differences stay on one side
    # Second order in h, with rounding of 1e-16/h.
    assert np.allclose(tangent.y, (a.y - b.y) / (2 * h), rtol=1e-6, atol=1e-8)
    assert np.allclose(tangent.w, (a.w - b.w) / (2 * h), rtol=1e-6, atol=1e-8)
    of_y, of_w = rng.uniform(-1, 1, (2, count, n))
    gradient = r.vjp(of_y, of_w)
    assert gradient.M.shape == (n, n)
    assert np.isclose(np.sum(gradient.q * dq) + np.sum(gradient.M * dM), np.sum(of_y * tangent.y) + np.sum(of_w * tangent.w))
    own = bromwich.lcp(np.broadcast_to(M, (count, n, n)), q).vjp(of_y, of_w)
    assert own.M.shape == (count, n, n) and np.allclose(own.M.sum(axis=0), gradient.M)


def test_degenerate_problems_are_masked():
    r = bromwich.lcp(np.eye(2), [[-1.0, 0.0], [-1.0, 1.0]])
    assert r.degenerate.tolist() == [True, False]
    tangent = r.jvp(q=np.ones((2, 2)))
    assert np.isnan(tangent.y[0]).all() and tangent.y[1].tolist() == [-1.0, 0.0]
    assert np.isnan(r.vjp(y=np.ones((2, 2))).q[0]).all()


@pytest.mark.parametrize(
    "arguments, message",
    [
        (dict(M=[[1.0, 2.0]], q=[1.0]), "M: is 1 x 2"),
        (dict(M=[1.0], q=[1.0]), "M: has 1 axes"),
        (dict(M=[[1.0]], q=1.0), "q: is a number"),
        (dict(M=[[1.0]], q=[1.0, 2.0]), "q: has 2 values"),
        (dict(M=[[1j]], q=[1.0]), "M: is complex"),
        (dict(M=[[np.nan]], q=[1.0]), "M"),
        (dict(M=np.ones((2, 1, 1)), q=np.ones((3, 1))), "M: has the leading axes"),
        (dict(M=[[1.0]], q=[1.0], y0=[1.0, 2.0]), "y0: has shape"),
        (dict(M=[[-1.0]], q=[1.0], lcp_class="P"), "lcp_class: is P, and M is not"),
        (dict(M=[[1.0]], q=[1.0], lcp_class="Q"), "lcp_class: found 'Q'"),
        (dict(M=[[1.0]], q=[1.0], backend="gpu"), "backend: found 'gpu'"),
        (dict(M=[[1.0]], q=["a"]), "q: "),
    ],
)
def test_bad_input(arguments, message):
    with pytest.raises(bromwich.Error, match=message):
        bromwich.lcp(**arguments)


def scalar(y, w):
    return (y**2).sum() + (w * 0.5).sum()


def expected(M, q):
    r = bromwich.lcp(M, q)
    return scalar(r.y, r.w), r.vjp(2 * r.y, np.full_like(r.w, 0.5))


@pytest.mark.filterwarnings("ignore::FutureWarning", "ignore:.*torch.jit.script")  # of what torch.func imports
def test_gradients_by_torch():
    torch = pytest.importorskip("torch")
    from bromwich.torch import lcp

    rng = np.random.default_rng(9)
    M, q = random_P(rng, 5), rng.uniform(-1, 1, (4, 5))
    value, gradient = expected(M, q)
    tensors = [torch.tensor(v, requires_grad=True) for v in (M, q)]
    loss = scalar(*lcp(*tensors))
    loss.backward()
    assert np.isclose(loss.item(), value)
    assert np.allclose(tensors[0].grad, gradient.M) and np.allclose(tensors[1].grad, gradient.q)
    each = torch.vmap(lambda one: lcp(tensors[0], one)[0])(tensors[1])
    assert np.allclose(each.detach(), bromwich.lcp(M, q).y)
    tangent = torch.func.jvp(lambda M, q: lcp(M, q), tuple(tensors), tuple(torch.ones_like(v) for v in tensors))[1]
    assert np.allclose(tangent[0].detach(), bromwich.lcp(M, q).jvp(q=np.ones((4, 5)), M=np.ones((5, 5))).y)
    q0 = torch.tensor([[-1.0, 0.0], [-1.0, 1.0]], dtype=torch.float64, requires_grad=True)
    y, w, status = lcp(torch.eye(2, dtype=torch.float64), q0, failed="zero")
    y.sum().backward()
    assert q0.grad.tolist() == [[0.0, 0.0], [-1.0, 0.0]] and status.tolist() == [0, 0]
    with pytest.raises(bromwich.NotSolved):
        lcp(torch.tensor([[-1.0]]), torch.tensor([-1.0]))


def test_gradients_by_jax():
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    from bromwich.jax import lcp

    rng = np.random.default_rng(9)
    M, q = random_P(rng, 5), rng.uniform(-1, 1, (4, 5))
    value, gradient = expected(M, q)
    total = lambda M, q: scalar(*lcp(M, q))
    for differentiated in (jax.value_and_grad(total, (0, 1)), jax.jit(jax.value_and_grad(total, (0, 1)))):
        found, (of_M, of_q) = differentiated(M, q)
        assert np.isclose(found, value) and np.allclose(of_M, gradient.M) and np.allclose(of_q, gradient.q)
    assert np.allclose(jax.vmap(lambda one: lcp(M, one)[0])(q), bromwich.lcp(M, q).y)
    assert np.allclose(jax.jvp(lambda q: lcp(M, q)[0], (q,), (np.ones_like(q),))[1], bromwich.lcp(M, q).jvp(q=np.ones_like(q)).y)
    q0 = np.array([[-1.0, 0.0], [-1.0, 1.0]])
    assert jax.grad(lambda q: lcp(np.eye(2), q, failed="zero")[0].sum())(q0).tolist() == [[0.0, 0.0], [-1.0, 0.0]]
    assert lcp([[-1.0]], [-1.0], failed="nan")[2] == 1
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pytest.raises(Exception, match="not solved"):
            jax.block_until_ready(lcp([[-1.0]], [-1.0]))
