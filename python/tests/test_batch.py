"""solve_batch against solve, scene by scene."""

import numpy as np
import pytest

import bromwich

ONE = dict(A=[[-1.0]], B=[[1.0]], N=[[1.0]], M=[[1.0]], T=2.0, steps=64)
SAME = 1e-12  # the same steps in another order of operations


def test_leading_axis_of_x0():
    x0 = np.linspace(-1, 1, 11).reshape(11, 1)
    r = bromwich.solve_batch(**ONE, g="-sin(3*t)", x0=x0)
    assert r.y.shape == r.w.shape == r.x.shape == (11, 65, 1) and len(r) == 11 and r.ok.all()
    assert r.in_lanes > 0
    for k in range(11):
        one = bromwich.solve(**ONE, g="-sin(3*t)", x0=x0[k])
        assert r.status[k] is one.status and r.method[k] == one.method
        for name in ("y", "w", "x"):
            assert np.abs(getattr(r, name)[k] - getattr(one, name)).max() <= SAME


def test_matrices_and_tables_of_their_own():
    A = -np.arange(1.0, 5).reshape(4, 1, 1)
    g = np.random.default_rng(1).normal(size=(4, 33, 1))
    shared = {**ONE, "A": None, "steps": None}
    r = bromwich.solve_batch(**{**shared, "A": A}, x0=[0.5], g=g)
    for k in range(4):
        one = bromwich.solve(**{**shared, "A": A[k]}, x0=[0.5], g=g[k])
        assert r.status[k] is one.status
        assert np.abs(r.y[k] - one.y).max() <= SAME * max(1, np.abs(one.y).max())


def test_lists_and_functions_of_each():
    scenes = [bromwich.Scene(**ONE, x0=[v]) for v in (0.0, -1.0)]
    assert bromwich.solve_batch(scenes).ok.all()
    f = [lambda t: np.sin(t), lambda t: 0 * t]
    r = bromwich.solve_batch(scenes[0], f=("each", f))
    for k in range(2):
        one = bromwich.solve(**ONE, x0=[0.0], f=f[k])
        assert np.abs(r.x[k] - one.x).max() <= SAME


def test_one_scene_that_fails_spoils_nothing():
    x0 = np.array([[0.0], [np.nan], [1.0]])
    with pytest.warns(bromwich.NotSolvedWarning, match="1 of 3 scenes are not solved; scene 1: unsupported: x0"):
        r = bromwich.solve_batch(**ONE, x0=x0)
    assert list(r.ok) == [True, False, True] and np.isnan(r.y[1]).all()
    with pytest.raises(bromwich.NotSolved):
        bromwich.solve_batch(**ONE, x0=x0, check=True)


def test_a_stopped_batch_has_rows_on_request():
    x0 = np.linspace(-1, 1, 4000).reshape(4000, 1)
    r = bromwich.solve_batch(**ONE, g="-sin(3*t)", x0=x0, stop=lambda: True, check=False)
    assert r.status[-1] == "interrupted" and not r.ok.all()
    assert r.y.shape == r.w.shape == r.x.shape == (4000, 65, 1)
    for rows in (r.y, r.w, r.x):
        assert np.isnan(rows[~r.ok]).all() and np.isfinite(rows[r.ok]).all()
    assert r.derivative().reason[-1] != ""


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (dict(A=np.ones((2, 1, 1)), x0=np.ones((3, 1))), "x0: has 3 scenes, and A has 2"),
        (dict(x0=np.ones((0, 1))), "x0: has no scenes"),
        (dict(x0=np.ones((2, 2, 2))), "x0: has 3 axes"),
        (dict(x0=np.ones((2, 1)), B=np.ones((2, 2, 2, 1))), "B: has 4 axes"),
    ],
)
def test_bad_input(bad, message):
    with pytest.raises(bromwich.Error, match=message):
        bromwich.solve_batch(**{**ONE, **bad})
