"""Shared by the rules for JAX and PyTorch: problems solved on the host, as arrays."""

from __future__ import annotations

import math

import numpy as np

from ._differentiable import FAILED
from ._errors import Error
from ._lcp import lcp

#: The numbers in the array of status of ``bromwich.jax.lcp`` and ``bromwich.torch.lcp``, as indices.
LCP_STATUSES = ("solved", "infeasible", "unsolved", "nonfinite")


def require_failed(failed: str) -> None:
    if failed not in FAILED:
        raise Error(f"failed: found {failed!r}; use {', '.join(FAILED)}", "failed")


def outputs(how: tuple, M: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, ...]:
    """y, w, status and margin, with the leading axes of both. A matrix that all problems share is given once. `how`: class,
    what happens where a problem is not solved, threads."""
    lcp_class, failed, threads = how
    n = q.shape[-1]
    leading = np.broadcast_shapes(M.shape[:-2], q.shape[:-1])
    shared = math.prod(M.shape[:-2]) == 1
    if shared and np.isfinite(M).all():
        M = M.reshape(n, n)
    rows = np.broadcast_to(q, (*leading, n))
    r = lcp(M, rows, lcp_class=lcp_class, threads=threads, check=failed == "raise")
    status = np.array([LCP_STATUSES.index(s) for s in np.ravel(r.status)], dtype=np.float64)
    return r.y.reshape(*leading, n), r.w.reshape(*leading, n), status.reshape(leading), r.margin.reshape(leading)
