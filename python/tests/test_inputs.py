"""Matrices and scenes in every form that is documented, against one another."""

import threading

import bromwich
import numpy as np
import pytest
import scipy.sparse


def same(r, other, atol=1e-13):
    np.testing.assert_allclose(r.y, other.y, atol=atol)


def test_tridiagonal_dense_and_sparse_M():
    sparse = pytest.importorskip("scipy.sparse")
    n = 20
    dense = 4 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    scene = dict(A=-np.eye(n), B=np.eye(n), N=np.eye(n), x0=np.zeros(n), T=1, steps=40)
    scene["g"] = lambda t: -np.sin(3 * t) * np.ones(n)
    given = [dense, sparse.csr_array(dense), sparse.csc_matrix(dense), bromwich.Tridiagonal(-1, np.full(n, 4.0), -1)]
    first, *others = [bromwich.solve(**scene, M=M) for M in given]
    for other in others:
        same(first, other)


def test_sparse_heat(heat):
    """SciPy's sparse matrices: A in CSR, B and N in COO; the same densely."""
    r = bromwich.solve(**heat, steps=200)
    assert r.ok and r.scene._model.form == "sparse"
    dense = {**heat, **{k: heat[k].toarray() for k in "ABN"}}
    # Weights of the sparse kernel are known to 1e-10.
    same(bromwich.solve(**dense, steps=200, method=r.method), r, atol=1e-8)
    assert r.x.shape == (201, 300)


def test_supplied_dynamics(heat):
    linalg, sparse = pytest.importorskip("scipy.sparse.linalg"), pytest.importorskip("scipy.sparse")
    A, B, N = heat.pop("A"), heat.pop("B"), heat.pop("N")
    identity = sparse.eye_array(A.shape[0])
    shifts = []

    def shifted(z):
        shifts.append(z)
        return linalg.splu((z * identity - A).tocsc()).solve

    dynamics = bromwich.Dynamics(A.shape[0], B, N, shifted=shifted, bound=(0, 0))
    r = bromwich.solve(dynamics=dynamics, **heat, steps=100)
    assert r.ok and len(shifts) > 5
    same(bromwich.solve(A=A, B=B, N=N, **heat, steps=100), r, atol=1e-8)
    massive = bromwich.Dynamics(A.shape[0], B, N, shifted=shifted, mass=lambda X: X, bound=(0, 0))
    same(bromwich.solve(dynamics=massive, **heat, steps=100), r, atol=1e-8)


def test_what_supplied_dynamics_raise_leaves_solve(heat):
    class Mine(Exception):
        pass

    def shifted(z):
        raise Mine("no factorization today")

    B, N = heat.pop("B"), heat.pop("N")
    heat.pop("A")
    with pytest.raises(Mine, match="today"):
        bromwich.solve(dynamics=bromwich.Dynamics(300, B, N, shifted=shifted), **heat, steps=10)
    dynamics = bromwich.Dynamics(300, B, N, shifted=lambda z: lambda R: R[:5])
    with pytest.raises(bromwich.Error, match="returned shape"):
        bromwich.solve(dynamics=dynamics, **heat, steps=10)


def test_dynamics_without_scipy(diode):
    """x' = -x by its resolvent 1/(z + 1), B and N dense."""
    scene = dict(M=diode["M"], x0=[0.0], T=2.0, g=lambda t: -np.sin(t), steps=64)
    dynamics = bromwich.Dynamics(1, [[1.0]], [[1.0]], shifted=lambda z: lambda R: R / (z + 1), bound=(0, -1))
    same(bromwich.solve(dynamics=dynamics, **scene), bromwich.solve(**diode, g=scene["g"], steps=64), atol=1e-9)


def test_an_eigenvalue_is_said_to_be_one(diode):
    """The bound is wrong, and the solve refuses every shift: an error of the library, not of the callback."""

    def shifted(z):
        raise np.linalg.LinAlgError("singular matrix")

    dynamics = bromwich.Dynamics(1, [[1.0]], [[1.0]], shifted=shifted, bound=(0, 0))
    with pytest.raises((bromwich.SingularShift, bromwich.NotSolved, bromwich.Error), match="singular|eigenvalue"):
        bromwich.solve(dynamics=dynamics, M=1, x0=0, T=1, g=-1, steps=20, check=True)


def test_without_constraints():
    """A port-Hamiltonian scene has none, and method goal makes its grid."""
    scene = bromwich.scene("ph-toy")
    assert scene.constraints == 0
    r = bromwich.solve(scene)
    assert r.ok and r.y.shape == (r.steps + 1, 0) and r.x.shape[1] == scene.states
    goal = bromwich.solve(scene, method="goal", steps=100)
    assert goal.ok and goal.goal["history"][-1]["cells"] == goal.steps


def test_catalogue():
    scenes = bromwich.scenes()
    assert scenes["signorini"]["parameters"]["Q"][0] == 39
    with pytest.raises(bromwich.Error):
        bromwich.scene("signorino")


@pytest.mark.parametrize("method", ["auto", "march", "contour", "multigrid", "euler"])
def test_supplied_dynamics_run_in_the_calling_thread(heat, method):
    """All three callables, also where the library has threads to spare; what the method refuses is refused."""
    linalg, sparse = pytest.importorskip("scipy.sparse.linalg"), pytest.importorskip("scipy.sparse")
    A, B, N = heat.pop("A"), heat.pop("B"), heat.pop("N")
    identity, calls = sparse.eye_array(A.shape[0]), []

    def note(kind):
        calls.append((kind, threading.get_ident()))

    def shifted(z):
        note("shifted")
        lu = linalg.splu((z * identity - A).tocsc())

        def solve(R):
            note("solve")
            return lu.solve(R)

        return solve

    def mass(X):
        note("mass")
        return X

    dynamics = bromwich.Dynamics(A.shape[0], B, N, shifted=shifted, mass=mass, bound=(0, 0))
    scene = bromwich.Scene(dynamics=dynamics, **heat)
    bromwich.solve(scene, steps=60, method=method, threads=4, check=False)
    assert {kind for kind, _ in calls} >= {"shifted", "solve"}
    assert {ident for _, ident in calls} == {threading.get_ident()}
    calls.clear()
    thread = threading.Thread(target=lambda: bromwich.solve(scene, steps=60, method=method, check=False))
    thread.start()
    thread.join()
    assert {ident for _, ident in calls} == {thread.ident}


def test_matrices_of_a_scene():
    """What was given can be read again, and the copies change nothing."""
    rng = np.random.default_rng(3)
    A, B, N, E, F = -np.eye(4) + 0.1 * rng.random((4, 4)), rng.random((4, 2)), rng.random((2, 4)), 2 * np.eye(4), rng.random((4, 3))
    scene = bromwich.Scene(A=A, B=B, N=N, M=[[2.0, 1], [0, 2]], E=E, F=F, f=np.ones(3), x0=0.0, T=1)
    for name, given in {"A": A, "B": B, "N": N, "M": [[2, 1], [0, 2]], "E": E}.items():
        np.testing.assert_array_equal(getattr(scene, name), given)
    np.testing.assert_array_equal(scene.F.toarray(), F)
    scene.A[:] = 0
    np.testing.assert_array_equal(scene.A, A)
    sparse = bromwich.Scene(A=scipy.sparse.csr_array(A), B=B, N=N, M=1.0, x0=0.0, T=1)
    assert scipy.sparse.issparse(sparse.A) and sparse.E is None and sparse.F is None
    np.testing.assert_array_equal(sparse.A.toarray(), A)
    np.testing.assert_array_equal(sparse.M, np.eye(2))
    three = bromwich.Scene(A=-np.eye(20), B=np.eye(20), N=np.eye(20), M=bromwich.Tridiagonal(-1, np.full(20, 4.0), -2), x0=0, T=1)
    np.testing.assert_array_equal(three.M, 4 * np.eye(20) - np.eye(20, k=-1) - 2 * np.eye(20, k=1))
    assert scene.E0 is None and scene.b is None and scene.restitution is None
    ends = bromwich.Scene(A=-1, B=1, N=1, M=1, E0=1, ET=-1, b=0.5, f="2*t", g=[-1], T=1)
    assert (ends.E0, ends.ET, ends.b) == (1, -1, 0.5)
    body = bromwich.Scene(A=[[0, 1], [0, 0]], B=[0, 1], N=[1, 0], M=0, x0=[1, 0], restitution=0.25, T=1)
    assert body.restitution == [0.25]
    np.testing.assert_array_equal(ends.f([0, 0.5, 1]), [[0], [1], [2]])
    assert ends.f(0.25) == [0.5] and ends.g(1) == [-1] and (scene.g([0, 1]) == 0).all()
    with pytest.raises(bromwich.Error, match="t: "):
        ends.f(np.nan)
    assert bromwich.scene("signorini", Q=9).A is None
    toy = bromwich.scene("dlcp-small")
    assert toy.A.shape == (3, 3) and toy.M.shape == (4, 4)
