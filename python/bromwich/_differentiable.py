"""What the wrappers for JAX and PyTorch have in common: a solve of arrays, and its gradient."""

from __future__ import annotations

from typing import Any

import numpy as np

from ._derivative import Derivative
from ._errors import NotSolved
from ._result import Result
from ._solve import solve

#: The data of a solve, in the order of :class:`Gradient`.
DATA = ("x0", "f", "g", "A", "B", "N", "M")


def solved(arrays: dict[str, np.ndarray | None], T: float, steps: int, method: str, threads: int) -> Result:
    """A solve of arrays with float64; raises NotSolved where it has no solution."""
    given = {name: np.asarray(v, dtype=np.float64) for name, v in arrays.items() if v is not None}
    return solve(**given, T=T, steps=steps, method=method, threads=threads, states="all", check=True, backend="cpu")


def outputs(result: Result) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """y, x and w, arrays of their own."""
    return np.array(result.y), np.array(result.x), np.array(result.w)


def gradient(derivative: Derivative, shapes: dict[str, Any], of: tuple[np.ndarray, ...]) -> list[np.ndarray | None]:
    """The gradient in the order of DATA, each in the shape of its data; None where there were no data. NaN for M where
    there is no derivative with respect to it (:attr:`Derivative.without_M`)."""
    y, x, w = (np.asarray(v, dtype=np.float64) for v in of)
    bar = derivative.vjp(y=y, x=x, w=w)._asdict()
    if bar["M"] is None and shapes["M"] is not None:
        bar["M"] = np.full(shapes["M"], np.nan)
    return [None if shapes[name] is None else np.array(bar[name]).reshape(shapes[name]) for name in DATA]


__all__ = ["DATA", "NotSolved", "gradient", "outputs", "solved"]
