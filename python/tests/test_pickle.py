"""Scenes and results through pickle and copy, as multiprocessing sends them."""

import copy
import multiprocessing
import pickle

import bromwich
import numpy as np
import pytest


def source(t):
    return -np.sin(3 * np.asarray(t))


def resolvent(z):
    return lambda R: R / (z + 1)


def again(thing):
    return pickle.loads(pickle.dumps(thing))


def small(**change):
    return dict(A=-1.0, B=1.0, N=1.0, M=1.0, x0=0.0, T=2.0, steps=50) | change


def scenes():
    I = np.eye(20)
    line = bromwich.Kronecker((20, 1 / 21, 1.0), (9, 0.1, 1.0), np.eye(9)[0], np.eye(9)[0])
    supplied = bromwich.Dynamics(1, [[1.0]], [[1.0]], shifted=resolvent, bound=(0, -1))
    table = ([0, 1, 1, 2], [1.0, 1.0, -1.0, -1.0])
    ends = dict(x0=None, E0=np.eye(1), ET=-np.eye(1), b=[0.0])
    return {
        "function": lambda: bromwich.Scene(**small(g=source, f=source, name="mine", breakpoints=[0.5])),
        "expression": lambda: bromwich.Scene(**small(g="-sin(w*t)", parameters={"w": 3.0})),
        "table": lambda: bromwich.Scene(**small(g=table)),
        "grid": lambda: bromwich.Scene(**small(g=-np.linspace(0, 1, 51), f=0.5)),
        "mass": lambda: bromwich.Scene(**small(E=2.0, g=source, F="B", f=source)),
        "ends": lambda: bromwich.Scene(**small(**ends, g=source)),
        "tridiagonal": lambda: bromwich.Scene(
            A=-I, B=I, N=I, M=bromwich.Tridiagonal(-1, np.full(20, 4.0), -1), x0=0, T=1, g=-0.1, steps=20
        ),
        "kronecker": lambda: bromwich.Scene(dynamics=line, M=I, x0=0, T=1, g=[-0.1] * 20, steps=20),
        "supplied": lambda: bromwich.Scene(dynamics=supplied, M=1, x0=0, T=2, g=source, steps=50),
        "catalogue": lambda: bromwich.scene("signorini", Q=9),
        "relay": lambda: bromwich.Scene.relay(A=[[-1.0]], B=[1.0], C=[[1.0]], x0=[0.5], T=1, steps=50),
        "relay with e": lambda: bromwich.Scene.relay(
            A=[[-1.0]], B=[1.0], C=[[1.0]], x0=[0.5], T=1, e="0.3*sin(w*t)", parameters={"w": 3}, names={"x": ["v"]}, steps=50
        ),
        "relay with pairs": lambda: bromwich.Scene.relay(
            A=[[-1.0]], B=[[1.0, 1.0]], C=[[1.0]], x0=[0.5], T=1, bound="1+t", N=[[1.0]], M=2.0, g="-t", steps=50
        ),
        "no constraints": lambda: bromwich.Scene(A=-np.eye(2), x0=1, T=1, f=["t", "1"], steps=50),
    }


@pytest.mark.parametrize("name", scenes())
def test_scenes(name):
    scene = scenes()[name]()
    for other in (again(scene), copy.copy(scene), copy.deepcopy(scene), again(again(scene))):
        assert repr(other) == repr(scene)
        assert (other.steps, other.breakpoints, other.parameters) == (scene.steps, scene.breakpoints, scene.parameters)
        assert other.description == scene.description
        np.testing.assert_array_equal(bromwich.solve(other, steps=40).y, bromwich.solve(scene, steps=40).y)


def test_sparse(heat):
    heat["g"] = "-0.2*sin(3*t)"
    scene = bromwich.Scene(**heat)
    np.testing.assert_array_equal(bromwich.solve(again(scene), steps=40).y, bromwich.solve(scene, steps=40).y)


def test_what_was_given_may_change():
    """The scene has a copy, and that is pickled."""
    A = np.array([[-1.0]])
    scene = bromwich.Scene(**small(A=A, g=source))
    expected = bromwich.solve(scene).y
    A[0, 0] = -5
    np.testing.assert_array_equal(bromwich.solve(again(scene)).y, expected)


def test_files(tmp_path):
    file = tmp_path / "mine.toml"
    text = "[dynamics]\nA = [[-1]]\nB = [[1]]\nx0 = [0]\n[complementarity]\nN = [[1]]\nM = [[1]]\ng = ['-sin(3*t)']\n"
    file.write_text(text + "[time]\nT = 2\nsteps = 50\n")
    scene = bromwich.Scene.from_toml(file)
    pickled = pickle.dumps(scene)
    np.testing.assert_array_equal(bromwich.solve(pickle.loads(pickled)).y, bromwich.solve(scene).y)
    file.write_text(text.replace("3*t", "2*t") + "[time]\nT = 2\nsteps = 50\n")
    with pytest.raises(bromwich.Error, match="mine.toml is not what it was"):
        pickle.loads(pickled)


def test_functions_without_a_name():
    scene = bromwich.Scene(**small(g=lambda t: -t))
    with pytest.raises((pickle.PicklingError, AttributeError), match="lambda"):
        pickle.dumps(scene)


def fields(result):
    names = "status reason warning x_components residual kernel_error error_estimate errors method backend kernel steps"
    names += " iterations history continuous starts_with_impulse bytes timings goal infeasible_at switches"
    return {name: getattr(result, name) for name in names.split()}


@pytest.mark.parametrize(
    "options", [{}, {"tol": 1e-3}, {"method": "galerkin"}, {"method": "contour", "states": None}, {"method": "euler"}]
)
def test_results(options):
    result = bromwich.solve(bromwich.Scene(**small(g=source)), **options)
    for other in (again(result), copy.deepcopy(result)):
        assert repr(fields(other)) == repr(fields(result))  # NaN is NaN
        for name in ("t", "y", "x", "w", "y_left", "y_integral"):
            np.testing.assert_array_equal(getattr(other, name), getattr(result, name))
        at = [0.0, 1.0, 2.0] if options.get("method") == "euler" else [0.1234, 1.0]
        np.testing.assert_allclose(other.at(at).y, result.at(at).y, atol=1e-14)
        np.testing.assert_allclose(other.at(at).x, result.at(at).x, atol=1e-12)
        assert len(other.switches_with_errors()) == len(result.switches_with_errors())


def test_results_that_jump():
    """Steps divided at a jump, an impulse at the start, and a status that is not solved."""
    for change in (dict(M=0.0, g=([0, 0.777, 0.777, 2], [1.0, 1.0, -1.0, -1.0])), dict(M=0.0, x0=-1.0, g=source)):
        result = bromwich.solve(**small(**change), check=False)
        other = again(result)
        assert repr(fields(other)) == repr(fields(result))
        np.testing.assert_array_equal(other.y, result.y)
        np.testing.assert_allclose(other.at([0.4, 1.2]).x, result.at([0.4, 1.2]).x, atol=1e-12)
    with pytest.warns(bromwich.NotSolvedWarning):
        result = bromwich.solve(A=0, B=0, N=1, M=0, g="0.5 - t", x0=0, T=1, steps=20)
    other = again(result)
    assert other.status == "infeasible" and other.infeasible_at == result.infeasible_at


def test_goal():
    result = bromwich.solve(bromwich.scene("ph-toy"), method="goal", steps=100)
    assert again(result).goal == result.goal


def test_results_of_a_solver():
    """x0 and sources that are no longer those of the scene."""
    solver = bromwich.Solver(bromwich.Scene(**small(g=source)), steps=50)
    solver.set_x0(0.7)
    moved = solver.solve()
    solver.set_sources(f=0.1, g="-sin(2*t)")
    driven = solver.solve()
    for result in (moved, driven, again(moved)):
        other = again(result)
        np.testing.assert_array_equal(other.y, result.y)
        np.testing.assert_array_equal(other.w, result.w)
        np.testing.assert_allclose(other.at([0.123, 1.2]).x, result.at([0.123, 1.2]).x, atol=1e-12)
    assert not np.allclose(moved.w, driven.w)


def solved(scene):
    return bromwich.solve(scene)


def test_other_processes():
    given = [bromwich.Scene(**small(g=f"-sin({w}*t)")) for w in (1, 2, 3)]
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        found = pool.map(solved, given)
    for scene, result in zip(given, found):
        np.testing.assert_allclose(result.y, bromwich.solve(scene).y, atol=1e-14)
