"""Linear complementarity problems of their own, many at once, and their derivatives."""

from __future__ import annotations

import math
import warnings
from typing import Any, Literal, NamedTuple

import numpy as np

from . import _core
from ._arrays import Tridiagonal, lcp_matrix, on_host
from ._errors import Error, NotSolved, NotSolvedWarning
from ._machine import wanted
from ._solve import Check
from ._sparse import is_sparse

CLASSES = ("auto", "P", "Z", "PSD", "unknown")
#: Of max(y_i, w_i), scaled: below it neither is clearly positive, and the active set changes with the least change of q.
DEGENERATE = 1e-10

LcpClassWord = Literal["auto", "P", "Z", "PSD", "unknown"]


class LcpTangent(NamedTuple):
    """Changes of y and w."""

    y: np.ndarray
    w: np.ndarray


class LcpGradient(NamedTuple):
    """With respect to q and M, which has the shape of M as given, summed over the problems that share it."""

    q: np.ndarray
    M: np.ndarray


class LcpResult:
    """What :func:`lcp` returns. Arrays have the leading axes of the problems, none of them for one problem.

    Attributes:
        y, w: the solutions; NaN where there is none.
        status: words: ``"solved"``; ``"infeasible"``, proven; ``"unsolved"``: none was found and none is excluded;
            ``"nonfinite"``: M or q is.
        residual: max_i ``|min(y_i, w_i)| / (|q_i| + sum_j |M_ij| y_j)``, rows and columns of M scaled.
        margin: min_i max(y_i, w_i), scaled; near 0 for a degenerate problem, where y is not differentiable.
        iterations: active sets tried; of problems that were solved side by side their mean.
        lcp_class: the class of M, a word for each matrix.
    """

    def __init__(self, M: Any, leading: tuple[int, ...], own: bool, answer: tuple) -> None:
        y, w, status, residual, margin, iterations, classes = answer
        n = y.shape[-1]
        self._M, self._own, self._leading = M, own, leading
        self.y: np.ndarray = y.reshape(*leading, n)
        self.w: np.ndarray = w.reshape(*leading, n)
        self.status: Any = np.array(status, dtype="<U10").reshape(leading) if leading else status[0]
        self.residual: np.ndarray = residual.reshape(leading)
        self.margin: np.ndarray = margin.reshape(leading)
        self.iterations: np.ndarray = np.array(iterations, dtype=np.int64).reshape(leading)
        self.lcp_class: Any = np.array(classes, dtype="<U8").reshape(leading) if own and leading else classes[0] if classes else "P"

    @property
    def ok(self) -> np.ndarray:
        """Whether the status is ``solved``."""
        return np.asarray(self.status) == "solved"

    @property
    def active(self) -> np.ndarray:
        """Whether y_i > 0, in the shape of y."""
        return self.y > 0

    @property
    def degenerate(self) -> np.ndarray:
        """Whether some y_i and w_i are both zero to rounding."""
        return self.margin <= DEGENERATE

    def jvp(self, q: Any = None, M: Any = None) -> LcpTangent:
        """The changes of y and w that changes of q and M cause, with the active sets held: y_S = -M_SS^{-1} q_S. NaN where a
        problem is not solved, is degenerate, or has a singular M_SS.

        Args:
            q, M: changes, of the shapes of q and M, or with the leading axes of the problems; None: none.
        """
        each = self._each()
        dq = np.zeros_like(each.y) if q is None else self._listed(q, "q", 1)
        change = dq if M is None else dq + np.einsum("kij,kj->ki", self._listed(M, "M", 2), each.y)
        dy = each.solve(-each.S * change)
        dw = (1 - each.S) * (np.einsum("kij,kj->ki", each.M, dy) + change)
        return LcpTangent(*(each.masked(v).reshape(self.y.shape) for v in (dy, dw)))

    def vjp(self, y: Any = None, w: Any = None) -> LcpGradient:
        """The gradient of sum(y * result.y + w * result.w) with respect to q and M, with the active sets held. NaN as for
        :meth:`jvp`.

        Args:
            y, w: weights, of the shapes of the result; None: zero.
        """
        each = self._each()
        of_y, of_w = (np.zeros_like(each.y) if v is None else self._listed(v, name, 1) for v, name in ((y, "y"), (w, "w")))
        of_w = (1 - each.S) * of_w
        of_active = -each.solve(each.S * (of_y + np.einsum("kji,kj->ki", each.M, of_w)), transposed=True)
        of_q = each.masked(of_w + each.S * of_active)
        of_M = of_q[:, :, None] * np.where(np.isfinite(each.y), each.y, 0.0)[:, None, :]
        q = of_q.reshape(self.y.shape)
        return LcpGradient(q, of_M.reshape(*self._leading, *of_M.shape[1:]) if self._own else of_M.sum(axis=0))

    def _each(self) -> _Held:
        n = self.y.shape[-1]
        M = self._M
        if isinstance(M, Tridiagonal):
            M = np.diag(M.diagonal) + np.diag(M.lower[1:], -1) + np.diag(M.upper[:-1], 1)
        elif isinstance(M, tuple):
            rows, cols, values, row, start = M
            dense = np.zeros((rows, cols))
            dense[row, np.repeat(np.arange(cols), np.diff(start))] = values
            M = dense
        y = self.y.reshape(math.prod(self._leading), n)
        good = self.ok.ravel() & ~np.ravel(self.degenerate)
        return _Held(np.broadcast_to(M, (y.shape[0], n, n)), y, good)

    def _listed(self, v: Any, name: str, axes: int) -> np.ndarray:
        n = self.y.shape[-1]
        array, shape = on_host(v, name), (*self._leading, *(n,) * axes)
        try:
            return np.broadcast_to(array, shape).reshape(math.prod(self._leading), *shape[len(self._leading) :])
        except ValueError:
            raise Error(f"{name}: has shape {array.shape}; give {shape}", name) from None

    def __repr__(self) -> str:
        return f"<bromwich.LcpResult {int(np.sum(self.ok))} of {self.ok.size} problems of {self.y.shape[-1]} unknowns solved>"


class _Held:
    """Problems with their active sets held: K x n x n and K x n."""

    def __init__(self, M: np.ndarray, y: np.ndarray, good: np.ndarray) -> None:
        self.M, self.y, self._good = M, np.where(good[:, None], y, 0.0), good
        self.S = (self.y > 0).astype(float)

    def solve(self, right: np.ndarray, transposed: bool = False) -> np.ndarray:
        """Of M_SS on the active set, and the identity beside it. Singular ones are left out from then on."""
        K = self.S[:, :, None] * self.M * self.S[:, None, :] + np.eye(self.M.shape[-1]) * (1 - self.S)[:, :, None]
        K = np.swapaxes(K, 1, 2) if transposed else K
        try:
            found = np.linalg.solve(K, right[:, :, None])[:, :, 0]
        except np.linalg.LinAlgError:
            found = np.full_like(right, np.nan)
            for k in range(len(right)):
                try:
                    found[k] = np.linalg.solve(K[k], right[k])
                except np.linalg.LinAlgError:
                    self._good = self._good & (np.arange(len(right)) != k)
        return found

    def masked(self, v: np.ndarray) -> np.ndarray:
        return np.where(self._good[:, None], v, np.nan)


def lcp(
    M: Any,
    q: Any,
    *,
    lcp_class: LcpClassWord = "auto",
    y0: Any = None,
    backend: Literal["cpu", "cuda"] = "cpu",
    device: int | None = None,
    threads: int = 0,
    check: Check = "warn",
) -> LcpResult:
    """Solves linear complementarity problems, many at once::

        0 <= y  ⊥  w = M y + q >= 0.

    Args:
        M: n x n, shared by all problems: an array, a matrix of scipy.sparse, or a :class:`Tridiagonal`; or an array with
            leading axes, a matrix for each problem.
        q: n values, or with leading axes, as those of M.
        lcp_class: which solution is meant. ``"P"``: there is only one. ``"Z"``: the least, y <= every other one. ``"PSD"``: the
            one of least norm. ``"unknown"``: any, certified by its residual, by Lemke's method where active sets fail.
            ``"auto"``: M is tested (of a matrix of each problem, above n = 8, the exact test of P is left out).
        y0: of the shape of q, where each problem starts: its active set is {y0 > 0}.
        backend: ``"cuda"``: problems that share M are solved side by side on a device; what it leaves, and a matrix of each
            problem, is solved on the host, and arrays come back to the host.
        device, threads: as :func:`solve` takes them.
        check: what happens where a problem is not solved: ``"warn"``, True (raises) or False.

    Returns:
        An :class:`LcpResult`, with ``jvp`` and ``vjp``. ``bromwich.jax.lcp`` and ``bromwich.torch.lcp`` are differentiated by
        those libraries.

    Raises:
        Error: shapes that do not fit, a shared M that is not finite or not of the stated class.
        NotSolved: with ``check=True``.

    Example:
        >>> lcp([[2, 1], [1, 2]], [[-1.0, 1.0], [-3.0, -3.0]]).y
        array([[0.5, 0. ],
               [1. , 1. ]])
    """
    if lcp_class not in CLASSES:
        raise Error(f"lcp_class: found {lcp_class!r}; use {', '.join(CLASSES)}", "lcp_class")
    if backend not in ("cpu", "cuda"):
        raise Error(f"backend: found {backend!r}; use cpu or cuda", "backend")
    right = on_host(q, "q")
    if right.ndim == 0:
        raise Error("q: is a number; give an array, the unknowns of a problem last", "q")
    matrix, n = _matrix(M, right.shape[-1])
    if right.shape[-1] != n:
        raise Error(f"q: has {right.shape[-1]} values for each problem; give {n}, as M has rows", "q")
    own = isinstance(matrix, np.ndarray) and matrix.ndim > 2
    leading = right.shape[:-1]
    if own:
        try:
            leading = np.broadcast_shapes(leading, matrix.shape[:-2])
        except ValueError:
            raise Error(f"M: has the leading axes {matrix.shape[:-2]}, and q has {leading}; give the same", "M") from None
    rows = _rows(right, "q", leading, n)
    start = None if y0 is None else _rows(on_host(y0, "y0"), "y0", leading, n)
    on = wanted(backend, device, threads)
    if own:
        matrix = np.ascontiguousarray(np.broadcast_to(matrix, (*leading, n, n)).reshape(math.prod(leading), n, n))
        answer = _core.lcp_own(matrix, rows, lcp_class, start, on)
    elif isinstance(matrix, Tridiagonal):
        answer = _core.lcp_tridiagonal(matrix.lower, matrix.diagonal, matrix.upper, rows, lcp_class, start, on)
    elif isinstance(matrix, tuple):
        answer = _core.lcp_sparse(matrix, rows, lcp_class, start, on)
    else:
        answer = _core.lcp_dense(matrix, rows, lcp_class, start, on)
    result = LcpResult(matrix, leading, own, answer)
    wrong = ~np.ravel(result.ok)
    if check and wrong.any():
        k = int(np.argmax(wrong))
        message = f"{wrong.sum()} of {wrong.size} problems are not solved; problem {k}: {np.ravel(result.status)[k]}"
        if check is True:
            raise NotSolved(f"status: {message}", result)
        warnings.warn(message, NotSolvedWarning, stacklevel=2)
    return result


def _matrix(M: Any, n: int) -> tuple[np.ndarray | Tridiagonal | tuple, int]:
    if isinstance(M, Tridiagonal):
        return M, M.diagonal.size
    if not is_sparse(M):
        array = on_host(M, "M")
        if array.ndim < 2:
            raise Error(f"M: has {array.ndim} axes; give an n x n matrix, or more axes for a matrix of each problem", "M")
        if array.shape[-1] != array.shape[-2]:
            raise Error(f"M: is {array.shape[-2]} x {array.shape[-1]}; make it square", "M")
        if array.ndim > 2:
            return array, array.shape[-1]
    elif M.shape[0] != M.shape[1]:
        raise Error(f"M: is {M.shape[0]} x {M.shape[1]}; make it square", "M")
    return lcp_matrix(M, M.shape[0] if is_sparse(M) else array.shape[0]), M.shape[0] if is_sparse(M) else array.shape[0]


def _rows(v: np.ndarray, name: str, leading: tuple[int, ...], n: int) -> np.ndarray:
    try:
        return np.ascontiguousarray(np.broadcast_to(v, (*leading, n)).reshape(math.prod(leading), n))
    except ValueError:
        raise Error(f"{name}: has shape {v.shape}; give {(*leading, n)}", name) from None
