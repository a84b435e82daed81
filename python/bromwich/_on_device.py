"""Shared by the wrappers for JAX and PyTorch: solves of small scenes whose tables stay on a CUDA device, and their
gradients."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from . import _core
from ._array_solver import borrowed
from ._differentiable import AXES, DATA, Shapes, leading
from ._errors import Error, NotSolved
from ._machine import wanted
from ._scene import Scene
from ._solve import _options

#: Of x0, f and g each scene may have its own; the others are shared by all scenes.
OWN = ("x0", "f", "g")


class Library(NamedTuple):
    """What is asked of a library of arrays."""

    spread: Callable[[Any, tuple[int, ...]], Any]  #: an array with leading axes of these lengths, float64
    shaped: Callable[[Any, tuple[int, ...]], Any]  #: the same numbers, contiguous
    take: Callable[[Any], Any]  #: from DLPack
    put: Callable[[np.ndarray, Any], Any]  #: from the host, where the other array is
    total: Callable[[Any, tuple[int, ...], bool], Any]  #: a sum over axes; whether they stay, with length 1
    on_host: Callable[[Any], np.ndarray]


class SharedTable:
    """A table in the memory of a backend, as DLPack knows it."""

    def __init__(self, table: _core.SharedTable) -> None:
        self._table = table

    def __dlpack__(self, *, stream: Any = None, **_: Any) -> Any:
        """`stream` is ignored: the numbers are complete."""
        return self._table.capsule()

    def __dlpack_device__(self) -> tuple[int, int]:
        return self._table.place


class SolvedOnDevice:
    """As :class:`Solved`, with arrays of a library. Tables of the size of the time points do not pass through the host;
    A, B, N and M do, and gradients with respect to them."""

    def __init__(
        self,
        library: Library,
        arrays: dict[str, Any],
        T: float,
        steps: int,
        method: str,
        threads: int,
        device: int | None,
    ) -> None:
        if method != "march":
            raise Error(f"method: found '{method}' on a device; use march, or backend='cpu'", "method")
        self._library, self._rows = library, steps + 1
        self._shapes = {name: None if v is None else tuple(v.shape) for name, v in arrays.items()}
        self._leading = leading(self._shapes)
        self._like = arrays["x0"]
        matrices = {name: self._of_all(name, arrays[name]) for name in ("A", "B", "N", "M")}
        self._m, self._n = matrices["B"].shape
        for name in ("f", "g"):
            rows = steps + 1 if arrays.get(name) is None else arrays[name].shape[-2]
            if rows != steps + 1:
                raise Error(f"{name}: has {rows} rows; give {steps + 1}, one for each time point", name)
        self._count = math.prod(self._leading)
        if self._count == 0:
            raise Error("leading axes: have length 0; give at least one scene, or use backend='cpu'", "leading axes")
        scene = Scene(**matrices, x0=np.zeros(self._m), T=T, steps=steps)
        options = _options(scene, method="march", steps=steps, states=None)
        self._prepared = _core.PreparedScenes(scene._model, options, wanted("cuda", device, threads), self._count)
        tables = [self._table(name, arrays.get(name)) for name in OWN]
        for k, reason in enumerate(self._prepared.solve(*tables)):
            if reason:
                raise NotSolved(f"scene {k}: {reason}", None)

    def _of_all(self, name: str, v: Any) -> np.ndarray:
        """On the host, without leading axes."""
        one = tuple(v.shape)[len(v.shape) - AXES[name] :]
        if math.prod(v.shape) != math.prod(one):
            raise Error(f"{name}: has leading axes, and scenes on a device share A, B, N and M; use backend='cpu'", name)
        return np.asarray(self._library.on_host(v), dtype=np.float64).reshape(one)

    def _table(self, name: str, v: Any) -> Any:
        """For the compiled part: two axes, rows of all scenes under each other, or those that they share."""
        if v is None:
            return None
        one = tuple(v.shape)[len(v.shape) - AXES.get(name, 2) :]
        rows = 1 if name == "x0" else one[0]
        shared = math.prod(v.shape) == math.prod(one)
        found = v if shared else self._library.spread(v, (*self._leading, *one))
        found = self._library.shaped(found, (rows if shared else self._count * rows, one[-1]))
        return borrowed(found, name, self._prepared.place)

    def outputs(self) -> tuple[Any, Any, Any]:
        """y, x and w: leading axes, J+1, and n, m, n."""
        take, shaped = self._library.take, self._library.shaped
        widths = (("y", self._n), ("x", self._m), ("w", self._n))
        return tuple(
            shaped(take(SharedTable(self._prepared.table(name))), (*self._leading, self._rows, k)) for name, k in widths
        )

    def gradient(self, of: tuple[Any, ...], shapes: Shapes | None = None, mapped: Sequence[bool] = ()) -> list[Any]:
        """As that of :class:`Solved`, for weights with the leading axes of the outputs."""
        every = tuple(np.broadcast_shapes(self._leading, *(tuple(v.shape)[:-2] for v in of)))
        if every != self._leading or not all(mapped):
            raise Error(
                "weights: have axes that the scenes do not have; take one gradient at a time, or use backend='cpu'",
                "weights",
            )
        reasons, *found = self._prepared.vjp(*(self._table(name, v) for name, v in zip("yxw", of)))
        for k, reason in enumerate(reasons):
            if reason:
                raise Error(f"scene {k}: {reason}", "derivative")
        bars = dict(zip(("x0", "f", "g", "A", "B", "N", "M"), found))
        return [
            None if self._shapes[name] is None else self._bar(name, bars[name], shape)
            for name, shape in zip(DATA, shapes or (None,) * len(DATA))
        ]

    def _bar(self, name: str, bar: Any, shape: tuple[int, ...] | None) -> Any:
        """Leading axes and those of one scene, summed to the shape; None: all of them."""
        rows, m, n = self._rows, self._m, self._n
        one = {"x0": (m,), "f": (rows, m), "g": (rows, n), "A": (m, m), "B": (m, n), "N": (n, m), "M": (n, n)}[name]
        whole = (*self._leading, *one)
        if name in OWN:
            found = self._library.shaped(self._library.take(SharedTable(bar)), whole)
            return found if shape is None else _summed(found, shape, self._library.total)
        found = bar.reshape(whole)
        if shape is not None:
            found = _summed(found, shape, lambda v, axes, keep: v.sum(axis=axes, keepdims=keep))
        return self._library.put(np.ascontiguousarray(found), self._like)


def _summed(bar: Any, shape: tuple[int, ...], total: Callable[[Any, tuple[int, ...], bool], Any]) -> Any:
    more = bar.ndim - len(shape)
    if more:
        bar = total(bar, tuple(range(more)), False)
    ones = tuple(i for i, k in enumerate(shape) if k == 1 and bar.shape[i] != 1)
    return total(bar, ones, True) if ones else bar


__all__ = ["Library", "SharedTable", "SolvedOnDevice"]
