"""Shared by the wrappers for JAX and PyTorch: a solve of arrays, with or without leading axes, and its gradient."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Optional

import numpy as np

from ._batch import BatchResult, solve_batch
from ._derivative import BatchDerivative, Derivative
from ._errors import Error, NotSolved
from ._result import Result
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


class Solved:
    """A solution of one scene, or of scenes over leading axes. Data without these axes, or of length 1, are shared."""

    def __init__(self, arrays: dict[str, np.ndarray | None], T: float, steps: int, method: str, threads: int) -> None:
        given = {name: np.asarray(v, dtype=np.float64) for name, v in arrays.items() if v is not None}
        self._shapes = {name: None if v is None else np.shape(v) for name, v in arrays.items()}
        self._leading = leading(self._shapes)
        for name in ("f", "g"):
            rows = given[name].shape[-2] if name in given else steps + 1
            if rows != steps + 1:
                raise Error(f"{name}: has {rows} rows; give {steps + 1}, one for each time point", name)
        self._threads = threads
        how: dict[str, Any] = dict(T=T, steps=steps, method=method, threads=threads, states="all", check=True, backend="cpu")
        count = math.prod(self._leading)
        self._result: Result | BatchResult | None = None
        self._derivative: Derivative | BatchDerivative | None = None
        if not self._leading:
            self._result = solve(**given, **how)
        elif count > 0:
            self._result = solve_batch(**{name: self._listed(name, v, count) for name, v in given.items()}, **how)
        self._sizes = steps + 1, given["B"].shape[-1], given["x0"].shape[-1]

    def _listed(self, name: str, v: np.ndarray, count: int) -> np.ndarray:
        one = v.shape[v.ndim - AXES[name] :]
        if v.size == math.prod(one):
            # The batch takes the number of scenes from x0, which is therefore repeated.
            return np.broadcast_to(v.reshape(one), (count, *one)) if name == "x0" else v.reshape(one)
        return np.broadcast_to(v, (*self._leading, *one)).reshape(count, *one)

    def outputs(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """y, x and w, arrays of their own: leading axes, J+1, and n, m, n."""
        rows, n, m = self._sizes
        if self._result is None:
            y, x, w = (np.zeros((*self._leading, rows, k)) for k in (n, m, n))
        else:
            y, x, w = (np.array(v).reshape(*self._leading, rows, -1) for v in (self._result.y, self._result.x, self._result.w))
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
        of = tuple(np.asarray(v, dtype=np.float64) for v in of)
        mine = iter(self._leading)
        own = (*(next(mine) if has else 1 for has in mapped), *mine)
        every = np.broadcast_shapes(own, *(v.shape[:-2] for v in of))
        own = (1,) * (len(every) - len(own)) + own
        of = tuple(np.broadcast_to(v, (*every, *v.shape[-2:])) for v in of)
        bars = {name: np.zeros((*every, *s[len(s) - AXES[name] :])) for name, s in self._shapes.items() if s is not None}
        # One pass for each index of the axes that the weights have and the scenes do not.
        for at in np.ndindex(*(k if one == 1 else 1 for k, one in zip(every, own))):
            here = tuple(slice(i, i + 1) if one == 1 else slice(None) for i, one in zip(at, own))
            for name, bar in self._bars([v[here] for v in of]).items():
                if name in bars:
                    part = bars[name][here]
                    bars[name][here] = np.nan if bar is None else np.reshape(bar, part.shape)
        if shapes is None:
            return [bars.get(name) for name in DATA]
        return [None if s is None else _summed_to(bars[name], s) for name, s in zip(DATA, shapes)]

    def _bars(self, of: list[np.ndarray]) -> dict[str, np.ndarray | None]:
        if self._result is None:
            return {}
        if self._derivative is None:
            single = isinstance(self._result, Result)
            self._derivative = self._result.derivative() if single else self._result.derivative(threads=self._threads)
        if isinstance(self._derivative, Derivative):
            y, x, w = (v.reshape(v.shape[-2:]) for v in of)
            return self._derivative.vjp(y=y, x=x, w=w)._asdict()
        y, x, w = (v.reshape(-1, *v.shape[-2:]) for v in of)
        bars, reasons = self._derivative.vjp(y=y, x=x, w=w)
        for k, reason in enumerate(reasons):
            if reason:
                raise Error(f"scene {k}: {reason}", "derivative")
        return bars._asdict()


def whole(steps: Any) -> int:
    """A number of steps; Error for anything else."""
    if isinstance(steps, bool) or steps != int(steps):
        raise Error(f"steps: found {steps}; give a whole number from 1 on", "steps")
    return int(steps)


def place(backend: Any, device: Any) -> str:
    """Where the wrappers compute: "cpu" or "cuda"."""
    if backend not in ("cpu", "cuda"):
        raise Error(f"backend: found {backend!r}; use cpu or cuda", "backend")
    if device is not None and backend == "cpu":
        raise Error(f"device: found {device} with backend='cpu'; leave it out, or use backend='cuda'", "device")
    return backend


def _summed_to(bar: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    more = bar.ndim - len(shape)
    bar = bar.sum(axis=tuple(range(more)))
    return bar.sum(axis=tuple(i for i, k in enumerate(shape) if k == 1 and bar.shape[i] != 1), keepdims=True)


__all__ = ["AXES", "DATA", "Error", "NotSolved", "Shapes", "Solved", "leading", "place", "whole"]
