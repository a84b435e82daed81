"""Results: views, other times, files, pictures, words."""

import gc
import pickle
import weakref

import bromwich
import numpy as np
import pytest
from conftest import is_view


@pytest.fixture
def result(diode):
    return bromwich.solve(**diode, g=lambda t: -np.sin(3 * t), steps=200)


def test_arrays_are_views(result):
    for name in ("t", "y", "x", "w"):
        first, second = getattr(result, name), getattr(result, name)
        assert is_view(first)
        assert np.shares_memory(first, second)
    with pytest.raises(ValueError):
        result.y[0] = 1


def test_views_outlive_the_result(result, request):
    y, copied = result.y, result.y.copy()
    del result
    request.node.funcargs.clear()
    gc.collect()
    np.testing.assert_array_equal(y, copied)


def test_w_is_what_it_says(result):
    np.testing.assert_allclose(result.w, result.x + result.y - np.sin(3 * result.t)[:, None], atol=1e-13)
    assert np.max(np.minimum(result.y, result.w)) < 1e-12


def test_states(diode):
    scene = dict(A=-np.eye(3), B=np.ones(3), N=np.ones(3), M=1, x0=[1, 2, 3], T=1, steps=10)
    assert bromwich.solve(**scene).x.shape == (11, 3)
    assert bromwich.solve(**scene, states=None).x.shape == (11, 0)
    chosen = bromwich.solve(**scene, states=[2, 0])
    assert chosen.x_components in ([2, 0], [0, 2])
    assert chosen.x[0, chosen.x_components.index(2)] == 3


def test_at(result):
    np.testing.assert_allclose(result.at(result.t).y, result.y)
    between = result.at(0.123456)
    assert between.t.shape == (1,) and between.y.shape == (1, 1)
    np.testing.assert_allclose(between.w, between.x + between.y - np.sin(3 * 0.123456), atol=1e-13)
    # x' = -x + y + ..., second order between time points of distance 1/100
    assert abs(between.x[0, 0] - np.interp(0.123456, result.t, result.x[:, 0])) < 1e-4
    with pytest.raises(bromwich.Error):
        result.at(3.0)


def test_switches_of_galerkin_have_the_error_of_the_grid_on_request():
    # x(0) = -x(T): what these nodes say of their own errors was 1e-9 where they are off by 4e-6.
    r = bromwich.solve(
        A=-1, B=1, N=1, M=1, T=1, f="0.2*sin(6*t)", g="t < 0.3337 ? 0.5 : -1+0.9*sin(9*t)",
        E0=1, ET=-1, b=0, method="galerkin", steps=400, event_location=True,
    )  # fmt: skip
    assert r.status == "solved" and r.switches and all(np.isnan(s.error) for s in r.switches)
    known = 0.7612239970  # of an integration with located events that shares no code
    nearest = min(r.switches_with_errors(), key=lambda s: abs(s.t - known))
    assert abs(nearest.t - known) <= nearest.error < 1e-3


def test_switches(result):
    switch = result.switches[0]
    assert switch.component == 0 and isinstance(switch.on, bool)
    assert 0 <= switch.t <= 2 and switch.error < 0.01
    assert len(result.switches_with_errors()) == len(result.switches)


def test_words(result):
    words = repr(result)
    for word in ("solved", result.method, "residual", "steps"):
        assert word in words
    assert "error estimate" in repr(bromwich.solve(bromwich.scene("dlcp-small"), tol=1e-3))
    jumps = bromwich.Scene.relay(A=[[0.0]], B=[[1.0]], C=[[1.0]], f=0.5, x0=[1.0], T=4, steps=400)
    for scene, method, of in ((jumps, "march", "the mean of y over [0, t]"), (bromwich.scene("dlcp-small"), "auto", "y")):
        r = bromwich.solve(scene, tol=1e-3, method=method, states="none")
        assert r.error_estimate_of == of and repr(r).count(f"error estimate {r.error_estimate:.1e} of {of},") == 1
        assert r.errors["of_integral"] == ("mean" in of)
    assert "3 states" in repr(bromwich.scene("dlcp-small"))


def test_names_and_units(tmp_path):
    """Of a scene of arrays: in options, pictures, data sets, files and pickles, as of a scene file."""
    names, units = {"x": ["v", "i"], "y": ["i_D"]}, {"t": "s", "x": ["V", "A"], "y": "A"}
    scene = bromwich.Scene(A=[[0, -1], [1, 0]], B=[-1, 0], N=[-1, 0], M=1, x0=[1, 0], T=1, steps=20, names=names, units=units)
    assert scene.names == {**names, "w": []} and scene.units["x"] == ["V", "A"]
    r = bromwich.solve(scene, states=["i"])
    assert r.x_components == [1] and r.state_names == ["i"] and r.constraint_names == ["i_D"]
    np.testing.assert_array_equal(r.x[:, 0], bromwich.solve(scene, states=[1]).x[:, 0])
    assert r.units == {"t": "s", "y": "A", "w": "", "x": ""}  # V and A are not one unit
    with pytest.raises(bromwich.Error, match=r"states: found 'I' \(did you mean 'i'\?\); .* names: v, i"):
        bromwich.solve(scene, states=["I"])
    assert pickle.loads(pickle.dumps(r)).state_names == ["i"]
    r.save(tmp_path / "r.npz")
    assert bromwich.load(tmp_path / "r.npz").constraint_names == ["i_D"]


def test_status_is_a_string(result):
    assert result.status == "solved" and result.status is bromwich.Status.solved and result.ok
    assert f"{result.status}" == "solved"


def test_timings(result):
    assert result.seconds == result.timings["total"] > 0


def test_xarray(result):
    pytest.importorskip("xarray")
    data = result.to_xarray()
    assert data["y"].dims == ("t", "constraint") and data["x"].dims == ("t", "state")
    assert data.attrs["method"] == result.method
    np.testing.assert_array_equal(data["y"].sel(t=0.5, method="nearest")[0], result.y[50, 0])


def test_plot(result, tmp_path, Q15):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    x, y = result.plot()
    assert x.get_title() == ""  # the scene has no name
    np.testing.assert_array_equal(y.lines[0].get_ydata(), result.y[:, 0])
    assert y.get_xlabel() == "t"
    assert result.plot("w").get_ylabel() == "w"
    many = bromwich.solve(Q15, steps=40).plot("y")
    assert len(many.collections) == 1
    many.figure.savefig(tmp_path / "y.png")
    jump = bromwich.solve(A=-1, B=1, N=1, M=0, g="-t", x0=-1, T=1, steps=20)
    assert jump.starts_with_impulse
    drawn = jump.plot("y").lines[0].get_ydata()
    assert np.isnan(drawn[0]) and np.array_equal(drawn[1:], jump.y[1:, 0])
    with pytest.raises(bromwich.Error, match="what"):
        result.plot("z")
    plt.close("all")


def test_cycles_are_collected():
    """An object whose method is a source, and which has the scene and its result."""

    class Circuit:
        def __init__(self):
            self.scene = bromwich.Scene(A=-1, B=1, N=1, M=1, x0=0, T=1, g=self.source)
            self.result = bromwich.solve(self.scene, steps=10)

        def source(self, t):
            return -t

    circuit = Circuit()
    gone = weakref.ref(circuit)
    del circuit
    gc.collect()
    assert gone() is None


def test_axes_have_units_and_prefixes():
    """A panel for each unit, x first; numbers in thousands of the unit, and the data as they are."""
    pytest.importorskip("matplotlib").use("Agg")
    names, units = {"x": ["i", "v"], "y": ["i_D"]}, {"t": "s", "x": ["A", "V"], "y": "A"}
    r = bromwich.solve(A=[[0, -1e3], [1e3, 0]], B=[0, -1], N=[0, -1], M=1, g=2e4, x0=[0, 1e4], T=2e-4, steps=20, names=names, units=units)
    above, middle, below = r.plot()
    assert [ax.get_ylabel() for ax in (above, middle, below)] == ["i [A]", "v [kV]", "i_D [A]"]
    assert below.get_xlabel() == "t [µs]" and above.get_xlabel() == ""
    np.testing.assert_array_equal(middle.lines[0].get_xdata(), r.t)
    assert below.xaxis.get_major_formatter()(1e-4, None) == "100" and middle.yaxis.get_major_formatter()(5e3, None) == "5"


@pytest.mark.parametrize(
    "size, unit, expected",
    [(2e-4, "s", "µs"), (3.0, "s", "s"), (2e4, "V", "kV"), (1e-7, "mm", "mm"), (5e-10, "F", "pF"), (0.0, "s", "s"), (1e30, "V", "V")],
)
def test_prefixes(size, unit, expected):
    from bromwich._axes import scale_of

    scale, named = scale_of(np.array([0.0, size, np.nan]), unit)
    assert named == expected and scale == pytest.approx({"µs": 1e-6, "kV": 1e3, "pF": 1e-12}.get(expected, 1))


def test_the_history_of_a_tolerance():
    r = bromwich.solve(bromwich.scene("dlcp-small"), tol=1e-3, method="march")
    assert len(r.history) == len(r.errors["grids"]) > 1 and r.history[-1] == pytest.approx(r.error_estimate)
    sweeps = bromwich.solve(bromwich.scene("signorini", Q=9), steps=20, method="contour")
    assert len(sweeps.history) > 3 and sweeps.errors is None and max(sweeps.history) < 1
