"""Numerical Laplace inversion against published pairs (Abramowitz, Stegun, Handbook of Mathematical Functions, 29.3; Davies,
Martin, J. Comput. Phys. 33, 1979), and what F may be. The rules themselves: tests/numerics/test_laplace_inversion.cpp."""

import warnings

import bromwich
import numpy as np
import pytest

special = pytest.importorskip("scipy.special")

T = np.logspace(-3, 3, 1000)


def root(s):
    """sqrt(s^2 + 1) with cuts to the left."""
    return np.sqrt(s - 1j) * np.sqrt(s + 1j)


# name: F, f, singularities, least and largest t. Beyond these f is below the rounding of its terms (of exp(-sqrt(s)), which
# tends to 1 as s -> 0: 1e-11 at t = 0.01, and 1/sqrt(t) of them at large t), underflows or overflows.
PAIRS = {
    "1": (lambda s: 1 / s, lambda t: 1 + 0 * t, None, 1e-3, 1e3),
    "t": (lambda s: 1 / s**2, lambda t: t, None, 1e-3, 1e3),
    "t^3/6": (lambda s: 1 / s**4, lambda t: t**3 / 6, None, 1e-3, 1e3),
    "1/sqrt(pi t)": (lambda s: s**-0.5, lambda t: 1 / np.sqrt(np.pi * t), None, 1e-3, 1e3),
    "2 sqrt(t/pi)": (lambda s: s**-1.5, lambda t: 2 * np.sqrt(t / np.pi), None, 1e-3, 1e3),
    "e^-t": (lambda s: 1 / (s + 1), lambda t: np.exp(-t), [-1], 1e-3, 600),
    "t e^-t": (lambda s: 1 / (s + 1) ** 2, lambda t: t * np.exp(-t), [-1], 1e-3, 600),
    "1 - e^-t": (lambda s: 1 / (s * (s + 1)), lambda t: -np.expm1(-t), None, 1e-3, 1e3),
    "heat": (lambda s: np.exp(-np.sqrt(s)), lambda t: np.exp(-1 / (4 * t)) / (2 * np.sqrt(np.pi * t**3)), None, 0.03, 1e2),
    "erfc": (lambda s: np.exp(-np.sqrt(s)) / s, lambda t: special.erfc(0.5 / np.sqrt(t)), None, 0.03, 1e3),
    "erfcx": (lambda s: 1 / (np.sqrt(s) * (np.sqrt(s) + 1)), lambda t: special.erfcx(np.sqrt(t)), None, 1e-3, 1e3),
    "log": (lambda s: np.log(s) / s, lambda t: -np.log(t) - np.euler_gamma, None, 1e-3, 1e3),
    "e^t": (lambda s: 1 / (s - 1), np.exp, [1], 1e-3, 600),
    "sinh": (lambda s: 1 / (s**2 - 1), np.sinh, [1], 1e-3, 600),
    "I0": (lambda s: 1 / (np.sqrt(s - 1) * np.sqrt(s + 1)), special.i0, [1], 1e-3, 600),
    "sin": (lambda s: 1 / (s**2 + 1), np.sin, [1j], 1e-3, 1e3),
    "cos": (lambda s: s / (s**2 + 1), np.cos, [1j], 1e-3, 1e3),
    "damped": (lambda s: 1 / ((s + 0.2) ** 2 + 1), lambda t: np.exp(-0.2 * t) * np.sin(t), [-0.2 + 1j], 1e-3, 1e3),
    "J0": (lambda s: 1 / root(s), special.j0, [1j], 1e-3, 1e3),
    "J1": (lambda s: 1 / (root(s) * (s + root(s))), special.j1, [1j], 1e-3, 1e3),
    "cos(2 sqrt(t))": (lambda s: np.exp(-1 / s) / np.sqrt(s), lambda t: np.cos(2 * np.sqrt(t)) / np.sqrt(np.pi * t), None, 1e-3, 1e3),
}
#: Zeros of f: errors are relative to its amplitude around t. What is left is the rounding of t at t = 1000, 1e-13.
AMPLITUDES = {
    "sin": lambda t: np.minimum(t, 1),
    "cos": np.ones_like,
    "damped": lambda t: np.exp(-0.2 * t) * np.minimum(t, 1),
    "J0": lambda t: np.minimum(1, 1 / np.sqrt(t)),
    "J1": lambda t: np.minimum(t / 2, 1 / np.sqrt(t)),
    "cos(2 sqrt(t))": lambda t: 1 / np.sqrt(np.pi * t),
    "log": lambda t: 1 + np.abs(np.log(t)),
}


@pytest.mark.parametrize("name", PAIRS)
def test_pairs_over_six_decades(name):
    F, f, singularities, t0, t1 = PAIRS[name]
    t = T[(T >= t0) & (T <= t1)]
    r = bromwich.invert(F, t, singularities=singularities, check=True)
    size = AMPLITUDES.get(name, lambda t: np.abs(f(t)))(t)
    error = np.abs(r.f - f(t))
    assert np.all(error <= 1e-12 * size)
    # References have roundings of their own, those of SciPy's Bessel functions at large t of the argument.
    assert np.all(error <= r.error + 4e-16 * np.maximum(1, t) * size)
    assert np.all(r.error <= 1e-9 * size) and np.all(r.ok)


@pytest.mark.parametrize("name", ["e^t", "sinh", "I0", "sin", "J0", "damped"])
def test_singularities_are_located(name):
    F, f, given, t0, _ = PAIRS[name]
    t = np.logspace(-3, 2, 200)
    r = bromwich.invert(F, t, check=True)
    size = AMPLITUDES.get(name, lambda t: np.abs(f(t)))(np.minimum(t, 1) if name == "damped" else t)
    assert np.all(np.abs(r.f - f(t)) <= np.minimum(r.error, 1e-11 * size) + 1e-14 * size)
    assert min(abs(s - given[0]) for s in r.singularities) < (0.1 if name in ("I0", "J0") else 1e-6)


# Cuts up and down from i and -i; a step at t = 1; a square wave, poles all along the imaginary axis; and what no contour sees
# of F. Where there is a finite estimate, it holds.
HARD = {
    "cuts": (lambda s: 1 / np.sqrt(s**2 + 1), special.j0),
    "step": (lambda s: np.exp(-s) / s, lambda t: np.where(t > 1, 1.0, 0.0)),
    "square wave": (lambda s: np.tanh(s / 2) / s, lambda t: 1 - 2 * (np.floor(t) % 2)),
    "small": (lambda s: 1 / s + 1e-5 / (s - 0.5), lambda t: 1 + 1e-5 * np.exp(0.5 * t)),
    "beside the cut": (lambda s: 1 / ((s + 0.01) ** 2 + 4), lambda t: np.exp(-0.01 * t) * np.sin(2 * t) / 2),
}


@pytest.mark.parametrize("name", HARD)
@pytest.mark.parametrize("given", [None, [0]])
@pytest.mark.parametrize("t", [T, T[-1:], T[::300]])
def test_no_wrong_value_without_its_error(name, given, t):
    F, f = HARD[name]
    r = bromwich.invert(F, t, singularities=given, check=False)
    with np.errstate(over="ignore"):
        exact = f(t)
    trusted = np.isfinite(r.error)
    assert np.all(np.abs(r.f - exact)[trusted] <= r.error[trusted] + 1e-13 * np.abs(exact[trusted]))
    if name in ("cuts", "square wave") or (name == "step" and t.size > 1):  # at t = 1000 the step is far away
        assert not np.any(r.ok & (np.abs(r.f - exact) > 1e-9))
        with pytest.warns(bromwich.NotSolvedWarning, match="error"):
            bromwich.invert(F, t, singularities=given)
        with pytest.raises(bromwich.NotSolved):
            bromwich.invert(F, t, singularities=given, check=True)


def test_units_do_not_matter():
    for unit in (1e-12, 1e12):
        t = unit * np.logspace(-2, 1, 50)
        r = bromwich.invert(lambda s: unit / ((unit * s + 0.1) ** 2 + 1), t, check=True)
        assert np.allclose(r.f, np.exp(-0.1 * t / unit) * np.sin(t / unit), rtol=1e-11, atol=1e-12)


def test_matrices_and_shapes():
    A = np.array([[0.0, 1.0], [-1.0, -0.2]])
    t = np.linspace(0.1, 5, 6).reshape(2, 3)
    r = bromwich.invert(lambda s: np.linalg.inv(s[:, None, None] * np.eye(2) - A), t)
    assert r.f.shape == r.error.shape == (2, 3, 2, 2) and r.ok.shape == (2, 3) and r.ok.all()
    expm = pytest.importorskip("scipy.linalg").expm
    assert np.allclose(r.f, [[expm(A * one) for one in row] for row in t], rtol=0, atol=1e-13)
    one = bromwich.invert(lambda s: 1 / s**2, 2.0)
    assert np.shape(one.f) == () and abs(one.f - 2) < 1e-14 and one.ok
    assert bromwich.invert(lambda s: 1 / s, []).f.shape == (0,)


def test_complex_originals_and_talbot():
    t = T[T < 50]
    r = bromwich.invert(lambda s: 1 / (s - (2j - 0.1)), t, real=False, check=True)
    assert np.all(np.abs(r.f - np.exp((2j - 0.1) * t)) <= 1e-11)
    r = bromwich.invert(lambda s: s**-0.5, T, contour="talbot", check=True)
    assert np.all(np.abs(r.f * np.sqrt(np.pi * T) - 1) <= 1e-11)


def test_accuracy_of_F():
    """F to 1e-7: so is f, and contours that differ by that have no singularity between them."""
    rng = np.random.default_rng(1)
    F = lambda s: 1 / (s + 1) / s * (1 + 1e-7 * rng.uniform(-1, 1, s.size))
    t = np.logspace(-2, 2, 50)
    r = bromwich.invert(F, t, accuracy=1e-7, tol=1e-4, check=True)
    assert np.all(np.abs(r.f + np.expm1(-t)) <= r.error) and np.all(r.error < 1e-4)


@pytest.mark.parametrize(
    "F, arguments, message",
    [
        (3, {}, "F: is a int"),
        (lambda s: 1.0, {}, "F: returned shape"),
        (lambda s: np.zeros((s.size + 1, 2)), {}, "F: returned shape"),
        (lambda s: ["a"] * s.size, {}, "F: returned an array"),
        (lambda s: 1 / s, dict(t=[1.0, 0.0]), "t: has the entry 0"),
        (lambda s: 1 / s, dict(t=[1.0, np.nan]), "t: has the entry nan"),
        (lambda s: 1 / s, dict(t=["a"]), "t: "),
        (lambda s: 1 / s, dict(t=[1e-300, 1e308]), "t: lies between"),
        (lambda s: 1 / s, dict(contour="circle"), "contour: found 'circle'"),
        (lambda s: 1 / s, dict(singularities="a"), "singularities: "),
        (lambda s: 1 / s, dict(singularities=[np.inf]), "singularities: has the point"),
        (lambda s: 1 / s, dict(singularities=[1j], contour="talbot"), "contour: is talbot"),
        (lambda s: 1 / s, dict(accuracy="b"), "accuracy: found 'b'"),
    ],
)
def test_bad_input(F, arguments, message):
    with pytest.raises(bromwich.Error, match=message):
        bromwich.invert(F, **{"t": [1.0], **arguments})


def test_derivatives_by_jax():
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    t = np.logspace(-2, 1, 20)
    total = lambda a: bromwich.invert(lambda s: 1 / (s * (s + a)), t, singularities=[0]).f.sum()
    exact = lambda a: np.sum(-np.expm1(-a * t) / a)
    slope = np.sum((t * np.exp(-0.5 * t) * 0.5 + np.expm1(-0.5 * t)) / 0.25)
    for gradient in (jax.grad(total), jax.jit(jax.grad(total))):
        assert abs(gradient(0.5) - slope) < 1e-11
    assert np.allclose(jax.vmap(total)(np.array([0.5, 0.6])), [exact(0.5), exact(0.6)], rtol=1e-13)
    located = lambda a: bromwich.invert(lambda s: 1 / (s * s + a), t).f.sum()  # arrays with values: as with NumPy
    assert abs(jax.grad(located)(1.0) - np.sum((t * np.cos(t) - np.sin(t)) / 2)) < 1e-9
    traced = jax.jit(lambda a: bromwich.invert(lambda s: 1 / (s * s + a), t).error)(1.0)
    assert np.isinf(traced[-1])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        total(0.5)
