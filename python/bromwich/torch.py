"""Solves that PyTorch differentiates.

    from bromwich.torch import solve
    y, x, w = solve(A=A, B=B, N=N, M=M, x0=x0, T=1.0, g=g, steps=400)
    loss = (y - measured).square().sum()
    loss.backward()
"""

from __future__ import annotations

import functools
from typing import Any

import torch

from . import _differentiable as common
from . import _on_device as on_device
from ._differentiable import STATUSES
from ._errors import Error
from ._lcp_differentiable import LCP_STATUSES
from ._lcp_torch import lcp

_LIBRARY = on_device.Library(
    spread=lambda v, shape: v.detach().double().expand(shape),
    shaped=lambda v, shape: v.detach().double().reshape(shape).contiguous(),
    take=torch.from_dlpack,
    put=lambda v, like: torch.tensor(v, device=like.device),
    total=lambda v, axes, keep: v.sum(dim=axes, keepdim=keep),
    on_host=lambda v: _array(v),
)


class _Solve(torch.autograd.Function):
    """y, x, w, the status of each scene, and the solution itself."""

    @staticmethod
    def forward(how: common.How, place: tuple, *data: torch.Tensor | None) -> tuple:
        backend, device = place
        given = [v for v in data if v is not None]
        kind = functools.reduce(torch.promote_types, (v.dtype for v in given if v.is_floating_point()))
        if backend == "cuda":
            named = dict(zip(common.DATA, data))
            on_cuda = on_device.SolvedOnDevice(_LIBRARY, named, how.T, how.steps, how.method, how.threads, device)
            outputs = on_cuda.outputs()
            return *(v.to(kind) for v in outputs), torch.zeros(outputs[0].shape[:-2], dtype=torch.int32), on_cuda
        solved = common.Solved(common.arrays(data, _array), *how)
        outputs = (torch.from_numpy(v).to(given[0].device, kind) for v in solved.outputs())
        return *outputs, torch.from_numpy(solved.status).to(given[0].device), solved

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple, output: tuple) -> None:
        ctx.solved = output[-1]
        ctx.mark_non_differentiable(output[-2])
        ctx.save_for_backward(*inputs[2:])
        ctx.save_for_forward(*inputs[2:])

    @staticmethod
    def backward(ctx: Any, *of: Any) -> tuple:
        data = ctx.saved_tensors
        shapes = tuple(None if v is None else tuple(v.shape) for v in data)
        return None, None, *_Gradient.apply(ctx.solved, (), shapes, *of[:3], *data)

    @staticmethod
    def jvp(ctx: Any, *changes: Any) -> tuple:
        along = _Tangent.apply(ctx.solved, (), *changes[2:], *ctx.saved_tensors)
        return *along, None, None

    @staticmethod
    def vmap(info: Any, in_dims: tuple, how: common.How, place: tuple, *data: torch.Tensor | None) -> tuple:
        given = list(zip(common.DATA, data, in_dims[2:]))
        most = max(v.ndim - common.AXES[n] - (d is not None) for n, v, d in given if v is not None)
        listed = (None if v is None else _scenes_first(v, d, most + common.AXES[n]) for n, v, d in given)
        return _Solve.apply(how, place, *listed), (0, 0, 0, 0, None)


class _Tangent(torch.autograd.Function):
    """The changes of y, x and w along changes of the data; `mapped` as for :class:`_Gradient`."""

    @staticmethod
    def forward(solved: Any, mapped: tuple, *given: torch.Tensor | None) -> tuple:
        count = len(common.DATA)
        changes, data = given[:count], given[count:]
        if isinstance(solved, on_device.SolvedOnDevice):
            raise Error("jvp: is not there on a device; use backend='cpu', or backward", "backend")
        kind = functools.reduce(torch.promote_types, (v.dtype for v in data if v is not None))
        where = next(v.device for v in data if v is not None)
        along = solved.tangent(common.arrays(changes, _array), mapped)
        return tuple(torch.from_numpy(v).to(where, kind) for v in along)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple, output: tuple) -> None:
        pass

    backward = staticmethod(common.no_second_derivative)

    @staticmethod
    def vmap(info: Any, in_dims: tuple, solved: Any, mapped: tuple, *given: Any) -> tuple:
        count, dims = len(common.DATA), in_dims[2:]
        solution_too = any(d is not None for d in dims[count:])
        axes = [common.AXES[name] for name in common.DATA]
        most = max(v.ndim - k - (d is not None) for v, d, k in zip(given[:count], dims, axes) if v is not None)
        changes = (None if v is None else _scenes_first(v, d, most + k) for v, d, k in zip(given[:count], dims, axes))
        found = _Tangent.apply(solved, (solution_too, *mapped), *changes, *given[count:])
        return tuple(v.expand(info.batch_size, *v.shape[1:]) for v in found), (0, 0, 0)


class _Gradient(torch.autograd.Function):
    """The gradient with respect to the data. It receives the data only to refuse second derivatives. `mapped`: for each
    axis that a vmap has added, the outermost first, whether the solution has it too."""

    @staticmethod
    def forward(solved: common.Solved | on_device.SolvedOnDevice, mapped: tuple, shapes: common.Shapes, *given: torch.Tensor | None) -> tuple:
        of, data = given[:3], given[3:]
        if isinstance(solved, on_device.SolvedOnDevice):
            bars = solved.gradient(of, shapes, mapped)
            return tuple(None if v is None else bar.to(v.dtype) for bar, v in zip(bars, data))
        bars = solved.gradient(tuple(_array(v) for v in of if v is not None), shapes, mapped)
        return tuple(None if v is None else torch.from_numpy(bar).to(v.device, v.dtype) for bar, v in zip(bars, data))

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple, output: tuple) -> None:
        pass

    backward = staticmethod(common.no_second_derivative)

    @staticmethod
    def vmap(info: Any, in_dims: tuple, solved: common.Solved, mapped: tuple, shapes: common.Shapes, *given: Any) -> tuple:
        dims = in_dims[3:]
        solution_too = any(d is not None for d in dims[3:])
        outputs = [(v, d) for v, d in zip(given[:3], dims) if v is not None]
        most = max(v.ndim - 2 - (d is not None) for v, d in outputs)
        of = (_scenes_first(v, d, most + 2) for v, d in outputs)
        # Each scene has its own gradient, also with respect to shared data.
        wanted = tuple(
            None if s is None else (info.batch_size, *(1,) * (most + common.AXES[name] - len(s)), *s)
            for name, s in zip(common.DATA, shapes)
        )
        bars = _Gradient.apply(solved, (solution_too, *mapped), wanted, *of, *given[3:])
        found = tuple(None if s is None else bar.reshape(info.batch_size, *s) for bar, s in zip(bars, shapes))
        return found, tuple(None if s is None else 0 for s in shapes)


def _array(v: torch.Tensor) -> Any:
    return v.detach().cpu().double().numpy()


def _scenes_first(v: torch.Tensor, dim: int | None, axes: int) -> torch.Tensor:
    """v with an axis of scenes before the `axes` axes of one scene; its length is 1 where all scenes share v."""
    v = v[None] if dim is None else v.movedim(dim, 0)
    return v.reshape(v.shape[0], *(1,) * (axes + 1 - v.ndim), *v.shape[1:])


def solve(
    *,
    A: torch.Tensor,
    B: torch.Tensor,
    N: torch.Tensor,
    M: torch.Tensor,
    x0: torch.Tensor,
    T: float,
    steps: int,
    f: torch.Tensor | None = None,
    g: torch.Tensor | None = None,
    method: str = "march",
    threads: int = 0,
    backend: str = "cpu",
    device: int | None = None,
    tol: float | None = None,
    refine: int = 1,
    failed: str = "raise",
) -> tuple[torch.Tensor, ...]:
    """y (J+1) x n, x (J+1) x m and w (J+1) x n of a dense scene, computed in double precision.

    Args:
        A, B, N, M, x0: m x m, m x n, n x m, n x n and m. Each may have leading axes for scenes that are solved together
            (:func:`bromwich.solve_batch`), and then y, x and w have them; ``torch.vmap`` adds one.
        f, g: (J+1) x m and (J+1) x n at the time points, linear between them; None: zero.
        T: final time. steps: J. method: ``"march"``, ``"contour"`` or ``"multigrid"``.
        backend: ``"cpu"``: computed on the host, where tensors of a device are copied. ``"cuda"``: x0, f and g are
            tensors on a CUDA device, and so are y, x, w and the gradients: no table of J+1 rows passes through the host.
            At most 8 states and 8 constraints, M of class P, method ``"march"``; scenes share A, B, N and M, which are
            read on the host. Results are not looked at again with half the step.
        device: number of the CUDA device; None: the first one.
        tol: switches are located, so that values and derivatives are those of the solution, to this tolerance (derivatives to
            about 1e-9), and not of its steps; at most 96 states and 72 constraints. None: of the steps.
        refine: steps between two time points. Derivatives of few steps may be far off where the values are not; how far
            says :func:`gradient_and_error`.
        failed: what a scene without a solution does. ``"raise"``: it raises an error. ``"nan"``, ``"zero"``: its y, x and w
            are NaN, derivatives of it, and those of scenes that are not differentiable, are NaN or 0, and a fourth tensor
            is returned: 0 where the scene is solved, otherwise an index of ``bromwich.torch.STATUSES``.

    Raises:
        NotSolved: there is no solution, of some scene.
        Error: in ``backward``, where the solution is not differentiable (see :meth:`bromwich.Result.derivative`), and for
            second derivatives.
    """
    if isinstance(T, torch.Tensor) and T.requires_grad:
        raise Error("T: has no derivative; give a number", "T")
    data = []
    for name, v in zip(common.DATA, (x0, f, g, A, B, N, M)):
        if v is None and name in "fg":
            data.append(None)
            continue
        if not isinstance(v, torch.Tensor):
            raise Error(f"{name}: is a {type(v).__name__}; give a torch.Tensor", name)
        common.require_real(name, v.is_complex())
        v = v if v.layout is torch.strided else v.to_dense()
        data.append(v if v.is_floating_point() else v.double())
    how = common.how(T, steps, method, threads, tol, refine, failed)
    if common.place(backend, device) == "cuda":
        common.on_a_device(how)
    found = _Solve.apply(how, (backend, device), *data)
    return found[:3] if failed == "raise" else found[:4]


def gradient_and_error(loss: Any, *tensors: torch.Tensor) -> tuple[tuple[torch.Tensor, ...], tuple[torch.Tensor, ...]]:
    """The gradient of ``loss(*tensors, refine=2)`` by each tensor, and an estimate of the error of each entry: twice its
    distance from ``refine=1``, which bounds errors that at least halve with the step.

    Args:
        loss: takes ``refine``, for :func:`solve`, beside the tensors, which require gradients.

    Example:
        >>> def loss(M, refine):
        ...     return (solve(A=A, B=B, N=N, M=M, x0=x0, T=1.0, steps=400, refine=refine)[0] ** 2).sum()
        >>> (gradient,), (error,) = gradient_and_error(loss, M)
    """
    coarse, fine = (torch.autograd.grad(loss(*tensors, refine=steps), tensors) for steps in (1, 2))
    return fine, tuple(2 * (a - b).abs() for a, b in zip(fine, coarse))


__all__ = ["LCP_STATUSES", "STATUSES", "gradient_and_error", "lcp", "solve"]
