"""Complementarity problems that JAX differentiates, compiles and maps."""

from __future__ import annotations

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ._errors import Error
from ._lcp import DEGENERATE
from ._lcp_differentiable import outputs, require_failed


def _on_host(how: tuple, M: Any, q: Any) -> tuple[np.ndarray, ...]:
    try:
        return outputs(how, np.asarray(M), np.asarray(q))
    except ValueError as error:
        short = Error(str(error), getattr(error, "argument", ""))
    raise short from None


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def _solution(how: tuple, M: jax.Array, q: jax.Array) -> tuple:
    leading = jnp.broadcast_shapes(M.shape[:-2], q.shape[:-1])
    rows, one = (jax.ShapeDtypeStruct(shape, jnp.float64) for shape in ((*leading, q.shape[-1]), leading))
    return tuple(jax.pure_callback(functools.partial(_on_host, how), (rows, rows, one, one), M, q, vmap_method="expand_dims"))


@_solution.defjvp
def _tangent(how: tuple, data: tuple, changes: tuple) -> tuple:
    (M, q), (dM, dq) = data, changes
    found = _solution(how, M, q)
    y, w, status, margin = map(jax.lax.stop_gradient, found)
    good = ((status == 0) & (margin > DEGENERATE))[..., None]
    y = jnp.where(good, y, 0.0)
    S = (y > 0).astype(jnp.float64)
    eye = jnp.eye(y.shape[-1])
    K = S[..., :, None] * M * S[..., None, :] + eye * (1 - S)[..., :, None]
    change = dq + (dM @ y[..., None])[..., 0]
    dy = -jnp.linalg.solve(K, (S * change)[..., None])[..., 0]
    dw = (1 - S) * ((M @ dy[..., None])[..., 0] + change)
    bad = 0.0 if how[1] == "zero" else jnp.nan
    kept = jnp.where(good, 1.0, bad)
    return found, (dy * kept, dw * kept, jnp.zeros_like(status), jnp.zeros_like(margin))


def lcp(M: Any, q: Any, *, lcp_class: str = "auto", failed: str = "raise", threads: int = 0) -> tuple[jax.Array, ...]:
    """y and w of ``0 <= y  ⊥  w = M y + q >= 0`` (:func:`bromwich.lcp`), solved on the host. M is n x n and q has n values,
    or both have leading axes for problems that are solved together; ``jax.vmap`` adds one. The derivative holds the active
    sets.

    Args:
        lcp_class: as :func:`bromwich.lcp` takes it.
        failed: what a problem without a solution does. ``"raise"``: it raises an error; derivatives of degenerate problems
            are NaN. ``"nan"``, ``"zero"``: its y and w are NaN, derivatives of it, and of degenerate problems, are NaN or 0, and
            a third array is returned: 0 where the problem is solved, otherwise an index of ``LCP_STATUSES``.
        threads: of the host; 0: all.
    """
    if not jax.config.jax_enable_x64:
        raise Error('jax: has no float64; call jax.config.update("jax_enable_x64", True) first', "jax")
    require_failed(failed)
    for name, v in (("M", M), ("q", q)):
        if jnp.iscomplexobj(v):
            raise Error(f"{name}: is complex; give real numbers", name)
    M, q = jnp.asarray(M, jnp.float64), jnp.asarray(q, jnp.float64)
    if M.ndim < 2 or M.shape[-1] != M.shape[-2] or q.ndim < 1 or q.shape[-1] != M.shape[-1]:
        raise Error(f"M: has shape {M.shape}, and q {q.shape}; give n x n and n, or more axes of problems before", "M")
    y, w, status, _ = _solution((lcp_class, failed, threads), M, q)
    return (y, w) if failed == "raise" else (y, w, status.astype(jnp.int32))
