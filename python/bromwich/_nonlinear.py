"""Nonlinear complementarity systems."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from typing import Any, Literal

import numpy as np

from . import _core
from ._arrays import number, whole_number, word
from ._errors import Error
from ._machine import wanted
from ._rows import Rows, Switch
from ._scene import Scene
from ._solve import Backend, Check, judged, known, stated
from ._words import suggestion

METHODS = ("auto", "march", "iteration", "newton", "pointwise")
INNER = ("auto", "march", "contour", "multigrid")

Method = Literal["auto", "march", "iteration", "newton", "pointwise"]
Function = Callable[[float, np.ndarray, np.ndarray], Any]


class NonlinearResult(Rows):
    """The result of :func:`solve_nonlinear`.

    Attributes:
        defect: of the discrete equation of x, relative to max(1, |x|).
        newton, solves, windows, marched: Newton iterations, linear solves, windows of the iteration, marched steps.
        contraction: the largest one of an accepted window.
        seconds: wall-clock time of the solve.
    """

    def __init__(self, answer: _core.NonlinearAnswer, scene: Scene) -> None:
        super().__init__(answer, scene)
        self.defect: float = answer.defect
        self.newton: int = answer.newton
        self.solves: int = answer.solves
        self.windows: int = answer.windows
        self.marched: int = answer.marched
        self.contraction: float = answer.contraction
        self.seconds: float = answer.seconds

    @property
    def x_components(self) -> list[int]:
        """Which component of the state each column of ``x`` is: all of them, or none."""
        return list(range(self.x.shape[1]))

    @property
    def trace(self) -> np.ndarray:
        """(J+1) x n, v = N x in place of x, with ``of="trace"`` in scenes that are not dense; otherwise empty."""
        return self._answer.trace

    @property
    def residual(self) -> float:
        """max |min(y, w)| / max(1, |w - M y|) at the time points."""
        return self._answer.residual

    @property
    def error_estimate(self) -> float | None:
        """With ``tol``, and where half the step was solved to confirm a result; otherwise None."""
        return self._answer.error_estimate

    @property
    def steps(self) -> int:
        """J."""
        return self.t.size - 1

    @property
    def switches(self) -> list[Switch]:
        """When constraints become active and inactive, in order of time; the errors are those of interpolation."""
        return [Switch(*s) for s in self._answer.switches()]

    def at(self, t: float | Iterable[float]) -> NonlinearResult:
        """The result at other times: a row of ``t``, ``x``, ``y`` and ``w`` for each.

        y is linear between its rows, and x is computed from the row before. Where y may jump, a step from that row to
        the requested time is solved.

        Raises:
            Error: for times outside [0, T].
        """
        return NonlinearResult(self._answer.at(self._times(t)), self._scene)

    def __repr__(self) -> str:
        words = [f"{self.status} by {self.method}", *([] if self.ok else [self.reason])]
        words += [word for word in (self._estimate(), f"{self.steps} steps") if word]
        words += [f"warning: {self.warning}"] if self.warning else []
        return f"<bromwich.NonlinearResult {', '.join(words)}>"


def solve_nonlinear(
    scene: Scene | str | os.PathLike[str] | None = None,
    /,
    *,
    phi: Function | None = None,
    gamma: Function | None = None,
    dphi: Function | str | None = None,
    dgamma: Function | str | None = None,
    of: Literal["state", "trace"] = "state",
    method: Method = "auto",
    inner: Literal["auto", "march", "contour", "multigrid"] = "auto",
    steps: int | None = None,
    tol: float | None = None,
    max_steps: int | None = None,
    iteration_tol: float | None = None,
    backend: Backend = "auto",
    device: int | None = None,
    threads: int = 0,
    stop: Callable[[], bool] | None = None,
    check: Check = "warn",
    **arguments: Any,
) -> NonlinearResult:
    """Solves a nonlinear complementarity system on the time points t_j = j T/J::

        x' = A x + B y + f(t) + phi(t, x, y),   0 <= y  ⊥  w = N x + M y + g(t) + gamma(t, x, y) >= 0,   x(0) = x0.

    The linear part is integrated exactly; y and phi are linear between the time points, or, where y may jump, between
    the stages of Radau IIA: order 2.

    Args:
        scene: the linear part, a :class:`Scene`; or none, and A, B, N, M, x0, T, f, g by name; or the path of a scene file
            with a section [nonlinear], and values of its parameters by name.
        phi: function of t, x (m) and y (n) that returns m values. y is not negative where it is called.
        gamma: the same with n values.
        dphi, dgamma: derivatives: functions that return two arrays, by x and by y; ``"jax"``: by jax.jacfwd; None: by
            central differences.
        of: ``"trace"``: phi and gamma are functions of v = N x in place of x, and phi returns n values that enter through
            B; for large scenes, whose states at all times do not fit into memory.
        method: ``"march"``: each step by Josephy-Newton. ``"iteration"``: on windows of time, the linear part is solved
            with phi and gamma of the last iterate as sources. ``"newton"``: on windows, phi and gamma linearised about
            the last iterate. ``"pointwise"``: on windows, the functional iteration: nonlinear complementarity problems of
            all time points with the states of the last sweep. ``"auto"``: march for dense scenes, otherwise iteration.
        inner: the method of the linear solves of ``iteration`` and ``newton``: ``"march"``, ``"contour"``, ``"multigrid"``
            or ``"auto"``.
        steps: J; with ``tol`` of the first grid. Without both: as :func:`solve`.
        tol: halve the steps until the error of x and y, of the mean of y over [0, t] where it may jump, is estimated below tol
            times the largest value of each component.
        max_steps: with ``tol``.
        iteration_tol: of the last change of Newton's and other iterations; None: 1e-12.
        backend, device, threads, stop, check: as :func:`solve` takes them.

    Returns:
        A :class:`NonlinearResult`, whatever the status is.

    Raises:
        Error: bad input, such as a function that returns another number of values.
        NotSolved, Interrupted: as :func:`solve`.

    Example:
        >>> r = solve_nonlinear(A=[[0, 1], [-1, 0]], B=[0, 1], N=[1, 0], M=0.2, x0=[1, 0], T=6,
        ...                     phi=lambda t, x, y: [0, -x[0] ** 3])
        >>> r.status, r.x[-1]
    """
    if of not in ("state", "trace"):
        raise Error(f"of: is {of!r}; use \"state\" or \"trace\"", "of")
    terms = None
    if isinstance(scene, (str, os.PathLike)):
        for name, function in (("phi", phi), ("gamma", gamma), ("dphi", dphi), ("dgamma", dgamma)):
            if function is not None:
                raise Error(f"{name}: is given with a scene file, which states it; leave it out", name)
        model, terms, facts = _core.read_nonlinear(os.fspath(scene), {k: number(v, k) for k, v in arguments.items()})
        scene = Scene._of(model, facts["parameters"], {"description": facts["description"], "warning": facts["warning"]})
    else:
        known(arguments, solve_nonlinear)
        scene = stated(scene, steps, arguments)
    answer = _core.solve_nonlinear(
        scene._model,
        _values("phi", phi, dphi),
        _values("gamma", gamma, dgamma),
        _pair("dphi", dphi, phi),
        _pair("dgamma", dgamma, gamma),
        terms,
        of == "trace",
        _one_of(method, "method", METHODS),
        _one_of(inner, "inner", INNER),
        0 if steps is None else whole_number(steps, "steps"),
        _positive("tol", tol),
        0 if max_steps is None else whole_number(max_steps, "max_steps"),
        _positive("iteration_tol", iteration_tol, 1),
        wanted(backend, device, threads),
        stop,
    )
    return judged(NonlinearResult(answer, scene), answer.by_keyboard, check, stop, 3)


def _one_of(value: Any, name: str, words: tuple[str, ...]) -> str:
    if word(value, name) not in words:
        listed = f"{', '.join(words[:-1])} or {words[-1]}"
        raise Error(f"{name}: found {value!r}{suggestion(value, words)}; use {listed}", name)
    return value


def _positive(name: str, value: float | None, below: float = float("inf")) -> float:
    """The value as the compiled part takes it, 0 for None."""
    if value is None:
        return 0.0
    found = number(value, name)
    if not 0 < found < below:
        room = "a positive number" if below == float("inf") else f"a number between 0 and {below:g}"
        raise Error(f"{name}: is {value}; give {room}, or None", name)
    return found


def _values(name: str, function: Function | None, derivative: Function | str | None) -> Function | None:
    if function is None:
        return None
    if not callable(function):
        raise Error(f"{name}: is a {type(function).__name__}; give a function of t, x and y", name)

    if isinstance(derivative, str) and derivative == "jax":
        function = _in_double("d" + name, function)

    def values(t: float, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        found = _numbers(name, function(t, x, y))
        if found.ndim > 1:
            raise Error(f"{name}: returns an array of shape {found.shape}; return one number for each row, in a list", name)
        return np.atleast_1d(found)

    return values


def _numbers(name: str, found: Any) -> np.ndarray:
    """The values that a function has returned, as an array of float64."""
    try:
        if found is None or np.iscomplexobj(found):
            raise TypeError
        return np.asarray(found, float)
    except (TypeError, ValueError):
        raise Error(f"{name}: returns {_shown(found)}; return real numbers", name) from None


def _shown(value: Any) -> str:
    """In one short line."""
    return f"{' '.join(repr(value).split()):.60}"


def _pair(name: str, derivative: Function | str | None, function: Function | None) -> Function | None:
    if derivative is None:
        return None
    if function is None:
        raise Error(f"{name}: is given without {name[1:]}; give both, or none", name)
    if isinstance(derivative, str) and derivative == "jax":
        return _by_jax(name, function)
    if not callable(derivative):
        raise Error(f"{name}: is {derivative!r}; give a function, \"jax\" or None", name)

    def matrix(found: Any, columns: int) -> np.ndarray:
        entries = _numbers(name, found)
        if entries.ndim < 2:  # one row, or one column
            entries = entries.reshape(-1, columns) if entries.size % columns == 0 else entries.reshape(1, -1)
        if entries.ndim > 2:
            raise Error(f"{name}: returns an array of shape {entries.shape}; return a matrix by x and one by y", name)
        return np.ascontiguousarray(entries)

    def both(t: float, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found = derivative(t, x, y)
        if not isinstance(found, (tuple, list)) or len(found) != 2:
            raise Error(f"{name}: returns {_shown(found)}; return two arrays, by x and by y", name)
        return matrix(found[0], x.size), matrix(found[1], y.size)

    return both


def _jax(name: str) -> tuple[Any, Any]:
    """JAX, and its context of float64."""
    try:
        import jax
    except ImportError:
        raise Error(f'{name}: "jax" needs the package jax, which is not installed; install it, or give a function', name) from None
    if hasattr(jax, "enable_x64"):
        return jax, jax.enable_x64
    from jax.experimental import enable_x64  # of JAX before 0.8

    return jax, enable_x64


def _in_double(name: str, function: Function) -> Function:
    """A function written for JAX, whose values are float64."""
    jax, enable_x64 = _jax(name)
    compiled = jax.jit(lambda t, x, y: jax.numpy.atleast_1d(jax.numpy.asarray(function(t, x, y))))

    def values(t: float, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        with enable_x64(True):
            return np.asarray(compiled(t, x, y), float)

    return values


def _by_jax(name: str, function: Function) -> Function:
    jax, enable_x64 = _jax(name)
    jacobian = jax.jit(
        jax.jacfwd(lambda t, x, y: jax.numpy.atleast_1d(jax.numpy.asarray(function(t, x, y))), argnums=(1, 2))
    )

    def both(t: float, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        with enable_x64(True):
            by_x, by_y = jacobian(t, x, y)
        return np.ascontiguousarray(by_x, float), np.ascontiguousarray(by_y, float)

    return both
