"""Mean, RMS, extreme values and ripple against closed forms."""

import numpy as np
import pytest

import bromwich


def oscillator(**given):
    """x = cos(w t), constraint never active."""
    w = 2 * np.pi
    return bromwich.solve(
        A=[[0, w], [-w, 0]], B=[0, 0], N=[0, 0], M=1, g=1.0, x0=[1, 0], T=2, names={"x": ["v", "i"]}, **given
    )


# x of march is exact at any time up to 1e-13 of the kernel; Gauss of order 8 on pieces of 1/20 has errors below (w/20)^8 / 8!.
@pytest.mark.parametrize("options", [dict(steps=40, method="march"), dict(method="events", tol=1e-10), dict(steps=400)])
def test_of_a_sine(options):
    r = oscillator(**options)
    assert r.mean("v", 1, 2) == pytest.approx(0, abs=1e-8)
    assert r.mean("v", 0, 0.25) == pytest.approx(2 / np.pi, abs=1e-8)
    assert r.rms("v", start=1) == pytest.approx(np.sqrt(0.5), abs=1e-8)
    assert r.max("i", 0.1, 2) == pytest.approx(1, abs=1e-5) and r.min("x0") == pytest.approx(-1, abs=1e-5)
    assert r.ripple("v", start=1) == pytest.approx(2, abs=1e-5)
    assert r.max("v", 0.1, 0.2) == pytest.approx(np.cos(0.2 * np.pi), abs=1e-7)


def test_where_y_jumps():
    """x' = -1 + y from 1/2 with a stop at 0: y jumps from 0 to 1 at t = 1/2."""
    r = bromwich.solve(A=0, B=1, N=1, M=0, f=-1, x0=0.5, T=2, method="events", tol=1e-8)
    assert r.mean("y0") == pytest.approx(1.5 / 2, abs=1e-7)
    assert r.rms("y0") == pytest.approx(np.sqrt(1.5 / 2), abs=1e-7)
    assert (r.min("y0"), r.max("y0")) == pytest.approx((0, 1), abs=1e-7)
    assert r.mean("x0", 0, 0.5) == pytest.approx(0.25, abs=1e-7)
    assert r.mean("y0", 0.25, 0.75) == pytest.approx(0.5, abs=1e-7)


@pytest.mark.parametrize("options", [dict(restitution=[0.8], tol=1e-6), dict(restitution=[0], tol=1e-6), dict(steps=600, method="march")])
def test_means_of_forces_have_the_impulses_of_impacts(options):
    """A falling mass on a floor: its momentum changes by the mean force times the time, from before an impact to behind it."""
    gravity = 9.81
    r = bromwich.solve(A=[[0, 1], [0, 0]], B=[0, 1], N=[1, 0], M=0, f=[0, -gravity], x0=[1, 0], T=6, states="all", **options)
    for start, end in ((0, 6), (0, 0.3), (0.3, 5.5)):
        v = r.at([start, end]).x[:, 1]
        assert r.mean("y0", start, end) == pytest.approx(gravity + (v[1] - v[0]) / (end - start), abs=1e-9)


@pytest.mark.parametrize("options", [{}, dict(method="events", steps=20), dict(method="march", steps=1000)])
@pytest.mark.parametrize("rate", [20.0, 2e5])
def test_of_layers_far_shorter_than_a_row(rate, options):
    """x = e^{-rate t}, never in contact. March with 1000 steps is off by (20/1000)^3/72 = 1e-7 of x where the rate is 20."""
    r = bromwich.solve(A=-rate, B=1, N=1, M=0, x0=1, T=1, **options)
    near = 5e-7 if options.get("method") == "march" else 1e-8
    assert r.mean("x0") == pytest.approx((1 - np.exp(-rate)) / rate, rel=near)
    assert r.rms("x0") == pytest.approx(np.sqrt((1 - np.exp(-2 * rate)) / (2 * rate)), rel=near)


@pytest.mark.parametrize("method", ["auto", "events", "march", "euler", "multigrid", "dual"])
def test_means_have_the_impulse_of_a_start_beyond_a_constraint(method):
    """x' = -1 + y from -1 onto x >= 0: an impulse of 1, and y = 1 from then on."""
    r = bromwich.solve(A=0, B=1, N=1, M=0, f="-1", x0=-1, T=2, steps=200, method=method)
    assert r.mean("y0") == pytest.approx(3 / 2, abs=1e-9)


def test_wrong_names_and_times():
    r = oscillator(steps=20)
    with pytest.raises(bromwich.Error, match=r"name: found 'vv' \(did you mean 'v'\?\)"):
        r.mean("vv")
    for start, end in ((1, 1), (-1, 1), (0, 3), (float("nan"), 1)):
        with pytest.raises(bromwich.Error, match="start: found"):
            r.mean("v", start, end)


def test_of_a_file(tmp_path):
    """Linear between the rows."""
    r = oscillator(steps=400)
    r.save(tmp_path / "r.npz")
    read = bromwich.load(tmp_path / "r.npz")
    assert read.rms("v", start=1) == pytest.approx(np.sqrt(0.5), abs=1e-3)  # (w h)^2 / 12 = 8e-5
