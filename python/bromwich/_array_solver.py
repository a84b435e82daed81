"""Solves whose sources and results stay where they are: on the host or on a CUDA device, handed over by DLPack."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from . import _core
from ._arrays import filled
from ._errors import Error, Interrupted, NotSolved, NotSolvedWarning
from ._machine import wanted
from ._progress import reporting
from ._rows import Status
from ._scene import Scene
from ._solve import Check, Progress, _options


class SharedArray:
    """A read-only result in the memory of a backend, float64, row by row. It is taken without a copy by
    ``numpy.from_dlpack`` on the host and by ``torch.from_dlpack``, ``jax.numpy.from_dlpack``, ``cupy.from_dlpack`` on a
    CUDA device; ``numpy.asarray`` copies what lies on a device."""

    def __init__(
        self, answer: _core.SharedAnswer | _core.BatchAnswer, name: str, shape: tuple[int, ...] | None = None
    ) -> None:
        self._answer, self._name = answer, name
        self.shape: tuple[int, ...] = answer.shape if shape is None else shape
        self.dtype = np.dtype(np.float64)
        if answer.place[0] == 2:  # for libraries without DLPack, such as Numba
            self.__cuda_array_interface__ = {
                "shape": self.shape,
                "typestr": "<f8",
                "data": (answer.address(name), True),
                "version": 3,
                "strides": None,
                "stream": None,
            }

    def __dlpack__(self, *, stream: Any = None, **_: Any) -> Any:
        """`stream` is ignored: the values are complete when the solve has returned."""
        return self._answer.capsule(self._name)

    def __dlpack_device__(self) -> tuple[int, int]:
        return self._answer.place

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        if self._answer.place[0] == 1:
            found = np.from_dlpack(self)
            return found.astype(dtype) if copy or (dtype is not None and dtype != found.dtype) else found
        if copy is False:
            raise ValueError("the array lies on a device: it cannot be had without a copy")
        found = np.frombuffer(_core.to_host(self.__dlpack__()), dtype=np.float64).reshape(self.shape)
        return found.astype(dtype) if dtype is not None else found

    def __repr__(self) -> str:
        where = "the host" if self._answer.place[0] == 1 else f"CUDA device {self._answer.place[1]}"
        return f"SharedArray({self._name}, shape={self.shape}, on {where})"


class ArrayResult:
    """What :meth:`ArraySolver.solve` returns.

    Attributes:
        status, reason: as in :class:`Result`.
        t: J+1 times, on the host.
        y, w: (J+1) x n, :class:`SharedArray`. Where the status is not ``solved`` they are the last iterate.
        residual: max over time of ||min(y, w)|| / max(1, ||N x + g||), maximum norms.
        iterations, history: sweeps, and the largest change of y of each, relative to max(1, |y|).
        infeasible_at: a time, or None.
        backend, method, kernel, kernel_error, seconds: as in :class:`Result`; seconds is the total.
    """

    def __init__(self, answer: _core.SharedAnswer) -> None:
        facts = answer.facts
        self.status = Status(facts["status"])
        self.reason: str = facts["reason"]
        self.t: np.ndarray = answer.t
        self.y, self.w = SharedArray(answer, "y"), SharedArray(answer, "w")
        self.residual: float = facts["residual"]
        self.iterations: int = facts["iterations"]
        self.history: list[float] = facts["history"]
        self.infeasible_at: float | None = facts["infeasible_at"]
        self.backend: str = facts["backend"]
        self.method: str = facts["method"]
        self.kernel: str = facts["kernel"]
        self.kernel_error: float = facts["kernel_error"]
        self.seconds: float = facts["seconds"]

    def __repr__(self) -> str:
        return f"ArrayResult({self.status}, y {self.y.shape}, {self.iterations} iterations, residual {self.residual:.1e})"


class ArraySolver:
    """One scene, solved many times with f and g as arrays on the host or on a CUDA device, where they are read without a copy.

    Method ``contour`` on one grid: nothing of size J x n passes through the host. The solver works in the units of the
    scene, and its results are not looked at again with half the step, as those of :func:`solve` may be.

    Args:
        scene: a :class:`Scene` with initial values; its f and g are not used.
        backend: ``"cpu"`` for arrays of the host, ``"cuda"`` for those of a CUDA device.
        device: number of the CUDA device; None: the first one.
        threads: of the host; 0: all cores.
        steps: None: those of the scene, or 400.
        iteration_tol, max_iterations: as in :func:`solve`.

    Raises:
        Error: for boundary values, free rows, and scenes without a kernel for the functional iteration, where y jumps.

    Example:
        >>> solver = ArraySolver(scene("signorini", Q=127), steps=400, backend="cuda")
        >>> r = solver.solve(g=cupy.asarray(g))  # or a tensor of PyTorch, an array of JAX
        >>> y = cupy.from_dlpack(r.y)
    """

    def __init__(
        self,
        scene: Scene,
        *,
        backend: str = "cpu",
        device: int | None = None,
        threads: int = 0,
        steps: int | None = None,
        iteration_tol: float | None = None,
        max_iterations: int | None = None,
    ) -> None:
        if not isinstance(scene, Scene):
            raise Error(f"scene: is a {type(scene).__name__}; give a bromwich.Scene", "scene")
        options = _options(
            scene,
            method="contour",
            steps=steps,
            iteration_tol=iteration_tol,
            max_iterations=max_iterations,
            states="none",
            one_grid=True,
        )
        self._scene, self._iteration_tolerance = scene, options.iteration_tolerance
        self._prepared = _core.PreparedArrays(scene._model, options, wanted(backend, device, threads))

    @property
    def device(self) -> tuple[int, int]:
        """As ``__dlpack_device__`` returns it: (1, 0) for the host, (2, number) for a CUDA device."""
        return self._prepared.place[:2]

    def set_x0(self, x0: Any) -> None:
        """The state at t = 0, m values of any library; they are read on the host."""
        self._prepared.set_x0(filled(x0, self._scene.states, "x0"))

    def solve(
        self,
        g: Any = None,
        f: Any = None,
        *,
        progress: Progress | bool | None = None,
        stop: Callable[[], bool] | None = None,
        check: Check = "warn",
    ) -> ArrayResult:
        """With sources that have values at t_j = j T/J and are linear in between.

        Args:
            g: (J+1) x n, float64, row by row, an array of any library on the device of the solver; None: as before, at
                first zero.
            f: the same for phi, with f = B phi.
            progress, stop, check: as in :func:`bromwich.solve`.

        Raises:
            Error: for another shape, type or device.
        """
        tables = [borrowed(table, name, self._prepared.place) for table, name in ((g, "g"), (f, "f"))]
        with reporting(progress, self._iteration_tolerance) as report:
            answer = self._prepared.solve(*tables, report, stop)
        result = ArrayResult(answer)
        return _checked(result, answer.facts["by_keyboard"], check, stop)



def borrowed(table: Any, name: str, place: tuple[int, int, int]) -> Any:
    """A table for the compiled part: a view, or a capsule that is ready on the stream of this place; None as it is."""
    if table is None:
        return None
    kind, number, stream = place
    where = table.__dlpack_device__() if hasattr(table, "__dlpack_device__") else (1, 0)
    if kind != 2 and where[0] in (1, 3):
        return np.ascontiguousarray(np.asarray(table), dtype=np.float64)
    where = tuple(int(part) for part in where)
    if where != (kind, number):
        found = "the host" if where[0] == 1 else f"device {where}"
        raise Error(f"{name}: lies on {found}; give an array on device {(kind, number)}, or use its device", name)
    if str(getattr(table, "dtype", "float64")).removeprefix("torch.") != "float64":
        raise Error(f"{name}: is of {table.dtype}; give float64", name)
    try:
        return table.__dlpack__(stream=stream)
    except (TypeError, ValueError, RuntimeError, BufferError) as error:
        raise Error(f"{name}: cannot be read through DLPack ({error})", name) from error


def _checked(result: ArrayResult, by_keyboard: bool, check: Check, stop: Callable[[], bool] | None) -> ArrayResult:
    if result.status is Status.solved:
        return result
    if by_keyboard:
        raise Interrupted(result.reason, result)
    if check is True:
        raise NotSolved(f"status: {result.status}: {result.reason}", result)
    if check and not (stop is not None and result.status is Status.interrupted):
        warnings.warn(f"{result.status}: {result.reason}", NotSolvedWarning, stacklevel=3)
    return result
