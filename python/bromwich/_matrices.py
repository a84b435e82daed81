"""The matrices of a scene as NumPy or SciPy has them."""

from __future__ import annotations

from typing import Any

import numpy as np

from . import _core


def matrices(model: _core.Model) -> dict[str, Any]:
    """A, B, N, E, M, F, E0 and ET; None where there is none: what was not given, A of callbacks, A, B and N of a Kronecker sum."""
    state = _core.state_of_model(model)
    kind, *parts = state["dynamics"]
    found: dict[str, Any] = dict.fromkeys("ABNE")
    if kind in ("set_dense", "set_sparse"):
        found.update(zip("ABNE", parts))
    elif kind == "set_supplied":
        found["B"], found["N"] = parts[1], parts[2]
    kind, *parts = state["M"]
    found["M"] = _tridiagonal(*parts) if kind == "set_M_tridiagonal" else parts[0]
    found["F"] = state["f_entry"][1]
    found["E0"], found["ET"], _ = state.get("boundary", (None, None, None))
    return {name: _as_array(value) for name, value in found.items()}


def _as_array(found: Any) -> Any:
    """Of compressed columns a matrix of SciPy."""
    if not isinstance(found, tuple):
        return found
    rows, columns, values, indices, starts = found
    from scipy.sparse import csc_array

    return csc_array((values, indices, starts), shape=(rows, columns))


def _tridiagonal(lower: np.ndarray, diagonal: np.ndarray, upper: np.ndarray) -> np.ndarray:
    return np.diag(diagonal) + np.diag(lower[1:], -1) + np.diag(upper[:-1], 1)
