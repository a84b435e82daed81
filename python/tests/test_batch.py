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


def falling(**more):
    """x = x0 - t until the stop at 0, where y jumps to 1: for three starts."""
    names, units = {"x": ["v"], "y": ["force"]}, {"t": "s", "x": "m", "y": "N"}
    given = dict(A=[[0.0]], B=[[1.0]], N=[[1.0]], M=[[0.0]], f=[-1.0], T=1e-3 * 2000, steps=200, names=names, units=units)
    return bromwich.solve_batch(**given, x0=[[0.5], [1.0], [3.0]], states="all", **more)


def test_measures_switches_and_names():
    r = falling()
    assert r.state_names == ["v"] and r.constraint_names == ["force"]
    starts = np.array([0.5, 1.0, 3.0])
    # Rows are 0.01 apart and contain the stop: a line between them errs by h at most where x has its kink.
    np.testing.assert_allclose(r.mean("v"), [0.5**2 / 4, 1 / 4, 2], atol=0.01 * 0.01)
    np.testing.assert_allclose(r.rms("v", 0, 0.5), [np.sqrt((b**3 - a**3) / 1.5) for a, b in zip(starts - 0.5, starts)], atol=1e-3)
    np.testing.assert_allclose(r.ripple("v"), [0.5, 1.0, 2.0], atol=1e-12)
    np.testing.assert_allclose(r.max("force"), [1, 1, 0], atol=1e-9)
    found = r.switches
    assert [len(one) for one in found] == [1, 1, 0]
    for one, start in zip(found[:2], starts):
        assert abs(one[0].t - start) <= one[0].error + 1e-12 <= 0.011 and one[0].on
    with pytest.raises(bromwich.Error, match="name: found 'w'"):
        r.mean("w")


def test_files_data_sets_and_pictures(tmp_path):
    r = falling()
    r.save(tmp_path / "r.npz")
    with np.load(tmp_path / "r.npz") as read:
        np.testing.assert_array_equal(read["y"], r.y)
        assert read["status"].tolist() == ["solved"] * 3 and read["state_name"].tolist() == ["v"]
    with pytest.raises(bromwich.Error, match="path"):
        r.save(tmp_path / "r.csv")
    xarray = pytest.importorskip("xarray")
    dataset = r.to_xarray()
    assert dataset["x"].dims == ("scene", "t", "state") and dataset["x"].attrs["units"] == "m"
    pytest.importorskip("h5netcdf")
    r.save(tmp_path / "r.nc")
    with xarray.open_dataset(tmp_path / "r.nc", engine="h5netcdf") as read:
        np.testing.assert_array_equal(read["x"], r.x)
    pytest.importorskip("matplotlib").use("Agg")
    axes = r.plot("v")
    assert len(axes.lines) == 3 and axes.get_ylabel() == "v [m]" and axes.get_xlabel() == "t [s]"
    many = bromwich.solve_batch(A=[[-1.0]], B=[[1.0]], N=[[1.0]], M=[[1.0]], x0=np.ones((20, 1)), T=1, steps=10)
    assert many.plot("x0").collections[0].get_array().shape == (20, 11)


def test_rows_at_times_of_the_grid_and_matrices_of_their_own():
    A = -np.linspace(0.5, 2, 40).reshape(40, 1, 1)
    shared = {**ONE, "A": A, "g": "-sin(3*t)", "f": "cos(t)", "x0": [0.2]}
    every = bromwich.solve_batch(**shared)
    assert every.in_lanes == 40
    some = bromwich.solve_batch(**shared, times=[0.5, 2.0])
    assert some.in_lanes == 40 and some.y.shape == (40, 2, 1)
    for name in ("y", "x", "w"):
        assert np.abs(getattr(some, name) - getattr(every, name)[:, [16, 64]]).max() <= SAME
    between = bromwich.solve_batch(**shared, times=[0.51])  # not on the grid: by single solves
    assert between.in_lanes == 0 and between.y.shape == (40, 1, 1)


def test_w_is_that_of_the_rows():
    x0 = np.linspace(-1, 1, 11).reshape(11, 1)
    r = bromwich.solve_batch(**ONE, g="-sin(3*t)", x0=x0)
    assert np.abs(r.w - (r.x + r.y - np.sin(3 * r.t)[:, None])).max() <= SAME
    none = bromwich.solve_batch(**ONE, g="-sin(3*t)", x0=x0, states="none")
    assert none.x.shape == (11, 65, 0) and np.abs(none.w - r.w).max() <= SAME


def test_where_results_are():
    x0 = np.linspace(-1, 1, 40).reshape(40, 1)
    r = bromwich.solve_batch(**ONE, g="-sin(3*t)", x0=x0, backend="cpu", results="device")
    assert isinstance(r.y, np.ndarray) and r.ok.all()
    with pytest.raises(bromwich.Error, match='results: is \'disk\'; use "host" or "device"'):
        bromwich.solve_batch(**ONE, x0=x0, results="disk")
