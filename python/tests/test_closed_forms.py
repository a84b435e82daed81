"""Against solutions that are known in closed form."""

import pickle

import bromwich
import numpy as np
import pytest


def test_linear_decay_without_contact(diode):
    """w = x + y > 0 with x > 0, so y = 0 and x = exp(-t): exact for exponential steps, up to rounding."""
    r = bromwich.solve(**{**diode, "x0": [1.0]}, steps=50)
    assert r.ok
    assert np.all(r.y == 0)
    np.testing.assert_allclose(r.x[:, 0], np.exp(-r.t), rtol=1e-13)
    np.testing.assert_allclose(r.w[:, 0], r.x[:, 0], rtol=1e-13)


def test_obstacle_carries_the_state(diode):
    """x + y - t = 0 while y > 0: y = t - x, x' = -2x + t, x = t/2 - 1/4 + exp(-2t)/4."""
    r = bromwich.solve(**diode, g=lambda t: -t, steps=100, method="march")
    x = r.t / 2 - 0.25 + 0.25 * np.exp(-2 * r.t)
    # y is linear in every step: second order, x'' <= 1 and h = 0.02.
    np.testing.assert_allclose(r.x[:, 0], x, atol=0.02**2)
    np.testing.assert_allclose(r.y[:, 0], r.t - x, atol=0.02**2)
    assert r.residual < 1e-13
    np.testing.assert_allclose(r.w, 0, atol=1e-13)


def test_ideal_diode_charges_a_capacitor():
    """A source u = t - 1/2 behind an ideal diode and R = 1 charges C = 1: none before t = 1/2, then v' = u - v."""
    r = bromwich.solve(A=0, B=1, N=1, M=1, g=lambda t: 0.5 - t, x0=0, T=2, steps=400)
    s = np.maximum(r.t - 0.5, 0)
    # Steps of second order away from the kink of y at 1/2, where h^2 slope is lost once.
    np.testing.assert_allclose(r.x[:, 0], s - 1 + np.exp(-s), atol=(2 / 400) ** 2)
    on = [switch for switch in r.switches if switch.on]
    assert len(on) == 1 and abs(on[0].t - 0.5) <= 2 / 400


def test_tolerance_holds(diode):
    r = bromwich.solve(**diode, g=lambda t: -t, tol=1e-6, steps=10)
    x = r.t / 2 - 0.25 + 0.25 * np.exp(-2 * r.t)
    assert r.ok and r.error_estimate < 1e-6
    assert np.max(np.abs(r.y[:, 0] - (r.t - x))) < 1e-6 * np.max(r.y)
    assert r.errors["grids"][-1] == r.steps


def test_mass_matrix(diode):
    """2 x' = -x + 2 y with E = 2 is x' = -x/2 + y."""
    with_mass = bromwich.solve(**{**diode, "B": [[2.0]]}, E=[[2.0]], g=lambda t: -t, steps=100)
    without = bromwich.solve(**{**diode, "A": [[-0.5]]}, g=lambda t: -t, steps=100)
    np.testing.assert_allclose(with_mass.y, without.y, atol=1e-13)


def test_boundary_values():
    """x'' = 0 between x(0) = 1 and x(1) = 2, an obstacle far below: x = 1 + t, x' = 1."""
    r = bromwich.solve(
        A=[[0, 1], [0, 0]], B=[0, 1], N=[1, 0], M=1, g=5.0,
        E0=[[1, 0], [0, 0]], ET=[[0, 0], [1, 0]], b=[1, 2], T=1, steps=10,
    )  # fmt: skip
    assert r.ok and r.method == "shooting"
    np.testing.assert_allclose(r.x[:, 0], 1 + r.t, rtol=1e-12)
    assert r.boundary_residual < 1e-12


def test_the_default_is_an_accuracy():
    """x' = -x + 100 cos(300 t), y = 0: 400 steps, 0.75 rad each, would err by 0.75^2/12 = 5 % of the largest x, 1/3."""
    given = dict(A=-1, B=1, N=1, M=1, g=10, x0=0, T=1)
    scene = bromwich.Scene(**given, f="100*cos(300*t)")
    assert scene.steps == 0
    results = [
        bromwich.solve(scene),
        bromwich.solve(**given, f=lambda t: 100 * np.cos(300 * t)),
        bromwich.Solver(pickle.loads(pickle.dumps(scene))).solve(),
    ]
    for r in results:
        assert r.ok and r.error_estimate <= 1e-3
        exact = 100 / 90001 * (np.cos(300 * r.t) + 300 * np.sin(300 * r.t) - np.exp(-r.t))
        assert np.abs(r.x[:, 0] - exact).max() <= 1e-3 / 3
    assert bromwich.solve(bromwich.Scene(**given, f=1.0, steps=20)).steps == 20
    rows = bromwich.solve_batch(scene, x0=[[0.0], [0.0]], times=[0, 0.5, 1])
    assert np.abs(rows.x[:, -1, 0] - results[0].x[-1, 0]).max() <= 2e-3 / 3


def test_built_in_scene_with_exact_solution():
    scene = bromwich.scene("dlcp-small")
    r = bromwich.solve(scene, steps=800)
    x, y = scene.exact(1.0)
    # Second order, h = 1/800, derivatives up to (3 pi)^2.
    np.testing.assert_allclose(r.x[-1], x, atol=90 / 800**2)
    np.testing.assert_allclose(r.y[-1], y, atol=90 / 800**2)


def test_relay_slides():
    """x' = 1/2 + l, l in -Sgn(x), from x = 1: x = 1 - t/2 until it slides on 0 with l = -1/2."""
    scene = bromwich.Scene.relay(A=[[0.0]], B=[[1.0]], C=[[1.0]], f=0.5, x0=[1.0], T=4, steps=400)
    r = bromwich.solve(scene)
    assert r.ok
    np.testing.assert_allclose(r.x[:, 0], np.maximum(1 - r.t / 2, 0), atol=4 / 400)
    assert 1 - 2 * r.y[-1, 0] == pytest.approx(-0.5, abs=1e-10)


def test_relay_with_an_offset_follows_it():
    # x' in -Sgn(x - t/2), x(0) = 0: x = t/2, lambda = 1/2
    scene = bromwich.Scene.relay(A=[[0.0]], B=[[1.0]], C=[[1.0]], e="-t/2", x0=[0.0], T=1, steps=50)
    r = bromwich.solve(scene)
    np.testing.assert_allclose(r.x[:, 0], r.t / 2, atol=1e-12)
    np.testing.assert_allclose(1 - 2 * r.y[1:, 0], 0.5, atol=1e-11)


def test_relay_with_a_bound_in_time_beside_a_stop():
    """x1' in -(1 + t) Sgn(x1) from 1 is 0 from t + t^2/2 = 1 on; x2' = -1 + y, 0 <= y ⊥ x2 >= 0, from 1/2 rests from t = 1/2 on."""
    scene = bromwich.Scene.relay(
        A=np.zeros((2, 2)), B=np.eye(2), C=[[1.0, 0.0]], x0=[1.0, 0.5], T=1, f=[0.0, -1.0], bound="1 + t", N=[[0.0, 1.0]], steps=50
    )
    r = bromwich.solve(scene, method="events", tol=1e-8, states="all")
    assert r.ok and r.y.shape[1] == 3
    np.testing.assert_allclose(r.x[:, 0], np.maximum(1 - r.t - r.t**2 / 2, 0), atol=1e-8)
    np.testing.assert_allclose(r.x[:, 1], np.maximum(0.5 - r.t, 0), atol=1e-8)
    assert (1 + r.t - 2 * r.y[:, 0])[[1, -1]] == pytest.approx([-1 - r.t[1], 0], abs=1e-7)
    assert sorted({round(s.t, 6) for s in r.switches}) == [0.5, round(np.sqrt(3) - 1, 6)]


def test_no_constraints():
    # x' = -2 x + 1
    r = bromwich.solve(A=-2.0, f=1.0, x0=3.0, T=1, steps=10, states="all")
    assert r.ok and r.y.shape == (11, 0)
    np.testing.assert_allclose(r.x[:, 0], 0.5 + 2.5 * np.exp(-2 * r.t), rtol=1e-12)


@pytest.mark.parametrize("M, n", [(0.0, 40), (2.0, 40), (2.0, 3), (np.float64(0.5), 1)])
def test_a_number_is_a_multiple_of_the_identity(M, n):
    given = dict(A=-np.eye(n), B=np.eye(n), N=np.eye(n), x0=0.0, T=1.0, g=-1.0, steps=20)
    found, expected = bromwich.solve(**given, M=M), bromwich.solve(**given, M=M * np.eye(n))
    np.testing.assert_allclose(found.y, expected.y, rtol=0, atol=1e-13)
    periodic = dict(A=-np.eye(n), B=np.eye(n), N=np.eye(n), M=np.eye(n), T=1.0, g="-sin(2*pi*t)", steps=20)
    periodic["g"] = [periodic["g"]] * n
    found = bromwich.solve(**periodic, E0=1, ET=-1, b=0, states="all")
    expected = bromwich.solve(**periodic, E0=np.eye(n), ET=-np.eye(n), b=np.zeros(n), states="all")
    np.testing.assert_allclose(found.x, expected.x, rtol=0, atol=1e-13)


def ball(e, **others):
    return bromwich.Scene(
        A=[[0, 1], [0, 0]], B=[[0], [1]], N=[[1, 0]], M=0.0, f=[0, -9.81], x0=[1, 0], T=1.2, restitution=e, **others
    )


def test_a_ball_bounces():
    # From height 1: the impact is at sqrt(2/g), and the next flight is e as fast.
    impact, speed = np.sqrt(2 / 9.81), np.sqrt(2 * 9.81)
    for e in (0.5, [0.8]):
        r = bromwich.solve(ball(e), check=True)
        k = np.ravel(e)[0]
        s = 0.6 - impact
        np.testing.assert_allclose(r.at(0.6).x[0], [k * speed * s - 9.81 * s * s / 2, k * speed - 9.81 * s], atol=1e-8)
        march = bromwich.solve(ball(e), method="march", steps=10, states="all", check=True)  # exact between impacts
        np.testing.assert_allclose(march.x[5], [k * speed * s - 9.81 * s * s / 2, k * speed - 9.81 * s], atol=1e-8)
    again = pickle.loads(pickle.dumps(ball(0.5)))
    np.testing.assert_array_equal(bromwich.solve(again).x, bromwich.solve(ball(0.5)).x)
    batch = bromwich.solve_batch([ball(0.5), ball(0.9)], steps=40)
    np.testing.assert_allclose(batch.x[1], bromwich.solve(ball(0.9), steps=40, method="events").x, atol=1e-12)


def test_restitution_that_is_refused():
    for e in (1.5, [0.5, 0.5]):
        with pytest.raises(bromwich.Error, match="restitution"):
            ball(e)
    assert bromwich.solve(ball(0.5), method="euler", steps=10, check=False).status == "unsupported"
