"""Sources in every form that is documented, against one another."""

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


def test_functions_return_arrays_of_other_shapes(diode):
    """One number, a list, a column, integers: one value each."""
    expected = bromwich.solve(**diode, g=-1.0, steps=20)
    for g in (lambda t: -1, lambda t: [-1], lambda t: np.array([[-1.0]]), lambda t: np.full(np.shape(t), -1)):
        same(bromwich.solve(**diode, g=g, steps=20), expected)
