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


def test_margin(circuit):
    margin = solve(circuit).derivative().margin
    assert 0 < margin.margin < 1
    assert 0 <= margin.t <= circuit["T"]
    assert margin.constraint == 0


def test_refusals(circuit):
    with pytest.raises(bromwich.Error, match="not differentiable here: y may jump"):
        bromwich.solve(A=0, B=1, N=1, M=0, x0=1, T=2, g="-t", steps=50, method="march").derivative(located=False)
    with pytest.raises(bromwich.Error, match="at most 1000 states"):
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
