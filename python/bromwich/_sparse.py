"""Matrices of scipy.sparse, checked before they are read: SciPy trusts indices, its conversions read wherever they say.
SciPy is not imported for this."""

from __future__ import annotations

from typing import Any

import numpy as np

from ._errors import Error


def is_sparse(a: Any) -> bool:
    """Whether it is a matrix or array of scipy.sparse."""
    return hasattr(a, "tocsc") and hasattr(a, "nnz")


def checked(a: Any, name: str) -> Any:
    """The matrix, whose indices lie within it."""
    form = getattr(a, "format", "")
    if form in ("csr", "csc", "bsr"):
        _check_compressed(a, form, name)
    elif form == "dia":
        held = np.ndim(a.data) == 2 and len(a.data) == np.size(a.offsets)
        _require(held, name, f"has {np.size(a.offsets)} offsets and data of shape {np.shape(a.data)}", "give a row for each offset")
    elif form == "lil":
        return checked(a.tocsr(), name)
    else:  # coo, and those that become one; others fail in a conversion of their own
        a = a.tocoo()
        coords = getattr(a, "coords", None) or (a.row, a.col)
        for of, size, which in zip(("row", "column")[-len(coords) :], a.shape, coords):
            _require(len(which) == len(a.data), name, f"has {len(which)} {of} indices for {len(a.data)} values", "give one for each")
            _check_indices(which, size, of, name)
    return a


def _check_compressed(a: Any, form: str, name: str) -> None:
    """Lengths, starts and indices of compressed rows, columns or blocks."""
    rows, columns = a.shape if len(a.shape) == 2 else (1, *a.shape)
    if form == "bsr":
        held = np.ndim(a.data) == 3 and min(a.data.shape[1:]) > 0
        _require(held, name, f"has data of shape {np.shape(a.data)}", "give blocks, entries x rows x columns")
        rows, columns = rows // a.data.shape[1], columns // a.data.shape[2]
    major, minor, of = (columns, rows, "row") if form == "csc" else (rows, columns, "column")
    starts, indices, entries = np.asarray(a.indptr), np.asarray(a.indices), len(a.data)
    for array, word in ((starts, "indptr"), (indices, "indices")):
        flat = array.ndim == 1 and array.dtype.kind in "iu"
        _require(flat, name, f"has {word} of {array.dtype} with {array.ndim} dimensions", "give whole numbers in one dimension")
    _require(indices.size == entries, name, f"has {indices.size} indices for {entries} values", "give one for each")
    held = starts.size == major + 1 and starts[0] == 0 and bool(np.all(starts[1:] >= starts[:-1])) and starts[-1] <= entries
    _require(held, name, "has an indptr that does not ascend from 0 to its number of entries, one for each "
             f"{'column' if form == 'csc' else 'row'} and one more", "correct it")  # fmt: skip
    _check_indices(indices[: starts[-1]], minor, f"{of} of blocks" if form == "bsr" else of, name)


def _check_indices(indices: np.ndarray, size: int, of: str, name: str) -> None:
    if indices.size == 0:
        return
    least, largest = int(np.min(indices)), int(np.max(indices))
    found = f"has {of} indices from {least} to {largest}, and {size} of them"
    _require(0 <= least and largest < size, name, found, "count from 0")


def _require(held: bool, name: str, found: str, remedy: str) -> None:
    if not held:
        raise Error(f"{name}: {found}; {remedy}", name)
