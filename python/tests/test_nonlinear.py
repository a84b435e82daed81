"""Nonlinear systems: against SciPy with events, and what is said of bad input."""

import subprocess
import sys
import warnings

import numpy as np
import pytest

import bromwich

SCENE = dict(
    A=[[0, 1], [-1, -0.2]],
    B=[0, 1],
    N=[1, 0],
    M=0.2,
    x0=[0.3, 0],
    T=6,
    f=lambda t: [0 * t, 2 * np.cos(2 * t)],
    g=0.5,
)


def spring(t, x, y):
    return [0, -x[0] ** 3]


def by_events():
    """The same by DOP853, restarted at each switch of y = max(0, -5 (q + 1/2))."""
    integrate = pytest.importorskip("scipy.integrate")

    def rate(t, z):
        y = max(0.0, -5 * (z[0] + 0.5))
        return [z[1], -z[0] - z[0] ** 3 - 0.2 * z[1] + 2 * np.cos(2 * t) + y]

    def touch(t, z):
        return z[0] + 0.5

    touch.terminal = True
    t, z = 0.0, np.array([0.3, 0.0])
    while t < 6:
        part = integrate.solve_ivp(rate, (t, 6), z, "DOP853", rtol=1e-11, atol=1e-12, events=touch)
        t, z = part.t[-1], part.y[:, -1]
        if t < 6:  # away from the event
            step = integrate.solve_ivp(rate, (t, t + 1e-6), z, "DOP853", rtol=1e-11, atol=1e-12)
            t, z = step.t[-1], step.y[:, -1]
    return z


def test_order_two_against_located_events():
    exact = by_events()
    errors = [
        np.abs(bromwich.solve_nonlinear(**SCENE, phi=spring, steps=J).x[-1] - exact).max() for J in (200, 800)
    ]
    assert np.log2(errors[0] / errors[1]) / 2 == pytest.approx(2, abs=0.25)


@pytest.mark.parametrize("method", ["iteration", "newton"])
def test_windows_agree_with_steps(method):
    march = bromwich.solve_nonlinear(**SCENE, phi=spring, steps=300)
    other = bromwich.solve_nonlinear(**SCENE, phi=spring, steps=300, method=method)
    assert other.ok and other.method == method and other.windows > 0
    np.testing.assert_allclose(other.x, march.x, atol=1e-10)


def test_tolerance():
    r = bromwich.solve_nonlinear(**SCENE, phi=spring, tol=1e-3, steps=50)
    assert r.ok and r.error_estimate <= 1e-3 and r.residual < 1e-10 and r.defect < 1e-10


def test_derivatives_by_jax():
    jnp = pytest.importorskip("jax.numpy")
    given = bromwich.solve_nonlinear(
        **SCENE, phi=spring, steps=40, dphi=lambda t, x, y: ([[0, 0], [-3 * x[0] ** 2, 0]], np.zeros((2, 1)))
    )
    jax = bromwich.solve_nonlinear(
        **SCENE, phi=lambda t, x, y: jnp.array([0 * x[0], -x[0] ** 3]), steps=40, dphi="jax"
    )
    np.testing.assert_allclose(jax.x, given.x, atol=1e-11)


@pytest.mark.parametrize(
    "arguments, words",
    [
        (dict(phi=lambda t, x, y: [[0, 1]]), "phi: returns an array of shape (1, 2); return one number for each row, in a list"),
        (dict(phi=lambda t, x, y: "a"), "phi: returns 'a'; return real numbers"),
        (dict(phi=lambda t, x, y: None), "phi: returns None; return real numbers"),
        (dict(phi=lambda t, x, y: np.array([0, 1j])), "phi: returns array([0.+0.j, 0.+1.j]); return real numbers"),
        (dict(phi=spring, dphi=lambda t, x, y: np.zeros((2, 2))), "dphi: returns array"),
        (dict(phi=spring, dphi=lambda t, x, y: (1, 2, 3)), "dphi: returns (1, 2, 3); return two arrays, by x and by y"),
        (dict(phi=spring, dphi=lambda t, x, y: (np.zeros((2, 3)), np.zeros((2, 1)))), "dphi: returns a 2 x 3 matrix; return 2 x 2"),
        (dict(phi=spring, dphi=lambda t, x, y: (np.zeros((2, 2)), np.zeros((1, 2)))), "dphi: returns a 1 x 2 matrix; return 2 x 1"),
        (dict(gamma=lambda t, x, y: 0 * y, dphi=lambda t, x, y: (0, 0)), "dphi: is given without phi; give both, or none"),
        (dict(phi=spring, inner="events"), "inner: found 'events'; use auto, march, contour or multigrid"),
        (dict(phi=spring, tol=-1), "tol: is -1; give a positive number, or None"),
        (dict(phi=spring, iteration_tol=float("nan")), "iteration_tol: is nan; give a number between 0 and 1, or None"),
        (dict(phi=spring, max_steps=-1), "max_steps: found -1; give a whole number from 1 on"),
        (dict(phi=spring, tol=1e-3, steps=100, max_steps=50), "max_steps: found 50; give 100 or more"),
    ],
)
def test_bad_input_has_one_line(arguments, words):
    with pytest.raises(bromwich.Error) as error:
        bromwich.solve_nonlinear(**{**SCENE, "steps": 10, **arguments})
    assert str(error.value).startswith(words) and "\n" not in str(error.value)


def test_jax_that_is_not_installed(monkeypatch):
    monkeypatch.setitem(sys.modules, "jax", None)
    with pytest.raises(bromwich.Error, match="dphi: .* needs the package jax"):
        bromwich.solve_nonlinear(**SCENE, phi=spring, steps=10, dphi="jax")


def test_bad_input_and_failure():
    with pytest.raises(bromwich.Error, match="phi"):
        bromwich.solve_nonlinear(**SCENE, phi=lambda t, x, y: [0.0], steps=10)
    with pytest.raises(bromwich.Error, match="phi"):
        bromwich.solve_nonlinear(**SCENE, phi=3, steps=10)
    with pytest.raises(bromwich.Error, match="method"):
        bromwich.solve_nonlinear(**SCENE, phi=spring, steps=10, method="newtn")
    with pytest.raises(ZeroDivisionError):
        bromwich.solve_nonlinear(**SCENE, phi=lambda t, x, y: [0, 1 / 0], steps=10)
    with warnings.catch_warnings(record=True):
        warnings.simplefilter("always")
        r = bromwich.solve_nonlinear(**SCENE, phi=lambda t, x, y: [0, 1e3 * x[0] ** 2], steps=20)
    assert not r.ok and "t = " in r.reason and np.isnan(r.x[-1]).all()


def test_rows_at_other_times_and_switches():
    r = bromwich.solve_nonlinear(**SCENE, phi=spring, steps=300)
    rows = r.at([0.0, 1.2345, 6.0])
    assert rows.x.shape == (3, 2)
    np.testing.assert_array_equal(rows.x[2], r.x[-1])
    near = bromwich.solve_nonlinear(**{**SCENE, "T": 1.2345}, phi=spring, steps=300)
    np.testing.assert_allclose(rows.x[1], near.x[-1], atol=1e-3)  # h^2 of both
    switches = r.switches
    assert [s.on for s in switches] == [True, False, True]
    with pytest.raises(bromwich.Error):
        r.at(7)


def test_a_result_is_saved_and_drawn_like_a_linear_one(tmp_path):
    names = {"x": ["q", "v"], "y": ["force"]}
    r = bromwich.solve_nonlinear(**SCENE, phi=spring, steps=60, names=names, units={"t": "s", "y": "N"})
    r.save(tmp_path / "r.npz")
    again = bromwich.load(tmp_path / "r.npz")
    for key in ("t", "y", "w", "x"):
        np.testing.assert_array_equal(getattr(again, key), getattr(r, key))
    assert again.ok and again.state_names == ["q", "v"] and again.attributes["method"] == "march"
    assert r.constraint_names == ["force"] and r.units["y"] == "N"
    assert r.seconds > 0 and r.steps == 60 and "solved by march, error estimate" in repr(r) and " of y and x, 60 steps" in repr(r)
    part = r.at([0.1, 0.2])
    part.save(tmp_path / "part.csv")
    np.testing.assert_allclose(bromwich.load(tmp_path / "part.csv").x, part.x)
    with pytest.raises(bromwich.Error, match=r"^t: found 7.0; give times from 0.0 to 6"):
        r.at(7)
    pytest.importorskip("matplotlib").use("Agg")
    above, below = r.plot()
    assert [line.get_label() for line in above.lines] == ["q", "v"] and below.get_ylabel() == "force [N]"
    xarray = pytest.importorskip("xarray")
    data = r.to_xarray()
    assert isinstance(data, xarray.Dataset) and data["y"].attrs["units"] == "N" and data.sizes["t"] == 61


FILE = """
[parameters]
k = 1
[dynamics]
A = [[0, 1], [-1, -0.2]]
B = [[0], [1]]
f = [0, "2*cos(2*t)"]
x0 = [0.3, 0]
[complementarity]
N = [[1, 0]]
M = [[0.2]]
g = [0.5]
[nonlinear]
phi = [0, "-k*x0^3"]
[time]
T = 6
steps = 200
"""


def test_ctrl_c_while_arrays_are_handed_over():
    """The exception of one argument of phi is not hidden by that of the next one. NumPy's copy stands for the place where
    the signal arrives."""
    code = """
import numpy as np, bromwich
def interrupted(*_):
    raise KeyboardInterrupt("here")
np.copy = interrupted
bromwich.solve_nonlinear(A=-1, B=1, N=1, M=1, x0=1, T=1, phi=lambda t, x, y: -x**3, steps=10)
"""
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert found.stderr.strip().endswith("KeyboardInterrupt: here"), found.stderr


def test_files(tmp_path):
    path = tmp_path / "stop.toml"
    path.write_text(FILE)
    read = bromwich.solve_nonlinear(path)
    stated = bromwich.solve_nonlinear(**SCENE, phi=spring, steps=200)
    np.testing.assert_allclose(read.x, stated.x, atol=1e-12)
    softer = bromwich.solve_nonlinear(path, k=0)
    assert np.abs(softer.x - read.x).max() > 0.1
    with pytest.raises(bromwich.Error, match="nonlinear"):
        bromwich.Scene.from_toml(path)
    with pytest.raises(bromwich.Error, match="phi"):
        bromwich.solve_nonlinear(path, phi=spring)


def test_functions_of_the_trace():
    scene = dict(A=[[-1.0]], B=[[2.0]], N=[[1.0]], M=0.5, g="-5*sin(2*t)", x0=[0.0], T=4, steps=100)
    of_x = bromwich.solve_nonlinear(**scene, phi=lambda t, x, y: -2 * x**3)
    of_v = bromwich.solve_nonlinear(**scene, phi=lambda t, v, y: -(v**3), of="trace")
    np.testing.assert_allclose(of_v.x, of_x.x, atol=1e-9)  # derivatives by differences


def test_doubtful_steps_are_named():
    """A stop 10^4 times stiffer than the spring, met for less than a step of 1/5."""
    fine = bromwich.solve_nonlinear(**SCENE, phi=spring, steps=2000)
    assert fine.ok and fine.warning == "" and fine.error_estimate is None
    stiff = dict(SCENE, M=1e-4)
    with pytest.warns(bromwich.NotSolvedWarning, match="more steps"):
        coarse = bromwich.solve_nonlinear(**stiff, phi=spring, steps=30)
    assert coarse.status == "tolerance_not_met" and coarse.error_estimate > 0.01


@pytest.mark.parametrize("saturation", [1e-3, 1e-6, 1e-9, 1e-12, 1e-14])
@pytest.mark.parametrize("derivative", [True, False])
@pytest.mark.parametrize("voltage", [0.025, 0.05])
def test_a_rectifier_with_the_law_of_a_diode(saturation, derivative, voltage):
    """y is found where w = v - e + r y + V ln(1 + y / I) = 0, from currents of 1e-14 A on, at default steps."""
    r = 1.0
    scene = bromwich.Scene(A=-10.0, B=1e3, N=1, M=r, g="-10*sin(100*pi*t)", x0=0, T=0.04)
    law = lambda t, x, y: voltage * np.log1p(np.maximum(y, 0) / saturation)
    slope = lambda t, x, y: (np.zeros((1, 1)), np.diag(voltage / (saturation + np.maximum(y, 0))))
    found = bromwich.solve_nonlinear(scene, gamma=law, dgamma=slope if derivative else None, check=False)
    if not found.ok and not derivative and saturation < 1e-9:  # differences of y see nothing of a law that is so steep
        assert "does not converge" in found.reason
        return
    assert found.ok, found.reason
    x, y = found.x[:, 0], found.y[:, 0]
    w = x - 10 * np.sin(100 * np.pi * found.t) + r * y + voltage * np.log1p(y / saturation)
    assert np.min(y) >= 0
    # The change of w in the last iteration is below 1e-8 of its terms, of about 20 V, and Newton's next one would be far smaller.
    assert np.max(np.abs(np.minimum(y, w))) < 1e-6 and found.residual < 1e-7
