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
from jax.core import ShapedArray
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

from . import _differentiable as common
from . import _on_device as on_device
from ._differentiable import STATUSES
from ._errors import Error
from ._lcp_differentiable import LCP_STATUSES
from ._lcp_jax import lcp

_LIBRARY = on_device.Library(
    spread=jnp.broadcast_to,
    shaped=jnp.reshape,
    take=jnp.from_dlpack,
    put=lambda v, like: jax.device_put(v, like.sharding),
    total=lambda v, axes, keep: v.sum(axis=axes, keepdims=keep),
    on_host=np.asarray,
)


# ---- On the host: three primitives, the solve and the two directions of its derivative. Their arrays have the leading
# axes of all scenes, of length 1 where scenes share one. Arrays with values are passed to the solver as they are, so that
# its errors are those of Python; only under jax.jit it is called back.


def _leading(arrays: Any, names: Any) -> tuple[int, ...]:
    return np.broadcast_shapes(*(v.shape[: v.ndim - common.AXES.get(name, 2)] for name, v in zip(names, arrays)))


def _solved(how: common.How, data: tuple) -> common.Solved:
    # A source without columns stands for None, since callbacks take arrays only.
    return common.Solved(common.arrays(data, np.asarray), *how)


def _of_host(how: common.How, *data: Any) -> tuple:
    solved = _solved(how, data)
    return *solved.outputs(), solved.status.astype(np.float64)


def _shapes_of_solution(how: common.How, *data: Any) -> list[tuple[int, ...]]:
    every, m, n = _leading(data, common.DATA), data[3].shape[-1], data[6].shape[-1]
    return [*((*every, how.steps + 1, k) for k in (n, m, n)), every]


def _tangent_on_host(how: common.How, *given: Any) -> tuple:
    data, changes = given[: len(common.DATA)], given[len(common.DATA) :]
    return _solved(how, data).tangent(common.arrays(changes, np.asarray))


def _shapes_of_tangent(how: common.How, *given: Any) -> list[tuple[int, ...]]:
    every, m, n = _leading(given, common.DATA * 2), given[3].shape[-1], given[6].shape[-1]
    return [(*every, how.steps + 1, k) for k in (n, m, n)]


def _gradient_on_host(how: common.How, *given: Any) -> tuple:
    data, of = given[: len(common.DATA)], given[len(common.DATA) :]
    bars = _solved(how, data).gradient(of)
    shapes = _shapes_of_gradient(how, *given)
    return tuple(np.zeros(shape) if bar is None else bar for bar, shape in zip(bars, shapes))


def _shapes_of_gradient(how: common.How, *given: Any) -> list[tuple[int, ...]]:
    every = _leading(given, (*common.DATA, "y", "x", "w"))
    return [(*every, *v.shape[v.ndim - common.AXES[name] :]) for name, v in zip(common.DATA, given)]


def _primitive(name: str, on_host: Any, shapes: Any) -> Primitive:
    primitive = Primitive(f"bromwich_{name}")
    primitive.multiple_results = True

    def called_back(*given: Any, how: common.How) -> list:
        results = [jax.ShapeDtypeStruct(shape, jnp.float64) for shape in shapes(how, *given)]
        return list(jax.pure_callback(functools.partial(_shortly, on_host, how), tuple(results), *given))

    def mapped(given: Any, axes: Any, how: common.How) -> tuple:
        moved = [v[None] if axis is None else jnp.moveaxis(v, axis, 0) for v, axis in zip(given, axes)]
        found = primitive.bind(*moved, how=how)
        return found, [0] * len(found)

    primitive.def_impl(lambda *given, how: [jnp.asarray(v) for v in on_host(how, *(np.asarray(v) for v in given))])
    primitive.def_abstract_eval(lambda *given, how: [ShapedArray(s, np.dtype(np.float64)) for s in shapes(how, *given)])
    batching.primitive_batchers[primitive] = mapped
    mlir.register_lowering(primitive, mlir.lower_fun(called_back, multiple_results=True))
    return primitive


def _shortly(on_host: Any, how: common.How, *given: Any) -> tuple:
    """An error is raised here, so that JAX has no more of its frames to print."""
    try:
        return on_host(how, *given)
    except ValueError as error:
        short = Error(str(error), getattr(error, "argument", ""))
    raise short from None


_solution = _primitive("solution", _of_host, _shapes_of_solution)
_tangent = _primitive("tangent", _tangent_on_host, _shapes_of_tangent)
_gradient = _primitive("gradient", _gradient_on_host, _shapes_of_gradient)


def _tangent_of_solution(data: Any, changes: Any, how: common.How) -> tuple:
    found = _solution.bind(*data, how=how)
    along = _tangent.bind(*data, *map(ad.instantiate_zeros, changes), how=how)
    return found, [*along, jnp.zeros_like(found[-1])]


def _tangent_of_derivative(primitive: Primitive, given: Any, changes: Any, how: common.How) -> tuple:
    data, of = given[: len(common.DATA)], changes[len(common.DATA) :]
    if any(type(change) is not ad.Zero for change in changes[: len(common.DATA)]):
        common.no_second_derivative()
    return primitive.bind(*given, how=how), primitive.bind(*data, *map(ad.instantiate_zeros, of), how=how)


def _transposed_tangent(of: Any, *given: Any, how: common.How) -> list:
    data, changes = given[: len(common.DATA)], given[len(common.DATA) :]
    bars = _gradient.bind(*data, *map(ad.instantiate_zeros, of), how=how)
    wanted = [ad.is_undefined_primal(v) for v in changes]
    bars = [_summed_to(bar, v.aval.shape) if want else None for bar, v, want in zip(bars, changes, wanted)]
    return [None] * len(data) + bars


def _transposed_gradient(of: Any, *given: Any, how: common.How) -> list:
    data, weights = given[: len(common.DATA)], given[len(common.DATA) :]
    found = _tangent.bind(*data, *map(ad.instantiate_zeros, of), how=how)
    wanted = [ad.is_undefined_primal(v) for v in weights]
    found = [_summed_to(v, w.aval.shape) if want else None for v, w, want in zip(found, weights, wanted)]
    return [None] * len(data) + found


def _summed_to(bar: Any, shape: tuple[int, ...]) -> Any:
    ones = tuple(i for i, k in enumerate(shape) if k == 1 and bar.shape[i] != 1)
    return bar.sum(axis=ones, keepdims=True)


ad.primitive_jvps[_solution] = _tangent_of_solution
for _primitive_of_derivative, _rule in ((_tangent, _transposed_tangent), (_gradient, _transposed_gradient)):
    ad.primitive_jvps[_primitive_of_derivative] = functools.partial(_tangent_of_derivative, _primitive_of_derivative)
    ad.primitive_transposes[_primitive_of_derivative] = _rule


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
    return on_device.SolvedOnDevice(_LIBRARY, common.arrays(data, lambda v: v), *how)


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
    tol: float | None = None,
    refine: int = 1,
    failed: str = "raise",
) -> tuple[jax.Array, ...]:
    """y (J+1) x n, x (J+1) x m and w (J+1) x n of a dense scene. ``jax.vmap`` solves all scenes together on the host
    (:func:`bromwich.solve_batch`).

    Args:
        A, B, N, M, x0: m x m, m x n, n x m, n x n and m, float64.
        f, g: (J+1) x m and (J+1) x n at the time points, linear between them; None: zero.
        T: final time. steps: J. method: ``"march"``, ``"contour"`` or ``"multigrid"``.
        tol: switches are located, so that values and derivatives are those of the solution, to this tolerance (derivatives to
            about 1e-9), and not of its steps; at most 96 states and 72 constraints. None: of the steps.
        refine: steps between two time points. Derivatives of few steps may be far off where the values are not; how far
            says :func:`gradient_and_error`.
        failed: what a scene without a solution does. ``"raise"``: it raises an error. ``"nan"``, ``"zero"``: its y, x and w
            are NaN, derivatives of it, and those of scenes that are not differentiable, are NaN or 0, and a fourth array
            is returned: 0 where the scene is solved, otherwise an index of ``bromwich.jax.STATUSES``.
        backend: ``"cpu"``: computed on the host. ``"cuda"``: x0, f and g are arrays on a CUDA device, and so are y, x, w
            and the gradients: no table of J+1 rows passes through the host. x0, f and g may have leading axes for scenes
            that are solved together. Not inside ``jax.jit`` and ``jax.vmap``. At most 8 states and 8 constraints, M of
            class P, method ``"march"``; scenes share A, B, N and M, which are read on the host. Results are not looked
            at again with half the step.
        device: number of the CUDA device; None: the first one.

    Raises:
        Error: JAX has no float64 (``jax.config.update("jax_enable_x64", True)``).
        NotSolved, Error: a failure of the solve, or a solution that is not differentiable. Under ``jax.jit`` it is the last
            line of an error of JAX. Second derivatives are not there.
    """
    if not jax.config.jax_enable_x64:
        raise Error('jax: has no float64; call jax.config.update("jax_enable_x64", True) first', "jax")
    how = common.how(T, steps, method, threads, tol, refine, failed)
    none = jnp.zeros((how.steps + 1, 0))
    data = (x0, none if f is None else f, none if g is None else g, A, B, N, M)
    for name, v in zip(common.DATA, data):
        common.require_real(name, jnp.iscomplexobj(v))
    arrays = tuple(jnp.asarray(v, jnp.float64) for v in data)
    if common.place(backend, device) == "cuda":
        common.on_a_device(how)
        return _solve_on_device((how.T, how.steps, method, threads, device), *arrays)
    for name, v in zip(common.DATA, arrays):
        if v.ndim != common.AXES[name]:
            raise Error(f"{name}: has {v.ndim} axes; give {common.AXES[name]}, and more by jax.vmap", name)
    *found, status = _solution.bind(*arrays, how=how)
    return tuple(found) if failed == "raise" else (*found, status.astype(jnp.int32))


def gradient_and_error(loss: Any, *args: Any, argnums: int | tuple[int, ...] = 0) -> tuple[Any, Any]:
    """The gradient of ``loss(*args, refine=2)``, and an estimate of the error of each entry: twice its distance from
    ``refine=1``, which bounds errors that at least halve with the step.

    Args:
        loss: takes ``refine``, for :func:`solve`, beside its arguments.
        argnums: those to differentiate by, as :func:`jax.grad` takes them.

    Example:
        >>> def loss(M, refine):
        ...     return (solve(A=A, B=B, N=N, M=M, x0=x0, T=1.0, steps=400, refine=refine)[0] ** 2).sum()
        >>> gradient, error = gradient_and_error(loss, M)
    """
    coarse, fine = (jax.grad(functools.partial(loss, refine=steps), argnums)(*args) for steps in (1, 2))
    return fine, jax.tree.map(lambda a, b: 2 * jnp.abs(a - b), fine, coarse)


__all__ = ["LCP_STATUSES", "STATUSES", "gradient_and_error", "lcp", "solve"]
