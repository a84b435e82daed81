"""A scene that is prepared once."""

import bromwich
import numpy as np
import pytest


def test_other_initial_values(Q15):
    solver = bromwich.Solver(Q15, steps=100)
    first = solver.solve()
    np.testing.assert_allclose(first.y, bromwich.solve(Q15, steps=100).y, atol=1e-12)
    solver.set_x0(0.1 * np.ones(Q15.states))
    second = solver.solve()
    assert second.ok and not np.allclose(first.y, second.y)
    # What the first result shows is its own.
    np.testing.assert_allclose(first.y, bromwich.solve(Q15, steps=100).y, atol=1e-12)


def test_other_sources(diode):
    scene = bromwich.Scene(**diode, g=lambda t: -np.sin(t))
    solver = bromwich.Solver(scene, steps=64)
    solver.solve()
    solver.set_sources(g="-cos(t)", f=0.25)
    r = solver.solve()
    expected = bromwich.solve(**diode, g=lambda t: -np.cos(t), f=[0.25], steps=64)
    np.testing.assert_allclose(r.y, expected.y, atol=1e-12)
    np.testing.assert_allclose(r.w, expected.w, atol=1e-12)
    np.testing.assert_allclose(r.at(0.7).x, expected.at(0.7).x, atol=1e-12)


def test_refused(diode):
    solver = bromwich.Solver(bromwich.Scene(**diode))
    with pytest.raises(bromwich.Error, match="x0"):
        solver.set_x0([1.0, 2.0])
    with pytest.raises(bromwich.Error, match="g"):
        solver.set_sources(g=np.zeros((5, 3)))
    assert solver.solve().ok
    with pytest.raises(bromwich.Error, match="stepz"):
        bromwich.Solver(bromwich.Scene(**diode), stepz=3)


def test_errors_do_not_break_a_solver(diode):
    solver = bromwich.Solver(bromwich.Scene(**diode), steps=50)

    def raising(t):
        if np.ndim(t) or t > 0:
            raise OSError("lost")
        return 0.0

    solver.set_sources(g=raising)
    with pytest.raises(OSError, match="lost"):
        solver.solve()
    solver.set_sources(g=lambda t: -t)
    np.testing.assert_allclose(solver.solve().y, bromwich.solve(**diode, g=lambda t: -t, steps=50).y, atol=1e-13)


@pytest.mark.parametrize("method", ["march", "multigrid", "contour"])
def test_a_second_solve_of_the_same_scene(Q15, method):
    options = {"steps": 64, "method": method, "backend": "cpu"}
    alone = bromwich.solve(Q15, reuse=False, **options)
    for _ in range(2):
        kept = bromwich.solve(Q15, **options)
        np.testing.assert_allclose(kept.y, alone.y, atol=1e-11)
    finer = bromwich.solve(Q15, **{**options, "steps": 128})
    assert finer.steps == 128 and kept.steps == 64
    np.testing.assert_allclose(kept.y, alone.y, atol=1e-11)  # results do not change with what is kept


def test_one_solve_without_confirmation():
    # Perturbations of x = cos t grow by e^10, which half the step shows.
    growing = bromwich.Scene(A=5.0, B=1.0, N=0.0, M=1.0, g=1.0, f="-sin(t) - 5*cos(t)", x0=1.0, T=2.0)
    confirmed = bromwich.solve(growing, steps=8, method="march", check=False)
    alone = bromwich.Solver(growing, steps=8, method="march", confirm=False).solve()
    assert confirmed.status == "tolerance_not_met"
    assert alone.status == "solved"
    np.testing.assert_allclose(alone.x, confirmed.x, rtol=1e-9)
    with pytest.raises(bromwich.Error, match="confirm"):
        bromwich.solve(growing, tol=1e-3, confirm=False)


def test_says_what_it_solves():
    scene = bromwich.Scene(A=-1, B=1, N=1, M=1, x0=0.5, T=1, name="leak")
    assert repr(bromwich.Solver(scene, steps=10)) == (
        "<bromwich.Solver of <bromwich.Scene 'leak': 1 states (dense), 1 constraints, initial values, T = 1>, steps = 10>"
    )
