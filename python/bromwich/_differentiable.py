"""Shared by the wrappers for JAX and PyTorch: a solve of arrays, with or without leading axes, and its gradient."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from typing import Any, NamedTuple, NoReturn, Optional

import numpy as np

from ._batch import BatchResult, solve_batch
from ._derivative import BatchDerivative, Derivative
from ._errors import Error, NotSolved, NotSolvedWarning
from ._result import Result
from ._rows import Status
from ._solve import solve

#: The data of a solve, in the order of :class:`Gradient`, and the number of axes of each for one scene.
AXES = {"x0": 1, "f": 2, "g": 2, "A": 2, "B": 2, "N": 2, "M": 2}
DATA = tuple(AXES)

#: The shape of each array in DATA, in that order; None for one that is not given.
Shapes = Sequence[Optional[tuple[int, ...]]]


def leading(shapes: dict[str, tuple[int, ...] | None]) -> tuple[int, ...]:
    """The shape of the leading axes, after broadcasting those of all data."""
    for name, shape in shapes.items():
        if shape is not None and len(shape) < AXES[name]:
            raise Error(f"{name}: has {len(shape)} axes; give {AXES[name]}, or more with the scenes first", name)
    own = {name: shape[: len(shape) - AXES[name]] for name, shape in shapes.items() if shape is not None}
    try:
        return np.broadcast_shapes(*own.values())
    except ValueError:
        found = ", ".join(f"{name} {shape}" for name, shape in own.items() if shape)
        raise Error(f"leading axes: do not fit together ({found}); give one number of scenes", "leading axes") from None


#: The numbers in the array ``status`` of a solve with ``failed="nan"`` or ``"zero"``, as indices; 0: solved.
STATUSES: tuple[Status, ...] = (Status.solved, *(s for s in Status if s is not Status.solved))

FAILED = ("raise", "nan", "zero")

#: Larger values have squares that overflow, and with them a loss over all scenes: such a scene counts as not finite.
LARGEST = 1e150


class How(NamedTuple):
    """What a solve is told besides its data. Hashable, as JAX needs it."""

    T: float
    steps: int  #: J; rows at j T/J
    method: str = "march"
    threads: int = 0
    tol: float | None = None  #: switches are located; None: none are
    refine: int = 1  #: steps between two rows
    failed: str = "raise"


def how(T: Any, steps: Any, method: str, threads: int, tol: Any, refine: Any, failed: str) -> How:
    """These arguments, checked."""
    if failed not in FAILED:
        raise Error(f"failed: found {failed!r}; use {', '.join(FAILED)}", "failed")
    refine = whole(refine, "refine")
    if refine < 1:
        raise Error(f"refine: found {refine}; give a whole number from 1 on", "refine")
    if tol is not None and (method != "march" or refine != 1):
        name = "refine" if method == "march" else "method"
        raise Error(f"{name}: is given together with tol, which locates switches; leave one of them out", name)
    return How(float(T), whole(steps), method, threads, None if tol is None else float(tol), refine, failed)


def on_a_device(how: How) -> None:
    """Refuses what only the host has."""
    for name, asked in (("tol", how.tol is not None), ("refine", how.refine != 1), ("failed", how.failed != "raise")):
        if asked:
            raise Error(f"{name}: found {getattr(how, name)!r} on a device; leave it out, or use backend='cpu'", name)


class Solved:
    """A solution of one scene, or of scenes over leading axes. Data without these axes, or of length 1, are shared."""

    def __init__(self, arrays: dict[str, np.ndarray | None], *how: Any) -> None:
        self._how = How(*how)
        J, refine = self._how.steps, self._how.refine
        given = {name: np.asarray(v, dtype=np.float64) for name, v in arrays.items() if v is not None}
        self._shapes = {name: None if v is None else np.shape(v) for name, v in arrays.items()}
        self._leading = leading(self._shapes)
        for name in ("f", "g"):
            rows = given[name].shape[-2] if name in given else J + 1
            if rows != J + 1:
                raise Error(f"{name}: has {rows} rows; give {J + 1}, one for each time point", name)
            if name in given:
                given[name] = finer(given[name], refine)
        self._sizes = J + 1, given["B"].shape[-1], given["x0"].shape[-1]
        self._count = math.prod(self._leading)
        self._result: Result | BatchResult | None = None
        self._derivative: Derivative | BatchDerivative | None = None
        raises = self._how.failed == "raise"
        options: dict[str, Any] = dict(T=self._how.T, threads=self._how.threads, states="all", check=raises, backend="cpu")
        if self._how.tol is None:
            options |= dict(method=self._how.method, steps=J * refine)
        else:
            options |= dict(method="events", tol=self._how.tol, times=np.linspace(0, self._how.T, J + 1))
        if not self._leading and raises and self._how.tol is None:
            self._result = solve(**given, **options)
        elif self._count > 0:
            self._result = self._batch({name: self._listed(name, v) for name, v in given.items()}, options)
        if raises and (self.status != 0).any():
            scene = f"scene {int(np.argmax(self.status != 0))}: " if self._leading else ""
            raise NotSolved(f"{scene}nonfinite: values above {LARGEST:.0e}, whose squares overflow", self._result)

    def _listed(self, name: str, v: np.ndarray) -> np.ndarray:
        one = v.shape[v.ndim - AXES[name] :]
        spread = np.broadcast_to(v, (*self._leading, *one)).reshape(self._count, *one)
        # The batch takes the number of scenes from x0. Shared numbers that are not finite are those of each scene.
        own = name == "x0" or v.size != math.prod(one) or not (self._how.failed == "raise" or np.isfinite(v).all())
        return spread if own else v.reshape(one)

    def _batch(self, given: dict[str, np.ndarray], options: dict[str, Any]) -> BatchResult:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore" if self._how.failed != "raise" else "default", NotSolvedWarning)
            return solve_batch(**given, **options)

    @cached_property
    def status(self) -> np.ndarray:
        """Of each scene: an index of STATUSES."""
        if self._result is None:
            return np.zeros(self._leading, dtype=np.int32)
        r = self._result
        each = np.array([STATUSES.index(s) for s in ([r.status] if isinstance(r.status, Status) else r.status)], dtype=np.int32)
        large = np.zeros(each.size, dtype=bool)
        for v in (r.y, r.x, r.w):
            large |= (np.abs(v).reshape(each.size, -1) > LARGEST).any(axis=1)
        each[large & (each == 0)] = STATUSES.index(Status.nonfinite)
        return each.reshape(self._leading)

    def outputs(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """y, x and w, arrays of their own: leading axes, J+1, and n, m, n. NaN where there is no solution."""
        rows, n, m = self._sizes
        if self._result is None:
            y, x, w = (np.zeros((*self._leading, rows, k)) for k in (n, m, n))
            return y, x, w
        every = slice(None, None, self._how.refine)
        found = (self._result.y, self._result.x, self._result.w)
        y, x, w = (np.array(v[..., every, :]).reshape(*self._leading, rows, -1) for v in found)
        for v in (y, x, w):
            v[self.status != 0] = np.nan
        return y, x, w

    def gradient(
        self, of: tuple[np.ndarray, ...], shapes: Shapes | None = None, mapped: Sequence[bool] = ()
    ) -> list[np.ndarray | None]:
        """The gradient in the order of DATA; None for data that were not given, NaN for M where
        :attr:`Derivative.without_M` says that there is no derivative with respect to it.

        Args:
            of: weights of y, x and w. They have the leading axes of the outputs, or more where the scenes are shared.
            shapes: of the results, which are summed over axes that these lack, or where these have length 1; None: all
                leading axes.
            mapped: for each of the first axes of `of`, whether the scenes have it too.
        """
        one = {name: s[len(s) - AXES[name] :] for name, s in self._shapes.items() if s is not None}
        of = tuple(np.asarray(v, dtype=np.float64) for v in of)
        bars = self._passes(self._bars, dict(zip(("y", "x", "w"), of)), one, mapped)
        if shapes is None:
            return [bars.get(name) for name in DATA]
        return [None if s is None else _summed_to(bars[name], s) for name, s in zip(DATA, shapes)]

    def tangent(self, changes: dict[str, np.ndarray | None], mapped: Sequence[bool] = ()) -> tuple[np.ndarray, ...]:
        """The changes of y, x and w that changes of the data cause.

        Args:
            changes: of members of DATA. They have the leading axes of the outputs, or more where the scenes are shared.
            mapped: as for :meth:`gradient`.
        """
        given = {name: np.asarray(v, dtype=np.float64) for name, v in changes.items() if v is not None}
        rows, n, m = self._sizes
        return tuple(self._passes(self._changes, given, {"y": (rows, n), "x": (rows, m), "w": (rows, n)}, mapped).values())

    def _passes(self, one_pass: Any, given: dict[str, np.ndarray], shapes: dict[str, tuple], mapped: Sequence[bool]) -> dict:
        """What `one_pass` makes of tables with more leading axes than the scenes have: tables of these shapes, one pass
        for each index of these axes."""
        mine = iter(self._leading)
        own = (*(next(mine) if has else 1 for has in mapped), *mine)
        axes = {name: AXES.get(name, 2) for name in given}
        every = np.broadcast_shapes(own, *(v.shape[: v.ndim - axes[name]] for name, v in given.items()))
        own = (1,) * (len(every) - len(own)) + own
        given = {name: np.broadcast_to(v, (*every, *v.shape[v.ndim - axes[name] :])) for name, v in given.items()}
        found = {name: np.zeros((*every, *shape)) for name, shape in shapes.items()}
        for at in np.ndindex(*(k if one == 1 else 1 for k, one in zip(every, own))):
            here = tuple(slice(i, i + 1) if one == 1 else slice(None) for i, one in zip(at, own))
            listed = {name: v[here].reshape(-1, *v.shape[v.ndim - axes[name] :]) for name, v in given.items()}
            for name, table in one_pass(listed).items():
                if name in found:
                    part = found[name][here]
                    found[name][here] = np.nan if table is None else np.reshape(table, part.shape)
        return found

    def _differentiated(self) -> Derivative | BatchDerivative:
        if self._derivative is None:
            located = None if self._how.tol is None else True
            if isinstance(self._result, Result):
                self._derivative = self._result.derivative()
            else:
                self._derivative = self._result.derivative(located=located, threads=self._how.threads, failed=self._how.failed)
        return self._derivative

    def _of_solved(self, v: np.ndarray) -> np.ndarray:
        """Changes or weights; those of scenes that are not solved are not finite, and so their derivatives fail."""
        good = (self.status == 0).reshape(-1, *(1,) * (v.ndim - 1))
        return v if good.all() else np.where(good, v, np.nan)

    def _bars(self, of: dict[str, np.ndarray]) -> dict[str, np.ndarray | None]:
        if self._result is None:
            return {}
        refine, d = self._how.refine, self._differentiated()
        of = {name: self._of_solved(at_rows_only(v, refine)) for name, v in of.items()}
        if isinstance(d, Derivative):
            bars = d.vjp(**{name: v[0] for name, v in of.items()})._asdict()
        else:
            bars = d.vjp(**of)[0]._asdict()
        return {name: coarser(v, refine) if name in "fg" and v is not None else v for name, v in bars.items()}

    def _changes(self, of: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        if self._result is None:
            return {}
        refine, d = self._how.refine, self._differentiated()
        of = {name: self._of_solved(finer(v, refine) if name in "fg" else v) for name, v in of.items()}
        found = d.jvp(**{name: v[0] for name, v in of.items()}) if isinstance(d, Derivative) else d.jvp(**of)[0]
        return {name: v[..., ::refine, :] for name, v in found._asdict().items()}


def finer(v: np.ndarray, refine: int) -> np.ndarray:
    """From values at the rows (axis -2) to those at all time points, linear in between."""
    if refine == 1:
        return v
    share = np.arange(refine)[:, None] / refine
    lines = v[..., :-1, None, :] * (1 - share) + v[..., 1:, None, :] * share
    return np.concatenate([lines.reshape(*v.shape[:-2], -1, v.shape[-1]), v[..., -1:, :]], axis=-2)


def coarser(bar: np.ndarray, refine: int) -> np.ndarray:
    """The transpose of :func:`finer`, for gradients."""
    if refine == 1:
        return bar
    share = np.arange(refine)[:, None] / refine
    inside = bar[..., :-1, :].reshape(*bar.shape[:-2], -1, refine, bar.shape[-1])
    found = np.concatenate([(inside * (1 - share)).sum(-2), bar[..., -1:, :]], axis=-2)
    found[..., 1:, :] += (inside * share).sum(-2)
    return found


def at_rows_only(v: np.ndarray, refine: int) -> np.ndarray:
    """Weights at the rows as weights at all time points."""
    if refine == 1:
        return v
    found = np.zeros((*v.shape[:-2], (v.shape[-2] - 1) * refine + 1, v.shape[-1]))
    found[..., ::refine, :] = v
    return found


def whole(steps: Any, name: str = "steps") -> int:
    """A number of steps; Error for anything else."""
    if isinstance(steps, bool) or steps != int(steps):
        raise Error(f"{name}: found {steps}; give a whole number from 1 on", name)
    return int(steps)


def place(backend: Any, device: Any) -> str:
    """Where the wrappers compute: "cpu" or "cuda"."""
    if backend not in ("cpu", "cuda"):
        raise Error(f"backend: found {backend!r}; use cpu or cuda", "backend")
    if device is not None and backend == "cpu":
        raise Error(f"device: found {device} with backend='cpu'; leave it out, or use backend='cuda'", "device")
    return backend


def arrays(data: Iterable[Any], array: Callable[[Any], Any]) -> dict[str, Any]:
    """The data by name; None for f and g that are not given, or have no columns."""
    named = dict(zip(DATA, data))
    return {k: None if v is None or (k in "fg" and v.shape[-1] == 0) else array(v) for k, v in named.items()}


def require_real(name: str, is_complex: bool) -> None:
    if is_complex:
        raise Error(f"{name}: is complex; give real numbers", name)


def no_second_derivative(*_: Any) -> NoReturn:
    raise Error("derivative: of a derivative is not there; take differences of gradients", "derivative")


def _summed_to(bar: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    more = bar.ndim - len(shape)
    bar = bar.sum(axis=tuple(range(more)))
    return bar.sum(axis=tuple(i for i, k in enumerate(shape) if k == 1 and bar.shape[i] != 1), keepdims=True)


__all__ = ["AXES", "DATA", "STATUSES", "Error", "How", "NotSolved", "Shapes", "Solved", "arrays", "how", "leading",
           "no_second_derivative", "on_a_device", "place", "require_real", "whole"]
