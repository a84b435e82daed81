"""Derivatives of results: against closed forms and differences, and what is refused."""

import bromwich
import numpy as np
import pytest

STEPS = 200


@pytest.fixture
def circuit():
    C, L = 1.0, 0.3
    return dict(A=[[-0.2, -1 / C], [1 / L, 0]], B=[-1 / C, 0], N=[-1, 0], M=0.7, x0=[1, 0], T=5, g="0.1*cos(3*t)")


def solve(scene, **other):
    return bromwich.solve(**{**scene, **other}, steps=STEPS, method="march")


def test_x0_and_parameters_against_differences(circuit):
    d = solve(circuit).derivative()
    step = 1e-6
    for name, change in [("x0", np.array([0.3, -1])), ("M", np.array([[1.0]])), ("A", np.array([[1, 2], [0, -1.0]]))]:
        value = np.asarray(circuit[name], dtype=float)
        up, down = (solve(circuit, **{name: value + s * change}) for s in (step, -step))
        tangent = d.jvp(**{name: change})
        for kind in ("y", "x", "w"):
            difference = (getattr(up, kind) - getattr(down, kind)) / (2 * step)
            np.testing.assert_allclose(getattr(tangent, kind), difference, atol=1e-6 * (1 + np.abs(difference).max()))


def test_a_gradient_is_the_transpose_of_all_tangents(circuit):
    d = solve(circuit).derivative()
    last = np.zeros((STEPS + 1, 2))
    last[-1, 0] = 1
    gradient = d.vjp(x=last)
    assert gradient.E is None
    assert [g.shape for g in gradient[:7]] == [(2,), (STEPS + 1, 2), (STEPS + 1, 1), (2, 2), (2, 1), (1, 2), (1, 1)]
    for i in range(2):
        np.testing.assert_allclose(gradient.x0[i], d.jvp(x0=np.eye(2)[i]).x[-1, 0], rtol=1e-10)
    np.testing.assert_allclose(gradient.M[0, 0], d.jvp(M=[[1]]).x[-1, 0], rtol=1e-10)


def backends_here():
    return ["cpu", *(["cuda"] if bromwich.cuda_devices() else [])]


@pytest.mark.parametrize("backend", backends_here())
def test_over_all_time_points_on_a_backend(circuit, backend):
    r = bromwich.solve(**circuit, steps=STEPS, method="march", backend=backend)
    d, host = r.derivative(all_times=True), r.derivative()
    assert d.form == "over all time points" and host.form == "discrete solution"
    changes = dict(x0=[0.3, -1], g=np.cos(np.arange(STEPS + 1)).reshape(-1, 1), M=[[0.7]])
    for kind, found, expected in zip("yxw", d.jvp(states=True, **changes)[:3], host.jvp(**changes)[:3]):
        np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max(), err_msg=kind)
    weights = np.sin(np.arange(STEPS + 1)).reshape(-1, 1)
    found, expected = d.vjp(y=weights), host.vjp(y=weights)
    for name in ("x0", "g", "M"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-9 * np.abs(getattr(expected, name)).max())
    with pytest.raises(bromwich.Error, match="leave one of them out"):
        r.derivative(all_times=True, located=True)


def test_margin(circuit):
    margin = solve(circuit).derivative().margin
    assert 0 < margin.margin < 1
    assert 0 <= margin.t <= circuit["T"]
    assert margin.constraint == 0


def test_refusals(circuit):
    with pytest.raises(bromwich.Error, match="not differentiable here: y may jump"):
        bromwich.solve(A=0, B=1, N=1, M=0, x0=1, T=2, g="-t", steps=50, method="march").derivative(located=False)
    with pytest.raises(bromwich.Error, match="solve on more steps"):  # sources move fast inside of ten steps
        bromwich.solve(bromwich.scene("signorini", Q=33), steps=10, method="march").derivative()
    with pytest.raises(bromwich.Error, match="give 201 x 1"):
        solve(circuit).derivative().jvp(g=np.zeros((3, 1)))


def relay(x0, M=((0, 1), (-1, 0)), **given):
    # x' = 2 - sgn x: y = (s, x+), lambda = 1 - 2 s.
    return dict(A=0, B=[[-2, 0]], N=[[-1], [0]], M=M, g=lambda t: [0, 1], f=lambda t: [3], x0=x0, T=1, steps=50, **given)


def test_relay_that_crosses():
    d = bromwich.solve(**relay(-0.95)).derivative()
    assert d.located
    np.testing.assert_allclose(d.switches, [0.95 / 3], rtol=1e-9)
    np.testing.assert_allclose(d.jvp(x0=[1]).x[-1, 0], 1 / 3, rtol=1e-10)
    np.testing.assert_allclose(d.vjp(x=np.eye(51, 1, k=-50)).x0[0], 1 / 3, rtol=1e-10)
    assert d.vjp(x=np.eye(51, 1, k=-50)).M is None
    assert "jumps" in d.without_M
    with pytest.raises(bromwich.Error, match="one side|jumps"):
        d.jvp(M=np.eye(2))


def test_integral_of_y(circuit):
    discrete = solve(circuit).derivative()
    located = solve(circuit).derivative(located=True)
    assert not discrete.located
    # Order 2 in the step.
    np.testing.assert_allclose(
        discrete.jvp(x0=[1, 0]).integral[-1], located.jvp(x0=[1, 0]).integral[-1], rtol=2e-3
    )


def test_kronecker_sum(Q15):
    d = bromwich.solve(Q15, steps=50, method="march").derivative()
    g, weights = np.random.default_rng(1).normal(size=(2, 51, 15))
    np.testing.assert_allclose((d.vjp(y=weights).g * g).sum(), (d.jvp(g=g).y * weights).sum(), rtol=1e-10)


def test_batches_have_a_leading_axis() -> None:
    rng = np.random.default_rng(4)
    K, J = 6, 60
    M = np.array([[1.0, 0.2], [0.2, 1.5]])
    scene = dict(A=[[-1, 0.5], [-0.5, -1]], B=np.eye(2), N=np.eye(2), g=["sin(2*t + 0.3)", "sin(3*t + 1)"], T=3)
    x0, Ms = rng.normal(size=(K, 2)), M + 0.1 * np.arange(K)[:, None, None]
    r = bromwich.solve_batch(**scene, x0=x0, M=Ms, steps=J, method="march")
    d = r.derivative(threads=2)
    assert d.reason == [""] * K and not d.located.any()
    step = rng.normal(size=(K, 2))
    change, reason = d.jvp(x0=step, M=np.eye(2))
    assert change.y.shape == (K, J + 1, 2) and reason == [""] * K
    weights = rng.normal(size=(K, J + 1, 2))
    gradient, _ = d.vjp(y=weights)
    assert gradient.x0.shape == (K, 2) and gradient.M.shape == (K, 2, 2) and gradient.E is None
    for k in range(K):
        one = bromwich.solve(**scene, x0=x0[k], M=Ms[k], steps=J, method="march").derivative()
        np.testing.assert_allclose(change.y[k], one.jvp(x0=step[k], M=np.eye(2)).y, rtol=0, atol=1e-10)
        np.testing.assert_allclose(gradient.M[k], one.vjp(y=weights[k]).M, rtol=0, atol=1e-9)
    for bad in (dict(x0=np.ones((K + 1, 2))), dict(x0=1.0), dict(y=weights), dict(x0=[np.nan, 0])):
        with pytest.raises(bromwich.Error):
            d.jvp(**bad)
    with pytest.raises(bromwich.Error, match="not finite"):
        d.vjp(y=np.full((J + 1, 2), np.nan))


def test_a_quantity_of_interest() -> None:
    # x' = -x: the integral of x^2, and x(T).
    scene = dict(A=-1.0, B=1.0, N=0.0, M=1.0, g=lambda t: [1.0], x0=2.0, T=1)
    d = bromwich.solve(**scene, steps=200).derivative()
    found = d.quantity(W=[[1.0]], end_c=[1.0])
    half = (1 - np.exp(-2)) / 2
    assert abs(found.value - (4 * half + 2 * np.exp(-1))) < 1 / 200**2
    assert abs(found.gradient.x0[0] - (4 * half + np.exp(-1))) < 1 / 200**2
    assert abs((found.weights * d.jvp(x0=[1.0]).x).sum() - found.gradient.x0[0]) < 1e-12
    assert abs(d.quantity(c="t").value - 2 * (1 - 2 * np.exp(-1))) < 1 / 200**2
    with pytest.raises(bromwich.Error, match="quantity"):
        d.quantity()


def test_a_large_kronecker_sum() -> None:
    scene = bromwich.scene("signorini", Q=40)
    r = bromwich.solve(scene, steps=32, method="contour", states="none")
    d = r.derivative()
    change = d.jvp(g=np.ones((33, 40)))
    gradient = d.vjp(y=np.ones((33, 40)))
    assert change.x.size == 0 and gradient.A is None
    assert abs(change.y.sum() - gradient.g.sum()) < 1e-10 * abs(gradient.g).sum()


def test_states_of_a_large_scene() -> None:
    scene = bromwich.scene("signorini", Q=40)
    d = bromwich.solve(scene, steps=16, method="march", states="none").derivative()
    x0, weights = np.linspace(0, 1, 1600), np.sin(np.arange(17 * 1600)).reshape(17, 1600)
    change = d.jvp(x0=x0, states=True)
    assert change.x.shape == (17, 1600)
    np.testing.assert_allclose(change.x[0], x0, rtol=1e-12, atol=1e-12)
    assert abs((change.x * weights).sum() - d.vjp(x=weights).x0 @ x0) < 1e-10 * np.linalg.norm(weights) * np.linalg.norm(change.x)


def test_boundary_values() -> None:
    scene = dict(A=-1, B=1, N=1, M=1, T=2, f="3*sin(4*t)", g="cos(3*t)-0.2", E0=1, ET=-0.5, b=0.2)
    r = bromwich.solve(**scene, steps=100, method="galerkin")
    d = r.derivative()
    assert not d.located and 0 < d.margin.margin < 1 and (r.y > 0).any() and (r.y == 0).any()
    step = 1e-6
    up, down = (bromwich.solve(**{**scene, "b": scene["b"] + s}, steps=100, method="galerkin") for s in (step, -step))
    tangent = d.jvp(b=[1])
    for kind in ("y", "x", "w"):
        difference = (getattr(up, kind) - getattr(down, kind)) / (2 * step)
        np.testing.assert_allclose(getattr(tangent, kind), difference, atol=1e-7)
    gradient = d.vjp(x=np.eye(101, 1))
    assert gradient.x0 is None and gradient.E is None
    np.testing.assert_allclose(gradient.b, tangent.x[0], rtol=1e-12)
    for name in ("A", "B", "N", "M", "E0", "ET"):
        up, down = (bromwich.solve(**{**scene, name: scene[name] + s}, steps=100, method="galerkin") for s in (step, -step))
        difference = (up.x - down.x) / (2 * step)
        np.testing.assert_allclose(d.jvp(**{name: [[1.0]]}).x, difference, atol=1e-7)
        np.testing.assert_allclose(getattr(gradient, name), [[difference[0, 0]]], atol=1e-7)
    assert abs(d.quantity(end_c=[1]).gradient.b[0] - tangent.x[-1, 0]) < 1e-12
    with pytest.raises(bromwich.Error, match="change b"):
        d.jvp(x0=[1])
    with pytest.raises(bromwich.Error, match="change x0"):
        bromwich.solve(A=-1, B=1, N=1, M=1, x0=1, T=1, steps=10, method="march").derivative().jvp(b=[1])


def test_parameters_of_a_kronecker_sum() -> None:
    def at(c):
        return bromwich.solve(bromwich.scene("signorini", Q=7, c=c), steps=33, method="march")

    c, step = 0.05, 1e-6
    d = at(c).derivative()
    difference = (at(c * (1 + step)).y - at(c * (1 - step)).y) / (2 * step)
    tangent = d.jvp_parameters(face=1, across=1, B=1)  # B has the factor c, too
    np.testing.assert_allclose(tangent.y, difference, atol=1e-7)
    gradient = d.vjp_parameters(y=np.ones((34, 7)))
    np.testing.assert_allclose(gradient.face + gradient.across + gradient.B, tangent.y.sum(), rtol=1e-10)
    with pytest.raises(bromwich.Error, match="Kronecker"):
        bromwich.solve(A=-1, B=1, N=1, M=1, x0=1, T=1, steps=10, method="march").derivative().jvp_parameters(B=1)


def fall(h, t, k=40.0, gravity=9.81):
    """Height of a mass that falls from h on soft ground of stiffness k, until it leaves it, and its derivative by h."""
    meets, omega = np.sqrt(2 * h / gravity), np.sqrt(k)
    speed, later, s = -gravity * meets, 1 / (gravity * meets), t - meets  # d meets / dh
    x = -gravity / k * (1 - np.cos(omega * s)) + speed / omega * np.sin(omega * s)
    rate = -gravity / omega * np.sin(omega * s) + speed * np.cos(omega * s)
    return x, -rate * later - gravity * later / omega * np.sin(omega * s)


SOFT = dict(A=[[0, 1], [0, 0]], B=[0, 1], N=[1, 0], M=1 / 40.0, f=[0, -9.81], T=0.5)
HEIGHTS = np.linspace(0.2, 0.6, 9)


def test_the_estimated_error_is_that_of_few_steps():
    steps = 25
    weights = np.zeros((steps + 1, 2))
    weights[-1, 0] = 1
    found, estimated = [], []
    for h in HEIGHTS:
        d = bromwich.solve(**SOFT, x0=[h, 0], steps=steps, method="march").derivative()
        exact = fall(h, SOFT["T"])[1]
        found.append(d.vjp(x=weights).x0[0] - exact)
        estimated.append(d.vjp_error(x=weights).x0[0])
        assert d.jvp_error(x0=[1, 0]).x[-1, 0] == pytest.approx(estimated[-1], rel=1e-9)
        located = bromwich.solve(**SOFT, x0=[h, 0], steps=steps, method="march").derivative(located=True)
        assert located.vjp(x=weights).x0[0] == pytest.approx(exact, rel=1e-8)  # ten times what it is said to be good for
        assert located.vjp_error(x=weights).x0[0] <= 1e-7 * abs(exact)
    # Twice what half the step changes; where the switch lies in its step differs from height to height.
    assert np.linalg.norm(found) <= np.linalg.norm(estimated) <= 8 * np.linalg.norm(found)
    assert np.linalg.norm(found) >= 1e-3, "and the steps are few"
    d = bromwich.solve(**SOFT, x0=[0.3, 0], steps=steps, method="march").derivative()
    table = np.linspace(0, 1, steps + 1)[:, None]
    error = d.vjp_error(x=weights)
    # The gradient by g is the same linear function at both steps: its error bounds that of any change.
    assert d.jvp_error(g=table).x[-1, 0] <= (error.g * table).sum() * (1 + 1e-9)
    with pytest.raises(bromwich.Error, match="h: is not known"):
        d.jvp_error(h=1)


def test_scenes_without_a_derivative_by_choice() -> None:
    x0 = np.array([[0.3, 0], [np.nan, 0], [0.5, 0]])
    r = bromwich.solve_batch(**SOFT, x0=x0, steps=40, method="march", check=False)
    weights = np.ones((3, 41, 2))
    weights[1] = np.nan
    for failed, value in (("nan", np.nan), ("zero", 0)):
        d = r.derivative(failed=failed)
        assert d.ok.tolist() == [True, False, True] and "not solved" in d.reason[1]
        gradient, reason = d.vjp(x=weights)
        change, _ = d.jvp(x0=np.where(np.isnan(x0), np.nan, 1))
        assert [bool(line) for line in reason] == [False, True, False]
        for table in (gradient.x0, gradient.A, change.x):
            assert np.isfinite(table[[0, 2]]).all()
            np.testing.assert_array_equal(table[1], np.full_like(table[1], value))
    weights[1:] = 1
    weights[2, 3] = np.inf
    gradient, reason = r.derivative().vjp(x=weights)
    assert "not finite" in reason[2] and np.isnan(gradient.x0[2]).all() and np.isfinite(gradient.x0[0]).all()
    with pytest.raises(bromwich.Error, match="scene 1: .*not solved"):
        r.derivative(failed="raise").vjp(x=np.ones((41, 2)))
    with pytest.raises(bromwich.Error, match="failed: found 'skip'"):
        r.derivative(failed="skip")


def test_a_batch_with_a_tolerance_has_located_derivatives() -> None:
    times = [0, 0.2, 0.5]
    r = bromwich.solve_batch(**SOFT, x0=[[h, 0] for h in HEIGHTS], method="events", tol=1e-6, times=times, states="all")
    d = r.derivative()
    assert d.located.all()
    change, reason = d.jvp(x0=[1, 0])
    assert not any(reason)
    for k, h in enumerate(HEIGHTS):
        x, by_h = fall(h, SOFT["T"])
        assert r.x[k, -1, 0] == pytest.approx(x, abs=1e-6)
        assert change.x[k, -1, 0] == pytest.approx(by_h, rel=1e-8)
    with pytest.raises(bromwich.Error, match="times"):
        r.derivative(located=False)
