"""Numerical inversion of the Laplace transform."""

from __future__ import annotations

import functools
import math
import warnings
from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import numpy as np

from . import _core
from ._arrays import listed, number, on_host
from ._errors import Error, NotSolved, NotSolvedWarning
from ._poles import poles_of
from ._solve import Check

CONTOURS = ("hyperbola", "talbot")

#: Two rules that disagree beyond this multiple of their rounding have a singularity between them, or near them.
BEYOND_ROUNDING = 100.0
#: The difference of two rules estimates the error of the worse one, some times too small.
OF_DIFFERENCE = 4.0
#: s times this is a neighbour of s: the difference of F there says how F is rounded.
NEIGHBOUR = 1 + 2.0**-50
#: Where no singularity is found, a disagreement of less than this part of the terms is that of a contour which does not
#: suit F, such as exp(-sqrt(s)) at small t; it counts so many times for all larger t.
LITTLE, OF_LITTLE = 1e-6, 10.0
#: Rounds in which singularities are located: each looks at one place where windows disagree.
MOST_ROUNDS = 12
#: More poles than these stand for no point: a branch point has fewer.
MOST_POLES = 30


class Inverse:
    """What :func:`invert` returns.

    Attributes:
        t: the times, as they were given.
        f: the original at these times; the axes of t, then those of a value of F; NaN where there is no estimate of its error.
        error: an estimate of ``abs(f - f_exact)``, of the same shape; infinite where F has singularities to the right of
            the contour that could not be located.
        singularities: the points that were given or located; empty: the negative real axis alone.
        evaluations: points s at which F was called.
        tol: as given.
    """

    def __init__(self, t: np.ndarray, f: Any, error: Any, singularities: list[complex], evaluations: int, tol: float) -> None:
        self.t, self.f, self.error = t, f, error
        self.singularities, self.evaluations, self.tol = singularities, evaluations, tol

    @property
    def ok(self) -> np.ndarray:
        """Of each time: whether the errors of all components are at most ``tol`` times the largest of them there, or times
        their largest value within a decade of t."""
        size, error = (np.abs(np.asarray(v)).reshape(np.size(self.t), -1).max(axis=1, initial=0.0) for v in (self.f, self.error))
        size = np.where(np.isfinite(size), size, 0.0)
        decade = np.round(np.log10(np.ravel(self.t)))
        with np.errstate(invalid="ignore"):
            largest = np.array([size[np.abs(decade - d) < 0.5].max() for d in np.unique(decade)])
            near = largest[np.searchsorted(np.unique(decade), decade)] if size.size else size
            return (error <= self.tol * near).reshape(np.shape(self.t))

    def __repr__(self) -> str:
        return f"<bromwich.Inverse {np.size(self.t)} times, {self.evaluations} values of F>"


def invert(
    F: Callable[[np.ndarray], Any],
    t: Any,
    *,
    singularities: Any = None,
    real: bool = True,
    contour: Literal["hyperbola", "talbot"] = "hyperbola",
    tol: float = 1e-9,
    accuracy: float = 0.0,
    check: Check = "warn",
) -> Inverse:
    """The original f of a Laplace transform F at many times::

        f(t) = 1/(2 pi i) ∫ e^{st} F(s) ds.

    Times of one decade share one contour: 1000 times over six decades take about 700 values of F with their estimate of the
    error. The error is estimated by a second contour with other parameters, by rounding, and by the agreement of contours
    of neighbouring decades, between which a singularity would show.

    Args:
        F: takes an array of complex s and returns an array whose first axis is that of s: numbers, vectors or matrices of
            NumPy or JAX. It has to be the analytic continuation of the transform to the left, with cuts on half-lines to the
            left of its singularities: ``sqrt(s - 1j) * sqrt(s + 1j)`` and not ``sqrt(s**2 + 1)``, whose cuts go up and down.
        t: times above 0, an array of any shape.
        singularities: points s_k, so that F is analytic without the half-lines from s_k to the left: poles and branch
            points, the rightmost first in mind. None: 0, the negative real axis; others to the right of it or beside it are
            located where contours of neighbouring decades disagree. Errors are relative to e^{Re s t} of the rightmost one:
            give it where f decays, since located ones are not looked for on the negative axis.
        real: f is real, F(conj(s)) = conj(F(s)): F is called in the upper half-plane alone, and conjugates of
            ``singularities`` are meant too. False: f is complex.
        contour: ``"hyperbola"``: one for a decade. ``"talbot"``: a cotangent contour for each t, of 13 points; the
            hyperbolas give its error.
        tol: where the estimated error exceeds this part of the largest abs(f) within the decade, ``check`` says so.
        check: ``"warn"``, True (raises) or False.

    Returns:
        An :class:`Inverse`. The quadrature is linear in F: with a function of JAX, ``f`` and ``error`` are its arrays, and
        ``jax.jit``, ``jax.grad`` and ``jax.vmap`` go through, with ``singularities`` given or on the negative axis and
        without ``check``.

    Raises:
        Error: times that are not positive, a result of F with another first axis, or not of complex or real numbers;
            singularities so far apart that F would be called more than 10^5 times for a decade.
        NotSolved: with ``check=True``.

    Originals that jump at t = a have transforms with factors e^{-as}, which grow to the left: the estimate says that there
    is no value near and before a. Take the factor out, and invert ``F(s) * exp(a * s)`` at ``t - a``.

    Example:
        >>> import numpy as np
        >>> r = invert(lambda s: 1 / (s + 1), np.logspace(-3, 1, 5), singularities=[-1])
        >>> bool(np.all(abs(r.f - np.exp(-r.t)) <= 1e-12 * np.exp(-r.t)))
        True
    """
    if not callable(F):
        raise Error(f"F: is a {type(F).__name__}; give a function of an array of complex s", "F")
    if contour not in CONTOURS:
        raise Error(f"contour: found {contour!r}; use {', '.join(CONTOURS)}", "contour")
    times = np.atleast_1d(on_host(t, "t")) if np.ndim(t) == 0 else on_host(t, "t")
    points = [] if singularities is None else _points(singularities)
    plan = _Quadrature(F, times, real, contour, number(accuracy, "accuracy"))
    found, apart = plan.apply(points)
    if singularities is None and plan.concrete:
        found, points = _locate(plan, found, apart)
    f, error = found
    one = np.ndim(t) == 0
    result = Inverse(times[0] if one else times, f[0] if one else f, error[0] if one else error, points, plan.evaluations, tol)
    if check and plan.concrete and times.size:
        numbers = Inverse(result.t, plan.number(result.f), plan.number(result.error), points, plan.evaluations, tol)
        _look_at(numbers, result, check)
    return result


def _locate(plan: _Quadrature, found: tuple[Any, Any], apart: list[int]) -> tuple[tuple[Any, Any], list[complex]]:
    """f, its error and the singularities that make neighbours agree, from small t to large ones. Points that do not help
    are left out again."""
    points: list[complex] = []
    left_out: set[int] = set()
    for _ in range(MOST_ROUNDS):
        at = max((k for k in apart if k not in left_out), default=None)
        if at is None:
            break
        more = plan.located(at, points)
        try:
            better, then = plan.apply([*points, *more]) if more else (found, apart)
        except Error:  # they are too far apart
            then = apart
        if at in then:
            left_out.add(at)
        else:
            found, apart, points = better, then, [*points, *more]
    return found, points


def _points(singularities: Any) -> list[complex]:
    values = listed([singularities] if np.ndim(singularities) == 0 else singularities, "singularities")
    try:
        return [complex(v) for v in values]
    except (TypeError, ValueError):
        raise Error("singularities: are no complex numbers; give a list of points", "singularities") from None


def _look_at(numbers: Inverse, result: Inverse, check: Check) -> None:
    wrong = ~np.ravel(numbers.ok)
    if not wrong.any():
        return
    t = np.ravel(numbers.t)[wrong]
    error = np.asarray(numbers.error).reshape(wrong.size, -1)[wrong].max(axis=1)
    message = (
        f"error: of {wrong.sum()} of {wrong.size} times is estimated above tol={numbers.tol:g}, up to {error.max():.2g} at "
        f"t={t[np.argmax(error)]:g}; give singularities, take out factors e^(-as), or see the attribute error"
    )
    if check is True:
        raise NotSolved(message, result)
    warnings.warn(message, NotSolvedWarning, stacklevel=3)


class _Part(NamedTuple):
    f: Any
    rounding: Any
    difference: Any  #: of two rules
    size: Any  #: sum of the absolute terms

    def at(self, row: int) -> _Part:
        return _Part(*(v[row] for v in self))


class _Quadrature:
    """One inversion. `concrete`: the values of F are numbers, and not those of a function that JAX traces."""

    def __init__(self, F: Callable[[np.ndarray], Any], t: np.ndarray, real: bool, contour: str, accuracy: float) -> None:
        self._F, self._t, self._real, self._contour, self._accuracy = F, t, bool(real), contour, accuracy
        self._xp: Any = np
        self.number: Callable[[Any], np.ndarray] = np.asarray
        self.concrete, self.evaluations = True, 0

    def apply(self, points: list[complex]) -> tuple[tuple[Any, Any], list[int]]:
        """f and its error, and the windows that disagree with their neighbour to the right."""
        with np.errstate(all="ignore"):
            return self._apply(points)

    def _apply(self, points: list[complex]) -> tuple[tuple[Any, Any], list[int]]:
        times = np.ascontiguousarray(self._t.ravel())
        self._windows = _core.inversion_windows(times, points, self._real, self._accuracy)
        talbot = _core.talbot(times, points, self._real, self._accuracy) if self._contour == "talbot" else None
        blocks = [s for _, first, second in self._windows for s in (first[0], first[0] * NEIGHBOUR, second[0])]
        ends = np.cumsum([0] + [s.size for s in blocks])
        if talbot is not None:
            blocks.append(talbot[0].ravel())
        self._s = np.concatenate(blocks) if blocks else np.zeros(0, complex)
        values = self._values()
        shape = (*self._t.shape, *values.shape[1:])
        values = values.reshape(self._s.size, math.prod(values.shape[1:]))
        self._ends, self._values_by_row = ends, values
        rows = [np.asarray(rows) for rows, *_ in self._windows]
        parts = [self._part(k, values) for k in range(len(rows))]
        xp, beyond = self._xp, 0.0
        windows_apart = []
        f: list[Any] = [values.real if self._real else values]
        error: list[Any] = [values.real]
        asked = max((k for k in range(len(rows)) if rows[k].size), default=0)
        for k in range(len(parts) - 1, -1, -1):
            if k + 1 < len(parts):
                apart, difference = self._apart(parts[k], parts[k + 1])
                size = functools.reduce(xp.maximum, (p.at(-2).size for p in parts[max(min(k, asked) - 2, 0) : k + 2]))
                step = xp.where(difference <= LITTLE * size, OF_LITTLE * difference, np.inf)
                beyond = beyond + xp.where(apart, step, 0.0)
                if self.concrete and np.any(self.number(apart)):
                    windows_apart.append(k)
            f.append(parts[k].f[: rows[k].size])
            error.append((OF_DIFFERENCE * parts[k].difference + parts[k].rounding)[: rows[k].size] + beyond)
        rows.reverse()
        f, error = (f[1:], error[1:]) if parts else (f, error)
        back = np.argsort(np.concatenate(rows), kind="stable") if rows else np.zeros(0, int)
        f, error = xp.concatenate(f)[back], xp.concatenate(error)[back]
        if talbot is not None:
            f, error = self._by_talbot(talbot, values[ends[-1] :], f, error)
        error = xp.where(xp.isnan(error), np.inf, error)
        f = f * xp.where(xp.isinf(error), np.nan, 1.0)
        return (f.reshape(shape), error.reshape(shape)), windows_apart

    def _values(self) -> Any:
        found = self._F(self._s)
        self.evaluations += self._s.size
        if type(found).__module__.partition(".")[0] in ("jax", "jaxlib"):
            import jax

            self._xp = jax.numpy
            self.number = lambda v: np.asarray(jax.lax.stop_gradient(v))
            self.concrete = not isinstance(jax.lax.stop_gradient(found), jax.core.Tracer)
            if found.dtype in (np.complex64, np.float32):
                raise Error('jax: has no float64; call jax.config.update("jax_enable_x64", True) first', "jax")
        else:
            found = np.asarray(found)
        if found.dtype.kind not in "cfiu":
            raise Error(f"F: returned an array of {found.dtype}; return numbers", "F")
        if found.ndim == 0 or found.shape[0] != self._s.size:
            raise Error(f"F: returned shape {found.shape} for {self._s.size} points; return an array with the axis of s first", "F")
        return found

    def _sum(self, weights: np.ndarray, values: Any) -> Any:
        total = weights @ values
        return total.real if self._real else total

    def _part(self, k: int, values: Any) -> _Part:
        """At the times of a window, then at its ends."""
        _, (_, weights, sizes), (_, second, _) = self._windows[k]
        a, b, c, d = self._ends[3 * k : 3 * k + 4]
        f, other, size = self._sum(weights, values[a:b]), self._sum(second, values[c:d]), self._xp.abs(values[a:b])
        terms = np.abs(weights)
        rounding = sizes @ size + OF_DIFFERENCE * (terms @ self._xp.abs(values[a:b] - values[b:c]))
        return _Part(f, rounding, self._xp.abs(f - other), terms @ size)

    def _apart(self, left: _Part, right: _Part) -> tuple[Any, Any]:
        """Of each component: whether a window and its neighbour to the right differ at the time that they share, or one of
        them differs between its rules; and by how much."""
        l, r = left.at(-2), right.at(-1)
        across = self._xp.abs(l.f - r.f)
        agree = across <= BEYOND_ROUNDING * (l.rounding + r.rounding)
        agree = agree & (l.difference <= BEYOND_ROUNDING * l.rounding) & (r.difference <= BEYOND_ROUNDING * r.rounding)
        return ~agree, across + l.difference + r.difference

    def _by_talbot(self, talbot: tuple, values: Any, f: Any, error: Any) -> tuple[Any, Any]:
        _, weights, sizes = talbot
        values = values.reshape(*weights.shape, values.shape[1])
        own = (weights[:, :, None] * values).sum(axis=1)
        own = own.real if self._real else own
        return own, error + self._xp.abs(own - f) + (sizes[:, :, None] * self._xp.abs(values)).sum(axis=1)

    def located(self, at: int, known: list[complex]) -> list[complex]:
        """Points to the left of the contour that is right of the window `at`, from a rational function that has the values
        of F there. Those that count at the time that both windows share."""
        a, b, c, d = self._ends[3 * at + 3 : 3 * at + 7]
        of_rules = np.r_[a:b, c:d]
        s, values = self._s[of_rules], self.number(self._values_by_row)[of_rules]
        if not np.isfinite(values).all():
            return []
        mixed = values @ np.cos(1.0 + np.arange(values.shape[1]))  # one function with the singularities of all
        if self._real:
            above = s.imag > 0
            s, mixed = np.concatenate([s, s[above].conj()]), np.concatenate([mixed, mixed[above].conj()])
        shared = 1 / np.abs(self._windows[at + 1][1][0]).min()  # about the time that both windows share
        poles, residues = poles_of(s, mixed)
        inside = poles.real < s.real.max()
        poles, residues = poles[inside], residues[inside]
        with np.errstate(over="ignore", invalid="ignore"):
            size = np.abs(residues * np.exp(np.minimum(poles.real * shared, 700)))
        if self._real:
            poles = poles.real + 1j * np.where(np.abs(poles.imag) <= 1e-7 * np.abs(poles), 0.0, np.abs(poles.imag))
        on_cut = (poles.imag == 0) & (poles.real <= max([0.0, *(p.real for p in known if p.imag == 0)]))
        counts = (size > 1e-10 * size.max(initial=0.0)) & ~on_cut
        fresh = [complex(p) for p in poles[counts] if all(abs(p - q) > 1e-6 * (abs(p) + abs(q)) for q in known)]
        if len(fresh) > MOST_POLES:
            return []
        return fresh if fresh == [] or any(abs(p.imag) == 0 for p in (*known, *fresh)) else [0j, *fresh]
