"""Derivatives by parameters of scenes: against differences of solves, closed forms, and what is refused."""

import bromwich
import numpy as np
import pytest

STEPS = 200

CIRCUIT = """
name = "circuit"
[parameters]
R = 0.7
C = 1
v0 = 1
[dynamics]
A = [[-0.2, "-1/C"], ["1/0.3", 0]]
B = [["-1/C"], [0]]
x0 = ["v0", 0]
[complementarity]
N = [[-1, 0]]
M = [["R"]]
g = ["0.1*R*cos(3*t)"]
[time]
T = 5
[quantity]
W = [["C/2", 0], [0, 0.15]]
end_c = [0, 1]
"""


@pytest.fixture
def circuit(tmp_path):
    path = tmp_path / "circuit.toml"
    path.write_text(CIRCUIT)
    return lambda **settings: bromwich.Scene.from_toml(path, **settings)


def solve(scene):
    return bromwich.solve(scene, steps=STEPS, method="march")


def assert_differences(tangent, up, down, by):
    for kind in ("y", "x", "w"):
        difference = (getattr(up, kind) - getattr(down, kind)) / (2 * by)
        np.testing.assert_allclose(getattr(tangent, kind), difference, atol=1e-6 * (1 + np.abs(difference).max()))


def test_of_a_file(circuit):
    d = solve(circuit()).derivative(parameters=["R", "C"])
    assert d.form == "discrete solution" and "central differences" in d.words and not d.located
    assert d.parameters == {"R": 0.7, "C": 1.0} and d.t.size == STEPS + 1
    jacobian = d.jacobian()
    for name, value in d.parameters.items():
        step = 1e-6 * value
        assert_differences(jacobian[name], solve(circuit(**{name: value + step})), solve(circuit(**{name: value - step})), step)
    np.testing.assert_allclose(d.jvp(R=2, C=-1).y, 2 * jacobian["R"].y - jacobian["C"].y, atol=1e-12)
    weights = np.random.default_rng(3).normal(size=(STEPS + 1, 2))
    gradient = d.vjp(x=weights)
    for name in ("R", "C"):
        np.testing.assert_allclose(gradient[name], (weights * jacobian[name].x).sum(), rtol=1e-10)
    assert 0 < d.margin.margin < 1


def test_of_the_quantity_of_a_file(circuit):
    def value(C):
        return solve(circuit(C=C)).derivative(parameters="C").quantity()

    found, gradient = value(1.0)
    step = 1e-5
    np.testing.assert_allclose(gradient["C"], (value(1 + step)[0] - value(1 - step)[0]) / (2 * step), rtol=1e-6)
    other, of_other = solve(circuit()).derivative(parameters=["C"]).quantity(end_c=[1, 0])
    assert abs(other - solve(circuit()).x[-1, 0]) < 1e-12
    np.testing.assert_allclose(of_other["C"], solve(circuit()).derivative(parameters=["C"]).jvp(C=1).x[-1, 0], rtol=1e-10)


def test_of_expressions_and_of_built_in_scenes():
    def at(a, w):
        return bromwich.Scene(A=-1, B=1, N=1, M=1, x0=1, T=3, g="a*cos(w*t)", parameters={"a": a, "w": w})

    d = solve(at(2, 1.5)).derivative(parameters=["a", "w"])
    step = 1e-6
    assert_differences(d.jvp(a=1), solve(at(2 + step, 1.5)), solve(at(2 - step, 1.5)), step)
    assert_differences(d.jvp(w=1), solve(at(2, 1.5 + step)), solve(at(2, 1.5 - step)), step)
    built_in = solve(bromwich.scene("signorini", Q=7, c=0.05)).derivative(parameters=["c"])
    step = 1e-7
    assert_differences(
        built_in.jvp(c=1),
        solve(bromwich.scene("signorini", Q=7, c=0.05 + step)),
        solve(bromwich.scene("signorini", Q=7, c=0.05 - step)),
        step,
    )


def test_of_a_function():
    # x' = 2 p - sgn x with p = 1: x' = 3 below 0 and 1 above. x(T) = 2 p T - 1 (T - t*) + t*, t* = -x0/(2p + 1).
    def relay(p):
        return bromwich.Scene(
            A=0, B=[[-2, 0]], N=[[-1], [0]], M=[[0, 1], [-1, 0]], g=lambda t: [0, 1], f=lambda t: [2 * p + 1], x0=-0.95, T=1
        )

    r = bromwich.solve(relay(1.0), steps=50)
    d = r.derivative(parameters={"p": 1.0}, scene_of=relay)
    assert d.located
    switch = 0.95 / 3
    np.testing.assert_allclose(d.switches, [switch], rtol=1e-9)
    np.testing.assert_allclose(d.jvp(p=1).x[-1, 0], 2 * switch / 3 + 2 * (1 - switch), rtol=1e-8)
    np.testing.assert_allclose(d.vjp(x=np.eye(51, 1, k=-50))["p"], d.jvp(p=1).x[-1, 0], rtol=1e-10)


def test_of_boundary_values():
    def at(p):
        return bromwich.Scene(A=-p, B=1, N=1, M=p, T=2, f="3*sin(4*t)", g=[p - 1.2], E0=p, ET=-0.5, b=0.2 * p)

    def solved(p):
        return bromwich.solve(at(p), steps=100, method="galerkin")

    d = solved(1.0).derivative(parameters={"p": 1.0}, scene_of=at)
    assert d.form == "boundary values"
    step = 1e-6
    assert_differences(d.jvp(p=1), solved(1 + step), solved(1 - step), step)


def test_refusals(circuit):
    r = solve(circuit())
    for given, message in [
        (dict(parameters=["Q"]), "found 'Q'; use parameters of the scene: C, R, v0"),
        (dict(parameters=[]), "is empty"),
        (dict(parameters={"R": 1.0}), "without scene_of"),
        (dict(parameters=["R"], scene_of=circuit), "no values for scene_of"),
        (dict(scene_of=circuit), "without parameters"),
    ]:
        with pytest.raises(bromwich.Error, match=message):
            r.derivative(**given)
    d = r.derivative(parameters=["R"])
    with pytest.raises(bromwich.Error, match="is not differentiated by"):
        d.jvp(C=1)
    with pytest.raises(bromwich.Error, match="by p: x0 is not differentiable at p = 1"):
        bend = lambda p: bromwich.Scene(A=-1, B=1, N=1, M=1, x0=abs(p - 1), T=1)
        solve(bend(1)).derivative(parameters={"p": 1}, scene_of=bend)


def test_of_the_width_of_a_pulse():
    # x' = -x + f, f = 1 up to p: x(T) = (e^p - 1) e^{-T}.
    scene = bromwich.Scene(A=-1, B=1, N=0, M=1, x0=0, T=2, f="t < p ? 1 : 0", g=[1], parameters={"p": 0.503})
    d = bromwich.solve(scene, steps=100).derivative(parameters=["p"])
    assert d.located
    np.testing.assert_allclose(d.jvp(p=1).x[-1, 0], np.exp(0.503 - 2), rtol=1e-8)


def test_of_a_relay():
    """x' = -x + l + sin(w t) slides on x = e until it leaves; e moves with w."""
    make = lambda w: bromwich.Scene.relay(
        A=-1.0, B=1.0, C=1.0, x0=0.8, T=2, f="2*sin(w*t)", e="0.2*cos(w*t)", parameters={"w": w}, names={"x": ["v"]}, steps=400
    )
    assert make(3).names["x"] == ["v"] and make(3).parameters == {"w": 3.0}
    result = bromwich.solve(make(3), tol=1e-9)
    d = result.derivative(parameters=["w"])
    by = 1e-5
    up, down = (bromwich.solve(make(3 + s * by), tol=1e-9).at(result.t) for s in (1, -1))
    change, difference = d.jvp(w=1.0).x[:, 0], (up.x[:, 0] - down.x[:, 0]) / (2 * by)
    away = np.array([all(abs(t - s) > 1e-3 for s in d.switches) for t in result.t])
    np.testing.assert_allclose(change[away], difference[away], atol=1e-5)
