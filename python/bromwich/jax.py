"""Solves that JAX differentiates, compiles and maps.

    jax.config.update("jax_enable_x64", True)
    from bromwich.jax import solve
    y, x, w = solve(A=A, B=B, N=N, M=M, x0=x0, T=1.0, g=g, steps=400)
    jax.grad(lambda M: (solve(A=A, B=B, N=N, M=M, x0=x0, T=1.0, g=g, steps=400)[0] ** 2).sum())(M)
"""

from __future__ import annotations

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from . import _differentiable as common
from . import _on_device as on_device
from ._errors import Error

_LIBRARY = on_device.Library(
    spread=jnp.broadcast_to,
    shaped=jnp.reshape,
    take=jnp.from_dlpack,
    put=lambda v, like: jax.device_put(v, like.sharding),
    total=lambda v, axes, keep: v.sum(axis=axes, keepdims=keep),
    on_host=np.asarray,
)


def _named(data: tuple) -> dict[str, np.ndarray | None]:
    # A source without columns stands for None, since callbacks take arrays only.
    arrays = {name: np.asarray(v) for name, v in zip(common.DATA, data)}
    return {name: None if name in "fg" and v.shape[-1] == 0 else v for name, v in arrays.items()}


def _of_host(how: tuple, *data: Any) -> tuple:
    return common.Solved(_named(data), *how).outputs()


def _back_on_host(how: tuple, data: tuple, of: tuple) -> tuple:
    bars = common.Solved(_named(data), *how).gradient(of)
    every = np.shape(bars[0])[:-1]  # of x0
    return tuple(np.zeros((*every, *np.shape(v)[-2:])) if bar is None else bar for bar, v in zip(bars, data))


def _called(function: Any, shapes: Any, *arguments: Any) -> Any:
    return jax.pure_callback(function, shapes, *arguments, vmap_method="expand_dims")


@functools.partial(jax.custom_vjp, nondiff_argnums=(0,))
def _solve(how: tuple, *data: Any) -> tuple:
    rows, m, n = how[1] + 1, data[3].shape[-1], data[6].shape[-1]
    shapes = tuple(jax.ShapeDtypeStruct((rows, k), jnp.float64) for k in (n, m, n))
    return _called(functools.partial(_of_host, how), shapes, *data)


def _forward(how: tuple, *data: Any) -> tuple:
    return _solve(how, *data), data


def _backward(how: tuple, data: tuple, of: tuple) -> tuple:
    shapes = tuple(jax.ShapeDtypeStruct(v.shape, jnp.float64) for v in data)
    return _called(functools.partial(_back_on_host, how), shapes, data, of)


_solve.defvjp(_forward, _backward)


# ---- On a device. Arrays have values here: there is no callback, and nothing is compiled.


class _Kept:
    """A solution, from `_forward_on_device` to `_backward_on_device`. It has no arrays that JAX knows of."""

    def __init__(self, solved: on_device.SolvedOnDevice) -> None:
        self.solved = solved


jax.tree_util.register_pytree_node(_Kept, lambda kept: ((), kept), lambda kept, _: kept)


def _solved_on_device(how: tuple, data: tuple) -> on_device.SolvedOnDevice:
    if any(isinstance(v, jax.core.Tracer) for v in data):
        raise Error(
            "backend: 'cuda' inside jax.jit or jax.vmap, where arrays have no values; call it outside, with the scenes as "
            "leading axes of x0, f and g, or use backend='cpu'",
            "backend",
        )
    arrays = dict(zip(common.DATA, data))
    named = {name: None if name in "fg" and v.shape[-1] == 0 else v for name, v in arrays.items()}
    return on_device.SolvedOnDevice(_LIBRARY, named, *how)


@functools.partial(jax.custom_vjp, nondiff_argnums=(0,))
def _solve_on_device(how: tuple, *data: Any) -> tuple:
    return _solved_on_device(how, data).outputs()


def _forward_on_device(how: tuple, *data: Any) -> tuple:
    solved = _solved_on_device(how, data)
    return solved.outputs(), (_Kept(solved), data)


def _backward_on_device(how: tuple, kept: tuple, of: tuple) -> tuple:
    solution, data = kept
    bars = solution.solved.gradient(tuple(of), [tuple(v.shape) for v in data])
    return tuple(jnp.zeros(v.shape) if bar is None else bar for bar, v in zip(bars, data))


_solve_on_device.defvjp(_forward_on_device, _backward_on_device)


def solve(
    *,
    A: Any,
    B: Any,
    N: Any,
    M: Any,
    x0: Any,
    T: float,
    steps: int,
    f: Any = None,
    g: Any = None,
    method: str = "march",
    threads: int = 0,
    backend: str = "cpu",
    device: int | None = None,
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """y (J+1) x n, x (J+1) x m and w (J+1) x n of a dense scene. ``jax.vmap`` solves all scenes together on the host
    (:func:`bromwich.solve_batch`).

    Args:
        A, B, N, M, x0: m x m, m x n, n x m, n x n and m, float64.
        f, g: (J+1) x m and (J+1) x n at the time points, linear between them; None: zero.
        T: final time. steps: J. method: ``"march"``, ``"contour"`` or ``"multigrid"``.
        backend: ``"cpu"``: computed on the host. ``"cuda"``: x0, f and g are arrays on a CUDA device, and so are y, x, w
            and the gradients: no table of J+1 rows passes through the host. x0, f and g may have leading axes for scenes
            that are solved together. Not inside ``jax.jit`` and ``jax.vmap``. At most 8 states and 8 constraints, M of
            class P, method ``"march"``; scenes share A, B, N and M, which are read on the host. Results are not looked
            at again with half the step.
        device: number of the CUDA device; None: the first one.

    Raises:
        Error: JAX has no float64 (``jax.config.update("jax_enable_x64", True)``).
        A failure of the solve, or a solution that is not differentiable, leaves JAX as an error of the callback. Second
            derivatives are not there.
    """
    if not jax.config.jax_enable_x64:
        raise Error('jax: has no float64; call jax.config.update("jax_enable_x64", True) first', "jax")
    J = common.whole(steps)
    none = jnp.zeros((J + 1, 0))
    data = (x0, none if f is None else f, none if g is None else g, A, B, N, M)
    for name, v in zip(common.DATA, data):
        if jnp.iscomplexobj(v):
            raise Error(f"{name}: is complex; give real numbers", name)
    arrays = tuple(jnp.asarray(v, jnp.float64) for v in data)
    if common.place(backend, device) == "cuda":
        return _solve_on_device((float(T), J, method, threads, device), *arrays)
    for name, v in zip(common.DATA, arrays):
        if v.ndim != common.AXES[name]:
            raise Error(f"{name}: has {v.ndim} axes; give {common.AXES[name]}, and more by jax.vmap", name)
    return _solve((float(T), J, method, threads), *arrays)
