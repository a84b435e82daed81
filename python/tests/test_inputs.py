"""Matrices, sources and scenes in every form that is documented, against one another."""

import pickle
import threading

import bromwich
import numpy as np
import pytest
import scipy.sparse


@pytest.fixture
def solved(diode):
    return bromwich.solve(**diode, g=lambda t: -np.sin(t), steps=64)


def same(r, other, atol=1e-13):
    np.testing.assert_allclose(r.y, other.y, atol=atol)


@pytest.mark.parametrize(
    "g",
    [
        "-sin(t)",
        ["-sin(w*t)"],
        lambda t: [-np.sin(t)],
        lambda t: -np.sin(t)[:, None] if np.ndim(t) else -np.sin(t),
        -np.sin(np.linspace(0, 2, 65)),
        -np.sin(np.linspace(0, 2, 65))[:, None],
        (np.linspace(0, 2, 65), -np.sin(np.linspace(0, 2, 65))),
    ],
)
def test_sources_agree(diode, solved, g):
    same(bromwich.solve(**diode, g=g, steps=64, parameters={"w": 1.0}), solved)


def test_a_table_says_the_steps(diode):
    assert bromwich.solve(**diode, g=np.zeros(33)).steps == 32


def test_a_table_that_jumps(diode):
    """g = 1 before t = 1, -1 behind it: y = 0, then x + y = 1."""
    r = bromwich.solve(**diode, g=([0, 1, 1, 2], [1.0, 1.0, -1.0, -1.0]), steps=200)
    assert np.all(r.y[r.t < 0.99] == 0)
    np.testing.assert_allclose((r.x + r.y)[r.t > 1.02], 1, atol=1e-12)


def test_functions_are_called_for_all_times_at_once(diode):
    at_once, alone = [], []

    def g(t):
        (at_once if np.ndim(t) else alone).append(np.size(t))
        return -np.sin(t)

    bromwich.solve(**diode, g=g, steps=1000, confirm=False)  # a certificate looks between the rows
    assert max(at_once) >= 1000
    assert len(alone) < 200


def test_functions_may_change_between_solves(diode):
    speed = [1.0]

    def g(t):
        return -np.sin(speed[0] * t)

    scene = bromwich.Scene(**diode, g=g)
    solver = bromwich.Solver(scene, steps=64)
    first = solver.solve()
    speed[0] = 2.0
    solver.set_sources(g=g)
    for second in (bromwich.solve(scene, steps=64), solver.solve()):
        same(second, bromwich.solve(**diode, g="-sin(2*t)", steps=64))
    assert not np.allclose(first.y, second.y)


def test_functions_of_one_time(diode, solved):
    def g(t):
        return -np.sin(t) if t < 10 else 0.0  # a truth value of an array raises

    same(bromwich.solve(**diode, g=g, steps=64), solved)


def test_rows_or_columns_over_time():
    """Two values: k x 2 and 2 x k arrays for k times."""
    scene = dict(A=-np.eye(2), B=np.eye(2), N=np.eye(2), M=np.eye(2), x0=[0, 0], T=1, steps=50)
    columns = bromwich.solve(**scene, g=lambda t: np.array([-np.sin(t), 0 * t - 0.1]))
    rows = bromwich.solve(**scene, g=lambda t: np.array([-np.sin(t), 0 * t - 0.1]).T)
    one = bromwich.solve(**scene, g=lambda t: [-float(np.sin(t)), -0.1])
    same(columns, one)
    same(rows, one)


def test_a_constant_source_of_a_large_scene():
    """A number, or one value a state: a column F for all of them, where each would need one of its own."""
    sparse = pytest.importorskip("scipy.sparse")
    m = 5000
    A = sparse.diags_array([1.0, -2.0, 1.0], offsets=[-1, 0, 1], shape=(m, m), format="csc") * m
    middle = np.eye(1, m, m // 2)
    scene = dict(A=A, B=middle.T, N=middle, M=0.1, x0=0, T=1, steps=50, states=[0, m // 2])
    expected = bromwich.solve(**scene, F=-np.ones((m, 1)), f=1.0)
    assert expected.y.max() > 0.1
    for f in (-1.0, -np.ones(m)):
        r = bromwich.solve(**scene, f=f)
        same(r, expected)
        np.testing.assert_allclose(r.at(0.503).x, expected.at(0.503).x, atol=1e-12)
    solver = bromwich.Solver(bromwich.Scene(**{k: v for k, v in scene.items() if k not in ("steps", "states")}), steps=50)
    solver.set_sources(f=-np.ones(m))
    same(solver.solve(), expected)


def test_sources_of_the_states(diode):
    B = [[1.0]]
    direct = bromwich.solve(**diode, f=lambda t: [-np.cos(t)], steps=64)
    for F in (B, "B"):
        same(bromwich.solve(**diode, f=lambda t: [-np.cos(t)], F=F, steps=64), direct)


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


def test_kronecker_is_what_signorini_is(Q15):
    p = Q15.parameters
    assert p["Q"] == 15
    dx = 1 / 16
    kronecker = bromwich.Kronecker((15, dx, 1.0), (15, dx, 1.0), np.eye(15)[0], np.eye(15)[0])
    scene = bromwich.Scene(dynamics=kronecker, M=np.eye(15), g=lambda t: [-np.sin(t)] * 15, x0=0, T=1)
    assert scene.states == 225
    assert bromwich.solve(scene, steps=20).ok
    with pytest.raises(bromwich.Error, match="F='B'"):
        bromwich.Scene(dynamics=kronecker, M=np.eye(15), f=1.0, x0=0, T=1)


def line_of_points(points, dx, c, v, first, last):
    """c u'' - v u' with u = first u_1 and last u_points beyond the ends."""
    before, after = c / dx**2 + v / (2 * dx), c / dx**2 - v / (2 * dx)
    D = before * np.eye(points, k=-1) - 2 * c / dx**2 * np.eye(points) + after * np.eye(points, k=1)
    D[0, 0] += first * before
    D[-1, -1] += last * after
    return D


def test_rectangles_with_ends_of_their_own():
    P, Q, c, dx, loss = 4, 3, 0.2, 0.25, 1.5
    dy = bromwich.Kronecker.spacing(Q, 1, ("dirichlet", "neumann"))
    assert dy == pytest.approx(1 / 3.5)
    near, far = np.eye(Q)[0], np.eye(Q)[-1]
    reflected = (1 - loss * dx / 2) / (1 + loss * dx / 2)
    along, across = line_of_points(P, dx, c, 0.8, 1, reflected), line_of_points(Q, dy, c, 0, 0, 1)
    matrices = {
        "A": np.kron(np.eye(P), across) + np.kron(along, np.eye(Q)) - 0.5 * np.eye(P * Q),
        "B": np.hstack([np.kron(np.eye(P), near[:, None]), np.kron(np.eye(P), 2 * far[:, None])]),
        "N": np.vstack([np.kron(np.eye(P), -near), np.kron(np.eye(P), -far)]),
    }
    rest = {"M": np.eye(2 * P), "g": lambda t: [np.sin(3 * t + i) for i in range(2 * P)], "x0": 0.3, "T": 2}
    sides = {"b": near, "n": -near, "far_b": 2 * near, "far_n": -near}
    sides |= {"ends_along": ("neumann", loss), "ends_across": ("dirichlet", "neumann"), "reaction": 0.5}

    def rectangle(v):
        return bromwich.Kronecker((P, dx, c), (Q, dy, c), advection=(v, 0), **sides)

    for method in ("march", "contour"):
        known = bromwich.solve(**matrices, **rest, steps=100, method=method)
        found = bromwich.solve(dynamics=rectangle(0.8), **rest, steps=100, method=method)
        assert known.y.max() > 0.1
        np.testing.assert_allclose(found.y, known.y, atol=1e-12)
    with pytest.raises(bromwich.Error, match=r"along.advection: is -2, and central differences oscillate from 1.6"):
        bromwich.Scene(dynamics=rectangle(-2), **rest)
    with pytest.raises(bromwich.Error, match="ends_along: found 'neuman'; use 'dirichlet', 'neumann' or a number"):
        bromwich.Kronecker((P, dx, c), (Q, dy, c), near, near, ends_along="neuman")
    with pytest.raises(bromwich.Error, match="far_n: is missing"):
        bromwich.Kronecker((P, dx, c), (Q, dy, c), near, near, far_b=near)


@pytest.mark.parametrize("ends", [("neumann", "dirichlet"), ("neumann", 0.4), ("dirichlet", "neumann")])
def test_rectangles_in_modes(ends):
    Q, c, reaction = 24, 0.05, 0.3  # 576 states: below 513 they are written out as dense matrices
    dx, dy = 1 / (Q + 1), bromwich.Kronecker.spacing(Q, 1, ends)
    reflected = [{"dirichlet": 0, "neumann": 1}.get(end, None) for end in ends]
    reflected = [(1 - end * dy / 2) / (1 + end * dy / 2) if q is None else q for q, end in zip(reflected, ends)]
    along, across = line_of_points(Q, dx, c, 0, 0, 0), line_of_points(Q, dy, c, 0, *reflected)
    A = np.kron(np.eye(Q), across) + np.kron(along, np.eye(Q)) - reaction * np.eye(Q * Q)
    b, n = np.eye(Q)[0] / dy, np.eye(Q)[0]
    rest = {"M": 0.2 * np.eye(Q), "g": lambda t: 0.3 * np.sin(5 * t + np.arange(Q) / 9) - 0.1, "x0": 0.02, "T": 1}
    field = bromwich.Kronecker((Q, dx, c), (Q, dy, c), b, n, ends_across=ends, reaction=reaction)
    scene = bromwich.Scene(dynamics=field, **rest)
    assert scene._model.form == "kronecker"
    known = bromwich.solve(A=scipy.sparse.csr_array(A), B=np.kron(np.eye(Q), b[:, None]), N=np.kron(np.eye(Q), n), **rest,
                           steps=64, method="march")  # fmt: skip
    found = bromwich.solve(scene, steps=64, method="march", states=[0, 30, Q * Q - 1])
    assert found.ok and known.y.max() > 0.1
    np.testing.assert_allclose(found.y[1:], known.y[1:], atol=1e-8)
    still = bromwich.Scene(dynamics=field, **{**rest, "g": -0.3})
    again = pickle.loads(pickle.dumps(still))
    assert again._model.form == "kronecker"
    np.testing.assert_array_equal(*(bromwich.solve(each, steps=16, method="march").y for each in (still, again)))
    # f in every state: as sparse matrices.
    assert bromwich.Scene(dynamics=field, f=0.1, **rest)._model.form == "sparse"


def test_other_ends_and_advection_in_modes():
    P, Q, c, loss = 24, 25, 0.05, 1.5  # above 512 states
    dx, dy = bromwich.Kronecker.spacing(P, 1, ("neumann", loss)), bromwich.Kronecker.spacing(Q, 2, ("neumann", "dirichlet"))
    reflected = (1 - loss * dx / 2) / (1 + loss * dx / 2)
    b, n = 20 * np.eye(Q)[0], np.eye(Q)[0]
    rest = {"M": np.eye(P), "g": lambda t: 0.3 * np.sin(5 * t + np.arange(P) / 9) - 0.1, "x0": 0.02, "T": 1}
    for v in (0.0, -0.04):
        along, across = line_of_points(P, dx, c, v, 1, reflected), line_of_points(Q, dy, c, v, 1, 0)
        A = scipy.sparse.csr_array(np.kron(np.eye(P), across) + np.kron(along, np.eye(Q)))
        field = bromwich.Kronecker((P, dx, c), (Q, dy, c), b, n, ends_along=("neumann", loss),
                                   ends_across=("neumann", "dirichlet"), advection=v)  # fmt: skip
        known = bromwich.solve(A=A, B=np.kron(np.eye(P), b[:, None]), N=np.kron(np.eye(P), n), **rest, steps=64, method="march")
        found = bromwich.solve(dynamics=field, **rest, steps=64, method="march", states=[0, 30, P * Q - 1])
        assert found.ok and known.y.max() > 0.1
        assert ("symmetric form" in found.kernel) == (v != 0)
        np.testing.assert_allclose(found.y[1:], known.y[1:], atol=1e-8)


def test_boxes():
    P, R, Q, dx, c = 4, 3, 5, 0.2, 0.1
    D = [line_of_points(points, dx, c, 0, 0, 0) for points in (P, R, Q)]
    A = np.kron(np.kron(D[0], np.eye(R)), np.eye(Q)) + np.kron(np.kron(np.eye(P), D[1]), np.eye(Q)) + np.kron(np.eye(P * R), D[2])
    first = np.eye(Q)[0]
    box = bromwich.Kronecker((P, dx, c), (Q, dx, c), 2 * first, first, beside=[(R, dx, c)])
    rest = {"M": scipy.sparse.eye_array(P * R), "g": lambda t: np.sin(4 * t + np.arange(P * R)), "x0": 0.1, "T": 1}
    scene = bromwich.Scene(dynamics=box, **rest)
    assert scene.states == P * R * Q and scene.constraints == P * R
    known = bromwich.solve(A=A, B=np.kron(np.eye(P * R), 2 * first[:, None]), N=np.kron(np.eye(P * R), first), **{**rest, "M": np.eye(P * R)},
                           steps=32, method="march")  # fmt: skip
    found = bromwich.solve(scene, steps=32, method="march")
    assert found.ok and known.y.max() > 0.1
    np.testing.assert_allclose(found.y, known.y, atol=1e-10)
    with pytest.raises(bromwich.Error, match=r"beside\[0\].spacing: is 0; give a positive finite number"):
        bromwich.Scene(dynamics=bromwich.Kronecker((P, dx, c), (Q, dx, c), first, first, beside=[(R, 0, c)]), **rest)


def test_lines_of_points():
    line = bromwich.Kronecker(None, (5, 0.5, 2.0), [1, 0, 0, 0, 0], [1, 0, 0, 0, 0], advection=1, ends_across="neumann")
    rest = {"M": 1, "x0": np.arange(5.0), "g": lambda t: [np.sin(3 * t) - 1], "T": 1}
    A = line_of_points(5, 0.5, 2, 1, 1, 1)
    known = bromwich.solve(A=A, B=np.eye(5)[0], N=np.eye(5)[0], **rest, f=np.ones(5), steps=64)
    np.testing.assert_allclose(bromwich.solve(dynamics=line, **rest, f=np.ones(5), steps=64).y, known.y, atol=1e-13)


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


@pytest.mark.parametrize(
    "options", [{"method": m} for m in ("march", "contour", "multigrid", "euler", "galerkin")] + [{"tol": 1e-3}]
)
def test_callables_run_in_the_calling_thread(diode, options):
    idents = set()

    def g(t):
        idents.add(threading.get_ident())
        return -np.sin(3 * t)

    bromwich.solve(**diode, g=g, f=g, steps=64, progress=lambda *_: g(0.0), stop=lambda: g(0.0) > 2, **options)
    assert idents == {threading.get_ident()}


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


def test_functions_return_arrays_of_other_shapes(diode):
    """One number, a list, a column, integers: one value each."""
    expected = bromwich.solve(**diode, g=-1.0, steps=20)
    for g in (lambda t: -1, lambda t: [-1], lambda t: np.array([[-1.0]]), lambda t: np.full(np.shape(t), -1)):
        same(bromwich.solve(**diode, g=g, steps=20), expected)


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
    assert bromwich.scene("signorini", Q=9).A is None
    toy = bromwich.scene("dlcp-small")
    assert toy.A.shape == (3, 3) and toy.M.shape == (4, 4)
