"""What users hand over, as the arrays that the compiled part takes: float64, C-contiguous, on the host."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from . import _core
from ._errors import Error
from ._sparse import checked, is_sparse

# Rows from which a dense M that is tridiagonal is kept as three diagonals.
SMALLEST_TRIDIAGONAL = 17
# A sparse M stays sparse with at least so many rows and less than this share of nonzero entries.
SMALLEST_SPARSE = 257
LARGEST_DENSITY = 0.1


class Tridiagonal:
    """A tridiagonal n x n matrix M by its diagonals.

    Args:
        lower: n values, ``lower[i] = M[i, i-1]``; ``lower[0]`` is not used. Or a number.
        diagonal: n values.
        upper: n values, ``upper[i] = M[i, i+1]``; ``upper[n-1]`` is not used. Or a number.
    """

    def __init__(self, lower: Any, diagonal: Any, upper: Any) -> None:
        self.diagonal = vector(diagonal, "M.diagonal")
        n = self.diagonal.size
        self.lower, self.upper = (
            np.full(n, float(d)) if np.ndim(d) == 0 else vector(d, name)
            for d, name in ((lower, "M.lower"), (upper, "M.upper"))
        )


def number(value: Any, name: str) -> float:
    """A real number, as a float. The caller judges NaN and infinity."""
    try:
        if isinstance(value, (str, bytes)):
            raise TypeError
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise Error(f"{name}: found {_shortly(value)}; give a number", name) from None


def whole(value: Any, name: str, least: int | None = None) -> int:
    """A whole number that 64 bits hold; 1e6 is one."""
    found = number(value, name)
    if not (found.is_integer() and abs(found) < 2.0**63 and (least is None or found >= least)):
        kind = "a whole number" if least is None else f"a whole number from {least} on"
        raise Error(f"{name}: found {_shortly(value)}; give {kind}", name)
    return int(value)


def whole_number(value: Any, name: str) -> int:
    """1, 2, ..."""
    return whole(value, name, 1)


def listed(values: Any, name: str) -> list[Any]:
    """The items of an iterable."""
    try:
        return list(values)
    except TypeError:
        raise Error(f"{name}: found {_shortly(values)}; give a list", name) from None


def word(value: Any, name: str) -> str:
    if not isinstance(value, str) or not value.isprintable():
        raise Error(f"{name}: found {_shortly(value)}; give a word in quotes", name)
    return value


def _shortly(value: Any) -> str:
    words = " ".join(repr(value).split())
    return words if len(words) <= 60 else words[:57] + "..."


# Device types of DLPack: the processor, and device memory that the processor can read.
READABLE = frozenset({1, 3, 11, 13})
CUDA = 2


def on_host(a: Any, name: str) -> np.ndarray:
    """NumPy's view of an array of any library, through DLPack if it has that. An array on a device is copied."""
    found = a
    if not (isinstance(a, (np.ndarray, Sequence, int, float)) or np.isscalar(a)):
        where = a.__dlpack_device__()[0] if hasattr(a, "__dlpack_device__") else 1
        if where not in READABLE or (where == 1 and hasattr(a, "__cuda_array_interface__")):
            found = from_device(a, name)
        elif hasattr(a, "__dlpack__") and not hasattr(a, "__array__"):
            found = _through_dlpack(a, name)
    if np.ma.is_masked(found):
        raise Error(f"{name}: has masked entries; fill them, as with .filled(0)", name)
    if hasattr(found, "matvec"):
        raise Error(f"{name}: is an operator; give a matrix, or bromwich.Dynamics with solves of (zI - A) X = R", name)
    try:
        array = np.asarray(found)
        if np.iscomplexobj(array):
            raise Error(f"{name}: is complex; give real values", name)
        if array.dtype.kind not in "biufO":
            raise Error(f"{name}: is an array of {array.dtype}; give numbers", name)
        return np.ascontiguousarray(array, dtype=np.float64) if array.ndim else array.astype(np.float64)
    except Error:
        raise
    except (TypeError, ValueError, OverflowError, RuntimeError, BufferError) as error:  # what libraries say of theirs
        raise Error(f"{name}: is no array of numbers ({error}); give nested lists or an array", name) from error


def from_device(a: Any, name: str) -> np.ndarray:
    """A copy of an array on a CUDA device."""
    why = "bromwich cannot read it there" if a.__dlpack_device__()[0] != CUDA else _core.cuda_missing()
    if not why and not _core.cuda_devices():
        why = "no CUDA device is found"
    if why:
        raise Error(f"{name}: is an array on a device ({why}); copy it to the host first", name)
    try:
        found = _core.to_host(a.__dlpack__(stream=_core.stream_of_copies()))
        kind = np.dtype(str(a.dtype).removeprefix("torch."))
        return np.frombuffer(found, dtype=kind).reshape(tuple(a.shape))
    except (TypeError, ValueError, RuntimeError, BufferError) as error:
        raise Error(f"{name}: is an array on a device and cannot be read ({error}); make it contiguous", name) from error


def _through_dlpack(a: Any, name: str) -> np.ndarray:
    try:
        return np.from_dlpack(a)
    except (TypeError, ValueError, RuntimeError, BufferError) as error:
        raise Error(f"{name}: cannot be read through DLPack ({error}); give a NumPy array", name) from error


def vector(a: Any, name: str) -> np.ndarray:
    """One dimension; a number is one value."""
    array = on_host(a, name)
    if array.ndim == 2 and 1 in array.shape:
        array = array.ravel()
    if array.ndim > 1:
        raise Error(f"{name}: has {array.ndim} dimensions; give one", name)
    return np.atleast_1d(array)


def filled(a: Any, size: int, name: str) -> np.ndarray:
    """One dimension; a number is that for all of ``size``."""
    array = on_host(a, name)
    return np.full(size, float(array)) if array.ndim == 0 else vector(array, name)


def of_other_library(a: Any) -> bool:
    """Whether it is an array of another library than NumPy."""
    return hasattr(a, "__dlpack__") and not isinstance(a, np.ndarray)


def matrix(a: Any, name: str, column: bool = False) -> np.ndarray:
    """Two dimensions; a number is 1 x 1, one dimension a row, or a column."""
    if is_sparse(a):
        a = checked(a, name).toarray()
    array = on_host(a, name)
    if array.ndim > 2:
        raise Error(f"{name}: has {array.ndim} dimensions; give two", name)
    if array.ndim == 1 and column:
        return array.reshape(-1, 1)
    return np.atleast_2d(array)


def multiple(a: Any, size: int, name: str) -> np.ndarray:
    """A square matrix; a number is that multiple of the identity."""
    if is_sparse(a):
        return matrix(a, name)
    array = on_host(a, name)
    return float(array) * np.eye(size) if array.ndim == 0 else matrix(array, name)


def compressed(a: Any, name: str, column: bool = False) -> tuple:
    """Rows, columns, values, row indices and starts of columns."""
    if not is_sparse(a):
        dense = matrix(a, name, column)
        cols, rows = np.nonzero(dense.T)
        starts = np.concatenate([[0], np.cumsum(np.bincount(cols, minlength=dense.shape[1]))])
        return (*dense.shape, dense[rows, cols], rows.astype(np.int32), starts.astype(np.int32))
    if a.ndim != 2:
        raise Error(f"{name}: has {a.ndim} dimensions; give two", name)
    csc = checked(a, name).tocsc(copy=True)
    csc.sum_duplicates()
    largest = np.iinfo(np.int32).max
    if max(csc.nnz, *csc.shape) > largest:
        raise Error(f"{name}: is {csc.shape[0]} x {csc.shape[1]} with {csc.nnz} entries; at most {largest} of each are possible", name)
    return (*csc.shape, on_host(csc.data, name), csc.indices.astype(np.int32), csc.indptr.astype(np.int32))


def lcp_matrix(M: Any, n: int) -> np.ndarray | Tridiagonal | tuple:
    """M as a dense, a tridiagonal or a compressed sparse matrix; a number is that multiple of the identity, None zero."""
    if isinstance(M, Tridiagonal):
        return M
    if is_sparse(M):
        M = checked(M, "M")
        coo = M.tocoo()
        if n >= SMALLEST_TRIDIAGONAL and M.shape == (n, n) and np.all(np.abs(coo.row - coo.col) <= 1):
            return _three(M.diagonal(-1), M.diagonal(0), M.diagonal(1))
        if n >= SMALLEST_SPARSE and M.shape == (n, n) and M.nnz < LARGEST_DENSITY * n * n:
            return compressed(M, "M")
        return matrix(M, "M")
    given = on_host(0.0 if M is None else M, "M")
    if given.ndim == 0 and n >= SMALLEST_TRIDIAGONAL:
        return Tridiagonal(0.0, np.full(n, float(given)), 0.0)
    dense = multiple(given, n, "M")
    if n < SMALLEST_TRIDIAGONAL or dense.shape != (n, n) or np.any(np.triu(dense, 2)) or np.any(np.tril(dense, -2)):
        return dense
    return _three(np.diag(dense, -1), np.diag(dense), np.diag(dense, 1))


def _three(lower: np.ndarray, diagonal: np.ndarray, upper: np.ndarray) -> Tridiagonal:
    return Tridiagonal(np.concatenate([[0.0], lower]), diagonal, np.concatenate([upper, [0.0]]))
